"""Bodies of solids: cubes, round rods and the rounded plate, by their sizes and densities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, frozen_array, positive, shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.actuators import Coefficients, Geometry
from p3dof.machine.parameters.body import (
    Bodies,
    Body,
    Inertial,
    Scalar,
    inertial_of_box,
    inertial_of_cylinder,
    inertial_of_plate,
)

STEEL_DENSITY = 7801.0
"""Density that reproduces the paper's masses [kg/m³]: the customary default steel of ADAMS."""


KINDS = ("slider", "leg", "crossbar", "platform")
"""The kinds of bodies of a usual machine."""


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
    def scaled(cls, geometry: Geometry, **given: float) -> Dimensions:
        """Return sizes given, else the paper's times the smallest ratio of a geometry to its lengths."""
        ratio = min(scales(geometry.r, geometry.R, geometry.L, geometry.b))
        return cls(**{item.name: given.get(item.name, ratio * item.default) for item in fields(cls)})


def sizes_given(given: Mapping[str, float]) -> Coefficients:
    """Return sizes by the names of `Dimensions`, checked [m]."""
    known = [item.name for item in fields(Dimensions)]
    if not isinstance(given, Mapping):
        raise ParameterError(f"dimensions: expected sizes by name, got {shown(given)}")
    for name in given:
        if name not in known:
            raise ParameterError(f"dimensions: expected {', '.join(known)}, got {shown(name)}")
    return Coefficients(
        {name: positive(f"dimensions.{name}", size, ParameterError) for name, size in given.items()}
    )


def density_by_kind(given: float | Mapping[str, float]) -> Coefficients:
    """Return the densities of all kinds, of one for all or of some kinds, steel else [kg/m³]."""
    some: Mapping[Any, Any] = given if isinstance(given, Mapping) else dict.fromkeys(KINDS, given)
    for kind in some:
        if kind not in KINDS:
            raise ParameterError(f"density: unknown kind {shown(kind)}, expected one of {', '.join(KINDS)}")
    return Coefficients(
        {kind: positive("density", some.get(kind, STEEL_DENSITY), ParameterError) for kind in KINDS}
    )


def scales(r: Scalar, R: Scalar, L: Scalar, b: Scalar) -> tuple[Scalar, ...]:
    """Return the ratios of lengths to the paper's; the least is that of solids which still fit.

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
    radius: float, length: float, axis: int = 0, start: float = 0.0, density: float = STEEL_DENSITY
) -> Body:
    """Return the body of a solid cylinder along one of the axes."""
    if axis not in {0, 1, 2}:
        raise ParameterError(f"axis: expected 0, 1 or 2, got {axis!r}")
    radius, length = (positive(*given, ParameterError) for given in (("radius", radius), ("length", length)))
    density = positive("density", density, ParameterError)
    return _body(inertial_of_cylinder(radius, length, axis, start, density))


def rounded_plate(
    corners: NDArray[np.float64], radius: float, thickness: float, density: float = STEEL_DENSITY
) -> Body:
    """Return the body of a plate: a triangle widened all round by a radius, of constant thickness.

    In the frame that `corners` are given in.
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


def bodies_of_solids(
    geometry: Geometry, dimensions: Mapping[str, float], density: Mapping[str, float]
) -> Bodies:
    """Return every body from its solid, by the sizes given [m] and the densities of all kinds [kg/m³]."""
    inertials = inertials_of_solids(geometry, asdict(Dimensions.scaled(geometry, **dimensions)), density)
    return Bodies.alike(**{kind: _body(inertial) for kind, inertial in inertials.items()})


class _Lengths(Protocol):
    """The lengths that solids depend on; `Geometry` has them, and so have columns of designs."""

    @property
    def r(self) -> Scalar: ...
    @property
    def L(self) -> Scalar: ...  # noqa: N802 - as of `Geometry`
    @property
    def b(self) -> Scalar: ...


def inertials_of_solids(
    lengths: _Lengths, size: Mapping[str, Scalar], density: Mapping[str, Scalar]
) -> dict[str, Inertial]:
    """Return the inertial parameters of each kind of body from its solid, on numbers, arrays or symbols.

    Slider, leg, crossbar and platform.
    """
    edge, radius = size["slider_edge"], size["rod_radius"]
    plate = size["corner_radius"], size["plate_thickness"]
    return {
        "slider": inertial_of_box((edge, edge, edge), density["slider"]),
        "leg": inertial_of_cylinder(radius, lengths.L, 0, 0, density["leg"]),
        "crossbar": inertial_of_cylinder(radius, 2 * lengths.b, 1, -lengths.b, density["crossbar"]),
        "platform": inertial_of_plate(_CORNERS, lengths.r, *plate, density["platform"]),
    }


_CORNERS = np.array([[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0]])
"""A3, B3 and C5 of a platform of size one, counter-clockwise."""
