"""Tables of optima and of Pareto fronts, beside the machine that there was."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import NONE, Table
from p3dof._base.tables.table import Cell
from p3dof.design.optimisation.constraints import Linear
from p3dof.design.optimisation.front import Front
from p3dof.design.optimisation.optimum import Optimum

_ROWS = 12
"""Most designs in a table of a front."""


def optimum_tables(optimum: Optimum) -> list[Table]:
    """Return what changed against the machine that there was, what binds, and how it was checked.

    Parameters
    ----------
    optimum : Optimum
        Of `DesignProblem.minimise`.

    Returns
    -------
    list of Table
    """
    return [_changes(optimum), _limits(optimum), _checks(optimum)]


def _changes(optimum: Optimum) -> Table:
    variables, start = optimum.problem.variables, optimum.problem.start
    rows: list[tuple[Cell, ...]] = []
    for index, (label, unit) in enumerate(zip(variables.labels, variables.units, strict=True)):
        rows.append(_row(f"{label} [{unit}]", start[index], optimum.design[index]))
    for index, measure in enumerate(optimum.problem.objectives):
        name = f"{measure.name} [{measure.unit}]" if measure.unit else measure.name
        rows.append(_row(name, optimum.start.objectives[0, index], optimum.found.objectives[0, index]))
    title = f"Optimum of {optimum.problem.objectives[0].name}"
    return Table(title, ("", "start", "optimum", "change"), tuple(rows))


def _limits(optimum: Optimum) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for index, item in enumerate(optimum.problem.constraints):
        margins = (optimum.start.margins[0, index], optimum.found.margins[0, index])
        binding = "binding" if item.name in optimum.binding else ""
        if item.measure.unit == "rad":
            margins = (float(np.degrees(margins[0])), float(np.degrees(margins[1])))
        unit = {"rad": "deg"}.get(item.measure.unit, item.measure.unit)
        name = item.name if isinstance(item.measure, Linear) else item.name.removesuffix(unit).strip()
        told = f"{name} [{unit}]" if unit else name
        rows.append((told, *(_plain(round(margin, 12) + 0.0) for margin in margins), binding))
    bounds = ", ".join(name for name in optimum.binding if name.endswith(" bound"))
    note = f"Besides: {bounds}." if bounds else ""
    return Table("Margins", ("constraint", "start", "optimum", ""), tuple(rows), note)


def _checks(optimum: Optimum) -> Table:
    check, measure = optimum.check, optimum.problem.objectives[0]
    unit = f" [{measure.unit}]" if measure.unit else ""
    rows: tuple[tuple[Cell, ...], ...] = (
        (f"{measure.name} by the optimiser{unit}", optimum.value),
        (f"{measure.name} on a finer grid{unit}", float(check.finer.objectives[0, 0])),
        ("violation on a finer grid", check.reason or "none"),
        ("largest force by Pinocchio [N]", check.largest),
        ("largest difference of the two ways [N]", f"{check.difference:.2g}"),
    )
    return Table("Checks", ("", "value"), rows)


def front_tables(front: Front) -> list[Table]:
    """Return the machine that there was, and some designs of the front from one end to the other.

    Parameters
    ----------
    front : Front
        Of `DesignProblem.pareto`.

    Returns
    -------
    list of Table
    """
    problem = front.problem
    shown = np.unique(np.linspace(0, len(front) - 1, min(_ROWS, len(front))).round().astype(int))
    pairs = zip(problem.variables.labels, problem.variables.units, strict=True)
    header = [f"{label} [{unit}]" for label, unit in pairs]
    header += [f"{m.name} [{m.unit}]" if m.unit else m.name for m in problem.objectives]
    rows: list[tuple[Cell, ...]] = [("start", *_cells(problem.start, front.start.objectives[0]))]
    rows += [(str(k), *_cells(front.designs[k], front.objectives[k])) for k in shown]
    return [Table(f"Pareto front of {len(front)} designs", ("design", *header), tuple(rows), layout="wide")]


def _row(name: str, before: float, after: float) -> tuple[Cell, ...]:
    if not np.isfinite(before) or not before:
        return name, _plain(before), _plain(after), NONE
    return name, _plain(before), _plain(after), f"{(after - before) / abs(before):+.2%}"


def _plain(value: float) -> Cell:
    return float(value) if np.isfinite(value) else NONE


def _cells(design: FloatArray, objectives: FloatArray) -> list[Cell]:
    return [float(value) for value in (*design, *objectives)]
