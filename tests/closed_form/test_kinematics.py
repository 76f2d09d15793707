"""Kinematics: identities, finite differences, published closed forms, singular poses, every bad input."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from lagrange import BODIES, LagrangeModel
from machines import SEEDS, derivative, drops, random_machine, random_states

from p3dof._base import algebra
from p3dof._base.errors import InputError, ReachError
from p3dof.closed_form import kinematics
from p3dof.machine.parameters import PAPER, Geometry

G = PAPER.geometry
JOINTS = {
    "slide_a", "hinge_a", "slide_b", "hinge_b", "slide_c",
    "hinge_c", "hinge_left", "hinge_lower", "hinge_platform", "hinge_right",
}  # fmt: skip


def path(states, t):
    """Pose, velocity and acceleration at time t of the constant-acceleration motion through the states."""
    v, a = states.velocity, states.acceleration
    return states.pose + v * t + a * t**2 / 2, v + a * t, a


def test_home():
    motion = kinematics.mechanism_motion(G, np.zeros(3), np.zeros(3), np.zeros(3))
    assert set(motion.position) == JOINTS
    assert set(motion.bodies) == set(BODIES)
    for name, value in motion.position.items():
        assert abs(value) < 4e-16, name  # a rounding or two of lengths of 0.5 m
    for name, body in motion.bodies.items():
        if not name.startswith(("leg", "rod")):
            np.testing.assert_allclose(body.rotation, np.eye(3), rtol=0, atol=1e-15, err_msg=name)
    np.testing.assert_allclose(motion.bodies["platform"].origin, [0, 0, -G.h], rtol=0, atol=1e-16)
    np.testing.assert_allclose(motion.bodies["platform"].joint, [-G.r, 0, -G.h], rtol=0, atol=1e-16)
    np.testing.assert_allclose(motion.bodies["crossbar_lower"].joint, [-G.r, G.b, -G.h], rtol=0, atol=1e-16)


@settings(max_examples=100)
@given(SEEDS)
def test_closed_form_of_the_paper(seed):
    """The sliders of (6), printed as in the notes on the paper."""
    parameters = random_machine(seed)
    geometry = parameters.geometry
    pose = random_states(parameters, seed, 20).pose
    y, z, theta = pose.T
    r, R, L, h = geometry.r, geometry.R, geometry.L, geometry.h
    expected = np.column_stack(
        [
            z - h + np.sqrt(L**2 - (R - r + y) ** 2),
            z - h + np.sqrt(L**2 - (R - r - y) ** 2),
            z - h + r * np.sin(theta) + np.sqrt(L**2 - y**2 - (R - r * np.cos(theta)) ** 2),
        ]
    )
    sliders = kinematics.inverse_kinematics(geometry, pose).sliders
    np.testing.assert_allclose(sliders, expected, rtol=0, atol=3e-14 * L)


@settings(max_examples=200)
@given(SEEDS)
def test_forward_of_inverse_is_the_identity_in_the_working_mode(seed):
    parameters = random_machine(seed)
    pose = random_states(parameters, seed, 50).pose
    margin = kinematics.singularity(parameters.geometry, pose).actuation
    pose = pose[margin > 0]  # home's side of det J = 0
    sliders = kinematics.inverse_kinematics(parameters.geometry, pose).sliders
    back = kinematics.forward_kinematics(parameters.geometry, sliders)
    error = np.angle(np.exp(1j * (back[:, 2] - pose[:, 2])))
    L = parameters.geometry.L
    assert np.abs(back[:, :2] - pose[:, :2]).max(initial=0) <= 1e-12 * L
    # θ is a root that the singularity makes double: rounding grows with 1/margin
    assert np.all(np.abs(error) <= 1e-13 * L / parameters.geometry.r / margin[margin > 0])


@settings(max_examples=100)
@given(SEEDS)
def test_every_assembly_mode_closes_the_legs(seed):
    parameters = random_machine(seed)
    geometry = parameters.geometry
    pose = random_states(parameters, seed, 20).pose
    sliders = kinematics.inverse_kinematics(geometry, pose).sliders
    modes = kinematics.forward_kinematics(geometry, sliders, all_modes=True)
    assert modes.shape == (len(pose), 4, 3)
    same = np.abs(np.exp(1j * modes[..., 2]) - np.exp(1j * pose[:, None, 2])) + np.abs(
        modes[..., :2] - pose[:, None, :2]
    ).sum(axis=-1)
    assert np.all(np.nanmin(same, axis=1) < 1e-9 * max(1, geometry.L))  # the pose we came from is one of them
    y, p, theta = modes[..., 0], modes[..., 1] - geometry.h, modes[..., 2]
    a, b, c = (sliders[:, None, i] for i in range(3))
    r, R, d = geometry.r, geometry.R, geometry.R - geometry.r
    lengths = np.stack(
        [
            (a - p) ** 2 + (d + y) ** 2,
            (b - p) ** 2 + (d - y) ** 2,
            (c - p - r * np.sin(theta)) ** 2 + y**2 + (R - r * np.cos(theta)) ** 2,
        ]
    )
    real = np.isfinite(modes).all(axis=-1)
    assert np.abs(np.sqrt(lengths[:, real]) - geometry.L).max() < 1e-11 * geometry.L
    assert np.all(real.any(axis=1))


def test_paper_has_four_modes_at_home_and_the_working_one_is_first():
    modes = kinematics.forward_kinematics(G, [0.0, 0.0, 0.0], all_modes=True)
    assert np.isfinite(modes).all()
    np.testing.assert_allclose(modes[0], 0, rtol=0, atol=1e-15)
    assert len(np.unique(modes.round(9), axis=0)) == 4
    assert (modes[2:, 1] > 2 * G.h - 1e-9).all()  # platform above the sliders


def test_forward_kinematics_follows_theta_past_minus_pi_over_two():
    theta = np.linspace(-2.5, 1.04, 100)
    pose = np.column_stack([0 * theta, 0 * theta, theta])
    back = kinematics.forward_kinematics(G, kinematics.inverse_kinematics(G, pose).sliders)
    np.testing.assert_allclose(back, pose, rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(SEEDS)
def test_jacobian_against_finite_differences(seed):
    parameters = random_machine(seed)
    geometry = parameters.geometry
    pose = random_states(parameters, seed, 20, drop=0.2).pose
    size = np.array([geometry.L, geometry.L, 1])
    J = kinematics.inverse_jacobian(geometry, pose)
    for column in range(3):
        direction = np.eye(3)[column] * size[column]
        difference = derivative(
            lambda t, d=direction: kinematics.inverse_kinematics(geometry, pose + t * d).sliders, 0, 1e-4
        )
        np.testing.assert_allclose(
            J[..., column] * size[column], difference, rtol=5e-9, atol=5e-9 * geometry.L
        )


@settings(max_examples=50)
@given(SEEDS)
def test_jacobian_gives_slider_velocities_and_determinant(seed):
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 20)
    geometry = parameters.geometry
    motion = kinematics.mechanism_motion(geometry, states.pose, states.velocity, states.acceleration)
    J = kinematics.inverse_jacobian(geometry, states.pose)
    product = np.einsum("nij,nj->ni", J, states.velocity)
    np.testing.assert_allclose(motion.slider_velocities, product, rtol=1e-11, atol=1e-11 * geometry.L)
    determinant = kinematics.singularity(geometry, states.pose).determinant
    np.testing.assert_allclose(determinant, np.linalg.det(J), rtol=1e-9, atol=1e-12)


@settings(max_examples=40)
@given(SEEDS)
def test_velocities_and_accelerations_against_finite_differences(seed):
    """(8)-(15): joints and a random point and the axes of every body, against differences in time."""
    parameters = random_machine(seed)
    geometry = parameters.geometry
    states = random_states(parameters, seed, 10, drop=0.3)
    point = np.random.default_rng(seed).normal(0, geometry.L, 3)

    @cache
    def at(t):
        return kinematics.mechanism_motion(geometry, *path(states, t))

    now, step = at(0), 2e-4
    assert kinematics.closure_error(geometry, now).max() <= 1e-14 * geometry.L * 10
    for name in now.position:
        speed = derivative(lambda t, n=name: at(t).position[n], 0, step)
        rate = derivative(lambda t, n=name: at(t).velocity[n], 0, step)
        close(now.velocity[name], speed, name)
        close(now.acceleration[name], rate, name)
    for name, body in now.bodies.items():
        speed = derivative(lambda t, n=name: at(t).bodies[n].at(point)[0], 0, step)
        rate = derivative(lambda t, n=name: at(t).bodies[n].at(point)[1], 0, step)
        close(body.at(point)[1], speed, name)
        close(body.at(point)[2], rate, name)
        turn = derivative(lambda t, n=name: at(t).bodies[n].rotation, 0, step)
        spin = turn @ np.swapaxes(body.rotation, -1, -2)
        close(body.omega, np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1), name)
        close(body.epsilon, derivative(lambda t, n=name: at(t).bodies[n].omega, 0, step), name)
        joint = derivative(lambda t, n=name: at(t).bodies[n].joint, 0, step)
        close(body.velocity, joint, name)
        close(body.acceleration, derivative(lambda t, n=name: at(t).bodies[n].velocity, 0, step), name)


def close(exact, difference, name):
    scale = np.abs(exact).max() + 1
    assert np.abs(exact - difference).max() <= 2e-5 * scale, name


@settings(max_examples=50)
@given(SEEDS)
def test_bodies_stand_and_move_as_in_the_third_derivation(seed):
    parameters = random_machine(seed)
    geometry = parameters.geometry
    states = random_states(parameters, seed, 10)
    motion = kinematics.mechanism_motion(geometry, states.pose, states.velocity, states.acceleration)
    model = LagrangeModel(parameters)
    L = geometry.L
    np.testing.assert_allclose(motion.sliders, model.sliders(states.pose), rtol=0, atol=1e-13 * L)
    origins, turns = model.origins(states.pose), model.orientations(states.pose)
    omegas = model.angular_velocities(states.pose, states.velocity)
    centers = model.mass_center_velocities(states.pose, states.velocity)
    for i, name in enumerate(BODIES):
        body, com = motion.bodies[name], getattr(parameters.bodies, name).com
        np.testing.assert_allclose(body.origin, origins[:, i], rtol=0, atol=1e-13 * L, err_msg=name)
        np.testing.assert_allclose(body.rotation, turns[:, i], rtol=0, atol=2e-12, err_msg=name)
        scale = np.abs(omegas).max()
        np.testing.assert_allclose(body.omega, omegas[:, i], rtol=0, atol=1e-11 * scale, err_msg=name)
        velocity = body.at(com)[1]
        scale = np.abs(centers).max()
        np.testing.assert_allclose(velocity, centers[:, i], rtol=0, atol=1e-11 * scale, err_msg=name)


def test_slider_accelerations_are_the_third_derivations():
    states = random_states(PAPER, 3, 100)
    motion = kinematics.mechanism_motion(G, states.pose, states.velocity, states.acceleration)
    expected = LagrangeModel(PAPER).slider_accelerations(states.pose, states.velocity, states.acceleration)
    np.testing.assert_allclose(motion.slider_accelerations, expected, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize(("y", "theta"), [(0.0, 60.0), (0.1, 59.134), (-0.2, 55.943), (0.0, -146.44)])
def test_actuation_singularities_are_where_the_notes_say(y, theta):
    exact = np.degrees(np.arccos(G.R / (G.r + np.sqrt(G.L**2 - y**2))))
    found = kinematics.singularity(G, [y, 0.03, np.radians(theta)])
    assert abs(np.degrees(found.actuation)) < 6e-3
    assert abs(found.determinant) < 1e-4
    if theta > 0:
        assert exact == pytest.approx(theta, abs=6e-4)
        found = kinematics.singularity(G, [y, 0.03, np.radians(exact)])
        assert abs(found.actuation) < 1e-15  # some roundings of angles of 1 rad
        before = kinematics.singularity(G, [y, 0.03, np.radians(exact) - 1e-3])
        after = kinematics.singularity(G, [y, 0.03, np.radians(exact) + 1e-3])
        assert before.actuation > 0 > after.actuation


def test_determinant_at_home():
    assert kinematics.singularity(G, np.zeros(3)).determinant == pytest.approx(-0.0809039835, abs=1e-9)


def test_serial_margins():
    found = kinematics.singularity(G, [[0.25, 0, 0], [-0.24, 0, 0], [0, 0, np.radians(128.2)], [0.3, 0, 0]])
    assert found.serial[0, 0] == pytest.approx(0, abs=1e-16)
    assert found.serial[1] == pytest.approx([0.31, 0.01, 0.4 - np.hypot(0.24, 0.15)])
    assert np.all(found.serial[2] > 0)  # R = .25, r = .1 keep leg C in reach at y = 0 for every θ
    assert found.serial[3, 0] == pytest.approx(-0.05)
    assert np.isnan(found.determinant[3])
    assert np.isnan(found.actuation[3])
    lame = kinematics.singularity(G, [np.nan, 0, 0])
    assert np.isnan(lame.serial).all()


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(3))
def test_a_pose_with_one_number_that_is_none_has_no_margins(place, wrong):
    poses = np.zeros((2, 3))
    poses[1, place] = wrong
    found = kinematics.singularity(G, poses)
    for margin in (found.serial, found.actuation, found.determinant):
        assert np.isfinite(margin[0]).all()
        assert np.isnan(margin[1]).all()


def test_an_earlier_result_is_written_again():
    poses = np.array([[0.02, 0.03, 0.1], [-0.05, 0.1, -0.2]])
    expected = kinematics.inverse_kinematics(G, poses)
    out = kinematics.inverse_kinematics(G, np.zeros((2, 3)))
    assert kinematics.inverse_kinematics(G, poses, out=out) is out
    np.testing.assert_array_equal(out.sliders, expected.sliders)
    for name, angles in expected.angles.items():
        np.testing.assert_array_equal(out.angles[name], angles)
    with pytest.raises(InputError, match=r"out\.sliders: expected shape \(1, 3\), got \(2, 3\)"):
        kinematics.inverse_kinematics(G, poses[:1], out=out)


def test_out_of_reach_names_leg_margin_and_sample():
    poses = np.zeros((7, 3))
    poses[3, 0], poses[5, 0] = 0.26, -0.3
    with pytest.raises(ReachError, match=r"leg A is too short by 0\.01 m \(sample 3, the first of 2") as info:
        kinematics.inverse_kinematics(G, poses)
    assert info.value.leg == "a"
    assert info.value.margin == pytest.approx(-0.01)
    assert info.value.index == (3,)
    assert info.value.count == 2
    with pytest.raises(ReachError, match=r"leg B is too short by 0\.05 m$") as info:
        kinematics.inverse_jacobian(G, poses[5])
    assert info.value.index == ()
    assert info.value.leg == "b"


def test_leg_c_out_of_reach():
    geometry = Geometry(r=0.2, R=0.25, L=0.4)
    with pytest.raises(ReachError, match="leg C is too short by") as info:
        kinematics.inverse_kinematics(geometry, [[[0, 0, 0], [0, 0, 3.0]]])
    assert info.value.index == (0, 1)
    assert info.value.leg == "c"


def test_border_of_reach_is_out_of_reach_without_warnings():
    y = np.nextafter(G.L - (G.R - G.r), 0, dtype=float)
    for value in (y, G.L - (G.R - G.r)):
        with pytest.raises(ReachError):
            kinematics.inverse_kinematics(G, [value, 0, 0])
    kinematics.inverse_kinematics(G, [0.25 - 1e-12, 0, 0])


def test_nan_rows_leave_good_neighbours():
    poses = np.array([[0, 0, 0], [0.3, 0, 0], [np.nan, 0, 0], [0, np.inf, 0], [0.01, 0.02, 0.03]])
    good = [0, 4]
    result = kinematics.inverse_kinematics(G, poses, on_invalid="nan")
    np.testing.assert_array_equal(result.sliders[good], kinematics.inverse_kinematics(G, poses[good]).sliders)
    assert np.isnan(result.sliders[1:4]).all()
    J = kinematics.inverse_jacobian(G, poses, on_invalid="nan")
    assert np.isnan(J[1:4]).all()
    assert np.isfinite(J[good]).all()
    motion = kinematics.mechanism_motion(G, poses, [0.1, np.nan, 0], np.ones(3), on_invalid="nan")
    assert np.isnan(motion.sliders).all()  # a NaN velocity spoils every row that it is broadcast to
    velocity = np.zeros((5, 3))
    velocity[4, 1] = np.nan
    motion = kinematics.mechanism_motion(G, poses, velocity, np.ones(3), on_invalid="nan")
    assert np.isfinite(motion.bodies["platform"].acceleration[0]).all()
    for body in motion.bodies.values():
        assert np.isnan(body.origin[1:, 2]).all()
    sliders = np.array([[0, 0, 0], [0, 2.0, 0], [np.nan, 0, 0], [0.0, 0, 5]])
    back = kinematics.forward_kinematics(G, sliders, on_invalid="nan")
    assert np.isfinite(back[0]).all()
    assert np.isnan(back[1:]).all()
    modes = kinematics.forward_kinematics(G, sliders, all_modes=True, on_invalid="nan")
    assert np.isnan(modes[1:]).any(axis=(1, 2)).all()


@pytest.mark.parametrize(
    ("sliders", "leg", "words"),
    [
        ([0, 1.0, 0], "a", "A and B are too far apart for their legs by"),
        ([1.0, 0, 0], "b", "A and B are too far apart for their legs by"),
        ([0, 0, 2.0], "c", "leg C misses the platform by"),
        ([0.5, 0.0, 0.1], "b", "leg B would have to stand above its slider"),
    ],
)
def test_sliders_that_do_not_assemble(sliders, leg, words):
    with pytest.raises(ReachError, match=words) as info:
        kinematics.forward_kinematics(G, sliders)
    assert info.value.leg == leg
    assert info.value.margin < 0


def test_margin_of_leg_c_is_that_of_the_circle_it_misses():
    """Slider C below P: at y = 0 the rods (.4) and the platform's arm (.1) leave distances .3 to .5."""
    with pytest.raises(ReachError, match=r"leg C misses the platform by 0\.05 m") as info:
        kinematics.forward_kinematics(G, [0, 0, np.sqrt(0.25**2 - 0.25**2) - G.h])
    assert info.value.margin == pytest.approx(-0.05)
    with pytest.raises(ReachError) as info:
        kinematics.forward_kinematics(G, [0, 0, 0.6 - G.h])
    assert info.value.margin == pytest.approx(0.5 - np.hypot(0.6, 0.25))


