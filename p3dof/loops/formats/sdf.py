"""SDF: a spanning tree of its joints, whose graph may have loops, and closures where these are cut.

Joints that act, such as motors, springs, screws and those that others follow, stay in the tree, then those
with limits, then the first ones of the file. A plain joint that is cut is a closure of its own kind. Any
other leads to a second body with half the mass of its child, and both are held together: nothing of it is
lost. A joint that is passed from its child to its parent keeps its value and its sign.

A link that no joint holds in the world floats. Motors are the joints of one freedom whose effort is not 0, as
in Drake; in a file with loops whose efforts are all other than 0, those that plug-ins of Gazebo move.

References
----------
SDFormat specification 1.4 to 1.12; Drake, parsing of SDF.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, ModelError, ModelWarning
from p3dof.loops.coordinates import add_frame, single_joint, with_armature
from p3dof.loops.formats.sdf_file import BALL, Item, SdfRobot, SdfText, first
from p3dof.loops.formats.sdf_joints import CLOSURES, Graph, Joint, Step, inertia_of, joints_of, reference_body
from p3dof.loops.formats.urdf import MAX_FREEDOMS, check_options
from p3dof.loops.formats.urdf_loops import tying_plugins, with_z_along
from p3dof.loops.sidecar import (
    Closure,
    Coupling,
    JointData,
    Sidecar,
    SidecarLike,
    check_couplings,
    sidecar_of,
    suggestion,
)

_TYING = re.compile(
    r"loop|coupling|constraint|closure|tendon|equality|bushing|drake:joint|mimic|gear|screw", re.IGNORECASE
)
"""Names of elements that may tie joints."""
_TIED_IN = ("sdf", "world", "model", "joint", "axis", "axis2")
_PARALLEL = 1e-9  # how far axes of a gear may be from parallel
_LIMITS = (
    *("lowerPositionLimit", "upperPositionLimit", "damping"),
    *("upperEffortLimit", "upperVelocityLimit", "upperDryFrictionLimit"),
)
_TURNS = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
_SLIDES = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)


def read(
    source: str | os.PathLike[str],
    closures: SidecarLike = None,
    root_joint: pin.JointModel | None = None,
    mimic: bool = True,
    on_unknown: str = "raise",
    passive: bool | None = None,
    include_root: str | os.PathLike[str] | None = None,
) -> tuple[pin.Model, Sidecar]:
    """Return the tree of an SDF file and its loops; joints that the user's sidecar names stay in the tree."""
    check_options(root_joint, on_unknown)
    robot, given = SdfRobot(source, include_root), sidecar_of(closures)
    if on_unknown == "raise":
        _tell_unknown(robot)
    tree = _Tree(robot, list(joints_of(robot)), _named(given))
    tree.build(root_joint)
    loops = (*tree.closures, *tree.balls())
    couplings = tree.couplings(mimic, () if given is None else given.couplings)
    tied = {coupling.joint for coupling in (*couplings, *(() if given is None else given.couplings))}
    free = {str(name) for name in tree.model.names} - tied if mimic else set()
    for file in robot.files if on_unknown == "raise" else ():
        for element, words in tying_plugins(file.root, free):
            warnings.warn(f"{_where(file, element)}: {words}", ModelWarning, stacklevel=3)
    motors = tuple(name for name in tree.motors() if name not in tied)
    if not tree.motors_known and closures is None:
        warnings.warn(
            f"{robot.source}: it has loops, no <effort> of 0 and no plug-in that moves joints, so that it "
            "does not say which joints have motors: none is taken for one (name them in a sidecar)",
            ModelWarning,
            stacklevel=3,
        )
    sidecar = Sidecar(loops, motors, couplings, tree.reference or None)
    return tree.model, replace(sidecar, joint_data=with_armature(tree.model, tree.joint_data(passive)))


def _where(file: SdfText, element: Xml.Element) -> str:
    return f"{file.source}, line {file.line_of(element)}"


