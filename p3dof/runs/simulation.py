"""`Simulation`: everything that a run of the machine leaves behind, and its tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import FileError, InputError, MotionError
from p3dof._base.files import called, suffix_of, write_atomic
from p3dof._base.tables import (
    ShownInNotebook,
    Table,
    Tabular,
    formatted,
    html_of,
    notebook_html,
    number,
    table_of,
    time_text,
)
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import runs
from p3dof.closed_form.compiled.kernels import MachineKernels
from p3dof.closed_form.compiled.runs import Samples
from p3dof.machine.motion import Motion, motion_table
from p3dof.machine.parameters import LEGS, SLIDES, Actuators, Limits, Parameters
from p3dof.methods import METHODS, Exceedance, JointStates, exceedances_of
from p3dof.runs import archive
from p3dof.runs.archive import Member
from p3dof.runs.controllers import Reference
from p3dof.runs.margins import Occurrence, Stop
from p3dof.runs.results import RunResult
from p3dof.runs.settings import KINDS

if TYPE_CHECKING:  # reactions are by Pinocchio
    from p3dof.analysis.reactions import Reactions, Stiffness, Way

STOPS = (*KINDS, "event", "accuracy", "controller")  # what may have ended a run

FORM: dict[str, Member] = {
    "time": Member("f", ("N",)),
    **dict.fromkeys(("pose", "velocity", "acceleration", "forces", "asked"), Member("f", ("N", 3))),
    **dict.fromkeys(("sliders", "slider_velocities"), Member("f", ("N", 3))),
    "wrench": Member("f", ("N", 6)),
    "closure_error": Member("f", ("N",)),
    "joint_names": Member("U", (10,)),
    **dict.fromkeys(("q", "v", "a"), Member("f", ("N", 10))),
    **archive.ENDING,
    "reference": Member("f", ("N", 3), optional=True),
}
"""The arrays of a run that is saved."""

_MOTION = ("time", "pose", "velocity", "acceleration")
_ARRAYS = ("forces", "asked", "sliders", "slider_velocities", "wrench", "closure_error")

POSE = ("y [m]", "z [m]", "theta [rad]")
_DOTTED = ("ydot [m/s]", "zdot [m/s]", "thetadot [rad/s]")
_TWICE = ("yddot [m/s^2]", "zddot [m/s^2]", "thetaddot [rad/s^2]")
_WRENCH = ("Fx [N]", "Fy [N]", "Fz [N]", "Mx [N m]", "My [N m]", "Mz [N m]")


@dataclass(frozen=True, eq=False)
class Simulation(RunResult, ShownInNotebook, Tabular):
    """A run of the machine: its motion, the forces on it, and why it ended.

    Parameters
    ----------
    method : str
        ``"virtual-power"`` or ``"compiled"`` (minimal coordinates), or ``"pinocchio"`` (all joints, with loop
        closures).
    motion : Motion
        Pose, velocity and acceleration at the samples.
    forces : ndarray, shape (N, 3)
        Forces of the actuators A, B, C on their sliders [N].
    asked : ndarray, shape (N, 3)
        Forces that the controller asked for, before they were cut off at the limits [N].
    sliders, slider_velocities : ndarray, shape (N, 3)
        Of A, B, C [m, m/s].
    joints : JointStates
        Every joint.
    closure_error : ndarray, shape (N,)
        Largest gap of the loops [m].
    wrench : ndarray, shape (N, 6)
        External force and moment on the platform at P [N, N m].
    reference : ndarray, shape (N, 3), or None
        The poses that the controller was to follow.
    stop : Stop or None
        What ended the run early; None if it went on to its end.
    evaluations : int
        How many times the equations of motion were evaluated.
    seconds : float
        Time that the whole call took on the clock [s]: checks, tables, integration and result.
    note : str
        What made the run slow, and what to do instead, where it was not made in C; else empty.
    events : tuple of Occurrence
        Events that did not end the run, in their order.
    parameters : Parameters or None
        The machine; None of a run from a file.
    """

    method: str
    motion: Motion
    forces: FloatArray
    asked: FloatArray
    sliders: FloatArray
    slider_velocities: FloatArray
    joints: JointStates
    closure_error: FloatArray
    wrench: FloatArray
    reference: FloatArray | None
    stop: Stop | None
    evaluations: int
    seconds: float
    note: str = ""
    events: tuple[Occurrence, ...] = ()
    parameters: Parameters | None = None

    def __repr__(self) -> str:
        end = "finished" if self.stop is None else f"ended by {self.stop}"
        return f"Simulation({self.method}, {self.motion!r}, {end})"

    @property
    def time(self) -> FloatArray:
        """Times of the samples, shape (N,) [s]."""
        return self.motion.time

    @property
    def pose(self) -> FloatArray:
        """Poses, shape (N, 3): y [m], z [m], θ [rad]."""
        return self.motion.pose

    @property
    def velocity(self) -> FloatArray:
        """Their velocities, shape (N, 3)."""
        return self.motion.velocity

    @property
    def acceleration(self) -> FloatArray:
        """Their accelerations, shape (N, 3)."""
        return self.motion.acceleration

    @property
    def error(self) -> FloatArray:
        """Tracking error, pose less reference, shape (N, 3) [m, m, rad].

        Raises
        ------
        InputError
            If the run had nothing to follow.
        """
        if self.reference is None:
            raise InputError("error: the run had no motion to follow")
        return self.pose - self.reference

    def nut_forces(self, actuators: Actuators) -> FloatArray:
        """Return the forces that screws passed on: `forces` without what armatures took, shape (N, 3) [N].

        Parameters
        ----------
        actuators : Actuators
            Those of the machine that ran.
        """
        return self.forces - actuators.rotors * self.joints.columns(SLIDES).a

    def exceedances(self, limits: Limits) -> list[Exceedance]:
        """Return the limits that the samples exceed, each at its worst; empty if none is."""
        return exceedances_of(limits, self.motion, self.sliders, self.slider_velocities, self.forces)

    @property
    def duration(self) -> float:
        """How long the run went on [s]."""
        return self.motion.duration

    @property
    def rates(self) -> FloatArray:
        """Velocities of the sliders, shape (N, 3) [m/s]."""
        return self.slider_velocities

    @property
    def gap(self) -> FloatArray:
        """Largest gap of the loops, shape (N,) [m]: `closure_error`."""
        return self.closure_error

    @property
    def energy(self) -> FloatArray:
        """Kinetic and potential energy, that of motors and counterbalances included, shape (N,) [J]."""
        from p3dof.analysis.energy.evaluation import quantities

        found = quantities(self._machine(), self.pose, self.velocity, "nan")
        return np.asarray(np.sum(found.kinetic + found.potential, axis=-1))

    def reactions(self, joints: Way = "elastic", stiffness: Stiffness | None = None) -> Reactions:
        """Return the force and moment in every joint at the samples.

        Parameters
        ----------
        joints : {"elastic", "paper", "points"}
            How loads are found that rigid bodies leave open, as of `p3dof.Manipulator.reactions`.
        stiffness : Stiffness, optional
            Of joints and rods.

        Raises
        ------
        InputError
            If the run is from a file, which does not hold its machine.
        """
        from p3dof.analysis.reactions.evaluation import of_solution
        from p3dof.methods.registry import ManipulatorModel

        parameters, solved = self._machine(), cast("Any", self)  # it has joints and forces, as a solution has
        loop = ManipulatorModel(parameters).bare_loop
        return of_solution(loop, parameters, self.motion, solved, joints, self.wrench, stiffness=stiffness)

    def _machine(self) -> Parameters:
        if self.parameters is None:
            raise InputError("parameters: a file does not hold the machine of a run; load(path, parameters)")
        return self.parameters

    def to_columns(self) -> dict[str, FloatArray]:
        """Return the samples as named columns of numbers, shape (N,) each; the names hold the units."""
        found: dict[str, FloatArray] = {"t [s]": self.time}
        tables = [
            (POSE, self.pose),
            (_DOTTED, self.velocity),
            (_TWICE, self.acceleration),
            (tuple(f"slider {leg} [m]" for leg in LEGS), self.sliders),
            (tuple(f"slider velocity {leg} [m/s]" for leg in LEGS), self.slider_velocities),
            (tuple(f"f{leg} [N]" for leg in LEGS), self.forces),
            (tuple(f"f{leg} asked [N]" for leg in LEGS), self.asked),
            (_WRENCH, self.wrench),
        ]
        if self.reference is not None:
            tables.append((tuple(f"reference {name}" for name in POSE), self.reference))
        for names, table in tables:
            found.update(zip(names, table.T, strict=True))
        found["closure_error [m]"] = self.closure_error
        return found

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the samples to a file; the ending of the name chooses the format.

        Parameters
        ----------
        path : path-like
            ``.csv`` (17 significant digits) or ``.npz`` (NumPy arrays, with all joints in q, v and a);
            replaced whole or not at all.

        Raises
        ------
        InputError
            If the ending is another one.
        FileError
            If the file cannot be written.
        """
        if suffix_of(path, "run") == ".csv":
            return self.to_csv(path)
        arrays = {
            "time": self.time,
            "pose": self.pose,
            "velocity": self.velocity,
            "acceleration": self.acceleration,
            "forces": self.forces,
            "asked": self.asked,
            "sliders": self.sliders,
            "slider_velocities": self.slider_velocities,
            "wrench": self.wrench,
            "closure_error": self.closure_error,
            "joint_names": np.array(self.joints.names),
            "q": self.joints.q,
            "v": self.joints.v,
            "a": self.joints.a,
        }
        return write_atomic(path, archive.pack(self, arrays))

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        parameters: Parameters | None = None,
        max_samples: int = archive.MAX_SAMPLES,
    ) -> Simulation:
        """Read a run that `save` wrote as ``.npz``.

        Parameters
        ----------
        path : path-like
            The file; it may come from anywhere.
        parameters : Parameters, optional
            The machine that ran, which `energy` and `reactions` need.
        max_samples : int
            Most samples to read, each takes about half a kilobyte; a longer run is refused.

        Raises
        ------
        FileError
            If the file cannot be read, or is no such run: nothing but the arrays of `save`, with their types
            and shapes.
        InputError
            If `max_samples` is no positive number.
        """
        found = archive.unpack(path, FORM, METHODS, STOPS, max_samples)
        time, pose, velocity, acceleration = (found[name] for name in _MOTION)
        names = tuple(str(name) for name in found["joint_names"])
        try:
            motion = Motion(time, pose, velocity, acceleration, check=False)
        except MotionError as error:  # numbers that are too large for a motion
            raise FileError(f"{called(path)}: expected a run saved as .npz ({error})") from error
        return cls(
            motion=motion,
            joints=JointStates(names, found["q"], found["v"], found["a"]),
            parameters=parameters,
            **{name: found[name] for name in _ARRAYS},
            **archive.ending_of(found),
        )


