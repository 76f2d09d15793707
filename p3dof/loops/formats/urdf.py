"""URDF: the tree by Pinocchio, its loops from the file (URDF+, Drake's tags, ``<mimic>``) or a sidecar.

Drake's rotors are read too, and what is unknown is named.

urdfdom drops an unreadable ``<inertial>`` and goes on with a massless link, and Pinocchio reads a cycle as an
empty model and a link with two parents as a missing body. Here each of these is one clear error. They are
given links and joints only: of all else, urdfdom would complain on the standard error.

References
----------
M. Chignoli et al., URDF+: an enhanced URDF for robots with kinematic loops, 2024, arXiv:2411.19753.
Drake, parsing of URDF, ``drake:ball_constraint``.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import NoReturn
from warnings import warn
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, one_line, shown
from p3dof._base.errors import FileError, InputError, ModelError, ModelWarning
from p3dof._base.files import read_text
from p3dof.loops.coordinates import losses_of, single_joint, with_armature
from p3dof.loops.sidecar import Closure, Coupling, JointData, Sidecar, SidecarLike, sidecar_of, suggestion
from p3dof.loops.trees import NewJoint, add_frame, with_joints
from p3dof.loops.xml_text import XmlReader, is_text, read_xml

MAX_LINKS = 1000  # most links: on a chain of a few thousand, Pinocchio's reader overflows the stack
MAX_FREEDOMS = 200
"""Most degrees of freedom: Pinocchio's workspaces take the cube of their number, 256 MB each at this one."""
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": dict.fromkeys(("damping", "friction"), 1),
    "mimic": dict.fromkeys(("multiplier", "offset"), 1),
}
"""Attributes that must be numbers, and how many."""
_REQUIRED = {("inertial", "mass"), ("inertial", "inertia"), ("joint", "effort"), ("joint", "velocity")}
"""Elements and attributes, by where they are, that must be there."""
_PARTS = {"link": ("inertial",), "joint": ("parent", "child", "origin", "axis", "limit", "dynamics")}
"""What Pinocchio is given of a file: of each the first, so that there may be no second."""
_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_LIMITED = ("revolute", "prismatic")
_SHORT = 1e-9
"""Length of an axis below which its direction is rounding, if it has one; one may be as much too long."""


def build_tree(
    text: str, source: str, root_joint: pin.JointModel | None = None
) -> tuple[pin.Model, Xml.Element, Callable[[Xml.Element], int]]:
    """Build the tree model of a URDF, of at most 1000 links and 200 degrees of freedom."""
    reader = _LinkReader(source)
    robot = reader.parse(text)
    if not reader.links:
        raise ModelError(f"{source}: the robot has no links")
    _check_parts(reader, robot)
    _check_tree(reader)
    bare = _bare(robot)
    arguments = (bare,) if root_joint is None else (bare, root_joint)
    try:
        model = pin.buildModelFromXML(*arguments)
    except Exception as error:  # Boost.Python raises its own types
        message = one_line(str(error)) or type(error).__name__
        raise ModelError(f"{source}: Pinocchio cannot read it: {message}") from error
    if model.nv > MAX_FREEDOMS:
        raise ModelError(f"{source}: expected at most {MAX_FREEDOMS} degrees of freedom, got {model.nv}")
    return model, robot, reader.line_of


def _bare(robot: Xml.Element) -> str:
    """Return the text of links and joints alone."""
    root = Xml.Element("robot", name=robot.get("name") or "robot")
    for element in robot:
        if element.tag in _PARTS:
            part = Xml.SubElement(root, element.tag, element.attrib)
            part.extend(inner for inner in element if inner.tag in _PARTS[element.tag])
    return Xml.tostring(root, encoding="unicode")


@dataclass
class _Joint:
    name: str
    line: int
    kind: str
    parent: str | None = None
    child: str | None = None


