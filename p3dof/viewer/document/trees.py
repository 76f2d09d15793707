"""The joints of any tree and its loop closures as a document has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel
from p3dof.viewer.document.encoding import encoded

_KINDS = {
    "JointModelRevoluteUnboundedUnaligned": "continuous",
    "JointModelRevoluteUnaligned": "revolute",
    "JointModelPrismaticUnaligned": "prismatic",
    "JointModelHelicalUnaligned": "helical",
    "JointModelSpherical": "spherical",
    "JointModelTranslation": "translation",
    "JointModelPlanar": "planar",
    "JointModelFreeFlyer": "free",
    "JointModelUniversal": "universal",
    **{f"JointModelR{axis}": "revolute" for axis in "XYZ"},
    **{f"JointModelRUB{axis}": "continuous" for axis in "XYZ"},
    **{f"JointModelP{axis}": "prismatic" for axis in "XYZ"},
    **{f"JointModelH{axis}": "helical" for axis in "XYZ"},
}
"""What a page calls Pinocchio's joints; of other joints a run has the placements."""
_ALONG = ("prismatic",)
_ABOUT = ("revolute", "continuous", "helical")


def placement(place: pin.SE3) -> list[float]:
    """Return a placement as x, y, z [m] and the quaternion x, y, z, w."""
    turn = pin.Quaternion(place.rotation).normalized().coeffs()
    return [*(float(x) for x in place.translation), *(float(x) for x in turn)]


def place_of(frame: pin.Frame) -> tuple[int, list[float]]:
    """Return the joint that carries a frame, -1 for the world, and the frame's origin there [m]."""
    return int(frame.parentJoint) - 1, frame.placement.translation.tolist()


def tree_of(model: pin.Model) -> list[dict[str, Any]]:
    """Return the joints of a tree, each after its parent.

    Name, parent (-1: the world), placement in the parent, kind, axis and place in q.
    """
    return [_joint(model, i) for i in range(1, model.njoints)]


def bodies_of(model: pin.Model) -> list[str]:
    """Return the names of the links that the joints move; of a joint without one its own."""
    found: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            found.setdefault(int(frame.parentJoint), str(frame.name))
    return [found.get(i, str(model.names[i])) for i in range(1, model.njoints)]


def _joint(model: pin.Model, i: int) -> dict[str, Any]:
    kind = _KINDS.get(str(model.joints[i].shortname()), "placed")
    found: dict[str, Any] = {
        "name": str(model.names[i]),
        "parent": int(model.parents[i]) - 1,
        "placement": placement(model.jointPlacements[i]),
        "kind": kind,
        "q": [int(model.idx_qs[i]), int(model.nqs[i])],
    }
    motions = _subspace(model, i)
    if kind in _ALONG:
        found["axis"] = motions[:3, 0].tolist()
    elif kind in _ABOUT:
        found["axis"] = motions[3:, 0].tolist()
    if kind == "helical":
        found["pitch"] = float(motions[:3, 0] @ motions[3:, 0])
    if kind == "universal":
        found["axis"], found["axis2"] = motions[3:].T.tolist()
    return found


def _subspace(model: pin.Model, i: int) -> FloatArray:
    """Return the motions (6, nv) of a joint at zero, in its own axes: linear, angular."""
    alone = pin.Model()
    if "Mimic" in str(model.joints[i].shortname()):
        return np.zeros((6, 0))
    alone.addJoint(0, model.joints[i], pin.SE3.Identity(), "joint")
    data = alone.createData()
    pin.computeJointJacobians(alone, data, pin.neutral(alone))
    return np.array(pin.getJointJacobian(alone, data, 1, pin.LOCAL)).reshape(6, -1)


def placed_over(model: pin.Model, q: FloatArray) -> dict[str, Any]:
    """Return where joints that a page cannot move are in their parents, over a run.

    By joint name, encoded, shape (N, 7): x, y, z [m] and a quaternion x, y, z, w of continuous sign.
    """
    joints = [i for i in range(1, model.njoints) if str(model.joints[i].shortname()) not in _KINDS]
    if not joints:
        return {}
    data, places = model.createData(), np.full((len(q), model.njoints, 7), np.nan)
    before = np.tile([0.0, 0.0, 0.0, 1.0], (model.njoints, 1))
    for row, values in zip(places, q, strict=True):
        if not np.isfinite(values).all():
            continue
        pin.forwardKinematics(model, data, values)
        row[:] = [placement(data.liMi[i]) for i in range(model.njoints)]
        row[(row[:, 3:] * before).sum(axis=1) < 0, 3:] *= -1.0
        before = row[:, 3:].copy()
    return {str(model.names[i]): encoded(places[:, i]) for i in joints}


def closures_of(loop: ClosedLoopModel) -> list[dict[str, Any]]:
    """Return the closures of a robot: which frames of which joints are held together, and how.

    Name, kind, and of both frames the joint (-1: the world) and the placement in it; of a distance also its
    length [m].
    """
    model, found = loop.model, []
    for closure in loop.sidecar.closures:
        entry: dict[str, Any] = {"name": closure.name, "kind": closure.kind}
        for i, name in enumerate((closure.frame1, closure.frame2), 1):
            frame = model.frames[model.getFrameId(name)]
            entry[f"joint{i}"] = int(frame.parentJoint) - 1
            entry[f"placement{i}"] = placement(frame.placement)
        if closure.length is not None:
            entry["length"] = closure.length
        found.append(entry)
    return found
