"""Transmissions: coordinates and actuators behind a linkage, by closed forms, other layers, differences."""

import threading
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import (
    FOUR_BAR,
    FOUR_BAR_SIDECAR,
    PARALLELOGRAM_SIDECAR,
    ROD,
    differences,
    four_bar,
    four_bar_angles,
    joint,
    link,
    parallelogram,
    robot,
)
from example_robot_data.robots_loader import getModelPath
from gallery import GALLERY, gallery
from mujoco_opinion import null_space
from mujoco_robots import in_mujoco
from numpy.testing import assert_allclose, assert_array_equal
from other_robots import OUTSIDE, load

import p3dof
from p3dof._base.errors import AssemblyError, InputError, ModelError, ModelWarning, SingularityError
from p3dof.loops import ClosedLoopModel, Coupling, Sidecar
from p3dof.loops.compiled import build

ANKLE = ("ankle_pitch", "ankle_roll")
LEG = ("hip_pitch", "knee_motor", "left_motor", "right_motor")
CASES = {
    "ankle": ("leg", ANKLE, None),
    "knee": ("leg", ("knee",), None),
    "whole leg": ("leg", ("hip_pitch", "knee", *ANKLE), LEG),
    "five-bar": ("five_bar", ("right_elbow", "left_elbow"), None),
    "gripper": ("gripper", ("right_guide",), None),
    "rods": ("leg_with_rods", ("free_foot", "free_knee"), None),
}
PUBLIC = {
    "panda": ("panda", ("panda_finger_joint2",)),
    "knee belt": ("plus_leg_with_rotors", ("to_thigh_rotor",)),
    "leg of a plane": ("plus_planar_leg", ("driver_to_foot",)),
    "cassie": ("cassie", ("left-shin-tarsus-joint", "left-foot-op")),
    "ankle and knee": ("digit_like/robot.urdf", ("motor_hip_z", "free_knee", "free_foot1", "free_foot2")),
    "knee belt, outside": ("urdf_plus/mini_cheetah_leg.urdf", ("thigh_to_knee_rotor_j",)),
    "leg of a plane, outside": ("urdf_plus/planar_leg_linkage.urdf", ("driver_to_foot",)),
}
"""Robots of public files, or what stands in for them: mimic joints, a belt with rotors, linkages."""
each_case = pytest.mark.parametrize("case", CASES)


@pytest.fixture(scope="module")
def made():
    found = {}

    def of(case):
        if case not in found:
            name, coordinates, actuators = CASES[case]
            loop = gallery(name) if (GALLERY / f"{name}.urdf").is_file() else load(name)
            found[case] = loop.transmission(coordinates, actuators)
        return found[case]

    return of


def motions(one, count=12, spread=0.15, seed=0):
    """Motions of the coordinates about where the linkage is at home."""
    rng, side = np.random.default_rng(seed), one.joint
    size = np.where(side.slides, 0.05 * side.length, 1.0)
    x = side.settle.values(one.home[None]) + spread * size * rng.uniform(-1, 1, (count, len(side.names)))
    return x, size * rng.normal(size=x.shape), size * rng.normal(size=x.shape)


def places(one, names):
    return [int(one.robot.model.idx_vs[one.robot.model.getJointId(name)]) for name in names]


@each_case
def test_motions_are_those_of_the_general_layer_both_ways(made, case):
    one = made(case)
    x, v, a = motions(one)
    there = one.joint_to_actuator(x, v, a)
    back = one.actuator_to_joint(there.position, there.velocity, there.acceleration)
    assert not there.errors
    assert not back.errors
    for found, given in zip((back.position, back.velocity, back.acceleration), (x, v, a), strict=True):
        assert_allclose(found, given, rtol=0, atol=1e-12 * max(1, np.abs(there.acceleration).max()))
    units = there.jacobian @ back.jacobian
    assert_allclose(units, np.broadcast_to(np.eye(x.shape[1]), units.shape), rtol=0, atol=1e-12)
    own, other = places(one, one.coordinates), places(one, one.actuators)
    for i, q in enumerate(there.q):
        target = dict(zip(one.coordinates, x[i].tolist(), strict=True))
        state = one.robot.complete(target, v[i], a[i], guess=q)
        assert np.abs(one.robot.closure_error(q)).max() < 1e-12
        J, size = one.robot.closure_jacobian(q), np.abs(there.jacobian[i]).max()
        N = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :].T
        assert_allclose(N[other], there.jacobian[i] @ N[own], rtol=0, atol=1e-11 * size)
        assert_allclose(there.velocity[i], state.v[other], rtol=0, atol=1e-11 * np.abs(state.v).max())
        # Idle rods move otherwise there, which the actuators do not feel.
        assert_allclose(there.acceleration[i], state.a[other], rtol=0, atol=1e-9 * np.abs(state.a).max())


