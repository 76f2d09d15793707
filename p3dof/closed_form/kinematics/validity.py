"""Which poses are reachable and which are singular: margins, and one clear error for a batch.

Which states are within reach, and where the actuators hold the platform: the verdict of the closed forms.

The configuration is computed here, once; what the closed forms know of the states goes on from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray, Readable
from p3dof._base.samples import (
    ACTUATION_TOLERANCE,
    REACH_TOLERANCE,
    OnInvalid,
    raise_out_of_reach,
    raise_singular,
)
from p3dof.closed_form.paper.formulas import Configuration, Lengths, configuration
from p3dof.machine.motion.states import States, states_of
from p3dof.machine.parameters import Geometry


@dataclass(frozen=True, eq=False)
class Singularity(Readable):
    """How far poses are from the two kinds of singularity.

    Parameters
    ----------
    serial : ndarray, shape (..., 3)
        Reach margin of the legs A, B, C [m]: the leg's length less what the pose demands of it across the
        guides. Zero: the leg is horizontal; negative: the pose is out of reach.
    actuation : ndarray, shape (...)
        Angle from the pose where the platform's arm P-C5 lies in the plane of leg C's rods [rad], positive on
        home's side. Zero: det J = 0, the sliders cannot hold the platform's rotation.
    determinant : ndarray, shape (...)
        det J of ∂(λA, λB, λC)/∂(y, z, θ) [m/rad]; NaN out of reach.
    """

    serial: FloatArray
    actuation: FloatArray
    determinant: FloatArray


def reach_margins(geometry: Geometry, poses: FloatArray) -> FloatArray:
    """Return by how much legs A, B, C are longer than demanded across [m]; zero or less is out of reach."""
    y, _, theta = components(poses)
    width = geometry.R - geometry.r
    demands = (np.abs(width + y), np.abs(width - y), np.hypot(y, geometry.R - geometry.r * np.cos(theta)))
    margins: FloatArray = geometry.L - np.stack(demands, axis=-1)
    return margins


def actuation_angle(x: Configuration) -> FloatArray:
    """Return the angle from the pose where the platform's arm lies in the plane of the rods of leg C.

    [rad]; see `Singularity`.
    """
    return np.asarray(np.arcsin(np.clip(x.cos_54, -1, 1)))


def reached(geometry: Geometry, serial: FloatArray) -> NDArray[np.bool_]:
    """Return whether every leg reaches, by more than what rounding can tell; ndarray of bool, shape (...)."""
    inside: NDArray[np.bool_] = np.all(serial > REACH_TOLERANCE * geometry.L, axis=-1)
    return inside


class Placed(NamedTuple):
    """States within reach, with the configuration of the mechanism at each."""

    states: States  # with rows of NaN where they are invalid
    lengths: Lengths  # of the mechanism [m]
    x: Configuration  # of arrays of the leading shape of the states; NaN where they are invalid

    @property
    def actuation(self) -> FloatArray:
        """Angles from the actuation singularity (...) [rad]; see `Singularity`."""
        return actuation_angle(self.x)

    def without(self, bad: NDArray[np.bool_]) -> Placed:
        """Return the states with rows of NaN where they are bad, (...)."""

        def hidden(values: Any) -> Any:
            return np.where(bad, np.nan, values)

        sliders, *others = self.x
        a, b, c = map(hidden, sliders)
        return Placed(self.states.without(bad), self.lengths, Configuration((a, b, c), *map(hidden, others)))


def reachable(geometry: Geometry, states: States) -> Placed:
    """Return states that every leg reaches."""
    states = states.finite()
    margins = reach_margins(geometry, states.pose)
    inside = reached(geometry, margins)
    if not inside.all():
        if states.on_invalid == "raise":
            raise_out_of_reach(states.pose, ~inside, margins)
        states = states.without(~inside)
    lengths = Lengths.of(geometry)
    return Placed(states, lengths, configuration(lengths, components(states.pose), np))


def holdable(geometry: Geometry, states: States) -> Placed:
    """Return states that every leg reaches and at which the actuators hold the platform."""
    placed = reachable(geometry, states)
    actuation = placed.actuation
    singular = np.abs(actuation) < ACTUATION_TOLERANCE
    if not singular.any():
        return placed
    if states.on_invalid == "raise":
        raise_singular(placed.states.pose, singular, actuation)
    return placed.without(singular)


def reachable_poses(geometry: Geometry, pose: ArrayLike, on_invalid: OnInvalid) -> FloatArray:
    """Return poses that every leg reaches, with rows of NaN in the place of others, or raise for these."""
    return reachable(geometry, states_of(pose, on_invalid=on_invalid)).states.pose
