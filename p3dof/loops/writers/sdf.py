"""Any robot written as SDF: with the joints of the standard for its loops, or with Drake's constraints.

SDF gives a joint one place, so both bodies of a closure that is a joint have to meet where links have their
poses: joints are zero at the reference configuration, its loops closed, unless they close with all joints at
zero. Drake reads no loops of joints, but ball constraints with a point on either body; there zero stays zero.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof._base.markup import (
    VERSION,
    check_names,
    document,
    inertial,
    joint_between,
    numbers,
    roll_pitch_yaw,
    sub,
)
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.sidecar import JointData
from p3dof.loops.writers.bodies import (
    Body,
    End,
    Names,
    WrittenJoint,
    bodies_of,
    closed_configuration,
    frame_ends,
    values_of,
    with_least,
)

_SDF = "SDF"
_KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball"}
_CLOSURES = {
    "3d": "ball",
    "6d": "fixed",
    "hinge": "revolute",
    "slider": "prismatic",
    "universal": "universal",
}
"""Kinds of closure, and the joints of SDF that they are."""
_X, _Y, _Z = np.eye(3)
_POINTS: dict[str, tuple[FloatArray, ...]] = {
    "3d": (np.zeros(3),),
    "hinge": (np.zeros(3), _Z),
    "6d": (np.zeros(3), _X, _Y),
}
"""Kinds of closure, and the points that coincide in them."""
_MOTORS = "joint-trajectory-controller", "JointTrajectoryController"
"""Gazebo's plug-in for motors: a list of joints, on which it does nothing until it is asked to."""
_MIMIC_VERSION = "1.11"  # of SDF: the first that has mimic joints
_LINEAR = 2


def text(loop: LoopModel, drake: bool = False) -> str:
    """Return a robot as SDF.

    Joints keep their names; links have those of bodies, or new ones where a joint has the name already. A
    joint of several freedoms that SDF does not have becomes several, with links of next to no mass between.
    Shapes are not written; gravity is that of the world.
    """
    return _SdfWriter(loop, drake).text()


