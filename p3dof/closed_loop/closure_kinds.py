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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof.checks import FloatArray
from p3dof.closed_loop.constraints import Closure
from p3dof.closed_loop.rotations import cross, shortest_turn, skew, turned_rates, turned_rates_dot

IndexArray: TypeAlias = NDArray[np.int_]

_HALF_TURN = 1e-6
"""Sine of an angle that counts as half a turn [rad]."""


@dataclass(frozen=True, eq=False)
class Relative:
    """Placement of frame 2 of a closure in the axes of frame 1.

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

    def matrix(self, at: Relative) -> FloatArray:
        """Return the matrices A (..., rows, 6) from (ḋ, ω) to the rates of the errors."""

    def bias(self, at: Relative, d_dot: FloatArray, omega: FloatArray) -> FloatArray:
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

    def matrix(self, at: Relative) -> FloatArray:
        return np.broadcast_to(np.eye(6)[list(self.axes)], (*at.d.shape[:-1], len(self.axes), 6))

    def bias(self, at: Relative, _d_dot: FloatArray, _omega: FloatArray) -> FloatArray:
        return np.zeros((*at.d.shape[:-1], len(self.axes)))


class _Tilt:
    """How far z2 is from z1: g(u_z) (-u_y, u_x) with u = E z, where g is the angle over its sine."""

    lengths = (False, False)

    def error(self, at: Relative) -> FloatArray:
        u = at.E[..., 2]
        error = shortest_turn(u[..., 2])[0][..., None] * _across(u)
        error[_opposite(u)] = np.pi, 0.0
        return np.asarray(error)

    def matrix(self, at: Relative) -> FloatArray:
        u = at.E[..., 2]
        g, slope, _ = shortest_turn(u[..., 2])
        gradient = np.zeros((*u.shape[:-1], 2, 3))  # by u
        gradient[..., 0, 1], gradient[..., 1, 0] = -g, g
        gradient[..., 2] = slope[..., None] * _across(u)
        A = gradient @ -skew(u)
        A[_opposite(u)] = np.eye(2, 3)
        return _angular(A)

    def bias(self, at: Relative, _d_dot: FloatArray, omega: FloatArray) -> FloatArray:
        u = at.E[..., 2]
        u_dot = cross(omega, u)
        u_ddot = cross(omega, u_dot)
        g, slope, curvature = (value[..., None] for value in shortest_turn(u[..., 2]))
        z_dot, z_ddot = u_dot[..., 2:], u_ddot[..., 2:]
        rate = 2.0 * slope * z_dot * _across(u_dot)
        return np.asarray((curvature * z_dot**2 + slope * z_ddot) * _across(u) + rate + g * _across(u_ddot))


class _Turn:
    """The whole rotation."""

    lengths = (False, False, False)

    def error(self, at: Relative) -> FloatArray:
        return at.turn

    def matrix(self, at: Relative) -> FloatArray:
        return _angular(turned_rates(at.turn))

    def bias(self, at: Relative, _d_dot: FloatArray, omega: FloatArray) -> FloatArray:
        return np.asarray((turned_rates_dot(at.turn, omega) @ omega[..., None])[..., 0])


class _Square:
    """The angle between x1 and y2, a right one."""

    lengths = (False,)

    def error(self, at: Relative) -> FloatArray:
        return -at.E[..., 0, 1:2]

    def matrix(self, at: Relative) -> FloatArray:
        y = at.E[..., 1]
        zero = np.zeros(y.shape[:-1])
        return _angular(np.stack((zero, -y[..., 2], y[..., 1]), axis=-1)[..., None, :])

    def bias(self, at: Relative, _d_dot: FloatArray, omega: FloatArray) -> FloatArray:
        return -cross(omega, cross(omega, at.E[..., 1]))[..., :1]


class _Rod:
    """The distance of the origins."""

    lengths = (True,)

    def error(self, at: Relative) -> FloatArray:
        return _distance(at)[0] - at.length[..., None]

    def matrix(self, at: Relative) -> FloatArray:
        _, direction = _distance(at)
        return np.concatenate((direction, np.zeros_like(direction)), axis=-1)[..., None, :]

    def bias(self, at: Relative, d_dot: FloatArray, _omega: FloatArray) -> FloatArray:
        distance, direction = _distance(at)
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
        self._groups: list[tuple[tuple[_Part, ...], IndexArray, IndexArray]] = []
        for kind in dict.fromkeys(closure.kind for closure in closures):
            which = [i for i, closure in enumerate(closures) if closure.kind == kind]
            where = np.array([range(rows[i].start, rows[i].stop) for i in which])
            self._groups.append((PARTS[kind], np.array(which), where))
        self.turning = np.array([i for i, c in enumerate(closures) if c.kind == "slider"], dtype=int)
        """Which closures need `Relative.turn`."""

    def errors(self, d: FloatArray, E: FloatArray, turn: FloatArray, out: FloatArray) -> None:
        """Enter the errors.

        Parameters
        ----------
        d, E, turn : (..., count, 3), (..., count, 3, 3), (..., count, 3) array
            Placements as in `Relative`.
        out : (..., size) array
            Where the rows go.
        """
        for parts, at, _, rows in self._each(d, E, turn):
            out[..., rows] = np.concatenate([part.error(at) for part in parts], axis=-1)

    def jacobian(
        self, d: FloatArray, E: FloatArray, turn: FloatArray, J: FloatArray, out: FloatArray
    ) -> None:
        """Enter the Jacobian.

        Parameters
        ----------
        d, E, turn : array
            As for `errors`.
        J : (..., count, 6, nv) array
            The matrices from v to (ḋ, ω).
        out : (..., size, nv) array
            Where the rows go.
        """
        for parts, at, which, rows in self._each(d, E, turn):
            A = np.concatenate([part.matrix(at) for part in parts], axis=-2)
            out[..., rows, :] = A @ J[..., which, :, :]

    def drift(
        self,
        d: FloatArray,
        E: FloatArray,
        turn: FloatArray,
        motion: tuple[FloatArray, FloatArray],
        out: FloatArray,
    ) -> None:
        """Enter the second derivatives of the errors.

        Parameters
        ----------
        d, E, turn : array
            As for `errors`.
        motion : tuple of (..., count, 6) array
            (ḋ, ω) and (d̈, ω̇).
        out : (..., size) array
            Where the rows go.
        """
        for parts, at, which, rows in self._each(d, E, turn):
            rate, acceleration = (values[..., which, :] for values in motion)
            A = np.concatenate([part.matrix(at) for part in parts], axis=-2)
            bias = [part.bias(at, rate[..., :3], rate[..., 3:]) for part in parts]
            out[..., rows] = (A @ acceleration[..., None])[..., 0] + np.concatenate(bias, axis=-1)

    def _each(
        self, d: FloatArray, E: FloatArray, turn: FloatArray
    ) -> Iterator[tuple[tuple[_Part, ...], Relative, IndexArray, IndexArray]]:
        for parts, which, rows in self._groups:
            place = d[..., which, :], E[..., which, :, :], turn[..., which, :], self._lengths[which]
            yield parts, Relative(*place), which, rows


def _opposite(u: FloatArray) -> NDArray[np.bool_]:
    """Whether u is that of half a turn, which may be about any axis; that about x1 is taken."""
    return np.asarray((u[..., 2] < 0.0) & (np.hypot(u[..., 0], u[..., 1]) < _HALF_TURN))


def _across(u: FloatArray) -> FloatArray:
    """Return x and y of z × u."""
    return np.stack((-u[..., 1], u[..., 0]), axis=-1)


def _angular(A: FloatArray) -> FloatArray:
    """Return matrices (..., rows, 6) whose last three columns are A."""
    return np.concatenate((np.zeros_like(A), A), axis=-1)


def _distance(at: Relative) -> tuple[FloatArray, FloatArray]:
    """Return the distance (..., 1) and its direction (..., 3), which is x where it has none."""
    distance = np.linalg.norm(at.d, axis=-1, keepdims=True)
    direction = np.divide(at.d, distance, out=np.zeros_like(at.d), where=distance > 0)
    direction[..., :1] += distance == 0
    return distance, direction
