"""Springs, damping, friction and rotors in joints: in forces, accelerations, energies, runs and files."""

from __future__ import annotations

import pickle
from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof._base.errors import InputError, ModelError
from p3dof.loops import ClosedLoopModel, ClosureJoint, JointData, ReactionSolver, Sidecar, reactions_batch
from p3dof.loops.writers.urdf import texts
from p3dof.runs import simulate_robot

DATA = (
    JointData("left_elbow", stiffness=3.0, rest=-0.4, damping=0.7),
    JointData("right_joint", damping=0.2, friction=0.3),
    JointData("right_elbow", stiffness=1.5, rest=0.2, force=0.9),
)


def five_bar(data=DATA):
    return ClosedLoopModel.from_urdf(robots.five_bar(), replace(robots.FIVE_BAR_SIDECAR, joint_data=data))


def moving(loop, seed=0, count=1):
    rng = np.random.default_rng(seed)
    states = [loop.complete(angles, *rng.normal(size=(2, 2))) for angles in rng.uniform(1.1, 1.9, (count, 2))]
    return [np.array([getattr(state, name) for state in states]) for name in "qva"]


def law(q, v):
    """What acts in the joints of the five-bar, written out."""
    forces = np.zeros(4)
    forces[1] = -3.0 * (q[1] + 0.4) - 0.7 * v[1]
    forces[2] = -0.2 * v[2] - 0.3 * np.tanh(v[2] / 1e-3)
    forces[3] = 0.9 - 1.5 * (q[3] - 0.2)
    return forces


def test_all_dynamics_have_what_acts_in_the_joints():
    loop, plain = five_bar(), five_bar(())
    q, v, a = moving(loop, count=12)
    acting = np.array([law(*pair) for pair in zip(q, v, strict=True)])
    np.testing.assert_allclose(loop.passive.forces(q, v), acting, rtol=0, atol=1e-14)
    more = np.array([0.1, -0.2, 0.3, 0.4])
    both = loop.inverse_dynamics_batch(q, v, a, joint_forces=more).tau
    expected = plain.inverse_dynamics_batch(q, v, a, joint_forces=acting + more).tau
    np.testing.assert_allclose(both, expected, rtol=0, atol=1e-11)
    driven = a[:, loop.actuated_v]
    for many in (12, 2):  # by arrays, and one by one
        found = loop.hybrid_dynamics_batch(q[:many], v[:many], driven[:many], joint_forces=more).tau
        np.testing.assert_allclose(found, expected[:many], rtol=0, atol=1e-10)
    for i in range(3):
        state = q[i], v[i]
        one = loop.inverse_dynamics(*state, a[i], joint_forces=more)
        np.testing.assert_allclose(one.tau, both[i], rtol=0, atol=1e-11)
        assert one.residual < 1e-11
        assert loop.residual(*state, a[i], one.tau, one.lambda_, joint_forces=more) < 1e-11
        assert plain.residual(*state, a[i], one.tau, one.lambda_, joint_forces=more) > 0.1
        forward = loop.forward_dynamics(*state, one.tau, joint_forces=more).a
        np.testing.assert_allclose(forward, a[i], rtol=0, atol=1e-9)
        found = loop.hybrid_dynamics(*state, a[i][loop.actuated_v], joint_forces=more)
        np.testing.assert_allclose(found.tau, one.tau, rtol=0, atol=1e-10)


