"""What the actuated joints of any robot should do over time: from a file, an array, or standing still."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError, MotionError
from p3dof._base.files import Source, called, read_text
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import is_slide
from p3dof.machine.motion.joint_files import JointCurve, read_joints
from p3dof.machine.motion.smoothing import Smooth
from p3dof.machine.motion.times import require_rising, rounding_told


class JointReference:
    """Values, velocities and accelerations of the actuated joints at any time.

    Between its samples it is a spline of degree 7, whose velocities need not be zero at its ends; before the
    first sample and after the last one the joints rest there.

    Parameters
    ----------
    time : array-like, shape (N,)
        Rising times [s]; they count from the first one.
    values : array-like, shape (N, n_actuated)
        Of the joints [m or rad].
    smooth : float or "auto", optional
        For measured or rounded values, which the reference need not pass then, as of
        `p3dof.machine.motion.Motion.from_poses`; `curve.remarks` state what it does.

    Raises
    ------
    MotionError
        If shapes do not fit, a number is not finite, or times do not rise or are too coarse, as those of a
        clock that were rounded before the first one was subtracted.
    """

    def __init__(self, time: ArrayLike, values: ArrayLike, smooth: Smooth = None) -> None:
        times = frozen_array("time", time, ("N",), MotionError)
        if not len(times):
            raise MotionError("time: expected at least one sample, got none")
        require_rising("time", times)
        times, first = times - times[0], float(times[0])
        rounded = rounding_told(times, first)
        if rounded and smooth is None:
            raise MotionError(f"time: {rounded}")
        rows = frozen_array("values", values, (len(times), "n"), MotionError)
        self.curve = JointCurve(times, rows, smooth=smooth)
        with np.errstate(all="ignore"):
            found = self.curve.at(times)
        if not all(np.isfinite(array).all() for array in found):
            raise MotionError("values: too large or too near in time for finite velocities and accelerations")

    @classmethod
    def from_csv(cls, loop: ClosedLoopModel, path: Source, smooth: Smooth = None) -> JointReference:
        """Read a motion of the actuated joints: CSV with ``t`` and their names, see the file formats.

        Parameters
        ----------
        loop : ClosedLoopModel
            The robot.
        path : path-like or stream
            The file.
        smooth : float or "auto", optional
            As of the class.

        Returns
        -------
        JointReference

        Raises
        ------
        MotionError, FileError
            If the file cannot be read or does not fit the robot.
        """
        sliding = [is_slide(loop, loop.model.getJointId(name)) for name in loop.actuated]
        curve = read_joints(read_text(path), called(path), loop.actuated, sliding)
        return cls(curve.time, curve.values, smooth)

    @classmethod
    def standing(cls, values: ArrayLike) -> JointReference:
        """Return a reference that stays at values (n_actuated,) of the joints [m or rad]."""
        return cls([0.0], frozen_array("values", values, ("n",))[None])

    @property
    def duration(self) -> float:
        """How long it moves [s]."""
        return float(self.curve.time[-1])

    @property
    def step(self) -> float:
        """The mean step between its samples [s]; infinite if there is one only."""
        return self.duration / (len(self.curve.time) - 1) if len(self.curve.time) > 1 else np.inf

    @property
    def size(self) -> int:
        """Of how many joints it is."""
        return int(self.curve.values.shape[1])

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return values, velocities and accelerations (n_actuated,) at a time since its beginning [s]."""
        values, velocities, accelerations = self.over(np.array([time]))
        return values[0], velocities[0], accelerations[0]

    def over(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return values, velocities and accelerations (N, n_actuated) at times (N,) since its beginning."""
        inside = np.clip(times, 0.0, self.duration)
        found = self.curve.at(inside)
        slack = 1e-12 * max(1.0, self.duration)
        moving = ((times >= -slack) & (times <= self.duration + slack))[:, None]
        values, velocities, accelerations = found
        return values, np.where(moving, velocities, 0.0), np.where(moving, accelerations, 0.0)


def reference_of(loop: ClosedLoopModel, given: JointReference | ArrayLike) -> JointReference:
    """Return a reference of a robot's actuated joints: one that is given, or values (n,) that stay.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    given : JointReference or (n_actuated,) array
        The reference.

    Returns
    -------
    JointReference

    Raises
    ------
    InputError
        If it is of another number of joints.
    """
    if not isinstance(loop, ClosedLoopModel):
        raise InputError(f"loop: expected a ClosedLoopModel, got {shown(loop)}")
    reference = given if isinstance(given, JointReference) else JointReference.standing(given)
    if reference.size != len(loop.actuated):
        raise InputError(
            f"reference: expected values of the {len(loop.actuated)} actuated joints, got {reference.size}"
        )
    return reference
