"""The numbers of a machine as the functions in C take them, and how they follow from its parameters.

Traced formulas again on another tape, with some of their values replaced by numbers or other symbols.

So one trace serves many machines: with the numbers of one put in, what is known is computed and what is zero
vanishes.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from functools import cache

from p3dof._base.errors import ParameterError
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced.dynamics import FRICTION, JOINTS, folded
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.machine.parameters import LINKS, SLIDES, Parameters
from p3dof.machine.parameters.body import Inertial

_ON_NUMBERS: dict[str, Callable[..., float]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "min": min,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
}
_ON_TAPE = {
    "add": "add",
    "sub": "subtract",
    "mul": "multiply",
    "div": "divide",
    "neg": "negate",
    "min": "minimum",
}


def replay(
    source: Tape, results: Sequence[Number], known: MutableMapping[int, Number], tape: Tape
) -> list[Number]:
    """Return results of one tape on another."""
    for index in source.needed(results, known):
        operation = source.operations[index]
        operands = [_value(operand, known) for operand in operation.operands]
        if any(isinstance(operand, Symbol) for operand in operands):
            known[index] = getattr(tape, _ON_TAPE.get(operation.name, operation.name))(*operands)
        else:
            known[index] = _ON_NUMBERS[operation.name](*operands)
    return [_value(result, known) for result in results]


def _value(value: Number, known: Mapping[int, Number]) -> Number:
    return known[value.index] if isinstance(value, Symbol) else value


MACHINE = (*MODEL, *FRICTION)  # the numbers of a machine

NOT_NUMBERS = "the numbers of this machine are too large or too small for double precision"
"""What is wrong with a machine whose numbers overflow."""

INERTIA = ("xx", "xy", "xz", "yy", "yz", "zz")  # order of the entries of an inertia in C


def body_names(link: str) -> list[str]:
    """Return the names of the ten numbers of a body."""
    return [f"{link}.mass", *(f"{link}.com{i}" for i in range(3)), *(f"{link}.{name}" for name in INERTIA)]


ACTUATORS = ("armature", "counterbalance", "spring", "counterweight")
"""What motors, screws and counterbalances have at each slider."""

GIVEN = (
    *("r", "R", "L", "gx", "gy", "gz"),
    *(name for link in LINKS for name in body_names(link)),
    *(f"{kind}.{joint}" for kind in ("viscous", "coulomb") for joint in JOINTS),
    "smoothing",
    *(f"{kind}.{slide}" for kind in ACTUATORS for slide in SLIDES),
)
"""The parameters of a machine in a row."""


@cache
def preparation() -> tuple[Tape, dict[str, Symbol], list[Number]]:
    """Return how the numbers of a machine, `MACHINE`, follow from its parameters, `GIVEN`."""
    tape = Tape()
    given = dict(zip(GIVEN, tape.symbols(GIVEN), strict=True))
    r, R, L = given["r"], given["R"], given["L"]
    h = tape.sqrt((L - (R - r)) * (L + (R - r)))
    bodies = {link: _inertial([given[name] for name in body_names(link)]) for link in LINKS}
    base = reduced.fold(Lengths(r, R, L, 0, h), bodies)
    viscous, coulomb = (
        folded({joint: given[f"{kind}.{joint}"] for joint in JOINTS}) for kind in ("viscous", "coulomb")
    )
    rows = ([given[f"{kind}.{slide}"] for slide in SLIDES] for kind in ACTUATORS)
    actuated = reduced.fold_actuators(rows, given["gz"])
    lengths_and_gravity = [given[name] for name in MODEL[:6]]
    return tape, given, [*lengths_and_gravity, *base, *actuated, *viscous, *coulomb, 1 / given["smoothing"]]


def parameter_row(parameters: Parameters) -> list[float]:
    """Return the parameters of a machine in the order of `GIVEN`."""
    geometry, friction = parameters.geometry, parameters.friction
    row = [geometry.r, geometry.R, geometry.L, *parameters.gravity.tolist()]
    for _, body in tuple(parameters.bodies.items()):
        I = body.inertia  # noqa: E741 - the inertia
        six = (I[0, 0], I[0, 1], I[0, 2], I[1, 1], I[1, 2], I[2, 2])
        row += [body.mass, *body.com.tolist(), *(float(value) for value in six)]
    row += [friction.viscous.get(joint, 0.0) for joint in JOINTS]
    row += [friction.coulomb.get(joint, 0.0) for joint in JOINTS]
    row.append(friction.smoothing)
    return row + [of.get(slide, 0.0) for of in parameters.actuators.mappings for slide in SLIDES]


def limit_row(parameters: Parameters) -> list[float]:
    """Return the limits of a machine as C has them: travel, speed, force, tilt; six numbers."""
    limits = parameters.limits
    return [*limits.travel, limits.speed, limits.force, *limits.tilt]


def _inertial(row: list[Symbol]) -> Inertial:
    m, cx, cy, cz, xx, xy, xz, yy, yz, zz = row
    return Inertial(m, (cx, cy, cz), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))


def machine_numbers(row: Sequence[float]) -> dict[str, float]:
    """Return the numbers of a machine by name of `MACHINE` from its parameters in the order of `GIVEN`."""
    tape, given, numbers = preparation()
    known: dict[int, Number] = {
        symbol.index: value for symbol, value in zip(given.values(), row, strict=True)
    }
    try:
        found = replay(tape, numbers, known, Tape())
    except (ArithmeticError, ValueError) as error:
        raise ParameterError(NOT_NUMBERS) from error
    return {name: finite_number(value) for name, value in zip(MACHINE, found, strict=True)}


def finite_number(value: Number) -> float:
    """Return a value that is known and finite, or raise ParameterError."""
    if isinstance(value, Symbol) or not math.isfinite(value):
        raise ParameterError(NOT_NUMBERS)
    return float(value)
