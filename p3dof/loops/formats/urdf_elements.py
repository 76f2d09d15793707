"""What is known of the elements of a URDF: those that are read, those without effect; all others are named.

Known is what stands in `READ`, by its place below ``<robot>``, and, with all that is in it, in `IDLE`. So a
robot that somebody else's dialect holds together is never taken for an open tree without a word.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import NamedTuple
from xml.etree import ElementTree as Xml

from p3dof._base.checks import shown

_POSE, _LINK, _VALUE = "xyz rpy", "link", "value"
_BALL, _BUSHING = "drake:ball_constraint", "drake:linear_bushing_rpy"
READ: Mapping[str, tuple[str, str]] = {
    "robot": ("name version", "the model"),
    "link": (
        "name",
        "a body; onshape-to-robot: `closing_NAME_1` and `closing_NAME_2` are a point closure, unless there "
        "is a sidecar",
    ),
    "link/inertial": ("", "its mass and inertia"),
    "link/inertial/origin": (_POSE, ""),
    "link/inertial/mass": (_VALUE, ""),
    "link/inertial/inertia": ("ixx ixy ixz iyy iyz izz", ""),
    "joint": (
        "name type independent",
        'a joint; one with `independent="false"` is not actuated. The parent `world` needs no `<link>`',
    ),
    "joint/parent": (_LINK, ""),
    "joint/child": (_LINK, ""),
    "joint/origin": (_POSE, ""),
    "joint/axis": ("xyz", ""),
    "joint/limit": ("lower upper effort velocity", "limits"),
    "joint/dynamics": ("damping friction", "losses, with `passive=True`"),
    "joint/mimic": ("joint multiplier offset", "a coupling, unless `mimic=False`"),
    "loop": ("name type", "URDF+: a closure between two links; cylindrical and planar ones too"),
    "loop/predecessor": (_LINK, ""),
    "loop/predecessor/origin": (_POSE, ""),
    "loop/successor": (_LINK, ""),
    "loop/successor/origin": (_POSE, ""),
    "loop/axis": ("xyz", ""),
    "coupling": ("name type", "URDF+: a coupling of the joints between two pairs of links"),
    "coupling/predecessor": (_LINK, ""),
    "coupling/successor": (_LINK, ""),
    "coupling/ratio": (_VALUE, ""),
    "loop_joint": ("name type", "Isaac Sim, and Drake before 2017: a closure between two links"),
    "loop_joint/link1": (f"{_LINK} {_POSE}", ""),
    "loop_joint/link1/origin": (_POSE, ""),
    "loop_joint/link2": (f"{_LINK} {_POSE}", ""),
    "loop_joint/link2/origin": (_POSE, ""),
    "loop_joint/axis": ("xyz", "in both frames"),
    "frame": (f"name {_LINK} {_POSE}", "Drake: a frame"),
    "fixed_frame": ("name", "Isaac Sim: a frame"),
    "fixed_frame/parent": (_LINK, ""),
    "fixed_frame/origin": (_POSE, ""),
    _BALL: ("", "Drake: a point closure"),
    **{f"{_BALL}/{_BALL}_body_{end}": ("name", "") for end in "AB"},
    **{f"{_BALL}/{_BALL}_p_{point}": (_VALUE, "") for point in ("AP", "BQ")},
    _BUSHING: (
        "name",
        'Drake: with `bushings="closures"` the closure that it stands for, a point, hinge, slider or rigid '
        "connection; else an error",
    ),
    **{f"{_BUSHING}/drake:bushing_frame{end}": ("name", "") for end in "AC"},
    **{
        f"{_BUSHING}/drake:bushing_{what}_{part}": (_VALUE, "" if part == "stiffness" else "no effect")
        for what in ("torque", "force")
        for part in ("stiffness", "damping")
    },
    "gazebo": ("reference", "settings of a simulator"),
    "gazebo/joint": (
        "name type",
        "a closure between two links, as in SDF: revolute, continuous, prismatic, ball, universal, fixed",
    ),
    "gazebo/joint/parent": ("", ""),
    "gazebo/joint/child": ("", ""),
    "gazebo/joint/pose": ("relative_to", "in the child link"),
    "gazebo/joint/axis": ("", ""),
    "gazebo/joint/axis/xyz": ("expressed_in", "in the joint's frame"),
    "gazebo/joint/axis/use_parent_model_frame": ("", ""),
    "gazebo/joint/axis2": ("", ""),
    "gazebo/joint/axis2/xyz": ("expressed_in", ""),
    "gazebo/joint/axis2/use_parent_model_frame": ("", ""),
    "gazebo/plugin": ("name filename", "a warning, if it ties joints"),
    "transmission": ("name type", "which joints are actuated"),
    "transmission/joint": ("name", ""),
    "transmission/flexJoint": ("name mechanicalReduction", ""),
    "transmission/rollJoint": ("name mechanicalReduction", ""),
    "transmission/gap_joint": (
        "name mechanical_reduction screw_reduction gear_ratio L0 a b h r t0 phi0 theta0",
        "",
    ),
    "transmission/actuator": ("name", ""),
    "transmission/actuator/drake:rotor_inertia": (_VALUE, "Drake: inertia of the rotor"),
    "transmission/actuator/drake:gear_ratio": (_VALUE, "Drake: its gear"),
    "ros2_control": ("name type rw_rate is_async", "which joints are actuated"),
    "ros2_control/joint": ("name mimic", "actuated with a `<command_interface>`"),
    "ros2_control/joint/command_interface": ("name data_type size", ""),
    "ros2_control/joint/param": ("name", "a warning, if it ties joints"),
}
"""Elements that are read, by their place below ``<robot>``: their attributes, and what they become."""

_SHAPES = (
    "drake:proximity_properties drake:illustration_properties drake:perception_properties drake:visual "
    "drake:collision_filter_group"
)
_TEXT = "hardwareInterface mechanicalReduction mechanical_reduction offset role"
IDLE: Mapping[str, str] = {
    "robot": "material sensor author license group group_state disable_collisions end_effector "
    "virtual_joint "
    "passive_joint drake:collision_filter_group",
    "mujoco": "compiler option size visual statistic asset default contact actuator sensor keyframe",
    "link": "visual collision contact material self_filter collision_checking surface gravity kinematic "
    f"audio_source self_collide {_SHAPES}",
    "joint": "calibration safety_controller joint_properties hardwareInterface drake:controller_gains",
    "gazebo": "material visual collision sensor sensor:* controller:* map:* interface:* mu mu1 mu2 mu3 fdir1 "
    "kp kd maxVel minDepth maxContacts laserRetro selfCollide self_collide fudgeFactor stopKp stopKd stopErp "
    "stopCfm provideFeedback implicitSpringDamper dampingFactor turnGravityOff gravity kinematic enable_wind "
    "static physics surface canonicalBody initial_joint_position preserveFixedJoint light "
    "disableFixedJointLumping "
    "genTexCoord genNormals soft_cfm soft_erp cfmDamping torsional_friction allow_auto_disable",
    "gazebo/joint": "physics sensor",
    "gazebo/joint/axis": "limit",
    "gazebo/joint/axis2": "limit",
    "transmission": "type compensator leftActuator rightActuator passive_joint simulated_actuated_joint "
    f"use_simulated_gripper_joint pid motorTorqueConstant pulsesPerRevolution robotNamespace {_TEXT}",
    "transmission/joint": f"deadBandUpper deadBandLower saturationUpper saturationLower pid "
    f"ignoreTransmissionAbsoluteEncoder {_TEXT}",
    "transmission/actuator": f"motorTorqueConstant pulsesPerRevolution drake:controller_gains {_TEXT}",
    "ros2_control": "hardware sensor gpio transmission",
    "ros2_control/joint": "state_interface limits",
    "ros2_control/joint/command_interface": "param",
}
"""Elements that have no effect on the dynamics, by their place, with all that is in them."""
IDLE_ATTRIBUTES: Mapping[str, str] = {
    "link": "type concave",
    "link/inertial": "name",
    "joint": "dont_collapse",
    "joint/axis": "rpy",
    "joint/limit": "acceleration deceleration jerk current command_effort gear_velocity drake:acceleration",
    "joint/dynamics": "D K mu_coulomb mu_viscous",
}
"""Attributes that have none, likewise."""
_TYING = (
    "tendon equality constraint constraints closure loop_closure closed_loop linkage gear belt cable drake:*"
)
"""Elements of other dialects that hold joints together, whatever is in them."""
_POINTERS = (
    "frame frameName frame_name frame_id frameId bodyName body_name link linkName link_name robotBaseFrame "
    "robot_base_frame odometryFrame odometry_frame parent child collision joint jointName joint_name joints "
    "joint_names leftJoint rightJoint left_joint right_joint member topicName topic reference anchor "
    "drake:member drake:ignored_collision_filter_group drake:member_group disable_collisions group chain "
    "gazebo_frame base_link_id passive_joint gripper_name mimicJoint mimic_joint"
)
"""Elements in those without effect, and in plug-ins, that name links and joints and hold none together."""
_NO_CONSTRAINT = ("transmission", "ros2_control")
_NUMBER = re.compile(r"[-+.\deE]+")  # names of links, in some files
_SHOWN = 4  # how many are named in a warning


class Surprise(NamedTuple):
    """An element that is not understood."""

    element: Xml.Element
    words: str
    ties: bool
    """Whether it may hold joints together."""
    names: frozenset[str]
    """Links and joints that it names."""


def surprises(robot: Xml.Element) -> Iterator[Surprise]:
    """Yield what stands in a URDF and is neither read nor known to have no effect."""
    named = {name for element in robot if element.tag in ("link", "joint") and (name := element.get("name"))}
    yield from _within(robot, "robot", frozenset(), named)


def _within(element: Xml.Element, place: str, own: frozenset[str], named: set[str]) -> Iterator[Surprise]:
    known = READ.get(place, ("", ""))[0] + " " + IDLE_ATTRIBUTES.get(place, "")
    for attribute, text in element.attrib.items():
        if not _is_in(attribute, known + " xmlns*"):
            names = _named_in(text, named)
            words = f"the attribute {shown(attribute)} of <{element.tag}>"
            yield Surprise(element, words, _tie(names, own, place), names)
    for inner in element:
        tag = str(inner.tag)
        path = tag if place == "robot" else f"{place}/{tag}"
        if path in READ or path in IDLE:
            if tag == "plugin":
                yield from _idle(inner, named)
            else:
                yield from _within(inner, path, own or _own(inner, path), named)
        elif _is_in(tag, IDLE.get(place, "")) or (path == "link/origin" and not _moves(inner)):
            yield from _idle(inner, named)
        else:
            names = frozenset[str]().union(*(_names(part, named) for part in inner.iter()))
            ties = _tie(names, own, place) or (_is_in(tag, _TYING) and not place.startswith(_NO_CONSTRAINT))
            where = "" if place == "robot" else f" in <{element.tag}>"
            yield Surprise(inner, f"<{tag:.80}>{where}", ties, names)


def _moves(origin: Xml.Element) -> bool:
    """Whether an origin is more than zeros, as some exporters write for each link."""
    return any(word.strip("-+0.e") for text in origin.attrib.values() for word in text.split())


def _tie(names: frozenset[str], own: frozenset[str], place: str) -> bool:
    """Whether names beside those of what an element belongs to can be held together by it."""
    return len(names - own) > (not own) and not place.startswith(_NO_CONSTRAINT)


def _idle(element: Xml.Element, named: set[str]) -> Iterator[Surprise]:
    """Yield what names two links or joints in an element without effect."""
    names = _below(element, named, top=True)
    if len(names) < 2:
        return
    part: Xml.Element | None = element
    smallest = element
    while part is not None:
        smallest, part = part, next((one for one in part if len(_below(one, named)) > 1), None)
    called = f" name={shown(smallest.get('name'))}" if smallest.get("name") else ""
    where = "" if smallest is element else f" in <{element.tag}>"
    listed = ", ".join(sorted(_below(smallest, named, top=smallest is element))[:2])
    words = f"<{smallest.tag:.80}{called}>{where} (it names {listed:.160})"
    yield Surprise(smallest, words, False, names)


def _below(element: Xml.Element, named: set[str], top: bool = False) -> frozenset[str]:
    """Return what an element without effect and all in it name, but for pointers, numbers, its own name."""
    parts = [part for part in element.iter() if not _is_in(str(part.tag), _POINTERS)]
    names = (_names(part, named, not top or part is not element) for part in parts)
    return frozenset(name for found in names for name in found if not _NUMBER.fullmatch(name))


def _own(element: Xml.Element, path: str) -> frozenset[str]:
    """Return the names of what an element is about."""
    if path in ("link", "joint"):
        ends = [element.find(end) for end in ("parent", "child")]
        links = [end.get("link", "") for end in ends if end is not None]
        return frozenset({element.get("name", ""), *links})
    reference = element.get("reference")
    return frozenset({reference}) if path == "gazebo" and reference else frozenset()


def _names(element: Xml.Element, named: set[str], with_name: bool = True) -> frozenset[str]:
    texts = [text for key, text in element.attrib.items() if with_name or key != "name"]
    return frozenset[str]().union(*(_named_in(text, named) for text in (*texts, element.text or "")))


def _named_in(text: str, named: set[str]) -> frozenset[str]:
    """Return the names in a text: all of it, its words, and the parts of scoped ones."""
    words = {*re.split(r"[\s,;]+", text), *re.split(r"[\s,;/\[\]()]+|::", text)}
    return frozenset({text.strip(), *(word for word in words if not _NUMBER.fullmatch(word))} & named)


def _is_in(name: str, known: str) -> bool:
    words, starts = _words(known)
    return name in words or name.startswith(starts)


@cache
def _words(known: str) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return words, and the beginnings of those that end in a star."""
    words = known.split()
    return frozenset(words), tuple(word[:-1] for word in words if word.endswith("*"))


def in_one_line(found: list[tuple[int, str]]) -> str:
    """Return what was found, with its lines: the first few, and how many more."""
    first: dict[str, int] = {}
    for line, words in found:
        first.setdefault(words, line)
    told = [f"{words} (line {line})" for words, line in list(first.items())[:_SHOWN]]
    more = len(first) - len(told)
    return ", ".join(told) + (f" and {more} more" if more else "")


def table() -> str:
    """Return the elements that are read, and those without effect, in Markdown."""
    rows = ["| Element | Attributes | Read as |", "|---|---|---|"]
    for path, (attributes, meaning) in READ.items():
        listed = ", ".join(f"`{name}`" for name in attributes.split())
        rows.append(f"| `{path}` | {listed} | {meaning} |")
    rows += ["", "| In | Elements without effect on the dynamics | Attributes |", "|---|---|---|"]
    for path in dict.fromkeys((*IDLE, *IDLE_ATTRIBUTES)):
        parts = (
            ", ".join(f"`{name}`" for name in sorted(known.get(path, "").split()))
            for known in (IDLE, IDLE_ATTRIBUTES)
        )
        rows.append(f"| `{path}` | {' | '.join(parts)} |")
    return "\n".join(rows) + "\n"
