"""Any robot written as MJCF: MuJoCo has the same tree, forces and motions, and so has what is read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import closed_loop_robots as robots
import closure_robots as kinds
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from other_robots import STAND_INS, load, others
from scipy.linalg import qr

mujoco = pytest.importorskip("mujoco")

from mujoco_opinion import Opinion, agree, coordinates  # noqa: E402
from mujoco_texts import GRIPPER, TENDONS, without_meshes  # noqa: E402

import p3dof  # noqa: E402
from p3dof._base.errors import InputError, ModelError, ModelWarning  # noqa: E402
from p3dof.loops import ClosedLoopModel, Closure, Coupling, JointData, Sidecar  # noqa: E402
from p3dof.loops.sidecar import KINDS  # noqa: E402
from p3dof.loops.writers.mjcf import text  # noqa: E402

GALLERY = sorted((ROOT / "docs/_static/gallery").glob("*.urdf"))
CARRIED = ("slider", "cylindrical", "planar")


def solid(generator: np.random.Generator) -> pin.Inertia:
    """A rigid body of six small balls: its moments keep the inequality of triangles."""
    parts = zip(generator.uniform(0.1, 1, 6), 0.2 * generator.normal(size=(6, 3)), strict=True)
    return sum((pin.Inertia(m, at, 1e-3 * np.eye(3)) for m, at in parts), pin.Inertia.Zero())


@pytest.fixture
def trees(monkeypatch):
    monkeypatch.setattr(kinds, "solid", solid)
    return kinds


def same_tree(loop: ClosedLoopModel, xml: str, seed: int = 0) -> None:
    """Compare kinetic energy and power at any state: they are the mass matrix and all forces of the tree."""
    model, theirs, rng = loop.model, Opinion(xml), np.random.default_rng(seed)
    data = model.createData()
    for _ in range(3):
        q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        v, a = rng.normal(size=(2, model.nv))
        qacc = theirs.set(loop, q, v, a)
        M, rate = theirs.mass_matrix, theirs.d.qvel
        forces = M @ qacc + theirs.d.qfrc_bias
        own = pin.rnea(model, data, q, v, a)
        tree = np.abs(own).max() * np.abs(v).max() * model.nv
        assert rate @ forces == pytest.approx(own @ v, abs=1e-12 * tree)
        energy = pin.computeKineticEnergy(model, data, q, v)
        assert rate @ M @ rate / 2 == pytest.approx(energy, rel=1e-12)
        if model.nq == model.nv == theirs.m.nv:  # one by one, where the coordinates are the same
            names = [theirs.m.joint(number).name for number in range(theirs.m.njnt)]
            order = [names.index(name) for name in list(model.names)[1:]]
            own_M = pin.crba(model, data, q)
            own_M = np.triu(own_M) + np.triu(own_M, 1).T
            np.testing.assert_allclose(
                M[np.ix_(order, order)], own_M, rtol=0, atol=1e-12 * np.abs(own_M).max()
            )
            bias = pin.nonLinearEffects(model, data, q, v)
            np.testing.assert_allclose(
                theirs.d.qfrc_bias[order], bias, rtol=0, atol=1e-12 * np.abs(bias).max()
            )
    assert not any(warning.number for warning in theirs.d.warning)


def same_forces(loop: ClosedLoopModel, seed: int = 0) -> ClosedLoopModel:
    """Compare a robot with what is read back, in one motion: joints that are only there follow."""
    rng, model = np.random.default_rng(seed), loop.model
    q = loop.assemble(None, pin.integrate(model, loop.assemble().q, 0.03 * rng.uniform(-1, 1, model.nv))).q
    loop = ClosedLoopModel(model, replace(loop.sidecar, reference=values(model, q)))
    q = loop.assemble().q
    again = p3dof.load_robot(text(loop))
    J = loop.closure_jacobian(q)
    N = null_space(J) if len(J) else np.eye(model.nv)
    v = N @ rng.normal(size=N.shape[1])
    chosen = qr(N[loop.actuated_v].T, pivoting=True)[2][: np.linalg.matrix_rank(N[loop.actuated_v], 1e-8)]
    wanted = {loop.actuated[i]: rng.normal() for i in chosen}
    found = loop.hybrid_dynamics(q, v, wanted)
    there, rates = again.reference, follow(loop, again, q, v)
    assert np.abs(again.closure_error(there)).max(initial=0.0) < 1e-9
    assert np.abs(again.closure_jacobian(there) @ rates).max(initial=0.0) < 1e-9 * np.abs(v).max()
    back = again.hybrid_dynamics(there, rates, wanted)
    assert again.actuated == loop.actuated
    if len(chosen) == len(loop.actuated):  # redundant forces are a choice
        size = max(1.0, np.abs(found.tau).max(initial=0))
        np.testing.assert_allclose(back.tau, found.tau, rtol=0, atol=1e-10 * size)
    return again


def values(model: pin.Model, q: np.ndarray) -> dict:
    """A configuration by the names of joints."""
    found = {}
    for i in range(1, model.njoints):
        x = q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
        circle = model.nqs[i] == 2 and model.nvs[i] == 1
        found[str(model.names[i])] = np.arctan2(x[1], x[0]) if circle else x[0] if len(x) == 1 else tuple(x)
    return found


def follow(loop: ClosedLoopModel, again: ClosedLoopModel, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The velocity of what is read back; joints that are only there follow from the closures."""
    model, other = loop.model, again.model
    rates, known = np.zeros(other.nv), []
    for name, _, rate, _ in coordinates(model, q, v, v):
        joint, own = other.getJointId(name), model.getJointId(name)
        span = slice(other.idx_vs[joint], other.idx_vs[joint] + other.nvs[joint])
        same = own < model.njoints and model.nvs[own] == other.nvs[joint]
        rates[span] = v[model.idx_vs[own] : model.idx_vs[own] + model.nvs[own]] if same else rate
        known += range(span.start, span.stop)
    new, J = np.setdiff1d(np.arange(other.nv), known), again.closure_jacobian(again.reference)
    if len(new):
        rates[new] = np.linalg.lstsq(J[:, new], -J @ rates, rcond=None)[0]
    return rates


