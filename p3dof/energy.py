"""Energy, momentum and work over a motion, body by body, and what they mean for the choice of the drives.

    T = Σ ½ m ċ·ċ + ½ ω·I ω     V = -Σ m g·c     p = Σ m ċ     H = Σ c × m ċ + I ω

with the mass centre c of each body from the origin O of the fixed frame: potential energy is zero where it is
at O. Momenta are in the axes of the fixed frame, the angular one about O. All of it comes from the closed
forms of the kinematics and from the bodies, without any force: that the work of the forces makes up for the
change of T + V is evidence for the forces.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof.checks import FloatArray, shown
from p3dof.errors import InputError
from p3dof.kinematics import MechanismMotion, OnInvalid, mechanism_motion
from p3dof.parameters import Bodies, Parameters
from p3dof.routes.results import LEGS, InverseDynamics, write_table

BODIES = tuple(item.name for item in fields(Bodies))
"""The moving bodies, in the order of every result that has one column a body."""

_DEGREE = 5
"""Of the spline through the power that is integrated; lower where there are fewer samples than it takes."""

_ROUNDING = 1e-9
"""Share of the time by which the integral of one may miss it."""

_SAME_MACHINE = 1e-6
"""Share of a leg's length by which sliders of a result may differ from those of the machine."""

_WORKING = (1, 2, 4)
"""What of a wrench works on the platform: F_y, F_z and M_y."""


@dataclass(frozen=True, eq=False)
class DriveLoads:
    """What a motion asks of each actuator, over its valid samples; NaN where there are none.

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
class Energy:
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
        Names of the ten bodies.
    kinetic, potential : ndarray, shape (N, 10)
        Energies of each body [J]; potential energy is zero where the mass centre is at O.
    momentum, angular_momentum : ndarray, shape (N, 3)
        Of all bodies together, the angular one about O, in fixed axes [N s, N m s].
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


def kinetic_energy(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> FloatArray:
    """Return the kinetic energy of each body.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : array-like, shape (..., 3)
        Of (y, z, θ) [m, m, rad] and per second; leading shapes broadcast.
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    ndarray, shape (..., 10)
        In the order of `BODIES` [J].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    return _measured(parameters, _moving(parameters, pose, velocity, on_invalid)).kinetic


def potential_energy(parameters: Parameters, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return the potential energy of each body, zero where its mass centre is at the origin O.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad].
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    ndarray, shape (..., 10)
        In the order of `BODIES` [J].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    return _measured(parameters, _moving(parameters, pose, np.zeros(3), on_invalid)).potential


