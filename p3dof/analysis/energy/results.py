"""Energy, momentum and work over a motion, and what it asks of the drives."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.files import write_table
from p3dof._base.tables import NONE, ShownInNotebook, Table, html_of, notebook_html, number, table_of
from p3dof.machine.parameters import LEGS


@dataclass(frozen=True, eq=False)
class DriveLoads(Readable):
    """Loads of each actuator over a motion; NaN if a sample is invalid: there is no largest then, and no sum.

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
        Work supplied, and work regenerated, zero or less [J].
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
    nothing is added for it, and the balance restarts.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times [s].
    bodies : tuple of str
        Names of the ten bodies, and of the three actuators where the machine has any.
    kinetic, potential : ndarray, shape (N, 10) or (N, 13)
        Energies of each body [J]; potential energy is zero where the mass centre is at O. An actuator has
        that of the inertia reflected to its slider, and of its counterbalance, zero at home.
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
        """Write every quantity to a CSV file, 17 digits; errors as `InverseDynamics.to_csv`."""
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


def drives_table(energy: Energy) -> Table:
    """Return what each drive must do."""
    drives = energy.drives
    loads = {
        "peak force [N]": drives.peak_force,
        "RMS force [N]": drives.rms_force,
        "peak speed [m/s]": drives.peak_speed,
        "peak power [W]": drives.peak_power,
        "peak braking power [W]": drives.peak_braking,
        "mean power [W]": drives.mean_power,
        "work supplied [J]": drives.positive_work,
        "work regenerated [J]": drives.negative_work,
    }
    rows = {name: tuple(values.tolist()) for name, values in loads.items()}
    return table_of("Loads of the drives", ("drive load", *(f"actuator {leg}" for leg in LEGS)), rows)


def bodies_table(energy: Energy) -> Table:
    """Return the largest kinetic energy of each body."""
    header = ["body", "peak kinetic energy [J]"]
    if not energy.valid.all():
        unknown = dict.fromkeys(energy.bodies, (np.nan,))
        return table_of("Kinetic energy", header, unknown, "Not known in all samples.")
    most = int(np.argmax(energy.kinetic_total))
    total = energy.kinetic_total[most]
    rows = {
        name: (energy.kinetic[:, k].max(), f"{energy.kinetic[most, k] / total if total else 0.0:.1%}")
        for k, name in enumerate(energy.bodies)
    }
    header.append(f"share at t = {number(energy.time[most])} s")
    return table_of("Kinetic energy", header, rows, f"All bodies at most {number(total)} J.")


def balance_table(energy: Energy) -> Table:
    """Return the evidence: the work done on the mechanism against the change of its energy."""
    error = np.abs(energy.balance[energy.valid]).max(initial=0.0)
    done = energy.work_done[-1] if energy.valid.all() else np.nan
    rows = {"over the motion": (done, f"{error:.1e}" if energy.valid.any() else NONE, energy.scale)}
    header = ("energy balance", "work done [J]", "largest error [J]", "range of the energy [J]")
    return table_of("Change of the energy less the work done", header, rows)


@html_of.register(Energy)
def energy_html(energy: Energy) -> str:
    """Return how a notebook shows energy and work over a motion, as HTML."""
    facts = f"{len(energy.time)} samples from {number(energy.time[0])} to {number(energy.time[-1])} s"
    invalid = int((~energy.valid).sum())
    warnings = [f"{invalid} samples are invalid: no peak and no sum is known"] if invalid else []
    tables = (drives_table(energy), bodies_table(energy), balance_table(energy))
    return notebook_html("Energy", facts, tables, warnings)
