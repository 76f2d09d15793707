"""Identified robots on held-out data: better than the design, honest about noise, prior and doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gallery import gallery
from motor_logs import fourier_motion, motor_log, truth_of
from scipy.stats import binom
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof.analysis.identification import MachineForces
from p3dof.loops.identification.data import ForcesFit
from p3dof.loops.identification.forces import ExtendedForces, LoopForces, Rows, States
from p3dof.loops.identification.validation import (
    combinations_table,
    identify,
    in_words,
    ljung_box,
    parameters_table,
    unit_of,
    validate,
    validation_table,
)
from p3dof.loops.robots import load_robot
from p3dof.loops.sidecar import Closure, JointData, Sidecar
from p3dof.machine.parameters import read_parameters, write_parameters

COUNTS, NOISE = 2 * np.pi / 8192, 0.02


def logs_of(forces, truth, sizes, noise, counts, rate=250.0, seconds=3.0):
    """A log to identify from, periodic; one of another motion to validate on."""
    motions = (fourier_motion(forces.home, size * sizes, T, 4, seed) for size, T, seed in
               ((1.0, 1.5, 1), (0.7, 2.3, 2)))  # fmt: skip
    settings = {"rate": rate, "noise": noise, "counts": counts, "delay": 0.003}
    return [motor_log(forces, truth, motion, seconds, seed=i, **settings) for i, motion in enumerate(motions)]


@pytest.fixture(scope="module")
def five_bar():
    forces = LoopForces(gallery("five_bar"))
    truth = truth_of(forces, seed=3)
    return forces, truth, logs_of(forces, truth, np.full(2, 0.4), NOISE, COUNTS)


@pytest.fixture(scope="module")
def found(five_bar):
    forces, _, (log, other) = five_bar
    identified = identify(forces, log)
    return identified, validate(identified, other)


def friction_within(identified, truth, sigmas=3.0):
    forces = identified.forces
    own = [
        i for i, name in enumerate(forces.names)
        if name.rpartition(".")[0] in forces.actuators and name.endswith(("damping", "friction"))
    ]  # fmt: skip
    apart = np.abs(identified.parameters - truth)[own] / identified.deviations[own]
    return len(own) == 2 * len(forces.actuators) and (apart < sigmas).all()


def test_held_out_forces_are_those_of_the_robot_as_built(five_bar, found):
    _, truth, _ = five_bar
    identified, checked = found
    assert checked.better
    assert (checked.error < checked.design_error / 30).all()
    assert checked.verdict.startswith("Better than the design on held-out data: 0.0")
    assert checked.chi_square == pytest.approx(1.0, abs=0.5)
    assert friction_within(identified, truth)
    assert not checked.remarks


def test_curves_of_forces_have_gaps_where_samples_were_left_out(five_bar):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    from p3dof.report.plots import predicted_figure

    forces, _, (log, other) = five_bar
    for lost in (0, 40):
        keep = np.r_[0:300, 300 + lost : len(other.time)]
        part = replace(
            other, **{name: getattr(other, name)[keep] for name in ("time", "positions", "forces")}
        )
        checked = validate(identify(forces, log), part)
        axes = predicted_figure(checked).axes
        assert len(axes) == 2
        for i, axis in enumerate(axes):
            measured, _, identified = axis.lines
            assert (
                np.isnan(measured.get_ydata()).sum() == np.isnan(identified.get_ydata()).sum() == (lost > 0)
            )
            kept = ~np.isnan(measured.get_xdata())
            assert measured.get_xdata()[kept].tolist() == checked.data.time.tolist()
            assert measured.get_ydata()[kept].tolist() == checked.data.forces[:, i].tolist()


def test_the_machine_learns_its_friction_and_writes_a_file_that_has_it(tmp_path):
    forces = MachineForces()
    truth = truth_of(forces, seed=3)
    log, other = logs_of(forces, truth, np.array([0.1, 0.1, 0.4]), 1.0, 1e-5)
    identified = identify(forces, log)
    checked = validate(identified, other)
    assert checked.better
    assert (checked.error < 0.1 * checked.design_error).all()
    assert friction_within(identified, truth)
    write_parameters(identified.robot, tmp_path / "machine.yaml")
    again = MachineForces(read_parameters(tmp_path / "machine.yaml"))
    states = checked.data.states
    rows, own = forces.rows(states), again.rows(states)
    predicted = rows.columns @ identified.parameters + rows.known
    np.testing.assert_allclose(
        own.columns @ again.design + own.known, predicted, rtol=0, atol=1e-10 * np.abs(predicted).max()
    )


def test_the_robot_that_is_written_has_the_identified_forces(tmp_path, found):
    identified, checked = found
    identified.robot.write(tmp_path / "robot.urdf")
    again = LoopForces(p3dof.load_robot(tmp_path / "robot.urdf"))
    states = checked.data.states
    rows = identified.forces.rows(states)
    own = again.rows(again.from_actuators(*states[:3]))
    predicted = rows.columns @ identified.parameters + rows.known
    np.testing.assert_allclose(
        own.columns @ again.design + own.known, predicted, rtol=0, atol=1e-9 * np.abs(predicted).max()
    )


@pytest.mark.slow
def test_a_leg_with_rods_between_balls_learns():
    forces = LoopForces(gallery("leg"))
    truth = truth_of(forces, seed=3)
    log, other = logs_of(forces, truth, np.full(6, 0.25), 0.05, 2 * np.pi / 16384)
    identified = identify(forces, log)
    checked = validate(identified, other)
    assert (checked.error < 0.1 * checked.design_error).all()
    assert friction_within(identified, truth, 3.5)  # the largest of twelve
    assert abs(identified.data.delay - 0.003) < 4 * identified.data.delay_deviation


@pytest.mark.parametrize(("scale", "words"), [(0.1, "too narrow"), (10.0, "too wide"), (1.0, "")])
def test_a_prior_that_the_forces_contradict_is_told(five_bar, scale, words):
    forces, _, (log, other) = five_bar
    identified = identify(forces, log, deviations=scale * forces.deviations(), consistent=False)
    told = [one for one in validate(identified, other).remarks if "the prior is" in one]
    assert len(told) == bool(words)
    assert all(words in one for one in told)


def test_what_is_not_better_than_the_design_is_not_to_be_used(five_bar):
    """The held-out robot is the design: what another one taught is wrong for it."""
    forces, truth, (log, _) = five_bar
    _, other = logs_of(forces, forces.design, np.full(2, 0.4), NOISE, COUNTS)
    identified = identify(forces, log)
    checked = validate(identified, other)
    assert not checked.better
    assert checked.verdict.startswith("Do not use: not better than the design on held-out data: ")
    assert checked.chi_square > 10
    assert any("the model lacks something" in told for told in checked.remarks)
    assert np.abs(truth - forces.design).max() > 0


def test_offsets_of_sensors_are_found_beside_the_weight(five_bar):
    forces, truth, (log, other) = five_bar
    shifted = replace(log, forces=log.forces + np.array([0.2, -0.1]))
    identified = identify(forces, shifted, offsets=True)
    spread = identified.estimate.deviations[-2:]
    assert (np.abs(identified.offsets - [0.2, -0.1]) < 3.5 * spread).all()
    assert (spread < 0.1).all()
    checked = validate(identified, replace(other, forces=other.forces + np.array([0.2, -0.1])))
    assert (checked.error < checked.design_error / 10).all()
    assert not identify(forces, log).offsets.any()
    assert friction_within(identified, truth)


def test_ljung_box_tells_white_noise_from_coloured():
    rng = np.random.default_rng(0)
    p = np.array([ljung_box(rng.normal(size=400)) for _ in range(200)])
    assert 0.02 < (p < 0.05).mean() < 0.09
    assert (p > 0.5).mean() == pytest.approx(0.5, abs=0.12)
    walk = rng.normal(size=400)
    assert ljung_box(walk + 0.5 * np.roll(walk, 1)) < 1e-6
    assert ljung_box(np.zeros(50)) == 1.0


class Axes:
    """Two motors with inertia, friction and weight: forces that are quick enough for many logs."""

    actuators = coordinates = ("one", "two")
    position_units = coordinate_units = ("rad", "rad")
    force_units = ("N m", "N m")
    home, limits = np.zeros(2), ()
    names = tuple(
        f"{axis}.{what}" for axis in actuators for what in ("armature", "damping", "friction", "load")
    )
    design = np.array([0.05, 0.1, 0.3, 1.0, 0.04, 0.1, 0.2, 0.5])

    def deviations(self, **_):
        return 0.2 * self.design

    def from_actuators(self, *motion):
        return States(*map(np.asarray, motion), None)

    from_coordinates = from_actuators

    def rows(self, states):
        x, v, a = states[:3]
        columns = np.zeros((*x.shape, 8))
        for j in range(2):
            columns[:, j, 4 * j : 4 * j + 4] = np.stack([a, v, np.sign(v), np.cos(x)], axis=-1)[:, j]
        return Rows(columns, np.zeros(x.shape))

    def corrected(self, parameters):
        return parameters


BUILT = Axes.design * [1.2, 0.9, 1.3, 1.1, 0.8, 1.1, 0.9, 1.05]


def axes_logs(seed, delay=0.003, periods=(1.0, 1.1), seconds=3.3):
    motions = (fourier_motion(Axes.home, size * np.full(2, 0.4), T, 3, first + seed)
               for size, T, first in ((1.0, periods[0], 1000), (0.7, periods[1], 2000)))  # fmt: skip
    return [
        motor_log(Axes(), BUILT, motion, seconds, rate=250.0, noise=0.02, delay=delay, seed=2 * seed + i)
        for i, motion in enumerate(motions)
    ]


@pytest.mark.parametrize(
    ("period", "periods"), [("auto", (1.0, 1.1)), ("auto", (1.0013, 1.0817)), (None, (1.0, 1.1))]
)
def test_residuals_of_a_perfect_model_are_white_and_those_without_friction_are_not(period, periods):
    """One in twenty p values is below 0.05, half of them below 0.5, as binomial distributions let them be.

    Parameters miss the true ones by their standard deviations, the root mean square of all.
    """
    found, wrong, chi_square, missed = [], [], [], []
    for seed in range(60):
        log, other = axes_logs(seed, periods=periods)
        identified = identify(Axes(), log, period=period, consistent=False)
        checked = validate(identified, other, period=period)
        assert (checked.data.periods > 0) == (period == "auto")
        found += list(checked.whiteness)
        chi_square.append(checked.chi_square)
        doubts = np.sqrt(np.diag(identified.estimate.covariance))
        missed.append((identified.parameters - BUILT) / doubts)
        if seed < 5:
            without = np.array(identified.parameters)
            without[[2, 6]] = 0.0
            estimate = replace(identified.estimate, parameters=without)
            wrong.append(validate(replace(identified, estimate=estimate), other, period=period).whiteness)
    for level in (0.05, 0.5):
        least, most = binom.interval(0.999, len(found), level)
        assert least <= np.count_nonzero(np.array(found) < level) <= most
    assert np.max(wrong) < 0.05
    assert np.count_nonzero(np.array(wrong) < 0.01) >= 9  # of ten
    assert np.mean(chi_square) == pytest.approx(1.0, abs=0.2)
    assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(1.0, abs=0.13)


@pytest.mark.parametrize("delay", [0.002, 0.003, 0.004])
def test_the_delay_of_a_motion_that_is_not_periodic_is_found_between_samples_and_on_them(delay):
    """Of samples 4 ms apart: a mean of two neighbours has less noise, and would draw it between them."""
    errors = []
    for seed in range(5):
        data = identify(Axes(), axes_logs(seed, delay)[0], period=None, consistent=False).data
        errors.append((data.delay - delay) / data.delay_deviation)
    assert np.abs(errors).max() < 4
    assert abs(np.mean(errors)) < 4 / np.sqrt(5)


def test_tables_say_it_in_words(found):
    identified, checked = found
    rows = {row[0]: row for row in parameters_table(identified).rows}
    assert rows["left_motor: viscous friction"][1] == "N m s/rad"
    assert rows["left_motor: Coulomb friction"][-1] == "100%"
    assert len(parameters_table(identified, all_of_them=True).rows) == len(identified.forces.names)
    assert [row[0] for row in validation_table(checked).rows] == ["left_motor", "right_motor"]
    assert any("left_motor.friction" in str(row[0]) for row in combinations_table(identified).rows)
    assert in_words("slider_a.Ixy") == "slider_a: inertia xy"
    machine = MachineForces()
    units = {name.rpartition(".")[2]: unit_of(name, machine) for name in machine.names}
    assert units == {
        "m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m", "Ixx": "kg m²", "Ixy": "kg m²", "Iyy": "kg m²",
        "Ixz": "kg m²", "Iyz": "kg m²", "Izz": "kg m²", "armature": "kg", "counterbalance": "N",
        "spring": "N/m", "damping": "N s/m", "friction": "N",
    }  # fmt: skip


def test_units_are_those_of_each_joint_not_of_motors_alone():
    """A passive slide with a spring and a wheel with one, behind a motor that turns."""
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    kinds = {"crank": "continuous", "rod": "continuous", "piston": "prismatic"}
    parents = {"crank": "base", "rod": "crank", "piston": "base"}
    places = {"crank": "0 0 0", "rod": "0.2 0 0", "piston": "0.7 0 0"}
    joints = "".join(
        f'<link name="{name}_body">{inertial}</link><joint name="{name}" type="{kind}">'
        f'<parent link="{"base" if parents[name] == "base" else parents[name] + "_body"}"/>'
        f'<child link="{name}_body"/><origin xyz="{places[name]}"/>'
        f'<axis xyz="{"1 0 0" if kind == "prismatic" else "0 1 0"}"/>'
        '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        for name, kind in kinds.items()
    )
    eye = '<link name="eye"/><joint name="end" type="fixed"><parent link="rod_body"/><child link="eye"/>'
    text = f'<robot name="r"><link name="base"/>{joints}{eye}<origin xyz="0.5 0 0"/></joint></robot>'
    springs = [JointData("piston", stiffness=3.0, force=2.0), JointData("rod", stiffness=1.0)]
    sidecar = Sidecar(
        (Closure("eye", "piston_body"),), ("crank",), (), {"crank": 1.0}, joint_data=tuple(springs)
    )
    forces = LoopForces(load_robot(text, sidecar))
    told = {name: unit_of(name, ExtendedForces(forces, ["stribeck"])) for name in forces.names}
    of_slide = {"stiffness": "N/m", "preload": "N", "damping": "N s/m", "friction": "N", "armature": "kg"}
    assert {what: told[f"piston.{what}"] for what in of_slide} == of_slide
    assert [told[f"rod.{what}"] for what in ("stiffness", "damping")] == ["N m/rad", "N m s/rad"]
    assert told["crank.armature"] == "kg m²"
    assert unit_of("crank.stribeck", forces) == "N m"


def test_whiteness_is_of_residuals_whitened_by_the_whole_covariance(found):
    identified, checked = found
    data, rest = checked.data, checked.residuals
    A = (data.rows.columns / data.noise[:, None]).reshape(rest.size, -1)
    values, vectors = np.linalg.eigh(np.eye(rest.size) + A @ identified.estimate.covariance @ A.T)
    white = (vectors @ ((vectors.T @ (rest / data.noise).ravel()) / np.sqrt(values))).reshape(rest.shape)
    pairs = list(zip(white.T, data.independent.T, strict=True))
    check_evidence(checked, "whiteness", np.array([ljung_box(x[some]) for x, some in pairs]), rtol=1e-6)
    assert (checked.whiteness > 0.01).all()


@pytest.mark.parametrize(("period", "apart"), [("auto", 6), (None, 3)])
def test_residuals_are_tested_at_samples_that_filters_leave_independent(period, apart):
    """So many steps of 4 ms apart, and not beside a motor's reversal."""
    data = identify(Axes(), axes_logs(0)[0], period=period, consistent=False).data
    speed = np.abs(data.states.velocities)
    for some, own in zip(data.independent.T, speed.T, strict=True):
        assert np.count_nonzero(some) > 20
        assert np.diff(data.time[some]).min() > 0.004 * (apart - 1e-6)
        assert own[some].min() > 0.02 * own.max()


