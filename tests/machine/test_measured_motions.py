"""Measured motions: times of a clock, rounded poses, and what is told of them."""

from __future__ import annotations

import io
from decimal import Decimal

import numpy as np
import pytest
from command_line import run
from documents import ROOT
from scipy.interpolate import BSpline
from table_numbers import check_evidence, shows

import p3dof
from p3dof._base.errors import MotionError
from p3dof._base.time_series.joint_files import read_joints
from p3dof._base.time_series.smoothing import fitted, last_digit
from p3dof.machine.motion import Motion, WrenchHistory, motion_table, paper_motion
from p3dof.runs import JointReference
from p3dof.runs.forces_along import forces_along

NOON = "1700000000.123"
"""A time of the day, in digits that double precision has not."""


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def exact():
    """The paper's motion at 1 ms, and its forces."""
    motion = paper_motion(1001)
    return motion, forces_of(motion)


def forces_of(motion, **load):
    return p3dof.load().inverse_dynamics(motion, method="compiled", **load)


def stamps(count, step, start=NOON):
    return [str(Decimal(start) + Decimal(i) * Decimal(step)) for i in range(count)]


def table(times, columns, header):
    rows = (",".join([time, *map(repr, row)]) for time, row in zip(times, columns.tolist(), strict=True))
    return "\n".join([header, *rows])


# --- times of a clock ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_stamps_of_a_clock_in_a_file_have_all_their_digits(exact, unit, factor):
    motion, expected = exact
    times = [str(Decimal(one) * factor) for one in stamps(1001, "0.001")]
    text = table(times, motion.pose, f"t [{unit}],y,z,theta")
    found = Motion.from_csv(io.StringIO(text))
    np.testing.assert_array_equal(found.time, np.arange(1001) / 1000)  # each rounded once
    np.testing.assert_allclose(forces_of(found).forces, expected.forces, atol=1e-6)
    assert found.start == float(NOON)
    assert found.remarks()[0] == f"times count from the first one, {NOON} s of the clock"
    assert f"{NOON} s of the clock" in motion_table(found).note
    assert forces_of(found).warnings[0].endswith("of the clock")
    assert found[10:20].start == found.resampled(11).start == found.divided(2).start == float(NOON)


def test_numbers_that_were_rounded_before_are_told_and_can_be_smoothed(exact):
    """The stamps are known to 2.4e-7 s: 9 N of 118 N, as poses alone are differentiated twice."""
    motion, expected = exact
    clock = float(NOON) + motion.time
    rough = Motion.from_poses(clock, motion.pose)
    assert rough.time[0] == 0
    assert np.abs(forces_of(rough).forces - expected.forces).max() > 5
    assert any("known to 2.4e-07 s in double precision" in words for words in rough.remarks())
    smooth = forces_of(Motion.from_poses(clock, motion.pose, smooth="auto"))
    assert np.abs(smooth.forces - expected.forces).max() < 0.01
    assert not any(
        "double" in words for words in Motion.from_poses(clock[::100], motion.pose[::100]).remarks()
    )


def test_velocities_beside_stamps_make_the_same_motion(exact, tmp_path):
    motion, expected = exact
    columns = np.hstack([motion.pose, motion.velocity, motion.acceleration])
    header = "t,y,z,theta,ydot,zdot,thetadot,yddot,zddot,thetaddot"
    found = Motion.from_csv(io.StringIO(table(stamps(1001, "0.001"), columns, header)))
    np.testing.assert_array_equal(forces_of(found).forces, expected.forces)
    again = Motion.from_csv(found.to_csv(tmp_path / "again.csv"))
    np.testing.assert_array_equal(again.time, found.time)
    columns[500, 3] += 1.0
    with pytest.raises(
        MotionError, match=r"at t = 0\.5 s.*times count from the first one, 1700000000\.123 s"
    ):
        Motion.from_csv(io.StringIO(table(stamps(1001, "0.001"), columns, header)))