class _LinkReader(XmlReader):
    """Collects links and joints."""

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self.links: dict[str, int] = {}
        self.joints: dict[str, _Joint] = {}
        self._joint: _Joint | None = None
        self._parts: set[tuple[str, ...]] = set()

    def visit(self, tag: str, attributes: dict[str, str]) -> None:
        """Enter a link, a joint or a part of one."""
        if len(self.path) == 1 and tag != "robot":
            self.fail(f"expected the element <robot>, got <{tag}>")
        if tag.startswith("xacro:"):
            self.fail(
                f"<{tag:.80}> is a macro: expand the file first, such as with `xacro FILE > robot.urdf`"
            )
        if self.path[1:] == ["link"]:
            self._new(tag, attributes, self.links)
            self.links[attributes["name"]] = self.line
        elif self.path[1:] == ["joint"]:
            self._new(tag, attributes, self.joints)
            name = attributes["name"]
            self._joint = _Joint(name, self.line, attributes.get("type", ""))
            self.joints[name] = self._joint
        elif self._joint is not None and self.path[1:-1] == ["joint"] and tag in ("parent", "child"):
            setattr(self._joint, tag, attributes.get("link"))
        if len(self.path) > 2 and self.path[1] in _PARTS:
            self._numbers(tag, attributes)
            if self.path[2] in _PARTS[self.path[1]]:
                self._once(tag)

    def _new(self, tag: str, attributes: dict[str, str], known: Collection[str]) -> None:
        name = attributes.get("name", "")
        if not name:
            self.fail(f"<{tag}> has no name")
        if name in known:
            self.fail(f"the {tag} {shown(name)} is defined twice")
        if len(known) == MAX_LINKS:
            self.fail(f"expected at most {MAX_LINKS} {tag}s")
        self._parts.clear()

    def _once(self, tag: str) -> None:
        part = tuple(self.path[2:])
        if part in self._parts:
            self.fail(f"<{tag}> is given twice in <{self.path[-2]}>")
        self._parts.add(part)

    def _numbers(self, tag: str, attributes: dict[str, str]) -> None:
        above = self.path[-2]
        for name, count in _NUMBERS.get(tag, {}).items():
            if name not in attributes and not {(above, tag), (above, name)} & _REQUIRED:
                continue
            text = attributes.get(name, "")
            values = [_number(word) for word in text.split()]
            # urdfdom drops the whole <inertial> when white space follows a single number
            trailing = count == 1 and text != text.rstrip()
            if trailing or len(values) != count or not all(map(math.isfinite, values)):
                wanted = "a finite number" if count == 1 else f"{count} finite numbers"
                self.fail(f"<{tag}> {name}: expected {wanted}, got {shown(attributes.get(name))}")
            if tag == "mass" and values[0] < 0:
                self.fail(f"<mass> value: expected no negative mass, got {values[0]:g}")
            if tag == "axis" and self._turns() and not _SHORT <= math.hypot(*values) <= 1 / _SHORT:
                length = (
                    "one that is too long" if math.hypot(*values) > 1 else "nearly " * any(values) + "zero"
                )
                self.fail(f"<axis> xyz: expected a direction, got {length}")

    def _turns(self) -> bool:
        """Whether the joint needs an axis: CAD exporters give fixed ones a zero axis."""
        return self._joint is None or self._joint.kind not in ("fixed", "floating")


def _number(word: str) -> float:
    try:
        return float(word) if word.isascii() and "_" not in word else math.nan  # as urdfdom does
    except ValueError:
        return math.nan


def _check_parts(reader: _LinkReader, robot: Xml.Element) -> None:
    """Refuse what urdfdom leaves out and goes on without, or refuses for reasons that only it prints."""
    for link in robot.iterfind("link"):
        for inertial, part in itertools.product(link.iterfind("inertial"), ("mass", "inertia")):
            if inertial.find(part) is None:
                name = link.get("name", "")
                reader.fail(f"link {shown(name)}: its <inertial> has no <{part}>", reader.links[name])
    for element in robot.iterfind("joint"):
        joint = reader.joints[element.get("name", "")]
        if joint.kind not in _KINDS:
            expected = f"expected one of {', '.join(_KINDS)}, got {shown(joint.kind)}"
            reader.fail(f"joint {shown(joint.name)}: type: {expected}", joint.line)
        if joint.kind in _LIMITED and element.find("limit") is None:
            reader.fail(f"joint {shown(joint.name)}: a {joint.kind} joint needs a <limit>", joint.line)


