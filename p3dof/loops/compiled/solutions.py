"""Solutions of the equation of motion on a tape: forces of actuators, accelerations, how good they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from p3dof._base.tracing import Number, Symbol
from p3dof.loops.closed_tree import NEARLY_CLOSED, NEARLY_CONSISTENT
from p3dof.loops.compiled.dynamics import forces, mass_matrix, motion, velocities
from p3dof.loops.compiled.formulas import (
    LIGHTEST,
    MARGIN_OF_STATES,
    At,
    Moving,
    applied,
    larger,
    stays_closed,
)
from p3dof.loops.compiled.function import Builder
from p3dof.loops.compiled.pivots import solve_symmetric, symmetric_factors
from p3dof.loops.tree_formulas import ZERO, dot


class Borne(NamedTuple):
    """What bears a motion."""

    tau: list[Number]  # forces of the motors, the smallest ones
    rows: dict[int, Number]  # multipliers by row of the Jacobian; zero of redundant rows
    missing: list[Number]  # what no motor gives

    def multipliers(self, at: At) -> list[Number]:
        """Return the multipliers of the general layer."""
        return at.loops.multipliers([self.rows.get(row, 0.0) for row in range(len(at.rows))])


def completed_motion(
    at: At, v: Sequence[Number], a: Sequence[Number], load: Mapping[str, Sequence[Number]]
) -> tuple[Moving, list[Number], list[Number]]:
    """Return a robot in motion, with all velocities and accelerations, from those of independent speeds."""
    free, nv = at.robot.independent, at.robot.tree.nv
    all_v = at.completed(dict(zip(free, v, strict=True)), [0.0] * len(at.rows))
    moving = Moving(at, all_v, load)
    all_a = at.completed(dict(zip(free, a, strict=True)), moving.opening([0.0] * nv))
    return moving, all_v, all_a


def actuator_forces(at: At, needed: Sequence[Number]) -> Borne:
    """Return the motors' forces for generalised forces that are needed."""
    robot = at.robot
    free = robot.independent
    if all(motor in free for motor in robot.motors):
        force, rows = at.projected(needed)
        tau = [force[motor] for motor in robot.motors]
        missing = [force[i] for i in free if i not in robot.motors]
    else:
        tau = smallest_forces(at, needed)
        left = list(needed)
        for motor, value in zip(robot.motors, tau, strict=True):
            left[motor] = left[motor] - value
        force, rows = at.projected(left)
        missing = [force[i] for i in free]
    return Borne(tau, rows, missing)


def give_residuals(build: Builder, at: At, needed: Sequence[Number], borne: Borne) -> None:
    """Give the largest error of the equation of motion of all joints, and the errors of all closures."""
    left = list(needed)
    for motor, value in zip(at.robot.motors, borne.tau, strict=True):
        left[motor] = left[motor] - value
    for row, value in borne.rows.items():
        for place, factor in at.rows[row].items():
            left[place] = left[place] - factor * value
    build.give("residual", [largest_of(at, left)])
    build.give("closure_error", at.loops.multipliers(at.errors))


def largest_of(at: At, values: Sequence[Number]) -> Number:
    """Return the largest one of the absolute values."""
    squares: Number = 0.0
    for value in values:
        squares = larger(at.tape, squares, value * value)
    return at.tape.sqrt(squares)


def smallest_forces(at: At, needed: Sequence[Number]) -> list[Number]:
    """Return the smallest forces of redundant motors: Aᵀ (A Aᵀ)⁻¹ r with A = Nᵀ B."""
    robot = at.robot
    force, _ = at.projected(needed)
    A = {
        place: [1.0 if motor == place else at.null_space[place].get(motor, 0.0) for motor in robot.motors]
        for place in robot.independent
    }
    kept = [place for place, row in A.items() if any(isinstance(x, Symbol) or x != 0.0 for x in row)]
    squares = [[dot(A[i], A[j]) for j in kept] for i in kept]
    x = solve_symmetric(at.tape, squares, [force[i] for i in kept])
    return [dot([A[i][k] for i in kept], x) for k in range(len(robot.motors))]


def drift_of(at: At, moving: Moving, beta: Number | None = None) -> list[Number]:
    """Return what accelerations of the joints must make up for at the closures, with Baumgarte's terms."""
    drift = moving.opening([0.0] * at.robot.tree.nv, moved=beta is not None)
    if beta is None:
        return drift
    speeds = [applied(row, moving.v) for row in at.rows]
    return [
        bias + beta * (2.0 * speed + beta * error)
        for bias, speed, error in zip(drift, speeds, at.errors, strict=True)
    ]


