"""MJCF: the tree and its equality constraints, as MuJoCo's own compiler understands the file.

Defaults, includes, angles, frames and inertias of shapes are MuJoCo's business: what it compiles is
translated number by number. (Pinocchio 4.1 reads MJCF too, but drops a second body of the world, takes
constraints that are switched off for active, and leaves joint equalities out.) Contacts, tendons and shapes
are not read.

References
----------
MuJoCo documentation, XML reference and "Computation": order of the joints of a body, ``eq_data``.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any
from warnings import warn
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof.checks import LARGEST, FloatArray, one_line, shown
from p3dof.closed_loop.joint_data import JointData
from p3dof.closed_loop.sidecar import Closure, Coupling, Sidecar, suggestion
from p3dof.closed_loop.trees import add_frame
from p3dof.closed_loop.urdf import MAX_FREEDOMS, MAX_LINKS
from p3dof.closed_loop.xml_text import XmlReader, check_includes, is_text, read_xml
from p3dof.errors import MissingExtraError, ModelError, ModelWarning

_EXTRA = "MJCF files are compiled by MuJoCo: pip install 'p3dof[mjcf]'"
_TURNS = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
_SLIDES = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)


def read(source: str | os.PathLike[str], key: str | None = None) -> tuple[pin.Model, Sidecar]:
    """Return the tree of an MJCF file and its loops.

    Parameters
    ----------
    source : str or path-like
        XML text or the path of a file.
    key : str, optional
        The keyframe that is the reference configuration; the first one by default.

    Returns
    -------
    model : pin.Model
        Coordinates of hinges and slides are MuJoCo's ``qpos``; quaternions are in Pinocchio's order.
    sidecar : Sidecar
        Actuated are the joints that have an actuator.

    Raises
    ------
    ModelError
        If the file is malformed or too large, or ties bodies by something that is not understood.
    MissingExtraError
        If MuJoCo is not installed.
    """
    return _Translation(_compiled(source), key).result()


def _compiled(source: str | os.PathLike[str]) -> Any:
    """Return MuJoCo's model of a file, whose meshes need not be there."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError(_EXTRA) from error
    text, name = read_xml(source, "MJCF")
    robot = XmlReader(name).parse(text)
    if robot.tag != "mujoco":
        raise ModelError(f"{name}: expected the element <mujoco>, got <{robot.tag:.80}>")
    check_includes(robot, source, name)
    _check_numbers(robot, name)
    try:
        spec = mujoco.MjSpec.from_string(text) if is_text(source) else mujoco.MjSpec.from_file(name)
        _without_files(mujoco, spec)
        compiled = spec.compile()
    except Exception as error:  # ValueError, and what MuJoCo's bindings raise beside it
        raise ModelError(f"{name}: MuJoCo cannot compile it: {one_line(str(error))}") from error
    for field in ("body_mass", "body_inertia", "body_pos", "body_ipos", "jnt_pos", "dof_armature", "eq_data"):
        numbers = getattr(compiled, field)
        if not np.all(np.abs(numbers) < LARGEST):  # also what is not a number
            raise ModelError(f"{name}: MuJoCo compiles numbers that are too large, or none, into {field}")
    return compiled


def _check_numbers(robot: Xml.Element, name: str) -> None:
    """Refuse NaN: MuJoCo only warns of it, and in MuJoCo 4.0 such a warning can go on for ever."""
    for element in robot.iter():
        for attribute, text in element.attrib.items():
            if (
                any(word.lower().lstrip("+-").startswith("nan") for word in text.split())
                and attribute != "name"
            ):
                raise ModelError(
                    f"{name}: <{element.tag:.80}> {attribute:.80}: expected numbers, got {shown(text)}"
                )


