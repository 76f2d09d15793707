"""URDF: the tree by Pinocchio, its loops from the file (`urdf_loops`) or a sidecar; the states of its SRDF.

What is unknown is named (`urdf_loops`).

urdfdom drops an unreadable ``<inertial>`` and goes on with a massless link, and Pinocchio reads a cycle as an
empty model and a link with two parents as a missing body. Here each of these is one clear error. They are
given links and joints only: of all else, urdfdom would complain on the standard error.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import warnings
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any
from warnings import warn
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import one_line, shown
from p3dof._base.errors import FileError, InputError, ModelError, ModelWarning
from p3dof._base.files import read_text
from p3dof.loops.coordinates import losses_of, with_armature
from p3dof.loops.formats.urdf_loops import Declared, closing_pairs, declared, tying_parameters, tying_plugins
from p3dof.loops.sidecar import Sidecar, SidecarLike, names_beside, sidecar_of, suggestion
from p3dof.loops.trees import NewJoint, with_joints
from p3dof.loops.xml_text import XmlReader, is_text, number_of, read_xml

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
_FREE = "root_joint"  # joint of a root that is free, as Pinocchio calls it
_LONG = 2000  # longest list in a message [characters]
SHORT = 1e-9
"""Length of an axis below which its direction is rounding, if it has one; one may be as much too long."""


def build_tree(
    text: str, source: str, root_joint: pin.JointModel | None = None
) -> tuple[pin.Model, Xml.Element, Callable[[Xml.Element], int]]:
    """Build the tree model of a URDF, of at most 1000 links and 200 degrees of freedom."""
    reader = _LinkReader(source)
    robot = reader.parse(text)
    reader.imply_world(robot)
    if not reader.links:
        raise ModelError(f"{source}: the robot has no links")
    _check_parts(reader, robot)
    if isinstance(root_joint, pin.JointModelFreeFlyer) and reader.free_root(robot):
        root_joint = None
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

    text_of = None  # elements of simulators have names and numbers in theirs

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
                f"<{tag:.80}> is a macro: name the file robot.urdf.xacro, or expand it first, such as with "
                "`xacro FILE > robot.urdf`"
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

    def imply_world(self, robot: Xml.Element) -> None:
        """Add the link ``world`` that a joint hangs on and nobody declares, as Drake does."""
        hung = next((joint for joint in self.joints.values() if joint.parent == "world"), None)
        if hung is not None and "world" not in self.links:
            self.links["world"] = hung.line
            Xml.SubElement(robot, "link", name="world")

    @property
    def roots(self) -> list[str]:
        """Links that no joint moves."""
        moved = {joint.child for joint in self.joints.values()}
        return [link for link in self.links if link not in moved]

    def free_root(self, robot: Xml.Element) -> bool:
        """Join the one root beside ``world`` to it by a free joint, as in Drake; whether there is one."""
        roots = self.roots
        if len(roots) != 2 or "world" not in roots or _FREE in self.joints:
            return False
        root = roots[roots[0] == "world"]
        element = Xml.SubElement(robot, "joint", name=_FREE, type="floating")
        Xml.SubElement(element, "parent", link="world")
        Xml.SubElement(element, "child", link=root)
        self.joints[_FREE] = _Joint(_FREE, self.links[root], "floating", "world", root)
        return True

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
            values = [number_of(word) for word in text.split()]
            # urdfdom drops the whole <inertial> when white space follows a single number
            trailing = count == 1 and text != text.rstrip()
            if trailing or len(values) != count or not all(map(math.isfinite, values)):
                wanted = "a finite number" if count == 1 else f"{count} finite numbers"
                self.fail(f"<{tag}> {name}: expected {wanted}, got {shown(attributes.get(name))}")
            if tag == "mass" and values[0] < 0:
                self.fail(f"<mass> value: expected no negative mass, got {values[0]:g}")
            if name in ("effort", "velocity") and values[0] < 0:
                self.fail(f"<{tag}> {name}: expected no negative number, got {values[0]:g}")
            if tag == "axis" and self._turns() and not SHORT <= math.hypot(*values) <= 1 / SHORT:
                length = (
                    "one that is too long" if math.hypot(*values) > 1 else "nearly " * any(values) + "zero"
                )
                self.fail(f"<axis> xyz: expected a direction, got {length}")

    def _turns(self) -> bool:
        """Whether the joint needs an axis: CAD exporters give fixed ones a zero axis."""
        return self._joint is None or self._joint.kind not in ("fixed", "floating")


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
        limit = element.find("limit")
        if joint.kind in _LIMITED and limit is None:
            reader.fail(f"joint {shown(joint.name)}: a {joint.kind} joint needs a <limit>", joint.line)
        lower, upper = (0.0 if limit is None else float(limit.get(end, 0)) for end in ("lower", "upper"))
        if joint.kind in _LIMITED and lower > upper:
            expected = f"expected lower <= upper, got {lower:g} and {upper:g}"
            reader.fail(f"joint {shown(joint.name)}: <limit>: {expected}", joint.line)


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
    roots = reader.roots
    if len(roots) > 1:
        names = one_line(", ".join(f"{root:.80}" for root in roots), _LONG)
        beside = len(roots) == 2 and "world" in roots
        help_ = "; root_joint=pin.JointModelFreeFlyer() (--floating) frees the other" if beside else ""
        line = reader.links[roots[1]]
        raise ModelError(f"{reader.source}, line {line}: expected one root link, got {names}{help_}")
    below: dict[str | None, list[str]] = {}
    for link, joint in above.items():
        below.setdefault(joint.parent, []).append(link)
    reached = list(roots)
    for link in reached:  # grows while it is walked
        reached += below.get(link, [])
    if pending := set(reader.links) - set(reached):
        link = min(pending)
        reader.fail(f"the joint {shown(above[link].name)} is part of a cycle of links", above[link].line)


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
_OF_LOOPS = re.compile(r"closed[_-]?loop|loop[_-]?clos|closing[_-]|cut[_-]?joint", re.IGNORECASE)
"""What says in a name that a loop is closed there."""
_OF_LINKAGES = re.compile(
    r"loops?|closures?|coupler|crank|rocker|(push|con)?rods?|(four|five)bar|linkage|pantograph", re.IGNORECASE
)
"""Words in names of a robot's parts that speak of linkages, which are open if two branches have bare ends."""


