"""The links and joints of a robot in SDF: inertias, axes, limits, springs; and which joints make a tree."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import LARGEST, FloatArray, shown
from p3dof.loops.formats.sdf_file import (
    DRAKES,
    MOMENTS,
    POSE_FRAMES,
    Item,
    SdfRobot,
    SdfText,
    first,
    relative_to,
)
from p3dof.loops.formats.urdf import SHORT
from p3dof.loops.xml_text import number_of

_JOINT_AXES = (1, 5)  # the first version whose axes are in the axes of the joint
_UNIT = 1e-15  # how far the length of a direction may be from 1
_ROUNDING = 1e-9  # of the largest moment of inertia, how far below zero the least may be by rounding
_UNLIMITED = 1e16  # what SDF writes for infinity


def inertia_of(link: Item) -> pin.Inertia:
    """Return the inertia of a link, in its axes; without one it has 1 kg and 1 kg m², as SDF says."""
    file, element = link.file, link.element.find("inertial")
    if element is None:
        return pin.Inertia(1.0, np.zeros(3), np.eye(3))
    if file.flag(element, element.get("auto", "false")):
        file.bad(element, "auto: the inertia of shapes is not computed; give mass and inertia")
    mass = file.number(element, "mass", 1.0)
    if mass < 0:
        file.bad(element, f"expected no negative mass, got {mass:g}")
    moments = element.find("inertia")
    xx, xy, xz, yy, yz, zz = (file.number(moments, tag, float(tag[1] == tag[2])) for tag in MOMENTS)
    pose = element.find("pose")
    if pose is not None and relative_to(file, pose):
        file.bad(pose, "relative_to: the pose of an <inertial> is relative to its link")
    place = file.placement(pose)
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least, *_, largest = np.linalg.eigvalsh(matrix)
    if least < -_ROUNDING * largest:
        file.bad(element, f"expected no negative moment of inertia, got {least:g}")
    own = pin.Inertia.Zero()
    own.mass, own.inertia = mass, matrix
    return place.act(own)


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a joint."""

    direction: FloatArray  # (3,): in the axes of the joint, of length 1
    limits: tuple[float, float]  # of the position [m or rad]
    velocity: float  # most [m/s or rad/s]
    effort: float  # most [N or N m]
    damping: float
    friction: float
    stiffness: float
    rest: float
    mimic: tuple[str, str, float, float] | None
    """Which joint it follows, which axis of that, its offset and its factor."""


def axis_of(robot: SdfRobot, joint: Item, place: pin.SE3, tag: str = "axis") -> Axis:
    """Return an axis of a joint that has a place in the world."""
    file, element = joint.file, joint.element.find(tag)
    if element is None:
        file.bad(joint.element, f"expected the element <{tag}>")
    direction = _direction(robot, joint, place, element)
    limit, acts = element.find("limit"), element.find("dynamics")
    lower, upper, effort, velocity = (
        file.number(limit, name, default, infinite=True)
        for name, default in (("lower", -np.inf), ("upper", np.inf), ("effort", np.inf), ("velocity", np.inf))
    )
    lower, upper = (
        value if abs(value) < _UNLIMITED else math.copysign(np.inf, value) for value in (lower, upper)
    )
    if lower > upper:
        file.bad(element, f"limit: expected lower <= upper, got {lower:g} and {upper:g}")
    effort, velocity = (value if 0 <= value < _UNLIMITED else np.inf for value in (effort, velocity))
    damping, friction, stiffness, rest = (
        file.number(acts, name, 0.0)
        for name in ("damping", "friction", "spring_stiffness", "spring_reference")
    )
    if damping < 0 or friction < 0:
        file.bad(element, "dynamics: expected no negative damping or friction")
    mimic = _mimic(file, joint.element, element if tag == "axis" else None, element)
    return Axis(direction, (lower, upper), velocity, effort, damping, friction, stiffness, rest, mimic)


