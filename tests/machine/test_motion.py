"""Motion: the paper's formula, planned motions, the consistency check, and motion files."""

import copy
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import constants

import p3dof
from p3dof._base import errors
from p3dof._base.checks import ANGLES, FORCES, LENGTHS, MOMENTS, TIMES, units_of
from p3dof._base.errors import FileError, InputError, MotionError, P3dofError
from p3dof._base.quantities import unit_of
from p3dof._base.time_series import csv_files
from p3dof._base.time_series import smoothing as splines
from p3dof.machine.motion import Motion, WrenchHistory, paper_motion
from p3dof.machine.motion.core import load_along, natural_ramp
from p3dof.machine.motion.curve import MINIMUM

REPEATABLE = settings(derandomize=True, deadline=None, max_examples=60)
HEADER = "t,y,z,theta,ydot,zdot,thetadot,yddot,zddot,thetaddot"
COLUMNS = ("y", "z", "theta")


def arrays(motion: Motion) -> tuple[np.ndarray, ...]:
    return motion.time, motion.pose, motion.velocity, motion.acceleration


def assert_same_bits(one: Motion, other: Motion) -> None:
    for mine, theirs in zip(arrays(one), arrays(other), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def scaled(array: np.ndarray, column: int, factor: float) -> np.ndarray:
    result = array.copy()
    result[:, column] *= factor
    return result


def trapezoid(n: int, ramp: float) -> tuple[np.ndarray, ...]:
    """Constant acceleration, constant speed, constant deceleration over 1 s, in y and θ; z stands still."""
    t = np.linspace(0, 1, n)
    a = np.select([t < ramp, t < 1 - ramp], [1.0, 0.0], -1.0)
    v = np.select([t < ramp, t < 1 - ramp], [t, ramp], 1 - t)
    p = np.select(
        [t < ramp, t < 1 - ramp],
        [t**2 / 2, ramp**2 / 2 + ramp * (t - ramp)],
        ramp * (1 - ramp) - (1 - t) ** 2 / 2,
    )
    return t, *(np.column_stack([x, np.full(n, still), 2 * x]) for x, still in ((p, 0.1), (v, 0.0), (a, 0.0)))


# ---------------------------------------------------------------- the paper's motion


@pytest.mark.parametrize("samples", [1, 2, 101, 1001])
def test_paper_motion_is_equation_5_with_its_derivatives(samples):
    t = sp.Symbol("t")
    formulas = [
        -(t**2) * (t**2 - sp.Rational(13, 10) * t + sp.Rational(3, 10)),
        sp.Rational(1, 5) * t**2 * (2 * t**2 - t - 1),
        sp.Rational(2, 5) * sp.sin(4 * sp.pi * t),
    ]
    motion = paper_motion(samples)
    assert motion.time[0] == 0
    for order, got in enumerate((motion.pose, motion.velocity, motion.acceleration)):
        functions = [sp.lambdify(t, sp.diff(formula, t, order), "numpy") for formula in formulas]
        expected = np.column_stack([function(motion.time) + 0 * motion.time for function in functions])
        np.testing.assert_allclose(got, expected, rtol=0, atol=3e-14 * max(1, np.abs(expected).max()))


def test_paper_motion_neither_starts_nor_ends_at_rest():
    motion = paper_motion()
    assert (len(motion), motion.time[-1], motion.duration) == (1001, 1.0, 1.0)
    assert motion.velocity[0] == pytest.approx([0, 0, 1.6 * np.pi], abs=1e-14)
    assert motion.velocity[-1] == pytest.approx([-0.7, 0.6, 1.6 * np.pi], abs=1e-13)
    assert motion.acceleration[0] == pytest.approx([-0.6, -0.4, 0], abs=1e-13)


@pytest.mark.parametrize("samples", [True, np.bool_(True), 1.5, 0, -3, 10**9, float("nan"), "10", None, [5]])
def test_paper_motion_refuses_bad_samples(samples):
    with pytest.raises(MotionError, match="samples: expected a whole number"):
        paper_motion(samples)


def test_samples_may_be_any_whole_number():
    assert len(paper_motion(np.int64(7))) == len(paper_motion(7.0)) == 7


# ---------------------------------------------------------------- construction


def test_the_constructor_copies_and_freezes():
    given_pose = np.zeros((8, 3))
    motion = Motion(np.arange(8), given_pose, np.zeros((8, 3)), np.zeros((8, 3), dtype=int))
    given_pose[:] = 1.0
    assert not motion.pose.any()
    for array in arrays(motion):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        motion.time = np.zeros(8)


def test_replace_makes_a_checked_variant():
    motion = paper_motion(101)
    assert_same_bits(dataclasses.replace(motion), motion)
    with pytest.raises(MotionError, match="velocity of y"):
        dataclasses.replace(motion, velocity=scaled(motion.velocity, 0, 2.0))
    dataclasses.replace(motion, velocity=scaled(motion.velocity, 0, 2.0), check=False)
    assert_same_bits(copy.deepcopy(motion), motion)


BAD = {
    "time_2d": ({"time": np.zeros((4, 1))}, r"time: expected shape \(N,\), got \(4, 1\)"),
    "time_scalar": ({"time": 1.0}, r"time: expected shape \(N,\), got a single number"),
    "no_samples": ({"time": []}, "time: expected at least one sample, got none"),
    "time_nan": ({"time": [0, np.nan, 2, 3]}, r"time: expected finite numbers, got nan at index \[1\]"),
    "time_falls": (
        {"time": [0, 2, 1, 3]},
        "time: expected strictly rising times, got 2 s and then 1 s at index 2",
    ),
    "time_repeats": ({"time": [0, 1, 1, 2]}, "got 1 s and then 1 s at index 2"),
    "time_text": ({"time": ["0", "1", "2", "3"]}, "time: expected real numbers"),
    "pose_columns": ({"pose": np.zeros((4, 2))}, r"pose: expected shape \(4, 3\), got \(4, 2\)"),
    "pose_rows": ({"pose": np.zeros((5, 3))}, r"pose: expected shape \(4, 3\), got \(5, 3\)"),
    "pose_infinite": (
        {"pose": np.full((4, 3), np.inf)},
        r"pose: expected finite numbers, got inf at index \[0, 0\]",
    ),
    "pose_complex": ({"pose": np.zeros((4, 3), complex)}, "pose: expected real numbers"),
    "pose_none": ({"pose": None}, "pose: expected real numbers"),
    "pose_ragged": ({"pose": [[0, 0, 0], [0, 0], [0], []]}, "pose: expected real numbers"),
    "velocity_rows": ({"velocity": np.zeros(3)}, r"velocity: expected shape \(4, 3\)"),
    "acceleration_nan": ({"acceleration": np.full((4, 3), np.nan)}, "acceleration: expected finite"),
    "acceleration_bool": ({"acceleration": np.zeros((4, 3), bool)}, "acceleration: expected real numbers"),
}


@pytest.mark.parametrize(("change", "message"), BAD.values(), ids=BAD)
@pytest.mark.parametrize("check", [True, False])
def test_the_constructor_refuses(change, message, check):
    zeros = np.zeros((4, 3))
    fields = {"time": np.arange(4.0), "pose": zeros, "velocity": zeros, "acceleration": zeros}
    with pytest.raises(MotionError, match=message):
        Motion(**(fields | change), check=check)


def test_a_motion_error_is_a_value_error_of_the_package():
    assert issubclass(MotionError, ValueError)
    assert issubclass(MotionError, P3dofError)
    assert errors.MotionError is MotionError


def test_a_single_sample_is_a_motion():
    motion = Motion([2.0], [[0.1, 0, 0]], [[1, 2, 3]], [[4, 5, 6]])
    assert (len(motion), motion.duration) == (1, 0.0)
    assert_same_bits(motion.resampled(1), motion)
    assert_same_bits(motion.resampled([2.0]), motion)


# ---------------------------------------------------------------- the consistency check


@pytest.mark.parametrize("samples", [*range(1, 60), 101, 1001, 20001])
def test_true_motions_pass_at_any_sampling(samples):
    Motion(*arrays(paper_motion(samples)))
    if samples > 1:
        Motion(*arrays(Motion.rest_to_rest([0, 0, 0], [0.1, -0.05, 0.3], 0.4, samples, order=9)))


@pytest.mark.parametrize("column", range(3), ids=COLUMNS)
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
@pytest.mark.parametrize("samples", [31, 101, 1001])
def test_one_percent_is_caught(samples, quantity, column):
    motion = paper_motion(samples)
    wrong = scaled(getattr(motion, quantity), column, 1.01)
    with pytest.raises(MotionError, match=f"^{quantity} of {COLUMNS[column]} at t = [0-9.e-]+ s: expected"):
        dataclasses.replace(motion, **{quantity: wrong})
    dataclasses.replace(motion, **{quantity: wrong}, check=False)


def test_a_tenth_of_the_tolerance_passes():
    motion = paper_motion(101)
    for column in range(3):
        for quantity in ("velocity", "acceleration"):
            dataclasses.replace(motion, **{quantity: scaled(getattr(motion, quantity), column, 1.0001)})


def test_the_message_names_the_worst_sample():
    motion = paper_motion(101)
    wrong = motion.velocity.copy()
    wrong[40, 1] += 0.05
    wrong[60, 1] += 0.5
    expected = rf"velocity of z at t = 0\.6 s: expected {motion.velocity[60, 1]:.4g}\d* m/s, .* got "
    expected += rf"{wrong[60, 1]:.4g}\d* m/s .*check=False"
    with pytest.raises(MotionError, match=expected):
        dataclasses.replace(motion, velocity=wrong)


@pytest.mark.parametrize("samples", [21, 101, 1001])
def test_wrong_units_and_columns_are_caught(samples):
    t, p, v, a = arrays(paper_motion(samples))
    degrees, millimetres = 180 / np.pi, 1000
    cases = {
        "pose in deg": ((t, scaled(p, 2, degrees), v, a), "velocity of theta"),
        "velocity in deg/s": ((t, p, scaled(v, 2, degrees), a), "velocity of theta"),
        "acceleration in deg/s²": ((t, p, v, scaled(a, 2, degrees)), "acceleration of theta"),
        "pose in mm": ((t, scaled(p, 0, millimetres), v, a), "velocity of y"),
        "acceleration in mm/s²": ((t, p, v, scaled(a, 1, millimetres)), "acceleration of z"),
        "time in ms": ((t * 1000, p, v, a), "velocity of"),
        "pose columns swapped": ((t, p[:, [1, 0, 2]], v, a), "velocity of"),
        "velocity columns swapped": ((t, p, v[:, [1, 0, 2]], a), "velocity of"),
        "acceleration columns swapped": ((t, p, v, a[:, [1, 0, 2]]), "acceleration of"),
        "velocity and acceleration swapped": ((t, p, a, v), "velocity of"),
        "sign": ((t, p, -v, a), "velocity of"),
        "zeros for velocity": ((t, p, 0 * v, a), "velocity of"),
        "zeros for acceleration": ((t, p, v, 0 * a), "acceleration of"),
        "velocity late by a sample": ((t, p, np.roll(v, 1, axis=0), a), "velocity of"),
        "acceleration late by a sample": ((t, p, v, np.roll(a, 1, axis=0)), "acceleration of"),
    }
    for name, (motion, message) in cases.items():
        with pytest.raises(MotionError, match=message):
            pytest.fail(f"accepted: {name}: {Motion(*motion)!r}")


@pytest.mark.parametrize("which", [1, 2, 3], ids=["pose", "velocity", "acceleration"])
@pytest.mark.parametrize("row", [0, 1, 50, 99, 100])
def test_a_single_wrong_sample_is_caught(which, row):
    motion = list(arrays(paper_motion(101)))
    wrong = motion[which].copy()
    wrong[row] += 0.03 * np.ptp(wrong, axis=0)
    motion[which] = wrong
    with pytest.raises(MotionError, match=r"velocity|acceleration|pose"):
        Motion(*motion)


def test_a_single_wrong_pose_on_a_straight_way_is_caught():
    """A derivative in the middle of its neighbours does not see it, and those of one side look away.

    That the acceleration of θ changes fast excuses nothing in z.
    """
    t, v, a = np.arange(101) / 100, np.tile([0.5, -1.0, 2.0], (101, 1)), np.zeros((101, 3))
    p = v * t[:, None]
    p[:, 2], v[:, 2], a[:, 2] = 500 * t**3 / 3, 500 * t**2, 1000 * t
    Motion(t, p, v, a)
    p[50, 1] += 1e-4
    with pytest.raises(
        MotionError, match=r"^pose z from t = 0\.(49 to 0\.5|5 to 0\.51) s: .* of -0\.01 m, as"
    ):
        Motion(t, p, v, a)


@pytest.mark.parametrize("jump", [2.0, 20.0])
def test_a_single_wrong_pose_where_an_acceleration_jumps_is_caught(jump):
    """A jump of Δ between two samples h apart moves the latter pose by h² Δ / 12 at most."""
    t, one = np.arange(101) / 100, np.ones(3)
    late = np.maximum(t - 0.5, 0)[:, None]
    a = np.where(t >= 0.5, jump, 0)[:, None] * one
    p, v = (0.2 * t[:, None] + jump * late**2 / 2) * one, (0.2 + jump * late) * one
    Motion(t, p, v, a)
    p[50, 0] += 1e-4 * jump / 2 + 5e-5
    with pytest.raises(MotionError, match=r"^pose y from t = 0\.(49 to 0\.5|5 to 0\.51) s"):
        Motion(t, p, v, a)


@pytest.mark.parametrize("n", [7, 100, 20_000])
@pytest.mark.parametrize("duration", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize("offset", [0.0, 0.1, 1e3])
def test_a_column_that_stands_still_passes(n, duration, offset):
    t = np.linspace(0, duration, n)
    noise = np.spacing(offset) * np.cos(np.arange(n))[:, None] * np.ones(3)
    Motion(t, offset + noise, np.zeros((n, 3)), np.zeros((n, 3)))


def test_a_column_that_stands_still_must_not_have_a_velocity():
    t, zeros = np.linspace(0, 1, 50), np.zeros((50, 3))
    with pytest.raises(MotionError, match=r"velocity of theta .* got 0\.001 rad/s"):
        Motion(t, zeros + 0.1, zeros + np.array([0, 0, 1e-3]), zeros)
    with pytest.raises(MotionError, match=r"acceleration of y .* got 0\.001 m/s²"):
        Motion(t, zeros + 0.1, zeros, zeros + np.array([1e-3, 0, 0]))


@pytest.mark.parametrize("decimals", [5, 6, 8])
@pytest.mark.parametrize("samples", [21, 101, 1001, 10001])
def test_rounded_numbers_pass(samples, decimals):
    t, *rest = arrays(paper_motion(samples))
    Motion(t, *(array.round(decimals) for array in rest))


@pytest.mark.parametrize("n", [51, 101, 333, 1001])
@pytest.mark.parametrize("ramp", [0.2, 0.237])
def test_trapezoidal_profiles_pass_and_their_mistakes_do_not(n, ramp):
    t, p, v, a = trapezoid(n, ramp)
    Motion(t, p, v, a)
    with pytest.raises(MotionError, match="velocity of theta"):
        Motion(t, p, scaled(v, 2, 1.01), a)
    if n > 51:  # ten samples a phase say too little
        with pytest.raises(MotionError, match="acceleration of theta"):
            Motion(t, p, v, scaled(a, 2, 1.1))


def test_short_motions_pass_unchecked():
    for n in range(1, MINIMUM):
        Motion(np.arange(n), np.zeros((n, 3)), np.ones((n, 3)), np.ones((n, 3)))
    with pytest.raises(MotionError, match="velocity of y"):
        Motion(np.arange(MINIMUM), *(np.full((MINIMUM, 3), x) for x in (0, 1, 1)))


def test_uneven_and_distant_times_pass():
    rng = np.random.default_rng(5)
    for _ in range(50):
        t = np.linspace(0, 1, 101)
        t[1:-1] += rng.uniform(-0.4, 0.4, 99) / 100
        sine, cosine = np.sin(9 * t)[:, None], np.cos(9 * t)[:, None]
        one = np.array([0.1, 1e-5, 1.0])
        Motion(t, one * sine, 9 * one * cosine, -81 * one * sine)
        Motion(t + 1e5, one * sine, 9 * one * cosine, -81 * one * sine)


def test_hopeless_times_and_numbers_are_no_crash():
    zeros = np.zeros((10, 3))
    ones = zeros + 1e308
    Motion(np.geomspace(1e-300, 1e30, 10), zeros, zeros, zeros)
    with pytest.raises(MotionError):
        Motion.from_poses(np.arange(10), ones * (-1.0) ** np.arange(10)[:, None])


# ---------------------------------------------------------------- planned motions


@pytest.mark.parametrize("order", [5, 7, 9])
def test_rest_to_rest_is_the_known_polynomial(order):
    motion = Motion.rest_to_rest([0, 0, 0], [1, -2, 0.5], 2.0, samples=201, order=order)
    s = sp.Symbol("s")
    half = (order - 1) // 2
    density = s**half * (1 - s) ** half
    blend = sp.integrate(density, (s, 0, s)) / sp.integrate(density, (s, 0, 1))
    for n, got in enumerate((motion.pose, motion.velocity, motion.acceleration)):
        shape = sp.lambdify(s, sp.diff(blend, s, n))(motion.time / 2)[:, None] / 2**n
        np.testing.assert_allclose(got, shape * [1, -2, 0.5], rtol=0, atol=5e-12)


POSES = st.lists(st.floats(-1, 1), min_size=3, max_size=3)


@REPEATABLE
@given(POSES, POSES, st.floats(1e-2, 1e3), st.integers(2, 300), st.sampled_from([5, 7, 9]))
def test_rest_to_rest_rests(start, end, duration, samples, order):
    motion = Motion.rest_to_rest(start, end, duration, samples, order)
    assert len(motion) == samples
    assert motion.duration == duration
    assert motion.pose[0].tolist() == pytest.approx(start, abs=1e-15)
    assert motion.pose[-1].tolist() == pytest.approx(end, abs=1e-15)
    assert np.abs(motion.velocity[[0, -1]]).max() <= 1e-13 / duration
    assert np.abs(motion.acceleration[[0, -1]]).max() <= 1e-12 / duration**2
    Motion(*arrays(motion))  # and passes the check


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": [0, 0]}, r"start: expected shape \(3,\)"),
        ({"end": [0, 0, np.nan]}, "end: expected finite"),
        ({"duration": 0}, "duration: expected a positive number, got 0"),
        ({"duration": -1.0}, "duration: expected a positive"),
        ({"duration": np.inf}, "duration: expected a finite"),
        ({"duration": "1"}, "duration: expected real"),
        ({"duration": 1e-320}, "expected"),
        (
            {"end": [1e308, -1e308, 0], "start": [-1e308, 1e308, 0]},
            "start: expected numbers of at most 1e.30 in size",
        ),
        ({"order": 6}, "order: expected 5, 7 or 9, got 6"),
        ({"order": True}, "order: expected 5, 7 or 9"),
        ({"order": "5"}, "order: expected 5, 7 or 9"),
        ({"samples": 1}, "samples: expected a whole number from 2"),
    ],
)
def test_rest_to_rest_refuses(arguments, message):
    with pytest.raises(MotionError, match=message):
        Motion.rest_to_rest(**({"start": [0, 0, 0], "end": [0.1, 0, 0], "duration": 1.0} | arguments))


