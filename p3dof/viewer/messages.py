"""What Python and a page tell each other: JSON, and behind it its arrays as they are in memory.

A message is ``P3D1``, the length of the JSON as four bytes (little endian), the JSON padded with spaces to a
multiple of eight bytes, and the arrays, each at a multiple of eight bytes. In the JSON an array is
``{"shape": [...], "dtype": "float64", "offset": bytes behind the JSON}``.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from p3dof._base.errors import FileError

MAGIC = b"P3D1"
_ALIGNED = 8


def packed_message(message: Mapping[str, Any]) -> bytes:
    """Return a message as a page takes it.

    Parameters
    ----------
    message : mapping
        Plain data without NaN, in which there may be NumPy arrays, bytes, and arrays in base64 as in the
        document of a page.

    Returns
    -------
    bytes
    """
    arrays = _Arrays()
    text = json.dumps(arrays.without(message), allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % _ALIGNED)
    return b"".join((MAGIC, struct.pack("<I", len(text)), text, *arrays.parts))


def unpacked_message(data: bytes) -> dict[str, Any]:
    """Return what `packed_message` has packed, with NumPy arrays.

    Parameters
    ----------
    data : bytes
        The message.

    Returns
    -------
    dict

    Raises
    ------
    FileError
        If it is not such a message.
    """
    if data[:4] != MAGIC or len(data) < _ALIGNED:
        raise FileError("expected a message of p3dof")
    (length,) = struct.unpack("<I", data[4:8])
    behind = data[8 + length :]

    def filled(value: Any) -> Any:
        if isinstance(value, dict) and "offset" in value and "dtype" in value:
            dtype, shape = np.dtype(value["dtype"]).newbyteorder("<"), tuple(value["shape"])
            count = int(np.prod(shape, dtype=int))
            return np.frombuffer(behind, dtype, count, value["offset"]).reshape(shape)
        if isinstance(value, dict):
            return {key: filled(one) for key, one in value.items()}
        return [filled(one) for one in value] if isinstance(value, list) else value

    content: dict[str, Any] = filled(json.loads(data[8 : 8 + length]))
    return content


class _Arrays:
    """The arrays of one message, taken out of it."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self._length = 0

    def without(self, value: Any) -> Any:
        """Return plain data in which every array says where it is."""
        if isinstance(value, Mapping):
            if "base64" in value and "dtype" in value:
                content = base64.b64decode(value["base64"])
                return {"shape": value["shape"], "dtype": value["dtype"], "offset": self._put(content)}
            return {key: self.without(one) for key, one in value.items()}
        if isinstance(value, list | tuple):
            return [self.without(one) for one in value]
        if isinstance(value, bytes):
            return {"shape": [len(value)], "dtype": "uint8", "offset": self._put(value)}
        if isinstance(value, np.ndarray):
            order = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
            return {
                "shape": list(value.shape),
                "dtype": value.dtype.name,
                "offset": self._put(order.tobytes()),
            }
        return value

    def _put(self, content: bytes) -> int:
        offset = self._length
        content += bytes(-len(content) % _ALIGNED)
        self.parts.append(content)
        self._length += len(content)
        return offset
