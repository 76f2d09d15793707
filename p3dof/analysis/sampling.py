"""Do the samples of a motion tell its peaks and its work? How many it takes, and what to say if not.

What counts are the numbers that a drive is sized by, `loads_at`. They are taken again from more samples:
those of the curve where the motion has one; else those of two interpolations between the samples, by the
velocities and by the accelerations, of which the nearer one counts (rounded numbers disturb the former,
accelerations that jump both, so that steps in which they do are left out).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.time_series.smoothing import between_samples, breaks, subdivided
from p3dof.analysis.energy import imbalance, work_given
from p3dof.closed_form.compiled import MachineKernels
from p3dof.closed_form.kinematics import singularity
from p3dof.machine.motion import Motion, WrenchHistory, WrenchOverTime, states_over
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import LEGS, Parameters
from p3dof.methods import InverseDynamics
from p3dof.methods.compiled import CompiledMethod
from p3dof.methods.solution import crossing_told, crossings_of

COARSE = 1e-3
"""Share by which a number may change with more samples, and the work may miss the energy, without a word."""

SETTLED = 0.3 * COARSE  # share by which twice as many samples may change a number for them to suffice

FEWEST, MANY, MOST = 200, 4_000, 20_000
"""Steps that `refined` begins with, that are enough for any smooth curve, and that it never goes beyond."""

_PARTS = 4  # into how many parts all steps are divided: more would follow the noise of poses

_JUMP = 8.0  # how many times larger than near steps a change of the acceleration is that counts as a jump

_SMALL, _TINY = 1e-2, 1e-9
"""Shares of the largest number of its kind below which one is held to that only, and absolutely [SI]."""

_ENDS = ("lowest force", "highest force")  # numbers that are held to the larger one of the two

_TOLD = 3  # numbers that a warning names: those that are furthest off

_UNITS = {"force": "N", "speed": "m/s", "power": "W", "work": "J"}

Loads = Mapping[str, FloatArray]
"""Numbers that a drive is sized by, each for A, B, C; the last word of its name is the kind."""


def refined(parameters: Parameters, motion: Motion, wrench: WrenchOverTime) -> Motion:
    """Return a motion with as many samples as peaks and work need; as it is where it cannot be performed."""
    require_motion(motion)
    steps = len(motion) - 1
    if not 0 < steps <= MOST:
        return motion
    load, kernels = _load(motion, wrench), MachineKernels(parameters)
    parts = 1
    while parts * steps < FEWEST:
        parts *= 2
    now = motion.divided(parts)
    known = loads_at(kernels, now, load)
    while known is not None:
        finer = motion.divided(2 * parts)
        more = loads_at(kernels, _with_load_rows(finer, load), load)
        if more is None or not _changes(known, [more], SETTLED):
            break
        peaked = _with_load_rows(now, load)
        if peaked is not now and not _changes(loads_at(kernels, peaked, load) or known, [more], SETTLED):
            return peaked  # the load alone had peaks between the samples
        if 2 * parts * steps > min(MOST, max(MANY, _PARTS * steps)):
            return peaked  # not enough, but what the load does is seen
        now, known, parts = finer, loads_at(kernels, finer, load), 2 * parts
    return now


_LONG, _SLOW = 60.0, 0.01
"""A motion longer than this [s] and slower than this share of the sliders' limit may have its times in ms."""


def warnings_about(
    parameters: Parameters, result: InverseDynamics, wrench: WrenchOverTime = None
) -> tuple[str, ...]:
    """Return what a reader of forces should know, one sentence each; see `InverseDynamics.warnings`."""
    count, invalid = len(result.time), int((~result.valid).sum())
    found = [crossing_told(time) for time in result.crossings]
    if invalid:
        found.append(
            f"{invalid} of {count} samples are invalid and left NaN: forces there are unknown, "
            "so that no peak is reported"
        )
    found += remarks_on(parameters, result, wrench)
    found += [f"limit exceeded: {exceedance}" for exceedance in result.exceedances(parameters.limits)]
    return tuple(found)


def remarks_on(
    parameters: Parameters, result: InverseDynamics, wrench: WrenchOverTime = None
) -> tuple[str, ...]:
    """Return what there is to know about poses from a file, and about samples that are too few."""
    motion = result.motion
    found = list(motion.remarks())
    if not result.possible or len(motion) < 2:
        return tuple(found)
    fastest = float(np.abs(motion.velocity).max())
    if motion.duration > _LONG and 0 < fastest < _SLOW * parameters.limits.speed:
        found.append(
            f"the motion takes {motion.duration:g} s, at {fastest:.2g} m/s at most (ms? write t [ms])"
        )
    load = _load(motion, wrench if isinstance(wrench, WrenchHistory) else result.wrench)
    doubts = _between(MachineKernels(parameters), motion, load)
    missed, scale = imbalance(parameters, result)
    if missed > COARSE * scale:
        doubts.append(f"work and energy differ by {missed:.3g} J, where {scale:.4g} J move")
    if doubts:
        found.append(f"the motion is undersampled: {'; '.join(doubts)}")
    return tuple(found)