@REPEATABLE
@given(st.lists(POSES, min_size=2, max_size=7), st.floats(0.1, 20), st.integers(1, 9))
def test_through_passes_its_waypoints_and_rests_at_both_ends(waypoints, duration, between):
    motion = Motion.through(waypoints, duration=duration, samples=between * (len(waypoints) - 1) + 1)
    np.testing.assert_allclose(motion.pose[::between], waypoints, rtol=0, atol=1e-12)
    assert not motion.velocity[[0, -1]].any()
    assert not motion.acceleration[[0, -1]].any()
    assert motion.duration == pytest.approx(duration)


def test_through_has_four_continuous_derivatives():
    waypoints = [[0, 0, 0], [0.1, -0.05, 0.3], [-0.1, 0.02, -0.2], [0, 0.1, 0]]
    times = [0.5, 1.0, 2.2, 3.0]
    motion = Motion.through(waypoints, times=times, samples=25001)
    assert (motion.time[0], motion.time[-1]) == (0.5, 3.0)
    Motion(*arrays(motion))
    step = motion.time[1] - motion.time[0]
    jerk = np.diff(motion.acceleration, axis=0) / step
    snap = np.diff(jerk, axis=0) / step
    assert np.abs(np.diff(snap, axis=0)).max() < 1e-3 * np.ptp(snap)  # a jump would be a large share
    for when, waypoint in zip(times, waypoints, strict=True):
        row = int(np.argmin(np.abs(motion.time - when)))
        assert motion.pose[row] == pytest.approx(waypoint, abs=1e-9)


