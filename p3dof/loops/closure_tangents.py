"""How velocities and accelerations at closed loops change with configuration and velocity; exact.

Where the loops are closed, and along motions that keep them so, every kind of closure is the same as a
function that is linear in the entries of T = M1⁻¹ M2, the placement of frame 2 in the axes of frame 1:
positions and, as the rotations that are prescribed are none, entries of the rotation matrix. A rod is
(d·d - length²) / (2 length). The rates follow from Ṁ = [V] M, where [V] is the 4 x 4 matrix of a spatial
velocity in the world:

    Ṫ = M1⁻¹ [V2 - V1] M2,
    T̈ = M1⁻¹ ([A2 - A1] - [V1] [V2 - V1] + [V2 - V1] [V2]) M2.        (1)

Derivatives of the bodies' V and A are those of `p3dof.loops.tree_tangents`. Those of accelerations are
exact for velocities that keep the loops closed. A gap leaves an error of its own size.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.coordinates import single_joint
from p3dof.loops.sidecar import Coupling
from p3dof.loops.tree_tangents import TreeMotion, hat


class CouplingTangents:
    """Derivatives of q_joint = p(q_on) + Σ f q_other: only p is curved, all in the column of `on`."""

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling], q: FloatArray) -> None:
        self._nv, self._size = int(model.nv), len(couplings)
        curved = [(row, c, c.on) for row, c in enumerate(couplings) if c.on and any(c.coefficients[2:])]
        self._rows = np.array([row for row, _, _ in curved], dtype=int)
        joints = [single_joint(model, on, f"coupling {c.title}") for _, c, on in curved]
        self._on = np.array([model.idx_vs[joint] for joint in joints], dtype=int)
        bends = []
        for (_, coupling, _), joint in zip(curved, joints, strict=True):
            p, value = np.polynomial.Polynomial(coupling.coefficients), q[model.idx_qs[joint]]
            bends.append((p.deriv(2)(value), p.deriv(3)(value)))  # no continuous joint enters in a power
        self._second, self._third = np.array(bends, dtype=float).reshape(-1, 2).T

    def velocity_by_q(self, w: FloatArray) -> FloatArray:
        """Return the derivative by q of J w (size, nv), w (nv,) being constant."""
        return self._placed(-self._second * w[self._on])

    def jacobian_rate(self, v: FloatArray) -> FloatArray:
        """Return J̇ (size, nv) at a velocity (nv,)."""
        return self._placed(-self._second * v[self._on])

    def acceleration(self, v: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (size, nv) by q and by v of the accelerations J a + J̇ v."""
        v, a = v[self._on], a[self._on]
        return self._placed(-self._second * a - self._third * v**2), self._placed(-2.0 * self._second * v)

    def force_by_q(self, lambda_: FloatArray) -> FloatArray:
        """Return the derivative by q of Jᵀ λ (nv, nv), λ (size,) being constant."""
        total = np.zeros((self._nv, self._nv))
        np.add.at(total, (self._on, self._on), -self._second * lambda_[self._rows])
        return total

    def _placed(self, values: FloatArray) -> FloatArray:
        result = np.zeros((self._size, self._nv))
        result[self._rows, self._on] = values
        return result


