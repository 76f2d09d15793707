"""The ways to the forces, by name."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

from p3dof.checks import shown
from p3dof.errors import InputError

Method: TypeAlias = Literal["pinocchio", "virtual-power", "compiled"]
"""The ways to the forces. The first two share only the parameters; the third is the second's result by the
reduced formulas of `p3dof.compiled.reduced`, compiled."""

ClosedForm: TypeAlias = Literal["virtual-power", "compiled"]
"""The ways to what Pinocchio is not asked for."""

DEFAULT_METHOD: Method = "pinocchio"
"""Wherever a method can be chosen."""

METHODS: tuple[str, ...] = get_args(Method)
CLOSED_FORMS: tuple[str, ...] = get_args(ClosedForm)


def check_method(method: str, methods: tuple[str, ...] = METHODS) -> str:
    """Return a method if it is known.

    Parameters
    ----------
    method : str
        What the user gave.
    methods : tuple of str
        What there is.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If it is not one of them.
    """
    if not isinstance(method, str) or method not in methods:
        raise InputError(f"method: expected one of {', '.join(map(repr, methods))}, got {shown(method)}")
    return method