def cassie(name):
    """Cassie in a stance, with a stiff shin at the left; in the file the linkage of the foot is flat."""
    stance = {"tarsus-crank-joint": -1.5, "crank-rod-joint": 1.5, "foot-op": -1.5, "knee-op": -1.6}
    stance = {f"left-{joint}": angle for joint, angle in {**stance, "shin-tarsus-joint": 0.0}.items()}
    sidecar = Sidecar((), ("left-knee-op", "left-tarsus-crank-joint"), reference=stance)
    path = f"/{name}_description/robots/{name}_v2.sdf"
    return p3dof.load_robot(Path(getModelPath(path)) / path[1:], sidecar).lock({"left-knee-shin-joint": 0.0})


@pytest.mark.parametrize("case", [case for case, (name, _) in PUBLIC.items() if "/" not in name or OUTSIDE])
def test_robots_of_public_files_are_mapped_both_ways(case):
    name, coordinates = PUBLIC[case]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # what they say of visuals and materials
        own_way = {"panda": p3dof.load_robot, "cassie": cassie}
        loop = own_way.get(name, load)(name)
    one = loop.transmission(coordinates)
    x, v, a = motions(one, 20, 0.05)
    there = one.joint_to_actuator(x, v, a)
    back = one.actuator_to_joint(there.position, there.velocity, there.acceleration)
    assert not {**there.errors, **back.errors}
    # How much rounding is felt: where the linkage is nearly singular, more.
    worst = np.linalg.cond(there.jacobian).max() * max(1.0, np.abs(there.acceleration).max())
    worst /= min(there.margin.min(), back.margin.min())
    for found, given in zip((back.position, back.velocity, back.acceleration), (x, v, a), strict=True):
        assert_allclose(found, given, rtol=0, atol=1e-13 * worst)
    own, other = places(one, one.coordinates), places(one, one.actuators)
    for i, q in enumerate(there.q):
        J = one.robot.closure_jacobian(q)
        N = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :].T
        size = np.abs(there.jacobian[i]).max()
        assert_allclose(N[other], there.jacobian[i] @ N[own], rtol=0, atol=1e-9 * size)


@each_case
def test_speeds_and_accelerations_are_rates_of_positions(made, case):
    one = made(case)
    (x,), (v,), (a,) = motions(one, 1)
    there = one.joint_to_actuator(x, v, a)
    back = (there.position, there.velocity, there.acceleration)
    for go, (p, s, b) in ((one.joint_to_actuator, (x, v, a)), (one.actuator_to_joint, back)):
        first, second = differences(lambda t: go(p + t * s + t * t / 2 * b, near=there.q).position)  # noqa: B023
        found = go(p, s, b)
        assert_allclose(found.velocity, first, rtol=0, atol=1e-9 * max(1, np.abs(second).max()))
        assert_allclose(found.acceleration, second, rtol=0, atol=1e-6 * max(1, np.abs(second).max()))


def test_a_four_bar_is_its_closed_form_over_many_turns():
    loop = ClosedLoopModel.from_urdf(four_bar(*FOUR_BAR, kind="continuous"), FOUR_BAR_SIDECAR)
    one = loop.around({"crank_joint": 1.0}).transmission(["rocker_joint"])
    crank = np.linspace(-3, 3, 40)
    rocker = np.array([four_bar_angles(theta, *FOUR_BAR)[1] for theta in crank])
    found = one.actuator_to_joint(crank[:, None], np.ones((40, 1)), np.zeros((40, 1)))
    rates = [differences(lambda t, at=at: four_bar_angles(at + t, *FOUR_BAR)[1]) for at in crank]
    assert_allclose(found.position[:, 0], rocker, rtol=0, atol=1e-13)
    assert_allclose(found.velocity[:, 0], [rate for rate, _ in rates], rtol=0, atol=1e-10)
    assert_allclose(found.acceleration[:, 0], [rate for _, rate in rates], rtol=0, atol=1e-7)
    (to_crank, to_rocker), last = one.bind(), 1.0
    for turns in (1.0, 7.5, 20.0, -3.0):  # the crank turns, and what is bound counts
        for at in [*np.arange(last, turns, np.copysign(0.9, turns - last)).tolist(), turns]:
            to_rocker.inputs["position"][:] = at
            to_rocker.run()
            assert to_rocker.status == 0
        last = turns
        expected = four_bar_angles(turns, *FOUR_BAR)[1]
        assert_allclose(to_rocker.outputs["position"], expected, rtol=0, atol=1e-12)
    to_crank.inputs["position"][:] = to_rocker.outputs["position"]
    to_crank.run()
    assert_allclose(to_crank.outputs["position"], turns, rtol=0, atol=1e-12)


