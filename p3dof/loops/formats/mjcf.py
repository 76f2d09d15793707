"""MJCF: the tree and its equality constraints, as MuJoCo's own compiler understands the file.

Defaults, includes, angles, frames and inertias of shapes are MuJoCo's business: what it compiles is
translated number by number. (Pinocchio 4.1 reads MJCF too, but drops a second body of the world, takes
constraints that are switched off for active, and leaves joint equalities out.) Contacts and shapes are not
read.

A fixed tendon of several joints that has an actuator, a spring or a damper becomes a joint of its own: it has
no mass, the tendon's name and its length, and a coupling makes the joints move with it. What else would act
and is left out is told.

References
----------
MuJoCo documentation, XML reference and "Computation": order of the joints of a body, ``eq_data``.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from warnings import warn

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError, ModelWarning
from p3dof.loops.coordinates import add_frame
from p3dof.loops.formats.mjcf_file import compiled
from p3dof.loops.formats.urdf import MAX_FREEDOMS, MAX_LINKS
from p3dof.loops.sidecar import Closure, Coupling, JointData, Sidecar, check_couplings, suggestion

_SLIDE = 2  # of `mujoco.mjtJoint`


def acting(m: Any, number: int) -> bool:
    """Return whether something acts in a tendon by itself."""
    fields = m.tendon_stiffness, m.tendon_damping, m.tendon_frictionloss, tendon_armature(m)
    return any(bool(field[number]) for field in fields)


def tendon_armature(m: Any) -> FloatArray:
    """Return the inertia of all tendons, which they have since MuJoCo 3.3.1; (ntendon,)."""
    return np.array(getattr(m, "tendon_armature", np.zeros(m.ntendon)))


def lifting(m: Any, gravity: FloatArray) -> dict[int, float]:
    """Return the compensation of gravity as forces [N] of slides that alone carry a body, by joint number."""
    found: dict[int, float] = {}
    for body in np.flatnonzero(m.body_gravcomp > 0):
        slide = _slide_of(m, int(body))
        if slide is not None:
            number, axis = slide
            weight = -float(m.body_mass[body]) * float(np.dot(gravity, axis))
            found[number] = found.get(number, 0.0) + float(m.body_gravcomp[body]) * weight
    return found


def _slide_of(m: Any, body: int) -> tuple[int, FloatArray] | None:
    """Return the slide by which alone a body moves, and its axis in the world; None if there is more."""
    joints: list[int] = []
    rotation, found = np.eye(3), body
    while body:
        first = int(m.body_jntadr[body])
        joints += range(first, first + int(m.body_jntnum[body]))
        body = int(m.body_parentid[body])
    if len(joints) != 1 or m.jnt_type[joints[0]] != _SLIDE or m.jnt_actgravcomp[joints[0]]:
        return None
    body = int(m.jnt_bodyid[joints[0]])
    while body:
        rotation = _matrix(m.body_quat[body]) @ rotation
        body = int(m.body_parentid[body])
    return (joints[0], rotation @ m.jnt_axis[joints[0]]) if found else None


def _not_lifting(m: Any) -> Iterator[str]:
    for body in np.flatnonzero(m.body_gravcomp > 0):
        if _slide_of(m, int(body)) is None:
            yield f"the compensation of gravity of the body {shown(str(m.body(int(body)).name))}"


def _matrix(quaternion: FloatArray) -> FloatArray:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def left_out(m: Any, tendons: Collection[int]) -> Iterator[str]:
    """Yield words for what acts and is not read."""
    for number in range(m.ntendon):
        called = f"the tendon {shown(str(m.tendon(number).name))}"
        if number in tendons:
            low, high = m.tendon_lengthspring[number]
            if m.tendon_stiffness[number] and low != high:
                yield f"the spring of {called}, which is slack between two lengths"
        elif acting(m, number):
            yield f"what acts in {called}, which is not fixed to joints"
    if hasattr(m, "actuator_damping"):
        for number in np.flatnonzero(m.actuator_damping):
            yield f"the damping of the actuator {shown(str(m.actuator(int(number)).name))}"
    for number in range(m.njnt):
        called = f"the joint {shown(str(m.joint(number).name))}"
        dofs = np.flatnonzero(m.dof_jntid == number)
        if _any(m, "jnt_stiffnesspoly", number) or _any(m, "dof_dampingpoly", dofs):
            yield f"the higher powers of the spring or damper of {called}"
        if m.jnt_type[number] == 0 and m.dof_armature[dofs].any():
            yield f"that the armature of {called} is in axes of the world"
    yield from _not_lifting(m)
    if m.opt.density or m.opt.viscosity:
        yield "the fluid around the robot"


def _any(m: Any, field: str, which: Any) -> bool:
    """Whether an array of newer versions of MuJoCo has entries there that are not zero."""
    return hasattr(m, field) and bool(np.any(getattr(m, field)[which]))


_LINEAR = 2  # coefficients of a polynomial of degree one


@dataclass(frozen=True)
class Tendon:
    """A tendon."""

    name: str  # what to call it
    start: float  # its length at `qpos0` [m or rad]
    joints: Mapping[str, float]  # of a fixed tendon, its joints and how much of each its length is
    sites: tuple[int, ...] = ()  # of a straight tendon between two sites, these


def tendon(m: Any, number: int, name: str, joints: Sequence[str]) -> Tendon:
    """Return a tendon of a compiled model; one that is neither fixed nor straight has nothing in it."""
    import mujoco

    parts = range(m.tendon_adr[number], m.tendon_adr[number] + m.tendon_num[number])
    kinds = {mujoco.mjtWrap(int(m.wrap_type[part])) for part in parts}
    start = float(m.tendon_length0[number])
    if kinds == {mujoco.mjtWrap.mjWRAP_JOINT}:
        terms: dict[str, float] = {}
        for part in parts:
            joint = joints[m.wrap_objid[part]]
            terms[joint] = terms.get(joint, 0.0) + float(m.wrap_prm[part])
        return Tendon(name, start, {joint: factor for joint, factor in terms.items() if factor})
    straight = kinds == {mujoco.mjtWrap.mjWRAP_SITE} and len(parts) == 2
    return Tendon(name, start, {}, tuple(int(m.wrap_objid[part]) for part in parts) if straight else ())


def tied(
    name: str,
    one: Tendon,
    other: Tendon | None,
    polynomial: Sequence[float],
    sites: Sequence[str],
    others: Sequence[Coupling],
) -> Closure | Coupling:
    """Return an equality of tendons as a rod between two sites, or a coupling of joints of fixed tendons."""
    if one.sites and other is None:
        first, second = (sites[site] for site in one.sites)
        return Closure(first, second, "distance", one.start + polynomial[0])
    if not one.joints or (other is not None and not other.joints):
        raise ModelError(
            f"MJCF: the equality {shown(name)} ties tendons that are neither fixed nor, one alone, straight "
            "between two sites: it is not understood"
        )
    p = np.polynomial.Polynomial([polynomial[0]])
    if other is not None:
        p = np.polynomial.Polynomial(polynomial).trim()
    joints, start = dict(one.joints), one.start
    if other is not None and len(p.coef) == _LINEAR:  # all joints on one side
        for joint, factor in other.joints.items():
            joints[joint] = joints.get(joint, 0.0) - p.coef[1] * factor
        constant = start + p.coef[0] - p.coef[1] * other.start
        return _coupling(name, {j: f for j, f in joints.items() if f}, None, np.array([constant]), others)
    if other is None or len(p.coef) == 1:
        return _coupling(name, joints, None, np.array([start + p.coef[0]]), others)
    if len(other.joints) > 1:
        raise ModelError(
            f"MJCF: the equality {shown(name)} is a polynomial in the length of a tendon over "
            f"{len(other.joints)} joints, which is not understood"
        )
    ((leader, factor),) = other.joints.items()
    return _coupling(
        name, joints, leader, (p(np.polynomial.Polynomial([-other.start, factor])) + start).coef, others
    )


def _coupling(
    name: str, joints: Mapping[str, float], leader: str | None, constant: Any, others: Sequence[Coupling]
) -> Coupling:
    """Return Σ factor q = constant, or that polynomial in the value of the leader, solved for some joint."""
    failed = None
    for joint, factor in joints.items():
        rest = {other: -f / factor for other, f in joints.items() if other != joint}
        coefficients = [float(c) / factor for c in constant]
        on = leader
        if leader is None and rest:
            on = next(iter(rest))
            coefficients.append(rest.pop(on))
        try:
            found = Coupling(joint, on, tuple(coefficients), name, tuple(rest.items()))
            check_couplings("MJCF", [*others, found])
        except ModelError as error:
            failed = error
        else:
            return found
    raise failed or ModelError(f"MJCF: the equality {shown(name)} ties no joint")


def pulled(one: Tendon) -> Coupling:
    """Return what makes the joint of a fixed tendon have its length."""
    (first, factor), *rest = one.joints.items()
    return Coupling(one.name, first, (0.0, factor), f"tendon {one.name}", tuple(rest))


_TURNS = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
_SLIDES = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
_SPRINGS = "jnt_stiffness", "jnt_stiffnesspoly", "tendon_stiffness", "tendon_stiffnesspoly"
_DAMPERS = "dof_damping", "dof_dampingpoly", "tendon_damping", "tendon_dampingpoly", "actuator_damping"
_FRICTION = "dof_frictionloss", "tendon_frictionloss"
_OFF = {  # flags of MuJoCo that disable, and the arrays that have no effect then
    "SPRING": _SPRINGS,
    "DAMPER": _DAMPERS,
    "PASSIVE": _SPRINGS + _DAMPERS,  # MuJoCo before 3.3.6
    "FRICTIONLOSS": _FRICTION,
    "LIMIT": ("jnt_limited",),
    "EQUALITY": ("eq_active0",),
    "CONSTRAINT": (*_FRICTION, "jnt_limited", "eq_active0"),
}
_UNIT = 1e-9  # how far the length of an axis may be from 1: MuJoCo makes zeros of axes whose squares overflow


def read(
    source: str | os.PathLike[str], key: str | None = None, include_root: str | os.PathLike[str] | None = None
) -> tuple[pin.Model, Sidecar]:
    """Return the tree of an MJCF file and its loops."""
    return _Translation(compiled(source, include_root), key).result()


def translation_of(source: str | os.PathLike[str]) -> tuple[Any, _Translation]:
    """Return MuJoCo's model of a file, and what turns it into a tree; parameters and errors as of `read`."""
    found = compiled(source)
    return found, _Translation(found, None)


