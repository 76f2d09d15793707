"""The forces of any design at any sample as one traced formula on arrays, with its exact derivatives.

The same reduced formulas as the kernels, with friction and with what powers and margins need beside the
forces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.algebra import Vector, subtract
from p3dof._base.checks import FloatArray
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.derivatives import tangent
from p3dof._base.tracing.python import function_of
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import ACCELERATION, MODEL, POSE, VELOCITY, WRENCH
from p3dof.closed_form.compiled.reduced import Model, State
from p3dof.closed_form.compiled.reduced.friction import generalized_friction

INPUTS = (*POSE, *VELOCITY, *ACCELERATION, *WRENCH)
_OUTPUTS = 10
"""Three forces, slider positions and velocities, and the sine of the angle from the singularity."""


class Outputs(NamedTuple):
    """What a formula returns, or its derivative; arrays over designs and samples (D, N).

    Parameters
    ----------
    forces, sliders, speeds : sequence of ndarray
        Of A, B, C [N, m, m/s].
    sine : ndarray
        Of the angle from the actuation singularity.
    """

    forces: Sequence[FloatArray]
    sliders: Sequence[FloatArray]
    speeds: Sequence[FloatArray]
    sine: FloatArray


def outputs(numbers: Sequence[Any], inputs: Sequence[Any], namespace: Any = np) -> Outputs:
    """Return forces and what goes with them.

    Parameters
    ----------
    numbers : sequence
        Of the designs, as `Folded.numbers`: each a number or an array that broadcasts, (D, 1).
    inputs : sequence
        As `INPUTS`, likewise (D, N).
    namespace : module
        Where functions come from.

    Returns
    -------
    Outputs
    """
    return _grouped(_values(len(numbers), namespace)(*numbers, *inputs))


def derivatives(
    numbers: Sequence[Any],
    inputs: Sequence[Any],
    by_numbers: Sequence[Any],
    by_pose: Sequence[Any],
) -> Outputs:
    """Return how they change along a direction.

    Parameters
    ----------
    numbers, inputs
        As of `outputs`.
    by_numbers : sequence
        How the numbers change.
    by_pose : sequence
        How y, z and θ change.

    Returns
    -------
    Outputs
    """
    rates = (*by_numbers, *by_pose)
    moving = tuple(i for i, rate in enumerate(rates) if np.any(rate))  # the rest costs nothing
    return _grouped(_tangents(len(numbers), moving)(*numbers, *inputs, *(rates[i] for i in moving)))


def _grouped(found: Sequence[Any]) -> Outputs:
    return Outputs(found[:3], found[3:6], found[6:9], found[9])


class _Trace(NamedTuple):
    tape: Tape
    numbers: tuple[Symbol, ...]
    inputs: tuple[Symbol, ...]
    results: tuple[Number, ...]


def _trace(count: int) -> _Trace:
    tape = Tape()
    numbers = tape.symbols((f"n{i}" for i in range(count)), constant=True)
    model = Model.of_numbers(numbers[: len(MODEL)])
    inputs = tape.symbols(INPUTS)
    rows = dict(zip(INPUTS, inputs, strict=True))
    state = State(*(rows[name] for name in State._fields))
    x = reduced.shape(model, state.y, state.theta, tape)
    wrench: Vector = (rows[WRENCH[0]], rows[WRENCH[1]], rows[WRENCH[2]])
    friction = numbers[len(MODEL) :]
    if friction:
        half = len(friction) // 2
        coefficients = friction[:half], friction[half:-1], friction[-1]
        velocity = (rows["vy"], rows["vz"], rows["vtheta"])
        wrench = subtract(wrench, generalized_friction(x, state.y, velocity, coefficients, tape))
    forces = reduced.actuator_forces(model, x, state, tape, wrench)
    sliders = reduced.sliders(model, x, rows["z"], tape)
    speeds = (
        rows["vz"] - x.ta * state.vy,
        rows["vz"] + x.tb * state.vy,
        rows["vz"] - x.ty * state.vy + x.arm * state.vtheta,
    )
    sine = (x.arm * x.Sc) / (model.r * tape.sqrt(x.u2))
    return _Trace(tape, numbers, inputs, (*forces, *sliders, *speeds, sine))


@lru_cache(maxsize=32)
def _values(count: int, namespace: Any) -> Callable[..., tuple[Any, ...]]:
    trace = _trace(count)
    return function_of(trace.tape, (*trace.numbers, *trace.inputs), trace.results, namespace)


@lru_cache(maxsize=128)
def _tangents(count: int, which: tuple[int, ...]) -> Callable[..., tuple[Any, ...]]:
    trace = _trace(count)
    tape, movable = trace.tape, (*trace.numbers, *trace.inputs[:3])
    seeds = {movable[i].index: tape.symbol(f"d{i}") for i in which}
    moved = tangent(trace.results, dict(seeds))
    return function_of(tape, (*trace.numbers, *trace.inputs, *seeds.values()), moved, np)
