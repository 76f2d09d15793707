"""The loop closures of any robot as a document has them."""

from __future__ import annotations

from typing import Any

from p3dof.loops import ClosedLoopModel
from p3dof.viewer.document.trees import placement


def closures_of(loop: ClosedLoopModel) -> list[dict[str, Any]]:
    """Return the closures of a robot: which frames of which joints are held together, and how.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.

    Returns
    -------
    list of dict
        Name, kind, and of both frames the joint (-1: the world) and the placement in it; of a distance also
        its length [m].
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
