"""Mass properties of the solids that the bodies are made of, and their sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from p3dof.checks import FloatArray, frozen_array, positive
from p3dof.errors import ParameterError
from p3dof.parameters.body import Body
from p3dof.parameters.geometry import Geometry

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
        ours, paper = geometry, Geometry()
        ratio = min(
            ours.L / paper.L, ours.r / paper.r, ours.b / paper.b, (ours.R - ours.r) / (paper.R - paper.r)
        )
        return cls(*(ratio * item.default for item in fields(cls)))  # type: ignore[operator]


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
    x, y, z = (positive("size", edge, ParameterError) for edge in _three("size", size))
    mass = positive("density", density, ParameterError) * x * y * z
    return Body(mass, np.zeros(3), mass / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y]))


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
    mass = positive("density", density, ParameterError) * math.pi * radius**2 * length
    com = np.zeros(3)
    com[axis] = start + length / 2
    inertia = np.full(3, mass * (3 * radius**2 + length**2) / 12)
    inertia[axis] = mass * radius**2 / 2
    return Body(mass, com, inertia)


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
    areas, centroids, moments = zip(*_pieces(corners, radius), strict=True)
    area = np.array(areas)  # (pieces,)
    total = area.sum()
    centroid = area @ np.array(centroids) / total  # (2,)
    offset = np.array(centroids) - centroid  # (pieces, 2)
    second = np.sum(moments, axis=0) + np.einsum("p,pi,pj->ij", area, offset, offset)  # ∫ d dᵀ dA
    across = total * thickness**2 / 12
    inertia = np.diag([second[1, 1] + across, second[0, 0] + across, second[0, 0] + second[1, 1]])
    inertia[0, 1] = inertia[1, 0] = -second[0, 1]
    mass = density * thickness
    return Body(mass * total, np.append(centroid, 0.0), mass * inertia)


_Piece = tuple[float, NDArray[np.float64], NDArray[np.float64]]


def _pieces(corners: NDArray[np.float64], radius: float) -> list[_Piece]:
    """Cut the widened triangle into triangle, edge strips and corner sectors: (area, centroid, ∫ d dᵀ dA)."""
    middle = corners.mean(axis=0)
    edges = np.roll(corners, -1, axis=0) - corners
    area = 0.5 * (edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    if area < 0:  # normals point outward on a counter-clockwise walk
        return _pieces(corners[::-1], radius)
    if area <= 1e-12 * float(np.abs(edges).max()) ** 2:
        raise ParameterError("corners: expected a triangle, got three points on a line")
    spokes = corners - middle
    pieces: list[_Piece] = [(area, middle, area / 12 * spokes.T @ spokes)]
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    for corner, edge, normal, previous in zip(
        corners, edges, normals, np.roll(normals, 1, axis=0), strict=True
    ):
        strip = float(np.linalg.norm(edge)) * radius
        pieces.append(
            (
                strip,
                corner + edge / 2 + normal * radius / 2,
                strip / 12 * (np.outer(edge, edge) + radius**2 * np.outer(normal, normal)),
            )
        )
        half = 0.5 * math.acos(float(normal @ previous))  # half the angle of the sector
        bisector = (normal + previous) / np.linalg.norm(normal + previous)
        pieces.append(_sector(corner, bisector, half, radius))
    return pieces


def _three(name: str, value: object) -> FloatArray:
    return frozen_array(name, value, (3,), ParameterError)


def _sector(apex: NDArray[np.float64], axis: NDArray[np.float64], half: float, radius: float) -> _Piece:
    """Return area, centroid and central second moments of a circular sector."""
    area = half * radius**2
    distance = 2 * radius * math.sin(half) / (3 * half)
    wave = math.sin(half) * math.cos(half)
    along = radius**4 / 4 * (half + wave) - area * distance**2
    across = radius**4 / 4 * (half - wave)
    normal = np.array([-axis[1], axis[0]])
    return (
        area,
        apex + distance * axis,
        along * np.outer(axis, axis) + across * np.outer(normal, normal),
    )
