"""What a sweep has on disk: its folder, the manifest that says what it is, and a file for each block."""

from __future__ import annotations

import base64
import contextlib
import errno
import io
import json
import os
import re
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks.problem import (
    LARGEST_BLOCK,
    MOST_ITEMS,
    NAME,
    UNIT,
    Block,
    Problem,
    check_problem,
    not_among,
)
from p3dof._base.blocks.reduction import Form, Histogram, Moments, ParetoArchive, Reduction, State, TopK
from p3dof._base.checks import Readable, one_line, shown, whole
from p3dof._base.errors import FileError, InputError, P3dofError, SweepError
from p3dof._base.files import (
    UnfitError,
    archives,
    called,
    dump_hashed,
    hash_of,
    make_folders,
    pack_arrays,
    parse_hashed,
    parse_json,
    read_bytes,
    read_text,
    unpack_arrays,
)
from p3dof._base.files.reading import reason
from p3dof._base.version import __version__

Format: TypeAlias = Literal["npz", "parquet"]  # how blocks are stored

NAME_OF_FILE = "sweep.json"  # the manifest in the folder of a sweep

KIND = "p3dof sweep"
VERSION = 1
_LARGEST_FILE = 5_000_000
_TOLD = 3

REDUCTIONS: dict[str, Callable[..., Reduction]] = {
    kind.__name__: kind for kind in (Histogram, Moments, ParetoArchive, TopK)
}
"""The reductions that a manifest may name. A reduction of one's own is entered here before `Sweep.load`."""


@dataclass(frozen=True)
class Manifest(Readable):
    """What a sweep is."""

    problem: str  # the class of its problem
    settings: Mapping[str, Any]  # what the results depend on: `Problem.settings`
    count: int  # items, items of a block, and the seed of all random numbers
    block_size: int
    seed: int
    columns: tuple[str, ...]  # of the problem
    keep: tuple[str, ...]  # columns that are stored
    format: Format = "npz"  # how blocks are stored
    reductions: tuple[Reduction, ...] = ()  # what is found in each block, and of all
    versions: Mapping[str, str] = field(
        default_factory=lambda: {"p3dof": __version__, "numpy": np.__version__}
    )  # of the programs that the last bits may depend on
    units: Mapping[str, str] = field(default_factory=dict)  # of columns that have one, for tables and figures

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
    problem: Problem, seed: int, block_size: int | None, keep: Any, kind: Format, reductions: Any
) -> Manifest:
    """Return what a sweep of a problem is; parameters as of `p3dof.sweep`."""
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
    """Return what the manifest of a folder holds, its hash checked and left out."""
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
    """Return a manifest from what `read_manifest` read."""
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
    """Raise unless what a folder holds is the sweep that is asked for."""
    ours = json.loads(json.dumps(manifest.to_dict()))
    found = list(_differences(there, ours, ""))
    if found:
        more = f" (and {len(found) - _TOLD} more differences)" if len(found) > _TOLD else ""
        raise SweepError(
            f"{folder}: holds another sweep: {one_line('; '.join(found[:_TOLD]))}{more}; "
            "choose another folder"
        )


def plain(value: Any, where: str) -> Any:
    """Return settings as plain data that JSON gives back the same."""
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


_ROWS = "N"
_LONGEST_TEXT = 6_000
_ROOM = 1_000_000  # of what stands beside the numbers of a block [bytes]


class Content(NamedTuple):
    """What the file of a block holds."""

    columns: dict[str, NDArray[Any]]  # (n,): the columns that are kept
    states: tuple[State, ...]  # what its reductions found, in their order


def pack_block(manifest: Manifest, block: Block, content: Content) -> bytes:
    """Return the file of a block: the same bytes for the same numbers."""
    about = json.dumps({"hash": manifest.hash, "block": block.number})
    states = {
        f"of{i}.{name}": array for i, state in enumerate(content.states) for name, array in state.items()
    }
    if manifest.format == "parquet":
        return _pack_parquet(about, content.columns, pack_arrays(states) if states else b"")
    columns = {f"column.{name}": array for name, array in content.columns.items()}
    return pack_arrays({"about": np.array(about), **columns, **states}, compressed=False)


def read_block(manifest: Manifest, block: Block, path: Path, names: Sequence[str] | None = None) -> Content:
    """Read the file of a block."""
    wanted = manifest.keep if names is None else tuple(names)
    what = f"block {block.number} of this sweep"
    if manifest.format == "parquet":
        return _read_parquet(manifest, block, path, wanted, what)
    columns: Form = {f"column.{name}": ("fi", (len(block),)) for name in wanted}
    reader = _Reader({"about": ("U", ()), **columns, **_states_form(manifest)}, manifest, block)
    arrays = unpack_arrays(path, reader.names, reader.accept, reader.found, what=what, max_directory=_ROOM)
    found = {name: arrays[f"column.{name}"] for name in wanted}
    return Content(found, _states_in(manifest, arrays))


