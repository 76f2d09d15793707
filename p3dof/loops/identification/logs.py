"""Logs of a robot's motors, positions and forces over time: files in and out, and what is wrong with them.

The columns of a file are ``t``, the name of each actuator for its position, and ``force:`` or ``current:``
before the name for its force or current, in any order; a unit in brackets may follow each name, as in
``t [ms],slide_a [mm],force:slide_a [N]``; without one a column is in s, m or rad, N or N m, and A.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import (
    ANGLES,
    FORCES,
    LENGTHS,
    MOMENTS,
    FloatArray,
    FrozenArrays,
    as_floats,
    name_and_unit,
    shown,
)
from p3dof._base.errors import InputError, MotionError, P3dofError
from p3dof._base.files import Source, called, read_text, write_table
from p3dof._base.files.archives import READ, damage_told, pyarrow
from p3dof._base.time_series import csv_files
from p3dof._base.time_series.times import set_times
from p3dof.loops.identification.forces import IdentifiableForces, Rows, States

FORCE, CURRENT = "force:", "current:"
"""What stands before an actuator's name in the column of its force, or of its current."""
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
_WINDOW, _OUTLYING = 5, 8.0
"""Samples to each side, and spreads from their median, of what is no outlier yet (Hampel)."""


_LINE = re.compile(r"^[ \t]*[^#\s].*$", re.MULTILINE)
_HOLE = re.compile(r"^(?=.*,)(?:[^#\n]*,)?[ \t]*(?:nan)?[ \t]*(?:,.*)?\r?$", re.MULTILINE | re.IGNORECASE)
"""A line with numbers, and one with a field that has none."""


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
    left_out : int
        How many samples of the file had no number somewhere.

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
    left_out: int = 0

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
        In SI units, without samples that have no number somewhere (empty or NaN).

    Raises
    ------
    MotionError
        If the content does not fit; the message names file, line and column. If more than a fifth of the
        samples have no number somewhere.
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
        holes = np.any([np.isnan(column) for column in columns.values()], axis=0)
        left_out = _few(int(np.count_nonzero(holes)), np.size(holes), source)
        columns = {name: column[~holes] for name, column in columns.items()} if left_out else columns
        given = [name_and_unit(name)[0] for name in columns]
        time, values, start = csv_files.of_columns(columns, source, _form(given, each))
    else:
        text = read_text(path, csv_files.MAX_BYTES)
        given = csv_files.header_of(text, source)
        text, left_out = _without_holes(text, source)
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
    return MotorLog(names, time, positions, np.stack(forces, axis=-1), start, source, left_out)


def _without_holes(text: str, source: str) -> tuple[str, int]:
    """Make comments of lines that have an empty field or NaN: the numbers of other lines stay."""
    header = _LINE.search(text)
    start = header.end() if header else len(text)
    rest, holes = _HOLE.subn("#", text[start:])
    return text[:start] + rest, _few(holes, len(_LINE.findall(text, start)) if holes else 0, source)


def _few(holes: int, count: int, source: str) -> int:
    """Return how many samples have no number somewhere, if they are few."""
    if holes > _MOST_LEFT_OUT * count:
        raise MotionError(
            f"{source}: {holes} of {count} samples have no number in a column (empty or NaN): expected at "
            f"most {_MOST_LEFT_OUT:.0%}"
        )
    return holes


def _form(given: list[str], each: Mapping[str, Kind]) -> csv_files.Form:
    """Return what a file holds: its own columns in their order where right, else what is expected."""
    wanted = ["t", *each]
    forces = [CURRENT + name if CURRENT + name in given else FORCE + name for name in each]
    wanted += forces
    order = given if sorted(given) == sorted(wanted) and given[:1] == ["t"] else wanted
    units = {name: LENGTHS if kind.position == "m" else ANGLES for name, kind in each.items()}
    units |= {FORCE + name: (FORCES if kind.force == "N" else MOMENTS) for name, kind in each.items()}
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
                "of each actuator [N/A or N m/A]"
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
    """Return which samples of a log are usable, and what to know about the others."""
    remarks = []
    if log.left_out:
        remarks.append(
            f"{log.left_out} samples of {log.source} have no number in a column (empty or NaN): left out"
        )
    kept, known = np.ones(log.forces.shape, dtype=bool), np.ones(log.forces.shape, dtype=bool)
    for j, (name, unit) in enumerate(zip(log.actuators, units, strict=True)):
        force = log.forces[:, j]
        if not np.ptp(force) > 0:
            raise InputError(
                f"{log.source}: the force of {name} is constant, {force[0]:g} {unit.force}: is its "
                "sensor connected, its column the right one?"
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
    found = np.abs(values - middle) > _OUTLYING * np.maximum(spread, floor)
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
            "themselves; look for lost messages"
        )
    ends = [0, *(holes + 1).tolist(), len(log)]
    return tuple(slice(a, b) for a, b in pairwise(ends))