def open_ends(path: str | None, robot: Xml.Element, model: pin.Model) -> str:
    """Say what in a URDF looks like a loop that is left open; the sign in words; empty if there is none.

    That is a sidecar beside the file (``robot.yaml`` beside ``robot.urdf``); two bare ends of different
    branches, which are links at fixed joints without shape and children, that coincide in the neutral
    configuration; or names, or a body that floats beside other branches, and two such ends anywhere.
    """
    looked = [] if path is None else names_beside(path)
    for beside in looked:
        with suppress(FileError):
            if _SIDECAR_KEY in read_text(beside):
                return f"{beside} beside it holds loop closures"
    together, apart = _pairs(model, _bare_ends(robot))
    names = [one.get("name", "") for one in robot if one.tag in _PARTS]
    if together:
        more = f" and {len(together) - 1} more such pairs" if len(together) > 1 else ""
        sign = f"its frames {together[0][0]} and {together[0][1]} coincide{more}"
    elif said := [name for name in names if _OF_LOOPS.search(name)][:2]:
        sign = f"it has names such as {' and '.join(map(shown, said))}"
    elif apart and (said := [name for name in names if _speaks(name)] or _floating(robot)):
        sign = f"with {' and '.join(map(shown, said[:2]))} its frames {' and '.join(apart[0])} carry nothing"
    else:
        return ""
    places = f" or beside it (looked for {', '.join(one.name for one in looked)})" if looked else ""
    return f"{sign}, and no closures were found in it{places}"


def _speaks(name: str) -> bool:
    return any(_OF_LINKAGES.fullmatch(word) for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name))


def _floating(robot: Xml.Element) -> list[str]:
    return [joint.get("name", "") for joint in robot.iterfind("joint[@type='floating']")]


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


def _pairs(model: pin.Model, names: list[str]) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return pairs of frames on different branches: with one place at neutral, and others."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    place = {
        name: np.array(data.oMf[model.getFrameId(name, pin.FrameType.BODY)].translation) for name in names
    }
    joint = {name: model.frames[model.getFrameId(name, pin.FrameType.BODY)].parentJoint for name in names}
    size = max((float(np.abs(frame.translation).max()) for frame in data.oMf), default=0.0)
    found: tuple[list[tuple[str, str]], list[tuple[str, str]]] = [], []
    for a, b in combinations(names, 2):
        if joint[a] not in model.supports[joint[b]] and joint[b] not in model.supports[joint[a]]:
            found[bool(np.abs(place[a] - place[b]).max() > _TOGETHER * size)].append((a, b))
    return found


def check_options(root_joint: object, on_unknown: object) -> None:
    """Refuse options of a reader that are none."""
    if root_joint is not None and not hasattr(root_joint, "nq"):
        raise InputError(f"root_joint: expected a pinocchio joint model, got {type(root_joint).__name__}")
    if on_unknown not in ("raise", "ignore"):
        raise InputError(f"on_unknown: expected 'raise' or 'ignore', got {shown(on_unknown)}")


