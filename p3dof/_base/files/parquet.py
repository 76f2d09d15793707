"""Parquet by pyarrow: with a checksum (CRC-32) of each page, and errors in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from p3dof._base.checks import one_line
from p3dof._base.errors import FileError, MissingExtraError

WRITE = {"write_page_checksum": True}
"""How pyarrow is to write."""
READ = {"page_checksum_verification": True}
"""How it is to read; pages of other programs without a checksum are taken as they are."""


def pyarrow() -> Any:
    """Return pyarrow, with its Parquet.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import pyarrow as found
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("Parquet files need pyarrow: pip install 'p3dof[tables]'") from error
    return found


@contextmanager
def damage_told(expected: str) -> Iterator[None]:
    """Turn what is said of a damaged file, by pyarrow or in this block, into a `FileError` of one line.

    Parameters
    ----------
    expected : str
        What the error begins with: the file, and what it should be.
    """
    errors = (pyarrow().ArrowException, OSError, ValueError, LookupError, OverflowError, MemoryError)
    try:
        yield
    except errors as error:
        raise FileError(f"{expected} ({one_line(str(error), 200)})") from error