def test_through_two_waypoints_is_rest_to_rest():
    straight = Motion.rest_to_rest([0, 0, 0], [0.1, 0.2, -0.3], 1.5, 101)
    spline = Motion.through([[0, 0, 0], [0.1, 0.2, -0.3]], duration=1.5, samples=101)
    for mine, theirs in zip(arrays(straight), arrays(spline), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "expected one of the two, got neither or both"),
        ({"times": [0, 1, 2], "duration": 2}, "expected one of the two"),
        ({"times": [0, 1]}, r"times: expected shape \(3,\), got \(2,\)"),
        ({"times": [0, 2, 1]}, "times: expected strictly rising times, got 2 s and then 1 s"),
        ({"times": [0, np.nan, 1]}, "times: expected finite"),
        ({"duration": 0}, "duration: expected a positive"),
        ({"duration": 1, "samples": 1}, "samples: expected"),
        ({"duration": 1, "waypoints": [[0, 0, 0]]}, "waypoints: expected at least two, got 1"),
        ({"duration": 1, "waypoints": [0, 0, 0]}, r"waypoints: expected shape \(K, 3\)"),
        ({"duration": 1, "waypoints": np.zeros((3, 2))}, r"waypoints: expected shape \(K, 3\)"),
    ],
)
def test_through_refuses(arguments, message):
    with pytest.raises(MotionError, match=message):
        Motion.through(**({"waypoints": np.zeros((3, 3))} | arguments))


