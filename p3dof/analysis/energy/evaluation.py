"""Energy, momentum and work over a motion whose forces are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, shown
from p3dof._base.errors import InputError
from p3dof._base.samples import OnInvalid
from p3dof._base.tables import (
    NONE,
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
from p3dof._base.time_series.smoothing import unbroken
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form.kinematics import MechanismMotion, mechanism_motion
from p3dof.machine.parameters import LEGS, LINKS, Parameters
from p3dof.methods import InverseDynamics


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
class Energy(ShownInNotebook, Tabular):
    """Energy, momentum and work over a motion; rows of invalid samples are NaN.

    Work is integrated by a spline of degree 5 through the power at the samples, over runs of neighbouring
    valid samples (of a lower degree for fewer than 6; by trapezoids if their steps are too uneven for a
    spline), each of which ends at steps a thousand times shorter than those beside them, where powers jump.
    What is done between two runs, across invalid samples or an actuation singularity, is unknown:
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

    def to_columns(self) -> dict[str, FloatArray]:
        """Return every quantity, (N,) each, by name and unit."""
        found = {"t [s]": self.time, "kinetic [J]": self.kinetic_total, "potential [J]": self.potential_total}
        found |= {"total [J]": self.total}
        found |= columns_by("power {} [W]", LEGS, self.power) | columns_by("work {} [J]", LEGS, self.work)
        found |= {"wrench power [W]": self.wrench_power, "wrench work [J]": self.wrench_work}
        found |= {"dissipated power [W]": self.dissipated_power, "dissipated work [J]": self.dissipated_work}
        found |= {"balance [J]": self.balance}
        found |= columns_by("momentum {} [N s]", "xyz", self.momentum)
        found |= columns_by("angular momentum {} [N m s]", "xyz", self.angular_momentum)
        found |= columns_by("kinetic {} [J]", self.bodies, self.kinetic)
        found |= columns_by("potential {} [J]", self.bodies, self.potential)
        return found


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
    shares = energy.kinetic[most] / (total or 1.0)
    rows = {
        name: (energy.kinetic[:, k].max(), formatted(shares[k], ".1%"))
        for k, name in enumerate(energy.bodies)
    }
    header.append(f"share at t = {number(energy.time[most])} s")
    return table_of("Kinetic energy", header, rows, f"All bodies at most {number(total)} J.")


def balance_table(energy: Energy) -> Table:
    """Return the evidence: the work done on the mechanism against the change of its energy."""
    error = np.abs(energy.balance[energy.valid]).max(initial=0.0)
    done = energy.work_done[-1] if energy.valid.all() else np.nan
    rows = {"over the motion": (done, formatted(error, ".1e") if energy.valid.any() else NONE, energy.scale)}
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


@dataclass(frozen=True, eq=False)
class Quantities:
    """What the states of motion of a batch amount to; rows of NaN where they are invalid."""

    sliders: FloatArray  # (..., 3): slider positions A, B, C [m]
    kinetic: FloatArray  # (..., 10): energies of each of `bodies_of` the machine [J]
    potential: FloatArray
    momentum: FloatArray
    """(..., 3): of all bodies together, the angular one about O, in fixed axes [N s, N m s]."""
    angular_momentum: FloatArray


ACTUATORS = (
    "actuator_a",
    "actuator_b",
    "actuator_c",
)  # names of energies of motors, screws and counterbalances


def bodies_of(parameters: Parameters) -> tuple[str, ...]:
    """Return what has energy: the ten bodies, and the three actuators where there are any."""
    return (*LINKS, *ACTUATORS) if parameters.actuators else LINKS


def quantities(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid
) -> Quantities:
    """Return energies and momenta at states of motion."""
    if not isinstance(parameters, Parameters):
        raise InputError(f"parameters: expected Parameters, got {shown(parameters)}")
    moving = mechanism_motion(parameters.geometry, pose, velocity, np.zeros(3), on_invalid)
    shape = moving.sliders.shape[:-1]
    kinetic, potential = np.zeros((*shape, len(LINKS))), np.zeros((*shape, len(LINKS)))
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
    if parameters.actuators:
        own, stored = _of_actuators(parameters, moving)
        kinetic = np.concatenate([kinetic, own], axis=-1)
        potential = np.concatenate([potential, stored], axis=-1)
    return Quantities(moving.sliders, kinetic, potential, linear, angular)


def _of_actuators(parameters: Parameters, moving: MechanismMotion) -> tuple[FloatArray, FloatArray]:
    """Return kinetic and potential energy of motors, screws and counterbalances, the latter zero at home."""
    actuators, position = parameters.actuators, moving.sliders
    home = actuators.balance_at_home(parameters.gravity)
    kinetic: FloatArray = actuators.inertia * moving.slider_velocities**2 / 2
    return kinetic, position * (actuators.stiffness * position / 2 - home)