def _check_tree(reader: _LinkReader) -> None:
    above: dict[str, _Joint] = {}
    for joint in reader.joints.values():
        for end in ("parent", "child"):
            link = getattr(joint, end)
            if link not in reader.links:
                help_ = suggestion(link or "", reader.links)
                reader.fail(
                    f"joint {shown(joint.name)}: its {end} link {shown(link)} does not exist; {help_}",
                    joint.line,
                )
        child = str(joint.child)
        if child in above:
            reader.fail(
                f"the link {shown(child)} has two parent joints, {shown(above[child].name)} and "
                f"{shown(joint.name)}: cut the loop there and describe it as a closure in the sidecar",
                joint.line,
            )
        above[child] = joint
    roots = [link for link in reader.links if link not in above]
    if len(roots) > 1:
        reader.fail(
            f"expected one root link, got {', '.join(f'{root:.80}' for root in roots[:5])}",
            reader.links[roots[1]],
        )
    below: dict[str | None, list[str]] = {}
    for link, joint in above.items():
        below.setdefault(joint.parent, []).append(link)
    reached = list(roots)
    for link in reached:  # grows while it is walked
        reached += below.get(link, [])
    if pending := set(reader.links) - set(reached):
        link = min(pending)
        reader.fail(f"the joint {shown(above[link].name)} is part of a cycle of links", above[link].line)


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

_BALL = "drake:ball_constraint"
_LOOP_LIKE = re.compile(
    r"loop|coupling|constraint|closure|tendon|equality|bushing|drake:joint|drake:mimic", re.IGNORECASE
)
"""Names of elements that close loops or tie joints in some dialect of URDF."""
_TYING = re.compile(r"mimic|closed.?loop|loop.?clos|constraint", re.IGNORECASE)
"""Names of plug-ins of simulators, and of elements in them, that do so."""
_ELSEWHERE = ("link", "transmission", "ros2_control", "material", "sensor")
"""Elements of a robot whose contents are about something else."""


@dataclass
class Declared:
    """What a URDF says of loops, beside its tree."""

    closures: list[Closure] = field(default_factory=list)  # the loops
    couplings: list[Coupling] = field(default_factory=list)
    dependent: set[str] = field(default_factory=set)
    """Names of joints that the loops determine, by the file's own words."""
    rotors: list[JointData] = field(default_factory=list)
    """Rotors and gears in Drake's elements of `<transmission>`."""


def declared(
    robot: Xml.Element,
    model: pin.Model,
    source: str,
    mimic: bool,
    line_of: Callable[[Xml.Element], int],
    ignore_unknown: bool,
) -> Declared:
    """Return the loops that a URDF declares; their frames are added to its model."""
    reader = _LoopReader(robot, model, source)
    for element in robot.iterfind("loop"):
        reader.loop(element)
    for number, element in enumerate(_parts(robot, _BALL), 1):
        reader.ball(element, number)
    for element in robot.iterfind("coupling"):
        reader.coupling(element)
    if mimic:
        for joint in robot.iterfind("joint"):
            reader.mimic(joint)
    for element in robot.iterfind("transmission"):
        reader.rotor(element)
    reader.independent(ignore_unknown)
    if not ignore_unknown:
        for element, words in unknown(robot):
            raise ModelError(
                f"{source}, line {line_of(element)}: {words} looks like a loop, and is not understood "
                "(on_unknown='ignore' leaves it out)"
            )
    return reader.found


def unknown(robot: Xml.Element) -> Iterator[tuple[Xml.Element, str]]:
    """Yield elements that look like loops and are none of those that are read, with words for them."""
    for element in robot:
        if element.tag in {"loop", "coupling", _BALL} or element.tag in _ELSEWHERE:
            continue
        for inner in _without_plugins(element):
            joint = element.tag == "gazebo" and inner.tag == "joint" and _first(inner, "child") is not None
            if joint or _LOOP_LIKE.search(inner.tag):
                where = "" if inner is element else f" in <{element.tag}>"
                yield inner, f"<{inner.tag}>{where}"


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


def _without_plugins(element: Xml.Element) -> Iterator[Xml.Element]:
    """Yield an element and all in it but plug-ins, whose settings have their own names (``<loop_rate>``)."""
    yield element
    for inner in element:
        if inner.tag != "plugin":
            yield from _without_plugins(inner)