def momentum(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> tuple[FloatArray, FloatArray]:
    """Return the momentum of all bodies together, and their angular momentum about the origin O.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : array-like, shape (..., 3)
        Of (y, z, θ) [m, m, rad] and per second; leading shapes broadcast.
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    linear, angular : ndarray, shape (..., 3)
        In fixed axes [N s, N m s].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    found = _measured(parameters, _moving(parameters, pose, velocity, on_invalid))
    return found.momentum, found.angular_momentum


def energy_of(parameters: Parameters, result: InverseDynamics) -> Energy:
    """Return energy, momentum and work over a motion whose forces are known.

    Parameters
    ----------
    parameters : Parameters
        The machine that the result belongs to.
    result : InverseDynamics
        The forces of the actuators, by either method.

    Returns
    -------
    Energy

    Raises
    ------
    InputError
        If an argument is something else, or the result is that of a machine of another geometry.
    """
    _check_types(parameters, result)
    pose = np.where(result.valid[:, None], result.motion.pose, np.nan)
    moving = _moving(parameters, pose, result.motion.velocity, "nan")
    _check_machine(parameters, result, moving)
    found = _measured(parameters, moving)
    power = result.forces * result.slider_velocities
    wrench_power = np.sum(result.wrench[:, _WORKING] * result.motion.velocity, axis=-1)
    rates = np.column_stack([power, wrench_power, result.dissipation])
    rates = np.where(result.valid[:, None], rates, np.nan)
    total = np.sum(found.kinetic + found.potential, axis=-1)
    work, balance, given = _integrated(result, rates, total)
    return Energy(
        result.time,
        BODIES,
        found.kinetic,
        found.potential,
        found.momentum,
        found.angular_momentum,
        rates[:, :3],
        work[:, :3],
        rates[:, 3],
        work[:, 3],
        rates[:, 4],
        work[:, 4],
        balance,
        _drive_loads(result, rates[:, :3], work[:, :3], given),
    )


@dataclass(frozen=True, eq=False)
class _Measured:
    kinetic: FloatArray  # (..., 10)
    potential: FloatArray  # (..., 10)
    momentum: FloatArray  # (..., 3)
    angular_momentum: FloatArray  # (..., 3)


def _moving(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid
) -> MechanismMotion:
    if not isinstance(parameters, Parameters):
        raise InputError(f"parameters: expected Parameters, got {shown(parameters)}")
    return mechanism_motion(parameters.geometry, pose, velocity, np.zeros(3), on_invalid)


def _measured(parameters: Parameters, moving: MechanismMotion) -> _Measured:
    shape = moving.sliders.shape[:-1]
    kinetic, potential = np.zeros((*shape, len(BODIES))), np.zeros((*shape, len(BODIES)))
    linear, angular = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    for k, (name, body) in enumerate(parameters.bodies.items()):
        motion = moving.bodies[name]
        c, v, _ = motion.at(body.com)
        omega = np.einsum("...ji,...j->...i", motion.rotation, motion.omega)  # in the axes of the body
        spin = np.einsum("ij,...j->...i", body.inertia, omega)
        kinetic[..., k] = (body.mass * np.sum(v * v, axis=-1) + np.sum(omega * spin, axis=-1)) / 2
        potential[..., k] -= body.mass * np.sum(c * parameters.gravity, axis=-1)
        linear += body.mass * v
        angular += body.mass * np.cross(c, v) + np.einsum("...ij,...j->...i", motion.rotation, spin)
    return _Measured(kinetic, potential, linear, angular)


def _check_types(parameters: Parameters, result: InverseDynamics) -> None:
    if not isinstance(parameters, Parameters):
        raise InputError(f"parameters: expected Parameters, got {shown(parameters)}")
    if not isinstance(result, InverseDynamics):
        raise InputError(f"result: expected InverseDynamics, got {shown(result)}")


def _check_machine(parameters: Parameters, result: InverseDynamics, moving: MechanismMotion) -> None:
    apart = np.abs(result.sliders - moving.sliders)[result.valid]
    if not np.all(apart <= _SAME_MACHINE * parameters.geometry.L):  # NaN: out of reach of this machine
        raise InputError(
            "result: expected one of a machine with these parameters, got sliders where this machine has none"
        )


def _integrated(
    result: InverseDynamics, rates: FloatArray, total: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the integrals (N, 5) of the rates, the balance (N,), and the actuators' positive work (3,)."""
    work, balance = np.full(rates.shape, np.nan), np.full(len(total), np.nan)
    done, given = np.zeros(rates.shape[1]), np.zeros(3)
    for run in _runs(result):
        time = result.time[run]
        curve = _integral(time, rates[run])
        since = curve(time)
        work[run] = done + since
        done = work[run][-1]
        balance[run] = total[run] - total[run.start] - since[:, :4].sum(axis=-1) + since[:, 4]
        for leg in range(3):
            steps = np.diff(curve(_with_turns(time, rates[run, leg]))[:, leg])
            given[leg] += steps[steps > 0].sum()
    return work, balance, given


def _runs(result: InverseDynamics) -> list[slice]:
    """Return the stretches of neighbouring valid samples between which no singularity is crossed."""
    valid = result.valid
    joined = valid[:-1] & valid[1:] & ~np.isin(result.time[:-1], result.crossings)
    starts = np.flatnonzero(valid & np.concatenate([[True], ~joined]))
    ends = np.flatnonzero(valid & np.concatenate([~joined, [True]]))
    return [slice(int(start), int(end) + 1) for start, end in zip(starts, ends, strict=True)]


def _integral(time: FloatArray, rates: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the integral of columns (n, k) from the first time on, as a function of time."""
    if len(time) == 1:
        return lambda t: np.zeros((len(t), rates.shape[1]))
    unit = (time[-1] - time[0]) / (len(time) - 1)  # the mean step keeps the equations well scaled
    local = (time - time[0]) / unit
    known = np.column_stack([rates, np.ones(len(time))])  # the integral of one is the time
    try:
        curve = _antiderivative(local, known, min(_DEGREE, len(time) - 1))
        smooth = abs(curve(local[-1])[-1] - local[-1]) <= _ROUNDING * local[-1]
    except (np.linalg.LinAlgError, ValueError):
        smooth = False
    if not smooth:
        curve = _antiderivative(local, known, 1)
    return lambda t: np.asarray(curve((t - time[0]) / unit)[:, :-1]) * unit


def _antiderivative(time: FloatArray, rates: FloatArray, degree: int) -> Any:
    from scipy.interpolate import make_interp_spline

    # Of few samples, the polynomial through all of them.
    knots = np.repeat(time[[0, -1]], degree + 1) if len(time) == degree + 1 else None
    return make_interp_spline(time, rates, k=degree, t=knots).antiderivative()


def _with_turns(time: FloatArray, power: FloatArray) -> FloatArray:
    """Return the times of the samples and of the zeros of the power between them.

    The zeros are those of straight lines: the work is stationary there, so that it hardly matters where.
    """
    i = np.flatnonzero(np.sign(power[:-1]) * np.sign(power[1:]) < 0)
    share = power[i] / (power[i] - power[i + 1])
    return np.sort(np.concatenate([time, time[i] + share * (time[i + 1] - time[i])]))


def _drive_loads(
    result: InverseDynamics, power: FloatArray, work: FloatArray, given: FloatArray
) -> DriveLoads:
    if not result.valid.any():
        nothing = np.full(3, np.nan)
        return DriveLoads(*(nothing for _ in fields(DriveLoads)))
    valid_power, net = power[result.valid], work[result.valid][-1]
    duration = sum(result.time[run][-1] - result.time[run][0] for run in _runs(result))
    return DriveLoads(
        peak_force=result.peak_forces,
        rms_force=result.rms_forces,
        peak_speed=np.abs(result.slider_velocities[result.valid]).max(axis=0),
        peak_power=np.maximum(valid_power.max(axis=0), 0.0),
        peak_braking=np.maximum(-valid_power.min(axis=0), 0.0),
        mean_power=net / duration if duration > 0 else valid_power.mean(axis=0),
        positive_work=given,
        negative_work=np.minimum(net - given, 0.0),
    )
