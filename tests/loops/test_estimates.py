"""Inertial parameters from measured forces and the design: never worse than the design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from gallery import gallery
from lagrange import LagrangeModel
from table_numbers import check_evidence, shows

import p3dof
from p3dof import ClosedLoopModel
from p3dof._base.errors import InputError
from p3dof.analysis import MachineForces
from p3dof.loops import (
    ExtendedForces,
    LoopForces,
    estimate_parameters,
    estimate_payload,
    optimise_excitation,
    prior_deviations,
)
from p3dof.loops.identification import validation
from p3dof.loops.identification.forces import bodies_of, pseudo_inertia
from p3dof.machine.motion import paper_motion
from p3dof.machine.parameters import SOLIDS, Body, Friction
from p3dof.methods.regressor import inertial_parameters


def another(body, rng):
    """A body as built: its mass 10 % off at most, its mass centre 5 mm in each direction."""
    heavier = rng.uniform(0.9, 1.1)
    return Body(body.mass * heavier, body.com + rng.uniform(-5e-3, 5e-3, 3), body.inertia * heavier)


@pytest.fixture(scope="module")
def machines():
    """Regressor of the paper's motion at 1 kHz, the design, and forces of machines as built, by Lagrange."""
    motion, robot = paper_motion(1001), p3dof.load(SOLIDS)
    states = motion.pose, motion.velocity, motion.acceleration
    built = []
    for seed in range(7):
        rng = np.random.default_rng(seed)
        bodies = {name: another(body, rng) for name, body in SOLIDS.bodies.items()}
        built.append(LagrangeModel(replace(SOLIDS, bodies=replace(SOLIDS.bodies, **bodies))).forces(*states))
    regressor = robot.force_regressor(*states)
    return regressor, inertial_parameters(SOLIDS.bodies), built


@pytest.mark.parametrize("noise", [0.1, 0.5])
@pytest.mark.parametrize("milliseconds", [20, 60, 200, 1000])
def test_forces_over_the_whole_motion_are_never_worse_than_the_designs(machines, milliseconds, noise):
    regressor, design, built = machines
    A, rows = regressor.inertial, milliseconds + 1
    doubts = prior_deviations(regressor.inertial_names, design)
    own, found = [], []
    for seed, forces in enumerate(built):
        measured = forces[:rows] + np.random.default_rng(seed).normal(0, noise, (rows, 3))
        estimate = estimate_parameters(A[:rows], measured, design, doubts, noise)
        own.append(np.sqrt(((A @ design - forces) ** 2).mean()))
        found.append(np.sqrt(((A @ estimate.parameters - forces) ** 2).mean()))
        assert estimate.residual == pytest.approx(noise, rel=0.5)
        assert (estimate.deviations <= doubts * (1 + 1e-12)).all()
    assert np.median(found) < np.median(own) / 2
    assert (np.array(found) < own).all()


def test_what_least_squares_alone_makes_of_60_ms(machines):
    """Why there is a prior: whatever is cut off, forces on the rest of the motion are wrong."""
    regressor, _, (forces, *_) = machines
    measured = forces[:61] + np.random.default_rng(0).normal(0, 0.5, (61, 3))
    A = regressor.base[:61].reshape(-1, 21)
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    change = np.linalg.lstsq(A / scale, measured.ravel() - A @ regressor.base_parameters, rcond=1e-3)[0]
    wrong = regressor.base @ (regressor.base_parameters + change / scale) - forces
    assert np.sqrt((wrong**2).mean()) > 20


@shows(
    "p3dof.loops.identification.estimates.ParameterEstimate.residual",
    "p3dof.loops.identification.estimates.ParameterEstimate.residuals",
)
def test_it_is_the_posterior_of_two_normal_distributions():
    """By the formulas of the text book with plain inverses: the problem is small and well conditioned."""
    rng = np.random.default_rng(5)
    A, truth, doubts = rng.normal(size=(12, 4)), rng.normal(size=4), np.array([0.5, 2.0, 0.1, 1.0])
    design, measured = truth + doubts * rng.normal(size=4), A @ truth + rng.normal(0, 0.3, 12)
    found = estimate_parameters(A.reshape(6, 2, 4), measured.reshape(6, 2), design, doubts, [0.3, 0.3])
    precision = np.diag(doubts**-2) + A.T @ A / 0.3**2
    mean = np.linalg.solve(precision, design / doubts**2 + A.T @ measured / 0.3**2)
    np.testing.assert_allclose(found.parameters, mean, rtol=1e-12)
    np.testing.assert_allclose(found.deviations, np.sqrt(np.diag(np.linalg.inv(precision))), rtol=1e-12)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(precision), rtol=1e-11, atol=1e-14)
    forces, spread = found.predicted(A[:2])
    np.testing.assert_allclose(forces, A[:2] @ mean, rtol=1e-12)
    np.testing.assert_allclose(spread**2, np.diag(A[:2] @ np.linalg.inv(precision) @ A[:2].T), rtol=1e-10)
    check_evidence(found, "residuals", (measured - A @ mean).reshape(6, 2), rtol=1e-11)
    check_evidence(found, "residual", np.sqrt(((A @ mean - measured) ** 2).mean()), rtol=1e-12)


