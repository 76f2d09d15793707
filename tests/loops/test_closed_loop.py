"""Dynamics of closed loops, against closed forms and derivations that share nothing with the package."""

from __future__ import annotations

import re

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import ARM, BAR, FIVE_BAR_SIDECAR, FOUR_BAR, FOUR_BAR_SIDECAR, Solid
from hypothesis import given, settings
from hypothesis import strategies as st

from p3dof._base.errors import DynamicsError, InputError, SingularityError
from p3dof.loops import ClosedLoopModel, Closure, FrameTarget, Sidecar
from p3dof.loops.forward import _ProximalSolver


@pytest.fixture(scope="module")
def arms() -> tuple[ClosedLoopModel, np.ndarray]:
    model, guess = robots.two_arms()
    joints = tuple(str(name) for name in model.names[1:15])
    return ClosedLoopModel(model, Sidecar(robots.TWO_ARMS, joints)), guess


def moving(loop: ClosedLoopModel, q: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A random velocity and acceleration that keep the loops closed, without `complete`.

    The drift comes from a finite difference of the Jacobian along the velocity.
    """
    generator = np.random.default_rng(seed)
    N = np.linalg.svd(loop.closure_jacobian(q))[2][loop.rank(q) :].T
    v = N @ generator.normal(size=N.shape[1])
    J_dot, _ = robots.differences(lambda t: loop.closure_jacobian(pin.integrate(loop.model, q, t * v)))
    J = loop.closure_jacobian(q)
    a = N @ generator.normal(size=N.shape[1]) - np.linalg.pinv(J, rcond=1e-9) @ (J_dot @ v)
    return v, a


# --- against independent derivations ------------------------------------------------------------------------


@settings(max_examples=30)
@given(
    theta=st.floats(-3.1, 3.1),
    rate=st.floats(-5, 5),
    acceleration=st.floats(-20, 20),
    ground=st.floats(0.45, 0.55),
    coupler=st.floats(0.4, 0.5),
)
def test_four_bar_torque_is_dalemberts(theta, rate, acceleration, ground, coupler):
    lengths = (ground, 0.15, coupler, 0.35)  # Grashof: the crank turns all the way round
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), FOUR_BAR_SIDECAR)
    state = loop.complete([theta], [rate], [acceleration], guess=robots.four_bar_q(theta, *lengths))
    result = loop.inverse_dynamics(state.q, state.v, state.a)
    expected = robots.planar_torques(
        robots.four_bar_bodies(*lengths), np.array([theta]), np.array([rate]), np.array([acceleration])
    )
    assert result.tau == pytest.approx(expected, abs=1e-8 * (1 + rate**2 + abs(acceleration)))
    assert result.residual < 1e-11
    assert result.tau_unique


@pytest.mark.parametrize("seed", range(5))
def test_five_bar_torques_are_dalemberts(five_bar, seed):
    generator = np.random.default_rng(seed)
    theta = np.array([2.0, 1.2]) + generator.uniform(-0.4, 0.4, 2)
    rate, acceleration = generator.normal(size=2), 5 * generator.normal(size=2)
    state = five_bar.complete(theta, rate, acceleration, guess=robots.five_bar_q(*theta))
    result = five_bar.inverse_dynamics(state.q, state.v, state.a)
    expected = robots.planar_torques(robots.five_bar_bodies(), theta, rate, acceleration)
    assert result.tau == pytest.approx(expected, abs=1e-8)
    assert (result.rank, result.mobility, result.tau_unique) == (2, 2, True)


def test_sarrus_statics_is_virtual_work(sarrus):
    # Both legs alike in angle: the plate is 0.6 sin α high, so every mass centre has a closed form in α.
    state = sarrus.complete([0.2], [0.0], [0.0])
    alpha = np.pi / 4 + 0.2

    def height(solid: Solid, base: float, angle: float) -> float:
        return base + solid.com[0] * np.sin(angle) + solid.com[2] * np.cos(angle)

    def energy(t: float) -> np.ndarray:
        angle, arm = alpha + t, robots.SARRUS_ARM
        lower = height(robots.ROD, 0.0, angle)
        # The upper arms lean the other way: their x axis points back, along π - α.
        upper = height(BAR, arm * np.sin(angle), np.pi - angle)
        plate = 2 * arm * np.sin(angle)
        masses = 2 * robots.ROD.mass * lower + 2 * BAR.mass * upper
        tops = ARM.mass * (plate + ARM.com[2]) + robots.ROD.mass * (plate + robots.ROD.com[2])
        return np.array([9.81 * (masses + tops)])

    expected, _ = robots.differences(energy, h=1e-2)
    result = sarrus.inverse_dynamics(state.q, state.v, state.a)
    assert result.tau == pytest.approx(expected, abs=1e-10)
    assert (result.rank, result.mobility) == (
        5,
        1,
    )  # one row of the six is redundant, everywhere on the motion
    assert result.unique.sum() < 6


def test_a_robot_is_composed_of_subjects():
    """No chain of classes: whoever reads a method finds it in one of two."""
    ours = [kind for kind in ClosedLoopModel.__mro__ if kind.__module__.startswith("p3dof.")]
    assert len(ours) <= 3


def test_serial_arm_is_plain_rnea_and_aba():
    model = robots.arm_model()
    loop = ClosedLoopModel(model, Sidecar.serial(model))
    data, generator = model.createData(), np.random.default_rng(0)
    q, v, a = generator.normal(size=(3, model.nv))
    result = loop.inverse_dynamics(q, v, a)
    tau = pin.rnea(model, data, q, v, a).copy()
    assert np.array_equal(result.tau, tau)
    assert (result.rank, result.mobility, result.lambda_.size, result.residual) == (0, 7, 0, 0.0)
    assert result.conditioning == 1.0
    forward = loop.forward_dynamics(q, v, tau)
    assert np.array_equal(forward.a, pin.aba(model, data, q, v, tau))
    assert forward.a == pytest.approx(a, abs=1e-9)


# --- two arms and a bar -------------------------------------------------------------------------------------


def test_two_arms_have_mobility_eight_and_spare_actuators(arms):
    loop, guess = arms
    q = loop.assemble(None, guess=guess).q
    v, a = moving(loop, q)
    result = loop.inverse_dynamics(q, v, a)
    assert (result.rank, result.mobility, len(result.tau)) == (12, 8, 14)
    assert not result.tau_unique
    assert not result.unique.any()  # squeezing the bar changes every multiplier
    assert result.residual < 1e-11
    assert loop.power(q, v, a) == pytest.approx(result.tau @ v[loop.actuated_v], abs=1e-9)
    # Least norm: no component along the torques that do nothing.
    N = np.linalg.svd(loop.closure_jacobian(q))[2][12:].T
    idle = np.linalg.svd(N[loop.actuated_v].T)[2][8:]
    assert np.abs(idle @ result.tau).max() < 1e-10 * np.abs(result.tau).max()


@pytest.mark.parametrize("passive", [0, 6], ids=["redundant", "just enough"])
def test_arms_hold_the_bar_with_newton_eulers_wrench(arms, passive):
    loop, guess = arms
    loop = ClosedLoopModel(loop.model, Sidecar(robots.TWO_ARMS, loop.actuated[: 14 - passive]))
    q = loop.assemble(None, guess=guess).q
    v, a = moving(loop, q)
    result = loop.inverse_dynamics(q, v, a)
    assert result.unique.all() == (passive == 6)
    # Wrench on the bar about its mass centre, from both hands, in world axes.
    model, data = loop.model, loop.model.createData()
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    bar = model.getJointId("bar")
    centre = data.oMi[bar].act(np.array(BAR.com))
    force, moment = np.zeros(3), np.zeros(3)
    for side, rows in zip(("left", "right"), loop.constraint_rows, strict=True):
        hand = data.oMf[model.getFrameId(f"{side}_tool0")]
        f, m = hand.rotation @ result.lambda_[rows][:3], hand.rotation @ result.lambda_[rows][3:]
        force += f
        moment += m + np.cross(hand.translation - centre, f)
    at_centre = (model, data, bar, pin.SE3(np.eye(3), np.array(BAR.com)), pin.LOCAL_WORLD_ALIGNED)
    V = pin.getFrameVelocity(*at_centre)
    A = pin.getFrameClassicalAcceleration(*at_centre)
    R = data.oMi[bar].rotation
    inertia = R @ BAR.matrix @ R.T
    assert force == pytest.approx(BAR.mass * (A.linear + np.array([0, 0, 9.81])), abs=1e-10)
    assert moment == pytest.approx(inertia @ A.angular + np.cross(V.angular, inertia @ V.angular), abs=1e-10)


# --- multipliers --------------------------------------------------------------------------------------------


def held(kind: str, swap: bool, level: bool) -> tuple[ClosedLoopModel, np.ndarray, pin.SE3]:
    """A pendulum at rest; level: its mass centre straight below the mark."""
    xml, sidecar = robots.pendulum(kind, swap=swap)
    loop = ClosedLoopModel.from_urdf(xml, sidecar)
    q = loop.assemble().q.copy()
    if kind == "3d" and level:
        lever = np.array(ARM.com) - np.array(robots.PENDULUM_MARK)
        turn = pin.Quaternion.FromTwoVectors(lever, np.array([0.0, 0.0, -1.0]))
        turned = pin.SE3(turn.matrix(), np.zeros(3))
        turned.translation = np.array([0.1, 0.2, 0.3]) - turned.rotation @ np.array(robots.PENDULUM_MARK)
        q = pin.SE3ToXYZQUAT(turned)
    data = loop.model.createData()
    pin.framesForwardKinematics(loop.model, data, q)
    return loop, q, data


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_multiplier_is_what_the_closure_exerts_on_frame2_in_axes_of_frame1(kind, swap):
    loop, q, data = held(kind, swap, level=True)
    zero = np.zeros(loop.model.nv)
    lambda_ = loop.inverse_dynamics(q, zero, zero).lambda_
    first = data.oMf[loop.model.getFrameId("bob_mark" if swap else "ground_mark")]
    mark = data.oMf[loop.model.getFrameId("bob_mark")].translation
    centre = data.oMi[1].act(np.array(ARM.com))
    on_bob = np.array([0, 0, ARM.mass * 9.81])  # the world carries the bob's weight
    moment = np.cross(centre - mark, on_bob)
    sign = -1.0 if swap else 1.0  # then frame2 is the world's
    assert sign * first.rotation @ lambda_[:3] == pytest.approx(on_bob, abs=1e-10)
    if kind == "6d":
        assert np.abs(moment).max() > 1.0
        assert sign * first.rotation @ lambda_[3:] == pytest.approx(moment, abs=1e-10)


def test_no_actuator_can_hold_a_tilted_pendulum():
    loop, q, _ = held("3d", swap=False, level=False)
    zero = np.zeros(loop.model.nv)
    with pytest.raises(DynamicsError, match=r"no actuator gives: .* is missing"):
        loop.inverse_dynamics(q, zero, zero)
    fall = loop.forward_dynamics(q, zero, [])
    with pytest.raises(DynamicsError, match="is missing"):  # a part in a million of it is missing already
        loop.inverse_dynamics(q, zero, fall.a * (1 - 1e-6))
    result = loop.inverse_dynamics(q, zero, fall.a)  # but its own fall needs none
    assert result.tau.size == 0
    assert (result.conditioning, result.tau_unique) == (1.0, True)  # there is nothing to be known
    assert result.lambda_ == pytest.approx(fall.lambda_, abs=1e-10)


def test_a_duplicate_closure_changes_nothing_but_uniqueness(five_bar):
    closure = FIVE_BAR_SIDECAR.closures[0]
    doubled = ClosedLoopModel.from_urdf(
        robots.five_bar(), Sidecar((closure, closure), FIVE_BAR_SIDECAR.actuated)
    )
    q = robots.five_bar_q(2.0, 1.2)
    v, a = moving(five_bar, q)
    one, two = five_bar.inverse_dynamics(q, v, a), doubled.inverse_dynamics(q, v, a)
    assert one.rank == two.rank == 2
    assert two.tau == pytest.approx(one.tau, abs=1e-12)
    assert one.unique.tolist() == [True, False, True]  # x and z; nothing in the plane holds y
    assert not two.unique.any()
    assert two.lambda_[:3] + two.lambda_[3:] == pytest.approx(one.lambda_, abs=1e-12)
    forward = doubled.forward_dynamics(q, v, one.tau)
    assert forward.a == pytest.approx(a, abs=1e-10)


# --- forward dynamics, energy, external wrenches ------------------------------------------------------------


def machine(request: pytest.FixtureRequest, name: str) -> tuple[ClosedLoopModel, np.ndarray]:
    loop = request.getfixturevalue(name)
    if name == "arms":
        return loop[0], loop[0].assemble(None, guess=loop[1]).q
    starts = {
        "four_bar": lambda: robots.four_bar_q(0.9, *FOUR_BAR),
        "five_bar": lambda: robots.five_bar_q(2.0, 1.2),
        "hexapod": lambda: robots.hexapod_q(
            pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.05, -0.03, 0.6])), loop.model
        ),
        "sarrus": lambda: np.array([0.2, -0.4, 0.2] * 2),
    }
    return loop, starts[name]()


MACHINES = ["four_bar", "five_bar", "hexapod", "sarrus", "arms"]


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("seed", range(3))
def test_forward_undoes_inverse_and_power_balances(request, name, seed):
    loop, q = machine(request, name)
    v, a = moving(loop, q, seed)
    push = {loop.model.frames[loop.model.nframes - 1].name: np.random.default_rng(seed).normal(size=6) * 10}
    inverse = loop.inverse_dynamics(q, v, a, push)
    forward = loop.forward_dynamics(q, v, inverse.tau, push)
    scale = 1 + np.abs(a).max()
    assert forward.a == pytest.approx(a, abs=1e-9 * scale)
    assert forward.closure_residual < 1e-11 * scale
    assert forward.residual < 1e-10 * scale
    if inverse.tau_unique:
        determined = inverse.unique
        assert forward.lambda_[determined] == pytest.approx(inverse.lambda_[determined], abs=1e-8 * scale)
    # Energy: body by body on one side, forces times velocities on the other.
    ((frame, wrench),) = push.items()
    data = loop.model.createData()
    pin.computeJointJacobians(loop.model, data, q)
    index = loop.model.getFrameId(frame)
    V = pin.getFrameJacobian(loop.model, data, index, pin.LOCAL_WORLD_ALIGNED) @ v
    supplied = inverse.tau @ v[loop.actuated_v] + wrench @ V
    assert loop.power(q, v, a) == pytest.approx(supplied, abs=1e-10 * scale * (1 + np.abs(inverse.tau).max()))


@pytest.mark.parametrize("name", MACHINES)
def test_pinocchios_constraint_dynamics_agrees_before_any_refinement(request, name):
    """The adapter by itself, on redundant closures too: the refinement must have next to nothing to do."""
    loop, q = machine(request, name)
    v, a = moving(loop, q)
    twice = ClosedLoopModel(loop.model, Sidecar(loop.sidecar.closures * 2, loop.actuated))
    force = np.zeros(loop.model.nv)
    force[loop.actuated_v] = loop.inverse_dynamics(q, v, a).tau
    for each in (loop, twice):
        raw = _ProximalSolver(each._tree.kinematics).acceleration(q, v, force)
        assert raw == pytest.approx(a, abs=1e-8 * np.abs(a).max())


def test_power_is_the_derivative_of_pinocchios_energy(hexapod):
    loop, model = hexapod, hexapod.model
    q = robots.hexapod_q(pin.SE3(np.eye(3), np.array([0.05, -0.03, 0.6])), model)
    v, a = np.random.default_rng(0).normal(size=(2, model.nv))
    data = model.createData()

    def energy(t: float) -> np.ndarray:
        # To second order in t, integrate(q, v t + a t²/2) has velocity v + a t.
        moved = pin.integrate(model, pin.integrate(model, q, v * t), a * t**2 / 2)
        return np.array([pin.computeMechanicalEnergy(model, data, moved, v + a * t)])

    slopes = [robots.differences(energy, h=h)[0][0] for h in (1e-3, 2e-3)]
    assert loop.power(q, v, a) == pytest.approx(slopes[0], rel=1e-7)
    model = pin.Model(model)
    model.armature = np.full(model.nv, 0.1)
    rotors = ClosedLoopModel(model, robots.HEXAPOD_SIDECAR).power(q, v, a)
    assert rotors - loop.power(q, v, a) == pytest.approx(0.1 * v @ a, rel=1e-9)


def test_an_external_wrench_is_virtual_work(hexapod):
    loop, q = hexapod, robots.hexapod_q(pin.SE3(np.eye(3), np.array([0.05, -0.03, 0.6])), hexapod.model)
    zero = np.zeros(loop.model.nv)
    wrench = np.array([3.0, -2.0, 50.0, 1.0, 4.0, -2.0])
    free = loop.inverse_dynamics(q, zero, zero)
    pushed = loop.inverse_dynamics(q, zero, zero, external={"platform": wrench})
    # Leg rates of a Gough-Stewart platform in closed form: direction · (velocity of the corner).
    M = pin.SE3(np.eye(3), np.array([0.05, -0.03, 0.6]))
    rows = []
    for foot, corner in zip(robots.HEXAPOD_BASE, robots.HEXAPOD_TOP, strict=True):
        lever = np.array(corner)
        u = M.act(lever) - np.array(foot)
        u /= np.linalg.norm(u)
        rows.append(np.concatenate((u, np.cross(lever, u))))
    # The wrench helps: Jᵀ Δτ = -w.
    assert np.array(rows).T @ (pushed.tau - free.tau) == pytest.approx(-wrench, abs=1e-10)
    # On the ground a wrench does nothing, on the free tree frame it is the same as on its joint.
    assert loop.inverse_dynamics(q, zero, zero, {"base": wrench}).tau == pytest.approx(free.tau, abs=1e-12)


def test_simulation_keeps_energy_and_loops(four_bar):
    """A passive four-bar swings: RK4 on the forward dynamics, projected after each step."""
    passive = ClosedLoopModel(four_bar.model, Sidecar(FOUR_BAR_SIDECAR.closures, ()))
    model, data, dt = passive.model, four_bar.model.createData(), 2e-3
    q, v = robots.four_bar_q(0.9, *FOUR_BAR), np.zeros(3)
    start = pin.computeMechanicalEnergy(model, data, q, v)
    fastest = 0.0
    for _ in range(300):
        k1 = passive.forward_dynamics(q, v, []).a
        k2 = passive.forward_dynamics(q + dt / 2 * v, v + dt / 2 * k1, []).a
        k3 = passive.forward_dynamics(q + dt / 2 * (v + dt / 2 * k1), v + dt / 2 * k2, []).a
        k4 = passive.forward_dynamics(q + dt * (v + dt / 2 * k2), v + dt * k3, []).a
        q = q + dt * v + dt**2 / 6 * (k1 + k2 + k3)
        v = v + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        q = passive.assemble(None, guess=q).q
        fastest = max(fastest, float(np.abs(v).max()))
    assert fastest > 2.0
    assert pin.computeMechanicalEnergy(model, data, q, v) == pytest.approx(start, abs=1e-6)
    assert np.abs(passive.closure_error(q)).max() < 1e-14


# --- singularities and refusals -----------------------------------------------------------------------------


def dead_point() -> np.ndarray:
    """The four-bar with coupler and rocker in one line: the crank's torque cannot hold the rocker."""
    ground, crank, coupler, rocker = 0.5, 0.4, 0.35, 0.3
    theta = np.arccos((ground**2 + crank**2 - (coupler + rocker) ** 2) / (2 * ground * crank))
    along = np.arctan2(-crank * np.sin(theta), ground - crank * np.cos(theta))
    return np.array([theta, along - theta, along - np.pi])


def test_the_dead_point_cannot_be_held_by_the_crank():
    xml = robots.four_bar(0.5, 0.4, 0.35, 0.3)
    q, zero = dead_point(), np.zeros(3)
    loop = ClosedLoopModel.from_urdf(xml, FOUR_BAR_SIDECAR)
    assert loop.mobility(q) == 1
    with pytest.raises(SingularityError, match="resist 0 of its 1 free motions"):
        loop.inverse_dynamics(q, zero, zero)
    held_by_rocker = ClosedLoopModel.from_urdf(xml, Sidecar(FOUR_BAR_SIDECAR.closures, ("rocker_joint",)))
    result = held_by_rocker.inverse_dynamics(q, zero, zero)
    assert result.conditioning > 0.3
    assert result.residual < 1e-13


def test_conditioning_falls_toward_the_dead_point():
    xml = robots.four_bar(0.5, 0.4, 0.35, 0.3)
    loop, q = ClosedLoopModel.from_urdf(xml, FOUR_BAR_SIDECAR), dead_point()
    values = []
    for bend in (0.3, 0.1, 0.03):
        rocker = ClosedLoopModel.from_urdf(xml, Sidecar(FOUR_BAR_SIDECAR.closures, ("rocker_joint",)))
        near = rocker.assemble([q[2] + bend], guess=q).q
        values.append(loop.inverse_dynamics(near, np.zeros(3), np.zeros(3)).conditioning)
    assert values == sorted(values, reverse=True)
    assert 0 < values[-1] < 0.1


def test_redundant_actuation_is_least_norm(four_bar):
    q = robots.four_bar_q(0.9, *FOUR_BAR)
    both = ClosedLoopModel(
        four_bar.model, Sidecar(FOUR_BAR_SIDECAR.closures, ("crank_joint", "rocker_joint"))
    )
    v, a = moving(four_bar, q)
    one, two = four_bar.inverse_dynamics(q, v, a), both.inverse_dynamics(q, v, a)
    ratio = v[2] / v[0]  # the same virtual work: τ1 + τ2 ratio = τ
    assert two.tau == pytest.approx(one.tau[0] * np.array([1, ratio]) / (1 + ratio**2), abs=1e-12)
    assert not two.tau_unique
    # Working against each other, the actuators stretch the coupler along its x axis: the force across it, in
    # z, follows from the coupler's own motion. Nothing in the plane holds y.
    assert two.unique.tolist() == [False, False, True]
    assert two.lambda_[2] == pytest.approx(one.lambda_[2], abs=1e-12)


def test_what_one_pair_of_actuators_leaves_open_stays_determined_elsewhere(four_bar):
    """Two four-bars on one base, the first with two actuators and the second with two: each opens its own."""
    first = robots.four_bar(*FOUR_BAR)
    again = re.sub(r'"((?:crank|coupler|rocker)\w*)"', r'"second_\1"', first)
    parts = re.sub(r"</?robot[^>]*>|<link name=.base./>", "", again)
    closures = [Closure("coupler_tip", "rocker_tip"), Closure("second_coupler_tip", "second_rocker_tip")]
    actuated = ("crank_joint", "rocker_joint", "second_crank_joint", "second_rocker_joint")
    both = ClosedLoopModel.from_urdf(
        first.replace("</robot>", f"{parts}</robot>"), Sidecar(closures, actuated)
    )
    pair = ClosedLoopModel(four_bar.model, Sidecar(closures[:1], actuated[:2]))
    q = robots.four_bar_q(0.9, *FOUR_BAR)
    v, a = moving(four_bar, q)
    one = pair.inverse_dynamics(q, v, a)
    two = both.inverse_dynamics(*(np.tile(x, 2) for x in (q, v, a)))
    assert two.unique.tolist() == [*one.unique, *one.unique]
    np.testing.assert_allclose(two.tau, np.tile(one.tau, 2), rtol=1e-11)


def test_of_a_joint_and_a_link_of_one_name_the_link_is_meant():
    xml = robots.robot(
        robots.link("base"),
        robots.link("part", BAR),
        robots.link("same", robots.ROD),
        robots.joint("same", "base", "part"),
        robots.joint("next", "part", "same", (0.3, 0, 0)),
    )
    loop = ClosedLoopModel.from_urdf(xml)
    place = pin.SE3(pin.exp3(np.array([0, 0.9, 0])), np.array([0.3 * np.cos(0.4), 0, -0.3 * np.sin(0.4)]))
    found = loop.assemble(FrameTarget("same", place, (True, False, True, False, True, False)), [0.4, 0.5])
    np.testing.assert_allclose(found.q, [0.4, 0.5], rtol=0, atol=1e-12)


def test_a_structure_needs_no_actuator_forces():
    xml, sidecar = robots.pendulum("6d")
    loop = ClosedLoopModel.from_urdf(xml, sidecar)
    state = loop.complete(None, [], [])
    result = loop.inverse_dynamics(state.q, state.v, state.a)
    assert (result.mobility, result.tau.size, result.conditioning) == (0, 0, 1.0)
    assert loop.forward_dynamics(state.q, state.v, []).a == pytest.approx(np.zeros(6), abs=1e-10)


def test_a_free_motion_without_inertia_is_refused():
    xml = robots.robot(
        robots.link("base"), robots.link("a"), robots.link("b"), robots.link("c", BAR),
        robots.joint("j1", "base", "a"), robots.joint("j2", "base", "b", kind="prismatic"),
        robots.joint("j3", "base", "c", (0.1, 0, 0)),
        robots.link("a_tip"), robots.joint("t", "a", "a_tip", (0.1, 0, 0), kind="fixed"),
        robots.link("c_tip"), robots.joint("u", "c", "c_tip", (0, 0, 0), kind="fixed"),
    )  # fmt: skip
    loop = ClosedLoopModel.from_urdf(xml, Sidecar((Closure("a_tip", "c_tip"),), ("j3",)))
    q = loop.assemble().q
    with pytest.raises(DynamicsError, match=r"without inertia|accuracy"):
        loop.forward_dynamics(q, np.zeros(3), [0.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": np.zeros(4)}, r"q: expected shape \(3,\), got \(4,\)"),
        ({"q": [0, np.nan, 0]}, "q: expected finite"),
        ({"v": np.zeros(2)}, r"v: expected shape \(3,\)"),
        ({"a": [0, 0, np.inf]}, "a: expected finite"),
        ({"q": np.array([0.9, 0, 0])}, "q: the closure coupler_tip/rocker_tip is open by"),
        ({"v": np.array([1.0, 0, 0])}, "v: opens the closure coupler_tip/rocker_tip"),
        ({"v": np.array([1e-4, 0, 0])}, "v: opens the closure coupler_tip/rocker_tip"),
        ({"a": np.array([1.0, 0, 0])}, "a: opens the closure coupler_tip/rocker_tip"),
        ({"a": np.array([1e-4, 0, 0])}, "a: opens the closure coupler_tip/rocker_tip"),
        ({"external": [np.zeros(6)]}, "external: expected a mapping of frame names to wrenches, got list"),
        ({"external": {"nowhere": np.zeros(6)}}, "external: the frame 'nowhere' does not exist; known: "),
        ({"external": {"rockr": np.zeros(6)}}, "did you mean 'rocker'"),
        ({"external": {"rocker": np.zeros(3)}}, r"external rocker: expected shape \(6,\)"),
    ],
)
def test_inverse_dynamics_refuses(four_bar, change, message):
    arguments = {"q": robots.four_bar_q(0.9, *FOUR_BAR), "v": np.zeros(3), "a": np.zeros(3)} | change
    with pytest.raises(InputError, match=message):
        four_bar.inverse_dynamics(**arguments)


def test_forward_dynamics_refuses_bad_arguments(four_bar, hexapod):
    q = robots.four_bar_q(0.9, *FOUR_BAR)
    with pytest.raises(InputError, match=r"tau: expected shape \(1,\)"):
        four_bar.forward_dynamics(q, np.zeros(3), [1.0, 2.0])
    with pytest.raises(InputError, match="open by"):
        four_bar.forward_dynamics(np.zeros(3), np.zeros(3), [1.0])
    with pytest.raises(InputError, match="v: opens the closure"):
        four_bar.forward_dynamics(q, [1.0, 0, 0], [1.0])
    with pytest.raises(InputError, match="q: not normalised"):
        hexapod.rank(2 * pin.neutral(hexapod.model))


def test_results_cannot_be_written_to_and_survive_the_next_call(four_bar):
    q = robots.four_bar_q(0.9, *FOUR_BAR)
    v, a = moving(four_bar, q)
    result = four_bar.inverse_dynamics(q, v, a)
    before = result.tau.copy(), result.lambda_.copy()
    four_bar.inverse_dynamics(robots.four_bar_q(1.4, *FOUR_BAR), np.zeros(3), np.zeros(3))
    assert np.array_equal(result.tau, before[0])
    assert np.array_equal(result.lambda_, before[1])
    for array in (result.tau, result.lambda_, result.unique):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    J = four_bar.closure_jacobian(q)
    J[:] = 7.0  # a copy: the model's own is untouched
    assert not np.any(four_bar.closure_jacobian(q) == 7.0)


def test_gravity_may_be_changed(four_bar):
    loop, q = four_bar.copy(), robots.four_bar_q(0.9, *FOUR_BAR)
    zero = np.zeros(3)
    loop.model.gravity.linear = np.zeros(3)
    assert loop.inverse_dynamics(q, zero, zero).tau == pytest.approx([0.0], abs=1e-14)
    assert abs(four_bar.inverse_dynamics(q, zero, zero).tau[0]) > 1.0  # the original keeps its own


def test_a_frame_target_drives_the_five_bar_tip(five_bar):
    # The tip in the plane determines both motors; the torques follow from virtual work again.
    q = robots.five_bar_q(2.0, 1.2)
    data = five_bar.model.createData()
    pin.framesForwardKinematics(five_bar.model, data, q)
    place = data.oMf[five_bar.model.getFrameId("left_tip")]
    target = FrameTarget("left_tip", place, [True, False, True, False, False, False])
    state = five_bar.complete(target, [0.3, -0.2], [1.0, 2.0], guess=q)
    rate, acceleration = state.v[[0, 2]], state.a[[0, 2]]
    result = five_bar.inverse_dynamics(state.q, state.v, state.a)
    expected = robots.planar_torques(robots.five_bar_bodies(), np.array([2.0, 1.2]), rate, acceleration)
    assert result.tau == pytest.approx(expected, abs=1e-8)
