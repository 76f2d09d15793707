"""The forces of many samples and designs for a GPU: functions of JAX arrays, and a file of CUDA C++.

Both are printed from one tape, from the parameters of a machine in a row (`GIVEN`) to the forces. Neither
looks at the states: one out of reach has NaN, one near a singularity very large forces.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import cache
from typing import Any

from numpy.typing import ArrayLike

from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.printing import function_of, statements, text
from p3dof.closed_form.compiled.formulas import Kernel, kernel
from p3dof.codegen.batch import work_of
from p3dof.codegen.controller import origin_of
from p3dof.codegen.frame import INDENT
from p3dof.codegen.machine import GIVEN, MACHINE, parameter_row, preparation, replay
from p3dof.codegen.naming import PREFIX, fill, renamed
from p3dof.machine.parameters import Parameters


@cache
def forces_kernel(friction: bool) -> Kernel:
    """Return the forces of any machine, `GIVEN`, at a state and a wrench."""
    of_numbers = kernel("inverse_dynamics_" + ("with_friction" if friction else "loaded"))
    tape, (source, given, folded) = Tape(), preparation()
    row = tape.symbols(GIVEN, constant=True)
    symbols = tape.symbols(of_numbers.inputs)
    known: dict[int, Number] = dict(zip((each.index for each in given.values()), row, strict=True))
    numbers = dict(zip(MACHINE, replay(source, folded, known, tape), strict=True))
    known = dict(zip((each.index for each in of_numbers.symbols), symbols, strict=True))
    for number in of_numbers.model:
        if isinstance(number, Symbol):
            known[number.index] = numbers[of_numbers.tape.operation(number).name]
    results = replay(of_numbers.tape, of_numbers.results[:-1], known, tape)
    outputs = of_numbers.outputs[:-1]
    return Kernel("forces", tape, row, of_numbers.inputs, outputs, symbols, tuple(results))


def jax_forces(
    machine: ArrayLike,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    wrench: ArrayLike | None = None,
    friction: bool = True,
) -> Any:
    """Return the forces of the actuators as a JAX array of doubles, (..., 3) [N].

    It can be given to `jax.jit`, `jax.vmap` and `jax.grad`, within ``jax.enable_x64(True)``. `machine` is of
    `parameter_row`, (..., len(GIVEN)); pose, velocity and acceleration are (..., 3), the wrench (..., 6);
    their first axes are broadcast. Without `friction` that of the machine is left out.
    """
    jax = _jax()
    with jax.enable_x64(True):
        row = _doubles(jax, "machine", machine, len(GIVEN))
        return _on_arrays(friction)(row, *_motion(jax, pose, velocity, acceleration, wrench))


def jax_peaks(
    machines: ArrayLike,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    wrench: ArrayLike | None = None,
    friction: bool = True,
) -> Any:
    """Return the peaks (D, 3) [N] over a motion (N, 3) of machines (D, len(GIVEN)); as `jax_forces`."""
    jax = _jax()
    with jax.enable_x64(True):
        rows = _doubles(jax, "machines", machines, len(GIVEN))
        motion = _motion(jax, pose, velocity, acceleration, wrench)
        return _peaks(friction)(rows, *motion)


@cache
def _on_arrays(friction: bool) -> Callable[..., Any]:
    jax, traced = _jax(), forces_kernel(friction)
    given: Any = traced.model
    function = function_of(traced.tape, (*given, *traced.symbols), traced.results, jax.numpy)

    def forces(row: Any, *motion: Any) -> Any:
        columns = (each[..., i] for each in (row, *motion) for i in range(each.shape[-1]))
        return jax.numpy.stack(function(*columns), axis=-1)

    return jax.jit(forces)  # type: ignore[no-any-return]


@cache
def _peaks(friction: bool) -> Callable[..., Any]:
    jax, forces = _jax(), _on_arrays(friction)

    def peaks(rows: Any, *motion: Any) -> Any:
        return jax.numpy.abs(forces(rows[..., None, :], *motion)).max(axis=-2)

    return jax.jit(peaks)  # type: ignore[no-any-return]


def _motion(jax: Any, pose: Any, velocity: Any, acceleration: Any, wrench: Any) -> tuple[Any, ...]:
    load = _doubles(jax, "wrench", jax.numpy.zeros(6) if wrench is None else wrench, 6)
    names = "pose", "velocity", "acceleration"
    found = (_doubles(jax, *pair, 3) for pair in zip(names, (pose, velocity, acceleration), strict=True))
    return *found, load[..., jax.numpy.array(WRENCH_ROWS)]


def _doubles(jax: Any, name: str, value: Any, width: int) -> Any:
    """Return an array of doubles whose last axis is of a width; floats of JAX are refused, not widened."""
    found = jax.numpy.asarray(value)
    if found.shape[-1:] != (width,):
        raise InputError(f"{name}: expected shape (..., {width}), got {found.shape}")
    if found.dtype != "float64" and not jax.numpy.issubdtype(found.dtype, jax.numpy.integer):
        words = "call jax.jit, jax.vmap and jax.grad within jax.enable_x64(True)"
        raise InputError(f"{name}: expected doubles, got {found.dtype}: {words}")
    return found.astype("float64")


def _jax() -> Any:
    try:
        import jax
    except ImportError as error:
        raise MissingExtraError("functions of JAX arrays need jax: pip install 'p3dof[jax]'") from error
    return jax


def cuda_files(
    parameters: Parameters, bake: bool = False, prefix: str = PREFIX, command: str = ""
) -> dict[str, str]:
    """Return the file of CUDA C++ of a machine by its name; with friction where the machine has any."""
    traced = forces_kernel(bool(parameters.friction))
    prepared = [value.index for value in traced.constants]
    names = {symbol.index: f"p[{i}]" for i, symbol in enumerate(traced.model) if isinstance(symbol, Symbol)}
    prepare = statements(traced.tape, traced.tape.needed(traced.constants), names)
    prepare += [f"c[{i} * stride] = {names[index]};" for i, index in enumerate(prepared)]
    names = {index: f"c[{i} * stride]" for i, index in enumerate(prepared)}
    names |= {symbol.index: f"x[{i} * n]" for i, symbol in enumerate(traced.symbols)}
    sample = statements(traced.tape, work_of(traced), names, "sincos")
    sample += [f"f[{i}] = {text(result, names)};" for i, result in enumerate(traced.results)]
    note = origin_of(parameters, bake, prefix, command)
    values = {
        "inputs": str(len(traced.inputs)),
        "motion": ", ".join(traced.inputs),
        "parameters": str(len(GIVEN)),
        "constants": str(len(prepared)),
        "names": _lines(", ".join(GIVEN), " * ").removeprefix(" * "),
        "machine": _lines(", ".join(repr(value) for value in map(float, parameter_row(parameters))), INDENT),
        "prepare": textwrap.indent("\n".join(prepare), INDENT),
        "operations": str(sum(traced.operations(margin=True).values())),
        "sample": textwrap.indent("\n".join(sample), INDENT),
    }
    texts = {"p3dof_cuda.cu": fill("cuda.in", note="@{note}", **values)}
    return {name: found.replace("@{note}", note, 1) for name, found in renamed(texts, prefix).items()}


def _lines(words: str, before: str) -> str:
    return textwrap.fill(words, 110, initial_indent=before, subsequent_indent=before, break_long_words=False)
