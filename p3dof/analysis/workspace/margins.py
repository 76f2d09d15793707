"""What is demanded of the poses of a workspace, and how far poses are from each demand.

What a box of poses leaves, in closed form: nothing is sampled.

Two facts make boxes exact. ℓC grows with θ wherever det J keeps home's sign, since ∂ℓC/∂θ is the arm of
det J, and falls with |y|; ℓA and ℓB depend on y alone and have one maximum each, where their leg is vertical.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, batch_of, frozen_array
from p3dof._base.errors import InputError
from p3dof._base.samples import OnInvalid
from p3dof._base.tables import Tabular
from p3dof.analysis.workspace.closed_forms import (
    Sizes,
    aspect_range,
    extents,
    inclination,
    larger,
    offsets,
    signed_root,
    smaller,
)
from p3dof.machine.parameters import LEGS, Limits, Parameters
from p3dof.methods import Method


class WorkspaceMachine(Protocol):
    """What the workspace is asked of: `p3dof.Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """The machine."""

    def jacobian(self, pose: ArrayLike, *, on_invalid: OnInvalid = ..., method: Method = ...) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ) (..., 3, 3)."""

    def forces(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        *,
        on_invalid: OnInvalid = ...,
        method: Method = ...,
    ) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""

    def indices(self, pose: ArrayLike, length: float | None = ..., **options: Any) -> Any:
        """Return performance indices at poses: `p3dof.Indices`."""


HORIZON = np.pi  # largest tilt of a workspace, to each side [rad]: beyond, the platform would turn over


@dataclass(frozen=True)
class WorkspaceMargins(Readable):
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
class PoseMargins(Tabular):
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
        Force limit less what static load and demanded accelerations take [N]; None if none are demanded.
    """

    _row_name = "pose"

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

    def to_columns(self) -> dict[str, FloatArray]:
        """Return every margin, by name and unit; one pose a row."""
        units = {
            "serial": "1",
            "actuation": "rad",
            "tilt": "rad",
            "travel": "m",
            "speed": "m/s",
            "force": "N",
        }
        return {f"{name} [{units[name.split()[0]]}]": np.ravel(x) for name, x in self.columns.items()}

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


def pose_margins(
    machine: WorkspaceMachine, limits: Limits, margins: WorkspaceMargins, pose: ArrayLike
) -> PoseMargins:
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
    machine: WorkspaceMachine, limits: Limits, margins: WorkspaceMargins, poses: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return what demanded rates leave of speed and force [m/s, N]; None if not demanded, NaN if singular."""
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


class BoxPieces(NamedTuple):
    """What a box of poses depends on, each of it smooth where no end of the box passes 0."""

    highest: tuple[Any, ...]
    """Largest and least S + r sinθ of legs over the box [m]: of A, B and C the largest; of A, of B and of
    C two each, of which the lesser one counts."""
    lowest: tuple[Any, ...]
    serial: tuple[Any, ...]  # S/L of the legs at the ends of the box
    actuation: tuple[Any, ...]  # angles from det J = 0 [rad]


class BoxMargins(NamedTuple):
    """What a box y0 ≤ y ≤ y1, θ0 ≤ θ ≤ θ1 leaves of stroke, and how far it stays from singularities."""

    height: Any
    """Largest height in z that the stroke leaves a box of all these y and θ [m]. It is less than the least
    H(y, θ), for which z would have to follow y and θ. Exact where `serial` and `actuation` are
    positive."""
    serial: Any  # least S/L of the three legs over the box; negative if it is out of reach
    actuation: Any  # least angle from det J = 0 over the box [rad]; negative if the box crosses it
    lowest: Any
    """Least and largest ℓ of any leg over the box [m]: z may lie between the lower end of the travel less
    `lowest` and its upper end less `highest`."""
    highest: Any


def box_margins(sizes: Sizes, y: tuple[Any, Any], theta: tuple[Any, Any], travel: Any) -> BoxMargins:
    """Return what boxes of poses leave: numbers or arrays that broadcast, complex ones too.

    Out of reach, where optimisers may come by, the numbers go on smoothly, with `serial` negative.

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y : tuple of two floats or ndarrays
        From and to [m].
    theta : tuple of two floats or ndarrays
        From and to [rad]; between -π and π, and around 0 or beside it.
    travel : float or ndarray
        Highest less lowest slider position [m].
    """
    highest, lowest, serial, actuation = box_pieces(sizes, y, theta)
    h = signed_root((sizes.L - sizes.width) * (sizes.L + sizes.width))
    top, low = reduce(larger, highest), reduce(smaller, lowest)
    return BoxMargins(
        travel - (top - low), reduce(smaller, serial), reduce(smaller, actuation), low - h, top - h
    )


def box_pieces(sizes: Sizes, y: tuple[Any, Any], theta: tuple[Any, Any]) -> BoxPieces:
    """Return what the margins of boxes are the least of; arguments as of `box_margins`."""
    r, L = sizes.r, sizes.L
    near = _within(y, 0.0)
    tops = [_drop(L, _within((sizes.width + a, sizes.width + b), 0.0)) for a, b in (y, (-y[1], -y[0]))]
    ends = [_drop(L, sizes.width + side * end) for side in (1, -1) for end in y]
    corners = [(end, turned) for end in y for turned in theta]
    low_c = [_drop_c(sizes, end, theta[0]) + r * np.sin(theta[0]) for end in y]
    return BoxPieces(
        (*tops, _drop_c(sizes, near, theta[1]) + r * np.sin(theta[1])),
        (*ends, *low_c),
        tuple(drop / L for drop in (*ends, *(_drop_c(sizes, *corner) for corner in corners))),
        (*(np.pi / 2 - _lean(sizes, *corner) for corner in corners), *_below(sizes, near, theta)),
    )


def _within(y: tuple[Any, Any], place: Any) -> Any:
    """Return the place of a range that is nearest to another."""
    return smaller(larger(place, y[0]), y[1])


def _drop(L: Any, extent: Any) -> Any:
    return signed_root((L - extent) * (L + extent))


def _drop_c(sizes: Sizes, y: Any, theta: Any) -> Any:
    wc = sizes.R - sizes.r * np.cos(theta)
    return signed_root((sizes.L - y) * (sizes.L + y) - wc * wc)


def _lean(sizes: Sizes, y: Any, theta: Any) -> Any:
    return theta + inclination(sizes.R - sizes.r * np.cos(theta), _drop_c(sizes, y, theta))


def _below(sizes: Sizes, near: Any, theta: tuple[Any, Any]) -> tuple[Any, Any, Any]:
    """Return the angles from det J = 0 on the side of negative θ + β.

    Over y, θ + β grows with |y|. Over θ it has one minimum, where slider C is as high as P: there
    S_C = -r sinθ, cosθ = (R² + r² - u²) / (2 R r).
    """
    r, R, L = sizes
    low, high = theta
    first, last = _lean(sizes, near, low), _lean(sizes, near, high)
    cosine = (R * R + r * r - (L - near) * (L + near)) / (2 * R * r)
    exists = np.abs(np.real(cosine)) < 1
    lowest = -np.arccos(np.where(exists, cosine, 0.0))
    inside = exists & (np.real(lowest) > np.real(low)) & (np.real(lowest) < np.real(high))
    least = np.where(inside, _lean(sizes, near, lowest), first)
    return np.pi / 2 + first, np.pi / 2 + last, np.pi / 2 + least
