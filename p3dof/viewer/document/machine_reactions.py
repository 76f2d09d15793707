"""Reactions of the manipulator's joints as a document has them: curves of their sizes, and arrows."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.reactions import AnyReactions, how_chosen
from p3dof.analysis.reactions.joints import JOINTS
from p3dof.viewer.document.curves import PALETTE, curve
from p3dof.viewer.document.encoding import encoded
from p3dof.viewer.document.machine import Machine
from p3dof.viewer.document.machine_runs import Samples

LAYER = {"name": "reactions", "label": "Reactions of joints", "shown": False}
"""Their arrows can be shown."""
_KINDS = (("force", "Forces in joints", "N"), ("moment", "Moments in joints", "N m"))


def with_reactions(
    robot: Machine, document: dict[str, Any], samples: Samples, reactions: AnyReactions
) -> dict[str, Any]:
    """Return a document whose first run also has the reactions of the joints.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    document : dict
        The document.
    samples : Samples
        Its first run.
    reactions : Reactions or ReactionsComparison
        Over the same motion; of a comparison those of elastic joints.

    Returns
    -------
    dict

    Raises
    ------
    InputError
        If they are something else, or over another motion.
    """
    if not isinstance(reactions, AnyReactions):
        raise InputError(f"reactions: expected Reactions, got {shown(reactions)}")
    one = reactions.each[0]
    if not np.array_equal(one.motion.pose, samples.motion.pose, equal_nan=True):
        raise InputError("reactions: expected those of the motion that is shown first")
    curves, loads = [], []
    values = dict(zip(("force", "moment"), one.in_base(), strict=True))
    for kind, group, unit in _KINDS:
        for i, joint in enumerate(JOINTS):
            label = f"{joint.label} {joint.name}"
            size = np.linalg.norm(values[kind][:, i], axis=1)
            curves.append(curve(f"{kind} {joint.name}", label, group, unit, PALETTE[i % len(PALETTE)], size))
            loads.append(_load(robot, i, kind, unit, values[kind][:, i]))
    run, *others = document["runs"]
    notes = [*run["notes"], f"Loads of joints: {how_chosen(one)}"]
    run = run | {"curves": run["curves"] + curves, "loads": run["loads"] + loads, "notes": notes}
    scene = document["scene"] | {"layers": [*document["scene"]["layers"], LAYER]}
    return document | {"runs": [run, *others], "scene": scene}


def _load(robot: Machine, i: int, kind: str, unit: str, values: FloatArray) -> dict[str, Any]:
    """Return what the predecessor of a joint exerts on the successor, at the joint."""
    joint = JOINTS[i]
    frame = robot.model.frames[robot.model.getFrameId(joint.frame)]
    return {
        "key": f"{kind} {joint.name}",
        "label": f"{kind.capitalize()} in {joint.label}, {joint.meaning}",
        "kind": kind,
        "joint": int(frame.parentJoint) - 1,
        "point": frame.placement.translation.tolist(),
        "frame": "world",
        "values": encoded(values, "float32"),
        "colour": PALETTE[i % len(PALETTE)],
        "group": "reaction",
        "unit": unit,
        "layer": LAYER["name"],
    }
