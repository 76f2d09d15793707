"""MuJoCo: `mujoco.MjModel.from_xml_path("urdf/p3dof_mjcf.xml")`; the URDF loads too, as an open tree."""

import functools
import itertools
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest
from machines import random_machine, random_states
from reference import (
    FILES,
    GRAVITY,
    LINKS,
    MECHANISM,
    MOVING,
    URDF,
    assert_bodies,
    assert_placements,
    closed_joints,
    closed_states,
    mimicking_joints,
    random_joints,
    tree_forces,
)
from scipy.integrate import solve_ivp

import p3dof
from p3dof import P3dofError
from p3dof._base.errors import ModelError
from p3dof._base.markup import STIFFNESS, TIME_STEP
from p3dof.machine import description
from p3dof.machine.description.mechanism import Closure, Joint, JointLimits, Link, Mechanism, Placement
from p3dof.machine.description.mjcf_text import holding_forces, mjcf
from p3dof.machine.parameters import PAPER, SOLIDS, Body, Geometry, of_solids

mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[test]'")

MJCF = FILES / "p3dof_mjcf.xml"
SLIDES = list(MECHANISM.actuated)


@functools.cache
def urdf_model(fused):
    """The URDF as MuJoCo loads it, or with the links that it would fuse with their parents."""
    spec = mujoco.MjSpec.from_file(str(URDF))
    spec.compiler.fusestatic = fused
    return spec.compile()


@functools.cache
def mjcf_model():
    return mujoco.MjModel.from_xml_path(str(MJCF))


@pytest.fixture(params=["urdf", "mjcf"])
def model(request):
    """Every link of either file."""
    return urdf_model(False) if request.param == "urdf" else mjcf_model()


def names(model, what):
    return [getattr(model, what)(i).name for i in range(getattr(model, f"n{what}".replace("joint", "jnt")))]


def put(model, data, q, v=None, a=None):
    """Set joints by name; each has one coordinate."""
    for name, value in q.items():
        i = model.joint(name).id
        data.qpos[i] = value
        data.qvel[i] = 0.0 if v is None else v[name]
        data.qacc[i] = 0.0 if a is None else a[name]


def bodies(model):
    """Mass, mass centre and inertia of every link, in link axes."""
    found = {}
    for i, name in enumerate(names(model, "body")[1:], start=1):
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, model.body_iquat[i])
        axes = axes.reshape(3, 3)
        inertia = axes @ np.diag(model.body_inertia[i]) @ axes.T
        found[name] = (model.body_mass[i], model.body_ipos[i], inertia)
    return found


def placements(model, q):
    data = mujoco.MjData(model)
    put(model, data, q)
    mujoco.mj_kinematics(model, data)
    base = model.body("base_link").id
    np.testing.assert_array_equal(data.xpos[base], np.zeros(3))
    found = {}
    for i, name in enumerate(names(model, "body")[1:], start=1):
        found[name] = np.eye(4)
        found[name][:3, :3], found[name][:3, 3] = data.xmat[i].reshape(3, 3), data.xpos[i]
    return found


def equality_rows(data):
    return data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY


# --- both files --------------------------------------------------------------------------------------


def test_every_link_weighs_the_same(model):
    assert_bodies(bodies(model))


def test_the_plain_urdf_has_the_composites_of_its_fused_links():
    model, tree = urdf_model(True), pin.buildModelFromUrdf(str(URDF))
    found = bodies(model)
    assert list(found) == [joint.child for joint in MECHANISM.moving]
    assert sum(mass for mass, _, _ in found.values()) == pytest.approx(PAPER.bodies.mass, rel=1e-14)
    for name, inertia in zip(tree.names[1:], tree.inertias[1:], strict=True):
        mass, com, about = found[MOVING[name].child]
        assert mass == pytest.approx(inertia.mass, rel=1e-14)
        np.testing.assert_allclose(com, inertia.lever, rtol=0, atol=1e-14)
        np.testing.assert_allclose(about, inertia.inertia, rtol=0, atol=1e-12 * inertia.inertia.max())
    # Also of the paper, but for what rods and cross-bars exchange.
    for name, body in PAPER.bodies.items():
        if name not in ("crossbar_upper", "crossbar_lower", "rod_left", "rod_right"):
            np.testing.assert_allclose(found[name][0], body.mass, rtol=1e-14)
            np.testing.assert_allclose(found[name][2], body.inertia, rtol=0, atol=1e-12 * body.inertia.max())