def test_what_nothing_was_measured_of_stays_at_the_design():
    A = np.array([[1.0, 0.0, 2.0], [3.0, 0.0, -1.0]])
    found = estimate_parameters(A, [5.0, 5.0], [1.0, 7.0, 1.0], [10.0, 3.0, 0.0], 1e-3)
    assert (found.parameters[1], found.deviations[1]) == (7.0, 3.0)  # no force shows it
    assert (found.parameters[2], found.deviations[2]) == (1.0, 0.0)  # it was not to change
    assert found.parameters[0] == pytest.approx((3 * 1 + 6 * 3) / 10, rel=1e-6)


def test_the_doubts_of_bodies_cover_how_they_were_made():
    """Over many bodies as built, parameters differ from the design by about their standard deviations."""
    names = [f"leg_a.{name}" for name in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
    first = 10 * list(dict(SOLIDS.bodies.items())).index("leg_a")
    at = slice(first, first + 10)
    design = inertial_parameters(SOLIDS.bodies)[at]
    doubts = prior_deviations(names, design)
    rng = np.random.default_rng(1)
    drawn = []
    for _ in range(200):
        leg = SOLIDS.bodies.leg_a
        heavier = 1 + 0.1 * rng.normal()
        one = Body(leg.mass * heavier, leg.com + rng.normal(0, 5e-3, 3), leg.inertia * heavier)
        drawn.append(inertial_parameters(replace(SOLIDS.bodies, leg_a=one))[at])
    spread = np.std(drawn, axis=0)
    assert (spread < 1.2 * doubts).all()
    np.testing.assert_allclose(spread[:4], doubts[:4], rtol=0.2)


def test_any_robot_learns_from_few_states():
    """A Stewart platform as built, 4 and 40 states: forces at others, against its own."""
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/stewart.urdf")
    rng, model = np.random.default_rng(3), loop.model.copy()
    for i in range(1, model.njoints):
        body = model.inertias[i]
        if body.mass:
            place = body.lever + rng.uniform(-5e-3, 5e-3, 3)
            model.inertias[i] = pin.Inertia(body.mass * rng.uniform(0.9, 1.1), place, body.inertia)
    built, home = ClosedLoopModel(model, loop.sidecar), loop.assemble()
    start = home.q[[loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]]
    motions = start + 0.03 * rng.normal(size=(60, 6)), rng.normal(size=(60, 6)), 5 * rng.normal(size=(60, 6))
    states = loop.complete_batch(*motions, guess=home.q)
    regressor = loop.force_regressor(states.q, states.v, states.a)
    forces = built.inverse_dynamics_batch(states.q, states.v, states.a).tau
    doubts = prior_deviations(regressor.parameter_names, regressor.parameters)
    others, errors = slice(40, None), [np.abs(regressor.forces @ regressor.parameters - forces)[40:].max()]
    for count in (4, 40):
        measured = forces[:count] + rng.normal(0, 0.01, (count, 6))
        found = estimate_parameters(
            regressor.forces[:count], measured, regressor.parameters, doubts, noise=0.01
        )
        errors.append(np.abs(regressor.forces @ found.parameters - forces)[others].max())
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.1 * errors[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"columns": np.zeros(3)}, r"columns: expected shape \(N, m, P\) or \(N, P\), got \(3,\)"),
        ({"measured": np.zeros(5)}, r"measured: expected shape \(4,\), got \(5,\)"),
        ({"measured": [0, 0, np.nan, 0]}, "measured: expected finite numbers"),
        ({"columns": np.zeros((0, 3)), "measured": []}, "measured: expected at least one sample"),
        ({"design": np.zeros(2)}, r"design: expected shape \(3,\)"),
        ({"deviations": [1, -1, 1]}, "deviations: expected zero or more"),
        ({"noise": 0.0}, "noise: expected positive numbers"),
        ({"noise": [1.0, 1.0]}, r"noise: expected shape \(\) or \(1,\), got \(2,\)"),
        ({"names": ["a"]}, "names: expected 3, got 1"),
        ({"method": "best"}, "method: expected one of map, wls, essential, robust, got 'best'"),
        ({"widths": "any"}, "widths: expected one of given, estimated, got 'any'"),
    ],
)
def test_a_bad_argument_is_one_clear_error(change, words):
    given = {
        "columns": np.zeros((4, 3)), "measured": np.zeros(4), "design": np.zeros(3),
        "deviations": np.ones(3), "noise": 1.0,
    }  # fmt: skip
    with pytest.raises(InputError, match=words):
        estimate_parameters(**given | change)


