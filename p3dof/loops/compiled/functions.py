"""The functions that are compiled: forces, accelerations, completion, and how they change."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from p3dof._base.errors import ModelError
from p3dof._base.tracing import Number, Symbol
from p3dof._base.tracing.tape import tangent
from p3dof.loops.closed_tree import CLOSED, CONSISTENT, NEARLY_CLOSED
from p3dof.loops.compiled import solutions
from p3dof.loops.compiled.dynamics import mass_matrix
from p3dof.loops.compiled.formulas import (
    MARGIN_OF_STATES,
    At,
    Moving,
    Robot,
    applied,
    moved,
    nothing_missing,
    rates_of,
    seeds_of,
    stays_closed,
    with_units,
)
from p3dof.loops.compiled.function import Builder, Function
from p3dof.loops.compiled.pivots import solve_symmetric
from p3dof.loops.tree_formulas import placements


def flow(robot: Robot) -> Function:
    """Return the rates of a state (q, independent v) under forces of the motors, with all that belongs to it.

    The configuration may be a little open, its quaternions and circles a little long: the ``q`` that is
    returned is one step of Newton's method nearer. All speeds follow from the independent ones, so that rates
    are those of a motion that keeps the loops closed.
    """
    build = Builder()
    tree, free = robot.tree, robot.independent
    q, v = build.take("q", tree.nq), build.take("v_independent", len(free))
    tau = build.take("tau", len(robot.motors))
    robot, load = build.loaded(robot)
    at, all_v = _state(build, robot, q, v)
    shift = at.factors.solve({row: -at.errors[row] for row in robot.plan.rows})
    moving = Moving(at, all_v, load)
    mass, drift = solutions.projected_mass(at, free, free), solutions.drift_of(at, moving)
    found = solutions.independent_accelerations(at, moving, tau, mass, drift)
    build.give("q", moved(at, shift))
    build.give("rate", rates_of(at, all_v))
    build.give("a_independent", [found[i] for i in free])
    build.give("v", all_v)
    build.give("a", at.completed(found, drift))
    build.evidence(at, NEARLY_CLOSED, solutions.heavy(at, free, mass), MARGIN_OF_STATES)
    return build.function("flow")


def stabilised_flow(robot: Robot) -> Function:
    """Return the rates of a state (q, v) under forces of the motors, with Baumgarte's stabilisation.

    They are those that `p3dof.runs.plants.ConstrainedPlant` integrates: circles and quaternions are of
    length one before anything else.
    """
    build = Builder()
    tree, free = robot.tree, robot.independent
    q, v = build.take("q", tree.nq), build.take("v", tree.nv)
    tau = build.take("tau", len(robot.motors))
    robot, load = build.loaded(robot)
    beta = build.take("stabilisation", 1)[0]
    at = At(robot, build.tape, with_units(tree, build.tape, q))
    moving = Moving(at, v, load)
    mass, drift = solutions.projected_mass(at, free, free), solutions.drift_of(at, moving, beta)
    found = solutions.independent_accelerations(at, moving, tau, mass, drift)
    build.give("q", at.q)
    build.give("rate", rates_of(at, v))
    build.give("a", at.completed(found, drift))
    solutions.evidence_of_state(build, at, v, solutions.heavy(at, free, mass))
    return build.function("stabilised_flow")


def model_forces(robot: Robot) -> Function:
    """Return the motors' forces for their accelerations at a state (q, independent v)."""
    if not set(robot.motors) <= set(robot.independent):
        raise ModelError("model forces: more actuators than freedoms; their accelerations are not free")
    build = Builder()
    q, v = build.take("q", robot.tree.nq), build.take("v_independent", len(robot.independent))
    wanted = dict(zip(robot.motors, build.take("a_actuated", len(robot.motors)), strict=True))
    robot, load = build.loaded(robot)
    at, all_v = _state(build, robot, q, v)
    moving = Moving(at, all_v, load)
    a, limits = solutions.accelerated(at, moving, wanted)
    build.give("tau", solutions.actuator_forces(at, moving.needed(a)).tau)
    build.evidence(at, NEARLY_CLOSED, limits, MARGIN_OF_STATES)
    return build.function("model_forces")


def _state(build: Builder, robot: Robot, q: Sequence[Number], v: Sequence[Number]) -> tuple[At, list[Number]]:
    """Return a robot at a configuration with units of length one, and all its speeds."""
    at = At(robot, build.tape, with_units(robot.tree, build.tape, q))
    return at, at.completed(dict(zip(robot.independent, v, strict=True)), [0.0] * len(at.rows))


FOLLOWED = 1e-4  # what is left of the largest gap where Newton's steps along a motion ended well


