"""Generated C as a small WebAssembly file that imports nothing, and the JavaScript that loads it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from p3dof.codegen.filling import fill

_INDENT = " " * 4


@dataclass(frozen=True)
class Rows:
    """An argument of a function, row after row.

    Parameters
    ----------
    name : str
        Its name.
    size : int
        Numbers of a row.
    cast : str
        What C makes of the place of a row; ``*`` takes the number there.
    optional : bool
        Whether it may be missing.
    kept : str
        Where to copy the row from after a call, instead of giving it to the function.
    """

    name: str
    size: int
    cast: str = ""
    optional: bool = False
    kept: str = ""

    @property
    def argument(self) -> str:
        """What is given to the function for row ``i``."""
        place = f"{self.name} + {self.size}U * i"
        if self.optional:
            return f"({self.name} != NULL) ? {place} : NULL"
        return f"{self.cast}({place})" if self.cast else place


@dataclass(frozen=True)
class Exported:
    """A function of generated C that is called on rows.

    Parameters
    ----------
    name : str
        Its name, without prefix.
    inputs, outputs : sequence of Rows
        What it takes and gives.
    first : str
        Its first argument, if that is no row.
    """

    name: str
    inputs: Sequence[Rows]
    outputs: Sequence[Rows]
    first: str = ""

    def code(self, prefix: str) -> str:
        """Return C that calls it on rows, and tells how many are good."""
        given = [f"const double *{rows.name}" for rows in self.inputs]
        taken = [f"double *{rows.name}" for rows in self.outputs]
        head = (
            f"size_t rows_of_{self.name}(size_t count, {', '.join([*given, *taken])}, unsigned char *status)"
        )
        first = [self.first] if self.first else []
        called = [rows.argument for rows in (*self.inputs, *self.outputs) if not rows.kept]
        ok = f"{prefix.upper()}_OK"
        kept = [
            f"memcpy({rows.name} + {rows.size}U * i, {rows.kept}, {rows.size}U * sizeof(double));"
            for rows in self.outputs
            if rows.kept
        ]
        inner = [
            f"const {prefix}_status told = {prefix}_{self.name}({', '.join([*first, *called])});",
            "status[i] = (unsigned char)told;",
            f"if (told == {ok}) {{",
            *(_INDENT + line for line in ("++good;", *kept)),
            "}",
        ]
        lines = [
            f'EXPORT("{self.name}") {head};',
            "",
            head,
            "{",
            f"{_INDENT}size_t i, good = 0U;",
            f"{_INDENT}for (i = 0U; i < count; ++i) {{",
            *(2 * _INDENT + line for line in inner),
            f"{_INDENT}}}",
            f"{_INDENT}return good;",
            "}",
            "",
        ]
        return "\n".join(lines)


@dataclass(frozen=True)
class WebModule:
    """What a WebAssembly file offers.

    Parameters
    ----------
    prefix : str
        What the names of the C begin with.
    note : str
        What its files begin with.
    functions : sequence of Exported
        What is called on rows.
    statuses : mapping of str to str
        What a status means, by its number.
    state : str
        C of what is kept between calls.
    methods, constructed : str
        JavaScript of more methods, and of what is done at first.
    places : mapping
        Where the parameters are, by name; empty without any.
    optimisation : str
        What the compiler is told: ``"-O2"`` for speed, ``"-Oz"`` for a small file.
    """

    prefix: str
    note: str
    functions: Sequence[Exported]
    statuses: Mapping[int, str]
    state: str = ""
    methods: str = ""
    constructed: str = ""
    places: Mapping[str, object] = field(default_factory=dict)
    optimisation: str = "-O2"

    def exports(self) -> str:
        """Return the C that is compiled beside the library."""
        functions = "\n".join(function.code(self.prefix) for function in self.functions)
        return fill(
            "wasm_exports.in", note=self.note, prefix=self.prefix, state=self.state, functions=functions
        )

    def loader(self) -> str:
        """Return the JavaScript module."""
        spec = {
            function.name: {
                "inputs": _sizes(function.inputs),
                "optional": [rows.name for rows in function.inputs if rows.optional],
                "outputs": _sizes(function.outputs),
            }
            for function in self.functions
        }
        example = self.functions[0]
        places = (
            "\n/** Places in `parameters`; at a body's begin mass, mass centre (3) and inertia (6). */\n"
            f"export const places = {_script(self.places)};\n"
            if self.places
            else ""
        )
        return fill(
            "wasm_loader.in",
            note=self.note,
            prefix=self.prefix,
            example=example.name,
            arguments=", ".join(rows.name for rows in example.inputs if not rows.optional),
            statuses=_script(self.statuses),
            spec=_script(spec),
            places=places,
            constructed=self.constructed,
            methods=self.methods,
        )


def _sizes(groups: Iterable[Rows]) -> dict[str, int]:
    return {rows.name: rows.size for rows in groups}


def _script(value: object) -> str:
    """Return a constant of JavaScript, an entry of the outermost object a line."""
    if not isinstance(value, Mapping):
        return json.dumps(value)
    lines = [f"{_INDENT}{json.dumps(str(key))}: {json.dumps(one)}," for key, one in value.items()]
    return "\n".join(["{", *lines, "}"])