def test_power_of_the_motors_is_energy_and_loss():
    loop = five_bar()
    q, v, a = moving(loop, 1, 12)
    tau = loop.inverse_dynamics_batch(q, v, a).tau
    put_in = np.sum(tau * v[:, loop.actuated_v], axis=1)
    lost = loop.dissipation(v)
    expected = 0.7 * v[:, 1] ** 2 + 0.2 * v[:, 2] ** 2 + 0.3 * v[:, 2] * np.tanh(v[:, 2] / 1e-3)
    np.testing.assert_allclose(lost, expected, rtol=1e-13)
    np.testing.assert_allclose(loop.power_batch(q, v, a), put_in - lost, rtol=0, atol=1e-11)
    assert loop.power(q[0], v[0], a[0]) == pytest.approx(put_in[0] - lost[0], abs=1e-11)
    energies = loop.body_energies(q, v)
    springs = 1.5 * (q[:, 1] + 0.4) ** 2 + 0.75 * (q[:, 3] - 0.2) ** 2 - 0.9 * q[:, 3]
    np.testing.assert_allclose(energies.springs, springs, rtol=1e-13)
    without = five_bar(()).body_energies(q, v).total
    np.testing.assert_allclose(energies.total - without, springs, rtol=0, atol=1e-12)
    assert loop.body_energies(q[0], v[0]).total == pytest.approx(energies.total[0], rel=1e-14)


def test_a_run_keeps_the_energy_of_springs_and_loses_what_is_damped():
    start = robots.five_bar_q(1.9, 1.2)
    kept = simulate_robot(five_bar((DATA[2],)), 0.2, start, samples=51, method="general")
    assert np.ptp(kept.loop.passive.energy(kept.q)) > 0.05
    np.testing.assert_allclose(kept.energy, kept.energy[0], rtol=0, atol=1e-7)
    loop = five_bar(DATA[:1])
    damped = simulate_robot(loop, 0.2, start, samples=1001, method="general")
    lost = loop.dissipation(damped.v)
    taken = np.sum((lost[1:] + lost[:-1]) / 2 * np.diff(damped.time))
    assert taken > 1e-3
    assert damped.energy[0] - damped.energy[-1] == pytest.approx(taken, rel=1e-3)


def test_reactions_have_what_acts_in_the_joints():
    loop = five_bar()
    q, v, a = moving(loop, 2, 4)
    tau = loop.inverse_dynamics_batch(q, v, a).tau
    solver = ReactionSolver(loop, [ClosureJoint.revolute((0.0, 1.0, 0.0))])
    found = reactions_batch(solver, q, v, a, tau)
    assert not found.errors
    acting = np.array([law(*pair) for pair in zip(q, v, strict=True)])
    axes = -found.moments[:, [1, 3], 1]  # they point along -y
    np.testing.assert_allclose(axes, acting[:, [1, 3]], rtol=0, atol=1e-11)


def test_small_robots_are_computed_in_their_own_unit():
    """A robot of millimetres has another unit of length inside."""
    text = robots.robot(
        robots.link("base"),
        robots.link("arm", robots.Solid(1e-6, (1e-3, 0, 0), (1e-12, 0, 0, 1e-12, 0, 1e-12))),
        robots.link("slider", robots.Solid(1e-6, (0, 0, 0), (1e-12, 0, 0, 1e-12, 0, 1e-12))),
        robots.joint("turn", "base", "arm", (0, 0, 1e-3)),
        robots.joint("slide", "arm", "slider", (2e-3, 0, 0), (1, 0, 0), kind="prismatic"),
    )
    data = (JointData("turn", 1e-7, 0.3, 2e-8), JointData("slide", 0.2, 1e-4, 1e-3))
    loop, plain = (
        ClosedLoopModel.from_urdf(text, Sidecar((), ("turn", "slide"), joint_data=given))
        for given in (data, ())
    )
    assert loop.unit_of_length != 1.0
    q, v, a = np.array([0.5, 3e-4]), np.array([2.0, 1e-2]), np.array([3.0, 0.1])
    acting = np.array([-1e-7 * 0.2 - 2e-8 * 2.0, -0.2 * 2e-4 - 1e-3 * 1e-2])
    expected = plain.inverse_dynamics(q, v, a).tau - acting
    np.testing.assert_allclose(loop.inverse_dynamics(q, v, a).tau, expected, rtol=1e-12)
    batch = [np.tile(row, (9, 1)) for row in (q, v, a)]
    many = loop.inverse_dynamics_batch(*batch).tau
    np.testing.assert_allclose(many, np.tile(expected, (9, 1)), rtol=1e-12)
    np.testing.assert_allclose(loop.forward_dynamics(q, v, expected).a, a, rtol=1e-9)


