"""Traced functions as C, for one sample and for lanes of a vector."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from string import Template

from p3dof._base.tracing import Symbol
from p3dof._base.tracing.printing import statements, text
from p3dof.loops.compiled.formulas import Robot
from p3dof.loops.compiled.function import Function

_INDENT = " " * 4
_LIBRARY = {"floor": "EACH(floor)"}  # what comes from the library of C, lane by lane
_OURS = ("tanh", "atan2")  # what is in `p3dof._base.tracing`, for one sample and for lanes


class _Text(Template):
    """Templates mark what is put in with ``@``, which C leaves free here."""

    delimiter = "@"


def lanes_source(functions: Sequence[Function], more: str = "", calls: bool = True) -> str:
    """Return functions as one file of C with calls for one sample and for many."""
    used = {f.tape.operations[i].name for f in functions for i in f.tape.needed(f.results)}
    ours = [name for name in _OURS if name in used]
    return fill(
        "lanes.in",
        sincos="\n".join(_resource("p3dof._base.tracing", f"{name}.h") for name in ("sincos", *ours)),
        scalar="\n\n".join(_definition(f, "double", "_one") for f in functions),
        vector="\n\n".join(_definition(f, "lanes", "_lanes") for f in functions),
        functions="\n".join(each for name, each in _LIBRARY.items() if name in used),
        calls="".join(_calls(f) for f in functions if calls) + more,
    )


def sweep_source(robot: Robot, functions: Sequence[Function]) -> str:
    """Return the functions `integrate`, `step` and `motion` as C, and what follows a motion with them."""
    motion = next(f for f in functions if f.name == "motion")
    parts = {place: part for part in robot.tree.parts[1:] for place in part.v}
    loads = list(motion.inputs.values())[3:]
    results = list(motion.outputs.values())[2:]
    sweep = fill(
        "sweep.in",
        nq=robot.tree.nq,
        nv=robot.tree.nv,
        free=len(robot.independent),
        loads=sum(loads),
        groups=len(loads),
        load_sizes=listed(loads or [0]),
        results=len(motion.results),
        result_sizes=listed(results),
        places=listed([parts[place].q[0] for place in robot.independent]),
        circles=listed([int(parts[place].kind == "unbounded") for place in robot.independent]),
    )
    return lanes_source(functions, sweep)


def body(function: Function, real: str, suffix: str) -> str:
    """Return the statements from ``in`` to ``out``, of a type `real`; ``zero`` is a constant of it."""
    tape = function.tape
    names = {symbol.index: f"in[{i}]" for i, symbol in enumerate(function.symbols)}
    places = tape.needed(function.results)
    waves = [i for i in places if tape.operations[i].name in ("sin", "cos")]
    first = set(tape.needed(Symbol(tape, i) for i in waves))  # they do not wait for each other
    order = sorted(places, key=lambda i: (i not in first, i))
    lines = statements(tape, order, names, f"sincos{suffix}", real=real, suffix=suffix)
    for i, result in enumerate(function.results):
        value = text(result, names)
        lines.append(f"out[{i}] = {value if isinstance(result, Symbol) else f'zero + {value}'};")
    return "\n".join(_INDENT + line for line in lines)


def _definition(function: Function, real: str, suffix: str) -> str:
    head = f"static void {function.name}{suffix}(const {real} *restrict in, {real} *restrict out)"
    zero = f"{_INDENT}const {real} zero = {{0}};\n{_INDENT}(void)zero, (void)in;"
    return f"{head}\n{{\n{zero}\n{body(function, real, suffix)}\n}}"


def _calls(function: Function) -> str:
    return fill(
        "calls.in",
        name=function.name,
        inputs=max(1, len(function.symbols)),
        outputs=max(1, len(function.results)),
        input_groups=len(function.inputs),
        output_groups=len(function.outputs),
        input_sizes=listed(list(function.inputs.values())),
        output_sizes=listed(list(function.outputs.values())),
    )


def listed(numbers: Sequence[int]) -> str:
    """Return numbers with commas."""
    return ", ".join(map(str, numbers))


def fill(template: str, **values: object) -> str:
    """Return a template of this package with values put in."""
    return _Text(_resource("p3dof.loops.compiled", template)).substitute(values)


@cache
def _resource(package: str, name: str) -> str:
    return (files(package) / name).read_text(encoding="utf-8")