class LaterSimulation(Simulation):
    """A run of which all but states and forces is computed when it is first asked for."""

    @classmethod
    def of(
        cls,
        kernels: MachineKernels,
        samples: Samples,
        followed: Reference | None,
        pushed: Callable[[FloatArray], FloatArray],
        part: bool = False,
        **known: Any,
    ) -> Simulation:
        """Return a run: samples, or a part of them, what it followed, wrenches by time, and more."""
        run = object.__new__(cls)
        vars(run).update(known, _kernels=kernels, _samples=samples, _followed=followed, _pushed=pushed)
        vars(run)["_start"] = None if samples.time[0] == 0 or not part else 0.0
        return run

    def __reduce__(self) -> tuple[type[Simulation], tuple[Any, ...]]:
        return Simulation, tuple(getattr(self, field.name) for field in fields(Simulation))

    def __getattr__(self, name: str) -> Any:
        made = _LATER.get(name)
        if made is None:
            return Readable.__getattr__(self, name)  # type: ignore[attr-defined]
        for each, value in made(self).items():
            object.__setattr__(self, each, value)
        return self.__dict__[name]


def _motion(run: Any) -> dict[str, Any]:
    samples = run._samples
    acceleration = runs.accelerations(run._kernels, samples, run.wrench)
    moved = samples.time, samples.pose, samples.velocity, acceleration
    return {"motion": Motion(*moved, check=False, start=run._start)}


