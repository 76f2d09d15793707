"""How long workspaces and indices take: ``make benchmark``, or this file.

The volume of a workspace, the indices of 200 × 200 poses, and a map of all of them, on one thread.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import p3dof


def least(task, rounds=5):
    """Seconds of processor time of the quickest of several rounds."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        task()
        times.append(time.process_time() - start)
    return min(times)


def main():
    robot = p3dof.load()
    space = robot.workspace()
    y, theta = np.linspace(-0.24, 0.24, 200), np.linspace(-0.78, 0.78, 200)
    grid = np.stack(np.broadcast_arrays(y[:, None], 0.0, theta), axis=-1)
    tasks = {
        "volume of a workspace": lambda: robot.workspace().volume,
        "the largest box": space.largest_box,
        "all indices of 200 × 200 poses": lambda: robot.indices(grid).columns,
        "a map of all indices, 200 × 200": space.map,
        "mean of LTI over the workspace": lambda: space.mean("lti"),
        "share with LTI from 0.7": lambda: space.share("lti", 0.7),
    }
    for name, task in tasks.items():
        sys.stdout.write(f"{name:34s} {1e3 * least(task):9.2f} ms\n")


if __name__ == "__main__":
    main()
