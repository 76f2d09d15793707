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

from p3dof._base.tracing import Number, Tape
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.compiled.couplings import CoupledJoints
from p3dof.loops.compiled.dynamics import Motion, forces, motion, velocities
from p3dof.loops.compiled.loops import Loops
from p3dof.loops.compiled.passive import PassiveJoints
from p3dof.loops.compiled.pivots import Factors, Plan
from p3dof.loops.compiled.tree import Placements, Tree, placements, with_parameters
from p3dof.loops.compiled.vectors import ZERO, Vector, back, cross, plus, product


@dataclass(frozen=True)
class Load:
    """A frame on which an external wrench can act.

    Parameters
    ----------
    name : str
        Of the frame.
    part : int
        The part on whose body it is.
    place : Vector
        Its origin in the axes of the body.
    """

    name: str
    part: int
    place: Vector


@dataclass(frozen=True, eq=False)
class Robot:
    """All that formulas need of a robot.

    Parameters
    ----------
    tree : Tree
        The parts.
    kinematics : LoopKinematics
        Closures.
    coupled : CoupledJoints
        Couplings.
    passive : PassiveJoints
        Springs, damping, friction.
    motors : tuple of int
        Places in v of the actuated joints.
    plan : Plan, optional
        Not there while it is being made.
    loads : tuple of Load
        Frames of external wrenches.
    joint_forces : bool
        Whether forces in all joints are an input.
    inertias : mapping of str to int
        Joints whose bodies have their inertial parameters as an input, and their parts.
    length : float
        The model's own unit of length where it is smaller than a metre, else one: what counts as closed.
    """

    tree: Tree
    kinematics: LoopKinematics
    coupled: CoupledJoints
    passive: PassiveJoints
    motors: tuple[int, ...]
    plan: Plan
    loads: tuple[Load, ...] = ()
    joint_forces: bool = False
    inertias: Mapping[str, int] = field(default_factory=dict)
    length: float = 1.0

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
        self.loops = Loops(robot.tree, robot.kinematics, self.where)

    @cached_property
    def rows(self) -> list[dict[int, Number]]:
        """The Jacobian of closures and couplings."""
        return [*self.loops.rows(), *self.robot.coupled.rows(self.tape, self.q)]

    @cached_property
    def errors(self) -> list[Number]:
        """How far closures and couplings are off."""
        return [*self.loops.errors(), *self.robot.coupled.errors(self.tape, self.q)]

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

    def motion(self, a: Sequence[Number]) -> Motion:
        """Return accelerations of bodies with gravity."""
        tree = self.at.robot.tree
        return motion(tree, self.at.where, self.v, a, self.omega, tree.gravity)

    def needed(self, a: Sequence[Number], moving: Motion | None = None) -> list[Number]:
        """Return the generalised forces that motors and closures have to give."""
        tree = self.at.robot.tree
        found = forces(tree, self.at.where, moving or self.motion(a), self._wrenches)
        found = [f + arm * x for f, arm, x in zip(found, tree.armature, a, strict=True)]
        found = [f - p for f, p in zip(found, self._passive, strict=True)]
        if self._joint_forces:
            found = [f - p for f, p in zip(found, self._joint_forces, strict=True)]
        return found

    def opening(self, a: Sequence[Number], moving: Motion | None = None, moved: bool = False) -> list[Number]:
        """Return the accelerations at closures and couplings, if asked for of those that open slowly."""
        at, tree = self.at, self.at.robot.tree
        if moving is None:
            moving = motion(tree, at.where, self.v, a, self.omega, ZERO, at.loops.parts)
        coupled = at.robot.coupled.accelerations(at.tape, at.q, self.v, a)
        return [*at.loops.accelerations(self.v, moving, moved), *coupled]


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
