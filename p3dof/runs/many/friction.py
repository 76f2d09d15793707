"""Friction of the joints in many runs: how quickly it slows each machine down, and so how short steps are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.many import MOST_STEPS
from p3dof.closed_form.compiled.reduced import Model
from p3dof.closed_form.compiled.reduced.friction import TOGETHER, gradients
from p3dof.runs.many.plan import Task

CAREFULLY = 0
"""Instead of a number of parts: by DOP853 from the beginning."""

_OF_DECAY = 0.5
"""Longest step in time constants of friction."""

_MOST_PARTS = 64


def have_friction(model: tuple[Any, ...], count: int) -> NDArray[np.bool_]:
    """Return which machines have friction.

    Parameters
    ----------
    model : tuple of numbers or ndarray, shape (R,)
        The 36 of `Model.numbers`; and those of `FRICTION` where joints have friction.
    count : int
        How many machines.

    Returns
    -------
    ndarray of bool, shape (R,)
    """
    found = np.zeros(count, dtype=bool)
    for number in model[len(MODEL) : -1]:
        found |= np.broadcast_to(np.asarray(number) != 0, count)
    return found


def parts_of_steps(task: Task, model: tuple[Any, ...], y: Any, theta: Any, count: int) -> NDArray[np.int64]:
    """Return into how many parts the steps of each run are cut, or `CAREFULLY`.

    A run's own friction and start count only, so that it does not depend on the others.

    Parameters
    ----------
    task : Task
        What is asked of every run.
    model : tuple of numbers or ndarray, shape (R,)
        As of `have_friction`.
    y, theta : float or ndarray, shape (R,)
        Where runs start [m, rad].
    count : int
        How many runs.

    Returns
    -------
    ndarray of int, shape (R,)
        Powers of two.
    """
    parts = np.ones(count, np.int64)
    if len(model) == len(MODEL):
        return parts
    most = min(float(_MOST_PARTS), (MOST_STEPS - 2) * task.step / task.tick)
    wanted = np.broadcast_to(decay_rates(model, y, theta), count) * task.step / _OF_DECAY
    parts[wanted > 1] = CAREFULLY
    part = 1
    while part <= most:
        parts[(parts == CAREFULLY) & (wanted <= part)] = part
        part *= 2
    return parts


def decay_rates(model: tuple[Any, ...], y: Any, theta: Any) -> FloatArray:
    """Return how quickly friction slows machines down that hardly move: the sum of the three decay rates.

    Parameters
    ----------
    model : tuple of 55 numbers or ndarray, shape (R,)
        `Model.numbers` and those of `FRICTION`.
    y, theta : float or ndarray, shape (R,)
        Where they are [m, rad].

    Returns
    -------
    ndarray
        [1/s]; NaN out of reach.
    """
    numbers, friction = Model.of_numbers(model[: len(MODEL)]), model[len(MODEL) :]
    size = len(TOGETHER)
    with np.errstate(all="ignore"):
        x = reduced.shape(numbers, y, theta, np)
        (yy, yz, yt), (_, zz, zt), (_, _, tt) = reduced.mass_matrix(numbers, x, y, np)
        inverse = (  # times the determinant
            (zz * tt - zt * zt, yt * zt - yz * tt, yz * zt - yt * zz),
            (yt * zt - yz * tt, yy * tt - yt * yt, yz * yt - yy * zt),
            (yz * zt - yt * zz, yz * yt - yy * zt, yy * zz - yz * yz),
        )
        determinant = yy * inverse[0][0] + yz * inverse[0][1] + yt * inverse[0][2]
        total = 0.0 * (np.asarray(y) + theta)
        for k, gradient in enumerate(gradients(x, y, np)):
            slope = friction[k] + friction[size + k] * friction[-1]
            products = (
                g * entry * h
                for g, row in zip(gradient, inverse, strict=True)
                for h, entry in zip(gradient, row, strict=True)
            )
            total = total + slope * sum(products)
        return np.asarray(total / determinant, dtype=float)
