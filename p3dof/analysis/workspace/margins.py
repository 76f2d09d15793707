"""What is demanded of the poses of a workspace, and how far poses are from each demand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, batch_of, frozen_array
from p3dof._base.errors import InputError
from p3dof.analysis.workspace.closed_forms import Sizes, extents, inclination, offsets, signed_root
from p3dof.analysis.workspace.machine import Machine
from p3dof.analysis.workspace.slices import aspect_range
from p3dof.machine.parameters import LEGS, Limits

HORIZON = np.pi
"""Largest tilt that a workspace may have, to each side [rad]: beyond, the platform would turn over."""


@dataclass(frozen=True)
class WorkspaceMargins:
    """What is demanded of the poses of a workspace beside stroke and tilt; nothing by default.

    Parameters
    ----------
    serial : float
        Least S/L of every leg, from 0 to 1: S/L is the cosine of its angle from the vertical, and 0 a serial
        singularity.
    actuation : float
        Least angle from det J = 0 [rad], from 0 to π/2; see `Singularity.actuation`.
    velocity : array-like, shape (3,), optional
        Lone velocities ẏ, ż [m/s], θ̇ [rad/s] that the sliders' speed limit must allow, each by itself and
        both ways.
    acceleration : array-like, shape (3,), optional
        Lone accelerations from rest of y, z [m/s²], θ [rad/s²] that the force limit must allow with gravity,
        each by itself and both ways; ``(0, 0, 0)`` demands that the machine can be held.

    Raises
    ------
    InputError
        If a number is out of its range.
    """

    serial: float = 0.0
    actuation: float = 0.0
    velocity: tuple[float, float, float] | None = None
    acceleration: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name, end in (("serial", 1.0), ("actuation", np.pi / 2)):
            value = float(frozen_array(name, getattr(self, name), ()))
            if not 0 <= value < end:
                raise InputError(f"{name}: expected a number from 0 to {end:.6g}, got {value:g}")
            object.__setattr__(self, name, value)
        for name in ("velocity", "acceleration"):
            given = getattr(self, name)
            if given is not None:
                values = frozen_array(name, given, (3,))
                if (values < 0).any():
                    raise InputError(f"{name}: expected magnitudes, 0 or more, got {values.tolist()}")
                object.__setattr__(self, name, tuple(values.tolist()))


@dataclass(frozen=True, eq=False)
class PoseMargins:
    """How far poses are from what bounds a workspace: positive inside, negative outside.

    Parameters
    ----------
    serial : ndarray, shape (..., 3)
        S/L of A, B, C less what is demanded; of what is out of reach less than that, in numbers.
    actuation : ndarray, shape (...)
        Angle from det J = 0 less what is demanded [rad]; negative in other aspects too.
    tilt : ndarray, shape (...)
        To the nearer limit of θ [rad].
    travel : ndarray, shape (..., 3)
        Of sliders A, B, C to their nearer limit [m]; NaN out of reach.
    speed : ndarray, shape (..., 3), or None
        Speed limit less what the demanded velocities take [m/s]; None if none are demanded.
    force : ndarray, shape (..., 3), or None
        Force limit less what holding and the demanded accelerations take [N]; None if none are demanded.
    """

    serial: FloatArray
    actuation: FloatArray
    tilt: FloatArray
    travel: FloatArray
    speed: FloatArray | None = None
    force: FloatArray | None = None

    @property
    def columns(self) -> dict[str, FloatArray]:
        """Every margin by its name, such as ``"travel C"``, (...); in the order in which reasons are told."""
        found: dict[str, FloatArray] = {}
        for name in ("serial", "actuation", "tilt", "travel", "speed", "force"):
            values = getattr(self, name)
            if values is not None and values.ndim > self.tilt.ndim:
                found |= {f"{name} {leg}": values[..., k] for k, leg in enumerate(LEGS)}
            elif values is not None:
                found[name] = values
        return found

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether poses are within all that is demanded, shape (...)."""
        found: NDArray[np.bool_] = np.logical_and.reduce([v >= 0 for v in self.columns.values()])
        return found

    @property
    def reason(self) -> NDArray[np.str_]:
        """The first demand that a pose does not meet, such as ``"travel C"``; empty inside, shape (...)."""
        found = np.full(self.tilt.shape, "", dtype="<U12")
        for name, values in reversed(self.columns.items()):
            found = np.where(values >= 0, found, name)
        return np.asarray(np.where(np.isnan(self.tilt), "not finite", found))


def pose_margins(machine: Machine, limits: Limits, margins: WorkspaceMargins, pose: ArrayLike) -> PoseMargins:
    """Return how far poses are from limits and margins; `Workspace.margin` has the arguments."""
    poses = batch_of("pose", pose, 3)
    poses = np.where(np.isfinite(poses).all(axis=-1, keepdims=True), poses, np.nan)
    y, z, theta = (poses[..., k] for k in range(3))
    sizes = Sizes.of(machine.parameters.geometry)
    squares = [(sizes.L - w) * (sizes.L + w) for w in extents(sizes, y, theta)[:2]]
    wc = extents(sizes, y, theta)[2]
    squares.append((sizes.L - y) * (sizes.L + y) - wc * wc)
    drops = np.stack([signed_root(square) for square in squares], axis=-1)
    sliders = z[..., None] + np.stack(offsets(sizes, y, theta), axis=-1)
    low, high = limits.travel
    speed, force = demands(
        machine, limits, margins, np.where(drops.min(axis=-1)[..., None] > 0, poses, np.nan)
    )
    return PoseMargins(
        drops / sizes.L - margins.serial,
        _actuation(sizes, y, theta, inclination(wc, drops[..., 2])) - margins.actuation,
        np.minimum(theta - limits.tilt[0], limits.tilt[1] - theta),
        np.minimum(sliders - low, high - sliders),
        speed,
        force,
    )


def demands(
    machine: Machine, limits: Limits, margins: WorkspaceMargins, poses: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return what the demanded velocities and accelerations leave of the limits of speed and force.

    Parameters
    ----------
    machine : Machine
        The machine.
    limits : Limits
        Of its actuators.
    margins : WorkspaceMargins
        The demands.
    poses : ndarray, shape (..., 3)
        The poses.

    Returns
    -------
    speed, force : ndarray, shape (..., 3), or None
        [m/s, N]; None where nothing is demanded, NaN out of reach and where the machine is singular.
    """
    if margins.velocity is None and margins.acceleration is None:
        return None, None
    J = machine.jacobian(poses, on_invalid="nan", method="compiled")
    speed = force = None
    if margins.velocity is not None:
        speed = limits.speed - (np.abs(J) * margins.velocity).max(axis=-1)
    if margins.acceleration is not None:
        still = np.zeros(3)
        held = machine.forces(poses, still, still, on_invalid="nan", method="compiled")
        lone = [
            machine.forces(poses, still, still + row, on_invalid="nan", method="compiled") - held
            for row in np.diag(margins.acceleration)
        ]
        force = limits.force - np.abs(held) - np.abs(lone).max(axis=0)
    return speed, force


def _actuation(sizes: Sizes, y: FloatArray, theta: FloatArray, beta: FloatArray) -> FloatArray:
    """Return the angle from det J = 0, less than zero beyond it whatever lies there."""
    angle = np.pi / 2 - np.abs(theta + beta)
    lower, upper = (end.reshape(y.shape) for end in aspect_range(sizes, y.ravel()))
    beyond = np.minimum(theta - lower, upper - theta)  # NaN where no θ is in reach
    return np.where((beyond < 0) & (angle > 0), beyond, angle)
