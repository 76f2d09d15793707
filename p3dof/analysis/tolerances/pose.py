"""Static errors of the pose of a machine whose legs are not what they should be: each has its own lengths.

The closures of the legs, with R, r, L of each leg and the offset of its encoder:

- A: λ = z - h + √(L² - w²), w = R - r + y
- B: λ = z - h + √(L² - w²), w = R - r - y
- C: λ = z - h + r sinθ + √(L² - y² - w²), w = R - r cosθ

h is that of the nominal machine: it only says where z counts from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, batch_of, shown
from p3dof._base.errors import InputError
from p3dof._base.quantities import LENGTH
from p3dof._base.tables import POSE_COLUMNS, ShownInNotebook, Tabular, columns_by
from p3dof._base.time_series.wrenches import WrenchOverTime
from p3dof.analysis.designs.columns import OFFSETS, BodiesOfDesigns
from p3dof.analysis.designs.figures import derivatives, sampled, samples_of
from p3dof.analysis.designs.folding import Folded, Folding, folding_of
from p3dof.analysis.designs.results import DesignStatus
from p3dof.analysis.tolerances.directions import (
    Direction,
    amount_of,
    columns_of_directions,
    designs_of,
    require_smaller,
)
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, Geometry, Parameters

ToleranceMethod: TypeAlias = Literal["gradient", "montecarlo"]
"""First order by exact gradients, or sampled machines."""


@dataclass(frozen=True, eq=False, repr=False)
class ForceTolerance(ShownInNotebook, Tabular):
    """How uncertain the forces over a motion are.

    P parameters vary independently of each other. Bounds: of a force at one sample, between which 95 % of all
    machines are; of a peak, below which 95 % are.

    Parameters
    ----------
    method : {"gradient", "montecarlo"}
        First order, or sampled machines.
    names, units : tuple of str
        Of the P parameters.
    nominal, sigma : ndarray, shape (P,)
        Their numbers and standard deviations, in SI units.
    time : ndarray, shape (N,)
        Of the samples [s].
    forces : ndarray, shape (N, 3)
        Of the nominal machine [N].
    deviation : ndarray, shape (N, 3)
        Standard deviations of the forces [N].
    low, high : ndarray, shape (N, 3)
        95 % bounds of the forces [N]: 1.96 standard deviations from their mean.
    worst : ndarray, shape (N, 3)
        Change of the forces in the worst case [N]: all parameters `worst_sigma` standard deviations off, each
        to its bad side, to first order.
    peak : ndarray, shape (4,)
        Largest magnitude of the forces of A, B, C, and of all [N]; of the nominal machine.
    peak_mean, peak_deviation : ndarray, shape (4,)
        Its mean and standard deviation [N].
    peak_high : ndarray, shape (4,)
        Below which it is in 95 % of machines [N].
    peak_worst : ndarray, shape (4,)
        In the worst case [N].
    peak_gradient : ndarray, shape (4, P)
        Derivative of it by the parameters, in SI units.
    shares : ndarray, shape (4, P)
        Share of the variance of the peak that each parameter has, to first order.
    worst_sigma : float
        How many standard deviations the worst case is.
    peaks : ndarray, shape (M, 4), optional
        The peaks of each sampled machine [N]; NaN where it cannot perform the motion.
    drawn : ndarray, shape (M, P), optional
        By how much the parameters of each were off, in SI units.
    """

    method: ToleranceMethod
    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: FloatArray
    sigma: FloatArray
    time: FloatArray
    forces: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    worst: FloatArray
    peak: FloatArray
    peak_mean: FloatArray
    peak_deviation: FloatArray
    peak_high: FloatArray
    peak_worst: FloatArray
    peak_gradient: FloatArray
    shares: FloatArray
    worst_sigma: float
    peaks: FloatArray | None = None
    drawn: FloatArray | None = None

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, nominal forces, deviations and bounds, (N,) each, by name and unit."""
        found = {"t [s]": self.time} | columns_by("f{} [N]", LEGS, self.forces)
        for name in ("deviation", "low", "high", "worst"):
            found |= columns_by(f"{name} {{}} [N]", LEGS, getattr(self, name))
        return found

    def __repr__(self) -> str:
        peak, deviation, high = self.peak[3], self.peak_deviation[3], self.peak_high[3]
        return (
            f"ForceTolerance({self.method}: peak {peak:.5g} N, standard deviation {deviation:.4g} N, "
            f"95 % below {high:.5g} N)"
        )

    @property
    def machines(self) -> int:
        """How many machines were sampled."""
        return 0 if self.peaks is None else len(self.peaks)

    @property
    def impossible(self) -> int:
        """How many of them cannot perform the motion: they are left out of all means and bounds."""
        return 0 if self.peaks is None else int(np.isnan(self.peaks[:, 3]).sum())


