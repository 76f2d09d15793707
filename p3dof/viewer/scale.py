"""`ArrowScale`: how long the arrow of a force is drawn, and which force the legend's arrow stands for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.motion import states_of
from p3dof.methods import InverseDynamics
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.viewer.document.machine import Machine
from p3dof.viewer.stage import number

_POSES = 41
"""Along each axis of the poses that are looked at for forces at rest."""
_FAR = 4.0
"""Forces at rest beyond so many times the middle one are those near a singularity, which have no bound."""
_CUT = 1.01
"""An arrow may be so much longer than the longest: forces at rest are looked at in samples."""


@dataclass(frozen=True)
class ArrowScale:
    """Lengths of arrows: in proportion to the forces, the longest for the largest one.

    Parameters
    ----------
    newtons : float
        The largest force [N].
    metres : float
        The length of its arrow [m].
    low, high : float
        Between which heights the arrows are, tips included [m].
    words : str
        What the largest force is one of.
    """

    newtons: float
    metres: float
    low: float
    high: float
    words: str

    @classmethod
    def of_motion(cls, robot: Machine, result: InverseDynamics, *more: FloatArray) -> ArrowScale:
        """Return the scale for a motion.

        Parameters
        ----------
        robot : Manipulator
            The machine.
        result : InverseDynamics
            Its motion.
        *more : ndarray, shape (N, 3)
            Other forces that are to be shown in it, such as those at rest [N].

        Returns
        -------
        ArrowScale
            For the largest of all forces; where they are NaN there is no arrow.
        """
        forces = np.stack((result.forces, *more))
        return cls._of(robot, forces, result.sliders, "the largest force of the motion")

    @classmethod
    def of_forces(cls, robot: Machine, forces: FloatArray, sliders: FloatArray) -> ArrowScale:
        """Return the scale for one state.

        Parameters
        ----------
        robot : Manipulator
            The machine.
        forces : ndarray, shape (3,)
            Of the actuators [N].
        sliders : ndarray, shape (3,)
            Where they are [m].

        Returns
        -------
        ArrowScale
        """
        return cls._of(robot, forces, sliders, "the largest force shown")

    @classmethod
    def at_rest(cls, robot: Machine) -> ArrowScale:
        """Return the scale for a machine that is moved by hand: for what holds it at rest.

        That is the largest force over the poses within reach, travel and tilt, but not those near a
        singularity: forces beyond four times the middle one are left out.

        Parameters
        ----------
        robot : Manipulator
            The machine.

        Returns
        -------
        ArrowScale
        """
        geometry, tilt = robot.parameters.geometry, robot.parameters.limits.tilt
        reach = geometry.L - (geometry.R - geometry.r)
        y, theta = np.meshgrid(np.linspace(-reach, reach, _POSES), np.linspace(*tilt, _POSES))
        poses = np.stack((y, np.zeros_like(y), theta), axis=-1).reshape(-1, 3)
        states = states_of(poses, on_invalid="nan")
        forces = np.abs(VirtualPowerMethod(robot.parameters).forces(states))
        found = forces[np.isfinite(forces)]
        found = found[found <= _FAR * np.median(found)] if len(found) else found
        words = "about the largest force that holds the platform at rest"
        return cls._of(robot, found, np.full(found.shape, np.nan), words).by_hand(robot)

    @classmethod
    def _of(cls, robot: Machine, forces: FloatArray, sliders: FloatArray, words: str) -> ArrowScale:
        metres = robot.parameters.geometry.R
        largest = float(np.abs(forces[np.isfinite(forces)]).max(initial=0.0))
        if largest < np.finfo(float).tiny:  # no force at all
            limit = robot.parameters.limits.force
            largest, words = (limit, "the limit of the drives") if math.isfinite(limit) else (1.0, "1 N")
        ends = np.stack(np.broadcast_arrays(sliders, sliders + metres / largest * forces))
        ends = ends[np.isfinite(ends)]
        return cls(largest, metres, ends.min(initial=np.inf), ends.max(initial=-np.inf), words)

    def by_hand(self, robot: Machine) -> ArrowScale:
        """Return the same scale for a platform that is also moved by hand: all over the travel."""
        low, high = robot.parameters.limits.travel
        return replace(self, low=min(self.low, low - self.metres), high=max(self.high, high + self.metres))

    @property
    def reference(self) -> float:
        """The force of the legend's arrow: 1, 2 or 5 times a power of ten, at most the largest [N]."""
        power = 10.0 ** math.floor(math.log10(self.newtons))
        return max((step * power for step in (1, 2, 5) if step * power <= self.newtons), default=power)

    @property
    def legend(self) -> str:
        """What the arrows mean, in words."""
        return (
            f"The grey arrow is {number(self.reference)} N; "
            f"the longest is {number(self.newtons)} N, {self.words}."
        )

    def length(self, force: float) -> float:
        """Return how long the arrow of a force is [m], negative for one that points down.

        Parameters
        ----------
        force : float
            [N]

        Returns
        -------
        float
            In proportion to the force, but cut off for one that is `beyond` the largest.
        """
        return float(np.clip(force / self.newtons, -_CUT, _CUT) * self.metres)

    def beyond(self, force: float) -> bool:
        """Return whether a force is larger than the scale's largest, so that its arrow is cut off."""
        return bool(abs(force) > _CUT * self.newtons)
