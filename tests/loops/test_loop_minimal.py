"""Equations of motion of any robot in independent coordinates, and Jacobians from them to frames."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from loop_motions import ROBOTS, biped, five_bar, index_of, motion, moved, stewart
from mujoco_robots import in_mujoco

import p3dof
from p3dof import ClosedLoopModel, InputError, JointData, Sidecar
from p3dof._base.errors import SingularityError


def moving(name: str) -> tuple[ClosedLoopModel, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    loop, q = ROBOTS[name]()
    n = loop.mobility(q)
    speeds, accelerations = np.random.default_rng(2).normal(size=(2, n))
    return (
        loop,
        q,
        *motion(loop, q, index_of(loop, loop.coordinates(q)), speeds, accelerations),
        accelerations,
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_the_coriolis_matrix_is_that_of_the_mass_matrix(name):
    """Ṁ - 2 C is skew-symmetric, Ṅ is the rate of N, C ẏ is what Lagrange's equations say."""
    loop, q, v, _, _ = moving(name)
    at = loop.minimal_dynamics(q, v)

    def there(t: float) -> p3dof.loops.MinimalDynamics:
        return loop.minimal_dynamics(moved(loop, q, t * v), None, at.coordinates)

    M_dot, _ = robots.differences(lambda t: there(t).mass_matrix, h=1e-3)
    N_dot, _ = robots.differences(lambda t: there(t).motion, h=1e-3)
    S = M_dot - 2.0 * at.coriolis_matrix
    np.testing.assert_allclose(S, -S.T, rtol=0, atol=1e-9 * np.abs((M_dot, at.mass_matrix)).max())
    np.testing.assert_allclose(at.motion_rate, N_dot, rtol=0, atol=1e-9 * max(1.0, np.abs(N_dot).max()))
    np.testing.assert_allclose(at.motion @ at.speeds, v, rtol=0, atol=1e-10 * np.abs(v).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_energies_are_those_of_the_bodies(name):
    loop, q, v, _, _ = moving(name)
    at, energies = loop.minimal_dynamics(q, v), loop.body_energies(q, v)
    kinetic = at.speeds @ at.mass_matrix @ at.speeds / 2
    assert kinetic == pytest.approx(np.sum(energies.kinetic), rel=1e-10)
    still = np.zeros(loop.model.nv)
    gradient = [
        robots.differences(
            lambda t, d=d: np.sum(loop.body_energies(moved(loop, q, t * d), still).potential), h=1e-3
        )[0]
        for d in at.motion.T
    ]
    np.testing.assert_allclose(at.gravity_forces, gradient, rtol=0, atol=1e-8 * np.abs(gradient).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_the_equations_of_motion_hold(name):
    loop, q, v, a, accelerations = moving(name)
    frame = loop.model.frames[loop.model.nframes - 1].name
    load = {str(frame): np.arange(1.0, 7.0)} if name == "biped in the air" else {}
    at = loop.minimal_dynamics(q, v, external=load)
    np.testing.assert_allclose(
        at.motion @ accelerations + at.motion_rate @ at.speeds, a, rtol=0, atol=1e-9 * np.abs(a).max()
    )
    tau = np.random.default_rng(7).normal(size=len(loop.actuated))
    right = at.actuation @ tau + at.passive_forces + at.external_forces
    found = np.linalg.solve(at.mass_matrix, right - at.coriolis_matrix @ at.speeds - at.gravity_forces)
    expected = loop.forward_dynamics(q, v, tau, load).a[index_of(loop, at.coordinates)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_motions_follow_from_closures_that_are_differentiated_numerically():
    """N from nothing but how far the loops are open: of the Stewart platform, with pinocchio.integrate."""
    loop, q = stewart()
    J = np.array(
        [
            robots.differences(
                lambda t, d=d: loop.closure_error(pin.integrate(loop.model, q, t * d)), h=1e-3
            )[0]
            for d in np.eye(loop.model.nv)
        ]
    ).T
    at = loop.minimal_dynamics(q)
    np.testing.assert_allclose(J @ at.motion, 0, rtol=0, atol=1e-10 * np.abs(at.motion).max())
    np.testing.assert_array_equal(at.motion[index_of(loop, at.coordinates)], np.eye(6))


def test_springs_dampers_and_rotors_count():
    plain, q = five_bar()
    data = (JointData("left_elbow", 3.0, 0.1, 0.4), JointData("right_joint", damping=0.2, friction=0.3))
    model = plain.model.copy()
    model.armature = np.array([0.5, 0.0, 0.7, 0.0])
    loop = ClosedLoopModel(model, replace(plain.sidecar, joint_data=data))
    v, a = motion(loop, q, index_of(loop, loop.actuated), np.array([0.3, -0.4]), np.array([1.0, 2.0]))
    at, bare = loop.minimal_dynamics(q, v), plain.minimal_dynamics(q, v)
    np.testing.assert_allclose(at.mass_matrix - bare.mass_matrix, np.diag([0.5, 0.7]), rtol=0, atol=1e-14)
    N = at.motion
    spring = -3.0 * (q[1] - 0.1) - 0.4 * v[1]
    expected = N[1] * spring + np.array([0.0, 0.2 * 0.4 + 0.3])
    np.testing.assert_allclose(at.passive_forces, expected, rtol=1e-12)
    np.testing.assert_array_equal(bare.passive_forces, 0)
    tau = loop.inverse_dynamics(q, v, a).tau
    left = at.mass_matrix @ [1.0, 2.0] + at.coriolis_matrix @ at.speeds + at.gravity_forces
    np.testing.assert_allclose(left, at.actuation @ tau + at.passive_forces, rtol=1e-10)


@pytest.mark.parametrize(
    ("name", "frame"), [("Stewart platform", "platform"), ("biped on one foot", "right_sole")]
)
def test_frames_move_as_their_jacobian_says(name, frame):
    loop, q, v, a, accelerations = moving(name)
    at, data = loop.frame_jacobian(frame, q, v), loop.model.createData()
    index = loop.model.getFrameId(frame)

    def place(t: float) -> pin.SE3:
        pin.framesForwardKinematics(loop.model, data, moved(loop, q, t * v))
        return data.oMf[index].copy()

    here = place(0.0)
    rate, _ = robots.differences(lambda t: place(t).translation, h=1e-3)
    turn, _ = robots.differences(lambda t: pin.log3(place(t).rotation @ here.rotation.T), h=1e-3)
    speeds = v[index_of(loop, at.coordinates)]
    np.testing.assert_allclose(at.jacobian @ speeds, np.concatenate((rate, turn)), rtol=0, atol=1e-9)
    pin.forwardKinematics(loop.model, data, q, v, a)
    expected = pin.getFrameClassicalAcceleration(loop.model, data, index, pin.LOCAL_WORLD_ALIGNED).vector
    found = at.jacobian @ accelerations + at.drift
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_many_states_are_each():
    loop, q = stewart()
    generator = np.random.default_rng(3)
    at = loop.minimal_dynamics(q)
    many = np.array([moved(loop, q, 0.02 * at.motion @ generator.normal(size=6)) for _ in range(3)])
    v = np.array([loop.minimal_dynamics(one).motion @ generator.normal(size=6) for one in many])
    names = ("platform_x", *loop.actuated[1:]) if "platform_x" in loop.model.names else loop.actuated
    found, frames = loop.minimal_dynamics(many, v, names), loop.frame_jacobian("platform", many, v, names)
    for i in range(3):
        one = loop.minimal_dynamics(many[i], v[i], names)
        for field in ("mass_matrix", "coriolis_matrix", "gravity_forces", "motion", "speeds", "actuation"):
            np.testing.assert_array_equal(getattr(found, field)[i], getattr(one, field))
        np.testing.assert_allclose(
            found.coriolis_forces[i], one.coriolis_matrix @ one.speeds, rtol=0, atol=1e-12
        )
        np.testing.assert_array_equal(
            frames.drift[i], loop.frame_jacobian("platform", many[i], v[i], names).drift
        )
    assert found.coordinates == frames.coordinates == tuple(names)
    with pytest.raises(InputError):
        loop.minimal_dynamics(np.zeros((0, loop.model.nq)))


def test_coordinates_are_the_motors_where_these_determine_the_motion():
    loop, q = five_bar()
    assert loop.coordinates(q) == ("left_joint", "right_joint")
    assert loop.coordinates(q, ["right_elbow", "left_joint"]) == ("right_elbow", "left_joint")
    redundant, _ = five_bar(actuated=("right_elbow", "left_joint", "right_joint"))
    chosen = redundant.coordinates(q)
    assert len(chosen) == 2
    assert set(chosen) < set(redundant.actuated)
    few, _ = five_bar(actuated=("left_joint",))
    for angles in ((2.0, 1.0), (1.5, 0.2)):  # at the first one the right elbow moves more
        assert few.coordinates(robots.five_bar_q(*angles)) == ("left_joint", "right_joint")
    turned, _ = five_bar(actuated=("right_joint", "left_joint"))
    assert turned.coordinates(q) == turned.actuated


def test_a_floating_base_is_a_coordinate_of_its_own_axes():
    loop, q = biped()
    names = loop.coordinates(q)
    assert set(names) == {*loop.actuated, *(f"base[{k}]" for k in range(6))}
    assert loop.coordinates(q, ["base", *loop.actuated]) == (
        *(f"base[{k}]" for k in range(6)),
        *loop.actuated,
    )
    turned = pin.integrate(loop.model, q, np.concatenate(([0, 0, 0, 0.4, 0.5, -0.3], np.zeros(12))))
    J = loop.frame_jacobian("torso", turned, coordinates=["base", *loop.actuated]).jacobian
    R = pin.Quaternion(turned[3:7]).toRotationMatrix()
    np.testing.assert_allclose(J[:, :6], np.kron(np.eye(2), R), rtol=0, atol=1e-12)


def test_what_does_not_determine_the_motion_is_refused():
    loop, q = five_bar()
    with pytest.raises(SingularityError, match="1 of 2 free motions"):
        loop.minimal_dynamics(q, coordinates=["left_joint"])
    with pytest.raises(InputError, match="3 are given"):
        loop.minimal_dynamics(q, coordinates=["left_joint", "right_joint", "left_elbow"])
    with pytest.raises(InputError, match=r"left_jiont.*left_joint"):
        loop.coordinates(q, ["left_jiont", "right_joint"])
    with pytest.raises(InputError, match="open by"):
        loop.minimal_dynamics(q + 0.01)
    with pytest.raises(InputError, match="opens"):
        loop.frame_jacobian("left_tip", q, [1.0, 0.0, 0.0, 0.0])
    fast = 1e3 * loop.minimal_dynamics(q).motion @ [1.0, -1.0]
    loop.minimal_dynamics(q, fast + np.array([1e-4, 0.0, 0.0, 0.0]))  # a small part of it
    with pytest.raises(InputError, match="opens"):
        loop.minimal_dynamics(q, [1e-4, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="frame"):
        loop.frame_jacobian("nowhere", q)
    rod = ClosedLoopModel.from_urdf(robots.parallelogram(), Sidecar((), ("left_joint",)))
    flat = ClosedLoopModel(rod.model, robots.PARALLELOGRAM_SIDECAR)
    dead = flat.assemble([np.pi / 2]).q  # all bars in one line: one more free motion
    with pytest.raises(SingularityError):
        flat.minimal_dynamics(dead, coordinates=["left_joint"])


IN_MUJOCO = {"five_bar": "left_rod", "delta": "platform", "stewart": "platform"}


@pytest.mark.parametrize(("name", "frame"), IN_MUJOCO.items())
def test_the_equations_of_motion_are_those_of_mujoco(name, frame):
    """MuJoCo reads the URDF itself: its mass matrix, load and Jacobians, and its closures' null space."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    file = ROOT / f"docs/_static/gallery/{name}.urdf"
    loop, generator = p3dof.load_robot(file), np.random.default_rng(4)
    q = loop.assemble().q
    at = loop.minimal_dynamics(q)
    q = moved(loop, q, 0.1 * at.motion @ generator.normal(size=len(at.speeds)))
    at = loop.minimal_dynamics(q)
    v = at.motion @ generator.normal(size=len(at.speeds))
    at, J = loop.minimal_dynamics(q, v), loop.frame_jacobian(frame, q, v)
    assert at.coordinates == loop.actuated
    other = in_mujoco(loop, file)
    model, data = other.model, mujoco.MjData(other.model)
    data.qpos[:], data.qvel[:] = other.qpos(q), other.qvel(q, v)
    data.qacc[:] = other.qacc(q, v, at.motion_rate @ at.speeds)
    mujoco.mj_inverse(model, data)
    closures = data.efc_J.reshape(data.nefc, model.nv)
    _, s, Vt = np.linalg.svd(closures)
    N = Vt[np.count_nonzero(s > 1e-9 * s[0]) :].T
    N = N @ np.linalg.inv(N[other.actuated_v()])
    M = np.zeros((model.nv, model.nv))
    for row, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    np.testing.assert_allclose(at.mass_matrix, N.T @ M @ N, rtol=0, atol=1e-10 * np.abs(at.mass_matrix).max())
    load = N.T @ (data.qfrc_inverse + data.qfrc_constraint)
    found = at.coriolis_matrix @ at.speeds + at.gravity_forces - at.passive_forces
    np.testing.assert_allclose(found, load, rtol=0, atol=1e-9 * np.abs(load).max())
    linear, angular = np.zeros((2, 3, model.nv))
    mujoco.mj_jacBody(model, data, linear, angular, model.body(frame).id)
    np.testing.assert_allclose(J.jacobian, np.vstack((linear, angular)) @ N, rtol=0, atol=1e-10)
