"""Reciprocals that are taken two at a time: one division and three products instead of two divisions.

Processors divide vectors slowly, one division after the other, while several products are under way at once.
"""

from __future__ import annotations

from collections.abc import Sequence

from p3dof._base.tracing.tape import Number, Symbol, Tape


def in_pairs(tape: Tape, results: Sequence[Number]) -> list[Number]:
    """Return the same results with their reciprocals computed in pairs: 1/a = b · 1/(ab), 1/b = a · 1/(ab).

    Partners are neighbours on the tape among those with as many divisions before them, so that neither
    waits for the other. What depends on constants only stays as it is. Where one of a pair is not finite,
    both are not.

    Parameters
    ----------
    tape : Tape
        The operations; new ones are added.
    results : sequence of Symbol or float
        What is wanted.

    Returns
    -------
    list of Symbol or float
        In the same order.
    """
    places = tape.needed(results)
    partners = _partners(tape, places)
    new: dict[int, Number] = {}

    def value(old: Number) -> Number:
        if not isinstance(old, Symbol):
            return old
        if old.index not in new:
            operation = tape.operation(old)
            operands = [value(operand) for operand in operation.operands]
            if old.index in partners:
                other = value(tape.operations[partners[old.index]].operands[1])
                new[old.index] = other * (1 / (operands[1] * other))
            else:
                moved = any(a is not b for a, b in zip(operands, operation.operands, strict=True))
                new[old.index] = tape.repeat(operation, operands) if moved else old
        return new[old.index]

    for index in places:  # in their order, so that nothing waits long
        value(Symbol(tape, index))
    return [value(result) for result in results]


def _partners(tape: Tape, places: Sequence[int]) -> dict[int, int]:
    """Return the partner of every reciprocal that has one."""
    depth: dict[int, int] = {}
    alone: dict[int, int] = {}
    found: dict[int, int] = {}
    for index in places:
        operation = tape.operations[index]
        depth[index] = max((depth[o.index] for o in operation.operands if isinstance(o, Symbol)), default=0)
        if operation.name != "div" or tape.constant[index]:
            continue
        depth[index] += 1
        if operation.operands[0] != 1:
            continue
        other = alone.pop(depth[index], None)
        if other is None:
            alone[depth[index]] = index
        else:
            found |= {index: other, other: index}
    return found
