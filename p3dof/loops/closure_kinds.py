"""Errors of the kinds of closure that Pinocchio does not know, their Jacobians and drifts.

Everything follows from the placement of frame 2 in the axes of frame 1, d = R1ᵀ (p2 - p1) and E = R1ᵀ R2, and
from its rates ḋ and ω, where Ė = ω × E. A kind is a few Part objects under each other, each with its errors
f(d, E), the matrix of ḟ = A (ḋ, ω), and the part of f̈ = A (d̈, ω̇) + b that is left at zero acceleration:

- Position: chosen components of d [m]; the multiplier is the force [N] along these axes of frame 1;
- Tilt: x and y of the rotation vector of the shortest turn from z1 to z2 [rad], whose z is zero; the
  multiplier is the moment [N m] about x1 and y1;
- Turn: the rotation vector of E [rad]; the multiplier is the moment [N m] about x1, y1 and z1;
- Square: -x1·y2 [rad]; the multiplier is the moment [N m] about x1 × y2;
- Rod: |d| - length [m]; the multiplier is the force [N] along d, positive if it pushes the frames apart.

Multipliers act on the body of frame 2, and their opposite on that of frame 1; the forces act at the origin of
frame 2. All parts are exact away from the closed configurations too, but Tilt and Turn have no derivative at
half a turn, and Rod none where the origins coincide: there Tilt turns about x1, and Rod points along it.

Everything works on stacks: leading axes, if there are any, count samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.constraints import Closure
from p3dof.loops.rotations import cross, shortest_turn, skew, turned_rates, turned_rates_dot

IndexArray: TypeAlias = NDArray[np.int_]

HALF_TURN = 1.0 - 5e-13
"""Cosine of an angle from half a turn that still counts as half a turn, 1e-6 rad."""


@dataclass(frozen=True, eq=False)
class Relative:
    """Placement of frame 2 of closures in the axes of frame 1.

    Parameters
    ----------
    d : (..., 3) array
        Its origin [m].
    E : (..., 3, 3) array
        Its axes, as columns.
    turn : (..., 3) array
        The rotation vector of `E` [rad]; of no meaning for kinds without a Turn.
    length : (...) array
        The prescribed distance [m]; of no meaning for kinds without one.
    """

    d: FloatArray
    E: FloatArray
    turn: FloatArray
    length: FloatArray

    @cached_property
    def shortest(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The angle from z1 to z2 over its sine (..., 1), and its derivatives by the cosine."""
        g, slope, curvature = shortest_turn(self.E[..., 2, 2])
        return g[..., None], slope[..., None], curvature[..., None]

    @cached_property
    def opposite(self) -> NDArray[np.bool_] | None:
        """Whether z2 is -z1 (...): half a turn, which may be about any axis; that about x1 is taken."""
        found: NDArray[np.bool_] = self.E[..., 2, 2] < -HALF_TURN
        return found if found.any() else None

    @cached_property
    def rod(self) -> tuple[FloatArray, FloatArray]:
        """The distance (..., 1) and its direction (..., 3), which is x1 where it has none."""
        distance = np.sqrt(np.sum(self.d * self.d, axis=-1, keepdims=True))
        direction = np.divide(self.d, distance, out=np.zeros_like(self.d), where=distance > 0)
        direction[..., :1] += distance == 0
        return distance, direction


class _Part(Protocol):
    """Some rows of a closure.

    Attributes
    ----------
    lengths : tuple of bool
        Which of them are lengths, one a row.
    """

    @property
    def lengths(self) -> tuple[bool, ...]: ...

    def error(self, at: Relative) -> FloatArray:
        """Return the errors (..., rows)."""

    def matrix(self, at: Relative, A: FloatArray) -> None:
        """Enter the matrices from (ḋ, ω) to the rates of the errors into A (..., rows, 6), which is zero."""

    def bias(self, at: Relative, d_dot: FloatArray, omega: FloatArray) -> FloatArray | float:
        """Return what (..., rows) the rates of the errors change by at zero (d̈, ω̇)."""


