"""Logs of a robot's motors, positions and forces over time: files in and out, and what is wrong with them.

The columns of a file are ``t``, the name of each actuator for its position, and ``force:`` or ``current:``
before the name for its force or current, in any order; a unit in brackets may follow each name, as in
``t [ms],slide_a [mm],force:slide_a [N]``; without one a column is in s, m or rad, N or N m, and A.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import ANGLES, LENGTHS, FloatArray, FrozenArrays, as_floats, name_and_unit, shown
from p3dof._base.errors import InputError, MotionError
from p3dof._base.files import Source, called, read_text, write_table
from p3dof._base.files.archives import READ, damage_told, pyarrow
from p3dof._base.time_series import csv_files
from p3dof._base.time_series.times import set_times

FORCE, CURRENT = "force:", "current:"
"""What stands before an actuator's name in the column of its force, or of its current."""
_FORCES = {
    "N": {"N": (1.0, 1.0), "kN": (1e3, 1.0), "mN": (1.0, 1e3)},
    "N m": {"N m": (1.0, 1.0), "Nm": (1.0, 1.0), "N mm": (1.0, 1e3), "mN m": (1.0, 1e3), "kN m": (1e3, 1.0)},
}
_CURRENTS = {"A": (1.0, 1.0), "mA": (1.0, 1e3)}

FEWEST = 40
"""Samples that a log has at least."""
_HELD = 3
"""So many equal extreme values one after the other are a limit, not a peak."""
_HELD_SHARE = 2e-3
"""Share of the samples at a limit from which it counts."""
_MOST_LEFT_OUT = 0.2
"""Share of the samples that may be left out as saturated or outliers."""
_GAP = 5.0
"""Steps, over the median step, from which there is a gap."""
_WINDOW, _FAR = 5, 8.0
"""Samples to each side, and spreads from their median, of what is no outlier yet (Hampel)."""


class Kind(NamedTuple):
    """What an actuator moves by, and pushes with."""

    position: str  # unit: "m" or "rad"
    force: str  # unit: "N" or "N m"


@dataclass(frozen=True, eq=False, repr=False)
class MotorLog(FrozenArrays):
    """Positions and forces of a robot's actuators over time, as measured.

    Parameters
    ----------
    actuators : tuple of str
        Names of the m actuators.
    time : array-like, shape (N,)
        Strictly rising times [s], in any steps. Times of a clock are counted from the first one.
    positions : array-like, shape (N, m)
        Of the actuators [m or rad].
    forces : array-like, shape (N, m)
        Of the actuators on the robot [N or N m].
    start : float, optional
        The time of a clock at time zero [s].
    source : str
        What to call it in messages.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, or there are too few samples.
    MotionError
        If times do not rise.
    """

    actuators: tuple[str, ...]
    time: FloatArray
    positions: FloatArray
    forces: FloatArray
    start: float = None  # type: ignore[assignment]  # made below
    source: str = "log"

    def __post_init__(self) -> None:
        object.__setattr__(self, "actuators", tuple(self.actuators))
        count = set_times(self)
        for what in ("positions", "forces"):
            values = as_floats(f"{self.source}: {what}", getattr(self, what))
            if values.shape != (count, len(self.actuators)):
                raise InputError(
                    f"{self.source}: {what}: expected shape ({count}, {len(self.actuators)}), got "
                    f"{values.shape}"
                )
            for i, j in np.argwhere(~np.isfinite(values)):
                raise InputError(
                    f"{self.source}: {what} of {self.actuators[j]}: expected finite numbers, got "
                    f"{values[i, j]} at t = {self.time[i]:g} s, sample {i}"
                )
            frozen = np.array(values)
            frozen.setflags(write=False)
            object.__setattr__(self, what, frozen)
        if count < FEWEST:
            raise InputError(
                f"{self.source}: too short: {count} samples, expected at least {FEWEST}; record a "
                "longer motion"
            )

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        names = ", ".join(self.actuators)
        return f"MotorLog({names}; {len(self)} samples, {self.time[0]:g} to {self.time[-1]:g} s)"

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write it to a CSV file that `read_log` reads; the path written.

        Parameters
        ----------
        path : path-like
            The file, ``.csv``.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        header = ["t", *self.actuators, *(FORCE + name for name in self.actuators)]
        return write_table(path, header, (self.time, *self.positions.T, *self.forces.T))


