"""Any robot written as SDF: Drake has the same energies, and its constraints leave the same motions."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as Xml

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from other_robots import load, others

pytest.importorskip("pydrake", reason="drake is not installed")

from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

import p3dof
from p3dof._base.errors import ModelError, ModelWarning
from p3dof.loops import ClosedLoopModel, Closure, Coupling, JointData, Sidecar
from p3dof.loops.writers.sdf import text

GALLERY = {file.stem: file for file in sorted((ROOT / "docs/_static/gallery").glob("*.urdf"))}
DRAKE = "{http://drake.mit.edu}"


class Plant:
    """Drake's model of a text."""

    def __init__(self, sdf: str, gravity: np.ndarray) -> None:
        self.plant = MultibodyPlant(1e-3)
        Parser(self.plant).AddModelsFromString(sdf, "sdf")
        self.plant.mutable_gravity_field().set_gravity_vector(gravity)
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()

    def set(self, loop: ClosedLoopModel, q: np.ndarray, v: np.ndarray, zero: np.ndarray) -> None:
        """Set a state; `zero` is where the joints of the file are at zero."""
        model, plant, context = loop.model, self.plant, self.context
        positions, velocities = np.zeros(plant.num_positions()), np.zeros(plant.num_velocities())
        free = []
        for i in range(1, model.njoints):
            x, x0 = (y[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]] for y in (q, zero))
            rate, kind = v[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]], str(model.joints[i].shortname())
            if kind == "JointModelFreeFlyer":
                free.append((i, x, rate))
                continue
            joint = plant.GetJointByName(str(model.names[i]))
            if kind == "JointModelSpherical":
                R0, R = (pin.Quaternion(y).matrix() for y in (x0, x))
                R = R0.T @ R
                joint.set_angles(context, RollPitchYaw(RotationMatrix(R)).vector())
                joint.set_angular_velocity(context, R @ rate)
                at, to = joint.position_start(), joint.velocity_start()
                positions[at : at + 3] = plant.GetPositions(context)[at : at + 3]
                velocities[to : to + 3] = plant.GetVelocities(context)[to : to + 3]
                continue
            angles = [np.arctan2(y[1], y[0]) if len(y) == 2 else y[0] for y in (x, x0)]
            positions[joint.position_start()] = angles[0] - angles[1]
            velocities[joint.velocity_start()] = rate[0]
        plant.SetPositions(context, positions) if not free else None
        plant.SetVelocities(context, velocities) if not free else None
        for joint in (plant.get_joint(index) for index in plant.GetJointIndices()):
            at, to = joint.position_start(), joint.velocity_start()
            if free and joint.num_velocities() and joint.num_velocities() < 6:
                whole, rates = plant.GetPositions(context), plant.GetVelocities(context)
                whole[at : at + joint.num_positions()] = positions[at : at + joint.num_positions()]
                rates[to : to + joint.num_velocities()] = velocities[to : to + joint.num_velocities()]
                plant.SetPositions(context, whole)
                plant.SetVelocities(context, rates)
        for i, x, rate in free:
            place = model.jointPlacements[i] * pin.XYZQUATToSE3(x)
            body = plant.GetBodyByName(self.floating(model, i))
            there = RigidTransform(RotationMatrix(place.rotation), place.translation)
            plant.SetFreeBodyPose(context, body, there)
            spatial = SpatialVelocity(place.rotation @ rate[3:], place.rotation @ rate[:3])
            plant.SetFreeBodySpatialVelocity(context, body, spatial)

    @staticmethod
    def floating(model: pin.Model, joint: int) -> str:
        return next(
            str(frame.name)
            for frame in model.frames
            if frame.type == pin.FrameType.BODY
            and frame.parentJoint == joint
            and frame.placement.isIdentity()
        )

    def constraints(self, sdf: str) -> tuple[np.ndarray, np.ndarray]:
        """How far the ball constraints are open, and their Jacobian."""
        gaps, rows = [], []
        world = self.plant.world_frame()
        for element in Xml.fromstring(sdf).iter(f"{DRAKE}ball_constraint"):  # noqa: S314 - our own text
            places, jacobians = [], []
            for side, point in (("A", "p_AP"), ("B", "p_BQ")):
                body = self.plant.GetBodyByName(element.find(f"{DRAKE}ball_constraint_body_{side}").text)
                at = np.array(element.find(f"{DRAKE}ball_constraint_{point}").text.split(), dtype=float)
                places.append(body.EvalPoseInWorld(self.context) @ at)
                jacobians.append(
                    self.plant.CalcJacobianTranslationalVelocity(
                        self.context, JacobianWrtVariable.kV, body.body_frame(), at, world, world
                    )
                )
            gaps.append(places[1] - places[0])
            rows.append(jacobians[1] - jacobians[0])
        return np.concatenate(gaps), np.vstack(rows)


