"""SDF is read: against Drake's own reader, formulas by hand, and what this package writes."""

from __future__ import annotations

import random
import re
import warnings
from dataclasses import replace
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin
import pytest
from damage import damaged
from documents import ROOT
from gallery import MOBILITY, gallery
from other_robots import load, others
from sdf_texts import ALL, BACKWARDS, DRAKES, FOUR_BAR, GEARS, RICH, effort, joint, link, pose, sdf

pytest.importorskip("pydrake", reason="drake is not installed")

from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from p3dof._base.errors import InputError, ModelError, ModelWarning
from p3dof.loops import ClosedLoopModel, load_robot
from p3dof.loops.formats import sdf_file
from p3dof.loops.formats.sdf_joints import KINDS
from p3dof.loops.writers.sdf import text
from p3dof.viewer.document.meshes import visuals_of

OTHERS = others("five_bar_rod_end", "leg_with_rods", "tiny_delta")


def place_of(robot, name, q=None):
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model) if q is None else q)
    return data.oMf[model.getFrameId(name)].homogeneous


# -- What this package writes ------------------------------------------------------------------------------


def angles(robot, q):
    """The values of joints with one freedom, by name."""
    model = robot.model
    found = {}
    for i in range(1, model.njoints):
        x = q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
        if model.nvs[i] == 1:
            found[str(model.names[i])] = float(np.arctan2(x[1], x[0]) if len(x) == 2 else x[0])
    return found


def of_bodies(robot, q):
    """The state as a reference of what is read again, whose free body counts from the world."""
    model, found = robot.model, angles(robot, q)
    for i in range(1, model.njoints):
        x, kind = q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]], model.joints[i].shortname()
        if kind == "JointModelFreeFlyer":
            found["root_joint"] = pin.SE3ToXYZQUAT(model.jointPlacements[i] * pin.XYZQUATToSE3(x))
        elif kind == "JointModelSpherical":
            found[str(model.names[i])] = x
    return found


def same(robot, again, zero, seed=0):
    """Assert the same mobility and forces where the motors do the same; `zero` is the zero of the file."""
    rng = np.random.default_rng(seed)
    near, start = robot.assemble().q, again.assemble().q
    assert again.actuated == robot.actuated
    count = len(robot.actuated)
    free = count == robot.mobility(near)
    motors = [angles(robot, near)[name] for name in robot.actuated]
    zeros = [zero.get(name, 0.0) for name in robot.actuated]
    for _ in range(4):
        target, rates = motors + 0.05 * rng.normal(size=count), rng.normal(size=(2, count))
        if free:
            first = robot.complete(target, *rates, guess=near)
            second = again.complete(target - zeros, *rates, guess=start)
            states = [(at.q, at.v, at.a) for at in (first, second)]
        else:
            states = [(q, *np.zeros((2, one.model.nv))) for one, q in ((robot, near), (again, start))]
        assert again.mobility(states[1][0]) == robot.mobility(states[0][0])
        mine, theirs = angles(robot, states[0][0]), angles(again, states[1][0])
        for name in set(mine) & set(theirs):
            turned = mine[name] - zero.get(name, 0.0) - theirs[name]
            assert abs(np.angle(np.exp(1j * turned))) < 1e-9, name
        pairs = list(zip((robot, again), states, strict=True))
        if robot.mobility(near) > count:  # they do not hold it
            found = [one.forward_dynamics(*at[:2], rates[0]).a for one, at in pairs]
            motors_v = [
                [one.model.idx_vs[one.model.getJointId(n)] for n in robot.actuated] for one, _ in pairs
            ]
            found = [a[columns] for a, columns in zip(found, motors_v, strict=True)]
        else:
            found = [one.inverse_dynamics(*at).tau for one, at in pairs]
        np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9 * np.abs(found[0]).max())


@pytest.mark.parametrize("drake", [False, True])
@pytest.mark.parametrize("name", [*(name for name in MOBILITY if name != "leg"), *OTHERS])
def test_what_is_written_is_read_again(name, drake):
    robot = load(name) if name in OTHERS else gallery(name)
    q, zero = robot.assemble().q, {}
    if drake:
        again = load_robot(text(robot, drake), passive=True, reference=matching(text(robot, drake), robot, q))
    else:
        again = load_robot(text(robot), passive=True)
        if np.abs(robot.closure_error(pin.neutral(robot.model))).max() > 1e-9:
            zero = angles(robot, q)
    same(robot, again, zero)


@pytest.mark.parametrize("drake", [False, True])
@pytest.mark.parametrize("kind", ["3d", "hinge"])
def test_a_robot_whose_joints_all_have_motors_has_them_when_it_is_read_again(kind, drake):
    """In their order, which is not that of the file; Drake itself has them by their efforts."""
    robot = gallery("four_bar") if kind == "3d" else load_robot(FOUR_BAR)
    assert [closure.kind for closure in robot.sidecar.closures] == [kind]
    joints = tuple(reversed([str(name) for name in robot.model.names][1:]))
    robot = ClosedLoopModel(robot.model, replace(robot.sidecar, actuated=joints))
    written = text(robot, drake)
    again = load_robot(written, reference=matching(written, robot, robot.assemble().q) if drake else None)
    assert again.actuated == joints
    assert {one.kind for one in again.sidecar.closures} == {"3d" if drake else kind}
    assert again.mobility(again.assemble().q) == robot.mobility(robot.assemble().q) == 1
    if drake:
        plant = Drake(written).plant
        assert {plant.get_joint_actuator(i).name() for i in plant.GetJointActuatorIndices()} == set(joints)


@pytest.mark.parametrize(
    ("plugin", "actuated"),
    [
        ('name="gz::sim::systems::JointPositionController" filename="x"', ("coupler_joint",)),
        ('name="ignition::gazebo::systems::JointController" filename="x"', ("coupler_joint",)),
        ('name="mine" filename="libgz-sim-joint-trajectory-controller-system.so"', ("coupler_joint",)),
        ('name="mine" filename="gz-sim-apply-joint-force-system"', ("coupler_joint",)),
        ('name="gz::sim::systems::JointStatePublisher" filename="x"', ()),
    ],
)
def test_plugins_that_move_joints_are_motors_where_efforts_do_not_say(plugin, actuated):
    names = "<joint_name>coupler_joint</joint_name><joint_name>none</joint_name>"
    words = f"<plugin {plugin}>{names}</plugin></model>"
    silent = FOUR_BAR.replace("<effort>0</effort>", "").replace("</model>", words)
    assert load_robot(silent, None if actuated else ()).actuated == actuated
    said = FOUR_BAR.replace("</model>", words)  # by efforts
    assert load_robot(said).actuated == ("crank_joint",)


