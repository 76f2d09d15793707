"""Closures that are no constraint models of Pinocchio, at the one configuration that a `pin.Data` holds.

A frame anchor of Pinocchio tells where frame 2 is in the axes of frame 1, (d, E), and the velocity (V, ω) and
acceleration (a, α) of body 2 relative to body 1 at the origin of frame 1. With p and r the rows of a part of
`p3dof.loops.closure_kinds`, of which these are the same formulas for plain numbers,

    ḟ = p·ḋ + r·ω,    ḋ = V + ω × d
    f̈ = p·d̈ + r·α + b,    d̈ = a + α × d + ω × ḋ

Plain numbers take a tenth of the time of arrays with a few entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, sqrt
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.closure_kinds import HALF_TURN
from p3dof.loops.constraints import Closure
from p3dof.loops.rotations import NEAR_TURN, shortest_turn, turned_rates, turned_rates_dot

Ends: TypeAlias = tuple[int, pin.SE3, int, pin.SE3]
"""Joint and placement in its body, of frame 1 and of frame 2."""
Three: TypeAlias = tuple[float, float, float]

_NEAR = 1e-4
"""(1 - cosine)/2, or the square of an angle, below which few terms of a series are enough."""


class OtherClosures:
    """The closures of a model that are no constraint models of Pinocchio, at one configuration.

    Parameters
    ----------
    model : pin.Model
        The tree.
    closures : sequence of Closure
        The closures.
    ends : sequence of Ends
        The frames of each.
    rows : sequence of slice
        The rows of each.
    """

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
    """One closure.

    Parameters
    ----------
    length : float
        Its length, if it has one.
    """

    axes: tuple[int, ...] = ()
    """Which components of the position are prescribed."""

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
