"""`TaskForces`: what a task asks of the actuators, with what the platform bears along the path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Progress, require, shown
from p3dof._base.errors import InputError, SampleError
from p3dof._base.tables import (
    NONE,
    POSE_COLUMNS,
    ShownInNotebook,
    Table,
    Tabular,
    columns_by,
    formatted,
    html_of,
    notebook_html,
    number,
    table_of,
)
from p3dof.analysis.load_friction import LoadFriction, SlideContact
from p3dof.analysis.reactions import (
    AnyReactions,
    Choice,
    Reactions,
    ReactionsComparison,
    Stiffness,
    Way,
    ways_of,
)
from p3dof.design.bearings import Bearings, Guide
from p3dof.design.bearings.catalogue import ROLLING_FRICTION, SEAL_FRICTION
from p3dof.design.tasks import FastestPlan, Piece, Plan
from p3dof.design.tasks.plan import JUMP
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, SLIDES, Limits
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics, JointStates
from p3dof.methods.registry import Method
from p3dof.methods.solution import CoulombLimits
from p3dof.methods.utilisation import Utilisation, utilisations


@dataclass(frozen=True, eq=False)
class TaskForces(ShownInNotebook, Tabular):
    """Actuator forces over a planned task, piece by piece.

    Parameters
    ----------
    plan : Plan
        The task in time.
    results : tuple of InverseDynamics
        Of every piece of the plan, by the machine with what it carries there. Where two pieces meet, the
        first one's last sample and the second one's first are of the same time: forces may jump.
    """

    plan: Plan
    results: tuple[InverseDynamics, ...]

    def __repr__(self) -> str:
        peaks = ", ".join(f"{peak:.6g}" for peak in self.peak_forces)
        words = f"peak forces {peaks} N" if self.possible else "not possible"
        return f"TaskForces({self.plan.name or 'task'}, {self.plan.duration:g} s, {words})"

    @property
    def possible(self) -> bool:
        """Whether the machine can be at every sample of the task."""
        return all(result.possible for result in self.results)

    @cached_property
    def time(self) -> FloatArray:
        """Times of the samples of all pieces, shape (N,) [s].

        Those of stops and waypoints come twice: at the end of a piece, and a rounding later, so that
        `piece_at` tells a load that jumps there from the one before, at the beginning of the next.
        """
        times = [result.time.copy() for result in self.results]
        for own in times[1:]:
            own[0] = np.nextafter(own[0], np.inf)
        return np.concatenate(times)

    @cached_property
    def forces(self) -> FloatArray:
        """Forces of A, B, C, shape (N, 3) [N]."""
        return np.concatenate([result.forces for result in self.results])

    @cached_property
    def nut_forces(self) -> FloatArray:
        """Forces that screws pass on to the sliders, shape (N, 3) [N]: without what armatures take."""
        return np.concatenate([result.nut_forces for result in self.results])

    @cached_property
    def power(self) -> FloatArray:
        """Power of the actuators together, shape (N,) [W]."""
        return np.concatenate([result.power for result in self.results])

    @cached_property
    def slider_velocities(self) -> FloatArray:
        """Of A, B, C, shape (N, 3) [m/s]."""
        return np.concatenate([result.slider_velocities for result in self.results])

    @cached_property
    def slider_accelerations(self) -> FloatArray:
        """Of A, B, C, shape (N, 3) [m/s²]."""
        return np.concatenate([result.slider_accelerations for result in self.results])

    @property
    def peak_forces(self) -> FloatArray:
        """Largest magnitude of the forces, shape (3,) [N]; NaN if the task is not possible."""
        return np.asarray(np.abs(self.forces).max(axis=0)) if self.possible else np.full(3, np.nan)

    @property
    def rms_forces(self) -> FloatArray:
        """Root mean square of the forces over the whole task, dwells included, shape (3,) [N]."""
        squares = sum(np.trapezoid(r.forces**2, r.time, axis=0) for r in self.results)
        mean = np.asarray(squares) / self.plan.duration
        return np.sqrt(mean) if self.possible else np.full(3, np.nan)

    def piece_at(self, time: float) -> Piece:
        """Return the piece of the plan that a time belongs to; the former where two meet."""
        return self.plan.piece_at(time)

    def utilisations(self, limits: Limits) -> tuple[Utilisation, ...]:
        """Return how much of the limits of forces, speeds, travel and tilt the task uses, and when the most.

        Parameters
        ----------
        limits : Limits
            What the actuators can do.

        Raises
        ------
        InputError
            If `limits` is not a `Limits`.
        """
        columns = {
            "force": self.forces,
            "speed": self.slider_velocities,
            "travel": np.concatenate([result.sliders for result in self.results]),
            "tilt": np.concatenate([result.motion.pose[:, 2:] for result in self.results]),
        }
        if not self.possible:
            columns["force"] = columns["speed"] = np.full_like(self.forces, np.nan)
        return utilisations(self.time, columns, limits)

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, forces, power, pose and payload of all samples, (N,) each, by name and unit.

        With armatures, forces at the nuts follow those of the actuators.
        """
        pose = np.concatenate([result.motion.pose for result in self.results])
        carried = [0.0 if piece.payload is None else piece.payload.mass for piece in self.plan.pieces]
        mass = np.concatenate([np.full(len(r.time), m) for r, m in zip(self.results, carried, strict=True)])
        found = {"t [s]": self.time, **columns_by("f{} [N]", LEGS, self.forces)}
        if any(result.armature.any() for result in self.results):
            found |= columns_by("nut {} [N]", LEGS, self.nut_forces)
        found |= {"power [W]": self.power}
        found |= columns_by("{}", POSE_COLUMNS, pose)
        return found | {"carried [kg]": mass}


