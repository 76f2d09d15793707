"""The reduced form: the full recursion with a third of the operations, from 21 numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from lagrange import LagrangeModel
from machines import SEEDS, conditioning, derivative, random_machine, random_states, virtual_power_forces

import p3dof
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import MODEL, NAMES, OF_LENGTHS, all_kernels, is_symmetric, kernel
from p3dof.closed_form.compiled.reduced import SYMMETRIC_ZEROS, State, model_of
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import PAPER, Bodies, Body
from p3dof.methods.regressor import BASE, INERTIAL, force_regressor, inertial_parameters


def formulas(machine, states):
    """Forces, mass matrix and accelerations under these forces, by the plain formulas on arrays."""
    q, v, a = states.pose, states.velocity, states.acceleration
    model, state = model_of(machine), State(q[:, 0], q[:, 2], v[:, 0], v[:, 2], *a.T, q[:, 1])
    x = reduced.shape(model, state.y, state.theta, np)
    wrench = tuple(states.wrench[:, row] for row in WRENCH_ROWS)
    forces = reduced.actuator_forces(model, x, state, np, wrench)
    M = reduced.mass_matrix(model, x, state.y, np)
    M = np.stack([np.stack(np.broadcast_arrays(*row, state.y)[:3], axis=-1) for row in M], axis=-2)
    acceleration = reduced.forward_dynamics(model, x, state, forces, np, wrench)
    return np.stack(forces, axis=-1), M, np.stack(acceleration, axis=-1)


@given(seed=SEEDS)
@settings(max_examples=30, deadline=None)
def test_it_is_the_recursion_and_lagrange_for_bodies_without_any_symmetry(seed):
    machine = random_machine(seed)
    states = random_states(machine, seed, 20)
    forces, M, acceleration = formulas(machine, states)
    motion = states.pose, states.velocity, states.acceleration
    scale = 1e-12 * conditioning(machine.geometry, states.pose)[:, None] * np.abs(forces).max()
    assert np.all(np.abs(forces - virtual_power_forces(machine, *motion, states.wrench)) < scale)
    assert np.all(np.abs(forces - LagrangeModel(machine).forces(*motion, states.wrench)) < scale)
    np.testing.assert_allclose(
        M,
        p3dof.load(machine).mass_matrix(states.pose, method="virtual-power"),
        rtol=0,
        atol=1e-12 * np.abs(M).max(),
    )
    size = np.abs(states.acceleration).max()
    error = np.abs(acceleration - states.acceleration)
    assert np.all(error < 1e-9 * np.maximum(1, np.linalg.cond(M))[:, None] * size)


@pytest.mark.parametrize("machine", [p3dof.PAPER, p3dof.SOLIDS])
def test_the_papers_machines_need_the_smaller_kernels_only(machine):
    model = model_of(machine)
    assert is_symmetric(model)
    assert all(getattr(model.bodies, name) == 0 for name in SYMMETRIC_ZEROS)
    assert not is_symmetric(model_of(replace(machine, gravity=[0.1, 0, -9.8])))
    tilted = replace(machine.bodies, leg_b=Body(1.0, [0.2, 0, 0.01], np.eye(3) * 1e-2))
    assert not is_symmetric(model_of(replace(machine, bodies=tilted)))


def test_the_operations_are_as_few_as_the_readme_says():
    counts = {k.name: sum(k.operations().values()) for k in all_kernels()}
    assert counts["inverse_dynamics"] == 223
    assert counts["inverse_dynamics_symmetric"] == 141
    assert counts["forward_dynamics"] <= 1.3 * counts["inverse_dynamics"]
    assert counts["forward_dynamics_symmetric"] <= 1.4 * counts["inverse_dynamics_symmetric"]
    for name in ("inverse_dynamics", "inverse_dynamics_symmetric"):
        found = kernel("inverse_dynamics", name.endswith("symmetric"))
        assert found.operations()["div"] == 3
        assert set(found.operations()) <= {"add", "sub", "mul", "div", "sqrt", "sin", "cos"}
    assert len(counts) == 2 * len(NAMES) - len(OF_LENGTHS)


@given(seed=SEEDS)
@settings(max_examples=15, deadline=None)
def test_its_numbers_are_the_base_parameters(seed):
    """The forces are linear in them; they need all of them, and no more than the 100 of the bodies give."""
    machine = random_machine(seed)
    states = random_states(machine, seed, 300)
    motion = states.pose, states.velocity, states.acceleration
    forces = virtual_power_forces(machine, *motion)
    found = force_regressor(machine, states_of(*motion))
    phi = inertial_parameters(machine.bodies)
    assert len(BASE) == 21
    assert found.base.shape == (len(states.pose), 3, 21)
    assert found.inertial.shape == (len(states.pose), 3, len(INERTIAL))
    bound = 1e-11 * np.abs(forces).max()
    np.testing.assert_allclose(found.base @ found.base_parameters, forces, rtol=0, atol=bound)
    np.testing.assert_allclose(found.inertial @ phi, forces, rtol=0, atol=bound)
    np.testing.assert_allclose(
        found.base_matrix @ phi,
        found.base_parameters,
        rtol=0,
        atol=1e-13 * np.abs(found.base_matrix * phi).max(),
    )
    base = found.base.reshape(-1, len(BASE))
    singular = np.linalg.svd(base / np.linalg.norm(base, axis=0), compute_uv=False)
    assert singular[-1] > 1e-7 * singular[0]  # 21 are needed
    assert np.linalg.matrix_rank(found.base_matrix) == len(BASE)  # and all can be had


def test_the_regressor_of_the_recursion_has_the_same_rank():
    """Columns of the recursion itself, one body's parameter at a time: their rank is 21, not more."""
    machine = random_machine(11)
    states = random_states(machine, 11, 120)
    motion = states.pose, states.velocity, states.acceleration
    rng, links = np.random.default_rng(0), p3dof.machine.parameters.LINKS
    base = {name: Body(1.0, rng.normal(0, 0.1, 3), np.diag([1.0, 1.1, 1.2])) for name in links}
    reference = virtual_power_forces(replace(machine, bodies=Bodies(**base)), *motion).ravel()
    columns = []
    for name in links:
        for _ in range(10):  # ten random changes span a body's ten parameters
            other = Body(rng.uniform(0.5, 2), rng.normal(0, 0.1, 3), _inertia(rng))
            changed = replace(machine, bodies=Bodies(**{**base, name: other}))
            columns.append(virtual_power_forces(changed, *motion).ravel() - reference)
    A = np.array(columns).T
    singular = np.linalg.svd(A / np.linalg.norm(A, axis=0), compute_uv=False)
    assert singular[20] > 1e-9 * singular[0]
    assert singular[21] < 1e-12 * singular[0]