def test_a_differential_wrist_is_that_of_its_gears():
    """Two motors side by side: their mean is pitch, half of their difference roll."""
    axes = {"a": "base", "b": "base", "pitch": "base", "roll": "pitch_link"}
    links = [link("base"), *(link(f"{name}_link", ROD) for name in axes)]
    joints = [
        joint(name, parent, f"{name}_link", axis=(1, 0, 0) if name == "roll" else (0, 1, 0))
        for name, parent in axes.items()
    ]
    halves = {"pitch": (("a", 0.5), ("b", 0.5)), "roll": (("a", 0.5), ("b", -0.5))}
    gears = tuple(Coupling(name, None, (0.0,), name, parts) for name, parts in halves.items())
    one = ClosedLoopModel.from_urdf(
        robot(*links, *joints), Sidecar((), ("a", "b"), couplings=gears)
    ).transmission(["pitch", "roll"])
    x, v, a = np.random.default_rng(5).normal(size=(3, 20, 2))
    found, G = one.joint_to_actuator(x, v, a), np.array([[1.0, 1.0], [1.0, -1.0]])
    for values, given in zip((found.position, found.velocity, found.acceleration), (x, v, a), strict=True):
        assert_allclose(values, given @ G, rtol=0, atol=1e-14)
    assert_allclose(one.actuator_forces(found.q, v), v @ G / 2, rtol=0, atol=1e-14)
    K = np.diag([3.0, 5.0])
    assert_allclose(one.actuator_gains(found.q[0], K)[0], G @ K @ G / 4, rtol=0, atol=1e-14)
    far = np.array([[9.0, -2.0], [-9.0, 1.0]])  # rad: turns of a motor
    assert_allclose(one.joint_to_actuator(far).position, far @ G, rtol=0, atol=1e-14)


@each_case
def test_forces_have_the_same_power_on_both_sides(made, case):
    one, rng = made(case), np.random.default_rng(1)
    x, v, _ = motions(one)
    there, f = one.joint_to_actuator(x, v), rng.normal(size=x.shape)
    tau = one.actuator_forces(there.q, f)
    assert_allclose((tau * there.velocity).sum(1), (f * v).sum(1), rtol=0, atol=1e-11 * np.abs(tau).max())
    assert_allclose(one.joint_forces(there.q, tau), f, rtol=0, atol=1e-12 * np.abs(tau).max())
    assert_allclose(
        one.joint_forces(there.q[0], np.eye(x.shape[1])), there.jacobian[0], rtol=1e-11, atol=1e-12
    )


