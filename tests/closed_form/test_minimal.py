"""The equations of motion in y, z, θ: against Lagrange, their structure, and forward of inverse dynamics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from lagrange import LagrangeModel
from machines import SEEDS, derivative, random_machine, random_states

import p3dof
from p3dof._base.errors import InputError, ReachError
from p3dof.machine.parameters import PAPER

HOME = np.zeros(3)
METHODS = ("virtual-power", "pinocchio")


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@settings(max_examples=25)
@given(SEEDS)
def test_terms_are_those_of_lagrange(seed):
    parameters = random_machine(seed)
    machine, model = p3dof.load(parameters), LagrangeModel(parameters)
    s = random_states(parameters, seed, 10)
    rest = np.zeros_like(s.pose)
    M = machine.mass_matrix(s.pose, method="virtual-power")
    np.testing.assert_allclose(M, model.mass_matrix(s.pose), rtol=0, atol=1e-12 * np.abs(M).max())
    still = model.generalized_forces(s.pose, rest, rest)
    g = machine.gravity_forces(s.pose)
    np.testing.assert_allclose(g, still, rtol=0, atol=1e-12 * np.abs(still).max())
    moving = model.generalized_forces(s.pose, s.velocity, rest) - still
    C = machine.coriolis_matrix(s.pose, s.velocity)
    found = np.einsum("nij,nj->ni", C, s.velocity)
    np.testing.assert_allclose(found, moving, rtol=0, atol=1e-11 * np.abs(moving).max())


@settings(max_examples=40)
@given(SEEDS)
def test_mass_matrix_is_symmetric_and_positive_definite(seed):
    parameters = random_machine(seed)
    M = p3dof.load(parameters).mass_matrix(random_states(parameters, seed, 20).pose, method="virtual-power")
    np.testing.assert_array_equal(M, np.swapaxes(M, -1, -2))
    assert np.linalg.eigvalsh(M).min() > 0


@settings(max_examples=30)
@given(SEEDS)
def test_rate_of_m_less_2c_is_skew(seed):
    """Ṁ by differences along the motion; C from Christoffel's symbols by complex steps."""
    parameters = random_machine(seed)
    machine = p3dof.load(parameters)
    s = random_states(parameters, seed, 10, drop=0.3)
    M_dot = derivative(
        lambda t: machine.mass_matrix(s.pose + t * s.velocity, method="virtual-power"), 0, 1e-4
    )
    N = M_dot - 2 * machine.coriolis_matrix(s.pose, s.velocity)
    assert np.abs(N + np.swapaxes(N, -1, -2)).max() <= 1e-7 * np.abs(M_dot).max()


@settings(max_examples=20)
@given(SEEDS)
def test_forward_of_inverse_dynamics_is_the_identity(seed):
    parameters = random_machine(seed)
    machine = p3dof.load(parameters)
    s = random_states(parameters, seed, 4)
    forces = machine.forces(s.pose, s.velocity, s.acceleration, method="virtual-power", wrench=s.wrench)
    for method in METHODS:
        found = machine.forward_dynamics(s.pose, s.velocity, forces, method=method, wrench=s.wrench)
        scale = (
            np.abs(s.acceleration).max()
            * np.linalg.cond(machine.mass_matrix(s.pose, method="virtual-power")).max()
        )
        assert np.abs(found - s.acceleration).max() <= 1e-13 * scale + 1e-10 * np.abs(s.acceleration).max()


def test_both_methods_agree_over_the_papers_motion(robot):
    m = p3dof.paper_motion(101)
    forces = robot.forces(m.pose, m.velocity, m.acceleration, method="virtual-power")
    for method in METHODS:
        found = robot.forward_dynamics(m.pose, m.velocity, forces, method=method)
        assert np.abs(found - m.acceleration).max() <= 1e-10 * np.abs(m.acceleration).max()


def test_published_mass_matrix_at_home(robot):
    """Entries at home of the third derivation, in fifty digits there."""
    M = robot.mass_matrix(HOME, method="virtual-power")
    np.testing.assert_allclose(np.diag(M), [9.893605454545, 15.0038, 0.048402604641], rtol=1e-11)
    assert M[1, 2] == pytest.approx(0.546163023205, rel=1e-11)


def test_free_fall_from_home(robot):
    """Without forces the whole machine falls: no leg turns."""
    for method in METHODS:
        np.testing.assert_allclose(
            robot.forward_dynamics(HOME, HOME, HOME, method=method), [0, -9.806, 0], rtol=0, atol=1e-12
        )


def test_power_is_the_rate_of_the_energy(robot):
    model = LagrangeModel(PAPER)
    s = random_states(PAPER, 9, 20, drop=0.3)
    forces = np.random.default_rng(0).normal(50, 20, (20, 3))
    a = robot.forward_dynamics(s.pose, s.velocity, forces, method="virtual-power")

    def energy(t):
        return model.energy(s.pose + t * s.velocity + t**2 / 2 * a, s.velocity + t * a)

    power = np.sum(
        forces * np.einsum("nij,nj->ni", robot.jacobian(s.pose, method="virtual-power"), s.velocity), axis=-1
    )
    np.testing.assert_allclose(derivative(energy, 0, 1e-4), power, rtol=0, atol=1e-6 * np.abs(power).max())


def test_the_actuation_singularity_is_no_obstacle(robot):
    pose = [0, 0, np.pi / 3]
    found = [robot.forward_dynamics(pose, [0.1, 0.2, 0.3], [40, 50, 60], method=m) for m in METHODS]
    np.testing.assert_allclose(*found, rtol=1e-9)


def test_batches_nan_rows_and_bad_input(robot):
    poses = np.zeros((2, 3, 3))
    poses[1, 1, 0], poses[0, 2, 1] = 0.3, np.nan
    for method in METHODS:
        found = robot.forward_dynamics(poses, HOME, HOME, method=method, on_invalid="nan")
        assert np.isfinite(found).all(axis=-1).tolist() == [[True, True, False], [True, False, True]]
        with pytest.raises(ReachError, match="leg A"):
            robot.forward_dynamics(poses[1], HOME, HOME, method=method)
        with pytest.raises(InputError, match="forces: expected finite"):
            robot.forward_dynamics(HOME, HOME, [0, np.inf, 0], method=method)
        with pytest.raises(InputError, match="expected shape"):
            robot.forward_dynamics(HOME, HOME, [0, 0], method=method)
        with pytest.raises(InputError, match="expected"):
            robot.forward_dynamics(np.zeros((2, 3)), HOME, np.zeros((5, 3)), method=method)
        with pytest.raises(InputError, match="wrench"):
            robot.forward_dynamics(HOME, HOME, HOME, method=method, wrench=np.zeros(3))
    assert np.isnan(robot.mass_matrix(poses, on_invalid="nan", method="virtual-power")[1, 1]).all()
    assert np.isnan(robot.coriolis_matrix(poses, HOME, on_invalid="nan")[0, 2]).all()
    assert np.isnan(robot.gravity_forces(poses, on_invalid="nan")[1, 1]).all()
    for call in (robot.mass_matrix, robot.gravity_forces):
        with pytest.raises(ReachError):
            call(poses[1])
    with pytest.raises(InputError, match="method"):
        robot.forward_dynamics(HOME, HOME, HOME, method="newton")
    assert robot.forward_dynamics(np.zeros((0, 3)), HOME, HOME, method="virtual-power").shape == (0, 3)
