"""Events of a run: functions of time and state that change their sign, as a user gives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError


@dataclass(frozen=True)
class Event:
    """Something that happens when a function of time and state passes through zero.

    Parameters
    ----------
    name : str
        What to call it.
    value : callable
        Takes the time [s], the configuration (nq,) and the velocity (nv,), and returns a number. It should
        change smoothly; what passes through zero and back within 2 ms may be overlooked.
    stops : bool
        Whether the run ends then; else it is noted in `RobotRun.events`.

    Raises
    ------
    InputError
        If the name is no text, or the value cannot be called.
    """

    name: str
    value: Callable[[float, FloatArray, FloatArray], Any]
    stops: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise InputError(f"event: expected a name, got {shown(self.name)}")
        if not callable(self.value):
            raise InputError(f"event {shown(self.name)}: expected a function, got {shown(self.value)}")

    def at(self, time: float, q: FloatArray, v: FloatArray) -> float:
        """Return the value at a time and state.

        Raises
        ------
        InputError
            If the function raises, or returns anything but a finite number; with the time.
        """
        try:
            value = np.asarray(self.value(time, q, v), dtype=float)
        except Exception as error:
            raise InputError(f"event {shown(self.name)} failed at t = {time:.6g} s: {error}") from error
        if value.size != 1 or not np.isfinite(value).all():
            raise InputError(
                f"event {shown(self.name)}: expected a finite number at t = {time:.6g} s, "
                f"got {shown(value.tolist())}"
            )
        return float(value.reshape(()))


@dataclass(frozen=True)
class Occurrence:
    """An event that did not end the run.

    Parameters
    ----------
    name : str
        Of the event.
    time : float
        When [s].
    rising : bool
        Whether its value rose through zero.
    """

    name: str
    time: float
    rising: bool

    def __str__(self) -> str:
        return f"{self.name} at t = {self.time:.6g} s"


def checked_events(events: Sequence[Event]) -> tuple[Event, ...]:
    """Return events with different names.

    Raises
    ------
    InputError
        If one is something else, or two have the same name.
    """
    if isinstance(events, str | Event) or not all(isinstance(event, Event) for event in events):
        raise InputError(f"events: expected a list of Event(...), got {shown(events)}")
    names = [event.name for event in events]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"events: two are called {shown(name)}")
    return tuple(events)
