"""A robot's own dynamics for its page: traced functions as WebAssembly, and samples that they are checked by.

The page does the linear algebra, so that it needs no plan of pivots and masses, gravity and loads can change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError, ModelError, P3dofError
from p3dof._base.tracing.wasm import Traced, module_of
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiled.formulas import Load
from p3dof.loops.compiled.functions import unplanned_functions
from p3dof.loops.compiled.robot import closed_configurations, unplanned
from p3dof.loops.tree_formulas import ZERO
from p3dof.viewer.document.encoding import encoded, finite
from p3dof.viewer.document.trees import place_of, tree_of

_CHECKED = 4
"""How many samples of Pinocchio's a page compares its own forces with."""
_UNLIMITED = 1e9
"""Larger limits of forces or positions are none [N, N m, m, rad]."""


def engine_of(
    loop: ClosedLoopModel, q: FloatArray, external: Mapping[str, FloatArray] | None = None
) -> dict[str, Any]:
    """Return the engine of a document: what a page needs to move a robot and to compute its forces.

    `q`: a configuration whose loops are nearly closed, (nq,). `external`: wrenches (6,) that act on frames.
    Where the page cannot compute a robot, `kind` is ``none`` and `why` says the reason.
    """
    model = loop.model
    placed = [joint["name"] for joint in tree_of(model) if joint["kind"] == "placed"]
    if placed:
        return {"kind": "none", "why": f"joint {placed[0]} is of a kind that this page cannot move"}
    try:
        robot = unplanned(loop)
    except ModelError as error:
        return {"kind": "none", "why": str(error)}
    names, of = [str(name) for name in model.names][1:], robot.tree.of_joint[1:]
    loads = tuple(Load(name, part, ZERO) for name, part in zip(names, of, strict=True))
    robot = replace(robot, loads=loads, inertias=dict(zip(names, of, strict=True)))
    parts = unplanned_functions(robot)
    traced = {name: Traced(f.tape, f.symbols, f.results) for name, f in parts.functions.items()}
    effort = [float(x) for x in model.upperEffortLimit[loop.actuated_v]]
    return {
        "kind": "loop",
        "module": encoded(np.frombuffer(module_of(traced), np.uint8), "uint8"),
        "nq": model.nq,
        "nv": model.nv,
        "v": [[int(model.idx_vs[i]), int(model.nvs[i])] for i in range(1, model.njoints)],
        "motors": [int(model.getJointId(name)) - 1 for name in loop.actuated],
        "effort": [x if 0 < x < _UNLIMITED else None for x in effort],
        "limits": [_limits(model, i) for i in range(1, model.njoints)],
        "rows": [span.stop - span.start for span in loop.constraint_rows],
        "rank": loop.generic_rank,
        "entries": encoded(np.array(parts.entries, dtype=int).reshape(-1, 2), "int32"),
        "mass": encoded(np.array(parts.mass, dtype=int).reshape(-1, 2), "int32"),
        "gravity": model.gravity.linear.tolist(),
        "inertias": encoded([model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]),
        "external": [_wrench(model, name, wrench) for name, wrench in (external or {}).items()],
        "check": _samples(loop, q),
    }


def _limits(model: pin.Model, joint: int) -> list[float | None]:
    """Return the lowest and the highest position of a joint; None where it has none."""
    if model.nqs[joint] != 1 or model.nvs[joint] != 1:
        return [None, None]
    at = model.idx_qs[joint]
    ends = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
    return [end if abs(end) < _UNLIMITED and ends[0] < ends[1] else None for end in ends]


def _wrench(model: pin.Model, name: str, wrench: FloatArray) -> dict[str, Any]:
    body = model.existFrame(name, pin.FrameType.BODY)
    number = model.getFrameId(name, pin.FrameType.BODY) if body else model.getFrameId(name)
    joint, point = place_of(model.frames[number])
    return {"frame": name, "joint": joint, "point": point, "wrench": [finite(float(x)) for x in wrench]}


def _samples(loop: ClosedLoopModel, q: FloatArray) -> dict[str, Any]:
    """Return states in motion with forces and accelerations as Pinocchio's layer has them."""
    draw, rows = np.random.default_rng(0), []
    count = len(loop.actuated)
    try:
        start = loop.assemble(None, q).q
    except AssemblyError:
        start = q
    for place in closed_configurations(loop, start)[:_CHECKED]:
        J = loop.closure_jacobian(place)
        N = np.linalg.svd(J)[2][loop.rank(place) :].T if J.size else np.eye(loop.model.nv)
        v = N @ draw.normal(size=N.shape[1])
        still = pin.rnea(loop.model, loop.model.createData(), place, 0 * v, 0 * v)
        tau = draw.normal(size=count) * max(1.0, float(np.abs(still).max(initial=0.0)))
        try:
            a = loop.forward_dynamics(place, v, tau).a
            known = loop.inverse_dynamics(place, v, a).tau if count else tau
        except P3dofError:
            continue  # a singular pose, or a free motion without inertia
        rows.append((place, v, tau, a, known))
    columns = [np.array(column) for column in zip(*rows, strict=True)] or [np.zeros((0, 0))] * 5
    return {name: encoded(x) for name, x in zip(("q", "v", "tau", "a", "forces"), columns, strict=True)}