def same_energies(loop: ClosedLoopModel, plant: Plant, zero: np.ndarray, seed: int = 0) -> None:
    """They are the mass matrix and, by their derivatives, all forces."""
    rng, model, data = np.random.default_rng(seed), loop.model, loop.model.createData()
    heights = []
    for _ in range(4):
        q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        v = rng.normal(size=model.nv)
        plant.set(loop, q, v, zero)
        own = pin.computeKineticEnergy(model, data, q, v)
        assert plant.plant.CalcKineticEnergy(plant.context) == pytest.approx(own, rel=1e-11)
        heights.append(
            [
                plant.plant.CalcPotentialEnergy(plant.context),
                pin.computePotentialEnergy(model, data, q) + loop.passive.energy(q),
            ]
        )
    rises = np.diff(heights, axis=0)
    np.testing.assert_allclose(rises[:, 0], rises[:, 1], rtol=0, atol=1e-11 * np.abs(heights).max())


def zero_of(loop: ClosedLoopModel) -> np.ndarray:
    zero = pin.neutral(loop.model)
    return zero if np.abs(loop.closure_error(zero)).max(initial=0.0) < 1e-9 else loop.assemble().q


def without_loops(sdf: str, closures: int) -> str:
    """The text without the joints of closures, which are the last ones."""
    root = Xml.fromstring(sdf)  # noqa: S314 - our own text
    model = root.find("model")
    for joint in model.findall("joint")[-closures:]:
        model.remove(joint)
    return Xml.tostring(root, encoding="unicode")


def robot_of(name):
    return load(name) if name in OTHERS else p3dof.load_robot(GALLERY[name])


OTHERS = others("five_bar_rod_end", "leg_with_rods", "tiny_delta")
NAMES = [name for name in GALLERY if name != "leg"] + OTHERS


