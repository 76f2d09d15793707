"""The section of a WebAssembly file that says what it was built from."""

from __future__ import annotations

import json
from collections.abc import Mapping

_NAME = b"p3dof"
_MAGIC = b"\0asm\1\0\0\0"


def with_section(made: bytes, told: Mapping[str, str]) -> bytes:
    """Return a file with the section at its end.

    Parameters
    ----------
    made : bytes
        The file.
    told : mapping of str to str
        What the section says.

    Returns
    -------
    bytes
    """
    body = _length(len(_NAME)) + _NAME + json.dumps(dict(told)).encode()
    return made + b"\0" + _length(len(body)) + body


def section_of(found: bytes) -> dict[str, str]:
    """Return what the section of a file says.

    Parameters
    ----------
    found : bytes
        The file, or what somebody takes for one.

    Returns
    -------
    dict of str to str
        Empty if it has no such section, or is no WebAssembly.
    """
    place = len(_MAGIC)
    try:
        while found.startswith(_MAGIC) and place < len(found):
            kind = found[place]
            size, start = _number(found, place + 1)
            if kind == 0:
                length, at = _number(found, start)
                if found[at : at + length] == _NAME:
                    told = json.loads(found[at + length : start + size])
                    return told if isinstance(told, dict) else {}
            place = start + size
    except (IndexError, ValueError):
        pass
    return {}


def _length(value: int) -> bytes:
    """Return an unsigned number in LEB128."""
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def _number(found: bytes, place: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = found[place]
        value |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return value, place
