"""Figures of what was measured: excitation motions, residuals of an identification, errors of poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import FloatArray, require, shown
from p3dof._base.errors import InputError
from p3dof.loops.identification.validation import Identification, Validation
from p3dof.report.plots.common import COLOURS, Place, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from p3dof.analysis.tolerances import MachineCalibration
    from p3dof.loops import Calibration
    from p3dof.loops.identification.excitation import Excitation
    from p3dof.loops.identification.forces import IdentifiableForces

_DESIGN, _FOUND = "0.6", COLOURS[0]
_MOST = 3000  # points of a panel


class _Shown:
    """What is drawn: held-out data where there are any, else those that were identified from."""

    def __init__(self, found: Identification | Validation) -> None:
        if isinstance(found, Validation):
            identification, self.data = found.identification, found.data
            self.residuals, self.design = found.residuals, found.design_residuals
        else:
            require("found", found, Identification)
            identification, self.data = found, found.data
            measured = self.data.forces - self.data.rows.known
            self.design = measured - self.data.rows.columns @ found.forces.design
            self.residuals = measured - self.data.rows.columns @ found.parameters - found.offsets
        self.forces = identification.forces
        self.some = np.unique(np.linspace(0, len(self.data) - 1, min(len(self.data), _MOST)).astype(int))


def residuals_figure(found: Identification | Validation, *, ax: Place = None) -> Figure:
    """Draw residuals over time, position and velocity, a row for each actuator.

    Of the identified robot in colour, of the design in grey. A slope or a step over the velocity is friction
    that the model lacks, a wave over the position an eccentric or a cogging torque, a trend over time warmth.

    Parameters
    ----------
    found : Identification or Validation
        What was found; residuals of held-out data where there are any.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError, MissingExtraError
        If `found` is something else; if matplotlib is not installed.
    """
    shown = _Shown(found)
    m, states, some = len(shown.forces.actuators), shown.data.states, shown.some
    figure = new_figure(figsize=(11.0, 2.3 * m + 0.6), ax=ax)
    axes = figure.subplots(m, 3, squeeze=False, sharey="row")
    size = 2.0 if len(some) > 600 else 4.0
    for i, (row, name) in enumerate(zip(axes, shown.forces.actuators, strict=True)):
        unit, force = shown.forces.position_units[i], shown.forces.force_units[i]
        over = (
            (shown.data.time, "time [s]"),
            (states.positions[:, i], f"position [{unit}]"),
            (states.velocities[:, i], f"velocity [{unit}/s]"),
        )
        for axis, (x, label) in zip(row, over, strict=True):
            axis.plot(x[some], shown.design[some, i], ".", ms=size, color=_DESIGN, label="design")
            axis.plot(x[some], shown.residuals[some, i], ".", ms=size, color=_FOUND, label="identified")
            axis.axhline(0.0, color="0.3", lw=0.6)
            tidy(axis)
            axis.set_xlabel(label if i == m - 1 or unit != shown.forces.position_units[-1] else "")
        row[0].set_ylabel(f"{name}\n[{force}]")
    axes[0, 0].legend(loc="upper right", markerscale=2, frameon=True, fontsize="small")
    return figure


def predicted_figure(found: Identification | Validation, *, ax: Place = None) -> Figure:
    """Draw measured forces over time, and those that design and identified robot predict.

    Parameters
    ----------
    found : Identification or Validation
        What was found; held-out data where there are any.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError, MissingExtraError
        If `found` is something else; if matplotlib is not installed.
    """
    shown = _Shown(found)
    m, time, measured = len(shown.forces.actuators), shown.data.time, shown.data.forces
    left_out = 1 + np.flatnonzero(np.diff(time) > 1.5 * np.median(np.diff(time)))
    forces = (measured, measured - shown.design, measured - shown.residuals)
    time, *curves = (np.insert(x, left_out, np.nan, axis=0) for x in (time, *forces))
    figure = new_figure(figsize=(11.0, 1.9 * m + 0.6), ax=ax)
    axes = figure.subplots(m, 1, squeeze=False, sharex=True)[:, 0]
    for i, (axis, name) in enumerate(zip(axes, shown.forces.actuators, strict=True)):
        axis.plot(time, curves[0][:, i], color="0.1", lw=2.2, label="measured")
        axis.plot(time, curves[1][:, i], color="#d55e00", lw=1.1, ls="--", label="design")
        axis.plot(time, curves[2][:, i], color="#56b4e9", lw=1.1, label="identified")
        axis.set_ylabel(f"{name}\n[{shown.forces.force_units[i]}]")
        tidy(axis)
    axes[-1].set_xlabel("time [s]")
    axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=3, fontsize="small")
    return figure


MOST_BARS = 24  # most parameters that are drawn: those that are known worst, compared with their tolerances
_BEFORE, _AFTER = "0.6", COLOURS[0]


def calibration_figure(
    calibration: Calibration | MachineCalibration,
    held_out: tuple[FloatArray, FloatArray] | None = None,
    *,
    ax: Place = None,
) -> Figure:
    """Draw errors of measured poses before and after, and the parameters' standard deviations.

    Parameters
    ----------
    calibration : Calibration or MachineCalibration
        What `p3dof.loops.calibrate` or `p3dof.analysis.tolerances.calibrate_machine` returns; of several
        kinds of measurements the first is drawn.
    held_out : tuple of two (K, c) arrays, optional
        Errors before and after of poses that were measured and not used.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If it is something else; if matplotlib is not installed.
    """
    from p3dof.loops import Calibration

    if isinstance(calibration, Calibration):
        names = calibration.measured[0].components
        before, after = calibration.before[0], calibration.after[0]
    else:
        from p3dof.analysis.tolerances import MachineCalibration  # not for any robot

        if not isinstance(calibration, MachineCalibration):
            raise InputError(f"calibration: expected a Calibration, got {shown(calibration)}")
        names, before, after = ("y", "z", "θ"), calibration.before, calibration.after
    bars = 0.6 + 0.16 * min(len(calibration.names), MOST_BARS)  # height of their panel [inches]
    figure = new_figure((9.0, 1.5 * len(names) + 1.0 + bars), ax=ax)
    *panels, last = figure.subplots(len(names) + 1, 1, height_ratios=(*[1.2] * len(names), bars))
    for k, (name, panel) in enumerate(zip(names, panels, strict=True)):
        factor, unit = (1e3, "mrad") if name in ("θ", "rx", "ry", "rz") else (1e3, "mm")
        held = None if held_out is None else tuple(factor * part[:, k] for part in held_out)
        _of_component(panel, factor * before[:, k], factor * after[:, k], held, k == 0)
        more = "" if k else ", computed less measured" + ("" if held_out is None else "; shaded: held out")
        panel.set_title(f"{name} [{unit}]{more}", fontsize=9, loc="left")
    panels[-1].set_xlabel("pose")
    _of_parameters(last, calibration)
    return figure


def _of_component(
    panel: Axes, before: FloatArray, after: FloatArray, held: tuple[FloatArray, ...] | None, named: bool
) -> None:
    own = 1 + np.arange(len(before))
    later = len(before) + 1 + np.arange(0 if held is None else len(held[0]))
    first, second = (
        (before, after) if held is None else (np.append(before, held[0]), np.append(after, held[1]))
    )
    poses = np.append(own, later)
    panel.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    panel.vlines(poses, np.minimum(first, 0), np.maximum(first, 0), color=_BEFORE, lw=1.2)
    panel.plot(poses, first, "o", ms=3, color=_BEFORE, label="by the design")
    panel.plot(poses, second, "o", ms=3, color=_AFTER, label="calibrated")
    if held is not None:
        panel.axvspan(len(before) + 0.5, poses[-1] + 0.5, color="0.93", lw=0, zorder=-1)
    if named:
        panel.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2, fontsize=8)
    tidy(panel)


def _of_parameters(panel: Axes, found: Calibration | MachineCalibration) -> None:
    known = np.isfinite(found.tolerances)
    with np.errstate(invalid="ignore"):
        left = np.where(known, found.deviations / found.tolerances, np.nan)
    order = np.argsort(np.where(known, -left, -np.inf), kind="stable")[:MOST_BARS]
    panel.barh(np.arange(len(order)), 100 * left[order], color=_AFTER, height=0.65)
    panel.axvline(100, color="0.6", lw=0.8)
    panel.set_xlabel("standard deviation [% of the tolerance]; 100 %: measuring told nothing")
    tidy(panel)
    panel.grid(visible=False)
    panel.set_yticks(np.arange(len(order)), [found.names[i] for i in order], fontsize=8)
    panel.invert_yaxis()
    panel.set_xlim(0, 105)


_SAMPLES = 401
_KINDS = {"m": "[m]", "rad": "[rad]", "N": "[N]", "N m": "[N m]"}


def excitation_figure(found: Excitation, forces: IdentifiableForces, *, ax: Place = None) -> Figure:
    """Draw one period of an excitation motion.

    Coordinates, velocities, forces of the design, and the utilisation of each kind of limit.

    Parameters
    ----------
    found : Excitation
        The motion.
    forces : LoopForces or MachineForces
        Its robot.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.
    """
    time: FloatArray = np.linspace(0.0, found.period, _SAMPLES, dtype=np.float64)
    motion = found.steady(time)
    states = forces.from_coordinates(*motion)
    rows = forces.rows(states)
    tau = rows.columns @ forces.design + rows.known
    used = 1 + forces.excess(states, rows)
    figure = new_figure((9.0, 6.0), ax=ax)
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
