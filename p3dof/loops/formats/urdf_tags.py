"""Loops in a URDF: URDF+, Drake's ball constraints, ``<mimic>``; Drake's rotors; and what is unknown.

References
----------
M. Chignoli et al., URDF+: an enhanced URDF for robots with kinematic loops, 2024, arXiv:2411.19753.
Drake, parsing of URDF, ``drake:ball_constraint``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import NoReturn
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.joint_data import JointData
from p3dof.loops.joints import single_joint
from p3dof.loops.sidecar import Closure, Coupling, suggestion
from p3dof.loops.trees import add_frame

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
    """What a URDF says of loops, beside its tree.

    Parameters
    ----------
    closures, couplings : list
        The loops.
    dependent : set of str
        Names of joints that the loops determine, by the file's own words.
    rotors : list of JointData
        Rotors and gears in Drake's elements of ``<transmission>``.
    """

    closures: list[Closure] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    dependent: set[str] = field(default_factory=set)
    rotors: list[JointData] = field(default_factory=list)


def declared(
    robot: Xml.Element,
    model: pin.Model,
    source: str,
    mimic: bool,
    line_of: Callable[[Xml.Element], int],
    ignore_unknown: bool,
) -> Declared:
    """Return the loops that a URDF declares; their frames are added to its model.

    Parameters
    ----------
    robot : xml.etree.ElementTree.Element
        The file, a valid tree.
    model : pin.Model
        What Pinocchio reads of it; changes.
    source : str
        What to call the file in an error.
    mimic : bool
        Whether ``<mimic>`` couples joints.
    line_of : callable
        Returns the line of an element.
    ignore_unknown : bool
        Leave out what looks like a loop and is not understood.

    Returns
    -------
    Declared

    Raises
    ------
    ModelError
        If a loop is malformed, or something looks like one and is not understood; the message names it.
    """
    reader = _Reader(robot, model, source)
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
    """Yield plug-ins of simulators that tie joints which nothing else ties, with words for them.

    Parameters
    ----------
    robot : xml.etree.ElementTree.Element
        The file.
    free : collection of str
        Joints that move by themselves.

    Yields
    ------
    element : xml.etree.ElementTree.Element
        The plug-in.
    words : str
        What it does, and what to do about it.
    """
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


class _Reader:
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
                f"{self._source}: {len(said)} joints are dependent by its own words ({names}, ...), and no "
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
