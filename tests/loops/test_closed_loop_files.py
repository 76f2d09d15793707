"""Sidecars and URDFs: what is accepted, and the one clear error for everything else."""

from __future__ import annotations

import contextlib
import copy
import pickle
from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import FOUR_BAR, FOUR_BAR_SIDECAR, joint, link, robot
from documents import ROOT
from hypothesis import example, given
from hypothesis import strategies as st

from p3dof._base.errors import ModelError, ModelWarning
from p3dof.loops import ClosedLoopModel, Closure, Coupling, Sidecar, load_robot

GOOD = """\
closed_loop: [[coupler_tip, rocker_tip]]
type: ['3D']
name_mot: [crank_joint]
joint_name: [anything]
joint_type: [continuous]
"""


# --- sidecar ------------------------------------------------------------------------------------------------


def test_the_gepetto_convention_is_read():
    sidecar = Sidecar.parse(GOOD)
    assert sidecar.joints == (("anything", "continuous"),)
    assert replace(sidecar, joints=()) == FOUR_BAR_SIDECAR


names = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S"]), min_size=1).filter(str.strip)


@given(st.lists(st.tuples(names, names, st.sampled_from(["3d", "6d"]))), st.lists(names, unique=True))
def test_yaml_round_trip(closures, actuated):
    sidecar = Sidecar(tuple(Closure(*c) for c in closures if c[0] != c[1]), tuple(actuated))
    assert Sidecar.parse(sidecar.to_yaml()) == sidecar


def test_names_that_look_like_numbers_survive_the_round_trip():
    sidecar = Sidecar((Closure("1", "no"),), ("1e3", "null", "~"))
    assert Sidecar.parse(sidecar.to_yaml()) == sidecar


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a mapping"),
        ("[1, 2]", "expected a mapping"),
        ("closed_loop: [", "line 2: not valid YAML|line 1: not valid YAML"),
        ("type: []\nname_mot: []", "the key 'closed_loop' is missing"),
        ("closed_loop: []\nname_mot: []", "the key 'type' is missing"),
        ("closed_loop: []\ntype: []", "the key 'name_mot' is missing"),
        (GOOD + "motors: []", "unknown field 'motors', expected closed_loop, type, name_mot"),
        (GOOD + "type: ['6d']", "the key 'type' is given more than once"),
        (GOOD.replace("['3D']", "3d"), "type: expected a list, got '3d'"),
        (GOOD.replace("['3D']", "[3d, 6d]"), "type: expected 1 entries, one a closure, got 2"),
        (GOOD.replace("['3D']", "[4d]"), r"type\[0\]: expected '3d', '6d', 'hinge', .*, got '4d'"),
        (GOOD.replace("['3D']", "[3]"), r"type\[0\]: expected '3d', '6d', 'hinge', .*, got 3"),
        (GOOD.replace("['3D']", "[distance]"), r"length\[0\]: .*a distance needs one"),
        (GOOD + "length: [0.5]", r"length\[0\]: .*only a 'distance' has one, got 0.5 for '3d'"),
        (GOOD.replace("['3D']", "[distance]\nlength: [-1]"), r"length\[0\]: .*expected a positive number"),
        (GOOD.replace("['3D']", "[distance]\nlength: [.nan]"), r"length\[0\]: .*expected a finite number"),
        (GOOD.replace("['3D']", "[distance]\nlength: [long]"), r"length\[0\]: .*got 'long'"),
        (GOOD + "length: [null, null]", "length: expected 1 entries, one a closure, got 2"),
        (GOOD + "coupling: {joint: a}", "coupling: expected a list"),
        (GOOD + "coupling: [a]", r"coupling\[0\]: expected a mapping with 'joint', 'coefficients'"),
        (GOOD + "coupling: [{joint: a}]", r"coupling\[0\]: the key 'coefficients' is missing"),
        (GOOD + "coupling: [{joint: a, coefficients: [1], to: b}]", r"coupling\[0\]: unknown field 'to'"),
        (GOOD + "coupling: [{joint: a, coefficients: 1}]", r"coupling\[0\]: .*coefficients: expected shape"),
        (
            GOOD + "coupling: [{joint: a, coefficients: [x]}]",
            r"coupling\[0\]: .*expected real numbers, got 'x'",
        ),
        (GOOD + "reference: [1]", "reference: expected a mapping of joints to values"),
        (GOOD + "reference: {a: much}", "reference: 'a': expected real numbers, got 'much'"),
        (GOOD + "reference: {a: [.inf]}", "reference: 'a': expected finite numbers"),
        (GOOD.replace("[continuous]", "[a, b]"), "joint_type: expected 1 entries, one a name, got 2"),
        (GOOD.replace("[continuous]", "[7]"), "joint_type: expected a name, got 7"),
        (GOOD.replace(", rocker_tip", ""), r"closed_loop\[0\]: expected a pair of frame names"),
        (GOOD.replace("rocker_tip", "7"), r"closed_loop\[0\]: expected a name, got 7"),
        (GOOD.replace("rocker_tip", "coupler_tip"), r"closed_loop\[0\]: expected two different frames"),
        (GOOD.replace("[[coupler_tip, rocker_tip]]", "[coupler_tip]"), r"closed_loop\[0\]: expected a pair"),
        (GOOD.replace("[crank_joint]", "crank_joint"), "name_mot: expected a list"),
        (GOOD.replace("[crank_joint]", "{a: b}"), "name_mot: expected a list"),
        (GOOD.replace("[crank_joint]", "[a, b, a]"), r"name_mot\[2\]: the joint 'a' is named twice"),
        (GOOD.replace("[crank_joint]", "[null]"), r"name_mot\[0\]: expected a name, got None"),
        (GOOD.replace("[crank_joint]", "['']"), r"name_mot\[0\]: expected a name, got ''"),
    ],
)
def test_a_malformed_sidecar_names_file_and_field(tmp_path, text, message):
    path = tmp_path / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError, match=message) as caught:
        Sidecar.from_yaml(path)
    assert str(path) in str(caught.value)


