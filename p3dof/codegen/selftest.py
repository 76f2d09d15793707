"""The program that tests generated C where it is compiled: its tables of states and its calls."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.codegen.precision import DOUBLE, Precision
from p3dof.codegen.reference import Reference, reference
from p3dof.codegen.routines import Argument, routines
from p3dof.machine.parameters import Parameters

_INDENT = " " * 4
_FIELDS = {"pose": 3, "velocity": 3, "acceleration": 3, "wrench": 6, "forces": 3, "sliders": 3, "rates": 3}

Prototype = tuple[str, tuple[Argument, ...], tuple[Argument, ...]]


def selftest(
    parameters: Parameters, prototypes: Sequence[Prototype], baked: bool, precision: Precision
) -> dict[str, str]:
    """Return what the template of the self-test is filled with.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    prototypes : sequence of tuple
        Name, inputs and outputs of every function.
    baked : bool
        The functions take no model.
    precision : Precision
        What the functions compute with.

    Returns
    -------
    dict of str to str
        Text by placeholder.
    """
    expected = reference(parameters, rounded=precision.rounded)
    count = len(expected.amplification)
    rows = []
    for i in range(count):
        entries = [_braced(expected.inputs[name][i], precision) for name in _FIELDS]
        rows.append(f"{_INDENT}{{" + f",\n{_INDENT} ".join(entries) + "}")
    held = {routine.name for routine in routines().all if routine.held}
    tables, table = [], []
    for name, inputs, outputs in prototypes:
        sizes = [math.prod(argument.shape) for argument in outputs]
        tables.append(
            number_table(f"expected_{name}[{count}][{sum(sizes)}]", _settled(expected.outputs[name], sizes))
        )
        groups = ", ".join(str(size) for size in (*sizes, *[0] * (4 - len(sizes))))
        size = size_of(name, parameters, precision)
        where = 2 if name == "forward_kinematics" else int(name in held)
        table.append(
            f'{_INDENT}{{"{name}", run_{name}, nulls_{name}, expected_{name}[0], {sum(sizes)}, {{{groups}}}, '
            f"{where}, {int(any(argument.name == 'wrench' for argument in inputs))}, {size!r}}},"
        )
    model = "" if baked else "const p3dof_model *model, "
    return {
        "model": model,
        "pass_model": "" if baked else "model, ",
        "model_only": "void" if baked else "const p3dof_model *model",
        "only_model": "" if baked else "model",
        "strong": "P3DOF_BEYOND_LIMITS" if parameters.limits.force < precision.largest else "P3DOF_OK",
        "high": "P3DOF_BEYOND_LIMITS" if parameters.limits.travel[1] < precision.largest else "P3DOF_OK",
        "baked": str(int(baked)),
        "fields": "\n".join(f"{_INDENT}real {name}[{size}];" for name, size in _FIELDS.items()),
        "count": str(count),
        "states": ",\n".join(rows),
        "tolerances": ", ".join(f"{value:.3g}" for value in tolerances(expected, parameters, precision)),
        "singular": _braced(expected.singular, precision),
        "far": precision.number(4 * parameters.geometry.L),
        "real": precision.real,
        "limits": precision.limits,
        "tiny": precision.number(1e-320 if precision is DOUBLE else 1e-40),
        "expected": "\n".join(tables),
        "calls": "\n".join(_call(*prototype, baked) for prototype in prototypes),
        "table": "\n".join(table),
        "functions": str(len(prototypes)),
        "largest": str(max(sum(math.prod(a.shape) for a in outputs) for _, _, outputs in prototypes)),
    }


def tolerances(expected: Reference, parameters: Parameters, precision: Precision) -> FloatArray:
    """Return the relative error that results at states may have, by what rounding is there.

    It grows near singularities, which for doubles is all that matters. Of floats, guide-ways that are hardly
    farther out than the platform's joints take digits as well, since det J is proportional to R - r. And
    friction turns over within its smoothing rate, of which the rounding of a speed is a share then.

    Parameters
    ----------
    expected : Reference
        The states.
    parameters : Parameters
        The machine.
    precision : Precision
        What is computed with.

    Returns
    -------
    ndarray, shape (N,)
    """
    growth = expected.amplification
    if precision is DOUBLE:
        return precision.accuracy * growth
    geometry, friction = parameters.geometry, parameters.friction
    growth = growth * float(geometry.L / (geometry.R - geometry.r)) ** 2
    found: FloatArray = precision.accuracy * growth
    if any(value > 0 for value in friction.coulomb.values()):
        speed = np.abs(expected.inputs["velocity"]).max(axis=1)
        found = found + 4 * precision.epsilon * growth * speed / friction.smoothing
    return found


def size_of(name: str, parameters: Parameters, precision: Precision) -> float:
    """Return what the error of a function is at least relative to.

    Sliders and poses near home are differences of lengths, and the platform's angle is one over its size,
    which floats feel.

    Parameters
    ----------
    name : str
        The function.
    parameters : Parameters
        The machine.
    precision : Precision
        What is computed with.

    Returns
    -------
    float
    """
    if precision is DOUBLE or not name.endswith("_kinematics"):
        return 0.0
    L = float(parameters.geometry.L)
    return max(L, L / float(parameters.geometry.r)) if name == "forward_kinematics" else L


def _call(name: str, inputs: tuple[Argument, ...], outputs: tuple[Argument, ...], baked: bool) -> str:
    """Return the functions that call one from a state into a row, and with NULL for each argument."""
    model = "" if baked else "const p3dof_model *model, "
    given = [] if baked else ["model"]
    given += ["(has_wrench ? in->wrench : NULL)" if a.name == "wrench" else f"in->{a.name}" for a in inputs]
    taken, place = [], 0
    for argument in outputs:
        start = f"&out[{place}]" if place else "out"
        shape = argument.shape
        taken.append(start if len(shape) == 1 else f"(real (*)[{shape[1]}])({start})")
        place += math.prod(shape)
    optional = [argument.name == "wrench" for argument in inputs]
    call = f"p3dof_{name}({', '.join([*given, *taken])})"
    uses = any(optional)
    lines = [f"static p3dof_status run_{name}({model}const inputs *in, int has_wrench, real *out)", "{"]
    lines += [] if uses else [f"{_INDENT}(void)has_wrench;"]
    lines += [f"{_INDENT}return {call};", "}", ""]
    plain = [text.replace("(has_wrench ? in->wrench : NULL)", "in->wrench") for text in given] + taken
    needed = [i for i, text in enumerate(plain) if text != "in->wrench"]
    lines += [f"static int nulls_{name}({model}const inputs *in, real *out)", "{", f"{_INDENT}int bad = 0;"]
    for i in needed:
        arguments = ", ".join("NULL" if j == i else text for j, text in enumerate(plain))
        lines.append(f"{_INDENT}bad += p3dof_{name}({arguments}) != P3DOF_NULL_POINTER;")
    return "\n".join([*lines, f"{_INDENT}return bad;", "}", ""])


def number_table(declaration: str, rows: FloatArray) -> str:
    """Return a table of numbers in C."""
    body = ",\n".join(_wrapped(row) for row in rows)
    return f"static const double {declaration} = {{\n{body}}};"


def _wrapped(row: FloatArray) -> str:
    """Return a row in braces, on as many lines as it takes."""
    lines, line = [], f"{_INDENT}{{"
    for i, value in enumerate(row):
        number = repr(float(value)) + ("" if i == len(row) - 1 else ", ")
        if len(line) + len(number) > 118:
            lines.append(line.rstrip())
            line = f"{_INDENT} "
        line += number
    return "\n".join([*lines, line + "}"])


def _braced(row: FloatArray, precision: Precision) -> str:
    return "{" + ", ".join(precision.number(value) for value in row) + "}"


def _settled(rows: FloatArray, sizes: Sequence[int]) -> FloatArray:
    """Return results with what is only rounding set to zero: it differs between processors."""
    found, place = rows.copy(), 0
    for size in sizes:
        block = found[:, place : place + size]
        block[np.abs(block) < 1e-15 * np.abs(block).max(axis=1, keepdims=True)] = 0
        place += size
    return found
