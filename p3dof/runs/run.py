"""`Simulation`: everything that a run leaves behind."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import FileError, InputError, MotionError
from p3dof._base.files import MAX_TEXT, called, suffix_of, write_atomic, write_table
from p3dof._base.tables import ShownInNotebook
from p3dof.machine.motion import Motion
from p3dof.machine.motion.times import require_rising
from p3dof.machine.parameters import LEGS, SLIDES, Actuators, Limits
from p3dof.methods import METHODS, Exceedance, JointStates, exceedances_of
from p3dof.runs import archive
from p3dof.runs.limits import KINDS
from p3dof.runs.margins import Stop

STOPS = (*KINDS, "accuracy", "controller")
"""What may have ended a run."""

_MOTION = ("time", "pose", "velocity", "acceleration")
_ARRAYS = ("forces", "asked", "sliders", "slider_velocities", "wrench", "closure_error")

POSE = ("y [m]", "z [m]", "theta [rad]")
_DOTTED = ("ydot [m/s]", "zdot [m/s]", "thetadot [rad/s]")
_TWICE = ("yddot [m/s^2]", "zddot [m/s^2]", "thetaddot [rad/s^2]")
_WRENCH = ("Fx [N]", "Fy [N]", "Fz [N]", "Mx [N m]", "My [N m]", "Mz [N m]")


@dataclass(frozen=True, eq=False)
class Simulation(ShownInNotebook):
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
        Time that the integration took on the clock [s].
    note : str
        What made the run slow, and what to do instead, where it was not made in C; else empty.
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

    def __repr__(self) -> str:
        end = "finished" if self.stop is None else f"ended by {self.stop}"
        return f"Simulation({self.method}, {self.motion!r}, {end})"

    def __len__(self) -> int:
        return len(self.motion)

    @property
    def finished(self) -> bool:
        """Whether the run went on to its end."""
        return self.stop is None

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
        """Return the forces that screws passed on to the sliders.

        Parameters
        ----------
        actuators : Actuators
            Those of the machine that ran.

        Returns
        -------
        ndarray, shape (N, 3)
            Of A, B, C: `forces` without what armatures took [N].
        """
        return self.forces - actuators.rotors * self.joints.columns(SLIDES).a

    def exceedances(self, limits: Limits) -> list[Exceedance]:
        """Return the limits that the samples exceed, each at its worst; empty if none is."""
        return exceedances_of(limits, self.motion, self.sliders, self.slider_velocities, self.forces)

    @property
    def rms_error(self) -> FloatArray:
        """Root mean square over the samples of the tracking error, shape (3,) [m, m, rad]."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def peak_error(self) -> FloatArray:
        """Largest magnitude of the tracking error, shape (3,) [m, m, rad]."""
        return np.asarray(np.abs(self.error).max(axis=0))

    @property
    def speed(self) -> float:
        """Simulated time by time on the clock: above 1 the run was faster than the machine."""
        return self.motion.duration / self.seconds if self.seconds else float("inf")

    def columns(self) -> dict[str, FloatArray]:
        """Return the samples as named columns of numbers, shape (N,) each; the names hold the units."""
        found: dict[str, FloatArray] = {"t [s]": self.time}
        tables = [
            (POSE, self.pose),
            (_DOTTED, self.velocity),
            (_TWICE, self.acceleration),
            (tuple(f"slider {leg} [m]" for leg in LEGS), self.sliders),
            (tuple(f"slider {leg} [m/s]" for leg in LEGS), self.slider_velocities),
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

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        InputError
            If the ending is another one.
        FileError
            If the file cannot be written.
        """
        if suffix_of(path, "run") == ".csv":
            columns = self.columns()
            return write_table(path, list(columns), tuple(columns.values()))
        words = [] if self.stop is None else [self.stop.kind, self.stop.reason[:MAX_TEXT]]
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
            "method": np.array(self.method),
            "stop": np.array(words, dtype=np.str_),
            "stop_time": np.array(np.nan if self.stop is None else self.stop.time),
            "evaluations": np.array(self.evaluations),
            "seconds": np.array(self.seconds),
            "note": np.array(self.note[:MAX_TEXT]),
        }
        if self.reference is not None:
            arrays["reference"] = self.reference
        return write_atomic(path, archive.pack(arrays))

    @classmethod
    def load(cls, path: str | os.PathLike[str], max_samples: int = archive.MAX_SAMPLES) -> Simulation:
        """Read a run that `save` wrote as ``.npz``.

        Parameters
        ----------
        path : path-like
            The file; it may come from anywhere.
        max_samples : int
            Most samples to read, each takes about half a kilobyte; a longer run is refused.

        Returns
        -------
        Simulation

        Raises
        ------
        FileError
            If the file cannot be read, or is no such run: nothing but the arrays of `save`, with their types
            and shapes.
        InputError
            If `max_samples` is no positive number.
        """
        if isinstance(max_samples, bool) or not isinstance(max_samples, int) or max_samples < 1:
            raise InputError(f"max_samples: expected a positive whole number, got {shown(max_samples)}")
        found = archive.unpack(path, _check, max_samples)
        words = [str(word) for word in found["stop"]]
        stop = Stop(words[0], float(found["stop_time"]), words[1]) if words else None
        time, pose, velocity, acceleration = (found[name] for name in _MOTION)
        names = tuple(str(name) for name in found["joint_names"])
        try:
            motion = Motion(time, pose, velocity, acceleration, check=False)
        except MotionError as error:  # numbers that are too large for a motion
            raise FileError(f"{called(path)}: expected a run saved as .npz ({error})") from error
        return cls(
            method=str(found["method"]),
            motion=motion,
            joints=JointStates(names, found["q"], found["v"], found["a"]),
            reference=found.get("reference"),
            stop=stop,
            evaluations=int(found["evaluations"]),
            seconds=float(found["seconds"]),
            note=str(found["note"]),
            **{name: found[name] for name in _ARRAYS},
        )


def _check(found: dict[str, Any]) -> None:
    """Raise InputError unless what has just been read of a run can be so; called after every array."""
    name, value = next(reversed(found.items()))
    if name == "time":
        if len(value) == 0:
            raise InputError("time: expected at least one sample, got none")
        require_rising("time", value)
    elif name == "joint_names" and len({str(word) for word in value}) < len(value):
        raise InputError("joint_names: expected different names")
    elif name == "method" and str(value) not in METHODS:
        raise InputError(f"method: expected one of {', '.join(METHODS)}, got {shown(str(value))}")
    elif name == "stop" and len(value) and (len(value) != 2 or str(value[0]) not in STOPS):
        raise InputError(
            f"stop: expected nothing, or one of {', '.join(STOPS)} and why, got {shown(str(value[0]))}"
        )
    elif name == "stop_time" and np.isfinite(value) != bool(len(found["stop"])):
        raise InputError("stop_time: expected a time if the run was ended, and none if not")
    elif name in {"closure_error", "evaluations", "seconds"} and np.any(value < 0):
        raise InputError(f"{name}: expected no negative number")
