"""Checks of numbers of drives: each names the part and the field."""

from __future__ import annotations

from typing import Any

from p3dof._base.checks import frozen_array, shown
from p3dof._base.errors import DriveError


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


def share(what: str, value: Any, zero: bool = False) -> float:
    """Return a number up to 1 and above 0, or 0 too; texts may be in percent. Or raise DriveError."""
    if isinstance(value, str):
        digits = value.strip()
        try:
            value = float(digits.rstrip("%")) / (100 if digits.endswith("%") else 1)
        except ValueError:
            raise DriveError(f"{what}: expected a share such as 0.9 or '90 %', got {shown(value)}") from None
    number = from_zero(what, value) if zero else above_zero(what, value)
    if number > 1:
        raise DriveError(f"{what}: expected at most 1, got {number:g}")
    return number


def text(what: str, value: Any) -> str:
    """Return a text, or raise DriveError."""
    if not isinstance(value, str):
        raise DriveError(f"{what}: expected a text, got {shown(value)}")
    return value