def test_mujoco_has_the_same_speeds_and_weights(made):
    one = made("ankle")
    loop = gallery("leg")
    other = in_mujoco(loop, GALLERY / "leg.urdf")
    import mujoco

    data = mujoco.MjData(other.model)
    held = ("hip_yaw", "hip_roll", "hip_pitch", "knee_motor")
    row = {name: int(other.model.joint(name).dofadr[0]) for name in (*ANKLE, *held, *one.actuators)}
    x, *_ = motions(one, 5)
    there = one.joint_to_actuator(x)
    weights = one.joint_dynamics(there.q).forces
    for i, q in enumerate(there.q):
        full = np.array(loop.regular_configuration)
        for k in range(1, one.robot.model.njoints):
            joint, of = (
                one.robot.model.joints[k],
                loop.model.joints[loop.model.getJointId(one.robot.model.names[k])],
            )
            full[of.idx_q : of.idx_q + of.nq] = q[joint.idx_q : joint.idx_q + joint.nq]
        data.qpos[:] = other.qpos(full)
        mujoco.mj_forward(other.model, data)
        J = np.zeros((data.nefc, other.model.nv))
        if mujoco.mj_isSparse(other.model):
            mujoco.mju_sparse2dense(J, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        else:
            J = data.efc_J.reshape(-1, other.model.nv)[: data.nefc].copy()
        N = null_space(J[data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY])
        asked = np.eye(6)[:, :2]
        moves = N @ np.linalg.lstsq(N[[row[name] for name in (*ANKLE, *held)]], asked, rcond=None)[0]
        assert_allclose(there.jacobian[i], moves[[row[name] for name in one.actuators]], rtol=0, atol=1e-9)
        assert_allclose(weights[i], moves.T @ data.qfrc_bias, rtol=0, atol=1e-9)


@each_case
def test_gains_make_small_motions_agree_to_first_order(made, case):
    one, rng = made(case), np.random.default_rng(2)
    (x,), (v,), _ = motions(one, 1)
    n, there = len(x), one.joint_to_actuator(x)
    A = rng.normal(size=(n, n))
    K, D, f = A @ A.T + np.eye(n), np.diag(rng.uniform(1, 2, n)), 5 * rng.normal(size=n)
    Ky, Dy = one.actuator_gains(there.q, K, D, f)
    fy = one.actuator_forces(there.q, f)

    def felt(t):  # what the actuators' controller gives the coordinates, moved a little
        at = one.joint_to_actuator(x + t * v, v, near=there.q)
        return one.joint_forces(at.q, fy - Ky @ (at.position - there.position) - t * (Dy @ at.velocity))

    size = 1e-8 * max(1, np.abs(Ky).max()) * max(1, np.abs(there.jacobian).max()) ** 2
    assert_allclose(differences(felt)[0], -K @ v - D @ v, rtol=0, atol=size)
    for found, given in zip(one.joint_gains(there.q, Ky, Dy, fy), (K, D), strict=True):
        assert_allclose(found, given, rtol=0, atol=1e-11 * max(1, np.abs(Ky).max()))
    diagonal = one.actuator_gains(there.q, np.ones(n))
    assert_allclose(
        diagonal[0], one.actuator_gains(there.q, np.eye(n), np.zeros((n, n)))[0], rtol=0, atol=1e-14
    )
    assert not diagonal[1].any()
    wrong = one.actuator_gains(there.q, K, D)[0]  # without the forces that are borne
    bent = np.abs(wrong - Ky).max() > 1e-3
    assert bent == (case != "gripper")  # whose guides slide in proportion


@each_case
def test_dynamics_are_those_of_the_whole(made, case):
    one = made(case)
    x, v, a = motions(one, 4)
    there = one.joint_to_actuator(x, v, a)
    motors = places(one, one.actuators)
    joint = one.joint_dynamics(there.q, v, a)
    actuator = one.actuator_dynamics(there.q, there.velocity, there.acceleration)
    assert_allclose(one.actuator_forces(there.q, joint.forces), actuator.forces, rtol=1e-10, atol=1e-10)
    J = there.jacobian
    mapped = np.swapaxes(J, 1, 2) @ actuator.inertia @ J
    assert_allclose(joint.inertia, mapped, rtol=0, atol=1e-11 * np.abs(mapped).max())
    for i, q in enumerate(there.q):
        idle = one.robot.mobility(q) - x.shape[1]
        if not idle:  # rods that spin have speeds of their own there
            names = [one.robot.model.names[one.robot.model.getJointId(name)] for name in one.coordinates]
            minimal = one.robot.minimal_dynamics(q, coordinates=names)
            assert_allclose(
                joint.inertia[i], minimal.mass_matrix, rtol=0, atol=1e-11 * np.abs(mapped[i]).max()
            )
            state = one.robot.complete(dict(zip(names, x[i].tolist(), strict=True)), v[i], a[i], guess=q)
            tau = one.robot.inverse_dynamics(q, state.v, state.a).tau
            order = [one.robot.actuated.index(name) for name in one.actuators]
            assert_allclose(actuator.forces[i], tau[order], rtol=1e-9, atol=1e-9)
    assert len(motors) == x.shape[1]


def test_a_serial_model_and_the_linkage_are_the_whole(made):
    one = made("ankle")
    x, v, a = motions(one, 4)
    there = one.joint_to_actuator(x, v, a)
    model, home = one.robot.model, one.home
    others = [i for i in range(1, model.njoints) if model.names[i] not in ANKLE]
    for i in others:  # what has no mass is no part of it
        model = model.copy()
        model.inertias[i] = pin.Inertia.Zero()
    serial = pin.buildReducedModel(model, others, home)
    data, linkage = serial.createData(), one.linkage_dynamics(there.q, v, a)
    whole, rotors = one.joint_dynamics(there.q, v, a), np.zeros((4, 2, 2))
    for i in range(4):
        own = pin.rnea(serial, data, x[i], v[i], a[i]), pin.crba(serial, data, x[i])
        M = np.triu(own[1]) + np.triu(own[1], 1).T
        assert_allclose(linkage.forces[i] + own[0], whole.forces[i], rtol=0, atol=1e-12)
        assert_allclose(linkage.inertia[i] + M + rotors[i], whole.inertia[i], rtol=0, atol=1e-13)


def test_friction_and_rotors_of_actuators_are_the_linkages():
    loop = gallery("leg")
    plain = loop.transmission(ANKLE)
    other = loop.copy()
    armature = np.array(other.model.armature)
    for name in plain.actuators:
        armature[other.model.idx_vs[other.model.getJointId(name)]] = 0.02
    other.model.armature = armature
    heavy = other.transmission(ANKLE)
    x, *_ = motions(plain, 3)
    there = plain.joint_to_actuator(x)
    more = heavy.linkage_dynamics(there.q).inertia - plain.linkage_dynamics(there.q).inertia
    J = there.jacobian
    assert_allclose(more, 0.02 * np.swapaxes(J, 1, 2) @ J, rtol=0, atol=1e-14)


def test_within_the_limits_of_joints_nothing_fails(made):
    one = made("ankle")
    model = one.robot.model
    at = [model.joints[model.getJointId(name)].idx_q for name in ANKLE]
    ends = np.array(model.lowerPositionLimit)[at], np.array(model.upperPositionLimit)[at]
    x = np.stack(np.meshgrid(*np.linspace(*ends, 21).T), axis=-1).reshape(-1, 2)
    there = one.joint_to_actuator(x)
    assert not there.errors
    assert there.margin.min() > 0.1
    forces = one.actuator_forces(there.q, [1.0, 1.0])
    assert np.isfinite(forces).all()
    back = one.actuator_to_joint(there.position)
    assert_allclose(back.position, x, rtol=0, atol=1e-12)
    assert back.margin.min() > 0.1


def test_limits_of_effort_are_a_polytope(made):
    one = made("ankle")
    q = one.joint_to_actuator(motions(one, 3)[0]).q
    limits = one.force_limits(q)
    largest = np.array(one.robot.model.upperEffortLimit)[places(one, one.actuators)]
    for A, corners, at in zip(limits.A, limits.vertices, q, strict=True):
        assert (limits.b[:, None] * (1 + 1e-12) >= A @ corners.T).all()
        assert (np.isclose(A @ corners.T, limits.b[:, None], rtol=1e-12).sum(axis=0) == 2).all()
        assert_allclose(
            np.abs(one.actuator_forces(at, corners)), np.broadcast_to(largest, (4, 2)), rtol=1e-12
        )
        edges = np.roll(corners, -1, axis=0) - corners
        turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
        assert (np.sign(turns) == np.sign(turns[0])).all()  # in their order around it
    free = one.robot.copy()
    free.model.upperEffortLimit = np.full(free.model.nv, np.inf)
    with pytest.raises(ModelError, match="not all of left_motor, right_motor have a limit of effort"):
        free.transmission(ANKLE).force_limits(q[0])


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler is installed")
@each_case
def test_what_is_bound_is_what_many_samples_are(made, case):
    one = made(case)
    x, v, a = motions(one, 30)
    there = one.joint_to_actuator(x, v, a)
    forth, back = one.bind()
    for i in range(len(x)):
        for key, value in zip(forth.inputs, (x[i], v[i], a[i]), strict=True):
            forth.inputs[key][:] = value
        forth.run()
        assert forth.status == 0
        assert forth.q is not None
        for key in ("position", "velocity", "acceleration", "jacobian"):
            size = max(1.0, np.abs(getattr(there, key)[i]).max())
            assert_allclose(
                forth.outputs[key], getattr(there, key)[i], rtol=0, atol=1e-11 * size, err_msg=key
            )
        assert forth.outputs["margin"][0] > 0.0
        assert forth.outputs["gap"][0] < 1e-12
        for key in back.inputs:
            back.inputs[key][:] = forth.outputs[key]
        back.run()
        assert back.status == 0
        assert_allclose(back.outputs["position"], x[i], rtol=0, atol=1e-12)
        assert_allclose(
            back.outputs["acceleration"], a[i], rtol=0, atol=1e-11 * max(1, np.abs(a[i]).max()) ** 2
        )
    before = np.array(forth.q), np.array(forth.outputs["position"])
    for wrong in (np.nan, np.inf, 1e3):
        forth.inputs["position"][:] = wrong
        forth.run()
        assert forth.status == 1
    assert_allclose(forth.q, before[0], rtol=0, atol=0)
    assert_allclose(forth.outputs["position"], before[1], rtol=0, atol=0)


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler is installed")
def test_a_way_that_takes_too_many_pieces_does_not_end_well():
    """Towards a dead point pieces are halved: they may run out after one that succeeded."""
    loop = ClosedLoopModel.from_urdf(four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR)
    one = loop.around({"crank_joint": 1.0}).transmission(["rocker_joint"])
    forth, _ = one.bind()
    (home,), seen = one.positions("joint", one.home), []
    target = home + np.linspace(0.02, 3.0, 300)
    errors = one.joint_to_actuator(target[:, None]).errors
    for value in target:
        forth.inputs["position"][:] = home
        forth.run()
        assert forth.status == 0
        forth.inputs["position"][:] = value
        forth.run()
        seen.append(forth.status)
    assert [i for i, status in enumerate(seen) if status] == [*errors]
    assert 100 < len(errors) < 200


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler is installed")
def test_what_is_bound_belongs_to_a_thread(made):
    forth, _ = made("knee").bind()
    forth.inputs["position"][:] = 0.9
    forth.run()
    told = []

    def run():
        with pytest.raises(InputError, match="bind one in each thread"):
            forth.run()
        told.append(True)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert told


def test_a_singular_position_ends_a_way_and_no_branch_is_changed():
    """Behind the dead centre of a crank, the rocker comes back: its angle belongs to two of the crank."""
    loop = ClosedLoopModel.from_urdf(four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR).around({"crank_joint": 1.0})
    one = loop.transmission(["rocker_joint"])
    ground, crank, coupler, rocker = FOUR_BAR
    reach = [coupler + crank, coupler - crank]  # of the crank's joint to the rocker's end, at dead centres
    low, high = (np.arccos((ground**2 + x * x - rocker**2) / (2 * ground * x)) for x in reach)
    high += np.pi
    cranks = np.linspace(-2, 4, 601)
    rockers = np.array([four_bar_angles(theta, *FOUR_BAR)[1] for theta in cranks])
    found = one.joint_to_actuator(rockers[:, None])
    assert 0 < len(found.errors) < 601
    good = np.setdiff1d(np.arange(601), list(found.errors))
    assert ((found.position[good, 0] > low) & (found.position[good, 0] < high)).all()
    back = one.actuator_to_joint(found.position[good])
    assert_allclose(back.position[:, 0], rockers[good], rtol=0, atol=1e-10)
    assert np.isnan(found.position[list(found.errors)]).all()
    assert {type(error) for error in found.errors.values()} <= {AssemblyError, SingularityError}
    with pytest.raises(AssemblyError, match=r"does not reach rocker_joint=0\.2"):
        one.joint_to_actuator([0.2])
    dead = one.actuator_to_joint([low + 1e-9])
    with pytest.raises(SingularityError, match="near a singular configuration: margin"):
        one.joint_forces(dead.q, [1.0])
    many = one.joint_forces([dead.q, found.q[good[0]]], [1.0])
    assert np.isnan(many[0, 0])
    assert np.isfinite(many[1, 0])
    assert abs(one.actuator_forces(dead.q, [1.0])[0]) < 1e-3  # there the crank feels no torque of the rocker


def test_joints_that_nothing_ties_are_locked_where_the_robot_is():
    loop = gallery("leg")
    bent = loop.around({"hip_roll": 0.3, "knee": 1.1})
    at, there = (one.transmission(ANKLE) for one in (loop, bent))
    assert set(at.robot.model.names) == {
        "universe",
        *ANKLE,
        "left_motor",
        "left_ball",
        "right_motor",
        "right_ball",
    }
    x, *_ = motions(at, 3)
    one, other = at.joint_to_actuator(x), there.joint_to_actuator(x)
    assert_allclose(one.position, other.position, rtol=0, atol=1e-12)  # the linkage is in the shank
    assert np.abs(at.joint_dynamics(one.q).forces - there.joint_dynamics(other.q).forces).max() > 1e-2


def test_a_linkage_of_any_size_has_the_same_angles():
    found = []
    for size in (1.0, 1e-4, 1e3):
        loop = ClosedLoopModel.from_urdf(four_bar(*(size * x for x in FOUR_BAR)), FOUR_BAR_SIDECAR)
        one = loop.around({"crank_joint": 1.0}).transmission(["rocker_joint"])
        found.append(one.joint_to_actuator([1.45], [1.0], [0.0]))
    for other in found[1:]:
        assert_allclose(other.position, found[0].position, rtol=0, atol=1e-10)
        assert_allclose(other.acceleration, found[0].acceleration, rtol=1e-9)


def test_without_a_compiler_the_numbers_are_the_same(made):
    one, other = made("ankle"), gallery("leg").transmission(ANKLE, level="numpy")
    x, v, a = motions(one, 3)
    q = one.joint_to_actuator(x, v, a).q
    for name in ("position", "velocity", "acceleration", "jacobian"):  # rods that spin stop anywhere
        values = (getattr(each.joint_to_actuator(x, v, a), name) for each in (one, other))
        assert_allclose(*values, rtol=0, atol=1e-12)
    gains = (each.actuator_gains(q, [50.0, 40.0], [1.0, 2.0], [3.0, -4.0])[0] for each in (one, other))
    assert_allclose(*gains, rtol=0, atol=1e-11)
    with pytest.raises(ModelError, match="bind needs a C compiler"):
        other.bind()


def test_a_trunk_that_tilts_and_accelerates_is_another_gravity(made):
    """What the motors bear there is what Newton and Euler say of the whole robot on a free base."""
    one, leg = made("ankle"), gallery("leg")
    free = p3dof.load_robot(GALLERY / "leg.urdf", root_joint=pin.JointModelFreeFlyer())
    model, home, linkage = free.model, leg.regular_configuration, one.robot.model
    rng, still = np.random.default_rng(3), np.zeros(2)
    for x in motions(one, 3)[0]:
        q = one.joint_to_actuator(x).q
        R, push = pin.exp3(rng.normal(size=3)), rng.normal(size=3)
        whole, a = pin.neutral(model), np.zeros(model.nv)
        whole[:7] = pin.SE3ToXYZQUAT(pin.SE3(R, rng.normal(size=3)))
        for source, values in ((leg.model, home), (linkage, q)):
            for name in list(source.names)[1:]:
                there, here = model.joints[model.getJointId(name)], source.joints[source.getJointId(name)]
                whole[there.idx_q : there.idx_q + there.nq] = values[here.idx_q : here.idx_q + here.nq]
        a[:3] = R.T @ push
        needed = pin.rnea(model, model.createData(), whole, np.zeros(model.nv), a)
        J = one.robot.closure_jacobian(q)
        N = np.linalg.svd(J)[2][one.robot.rank(q) :].T
        N = N @ np.linalg.pinv(N[places(one, one.actuators)])
        at = [
            k
            for name in list(linkage.names)[1:]
            for k in range(model.nv)
            if 0 <= k - model.joints[model.getJointId(name)].idx_v < model.joints[model.getJointId(name)].nv
        ]
        gravity = R.T @ (model.gravity.linear - push)
        found = one.actuator_dynamics(q, still, still, gravity)
        assert_allclose(found.forces, N.T @ needed[at], rtol=0, atol=1e-11 * np.abs(needed[at]).max())
        assert np.abs(found.forces - one.actuator_dynamics(q).forces).max() > 0.005
    many = one.actuator_dynamics(np.tile(q, (3, 1)), gravity=np.array([gravity, gravity, [0, 0, -9.81]]))
    assert_allclose(many.forces[:2], np.tile(found.forces, (2, 1)), rtol=0, atol=1e-12)


def test_many_positions_are_the_same_on_any_number_of_threads(made, monkeypatch):
    """Near each other, far apart, and out of reach in between: to the last bit, and as those of NumPy."""
    one, rng = made("ankle"), np.random.default_rng(1)
    near = 0.3 * np.sin(np.linspace([0, 1], [20, 31], 5000))
    x = np.where(rng.random((5000, 1)) < 0.9, near, rng.uniform(-1.6, 1.6, (5000, 2)))
    found = []
    for threads in ("1", "3"):
        monkeypatch.setenv("P3DOF_THREADS", threads)
        found.append(one.joint_to_actuator(x))
    assert_array_equal(found[0].q, found[1].q)
    assert 0 < len(found[0].errors) < 400
    other = gallery("leg").transmission(ANKLE, level="numpy").joint_to_actuator(x)
    assert {*found[0].errors} <= {*other.errors}  # which goes fewer ways
    good = np.setdiff1d(np.arange(5000), [*other.errors])
    assert len(other.errors) - len(found[0].errors) < 5
    assert_allclose(found[0].position[good], other.position[good], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["motion", "close", "forces", "gains", "dynamics"])
def test_traced_functions_run_in_jax(made, name):
    """Compiled, vectorised and differentiated there; its derivatives are those of differences."""
    jax = pytest.importorskip("jax", reason="jax not installed")
    one, rng = made("ankle"), np.random.default_rng(4)
    q = one.joint_to_actuator(motions(one, 3)[0]).q
    with jax.enable_x64(True):
        call = one.traced("joint", name, jax.numpy)
        given = [
            q,
            *(
                rng.normal(size=(3, size))
                for key, size in one.joint.function(name).inputs.items()
                if key != "q"
            ),
        ]
        found = jax.jit(jax.vmap(call))(*given)
        expected = one.traced("joint", name)(*given)
        for key, value in expected.items():
            assert_allclose(
                found[key], value, rtol=0, atol=1e-12 * max(1.0, np.abs(value).max()), err_msg=key
            )
        key, along = next(iter(expected)), rng.normal(size=q.shape)
        _, tangent = jax.jvp(lambda x: call(x, *given[1:])[key], (q,), (along,))
    first, _ = differences(lambda t: one.traced("joint", name)(q + t * along, *given[1:])[key], h=1e-3)
    assert_allclose(tangent, first, rtol=0, atol=1e-7 * max(1.0, np.abs(first).max()))


BAD = {
    "ankle": (InputError, "coordinates: expected several names, got 'ankle'"),
    3: (InputError, "coordinates: expected several names, got 3"),
    (): (InputError, "coordinates: expected at least one joint"),
    ("knee", "knee"): (InputError, "coordinates: a joint is named twice"),
    ("ankle",): (ModelError, "transmission: the joint 'ankle' does not exist; did you mean"),
    ("left_ball",): (ModelError, "expected joints with one degree of freedom, 'left_ball' has 3"),
    ("ankle_pitch",): (
        ModelError,
        "as many actuators as coordinates: for ankle_pitch there are left_motor, right",
    ),
    ("hip_yaw", "ankle_roll"): (
        ModelError,
        "there are hip_yaw, left_motor, right_motor; name more coordinates",
    ),
}


@pytest.mark.parametrize("names", BAD, ids=str)
def test_what_is_no_transmission_is_told(names):
    error, message = BAD[names]
    with pytest.raises(error, match=message):
        gallery("leg").transmission(names)


def test_sides_that_do_not_determine_each_other_are_told():
    leg = gallery("leg")
    with pytest.raises(
        ModelError, match="knee do not determine the other side; the linkage of hip_yaw, knee"
    ):
        leg.transmission(["knee"], ["hip_yaw"])
    with pytest.raises(
        ModelError, match=r"depend on each other; the linkage of .* has 1 free motions, of which they"
    ):
        leg.transmission(["knee", "knee_motor"], ["knee", "knee_motor"])
    flat = ClosedLoopModel.from_urdf(parallelogram(), PARALLELOGRAM_SIDECAR)
    assert flat.transmission(["right_joint"]).joint_to_actuator([0.3]).position == pytest.approx(
        0.3, abs=1e-14
    )


def test_a_linkage_that_is_locked_but_where_it_stands_is_told():
    """A triangle of three joints, one of them a ball, drawn flat: it can move there alone."""
    model, body = pin.Model(), pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))
    for parent, kind, x in (
        (0, pin.JointModelRY(), 0.0),
        (1, pin.JointModelSpherical(), 0.2),
        (0, pin.JointModelRY(), 0.5),
    ):
        model.addJoint(parent, kind, pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), "abc"[model.njoints - 1])
        model.appendBodyToJoint(model.njoints - 1, body, pin.SE3.Identity())
    for name, carrier, x in (("rod", 2, 0.1), ("rocker", 3, -0.2)):
        place = pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
        model.addFrame(pin.Frame(name, carrier, 0, place, pin.FrameType.OP_FRAME))
    flat = ClosedLoopModel(model, Sidecar(closures=[p3dof.Closure("rod", "rocker", "6d")], actuated=["a"]))
    with pytest.raises(ModelError, match="transmission: a do not determine the motion: the loops lock"):
        flat.transmission(["a"])


