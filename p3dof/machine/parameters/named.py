"""The named parameter sets: `PAPER` and `SOLIDS`."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from p3dof._base.checks import FloatArray, positive
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.bodies import Bodies
from p3dof.machine.parameters.body import Body
from p3dof.machine.parameters.geometry import Geometry
from p3dof.machine.parameters.inertial import (
    Inertial,
    Scalar,
    inertial_of_box,
    inertial_of_cylinder,
    inertial_of_plate,
)
from p3dof.machine.parameters.limits import Limits
from p3dof.machine.parameters.machine import Parameters
from p3dof.machine.parameters.solids import STEEL_DENSITY, Dimensions


def of_solids(
    geometry: Geometry | None = None,
    dimensions: Dimensions | None = None,
    density: float = STEEL_DENSITY,
    limits: Limits | None = None,
) -> Parameters:
    """Compute every body from its solid: cubes, round rods and the rounded plate.

    Parameters
    ----------
    geometry : Geometry, optional
        Lengths; the paper's by default.
    dimensions : Dimensions, optional
        Sizes of the solids; those of the paper, scaled to the geometry, by default.
    density : float
        Density of all solids [kg/m³].
    limits : Limits, optional
        Actuator limits.

    Returns
    -------
    parameters : Parameters

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
    size = dimensions or Dimensions.scaled(geometry)
    positive("density", density, ParameterError)
    bodies = {
        kind: Body(inertial.mass, np.array(inertial.com), np.array(inertial.inertia))
        for kind, inertial in inertials_of_solids(geometry, size, density).items()
    }
    return Parameters(geometry, Bodies.alike(**bodies), limits or Limits())


class _Lengths(Protocol):
    """The lengths that solids depend on; `Geometry` has them, and so have columns of designs."""

    @property
    def r(self) -> Scalar: ...
    @property
    def L(self) -> Scalar: ...  # noqa: N802 - as of `Geometry`
    @property
    def b(self) -> Scalar: ...


class _Sizes(Protocol):
    """Sizes as of `Dimensions`."""

    @property
    def slider_edge(self) -> Scalar: ...
    @property
    def rod_radius(self) -> Scalar: ...
    @property
    def plate_thickness(self) -> Scalar: ...
    @property
    def corner_radius(self) -> Scalar: ...


def inertials_of_solids(lengths: _Lengths, size: _Sizes, density: Scalar) -> dict[str, Inertial]:
    """Return the inertial parameters of each kind of body from its solid, on numbers, arrays or symbols.

    Parameters
    ----------
    lengths : Geometry or columns
        Lengths of the mechanism [m].
    size : Dimensions or columns
        Sizes of the solids [m].
    density : number, array or symbol
        Of all solids [kg/m³].

    Returns
    -------
    dict of str to Inertial
        Slider, leg, crossbar and platform.
    """
    edge = size.slider_edge
    return {
        "slider": inertial_of_box((edge, edge, edge), density),
        "leg": inertial_of_cylinder(size.rod_radius, lengths.L, 0, 0, density),
        "crossbar": inertial_of_cylinder(size.rod_radius, 2 * lengths.b, 1, -lengths.b, density),
        "platform": inertial_of_plate(_CORNERS, lengths.r, size.corner_radius, size.plate_thickness, density),
    }


_CORNERS = np.array([[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0]])
"""A3, B3 and C5 of a platform of size one, counter-clockwise."""


def platform_corners(geometry: Geometry) -> FloatArray:
    """Return the platform's joints A3, B3, C5 in its plane, in the platform frame, counter-clockwise.

    Parameters
    ----------
    geometry : Geometry
        The lengths of the mechanism.

    Returns
    -------
    ndarray, shape (3, 2)
        x and y of A3, B3 and C5 [m].
    """
    corners: FloatArray = geometry.r * _CORNERS + 0.0
    return corners


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