def test_huge_sliders_do_not_assemble():
    with pytest.raises(ReachError):
        kinematics.forward_kinematics(G, [1e200, 0, 0])
    assert np.isnan(kinematics.forward_kinematics(G, [1e200, 0, 0], on_invalid="nan")).all()


def test_points_of_a_body_may_differ_between_samples():
    poses = random_states(PAPER, 1, 3).pose
    body = kinematics.mechanism_motion(G, poses, np.ones(3), np.ones(3)).bodies["platform"]
    points = np.arange(9.0).reshape(3, 3)
    for i in range(3):
        one = kinematics.mechanism_motion(G, poses[i], np.ones(3), np.ones(3)).bodies["platform"]
        for all_, single in zip(body.at(points), one.at(points[i]), strict=True):
            np.testing.assert_allclose(all_[i], single, rtol=1e-13)
    for bad in ("abc", [1.0, 2.0]):
        with pytest.raises(InputError, match="point: expected"):
            body.at(bad)


def test_no_mode_at_all():
    with pytest.raises(ReachError, match="too far apart"):
        kinematics.forward_kinematics(G, [0, 1.0, 0], all_modes=True)


@pytest.mark.parametrize("function", [kinematics.inverse_kinematics, kinematics.inverse_jacobian])
@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ([0, 0], r"pose: expected shape \(\.\.\., 3\), got \(2,\)"),
        (0.0, r"pose: expected shape \(\.\.\., 3\), got \(\)"),
        ([0, 0, "a"], "pose: expected real numbers"),
        ([0, 0, 1j], "pose: expected real numbers"),
        ([[0, 0], [1]], "pose: expected real numbers"),
        ([0, np.nan, 0], "pose: expected finite numbers"),
        ([[0, 0, 0], [0, np.inf, 0]], "sample 1, the first of 1 such of 2"),
    ],
)
def test_bad_poses(function, pose, words):
    with pytest.raises(InputError, match=words):
        function(G, pose)


