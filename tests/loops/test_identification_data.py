"""Logs of motors: files, periods, derivatives, the delay, and one clear line for each thing that is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from gallery import gallery
from motor_logs import fourier_motion, motor_log, truth_of

from p3dof._base.errors import FileError, InputError, ModelError, MotionError
from p3dof.analysis.identification import MachineForces
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.loops.identification.data import prepare_log, resolution
from p3dof.loops.identification.forces import LoopForces
from p3dof.loops.identification.logs import MotorLog, outliers, read_log
from p3dof.loops.identification.validation import identify

RATE, COUNTS, NOISE = 400.0, 2 * np.pi / 8192, 0.02
KINDS = [("rad", "N m")] * 2


@pytest.fixture(scope="module")
def five_bar():
    forces = LoopForces(gallery("five_bar"))
    return forces, truth_of(forces, seed=3)


@pytest.fixture(scope="module")
def log(five_bar):
    """Two and a half periods of 1.5 s, forces late by 3 ms."""
    forces, truth = five_bar
    motion = fourier_motion(forces.home, np.full(2, 0.4), 1.5, 4, seed=1)
    return motor_log(forces, truth, motion, 3.75, rate=RATE, noise=NOISE, counts=COUNTS, delay=0.003)


def changed(log, **columns):
    return replace(log, **{name: np.array(values) for name, values in columns.items()})


# Files


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_files_come_back_in_si_units_whatever_they_are_in(tmp_path, ending):
    names, rng = ("slide", "hinge"), np.random.default_rng(0)
    x, f, time = rng.normal(size=(50, 2)), rng.normal(size=(50, 2)), np.arange(50) * 1e-3
    columns = {
        "t [ms]": 1e3 * time, "force:hinge [N mm]": 1e3 * f[:, 1], "slide [mm]": 1e3 * x[:, 0],
        "hinge [deg]": np.degrees(x[:, 1]), "current:slide [mA]": 1e3 * f[:, 0] / -4.0,
    }  # fmt: skip
    path = tmp_path / f"log.{ending}"
    if ending == "csv":
        rows = np.column_stack(list(columns.values()))
        path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows.tolist())]))
    else:
        arrow = pytest.importorskip("pyarrow", reason="pyarrow not installed")
        parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow not installed")
        parquet.write_table(arrow.table(columns), path)
    found = read_log(path, names, [("m", "N"), ("rad", "N m")], constants={"slide": -4.0})
    np.testing.assert_allclose(found.time, time, rtol=1e-15, atol=1e-18)
    np.testing.assert_allclose(found.positions, x, rtol=1e-15)
    np.testing.assert_allclose(found.forces, f, rtol=4e-16)


def test_what_is_written_comes_back_to_the_same_bits(tmp_path, log):
    found = read_log(log.to_csv(tmp_path / "log.csv"), log.actuators, KINDS)
    for one, other in zip(
        (found.time, found.positions, found.forces), (log.time, log.positions, log.forces), strict=True
    ):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,a,b,force:a\n0,1,2,3\n", "expected a log of motors with the columns|expected the columns"),
        ("t,a,b,force:a [V],force:b\n0,1,2,3,4\n", r"column force:a: expected a unit of N m, .* got \[V\]"),
        ("t [h],a,b,force:a,force:b\n0,1,2,3,4\n", r"column t: expected a unit of s, ms"),
        ("t,a,b,force:a,force:b\n0,1,2,nan,4\n", "1 of 1 samples have no number in a column"),
        ("t,a,b,force:a,force:b\n0,1,2,3\n", "line 2: expected 5 columns, got 4"),
        ("t,a,b,force:a,force:b\n0,1,2,3,4\n0,1,2,3,4\n", "line 3, column t: expected a time after 0"),
        ("t,a,b,current:a,force:b\n0,1,2,3,4\n", "current:a is a current: give constants"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_one_line(tmp_path, text, words):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises((InputError, MotionError, FileError), match=words) as caught:
        read_log(path, ("a", "b"), KINDS)
    assert "\n" not in str(caught.value)


# Derivatives, averages, the delay


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("delay", [0.003, -0.0037])
def test_the_delay_is_found_to_a_fifth_of_a_millisecond(five_bar, periodic, delay):
    """Samples are 2.5 ms apart, friction and masses of the robot unknown."""
    forces, truth = five_bar
    motion = fourier_motion(forces.home, np.full(2, 0.4), 1.5, 4, seed=1)
    log = motor_log(forces, truth, motion, 4.5, rate=RATE, noise=NOISE, counts=COUNTS, delay=delay)
    found = prepare_log(forces, log, period="auto" if periodic else None)
    assert found.periods == (3 if periodic else 0)
    assert abs(found.delay - delay) < 2e-4
    assert abs(found.delay - delay) < 4 * found.delay_deviation
    given = prepare_log(forces, log, period="auto" if periodic else None, delay=delay + 0.004)
    assert (given.noise > 2 * found.noise).all()  # at a wrong delay the model does not fit


def test_viscous_friction_does_not_pass_for_a_delay(five_bar):
    """The design knows of no friction: with its parameters alone, the delay is far off."""
    forces, truth = five_bar
    motion = fourier_motion(forces.home, np.full(2, 0.4), 1.5, 4, seed=1)
    log = motor_log(forces, truth, motion, 3.0, rate=RATE, noise=NOISE, counts=COUNTS, delay=0.003)
    blind = prepare_log(forces, log, deviations=1e-6 * forces.deviations(), check=False)
    assert abs(blind.delay - 0.003) > 2e-3


@pytest.mark.parametrize("uneven", [False, True])
def test_derivatives_of_a_periodic_motion_are_those_of_the_motion(five_bar, log, uneven):
    forces, _ = five_bar
    motion = fourier_motion(forces.home, np.full(2, 0.4), 1.5, 4, seed=1)
    if uneven:
        rng = np.random.default_rng(0)
        keep = np.sort(rng.choice(len(log), int(0.8 * len(log)), replace=False))
        log = changed(log, time=log.time[keep], positions=log.positions[keep], forces=log.forces[keep])
    found = prepare_log(forces, log)
    assert found.period == pytest.approx(1.5, rel=1e-4)
    x, v, a = motion(found.time)
    # Counts are an error of COUNTS / √12 a sample; with K unknowns of N it is √(K / N) of that, times ω^n.
    step = COUNTS / np.sqrt(12) * np.sqrt(9 / len(found)) * 4
    omega = 2 * np.pi * 4 / 1.5
    for one, true, power in zip(found.states[:3], (x, v, a), range(3), strict=True):
        assert np.abs(one - true).max() < step * omega**power * (4 if uneven else 2)
    assert found.spread == pytest.approx(np.full(2, NOISE), rel=0.15)


def test_the_clock_of_a_log_may_begin_anywhere(five_bar, log):
    """Far from zero, and no multiple of the period away: states and delay are the same."""
    forces, _ = five_bar
    here, later = (prepare_log(forces, one) for one in (log, changed(log, time=log.time + 500.321)))
    assert (here.periods, later.periods) == (2, 2)
    for name in ("positions", "velocities", "accelerations"):
        one, other = getattr(here.states, name), getattr(later.states, name)
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-6 * np.abs(one).max())
    assert later.delay == pytest.approx(here.delay, abs=1e-6)


def test_without_noise_the_model_of_the_truth_is_met_to_rounding(five_bar):
    forces, truth = five_bar
    truth = np.where([name.endswith("friction") for name in forces.names], 0.0, truth)
    motion = fourier_motion(forces.home, np.full(2, 0.3), 1.0, 3, seed=4)
    found = prepare_log(forces, motor_log(forces, truth, motion, 2.0, rate=200.0), delay=0.0)
    left = found.forces - found.rows.columns @ truth - found.rows.known
    # Between a quarter and half of the sampling rate forces fade: nothing of them is there.
    assert np.abs(left).max() < 1e-9 * np.abs(found.forces).max()


def test_what_the_filter_takes_from_forces_it_takes_from_the_model(five_bar):
    """A window of 80 ms takes away much of steps of friction; nothing is left over all the same."""
    forces, truth = five_bar
    motion = fourier_motion(forces.home, np.full(2, 0.4), 1.5, 4, seed=1)
    log = motor_log(forces, truth, motion, 3.0, rate=RATE)
    found = prepare_log(forces, log, period=None, smooth=6.0, delay=0.0)
    left = found.forces - found.rows.columns @ truth - found.rows.known
    unfiltered = forces.rows(found.states)
    biased = found.forces - unfiltered.columns @ truth - unfiltered.known
    assert np.sqrt((left**2).mean()) < 0.1 * np.sqrt((biased**2).mean())


def test_the_resolution_of_an_encoder_is_seen():
    x = np.sin(np.linspace(0, 9, 5000))
    assert resolution(np.round(x / COUNTS) * COUNTS + 0.3) == pytest.approx(COUNTS, rel=1e-6)
    assert resolution(x) == 0.0


def test_outliers_are_single_samples_and_no_steps():
    rng = np.random.default_rng(0)
    x = np.where(np.arange(400) < 200, -1.0, 1.0) + 0.05 * rng.normal(size=400)
    assert not outliers(x).any()
    x[[50, 300]] += 3.0
    assert np.flatnonzero(outliers(x)).tolist() == [50, 300]


# What is wrong


def test_a_healthy_log_has_no_remark(five_bar, log):
    assert prepare_log(five_bar[0], log).remarks == ()


def swap(values):
    return values[:, ::-1]


def turned(values):
    return values * [1.0, -1.0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda log: {"forces": swap(log.forces)}, "forces of left_motor and right_motor are exchanged"),
        (lambda log: {"positions": swap(log.positions)}, "s of left_motor and right_motor are exchanged"),
        (lambda log: {"forces": turned(log.forces)}, "the force of right_motor has the other sign"),
        (lambda log: {"forces": -log.forces}, "all forces have the other sign"),
        (lambda log: {"positions": turned(log.positions)}, "the position of right_motor has the other sign"),
        (lambda log: {"forces": 1e3 * log.forces}, r"all forces are 1000 times too large \(mm or N mm\?\)"),
        (lambda log: {"forces": 1e-3 * log.forces}, "all forces are 1000 times too small"),
        (lambda log: {"positions": np.degrees(log.positions)}, "all positions are in degrees"),
        (lambda log: {"positions": np.radians(log.positions)}, "all positions are in rad where"),
        (lambda log: {"forces": log.forces * [1.0, 1e3]}, "force of right_motor is 1000 times too large"),
        (lambda log: {"forces": log.forces * [1, 0] + [0, 2.5]}, "force of right_motor is constant, 2.5"),
        (lambda log: {"forces": np.clip(log.forces, -0.8, 0.8)}, "is saturated: .* record a slower motion"),
        (lambda log: {"positions": np.where(log.time[:, None] > 1, np.nan, log.positions)}, "sample 401"),
    ],
)  # fmt: skip
def test_wrong_columns_are_one_line_that_says_what_to_do(five_bar, log, change, words):
    with pytest.raises(InputError, match=words) as caught:
        prepare_log(five_bar[0], changed(log, **change(log)))
    assert "\n" not in str(caught.value)


def test_who_knows_better_may_go_on(five_bar, log):
    worse = changed(log, forces=swap(log.forces))
    assert (prepare_log(five_bar[0], worse, check=False).noise > 0.1).all()


def test_a_short_log_is_refused(five_bar, log):
    with pytest.raises(InputError, match="too short: 30 samples, expected at least 40"):
        changed(log, time=log.time[:30], positions=log.positions[:30], forces=log.forces[:30])
    few = slice(0, 60)
    with pytest.raises(InputError, match=r"too short: \d+ independent samples"):
        prepare_log(
            five_bar[0],
            changed(log, time=log.time[few], positions=log.positions[few], forces=log.forces[few]),
        )


def test_few_saturated_samples_are_left_out(five_bar, log):
    forces, truth = five_bar
    most = np.quantile(log.forces[:, 0], 0.97)
    clipped = changed(log, forces=np.column_stack([np.minimum(log.forces[:, 0], most), log.forces[:, 1]]))
    found = prepare_log(forces, clipped)
    (told,) = found.remarks
    assert "the force of left_motor is saturated" in told
    assert "left out" in told
    # As they are, the peaks would be wrong by more than the noise.
    left = found.forces - found.rows.columns @ truth - found.rows.known
    assert np.sqrt((left[:, 0] ** 2).mean()) < 1.5 * NOISE


def test_a_gap_is_told_and_both_sides_are_used(five_bar, log):
    keep = (log.time < 1.2) | (log.time > 1.7)
    torn = changed(log, time=log.time[keep], positions=log.positions[keep], forces=log.forces[keep])
    found = prepare_log(five_bar[0], torn, period=None)
    (told,) = found.remarks
    assert "has a gap from t = 1.198 to 1.702 s" in told
    assert found.time.min() < 0.5
    assert found.time.max() > 3.0
    assert not ((found.time > 1.2) & (found.time < 1.7)).any()


HOLES = ["1.0,,2,3,4", "1.0,1,nan,3,4", "1.0,1,2,3,", "1.0,1,2, NaN ,4", ",1,2,3,4"]


@pytest.mark.parametrize("hole", HOLES)
def test_samples_without_a_number_are_left_out_as_lost_lines_are(tmp_path, hole, log):
    path = log.to_csv(tmp_path / "log.csv")
    header, *lines = path.read_text().splitlines()
    without = ["# of a controller", header, *lines[:50], *lines[57:]]
    path.write_text("\n".join([*without[:52], *[hole] * 7, *without[52:]]) + "\n")
    found = read_log(path, log.actuators, KINDS)
    assert found.left_out == 7
    kept = np.r_[:50, 57 : len(log)]
    for name in ("time", "positions", "forces"):
        np.testing.assert_array_equal(getattr(found, name), getattr(log, name)[kept])
    path.write_text("\n".join([*without[:52], *[hole] * 7, *without[52:], "5,1,2,x,4"]))
    with pytest.raises(MotionError, match=f"line {len(lines) + 3}, column .*expected a number, got 'x'"):
        read_log(path, log.actuators, KINDS)


def test_how_many_samples_have_no_number_is_told_with_the_gap(five_bar, tmp_path, log):
    path = log.to_csv(tmp_path / "log.csv")
    lines = path.read_text().splitlines()
    holes = [line.rsplit(",", 1)[0] + "," for line in lines[50:60]]
    path.write_text("\n".join([*lines[:50], *holes, *lines[60:]]))
    data = prepare_log(five_bar[0], read_log(path, log.actuators, KINDS))
    told = " ".join(data.remarks)
    assert told.startswith("10 samples of ")
    assert "log.csv have no number in a column (empty or NaN): left out" in told
    assert "(11 steps): the pieces beside it are taken by themselves" in told


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_log_with_many_samples_without_a_number_is_one_error(tmp_path, share, log):
    path = log.to_csv(tmp_path / "log.csv")
    header, *lines = path.read_text().splitlines()
    count = round(share * len(lines))
    lines[:count] = [line.rsplit(",", 1)[0] + "," for line in lines[:count]]
    path.write_text("\n".join([header, *lines]))
    words = f"log.csv: {count} of {len(lines)} samples have no number in a column .* expected at most 20%"
    with pytest.raises(MotionError, match=words):
        read_log(path, log.actuators, KINDS)


def test_outliers_of_forces_and_positions_are_left_out(five_bar, log):
    forces, positions = np.array(log.forces), np.array(log.positions)
    forces[400, 0] += 40.0
    positions[500, 1] += 0.5
    found = prepare_log(five_bar[0], changed(log, forces=forces, positions=positions))
    assert [("force" in told, "position" in told) for told in found.remarks] == [(True, False), (False, True)]
    assert all("an outlier at t = " in told and "left out" in told for told in found.remarks)
    assert (found.noise < 1.3 * prepare_log(five_bar[0], log).noise).all()


def test_a_motion_that_shows_nothing_is_told(five_bar):
    forces, truth = five_bar
    motion = fourier_motion(forces.home, np.full(2, 1e-5), 1.5, 1, seed=1)
    truth = np.where([name.endswith("friction") for name in forces.names], 0.0, truth)
    log = motor_log(forces, truth, motion, 3.0, rate=RATE, noise=0.3)
    told = identify(forces, log, delay=0.0, check=False).remarks
    assert any("not exciting: the motion shows only" in one for one in told)


def test_a_log_of_other_actuators_is_refused(five_bar, log):
    with pytest.raises(MotionError, match="expected the actuators left_motor, right_motor, got a, b"):
        prepare_log(five_bar[0], MotorLog(("a", "b"), log.time, log.positions, log.forces))


def test_positions_that_no_pose_has_are_named_with_their_range():
    forces = MachineForces()
    log = motor_log(
        forces, forces.design, fourier_motion(forces.home, np.full(3, 0.06), 1.0, 3, seed=2), 2.0, rate=200.0
    )
    with pytest.raises(InputError, match=r"the robot cannot follow slide_a 4\.9.* m, slide_b"):
        prepare_log(forces, changed(log, positions=log.positions + np.array([5.0, 0.0, 0.0])))


def test_a_limit_of_the_design_that_is_exceeded_is_told():
    """The machine beyond its travel of .2 m, as an encoder with a wrong zero says."""
    forces = MachineForces()
    motion = fourier_motion(np.array([0.17, 0.0, 0.0]), np.full(3, 0.06), 1.0, 3, seed=2)
    log = motor_log(forces, truth_of(forces, 1), motion, 2.0, rate=200.0, noise=1.0)
    assert any("position of slide_" in told and "exceeds the design's limit" in told
               for told in identify(forces, log, delay=0.0, consistent=False).remarks)  # fmt: skip


def test_a_pendulum_that_swings_is_no_rod_that_spins():
    """Rods of a leg may spin between their balls; what a motor feels, it must determine."""
    model = pin.Model()
    cart = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "cart")
    pole = model.addJoint(cart, pin.JointModelRY(), pin.SE3.Identity(), "pole")
    for joint, mass, lever in ((cart, 2.0, 0.0), (pole, 0.3, -0.5)):
        body = pin.Inertia(mass, np.array([0.0, 0.0, lever]), 1e-3 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    with pytest.raises(ModelError, match="1 actuators do not determine a motion with 2 degrees of freedom"):
        LoopForces(ClosedLoopModel(model, Sidecar((), ("cart",))))
    assert len(LoopForces(gallery("leg")).actuators) == 6
