"""Designs side by side, as one page."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.design.assessment_tables import assumptions
from p3dof.design.design_comparison import DesignComparison, comparison_table, verdicts_table
from p3dof.report import plots
from p3dof.report.assessment import write_report
from p3dof.report.figures import picture
from p3dof.report.templates import dated, rendered, template, texts, versions

_TITLE = "Designs side by side"


def render_designs(
    found: Sequence[DesignComparison],
    *,
    title: str | None = None,
    about: Mapping[str, str] | None = None,
    command: str | None = None,
    date: datetime | None = None,
) -> str:
    """Return comparisons of designs as one HTML page that loads nothing from elsewhere.

    Parameters
    ----------
    found : sequence of DesignComparison
        Of `p3dof.compare_designs`.
    title : str, optional
        Heading of the page.
    about : mapping of str to str, optional
        What else its head should tell, such as where the designs come from.
    command : str, optional
        How to make this page again.
    date : datetime, optional
        When it was made; now by default.

    Returns
    -------
    str
        The page.

    Raises
    ------
    InputError
        If an argument does not fit.
    MissingExtraError
        If Jinja2 or matplotlib is not installed.
    """
    if not found or not all(isinstance(one, DesignComparison) for one in found):
        raise InputError(f"found: expected DesignComparison objects, got {shown(found)}")
    page_of = template("designs.html.j2")
    texts(title=title, command=command)
    told = {one.name: assumptions(one) for part in found for one in part.assessments}
    common = [
        (topic, value)
        for topic, value in next(iter(told.values())).items()
        if all(other.get(topic) == value for other in told.values())
    ]
    own = [
        (name, {topic: value for topic, value in one.items() if (topic, value) not in common})
        for name, one in told.items()
    ]
    words: dict[str, Any] = {
        "title": _TITLE if title is None else title,
        "about": dict(about or {}),
        "command": command,
        "date": dated(date),
        "versions": versions(),
        "parts": [_part(one) for one in found],
        "assumptions": [("All of them", dict(common)), *(pair for pair in own if pair[1])],
    }
    return rendered(page_of, words)


def write_designs(path: str | os.PathLike[str], found: Sequence[DesignComparison], **options: Any) -> Path:
    """Write comparisons of designs to a file.

    Parameters
    ----------
    path : path-like
        The file, replaced whole or not at all: ``.html``, or ``.pdf``, which a Chromium prints.
    found : sequence of DesignComparison
        Of `p3dof.compare_designs`.
    **options
        As of `render_designs`.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    InputError
        If the name ends in something else, or an argument does not fit.
    FileError
        If the file cannot be written.
    MissingExtraError
        If Jinja2 or matplotlib is not installed, or playwright or a browser for a PDF.
    """
    return write_report(path, render_designs(found, **options))


def _part(found: DesignComparison) -> dict[str, Any]:
    names = ", ".join(found.names)
    return {
        "title": found.title,
        "fits": all(one.fits for one in found.assessments),
        "verdicts": [(one.name, one.verdict, one.unchecked) for one in found.assessments],
        "table": comparison_table(found),
        "ratings": verdicts_table(found),
        "picture": picture(
            plots.comparison_figure(found),
            f"Forces and speeds of A, B and C over time, of {names}.",
            "Forces and speeds of the sliders, laid over each other.",
        ),
        "warnings": [(one.name, one.warnings) for one in found.assessments],
    }
