"""One file a block: its columns and the states of its reductions, checked when they are read."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks.manifest import Manifest
from p3dof._base.blocks.problem import Block
from p3dof._base.blocks.reduction import Form, State
from p3dof._base.files import UnfitError, pack_arrays, parquet, parse_json, read_bytes, unpack_arrays

_ROWS = "N"
_LONGEST_TEXT = 6_000
_ROOM = 1_000_000
"""Of what stands beside the numbers of a block [bytes]."""


class Content(NamedTuple):
    """What the file of a block holds.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        The columns that are kept.
    states : tuple of State
        What its reductions found, in their order.
    """

    columns: dict[str, NDArray[Any]]
    states: tuple[State, ...]


def pack_block(manifest: Manifest, block: Block, content: Content) -> bytes:
    """Return the file of a block: the same bytes for the same numbers.

    Parameters
    ----------
    manifest : Manifest
        Of the sweep.
    block : Block
        Which block.
    content : Content
        What to store.

    Returns
    -------
    bytes
    """
    about = json.dumps({"hash": manifest.hash, "block": block.number})
    states = {
        f"of{i}.{name}": array for i, state in enumerate(content.states) for name, array in state.items()
    }
    if manifest.format == "parquet":
        return _pack_parquet(about, content.columns, pack_arrays(states) if states else b"")
    columns = {f"column.{name}": array for name, array in content.columns.items()}
    return pack_arrays({"about": np.array(about), **columns, **states}, compressed=False)


def read_block(manifest: Manifest, block: Block, path: Path, names: Sequence[str] | None = None) -> Content:
    """Read the file of a block.

    Parameters
    ----------
    manifest : Manifest
        Of the sweep.
    block : Block
        Which block.
    path : Path
        Its file.
    names : sequence of str, optional
        Columns to read; all that are kept by default.

    Returns
    -------
    Content

    Raises
    ------
    FileError
        If the file is missing, damaged, or belongs to another sweep or block.
    """
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
        raise UnfitError("it does not say whose it is") from error
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
        parquet.pyarrow()


def _pack_parquet(about: str, columns: Mapping[str, Any], states: bytes) -> bytes:
    pa = parquet.pyarrow()
    metadata = {"p3dof": about, "p3dof.reductions": base64.b64encode(states).decode()}
    table = pa.table(dict(columns)).replace_schema_metadata(metadata)
    stream = io.BytesIO()
    pa.parquet.write_table(table, stream, compression="zstd", use_dictionary=False, **parquet.WRITE)
    return stream.getvalue()


def _read_parquet(manifest: Manifest, block: Block, path: Path, names: Sequence[str], what: str) -> Content:
    pa = parquet.pyarrow()
    room = _ROOM + 9 * len(block) * len(manifest.keep) + 100 * sum(r.most for r in manifest.reductions)
    data = read_bytes(path, room)
    with parquet.damage_told(f"{path}: expected {what}"):
        with pa.parquet.ParquetFile(pa.BufferReader(data), **parquet.READ) as file:
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
