"""`Limits`: what the actuators can do, and how far the platform may turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

from p3dof._base.checks import frozen_array, positive
from p3dof._base.errors import ParameterError


@dataclass(frozen=True)
class Limits:
    """What the actuators can do, and how far the platform may turn; the paper gives none of these.

    Parameters
    ----------
    travel : tuple of float
        Lowest and highest slider position [m]; home (0) lies between.
    speed : float
        Largest slider speed [m/s].
    force : float
        Largest actuator force [N].
    tilt : tuple of float
        Smallest and largest platform rotation θ [rad]; home (0) lies between.

    Raises
    ------
    ParameterError
        If a number is not finite, not positive where it must be, or a range does not hold home.
    """

    travel: tuple[float, float] = (-0.2, 0.2)
    speed: float = 2.0
    force: float = 500.0
    tilt: tuple[float, float] = (-math.pi / 4, math.pi / 4)

    def __post_init__(self) -> None:
        for name in ("travel", "tilt"):
            low, high = (float(end) for end in frozen_array(name, getattr(self, name), (2,), ParameterError))
            if not low < 0 < high:
                raise ParameterError(f"{name}: expected a range around 0 (home), got [{low:g}, {high:g}]")
            object.__setattr__(self, name, (low, high))
        for name in ("speed", "force"):
            object.__setattr__(self, name, positive(name, getattr(self, name), ParameterError))