class _SdfWriter:
    """Writes one robot."""

    def __init__(self, loop: LoopModel, drake: bool) -> None:
        self._loop, self._model, self._drake = loop, loop.model, drake
        self._data = {entry.joint: entry for entry in loop.sidecar.joint_data}
        self._ends = frame_ends(loop)
        held = {joint for pair in self._ends for joint, _ in pair}
        merged = bodies_of(self._model, held, (), _SDF)
        self._zero = self._zero_configuration()
        self._values: dict[str, FloatArray] = {}
        for joint in dict.fromkeys(part.joint for body in merged for part in body.parts):
            parts = [part for body in merged for part in body.parts if part.joint == joint]
            for part, value in zip(parts, values_of(parts, self._model, self._zero), strict=True):
                self._values[part.name] = value
        self._bodies = _in_a_row(merged, self._model.njoints)
        with_least(self._model, self._bodies, _SDF)
        check_names([part.name for body in self._bodies for part in body.parts])
        self._names = Names(_SDF, ["world", *(part.name for body in self._bodies for part in body.parts)])
        self._links = {0: "world"}

    def text(self) -> str:
        """Return the file."""
        mimic = self._loop.sidecar.couplings and not self._drake
        root = Xml.Element("sdf", version=_MIMIC_VERSION if mimic else VERSION)
        if self._drake:
            root.set("xmlns:drake", "http://drake.mit.edu")
        model = sub(root, "model", name=_clean(str(self._model.name) or "robot"))
        self._name_links()
        for body in self._bodies:
            self._link(model, body)
        if self._drake and any(joint == 0 for pair in self._ends for joint, _ in pair):
            self._anchor(model)
        for body in self._bodies:
            self._joint(model, body)
        self._frames(model)
        for closure, ends in zip(self._loop.sidecar.closures, self._ends, strict=True):
            if closure.kind not in (_POINTS if self._drake else _CLOSURES):
                words = "Drake has no constraint for in a file" if self._drake else "no joint of SDF is"
                raise ModelError(f"SDF: the closure {shown(closure.name)} is a {closure.kind}, which {words}")
            name = self._names.new(_clean(f"{closure.frame1}_{closure.frame2}"))
            if self._drake:
                self._points(model, closure.kind, ends)
            else:
                self._closure(model, name, closure.kind, ends)
        if self._loop.actuated:
            plugin = sub(
                model,
                "plugin",
                filename=f"gz-sim-{_MOTORS[0]}-system",
                name=f"gz::sim::systems::{_MOTORS[1]}",
            )
            for name in self._loop.actuated:
                sub(plugin, "joint_name", name)
        kind = " For discrete plants of Drake." if self._drake else ""
        gravity = numbers(np.array(self._model.gravity.linear))
        said = f"Gravity is the world's; the robot's is {gravity} m/s²."
        return document(root, f"{model.get('name')}, written by p3dof.{kind} {said}")

    def _zero_configuration(self) -> FloatArray:
        """Return the configuration in which the joints of the file are at zero."""
        zero = np.array(pin.neutral(self._model), dtype=float)
        if self._drake or np.abs(self._loop.closure_error(zero)).max(initial=0.0) < 1e-9:
            return zero
        return closed_configuration(self._loop, _SDF)

    def _name_links(self) -> None:
        own: dict[int, str] = {}
        for frame in self._model.frames:
            if frame.type == pin.FrameType.BODY and frame.placement.isIdentity(1e-15) and frame.name:
                own.setdefault(int(frame.parentJoint), str(frame.name))
        for body in self._bodies:
            name = _clean(own.get(body.joint, f"{body.name}_link"))
            self._links[body.joint] = self._names.new(name)
        self._own = {own[joint] for joint in self._links if joint in own}

    def _place(self, part: WrittenJoint) -> pin.SE3:
        """Return where a joint is at the zero of the file, in the axes of the link before it."""
        value = self._values[part.name]
        if part.kind == "free":
            return pin.SE3(pin.Quaternion(value[3], *value[4:]).matrix(), value[:3])
        move = pin.SE3.Identity()
        if part.kind == "ball":
            move = pin.SE3(pin.Quaternion(value[0], *value[1:]).matrix(), np.zeros(3))
        elif part.kind == "hinge":
            move = pin.SE3(pin.exp3(value[0] * part.axis), np.zeros(3))
        else:
            move.translation = value[0] * part.axis
        return part.place * move

    def _link(self, model: Xml.Element, body: Body) -> None:
        (part,) = body.parts
        link = sub(model, "link", name=self._links[body.joint])
        if part.kind == "free":
            if body.parent:
                raise ModelError(
                    f"SDF: the free joint {shown(part.name)} hangs on another body than the world"
                )
            _pose(link, self._place(part), "__model__")
        else:
            _pose(link, pin.SE3.Identity(), part.name)
        Y = body.inertia
        inertial(link, float(Y.mass), Y.lever, np.array(Y.inertia), exact=True)

    def _anchor(self, model: Xml.Element) -> None:
        """Write a link that is the world: Drake ties links only."""
        self._links[0] = name = self._names.new("world_link")
        link = sub(model, "link", name=name)
        _pose(link, pin.SE3.Identity(), "__model__")
        inertial(link, 1.0, np.zeros(3), np.eye(3))
        joint_between(model, self._names.new("world_fixed"), "fixed", "world", name)

    def _joint(self, model: Xml.Element, body: Body) -> None:
        (part,) = body.parts
        data = self._data.get(str(self._model.names[part.joint]), JointData("_"))
        rotor = np.asarray(self._model.armature)[list(part.v)]
        if part.kind in ("free", "ball") or part.turned:
            if data or rotor.any():
                raise ModelError(
                    f"SDF: what acts in the joint {shown(part.name)} of several freedoms has no place"
                )
            if part.kind == "free":
                return
        parent = "world" if body.parent == 0 else self._links[body.parent]
        element = joint_between(model, part.name, _KINDS[part.kind], parent, self._links[body.joint])
        _pose(element, self._place(part), "__model__" if body.parent == 0 else parent)
        if part.kind == "ball":
            return
        axis = sub(element, "axis")
        sub(axis, "xyz", numbers(part.axis, exact=True))
        self._limits(axis, part)
        self._dynamics(axis, part, data)
        self._mimic(element, axis, part)
        if rotor.any():
            if not self._drake or part.name not in self._loop.actuated:
                raise ModelError(
                    f"SDF: the joint {shown(part.name)} has an armature, which SDF has no word for"
                )
            sub(element, "drake:rotor_inertia", numbers(rotor[0], exact=True))
            sub(element, "drake:gear_ratio", "1")

    def _limits(self, axis: Xml.Element, part: WrittenJoint) -> None:
        model, limit = self._model, sub(axis, "limit")
        joint, actuated = part.joint, part.name in self._loop.actuated
        if model.nvs[joint] == 1 and model.nqs[joint] == 1:
            at = model.idx_qs[joint]
            bounds = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
            for name, value in zip(("lower", "upper"), bounds, strict=True):
                if bounds[0] < bounds[1] and np.isfinite(value):
                    sub(limit, name, numbers(value - self._values[part.name][0], exact=True))
        speed = float(model.upperVelocityLimit[model.idx_vs[joint]])
        if 0 < speed < np.inf:
            sub(limit, "velocity", numbers(speed, exact=True))
        effort = float(model.upperEffortLimit[model.idx_vs[joint]])
        if not actuated:
            sub(limit, "effort", "0")
        elif 0 < effort < np.inf:
            sub(limit, "effort", numbers(effort, exact=True))

    def _dynamics(self, axis: Xml.Element, part: WrittenJoint, data: JointData) -> None:
        values = {"damping": data.damping, "friction": data.friction}
        if data.stiffness:
            at: Any = data.rest  # a number, of a joint with one degree of freedom
            rest = at + data.force / data.stiffness - self._values[part.name][0]
            values |= {"spring_stiffness": data.stiffness, "spring_reference": rest}
        elif data.force:
            raise ModelError(
                f"SDF: the joint {shown(part.name)} has a constant force, which SDF has no word for"
            )
        if any(values.values()):
            dynamics = sub(axis, "dynamics")
            for name, value in values.items():
                sub(dynamics, name, numbers(value, exact=True))

    def _mimic(self, element: Xml.Element, axis: Xml.Element, part: WrittenJoint) -> None:
        coupling = next((c for c in self._loop.sidecar.couplings if c.joint == part.name), None)
        if coupling is None:
            return
        if coupling.on is None or coupling.others or len(coupling.coefficients) > _LINEAR:
            raise ModelError(f"SDF: the coupling {coupling.title} is no multiple of one other joint")
        constant, factor = (*coupling.coefficients, 0.0)[:_LINEAR]
        offset = constant + factor * self._values[coupling.on][0] - self._values[part.name][0]
        multiplier, offset_ = numbers(factor, exact=True), numbers(offset, exact=True)
        if self._drake:
            sub(element, "drake:mimic", joint=coupling.on, multiplier=multiplier, offset=offset_)
            return
        mimic = sub(axis, "mimic", joint=coupling.on)
        for name, value in (("multiplier", multiplier), ("offset", offset_), ("reference", "0")):
            sub(mimic, name, value)

    def _frames(self, model: Xml.Element) -> None:
        """Write the frames of closures, and all others but those of joints and links."""
        skipped = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
        needed: dict[str, End] = {}
        for closure, ends in zip(self._loop.sidecar.closures, self._ends, strict=True):
            needed |= dict(zip((closure.frame1, closure.frame2), ends, strict=True))
        self._sites: dict[tuple[int, bytes], str] = {}
        others = [frame for frame in list(self._model.frames)[1:] if frame.type not in skipped]
        for frame in others:
            name, joint = str(frame.name), int(frame.parentJoint)
            if name not in self._own and joint in self._links:
                needed.setdefault(name, (joint, frame.placement))
        for name, (joint, place) in needed.items():
            self._frame(model, name, joint, place)

    def _frame(self, model: Xml.Element, name: str, joint: int, place: pin.SE3) -> None:
        if self._links[joint] == "world":
            return  # SDF attaches no frame to it
        chosen = self._names.new(_clean(name))
        element = sub(model, "frame", name=chosen, attached_to=self._links[joint])
        _pose(element, place, self._links[joint])
        self._sites[joint, place.homogeneous.tobytes()] = chosen

    def _closure(self, model: Xml.Element, name: str, kind: str, ends: tuple[End, End]) -> None:
        """Write a closure as a joint between its frames."""
        first, second = ends
        free = _Z
        if second[0] == 0:  # a child in the world is none
            first, second = second, first
        parent = "world" if first[0] == 0 else self._site(first)
        element = joint_between(model, name, _CLOSURES[kind], parent, self._site(second))
        if kind in ("hinge", "slider"):
            axis = sub(element, "axis")
            sub(axis, "xyz", numbers(free))
            sub(sub(axis, "limit"), "effort", "0")
        elif kind == "universal":
            self._cross(element, ends, first is not ends[0])

    def _cross(self, element: Xml.Element, ends: tuple[End, End], swapped: bool) -> None:
        """Write the axes x1 and y2 of a universal joint, as they are at the zero of the file."""
        data = self._model.createData()
        pin.forwardKinematics(self._model, data, self._zero)
        one, two = ((data.oMi[joint] * place).rotation for joint, place in ends)
        child = one if swapped else two
        axes = [child.T @ one[:, 0], child.T @ two[:, 1]]
        for tag, axis in zip(("axis", "axis2"), reversed(axes) if swapped else axes, strict=True):
            sub(sub(element, tag), "xyz", numbers(axis, exact=True))

    def _site(self, end: End) -> str:
        return self._sites[end[0], end[1].homogeneous.tobytes()]

    def _points(self, model: Xml.Element, kind: str, ends: tuple[End, End]) -> None:
        """Write a closure as points that coincide."""
        spans = [np.linalg.norm(place.translation) for place in self._model.jointPlacements]
        for point in _POINTS[kind]:
            element = sub(model, "drake:ball_constraint")
            for side, at, (joint, place) in zip("AB", ("p_AP", "p_BQ"), ends, strict=True):
                sub(element, f"drake:ball_constraint_body_{side}", self._links[joint])
                there = place.act((float(max(spans)) or 1.0) * point)
                sub(element, f"drake:ball_constraint_{at}", numbers(there, exact=True))


def _in_a_row(bodies: list[Body], first: int) -> list[Body]:
    """Return bodies that have one joint each; those between several joints have no mass."""
    found = []
    for body in bodies:
        parent = body.parent
        for part in body.parts[:-1]:
            found.append(Body(part.name, first, parent, (part,), pin.Inertia.Zero()))
            parent, first = first, first + 1
        found.append(replace(body, parent=parent, parts=body.parts[-1:]))
    return found


def _clean(name: str) -> str:
    """Return a name without what SDF reserves."""
    name = name.replace("::", "_")
    return f"{name}_" if name == "world" or (name.startswith("__") and name.endswith("__")) else name


def _pose(parent: Xml.Element, place: pin.SE3, frame: str) -> None:
    values = numbers(place.translation, roll_pitch_yaw(place.rotation), exact=True)
    sub(parent, "pose", values, relative_to=frame)