def forces_of_task(
    robot: Manipulator,
    plan: Plan,
    method: Method = "compiled",
    progress: Progress | None = None,
    load_friction: LoadFriction | None = None,
    stiffness: Stiffness | None = None,
) -> TaskForces:
    """Return the actuator forces over a planned task.

    Parameters
    ----------
    robot : Manipulator
        The machine; what it carries already stays on it.
    plan : Plan
        Of `Task.plan`.
    method : {"pinocchio", "virtual-power", "compiled"}
        How to compute them.
    progress : callable, optional
        Called with (done, total) pieces.
    load_friction : LoadFriction, optional
        Friction that grows with the loads of the joints; not by ``"compiled"``.
    stiffness : Stiffness, optional
        How joints and rods give way, for these loads; guesses by default.

    Raises
    ------
    InputError
        If an argument is something else.
    ReachError
        If the task leaves the reach of the machine.
    SingularityError
        If the actuators cannot hold the machine somewhere on the way.
    """
    results = []
    for done, (machine, piece) in enumerate(zip(machines_of(robot, plan), plan.pieces, strict=True), 1):
        try:
            results.append(
                machine.inverse_dynamics(
                    piece.motion,
                    method=method,
                    wrench=piece.wrench,
                    load_friction=load_friction,
                    stiffness=stiffness,
                )
            )
        except SampleError as error:
            error.args = (f"{piece.name}: {error}", *error.args[1:])
            raise
        if progress is not None:
            progress(done, len(plan.pieces))
    return TaskForces(plan, tuple(results))


def machines_of(robot: Manipulator, plan: Plan) -> tuple[Manipulator, ...]:
    """Return the machine with what it carries, for each piece; one object where the payload is the same."""
    require("robot", robot, Manipulator)
    if not isinstance(plan, Plan):
        raise InputError(f"plan: expected what Task.plan returns, got {shown(plan)}")
    laden: dict[int, Manipulator] = {id(None): robot}
    for piece in plan.pieces:
        if piece.payload is not None and id(piece.payload) not in laden:
            laden[id(piece.payload)] = Manipulator(robot.parameters.carrying(piece.payload))
    return tuple(laden[id(piece.payload)] for piece in plan.pieces)


