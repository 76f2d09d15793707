"""`RobotArrows`: forces of actuators, in closures and from outside as arrows, to one scale."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.closure_wrenches import ClosureWrench
from p3dof.page.robots.lines import turned_to
from p3dof.viewer.arrows import HEAD_RADIUS, draw_arrow, set_length
from p3dof.viewer.robots.closures import COLOUR, ink

UNITS = ("N", "N m")
"""Of forces and of moments."""
LONGEST = 0.5
"""Length of the longest arrow, as a share of half the robot's size."""
ACTUATORS = ((0.0, 0.45, 0.70), (0.84, 0.37, 0.0), (0.0, 0.62, 0.45), (0.80, 0.47, 0.65))
"""Of the actuators' arrows; told apart by colour-blind readers."""
_PALE = tuple(0.45 * part + 0.55 for part in COLOUR)
"""Of forces in closures of which only some components are determined, or that go with chosen torques."""
_OUTSIDE = (0.15, 0.15, 0.15)
"""Of external wrenches."""
_TOO_LONG = 1.001
"""A force may be so much larger than the largest of a scale: rounding."""


@dataclass(frozen=True)
class Arrow:
    """One force or moment to be drawn.

    Parameters
    ----------
    name : str
        Where it is in the scene.
    place : ndarray, shape (3,)
        Where it starts [m].
    value : ndarray, shape (3,)
        In world axes [N or N m].
    unit : str
        One of `UNITS`.
    """

    name: str
    place: FloatArray
    value: FloatArray
    unit: str

    @property
    def size(self) -> float:
        """How large it is [N or N m]; NaN if it is not determined."""
        return float(np.linalg.norm(self.value))


class RobotArrows:
    """The arrows of one robot.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The root of what is drawn.
    longest : float
        Length of the arrow of the largest force [m].
    radius : float
        Of the shafts [m].
    """

    def __init__(self, viewer: Any, longest: float, radius: float) -> None:
        self._viewer, self._longest, self.radius = viewer, longest, radius
        self.largest: dict[str, float] = {}
        """What the longest arrow stands for, by unit [N, N m]; set by `scale_to`."""
        self._double: dict[str, bool] = {}

    @property
    def reach(self) -> float:
        """How far the widest of an arrow is from its axis [m]."""
        return HEAD_RADIUS * self.radius

    def draw_actuators(self, units: Sequence[str], colours: Iterable[Sequence[float]]) -> None:
        """Put an arrow into the scene for each actuator."""
        for i, (unit, colour) in enumerate(zip(units, colours, strict=True)):
            self._draw(f"forces/{i}", colour, unit)

    def draw_closures(self, moments: Sequence[bool], through: bool = False) -> None:
        """Put arrows into the scene for each closure: of its force, and of its moment where it has one.

        Parameters
        ----------
        moments : sequence of bool
            Whether each closure has a moment.
        through : bool
            Whether they are seen through what is before them.
        """
        for i, has_moment in enumerate(moments):
            for unit in UNITS[: 2 if has_moment else 1]:
                word = "force" if unit == "N" else "moment"
                self._draw(f"closure_forces/{i}/{word}", COLOUR, unit, through)
                self._draw(f"closure_forces/{i}/part_of_{word}", _PALE, unit, through)

    def draw_wrenches(self, names: Iterable[str]) -> None:
        """Put arrows into the scene for the external wrenches on frames."""
        for i, _ in enumerate(names):
            self._draw(f"wrenches/{i}/force", _OUTSIDE, "N")
            self._draw(f"wrenches/{i}/moment", _OUTSIDE, "N m")

    def scale_to(self, arrows: Iterable[Arrow], sizes: Iterable[tuple[str, float]] = ()) -> None:
        """Take the longest arrow for the largest of some forces, and of sizes with their units."""
        self.largest = largest_of(arrows)
        for unit, size in sizes:
            if size > np.finfo(float).tiny:
                self.largest[unit] = max(self.largest.get(unit, 0.0), float(size))

    def fit(self, arrows: Iterable[Arrow]) -> None:
        """Change the scale only if some force is too large for it, or all are small: to 1, 2, 5, 10, ..."""
        for unit, size in largest_of(arrows).items():
            scale = self.largest.get(unit, 0.0)
            if not 0.2 * scale <= size <= scale * _TOO_LONG:
                self.largest[unit] = _round_up(size)

    def show(self, arrows: Iterable[Arrow]) -> None:
        """Show some forces, and hide all others; one beyond the scale is cut off at its end."""
        hidden = set(self._double)
        for arrow in arrows:
            scale, size = self.largest.get(arrow.unit, 1.0), arrow.size
            if not size > 0 or arrow.name not in hidden:
                continue
            hidden.discard(arrow.name)
            node = self._viewer[arrow.name]
            matrix = np.eye(4)
            matrix[:3, :3] = turned_to(arrow.value / size)
            matrix[:3, 3] = arrow.place
            node.set_transform(matrix)
            length = self._longest * min(size / scale, 1.0)
            set_length(node, length, self.radius, self._double[arrow.name])
        for name in hidden:
            set_length(self._viewer[name], 0.0, self.radius)

    def ends(self, arrows: Iterable[Arrow]) -> FloatArray:
        """Return where the tips of forces are, shape (N, 3) [m]."""
        tips = [
            arrow.place + self._longest * arrow.value / self.largest.get(arrow.unit, 1.0)
            for arrow in arrows
            if arrow.size > 0
        ]
        return np.array(tips).reshape(-1, 3)

    def _draw(self, name: str, colour: Sequence[float], unit: str, through: bool = False) -> None:
        self._double[name] = unit == "N m"
        draw_arrow(self._viewer[name], self.radius, ink(colour, through), self._double[name])
        set_length(self._viewer[name], 0.0, self.radius)