@dataclass(frozen=True)
class _Position:
    """Chosen components of the position."""

    axes: tuple[int, ...]

    @property
    def lengths(self) -> tuple[bool, ...]:
        return (True,) * len(self.axes)

    def error(self, at: Relative) -> FloatArray:
        return at.d[..., self.axes]

    def matrix(self, _at: Relative, A: FloatArray) -> None:
        A[..., range(len(self.axes)), self.axes] = 1.0

    def bias(self, _at: Relative, _d_dot: FloatArray, _omega: FloatArray) -> float:
        return 0.0


class _Tilt:
    """How far z2 is from z1: g(u_z) (-u_y, u_x) with u = E z, where g is the angle over its sine."""

    lengths = (False, False)

    def error(self, at: Relative) -> FloatArray:
        error = at.shortest[0] * _across(at.E[..., 2])
        if at.opposite is not None:
            error[at.opposite] = np.pi, 0.0
        return np.asarray(error)

    def matrix(self, at: Relative, A: FloatArray) -> None:
        u, (g, slope, _) = at.E[..., 2], at.shortest
        gradient = np.zeros((*u.shape[:-1], 2, 3))  # by u
        gradient[..., 0, 1], gradient[..., 1, 0] = -g[..., 0], g[..., 0]
        gradient[..., 2] = slope * _across(u)
        A[..., 3:] = gradient @ -skew(u)
        if at.opposite is not None:
            A[at.opposite] = np.eye(2, 6, 3)

    def bias(self, at: Relative, _d_dot: FloatArray, omega: FloatArray) -> FloatArray:
        u, (g, slope, curvature) = at.E[..., 2], at.shortest
        u_dot = cross(omega, u)
        u_ddot = cross(omega, u_dot)
        z_dot, z_ddot = u_dot[..., 2:], u_ddot[..., 2:]
        rate = 2.0 * slope * z_dot * _across(u_dot)
        return np.asarray((curvature * z_dot**2 + slope * z_ddot) * _across(u) + rate + g * _across(u_ddot))


class _Turn:
    """The whole rotation."""

    lengths = (False, False, False)

    def error(self, at: Relative) -> FloatArray:
        return at.turn

    def matrix(self, at: Relative, A: FloatArray) -> None:
        A[..., 3:] = turned_rates(at.turn)

    def bias(self, at: Relative, _d_dot: FloatArray, omega: FloatArray) -> FloatArray:
        return np.asarray((turned_rates_dot(at.turn, omega) @ omega[..., None])[..., 0])


class _Square:
    """The angle between x1 and y2, a right one."""

    lengths = (False,)

    def error(self, at: Relative) -> FloatArray:
        return -at.E[..., 0, 1:2]

    def matrix(self, at: Relative, A: FloatArray) -> None:
        A[..., 0, 4], A[..., 0, 5] = -at.E[..., 2, 1], at.E[..., 1, 1]

    def bias(self, at: Relative, _d_dot: FloatArray, omega: FloatArray) -> FloatArray:
        return -cross(omega, cross(omega, at.E[..., 1]))[..., :1]


class _Rod:
    """The distance of the origins."""

    lengths = (True,)

    def error(self, at: Relative) -> FloatArray:
        return at.rod[0] - at.length[..., None]

    def matrix(self, at: Relative, A: FloatArray) -> None:
        A[..., 0, :3] = at.rod[1]

    def bias(self, at: Relative, d_dot: FloatArray, _omega: FloatArray) -> FloatArray:
        distance, direction = at.rod
        across = d_dot - np.sum(direction * d_dot, axis=-1, keepdims=True) * direction
        square = np.sum(across**2, axis=-1, keepdims=True)
        return np.asarray(np.divide(square, distance, out=np.zeros_like(square), where=distance > 0))


PARTS: Mapping[str, tuple[_Part, ...]] = MappingProxyType(
    {
        "hinge": (_Position((0, 1, 2)), _Tilt()),
        "slider": (_Position((0, 1)), _Turn()),
        "universal": (_Position((0, 1, 2)), _Square()),
        "cylindrical": (_Position((0, 1)), _Tilt()),
        "planar": (_Position((2,)), _Tilt()),
        "distance": (_Rod(),),
    }
)
"""The parts of each kind; those that are not here are constraint models of Pinocchio."""