def pieces_table(found: TaskForces) -> Table:
    """Return what every piece of a task takes."""
    loads = (f"peak {leg} [N]" for leg in LEGS)
    header = ("segment", "start [s]", "duration [s]", "payload [kg]", "peak speed [m/s]", *loads)
    rows: list[tuple[str, ...]] = []
    for piece, result in zip(found.plan.pieces, found.results, strict=True):
        forces = [number(peak) for peak in np.abs(result.forces).max(axis=0)]
        rows.append(
            (
                piece.name,
                number(piece.motion.time[0]),
                number(piece.motion.duration),
                NONE if piece.payload is None else number(piece.payload.mass),
                number(np.abs(result.slider_velocities).max()),
                *forces,
            )
        )
    note = f"{number(found.plan.duration)} s in total."
    return Table(f"Task {found.plan.name}".strip(), header, tuple(rows), note)


def limits_table(plan: FastestPlan) -> Table:
    """Return how much of each of its limits the fastest plan uses, also between samples, when and where."""
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            one.holds_at,
            number(one.value),
            number(one.limit),
            formatted(one.share, ".2%"),
            number(one.time),
            one.way,
        )
        for one in plan.uses
    }
    header = ("limit of", "acts at", "peak", "limit", "utilisation", "at t [s]", "segment")
    return table_of("Limits of the time-optimal motion", header, rows)


@html_of.register(TaskForces)
def task_forces_html(found: TaskForces) -> str:
    """Return how a notebook shows the forces of a task, as HTML."""
    facts = f"{len(found.plan.pieces)} segments over {number(found.plan.duration)} s"
    return notebook_html("Forces of a task", facts, [pieces_table(found)])


GUIDES = SlideContact(drag=SEAL_FRICTION, mu=ROLLING_FRICTION, arm=0.01)
"""Friction of guides of which nothing is known: one carriage each, of a size for this machine."""
USUAL_FRICTION = (
    f"friction of guides: {SEAL_FRICTION:g} N of its seals and {ROLLING_FRICTION:g} of its load for each "
    "carriage, as none was given"
)
"""What `with_guide_friction` adds by default, in words."""
_LOOKS = 60  # instants of each piece at which loads of guides are found: they change slowly


@overload
def with_guide_friction(
    robot: Manipulator, found: TaskForces, bearings: Bearings | None = ..., stiffness: Stiffness | None = ...
) -> TaskForces: ...
@overload
def with_guide_friction(
    robot: Manipulator,
    found: InverseDynamics | TaskForces,
    bearings: Bearings | None = ...,
    stiffness: Stiffness | None = ...,
) -> InverseDynamics | TaskForces: ...
def with_guide_friction(
    robot: Manipulator,
    found: InverseDynamics | TaskForces,
    bearings: Bearings | None = None,
    stiffness: Stiffness | None = None,
) -> InverseDynamics | TaskForces:
    """Return forces with the usual friction of guides: of seals, and of what the carriages bear.

    Of a guide whose ratings are known, `p3dof.design.bearings.Guide.resistance`; of others, that of `GUIDES`.
    Friction along a guide changes the force of its own actuator and no load of a joint, so that loads are
    those without it. Where machine or forces have friction already, and of a fastest motion, which was
    planned without it up to the limits, `found` itself.
    """
    results = (found,) if isinstance(found, InverseDynamics) else found.results
    if robot.parameters.friction or any(result.coulomb is not None for result in results):
        return found
    if isinstance(found, InverseDynamics):
        return _rubbed(robot, found, bearings, stiffness)
    if isinstance(found.plan, FastestPlan):
        return found
    pairs = zip(machines_of(robot, found.plan), found.results, strict=True)
    return replace(found, results=tuple(_rubbed(machine, one, bearings, stiffness) for machine, one in pairs))


def with_rotors(found: TaskForces, masses: Sequence[float]) -> TaskForces:
    """Return forces with these inertias of motors and screws (3,), reflected [kg], in place of armatures."""
    own = np.array(masses)
    turned = [
        replace(one, forces=one.nut_forces + own * one.slider_accelerations, armature=own)
        for one in found.results
    ]
    return replace(found, results=tuple(turned))


