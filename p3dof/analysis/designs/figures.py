"""The figures of designs over a motion: what there is, where it is in a row, how NumPy computes it.

The forces of any design at any sample as one traced formula on arrays, with its exact derivatives.

The same reduced formulas as the kernels, with friction and with what powers and margins need beside the
forces.

Exact derivatives of the figures of designs by their columns: forward mode of the formulas.

A peak changes as the force does at its sample; where two samples tie, that is the derivative to one side. The
same holds for least margins, and for power that is only ever given or taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.algebra import Vector, subtract
from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.samples import ACTUATION_TOLERANCE
from p3dof._base.time_series.wrenches import WRENCH_ROWS, Load, WrenchOverTime
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.printing import function_of
from p3dof._base.tracing.tape import tangent
from p3dof.analysis.designs.folding import Folded
from p3dof.analysis.designs.results import DesignStatus
from p3dof.analysis.energy.evaluation import first_points, step_weights, work_weights
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import ACCELERATION, MODEL, POSE, VELOCITY, WRENCH
from p3dof.closed_form.compiled.reduced import Model, State
from p3dof.closed_form.compiled.reduced.dynamics import generalized_friction
from p3dof.closed_form.kinematics.validity import reach_margins, reached
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion

INPUTS = (*POSE, *VELOCITY, *ACCELERATION, *WRENCH)


class Outputs(NamedTuple):
    """What a formula returns, or its derivative; arrays over designs and samples (D, N)."""

    forces: Sequence[FloatArray]  # of A, B, C [N, m, m/s]
    sliders: Sequence[FloatArray]
    speeds: Sequence[FloatArray]
    sine: FloatArray  # of the angle from the actuation singularity


def outputs(numbers: Sequence[Any], inputs: Sequence[Any], namespace: Any = np) -> Outputs:
    """Return forces and what goes with them."""
    return _grouped(_values(len(numbers), namespace)(*numbers, *inputs))


def derivatives(
    numbers: Sequence[Any], inputs: Sequence[Any], by_numbers: Sequence[Any], by_pose: Sequence[Any]
) -> Outputs:
    """Return how they change along a direction."""
    rates = (*by_numbers, *by_pose)
    moving = tuple(i for i, rate in enumerate(rates) if np.any(rate))  # the rest costs nothing
    return _grouped(_tangents(len(numbers), moving)(*numbers, *inputs, *(rates[i] for i in moving)))


def _grouped(found: Sequence[Any]) -> Outputs:
    return Outputs(found[:3], found[3:6], found[6:9], found[9])


class _Trace(NamedTuple):
    tape: Tape
    numbers: tuple[Symbol, ...]
    inputs: tuple[Symbol, ...]
    results: tuple[Number, ...]


def _trace(count: int) -> _Trace:
    tape = Tape()
    numbers = tape.symbols((f"n{i}" for i in range(count)), constant=True)
    model = Model.of_numbers(numbers[: len(MODEL)])
    inputs = tape.symbols(INPUTS)
    rows = dict(zip(INPUTS, inputs, strict=True))
    state = State(*(rows[name] for name in State._fields))
    x = reduced.shape(model, state.y, state.theta, tape)
    wrench: Vector = (rows[WRENCH[0]], rows[WRENCH[1]], rows[WRENCH[2]])
    friction = numbers[len(MODEL) :]
    if friction:
        half = len(friction) // 2
        coefficients = friction[:half], friction[half:-1], friction[-1]
        velocity = (rows["vy"], rows["vz"], rows["vtheta"])
        wrench = subtract(wrench, generalized_friction(x, state.y, velocity, coefficients, tape))
    forces = reduced.actuator_forces(model, x, state, tape, wrench)
    sliders = reduced.sliders(model, x, rows["z"], tape)
    speeds = (
        rows["vz"] - x.ta * state.vy,
        rows["vz"] + x.tb * state.vy,
        rows["vz"] - x.ty * state.vy + x.arm * state.vtheta,
    )
    sine = (x.arm * x.Sc) / (model.r * tape.sqrt(x.u2))
    return _Trace(tape, numbers, inputs, (*forces, *sliders, *speeds, sine))


@lru_cache(maxsize=32)
def _values(count: int, namespace: Any) -> Callable[..., tuple[Any, ...]]:
    trace = _trace(count)
    return function_of(trace.tape, (*trace.numbers, *trace.inputs), trace.results, namespace)


@lru_cache(maxsize=128)
def _tangents(count: int, which: tuple[int, ...]) -> Callable[..., tuple[Any, ...]]:
    trace = _trace(count)
    tape, movable = trace.tape, (*trace.numbers, *trace.inputs[:3])
    seeds = {movable[i].index: tape.symbol(f"d{i}") for i in which}
    moved = tangent(trace.results, dict(seeds))
    return function_of(tape, (*trace.numbers, *trace.inputs, *seeds.values()), moved, np)


LANES = 8  # samples are padded to a multiple of this with the last one, whose weights are zero

_POINTS = 6  # samples of the polynomials that integrate powers between two of them

_UNEVEN = 10.0  # sum of the sizes of these weights, by the step, above which trapezoids serve instead

MOST_SAMPLES = 100_000  # the longest motion that designs are computed over


@dataclass(frozen=True, eq=False)
class Samples:
    """A motion, and the external load on the platform, as the loops over designs take them."""

    time: FloatArray  # (N,): [s]
    rows: FloatArray
    """(9, N): y, z, θ, their velocities and accelerations; F_y, F_z and M_y of the wrench if there is one."""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def pose(self) -> FloatArray:
        """Poses (N, 3)."""
        return self.rows[:3].T

    @cached_property
    def mean(self) -> FloatArray:
        """Weights of the mean over time, by trapezoids as `InverseDynamics.rms_forces` (N,)."""
        if len(self) < 2:
            return np.ones(1)
        steps = np.diff(self.time)
        sums = (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / 2
        mean: FloatArray = sums / (self.time[-1] - self.time[0])
        return mean

    @cached_property
    def work(self) -> FloatArray:
        """Weights of the work of powers, as `Energy.work` (N,) [s]."""
        return work_weights(self.time)

    @cached_property
    def points(self) -> int:
        """How many samples make the polynomials that tell work given from work taken back."""
        if len(self) < 2:
            return 1
        points = min(_POINTS, len(self))
        sizes = np.abs(step_weights(self.time, points).sum(axis=1)).sum(axis=1)
        smooth = np.all(sizes <= _UNEVEN * np.diff(self.time))
        return points if smooth else 2

    @cached_property
    def partial(self) -> FloatArray:
        """Coefficients of the work over a part of a step (N - 1, points, points) [s]."""
        return step_weights(self.time, self.points) if len(self) > 1 else np.zeros((0, 1, 1))

    @cached_property
    def first(self) -> NDArray[np.int_]:
        """The first of the samples that these are for (N - 1,)."""
        return first_points(len(self), self.points)

    def packed(self) -> FloatArray:
        """Return all of it in a row, as the compiled loop takes it; see `DesignLoop`."""
        count, points = len(self), self.points
        padded = -(-count // LANES) * LANES
        steps = np.zeros((points, padded))
        steps[:, : count - 1] = self.partial.sum(axis=1).T
        partial = np.zeros((count, points, points))
        partial[: count - 1] = self.partial
        y, z, theta, *moving = self.rows
        load = [np.zeros(count)] * (12 - len(self.rows))
        rows = np.stack([y, z, np.sin(theta), np.cos(theta), *moving, *load, theta])
        edge = np.pad(rows, ((0, 0), (0, padded - count)), "edge")
        weights = np.pad(np.stack([self.mean, self.work]), ((0, 0), (0, padded - count)))
        return np.concatenate([edge.ravel(), weights.ravel(), steps.ravel(), partial.ravel()])


def samples_of(motion: Motion, wrench: WrenchOverTime = None) -> Samples:
    """Return a motion and a load as samples."""
    require_motion(motion)
    if len(motion) > MOST_SAMPLES:
        raise InputError(f"motion: expected at most {MOST_SAMPLES} samples for designs, got {len(motion)}")
    rows = [*motion.pose.T, *motion.velocity.T, *motion.acceleration.T]
    if wrench is not None:
        load = Load(wrench, motion.start).over(motion.time)
        if not np.isfinite(load).all():
            raise InputError("wrench: expected finite numbers")
        rows += [load[:, row] for row in WRENCH_ROWS]
    return Samples(np.asarray(motion.time), np.ascontiguousarray(rows))


FigureGroup: TypeAlias = Literal["singularity", "sliders", "power"]
"""What can be asked for beside the forces and the reach."""

BITS: dict[str, int] = {"singularity": 1, "sliders": 2, "power": 4}
"""As the compiled loop takes them; powers need the sliders."""


class Figure(NamedTuple):
    """A figure of a design."""

    unit: str  # its SI unit
    place: int  # where it begins in a row of results
    width: int  # 1, or 3 for one of each actuator
    bit: int = 0  # of `BITS`; 0 if it is always there


FIGURES: dict[str, Figure] = {
    "reach": Figure("m", 2, 1),
    "actuation": Figure("rad", 3, 1, 1),
    "peak_force": Figure("N", 4, 3),
    "peak_time": Figure("s", 7, 3),
    "rms_force": Figure("N", 10, 3),
    "lowest_slider": Figure("m", 13, 3, 2),
    "highest_slider": Figure("m", 16, 3, 2),
    "peak_speed": Figure("m/s", 19, 3, 2),
    "peak_power": Figure("W", 22, 3, 4),
    "peak_braking": Figure("W", 25, 3, 4),
    "work": Figure("J", 28, 3, 4),
    "positive_work": Figure("J", 31, 3, 4),
}
STATUS, SAMPLE, WIDTH = 0, 1, 34
"""Where a row has its status and the sample that it belongs to, and how long it is."""


def asked_for(groups: Iterable[str]) -> int:
    """Return groups of figures as bits."""
    asked = 0
    for group in (groups,) if isinstance(groups, str) else groups:
        if group not in BITS:
            raise InputError(f"figures: expected some of {', '.join(BITS)}, got {shown(group)}")
        asked |= BITS[group]
    return asked | BITS["sliders"] if asked & BITS["power"] else asked


def asked_figures(asked: int) -> dict[str, Figure]:
    """Return the figures that some bits ask for, by name."""
    return {name: figure for name, figure in FIGURES.items() if not figure.bit or figure.bit & asked}


class Sampled(NamedTuple):
    """Designs at all samples."""

    numbers: list[Any]  # each a number or an array (D, 1), as `Folded.numbers`
    inputs: list[Any]  # of the samples, each a number or an array that broadcasts to (D, N)
    pose: FloatArray  # (D, N, 3): with the offsets of the designs
    found: Outputs  # forces and what goes with them, (D, N)

    @property
    def powers(self) -> list[FloatArray]:
        """Powers of the actuators on the mechanism (D, N) [W]."""
        return [force * speed for force, speed in zip(self.found.forces, self.found.speeds, strict=True)]

    @property
    def reach(self) -> FloatArray:
        """Reach margins of the legs (D, N, 3) [m]."""
        r, R, L = (np.reshape(number, (-1, 1)) for number in self.numbers[:3])
        return np.asarray(reach_margins(SimpleNamespace(r=r, R=R, L=L[..., None]), self.pose))  # type: ignore[arg-type]  # columns of lengths

    @property
    def angle(self) -> FloatArray:
        """Angles from the actuation singularity (D, N) [rad]."""
        return np.arcsin(np.clip(self.found.sine, -1, 1))


def sampled(folded: Folded, samples: Samples, offsets: FloatArray) -> Sampled:
    """Return designs at all samples of a motion."""
    numbers = [n[:, None] if isinstance(n, np.ndarray) and n.ndim else n for n in folded.numbers]
    pose = samples.pose + offsets[:, None, :]
    rows = list(samples.rows) + [0.0] * (len(INPUTS) - len(samples.rows))
    inputs = [pose[..., 0], pose[..., 1], pose[..., 2], *rows[3:]]
    with np.errstate(all="ignore"):
        found = outputs(numbers, inputs)
    shape = pose.shape[:2]
    whole = [np.broadcast_to(values, shape) for group in found[:3] for values in group]
    return Sampled(
        numbers, inputs, pose, Outputs(whole[:3], whole[3:6], whole[6:], np.broadcast_to(found.sine, shape))
    )


def rows_of(state: Sampled, samples: Samples, asked: int) -> FloatArray:
    """Return the figures of designs, NaN for those that cannot perform the motion; ndarray, shape (D, 34)."""
    designs = len(state.pose)
    rows = np.full((designs, WIDTH), np.nan)
    with np.errstate(all="ignore"):
        forces = np.stack(np.broadcast_arrays(*state.found.forces), axis=1)  # (D, 3, N)
        rows[:, STATUS], rows[:, SAMPLE] = _status(state, forces)
        rows[:, 2] = state.reach.min(axis=(1, 2))
        if asked & BITS["singularity"]:
            rows[:, 3] = state.angle.min(axis=1)
        sizes = np.abs(forces)
        rows[:, 4:7], rows[:, 7:10] = sizes.max(axis=-1), sizes.argmax(axis=-1)
        rows[:, 10:13] = (forces**2) @ samples.mean
        if asked & (BITS["sliders"] | BITS["power"]):
            sliders, speeds = (np.stack(group, axis=1) for group in (state.found.sliders, state.found.speeds))
            rows[:, 13:16], rows[:, 16:19] = sliders.min(axis=-1), sliders.max(axis=-1)
            rows[:, 19:22] = np.abs(speeds).max(axis=-1)
        if asked & BITS["power"]:
            power = np.stack(state.powers, axis=1)
            rows[:, 22:25] = np.maximum(power.max(axis=-1), 0.0)
            rows[:, 25:28] = np.maximum(-power.min(axis=-1), 0.0)
            rows[:, 28:31] = power @ samples.work
            rows[:, 31:34] = given(power, samples)
    rows[rows[:, STATUS] != DesignStatus.FEASIBLE, 4:] = np.nan
    return rows


def _status(state: Sampled, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the status of designs, and the sample that it belongs to."""
    length = np.reshape(state.numbers[2], (-1, 1, 1))
    inside = reached(SimpleNamespace(L=length), state.reach)  # type: ignore[arg-type]  # columns of lengths
    singular = np.abs(state.angle) < ACTUATION_TOLERANCE
    strange = ~np.isfinite(forces).all(axis=1)
    status, sample = np.zeros(len(forces)), np.full(len(forces), np.nan)
    reasons: tuple[tuple[DesignStatus, Any], ...] = (
        (DesignStatus.NOT_FINITE, strange),
        (DesignStatus.SINGULAR, singular),
        (DesignStatus.OUT_OF_REACH, ~inside),
    )
    for reason, bad in reasons:
        some = bad.any(axis=1)
        status[some], sample[some] = reason, bad.argmax(axis=1)[some]
    return status, sample


