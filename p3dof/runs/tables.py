"""The table of runs that follow a motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from p3dof._base.tables import Table, html_of, notebook_html, number, table_of, time_text
from p3dof.machine.motion import motion_table
from p3dof.machine.parameters import LEGS
from p3dof.runs.run import Simulation


def errors_table(runs: Mapping[str, Simulation]) -> Table:
    """Return the tracking errors of runs, their forces, and how fast they were.

    Parameters
    ----------
    runs : mapping of str to Simulation
        By controller; each follows a motion.

    Returns
    -------
    Table
    """
    rows = {
        name: (
            *(f"{1e3 * error:.3g}" for error in run.peak_error),
            f"{np.abs(run.forces).max():.1f}",
            f"{run.speed:.2g}",
        )
        for name, run in runs.items()
    }
    header = ("controller", "y [mm]", "z [mm]", "θ [mrad]", "force [N]", "× real time")
    return table_of("Largest tracking errors and forces, and the speed of the simulation", header, rows)


def run_table(run: Simulation) -> Table:
    """Return what each actuator did in a run.

    Parameters
    ----------
    run : Simulation
        The run.

    Returns
    -------
    Table
    """
    rows = {
        leg: (
            np.abs(run.forces[:, k]).max(),
            np.abs(run.slider_velocities[:, k]).max(),
            run.sliders[:, k].min(),
            run.sliders[:, k].max(),
        )
        for k, leg in enumerate(LEGS)
    }
    header = ("actuator", "largest force [N]", "largest speed [m/s]", "lowest [m]", "highest [m]")
    note = f"Largest closure error: {run.closure_error.max():.1e} m."
    return table_of("Actuators", header, rows, note)


@html_of.register(Simulation)
def simulation_html(run: Simulation) -> str:
    """Return how a notebook shows a run, as HTML."""
    took = f"in {time_text(run.seconds)}, {run.evaluations} evaluations"
    facts = f"{run.method}, {len(run)} samples over {number(run.motion.duration)} s, {took}"
    tables = [run_table(run), motion_table(run.motion, run.wrench)]
    if run.reference is not None:
        tables.insert(0, errors_table({"this run": run}))
    warnings = [] if run.stop is None else [f"ended by {run.stop}"]
    return notebook_html("Simulation", facts, tables, warnings, run.note)
