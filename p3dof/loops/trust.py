"""Closing loops from far away: the Levenberg-Marquardt method, within the limits of joints on request."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof.loops.closures import max_abs
from p3dof.loops.coordinates import length_coordinates, rounding
from p3dof.loops.solver import Path, Point, System

_MOST = 300
"""Steps after which a start is given up."""
_SOLVED = 1e-14
"""Residual below which no further step is taken [m or rad]."""
_GAIN = 1e-4
"""Share of the predicted decrease from which on a step is taken."""
_STALLED = 1e-13
"""Relative step after which nothing moves any more."""
_SLOW = 40
"""Steps within which the residual must halve."""
_LARGEST = 1e12
"""Damping, relative to its start, at which a start is given up."""
_BEYOND = 1e-9
"""Distance from which on a joint is beyond its limit [m or rad]."""
_AT_LIMIT = 1e-12
"""Distance at which a joint is at its limit [m or rad]."""


class Limits:
    """Position limits of the joints with one freedom that are plain coordinates.

    Parameters
    ----------
    model : pin.Model
        The tree.
    """

    def __init__(self, model: pin.Model) -> None:
        joints = [i for i in range(1, model.njoints) if model.nqs[i] == 1 and model.nvs[i] == 1]
        self.names = [str(model.names[i]) for i in joints]
        self.q = np.array([model.idx_qs[i] for i in joints], dtype=int)
        self.v = np.array([model.idx_vs[i] for i in joints], dtype=int)
        """Where these joints are."""
        self.lower: FloatArray = np.array(model.lowerPositionLimit)[self.q]
        self.upper: FloatArray = np.array(model.upperPositionLimit)[self.q]
        self._lengths = length_coordinates(model)[0][self.q]

    def beyond(self, q: FloatArray) -> dict[str, float]:
        """Return by how much joints are beyond their limits [m or rad], negative if below."""
        values = q[self.q]
        over = np.maximum(values - self.upper, 0.0) + np.minimum(values - self.lower, 0.0)
        return {self.names[i]: float(over[i]) for i in np.flatnonzero(np.abs(over) > _BEYOND)}

    def inside(self, q: FloatArray) -> FloatArray:
        """Return the configuration (nq,) with these joints moved to their limits, whole turns first.

        What is beyond a limit by rounding only goes back to it, and by no turn.
        """
        q = q.copy()
        turn = np.where(self._lengths, np.inf, 2 * np.pi)
        over = np.maximum(q[self.q] - self.upper, 0.0) + np.minimum(q[self.q] - self.lower, 0.0)
        over = np.where(np.abs(over) > _BEYOND, over, 0.0)
        with np.errstate(invalid="ignore"):
            turns = np.where(self._lengths, 0.0, np.sign(over) * np.ceil(np.abs(over) / turn))
        shifted = q[self.q] - np.where(turns == 0, 0.0, turns * 2 * np.pi)
        fits = (shifted >= self.lower) & (shifted <= self.upper)
        q[self.q] = np.clip(np.where(fits, shifted, q[self.q]), self.lower, self.upper)
        return q

    def turns(self, q: FloatArray, near: FloatArray) -> list[tuple[int, float]]:
        """Return by which whole turns joints would come nearest to `near` (nq,) within limits, and where."""
        found = []
        for i in np.flatnonzero(~self._lengths):
            at = int(self.q[i])
            shift = 2 * np.pi * float(np.round((near[at] - q[at]) / (2 * np.pi)))
            if shift and self.lower[i] <= q[at] + shift <= self.upper[i]:
                found.append((at, shift))
        return found

    def random(self, model: pin.Model, around: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return a configuration (nq,) anywhere: within limits and half a turn, or a unit of length."""
        shift = generator.uniform(-1.0, 1.0, model.nv)
        shift *= np.where(length_coordinates(model)[1], 1.0, np.pi)
        q = np.array(pin.integrate(model, around, shift))
        wide = np.where(self._lengths, 1.0, np.pi)
        low = np.maximum(self.lower, around[self.q] - wide)
        high = np.minimum(self.upper, around[self.q] + wide)
        some = generator.uniform(0.0, 1.0, len(low))
        q[self.q] = np.where(
            low <= high, low + some * (high - low), np.clip(q[self.q], self.lower, self.upper)
        )
        return q

    def apart(self, model: pin.Model, one: FloatArray, other: FloatArray) -> FloatArray:
        """Return the difference (nv,) of two configurations; whole turns of joints are none."""
        difference = np.array(pin.difference(model, one, other))
        turning = self.v[~self._lengths]
        difference[turning] -= 2 * np.pi * np.round(difference[turning] / (2 * np.pi))
        return difference

    def told(self, q: FloatArray) -> str:
        """Say which joint is beyond its limits the most."""
        over = self.beyond(q)
        name = max(over, key=lambda joint: abs(over[joint]))
        at = self.names.index(name)
        return (
            f"the joint {shown(name)} would be at {q[self.q[at]]:.4g}, "
            f"its limits are {self.lower[at]:.4g} and {self.upper[at]:.4g}"
        )


