"""Robots from other people's files: what is read, what is refused, and that it is the same machine."""

import contextlib
import dataclasses
import math
import pathlib
import re
import sys
import warnings
from xml.etree import ElementTree as Xml

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from other_robots import STAND_INS, load, others, urdf_of
from robot_texts import (
    BALL,
    BUSHING,
    CONTROL,
    GAZEBO,
    GEAR,
    INSIDE,
    LOOP_JOINT,
    MIMIC,
    QUIET,
    RATE,
    ROTOR,
    SRDF,
    TRANSMISSION,
    chain,
    loop,
)

import p3dof
from p3dof._base.errors import InputError, ModelError, ModelWarning
from p3dof.loops import Closure, Coupling, Sidecar, xml_text
from p3dof.loops.formats import urdf, urdf_loops
from p3dof.loops.robots import load_robot
from p3dof.loops.tables import facts_table
from p3dof.loops.trees import with_joints

POSE, VELOCITY, ACCELERATION = (0.03, -0.04, 0.2), (0.2, 0.3, -1.0), (1.0, -2.0, 3.0)


# The machine of this package, as it is written for others -------------------------------------------------


@pytest.mark.parametrize(
    "file", ["p3dof.urdf", "p3dof_plus.urdf", "p3dof_drake.urdf", "p3dof_mjcf.xml", "p3dof.sdf"]
)
def test_what_is_written_for_others_is_read_back_as_the_same_machine(file):
    if file.endswith(".xml"):
        pytest.importorskip("mujoco")
    robot, loaded = p3dof.load(), load_robot(ROOT / "urdf" / file)
    state = robot.inverse_dynamics(
        p3dof.Motion([0.0, 1.0], [POSE] * 2, [VELOCITY] * 2, [ACCELERATION] * 2, check=False)
    ).joints
    loaded.model.gravity.linear = robot.parameters.gravity  # a URDF has no place for it
    order = [state.names.index(name) for name in list(loaded.model.names)[1:]]
    q, v, a = (array[0, order] for array in (state.q, state.v, state.a))
    assert loaded.model.nv - loaded.rank(q) == 3
    assert len(loaded.sidecar.closures) == 3
    actuated = ("slide_a", "slide_b", "slide_c")
    loaded = p3dof.ClosedLoopModel(loaded.model, Sidecar(loaded.sidecar.closures, actuated))
    tau = loaded.inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(tau, robot.forces(POSE, VELOCITY, ACCELERATION), rtol=1e-9)


def test_loops_of_a_file_are_not_closed_again_by_the_sidecar_of_a_urdf_beside_it():
    """Which closures bear what would be open; a sidecar that is asked for adds its own."""
    file = ROOT / "urdf/p3dof.sdf"
    assert file.with_suffix(".yaml").exists()
    assert load_robot(file).actuated == ("slide_a", "slide_b", "slide_c")
    assert len(load_robot(file).sidecar.closures) == 3
    assert len(load_robot(file, file.with_suffix(".yaml")).sidecar.closures) == 6


# Sidecars of the Gepetto team ------------------------------------------------------------------------------


def test_a_fixed_joint_may_have_a_zero_axis():
    fixed = (
        '<link name="mark"/><joint name="glue" type="fixed"><axis xyz="0 0 0"/><parent link="lower"/>'
        '<child link="mark"/></joint>'
    )
    assert load_robot(chain(fixed)).model.nv == 2
    with pytest.raises(ModelError, match="<axis> xyz: expected a direction, got zero"):
        load_robot(chain(fixed.replace('"fixed"', '"continuous"')))


def sidecar(kind, name="elbow", actuated=()):
    return {
        "closed_loop": [],
        "type": [],
        "name_mot": list(actuated),
        "joint_name": [name],
        "joint_type": [kind],
    }


def test_a_sidecar_makes_a_hinge_a_ball_that_keeps_its_name():
    model = load_robot(chain(), sidecar("SPHERICAL", actuated=["shoulder"])).model
    assert list(model.names) == ["universe", "shoulder", "elbow"]
    assert model.joints[2].shortname() == "JointModelSpherical"
    q = np.array([0.7, *pin.Quaternion(pin.exp3(np.array([0.1, -0.4, 0.2]))).coeffs()])
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    turned = pin.SE3(pin.exp3(np.array([0.1, -0.4, 0.2])), np.array([0.4, 0, 0]))
    expected = pin.SE3(pin.exp3(np.array([0, 0.7, 0])), np.zeros(3)) * turned
    np.testing.assert_allclose(
        data.oMf[model.getFrameId("lower")].homogeneous, expected.homogeneous, rtol=0, atol=1e-15
    )


@pytest.mark.parametrize("axes", ["XY", "ZY", "XZ"])
def test_a_sidecar_makes_a_hinge_a_universal_joint_of_two(axes):
    loaded = load_robot(chain(), sidecar(f"UJOINT_{axes}", actuated=[f"elbow_{axes[0]}"]))
    model = loaded.model
    assert list(model.names)[1:] == ["shoulder", f"elbow_{axes[0]}", f"elbow_{axes[1]}"]
    assert loaded.actuated == (f"elbow_{axes[0]}",)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0.0, 0.5, -0.8]))
    first, second = (np.eye(3)["XYZ".index(axis)] for axis in axes)
    np.testing.assert_allclose(
        data.oMf[model.getFrameId("lower")].rotation,
        pin.exp3(0.5 * first) @ pin.exp3(-0.8 * second),
        rtol=0,
        atol=1e-15,
    )
    assert sum(body.mass for body in model.inertias) == robots.ROD.mass + robots.BAR.mass


def test_a_sidecar_locks_a_joint():
    model = load_robot(chain(), sidecar("FIXED", actuated=["shoulder"])).model
    assert list(model.names)[1:] == ["shoulder"]
    assert model.inertias[1].mass == pytest.approx(robots.ROD.mass + robots.BAR.mass)


@pytest.mark.parametrize("kind", ["UJOINT_XX", "UJOINT_AB", "BALL", "spherical", "UJOINT_XYZ"])
def test_another_type_in_a_sidecar_is_refused(kind):
    with pytest.raises(ModelError, match=rf"joint_type\[0\]: expected SPHERICAL, FIXED or .*, got '{kind}'"):
        load_robot(chain(), sidecar(kind))


def test_a_joint_of_a_sidecar_that_does_not_exist_is_told_and_left_out():
    with pytest.warns(ModelWarning, match=r"joint_name\[0\]: the joint 'elbov' does not exist; did you mean"):
        assert load_robot(chain(), sidecar("SPHERICAL", "elbov")).model.nv == 2


def test_the_sidecar_beside_a_file_is_taken(tmp_path):
    (tmp_path / "arm.urdf").write_text(robots.four_bar(*robots.FOUR_BAR))
    (tmp_path / "arm.yaml").write_text(robots.FOUR_BAR_SIDECAR.to_yaml())
    assert load_robot(tmp_path / "arm.urdf").sidecar == robots.FOUR_BAR_SIDECAR
    assert load_robot(tmp_path / "arm.urdf", ()).sidecar.closures == ()
    (tmp_path / "arm.yaml").write_text("something: else")
    straight = robots.four_bar(0.5, 0.2, 0.45, 0.15)  # at neutral its ends are at one place
    (tmp_path / "arm.urdf").write_text(straight)
    with pytest.warns(ModelWarning, match="coincide"):
        load_robot(tmp_path / "arm.urdf")


