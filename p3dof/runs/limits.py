"""What ends a run: the ends of a slider's travel, the tilt's, a leg at its reach, a singular pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

import numpy as np

from p3dof._base.algebra import Scalar
from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.tracing import Tape, straight_line
from p3dof.closed_form.kinematics.validity import reach_margins
from p3dof.closed_form.paper.formulas import Lengths, configuration
from p3dof.machine.parameters import LEGS, Geometry, Parameters
from p3dof.runs.margins import Stop

KINDS = ("slider stop", "tilt limit", "reach limit", "singular pose")
"""What can end a run; the reach limit always does."""

HORIZONTAL = 1e-3
"""A leg is at its reach when its drop is this share of its length: .06° from horizontal."""

_REACH = slice(8, 11)  # where the legs' reach is among the margins


class Limiter:
    """How far a pose is from everything that can end a run; not positive is beyond it.

    Parameters
    ----------
    parameters : Parameters
        The machine and its limits.
    stop_at : tuple of str
        Which of `KINDS` count.
    pose : ndarray, shape (3,)
        Where the run starts: the singular pose is to be crossed from its side.
    drops : ndarray, shape (3,), optional
        As in `__call__`.

    Raises
    ------
    InputError
        If a kind is unknown, or the run starts beyond a limit.
    """

    def __init__(
        self, parameters: Parameters, stop_at: Sequence[str], pose: FloatArray, drops: FloatArray | None
    ) -> None:
        kinds = [stop_at] if isinstance(stop_at, str) or not isinstance(stop_at, Iterable) else list(stop_at)
        unknown = [kind for kind in kinds if kind not in KINDS]
        if unknown or isinstance(stop_at, str):
            raise InputError(f"stop_at: expected a list of {', '.join(KINDS)}, got {shown(stop_at)}")
        self._geometry = parameters.geometry
        limits = parameters.limits
        self._values = _values(parameters.geometry)
        low, high = limits.travel
        down, up = limits.tilt
        names = [("slider stop", f"slider {leg} at its lower end, {low:g} m") for leg in LEGS]
        names += [("slider stop", f"slider {leg} at its upper end, {high:g} m") for leg in LEGS]
        names += [("tilt limit", f"the platform at {angle:g} rad") for angle in (down, up)]
        names += [("reach limit", f"leg {leg} horizontal") for leg in LEGS]
        names += [("singular pose", "the sliders cannot hold the platform's rotation (det J = 0)")]
        self._names = names
        counted = np.array([kind in kinds or kind == "reach limit" for kind, _ in names])
        self._offset = np.where(counted, 0.0, np.inf)
        self._bounds = np.array([low] * 3 + [high] * 3 + [down, up] + [HORIZONTAL] * 3 + [0.0])
        self._sign = np.array([1.0] * 3 + [-1.0] * 3 + [1.0, -1.0] + [1.0] * 4)
        self._sign[-1] = np.sign(self._values(*pose.tolist())[-1]) or 1.0
        margins = self(pose, drops)
        if margins.min() <= 0:
            kind, reason = names[int(np.argmin(margins))]
            raise InputError(f"pose: the run would start beyond a limit: {kind}: {reason}")

    def __call__(self, pose: FloatArray, drops: FloatArray | None = None) -> FloatArray:
        """Return the margins of a pose (3,): positive inside, shape (12,).

        A mechanism that is integrated in its joints can swing a leg through the horizontal, where its pose
        turns back: its `drops` (3,), shares of the legs' lengths, then tell, being negative beyond.
        """
        try:
            values = np.array(self._values(*pose.tolist()))
        except (ValueError, ArithmeticError):  # beyond reach there are no angles
            margins = np.full(len(self._names), np.inf)
            margins[_REACH] = np.minimum(reach_margins(self._geometry, pose), 0.0)
            return margins
        if drops is not None:
            values[_REACH] = drops
        return np.asarray(self._sign * (values - self._bounds) + self._offset)

    @property
    def watched(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bounds, signs and whether they count, shape (12,): margins are sign (value - bound)."""
        return self._bounds, self._sign, (self._offset == 0).astype(float)

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        kind, reason = self._names[index]
        return Stop(kind, time, reason)


@lru_cache(maxsize=64)
def _values(geometry: Geometry) -> Callable[..., tuple[float, ...]]:
    """Return what has limits, of a pose."""
    lengths = Lengths.of(geometry)

    def formula(tape: Tape, *pose: Scalar) -> list[Scalar]:
        x = configuration(lengths, (pose[0], pose[1], pose[2]), tape)
        return [*x.sliders, *x.sliders, pose[2], pose[2], x.cos_a, x.cos_b, x.cos_c, x.cos_54]

    return straight_line(formula, 3)