@given(st.text(max_size=200))
def test_any_text_is_a_sidecar_or_one_error(text):
    with contextlib.suppress(ModelError):
        assert isinstance(Sidecar.parse(text), Sidecar)


KEYS = ["closed_loop", "type", "name_mot", "length", "coupling", "reference", "joint_name", "joint_type"]
leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.sampled_from(["a", "b", "hinge", "distance", "3d", "1e-3", "nan", "on", "joint", "coefficients"]),
)
plain = st.recursive(
    leaves,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(leaves.filter(lambda key: not isinstance(key, float)), inner, max_size=3)
    ),
    max_leaves=6,
)
likely = st.fixed_dictionaries(
    {"joint": leaves, "coefficients": st.lists(leaves, max_size=3)}, optional={"on": leaves, "name": leaves}
)


@given(st.fixed_dictionaries(dict.fromkeys(KEYS[:3], plain), optional=dict.fromkeys(KEYS[3:], plain)))
@example({**dict.fromkeys(KEYS[:3], ()), "reference": {"a": [[1], [2, 3]]}})
@example({**dict.fromkeys(KEYS[:3], ()), "reference": {"a": 10**400}})
def test_any_content_is_a_sidecar_or_one_error(content):
    with contextlib.suppress(ModelError):
        sidecar = Sidecar.from_mapping(content)
        assert Sidecar.parse(sidecar.to_yaml()) == sidecar


@given(st.lists(likely, max_size=4))
def test_any_couplings_are_taken_or_refused(couplings):
    content = {**dict.fromkeys(KEYS[:3], ()), "coupling": couplings}
    with contextlib.suppress(ModelError):
        sidecar = Sidecar.from_mapping(content)
        assert Sidecar.parse(sidecar.to_yaml()) == sidecar


def test_missing_and_binary_sidecars(tmp_path):
    with pytest.raises(ModelError, match="cannot be read"):
        Sidecar.from_yaml(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ModelError, match="expected UTF-8 text"):
        Sidecar.from_yaml(tmp_path / "binary.yaml")


