"""The figure of an excitation motion: coordinates, their rates, forces and limits over one period."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops.identification.excitation import Excitation
from p3dof.loops.identification.forces import IdentifiableForces
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SAMPLES = 401
_KINDS = {"m": "[m]", "rad": "[rad]", "N": "[N]", "N m": "[N m]"}


def excitation_figure(found: Excitation, forces: IdentifiableForces) -> Figure:
    """Draw one period of an excitation motion.

    Coordinates, velocities, forces of the design, and the utilisation of each kind of limit.

    Parameters
    ----------
    found : Excitation
        The motion.
    forces : LoopForces or MachineForces
        Its robot.
    """
    time: FloatArray = np.linspace(0.0, found.period, _SAMPLES, dtype=np.float64)
    motion = found.steady(time)
    states = forces.from_coordinates(*motion)
    rows = forces.rows(states)
    tau = rows.columns @ forces.design + rows.known
    used = 1 + forces.excess(states, rows)
    figure = new_figure((9.0, 6.0))
    (place, speed), (force, limit) = figure.subplots(2, 2, sharex=True)
    units = _unit(found.coordinate_units)
    _lines(place, time, motion[0], found.coordinates, f"position {units}")
    _lines(speed, time, motion[1], found.coordinates, f"velocity {units.replace(']', '/s]')}")
    _lines(force, time, tau, found.actuators, f"actuator force {_unit(found.force_units)}")
    kinds: dict[str, list[int]] = {}
    for k, name in enumerate(found.limits):
        kinds.setdefault(name.partition(" of ")[0], []).append(k)
    drawn = {name: used[:, where].max(axis=1) for name, where in kinds.items()}
    drawn = {name: values for name, values in drawn.items() if values.max() > 0}
    _lines(limit, time, np.column_stack(list(drawn.values())), tuple(drawn), "utilisation of limits")
    limit.axhline(1.0, color="0.3", lw=1.0, ls="--")
    limit.set_ylim(0.0, 1.35)
    for axis in (force, limit):
        axis.set_xlabel("time [s]")
    return figure


def _unit(units: tuple[str, ...]) -> str:
    """Return the unit of an axis."""
    return _KINDS[units[0]] if len(set(units)) == 1 else f"[{' or '.join(dict.fromkeys(units))}]"


def _lines(axis: Axes, time: FloatArray, values: FloatArray, names: tuple[str, ...], label: str) -> None:
    for k, (name, column) in enumerate(zip(names, values.T, strict=True)):
        style = ("-", "--", ":")[k // len(COLOURS) % 3]
        axis.plot(time, column, label=name, lw=1.4, ls=style, color=COLOURS[k % len(COLOURS)])
    axis.set_ylabel(label)
    axis.legend(fontsize="small", ncols=min(3, len(names)))
    tidy(axis)