_X, _Y, _Z = _POSITION = 3, 7, 11  # where the position is among the twelve entries of T, three rows of four
_TILT = ({6: -1.0}, {2: 1.0})  # x and y of z1 × z2: -E_yz, E_xz
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
    """Derivatives of J v and d(J v)/dt in one motion; (c, nv, ...): a row a closure and an entry of v."""

    def __init__(
        self,
        kinematics: LoopKinematics,
        couplings: Sequence[Coupling],
        motion: TreeMotion,
        q: FloatArray,
        v: FloatArray,
        a: FloatArray,
    ) -> None:
        self._motion, self._v, self._a, tree = motion, v, a, motion.tree
        self._couplings = CouplingTangents(kinematics.model, couplings, q)
        self._coupled = kinematics.coupled
        ends = kinematics.ends
        self._one = tree.bodies[np.array([one for one, _, _, _ in ends], dtype=int)]
        self._two = tree.bodies[np.array([two for _, _, two, _ in ends], dtype=int)]
        places1 = [motion.M[i] * end[1] for i, end in zip(self._one, ends, strict=True)]
        places2 = [motion.M[i] * end[3] for i, end in zip(self._two, ends, strict=True)]
        into1, into2 = [place.inverse() for place in places1], [place.inverse() for place in places2]
        into, M2 = _matrices(into1), _matrices(places2)
        self._Ad1, self._Ad2 = _actions(into1), _actions(into2)
        moved1, moved2 = (tree.carries[:, at].T.astype(float) for at in (self._one, self._two))
        self._signs = moved2 - moved1
        self._hats1 = hat((motion.J @ np.swapaxes(self._Ad1, 1, 2)) * moved1[..., None])
        self._hats2 = hat((motion.J @ np.swapaxes(self._Ad2, 1, 2)) * moved2[..., None])
        self._moves = (into[:, None] @ hat(np.eye(6)) @ M2[:, None]).reshape(len(ends), 6, 16)
        self._dT = self._moved(motion.J * self._signs[..., None])
        self._V1 = hat(_applied(self._Ad1, motion.V[self._one]))[:, None]
        self._V2 = hat(_applied(self._Ad2, motion.V[self._two]))[:, None]
        self._rate = self._moved((motion.V[self._two] - motion.V[self._one])[:, None])
        self._rods = np.array([k for k, c in enumerate(kinematics.closures) if c.length is not None], int)
        lengths = [c.length for c in kinematics.closures if c.length is not None]
        self._lengths = np.array(lengths, dtype=float)
        self._L, self._used = _entries([c.kind for c in kinematics.closures])
        self._L[self._rods[:, None], 0, _POSITION] = (into @ M2)[self._rods, :3, 3] / self._lengths[:, None]

    def velocity_by_q(self, w: FloatArray) -> FloatArray:
        """Return the derivative by q of J w (rows, nv), w (nv,) being constant."""
        motion, tree = self._motion, self._motion.tree
        V: FloatArray = tree.carries.T.astype(float) @ (motion.J * w[:, None])
        turned = motion.turned(V)
        rate = self._moved((V[self._two] - V[self._one])[:, None])
        change = motion.of(turned, self._two) - motion.of(turned, self._one)
        found = self._changes(self._turned(rate) + self._moved(change))
        self._add_dots(found, rate, self._dT)
        return self._with(found, self._couplings.velocity_by_q(w))

    def jacobian_rate(self) -> FloatArray:
        """Return J̇ (rows, nv) at the velocity."""
        J_dot = self._motion.J_dot * self._signs[..., None]
        found = self._changes(self._moved(J_dot) + self._dT @ self._V2 - self._V1 @ self._dT)
        self._add_dots(found, self._rate, self._dT)
        return self._with(found, self._couplings.jacobian_rate(self._v))

    @cached_property
    def acceleration(self) -> tuple[FloatArray, FloatArray]:
        """The derivatives (rows, nv) by q and by v of the accelerations J a + J̇ v."""
        motion, V1, V2, X = self._motion, self._V1, self._V2, self._rate
        G = self._moved((motion.A[self._two] - motion.A[self._one])[:, None]) - V1 @ X + X @ V2
        V1_q, V2_q = motion.velocities(self._one), motion.velocities(self._two)
        (A1_q, A1_v), (A2_q, A2_v) = motion.accelerations(self._one), motion.accelerations(self._two)
        X_q = self._moved(V2_q - V1_q)
        by_q = self._turned(G) + self._moved(A2_q - A1_q) - V1 @ X_q + X_q @ V2
        by_q += X @ hat(V2_q @ np.swapaxes(self._Ad2, 1, 2)) - hat(V1_q @ np.swapaxes(self._Ad1, 1, 2)) @ X
        by_v = self._moved(A2_v - A1_v) - V1 @ self._dT + self._dT @ V2 + self._turned(X)
        found_q, found_v = self._changes(by_q), self._changes(by_v)
        self._add_dots(found_q, G, self._dT)
        self._add_dots(found_q, 2.0 * X, X_q + self._turned(X))
        self._add_dots(found_v, 2.0 * X, self._dT)
        coupled_q, coupled_v = self._couplings.acceleration(self._v, self._a)
        return self._with(found_q, coupled_q), self._with(found_v, coupled_v)

    def force_by_q(self, lambda_: FloatArray) -> FloatArray:
        """Return the derivative by q of Jᵀ λ (nv, nv), λ (rows,) being constant."""
        each = np.zeros(self._used.shape)
        each[self._used] = lambda_[: self._coupled.start]
        weights = (each[:, None] @ self._L).reshape(-1, 1, 4, 4)
        turned = weights @ np.swapaxes(self._hats2, 2, 3) - np.swapaxes(self._hats1, 2, 3) @ weights
        c, nv = self._dT.shape[:2]
        moves, turns = (
            x.reshape(c, nv, 16).transpose(1, 0, 2).reshape(nv, c * 16) for x in (self._dT, turned)
        )
        F = _applied(self._moves, weights.reshape(-1, 16))
        total = moves @ turns.T + self._motion.forces_by_q(F, self._signs)
        for rod, length in zip(self._rods, self._lengths, strict=True):
            d = self._dT[rod, :, :3, 3]
            total = total + each[rod, 0] * (d @ d.T) / length
        return np.asarray(total + self._couplings.force_by_q(lambda_[self._coupled]))

    def _moved(self, V: FloatArray) -> FloatArray:
        """Return M1⁻¹ [V] M2 (c, n, 4, 4) of motions (c, n, 6)."""
        return np.asarray(V @ self._moves).reshape(*V.shape[:2], 4, 4)

    def _turned(self, X: FloatArray) -> FloatArray:
        """Return the change (c, nv, 4, 4) of M1⁻¹ X M2 for a constant X in the world, given M1⁻¹ X M2."""
        return np.asarray(X @ self._hats2 - self._hats1 @ X)

    def _changes(self, T: FloatArray) -> FloatArray:
        """Return the rows (c, 6, nv) of changes (c, nv, 4, 4) of T or its rates; unused ones are zero."""
        c, nv = T.shape[:2]
        return np.asarray(self._L @ np.swapaxes(T.reshape(c, nv, 16), 1, 2))

    def _add_dots(self, found: FloatArray, X: FloatArray, T: FloatArray) -> None:
        """Add d·δd / length to the rows of rods, for rates X (c, 1, 4, 4) and changes T (c, nv, 4, 4)."""
        if len(self._rods):
            dots = (T[self._rods, :, :3, 3] @ X[self._rods, 0, :3, 3, None])[..., 0]
            found[self._rods, 0] += dots / self._lengths[:, None]

    def _with(self, found: FloatArray, coupled: FloatArray) -> FloatArray:
        """Return rows (c, 6, nv) one after the other, then those of couplings."""
        return np.concatenate((found[self._used], coupled))


def _matrices(places: Sequence[pin.SE3]) -> FloatArray:
    """Return the matrices (c, 4, 4) of placements."""
    return np.array([place.homogeneous for place in places]).reshape(-1, 4, 4)


def _actions(places: Sequence[pin.SE3]) -> FloatArray:
    """Return the matrices (c, 6, 6) by which placements act on motions."""
    return np.array([place.action for place in places]).reshape(-1, 6, 6)


def _applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return matrices (c, m, n) times vectors (c, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _entries(kinds: Sequence[str]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the rows (c, 6, 16) of closures as combinations of entries of T, and which are used (c, 6)."""
    L, used = np.zeros((len(kinds), 6, 16)), np.zeros((len(kinds), 6), dtype=bool)
    for k, kind in enumerate(kinds):
        rows = _ENTRIES.get(kind, ({},))
        used[k, : len(rows)] = True
        for row, values in enumerate(rows):
            for at, value in values.items():
                L[k, row, at] = value
    return L, used