def test_a_spring_of_a_continuous_joint_turns_back_by_the_shorter_way():
    text = robots.four_bar(*robots.FOUR_BAR, kind="continuous")
    data = (JointData("crank_joint", stiffness=2.0, rest=3.0),)
    loop = ClosedLoopModel.from_urdf(text, replace(robots.FOUR_BAR_SIDECAR, joint_data=data))
    q = np.array(loop.reference)
    q[:2] = np.cos(-3.1), np.sin(-3.1)
    force = loop.passive.forces(q, np.zeros(3))
    assert force[0] == pytest.approx(-2.0 * (2 * np.pi - 6.1), rel=1e-12)


# --- files --------------------------------------------------------------------------------------------------


def test_friction_changes_its_sign_over_its_own_smoothing():
    """In forces, their derivatives, losses, code, regressor and file; 1 mm/s where nothing is said."""
    smoothed = replace(DATA[1], smoothing=0.4)
    assert DATA[1].smoothing == 1e-3
    loop, plain = five_bar((smoothed,)), five_bar(())
    q, v, a = moving(loop, 5, 3)
    acting = np.zeros((3, 4))
    acting[:, 2] = -0.2 * v[:, 2] - 0.3 * np.tanh(v[:, 2] / 0.4)
    expected = plain.inverse_dynamics_batch(q, v, a, joint_forces=acting).tau
    assert np.abs(expected - five_bar((DATA[1],)).inverse_dynamics_batch(q, v, a).tau).max() > 1e-3
    np.testing.assert_allclose(loop.inverse_dynamics_batch(q, v, a).tau, expected, rtol=0, atol=1e-11)
    compiled = loop.compile()
    np.testing.assert_allclose(compiled.inverse_dynamics(q, v, a).tau, expected, rtol=0, atol=1e-11)
    np.testing.assert_allclose(loop.dissipation(v), -np.sum(acting * v, axis=1), rtol=1e-13)
    step = np.array([0, 0, 1e-6, 0])
    ends = [loop.passive.forces(q[0], v[0] + s * step)[2] for s in (1, -1)]
    slope = loop.passive.derivatives(q[0], v[0])[1][2, 2]
    assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-8)
    regressor = loop.force_regressor(q[0], v[0], a[0])
    np.testing.assert_allclose(regressor.forces @ regressor.parameters, expected[0], rtol=0, atol=1e-11)
    assert Sidecar.parse(loop.sidecar.to_yaml()).joint_data == (smoothed,)
    with pytest.raises(ModelError, match="smoothing: expected a positive number, got 0"):
        JointData("right_joint", smoothing=0)


def test_losses_of_a_urdf_act_on_request():
    text = robots.five_bar().replace("<limit", '<dynamics damping="0.4" friction="0.3"/><limit')
    assert not p3dof.load_robot(text, robots.FIVE_BAR_SIDECAR).passive
    sidecar = replace(robots.FIVE_BAR_SIDECAR, joint_data=(JointData("left_joint", damping=9.0),))
    loop = p3dof.load_robot(text, sidecar, passive=True)
    found = {entry.joint: (entry.damping, entry.friction) for entry in loop.sidecar.joint_data}
    others = dict.fromkeys(("left_elbow", "right_joint", "right_elbow"), (0.4, 0.3))
    assert found == {"left_joint": (9.0, 0.0), **others}
    v = np.array([1.0, -2.0, 3.0, 0.0])
    np.testing.assert_allclose(loop.passive.forces(np.zeros(4), v), [-9.0, 0.8 + 0.3, -1.2 - 0.3, 0.0])