class _LoopReader:
    """Turns elements into closures and couplings."""

    def __init__(self, robot: Xml.Element, model: pin.Model, source: str) -> None:
        self._robot, self._model, self._source = robot, model, source
        self._above: dict[str, Xml.Element] = {}
        for joint in robot.iterfind("joint"):
            child = joint.find("child")
            if child is not None:
                self._above[child.get("link", "")] = joint
        self._links = [link.get("name", "") for link in robot.iterfind("link")]
        self._names = {frame.name for frame in model.frames}
        self.found = Declared()

    def fail(self, element: Xml.Element, message: str) -> NoReturn:
        name = element.get("name")
        called = f"<{element.tag}{f' name={shown(name)}' if name else ''}>"
        start = "" if message.startswith("<") else f"{called}: "
        raise ModelError(f"{self._source}: {start}{message}")

    def loop(self, element: Xml.Element) -> None:
        """Read ``<loop>`` of URDF+: a joint between two links that are both in the tree already."""
        name, kind = element.get("name", ""), element.get("type", "")
        if kind not in LOOP_KINDS:
            self.fail(element, f"type: expected one of {', '.join(LOOP_KINDS)}, got {shown(kind)}")
        axis = self._numbers(element.find("axis"), "xyz", 3, (1.0, 0.0, 0.0))
        if not np.linalg.norm(axis) > 0:
            self.fail(element, "axis: expected a direction, got zero")
        turn = pin.SE3(_with_z_along(axis), np.zeros(3))
        ends = []
        for end in ("predecessor", "successor"):
            part = self._part(element, end)
            ends.append(self._frame(f"{name}_{end}", self._link(part), self._origin(part) * turn))
        self.found.closures.append(Closure(ends[0], ends[1], LOOP_KINDS[kind]))

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
        if element is None:
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
        if name not in self._links:
            help_ = suggestion(name, self._links)
            self.fail(part, f"<{part.tag}>: the link {shown(name)} does not exist; {help_}")
        return name

    def _origin(self, part: Xml.Element) -> pin.SE3:
        origin = part.find("origin")
        xyz = self._numbers(origin, "xyz", 3, (0.0, 0.0, 0.0))
        rpy = self._numbers(origin, "rpy", 3, (0.0, 0.0, 0.0))
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)

    def _frame(self, name: str, link: str, placement: pin.SE3) -> str:
        while name in self._names:
            name += "_"
        self._names.add(name)
        on = self._model.getFrameId(link, pin.FrameType.BODY)
        if on >= self._model.nframes:
            raise ModelError(f"{self._source}: Pinocchio has left out the link {shown(link)} of a loop")
        add_frame(self._model, name, on, placement)
        return name

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


def _with_z_along(axis: FloatArray) -> FloatArray:
    """Return a rotation matrix whose z axis is along an axis; the identity where it is z already."""
    z = axis / np.linalg.norm(axis)
    if z[2] > 1 - 1e-15:
        return np.eye(3)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")
_AXES = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}


def with_types(model: pin.Model, joints: Sequence[tuple[str, str]], source: str) -> pin.Model:
    """Return a tree with other joints in the place of some."""
    replaced: dict[str, list[NewJoint]] = {}
    locked = []
    for index, (name, kind) in enumerate(joints):
        if name not in list(model.names)[1:]:
            help_ = suggestion(name, list(model.names)[1:])
            message = f"{source}: joint_name[{index}]: the joint {shown(name)} does not exist; {help_}"
            warn(f"{message} It is left out.", ModelWarning, stacklevel=4)
            continue
        universal = _UNIVERSAL.fullmatch(kind)
        if universal and universal[1] != universal[2]:
            replaced[name] = [NewJoint(f"{name}_{axis}", _AXES[axis]()) for axis in universal.groups()]
        elif kind == "SPHERICAL":
            replaced[name] = [NewJoint(name, pin.JointModelSpherical())]
        elif kind == "FIXED":
            locked.append(name)
        else:
            raise ModelError(
                f"{source}: joint_type[{index}]: expected SPHERICAL, FIXED or UJOINT_ with two different "
                f"axes such as UJOINT_XY, got {shown(kind)}"
            )
    if replaced:
        model = with_joints(model, replaced)
    if locked:
        ids = [model.getJointId(name) for name in locked]
        model = pin.buildReducedModel(model, ids, pin.neutral(model))
    return model


_TOGETHER = 1e-6  # how near two ends coincide, as a share of the robot's size

_SIDECAR_KEY = "closed_loop:"


def open_ends(path: str | None, robot: Xml.Element, model: pin.Model) -> str:
    """Say what in a URDF looks like a loop that is left open; the sign in words; empty if there is none.

    That is a sidecar beside the file (``robot.yaml`` beside ``robot.urdf``), or two ends of different
    branches that coincide in the neutral configuration: links at fixed joints, without shape and children.
    """
    for ending in (".yaml", ".yml") if path else ():
        beside = Path(str(path)).with_suffix(ending)
        with suppress(FileError):
            if _SIDECAR_KEY in read_text(beside):
                return f"{beside} beside it holds loop closures"
    pairs = _coinciding(model, _bare_ends(robot))
    if not pairs:
        return ""
    more = f" and {len(pairs) - 1} more such pairs" if len(pairs) > 1 else ""
    return f"its frames {pairs[0][0]} and {pairs[0][1]} coincide{more}"


