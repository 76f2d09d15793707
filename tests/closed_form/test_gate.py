"""Which samples are valid: each way to the forces finds out by itself, and a difference is told."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from machines import SEEDS, random_machine

import p3dof
from p3dof._base.errors import InputError, ReachError, SingularityError
from p3dof._base.samples import ACTUATION_TOLERANCE, wrench_like
from p3dof.cli import main
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics import validity as closed
from p3dof.machine.parameters import PAPER
from p3dof.methods import pinocchio
from p3dof.methods import pinocchio as gate

BORDER = 1e-9
"""Where the verdicts may differ: this share of a leg's length, or of the least angle of actuation."""
REST = np.zeros(3)


def verdicts(robot, poses):
    """What both ways say, and where they need not agree."""
    valid = [
        np.isfinite(robot.forces(poses, REST, REST, method=method, on_invalid="nan")).all(axis=1)
        for method in ("pinocchio", "virtual-power")
    ]
    found, L = kinematics.singularity(robot.parameters.geometry, poses), robot.parameters.geometry.L
    border = np.abs(found.serial).min(axis=1) <= BORDER * L
    border |= np.abs(np.abs(found.actuation) / ACTUATION_TOLERANCE - 1) <= BORDER
    return (*valid, border)


def box(geometry, seed, count):
    """Poses in a box three times as large as the workspace."""
    reach = geometry.L - (geometry.R - geometry.r)
    return np.random.default_rng(seed).uniform(-3, 3, (count, 3)) * [reach, geometry.L, np.pi / 3]


def test_both_ways_judge_alike_over_three_times_the_workspace():
    robot = p3dof.load()
    pinocchio, closed, border = verdicts(robot, box(PAPER.geometry, 1, 2000))
    assert not border.any()
    np.testing.assert_array_equal(pinocchio, closed)
    assert 0.2 < closed.mean() < 0.5


@settings(max_examples=15)
@given(SEEDS)
def test_both_ways_judge_random_machines_alike(seed):
    robot = p3dof.load(random_machine(seed))
    pinocchio, closed, border = verdicts(robot, box(robot.parameters.geometry, seed, 60))
    np.testing.assert_array_equal(pinocchio[~border], closed[~border])


def test_both_ways_judge_alike_at_the_borders():
    """Just inside and just outside of reach, and of the least angle from the actuation singularity."""
    g = PAPER.geometry
    inside = np.array([1e-3, 1e-6, 1e-9, -1e-9, -1e-6, -1e-3]) * 1.001
    y = g.L * (1 - inside) - (g.R - g.r)
    theta = np.arccos((g.R - np.sqrt((g.L * (1 - inside)) ** 2 - 0.2**2)) / g.r)
    legs = np.concatenate([
        np.column_stack([y, 0.1 + 0 * y, 0.2 + 0 * y]),
        np.column_stack([-y, 0 * y, 0 * y]),
        np.column_stack([0.2 + 0 * y, 0 * y, theta]),
    ])  # fmt: skip
    singular = np.arccos(g.R / (g.r + g.L))
    angles = np.array([2, 1.001, 0.999, 0.5, 0, -0.5, -0.999, -1.001, -2]) * ACTUATION_TOLERANCE
    hold = np.column_stack([0 * angles, 0 * angles, singular - angles / (1 + g.r / g.L)])
    pinocchio, closed, border = verdicts(p3dof.load(), np.concatenate([legs, hold]))
    assert not border[[0, 1, 2, 3, 4, 5]].any()
    np.testing.assert_array_equal(pinocchio, closed)
    assert closed.tolist() == 3 * (3 * [True] + 3 * [False]) + 2 * [True] + 5 * [False] + 2 * [True]


def test_margins_of_its_own_are_those_of_the_closed_forms():
    robot, g = p3dof.load(), PAPER.geometry
    poses = box(g, 2, 300)
    own = gate.Gate(robot.loop)
    found = kinematics.singularity(g, poses)
    np.testing.assert_allclose(
        own.margins(pinocchio.targets_of(poses, g.h)), found.serial, rtol=0, atol=1e-15
    )
    motion = p3dof.paper_motion(101)
    actuations = [robot.inverse_dynamics(motion, method=m).actuation for m in ("pinocchio", "virtual-power")]
    np.testing.assert_allclose(*actuations, rtol=0, atol=1e-12)
    few = [robot.inverse_dynamics(motion[:3], method=m).actuation for m in ("pinocchio", "virtual-power")]
    np.testing.assert_allclose(*few, rtol=0, atol=1e-12)


