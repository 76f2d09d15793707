"""The named parameter sets: `PAPER` and `SOLIDS`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.actuators import Geometry, Limits
from p3dof.machine.parameters.body import Bodies, Body
from p3dof.machine.parameters.machine import Parameters
from p3dof.machine.parameters.solids import STEEL_DENSITY, Dimensions, bodies_of_solids


def of_solids(
    geometry: Geometry | None = None,
    dimensions: Dimensions | None = None,
    density: float | Mapping[str, float] = STEEL_DENSITY,
    limits: Limits | None = None,
) -> Parameters:
    """Compute every body from its solid: cubes, round rods and the rounded plate.

    Parameters
    ----------
    geometry : Geometry, optional
        Lengths; the paper's by default.
    dimensions : Dimensions, optional
        Sizes of the solids; those of the paper, scaled to the geometry, by default.
    density : float or mapping of str to float
        Density of all solids, or of some kinds (slider, leg, crossbar, platform), steel else [kg/m³].
    limits : Limits, optional
        Actuator limits.

    Raises
    ------
    ParameterError
        If an argument has the wrong type, or the sizes do not make bodies.
    """
    for name, value, kind in (
        ("geometry", geometry, Geometry),
        ("dimensions", dimensions, Dimensions),
        ("limits", limits, Limits),
    ):
        if value is not None and not isinstance(value, kind):
            raise ParameterError(f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    geometry = geometry or Geometry()
    return Parameters(geometry, bodies_of_solids(geometry, dimensions, density), limits or Limits())


def _paper() -> Parameters:
    """Return the printed numbers, with the mass centres and axes that the paper leaves to the reader.

    The printed J2 is about the leg's upper joint, x along the leg. The printed J3 = diag(.0269, .0658, .0501)
    is about C5 in the axes of T5 (x0, -z0, y0). Mass centres are those of the solids, which reproduce the
    printed masses; sliders only translate, so that the inertia of the cube stands in for the one not given.
    """
    geometry = Geometry()
    solids = of_solids(geometry).bodies
    slider_mass, leg_mass, platform_mass = 0.9751, 0.9803, 8.1573
    bodies = Bodies.alike(
        slider=Body(slider_mass, np.zeros(3), np.full(3, slider_mass * Dimensions().slider_edge ** 2 / 6)),
        leg=Body.about(np.zeros(3), leg_mass, solids.leg_a.com, np.array([0.0006, 0.0524, 0.0524])),
        crossbar=Body.massless(),
        platform=Body.about(
            np.array([-geometry.r, 0.0, 0.0]),
            platform_mass,
            solids.platform.com,
            np.array([0.0269, 0.0501, 0.0658]),
        ),
    )
    return Parameters(geometry, bodies)


PAPER = _paper()
"""The printed numbers of the paper, completed by the reconstructed mass centres; massless cross-bars."""

SOLIDS = of_solids()
"""Every body computed from its steel solid; the masses, rounded, are those of the paper."""
