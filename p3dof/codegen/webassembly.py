"""Generated C as a small WebAssembly file that imports nothing, and the JavaScript that loads it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from p3dof.codegen.frame import INDENT, Argument, Prototype, definition, indented
from p3dof.codegen.naming import fill


@dataclass(frozen=True)
class Exported:
    """A function of generated C that is called on rows, every argument row after row."""

    function: Prototype  # the function
    first: str = ""  # its first argument, if that is no row
    kept: tuple[Argument, ...] = ()  # of ``state``, copied from there after a call

    @property
    def name(self) -> str:
        """Its name, without prefix."""
        return self.function.name

    @property
    def inputs(self) -> tuple[Argument, ...]:
        """What it takes."""
        return self.function.inputs

    @property
    def outputs(self) -> tuple[Argument, ...]:
        """What it gives."""
        return (*self.function.outputs, *self.kept)

    def code(self, prefix: str) -> str:
        """Return C that calls it on rows, and tells how many are good."""
        given = [f"const double *{one.name}" for one in self.inputs]
        taken = [f"double *{one.name}" for one in self.outputs]
        head = (
            f"size_t rows_of_{self.name}(size_t count, {', '.join([*given, *taken])}, unsigned char *status)"
        )
        first = [self.first] if self.first else []
        called = ", ".join([*first, *(one.row(prefix) for one in self.function.arguments)])
        kept = [
            f"memcpy({one.name} + {one.size}U * i, state.{one.name}, {one.size}U * sizeof(double));"
            for one in self.kept
        ]
        inner = [
            f"const {prefix}_status told = {prefix}_{self.name}({called});",
            "status[i] = (unsigned char)told;",
            f"if (told == {prefix.upper()}_OK) {{",
            *indented(("++good;", *kept)),
            "}",
        ]
        lines = [
            "size_t i, good = 0U;",
            "for (i = 0U; i < count; ++i) {",
            *indented(inner),
            "}",
            "return good;",
        ]
        return f'EXPORT("{self.name}") {head};\n\n{definition(head, lines)}'


@dataclass(frozen=True)
class WebModule:
    """What a WebAssembly file offers."""

    prefix: str  # what the names of the C begin with
    note: str  # what its files begin with
    functions: Sequence[Exported]  # what is called on rows
    statuses: Mapping[int, str]  # what a status means, by its number
    state: str = ""  # C of what is kept between calls
    methods: str = ""  # JavaScript of more methods, and of what is done at first
    constructed: str = ""
    places: Mapping[str, object] = field(default_factory=dict)
    """Where the parameters are, by name; empty without any."""
    optimisation: str = "-O2"  # what the compiler is told: `"-O2"` for speed, `"-Oz"` for a small file

    def exports(self) -> str:
        """Return the C that is compiled beside the library."""
        functions = "\n".join(one.code(self.prefix) for one in self.functions)
        return fill(
            "wasm_exports.in", note=self.note, prefix=self.prefix, state=self.state, functions=functions
        )

    def loader(self) -> str:
        """Return the JavaScript module."""
        spec = {
            one.name: {
                "inputs": _sizes(one.inputs),
                "optional": [argument.name for argument in one.inputs if argument.optional],
                "outputs": _sizes(one.outputs),
            }
            for one in self.functions
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
            arguments=", ".join(one.name for one in example.inputs if not one.optional),
            statuses=_script(self.statuses),
            spec=_script(spec),
            places=places,
            constructed=self.constructed,
            methods=self.methods,
        )


def _sizes(groups: Iterable[Argument]) -> dict[str, int]:
    return {one.name: one.size for one in groups}


def _script(value: object) -> str:
    """Return a constant of JavaScript, an entry of the outermost object a line."""
    if not isinstance(value, Mapping):
        return json.dumps(value)
    lines = [f"{INDENT}{json.dumps(str(key))}: {json.dumps(one)}," for key, one in value.items()]
    return "\n".join(["{", *lines, "}"])