def lengths_of(kind: str) -> tuple[bool, ...]:
    """Return which rows of a kind of closure are lengths; the others are angles."""
    if kind in PARTS:
        return tuple(is_length for part in PARTS[kind] for is_length in part.lengths)
    return (True,) * 3 if kind == "3d" else (True,) * 3 + (False,) * 3


class KindRows:
    """The rows of some closures of these kinds, all closures of one kind at a time.

    Parameters
    ----------
    closures : sequence of Closure
        The closures.
    rows : sequence of slice
        The rows of each.
    """

    def __init__(self, closures: Sequence[Closure], rows: Sequence[slice]) -> None:
        self.count = len(closures)
        self._lengths = np.array([closure.length or 0.0 for closure in closures])
        self._groups: list[tuple[tuple[_Part, ...], IndexArray | slice, IndexArray]] = []
        for kind in dict.fromkeys(closure.kind for closure in closures):
            which = [i for i, closure in enumerate(closures) if closure.kind == kind]
            where = np.array([range(rows[i].start, rows[i].stop) for i in which])
            alone = len(which) == len(closures)
            self._groups.append((PARTS[kind], slice(None) if alone else np.array(which), where))
        self.turning = np.array([i for i, c in enumerate(closures) if c.kind == "slider"], dtype=int)
        """Which closures need `Relative.turn`."""

    def at(self, d: FloatArray, E: FloatArray, turn: FloatArray) -> list[_Group]:
        """Return the closures of each kind at some placements.

        Parameters
        ----------
        d, E, turn : (..., count, 3), (..., count, 3, 3), (..., count, 3) array
            Placements as in `Relative`.
        """
        return [
            _Group(
                parts,
                Relative(d[..., which, :], E[..., which, :, :], turn[..., which, :], self._lengths[which]),
                which,
                rows,
            )
            for parts, which, rows in self._groups
        ]


@dataclass(frozen=True, eq=False)
class _Group:
    """The closures of one kind at some placements: which they are, and their rows."""

    parts: tuple[_Part, ...]
    at: Relative
    which: IndexArray | slice
    rows: IndexArray

    @cached_property
    def A(self) -> FloatArray:  # noqa: N802
        """The matrices (..., n, rows, 6) from (ḋ, ω) to the rates of the errors."""
        A, start = np.zeros((*self.at.d.shape[:-1], self.rows.shape[1], 6)), 0
        for part in self.parts:
            stop = start + len(part.lengths)
            part.matrix(self.at, A[..., start:stop, :])
            start = stop
        return A

    def errors(self, out: FloatArray) -> None:
        """Enter the errors into (..., size)."""
        out[..., self.rows] = np.concatenate([part.error(self.at) for part in self.parts], axis=-1)

    def jacobian(self, J: FloatArray, out: FloatArray) -> None:
        """Enter the Jacobian into (..., size, nv), from J (..., count, 6, nv), which takes v to (ḋ, ω)."""
        out[..., self.rows, :] = self.A @ J[..., self.which, :, :]

    def drift(self, rates: FloatArray, accelerations: FloatArray, out: FloatArray) -> None:
        """Enter the errors' second derivatives into (..., size), from (ḋ, ω), (d̈, ω̇) (..., count, 6)."""
        rate, start = rates[..., self.which, :], 0
        found = (self.A @ accelerations[..., self.which, :, None])[..., 0]
        for part in self.parts:
            stop = start + len(part.lengths)
            found[..., start:stop] += part.bias(self.at, rate[..., :3], rate[..., 3:])
            start = stop
        out[..., self.rows] = found


def _across(u: FloatArray) -> FloatArray:
    """Return x and y of z × u."""
    result = np.empty((*u.shape[:-1], 2))
    result[..., 0], result[..., 1] = -u[..., 1], u[..., 0]
    return result