def test_names_that_are_no_bodies_are_refused():
    with pytest.raises(InputError, match="names: expected m, mx, my"):
        prior_deviations(["leg.m", "leg.mx"], [1.0, 0.0])
    with pytest.raises(InputError, match="shift: expected a positive number"):
        prior_deviations(["hinge.damping"], [1.0], shift=0)
    np.testing.assert_allclose(prior_deviations(["hinge.damping"], [-2.0], other=0.5), [1.0])


# With friction, over the whole workspace

FRICTION = Friction({"slide_a": 20, "slide_b": 25, "slide_c": 15}, {"slide_a": 5, "slide_b": 4, "slide_c": 6})


def built_machine(seed):
    """The machine as built: bodies as `another` makes them, and friction that the design lacks."""
    rng = np.random.default_rng(seed)
    bodies = {name: another(body, rng) for name, body in SOLIDS.bodies.items()}
    return MachineForces(replace(SOLIDS, bodies=replace(SOLIDS.bodies, **bodies), friction=FRICTION))


def fourier(rng, time, count=5):
    """A motion of five harmonics in two seconds, as far as the tests need it within the workspace."""
    w = np.pi * np.arange(1, count + 1)
    a, b = rng.normal(size=(2, count, 3)) / np.arange(1, count + 1)[:, None] * [0.02, 0.02, 0.1]
    s, c = np.sin(np.outer(time, w)), np.cos(np.outer(time, w))
    return s @ a + (c - 1) @ b, (c * w) @ a - (s * w) @ b, -(s * w**2) @ a - (c * w**2) @ b


@pytest.fixture(scope="module")
def somewhere():
    """The design, and its rows at 300 random states of the workspace."""
    forces, rng = MachineForces(SOLIDS), np.random.default_rng(0)
    pose = rng.uniform(-1, 1, (300, 3)) * [0.1, 0.1, 0.6]
    states = forces.from_coordinates(
        pose, rng.normal(size=(300, 3)) * [0.4, 0.4, 1.5], rng.normal(size=(300, 3)) * [4, 4, 15]
    )
    return forces, forces.rows(states)


@pytest.mark.parametrize("noise", [0.1, 5.0])
@pytest.mark.parametrize("seconds", [0.02, 0.2, 10.0])
def test_forces_over_the_workspace_are_never_worse_than_the_designs(somewhere, seconds, noise):
    """Nothing of the noise is given, at any length of data: median and 95 % of 20 machines as built."""
    forces, (others, _) = somewhere
    time = np.linspace(0, seconds, max(21, min(int(1000 * seconds), 500)))
    noise *= np.sqrt(len(time) / max(21, 1000 * seconds))  # as of 1 kHz
    own, found = [], []
    for seed in range(20):
        rng, built = np.random.default_rng(100 + seed), built_machine(seed)
        rows = forces.rows(forces.from_coordinates(*fourier(rng, time)))
        measured = rows.columns @ built.design + rng.normal(0, noise, (len(time), 3))
        estimate = estimate_parameters(
            rows.columns, measured, forces.design, forces.deviations(), names=forces.names, consistent=False
        )
        own.append(np.sqrt(((others @ (forces.design - built.design)) ** 2).mean()))
        found.append(np.sqrt(((others @ (estimate.parameters - built.design)) ** 2).mean()))
    assert np.median(found) < np.median(own)
    assert np.quantile(found, 0.95) < np.quantile(own, 0.95)
    if seconds == 10.0:
        assert np.median(found) < 0.05 * np.median(own)