@pytest.mark.parametrize(
    ("closures", "actuated", "message"),
    [
        ((("a", "b"),), (), "expected Closure objects"),
        ((), "joint", "actuated: expected a sequence"),
        (None, (), "closures: expected a sequence"),
        ((), ("a", "a"), "named twice"),
        ((), (3,), "expected a name, got 3"),
    ],
)
def test_sidecar_refuses(closures, actuated, message):
    with pytest.raises(ModelError, match=message):
        Sidecar(closures, actuated)


@pytest.mark.parametrize("arguments", [("a", "a"), ("", "b"), ("a", 3), ("a", "b", "5d")])
def test_closure_refuses(arguments):
    with pytest.raises(ModelError, match="closure"):
        Closure(*arguments)


@pytest.mark.parametrize(
    ("kind", "length", "message"),
    [
        ("distance", None, "a distance needs one"),
        ("distance", 0.0, "expected a positive number, got 0"),
        ("distance", -0.1, "expected a positive number"),
        ("distance", float("nan"), "expected a finite number"),
        ("distance", float("inf"), "expected a finite number"),
        ("distance", "long", "expected real numbers, got 'long'"),
        ("distance", [0.5], "expected a single number"),
        ("hinge", 0.5, "only a 'distance' has one, got 0.5 for 'hinge'"),
        ("weld", None, "kind: expected '3d', '6d', 'hinge', .* got 'weld'"),
        (6, None, "kind: expected .* got 6"),
    ],
)
def test_closure_refuses_kind_and_length(kind, length, message):
    with pytest.raises(ModelError, match=f"closure of 'a' and 'b': .*{message}"):
        Closure("a", "b", kind, length)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("", None, (0,)), "coupling: joint: expected a name"),
        ((3, None, (0,)), "coupling: joint: expected a name, got 3"),
        (("a", 3, (0,)), "coupling of 'a': on: expected a name, got 3"),
        (("a", "a", (0, 1)), "coupling of 'a': on: the joint cannot follow itself"),
        (("a", "b", ()), "coefficients: expected one to 5, got 0"),
        (("a", "b", (0,) * 6), "coefficients: expected one to 5, got 6"),
        (("a", None, (0, 1)), "coefficients: expected one, the joint being locked, got 2"),
        (("a", "b", (0, float("nan"))), "coefficients: expected finite numbers, got nan"),
        (("a", "b", 2.0), "coefficients: expected shape"),
        (("a", "b", "12"), "coefficients: expected real numbers, got '12'"),
        (("a", "b", (0, 1), " "), "name: expected a name"),
    ],
)
def test_coupling_refuses(arguments, message):
    with pytest.raises(ModelError, match=message):
        Coupling(*arguments)


def test_couplings_may_be_chained_but_not_closed():
    chain = [Coupling("a", "b", (0, 2)), Coupling("b", "c", (0, 3)), Coupling("d", "b", (1,))]
    assert Sidecar((), (), chain).couplings == tuple(chain)
    with pytest.raises(ModelError, match="in a ring: b -> c"):
        Sidecar((), (), [*chain[:2], Coupling("c", "b", (0, 1))])
    with pytest.raises(ModelError, match="the joint 'b' is coupled twice"):
        Sidecar((), (), [*chain, Coupling("b", None, (0,))])
    long = [Coupling(str(i), str(i + 1), (0, 1)) for i in range(5000)]
    assert len(Sidecar((), (), long).couplings) == 5000
    with pytest.raises(ModelError, match="expected Coupling objects, got 'a'"):
        Sidecar((), (), ["a"])


def test_kinds_have_synonyms():
    assert Closure("a", "b", "Point") == Closure("a", "b", "3d")
    assert Closure("a", "b", "frame") == Closure("a", "b", "6D")
    text = "closed_loop: [[a, b], [c, d]]\ntype: [POINT, Hinge]\nname_mot: []"
    assert [closure.kind for closure in Sidecar.parse(text).closures] == ["3d", "hinge"]


