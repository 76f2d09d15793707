"""The functions that are compiled: forces, accelerations, completion, and how they change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from p3dof.closed_loop.closed_tree import CLOSED, CONSISTENT, NEARLY_CLOSED, NEARLY_CONSISTENT
from p3dof.closed_loop.compiled.dynamics import mass_matrix
from p3dof.closed_loop.compiled.formulas import At, Moving, Robot
from p3dof.closed_loop.compiled.function import Builder, Function
from p3dof.closed_loop.compiled.limits import (
    LIGHTEST,
    MARGIN_OF_STATES,
    applied,
    nothing_missing,
    stays_closed,
)
from p3dof.closed_loop.compiled.pivots import solve_symmetric, symmetric_factors
from p3dof.closed_loop.compiled.rates import moved, seeds_of
from p3dof.closed_loop.compiled.vectors import dot
from p3dof.errors import ModelError
from p3dof.tracing import Number, Symbol
from p3dof.tracing.derivatives import tangent

_FOLLOWED = 1e-4
"""What is left of the largest gap where Newton's steps along a motion ended well."""


def jacobian_rows(robot: Robot) -> Function:
    """Return the Jacobian of closures and couplings at q, all entries: what a plan is made from."""
    build = Builder()
    at = At(robot, build.tape, build.take("q", robot.tree.nq))
    nv = robot.tree.nv
    build.give("J", [row.get(i, 0.0) for row in at.rows for i in range(nv)])
    return build.function("jacobian_rows")


def inverse_dynamics(robot: Robot) -> Function:
    """Return forces and multipliers of a motion (q, v, a), and whether it keeps the loops closed."""
    build = Builder()
    tree = robot.tree
    q, v, a = (build.take(name, size) for name, size in (("q", tree.nq), ("v", tree.nv), ("a", tree.nv)))
    robot, load = build.loaded(robot)
    at = At(robot, build.tape, q)
    moving = Moving(at, v, load)
    bodies = moving.motion(a)
    needed = moving.needed(a, bodies)
    tau, multipliers, missing = _actuated(at, needed)
    build.give("tau", tau)
    build.give("lambda_", multipliers)
    speeds = [applied(row, v) for row in at.rows]
    limits = [
        stays_closed(build.tape, speeds, CONSISTENT * robot.length, v),
        stays_closed(build.tape, moving.opening(a, bodies), CONSISTENT * robot.length, v, a),
        nothing_missing(build.tape, missing, (*tau, *multipliers)),
    ]
    build.evidence(at, CLOSED, limits)
    return build.function("inverse_dynamics")


def motion(robot: Robot) -> Function:
    """Return velocity and acceleration of the tree from those of the independent speeds, and the forces."""
    build = Builder()
    tape, tree, free = build.tape, robot.tree, robot.independent
    q, v, a = (
        build.take(name, size)
        for name, size in (("q", tree.nq), ("v_independent", len(free)), ("a_independent", len(free)))
    )
    robot, load = build.loaded(robot)
    at = At(robot, tape, q)
    moving, all_v, all_a = _completed(at, v, a, load)
    tau, multipliers, missing = _actuated(at, moving.needed(all_a))
    build.give("v", all_v)
    build.give("a", all_a)
    build.give("tau", tau)
    build.give("lambda_", multipliers)
    build.evidence(at, CLOSED * _FOLLOWED, [nothing_missing(tape, missing, (*tau, *multipliers))])
    return build.function("motion")


def tangent_of_forces(robot: Robot) -> Function:
    """Return forces and their derivative along one direction of the independent motion."""
    build = Builder()
    tape, tree, free = build.tape, robot.tree, robot.independent
    n = len(free)
    q, v, a = (
        build.take(name, size) for name, size in (("q", tree.nq), ("v_independent", n), ("a_independent", n))
    )
    robot, load = build.loaded(robot)
    dq, dv, da = (build.take(name, n) for name in ("dq", "dv", "da"))
    at = At(robot, tape, q)
    moving, _, all_a = _completed(at, v, a, load)
    tau, _, _ = _actuated(at, moving.needed(all_a))
    seeds = seeds_of(at, dict(zip(free, dq, strict=True)))
    seeds |= {symbol.index: seed for symbol, seed in zip((*v, *a), (*dv, *da), strict=True)}
    build.give("tau", tau)
    build.give("dtau", tangent(tau, seeds))
    build.evidence(at, CLOSED, margin=MARGIN_OF_STATES)
    return build.function("tangent_of_forces")


