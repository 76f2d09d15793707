"""`Body`: the inertial parameters of one rigid body.

Mass, mass centre, inertia as components, and those of solids: a formula for numbers, arrays and symbols.

Only ``+ - * /`` is used. `p3dof.machine.parameters.solids` makes bodies of them, `p3dof.analysis.designs`
columns.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, Readable, as_floats, frozen_array, positive
from p3dof._base.errors import ParameterError

_TOLERANCE = 1e-9
"""Share of the largest principal moment by which an inertia may miss symmetry or the triangle inequality."""


@dataclass(frozen=True, eq=False)
class Body(FrozenArrays):
    """Mass, mass centre and inertia of one rigid body, in its body frame.

    Parameters
    ----------
    mass : float
        Mass [kg]; zero makes a massless body (only the cross-bars of the manipulator may be one).
    com : array-like, shape (3,), optional
        Mass centre in the body frame [m]; its origin by default.
    inertia : array-like, shape (3, 3) or (3,), optional
        Inertia about the mass centre, in the axes of the body frame [kg m²]; three numbers are a diagonal.
        None by default: a point mass.

    Attributes
    ----------
    parts : tuple of Body
        The bodies that `joined` made it of, in their order; empty otherwise.

    Raises
    ------
    ParameterError
        If the mass is negative, a number is not finite, or no distribution of mass has this inertia:
        not symmetric, a negative principal moment, or one larger than the sum of the other two.

    Notes
    -----
    Body frames of the manipulator: a leg or rod has its origin at the upper joint, x along the rod toward
    its lower end and y along its hinge axis, on the side of +x0. The platform has its origin at P and axes
    parallel to the fixed frame at θ = 0. A slider has its origin at its pivot, a cross-bar at its middle,
    both with axes parallel to the fixed frame at home.
    """

    mass: float
    com: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # made an array below, as the next
    inertia: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    parts: tuple[Body, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        mass = float(frozen_array("mass", self.mass, (), ParameterError))
        com = frozen_array("com", self.com, (3,), ParameterError)
        inertia = frozen_array("inertia", _matrix(self.inertia), (3, 3), ParameterError)
        if mass < 0:
            raise ParameterError(f"mass: expected zero or more, got {mass:g} kg")
        if mass == 0 and np.any(inertia):
            raise ParameterError("inertia: expected zeros for a body without mass, got a non-zero inertia")
        _check_physical(inertia)
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "com", com)
        object.__setattr__(self, "inertia", inertia)

    @classmethod
    def about(cls, point: ArrayLike, mass: float, com: ArrayLike, inertia: ArrayLike) -> Body:
        """Make a body from an inertia about another point than the mass centre.

        Parameters
        ----------
        point : array-like, shape (3,)
            The point that `inertia` is about, in the body frame [m].
        mass : float
            Mass [kg].
        com : array-like, shape (3,)
            Mass centre in the body frame [m].
        inertia : array-like, shape (3, 3) or (3,)
            Inertia about `point`, in the axes of the body frame [kg m²].

        Raises
        ------
        ParameterError
            If the numbers are not those of a body.
        """
        offset = frozen_array("com", com, (3,), ParameterError) - frozen_array(
            "point", point, (3,), ParameterError
        )
        moments = frozen_array("inertia", _matrix(inertia), (3, 3), ParameterError)
        weight = frozen_array("mass", mass, (), ParameterError)
        return cls(mass, np.asarray(com), moments - weight * steiner(offset))

    @classmethod
    def massless(cls) -> Body:
        """Return a body without mass."""
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    def joined(self, other: Body) -> Body:
        """Return the one body that this and another of the same frame, fixed to it, make; it has `parts`."""
        mass = self.mass + other.mass
        if mass == 0:
            return Body.massless()
        com = (self.mass * self.com + other.mass * other.com) / mass
        body = Body(mass, com, self.inertia_about(com) + other.inertia_about(com))
        parts = (*(self.parts or (self,)), other) if self.mass > 0 else ()
        object.__setattr__(body, "parts", parts if other.mass > 0 else self.parts)
        return body

    def inertia_about(self, point: ArrayLike) -> FloatArray:
        """Return the inertia (3, 3) about a point of the body frame (3,) [m], in its axes [kg m²]."""
        offset = self.com - frozen_array("point", point, (3,), ParameterError)
        moments: FloatArray = self.inertia + self.mass * steiner(offset)
        return moments

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists: the form of the parameter file."""
        return {"mass": self.mass, "com": self.com.tolist(), "inertia": self.inertia.tolist()}


