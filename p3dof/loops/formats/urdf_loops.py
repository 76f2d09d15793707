"""Loops, couplings, motors and frames that a URDF declares itself, in the dialects of several tools.

Known is what stands in `READ`, by its place below ``<robot>``, and, with all that is in it, in `IDLE`; all
else is named. So what somebody else's dialect holds together is never an open tree without a word.

References
----------
M. Chignoli et al., URDF+: an enhanced URDF for robots with kinematic loops, 2024, arXiv:2411.19753.
Drake, parsing of URDF: ``drake:ball_constraint``, ``drake:linear_bushing_rpy``, ``frame``.
NVIDIA Isaac Sim, URDF importer: ``loop_joint``, ``fixed_frame``.
SDFormat, specification 1.7: ``joint``, as in ``<gazebo>``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple, NoReturn
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.bushings import Bushing
from p3dof.loops.coordinates import add_frame, single_joint
from p3dof.loops.sidecar import Closure, Coupling, JointData, suggestion

_BALL, _BUSHING = "drake:ball_constraint", "drake:linear_bushing_rpy"
_POSE, _LINK, _VALUE = "xyz rpy", "link", "value"
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
        'Drake: a spring and damper between two frames; with `bushings="closures"` the closure that it '
        "stands for, a point, hinge, slider or rigid connection",
    ),
    **{f"{_BUSHING}/drake:bushing_frame{end}": ("name", "") for end in "AC"},
    **{
        f"{_BUSHING}/drake:bushing_{what}_{part}": (
            _VALUE,
            "zero where it is missing" if part == "stiffness" else "likewise; no effect in a closure",
        )
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
_TIES = (
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
            ties = _tie(names, own, place) or (_is_in(tag, _TIES) and not place.startswith(_NO_CONSTRAINT))
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


LOOP_KINDS = {
    "revolute": "hinge",
    "continuous": "hinge",
    "spherical": "3d",
    "fixed": "6d",
    "prismatic": "slider",
    "cylindrical": "cylindrical",
    "planar": "planar",
}
"""Types of ``<loop>`` in URDF+, and the closures that they are."""

_IN_GAZEBO = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
    "ball": "3d",
    "universal": "universal",
    "fixed": "6d",
}
"""Types of ``<joint>`` in ``<gazebo>``, and the closures that they are."""
_SOFT = 1e-3  # a stiffness of a bushing below this share of the largest of its kind holds nothing
_PERPENDICULAR = 1e-6  # largest cosine between the two axes of a universal joint
_TYING = re.compile(r"mimic|closed.?loop|loop.?clos|constraint", re.IGNORECASE)
"""Names of plug-ins of simulators, and of elements in them, that tie joints."""
_MOTORS = ("actuator", "leftActuator", "rightActuator")
_MOVED = ("joint", "flexJoint", "rollJoint", "gap_joint")
"""Elements of a ``<transmission>`` that are motors, and that are joints which these move."""


@dataclass
class Declared:
    """What a URDF says of loops, beside its tree."""

    closures: list[Closure] = field(default_factory=list)  # the loops
    couplings: list[Coupling] = field(default_factory=list)
    bushings: list[Bushing] = field(default_factory=list)  # springs and dampers between frames
    dependent: set[str] = field(default_factory=set)
    """Names of joints that the loops determine, by the file's own words."""
    rotors: list[JointData] = field(default_factory=list)
    """Rotors and gears in Drake's elements of `<transmission>`."""
    motors: set[str] = field(default_factory=set)
    """Names of joints that have motors, by the file's own words."""
    unknown: str = ""
    """What is not understood and holds no joints together, in words."""


def declared(
    robot: Xml.Element,
    model: pin.Model,
    source: str,
    mimic: bool,
    line_of: Callable[[Xml.Element], int],
    ignore_unknown: bool,
    bushings: str | None,
) -> Declared:
    """Return the loops that a URDF declares; their frames are added to its model."""
    reader = _LoopReader(robot, model, source, line_of)
    reader.frames()
    reader.closures(bushings, ignore_unknown)
    for element in robot.iterfind("coupling"):
        reader.coupling(element)
    for joint in robot.iterfind("joint") if mimic else ():
        reader.mimic(joint)
    for element in robot.iterfind("transmission"):
        reader.rotor(element)
    reader.independent(ignore_unknown)
    reader.found.motors = _motors(robot)
    if not ignore_unknown:
        reader.surprises()
    return reader.found