def pack_totals(manifest: Manifest, states: Sequence[State]) -> bytes:
    """Return the file of what the reductions found in all blocks of a sweep."""
    return pack_arrays(
        {
            "about": np.array(json.dumps({"hash": manifest.hash, "block": None})),
            **{f"of{i}.{name}": array for i, state in enumerate(states) for name, array in state.items()},
        }
    )


def read_totals(manifest: Manifest, path: Path) -> tuple[State, ...]:
    """Read what `pack_totals` made; `FileError` if it is damaged or of another sweep."""
    reader = _Reader({"about": ("U", ()), **_states_form(manifest)}, manifest, None)
    arrays = unpack_arrays(path, reader.names, reader.accept, reader.found, what="what reductions found")
    return _states_in(manifest, arrays)


class _Reader:
    """Says what may be in a file, and checks whose it is as soon as that is known."""

    def __init__(self, form: Form, manifest: Manifest, block: Block | None) -> None:
        self._form, self._manifest = form, manifest
        self._number = None if block is None else block.number
        self._lengths: dict[str, int] = {}

    def names(self, there: list[str]) -> list[str]:
        missing = [name for name in self._form if name not in there]
        if missing:
            raise UnfitError(f"{missing[0]} is missing")
        return list(self._form)

    def accept(self, name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
        kinds, expected = self._form[name]
        if kind.kind not in kinds or (kind.kind == "U" and kind.itemsize > 4 * _LONGEST_TEXT):
            raise UnfitError(f"{name}: it is of the type {kind}")
        if len(shape) != len(expected):
            raise UnfitError(f"{name}: it has the shape {shape}")
        group = name.partition(".")[0]
        for length, got in zip(expected, shape, strict=True):
            if length == _ROWS and got <= self._most(group):
                length = self._lengths.setdefault(group, got)  # noqa: PLW2901 - the first one tells
            if got != length:
                raise UnfitError(f"{name}: it has the shape {shape}")

    def found(self, arrays: dict[str, Any]) -> None:
        if len(arrays) == 1:
            check_about(str(arrays["about"]), self._manifest, self._number)

    def _most(self, group: str) -> int:
        return self._manifest.reductions[int(group.removeprefix("of"))].most


def check_about(text: str, manifest: Manifest, number: int | None) -> None:
    """Raise `UnfitError` unless a file says that it belongs to this sweep and block."""
    try:
        about = parse_json(text)
        whose, which = about["hash"], about["block"]
    except (ValueError, LookupError, TypeError) as error:
        raise UnfitError("it does not name its owner") from error
    if whose != manifest.hash:
        raise UnfitError("it belongs to another sweep")
    if which != number:
        raise UnfitError(f"it is block {which}")


def _states_form(manifest: Manifest) -> dict[str, tuple[str, tuple[int | str, ...]]]:
    return {
        f"of{i}.{name}": form
        for i, reduction in enumerate(manifest.reductions)
        for name, form in reduction.form().items()
    }


def _states_in(manifest: Manifest, arrays: Mapping[str, Any]) -> tuple[State, ...]:
    return tuple(
        {name: arrays[f"of{i}.{name}"] for name in reduction.form()}
        for i, reduction in enumerate(manifest.reductions)
    )


def require_format(kind: str) -> None:
    """Raise `MissingExtraError` unless blocks can be stored in this format here."""
    if kind == "parquet":
        archives.pyarrow()


def _pack_parquet(about: str, columns: Mapping[str, Any], states: bytes) -> bytes:
    pa = archives.pyarrow()
    metadata = {"p3dof": about, "p3dof.reductions": base64.b64encode(states).decode()}
    table = pa.table(dict(columns)).replace_schema_metadata(metadata)
    stream = io.BytesIO()
    pa.parquet.write_table(table, stream, compression="zstd", use_dictionary=False, **archives.WRITE)
    return stream.getvalue()


def _read_parquet(manifest: Manifest, block: Block, path: Path, names: Sequence[str], what: str) -> Content:
    pa = archives.pyarrow()
    room = _ROOM + 9 * len(block) * len(manifest.keep) + 100 * sum(r.most for r in manifest.reductions)
    data = read_bytes(path, room)
    with archives.damage_told(f"{path}: expected {what}"):
        with pa.parquet.ParquetFile(pa.BufferReader(data), **archives.READ) as file:
            about = file.schema_arrow.metadata or {}
            check_about(about[b"p3dof"].decode(), manifest, block.number)
            if file.metadata.num_rows != (len(block) if manifest.keep else 0):
                raise UnfitError(f"it has {file.metadata.num_rows} rows")
            for name in names:
                if str(file.schema_arrow.field(name).type) not in ("double", "int64"):
                    raise UnfitError(f"{name}: it is of the type {file.schema_arrow.field(name).type}")
            table = file.read(columns=list(names))
            states = base64.b64decode(about[b"p3dof.reductions"], validate=True)
        columns = {name: table.column(name).to_numpy() for name in names}
    if not manifest.reductions:
        return Content(columns, ())
    reader = _Reader(_states_form(manifest), manifest, block)
    arrays = unpack_arrays(io.BytesIO(states), reader.names, reader.accept, what=what)
    return Content(columns, _states_in(manifest, arrays))


if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

TOTALS = "reductions.npz"  # what the reductions found in all blocks, once all are there

_LOCK = "sweep.lock"
_BLOCKS = "blocks"
_IN_A_FOLDER = 1000
_FILE = re.compile(r"(\d{10})\.(npz|parquet)", re.ASCII)

_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP}

