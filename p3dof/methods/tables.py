"""Tables of the inverse dynamics: forces, evidence, limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof._base.tables import NONE, Table, html_of, notebook_html, number, table_of, time_text
from p3dof.machine.parameters import LEGS, Limits
from p3dof.methods.results import InverseDynamics


def forces_table(result: InverseDynamics) -> Table:
    """Return lowest, highest and RMS force of each actuator, with armatures of each nut too.

    Parameters
    ----------
    result : InverseDynamics
        Over a motion; if a sample is invalid, there is no lowest and no highest.

    Returns
    -------
    Table
    """
    rows = {
        leg: (result.forces[:, k].min(), result.forces[:, k].max(), result.rms_forces[k])
        for k, leg in enumerate(LEGS)
    }
    if result.armature.any():
        nuts = result.nut_forces
        rows |= {
            f"nut {leg}": (nuts[:, k].min(), nuts[:, k].max(), mean)
            for k, (leg, mean) in enumerate(zip(LEGS, result.rms_of(nuts), strict=True))
        }
    header = ("actuator", "lowest [N]", "highest [N]", "RMS [N]")
    return table_of(f"Forces, {result.method}", header, rows)


def evidence_table(*results: InverseDynamics, seconds: Sequence[float] = ()) -> Table:
    """Return closure errors and power residuals.

    Parameters
    ----------
    *results : InverseDynamics
        By different methods.
    seconds : sequence of float, optional
        How long each took [s].

    Returns
    -------
    Table
    """
    rows = {
        result.method: [
            f"{result.closure_error[result.valid].max(initial=0.0):.1e}",
            f"{np.abs(result.power_residual[result.valid]).max(initial=0.0):.1e}",
            number(np.abs(result.power).max()),  # NaN in one sample: there is no largest one
        ]
        for result in results
    }
    header = ["method", "closure error [m]", "power residual [W]", "largest power [W]"]
    if seconds:
        header.append("time per sample")
        for result, each in zip(results, seconds, strict=True):
            rows[result.method].append(time_text(each / len(result.time)))
    return table_of("Evidence", header, rows)


def limits_table(result: InverseDynamics, limits: Limits) -> Table:
    """Return how much of each limit the motion uses, and when.

    Parameters
    ----------
    result : InverseDynamics
        The forces.
    limits : Limits
        What the actuators can do.

    Returns
    -------
    Table
    """
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            number(one.value),
            number(one.time),
            number(one.limit),
            NONE if np.isnan(one.share) else f"{one.share:.1%}",
        )
        for one in result.utilisations(limits)
    }
    return table_of("How much of the limits is used", ("limit of", "peak", "at t [s]", "limit", "used"), rows)


@html_of.register(InverseDynamics)
def inverse_dynamics_html(result: InverseDynamics) -> str:
    """Return how a notebook shows forces over a motion, as HTML."""
    facts = f"by {result.method}, {len(result.time)} samples over {number(result.motion.duration)} s"
    tables = (forces_table(result), evidence_table(result))
    return notebook_html("Inverse dynamics", facts, tables, result.warnings)