def _direction(robot: SdfRobot, joint: Item, place: pin.SE3, axis: Xml.Element) -> FloatArray:
    """Return the direction of an axis in the axes of its joint."""
    file, xyz = joint.file, axis.find("xyz")
    given = np.array([0.0, 0.0, 1.0]) if xyz is None else file.numbers(xyz, 3)
    length = math.hypot(*given)
    if not SHORT <= length <= 1 / SHORT:
        file.bad(axis, "xyz: expected a direction, got one that is zero or too long")
    if abs(length - 1) > _UNIT:
        given = given / length
    if file.version >= POSE_FRAMES and axis.find("use_parent_model_frame") is not None:
        file.bad(axis, "use_parent_model_frame: since version 1.7 it is <xyz expressed_in>")
    in_model = file.is_set(axis, "use_parent_model_frame", file.version < _JOINT_AXES)
    frame = (None if xyz is None else xyz.get("expressed_in")) or (joint.scope.own if in_model else "")
    if not frame:
        return given
    turn = robot.place(joint.scope, frame, (file, axis)).rotation
    return np.asarray(place.rotation.T @ turn @ given)


def _mimic(
    file: SdfText, joint: Xml.Element, first_axis: Xml.Element | None, axis: Xml.Element
) -> tuple[str, str, float, float] | None:
    """Return which joint and axis an axis follows, with the offset and the factor."""
    own = axis.find("mimic")
    drakes = None if first_axis is None else first(joint, "drake:mimic")
    if own is not None:
        factor, offset = file.number(own, "multiplier", 1.0), file.number(own, "offset", 0.0)
        start = file.number(own, "reference", 0.0)
        return own.get("joint", ""), own.get("axis", "axis"), offset - factor * start, factor
    if drakes is None:
        return None
    values = []
    for name, default in (("multiplier", "1"), ("offset", "0")):
        value = number_of(drakes.get(name, default).strip())
        if not abs(value) < LARGEST:
            file.bad(drakes, f"{name}: expected a finite number, got {shown(drakes.get(name))}")
        values.append(value)
    return drakes.get("joint", ""), "axis", values[1], values[0]


KINDS = {
    "fixed": (),
    "revolute": ("hinge",),
    "continuous": ("hinge",),
    "prismatic": ("slide",),
    "screw": ("slide", "hinge"),
    "ball": ("ball",),
    "universal": ("hinge", "hinge"),
    "revolute2": ("hinge", "hinge"),
    "gearbox": (),
}
"""Types of joint, and the steps in which what they join moves; a gearbox joins nothing."""
CLOSURES = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
    "ball": "3d",
    "fixed": "6d",
    "universal": "universal",
}
"""Types of joint, and the closures that they are."""
_MOTORS = ("revolute", "continuous", "prismatic", "screw")
_PERPENDICULAR = 1e-9  # cosine of the angle between the axes of a universal joint that is a closure
_PLAIN = 2  # the rank of a joint that is a closure by itself
_TWO = ("universal", "revolute2", "gearbox")


