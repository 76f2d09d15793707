"""Joints that a sidecar puts in the place of those of a URDF, which has no balls and no universal joints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from warnings import warn

import pinocchio as pin

from p3dof._base.checks import shown
from p3dof._base.errors import ModelError, ModelWarning
from p3dof.loops.sidecar import suggestion
from p3dof.loops.trees import NewJoint, with_joints

_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")
_AXES = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}


def with_types(model: pin.Model, joints: Sequence[tuple[str, str]], source: str) -> pin.Model:
    """Return a tree with other joints in the place of some.

    Parameters
    ----------
    model : pin.Model
        The tree of the URDF.
    joints : sequence of (str, str)
        Names of its joints, and what they are: ``SPHERICAL``, a ball that keeps the name; ``UJOINT_XY`` (any
        two letters), two hinges about these axes of the joint's frame, in this order, whose names end in
        ``_X`` and ``_Y``; ``FIXED``, locked in the neutral configuration.
    source : str
        What to call the sidecar in an error.

    Returns
    -------
    pin.Model

    Raises
    ------
    ModelError
        If a type is unknown.

    Warns
    -----
    ModelWarning
        If a joint does not exist, which public files have: it is left out.
    """
    replaced: dict[str, list[NewJoint]] = {}
    locked = []
    for index, (name, kind) in enumerate(joints):
        if name not in list(model.names)[1:]:
            help_ = suggestion(name, list(model.names)[1:])
            message = f"{source}: joint_name[{index}]: the joint {shown(name)} does not exist; {help_}"
            warn(f"{message} It is left out.", ModelWarning, stacklevel=4)
            continue
        universal = _UNIVERSAL.fullmatch(kind)
        if universal and universal[1] != universal[2]:
            replaced[name] = [NewJoint(f"{name}_{axis}", _AXES[axis]()) for axis in universal.groups()]
        elif kind == "SPHERICAL":
            replaced[name] = [NewJoint(name, pin.JointModelSpherical())]
        elif kind == "FIXED":
            locked.append(name)
        else:
            raise ModelError(
                f"{source}: joint_type[{index}]: expected SPHERICAL, FIXED or UJOINT_ with two different "
                f"axes such as UJOINT_XY, got {shown(kind)}"
            )
    if replaced:
        model = with_joints(model, replaced)
    if locked:
        ids = [model.getJointId(name) for name in locked]
        model = pin.buildReducedModel(model, ids, pin.neutral(model))
    return model