class _Translation:
    """Turns MuJoCo's compiled model into a tree and a sidecar."""

    def __init__(self, compiled: Any, key: str | None) -> None:
        import mujoco

        self._m, self._key, self._types = compiled, key, mujoco
        self._model = pin.Model()
        self._model.name = compiled.names.split(b"\0", 1)[0].decode("utf-8", "replace")
        self._switch_off()
        weightless = compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        self._model.gravity.linear = np.zeros(3) if weightless else np.array(compiled.opt.gravity)
        self._joints: list[str] = []
        self._bodies: list[tuple[int, pin.SE3, int]] = [(0, pin.SE3.Identity(), 0)]
        self._frames: set[str] = {"universe"}
        self._sites: list[str] = []
        self._tendons: dict[int, Tendon] = {}

    def _switch_off(self) -> None:
        """Make zero what a `<flag>` disables: MuJoCo keeps the numbers, and leaves them out at each step."""
        for flag, fields in _OFF.items():
            bit = getattr(self._types.mjtDisableBit, f"mjDSBL_{flag}", 0)
            for field in fields if int(self._m.opt.disableflags) & int(bit) else ():
                if hasattr(self._m, field):
                    getattr(self._m, field)[...] = 0

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
        actuated = self._actuated()
        for number in range(m.ntendon):
            if number in self._tendons or self._acts(number):
                self._add_tendon(number)
        self._give_data()
        closures, couplings = self._equalities()
        couplings += tuple(pulled(one) for one in self._tendons.values())
        for words in left_out(m, self._tendons):
            warn(f"MJCF: left out is {words}", ModelWarning, stacklevel=4)
        sidecar = Sidecar(closures, actuated, couplings, self._reference())
        return self._model, replace(sidecar, joint_data=self._joint_data())

    def place_of_body(self, body: int) -> tuple[int, pin.SE3]:
        """Return the joint that carries a body, and where the body is in its axes, after `result`."""
        joint, place, _ = self._bodies[body]
        return joint, place

    def kind_of_geom(self, number: int) -> str:
        """Return the kind of a shape, such as ``"box"``."""
        kind = self._types.mjtGeom(int(self._m.geom_type[number]))
        return str(kind).rsplit("_", 1)[-1].lower()

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
        """Return a joint, its place, and the body's seen from behind it; MuJoCo counts from ``qpos0``."""
        m, kinds = self._m, self._types.mjtJoint
        kind = kinds(int(m.jnt_type[number]))
        anchor, axis = m.jnt_pos[number], m.jnt_axis[number]
        if kind == kinds.mjJNT_FREE:
            return pin.JointModelFreeFlyer(), pin.SE3.Identity(), pin.SE3.Identity()
        back = pin.SE3(np.eye(3), -anchor)
        at = place * back.inverse()
        if kind == kinds.mjJNT_BALL:
            return pin.JointModelSpherical(), at, back
        if not abs(np.linalg.norm(axis) - 1) < _UNIT:
            name = self._name(m.joint, number, "joint")
            raise ModelError(f"MJCF: joint {shown(name)}: expected an axis, got none or one that is too long")
        zero = float(m.qpos0[m.jnt_qposadr[number]])
        if kind == kinds.mjJNT_HINGE:
            turned = pin.SE3(pin.exp3(-zero * axis), np.zeros(3))
            return _about(axis, _TURNS, pin.JointModelRevoluteUnaligned), at * turned, back
        moved = pin.SE3(np.eye(3), -zero * axis)
        return _about(axis, _SLIDES, pin.JointModelPrismaticUnaligned), at * moved, back

    def _give_data(self) -> None:
        """Give the joints their armature, damping, friction and limits."""
        m, model, tendons = self._m, self._model, list(self._tendons)
        model.armature = np.concatenate((m.dof_armature, tendon_armature(m)[tendons]))
        self._give_rotors()
        model.damping = np.concatenate((m.dof_damping, m.tendon_damping[tendons]))
        friction = np.concatenate((m.dof_frictionloss, m.tendon_frictionloss[tendons]))
        model.lowerDryFrictionLimit, model.upperDryFrictionLimit = -friction, friction
        lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        for number, name in enumerate(self._joints):
            joint = model.getJointId(name)
            if m.jnt_limited[number] and model.nqs[joint] == 1:
                lower[model.idx_qs[joint]], upper[model.idx_qs[joint]] = m.jnt_range[number]
        model.lowerPositionLimit, model.upperPositionLimit = lower, upper

    def _give_rotors(self) -> None:
        """Give the joints the armature of their actuators, which MuJoCo has from version 4 on."""
        m, armature = self._m, np.array(self._model.armature)
        for number in range(m.nu if hasattr(m, "actuator_armature") else 0):
            name = self._pulls(number) if m.actuator_armature[number] else None
            if name is not None:
                at = self._model.idx_vs[self._model.getJointId(name)]
                armature[at] += m.actuator_gear[number, 0] ** 2 * m.actuator_armature[number]
        self._model.armature = armature

    def _joint_data(self) -> tuple[JointData, ...]:
        """Return springs, damping, friction and motors."""
        gravity = np.array(self._model.gravity.linear)
        m, found, motors, lifted = self._m, [], self._motors(), lifting(self._m, gravity)
        for number, name in enumerate(self._joints):
            stiffness, dof = float(m.jnt_stiffness[number]), m.jnt_dofadr[number]
            losses = float(m.dof_damping[dof]), float(m.dof_frictionloss[dof])
            rest = self._values(m.qpos_spring, number) if stiffness else 0.0
            motor = motors.get(name, (0.0, 1.0))
            found.append(JointData(name, stiffness, rest, *losses, 0.0, *motor, lifted.get(number, 0.0)))
        for number, one in self._tendons.items():
            (rest, slack), stiffness = m.tendon_lengthspring[number], float(m.tendon_stiffness[number])
            losses = float(m.tendon_damping[number]), float(m.tendon_frictionloss[number])
            spring = stiffness if rest == slack else 0.0, float(rest)
            found.append(JointData(one.name, *spring, *losses, 0.0, *motors.get(one.name, (0.0, 1.0))))
        return tuple(found)

    def _motors(self) -> dict[str, tuple[float, float]]:
        """Return rotor and gear of the joints that one actuator drives: its length is gear times theirs."""
        m, found = self._m, dict[str, list[tuple[float, float]]]()
        for number in range(m.nu):
            name, gear = self._pulls(number), float(m.actuator_gear[number, 0])
            if name is None:
                continue
            if self._types.mjtTrn(int(m.actuator_trntype[number])) == self._types.mjtTrn.mjTRN_TENDON:
                gear *= self._tendon(int(m.actuator_trnid[number, 0])).joints.get(name, 1.0)
            rotor = float(m.actuator_armature[number]) if hasattr(m, "actuator_armature") else 0.0
            found.setdefault(name, []).append((rotor, gear))
        return {name: motors[0] for name, motors in found.items() if len(motors) == 1 and motors[0][1]}

    def _equalities(self) -> tuple[tuple[Closure, ...], tuple[Coupling, ...]]:
        m, kinds = self._m, self._types.mjtEq
        closures: list[Closure] = []
        couplings: list[Coupling] = []
        for number in range(m.neq):
            kind = kinds(int(m.eq_type[number]))
            if not m.eq_active0[number]:
                continue
            if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                closures.append(self._closure(number, "3d" if kind == kinds.mjEQ_CONNECT else "6d"))
            elif kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
                of = self._value if kind == kinds.mjEQ_JOINT else self._tendon
                found = self._tied(number, of, couplings)
                if isinstance(found, Closure):
                    closures.append(found)
                else:
                    couplings.append(found)
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

    def _value(self, joint: int) -> Tendon:
        """Return the value of a joint, as the length of a tendon that has no other."""
        name = self._joints[joint]
        return Tendon(name, float(self._m.qpos0[self._m.jnt_qposadr[joint]]), {name: 1.0})

    def _tied(
        self, number: int, of: Callable[[int], Tendon], couplings: Sequence[Coupling]
    ) -> Closure | Coupling:
        m, name = self._m, self._name(self._m.equality, number, "equality")
        first, second = int(m.eq_obj1id[number]), int(m.eq_obj2id[number])
        other = None if second < 0 else of(second)
        return tied(name, of(first), other, m.eq_data[number, :5], self._sites, couplings)

    def _tendon(self, number: int) -> Tendon:
        return tendon(self._m, number, self._name(self._m.tendon, number, "tendon"), self._joints)

    def _acts(self, number: int) -> bool:
        """Whether a fixed tendon has a spring, a damper, friction or an inertia."""
        return acting(self._m, number) and bool(self._tendon(number).joints)

    def _add_tendon(self, number: int) -> str:
        """Give a fixed tendon a joint that has its length, and no mass."""
        if number not in self._tendons:
            one, joints = self._tendon(number), set(self._joints)
            name = one.name
            while name in joints or any(name == each.name for each in self._tendons.values()):
                name += "_"
            self._tendons[number] = replace(one, name=name)
            hinges = all(self._turns(joint) for joint in one.joints)
            kind = pin.JointModelRX() if hinges else pin.JointModelPX()  # its unit is that of its length
            joint = self._model.addJoint(0, kind, pin.SE3.Identity(), name)
            self._model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.JOINT))
        return self._tendons[number].name

    def _turns(self, joint: str) -> bool:
        kind = self._m.jnt_type[self._joints.index(joint)]
        return bool(kind == self._types.mjtJoint.mjJNT_HINGE)

    def _pulls(self, number: int) -> str | None:
        """Return the joint that an actuator acts on, if any."""
        m, kinds = self._m, self._types.mjtTrn
        kind, target = kinds(int(m.actuator_trntype[number])), int(m.actuator_trnid[number, 0])
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            name = self._joints[target]
            return name if self._model.nvs[self._model.getJointId(name)] == 1 else None
        if kind == kinds.mjTRN_TENDON and (one := self._tendon(target)).joints:
            return next(iter(one.joints)) if len(one.joints) == 1 else self._add_tendon(target)
        return None

    def _actuated(self) -> tuple[str, ...]:
        """Return the joints with an actuator; all with one degree of freedom where there is none at all."""
        m = self._m
        if not m.nu:
            kind = self._types.mjtObj.mjOBJ_TEXT
            if any(self._types.mj_id2name(m, kind, number) == "actuated" for number in range(m.ntext)):
                return ()  # as this package writes a robot without motors
            return Sidecar.serial(self._model).actuated
        names: dict[str, None] = {}
        for number in range(m.nu):
            name = self._pulls(number)
            if name is not None:
                names[name] = None
                continue
            called = self._name(m.actuator, number, "actuator")
            message = f"MJCF: the actuator {shown(called)} acts on no joint of one freedom and is left out"
            warn(message, ModelWarning, stacklevel=5)
        return tuple(names)

    def _reference(self) -> dict[str, Any]:
        """Return the keyframe, or else where the file draws the robot, which few put at zero."""
        m = self._m
        names = [self._name(m.key, number, "key") for number in range(m.nkey)]
        if self._key is not None and self._key not in names:
            raise ModelError(f"keyframe {shown(self._key)} does not exist; {suggestion(self._key, names)}")
        q = m.key_qpos[0 if self._key is None else names.index(self._key)] if names else m.qpos0
        found = {name: self._values(q, number) for number, name in enumerate(self._joints)}
        return found | {
            one.name: sum(f * found[j] for j, f in one.joints.items()) for one in self._tendons.values()
        }

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