def test_other_bad_input():
    with pytest.raises(InputError, match="on_invalid"):
        kinematics.inverse_kinematics(G, np.zeros(3), on_invalid="ignore")
    with pytest.raises(InputError, match="velocity: expected finite"):
        kinematics.mechanism_motion(G, np.zeros(3), [0, np.nan, 0], np.zeros(3))
    with pytest.raises(InputError, match="acceleration: expected finite"):
        kinematics.mechanism_motion(G, np.zeros(3), np.zeros(3), [0, np.nan, 0])
    with pytest.raises(InputError, match="expected shapes that fit each other"):
        kinematics.mechanism_motion(G, np.zeros((2, 3)), np.zeros((4, 3)), np.zeros(3))
    with pytest.raises(InputError, match="sliders: expected finite"):
        kinematics.forward_kinematics(G, [0, np.nan, 0])
    with pytest.raises(InputError, match="sliders: expected shape"):
        kinematics.forward_kinematics(G, [0, 0])


def test_leading_dimensions_and_empty_batches():
    poses = random_states(PAPER, 1, 24).pose.reshape(2, 3, 4, 3)
    result = kinematics.inverse_kinematics(G, poses)
    assert result.sliders.shape == (2, 3, 4, 3)
    one = kinematics.inverse_kinematics(G, poses[1, 2, 3])
    np.testing.assert_array_equal(result.sliders[1, 2, 3], one.sliders)
    for name, value in result.joints.items():
        assert value.shape == (2, 3, 4)
        assert value[1, 2, 3] == one.joints[name]
    assert kinematics.forward_kinematics(G, result.sliders).shape == (2, 3, 4, 3)
    motion = kinematics.mechanism_motion(G, poses, np.zeros(3), np.zeros(3))
    assert motion.bodies["rod_left"].rotation.shape == (2, 3, 4, 3, 3)
    empty = kinematics.inverse_kinematics(G, np.zeros((0, 3)))
    assert empty.sliders.shape == (0, 3)
    assert kinematics.forward_kinematics(G, np.zeros((0, 3))).shape == (0, 3)


def test_poses_of_the_helper_keep_their_distance():
    states = random_states(PAPER, 0, 1000)
    assert len(states.pose) == 1000
    assert drops(G, states.pose).min() >= 0.1


@pytest.mark.parametrize("a", [0, 1, -1, 3, 0.0, 2.5, np.array([1.5, -2.0])])
@pytest.mark.parametrize("b", [0, 1, -1, 3, 0.0, 2.5, np.array([0.5, 4.0])])
def test_arithmetic_that_skips_whole_numbers_is_arithmetic(a, b):
    np.testing.assert_array_equal(algebra.plus(a, b), a + b)
    np.testing.assert_array_equal(np.broadcast_to(algebra.times(a, b), np.shape(a * b)), a * b)
    for whole in (0, 1, -1):  # nothing is computed: the same object comes back
        assert algebra.times(whole, 0) == 0
    assert algebra.plus(a, 0) is a
    assert algebra.plus(0, b) is b
    assert algebra.times(1, b) is b
