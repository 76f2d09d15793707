"""Mass properties of the solids that the bodies are made of, and their sizes."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, frozen_array, positive
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.body import Body
from p3dof.machine.parameters.geometry import Geometry
from p3dof.machine.parameters.inertial import (
    Inertial,
    Scalar,
    inertial_of_box,
    inertial_of_cylinder,
    inertial_of_plate,
)

STEEL_DENSITY = 7801.0
"""Density that reproduces the paper's masses [kg/m³]: the customary default steel of ADAMS."""


@dataclass(frozen=True)
class Dimensions:
    """Sizes of the solids [m]; the defaults reproduce the paper's masses.

    Parameters
    ----------
    slider_edge : float
        Edge of the sliders, which are cubes.
    rod_radius : float
        Radius of legs, rods and cross-bars, which are cylinders.
    plate_thickness : float
        Thickness of the platform.
    corner_radius : float
        By how much the triangle of the joints is widened to make the platform.

    Raises
    ------
    ParameterError
        If a size is not a positive number.
    """

    slider_edge: float = 0.05
    rod_radius: float = 0.01
    plate_thickness: float = 0.05
    corner_radius: float = 0.02

    def __post_init__(self) -> None:
        for item in fields(self):
            value = positive(item.name, getattr(self, item.name), ParameterError)
            object.__setattr__(self, item.name, value)

    @classmethod
    def scaled(cls, geometry: Geometry) -> Dimensions:
        """Return the sizes of the paper's solids scaled to another geometry, so that they still fit.

        Parameters
        ----------
        geometry : Geometry
            The lengths of the mechanism.

        Returns
        -------
        Dimensions
            The paper's sizes, times the smallest ratio of `geometry` to the paper's lengths.
        """
        ratio = min(scales(geometry.r, geometry.R, geometry.L, geometry.b))
        return cls(*(ratio * item.default for item in fields(cls)))


def scales(r: Scalar, R: Scalar, L: Scalar, b: Scalar) -> tuple[Scalar, ...]:
    """Return the ratios of lengths to the paper's; the least is that of solids which still fit.

    Parameters
    ----------
    r, R, L, b : number or array
        As of `Geometry` [m].

    Returns
    -------
    tuple
        Four ratios.
    """
    paper = Geometry()
    return L / paper.L, r / paper.r, b / paper.b, (R - r) / (paper.R - paper.r)


def box(size: tuple[float, float, float], density: float = STEEL_DENSITY) -> Body:
    """Return the body of a solid box about its middle.

    Parameters
    ----------
    size : tuple of float
        Edges along x, y, z [m].
    density : float
        Density [kg/m³].

    Returns
    -------
    Body
        Origin at the middle of the box.

    Raises
    ------
    ParameterError
        If an edge or the density is not a positive number.
    """
    edges = [positive("size", edge, ParameterError) for edge in _three("size", size)]
    return _body(
        inertial_of_box((edges[0], edges[1], edges[2]), positive("density", density, ParameterError))
    )


def cylinder(
    radius: float,
    length: float,
    axis: int = 0,
    start: float = 0.0,
    density: float = STEEL_DENSITY,
) -> Body:
    """Return the body of a solid cylinder along one of the axes.

    Parameters
    ----------
    radius, length : float
        Sizes [m].
    axis : int
        The axis of the body frame that it lies along: 0, 1 or 2.
    start : float
        Coordinate of its first end on that axis [m].
    density : float
        Density [kg/m³].

    Returns
    -------
    Body

    Raises
    ------
    ParameterError
        If `axis` is not one of the three, or the sizes do not make a body.
    """
    if axis not in {0, 1, 2}:
        raise ParameterError(f"axis: expected 0, 1 or 2, got {axis!r}")
    radius, length = (positive(*given, ParameterError) for given in (("radius", radius), ("length", length)))
    density = positive("density", density, ParameterError)
    return _body(inertial_of_cylinder(radius, length, axis, start, density))


def rounded_plate(
    corners: NDArray[np.float64], radius: float, thickness: float, density: float = STEEL_DENSITY
) -> Body:
    """Return the body of a plate: a triangle widened all round by a radius, of constant thickness.

    Parameters
    ----------
    corners : ndarray, shape (3, 2)
        Corners of the triangle in the plane x, y [m].
    radius : float
        By how much the triangle is widened [m].
    thickness : float
        Thickness along z, half of it on either side of the plane [m].
    density : float
        Density [kg/m³].

    Returns
    -------
    Body
        In the frame that `corners` are given in.

    Raises
    ------
    ParameterError
        If a size is not a positive number, or the corners are on one line.
    """
    corners = frozen_array("corners", corners, (3, 2), ParameterError)
    radius, thickness, density = (
        positive(name, value, ParameterError)
        for name, value in (("radius", radius), ("thickness", thickness), ("density", density))
    )
    return _body(inertial_of_plate(corners, 1.0, radius, thickness, density))


def _body(inertial: Inertial) -> Body:
    return Body(inertial.mass, np.array(inertial.com), np.array(inertial.inertia))


def _three(name: str, value: object) -> FloatArray:
    return frozen_array(name, value, (3,), ParameterError)