def matching(written, robot, q):
    known = {str(name) for name in load_robot(written, ()).model.names}
    return {name: value for name, value in of_bodies(robot, q).items() if name in known}


# -- Drake's own reader ------------------------------------------------------------------------------------


class Drake:
    """Drake's model of a text."""

    def __init__(self, written):
        self.plant = MultibodyPlant(1e-3)
        Parser(self.plant).AddModelsFromString(written, "sdf")
        self.plant.Finalize()
        self.plant.mutable_gravity_field().set_gravity_vector(np.array([0, 0, -9.81]))
        self.context = self.plant.CreateDefaultContext()
        names = [self.plant.get_joint(i) for i in self.plant.GetJointIndices()]
        self.joints = {self.full(joint): joint for joint in names}

    def full(self, element):
        model = self.plant.GetModelInstanceName(element.model_instance())
        return f"{model}::{element.name()}".removeprefix("robot::")

    def places(self):
        for number in range(self.plant.num_model_instances()):
            for index in self.plant.GetBodyIndices(ModelInstanceIndex(number)):
                body = self.plant.get_body(index)
                if body.name() != "world":
                    yield self.full(body), body.EvalPoseInWorld(self.context).GetAsMatrix4()


def compare(written, columns, seed=0):
    """Compare places, mass matrix and forces with Drake; columns are our joints by Drake's joint."""
    rng, drake, robot = np.random.default_rng(seed), Drake(written), load_robot(written, ())
    model, data = robot.model, robot.model.createData()
    nv = drake.plant.num_velocities()
    into = np.zeros((model.nv, nv))  # v = into v_drake
    for name, ours in columns.items():
        at = drake.joints[name].velocity_start()
        for number, our in enumerate(ours):
            factor = 1.0
            if isinstance(our, tuple):
                our, factor, number = *our, 0  # noqa: PLW2901 - a follower
            into[model.idx_vs[model.getJointId(our)], at + number] = factor
    assert np.linalg.matrix_rank(into) == nv == robot.mobility(pin.neutral(model))
    for _ in range(4):
        x, rate, change = rng.normal(size=(3, nv))
        q, v, a = into @ x, into @ rate, into @ change
        drake.plant.SetPositions(drake.context, x)
        drake.plant.SetVelocities(drake.context, rate)
        for name, there in drake.places():
            np.testing.assert_allclose(place_of(robot, name, q), there, rtol=0, atol=1e-13, err_msg=name)
        M = drake.plant.CalcMassMatrix(drake.context)
        h = drake.plant.CalcBiasTerm(drake.context) - drake.plant.CalcGravityGeneralizedForces(drake.context)
        theirs = M @ change + h
        ours = into.T @ pin.rnea(model, data, q, v, a)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())


def test_drake_places_and_moves_everything_alike():
    columns = {name: [name] for name in ("shoulder", "slide", "hand::knuckle")}
    columns |= {
        "hand::wrist": ["wrist_1", "wrist_2"],
        "hand::tip::pad": ["hand::pad", ("hand::pad_slide", 0.7 / (2 * np.pi))],
    }
    compare(RICH, columns)


def test_drake_passes_joints_from_child_to_parent_alike():
    compare(BACKWARDS, {name: [name] for name in ("knee", "ankle", "weld")})


# -- Loops -------------------------------------------------------------------------------------------------


def without(written, name):
    """The text without a joint."""
    return re.sub(f'<joint name="{name}".*?</joint>', "", written, flags=re.DOTALL)


def drakes_forces(written, robot, rows, closing):
    """Compare the force of the crank with Drake's tree, whose two ends Drake itself moves."""
    drake = Drake(written)
    rng, plant, context = np.random.default_rng(1), drake.plant, drake.context
    columns = [drake.joints[str(name)].velocity_start() for name in list(robot.model.names)[1:]]
    for _ in range(5):
        at = robot.complete([0.1 * rng.normal()], [rng.normal()], [rng.normal()])
        x, v, a = (np.zeros(3) for _ in range(3))
        x[columns], v[columns], a[columns] = at.q, at.v, at.a
        plant.SetPositions(context, x)
        plant.SetVelocities(context, v)
        bodies = [plant.GetBodyByName(name).EvalPoseInWorld(context).GetAsMatrix4() for name, _ in closing]
        ends = [(body @ [*point, 1])[:3] for body, (_, point) in zip(bodies, closing, strict=True)]
        np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-13)
        jacobians = [
            plant.CalcJacobianTranslationalVelocity(
                context,
                JacobianWrtVariable.kV,
                plant.GetBodyByName(name).body_frame(),
                np.array(point),
                plant.world_frame(),
                plant.world_frame(),
            )
            for name, point in closing
        ]
        J = (jacobians[0] - jacobians[1])[rows]
        free = np.linalg.svd(J)[2][-1]  # J has rank 2
        np.testing.assert_allclose(J @ v, 0, rtol=0, atol=1e-12)
        theirs = plant.CalcMassMatrix(context) @ a
        theirs += plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
        crank = drake.joints["crank_joint"].velocity_start()
        expected = free @ theirs / free[crank]
        found = robot.inverse_dynamics(at.q, at.v, at.a).tau
        np.testing.assert_allclose(found, [expected], rtol=1e-11)


def test_a_joint_that_closes_a_loop_is_a_closure():
    robot = load_robot(FOUR_BAR)
    assert robot.actuated == ("crank_joint",)
    assert [closure.kind for closure in robot.sidecar.closures] == ["hinge"]
    assert robot.mobility(np.zeros(3)) == 1
    coupler = np.linalg.inv(place_of(robot, "coupler")) @ [0.4, 0, 0.15, 1]
    rocker = np.linalg.inv(place_of(robot, "rocker")) @ [0.4, 0, 0.15, 1]
    drakes_forces(
        without(FOUR_BAR, "closing"), robot, [0, 2], [("coupler", coupler[:3]), ("rocker", rocker[:3])]
    )


def test_a_ball_constraint_of_drake_is_a_closure():
    robot = load_robot(DRAKES)
    assert [closure.kind for closure in robot.sidecar.closures] == ["3d"]
    assert robot.model.armature[0] == pytest.approx(0.002 * 49)
    drakes_forces(
        re.sub("<drake:ball_constraint>.*</drake:ball_constraint>", "", DRAKES),
        robot,
        [0, 2],
        [("coupler", [0.25, 0, 0.1]), ("rocker", [-0.02, 0, 0.2])],
    )


