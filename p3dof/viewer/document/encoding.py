"""Numbers, curves and arrows of a document as JSON: no digit is lost, and none is written out."""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError

DTYPES = ("float64", "float32", "int32", "uint32", "int16", "uint16", "int8", "uint8")
"""What the numbers of an array may be; little endian, rows first."""


def encoded(values: ArrayLike, dtype: str = "float64") -> dict[str, Any]:
    """Return an array as JSON takes it.

    ``shape``, ``dtype`` and ``base64``: the numbers, little endian, rows first.
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
    """Return what `encoded` wrote; read-only."""
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


def some_of(count: int, most: int) -> NDArray[np.intp]:
    """Return indices of at most so many of `count` samples, spread evenly, the first and last included."""
    return np.asarray(np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)))


GREY = "#5f6b76"
"""Colour of sums."""
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7b1fa2", "#8d6e63")
"""Colours that the colour-blind can tell apart (Okabe and Ito, and two more)."""
Limit = tuple[float, float]
"""Lowest and highest value; infinite where there is none."""


def curve(
    key: str,
    label: str,
    group: str,
    unit: str,
    ink: str,
    values: FloatArray | None = None,
    column: tuple[str, int] | None = None,
    limit: Limit | None = None,
) -> dict[str, Any]:
    """Return a curve as a document has it."""
    found: dict[str, Any] = {"key": key, "label": label, "group": group, "unit": unit, "colour": ink}
    if column is not None:
        found["column"] = list(column)
    else:
        found["values"] = encoded(np.zeros(0) if values is None else values)
    if limit is not None:
        found["limit"] = [finite(limit[0]), finite(limit[1])]
    return found


def load(
    key: str,
    label: str,
    kind: str,
    place: tuple[int, list[float]],
    ink: str,
    group: str,
    values: dict[str, Any] | None = None,
    along: tuple[list[float], str] | None = None,
    frame: str = "world",
    layer: str | None = None,
) -> dict[str, Any]:
    """Return a force or moment that is drawn as an arrow, at a point of a joint's body.

    Its vectors are encoded `values`, or it is `along` a direction, as large as a curve says.
    """
    found: dict[str, Any] = {"key": key, "label": label, "kind": kind, "joint": place[0], "point": place[1]}
    found["frame"] = frame
    found |= {"values": values} if along is None else {"direction": along[0], "curve": along[1]}
    found |= {"colour": ink, "group": group, "unit": "N" if kind == "force" else "N m"}
    return found if layer is None else found | {"layer": layer}


def layer(name: str, label: str, seen: bool = True) -> dict[str, Any]:
    """Return what can be hidden, and whether it is seen at first."""
    return {"name": name, "label": label, "shown": seen}


def setting(key: str, label: str, unit: str, ends: tuple[float, float], value: float = 0.0) -> dict[str, Any]:
    """Return what may be set by a slider of the page."""
    low, high = ends
    return {"key": key, "label": label, "unit": unit, "low": low, "high": high, "value": value}