def forward_dynamics(robot: Robot, stabilised: bool = False) -> Function:
    """Return the acceleration of the tree from its state and the motors' forces."""
    build = Builder()
    tree, free = robot.tree, robot.independent
    q, v = build.take("q", tree.nq), build.take("v", tree.nv)
    tau = build.take("tau", len(robot.motors))
    robot, load = build.loaded(robot)
    beta = build.take("stabilisation", 1)[0] if stabilised else None
    at = At(robot, build.tape, q)
    moving = Moving(at, v, load)
    drift = _drift(at, moving, beta)
    mass = _projected_mass(at, free, free)
    found = _independent_accelerations(at, moving, tau, mass, drift)
    build.give("a", at.completed(found, drift))
    _evidence_of_state(build, at, v, _heavy(at, free, mass))
    return build.function("stabilised_forward_dynamics" if stabilised else "forward_dynamics")


def tangent_of_accelerations(robot: Robot) -> Function:
    """Return the acceleration and its derivative along one direction of state and forces."""
    build = Builder()
    tape, tree, free = build.tape, robot.tree, robot.independent
    n = len(free)
    q, v = build.take("q", tree.nq), build.take("v_independent", n)
    tau = build.take("tau", len(robot.motors))
    robot, load = build.loaded(robot)
    dq, dv, dtau = build.take("dq", n), build.take("dv", n), build.take("dtau", len(robot.motors))
    at = At(robot, tape, q)
    all_v = at.completed(dict(zip(free, v, strict=True)), [0.0] * len(at.rows))
    moving = Moving(at, all_v, load)
    mass = _projected_mass(at, free, free)
    drift = _drift(at, moving)
    found = _independent_accelerations(at, moving, tau, mass, drift)
    # What is out of balance when q and v change and the accelerations stay is what they have to make up for.
    a = at.completed(found, drift)
    left = [-x for x in moving.needed(a)]
    for motor, value in zip(robot.motors, tau, strict=True):
        left[motor] = left[motor] + value
    balance, _ = at.projected(left)
    seeds = seeds_of(at, dict(zip(free, dq, strict=True)))
    seeds |= {symbol.index: seed for symbol, seed in zip((*v, *tau), (*dv, *dtau), strict=True)}
    kept = {x.index: 0.0 for x in found.values() if isinstance(x, Symbol)}
    lost = tangent([balance[i] for i in free], {**seeds, **kept})
    made = solve_symmetric(tape, mass, lost)
    moved = {x.index: dx for x, dx in zip(found.values(), made, strict=True) if isinstance(x, Symbol)}
    build.give("a", a)
    build.give("da", tangent(a, {**seeds, **moved}))
    build.evidence(at, CLOSED, _heavy(at, free, mass), MARGIN_OF_STATES)
    return build.function("tangent_of_accelerations")


def hybrid_dynamics(robot: Robot, stabilised: bool = False) -> Function:
    """Return forces and the acceleration of the tree from the accelerations of the motors."""
    build = Builder()
    tape, tree, free = build.tape, robot.tree, robot.independent
    held, idle = [i for i in free if i in robot.motors], [i for i in free if i not in robot.motors]
    if len(held) != len(robot.motors):
        raise ModelError("hybrid dynamics: more actuators than freedoms; their accelerations are not free")
    q, v = build.take("q", tree.nq), build.take("v", tree.nv)
    given = dict(zip(robot.motors, build.take("a_actuated", len(robot.motors)), strict=True))
    robot, load = build.loaded(robot)
    beta = build.take("stabilisation", 1)[0] if stabilised else None
    at = At(robot, tape, q)
    moving = Moving(at, v, load)
    start = at.completed({**given, **dict.fromkeys(idle, 0.0)}, _drift(at, moving, beta))
    a, limits = start, list[Number]()
    if idle:
        force, _ = at.projected(moving.needed(start))
        inertia = _projected_mass(at, idle, idle)
        limits = _heavy(at, idle, inertia)
        found = solve_symmetric(tape, inertia, [-force[i] for i in idle])
        a = _added(at, start, dict(zip(idle, found, strict=True)))
    tau, multipliers, _ = _actuated(at, moving.needed(a))
    build.give("tau", tau)
    build.give("a", a)
    build.give("lambda_", multipliers)
    _evidence_of_state(build, at, v, limits)
    return build.function("stabilised_hybrid_dynamics" if stabilised else "hybrid_dynamics")


def step(robot: Robot) -> Function:
    """Return q after one Newton step of the dependent coordinates, with the gap before it."""
    build = Builder()
    q = build.take("q", robot.tree.nq)
    at = At(robot, build.tape, q)
    right = {row: -at.errors[row] for row in robot.plan.rows}
    shift = at.factors.solve(right)
    build.give("q", moved(at, shift))
    build.evidence(at, CLOSED)
    return build.function("step")


def integrate(robot: Robot) -> Function:
    """Return q moved by a small rate times time: a prediction for `step`."""
    build = Builder()
    q, shift = build.take("q", robot.tree.nq), build.take("dq", robot.tree.nv)
    build.give("q", moved(At(robot, build.tape, q), dict(enumerate(shift))))
    return build.function("integrate")