@pytest.mark.parametrize(
    ("more", "kinds"),
    [
        ("<lower>-1</lower><upper>2</upper>", ["6d"]),
        ("<lower>-1e16</lower><upper>1e16</upper>", ["hinge"]),
        ("<effort>3</effort>", ["6d"]),
    ],
)
def test_a_joint_that_acts_stays_though_all_of_its_loop_do(more, kinds):
    """It leads to a second body, and both together have the mass of its child."""
    limit = f"<limit><effort>0</effort>{more}</limit>".replace("<effort>0</effort><effort>", "<effort>")
    written = FOUR_BAR.replace(
        effort(0), "<limit><lower>-3</lower><upper>3</upper><effort>0</effort></limit>", 2
    )
    assert written.count("<lower>-3") == 2
    written = written.replace(effort(0), limit)
    robot, plain = load_robot(written, ()), load_robot(FOUR_BAR)
    assert [closure.kind for closure in robot.sidecar.closures] == kinds
    assert robot.mobility(robot.assemble().q) == 1
    masses = [sum(inertia.mass for inertia in one.model.inertias) for one in (robot, plain)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-14)
    if kinds == ["6d"]:
        assert "closing" in robot.model.names
        motor = {"closed_loop": [], "type": [], "name_mot": ["crank_joint"]}
        same(plain, load_robot(written, motor), {})


def test_joints_with_motors_are_in_the_tree_whatever_their_order():
    """A crank that comes last in the file, and one that a sidecar names."""
    crank = re.search('<joint name="crank_joint".*?</joint>', FOUR_BAR).group()
    last = FOUR_BAR.replace(crank, "").replace("</model>", f"{crank}</model>")
    robot = load_robot(last)
    assert "crank_joint" in robot.model.names
    same(load_robot(FOUR_BAR), robot, {})
    silent = last.replace(effort(0), effort(8))
    with pytest.warns(
        ModelWarning, match="and no plug-in that moves joints, so that it does not say"
    ) as told:
        assert load_robot(silent).actuated == ()
    assert told[0].filename == __file__
    robot = load_robot(silent, {"closed_loop": [], "type": [], "name_mot": ["crank_joint"]})
    same(load_robot(FOUR_BAR), robot, {})


@pytest.mark.parametrize(
    ("kind", "closure", "freedom", "more"),
    [
        ("revolute", "hinge", 1, ""),
        ("prismatic", "slider", 1, ""),
        ("ball", "3d", 3, ""),
        ("fixed", "6d", 0, ""),
        ("universal", "universal", 2, "<axis2><xyz>0.8 0 -0.6</xyz></axis2>"),
    ],
)
def test_every_kind_of_joint_closes_a_loop(kind, closure, freedom, more):
    """A chain of six freedoms, whose end the joint holds: what is left is what the joint lets move."""
    names = "abcdef"
    parts = [
        link(name, pose(f"{0.2 * i} {0.1 * i * i} {0.1 * i} 0.1 {0.2 * i} 0.3"))
        for i, name in enumerate(names)
    ]
    axes = ("1 0 0", "0 1 0", "0 0 1", "0.3 1 0.2", "1 0.2 0.4", "0.1 0.3 1")
    limit = "<limit><lower>-3</lower><upper>3</upper></limit>"
    parts += [
        joint(f"j{name}", "world" if before is None else before, name, axis=axis, limit=limit)
        for before, name, axis in zip((None, *names), names, axes, strict=False)
    ]
    axis = "" if kind in ("ball", "fixed") else "0.6 0 0.8"
    end = joint("end", "world", "f", kind, axis=axis, more=more, where=pose("0.1 0.2 0 0.3 0 0.1"))
    written = sdf(*parts, end)
    robot = load_robot(written, ())
    assert [one.kind for one in robot.sidecar.closures] == [closure]
    assert robot.mobility(np.zeros(6)) == freedom
    if kind != "fixed":  # the motions of the end are those that the joint alone allows
        moved = jacobian(robot, "f") @ np.linalg.svd(robot.closure_jacobian(np.zeros(6)))[2][6 - freedom :].T
        allowed = jacobian(load_robot(sdf(parts[5], end), ()), "f")
        assert np.linalg.matrix_rank(np.hstack([moved, allowed]), 1e-10) == freedom


def jacobian(robot, frame):
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    pin.updateFramePlacements(model, data)
    return pin.getFrameJacobian(model, data, model.getFrameId(frame), pin.WORLD).reshape(6, -1)


# -- What couples joints -----------------------------------------------------------------------------------


def test_gears_and_followers():
    """theta_2 = -ratio theta_1 from the reference body, about axis2 and axis: the turns of bodies show it."""
    robot = load_robot(GEARS)
    assert robot.actuated == ("one",)
    at = robot.assemble({"one": 0.3})
    q = angles(robot, at.q)
    assert q["three"] == pytest.approx(0.2 + 3 * (0.3 - 0.5), abs=1e-14)
    turns = []
    for name in ("first", "second"):
        home = np.linalg.inv(place_of(robot, "frame")) @ place_of(robot, name)
        now = np.linalg.inv(place_of(robot, "frame", at.q)) @ place_of(robot, name, at.q)
        turns.append(pin.log3(now[:3, :3] @ home[:3, :3].T))
    np.testing.assert_allclose(turns[0], [0, 0, 0.3], rtol=0, atol=1e-13)
    np.testing.assert_allclose(turns[1], [0, 0, 2.5 * 0.3], rtol=0, atol=1e-13)  # about -z: -2.5 times
    free = load_robot(GEARS, mimic=False)
    assert [coupling.name for coupling in free.sidecar.couplings] == ["gear"]
    assert free.actuated == ("one",)


def turn_of(robot, q, name, seen_from):
    """How far a link has turned about z, seen from another one."""
    places = [place_of(robot, one, x) for x in (pin.neutral(robot.model), q) for one in (seen_from, name)]
    home, now = (np.linalg.inv(a) @ b for a, b in (places[:2], places[2:]))
    return pin.log3(now[:3, :3] @ home[:3, :3].T)[2]


def test_the_joint_without_a_motor_follows():
    swapped = (
        GEARS.replace(effort(5), effort("x")).replace(effort(0), effort(5), 1).replace(effort("x"), effort(0))
    )
    robot = load_robot(swapped)
    assert robot.actuated == ("two",)
    q = robot.assemble({"two": 0.3}).q
    assert angles(robot, q)["one"] == pytest.approx(-0.3 / 2.5, rel=1e-14)
    assert turn_of(robot, q, "first", "frame") == pytest.approx(-0.3 / 2.5, rel=1e-13)


