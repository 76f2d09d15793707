"""Inertial parameters from measured forces and the design: never worse than the design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from lagrange import LagrangeModel
from table_numbers import check_evidence, shows

import p3dof
from p3dof import ClosedLoopModel
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances import estimate_parameters, prior_deviations
from p3dof.machine.motion import paper_motion
from p3dof.machine.parameters import SOLIDS, Body
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


@shows("p3dof.analysis.tolerances.estimation.ParameterEstimate.residual")
def test_it_is_the_posterior_of_two_normal_distributions():
    """By the formulas of the text book with plain inverses: the problem is small and well conditioned."""
    rng = np.random.default_rng(5)
    A, truth, doubts = rng.normal(size=(12, 4)), rng.normal(size=4), np.array([0.5, 2.0, 0.1, 1.0])
    design, measured = truth + doubts * rng.normal(size=4), A @ truth + rng.normal(0, 0.3, 12)
    found = estimate_parameters(A.reshape(6, 2, 4), measured.reshape(6, 2), design, doubts, 0.3)
    precision = np.diag(doubts**-2) + A.T @ A / 0.3**2
    mean = np.linalg.solve(precision, design / doubts**2 + A.T @ measured / 0.3**2)
    np.testing.assert_allclose(found.parameters, mean, rtol=1e-12)
    np.testing.assert_allclose(found.deviations, np.sqrt(np.diag(np.linalg.inv(precision))), rtol=1e-12)
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
        ({"regressor": np.zeros(3)}, r"regressor: expected shape \(..., P\)"),
        ({"measured": np.zeros(5)}, r"measured: expected shape \(4,\), got \(5,\)"),
        ({"measured": [0, 0, np.nan, 0]}, "measured: expected finite numbers"),
        ({"prior": np.zeros(2)}, r"prior: expected shape \(3,\)"),
        ({"deviations": [1, -1, 1]}, "deviations: expected zero or more"),
        ({"noise": 0.0}, "noise: expected a positive number"),
    ],
)
def test_a_bad_argument_is_one_clear_error(change, words):
    given = {
        "regressor": np.zeros((4, 3)), "measured": np.zeros(4), "prior": np.zeros(3),
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
