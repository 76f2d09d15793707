"""Rates of configurations: quaternions and circles move along their tangent space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from p3dof._base.tracing import Number, Symbol, Tape
from p3dof.loops.compiled.formulas import At
from p3dof.loops.compiled.tree import Tree
from p3dof.loops.compiled.vectors import dot

_UNITS = {"unbounded": 2, "planar": 2, "ball": 4, "free": 4}
"""How many numbers at the end of a joint's q have length one."""


def seeds_of(at: At, free: Mapping[int, Number]) -> dict[int, Number]:
    """Return how q changes along a direction of the independent coordinates, by place on the tape."""
    rates = at.completed(free, [0.0] * len(at.rows))
    found: dict[int, Number] = {}
    for part in at.robot.tree.parts[1:]:
        q, x = [at.q[i] for i in part.q], [rates[i] for i in part.v]
        for symbol, rate in zip(q, _RATES[part.kind](q, x), strict=True):
            assert isinstance(symbol, Symbol)  # noqa: S101 - q are inputs
            found[symbol.index] = rate
    return found


def moved(at: At, shift: Mapping[int, Number]) -> list[Number]:
    """Return q moved along the tangent space, to second order, with unit circles and quaternions."""
    found = list(at.q)
    for part in at.robot.tree.parts[1:]:
        if not any(place in shift for place in part.v):
            continue
        q, x = [at.q[i] for i in part.q], [shift.get(i, 0.0) for i in part.v]
        new = [value + rate for value, rate in zip(q, _RATES[part.kind](q, x), strict=True)]
        for place, value in zip(part.q, _normalised(at.tape, part.kind, new), strict=True):
            found[place] = value
    return found


def rates_of(at: At, v: Sequence[Number]) -> list[Number]:
    """Return how q changes with a velocity."""
    found: list[Number] = [0.0] * len(at.q)
    for part in at.robot.tree.parts[1:]:
        rates = _RATES[part.kind]([at.q[i] for i in part.q], [v[i] for i in part.v])
        for place, rate in zip(part.q, rates, strict=True):
            found[place] = rate
    return found


def with_units(tree: Tree, tape: Tape, q: Sequence[Number]) -> list[Number]:
    """Return q with circles and quaternions of length one."""
    found = list(q)
    for part in tree.parts[1:]:
        values = _normalised(tape, part.kind, [q[i] for i in part.q])
        for place, value in zip(part.q, values, strict=True):
            found[place] = value
    return found


def units(at: At) -> list[list[Number]]:
    """Return the circles and quaternions in q."""
    parts = at.robot.tree.parts[1:]
    return [[at.q[i] for i in part.q[-_UNITS[part.kind] :]] for part in parts if part.kind in _UNITS]


def _normalised(tape: Tape, kind: str, q: list[Number]) -> list[Number]:
    size = _UNITS.get(kind, 0)
    if not size:
        return q
    kept, unit = q[:-size], q[-size:]
    inverse = tape.divide(1.0, tape.sqrt(dot(unit, unit)))
    return [*kept, *(x * inverse for x in unit)]


def _ball_rate(q: Sequence[Number], x: Sequence[Number]) -> list[Number]:
    """Return the rate of a quaternion by an angular velocity in the body's axes."""
    qx, qy, qz, qw = q
    a, b, c = (value * 0.5 for value in x)
    return [
        qw * a + qy * c - qz * b,
        qw * b + qz * a - qx * c,
        qw * c + qx * b - qy * a,
        -(qx * a + qy * b + qz * c),
    ]


def _free_rate(q: Sequence[Number], x: Sequence[Number]) -> list[Number]:
    qx, qy, qz, qw = q[3:]
    vx, vy, vz = x[:3]
    # R v = v + 2 w (u x v) + 2 u x (u x v)
    tx, ty, tz = (qy * vz - qz * vy) * 2.0, (qz * vx - qx * vz) * 2.0, (qx * vy - qy * vx) * 2.0
    return [
        vx + qw * tx + qy * tz - qz * ty,
        vy + qw * ty + qz * tx - qx * tz,
        vz + qw * tz + qx * ty - qy * tx,
        *_ball_rate(q[3:], x[3:]),
    ]


def _planar_rate(q: Sequence[Number], x: Sequence[Number]) -> list[Number]:
    c, s = q[2:]
    return [c * x[0] - s * x[1], s * x[0] + c * x[1], -(s * x[2]), c * x[2]]


_RATES: dict[str, Callable[[Sequence[Number], Sequence[Number]], list[Number]]] = {
    "revolute": lambda _q, x: [x[0]],
    "helical": lambda _q, x: [x[0]],
    "prismatic": lambda _q, x: [x[0]],
    "unbounded": lambda q, x: [-(q[1] * x[0]), q[0] * x[0]],
    "translation": lambda _q, x: list(x),
    "planar": _planar_rate,
    "ball": _ball_rate,
    "free": _free_rate,
}
"""Rates of q by those of v."""