def kinetic_energy(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> FloatArray:
    """Return the kinetic energy of each body, and of the actuators where the machine has any.

    In the order of `bodies_of` the machine [J].
    """
    return quantities(parameters, pose, velocity, on_invalid).kinetic


def potential_energy(parameters: Parameters, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return the potential energy of each body, zero where its mass centre is at the origin O.

    That of the actuators, where the machine has any, is stored in their balances, and zero at home.

    In the order of `bodies_of` the machine [J].
    """
    return quantities(parameters, pose, np.zeros(3), on_invalid).potential


def momentum(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> tuple[FloatArray, FloatArray]:
    """Return the momentum of all bodies together, and their angular momentum about the origin O.

    Motors, screws and counterweights, whose axes and places are not known, are left out.

    In fixed axes [N s, N m s].
    """
    found = quantities(parameters, pose, velocity, on_invalid)
    return found.momentum, found.angular_momentum


_DEGREE = 5  # of the spline through the power that is integrated; lower where there are too few samples


def work_over(
    result: InverseDynamics, rates: FloatArray, total: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the work of all powers over a motion, and how it balances the energy."""
    work, balance = np.full(rates.shape, np.nan), np.full(len(total), np.nan)
    done, given = np.zeros(rates.shape[1]), np.zeros(3)
    for run in runs(result):
        time = result.time[run]
        curve = integral(time, rates[run])
        since = curve(time)
        work[run] = done + since
        done = work[run][-1]
        balance[run] = total[run] - total[run.start] - since[:, :4].sum(axis=-1) + since[:, 4]
        given += _given(time, rates[run, :3], curve)
    return work, balance, given


def work_given(time: FloatArray, power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the work of actuators over a motion, all samples of which are valid; ndarray, shape (3,)."""
    curve = integral(time, power)
    return curve(time[-1:])[0], _given(time, power, curve)


def _given(time: FloatArray, power: FloatArray, curve: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return the work that each of some powers gives, from their integral."""
    given = np.zeros(power.shape[1])
    for leg in range(power.shape[1]):
        steps = np.diff(curve(_with_turns(time, power[:, leg]))[:, leg])
        given[leg] = steps[steps > 0].sum()
    return given


def runs(result: InverseDynamics) -> list[slice]:
    """Return the stretches of neighbouring valid samples; none reaches across a singularity.

    Of its samples.
    """
    valid = result.valid
    joined = valid[:-1] & valid[1:]
    starts = np.flatnonzero(valid & np.concatenate([[True], ~joined]))
    ends = np.flatnonzero(valid & np.concatenate([~joined, [True]]))
    return [slice(int(start), int(end) + 1) for start, end in zip(starts, ends, strict=True)]


def integral(time: FloatArray, rates: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the integral of powers from the first time on; from times (m,) to integrals (m, k)."""
    parts = unbroken(time)
    curves = [_integral(time[part], rates[part]) for part in parts]
    starts = time[[part.start for part in parts]]
    whole = [curve(time[[part.stop - 1]])[0] for curve, part in zip(curves, parts, strict=True)]
    before = np.cumsum([np.zeros(rates.shape[1]), *whole[:-1]], axis=0)

    def since(times: FloatArray) -> FloatArray:
        at = np.clip(np.searchsorted(starts, times, "right") - 1, 0, None)
        found = before[at]
        for part in np.unique(at):
            found[at == part] += curves[part](times[at == part])
        return found

    return since if len(parts) > 1 else curves[0]


def _integral(time: FloatArray, rates: FloatArray) -> Callable[[FloatArray], FloatArray]:
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


def work_weights(time: FloatArray) -> FloatArray:
    """Return what the powers at the samples contribute to the work over all: weights of `integral` [s]."""
    found = np.zeros(len(time))
    for part in unbroken(time):
        found[part] += _work_weights(time[part])
    return found


def _work_weights(time: FloatArray) -> FloatArray:
    count = len(time)
    if count == 1:
        return np.zeros(1)
    unit = (time[-1] - time[0]) / (count - 1)
    local = (time - time[0]) / unit
    weights = _spline_weights(local, min(_DEGREE, count - 1))
    if not abs(weights.sum() - local[-1]) <= _ROUNDING * local[-1]:
        weights = _spline_weights(local, 1)
    return np.asarray(weights * unit)


def _spline_weights(time: FloatArray, degree: int) -> FloatArray:
    """Return the integrals of the splines that are one at a sample and zero at all others."""
    from scipy.interpolate import BSpline, make_interp_spline
    from scipy.sparse.linalg import spsolve

    knots = np.repeat(time[[0, -1]], degree + 1) if len(time) == degree + 1 else None
    try:
        knots = make_interp_spline(time, np.ones(len(time)), k=degree, t=knots).t
        table = BSpline.design_matrix(time, knots, degree)
        whole = (knots[degree + 1 :] - knots[: -degree - 1]) / (degree + 1)  # integrals of the B-splines
        return np.asarray(spsolve(table.T.tocsc(), whole))
    except (np.linalg.LinAlgError, ValueError):
        return np.full(len(time), np.nan)


def step_weights(time: FloatArray, points: int) -> FloatArray:
    """Return how the work of a power grows between samples, by the polynomial through those around.

    Coefficients: the work until the share s of step i is the sum over m of s**(m + 1) times row m on the
    powers [s].
    """
    steps = np.diff(time)
    nearby = first_points(len(time), points)[:, None] + np.arange(points)
    places = (time[nearby] - time[:-1, None]) / steps[:, None]
    powers = np.linalg.inv(places[:, :, None] ** np.arange(points))
    weights: FloatArray = steps[:, None, None] * powers / np.arange(1, points + 1)[:, None]
    return weights


def first_points(count: int, points: int) -> NDArray[np.int_]:
    """Return the first of the samples that integrate the step after each of `count` samples but the last."""
    return np.clip(np.arange(count - 1) - (points // 2 - 1), 0, count - points)


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


_SAME_MACHINE = 1e-6  # share of a leg's length by which sliders may differ from those of the machine

_BLOCK = 10_000  # samples whose energies are held at a time

_ROUNDING = 1e-9  # share of the whole energy below which nothing moves


def energy_of(parameters: Parameters, result: InverseDynamics) -> Energy:
    """Return energy, momentum and work over a motion whose forces are known."""
    if not isinstance(result, InverseDynamics):
        raise InputError(f"result: expected InverseDynamics, got {shown(result)}")
    pose = np.where(result.valid[:, None], result.motion.pose, np.nan)
    found = quantities(parameters, pose, result.motion.velocity, "nan")
    _check_machine(parameters, result, found.sliders)
    rates = _rates(result)
    total = np.sum(found.kinetic + found.potential, axis=-1)
    work, balance, given = work_over(result, rates, total)
    return Energy(
        time=result.time,
        bodies=bodies_of(parameters),
        kinetic=found.kinetic,
        potential=found.potential,
        momentum=found.momentum,
        angular_momentum=found.angular_momentum,
        power=rates[:, :3],
        work=work[:, :3],
        wrench_power=rates[:, 3],
        wrench_work=work[:, 3],
        dissipated_power=rates[:, 4],
        dissipated_work=work[:, 4],
        balance=balance,
        drives=_drive_loads(result, rates[:, :3], work[:, :3], given),
    )


def imbalance(parameters: Parameters, result: InverseDynamics) -> tuple[float, float]:
    """Return how far the work over a motion misses the change of the energy, and what that is small to."""
    pose, velocity = result.motion.pose, result.motion.velocity
    energies = np.concatenate(
        [
            [found.kinetic.sum(axis=-1), found.potential.sum(axis=-1)]
            for start in range(0, len(pose), _BLOCK)
            for found in [quantities(parameters, pose[start:][:_BLOCK], velocity[start:][:_BLOCK], "nan")]
        ],
        axis=1,
    )
    total = energies.sum(axis=0)
    _, balance, _ = work_over(result, _rates(result), total)
    missed = float(np.abs(balance).max())
    rounding = _ROUNDING * float(np.abs(total).max())
    scale = float(max(energies[0].max(), np.ptp(total)))
    return (missed if missed > rounding else 0.0), scale


def _check_machine(parameters: Parameters, result: InverseDynamics, sliders: FloatArray) -> None:
    apart = np.abs(result.sliders - sliders)[result.valid]
    if not np.all(apart <= _SAME_MACHINE * parameters.geometry.L):  # NaN: out of reach of this machine
        raise InputError(
            "result: expected one of a machine with these parameters, got sliders where this machine has none"
        )


def _rates(result: InverseDynamics) -> FloatArray:
    """Return the powers of the actuators and of the wrench, and what friction takes, (N, 5) [W]."""
    power = result.forces * result.slider_velocities
    wrench_power = np.sum(result.wrench[:, WRENCH_ROWS] * result.motion.velocity, axis=-1)
    rates = np.column_stack([power, wrench_power, result.dissipation])
    return np.where(result.valid[:, None], rates, np.nan)


def _drive_loads(
    result: InverseDynamics, power: FloatArray, work: FloatArray, given: FloatArray
) -> DriveLoads:
    if not result.possible:
        nothing = np.full(3, np.nan)
        return DriveLoads(*(nothing for _ in fields(DriveLoads)))
    net, duration = work[-1], result.motion.duration
    return DriveLoads(
        peak_force=result.peak_forces,
        rms_force=result.rms_forces,
        peak_speed=np.abs(result.slider_velocities).max(axis=0),
        peak_power=np.maximum(power.max(axis=0), 0.0),
        peak_braking=np.maximum(-power.min(axis=0), 0.0),
        mean_power=net / duration if duration > 0 else power.mean(axis=0),
        positive_work=given,
        negative_work=np.minimum(net - given, 0.0),
    )