@pytest.mark.parametrize(("element", "ratio"), [("<gearbox_ratio>3</gearbox_ratio>", 3.0), ("", 1.0)])
def test_a_planetary_gear_ties_three_joints(element, ratio):
    z = {"axis": "0 0 1", "limit": effort(0)}
    gear = joint("mesh", "sun", "planet", "gearbox", axis="0 0 1").replace(
        "</joint>",
        f"<axis2><xyz>0 0 1</xyz></axis2>{element}"
        "<gearbox_reference_body>carrier</gearbox_reference_body></joint>",
    )
    robot = load_robot(
        sdf(
            *(link(name) for name in ("carrier", "sun", "planet")),
            joint("c", "world", "carrier", axis="0 0 1", limit=effort(5)),
            joint("s", "world", "sun", axis="0 0 1", limit=effort(5)),
            joint("p", "carrier", "planet", **z),
            gear,
        )
    )
    assert robot.actuated == ("c", "s")
    q = robot.assemble({"c": 0.2, "s": 0.5}).q
    assert turn_of(robot, q, "sun", "carrier") == pytest.approx(0.3, rel=1e-13)
    assert turn_of(robot, q, "planet", "carrier") == pytest.approx(-ratio * 0.3, rel=1e-13)


@pytest.mark.parametrize(
    ("element", "advance"),
    [
        ("<thread_pitch>50</thread_pitch>", -1 / 50),
        ("<screw_thread_pitch>0.01</screw_thread_pitch>", 0.01 / (2 * np.pi)),
        ("<thread_pitch>50</thread_pitch><screw_thread_pitch>0.01</screw_thread_pitch>", 0.01 / (2 * np.pi)),
    ],
)
@pytest.mark.parametrize("ends", [("base", "nut"), ("nut", "base")])
def test_a_screw_goes_along_as_it_turns(element, advance, ends):
    written = sdf(
        link("base"),
        link("nut", pose("0.1 0.2 0.3 0.1 0.2 0.3")),
        joint("held", "world", "base", "fixed", axis=""),
        joint("screw", *ends, "screw", axis="0.6 0 0.8", more=element),
    )
    robot = load_robot(written)
    assert robot.actuated == ("screw",)
    q = robot.assemble({"screw": 0.7}).q
    one, two = (place_of(robot, ends[0], x) for x in (pin.neutral(robot.model), q))
    three, four = (place_of(robot, ends[1], x) for x in (pin.neutral(robot.model), q))
    home, now = np.linalg.inv(one) @ three, np.linalg.inv(two) @ four  # the child from the parent
    move = now @ np.linalg.inv(home)
    axis = home[:3, :3] @ [0.6, 0, 0.8]
    np.testing.assert_allclose(pin.log3(move[:3, :3]), 0.7 * axis, rtol=0, atol=1e-13)
    centre = home[:3, 3]
    np.testing.assert_allclose(move[:3, :3] @ centre + move[:3, 3] - centre, 0.7 * advance * axis, atol=1e-13)
    if ends[0] == "base":
        drake = Drake(written)
        drake.plant.SetPositions(drake.context, [0.7])
        there = drake.plant.GetBodyByName("nut").EvalPoseInWorld(drake.context).GetAsMatrix4()
        np.testing.assert_allclose(four, there, rtol=0, atol=1e-13)


def test_two_axes_in_a_row_and_what_follows_the_second():
    written = sdf(
        link("base"),
        link("bob", pose("0.1 0.2 0.3 0.1 0.2 0.3")),
        link("arm"),
        joint("held", "world", "base", "fixed", axis=""),
        joint("two", "base", "bob", "revolute2", axis="1 0 0", more="<axis2><xyz>1 1 0</xyz></axis2>"),
        joint(
            "arm_joint",
            "base",
            "arm",
            limit='<mimic joint="two" axis="axis2"><multiplier>2</multiplier></mimic>',
        ),
    )
    robot = load_robot(written, ())
    assert list(robot.model.names)[1:] == ["two_1", "two_2", "arm_joint"]
    home = place_of(robot, "bob")
    now = place_of(robot, "bob", np.array([0.3, -0.5, 0.0]))
    axis = np.array([1, 1, 0]) / np.sqrt(2)
    turn = pin.exp3(0.3 * np.array([1, 0, 0])) @ pin.exp3(-0.5 * axis)
    np.testing.assert_allclose(now[:3, :3], home[:3, :3] @ turn, rtol=0, atol=1e-14)
    (coupling,) = robot.sidecar.couplings
    assert (coupling.joint, coupling.on, coupling.coefficients) == ("arm_joint", "two_2", (0.0, 2.0))
    assert robot.actuated == ()  # a joint of two freedoms has no motor, and the arm follows


def test_a_continuous_joint_has_no_limits_and_counts_its_turns():
    limit = "<limit><lower>-1</lower><upper>1</upper></limit>"
    model = load_robot(sdf(link("arm"), joint("hinge", "world", "arm", "continuous", limit=limit))).model
    assert model.nq == 1
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-np.inf, np.inf)


def test_what_acts_and_limits():
    acts = "<dynamics><damping>0.3</damping><friction>0.2</friction><spring_stiffness>4</spring_stiffness>"
    acts += "<spring_reference>0.5</spring_reference></dynamics><limit><lower>-1</lower><upper>2</upper>"
    written = sdf(
        link("arm"),
        joint("hinge", "arm", "world", limit=f"{acts}<effort>7</effort><velocity>3</velocity></limit>"),
    ).replace("<parent>arm</parent><child>world</child>", "<parent>world</parent><child>arm</child>")
    for passive, stiffness, damping in ((None, 4, 0), (True, 4, 0.3), (False, 0, 0)):
        robot = load_robot(written, passive=passive)
        data = {entry.joint: entry for entry in robot.sidecar.joint_data}.get("hinge")
        assert (data.stiffness if data else 0, data.damping if data else 0) == (stiffness, damping)
        assert (data is None) == (passive is False)
    assert data is None
    model = robot.model
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-1, 2)
    assert (model.upperEffortLimit[0], model.upperVelocityLimit[0]) == (7, 3)
    assert (model.lowerEffortLimit[0], model.damping[0]) == (-7, 0.3)


# -- Roots -------------------------------------------------------------------------------------------------


