"""How velocities and accelerations at closed loops change with configuration and velocity; exact.

Where the loops are closed, and along motions that keep them so, every kind of closure is the same as a
function that is linear in the entries of T = M1⁻¹ M2, the placement of frame 2 in the axes of frame 1:
positions and, as the rotations that are prescribed are none, entries of the rotation matrix. A rod is
(d·d - length²) / (2 length). The rates follow from Ṁ = [V] M, where [V] is the 4 x 4 matrix of a spatial
velocity in the world:

    Ṫ = M1⁻¹ [V2 - V1] M2,
    T̈ = M1⁻¹ ([A2 - A1] - [V1] [V2 - V1] + [V2 - V1] [V2]) M2.        (1)

Derivatives of the bodies' V and A are those of `p3dof.closed_loop.tree_tangents`. Those of accelerations are
exact for velocities that keep the loops closed. A gap leaves an error of its own size.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from p3dof.checks import FloatArray
from p3dof.closed_loop.closures import LoopKinematics
from p3dof.closed_loop.constraints import Coupling
from p3dof.closed_loop.coupling_tangents import CouplingTangents
from p3dof.closed_loop.relative_motion import Ends
from p3dof.closed_loop.tree_tangents import TreeMotion, hat

_X, _Y, _Z = 3, 7, 11
"""Where the position is among the twelve entries of T, three rows of four."""
_TILT = ({6: -1.0}, {2: 1.0})
"""x and y of z1 × z2: -E_yz, E_xz."""
_TURN = ({9: 0.5, 6: -0.5}, {2: 0.5, 8: -0.5}, {4: 0.5, 1: -0.5})
_POINT = ({_X: 1.0}, {_Y: 1.0}, {_Z: 1.0})
_ENTRIES: dict[str, tuple[dict[int, float], ...]] = {
    "3d": _POINT,
    "6d": (*_POINT, *_TURN),
    "hinge": (*_POINT, *_TILT),
    "slider": (*_POINT[:2], *_TURN),
    "universal": (*_POINT, {1: -1.0}),
    "cylindrical": (*_POINT[:2], *_TILT),
    "planar": (_POINT[2], *_TILT),
}
"""Of each kind but the rod, its rows as combinations of entries of T."""


class ClosureTangents:
    """Derivatives of J v and d(J v)/dt of closures and couplings, in one motion.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    couplings : sequence of Coupling
        Its couplings.
    motion : TreeMotion
        The motion of its bodies.
    q : (nq,) array
        Configuration.
    v, a : (nv,) array
        Velocity and acceleration.
    """

    def __init__(
        self,
        kinematics: LoopKinematics,
        couplings: Sequence[Coupling],
        motion: TreeMotion,
        q: FloatArray,
        v: FloatArray,
        a: FloatArray,
    ) -> None:
        self._k, self._motion, self._v = kinematics, motion, v
        pairs = zip(kinematics.closures, kinematics.ends, strict=True)
        self._loops = [_Loop(motion, closure.kind, closure.length, ends) for closure, ends in pairs]
        self._couplings = CouplingTangents(kinematics.model, couplings, q)
        self._a = a

    def velocity_by_q(self, w: FloatArray) -> FloatArray:
        """Return the derivative by q of J w (rows, nv), w (nv,) being constant."""
        motion = self._motion
        V: FloatArray = motion.tree.carries.T.astype(float) @ (motion.J * w[:, None])
        turned = motion.turned(V)
        parts = [loop.velocity_by_q(V, turned) for loop in self._loops]
        return self._stacked([*parts, self._couplings.velocity_by_q(w)])

    def jacobian_rate(self) -> FloatArray:
        """Return J̇ (rows, nv) at the velocity."""
        parts = [loop.jacobian_rate() for loop in self._loops]
        return self._stacked([*parts, self._couplings.jacobian_rate(self._v)])

    @cached_property
    def acceleration(self) -> tuple[FloatArray, FloatArray]:
        """The derivatives (rows, nv) by q and by v of the accelerations J a + J̇ v."""
        parts = [loop.acceleration for loop in self._loops]
        by_q, by_v = self._couplings.acceleration(self._v, self._a)
        return (
            self._stacked([*(part[0] for part in parts), by_q]),
            self._stacked([*(part[1] for part in parts), by_v]),
        )

    def force_by_q(self, lambda_: FloatArray) -> FloatArray:
        """Return the derivative by q of Jᵀ λ (nv, nv), λ (rows,) being constant."""
        rows = self._k.rows
        total = self._couplings.force_by_q(lambda_[self._k.coupled])
        for loop, at in zip(self._loops, rows[: len(self._loops)], strict=True):
            total = total + loop.force_by_q(lambda_[at])
        return total

    def _stacked(self, parts: list[FloatArray]) -> FloatArray:
        return np.concatenate([np.zeros((0, self._k.model.nv)), *parts])


class _Loop:
    """One closure in one motion; matrices (nv, 4, 4) have one row of entries for each entry of v."""

    def __init__(self, motion: TreeMotion, kind: str, length: float | None, ends: Ends) -> None:
        self._motion, (one, M1, two, M2) = motion, ends
        self._one, self._two = (int(motion.tree.bodies[joint]) for joint in (one, two))
        place1, place2 = motion.M[self._one] * M1, motion.M[self._two] * M2
        self._into = place1.inverse().homogeneous
        self._M2 = place2.homogeneous
        self._Ad1, self._Ad2 = place1.inverse().action, place2.inverse().action
        self._rod, self._length = length is not None, length or 1.0
        columns1, columns2 = motion.columns(self._one), motion.columns(self._two)
        self._hats1, self._hats2 = hat(columns1 @ self._Ad1.T), hat(columns2 @ self._Ad2.T)
        self._moves = np.asarray(self._into @ hat(np.eye(6)) @ self._M2).reshape(6, 16)
        self._dT = self._moved(columns2 - columns1)
        self._V1 = hat(self._Ad1 @ motion.V[self._one])
        self._V2 = hat(self._Ad2 @ motion.V[self._two])
        self._rate = self._moved(motion.V[self._two] - motion.V[self._one])
        rows = _ENTRIES.get(kind)
        d = (self._into @ self._M2)[:3, 3]
        entries = ({_X: d[0], _Y: d[1], _Z: d[2]},) if rows is None else rows
        self._L = np.zeros((len(entries), 16))
        for row, values in enumerate(entries):
            for at, value in values.items():
                self._L[row, at] = value
        if rows is None:
            self._L /= self._length

    def _moved(self, V: FloatArray) -> FloatArray:
        """Return M1⁻¹ [V] M2 (..., 4, 4)."""
        return np.asarray(V @ self._moves).reshape(*V.shape[:-1], 4, 4)

    def _rows(self, T: FloatArray) -> FloatArray:
        """Return the closure's rows (rows, nv) of changes (nv, 4, 4) of T or its rates."""
        return np.asarray(self._L @ T.reshape(len(T), 16).T)

    def _turned(self, X: FloatArray) -> FloatArray:
        """Return the change (nv, 4, 4) of M1⁻¹ X M2 for a constant X in the world, given M1⁻¹ X M2."""
        return np.asarray(X @ self._hats2 - self._hats1 @ X)

    def _velocities(self) -> tuple[FloatArray, FloatArray]:
        """Return ∂V1/∂q and ∂V2/∂q."""
        return self._motion.velocity(self._one), self._motion.velocity(self._two)

    def velocity_by_q(self, V: FloatArray, turned: FloatArray) -> FloatArray:
        carries = self._motion.tree.carries
        rate = self._moved(V[self._two] - V[self._one])
        change = turned[..., self._two] * carries[:, self._two, None]
        change = change - turned[..., self._one] * carries[:, self._one, None]
        rows = self._rows(self._turned(rate) + self._moved(change))
        if self._rod:
            rows = rows + self._dots(rate[:3, 3], self._dT)
        return rows

    def jacobian_rate(self) -> FloatArray:
        tree, J_dot = self._motion.tree, self._motion.J_dot
        signs = tree.carries[:, self._two].astype(float) - tree.carries[:, self._one]
        change = self._moved(J_dot * signs[:, None]) + self._dT @ self._V2 - self._V1 @ self._dT
        rows = self._rows(change)
        if self._rod:
            rows = rows + self._dots(self._rate[:3, 3], self._dT)
        return rows

    @cached_property
    def acceleration(self) -> tuple[FloatArray, FloatArray]:
        motion, V1, V2, X = self._motion, self._V1, self._V2, self._rate
        G = self._moved(motion.A[self._two] - motion.A[self._one]) - V1 @ X + X @ V2
        V1_q, V2_q = self._velocities()
        (A1_q, A1_v), (A2_q, A2_v) = motion.acceleration(self._one), motion.acceleration(self._two)
        X_q = self._moved(V2_q - V1_q)
        by_q = self._turned(G) + self._moved(A2_q - A1_q) - V1 @ X_q + X_q @ V2
        by_q += X @ hat(V2_q @ self._Ad2.T) - hat(V1_q @ self._Ad1.T) @ X
        by_v = self._moved(A2_v - A1_v) - V1 @ self._dT + self._dT @ V2 + self._turned(X)
        rows_q, rows_v = self._rows(by_q), self._rows(by_v)
        if self._rod:
            rate_q = X_q + self._turned(X)
            rows_q = rows_q + self._dots(G[:3, 3], self._dT) + 2.0 * self._dots(X[:3, 3], rate_q)
            rows_v = rows_v + 2.0 * self._dots(X[:3, 3], self._dT)
        return rows_q, rows_v

    def force_by_q(self, lambda_: FloatArray) -> FloatArray:
        weights = (self._L.T @ lambda_).reshape(4, 4)
        turned = weights @ np.swapaxes(self._hats2, 1, 2) - np.swapaxes(self._hats1, 1, 2) @ weights
        nv = len(turned)
        by_place = self._dT.reshape(nv, 16) @ turned.reshape(nv, 16).T
        F = self._moves @ weights.ravel()
        tree = self._motion.tree
        signs = tree.carries[:, self._two].astype(float) - tree.carries[:, self._one]
        total = by_place + self._motion.force_by_q(F) * signs[:, None]
        if self._rod:
            d = self._dT[:, :3, 3]
            total = total + lambda_[0] * (d @ d.T) / self._length
        return np.asarray(total)

    def _dots(self, d: FloatArray, T: FloatArray) -> FloatArray:
        """Return d·δd / length (1, nv)."""
        return np.asarray((T[:, :3, 3] @ d)[None] / self._length)
