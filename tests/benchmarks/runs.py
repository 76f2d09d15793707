"""Runs of the paper's machine in C: times faster than real time, than the integrator in Python, than SciPy.

All in one process, on one thread, in processor time; the least of interleaved rounds. Errors are those of the
poses at the samples against a run at the smallest tolerances. "prepared" is a call of what
`robot.prepare_run` made, "call" all of `robot.simulate`, the result included. MuJoCo and the other engines
are in ``simulation.py``, at equal errors. Run with ``make benchmark``. Timings are never a test: machines
differ; compare the ratios of one run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table
from rounds import load_average, wide_console
from scipy.integrate import solve_ivp

import p3dof
from p3dof.runs import PD, ComputedTorque, ControlLoop, Integration, Springs
from p3dof.runs.machine import RunOfMachine

HOME, ROUNDS = np.zeros(3), 5
EXACT = Integration(rtol=1e-13, atol=1e-16)


@dataclass(frozen=True, eq=False)
class Case:
    """What is simulated, and how long [s]."""

    name: str
    duration: float
    how: dict[str, Any]
    plain: bool = False
    """Whether SciPy can do it as it is."""


def cases(robot: p3dof.Manipulator) -> list[Case]:
    """Return what is measured."""
    motion, hold = p3dof.paper_motion(), robot.forces(HOME, HOME, HOME)
    swinging = Springs(2000.0, preload=hold)
    at_1_khz = ControlLoop(1000)

    def python(measured: Any) -> Any:
        return hold - 3000 * measured.sliders - 100 * measured.slider_velocities

    fall = {"start": [0, 0, 0.15], "controller": hold * 0.9, "samples": 2}
    swing = {"start": [0.02, 0.03, 0.15], "controller": swinging, "samples": 2}
    place = {"start": [0, 0.01, 0], "samples": 2, "control": at_1_khz}
    follow = {"control": at_1_khz, "samples": 2}
    equal, late = {"integration": Integration(scheme="rk4")}, {"control": ControlLoop(1000, delay=1.5e-3)}
    torque = ComputedTorque(robot, motion)
    return [
        Case("falling, adaptive", 0.3, fall, plain=True),
        Case("swinging on springs, adaptive", 20.0, swing),
        Case("PD at 1 kHz", 1.0, {"controller": PD(robot, motion), **follow}),
        Case("computed torque at 1 kHz", 1.0, {"controller": torque, **follow}),
        Case("PD at 1 kHz, rk4", 1.0, {"controller": PD(robot, motion), **follow, **equal}),
        Case("computed torque at 1 kHz, rk4", 1.0, {"controller": torque, **follow, **equal}),
        Case("PD at 1 kHz, late by 1.5 periods", 1.0, {"controller": PD(robot, motion), **follow, **late}),
        Case("computed torque, continuous", 1.0, {"controller": torque, "samples": 2}),
        Case("springs held at 1 kHz", 1.0, {**place, "controller": swinging}),
        Case("Python's controller at 1 kHz", 1.0, {**place, "controller": python}),
    ]


def in_python(robot: p3dof.Manipulator, case: Case, **more: Any) -> p3dof.Simulation:
    """Run by the integrator in Python, over the same kernels."""
    return RunOfMachine(robot, case.duration, method="compiled", **case.how, **more).in_python()


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call, and what it returns."""
    begun = time.process_time()
    found = run()
    return time.process_time() - begun, found


def by_scipy(robot: p3dof.Manipulator, case: Case) -> tuple[float, int]:
    """Return seconds and evaluations of SciPy's DOP853 on our kernel: no limits, no samples, no events."""
    accelerate = robot.kernels.function("forward_dynamics_loaded")
    forces = [float(force) for force in case.how["controller"]]

    def rate(_: float, state: np.ndarray) -> list[float]:
        y, z, theta, *speed = state.tolist()
        return [*speed, *accelerate(y, z, theta, *speed, *forces, 0.0, 0.0, 0.0)[:3]]

    start = [*case.how["start"], 0, 0, 0]
    tolerances = {"rtol": 1e-11, "atol": 1e-13}
    seconds, found = timed(lambda: solve_ivp(rate, (0, case.duration), start, method="DOP853", **tolerances))
    return seconds, int(found.nfev)


def row(robot: p3dof.Manipulator, case: Case) -> list[str]:
    """Measure one case."""
    inner, call, python, scipy = [], [], [], []
    start = case.how.get("start", HOME)
    prepared = robot.prepare_run(case.duration, **{k: v for k, v in case.how.items() if k != "start"})
    for _ in range(ROUNDS):
        for _ in range(20 if case.duration < 1 else 3):
            seconds, run = timed(lambda: robot.simulate(case.duration, method="compiled", **case.how))
            call.append(seconds)
            inner.append(timed(lambda: prepared(start))[0])
        python.append(in_python(robot, case).seconds)
        if case.plain:
            scipy.append(by_scipy(robot, case))
    theirs = in_python(robot, case)
    exact = robot.simulate(case.duration, method="compiled", **case.how | {"integration": EXACT})
    if len(run) != len(exact):
        raise SystemExit(f"{case.name}: the runs end in different places")
    error = float(np.abs(run.pose - exact.pose).max())
    lasted = run.time[-1]
    return [
        case.name,
        f"{lasted / min(inner):,.0f}",
        f"{lasted / min(call):,.0f}",
        f"{min(python) / min(inner):,.0f}",
        f"{min(seconds for seconds, _ in scipy) / min(inner):,.0f}" if scipy else "",
        f"{error:.1e}",
        f"{run.evaluations:,}",
        f"{theirs.evaluations:,}",
        f"{1e9 * min(inner) / run.evaluations:.0f}",
    ]


def main() -> None:
    """Measure, and print a table."""
    robot = p3dof.load()
    table = Table(title=f"{robot.kernels!r}, load {load_average()}")
    heads = ["run", "× real time, prepared", "× real time, call", "× Python's", "× SciPy's, bare"]
    for head in (*heads, "error [m, rad]", "evaluations", "Python's", "ns each"):
        table.add_column(head, justify="left" if head == "run" else "right")
    for case in cases(robot):
        table.add_row(*row(robot, case))
    wide_console().print(table)


if __name__ == "__main__":
    main()