def read_log(
    path: Source,
    actuators: Sequence[str],
    kinds: Sequence[tuple[str, str]],
    constants: Mapping[str, float] | ArrayLike | None = None,
) -> MotorLog:
    """Read a log of motors from CSV or Parquet.

    Parameters
    ----------
    path : path-like or stream
        The file; one whose name ends in ``.parquet`` needs pyarrow.
    actuators : sequence of str
        Names of the m actuators: ``forces.actuators``, `ClosedLoopModel.actuated`.
    kinds : sequence of (str, str)
        Units of position and force of each: ``("m", "N")`` or ``("rad", "N m")``.
    constants : mapping or array-like, shape (m,), optional
        Force per ampere of each actuator [N/A or N m/A], for a file with currents; a sign turns one round.

    Returns
    -------
    MotorLog
        In SI units.

    Raises
    ------
    MotionError
        If the content does not fit; the message names file, line and column.
    InputError
        If constants do not fit, or are missing for currents.
    FileError
        If the file cannot be read.
    """
    source, names = called(path), tuple(actuators)
    each = dict(zip(names, (Kind(*kind) for kind in kinds), strict=True))
    parquet = isinstance(path, str | os.PathLike) and Path(path).suffix.lower() == ".parquet"
    if parquet:
        columns = _of_parquet(Path(path))  # type: ignore[arg-type]  # as the line above says
        given = [name_and_unit(name)[0] for name in columns]
        time, values, start = csv_files.of_columns(columns, source, _form(given, each))
    else:
        text = read_text(path, csv_files.MAX_BYTES)
        given = csv_files.header_of(text, source)
        time, values, start = csv_files.parse(text, source, _form(given, each))
    order = given[1:] if given[:1] == ["t"] else []
    found = {name: values[:, k] for k, name in enumerate(order)}
    currents = [name for name in names if CURRENT + name in found]
    per_ampere = _per_ampere(constants, names, currents, source)
    forces = [
        found[FORCE + name] if FORCE + name in found else found[CURRENT + name] * per_ampere[name]
        for name in names
    ]
    positions = np.stack([found[name] for name in names], axis=-1)
    return MotorLog(names, time, positions, np.stack(forces, axis=-1), start, source)


def _form(given: list[str], each: Mapping[str, Kind]) -> csv_files.Form:
    """Return what a file holds: its own columns in their order where right, else what is expected."""
    wanted = ["t", *each]
    forces = [CURRENT + name if CURRENT + name in given else FORCE + name for name in each]
    wanted += forces
    order = given if sorted(given) == sorted(wanted) and given[:1] == ["t"] else wanted
    units = {name: LENGTHS if kind.position == "m" else ANGLES for name, kind in each.items()}
    units |= {FORCE + name: _FORCES[kind.force] for name, kind in each.items()}
    units |= {CURRENT + name: _CURRENTS for name in each}
    words = "t first; units in square brackets"
    return csv_files.Form("a log of motors", tuple(order), (len(order),), units, words)


def _of_parquet(path: Path) -> dict[str, FloatArray]:
    arrow = pyarrow()
    with damage_told(f"{path}: expected a Parquet file with columns of numbers"):
        table = arrow.parquet.read_table(path, **READ)
        return {
            str(name): np.asarray(table.column(name).to_numpy(), dtype=float) for name in table.column_names
        }


def _per_ampere(
    constants: Mapping[str, float] | ArrayLike | None,
    names: tuple[str, ...],
    currents: Sequence[str],
    source: str,
) -> dict[str, float]:
    """Return the force per ampere of the actuators whose current was measured."""
    if constants is None:
        if currents:
            raise InputError(
                f"{source}: {CURRENT}{currents[0]} is a current: give constants, the force per ampere "
                "of each "
                "actuator [N/A or N m/A]"
            )
        return {}
    if isinstance(constants, Mapping):
        given = {str(name): value for name, value in constants.items()}
    else:
        values = as_floats("constants", constants)
        if values.shape != (len(names),):
            raise InputError(f"constants: expected one number for each of {', '.join(names)}")
        given = dict(zip(names, values.tolist(), strict=True))
    for name in currents:
        value = given.get(name)
        if not isinstance(value, int | float) or not np.isfinite(value) or value == 0:
            raise InputError(f"constants: expected a number that is not zero for {name}, got {shown(value)}")
    if not currents:
        raise InputError(f"constants: {source} has forces, no currents")
    return {name: float(given[name]) for name in currents}


class Usable(NamedTuple):
    """Which samples of a log are usable."""

    kept: NDArray[np.bool_]  # (N, m): forces
    positions: NDArray[np.bool_]  # (N, m)
    pieces: tuple[slice, ...]  # between gaps in time
    remarks: tuple[str, ...]


