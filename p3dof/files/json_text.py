"""JSON text to plain data, whose numbers all fit into floats."""

from __future__ import annotations

import json
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
