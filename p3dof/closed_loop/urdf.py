"""Reading a tree URDF into Pinocchio, with the checks that urdfdom leaves out or only prints.

urdfdom drops an unreadable ``<inertial>`` and goes on with a massless link, and Pinocchio reads a cycle as an
empty model and a link with two parents as a missing body. Here each of these is one clear error.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

import pinocchio as pin

from p3dof.checks import one_line, shown
from p3dof.closed_loop.sidecar import suggestion
from p3dof.errors import FileError, ModelError
from p3dof.files import MAX_BYTES, read_text

MAX_LINKS = 1000
"""Most links that are read: on a chain of a few thousand, Pinocchio's reader overflows the stack."""
MAX_FREEDOMS = 200
"""Most degrees of freedom: Pinocchio's workspaces take the cube of their number, 256 MB each at this one."""
MAX_DEPTH = 100
"""Deepest nesting of XML elements that is read; a URDF needs six."""
MAX_ATTRIBUTES = 100
"""Most attributes of an element: urdfdom takes a time that grows with the square of their number."""

_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
}
"""Attributes that must be finite numbers, and how many; all of `mass` and `inertia` are required."""


def read_urdf(source: str | os.PathLike[str]) -> tuple[str, str]:
    """Return the XML text of a URDF and what to call it in an error.

    Parameters
    ----------
    source : str or path-like
        XML text (it starts with ``<``) or the path of a file.

    Returns
    -------
    text : str
    name : str
        The path, or ``"URDF text"``.

    Raises
    ------
    ModelError
        If the file cannot be read, the text is longer than 20 MB, or `source` is neither text nor a path.
    """
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        if len(source) > MAX_BYTES:
            raise ModelError(f"URDF text: expected at most {MAX_BYTES} characters, got {len(source)}")
        return source.lstrip("\ufeff"), "URDF text"
    if not isinstance(source, str | os.PathLike) or not os.fspath(source):
        raise ModelError(f"URDF: expected XML text or the path of a file, got {shown(source)}")
    try:
        return read_text(source), os.fspath(source)
    except (FileError, ValueError) as error:
        raise ModelError(str(error)) from error


def build_tree(source: str | os.PathLike[str], root_joint: pin.JointModel | None = None) -> pin.Model:
    """Build the tree model of a URDF, of at most 1000 links and 200 degrees of freedom.

    Parameters
    ----------
    source : str or path-like
        XML text or the path of a file.
    root_joint : pin.JointModel, optional
        The joint between the world and the root link; by default the root link is fixed.

    Returns
    -------
    pin.Model

    Raises
    ------
    ModelError
        If the file cannot be read, is not well-formed XML, is not one tree of links, or is too large.
    """
    text, name = read_urdf(source)
    _check(text, name)
    arguments = (text,) if root_joint is None else (text, root_joint)
    try:
        model = pin.buildModelFromXML(*arguments)
    except Exception as error:  # Boost.Python raises its own types
        message = one_line(str(error)) or type(error).__name__
        raise ModelError(f"{name}: Pinocchio cannot read it: {message}") from error
    if model.nv > MAX_FREEDOMS:
        raise ModelError(f"{name}: expected at most {MAX_FREEDOMS} degrees of freedom, got {model.nv}")
    return model


@dataclass
class _Joint:
    name: str
    line: int
    kind: str
    parent: str | None = None
    child: str | None = None


@dataclass
class _Reader:
    """Collects links and joints from the events of an expat parser."""

    source: str
    parser: expat.XMLParserType
    links: dict[str, int] = field(default_factory=dict)
    joints: dict[str, _Joint] = field(default_factory=dict)
    path: list[str] = field(default_factory=list)
    joint: _Joint | None = None

    def fail(self, message: str, line: int | None = None) -> NoReturn:
        raise ModelError(f"{self.source}, line {line or self.parser.CurrentLineNumber}: {one_line(message)}")

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.path.append(tag)
        if len(self.path) > MAX_DEPTH:
            self.fail(f"expected elements nested at most {MAX_DEPTH} deep")
        if len(attributes) > MAX_ATTRIBUTES:
            self.fail(f"expected at most {MAX_ATTRIBUTES} attributes, <{tag:.80}> has {len(attributes)}")
        if len(self.path) == 1 and tag != "robot":
            self.fail(f"expected the element <robot>, got <{tag}>")
        if self.path[1:] == ["link"]:
            self._new(tag, attributes, self.links)
            self.links[attributes["name"]] = self.parser.CurrentLineNumber
        elif self.path[1:] == ["joint"]:
            self._new(tag, attributes, self.joints)
            name = attributes["name"]
            self.joint = _Joint(name, self.parser.CurrentLineNumber, attributes.get("type", ""))
            self.joints[name] = self.joint
        elif self.joint is not None and self.path[1:-1] == ["joint"] and tag in ("parent", "child"):
            setattr(self.joint, tag, attributes.get("link"))
        if len(self.path) > 2 and self.path[1] in ("link", "joint"):
            self._numbers(tag, attributes)

    def end(self, _tag: str) -> None:
        self.path.pop()

    def _new(self, tag: str, attributes: dict[str, str], known: Collection[str]) -> None:
        name = attributes.get("name", "")
        if not name:
            self.fail(f"<{tag}> has no name")
        if name in known:
            self.fail(f"the {tag} {shown(name)} is defined twice")
        if len(known) == MAX_LINKS:
            self.fail(f"expected at most {MAX_LINKS} {tag}s")

    def _numbers(self, tag: str, attributes: dict[str, str]) -> None:
        required = tag in ("mass", "inertia") and self.path[-2] == "inertial"
        for name, count in _NUMBERS.get(tag, {}).items():
            if name not in attributes and not required:
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
            if tag == "axis" and not any(values):
                self.fail("<axis> xyz: expected a direction, got zero")


def _number(word: str) -> float:
    try:
        return float(word) if word.isascii() and "_" not in word else math.nan  # as urdfdom does
    except ValueError:
        return math.nan


def _check(text: str, source: str) -> None:
    """Raise ModelError unless the text is well-formed XML that describes one tree of links."""
    parser = expat.ParserCreate("utf-8")
    reader = _Reader(source, parser)
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    # A URDF has no use for entities; refusing the document type stops expansion attacks.
    parser.StartDoctypeDeclHandler = lambda *_: reader.fail("a document type declaration is not allowed")
    try:
        parser.Parse(text.encode("utf-8"), True)
    except expat.ExpatError as error:
        raise ModelError(f"{source}, line {error.lineno}: not well-formed XML: {error}") from error
    except UnicodeEncodeError as error:
        raise ModelError(f"{source}: not Unicode text: {error}") from error
    if not reader.links:
        raise ModelError(f"{source}: the robot has no links")
    _check_tree(reader)


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
