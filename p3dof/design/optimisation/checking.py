"""An optimum looked at again: on finer grids than the optimiser's, and by the Pinocchio way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.designs.names import OFFSETS
from p3dof.design.optimisation.evaluated import Evaluated
from p3dof.design.optimisation.loops import loop_of
from p3dof.design.optimisation.population import Population
from p3dof.design.optimisation.statement import Statement
from p3dof.machine.motion.states import states_over
from p3dof.methods.pinocchio import PinocchioMethod

FINER = 9
"""How many times finer than those of the optimiser grids of poses and samples of the motion are."""


@dataclass(frozen=True, eq=False)
class Check:
    """What a design is worth where the optimiser did not look.

    Parameters
    ----------
    finer : Evaluated
        On finer grids of the motion and of the box.
    difference : float
        Largest difference between the forces of the two ways at the optimiser's samples [N].
    largest : float
        Largest force by the Pinocchio way [N].
    """

    finer: Evaluated
    difference: float
    largest: float

    @property
    def violation(self) -> float:
        """Of constraints on the finer grids, as of `Evaluated`."""
        return float(self.finer.violation[0])

    @property
    def reason(self) -> str:
        """Which constraint is missed most on the finer grids, and by how much; empty if none is."""
        return self.finer.reason(0)


def checked(problem: Statement, design: FloatArray) -> Check:
    """Look at a design again.

    Parameters
    ----------
    problem : Statement
        What it is a design of.
    design : ndarray, shape (n,)
        Variables [SI units].

    Returns
    -------
    Check
    """
    finer = problem.refined(FINER).evaluate(design)
    ours = forces_of(problem, design)
    theirs = pinocchio_forces(problem, design)
    return Check(finer, float(np.abs(ours - theirs).max()), float(np.abs(theirs).max()))


def forces_of(problem: Statement, design: FloatArray) -> FloatArray:
    """Return the forces by the reduced formulas that optimisers use, (N, 3) [N]."""
    population = Population(problem.setting, np.atleast_2d(design))
    return np.stack([np.ravel(force) for force in population.sampled.found.forces], axis=1)


def pinocchio_forces(problem: Statement, design: FloatArray) -> FloatArray:
    """Return the forces by Pinocchio with its closed loops, (N, 3) [N].

    Parameters
    ----------
    problem : Statement
        What it is a design of.
    design : ndarray, shape (n,)
        Variables [SI units].

    Returns
    -------
    ndarray, shape (N, 3)
    """
    machine, setting = problem.machine(design), problem.setting
    states = states_over(setting.motion, setting.wrench)
    moved = setting.columns(np.atleast_2d(design))
    offset = np.array([moved[name][0] if name in moved else 0.0 for name in OFFSETS])
    states = states._replace(pose=states.pose + offset)
    return np.asarray(PinocchioMethod(machine, loop_of(machine)).solve(states).forces)
