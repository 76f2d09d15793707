"""How much of the limits a task uses: those of the machine and its own, the tighter of the two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.tables import NONE, Table, number, percent, table_of
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.design.tasks import FastestPlan, LimitUse
from p3dof.design.tasks.limits import AxisLimits
from p3dof.machine.parameters import LEGS, Limits
from p3dof.methods import InverseDynamics

_UNSEEN = ("jerk", "nut_force")
"""Limits of tasks that samples are not held against."""
_FITS = 1 + 1e-9


@dataclass(frozen=True)
class OwnedUse:
    """How much of a limit a task uses, and whose limit it is.

    Parameters
    ----------
    of : str
        ``"machine"`` or ``"task"``, that is also what the fastest motion was asked to keep.
    quantity : str
        What is limited.
    leg : str
        ``"A"``, ``"B"``, ``"C"`` or ``"platform"``.
    value, limit : float
        The largest value, and what is allowed [`unit`].
    unit : str
        Of both.
    time : float
        When [s].
    """

    of: str
    quantity: str
    leg: str
    value: float
    limit: float
    unit: str
    time: float

    @property
    def share(self) -> float:
        """Value by limit: 1 at the limit."""
        return self.value / self.limit


def uses_of_task(
    found: InverseDynamics | TaskForces, limits: AxisLimits | None, machine: Limits
) -> tuple[LimitUse, ...]:
    """Return how much of its own limits a task uses: densely of the fastest motion, else by samples.

    Parameters
    ----------
    found : InverseDynamics or TaskForces
        The forces.
    limits : AxisLimits or None
        What the task allows; the fastest motion has its own.
    machine : Limits
        What the machine allows: limits of the task that are the same are left out.

    Returns
    -------
    tuple of LimitUse
        None without limits, or of a task that is not possible.
    """
    if isinstance(found, TaskForces) and isinstance(found.plan, FastestPlan):
        return found.plan.uses
    if limits is None or not found.possible:
        return ()
    force = found.forces + limits.reflected_mass * found.slider_accelerations
    columns = {
        "force": (np.abs(force), limits.force),
        "speed": (np.abs(found.slider_velocities), limits.speed),
        "power": (force * found.slider_velocities, limits.power),
    }
    uses = []
    for name, (values, allowed) in columns.items():
        for k, row in enumerate(values.argmax(axis=0)):
            own = getattr(machine, name, np.inf)
            if allowed[k] == own and not (name == "force" and limits.reflected_mass[k]):
                continue
            time, value = float(found.time[row]), max(float(values[row, k]), 0.0)
            place = found.piece_at(time).name if isinstance(found, TaskForces) else ""
            if np.isfinite(allowed[k]):
                uses.append(LimitUse(name, LEGS[k], value, float(allowed[k]), time, place))
    return tuple(uses)


def unseen_limits(limits: AxisLimits | None) -> str:
    """Return a warning of limits of a task that samples are not held against; empty if it has none."""
    names = [] if limits is None else [n for n in _UNSEEN if np.isfinite(getattr(limits, n)).any()]
    words = ", ".join(name.replace("_", " ") for name in names)
    return f"limits of the task that only the fastest motion is held to: {words}" if words else ""


def tightest_uses(
    found: TaskForces, machine: Limits, limits: AxisLimits | None = None
) -> tuple[OwnedUse, ...]:
    """Return how much of each limit a task uses, of machine and task the one that is used more.

    Parameters
    ----------
    found : TaskForces
        The forces over the task.
    machine : Limits
        What the machine allows.
    limits : AxisLimits, optional
        What the task allows; the fastest motion has its own.

    Returns
    -------
    tuple of OwnedUse
    """
    rows = {
        (one.quantity, one.leg): OwnedUse(
            "machine", one.quantity, one.leg, one.value, one.limit, one.unit, one.time
        )
        for one in found.utilisations(machine)
    }
    plan = found.plan
    chosen = plan.limits if isinstance(plan, FastestPlan) else limits
    for use in uses_of_task(found, limits, machine):
        own = rows.get((use.quantity, use.leg))
        turning = chosen is not None and use.quantity == "force" and chosen.reflected_mass.any()
        if own is None or (use.share > own.share and (turning or use.limit != abs(own.limit))):
            rows[use.quantity, use.leg] = OwnedUse(
                "task",
                use.quantity,
                use.leg,
                use.value,
                use.limit,
                use.unit,
                use.time,
            )
    return tuple(rows.values())


def within_limits(found: TaskForces, machine: Limits, limits: AxisLimits | None = None) -> bool:
    """Return whether a task is possible and exceeds no limit; arguments are those of `tightest_uses`."""
    return all(one.share <= _FITS for one in tightest_uses(found, machine, limits))


def sizing_table(found: TaskForces, machine: Limits, limits: AxisLimits | None = None) -> Table:
    """Return how much of each limit a task uses, when and where, and whose limit it is.

    Parameters
    ----------
    found : TaskForces
        The forces over the task.
    machine : Limits
        What the machine allows.
    limits : AxisLimits, optional
        What the task allows; the fastest motion has its own.

    Returns
    -------
    Table
    """
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            number(one.value),
            number(one.time),
            found.piece_at(one.time).name,
            number(one.limit),
            one.of,
            NONE if np.isnan(one.share) else percent(one.share),
        )
        for one in tightest_uses(found, machine, limits)
    }
    header = ("limit of", "peak", "at t [s]", "on the way", "limit", "of", "used")
    return table_of("How much of the limits is used", header, rows, unseen_limits(limits))
