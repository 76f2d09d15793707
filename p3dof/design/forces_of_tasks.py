"""`TaskForces`: what a task asks of the actuators, with what the platform carries and bears on the way."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError, SampleError
from p3dof._base.files import write_table
from p3dof._base.tables import NONE, ShownInNotebook, Table, html_of, notebook_html, number, table_of
from p3dof.analysis.load_friction import LoadFriction
from p3dof.analysis.reactions import Stiffness
from p3dof.design.tasks import FastestPlan, Piece, Plan
from p3dof.machine.parameters import LEGS, Limits
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.methods.registry import Method
from p3dof.methods.utilisation import Utilisation, utilisations


@dataclass(frozen=True, eq=False)
class TaskForces(ShownInNotebook):
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
        """Return how much of each limit the task uses, and when it uses most of it.

        Parameters
        ----------
        limits : Limits
            What the actuators can do.

        Returns
        -------
        tuple of Utilisation
            Forces, speeds and travel of A, B and C, and the tilt of the platform.

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

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write time, forces, power and pose of all samples to a CSV file, 17 significant digits.

        With armatures, forces at the nuts follow those of the actuators.

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        pose = np.concatenate([result.motion.pose for result in self.results])
        carried = [0.0 if piece.payload is None else piece.payload.mass for piece in self.plan.pieces]
        mass = np.concatenate([np.full(len(r.time), m) for r, m in zip(self.results, carried, strict=True)])
        nuts = self.nut_forces.T if any(result.armature.any() for result in self.results) else ()
        header = ["t [s]", *(f"f{leg} [N]" for leg in LEGS)]
        header += [*(f"nut {leg} [N]" for leg in LEGS if len(nuts)), "power [W]"]
        header += ["y [m]", "z [m]", "theta [rad]", "carried [kg]"]
        return write_table(path, header, (self.time, *self.forces.T, *nuts, self.power, *pose.T, mass))


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

    Returns
    -------
    TaskForces

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
    """Return the machine with what it carries, for each piece of a plan.

    Parameters
    ----------
    robot : Manipulator
        The machine; what it carries already stays on it.
    plan : Plan
        Of `Task.plan`.

    Returns
    -------
    tuple of Manipulator
        The same object wherever the same payload is carried.

    Raises
    ------
    InputError
        If an argument is something else.
    """
    if not isinstance(robot, Manipulator):
        raise InputError(f"robot: expected a Manipulator, got {shown(robot)}")
    if not isinstance(plan, Plan):
        raise InputError(f"plan: expected what Task.plan returns, got {shown(plan)}")
    laden: dict[int, Manipulator] = {id(None): robot}
    for piece in plan.pieces:
        if piece.payload is not None and id(piece.payload) not in laden:
            laden[id(piece.payload)] = Manipulator(robot.parameters.carrying(piece.payload))
    return tuple(laden[id(piece.payload)] for piece in plan.pieces)


def pieces_table(found: TaskForces) -> Table:
    """Return what every piece of a task takes.

    Parameters
    ----------
    found : TaskForces
        The forces over the task.

    Returns
    -------
    Table
    """
    loads = (f"largest {leg} [N]" for leg in LEGS)
    header = ("from → to", "begins [s]", "takes [s]", "carries [kg]", "fastest slider [m/s]", *loads)
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
    note = f"{number(found.plan.duration)} s in all."
    return Table(f"Task {found.plan.name}".strip(), header, tuple(rows), note)


def limits_table(plan: FastestPlan) -> Table:
    """Return how much of each of its limits the fastest plan uses, between the samples too, when and where.

    Parameters
    ----------
    plan : FastestPlan
        Of `fastest_plan`.

    Returns
    -------
    Table
    """
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            one.holds_at,
            number(one.value),
            number(one.limit),
            f"{one.share:.2%}",
            number(one.time),
            one.way,
        )
        for one in plan.uses
    }
    header = ("limit of", "holds at", "peak", "limit", "used", "at t [s]", "on the way")
    return table_of("Limits that the fastest motion keeps", header, rows)


@html_of.register(TaskForces)
def task_forces_html(found: TaskForces) -> str:
    """Return how a notebook shows the forces of a task, as HTML."""
    facts = f"{len(found.plan.pieces)} pieces over {number(found.plan.duration)} s"
    return notebook_html("Forces of a task", facts, [pieces_table(found)])
