"""What differs between the machines of a sweep, and what is found of all, from the fields of its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from p3dof._base.blocks import (
    Distribution,
    Grid,
    Histogram,
    LogUniform,
    Moments,
    Normal,
    ParetoArchive,
    Reduction,
    Samples,
    Sampling,
    TopK,
    Uniform,
)
from p3dof._base.blocks.sampling import METHODS
from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs.fields import listed, mapping, named, number, read_beside
from p3dof.analysis.designs.files import Meaning
from p3dof.analysis.designs.names import LENGTHS, QUANTITIES, columns_of, full_name
from p3dof.design.sweeps.rows import FileRows
from p3dof.machine.parameters.plain import LARGEST
from p3dof.machine.parameters.quantities import Quantity
from p3dof.runs.many.columns import run_columns_of, variable_of


class Naming(NamedTuple):
    """What may differ between the items of a sweep.

    Parameters
    ----------
    variable : callable
        Returns the full name of a variable, and the quantity that it is; None for plain numbers.
    columns : callable
        Returns the columns that the headers of a table mean.
    """

    variable: Callable[[str], tuple[str, Quantity | None]]
    columns: Meaning


def _design_variable(name: str) -> tuple[str, Quantity | None]:
    known = full_name(name)
    return known, QUANTITIES[known]


OF_DESIGNS, OF_RUNS = Naming(_design_variable, columns_of), Naming(variable_of, run_columns_of)

SPREADS: dict[str, Callable[..., Distribution]] = {
    "uniform": Uniform,
    "log-uniform": LogUniform,
    "normal": Normal,
}


def sampling_of(
    data: Mapping[str, Any], folder: Path, name: str, naming: Naming, any_size: bool = False
) -> Sampling:
    """Return where the inputs come from: the fields `rows`, or `variables`, `sampling` and `count`.

    Parameters
    ----------
    data : mapping
        The fields of the file.
    folder : Path
        Where it is.
    name : str
        What to call it.
    naming : Naming
        What may differ.
    any_size : bool
        Take machines of more than 20 m too.

    Returns
    -------
    Sampling

    Raises
    ------
    InputError, FileError
        If a field does not fit, or a file cannot be read.
    """
    if "rows" in data:
        others = [key for key in ("variables", "sampling", "count") if key in data]
        if others or not isinstance(data["rows"], str):
            got = f"with {others[0]!r}" if others else shown(data["rows"])
            raise InputError(f"rows: expected a file of designs and no other inputs, got {got}")
        return read_beside(
            lambda path: FileRows(path, naming.columns, any_size), folder, data["rows"], f"{name}: rows"
        )
    variables = mapping(data.get("variables"), "variables", None)
    spreads = {}
    for given, value in variables.items():
        key, quantity = naming.variable(str(given))
        spreads[key] = _spread(value, key, quantity, any_size)
    method = data.get("sampling", "grid" if all(isinstance(s, tuple) for s in spreads.values()) else "random")
    grid = {key: item for key, item in spreads.items() if isinstance(item, tuple)}
    free = {key: item for key, item in spreads.items() if isinstance(item, Distribution)}
    if method == "grid":
        if free or "count" in data:
            what = f"{next(iter(free))} without" if free else "a count besides"
            raise InputError(f"variables: expected `values` of each variable of a grid, got {what} them")
        return Grid(grid)
    if method not in METHODS:
        raise InputError(f"sampling: expected {', '.join(METHODS)} or grid, got {shown(method)}")
    if grid:
        raise InputError(f"variables.{next(iter(grid))}: `values` belong to a grid (sampling: grid)")
    if "count" not in data:
        raise InputError("count: expected how many items there are, got nothing")
    return Samples(free, data["count"], method)


def _spread(
    value: Any, key: str, quantity: Quantity | None, any_size: bool
) -> Distribution | tuple[float, ...]:
    """Return how a variable is spread, or its values."""
    where = f"variables.{key}"
    spread = mapping(value, where, (*SPREADS, "values"))
    if len(spread) != 1:
        known = ", ".join((*SPREADS, "values"))
        raise InputError(f"{where}: expected one of {known}, got {len(spread)} of them")
    ((kind, given),) = spread.items()
    numbers = [number(item, quantity, f"{where}.{kind}") for item in listed(given, f"{where}.{kind}")]
    large = max(numbers, default=0.0)
    if key in LENGTHS and large > LARGEST and not any_size:
        raise InputError(
            f"{where}.{kind}: {large:g} m is more than {LARGEST:g} m: lengths are in metres; did you mean "
            f"'{large:g} mm'? (--any-size takes it as it is)"
        )
    if kind == "values":
        return tuple(numbers)
    if len(numbers) != 2:
        raise InputError(f"{where}.{kind}: expected two numbers, got {len(numbers)}")
    return named(where, lambda: SPREADS[kind](*numbers))


_REDUCTIONS: dict[str, tuple[tuple[str, ...], Callable[[dict[str, Any]], Reduction]]] = {
    "top": (("count", "largest", "columns"), lambda d: TopK(d.pop("top"), **d)),
    "pareto": (("resolution", "columns"), lambda d: ParetoArchive(d.pop("pareto"), **d)),
    "histogram": (
        ("from", "to", "bins"),
        lambda d: Histogram(d.pop("histogram"), d.pop("from"), d.pop("to"), **d),
    ),
    "moments": ((), lambda d: Moments(d["moments"])),
}
"""What a reduction may say beside its own name, and what it means."""


def reduction_of(value: Any, where: str, columns: tuple[str, ...]) -> Reduction:
    """Return one of the field `reductions`, for a problem with these columns."""
    data = dict(mapping(value, where, None))
    kinds = [kind for kind in _REDUCTIONS if kind in data]
    if len(kinds) != 1:
        raise InputError(f"{where}: expected one of {', '.join(_REDUCTIONS)}")
    others, make = _REDUCTIONS[kinds[0]]
    mapping(data, where, (kinds[0], *others))
    for key in ("from", "to"):
        if kinds[0] == "histogram" and key not in data:
            raise InputError(f"{where}: the field {key!r} is missing")
    if kinds[0] in {"top", "histogram"} and not isinstance(data[kinds[0]], str):
        raise InputError(f"{where}.{kinds[0]}: expected the name of a column, got {shown(data[kinds[0]])}")
    return named(where, lambda: make(data).over(columns))
