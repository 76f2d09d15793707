"""Ten seconds of robots of the gallery without friction: the energy stays, and the loops stay closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gallery import GALLERY as FOLDER

import p3dof
from p3dof.loops import ClosedLoopModel, JointData
from p3dof.loops.tables import joint_values
from p3dof.runs import moved_inertia, simulate_robot

SECONDS = 10.0
DRIFT = 1e-8
"""Of the energy, as a share of the largest kinetic one: the tolerance of a step is 1e-9."""
GAP = 1e-9
"""Of the loops [m]."""


def on_springs(name: str, frequency: float) -> tuple[ClosedLoopModel, np.ndarray]:
    """A robot whose actuated joints hang on springs that hold it at its reference, and their values there."""
    robot = p3dof.load_robot(FOLDER / f"{name}.urdf")
    q = robot.assemble().q
    stiffness = moved_inertia(robot, q) * (2 * np.pi * frequency) ** 2
    holding = robot.inverse_dynamics(q, np.zeros(robot.model.nv), np.zeros(robot.model.nv)).tau
    values = np.array([joint_values(robot, q)[joint][0] for joint in robot.actuated])
    springs = tuple(
        JointData(joint, stiffness=float(k), rest=float(x + force / k))
        for joint, k, x, force in zip(robot.actuated, stiffness, values, holding, strict=True)
    )
    return ClosedLoopModel(robot.model, replace(robot.sidecar, joint_data=springs)), values


@pytest.mark.parametrize(
    ("name", "frequency", "speed"),
    [
        ("five_bar", 1.5, 2.0),
        pytest.param("delta", 1.0, 2.0, marks=pytest.mark.slow),
        pytest.param("stewart", 2.0, 0.2, marks=pytest.mark.slow),
    ],
)
def test_robots_on_springs_keep_their_energy_for_ten_seconds(name, frequency, speed):
    robot, values = on_springs(name, frequency)
    count = len(values)
    begin = robot.complete(values, speed * np.cos(2 * np.arange(count)), np.zeros(count))
    check(simulate_robot(robot, SECONDS, begin.q, begin.v, samples=101, method="general"))


@pytest.mark.slow
def test_the_four_bar_swings_for_ten_seconds():
    check(simulate_robot(p3dof.load_robot(FOLDER / "four_bar.urdf"), SECONDS, samples=101, method="general"))


def check(run):
    assert run.finished
    energies = run.loop.body_energies(run.q, run.v)
    kinetic = energies.kinetic.sum(axis=1)
    assert np.ptp(kinetic) > 0.9 * kinetic.max() > 0.05  # it comes to rest and back
    assert np.ptp(run.energy) < DRIFT * kinetic.max()
    assert run.gap.max() < GAP