def null_space(J: np.ndarray) -> np.ndarray:
    _, s, Vt = np.linalg.svd(J)
    return Vt[np.count_nonzero(s > 1e-7 * s[0]) :].T


@pytest.mark.parametrize("file", GALLERY, ids=lambda file: file.stem)
def test_robots_of_the_gallery(file):
    robot = p3dof.load_robot(file)
    xml = text(robot)
    same_tree(robot, xml)
    agree(robot, xml)
    same_forces(robot)


@pytest.mark.parametrize("name", others(*(name for name in STAND_INS if name != "plus_leg_with_rotors")))
@pytest.mark.filterwarnings("ignore:MJCF. limits that leave a joint no travel")
def test_other_robots(name):
    robot = load(name)
    xml = text(robot)
    agree(robot, xml)
    same_forces(robot)


@pytest.mark.parametrize("seed", range(3))
def test_every_joint_becomes_joints_of_mujoco(trees, seed):
    tree = ClosedLoopModel(trees.tree(seed), Sidecar((), ()))
    xml = text(tree)
    same_tree(tree, xml, seed)
    assert p3dof.load_robot(xml).actuated == ()


def test_composite_joints_and_others_of_several_freedoms():
    rng = np.random.default_rng(5)
    whole = pin.JointModelComposite()
    whole.addJoint(pin.JointModelRevoluteUnaligned(0.6, 0.0, 0.8), kinds.place(rng))
    whole.addJoint(pin.JointModelPY(), kinds.place(rng))
    whole.addJoint(pin.JointModelRUBX(), kinds.place(rng))
    model = pin.Model()
    for number, joint in enumerate(
        (pin.JointModelTranslation(), whole, pin.JointModelSphericalZYX(), pin.JointModelFreeFlyer())
    ):
        model.addJoint(number, joint, kinds.place(rng), f"joint_{number}")
        model.appendBodyToJoint(number + 1, solid(rng), pin.SE3.Identity())
    tree = ClosedLoopModel(model, Sidecar((), (), joint_data=(JointData("joint_3", damping=0.2),)))
    theirs = mujoco.MjModel.from_xml_string(text(tree))
    assert (theirs.nv, theirs.njnt) == (15, 13)
    data, own = mujoco.MjData(theirs), model.createData()
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    at, to = list(model.idx_qs), list(model.idx_vs)
    data.qpos[:3] = q[:3]
    circle = q[at[2] + 2 : at[2] + 4]
    data.qpos[3:6] = *q[at[2] : at[2] + 2], np.arctan2(circle[1], circle[0])
    data.qpos[6:9] = q[at[3] : at[3] + 3]
    data.qpos[9:12] = q[at[4] : at[4] + 3]
    data.qpos[12:] = np.roll(q[at[4] + 3 :], 1)
    mujoco.mj_forward(theirs, data)
    pin.forwardKinematics(model, own, q)
    for joint in range(1, model.njoints):
        body = data.body(f"joint_{joint - 1}_link")
        np.testing.assert_allclose(body.xpos, own.oMi[joint].translation, rtol=0, atol=1e-13)
        np.testing.assert_allclose(body.xmat, own.oMi[joint].rotation.ravel(), rtol=0, atol=1e-13)
    M, turn = np.zeros((15, 15)), np.eye(15)
    for row, unit in zip(M, np.eye(15), strict=True):
        mujoco.mj_mulM(theirs, data, row, unit)
    turn[to[4] : to[4] + 3, to[4] : to[4] + 3] = pin.XYZQUATToSE3(q[at[4] :]).rotation
    own_M = pin.crba(model, own, q)
    own_M = np.triu(own_M) + np.triu(own_M, 1).T
    np.testing.assert_allclose(turn.T @ M @ turn, own_M, rtol=0, atol=1e-12 * np.abs(own_M).max())


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_closure(trees, kind):
    for seed in range(2):
        model = trees.tree(seed)
        hinges = tuple(name for name in model.names if name.startswith("hinge"))
        loop = ClosedLoopModel(model, Sidecar((trees.closure(kind, "on_2", "on_9"),), hinges[:2]))
        xml = text(loop)
        again = p3dof.load_robot(xml)
        if kind in CARRIED:
            assert again.model.nv > model.nv
            agree(again, xml, seed)
        else:
            same_tree(loop, xml, seed)
            agree(loop, xml, seed)
        same_forces(loop, seed)


