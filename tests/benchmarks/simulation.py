"""Speed of simulation as a multiple of real time, of all ways on the same run, interleaved in one process.

The machine falls from home under constant forces a little too small to hold it. Run with ``make benchmark``.
Timings are never a test: machines differ; compare the ratios of one run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from importlib.util import find_spec

import numpy as np
import pinocchio as pin
from rich.table import Table
from rounds import Contender, described, measure, wide_console

import p3dof
from p3dof import ControlLoop, Integration, engines
from p3dof.parameters import SLIDES

ROUNDS = 5
DURATION = 0.5
STEP = 1e-3
RTOL = 1e-9
"""Relative tolerance: looser than by default, to stand beside engines of fixed steps."""
HOME = np.zeros(3)
LIBRARIES = {"mujoco": "mujoco", "drake": "pydrake", "exudyn": "exudyn"}


def main() -> None:
    """Measure and print."""
    robot = p3dof.load()
    forces = robot.forces(HOME, HOME, HOME) * [0.95, 1.0, 1.05]
    ends: dict[str, np.ndarray] = {}
    contenders = [contender(name, run, ends) for name, run in ways(robot, forces).items()]
    found = measure(contenders, ROUNDS, share=np.inf)
    exact = robot.simulate(
        DURATION,
        controller=forces,
        method="virtual-power",
        samples=2,
        integration=Integration(rtol=1e-12, atol=1e-14),
    ).sliders[-1]
    table = Table("simulation", "× real time", "µs per simulated ms", "error of the sliders at the end")
    for (_, name, _), timing in found.items():
        error = f"{np.abs(ends[name] - exact).max():.1e} m"
        table.add_row(name, f"{DURATION / timing.median:.3g}", f"{timing.median / DURATION * 1e3:.3g}", error)
    console = wide_console()
    console.print(table)
    console.print(f"median of {ROUNDS} interleaved rounds of {DURATION} s; {described()}", soft_wrap=True)


def contender(
    name: str, run: Callable[[], tuple[np.ndarray, float]], ends: dict[str, np.ndarray]
) -> Contender:
    """Return a way as a contender, which also tells where it ended."""

    def runs(count: int) -> float:
        total = 0.0
        for _ in range(count):
            ends[name], seconds = run()
            total += seconds
        return total

    return Contender("simulation", name, "", runs)


def ways(
    robot: p3dof.Manipulator, forces: np.ndarray
) -> Mapping[str, Callable[[], tuple[np.ndarray, float]]]:
    """Return what to measure: each returns the sliders at the end and the seconds that it took."""

    def ours(method: str, rate: float | None = None) -> Callable[[], tuple[np.ndarray, float]]:
        options = {
            "method": method,
            "control": ControlLoop(rate),
            "integration": Integration(RTOL, RTOL / 100),
        }

        def run() -> tuple[np.ndarray, float]:
            done = robot.simulate(DURATION, controller=forces, samples=2, **options)
            assert done.finished
            return done.sliders[-1], done.seconds

        return run

    def other(name: str) -> Callable[[], tuple[np.ndarray, float]]:
        engine = engines.load(name, robot.parameters)

        def run() -> tuple[np.ndarray, float]:
            end = engine.simulate(DURATION, STEP, HOME, forces)
            return np.array([end.positions[slide] for slide in SLIDES]), end.seconds

        return run

    found = {
        "y, z, θ, compiled, adaptive": ours("compiled"),
        "y, z, θ, compiled, forces held at 1 kHz": ours("compiled", 1000.0),
        "y, z, θ, adaptive": ours("virtual-power"),
        "y, z, θ, forces held at 1 kHz": ours("virtual-power", 1000.0),
        "all joints, adaptive": ours("pinocchio"),
        "all joints, forces held at 1 kHz": ours("pinocchio", 1000.0),
        "bare pin.constraintDynamics, semi-implicit Euler, 1 ms": lambda: bare_steps(robot, forces),
    }
    for name, library in LIBRARIES.items():
        if find_spec(library) is not None:
            found[f"{name}, 1 ms"] = other(name)
    return found


def bare_steps(robot: p3dof.Manipulator, forces: np.ndarray) -> tuple[np.ndarray, float]:
    """Step Pinocchio's constrained dynamics with nothing around it."""
    model = robot.model
    data = model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for constraint in robot.constraint_models:
        models.append(pin.convertToRigidConstraintModel(model, constraint.extract()))
        datas.append(models[-1].createData())
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 50)
    slides = [model.idx_vs[model.getJointId(name)] for name in SLIDES]
    q, v, tau = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
    tau[slides] = forces
    begun = time.perf_counter()
    for _ in range(round(DURATION / STEP)):
        v = v + STEP * pin.constraintDynamics(model, data, q, v, tau, models, datas, settings)
        q = q + STEP * v
    return q[slides], time.perf_counter() - begun


if __name__ == "__main__":
    main()