@pytest.mark.parametrize("name", NAMES)
def test_drake_has_the_tree_and_its_constraints_leave_the_same_motions(name):
    robot = robot_of(name)
    model, sdf = robot.model, text(robot, drake=True)
    plant = Plant(sdf, model.gravity.linear)
    neutral = pin.neutral(model)
    same_energies(robot, plant, neutral)
    mimics = sum(1 for _ in Xml.fromstring(sdf).iter(f"{DRAKE}mimic"))  # noqa: S314 - our own text
    assert mimics == len(robot.sidecar.couplings)
    rows = sum({"3d": 1, "hinge": 2, "6d": 3}[closure.kind] for closure in robot.sidecar.closures)
    assert plant.plant.num_constraints() == rows + mimics
    assert plant.plant.num_actuators() == len(robot.actuated)
    q = robot.assemble().q
    closed = ClosedLoopModel(model, replace(robot.sidecar, couplings=()))
    J = closed.closure_jacobian(q)
    _, s, Vt = np.linalg.svd(J)
    rank = np.count_nonzero(s > 1e-8 * s[0])
    for v in Vt[rank:]:
        plant.set(robot, q, v, neutral)
        gap, rates = plant.constraints(sdf)
        np.testing.assert_allclose(gap, 0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(rates @ plant.plant.GetVelocities(plant.context), 0, rtol=0, atol=1e-12)
    assert np.linalg.matrix_rank(rates, 1e-8 * np.linalg.norm(rates)) == rank


@pytest.mark.parametrize("name", NAMES)
def test_the_tree_of_the_standard_file_is_zero_where_its_loops_close(name):
    robot = robot_of(name)
    sdf, closures = text(robot), len(robot.sidecar.closures)
    if not robot.sidecar.couplings:
        plant = Plant(without_loops(sdf, closures), robot.model.gravity.linear)
        same_energies(robot, plant, zero_of(robot))
    kinds = [joint.get("type") for joint in Xml.fromstring(sdf).iter("joint")]  # noqa: S314 - our own text
    names = {"3d": "ball", "6d": "fixed", "hinge": "revolute"}
    assert kinds[-closures:] == [names[closure.kind] for closure in robot.sidecar.closures]


def test_what_acts_is_there_and_counts_from_the_zero_of_the_file():
    data = (JointData("coupler_joint", stiffness=3.0, rest=-0.4, damping=0.7, friction=0.2),)
    sidecar = replace(robots.FOUR_BAR_SIDECAR, joint_data=data, reference={"crank_joint": 0.5})
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    zero = loop.assemble().q
    (axis,) = [
        joint.find("axis")
        for joint in Xml.fromstring(text(loop)).iter("joint")  # noqa: S314 - our own text
        if joint.get("name") == "coupler_joint"
    ]
    found = {
        element.tag: float(element.text) for part in ("dynamics", "limit") for element in axis.find(part)
    }
    assert found["spring_reference"] == pytest.approx(-0.4 - zero[1])
    assert found["lower"] == pytest.approx(-9 - zero[1])
    assert (found["damping"], found["friction"], found["effort"]) == (0.7, 0.2, 0)
    loop.model.armature = np.array([0.3, 0.0, 0.0])
    drake = Plant(text(loop, drake=True), loop.model.gravity.linear)
    M = drake.plant.CalcMassMatrix(drake.context)
    own = pin.crba(loop.model, loop.model.createData(), np.zeros(3))
    index = drake.plant.GetJointByName("crank_joint").velocity_start()
    assert M[index, index] == pytest.approx(own[0, 0], rel=1e-12)
    assert own[0, 0] > 0.3


def test_universal_joints_have_their_axes_and_couplings_their_offset():
    parts = (robots.link("base"), robots.link("bob", robots.ARM), robots.link("arm", robots.ROD))
    xml = robots.robot(
        *parts,
        robots.joint("first", "base", "bob", (0.1, 0.2, 0.3), (1, 0, 0), rpy=(0.3, 0.1, -0.2)),
        robots.joint("second", "bob", "arm", (0.0, 0.1, 0.2), (0, 1, 0), rpy=(0.2, -0.4, 0.6)),
    )
    loop = ClosedLoopModel.from_urdf(
        xml, Sidecar((), ("first",), (Coupling("second", "first", (0.1, -2.0)),))
    )
    sdf = text(loop)
    assert '<sdf version="1.11">' in sdf
    mimic = Xml.fromstring(sdf).find(".//mimic")  # noqa: S314 - our own text
    assert mimic.get("joint") == "first"
    numbers = [float(part.text) for part in mimic]
    assert numbers == pytest.approx([-2, 0, 0], abs=1e-15)  # zero is where the coupling holds
    mimic = Xml.fromstring(text(loop, drake=True)).find(f".//{DRAKE}mimic")  # noqa: S314 - likewise
    assert mimic.attrib == {"joint": "first", "multiplier": "-2", "offset": "0.1"}
    model = loop.model
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.3, 0.5), np.array([0.1, 0.0, 0.2]))
    model.addFrame(pin.Frame("hook", 2, place, pin.FrameType.OP_FRAME))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(2))
    there = data.oMf[model.getFrameId("hook")].copy()
    turn = pin.exp3(np.array([0.0, -0.7, 0.0])) @ pin.exp3(np.array([-0.3, 0.0, 0.0]))
    wall = there * pin.SE3(turn, np.zeros(3))
    model.addFrame(pin.Frame("wall", 0, wall, pin.FrameType.OP_FRAME))
    for pair in (("wall", "hook"), ("hook", "wall")):
        if pair[0] == "hook":
            wall.rotation = there.rotation @ pin.exp3(np.array([0.3, 0, 0])) @ pin.exp3(np.array([0, 0.7, 0]))
            model.frames[model.getFrameId("wall")].placement = wall
        held = ClosedLoopModel(model, Sidecar((Closure(*pair, "universal"),), ()))
        assert np.abs(held.closure_error(np.zeros(2))).max() < 1e-12
        joint = Xml.fromstring(text(held)).findall(".//joint")[-1]  # noqa: S314 - likewise
        assert (joint.get("type"), joint.find("parent").text, joint.find("child").text) == (
            "universal",
            "world",
            "hook",
        )
        axes = [np.array(joint.find(f"{tag}/xyz").text.split(), dtype=float) for tag in ("axis", "axis2")]
        x1, y2 = (wall, there) if pair[0] == "wall" else (there, wall)
        expected = [there.rotation.T @ x1.rotation[:, 0], there.rotation.T @ y2.rotation[:, 1]]
        expected = expected if pair[0] == "wall" else expected[::-1]  # the first axis is the parent's
        np.testing.assert_allclose(axes, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "drake", "message"),
    [
        (
            lambda: p3dof.load_robot(ROOT / "docs/_static/gallery/leg.urdf"),
            False,
            "is a distance, which no joint of SDF",
        ),
        (
            lambda: p3dof.load_robot(ROOT / "docs/_static/gallery/leg.urdf"),
            True,
            "is a distance, which Drake has no",
        ),
        (lambda: coupled((0.0, 1.0, 0.5)), False, "coupling .* is no multiple of one other joint"),
        (lambda: coupled((0.0, 1.0), armature=0.1), False, "'rocker_joint' has an armature"),
        (lambda: coupled((0.0, 1.0), armature=0.1), True, "'rocker_joint' has an armature"),
        (lambda: renamed("left::joint"), False, "the name 'left::joint' is reserved"),
    ],
)
def test_what_sdf_cannot_hold_is_one_error_that_names_it(make, drake, message):
    with pytest.raises(ModelError, match=message) as error:
        text(make(), drake)
    assert "\n" not in str(error.value)


