"""All measures by name."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.design.optimisation.measure import Measure
from p3dof.design.optimisation.of_motion import OF_MOTION
from p3dof.design.optimisation.of_poses import OF_POSES
from p3dof.design.optimisation.of_rods import OF_RODS
from p3dof.design.optimisation.of_solids import OF_SOLIDS
from p3dof.design.optimisation.of_time import FastestTime

_ALL: tuple[Any, ...] = (*OF_MOTION, FastestTime(), *OF_POSES, *OF_SOLIDS, *OF_RODS)

MEASURES: Mapping[str, Measure] = {measure.name: measure for measure in _ALL}
"""What designs can be optimised for, and bounded in, by name."""

ABOUT: Mapping[str, str] = {measure.name: measure.about for measure in _ALL}
"""What each is, in a line."""


def measure_of(given: Any, where: str) -> Measure:
    """Return a measure of its name, or one's own as it is.

    Parameters
    ----------
    given : str or Measure
        The name, or an object.
    where : str
        What to call it in an error.

    Returns
    -------
    Measure

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if isinstance(given, str):
        if given in MEASURES:
            return MEASURES[given]
        near = difflib.get_close_matches(given, MEASURES, 3, 0.5)
        hint = f"; did you mean {' or '.join(near)}?" if near else "."
        raise InputError(f"{where}: unknown measure {shown(given)}{hint} There are {', '.join(MEASURES)}")
    if not isinstance(given, Measure):
        raise InputError(f"{where}: expected the name of a measure or a Measure, got {shown(given)}")
    return given
