"""What a sweep is, as one JSON file: written first, and compared before anything is added to a folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.blocks.best import ParetoArchive, TopK
from p3dof._base.blocks.problem import (
    LARGEST_BLOCK,
    MOST_ITEMS,
    NAME,
    UNIT,
    Block,
    Problem,
    check_problem,
    not_among,
    whole,
)
from p3dof._base.blocks.reduction import Reduction
from p3dof._base.blocks.statistics import Histogram, Moments
from p3dof._base.checks import one_line, shown
from p3dof._base.errors import FileError, InputError, P3dofError, SweepError
from p3dof._base.files import dump_hashed, hash_of, parse_hashed, read_text
from p3dof._base.version import __version__

Format: TypeAlias = Literal["npz", "parquet"]
"""How blocks are stored."""

NAME_OF_FILE = "sweep.json"
"""The manifest in the folder of a sweep."""

KIND = "p3dof sweep"
VERSION = 1
_LARGEST_FILE = 5_000_000
_TOLD = 3

REDUCTIONS: dict[str, Callable[..., Reduction]] = {
    kind.__name__: kind for kind in (Histogram, Moments, ParetoArchive, TopK)
}
"""The reductions that a manifest may name. A reduction of one's own is entered here before `Sweep.load`."""


@dataclass(frozen=True)
class Manifest:
    """What a sweep is.

    Parameters
    ----------
    problem : str
        The class of its problem.
    settings : mapping
        What the results depend on: `Problem.settings`.
    count, block_size, seed : int
        Items, items of a block, and the seed of all random numbers.
    columns : tuple of str
        Of the problem.
    keep : tuple of str
        Columns that are stored.
    format : {"npz", "parquet"}
        How blocks are stored.
    reductions : tuple of Reduction
        What is found in each block, and of all.
    versions : mapping of str to str
        Of the programs that the last bits may depend on.
    units : mapping of str to str
        Of columns that have one, for tables and figures.
    """

    problem: str
    settings: Mapping[str, Any]
    count: int
    block_size: int
    seed: int
    columns: tuple[str, ...]
    keep: tuple[str, ...]
    format: Format = "npz"
    reductions: tuple[Reduction, ...] = ()
    versions: Mapping[str, str] = field(
        default_factory=lambda: {"p3dof": __version__, "numpy": np.__version__}
    )
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        whole("count", self.count, 1, MOST_ITEMS)
        whole("block_size", self.block_size, 1, LARGEST_BLOCK)
        whole("seed", self.seed, 0, 2**128)
        if self.format not in get_args(Format):
            raise InputError(f"format: expected {' or '.join(get_args(Format))}, got {shown(self.format)}")
        for name in (*self.columns, *self.keep):
            if not isinstance(name, str) or not NAME.fullmatch(name) or name not in self.columns:
                raise InputError(f"keep: {not_among(name, self.columns)}")
        for name, unit in self.units.items():
            if name not in self.columns or not isinstance(unit, str) or not UNIT.fullmatch(unit):
                raise InputError(f"units: expected a unit for a column, got {shown(unit)} for {shown(name)}")
        names = [reduction.name for reduction in self.reductions]
        if len(set(names)) < len(names):
            raise InputError(f"reductions: expected each one once, got {names}")

    def with_unit(self, column: str) -> str:
        """Return the name of a column, and its unit in brackets where it has one."""
        return f"{column} [{self.units[column]}]" if column in self.units else column

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return -(-self.count // self.block_size)

    def block(self, number: int) -> Block:
        """Return which items a block has."""
        start = number * self.block_size
        return Block(number, start, min(start + self.block_size, self.count), self.seed)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "kind": KIND,
            "format_version": VERSION,
            "problem": self.problem,
            "settings": plain(self.settings, "settings"),
            "seed": self.seed,
            "count": self.count,
            "block_size": self.block_size,
            "columns": list(self.columns),
            "units": dict(self.units),
            "keep": list(self.keep),
            "format": self.format,
            "reductions": [plain(item.settings(), item.name) for item in self.reductions],
            "versions": dict(self.versions),
        }

    @property
    def text(self) -> str:
        """The content of the file."""
        return dump_hashed(self.to_dict())

    @cached_property
    def hash(self) -> str:
        """SHA-256 of all of it: each block carries it."""
        return hash_of(self.to_dict())