@dataclass(frozen=True, eq=False, repr=False)
class PoseTolerance(ShownInNotebook, Tabular):
    """How uncertain static poses are, when the sliders stand where the nominal machine would have them.

    Each leg has its own R, r, L and offset of its encoder: P = 12 parameters, or those of them that vary. The
    closures stay those of this machine: unequal rods of the parallelogram, axes that are not parallel and
    guides that are not vertical are outside of it. They do not make a small error of the pose: the machine is
    overconstrained, and they jam it or strain its parts (see `p3dof.analysis.reactions`, assembly errors).

    Parameters
    ----------
    method : {"gradient", "montecarlo"}
        First order, or sampled machines whose closures are solved.
    names : tuple of str
        Of the P parameters: ``R.a``, ``r.a``, ``L.a``, ``encoder.a`` and so on.
    sigma : ndarray, shape (P,)
        Their standard deviations [m].
    pose : ndarray, shape (..., 3)
        y [m], z [m], θ [rad].
    gradient : ndarray, shape (..., 3, P)
        Derivative of the pose by the parameters [1, rad/m].
    deviation : ndarray, shape (..., 3)
        Standard deviations of y, z, θ [m, m, rad].
    high : ndarray, shape (..., 3)
        Below which the magnitude of the error is in 95 % of machines [m, m, rad].
    covariance : ndarray, shape (..., 3, 3)
        Of the errors of y, z, θ.
    worst : ndarray, shape (..., 3)
        Error in the worst case [m, m, rad]: all parameters `worst_sigma` standard deviations off, each to its
        bad side, to first order.
    shares : ndarray, shape (..., 3, P)
        Share of the variance that each parameter has, to first order.
    worst_sigma : float
        How many standard deviations the worst case is.
    errors : ndarray, shape (M, ..., 3), optional
        The errors of each sampled machine [m, m, rad]; NaN where it does not assemble.
    drawn : ndarray, shape (M, P), optional
        By how much the parameters of each were off [m].
    """

    _row_name = "pose"

    method: ToleranceMethod
    names: tuple[str, ...]
    sigma: FloatArray
    pose: FloatArray
    gradient: FloatArray
    deviation: FloatArray
    high: FloatArray
    covariance: FloatArray
    worst: FloatArray
    shares: FloatArray
    worst_sigma: float
    errors: FloatArray | None = None
    drawn: FloatArray | None = None

    def to_columns(self) -> dict[str, FloatArray]:
        """Return poses and the uncertainty of each coordinate, by name and unit; one pose a row."""
        found = columns_by("{}", POSE_COLUMNS, self.pose)
        for name in ("deviation", "high", "worst"):
            found |= columns_by(f"{name} {{}}", POSE_COLUMNS, getattr(self, name))
        return found

    def __repr__(self) -> str:
        sizes = self.deviation.reshape(-1, 3).max(axis=0)
        return (
            f"PoseTolerance({self.method}: standard deviations up to {1e6 * sizes[0]:.4g} µm in y, "
            f"{1e6 * sizes[1]:.4g} µm in z, {1e3 * sizes[2]:.4g} mrad)"
        )

    @property
    def machines(self) -> int:
        """How many machines were sampled."""
        return 0 if self.errors is None else len(self.errors)

    @property
    def impossible(self) -> int:
        """How many of them do not assemble at some pose: they are left out of all means and bounds."""
        if self.errors is None:
            return 0
        return int(np.isnan(self.errors.reshape(len(self.errors), -1)).any(axis=1).sum())


