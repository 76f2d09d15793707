"""Robots from other people's files: what is read, what is refused, and that it is the same machine."""

import math
import warnings
from xml.etree import ElementTree as Xml

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from other_robots import STAND_INS, load, others, urdf_of
from robot_texts import BALL, GEAR, ROTOR, SRDF, chain, loop

import p3dof
from p3dof._base.errors import InputError, ModelError, ModelWarning
from p3dof.loops import Closure, Coupling, Sidecar
from p3dof.loops.robots import load_robot
from p3dof.loops.trees import with_joints

POSE, VELOCITY, ACCELERATION = (0.03, -0.04, 0.2), (0.2, 0.3, -1.0), (1.0, -2.0, 3.0)


# The machine of this package, as it is written for others -------------------------------------------------


@pytest.mark.parametrize("file", ["p3dof.urdf", "p3dof_plus.urdf", "p3dof_drake.urdf", "p3dof_mjcf.xml"])
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
    actuated = ("slide_a", "slide_b", "slide_c")
    loaded = p3dof.ClosedLoopModel(loaded.model, Sidecar(loaded.sidecar.closures, actuated))
    tau = loaded.inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(tau, robot.forces(POSE, VELOCITY, ACCELERATION), rtol=1e-9)


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
        (chain('<loop_joint name="x"/>'), "<loop_joint> looks like a loop"),
        (chain("<tendon/>"), "<tendon> looks like a loop"),
        (chain('<drake:distance_constraint name="x"/>'), "<drake:distance_constraint> looks like a loop"),
        (
            chain('<gazebo><joint name="c" type="revolute"><child>a</child></joint></gazebo>'),
            "<joint> in <gazebo>",
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
        ("<sdf/>", "p3dof writes SDF but reads none"),
        ("<html/>", "expected URDF .* or MJCF .*, got <html>"),
        ("<robot", "not well-formed XML"),
        ("<!DOCTYPE x><robot/>", "a document type declaration is not allowed"),
    ],
)
def test_what_is_not_understood_is_one_clear_error(xml, message):
    with pytest.raises(ModelError, match=message):
        load_robot(xml)


BUSHING = """
<drake:linear_bushing_rpy>
  <drake:bushing_frameA name="lower"/><drake:bushing_frameC name="base"/>
  <drake:bushing_force_stiffness value="3e4 3e4 3e4"/>
</drake:linear_bushing_rpy>"""
MIMIC = """
<gazebo>
  <plugin filename="libroboticsgroup_upatras_gazebo_mimic_joint_plugin.so" name="{name}">
    <joint>shoulder</joint><mimicJoint>elbow</mimicJoint><multiplier>-1.0</multiplier>
  </plugin>
</gazebo>"""
RATE = """
<gazebo>
  <plugin filename="libgazebo_ros_control.so" name="control"><loop_rate>1000</loop_rate></plugin>
  <sensor name="imu" type="imu"><plugin name="imu"><constraint_loop>1</constraint_loop></plugin></sensor>
</gazebo>"""


def line_of(text, part):
    return text[: text.index(part)].count("\n") + 1


def test_a_bushing_that_closes_a_loop_is_named_with_its_line(tmp_path):
    path, text = tmp_path / "four_bar.urdf", chain(BUSHING)
    path.write_text(text, encoding="utf-8")
    line = line_of(text, "<drake:linear_bushing_rpy")
    with pytest.raises(
        ModelError, match=rf"four_bar\.urdf, line {line}: <drake:linear_bushing_rpy> looks like"
    ):
        load_robot(path)
    assert load_robot(path, on_unknown="ignore").model.nv == 2


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
    assert load_robot(chain('<loop_joint name="x"/>'), on_unknown="ignore").model.nv == 2
    with pytest.raises(InputError, match="on_unknown: expected 'raise' or 'ignore', got 'skip'"):
        load_robot(chain(), on_unknown="skip")


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


@pytest.mark.parametrize("source", [3, "", None, b"robot.urdf"])
def test_what_cannot_be_a_robot_is_refused(source):
    with pytest.raises(ModelError):
        load_robot(source)


# Couplings of several joints -------------------------------------------------------------------------------


def differential(kind="revolute"):
    """A tree of two rods and a rotor that turns six times as much as the second rod does in space."""
    xml = chain(ROTOR + GEAR.replace('link="upper"', 'link="lower"'))
    return load_robot(xml.replace('type="revolute"', f'type="{kind}"'))


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