def test_a_written_robot_has_its_springs_and_rotors_when_it_is_read():
    loop = five_bar((*DATA, JointData("left_joint", armature=0.05)))
    np.testing.assert_array_equal(loop.model.armature, [0.05, 0, 0, 0])
    assert {entry.joint for entry in loop.sidecar.joint_data} == {entry.joint for entry in DATA}
    again = p3dof.load_robot(*texts(loop))
    np.testing.assert_array_equal(again.model.armature, loop.model.armature)
    assert again.sidecar.joint_data == loop.sidecar.joint_data
    assert pickle.loads(pickle.dumps(loop)).sidecar == loop.sidecar  # noqa: S301 - our own
    assert loop.copy().sidecar.joint_data == loop.sidecar.joint_data
    assert Sidecar.parse(loop.sidecar.to_yaml()) == loop.sidecar


def test_locked_joints_lose_what_acted_in_them():
    part = five_bar().lock({"left_elbow": 0.3})
    assert part.sidecar.joint_data == DATA[1:]


MJCF = """<mujoco><compiler angle="radian"/><option><flag contact="disable"/></option><worldbody>
 <body pos="0 0 1"><joint name="a" axis="0 1 0.3" stiffness="5" springref="0.4" damping="0.3"
   armature="0.02"/><inertial pos="0.1 0.02 -0.2" mass="1.5" fullinertia="0.02 0.03 0.04 0.001 0.002 0.003"/>
  <body pos="0.1 0 -0.4"><joint name="b" type="slide" axis="1 0.2 0" stiffness="80" ref="0.1" damping="2"/>
   <inertial pos="0 0.1 0" mass="0.7" diaginertia="0.01 0.02 0.02"/>
   <body pos="0 0 -0.3"><joint name="c" type="ball" damping="0.1"/>
    <inertial pos="0 0 -0.1" mass="0.4" diaginertia="0.01 0.01 0.005"/></body></body></body></worldbody>
 <actuator><motor joint="a"/></actuator></mujoco>"""


def test_springs_and_dampers_are_those_of_mujoco():
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    model = mujoco.MjModel.from_xml_string(MJCF)
    data, loop = mujoco.MjData(model), p3dof.load_robot(MJCF)
    rng = np.random.default_rng(7)
    for _ in range(5):
        q = pin.integrate(loop.model, np.array(loop.reference), rng.normal(size=5))
        v, torque = rng.normal(size=5), float(rng.normal())
        data.qpos[:] = [*q[:2], q[5], *q[2:5]]  # MuJoCo's quaternions begin with the scalar
        data.qvel[:], data.ctrl[:] = v, torque
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(loop.passive.forces(q, v), data.qfrc_passive, rtol=0, atol=1e-12)
        found = loop.forward_dynamics(q, v, [torque]).a
        np.testing.assert_allclose(found, data.qacc, rtol=0, atol=1e-9 * np.abs(data.qacc).max())
    assert not p3dof.load_robot(MJCF, passive=False).passive
    given = {"closed_loop": [], "type": [], "name_mot": ["a"], "joint_data": [{"joint": "b", "stiffness": 1}]}
    both = p3dof.load_robot(MJCF, given)
    assert {entry.joint: entry.stiffness for entry in both.sidecar.joint_data} == {
        "b": 1.0,
        "a": 5.0,
        "c": 0.0,
    }


# --- balls and free joints ----------------------------------------------------------------------------------

SPRUNG = """<mujoco><compiler angle="radian"/><option><flag contact="disable"/></option><worldbody>
 <body pos="0.2 -0.1 1" quat="0.8 0.2 -0.4 0.4"><joint name="f" type="free" stiffness="7" damping="0.2"/>
  <inertial pos="0.1 0.02 -0.2" mass="1.5" fullinertia="0.02 0.03 0.04 0.001 0.002 0.003"/>
  <body pos="0.1 0 -0.4" quat="0.5 0.5 -0.5 0.5"><joint name="b" type="ball" stiffness="3" damping="0.1"/>
   <inertial pos="0 0 -0.1" mass="0.4" diaginertia="0.01 0.01 0.005"/></body></body></worldbody></mujoco>"""


