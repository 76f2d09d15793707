"""How a run enters a motion from rest: for how long, and what loads it on the way."""

from __future__ import annotations

import math

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.motion.core import Motion
from p3dof.machine.motion.splines import eased
from p3dof.machine.motion.wrenches import WrenchHistory

RAMP = 0.2
"""How long a motion that does not start at rest takes to come from there, if nobody says so [s]."""

AT_REST = 1e-3
"""Share of its largest velocity below which a motion starts at rest: what a spline makes of rounded poses."""

_ROWS_OF_A_RAMP = 2000
"""Rows of the load a second of a ramp, along which it changes as the motion comes up to its rate."""


def natural_ramp(motion: Motion) -> float:
    """Return how long a motion takes to come from rest, if nobody says so: no time if it starts there [s].

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    float
    """
    speed = np.abs(motion.velocity)
    at_rest = np.all(speed[0] <= AT_REST * speed.max(axis=0))
    return 0.0 if at_rest else min(RAMP, motion.duration)


def load_along(history: WrenchHistory, motion: Motion, ramp: float) -> WrenchHistory:
    """Return the load of a run that enters a motion from rest, by its place on the path.

    Parameters
    ----------
    history : WrenchHistory
        The load at the times of the motion.
    motion : Motion
        The motion.
    ramp : float
        How long it takes to come from rest to the motion's own rate [s]; 0 to start as the motion does.

    Returns
    -------
    WrenchHistory
        At the times of the run.
    """
    history, begin = history.since(motion.start), float(motion.time[0])
    places = history.time - begin
    if not ramp:
        return WrenchHistory(places, history.wrench, 0.0)
    entered: FloatArray = np.array(np.linspace(0.0, ramp, math.ceil(_ROWS_OF_A_RAMP * ramp) + 1), dtype=float)
    phase = eased(entered, motion.duration + ramp / 2, ramp, 0.0)[0]
    inside = places[(places > 0) & (places < ramp / 2)]
    times = np.concatenate([entered, np.interp(inside, phase, entered)])
    times, first = np.unique(times, return_index=True)
    phase = np.concatenate([phase, inside])[first]
    later = places[places > ramp / 2]
    return WrenchHistory(
        np.concatenate([times, later + ramp / 2]),
        np.concatenate([history(begin + phase), history(begin + later)]),
        0.0,
    )