def _motors(robot: Xml.Element) -> set[str]:
    """Return the joints that have motors by the file's own word."""
    moved = [
        part
        for element in robot.iterfind("transmission")
        if any(element.find(motor) is not None for motor in _MOTORS)
        for part in element
        if part.tag in _MOVED
    ]
    commanded = [
        joint for joint in robot.iterfind("ros2_control/joint") if joint.find("command_interface") is not None
    ]
    return {part.get("name", "") for part in (*moved, *commanded)}


def closing_pairs(robot: Xml.Element, model: pin.Model) -> Iterator[Closure]:
    """Yield the loops that onshape-to-robot cuts: links ``closing_NAME_1`` and ``_2`` on two moving bodies.

    It says nothing of the kind of joint; a point is what all kinds but slides have in common.
    """
    names = {link.get("name", "") for link in robot.iterfind("link")}
    for first in sorted(names):
        second = f"{first[:-1]}2"
        if first.startswith("closing_") and first.endswith("_1") and second in names:
            ends = [model.frames[model.getFrameId(name, pin.FrameType.BODY)] for name in (first, second)]
            if ends[0].parentJoint != ends[1].parentJoint:
                yield Closure(first, second, "3d")


def tying_plugins(robot: Xml.Element, free: Collection[str]) -> Iterator[tuple[Xml.Element, str]]:
    """Yield plug-ins of simulators that tie joints which nothing else ties, with words for them."""
    for plugin in robot.iter("plugin"):
        parts = [part for part in plugin.iter() if part is not plugin and _TYING.search(part.tag)]
        if not parts and not _TYING.search(f"{plugin.get('name', '')} {plugin.get('filename', '')}"):
            continue
        followers = [(part.text or part.get("name") or "").strip() for part in parts]
        loose = [name for name in followers if name in free]
        if not loose and (followers or not free):
            continue
        what = f"ties the joint {', '.join(map(shown, loose))} to others" if loose else "ties joints"
        name = plugin.get("name") or plugin.get("filename") or ""
        yield (
            plugin,
            f"<plugin name={shown(name)}> {what} in its simulator only, and is left out: here they move by "
            "themselves (give <mimic>, or couplings or closures in a sidecar)",
        )


def tying_parameters(robot: Xml.Element, free: Collection[str]) -> Iterator[tuple[Xml.Element, str]]:
    """Yield joints in ``<ros2_control>`` that follow others there and here do not, with words for them."""
    for joint in robot.iterfind("ros2_control/joint"):
        follows = joint.get("mimic", "").lower() == "true" or joint.find("param[@name='mimic']") is not None
        if follows and (name := joint.get("name", "")) in free:
            yield (
                joint,
                f"<ros2_control> makes the joint {shown(name)} follow another one, and here it moves by "
                "itself (give <mimic>, or couplings in a sidecar)",
            )