@shows(
    "p3dof.loops.identification.validation.Validation.residuals",
    "p3dof.loops.identification.validation.Validation.design_residuals",
    "p3dof.loops.identification.validation.Validation.error",
    "p3dof.loops.identification.validation.Validation.design_error",
    "p3dof.loops.identification.validation.validation_table",
)
def test_errors_are_those_of_plain_sums(five_bar, found):
    """Chi-square by the whole covariance matrix of all samples."""
    forces, _, _ = five_bar
    identified, checked = found
    A, y, noise = checked.data.rows.columns, checked.data.forces - checked.data.rows.known, checked.data.noise
    left, before = y - A @ identified.parameters, y - A @ forces.design
    error, design = (np.sqrt((x**2).mean(axis=0)) for x in (left, before))
    check_evidence(checked, "residuals", left, rtol=0, atol=1e-12 * np.abs(y).max())
    check_evidence(checked, "design_residuals", before, rtol=0, atol=1e-12 * np.abs(y).max())
    check_evidence(checked, "error", error, rtol=1e-9)
    check_evidence(checked, "design_error", design, rtol=1e-9)
    flat = A.reshape(-1, A.shape[-1])
    covariance = flat @ identified.estimate.covariance @ flat.T + np.diag(np.tile(noise**2, len(A)))
    chi_square = left.ravel() @ np.linalg.solve(covariance, left.ravel()) / left.size
    size = np.sqrt((checked.data.forces**2).mean(axis=0))
    check_table(
        validation_table(checked),
        {
            name: ("N m", size[i], design[i], error[i], (error[i] / size[i],), checked.whiteness[i])
            for i, name in enumerate(forces.actuators)
        },
        note=[chi_square, 1],
    )


