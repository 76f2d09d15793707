"""The figures of designs over a motion: what there is, where it is in a row, how NumPy computes it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.samples import ACTUATION_TOLERANCE
from p3dof.analysis.designs.folding import Folded
from p3dof.analysis.designs.formula import INPUTS, Outputs, outputs
from p3dof.analysis.designs.samples import Samples
from p3dof.analysis.designs.status import DesignStatus
from p3dof.closed_form.kinematics.validity import reach_margins, reached

FigureGroup: TypeAlias = Literal["singularity", "sliders", "power"]
"""What can be asked for beside the forces and the reach."""

BITS: dict[str, int] = {"singularity": 1, "sliders": 2, "power": 4}
"""As the compiled loop takes them; powers need the sliders."""


class Figure(NamedTuple):
    """A figure of a design.

    Parameters
    ----------
    unit : str
        Its SI unit.
    place : int
        Where it begins in a row of results.
    width : int
        1, or 3 for one of each actuator.
    bit : int
        Of `BITS`; 0 if it is always there.
    """

    unit: str
    place: int
    width: int
    bit: int = 0


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
    """Return groups of figures as bits.

    Parameters
    ----------
    groups : iterable of str
        Keys of `BITS`.

    Returns
    -------
    int

    Raises
    ------
    InputError
        If there is no such group.
    """
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
    """Designs at all samples.

    Parameters
    ----------
    numbers : list
        Each a number or an array (D, 1), as `Folded.numbers`.
    inputs : list
        Of the samples, each a number or an array that broadcasts to (D, N).
    pose : ndarray, shape (D, N, 3)
        With the offsets of the designs.
    found : Outputs
        Forces and what goes with them, (D, N).
    """

    numbers: list[Any]
    inputs: list[Any]
    pose: FloatArray
    found: Outputs

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
    """Return designs at all samples of a motion.

    Parameters
    ----------
    folded : Folded
        The numbers of D designs.
    samples : Samples
        The motion.
    offsets : ndarray, shape (D, 3)
        Of the pose.

    Returns
    -------
    Sampled
    """
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
    """Return the figures of designs, NaN for those that cannot make the motion.

    Parameters
    ----------
    state : Sampled
        Designs at all samples.
    samples : Samples
        The motion.
    asked : int
        Which groups of figures, as bits.

    Returns
    -------
    ndarray, shape (D, 34)
        The first number is a `DesignStatus`, the second the sample that it belongs to.
    """
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
    """Work from each sample to the next, and to where the power turns on the way.

    Parameters
    ----------
    steps : ndarray, shape (..., N - 1)
        The work of whole steps [J].
    first : ndarray, shape (..., N - 1)
        Up to where the power turns; the whole step where it does not.
    """

    steps: FloatArray
    first: FloatArray

    @property
    def positive(self) -> FloatArray:
        """What is given in all (...)."""
        given: FloatArray = (np.maximum(self.first, 0) + np.maximum(self.steps - self.first, 0)).sum(axis=-1)
        return given


def given(power: FloatArray, samples: Samples) -> FloatArray:
    """Return the work that powers give, without what they take back.

    Parameters
    ----------
    power : ndarray, shape (..., N)
        [W]
    samples : Samples
        The motion.

    Returns
    -------
    ndarray, shape (...)
        [J]
    """
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
