"""Any robot written as URDF and sidecar, which read back to the same robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import shown
from p3dof._base.errors import ModelError
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.sidecar import JointData, Sidecar

_UNLIMITED = 1e12  # what is written for a limit that is infinite: URDF has no word for it [SI]
_GRAVITY = (0.0, 0.0, -9.81)  # what a URDF is read with [m/s²]
_WHOLE = {"JointModelFreeFlyer": "floating", "JointModelPlanar": "planar"}


def texts(loop: LoopModel) -> tuple[str, str]:
    """Return a robot as URDF and sidecar.

    What `p3dof.load_robot` reads back to a robot with the same motions and forces.
    """
    model = loop.model
    if not np.allclose(model.gravity.vector, (*_GRAVITY, 0.0, 0.0, 0.0), rtol=0, atol=1e-12):
        raise ModelError(
            "URDF: the gravity of the robot is not 9.81 m/s² downward, which URDF cannot represent"
        )
    needed = [end for c in loop.sidecar.closures for end in (c.frame1, c.frame2)]
    needed += [end for bushing in loop.sidecar.bushings for end in bushing.frames]
    writer = _UrdfWriter(model, needed)
    return writer.text(), _sidecar(loop, writer.balls).to_yaml()


def _sidecar(loop: LoopModel, balls: Iterable[str]) -> Sidecar:
    data = {entry.joint: entry for entry in loop.sidecar.joint_data}
    model = loop.model
    for i in range(1, model.njoints):
        rotor = np.asarray(model.armature)[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]]
        name = str(model.names[i])
        own = data.get(name, JointData(name)).reflected_inertia
        rotor = np.where(np.abs(rotor - own) <= 1e-15 * own, 0.0, rotor - own)
        if rotor.any():
            if np.ptp(rotor):
                raise ModelError(f"URDF: the joint {shown(name)} has rotors (armature) that differ")
            data[name] = replace(data.get(name, JointData(name)), armature=float(rotor[0]))
    joints = tuple((name, "SPHERICAL") for name in balls)
    return replace(loop.sidecar, joints=joints, joint_data=tuple(data.values()))


class _UrdfWriter:
    """Writes one tree."""

    def __init__(self, model: pin.Model, needed: list[str]) -> None:
        self._model, self._data = model, model.createData()
        pin.computeJointJacobians(model, self._data, pin.neutral(model))
        self._root = Xml.Element("robot", name=str(model.name) or "robot")
        self._taken: set[str] = set()
        self.balls: list[str] = []
        frames = list(model.frames)[1:]
        bodies = [f for f in frames if f.type == pin.FrameType.BODY]
        skipped = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
        others = [f for f in frames if f.type not in skipped or (f.name in needed and f.type == skipped[1])]
        reserved = {str(frame.name) for frame in frames}
        self._links: dict[int, str] = {}
        for i in range(model.njoints):
            own = [f for f in bodies if f.parentJoint == i and f.placement.isIdentity(1e-15)]
            name = str(own[0].name) if own else "base" if i == 0 else f"{model.names[i]}_link"
            while not own and name in reserved:
                name += "_"
            self._links[i] = name
            self._link(name, model.inertias[i] if i else None)
        for i in range(1, model.njoints):
            self._joint(i)
        for frame in others:
            self._frame(frame)

    def text(self) -> str:
        """Return the file."""
        Xml.indent(self._root)
        return Xml.tostring(self._root, encoding="unicode", xml_declaration=False) + "\n"

    def _link(self, name: str, body: Any = None) -> None:
        self._taken.add(name)
        link = Xml.SubElement(self._root, "link", name=name)
        if body is None or not (body.mass or np.any(body.inertia)):
            return
        inertial = Xml.SubElement(link, "inertial")
        Xml.SubElement(inertial, "origin", xyz=_numbers(body.lever), rpy="0 0 0")
        Xml.SubElement(inertial, "mass", value=repr(float(body.mass)))
        matrix = np.array(body.inertia)
        names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        Xml.SubElement(inertial, "inertia", {name: repr(float(matrix[at])) for name, at in names.items()})

    def _joint(self, i: int) -> None:
        model, name = self._model, str(self._model.names[i])
        kind, axis = self._kind(i)
        joint = Xml.SubElement(self._root, "joint", name=name, type=kind)
        Xml.SubElement(joint, "parent", link=self._links[int(model.parents[i])])
        Xml.SubElement(joint, "child", link=self._links[i])
        _origin(joint, model.jointPlacements[i])
        if axis is not None:
            Xml.SubElement(joint, "axis", xyz=_numbers(axis))
        if kind in ("revolute", "prismatic"):
            at, to = model.idx_qs[i], model.idx_vs[i]
            values = {
                "lower": model.lowerPositionLimit[at],
                "upper": model.upperPositionLimit[at],
                "effort": model.upperEffortLimit[to],
                "velocity": model.upperVelocityLimit[to],
            }
            bounded = {key: repr(float(np.clip(x, -_UNLIMITED, _UNLIMITED))) for key, x in values.items()}
            Xml.SubElement(joint, "limit", bounded)
        if model.nvs[i] == 1:
            to = model.idx_vs[i]
            losses = float(model.damping[to]), float(model.upperDryFrictionLimit[to])
            if any(losses):
                Xml.SubElement(joint, "dynamics", damping=repr(losses[0]), friction=repr(losses[1]))

    def _kind(self, i: int) -> tuple[str, Any]:
        """Return the type of a joint, and its axis."""
        short = str(self._model.joints[i].shortname())
        if short in _WHOLE:
            return _WHOLE[short], None
        if short == "JointModelSpherical":
            self.balls.append(str(self._model.names[i]))
            return "continuous", np.eye(3)[2]
        if self._model.nvs[i] != 1 or not short.startswith(("JointModelR", "JointModelP")):
            raise ModelError(
                f"URDF: the joint {shown(str(self._model.names[i]))} is a {short}, which no URDF knows"
            )
        column = pin.getJointJacobian(self._model, self._data, i, pin.LOCAL)[:, self._model.idx_vs[i]]
        sliding = short.startswith("JointModelP")
        axis = column[:3] if sliding else column[3:]
        if sliding:
            return "prismatic", axis
        return ("continuous" if self._model.nqs[i] == 2 else "revolute"), axis

    def _frame(self, frame: Any) -> None:
        """Write a frame as a link without mass."""
        name = str(frame.name)
        if name in self._taken:
            return
        self._link(name)
        joint = Xml.SubElement(self._root, "joint", name=f"{name}_is_fixed", type="fixed")
        Xml.SubElement(joint, "parent", link=self._links[int(frame.parentJoint)])
        Xml.SubElement(joint, "child", link=name)
        _origin(joint, frame.placement)


def _origin(parent: Xml.Element, placement: pin.SE3) -> None:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    Xml.SubElement(parent, "origin", xyz=_numbers(placement.translation), rpy=_numbers(rpy))


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
