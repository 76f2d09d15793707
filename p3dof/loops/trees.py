"""Trees built anew: with other joints in the place of some, or with joints locked; their loops stay."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.coordinates import configuration_of, joint_named
from p3dof.loops.sidecar import Closure, Coupling, Sidecar, reference_of

BY_VELOCITY = (
    "armature",
    "damping",
    "rotorInertia",
    "rotorGearRatio",
    "lowerEffortLimit",
    "upperEffortLimit",
    "lowerVelocityLimit",
    "upperVelocityLimit",
    "lowerDryFrictionLimit",
    "upperDryFrictionLimit",
)
"""What a model says of each entry of v."""
BY_POSITION = ("lowerPositionLimit", "upperPositionLimit")  # what a model says of each entry of q


@dataclass(frozen=True)
class NewJoint:
    """A joint that takes the place of another one, or follows one that does."""

    name: str  # its name
    model: Any  # what it lets move
    placement: Any = None
    """Where it is, in the axes of the joint that it replaces or follows; there by default."""


def with_joints(model: pin.Model, replaced: Mapping[str, Sequence[NewJoint]]) -> pin.Model:
    """Return a copy of a tree with some joints replaced; what stays keeps its limits, armature, friction."""
    new = pin.Model()
    new.name = model.name
    new.gravity = model.gravity
    ids, kept = {0: 0}, []
    for i in range(1, model.njoints):
        name, placement = str(model.names[i]), model.jointPlacements[i]
        joint = ids[int(model.parents[i])]
        chain = replaced.get(name)
        if chain is None:
            joint = new.addJoint(joint, model.joints[i], placement, name)
            kept.append((i, joint))
        else:
            for number, link in enumerate(chain):
                start = placement if number == 0 else pin.SE3.Identity()
                where = start if link.placement is None else start * link.placement
                joint = new.addJoint(joint, link.model, where, link.name)
        new.appendBodyToJoint(joint, model.inertias[i], pin.SE3.Identity())
        ids[i] = joint
    _copy_data(model, new, kept)
    _copy_frames(model, new, ids, replaced)
    return new


def _copy_data(model: pin.Model, new: pin.Model, kept: Sequence[tuple[int, int]]) -> None:
    """Give joints that stay what they had; unlimited and without losses are the new ones."""
    for field in BY_VELOCITY:
        values = np.array(getattr(new, field))
        for old, joint in kept:
            there = slice(new.idx_vs[joint], new.idx_vs[joint] + new.nvs[joint])
            values[there] = getattr(model, field)[model.idx_vs[old] : model.idx_vs[old] + model.nvs[old]]
        setattr(new, field, values)
    for field in BY_POSITION:
        values = np.array(getattr(new, field))
        for old, joint in kept:
            there = slice(new.idx_qs[joint], new.idx_qs[joint] + new.nqs[joint])
            values[there] = getattr(model, field)[model.idx_qs[old] : model.idx_qs[old] + model.nqs[old]]
        setattr(new, field, values)


def _copy_frames(
    model: pin.Model, new: pin.Model, ids: Mapping[int, int], replaced: Mapping[str, Sequence[NewJoint]]
) -> None:
    frames = {0: 0}
    for i in range(1, model.nframes):
        frame = model.frames[i]
        joint, above = ids[int(frame.parentJoint)], frames[int(frame.parentFrame)]
        if frame.type == pin.FrameType.JOINT and frame.name in replaced:
            for link in replaced[frame.name]:
                above = new.addFrame(
                    pin.Frame(
                        link.name, new.getJointId(link.name), above, pin.SE3.Identity(), pin.FrameType.JOINT
                    )
                )
            frames[i] = above
        else:
            frames[i] = new.addFrame(pin.Frame(frame.name, joint, above, frame.placement, frame.type))


_SHUT = 1e-9  # largest gap that a closure or a coupling may have which locked joints hold alone [m or rad]


def locked_at(
    model: pin.Model, joints: Mapping[str, Any] | Iterable[str] | str, reference: FloatArray
) -> tuple[list[str], FloatArray]:
    """Return which joints a user wants to lock, and a configuration in which they have their values."""
    if isinstance(joints, Mapping):
        values = reference_of("lock", joints) or {}
        wanted, q = list(values), np.array(configuration_of(model, values, "lock"))
    else:
        if not isinstance(joints, str | Iterable):
            raise ModelError(f"lock: expected names of joints, or values by joint, got {shown(joints)}")
        wanted, q = [joints] if isinstance(joints, str) else list(joints), np.array(reference)
        for name in wanted:
            if not isinstance(name, str):
                raise ModelError(f"lock: expected names of joints, got {shown(name)}")
    indices = [joint_named(model, name, "lock") for name in wanted]
    if len(set(indices)) == model.njoints - 1:
        raise ModelError("lock: expected at least one joint that is left, all are locked")
    return wanted, q


def without(
    model: pin.Model, sidecar: Sidecar, names: Iterable[str], q: FloatArray
) -> tuple[pin.Model, Sidecar]:
    """Return a robot some of whose joints are locked."""
    locked = set(names)
    ids = [model.getJointId(name) for name in locked]
    reduced = pin.buildReducedModel(model, ids, q)
    reduced.name = model.name
    values = {name: joint_value(model, name, q) for name in locked}
    kept = None
    if sidecar.reference is not None:
        kept = {name: value for name, value in sidecar.reference.items() if name not in locked}
    couplings = [_left(coupling, values) for coupling in sidecar.couplings]
    return reduced, replace(
        sidecar,
        closures=tuple(closure for closure in sidecar.closures if _moves(reduced, closure)),
        actuated=tuple(name for name in sidecar.actuated if name not in locked),
        couplings=tuple(coupling for coupling in couplings if coupling is not None),
        reference=kept,
        joints=(),
        joint_data=tuple(entry for entry in sidecar.joint_data if entry.joint not in locked),
        bushings=tuple(bushing for bushing in sidecar.bushings if _apart(reduced, *bushing.frames)),
    )


def _moves(model: pin.Model, closure: Closure) -> bool:
    """Whether the frames of a closure are on two bodies; if not, it must be closed."""
    if _apart(model, closure.frame1, closure.frame2):
        return True
    one, two = (model.frames[model.getFrameId(name)] for name in (closure.frame1, closure.frame2))
    gap = _gap(one.placement.actInv(two.placement), closure)
    if not gap <= _SHUT:
        raise ModelError(
            f"lock: the closure {closure.name} is open by {gap:.3g} m or rad, and no joint is left for it"
        )
    return False


def _apart(model: pin.Model, *frames: str) -> bool:
    """Whether frames are on several bodies."""
    return len({model.frames[model.getFrameId(name)].parentJoint for name in frames}) > 1


def _gap(between: pin.SE3, closure: Closure) -> float:
    """Return by how much a closure is open whose second frame is seen from the first at a placement."""
    model = pin.Model()  # a free body: any kind of closure tells its error by its own code
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    model.addFrame(pin.Frame(closure.frame1, 0, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame(closure.frame2, joint, 0, between, pin.FrameType.OP_FRAME))
    point = LoopKinematics(model, Sidecar((closure,), ())).at(np.array(pin.neutral(model)))
    return float(point.gap)


def joint_value(model: pin.Model, name: str, q: FloatArray) -> float:
    """Return the value of a joint [m or rad]; NaN if it has several."""
    joint = model.getJointId(name)
    if model.nvs[joint] != 1:
        return float("nan")
    at = model.idx_qs[joint]
    return float(np.arctan2(q[at + 1], q[at])) if model.nqs[joint] == 2 else float(q[at])


def _left(coupling: Coupling, values: Mapping[str, float]) -> Coupling | None:
    """Return what a coupling says of the joints that are left; None if there are none."""
    if not {coupling.joint, *coupling.leaders} & set(values):
        return coupling
    others = tuple((name, factor) for name, factor in coupling.others if name not in values)
    constant = sum(factor * values[name] for name, factor in coupling.others if name in values)
    coefficients = list(coupling.coefficients)
    on = coupling.on
    if on is not None and on in values:
        coefficients, on = [float(np.polynomial.polynomial.polyval(values[on], coefficients))], None
    coefficients[0] += constant
    if coupling.joint not in values:
        return Coupling(coupling.joint, on, tuple(coefficients), coupling.name, others)
    coefficients[0] -= values[coupling.joint]
    if on is None and not others:
        if abs(coefficients[0]) > _SHUT:
            raise ModelError(
                f"lock: the coupling {coupling.title} does not hold: it is off by {coefficients[0]:.3g}"
            )
        return None
    return _solved(coupling, on, coefficients, others)


def _solved(
    coupling: Coupling, on: str | None, coefficients: list[float], others: tuple[tuple[str, float], ...]
) -> Coupling:
    """Return 0 = p(q_on) + Σ f q_other as a coupling of one of the joints that are left."""
    terms = dict(others)
    if on is not None and not any(coefficients[2:]) and len(coefficients) > 1:
        terms[on] = coefficients[1]
        on, coefficients = None, coefficients[:1]
    follower = next((name for name, factor in terms.items() if factor), None)
    if follower is None:
        raise ModelError(
            f"lock: {coupling.joint!r} follows by the coupling {coupling.title}, which cannot be solved for "
            f"{on!r}: lock that joint instead"
        )
    factor = -terms.pop(follower)
    rest = tuple((name, other / factor) for name, other in terms.items())
    return Coupling(follower, on, tuple(c / factor for c in coefficients), coupling.name, rest)