@pytest.mark.parametrize("kind", CARRIED)
def test_what_slides_on_or_beside_the_world_is_carried_by_what_has_a_mass(trees, kind):
    model = trees.tree(1)
    for first, second in (("universe", "on_5"), ("on_5", "universe")):
        loop = ClosedLoopModel(model, Sidecar((trees.closure(kind, first, second),), ()))
        same_forces(loop)


def test_couplings_of_all_kinds(trees):
    model = trees.tree(2)
    hinges = [name for name in model.names if name.startswith("hinge")]
    slides = [name for name in model.names if name.startswith("slide")]
    circles = [name for name in model.names if name.startswith("circle")]
    couplings = (
        Coupling(hinges[0], hinges[1], (0.1, -0.5, 0.3, 0.2, -0.1), "polynomial"),
        Coupling(slides[0], hinges[1], (0.1, 0.4, 0.2), "more", ((slides[1], 0.3),)),
        Coupling(slides[1], None, (0.15,), "sum", ((hinges[1], -0.3),)),
        Coupling(circles[1], None, (0.7,)),
        Coupling(circles[2], hinges[1], (5.0, 2.0), "turning"),
    )
    loop = ClosedLoopModel(model, Sidecar((), (hinges[1], circles[0]), couplings))
    xml = text(loop)
    agree(loop, xml)
    again = p3dof.load_robot(xml)
    assert [coupling.joint for coupling in again.sidecar.couplings] == [c.joint for c in couplings]
    same_forces(loop)


@pytest.mark.parametrize("source", [without_meshes(GRIPPER), TENDONS.replace("{armature}", "")])
def test_joints_that_are_tendons_are_tendons_again(source):
    robot = p3dof.load_robot(source)
    again = p3dof.load_robot(text(robot))
    assert again.model.nv == robot.model.nv
    assert again.sidecar.joint_data == robot.sidecar.joint_data
    np.testing.assert_array_equal(again.model.armature, robot.model.armature)
    agree(robot, text(robot))
    same_forces(robot)


def test_what_acts_in_joints_and_limits_are_there():
    data = (
        JointData("left_elbow", stiffness=3.0, rest=-0.4, damping=0.7),
        JointData("right_joint", damping=0.2, friction=0.3),
    )
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), replace(robots.FIVE_BAR_SIDECAR, joint_data=data))
    loop.model.armature = np.array([0.1, 0.0, 0.2, 0.0])
    loop.model.gravity.linear = np.array([0.1, 0.2, -3.7])
    xml = text(loop)
    agree(loop, xml)
    again = p3dof.load_robot(xml)
    assert again.sidecar.joint_data == data
    np.testing.assert_array_equal(again.model.gravity.linear, loop.model.gravity.linear)
    np.testing.assert_array_equal(again.model.upperPositionLimit, loop.model.upperPositionLimit)
    theirs = mujoco.MjModel.from_xml_string(xml)
    ranges = theirs.jnt_actfrcrange
    np.testing.assert_array_equal(ranges[theirs.joint("left_joint").id], [-9, 9])
    np.testing.assert_array_equal(ranges[theirs.joint("left_elbow").id], [0, 0])
    np.testing.assert_allclose(loop.closure_error(theirs.key_qpos[0]), 0, rtol=0, atol=1e-12)