def test_bad_arguments_are_told(made):
    one = made("ankle")
    q = one.home
    for call, message in (
        (lambda: one.joint_to_actuator([0.1]), r"position: expected shape \(2,\) or \(N, 2\), got \(1,\)"),
        (lambda: one.joint_to_actuator([[0.1, 0.0]], [0.0, 0.0]), r"velocity: expected shape \(1, 2\), got"),
        (lambda: one.joint_to_actuator([0.1, np.nan]), "expected finite numbers, sample 0 has others"),
        (lambda: one.joint_to_actuator(["a", 0.0]), "position: expected real numbers"),
        (lambda: one.joint_forces(q[:5], [0.0, 0.0]), r"q: expected shape \(12,\)"),
        (lambda: one.joint_forces(q + 0.01, [0.0, 0.0]), "q: the loops are open by .* at configuration 0"),
        (lambda: one.joint_forces(q, [0.0]), r"forces: expected shape \(2,\)"),
        (
            lambda: one.joint_gains(q, np.eye(3)),
            r"stiffness: expected shape \(2,\), \(2, 2\) or \(N, 2, 2\), got",
        ),
        (lambda: one.joint_gains(q, np.zeros((1, 2, 2, 2))), "stiffness: expected shape"),
    ):
        with pytest.raises(InputError, match=message):
            call()
    for wrong in (("rod", "motion"), ("joint", "step")):
        with pytest.raises(InputError, match="traced: expected 'joint' or 'actuator' and one of motion"):
            one.traced(*wrong)
    x = motions(one, 3)[0]
    x[1] = np.nan
    some = one.joint_to_actuator(x)
    assert list(some.errors) == [1]
    assert np.isnan(some.position[1]).all()
    forces = one.actuator_forces(some.q, [1.0, 2.0])  # what failed stays so
    assert np.isnan(forces[1]).all()
    assert np.isfinite(forces[[0, 2]]).all()
    again = one.actuator_to_joint(some.position)
    assert isinstance(again.errors[1], InputError)
    assert repr(one) == "Transmission(ankle_pitch, ankle_roll <-> left_motor, right_motor)"
