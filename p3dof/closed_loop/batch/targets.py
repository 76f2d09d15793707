"""Targets of many samples: placements of a frame, or values of the actuated joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof.checks import FloatArray, frozen_array
from p3dof.closed_loop.batch.kinematics import Frames, Pair
from p3dof.closed_loop.batch.linear import IndexArray
from p3dof.closed_loop.closures import LoopKinematics
from p3dof.closed_loop.rotations import rotation_vector, turned_rates
from p3dof.closed_loop.targets import FrameTarget
from p3dof.errors import InputError


@dataclass(frozen=True, eq=False)
class FrameTargets:
    """Chosen components of the placement of a frame, at N samples; see `FrameTarget`.

    Parameters
    ----------
    frame : str
        Name of the frame.
    positions : (N, 3) array
        Where its origin shall be, in the world [m].
    rotations : (N, 3, 3) array
        Its axes, as columns.
    mask : (6,) array of bool
        Which of x, y, z, rx, ry, rz are prescribed, the same at all samples.

    Raises
    ------
    InputError
        If the arrays do not fit, hold something that is not finite or no rotation, or the mask is not six
        bools with at least one true.
    """

    frame: str
    positions: FloatArray
    rotations: FloatArray
    mask: Sequence[bool] | NDArray[np.bool_] = (True,) * 6

    def __post_init__(self) -> None:
        positions = frozen_array("positions", self.positions, ("N", 3))
        rotations = frozen_array("rotations", self.rotations, (len(positions), 3, 3))
        wrong = np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max(axis=(1, 2)) > 1e-9
        wrong |= np.linalg.det(rotations) < 0
        if wrong.any():
            raise InputError(f"rotations: number {int(np.argmax(wrong))} is not a rotation matrix")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "rotations", rotations)
        object.__setattr__(self, "mask", FrameTarget(self.frame, pin.SE3.Identity(), self.mask).mask)

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, i: int) -> FrameTarget:
        """Return the target of one sample."""
        return FrameTarget(self.frame, pin.SE3(self.rotations[i], self.positions[i]), self.mask)


class FrameGoals:
    """`FrameTargets` in a model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    targets : FrameTargets
        The targets.

    Raises
    ------
    InputError
        If the frame does not exist.
    """

    def __init__(self, kinematics: LoopKinematics, targets: FrameTargets) -> None:
        frame = kinematics.frame(targets.frame, "target", InputError)
        self._targets = targets
        self._mask = np.asarray(targets.mask)
        self._turns = bool(self._mask[3:].any())
        components = tuple(int(i) for i in np.flatnonzero(self._mask))
        ends = (0, pin.SE3.Identity(), frame.parentJoint, frame.placement.copy())
        self.pairs = [Pair(ends, components, at_first=False)]
        self.size = len(components)
        self.rows = np.zeros((0, kinematics.model.nv))

    def error(
        self, _q: FloatArray, frames: Frames, which: IndexArray
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the errors (n, size), and the matrices from ω to the rate of the rotation's error."""
        error = np.zeros((len(which), 6))
        error[:, :3] = frames.p2[:, -1] - self._targets.positions[which]
        last = None
        if self._turns:
            goal = np.swapaxes(self._targets.rotations[which], -1, -2)
            error[:, 3:] = rotation_vector(frames.R2[:, -1] @ goal)
            last = turned_rates(error[:, 3:])
        return error[:, self._mask], last

    def coordinates(self, which: IndexArray) -> FloatArray:
        """Return the prescribed positions, and the axes if a rotation is prescribed, of some samples."""
        positions = self._targets.positions[which][:, self._mask[:3]]
        if not self._turns:
            return positions
        return np.concatenate((positions, self._targets.rotations[which].reshape(-1, 9)), axis=1)


class JointGoals:
    """Values of the actuated joints at N samples [m or rad]; a continuous joint is given an angle.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    joints : sequence of int
        Ids of the actuated joints.
    values : (N, n_actuated) array
        Their values.
    """

    def __init__(self, kinematics: LoopKinematics, joints: Sequence[int], values: FloatArray) -> None:
        model = kinematics.model
        self._values = values
        self._q = np.array([model.idx_qs[j] for j in joints], dtype=int)
        self._circles = np.array([model.nqs[j] == 2 for j in joints], dtype=bool)
        self.pairs: list[Pair] = []
        self.size = len(joints)
        self.rows = np.eye(model.nv)[[model.idx_vs[j] for j in joints]]

    def error(self, q: FloatArray, _frames: Frames, which: IndexArray) -> tuple[FloatArray, None]:
        """Return the errors (n, size), for a continuous joint the shorter way round."""
        error = q[:, self._q] - self._values[which]
        cosine, sine = self._q[self._circles], self._q[self._circles] + 1
        goal = self._values[which][:, self._circles]
        c, s = np.cos(goal), np.sin(goal)
        error[:, self._circles] = np.arctan2(
            q[:, sine] * c - q[:, cosine] * s, q[:, cosine] * c + q[:, sine] * s
        )
        return error, None

    def coordinates(self, which: IndexArray) -> FloatArray:
        """Return the values of some samples."""
        return self._values[which]
