"""`Waypoint`: where the platform has to go, and what happens there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, positive, shown
from p3dof._base.errors import TaskError
from p3dof.machine.parameters import Body


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A pose of the platform on its way, and what happens there.

    Parameters
    ----------
    pose : array-like, shape (3,) or (2,)
        y, z [m] and θ [rad]. A waypoint that is passed without a stop may leave θ out: the platform turns
        smoothly from the stop before it to the stop after it.
    name : str
        What tables and messages call it; its number without one.
    blend : float
        How far before and after the waypoint the path leaves its straight lines, to pass it without a stop
        [m, in the metric of `Task`]; zero to stop there.
    dwell : float
        How long the platform stays at a stop [s].
    duration : float, optional
        How long the platform takes to this stop from the one before it [s]; shared out without it.
    pick_up : Body, optional
        What the platform carries from here on, in its own frame; it does so when the dwell begins.
    put_down : bool
        Whether the platform leaves here what it carries, at the end of the dwell.
    wrench : array-like, shape (6,), optional
        External force and moment on the platform at P, in the fixed frame, on the way from the waypoint
        before it to this one [N, N m]; none without it.
    blend_range : array-like, shape (2,), optional
        Least and largest blend when the best path is looked for [m]; it stays without it.
    tolerance : array-like, shape (2,) or (3,), optional
        How far y, z and, where the pose has one, θ may be from the pose when the best path is looked for, to
        either side [m, m, rad], at a waypoint that is passed; not at all without it.

    Raises
    ------
    TaskError
        If an argument does not fit, or something is to happen at a waypoint that is passed without a stop.
    """

    pose: FloatArray
    name: str = ""
    blend: float = 0.0
    dwell: float = 0.0
    duration: float | None = None
    pick_up: Body | None = None
    put_down: bool = False
    wrench: FloatArray = field(default_factory=lambda: np.zeros(6))
    blend_range: FloatArray | None = None
    tolerance: FloatArray | None = None

    def __init__(
        self,
        pose: ArrayLike,
        name: str = "",
        blend: float = 0.0,
        dwell: float = 0.0,
        duration: float | None = None,
        pick_up: Body | None = None,
        put_down: bool = False,
        wrench: ArrayLike | None = None,
        blend_range: ArrayLike | None = None,
        tolerance: ArrayLike | None = None,
    ) -> None:
        if not isinstance(name, str):
            raise TaskError(f"name: expected a text, got {shown(name)}")
        where = f"waypoint {name}: " if name else ""
        place = frozen_array(f"{where}pose", pose, ("K",), TaskError)
        if len(place) not in (2, 3):
            raise TaskError(f"{where}pose: expected y, z, θ or y, z, got {len(place)} numbers")
        if pick_up is not None and not isinstance(pick_up, Body):
            raise TaskError(f"{where}pick_up: expected a Body, got {shown(pick_up)}")
        if not isinstance(put_down, bool):
            raise TaskError(f"{where}put_down: expected true or false, got {shown(put_down)}")
        set_ = object.__setattr__
        set_(self, "pose", place)
        set_(self, "name", name)
        set_(self, "blend", _from_zero(f"{where}blend", blend))
        set_(self, "dwell", _from_zero(f"{where}dwell", dwell))
        set_(
            self, "duration", None if duration is None else positive(f"{where}duration", duration, TaskError)
        )
        set_(self, "pick_up", pick_up)
        set_(self, "put_down", put_down)
        load = np.zeros(6) if wrench is None else wrench
        set_(self, "wrench", frozen_array(f"{where}wrench", load, (6,), TaskError))
        set_(self, "blend_range", None if blend_range is None else self._range(where, blend_range))
        set_(self, "tolerance", None if tolerance is None else self._tolerance(where, tolerance))
        self._check(where)

    @property
    def stops(self) -> bool:
        """Whether the platform comes to rest here."""
        return self.blend == 0.0

    def _range(self, where: str, value: ArrayLike) -> FloatArray:
        bounds = frozen_array(f"{where}blend_range", value, (2,), TaskError)
        if not 0 < bounds[0] <= self.blend <= bounds[1]:
            raise TaskError(
                f"{where}blend_range: expected least and largest blend above zero around "
                f"blend = {self.blend:g} m, got {bounds[0]:g} and {bounds[1]:g} m"
            )
        return bounds

    def _tolerance(self, where: str, value: ArrayLike) -> FloatArray:
        bounds = frozen_array(f"{where}tolerance", value, (len(self.pose),), TaskError)
        if (bounds < 0).any():
            raise TaskError(f"{where}tolerance: expected zero or more, got {bounds.min():g}")
        if self.stops:
            raise TaskError(f"{where}tolerance: expected at a waypoint that is passed, with a blend, only")
        return bounds

    def _check(self, where: str) -> None:
        if self.stops:
            if len(self.pose) == 2:
                raise TaskError(f"{where}pose: expected y, z, θ at a stop, got y, z")
            return
        happens = {
            "dwell": self.dwell > 0,
            "duration": self.duration is not None,
            "pick_up": self.pick_up is not None,
            "put_down": self.put_down,
        }
        for name, set_here in happens.items():
            if set_here:
                raise TaskError(
                    f"{where}{name}: expected at a stop only, but blend = {self.blend:g} m passes it"
                )


def _from_zero(name: str, value: float) -> float:
    number = float(frozen_array(name, value, (), TaskError))
    if number < 0:
        raise TaskError(f"{name}: expected zero or more, got {number:g}")
    return number
