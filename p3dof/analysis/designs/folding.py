"""Columns of designs to columns of the few numbers that the dynamics need, by the formulas of one machine.

The formulas are traced with one symbol a column; what no column moves is computed once. `tangents` are those
of the same trace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.algebra import Scalar, add, matrix_sum, plus, times
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.printing import function_of
from p3dof._base.tracing.tape import tangent
from p3dof.analysis.designs.columns import (
    ACTUATORS,
    DENSITY,
    GRAVITY,
    KINDS,
    LENGTHS,
    SIZES,
    BodiesOfDesigns,
    by_joint_of,
)
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced import Actuated, Moments, fold_actuators, fold_moments, moments_of
from p3dof.closed_form.compiled.reduced.dynamics import folded
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.machine.parameters import LINKS, SLIDES, Body, Dimensions, Parameters
from p3dof.machine.parameters.body import Inertial, inertials, numbers
from p3dof.machine.parameters.solids import inertials_of_solids, scales

_MASSLESS = Inertial(0, (0, 0, 0), ((0, 0, 0), (0, 0, 0), (0, 0, 0)))
_FUNCTION = Callable[..., tuple[Any, ...]]


class Folded(NamedTuple):
    """What the forces of designs depend on."""

    numbers: tuple[Any, ...]
    """The 36 of `p3dof.closed_form.compiled.reduced.Model.numbers`, then the coefficients of friction and
    its smoothing: each a number, or a column (D,)."""


@dataclass(frozen=True, eq=False)
class Folding:
    """The traced formulas of some columns."""

    tape: Tape  # their operations
    inputs: dict[str, Symbol]  # the columns, and sizes of solids that follow from lengths
    results: tuple[Number, ...]  # as `Folded.numbers`
    machine: Parameters  # what has no column

    @property
    def friction(self) -> bool:
        """Whether designs have friction."""
        return len(self.results) > len(MODEL)

    def fold(self, columns: Mapping[str, Any]) -> Folded:
        """Return the numbers of designs."""
        with np.errstate(all="ignore"):
            given = {**columns, **self._sizes(columns)}
            return Folded(self._values(*(given[name] for name in self.inputs)))

    def tangents(self, columns: Mapping[str, Any], name: str) -> tuple[Any, ...]:
        """Return how the numbers of `Folded` change with one column; each a number, or a column (D,)."""
        with np.errstate(all="ignore"):
            given = {**columns, **self._sizes(columns)}
            moved = {name: 1.0, **self._size_rates(columns, name)}
            values = [given[each] for each in self.inputs]
            return self._tangents(*values, *(moved.get(each, 0.0) for each in self.inputs))

    @property
    def _values(self) -> _FUNCTION:
        return _values_of(self)

    @property
    def _tangents(self) -> _FUNCTION:
        return _tangents_of(self)

    def _ratios(self, columns: Mapping[str, Any]) -> tuple[Any, ...]:
        geometry = self.machine.geometry
        return scales(*(columns.get(name, getattr(geometry, name[-1])) for name in LENGTHS))

    def _derived(self, columns: Mapping[str, Any]) -> list[str]:
        return [name for name in self.inputs if name in SIZES and name not in columns]

    def _sizes(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Return sizes that follow from the lengths: the paper's, scaled as `Dimensions.scaled` does."""
        derived = self._derived(columns)
        if not derived:
            return {}
        L, r, b, width = self._ratios(columns)
        ratio = np.minimum(np.minimum(np.minimum(L, r), b), width)
        return {name: ratio * getattr(Dimensions(), name.partition(".")[2]) for name in derived}

    def _size_rates(self, columns: Mapping[str, Any], name: str) -> dict[str, Any]:
        """Return how these change with a column: one of the ratios, the smallest, counts."""
        derived = self._derived(columns)
        if not derived or name not in LENGTHS:
            return {}
        ratios = self._ratios(columns)
        ahead = self._ratios({name: 1.0, **{each: 0.0 for each in LENGTHS if each != name}})
        least, rate = ratios[0], ahead[0] + np.zeros_like(ratios[0])
        for ratio, change in zip(ratios[1:], ahead[1:], strict=True):
            rate = np.where(ratio < least, change, rate)
            least = np.minimum(ratio, least)
        return {each: rate * getattr(Dimensions(), each.partition(".")[2]) for each in derived}


