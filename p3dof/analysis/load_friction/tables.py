"""Tables of friction that depends on loads: what it adds to each actuator, and where it arises."""

from __future__ import annotations

import numpy as np

from p3dof._base.tables import Table, html_of, notebook_html, number, table_of
from p3dof.analysis.load_friction.results import LoadFrictionEffect
from p3dof.machine.parameters import LEGS, SLIDES

APPLIES = (
    "Friction by load: in forces over motions and tasks, reactions, lives of bearings, drives. Kernels, "
    "generated C, runs in time and the fastest motion have only the constant friction of the parameters."
)
"""What must stand beside it: where it counts, and where not."""


def additions_table(effect: LoadFrictionEffect) -> Table:
    """Return what friction by load adds to the force of each actuator.

    Parameters
    ----------
    effect : LoadFrictionEffect
        Forces with and without.

    Returns
    -------
    Table
    """
    with_, without, additions = effect.result, effect.without, effect.additions
    guides = np.abs(effect.of_guides)
    rows = {}
    for k, leg in enumerate(LEGS):
        size = np.abs(additions[:, k])
        at = int(np.nanargmax(size)) if with_.possible else 0
        rows[f"force {leg} [N]"] = (
            without.peak_forces[k],
            with_.peak_forces[k],
            without.rms_forces[k],
            with_.rms_forces[k],
            effect.largest_additions[k],
            with_.time[at] if with_.possible else float("nan"),
            guides[at, k] if with_.possible else float("nan"),
            _share(float(effect.largest_additions[k]), float(without.peak_forces[k])),
        )
    header = (
        "", "peak without", "peak with", "RMS without", "RMS with", "most added", "at t [s]",
        "of its own guide", "share of the peak",
    )  # fmt: skip
    note = (
        f"Loads and friction settled in {effect.steps} steps. Hinges add what the own guide and screw do not."
    )
    return table_of("What friction by load adds", header, rows, note, "wide", decimals=3)


def contacts_table(effect: LoadFrictionEffect) -> Table:
    """Return the load and the friction of each contact, and what it loses.

    Parameters
    ----------
    effect : LoadFrictionEffect
        Forces with and without.

    Returns
    -------
    Table
    """
    total = sum(effect.lost_work.values())
    rows = {}
    for name, work in effect.lost_work.items():
        load, friction = (
            float(values[name].max()) if effect.result.possible else float("nan")
            for values in (effect.loads, effect.coulomb.limits)
        )
        unit = "N" if name in SLIDES else "N m"
        rows[name] = (number(load), f"{number(friction)} {unit}", number(work), _share(work, total))
    header = ("joint", "largest load [N]", "largest friction", "lost in the motion [J]", "share")
    note = "Load: of a hinge across its axis; of a guide |fx| + |fy| + (|mx| + |my| + |mz|) / arm."
    return table_of("Where friction by load arises", header, rows, note)


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole > 0 else "–"


@html_of.register(LoadFrictionEffect)
def effect_html(effect: LoadFrictionEffect) -> str:
    """Return how a notebook shows what friction by load adds, as HTML."""
    facts = f"{len(effect.result.time)} samples over {number(effect.result.motion.duration)} s"
    tables = [additions_table(effect), contacts_table(effect)]
    return notebook_html("Friction by load", facts, tables, [], APPLIES)
