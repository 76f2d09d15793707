"""Any robot written as MJCF: tree, closures, couplings, motors and the reference configuration.

Closures as equalities of MuJoCo, each with the same free motions, exactly.

MuJoCo ties points (``connect``), frames (``weld``), values of joints, and lengths of tendons. A hinge is two
points on its axis. A rod is a tendon of a fixed length; the axes of a universal joint are perpendicular where
a tendon between a point on each, both as far from where they meet, is as long as the longest side of a
triangle with a right angle. What slides has no such word: a slider, a cylindrical and a planar joint get a
carriage, a body that moves on one of the two bodies as the closure lets it, and is welded to the other.
It takes a part of the mass of that body, with which it moves as one: closed, nothing changes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError, ModelWarning
from p3dof._base.markup import document, mujoco, numbers, sub
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.sidecar import Closure, Coupling, JointData
from p3dof.loops.writers.bodies import (
    Body,
    End,
    Names,
    WrittenJoint,
    bodies_of,
    closed_configuration,
    frame_ends,
    has_mass,
    principal,
    values_of,
    with_least,
)

_X, _Y, _Z = np.eye(3)
_SLIDING = {
    "slider": (("slide", _Z),),
    "cylindrical": (("slide", _Z), ("hinge", _Z)),
    "planar": (("slide", _X), ("slide", _Y), ("hinge", _Z)),
}
"""What a carriage can do, by the kind of closure."""


@dataclass
class Carriage:
    """A body between those of a closure."""

    name: str  # its name
    closure: int  # the closure that it stands for
    on: int  # the joint whose body it slides on, and where
    place: pin.SE3
    with_: int  # the joint whose body it is welded to, and where
    seat: pin.SE3
    joints: list[tuple[str, str, FloatArray]] = field(default_factory=list)
    """(3,): its joints: names, kinds and axes."""
    inertia: Any = None  # its inertia, in its own axes
    site: str = ""  # the site at its origin, once that is written

    def values(self, places: Sequence[pin.SE3]) -> list[FloatArray]:
        """Return the values of its joints where the joints of the tree have these placements."""
        between = (places[self.on] * self.place).actInv(places[self.with_] * self.seat)
        x, y, z = between.translation
        turn = float(np.arctan2(between.rotation[1, 0], between.rotation[0, 0]))
        found = {"slide": {"x": x, "y": y, "z": z}, "hinge": {"z": turn}}
        return [np.array([found[kind]["xyz"[int(np.argmax(axis))]]]) for _, kind, axis in self.joints]


def carriages_of(
    closures: Sequence[Closure], ends: Sequence[tuple[End, End]], bodies: Sequence[Body], names: Names
) -> list[Carriage]:
    """Return the carriages of closures that slide; the bodies that they are welded to get lighter."""
    by_joint = {body.joint: body for body in bodies if has_mass(body.inertia)}
    found = []
    for number, (closure, (one, two)) in enumerate(zip(closures, ends, strict=True)):
        if closure.kind not in _SLIDING:
            continue
        (on, place), (with_, seat) = (one, two) if two[0] in by_joint else (two, one)
        if with_ not in by_joint:
            raise ModelError(
                f"MJCF: the closure {shown(closure.name)} is a {closure.kind}, which MuJoCo has between "
                "bodies with a mass only"
            )
        name = f"{closure.frame1}_{closure.frame2}_{closure.kind}"
        carriage = Carriage(name, number, on, place, with_, seat)
        for kind, axis in _SLIDING[closure.kind]:
            carriage.joints.append((names.new(f"{name}_{'xyz'[int(np.argmax(axis))]}_{kind}"), kind, axis))
        found.append(carriage)
    for joint in dict.fromkeys(carriage.with_ for carriage in found):
        riding = [carriage for carriage in found if carriage.with_ == joint]
        whole, share = by_joint[joint].inertia, 1.0 / (len(riding) + 1)
        part = pin.Inertia(share * whole.mass, whole.lever, share * whole.inertia)
        by_joint[joint].inertia = part
        for carriage in riding:
            carriage.inertia = carriage.seat.actInv(part)
    return found


class LoopWriter:
    """Writes closures; `site` writes a site, given joint, placement and name, and returns its name."""

    def __init__(
        self,
        loop: LoopModel,
        ends: Sequence[tuple[End, End]],
        site: Callable[[int, pin.SE3, str], str],
        names: Names,
        tendons: Xml.Element,
        equalities: Xml.Element,
    ) -> None:
        self._ends, self._closures, self._new = ends, loop.sidecar.closures, site
        self._names, self._tendons, self._equalities = names, tendons, equalities
        data = loop.model.createData()
        pin.forwardKinematics(loop.model, data, pin.neutral(loop.model))
        self._zero = [place.copy() for place in data.oMi]
        spans = [np.linalg.norm(place.translation) for place in loop.model.jointPlacements]
        self._arm = float(max(spans)) or 1.0

    def write(self, carriages: Sequence[Carriage]) -> None:
        """Write all closures, those that slide by their carriages."""
        riding = {carriage.closure: carriage for carriage in carriages}
        for number, (closure, ends) in enumerate(zip(self._closures, self._ends, strict=True)):
            frames = closure.frame1, closure.frame2
            sites = [self._new(*end, name) for end, name in zip(ends, frames, strict=True)]
            name = self._names.new("_".join(frames))
            if number in riding:
                carriage = riding[number]
                seat = sites[1] if carriage.with_ == ends[1][0] else sites[0]
                self._equality("weld", name, carriage.site, seat)
            elif closure.kind == "6d":
                self._equality("weld", name, *sites)
            elif closure.kind == "distance":
                self._tendon(name, sites, ends, float(closure.length or 0.0))
            else:
                self._equality("connect", name, *sites)
                if closure.kind == "hinge":
                    self._equality(
                        "connect", self._names.new(f"{name}_axis"), *self._shifted(ends, name, _Z, _Z)[0]
                    )
                elif closure.kind == "universal":
                    axes = self._names.new(f"{name}_axes")
                    self._tendon(axes, *self._shifted(ends, name, _X, _Y), np.sqrt(2.0) * self._arm)

    def _shifted(
        self, ends: tuple[End, End], name: str, axis1: FloatArray, axis2: FloatArray
    ) -> tuple[list[str], tuple[End, End]]:
        """Return sites on axes of both frames, as far from their origins, and where they are."""
        moved = []
        for (joint, place), axis in zip(ends, (axis1, axis2), strict=True):
            moved.append((joint, place * pin.SE3(np.eye(3), self._arm * axis)))
        sites = [self._new(*end, f"{name}_axis_{number}") for number, end in enumerate(moved, 1)]
        return sites, (moved[0], moved[1])

    def _equality(self, kind: str, name: str, site1: str, site2: str) -> None:
        sub(self._equalities, kind, name=name, site1=site1, site2=site2)

    def _tendon(self, name: str, sites: Sequence[str], ends: tuple[End, End], length: float) -> None:
        """Write a straight tendon of a fixed length: MuJoCo counts from what it has at zero."""
        tendon = sub(self._tendons, "spatial", name=name)
        for site in sites:
            sub(tendon, "site", site=site)
        one, two = ((self._zero[joint] * place).translation for joint, place in ends)
        more = length - float(np.linalg.norm(one - two))
        sub(
            self._equalities,
            "tendon",
            name=name,
            tendon1=name,
            polycoef=numbers(more, 0, 0, 0, 0, exact=True),
        )


_SIMPLE = ("JointModelP", "JointModelR")  # beginnings of the names of slides and hinges
_LINEAR = 2  # coefficients of a polynomial of degree one


@dataclass(frozen=True)
class TendonJoint:
    """A joint without mass that is the length of a tendon; the motor on it pulls at the joints it follows."""

    name: str  # the joint, and the tendon
    joint: int  # its index
    coupling: Coupling  # what it follows


def tendon_joints(loop: LoopModel) -> list[TendonJoint]:
    """Return the joints of a robot that are lengths of fixed tendons."""
    model, found = loop.model, []
    leaders = {leader for coupling in loop.sidecar.couplings for leader in coupling.leaders}
    occupied = {int(frame.parentJoint) for frame in model.frames if frame.name not in set(model.names)}
    occupied |= {int(parent) for parent in list(model.parents)[1:]}
    for coupling in loop.sidecar.couplings:
        i = model.getJointId(coupling.joint)
        inertia, c = model.inertias[i], coupling.coefficients
        fixed = str(model.joints[i].shortname()).startswith(_SIMPLE) and model.nqs[i] == model.nvs[i] == 1
        empty = not (inertia.mass or np.any(inertia.inertia)) and i not in occupied and model.parents[i] == 0
        linear = len(c) == _LINEAR and c[0] == 0.0 and coupling.on is not None
        if fixed and empty and linear and coupling.joint not in leaders:
            found.append(TendonJoint(coupling.joint, i, coupling))
    return found


def write_tendons(
    loop: LoopModel,
    joints: Sequence[TendonJoint],
    data: Mapping[str, JointData],
    names: Names,
    tendons: Xml.Element,
    equalities: Xml.Element,
) -> None:
    """Write tendons that are joints, and couplings."""
    for joint in joints:
        entry = data.get(joint.name, JointData(joint.name))
        armature = float(loop.model.armature[loop.model.idx_vs[joint.joint]])
        values = {"damping": entry.damping, "frictionloss": entry.friction, "armature": armature}
        if entry.stiffness:
            values |= {"stiffness": entry.stiffness, "springlength": float(np.asarray(entry.rest))}
        acting = {
            key: numbers(value, exact=True) for key, value in values.items() if value or key == "springlength"
        }
        _fixed(
            tendons,
            joint.name,
            [(str(joint.coupling.on), joint.coupling.coefficients[1]), *joint.coupling.others],
            acting,
        )
    written = {joint.name for joint in joints}
    for coupling in loop.sidecar.couplings:
        if coupling.joint not in written:
            _coupling(coupling, names, tendons, equalities)


def _coupling(coupling: Coupling, names: Names, tendons: Xml.Element, equalities: Xml.Element) -> None:
    name = names.new(coupling.name or coupling.joint)
    coefficients = numbers(*(coupling.coefficients + (0.0,) * 5)[:5], exact=True)
    if not coupling.others:
        on = {} if coupling.on is None else {"joint2": coupling.on}
        sub(equalities, "joint", name=name, joint1=coupling.joint, **on, polycoef=coefficients)
        return
    _fixed(tendons, name, [(coupling.joint, 1.0), *((other, -factor) for other, factor in coupling.others)])
    on = {}
    if coupling.on is not None:
        on["tendon2"] = names.new(f"{name}_on")
        _fixed(tendons, on["tendon2"], [(coupling.on, 1.0)])
    sub(equalities, "tendon", name=name, tendon1=name, **on, polycoef=coefficients)


def _fixed(
    tendons: Xml.Element,
    name: str,
    joints: Sequence[tuple[str, float]],
    acting: Mapping[str, str] | None = None,
) -> None:
    tendon = sub(tendons, "fixed", name=name, **(acting or {}))
    for joint, factor in joints:
        sub(tendon, "joint", joint=joint, coef=numbers(factor, exact=True))


def turned(couplings: Sequence[Coupling], values: dict[str, FloatArray], circles: Collection[str]) -> None:
    """Count the turns of continuous joints that follow others: MuJoCo does."""
    left = {coupling.joint: coupling.leaders for coupling in couplings}
    by_joint = {coupling.joint: coupling for coupling in couplings}
    for joint in TopologicalSorter(left).static_order():
        if joint in by_joint and joint in circles:
            coupling = by_joint[joint]
            on = 0.0 if coupling.on is None else values[coupling.on][0]
            follows = np.polynomial.polynomial.polyval(on, coupling.coefficients)
            follows += sum(factor * values[other][0] for other, factor in coupling.others)
            whole = 2.0 * np.pi * np.round((follows - values[joint]) / (2.0 * np.pi))
            values[joint] = values[joint] + whole


_MJCF = "MJCF"
_UNLIMITED = 1e12  # what is written for a limit on one side only [m or rad]
_FREE = ("slide", "slide", "slide", "ball")


def text(loop: LoopModel) -> str:
    """Return a robot as MJCF.

    Bodies, joints and frames keep their names. A joint of several freedoms that MuJoCo does not have becomes
    hinges and slides, ``name_1``, ``name_2`` and so on; a body without mass in a row of joints is joined with
    the one behind it. Points and rigid connections are ``connect`` and ``weld`` between sites, hinges two of
    ``connect``; rods, and the right angle of universal joints, are tendons of a fixed length; sliders,
    cylindrical and planar joints get a carriage, see `mjcf_loops`. The keyframe ``reference`` has closed
    loops. Not in the file are speed limits, for which MJCF has no word, and shapes.
    """
    return _MjcfWriter(loop).text()


class _MjcfWriter:
    """Writes one robot."""

    def __init__(self, loop: LoopModel) -> None:
        self._loop, self._model = loop, loop.model
        model = loop.model
        self._data = {entry.joint: entry for entry in loop.sidecar.joint_data}
        self._ends = frame_ends(loop)
        self._tendons = tendon_joints(loop)
        held = {joint for pair in self._ends for joint, _ in pair}
        bodies = bodies_of(model, held, {tendon.joint for tendon in self._tendons}, _MJCF)
        self._joints = Names(_MJCF, [str(tendon.name) for tendon in self._tendons])
        for part in (part for body in bodies for part in body.parts):
            self._joints.own(part.name)
        self._bodies, self._sites = Names(_MJCF, ["world"]), Names(_MJCF)
        self._carriages = carriages_of(loop.sidecar.closures, self._ends, bodies, self._joints)
        with_least(model, bodies, _MJCF)
        self._list = bodies
        self._elements: dict[int, Xml.Element] = {}
        self._frames: dict[str, str] = {}
        self._roomless: list[str] = []
        self._loosened: dict[str, list[str]] = {}

    def text(self) -> str:
        """Return the file."""
        name = Names(_MJCF).new(str(self._model.name) or "robot")
        root, _ = mujoco(name, np.array(self._model.gravity.linear))
        self._elements[0] = sub(root, "worldbody")
        self._name_bodies()
        for body in self._list:
            self._body(body)
        for carriage in self._carriages:
            self._carriage(carriage)
        self._write_frames()
        tendons, equalities = Xml.Element("tendon"), Xml.Element("equality")
        names = Names(_MJCF, (tendon.name for tendon in self._tendons))
        write_tendons(self._loop, self._tendons, self._data, names, tendons, equalities)
        LoopWriter(self._loop, self._ends, self._site, names, tendons, equalities).write(self._carriages)
        root.extend(element for element in (tendons, equalities) if len(element))
        if self._roomless:
            some = ", ".join(shown(name) for name in self._roomless[:4])
            message = f"MJCF: limits that leave a joint no travel are not written: {some}"
            more = ", ..." if len(self._roomless) > 4 else ""
            warnings.warn(message + more, ModelWarning, stacklevel=4)
        self._actuators(root)
        self._keyframe(root)
        return document(root, f"{name}, written by p3dof.")

    def _name_bodies(self) -> None:
        """Give bodies the names of the frames that are theirs."""
        names: dict[int, str] = {}
        for frame in self._model.frames:
            if frame.type == pin.FrameType.BODY and frame.placement.isIdentity(1e-15) and frame.name:
                names.setdefault(int(frame.parentJoint), str(frame.name))
        chosen = {body.joint: names[body.joint] for body in self._list if body.joint in names}
        for name in chosen.values():
            self._bodies.own(name)
        for body in self._list:
            body.name = chosen.get(body.joint) or self._bodies.new(f"{body.name}_link")
        self._own = set(chosen.values())

    def _body(self, body: Body) -> None:
        element = sub(self._elements[body.parent], "body", name=body.name, **_pose(body.place))
        self._elements[body.joint] = element
        for part, at in body.seen():
            if part.kind == "free" and body.parent:
                self._loose(element, part)
            else:
                self._joint(element, part, at)
        _inertial(element, body.inertia)

    def _joint(self, element: Xml.Element, part: WrittenJoint, at: pin.SE3) -> None:
        shape = (
            {} if part.kind in ("ball", "free") else {"axis": numbers(at.rotation @ part.axis, exact=True)}
        )
        if part.kind != "free" and at.translation.any():
            shape["pos"] = numbers(at.translation, exact=True)
        sub(
            element,
            "joint",
            name=part.name,
            type=part.kind,
            **shape,
            **self._acting(part),
            **self._limits(part),
        )

    def _loose(self, element: Xml.Element, part: WrittenJoint) -> None:
        """Write a free joint between two bodies: MuJoCo has them to the world only."""
        if np.any(np.asarray(self._model.armature)[list(part.v)]):
            raise ModelError(
                f"MJCF: the free joint {shown(part.name)} has an armature, in axes that turn with it"
            )
        data = self._data.get(str(self._model.names[part.joint]))
        if data and data.friction:
            raise ModelError(
                f"MJCF: the free joint {shown(part.name)} has friction, in axes that turn with it"
            )
        damping = {"damping": numbers(data.damping, exact=True)} if data and data.damping else {}
        self._loosened[part.name] = names = [
            self._joints.new(f"{part.name}_{number}") for number in range(1, 5)
        ]
        for number, (name, kind) in enumerate(zip(names, _FREE, strict=True)):
            axis = {"axis": numbers(np.eye(3)[number])} if kind == "slide" else {}
            sub(element, "joint", name=name, type=kind, **axis, **damping)

    def _acting(self, part: WrittenJoint) -> dict[str, str]:
        """Return the rotor, spring, damping and friction of a joint as attributes."""
        model, name = self._model, str(self._model.names[part.joint])
        data = self._data.get(name, JointData(name))
        rotor = np.asarray(model.armature)[list(part.v)]
        if np.ptp(rotor):
            raise ModelError(f"MJCF: the joint {shown(name)} has rotors (armature) that differ")
        if part.turned and (rotor.any() or data.friction):
            what = "friction" if data.friction else "an armature"
            raise ModelError(
                f"MJCF: the joint {shown(name)} has {what} in axes that turn with it; MuJoCo's do not"
            )
        values = {"armature": rotor[0], "damping": data.damping, "frictionloss": data.friction}
        if data.stiffness:
            ball = part.kind == "ball" and data.rest in (0.0, (0.0, 0.0, 0.0, 1.0))
            if part.kind not in ("hinge", "slide") and not ball:
                raise ModelError(f"MJCF: the joint {shown(name)} of several freedoms has a spring")
            values |= {"stiffness": data.stiffness}
            if isinstance(data.rest, float):
                values |= {"springref": data.rest + data.force / data.stiffness}
            if model.nqs[part.joint] == 2:
                message = f"MJCF: the spring of the continuous joint {shown(name)} counts its turns in MuJoCo"
                warnings.warn(message, ModelWarning, stacklevel=6)
        elif data.force:
            raise ModelError(
                f"MJCF: the joint {shown(name)} has a constant force, which MuJoCo has with a spring only"
            )
        return {key: numbers(value, exact=True) for key, value in values.items() if value}

    def _limits(self, part: WrittenJoint) -> dict[str, str]:
        model, joint = self._model, part.joint
        found = {}
        if model.nvs[joint] == 1:
            at, to = model.idx_qs[joint], model.idx_vs[joint]
            effort = float(model.upperEffortLimit[to])
            if part.name in self._loop.actuated and 0 < effort < _UNLIMITED:
                found["actuatorfrcrange"] = numbers(-effort, effort, exact=True)
            if model.nqs[joint] == 1:
                limits = np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
                if limits[0] < limits[1]:
                    if np.any(np.abs(limits) < _UNLIMITED):
                        found["range"] = numbers(np.clip(limits, -_UNLIMITED, _UNLIMITED), exact=True)
                else:
                    self._roomless.append(part.name)
        return found

    def _carriage(self, carriage: Carriage) -> None:
        element = sub(
            self._elements[carriage.on], "body", name=self._bodies.new(carriage.name), **_pose(carriage.place)
        )
        for name, kind, axis in carriage.joints:
            sub(element, "joint", name=name, type=kind, axis=numbers(axis))
        _inertial(element, carriage.inertia)
        carriage.site = self._sites.new(carriage.name)
        sub(element, "site", name=carriage.site)

    def _write_frames(self) -> None:
        """Write frames as sites; not joints, and not those that bodies have the names of."""
        skipped = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
        needed = {end for c in self._loop.sidecar.closures for end in (c.frame1, c.frame2)}
        for pair, closure in zip(self._ends, self._loop.sidecar.closures, strict=True):
            for (joint, place), name in zip(pair, (closure.frame1, closure.frame2), strict=True):
                if name not in self._frames:
                    self._frames[name] = self._site(joint, place, name)
        for frame in list(self._model.frames)[1:]:
            name, joint = str(frame.name), int(frame.parentJoint)
            if frame.type in skipped or name in needed or name in self._own or joint not in self._elements:
                continue
            self._site(joint, frame.placement, name)

    def _site(self, joint: int, place: pin.SE3, name: str) -> str:
        """Write a site and return its name; the frame of a closure has one already."""
        if name in self._frames:
            return self._frames[name]
        chosen = self._sites.new(name)
        sub(self._elements[joint], "site", name=chosen, **_pose(place))
        return chosen

    def _actuators(self, root: Xml.Element) -> None:
        tendons = {tendon.name for tendon in self._tendons}
        if not self._loop.actuated:
            sub(sub(root, "custom"), "text", name="actuated", data="none")
            return
        motors = sub(root, "actuator")
        for name in self._loop.actuated:
            gear = numbers(self._data.get(name, JointData(name)).gear_ratio, exact=True)
            sub(motors, "motor", name=name, **{"tendon" if name in tendons else "joint": name}, gear=gear)

    def _keyframe(self, root: Xml.Element) -> None:
        """Write the reference configuration, its loops closed, in the order of the joints in the file."""
        model, q = self._model, closed_configuration(self._loop, _MJCF)
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        values: dict[str, FloatArray] = {}
        for joint in {part.joint for body in self._list for part in body.parts}:
            parts = [part for body in self._list for part in body.parts if part.joint == joint]
            values |= {p.name: value for p, value in zip(parts, values_of(parts, model, q), strict=True)}
        for name, parts_of_free in self._loosened.items():
            pose = values.pop(name)
            values |= dict(zip(parts_of_free, [*pose[:3, None], pose[3:]], strict=True))
        circles = {
            str(model.names[i]) for i in range(1, model.njoints) if (model.nqs[i], model.nvs[i]) == (2, 1)
        }
        turned(self._loop.sidecar.couplings, values, circles)
        for carriage in self._carriages:
            names = [name for name, *_ in carriage.joints]
            values |= dict(zip(names, carriage.values(data.oMi), strict=True))
        order = [values[str(joint.get("name"))] for joint in self._elements[0].iter("joint")]
        if order:
            sub(sub(root, "keyframe"), "key", name="reference", qpos=numbers(*order, exact=True))


def _pose(place: pin.SE3) -> dict[str, str]:
    """Return the attributes of a placement."""
    found = {}
    if place.translation.any():
        found["pos"] = numbers(place.translation, exact=True)
    if np.any(place.rotation != np.eye(3)):
        x, y, z, w = pin.Quaternion(place.rotation).coeffs()
        found["quat"] = numbers(w, x, y, z, exact=True)
    return found


def _inertial(element: Xml.Element, inertia: Any) -> None:
    moments, axes = principal(inertia)
    if np.array_equal(inertia.inertia, np.diag(np.diag(inertia.inertia))):
        moments, axes = np.diag(inertia.inertia).copy(), np.eye(3)
    largest = int(np.argmax(moments))
    moments[largest] = min(moments[largest], moments.sum() - moments[largest])  # but for the rounding, it is
    pose = _pose(pin.SE3(axes, np.array(inertia.lever)))
    pose.setdefault("pos", "0 0 0")
    mass = numbers(float(inertia.mass), exact=True)
    sub(element, "inertial", mass=mass, diaginertia=numbers(moments, exact=True), **pose)
