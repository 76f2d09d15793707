"""Checks of the third derivation itself: closed loops, forces by hand, energy, bodies as point masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lagrange import BODIES, LagrangeModel, cloud_body, general_parameters, lagrange_forces, random_cloud
from numpy.polynomial import Polynomial

from p3dof.machine.parameters import PAPER, SOLIDS, Bodies, Body, Geometry, Parameters

PATH_Y = Polynomial([0, 0, -0.3, 1.3, -1])  # eq. (5)
PATH_Z = Polynomial([0, 0, -0.2, -0.2, 0.4])
FEATHER = Body(1e-30, np.zeros(3), np.zeros(3))  # only cross-bars may be without mass
AT = {name: index for index, name in enumerate(BODIES)}
MACHINES = {
    "paper": PAPER,
    "solids": SOLIDS,
    "general": general_parameters(7),
    "other": general_parameters(8),
}


def paper_motion(t):
    """Pose, velocity, acceleration (..., 3) of eq. (5)."""
    t = np.asarray(t, float)
    turn, rate = 4 * np.pi * t, 4 * np.pi
    theta = 0.4 * np.array([np.sin(turn), rate * np.cos(turn), -(rate**2) * np.sin(turn)])
    return tuple(
        np.stack([PATH_Y.deriv(order)(t), PATH_Z.deriv(order)(t), theta[order]], axis=-1)
        for order in range(3)
    )


def random_states(count, seed=1):
    rng = np.random.default_rng(seed)
    pose = rng.uniform(-1, 1, (count, 3)) * [0.12, 0.2, 0.6]
    return pose, rng.normal(0, 1, (count, 3)), rng.normal(0, 5, (count, 3))


def only(geometry=PAPER.geometry, gravity=PAPER.gravity, **bodies):
    """A machine whose other bodies weigh nothing."""
    return Parameters(geometry, Bodies(**(dict.fromkeys(BODIES, FEATHER) | bodies)), gravity=gravity)


@pytest.fixture(params=MACHINES, scope="module")
def model(request):
    return LagrangeModel(MACHINES[request.param])


# --- geometry ---------------------------------------------------------------------------------------------


def points_of(model, pose):
    """The geometry, and a function from (body, coordinates in its frame) to points in the fixed frame."""
    g = model.parameters.geometry
    origin, axes = model.origins(pose), model.orientations(pose)

    def point(body, *local):
        return origin[:, AT[body]] + axes[:, AT[body]] @ np.array(local)

    return g, point


def test_loops_close(model):
    pose = random_states(50)[0]
    g, point = points_of(model, pose)
    sliders = model.sliders(pose)
    for name, anchor, column in (("a", (0, -g.R), 0), ("b", (0, g.R), 1), ("c", (-g.R, 0), 2)):
        base = point(f"slider_{name}", 0, 0, 0)
        np.testing.assert_array_equal(base[:, :2], np.broadcast_to(anchor, (50, 2)))
        np.testing.assert_array_equal(base[:, 2], sliders[:, column])
    pairs = [
        (point("leg_a", 0, 0, 0), point("slider_a", 0, 0, 0)),
        (point("leg_a", g.L, 0, 0), point("platform", 0, -g.r, 0)),
        (point("leg_b", g.L, 0, 0), point("platform", 0, g.r, 0)),
        (point("rod_left", 0, 0, 0), point("crossbar_upper", 0, g.b, 0)),
        (point("rod_right", 0, 0, 0), point("crossbar_upper", 0, -g.b, 0)),
        (point("rod_left", g.L, 0, 0), point("crossbar_lower", 0, g.b, 0)),
        (point("rod_right", g.L, 0, 0), point("crossbar_lower", 0, -g.b, 0)),
        (point("crossbar_upper", 0, 0, 0), point("slider_c", 0, 0, 0)),
        (point("crossbar_lower", 0, 0, 0), point("platform", -g.r, 0, 0)),
    ]
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=0, atol=5e-16)
    np.testing.assert_allclose(
        point("platform", 0, 0, 0),
        np.stack([0 * pose[:, 0], pose[:, 0], pose[:, 1] - g.h], -1),
        rtol=0,
        atol=1e-16,
    )


def test_orientations(model):
    pose = random_states(50)[0]
    axes = model.orientations(pose)
    np.testing.assert_allclose(
        np.swapaxes(axes, -1, -2) @ axes, np.broadcast_to(np.eye(3), axes.shape), rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(np.linalg.det(axes), 1, rtol=0, atol=1e-15)
    hinge = axes[..., 1]
    np.testing.assert_array_equal(hinge[:, AT["leg_a"]], np.broadcast_to([1, 0, 0], (50, 3)))
    np.testing.assert_array_equal(hinge[:, AT["leg_b"]], np.broadcast_to([1, 0, 0], (50, 3)))
    assert np.all(hinge[:, AT["rod_left"], 0] > 0)
    for body in ("crossbar_upper", "crossbar_lower", "platform"):
        np.testing.assert_array_equal(hinge[:, AT[body]], np.broadcast_to([0, 1, 0], (50, 3)))
    for one, other in (("crossbar_upper", "crossbar_lower"), ("rod_left", "rod_right")):
        np.testing.assert_array_equal(axes[:, AT[one]], axes[:, AT[other]])
    # The rods turn on both cross-bars about the rods' hinge axis only, which is fixed in the bars.
    np.testing.assert_allclose(
        np.einsum("nji,nj->ni", axes[:, AT["crossbar_upper"]], hinge[:, AT["rod_left"]]),
        np.broadcast_to(model.orientations(np.zeros(3))[AT["rod_left"], :, 1], (50, 3)),
        rtol=0,
        atol=1e-15,
    )


def test_home(model):
    np.testing.assert_allclose(model.sliders(np.zeros(3)), 0, rtol=0, atol=1e-16)
    axes = model.orientations(np.zeros(3))
    for body in set(BODIES) - {"leg_a", "leg_b", "rod_left", "rod_right"}:
        np.testing.assert_allclose(axes[AT[body]], np.eye(3), rtol=0, atol=1e-16)


def test_velocities_are_rates(model):
    pose, velocity, acceleration = random_states(20)
    step = 1e-6

    def difference(function, *later):
        """Central difference along the motion through each state."""
        ahead, behind = (
            function(*(x + sign * step * v for x, v in zip((pose, velocity), later, strict=False)))
            for sign in (1, -1)
        )
        return (ahead - behind) / (2 * step)

    close = {"rtol": 1e-8, "atol": 2e-8}
    np.testing.assert_allclose(
        model.slider_velocities(pose, velocity), difference(model.sliders, velocity), **close
    )
    np.testing.assert_allclose(
        model.slider_accelerations(pose, velocity, acceleration),
        difference(model.slider_velocities, velocity, acceleration),
        **close,
    )
    np.testing.assert_allclose(
        model.mass_center_velocities(pose, velocity), difference(model.mass_centers, velocity), **close
    )
    turning = np.cross(
        model.angular_velocities(pose, velocity)[..., None, :], np.swapaxes(model.orientations(pose), -1, -2)
    )
    np.testing.assert_allclose(
        np.swapaxes(turning, -1, -2), difference(model.orientations, velocity), **close
    )


# --- energy -----------------------------------------------------------------------------------------------


def test_kinetic_energy_is_quadratic_and_positive(model):
    pose, velocity, _ = random_states(50)
    M, T = model.mass_matrix(pose), model.kinetic_energy(pose, velocity)
    np.testing.assert_allclose(M, np.swapaxes(M, -1, -2), rtol=0, atol=1e-14)
    assert np.linalg.eigvalsh(M).min() > 0
    assert np.all(model.body_kinetic_energies(pose, velocity) >= 0)
    np.testing.assert_allclose(T, np.einsum("ni,nij,nj->n", velocity, M, velocity) / 2, rtol=1e-13)
    np.testing.assert_allclose(model.kinetic_energy(pose, -3 * velocity), 9 * T, rtol=1e-13)


def test_power_balance(model):
    """d(T + V)/dt = f·λ̇ + F·Ṗ + M·ω, the left side by differences along the motion."""
    pose, velocity, acceleration = random_states(20)
    wrench = np.random.default_rng(3).normal(0, 10, (20, 6))
    forces = model.forces(pose, velocity, acceleration, wrench)
    assert np.all(np.isfinite(forces))
    power = (forces * model.slider_velocities(pose, velocity)).sum(-1)
    power += wrench[:, 1] * velocity[:, 0] + wrench[:, 2] * velocity[:, 1] + wrench[:, 4] * velocity[:, 2]
    step = 1e-5
    before, after = (
        model.energy(pose + s * velocity + s * s / 2 * acceleration, velocity + s * acceleration)
        for s in (-step, step)
    )
    np.testing.assert_allclose(power, (after - before) / (2 * step), rtol=1e-6, atol=1e-5)


def test_forward_dynamics_inverts(model):
    pose, velocity, acceleration = random_states(20)
    wrench = np.linspace(-5, 5, 6)
    forces = model.forces(pose, velocity, acceleration, wrench)
    np.testing.assert_allclose(
        model.accelerations(pose, velocity, forces, wrench), acceleration, rtol=1e-9, atol=1e-10
    )


# --- forces -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parameters", [PAPER, SOLIDS], ids=["paper", "solids"])
def test_static_forces_carry_the_weight(parameters):
    """∂λ/∂z = 1 for all three sliders, so their forces sum to the weight; A and B are alike at y = 0."""
    forces = lagrange_forces(parameters, [[0, 0, 0], [0, 0.1, 0.3], [0.1, 0, -0.2]], np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(forces.sum(-1), 9.806 * parameters.bodies.mass, rtol=1e-14)
    np.testing.assert_allclose(forces[:2, 0], forces[:2, 1], rtol=1e-14)


def test_forces_sum_to_the_rate_of_vertical_momentum(model):
    pose, velocity, acceleration = random_states(20)
    masses = np.array([getattr(model.parameters.bodies, name).mass for name in BODIES])
    step = 1e-5
    before, after = (
        model.mass_center_velocities(
            pose + s * velocity + s * s / 2 * acceleration, velocity + s * acceleration
        )
        for s in (-step, step)
    )
    vertical = ((after - before) / (2 * step))[..., 2] - model.parameters.gravity[2]  # (N, bodies)
    np.testing.assert_allclose(
        model.forces(pose, velocity, acceleration).sum(-1), vertical @ masses, rtol=1e-6, atol=1e-5
    )


def test_platform_alone_by_hand():
    """Newton-Euler of the platform, and Jᵀ f = Q solved on paper: only C resists turning."""
    g, gravity = PAPER.geometry, np.array([1.5, -2.5, -9.0])
    mass, (cx, cz), Iyy = 8.0, (-0.03, 0.02), 0.05
    inertia = np.array([[0.06, 0.002, 0.001], [0.002, Iyy, 0.003], [0.001, 0.003, 0.07]])
    parameters = only(platform=Body(mass, np.array([cx, 0.01, cz]), inertia), gravity=gravity)
    pose, velocity, acceleration = random_states(20)
    wrench = np.random.default_rng(5).normal(0, 10, (20, 6))
    y, _, theta = pose.T
    rate, (ay, az, aa) = velocity[:, 2], acceleration.T
    sin, cos = np.sin(theta), np.cos(theta)
    dx, dz = cx * cos + cz * sin, cz * cos - cx * sin  # mass centre from P
    Fx = mass * (aa * dz - rate**2 * dx - gravity[0])
    Fy = mass * (ay - gravity[1])
    Fz = mass * (az - aa * dx - rate**2 * dz - gravity[2])
    moment = Iyy * aa + dz * Fx - dx * Fz - wrench[:, 4]
    Fy, Fz = Fy - wrench[:, 1], Fz - wrench[:, 2]
    wa, wb, wc = g.R - g.r + y, g.R - g.r - y, g.R - g.r * cos
    sa, sb, sc = (np.sqrt(g.L**2 - w**2) for w in (wa, wb, np.hypot(wc, y)))
    C = moment / (g.r * cos - wc * g.r * sin / sc)  # θ: only leg C
    # z: A + B = Fz - C,  y: -A wa/sa + B wb/sb = Fy + C y/sc
    A = ((Fz - C) * wb / sb - Fy - C * y / sc) / (wa / sa + wb / sb)
    B = Fz - C - A
    forces = lagrange_forces(parameters, pose, velocity, acceleration, wrench)
    np.testing.assert_allclose(forces, np.stack([A, B, C], -1), rtol=1e-11, atol=1e-11)


def test_slider_alone_by_hand():
    pose, velocity, acceleration = random_states(20)
    for column, name in enumerate(("slider_a", "slider_b", "slider_c")):
        slider = Body(1.7, np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.25]))
        model = LagrangeModel(only(**{name: slider}))
        expected = np.zeros((20, 3))
        expected[:, column] = 1.7 * (
            model.slider_accelerations(pose, velocity, acceleration)[:, column] + 9.806
        )
        np.testing.assert_allclose(
            model.forces(pose, velocity, acceleration), expected, rtol=1e-11, atol=1e-11
        )


def test_leg_alone_by_hand():
    """Leg A on a carriage held by A: Q from its angle φ from the vertical, w = R - r + y = L sin φ."""
    g = PAPER.geometry
    mass, (cx, cz), Iyy = 2.0, (0.15, 0.04), 0.03
    leg = Body(mass, np.array([cx, -0.02, cz]), np.array([0.02, Iyy, 0.03]))
    y, v, a = 0.07, 0.8, -3.0
    L, w = g.L, g.R - g.r + y
    phi, drop = np.arcsin(w / L), np.sqrt(L**2 - w**2)
    turn = v / drop  # φ̇ = ẏ / (L cos φ)
    spin = a / drop + turn**2 * w / drop
    along, across = (
        np.array([np.sin(phi), -np.cos(phi)]),
        np.array([-np.cos(phi), -np.sin(phi)]),
    )  # y, z of axes
    lift = 0.9 + spin * -L * np.sin(phi) - turn**2 * L * np.cos(phi)  # λ̈ = z̈ + d²(L cos φ)/dt²
    force = mass * (
        np.array([0, lift + 9.806]) + spin * (cz * along - cx * across) - turn**2 * (cx * along + cz * across)
    )
    about = Iyy * spin + (cz * along - cx * across) @ force  # moment about A2, on φ
    # δλ = δz - δy w/S, δφ = δy/S: Q = (force_z, about/S - force_z w/S, 0), and Jᵀ f = Q with f_C = 0
    Qy, Qz = about / drop - force[1] * w / drop, force[1]
    wb = g.R - g.r - y
    tan, tan_b = w / drop, wb / np.sqrt(L**2 - wb**2)
    A = (Qz * tan_b - Qy) / (tan + tan_b)
    forces = lagrange_forces(only(leg_a=leg), [y, 0.05, 0.2], [v, 0.3, 1.0], [a, 0.9, 2.0])
    np.testing.assert_allclose(forces, [A, Qz - A, 0], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", BODIES)
def test_inertia_is_that_of_points(name):
    """Forces are linear in the distribution of mass: a body of point masses, or each of them on its own."""
    masses, positions = random_cloud(np.random.default_rng(11))
    general = general_parameters(12)
    state = random_states(10)

    def forces(body):
        return lagrange_forces(only(general.geometry, general.gravity, **{name: body}), *state)

    points = [forces(Body(m, p, np.zeros(3))) for m, p in zip(masses, positions, strict=True)]
    np.testing.assert_allclose(forces(cloud_body(masses, positions)), sum(points), rtol=1e-9, atol=1e-9)


def test_points_where_bodies_meet_are_alike():
    g, state = PAPER.geometry, random_states(10)

    def forces(name, *com):
        return lagrange_forces(only(**{name: Body(3.0, np.array(com, float), np.zeros(3))}), *state)

    meetings = [
        (("slider_a", 0, 0, 0), ("leg_a", 0, 0, 0)),
        (("slider_b", 0, 0, 0), ("leg_b", 0, 0, 0)),
        (("slider_c", 0, 0, 0), ("crossbar_upper", 0, 0, 0)),
        (("leg_a", g.L, 0, 0), ("platform", 0, -g.r, 0)),
        (("leg_b", g.L, 0, 0), ("platform", 0, g.r, 0)),
        (("crossbar_upper", 0, g.b, 0), ("rod_left", 0, 0, 0)),
        (("crossbar_upper", 0, -g.b, 0), ("rod_right", 0, 0, 0)),
        (("crossbar_lower", 0, g.b, 0), ("rod_left", g.L, 0, 0)),
        (("crossbar_lower", 0, -g.b, 0), ("rod_right", g.L, 0, 0)),
        (("crossbar_lower", 0, 0, 0), ("platform", -g.r, 0, 0)),
    ]
    for one, other in meetings:
        np.testing.assert_allclose(forces(*one), forces(*other), rtol=1e-10, atol=1e-10)


# By d'Alembert's principle in 50 digits, geometry by joint angles, neither ω nor T; at t = 0, .25, .5, 1 s.
FIFTY_DIGITS = {
    "paper": [
        [52.214118599057, 37.539530238273, 49.373542979948],
        [38.362392716100, 51.395207097736, 49.375768777323],
        [34.646202175321, 60.478323064278, 52.443720437735],
        [118.49801831770, 1.1013114314256, 66.451484209652],
    ],
    "solids": [
        [52.394306928126, 37.359907896475, 53.733698668453],
        [38.200784273688, 51.557381598297, 53.736203462500],
        [34.354172943440, 60.770948029026, 57.072064525016],
        [119.93761188741, -0.33758036579973, 72.252413999754],
    ],
}


@pytest.mark.parametrize("name", FIFTY_DIGITS)
def test_paper_motion_in_fifty_digits(name):
    forces = lagrange_forces(MACHINES[name], *paper_motion([0, 0.25, 0.5, 1]))
    np.testing.assert_allclose(forces, FIFTY_DIGITS[name], rtol=1e-12, atol=1e-12)


def test_width_and_exchange_of_rods_have_no_effect():
    general = general_parameters(13)
    state = random_states(20)
    forces = lagrange_forces(general, *state)
    g, bodies = general.geometry, general.bodies
    wider = replace(general, geometry=Geometry(g.r, g.R, g.L, b=3 * g.b))
    swapped = replace(general, bodies=replace(bodies, rod_left=bodies.rod_right, rod_right=bodies.rod_left))
    for variant in (wider, swapped):
        np.testing.assert_allclose(lagrange_forces(variant, *state), forces, rtol=1e-11, atol=1e-11)
    heavier = replace(bodies, rod_left=replace(bodies.rod_left, mass=2 * bodies.rod_left.mass))
    changed = lagrange_forces(replace(general, bodies=heavier), *state)
    assert np.abs(changed - forces).max() > 0.1


def test_mirror_image_exchanges_a_and_b():
    """Reflection at the plane y = 0 holds for bodies alike on both sides."""
    pose, velocity, acceleration = random_states(20)
    mirror = np.array([-1, 1, 1])
    forces = lagrange_forces(SOLIDS, pose, velocity, acceleration)
    image = lagrange_forces(SOLIDS, mirror * pose, mirror * velocity, mirror * acceleration)
    np.testing.assert_allclose(image[:, [1, 0, 2]], forces, rtol=1e-11, atol=1e-11)


def test_leading_dimensions_broadcast():
    pose, velocity, acceleration = (x.reshape(2, 3, 3) for x in random_states(6))
    model = LagrangeModel(PAPER)
    forces = model.forces(pose, velocity[0], acceleration[1, 2])
    assert forces.shape == (2, 3, 3)
    one = model.forces(pose[1, 0], velocity[0, 0], acceleration[1, 2])
    np.testing.assert_allclose(forces[1, 0], one, rtol=1e-13)
    assert model.energy(pose, velocity).shape == (2, 3)
    assert model.energy(pose[0, 0], velocity[0, 0]).shape == ()
    assert model.orientations(pose).shape == (2, 3, 10, 3, 3)


def test_paper_motion_is_consistent():
    """The rates of eq. (5) used here are the derivatives of its poses."""
    t, step = np.linspace(0, 1, 11), 1e-6
    for order in (0, 1):
        slope = (paper_motion(t + step)[order] - paper_motion(t - step)[order]) / (2 * step)
        np.testing.assert_allclose(slope, paper_motion(t)[order + 1], atol=1e-7)
    np.testing.assert_allclose(
        paper_motion(0.5)[0][:2], [-0.25 * (0.25 - 0.65 + 0.3), -0.05], rtol=0, atol=1e-16
    )