def _named(given: Sidecar | None) -> set[str]:
    """Return the names of joints that a sidecar says something of."""
    if given is None:
        return set()
    coupled = {name for coupling in given.couplings for name in (coupling.joint, *coupling.leaders)}
    return {*given.actuated, *coupled, *(entry.joint for entry in given.joint_data), *(given.reference or {})}


def _tell_unknown(robot: SdfRobot) -> None:
    """Refuse unknown elements that may tie joints, and name all others and what acts and is not read."""
    found = []
    named = {item.name for item in (*robot.links, *robot.joints)}
    for file, element, within in robot.unknown:
        texts = {text.strip() for one in element.iter() for text in (one.text or "", *one.attrib.values())}
        ties = len(named & texts) > 1  # such as a belt between two links
        if within in _TIED_IN and (ties or _TYING.search(element.tag)):
            raise ModelError(
                f"{_where(file, element)}: <{element.tag:.80}> in <{within}> looks like a loop, and is not "
                "understood (on_unknown='ignore' leaves it out)"
            )
        found.append(f"<{element.tag:.80}> in <{within}> ({_where(file, element)})")
    for link in robot.links:
        for tag, plain in (("gravity", True), ("kinematic", False), ("enable_wind", False)):
            flag = link.element.find(tag)
            if flag is not None and link.file.is_set(link.element, tag, plain) is not plain:
                found.append(f"<{tag}> of the link {shown(link.full)} ({_where(link.file, flag)})")
    if found:
        more = f" and {len(found) - 10} more" if len(found) > 10 else ""
        words = f"not understood, and left out: {', '.join(found[:10])}{more}"
        warnings.warn(words, ModelWarning, stacklevel=4)