def levenberg_marquardt(
    system: System, q: FloatArray, tolerance: float, limits: Limits | None = None
) -> Path:
    """Minimise the residual by damped steps, from anywhere; joints stay within limits, if there are any.

    The damping is in proportion to the squared residual, which keeps steps short far away and makes them
    Newton steps near a solution, also where the Jacobian is singular. Joints at a limit that the
    gradient holds there do not take part in a step.

    Parameters
    ----------
    system : System
        What to solve.
    q : (nq,) array
        Start.
    tolerance : float
        Largest residual of a solution [m or rad].
    limits : Limits, optional
        Between which joints have to stay.

    Returns
    -------
    Path
        Not complete if it ends in a minimum that is not zero.

    References
    ----------
    K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems, 2nd ed., Technical
    University of Denmark 2004, section 3.2: the damping.
    J. Fan, Y. Yuan, On the quadratic convergence of the Levenberg-Marquardt method without nonsingularity
    assumption, Computing 74 (2005) 23-39.
    """
    point = system.at(q if limits is None else limits.inside(q))
    damping, growth, count = 1.0, 2.0, 0
    costs = [float(point.r @ point.r)]
    while count < _MOST and point.gap > _SOLVED:
        count += 1
        step = _damped(point, damping * costs[-1], limits)
        there = _moved(system, point, step, limits)
        cost = float(there.r @ there.r)
        predicted = costs[-1] - float(np.sum((point.r + point.J @ step) ** 2))
        gain = (costs[-1] - cost) / predicted if predicted > 0 else -1.0
        if gain > _GAIN:  # not so if something is not a number
            point = there
            costs.append(cost)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            growth = 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
        stalled = max_abs(step) <= _STALLED * max(1.0, max_abs(point.q)) or damping > _LARGEST
        if stalled or (len(costs) > _SLOW and costs[-1] > 0.25 * costs[-_SLOW]):
            break
    return Path(point, point.gap <= max(tolerance, float(rounding(point.q[None])[0])), count)


def _damped(point: Point, damping: float, limits: Limits | None) -> FloatArray:
    """Return the step (nv,) of joints that are free to move."""
    J = point.J
    if limits is not None:
        descent = -(point.r @ J)[limits.v]
        values = point.q[limits.q]
        held = (values >= limits.upper - _AT_LIMIT) & (descent > 0)
        held |= (values <= limits.lower + _AT_LIMIT) & (descent < 0)
        J = J.copy()
        J[:, limits.v[held]] = 0.0
    stacked = np.concatenate((J, np.sqrt(damping) * np.eye(J.shape[1])))
    goal = np.concatenate((-point.r, np.zeros(J.shape[1])))
    return np.asarray(np.linalg.lstsq(stacked, goal, rcond=point.rank_tolerance * 1e-3)[0])


def _moved(system: System, point: Point, step: FloatArray, limits: Limits | None) -> Point:
    """Return where a step leads, joints stopping at their limits."""
    there = np.array(pin.integrate(system.kinematics.model, point.q, step))
    if limits is not None:
        there[limits.q] = np.clip(there[limits.q], limits.lower, limits.upper)
    return system.at(there)
