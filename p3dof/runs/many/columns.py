"""What differs between many runs, as columns: starts, gains, seeds, loads, machines; and why one ended."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.files import called
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MOMENT, RATE, SPEED, Quantity
from p3dof.analysis.designs import Designs, DesignStatus
from p3dof.analysis.designs.columns import DENSITY, QUANTITIES, SIZES, Column, as_column, by_header, column_of
from p3dof.analysis.designs.files import read_designs, require_size
from p3dof.analysis.designs.results import status_of
from p3dof.closed_form.compiled.many import ACCURACY, CONTROLLER, FINISHED, NOWHERE, START
from p3dof.machine.parameters import LEGS, Parameters

__all__ = ["BAD_COLUMN", "DESIGN", "FINISHED", "NOT_FINITE", "NOT_RUN", "kind_of", "reason_of", "stop_codes"]

NOT_RUN, NOT_FINITE, BAD_COLUMN, DESIGN = -2, 16, 17, 20
"""Why a run was not made, besides the numbers of the engine; from `DESIGN` on the `DesignStatus`."""

_LIMITS = (
    *(("slider stop", f"slider {leg} at its lower end") for leg in LEGS),
    *(("slider stop", f"slider {leg} at its upper end") for leg in LEGS),
    ("tilt limit", "the platform at its lower limit"),
    ("tilt limit", "the platform at its upper limit"),
    *(("reach limit", f"leg {leg} horizontal") for leg in LEGS),
    ("singular pose", "the sliders cannot hold the platform's rotation (det J = 0)"),
)
_OTHERS = {
    NOT_RUN: ("not run", "it was interrupted"),
    FINISHED: ("finished", "it went on to its end"),
    ACCURACY: ("accuracy", "no step is small enough for the tolerances"),
    CONTROLLER: ("controller", "it gave forces that are not finite, or failed"),
    START: ("impossible start", "it would start beyond a limit"),
    NOWHERE: ("impossible start", "it would start out of reach"),
    NOT_FINITE: ("not a number", "a column has NaN or infinity"),
    BAD_COLUMN: ("bad gain or seed", "a gain that is not positive, or a seed that is no whole number"),
}


_MACHINES = tuple(
    DESIGN + status
    for status in DesignStatus
    if status not in (DesignStatus.FEASIBLE, DesignStatus.OUT_OF_REACH, DesignStatus.SINGULAR)
)


def kind_of(stop: int) -> str:
    """Return what ended a run; a kind of `p3dof.runs.Stop`, ``"finished"``, or why it was not made."""
    return _words(stop)[0]


def reason_of(stop: int) -> str:
    """Return in words why a run ended: the kind, and what it means.

    Parameters
    ----------
    stop : int
        As of `kind_of`.
    """
    kind, reason = _words(stop)
    return f"{kind}: {reason}"


def stop_codes() -> tuple[int, ...]:
    """Return all numbers that say why a run ended, rising."""
    return tuple(sorted((*range(len(_LIMITS)), *_OTHERS, *_MACHINES)))


def _words(stop: int) -> tuple[str, str]:
    if 0 <= stop < len(_LIMITS):
        return _LIMITS[stop]
    if stop == DESIGN + DesignStatus.NOT_FINITE:
        return _OTHERS[NOT_FINITE]
    if stop >= DESIGN:
        return "impossible machine", DesignStatus(stop - DESIGN).in_words
    return _OTHERS[stop]


STARTS = ("start.y", "start.z", "start.theta", "start.vy", "start.vz", "start.vtheta")
GAINS = ("controller.frequency", "controller.damping", "controller.integral_time", "controller.stiffness")
WRENCH = ("wrench.fy", "wrench.fz", "wrench.my")
SEED = "seed"

_UNITS: dict[str, Quantity | None] = {
    **dict(zip(STARTS, (LENGTH, LENGTH, ANGLE, SPEED, SPEED, RATE), strict=True)),
    **dict.fromkeys(GAINS),
    **dict(zip(WRENCH, (FORCE, FORCE, MOMENT), strict=True)),
    SEED: None,
}
_PLAIN = {"controller.frequency": "Hz", "controller.integral_time": "s", "controller.stiffness": "N/m"}
"""The only units that these columns can have."""

_SHORT = {name.partition(".")[2]: name for name in GAINS}  # names of gains without ``controller``


class RunColumns:
    """Many runs by columns; runs that cannot be made have their reason in `status`."""

    def __init__(self, runs: Any, machine: Parameters) -> None:
        self.own: dict[str, FloatArray] = {}
        self.designs: Designs | None = None
        self.count = 1
        try:
            self._fill(runs, machine)
        except InputError as error:
            told = str(error)
            if not told.startswith("designs: "):
                raise
            raise InputError(
                f"runs: {told.removeprefix('designs: ').replace('one a design', 'one a run')}"
            ) from error

    def _fill(self, runs: Any, machine: Parameters) -> None:
        if isinstance(runs, int | np.integer) and not isinstance(runs, bool):
            if runs < 1:
                raise InputError(f"runs: expected at least one, got {runs}")
            self.count = int(runs)
        elif isinstance(runs, Sequence) and not isinstance(runs, str):
            if not len(runs) or not all(isinstance(one, Parameters) for one in runs):
                raise InputError("runs: expected columns by name, a number, or machines (Parameters)")
            self._take_machines(Designs(runs, machine))
        else:
            self._take(by_header(runs), machine)

    def _take(self, given: Any, machine: Parameters) -> None:
        run_columns_of(given)
        others: dict[str, Any] = {}
        for header, values in given.items():
            name, factor = _own(header)
            if name is None:
                others[header] = values
            else:
                self.own[name] = as_column(str(header), values) * factor
        if others:
            self._take_machines(Designs(others, machine))
        lengths = {name: len(column) for name, column in self.own.items() if column.ndim}
        if self.designs is not None:
            known = [np.ndim(getattr(values, "values", values)) for values in others.values()]
            lengths |= {"the machine's": len(self.designs)} if any(known) else {}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise InputError(f"runs: expected columns of one length, got {told}")
        if not given:
            raise InputError("runs: expected columns, got none")
        self.count = next(iter(lengths.values()), 1)
        if self.count < 1:
            raise InputError("runs: expected at least one, the columns are empty")
        self.own = {
            name: np.ascontiguousarray(np.broadcast_to(column, self.count))
            for name, column in self.own.items()
        }

    def _take_machines(self, designs: Designs) -> None:
        for name in designs.columns:
            if name.startswith("offset."):
                raise InputError(
                    f"runs: unknown column {name}; a run starts at start.y, start.z, start.theta"
                )
        self.designs, self.count = designs, len(designs)

    first: int = 0  # the number of the first run, where these are some of many

    def part(self, start: int, stop: int) -> RunColumns:
        """Return some of the runs, which keep their numbers."""
        found = copy(self)
        found.own = {name: column[start:stop] for name, column in self.own.items()}
        if self.designs is not None and len(self.designs) > 1:
            found.designs = self.designs.part(start, stop)
        found.count, found.first = stop - start, self.first + start
        found.status = self.status[start:stop]
        return found

    @cached_property
    def status(self) -> NDArray[np.int16]:
        """Which runs cannot be made, and why, (R,); `NOT_RUN` for those that can."""
        status = np.full(self.count, NOT_RUN, np.int16)
        for name, column in self.own.items():
            status[~_possible(name, column)] = BAD_COLUMN
        for name, column in self.own.items():
            status[~_finite(name, column)] = NOT_FINITE
        if self.designs is not None:
            found = status_of(self.designs)
            bad = np.broadcast_to(found != DesignStatus.FEASIBLE, self.count)
            status[bad] = DESIGN + np.broadcast_to(found, self.count)[bad].astype(np.int16)
        return status

    @property
    def columns(self) -> dict[str, FloatArray]:
        """All columns by their full names, (R,) each, in SI units."""
        machine = {} if self.designs is None else self.designs.columns
        return self.own | {
            name: np.ascontiguousarray(np.broadcast_to(column, self.count))
            for name, column in machine.items()
        }

    def machine(self, run: int, otherwise: Parameters) -> Parameters:
        """Return the machine of a run."""
        if self.designs is None:
            return otherwise
        return self.designs[run if len(self.designs) > 1 else 0]


def _finite(name: str, column: Any) -> Any:
    """Return where a column holds numbers; infinity is one where nothing is integrated."""
    return np.isfinite(column) | ((name == "controller.integral_time") & (column == np.inf))


def _possible(name: str, column: Any) -> Any:
    """Return where a gain or a seed is one that can be."""
    if name == SEED:
        return (column >= 0) & (column == np.rint(column)) & (column < 2.0**63)
    if name in GAINS:
        return column >= 0 if name == "controller.stiffness" else column > 0
    return np.ones(np.shape(column), dtype=bool)


def faults(columns: Mapping[str, FloatArray], run: int, stop: int) -> str:
    """Return columns, as ``"geometry.L is nan"``, each alone a reason why a run was not made."""
    fits = {NOT_FINITE: _finite, DESIGN + DesignStatus.NOT_FINITE: _finite, BAD_COLUMN: _possible}.get(stop)
    if fits is None:
        return ""
    numbers = {name: column[run] for name, column in columns.items()}
    return ", ".join(f"{name} is {number:.15g}" for name, number in numbers.items() if not fits(name, number))


def run_columns_of(headers: Iterable[Any]) -> list[Column]:
    """Return what headers of runs mean, each once."""
    found: dict[str, tuple[Column, object]] = {}
    for header in headers:
        name, factor = _own(header)
        column = Column(name, factor) if name is not None else _column_of_machine(header)
        if column.name in found:
            both = f"{shown(found[column.name][1])} and {shown(header)}"
            raise InputError(f"runs: two columns are {column.name}: {both}; leave one of them out")
        found[column.name] = column, header
    return [column for column, _ in found.values()]


def variable_of(name: str) -> tuple[str, Quantity | None]:
    """Return the full name of a column of runs, and the quantity that it is; None for plain numbers."""
    own = _SHORT.get(name, name)
    if own in _UNITS:
        return own, _UNITS[own]
    known = _column_of_machine(name).name
    return known, QUANTITIES[known]


def unit_of(name: str) -> str:
    """Return the SI unit of a column of runs by its full name; empty where it has none."""
    if name not in _UNITS:
        return QUANTITIES[name].unit
    quantity = _UNITS[name]
    return _PLAIN.get(name, "") if quantity is None else quantity.unit


def _own(header: object) -> tuple[str | None, float]:
    """Return the name of a column of runs and what takes it to SI units; None for those of machines."""
    if not isinstance(header, str):
        raise InputError(f"runs: expected names of columns, got {shown(header)}")
    name, bracket, unit = header.strip().rpartition("[")
    unit = unit.removesuffix("]").strip() if bracket and unit.endswith("]") else ""
    name = (name if unit else header).strip()
    name = _SHORT.get(name, name)
    if name not in _UNITS:
        return None, 1.0
    quantity = _UNITS[name]
    if not unit:
        return name, 1.0
    if quantity is None:
        if unit != _PLAIN.get(name):
            raise InputError(f"runs: column {shown(header)}: expected no unit but {_PLAIN.get(name, 'none')}")
        return name, 1.0
    try:
        return name, float(quantity.read(f"1 {unit}", f"runs: column {shown(header)}"))
    except ParameterError as error:
        raise InputError(str(error)) from error


def _column_of_machine(header: str) -> Column:
    try:
        column = column_of(header)
    except InputError as error:
        own = ", ".join((*STARTS[:4], "...", *GAINS[:2], "...", *WRENCH[:1], "...", SEED))
        raise InputError(f"{str(error).replace('designs:', 'runs:', 1)}; or of a run: {own}") from error
    if column.name in (*SIZES, DENSITY):
        raise InputError(
            f"runs: the column {column.name} is of solids; runs take masses and inertias instead"
        )
    return column


_ROWS = 100_000


def read_runs(source: Any, any_size: bool = False) -> dict[str, FloatArray]:
    """Return the columns of a table: names in its first line, a run in every other one.

    By header.
    """
    parts = []
    for rows in read_designs(source, _ROWS, run_columns_of):
        if not any_size:
            require_size(run_columns_of(rows.columns), rows, called(source))
        parts.append(rows.columns)
    return {header: np.concatenate([part[header] for part in parts]) for header in parts[0]}
