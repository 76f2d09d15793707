"""The paper's method: against Lagrange, against the potential, symbolically, and with every bad input."""

from __future__ import annotations

from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from lagrange import LagrangeModel
from machines import SEEDS, conditioning, derivative, random_machine, random_states, virtual_power_forces

from p3dof._base.errors import InputError, ReachError, SingularityError
from p3dof._base.samples import ACTUATION_TOLERANCE
from p3dof.closed_form import kinematics
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.closed_form.paper.virtual_power import Wrench, actuator_forces
from p3dof.machine.parameters import PAPER, SOLIDS, Bodies, Body, Geometry
from p3dof.machine.parameters.body import Inertial

HOME = np.zeros(3)


@settings(max_examples=150)
@given(SEEDS)
def test_agrees_with_lagrange(seed):
    """Random machines without symmetry, of sizes over two decades; general bodies and gravity; a wrench."""
    parameters = random_machine(seed)
    s = random_states(parameters, seed, 20)
    ours = virtual_power_forces(parameters, s.pose, s.velocity, s.acceleration, s.wrench)
    expected = LagrangeModel(parameters).forces(s.pose, s.velocity, s.acceleration, s.wrench)
    largest = np.abs(expected).max(axis=-1)
    assert np.all(np.abs(ours - expected).max(axis=-1) <= 1e-10 * largest)


@settings(max_examples=100)
@given(SEEDS)
def test_agrees_with_lagrange_near_singular_poses(seed):
    """Nearer to the singularities rounding of the pose is amplified, and the tolerance with it."""
    parameters = random_machine(seed)
    near = {"drop": 0.1, "angle": 0.01}
    s = random_states(parameters, seed, 5, drop=0.005, angle=1e-5, near=near)
    ours = virtual_power_forces(parameters, s.pose, s.velocity, s.acceleration)
    expected = LagrangeModel(parameters).forces(s.pose, s.velocity, s.acceleration)
    allowed = 1e-12 * conditioning(parameters.geometry, s.pose) * np.abs(expected).max(axis=-1)
    assert np.all(np.abs(ours - expected).max(axis=-1) <= allowed)


@pytest.mark.parametrize("parameters", [PAPER, SOLIDS], ids=["paper", "solids"])
def test_static_forces_are_the_gradient_of_the_potential(parameters):
    """With V from the bodies' heights: Jᵀ f = ∂V/∂x, by central differences of V."""
    geometry = parameters.geometry
    pose = random_states(parameters, 5, 50, drop=0.5).pose  # where the differences are accurate

    def potential(poses):
        motion = kinematics.mechanism_motion(geometry, poses, HOME, HOME)
        return -sum(
            body.mass * motion.bodies[name].at(body.com)[0] @ parameters.gravity
            for name, body in parameters.bodies.items()
        )

    f = virtual_power_forces(parameters, pose, HOME, HOME)
    gradient = np.einsum("nij,ni->nj", kinematics.inverse_jacobian(geometry, pose), f)
    for j in range(3):
        axis = np.eye(3)[j]
        difference = derivative(lambda t, e=axis: potential(pose + t * e), 0, 2e-4)
        np.testing.assert_allclose(gradient[:, j], difference, rtol=0, atol=5e-9)


def test_weight_is_carried():
    f = virtual_power_forces(PAPER, [0.05, -0.02, 0.3], HOME, HOME)
    assert f.sum() == pytest.approx(PAPER.bodies.mass * 9.806, rel=1e-14)


@settings(max_examples=30)
@given(SEEDS)
def test_width_of_the_parallelogram_does_not_matter(seed):
    parameters = random_machine(seed)
    s = random_states(parameters, seed, 20)
    forces = [
        virtual_power_forces(
            replace(parameters, geometry=replace(parameters.geometry, b=b)),
            s.pose,
            s.velocity,
            s.acceleration,
        )
        for b in (0.001, 0.3)
    ]
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-11 * np.abs(forces[0]).max())


def test_axial_inertia_of_the_legs_does_not_matter():
    """Legs A and B turn about the axis x0 only: of J2 only the entry about the hinge enters."""
    other = Body.about(
        np.zeros(3), PAPER.bodies.leg_a.mass, PAPER.bodies.leg_a.com, [0.0004, 0.0524, 0.05235]
    )
    bodies = replace(PAPER.bodies, leg_a=other, leg_b=other)
    s = random_states(PAPER, 7, 50)
    forces = [
        virtual_power_forces(p, s.pose, s.velocity, s.acceleration)
        for p in (PAPER, replace(PAPER, bodies=bodies))
    ]
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-10)