def test_stamps_that_only_their_digits_tell_apart(exact):
    motion, _ = exact
    times = stamps(11, "0.0000001")  # double precision has 2.4e-7 s
    found = Motion.from_csv(io.StringIO(table(times, motion.pose[:11] * 1e-9, "t,y,z,theta")))
    np.testing.assert_array_equal(found.time, np.arange(11) / 1e7)
    times[5] = times[4]
    with pytest.raises(MotionError, match=r"line 7, column t: expected a time after 1700000000\.123"):
        Motion.from_csv(io.StringIO(table(times, motion.pose[:11], "t,y,z,theta")))


def test_a_load_of_the_same_clock_stays_with_its_motion(exact, robot):
    motion, _ = exact
    later = Decimal(NOON) + Decimal("0.25")
    rows = np.column_stack([np.zeros((501, 2)), np.sin(np.arange(501) / 50), np.zeros((501, 3))])
    header = "t,fx,fy,fz,mx,my,mz"
    plain = WrenchHistory(0.25 + np.arange(501) / 1000, rows)
    load = WrenchHistory.from_csv(io.StringIO(table(stamps(501, "0.001", str(later)), rows, header)))
    clock = Motion(motion.time + float(NOON), motion.pose, motion.velocity, motion.acceleration)
    expected = forces_of(motion, wrench=plain)
    found = forces_of(clock, wrench=load)
    # 2.4e-7 s at most between the two, at 20 N/s.
    np.testing.assert_allclose(found.forces, expected.forces, atol=1e-5)
    assert np.abs(found.forces - forces_of(motion).forces).max() > 0.1
    for one, other in ((motion, load), (clock, plain)):
        with pytest.raises(MotionError, match="are those of a clock"):
            forces_of(one, wrench=other)
    refined = robot.refined(Motion.from_poses(clock.time[::50] + clock.start, motion.pose[::50]), wrench=load)
    assert refined.start == clock.start


def test_small_times_stay_as_they_are(exact):
    motion, _ = exact
    for shift in (0.5, -3.0, 9999.0):
        found = Motion.from_poses(motion.time + shift, motion.pose)
        assert (found.time[0], found.start) == (shift, 0.0)
    long = Motion(np.linspace(-1e4, 1e4, 5), *np.zeros((3, 5, 3)))
    assert (long.time[0], long.start) == (-1e4, 0.0)


def test_joints_of_any_robot_by_a_clock():
    names, swing = ("left", "right"), np.linspace(0, 1, 101)[:, None] ** 2 * [0.1, -0.2]
    header = ",".join(["t", *names])
    plain, clock = (
        read_joints(table(stamps(101, "0.001", start), swing, header), "joints.csv", names, [False, False])
        for start in ("0", NOON)
    )
    assert clock.start == float(NOON)
    for one, other in zip(plain.at(plain.time), clock.at(clock.time), strict=True):
        np.testing.assert_array_equal(one, other)
    reference = JointReference(1e5 + np.arange(101) / 100, swing)
    np.testing.assert_allclose(reference.at(0.5)[0], swing[50], rtol=0, atol=1e-9)
    with pytest.raises(MotionError, match="known to 2.4e-07 s in double precision".replace(".", r"\.")):
        JointReference(1.7e9 + np.arange(101) / 1000, swing)


# --- rounded and noisy poses --------------------------------------------------------------------------------


