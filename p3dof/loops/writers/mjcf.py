"""Any robot written as MJCF: tree, closures, couplings, motors and the reference configuration."""

from __future__ import annotations

import warnings
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError, ModelWarning
from p3dof._base.markup import document, numbers, sub
from p3dof._base.markup.mjcf import option, stiff_equalities
from p3dof.loops.joint_data import JointData
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.writers.bodies import Body, bodies_of, principal, with_least
from p3dof.loops.writers.chains import Part, values_of
from p3dof.loops.writers.frames import closed_configuration, frame_ends
from p3dof.loops.writers.mjcf_loops import Carriage, LoopWriter, carriages_of
from p3dof.loops.writers.mjcf_tendons import tendon_joints, turned, write_tendons
from p3dof.loops.writers.names import Names

_MJCF = "MJCF"
_UNLIMITED = 1e12
"""What is written for a limit on one side only [m or rad]."""
_FREE = ("slide", "slide", "slide", "ball")


def text(loop: LoopModel) -> str:
    """Return a robot as MJCF.

    Bodies, joints and frames keep their names. A joint of several freedoms that MuJoCo does not have becomes
    hinges and slides, ``name_1``, ``name_2`` and so on; a body without mass in a row of joints is joined with
    the one behind it. Points and rigid connections are ``connect`` and ``weld`` between sites, hinges two of
    ``connect``; rods, and the right angle of universal joints, are tendons of a fixed length; sliders,
    cylindrical and planar joints get a carriage, see `mjcf_loops`. The keyframe ``reference`` has closed
    loops. Not in the file are speed limits, for which MJCF has no word, and shapes.

    Parameters
    ----------
    loop : LoopModel
        The robot.

    Returns
    -------
    str

    Raises
    ------
    ModelError
        If the robot has something that MJCF cannot hold; the message names it.

    Warns
    -----
    ModelWarning
        If limits are left out that are none, or a spring will count the turns of a continuous joint.
    """
    return _Writer(loop).text()


class _Writer:
    """Writes one robot.

    Parameters
    ----------
    loop : LoopModel
        The robot.
    """

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
        root = Xml.Element("mujoco", model=Names(_MJCF).new(str(self._model.name) or "robot"))
        sub(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
        option(root, np.array(self._model.gravity.linear))
        stiff_equalities(root)
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
            message = f"MJCF: limits that leave a joint no room are not written: {some}"
            more = ", ..." if len(self._roomless) > 4 else ""
            warnings.warn(message + more, ModelWarning, stacklevel=4)
        self._actuators(root)
        self._keyframe(root)
        return document(root, f"{root.get('model')}, written by p3dof.")

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

    def _joint(self, element: Xml.Element, part: Part, at: pin.SE3) -> None:
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

    def _loose(self, element: Xml.Element, part: Part) -> None:
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

    def _acting(self, part: Part) -> dict[str, str]:
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

    def _limits(self, part: Part) -> dict[str, str]:
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
            self._elements[carriage.on],
            "body",
            name=self._bodies.new(carriage.name),
            **_pose(carriage.place),
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