@pytest.fixture(scope="module")
def logged():
    """Ten seconds of five harmonics, a thousand samples: rows, and the machine as built."""
    forces = MachineForces(SOLIDS)
    rows = forces.rows(forces.from_coordinates(*fourier(np.random.default_rng(4), np.arange(1000) * 0.002)))
    return forces, rows.columns, built_machine(3)


@pytest.mark.parametrize("method", ["map", "wls"])
def test_intervals_of_95_percent_hold_the_truth_so_often(logged, method):
    """Two hundred draws: of noise, for friction; and of noise and machines, for all parameters."""
    forces, A, built = logged
    A = A[::4]
    doubts, held, friction = forces.deviations(), [], slice(109, 115)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        truth = forces.design + doubts * rng.normal(size=len(doubts)) if method == "map" else built.design
        measured = A @ truth + rng.normal(0, 1.0, A.shape[:2])
        found = estimate_parameters(A, measured, forces.design, doubts, 1.0, method=method)
        inside = np.abs(found.parameters - truth) <= 1.96 * found.deviations
        held.append(inside[friction].mean() if method == "wls" else inside[doubts > 0].mean())
    assert 0.92 < np.mean(held) < 0.98


def test_friction_is_within_three_standard_deviations_and_noise_is_found(logged):
    forces, A, built = logged
    rng, sizes = np.random.default_rng(8), np.array([0.5, 1.0, 2.0])
    measured = A @ built.design + rng.normal(0, 1, A.shape[:2]) * sizes
    found = estimate_parameters(A, measured, forces.design, forces.deviations(), names=forces.names)
    for slide in "abc":
        for what in ("damping", "friction"):
            at = forces.names.index(f"slide_{slide}.{what}")
            assert abs(found.parameters[at] - built.design[at]) < 3 * found.deviations[at]
            assert found.seen[at] > 0.9
    np.testing.assert_allclose(found.noise, sizes, rtol=0.06)


def test_all_bodies_are_possible_and_both_solvers_agree(logged):
    """Weak excitation and much noise: the most likely bodies are impossible, the consistent ones are not."""
    pytest.importorskip("clarabel", reason="clarabel is not installed")
    forces, A, built = logged
    rng, d = np.random.default_rng(2), 3 * forces.deviations()
    few, measured = A[:40], A[:40] @ built.design + rng.normal(0, 0.1, (40, 3))
    estimates = {
        solver: estimate_parameters(few, measured, forces.design, d, 0.1, names=forces.names, solver=solver)
        for solver in ("clarabel", "barrier")
    }
    free = estimate_parameters(few, measured, forces.design, d, 0.1, names=forces.names, consistent=False)

    def cost(parameters):
        z = (parameters - forces.design) / np.where(d > 0, d, 1)
        return (((few @ parameters - measured) / 0.1) ** 2).sum() + z @ z

    def least(parameters):
        found = []
        for first in bodies_of(forces.names):
            J = pseudo_inertia(parameters[first : first + 10])
            size = np.sqrt(np.abs(np.diag(pseudo_inertia(forces.design[first : first + 10]))))
            found.append(np.linalg.eigvalsh(J / np.outer(size, size)).min())
        return min(found)

    assert least(free.parameters) < -0.01
    assert min(least(one.parameters) for one in estimates.values()) > 0
    one, other = (cost(estimates[solver].parameters) for solver in ("clarabel", "barrier"))
    assert one == pytest.approx(other, rel=1e-6)
    assert cost(free.parameters) < one
    assert one < cost(forces.design)
    np.testing.assert_allclose(
        estimates["clarabel"].parameters / np.where(d > 0, d, 1),
        estimates["barrier"].parameters / np.where(d > 0, d, 1),
        rtol=0,
        atol=1e-3,
    )
    for estimate in estimates.values():  # a machine that can be made, of which the forces are those estimated
        machine = forces.corrected(estimate.parameters)
        motion = paper_motion(11)
        rows = forces.rows(forces.from_coordinates(motion.pose, motion.velocity, motion.acceleration))
        np.testing.assert_allclose(
            p3dof.load(machine).inverse_dynamics(motion).forces,
            rows.columns @ estimate.parameters + rows.known,
            rtol=0,
            atol=1e-9,
        )