def coupled(coefficients: tuple[float, ...], armature: float = 0.0) -> ClosedLoopModel:
    xml = robots.four_bar(*robots.FOUR_BAR)
    sidecar = Sidecar((), ("crank_joint",), (Coupling("rocker_joint", "crank_joint", coefficients),))
    loop = ClosedLoopModel.from_urdf(xml, sidecar)
    loop.model.armature = np.array([0.0, 0.0, armature])
    return loop


def renamed(name: str) -> ClosedLoopModel:
    loop = coupled((0.0, 1.0))
    loop.model.names[1] = name
    return ClosedLoopModel(loop.model, Sidecar((), ()))


def test_names_are_one_scope_and_open_loops_are_told():
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "same")
    model.appendBodyToJoint(1, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("same", 1, pin.SE3.Identity(), pin.FrameType.BODY))
    model.addFrame(pin.Frame("a::b", 1, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    root = Xml.fromstring(text(ClosedLoopModel(model, Sidecar((), ("same",)))))  # noqa: S314 - our own text
    assert [root.find(f".//{tag}").get("name") for tag in ("link", "joint", "frame")] == [
        "same_",
        "same",
        "a_b",
    ]
    far = ClosedLoopModel.from_urdf(robots.four_bar(5.0, 0.2, 0.45, 0.35), robots.FOUR_BAR_SIDECAR)
    with pytest.warns(ModelWarning, match="SDF: the loops are open in what is written"):
        text(far)
