"""Exact derivatives of the figures of designs by their columns: forward mode of the formulas.

A peak changes as the force does at its sample; where two samples tie, that is the derivative to one side. The
same holds for least margins, and for power that is only ever given or taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.designs.figures import BITS, Sampled, nearby_of, shares_of
from p3dof.analysis.designs.formula import Outputs, derivatives
from p3dof.analysis.designs.samples import Samples


def gradient_of(
    state: Sampled,
    samples: Samples,
    by_numbers: tuple[Any, ...],
    by_pose: tuple[float, float, float],
    asked: int,
) -> dict[str, FloatArray]:
    """Return how the figures of designs change along a direction.

    Parameters
    ----------
    state : Sampled
        Designs at all samples.
    samples : Samples
        The motion.
    by_numbers : tuple
        How `Folded.numbers` change, each a number or a column (D,).
    by_pose : tuple of float
        How y, z and θ change.
    asked : int
        Which groups of figures, as bits.

    Returns
    -------
    dict of str to ndarray, shape (D,) or (D, 3)
        By the names of `FIGURES`; without times of peaks.
    """
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