def test_outliers_are_told_and_do_not_matter(logged):
    forces, A, built = logged
    rng = np.random.default_rng(6)
    measured = A @ built.design + rng.normal(0, 0.5, A.shape[:2])
    wrong = rng.choice(1000, 30, replace=False)
    measured[wrong] += rng.choice([-200.0, 200.0], (30, 3))
    given = A, measured, forces.design, forces.deviations()
    robust = estimate_parameters(*given, method="robust", names=forces.names)
    plain = estimate_parameters(*given, names=forces.names)
    errors = [np.sqrt(((A @ (one.parameters - built.design)) ** 2).mean()) for one in (robust, plain)]
    assert errors[0] < 0.1 < 0.2 * errors[1]
    np.testing.assert_allclose(robust.noise, 0.5, rtol=0.1)
    assert robust.remarks[0] == "90 of 3000 forces are outliers and count less than a third"


def test_essential_parameters_are_those_that_are_sure(logged):
    forces, A, built = logged
    measured = A @ built.design + np.random.default_rng(5).normal(0, 1, A.shape[:2])
    given = A, measured, forces.design, forces.deviations(), 1.0
    few, all_of_them = (estimate_parameters(*given, method=method) for method in ("essential", "wls"))
    changed = [np.count_nonzero(one.parameters != forces.design) for one in (few, all_of_them)]
    assert changed[1] == 27  # 21 base parameters, six of friction
    assert 10 <= changed[0] < 20
    free = A[..., all_of_them.prior > 0].reshape(3000, -1)  # normal equations of what is not known
    left = (measured - A @ all_of_them.parameters).ravel()
    assert np.abs(free.T @ left).max() < 1e-9 * np.abs(free.T @ measured.ravel()).max()
    at = few.parameters != forces.design
    assert (few.deviations[~at] == few.prior[~at]).all()
    others = MachineForces(SOLIDS)
    motion = paper_motion(101)
    rows = others.rows(others.from_coordinates(motion.pose, motion.velocity, motion.acceleration)).columns
    errors = [np.sqrt(((rows @ (one.parameters - built.design)) ** 2).mean()) for one in (few, all_of_them)]
    assert errors[0] < 0.5 < errors[1]


def test_the_width_of_the_prior_is_found_from_much_data(logged):
    """Ten times too wide or too narrow a prior comes back to what the machines were drawn from."""
    forces, A, _ = logged
    doubts, factors = forces.deviations(), {0.1: [], 10.0: []}
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth = forces.design + doubts * rng.normal(size=len(doubts))
        measured = A @ truth + rng.normal(0, 0.05, A.shape[:2])
        for wrong, found in factors.items():
            one = estimate_parameters(
                A, measured, forces.design, wrong * doubts, 0.05, widths="estimated", names=forces.names
            )
            np.testing.assert_allclose(
                one.prior[:100], one.widths["bodies"] * wrong * doubts[:100], rtol=1e-12
            )
            found.append(wrong * one.widths["bodies"])
    assert 0.5 < min(map(min, factors.values())) < max(map(max, factors.values())) < 2


def test_estimated_widths_make_the_forces_most_probable():
    """Against the density of the forces themselves, a normal distribution, all covariances written out."""
    rng = np.random.default_rng(3)
    A, names = (
        rng.normal(size=(60, 8)),
        [f"joint_{i}.{'damping' if i < 4 else 'stiffness'}" for i in range(8)],
    )
    doubts = rng.uniform(0.5, 2.0, 8)
    truth = doubts * rng.normal(size=8) * np.repeat([3.0, 0.3], 4)
    measured = A @ truth + rng.normal(0, 0.2, 60)
    found = estimate_parameters(A, measured, np.zeros(8), doubts, 0.2, widths="estimated", names=names)
    best = np.log([found.widths["friction"], found.widths["joints"]])

    def probability(logs):
        spread = doubts * np.exp(np.repeat(logs, 4))
        covariance = 0.04 * np.eye(60) + (A * spread**2) @ A.T
        size = np.linalg.slogdet(covariance)[1] + measured @ np.linalg.solve(covariance, measured)
        return -size / 2 - np.sum((logs / np.log(10)) ** 2) / 2

    slopes = [(probability(best + h) - probability(best - h)) / 0.02 for h in 0.01 * np.eye(2)]
    curvature = [
        (probability(best + h) + probability(best - h) - 2 * probability(best)) / 1e-4
        for h in 0.01 * np.eye(2)
    ]
    assert (np.array(curvature) < 0).all()
    np.testing.assert_allclose(np.array(slopes) / curvature, 0, atol=5e-3)
    assert best[0] > 0 > best[1]