def loads_at(kernels: MachineKernels, motion: Motion, load: WrenchHistory) -> Loads | None:
    """Return the numbers that a drive is sized by; mapping of str to ndarray, shape (3,), or None."""
    pose, velocity, time = motion.pose, motion.velocity, motion.time
    actuation = singularity(kernels.parameters.geometry, pose).actuation
    states, dynamics = states_over(motion, load(time), "nan"), CompiledMethod(kernels)
    forces = dynamics.forces(states)
    if not np.isfinite(forces).all() or len(crossings_of(actuation)[0]):
        return None
    speeds = np.einsum("nij,nj->ni", dynamics.jacobian(states), velocity)
    power = forces * speeds
    net, given = work_given(time, power)
    mean_square = np.trapezoid(forces**2, time, axis=0) / motion.duration
    return {
        "lowest force": forces.min(axis=0),
        "highest force": forces.max(axis=0),
        "RMS force": np.sqrt(mean_square),
        "peak speed": np.abs(speeds).max(axis=0),
        "peak power": np.maximum(power.max(axis=0), 0.0),
        "peak braking power": np.maximum(-power.min(axis=0), 0.0),
        "positive work": given,
        "negative work": np.minimum(net - given, 0.0),
    }


def _load(motion: Motion, wrench: WrenchOverTime) -> WrenchHistory:
    """Return a load as a function of time: linear between the samples where it is given at these."""
    if isinstance(wrench, WrenchHistory):
        return wrench.since(motion.start)
    known = states_over(motion, wrench).wrench
    return WrenchHistory(motion.time, np.zeros((len(motion), 6)) if known is None else known, motion.start)


def _with_load_rows(motion: Motion, load: WrenchHistory) -> Motion:
    """Add the times at which a load is known: it may peak between the samples."""
    inside = load.time[(load.time > motion.time[0]) & (load.time < motion.time[-1])]
    missing = np.setdiff1d(inside, motion.time)
    if not 0 < len(missing) <= MOST:
        return motion
    return motion.resampled(np.union1d(motion.time, missing))


def _between(kernels: MachineKernels, motion: Motion, load: WrenchHistory) -> list[str]:
    """Return what is larger between the samples than at them."""
    known = loads_at(kernels, motion, load)
    if known is None:
        return []
    parts = max(2, -(-2 * FEWEST // (len(motion) - 1)))
    if motion.curve is not None:
        finer = [_with_load_rows(motion.divided(parts), load)]
    else:
        finer = _interpolated(motion, parts)
    more = [loads_at(kernels, one, load) for one in finer]
    if any(one is None for one in more):
        return ["between them, the motion leaves the range of the machine"]
    return _changes(known, [one for one in more if one is not None], COARSE)


def _changes(known: Loads, more: list[Loads], share: float) -> list[str]:
    """Return which numbers change by more than a share in every one of some better computations."""
    worst: dict[str, tuple[float, str]] = {}
    for name, values in known.items():
        kind = name.rsplit(" ", maxsplit=1)[-1]
        scale = np.max([np.abs(other) for key, other in known.items() if key.endswith(kind)], axis=0)
        floor = np.maximum(_SMALL * np.maximum(scale, _SMALL * scale.max()), _TINY)
        better = np.array([one[name] for one in more])  # (K, 3)
        size_of = np.abs(better)
        if name in _ENDS:  # the range of the same actuator's force, of which the larger end sizes a drive
            size_of = np.max([np.abs([one[end] for one in more]) for end in _ENDS], axis=0)
        change = np.abs(better - values) / np.maximum(size_of, floor)
        nearest = np.argmin(change, axis=0)
        for leg in range(3):
            size = float(change[nearest[leg], leg])
            if size > share and size > worst.get(kind, (0.0, ""))[0]:
                value = better[nearest[leg], leg]
                worst[kind] = (
                    size,
                    f"{name} of {LEGS[leg]} is {value:.4g} {_UNITS[kind]} between them, "
                    f"{values[leg]:.4g} {_UNITS[kind]} at them",
                )
    return [words for _, words in sorted(worst.values(), reverse=True)[:_TOLD]]


def _interpolated(motion: Motion, parts: int) -> list[Motion]:
    """Return a motion with more samples, by two interpolations; none where the acceleration jumps."""
    whole = _jumps(motion.acceleration) | breaks(motion.time)
    time = np.append(subdivided(motion.time, np.where(whole, 1, parts)), motion.time[-1])
    pose, velocity, *accelerations = between_samples(
        motion.time, motion.pose, motion.velocity, motion.acceleration, time
    )
    return [Motion(time, pose, velocity, one, check=False, start=motion.start) for one in accelerations]


def _jumps(acceleration: FloatArray) -> NDArray[np.bool_]:
    """Return between which samples an acceleration (N, 3) jumps, shape (N - 1,)."""
    change = np.abs(np.diff(acceleration, axis=0))
    padded = np.pad(change, ((2, 2), (0, 0)), constant_values=np.inf)
    before = np.minimum(padded[:-4], padded[1:-3])
    after = np.minimum(padded[3:-1], padded[4:])
    large = change > COARSE * np.abs(acceleration).max(axis=0)
    return np.asarray(np.any(large & (change > _JUMP * np.maximum(before, after)), axis=1))
