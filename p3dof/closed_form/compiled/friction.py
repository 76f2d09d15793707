"""What friction takes in y, z, θ, for arrays of states, and how that moves the actuator forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from p3dof._base.algebra import BLOCK, components
from p3dof._base.checks import FloatArray
from p3dof._base.tracing import Number, Symbol, Tape, derivatives, straight_line
from p3dof._base.tracing.python import or_nan
from p3dof.closed_form.compiled.reduced import Model, model_of, shape, solve_transposed
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.closed_form.paper.friction import generalized_losses, losses_of
from p3dof.machine.parameters import Parameters

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


def loss_by_lengths(
    parameters: Parameters, pose: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the actuator forces against friction, J⁻ᵀ d, and how they change with r, R and L.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : ndarray, shape (N, 3)
        States; out of reach the result is NaN.

    Returns
    -------
    forces : ndarray, shape (N, 3)
        [N]
    by_lengths : ndarray, shape (N, 3, 3)
        [N/m]
    """
    found = _on_blocks(_loss_by_lengths(parameters), pose, velocity, 12)
    rows = found.reshape(3, 4, -1).transpose(2, 0, 1)
    return np.ascontiguousarray(rows[..., 0]), np.ascontiguousarray(rows[..., 1:])


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


@lru_cache(maxsize=64)
def _loss_by_lengths(parameters: Parameters) -> _Function:
    g, friction = parameters.geometry, losses_of(parameters.friction)
    own = model_of(parameters).numbers

    def formula(tape: Tape, *symbols: Symbol) -> Sequence[Number]:
        r, R, L, *x = symbols
        lengths = Lengths(r, R, L, g.b, tape.sqrt((L - (R - r)) * (L + (R - r))))
        lost = generalized_losses(lengths, components(x[:3]), components(x[3:]), friction, tape)
        where = shape(Model.of_numbers((r, R, L, *own[3:])), x[0], x[2], tape)
        forces = solve_transposed(where, lost)
        rows = zip(forces, derivatives(forces, (r, R, L)), strict=True)
        return [entry for force, row in rows for entry in (force, *row)]

    function = straight_line(formula, 9, np)
    return lambda *x: function(g.r, g.R, g.L, *x)


def _on_blocks(function: _Function, pose: FloatArray, velocity: FloatArray, width: int) -> FloatArray:
    found = np.empty((width, len(pose)))
    with np.errstate(all="ignore"):  # out of reach is told elsewhere
        for start in range(0, len(pose), BLOCK):
            block = slice(start, start + BLOCK)
            for row, values in zip(found, function(*pose[block].T, *velocity[block].T), strict=True):
                row[block] = values
    return found