def test_what_no_joint_holds_floats():
    written = sdf(
        pose("1 2 3 0.1 0.2 0.3"),
        link("body", pose("0.1 0 0 0 0 1")),
        link("arm"),
        joint("hip", "body", "arm"),
    )
    robot = load_robot(written)
    assert list(robot.model.names) == ["universe", "root_joint", "hip"]
    frames = {str(frame.name): frame for frame in robot.model.frames}
    above = [
        str(robot.model.frames[frames[name].parentFrame].name)
        for name in ("root_joint", "body", "hip", "arm")
    ]
    assert above == ["universe", "root_joint", "body", "hip"]
    drake = Drake(written)
    places = dict(drake.places())
    q = robot.reference
    np.testing.assert_allclose(place_of(robot, "body", q), places["body"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(place_of(robot, "arm", q), places["arm"], rtol=0, atol=1e-14)
    planar = load_robot(written, root_joint=pin.JointModelPZ())
    np.testing.assert_allclose(place_of(planar, "arm"), places["arm"], rtol=0, atol=1e-14)
    assert planar.model.nv == 2
    two = written.replace("</model>", link("other") + "</model>")
    assert list(load_robot(two).model.names)[1:] == ["body_root_joint", "hip", "other_root_joint"]
    with pytest.raises(InputError, match=r"root_joint: expected one link .*, got 2: 'body', 'other'"):
        load_robot(two, root_joint=pin.JointModelPZ())
    static = written.replace("<pose>", "<static>true</static><pose>", 1)
    assert load_robot(static).model.nv == 0
    with pytest.raises(InputError, match="got none"):
        load_robot(static, root_joint=pin.JointModelPZ())


def test_a_world_with_one_model_that_moves():
    body = sdf(pose("0 0 1 0 0 0", "spot"), link("body"), name="r")
    body = body[body.index("<model") : -len("</sdf>")]
    ground = '<model name="ground"><static>1</static>' + link("plane") + "</model>"
    world = (
        f'<sdf version="1.10"><world name="w"><gravity>0 0 -3.7</gravity><physics type="ode"/>'
        f'<frame name="spot" attached_to="ground">{pose("1 0 0 0 0 0.5")}</frame>{ground}{body}'
        f"{joint('pin', 'ground', 'r')}</world></sdf>"
    )
    robot = load_robot(world)
    assert robot.model.gravity.linear.tolist() == [0, 0, -3.7]
    assert list(robot.model.names)[1:] == ["pin"]
    turn = pin.exp3(np.array([0, 0, 0.5]))
    np.testing.assert_allclose(place_of(robot, "body")[:3, 3], [1, 0, 1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(place_of(robot, "body")[:3, :3], turn, rtol=0, atol=1e-15)
    assert robot.model.existFrame("ground::plane")
    with pytest.raises(ModelError, match="expected one model that moves, got 'r', 's'"):
        load_robot(world.replace("</world>", body.replace('"r"', '"s"') + "</world>"))


def test_a_link_without_inertia_has_that_of_the_format():
    robot = load_robot(sdf('<link name="a"/>'))
    assert robot.model.inertias[1].mass == 1
    np.testing.assert_array_equal(robot.model.inertias[1].inertia, np.eye(3))
    drake = Drake(sdf('<link name="a"/>')).plant.GetBodyByName("a")
    assert drake.default_mass() == 1
    robot = load_robot(sdf('<link name="a"><inertial><mass>3</mass></inertial></link>'))
    assert robot.model.inertias[1].mass == 3


# -- What is not understood --------------------------------------------------------------------------------

ARM = sdf(
    link("base"), link("arm"), joint("held", "world", "base", "fixed", axis=""), joint("hinge", "base", "arm")
)
NO_AXIS = '<joint name="x" type="revolute"><parent>base</parent><child>arm</child></joint>'


def more(extra):
    return ARM.replace("</model>", f"{extra}</model>")


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("<sdf/>", "version: expected 1.4 to 1.12, got None"),
        (ARM.replace("1.11", "1.3"), "version: expected 1.4 to 1.12, got '1.3'"),
        (ARM.replace("1.11", "1.13"), "version: expected 1.4 to 1.12, got '1.13'"),
        (ARM.replace("1.11", "a"), "version: expected 1.4 to 1.12"),
        ('<sdf version="1.9"/>', "expected models or one world, got 0 and 0"),
        ('<sdf version="1.9"><world name="w"/></sdf>', "expected one model that moves, got none"),
        (sdf(), "the robot has no links"),
        (ARM.replace("</sdf>", ARM[ARM.index("<model") :].replace('"robot"', '"b"')), "got 'robot', 'b'"),
        (ARM.replace('<link name="arm"', "<link"), "<link>: expected a name"),
        (ARM.replace('"arm"', '"world"'), "the name 'world' is reserved"),
        (ARM.replace('"arm"', '"__a__"'), "the name '__a__' is reserved"),
        (ARM.replace('"arm"', '"a::b"'), "the name 'a::b' has :: in it"),
        (ARM.replace('"hinge"', '"arm"'), "<joint name='arm'>: the name 'arm' is there twice"),
        (more('<frame name="arm"/>'), "<frame name='arm'>: the name 'arm' is there twice"),
        (ARM.replace("<child>arm", "<child>hand"), "the frame 'hand' does not exist; known: base, arm"),
        (ARM.replace("<child>arm", "<child>base"), "it joins the link 'base' with itself"),
        (ARM.replace("<child>arm", "<child>world"), "the frame 'world' does not exist"),
        (ARM.replace("<child>arm</child>", ""), "expected the element <child> with a text in it"),
        (ARM.replace('"revolute"', '"hinge"'), "type: expected one of fixed, revolute, .*, got 'hinge'"),
        (ARM.replace("<xyz>0 1 0", "<xyz>0 0 0"), "xyz: expected a direction, got one that is zero"),
        (ARM.replace("<xyz>0 1 0", "<xyz>0 1"), "<xyz>: expected 3 finite numbers, got '0 1'"),
        (ARM.replace("<xyz>0 1 0", "<xyz>0 1_0 0"), "expected 3 finite numbers, got '0 1_0 0'"),
        (ARM.replace("<xyz>0 1 0", "<xyz>0 1e40 0"), "expected 3 finite numbers"),
        (ARM.replace("<xyz>", '<xyz expressed_in="x">'), "the frame 'x' does not exist"),
        (more(NO_AXIS), "expected the element <axis>"),
        (ARM.replace("<mass>1.3", "<mass>-1"), "expected no negative mass, got -1"),
        (ARM.replace("<mass>1.3", "<mass>nan"), "<mass>: expected a finite number, got 'nan'"),
        (ARM.replace("<ixx>0.02", "<ixx>-0.02"), "expected no negative moment of inertia"),
        (ARM.replace("<inertial>", '<inertial auto="true">'), "auto: the inertia of shapes is not computed"),
        (ARM.replace("<inertial><pose>", '<inertial><pose relative_to="base">'), "is relative to its link"),
        (ARM.replace("<inertial>", "<pose/><pose/><inertial>", 1), "<pose>: it is given twice in <link>"),
        (more(link("c", pose("0 0 0 1"))), "<pose>: expected 6 finite numbers, got '0 0 0 1'"),
        (more(link("c", pose("0 0 0 1 0 0", more=' degrees="x"'))), "expected true or false, got 'x'"),
        (more(link("c", pose("0 0 0 1 1 1 1", more=' rotation_format="quat_xyzw"'))), "of length 1, got 2"),
        (more(link("c", pose("0 0 0 1 1 1", more=' rotation_format="rpy"'))), "rotation_format: expected"),
        (
            more(link("c", pose("1 0 0 0 0 0", "d")) + link("d", pose("1 0 0 0 0 0", "c"))),
            "its pose is relative to itself: '[cd]' -> '[cd]' -> '[cd]'",
        ),
        (
            more('<frame name="e" attached_to="f"><pose relative_to="arm"/></frame>').replace(
                "</model>", '<frame name="f" attached_to="e"><pose relative_to="arm"/></frame></model>'
            ),
            "it is attached to itself",
        ),
        (more('<frame name="e" attached_to="none"/>'), "<frame name='e'>: the frame 'none' does not exist"),
        (more('<model name="m"/><frame name="e" attached_to="m"/>'), "expected a link in the model"),
        (ARM.replace("<axis>", "<axis><limit><lower>2</lower><upper>1</upper></limit>"), "lower <= upper"),
        (ARM.replace("<axis>", "<axis><limit><lower>nan</lower></limit>"), "expected a finite number"),
        (ARM.replace("<axis>", "<axis><dynamics><damping>-1</damping></dynamics>"), "no negative damping"),
        (ARM.replace('"revolute"', '"screw"'), "expected the element <screw_thread_pitch>"),
        (
            ARM.replace('"revolute"', '"screw"').replace("<axis>", "<thread_pitch>0</thread_pitch><axis>"),
            "thread_pitch: expected a number other than zero",
        ),
        (ARM.replace("</axis>", '<mimic joint="x"/></axis>'), "the frame 'x' does not exist"),
        (ARM.replace("</axis>", '<mimic joint="held"/></axis>'), "mimic: 'held' is no joint with that axis"),
        (ARM.replace("</axis>", '<mimic joint="hinge"/></axis>'), "the joint cannot follow itself"),
        (
            GEARS.replace("<gearbox_ratio>2.5", "<gearbox_ratio>0"),
            "<joint name='gear'>: it ties no two joints",
        ),
        (GEARS.replace("_body>frame<", "_body>third<"), "expected hinges along its axes between"),
        (
            GEARS.replace("_body>frame<", "_body>frames<"),
            "the frame 'frames' does not exist; did you mean 'frame'",
        ),
        (
            ARM.replace("<axis>", "<axis><use_parent_model_frame>1</use_parent_model_frame>"),
            "use_parent_model_frame: since version 1.7 it is <xyz expressed_in>",
        ),
        (
            more(link("c", pose("1 0 0 0 0 0", more=' frame="arm"'))),
            "frame: since version 1.7 it is relative_to",
        ),
        (
            more(
                joint(
                    "b", "base", "arm", "ball", axis="", more="<drake:rotor_inertia>1</drake:rotor_inertia>"
                )
            ),
            "<drake:rotor_inertia>: expected a joint of one freedom, this one is ball",
        ),
        (DRAKES.replace("<drake:gear_ratio>7", "<drake:gear_ratio>0"), "a gear ratio other than zero"),
        (DRAKES.replace("p_AP>0.25 0 0.1", "p_AP>0.25 0"), "p_AP>: expected 3 finite numbers"),
        (
            DRAKES.replace("body_A>coupler", "body_A>couple"),
            "'couple' does not exist; did you mean 'coupler'",
        ),
        (more(joint("again", "base", "arm", "fixed", axis="") + joint("two", "base", "arm")), None),
        (
            ARM.replace('"revolute"', '"fixed"').replace(
                "</model>", joint("two", "base", "arm") + "</model>"
            ),
            "<joint name='two'>: it joins two links that are fixed to each other",
        ),
        (more("<drake:linear_bushing_rpy/>"), "<drake:linear_bushing_rpy> in <model> looks like a loop"),
        (more('<drake:joint name="j" type="planar"/>'), "<drake:joint> in <model> looks like a loop"),
        (ARM.replace("</axis>", "<mimic_too/></axis>"), "<mimic_too> in <axis> looks like a loop"),
        (more("<include><uri>model://hand</uri></include>"), "it needs the files beside it"),
        ("<sdf", "not well-formed XML"),
        ("<!DOCTYPE x><sdf/>", "a document type declaration is not allowed"),
        (sdf(*(f'<link name="{i}"/>' for i in range(1001))), "expected at most 1000 links"),
        (sdf(*(f'<link name="{i}"/>' for i in range(34))), "at most 200 degrees of freedom, got 204"),
        (sdf("".join(f'<model name="{i}">' for i in range(96)) + "</model>" * 96), "the robot has no links"),
    ],
)
def test_what_is_wrong_is_one_clear_line(written, message):
    if message is None:
        assert [one.kind for one in load_robot(written, ()).sidecar.closures]
        return
    with pytest.raises(ModelError, match=message) as error:
        load_robot(written)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_a_ring_of_poses_does_not_overflow_a_stack():
    frames = [
        f'<frame name="f{i}"><pose relative_to="f{i + 1}">0 0 1 0 0 0</pose></frame>' for i in range(5000)
    ]
    last = '<frame name="f5000" attached_to="base"/>'
    robot = load_robot(more("".join(frames) + last))
    assert place_of(robot, "f0")[2, 3] == 5000
    with pytest.raises(ModelError, match="its pose is relative to itself"):
        load_robot(more("".join(frames) + '<frame name="f5000" attached_to="f0"/>'))
    attached = "".join(f'<frame name="f{i}" attached_to="f{i + 1}"/>' for i in range(5000))
    robot = load_robot(more(attached + '<frame name="f5000" attached_to="arm"/>'))
    assert robot.model.frames[robot.model.getFrameId("f0")].parentJoint == robot.model.getJointId("hinge")


def test_unknown_elements_are_named_in_one_warning():
    written = more("<thing><deep/></thing>").replace(
        "<inertial>", "<glow/><visual/><gravity>0</gravity><inertial>", 1
    )
    with pytest.warns(ModelWarning) as caught:
        load_robot(written)
    assert [str(one.message) for one in caught] == [
        "not understood, and left out: <glow> in <link> (SDF text, line 1), <thing> in <model> "
        "(SDF text, line 1), <gravity> of the link 'base' (SDF text, line 1)"
    ]
    assert load_robot(written, on_unknown="ignore").model.nv == 1
    assert load_robot(more("<drake:linear_bushing_rpy/>"), on_unknown="ignore").model.nv == 1
    for name in ("visual", "collision", "sensor"):
        assert load_robot(ARM.replace("<inertial>", f"<{name}><x/></{name}><inertial>", 1)).model.nv == 1
    plugin = '<plugin name="mimic" filename="x.so"><joint>held</joint><mimicJoint>hinge</mimicJoint></plugin>'
    with pytest.warns(ModelWarning, match="<plugin name='mimic'> ties the joint 'hinge' to others") as told:
        load_robot(more(plugin))
    assert {one.filename for one in (*caught, *told)} == {__file__}
    added = ARM.replace("<mass>", "<fluid_added_mass><xx>1</xx></fluid_added_mass><mass>", 1)
    with pytest.warns(ModelWarning, match="<fluid_added_mass> in <inertial>"):
        load_robot(added)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"on_unknown": "warn"}, "on_unknown: expected 'raise' or 'ignore'"),
        ({"root_joint": 3}, "root_joint: expected a pinocchio joint model"),
        ({"reference": "home"}, "reference: an SDF file has no states with names"),
        ({"srdf_file": "a.srdf"}, "srdf_file: an SDF file has no states with names"),
        (
            {"root_joint": pin.JointModelFreeFlyer()},
            "root_joint: expected one link without a joint to the world",
        ),
    ],
)
def test_arguments_that_do_not_fit(arguments, message):
    with pytest.raises(InputError, match=message):
        load_robot(ARM, **arguments)