def test_what_is_seen_is_told_in_combinations():
    """Two masses that only their sum shows, and a third that nothing does."""
    A = np.array([[1.0, 2.0, 0.0, 0.5], [2.0, 4.0, 0.0, -1.0], [1.0, 2.0, 0.0, 3.0]])
    names = ["slide.damping", "hinge.damping", "rest.damping", "slide.friction"]
    found = estimate_parameters(
        A, A @ [2.0, 1.0, 9.0, 1.0], [1.0, 1.0, 9.0, 0.0], [1.0, 1.0, 1.0, 1.0], 1e-3, names=names
    )
    told = {words: (value, spread) for words, value, spread in found.combinations}
    assert sorted(told, reverse=True) == ["slide.friction", "hinge.damping + 0.5 slide.damping"]
    assert told["hinge.damping + 0.5 slide.damping"][0] == pytest.approx(2.0, rel=1e-5)
    precision = np.eye(4) + A.T @ A / 1e-6
    row = np.array([0.5, 1.0, 0.0, 0.0])
    spread = np.sqrt(row @ np.linalg.inv(precision) @ row)
    assert told["hinge.damping + 0.5 slide.damping"][1] == pytest.approx(spread, rel=1e-6)
    np.testing.assert_allclose(found.seen[2], 0.0, atol=1e-12)
    nothing = estimate_parameters(0 * A, np.zeros(3), np.zeros(4), np.ones(4), 1.0, names=names)
    assert nothing.remarks == (
        "the forces show nothing that the prior does not know better: excite the robot more",
    )
    assert nothing.combinations == ()


def test_values_of_combinations_are_those_of_their_words():
    """Small terms are left out of the words; value and deviation were with them, many deviations off."""
    A = np.array([[1.0, 0.009, 0.0], [-1.0, -0.009, 2.0], [2.0, 0.018, 1.0]])
    truth, doubt = np.array([3.0, 50.0, 1.0]), np.array([10.0, 10.0, 1.0])
    names = ["rotor.armature", "body.m", "rotor.friction"]
    found = estimate_parameters(A, A @ truth, [1.0, 50.0, 1.0], doubt, 1e-3, names=names, consistent=False)
    told = {words: (value, spread) for words, value, spread in found.combinations}
    for i, name in ((0, "rotor.armature"), (2, "rotor.friction")):
        assert told[name][0] == pytest.approx(found.parameters[i], rel=1e-12)
        assert told[name][1] == pytest.approx(np.sqrt(found.covariance[i, i]), rel=1e-12)
    precision = np.diag(doubt**-2.0) + A.T @ A / 1e-6
    spread = np.sqrt(np.linalg.inv(precision)[0, 0])  # 0.09: the body's mass is known to 10 kg
    assert told["rotor.armature"][1] == pytest.approx(spread, rel=1e-6)
    assert told["rotor.armature"][0] == pytest.approx(3.0, abs=spread)


# Payloads, and what a model of bodies lacks


def test_a_payload_of_two_kilograms_is_found_to_a_percent(logged):
    """The same motion with and without it, of a machine that is not its design, by Lagrange's equations."""
    forces, _, built = logged
    motion = fourier(np.random.default_rng(4), np.arange(1000) * 0.002)
    com = np.array([0.0, 0.03, -0.06])
    payload = Body(2.0, com, np.diag([0.004, 0.005, 0.006]))
    loaded = LagrangeModel(built.parameters.carrying(payload)).forces(*motion)
    rng = np.random.default_rng(0)
    difference = loaded - LagrangeModel(built.parameters).forces(*motion) + rng.normal(0, 1.0, loaded.shape)
    found = estimate_payload(forces, forces.from_coordinates(*motion), difference, "platform")
    assert found.mass == pytest.approx(2.0, rel=0.01)
    assert abs(found.mass - 2.0) < 3 * found.mass_deviation < 0.06
    seen = found.com_deviations < 0.05  # the platform turns about y, and cannot show where along it
    assert seen.tolist() == [True, False, True]
    assert (np.abs(found.com - com)[seen] < 3 * found.com_deviations[seen]).all()
    assert np.linalg.eigvalsh(found.inertia).min() > 0


