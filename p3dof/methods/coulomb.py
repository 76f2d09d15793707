"""`CoulombLimits`: Coulomb friction of joints that differs from sample to sample, as loads make it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from p3dof._base.checks import FloatArray


@dataclass(frozen=True, eq=False)
class CoulombLimits:
    """Coulomb friction of joints at N samples, besides what `Friction` says of the machine.

    Parameters
    ----------
    limits : mapping of str to ndarray, shape (N, axes)
        Largest force [N] or moment [N m] against each axis of a joint, by the names of `Friction`: one axis,
        or two of a universal joint (x0, then y0).
    smoothing : float
        The rate at which tanh(rate / smoothing) turns its sign [m/s, rad/s].
    screws : ndarray, shape (N, 3), optional
        What of those of the slides screws lose, between motor and nut [N].
    """

    limits: Mapping[str, FloatArray]
    smoothing: float
    screws: FloatArray | None = None
