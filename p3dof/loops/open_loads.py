"""Which of all possible reactions is taken: the least squares (2) of `reactions`, or the least energy.

Reactions are stacked, 6 a joint; a change of them that rigid bodies leave open is a column.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof.loops.batch.linear import apply
from p3dof.loops.compliance import JointCompliance, factor
from p3dof.loops.linear import RANK_TOLERANCE

Weighting: TypeAlias = Callable[[FloatArray], FloatArray]
"""Takes wrenches (N, 6 m, k) to rows whose squares are to be small."""


@dataclass(frozen=True, eq=False)
class Measure:
    """What is smallest where rigid bodies leave a choice: (2), or the complementary energy.

    Parameters
    ----------
    length : float
        What compares moments with forces in (2) [m].
    compliances : tuple of JointCompliance, optional
        Of all joints and closures: then their energy is smallest.
    misfit : (n + c, 6) array, optional
        By how much each joint may be out of place when it is assembled [m, rad].
    """

    length: float
    compliances: tuple[JointCompliance, ...] | None = None
    misfit: FloatArray | None = None

    @property
    def links(self) -> tuple[int, ...]:
        """Which joints have a link before them that gives way."""
        each = self.compliances or ()
        return tuple(i for i, one in enumerate(each) if one.before is not None)


def weighting(measure: Measure, turns: Mapping[int, FloatArray]) -> Weighting:
    """Return the weighting of a measure.

    Parameters
    ----------
    measure : Measure
        What is to be smallest.
    turns : mapping of int to (N, 6, 6) array
        Of joints with a link before them, what takes their wrench to the axes of that link.

    Returns
    -------
    callable
    """
    if measure.compliances is None:
        row = np.array([1.0] * 3 + [1.0 / measure.length] * 3)
        return lambda X: np.tile(row, X.shape[1] // 6)[:, None] * X
    own = np.array([factor(one.own) for one in measure.compliances])
    turned = {i: factor(_before(measure.compliances[i])) @ turn for i, turn in turns.items()}

    def rows(X: FloatArray) -> FloatArray:
        each = X.reshape(len(X), -1, 6, X.shape[-1])
        parts = [(own @ each).reshape(X.shape), *(S @ each[:, i] for i, S in turned.items())]
        return np.concatenate(parts, axis=1)

    return rows


def _before(one: JointCompliance) -> FloatArray:
    return np.zeros((6, 6)) if one.before is None else one.before


def steps_to_least(all_: FloatArray, change: FloatArray, coupled: bool) -> FloatArray:
    """Return how much of each open change (N, m, k) to take away, (N, k), for the least squares."""
    if change.shape[-1] == 0:
        return np.zeros((len(change), 0))
    if coupled:  # changes of couplings alone move nothing here, and stay out
        inverse = np.linalg.pinv(change, rcond=RANK_TOLERANCE)
        return apply(np.asarray(inverse, dtype=np.float64), all_)
    Q, R = _factored(change)
    return np.asarray(np.linalg.solve(R, np.swapaxes(Q, -1, -2) @ all_[..., None])[..., 0])


def _factored(change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and R of weighted changes, which must all count."""
    Q, R = np.linalg.qr(change)
    diagonal = np.abs(np.diagonal(R, axis1=-2, axis2=-1))
    if (diagonal <= RANK_TOLERANCE * diagonal.max(axis=-1, keepdims=True)).any():
        raise ModelError(
            "compliances: they leave loads open: in some way that loads can change, nothing gives way"
        )
    return Q, R


def fit_of(misfit: FloatArray, change: FloatArray, weighted: FloatArray) -> FloatArray:
    """Return what misfits within their tolerances add at worst, and at random, (2, N, m, 6)."""
    if change.shape[-1] == 0:
        return np.zeros((2, len(change), *misfit.shape))
    _, R = _factored(weighted)
    B = np.swapaxes(np.linalg.solve(np.swapaxes(R, -1, -2), np.swapaxes(change, -1, -2)), -1, -2)
    H = np.abs(B @ np.swapaxes(B, -1, -2))
    tolerance = misfit.ravel()
    both = np.stack([H @ tolerance, np.sqrt(H**2 @ tolerance**2)])
    return both.reshape(2, len(change), *misfit.shape)
