"""What ends a run of any plant: margins that must stay positive, and the reason when one does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from p3dof._base.checks import FloatArray


@dataclass(frozen=True)
class Stop:
    """Why and when a run ended before its time.

    Parameters
    ----------
    kind : str
        What ended it, one of `p3dof.runs.KINDS` for the manipulator, of
        `p3dof.runs.ROBOT_KINDS` for any robot, ``"event"`` for an event; ``"accuracy"`` when the
        integrator could not go on, ``"controller"`` when the controller failed.
    time : float
        When [s].
    reason : str
        In words.
    """

    kind: str
    time: float
    reason: str

    def __str__(self) -> str:
        return f"{self.kind} at t = {self.time:.6g} s: {self.reason}"


class Margins(Protocol):
    """How far a plant is from everything that can end a run: m numbers, positive inside."""

    def __call__(self, time: float, state: FloatArray) -> FloatArray:
        """Return the margins of a state at a time, shape (m,); at least one."""

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state at a time, and those a short time ahead at its present velocity."""

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""


class Unlimited:
    """Margins of a plant that nothing stops."""

    def __call__(self, time: float, state: FloatArray) -> FloatArray:  # noqa: ARG002 - as the others
        """Return that there is room everywhere."""
        return np.array([np.inf])

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return that there is room, and stays."""
        return self(time, state), self(time, state)

    def stop(self, index: int, time: float) -> Stop:
        """Never asked for: no margin is ever crossed."""
        raise AssertionError(f"margin {index} at t = {time:g} s")