def usable(log: MotorLog, units: Sequence[Kind]) -> Usable:
    """Return which samples of a log are usable, and what to know about the others.

    Raises
    ------
    InputError
        If a column is constant, or so much is saturated that what is left is no measurement.
    """
    remarks = []
    kept, known = np.ones(log.forces.shape, dtype=bool), np.ones(log.forces.shape, dtype=bool)
    for j, (name, unit) in enumerate(zip(log.actuators, units, strict=True)):
        force = log.forces[:, j]
        if not np.ptp(force) > 0:
            raise InputError(
                f"{log.source}: the force of {name} is constant, {force[0]:g} {unit.force}: is its "
                "sensor connected, "
                "its column the right one?"
            )
        if not np.ptp(log.positions[:, j]) > 0:
            remarks.append(
                f"{name} does not move in {log.source}: its friction and inertia stay those of the design"
            )
        at_limit = _saturated(force)
        if at_limit.any():
            first, last = log.time[np.flatnonzero(at_limit)[[0, -1]]]
            told = (
                f"the force of {name} is saturated: {np.count_nonzero(at_limit)} samples from t = "
                f"{first:.4g} to "
                f"{last:.4g} s lie at the extreme value {force[np.argmax(at_limit)]:.4g} {unit.force}"
            )
            if at_limit.mean() > _MOST_LEFT_OUT:
                raise InputError(f"{log.source}: {told}; record a slower motion, or widen the range")
            remarks.append(f"{told}; they are left out: record a slower motion, or widen the range")
        far = outliers(force) & ~at_limit
        if far.any():
            remarks.append(_outliers_told("force", name, log.time, far))
        kept[:, j] = ~(at_limit | far)
        known[:, j] = ~outliers(log.positions[:, j])
        if not known[:, j].all():
            remarks.append(_outliers_told("position", name, log.time, ~known[:, j]))
    pieces = _pieces(log, remarks)
    return Usable(kept, known, pieces, tuple(remarks))


def _saturated(force: FloatArray) -> NDArray[np.bool_]:
    """Return which samples (N,) are runs at the largest or the smallest value."""
    found = np.zeros(len(force), dtype=bool)
    slack = 1e-9 * np.ptp(force)
    for extreme in (force.max(), force.min()):
        at = np.abs(force - extreme) <= slack
        edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]])))
        runs = edges.reshape(-1, 2)
        long = runs[np.diff(runs, axis=1)[:, 0] >= _HELD]
        # Coarse steps of a sensor repeat at a smooth peak as well: then the values below repeat as often.
        if len(long) and np.diff(long, axis=1).sum() > _HELD_SHARE * len(force) and not _stepped(force, at):
            for first, last in long:
                found[first:last] = True
    return found


def _stepped(force: FloatArray, at: NDArray[np.bool_]) -> bool:
    """Return whether equal neighbours are as common elsewhere as at the extreme: a coarse resolution."""
    equal = force[1:] == force[:-1]
    other = ~(at[1:] | at[:-1])
    return bool(other.any() and equal[other].mean() > 0.3)


def outliers(values: FloatArray) -> NDArray[np.bool_]:
    """Return which of the values (N,) are far from the median of those beside them (Hampel)."""
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(values, _WINDOW, mode="reflect"), 2 * _WINDOW + 1
    )
    middle = np.median(windows, axis=1)
    spread = 1.4826 * np.median(np.abs(windows - middle[:, None]), axis=1)
    floor = np.quantile(spread, 0.9) + 1e-12 * np.abs(values).max()
    found = np.abs(values - middle) > _FAR * np.maximum(spread, floor)
    found[:_WINDOW] = found[-_WINDOW:] = False  # a step there has one side only
    return np.asarray(found)


def _outliers_told(what: str, name: str, time: FloatArray, far: NDArray[np.bool_]) -> str:
    first = float(time[np.argmax(far)])
    count = np.count_nonzero(far)
    many = f"{count} outliers, the first" if count > 1 else "an outlier"
    return (
        f"the {what} of {name} has {many} at t = {first:.4g} s: left out; look at its wiring and its shield"
    )


def _pieces(log: MotorLog, remarks: list[str]) -> tuple[slice, ...]:
    """Return the pieces of a log between gaps in time."""
    steps = np.diff(log.time)
    holes = np.flatnonzero(steps > _GAP * np.median(steps))
    if len(holes):
        worst = holes[np.argmax(steps[holes])]
        many = f"{len(holes)} gaps, the longest" if len(holes) > 1 else "a gap"
        remarks.append(
            f"{log.source} has {many} from t = {log.time[worst]:.4g} to {log.time[worst + 1]:.4g} s "
            f"({steps[worst] / np.median(steps):.0f} steps): the pieces beside it are taken by "
            "themselves; look "
            "for lost messages"
        )
    ends = [0, *(holes + 1).tolist(), len(log)]
    return tuple(slice(a, b) for a, b in pairwise(ends))


def require_actuators(log: MotorLog, actuators: Sequence[str]) -> None:
    """Raise unless a log is of these actuators."""
    if log.actuators != tuple(actuators):
        raise MotionError(
            f"{log.source}: expected the actuators {', '.join(actuators)}, got {', '.join(log.actuators)}"
        )