def read(
    source: str | os.PathLike[str],
    closures: SidecarLike = None,
    root_joint: pin.JointModel | None = None,
    mimic: bool = True,
    on_unknown: str = "raise",
    passive: bool = False,
    bushings: str | None = None,
) -> tuple[pin.Model, Sidecar]:
    """Return the tree of a URDF and its loops."""
    sidecar, is_tree = sidecar_of(closures), isinstance(closures, tuple) and not closures
    check_options(root_joint, on_unknown)
    if bushings not in (None, "closures"):
        raise InputError(f"bushings: expected 'closures' or None, got {shown(bushings)}")
    text, name = read_xml(source)
    model, robot, line_of = build_tree(text, name, root_joint)
    ignore = on_unknown == "ignore"
    found = declared(robot, model, name, mimic, line_of, ignore, bushings)
    if sidecar is None and not is_tree:
        found.closures += closing_pairs(robot, model)
    given = () if sidecar is None else sidecar.couplings
    tied = {*found.dependent, *(coupling.joint for coupling in given)}
    free = {str(joint) for joint in model.names} - tied if mimic else set()
    told = [] if ignore else [*tying_plugins(robot, free), *tying_parameters(robot, free)]
    lines = [f"{name}, line {line_of(element)}: {words}" for element, words in told]
    if found.unknown:
        lines.append(f"{name}: not understood, and left out: {one_line(found.unknown, _LONG)}")
    if sidecar is None and not is_tree:
        lines += _of_a_tree(None if is_text(source) else os.fspath(source), name, robot, model, found)
    for line in lines:
        warnings.warn(line, ModelWarning, stacklevel=3)
    if sidecar is None:
        return model, _acting(model, _completed(model, found), passive, found)
    if sidecar.joints:
        model = with_types(model, sidecar.joints, "sidecar")
    told_again = {bushing.frames for bushing in sidecar.bushings}
    whole = replace(
        sidecar,
        closures=(*sidecar.closures, *found.closures),
        couplings=(*sidecar.couplings, *_new(found, sidecar)),
        bushings=(*sidecar.bushings, *(one for one in found.bushings if one.frames not in told_again)),
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


def _completed(model: pin.Model, found: Declared) -> Sidecar:
    free = _free(model, found)
    actuated = [name for name in free if name in _driven(model, found)] or free
    parts = tuple(found.closures), tuple(actuated), tuple(found.couplings)
    return Sidecar(*parts, bushings=tuple(found.bushings))


def _free(model: pin.Model, found: Declared) -> list[str]:
    """Return the joints of one freedom that no loop of the file determines."""
    return [name for name in Sidecar.serial(model).actuated if name not in found.dependent]


def _driven(model: pin.Model, found: Declared) -> set[str]:
    """Return the joints that have motors by the file's own words.

    Of open trees lists of transmissions are often not complete; there a limit of effort says it, too.
    """
    if not found.motors or found.closures:
        return found.motors
    effort = np.asarray(model.upperEffortLimit)
    limits = {name: effort[model.idx_vs[model.getJointId(name)]] for name in _free(model, found)}
    return found.motors | {name for name, limit in limits.items() if 0 < limit < np.inf}


def _of_a_tree(
    path: str | None, name: str, robot: Xml.Element, model: pin.Model, found: Declared
) -> list[str]:
    """Return what there is to say of a URDF that is read as an open tree; nothing if it is none."""
    if found.closures:
        return []
    if sign := open_ends(path, robot, model):
        return [
            f"{name}: read as an open tree, but {sign}: give a sidecar, or an empty tuple if it is a tree"
        ]
    free, driven = _free(model, found), _driven(model, found)
    idle = [joint for joint in free if joint not in driven]
    if not idle or len(idle) == len(free):
        return []
    more = f" and {len(idle) - 3} more" if len(idle) > 3 else ""
    return [
        f"{name}: by <transmission> or <ros2_control>, and without a limit of effort, these joints of a tree "
        "have no motor and are not "
        f"actuated, unless a sidecar says so: {', '.join(map(shown, idle[:3]))}{more}"
    ]


def _new(found: Declared, sidecar: Sidecar) -> list:
    """Return the couplings of the file for joints that the sidecar does not couple itself."""
    coupled = {coupling.joint for coupling in sidecar.couplings}
    return [coupling for coupling in found.couplings if coupling.joint not in coupled]


def state_of(source: str | os.PathLike[str], state: str | None, joints: Collection[str]) -> dict[str, Any]:
    """Return the values [m or rad] of the model's joints in a group state, as `p3dof.Sidecar.reference`."""
    text, name = read_xml(source, "SRDF")
    robot = XmlReader(name).parse(text)
    states = list(robot.iterfind("group_state"))
    names = [element.get("name", "") for element in states]
    if not names:
        raise ModelError(f"{name}: it has no group state")
    wanted = names[0] if state is None else state
    if wanted not in names:
        raise ModelError(
            f"{name}: the group state {shown(wanted)} does not exist; {suggestion(wanted, names)}"
        )
    values: dict[str, Any] = {}
    for element in states:
        for joint in element.iterfind("joint") if element.get("name") == wanted else ():
            called = joint.get("name", "")
            if called not in joints:
                if state is None:
                    continue  # of another robot of the same file
                raise ModelError(
                    f"{name}: group state {shown(wanted)}: the joint {shown(called)} does not exist; "
                    f"{suggestion(called, joints)}"
                )
            numbers = [number_of(word) for word in joint.get("value", "").split()]
            if not numbers or not all(map(math.isfinite, numbers)):
                raise ModelError(
                    f"{name}: group state {shown(wanted)}, joint {shown(called)}: expected numbers, got "
                    f"{shown(joint.get('value'))}"
                )
            values[called] = numbers[0] if len(numbers) == 1 else tuple(numbers)
    return values