class _LoopReader:
    """Turns elements into closures and couplings."""

    def __init__(
        self, robot: Xml.Element, model: pin.Model, source: str, line_of: Callable[[Xml.Element], int]
    ) -> None:
        self._robot, self._model, self._source, self._line_of = robot, model, source, line_of
        self._above: dict[str, Xml.Element] = {}
        for joint in robot.iterfind("joint"):
            child = joint.find("child")
            if child is not None:
                self._above[child.get("link", "")] = joint
        self._links = [link.get("name", "") for link in robot.iterfind("link")]
        self._names = {frame.name for frame in model.frames}
        self._named: dict[str, tuple[str, pin.SE3]] = {}  # frames of the file, each with its link
        self.found = Declared()

    def fail(self, element: Xml.Element, message: str) -> NoReturn:
        name = element.get("name")
        called = f"<{element.tag}{f' name={shown(name)}' if name else ''}>"
        start = "" if message.startswith("<") else f"{called}: "
        raise ModelError(f"{self._source}, line {self._line_of(element)}: {start}{message}")

    def frames(self) -> None:
        """Read the frames that the file names."""
        for element in self._robot:
            if element.tag in ("frame", "fixed_frame"):
                self.named_frame(element)

    def closures(self, bushings: str | None, ignore_unknown: bool) -> None:
        """Read the loops of all dialects."""
        for element in self._robot.iterfind("loop"):
            self.loop(element)
        for number, element in enumerate(_parts(self._robot, _BALL), 1):
            self.ball(element, number)
        for number, element in enumerate(_parts(self._robot, _BUSHING), 1):
            self.bushing(element, number, bushings)
        of_gazebo = [
            element
            for element in self._robot.iterfind("gazebo/joint")
            if element.find("parent") is not None or element.find("child") is not None
        ]
        with_reader = [(self.loop_joint, element) for element in self._robot.iterfind("loop_joint")]
        for read, element in (*with_reader, *((self.gazebo_joint, element) for element in of_gazebo)):
            with suppress(ModelError) if ignore_unknown else nullcontext():
                read(element)

    def named_frame(self, element: Xml.Element) -> None:
        """Read a frame of Drake (attributes) or of Isaac Sim (elements)."""
        name = element.get("name", "")
        if not name or name in self._names:
            self.fail(element, "it has no name" if not name else f"a frame {shown(name)} is there already")
        if element.tag == "frame":
            link, placement = self._link(element), self._pose(element)
        else:
            link, placement = self._link(self._part(element, "parent")), self._origin(element)
        self._named[name] = (link, placement)
        self._frame(name, link, placement)

    def loop(self, element: Xml.Element) -> None:
        """Read ``<loop>`` of URDF+: a joint between two links that are both in the tree already."""
        name, kind = element.get("name", ""), element.get("type", "")
        if kind not in LOOP_KINDS:
            self.fail(element, f"type: expected one of {', '.join(LOOP_KINDS)}, got {shown(kind)}")
        turn = self._along(element)
        ends = []
        for end in ("predecessor", "successor"):
            part = self._part(element, end)
            ends.append(self._frame(f"{name}_{end}", self._link(part), self._origin(part) * turn))
        self.found.closures.append(Closure(ends[0], ends[1], LOOP_KINDS[kind]))

    def loop_joint(self, element: Xml.Element) -> None:
        """Read ``<loop_joint>``: two places that coincide, but for what the joint leaves free.

        Isaac Sim writes both links as ``<link1>``.
        """
        name, kind = element.get("name") or "loop_joint", element.get("type", "")
        if kind not in LOOP_KINDS:
            self.fail(element, f"type: expected one of {', '.join(LOOP_KINDS)}, got {shown(kind)}")
        parts = [part for part in element if part.tag in ("link1", "link2")]
        if len(parts) != 2:
            self.fail(element, f"expected <link1> and <link2>, got {len(parts)} of them")
        turn = self._along(element)
        places = [self._pose(part) if part.find("origin") is None else self._origin(part) for part in parts]
        ends = [
            self._frame(f"{name}_{number}", self._link(part), place * turn)
            for number, (part, place) in enumerate(zip(parts, places, strict=True), 1)
        ]
        self._close(element, ends, LOOP_KINDS[kind])

    def gazebo_joint(self, element: Xml.Element) -> None:
        """Read ``<joint>`` in ``<gazebo>``: its frame is in the child link, and it is closed at zero."""
        name, kind = element.get("name") or "joint", element.get("type", "")
        if kind not in _IN_GAZEBO:
            self.fail(element, f"type: expected one of {', '.join(_IN_GAZEBO)}, got {shown(kind)}")
        links = [self._text(self._part(element, end)) for end in ("parent", "child")]
        for link in links:
            if link not in self._links and link != "world":
                help_ = suggestion(link, self._links)
                self.fail(element, f"the link {shown(link)} does not exist; {help_}")
        pose, place = element.find("pose"), pin.SE3.Identity()
        if pose is not None:
            if pose.get("relative_to", "") not in ("", links[1]):
                other = shown(pose.get("relative_to"))
                self.fail(element, f"<pose> relative_to: expected the child link, got {other}")
            values = self._values(element, pose, 6)
            place = pin.SE3(pin.rpy.rpyToMatrix(*values[3:]), values[:3])
        place = place * pin.SE3(self._axes(element, kind), np.zeros(3))
        data = self._model.createData()
        pin.framesForwardKinematics(self._model, data, pin.neutral(self._model))
        parent, child = (data.oMf[self._on(link)] for link in links)
        ends = [
            self._frame(f"{name}_{end}", link, where)
            for end, link, where in zip(
                ("parent", "child"), links, (parent.actInv(child) * place, place), strict=True
            )
        ]
        self._close(element, ends, _IN_GAZEBO[kind])

    def _axes(self, element: Xml.Element, kind: str) -> FloatArray:
        """Return the rotation from the joint's frame to that of its closure."""
        found = []
        count = {"universal": 2, "ball": 0, "fixed": 0}.get(kind, 1)
        for tag in ("axis", "axis2")[:count]:
            axis = element.find(tag)
            xyz = None if axis is None else axis.find("xyz")
            values = np.array([0.0, 0.0, 1.0])
            if axis is not None and xyz is not None:
                of_model = axis.find("use_parent_model_frame")
                if xyz.get("expressed_in", "") not in ("", element.get("name")) or (
                    of_model is not None and self._text(of_model).lower() in ("1", "true")
                ):
                    self.fail(element, f"<{tag}>: expected an axis in the joint's own frame")
                values = self._values(element, xyz, 3)
            if not 0 < np.linalg.norm(values) < np.inf:
                self.fail(element, f"<{tag}>: expected a direction, got zero or one too long")
            found.append(values / np.linalg.norm(values))
        if not found:
            return np.eye(3)
        if kind != "universal":
            return with_z_along(found[0])
        x, y = found
        if abs(x @ y) > _PERPENDICULAR:
            self.fail(element, "expected <axis> and <axis2> perpendicular to each other")
        y = y - (x @ y) * x
        y /= np.linalg.norm(y)
        return np.column_stack((x, y, np.cross(x, y)))

    def bushing(self, element: Xml.Element, number: int, bushings: str | None) -> None:
        """Read Drake's bushing, or the closure that it approaches where it is stiff."""
        law = [
            np.concatenate(
                [
                    self._numbers(_first(element, f"drake:bushing_{what}_{part}"), "value", 3, (0.0,) * 3)
                    for what in ("force", "torque")
                ]
            )
            for part in ("stiffness", "damping")
        ]
        if min(law[0]) < 0 or min(law[1]) < 0:
            self.fail(element, "expected no negative stiffness or damping")
        stiffness = law[0][:3], law[0][3:]
        kind, axis = _bushing_kind(*(part > _SOFT * part.max() for part in stiffness))
        if bushings is None:
            axis = None
        elif not kind:
            self.fail(
                element,
                "expected the stiffness of a point (forces alone), a hinge (a torque about two axes too), a "
                "slider (all but a force along one axis) or a rigid connection (all), got forces "
                f"{_listed(stiffness[0])} and torques {_listed(stiffness[1])}",
            )
        turn = pin.SE3(np.eye(3) if axis is None else with_z_along(np.eye(3)[axis]), np.zeros(3))
        ends = []
        for end in "AC":
            part = self._part(element, f"drake:bushing_frame{end}")
            name = part.get("name", "")
            link, place = self._named.get(name, (name, pin.SE3.Identity()))
            if link not in self._links and link != "world":
                help_ = suggestion(name, [*self._named, *self._links])
                self.fail(part, f"<{part.tag}>: the frame {shown(name)} does not exist; {help_}")
            ends.append(self._frame(f"bushing_{number}_{end}", link, place * turn))
        if bushings is None:
            self._apart(element, ends)
            name = element.get("name") or f"bushing_{number}"
            self.found.bushings.append(Bushing((ends[0], ends[1]), tuple(law[0]), tuple(law[1]), name))
        else:
            self._close(element, ends, kind)

    def ball(self, element: Xml.Element, number: int) -> None:
        """Read Drake's ball constraint: two points of two links that coincide."""
        ends = []
        for body, point in (("A", "p_AP"), ("B", "p_BQ")):
            part = self._part(element, f"{_BALL}_body_{body}")
            place = self._numbers(_first(element, f"{_BALL}_{point}"), "value", 3, (0.0, 0.0, 0.0))
            placement = pin.SE3(np.eye(3), place)
            ends.append(self._frame(f"ball_constraint_{number}_{body}", self._link(part, "name"), placement))
        self.found.closures.append(Closure(ends[0], ends[1], "3d"))

    def coupling(self, element: Xml.Element) -> None:
        """Read ``<coupling>`` of URDF+: the successor turns by the ratio times as much as the predecessor.

        Both turns are sums over the joints from the nearest link that both hang on.
        """
        if element.get("type", "rolling") != "rolling":
            self.fail(element, f"type: expected 'rolling', got {shown(element.get('type'))}")
        ratio = float(self._numbers(element.find("ratio"), "value", 1, None)[0])
        chains = [self._chain(self._link(self._part(element, end))) for end in ("predecessor", "successor")]
        common = set(chains[0]) & set(chains[1])
        before, after = ([joint for joint in chain if joint not in common] for chain in chains)
        if not before or not after:
            self.fail(element, "expected two links on different branches, one hangs on the other")
        driven, driver = after[0], before[0]
        others = [(joint, ratio) for joint in before[1:]] + [(joint, -1.0) for joint in after[1:]]
        self._couple(element, Coupling(driven, driver, (0.0, ratio), element.get("name"), tuple(others)))

    def mimic(self, joint: Xml.Element) -> None:
        """Read ``<mimic>``: a joint that follows another one."""
        element = joint.find("mimic")
        if element is None or joint.get("type") == "fixed":  # what is locked follows nothing
            return
        name, leader = joint.get("name", ""), element.get("joint", "")
        if leader not in self._model.names:
            help_ = suggestion(leader, list(self._model.names)[1:])
            self.fail(joint, f"<mimic>: the joint {shown(leader)} does not exist or cannot move; {help_}")
        factor = self._number(joint, element, "multiplier", 1.0)
        offset = self._number(joint, element, "offset", 0.0)
        self._couple(joint, Coupling(name, leader, (offset, factor), f"mimic_{name}"))

    def rotor(self, element: Xml.Element) -> None:
        """Read Drake's rotor inertia and gear ratio of the joint that a ``<transmission>`` drives."""
        actuator, joint = _first(element, "actuator"), _first(element, "joint")
        values = {
            name: self._number(element, part, "value", 0.0)
            for name in ("rotor_inertia", "gear_ratio")
            for part in (() if actuator is None else _parts(actuator, f"drake:{name}"))
        }
        if not values:
            return
        name = "" if joint is None else joint.get("name", "")
        if any(entry.joint == name for entry in self.found.rotors):
            self.fail(element, f"the joint {shown(name)} has a rotor already")
        single_joint(self._model, name, f"{self._source}: <transmission>")
        try:
            self.found.rotors.append(JointData(name, **values))
        except ModelError as error:
            self.fail(element, str(error))

    def independent(self, ignore: bool) -> None:
        """Read which joints the file itself calls dependent, and whether something determines them."""
        said = {
            joint.get("name", "")
            for joint in self._robot.iterfind("joint")
            if joint.get("independent", "true").lower() == "false"
        }
        if said and not ignore and not self.found.closures and not self.found.couplings:
            names = ", ".join(sorted(said)[:3])
            raise ModelError(
                f"{self._source}: {len(said)} joints are declared dependent ({names}, ...), and no "
                "<loop> or <coupling> says on what (on_unknown='ignore' takes them for independent)"
            )
        self.found.dependent |= said

    def surprises(self) -> None:
        """Refuse what is not understood and may hold joints together, and keep in words what else is."""
        told = []
        for found in surprises(self._robot):
            if found.ties and not self._is_tied(found):
                raise ModelError(
                    f"{self._source}, line {self._line_of(found.element)}: {found.words} may hold links or "
                    "joints together, and is not understood (on_unknown='ignore' leaves it out)"
                )
            told.append((self._line_of(found.element), found.words))
        self.found.unknown = in_one_line(told)

    def _is_tied(self, found: Surprise) -> bool:
        """Whether a simulator's joint ties links whose joints are coupled here already."""
        links = found.names & set(self._links)
        if not found.words.endswith("in <gazebo>") or len(links) < 2:
            return False
        chains = [set(self._chain(link)) for link in links]
        coupled = {name for coupling in self.found.couplings for name in (coupling.joint, *coupling.leaders)}
        return set().union(*chains) - chains[0].intersection(*chains) <= coupled

    def _close(self, element: Xml.Element, ends: list[str], kind: str) -> None:
        self._apart(element, ends)
        self.found.closures.append(Closure(ends[0], ends[1], kind))

    def _apart(self, element: Xml.Element, ends: list[str]) -> None:
        """Refuse two frames on one body."""
        frames = [self._model.frames[self._model.getFrameId(end)] for end in ends]
        if frames[0].parentJoint == frames[1].parentJoint:
            self.fail(element, "expected two links that move against each other")

    def _along(self, element: Xml.Element) -> pin.SE3:
        axis = self._numbers(element.find("axis"), "xyz", 3, (1.0, 0.0, 0.0))
        if not 0 < np.linalg.norm(axis) < np.inf:
            self.fail(element, f"axis: expected a direction, got {'one too long' if axis.any() else 'zero'}")
        return pin.SE3(with_z_along(axis), np.zeros(3))

    def _text(self, element: Xml.Element) -> str:
        return (element.text or "").strip()

    def _values(self, joint: Xml.Element, element: Xml.Element, count: int) -> FloatArray:
        """Return the numbers in an element's text."""
        part = Xml.Element(element.tag, {"text": self._text(element)})
        try:
            return self._numbers(part, "text", count, None)
        except ModelError as error:
            self.fail(joint, str(error).removeprefix(f"{self._source}: ").replace("> text:", ">:"))

    def _couple(self, element: Xml.Element, coupling: Coupling) -> None:
        for joint in (coupling.joint, *coupling.leaders):
            single_joint(self._model, joint, f"{self._source}: <{element.tag}>")
        self.found.couplings.append(coupling)
        self.found.dependent.add(coupling.joint)

    def _chain(self, link: str) -> list[str]:
        """Return the joints that can move from a link to the root."""
        joints = []
        while link in self._above:
            joint = self._above[link]
            if joint.get("type") != "fixed":
                joints.append(joint.get("name", ""))
            parent = joint.find("parent")
            link = parent.get("link", "") if parent is not None else ""
        return joints

    def _part(self, element: Xml.Element, tag: str) -> Xml.Element:
        part = _first(element, tag)
        if part is None:
            self.fail(element, f"the element <{tag}> is missing")
        return part

    def _link(self, part: Xml.Element, attribute: str = "link") -> str:
        name = part.get(attribute, "")
        if name not in self._links and name != "world":
            help_ = suggestion(name, self._links)
            self.fail(part, f"<{part.tag}>: the link {shown(name)} does not exist; {help_}")
        return name

    def _origin(self, part: Xml.Element) -> pin.SE3:
        return self._pose(part.find("origin"))

    def _pose(self, element: Xml.Element | None) -> pin.SE3:
        xyz = self._numbers(element, "xyz", 3, (0.0, 0.0, 0.0))
        rpy = self._numbers(element, "rpy", 3, (0.0, 0.0, 0.0))
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)

    def _frame(self, name: str, link: str, placement: pin.SE3) -> str:
        while name in self._names:
            name += "_"
        self._names.add(name)
        add_frame(self._model, name, self._on(link), placement)
        return name

    def _on(self, link: str) -> int:
        """Return the frame of a link, or of the world."""
        if link == "world" and link not in self._links:
            return 0
        on = self._model.getFrameId(link, pin.FrameType.BODY)
        if on >= self._model.nframes:
            raise ModelError(f"{self._source}: Pinocchio has left out the link {shown(link)} of a loop")
        return int(on)

    def _number(self, joint: Xml.Element, element: Xml.Element, name: str, default: float) -> float:
        try:
            return float(self._numbers(element, name, 1, (default,))[0])
        except ModelError as error:
            self.fail(joint, str(error).removeprefix(f"{self._source}: "))

    def _numbers(
        self, element: Xml.Element | None, name: str, count: int, default: tuple[float, ...] | None
    ) -> FloatArray:
        text = None if element is None else element.get(name)
        if text is None and default is not None:
            return np.array(default)
        try:
            values = [float(word) for word in (text or "").split()]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            tag = "ratio" if element is None else element.tag
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            raise ModelError(f"{self._source}: <{tag}> {name}: expected {wanted}, got {shown(text)}")
        return np.array(values)


def _parts(element: Xml.Element, tag: str) -> list[Xml.Element]:
    """Return the parts of a name, which may have a prefix: ElementTree's own search looks prefixes up."""
    return [part for part in element if part.tag == tag]


def _first(element: Xml.Element, tag: str) -> Xml.Element | None:
    return next(iter(_parts(element, tag)), None)


def _bushing_kind(forces: FloatArray, torques: FloatArray) -> tuple[str, int | None]:
    """Return the closure that a bushing stands for, and its axis; empty if it is none."""
    stiff, held = int(forces.sum()), int(torques.sum())
    if stiff == 3 and held in (0, 3):
        return ("6d" if held else "3d"), None
    if stiff == 3 and held == 2:
        return "hinge", int(np.argmin(torques))
    if stiff == 2 and held == 3:
        return "slider", int(np.argmin(forces))
    return "", None


def _listed(numbers: FloatArray) -> str:
    return " ".join(f"{number:g}" for number in numbers)


def with_z_along(axis: FloatArray) -> FloatArray:
    """Return a rotation matrix whose z axis is along an axis; the identity where it is z already."""
    z = axis / np.linalg.norm(axis)
    if z[2] > 1 - 1e-15:
        return np.eye(3)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
