"""What the live page shows of a machine at a time of its motion, or at a pose of the platform at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from p3dof import kinematics
from p3dof.checks import FloatArray
from p3dof.errors import SingularityError
from p3dof.methods import InverseDynamics
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.motion import Motion, states_of
from p3dof.page.machine import Machine
from p3dof.page.poses import joints_of
from p3dof.parameters import LEGS, SLIDES
from p3dof.samples import OnInvalid

CASES = ("total", "static", "dynamic")
"""Which forces: all that the motion takes, those that hold the pose at rest, or their difference."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A machine as it is shown.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        y [m], z [m], θ [rad].
    q : ndarray, shape (10,)
        Joints in Pinocchio's order.
    sliders : ndarray, shape (3,)
        Positions of the sliders A, B, C [m].
    forces : ndarray, shape (3,)
        Forces of the actuators A, B, C in the load case that was asked for; NaN where there are none [N].
    limits : tuple of str
        The limits that are exceeded, in words.
    """

    pose: FloatArray
    q: FloatArray
    sliders: FloatArray
    forces: FloatArray
    limits: tuple[str, ...]


class States:
    """The states of one machine.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : InverseDynamics, optional
        The motion that can be played.
    """

    def __init__(self, robot: Machine, result: InverseDynamics | None) -> None:
        self._robot = robot
        self._result = result
        self._slides = [list(robot.model.names[1:]).index(name) for name in SLIDES]
        self._pose_at = _curve(result.motion) if result is not None and len(result.time) > 1 else None
        self._speeds = np.zeros((1, 3)) if result is None else result.slider_velocities

    def of_time(self, time: float, case: str) -> Shown:
        """Return the state at a time of the motion: pose by its spline, forces linear between samples.

        Parameters
        ----------
        time : float
            Of the motion [s].
        case : str
            One of `CASES`.

        Returns
        -------
        Shown

        Raises
        ------
        ReachError
            If the pose then is out of reach.
        """
        result = self._result
        assert result is not None  # noqa: S101 - only a motion has times
        pose = result.motion.pose[0] if self._pose_at is None else self._pose_at(time)
        q = joints_of(self._robot, pose)
        total = forces = self._at(time, result.forces)
        if case != "total":
            static = self._static(pose, time)
            forces = static if case == "static" else total - static
        return self._shown(pose, q, forces, total, self._at(time, self._speeds))

    def of_pose(self, pose: FloatArray, time: float, before: FloatArray, case: str) -> Shown:
        """Return the state at rest in a pose, under the external load at a time of the motion.

        Parameters
        ----------
        pose : ndarray, shape (3,)
            y [m], z [m], θ [rad].
        time : float
            Of the motion, for its external load [s].
        before : ndarray, shape (3,)
            The pose that the platform comes from.
        case : str
            One of `CASES`; at rest all forces are static.

        Returns
        -------
        Shown

        Raises
        ------
        ReachError
            If the pose is out of reach.
        SingularityError
            If the pose is singular, or on the other side of the singularity than `before`.
        """
        q = joints_of(self._robot, pose)
        self._require_same_side(pose, before)
        static = self._static(pose, time, "raise")
        forces = np.zeros(3) if case == "dynamic" else static
        return self._shown(pose, q, forces, static, np.zeros(3))

    def curves(self, most: int = 241) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return times (N,) and the forces (N, 3) by load case, for a chart.

        Parameters
        ----------
        most : int
            Most samples; of a longer motion they are spread evenly.

        Returns
        -------
        time : ndarray, shape (N,)
            [s]
        forces : dict of str to ndarray, shape (N, 3)
            [N]
        """
        if self._result is None:
            return np.zeros(0), {case: np.zeros((0, 3)) for case in CASES}
        count = len(self._result.time)
        some = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
        poses, wrench = self._result.motion.pose[some], self._result.wrench[some]
        total = self._result.forces[some]
        static = self._static_forces(poses, wrench, "nan")
        static[~np.isfinite(total)] = np.nan  # near a singularity that is crossed these are of no use either
        return self._result.time[some], {"total": total, "static": static, "dynamic": total - static}

    def _static(self, pose: FloatArray, time: float, on_invalid: OnInvalid = "nan") -> FloatArray:
        wrench = None if self._result is None else self._at(time, self._result.wrench)
        return self._static_forces(pose, wrench, on_invalid)

    def _static_forces(
        self, pose: FloatArray, wrench: FloatArray | None, on_invalid: OnInvalid
    ) -> FloatArray:
        """Return the forces (..., 3) that hold the machine at rest [N]."""
        states = states_of(pose, wrench=wrench, on_invalid=on_invalid)
        return VirtualPowerMethod(self._robot.parameters).forces(states)

    def _require_same_side(self, pose: FloatArray, before: FloatArray) -> None:
        """Refuse to drag the platform through the singularity, where the sliders lose hold of it."""
        both = kinematics.singularity(self._robot.parameters.geometry, np.stack([pose, before]))
        here, there = (float(angle) for angle in both.actuation)
        if here * there < 0:
            y, z, theta = pose
            raise SingularityError(
                f"pose (y = {y:g} m, z = {z:g} m, theta = {theta:g} rad) lies beyond the actuation "
                f"singularity: the platform's arm has passed the plane of leg C's rods by {abs(here):.3g} rad"
            )

    def _at(self, time: float, values: FloatArray) -> FloatArray:
        """Return columns (N, K) at a time, linearly between samples."""
        assert self._result is not None  # noqa: S101 - likewise
        times = self._result.time
        after = int(np.clip(np.searchsorted(times, time), 1, max(len(times) - 1, 1)))
        if len(times) == 1 or time <= times[after - 1]:
            return np.asarray(values[after - 1])
        if time >= times[after]:
            return np.asarray(values[after])
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return np.asarray(values[after - 1] + share * (values[after] - values[after - 1]))

    def _shown(
        self, pose: FloatArray, q: FloatArray, forces: FloatArray, total: FloatArray, speeds: FloatArray
    ) -> Shown:
        sliders = q[self._slides]
        return Shown(pose, q, sliders, forces, tuple(self._exceeded(pose, sliders, total, speeds)))

    def _exceeded(
        self, pose: FloatArray, sliders: FloatArray, forces: FloatArray, speeds: FloatArray
    ) -> list[str]:
        limits = self._robot.parameters.limits
        checks = [("travel", "m", sliders, *limits.travel)]
        checks += [("speed", "m/s", speeds, -limits.speed, limits.speed)]
        checks += [("force", "N", forces, -limits.force, limits.force)]
        found = []
        for quantity, unit, values, low, high in checks:
            for leg, value in zip(LEGS, values, strict=True):
                if not low <= value <= high and np.isfinite(value):
                    limit = high if value > high else low
                    found.append(f"{quantity} of slider {leg}: {value:.3f} {unit}, limit {limit:g} {unit}")
        low, high = limits.tilt
        if not low <= pose[2] <= high:
            limit = high if pose[2] > high else low
            found.append(f"tilt of the platform: {pose[2]:.3f} rad, limit {limit:.3f} rad")
        return found


def _curve(motion: Motion) -> Callable[[float], FloatArray]:
    """Return the poses as a function of time: the quintic Hermite spline through the samples."""
    from p3dof.motion.splines import hermite

    curve = hermite(motion.time, motion.pose, motion.velocity, motion.acceleration)
    return lambda time: np.asarray(curve(time))