def _bare_ends(robot: Xml.Element) -> list[str]:
    """Return the links without shape and children that hang at fixed joints."""
    parents = {tag.get("link") for tag in robot.iterfind("joint/parent")}
    fixed = {tag.get("link") for tag in robot.iterfind("joint[@type='fixed']/child")}
    return [
        name
        for link in robot.iterfind("link")
        if (name := link.get("name")) in fixed - parents
        and name
        and link.find("visual") is None
        and link.find("collision") is None
    ]


def _coinciding(model: pin.Model, names: list[str]) -> list[tuple[str, str]]:
    """Return pairs of frames on different branches that have the same place in the neutral configuration."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    place = {name: np.array(data.oMf[model.getFrameId(name)].translation) for name in names}
    joint = {name: model.frames[model.getFrameId(name)].parentJoint for name in names}
    size = max((float(np.abs(frame.translation).max()) for frame in data.oMf), default=0.0)
    return [
        (a, b)
        for a, b in combinations(names, 2)
        if np.abs(place[a] - place[b]).max() <= _TOGETHER * size
        and joint[a] not in model.supports[joint[b]]
        and joint[b] not in model.supports[joint[a]]
    ]


def read(
    source: str | os.PathLike[str],
    closures: SidecarLike = None,
    root_joint: pin.JointModel | None = None,
    mimic: bool = True,
    on_unknown: str = "raise",
    passive: bool = False,
) -> tuple[pin.Model, Sidecar]:
    """Return the tree of a URDF and its loops."""
    sidecar, is_tree = sidecar_of(closures), isinstance(closures, tuple) and not closures
    if root_joint is not None and not hasattr(root_joint, "nq"):
        raise InputError(f"root_joint: expected a pinocchio joint model, got {type(root_joint).__name__}")
    if on_unknown not in ("raise", "ignore"):
        raise InputError(f"on_unknown: expected 'raise' or 'ignore', got {shown(on_unknown)}")
    text, name = read_xml(source)
    model, robot, line_of = build_tree(text, name, root_joint)
    ignore = on_unknown == "ignore"
    found = declared(robot, model, name, mimic, line_of, ignore_unknown=ignore)
    given = () if sidecar is None else sidecar.couplings
    tied = {*found.dependent, *(coupling.joint for coupling in given)}
    free = {str(joint) for joint in model.names} - tied if mimic else set()
    for element, words in () if ignore else tying_plugins(robot, free):
        warnings.warn(f"{name}, line {line_of(element)}: {words}", ModelWarning, stacklevel=3)
    if sidecar is None:
        sign = "" if is_tree or found.closures else open_ends(None if is_text(source) else name, robot, model)
        if sign:
            warnings.warn(
                f"the URDF is read as an open tree, but {sign}: give them as closures, "
                "or closures=() if it is a tree",
                ModelWarning,
                stacklevel=3,
            )
        return model, _acting(model, _completed(Sidecar.serial(model), found), passive, found)
    if sidecar.joints:
        model = with_types(model, sidecar.joints, "sidecar")
    whole = replace(
        sidecar,
        closures=(*sidecar.closures, *found.closures),
        couplings=(*sidecar.couplings, *_new(found, sidecar)),
    )
    return model, _acting(model, whole, passive, found)


def _acting(model: pin.Model, sidecar: Sidecar, passive: bool, found: Declared) -> Sidecar:
    """Return a sidecar with what acts in the joints; rotors go to the tree. It goes before the file."""
    said = {entry.joint for entry in sidecar.joint_data}
    sidecar = replace(
        sidecar, joint_data=(*sidecar.joint_data, *(one for one in found.rotors if one.joint not in said))
    )
    said |= {entry.joint for entry in sidecar.joint_data}
    more = [entry for entry in losses_of(model) if entry.joint not in said] if passive else []
    return replace(sidecar, joint_data=(*with_armature(model, sidecar.joint_data), *more))


def _completed(serial: Sidecar, found: Declared) -> Sidecar:
    actuated = tuple(name for name in serial.actuated if name not in found.dependent)
    return Sidecar(tuple(found.closures), actuated, tuple(found.couplings))


def _new(found: Declared, sidecar: Sidecar) -> list:
    """Return the couplings of the file for joints that the sidecar does not couple itself."""
    coupled = {coupling.joint for coupling in sidecar.couplings}
    return [coupling for coupling in found.couplings if coupling.joint not in coupled]