def yoke(mass: float = 0.0, held: bool = False) -> ClosedLoopModel:
    """A pendulum on a universal joint of two hinges, whose yoke has no mass."""
    xml = robots.robot(
        robots.link("base"),
        robots.link("yoke", robots.Solid(mass, (0, 0, 0), (mass, 0, 0, mass, 0, mass)) if mass else None),
        robots.link("bob", robots.ARM),
        robots.joint("first", "base", "yoke", (0.1, 0.2, 0.3), (1, 0, 0), rpy=(0.3, 0.1, -0.2)),
        robots.joint("second", "yoke", "bob", (0.0, 0.1, 0.2), (0, 1, 0), rpy=(0.2, -0.4, 0.6)),
    )
    loop = ClosedLoopModel.from_urdf(xml, Sidecar((), ("first", "second")))
    if not held:
        return loop
    loop.model.addFrame(
        pin.Frame("hook", 1, pin.SE3(np.eye(3), np.array([0.0, 0.1, 0.0])), pin.FrameType.OP_FRAME)
    )
    return ClosedLoopModel(loop.model, Sidecar((Closure("hook", "universe", "distance", 0.4),), ("second",)))


def test_bodies_without_mass_are_joined_or_get_next_to_none():
    loop = yoke()
    xml = text(loop)
    assert xml.count("<body") == 1
    same_tree(loop, xml)
    same_forces(loop)
    loop = yoke(held=True)
    xml = text(loop)
    assert xml.count("<body") == 2
    same_tree(loop, xml)
    loop.model.inertias[2] = pin.Inertia(1e-6, np.zeros(3), 1e-9 * np.eye(3))
    with pytest.raises(
        ModelError, match="'first' has no mass or moment of inertia, and the robot is too light"
    ):
        text(loop)


def test_moments_that_are_never_felt_may_be_none_that_a_body_has():
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)
    for i in range(1, 4):
        loop.model.inertias[i] = pin.Inertia(1.0, np.array([0.1, 0.0, 0.02 * i]), np.diag([0.0, 0.01, 0.0]))
    xml = text(loop)
    same_tree(loop, xml)
    agree(loop, xml)


def chain(joint: pin.JointModel, inertia: pin.Inertia | None = None, data: tuple[JointData, ...] = ()):
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addJoint(1, joint, pin.SE3.Identity(), "odd")
    for i, body in ((1, solid(np.random.default_rng(1))), (2, inertia or solid(np.random.default_rng(2)))):
        model.appendBodyToJoint(i, body, pin.SE3.Identity())
    return ClosedLoopModel(model, Sidecar((), (), joint_data=data))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: chain(pin.JointModelHX(0.1)),
            "MJCF: the joint 'odd' is a JointModelHX, which it does not know",
        ),
        (
            lambda: chain(pin.JointModelRX(), pin.Inertia.Zero()),
            "nothing behind the joint 'odd' has a mass, so it cannot move there",
        ),
        (
            lambda: chain(pin.JointModelRX(), pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))),
            "the inertia of the body 'odd' is of no rigid body",
        ),
        (
            lambda: chain(pin.JointModelPlanar(), data=(JointData("odd", friction=1.0),)),
            "'odd' has friction in axes",
        ),
        (
            lambda: chain(pin.JointModelFreeFlyer(), data=(JointData("odd", friction=1.0),)),
            "free joint 'odd' has fri",
        ),
        (lambda: with_armature("odd"), "the free joint 'odd' has an armature"),
        (lambda: with_armature("ball"), r"the joint 'ball' has rotors \(armature\) that differ"),
        (
            lambda: ClosedLoopModel(
                yoke(held=True).model, Sidecar((Closure("hook", "universe", "slider"),), ())
            ),
            "the closure 'hook/universe' is a slider, which MuJoCo has between bodies with a mass only",
        ),
    ],
)
def test_what_mujoco_cannot_hold_is_one_error_that_names_it(make, message):
    with pytest.raises(ModelError, match=message) as error:
        text(make())
    assert "\n" not in str(error.value)


