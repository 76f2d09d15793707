"""The functions that are compiled, as formulas on a tape: forces, completion, accelerations, derivatives.

With the dependent speeds v_d of a plan and the others v_i, J_d v_d + J_i v_i = 0; the equation of motion
gives the multipliers from the rows of v_d, J_dᵀ λ = f_d, and the forces from the others, τ = f_i - J_iᵀ λ.

References
----------
A. Müller, Dynamics of parallel manipulators with hybrid complex limbs, Mechanism and Machine Theory 167
(2022).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from p3dof._base.tracing import Number, Symbol, Tape
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.compiled.dynamics import BodyRates, forces, motion, velocities
from p3dof.loops.compiled.loops import CoupledJoints, Loops, PassiveJoints
from p3dof.loops.compiled.pivots import Factors, Plan
from p3dof.loops.coordinates import NORMALISED, SURELY
from p3dof.loops.tree_formulas import (
    RATES,
    ZERO,
    Placements,
    Tree,
    Vector,
    back,
    cross,
    dot,
    placements,
    plus,
    product,
    with_parameters,
)


@dataclass(frozen=True)
class Load:
    """A frame on which an external wrench can act."""

    name: str  # of the frame
    part: int  # the part on whose body it is
    place: Vector  # its origin in the axes of the body


@dataclass(frozen=True, eq=False)
class Robot:
    """All that formulas need of a robot."""

    tree: Tree  # the parts
    kinematics: LoopKinematics  # closures
    coupled: CoupledJoints  # couplings
    passive: PassiveJoints  # springs, damping, friction
    motors: tuple[int, ...]  # places in v of the actuated joints
    plan: Plan  # not there while it is being made
    loads: tuple[Load, ...] = ()  # frames of external wrenches
    joint_forces: bool = False  # whether forces in all joints are an input
    inertias: Mapping[str, int] = field(default_factory=dict)
    """Joints whose bodies have their inertial parameters as an input, and their parts."""
    idle: tuple[Mapping[int, float], ...] = ()
    """Rows that hold freedoms still which move nothing else, such as a rod that spins between balls."""
    length: float = 1.0
    """The model's own unit of length where it is smaller than a metre, else one: what counts as closed."""

    @property
    def inputs(self) -> dict[str, int]:
        """What acts, and what is known only when it runs, by name and size."""
        found = {f"wrench_{frame.name}": 6 for frame in self.loads}
        if self.joint_forces:
            found["joint_forces"] = self.tree.nv
        return found | {f"inertia_{name}": 10 for name in self.inertias}

    def with_inputs(self, values: Mapping[str, Sequence[Number]]) -> Robot:
        """Return the robot with bodies whose inertial parameters are inputs."""
        parts = list(self.tree.parts)
        for name, place in self.inertias.items():
            parts[place] = with_parameters(parts[place], values[f"inertia_{name}"])
        return replace(self, tree=replace(self.tree, parts=tuple(parts)))

    @property
    def independent(self) -> tuple[int, ...]:
        """Places in v of the speeds that do not depend on others."""
        dependent = set(self.plan.columns)
        return tuple(i for i in range(self.tree.nv) if i not in dependent)