def test_included_files_are_below_the_folder(tmp_path):
    inner = sdf(link("palm"), link("finger"), joint("knuckle", "palm", "finger"), name="hand", version="1.8")
    (tmp_path / "robot/hand").mkdir(parents=True)
    (tmp_path / "robot/hand/model.sdf").write_text(inner)
    (tmp_path / "outside.sdf").write_text(inner)
    (tmp_path / "robot/loop.sdf").write_text(
        inner.replace("</model>", "<include><uri>loop.sdf</uri></include></model>")
    )
    file = tmp_path / "robot/robot.sdf"

    def read(uri, extra="", attributes="", **options):
        file.write_text(
            more(f"<include {attributes}><uri>{uri}</uri>{extra}</include>" + joint("wrist", "arm", "hand"))
        )
        return load_robot(file, **options)

    for uri in ("model://hand", "hand", "hand/model.sdf", f"file://{tmp_path}/robot/hand"):
        robot = read(uri)
        assert list(robot.model.names)[1:] == ["hinge", "wrist", "hand::knuckle"]
    (tmp_path / "models/hand").mkdir(parents=True)
    (tmp_path / "models/hand/model.sdf").write_text(inner.replace("knuckle", "thumb"))
    for uri, options in (
        ("../outside.sdf", {"include_root": tmp_path}),
        ("../models/hand", {"include_root": str(tmp_path)}),
        ("model://models/hand", {"include_root": tmp_path}),
        ("model://hand", {"include_root": tmp_path / "models"}),
    ):
        names = list(read(uri, **options).model.names)
        assert names[-1] == ("hand::knuckle" if "outside" in uri else "hand::thumb")
    with pytest.raises(ModelError, match=r"'\.\./outside\.sdf' is no file below include_root"):
        read("../outside.sdf", include_root=tmp_path / "models")
    with pytest.raises(ModelError, match="include_root: expected a folder, got"):
        read("hand", include_root=tmp_path / "nowhere")
    with pytest.raises(ModelError, match="the frame 'hand' does not exist"):
        read("hand", "<name>other</name>")
    with pytest.raises(ModelError, match="is no file below the folder of the first one"):
        read("../outside.sdf")
    with pytest.raises(ModelError, match="is no file below the folder of the first one"):
        read("/etc")
    with pytest.raises(ModelError, match="is no file below the folder of the first one"):
        read("model://none")
    with pytest.raises(ModelError, match="uri: expected a path or model://, got 'https://a/b'"):
        read("https://a/b")
    with pytest.raises(ModelError, match=r"uri: 'loop\.sdf' includes itself"):
        read("loop.sdf")
    with pytest.raises(ModelError, match="merge: it is not read"):
        read("hand", attributes='merge="true"')
    with pytest.raises(ModelError, match="a <placement_frame> needs a <pose>"):
        read("hand", "<placement_frame>palm</placement_frame>")


