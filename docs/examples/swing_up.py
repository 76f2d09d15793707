"""Gymnasium: a linkage whose motor is too weak to lift it, and has to swing it up; many runs at once."""

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space

import p3dof

FILE = "gallery/four_bar.urdf"
TORQUE, PERIOD, STEPS = 0.6, 0.02, 250  # of the motor [N m], which needs 1.7 to lift it; [s]; of an episode
SPEED = 20.0  # [rad/s]: what is faster ends an episode


class SwingUpVector(gym.vector.VectorEnv):
    metadata = {"autoreset_mode": gym.vector.AutoresetMode.NEXT_STEP}

    def __init__(self, num_envs=1, file=FILE):
        self.num_envs, self.loop = num_envs, p3dof.load_robot(file)
        if len(self.loop.actuated) != 1:
            raise ValueError(f"expected a robot with one motor, got {', '.join(self.loop.actuated)}")
        self.single_observation_space = gym.spaces.Box(-1, 1, (3,), np.float32)
        self.single_action_space = gym.spaces.Box(-1, 1, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.crank = self.loop.model.joints[self.loop.model.getJointId(self.loop.actuated[0])].idx_q
        self.angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)[:, None]
        turn = self.loop.complete_batch(self.angles, 0 * self.angles, 0 * self.angles)
        work = np.cumsum(self.loop.inverse_dynamics_batch(turn.q, turn.v, turn.a).tau)
        self.height = (work - work.min()) / np.ptp(work)  # 0 where it hangs, 1 where it stands upright
        self.q, self.v = np.zeros((2, num_envs, self.loop.model.nv))
        self.steps, self.over = np.zeros(num_envs, int), np.ones(num_envs, bool)
        self.rngs = [np.random.default_rng() for _ in range(num_envs)]

    def _start(self, which):
        angles = [self.angles[self.height.argmin()] + self.rngs[i].uniform(-0.3, 0.3, 1) for i in which]
        states = self.loop.complete_batch(np.reshape(angles, (-1, 1)), *np.zeros((2, len(which), 1)))
        self.q[which], self.v[which], self.steps[which], self.over[which] = states.q, 0, 0, False

    def _observation(self):
        angle, speed = self.q[:, self.crank], self.v[:, self.crank] / SPEED
        return np.stack([np.cos(angle), np.sin(angle), speed.clip(-1, 1)], axis=1).astype(np.float32)

    def reset(self, *, seed=None, options=None):
        if seed is not None:
            seeds = seed + np.arange(self.num_envs) if np.isscalar(seed) else seed
            self.rngs = [np.random.default_rng(one) for one in seeds]
        self._start(np.arange(self.num_envs))
        return self._observation(), {}

    def step(self, actions):
        columns = {"q": self.q, "v": self.v, "forces": TORQUE * np.clip(actions, -1, 1)}
        runs, new = p3dof.runs.simulate_robot_many(self.loop, PERIOD, columns, stop_at=()), self.over.copy()
        self.q, self.v, self.steps = runs.q.copy(), runs.v.copy(), self.steps + 1
        self._start(np.flatnonzero(new))
        height = np.interp(self.q[:, self.crank], self.angles[:, 0], self.height, period=2 * np.pi)
        terminated = np.abs(self.v[:, self.crank]) > SPEED
        self.over = terminated | (self.steps >= STEPS)
        return self._observation(), np.where(new, 0.0, height), terminated, self.steps >= STEPS, {}