class At:
    """A robot at a symbolic configuration."""

    def __init__(self, robot: Robot, tape: Tape, q: Sequence[Number]) -> None:
        self.robot, self.tape, self.q = robot, tape, q
        self.where: Placements = placements(robot.tree, tape, q)

    @cached_property
    def loops(self) -> Loops:
        """The closures."""
        return Loops(self.robot.tree, self.robot.kinematics, self.where)

    @cached_property
    def rows(self) -> list[dict[int, Number]]:
        """The Jacobian of closures and couplings, with rows that hold idle freedoms still."""
        idle: list[dict[int, Number]] = [dict(row) for row in self.robot.idle]
        return [*self.loops.rows(), *self.robot.coupled.rows(self.tape, self.q), *idle]

    @cached_property
    def errors(self) -> list[Number]:
        """How far closures and couplings are off."""
        still = [0.0] * len(self.robot.idle)
        return [*self.loops.errors(), *self.robot.coupled.errors(self.tape, self.q), *still]

    @cached_property
    def factors(self) -> Factors:
        """The columns of the dependent speeds, factored."""
        return Factors(self.tape, self.rows, self.robot.plan)

    @cached_property
    def margin(self) -> Number:
        """The square of the smallest pivot over what it is on the samples; one without loops."""
        least: Number = 1.0
        for pivot, size in zip(self.factors.pivots, self.robot.plan.sizes, strict=True):
            part = pivot * (1.0 / size)
            least = self.tape.minimum(part * part, least)
        return least

    @cached_property
    def orientation(self) -> Number:
        """The product of the pivots over what they are on the samples: its sign tells assemblies apart."""
        product: Number = 1.0
        for pivot, size in zip(self.factors.pivots, self.robot.plan.sizes, strict=True):
            product = product * (pivot * (1.0 / size))
        return product

    @cached_property
    def null_space(self) -> dict[int, dict[int, Number]]:
        """N by independent place: what a unit of it makes of the dependent speeds."""
        found = {}
        for place in self.robot.independent:
            right = {row: -self.rows[row][place] for row in self.robot.plan.rows if place in self.rows[row]}
            found[place] = self.factors.solve(right) if right else {}
        return found

    def completed(self, independent: Mapping[int, Number], offset: Sequence[Number]) -> list[Number]:
        """Return all rates from the independent ones, with J x = -offset by row."""
        right = {}
        for row in self.robot.plan.rows:
            value = -offset[row]
            for place, factor in self.rows[row].items():
                if place in independent:
                    value = value - factor * independent[place]
            right[row] = value
        dependent = self.factors.solve(right)
        return [independent[i] if i in independent else dependent[i] for i in range(self.robot.tree.nv)]

    def projected(self, force: Sequence[Number]) -> tuple[dict[int, Number], dict[int, Number]]:
        """Return Nᵀ f by independent place, and the multipliers by row that take the rest."""
        plan = self.robot.plan
        multipliers = self.factors.solve_transposed({c: force[c] for c in plan.columns})
        found = {}
        for place in self.robot.independent:
            value = force[place]
            for row, multiplier in multipliers.items():
                if place in self.rows[row]:
                    value = value - self.rows[row][place] * multiplier
            found[place] = value
        return found, multipliers


class Moving:
    """A robot in motion: its velocities, and the forces that accelerations need."""

    def __init__(self, at: At, v: Sequence[Number], load: Mapping[str, Sequence[Number]]) -> None:
        self.at, self.v = at, v
        robot, tape = at.robot, at.tape
        self.omega = velocities(robot.tree, at.where, v)
        self._wrenches = _wrenches(robot, at.where, load)
        self._joint_forces = load.get("joint_forces", ())
        self._passive = robot.passive.forces(tape, at.q, v)

    def motion(self, a: Sequence[Number]) -> BodyRates:
        """Return accelerations of bodies with gravity."""
        tree = self.at.robot.tree
        return motion(tree, self.at.where, self.v, a, self.omega, tree.gravity)

    def needed(self, a: Sequence[Number], moving: BodyRates | None = None) -> list[Number]:
        """Return the generalised forces that motors and closures have to give."""
        tree = self.at.robot.tree
        found = forces(tree, self.at.where, moving or self.motion(a), self._wrenches)
        found = [f + arm * x for f, arm, x in zip(found, tree.armature, a, strict=True)]
        found = [f - p for f, p in zip(found, self._passive, strict=True)]
        if self._joint_forces:
            found = [f - p for f, p in zip(found, self._joint_forces, strict=True)]
        return found

    def opening(
        self, a: Sequence[Number], moving: BodyRates | None = None, moved: bool = False
    ) -> list[Number]:
        """Return the accelerations at closures and couplings, if asked for of those that open slowly."""
        at, tree = self.at, self.at.robot.tree
        if moving is None:
            moving = motion(tree, at.where, self.v, a, self.omega, ZERO, at.loops.parts)
        coupled = at.robot.coupled.accelerations(at.tape, at.q, self.v, a)
        still = [0.0] * len(at.robot.idle)
        return [*at.loops.accelerations(self.v, moving, moved), *coupled, *still]


def _wrenches(
    robot: Robot, where: Placements, load: Mapping[str, Sequence[Number]]
) -> dict[int, tuple[Vector, Vector]]:
    """Return forces and moments about the origins of bodies in their axes, from wrenches in world axes."""
    found: dict[int, tuple[Vector, Vector]] = {}
    for frame in robot.loads:
        x = load[f"wrench_{frame.name}"]
        R = where.R[frame.part]
        for part in robot.tree.path(robot.tree.parts[frame.part].parent):
            R = product(where.R[part], R)
        force, moment = back(R, (x[0], x[1], x[2])), back(R, (x[3], x[4], x[5]))
        moment = plus(moment, cross(frame.place, force))
        if frame.part in found:
            other = found[frame.part]
            force, moment = plus(force, other[0]), plus(moment, other[1])
        found[frame.part] = force, moment
    return found


_UNITS = {"unbounded": 2, "planar": 2, "ball": 4, "free": 4}
"""How many numbers at the end of a joint's q have length one."""