@dataclass(frozen=True, eq=False)
class Step:
    """A hinge, a slide or a ball."""

    name: str  # the name of the joint in the tree
    kind: str
    direction: FloatArray  # (3,): its axis, in the axes of the joint; of a ball nothing
    axis: Axis | None = None  # what the file says of it


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file."""

    item: Item
    kind: str
    parent: Item | None  # the links; None for the world
    child: Item
    place: pin.SE3  # in the axes of the world, at zero
    steps: tuple[Step, ...]  # from the parent to the child
    axes: tuple[Axis, ...]
    pitch: float = 0.0  # of a screw [m/rad]
    rotor: tuple[float, float] | None = None  # inertia of a rotor [kg m²] and its gear ratio

    @property
    def name(self) -> str:
        """Its full name."""
        return self.item.full

    @property
    def names(self) -> set[str]:
        """Its names in the file and in the tree."""
        return {self.name, *(step.name for step in self.steps)}

    def back(self) -> tuple[Step, ...]:
        """Return the steps from the child to the parent, in which the joint has the same value."""
        return tuple(replace(step, direction=-step.direction) for step in reversed(self.steps))


def joints_of(robot: SdfRobot) -> Iterator[Joint]:
    """Yield the joints of a robot that can move, and those that are fixed."""
    for item in robot.joints:
        if not item.scope.static:
            yield _joint(robot, item)


def _joint(robot: SdfRobot, item: Item) -> Joint:
    file, element = item.file, item.element
    at, kind = (file, element), element.get("type", "")
    if kind not in KINDS:
        file.bad(element, f"type: expected one of {', '.join(KINDS)}, got {shown(kind)}")
    name = file.word(element, "parent")
    parent = None if name == "world" else robot.link(item.scope, name, at)
    child = robot.link(item.scope, file.word(element, "child"), at)
    if child is None:
        file.bad(element, "child: expected a link, not the world")
    if parent is child:
        file.bad(element, f"it joins the link {shown(child.full)} with itself")
    place = robot.place_of(item)
    tags = ("axis", "axis2")[: 2 if kind in _TWO else int(kind not in ("fixed", "ball"))]
    axes = tuple(axis_of(robot, item, place, tag) for tag in tags)
    if kind == "continuous":
        axes = tuple(replace(axis, limits=(-np.inf, np.inf)) for axis in axes)
    for tag in DRAKES:
        if kind not in _MOTORS and first(element, tag) is not None:
            file.bad(element, f"<{tag}>: expected a joint of one freedom, this one is {kind}")
    pitch = _pitch(file, element) if kind == "screw" else 0.0
    return Joint(
        item, kind, parent, child, place, _steps(item.full, kind, axes), axes, pitch, _rotor(file, element)
    )


def _steps(name: str, kind: str, axes: tuple[Axis, ...]) -> tuple[Step, ...]:
    """Return the steps of a joint; those of a screw are a slide without mass and a hinge."""
    if kind == "ball":
        return (Step(name, "ball", np.zeros(3)),)
    if kind == "screw":
        (axis,) = axes
        return Step(f"{name}_slide", "slide", axis.direction), Step(name, "hinge", axis.direction, axis)
    kinds = KINDS[kind]
    names = [name] if len(kinds) == 1 else [f"{name}_{number}" for number in range(1, len(kinds) + 1)]
    return tuple(
        Step(one, what, axis.direction, axis)
        for one, what, axis in zip(names, kinds, axes, strict=kind != "gearbox")
    )


def _pitch(file: SdfText, joint: Xml.Element) -> float:
    """Return how far a screw goes per turn [m/rad]; ``thread_pitch`` is in rad/m, of a left-handed thread."""
    if first(joint, "screw_thread_pitch") is not None:
        return file.number(joint, "screw_thread_pitch", 1.0) / (2 * math.pi)
    if first(joint, "thread_pitch") is None:
        file.bad(joint, "expected the element <screw_thread_pitch>, in metres per turn, or <thread_pitch>")
    turns = file.number(joint, "thread_pitch", 1.0)
    if abs(turns) < SHORT:
        file.bad(joint, f"thread_pitch: expected a number other than zero, got {turns:g}")
    return -1.0 / turns


def _rotor(file: SdfText, joint: Xml.Element) -> tuple[float, float] | None:
    """Return Drake's rotor inertia and gear ratio of a joint; None if neither is there."""
    if first(joint, "drake:rotor_inertia") is None and first(joint, "drake:gear_ratio") is None:
        return None
    inertia, ratio = (
        file.number(joint, "drake:rotor_inertia", 0.0),
        file.number(joint, "drake:gear_ratio", 1.0),
    )
    if inertia < 0 or not ratio:
        file.bad(joint, "expected no negative rotor inertia and a gear ratio other than zero")
    return inertia, ratio


def reference_body(robot: SdfRobot, gear: Joint) -> Item | None:
    """Return the link from which the angles of a gearbox count; None for the world."""
    file, element = gear.item.file, gear.item.element
    name = file.word(element, "gearbox_reference_body")
    return None if name == "world" else robot.link(gear.item.scope, name, (file, element))


class _Sets:
    """Sets of links that are joined; those of static models are joined to the world."""

    def __init__(self, robot: SdfRobot) -> None:
        self._above: dict[Item | None, Item | None] = {
            link: None for link in robot.links if link.scope.static
        }

    def of(self, link: Item | None) -> Item | None:
        """Return the link that stands for a set."""
        trail = []
        while link in self._above:
            trail.append(link)
            link = self._above[link]
        self._above.update(dict.fromkeys(trail, link))
        return link

    def join(self, joint: Joint) -> bool:
        """Join the sets of the links of a joint; whether they were two."""
        one, other = self.of(joint.parent), self.of(joint.child)
        if one is other:
            return False
        if other is None:
            one, other = other, one
        self._above[other] = one
        return True