# ---------------------------------------------------------------- poses alone


@pytest.mark.parametrize(
    ("samples", "velocity_error", "acceleration_error"),
    [(21, 3e-3, 3e-2), (51, 3e-6, 6e-5), (101, 1.1e-8, 5e-7), (1001, 1e-11, 3e-9)],
)
def test_differentiation_accuracy_on_the_papers_motion(samples, velocity_error, acceleration_error):
    exact = paper_motion(samples)
    motion = Motion.from_poses(exact.time, exact.pose)
    for name, bound in (("velocity", velocity_error), ("acceleration", acceleration_error)):
        truth = getattr(exact, name)
        error = np.abs(getattr(motion, name) - truth).max(axis=0) / np.abs(truth).max(axis=0)
        assert error.max() < bound


@pytest.mark.parametrize("samples", range(2, 20))
def test_few_samples_are_differentiated_as_a_polynomial(samples):
    t = np.linspace(1, 3, samples)
    degree = min(samples - 1, 7)
    polynomials = [np.polynomial.Polynomial(np.linspace(1, c, degree + 1)) for c in (-1, 2, 0)]
    motion = Motion.from_poses(t, np.column_stack([p(t) for p in polynomials]))
    for order, got in ((1, motion.velocity), (2, motion.acceleration)):
        expected = np.column_stack([p.deriv(order)(t) for p in polynomials])
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    ("time", "pose", "message"),
    [
        ([0.0], [[0, 0, 0]], "at least two samples to differentiate, got 1"),
        ([], np.zeros((0, 3)), "at least two samples"),
        ([0, 0], np.zeros((2, 3)), "strictly rising"),
        ([0, 1], np.zeros((3, 3)), r"pose: expected shape \(2, 3\)"),
        ([0, 1], [[0, 0, 0], [0, np.nan, 0]], "pose: expected finite"),
        (np.arange(9) * 1e-200, np.eye(9, 3), "velocity: expected numbers of at most 1e.30 in size"),
    ],
)
def test_from_poses_refuses(time, pose, message):
    with pytest.raises(MotionError, match=message):
        Motion.from_poses(time, pose)


# ---------------------------------------------------------------- parts, other samplings, joining


def test_slices_are_motions():
    motion = paper_motion(101)
    part = motion[10:51:4]
    assert len(part) == 11
    np.testing.assert_array_equal(part.acceleration, motion.acceleration[10:51:4])
    assert part.duration == pytest.approx(0.4)
    assert len(motion[-1]) == 1
    assert motion[-1].time[0] == 1.0
    assert motion[np.int64(3)].time[0] == motion.time[3]
    assert sum(len(sample) for sample in motion) == 101


@pytest.mark.parametrize(
    ("index", "error"),
    [
        (slice(5, 5), MotionError),
        (slice(None, None, -1), MotionError),
        (101, IndexError),
        (-102, IndexError),
        (1.0, TypeError),
        ("y", TypeError),
    ],
)
def test_bad_indices(index, error):
    with pytest.raises(error):
        paper_motion(101)[index]


def test_repr_is_short():
    assert repr(paper_motion()) == "Motion(1001 samples, 0 to 1 s)"


def test_resampling_is_accurate_and_keeps_the_samples():
    coarse, fine = paper_motion(101), paper_motion(1001)
    dense = coarse.resampled(1001)
    for name, bound in (("pose", 2e-10), ("velocity", 2e-7), ("acceleration", 1e-4)):
        assert np.abs(getattr(dense, name) - getattr(fine, name)).max() < bound
    same = coarse.resampled(coarse.time)
    for mine, theirs in zip(arrays(same), arrays(coarse), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-10)
    assert coarse.resampled([0.25, 0.5]).time.tolist() == [0.25, 0.5]
    assert len(coarse.resampled([0.3])) == 1


def test_resampling_a_quintic_is_exact():
    few, many = (Motion.rest_to_rest([0, 0, 0], [0.1, 0.2, 0.3], 2.0, n) for n in (5, 401))
    for mine, theirs in zip(arrays(few.resampled(401)), arrays(many), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (1, "samples: expected a whole number from 2"),
        (True, "samples: expected"),
        (2.5, "samples: expected"),
        ([0.5, 1.5], r"expected times from 0 to 1 s, got 1\.5 s"),
        ([-0.1, 0.5], r"expected times from 0 to 1 s, got -0\.1 s"),
        ([0.5, 0.5], "strictly rising"),
        ([], "at least one"),
        ([[0.5]], r"times: expected shape \(M,\)"),
        ([np.nan], "times: expected finite"),
    ],
)
def test_resampling_refuses(samples, message):
    with pytest.raises(MotionError, match=message):
        paper_motion(11).resampled(samples)


def test_joined_motions_follow_each_other():
    there = Motion.rest_to_rest([0, 0, 0], [0.1, 0, 0.2], 1.0, 11)
    back = Motion.rest_to_rest([0.1, 0, 0.2], [0, 0, 0], 0.5, 21)
    both = Motion.joined(there, back, there)
    assert len(both) == 11 + 20 + 10
    assert both.duration == pytest.approx(2.5)
    np.testing.assert_array_equal(both.pose[10:31], np.vstack([there.pose[-1:], back.pose[1:]]))
    Motion(*arrays(both))
    later = dataclasses.replace(back, time=back.time + 7.0)  # whatever time a motion itself begins at
    np.testing.assert_allclose(Motion.joined(there, later, there).time, both.time, rtol=0, atol=1e-14)
    assert_same_bits(Motion.joined(there), there)
    with pytest.raises(MotionError, match=r"number 2 to begin with the pose .* that number 1 ends with"):
        Motion.joined(there, there)
    with pytest.raises(MotionError, match="begin with the velocity"):
        Motion.joined(
            paper_motion(11),
            dataclasses.replace(paper_motion(11), pose=paper_motion(11).pose * 0, check=False)[1:],
        )
    with pytest.raises(MotionError, match="at least one"):
        Motion.joined()
    for wrong in (5, None, "motion", [there, back]):
        with pytest.raises(MotionError, match="motions: expected Motion objects, got"):
            Motion.joined(wrong)
    with pytest.raises(MotionError, match="motions: expected Motion objects, got 5"):
        Motion.joined(there, 5)