FULL = """\
closed_loop: [[a, b], [c, d]]
type: [hinge, distance]
length: [null, 5e-1]
name_mot: [j]
coupling:
- {joint: k, on: j, coefficients: [0, -1.5, 1e-3], name: gears}
- {joint: l, on: null, coefficients: [2], others: {m: 0.5, n: -1}}
reference: {j: 0.25, ball: [0, 0, 0, 1]}
joint_name: [m]
joint_type: [SPHERICAL]
"""


def test_all_keys_of_the_file():
    sidecar = Sidecar.parse(FULL)
    assert sidecar == Sidecar(
        (Closure("a", "b", "hinge"), Closure("c", "d", "distance", 0.5)),
        ("j",),
        (
            Coupling("k", "j", (0, -1.5, 1e-3), "gears"),
            Coupling("l", None, [2], others=[("m", 0.5), ("n", -1)]),
        ),
        {"j": 0.25, "ball": (0, 0, 0, 1)},
        (("m", "SPHERICAL"),),
    )
    assert [coupling.title for coupling in sidecar.couplings] == ["gears", "l"]
    assert Sidecar.parse(sidecar.to_yaml()) == sidecar
    for twin in (pickle.loads(pickle.dumps(sidecar)), copy.deepcopy(sidecar)):  # noqa: S301
        assert twin == sidecar
        assert hash(twin) == hash(sidecar)
    with pytest.raises(TypeError):
        sidecar.reference["j"] = 1.0
    assert sidecar != replace(sidecar, reference={"j": 0.5})


def test_lists_are_taken_as_tuples():
    sidecar = Sidecar([Closure("a", "b")], ["j"])
    assert sidecar == Sidecar((Closure("a", "b"),), ("j",))
    assert hash(sidecar) == hash(Sidecar((Closure("a", "b"),), ("j",)))


# --- building -----------------------------------------------------------------------------------------------


def test_every_way_to_give_urdf_and_sidecar(tmp_path):
    xml = robots.four_bar(*FOUR_BAR)
    urdf, yaml = tmp_path / "robot.urdf", tmp_path / "robot.yaml"
    urdf.write_text(xml, encoding="utf-8")
    yaml.write_text(FOUR_BAR_SIDECAR.to_yaml(), encoding="utf-8")
    mapping = {"closed_loop": [("coupler_tip", "rocker_tip")], "type": ("3d",), "name_mot": ("crank_joint",)}
    q = robots.four_bar_q(0.9, *FOUR_BAR)
    for source in (xml, "\ufeff \n" + xml, urdf, str(urdf)):
        for closures in (FOUR_BAR_SIDECAR, yaml, str(yaml), mapping):
            loop = ClosedLoopModel.from_urdf(source, closures)
            assert loop.actuated == ("crank_joint",)
            assert np.abs(loop.closure_error(q)).max() < 1e-15
    assert repr(loop) == "ClosedLoopModel('robot', nv=3, closures=1, actuated=[crank_joint])"
    declared = '<?xml version="1.0" encoding="ISO-8859-1"?>' + xml
    assert ClosedLoopModel.from_urdf(declared, FOUR_BAR_SIDECAR).model.nv == 3


def test_without_a_sidecar_every_hinge_is_actuated():
    loop = ClosedLoopModel.from_urdf(robots.hexapod(), closures=())
    assert len(loop.actuated) == 18  # not the floating joint
    assert loop.mobility(pin.neutral(loop.model)) == 24
    assert loop.closure_jacobian(pin.neutral(loop.model)).shape == (0, 24)
    with pytest.warns(ModelWarning, match="with 'crank' and 'coupler' its frames coupler_tip and rocker_tip"):
        loop = ClosedLoopModel.from_urdf(robots.four_bar(*FOUR_BAR), root_joint=pin.JointModelFreeFlyer())
    assert (loop.model.nv, loop.actuated_v.tolist()) == (9, [6, 7, 8])


def test_a_model_without_any_joint():
    loop = ClosedLoopModel.from_urdf(robot(link("base")))
    state = loop.complete([], [], [])
    assert loop.inverse_dynamics(state.q, state.v, state.a).tau.shape == (0,)
    assert loop.forward_dynamics([], [], []).a.shape == (0,)
    assert loop.power([], [], []) == 0.0