def test_frames_of_onshape_to_robot_close_a_loop_unless_a_sidecar_does():
    text, known = robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR
    ends = [known.closures[0].frame1, known.closures[0].frame2]
    for number, end in enumerate(ends, 1):
        assert f'"{end}"' in text
        text = text.replace(f'"{end}"', f'"closing_pin_{number}"')
    loaded = load_robot(text)
    assert loaded.sidecar.closures == (Closure("closing_pin_1", "closing_pin_2"),)
    usual = load_robot(robots.four_bar(*robots.FOUR_BAR), known)
    q = usual.assemble().q
    np.testing.assert_array_equal(loaded.closure_error(q), usual.closure_error(q))
    assert loaded.mobility(q) == usual.mobility(q) == 1
    assert load_robot(text, ()).sidecar.closures == ()
    hinged = dataclasses.replace(known, closures=(Closure("closing_pin_2", "closing_pin_1", "hinge"),))
    assert load_robot(text, hinged).sidecar.closures == hinged.closures
    alone = text.replace("closing_pin_2", "closed_pin_2")
    with pytest.warns(
        ModelWarning, match="as an open tree, but it has names such as 'closing_pin_1', and no"
    ):
        assert load_robot(alone).sidecar.closures == ()
    one_body = chain(
        "".join(
            robots.link(f"closing_a_{i}") + robots.joint(f"mark_{i}", "lower", f"closing_a_{i}", kind="fixed")
            for i in (1, 2)
        )
    )
    with pytest.warns(ModelWarning, match="it has names such as 'closing_a_1' and 'closing_a_2', and no"):
        assert load_robot(one_body).sidecar.closures == ()


def test_other_joints_change_nothing_else():
    model = pin.buildSampleModelHumanoidRandom()
    model.armature = np.random.default_rng(1).random(model.nv)
    copy = with_joints(model, {})
    rng = np.random.default_rng(2)
    q, v, a = (
        pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)),
        *rng.random((2, model.nv)),
    )
    np.testing.assert_allclose(
        pin.rnea(copy, copy.createData(), q, v, a),
        pin.rnea(model, model.createData(), q, v, a),
        rtol=0,
        atol=1e-12,
    )
    for field in ("lowerPositionLimit", "upperPositionLimit", "upperEffortLimit", "armature"):
        np.testing.assert_array_equal(getattr(copy, field), getattr(model, field))
    assert [frame.name for frame in copy.frames] == [frame.name for frame in model.frames]


# Loops in the URDF itself ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("revolute", "hinge"),
        ("continuous", "hinge"),
        ("spherical", "3d"),
        ("fixed", "6d"),
        ("prismatic", "slider"),
        ("cylindrical", "cylindrical"),
        ("planar", "planar"),
    ],
)
def test_a_loop_of_urdf_plus_is_a_closure_along_its_axis(kind, expected):
    loaded = load_robot(chain(loop(kind)))
    (closure,) = loaded.sidecar.closures
    assert closure == Closure("ring_predecessor", "ring_successor", expected)
    frame = loaded.model.frames[loaded.model.getFrameId("ring_predecessor")]
    rotation = pin.exp3(np.array([0, 0.3, 0]))
    np.testing.assert_allclose(frame.placement.translation, [0.4, 0, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(frame.placement.rotation[:, 2], rotation @ [0, 1, 0], rtol=0, atol=1e-15)
    assert np.linalg.det(frame.placement.rotation) == pytest.approx(1)


def test_the_axis_z_of_a_loop_turns_nothing():
    frame = load_robot(chain(loop(axis="0 0 2"))).model.frames[-1]
    np.testing.assert_array_equal(frame.placement.rotation, np.eye(3))


def test_a_coupling_of_urdf_plus_ties_the_successor_to_the_predecessor():
    loaded = load_robot(chain(ROTOR + GEAR))
    assert loaded.sidecar.couplings == (Coupling("rotor_joint", "shoulder", (0.0, 6.0), "gear"),)
    assert loaded.actuated == ("shoulder", "elbow")


def test_a_coupling_of_two_chains_ties_their_sums():
    """The rotation of a link is the sum over the joints below the nearest link that both hang on."""
    loaded = load_robot(chain(ROTOR + GEAR.replace('link="upper"', 'link="lower"')))
    (coupling,) = loaded.sidecar.couplings
    assert (coupling.joint, coupling.on, coupling.coefficients) == ("rotor_joint", "elbow", (0.0, 6.0))
    assert coupling.others == (("shoulder", 6.0),)


def test_joints_that_depend_by_the_files_own_word_are_not_actuated():
    xml = chain(ROTOR + GEAR).replace('<joint name="elbow"', '<joint independent="false" name="elbow"')
    assert load_robot(xml).actuated == ("shoulder",)


def test_mimic_ties_two_joints_unless_the_user_says_otherwise():
    xml = chain(second='<mimic joint="shoulder" multiplier="-2" offset="0.3"/>')
    loaded = load_robot(xml)
    assert loaded.sidecar.couplings == (Coupling("elbow", "shoulder", (0.3, -2.0), "mimic_elbow"),)
    assert loaded.actuated == ("shoulder",)
    free = load_robot(xml, mimic=False)
    assert (free.sidecar.couplings, free.actuated) == ((), ("shoulder", "elbow"))
    assert load_robot(chain(second='<mimic joint="shoulder"/>')).sidecar.couplings[0].coefficients == (
        0.0,
        1.0,
    )


def test_a_sidecar_and_the_file_are_taken_together():
    own = Coupling("elbow", "shoulder", (0.0, 5.0))
    xml = chain(second='<mimic joint="shoulder"/>', extra=loop("spherical"))
    loaded = load_robot(xml, Sidecar((Closure("upper", "base"),), ("shoulder",), (own,)))
    assert loaded.sidecar.couplings == (own,)
    assert [closure.frame1 for closure in loaded.sidecar.closures] == ["upper", "ring_predecessor"]


def test_drakes_ball_constraint_is_a_point_closure():
    loaded = load_robot(chain(BALL))
    assert loaded.sidecar.closures == (Closure("ball_constraint_1_A", "ball_constraint_1_B"),)


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (
            chain('<loop_joint name="x"/>'),
            "<loop_joint name='x'>: type: expected one of revolute, .*, got ''",
        ),
        (
            chain('<loop_joint type="fixed"><link1 link="base"/></loop_joint>'),
            "expected <link1> and <link2>, got 1",
        ),
        (
            chain(LOOP_JOINT.format("revolut")),
            "<loop_joint name='ring'>: type: expected one of revolute, .*, got",
        ),
        (
            chain(LOOP_JOINT.format("fixed").replace("lower", "lover")),
            "'lover' does not exist; did you mean 'lower'",
        ),
        (
            chain(LOOP_JOINT.format("fixed").replace("lower", "base")),
            "expected two links that move against each other",
        ),
        (chain("<tendon/>"), "<tendon> may hold links or joints together, and is not understood"),
        (
            chain('<drake:distance_constraint name="x"/>'),
            "<drake:distance_constraint> may hold links or joints",
        ),
        (
            chain(GAZEBO.format("gearbox")),
            "<joint name='c'>: type: expected one of revolute, .*, got 'gearbox'",
        ),
        (
            chain(GAZEBO.format("ball").replace("lower", "lover")),
            "the link 'lover' does not exist; did you mean 'lower'",
        ),
        (chain(GAZEBO.format("ball").replace("<child>lower</child>", "")), "the element <child> is missing"),
        (
            chain(GAZEBO.format("ball").replace("0.4 0", "0.4 x")),
            "<pose>: expected 6 finite numbers, got '0.4 x",
        ),
        (
            chain(GAZEBO.format("ball").replace("<pose>", '<pose relative_to="base">')),
            "<pose> relative_to: expected the child link, got 'base'",
        ),
        (
            chain(GAZEBO.format("revolute").replace("0 1 0", "0 0 0")),
            "<axis>: expected a direction, got zero",
        ),
        (
            chain(GAZEBO.format("revolute").replace("<xyz>", '<xyz expressed_in="base">')),
            "<axis>: expected an axis in the joint's own frame",
        ),
        (
            chain(GAZEBO.format("universal").replace("0 1 0", "0 0 1")),
            "expected <axis> and <axis2> perpendicular to each other",
        ),
        (
            chain('<frame name="upper" link="lower"/>'),
            "<frame name='upper'>: a frame 'upper' is there already",
        ),
        (chain('<frame link="lower"/>'), "<frame>: it has no name"),
        (
            chain('<frame name="x" link="lover"/>'),
            "<frame>: the link 'lover' does not exist; did you mean 'lower'",
        ),
        (chain('<fixed_frame name="x"/>'), "<fixed_frame name='x'>: the element <parent> is missing"),
        (
            chain("<a/>").replace(
                "<a/>", '<link name="b"/><link name="c"/><link name="d"/><link name="e"/><link name="f"/>'
            ),
            "expected one root link, got base, b, c, d, e, f$",
        ),
        (chain(loop("screw")), "<loop name='ring'>: type: expected one of revolute, .*, got 'screw'"),
        (chain(loop(a="lover")), "the link 'lover' does not exist; did you mean 'lower'"),
        (chain(loop(axis="0 0 0")), "axis: expected a direction, got zero"),
        (chain(loop(axis="0 nan 0")), "<axis> xyz: expected 3 finite numbers, got '0 nan 0'"),
        (chain('<loop name="ring" type="revolute"/>'), "the element <predecessor> is missing"),
        (chain(ROTOR + GEAR.replace("rolling", "belt")), "type: expected 'rolling', got 'belt'"),
        (
            chain(ROTOR + GEAR.replace('value="6"', 'value="six"')),
            "<ratio> value: expected a finite number, got 'six'",
        ),
        (chain(ROTOR + GEAR.replace('link="rotor"', 'link="lower"')), "one hangs on the other"),
        (
            chain(second='<mimic joint="shulder"/>'),
            "the joint 'shulder' does not exist .* did you mean 'shoulder'",
        ),
        (
            chain(second='<mimic joint="shoulder" multiplier="x"/>'),
            "<mimic> multiplier: expected a finite number, got 'x'",
        ),
        (chain(first='<parent link="base"/>'), "<parent> is given twice in <joint>"),
        (chain().replace('xyz="0 1 0"', 'xyz="0 1e-320 0"', 1), "expected a direction, got nearly zero"),
        (
            chain().replace('xyz="0 1 0"', 'xyz="1e308 1 0"', 1),
            "expected a direction, got one that is too long",
        ),
        (chain(first='<limit effort="1" velocity="1"/>'), "<limit> is given twice in <joint>"),
        (
            chain().replace('"revolute"', '"hinge"', 1),
            "joint 'shoulder': type: expected one of revolute, .*, got 'hinge'",
        ),
        (chain().replace("<limit", "<limits", 1), "joint 'shoulder': a revolute joint needs a <limit>"),
        (
            chain().replace('effort="9"', 'effort="-9"', 1),
            "<limit> effort: expected no negative number, got -9",
        ),
        (
            chain().replace('effort="9"', 'effort="inf"', 1),
            "<limit> effort: expected a finite number, got 'inf'",
        ),
        (chain().replace("<inertia ", "<moments ", 1), "link 'upper': its <inertial> has no <inertia>"),
        (chain().replace("<mass ", "<weight ", 1), "link 'upper': its <inertial> has no <mass>"),
        (
            chain().replace('name="elbow"', 'independent="false" name="elbow"'),
            "no <loop> or <coupling> says on what",
        ),
        (chain(BALL.replace('"lower"', '"none"')), "the link 'none' does not exist"),
        ("<sdf/>", "version: expected 1.4 to 1.12, got None"),
        ("<html/>", "expected URDF .* or MJCF .*, got <html>"),
        ("<robot", "not well-formed XML"),
        ("<!DOCTYPE x><robot/>", "a document type declaration is not allowed"),
    ],
)
def test_what_is_not_understood_is_one_clear_error(xml, message):
    with pytest.raises(ModelError, match=message):
        load_robot(xml)