def jacobian_rows(robot: Robot) -> Function:
    """Return the Jacobian of closures and couplings at q, all entries: what a plan is made from."""
    build = Builder()
    at = At(robot, build.tape, build.take("q", robot.tree.nq))
    nv = robot.tree.nv
    build.give("J", [row.get(i, 0.0) for row in at.rows for i in range(nv)])
    return build.function("jacobian_rows")


def inverse_dynamics(robot: Robot, checked: bool = False) -> Function:
    """Return forces and multipliers of a motion (q, v, a), and if the equation of motion holds."""
    build = Builder()
    tree = robot.tree
    q, v, a = (build.take(name, size) for name, size in (("q", tree.nq), ("v", tree.nv), ("a", tree.nv)))
    robot, load = build.loaded(robot)
    at = At(robot, build.tape, q)
    moving = Moving(at, v, load)
    bodies = moving.motion(a)
    needed = moving.needed(a, bodies)
    borne = solutions.actuator_forces(at, needed)
    multipliers = borne.multipliers(at)
    build.give("tau", borne.tau)
    if checked:
        solutions.give_residuals(build, at, needed, borne)
    else:
        build.give("lambda_", multipliers)
    speeds = [applied(row, v) for row in at.rows]
    limits = [
        stays_closed(build.tape, speeds, CONSISTENT * robot.length, v),
        stays_closed(build.tape, moving.opening(a, bodies), CONSISTENT * robot.length, v, a),
        nothing_missing(build.tape, borne.missing, (*borne.tau, *multipliers)),
    ]
    build.evidence(at, CLOSED, [*limits, *build.size_limits(checked)])
    return build.function("checked_inverse_dynamics" if checked else "inverse_dynamics")


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
    moving, all_v, all_a = solutions.completed_motion(at, v, a, load)
    borne = solutions.actuator_forces(at, moving.needed(all_a))
    multipliers = borne.multipliers(at)
    build.give("v", all_v)
    build.give("a", all_a)
    build.give("tau", borne.tau)
    build.give("lambda_", multipliers)
    missing = nothing_missing(tape, borne.missing, (*borne.tau, *multipliers))
    build.evidence(at, CLOSED * FOLLOWED, [missing])
    return build.function("motion")


def completion(robot: Robot) -> Function:
    """Return velocity and acceleration of the tree from those of the independent speeds, and what moves it.

    The influence is by how much every speed grows with each independent one. The orientation is the product
    of the pivots: it keeps its sign as long as the partition does not fail.
    """
    build = Builder()
    tree, free = robot.tree, robot.independent
    q, v, a = (
        build.take(name, size)
        for name, size in (("q", tree.nq), ("v_independent", len(free)), ("a_independent", len(free)))
    )
    at = At(replace(robot, loads=(), joint_forces=False), build.tape, q)
    _, all_v, all_a = solutions.completed_motion(at, v, a, {})
    build.give("v", all_v)
    build.give("a", all_a)
    by = [{place: 1.0, **at.null_space[place]} for place in free]
    build.give("influence", [column.get(i, 0.0) for i in range(tree.nv) for column in by])
    build.give("orientation", [at.orientation])
    build.give("closure_error", at.loops.multipliers(at.errors))
    build.evidence(at, CLOSED * FOLLOWED)
    return build.function("completion")


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
    moving, _, all_a = solutions.completed_motion(at, v, a, load)
    tau = solutions.actuator_forces(at, moving.needed(all_a)).tau
    seeds = seeds_of(at, dict(zip(free, dq, strict=True)))
    seeds |= {symbol.index: seed for symbol, seed in zip((*v, *a), (*dv, *da), strict=True)}
    build.give("tau", tau)
    build.give("dtau", tangent(tau, seeds))
    build.evidence(at, CLOSED, margin=MARGIN_OF_STATES)
    return build.function("tangent_of_forces")


def momentum(robot: Robot) -> Function:
    """Return the generalised momentum p = Nᵀ M v, its rate without the motors, and their forces.

    External forces that are no input are left: dp/dt = rate + actuation + external.
    """
    build = Builder()
    free = robot.independent
    q, v = build.take("q", robot.tree.nq), build.take("v_independent", len(free))
    tau = build.take("tau", len(robot.motors))
    robot, load = build.loaded(robot)
    at = At(robot, build.tape, q)
    moving, all_v, all_a = solutions.completed_motion(at, v, [0.0] * len(free), load)
    needed, _ = at.projected(moving.needed(all_a))
    projected, _ = at.projected(solutions.momenta(at, all_v))
    found = [projected[i] for i in free]
    turning = tangent(found, seeds_of(at, dict(zip(free, v, strict=True))))
    acting: list[Number] = [0.0] * robot.tree.nv
    for motor, force in zip(robot.motors, tau, strict=True):
        acting[motor] = force
    given, _ = at.projected(acting)
    build.give("momentum", found)
    build.give("rate", [change - needed[i] for change, i in zip(turning, free, strict=True)])
    build.give("actuation", [given[i] for i in free])
    build.evidence(at, CLOSED)
    return build.function("momentum")