def with_armature(name: str) -> ClosedLoopModel:
    loop = chain(pin.JointModelFreeFlyer())
    armature = np.zeros(loop.model.nv)
    armature[loop.model.idx_vs[loop.model.getJointId(name)]] = 0.1
    loop.model.armature = armature
    return loop


def test_names_are_kept_and_never_clash():
    model = pin.Model()
    model.name = "a <robot> & more"
    for number, name in enumerate(("hip/left joint", "knee & <more>", 'the "third"')):
        model.addJoint(number, pin.JointModelRX(), pin.SE3.Random(), name)
        model.appendBodyToJoint(number + 1, solid(np.random.default_rng(number)), pin.SE3.Identity())
        model.addFrame(pin.Frame("world", number + 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("hip/left joint_link", 2, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    loop = ClosedLoopModel(model, Sidecar((), ("knee & <more>",)))
    again = p3dof.load_robot(text(loop))
    assert list(again.model.names) == list(model.names)
    assert again.actuated == loop.actuated
    model.names[1] = "bell\x07"
    with pytest.raises(ModelError, match="cannot be written in XML"):
        text(ClosedLoopModel(model, Sidecar((), ())))


def test_what_changes_a_little_is_told():
    loop = ClosedLoopModel.from_urdf(
        robots.four_bar(*robots.FOUR_BAR, kind="continuous"), robots.FOUR_BAR_SIDECAR
    )
    sprung = ClosedLoopModel(loop.model, replace(loop.sidecar, joint_data=(JointData("crank_joint", 1.0),)))
    with pytest.warns(ModelWarning, match="spring of the continuous joint 'crank_joint' counts its turns"):
        text(sprung)
    far = ClosedLoopModel.from_urdf(robots.four_bar(5.0, 0.2, 0.45, 0.35), robots.FOUR_BAR_SIDECAR)
    with pytest.warns(ModelWarning, match="the loops are open in what is written"):
        text(far)


def test_in_time_loops_stay_closed_in_mujoco():
    file = ROOT / "docs/_static/gallery/delta.urdf"
    theirs = mujoco.MjModel.from_xml_string(text(p3dof.load_robot(file)))
    theirs.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, energies = mujoco.MjData(theirs), []
    mujoco.mj_resetDataKeyframe(theirs, data, 0)
    for _ in range(200):
        mujoco.mj_step(theirs, data)
        energies.append(data.energy.copy())
    assert np.abs(data.efc_pos[: data.nefc]).max() < 1e-4  # in MuJoCo 4 it is 2e-6
    falls = np.ptp(energies, axis=0)[0]
    assert falls > 0.1  # J
    assert np.ptp(np.sum(energies, axis=1)) < 1e-3 * falls


def test_a_robot_is_written_by_the_ending_of_the_name(tmp_path):
    robot = p3dof.load_robot(GALLERY[0])
    assert robot.write(tmp_path / "robot.xml") == [tmp_path / "robot.xml"]
    assert p3dof.load_robot(tmp_path / "robot.xml").actuated == robot.actuated
    assert [path.name for path in robot.write(tmp_path / "robot.urdf")] == ["robot.urdf", "robot.yaml"]
    with pytest.raises(InputError, match=r"expected a file name that ends in \.xml for mjcf"):
        robot.write(tmp_path / "robot.urdf", "mjcf")
    with pytest.raises(InputError, match="format: expected one of urdf, mjcf, sdf, drake"):
        robot.write(Path("robot.usd"), "usd")


def test_springs_of_balls_and_gears_of_motors_are_written():
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Random(), "ball")
    model.addJoint(1, pin.JointModelRX(), pin.SE3.Random(), "arm")
    for i in (1, 2):
        body = pin.Inertia(1.0 + i, np.array([0.1, 0.2, -0.1]), np.diag([0.02, 0.03, 0.04]))
        model.appendBodyToJoint(i, body, pin.SE3.Identity())
        model.addJointFrame(i)
    data = (JointData("ball", stiffness=2.5), JointData("arm", gear_ratio=-12.5))
    loop = ClosedLoopModel(model, Sidecar((), ("arm",), joint_data=data))
    again = p3dof.load_robot(text(loop))
    q = np.array(pin.integrate(model, pin.neutral(model), np.array([0.4, -0.3, 1.2, 0.2])))
    force = loop.passive.forces(q, np.zeros(4))
    assert np.abs(force).max() > 1
    np.testing.assert_allclose(again.passive.forces(q, np.zeros(4)), force, rtol=0, atol=1e-12)
    assert again.motor_side([25.0], np.ones(4)).torque == -2.0