def test_a_payload_of_any_robot():
    forces = LoopForces(p3dof.load_robot(ROOT / "docs/_static/gallery/stewart.urdf"))
    rng, count = np.random.default_rng(1), 60
    motion = (
        forces.home + 0.03 * rng.normal(size=(count, 6)),
        rng.normal(size=(count, 6)),
        5 * rng.normal(size=(count, 6)),
    )
    states, design = forces.from_actuators(*motion), forces.design
    first = forces.names.index("platform.m")
    model, com = forces.robot.model.copy(), np.array([0.02, -0.03, 0.1])
    joint = 1 + first // 10
    model.inertias[joint] = model.inertias[joint] + pin.Inertia(2.0, com, np.diag([0.01, 0.012, 0.015]))
    loaded = ClosedLoopModel(model, forces.robot.sidecar).inverse_dynamics_batch(*states.whole).tau
    rows = forces.rows(states)
    difference = loaded - rows.columns @ design - rows.known + rng.normal(0, 0.1, loaded.shape)
    found = estimate_payload(forces, states, difference, "platform", size=0.3)
    assert found.mass == pytest.approx(2.0, rel=0.01)
    assert (np.abs(found.com - com) < 3 * found.com_deviations).all()
    np.testing.assert_allclose(found.com, com, atol=0.01)
    with pytest.raises(InputError, match=r"body: expected one of .*platform.*, got 'hand'"):
        estimate_payload(forces, states, difference, "hand")
    with pytest.raises(InputError, match="size: expected a positive number"):
        estimate_payload(forces, states, difference, "platform", size=0)


def test_what_a_model_of_bodies_lacks_is_found(logged):
    """Friction of a screw that grows with its load and as it stops, motor constants 4 % off, offsets."""
    forces, _, built = logged
    plain = forces.rows(forces.from_coordinates(*fourier(np.random.default_rng(4), np.arange(1000) * 0.002)))
    states = forces.from_coordinates(*fourier(np.random.default_rng(4), np.arange(1000) * 0.002))
    load = plain.columns @ built.design
    sign = np.tanh(states.velocities / 1e-3)
    true = load + np.array([0.03, 0.05, 0.0]) * np.abs(load) * sign
    true += np.array([2.0, 0.0, 3.0]) * np.exp(-((states.velocities / 0.05) ** 2)) * sign
    measured = true / (1 + np.array([0.04, 0.0, -0.04])) + [1.0, -2.0, 0.0]
    measured += np.random.default_rng(2).normal(0, 0.1, measured.shape)
    at, found = None, None
    for _ in range(4):  # loads are those of the estimate before
        extended = ExtendedForces(forces, stribeck_speed=0.05, at=at)
        found = estimate_parameters(
            extended.rows(states).columns,
            measured,
            extended.design,
            extended.deviations(),
            names=extended.names,
        )
        at = found.parameters
    value = dict(zip(found.names, found.parameters, strict=True))
    spread = dict(zip(found.names, found.deviations, strict=True))
    truth = {
        "slide_a.load_friction": 0.03, "slide_b.load_friction": 0.05, "slide_a.stribeck": 2.0,
        "slide_c.stribeck": 3.0, "slide_a.offset": 1.0, "slide_b.offset": -2.0,
    }  # fmt: skip
    for name, number in truth.items():
        assert abs(value[name] - number) < max(4 * spread[name], 0.1 * abs(number)), name
    difference = value["slide_a.constant"] - value["slide_c.constant"]
    assert difference == pytest.approx(0.08, abs=0.02)  # all constants together are the scale of all masses
    assert found.residual < 0.11
    without = estimate_parameters(
        plain.columns, measured, forces.design, forces.deviations(), names=forces.names
    )
    assert without.residual > 3 * found.residual
    assert isinstance(extended.corrected(found.parameters), type(SOLIDS))


def test_extras_that_are_none_are_refused(logged):
    with pytest.raises(
        InputError, match="extras: expected some of stribeck, load_friction, constant, offset, got 'dust'"
    ):
        ExtendedForces(logged[0], ["dust"])
    with pytest.raises(InputError, match="stribeck_speed: expected a positive number"):
        ExtendedForces(logged[0], stribeck_speed=0)
    with pytest.raises(InputError, match="at: expected 115 parameters or more, got 3"):
        ExtendedForces(logged[0], at=[1, 2, 3])