@shows("p3dof._base.time_series.smoothing.SmoothingFit.residual")
@pytest.mark.parametrize(("count", "worst"), [(26, 0.015), (101, 0.005), (1001, 0.005)])
def test_poses_rounded_to_tenths_of_a_millimetre_have_the_forces_again(exact, count, worst):
    """At steps of 40, 10 and 1 ms: from errors of 40 % and more of the largest force to a percent."""
    _, expected = exact
    rounded = np.round(paper_motion(count).pose, 4)
    times = paper_motion(count).time
    rough, smooth = (Motion.from_poses(times, rounded, smooth=way) for way in (None, "auto"))
    assert any("smooth='auto', or --smooth auto" in words for words in rough.remarks())
    apart = [np.abs(forces_of(one.resampled(1001)).forces - expected.forces).max() for one in (rough, smooth)]
    largest = np.abs(expected.forces).max()
    assert apart[0] > 0.3 * largest
    assert apart[1] < worst * largest
    np.testing.assert_allclose(
        forces_of(smooth.resampled(1001)).peak_forces, expected.peak_forces, rtol=0.005
    )
    fit = smooth.curve.fit
    left = rounded - smooth.pose
    check_evidence(fit, "residual", np.sqrt((left**2).mean(axis=0)), rtol=1e-6)
    np.testing.assert_allclose(fit.largest, np.abs(left).max(axis=0), rtol=1e-6)
    assert (fit.residual < 1e-4).all()
    np.testing.assert_allclose(fit.band, np.array(fit.pieces) / 2)  # of a second
    told = smooth.remarks()[-1]
    assert told.startswith("the poses are smoothed: quintic splines follow y to 0.5 Hz")
    assert f"{1e3 * fit.residual[2]:.2g} mrad rms" in told


def test_rounded_joints_of_any_robot_have_their_accelerations_again(tmp_path, capsys):
    """The five-bar's motors, to .1 mrad at 5 ms, by a clock: told, and smoothed on request."""
    time, names = np.arange(201) / 200, ("left_motor", "right_motor")
    exact = 1.9 + 0.1 * np.column_stack([np.sin(6 * time), np.cos(5 * time)])
    bent = -0.1 * np.column_stack([36 * np.sin(6 * time), 25 * np.cos(5 * time)])
    text = table(stamps(201, "0.005"), np.round(exact, 4), ",".join(["t", *names]))
    rough, smooth = (read_joints(text, "log.csv", names, [False, False], way) for way in (None, "auto"))
    apart = [np.abs(one.at(time)[2] - bent).max() for one in (rough, smooth)]
    assert apart[0] > 5
    assert apart[1] < 0.1  # of 3.6 rad/s²
    assert "the values are too noisy" in rough.remarks(names, [False, False])[1]
    assert "the values are smoothed" in smooth.remarks(names, [False, False])[1]
    shorter = table(stamps(201, "0.005", "0"), exact, ",".join(["t", *names]))
    plain = read_joints(shorter, "log.csv", names, [False, False], 20.0)
    assert plain.fit.pieces == (40, 40)
    reference = JointReference(time, np.round(exact, 4), smooth="auto")
    np.testing.assert_allclose(reference.over(time)[2], smooth.at(time)[2], rtol=0, atol=1e-9)
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    robot = ROOT / "docs/_static/gallery/five_bar.urdf"
    for option, words in (
        (["--smooth", "auto"], "The values are smoothed"),
        ([], "The values are too noisy"),
    ):
        code, out, _ = run(capsys, "loop", "forces", robot, "--motion", tmp_path / "log.csv", *option)
        assert code == 0
        told = " ".join(out.split())
        assert words in told
        assert f"Times count from the first one, {NOON} s of the clock." in told


def test_a_load_on_any_robot_stays_with_joints_of_the_same_clock():
    robot, time = p3dof.load_robot(ROOT / "docs/_static/gallery/five_bar.urdf"), np.arange(51) / 50
    angles = 1.9 + 0.1 * np.column_stack([np.sin(6 * time), np.cos(5 * time)])
    rows = np.column_stack([np.zeros((26, 2)), np.sin(np.arange(26)), np.zeros((26, 3))])
    found = []
    for start in ("0", NOON):
        joints = table(stamps(51, "0.02", start), angles, "t,left_motor,right_motor")
        later = str(Decimal(start) + Decimal("0.25"))
        load = WrenchHistory.from_csv(
            io.StringIO(table(stamps(26, "0.02", later), rows, "t,fx,fy,fz,mx,my,mz"))
        )
        found.append(forces_along(robot, io.StringIO(joints), 51, {"left_tip": load}).forces)
    bare = forces_along(robot, io.StringIO(joints), 51).forces
    np.testing.assert_allclose(*found, atol=1e-5)  # 2.4e-7 s at most between the two, at 50 N/s
    assert np.abs(found[1] - bare).max() > 0.05


