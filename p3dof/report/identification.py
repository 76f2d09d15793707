"""The page about an identification: what was found, and whether to use it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from p3dof._base.checks import require
from p3dof._base.errors import InputError
from p3dof.loops.identification.validation import (
    Identification,
    Validation,
    combinations_table,
    parameters_table,
    validation_table,
)
from p3dof.report.plots.identification import predicted_figure, residuals_figure
from p3dof.report.templates import Heading, picture, rendered, template, write_report

_TITLE = "Identification from measured forces"


def render_identification(found: Identification, validation: Validation | None = None, **heading: Any) -> str:
    """Return an identification as one HTML page that loads nothing from elsewhere; the page.

    Around the numbers stand ``title``, ``about``, ``command`` and ``date``.

    Parameters
    ----------
    found : Identification
        What was found.
    validation : Validation, optional
        On held-out data.
    **heading
        As above.

    Raises
    ------
    InputError
        If an argument is something else, or the validation is of another identification.
    MissingExtraError
        If Jinja2 or matplotlib is not installed.
    """
    page = template("identification.html.j2")
    require("found", found, Identification)
    if validation is not None and (
        not isinstance(validation, Validation) or validation.identification is not found
    ):
        raise InputError("validation: expected that of this identification")
    words = Heading(**heading).words(_TITLE)
    shown = found if validation is None else validation
    which = "held-out data" if validation is not None else "the data that it was identified from"
    data = found.data
    words |= {
        "verdict": "Not validated: what other motions take is not known."
        if validation is None
        else validation.verdict,
        "better": None if validation is None else validation.better,
        "prepared": [one.about for one in (data, *(() if validation is None else (validation.data,)))],
        "remarks": list(
            dict.fromkeys((*found.remarks, *(validation.remarks if validation is not None else ())))
        ),
        "key": {
            "samples compared": f"{len(data)}",
            "delay of the forces": f"{1e3 * data.delay:.3g} ms",
            "positions followed up to": f"{data.band:.3g} Hz",
            "combinations seen": f"{len(found.estimate.combinations)}",
        },
        "held_out": None if validation is None else validation_table(validation),
        "parameters": parameters_table(found),
        "all": parameters_table(found, all_of_them=True),
        "combinations": combinations_table(found),
        "predicted": picture(
            predicted_figure(shown),
            f"Measured forces over time, of {which}, and those that design and identified robot predict.",
            f"Forces of {which}: measured, and predicted by the design and by the identified robot.",
        ),
        "residuals": picture(
            residuals_figure(shown),
            f"Residuals over time, position and velocity of each actuator, of {which}.",
            f"Residuals of {which}. What is left should look like noise: a step or slope over the "
            "velocity is "
            "friction that the model lacks, a wave over the position an eccentric or cogging, a trend over "
            "time warmth.",
        ),
    }
    return rendered(page, words)


def write_identification(
    path: str | os.PathLike[str], found: Identification, validation: Validation | None = None, **heading: Any
) -> Path:
    """Write an identification to a file.

    Parameters
    ----------
    path : path-like
        The file: ``.html``, or ``.pdf``, which a Chromium prints.
    found, validation, **heading
        As for `render_identification`.

    Raises
    ------
    FileError
        If the file cannot be written.
    P3dofError
        As `render_identification`.
    """
    return write_report(path, lambda: render_identification(found, validation, **heading))
