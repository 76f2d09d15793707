"""Joints whose axes turn within the body that they carry, as chains of joints whose axes do not.

Pinocchio has no derivatives of the dynamics of such joints: universal joints, balls by three angles,
composites. The chain has the same configurations and velocities, in the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.errors import ModelError
from p3dof.loops.trees import NewJoint, with_joints

_UNKNOWN = ("Ellipsoid", "Mimic")
"""Kinds of joint that are no chain of simple ones."""


def simple_tree(model: pin.Model) -> tuple[pin.Model, NDArray[np.int_]]:
    """Return a tree of joints with fixed axes that moves alike.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Returns
    -------
    tree : pin.Model
        The model itself, if all its joints are such.
    bodies : (njoints,) array of int
        The joint of `tree` that carries what each joint of the model does.

    Raises
    ------
    ModelError
        If a joint is of a kind that is no such chain.
    """
    names = [str(name) for name in model.names]
    chains = {names[i]: _chain(names[i], model.joints[i]) for i in range(1, model.njoints)}
    replaced = {name: chain for name, chain in chains.items() if chain}
    if not replaced:
        return model, np.arange(model.njoints)
    tree = with_joints(model, replaced)
    last = {name: chain[-1].name if chain else name for name, chain in chains.items()}
    return tree, np.array([0, *(tree.getJointId(last[name]) for name in names[1:])], dtype=int)


def _chain(name: str, joint: Any) -> list[NewJoint]:
    """Return the joints that take the place of one; none if it is simple."""
    parts = _parts(name, joint, pin.SE3.Identity())
    if len(parts) == 1 and parts[0][0] is joint:
        return []
    return [NewJoint(f"{name}[{k}] of {len(parts)}", *part) for k, part in enumerate(parts)]


def _parts(name: str, joint: Any, placement: pin.SE3) -> Sequence[tuple[Any, pin.SE3]]:
    """Return simple joints, each with its placement behind the one before."""
    kind, here = joint.shortname().removeprefix("JointModel"), pin.SE3.Identity()
    content = joint.extract() if isinstance(joint, pin.JointModel) else joint
    if kind.startswith("Universal"):
        first, second = (pin.JointModelRevoluteUnaligned(axis) for axis in (content.axis1, content.axis2))
        return [(first, placement), (second, here)]
    if kind.startswith("SphericalZYX"):
        return [(pin.JointModelRZ(), placement), (pin.JointModelRY(), here), (pin.JointModelRX(), here)]
    if kind.startswith("Composite"):
        each = zip(list(content.joints), list(content.jointPlacements), strict=True)
        parts = [part for one, where in each for part in _parts(name, one, where)]
        return [(parts[0][0], placement * parts[0][1]), *parts[1:]]
    if kind.startswith(_UNKNOWN):
        raise ModelError(f"the joint {name!r} ({kind}) has no derivatives: expected simple joints")
    return [(joint, placement)]