def line_of(text, part):
    return text[: text.index(part)].count("\n") + 1


def test_a_wrong_bushing_is_named_with_its_line(tmp_path):
    path, text = tmp_path / "four_bar.urdf", chain(BUSHING.replace("3e4 3e4", "3e4 -3e4"))
    path.write_text(text, encoding="utf-8")
    line = line_of(text, "<drake:linear_bushing_rpy")
    words = (
        rf"four_bar\.urdf, line {line}: <drake:linear_bushing_rpy>: expected no negative stiffness or damping"
    )
    for options in ({}, {"on_unknown": "ignore"}, {"bushings": "closures"}):
        with pytest.raises(ModelError, match=words):
            load_robot(path, **options)
    for options in ({}, {"on_unknown": "ignore"}):
        assert load_robot(chain(BUSHING), **options).sidecar.bushings[0].stiffness == (3e4,) * 3 + (0.0,) * 3


def test_a_plugin_that_ties_joints_in_its_simulator_is_named_with_its_line(tmp_path):
    path, text = tmp_path / "gripper.urdf", chain(MIMIC.format(name="follow"))
    path.write_text(text, encoding="utf-8")
    told = (
        rf"gripper\.urdf, line {line_of(text, '<plugin')}: <plugin name='follow'> ties the joint 'elbow' "
        "to others in its simulator only, and is left out"
    )
    with pytest.warns(ModelWarning, match=told):
        loaded = load_robot(path)
    assert loaded.actuated == ("shoulder", "elbow")
    with pytest.warns(ModelWarning, match="<plugin name='closed_loop_plugin'> ties joints"):
        load_robot(chain('<gazebo><plugin name="closed_loop_plugin"/></gazebo>'))


@pytest.mark.parametrize(
    ("xml", "options"),
    [
        (chain(MIMIC.format(name="x"), second='<mimic joint="shoulder"/>'), {}),  # the tree has it too
        (chain(MIMIC.format(name="x")), {"mimic": False}),
        (chain(MIMIC.format(name="x")), {"on_unknown": "ignore"}),
        (
            chain(MIMIC.format(name="x")),
            {"sidecar": Sidecar((), ("shoulder",), (Coupling("elbow", "shoulder", (0.0, 1.0)),))},
        ),
        (chain(MIMIC.format(name="x").replace("elbow", "wheel")), {}),  # no joint that moves
        (chain(RATE), {}),  # the rate of a control loop
    ],
)
def test_what_ties_nothing_that_is_loose_says_nothing(xml, options):
    load_robot(xml, **options)  # warnings are errors


def test_what_is_not_understood_may_be_left_out_by_the_users_own_word():
    unknown = (
        f'<tendon/><weight a="1"/><loop_joint name="x"/>{GAZEBO.format("gearbox")}{MIMIC.format(name="x")}'
    )
    loaded = load_robot(chain(unknown), on_unknown="ignore")
    assert (loaded.model.nv, loaded.sidecar.closures) == (2, ())
    assert load_robot(chain(LOOP_JOINT.format("fixed")), on_unknown="ignore").sidecar.closures
    with pytest.raises(InputError, match="on_unknown: expected 'raise' or 'ignore', got 'skip'"):
        load_robot(chain(), on_unknown="skip")


# Loops in other dialects of URDF: the same machine as with a sidecar ----------------------------------------

MACHINE = robots.robot(
    robots.link("base"),
    robots.link("crank", robots.ROD),
    robots.link("coupler", robots.BAR),
    robots.link("end", robots.ROD),
    robots.link("rocker", robots.ARM),
    robots.joint("crank_joint", "base", "crank", (0.1, 0, 0), rpy=(0, -1.1, 0)),
    robots.joint("coupler_joint", "crank", "coupler", (0.3, 0.05, 0), rpy=(0, 0.8, 0)),
    robots.joint("end_joint", "coupler", "end", (0.4, 0, 0), rpy=(0, 0.3, 0)),
    robots.joint("rocker_joint", "base", "rocker", (0.6, 0.02, 0), rpy=(0, -1.6, 0)),
)
"""Four hinges about y in a plane, which a closure between `end` and `rocker` makes a ring."""
ALONG = {"slider": (math.cos(0.4), 0.0, math.sin(0.4))}  # the free axis in space, y for all others
TURN = pin.SE3(
    pin.rpy.rpyToMatrix(0.3, 0.2, -0.5), np.array([0.35, 0.02, 0.03])
)  # of the joint in the rocker


def on_links(of_rocker):
    """The same place on `end` and on `rocker`, where all joints are zero."""
    model = pin.buildModelFromXML(MACHINE)
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    end, rocker = (data.oMf[model.getFrameId(name)] for name in ("end", "rocker"))
    return end.inverse() * rocker * of_rocker, of_rocker, rocker * of_rocker


def numbers(values):
    return " ".join(repr(float(value)) for value in values)


def attributes(place):
    return f'xyz="{numbers(place.translation)}" rpy="{numbers(pin.rpy.matrixToRpy(place.rotation))}"'