def actuator_arrows(
    data: pin.Data, model: pin.Model, actuators: Iterable[tuple[int, bool]], forces: FloatArray
) -> list[Arrow]:
    """Return the forces of actuators (n,) along their joints' axes, at joint Jacobians that `data` holds.

    Parameters
    ----------
    data : pin.Data
        Of ``pinocchio.computeJointJacobians``.
    model : pin.Model
        The tree.
    actuators : iterable of (int, bool)
        Joints with one degree of freedom, and whether they slide.
    forces : ndarray, shape (n,)
        [N or N m]

    Returns
    -------
    list of Arrow
    """
    J, found = np.asarray(data.J).reshape(6, -1), []
    for i, (joint, sliding) in enumerate(actuators):
        column = J[:, model.idx_vs[joint]]
        axis = column[:3] if sliding else column[3:]
        place = np.array(data.oMi[joint].translation)
        found.append(Arrow(f"forces/{i}", place, forces[i] * np.array(axis), UNITS[0 if sliding else 1]))
    return found


def closure_arrows(wrench: ClosureWrench, pale: bool = False) -> list[Arrow]:
    """Return the forces and moments in closures that are determined, as a whole or in part (pale)."""
    found = []
    for i in np.flatnonzero(wrench.known):
        part = "" if wrench.whole[i] and not pale else "part_of_"
        for word, unit, value in (("force", "N", wrench.forces), ("moment", "N m", wrench.moments)):
            found.append(Arrow(f"closure_forces/{i}/{part}{word}", wrench.places[i], value[i], unit))
    return found


def wrench_arrows(
    data: pin.Data, frames: Mapping[str, tuple[int, pin.SE3]], wrenches: Mapping[str, FloatArray]
) -> list[Arrow]:
    """Return external wrenches (6,) at the origins of frames, at joint placements that `data` holds."""
    found = []
    for i, (name, (joint, placement)) in enumerate(frames.items()):
        place = np.array((data.oMi[joint] * placement).translation)
        found.append(Arrow(f"wrenches/{i}/force", place, wrenches[name][:3], "N"))
        found.append(Arrow(f"wrenches/{i}/moment", place, wrenches[name][3:], "N m"))
    return found


def largest_of(arrows: Iterable[Arrow]) -> dict[str, float]:
    """Return the largest force and the largest moment; units in which there is none are left out."""
    found: dict[str, float] = {}
    for arrow in arrows:
        if arrow.size > np.finfo(float).tiny:
            found[arrow.unit] = max(found.get(arrow.unit, 0.0), arrow.size)
    return found


def _round_up(size: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(size))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= size / _TOO_LONG)