def require_actuators(log: MotorLog, actuators: Sequence[str]) -> None:
    """Raise unless a log is of these actuators."""
    if log.actuators != tuple(actuators):
        raise MotionError(
            f"{log.source}: expected the actuators {', '.join(actuators)}, got {', '.join(log.actuators)}"
        )


_BAD = 0.3
"""Share of the forces that the model leaves, from which something may be wrong with the columns."""
_BETTER = 0.5
"""By what another reading of the columns is better at least."""
_NOISE, _SENSOR_OFFSET = 0.1, 0.1
"""Of forces, for these comparisons: shares of their variation."""
_SURE = 0.05
"""Share that another reading leaves, below which no further one is tried."""
_SCALE = 100.0
"""Ratio of measured forces to the design's from which their unit is asked about."""
_NOT_NEGATIVE = ("damping", "friction", "armature")
_ROUNDS = 3
_SAMPLES = 150
_TURN, _ANGLE = np.pi / 180, 3 * np.pi

Motion = tuple[FloatArray, FloatArray, FloatArray]


class Reading(NamedTuple):
    """Another reading of the columns."""

    words: str
    of: Callable[[FloatArray], FloatArray]  # columns (N, m) as they would be then


def readings(names: tuple[str, ...], what: str, kinds: tuple[str, ...]) -> Iterator[Reading]:
    """Yield what may have happened to columns (N, m): exchanged, turned round, in other units."""

    def exchanged(i: int, j: int) -> Callable[[FloatArray], FloatArray]:
        order = list(range(len(names)))
        order[i], order[j] = j, i
        return lambda x: x[:, order]

    def times(factors: FloatArray) -> Callable[[FloatArray], FloatArray]:
        return lambda x: x * factors

    each = np.eye(len(names))
    for i, name in enumerate(names):
        yield Reading(f"the {what} of {name} has the other sign", times(1 - 2 * each[i]))
    if len(names) > 1:
        yield Reading(f"all {what}s have the other sign", times(np.full(len(names), -1.0)))
    for i, j in combinations(range(len(names)), 2):
        yield Reading(f"the {what}s of {names[i]} and {names[j]} are exchanged", exchanged(i, j))
    scales = [(1e-3, "1000 times too large (mm or N mm?)"), (1e3, "1000 times too small (kN?)")]
    if "rad" in kinds:
        scales = [(_TURN, "in degrees"), (1 / _TURN, "in rad where they were given as degrees")]
    for factor, words in scales:
        yield Reading(f"all {what}s are {words}", times(np.full(len(names), factor)))
        if len(names) > 1:
            for i, name in enumerate(names):
                yield Reading(f"the {what} of {name} is {words}", times(1 + (factor - 1) * each[i]))


def left_over(forces: IdentifiableForces, rows: Rows, prior: FloatArray, measured: FloatArray) -> float:
    """Return how badly the model explains forces, as a share of their variation.

    All parameters are free within the prior, which counts too; friction and rotors are not negative.
    """
    size, m = np.maximum(measured.std(axis=0), 1e-300), measured.shape[1]
    shift = np.broadcast_to(np.diag(_SENSOR_OFFSET * size), (len(measured), m, m))
    own = np.concatenate([rows.columns * prior, shift], axis=-1) / (_NOISE * size[:, None])
    A = own.reshape(-1, own.shape[-1])
    r = ((measured - rows.columns @ forces.design - rows.known) / (_NOISE * size)).ravel()
    least = np.full(A.shape[1], -np.inf)
    for k, name in enumerate(forces.names):
        if prior[k] > 0 and name.rpartition(".")[2] in _NOT_NEGATIVE:
            least[k] = -forces.design[k] / prior[k]
    z, free = np.zeros(A.shape[1]), np.append(prior > 0, np.ones(m, dtype=bool))
    for _ in range(_ROUNDS):
        F = A[:, free]
        z[free] = np.linalg.solve(F.T @ F + np.eye(F.shape[1]), F.T @ (r - A[:, ~free] @ z[~free]))
        below = z < least
        if not below.any():
            break
        z[below], free = least[below], free & ~below
    left = r - A @ z
    return _NOISE * float(np.sqrt((left @ left + z @ z) / len(r)))