KINDS = ("R", "r", "L", "encoder")
NAMES = tuple(f"{kind}.{leg}" for leg in "abc" for kind in KINDS)  # the twelve parameters of the pose

_STEPS = 25
_CLOSED = 1e-13  # what a closure may be open in the end [m], for each metre of a leg's length


def sigmas_of(given: Mapping[str, Any], geometry: Geometry) -> tuple[tuple[str, ...], FloatArray]:
    """Return which parameters of the pose vary, and their standard deviations."""
    if not isinstance(given, Mapping) or not given:
        raise InputError("sigma: expected lengths by names of parameters, such as {'L': '50 um'}")
    found: dict[str, float] = {}
    for name in sorted(given, key=lambda name: "." in str(name).removeprefix("geometry.")):  # of one leg last
        plain = str(name).removeprefix("geometry.")
        kind, dot, leg = plain.partition(".")
        if kind not in KINDS or (dot and leg.lower() not in ("a", "b", "c")):
            raise InputError(
                f"sigma: expected R, r, L or encoder, for all legs or one such as L.a, got {shown(name)}; "
                "unequal rods of the parallelogram and tilted guides are outside of this model"
            )
        amount = amount_of(given[name], getattr(geometry, kind, 0.0), LENGTH, f"sigma of {plain}")
        if kind != "encoder":
            require_smaller(amount, getattr(geometry, kind), "m", f"sigma of {plain}")
        found |= {f"{kind}.{each}": amount for each in (leg.lower() or "abc")}
    names = tuple(name for name in NAMES if name in found)
    return names, np.array([found[name] for name in names])


def closures(geometry: Geometry, pose: FloatArray, off: FloatArray) -> FloatArray:
    """Return where the sliders of a machine stand, as its encoders tell it; ndarray, shape (..., 3)."""
    sliders: FloatArray = _closures(geometry, pose, off)[0]
    return sliders


