"""Curves over a run as a document has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.encoding import encoded, finite

GREY = "#5f6b76"
"""Colour of sums."""
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7b1fa2", "#8d6e63")
"""Colours that the colour-blind can tell apart (Okabe and Ito, and two more)."""
Limit = tuple[float, float]
"""Lowest and highest value; infinite where there is none."""


def curve(
    key: str,
    label: str,
    group: str,
    unit: str,
    ink: str,
    values: FloatArray | None = None,
    column: tuple[str, int] | None = None,
    limit: Limit | None = None,
) -> dict[str, Any]:
    """Return a curve as a document has it.

    Parameters
    ----------
    key : str
        Its name in the run.
    label, group : str
        What it is called, and with which others it is drawn.
    unit : str
        In SI units: ``"N"``, ``"m/s"``, ...
    ink : str
        Its colour.
    values : ndarray, shape (N,), optional
        Its values.
    column : tuple of str and int, optional
        Where the run has them already, in place of `values`: one of its arrays, and which column of it.
    limit : tuple of float, optional
        Lowest and highest value.

    Returns
    -------
    dict
    """
    found: dict[str, Any] = {"key": key, "label": label, "group": group, "unit": unit, "colour": ink}
    if column is not None:
        found["column"] = list(column)
    else:
        found["values"] = encoded(np.zeros(0) if values is None else values)
    if limit is not None:
        found["limit"] = [finite(limit[0]), finite(limit[1])]
    return found