@pytest.mark.parametrize(
    ("sidecar", "message"),
    [
        (Sidecar((Closure("coupler_top", "rocker_tip"),), ()), "'coupler_top' does not exist; did you mean"),
        (Sidecar((Closure("xyzzy", "rocker_tip"),), ()), "'xyzzy' does not exist; known: universe, base"),
        (Sidecar((), ("crank_joints",)), "'crank_joints' does not exist; did you mean 'crank_joint'"),
        (Sidecar((), ("coupler_tip_joint",)), "'coupler_tip_joint' does not exist"),  # fixed: no joint
        (Sidecar((Closure("coupler", "coupler_tip"),), ()), "coupler/coupler_tip: both frames are on"),
        (Sidecar((Closure("base", "universe"),), ()), "same body"),
        ({"closed_loop": [], "type": []}, "the key 'name_mot' is missing"),
        (3, "expected a mapping"),
    ],
)  # fmt: skip
def test_a_sidecar_that_does_not_fit_the_model(sidecar, message):
    with pytest.raises(ModelError, match=message):
        ClosedLoopModel.from_urdf(robots.four_bar(*FOUR_BAR), sidecar)


def test_a_joint_with_six_freedoms_is_no_actuator():
    with pytest.raises(ModelError, match="expected joints with one degree of freedom, 'float' has 6"):
        ClosedLoopModel.from_urdf(robots.hexapod(), Sidecar((), ("float",)))


def test_a_link_and_a_joint_may_share_a_name():
    xml = robots.four_bar(*FOUR_BAR).replace('joint name="coupler_tip_joint"', 'joint name="coupler_tip"')
    loop = ClosedLoopModel.from_urdf(xml, FOUR_BAR_SIDECAR)
    assert np.abs(loop.closure_error(robots.four_bar_q(0.9, *FOUR_BAR))).max() < 1e-15


def test_a_link_takes_precedence_over_any_frame_of_the_same_name():
    model = pin.Model()
    hinge = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    astray, right = pin.SE3(np.eye(3), np.ones(3)), pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    model.addFrame(pin.Frame("tip", hinge, astray, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("tip", hinge, right, pin.FrameType.BODY))
    loop = ClosedLoopModel(model, Sidecar((Closure("universe", "tip"),), ()))
    assert loop.closure_error([0.0]) == pytest.approx([1.0, 0.0, 0.0])


def test_pickle_and_deepcopy():
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR)
    q = robots.four_bar_q(0.9, *FOUR_BAR)
    sent = pickle.loads(pickle.dumps(loop))  # noqa: S301 - our own
    for other in (sent, copy.deepcopy(loop)):
        assert other.sidecar == loop.sidecar
        assert other.model is not loop.model
        assert np.array_equal(other.closure_jacobian(q), loop.closure_jacobian(q))


@pytest.mark.parametrize("arguments", [(None, FOUR_BAR_SIDECAR), (pin.Model(), None)])
def test_constructor_refuses(arguments):
    with pytest.raises(ModelError, match=r"model|sidecar"):
        ClosedLoopModel(*arguments)


