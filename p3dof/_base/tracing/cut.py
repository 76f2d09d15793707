"""A formula cut into two parts, so that each can be a short loop of its own with few values between them."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from p3dof._base.tracing.tape import Symbol, Tape

LATENCY = {"div": 24, "sqrt": 30, "rsqrt": 50, "sin": 48, "cos": 48, "tanh": 110, "atan2": 120, "neg": 1}
"""About how many cycles the result of an operation on vectors takes; all others take 4."""

MIDDLE = 0.4, 0.6
"""Where the cut is looked for, as shares of the longest chain of operations."""

_SUMS = ("add", "sub", "neg")
_MUST = 1 << 30

_Capacities: TypeAlias = "defaultdict[Hashable, dict[Hashable, int]]"


class Parts(NamedTuple):
    """The two parts of a formula, each in the order of the tape."""

    first: list[int]
    second: list[int]
    between: list[int]
    """What the first part computes and the second needs."""


def in_two(tape: Tape, places: Sequence[int]) -> Parts:
    """Return operations in two parts with the fewest values between them, cut in the middle.

    This is a minimum cut of the graph of operations. What begins before the middle is not in the second
    part and what ends after it not in the first; an operation is in the first part only if its operands are.
    A product stays with the sums that take it, where only sums do: a compiler that fuses them rounds as it
    does without a cut.

    Parameters
    ----------
    tape : Tape
        The operations.
    places : sequence of int
        Those of them that are done for each sample, from `Tape.needed`.

    Returns
    -------
    Parts
    """
    ends = _ends(tape, places)
    uses: dict[int, list[int]] = {index: [] for index in places}
    for index in places:
        for operand in dict.fromkeys(_operands(tape, index)):
            if operand in uses:
                uses[operand].append(index)
    first = _nearest(_graph(tape, uses, ends))
    return Parts(
        [index for index in places if index in first],
        [index for index in places if index not in first],
        [index for index in places if index in first and not first.issuperset(uses[index])],
    )


def _operands(tape: Tape, index: int) -> list[int]:
    return [operand.index for operand in tape.operations[index].operands if isinstance(operand, Symbol)]


def _latency(tape: Tape, index: int) -> int:
    return LATENCY.get(tape.operations[index].name, 4)


def _ends(tape: Tape, places: Sequence[int]) -> dict[int, int]:
    """Return when each operation ends if none waits but for its operands."""
    found: dict[int, int] = {}
    for index in places:
        start = max((found.get(operand, 0) for operand in _operands(tape, index)), default=0)
        found[index] = start + _latency(tape, index)
    return found


def _graph(tape: Tape, uses: Mapping[int, Sequence[int]], ends: Mapping[int, int]) -> _Capacities:
    """Return capacities from "first" to "second": whoever stays with "first" is in the first part."""
    early, late = (share * max(ends.values(), default=0) for share in MIDDLE)
    found: _Capacities = defaultdict(dict)
    waves: dict[Hashable, int] = {}
    for index, users in uses.items():
        operation, value = tape.operations[index], ("value", index)
        for operand in _operands(tape, index):
            if operand in uses:
                found[index][operand] = _MUST
        stays = operation.name in ("mul", "neg") and {tape.operations[u].name for u in users} <= set(_SUMS)
        found[index][value] = _MUST if stays else 1
        found[value] |= dict.fromkeys(users, _MUST)
        if ends[index] <= early and not stays:
            found["first"][index] = _MUST
        if ends[index] - _latency(tape, index) >= late:
            found[index]["second"] = _MUST
        if operation.name in ("sin", "cos"):  # one call computes both
            other = waves.setdefault(tuple(_operands(tape, index)), index)
            if other != index:
                found[index][other] = found[other][index] = _MUST
    return found


def _nearest(capacities: _Capacities) -> set[Hashable]:
    """Return what a minimum cut leaves with "first": what it reaches after the largest flow.

    By the method of Ford and Fulkerson.
    """
    left: _Capacities = defaultdict(dict)
    for start, row in capacities.items():
        for end, capacity in row.items():
            left[start][end] = capacity
            left[end].setdefault(start, 0)
    while "second" in (before := _reached(left)):
        at: Hashable = "second"
        while at != "first":
            start = before[at]
            left[start][at] -= 1
            left[at][start] += 1
            at = start
    return set(before)


def _reached(left: Mapping[Hashable, Mapping[Hashable, int]]) -> dict[Hashable, Hashable]:
    """Return from where each node is reached first."""
    found: dict[Hashable, Hashable] = {"first": "first"}
    waiting: deque[Hashable] = deque(["first"])
    while waiting:
        start = waiting.popleft()
        for end, capacity in left[start].items():
            if capacity > 0 and end not in found:
                found[end] = start
                waiting.append(end)
    return found