@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_derivatives_by_lengths_and_gravity(seed):
    machine = random_machine(seed)
    states = random_states(machine, seed, 10, drop=0.3, angle=0.3)
    motion = states.pose, states.velocity, states.acceleration
    found = force_regressor(machine, states_of(*motion))

    def stretched(name):
        def at(t):
            geometry = replace(machine.geometry, **{name: getattr(machine.geometry, name) + t})
            return virtual_power_forces(replace(machine, geometry=geometry), *motion)

        return at

    for index, name in enumerate("rRL"):
        expected = derivative(stretched(name), 0.0, 1e-4 * machine.geometry.r)
        np.testing.assert_allclose(
            found.by_lengths[..., index], expected, rtol=0, atol=1e-6 * np.abs(expected).max()
        )
    for axis in range(3):
        push = np.eye(3)[axis]
        expected = virtual_power_forces(replace(machine, gravity=machine.gravity + push), *motion)
        expected = expected - virtual_power_forces(machine, *motion)
        bound = 1e-11 * np.abs(virtual_power_forces(machine, *motion)).max()
        np.testing.assert_allclose(found.by_gravity[..., axis], expected, rtol=0, atol=bound)


def test_the_regressor_with_friction():
    """All its derivatives are those of the forces that the robot computes, friction included."""
    one = replace(PAPER, friction=p3dof.machine.Friction({"sliders": 20, "joints": 0.5}))
    found = force_regressor(one, states_of([0.05, 0.02, 0.3], [0.4, -0.3, 1.2], [0, 0, 0]))
    frictionless = force_regressor(PAPER, states_of([0.05, 0.02, 0.3], [0.4, -0.3, 1.2], [0, 0, 0]))
    assert np.abs(found.by_lengths - frictionless.by_lengths).max() > 50
    rich = p3dof.machine.Friction(
        {"sliders": 20, "joints": 0.5}, {"sliders": 5, "hinge_c": 0.4, "universal_a": 0.3}, 0.1
    )
    for machine in (one, replace(random_machine(7), friction=rich)):
        states = random_states(machine, 3, 12, drop=0.3, angle=0.3)
        motion = states.pose, states.velocity, states.acceleration
        robot = p3dof.load(machine)
        found = robot.force_regressor(*motion)

        def forces(motion=motion, robot=robot, **changed):
            return p3dof.load(replace(robot.parameters, **changed)).forces(*motion, method="pinocchio")

        size = np.abs(forces()).max()
        np.testing.assert_allclose(
            found.base @ found.base_parameters + found.friction, forces(), rtol=0, atol=1e-11 * size
        )
        assert np.abs(found.friction).max() > 1e-3 * size
        for index, name in enumerate("rRL"):

            def stretched(t, name=name, machine=machine, forces=forces):
                length = getattr(machine.geometry, name) + t
                return forces(geometry=replace(machine.geometry, **{name: length}))

            expected = derivative(stretched, 0.0, 1e-4 * machine.geometry.r)
            np.testing.assert_allclose(
                found.by_lengths[..., index], expected, rtol=0, atol=1e-6 * np.abs(expected).max()
            )
        for axis in range(3):
            expected = forces(gravity=machine.gravity + np.eye(3)[axis]) - forces()
            np.testing.assert_allclose(found.by_gravity[..., axis], expected, rtol=0, atol=1e-10 * size)
        heavier = machine.bodies.scaled(1.25)
        expected = forces(bodies=heavier) - forces()
        change = found.inertial @ (inertial_parameters(heavier) - inertial_parameters(machine.bodies))
        np.testing.assert_allclose(change, expected, rtol=0, atol=1e-10 * size)


def test_the_regressor_leaves_invalid_rows():
    machine = replace(PAPER, friction=p3dof.machine.Friction({"joints": 0.5}))
    poses = [[0.0, 0, 0], [0.3, 0, 0]]
    for one in (machine, PAPER):
        found = force_regressor(one, states_of(poses, np.ones(3), np.zeros(3), on_invalid="nan"))
        for array in (found.base, found.by_lengths, found.by_gravity, found.friction):
            assert np.isfinite(array[0]).all()
            assert np.isnan(array[1]).all()


def test_model_numbers_are_in_the_order_of_their_names():
    model = model_of(random_machine(5))
    assert len(MODEL) == len(model.numbers) == 36
    assert reduced.Model.of_numbers(model.numbers) == model


def _inertia(rng):
    points = rng.normal(0, 0.3, (6, 3))
    return sum(point @ point * np.eye(3) - np.outer(point, point) for point in points)