def test_the_lengths_of_the_chains_only_save_time(monkeypatch):
    """Poses that they rule out do not assemble either."""
    robot, poses = p3dof.load(), box(PAPER.geometry, 3, 40)
    expected = np.isfinite(robot.forces(poses, REST, REST, on_invalid="nan")).all(axis=1)
    monkeypatch.setattr(gate, "_HOPELESS", np.inf)
    found = np.isfinite(robot.forces(poses, REST, REST, on_invalid="nan")).all(axis=1)
    np.testing.assert_array_equal(found, expected)
    assert 5 < expected.sum() < 25


@pytest.mark.parametrize("count", [5, 40])
def test_errors_are_alike(count):
    """Kind, sample, how many, leg and margin; whether one by one or in a batch."""
    robot = p3dof.load()
    for where, kind in (([0.3, 0, 0], ReachError), ([0, 0, np.pi / 3], SingularityError)):
        poses = np.zeros((2, count, 3))
        poses[1, [2, 4]] = where
        errors = []
        for method in ("pinocchio", "virtual-power"):
            with pytest.raises(kind) as info:
                robot.forces(poses, REST, REST, method=method)
            errors.append(info.value)
        first, second = errors
        assert (first.index, first.count) == (second.index, second.count) == ((1, 2), 2)
        if kind is ReachError:
            assert str(first) == str(second)
            assert (first.leg, second.leg) == ("a", "a")
            assert abs(first.margin - second.margin) < 1e-15
    with pytest.raises(ReachError, match=r"sample 1, the first of 1 such"):
        robot.forward_dynamics([REST, [0.3, 0, 0]], REST, REST, method="pinocchio")


def test_a_long_batch_ends_soon_after_the_first_invalid_sample():
    poses = np.zeros((5000, 3))
    poses[7:, 0] = 0.3
    with pytest.raises(ReachError, match="sample 7, the first of at least 1017 such of 5000"):
        p3dof.load().forces(poses, REST, REST)


def short_leg(geometry, serial):
    return np.all(serial > 0.01 * geometry.L, axis=-1)


GATES = {
    "closed forms, reach": (closed, "reached", short_leg),
    "closed forms, actuation": (closed, "actuation_angle", lambda x: 0 * x.cos_54),
    "Pinocchio, reach": (gate.Gate, "hopeless", lambda _, margins: (margins < 0.004).any(axis=-1)),
    "Pinocchio, actuation": (gate.Gate, "actuation", lambda _, angle, __: np.where(abs(angle) > 0.1, 0, 1)),
}


@pytest.mark.parametrize("on_invalid", ["raise", "nan"])
@pytest.mark.parametrize("name", GATES)
def test_a_wrong_verdict_of_one_way_is_noticed(tmp_path, capsys, monkeypatch, name, on_invalid):
    time = np.linspace(0, 1, 21)
    # To within .5 % of the reach of leg A: all of it is valid.
    p3dof.Motion.from_poses(time, np.column_stack([0.248 * time**2, 0 * time, 0 * time])).to_csv(
        tmp_path / "m.csv"
    )
    arguments = ["compare", "--motion", str(tmp_path / "m.csv"), "--out", str(tmp_path), "--no-plot"]
    assert main([*arguments, "--on-invalid", on_invalid]) == 0
    assert "DISAGREE" not in capsys.readouterr().out
    monkeypatch.setattr(*GATES[name])
    assert main([*arguments, "--on-invalid", on_invalid]) == 1
    assert "the methods DISAGREE on which samples are valid: " in capsys.readouterr().out


def test_a_wrench_that_is_not_finite_is_refused_or_marks_its_sample():
    wrench = np.arange(18.0).reshape(3, 6)
    wrench[1, 4] = np.inf
    with pytest.raises(InputError, match=r"^wrench: .*inf"):
        wrench_like(wrench, (3,), "raise")
    found = wrench_like(wrench, (3,), "nan")
    assert np.isnan(found[1]).all()
    np.testing.assert_array_equal(found[[0, 2]], wrench[[0, 2]])
