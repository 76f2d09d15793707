"""Assemblies beyond the next one: within the limits of joints, and all that there are at a target."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError
from p3dof.loops.assembly import RESTARTS, SAME, TOLERANCE, Assembler
from p3dof.loops.assembly_results import Assembly
from p3dof.loops.linear import Decomposition
from p3dof.loops.solver import Path, Point, System
from p3dof.loops.targets import Target
from p3dof.loops.trust import Limits, levenberg_marquardt


def assemble_within_limits(
    assembler: Assembler, target: Target, guess: FloatArray | None, tolerance: float
) -> Assembly:
    """Close the loops at a target with all joints within their limits.

    Parameters
    ----------
    assembler : Assembler
        The model.
    target : Target
        The target.
    guess : (nq,) array, optional
        Where to start; the reference configuration by default.
    tolerance : float
        Largest closure and target error that counts as closed [m or rad].

    Returns
    -------
    Assembly

    Raises
    ------
    AssemblyError
        If the loops cannot be closed so.
    """
    model = assembler.model
    found, limits = assembler.assemble(target, guess, tolerance), Limits(model)
    system, count = System(assembler.kinematics, target), found.iterations
    start, generator = assembler.reference if guess is None else guess, np.random.default_rng(0)
    if not limits.beyond(found.q):
        if not limits.turns(found.q, start):
            return found
        point = _unwound(system, limits, system.at(found.q), start)
        return assembler.found(Path(point, True, count), lambda q: assembler.on_home(system, q))
    far = (limits.random(model, start, generator) for _ in range(RESTARTS))
    best: Path | None = None
    for origin in (found.q, start, *far):
        path = levenberg_marquardt(system, origin, tolerance, limits)
        count += path.iterations
        best = path if best is None or path.point.gap < best.point.gap else best
        if best.complete:
            point = _unwound(system, limits, best.point, start)
            return assembler.found(Path(point, True, count), lambda q: assembler.on_home(system, q))
    gap = best.point.gap if best else np.inf
    raise AssemblyError(
        f"the loops close{' at the target' if target.size else ''} beyond the limits of joints only: "
        f"{limits.told(found.q)}; within them {gap:.3g} m or rad is left",
        gap,
    )


def _unwound(system: System, limits: Limits, point: Point, start: FloatArray) -> Point:
    """Take back whole turns of joints that lead away from the start, where nothing asks for them."""
    for at, shift in limits.turns(point.q, start):
        q = point.q.copy()
        q[at] += shift
        there = system.at(q)
        if there.gap <= max(TOLERANCE, point.gap):  # a target or a coupling may count turns
            point = there
    return point


def assembly_modes(
    assembler: Assembler, target: Target, starts: int, seed: int, within: bool
) -> tuple[Assembly, ...]:
    """Find all configurations that close the loops at a target, from random starts.

    Parameters
    ----------
    assembler : Assembler
        The model.
    target : Target
        The target.
    starts : int
        How many there are.
    seed : int
        Of the random numbers.
    within : bool
        Whether joints have to stay within their limits.

    Returns
    -------
    tuple of Assembly
        That nearest to the reference configuration first.

    Raises
    ------
    AssemblyError
        If there is none, or closures and target leave free motions.
    """
    model = assembler.model
    system, generator, limits = (
        System(assembler.kinematics, target),
        np.random.default_rng(seed),
        Limits(model),
    )
    # Whole turns of a joint make no other mode, unless another joint follows it through gears.
    apart_of = pin.difference if assembler.kinematics.couplings.size else limits.apart
    found: list[tuple[float, Assembly]] = []
    best: Path | None = None
    for k in range(starts):
        origin = assembler.reference if k == 0 else limits.random(model, assembler.reference, generator)
        path = levenberg_marquardt(system, origin, TOLERANCE, limits if within else None)
        best = path if best is None or path.point.gap < best.point.gap else best
        apart = [np.linalg.norm(apart_of(model, one.q, path.point.q)) for _, one in found]
        if not path.complete or min(apart, default=np.inf) < SAME:
            continue
        _check_determined(model, path.point)
        away = float(np.linalg.norm(apart_of(model, assembler.reference, path.point.q)))
        found.append((away, assembler.found(path, lambda q: assembler.on_home(system, q))))
    if not found and best is not None:
        raise assembler.failure(best, system)
    return tuple(one for _, one in sorted(found, key=lambda item: item[0]))


def _check_determined(model: pin.Model, point: Point) -> None:
    free = model.nv - Decomposition.of(point.J, point.rank_tolerance).rank
    if free:
        raise AssemblyError(
            f"the target leaves {free} free motions, so that there are no single configurations to count",
            point.gap,
        )