@pytest.mark.slow
def test_a_badly_chosen_motion_gives_consistent_parameters_that_predict():
    """Ten seconds with the least condition number, 1 N of noise: .05 N on the paper's motion."""
    forces, motion = MachineForces(SOLIDS), paper_motion(101)
    found = optimise_excitation(forces, criterion="condition", motions=400)
    rows = forces.rows(forces.from_coordinates(*found.steady(np.arange(10_000) / 1000))).columns
    paper = forces.rows(forces.from_coordinates(motion.pose, motion.velocity, motion.acceleration)).columns
    for seed in range(3):
        built = built_machine(seed)
        measured = rows @ built.design + np.random.default_rng(seed).normal(0, 1.0, rows.shape[:2])
        estimate = estimate_parameters(rows, measured, forces.design, forces.deviations(), names=forces.names)
        error = np.sqrt(((paper @ (estimate.parameters - built.design)) ** 2).mean(axis=0))
        assert (error < 0.05).all()
        forces.corrected(estimate.parameters)  # refuses bodies that are none


def test_limits_of_an_extended_model_are_those_of_the_model():
    """So that its excitation can be optimised: rows are taken without the columns of the extras."""
    forces = MachineForces(SOLIDS)
    extended = ExtendedForces(forces, ["stribeck"], stribeck_speed=0.02)
    motion = paper_motion(11)
    states = extended.from_coordinates(motion.pose, motion.velocity, motion.acceleration)
    own = forces.excess(states, forces.rows(states))
    assert extended.excess(states, extended.rows(states)) == pytest.approx(own, rel=1e-14)
    assert extended.excess(states) == pytest.approx(own, rel=1e-12)


FLAT = {"lamina": (0.004, 0.006, 0.01), "rod": (0.0, 0.01, 0.01)}
TURNS = {"along": np.eye(3), "turned": pin.rpy.rpyToMatrix(0.3, -0.8, 1.1)}


def with_inertia(rotation, diagonal):
    """A five-bar whose bodies have these moments about their mass centres."""
    loop = gallery("five_bar").copy()
    for i in range(1, loop.model.njoints):
        body, about = loop.model.inertias[i], rotation @ np.diag(diagonal) @ rotation.T
        loop.model.inertias[i] = pin.Inertia(body.mass, body.lever, (about + about.T) / 2)
    return loop


@pytest.mark.parametrize("solver", ["clarabel", "barrier"])
@pytest.mark.parametrize("rotation", TURNS.values(), ids=TURNS)
@pytest.mark.parametrize("diagonal", FLAT.values(), ids=FLAT)
def test_bodies_without_thickness_are_identified_as_possible_ones(rotation, diagonal, solver):
    """Moments that keep the triangle inequality with equality; the least eigenvalue of what is found."""
    if solver == "clarabel":
        pytest.importorskip("clarabel", reason="clarabel is not installed")
    loop = with_inertia(rotation, diagonal)
    forces, rng, home = LoopForces(loop), np.random.default_rng(1), loop.assemble().q
    motors = home[[loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]]
    values = motors + 0.2 * rng.normal(size=(30, 2)), rng.normal(size=(30, 2)), 5 * rng.normal(size=(30, 2))
    A, d = forces.rows(forces.from_coordinates(*values)).columns, forces.deviations()
    measured = A @ (forces.design + d * rng.normal(size=d.shape)) + rng.normal(0, 0.01, (30, 2))
    found = estimate_parameters(A, measured, forces.design, d, 0.01, names=forces.names, solver=solver)
    assert not any("no possible" in told for told in found.remarks)
    assert np.abs((found.parameters - forces.design) / np.where(d > 0, d, 1)).max() > 0.1
    for first in bodies_of(forces.names):
        about = pin.Inertia.FromDynamicParameters(found.parameters[first : first + 10]).inertia
        half = np.trace(about) / 2
        assert half - np.linalg.eigvalsh(about).max() > 0
    again = LoopForces(forces.corrected(found.parameters))
    np.testing.assert_allclose(
        again.design, found.parameters, rtol=0, atol=1e-12 * np.abs(found.parameters).max()
    )


def test_a_design_that_no_body_has_is_refused_before_anything_is_computed(monkeypatch):
    monkeypatch.setattr(validation, "prepare_log", lambda *_, **__: pytest.fail("it began"))
    loop = with_inertia(np.eye(3), (0.005, 0.005, 0.013))
    body = LoopForces(loop).names[0].rpartition(".")[0]
    with pytest.raises(InputError, match=f"no body has the mass, mass centre and inertia of {body} in the"):
        validation.identify(LoopForces(loop), None)