A, B, HINGE = link("a"), link("b"), joint("j", "a", "b")
INERTIAL = (
    '<link name="b"><inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        ("<robot", "URDF text, line 1: not well-formed XML"),
        ("<robot name='x'>\n<link name='a'>\n</robot>", "line 3: not well-formed XML: mismatched tag"),
        ("<foo/>", "expected the element <robot>, got <foo>"),
        (robot(), "the robot has no links"),
        (robot("<link/>"), "<link> has no name"),
        (robot(A, A), "the link 'a' is defined twice"),
        (robot(A, B, HINGE, link("c"), joint("j", "b", "c")), "the joint 'j' is defined twice"),
        (robot(A, B), "expected one root link, got a, b"),
        (robot(A, B, joint("j", "a", "bb")), "joint 'j': its child link 'bb' does not exist; did you mean"),
        (robot(A, B, HINGE.replace('<parent link="a"/>', "")), "its parent link None does not exist"),
        (
            robot(A, B, link("c"), HINGE, joint("k", "a", "c"), joint("l", "c", "b")),
            "the link 'b' has two parent joints, 'j' and 'l': cut the loop there",
        ),
        (robot(A, B, HINGE, joint("k", "b", "a")), "part of a cycle"),
        (robot(link("r"), A, B, HINGE, joint("k", "b", "a")), "part of a cycle"),
        (robot(A, B, HINGE.replace("revolute", "hinge")), "joint 'j': type: expected one of revolute,"),
        (robot(A, B, joint("j", "a", "b", axis=(0, 0, 0))), "<axis> xyz: expected a direction, got zero"),
        (robot(A, B, joint("j", "a", "b", axis=(0, "q", 0))), "<axis> xyz: expected 3 finite numbers"),
        (robot(A, B, HINGE.replace("0.0 0.0 0.0", "0.0 0.0")), "<origin> xyz: expected 3 finite numbers"),
        (robot(A, INERTIAL.replace('"1"/><', '"nan"/><'), HINGE), "<mass> value: expected a finite number"),
        (robot(A, INERTIAL.replace('"1"/><', '"-1"/><'), HINGE), "expected no negative mass, got -1"),
        (robot(A, INERTIAL.replace(' izz="1"', ""), HINGE), "<inertia> izz: expected a finite number, got N"),
        ("<!DOCTYPE r [<!ENTITY e 'x'>]>" + robot(A), "document type declaration is not allowed"),
        (robot(A).replace("a", "\ud800"), "not Unicode text"),
    ],
)  # fmt: skip
def test_a_bad_urdf_is_one_clear_error(xml, message, capfd):
    with pytest.raises(ModelError, match=message):
        ClosedLoopModel.from_urdf(xml)
    capfd.readouterr()  # urdfdom prints its own reasons


@pytest.mark.parametrize("mass", ["1_0", "١", "1\t", "1 ", "1&#10;"])
def test_numbers_that_only_python_reads_are_refused(mass):
    """Pinocchio alone reads some of them as a massless link."""
    with pytest.raises(ModelError, match="<mass> value: expected a finite number"):
        ClosedLoopModel.from_urdf(robot(A, INERTIAL.replace('"1"/><', f'"{mass}"/><'), HINGE))


def chain(count, kind="fixed"):
    joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(count)]
    return robot(*(link(f"l{i}") for i in range(count + 1)), *joints).replace("revolute", kind)


LONG = "a" * 1_000_000


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (chain(1000), "expected at most 1000 links"),
        (robot(A, B, *(joint(f"j{i}", "a", "b") for i in range(1001))), "expected at most 1000 joints"),
        (chain(201, "continuous"), "expected at most 200 degrees of freedom, got 201"),
        (robot("<q>" * 200_000), "expected elements nested at most 100 deep"),
        (
            robot("<q " + " ".join(f"a{i}=''" for i in range(101)) + "/>"),
            "at most 100 attributes, <q> has 101",
        ),
        (robot(A, " " * 20_000_000), "expected at most 20000000 characters"),
        (robot(A, B, joint("j", "a", LONG)), "its child link 'aaa.* "),
        (robot(link(LONG), link(LONG)), "the link 'aaa.* is defined twice"),
        (robot(A, INERTIAL.replace('"1"/><', f'"{LONG}"/><')), "expected a finite number, got 'aaa"),
        (f"<{LONG}/>", "expected the element <robot>, got <aaa"),
    ],
    ids=range(10),
)
def test_a_urdf_too_large_is_one_short_error(xml, message):
    with pytest.raises(ModelError, match=message) as caught:
        ClosedLoopModel.from_urdf(xml)
    assert len(str(caught.value)) < 600


def test_the_longest_chain_is_read():
    assert ClosedLoopModel.from_urdf(chain(999)).model.nframes > 1000


