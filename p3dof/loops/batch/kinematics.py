"""Kinematics of many configurations at once: Pinocchio sample by sample, everything after it in arrays.

Spatial vectors are in world axes at the world's origin, linear part first: (v_O, ω).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof._base.threads import Workspace
from p3dof.loops.batch.linear import apply
from p3dof.loops.rotations import cross

_LAYOUT = 12
"""Numbers in a `pin.SE3`: the rotation by columns, then the translation."""
_STEADY = ("FreeFlyer", "Planar", "Spherical", "Translation")
"""Joints of several freedoms whose axes do not turn within the joint, after `JointModel`."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Bodies and joints at N configurations.

    Parameters
    ----------
    J : (N, 6, nv) array
        Column k: the spatial velocity that a unit rate of freedom k gives the bodies behind it.
    J_dot : (N, 6, nv) array
        The time derivative of `J`; empty without velocities. Where a joint's own axes turn with it, as those
        of a universal joint, only its product with the velocity is right.
    R : (N, njoints, 3, 3) array
        Axes of the bodies, as columns, in the world; joint 0 is the world itself.
    p : (N, njoints, 3) array
        Their origins [m].
    """

    J: FloatArray
    J_dot: FloatArray
    R: FloatArray
    p: FloatArray


class Sweep(Workspace):
    """Takes Pinocchio through many configurations.

    One call of Pinocchio a sample, and its results are copied straight from the memory of `pin.Data`.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Raises
    ------
    ModelError
        If Pinocchio's arrays are not laid out as expected.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self._data = model.createData()
        self._J, self._J_dot = self._data.J.T, self._data.dJ.T
        self._placements = shared_placements(self._data)
        shapes = (model.nv, 6), (model.nv, 6), (model.njoints * _LAYOUT,)
        self._room = [np.empty((0, *shape)) for shape in shapes]
        names = [model.joints[i].shortname().removeprefix("JointModel") for i in range(1, model.njoints)]
        self._unsteady = [i for i, n in enumerate(names, 1) if model.nvs[i] > 1 and n not in _STEADY]
        self.behind = np.zeros((model.njoints, model.nv))
        """Entry (i, k): 1 if freedom k moves body i, else 0."""
        for i in range(model.njoints):
            for j in list(model.supports[i])[1:]:
                self.behind[i, model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = 1.0

    def at(self, q: FloatArray) -> Samples:
        """Return the samples at configurations q (N, nq), without `J_dot`; they hold until the next call."""
        J, _, placements = self._buffers(len(q))
        compute, model, data = pin.computeJointJacobians, self.model, self._data
        for q_i, J_i, placements_i in zip(q, J, placements, strict=True):
            compute(model, data, q_i)
            J_i[:] = self._J
            placements_i[:] = self._placements
        return self._samples(J, J[:, :0], placements)

    def moving(self, q: FloatArray, v: FloatArray) -> Samples:
        """Return the samples at configurations q (N, nq), velocities v (N, nv), until the next call."""
        J, J_dot, placements = self._buffers(len(q))
        compute, model, data = pin.computeJointJacobiansTimeVariation, self.model, self._data
        for q_i, v_i, J_i, J_dot_i, placements_i in zip(q, v, J, J_dot, placements, strict=True):
            compute(model, data, q_i, v_i)
            J_i[:] = self._J
            J_dot_i[:] = self._J_dot
            for i in self._unsteady:
                self._turn_axes(i, v_i, J_dot_i)
            placements_i[:] = self._placements
        return self._samples(J, J_dot, placements)

    def _turn_axes(self, joint: int, v: FloatArray, J_dot: FloatArray) -> None:
        """Add to J_dot (nv, 6) what Pinocchio leaves out of it: that a joint's own axes turn, Ṡ v."""
        freedoms = slice(self.model.idx_vs[joint], self.model.idx_vs[joint] + self.model.nvs[joint])
        rate, square = v[freedoms], v[freedoms] @ v[freedoms]
        if square > 0:
            bias = self._data.oMi[joint].act(self._data.joints[joint].c).vector
            J_dot[freedoms] += np.outer(rate / square, bias)

    def twists(self, J: FloatArray, v: FloatArray, joints: Sequence[int] | slice = slice(None)) -> FloatArray:
        """Return Σ J_k v_k over the freedoms behind some joints' bodies.

        Parameters
        ----------
        J : (N, 6, nv) array
            `Samples.J`, or `Samples.J_dot`.
        v : (N, nv) array
            Velocity, or acceleration.
        joints : sequence of int or slice
            The joints; all by default.

        Returns
        -------
        (N, joints, 6) array
        """
        rates = np.swapaxes(J * v[:, None, :], -1, -2)
        return np.asarray(np.matmul(self.behind[joints], rates))

    def _buffers(self, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return room for samples; fresh memory at every call would cost as much as the kinematics."""
        if len(self._room[0]) < count:
            shapes = (self.model.nv, 6), (self.model.nv, 6), (self.model.njoints * _LAYOUT,)
            self._room = [np.empty((count, *shape)) for shape in shapes]
        J, J_dot, placements = (array[:count] for array in self._room)
        return J, J_dot, placements

    def _samples(self, J: FloatArray, J_dot: FloatArray, placements: FloatArray) -> Samples:
        return Samples(np.swapaxes(J, -1, -2), np.swapaxes(J_dot, -1, -2), *placed(placements))


@dataclass(frozen=True, eq=False)
class Pair:
    """Two frames whose relative motion is prescribed.

    Parameters
    ----------
    ends : tuple of (int, pin.SE3, int, pin.SE3)
        Joint and placement in its body of frame 1, then of frame 2.
    components : tuple of int
        Which of (vx, vy, vz, ωx, ωy, ωz) count: velocity of body 2 relative to body 1 in the axes of frame 1.
    at_first : bool
        Whether the velocity is that of the point at the origin of frame 1, else of frame 2.
    """

    ends: tuple[int, pin.SE3, int, pin.SE3]
    components: tuple[int, ...]
    at_first: bool


@dataclass(frozen=True, eq=False)
class Frames:
    """Both frames of k pairs at N samples: axes (N, k, 3, 3), origins (N, k, 3) and the common point."""

    R1: FloatArray
    R2: FloatArray
    p1: FloatArray
    p2: FloatArray
    point: FloatArray


class RelativeRows:
    """Relative velocities of pairs of frames, and their rates, over samples.

    Parameters
    ----------
    sweep : Sweep
        The model.
    pairs : sequence of Pair
        The pairs; their components follow each other as rows.
    """

    def __init__(self, sweep: Sweep, pairs: Sequence[Pair]) -> None:
        self._sweep = sweep
        self._joints1 = [pair.ends[0] for pair in pairs]
        self._joints2 = [pair.ends[2] for pair in pairs]
        placements1, placements2 = [pair.ends[1] for pair in pairs], [pair.ends[3] for pair in pairs]
        self._R1, self._R2 = (_stack([M.rotation for M in Ms], (3, 3)) for Ms in (placements1, placements2))
        self._t1, self._t2 = (_stack([M.translation for M in Ms], (3,)) for Ms in (placements1, placements2))
        self._at_first = np.array([pair.at_first for pair in pairs], dtype=bool)[:, None]
        self._rows = np.array([6 * i + c for i, pair in enumerate(pairs) for c in pair.components], dtype=int)
        sign = sweep.behind[self._joints2] - sweep.behind[self._joints1]
        self._sign = sign[self._rows // 6]

    def frames(self, samples: Samples) -> Frames:
        """Return both frames of every pair."""
        R1, R2 = samples.R[:, self._joints1], samples.R[:, self._joints2]
        p1 = samples.p[:, self._joints1] + apply(R1, self._t1)
        p2 = samples.p[:, self._joints2] + apply(R2, self._t2)
        point = np.where(self._at_first, p1, p2)
        return Frames(_turned(R1, self._R1), _turned(R2, self._R2), p1, p2, point)

    def jacobian(self, samples: Samples, frames: Frames, last: FloatArray | None = None) -> FloatArray:
        """Return the matrices (N, rows, nv) from v to the relative velocities.

        Parameters
        ----------
        samples : Samples
            Where.
        frames : Frames
            The frames there.
        last : (N, n, 3, 3) array, optional
            What takes the place of R1ᵀ for the angular velocities of the last n pairs.
        """
        J: FloatArray = np.matmul(self._projection(frames, last), samples.J)
        J *= self._sign
        return J

    def drift(self, samples: Samples, frames: Frames, v: FloatArray) -> FloatArray:
        """Return the relative accelerations (N, rows) at zero joint acceleration, for v (N, nv)."""
        (V1, V2), (A1, A2) = self._ends_of(samples.J, v), self._ends_of(samples.J_dot, v)
        carrying = np.where(self._at_first, V1, V2)
        point_dot = carrying[..., :3] + cross(carrying[..., 3:], frames.point)
        omega1, omega, alpha = V1[..., 3:], V2[..., 3:] - V1[..., 3:], A2[..., 3:] - A1[..., 3:]
        u = V2[..., :3] - V1[..., :3] + cross(omega, frames.point)
        linear = A2[..., :3] - A1[..., :3] + cross(alpha, frames.point)
        turning = linear + cross(omega, point_dot) - cross(omega1, u), alpha - cross(omega1, omega)
        rates = np.matmul(np.stack(turning, axis=-2), frames.R1)  # R1ᵀ x = (xᵀ R1)ᵀ
        return np.asarray(rates.reshape(len(v), 6 * len(self._joints1))[:, self._rows])

    def _ends_of(self, J: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `Sweep.twists` of the bodies of frames 1, and of frames 2."""
        both = self._sweep.twists(J, v, self._joints1 + self._joints2)
        count = len(self._joints1)
        return both[:, :count], both[:, count:]

    def _projection(self, frames: Frames, last: FloatArray | None) -> FloatArray:
        """Return the matrices (N, rows, 6) from a relative twist at the world's origin to the rows."""
        count, pairs = frames.p1.shape[:2]
        axes = np.swapaxes(frames.R1, -1, -2)
        X = np.zeros((count, pairs, 6, 6))
        X[..., :3, :3] = axes
        X[..., :3, 3:] = cross(frames.point[..., None, :], axes)  # rows a of R1ᵀ: a · (ω × c) = (c × a) · ω
        X[..., 3:, 3:] = axes
        if last is not None:
            X[:, -last.shape[1] :, 3:, 3:] = last
        return np.asarray(X.reshape(count, 6 * pairs, 6)[:, self._rows])


def _stack(arrays: Sequence[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    return np.array(arrays, dtype=np.float64).reshape(-1, *shape)


def _turned(R: FloatArray, placements: FloatArray) -> FloatArray:
    """Return R (N, k, 3, 3) times constant rotations (k, 3, 3), which are mostly none."""
    return R if (placements == np.eye(3)).all() else R @ placements


def shared_placements(data: Any) -> FloatArray:
    """Return all joint placements of a `pin.Data` as one array (njoints * 12,) in its own memory."""
    first = data.oMi[0].rotation.T  # by columns, as Pinocchio stores it
    numbers = len(data.oMi) * _LAYOUT
    parts = [(M.rotation.T, M.translation) for M in data.oMi]
    start, size = _address(first), first.itemsize
    expected = [(start + (_LAYOUT * i) * size, start + (_LAYOUT * i + 9) * size) for i in range(len(parts))]
    if first.flags.owndata or [(_address(R), _address(t)) for R, t in parts] != expected:
        raise ModelError("this version of Pinocchio stores its placements in a way that is not known here")
    return np.lib.stride_tricks.as_strided(first[0], (numbers,), (size,), writeable=False)


def placed(placements: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return axes (N, njoints, 3, 3) and origins (N, njoints, 3) of copies of shared placements."""
    each = placements.reshape(len(placements), placements.shape[1] // _LAYOUT, _LAYOUT)
    return np.swapaxes(each[..., :9].reshape(*each.shape[:2], 3, 3), -1, -2), each[..., 9:]


def _address(array: NDArray[np.float64]) -> int:
    return int(array.__array_interface__["data"][0])
