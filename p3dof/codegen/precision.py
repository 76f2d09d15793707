"""The numbers that generated C computes with, doubles or floats, and C of the one turned into the other.

Formulas and templates are written for doubles. For floats every type, number and function of the text is made
narrow, so that nothing is done in double precision in secret, which processors without it would do by library
calls of a hundred cycles each.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.samples import ACTUATION_TOLERANCE, REACH_TOLERANCE


@dataclass(frozen=True)
class Precision:
    """One kind of numbers, with the tolerances that their rounding asks for."""

    real: str  # the type in C
    epsilon: float  # distance from 1 to the next number
    largest: float  # the largest number, and the smallest positive one with all digits
    least: float
    limits: str  # what the names of its limits in `float.h` begin with
    reach: float  # share of a leg's length that must be left of its reach
    actuation: float  # angle that poses must be from the actuation singularity [rad]
    inertia: float  # share of its largest entry by which an inertia may miss the triangle inequality
    accuracy: float  # relative error that rounding may make in results far from singularities

    @property
    def tolerances(self) -> dict[str, float]:
        """Squares that a drop, as a share of the leg, and a sine must be more than, by their names."""
        return {"least_drop2": (2 - self.reach) * self.reach, "least_actuation2": self.actuation**2}

    def code(self, text: str) -> str:
        """Return C that is written for doubles with these numbers."""
        if self is DOUBLE:
            return text
        return _TOKENS.sub(lambda found: found["kept"] or _narrow(found), text)

    def number(self, value: float) -> str:
        """Return a number as C writes it, rounded to these."""
        if self is DOUBLE:
            return repr(float(value))
        narrow = np.float32(value)
        if not np.isfinite(narrow):
            raise ParameterError(f"{NOT_SINGLE}: {value:.6g}")
        return f"{narrow!s}F"

    def rounded(self, row: Sequence[float]) -> list[float]:
        """Return numbers as these can tell them."""
        return [float(np.float32(x)) for x in row] if self is SINGLE else [float(x) for x in row]

    def check(self, row: Sequence[float]) -> None:
        """Raise ParameterError if parameters of a machine are too large or too small for these numbers."""
        for value in row:
            if value != 0 and not self.least <= abs(value) <= self.largest and self is SINGLE:
                raise ParameterError(f"{NOT_SINGLE}: {value:.6g}")


NOT_SINGLE = "the numbers of this machine are too large or too small for single precision"
"""What is wrong with a machine that floats cannot describe."""

DOUBLE = Precision(
    real="double",
    epsilon=sys.float_info.epsilon,
    largest=sys.float_info.max,
    least=sys.float_info.min,
    limits="DBL",
    reach=REACH_TOLERANCE,
    actuation=ACTUATION_TOLERANCE,
    inertia=1e-9,
    accuracy=1e-12,
)

_EPSILON = float(np.finfo(np.float32).eps)

SINGLE = Precision(
    real="float",
    epsilon=_EPSILON,
    largest=float(np.finfo(np.float32).max),
    least=float(np.finfo(np.float32).tiny),
    limits="FLT",
    reach=5e-6,  # as many roundings as in double precision, 45
    actuation=1e-4,  # errors grow as one over it: three digits are left there
    inertia=4e-6,  # 32 roundings: moments of thin rods are differences that are zero but for rounding
    accuracy=32 * _EPSILON,
)
"""The accuracy is 64 roundings of half a digit each: the longest chains of operations, those of derivatives,
have about as many. Inputs and parameters that are rounded make a few of them."""


def precision_of(name: object) -> Precision:
    """Return the numbers by their type in C."""
    if name not in ("double", "float"):
        raise InputError(f"precision: expected 'double' or 'float', got {shown(name)}")
    return DOUBLE if name == "double" else SINGLE


_FUNCTIONS = ("sqrt", "sin", "cos", "tanh", "fabs", "hypot", "atan2", "floor")
_TOKENS = re.compile(
    r'(?P<kept>/\*.*?\*/|"(?:[^"\\\n]|\\.)*")'
    r"|(?<![\w.])(?P<number>(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)(?![\w.])"
    rf"|\b(?P<function>{'|'.join(_FUNCTIONS)})(?=\()"
    r"|\b(?P<word>double|HUGE_VAL|DBL_MAX|DBL_MIN)\b",
    re.DOTALL,
)
_WORDS = {"double": "float", "HUGE_VAL": "HUGE_VALF", "DBL_MAX": "FLT_MAX", "DBL_MIN": "FLT_MIN"}


def _narrow(found: re.Match[str]) -> str:
    if found["number"]:
        return SINGLE.number(float(found["number"]))
    return f"{found['function']}f" if found["function"] else _WORDS[found["word"]]