def test_joints_have_the_same_names_axes_and_limits(model):
    assert names(model, "joint") == list(MOVING)
    assert names(model, "body")[1:] == list(LINKS)
    kinds = {mujoco.mjtJoint.mjJNT_SLIDE.value: "prismatic", mujoco.mjtJoint.mjJNT_HINGE.value: "revolute"}
    for name, joint in MOVING.items():
        found = model.joint(name)
        assert kinds[int(found.type[0])] == joint.kind
        assert model.body(found.bodyid[0]).name == joint.child
        assert model.body(model.body(joint.child).parentid[0]).name == joint.parent
        assert found.limited[0]
        np.testing.assert_array_equal(found.pos, np.zeros(3))
        np.testing.assert_allclose(found.axis, joint.axis, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.range, [joint.limits.lower, joint.limits.upper], rtol=1e-14)
        effort = joint.limits.effort
        np.testing.assert_allclose(model.jnt_actfrcrange[found.id], [-effort, effort], rtol=1e-14)
    for what in (model.dof_damping, model.dof_armature, model.dof_frictionloss, model.jnt_stiffness):
        assert not what.any()


@pytest.mark.parametrize("seed", range(5))
def test_links_are_where_they_should_be(model, seed):
    for q in (random_joints(seed), mimicking_joints(seed)):
        assert_placements(placements(model, q), q, 1e-13)


@pytest.mark.parametrize("seed", range(3))
def test_forces_of_the_open_tree_are_pinocchios(model, seed):
    q, v, a, forces = tree_forces(seed)
    data = mujoco.MjData(model)
    gravity, flags = model.opt.gravity.copy(), model.opt.disableflags
    try:
        model.opt.gravity, model.opt.disableflags = GRAVITY, mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        put(model, data, q, v, a)
        mujoco.mj_inverse(model, data)
    finally:
        model.opt.gravity, model.opt.disableflags = gravity, flags
    expected = np.array([forces[name] for name in MOVING])
    np.testing.assert_allclose(data.qfrc_inverse, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("load", [lambda: urdf_model(True), mjcf_model], ids=["urdf", "mjcf"])
def test_nothing_touches_anywhere_in_the_workspace(load):
    """Not even parent and child, which MuJoCo leaves out unless told otherwise."""
    model = load()
    data, flags = mujoco.MjData(model), model.opt.disableflags
    solids = sum(len(link.collisions) for link in LINKS.values())
    assert np.count_nonzero(model.geom_contype & model.geom_conaffinity) == solids
    try:
        model.opt.disableflags = flags | mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
        for q in closed_joints(3000):
            put(model, data, q)
            mujoco.mj_fwdPosition(model, data)
            assert data.ncon == 0
        touching = 0
        for seed in range(20):  # whereas in the open tree, without its loops, something does
            put(model, data, random_joints(seed, share=1.0) | {"slide_c": -0.2})
            mujoco.mj_fwdPosition(model, data)
            touching += data.ncon > 0
        assert touching > 0
    finally:
        model.opt.disableflags = flags


def test_the_urdf_mimics_as_a_joint_equality_and_has_no_other():
    model = urdf_model(True)
    assert model.neq == 2
    assert list(model.eq_type) == 2 * [mujoco.mjtEq.mjEQ_JOINT]
    data = mujoco.MjData(model)
    for q in closed_joints(50):
        put(model, data, q)
        mujoco.mj_fwdPosition(model, data)
        assert np.abs(data.efc_pos[equality_rows(data)]).max() < 1e-14


# --- the MJCF ----------------------------------------------------------------------------------------


def test_the_mjcf_is_up_to_date():
    assert description.check(PAPER, FILES, ("mjcf",)) == []


def test_loops_motors_and_options():
    model = mjcf_model()
    assert model.names[: model.names.index(b"\0")] == b"p3dof"
    assert names(model, "eq") == [closure.name for closure in MECHANISM.closures]
    assert list(model.eq_type) == 3 * [mujoco.mjtEq.mjEQ_CONNECT]  # none repeats what the loops do
    assert names(model, "actuator") == SLIDES
    assert list(model.actuator_trnid[:, 0]) == [model.joint(name).id for name in SLIDES]
    assert list(model.actuator_gaintype) == 3 * [mujoco.mjtGain.mjGAIN_FIXED]
    assert list(model.actuator_biastype) == 3 * [mujoco.mjtBias.mjBIAS_NONE]
    np.testing.assert_array_equal(model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0], np.ones(3))
    np.testing.assert_array_equal(model.actuator_ctrlrange, 3 * [[-PAPER.limits.force, PAPER.limits.force]])
    np.testing.assert_array_equal(model.opt.gravity, GRAVITY)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.opt.timestep == TIME_STEP


