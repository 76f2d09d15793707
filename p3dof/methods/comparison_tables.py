"""Tables of a comparison: how well the two methods agree, and what others say."""

from __future__ import annotations

from p3dof._base.tables import Table, html_of, notebook_html, table_of, time_text
from p3dof.machine.parameters import LEGS
from p3dof.methods import evidence_table
from p3dof.methods.comparison import Comparison


def agreement_table(found: Comparison) -> Table:
    """Return how well the forces of the two methods agree.

    Parameters
    ----------
    found : Comparison
        Both methods over a motion.

    Returns
    -------
    Table
    """
    worst, second = found.difference[found.both_valid].max(axis=0, initial=0.0), found.second
    peak, rms, scale = second.peak_forces, second.rms_forces, second.force_scale
    rows = {
        leg: (
            peak[k],
            rms[k],
            f"{worst[k]:.1e}",
            f"{worst[k] / scale[k] if scale[k] else 0.0:.1e}",
        )
        for k, leg in enumerate(LEGS)
    }
    header = (
        "actuator",
        "largest force [N]",
        "RMS force [N]",
        "largest difference [N]",
        "of its largest force",
    )
    return table_of(f"Forces by {found.first.method} and by {second.method}", header, rows, decimals=6)


def opinions_table(found: Comparison) -> Table:
    """Return how far others are from the virtual powers.

    Parameters
    ----------
    found : Comparison
        Over a motion.

    Returns
    -------
    Table
    """
    rows = {
        opinion.name: (
            f"{found.opinion_difference(opinion):.1e}",
            f"{found.opinion_share(opinion):.1e}",
            time_text(opinion.seconds / max(1, int(found.second.valid.sum()))),
        )
        for opinion in found.opinions
    }
    header = ("by", "largest difference [N]", "of the largest force", "time per sample")
    return table_of(f"Others against {found.second.method}", header, rows)


@html_of.register(Comparison)
def comparison_html(found: Comparison) -> str:
    """Return how a notebook shows a comparison, as HTML."""
    evidence = evidence_table(found.first, found.second, seconds=found.seconds)
    tables = [agreement_table(found), evidence]
    tables += [opinions_table(found)] if found.opinions else []
    warnings = (*filter(None, [found.verdict_on_samples]), *found.warnings)
    return notebook_html("Comparison", found.verdict, tables, warnings)