def steiner(offset: FloatArray) -> FloatArray:
    """Return the inertia of a unit point mass at `offset` about the origin, |d|² 1 - d dᵀ [m²]."""
    moments: FloatArray = offset @ offset * np.eye(3) - np.outer(offset, offset)
    return moments


def _matrix(inertia: ArrayLike) -> FloatArray:
    """Return a diagonal given as three numbers as a matrix; anything else as it is."""
    array = as_floats("inertia", inertia, ParameterError)
    if array.shape not in ((3,), (3, 3)):
        raise ParameterError(f"inertia: expected three numbers, or 3 x 3 of them, got shape {array.shape}")
    return np.diag(array) if array.shape == (3,) else array


def _check_physical(inertia: FloatArray) -> None:
    scale = float(np.abs(inertia).max())
    if np.abs(inertia - inertia.T).max() > _TOLERANCE * scale:
        raise ParameterError("inertia: expected a symmetric matrix")
    low, middle, high = (float(moment) for moment in np.linalg.eigvalsh(inertia))
    if low < -_TOLERANCE * scale:
        raise ParameterError(f"inertia: expected principal moments of zero or more, got {low:g} kg m²")
    if high > low + middle + _TOLERANCE * scale:
        raise ParameterError(
            "inertia: expected each principal moment to be at most the sum of the other two, "
            f"got {high:g} > {low:g} + {middle:g} kg m² about the mass centre"
        )


@dataclass(frozen=True, eq=False)
class Bodies(Readable):
    """The ten moving bodies, one `Body` for each link.

    Parameters
    ----------
    slider_a, leg_a, slider_b, leg_b, slider_c : Body
        Sliders (T1) and legs (T2) of the legs A and B, slider of leg C.
    crossbar_upper, rod_left, crossbar_lower, platform, rod_right : Body
        T2, T3, T4, T5 and T6 of leg C. Only the cross-bars may be massless.

    Raises
    ------
    ParameterError
        If a field is not a `Body`, or a body other than a cross-bar has no mass.
    """

    slider_a: Body
    leg_a: Body
    slider_b: Body
    leg_b: Body
    slider_c: Body
    crossbar_upper: Body
    rod_left: Body
    crossbar_lower: Body
    platform: Body
    rod_right: Body

    def __post_init__(self) -> None:
        for name, body in self.items():
            if not isinstance(body, Body):
                raise ParameterError(f"{name}: expected a Body, got {type(body).__name__}")
            if body.mass == 0 and not name.startswith("crossbar"):
                raise ParameterError(f"{name}: expected a positive mass, got 0 kg")

    @classmethod
    def alike(cls, *, slider: Body, leg: Body, crossbar: Body, platform: Body) -> Bodies:
        """Make the usual set: equal sliders, equal legs and rods, equal cross-bars.

        Parameters
        ----------
        slider, leg, crossbar, platform : Body
            One body of each kind.
        """
        return cls(
            slider_a=slider,
            leg_a=leg,
            slider_b=slider,
            leg_b=leg,
            slider_c=slider,
            crossbar_upper=crossbar,
            rod_left=leg,
            crossbar_lower=crossbar,
            platform=platform,
            rod_right=leg,
        )

    def items(self) -> Iterator[tuple[str, Body]]:
        """Iterate over (link name, body)."""
        return ((item.name, getattr(self, item.name)) for item in fields(self))

    def scaled(self, factor: float) -> Bodies:
        """Return the bodies with all masses and inertias times a factor: a model that is wrong by so much.

        Parameters
        ----------
        factor : float
            Positive.

        Raises
        ------
        ParameterError
            If the factor is not positive.
        """
        by = positive("factor", factor, ParameterError)
        return Bodies(
            **{name: Body(by * body.mass, body.com, by * body.inertia) for name, body in self.items()}
        )

    @property
    def mass(self) -> float:
        """Total moving mass [kg]."""
        return sum(body.mass for _, body in self.items())


