"""The machine as it is drawn: what is asked of it, its joints at poses, the measures of what is around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats, shown
from p3dof._base.errors import InputError
from p3dof.closed_form import kinematics
from p3dof.loops import ClosedLoopModel
from p3dof.machine.description.shapes import LEG_A, LEG_B, LEG_C
from p3dof.machine.parameters import LEGS as ACTUATORS
from p3dof.machine.parameters import Dimensions, Parameters
from p3dof.methods import InverseDynamics
from p3dof.viewer.document.figure import Drawable
from p3dof.viewer.stage import above, enlargement


class Machine(Drawable, Protocol):
    """The manipulator, as `p3dof.Manipulator` is it: also with its measures, and forces over a motion."""

    @property
    def parameters(self) -> Parameters:
        """Its measures and limits."""

    @property
    def bare_loop(self) -> ClosedLoopModel:
        """The same with its loop closures."""

    @property
    def inverse_dynamics(self) -> Callable[..., InverseDynamics]:
        """Takes a `Motion`, a method and a wrench; returns the forces of the actuators."""


def require_machine(robot: object) -> None:
    """Raise unless something is a manipulator."""
    drawn = all(hasattr(robot, name) for name in ("model", "visual_model", "inverse_dynamics"))
    if not drawn or not isinstance(getattr(robot, "parameters", None), Parameters):
        raise InputError(f"robot: expected a Manipulator, got {shown(robot)}")


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
RAIL = (0.373, 0.42, 0.463, 1.0)
"""Colour of the guides."""
AXES = {"x": (0.698, 0.133, 0.133, 1.0), "y": (0.18, 0.49, 0.196, 1.0), "z": (0.122, 0.306, 0.62, 1.0)}
"""Colours of the axes of the fixed frame."""
TRACE = (0.482, 0.122, 0.635, 1.0)
"""Colour of P and its path."""


@dataclass(frozen=True)
class Room:
    """Measures of the surroundings of a machine [m]."""

    size: Dimensions  # sizes of its solids
    radius: float  # distance of the guides from the middle
    bottom: float  # heights of the floor and of the letters over the frame
    top: float
    travel: tuple[float, float]  # lowest and highest slider position
    b: float  # half the width of the parallelogram

    @classmethod
    def around(cls, parameters: Parameters) -> Room:
        """Measure the surroundings of a machine."""
        geometry, size = parameters.geometry, parameters.sizes
        low, high = parameters.limits.travel
        bottom = low - geometry.h - geometry.r
        return cls(size, geometry.R, bottom, high + 2.6 * size.slider_edge, (low, high), geometry.b)

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
        return {"a": np.array([0.0, -R, 0.0]), "b": np.array([0.0, R, 0.0]), "c": np.array([-R, 0.0, 0.0])}

    @property
    def beside(self) -> dict[str, FloatArray]:
        """Where the force of each leg's actuator is drawn, beside its slider, in the slider's axes."""
        edge = self.size.slider_edge
        shifts = {"a": -1.2 * edge, "b": 1.2 * edge, "c": self.b + 0.7 * edge}
        return {leg: np.array([0.0, shift, 0.0]) for leg, shift in shifts.items()}

    @property
    def rails(self) -> tuple[float, float, float]:
        """Lower and upper end of the guides, and their radius."""
        low, high = self.travel
        edge = self.size.slider_edge
        return low - 0.7 * edge, high + edge, 0.35 * self.size.rod_radius

    @property
    def names(self) -> dict[str, FloatArray]:
        """Where the letters of the legs are."""
        height = self.top - self.size.slider_edge + self.letter / 2
        return {leg: above(pivot, height) for leg, pivot in self.pivots.items()}

    @property
    def axes(self) -> tuple[float, float]:
        """Length and radius of the axes of the fixed frame."""
        return 0.35 * self.radius, 0.25 * self.size.rod_radius


_PROUD = 1.04
"""How much larger the platform's skin is than its solids."""


def skin_of(r: float, size: Dimensions) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return vertices and faces of the plate: the triangle A3 B3 C5 about P, widened by the corner radius."""
    corners = np.array([(0.0, r), (-r, 0.0), (0.0, -r)])  # B3, C5, A3, counter-clockwise
    turns = [(0.0, 3 / 4), (3 / 4, 5 / 4), (5 / 4, 2.0)]  # π times where the edges beside them face
    angles = np.concatenate([np.linspace(start * np.pi, end * np.pi, 13) for start, end in turns])
    around = np.repeat(corners, 13, axis=0)
    rim = around + size.corner_radius * _PROUD * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    half = size.plate_thickness / 2 * _PROUD
    low, high = (np.column_stack((rim, np.full(len(rim), z))) for z in (-half, half))
    vertices = np.concatenate((low, high, low, high))  # the walls, then the covers: edges stay sharp
    n = len(rim)
    i = np.arange(n)
    j, fan = (i + 1) % n, np.arange(1, n - 1)
    walls = np.concatenate((np.stack((i, j, n + j), axis=1), np.stack((i, n + j, n + i), axis=1)))
    cover = np.stack((np.zeros_like(fan), fan, fan + 1), axis=1)
    return vertices, np.concatenate((walls, 2 * n + cover[:, ::-1], 3 * n + cover))


def joints_of(robot: Machine, pose: ArrayLike) -> FloatArray:
    """Return all joints at poses, in Pinocchio's order; ndarray, shape (..., 10)."""
    joints = kinematics.inverse_kinematics(robot.parameters.geometry, pose).joints
    return np.stack([joints[name] for name in robot.model.names[1:]], axis=-1)


def trace_of(robot: Machine, pose: ArrayLike) -> FloatArray:
    """Return where P is at poses, in the fixed frame [m]."""
    poses = as_floats("pose", pose)
    if poses.ndim == 0 or poses.shape[-1] != 3:
        raise InputError(f"pose: expected shape (..., 3), got {poses.shape}")
    y, z = poses[..., 0], poses[..., 1]
    return np.stack((0.0 * y, y, z - robot.parameters.geometry.h), axis=-1)