def closure_derivatives(
    geometry: Geometry, pose: FloatArray, off: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how `closures` change with the pose, (..., 3, 3), and with the parameters, (..., 3, 12)."""
    sliders, (y, theta), (w, S, r, L) = _closures(geometry, pose, off)
    by_pose = np.zeros((*sliders.shape, 3))
    by_off = np.zeros((*sliders.shape, len(NAMES)))
    slope = w / S
    sine, cosine = np.sin(theta), np.cos(theta)
    by_pose[..., 0, 0], by_pose[..., 1, 0] = -slope[..., 0], slope[..., 1]
    by_pose[..., 2, 0] = -y / S[..., 2]
    by_pose[..., 1] = 1.0
    by_pose[..., 2, 2] = r[..., 2] * (cosine - sine * slope[..., 2])
    for leg in range(3):
        first = 4 * leg
        by_off[..., leg, first] = -slope[..., leg]
        by_off[..., leg, first + 1] = slope[..., leg]
        by_off[..., leg, first + 2] = L[..., leg] / S[..., leg]
        by_off[..., leg, first + 3] = 1.0
    by_off[..., 2, 9] = sine + cosine * slope[..., 2]
    return by_pose, by_off


def _closures(geometry: Geometry, pose: FloatArray, off: FloatArray) -> tuple[Any, Any, Any]:
    y, z, theta = (pose[..., k] for k in range(3))
    of_legs = off.reshape(*off.shape[:-1], 3, 4)
    R, r, L = geometry.R + of_legs[..., 0], geometry.r + of_legs[..., 1], geometry.L + of_legs[..., 2]
    across = R[..., 2] - r[..., 2] * np.cos(theta)
    ab = R[..., :2] - r[..., :2]
    w = np.stack(np.broadcast_arrays(ab[..., 0] + y, ab[..., 1] - y, across), axis=-1)
    rest = np.stack(np.broadcast_arrays(0 * y, 0 * y, y**2), axis=-1)
    S = np.sqrt(np.where(L**2 - rest - w**2 > 0, L**2 - rest - w**2, np.nan))
    rise = np.stack(np.broadcast_arrays(0 * theta, 0 * theta, r[..., 2] * np.sin(theta)), axis=-1)
    sliders = (z - geometry.h)[..., None] + rise + S + of_legs[..., 3]
    r, L = np.broadcast_to(r, sliders.shape), np.broadcast_to(L, sliders.shape)
    return sliders, (y, theta), (w, S, r, L)


def pose_gradient(geometry: Geometry, pose: FloatArray) -> FloatArray:
    """Return how the pose changes with the parameters, sliders held: (..., 3, 12) [1, rad/m]."""
    by_pose, by_off = closure_derivatives(geometry, pose, np.zeros(len(NAMES)))
    return np.asarray(-np.linalg.solve(by_pose, by_off), dtype=np.float64)


def poses_of(geometry: Geometry, pose: FloatArray, off: FloatArray) -> FloatArray:
    """Return where machines stand whose encoders tell what the nominal one's would at a pose.

    By Newton's method from `pose`; NaN where a machine does not assemble near it.
    """
    asked = closures(geometry, pose, np.zeros(len(NAMES)))
    off = off.reshape(len(off), *(1,) * (pose.ndim - 1), len(NAMES))
    return solved(geometry, asked, off, np.broadcast_to(pose, (len(off), *pose.shape)))


def solved(geometry: Geometry, asked: FloatArray, off: FloatArray, start: FloatArray) -> FloatArray:
    """Return the poses at which encoders tell what is asked; NaN where there is none near the start."""
    found = start.copy()
    gap: FloatArray = np.full(found.shape, np.inf)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            gap = closures(geometry, found, off) - asked
            open_ = np.nan_to_num(np.abs(gap), nan=0.0)
            if (open_ <= _CLOSED * geometry.L).all():
                break
            by_pose = closure_derivatives(geometry, found, off)[0]
            singular = ~np.isfinite(by_pose).all(axis=(-2, -1)) | (np.linalg.det(by_pose) == 0)
            by_pose[singular] = np.eye(3)
            step = np.linalg.solve(by_pose, gap[..., None])[..., 0]
            found -= np.where(singular[..., None], np.nan, step)
    closed = (np.abs(gap) <= 100 * _CLOSED * geometry.L).all(axis=-1, keepdims=True)
    return np.where(closed, found, np.nan)


def checked_pose(geometry: Geometry, pose: Any) -> FloatArray:
    """Return poses that the nominal machine reaches and holds."""
    from p3dof.closed_form.kinematics.validity import holdable
    from p3dof.machine.motion.states import states_of

    poses = batch_of("pose", pose, 3)
    holdable(geometry, states_of(poses))
    return poses


TWO_SIDED, ONE_SIDED = 1.959963984540054, 1.6448536269514722
"""Standard deviations within which 95 % of a normal distribution are, and below which they are."""


@dataclass(frozen=True, eq=False)
class ForceCase:
    """A machine, its motion, and what varies about it."""

    machine: Parameters  # the nominal machine
    motion: Motion  # what it does
    directions: tuple[Direction, ...]  # what varies
    sigma: FloatArray  # (P,): standard deviations, in SI units
    bodies: BodiesOfDesigns = "kept"  # where its bodies come from
    wrench: WrenchOverTime = None  # external load
    worst: float = 3.0  # how many standard deviations the worst case is
    fixed: Mapping[str, float] = field(default_factory=dict)
    """Numbers that are not those of the machine, such as sizes of its solids."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(direction.name for direction in self.directions)


def require_possible(case: ForceCase) -> None:
    """Raise `InputError` unless the nominal machine makes the motion."""
    from p3dof.analysis.designs.evaluation import DesignEvaluation

    nominal = designs_of(
        case.directions, case.machine, case.bodies, np.zeros((1, len(case.sigma))), case.fixed
    )
    found = DesignEvaluation(case.motion, case.wrench, threads=1).evaluate(nominal)
    if found.status[0] != DesignStatus.FEASIBLE:
        raise InputError(f"robot: the nominal machine cannot perform the motion: {found.reason(0)}")


def force_gradients(case: ForceCase) -> tuple[FloatArray, FloatArray]:
    """Return the nominal forces (N, 3) [N], and their derivatives by the parameters (P, N, 3), in SI."""
    columns = columns_of_directions(
        case.directions, case.machine, case.bodies, np.zeros((1, len(case.sigma))), case.fixed
    )
    samples = samples_of(case.motion, case.wrench)
    folding = folding_of(tuple(columns), case.machine, case.bodies)
    offsets = np.array([[float(columns[name][0]) if name in columns else 0.0 for name in OFFSETS]])
    state = sampled(folding.fold(columns), samples, offsets)
    by_column = partial(_along, folding, columns)
    gradients = []
    for direction in case.directions:
        rates = [rate if np.ndim(rate) == 0 else rate[:, None] for rate in by_column(direction)]
        moved = [direction.rates.get(name, 0.0) for name in OFFSETS]
        found = derivatives(state.numbers, state.inputs, rates, moved).forces
        gradients.append(np.stack([np.broadcast_to(force, (1, len(samples)))[0] for force in found], axis=-1))
    return np.stack([force[0] for force in state.found.forces], axis=-1), np.array(gradients)


def _along(folding: Folding, columns: dict[str, FloatArray], direction: Direction) -> tuple[FloatArray, ...]:
    """Return how the numbers of the dynamics change along a direction."""
    total: list[FloatArray] = []
    for column, rate in direction.rates.items():
        moved = [rate * np.asarray(number, dtype=float) for number in folding.tangents(columns, column)]
        total = [a + b for a, b in zip(total, moved, strict=True)] if total else moved
    return Folded(tuple(total)).numbers


def first_order(case: ForceCase) -> ForceTolerance:
    """Return the tolerance of forces to first order."""
    forces, gradients = force_gradients(case)
    spread = gradients * case.sigma[:, None, None]
    deviation = np.sqrt((spread**2).sum(axis=0))
    worst = case.worst * np.abs(spread).sum(axis=0)
    peak, by_peak = _peaks(forces, gradients)
    parts = (by_peak * case.sigma) ** 2
    variance = parts.sum(axis=1)
    peak_deviation = np.sqrt(variance)
    grown = (np.abs(forces) + worst).max(axis=0)
    return ForceTolerance(
        "gradient",
        case.names,
        tuple(direction.unit for direction in case.directions),
        np.array([direction.nominal for direction in case.directions]),
        case.sigma,
        np.asarray(case.motion.time),
        forces,
        deviation,
        forces - TWO_SIDED * deviation,
        forces + TWO_SIDED * deviation,
        worst,
        peak,
        peak,
        peak_deviation,
        peak + ONE_SIDED * peak_deviation,
        np.append(grown, grown.max()),
        by_peak,
        parts / np.where(variance > 0, variance, 1.0)[:, None],
        case.worst,
    )


def _peaks(forces: FloatArray, gradients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return peaks of A, B, C and of all (4,), and their derivatives (4, P)."""
    at = np.abs(forces).argmax(axis=0)
    each = forces[at, range(3)]
    by_each = (gradients[:, at, range(3)] * np.sign(each)).T  # (3, P)
    largest = int(np.abs(each).argmax())
    return np.append(np.abs(each), np.abs(each[largest])), np.vstack([by_each, by_each[largest]])