class Given(NamedTuple):
    """Work from each sample to the next, and to where the power turns on the way."""

    steps: FloatArray  # (..., N - 1): the work of whole steps [J]
    first: FloatArray  # (..., N - 1): up to where the power turns; the whole step where it does not

    @property
    def positive(self) -> FloatArray:
        """What is given in all (...)."""
        given: FloatArray = (np.maximum(self.first, 0) + np.maximum(self.steps - self.first, 0)).sum(axis=-1)
        return given


def given(power: FloatArray, samples: Samples) -> FloatArray:
    """Return the work that powers give, without what they take back [J]."""
    if len(samples) < 2:
        return np.zeros(power.shape[:-1])
    nearby = nearby_of(power, samples)
    steps = np.einsum("...nk,nmk->...n", nearby, samples.partial)
    turns, share = shares_of(power)
    parts = share[..., None] ** np.arange(1, samples.points + 1)
    first = np.einsum("...nm,nmk,...nk->...n", parts, samples.partial, nearby, optimize=True)
    return Given(steps, np.where(turns, first, steps)).positive


def nearby_of(values: FloatArray, samples: Samples) -> FloatArray:
    """Return the values at the samples that integrate each step, (..., N - 1, points)."""
    return values[..., samples.first[:, None] + np.arange(samples.points)]