def wrong_columns(
    forces: IdentifiableForces, motion: Motion, measured: FloatArray, prior: FloatArray, failed: str = ""
) -> str:
    """Return in words what explains measured forces (N, m) far better than these columns, or nothing."""
    some = np.unique(np.linspace(0, len(measured) - 1, min(len(measured), _SAMPLES)).astype(int))
    x, v, a = (part[some] for part in motion)
    y = measured[some]
    now = np.inf
    if not failed:
        rows = forces.rows(forces.from_actuators(x, v, a))
        now = left_over(forces, rows, prior, y)
        own = (rows.columns @ forces.design + rows.known).std(axis=0)
        alike = (own > y.std(axis=0) / _SCALE).any() and (own < y.std(axis=0) * _SCALE).any()
        if now < _BAD and alike:
            return ""
        found = [
            (left_over(forces, rows, prior, one.of(y)), one.words)
            for one in readings(forces.actuators, "force", forces.force_units)
        ]
        if min(found)[0] < _SURE:
            return _told(*min(found), now)
    else:
        found = []
    for one in readings(forces.actuators, "position", forces.position_units):
        if beyond_a_turn(forces, one.of(x)):
            continue
        try:  # at one sample first: what cannot be takes long
            forces.from_actuators(*(one.of(part[len(y) // 2 :][:1]) for part in (x, v, a)))
            rows = forces.rows(forces.from_actuators(*(one.of(part) for part in (x, v, a))))
        except (P3dofError, np.linalg.LinAlgError, ValueError, FloatingPointError):
            continue
        if np.isfinite(rows.columns).all():
            found.append((left_over(forces, rows, prior, y), one.words))
    best = min(found, default=(np.inf, ""))
    return _told(*best, now) if best[0] < _BETTER * min(now, 1.0) else ""


def beyond_a_turn(forces: IdentifiableForces, positions: FloatArray) -> bool:
    """Return whether angles (N, m) are beyond a turn and a half: in another unit, it seems."""
    angles = np.array([unit == "rad" for unit in forces.position_units])
    return bool((np.abs(positions[:, angles]) > _ANGLE).any())


def _told(share: float, words: str, now: float) -> str:
    before = "the robot cannot be there" if now == np.inf else f"the model leaves {now:.0%} of the forces"
    return f"it seems that {words}: as they are, {before}; then it leaves {share:.0%}. Correct the columns"


def beyond_limits(forces: IdentifiableForces, states: States, time: FloatArray) -> list[str]:
    """Return a line for each limit that the motion exceeds."""
    if states.whole is None:
        return []
    excess, found = forces.excess(states), []
    for k, name in enumerate(forces.limits):
        over = excess[:, k]
        if name.startswith("force of") or not over.max(initial=-1.0) > 0:
            continue  # of the design: measured ones are what they are
        at = int(np.argmax(over))
        found.append(
            f"the {name} exceeds the design's limit by {over[at]:.2g} of its size at t = {time[at]:.4g} s: "
            "look at the zero of its encoder, or correct the limit"
        )
    return found


def excitation_told(rows: Rows, prior: FloatArray, noise: FloatArray) -> list[str]:
    """Return lines if the motion shows little: few combinations of parameters, or of few samples."""
    found, m = [], len(noise)
    A = rows.columns * prior / noise[:, None]

    def combinations_in(matrix: FloatArray) -> int:
        flat = matrix.reshape(-1, matrix.shape[-1])
        return int((np.linalg.eigvalsh(flat.T @ flat) > 1).sum())

    seen, moving, samples = combinations_in(A), combinations_in(A - A.mean(axis=0)), A.shape[0] * m
    if moving <= m:
        found.append(
            f"not exciting: the motion shows only {moving} combinations of parameters better than the "
            "design knows them; move faster, and through more of the workspace"
        )
    if samples < 5 * seen:
        found.append(
            f"too short: {samples} independent forces for {seen} combinations of parameters; record a "
            "longer motion"
        )
    return found
