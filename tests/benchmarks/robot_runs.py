"""Runs of any robot in time: in C, one and many side by side, beside the integrator in Python.

How many times as fast as in reality a robot of the gallery moves under PD control at 1 kHz, RK4 a tick, for
ten seconds with 1001 samples; CPU time, the best of some turns. Timings are never a test: machines differ.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import click
import numpy as np
from robots import GALLERY
from rounds import described, load_average

import p3dof
from p3dof.runs import (
    ControlLoop,
    Integration,
    JointPD,
    JointReference,
    moved_inertia,
    simulate_robot,
    simulate_robot_many,
)

ROBOTS = ("four_bar", "five_bar", "delta", "stewart")
SECONDS, RATE, MANY = 10.0, 1000.0, 256
PROMISED = {"in C": 150.0, "in lanes, each": 1000.0}
"""Times real time, of the Stewart platform."""


def best(call: Callable[[], Any], turns: int) -> tuple[float, Any]:
    """Return the CPU seconds of the fastest turn, and what it returned."""
    least, found = np.inf, None
    for _ in range(turns):
        begun = time.process_time()
        found = call()
        least = min(least, time.process_time() - begun)
    return least, found


def rows(name: str) -> list[tuple[str, float, float]]:
    """Return ways, times real time, and the largest gap of the loops."""
    loop = p3dof.load_robot(GALLERY / f"{name}.urdf")
    q = loop.assemble().q
    home = np.array([q[loop.model.joints[loop.model.getJointId(joint)].idx_q] for joint in loop.actuated])
    instants = np.linspace(0, SECONDS, 201)
    swing = 0.02 * np.sin(np.pi * instants[:, None] + np.arange(len(home)))
    wanted = JointReference(instants, home + swing - swing[0])
    start = loop.complete(*wanted.at(0.0), q)
    frequency = 2 * np.pi * 8
    inertia = moved_inertia(loop, q)
    stay = JointPD(loop, wanted, frequency**2 * inertia, 2 * frequency * inertia)
    level = JointPD(loop, wanted, stay.kp, stay.kd, gravity=True)
    control, fixed = ControlLoop(RATE), Integration(scheme="rk4", step=1 / RATE)
    compiled = loop.compile(threads=1)

    def run(seconds: float, method: Any, of: Integration = fixed, acts: Any = stay) -> Any:
        arguments = loop, seconds, start.q, start.v, acts
        return simulate_robot(*arguments, control=control, integration=of, method=method, stop_at=())

    def many() -> Any:
        columns = {"q": start.q, "v": start.v, "kp": np.linspace(0.8, 1.2, MANY)[:, None] * stay.kp}
        return simulate_robot_many(
            loop, SECONDS, columns, stay, control=control, integration=fixed, stop_at=(), threads=1
        )

    run(0.1, compiled)
    many()
    found = []
    for words, seconds, count, call, turns in (
        ("in C", SECONDS, 1, lambda: run(SECONDS, compiled), 7),
        ("in C, with gravity", SECONDS, 1, lambda: run(SECONDS, compiled, acts=level), 7),
        ("in lanes, each", SECONDS, MANY, many, 3),
        ("in C, adaptive steps", SECONDS, 1, lambda: run(SECONDS, compiled, Integration()), 3),
        ("Python, rk4, general", 0.5, 1, lambda: run(0.5, "general"), 1),
    ):
        least, one = best(call, turns)
        found.append((words, count * seconds / least, float(np.max(one.gap))))
        if words == "in C":
            found.append(("  of it the steps", seconds / one.seconds, float(np.max(one.gap))))
    return found


@click.command()
@click.option("--only", multiple=True, help=f"Robots of the gallery; {', '.join(ROBOTS)} by default.")
def main(only: tuple[str, ...]) -> None:
    """Print how fast robots move in time."""
    sys.stdout.write(f"{described()}\nload {load_average()}\n")
    for name in only or ROBOTS:
        for words, speed, gap in rows(name):
            least = PROMISED.get(words) if name == "stewart" else None
            told = "" if least is None else f"  promised {least:g}: {'yes' if speed >= least else 'NO'}"
            sys.stdout.write(f"{name:10} {words:32} {speed:9.0f} x real time, gap {gap:.0e}{told}\n")


if __name__ == "__main__":
    main()
