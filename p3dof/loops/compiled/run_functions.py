"""The functions that runs in time are made of: rates of independent speeds, forces of a controller."""

from __future__ import annotations

from collections.abc import Sequence

from p3dof._base.errors import ModelError
from p3dof._base.tracing import Number
from p3dof.loops.closed_tree import NEARLY_CLOSED
from p3dof.loops.compiled.formulas import At, Moving, Robot
from p3dof.loops.compiled.function import Builder, Function
from p3dof.loops.compiled.limits import MARGIN_OF_STATES
from p3dof.loops.compiled.rates import moved, rates_of, with_units
from p3dof.loops.compiled.solutions import (
    accelerated,
    actuator_forces,
    drift_of,
    evidence_of_state,
    heavy,
    independent_accelerations,
    projected_mass,
)


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
    mass, drift = projected_mass(at, free, free), drift_of(at, moving)
    found = independent_accelerations(at, moving, tau, mass, drift)
    build.give("q", moved(at, shift))
    build.give("rate", rates_of(at, all_v))
    build.give("a_independent", [found[i] for i in free])
    build.give("v", all_v)
    build.give("a", at.completed(found, drift))
    build.evidence(at, NEARLY_CLOSED, heavy(at, free, mass), MARGIN_OF_STATES)
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
    mass, drift = projected_mass(at, free, free), drift_of(at, moving, beta)
    found = independent_accelerations(at, moving, tau, mass, drift)
    build.give("q", at.q)
    build.give("rate", rates_of(at, v))
    build.give("a", at.completed(found, drift))
    evidence_of_state(build, at, v, heavy(at, free, mass))
    return build.function("stabilised_flow")


def model_forces(robot: Robot) -> Function:
    """Return the motors' forces for their accelerations at a state (q, independent v).

    Raises
    ------
    ModelError
        If there are more actuators than freedoms.
    """
    if not set(robot.motors) <= set(robot.independent):
        raise ModelError("model forces: more actuators than freedoms; their accelerations are not free")
    build = Builder()
    q, v = build.take("q", robot.tree.nq), build.take("v_independent", len(robot.independent))
    wanted = dict(zip(robot.motors, build.take("a_actuated", len(robot.motors)), strict=True))
    robot, load = build.loaded(robot)
    at, all_v = _state(build, robot, q, v)
    moving = Moving(at, all_v, load)
    a, limits = accelerated(at, moving, wanted)
    build.give("tau", actuator_forces(at, moving.needed(a)).tau)
    build.evidence(at, NEARLY_CLOSED, limits, MARGIN_OF_STATES)
    return build.function("model_forces")


def _state(build: Builder, robot: Robot, q: Sequence[Number], v: Sequence[Number]) -> tuple[At, list[Number]]:
    """Return a robot at a configuration with units of length one, and all its speeds."""
    at = At(robot, build.tape, with_units(robot.tree, build.tape, q))
    return at, at.completed(dict(zip(robot.independent, v, strict=True)), [0.0] * len(at.rows))