def shares_of(power: FloatArray) -> tuple[Any, FloatArray]:
    """Return in which steps a power changes its sign, and after what share of them, as straight lines do."""
    before, after = power[..., :-1], power[..., 1:]
    turns = before * after < 0
    return turns, np.where(turns, before / np.where(turns, before - after, 1.0), 0.0)


def blocks_of(count: int, samples: int, most: int = 16_384) -> Sequence[slice]:
    """Return designs in blocks whose arrays over samples stay small."""
    size = max(1, most // samples)
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def gradient_of(
    state: Sampled,
    samples: Samples,
    by_numbers: tuple[Any, ...],
    by_pose: tuple[float, float, float],
    asked: int,
) -> dict[str, FloatArray]:
    """Return how figures change along a direction, by the names of `FIGURES`; without times of peaks."""
    rates = [rate[:, None] if isinstance(rate, np.ndarray) and rate.ndim else rate for rate in by_numbers]
    with np.errstate(all="ignore"):
        moved = derivatives(state.numbers, state.inputs, rates, by_pose)
        shape = state.pose.shape[:2]
        forces = _stack(state.found.forces, shape)
        d_forces = _stack(moved.forces, shape)
        rms = np.sqrt((forces**2) @ samples.mean)
        found = {
            "reach": _reach(state, rates, by_pose),
            "peak_force": _at(d_forces * np.sign(forces), np.abs(forces).argmax(axis=-1)),
            "rms_force": (forces * d_forces) @ samples.mean / rms,
        }
        if asked & BITS["singularity"]:
            least = state.angle.argmin(axis=-1)
            sine = np.broadcast_to(moved.sine, shape)
            found["actuation"] = _at(sine, least) / np.cos(_at(state.angle, least))
        if asked & BITS["sliders"]:
            found |= _sliders(state, moved, shape)
        if asked & BITS["power"]:
            speeds, d_speeds = _stack(state.found.speeds, shape), _stack(moved.speeds, shape)
            found |= _powers(forces * speeds, d_forces * speeds + forces * d_speeds, samples)
    return found


def _stack(values: Any, shape: tuple[int, ...]) -> FloatArray:
    return np.stack([np.broadcast_to(value, shape) for value in values], axis=1)


def _at(values: FloatArray, index: Any) -> FloatArray:
    return np.take_along_axis(values, index[..., None], axis=-1)[..., 0]


def _reach(state: Sampled, rates: list[Any], by_pose: tuple[float, float, float]) -> FloatArray:
    """Return how the least reach margin changes: that of one leg at one sample."""
    margins = state.reach
    least = margins.reshape(len(margins), -1).argmin(axis=1)
    sample, leg = least // 3, least % 3
    y, _, theta = (state.pose[np.arange(len(margins)), sample, k] for k in range(3))
    r, R = (np.broadcast_to(np.ravel(number), len(margins)) for number in state.numbers[:2])
    d_r, d_R, d_L = (np.broadcast_to(np.ravel(rate), len(margins)) for rate in rates[:3])
    side = np.where(leg == 0, 1.0, -1.0)
    across = R - r * np.cos(theta)
    d_across = d_R - d_r * np.cos(theta) + r * np.sin(theta) * by_pose[2]
    of_c = (y * by_pose[0] + across * d_across) / np.hypot(y, across)
    return np.asarray(d_L - np.where(leg == 2, of_c, d_R - d_r + side * by_pose[0]))


def _sliders(state: Sampled, moved: Outputs, shape: tuple[int, ...]) -> dict[str, FloatArray]:
    sliders, d_sliders = _stack(state.found.sliders, shape), _stack(moved.sliders, shape)
    speeds, d_speeds = _stack(state.found.speeds, shape), _stack(moved.speeds, shape)
    return {
        "lowest_slider": _at(d_sliders, sliders.argmin(axis=-1)),
        "highest_slider": _at(d_sliders, sliders.argmax(axis=-1)),
        "peak_speed": _at(d_speeds * np.sign(speeds), np.abs(speeds).argmax(axis=-1)),
    }


def _powers(power: FloatArray, d_power: FloatArray, samples: Samples) -> dict[str, FloatArray]:
    most, least = power.argmax(axis=-1), power.argmin(axis=-1)
    return {
        "peak_power": np.where(_at(power, most) > 0, _at(d_power, most), 0.0),
        "peak_braking": np.where(_at(power, least) < 0, -_at(d_power, least), 0.0),
        "work": d_power @ samples.work,
        "positive_work": _given(power, d_power, samples),
    }


def _given(power: FloatArray, d_power: FloatArray, samples: Samples) -> FloatArray:
    """Return how the work that is given changes: what is positive of each part of each step."""
    if len(samples) < 2:
        return np.zeros(power.shape[:-1])
    nearby, d_nearby = nearby_of(power, samples), nearby_of(d_power, samples)
    steps, d_steps = (np.einsum("...nk,nmk->...n", v, samples.partial) for v in (nearby, d_nearby))
    turns, share = shares_of(power)
    before, after = power[..., :-1], power[..., 1:]
    d_before, d_after = d_power[..., :-1], d_power[..., 1:]
    gap = np.where(turns, before - after, 1.0)
    d_share = np.where(turns, (before * d_after - after * d_before) / gap**2, 0.0)
    order = np.arange(1, samples.points + 1)
    parts, d_parts = share[..., None] ** order, order * share[..., None] ** (order - 1) * d_share[..., None]
    path = "...nm,nmk,...nk->...n"
    first = np.einsum(path, parts, samples.partial, nearby, optimize=True)
    d_first = np.einsum(path, parts, samples.partial, d_nearby, optimize=True)
    d_first = d_first + np.einsum(path, d_parts, samples.partial, nearby, optimize=True)
    first, d_first = np.where(turns, first, steps), np.where(turns, d_first, d_steps)
    second, d_second = steps - first, d_steps - d_first
    given: FloatArray = (np.where(first > 0, d_first, 0.0) + np.where(second > 0, d_second, 0.0)).sum(axis=-1)
    return given