def test_before_version_1_7_a_link_and_a_joint_may_have_the_same_name():
    written = ARM.replace('"hinge"', '"arm"').replace("1.11", "1.6")
    robot = load_robot(written.replace("</model>", '<frame name="on" attached_to="arm"/></model>'))
    assert list(robot.model.names)[1:] == ["arm"]
    assert robot.model.frames[robot.model.getFrameId("on")].parentJoint == 1
    for twice in (link("arm"), joint("arm", "base", "arm")):
        with pytest.raises(ModelError, match="the name 'arm' is there twice"):
            load_robot(written.replace("</model>", f"{twice}</model>"))


def test_a_rounded_quaternion_is_normalised():
    turn = pose("0 0 0 0 0 0.70745 0.70745", more=' rotation_format="quat_xyzw"')
    place = place_of(load_robot(sdf(link("base"), f'<frame name="turned">{turn}</frame>')), "turned")
    np.testing.assert_allclose(place[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], rtol=0, atol=1e-15)


def test_files_that_include_each_other_far_are_refused(tmp_path):
    for number in range(102):
        inner = f"<include><uri>{number + 1}.sdf</uri></include>" if number < 101 else ""
        (tmp_path / f"{number}.sdf").write_text(sdf(link("a"), inner, name=f"m{number}"))
    with pytest.raises(ModelError, match="expected models nested at most 100 deep"):
        load_robot(tmp_path / "0.sdf")
    assert load_robot(tmp_path / "90.sdf").model.nbodies == 13


