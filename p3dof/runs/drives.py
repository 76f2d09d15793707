"""Drives whose forces lag behind what is asked of them, with a first-order lag.

Where commands are held the forces are known exactly at any time; where they change continuously the forces
are states of the plant.
"""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.runs.plants import Plant


class Lag:
    """Forces that follow commands which stay for a while: ḟ = 2π b (command - f), solved exactly.

    Parameters
    ----------
    bandwidth : ndarray, shape (n,)
        b of each drive [Hz]; where it is infinite the force is the command.
    """

    def __init__(self, bandwidth: FloatArray) -> None:
        self._rates = 2 * np.pi * bandwidth
        self._since = 0.0
        self._begun: FloatArray = np.zeros(0)
        self._command: FloatArray = self._begun

    def follow(self, time: float, command: FloatArray) -> None:
        """Take another command (n,) from a time on [s]; drives have settled at the first one."""
        self._begun = self.at(time) if len(self._command) else command
        self._since, self._command = time, command

    def at(self, time: float) -> FloatArray:
        """Return the forces at a time since then, (n,) [N or N m]."""
        after = time - self._since
        rest = np.exp(-self._rates * after) if after > 0 else np.where(np.isinf(self._rates), 0.0, 1.0)
        return np.asarray(self._command + (self._begun - self._command) * rest)


class DrivenPlant:
    """A plant behind its drives: the forces on it follow the commands, ḟ = 2π b (command - f).

    Its state is that of the plant, followed by the n forces.

    Parameters
    ----------
    plant : Plant
        What they drive.
    bandwidth : ndarray, shape (n,)
        b of each drive [Hz]; where it is infinite the force is the command.
    """

    def __init__(self, plant: Plant, bandwidth: FloatArray) -> None:
        self._plant, self._count = plant, len(bandwidth)
        self._at_once = ~np.isfinite(bandwidth)
        self._rates = 2 * np.pi * np.where(self._at_once, 0.0, bandwidth)

    def begin(self, state: FloatArray, forces: FloatArray) -> FloatArray:
        """Return the state for one of the plant, whose drives have settled at forces (n,)."""
        return np.concatenate([state, forces])

    def delivered(self, state: FloatArray, command: FloatArray) -> FloatArray:
        """Return the forces on the plant, (n,) [N or N m]."""
        return np.where(self._at_once, command, state[-self._count :])

    def rate(self, state: FloatArray, command: FloatArray, load: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""
        own, forces = state[: -self._count], self.delivered(state, command)
        lag = np.where(self._at_once, 0.0, self._rates * (command - forces))
        return np.concatenate([self._plant.rate(own, forces, load), lag])

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of the actuated joints, (n,) each."""
        return self._plant.actuated(state)
