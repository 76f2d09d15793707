"""Closures that are no constraint models of Pinocchio: their kinds, errors, Jacobians and drifts.

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

Closures that are no constraint models of Pinocchio, at the one configuration that a `pin.Data` holds.

A frame anchor of Pinocchio tells where frame 2 is in the axes of frame 1, (d, E), and the velocity (V, ω) and
acceleration (a, α) of body 2 relative to body 1 at the origin of frame 1. With p and r the rows of a part of
`p3dof.loops.closure_kinds`, of which these are the same formulas for plain numbers,

    ḟ = p·ḋ + r·ω,    ḋ = V + ω × d
    f̈ = p·d̈ + r·α + b,    d̈ = a + α × d + ω × ḋ

Plain numbers take a tenth of the time of arrays with a few entries.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import acos, sqrt
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.coordinates import NEAR_TURN, cross, shortest_turn, skew, turned_rates, turned_rates_dot
from p3dof.loops.sidecar import Closure

IndexArray: TypeAlias = NDArray[np.int_]

HALF_TURN = 1.0 - 5e-13  # cosine of an angle from half a turn that still counts as half a turn, 1e-6 rad


@dataclass(frozen=True, eq=False)
class Relative:
    """Placement of frame 2 of closures in the axes of frame 1."""

    d: FloatArray  # (..., 3): its origin [m]
    E: FloatArray  # (..., 3, 3): its axes, as columns
    turn: FloatArray  # (..., 3): the rotation vector of `E` [rad]; of no meaning for kinds without a Turn
    length: FloatArray  # (...): the prescribed distance [m]; of no meaning for kinds without one

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
    """Some rows of a closure."""

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


LENGTHS = {
    "3d": (True,) * 3,
    "6d": (True,) * 3 + (False,) * 3,
    **{kind: tuple(length for part in parts for length in part.lengths) for kind, parts in PARTS.items()},
}
"""Which rows of a kind of closure are lengths; the others are angles."""


class KindRows:
    """The rows of some closures of these kinds, all closures of one kind at a time."""

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
        """Return the closures of each kind at some placements."""
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


Ends: TypeAlias = tuple[int, pin.SE3, int, pin.SE3]
"""Joint and placement in its body, of frame 1 and of frame 2."""
Three: TypeAlias = tuple[float, float, float]

_NEAR = 1e-4  # (1 - cosine)/2, or the square of an angle, below which few terms of a series are enough


class OtherClosures:
    """The closures of a model that are no constraint models of Pinocchio, at one configuration."""

    def __init__(
        self, model: pin.Model, closures: Sequence[Closure], ends: Sequence[Ends], rows: Sequence[slice]
    ) -> None:
        self._model, self._rows = model, rows
        # Frame anchors tell how frame 2 moves relative to frame 1.
        self._anchors, self._datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        for one in ends:
            self._anchors.append(pin.ConstraintModel(pin.FrameAnchorConstraintModel(model, *one)))
        for anchor in self._anchors:
            self._datas.append(anchor.createData())
        # Taken out once the vectors have their final place in memory: they are references, and so are these
        # arrays.
        self._pairs = list(zip(self._anchors, self._datas, strict=True))
        self._contents = [data.extract() for data in self._datas]
        self._places = [content.c1Mc2 for content in self._contents]
        self._d, self._E = [M.translation for M in self._places], [M.rotation for M in self._places]
        self._velocities = [content.constraint_velocity_error for content in self._contents]
        self._accelerations = [content.constraint_acceleration_error for content in self._contents]
        self._closures = [_KINDS[closure.kind](closure.length or 0.0) for closure in closures]
        self._at = np.array([k for part in rows for k in range(part.start, part.stop)], dtype=int)
        self._of = np.array([i for i, c in enumerate(closures) for _ in range(c.rows)], dtype=int)
        alike = len({c.rows for c in closures}) == 1
        self._each = (len(closures), closures[0].rows) if alike else (len(self._of), 1)
        self._alike = alike
        self._A: FloatArray = np.zeros((*self._each, 6))
        """The matrices from (V, ω) to the rates of the errors."""

    def calculate(self, data: pin.Data) -> None:
        """Let the frame anchors look at what `data` holds."""
        for anchor, anchored in self._pairs:
            anchor.calc(self._model, data, anchored)

    def evaluate(self, data: pin.Data, error: FloatArray, J: FloatArray) -> None:
        """Enter errors (size,) and their Jacobian (size, nv), after `calculate`."""
        rates = pin.getConstraintsJacobian(self._model, data, self._anchors, self._datas)
        rates = np.asarray(rates).reshape(len(self._pairs), 6, -1)
        places, axes = np.concatenate(self._d).tolist(), np.concatenate(self._E).tolist()
        errors: list[float] = []
        A: list[float] = []
        for i, closure in enumerate(self._closures):
            here = 3 * i
            d = places[here], places[here + 1], places[here + 2]
            closure.evaluate(d, axes[here : here + 3], errors, A)
        error[self._at] = errors
        self._A = np.array(A).reshape(*self._each, 6)
        J[self._at] = (self._A @ (rates if self._alike else rates[self._of])).reshape(len(self._at), -1)

    def accelerate(self, result: FloatArray) -> None:
        """Enter d²/dt² of the errors (size,) evaluated last, after `calculate` of a motion."""
        rates, bias = np.concatenate(self._velocities).tolist(), list[float]()
        for i, closure in enumerate(self._closures):
            x, y, z, *turning = rates[6 * i : 6 * i + 6]
            omega: Three = turning[0], turning[1], turning[2]
            carried = _cross(omega, closure.d)
            d_dot = x + carried[0], y + carried[1], z + carried[2]
            closure.bias(d_dot, omega, _cross(omega, d_dot), bias)
        accelerations = np.array(self._accelerations)
        if not self._alike:
            accelerations = accelerations[self._of]
        result[self._at] = (self._A @ accelerations[:, :, None]).ravel() + bias


class _Own:
    """One closure."""

    axes: tuple[int, ...] = ()  # which components of the position are prescribed

    def __init__(self, length: float) -> None:
        self.length = length
        self.d: Three = (0.0, 0.0, 0.0)

    def evaluate(self, d: Three, E: list[list[float]], errors: list[float], A: list[float]) -> None:
        """Append the errors, and the matrix from (V, ω) to their rates by rows; keep what `bias` needs."""
        x, y, z = self.d = d
        errors += [d[i] for i in self.axes]
        if 0 in self.axes:
            A += (1.0, 0.0, 0.0, 0.0, z, -y)
        if 1 in self.axes:
            A += (0.0, 1.0, 0.0, -z, 0.0, x)
        if 2 in self.axes:
            A += (0.0, 0.0, 1.0, y, -x, 0.0)
        self.rotation(E, errors, A)

    def bias(self, _d_dot: Three, omega: Three, across: Three, out: list[float]) -> None:
        """Append what the rates change by at zero (a, α); across is ω × ḋ."""
        out += [across[i] for i in self.axes]
        self.turning(omega, out)

    def rotation(self, E: list[list[float]], errors: list[float], A: list[float]) -> None:
        """Append the same of all other rows."""

    def turning(self, omega: Three, out: list[float]) -> None:
        """Append the same of all other rows."""


class _Tilted(_Own):
    """Rows of a Tilt: e = g(u_z) (-u_y, u_x) with u = z2 in the axes of frame 1."""

    def rotation(self, E: list[list[float]], errors: list[float], A: list[float]) -> None:
        x, y, z = self._u = E[0][2], E[1][2], E[2][2]
        g, slope, _ = self._shortest = _shortest(z)
        if z < -HALF_TURN:
            errors += (np.pi, 0.0)
            A += (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
            return
        errors += (-g * y, g * x)
        mixed, along = slope * x * y, g * z
        A += (0.0, 0.0, 0.0, along - slope * y * y, mixed, -g * x)
        A += (0.0, 0.0, 0.0, mixed, along - slope * x * x, -g * y)

    def turning(self, omega: Three, out: list[float]) -> None:
        (x, y, _), (g, slope, curvature) = self._u, self._shortest
        vx, vy, vz = velocity = _cross(omega, self._u)
        ax, ay, az = _cross(omega, velocity)
        along, twice = curvature * vz * vz + slope * az, 2.0 * slope * vz
        out += (-along * y - twice * vy - g * ay, along * x + twice * vx + g * ax)


class _Hinge(_Tilted):
    axes = (0, 1, 2)


class _Cylindrical(_Tilted):
    axes = (0, 1)


class _Planar(_Tilted):
    axes = (2,)


class _Slider(_Own):
    """Rows of a Turn: the rotation vector of E."""

    axes = (0, 1)

    def rotation(self, E: list[list[float]], errors: list[float], A: list[float]) -> None:
        turn = self._turn = pin.log3(np.array(E))
        x, y, z = turn.tolist()
        errors += (x, y, z)
        square = self._square = x * x + y * y + z * z
        if square > _NEAR:
            self._rates = turned_rates(turn).tolist()
        else:
            # V = 1 - [φ]/2 + k [φ]², with k = 1/12 + φ²/720 + φ⁴/30240.
            k = 1 / 12 + square * (1 / 720 + square / 30240)
            xy, yz, zx, x, y, z, c = k * x * y, k * y * z, k * z * x, x / 2, y / 2, z / 2, 1.0 - k * square
            self._rates = [
                [c + 4 * k * x * x, xy + z, zx - y],
                [xy - z, c + 4 * k * y * y, yz + x],
                [zx + y, yz - x, c + 4 * k * z * z],
            ]
        for row in self._rates:
            A += (0.0, 0.0, 0.0, *row)

    def turning(self, omega: Three, out: list[float]) -> None:
        turn, square = self._turn, self._square
        if square > _NEAR:
            out += turned_rates_dot(turn, np.array(omega)).dot(omega).tolist()
            return
        k, change = 1 / 12 + square * (1 / 720 + square / 30240), 1 / 720 + square / 15120
        phi, (x, y, z) = turn.tolist(), omega
        rate = [row[0] * x + row[1] * y + row[2] * z for row in self._rates]
        first, second = _cross(phi, omega), _cross(rate, omega)
        one, other, twice = _cross(rate, first), _cross(phi, second), _cross(phi, first)
        growth = 2.0 * change * (phi[0] * rate[0] + phi[1] * rate[1] + phi[2] * rate[2])
        out += [-0.5 * second[i] + k * (one[i] + other[i]) + growth * twice[i] for i in range(3)]


class _Universal(_Own):
    """Rows of a Square: -x1·y2."""

    axes = (0, 1, 2)

    def rotation(self, E: list[list[float]], errors: list[float], A: list[float]) -> None:
        x, y, z = self._y2 = E[0][1], E[1][1], E[2][1]
        errors.append(-x)
        A += (0.0, 0.0, 0.0, 0.0, -z, y)

    def turning(self, omega: Three, out: list[float]) -> None:
        out.append(-_cross(omega, _cross(omega, self._y2))[0])


class _Distance(_Own):
    """The row of a Rod: |d| - length."""

    def evaluate(self, d: Three, _E: list[list[float]], errors: list[float], A: list[float]) -> None:
        x, y, z = self.d = d
        distance = self._distance = sqrt(x * x + y * y + z * z)
        self._along = (x / distance, y / distance, z / distance) if distance > 0 else (1.0, 0.0, 0.0)
        errors.append(distance - self.length)
        A += (*self._along, *_cross(d, self._along))

    def bias(self, d_dot: Three, _omega: Three, across: Three, out: list[float]) -> None:
        a, b, c = self._along
        x, y, z = d_dot
        speed = a * x + b * y + c * z
        square = (x - speed * a) ** 2 + (y - speed * b) ** 2 + (z - speed * c) ** 2
        centripetal = square / self._distance if self._distance > 0 else 0.0
        out.append(a * across[0] + b * across[1] + c * across[2] + centripetal)


_KINDS: dict[str, type[_Own]] = {
    "hinge": _Hinge,
    "slider": _Slider,
    "universal": _Universal,
    "cylindrical": _Cylindrical,
    "planar": _Planar,
    "distance": _Distance,
}


def _cross(a: Sequence[float], b: Sequence[float]) -> Three:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _shortest(cosine: float) -> Three:
    """Return what `rotations.shortest_turn` does, of one number."""
    c = max(min(cosine, 1.0), -1.0)
    y = 0.5 * (1.0 - c)
    if y < _NEAR:
        # g = Σ aₖ yᵏ, aₖ = aₖ₋₁ 2k/(2k + 1), and its derivatives by the cosine, 1 - 2y.
        g = 1.0 + y * (2 / 3 + y * (8 / 15 + y * (16 / 35 + y * 128 / 315)))
        slope = -0.5 * (2 / 3 + y * (16 / 15 + y * (48 / 35 + y * 512 / 315)))
        return g, slope, 0.25 * (16 / 15 + y * (96 / 35 + y * (512 / 105 + y * 5120 / 693)))
    if y < NEAR_TURN:
        g, slope, curvature = (float(value) for value in shortest_turn(np.array(c)))
        return g, slope, curvature
    square = max(1.0 - c * c, 1e-12)
    g = acos(c) / sqrt(square)
    slope = (c * g - 1.0) / square
    return g, slope, (g + 3.0 * c * slope) / square