def test_noise_that_is_no_rounding_is_taken_out_too(exact):
    motion, expected = exact
    noisy = motion.pose + np.random.default_rng(4).normal(scale=3e-5, size=motion.pose.shape)
    found = Motion.from_poses(motion.time, noisy, smooth="auto")
    apart = np.abs(forces_of(found).forces - expected.forces).max()
    assert apart < 0.01 * np.abs(expected.forces).max()
    np.testing.assert_allclose(found.curve.fit.residual, 3e-5, rtol=0.1)
    later = Motion.from_poses(motion.time + 7, noisy, smooth="auto")  # the zero of time is nothing to it
    np.testing.assert_allclose(later.acceleration, found.acceleration, atol=1e-6)


@pytest.mark.parametrize("digit", [0.0, 0.1])
@pytest.mark.parametrize("frequency", [1, 3, 6, 10, 12])
def test_the_number_of_pieces_has_the_least_criterion(frequency, digit):
    """Schwarz's, with the correction of Hurvich and Tsai where it asks for more, of NumPy's least squares.

    What rounding leaves of 24 values with so many unknowns is known: less than that explains no more.
    """
    time, noise = np.linspace(2, 3, 24), np.random.default_rng(3).normal(0, 0.05, (8, 24))
    columns = np.repeat([1.0, 0.1], 4)[:, None] * (np.sin(frequency * time) + noise)  # fast and slow
    columns = np.round(columns, 1) if digit else columns
    scores = []
    for pieces in range(1, 9):  # 8 + 5 unknowns are at most .6 of 24
        knots = np.r_[5 * [2.0], np.linspace(2, 3, pieces + 1), 5 * [3.0]]
        basis = BSpline.design_matrix(time, knots, 5).toarray()
        left = columns.T - basis @ np.linalg.lstsq(basis, columns.T, rcond=None)[0]
        count = pieces + 5
        square = np.maximum(np.mean(left**2, axis=0), digit**2 / 12 * (24 - count) / 24)
        costs = max(np.log(24), 2 * 24 / (24 - count - 1))
        scores.append(24 * np.log(square) + count * costs)
    assert fitted(time, columns.T, "auto").pieces == tuple(1 + np.argmin(scores, axis=0))


def test_whether_more_pieces_would_do_better_is_told():
    """A fast swing asks for all pieces that 24 values allow, and for more; of rounded ones, none is owed."""
    time = np.linspace(0, 1, 24)
    swing = np.sin(22 * time)[:, None]
    found = fitted(time, swing, "auto")
    assert (found.pieces, found.settled) == ((8,), False)
    rounded = fitted(time, np.round(swing, 1), "auto")
    assert (rounded.pieces, rounded.settled) == ((8,), True)
    few = fitted(time[:8], time[:8, None] ** 5, "auto")  # no room for two pieces
    assert few.pieces == (1,)
    np.testing.assert_allclose(few.at(time[:8], 1)[:, 0], 5 * time[:8] ** 4, rtol=0, atol=1e-9)


@pytest.mark.parametrize("count", [12, 26, 101, 1001])
def test_exact_poses_are_left_alone(count):
    motion = paper_motion(count)
    plain, smooth = (Motion.from_poses(motion.time, motion.pose, smooth=way) for way in (None, "auto"))
    for name in ("pose", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(smooth, name))
    assert plain.remarks() == smooth.remarks()


