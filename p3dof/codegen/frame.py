"""The frame of generated C, of the machine as of any robot: the table of its functions, and its files.

`controller` and `loops` say what the functions are and what is in them; prototypes, checks of arguments,
self-tests and WebAssembly follow from the table.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Literal, NamedTuple

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.samples import ACTUATION_TOLERANCE, REACH_TOLERANCE
from p3dof.codegen.naming import checked_cpu, fill, named

INDENT = " " * 4


@dataclass(frozen=True)
class Argument:
    """An argument of a function in C: an array of doubles, unless it is something else."""

    name: str  # its name
    text: str = ""  # what it is, with units
    shape: tuple[int, ...] = (3,)  # its dimensions
    symbols: tuple[str, ...] = ()
    """What the entries of an input are called in the formulas; empty where they are not used."""
    optional: bool = False  # whether it may be NULL
    columns: str = ""  # what C calls the number of columns, if that has a name
    kind: Literal["array", "number", "struct"] = "array"  # a struct is of doubles too

    @property
    def size(self) -> int:
        """How many doubles it has."""
        return prod(self.shape)

    @property
    def cast(self) -> str:
        """What C makes of the place of its first double."""
        return f"(double (*)[{self.columns or self.shape[1]}])" if len(self.shape) > 1 else ""

    def declared(self, prefix: str, given: bool) -> str:
        """Return how C declares it, as an input or an output."""
        if self.kind == "struct":
            return f"{prefix}_{self.name} *{self.name}"
        if self.kind == "number":
            return f"double {self.name}"
        *first, last = map(str, self.shape)
        sizes = "".join(f"[{size}]" for size in (*first, self.columns or last))
        return f"{'const ' if given else ''}double {self.name}{sizes}"

    def row(self, prefix: str) -> str:
        """Return what a function is given for row ``i`` of many."""
        place = f"{self.name} + {self.size}U * i"
        if self.optional:
            return f"({self.name} != NULL) ? {place} : NULL"
        if self.kind == "number":
            return f"*({place})"
        cast = f"({prefix}_{self.name} *)" if self.kind == "struct" else named(self.cast, prefix)
        return f"{cast}({place})" if cast else place


class Prototype(NamedTuple):
    """A function of generated C, a row of the table."""

    name: str  # without prefix
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """Inputs and outputs."""
        return (*self.inputs, *self.outputs)

    @property
    def needed(self) -> list[str]:
        """The arguments that must not be NULL."""
        return [one.name for one in self.arguments if one.kind == "array" and not one.optional]

    def head(self, prefix: str, first: Sequence[str], width: int) -> str:
        """Return its declaration, with what comes before inputs and outputs, in lines of a width."""
        declared = [*first]
        declared += [one.declared(prefix, given=True) for one in self.inputs]
        declared += [one.declared(prefix, given=False) for one in self.outputs]
        head = f"{prefix}_status {prefix}_{self.name}("
        line = f"{head}{', '.join(declared)})"
        return (
            line if len(line) <= width else head + "\n" + ",\n".join(INDENT + one for one in declared) + ")"
        )


def leave(condition: str, status: str) -> list[str]:
    """Return statements that end a function with a status on a condition."""
    return [f"if ({condition}) {{", f"{INDENT}return {status};", "}"]


def indented(lines: Iterable[str]) -> list[str]:
    """Return lines one level deeper."""
    return [INDENT + line for line in lines]


def definition(head: str, lines: Iterable[str]) -> str:
    """Return a function in C of its declaration and its statements."""
    return "\n".join([head, "{", *indented(lines), "}", ""])


def groups(sizes: Sequence[int], most: int) -> str:
    """Return the sizes of the outputs of a function for the table of a self-test, zeros behind them."""
    return ", ".join(map(str, (*sizes, *[0] * (most - len(sizes)))))


def with_build(texts: Mapping[str, str], note: str, prefix: str, cpu: str) -> dict[str, str]:
    """Return the files of a library by name, with those that build it and its self-test, for a processor."""
    builds = {"Makefile": "makefile.in", "CMakeLists.txt": "cmake.in"}
    return {
        **texts,
        **{name: fill(file, note=note, name=prefix, cpu=checked_cpu(cpu)) for name, file in builds.items()},
    }


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