def test_springs_of_balls_and_free_joints_are_those_of_mujoco():
    """Accelerations under springs and dampers, also with turns of nearly π, and the springs' energy."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    model = mujoco.MjModel.from_xml_string(SPRUNG)
    data, loop = mujoco.MjData(model), p3dof.load_robot(SPRUNG)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    bare = p3dof.load_robot(SPRUNG, passive=False)
    rng = np.random.default_rng(3)
    offset = None
    for scale in (0.1, 1.0, 1.5, 2.0):
        q = np.array(pin.integrate(loop.model, pin.neutral(loop.model), scale * rng.normal(size=9)))
        v = rng.normal(size=9)
        R = pin.Quaternion(q[3:7]).matrix()
        data.qpos[:] = [*q[:3], q[6], *q[3:6], q[10], *q[7:10]]
        data.qvel[:] = [*(R @ v[:3]), *v[3:]]
        mujoco.mj_forward(model, data)
        forces = np.array(data.qfrc_passive)
        forces[:3] = R.T @ forces[:3]
        np.testing.assert_allclose(loop.passive.forces(q, v), forces, rtol=0, atol=1e-12)
        a = loop.forward_dynamics(q, v, []).a
        a_world = R @ (a[:3] + np.cross(v[3:6], v[:3]))
        np.testing.assert_allclose(a_world, data.qacc[:3], rtol=0, atol=1e-9 * np.abs(data.qacc).max())
        np.testing.assert_allclose(a[3:], data.qacc[3:], rtol=0, atol=1e-9 * np.abs(data.qacc).max())
        stored = loop.body_energies(q, v).springs
        assert loop.body_energies(q, v).total - bare.body_energies(q, v).total == pytest.approx(stored)
        difference = data.energy[0] - loop.body_energies(q, v).potential.sum() - stored
        offset = difference if offset is None else offset
        assert difference == pytest.approx(offset, abs=1e-10)


def sprung_ball():
    ball = pin.Model()
    ball.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    bodies = (
        pin.Inertia(1.2, np.array([0.1, 0, 0.05]), np.diag([0.02, 0.03, 0.04])),
        pin.Inertia(0.5, np.array([0.1, 0, 0]), np.diag([0.01, 0.02, 0.02])),
    )
    ball.appendBodyToJoint(1, bodies[0], pin.SE3.Identity())
    ball.addJoint(1, pin.JointModelSpherical(), pin.SE3(np.eye(3), np.array([0.3, 0, 0.1])), "ball")
    ball.appendBodyToJoint(2, bodies[1], pin.SE3.Identity())
    turned = pin.Quaternion(pin.exp3(np.array([0.3, -0.2, 0.5]))).coeffs()
    data = (
        JointData("free", stiffness=40.0, rest=(0.1, 0, 0.2, *turned), damping=0.0),
        JointData("ball", stiffness=2.0),
    )
    return ClosedLoopModel(ball, Sidecar((), (), joint_data=data))


def test_springs_of_balls_have_an_energy_of_which_they_are_the_gradient():
    loop, rng = sprung_ball(), np.random.default_rng(5)
    q = np.array([pin.integrate(loop.model, pin.neutral(loop.model), rng.normal(size=9)) for _ in range(4)])
    v = rng.normal(size=(4, 9))
    forces, h = loop.passive.forces(q, 0 * v), 1e-6
    for i in range(4):
        ends = [loop.passive.energy(np.array(pin.integrate(loop.model, q[i], s * h * v[i]))) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * h)
        assert loop.passive.power(q[i], v[i]) == pytest.approx(slope, abs=1e-7)
        assert forces[i] @ v[i] == pytest.approx(-slope, abs=1e-7)
        by_q, _ = loop.passive.derivatives(q[i], v[i])
        for k, row in enumerate(np.eye(9)):
            ends = [
                loop.passive.forces(np.array(pin.integrate(loop.model, q[i], s * h * row)), 0 * row)
                for s in (1, -1)
            ]
            np.testing.assert_allclose(by_q[:, k], (ends[0] - ends[1]) / (2 * h), rtol=0, atol=1e-7)
    np.testing.assert_allclose(loop.passive.energy(q)[2], loop.passive.energy(q[2]), rtol=1e-14)
    run = simulate_robot(
        loop, 1.0, q[0] * 0 + pin.neutral(loop.model), 0.3 * v[0], samples=21, method="general"
    )
    assert np.ptp(loop.passive.energy(run.q)) > 0.1
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=0, atol=1e-7)
    a = rng.normal(size=9)
    regressor = loop.force_regressor(q[1], v[1], a)
    assert {"free.stiffness", "ball.stiffness"} <= set(regressor.parameter_names)
    data = loop.model.createData()
    taken = np.array(pin.rnea(loop.model, data, q[1], v[1], a)) - loop.passive.forces(q[1], v[1])
    from_parameters = loop._regressor.rows(q[1], v[1], a) @ regressor.parameters
    np.testing.assert_allclose(from_parameters, taken, rtol=0, atol=1e-11)
    again = Sidecar.parse(loop.sidecar.to_yaml())
    assert again.joint_data == loop.sidecar.joint_data


# --- motors -------------------------------------------------------------------------------------------------


def test_a_rotor_behind_a_gear_is_an_armature_that_is_told_at_the_motor():
    geared = (JointData("left_joint", rotor_inertia=2e-5, gear_ratio=-50.0),)
    loop, plain = five_bar(geared), five_bar((JointData("left_joint", armature=0.05),))
    np.testing.assert_allclose(loop.model.armature, [0.05, 0, 0, 0], rtol=1e-15)
    q, v, a = moving(loop, 3, 6)
    tau = loop.inverse_dynamics_batch(q, v, a).tau
    np.testing.assert_array_equal(tau, plain.inverse_dynamics_batch(q, v, a).tau)
    side = loop.motor_side(tau, v)
    np.testing.assert_allclose(side.gear_ratio, [-50, 1])
    np.testing.assert_allclose(side.torque, tau / [-50.0, 1.0], rtol=1e-15)
    np.testing.assert_allclose(side.speed, v[:, [0, 2]] * [-50.0, 1.0], rtol=1e-15)
    np.testing.assert_allclose(side.torque * side.speed, tau * v[:, [0, 2]], rtol=1e-12)  # power stays
    assert loop.motor_side(tau[0], v[0]).torque.shape == (2,)
    light = five_bar(())  # the motor feels its own rotor, and the joint less the gear's share
    without = light.inverse_dynamics_batch(q, v, a).tau
    rotor = 2e-5 * -50.0 * a[:, 0]
    np.testing.assert_allclose(side.torque[:, 0], without[:, 0] / -50.0 + rotor, rtol=0, atol=1e-12)
    assert loop.copy().sidecar.joint_data == geared
    again = p3dof.load_robot(*texts(loop))
    assert again.sidecar.joint_data == geared
    np.testing.assert_array_equal(again.model.armature, loop.model.armature)
    both = five_bar((JointData("left_joint", armature=0.01, rotor_inertia=2e-5, gear_ratio=50.0),))
    assert both.model.armature[0] == pytest.approx(0.06)
    again = p3dof.load_robot(*texts(both))
    np.testing.assert_allclose(again.model.armature, both.model.armature, rtol=1e-14)
    with pytest.raises(ModelError, match=r"rotor_inertia: the tree has 0 in model\.armature, less than"):
        ClosedLoopModel(light.model, replace(robots.FIVE_BAR_SIDECAR, joint_data=geared))


GEARED = """<mujoco><option><flag contact="disable"/></option><worldbody><body><joint name="a" axis="0 1 0"
 armature="0.03"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
 <actuator><motor joint="a" gear="-20"/></actuator></mujoco>"""


def test_the_gear_of_an_actuator_is_the_ratio_of_its_motor():
    """MuJoCo's actuator has its own force and velocity; forces of the robot stay those of its joints."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    model, loop = mujoco.MjModel.from_xml_string(GEARED), p3dof.load_robot(GEARED)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.3, 1.5, 0.07
    mujoco.mj_forward(model, data)
    tau = [float(data.qfrc_actuator[0])]
    np.testing.assert_allclose(loop.forward_dynamics([0.3], [1.5], tau).a, data.qacc, rtol=1e-10)
    side = loop.motor_side(tau, [1.5])
    np.testing.assert_allclose(side.torque, data.actuator_force, rtol=1e-14)
    np.testing.assert_allclose(side.speed, data.actuator_velocity, rtol=1e-14)
    assert loop.model.armature[0] == 0.03