def _wrench(run: Any) -> dict[str, Any]:
    return {"wrench": run._pushed(run._samples.time)}


def _joints(run: Any) -> dict[str, Any]:
    motion, geometry = run.motion, run._kernels.parameters.geometry
    found = kinematics.mechanism_motion(geometry, motion.pose, motion.velocity, motion.acceleration, "nan")
    parts = found.position, found.velocity, found.acceleration
    joints = JointStates.from_mappings(tuple(found.position), *parts)
    return {"joints": joints, "closure_error": kinematics.closure_error(geometry, found)}


def _sliders(run: Any) -> dict[str, Any]:
    positions, velocities = runs.sliders(run._kernels, run._samples)
    return {"sliders": positions, "slider_velocities": velocities}


def _reference(run: Any) -> dict[str, Any]:
    return {"reference": None if run._followed is None else run._followed.poses(run._samples.time)}


_LATER = {
    "motion": _motion,
    "wrench": _wrench,
    "joints": _joints,
    "closure_error": _joints,
    "sliders": _sliders,
    "slider_velocities": _sliders,
    "reference": _reference,
}


def errors_table(runs: Mapping[str, Simulation]) -> Table:
    """Return the tracking errors of runs, their forces, and how fast they were.

    Parameters
    ----------
    runs : mapping of str to Simulation
        By controller; each follows a motion.
    """
    rows = {
        name: (
            *(formatted(1e3 * error, ".3g") for error in run.peak_error),
            formatted(np.abs(run.forces).max(), ".1f"),
            formatted(run.speed, ".2g"),
        )
        for name, run in runs.items()
    }
    header = ("controller", "y [mm]", "z [mm]", "θ [mrad]", "force [N]", "× real time")
    return table_of("Largest tracking errors and forces, and the speed of the simulation", header, rows)


def run_table(run: Simulation) -> Table:
    """Return what each actuator did in a run."""
    rows = {
        leg: (
            np.abs(run.forces[:, k]).max(),
            np.abs(run.slider_velocities[:, k]).max(),
            run.sliders[:, k].min(),
            run.sliders[:, k].max(),
        )
        for k, leg in enumerate(LEGS)
    }
    header = ("actuator", "largest force [N]", "largest speed [m/s]", "lowest [m]", "highest [m]")
    note = f"Largest closure error: {run.closure_error.max():.1e} m."
    return table_of("Actuators", header, rows, note)


@html_of.register(Simulation)
def simulation_html(run: Simulation) -> str:
    """Return how a notebook shows a run, as HTML."""
    took = f"in {time_text(run.seconds)}, {run.evaluations} evaluations"
    facts = f"{run.method}, {len(run)} samples over {number(run.motion.duration)} s, {took}"
    tables = [run_table(run), motion_table(run.motion, run.wrench)]
    if run.reference is not None:
        tables.insert(0, errors_table({"this run": run}))
    warnings = [] if run.stop is None else [f"ended by {run.stop}"]
    return notebook_html("Simulation", facts, tables, warnings, run.note)