def body_regressor(robot: Robot) -> Function:
    """Return what the motors' forces owe to the inertial parameters of one body, and what is left of them.

    Forces are linear in the parameters: tau = regressor @ parameters + rest. The body is the one whose
    parameters are an input of the robot; all that is not its own is in the rest.
    """
    if len(robot.inertias) != 1:
        raise ModelError(
            "body regressor: expected one body whose inertial parameters are an argument, "
            f"got {len(robot.inertias)}"
        )
    (name,) = robot.inertias
    build = Builder()
    tape, free = build.tape, robot.independent
    q, v, a = (
        build.take(key, size)
        for key, size in (("q", robot.tree.nq), ("v_independent", len(free)), ("a_independent", len(free)))
    )
    _, load = build.loaded(replace(robot, inertias={}))
    ten = tape.symbols(f"parameter[{i}]" for i in range(10))  # no input: nothing that is left has them
    needed = []
    for values in (ten, [0.0] * 10):
        at = At(robot.with_inputs({f"inertia_{name}": values}), tape, q)
        moving, _, all_a = solutions.completed_motion(at, v, a, load)
        needed.append(moving.needed(all_a))
    columns = [solutions.actuator_forces(at, tangent(needed[0], {one.index: 1.0})).tau for one in ten]
    build.give("regressor", [column[i] for i in range(len(robot.motors)) for column in columns])
    build.give("rest", solutions.actuator_forces(at, needed[1]).tau)
    build.evidence(at, CLOSED)
    return build.function("body_regressor")


def forward_dynamics(robot: Robot, stabilised: bool = False, checked: bool = False) -> Function:
    """Return the acceleration of the tree from its state and the motors' forces."""
    build = Builder()
    tree, free = robot.tree, robot.independent
    q, v = build.take("q", tree.nq), build.take("v", tree.nv)
    tau = build.take("tau", len(robot.motors))
    robot, load = build.loaded(robot)
    beta = build.take("stabilisation", 1)[0] if stabilised else None
    at = At(robot, build.tape, q)
    moving = Moving(at, v, load)
    drift = solutions.drift_of(at, moving, beta)
    mass = solutions.projected_mass(at, free, free)
    found = solutions.independent_accelerations(at, moving, tau, mass, drift)
    a = at.completed(found, drift)
    build.give("a", a)
    if checked:
        needed = moving.needed(a)
        for motor, value in zip(robot.motors, tau, strict=True):
            needed[motor] = needed[motor] - value
        rest, rows = at.projected(needed)
        solutions.give_residuals(build, at, needed, solutions.Borne([0.0] * len(tau), rows, [*rest.values()]))
        opening = [applied(row, a) + bias for row, bias in zip(at.rows, drift, strict=True)]
        build.give("closure_residual", [solutions.largest_of(at, opening)])
    solutions.evidence_of_state(build, at, v, [*solutions.heavy(at, free, mass), *build.size_limits(checked)])
    return build.function(_named("forward_dynamics", stabilised, checked))


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
    mass = solutions.projected_mass(at, free, free)
    drift = solutions.drift_of(at, moving)
    found = solutions.independent_accelerations(at, moving, tau, mass, drift)
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
    build.evidence(at, CLOSED, solutions.heavy(at, free, mass), MARGIN_OF_STATES)
    return build.function("tangent_of_accelerations")


def hybrid_dynamics(robot: Robot, stabilised: bool = False, checked: bool = False) -> Function:
    """Return forces and the acceleration of the tree from the accelerations of the motors."""
    build = Builder()
    tape, tree, free = build.tape, robot.tree, robot.independent
    if not set(robot.motors) <= set(free):
        raise ModelError("hybrid dynamics: more actuators than freedoms; their accelerations are not free")
    q, v = build.take("q", tree.nq), build.take("v", tree.nv)
    given = dict(zip(robot.motors, build.take("a_actuated", len(robot.motors)), strict=True))
    robot, load = build.loaded(robot)
    beta = build.take("stabilisation", 1)[0] if stabilised else None
    at = At(robot, tape, q)
    moving = Moving(at, v, load)
    a, limits = solutions.accelerated(at, moving, given, beta)
    needed = moving.needed(a)
    borne = solutions.actuator_forces(at, needed)
    build.give("tau", borne.tau)
    build.give("a", a)
    if checked:
        solutions.give_residuals(build, at, needed, borne)
    else:
        build.give("lambda_", borne.multipliers(at))
    solutions.evidence_of_state(build, at, v, [*limits, *build.size_limits(checked)])
    return build.function(_named("hybrid_dynamics", stabilised, checked))


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