def independent_accelerations(
    at: At, moving: Moving, tau: Sequence[Number], mass: Sequence[Sequence[Number]], drift: Sequence[Number]
) -> dict[int, Number]:
    """Return the accelerations of the independent speeds by place, under forces of the motors."""
    robot, free = at.robot, at.robot.independent
    start = at.completed(dict.fromkeys(free, 0.0), drift)
    left = [-x for x in moving.needed(start)]
    for motor, value in zip(robot.motors, tau, strict=True):
        left[motor] = left[motor] + value
    force, _ = at.projected(left)
    found = solve_symmetric(at.tape, mass, [force[i] for i in free])
    return dict(zip(free, found, strict=True))


def accelerated(
    at: At, moving: Moving, given: Mapping[int, Number], beta: Number | None = None
) -> tuple[list[Number], list[Number]]:
    """Return all accelerations from those of the motors, and what must be positive for that."""
    idle = [i for i in at.robot.independent if i not in at.robot.motors]
    start = at.completed({**given, **dict.fromkeys(idle, 0.0)}, drift_of(at, moving, beta))
    if not idle:
        return start, []
    force, _ = at.projected(moving.needed(start))
    inertia = projected_mass(at, idle, idle)
    found = solve_symmetric(at.tape, inertia, [-force[i] for i in idle])
    return with_more(at, start, dict(zip(idle, found, strict=True))), heavy(at, idle, inertia)


def projected_mass(at: At, rows: Sequence[int], columns: Sequence[int]) -> list[list[Number]]:
    """Return the entries of Nᵀ M N at independent places, both given in rising order."""
    M = mass_matrix(at.robot.tree, at.where)
    N = {place: {place: 1.0, **at.null_space[place]} for place in {*rows, *columns}}
    found: list[list[Number]] = []
    for i, row in enumerate(rows):
        entries: list[Number] = []
        pushed: dict[int, Number] = {}
        for place, factor in N[row].items():
            for other, mass in M[place].items():
                pushed[other] = pushed.get(other, 0.0) + mass * factor
        for j, column in enumerate(columns):
            if rows == columns and j > i:
                entries.append(0.0)  # only the lower half is looked at
                continue
            total: Number = 0.0
            for place, factor in N[column].items():
                if place in pushed:
                    total = total + factor * pushed[place]
            entries.append(total)
        found.append(entries)
    return found


def momenta(at: At, v: Sequence[Number]) -> list[Number]:
    """Return M v, as forces that accelerations v need at rest without weight."""
    tree, still = at.robot.tree, [0.0] * at.robot.tree.nv
    bodies = motion(tree, at.where, still, v, velocities(tree, at.where, still), ZERO)
    return [
        f + arm * x for f, arm, x in zip(forces(tree, at.where, bodies, {}), tree.armature, v, strict=True)
    ]


def heavy(at: At, places: Sequence[int], mass: Sequence[Sequence[Number]]) -> list[Number]:
    """Return what is positive where free motions have more inertia than rounding leaves."""
    sizes, found = inertias(at), list[Number]()
    for place, pivot in zip(places, symmetric_factors(at.tape, mass)[1], strict=True):
        size = sizes[place]
        for other, factor in at.null_space[place].items():
            size = size + factor * factor * sizes[other]
        found.append(at.tape.subtract(pivot, LIGHTEST * size))
    return found


def inertias(at: At) -> dict[int, Number]:
    """Return what every speed moves, about all axes of a ball together: about one it may be rounding."""
    M = mass_matrix(at.robot.tree, at.where)
    found: dict[int, Number] = {}
    for part in at.robot.tree.parts[1:]:
        turns = [any(axis) for axis in part.turning]
        for kind in (True, False):
            group = [place for place, turning in zip(part.v, turns, strict=True) if turning == kind]
            total: Number = 0.0
            for place in group:
                total = total + M[place].get(place, 0.0)
            found |= dict.fromkeys(group, total)
    return found


def with_more(at: At, start: Sequence[Number], more: Mapping[int, Number]) -> list[Number]:
    """Return rates with more of the independent ones."""
    found = list(start)
    for place, value in more.items():
        found[place] = found[place] + value
        for dependent, factor in at.null_space[place].items():
            found[dependent] = found[dependent] + factor * value
    return found


def evidence_of_state(build: Builder, at: At, v: Sequence[Number], limits: Sequence[Number]) -> None:
    """Give the evidence for what is found at a state, whose loops may be a little open."""
    speeds = [applied(row, v) for row in at.rows]
    opening = stays_closed(build.tape, speeds, NEARLY_CONSISTENT * at.robot.length, v)
    build.evidence(at, NEARLY_CLOSED, [opening, *limits], MARGIN_OF_STATES)