Scalar: TypeAlias = Any
"""A number, an array or a symbol; as in `p3dof._base.algebra`, which Pinocchio's way must not know."""

Vector: TypeAlias = tuple[Scalar, Scalar, Scalar]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]


class Inertial(NamedTuple):
    """Mass, mass centre and inertia about it, in the `Body` axes: numbers, arrays or symbols."""

    mass: Scalar
    com: Vector
    inertia: Matrix


def inertials(bodies: Bodies) -> dict[str, Inertial]:
    """Return the numbers of bodies as components; exact zeros become structural ones and cost nothing."""
    return {
        name: Inertial(
            body.mass or 0,
            numbers(body.com),
            (numbers(body.inertia[0]), numbers(body.inertia[1]), numbers(body.inertia[2])),
        )
        for name, body in bodies.items()
    }


def numbers(row: FloatArray) -> Vector:
    """Return three Python numbers, exact zeros as structural ones."""
    return (float(row[0]) or 0, float(row[1]) or 0, float(row[2]) or 0)


def inertial_of_box(size: Vector, density: Scalar) -> Inertial:
    """Return mass and inertia of a solid box about its middle."""
    x, y, z = size
    mass = density * x * y * z
    twelfth = mass / 12
    return Inertial(
        mass, (0, 0, 0), _diagonal(*(twelfth * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y))))
    )


def inertial_of_cylinder(
    radius: Scalar, length: Scalar, axis: int, start: Scalar, density: Scalar
) -> Inertial:
    """Return mass and inertia of a solid cylinder along one of the axes."""
    mass = density * math.pi * (radius * radius) * length
    across, along = mass * (3 * (radius * radius) + length * length) / 12, mass * (radius * radius) / 2
    com, moments = [0, 0, 0], [across, across, across]
    com[axis], moments[axis] = start + length / 2, along
    return Inertial(mass, (com[0], com[1], com[2]), _diagonal(*moments))


def inertial_of_plate(
    corners: FloatArray, size: Scalar, radius: Scalar, thickness: Scalar, density: Scalar
) -> Inertial:
    """Return mass and inertia of a plate: a triangle widened all round by a radius, of constant thickness."""
    pieces = _pieces(corners, size, radius)
    total = _sum(area for area, _, _ in pieces)
    centre = [_sum(area * point[k] for area, point, _ in pieces) / total for k in (0, 1)]
    second = [[_second(pieces, centre, i, j) for j in (0, 1)] for i in (0, 1)]  # ∫ d dᵀ dA
    across, mass = total * (thickness * thickness) / 12, density * thickness
    xx, yy, zz = second[1][1] + across, second[0][0] + across, second[0][0] + second[1][1]
    xy = -(mass * second[0][1])
    inertia = ((mass * xx, xy, 0), (xy, mass * yy, 0), (0, 0, mass * zz))
    return Inertial(mass * total, (centre[0], centre[1], 0), inertia)


_Piece = tuple[Scalar, tuple[Scalar, Scalar], "list[list[Scalar]]"]
"""Area, centroid and ∫ d dᵀ dA about it."""


def _second(pieces: list[_Piece], centre: list[Scalar], i: int, j: int) -> Scalar:
    return _sum(
        own[i][j] + area * ((point[i] - centre[i]) * (point[j] - centre[j])) for area, point, own in pieces
    )