def with_frame_axes(kind, rotation):
    """A rotation in space whose z is the free axis; of a universal joint x is y in space, and y across it."""
    free = np.array(ALONG.get(kind, (0.0, 1.0, 0.0)))
    other = np.cross(free, rotation[:, 0])
    other /= np.linalg.norm(other)
    if kind == "universal":
        return np.column_stack((free, other, np.cross(free, other)))
    return np.column_stack((other, np.cross(free, other), free))


def same_machine(text, kind, **options):
    """Read a text, and the machine with marks and a sidecar; compare their mobility, motion and forces."""
    world = on_links(TURN)[2]
    aligned = TURN * pin.SE3(world.rotation.T @ with_frame_axes(kind, world.rotation), np.zeros(3))
    marks = ""
    for name, place in zip(("end", "rocker"), on_links(aligned), strict=False):
        marks += robots.link(f"{name}_mark") + robots.joint(
            f"{name}_glue",
            name,
            f"{name}_mark",
            place.translation,
            kind="fixed",
            rpy=pin.rpy.matrixToRpy(place.rotation),
        )
    actuated = ("crank_joint", "rocker_joint")[: 1 if kind == "6d" else 2]
    expected = load_robot(
        MACHINE.replace("</robot>", f"{marks}</robot>"),
        Sidecar((Closure("end_mark", "rocker_mark", kind),), actuated),
    )
    loaded = load_robot(MACHINE.replace("</robot>", f"{text}</robot>"), **options)
    (closure,) = loaded.sidecar.closures
    assert closure.kind == kind
    loaded = p3dof.ClosedLoopModel(loaded.model, Sidecar((closure,), actuated))
    start = np.full(len(actuated), 0.03)
    motion = [robot.complete(start, 2 * start + 0.1, 0.4 - start) for robot in (loaded, expected)]
    for name in ("q", "v", "a"):
        np.testing.assert_allclose(*(getattr(one, name) for one in motion), rtol=0, atol=1e-9)
    mobility = [
        robot.model.nv - robot.rank(one.q) for robot, one in zip((loaded, expected), motion, strict=True)
    ]
    assert mobility == [len(actuated)] * 2
    tau = [
        robot.inverse_dynamics(one.q, one.v, one.a).tau
        for robot, one in zip((loaded, expected), motion, strict=True)
    ]
    np.testing.assert_allclose(*tau, rtol=0, atol=1e-9 * np.abs(tau[1]).max())
    return loaded


def axes(kind):
    """The axes in the joint's own frame."""
    world = on_links(TURN)[2].rotation
    wanted = world.T @ with_frame_axes(kind, world)
    return (wanted[:, 0], wanted[:, 1]) if kind == "universal" else (wanted[:, 2], wanted[:, 0])


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("revolute", "hinge"),
        ("continuous", "hinge"),
        ("prismatic", "slider"),
        ("ball", "3d"),
        ("universal", "universal"),
        ("fixed", "6d"),
    ],
)
def test_a_joint_of_gazebo_closes_a_loop_as_in_sdf(kind, expected):
    """The pose is in the child, the axes in the joint, and the joint is closed where all others are zero."""
    first, second = (f"<xyz>{numbers(axis)}</xyz>" for axis in axes(expected))
    pose = numbers((*TURN.translation, *pin.rpy.matrixToRpy(TURN.rotation)))
    text = (
        f'<gazebo><joint name="ring" type="{kind}"><parent>end</parent><child> rocker\n</child>'
        f"<pose>{pose}</pose>"
        f"<axis>{first}<limit><lower>-1</lower></limit></axis><axis2>{second}</axis2></joint></gazebo>"
    )
    loaded = same_machine(text, expected)
    assert loaded.sidecar.closures[0].name == "ring_parent/ring_child"


def test_a_joint_of_gazebo_may_hold_a_link_on_the_world():
    """Its axis is z, as in SDF, where nothing is said."""
    text = (
        GAZEBO.format("prismatic")
        .replace("<parent>base", "<parent>world")
        .replace("<axis><xyz>0 1 0</xyz></axis>", "")
    )
    loaded = load_robot(chain(text))
    (closure,) = loaded.sidecar.closures
    assert closure == Closure("c_parent", "c_child", "slider")
    parent, child = (
        loaded.model.frames[loaded.model.getFrameId(name)] for name in (closure.frame1, closure.frame2)
    )
    assert parent.parentJoint == 0
    np.testing.assert_allclose(parent.placement.translation, [0.8, 0, 0], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(child.placement.rotation, np.eye(3))


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("revolute", "hinge"), ("prismatic", "slider"), ("spherical", "3d"), ("fixed", "6d")],
)
@pytest.mark.parametrize("second", ["link1", "link2"])
def test_a_loop_joint_closes_a_loop(kind, expected, second):
    """Isaac Sim's documentation calls both links <link1>."""
    end, rocker, _ = on_links(TURN)
    axis = f'<axis xyz="{numbers(axes(expected)[0])}"/>'
    places = [f'link="end" {attributes(end)}/>', f'link="rocker" {attributes(rocker)}/>']
    if second == "link2":
        places[1] = f'link="rocker"><origin {attributes(rocker)}/></link2>'
    text = f'<loop_joint name="ring" type="{kind}"><link1 {places[0]}<{second} {places[1]}{axis}</loop_joint>'
    assert same_machine(text, expected).sidecar.closures[0].name == "ring_1/ring_2"


def bushing(forces, torques, rotation=None):
    """Drake's bushing between two of its frames."""
    turn = TURN if rotation is None else TURN * pin.SE3(rotation, np.zeros(3))
    end, rocker, _ = on_links(turn)
    return (
        f'<frame name="on_end" link="end" {attributes(end)}/>'
        f'<frame name="on_rocker" link="rocker" {attributes(rocker)}/>'
        '<drake:linear_bushing_rpy><drake:bushing_frameA name="on_end"/>'
        '<drake:bushing_frameC name="on_rocker"/>'
        f'<drake:bushing_torque_stiffness value="{torques}"/><drake:bushing_torque_damping value="1 1 1"/>'
        f'<drake:bushing_force_stiffness value="{forces}"/><drake:bushing_force_damping value="1 1 1"/>'
        "</drake:linear_bushing_rpy>"
    )


def with_axis(kind, index):
    """A rotation that brings an axis of the frames along the free one."""
    world = on_links(TURN)[2].rotation
    return np.roll(world.T @ with_frame_axes(kind, world), index + 1, axis=1)


STIFF = "3e4 2e4 3e4"
BUSHINGS = [
    (STIFF, "0 0 0", "3d", None),
    (STIFF, STIFF, "6d", None),
    (STIFF, "0 5e3 1e3", "hinge", 0),
    (STIFF, "5e3 0.5 1e3", "hinge", 1),  # next to nothing
    (STIFF, "5e3 1e3 0", "hinge", 2),
    ("0 3e4 2e4", STIFF, "slider", 0),
    ("3e4 2e4 0", STIFF, "slider", 2),
]


@pytest.mark.parametrize(("forces", "torques", "kind", "index"), BUSHINGS)
def test_a_bushing_of_drake_is_the_closure_that_it_stands_for(forces, torques, kind, index):
    rotation = None if index is None else with_axis(kind, index)
    text = bushing(forces, torques, rotation)
    loaded = same_machine(text, kind, bushings="closures")
    assert loaded.sidecar.closures[0].name == "bushing_1_A/bushing_1_C"
    plain = load_robot(MACHINE.replace("</robot>", f"{text}</robot>"))
    assert [bushing.title for bushing in plain.sidecar.bushings] == ["bushing_1"]


