"""JSON text to plain data, whose numbers all fit into floats, and plain data with a hash of themselves."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

_LONGEST = 300
"""Digits of whole numbers that a float can hold."""


def parse_json(text: str | bytes) -> Any:
    """Return what JSON text holds.

    Parameters
    ----------
    text : str or bytes
        The text.

    Returns
    -------
    object
        Plain data; whole numbers that no float can hold are infinite, as other numbers are.

    Raises
    ------
    ValueError
        If it is not JSON, or nested too deeply.
    """
    try:
        return json.loads(text, parse_int=lambda digits: (int if len(digits) < _LONGEST else float)(digits))
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def hash_of(data: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of their keys."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def dump_hashed(data: Mapping[str, Any]) -> str:
    """Return JSON text of plain data with their hash, for `parse_hashed`.

    Parameters
    ----------
    data : mapping
        Plain data without a key ``hash``.

    Returns
    -------
    str
    """
    return json.dumps({**data, "hash": hash_of(data)}, indent=1, ensure_ascii=False) + "\n"


def parse_hashed(text: str, kind: str) -> dict[str, Any]:
    """Return what `dump_hashed` wrote, its hash checked and left out.

    Parameters
    ----------
    text : str
        The text.
    kind : str
        What its field ``kind`` must say.

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        If it is something else, or its hash does not fit.
    """
    data = parse_json(text)
    if not isinstance(data, dict) or data.get("kind") != kind:
        raise ValueError("it is something else")
    told = data.pop("hash", None)
    if told != hash_of(data):
        raise ValueError("its hash does not fit")
    return data