def test_solids_are_those_of_the_description():
    model = mjcf_model()
    expected = [
        (name, solid, group)
        for name in names(model, "body")[1:]
        for group, solids in ((2, LINKS[name].visuals), (3, LINKS[name].collisions))
        for solid in solids
    ]
    assert model.ngeom == len(expected)
    for i, (name, solid, group) in enumerate(expected):
        assert model.body(model.geom_bodyid[i]).name == name
        assert model.geom_group[i] == group
        assert (model.geom_contype[i], model.geom_conaffinity[i]) == ((0, 0) if group == 2 else (1, 1))
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, model.geom_quat[i])
        np.testing.assert_allclose(model.geom_pos[i], solid.placement.position, rtol=0, atol=1e-14)
        np.testing.assert_allclose(axes.reshape(3, 3), solid.placement.rotation, rtol=0, atol=1e-14)
        if group == 2:
            material = model.mat(model.geom_matid[i])
            assert material.name == solid.colour.name
            np.testing.assert_allclose(material.rgba, solid.colour.rgba, rtol=0, atol=1e-7)  # floats


def test_loops_are_closed_where_the_machine_is():
    model = mjcf_model()
    data = mujoco.MjData(model)
    worst = 0.0
    for q in closed_joints(1000):
        put(model, data, q)
        mujoco.mj_fwdPosition(model, data)
        assert np.count_nonzero(equality_rows(data)) == 9
        worst = max(worst, np.abs(data.efc_pos[equality_rows(data)]).max())
    assert worst < 1e-14


def projected(model, q, v, a):
    """Actuator forces of a motion that keeps the loops: [B Jᵀ] [f; λ] = what the open tree takes."""
    data = mujoco.MjData(model)
    put(model, data, q, v, a)
    mujoco.mj_inverse(model, data)
    tree = data.qfrc_inverse + data.qfrc_constraint  # MuJoCo's inverse subtracts what its soft loops give
    J = data.efc_J.reshape(data.nefc, model.nv)[equality_rows(data)]  # (9, 10)
    B = np.eye(model.nv)[:, model.actuator_trnid[:, 0]]
    A = np.hstack([B, J.T])
    found = np.linalg.lstsq(A, tree, rcond=1e-9)[0]
    assert np.abs(A @ found - tree).max() < 1e-10 * np.abs(tree).max()
    return found[: model.nu]