@pytest.mark.parametrize("huge", [10**100_000, -(10**5000), LONG, list(range(10**5))], ids=range(4))
def test_a_sidecar_error_never_shows_the_whole_of_a_huge_object(huge):
    good = {"closed_loop": [["a", "b"]], "type": ["3d"], "name_mot": ["j"]}
    bad = [
        huge,
        *({**good, key: huge} for key in good if not isinstance(huge, list)),
        *({**good, key: [huge]} for key in good if not (key == "name_mot" and huge is LONG)),
        {**good, "name_mot": [LONG, LONG]},
        {**good, "closed_loop": [[huge, huge]]},
        *([] if isinstance(huge, list) else [{**good, huge: 1}]),
    ]
    for content in bad:
        with pytest.raises(ModelError) as caught:
            Sidecar.from_mapping(content)
        assert len(str(caught.value)) < 300
    for act in (lambda: Sidecar((huge,), ()), lambda: Closure("a", "b", huge), lambda: Closure(huge, huge)):
        with pytest.raises(ModelError) as caught:
            act()
        assert len(str(caught.value)) < 300


@pytest.mark.parametrize("path", [None, 5, b"robot.yaml", ["robot.yaml"]])
def test_what_is_no_path_of_a_sidecar(path):
    with pytest.raises(ModelError, match="expected the path of a file, got"):
        Sidecar.from_yaml(path)


def test_an_inertial_that_urdfdom_would_drop_in_silence():
    """The reason for the check above: Pinocchio alone reads a NaN mass as a massless link."""
    good = ClosedLoopModel.from_urdf(robot(A, INERTIAL, HINGE))
    assert good.model.inertias[1].mass == 1.0
    bad = robot(A, INERTIAL.replace('"1"/><', '"nan"/><'), HINGE)
    assert pin.buildModelFromXML(bad).inertias[1].mass == 0.0


@pytest.mark.parametrize("source", ["", None, 3, "no/such/file.urdf", "a\0b"])
def test_a_urdf_that_is_not_there(source):
    with pytest.raises(ModelError):
        ClosedLoopModel.from_urdf(source)


@given(st.text(max_size=200))
def test_any_text_after_robot_is_one_error(text):
    with pytest.raises(ModelError):
        ClosedLoopModel.from_urdf("<robot>" + text)


def test_a_forgotten_sidecar_is_warned_of(tmp_path):
    urdf = (ROOT / "urdf" / "p3dof.urdf").read_text(encoding="utf-8")
    # Text alone: three pairs of ends coincide at home.
    pairs = (
        "its frames leg_a_tip and platform_a coincide and 2 more such pairs, and no closures were found in"
    )
    with pytest.warns(ModelWarning, match=pairs):
        assert ClosedLoopModel.from_urdf(urdf).sidecar.closures == ()
    path = tmp_path / "p3dof.urdf"
    path.write_text(urdf, encoding="utf-8")
    looked = r"closures were found in it or beside it \(looked for p3dof\.yaml, p3dof\.yml\): give a sidecar"
    for name in ("p3dof.urdf", "p3dof.urdf.xacro", "p3dof.xacro"):
        path.rename(tmp_path / name)
        path = tmp_path / name
        for read in (ClosedLoopModel.from_urdf, load_robot):
            with pytest.warns(ModelWarning, match=looked):
                read(path)
    for ending in ("yml", "yaml"):
        (tmp_path / f"p3dof.{ending}").write_text(
            "closed_loop: []\ntype: []\nname_mot: []\n", encoding="utf-8"
        )
        with pytest.warns(ModelWarning, match=rf"p3dof\.{ending} beside it holds loop closures"):
            ClosedLoopModel.from_urdf(path)
    # Somebody who means it says so; warnings are errors here.
    assert ClosedLoopModel.from_urdf(path, closures=()).sidecar.closures == ()
    ClosedLoopModel.from_urdf(path, (tmp_path / "p3dof.yaml").read_text(encoding="utf-8"))
    # A linkage that is open at the neutral configuration, by its names. An open chain, two arms: no sign.
    four = robots.four_bar(2.0, 0.2, 0.45, 0.35)
    with pytest.warns(ModelWarning, match="with 'crank' and 'coupler' its frames coupler_tip and rocker_tip"):
        ClosedLoopModel.from_urdf(four)
    arms = four.replace("crank", "arm").replace("coupler", "hand").replace("rocker", "pointer")
    for tree in (arms, chain(20)):
        ClosedLoopModel.from_urdf(tree)
