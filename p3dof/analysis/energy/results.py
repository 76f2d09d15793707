"""Energy, momentum and work over a motion, and what it asks of the drives."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.files import write_table
from p3dof._base.tables import ShownInNotebook
from p3dof.machine.parameters import LEGS


@dataclass(frozen=True, eq=False)
class DriveLoads:
    """What a motion asks of each actuator; NaN if a sample is invalid: there is no largest then, and no sum.

    Parameters
    ----------
    peak_force, rms_force : ndarray, shape (3,)
        Largest magnitude and root mean square of the force [N].
    peak_speed : ndarray, shape (3,)
        Largest magnitude of the slider's velocity [m/s].
    peak_power, peak_braking : ndarray, shape (3,)
        Largest power that the actuator gives to the mechanism, and that it takes back from it [W]; zero if it
        never does.
    mean_power : ndarray, shape (3,)
        Work by the time that it takes [W].
    positive_work, negative_work : ndarray, shape (3,)
        Work given, and work taken back: what a drive could regenerate, zero or less [J].
    """

    peak_force: FloatArray
    rms_force: FloatArray
    peak_speed: FloatArray
    peak_power: FloatArray
    peak_braking: FloatArray
    mean_power: FloatArray
    positive_work: FloatArray
    negative_work: FloatArray


@dataclass(frozen=True, eq=False)
class Energy(ShownInNotebook):
    """Energy, momentum and work over a motion; rows of invalid samples are NaN.

    Work is integrated by a spline of degree 5 through the power at the samples, over runs of neighbouring
    valid samples (of a lower degree for fewer than 6; by trapezoids if their steps are too uneven for a
    spline). What is done between two runs, across invalid samples or an actuation singularity, is unknown:
    nothing is added for it, and the balance begins anew.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times [s].
    bodies : tuple of str
        Names of the ten bodies, and of the three actuators where the machine has any.
    kinetic, potential : ndarray, shape (N, 10) or (N, 13)
        Energies of each body [J]; potential energy is zero where the mass centre is at O. An actuator has
        that of the inertia reflected to its slider, and of its balance, zero at home.
    momentum, angular_momentum : ndarray, shape (N, 3)
        Of the ten bodies together, the angular one about O, in fixed axes [N s, N m s].
    power, work : ndarray, shape (N, 3)
        Of the actuators A, B, C on the mechanism, and its integral from the first valid sample [W, J].
    wrench_power, wrench_work : ndarray, shape (N,)
        Of the external wrench likewise [W, J].
    dissipated_power, dissipated_work : ndarray, shape (N,)
        Lost in friction, zero or more [W, J].
    balance : ndarray, shape (N,)
        Change of T + V since the first sample of the run, less the work done on the mechanism since then
        (actuators and wrench less friction) [J]: zero but for the forces' errors and the integration's. Where
        friction turns around, or one actuator works against another, errors of the single works cancel in it.
    drives : DriveLoads
        Peaks, means and sums for each actuator.
    """

    time: FloatArray
    bodies: tuple[str, ...]
    kinetic: FloatArray
    potential: FloatArray
    momentum: FloatArray
    angular_momentum: FloatArray
    power: FloatArray
    work: FloatArray
    wrench_power: FloatArray
    wrench_work: FloatArray
    dissipated_power: FloatArray
    dissipated_work: FloatArray
    balance: FloatArray
    drives: DriveLoads

    def __repr__(self) -> str:
        given, taken = self.drives.positive_work.sum(), abs(self.drives.negative_work.sum())
        return f"Energy({len(self.time)} samples, actuators give {given:.6g} J and take {taken:.6g} J)"

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which samples are valid, shape (N,)."""
        return np.asarray(np.isfinite(self.balance))

    @property
    def kinetic_total(self) -> FloatArray:
        """Kinetic energy of all bodies, shape (N,) [J]."""
        return np.asarray(self.kinetic.sum(axis=-1))

    @property
    def potential_total(self) -> FloatArray:
        """Potential energy of all bodies, shape (N,) [J]."""
        return np.asarray(self.potential.sum(axis=-1))

    @property
    def total(self) -> FloatArray:
        """Kinetic and potential energy of all bodies, shape (N,) [J]."""
        return self.kinetic_total + self.potential_total

    @property
    def work_done(self) -> FloatArray:
        """Work done on the mechanism: actuators and wrench less friction, shape (N,) [J]."""
        return np.asarray(self.work.sum(axis=-1) + self.wrench_work - self.dissipated_work)

    @property
    def scale(self) -> float:
        """The larger of the peak of T and the range of T + V [J]: what the balance is small to.

        Zero for a machine at rest; NaN if no sample is valid.
        """
        if not self.valid.any():
            return float("nan")
        total = self.total[self.valid]
        return float(max(self.kinetic_total[self.valid].max(), np.ptp(total)))

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write every quantity to a CSV file, 17 significant digits.

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
        header = ["t [s]", "kinetic [J]", "potential [J]", "total [J]"]
        header += [f"power {leg} [W]" for leg in LEGS] + [f"work {leg} [J]" for leg in LEGS]
        header += ["wrench power [W]", "wrench work [J]", "dissipated power [W]", "dissipated work [J]"]
        header += ["balance [J]"]
        header += [f"momentum {axis} [N s]" for axis in "xyz"]
        header += [f"angular momentum {axis} [N m s]" for axis in "xyz"]
        header += [f"kinetic {name} [J]" for name in self.bodies]
        header += [f"potential {name} [J]" for name in self.bodies]
        columns = (
            *(self.time, self.kinetic_total, self.potential_total, self.total),
            *(*self.power.T, *self.work.T, self.wrench_power, self.wrench_work),
            *(self.dissipated_power, self.dissipated_work, self.balance),
            *(*self.momentum.T, *self.angular_momentum.T, *self.kinetic.T, *self.potential.T),
        )
        return write_table(path, header, columns)
