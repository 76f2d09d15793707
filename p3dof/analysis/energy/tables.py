"""Tables of energy and work over a motion, and of what the drives must do."""

from __future__ import annotations

import numpy as np

from p3dof._base.tables import NONE, Table, html_of, notebook_html, number, table_of
from p3dof.analysis.energy.results import Energy
from p3dof.machine.parameters import LEGS


def drives_table(energy: Energy) -> Table:
    """Return what each drive must do.

    Parameters
    ----------
    energy : Energy
        Over a motion.

    Returns
    -------
    Table
    """
    drives = energy.drives
    loads = {
        "peak force [N]": drives.peak_force,
        "RMS force [N]": drives.rms_force,
        "peak speed [m/s]": drives.peak_speed,
        "peak power [W]": drives.peak_power,
        "peak braking power [W]": drives.peak_braking,
        "mean power [W]": drives.mean_power,
        "work given [J]": drives.positive_work,
        "work taken back [J]": drives.negative_work,
    }
    rows = {name: tuple(values.tolist()) for name, values in loads.items()}
    return table_of("What the drives must do", ("drive load", *(f"actuator {leg}" for leg in LEGS)), rows)


def bodies_table(energy: Energy) -> Table:
    """Return the largest kinetic energy of each body.

    Parameters
    ----------
    energy : Energy
        Over a motion; some sample is valid.

    Returns
    -------
    Table
    """
    header = ["body", "peak kinetic energy [J]"]
    if not energy.valid.all():
        unknown = dict.fromkeys(energy.bodies, (np.nan,))
        return table_of("Kinetic energy", header, unknown, "Not known in all samples.")
    most = int(np.argmax(energy.kinetic_total))
    total = energy.kinetic_total[most]
    rows = {
        name: (
            energy.kinetic[:, k].max(),
            f"{energy.kinetic[most, k] / total if total else 0.0:.1%}",
        )
        for k, name in enumerate(energy.bodies)
    }
    header.append(f"share at t = {number(energy.time[most])} s")
    return table_of("Kinetic energy", header, rows, f"All bodies at most {number(total)} J.")


def balance_table(energy: Energy) -> Table:
    """Return the evidence: the work done on the mechanism against the change of its energy.

    Parameters
    ----------
    energy : Energy
        Over a motion.

    Returns
    -------
    Table
    """
    error = np.abs(energy.balance[energy.valid]).max(initial=0.0)
    done = energy.work_done[-1] if energy.valid.all() else np.nan
    rows = {"over the motion": (done, f"{error:.1e}" if energy.valid.any() else NONE, energy.scale)}
    header = ("energy balance", "work done [J]", "largest error [J]", "range of the energy [J]")
    return table_of("Change of the energy less the work done", header, rows)


@html_of.register(Energy)
def energy_html(energy: Energy) -> str:
    """Return how a notebook shows energy and work over a motion, as HTML."""
    facts = f"{len(energy.time)} samples from {number(energy.time[0])} to {number(energy.time[-1])} s"
    invalid = int((~energy.valid).sum())
    warnings = [f"{invalid} samples are invalid: no peak and no sum is known"] if invalid else []
    tables = (drives_table(energy), bodies_table(energy), balance_table(energy))
    return notebook_html("Energy", facts, tables, warnings)