class _Tree:
    """The tree of a robot, and the closures of its loops."""

    def __init__(self, robot: SdfRobot, joints: list[Joint], keep: Collection[str]) -> None:
        self._robot, self._joints = robot, joints
        self._balls = list(self._ball_elements())
        self._graph = Graph(robot, joints, keep, bool(self._balls))
        self._at = {link: robot.place_of(link) for link in robot.links}
        self._bodies: dict[Item | None, tuple[int, pin.SE3, int]] = {None: (0, pin.SE3.Identity(), 0)}
        self._turns: dict[str, FloatArray] = {}  # axes of hinges, at zero in the world
        self._shares = dict.fromkeys(robot.links, 1)
        self._joint_names: set[str] = {"universe"}
        self._names = {"universe", *(link.full for link in robot.links)}
        self._names.update(name for joint in joints for name in joint.names)
        self.closures: list[Closure] = []
        self.reference: dict[str, Any] = {}
        self.model = pin.Model()
        self.model.name = robot.model.name
        if robot.gravity is not None:
            self.model.gravity.linear = robot.gravity

    # -- Its model -----------------------------------------------------------------------------------------

    def build(self, root_joint: pin.JointModel | None) -> None:
        """Build the tree and its closures."""
        for joint in self._graph.doubled:
            self._shares[joint.child] += 1
        fixed: list[Item | None] = [link for link in self._robot.links if link.scope.static]
        for link in fixed:
            if link is not None:
                self._add_body(link, 0, self._at[link], 0)
        for link in (None, *fixed):
            self._grow(link)
        self._float(root_joint)
        for frame in self._robot.frames:
            link = self._robot.link(frame.scope, frame.name, (frame.file, frame.element))
            self._frame(frame.full, link, self._robot.place_of(frame))
        for joint in self._graph.cut:
            self._close(joint)
        if self.model.nv > MAX_FREEDOMS:
            raise ModelError(
                f"{self._robot.source}: expected at most {MAX_FREEDOMS} degrees of freedom, got "
                f"{self.model.nv}"
            )
        self._give_limits()

    def _float(self, root_joint: pin.JointModel | None) -> None:
        """Add the trees that no joint holds in the world."""
        roots = self._graph.roots(self._bodies)
        if root_joint is not None and len(roots) != 1:
            got = f"{len(roots)}: {', '.join(shown(root.full) for root in roots[:5])}" if roots else "none"
            raise InputError(f"root_joint: expected one link without a joint to the world, got {got}")
        for root in roots:
            kind = pin.JointModelFreeFlyer() if root_joint is None else root_joint
            free = kind.shortname() == "JointModelFreeFlyer"
            name = "root_joint" if len(roots) == 1 else f"{root.full}_root_joint"
            while name in self._joint_names:
                name += "_"
            self._joint_names.add(name)
            place = pin.SE3.Identity() if free else self._at[root]
            joint = self.model.addJoint(0, kind, place, name)
            frame = self.model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.JOINT))
            self._add_body(root, joint, pin.SE3.Identity(), frame)
            if free and not self._at[root].isIdentity(0.0):
                self.reference[name] = tuple(pin.SE3ToXYZQUAT(self._at[root]))
            self._grow(root)

    def _grow(self, root: Item | None) -> None:
        """Add all that hangs on a link."""
        waiting = [(root, joint) for joint in reversed(self._graph.at(root))]
        while waiting:
            link, joint = waiting.pop()
            forward = joint.parent is link
            other = joint.child if forward else joint.parent
            if other in self._bodies:
                continue
            assert other is not None  # noqa: S101 - the world is a body from the beginning
            number, at, frame = self._hang(link, joint, joint.steps if forward else joint.back())
            self._add_body(other, number, at * self._at[other], frame)
            waiting += [(other, more) for more in reversed(self._graph.at(other)) if more is not joint]

    def _hang(self, link: Item | None, joint: Joint, steps: Iterable[Step]) -> tuple[int, pin.SE3, int]:
        """Add a joint to a link; return its number, where the axes of the world are in it, and its frame."""
        number, place, frame = self._bodies[link]
        start = place * (pin.SE3.Identity() if link is None else self._at[link].inverse()) * joint.place
        at, kind = start, pin.FrameType.FIXED_JOINT
        for step in steps:
            kind, name = pin.FrameType.JOINT, step.name
            if name in self._joint_names:
                joint.item.file.bad(joint.item.element, f"the name {shown(name)} of a joint is there twice")
            self._joint_names.add(name)
            number = self.model.addJoint(number, _joint_model(step), at, name)
            at = pin.SE3.Identity()
            frame = self.model.addFrame(pin.Frame(name, number, frame, at, kind))
            if step.kind == "hinge":
                self._turns[name] = joint.place.rotation @ step.direction
        if kind == pin.FrameType.FIXED_JOINT:
            frame = self.model.addFrame(pin.Frame(joint.name, number, frame, at, kind))
        return number, at * joint.place.inverse(), frame

    def _add_body(self, link: Item, number: int, place: pin.SE3, frame: int, name: str | None = None) -> str:
        inertia = inertia_of(link)
        if (share := self._shares[link]) > 1:
            inertia = pin.Inertia.FromDynamicParameters(inertia.toDynamicParameters() / share)
        if number:  # what is fixed to the world never moves
            self.model.appendBodyToJoint(number, inertia, place)
        called = link.full if name is None else self._new(name)
        index = self.model.addFrame(pin.Frame(called, number, frame, place, pin.FrameType.BODY))
        if name is None:
            self._bodies[link] = number, place, index
        return called

    def _new(self, name: str) -> str:
        while name in self._names:
            name += "_"
        self._names.add(name)
        return name

    def _frame(self, name: str, link: Item | None, place: pin.SE3) -> str:
        """Add a frame to a link, at a place in the axes of the world at zero, and return its name."""
        name = self._new(name)
        here = pin.SE3.Identity() if link is None else self._at[link]
        add_frame(self.model, name, self._bodies[link][2], here.actInv(place))
        return name

    def _close(self, joint: Joint) -> None:
        """Add the closure of a joint that is cut."""
        if joint in self._graph.doubled:
            number, at, frame = self._hang(joint.parent, joint, joint.steps)
            child = joint.child
            second = self._add_body(
                child, number, at * self._at[child], frame, f"{child.full}_of_{joint.name}"
            )
            self.closures.append(
                Closure(self._frame(f"{joint.name}_child", child, self._at[child]), second, "6d")
            )
            return
        turn = np.eye(3)
        if joint.kind == "universal":
            one, two = (axis.direction for axis in joint.axes)
            turn = np.column_stack((one, two, np.cross(one, two)))
        elif joint.axes:
            turn = with_z_along(joint.axes[0].direction)
        place = joint.place * pin.SE3(turn, np.zeros(3))
        names = [
            self._frame(f"{joint.name}_{end}", link, place)
            for end, link in (("parent", joint.parent), ("child", joint.child))
        ]
        self.closures.append(Closure(names[0], names[1], CLOSURES[joint.kind]))

    def _give_limits(self) -> None:
        """Give the joints their limits, damping and friction."""
        model = self.model
        fields = {name: np.array(getattr(model, name)) for name in _LIMITS}
        for step in self._steps():
            index = model.getJointId(step.name)
            q, v, axis = model.idx_qs[index], model.idx_vs[index], step.axis
            assert axis is not None  # noqa: S101 - of `_steps`
            fields["lowerPositionLimit"][q], fields["upperPositionLimit"][q] = axis.limits
            fields["damping"][v], fields["upperDryFrictionLimit"][v] = axis.damping, axis.friction
            if np.isfinite(axis.velocity):
                fields["upperVelocityLimit"][v] = axis.velocity
            if np.isfinite(axis.effort) and axis.effort:
                fields["upperEffortLimit"][v] = axis.effort
        for name, values in fields.items():
            setattr(model, name, values)
        for name in ("Effort", "Velocity", "DryFriction"):
            setattr(model, f"lower{name}Limit", -np.array(getattr(model, f"upper{name}Limit")))

    def _steps(self) -> Iterator[Step]:
        """Yield the joints of the tree of which the file says something."""
        for joint in self._graph.edges:
            for step in joint.steps:
                if step.axis is not None and self.model.existJointName(step.name):
                    yield step

    @property
    def motors_known(self) -> bool:
        """Whether the file says which joints have motors."""
        return self._graph.motors_known

    def motors(self) -> list[str]:
        """Return the joints that have motors, by the file's own words."""
        return self._graph.motors()

    # -- What goes with it ---------------------------------------------------------------------------------

    def joint_data(self, passive: bool | None) -> list[JointData]:
        """Return springs and rotors, and if they act, damping and friction."""
        rotors = {joint.name: joint.rotor for joint in self._graph.edges if joint.rotor is not None}
        found = []
        for step in self._steps():
            axis, rotor = step.axis, rotors.get(step.name, (0.0, 1.0))
            assert axis is not None  # noqa: S101 - of `_steps`
            spring = (axis.stiffness, axis.rest) if passive is not False else (0.0, 0.0)
            losses = (axis.damping, axis.friction) if passive else (0.0, 0.0)
            found.append(JointData(step.name, *spring, *losses, 0.0, *rotor))
        return found

    def _ball_elements(self) -> Iterator[tuple[Item, Xml.Element]]:
        for model in (item for item in self._robot.all_models() if item.inner is not None):
            for element in model.element:
                if element.tag == BALL and not (model.inner is not None and model.inner.static):
                    yield model, element

    def balls(self) -> Iterator[Closure]:
        """Yield Drake's ball constraints: two points of two links that coincide."""
        for number, (model, element) in enumerate(self._balls, 1):
            assert model.inner is not None  # noqa: S101 - a model
            ends, at = [], (model.file, element)
            for body, point in (("A", "p_AP"), ("B", "p_BQ")):
                name = model.file.word(element, f"{BALL}_body_{body}")
                link, place = (
                    self._robot.link(model.inner, name, at),
                    self._robot.place(model.inner, name, at),
                )
                part = first(element, f"{BALL}_{point}")
                shift = np.zeros(3) if part is None else model.file.numbers(part, 3)
                there = place * pin.SE3(np.eye(3), shift)
                ends.append(self._frame(f"ball_constraint_{number}_{body}", link, there))
            yield Closure(ends[0], ends[1], "3d")

    def couplings(self, mimic: bool, given: Iterable[Coupling]) -> tuple[Coupling, ...]:
        """Return what couples joints: screws, gears, and joints that follow others."""
        found: list[Coupling] = []
        own = {coupling.joint for coupling in given}
        for joint in self._joints:
            if joint.kind == "screw":
                slide, hinge = (step.name for step in joint.steps)
                found.append(Coupling(slide, hinge, (0.0, joint.pitch), joint.name))
            elif joint.kind == "gearbox":
                found.append(self._gear(joint))
            found += [
                self._mimic(joint, step, step.axis.mimic)
                for step in (joint.steps if mimic else ())
                if step.axis is not None and step.axis.mimic is not None
            ]
        found = [coupling for coupling in found if coupling.joint not in own]
        check_couplings(self._robot.source, found)
        return tuple(found)

    def _mimic(self, joint: Joint, step: Step, says: tuple[str, str, float, float]) -> Coupling:
        name, which, offset, factor = says
        file, element = joint.item.file, joint.item.element
        way = self._robot.way(joint.item.scope, name, (file, element), "joint")
        steps = next((one.steps for one in self._joints if one.item in way[-1:]), ())
        steps = tuple(one for one in steps if one.axis is not None)
        number = ("axis", "axis2").index(which) if which in ("axis", "axis2") else len(steps)
        if number >= len(steps):
            known = [one.name for one in self._graph.edges if one.axes]
            file.bad(element, f"mimic: {shown(name)} is no joint with that axis; {suggestion(name, known)}")
        for one in (step.name, steps[number].name):
            single_joint(self.model, one, f"{file.source}: <mimic>")
        try:
            return Coupling(step.name, steps[number].name, (offset, factor), f"mimic_{step.name}")
        except ModelError as error:
            file.bad(element, str(error))

    def _gear(self, gear: Joint) -> Coupling:
        """Return the coupling of a gearbox: the turn of its child is -ratio times that of its parent."""
        file, element = gear.item.file, gear.item.element
        ratio, body = file.number(element, "gearbox_ratio", 1.0), reference_body(self._robot, gear)
        terms: dict[str, float] = {}
        for link, axis, factor in ((gear.child, gear.axes[1], 1.0), (gear.parent, gear.axes[0], ratio)):
            turns = self._turning(body, link, gear.place.rotation @ axis.direction)
            if turns is None:
                file.bad(
                    element,
                    "expected hinges along its axes between the gearbox_reference_body and both links",
                )
            for name, sign in turns.items():
                terms[name] = terms.get(name, 0.0) + factor * sign
        terms = {name: factor for name, factor in terms.items() if factor}
        if len(terms) < 2 or not ratio:
            file.bad(element, "it ties no two joints")
        efforts = {step.name: step.axis.effort for step in self._steps() if step.axis is not None}
        follower = next((name for name in terms if not efforts[name]), next(iter(terms)))
        factor = -terms.pop(follower)
        (on, one), *rest = ((name, other / factor) for name, other in terms.items())
        return Coupling(follower, on, (0.0, one), gear.name, tuple(rest))

    def _turning(self, body: Item | None, link: Item | None, axis: FloatArray) -> dict[str, float] | None:
        """Return how much each joint turns a link from another about an axis; None if about others too."""
        behind = [set(self.model.supports[self._bodies[one][0]]) for one in (link, body)]
        found = {}
        for number in sorted(behind[0] ^ behind[1], reverse=True):
            name = str(self.model.names[number])
            cosine = float(self._turns.get(name, np.zeros(3)) @ axis)
            if abs(abs(cosine) - 1) > _PARALLEL:
                return None
            found[name] = float(np.sign(cosine)) * (1.0 if number in behind[0] else -1.0)
        return found


def _joint_model(step: Step) -> Any:
    """Return the joint of Pinocchio that a step is."""
    if step.kind == "ball":
        return pin.JointModelSpherical()
    slides = step.kind == "slide"
    for kind, direction in zip(_SLIDES if slides else _TURNS, np.eye(3), strict=True):
        if np.array_equal(step.direction, direction):
            return kind()
    unaligned = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
    return unaligned(np.array(step.direction))
