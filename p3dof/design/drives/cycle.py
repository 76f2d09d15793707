"""`Cycle`: what repeats: forces and motion of the three sliders over a cycle, dwells included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from p3dof._base.checks import FloatArray, FrozenArrays, frozen_array
from p3dof._base.errors import DriveError
from p3dof.design.drives.checked import from_zero


class Moved(Protocol):
    """Forces over a motion: an `InverseDynamics` or a `TaskForces`."""

    @property
    def possible(self) -> bool:
        """Whether all samples are valid."""

    @property
    def time(self) -> FloatArray:
        """Times of the samples, shape (N,) [s]."""

    @property
    def nut_forces(self) -> FloatArray:
        """Forces of the actuators without what armatures take, shape (N, 3) [N]."""

    @property
    def slider_velocities(self) -> FloatArray:
        """Shape (N, 3) [m/s]."""

    @property
    def slider_accelerations(self) -> FloatArray:
        """Shape (N, 3) [m/s²]."""


@dataclass(frozen=True, eq=False)
class Cycle(FrozenArrays):
    """Forces and motion of the sliders over a cycle.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times, rising; two samples of one time are a step [s].
    force, speed, acceleration : ndarray, shape (N, 3)
        Of the sliders A, B, C: forces without reflected mass [N], [m/s], [m/s²].
    rest : float
        How long the machine rests after the last sample, with the forces that it has there at rest [s].
    holding : ndarray, shape (3,)
        Those forces [N].

    Raises
    ------
    DriveError
        If shapes do not fit, a number is not finite, or times fall.
    """

    time: FloatArray
    force: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    rest: float = 0.0
    holding: FloatArray = None  # type: ignore[assignment]  # made below

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        time = frozen_array("time", self.time, ("N",), DriveError)
        if len(time) < 2 or (np.diff(time) < 0).any() or time[-1] <= time[0]:
            raise DriveError("time: expected at least two times that do not fall")
        set_(self, "time", time)
        for name in ("force", "speed", "acceleration"):
            set_(self, name, frozen_array(name, getattr(self, name), (len(time), 3), DriveError))
        set_(self, "rest", from_zero("rest", self.rest))
        held = self.force[-1] if self.holding is None else self.holding
        set_(self, "holding", frozen_array("holding", held, (3,), DriveError))

    @property
    def duration(self) -> float:
        """How long a cycle takes [s]."""
        return float(self.time[-1] - self.time[0]) + self.rest

    @property
    def resting(self) -> FloatArray:
        """Which intervals between samples are at rest, shape (N-1,) of 0 and 1."""
        still = ((self.speed == 0) & (self.acceleration == 0)).all(axis=1)
        return np.asarray((still[1:] & still[:-1]).astype(float))


def cycle_of(found: Moved, rest: float = 0.0, holding: FloatArray | None = None) -> Cycle:
    """Return the cycle of forces over a motion or a task.

    Parameters
    ----------
    found : InverseDynamics or TaskForces
        The forces.
    rest : float
        How long the machine rests afterwards, besides the dwells of a task [s].
    holding : ndarray, shape (3,), optional
        Forces at that rest [N]; those of the last sample without them.

    Returns
    -------
    Cycle

    Raises
    ------
    DriveError
        If the motion is not possible, or an argument does not fit.
    """
    if not found.possible:
        raise DriveError("the machine cannot make this motion: there is nothing to size")
    columns = found.nut_forces, found.slider_velocities, found.slider_accelerations
    return Cycle(found.time, *columns, rest, holding)  # type: ignore[arg-type]
