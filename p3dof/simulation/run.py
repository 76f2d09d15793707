"""`Simulation`: everything that a run leaves behind."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p3dof.checks import FloatArray
from p3dof.errors import InputError
from p3dof.files import write_atomic
from p3dof.motion import Motion
from p3dof.routes import LEGS, JointStates, write_table
from p3dof.simulation.limits import Stop

POSE = ("y [m]", "z [m]", "theta [rad]")
_DOTTED = ("ydot [m/s]", "zdot [m/s]", "thetadot [rad/s]")


@dataclass(frozen=True, eq=False)
class Simulation:
    """A run of the machine: its motion, the forces on it, and why it ended.

    Parameters
    ----------
    method : str
        ``"virtual-power"`` (minimal coordinates) or ``"pinocchio"`` (all joints, with loop closures).
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
            (tuple(f"slider {leg} [m]" for leg in LEGS), self.sliders),
            (tuple(f"slider {leg} [m/s]" for leg in LEGS), self.slider_velocities),
            (tuple(f"f{leg} [N]" for leg in LEGS), self.forces),
            (tuple(f"f{leg} asked [N]" for leg in LEGS), self.asked),
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
        kind = Path(path).suffix.lower()
        if kind == ".csv":
            columns = self.columns()
            return write_table(path, list(columns), tuple(columns.values()))
        if kind != ".npz":
            raise InputError(f"{path}: expected a file name that ends in .csv or .npz")
        stream = io.BytesIO()
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
            "stop": np.array("" if self.stop is None else str(self.stop)),
        }
        if self.reference is not None:
            arrays["reference"] = self.reference
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]  # NumPy's own stubs
        return write_atomic(path, stream.getvalue())