def test_middle_entry_of_the_printed_j3_does_not_matter():
    """.0658 (about z0 of the platform) is doubtful in the paper, and cannot enter the forces."""
    platform = PAPER.bodies.platform
    other = Body(platform.mass, platform.com, platform.inertia + np.diag([0, 0, 0.007]))
    s = random_states(PAPER, 8, 50)
    forces = [
        virtual_power_forces(p, s.pose, s.velocity, s.acceleration)
        for p in (PAPER, replace(PAPER, bodies=replace(PAPER.bodies, platform=other)))
    ]
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-12)


def test_wrench_is_balanced_by_virtual_power():
    rng = np.random.default_rng(0)
    pose, wrench = np.array([0.07, -0.03, 0.4]), rng.normal(0, 10, 6)
    without, loaded = (virtual_power_forces(PAPER, pose, HOME, HOME, w) for w in (None, wrench))
    J = kinematics.inverse_jacobian(PAPER.geometry, pose)
    expected = -np.linalg.solve(J.T, [wrench[1], wrench[2], wrench[4]])  # power of F_y, F_z, M_y
    np.testing.assert_allclose(loaded - without, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("symbolic", ["casadi", pytest.param("sympy", marks=pytest.mark.slow)])
def test_symbols_run_through_the_same_formula(symbolic):
    """Traced with symbols for motion, lengths, bodies, gravity and wrench, and equal to the arrays."""
    parameters = random_machine(11)
    s = random_states(parameters, 11, 5)
    if symbolic == "casadi":
        symbols = casadi.vertsplit(casadi.SX.sym("x", 131))
        namespace = casadi
    else:
        sympy = pytest.importorskip("sympy")
        symbols = list(sympy.symbols("x:131"))
        namespace = sympy
    names = [name for name, _ in parameters.bodies.items()]
    take = iter(symbols)

    def vector():
        return (next(take), next(take), next(take))

    lengths = Lengths(*(next(take) for _ in range(5)))
    bodies = {}
    for name in names:
        mass, com, (xx, xy, xz), (yy, yz, zz) = next(take), vector(), vector(), vector()
        bodies[name] = Inertial(mass, com, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    gravity, pose, velocity, acceleration = vector(), vector(), vector(), vector()
    wrench = Wrench(vector(), vector())
    used = 5 + 10 * len(names) + 18
    assert used <= len(symbols)
    f = actuator_forces(lengths, bodies, gravity, pose, velocity, acceleration, namespace, wrench)
    if symbolic == "casadi":
        compiled = casadi.Function("f", [casadi.vertcat(*symbols[:used])], [casadi.vertcat(*f)])
        evaluate = lambda values: np.array(compiled(values)).ravel()  # noqa: E731
    else:
        compiled = sympy.lambdify(symbols[:used], f, modules="math", cse=True)
        evaluate = lambda values: np.array(compiled(*values))  # noqa: E731
    expected = virtual_power_forces(parameters, s.pose, s.velocity, s.acceleration, s.wrench)
    for i in range(len(s.pose)):
        values = [*Lengths.of(parameters.geometry)]
        for name in names:
            body = getattr(parameters.bodies, name)
            values += [body.mass, *body.com, *body.inertia[np.triu_indices(3)]]
        values += [*parameters.gravity, *s.pose[i], *s.velocity[i], *s.acceleration[i], *s.wrench[i]]
        np.testing.assert_allclose(evaluate(values), expected[i], rtol=0, atol=1e-11 * np.abs(expected).max())


def test_blocks_and_leading_dimensions_do_not_change_a_sample():
    s = random_states(PAPER, 2, 60)
    pose, velocity, acceleration = (
        np.tile(x, (150, 1)) for x in (s.pose, s.velocity, s.acceleration)
    )  # two blocks
    forces = virtual_power_forces(PAPER, pose, velocity, acceleration)
    one = virtual_power_forces(PAPER, s.pose, s.velocity, s.acceleration)
    np.testing.assert_allclose(forces, np.tile(one, (150, 1)), rtol=0, atol=1e-12)
    shaped = virtual_power_forces(PAPER, s.pose.reshape(3, 20, 3), s.velocity.reshape(3, 20, 3), np.zeros(3))
    assert shaped.shape == (3, 20, 3)
    assert virtual_power_forces(PAPER, np.zeros((0, 3)), HOME, HOME).shape == (0, 3)
    single = virtual_power_forces(PAPER, s.pose[0], s.velocity[0], s.acceleration[0])
    np.testing.assert_allclose(single, one[0], rtol=1e-14)


def test_singular_poses_raise_with_the_sample():
    theta = np.arccos(PAPER.geometry.R / (PAPER.geometry.r + PAPER.geometry.L))
    poses = np.zeros((3, 3))
    poses[1, 2] = theta
    with pytest.raises(SingularityError, match=r"actuation-singular.*sample 1, the first of 1") as info:
        virtual_power_forces(PAPER, poses, HOME, HOME)
    assert info.value.index == (1,)
    forces = virtual_power_forces(PAPER, poses, HOME, HOME, on_invalid="nan")
    assert np.isnan(forces[1]).all()
    assert np.isfinite(forces[[0, 2]]).all()
    with pytest.raises(SingularityError):
        virtual_power_forces(PAPER, [0, 0, theta - 0.5 * ACTUATION_TOLERANCE], HOME, HOME)
    assert np.isfinite(virtual_power_forces(PAPER, [0, 0, theta - 2 * ACTUATION_TOLERANCE], HOME, HOME)).all()
    near = virtual_power_forces(PAPER, [0, 0, theta - 1e-4], HOME, HOME)
    assert np.isfinite(near).all()
    assert np.abs(near).max() > 1e4  # unbounded toward the singularity


def test_unreachable_and_nan_rows():
    poses = np.zeros((4, 3))
    poses[1, 0], poses[2, 1] = 0.3, np.nan
    with pytest.raises(InputError, match="sample 2"):
        virtual_power_forces(PAPER, poses, HOME, HOME)
    with pytest.raises(ReachError, match="leg A"):
        virtual_power_forces(PAPER, poses[:2], HOME, HOME)
    wrench = np.zeros((4, 6))
    wrench[3, 5] = np.inf
    forces = virtual_power_forces(PAPER, poses, HOME, HOME, wrench, on_invalid="nan")
    assert np.isnan(forces[1:]).all()
    np.testing.assert_array_equal(forces[0], virtual_power_forces(PAPER, HOME, HOME, HOME))


def test_overflow_is_told():
    with pytest.raises(InputError, match="forces: expected finite"):
        virtual_power_forces(PAPER, np.zeros((2, 3)), [0, 0, 1e200], HOME)


@pytest.mark.parametrize(
    ("wrench", "words"),
    [
        (np.zeros(3), r"wrench: expected shape \(\.\.\., 6\)"),
        ([0, 0, np.nan, 0, 0, 0], "wrench: expected finite"),
        (np.zeros((5, 6)), r"wrench: expected shape \(2, 6\) or \(6,\), got \(5, 6\)"),
    ],
)
def test_bad_wrench(wrench, words):
    with pytest.raises(InputError, match=words):
        virtual_power_forces(PAPER, np.zeros((2, 3)), HOME, HOME, wrench)


def test_only_the_platform_carries_mass():
    """A point-like platform of 1 kg at P, everything else (nearly) massless: f = J⁻ᵀ m (ÿ, z̈ - g, 0)."""
    speck = Body(1e-12, np.zeros(3), np.zeros((3, 3)))
    point = Body(1.0, np.zeros(3), np.zeros((3, 3)))
    bodies = Bodies.alike(slider=speck, leg=speck, crossbar=Body.massless(), platform=point)
    parameters = replace(PAPER, bodies=bodies, geometry=Geometry())
    pose, velocity, acceleration = [0.1, 0.02, 0.5], [0.4, -0.3, 2.0], [3.0, -2.0, 9.0]
    f = virtual_power_forces(parameters, pose, velocity, acceleration)
    J = kinematics.inverse_jacobian(parameters.geometry, pose)
    np.testing.assert_allclose(f, np.linalg.solve(J.T, [3.0, -2.0 + 9.806, 0.0]), rtol=0, atol=1e-9)