def test_a_moment_may_be_negative_by_rounding_alone():
    written = (
        ARM.replace("<ixx>0.02", "<ixx>-1e-5")
        .replace("<ixy>0.003", "<ixy>0")
        .replace("<ixz>-0.001", "<ixz>0")
    )
    large = written.replace("<iyy>0.03", "<iyy>1e6").replace("<izz>0.04", "<izz>1e6")
    assert load_robot(large).model.nv == 1
    with pytest.raises(ModelError, match="expected no negative moment of inertia, got -1"):
        load_robot(written)


VISUALS = {
    "base": "<box><size>0.1 0.2 0.3</size></box>",
    "arm": "<cylinder><radius>0.1</radius><length>0.4</length></cylinder>",
    "slider": "<sphere><radius>0.2</radius></sphere>",
    "palm": "<capsule><radius>0.1</radius><length>0.3</length></capsule>",
    "finger": "<ellipsoid><radii>0.1 0.2 0.3</radii></ellipsoid>",
}
PLACES = (
    pose("0.1 0.2 0.3 0.4 0.5 0.6"),
    pose("0.1 -0.2 0.3 10 20 30", "corner", ' degrees="true"'),
    pose("0.3 0.1 0.2 0.1 0.7 -0.1 0.7", "arm", ' rotation_format="quat_xyzw"'),
    pose("0 0.1 0 0.2 0 0", "grip"),
    "",
)
RED = "<material><ambient>0 0 1</ambient><diffuse>1 0.5 0.25 0.75</diffuse></material>"


def with_visuals():
    text = RICH
    for (name, shape), place in zip(VISUALS.items(), PLACES, strict=True):
        visual = f'<visual name="seen">{place}<geometry>{shape}</geometry>{RED}</visual>'
        text = text.replace(f'<link name="{name}">', f'<link name="{name}">{visual}')
    return text


def test_shapes_are_where_drake_has_them():
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, 0.0)
    Parser(plant).AddModelsFromString(with_visuals(), "sdf")
    plant.Finalize()
    inspector, theirs = scene.model_inspector(), {}
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        theirs[body.name()] = (
            inspector.GetPoseInFrame(geometry).GetAsMatrix4(),
            inspector.GetShape(geometry),
            inspector.GetIllustrationProperties(geometry).GetProperty("phong", "diffuse"),
        )
    model = load_robot(with_visuals()).model
    found, left_out = visuals_of(model, with_visuals())
    assert left_out == []
    assert len(found) == len(theirs) == len(VISUALS)
    names = [*VISUALS][:3] + [f"hand::{name}" for name in ("palm", "finger")]
    for name, visual in zip(names, found, strict=True):
        place, shape, colour = theirs[name.rpartition("::")[2]]
        frame = model.frames[model.getFrameId(name)]
        assert visual.joint == frame.parentJoint
        own = frame.placement.actInv(visual.placement).homogeneous
        np.testing.assert_allclose(own, place, rtol=0, atol=1e-14)
        sizes = {
            "box": lambda s: s.size(),
            "sphere": lambda s: [s.radius()],
            "ellipsoid": lambda s: [s.a(), s.b(), s.c()],
        }.get(visual.kind, lambda s: [s.radius(), s.length()])
        assert type(shape).__name__.lower() == visual.kind
        assert visual.size == tuple(sizes(shape))
        assert visual.colour == tuple(colour.rgba)


def test_shapes_that_are_not_drawn_are_told():
    model = load_robot(ARM).model
    assert visuals_of(model, ARM) == ([], [])
    assert sum(inertia.mass for inertia in model.inertias) == 1.3  # the base is fixed
    for shape, words in (
        ("", "a shape that is not drawn: none"),
        ("<geometry><plane/></geometry>", "<visual name='v'>: a shape that is not drawn: plane"),
        ("<geometry><box/></geometry>", "<box>: the element <size> is missing"),
        ("<geometry><box><size>1 1</size></box></geometry>", "<size>: expected 3 finite numbers, got '1 1'"),
        ("<geometry><mesh><uri>a.stl</uri><submesh/></mesh></geometry>", "parts of a mesh are not drawn"),
        (
            f"<geometry><sphere><radius>1</radius></sphere></geometry>{RED.replace('0.75', 'x')}",
            "<diffuse>: expected 4 finite numbers, got '1 0.5 0.25 x'",
        ),
    ):
        text = ARM.replace("<inertial>", f'<visual name="v">{shape}</visual><inertial>', 1)
        found, (told,) = visuals_of(model, text)
        assert (found, words in told) == ([], True), told
    nothing = "<visual name='v'><geometry><empty/></geometry></visual><inertial>"
    assert visuals_of(model, ARM.replace("<inertial>", nothing, 1)) == ([], [])


def test_no_joint_of_a_damaged_file_is_lost_in_silence():
    """What is read without a word has every joint of the file: in the tree, as a closure or as a coupling."""
    rng, read = random.Random(5), 0  # noqa: S311 - no secret
    for _ in range(600):
        written = damaged(rng.choice(ALL).encode(), "xml", rng).decode("utf-8", "replace")
        if not written.startswith("<"):
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                robot = load_robot(written, ())
        except (ModelError, ModelWarning):
            continue
        names = {str(frame.name) for frame in robot.model.frames}
        names |= {str(coupling.name) for coupling in robot.sidecar.couplings}
        for element in Xml.fromstring(written).iter("joint"):  # noqa: S314 - our own text
            name = element.get("name")
            found = [one for one in names if one.rpartition("::")[2] in (name, f"{name}_1", f"{name}_parent")]
            assert found, (name, written)
        read += 1
    assert read > 50


def test_the_documentation_has_the_table_of_the_reader():
    page = (ROOT / "docs/reference/sdf-elements.md").read_text(encoding="utf-8")
    assert sdf_file.table() in page, "write what table() of sdf_file.py returns into the page"
    for kind in KINDS:
        assert f"`{kind}`" in page


def test_an_unknown_element_that_names_two_links_is_not_left_out():
    belt = '<belt_drive><from>base</from><to side="left">hand</to></belt_drive>'
    text = sdf(link("base"), link("hand"), joint("wrist", "base", "hand"), belt)
    with pytest.raises(ModelError, match="<belt_drive> in <model> looks like a loop, and is not understood"):
        load_robot(text)
    with pytest.warns(ModelWarning, match="left out: <belt_drive> in <model>"):
        load_robot(text.replace(belt, belt.replace("hand", "tip")))
    assert load_robot(text, on_unknown="ignore").actuated == ("wrist",)
