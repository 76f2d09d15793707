"""Drives whose forces lag behind what is asked of them: a first-order lag in front of any plant."""

from __future__ import annotations

import numpy as np

from p3dof.checks import FloatArray
from p3dof.simulation.plants import Plant


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