@pytest.mark.parametrize(("forces", "torques", "kind", "index"), BUSHINGS)
def test_the_forces_of_a_bushing_vanish_where_its_closure_holds(forces, torques, kind, index):
    pytest.importorskip("pydrake", reason="make test EXTRAS=all installs it")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import MultibodyForces

    rotation = None if index is None else with_axis(kind, index)
    text = MACHINE.replace("</robot>", f"{bushing(forces, torques, rotation)}</robot>")
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    context, found = plant.CreateDefaultContext(), MultibodyForces(plant)
    actuated = ("crank_joint", "rocker_joint")[: 1 if kind == "6d" else 2]
    loaded = load_robot(text, bushings="closures")
    loaded = p3dof.ClosedLoopModel(loaded.model, Sidecar(loaded.sidecar.closures, actuated))
    q = loaded.complete(*np.full((3, len(actuated)), 0.03)).q

    def force(q):
        for name, value in zip(list(loaded.model.names)[1:], q, strict=True):
            plant.GetJointByName(name).set_angle(context, value)
        plant.CalcForceElementsContribution(context, found)
        return np.abs(plant.CalcGeneralizedForces(context, found)).max()

    assert force(q) < 3e4 * 1e-4  # of the softest torque, which holds nothing
    if "0.5" not in torques:
        assert force(q) < 3e4 * 1e-10
    assert force(q + np.array([0.0, 0.0, 0.0, 0.01])) > 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            bushing("0 0 1", "0 0 0"),
            "expected the stiffness of a point .* got forces 0 0 1 and torques 0 0 0",
        ),
        (bushing(STIFF, "1 0 0"), r"got forces 30000 20000 30000 and torques 1 0 0"),
        (bushing("0 1 1", "0 1 1"), "expected the stiffness of a point"),
        (bushing("-1 1 1", "0 1 1"), "expected no negative stiffness"),
        (
            bushing("1 1", "0 1 1"),
            "<drake:bushing_force_stiffness> value: expected 3 finite numbers, got '1 1'",
        ),
        (
            bushing(STIFF, STIFF).replace('frameC name="on_rocker"', 'frameC name="on_rock"'),
            "'on_rock' does not exist",
        ),
        (
            bushing(STIFF, STIFF).replace("bushing_frameC", "bushing_frame"),
            "<drake:bushing_frameC> is missing",
        ),
        (
            bushing(STIFF, STIFF).replace('frameC name="on_rocker"', 'frameC name="end"'),
            "expected two links that move against each other",
        ),
    ],
)
def test_a_bushing_that_stands_for_no_closure_is_one_clear_error(text, message):
    with pytest.raises(ModelError, match=message) as error:
        load_robot(MACHINE.replace("</robot>", f"{text}</robot>"), bushings="closures")
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="bushings: expected 'closures' or None, got 'yes'"):
        load_robot(MACHINE, bushings="yes")


@pytest.mark.parametrize(
    "text",
    [
        '<frame name="tool" link="lower" xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>',
        '<fixed_frame name="tool"><parent link="lower"/><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
        "</fixed_frame>",
    ],
)
def test_a_frame_of_the_file_is_one_of_the_model(text):
    model = load_robot(chain(text)).model
    frame = model.frames[model.getFrameId("tool")]
    assert model.names[frame.parentJoint] == "elbow"
    np.testing.assert_allclose(frame.placement.translation, [0.1, 0.2, 0.3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        frame.placement.rotation, pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), rtol=0, atol=1e-15
    )


@pytest.mark.parametrize("kind", ["fixed", "revolute"])
def test_a_link_may_hang_on_a_world_that_nobody_declares(kind):
    text = chain(robots.joint("foot", "world", "base", (0, 0, 0.5), kind=kind))
    loaded = load_robot(text)
    declared = load_robot(text.replace('<link name="base"/>', '<link name="world"/><link name="base"/>'))
    assert loaded.model.nv == declared.model.nv == 2 + (kind == "revolute")
    q, v, a = np.random.default_rng(1).random((3, loaded.model.nv))
    tau = [robot.inverse_dynamics(q, v, a).tau for robot in (loaded, declared)]
    np.testing.assert_allclose(*tau, rtol=1e-12)
    with pytest.raises(ModelError, match="expected one root link, got base, world"):
        load_robot(chain(robots.link("box") + robots.joint("foot", "world", "box", kind=kind)))


def test_a_root_beside_the_world_may_be_free():
    """As Drake has it: what the world carries stands still, and weighs nothing that moves."""
    alone = load_robot(chain(), root_joint=pin.JointModelFreeFlyer())
    floor = robots.link("floor", robots.ARM) + robots.joint("weld", "world", "floor", kind="fixed")
    beside = load_robot(chain(floor), root_joint=pin.JointModelFreeFlyer())
    assert list(beside.model.names) == list(alone.model.names)
    q = pin.randomConfiguration(alone.model, np.full(alone.model.nq, -1.0), np.ones(alone.model.nq))
    v, a = np.random.default_rng(1).random((2, alone.model.nv))
    tau = [pin.rnea(robot.model, robot.model.createData(), q, v, a) for robot in (alone, beside)]
    np.testing.assert_allclose(*tau, rtol=0, atol=1e-12)
    mass = [dict(facts_table(robot).rows)["moving mass"] for robot in (alone, beside)]
    assert mass[0] == mass[1]
    with pytest.raises(
        ModelError, match=r"got base, world; root_joint=pin\.JointModelFreeFlyer\(\) \(--floating\)"
    ):
        load_robot(chain(floor))
    with pytest.raises(ModelError, match=r"expected one root link, got base, box, world$"):
        load_robot(chain(floor + robots.link("box")), root_joint=pin.JointModelFreeFlyer())


def test_a_loop_may_end_at_a_world_that_nobody_declares():
    """As Drake has it; the root may float."""
    text = chain(BALL.replace('"base"', '"world"'))
    loaded = load_robot(text, root_joint=pin.JointModelFreeFlyer())
    frame = loaded.model.frames[loaded.model.getFrameId("ball_constraint_1_B")]
    assert (frame.parentJoint, loaded.model.nv, loaded.rank(pin.neutral(loaded.model))) == (0, 8, 3)
    closed = bushing(STIFF, STIFF).replace('frameC name="on_rocker"', 'frameC name="world"')
    loaded = load_robot(MACHINE.replace("</robot>", f"{closed}</robot>"), bushings="closures")
    assert loaded.model.frames[loaded.model.getFrameId("bushing_1_C")].parentJoint == 0


# Motors ----------------------------------------------------------------------------------------------------

HINGE = loop("spherical")


@pytest.mark.parametrize("text", [TRANSMISSION, CONTROL])
def test_joints_with_motors_by_the_files_own_word_are_actuated(text):
    closed = chain(
        robots.link("mark") + robots.joint("free", "lower", "mark") + text.format("shoulder") + HINGE
    )
    assert load_robot(closed).actuated == ("shoulder",)
    assert load_robot(closed, {"closed_loop": [], "type": [], "name_mot": ["elbow"]}).actuated == ("elbow",)
    tree = chain(text.format("shoulder"))  # of trees, a limit of effort says it too
    assert load_robot(tree).actuated == ("shoulder", "elbow")
    swinging = tree.replace('effort="9"', 'effort="0"')
    with pytest.warns(ModelWarning, match="these joints of a tree have no motor .* says so: 'elbow'$"):
        assert load_robot(swinging).actuated == ("shoulder",)


@pytest.mark.parametrize("text", [TRANSMISSION, CONTROL])
def test_motors_of_joints_that_follow_others_or_do_not_move_count_for_nothing(text):
    follows = '<mimic joint="shoulder"/>'
    loaded = load_robot(
        chain(text.format("elbow") + text.format("shoulder").replace("elbow", "wheel"), second=follows)
    )
    assert loaded.actuated == ("shoulder",)
    assert load_robot(chain(text.format("wheel"))).actuated == ("shoulder", "elbow")
    assert load_robot(
        chain(text.format("elbow").replace("command_interface", "state_interface").replace("actuator", "pid"))
    ).actuated == ("shoulder", "elbow")


def test_a_locked_joint_follows_nothing():
    mark = robots.link("mark") + robots.joint("glue", "lower", "mark", kind="fixed").replace(
        "</joint>", '<mimic joint="elbow"/></joint>'
    )
    loaded = load_robot(chain(mark))
    assert (loaded.actuated, loaded.sidecar.couplings) == (("shoulder", "elbow"), ())


# Elements that are not understood --------------------------------------------------------------------------

