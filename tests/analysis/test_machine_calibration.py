"""Calibration of the manipulator: by machines whose legs differ, by the general layer, by differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import AssemblyError, InputError, ReachError
from p3dof.analysis.tolerances import calibrate_machine, machine_calibration_tables, plan_machine
from p3dof.analysis.tolerances.calibration import ALL, _candidates, _Problem
from p3dof.analysis.tolerances.pose import NAMES, closures, pose_gradient, solved
from p3dof.closed_form.kinematics import forward_kinematics
from p3dof.loops import Measurements
from p3dof.loops.identification.calibration import MeasuredRobot
from p3dof.loops.identification.fitting import displacements
from p3dof.machine.parameters import PAPER

WIDTH = dict.fromkeys(("R", "r", "L", "encoder"), 5e-05)
SIGMA = np.array([10e-6, 10e-6, 50e-6])


def built(seed, count=70):
    """Readings and poses of a machine whose legs are 50 µm off, and its errors; noise of what measures."""
    rng, geometry = np.random.default_rng(seed), PAPER.geometry
    read = _candidates(PAPER, count, seed)
    off = 50e-6 * rng.normal(size=12)
    true = solved(geometry, read, off, forward_kinematics(geometry, read))
    return read, true, true + SIGMA * rng.normal(size=true.shape), off


def test_errors_of_50_um_are_found_to_the_size_of_the_covariance():
    """Over machines, errors of the parameters have the covariance; those of held-out poses are small."""
    distances, ratios = [], []
    for seed in range(8):
        read, true, seen, off = built(seed)
        found = calibrate_machine(None, read[:60], seen[:60], SIGMA, WIDTH)
        assert found.names == NAMES
        error = found.parameters - off
        distances.append(error @ np.linalg.solve(found.covariance, error))
        assert found.noise == pytest.approx(1, abs=4 / np.sqrt(2 * 170))
        before, after, file = found.errors(read[60:], true[60:])
        rms = [np.sqrt(np.mean((part / SIGMA) ** 2)) for part in (before, after, file)]
        ratios.append(rms)
        assert rms[1] < 1  # less than the noise of one measurement
        assert found.outliers == ()
    # Twelve numbers each, with the prior; their mean square has the deviation sqrt(2 / 96).
    assert np.mean(distances) / 12 == pytest.approx(1, abs=4 * np.sqrt(2 / 96))
    before, after, file = np.mean(ratios, axis=0)
    assert before / after > 20
    assert 2 < before / file < 20  # one R, r, L for all legs do not hold what legs of their own are


def test_exact_poses_give_back_the_machine_as_far_as_it_is_seen():
    read, true, _, off = built(1, 40)
    found = calibrate_machine(p3dof.load(), read, true, SIGMA * 1e-6, WIDTH)
    assert found.seen.rank == 10
    assert found.seen.unseen == ("R.a + r.a", "R.b + r.b")
    d = dict(zip(NAMES, found.parameters - off, strict=True))
    for leg in "ab":  # of each pair only the difference
        assert d[f"R.{leg}"] - d[f"r.{leg}"] == pytest.approx(0, abs=1e-13)
    assert_allclose([d[f"{kind}.c"] for kind in ("R", "r", "L", "encoder")], 0, atol=1e-12)
    # The unseen sums keep the design: of a difference, each takes half.
    both = dict(zip(NAMES, found.parameters, strict=True))
    assert both["R.a"] + both["r.a"] == pytest.approx(0, abs=1e-15)
    assert_allclose(found.pose(read), true, rtol=0, atol=1e-13)
    assert_allclose(found.sliders(true), read, rtol=0, atol=1e-13)
    assert np.abs(found.after).max() < 1e-13


def test_a_machine_with_one_r_and_l_is_what_its_file_holds():
    """Where all legs are alike but for the encoders, machine and encoders are found; others of it stay."""
    geometry = PAPER.geometry
    read = _candidates(PAPER, 30, 4)
    legs = np.column_stack([np.tile([40e-6, -30e-6, 60e-6], (3, 1)), [20e-6, -10e-6, 5e-6]]).ravel()
    true = solved(geometry, read, legs, forward_kinematics(geometry, read))
    found = calibrate_machine(PAPER, read, true, SIGMA * 1e-5, WIDTH)
    own = found.machine.geometry
    lengths = [getattr(own, kind) - getattr(geometry, kind) for kind in ("R", "r", "L")]
    assert_allclose(lengths, [40e-6, -30e-6, 60e-6], rtol=0, atol=1e-10)
    home = own.h - geometry.h  # from which z and the sliders count
    assert_allclose(found.encoders, np.array([20e-6, -10e-6, 5e-6]) + home, rtol=0, atol=1e-10)
    assert np.abs(found.after_file).max() < 1e-9
    assert found.machine.bodies == PAPER.bodies
    moved = forward_kinematics(own, read - found.encoders)  # the file and its encoders alone
    assert_allclose(moved, true, rtol=0, atol=1e-9)


def test_derivatives_are_those_of_the_general_layer_and_of_differences():
    """The robot of the description, its placements displaced as the twelve parameters say."""
    robot = p3dof.load()
    read, *_ = built(2, 6)
    ways = {
        "R.a": {"slide_a.y": -1.0},
        "r.a": {"platform_a.y": -1.0},
        "L.a": {"leg_a_tip.length": 1.0},
        "encoder.a": {"slide_a.offset": 1.0},
        "R.b": {"slide_b.y": 1.0},
        "r.b": {"platform_b.y": 1.0},
        "L.b": {"leg_b_tip.length": 1.0},
        "encoder.b": {"slide_b.offset": 1.0},
        "R.c": {"slide_c.x": -1.0},
        "r.c": {"platform_a.x": 1.0, "platform_b.x": 1.0, "platform_center.x": 1.0},
        "L.c": {"hinge_lower.length": 1.0, "rod_right_tip.length": 1.0},
        "encoder.c": {"slide_c.offset": 1.0},
    }
    parameters = displacements(robot.loop, dict.fromkeys(ways, 1.0), ways, ["device"])
    measured = Measurements(read, np.zeros((6, 3)), ("y", "z", "ry"), "platform_center", 1.0)
    _, (rows,) = MeasuredRobot(robot.loop, measured, parameters).all(np.zeros(12))
    pose = forward_kinematics(PAPER.geometry, read)
    gradient = pose_gradient(PAPER.geometry, pose)
    order = [parameters.names.index(name) for name in NAMES]
    size = np.abs(gradient).max()
    assert_allclose(np.abs(rows[..., order]), np.abs(gradient), rtol=0, atol=1e-10 * size)
    sign = np.sign(rows[0, 2, order[0]] / gradient[0, 2, 0])
    assert_allclose(rows[..., order] * [[1], [1], [sign]], gradient, rtol=0, atol=1e-10 * size)

    problem = _Problem(PAPER.geometry, read, np.zeros((6, 3)), np.ones(3), np.eye(len(ALL)))
    p = 1e-4 * np.random.default_rng(0).normal(size=len(ALL))
    _, rows = problem.all(p)
    for k, name in enumerate(ALL):
        h = 2e-6 * np.eye(len(ALL))[k]
        a, b, c, d = (problem.all(p + n * h)[0] for n in (-2, -1, 1, 2))
        found = (a - 8 * b + 8 * c - d) / (12 * 2e-6)
        assert_allclose(rows[..., k], found, rtol=0, atol=1e-8 * max(1, np.abs(rows).max()), err_msg=name)


def test_axes_of_what_measures_may_be_unknown():
    read, true, _, _ = built(3, 50)
    turn, shift = 0.02, np.array([0.003, -0.002])
    c, s = np.cos(turn), np.sin(turn)
    away = true[:, :2] - shift
    seen = np.column_stack([away @ [c, s], away @ [-s, c], true[:, 2] - turn])
    device = {"device.y": "10 mm", "device.z": 0.01, "device.theta": "3 deg"}
    found = calibrate_machine(None, read, seen, SIGMA * 1e-4, WIDTH | device)
    assert found.names[-3:] == ("device.y", "device.z", "device.theta")
    assert np.abs(found.after).max() < 1e-8
    assert np.abs(found.before).max() > 1e-3
    # Its height is that of all encoders together, and is found to their tolerance.
    assert found.parameters[-3] == pytest.approx(0.003, abs=2e-4)
    assert found.parameters[-1] == pytest.approx(turn, abs=1e-3)


def test_parts_of_poses_and_outliers():
    read, _, seen, _ = built(5, 60)
    part = seen.copy()
    part[::2, 2] = np.nan
    part[7, 1] += 1e-3
    told = calibrate_machine(None, read, part, SIGMA, WIDTH)
    assert told.outliers[0] == (7, "z")
    better = calibrate_machine(None, read, part, SIGMA, WIDTH, leave_out=True)
    assert better.left_out
    assert better.noise < 1.3 < told.noise


def test_a_plan_is_better_than_random_poses_and_tells_what_comes_out():
    plan = plan_machine(None, 12, SIGMA, WIDTH, candidates=300)
    assert plan.observability > 1.3 * plan.random
    again = plan_machine(None, 12, SIGMA, WIDTH, sliders=plan.readings)
    assert_allclose(again.deviations, plan.deviations, rtol=1e-9)
    poses = forward_kinematics(PAPER.geometry, plan.readings)
    found = calibrate_machine(None, plan.readings, poses, SIGMA, WIDTH)
    assert_allclose(found.deviations, plan.deviations, rtol=1e-6)
    own = np.linalg.slogdet(found.covariance)[1]
    for seed in range(3):
        read = _candidates(PAPER, 12, seed)
        other = calibrate_machine(None, read, forward_kinematics(PAPER.geometry, read), SIGMA, WIDTH)
        assert own < np.linalg.slogdet(other.covariance)[1] - 3


@shows("p3dof.analysis.tolerances.calibration.machine_calibration_tables")
def test_every_number_of_the_tables():
    read, _, seen, off = built(6, 40)
    found = calibrate_machine(None, read, seen, SIGMA, WIDTH)
    first, second = machine_calibration_tables(found)
    numbers = 1e3 * np.column_stack([found.parameters, found.deviations, np.full(12, 50e-6)])
    rows = {f"{name} [mm]": row for name, row in zip(NAMES, numbers, strict=True)}
    check_table(first, rows, note=(10, 12, "R.a + r.a; R.b + r.b"))
    legs = found.legs.ravel()
    left = closures(PAPER.geometry, seen, legs) - read  # to first order the same errors, seen at the sliders
    by_pose = [forward_kinematics(PAPER.geometry, read), found.pose(read)]
    file = seen + found.after_file
    own = found.machine.geometry
    assert_allclose(forward_kinematics(own, read - found.encoders), file, atol=1e-12)
    rms = [1e6 * np.sqrt(np.mean((pose - seen) ** 2, axis=0)) for pose in (by_pose[0], file, by_pose[1])]
    check_table(
        second,
        dict(zip(("the design", "one R, r, L, and encoders", "all legs of their own"), rms, strict=True)),
    )
    assert np.abs(left).max() < 1e-3
    columns = found.to_columns()
    names, R, encoder = (columns[name] for name in ("leg", "R [m]", "encoder [m]"))
    assert_allclose(R, PAPER.geometry.R + found.parameters[0::4])
    assert_allclose(encoder, found.parameters[3::4])
    assert names.tolist() == ["A", "B", "C"]
    assert off.shape == (12,)


def test_bad_data_are_one_clear_line():
    read, true, *_ = built(0, 12)
    cases = [
        ((read[:3], true[:3], SIGMA, WIDTH), "9 numbers fit exactly to 9 combinations"),
        ((read[[0] * 8], true[[0] * 8], SIGMA, WIDTH), "all poses are alike"),
        ((read, 1000 * true, SIGMA, WIDTH), r"y is 1e\+03 times what the robot does \(mm\?"),
        ((read, true * [1, 1, 180 / np.pi], SIGMA, WIDTH), r"theta is 57\.3 times .*\(deg\?"),
        ((read, true[:, :2], SIGMA, WIDTH), r"pose: expected shape \(K, 3\)"),
        ((read, true, [1e-5, 0, 1e-5], WIDTH), "sigma: expected positive"),
        ((read, true, SIGMA, {"Q": 1e-3}), "expected R, r, L or encoder"),
        ((read[:5], true, SIGMA, WIDTH), r"sliders: expected shape \(12, 3\)"),
    ]
    for arguments, words in cases:
        with pytest.raises(InputError, match=words):
            calibrate_machine(None, *arguments)
    with pytest.raises(ReachError):
        calibrate_machine(None, read + np.array([0, 0.9, 0]), true, SIGMA, WIDTH)
    found = calibrate_machine(None, read, true, SIGMA, WIDTH)
    with pytest.raises((AssemblyError, ReachError)):
        found.pose([[0.0, 0.9, 0.0]])