def seeds_of(at: At, free: Mapping[int, Number]) -> dict[int, Number]:
    """Return how q changes along a direction of the independent coordinates, by place on the tape."""
    rates = at.completed(free, [0.0] * len(at.rows))
    found: dict[int, Number] = {}
    for part in at.robot.tree.parts[1:]:
        q, x = [at.q[i] for i in part.q], [rates[i] for i in part.v]
        for symbol, rate in zip(q, RATES[part.kind](q, x), strict=True):
            assert isinstance(symbol, Symbol)  # noqa: S101 - q are inputs
            found[symbol.index] = rate
    return found


def moved(at: At, shift: Mapping[int, Number]) -> list[Number]:
    """Return q moved along the tangent space, to second order, with unit circles and quaternions."""
    found = list(at.q)
    for part in at.robot.tree.parts[1:]:
        if not any(place in shift for place in part.v):
            continue
        q, x = [at.q[i] for i in part.q], [shift.get(i, 0.0) for i in part.v]
        new = [value + rate for value, rate in zip(q, RATES[part.kind](q, x), strict=True)]
        for place, value in zip(part.q, _normalised(at.tape, part.kind, new), strict=True):
            found[place] = value
    return found


def rates_of(at: At, v: Sequence[Number]) -> list[Number]:
    """Return how q changes with a velocity."""
    found: list[Number] = [0.0] * len(at.q)
    for part in at.robot.tree.parts[1:]:
        rates = RATES[part.kind]([at.q[i] for i in part.q], [v[i] for i in part.v])
        for place, rate in zip(part.q, rates, strict=True):
            found[place] = rate
    return found


def with_units(tree: Tree, tape: Tape, q: Sequence[Number]) -> list[Number]:
    """Return q with circles and quaternions of length one."""
    found = list(q)
    for part in tree.parts[1:]:
        values = _normalised(tape, part.kind, [q[i] for i in part.q])
        for place, value in zip(part.q, values, strict=True):
            found[place] = value
    return found


def units(at: At) -> list[list[Number]]:
    """Return the circles and quaternions in q."""
    parts = at.robot.tree.parts[1:]
    return [[at.q[i] for i in part.q[-_UNITS[part.kind] :]] for part in parts if part.kind in _UNITS]


def _normalised(tape: Tape, kind: str, q: list[Number]) -> list[Number]:
    size = _UNITS.get(kind, 0)
    if not size:
        return q
    kept, unit = q[:-size], q[-size:]
    inverse = tape.divide(1.0, tape.sqrt(dot(unit, unit)))
    return [*kept, *(x * inverse for x in unit)]


EVIDENCE = ("margin", "gap", "trusted")  # outputs that say how good a result is, the last ones of a function
MARGIN = 1e-3  # smallest pivot, compared with those that the partition was made on, that is trusted
MARGIN_OF_STATES = 2e-2
"""The same where accelerations are found: NᵀM N squares what is large near a singular partition."""
LIGHTEST = 1e-10  # smallest inertia of a free motion, of what moves in it, that is more than rounding


def stays_closed(
    tape: Tape, opening: Sequence[Number], relative: float, v: Sequence[Number], a: Sequence[Number] = ()
) -> Number:
    """Return what is positive where closures open by less than a part of the motion, in the mean square."""
    if not opening:
        return 1.0
    speed = dot(v, v) * (1.0 / len(v))
    size = larger(tape, dot(a, a) * (1.0 / len(a)), speed * speed) if a else speed
    return tape.subtract(relative * relative * larger(tape, size, 1.0), dot(opening, opening))


def nothing_missing(tape: Tape, missing: Sequence[Number], forces: Sequence[Number]) -> Number:
    """Return what is positive where no force is missing that no actuator gives."""
    if not missing:
        return 1.0
    allowed = dot(forces, forces) * (SURELY * SURELY)
    return tape.add(tape.subtract(allowed, dot(missing, missing)), 1e-300)


def normalised(at: At) -> list[Number]:
    """Return what is positive where circles and quaternions in q are normalised: no doubt is left."""
    squares = [dot(unit, unit) - 1.0 for unit in units(at)]
    return [at.tape.subtract((2.0 * NORMALISED * (1.0 - NORMALISED)) ** 2, off * off) for off in squares]


def larger(tape: Tape, a: Number, b: Number) -> Number:
    """Return the larger one of two numbers."""
    return -tape.minimum(-a, -b)


def applied(row: Mapping[int, Number], v: Sequence[Number]) -> Number:
    """Return a row of the Jacobian times a velocity."""
    total: Number = 0.0
    for place, factor in row.items():
        total = total + factor * v[place]
    return total
