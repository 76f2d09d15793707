"""Targets of many samples: placements of a frame, or values of the actuated joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError
from p3dof.loops.batch.kinematics import Frames, Pair
from p3dof.loops.batch.linear import IndexArray
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.rotations import rotation_vector, turned_rates
from p3dof.loops.targets import FrameTarget


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

    def error_at(self, frames: Frames, which: IndexArray, pair: int) -> tuple[FloatArray, FloatArray]:
        """Return the errors (n, size), and the matrices (n, 1, 3, 3) from ω to the rate of the rotation's.

        Parameters
        ----------
        frames : Frames
            Where all frames are.
        which : (n,) array of int
            Which samples.
        pair : int
            Which of the frames is meant.
        """
        error = np.zeros((len(which), 6))
        error[:, :3] = frames.p2[:, pair] - self._targets.positions[which]
        rates: FloatArray = np.broadcast_to(np.eye(3), (len(which), 1, 3, 3))
        if self._turns:
            goal = np.swapaxes(self._targets.rotations[which], -1, -2)
            error[:, 3:] = rotation_vector(frames.R2[:, pair] @ goal)
            rates = turned_rates(error[:, 3:])[:, None]
        return error[:, self._mask], rates

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


class CombinedGoals:
    """Several goals at once, the placements of frames before the values of joints.

    Parameters
    ----------
    frames : sequence of FrameGoals
        Those of frames.
    joints : JointGoals
        Those of joints; it may be of none.
    """

    def __init__(self, frames: Sequence[FrameGoals], joints: JointGoals) -> None:
        self._frames, self._joints = frames, joints
        self.pairs = [pair for part in frames for pair in part.pairs]
        self.size = sum(part.size for part in frames) + joints.size
        self.rows = joints.rows

    def error(self, q: FloatArray, frames: Frames, which: IndexArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the errors (n, size), and the matrices from ω to the rates of the rotations' errors."""
        found = [part.error_at(frames, which, i - len(self._frames)) for i, part in enumerate(self._frames)]
        errors = [error for error, _ in found]
        last = np.concatenate([rates for _, rates in found], axis=1) if found else None
        return np.concatenate([*errors, self._joints.error(q, frames, which)[0]], axis=1), last

    def coordinates(self, which: IndexArray) -> FloatArray:
        """Return all coordinates of some samples."""
        parts = [part.coordinates(which) for part in self._frames]
        return np.concatenate([*parts, self._joints.coordinates(which)], axis=1)


@dataclass(frozen=True, eq=False)
class Targets:
    """What many samples are driven to, checked against a model: frames first, then joints.

    Parameters
    ----------
    frames : tuple of FrameTargets
        Placements of frames.
    joints : tuple of int
        Ids of joints.
    values : (N, n) array
        Values of these joints [m or rad]; an angle for a continuous joint.
    order : (size,) array of int
        Of which prescribed value, as they were given, each component is.
    """

    frames: tuple[FrameTargets, ...]
    joints: tuple[int, ...]
    values: FloatArray
    order: IndexArray

    def __len__(self) -> int:
        return len(self.values)

    def goals(self, kinematics: LoopKinematics) -> CombinedGoals:
        """Return the same, bound to a model."""
        frames = [FrameGoals(kinematics, target) for target in self.frames]
        return CombinedGoals(frames, JointGoals(kinematics, self.joints, self.values))

    def of_sample(self, i: int, model: pin.Model) -> list[FrameTarget | dict[str, float]]:
        """Return the targets of one sample, as `LoopModel.complete` takes them."""
        names = [str(model.names[joint]) for joint in self.joints]
        values = dict(zip(names, self.values[i].tolist(), strict=True))
        return [*(target[i] for target in self.frames), *([values] if values else [])]

    def given(self, components: FloatArray) -> FloatArray:
        """Return arrays (..., size) of components in the order in which these were given."""
        if np.array_equal(self.order, np.arange(len(self.order))):
            return components
        found = np.empty_like(components)
        found[..., self.order] = components
        return found
