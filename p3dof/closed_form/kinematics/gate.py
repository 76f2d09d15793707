"""Which states are within reach, and where the actuators hold the platform: the verdict of the closed forms.

The configuration is computed here, once; what the closed forms know of the states goes on from it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray
from p3dof._base.samples import ACTUATION_TOLERANCE, OnInvalid, raise_out_of_reach, raise_singular
from p3dof.closed_form.kinematics.validity import actuation_angle, reach_margins, reached
from p3dof.closed_form.paper.formulas import Configuration, Lengths, configuration
from p3dof.machine.motion.states import States, states_of
from p3dof.machine.parameters import Geometry


class Placed(NamedTuple):
    """States within reach, with the configuration of the mechanism at each.

    Parameters
    ----------
    states : States
        With rows of NaN where they are invalid.
    lengths : Lengths
        Of the mechanism [m].
    x : Configuration
        Of arrays of the leading shape of the states; NaN where they are invalid.
    """

    states: States
    lengths: Lengths
    x: Configuration

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
    """Return states that every leg reaches.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    states : States
        What the user gave.

    Returns
    -------
    Placed

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and the first sample that is out of reach or not finite, unless these become NaN.
    """
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
    """Return states that every leg reaches and at which the actuators hold the platform.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    states : States
        What the user gave.

    Returns
    -------
    Placed

    Raises
    ------
    ReachError, SingularityError, InputError
        Naming the first bad sample and how many there are, unless these become NaN.
    """
    placed = reachable(geometry, states)
    actuation = placed.actuation
    singular = np.abs(actuation) < ACTUATION_TOLERANCE
    if not singular.any():
        return placed
    if states.on_invalid == "raise":
        raise_singular(placed.states.pose, singular, actuation)
    return placed.without(singular)


def reachable_poses(geometry: Geometry, pose: ArrayLike, on_invalid: OnInvalid) -> FloatArray:
    """Return poses that every leg reaches, with rows of NaN in the place of others, or raise for these.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad].
    on_invalid : {"raise", "nan"}
        What to do with samples that are not finite or out of reach.

    Returns
    -------
    ndarray, shape (..., 3)

    Raises
    ------
    ReachError, InputError
        As `reachable`.
    """
    return reachable(geometry, states_of(pose, on_invalid=on_invalid)).states.pose
