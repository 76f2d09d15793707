"""All measures by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from p3dof._base.checks import meant, shown
from p3dof._base.errors import InputError
from p3dof.design.optimisation.measure import Measure
from p3dof.design.optimisation.of_motion import FASTEST, OF_MOTION
from p3dof.design.optimisation.of_poses import OF_POSES, OF_RODS, OF_SOLIDS

_ALL: tuple[Any, ...] = (*OF_MOTION, FASTEST, *OF_POSES, *OF_SOLIDS, *OF_RODS)

MEASURES: Mapping[str, Measure] = {measure.name: measure for measure in _ALL}
"""What designs can be optimised for, and bounded in, by name."""

ABOUT: Mapping[str, str] = {measure.name: measure.about for measure in _ALL}  # what each is, in a line


def measure_of(given: Any, where: str) -> Measure:
    """Return a measure of its name, or one's own as it is."""
    if isinstance(given, str):
        if given in MEASURES:
            return MEASURES[given]
        hint = meant(given, MEASURES, 0.5) or "."
        raise InputError(f"{where}: unknown measure {shown(given)}{hint} There are {', '.join(MEASURES)}")
    if not isinstance(given, Measure):
        raise InputError(f"{where}: expected the name of a measure or a Measure, got {shown(given)}")
    return given