def test_data_that_do_not_fit():
    for fields, words in (
        ({"joint": ""}, "joint data: joint: expected a name"),
        ({"joint": "x", "stiffness": np.inf}, "joint data of 'x': stiffness"),
        ({"joint": "x", "force": "some"}, "joint data of 'x': force"),
        ({"joint": "x", "rest": np.nan}, "joint data of 'x': rest"),
        ({"joint": "x", "damping": "much"}, "joint data of 'x': damping"),
        ({"joint": "x", "gear_ratio": 0}, "'x': gear_ratio: expected a number other than zero"),
        ({"joint": "x", "rotor_inertia": -1}, "joint data of 'x': rotor_inertia: expected zero or more"),
        ({"joint": "x", "rest": (1.0, 2.0)}, "'x': rest: expected one number, four or seven, got 2"),
    ):
        with pytest.raises(ModelError, match=words):
            JointData(**fields)
    for data, words in (
        ((JointData("elbow", damping=1.0),), "joint data: the joint 'elbow' does not exist"),
        ((DATA[0], DATA[0]), "joint_data: the joint 'left_elbow' is named twice"),
        (("left_elbow",), "joint_data: expected JointData objects, got 'left_elbow'"),
    ):
        with pytest.raises(ModelError, match=words):
            five_bar(data)
    plain, rotor = five_bar(()), JointData("left_joint", armature=1.0)
    with pytest.raises(ModelError, match=r"armature: it belongs to the tree, model\.armature"):
        ClosedLoopModel(plain.model, Sidecar((), (), joint_data=(rotor,)))
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addJoint(1, pin.JointModelTranslation(), pin.SE3.Identity(), "shift")
    for entry, words in (
        (JointData("shift", stiffness=1.0), "only a joint with one degree of freedom, a ball"),
        (JointData("shift", force=1.0), "'shift': force: expected a joint with one degree of freedom"),
        (JointData("ball", stiffness=-1.0), "'ball': stiffness: expected zero or more, got -1"),
        (JointData("ball", stiffness=1.0, rest=0.3), "rest: expected 4 values, got one"),
        (JointData("ball", stiffness=1.0, rest=(0, 0, 0, 2.0)), "rest: expected 4 values that end"),
        (JointData("ball", stiffness=1.0, rest=(0,) * 6 + (1,)), "rest: expected 4 values that end"),
    ):
        with pytest.raises(ModelError, match=words):
            ClosedLoopModel(model, Sidecar((), (), joint_data=(entry,)))
    with pytest.raises(ModelError, match=r"rest: expected one number$"):
        five_bar((JointData("left_elbow", stiffness=1.0, rest=(0, 0, 0, 1)),))
    with pytest.raises(InputError, match="v: expected shape"):
        plain.dissipation(np.zeros(3))