def _rubbed(
    robot: Manipulator, result: InverseDynamics, bearings: Bearings | None, stiffness: Stiffness | None
) -> InverseDynamics:
    from p3dof.analysis.reactions.evaluation import of_result

    rows = np.unique(np.linspace(0, len(result.time) - 1, _LOOKS).round().astype(int))
    kept = np.zeros(len(result.time), dtype=bool)
    kept[rows] = True
    motion = result.motion
    time, pose, velocity, acceleration = (
        values[rows] for values in (motion.time, motion.pose, motion.velocity, motion.acceleration)
    )
    few = _stacked([result], Motion(time, pose, velocity, acceleration, check=False, start=0.0), kept)
    loads = of_result(robot.bare_loop, robot.parameters, few, "elastic", "raise", stiffness).each[0]
    limits = {}
    for joint in SLIDES:
        guide = None if bearings is None else bearings.of(joint)
        forces, moments = loads[joint].forces, loads[joint].moments
        if isinstance(guide, Guide):
            largest = guide.resistance(forces, moments)
        else:
            across = np.abs(forces[:, :2]).sum(axis=1) + np.abs(moments).sum(axis=1) / GUIDES.arm
            largest = GUIDES.drag + GUIDES.mu * across
        limits[joint] = np.interp(result.time, few.time, largest)[:, None]
    coulomb = CoulombLimits(limits, LoadFriction(slides=GUIDES).smoothing)
    speeds = result.slider_velocities
    friction = np.hstack(list(limits.values())) * np.tanh(speeds / coulomb.smoothing)
    lost = (friction * speeds).sum(axis=1)
    return replace(
        result,
        forces=result.forces + friction,
        power=result.power + lost,
        dissipation=result.dissipation + lost,
        coulomb=coulomb,
    )


_WHOLE = ("crossings", "armature")  # arrays that do not go by sample
_Result = TypeVar("_Result", InverseDynamics, Reactions)


def joined(found: TaskForces) -> InverseDynamics:
    """Return the forces over a task as one result over the motion of its plan, such as for a page.

    With what the platform carries on each piece. Where two pieces meet, the sample is the latter's: just
    after a payload was picked up or put down.
    """
    if not isinstance(found, TaskForces):
        raise InputError(f"found: expected TaskForces, got {shown(found)}")
    time = np.concatenate([result.time for result in found.results])
    last = np.append(np.diff(time) > 0, True)  # the latter of two samples of one time
    one = _stacked(found.results, found.plan.motion, last)
    crossings = np.concatenate([result.crossings for result in found.results])
    return replace(one, crossings=crossings, examine=None)


@overload
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Way = ...,
    *,
    stiffness: Stiffness | None = ...,
    load_friction: LoadFriction | None = ...,
    progress: Progress | None = ...,
) -> Reactions: ...
@overload
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Literal["all"],
    *,
    stiffness: Stiffness | None = ...,
    load_friction: LoadFriction | None = ...,
    progress: Progress | None = ...,
) -> ReactionsComparison: ...
@overload
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Choice,
    *,
    stiffness: Stiffness | None = ...,
    load_friction: LoadFriction | None = ...,
    progress: Progress | None = ...,
) -> AnyReactions: ...
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Choice = "elastic",
    *,
    stiffness: Stiffness | None = None,
    load_friction: LoadFriction | None = None,
    progress: Progress | None = None,
) -> AnyReactions:
    """Return the reactions of all joints over a planned task.

    Parameters
    ----------
    robot, plan
        As of `forces_of_task`.
    joints : {"elastic", "paper", "points", "all"}
        How loads are found that rigid bodies leave open; see `p3dof.analysis.reactions`.
    stiffness : Stiffness, optional
        How joints and rods give way; guesses without it.
    load_friction : LoadFriction, optional
        Friction that grows with the loads of the joints.
    progress : callable, optional
        Called with (done, total) pieces.

    Returns
    -------
    Reactions or ReactionsComparison
        Over the motion of the plan, each piece with its own payload and wrench. Where these change, there are
        two samples, the latter a billionth of the whole time later: loads may jump.

    Raises
    ------
    InputError, ReachError, SingularityError
        As `forces_of_task`.
    """
    ways_of(joints)
    results: list[AnyReactions] = []
    for done, (machine, piece) in enumerate(zip(machines_of(robot, plan), plan.pieces, strict=True), 1):
        given = {"wrench": piece.wrench, "stiffness": stiffness, "load_friction": load_friction}
        try:
            found = machine.reactions(piece.motion, joints, **given)  # type: ignore[call-overload]
        except SampleError as error:
            error.args = (f"{piece.name}: {error}", *error.args[1:])
            raise
        results.append(found)
        if progress is not None:
            progress(done, len(plan.pieces))
    return _with_jumps(results, plan)