TIES = [
    '<linkage a="upper" b="lower"/>',
    '<pair><first joint="shoulder"/><second joint="elbow"/></pair>',
    "<pair>upper lower</pair>",
    "<pair><first>upper</first>\n<second>robot::lower</second></pair>",
    '<gazebo><joint:hinge name="x"><body1>upper</body1><body2>base</body2></joint:hinge></gazebo>',
    '<gazebo reference="upper"><rope to="base"/></gazebo>',
    '<drake:tendon_constraint><drake:tendon_constraint_joint name="elbow"/></drake:tendon_constraint>',
    '<drake:mimic joint="shoulder"/>',
    "<belt/>",
    '<mujoco><equality><connect body1="base" body2="lower"/></equality></mujoco>',
]


@pytest.mark.parametrize("text", TIES)
def test_what_may_hold_joints_together_is_an_error_with_its_line(text, tmp_path):
    (tmp_path / "robot.urdf").write_text(chain("\n" + text), encoding="utf-8")
    with pytest.raises(
        ModelError, match=r"robot\.urdf, line 2: <.*may hold links or joints together"
    ) as error:
        load_robot(tmp_path / "robot.urdf")
    assert "\n" not in str(error.value)
    assert load_robot(chain(text), on_unknown="ignore").model.nv == 2


@pytest.mark.parametrize(
    "text", ['<pull joint="shoulder"/>', '<pull to="base"/>', '<mimicked by="shoulder">x</mimicked>']
)
def test_what_ties_a_joint_from_inside_is_an_error(text):
    with pytest.raises(ModelError, match=r"in <joint> may hold links or joints together"):
        load_robot(chain(second=text))
    with pytest.raises(ModelError, match="the attribute 'with' of <joint> may hold links"):
        load_robot(chain().replace('<joint name="elbow"', '<joint with="shoulder" name="elbow"'))


def test_all_else_that_is_not_understood_is_one_warning_with_its_lines(tmp_path):
    inside = '\n<spring stiffness="3"/>\n<limits upper="1"/>\n<own joint="elbow" link="lower"/>'
    text = chain(
        '\n<weather wind="3"/><weather wind="4"/>\n<gazebo reference="upper"><loop_rate>10</loop_rate>'
        "</gazebo>"
        '\n<ros2_control name="a" mood="good"/>\n<sound/>',
        second=inside,
    )
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    told = (
        r"robot\.urdf: not understood, and left out: <spring> in <joint> \(line 2\), <limits> in <joint> "
        r"\(line 3\), <own> in <joint> \(line 4\), <weather> \(line 5\) and 3 more$"
    )
    with pytest.warns(ModelWarning, match=told) as found:
        assert load_robot(tmp_path / "robot.urdf").model.nv == 2
    assert len(found) == 1
    load_robot(tmp_path / "robot.urdf", on_unknown="ignore")


def test_what_public_files_have_beside_their_dynamics_says_nothing():
    text = chain(QUIET, second=INSIDE).replace(
        '<link name="base"/>',
        '<link name="base"><origin xyz="0 0 0" rpy="0 -0 0"/><visual><geometry><mesh filename="upper"/>'
        '</geometry></visual><contact><lateral_friction value="1"/></contact></link>',
    )
    load_robot(text)  # warnings are errors
    numbered = text.replace('"upper"', '"1"').replace('"lower"', '"0"')
    load_robot(numbered)  # links may be called as numbers are


def test_a_plugin_that_names_joints_in_its_own_way_is_named():
    text = chain(RATE.replace("<loop_rate>", "<driver>shoulder</driver><finger>elbow</finger><loop_rate>"))
    with pytest.warns(ModelWarning, match=r"<plugin name='control'> \(it names elbow, shoulder\) \(line 3\)"):
        load_robot(text)
    follows = '<joint name="elbow"><param name="mimic">shoulder</param></joint>'
    text = f'<ros2_control name="a" type="system">{follows}</ros2_control>'
    with pytest.warns(ModelWarning, match="<ros2_control> makes the joint 'elbow' follow another one"):
        load_robot(chain(text))
    load_robot(chain(text, second='<mimic joint="shoulder"/>'))


def random_places(text, count, seed):
    """Places in a text between its elements, below the first."""
    begin, end = text.index(">") + 1, text.rindex("</robot>")
    places = [found.end() for found in re.finditer(">", text) if begin <= found.end() <= end]
    return np.random.default_rng(seed).choice(places, count)


def test_a_random_element_that_names_two_links_or_joints_never_passes_in_silence():
    texts = [
        chain(
            ROTOR + GEAR + QUIET + TRANSMISSION.format("shoulder") + CONTROL.format("shoulder"), second=INSIDE
        ),
        chain(BALL + loop() + RATE, second='<mimic joint="shoulder"/>'),
        MACHINE.replace(
            "</robot>", f"{bushing(STIFF, STIFF)}{GAZEBO.format('ball').replace('lower', 'end')}</robot>"
        ),
        robots.four_bar(*robots.FOUR_BAR),
    ]
    rng = np.random.default_rng(7)
    for text in texts:
        tree = Xml.fromstring(text.replace("drake:", "drake."))  # noqa: S314 - our own
        names = [part.get("name") for part in tree if part.tag in ("link", "joint")]
        for place in random_places(text, 250, 5):
            one, two = rng.choice(names, 2, replace=False)
            tag = rng.choice(["strut", "drake:strut", "tie", "joint2", "x:link"])
            inside = rng.choice(
                [
                    f'<{tag} p="{one}" q="{two}"/>',
                    f"<{tag}><p>{one}</p><q>{two}</q></{tag}>",
                    f"<{tag}>{one} {two}</{tag}>",
                ]
            )
            refused = []
            with warnings.catch_warnings(record=True) as found:
                warnings.simplefilter("always")
                try:
                    load_tree(text[:place] + inside + text[place:], bushings="closures")
                except ModelError as error:
                    refused.append(str(error))
            told = [str(one.message) for one in found]
            assert refused or any(f"<{tag}> in" in line for line in told), (inside, text[:place][-80:], told)
            assert not any("\n" in line for line in (*told, *refused))


def load_tree(text, **options):
    """Read a URDF without the model of its loops, which takes longer than the file."""
    return urdf.read(text, **options)


def test_the_documentation_has_the_table_of_the_reader():
    page = (ROOT / "docs/reference/urdf-elements.md").read_text(encoding="utf-8")
    assert urdf_loops.table() in page, "write what table() of urdf_loops.py returns into the page"


# SRDF, names, references -----------------------------------------------------------------------------------


def test_a_reference_is_given_by_name_or_by_values():
    assert dict(load_robot(chain(), srdf_file=SRDF).sidecar.reference) == {"shoulder": 0.5}
    bent = load_robot(chain(), srdf_file=SRDF, reference="bent")
    assert dict(bent.sidecar.reference) == {"shoulder": 0.1, "elbow": 1.0}
    assert dict(load_robot(chain(), reference={"elbow": 2}).sidecar.reference) == {"elbow": 2.0}
    with pytest.raises(ModelError, match="the group state 'bend' does not exist; did you mean 'bent'"):
        load_robot(chain(), srdf_file=SRDF, reference="bend")
    with pytest.raises(InputError, match="reference: the name 'bent' needs an SRDF"):
        load_robot(chain(), reference="bent")
    for bad, message in (
        ('value="1"', "expected numbers, got 'x'"),
        ('"elbow"', "the joint 'elbov' does not"),
    ):
        text = SRDF.replace(bad, 'value="x"' if "value" in bad else '"elbov"')
        with pytest.raises(ModelError, match=message):
            load_robot(chain(), srdf_file=text, reference="bent")
    with pytest.raises(ModelError, match="it has no group state"):
        load_robot(chain(), srdf_file="<robot/>")


def test_robots_of_example_robot_data_have_names():
    pytest.importorskip("example_robot_data")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        panda = load_robot("panda")
    assert panda.model.nv >= 7
    assert load_robot("solo12").model.nv == 18  # it floats
    with pytest.raises(ModelError, match="'pandas' is no file and no robot by name; did you mean 'panda"):
        load_robot("pandas")


