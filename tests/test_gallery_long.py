"""Ten seconds of four robots of the gallery: no energy is lost or made, and the loops stay closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_gallery import FOLDER

import p3dof
from p3dof.loops.tables import joint_values

SPRINGS = {"four_bar": None, "five_bar": (15.0, 0.1), "delta": (20.0, 0.1), "stewart": (1500.0, 0.02)}
"""Stiffness of springs at the motors, and how far from the start they are at rest; the four-bar is free."""


@pytest.mark.parametrize("name", SPRINGS)
def test_energy_and_closures_over_ten_seconds(name):
    robot = p3dof.load_robot(FOLDER / f"{name}.urdf")
    start = robot.assemble().q
    if SPRINGS[name] is not None:
        stiffness, aside = SPRINGS[name]
        values = joint_values(robot, start)
        signs = np.resize([1.0, -1.0, 0.5], len(robot.actuated))  # no two motors move alike
        springs = tuple(
            p3dof.JointData(joint, stiffness=stiffness, rest=float(values[joint][0]) + aside * sign)
            for joint, sign in zip(robot.actuated, signs, strict=True)
        )
        robot = p3dof.ClosedLoopModel(robot.model, replace(robot.sidecar, joint_data=springs))
    run = p3dof.runs.simulate_robot(robot, 10.0, start, samples=201)
    assert run.finished
    kinetic = robot.body_energies(run.q, run.v).kinetic.sum(axis=-1)
    print(name, np.ptp(run.energy), kinetic.max(), run.gap.max())  # noqa: T201 - for pytest -s
    assert kinetic.max() > 0.01
    assert np.ptp(run.energy) < 1e-7 * kinetic.max()
    assert run.gap.max() < 1e-9