class Graph:
    """The joints between links, and which of them are in the tree."""

    def __init__(self, robot: SdfRobot, joints: list[Joint], keep: Collection[str], looped: bool) -> None:
        self._robot = robot
        self.edges = [joint for joint in joints if joint.kind != "gearbox"]
        sets = _Sets(robot)
        closing = [joint for joint in self.edges if not sets.join(joint)]
        efforts = [axis.effort for joint in self.edges for axis in joint.axes]
        self._driven = robot.driven()
        self._by_effort = 0.0 in efforts or not (closing or looped)
        self.motors_known = self._by_effort or not {joint.name for joint in self.edges}.isdisjoint(
            self._driven
        )
        """Whether the file says which joints have motors."""
        self._leaders = {
            axis.mimic[0].rpartition("::")[2] for one in joints for axis in one.axes if axis.mimic
        }
        self._geared = {
            frozenset((body, link))
            for gear in joints
            if gear.kind == "gearbox"
            for body in (reference_body(robot, gear),)
            for link in (gear.parent, gear.child)
        }
        ranks = {joint: self._rank(joint, keep) for joint in self.edges}
        self.kept, self.cut = self._chosen(ranks)
        self.doubled = {joint for joint in self.cut if ranks[joint] < _PLAIN}
        """Joints that are cut, but lead to a second body, as they act."""
        self._ends: dict[Item | None, list[Joint]] = {}
        for joint in self.kept:
            for link in (joint.parent, joint.child):
                self._ends.setdefault(link, []).append(joint)

    def at(self, link: Item | None) -> list[Joint]:
        """Return the joints of a link that are in the tree."""
        return self._ends.get(link, [])

    def is_motor(self, joint: Joint) -> bool:
        """Whether a joint has a motor, by the file's own words."""
        moved = joint.kind in _MOTORS and joint.axes[0].effort != 0
        return moved and (self._by_effort or joint.name in self._driven)

    def motors(self) -> list[str]:
        """Return the joints that have motors: in the order of plug-ins, then in that of the file."""
        found = [joint.name for joint in self.edges if self.is_motor(joint)]
        return sorted(
            found, key=lambda name: self._driven.index(name) if name in self._driven else len(found)
        )

    def roots(self, held: Collection[Item | None]) -> list[Item]:
        """Return a link of each tree that is not held in the world: one that is no child, if there is one."""
        robot, sets = self._robot, _Sets(self._robot)
        first = robot.link(robot.world, robot.model.name, (robot.model.file, robot.model.element))
        below = {joint.child for joint in self.kept}
        for joint in self.kept:
            sets.join(joint)
        found: dict[Item | None, Item] = {}
        for link in sorted(robot.links, key=lambda link: (link in below, link is not first)):
            if link not in held:
                found.setdefault(sets.of(link), link)
        return list(found.values())

    def _chosen(self, ranks: dict[Joint, int]) -> tuple[list[Joint], list[Joint]]:
        """Return which joints are in the tree, and which are cut, in the order of the file."""
        sets, rigid = _Sets(self._robot), _Sets(self._robot)
        kept = set()
        for joint in sorted(self.edges, key=ranks.__getitem__):
            if sets.join(joint):
                kept.add(joint)
                if joint.kind == "fixed":
                    rigid.join(joint)
        cut = []
        for joint in self.edges:
            if joint in kept:
                continue
            if rigid.of(joint.parent) is not rigid.of(joint.child):
                cut.append(joint)
            elif joint.kind != "fixed":  # which would be there twice
                joint.item.file.bad(joint.item.element, "it joins two links that are fixed to each other")
        return [joint for joint in self.edges if joint in kept], cut

    def _rank(self, joint: Joint, keep: Collection[str]) -> int:
        """Return 0 for a joint that acts, 1 for one with limits, 2 for a plain one."""
        used = joint.names & set(keep) or joint.item.name in self._leaders
        geared = frozenset((joint.parent, joint.child)) in self._geared
        if self.is_motor(joint) or used or geared or joint.rotor or joint.kind not in CLOSURES:
            return 0
        if any(axis.stiffness or axis.damping or axis.friction or axis.mimic for axis in joint.axes):
            return 0
        if any(np.isfinite(axis.limits).any() for axis in joint.axes):
            return 1
        if joint.kind == "universal":
            one, two = (axis.direction for axis in joint.axes)
            return _PLAIN if abs(float(one @ two)) <= _PERPENDICULAR else 1
        return _PLAIN
