"""Reading a tree URDF into Pinocchio, with the checks that urdfdom leaves out or only prints.

urdfdom drops an unreadable ``<inertial>`` and goes on with a massless link, and Pinocchio reads a cycle as an
empty model and a link with two parents as a missing body. Here each of these is one clear error. They are
given links and joints only: of all else, urdfdom would complain on the standard error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

import pinocchio as pin

from p3dof._base.checks import one_line, shown
from p3dof._base.errors import ModelError
from p3dof.loops.sidecar import suggestion
from p3dof.loops.xml_text import XmlReader

MAX_LINKS = 1000
"""Most links that are read: on a chain of a few thousand, Pinocchio's reader overflows the stack."""
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
    """Build the tree model of a URDF, of at most 1000 links and 200 degrees of freedom.

    Parameters
    ----------
    text : str
        The URDF.
    source : str
        What to call it in an error: usually the file name.
    root_joint : pin.JointModel, optional
        The joint between the world and the root link; by default the root link is fixed.

    Returns
    -------
    model : pin.Model
    robot : xml.etree.ElementTree.Element
        What the file says, for what Pinocchio does not read of it.
    line_of : callable
        Returns the line of an element of the file.

    Raises
    ------
    ModelError
        If the text is not well-formed XML, is not one tree of links, or is too large.
    """
    reader = _Reader(source)
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


class _Reader(XmlReader):
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


def _check_parts(reader: _Reader, robot: Xml.Element) -> None:
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


def _check_tree(reader: _Reader) -> None:
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
