"""`robot_document`: the document of the page for any robot."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.version import __version__
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import is_slide
from p3dof.viewer.document.closures import closures_of
from p3dof.viewer.document.drawable import Drawable
from p3dof.viewer.document.robots.motion import JointMotion, Run, spread
from p3dof.viewer.document.robots.ranges import slider_ranges, values_of
from p3dof.viewer.document.robots.room import room_of
from p3dof.viewer.document.robots.runs import LAYER, robot_run
from p3dof.viewer.document.robots.solids import BUDGET, robot_solids
from p3dof.viewer.document.robots.sticks import StickFigure
from p3dof.viewer.document.trees import tree_of

FORMAT = 1
Shown = JointMotion | Run
"""What can be a run of a document."""
_FEW = 4
"""What so many closures transmit is shown at first."""
_LAYERS = {"shapes": "Shapes", "sticks": "Rods"}


def robot_document(
    loop: ClosedLoopModel,
    visual: Drawable | pin.GeometryModel | None = None,
    run: Shown | None = None,
    *,
    runs: Mapping[str, Shown] | None = None,
    external: Mapping[str, ArrayLike] | None = None,
    title: str | None = None,
    engine: Literal["ask", "none"] = "none",
    triangles: int = BUDGET,
) -> dict[str, Any]:
    """Return the document of any robot: its joints, its solids, runs with curves and loads, its closures.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    visual : Drawable or pin.GeometryModel, optional
        What is seen of it: its visual model, or a `RobotFigure` with the shapes of its file; without, rods
        from joint to joint.
    run : JointMotion or RobotRun, optional
        What is shown first; without any run the robot stands where its loops close near the reference, held
        by its actuators.
    runs : mapping of str to JointMotion or RobotRun, optional
        Further runs by name, to be compared with it.
    external : mapping of str to array-like, shape (6,), optional
        Wrenches on frames of a robot that stands, or of a run that does not say them itself: force [N],
        moment [N m] in world axes.
    title : str, optional
        Heading of the page; the robot's name by default.
    engine : {"ask", "none"}
        Whether there is a Python that a page can ask for other configurations.
    triangles : int
        Most triangles of all meshes together; larger ones are simplified, and a note says so.

    Returns
    -------
    dict
        What `json.dumps` takes; SI units and radians.

    Raises
    ------
    AssemblyError
        If the loops do not close where it is to stand.
    InputError
        If an argument does not fit.
    """
    _check(loop, runs, title, engine, triangles)
    given: list[tuple[str, Shown | None]] = [] if run is None else [(_name(run), run)]
    given += [(str(name), one) for name, one in (runs or {}).items()]
    given = given or [("Held at rest", None)]
    figure = _figure(loop, visual)
    found = [(name, *_samples(loop, one, external)) for name, one in given]
    notes = list(getattr(figure, "notes", ()))
    solids, more = robot_solids(figure, triangles)
    notes += more
    points = room_of(loop.model, figure.visual_model, np.concatenate([motion.q for _, motion, _, _ in found]))
    low, high = points.min(axis=0), points.max(axis=0)
    first = np.array(found[0][1].q[0])
    return {
        "format": FORMAT,
        "title": str(loop.model.name) if title is None else title,
        "generator": {"p3dof": __version__, "pinocchio": str(pin.__version__)},
        "machine": {"name": str(loop.model.name), "hash": robot_hash(loop)},
        "scene": {
            "centre": ((low + high) / 2).tolist(),
            "radius": max(float(np.linalg.norm(high - low)) / 2, 1e-6),
            "floor": float(low[2]),
            "joints": tree_of(loop.model),
            "solids": solids,
            "labels": [],
            "lines": [],
            "layers": _layers(loop, figure, solids),
        },
        "runs": [robot_run(loop, motion, v, name, notes + told) for name, motion, v, told in found],
        "closures": closures_of(loop),
        "inputs": _inputs(loop, first, float(np.max(high - low)) / 2),
        "engine": {"kind": engine},
    }


def robot_hash(loop: ClosedLoopModel) -> str:
    """Return a hash of all numbers of a robot that its motions depend on.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.

    Returns
    -------
    str
        SHA-256, in hexadecimal digits.
    """
    model = loop.model
    bodies = [inertia.toDynamicParameters().tolist() for inertia in model.inertias]
    numbers = [tree_of(model), bodies, model.gravity.vector.tolist(), repr(loop.sidecar)]
    return hashlib.sha256(json.dumps(numbers).encode()).hexdigest()


def _check(loop: object, runs: object, title: object, engine: object, triangles: object) -> None:
    if not isinstance(loop, ClosedLoopModel):
        raise InputError(f"robot: expected a ClosedLoopModel, got {shown(loop)}")
    if not isinstance(runs, Mapping | None):
        raise InputError(f"runs: expected runs by name, got {shown(runs)}")
    if not isinstance(title, str | None):
        raise InputError(f"title: expected text, got {shown(title)}")
    if engine not in ("ask", "none"):
        raise InputError(f"engine: expected 'ask' or 'none', got {shown(engine)}")
    if isinstance(triangles, bool) or not isinstance(triangles, int) or triangles < 1:
        raise InputError(f"triangles: expected a positive whole number, got {shown(triangles)}")


def _figure(loop: ClosedLoopModel, visual: Drawable | pin.GeometryModel | None) -> Drawable:
    if visual is None:
        return StickFigure(loop)
    if isinstance(visual, pin.GeometryModel):
        return _Figure(loop.model, visual)
    if not hasattr(visual, "visual_model"):
        raise InputError(f"visual: expected a visual model, got {shown(visual)}")
    return visual


class _Figure:
    """A visual model beside its tree."""

    def __init__(self, model: pin.Model, visual_model: pin.GeometryModel) -> None:
        self.model, self.visual_model = model, visual_model


def _name(run: Shown) -> str:
    return "Run in time" if hasattr(run, "evaluations") else "Motion"


def _samples(
    loop: ClosedLoopModel, run: Shown | None, external: Mapping[str, ArrayLike] | None
) -> tuple[JointMotion, FloatArray | None, list[str]]:
    """Return motion, velocities if they are known, and notes."""
    if run is None:
        motion = JointMotion.at_rest(loop, None, external)
        return motion, np.zeros((1, loop.model.nv)), []
    if isinstance(run, JointMotion):
        if run.q.shape[1] != loop.model.nq:
            raise InputError(f"q: expected shape (N, {loop.model.nq}), got {run.q.shape}")
        return run, None, []
    acting = getattr(run, "external", None) or external
    motion = JointMotion.of_run(loop, run, acting)
    stop = getattr(run, "stop", None)
    return motion, run.v[spread(len(run.time))], [] if stop is None else [f"The run ended early: {stop}."]


def _layers(loop: ClosedLoopModel, figure: Drawable, solids: list[dict[str, Any]]) -> list[dict[str, Any]]:
    usual: Mapping[str, bool] = getattr(figure, "usual", {})
    there = {solid["layer"] for solid in solids}
    found: list[dict[str, Any]] = [
        {"name": name, "label": label, "shown": bool(usual.get(name, True))}
        for name, label in _LAYERS.items()
        if name in there
    ]
    closures = len(loop.sidecar.closures)
    return [*found, *([LAYER | {"shown": closures <= _FEW}] if closures else [])]


def _inputs(loop: ClosedLoopModel, q: FloatArray, half: float) -> list[dict[str, Any]]:
    """Return the actuated joints with their ranges, and their values in a configuration."""
    model, found = loop.model, []
    rows = zip(loop.actuated, slider_ranges(loop, q, half), values_of(loop, q).tolist(), strict=True)
    for name, (low, high), value in rows:
        joint = model.getJointId(name)
        unit = "m" if is_slide(loop, joint) else "rad"
        entry = {"key": name, "label": name, "unit": unit, "low": float(low), "high": float(high)}
        found.append(entry | {"value": float(value), "joint": int(joint) - 1})
    return found