def test_a_band_of_ones_own(exact):
    """A spline of 2 f T pieces: what lies within its band comes through, a vibration above it does not."""
    motion, _ = exact
    shaken = motion.pose + 1e-3 * np.sin(2 * np.pi * 150 * motion.time)[:, None]
    found = Motion.from_poses(motion.time, shaken, smooth=12)
    assert found.curve.fit.pieces == (24, 24, 24)
    inner = slice(100, -100)
    assert np.abs(found.acceleration - motion.acceleration)[inner].max() < 0.3  # of 888 in what was given
    assert np.abs(found.pose - motion.pose)[inner].max() < 2e-5
    with pytest.raises(MotionError, match="expected at most 298 Hz for 1001 values over 1 s, got 400 Hz"):
        Motion.from_poses(motion.time, motion.pose, smooth=400)
    for wrong in ("much", True, -1.0, 0, float("nan")):
        with pytest.raises(MotionError, match="smooth: expected"):
            Motion.from_poses(motion.time, motion.pose, smooth=wrong)


def test_a_hole_bounds_the_band(exact):
    """Half a period of the highest frequency is a piece; over a hole of more than two, chance decides."""
    motion, expected = exact
    pose = np.round(motion.pose, 4)
    there = np.r_[0:501, 600:1001]  # nothing for 100 ms: at most 10 Hz
    time, pose = motion.time[there], pose[there]
    for wrong in (10.1, 20.0, 200.0):
        with pytest.raises(MotionError, match=r"at most 10 Hz, as there are no values from 0\.5 to 0\.6 s"):
            Motion.from_poses(time, pose, smooth=wrong)
    inside = (motion.time > 0.1) & (motion.time < 0.9)  # at the ends, nothing holds a band of one's own
    for smooth in (8.0, "auto"):
        found = Motion.from_poses(time, pose, smooth=smooth)
        assert (found.curve.fit.band <= 10).all()
        apart = (forces_of(found.resampled(motion.time)).forces - expected.forces)[inside]
        assert np.abs(apart).max() < 0.01 * np.abs(expected.forces).max()


@pytest.mark.parametrize(
    ("numbers", "digit"),
    [
        ([0.1, 0.25, 3.0], 1e-2),
        (np.round(np.linspace(0, 1, 7), 4), 1e-4),
        (np.radians([0.5, 1.25, 89.75]), np.radians(0.01)),
        (np.linspace(0, 1, 7), 0.0),
        ([2.0, 3.0], 0.1),
        (np.round(np.linspace(0, 1, 7), 9), 1e-9),
        (np.round(np.linspace(0, 1, 7), 10), 0.0),  # finer than any instrument: as good as exact
        (np.radians(np.round([0.5, *np.random.default_rng(1).uniform(9e4, 1e5, 200)], 8)), np.radians(1e-8)),
    ],
)
def test_the_last_digit_of_rounded_numbers(numbers, digit):
    assert last_digit(np.asarray(numbers)) == pytest.approx(digit)


def test_the_command_line_smooths(tmp_path, capsys, exact):
    motion, expected = exact
    path = tmp_path / "log.csv"
    path.write_text(table(stamps(1001, "0.001"), np.round(motion.pose, 4), "t,y,z,theta"), encoding="utf-8")
    code, out, _ = run(capsys, "forces", "--motion", path, "--out", tmp_path / "rough.csv")
    assert "--smooth auto, leaves the noise out" in " ".join(out.split())
    code, out, _ = run(capsys, "forces", "--motion", path, "--smooth", "auto", "--out", tmp_path / "f.csv")
    words = " ".join(out.split())
    assert code == 0
    assert f"times count from the first one, {NOON} s of the clock" in words
    assert "the poses are smoothed: quintic splines follow" in words
    rows = np.genfromtxt(tmp_path / "f.csv", delimiter=",", skip_header=1)
    assert rows[0, 0] == 0
    most = np.abs(rows[:, 1:4]).max(axis=0)
    np.testing.assert_allclose(most, expected.peak_forces, rtol=0.01)
    assert run(capsys, "forces", "--motion", path, "--smooth", "30")[0] == 0
    for wrong in (["--smooth", "auto"], ["--motion", path, "--smooth", "soft"]):
        assert run(capsys, "forces", *wrong)[0] == 2
