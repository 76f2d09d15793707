"""Arrays of numbers in JSON: base64 of their bytes, so that no digit is lost and none is written out."""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.errors import InputError

DTYPES = ("float64", "float32", "int32", "uint32", "int16", "uint16", "int8", "uint8")
"""What the numbers of an array may be; little endian, rows first."""


def encoded(values: ArrayLike, dtype: str = "float64") -> dict[str, Any]:
    """Return an array as JSON takes it.

    Parameters
    ----------
    values : array-like
        Of any shape; NaN stays NaN.
    dtype : str
        One of `DTYPES`.

    Returns
    -------
    dict
        ``shape``, ``dtype`` and ``base64``: the numbers, little endian, rows first.

    Raises
    ------
    InputError
        If there is no such type, or whole numbers do not fit into it.
    """
    if dtype not in DTYPES:
        raise InputError(f"dtype: expected one of {', '.join(DTYPES)}, got {dtype!r}")
    given = np.asarray(values)
    kind = np.dtype(dtype).newbyteorder("<")
    if kind.kind in "iu" and given.size:
        room = np.iinfo(kind)
        if given.min() < room.min or given.max() > room.max:
            raise InputError(f"values: expected whole numbers that fit into {dtype}")
    content = base64.b64encode(np.ascontiguousarray(given.astype(kind)).tobytes()).decode("ascii")
    return {"shape": list(given.shape), "dtype": dtype, "base64": content}


def decoded(array: Mapping[str, Any]) -> NDArray[Any]:
    """Return what `encoded` wrote.

    Parameters
    ----------
    array : mapping
        With ``shape``, ``dtype`` and ``base64``.

    Returns
    -------
    ndarray
        Read-only.

    Raises
    ------
    InputError
        If it is no such array, or its bytes are not as many as its shape says.
    """
    try:
        shape, dtype = tuple(int(n) for n in array["shape"]), str(array["dtype"])
        content = base64.b64decode(array["base64"], validate=True)
    except (KeyError, TypeError, ValueError, binascii.Error) as error:
        raise InputError(f"array: expected shape, dtype and base64 ({error})") from error
    if dtype not in DTYPES or min(shape, default=0) < 0:
        raise InputError(f"array: expected a shape and one of {', '.join(DTYPES)}, got {shape}, {dtype!r}")
    kind = np.dtype(dtype).newbyteorder("<")
    if len(content) != math.prod(shape) * kind.itemsize:
        raise InputError(f"array: expected {math.prod(shape)} numbers, got {len(content)} bytes")
    return np.frombuffer(content, dtype=kind).reshape(shape)


def finite(value: float) -> float | None:
    """Return a number as JSON has it: None for NaN and infinity."""
    return float(value) if math.isfinite(value) else None


def colour(rgba: ArrayLike) -> str:
    """Return red, green and blue, from 0 to 1, as ``#rrggbb``."""
    parts = np.clip(np.nan_to_num(np.asarray(rgba, dtype=float).ravel()[:3]), 0.0, 1.0)
    return "#" + "".join(f"{round(255 * float(part)):02x}" for part in parts)
