"""A tree and constraint models that were made with Pinocchio: closures for its frames and points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, ModelError
from p3dof.loops.sidecar import Closure, Coupling, Sidecar

_POINT, _FRAME = "3d", "6d"
_ZERO = 1e-12  # largest offset [m or rad] that counts as none


def read(
    model: pin.Model,
    constraint_models: Iterable[Any] = (),
    actuated: Sequence[str] | None = None,
    couplings: Iterable[Coupling] = (),
    reference: Mapping[str, Any] | None = None,
) -> tuple[pin.Model, Sidecar]:
    """Return a copy of a tree, with frames where its constraints act, and the closures of these."""
    tree = model if isinstance(model, pin.Model) else getattr(model, "model", None)
    if not isinstance(tree, pin.Model):
        raise InputError(f"model: expected a pinocchio.Model or a RobotWrapper, got {shown(model)}")
    if isinstance(constraint_models, str | Mapping) or not isinstance(constraint_models, Iterable):
        raise InputError(
            f"constraint_models: expected constraint models of Pinocchio, got {shown(constraint_models)}"
        )
    tree = tree.copy()
    for joint in range(1, tree.njoints):  # a tree built joint by joint may have no frames
        if not tree.existFrame(str(tree.names[joint]), pin.FrameType.JOINT):
            tree.addJointFrame(joint)
    names = {frame.name for frame in tree.frames}
    closures = tuple(
        _closure(tree, constraint, number, names) for number, constraint in enumerate(constraint_models, 1)
    )
    coupled = tuple(couplings)
    if actuated is None:
        dependent = {coupling.joint for coupling in coupled}
        actuated = [name for name in Sidecar.serial(tree).actuated if name not in dependent]
    return tree, Sidecar(closures, tuple(actuated), coupled, reference)


def _closure(tree: pin.Model, constraint: Any, number: int, names: set[str]) -> Closure:
    """Return the closure that a constraint is; its frames are added to the tree."""
    inner = constraint.extract() if isinstance(constraint, pin.ConstraintModel) else constraint
    title = f"constraint {number}"
    kind = _kind(inner, title)
    base, frames = str(inner.name) or f"constraint{number}", []
    for end in (1, 2):
        joint = int(getattr(inner, f"joint{end}_id"))
        if joint >= tree.njoints:
            raise ModelError(f"{title}: joint{end}_id is {joint}, the model has {tree.njoints} joints")
        name = _unused(f"{base}_{end}", names)
        placement = pin.SE3(getattr(inner, f"joint{end}_placement"))
        above = tree.getFrameId(str(tree.names[joint]))
        tree.addFrame(pin.Frame(name, joint, above, placement, pin.FrameType.OP_FRAME), False)
        frames.append(name)
    return Closure(frames[0], frames[1], kind)


def _kind(constraint: Any, title: str) -> str:
    """Return what a constraint prescribes; those that move by themselves, or rub, are refused."""
    own: tuple[Any, ...] = ()
    kind = None
    if isinstance(constraint, pin.RigidConstraintModel):
        own = (
            pin.log6(constraint.desired_contact_placement).vector,
            constraint.desired_contact_velocity.vector,
            constraint.desired_contact_acceleration.vector,
        )
        kind = {pin.ContactType.CONTACT_3D: _POINT, pin.ContactType.CONTACT_6D: _FRAME}.get(constraint.type)
    elif isinstance(constraint, pin.PointAnchorConstraintModel | pin.FrameAnchorConstraintModel):
        own = (
            constraint.desired_constraint_offset,
            constraint.desired_constraint_velocity,
            constraint.desired_constraint_acceleration,
        )
        kind = _POINT if isinstance(constraint, pin.PointAnchorConstraintModel) else _FRAME
    if kind is None:
        raise ModelError(
            f"{title}: expected a rigid 3D or 6D constraint or an anchor of a point or frame, "
            f"got {type(constraint).__name__}"
        )
    if any(np.abs(values).max() > _ZERO for values in own):
        raise ModelError(f"{title}: an offset, a velocity or an acceleration of its own is not understood")
    return kind


def _unused(name: str, names: set[str]) -> str:
    """Return a name that no frame has, and note it."""
    found, number = name, 1
    while found in names:
        number += 1
        found = f"{name}_{number}"
    names.add(found)
    return found
