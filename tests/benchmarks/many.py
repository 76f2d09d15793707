"""How fast many runs and single runs in equal steps are: CPU time, medians, one process.

Say how busy the computer is.

python tests/benchmarks/many.py [runs]
"""

from __future__ import annotations

import os
import statistics
import sys
import time

import numpy as np

import p3dof
from p3dof import PAPER, PD, ComputedTorque, ControlLoop, Feedforward, Integration

RUNS = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
ROUNDS = 5
MOTION = p3dof.paper_motion(1001).from_rest(0.2)
AT_1_KHZ = ControlLoop(1000)


def columns(count: int) -> dict[str, np.ndarray]:
    """Return runs with a machine, a start and gains each."""
    rng = np.random.default_rng(0)
    y, z, theta = MOTION.pose[0]
    return {
        "start.y": y + rng.normal(0, 1e-3, count),
        "start.z": z + rng.normal(0, 1e-3, count),
        "start.theta": theta + rng.normal(0, 1e-3, count),
        "L": PAPER.geometry.L * rng.normal(1, 1e-3, count),
        "platform.mass": PAPER.bodies.platform.mass * rng.normal(1, 0.05, count),
        "frequency": rng.uniform(4, 6, count),
        "damping": rng.uniform(0.7, 1.0, count),
    }


def seconds(work, clock=time.process_time) -> float:
    """Return the median of some rounds."""
    found = []
    for _ in range(ROUNDS):
        begun = clock()
        work()
        found.append(clock() - begun)
    return statistics.median(found)


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201 - its output


def main() -> None:
    """Print the table."""
    robot, many = p3dof.load(), columns(RUNS)
    start = MOTION.pose[0]
    _say(
        f"load {os.getloadavg()[0]:.1f}; {RUNS} runs of 1 s at 1 kHz, each with its own machine, start, gains"
    )
    for kind in (PD, Feedforward, ComputedTorque):
        loop = {"controller": kind(PAPER, MOTION), "control": AT_1_KHZ}
        for level in robot_levels():
            took = seconds(
                lambda loop=loop, level=level: robot.simulate_many(1.0, many, threads=1, level=level, **loop)
            )
            _say(
                f"{kind.__name__:16} {level:9} {took:7.3f} s of CPU, {RUNS / took:9.0f} x real time a thread"
            )
    loop = {"controller": PD(PAPER, MOTION), "control": AT_1_KHZ}
    one, two = (
        seconds(lambda n=n: robot.simulate_many(1.0, many, threads=n, **loop), time.perf_counter)
        for n in (1, 2)
    )
    _say(f"two threads are {one / two:.2f} x one (on the clock; needs two free cores)")
    for kind in (PD, ComputedTorque):
        loop = {"controller": kind(PAPER, MOTION), "control": AT_1_KHZ, "start": start}
        long, short = (
            seconds(lambda d=d, loop=loop: robot.simulate_many(d, 1, threads=1, lanes=False, **loop))
            for d in (1.1, 0.1)
        )
        exact = robot.simulate_many(1.0, 1, **loop, integration=Integration(rtol=1e-12, atol=1e-15))
        error = np.abs(robot.simulate_many(1.0, 1, lanes=False, **loop).pose - exact.pose)[:, :2].max()
        _say(
            f"one run, {kind.__name__:14} {1 / (long - short):7.0f} x real time beside a call's own "
            f"{1e3 * short:.2f} ms; error {error:.1e} m (against rtol 1e-12)"
        )


def robot_levels() -> tuple[str, ...]:
    """Return the levels of the extension."""
    from p3dof.closed_form.compiled import levels

    return levels()[1:]


if __name__ == "__main__":
    main()
