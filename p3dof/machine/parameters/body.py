"""`Body`: the inertial parameters of one rigid body."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, as_floats, frozen_array
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
    com : array-like, shape (3,)
        Mass centre in the body frame [m].
    inertia : array-like, shape (3, 3) or (3,)
        Inertia about the mass centre, in the axes of the body frame [kg m²]; three numbers are a diagonal.

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
    com: FloatArray
    inertia: FloatArray
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

        Returns
        -------
        Body

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
        """Return the one body that this and another, fixed to it, make.

        Parameters
        ----------
        other : Body
            In the same frame.

        Returns
        -------
        Body
            It remembers its `parts`, unless one of them has no mass.
        """
        mass = self.mass + other.mass
        if mass == 0:
            return Body.massless()
        com = (self.mass * self.com + other.mass * other.com) / mass
        body = Body(mass, com, self.inertia_about(com) + other.inertia_about(com))
        parts = (*(self.parts or (self,)), other) if self.mass > 0 else ()
        object.__setattr__(body, "parts", parts if other.mass > 0 else self.parts)
        return body

    def inertia_about(self, point: ArrayLike) -> FloatArray:
        """Return the inertia about a point of the body frame.

        Parameters
        ----------
        point : array-like, shape (3,)
            The point, in the body frame [m].

        Returns
        -------
        ndarray, shape (3, 3)
            Inertia about that point, in the axes of the body frame [kg m²].
        """
        offset = self.com - frozen_array("point", point, (3,), ParameterError)
        moments: FloatArray = self.inertia + self.mass * steiner(offset)
        return moments

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists: the form of the parameter file."""
        return {"mass": self.mass, "com": self.com.tolist(), "inertia": self.inertia.tolist()}


def steiner(offset: FloatArray) -> FloatArray:
    """Return the inertia of a unit point mass at `offset` about the origin, |d|² 1 - d dᵀ [m²].

    Parameters
    ----------
    offset : ndarray, shape (3,)
        Position of the mass [m].

    Returns
    -------
    ndarray, shape (3, 3)
    """
    moments: FloatArray = offset @ offset * np.eye(3) - np.outer(offset, offset)
    return moments


def _matrix(inertia: ArrayLike) -> FloatArray:
    """Return a diagonal given as three numbers as a matrix; anything else as it is."""
    array = as_floats("inertia", inertia, ParameterError)
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