# ---------------------------------------------------------------- files


@pytest.mark.parametrize("samples", [1, 2, 11, 101, 1001])
def test_csv_round_trip_keeps_every_bit(tmp_path, samples):
    motion = paper_motion(samples)
    path = motion.to_csv(tmp_path / "new folder" / "Bewegung 1 – θ.csv")
    assert_same_bits(Motion.from_csv(path), motion)
    assert path.read_text(encoding="utf-8").splitlines()[0] == (
        "t [s],y [m],z [m],theta [rad],ydot [m/s],zdot [m/s],thetadot [rad/s],"
        "yddot [m/s^2],zddot [m/s^2],thetaddot [rad/s^2]"
    )


FINITE = st.floats(-1e30, 1e30)


@REPEATABLE
@given(st.data())
def test_any_motion_survives_the_file(tmp_path_factory, data):
    n = data.draw(st.integers(1, 6))
    time = np.array(data.draw(st.lists(FINITE, min_size=n, max_size=n, unique=True)))
    time.sort()
    assume(np.all(time[1:] > time[:-1]))
    parts = [
        np.array(data.draw(st.lists(FINITE, min_size=3 * n, max_size=3 * n))).reshape(n, 3) for _ in range(3)
    ]
    motion = Motion(time, *parts, check=False)
    path = motion.to_csv(tmp_path_factory.mktemp("any") / "motion.csv")
    again = Motion.from_csv(path, check=False)
    assert_same_bits(again, motion)
    for mine, theirs in zip(arrays(again), arrays(motion), strict=True):
        np.testing.assert_array_equal(np.signbit(mine), np.signbit(theirs))


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "motion.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def table(motion: Motion, factors: list[float], header: str, columns: int = 10) -> str:
    rows = np.column_stack(arrays(motion))[:, :columns] * factors
    return "\n".join([header, *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"


@pytest.mark.parametrize("square", ["^2", "²"])
@pytest.mark.parametrize("gap", ["", " "])
def test_units_are_converted(tmp_path, square, gap):
    motion = paper_motion(51)
    deg = 180 / np.pi
    units = ["ms", "mm", "mm", "deg", "mm/s", "mm/s", "deg/s"]
    units += [f"mm/s{square}", f"mm/s{square}", f"deg/s{square}"]
    header = ",".join(f"{name}{gap}[{unit}]" for name, unit in zip(HEADER.split(","), units, strict=True))
    factors = [1e3, 1e3, 1e3, deg, 1e3, 1e3, deg, 1e3, 1e3, deg]
    got = Motion.from_csv(write(tmp_path, table(motion, factors, header)))
    for mine, theirs in zip(arrays(got), arrays(motion), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-15, atol=1e-15)


def test_millimetres_convert_without_an_extra_rounding(tmp_path):
    header = HEADER.replace("t,y,", "t [ms],y [mm],", 1)
    for number, metres in ((100, 0.1), (300, 0.3), (29, 0.029)):
        rows = "".join(f"{t},{number}{',0' * 8}\n" for t in (0, 7, 11))  # at rest: nothing is computed of it
        motion = Motion.from_csv(write(tmp_path, f"{header}\n{rows}"))
        assert motion.pose[:, 0].tolist() == [metres] * 3
        assert motion.time.tolist() == [0.0, 0.007, 0.011]


def test_a_pose_only_file_is_differentiated(tmp_path):
    motion = paper_motion(101)
    deg = 180 / np.pi
    got = Motion.from_csv(write(tmp_path, table(motion, [1, 1, 1, deg], "t,y,z,theta [deg]", columns=4)))
    np.testing.assert_allclose(got.velocity, motion.velocity, rtol=0, atol=1e-7)
    np.testing.assert_allclose(got.acceleration, motion.acceleration, rtol=0, atol=1e-4)


ROWS = ["0,0,0,0", "0.5,.1,0,1e-1", "1,0.2,+0.0,-.3"]


@pytest.mark.parametrize(
    "text",
    [
        "t,y,z,theta\n" + "\n".join(ROWS),
        "\ufefft,y,z,theta\n" + "\n".join(ROWS) + "\n",
        "t,y,z,theta\r\n" + "\r\n".join(ROWS) + "\r\n",
        "t,y,z,theta\r" + "\r".join(ROWS) + "\r",
        "# a comment, with commas\n\n  # another\nt,y,z,theta\n\n" + "\n\n#x\n".join(ROWS) + "\n\n\n",
        " t , y [ m ] ,z, theta[rad]\n" + "\n".join(row.replace(",", " , ") for row in ROWS),
        '"t","y","z","theta"\n' + "\n".join(",".join(f'"{x}"' for x in row.split(",")) for row in ROWS),
    ],
    ids=["plain", "bom", "crlf", "cr", "comments", "spaces", "quotes"],
)
def test_harmless_variants_are_read(tmp_path, text):
    motion = Motion.from_csv(write(tmp_path, text))
    assert motion.time.tolist() == [0, 0.5, 1]
    poses = [[0, 0, 0], [0.1, 0, 0.1], [0.2, 0, -0.3]]  # they come from the curve through them
    np.testing.assert_allclose(motion.pose, poses, rtol=0, atol=1e-15)


GOOD = "\n".join(ROWS)
FULL = "0,0,0,0,0,0,0,0,0,0\n"
MALFORMED = {
    "empty": ("", "expected a motion with .*, got an empty file"),
    "blank": ("\n \n# nothing\n", "got an empty file"),
    "header_only": ("t,y,z,theta\n", "expected lines of numbers after the header, got none"),
    "no_header": (GOOD, "line 1, column 1: expected t, got '0'"),
    "semicolons": ("t;y;z;theta\n0;0;0;0\n", "line 1: expected commas between the columns, got semicolons"),
    "tabs": ("t\ty\tz\ttheta\n", "line 1: expected commas between the columns, got tabs"),
    "order": ("t,z,y,theta\n0,0,0,0\n", "line 1, column 2: expected y, got 'z' .*in this order"),
    "duplicate": ("t,y,y,theta\n0,0,0,0\n", "line 1, column 3: expected z, got 'y'"),
    "missing": ("t,y,theta\n0,0,0\n", "line 1, column 3: expected z, got 'theta'"),
    "short": ("# x\nt,y,z\n0,0,0\n", "line 2: expected the columns .*, got only t,y,z"),
    "velocities_only": ("t,y,z,theta,ydot,zdot,thetadot\n", "got only t,y,z,theta,ydot,zdot,thetadot"),
    "extra": (HEADER + ",force\n" + FULL, "line 1, column 11: expected no more columns, got 'force'"),
    "case": ("T,Y,Z,THETA\n", "column 1: expected t, got 'T'"),
    "unit": ("t,y [dm],z,theta\n", rf"line 1, column y: expected a unit of {', '.join(LENGTHS)}, got \[dm\]"),
    "unit_empty": ("t,y [],z,theta\n", rf"column y: expected a unit of {', '.join(LENGTHS)}, got \[\]"),
    "unit_of_another": (
        "t,y [deg],z,theta\n",
        rf"column y: expected a unit of {', '.join(LENGTHS)}, got \[deg\]",
    ),
    "unit_of_time": ("t [h],y,z,theta\n", r"column t: expected a unit of s, ms, us, µs, ns, got \[h\]"),
    "unit_of_angle": (
        "t,y,z,theta [grad]\n",
        r"column theta: expected a unit of rad, deg, °, mrad, got \[grad\]",
    ),
    "unit_of_rate": (
        HEADER.replace("thetadot", "thetadot [rad]"),
        r"column thetadot: expected a unit of rad/s, deg/s, °/s, mrad/s, got \[rad\]",
    ),
    "unit_of_acceleration": (
        HEADER.replace("zddot", "zddot [mm/s]"),
        r"column zddot: expected a unit of m/s\^2, mm/s\^2, cm/s\^2, .*ft/s\^2, got \[mm/s\]",
    ),
    "bracket": ("t,y [mm,z,theta\n", r"column 2: expected y, got 'y \[mm'"),
    "ragged_long": ("t,y,z,theta\n0,0,0,0\n1,0,0,0,0\n", "line 3: expected 4 columns, got 5"),
    "ragged_short": ("t,y,z,theta\n\n# x\n0,0,0\n", "line 4: expected 4 columns, got 3"),
    "text": ("t,y,z,theta\n0,0,0,0\n1,0,abc,0\n", "line 3, column z: expected a number, got 'abc'"),
    "no_value": ("t,y,z,theta\n0,,0,0\n", "line 2, column y: expected a number, got nothing"),
    "underscore": ("t,y,z,theta\n0,1_0,0,0\n", "line 2, column y: expected a number, got '1_0'"),
    "unit_in_cell": ("t,y,z,theta\n0,5mm,0,0\n", "line 2, column y: expected a number, got '5mm'"),
    "nan": ("t,y,z,theta\n0,0,0,0\n\n1,0,nan,0\n", "line 4, column z: expected a finite number, got nan"),
    "inf": ("t,y,z,theta\n0,0,0,-inf\n", "line 2, column theta: expected a finite number, got -inf"),
    "overflow": ("t,y,z,theta\n0,0,0,1e999\n", "line 2, column theta: expected a finite number, got inf"),
    "unsorted": (
        "t,y,z,theta\n0,0,0,0\n2,0,0,0\n1,0,0,0\n",
        "line 4, column t: expected a time after 2, got 1",
    ),
    "same_time": ("t,y,z,theta\n0,0,0,0\n0,0,0,0\n", "line 3, column t: expected a time after 0, got 0"),
    "open_quote": ('t,y,z,theta\n0,"0,0,0\n1,0,0,0\n', "line [23]: "),
    "one_pose": ("t,y,z,theta\n0,0,0,0\n", "at least two samples to differentiate"),
    "huge_field": (
        "t,y,z,theta\n0,0,0," + "1" * 200_000,
        "line 2: expected at most 10000 characters, got 200006",
    ),
    "huge_header": ("t," * 1_000_000, "line 1: expected at most 10000 characters"),
    "line_end_in_quotes": ('t,y,z,theta\n0,0,0,"0\n"\n', "line 2: not valid CSV"),
    "nul": ("t,y,z,theta\n0,0,0,\0\n", "line 2"),
}


@pytest.mark.parametrize(("text", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_get_one_clear_line(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(MotionError, match=message) as caught:
        Motion.from_csv(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < len(str(path)) + 300


def test_wrong_velocities_in_a_file_are_caught_and_named(tmp_path):
    motion = paper_motion(101)
    header = HEADER.replace("thetadot,", "thetadot [deg/s],")  # the numbers are rad/s
    path = write(tmp_path, table(motion, [1] * 10, header))
    with pytest.raises(
        MotionError, match=r"motion\.csv: velocity of theta at t = .* expected .* rad/s, .* got"
    ):
        Motion.from_csv(path)
    assert len(Motion.from_csv(path, check=False)) == 101


def test_unreadable_files(tmp_path):
    with pytest.raises(FileError, match=r"none\.csv"):
        Motion.from_csv(tmp_path / "none.csv")
    with pytest.raises(FileError, match="cannot be read"):
        Motion.from_csv(tmp_path)
    with pytest.raises(FileError, match="UTF-8"):
        Motion.from_csv(write(tmp_path, "t,y,z,theta\n".encode("utf-16")))
    made = tmp_path / "folder.csv"
    made.mkdir()
    with pytest.raises(FileError, match="folder"):
        paper_motion(3).to_csv(made)
    with pytest.raises(InputError, match=r"m\.xlsx: expected a file name that ends in \.csv"):
        paper_motion(3).to_csv(tmp_path / "m.xlsx")


@pytest.mark.parametrize("path", [None, 5, 2.5, b"m.csv", ["m.csv"]])
def test_what_is_no_path(path):
    for act in (Motion.from_csv, paper_motion(3).to_csv):
        with pytest.raises(FileError, match="expected the path of a file, got"):
            act(path)


def test_a_bad_header_is_refused_before_the_rest_is_split(monkeypatch):
    lines = csv_files._lines
    taken = []
    monkeypatch.setattr(csv_files, "_lines", lambda text: (taken.append(x) or x for x in lines(text)))
    with pytest.raises(MotionError, match="m, line 2, column 1: expected t, got 'x'"):
        csv_files.parse("# a comment\nx,y\n" + "0,0\n" * 1000, "m")
    assert len(taken) == 2


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = paper_motion(3).to_csv(tmp_path / "m.csv")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(FileError, match="No space left"):
        paper_motion(5).to_csv(path)
    assert len(Motion.from_csv(path)) == 3
    assert list(tmp_path.iterdir()) == [path]


def test_a_hundred_thousand_rows_survive_the_file(tmp_path):
    motion = paper_motion(100_000)
    assert_same_bits(Motion.from_csv(motion.to_csv(tmp_path / "m.csv")), motion)


# -- from rest ---------------------------------------------------------------------------------------------


def test_from_rest_is_the_same_path_entered_slowly():
    motion = paper_motion(1001)
    entered = motion.from_rest(0.2)
    assert entered.duration == pytest.approx(1.1)
    assert len(entered) == 1101
    for array in (entered.pose - motion.pose[0], entered.velocity, entered.acceleration):
        np.testing.assert_allclose(array[0], 0, atol=1e-15)
    later = entered.time >= 0.2 - 1e-12
    same = motion.resampled(np.minimum(entered.time[later] - 0.1, 1.0))
    np.testing.assert_allclose(entered.pose[later], same.pose, atol=1e-14)
    np.testing.assert_allclose(entered.velocity[later], same.velocity, atol=1e-13)
    np.testing.assert_allclose(entered.acceleration[later], same.acceleration, atol=1e-10)


@pytest.mark.parametrize(("ramp", "stop"), [(0.2, 0.0), (0.3, 0.5), (1.0, 1.0)])
def test_from_rest_derivatives_are_those_of_its_poses(ramp, stop):
    eased = paper_motion(2001).from_rest(ramp, stop, samples=4001)
    assert eased.duration == pytest.approx(1 + (ramp + stop) / 2)
    velocity, acceleration = splines.derivatives(eased.time, eased.pose, 2)
    np.testing.assert_allclose(eased.velocity, velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(eased.acceleration, acceleration, atol=1e-5)
    if stop:
        np.testing.assert_allclose(eased.pose[-1], paper_motion(2).pose[-1], rtol=0, atol=1e-14)
        np.testing.assert_allclose([eased.velocity[-1], eased.acceleration[-1]], 0, rtol=0, atol=1e-14)


def test_from_rest_keeps_a_late_beginning():
    motion = paper_motion(101)
    late = Motion(motion.time + 7, motion.pose, motion.velocity, motion.acceleration)
    np.testing.assert_allclose(late.from_rest(0.1).pose, motion.from_rest(0.1).pose, rtol=0, atol=1e-13)


def test_a_ramp_is_needed_where_any_coordinate_starts_at_speed():
    paper = paper_motion(101)
    assert paper.velocity[0, :2].tolist() == [0, 0]  # only the angle moves at once
    assert natural_ramp(paper) == 0.2
    assert natural_ramp(paper[:11]) == pytest.approx(0.1, rel=1e-12)  # as long as the motion at most
    rest = Motion.rest_to_rest([0, 0, 0], [0.02, 0, 0.1], 1.0, 201)
    assert natural_ramp(rest) == 0
    rounded = Motion.from_poses(rest.time, rest.pose.round(8))
    assert np.abs(rounded.velocity[0]).max() > 0
    assert natural_ramp(rounded) == 0


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize(("share", "ramp"), [(0.996e-3, 0), (1.004e-3, 0.2)])
def test_a_motion_starts_at_rest_below_a_thousandth_of_its_largest_speed(column, share, ramp):
    """Backwards at constant acceleration in one coordinate; faster ones from rest do not count."""
    t, first = np.linspace(0, 1, 11), share / (1 - share)  # the speed grows by one, to the largest
    p, v, a = np.column_stack([t**2 / 2] * 3), np.column_stack([t] * 3), np.ones((11, 3))
    scale = np.full(3, 20.0)
    scale[column] = -0.1
    p[:, column] += first * t
    v[:, column] += first
    assert natural_ramp(Motion(t, scale * p, scale * v, scale * a)) == ramp


def test_a_load_keeps_its_place_on_a_path_that_is_entered_from_rest():
    """One metre at one metre per second: the load at every place, wherever the run is then."""
    places, loads = np.array([0, 0.0303, 0.4, 1]), np.array([2.0, 50, -30, 5])
    t = np.linspace(7, 8, 11)
    still = np.zeros(11)
    motion = Motion(
        t, np.column_stack([t - 7, still, still]), np.tile([1.0, 0, 0], (11, 1)), np.zeros((11, 3))
    )
    history = WrenchHistory(7 + places, np.outer(loads, np.eye(6)[0]))
    at_once = load_along(history, motion, 0.0)
    np.testing.assert_allclose(at_once.time, places, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(at_once.wrench, history.wrench)
    run, entered = load_along(history, motion, 0.2), motion.from_rest(0.2, samples=4401)
    expected = np.interp(entered.pose[:, 0], places, loads)
    found = run(entered.time - entered.time[0])
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-3)  # rows of half a millisecond
    assert not found[:, 1:].any()
    assert (at_once.start, run.start) == (0, 0)
    assert run.time[0] == 0
    assert len(run.time) == 401 + 1 + 2  # of the ramp, where the load bends on it, and later
    assert run.time[-1] == pytest.approx(1.1, rel=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0,), "ramp: expected a positive number, got 0"),
        ((-0.1,), "ramp: expected a positive number, got -0.1"),
        ((0.1, -1), "stop: expected a positive number, got -1"),
        ((1.5, 1.0), "ramp, stop: expected at most 2 s together, got 2.5 s"),
        ((0.1, 0.0, 1), "samples: expected a whole number from 2"),
        (("slow",), "ramp: expected real numbers, got 'slow'"),
        ((0.1, [1, 2]), r"stop: expected a single number"),
    ],
)
def test_from_rest_refuses(arguments, message):
    with pytest.raises(MotionError, match=message):
        paper_motion(101).from_rest(*arguments)
    with pytest.raises(MotionError, match="ramp, stop: expected at most 0 s together"):
        paper_motion(1).from_rest(0.1)


# -- wrenches ----------------------------------------------------------------------------------------------


def test_a_wrench_file(tmp_path):
    path = tmp_path / "wrench.csv"
    path.write_text("t [ms],fx,fy [kN],fz,mx,my [N mm],mz\n0,1,2,3,4,5,6\n# more\n1000,3,2,3,4,15,6\n")
    history = WrenchHistory.from_csv(path)
    assert repr(history) == "WrenchHistory(2 samples, 0 to 1 s)"
    np.testing.assert_allclose(history(0.5), [2, 2000, 3, 4, 0.01, 6], rtol=1e-15)
    np.testing.assert_allclose(history([-1.0, 0.0, 2.0])[:, 0], [1, 1, 3])
    motion = paper_motion(11)
    robot = p3dof.load()
    given = robot.inverse_dynamics(motion, wrench=history)
    table = robot.inverse_dynamics(motion, method="virtual-power", wrench=history(motion.time))
    np.testing.assert_allclose(given.forces, table.forces, rtol=1e-11)
    np.testing.assert_array_equal(given.wrench, history(motion.time))
    assert np.abs(given.power_residual).max() < 1e-10 * np.abs(given.power).max()
    run = robot.simulate(
        0.1,
        controller=lambda _: robot.forces(np.zeros(3), np.zeros(3), np.zeros(3)),
        wrench=history,
        method="virtual-power",
    )
    np.testing.assert_allclose(run.wrench, history(run.time), rtol=1e-15)


UNITS = {
    "m": {
        "mm": 1e-3,
        "cm": 1e-2,
        "um": 1e-6,
        "µm": 1e-6,
        "km": 1e3,
        "in": constants.inch,
        "ft": constants.foot,
    },
    "rad": {"deg": constants.degree, "°": constants.degree, "mrad": 1e-3},
    "N": {"kN": 1e3, "mN": 1e-3, "lbf": constants.lbf, "kgf": constants.kgf},
    "N m": {"Nm": 1, "N mm": 1e-3, "Nmm": 1e-3, "mN m": 1e-3, "mNm": 1e-3, "kN m": 1e3}
    | {"lbf in": constants.lbf * constants.inch, "lbf ft": constants.lbf * constants.foot},
    "s": {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
}
"""What may follow the name of a column in brackets, by SciPy's constants."""


def test_every_unit_of_a_column_is_what_it_is_elsewhere():
    """All that are known, none besides; those of parameter files have the same number, to a bit or two."""
    for si, table in (("m", LENGTHS), ("rad", ANGLES), ("N", FORCES), ("N m", MOMENTS), ("s", TIMES)):
        assert set(table) == {si, *UNITS[si]}
        for unit, (multiply, divide) in table.items():
            assert multiply / divide == pytest.approx({si: 1, **UNITS[si]}[unit], rel=1e-9), unit
            known = unit_of(unit)
            if known is not None:
                assert known[0] == unit_of(si)[0], unit
                assert multiply / divide == pytest.approx(float(known[1]), rel=4e-16), unit


def test_a_motion_in_inches_and_its_derivatives(tmp_path):
    """By hand: 1 in = 25.4 mm, 1 ft = 12 in; the square of a second also as s², s2."""
    path = tmp_path / "motion.csv"
    zeros = 6 * ",0"
    header = "t [µs],y [in],z [ft],theta [°],ydot [in/s],zdot [cm/s],thetadot [deg/s],yddot [in/s2],"
    path.write_text(
        f"{header}zddot [ft/s²],thetaddot [mrad/s^2]\n0,1,0.5,9{zeros}\n1000000,1,0.5,9{zeros}\n",
        encoding="utf-8",
    )
    motion = p3dof.Motion.from_csv(path)
    np.testing.assert_allclose(motion.pose, [[0.0254, 0.1524, np.pi / 20]] * 2, rtol=1e-15)
    np.testing.assert_array_equal(motion.time, [0.0, 1.0])
    factors = [a / b for a, b in (units_of("yddot")["in/s^2"], units_of("zdot")["ft/s"])]
    np.testing.assert_allclose(factors, [0.0254, 0.3048], rtol=1e-15)


@pytest.mark.parametrize("shift", range(3))
def test_each_unit_of_a_wrench_file_in_each_column(tmp_path, shift):
    """Newtons and newton metres by hand; columns without a unit are in them."""
    forces = np.roll([("", "1.5", 1.5), (" [N]", "-20", -20.0), (" [kN]", "0.3", 300.0)], shift, axis=0)
    moments = np.roll([(" [N m]", "4", 4.0), (" [Nm]", "-5", -5.0), (" [N mm]", "60", 0.06)], shift, axis=0)
    units, texts, values = np.vstack([forces, moments]).T
    header = ",".join(
        name + unit for name, unit in zip(("fx", "fy", "fz", "mx", "my", "mz"), units, strict=True)
    )
    (tmp_path / "wrench.csv").write_text(f"t [s],{header}\n0,{','.join(texts)}\n")
    history = WrenchHistory.from_csv(tmp_path / "wrench.csv")
    np.testing.assert_allclose(history.wrench, [values.astype(float)], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a wrench with the columns t,fx,fy,fz,mx,my,mz, in this order, got an empty file"),
        (
            "t,fx,fy,fz,mx,my\n0,1,2,3,4,5\n",
            "expected the columns t,fx,fy,fz,mx,my,mz, in this order, got only",
        ),
        ("t,fx,fy,fz,mx,mz,my\n0,1,2,3,4,5,6\n", "line 1, column 6: expected my, got 'mz'"),
        (
            "t,fx [m],fy,fz,mx,my,mz\n0,1,2,3,4,5,6\n",
            r"column fx: expected a unit of N, kN, mN, lbf, kgf, got \[m\]",
        ),
        (
            "t,fx,fy,fz,mx,my [N],mz\n0,1,2,3,4,5,6\n",
            r"column my: expected a unit of N m, Nm, N mm, .*lbf ft, got \[N\]",
        ),
        ("t,fx,fy,fz,mx,my,mz\n0,1,x,3,4,5,6\n", "line 2, column fy: expected a number, got 'x'"),
        ("t,fx,fy,fz,mx,my,mz\n0,1,2,3,4,5,nan\n", "line 2, column mz: expected a finite number, got nan"),
        ("t,fx,fy,fz,mx,my,mz\n1,1,2,3,4,5,6\n0,1,2,3,4,5,6\n", "line 3, column t: expected a time after 1"),
    ],
)
def test_a_wrench_file_that_does_not_fit(tmp_path, text, message):
    path = tmp_path / "wrench.csv"
    path.write_text(text)
    with pytest.raises(MotionError, match=message) as caught:
        WrenchHistory.from_csv(path)
    assert str(path) in str(caught.value)


def test_a_wrench_history_refuses():
    with pytest.raises(MotionError, match=r"wrench: expected shape \(2, 6\), got \(2, 3\)"):
        WrenchHistory([0, 1], np.zeros((2, 3)))
    with pytest.raises(MotionError, match="time: expected at least one sample"):
        WrenchHistory([], np.zeros((0, 6)))
    with pytest.raises(MotionError, match="time: expected"):
        WrenchHistory([1, 0], np.zeros((2, 6)))
    with pytest.raises(MotionError, match="time: expected real numbers, got 'now'"):
        WrenchHistory([0], np.zeros((1, 6)))("now")


def test_what_lies_between_samples_does_not_ask_when_they_began():
    """A motion that begins at 5 s is that from 0 s, later; between samples too."""
    own = paper_motion(41)
    later = Motion(own.time + 5.0, own.pose, own.velocity, own.acceleration)
    at = np.linspace(0, own.duration, 97)
    found = splines.between_samples(later.time, later.pose, later.velocity, later.acceleration, at + 5.0)
    for one, other in zip(
        found, splines.between_samples(own.time, own.pose, own.velocity, own.acceleration, at), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * np.abs(other).max())


def test_what_lies_between_samples_is_that_of_its_own_side_of_a_jump():
    """A step a thousand times shorter than those beside it: a cubic on each side is met exactly."""
    sides = np.poly1d([2.0, -1.0, 0.5, 3.0]), np.poly1d([-1.0, 4.0, 0.0, -20.0])
    time = np.concatenate([np.linspace(0, 1, 11)[:-1], [1 - 1e-6], np.linspace(1, 2, 11)])
    assert splines.breaks(time).tolist() == [False] * 10 + [True] + [False] * 10
    assert [(part.start, part.stop) for part in splines.unbroken(time)] == [(0, 11), (10, 12), (11, 22)]
    known = np.concatenate([sides[0](time[:11]), sides[1](time[11:])])[:, None] * [1.0, -2.0, 0.5]
    at = np.sort(np.concatenate([time, np.arange(0.03, 2, 0.07)]))
    found = splines.between_samples(time, known, known, known, at)[3]
    expected = np.where(at < time[11], sides[0](at), sides[1](at))[:, None] * [1.0, -2.0, 0.5]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    assert splines.subdivided(np.array([0.0, 1.0, 4.0]), np.array([2, 3])).tolist() == [0, 0.5, 1, 2, 3]
