"""Checks of numbers of drives: each names the part and the field."""

from __future__ import annotations

from typing import Any

from p3dof.checks import frozen_array, shown
from p3dof.errors import DriveError


def above_zero(what: str, value: Any) -> float:
    """Return a number above zero, or raise DriveError."""
    number = float(frozen_array(what, value, (), DriveError))
    if number <= 0:
        raise DriveError(f"{what}: expected a number above zero, got {number:g}")
    return number


def from_zero(what: str, value: Any) -> float:
    """Return a number of zero or more, or raise DriveError."""
    number = float(frozen_array(what, value, (), DriveError))
    if number < 0:
        raise DriveError(f"{what}: expected zero or more, got {number:g}")
    return number


def share(what: str, value: Any) -> float:
    """Return a number above 0 and at most 1, or raise DriveError."""
    number = above_zero(what, value)
    if number > 1:
        raise DriveError(f"{what}: expected at most 1, got {number:g}")
    return number


def text(what: str, value: Any) -> str:
    """Return a text, or raise DriveError."""
    if not isinstance(value, str):
        raise DriveError(f"{what}: expected a text, got {shown(value)}")
    return value