class Unplanned(NamedTuple):
    """The parts of the dynamics whose linear algebra somebody else does, as a page.

    closure
        Errors of closures and couplings at q, and the entries of their Jacobian.
    terms
        Generalised forces of the tree at q, v and a, with what acts in joints by themselves, and the
        acceleration at the closures where a is zero. Gravity (3,), the dynamic parameters of each joint's
        body (10,) and a wrench at each joint's origin in world axes (6,) are inputs.
    mass
        The entries of the mass matrix.
    rate
        How q changes with v.
    wrenches
        Force and moment of each closure on body 2 at the origin of frame 2, in the axes of body 1.
    """

    functions: dict[str, Function]  # by name
    entries: list[tuple[int, int]]  # which entries of the Jacobian there can be: row and column
    mass: list[tuple[int, int]]  # the same of the mass matrix, of its lower half with the diagonal


def unplanned_functions(robot: Robot) -> Unplanned:
    """Return the functions of a robot whose bodies all have their parameters and loads as inputs."""
    nq, nv = robot.tree.nq, robot.tree.nv
    build = Builder()
    at = At(robot, build.tape, build.take("q", nq))
    rows = [*at.loops.general_rows(), *at.robot.coupled.rows(at.tape, at.q)]
    build.give("errors", at.loops.multipliers(at.errors))
    build.give("J", [x for row in rows for x in row.values()])
    found = {"closure": build.traced("closure"), "terms": _terms(robot)}

    build = Builder()
    q = build.take("q", nq)
    heavy = _with_bodies(build, robot)
    mass = mass_matrix(heavy.tree, placements(heavy.tree, build.tape, q))
    lower = [{j: x for j, x in row.items() if j <= i} for i, row in enumerate(mass)]
    build.give("M", [x for row in lower for x in row.values()])
    found["mass"] = build.traced("mass")

    build = Builder()
    q, v = build.take("q", nq), build.take("v", nv)
    build.give("rate", rates_of(At(robot, build.tape, q), v))
    found["rate"] = build.traced("rate")

    build = Builder()
    at = At(robot, build.tape, build.take("q", nq))
    build.give("wrenches", at.loops.wrenches(build.take("lambda_", len(rows))))
    found["wrenches"] = build.traced("wrenches")
    entries = [(i, place) for i, row in enumerate(rows) for place in row]
    return Unplanned(found, entries, [(i, j) for i, row in enumerate(lower) for j in row])


def _terms(robot: Robot) -> Function:
    build = Builder()
    nq, nv = robot.tree.nq, robot.tree.nv
    q, v, a = build.take("q", nq), build.take("v", nv), build.take("a", nv)
    x, y, z = build.take("gravity", 3)
    robot = _with_bodies(build, replace(robot, tree=replace(robot.tree, gravity=(x, y, z))))
    acting = build.take("wrenches", 6 * len(robot.loads))
    load = {f"wrench_{one.name}": acting[6 * i : 6 * i + 6] for i, one in enumerate(robot.loads)}
    at = At(robot, build.tape, q)
    moving = Moving(at, v, load)
    build.give("forces", moving.needed(a))
    build.give("drift", at.loops.multipliers(moving.opening([0.0] * nv)))
    return build.traced("terms")


def _with_bodies(build: Builder, robot: Robot) -> Robot:
    """Take the dynamic parameters of all bodies."""
    values = build.take("inertias", 10 * len(robot.inertias))
    each = {f"inertia_{name}": values[10 * i : 10 * i + 10] for i, name in enumerate(robot.inertias)}
    return robot.with_inputs(each)


FUNCTIONS: Mapping[str, Callable[[Robot], Function]] = {
    "inverse_dynamics": inverse_dynamics,
    "hybrid_dynamics": hybrid_dynamics,
    "forward_dynamics": forward_dynamics,
    "stabilised_hybrid_dynamics": partial(hybrid_dynamics, stabilised=True),
    "stabilised_forward_dynamics": partial(forward_dynamics, stabilised=True),
    "checked_inverse_dynamics": partial(inverse_dynamics, checked=True),
    "checked_hybrid_dynamics": partial(hybrid_dynamics, checked=True),
    "checked_forward_dynamics": partial(forward_dynamics, checked=True),
    "motion": motion,
    "completion": completion,
    "momentum": momentum,
    "body_regressor": body_regressor,
    "flow": flow,
    "stabilised_flow": stabilised_flow,
    "model_forces": model_forces,
    "step": step,
    "integrate": integrate,
    "tangent_of_forces": tangent_of_forces,
    "tangent_of_accelerations": tangent_of_accelerations,
}
"""What can be compiled, by name."""


def _named(name: str, stabilised: bool, checked: bool) -> str:
    return f"{'stabilised_' if stabilised else ''}{'checked_' if checked else ''}{name}"