def test_no_open_robot_of_a_collection_is_taken_for_one_with_loops():
    """Arms, hands, legged robots: 70 files, of which three are refused for what is wrong in them."""
    data = pytest.importorskip("example_robot_data").robots_loader.getModelPath("panda_description")
    read = 0
    for path in sorted(pathlib.Path(data).rglob("*.urdf")):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            with contextlib.suppress(ModelError):
                assert load_robot(path).sidecar.closures == ()
                read += 1
        assert [str(one.message) for one in told if "open tree" in str(one.message)] == []
    assert read >= 70


GALLERY_ALONE = {"stewart": None, "two_arms": "with 'bar_free' its frames", "gripper": "coincide"}


@pytest.mark.parametrize(("name", "words"), GALLERY_ALONE.items())
def test_a_sidecar_that_is_not_there_is_missed(name, words, tmp_path):
    """Of a platform whose legs end in shapes nothing is said: they may all be arms."""
    path = tmp_path / f"{name}.urdf"
    path.write_text(
        (ROOT / f"docs/_static/gallery/{name}.urdf").read_text(encoding="utf-8"), encoding="utf-8"
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        load_robot(path)
    assert [words in str(one.message) for one in told] == ([] if words is None else [True])


@pytest.mark.parametrize("source", [3, "", None, b"robot.urdf"])
def test_what_cannot_be_a_robot_is_refused(source):
    with pytest.raises(ModelError):
        load_robot(source)


# What random damages found ---------------------------------------------------------------------------------


def small(inertia="1e-9", xyz="0 0 0.001", name="upper"):
    """A robot of a millimetre, which is computed in a unit of its own, with one body otherwise."""
    body = (
        f'<inertial><origin xyz="{xyz}"/><mass value="1"/><inertia ixx="{inertia}" iyy="1e-9" izz="1e-9" '
        'ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    links = robots.link("base") + f'<link name="{name}">{body}</link><link name="lower">{body}</link>'
    joints = robots.joint("one", "base", name) + robots.joint("two", name, "lower", (0.001, 0, 0))
    return robots.robot(links, joints)


def test_a_small_robot_takes_and_refuses_what_others_do():
    assert load_robot(small()).unit_of_length < 0.1
    assert load_robot(small("-1e-9")).model.inertias[1].inertia[0, 0] < 0  # as a robot of a metre does
    for text in (small("1e308"), small(xyz="0 0 1e308")):
        with pytest.raises(ModelError, match=r"the inertia behind the joint 'one' is too large in units of"):
            load_robot(text)


def test_an_axis_of_a_loop_that_is_too_long_is_refused():
    assert len(load_robot(chain(loop())).sidecar.closures) == 1
    with pytest.raises(ModelError, match="axis: expected a direction, got one too long"):
        load_robot(chain(loop(axis="0 1e308 1e308")))


def test_links_and_joints_of_one_name_are_told_apart():
    text = robots.four_bar(*robots.FOUR_BAR).replace("_tip_joint", "_tip")  # where each tip hangs
    with pytest.warns(ModelWarning, match="its frames coupler_tip and rocker_tip carry nothing"):
        load_robot(text)


def test_names_in_an_error_cannot_turn_it_round():
    sidecar = {"closed_loop": [["another", "base"]], "type": ["3d"], "name_mot": []}
    with pytest.raises(ModelError, match=r"known: .*u202etxt") as caught:
        load_robot(small(name="\u202etxt"), sidecar)
    assert "\u202e" not in str(caught.value)


# Macros ----------------------------------------------------------------------------------------------------

MACROS = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="length" default="0.5"/><xacro:property name="L" value="$(arg length)"/>
<xacro:macro name="arm" params="name on"><link name="${name}"><inertial>
<origin xyz="${L/2} 0 0"/><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="${name}_joint" type="continuous"><parent link="${on}"/><child link="${name}"/>
<origin xyz="${L} 0 0"/><axis xyz="0 1 0"/></joint></xacro:macro>
<link name="base"/><xacro:arm name="upper" on="base"/><xacro:arm name="lower" on="upper"/></robot>"""


@pytest.fixture
def macros(tmp_path):
    path = tmp_path / "-arm of 'two'.urdf.xacro"
    path.write_text(MACROS, encoding="utf-8")
    return path


def test_macros_are_expanded_with_their_arguments(macros):
    pytest.importorskip("xacro")
    for args, length in ((None, 0.5), ({"length": 0.25}, 0.25)):
        robot = load_robot(macros, xacro_args=args)
        assert robot.actuated == ("upper_joint", "lower_joint")
        for number in (1, 2):
            assert robot.model.jointPlacements[number].translation.tolist() == [length, 0, 0]
            assert robot.model.inertias[number].lever.tolist() == [length / 2, 0, 0]
    sidecar = Sidecar((), ("lower_joint",))
    macros.with_name("-arm of 'two'.yaml").write_text(sidecar.to_yaml(), encoding="utf-8")
    assert load_robot(str(macros)).actuated == ("lower_joint",)
    plain = macros.with_name("plain.xacro")  # needs no program
    plain.write_text(chain(), encoding="utf-8")
    assert load_robot(plain).model.nv == load_robot(chain()).model.nv


def test_a_damaged_macro_is_one_line_of_error(macros):
    pytest.importorskip("xacro")
    for right, wrong, words in (
        ("${L/2}", "${K/2}", r"\.urdf\.xacro: xacro cannot expand it: .*name 'K' is not defined"),
        ('<link name="base"/>', "<link/>", r"\.urdf\.xacro \(expanded\), line \d+"),
        ("</robot>", "", r"\.urdf\.xacro: xacro cannot expand it: "),
    ):
        macros.write_text(MACROS.replace(right, wrong), encoding="utf-8")
        with pytest.raises(ModelError, match=words) as caught:
            load_robot(macros)
        assert str(caught.value).isprintable()
    for args, words in (
        ({"length of": 1}, "xacro_args: expected names with values, got 'length of'"),
        ({"a": "\0"}, "xacro_args: expected names with values, got 'a'"),
        ("a:=1", "xacro_args: expected a Mapping, got 'a:=1'"),
    ):
        with pytest.raises(InputError, match=words):
            load_robot(macros, xacro_args=args)
    with pytest.raises(InputError, match=r"xacro_args: only a file that ends in \.xacro has arguments"):
        load_robot(chain(), xacro_args={"a": 1})


SCRIPTS = {
    "import time; time.sleep(60)": r"\.xacro: xacro took more than 0\.2 s",
    "while True: print('x' * 1000)": r"\.xacro: expected at most 20000000 bytes from xacro",
    "import sys\nfor _ in range(9999): print('x' * 999, file=sys.stderr)\nsys.exit('last line')": "last line",
    "import sys; sys.exit(3)": r"\.xacro: xacro cannot expand it: exit code 3",
    "import sys; sys.stdout.buffer.write(b'<\\xff')": r"\.xacro: expected UTF-8 text from xacro",
    "import os; os.kill(os.getpid(), 9)": "xacro cannot expand it: exit code -9",
    "#!": "xacro does not start",
    None: r"\.xacro: its macros need the program xacro: pip install 'p3dof\[xacro\]', or",
}


@pytest.mark.parametrize(("script", "words"), SCRIPTS.items(), ids=range(len(SCRIPTS)))
def test_the_program_for_macros_is_held_to_bounds(macros, tmp_path, monkeypatch, script, words):
    folder = tmp_path / "bin"
    folder.mkdir()
    if script is not None:
        first = "/nowhere/python" if script == "#!" else sys.executable
        (folder / "xacro").write_text(f"#!{first}\n{script}\n", encoding="utf-8")
        (folder / "xacro").chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setattr(sys, "executable", str(folder / "python"))
    if "sleep" in str(script):
        monkeypatch.setattr(xml_text, "_SECONDS", 0.2)
    with pytest.raises(p3dof.P3dofError, match=words) as caught:
        load_robot(macros)
    assert len(str(caught.value)) < 2000


# Couplings of several joints -------------------------------------------------------------------------------


def differential(kind="revolute"):
    """A tree of two rods and a rotor that turns six times as much as the second rod does in space."""
    xml = chain(ROTOR + GEAR.replace('link="upper"', 'link="lower"'))
    return load_robot(xml.replace('type="revolute"', f'type="{kind}"'))


@pytest.mark.parametrize("end", ["", ".urdf", "/a.urdf", "\0", "\0.urdf", "\n.urdf", "/\0"])
@pytest.mark.parametrize("beginning", ["a", "a" * 5000, "\N{SNOWMAN}" * 100])
def test_a_name_that_no_file_can_have_is_one_line_of_error(beginning, end):
    """Too long for the system, in bytes of UTF-8 too, or with characters that end its names."""
    pytest.importorskip("example_robot_data")
    for source in (beginning + end, pathlib.Path(beginning + end)):
        with pytest.raises(ModelError) as caught:
            load_robot(source)
        told = str(caught.value)
        assert told.isprintable()
        assert len(told) < 1000
        with pytest.raises(ModelError) as caught:
            load_robot(robots.five_bar(), source)
        assert str(caught.value).isprintable() or "\n" in beginning + end


def test_a_coupling_of_several_joints_is_what_it_says():
    loaded = differential()
    rng = np.random.default_rng(3)
    q, step = rng.normal(size=3), 1e-2  # it is linear
    names = list(loaded.model.names)[1:]
    value = dict(zip(names, q, strict=True))
    expected = value["rotor_joint"] - 6 * (value["elbow"] + value["shoulder"])
    assert loaded.closure_error(q) == pytest.approx([expected], abs=1e-14)
    J = loaded.closure_jacobian(q)
    slopes = [
        (loaded.closure_error(q + step * unit) - loaded.closure_error(q - step * unit)) / (2 * step)
        for unit in np.eye(3)
    ]
    np.testing.assert_allclose(J, np.transpose(slopes), rtol=0, atol=1e-12)
    closed = loaded.complete([0.3, -0.7], [1.0, 2.0], [3.0, -1.0])
    at = dict(zip(names, np.transpose([closed.q, closed.v, closed.a]), strict=True))
    np.testing.assert_allclose(at["rotor_joint"], 6 * (at["elbow"] + at["shoulder"]), rtol=0, atol=1e-12)
    tau = loaded.inverse_dynamics(closed.q, closed.v, closed.a).tau
    free = pin.rnea(loaded.model, loaded.model.createData(), closed.q, closed.v, closed.a)
    torque = dict(zip(names, free, strict=True))
    virtual = [torque[name] + 6 * torque["rotor_joint"] for name in loaded.actuated]  # of virtual powers
    np.testing.assert_allclose(tau, virtual, rtol=1e-12)
    a = loaded.forward_dynamics(closed.q, closed.v, tau).a
    np.testing.assert_allclose(a, closed.a, rtol=0, atol=1e-9)
    many = loaded.inverse_dynamics_batch(*(np.tile(x, (5, 1)) for x in (closed.q, closed.v, closed.a)))
    np.testing.assert_allclose(many.tau, np.tile(tau, (5, 1)), rtol=1e-12)


def test_whole_turns_of_continuous_joints_change_no_coupling_of_several():
    loaded = differential("continuous")
    angles = np.array([0.4, -0.3, 6 * 0.1])  # as the rods, in the order of the joints
    order = [["shoulder", "elbow", "rotor_joint"].index(name) for name in list(loaded.model.names)[1:]]
    for turns in ((0, 0, 0), (1, 0, 0), (0, -2, 3)):
        turned = (angles + 2 * math.pi * np.array(turns))[order]
        q = np.column_stack((np.cos(turned), np.sin(turned))).ravel()
        np.testing.assert_allclose(loaded.closure_error(q), 0, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ([("a", 1.0), ("a", 2.0)], "others: the joint 'a' is there already"),
        ([("j", 1.0)], "others: the joint 'j' is there already"),
        ([("k", 1.0)], "others: the joint 'k' is there already"),
        (["ab"], "others: expected pairs of a joint and a factor, got 'ab'"),
        ("ab", "others: expected pairs of a joint and a factor, got 'ab'"),
        ([("a", "x")], "others: 'a': expected"),
        ([("a", math.nan)], "others: 'a': expected a finite number"),
        ([("", 1.0)], "others: expected a name, got ''"),
    ],
)
def test_further_joints_of_a_coupling_are_checked(others, message):
    with pytest.raises(ModelError, match=message):
        Coupling("j", "k", (0.0, 1.0), others=others)


def test_couplings_of_several_joints_form_no_ring():
    ring = [
        Coupling("a", None, (0.0,), others=[("b", 1.0)]),
        Coupling("b", "c", (0, 1)),
        Coupling("c", "a", (0, 1)),
    ]
    with pytest.raises(ModelError, match="the joints follow each other in a ring: "):
        Sidecar((), (), ring)


# Files as other people have them


def with_warnings_as_errors(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return load(name)


@pytest.mark.parametrize(
    ("names", "mobility", "actuated"),
    [
        (others("five_bar_hinges"), 3, 2),
        (others("five_bar_point"), 2, 2),
        (others("five_bar_rod_end"), 2, 2),
        (["leg_with_rods"], 5, 3),
        (others("leg_with_rods")[1:], 9, 6),
        (["two_legs"], 6, 6),
        (others("two_legs")[1:], 12, 12),
        (others("tiny_delta"), 5, 2),
        (others("plus_four_bar"), 1, 1),
        (others("plus_leg_with_rotors"), 3, 3),
        (others("plus_planar_leg"), 2, 2),
        (others("plus_rotor_chain"), 3, 3),
        (others("plus_six_bar"), 3, 3),
    ],
    ids=lambda value: value[0] if isinstance(value, list) and value else None,
)
def test_other_robots_load_close_and_move_as_they_should(names, mobility, actuated):
    for name in names:
        loaded = with_warnings_as_errors(name)
        assert loaded.assemble().gap < 1e-12
        assert (loaded.model.nv - loaded.generic_rank, len(loaded.actuated)) == (mobility, actuated)


def traits(name) -> set[str]:
    """What is remarkable about a robot."""
    loop = with_warnings_as_errors(name)
    model, sidecar, zero = loop.model, loop.sidecar, pin.neutral(loop.model)
    home, bodies = loop.assemble(), list(model.inertias)[1:]
    tree = Xml.fromstring(urdf_of(name))  # noqa: S314 - known files
    rows = len(loop.closure_error(zero))
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    parts = {
        "bodies without mass": min(body.mass for body in bodies) == 0.0,
        "bodies of micrograms": 0.0 < min(body.mass for body in bodies) < 1e-5,
        "a body of tons": max(body.mass for body in bodies) > 1e5,
        "inertia about one axis": any(np.count_nonzero(np.diag(body.inertia)) == 1 for body in bodies),
        "no room between limits": bool((lower == upper).any()),
        "room for some": bool((lower == upper).any() and ((lower < upper) & (upper < 9)).any()),
        "idle freedoms": loop.mobility(home.q) > len(loop.actuated),
        "rows that are always dependent": loop.generic_rank < rows,
        "singular at home": loop.mobility(home.q) > model.nv - loop.generic_rank,
        "open at zero": bool(rows and np.abs(loop.closure_error(zero)).max() > 1e-3),
        "meshes": tree.find(".//mesh") is not None,
        "a joint without a place": any(joint.find("origin") is None for joint in tree.iter("joint")),
        "a joint without an axis": any(joint.find("axis") is None for joint in tree.iter("joint")),
        "a slash in a name": any("/" in body.get("name") for body in tree.iter("link")),
        "a closure between joints": any(
            tree.find(f"joint[@name='{closure.frame1}']") is not None for closure in sidecar.closures
        ),
        **{f"joints {kind}": True for kind in {joint.shortname() for joint in list(model.joints)[1:]}},
        **{f"closures {closure.kind}": True for closure in sidecar.closures},
        **{f"types {kind}": True for _, kind in sidecar.joints},
        **{f"attribute {key}": True for joint in tree.iter("joint") for key in joint.attrib},
        "several closures": len(sidecar.closures) > 1,
        "couplings": bool(sidecar.couplings),
    }
    return {trait for trait, there in parts.items() if there}


@pytest.mark.parametrize("name", STAND_INS)
def test_stand_ins_have_the_traits_of_the_files_that_they_stand_for(name):
    own = traits(name)
    assert own
    for file in others(name)[1:]:
        assert traits(file) <= own
