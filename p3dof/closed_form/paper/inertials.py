"""The inertial parameters of bodies as components: numbers or symbols, for formulas on scalars."""

from __future__ import annotations

from p3dof._base.algebra import Vector
from p3dof._base.checks import FloatArray
from p3dof.machine.parameters import Bodies
from p3dof.machine.parameters.body import Inertial

__all__ = ["Inertial", "inertials", "numbers"]


def inertials(bodies: Bodies) -> dict[str, Inertial]:
    """Return the numbers of bodies as components; exact zeros become structural ones and cost nothing."""
    return {
        name: Inertial(
            body.mass or 0,
            numbers(body.com),
            (numbers(body.inertia[0]), numbers(body.inertia[1]), numbers(body.inertia[2])),
        )
        for name, body in bodies.items()
    }


def numbers(row: FloatArray) -> Vector:
    """Return three Python numbers, exact zeros as structural ones."""
    return (float(row[0]) or 0, float(row[1]) or 0, float(row[2]) or 0)
