"""One run of `swing_up` as an environment of Gymnasium, and both under a name for `make` and `make_vec`."""

import gymnasium as gym
from gymnasium.utils.env_checker import check_env
from swing_up import FILE, SwingUpVector


class SwingUp(gym.Env):
    def __init__(self, file=FILE):
        self.one = SwingUpVector(1, file)
        self.observation_space = self.one.single_observation_space
        self.action_space = self.one.single_action_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.one.reset(seed=seed)[0][0], {}

    def step(self, action):
        observation, reward, terminated, truncated, _ = self.one.step(action[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), {}


gym.register("p3dof/SwingUp-v0", SwingUp, vector_entry_point=SwingUpVector)

if __name__ == "__main__":
    check_env(gym.make("p3dof/SwingUp-v0").unwrapped)
    runs = gym.make_vec("p3dof/SwingUp-v0", num_envs=256)
    runs.reset(seed=1)
    print(runs.step(runs.action_space.sample())[1].mean())