def _pieces(corners: FloatArray, size: Scalar, radius: Scalar) -> list[_Piece]:
    """Cut the widened triangle into triangle, edge strips and corner sectors."""
    middle = corners.mean(axis=0)
    edges = np.roll(corners, -1, axis=0) - corners
    area = 0.5 * (edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    if area < 0:  # normals point outward on a counter-clockwise walk
        return _pieces(corners[::-1], size, radius)
    if area <= 1e-12 * float(np.abs(edges).max()) ** 2:
        raise ParameterError("corners: expected a triangle, got three points on a line")
    spokes, size2, radius2 = corners - middle, size * size, radius * radius
    core = (area / 12 * spokes.T @ spokes).tolist()
    pieces: list[_Piece] = [
        (float(area) * size2, _at(size, middle), [[size2 * size2 * m for m in row] for row in core])
    ]
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    for corner, edge, normal, previous in zip(
        corners, edges, normals, np.roll(normals, 1, axis=0), strict=True
    ):
        strip = float(np.linalg.norm(edge)) * (size * radius)
        along, across = np.outer(edge, edge).tolist(), np.outer(normal, normal).tolist()
        own = [[strip / 12 * (size2 * along[i][j] + radius2 * across[i][j]) for j in (0, 1)] for i in (0, 1)]
        pieces.append((strip, _at(size, corner + edge / 2, radius, normal / 2), own))
        pieces.append(_sector(size, corner, normal, previous, radius))
    return pieces


def _sector(
    size: Scalar, corner: FloatArray, normal: FloatArray, previous: FloatArray, radius: Scalar
) -> _Piece:
    """Return area, centroid and central second moments of the circular sector at a corner."""
    half = 0.5 * math.acos(float(normal @ previous))  # half the angle of the sector
    axis = (normal + previous) / np.linalg.norm(normal + previous)
    distance = 2 * math.sin(half) / (3 * half)  # all for a radius of one
    wave = math.sin(half) * math.cos(half)
    along, across = (half + wave) / 4 - half * distance**2, (half - wave) / 4
    other = np.array([-axis[1], axis[0]])
    own = (along * np.outer(axis, axis) + across * np.outer(other, other)).tolist()
    radius2 = radius * radius
    fourth = radius2 * radius2
    moments = [[fourth * m for m in row] for row in own]
    return half * radius2, _at(size, corner, radius, distance * axis), moments


def _at(
    size: Scalar, point: FloatArray, radius: Scalar = 0, beside: FloatArray | None = None
) -> tuple[Scalar, Scalar]:
    x, y = (size * float(part) for part in point)
    if beside is None:
        return x, y
    return x + radius * float(beside[0]), y + radius * float(beside[1])


def _sum(terms: Any) -> Scalar:
    first, *others = terms
    for term in others:
        first = first + term
    return first


def _diagonal(x: Scalar, y: Scalar, z: Scalar) -> Matrix:
    return (x, 0, 0), (0, y, 0), (0, 0, z)


LEGS = ("A", "B", "C")
"""The legs, each with its actuator."""

LINKS = tuple(item.name for item in fields(Bodies))
"""The ten moving bodies."""

SLIDES = ("slide_a", "slide_b", "slide_c")
"""The actuated joints, in the order of the legs."""

PASSIVE = (
    "hinge_a",
    "hinge_b",
    "hinge_c",
    "hinge_left",
    "hinge_right",
    "hinge_lower",
    "hinge_platform",
    "universal_a",
    "universal_b",
    "hinge_lower_right",
)
"""The passive joints: those of the URDF's tree, and the three at which its loops are cut."""

JOINT_GROUPS = {"sliders": SLIDES, "joints": PASSIVE}
"""Names that stand for several joints."""

PLATFORM = "platform_center"
"""The frame of the platform at P, with axes parallel to the fixed frame at θ = 0."""
