"""The frame of generated C, of the machine as of any robot: the table of its functions, and its files.

`controller` and `loops` say what the functions are and what is in them; prototypes, checks of arguments,
self-tests and WebAssembly follow from the table.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Literal, NamedTuple

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