def _without_files(mujoco: Any, spec: Any) -> None:
    """Take out what only shows, textures and meshes that no mass comes from: the files need not be there."""
    from_file = {mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD}
    for geom in list(spec.geoms):
        geom.material = ""
        stated = geom.parent.explicitinertial or geom.parent.name == "world"
        if geom.type in from_file and (stated or geom.mass == 0 or geom.density == 0):
            _delete(spec, geom)
    for site in spec.sites:
        site.material = ""
    weighed = {geom.meshname for geom in spec.geoms}
    meshes = [mesh for mesh in spec.meshes if mesh.name not in weighed]
    for asset in (*spec.skins, *spec.materials, *spec.textures, *spec.hfields, *meshes):
        _delete(spec, asset)


def _delete(spec: Any, element: Any) -> None:
    if hasattr(spec, "delete"):
        spec.delete(element)
    else:  # before MuJoCo 3.3.3
        element.delete()


class _Translation:
    """Turns MuJoCo's compiled model into a tree and a sidecar.

    Parameters
    ----------
    compiled : mujoco.MjModel
        The model.
    key : str, optional
        Name of a keyframe.
    """

    def __init__(self, compiled: Any, key: str | None) -> None:
        import mujoco

        self._m, self._key, self._types = compiled, key, mujoco
        self._model = pin.Model()
        self._model.name = compiled.names.split(b"\0", 1)[0].decode("utf-8", "replace")
        self._model.gravity.linear = np.array(compiled.opt.gravity)
        self._joints: list[str] = []
        self._bodies: list[tuple[int, pin.SE3, int]] = [(0, pin.SE3.Identity(), 0)]
        self._frames: set[str] = {"universe"}
        self._sites: list[str] = []

    def result(self) -> tuple[pin.Model, Sidecar]:
        """Return the tree and its sidecar."""
        m = self._m
        if m.nbody > MAX_LINKS or m.nv > MAX_FREEDOMS:
            raise ModelError(
                f"MJCF: expected at most {MAX_LINKS} bodies and {MAX_FREEDOMS} degrees of freedom, got "
                f"{m.nbody} and {m.nv}"
            )
        for body in range(1, m.nbody):
            self._add_body(body)
        for site in range(m.nsite):
            name, place = self._name(m.site, site, "site"), _place(m.site_pos[site], m.site_quat[site])
            self._sites.append(self._add_frame(name, m.site_bodyid[site], place))
        self._give_data()
        closures, couplings = self._equalities()
        sidecar = Sidecar(closures, self._actuated(), couplings, self._reference())
        return self._model, replace(sidecar, joint_data=self._joint_data())

    def _add_body(self, body: int) -> None:
        m = self._m
        joint, above, frame = self._bodies[m.body_parentid[body]]
        place = above * _place(m.body_pos[body], m.body_quat[body])
        first = m.body_jntadr[body]
        for number in range(first, first + m.body_jntnum[body]):
            name = self._name(m.joint, number, "joint")
            model, start, end = self._joint(number, place)
            joint = self._model.addJoint(joint, model, start, name)
            frame = self._model.addFrame(
                pin.Frame(name, joint, frame, pin.SE3.Identity(), pin.FrameType.JOINT)
            )
            self._joints.append(name)
            place = end
        inertial = _place(m.body_ipos[body], m.body_iquat[body])
        inertia = pin.Inertia(float(m.body_mass[body]), np.zeros(3), np.diag(m.body_inertia[body]))
        self._model.appendBodyToJoint(joint, inertia, place * inertial)
        name = self._unused(self._name(m.body, body, "body"))
        frame = self._model.addFrame(pin.Frame(name, joint, frame, place, pin.FrameType.BODY))
        self._bodies.append((joint, place, frame))

    def _joint(self, number: int, place: pin.SE3) -> tuple[Any, pin.SE3, pin.SE3]:
        """Return a joint, where it is, and where the body is seen from behind it.

        MuJoCo's coordinates count from ``qpos0``, at which the body is where the file has it.
        """
        m, kinds = self._m, self._types.mjtJoint
        kind = kinds(int(m.jnt_type[number]))
        anchor, axis = m.jnt_pos[number], m.jnt_axis[number]
        if kind == kinds.mjJNT_FREE:
            return pin.JointModelFreeFlyer(), pin.SE3.Identity(), pin.SE3.Identity()
        back = pin.SE3(np.eye(3), -anchor)
        at = place * back.inverse()
        if kind == kinds.mjJNT_BALL:
            return pin.JointModelSpherical(), at, back
        zero = float(m.qpos0[m.jnt_qposadr[number]])
        if kind == kinds.mjJNT_HINGE:
            turned = pin.SE3(pin.exp3(-zero * axis), np.zeros(3))
            return _about(axis, _TURNS, pin.JointModelRevoluteUnaligned), at * turned, back
        moved = pin.SE3(np.eye(3), -zero * axis)
        return _about(axis, _SLIDES, pin.JointModelPrismaticUnaligned), at * moved, back

    def _give_data(self) -> None:
        """Give the joints their armature, damping, friction and limits."""
        m, model = self._m, self._model
        model.armature = np.array(m.dof_armature)
        model.damping = np.array(m.dof_damping)
        model.upperDryFrictionLimit = np.array(m.dof_frictionloss)
        model.lowerDryFrictionLimit = -np.array(m.dof_frictionloss)
        lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        for number, name in enumerate(self._joints):
            joint = model.getJointId(name)
            if m.jnt_limited[number] and model.nqs[joint] == 1:
                lower[model.idx_qs[joint]], upper[model.idx_qs[joint]] = m.jnt_range[number]
        model.lowerPositionLimit, model.upperPositionLimit = lower, upper

    def _joint_data(self) -> tuple[JointData, ...]:
        """Return springs, damping and friction; MuJoCo has springs in balls and free joints too."""
        m, found = self._m, []
        for number, name in enumerate(self._joints):
            stiffness, rest = float(m.jnt_stiffness[number]), 0.0
            if self._model.nvs[self._model.getJointId(name)] == 1:
                rest = float(m.qpos_spring[m.jnt_qposadr[number]])
            elif stiffness:
                raise ModelError(f"MJCF: the joint {shown(name)} of several freedoms has a spring: not read")
            dof = m.jnt_dofadr[number]
            losses = float(m.dof_damping[dof]), float(m.dof_frictionloss[dof])
            found.append(JointData(name, stiffness, rest, *losses))
        return tuple(found)

    def _equalities(self) -> tuple[tuple[Closure, ...], tuple[Coupling, ...]]:
        m, kinds = self._m, self._types.mjtEq
        closures, couplings = [], []
        for number in range(m.neq):
            kind = kinds(int(m.eq_type[number]))
            if not m.eq_active0[number]:
                continue
            if kind == kinds.mjEQ_JOINT:
                couplings.append(self._coupling(number))
            elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                closures.append(self._closure(number, "3d" if kind == kinds.mjEQ_CONNECT else "6d"))
            else:
                called = shown(self._name(m.equality, number, "equality"))
                words = str(kind).rsplit("_", 1)[-1].lower()
                raise ModelError(f"MJCF: the equality {called} ties {words}s, which is not understood")
        return tuple(closures), tuple(couplings)

    def _closure(self, number: int, kind: str) -> Closure:
        m, data = self._m, self._m.eq_data[number]
        name = self._name(m.equality, number, "equality")
        ends = int(m.eq_obj1id[number]), int(m.eq_obj2id[number])
        if self._types.mjtObj(int(m.eq_objtype[number])) == self._types.mjtObj.mjOBJ_SITE:
            return Closure(self._sites[ends[0]], self._sites[ends[1]], kind)
        if kind == "3d":
            places = [_place(data[:3]), _place(data[3:6])]
        else:  # MuJoCo: body 1 at (relpose), body 2 at the anchor
            places = [_place(data[3:6], data[6:10]), _place(data[:3])]
        frames = [
            self._add_frame(f"{name}_{end}", body, place)
            for end, body, place in zip((1, 2), ends, places, strict=True)
        ]
        return Closure(frames[0], frames[1], kind)

    def _coupling(self, number: int) -> Coupling:
        """Return q1 - q1₀ = p(q2 - q2₀) as a polynomial in q2."""
        m = self._m
        joints = int(m.eq_obj1id[number]), int(m.eq_obj2id[number])
        name = self._name(m.equality, number, "equality")
        zeros = [float(m.qpos0[m.jnt_qposadr[joint]]) for joint in joints if joint >= 0]
        polynomial = np.polynomial.Polynomial(m.eq_data[number, :5])
        driven = self._name(m.joint, joints[0], "joint")
        if joints[1] < 0:
            return Coupling(driven, None, (zeros[0] + float(polynomial.coef[0]),), name)
        shifted = polynomial(np.polynomial.Polynomial([-zeros[1], 1.0])) + zeros[0]
        coefficients = tuple(float(c) for c in shifted.trim().coef)
        return Coupling(driven, self._name(m.joint, joints[1], "joint"), coefficients, name)

    def _actuated(self) -> tuple[str, ...]:
        """Return the joints with an actuator; all with one degree of freedom where there is none at all."""
        m = self._m
        if not m.nu:
            return Sidecar.serial(self._model).actuated
        names: dict[str, None] = {}
        for number in range(m.nu):
            kind = self._types.mjtTrn(int(m.actuator_trntype[number]))
            target = int(m.actuator_trnid[number, 0])
            if kind in (self._types.mjtTrn.mjTRN_JOINT, self._types.mjtTrn.mjTRN_JOINTINPARENT):
                names[self._name(m.joint, target, "joint")] = None
            else:
                called = self._name(m.actuator, number, "actuator")
                message = f"MJCF: the actuator {called!r} acts on no joint and is left out"
                warn(message, ModelWarning, stacklevel=5)
        return tuple(name for name in names if self._model.nvs[self._model.getJointId(name)] == 1)

    def _reference(self) -> dict[str, Any] | None:
        m = self._m
        names = [self._name(m.key, number, "key") for number in range(m.nkey)]
        if self._key is not None and self._key not in names:
            raise ModelError(f"keyframe {shown(self._key)} does not exist; {suggestion(self._key, names)}")
        if not names:
            return None
        q = m.key_qpos[0 if self._key is None else names.index(self._key)]
        return {name: self._values(q, number) for number, name in enumerate(self._joints)}

    def _values(self, q: FloatArray, number: int) -> Any:
        """Return the values of a joint in Pinocchio's order: quaternions end with their scalar."""
        start, kinds = int(self._m.jnt_qposadr[number]), self._types.mjtJoint
        kind = kinds(int(self._m.jnt_type[number]))
        if kind == kinds.mjJNT_FREE:
            return (*q[start : start + 3], *q[start + 4 : start + 7], q[start + 3])
        if kind == kinds.mjJNT_BALL:
            return (*q[start + 1 : start + 4], q[start])
        return float(q[start])

    def _add_frame(self, name: str, body: int, placement: pin.SE3) -> str:
        name = self._unused(name)
        add_frame(self._model, name, self._bodies[int(body)][2], placement)
        return name

    def _unused(self, name: str) -> str:
        while name in self._frames:
            name += "_"
        self._frames.add(name)
        return name

    def _name(self, access: Any, number: int, what: str) -> str:
        return str(access(number).name) or f"{what}_{number}"


def _place(position: FloatArray, quaternion: FloatArray | None = None) -> pin.SE3:
    """Return a placement from MuJoCo's numbers; its quaternions begin with their scalar."""
    rotation = np.eye(3)
    if quaternion is not None:
        w, x, y, z = (float(number) for number in quaternion)
        rotation = pin.Quaternion(w, x, y, z).normalized().matrix()
    return pin.SE3(rotation, np.array(position, dtype=float))


def _about(axis: FloatArray, aligned: Any, unaligned: Any) -> Any:
    for kind, direction in zip(aligned, np.eye(3), strict=True):
        if np.array_equal(axis, direction):
            return kind()
    return unaligned(np.array(axis, dtype=float))