@shows(
    "p3dof.loops.identification.validation.parameters_table",
    "p3dof.loops.identification.validation.combinations_table",
)
def test_parameters_stand_with_their_deviations(five_bar, found):
    forces, _, _ = five_bar
    identified, _ = found
    estimate = identified.estimate
    spread = np.sqrt(np.diag(estimate.covariance))
    prior = forces.deviations()
    seen = np.array([1 - min(s / p, 1.0) if p else 0.0 for s, p in zip(spread, prior, strict=True)])
    order = [i for i in np.argsort(-seen, kind="stable") if seen[i] >= 0.1]
    check_table(
        parameters_table(identified),
        [
            (
                in_words(forces.names[i]), unit_of(forces.names[i], forces), forces.design[i],
                estimate.parameters[i], spread[i], (seen[i],),
            )
            for i in order
        ],
    )  # fmt: skip
    check_table(combinations_table(identified), [(words, x, s) for words, x, s in estimate.combinations])
    assert len(estimate.combinations) > 8


def test_what_the_prior_expects_is_what_draws_from_it_show():
    """Of a thousand robots drawn from the prior, squares of the factor are one on average, p values even."""
    rng, prior, noise = np.random.default_rng(0), np.array([1.0, 0.5, 2.0, 3.0]), np.array([0.1, 0.2])
    columns, design = rng.normal(size=(30, 2, 4)), rng.normal(size=4)
    fit = ForcesFit(Rows(columns, np.ones((30, 2))), design, prior, noise, np.zeros(2))
    found = []
    for _ in range(1000):
        forces = columns @ (design + prior * rng.normal(size=4)) + 1.0 + noise * rng.normal(size=(30, 2))
        found.append(fit.against_prior(forces, 4.0))
    factors, shares = np.array(found).T
    assert np.mean(factors**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 4 / 1000))  # of four combinations
    assert np.mean(shares < 0.5) == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / 1000))
    doubled = fit.against_prior(columns @ (design + 10 * prior) + 1.0, 4.0)
    assert doubled[0] == pytest.approx(10.0, rel=0.01)
    assert doubled[1] < 1e-12
    assert np.isnan(fit.against_prior(forces, np.inf)).all()
