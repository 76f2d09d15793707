"""`Room`: the measures of what stands around the machine, and what belongs to which leg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.description.shapes import LEG_A, LEG_B, LEG_C
from p3dof.machine.parameters import LEGS as ACTUATORS
from p3dof.machine.parameters import Dimensions, Parameters
from p3dof.viewer.document.measures import above, enlargement, mesh_of

LEGS = tuple(leg.lower() for leg in ACTUATORS)
COLOURS = {"a": LEG_A.rgba, "b": LEG_B.rgba, "c": LEG_C.rgba}
"""Red, green, blue and opacity of what belongs to a leg."""
LINKS_OF_LEGS = {
    "a": ("slider_a", "leg_a"),
    "b": ("slider_b", "leg_b"),
    "c": ("slider_c", "crossbar_upper", "rod_left", "crossbar_lower", "rod_right"),
}
"""The bodies of each leg."""
GLASS = (0.62, 0.66, 0.70, 0.45)
"""Colour of the frame, which stands between the eye and the legs."""


@dataclass(frozen=True)
class Room:
    """Measures of the surroundings of a machine [m].

    Parameters
    ----------
    size : Dimensions
        Sizes of its solids.
    radius : float
        Distance of the guide-ways from the middle.
    bottom, top : float
        Heights of the floor and of the letters over the frame.
    travel : tuple of float
        Lowest and highest slider position.
    """

    size: Dimensions
    radius: float
    bottom: float
    top: float
    travel: tuple[float, float]

    @classmethod
    def around(cls, parameters: Parameters) -> Room:
        """Measure the surroundings of a machine."""
        geometry, size = parameters.geometry, Dimensions.scaled(parameters.geometry)
        low, high = parameters.limits.travel
        bottom = low - geometry.h - geometry.r
        return cls(size, geometry.R, bottom, high + 2.6 * size.slider_edge, (low, high))

    @property
    def corners(self) -> FloatArray:
        """What the camera must see of the machine, shape (N, 3)."""
        feet = [above(0.6 * pivot, self.bottom) for pivot in self.pivots.values()]
        heads = [above(pivot, self.top + self.letter / 2) for pivot in self.pivots.values()]
        return np.stack((*feet, *heads))

    @property
    def letter(self) -> float:
        """Height of the letters of the legs."""
        return max(self.size.slider_edge, 0.08 * self.half)

    @property
    def half(self) -> float:
        """Half the height of the machine, more or less."""
        return max((self.top - self.bottom) / 2, 1.3 * self.radius)

    @property
    def scale(self) -> float:
        """By how much the machine is drawn larger than it is: 1 unless it is far from a metre."""
        return enlargement(self.half)

    @property
    def pivots(self) -> dict[str, FloatArray]:
        """Where the sliders' axes stand, by leg."""
        R = self.radius
        return {
            "a": np.array([0.0, -R, 0.0]),
            "b": np.array([0.0, R, 0.0]),
            "c": np.array([-R, 0.0, 0.0]),
        }

    @property
    def mesh(self) -> float:
        """Distance between the lines of the floor."""
        return mesh_of(self.half)