def reactions_under(robot: Manipulator, found: TaskForces, stiffness: Stiffness | None = None) -> Reactions:
    """Return the reactions of elastic joints under forces that are known, as of `reactions_of_task`."""
    from p3dof.analysis.reactions.evaluation import of_result

    results = [
        of_result(machine.bare_loop, machine.parameters, result, "elastic", "raise", stiffness)
        for machine, result in zip(machines_of(robot, found.plan), found.results, strict=True)
    ]
    return _with_jumps(results, found.plan).each[0]


def without_jumps(reactions: Reactions, plan: Plan) -> Reactions:
    """Return reactions at the samples of a plan, for a page; the latter of two where a load jumps."""
    rows, jumps = _samples(plan)
    return _stacked([reactions], plan.motion, ~jumps[rows])


def _samples(plan: Plan) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which samples of all pieces count, one after the other, and after which of them a load jumps."""
    time = np.concatenate([piece.motion.time for piece in plan.pieces])
    last, jumps = np.append(np.diff(time) > 0, True), np.zeros(len(time), dtype=bool)
    ends = np.cumsum([len(piece.motion) for piece in plan.pieces])[:-1]
    for former, latter, k in zip(plan.pieces[:-1], plan.pieces[1:], ends.tolist(), strict=True):
        jumps[k - 1] = former.payload is not latter.payload or (former.wrench != latter.wrench).any()
    return last | jumps, jumps


def _with_jumps(results: Sequence[AnyReactions], plan: Plan) -> AnyReactions:
    """Return the reactions of all pieces as one, with two samples wherever the load changes."""
    rows, jumps = _samples(plan)
    time = np.concatenate([piece.motion.time for piece in plan.pieces])
    for k in (np.flatnonzero(jumps) + 1).tolist():
        later = time[k + 1] if k + 1 < len(time) else np.inf
        time[k] = min(time[k] + JUMP * plan.duration, (time[k] + later) / 2)
    pose, velocity, acceleration = (
        np.concatenate([getattr(piece.motion, name) for piece in plan.pieces])[rows]
        for name in ("pose", "velocity", "acceleration")
    )
    motion = Motion(time[rows], pose, velocity, acceleration, check=False, start=0.0)
    each = [_stacked(ways, motion, rows) for ways in zip(*(one.each for one in results), strict=True)]
    return each[0] if len(each) == 1 else ReactionsComparison(*each)


def _stacked(results: Sequence[_Result], motion: Motion, rows: NDArray[np.bool_]) -> _Result:
    """Return some samples of the results of all pieces as one over a motion."""
    changed: dict[str, object] = {"motion": motion}
    for field in fields(results[0]):
        parts = [getattr(result, field.name) for result in results]
        if isinstance(parts[0], JointStates):
            columns = (np.concatenate([getattr(part, name) for part in parts])[rows] for name in "qva")
            changed[field.name] = JointStates(parts[0].names, *columns)
        elif isinstance(parts[0], CoulombLimits):
            changed[field.name] = _stacked_limits(parts, rows)
        elif isinstance(parts[0], np.ndarray) and field.name not in _WHOLE:
            changed[field.name] = np.concatenate(parts)[rows]
    return replace(results[0], **changed)  # type: ignore[arg-type]  # by their names


def _stacked_limits(parts: Sequence[CoulombLimits], rows: NDArray[np.bool_]) -> CoulombLimits:
    limits = {name: np.concatenate([part.limits[name] for part in parts])[rows] for name in parts[0].limits}
    lost = [part.screws for part in parts if part.screws is not None]
    screws = np.concatenate(lost)[rows] if len(lost) == len(parts) else None
    return replace(parts[0], limits=limits, screws=screws)