def manifest_of(
    problem: Problem,
    seed: int,
    block_size: int | None,
    keep: Any,
    kind: Format,
    reductions: Any,
) -> Manifest:
    """Return what a sweep of a problem is; parameters as of `p3dof.sweep`.

    Returns
    -------
    Manifest

    Raises
    ------
    InputError
        If an argument does not fit.
    """
    check_problem(problem)
    columns = tuple(problem.columns)
    for item in reductions:
        if not isinstance(item, Reduction):
            raise InputError(f"reductions: expected TopK, ParetoArchive and the like, got {shown(item)}")
    if keep == "all":
        keep = columns
    elif isinstance(keep, str):
        keep = (keep,)
    own = type(problem)
    return Manifest(
        problem=f"{own.__module__}.{own.__qualname__}",
        settings=plain(problem.settings(), "settings"),
        count=int(problem.count),
        block_size=problem.block_size if block_size is None else block_size,
        seed=seed,
        columns=columns,
        keep=() if keep is None else tuple(keep),
        format=kind,
        reductions=tuple(item.over(columns) for item in reductions),
        units=dict(getattr(problem, "units", {})),
    )


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return what the manifest of a folder holds, its hash checked and left out.

    Parameters
    ----------
    folder : Path
        Of a sweep.

    Returns
    -------
    dict

    Raises
    ------
    FileError
        If there is none, or it is damaged.
    """
    path = folder / NAME_OF_FILE
    text = read_text(path, _LARGEST_FILE)
    try:
        data = parse_hashed(text, KIND)
        if data["format_version"] != VERSION:
            raise ValueError("it is of another version")
    except (ValueError, LookupError) as error:
        raise FileError(f"{path}: expected the manifest of a sweep ({one_line(str(error))})") from error
    return data


def parse_manifest(data: Mapping[str, Any], path: Path) -> Manifest:
    """Return a manifest from what `read_manifest` read.

    Parameters
    ----------
    data : mapping
        Plain data.
    path : Path
        What to name in an error.

    Returns
    -------
    Manifest

    Raises
    ------
    FileError
        If something in it is not as it should be.
    """
    try:
        known: dict[str, Any] = {
            key: data[key] for key in ("problem", "settings", "count", "block_size", "seed", "format")
        }
        known |= {key: tuple(data[key]) for key in ("columns", "keep")}
        reductions = tuple(_reduction(item).over(known["columns"]) for item in data["reductions"])
        return Manifest(
            **known, reductions=reductions, versions=dict(data["versions"]), units=dict(data["units"])
        )
    except (ValueError, LookupError, TypeError, AttributeError, P3dofError) as error:
        raise FileError(f"{path}: expected the manifest of a sweep ({one_line(str(error))})") from error


def require_same(there: Mapping[str, Any], manifest: Manifest, folder: Path) -> None:
    """Raise unless what a folder holds is the sweep that is asked for.

    Parameters
    ----------
    there : mapping
        What `read_manifest` read.
    manifest : Manifest
        What is asked for.
    folder : Path
        What to name in an error.

    Raises
    ------
    SweepError
        Naming what differs.
    """
    ours = json.loads(json.dumps(manifest.to_dict()))
    found = list(_differences(there, ours, ""))
    if found:
        more = f" (and {len(found) - _TOLD} more differences)" if len(found) > _TOLD else ""
        raise SweepError(
            f"{folder}: holds another sweep: {one_line('; '.join(found[:_TOLD]))}{more}; "
            "choose another folder"
        )


def plain(value: Any, where: str) -> Any:
    """Return settings as plain data that JSON gives back the same.

    Parameters
    ----------
    value : object
        Numbers, texts, lists, mappings; small arrays too.
    where : str
        What to call it in an error.

    Returns
    -------
    object

    Raises
    ------
    InputError
        If something else is in it.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), where)
    if isinstance(value, list | tuple):
        return [plain(item, where) for item in value]
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise InputError(f"{where}: expected plain data (numbers, texts, lists, mappings), got {shown(value)}")


def _reduction(data: Mapping[str, Any]) -> Reduction:
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}
    kind = values.pop("kind")
    if not isinstance(kind, str) or kind not in REDUCTIONS:
        raise InputError(f"{shown(kind)} is no reduction that is known here")
    return REDUCTIONS[kind](**values)


def _differences(there: Any, ours: Any, where: str) -> Iterator[str]:
    """Yield what differs, one sentence each."""
    if isinstance(there, Mapping) and isinstance(ours, Mapping):
        for key in dict.fromkeys((*there, *ours)):
            name = f"{where}.{key}" if where else str(key)
            if key not in there or key not in ours:
                yield f"{name} is only {'here' if key in ours else 'there'}"
            else:
                yield from _differences(there[key], ours[key], name)
    elif json.dumps(there) != json.dumps(ours):
        yield f"{where} is {_short(there)} there, {_short(ours)} here"


def _short(value: Any) -> str:
    return one_line(json.dumps(value, ensure_ascii=False), 60)
