"""Wrenches from outside on frames of any robot over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.sidecar import suggestion
from p3dof.machine.motion import Load, WrenchHistory, WrenchOverTime

ExternalOverTime: TypeAlias = Mapping[str, WrenchOverTime]
"""Frame name → wrench (6,) that stays, or a function of time, as `p3dof.WrenchHistory`."""


class Loads:
    """Wrenches on frames, one after the other.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    external : mapping of str to array-like (6,) or callable, optional
        Force [N] and moment [N m] on each frame, in world axes at its origin; or functions of one time since
        the start of the run [s].

    Raises
    ------
    InputError
        If a frame does not exist, or what acts on it is no wrench.
    """

    def __init__(self, loop: ClosedLoopModel, external: ExternalOverTime | None) -> None:
        if external is not None and not isinstance(external, Mapping):
            raise InputError(f"external: expected a mapping of frames to wrenches, got {shown(external)}")
        given = dict(external or {})
        known = [str(frame.name) for frame in loop.model.frames]
        for name in given:
            if name not in known:
                raise InputError(
                    f"external: the frame {shown(name)} does not exist; {suggestion(str(name), known)}"
                )
        self.frames = tuple(given)
        self._loads = {name: Load(wrench) for name, wrench in given.items()}
        self.kinks = np.unique(
            np.concatenate([np.zeros(0), *(w.time for w in given.values() if isinstance(w, WrenchHistory))])
        )
        """Times at which a wrench changes its slope [s]."""
        self.watched = any(callable(w) and not isinstance(w, WrenchHistory) for w in given.values())
        """Whether a function acts that could change unseen between two steps."""
        self._held = None if any(map(callable, given.values())) else self._now(0.0)

    def __call__(self, time: float) -> FloatArray:
        """Return the wrenches at a time since the start [s], one after the other, (6 k,)."""
        return self._now(time) if self._held is None else self._held

    @property
    def stays(self) -> bool:
        """Whether all wrenches stay as they are."""
        return self._held is not None

    def over(self, times: FloatArray) -> dict[str, FloatArray]:
        """Return the wrenches (N, 6) on each frame at times (N,)."""
        rows = np.array([self(float(time)) for time in times]).reshape(len(times), -1, 6)
        return {name: rows[:, i] for i, name in enumerate(self.frames)}

    def _now(self, time: float) -> FloatArray:
        found = [_wrench(name, load, time) for name, load in self._loads.items()]
        return np.concatenate([np.zeros(0), *found])


def _wrench(name: str, load: Load, time: float) -> FloatArray:
    try:
        return load.at(time)
    except InputError as error:
        raise InputError(f"external {shown(name)}: {error}") from error
