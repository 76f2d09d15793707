"""Measures of legs and rods by the forces in them over the motion: buckling and stress.

The forces are the reactions with elastic joints and rods (`p3dof.analysis.reactions`): the two rods of the
parallelogram bear different ones, which no model of rigid bodies tells. They are found machine by machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof.analysis.designs.figures import FigureGroup
from p3dof.analysis.designs.names import OFFSETS
from p3dof.analysis.reactions import Reactions
from p3dof.analysis.reactions.evaluation import over_motion
from p3dof.analysis.reactions.stiffness import RodSection, Stiffness
from p3dof.design.bearings.evaluation import rod_check
from p3dof.design.bearings.results import RodCheck
from p3dof.design.optimisation.loops import loop_of
from p3dof.design.optimisation.measure import Better, Pieces
from p3dof.design.optimisation.population import Population
from p3dof.machine.motion import Motion

_RODS = ("leg_a", "leg_b", "rod_left", "rod_right")
_STEP = 1e-5
"""Of differences, as a share of a variable."""
_SAMPLES = 101
"""Most samples of the motion that reactions are found at."""


@dataclass(frozen=True)
class RodLoad:
    """What the worst of legs and rods bears over the motion; gradients are central differences.

    Parameters
    ----------
    name : {"rod_buckling_share", "rod_stress"}
        Compression by Euler's load, both ends hinged; or the largest axial force by the section [Pa].
    unit : str
        Its SI unit.
    about : str
        What it is, in a line.
    """

    name: str
    unit: str
    about: str
    better: Better = "small"
    figures: tuple[FigureGroup, ...] = ()
    slow: bool = True

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        return np.asarray(self._of_rods(population).max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return that of each leg and rod, and the gradients."""
        return Pieces(self._of_rods(population), lambda: self._differences(population))

    def _differences(self, population: Population) -> FloatArray:
        values, slopes = population.values, []
        for index in range(values.shape[1]):
            step = np.zeros_like(values)
            step[:, index] = _STEP * np.maximum(np.abs(values[:, index]), 1e-3)
            moved = (Population(population.setting, values + sign * step) for sign in (1.0, -1.0))
            ahead, behind = (self._of_rods(each) for each in moved)
            slopes.append((ahead - behind) / (2 * step[:, [index]]))
        return np.stack(slopes, axis=-1)

    def _of_rods(self, population: Population) -> FloatArray:
        found = np.full((len(population), len(_RODS)), np.nan)
        radius = np.broadcast_to(population.numbers.size("rod_radius"), (len(population), 1))[:, 0]
        for index in np.flatnonzero(population.feasible):
            section = RodSection(diameter=2 * float(radius[index]), young=population.setting.modulus)
            try:
                rods = _rods(population, int(index), section)
            except P3dofError:
                continue
            area = math.pi * float(radius[index]) ** 2
            found[index] = [self._one(rod, area) for rod in rods]
        return found

    def _one(self, rod: RodCheck, area: float) -> float:
        if self.name == "rod_stress":
            return max(rod.compression, rod.tension) / area
        return rod.compression / rod.buckling


def _rods(population: Population, index: int, section: RodSection) -> list[RodCheck]:
    setting, machine = population.setting, population.designs[index]
    motion, load = setting.motion, setting.wrench
    every = max(1, -(-len(motion) // _SAMPLES))
    load = None if load is None else np.asarray(load)[::every]
    shift = [float(population.columns[n][index]) if n in population.columns else 0.0 for n in OFFSETS]
    pose, velocity, acceleration = (
        rows[::every] for rows in (motion.pose + np.array(shift), motion.velocity, motion.acceleration)
    )
    motion = Motion(motion.time[::every], pose, velocity, acceleration, check=False, start=motion.start)
    stiffness = replace(Stiffness(), rods=section)
    found = over_motion(loop_of(machine), machine, motion, "elastic", load, stiffness=stiffness)
    assert isinstance(found, Reactions)  # noqa: S101 - one way was asked for
    return [rod_check(machine, found, name, section) for name in _RODS]


OF_RODS = (
    RodLoad("rod_buckling_share", "", "largest compression of a leg or rod over the motion, by Euler's load"),
    RodLoad("rod_stress", "Pa", "largest axial stress of a leg or rod over the motion"),
)
"""Measures of legs and rods."""
