"""Locking joints of a robot: they become part of the bodies beside them; its loops stay."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.constraints import Closure, Coupling
from p3dof.loops.joints import configuration_of, joint_named
from p3dof.loops.sidecar import Sidecar
from p3dof.loops.sidecar_file import reference_of

_SHUT = 1e-9
"""Largest gap that a closure or a coupling may have which locked joints hold alone [m or rad]."""


def locked_at(
    model: pin.Model, joints: Mapping[str, Any] | Iterable[str] | str, reference: FloatArray
) -> tuple[list[str], FloatArray]:
    """Return which joints a user wants to lock, and a configuration in which they have their values.

    Parameters
    ----------
    model : pin.Model
        The tree.
    joints : mapping of str to float or sequence, or names
        Values by joint; without values those that the joints have in `reference`.
    reference : (nq,) array
        A configuration.

    Returns
    -------
    names : list of str
    q : (nq,) array

    Raises
    ------
    ModelError
        If a joint does not exist, its values do not fit, or no joint would be left.
    """
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
    """Return a robot some of whose joints are locked.

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        Its loops.
    names : iterable of str
        The joints to lock.
    q : (nq,) array
        A configuration in which they have their values.

    Returns
    -------
    model : pin.Model
        The tree without these joints; all frames are there, masses and the data of the other joints too.
    sidecar : Sidecar
        Closures, couplings, actuated joints and reference of what is left. A closure whose two frames are on
        one body now is left out if it is closed; so is a coupling of which all joints are locked.

    Raises
    ------
    ModelError
        If such a closure or coupling does not hold, or a coupling cannot be solved for the joints that are
        left.
    """
    locked = set(names)
    ids = [model.getJointId(name) for name in locked]
    reduced = pin.buildReducedModel(model, ids, q)
    reduced.name = model.name
    values = {name: _value(model, name, q) for name in locked}
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
    )


def _moves(model: pin.Model, closure: Closure) -> bool:
    """Whether the frames of a closure are on two bodies; if not, it must be closed."""
    one, two = (model.frames[model.getFrameId(name)] for name in (closure.frame1, closure.frame2))
    if one.parentJoint != two.parentJoint:
        return True
    gap = _gap(one.placement.actInv(two.placement), closure)
    if not gap <= _SHUT:
        raise ModelError(
            f"lock: the closure {closure.name} is open by {gap:.3g} m or rad, and no joint is left for it"
        )
    return False


def _gap(between: pin.SE3, closure: Closure) -> float:
    """Return by how much a closure is open whose second frame is seen from the first at a placement."""
    model = pin.Model()  # a free body: any kind of closure tells its error by its own code
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    model.addFrame(pin.Frame(closure.frame1, 0, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame(closure.frame2, joint, 0, between, pin.FrameType.OP_FRAME))
    point = LoopKinematics(model, Sidecar((closure,), ())).at(np.array(pin.neutral(model)))
    return float(point.gap)


def _value(model: pin.Model, name: str, q: FloatArray) -> float:
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
