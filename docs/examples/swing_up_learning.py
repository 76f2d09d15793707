"""Learn the swing-up by CMA-ES, all policies of a generation side by side; minutes, and a picture.

python docs/examples/swing_up_learning.py swing_up.png
"""

import sys

import cma
import matplotlib.pyplot as plt
import numpy as np
from swing_up import PERIOD, STEPS, SwingUpVector

HIDDEN = 8
SIZE = 5 * HIDDEN + 1


def actions(weights, seen):
    """Of policies (P, SIZE) at observations (P, R, 3) of R runs each: one hidden layer, (P, R)."""
    first, last = weights[:, None, : 4 * HIDDEN].reshape(-1, 4, HIDDEN), weights[:, 4 * HIDDEN :, None]
    hidden = np.tanh(seen * [1, 1, 4] @ first[:, :3] + first[:, 3:])
    return np.tanh(hidden @ last[:, :HIDDEN] + last[:, HIDDEN:])[..., 0]


def rewards(runs, weights, seeds, steps=STEPS):
    """Return the rewards (steps, P, R) of P policies from starts by R seeds, the same for all of them."""
    shape, found = (len(weights), len(seeds), -1), []
    seen, _ = runs.reset(seed=seeds * len(weights))
    for _ in range(steps):
        seen, reward, *_ = runs.step(actions(weights, seen.reshape(shape)).reshape(-1, 1))
        found.append(reward.reshape(shape[:2]))
    return np.array(found)


def learn(generations, seed=1, population=24, starts=8, steps=STEPS):
    """Return the policy in the middle of the last generation, and all returns (generations, population)."""
    search = cma.CMAEvolutionStrategy(
        np.zeros(SIZE), 1.0, {"seed": seed, "popsize": population, "verbose": -9}
    )
    runs, curve = SwingUpVector(population * starts), []
    for generation in range(generations):
        policies = np.array(search.ask())
        seeds = [generation * starts + i for i in range(starts)]
        curve.append(rewards(runs, policies, seeds, steps).sum(axis=0).mean(axis=1))
        search.tell(list(policies), list(-curve[-1]))
    return search.result.xfavorite, np.array(curve)


if __name__ == "__main__":
    picture, generations = [*sys.argv[1:], *("swing_up.png", "150")[len(sys.argv) - 1 :]]
    policy, curve = learn(int(generations))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    left.plot(curve.max(axis=1), label="best of a generation")
    left.plot(np.median(curve, axis=1), label="median")
    left.set(xlabel="generation", ylabel="return (250: upright all the time)")
    left.legend()
    tests = rewards(SwingUpVector(32), policy[None], [100_000 + i for i in range(32)])[:, 0]
    right.plot(PERIOD * np.arange(1, STEPS + 1), tests, color="C0", alpha=0.5)
    right.set(xlabel="time [s]", ylabel="height (0 hanging, 1 upright), new starts")
    print(f"return {tests.sum(axis=0).mean():.0f}, the first generation's {curve[0].mean():.0f}")
    figure.savefig(picture, dpi=110)