_SHOWN_GROUPS = 3  # MuJoCo shows the geoms of the first groups; the others are mostly there for contacts
_KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")


@dataclass(frozen=True, eq=False)
class Geom:
    """A primitive shape."""

    joint: str  # the joint whose body it is on; `"universe"` for the world
    placement: pin.SE3  # where it is in the axes of the joint
    kind: str  # `"sphere"`, `"capsule"`, `"ellipsoid"`, `"cylinder"` or `"box"`
    size: FloatArray  # (3,): as MuJoCo has it: radii and half lengths [m]
    rgba: FloatArray  # (4,): its colour


def geoms(source: str | os.PathLike[str]) -> list[Geom]:
    """Return the primitive shapes that MuJoCo would show; planes, meshes and height fields are left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # who reads the robot is told
        compiled, translation = translation_of(source)
        model, _ = translation.result()
    found = []
    for i in range(compiled.ngeom):
        kind = translation.kind_of_geom(i)
        if kind not in _KINDS or compiled.geom_group[i] >= _SHOWN_GROUPS:
            continue
        joint, place = translation.place_of_body(int(compiled.geom_bodyid[i]))
        w, x, y, z = (float(number) for number in compiled.geom_quat[i])
        own = pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(compiled.geom_pos[i]))
        size, rgba = np.array(compiled.geom_size[i]), np.array(compiled.geom_rgba[i], dtype=float)
        found.append(Geom(str(model.names[joint]), place * own, kind, size, rgba))
    return found
