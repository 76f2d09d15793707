"""Errors of a robot's geometry: a placement that is not where the design has it, as joints that stand still.

A joint or frame that may be displaced hangs on further joints in the tree, of which each is one parameter:
slides along the axes of the body before it, then turns about them. Their values are the errors. All else,
positions, closures of any kind and their derivatives, is then that of any robot: what the loops do when a
placement changes is what they do when such a joint moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, positive, real, require, shown, suggestion
from p3dof._base.errors import InputError
from p3dof.loops.coordinates import length_coordinates
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.sidecar import Closure

DEVICE = "device"
"""What measures, if no frame of the robot is named: a frame fixed in the world, by default at its origin."""
_SHIFTS = {"x": pin.JointModelPX, "y": pin.JointModelPY, "z": pin.JointModelPZ}
_TURNS = {"yaw": pin.JointModelRZ, "pitch": pin.JointModelRY, "roll": pin.JointModelRX}
KINDS = (*_SHIFTS, "roll", "pitch", "yaw", "length")  # of a placement
OFFSET = "offset"  # of the encoder of an actuated joint: what it reads less where the joint is
_NEAR = 1e-9  # distance from the joint before it below which a placement has no length [units of length]
_OPEN = 1e-6  # what a displacement may open the loops by, as a share of it


class Displacements(NamedTuple):
    """Parameters of the geometry of a robot: names, and what each of them displaces."""

    names: tuple[str, ...]  # P of them
    elements: tuple[str, ...]  # E displacements `what.kind`
    matrix: FloatArray  # (E, P): displacements = matrix @ parameters
    tolerances: FloatArray  # (P,): standard deviations about the design [m or rad]; infinite where unknown
    lengths: tuple[bool, ...]  # of P, which are lengths


def displacements(
    robot: LoopModel,
    tolerances: Mapping[str, float],
    combined: Mapping[str, Mapping[str, float] | Sequence[str]],
    frames: Iterable[str] = (),
) -> Displacements:
    """Return the parameters that names and patterns of names say; see `calibrate`."""
    require("tolerances", tolerances, Mapping)
    known = _elements(robot, frames)
    mixed = {str(name): _parts(str(name), parts, known) for name, parts in combined.items()}
    clash = next((name for name in mixed if name in known), None)
    if clash is not None:
        raise InputError(f"combined: {shown(clash)} is a displacement of the robot already")
    found: dict[str, float] = {}
    for pattern, value in tolerances.items():
        where = f"tolerances: {shown(pattern)}"
        amount = np.inf if value == np.inf else positive(where, value, InputError)
        some = [name for name in (*mixed, *known) if fnmatchcase(name, str(pattern))]
        some = [str(pattern)] if str(pattern) in (*mixed, *known) else some
        if not some:
            raise InputError(
                f"tolerances: there is no {shown(pattern)}; expected JOINT or FRAME with one of "
                f"{', '.join(KINDS)}, an actuated JOINT.{OFFSET}{_near(str(pattern), known)}"
            )
        found |= dict.fromkeys(some, amount)
    if not found:
        raise InputError("tolerances: expected one parameter or more")
    names = tuple(found)
    each = [mixed.get(name, {name: 1.0}) for name in names]
    elements = tuple(dict.fromkeys(element for parts in each for element in parts))
    matrix = np.array([[parts.get(element, 0.0) for parts in each] for element in elements])
    lengths = tuple(known[next(iter(parts))] for parts in each)
    return Displacements(names, elements, matrix, np.array([found[name] for name in names]), lengths)


def _near(name: str, known: Mapping[str, bool]) -> str:
    return f"; {suggestion(name, known)}" if len(known) < 5000 else ""


def _elements(robot: LoopModel, frames: Iterable[str]) -> dict[str, bool]:
    """Return all displacements that a robot has, and whether each is a length."""
    model = robot.model
    places = [str(name) for name in list(model.names)[1:]]
    places += [str(frame.name) for frame in model.frames if frame.type != pin.FrameType.JOINT]
    found = {
        f"{place}.{kind}": kind in _SHIFTS or kind == "length"
        for place in dict.fromkeys((*places, *frames))
        if place != "universe"
        for kind in KINDS
    }
    slides = length_coordinates(model)[1]
    for name in robot.actuated:
        found[f"{name}.{OFFSET}"] = bool(slides[model.idx_vs[model.getJointId(name)]])
    for closure in robot.sidecar.closures:
        if closure.length is not None:
            found[f"{closure.name}.length"] = True
    return found


def _parts(
    name: str, parts: Mapping[str, float] | Sequence[str], known: Mapping[str, bool]
) -> dict[str, float]:
    """Return the displacements that a parameter moves together, with their factors."""
    if isinstance(parts, str) or not isinstance(parts, Mapping | Sequence) or not len(parts):
        raise InputError(f"combined: {name}: expected names of displacements, or a mapping to their factors")
    given = parts if isinstance(parts, Mapping) else dict.fromkeys(parts, 1.0)
    found: dict[str, float] = {}
    for pattern, factor in given.items():
        some = (
            [str(pattern)] if pattern in known else [one for one in known if fnmatchcase(one, str(pattern))]
        )
        if not some:
            raise InputError(
                f"combined: {name}: there is no displacement {shown(pattern)}{_near(str(pattern), known)}"
            )
        found |= dict.fromkeys(some, real(f"combined: {name}: {pattern}", factor))
    if len({known[one] for one in found}) > 1 and len(set(found.values())) == 1:
        raise InputError(f"combined: {name}: expected lengths or angles, got both with the same factor")
    return found


class DisplacedRobot:
    """A robot whose placements may be displaced."""

    def __init__(self, robot: LoopModel, elements: Sequence[str], frames: Iterable[str]) -> None:
        self.robot, self.elements = robot, tuple(elements)
        rods = {f"{closure.name}.length" for closure in robot.sidecar.closures if closure.length is not None}
        self._rods = [(e, name) for e, name in enumerate(elements) if name in rods]
        self._offsets = [
            (e, robot.actuated.index(name.rpartition(".")[0]))
            for e, name in enumerate(elements)
            if name.rpartition(".")[2] == OFFSET
        ]
        other = {e for e, _ in (*self._rods, *self._offsets)}
        self._moved = [e for e in range(len(elements)) if e not in other]
        base = robot.model
        missing = [name for name in dict.fromkeys(frames) if not base.existFrame(name)]
        names = [self.elements[e] for e in self._moved]
        model = _Extension(base, names, missing).model
        sidecar = replace(
            robot.sidecar, actuated=(*robot.actuated, *names), joint_data=(), bushings=(), joints=()
        )
        self.extended = ClosedLoopModel(model, sidecar)
        self._sized: tuple[bytes, ClosedLoopModel] = (b"", self.extended)

    def with_lengths(self, values: FloatArray) -> ClosedLoopModel:
        """Return the extended robot, whose massless rods have the displaced lengths."""
        change = np.array([values[e] for e, _ in self._rods])
        if not change.any():
            return self.extended
        if self._sized[0] != change.tobytes():
            more = dict(zip((name for _, name in self._rods), change.tolist(), strict=True))
            sidecar = replace(self.extended.sidecar, closures=_resized(self.robot, more))
            self._sized = change.tobytes(), ClosedLoopModel(self.extended.model, sidecar)
        return self._sized[1]

    def targets(self, readings: FloatArray, values: FloatArray) -> FloatArray:
        """Return the values of the actuated joints and of those that stand still, (K, ...)."""
        positions = readings.copy()
        for e, column in self._offsets:
            positions[:, column] -= values[e]
        still = np.broadcast_to(values[self._moved], (len(readings), len(self._moved)))
        return np.concatenate((positions, still), axis=1)

    def influence(self, robot: ClosedLoopModel, q: FloatArray, parameters: Displacements) -> FloatArray:
        """Return how the joints move with the parameters, readings held: (nv, P)."""
        model = self.extended.model
        J = robot.closure_jacobian(q)
        A = np.concatenate((J, np.eye(model.nv)[robot.actuated_v]))
        b: FloatArray = np.zeros((len(A), len(self.elements)))
        for column, e in enumerate(self._moved, len(self.robot.actuated)):
            b[len(J) + column, e] = 1.0
        for e, column in self._offsets:
            b[len(J) + column, e] = -1.0
        rows = dict(zip((c.name for c in robot.sidecar.closures), robot.constraint_rows, strict=False))
        for e, name in self._rods:
            b[rows[name.rpartition(".")[0]], e] = 1.0
        b = b @ parameters.matrix
        found = np.linalg.lstsq(A, b, rcond=RANK_TOLERANCE)[0]
        left = np.abs(A @ found - b).max(axis=0, initial=0.0)
        if left.max(initial=0.0) > _OPEN:
            name = parameters.names[int(left.argmax())]
            raise InputError(
                f"tolerances: the loops cannot close with another {name}: they are overconstrained; "
                "combine it with what has to change with it, or leave it out"
            )
        return np.asarray(found)

    def idle(self, robot: ClosedLoopModel, q: FloatArray) -> FloatArray:
        """Return the motions of the joints that the motors leave free, as columns (nv, k)."""
        A = np.concatenate((robot.closure_jacobian(q), np.eye(robot.model.nv)[robot.actuated_v]))
        return Decomposition.of(A).null_space

    def corrected(self, values: FloatArray) -> ClosedLoopModel:
        """Return the robot itself with these displacements; its joints are what encoders read."""
        model = self.robot.model.copy()
        by = dict(zip(self.elements, values.tolist(), strict=True))
        joints = set(list(model.names)[1:])
        for place in dict.fromkeys(self.elements[e].rpartition(".")[0] for e in self._moved):
            if place in joints:
                j = model.getJointId(place)
                model.jointPlacements[j] = _displaced(model.jointPlacements[j], place, by)
            elif model.existFrame(place):
                for frame in model.frames:
                    if frame.name == place and frame.type != pin.FrameType.JOINT:
                        frame.placement = _displaced(frame.placement, place, by)
        for e, column in self._offsets:
            j = model.getJointId(self.robot.actuated[column])
            zero, one = pin.neutral(model), np.zeros(model.nv)
            one[model.idx_vs[j]] = -values[e]
            data = model.createData()
            pin.forwardKinematics(model, data, pin.integrate(model, zero, one))
            moved = data.joints[j].M
            pin.forwardKinematics(model, data, zero)
            model.jointPlacements[j] = model.jointPlacements[j] * moved * data.joints[j].M.inverse()
        more = {name: float(values[e]) for e, name in self._rods}
        return ClosedLoopModel(model, replace(self.robot.sidecar, closures=_resized(self.robot, more)))


def _resized(robot: LoopModel, more: Mapping[str, float]) -> tuple[Closure, ...]:
    """Return the closures, massless rods being longer."""
    closures = robot.sidecar.closures
    return tuple(
        closure if closure.length is None
        else replace(closure, length=closure.length + more.get(f"{closure.name}.length", 0.0))
        for closure in closures
    )  # fmt: skip


def _displaced(placement: pin.SE3, place: str, by: Mapping[str, float]) -> pin.SE3:
    value = {kind: by.get(f"{place}.{kind}", 0.0) for kind in KINDS}
    shift = np.array([value[kind] for kind in _SHIFTS])
    if value["length"]:
        shift = shift + value["length"] * _direction(placement, place)
    turn = pin.rpy.rpyToMatrix(value["roll"], value["pitch"], value["yaw"])
    return pin.SE3(turn @ placement.rotation, placement.translation + shift)


def _direction(placement: pin.SE3, place: str) -> FloatArray:
    """Return the direction from the joint before to a placement, in the axes of that joint."""
    distance = float(np.linalg.norm(placement.translation))
    if distance <= _NEAR:
        raise InputError(
            f"tolerances: {place}.length: it is at the origin of the joint before it, so that it has no "
            "length: displace it along x, y or z"
        )
    return np.asarray(placement.translation / distance)


class _Extension:
    """A tree with a joint for each displacement; its joints are depth first, as those of `base`."""

    def __init__(self, base: pin.Model, elements: Sequence[str], devices: Sequence[str]) -> None:
        self._base, self.model = base, pin.Model()
        self.model.name, self.model.gravity = base.name, base.gravity
        self._kinds: dict[str, list[str]] = {}
        for element in elements:
            place, _, kind = element.rpartition(".")
            self._kinds.setdefault(place, []).append(kind)
        self._joints = set(list(base.names)[1:])
        self._hung: dict[str, int] = {}
        for device in devices:
            on, at = self._hang(0, pin.SE3.Identity(), device)
            self.model.addFrame(pin.Frame(device, on, 0, at, pin.FrameType.OP_FRAME))
        self._grow(0, 0)

    def _hang(self, parent: int, placement: pin.SE3, place: str) -> tuple[int, pin.SE3]:
        """Add the joints of a place; return what it hangs on, and where."""
        wanted, turned = self._kinds.get(place, []), pin.SE3(placement.rotation, np.zeros(3))
        if not wanted:
            return parent, placement
        if place in self._hung:  # a link and the fixed joint that holds it may have one name
            return self._hung[place], turned
        at = pin.SE3(np.eye(3), placement.translation)
        for kind in (*_SHIFTS, "length", *_TURNS):
            if kind in wanted:
                joint = self._joint(kind, placement, place)
                parent, at = self.model.addJoint(parent, joint, at, f"{place}.{kind}"), pin.SE3.Identity()
                self.model.addJointFrame(parent)
        self._hung[place] = parent
        return parent, turned

    @staticmethod
    def _joint(kind: str, placement: pin.SE3, place: str) -> Any:
        if kind == "length":
            return pin.JointModelPrismaticUnaligned(_direction(placement, place))
        return {**_SHIFTS, **_TURNS}[kind]()

    def _grow(self, old: int, new: int) -> None:
        """Add the frames of a body, and the joints that hang on it."""
        base, model = self._base, self.model
        for frame in list(base.frames)[1:]:
            if frame.parentJoint == old and frame.type != pin.FrameType.JOINT:
                name = str(frame.name)
                free = name not in self._joints
                on, at = self._hang(new, frame.placement, name) if free else (new, frame.placement)
                model.addFrame(pin.Frame(name, on, 0, at, frame.type))
        for child in range(1, base.njoints):
            if base.parents[child] != old:
                continue
            name, joint = str(base.names[child]), base.joints[child]
            on, at = self._hang(new, base.jointPlacements[child], name)
            v, q = slice(joint.idx_v, joint.idx_v + joint.nv), slice(joint.idx_q, joint.idx_q + joint.nq)
            limits = [base.effortLimit[v], base.velocityLimit[v]]
            limits += [base.lowerPositionLimit[q], base.upperPositionLimit[q]]
            added = model.addJoint(on, joint, at, name, *limits)
            model.addJointFrame(added)
            model.appendBodyToJoint(added, base.inertias[child], pin.SE3.Identity())
            self._grow(child, added)
