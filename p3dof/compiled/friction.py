"""What friction takes in y, z, θ, for arrays of states, and how that moves the actuator forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from p3dof.algebra import BLOCK, components
from p3dof.checks import FloatArray
from p3dof.compiled.reduced import model_of, shape, solve_transposed
from p3dof.compiled.tracing import Number, Symbol, Tape, derivatives, straight_line
from p3dof.compiled.tracing.python import or_nan
from p3dof.paper.formulas import Lengths
from p3dof.paper.friction import generalized_losses, losses_of
from p3dof.parameters import Parameters

_Function = Callable[..., tuple[Any, ...]]


def losses(parameters: Parameters, pose: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the forces of y, z, θ that friction takes.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : ndarray, shape (N, 3)
        States; out of reach the result is NaN.

    Returns
    -------
    ndarray, shape (N, 3)
        [N, N, N m]
    """
    return _on_blocks(_losses(parameters), pose, velocity, 3).T


def loss_derivatives(parameters: Parameters, pose: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return how friction moves the actuator forces with pose and velocity: J⁻ᵀ ∂d/∂(x, ẋ).

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : ndarray, shape (N, 3)
        States; out of reach the result is NaN.

    Returns
    -------
    ndarray, shape (N, 3, 6)
    """
    found = _on_blocks(_loss_derivatives(parameters), pose, velocity, 18)
    return np.ascontiguousarray(found.reshape(6, 3, -1).transpose(2, 1, 0))


def losses_of_state(parameters: Parameters) -> Callable[..., tuple[float, ...]]:
    """Return what friction takes of one state as a function of numbers.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    callable
        (pose 3, velocity 3) → forces of y, z, θ 3 [N, N, N m]; NaN out of reach.
    """
    return or_nan(straight_line(_formula(parameters), 6), 3)


@lru_cache(maxsize=64)
def _losses(parameters: Parameters) -> _Function:
    return straight_line(_formula(parameters), 6, np)


def _formula(parameters: Parameters) -> Callable[..., Sequence[Number]]:
    lengths, friction = Lengths.of(parameters.geometry), losses_of(parameters.friction)

    def formula(tape: Tape, *x: Symbol) -> Sequence[Number]:
        return generalized_losses(lengths, components(x[:3]), components(x[3:]), friction, tape)

    return formula


@lru_cache(maxsize=64)
def _loss_derivatives(parameters: Parameters) -> _Function:
    lengths, friction, model = (
        Lengths.of(parameters.geometry),
        losses_of(parameters.friction),
        model_of(parameters),
    )

    def formula(tape: Tape, *x: Symbol) -> Sequence[Number]:
        lost = generalized_losses(lengths, components(x[:3]), components(x[3:]), friction, tape)
        where = shape(model, x[0], x[2], tape)
        columns = zip(*derivatives(lost, x), strict=True)
        return [entry for column in columns for entry in solve_transposed(where, column)]

    return straight_line(formula, 6, np)


def _on_blocks(function: _Function, pose: FloatArray, velocity: FloatArray, width: int) -> FloatArray:
    found = np.empty((width, len(pose)))
    with np.errstate(all="ignore"):  # out of reach is told elsewhere
        for start in range(0, len(pose), BLOCK):
            block = slice(start, start + BLOCK)
            for row, values in zip(found, function(*pose[block].T, *velocity[block].T), strict=True):
                row[block] = values
    return found
