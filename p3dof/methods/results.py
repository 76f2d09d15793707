"""Named results of the inverse dynamics; they carry their own evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import (
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
    time_text,
)
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, SLIDES, Actuators, Limits
from p3dof.methods.solution import CoulombLimits, JointStates, Later, Solution, later
from p3dof.methods.utilisation import Exceedance, Utilisation, exceedances_of, utilisations


@dataclass(frozen=True, eq=False)
class InverseDynamics(Later, ShownInNotebook, Tabular):
    """Actuator forces over a motion, with the evidence that they are right.

    What forces do not need (joints, power, evidence other than `actuation`) is found when it is first asked
    for, where a method finds it apart.

    Parameters
    ----------
    method : str
        ``"pinocchio"``, ``"virtual-power"`` or ``"compiled"``.
    motion : Motion
        The motion of the platform.
    forces : ndarray, shape (N, 3)
        Forces of the actuators A, B, C on their sliders, positive along +z0 [N].
    joints : JointStates
        Every joint, the sliders ``slide_a``, ``slide_b``, ``slide_c`` among them.
    closure_error : ndarray, shape (N,)
        Largest gap of the three loops [m].
    wrench : ndarray, shape (N, 6)
        External force and moment on the platform at P that the forces hold against [N, N m].
    power : ndarray, shape (N,)
        Power of the actuators [W].
    power_residual : ndarray, shape (N,)
        Power of actuators and external wrench less friction losses and less the rate of change of
        kinetic and potential energy, which is summed body by body, Σ v·m(a-g) + ω·(Iα + ω×Iω) [W].
    dissipation : ndarray, shape (N,)
        Power lost in friction [W].
    actuation : ndarray, shape (N,)
        Angle from the actuation singularity [rad]; see `p3dof.closed_form.kinematics.Singularity`.
    crossings : ndarray, shape (K,)
        Times of the samples after which (or at which) the motion crosses an actuation singularity [s]. The
        forces are unbounded there: samples near by are invalid, however tame theirs are.
    examine : callable, optional
        Finds `warnings` when they are asked for.
    coulomb : CoulombLimits, optional
        Friction that depends on loads, where it was asked for: forces and dissipation have it.
    armature : ndarray, shape (3,)
        Inertia of motors and screws reflected to the sliders, which the forces move [kg].
    """

    method: str
    motion: Motion
    forces: FloatArray
    joints: JointStates
    closure_error: FloatArray
    wrench: FloatArray
    power: FloatArray
    power_residual: FloatArray
    dissipation: FloatArray
    actuation: FloatArray
    crossings: FloatArray = field(default_factory=lambda: np.zeros(0))
    examine: Callable[[InverseDynamics], tuple[str, ...]] | None = None
    coulomb: CoulombLimits | None = None
    armature: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __repr__(self) -> str:
        words = f"{self.method}, {self.motion!r}"
        if not self.possible:
            invalid = len(self.time) - int(self.valid.sum())
            return f"InverseDynamics({words}, not possible: {invalid} samples are invalid)"
        peaks = ", ".join(f"{peak:.6g}" for peak in self.peak_forces)
        told = f", {len(self.warnings)} warnings" if self.warnings else ""
        return f"InverseDynamics({words}, peak forces {peaks} N{told})"

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What a reader of these numbers should know, one sentence each; empty when all is well.

        Invalid samples, crossings of a singularity, exceeded limits; that the motion is undersampled for the
        peaks and the work between them; that poses look like waypoints, or are too noisy to differentiate.
        The first look takes some milliseconds a thousand samples.
        """
        return () if self.examine is None else self.examine(self)

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""
        return self.motion.time

    @property
    def _slides(self) -> JointStates:
        return self.joints.columns(SLIDES)

    @property
    def sliders(self) -> FloatArray:
        """Slider positions A, B, C, shape (N, 3) [m]."""
        return self._slides.q

    @property
    def slider_velocities(self) -> FloatArray:
        """Slider velocities, shape (N, 3) [m/s]."""
        return self._slides.v

    @property
    def slider_accelerations(self) -> FloatArray:
        """Slider accelerations, shape (N, 3) [m/s²]."""
        return self._slides.a

    @property
    def nut_forces(self) -> FloatArray:
        """Forces that screws pass on to the sliders, shape (N, 3) [N]: without what armatures take.

        Nor have they what screws lose, if load-dependent friction has any of it.
        """
        forces = self.forces - self.armature * self.slider_accelerations
        if self.coulomb is None or self.coulomb.screws is None:
            return forces
        lost = self.coulomb.screws * np.tanh(self.slider_velocities / self.coulomb.smoothing)
        return np.asarray(forces - lost)

    @property
    def valid(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Which samples have forces, shape (N,); the others were invalid and are NaN."""
        return np.asarray(np.isfinite(self.forces).all(axis=-1))

    @property
    def possible(self) -> bool:
        """Whether every sample is valid: else the machine cannot perform the motion."""
        return bool(self.valid.all())

    @property
    def peak_forces(self) -> FloatArray:
        """Largest magnitude of each actuator's force, shape (3,) [N]; NaN unless the motion is `possible`."""
        if not self.possible:
            return np.full(3, np.nan)
        return np.asarray(np.abs(self.forces).max(axis=0))

    @property
    def rms_forces(self) -> FloatArray:
        """Root mean square of each force over time, shape (3,) [N]; NaN unless the motion is `possible`."""
        return self.rms_of(self.forces)

    def rms_of(self, columns: FloatArray) -> FloatArray:
        """Return the root mean square over time of columns such as `nut_forces`.

        Parameters
        ----------
        columns : ndarray, shape (N, K)
            Their values at the samples.

        Returns
        -------
        ndarray, shape (K,)
            NaN unless the motion is `possible`.
        """
        if not self.possible:
            return np.full(columns.shape[1], np.nan)
        if len(self.time) < 2:
            return np.asarray(np.abs(columns).max(axis=0))
        mean = np.trapezoid(columns**2, self.time, axis=0) / self.motion.duration
        return np.asarray(np.sqrt(mean))

    @property
    def force_scale(self) -> FloatArray:
        """Largest magnitude of each force among the valid samples, shape (3,) [N]: what errors are small to.

        Not a peak: what is between and beside them may be larger. Zero if no sample is valid.
        """
        return np.asarray(np.abs(self.forces[self.valid]).max(axis=0, initial=0.0))

    def exceedances(self, limits: Limits) -> list[Exceedance]:
        """Return the limits that the motion exceeds, each at its worst sample; see `exceedances_of`.

        Of a motion that is not `possible`, no force and no speed is named: there is no largest one.

        Parameters
        ----------
        limits : Limits
            What the actuators can do.

        Returns
        -------
        list of Exceedance
            Empty when the machine can do the motion.

        Raises
        ------
        InputError
            If `limits` is not a `Limits`.
        """
        unknown = np.full_like(self.forces, np.nan)
        speeds, forces = (self.slider_velocities, self.forces) if self.possible else (unknown, unknown)
        return exceedances_of(limits, self.motion, self.sliders, speeds, forces)

    def utilisations(self, limits: Limits) -> tuple[Utilisation, ...]:
        """Return how much of each limit the motion uses, and when it uses most of it.

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
        unknown = np.full_like(self.forces, np.nan)
        speeds, forces = (self.slider_velocities, self.forces) if self.possible else (unknown, unknown)
        used = {"force": forces, "speed": speeds, "travel": self.sliders, "tilt": self.motion.pose[:, 2:]}
        return utilisations(self.time, used, limits)

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, forces, pose, sliders, closure error and power, (N,) each, by name and unit.

        With armatures, forces at the nuts follow those of the actuators.
        """
        found = {"t [s]": self.time, **columns_by("f{} [N]", LEGS, self.forces)}
        if self.armature.any():
            found |= columns_by("nut {} [N]", LEGS, self.nut_forces)
        found |= columns_by("{}", POSE_COLUMNS, self.motion.pose)
        found |= columns_by("slider {} [m]", LEGS, self.sliders)
        found |= {"closure_error [m]": self.closure_error}
        return found | {"power [W]": self.power, "power_residual [W]": self.power_residual}


def with_evidence(
    method: str,
    motion: Motion,
    solution: Solution,
    wrench: FloatArray | None,
    crossings: FloatArray | None = None,
    examine: Callable[[InverseDynamics], tuple[str, ...]] | None = None,
    coulomb: CoulombLimits | None = None,
    actuators: Actuators | None = None,
) -> InverseDynamics:
    """Return the result; its evidence, and the balance of power, are found when they are first asked for."""
    return later(
        InverseDynamics,
        partial(_found, solution, motion, wrench, actuators),
        method=method,
        motion=motion,
        forces=solution.forces,
        actuation=solution.actuation,
        crossings=np.zeros(0) if crossings is None else crossings,
        examine=examine,
        coulomb=coulomb,
    )


def _found(
    solution: Solution, motion: Motion, wrench: FloatArray | None, actuators: Actuators | None, name: str
) -> dict[str, Any]:
    """Return what a result has by name."""
    if name in ("joints", "closure_error", "dissipation"):
        return {name: getattr(solution, name)}
    if name == "armature":
        return {name: np.zeros(3) if actuators is None else actuators.rotors}
    if name == "wrench":
        return {name: np.zeros((len(motion), 6)) if wrench is None else wrench}
    return _balanced(solution, motion, wrench)


def _balanced(solution: Solution, motion: Motion, wrench: FloatArray | None) -> dict[str, FloatArray]:
    """Balance the power of actuators and wrench with the losses and the rate of change of the energy."""
    speeds = solution.joints.columns(SLIDES).v if solution.speeds is None else solution.speeds
    power = _rows_dot(solution.forces, speeds)
    given = power.copy()
    if wrench is not None:
        given += _rows_dot(wrench[:, WRENCH_ROWS], motion.velocity)
    given -= solution.dissipation
    given -= solution.energy_rate
    return {"power": power, "power_residual": given}


def _rows_dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the products of rows of three, added as NumPy's sum adds them, (N,)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


def forces_table(result: InverseDynamics) -> Table:
    """Return lowest, highest and RMS force of each actuator, with armatures of each nut too."""
    rows = {
        leg: (result.forces[:, k].min(), result.forces[:, k].max(), result.rms_forces[k])
        for k, leg in enumerate(LEGS)
    }
    if result.armature.any():
        nuts = result.nut_forces
        rows |= {
            f"nut {leg}": (nuts[:, k].min(), nuts[:, k].max(), mean)
            for k, (leg, mean) in enumerate(zip(LEGS, result.rms_of(nuts), strict=True))
        }
    header = ("actuator", "lowest [N]", "highest [N]", "RMS [N]")
    return table_of(f"Forces, {result.method}", header, rows)


def evidence_table(*results: InverseDynamics, seconds: Sequence[float] = ()) -> Table:
    """Return closure errors and power residuals."""
    rows = {
        result.method: [
            formatted(result.closure_error[result.valid].max(initial=0.0), ".1e"),
            formatted(np.abs(result.power_residual[result.valid]).max(initial=0.0), ".1e"),
            number(np.abs(result.power).max()),  # NaN in one sample: there is no largest one
        ]
        for result in results
    }
    header = ["method", "closure error [m]", "power residual [W]", "largest power [W]"]
    if seconds:
        header.append("time per sample")
        for result, each in zip(results, seconds, strict=True):
            rows[result.method].append(time_text(each / len(result.time)))
    return table_of("Evidence", header, rows)


def limits_table(result: InverseDynamics, limits: Limits) -> Table:
    """Return how much of each limit the motion uses, and when."""
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            number(one.value),
            number(one.time),
            number(one.limit),
            formatted(one.share, ".1%"),
        )
        for one in result.utilisations(limits)
    }
    return table_of("Utilisation of limits", ("limit of", "peak", "at t [s]", "limit", "utilisation"), rows)


@html_of.register(InverseDynamics)
def inverse_dynamics_html(result: InverseDynamics) -> str:
    """Return how a notebook shows forces over a motion, as HTML."""
    facts = f"by {result.method}, {len(result.time)} samples over {number(result.motion.duration)} s"
    tables = (forces_table(result), evidence_table(result))
    return notebook_html("Inverse dynamics", facts, tables, result.warnings)
