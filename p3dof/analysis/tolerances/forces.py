"""First-order tolerance of forces: the exact derivative of the force at every sample by every parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof.analysis.designs.columns import BodiesOfDesigns
from p3dof.analysis.designs.figures import sampled
from p3dof.analysis.designs.folding import Folded, Folding, folding_of
from p3dof.analysis.designs.formula import derivatives
from p3dof.analysis.designs.names import OFFSETS
from p3dof.analysis.designs.samples import samples_of
from p3dof.analysis.designs.status import DesignStatus
from p3dof.analysis.tolerances.directions import Direction, columns_of_directions, designs_of
from p3dof.analysis.tolerances.results import ForceTolerance
from p3dof.machine.motion import Motion
from p3dof.machine.motion.wrenches import WrenchOverTime
from p3dof.machine.parameters import Parameters

TWO_SIDED, ONE_SIDED = 1.959963984540054, 1.6448536269514722
"""Standard deviations within which 95 % of a normal distribution are, and below which they are."""


@dataclass(frozen=True, eq=False)
class ForceCase:
    """A machine, its motion, and what varies about it.

    Parameters
    ----------
    machine : Parameters
        The nominal machine.
    motion : Motion
        What it does.
    directions : tuple of Direction
        What varies.
    sigma : ndarray, shape (P,)
        Standard deviations, in SI units.
    bodies : {"kept", "solids"}
        Where its bodies come from.
    wrench : array-like or callable, optional
        External load.
    worst : float
        How many standard deviations the worst case is.
    fixed : mapping of str to float
        Numbers that are not those of the machine, such as sizes of its solids.
    """

    machine: Parameters
    motion: Motion
    directions: tuple[Direction, ...]
    sigma: FloatArray
    bodies: BodiesOfDesigns = "kept"
    wrench: WrenchOverTime = None
    worst: float = 3.0
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(direction.name for direction in self.directions)


def require_possible(case: ForceCase) -> None:
    """Raise `InputError` unless the nominal machine makes the motion."""
    from p3dof.analysis.designs.evaluation import DesignEvaluation

    nominal = designs_of(
        case.directions, case.machine, case.bodies, np.zeros((1, len(case.sigma))), case.fixed
    )
    found = DesignEvaluation(case.motion, case.wrench, threads=1).evaluate(nominal)
    if found.status[0] != DesignStatus.FEASIBLE:
        raise InputError(f"robot: the nominal machine cannot make the motion: {found.reason(0)}")


def force_gradients(case: ForceCase) -> tuple[FloatArray, FloatArray]:
    """Return the nominal forces (N, 3) [N], and their derivatives by the parameters (P, N, 3), in SI units.

    Parameters
    ----------
    case : ForceCase
        The machine.

    Returns
    -------
    forces, gradients : ndarray
    """
    columns = columns_of_directions(
        case.directions, case.machine, case.bodies, np.zeros((1, len(case.sigma))), case.fixed
    )
    samples = samples_of(case.motion, case.wrench)
    folding = folding_of(tuple(columns), case.machine, case.bodies)
    offsets = np.array([[float(columns[name][0]) if name in columns else 0.0 for name in OFFSETS]])
    state = sampled(folding.fold(columns), samples, offsets)
    by_column = partial(_along, folding, columns)
    gradients = []
    for direction in case.directions:
        rates = [rate if np.ndim(rate) == 0 else rate[:, None] for rate in by_column(direction)]
        moved = [direction.rates.get(name, 0.0) for name in OFFSETS]
        found = derivatives(state.numbers, state.inputs, rates, moved).forces
        gradients.append(np.stack([np.broadcast_to(force, (1, len(samples)))[0] for force in found], axis=-1))
    return np.stack([force[0] for force in state.found.forces], axis=-1), np.array(gradients)


def _along(folding: Folding, columns: dict[str, FloatArray], direction: Direction) -> tuple[FloatArray, ...]:
    """Return how the numbers of the dynamics change along a direction."""
    total: list[FloatArray] = []
    for column, rate in direction.rates.items():
        moved = [rate * np.asarray(number, dtype=float) for number in folding.tangents(columns, column)]
        total = [a + b for a, b in zip(total, moved, strict=True)] if total else moved
    return Folded(tuple(total)).numbers


def first_order(case: ForceCase) -> ForceTolerance:
    """Return the tolerance of forces to first order.

    Parameters
    ----------
    case : ForceCase
        The machine.

    Returns
    -------
    ForceTolerance
    """
    forces, gradients = force_gradients(case)
    spread = gradients * case.sigma[:, None, None]
    deviation = np.sqrt((spread**2).sum(axis=0))
    worst = case.worst * np.abs(spread).sum(axis=0)
    peak, by_peak = _peaks(forces, gradients)
    parts = (by_peak * case.sigma) ** 2
    variance = parts.sum(axis=1)
    peak_deviation = np.sqrt(variance)
    grown = (np.abs(forces) + worst).max(axis=0)
    return ForceTolerance(
        "gradient",
        case.names,
        tuple(direction.unit for direction in case.directions),
        np.array([direction.nominal for direction in case.directions]),
        case.sigma,
        np.asarray(case.motion.time),
        forces,
        deviation,
        forces - TWO_SIDED * deviation,
        forces + TWO_SIDED * deviation,
        worst,
        peak,
        peak,
        peak_deviation,
        peak + ONE_SIDED * peak_deviation,
        np.append(grown, grown.max()),
        by_peak,
        parts / np.where(variance > 0, variance, 1.0)[:, None],
        case.worst,
    )


def _peaks(forces: FloatArray, gradients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return peaks of A, B, C and of all (4,), and their derivatives (4, P)."""
    at = np.abs(forces).argmax(axis=0)
    each = forces[at, range(3)]
    by_each = (gradients[:, at, range(3)] * np.sign(each)).T  # (3, P)
    largest = int(np.abs(each).argmax())
    return np.append(np.abs(each), np.abs(each[largest])), np.vstack([by_each, by_each[largest]])
