"""The figure of energy and power over a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.energy import Energy
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, line, new_figure, shade_gaps, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GROUPS = {
    "platform": ("#0072b2", ("platform",)),
    "legs A, B": ("#56b4e9", ("leg_a", "leg_b")),
    "rods of leg C": ("#009e73", ("rod_left", "rod_right")),
    "sliders": ("#e69f00", ("slider_a", "slider_b", "slider_c")),
    "cross-bars": ("#cc79a7", ("crossbar_upper", "crossbar_lower")),
    "motors, screws": ("#999999", ("actuator_a", "actuator_b", "actuator_c")),
}
"""What the figure calls the bodies, with colours that differ for colour-blind readers."""

_FLAT = 1e-9
"""Share of the potential energy below which a whole panel is rounding, and drawn flat."""

_BLACK, _GREY = "0.1", "0.6"
_DASHED, _DOTTED = (0, (4, 2)), (0, (1, 1.2))


def energy_figure(energy: Energy) -> Figure:
    """Draw the change of the energy with the work done, the kinetic energy by bodies, and the power.

    Stretches of invalid samples are hatched; the work begins anew behind them, from the energy there. Bodies
    that never have kinetic energy are left out.

    Parameters
    ----------
    energy : Energy
        What `p3dof.analysis.energy.energy_of` found.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `energy` is something else, or none of its samples is valid.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not isinstance(energy, Energy):
        raise InputError(f"energy: expected an Energy, got {shown(energy)}")
    if not energy.valid.any():
        raise InputError("energy: expected at least one valid sample, got none")
    figure = new_figure(figsize=(9.6, 8.4))
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.2, 1, 1.1))
    for axis, draw in zip(panels, (_draw_balance, _draw_bodies, _draw_power), strict=True):
        draw(axis, energy)
        _keep_flat(axis, energy)
        shade_gaps(axis, energy.time, energy.valid)
        tidy(axis)
        axis.set_axisbelow(True)
        axis.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            fontsize=9,
            reverse=draw is _draw_bodies,
        )
    panels[-1].set_xlabel("time [s]")
    return figure


def _draw_balance(axis: Axes, energy: Energy) -> None:
    first = int(np.argmax(energy.valid))
    parts = {"kinetic T": energy.kinetic_total, "potential V": energy.potential_total, "T + V": energy.total}
    styles: tuple[dict[str, Any], ...]
    styles = ({"color": "#d55e00"}, {"color": "#0072b2"}, {"color": _BLACK, "lw": 4, "alpha": 0.3})
    for (label, values), style in zip(parts.items(), styles, strict=True):
        _line(axis, energy, values - values[first], label=label, **style)
    acting = [("work of actuators", energy.power), ("and wrench", energy.wrench_power)]
    acting += [("less friction", energy.dissipated_power)]
    label = "\n".join(words for words, power in acting if power.ndim > 1 or _acts(power))
    work = energy.total - energy.balance - energy.total[first]  # from the first sample of each run
    _line(axis, energy, work, label=label, color=_BLACK, ls=_DASHED)
    axis.axhline(0, color=_GREY, lw=0.6, zorder=0)
    axis.set_title(
        "Energy since the first sample, and the work done on the mechanism", fontsize=10, loc="left", y=1.0
    )
    axis.set_ylabel("change of energy [J]")


def _draw_bodies(axis: Axes, energy: Energy) -> None:
    columns = {
        name: [energy.bodies.index(body) for body in bodies if body in energy.bodies]
        for name, (_, bodies) in GROUPS.items()
    }
    layers = {name: energy.kinetic[:, index].sum(axis=-1) for name, index in columns.items()}
    layers = {name: layer for name, layer in layers.items() if _acts(layer, _rounding(energy))}
    if layers:
        colours = [GROUPS[name][0] for name in layers]
        axis.stackplot(
            energy.time, list(layers.values()), labels=list(layers), colors=colours, lw=0, alpha=0.85
        )
    _line(axis, energy, energy.kinetic_total, label="all bodies", color=_BLACK, lw=1, clip_on=False)
    axis.set_title("Kinetic energy, one layer a group of bodies", fontsize=10, loc="left", y=1.0)
    axis.set_ylabel("kinetic energy [J]")
    axis.set_ylim(bottom=0)


def _draw_power(axis: Axes, energy: Energy) -> None:
    for leg, name in enumerate(LEGS):
        _line(axis, energy, energy.power[:, leg], label=f"actuator {name}", color=COLOURS[leg])
    if _acts(energy.wrench_power):
        _line(axis, energy, energy.wrench_power, label="wrench", color="#e69f00", ls=_DASHED)
    if _acts(energy.dissipated_power):
        _line(axis, energy, -energy.dissipated_power, label="friction", color="#cc79a7", ls=_DOTTED)
    axis.axhline(0, color=_GREY, lw=0.6, zorder=0)
    axis.set_title("Power given to the mechanism (below zero: taken from it)", fontsize=10, loc="left", y=1.0)
    axis.set_ylabel("power [W]")


def _line(axis: Axes, energy: Energy, values: FloatArray, **style: Any) -> None:
    line(axis, energy.time, values, energy.valid, **style)


def _acts(values: FloatArray, floor: float = 0.0) -> bool:
    return bool(np.any(np.abs(np.nan_to_num(values)) > floor))


def _rounding(energy: Energy) -> float:
    """Return what is too small to be shown [J, W]."""
    return _FLAT * (float(np.abs(energy.potential[energy.valid]).max()) or 1.0)


def _keep_flat(axis: Axes, energy: Energy) -> None:
    """Show what hardly changes as a straight line instead of a blow-up of its rounding."""
    if not any(_acts(np.asarray(line.get_ydata()), _rounding(energy)) for line in axis.lines):
        axis.set_ylim(0 if axis.get_ylim()[0] == 0 else -1, 1)
