"""Trees built anew, with other joints in the place of some; everything else stays as it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import shown
from p3dof._base.errors import ModelError

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
BY_POSITION = ("lowerPositionLimit", "upperPositionLimit")
"""What a model says of each entry of q."""


@dataclass(frozen=True)
class NewJoint:
    """A joint that takes the place of another one, or follows one that does.

    Parameters
    ----------
    name : str
        Its name.
    model : pin.JointModel
        What it lets move.
    placement : pin.SE3, optional
        Where it is, in the axes of the joint that it replaces or follows; there by default.
    """

    name: str
    model: Any
    placement: Any = None


def with_joints(model: pin.Model, replaced: Mapping[str, Sequence[NewJoint]]) -> pin.Model:
    """Return a copy of a tree with other joints in the place of some.

    Parameters
    ----------
    model : pin.Model
        The tree.
    replaced : mapping of str to sequence of NewJoint
        For the name of a joint, the chain of joints to put in its place; its body hangs on the last of them.

    Returns
    -------
    pin.Model
        What a joint that stays has of limits, armature and friction, it keeps. New ones have no limits.
    """
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


def check_tree(model: pin.Model) -> None:
    """Raise ModelError for a tree that Pinocchio's algorithms would compute wrongly, or refuse later.

    Joints that were not added depth first give a wrong mass matrix without a word; joints that mimic others
    are not taken by most algorithms.

    Parameters
    ----------
    model : pin.Model
        The tree.
    """
    mimicking = [str(model.names[i]) for i in model.mimicking_joints]
    if mimicking:
        raise ModelError(
            f"model: the joint {shown(mimicking[0])} mimics another one: build the model without, and couple "
            "them with a Coupling"
        )
    path = [0]
    for i in range(1, model.njoints):
        parent = int(model.parents[i])
        while path and path[-1] != parent:
            path.pop()
        if not path:
            raise ModelError(
                f"model: the joint {shown(str(model.names[i]))} is not depth first: add it right behind "
                f"{shown(str(model.names[parent]))} and what hangs on it, else Pinocchio's crba is wrong"
            )
        path.append(i)


def add_frame(model: pin.Model, name: str, on: int, placement: pin.SE3) -> None:
    """Add a frame to a tree.

    Parameters
    ----------
    model : pin.Model
        The tree, which changes.
    name : str
        Of the new frame.
    on : int
        Index of the frame that it is fixed to.
    placement : pin.SE3
        Where it is in the axes of that frame.
    """
    frame = model.frames[on]
    where = frame.placement * placement
    model.addFrame(pin.Frame(name, frame.parentJoint, on, where, pin.FrameType.OP_FRAME))