_working: set[Path] = set()
_guard = threading.Lock()


def path_of(folder: Path, manifest: Manifest, number: int) -> Path:
    """Return the file of a block: a thousand in each folder."""
    name = f"{number:010d}.{manifest.format}"
    return folder / _BLOCKS / f"{number // _IN_A_FOLDER:07d}" / name


def numbers_there(folder: Path, manifest: Manifest) -> list[int]:
    """Return the numbers of the blocks that have a file, rising."""
    found: list[int] = []
    try:
        with contextlib.suppress(FileNotFoundError):
            for inner in os.scandir(folder / _BLOCKS):
                if not inner.is_dir():
                    continue
                with os.scandir(inner) as files:
                    matches = [_FILE.fullmatch(file.name) for file in files]
                found += [int(match[1]) for match in matches if match and match[2] == manifest.format]
    except OSError as error:
        raise FileError(f"{called(folder)}: cannot be read ({reason(error)})") from error
    return sorted(number for number in set(found) if number < manifest.blocks)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep the folder of a sweep for this process alone; the system drops the lock when the process ends."""
    try:
        make_folders(folder.resolve())
        path = folder.resolve() / _LOCK
        with _guard:
            if path in _working:
                raise SweepError(f"{called(folder)}: this process works on this sweep already")
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            _working.add(path)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{called(folder)}: cannot be written ({reason(error)})") from error
    try:
        if not _take(descriptor):
            who = os.pread(descriptor, 200, 0).decode("utf-8", "replace") if hasattr(os, "pread") else ""
            raise SweepError(f"{called(folder)}: another process works on this sweep{_by(who)}")
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"{os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        os.close(descriptor)
        with _guard:
            _working.discard(path)


def _take(descriptor: int) -> bool:
    """Lock a file; false if another process has done so. A child that is forked does not share the lock."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in _NO_LOCKS  # a file system without locks: nobody can be told apart
    return True


def _by(who: str) -> str:
    return f" (process {who.strip()})" if re.fullmatch(r"\d+ on [\w.\-]+", who.strip()) else ""


def require_folder(folder: Path) -> None:
    """Raise `SweepError` unless a worker sees the folder of the sweep."""
    if not (folder / NAME_OF_FILE).is_file():
        raise SweepError(
            f"{folder}: a worker on {socket.gethostname()} does not see this folder; share it between the "
            "machines, or let the blocks come back to be written here (shared=False)"
        )


_FEW = 16  # states that wait to be merged together


class Totals:
    """What reductions found in the blocks that were added, in any order."""

    def __init__(self, manifest: Manifest) -> None:
        self._reductions = manifest.reductions
        nothing = {name: np.zeros(0) for name in manifest.columns}
        self._waiting: list[list[State]] = [[reduction.of(nothing, 0)] for reduction in self._reductions]

    def add(self, states: Sequence[State]) -> None:
        """Add what was found in one block."""
        for reduction, waiting, state in zip(self._reductions, self._waiting, states, strict=True):
            waiting.append(state)
            if len(waiting) > _FEW:
                waiting[:] = [reduction.merge(waiting)]

    def states(self) -> tuple[State, ...]:
        """Return one state of each reduction."""
        return tuple(
            reduction.merge(waiting)
            for reduction, waiting in zip(self._reductions, self._waiting, strict=True)
        )