def test_forces_are_those_of_the_paper():
    result = closed_states(101)
    joints, model = result.joints, mjcf_model()
    rows = ({name: values[k] for name, values in columns(joints).items()} for k in range(101))
    found = np.array([projected(model, *(split(row, i) for i in range(3))) for row in rows])
    np.testing.assert_allclose(found, result.forces, rtol=0, atol=1e-13 * np.abs(result.forces).max())


def columns(joints):
    return {
        name: np.stack([joints.q[:, i], joints.v[:, i], joints.a[:, i]], axis=-1)
        for i, name in enumerate(joints.names)
    }


def split(row, order):
    return {name: value[order] for name, value in row.items()}


# --- loops kept --------------------------------------------------------------------------------------


@dataclass
class Run:
    """A simulation: states after every step, with that at the start; (steps + 1, 10)."""

    q: np.ndarray
    v: np.ndarray
    contacts: int

    @property
    def gap(self):
        """The largest distance of two points that a loop joins [m], by Pinocchio."""
        loop = p3dof.load().loop
        gaps = [np.linalg.norm(loop.closure_error(q).reshape(3, 3), axis=1).max() for q in self.q]
        return max(gaps)


def simulate(model, duration, forces, q=None, v=None):
    """Run MuJoCo under forces(t), which its integrator asks for at every stage of a step."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos, data.qvel = data.qpos if q is None else q, data.qvel if v is None else v
    states, contacts = [(data.qpos.copy(), data.qvel.copy())], 0

    def control(_model, data):
        data.ctrl[:] = forces(data.time)

    mujoco.set_mjcb_control(control)
    try:
        for _ in range(round(duration / model.opt.timestep)):
            mujoco.mj_step(model, data)
            states.append((data.qpos.copy(), data.qvel.copy()))
            contacts += data.ncon
    finally:
        mujoco.set_mjcb_control(None)
    assert data.time == pytest.approx(duration)  # it starts anew where it fails
    return Run(*(np.array(values) for values in zip(*states, strict=True)), contacts)


@functools.cache
def released(shares, duration):
    """Our own forward dynamics from home, at rest, under constant shares of the forces that hold it."""
    robot = p3dof.load()
    tau = np.array(shares) * holding_forces(MECHANISM)

    def rate(_t, x):
        return np.concatenate([x[10:], robot.loop.forward_dynamics(x[:10], x[10:], tau).a])

    times = np.arange(round(duration / TIME_STEP) + 1) * TIME_STEP
    x = solve_ivp(
        rate, (0, times[-1]), np.zeros(20), method="DOP853", t_eval=times, rtol=1e-11, atol=1e-13
    ).y.T
    assert np.abs(robot.loop.closure_error(x[-1, :10])).max() < 1e-12
    return tau, x[:, :10], x[:, 10:]


def stiffer(factor):
    """The file with steps shorter by a factor, and loops as stiff as these steps allow."""
    text = MJCF.read_text(encoding="utf-8")
    ours = f'solref="-{STIFFNESS:.15g} -{STIFFNESS**0.5:.15g}"'
    assert ours in text
    text = text.replace(ours, f'solref="-{factor**2 * STIFFNESS:.15g} -{factor * STIFFNESS**0.5:.15g}"')
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = TIME_STEP / factor
    return model


def tell(text):
    print(f"\n{text}")  # noqa: T201 - what was measured, for pytest -s


RELEASES = [(0.0, 0.0, 0.0), (0.8, 1.0, 1.1), (1.3, 0.9, 0.9), (0.9, 1.2, 0.8)]


@pytest.mark.parametrize("shares", RELEASES)
def test_released_from_home_it_moves_as_ours_does_and_stays_closed(shares):
    """Loops yield a little: MuJoCo carries at most .9999 of what would open one, a spring of 1e6/s² the rest.

    The gap is then 1e-10 s² of the acceleration that would open it, and angles differ by the gap over a crank
    of b = .05 m.
    """
    tau, q, v = released(shares, 0.15)
    run = simulate(mjcf_model(), 0.15, lambda _: tau)
    error, speed = np.abs(run.q - q).max(), np.abs(run.v - v).max()
    tell(
        f"{shares}: gap {run.gap:.1e} m; joints {error:.1e} of {np.abs(q).max():.2f} m or rad, "
        f"{speed:.1e} of {np.abs(v).max():.2f} per second"
    )
    assert run.contacts == 0
    if not any(shares):  # all falls together
        np.testing.assert_allclose(q[-1, [0, 2, 4]], GRAVITY[2] * 0.15**2 / 2, rtol=1e-12)
        assert max(run.gap, error, speed) < 1e-12
    assert run.gap < 3e-8
    assert error < 1e-7
    assert speed < 1e-4


def test_what_differs_is_the_softness_of_mujocos_loops():
    """The difference falls as the stiffness grows; extrapolated to rigid loops, the motion is ours."""
    tau, q, _ = released(RELEASES[1], 0.15)
    runs = [simulate(stiffer(factor), 0.15, lambda _: tau) for factor in (1, 2, 4)]
    found = [run.q[::factor] for run, factor in zip(runs, (1, 2, 4), strict=True)]
    errors = [float(np.abs(states - q).max()) for states in found]
    settled = slice(round(0.01 / TIME_STEP), None)  # the release itself makes the loops tremble
    rigid = np.abs((4 * found[2] - found[1]) / 3 - q)[settled].max()
    tell(f"joints {errors} m or rad, extrapolated {rigid:.1e}; gap {[float(run.gap) for run in runs]} m")
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.02)
    assert runs[0].gap / runs[2].gap == pytest.approx(16, rel=0.02)
    assert rigid < 2e-11


def test_driven_by_the_computed_forces_it_makes_the_papers_motion():
    """A second of it, from its start at 5 rad/s; forces at the ends and the middle of every step."""
    steps = round(1 / TIME_STEP)
    result = closed_states(2 * steps + 1)
    joints = result.joints
    assert joints.names == tuple(MOVING)
    run = simulate(
        mjcf_model(), 1.0, lambda t: result.forces[round(2 * t / TIME_STEP)], joints.q[0], joints.v[0]
    )
    error, speed = np.abs(run.q - joints.q[::2]).max(), np.abs(run.v - joints.v[::2]).max()
    tell(f"gap {run.gap:.1e} m; joints {error:.1e} m or rad, {speed:.1e} per second")
    assert run.contacts == 0
    assert run.gap < 1e-7
    assert error < 1e-6
    assert speed < 3e-4


def test_from_rest_it_makes_a_smooth_motion():
    """The pose (.05, .08, .4) in half a second; speed, acceleration and jerk are zero at both ends."""
    robot, duration, steps = p3dof.load(), 0.5, round(0.5 / TIME_STEP)
    s = np.linspace(0, 1, 2 * steps + 1)[:, None]
    travel = np.array([0.05, 0.08, 0.4])
    pose = travel * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    velocity = travel * 140 * s**3 * (1 - s) ** 3 / duration
    acceleration = travel * 420 * s**2 * (1 - s) ** 2 * (1 - 2 * s) / duration**2
    forces = robot.forces(pose, velocity, acceleration, method="virtual-power")
    run = simulate(mjcf_model(), duration, lambda t: forces[round(2 * t / TIME_STEP)])
    joints = robot.inverse_kinematics(pose[::2]).joints
    error = np.abs(run.q - np.stack([joints[name] for name in MOVING], axis=-1)).max()
    tell(f"gap {run.gap:.1e} m; joints {error:.1e} m or rad")
    assert run.contacts == 0
    assert run.gap < 1e-8
    assert error < 5e-8


def test_home_holds():
    model = mjcf_model()
    held = p3dof.load().forces(np.zeros(3), np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(model.key_ctrl[0], held, rtol=1e-13)
    assert held.sum() == pytest.approx(-GRAVITY[2] * PAPER.bodies.mass)
    np.testing.assert_array_equal(model.key_qpos[0], np.zeros(10))
    run = simulate(model, 1.0, lambda _: held)
    tell(f"after a second {np.abs(run.q).max():.1e} m or rad")
    assert np.abs(run.q).max() < 2e-8


def test_mujocos_own_settings_leave_a_millimetre():
    text = re.sub(r" *<equality solref.*\n", "", MJCF.read_text(encoding="utf-8"), count=1)
    tau, _, _ = released(RELEASES[1], 0.15)
    gap = simulate(mujoco.MjModel.from_xml_string(text), 0.15, lambda _: tau).gap
    assert 5e-4 < gap < 5e-3


# --- Pinocchio reads it back -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def read_back():
    model, points, frames = pin.buildModelAndConstraintsFromMJCF(str(MJCF))
    assert len(frames) == 0
    model.gravity.linear = GRAVITY  # its reader leaves out <option gravity>
    anchors = pin.StdVec_ConstraintModel()
    for point in points:
        anchors.append(pin.ConstraintModel(point))
    return model, anchors


def test_pinocchio_reads_the_same_tree(read_back):
    model, anchors = read_back
    tree = pin.buildModelFromUrdf(str(URDF))
    assert list(model.names) == list(tree.names)
    assert len(anchors) == 3
    for one, two in zip(model.inertias[1:], tree.inertias[1:], strict=True):
        assert one.mass == pytest.approx(two.mass, rel=1e-14)
        np.testing.assert_allclose(one.lever, two.lever, rtol=0, atol=1e-14)
        np.testing.assert_allclose(one.inertia, two.inertia, rtol=0, atol=1e-14 * two.inertia.max())
    for what in ("lowerPositionLimit", "upperPositionLimit", "upperEffortLimit"):
        np.testing.assert_array_equal(getattr(model, what), getattr(tree, what))
    data = model.createData()
    for seed in range(3):
        q = random_joints(seed)
        pin.framesForwardKinematics(model, data, np.array([q[name] for name in model.names[1:]]))
        found = {name: data.oMf[model.getFrameId(name, pin.FrameType.BODY)].homogeneous for name in LINKS}
        assert_placements(found, q, 1e-13)


def test_pinocchio_reads_the_same_loops(read_back):
    model, anchors = read_back
    data, datas = model.createData(), pin.StdVec_ConstraintData()
    for anchor in anchors:
        datas.append(anchor.createData())
    result = closed_states(51)
    joints = result.joints
    assert joints.names == tuple(model.names[1:])
    found = np.zeros((51, 3))
    for k, (q, v, a) in enumerate(zip(joints.q, joints.v, joints.a, strict=True)):
        tree = pin.rnea(model, data, q, v, a).copy()
        pin.forwardKinematics(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        for anchor, datum in zip(anchors, datas, strict=True):
            anchor.calc(model, data, datum)
            assert np.abs(datum.extract().constraint_position_error).max() < 1e-14
        J = pin.getConstraintsJacobian(model, data, anchors, datas)
        sizes = np.linalg.svd(J, compute_uv=False)
        assert np.count_nonzero(sizes > 1e-9 * sizes[0]) == model.nv - 3
        A = np.hstack([np.eye(model.nv)[:, [joints.names.index(name) for name in SLIDES]], J.T])
        found[k] = np.linalg.lstsq(A, tree, rcond=1e-9)[0][:3]
    np.testing.assert_allclose(found, result.forces, rtol=0, atol=1e-13 * np.abs(result.forces).max())


# --- other machines and names ------------------------------------------------------------------------


def massive(seeds):
    """Random machines that can give their markers a mass, cross-bars with a mass of their own among them."""
    for seed in seeds:
        machine = random_machine(seed)
        try:
            yield seed, machine, description.with_masses(description.describe(machine))
        except ModelError:
            continue


def assert_machine(parameters, mechanism, states):
    model = mujoco.MjModel.from_xml_string(mjcf(mechanism))
    assert model.body_mass[2:].sum() == pytest.approx(parameters.bodies.mass, rel=1e-13)
    np.testing.assert_allclose(model.opt.gravity, parameters.gravity, rtol=1e-14)
    robot = p3dof.load(parameters)
    motion = robot.mechanism_motion(states.pose, states.velocity, states.acceleration)
    forces = robot.forces(states.pose, states.velocity, states.acceleration, method="virtual-power")
    for k, force in enumerate(forces):
        q, v, a = (
            {name: values[k] for name, values in rate.items()}
            for rate in (motion.position, motion.velocity, motion.acceleration)
        )
        found = projected(model, q, v, a)
        np.testing.assert_allclose(found, force, rtol=0, atol=1e-11 * np.abs(force).max())


def test_random_machines_of_any_size_have_their_forces():
    seen = Counter()
    for seed, parameters, mechanism in massive(range(60)):
        states = random_states(parameters, seed, 5, drop=0.3, angle=0.2)
        assert_machine(parameters, mechanism, states)
        seen["massless" if seed % 3 == 0 else "massive"] += len(states.pose)
    assert seen["massive"] > 50
    assert seen["massless"] > 20


@pytest.mark.parametrize(
    "parameters",
    [SOLIDS, *(of_solids(Geometry(0.1 * s, 0.25 * s, 0.4 * s, 0.05 * s)) for s in (0.01, 0.1, 10, 1000))],
)
def test_solids_of_any_size(parameters):
    mechanism = description.with_masses(description.describe(parameters))
    assert_machine(parameters, mechanism, random_states(parameters, 0, 5, drop=0.3, angle=0.2))


def test_home_is_held_in_any_machine():
    for _, parameters, mechanism in itertools.islice(massive(range(60)), 20):
        robot = p3dof.load(parameters)
        if (
            np.linalg.cond(
                robot.jacobian(np.zeros(3), method="virtual-power") / [1, 1, parameters.geometry.L]
            )
            > 100
        ):
            continue
        held = robot.forces(np.zeros(3), np.zeros(3), np.zeros(3), method="virtual-power")
        np.testing.assert_allclose(holding_forces(mechanism), held, rtol=0, atol=1e-9 * np.abs(held).max())


def test_a_moving_link_without_mass_is_refused():
    with pytest.raises(ModelError, match="'crossbar_upper' has none") as raised:
        mjcf(description.describe(PAPER))
    assert isinstance(raised.value, P3dofError)


@pytest.mark.parametrize("name", ['a<b>&"c', "-- x -->", "é 中"])
def test_names_are_escaped(name):
    model = mujoco.MjModel.from_xml_string(mjcf(replace(MECHANISM, name=name)))
    assert model.names[: model.names.index(b"\0")].decode() == name
    limits, body = JointLimits(-1.0, 1.0, 1.0, 1.0), Body(1.0, np.zeros(3), np.full(3, 1e-3))
    odd = Mechanism(
        name,
        (Link("yes"), Link(name, body)),
        (Joint(name, "revolute", "yes", name, Placement(), [0, 0, 1], limits),),
        (Closure(name, "yes", name),),
        (name,),
        np.zeros(3),
    )
    model = mujoco.MjModel.from_xml_string(mjcf(odd))
    assert [names(model, what)[-1] for what in ("body", "joint", "actuator", "eq")] == 4 * [name]


def test_bytes_do_not_depend_on_the_run():
    code = (
        "import sys; from p3dof.machine.description import *; from p3dof.machine.parameters import PAPER;"
        "sys.stdout.buffer.write(texts(PAPER, ('mjcf',))['p3dof_mjcf.xml'].encode())"
    )
    runs = {
        subprocess.run(
            [sys.executable, "-c", code],
            check=True,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert runs == {mjcf(MECHANISM).encode()}
