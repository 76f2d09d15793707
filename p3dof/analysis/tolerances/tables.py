"""Tables of tolerances and sensitivities."""

from __future__ import annotations

import math

import numpy as np

from p3dof._base.tables import Table, html_of, notebook_html, number, table_of
from p3dof.analysis.tolerances.results import ForceTolerance, PoseTolerance
from p3dof.analysis.tolerances.sensitivity import LocalSensitivity
from p3dof.analysis.tolerances.sobol import SobolIndices

RIGID = (
    "Each leg has its own lengths. Unequal rods of the parallelogram, tilted guides and axes are outside: "
    "they jam or strain this overconstrained machine."
)


def tolerance_tables(found: ForceTolerance | PoseTolerance) -> tuple[Table, ...]:
    """Return what is uncertain, and what it comes from.

    Parameters
    ----------
    found : ForceTolerance or PoseTolerance
        What `p3dof.tolerance` returns.

    Returns
    -------
    tuple of Table
    """
    return _of_forces(found) if isinstance(found, ForceTolerance) else _of_poses(found)


def sensitivity_table(found: SobolIndices | LocalSensitivity) -> Table:
    """Return what a figure depends on, the most important parameter first.

    Parameters
    ----------
    found : SobolIndices or LocalSensitivity
        What `p3dof.sensitivity` returns.

    Returns
    -------
    Table
    """
    if isinstance(found, LocalSensitivity):
        order = np.argsort(-np.abs(found.normalised)).tolist()
        rows = {
            found.names[i]: (
                f"{number(found.nominal[i])} {found.units[i]}",
                f"{number(found.gradient[i])} {found.unit}/{_below(found.units[i])}",
                f"{found.normalised[i]:+.4g}",
            )
            for i in order
        }
        title = f"{found.result} = {number(found.value)} {found.unit}"
        return table_of(title, ("parameter", "nominal", "derivative", "% per %"), rows)
    order = np.argsort(-found.total).tolist()
    shares = {
        found.names[i]: (
            f"{found.first[i]:.3f} ± {found.first_error[i]:.3f}",
            f"{found.total[i]:.3f} ± {found.total_error[i]:.3f}",
        )
        for i in order
    }
    note = (
        f"Mean {number(found.mean)} {found.unit}, standard deviation {number(found.deviation)} {found.unit}, "
        f"95 % from {number(found.low)} to {number(found.high)} {found.unit}; {found.rows} matched rows"
    )
    note += f", {found.missing_rows} left out" if found.missing_rows else ""
    header = ("parameter", "S1: alone", "ST: with interactions")
    return table_of(f"Shares of the variance of {found.result}", header, shares, f"{note}.")


def _of_forces(found: ForceTolerance) -> tuple[Table, ...]:
    largest = found.deviation.max(axis=0)
    deviations = (*largest.tolist(), float(largest.max()))
    rows = {
        name: tuple(
            map(
                number,
                (
                    found.peak[k],
                    deviations[k],
                    found.peak_deviation[k],
                    found.peak_high[k],
                    found.peak_worst[k],
                ),
            )
        )
        for k, name in enumerate(("A", "B", "C", "largest"))
    }
    header = (
        "actuator", "peak [N]", "largest σ of the motion [N]", "σ of the peak [N]", "95 % below [N]",
        f"worst case, {found.worst_sigma:g} σ [N]",
    )  # fmt: skip
    forces = table_of(
        "Forces", header, rows, _drawn(found.method, found.machines, found.impossible, "make the motion")
    )
    order = np.argsort(-found.shares[3]).tolist()
    parts = {
        found.names[i]: (
            f"{number(found.nominal[i])} {found.units[i]}",
            f"{number(found.sigma[i])} {found.units[i]}",
            f"{number(found.peak_gradient[3, i])} N/{_below(found.units[i])}",
            f"{100 * found.shares[3, i]:.3g} %",
        )
        for i in order
    }
    what = ("parameter", "nominal", "σ", "derivative of the peak", "share of its variance")
    return forces, table_of("Where it comes from", what, parts)


def _of_poses(found: PoseTolerance) -> tuple[Table, ...]:
    scale = np.array([1e6, 1e6, 1e3])
    shape = (-1, 3)
    poses, sizes, high, worst = (
        array.reshape(shape) for array in (found.pose, found.deviation, found.high, found.worst)
    )
    rows = {}
    for k, (y, z, theta) in enumerate(poses.tolist()):
        name = f"{k + 1}: {y:g} m, {z:g} m, {math.degrees(theta):.4g}°"
        rows[name] = tuple(
            number(float(value)) for values in (sizes, high, worst) for value in (values[k] * scale)
        )
    header = ["pose"]
    for what in ("σ of {}", "95 % of |{}| below", f"worst {{}}, {found.worst_sigma:g} σ"):
        header += [
            f"{what.format(axis)} [{unit}]" for axis, unit in (("y", "µm"), ("z", "µm"), ("θ", "mrad"))
        ]
    told = _drawn(found.method, found.machines, found.impossible, "assemble")
    errors = table_of("Static errors of the pose", header, rows, f"{told} {RIGID}", "wide")
    shares = found.shares.reshape(-1, 3, len(found.names))[0]
    parts = {
        name: (f"{1e6 * found.sigma[i]:.4g}", *(f"{100 * share:.3g}" for share in shares[:, i]))
        for i, name in enumerate(found.names)
    }
    titles = ("parameter", "σ [µm]", "of y [%]", "of z [%]", "of θ [%]")
    return errors, table_of("Where it comes from, at the first pose", titles, parts)


def _below(unit: str) -> str:
    """Return a unit as it stands below a line."""
    return f"({unit})" if " " in unit or "/" in unit else unit


def _drawn(method: str, machines: int, impossible: int, can: str) -> str:
    if method == "gradient":
        return "First order, by exact derivatives."
    left = f", {impossible} of which cannot {can} and are left out" if impossible else ""
    return f"{machines} machines drawn at random{left}; the worst case is of first order."


@html_of.register(ForceTolerance)
@html_of.register(PoseTolerance)
def tolerance_html(found: ForceTolerance | PoseTolerance) -> str:
    """Return how a notebook shows a tolerance, as HTML."""
    return notebook_html("Tolerance", repr(found), tolerance_tables(found), [], "")


@html_of.register(SobolIndices)
@html_of.register(LocalSensitivity)
def sensitivity_html(found: SobolIndices | LocalSensitivity) -> str:
    """Return how a notebook shows a sensitivity, as HTML."""
    return notebook_html("Sensitivity", repr(found), [sensitivity_table(found)], [], "")
