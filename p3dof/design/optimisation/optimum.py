"""`Optimum`: a better machine, how it was found, and what it is worth beside the machine that there was."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from p3dof._base.checks import FloatArray, Readable
from p3dof.analysis.designs.columns import OFFSETS
from p3dof.design.optimisation.constraints import amount
from p3dof.design.optimisation.epigraph import Local
from p3dof.design.optimisation.evaluated import Evaluated
from p3dof.design.optimisation.measures import loop_of
from p3dof.design.optimisation.population import Population, Setting
from p3dof.design.optimisation.statement import Statement
from p3dof.machine.motion.states import states_over
from p3dof.machine.parameters import Parameters, write_parameters
from p3dof.methods.pinocchio import PinocchioMethod

FINER = 9  # how many times finer than those of the optimiser grids of poses and samples of the motion are


@dataclass(frozen=True, eq=False)
class Check(Readable):
    """What a design is worth where the optimiser did not look."""

    finer: Evaluated  # on finer grids of the motion and of the box
    difference: float  # largest difference between the forces of the two ways at the optimiser's samples [N]
    largest: float  # largest force by the Pinocchio way [N]

    @property
    def violation(self) -> float:
        """Of constraints on the finer grids, as of `Evaluated`."""
        return float(self.finer.violation[0])

    @property
    def reason(self) -> str:
        """Which constraint is missed most on the finer grids, and by how much; empty if none is."""
        return self.finer.reason(0)


def checked(problem: Statement, design: FloatArray) -> Check:
    """Look at a design again."""
    finer = problem.refined(FINER).evaluate(design)
    ours = forces_of(problem, design)
    theirs = pinocchio_forces(problem, design)
    return Check(finer, float(np.abs(ours - theirs).max()), float(np.abs(theirs).max()))


def forces_of(problem: Statement, design: FloatArray) -> FloatArray:
    """Return the forces by the reduced formulas that optimisers use, (N, 3) [N]."""
    whole = Population(problem.setting, np.atleast_2d(design))
    return np.concatenate(
        [
            np.stack([np.ravel(force) for force in part.sampled.found.forces], axis=1)
            for part in whole.cases or (whole,)
        ]
    )


def pinocchio_forces(problem: Statement, design: FloatArray) -> FloatArray:
    """Return the forces by Pinocchio with its closed loops, (N, 3) [N]."""
    settings = [case.setting for case in problem.setting.cases] or [problem.setting]
    return np.concatenate([_pinocchio_forces(setting, np.atleast_2d(design)) for setting in settings])


def _pinocchio_forces(setting: Setting, design: FloatArray) -> FloatArray:
    machine = setting.designs(design)[0]
    states = states_over(setting.motion, setting.wrench)
    moved = setting.columns(design)
    offset = np.array([moved[name][0] if name in moved else 0.0 for name in OFFSETS])
    states = states._replace(pose=states.pose + offset)
    return np.asarray(PinocchioMethod(machine, loop_of(machine)).solve(states).forces)


_BINDING = 1e-4  # margin below which a constraint is called binding, as a share of its bound

_MISSED = 1e-3  # violation on finer grids that is told


@dataclass(frozen=True)
class Combination(Readable):
    """What came of one combination of the values of discrete variables."""

    values: tuple[str, ...]  # in words
    value: float  # the best of the objective; NaN where it was not looked for, or no design keeps all
    pruned: bool  # whether it was left out, as a bound tells that it cannot be the best
    reason: str  # why it is not the best; empty of the best one


@dataclass(frozen=True, eq=False, repr=False)
class Optimum:
    """A better machine.

    Parameters
    ----------
    problem : Statement
        What was asked, with all constraints.
    design : ndarray, shape (n,)
        Its variables [SI units].
    method : str
        How it was found.
    seed : int
        Of starts and random numbers.
    attempts : tuple of Local
        What the local optimiser came to from every start.
    evaluations : int
        How many designs were evaluated, with gradients where there are.
    combinations : tuple of Combination
        What came of each combination of discrete variables; none without any.
    """

    problem: Statement
    design: FloatArray
    method: str
    seed: int
    attempts: tuple[Local, ...]
    evaluations: int
    combinations: tuple[Combination, ...] = ()

    def __repr__(self) -> str:
        measure = self.problem.objectives[0]
        return f"Optimum({measure.name} {self.value:.6g} {measure.unit} at {self._variables()})"

    def _variables(self) -> str:
        pairs = zip(self.problem.variables.labels, self.design, strict=True)
        chosen = [f"{label} {value}" for label, value in self.problem.choice.items()]
        return ", ".join([*chosen, *(f"{label} {value:.6g}" for label, value in pairs)])

    @cached_property
    def found(self) -> Evaluated:
        """Objectives and constraints at the optimum."""
        return self.problem.evaluate(self.design)

    @cached_property
    def start(self) -> Evaluated:
        """The same of the machine that there was."""
        return self.problem.evaluate(np.nan_to_num(self.problem.start, nan=0.0))

    @property
    def value(self) -> float:
        """The objective."""
        return float(self.found.objectives[0, 0])

    @cached_property
    def machine(self) -> Parameters:
        """The optimum as a machine."""
        return self.problem.machine(self.design)

    @cached_property
    def gradient(self) -> dict[str, FloatArray]:
        """Derivatives of objectives and bounded measures at the optimum; see `DesignProblem.gradient`."""
        return self.problem.gradient(self.design)

    @cached_property
    def check(self) -> Check:
        """What it is worth on finer grids, and by the Pinocchio way."""
        return checked(self.problem, self.design)

    @property
    def binding(self) -> tuple[str, ...]:
        """What keeps it from being better: constraints without a margin, variables at a bound."""
        margins = self.found.margins[0]
        items = zip(self.problem.constraints, margins, strict=True)
        names = [item.name for item, margin in items if margin < _BINDING * item.scale]
        variables = self.problem.variables
        shares = variables.scaled(self.design)
        for label, share in zip(variables.labels, shares, strict=True):
            if share < _BINDING or share > 1 - _BINDING:
                names.append(f"{label} at its {'lower' if share < 0.5 else 'upper'} bound")
        return tuple(names)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know: where finer grids or the other way disagree, how starts ended."""
        notes = []
        if self.check.violation > _MISSED:
            notes.append(f"on a finer grid of poses and samples: {self.check.reason}")
        variables = self.problem.variables
        moved = [
            f"{label.removeprefix('offset.')} by {amount(float(value), unit)}"
            for label, value, unit in zip(
                variables.labels, self.design.tolist(), variables.units, strict=True
            )
            if label.startswith("offset.")
        ]
        if moved:
            notes.append(f"for the motion moved in {', '.join(moved)}, which no machine file holds")
        if self.check.difference > 1e-6 * self.check.largest:
            notes.append(f"the two methods differ by {self.check.difference:.2g} N")
        sign = 1.0 if self.problem.objectives[0].better == "small" else -1.0
        good = [a.value for a in self.attempts if a.violation == 0]
        if len(self.attempts) > 1:
            near = sum(sign * (value - self.value) < 1e-4 * abs(self.value) for value in good)
            if near < len(self.attempts):
                notes.append(f"{near} of {len(self.attempts)} starts came to this optimum, the others not")
        return tuple(notes)

    def write_parameters(self, path: str | os.PathLike[str]) -> Path:
        """Write the optimum as a machine file, which every command takes as ``--parameters``.

        Parameters
        ----------
        path : path-like
            The YAML file; replaced whole or not at all.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_parameters(self.machine, path)
        return Path(path)