@lru_cache(maxsize=64)
def _values_of(folding: Folding) -> _FUNCTION:
    return function_of(folding.tape, list(folding.inputs.values()), folding.results, np)


@lru_cache(maxsize=64)
def _tangents_of(folding: Folding) -> _FUNCTION:
    tape, inputs = folding.tape, list(folding.inputs.values())
    seeds = [tape.symbol(f"d_{name}", constant=True) for name in folding.inputs]
    moved = tangent(folding.results, {symbol.index: seed for symbol, seed in zip(inputs, seeds, strict=True)})
    return function_of(tape, [*inputs, *seeds], moved, np)


@lru_cache(maxsize=64)
def folding_of(names: tuple[str, ...], machine: Parameters, bodies: BodiesOfDesigns) -> Folding:
    """Trace the formulas of some columns."""
    tape = Tape()
    inputs = {name: tape.symbol(name, constant=True) for name in names if not name.startswith("limits.")}
    lengths = _lengths(inputs, machine, tape)
    moments = _moments(inputs, lengths, machine, bodies, tape)
    gravity = [inputs.get(name, float(g) or 0) for name, g in zip(GRAVITY, machine.gravity, strict=True)]
    results = [lengths.r, lengths.R, lengths.L, *gravity, *fold_moments(lengths, moments)]
    results += _actuators(inputs, machine, gravity[2])
    results += _friction(inputs, machine)
    exact = tuple(value if isinstance(value, Symbol) else value or 0 for value in results)
    return Folding(tape, inputs, exact, machine)


def _lengths(inputs: Mapping[str, Symbol], machine: Parameters, tape: Tape) -> Lengths:
    r, R, L, b = (inputs.get(name, getattr(machine.geometry, name[-1])) for name in LENGTHS)
    if not any(name in inputs for name in LENGTHS[:3]):
        return Lengths(r, R, L, b, machine.geometry.h)
    width = R - r
    return Lengths(r, R, L, b, tape.sqrt((L - width) * (L + width)))


def _moments(
    inputs: dict[str, Symbol], lengths: Lengths, machine: Parameters, bodies: BodiesOfDesigns, tape: Tape
) -> dict[str, Moments]:
    if bodies == "solids":
        own = asdict(machine.sizes)
        if any(name in inputs for name in LENGTHS):  # sizes that follow from these are symbols, too
            follow = {f"dimensions.{name}" for name in own.keys() - machine.dimensions.keys()}
            inputs.update({name: tape.symbol(name, constant=True) for name in sorted(follow - inputs.keys())})
        links = _links(lengths, own, inputs, machine)
        carried = [_inertial(payload) for payload in machine.payloads]
    else:
        links, carried = inertials(machine.bodies), []
    moments = {}
    for link in LINKS:
        kind = next(kind for kind, several in KINDS.items() if link in several)
        if link == "platform" and carried and _given(inputs, "bodies.platform."):
            links[link] = _joined([links[link], *carried])
            carried = []
        replaced = _replaced(links[link], _given(inputs, f"bodies.{kind}."))
        moments[link] = moments_of(_replaced(replaced, _given(inputs, f"bodies.{link}.")))
    payload = _given(inputs, "payload.")
    if payload:
        carried.append(_replaced(_MASSLESS, payload))
    for body in carried:
        moments["platform"] = _together(moments["platform"], moments_of(body))
    return moments


def solids_of(columns: Mapping[str, Any], machine: Parameters) -> dict[str, Inertial]:
    """Return the bodies of designs by link, made of solids, before columns replace numbers or arrays (D,)."""
    r, R, L, b = (columns.get(name, getattr(machine.geometry, name[-1])) for name in LENGTHS)
    ratio = np.min(np.broadcast_arrays(*scales(r, R, L, b)), axis=0)
    own = {item: ratio * size for item, size in asdict(Dimensions()).items()} | dict(machine.dimensions)
    found = _links(Lengths(r, R, L, b, np.sqrt((L - R + r) * (L + R - r))), own, columns, machine)
    if machine.payloads:
        found["platform"] = _joined([found["platform"], *map(_inertial, machine.payloads)])
    return found


