"""Robots of the gallery in time, beside MuJoCo and Drake, which read the same URDF.

Neither keeps loops closed as rigid constraints. MuJoCo's are springs and dampers: with its default stiffness
the error stays, however short the step; with a stiffness that grows as 1/step² it falls as step². Drake's
solver SAP regularises them by the step, and is of first order in it. What the errors at two steps come to
when the step goes to zero is much smaller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from drake_robots import in_drake
from gallery import GALLERY
from mujoco_robots import in_mujoco

import p3dof
from p3dof.runs import Integration

DURATION = {"four_bar": 2.0, "five_bar": 2.0, "stewart": 2.0, "leg": 0.2, "two_arms": 0.5, "biped": 0.3}
"""How long they are followed [s]: the last three fall freely, and soon through singular positions."""
STEWART = pytest.param("stewart", marks=pytest.mark.slow)
ROBOTS = pytest.mark.parametrize("name", ["four_bar", "five_bar", STEWART])
SAMPLES = 11
SPRINGS = {"five_bar": (15.0, (2.1, 1.3)), "stewart": (800.0, (0.62,) * 6)}
"""Stiffness and rest of springs at the motors, so that the robot swings; the four-bar turns freely."""


@dataclass(frozen=True)
class Run:
    """A robot, where it starts and where it comes by."""

    name: str
    loop: p3dof.ClosedLoopModel
    start: np.ndarray
    q: np.ndarray

    def off(self, q: list[np.ndarray]) -> np.ndarray:
        """How far another run's joints are from ours, sample by sample."""
        return np.array([pin.difference(self.loop.model, *pair) for pair in zip(self.q[1:], q, strict=True)])


@cache
def followed(name: str) -> Run:
    """Follow a robot by our own simulation."""
    loop = p3dof.load_robot(GALLERY / f"{name}.urdf")
    if name in SPRINGS:
        stiffness, rests = SPRINGS[name]
        springs = [
            p3dof.JointData(joint, stiffness=stiffness, rest=rest)
            for joint, rest in zip(loop.actuated, rests, strict=True)
        ]
        loop = p3dof.ClosedLoopModel(loop.model, replace(loop.sidecar, joint_data=tuple(springs)))
    target = None
    if name == "stewart":
        place = pin.SE3(pin.rpy.rpyToMatrix(0.05, -0.03, 0.1), np.array([0.02, 0.01, 0.5]))
        target = p3dof.FrameTarget("platform", place)
    start = loop.assemble(target).q
    ours = p3dof.runs.simulate_robot(
        loop,
        DURATION[name],
        start,
        samples=SAMPLES,
        stop_at=(),
        integration=Integration(rtol=1e-11, atol=1e-13),
        method="general",
    )
    assert ours.finished
    assert np.ptp(ours.energy) < 1e-9 * max(1.0, np.abs(ours.energy).max())
    assert np.ptp(ours.q, axis=0).max() > 0.1  # it moves
    return Run(name, loop, start, ours.q)


def in_mujoco_time(run: Run, step: float, stiff: bool = True) -> np.ndarray:
    mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    other = in_mujoco(run.loop, GALLERY / f"{run.name}.urdf")
    model = other.model
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
    if stiff:
        model.eq_solref[:] = -1 / step**2, -1 / step
        model.eq_solimp[:] = 0.9999, 0.9999, 0.001, 0.5, 2
        model.opt.tolerance = 0.0
    data = mujoco.MjData(model)
    data.qpos[:] = other.qpos(run.start)
    found = []
    for _ in range(SAMPLES - 1):
        mujoco.mj_step(model, data, nstep=round(DURATION[run.name] / (SAMPLES - 1) / step))
        found.append(other.from_qpos(data.qpos))
    return run.off(found)


def in_drake_time(run: Run, step: float) -> np.ndarray:
    other = in_drake(run.loop, GALLERY / f"{run.name}.urdf", step)
    from pydrake.systems.analysis import Simulator

    simulator = Simulator(other.plant)
    context = simulator.get_mutable_context()
    other.plant.SetPositions(context, other.positions(run.start))
    if other.plant.num_actuators():
        other.plant.get_actuation_input_port().FixValue(context, np.zeros(other.plant.num_actuators()))
    simulator.Initialize()
    found = []
    for time in np.linspace(0, DURATION[run.name], SAMPLES)[1:]:
        simulator.AdvanceTo(time)
        found.append(other.from_positions(other.plant.GetPositions(context)))
    return run.off(found)


# Largest errors [m, rad] that are allowed at the shorter step.
MUJOCO = {"four_bar": 1e-5, "five_bar": 1e-7, "stewart": 5e-7, "leg": 1e-4, "two_arms": 4e-5, "biped": 1e-6}
DRAKE = {"four_bar": 4e-2, "five_bar": 1.2e-3, "stewart": 6e-4}


def errors(
    simulate: Callable[[float], np.ndarray], steps: tuple[float, ...], order: int
) -> tuple[list, float]:
    """Largest errors at steps that are halved, and of what they are extrapolated to."""
    off = [simulate(step) for step in steps]
    beyond = (2**order * off[-1] - off[-2]) / (2**order - 1)
    largest = [float(np.abs(one).max()) for one in off]
    print(steps, largest, np.abs(beyond).max())  # noqa: T201 - what was measured, for pytest -s
    return largest, float(np.abs(beyond).max())


@pytest.mark.parametrize(
    "name",
    [
        "four_bar",
        "five_bar",
        STEWART,
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("leg", "biped")),
        "two_arms",
    ],
)
def test_mujoco_comes_to_the_same_with_the_square_of_its_step(name):
    run, step = followed(name), 1e-3 if DURATION[name] > 1 else 5e-4
    found, beyond = errors(lambda step: in_mujoco_time(run, step), (2 * step, step), 2)
    assert found[-1] < MUJOCO[run.name]
    assert all(3.5 < one / next_ < 5.0 for one, next_ in pairwise(found))
    assert beyond < 0.2 * found[-1]


@ROBOTS
def test_loops_of_mujoco_are_soft_whatever_the_step(name):
    """With its default stiffness, time constant 20 ms."""
    run = followed(name)
    found, _ = errors(lambda step: in_mujoco_time(run, step, stiff=False), (2e-3, 1e-3), 2)
    assert found[-1] > 1e-3
    assert found[0] == pytest.approx(found[1], rel=0.01)


@ROBOTS
def test_drake_comes_to_the_same_with_its_step(name):
    run = followed(name)
    found, beyond = errors(lambda step: in_drake_time(run, step), (5e-4, 2.5e-4), 1)
    assert found[-1] < DRAKE[run.name]
    assert all(1.9 < one / next_ < 2.2 for one, next_ in pairwise(found))
    assert beyond < 0.05 * found[-1]