FUNCTIONS: Mapping[str, Callable[[Robot], Function]] = {
    "inverse_dynamics": inverse_dynamics,
    "hybrid_dynamics": hybrid_dynamics,
    "forward_dynamics": forward_dynamics,
    "stabilised_hybrid_dynamics": partial(hybrid_dynamics, stabilised=True),
    "stabilised_forward_dynamics": partial(forward_dynamics, stabilised=True),
    "motion": motion,
    "step": step,
    "integrate": integrate,
    "tangent_of_forces": tangent_of_forces,
    "tangent_of_accelerations": tangent_of_accelerations,
}
"""What can be compiled, by name."""


def _completed(
    at: At, v: Sequence[Number], a: Sequence[Number], load: Mapping[str, Sequence[Number]]
) -> tuple[Moving, list[Number], list[Number]]:
    free, nv = at.robot.independent, at.robot.tree.nv
    all_v = at.completed(dict(zip(free, v, strict=True)), [0.0] * len(at.rows))
    moving = Moving(at, all_v, load)
    all_a = at.completed(dict(zip(free, a, strict=True)), moving.opening([0.0] * nv))
    return moving, all_v, all_a


def _actuated(at: At, needed: Sequence[Number]) -> tuple[list[Number], list[Number], list[Number]]:
    """Return the motors' forces, the smallest ones, all multipliers, and what no motor gives."""
    robot, plan = at.robot, at.robot.plan
    free = robot.independent
    if all(motor in free for motor in robot.motors):
        force, rows = at.projected(needed)
        tau = [force[motor] for motor in robot.motors]
        missing = [force[i] for i in free if i not in robot.motors]
    else:
        tau = _smallest(at, needed)
        left = list(needed)
        for motor, value in zip(robot.motors, tau, strict=True):
            left[motor] = left[motor] - value
        force, rows = at.projected(left)
        missing = [force[i] for i in free]
    values = [rows.get(row, 0.0) for row in range(len(at.rows))] if plan.pivots else [0.0] * len(at.rows)
    return tau, at.loops.multipliers(values), missing


def _smallest(at: At, needed: Sequence[Number]) -> list[Number]:
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


def _drift(at: At, moving: Moving, beta: Number | None = None) -> list[Number]:
    """Return what accelerations of the joints must make up for at the closures, with Baumgarte's terms."""
    drift = moving.opening([0.0] * at.robot.tree.nv, moved=beta is not None)
    if beta is None:
        return drift
    speeds = [applied(row, moving.v) for row in at.rows]
    return [
        bias + beta * (2.0 * speed + beta * error)
        for bias, speed, error in zip(drift, speeds, at.errors, strict=True)
    ]


def _independent_accelerations(
    at: At,
    moving: Moving,
    tau: Sequence[Number],
    mass: Sequence[Sequence[Number]],
    drift: Sequence[Number],
) -> dict[int, Number]:
    robot, free = at.robot, at.robot.independent
    start = at.completed(dict.fromkeys(free, 0.0), drift)
    left = [-x for x in moving.needed(start)]
    for motor, value in zip(robot.motors, tau, strict=True):
        left[motor] = left[motor] + value
    force, _ = at.projected(left)
    found = solve_symmetric(at.tape, mass, [force[i] for i in free])
    return dict(zip(free, found, strict=True))


def _projected_mass(at: At, rows: Sequence[int], columns: Sequence[int]) -> list[list[Number]]:
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


def _heavy(at: At, places: Sequence[int], mass: Sequence[Sequence[Number]]) -> list[Number]:
    """Return what is positive where free motions have more inertia than rounding leaves."""
    sizes, found = _inertias(at), list[Number]()
    for place, pivot in zip(places, symmetric_factors(at.tape, mass)[1], strict=True):
        size = sizes[place]
        for other, factor in at.null_space[place].items():
            size = size + factor * factor * sizes[other]
        found.append(at.tape.subtract(pivot, LIGHTEST * size))
    return found


def _inertias(at: At) -> dict[int, Number]:
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


def _added(at: At, start: Sequence[Number], more: Mapping[int, Number]) -> list[Number]:
    """Return rates with more of the independent ones."""
    found = list(start)
    for place, value in more.items():
        found[place] = found[place] + value
        for dependent, factor in at.null_space[place].items():
            found[dependent] = found[dependent] + factor * value
    return found


def _evidence_of_state(build: Builder, at: At, v: Sequence[Number], limits: Sequence[Number]) -> None:
    speeds = [applied(row, v) for row in at.rows]
    opening = stays_closed(build.tape, speeds, NEARLY_CONSISTENT * at.robot.length, v)
    build.evidence(at, NEARLY_CLOSED, [opening, *limits], MARGIN_OF_STATES)
