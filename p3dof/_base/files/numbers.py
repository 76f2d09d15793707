"""Tables of numbers as text and back, exactly and fast; by the extension, or without it by Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray


def table_lines(columns: Sequence[NDArray[Any] | list[str]], point: bool = True) -> bytes:
    """Return the lines of columns (N,): text as it is, numbers by the fewest digits that read back.

    `point`: whether whole numbers end in ``.0``, as Python writes them.
    """
    if (found := _extension()) is not None:
        return bytes(found.rows(_powers(), tuple(columns), point))
    written = [column if isinstance(column, list) else list(map(repr, column.tolist())) for column in columns]
    if not point:
        written = [
            given if isinstance(given, list) else [number.removesuffix(".0") for number in texts]
            for given, texts in zip(columns, written, strict=True)
        ]
    return "".join([f"{','.join(row)}\n" for row in zip(*written, strict=True)]).encode()


def numbers_of_lines(text: str, start: int, longest: int, columns: int) -> FloatArray | None:
    """Return the numbers (N, columns) of lines from a character on; None where a careful reader must look.

    Blank lines and lines that begin with ``#`` are skipped; no line may have more than `longest` bytes.
    """
    if (found := _extension()) is None:
        return None
    into = np.empty((text.count("\n", start) + 1, columns))
    try:
        count = found.numbers(_powers(), text, len(text[:start].encode()), longest, columns, into)
    except UnicodeEncodeError:  # half a character
        return None
    return None if count < 0 else into[:count]


@cache
def _extension() -> ModuleType | None:
    try:
        from p3dof._base.files import _numbers
    except ImportError:
        return None
    return _numbers


@cache
def _powers() -> NDArray[np.uint64]:
    """Return the powers of ten from -342 to 324: their first 128 bits, rounded up, as pairs of 64."""
    found = []
    for k in range(-342, 325):
        up, down = 10 ** max(k, 0), 10 ** max(-k, 0)
        shift = 127 - (up.bit_length() - down.bit_length() - (k < 0))
        found += divmod(-((-up << max(shift, 0)) // (down << max(-shift, 0))), 1 << 64)
    return np.array(found, np.uint64)