def _links(
    lengths: Lengths, own: Mapping[str, Any], columns: Mapping[str, Any], machine: Parameters
) -> dict[str, Inertial]:
    """Return bodies of solids by link; sizes without a column are one's `own`."""
    size = {name: columns.get(f"dimensions.{name}", value) for name, value in own.items()}
    density = dict.fromkeys(KINDS, columns[DENSITY]) if DENSITY in columns else machine.density
    by_kind = inertials_of_solids(lengths, size, density)
    return {link: by_kind[kind] for kind, several in KINDS.items() for link in several}


def _given(inputs: Mapping[str, Symbol], prefix: str) -> dict[str, Symbol]:
    return {name.removeprefix(prefix): symbol for name, symbol in inputs.items() if name.startswith(prefix)}


def _replaced(body: Inertial, numbers: Mapping[str, Scalar]) -> Inertial:
    com, inertia = list(body.com), [list(row) for row in body.inertia]
    for name, value in numbers.items():
        what, _, axes = name.partition(".")
        places = ["xyz".index(axis) for axis in axes]
        if what == "com":
            com[places[0]] = value
        elif what == "inertia":
            inertia[places[0]][places[1]] = inertia[places[1]][places[0]] = value
    return Inertial(numbers.get("mass", body.mass), tuple(com), tuple(map(tuple, inertia)))  # type: ignore[arg-type]  # threes


def _together(one: Moments, other: Moments) -> Moments:
    return Moments(
        plus(one.mass, other.mass), add(one.first, other.first), matrix_sum(one.second, other.second)
    )


def _joined(bodies: list[Inertial]) -> Inertial:
    """Return the one body that several, all of them numbers or all but the first, make together."""
    total = moments_of(bodies[0])
    for body in bodies[1:]:
        total = _together(total, moments_of(body))
    com = tuple(times(1 / total.mass, part) for part in total.first)
    own = moments_of(Inertial(total.mass, com, _MASSLESS.inertia)).second
    rest = tuple(
        tuple(plus(a, -b) for a, b in zip(*rows, strict=True)) for rows in zip(total.second, own, strict=True)
    )
    return Inertial(total.mass, com, rest)  # type: ignore[arg-type]  # threes


def _inertial(body: Body) -> Inertial:
    rows = [numbers(row) for row in body.inertia]
    return Inertial(body.mass or 0, numbers(body.com), (rows[0], rows[1], rows[2]))


def _actuators(inputs: Mapping[str, Symbol], machine: Parameters, gz: Any) -> Actuated:
    """Return the numbers of motors, screws and counterbalances."""
    own, given = machine.actuators, _given(inputs, ACTUATORS)
    rows = []
    for item in fields(own):
        by_slide = {**getattr(own, item.name), **by_joint_of(given, item.name)}
        rows.append([by_slide.get(slide, 0) for slide in SLIDES])
    return fold_actuators(rows, gz)


def _friction(inputs: Mapping[str, Symbol], machine: Parameters) -> list[Any]:
    """Return the numbers of friction in the order of `FRICTION`; none where there is none."""
    given, friction = _given(inputs, "friction."), machine.friction
    viscous, coulomb = (
        {**getattr(friction, kind), **by_joint_of(given, kind)} for kind in ("viscous", "coulomb")
    )
    if not any(isinstance(value, Symbol) or value for value in (*viscous.values(), *coulomb.values())):
        return []
    return [*folded(viscous), *folded(coulomb), 1 / given.get("smoothing", friction.smoothing)]


def column_or_number(value: Any, index: Any) -> Any:
    """Return what belongs to some designs of a column, or the number that is that of all."""
    return value[index] if isinstance(value, np.ndarray) and value.ndim else value
