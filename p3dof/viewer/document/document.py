"""The document of the page: what the machine and any robot share of it, and that of any robot.

The reference of the documentation describes the format, as does ``document.schema.json`` beside this file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, require, shown
from p3dof._base.errors import InputError
from p3dof._base.version import __version__
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import is_slide, joint_values
from p3dof.viewer.document.encoding import layer, setting, some_of
from p3dof.viewer.document.figure import Drawable, StickFigure
from p3dof.viewer.document.motion import MOST_SAMPLES, JointMotion, Run
from p3dof.viewer.document.robot_engine import engine_of
from p3dof.viewer.document.runs import MULTIPLIERS, robot_run
from p3dof.viewer.document.solids import BUDGET, robot_solids, room_of
from p3dof.viewer.document.trees import bodies_of, closures_of, tree_of

FORMAT = 1
"""Of the documents that are written; a page refuses a newer one."""
Shown = JointMotion | Run
"""What can be a run of a document."""
_FEW = 4
"""What so many closures transmit is shown at first."""
_LAYERS = {"shapes": "Shapes", "sticks": "Rods"}


def as_document(
    loop: ClosedLoopModel,
    title: str,
    identity: tuple[str, str],
    scene: dict[str, Any],
    runs: list[dict[str, Any]],
    inputs: list[dict[str, Any]],
    engine: dict[str, Any],
    **more: Any,
) -> dict[str, Any]:
    """Return the document of what the machine, or any robot, says of itself; `identity`: name and hash."""
    name, number = identity
    return {
        "format": FORMAT,
        "title": title,
        "generator": {"p3dof": __version__, "pinocchio": str(pin.__version__)},
        "machine": {"name": name, "hash": number},
        "scene": scene,
        "runs": runs,
        "closures": closures_of(loop),
        "inputs": inputs,
        **more,
        "engine": engine,
    }


def as_scene(
    model: pin.Model,
    points: FloatArray,
    solids: list[dict[str, Any]],
    layers: list[dict[str, Any]],
    labels: Iterable[dict[str, Any]] = (),
    **more: Any,
) -> dict[str, Any]:
    """Return the scene of a document, whose camera sees all points (N, 3) [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    return {
        "centre": ((low + high) / 2).tolist(),
        "radius": max(float(np.linalg.norm(high - low)) / 2, 1e-6),
        "floor": float(low[2]),
        "joints": [
            joint | {"body": body} for joint, body in zip(tree_of(model), bodies_of(model), strict=True)
        ],
        "solids": solids,
        "labels": list(labels),
        "lines": [],
        "layers": layers,
        **more,
    }


def check_asked(runs: object, title: object) -> None:
    """Raise unless runs are given by name, and the title is text."""
    if not isinstance(title, str):
        raise InputError(f"title: expected text, got {shown(title)}")
    if not isinstance(runs, Mapping | None):
        raise InputError(f"runs: expected runs by name, got {shown(runs)}")


def robot_document(
    loop: ClosedLoopModel,
    visual: Drawable | pin.GeometryModel | None = None,
    run: Shown | None = None,
    *,
    runs: Mapping[str, Shown] | None = None,
    external: Mapping[str, ArrayLike] | None = None,
    title: str | None = None,
    engine: Literal["page", "ask", "none"] = "page",
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
    engine : {"page", "ask", "none"}
        Who computes other configurations: the page, by the robot's own dynamics that it carries; a Python
        that it can ask; or nobody.
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
    given: list[tuple[str, Shown | None]] = (
        [] if run is None else [("Simulation" if hasattr(run, "evaluations") else "Motion", run)]
    )
    given += [(str(name), one) for name, one in (runs or {}).items()]
    given = given or [("Held at rest", None)]
    figure = _figure(loop, visual)
    found = [(name, *_samples(loop, one, external)) for name, one in given]
    notes = list(getattr(figure, "notes", ()))
    solids, more = robot_solids(figure, triangles)
    notes += more
    points = room_of(loop.model, figure.visual_model, np.concatenate([motion.q for _, motion, _, _ in found]))
    first, half = np.array(found[0][1].q[0]), float(np.ptp(points, axis=0).max()) / 2
    name = str(loop.model.name)
    return as_document(
        loop,
        name if title is None else title,
        (name, robot_hash(loop)),
        as_scene(loop.model, points, solids, _layers(loop, figure, solids)),
        [robot_run(loop, motion, v, words, notes + told) for words, motion, v, told in found],
        _inputs(loop, first, half),
        _own_engine(loop, found[0][1]) if engine == "page" else {"kind": engine},
    )


def _own_engine(loop: ClosedLoopModel, motion: JointMotion) -> dict[str, Any]:
    """Return the engine of a page that begins with a motion, under the wrenches of its beginning."""
    return engine_of(loop, np.array(motion.q[0]), {name: rows[0] for name, rows in motion.acting.items()})


def robot_hash(loop: ClosedLoopModel) -> str:
    """Return a hash of all numbers of a robot that its motions depend on; SHA-256, in hexadecimal digits."""
    model = loop.model
    bodies = [inertia.toDynamicParameters().tolist() for inertia in model.inertias]
    numbers = [tree_of(model), bodies, model.gravity.vector.tolist(), repr(loop.sidecar)]
    return hashlib.sha256(json.dumps(numbers).encode()).hexdigest()


def _check(loop: object, runs: object, title: object, engine: object, triangles: object) -> None:
    require("robot", loop, ClosedLoopModel)
    check_asked(runs, "" if title is None else title)
    if engine not in ("page", "ask", "none"):
        raise InputError(f"engine: expected 'page', 'ask' or 'none', got {shown(engine)}")
    if isinstance(triangles, bool) or not isinstance(triangles, int) or triangles < 1:
        raise InputError(f"triangles: expected a positive whole number, got {shown(triangles)}")


def _figure(loop: ClosedLoopModel, visual: Drawable | pin.GeometryModel | None) -> Drawable:
    if visual is None:
        return StickFigure(loop)
    if isinstance(visual, pin.GeometryModel):
        return SimpleNamespace(model=loop.model, visual_model=visual)
    if not hasattr(visual, "visual_model"):
        raise InputError(f"visual: expected a visual model, got {shown(visual)}")
    return visual


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
    v, stop = run.v[some_of(len(run.time), MOST_SAMPLES)], getattr(run, "stop", None)
    return motion, v, [] if stop is None else [f"The run ended early: {stop}."]


def _layers(loop: ClosedLoopModel, figure: Drawable, solids: list[dict[str, Any]]) -> list[dict[str, Any]]:
    usual: Mapping[str, bool] = getattr(figure, "usual", {})
    there = {solid["layer"] for solid in solids}
    found = [
        layer(name, label, bool(usual.get(name, True))) for name, label in _LAYERS.items() if name in there
    ]
    closures = len(loop.sidecar.closures)
    return [*found, *([layer(MULTIPLIERS, "Forces in closures", closures <= _FEW)] if closures else [])]


def _inputs(loop: ClosedLoopModel, q: FloatArray, half: float) -> list[dict[str, Any]]:
    """Return the actuated joints with their ranges, and their values in a configuration."""
    model, found = loop.model, []
    rows = zip(loop.actuated, slider_ranges(loop, q, half), values_of(loop, q).tolist(), strict=True)
    for name, (low, high), value in rows:
        joint = model.getJointId(name)
        unit = "m" if is_slide(loop, joint) else "rad"
        found.append(setting(name, name, unit, (float(low), float(high)), value) | {"joint": int(joint) - 1})
    return found


_UNLIMITED = 1e3
"""A joint whose limits are farther apart has none worth a slider [m or rad]."""


def values_of(robot: ClosedLoopModel, q: FloatArray) -> FloatArray:
    """Return the values (n,) of the actuated joints at a configuration (nq,) [m or rad]."""
    found = joint_values(robot, q)
    return np.array([float(found[name][0]) for name in robot.actuated])


def slider_ranges(robot: ClosedLoopModel, q: FloatArray, half: float) -> list[tuple[float, float]]:
    """Return how far the sliders of the actuated joints go [m or rad].

    That is to their limits; where there are none, half a turn to either side of zero, or half the robot's
    size to either side of where it is.
    """
    model, ranges = robot.model, []
    for name, value in zip(robot.actuated, values_of(robot, q).tolist(), strict=True):
        joint = model.getJointId(name)
        low, high = (value - half, value + half) if is_slide(robot, joint) else (-np.pi, np.pi)
        if model.nqs[joint] == 1:
            limits = (model.lowerPositionLimit, model.upperPositionLimit)
            least, most = (float(limit[model.idx_qs[joint]]) for limit in limits)
            low, high = (least, most) if 0 < most - least < _UNLIMITED else (low, high)
        ranges.append((min(low, value), max(high, value)))
    return ranges
