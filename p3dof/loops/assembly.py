"""Assembling a mechanism: configurations that close the loops at a target, the next one or all there are.

What an assembly is driven to: values of the actuated joints, or components of a frame's placement. How:
Newton's method along a path that never leaves an assembly; Levenberg-Marquardt from afar.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Protocol, TypeAlias, TypeGuard, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, shown
from p3dof._base.errors import AssemblyError, InputError, ModelError
from p3dof._base.threads import Workspace
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.coordinates import ACCURACY, length_coordinates, rounding, single_joint
from p3dof.loops.linear import Decomposition, actuation_of, least_norm, orientation
from p3dof.loops.partitions import Memory, Split

_ALL = (True,) * 6


@dataclass(frozen=True, eq=False)
class FrameTarget(Readable):
    """Chosen components of the placement of a frame.

    Parameters
    ----------
    frame : str
        Name of the frame.
    placement : pin.SE3
        Where the frame shall be, in the world; only the components in `mask` count.
    mask : (6,) array of bool
        Which components are prescribed: x, y, z, rx, ry, rz in world axes at the frame's origin. A mechanism
        with three degrees of freedom can be given three.

    Notes
    -----
    The error of position is p - p_target [m], that of rotation log3(R R_targetᵀ) [rad]. Velocity and
    acceleration of the target are the same components of the frame's ``LOCAL_WORLD_ALIGNED`` velocity and
    classical acceleration. If the mechanism turns the frame about axes that are not prescribed, away from
    `placement`, then the prescribed components of log3 and the time integral of the same components of the
    angular velocity are different things; where the frame's other rotations agree with `placement`, or all
    three are prescribed, they are the same.

    Raises
    ------
    InputError
        If the placement is not a finite `pin.SE3` or the mask is not six bools with at least one true.
    """

    frame: str
    placement: pin.SE3
    mask: Sequence[bool] | NDArray[np.bool_] = _ALL

    def __post_init__(self) -> None:
        if not isinstance(self.frame, str):
            raise InputError(f"frame: expected the name of a frame, got {self.frame!r}")
        if not isinstance(self.placement, pin.SE3):
            raise InputError(f"placement: expected a pinocchio.SE3, got {type(self.placement).__name__}")
        matrix = frozen_array("placement", self.placement.homogeneous, (4, 4))
        R = matrix[:3, :3]
        if np.abs(R.T @ R - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0:
            raise InputError("placement: its rotation matrix is not a rotation")
        mask = np.array(self.mask)
        if mask.dtype != np.bool_ or mask.shape != (6,):
            raise InputError(f"mask: expected six bools, got {self.mask!r}")
        if not mask.any():
            raise InputError("mask: expected at least one prescribed component")
        mask.setflags(write=False)
        object.__setattr__(self, "mask", mask)
        object.__setattr__(self, "placement", pin.SE3(self.placement))


OneTarget: TypeAlias = FrameTarget | ArrayLike | Mapping[str, float]
"""A frame's placement, the values of the actuated joints, or values of joints by name."""
TargetLike: TypeAlias = OneTarget | Sequence[OneTarget] | None
"""One target, several at once, or nothing but closed loops."""


class Residual(Protocol):
    """What an assembly brings to zero besides its closures."""

    size: int

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,) and its Jacobian (size, nv) at a configuration."""


class Target(Residual, Protocol):
    """A target that is bound to a model: its error and how velocities change it."""

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the matrix (size, nv) from v to the target's velocity."""

    def drift(self) -> FloatArray:
        """Return the target's acceleration (size,) in the motion last given to `LoopKinematics.move`."""


class JointTarget:
    """Values of the actuated joints [m or rad]; a continuous joint is given an angle."""

    def __init__(self, kinematics: LoopKinematics, joints: Sequence[int], values: ArrayLike) -> None:
        model = kinematics.model
        self.size = len(joints)
        self.values = frozen_array("target", values, (self.size,))
        self._q = np.array([model.idx_qs[j] for j in joints], dtype=int)
        self._circles = np.array([model.nqs[j] == 2 for j in joints], dtype=bool)
        self._J = np.eye(model.nv)[[model.idx_vs[j] for j in joints]]

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,), for a continuous joint the shorter way round, and its Jacobian."""
        error = q[self._q] - self.values
        if self._circles.any():
            cosine, sine = self._q[self._circles], self._q[self._circles] + 1
            goal = self.values[self._circles]
            c, s = np.cos(goal), np.sin(goal)
            error[self._circles] = np.arctan2(q[sine] * c - q[cosine] * s, q[cosine] * c + q[sine] * s)
        return error, self._J

    def jacobian(self, _q: FloatArray) -> FloatArray:
        """Return the matrix (size, nv) that picks the actuated joints."""
        return self._J

    def drift(self) -> FloatArray:
        """Return zeros (size,): a joint's acceleration is its entry of a."""
        return np.zeros(self.size)


class BoundFrameTarget:
    """A `FrameTarget` in a model."""

    def __init__(self, kinematics: LoopKinematics, target: FrameTarget) -> None:
        frame = kinematics.frame(target.frame, "target", InputError)
        self._kinematics = kinematics
        self._joint, self._placement = frame.parentJoint, frame.placement
        self._position, self._rotation = target.placement.translation, target.placement.rotation
        self._mask = np.asarray(target.mask)
        self._turns = bool(self._mask[3:].any())
        self.size = int(self._mask.sum())

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,) and its exact Jacobian, also at large rotations."""
        J = self._full_jacobian(q)
        M = self._kinematics.data.oMi[self._joint] * self._placement
        error = np.zeros(6)
        error[:3] = M.translation - self._position
        if self._turns:
            E = M.rotation @ self._rotation.T
            error[3:] = pin.log3(E)
            # d log3(exp(ω dt) E)/dt = Jlog3(E) Eᵀ ω = Jlog3(E)ᵀ ω
            J[3:] = pin.Jlog3(E).T @ J[3:]
        J = J[self._mask]
        return error[self._mask], J

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the prescribed rows (size, nv) of the frame's Jacobian."""
        rows: FloatArray = self._full_jacobian(q)[self._mask]
        return rows

    def drift(self) -> FloatArray:
        """Return the prescribed components (size,) of the frame's classical acceleration."""
        k = self._kinematics
        arguments = (k.model, k.data, self._joint, self._placement, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(pin.getFrameClassicalAcceleration(*arguments).vector[self._mask])

    def _full_jacobian(self, q: FloatArray) -> FloatArray:
        k = self._kinematics
        k.at(q)
        arguments = (k.model, k.data, self._joint, self._placement, pin.LOCAL_WORLD_ALIGNED)
        return np.array(pin.getFrameJacobian(*arguments))


class CombinedTarget:
    """Several targets at once, their components one after the other."""

    def __init__(self, parts: Sequence[Target]) -> None:
        self._parts = tuple(parts)
        self.size = sum(part.size for part in self._parts)

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return all errors (size,) and their Jacobian (size, nv)."""
        errors, matrices = zip(*(part.evaluate(q) for part in self._parts), strict=True)
        return np.concatenate(errors), np.concatenate(matrices)

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the matrix (size, nv) from v to the velocities of all."""
        return np.concatenate([part.jacobian(q) for part in self._parts])

    def drift(self) -> FloatArray:
        """Return the accelerations (size,) of all."""
        return np.concatenate([part.drift() for part in self._parts])


class ChartTarget:
    """Where a configuration is, seen along the free motions of another one."""

    def __init__(self, model: pin.Model, home: FloatArray, free: FloatArray, q: FloatArray) -> None:
        self._model, self._home, self._free = model, home, free
        self.size = free.shape[1]
        self._values = free.T @ pin.difference(model, home, q)

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,) and its Jacobian (size, nv)."""
        error = self._free.T @ pin.difference(self._model, self._home, q) - self._values
        return error, np.asarray(self._free.T @ pin.dDifference(self._model, self._home, q, pin.ARG1))


class NoTarget:
    """No target: only the loops are closed."""

    size = 0

    def __init__(self, nv: int) -> None:
        self._J = np.zeros((0, nv))

    def evaluate(self, _q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return an empty error and an empty Jacobian."""
        return np.zeros(0), self._J

    def jacobian(self, _q: FloatArray) -> FloatArray:
        """Return an empty matrix (0, nv)."""
        return self._J

    def drift(self) -> FloatArray:
        """Return an empty array."""
        return np.zeros(0)


def bound(target: TargetLike, kinematics: LoopKinematics, actuated: Sequence[int]) -> Target:
    """Return a target that is bound to a model, whose actuated joints have these ids."""
    if target is None:
        return NoTarget(kinematics.model.nv)
    if isinstance(target, FrameTarget):
        return BoundFrameTarget(kinematics, target)
    if isinstance(target, Mapping):
        return JointTarget(kinematics, named_joints(kinematics.model, target), list(target.values()))
    if are_several(target):
        return CombinedTarget([bound(part, kinematics, actuated) for part in target])
    return JointTarget(kinematics, actuated, cast("ArrayLike", target))


def named_joints(model: pin.Model, names: Iterable[str], what: str = "target") -> list[int]:
    """Return the ids of joints with one degree of freedom that a target names."""
    try:
        return [single_joint(model, name, what) for name in names]
    except ModelError as error:
        raise InputError(str(error)) from error


def are_several(target: TargetLike) -> TypeGuard[Sequence[OneTarget]]:
    """Whether a target is a sequence of targets, and not of numbers."""
    return isinstance(target, list | tuple) and any(
        isinstance(part, FrameTarget | Mapping) for part in target
    )


def in_arrays(target: TargetLike) -> Any:
    """Return a target that was checked, with arrays where numbers are meant."""
    if target is None or isinstance(target, FrameTarget):
        return target
    if isinstance(target, Mapping):
        return {name: float(value) for name, value in target.items()}
    if are_several(target):
        return [in_arrays(part) for part in target]
    return np.asarray(target, dtype=float)


FIRST_STEP = 0.3  # largest first Newton step that is trusted [m or rad]
CONTRACTION = 0.25  # a Newton step may be at most this fraction of the one before it
NEGLIGIBLE = 1e-9  # after a step this small, quadratic convergence leaves but round-off [m or rad]
ON_THE_WAY = 1e-8  # newton step after which an intermediate point of a path is good enough [m or rad]
_SHORTEST = 2.0**-22  # smallest fraction of a path that is tried
_MOST = 2000  # newton steps after which a path is given up
_PATIENCE = 15  # steps of the fallback within which the residual must halve
FAR = 4.0  # residual that can only be a length [m]: where larger, steps of lengths are in shares of it
_MAX_STEP = 0.5  # largest step of the fallback [m or rad]


@dataclass(slots=True, eq=False)
class Point:
    """Residual of closures and target at one configuration."""

    q: FloatArray  # (nq,): the configuration
    r: FloatArray  # (rows + size,): closure errors, then target errors [m, rad]
    J: FloatArray  # (rows + size, nv): Jacobian of `r`
    rank_tolerance: float  # relative rank tolerance for `J`

    @property
    def gap(self) -> float:
        """The largest entry of `r` [m or rad]."""
        return max_abs(self.r)

    def same_branch(self, other: Point) -> bool:
        """Whether the Jacobian keeps its orientation from here to a neighbouring solution.

        Two solutions that meet in a fold have Jacobians of opposite orientation, so a Newton step that jumps
        from one to the other, across targets out of reach, is found out. The determinant is that of the rows
        and columns which matter here: redundant closures and free motions have none.
        """
        return orientation(self.J, other.J, self.rank_tolerance) > 0

    def step_to(self, goal: FloatArray | float) -> FloatArray:
        """Return the shortest step (nv,) that brings `r` to `goal` to first order."""
        if not self.J.size:
            return np.zeros(self.J.shape[1])
        return least_norm(self.J, goal - self.r, self.rank_tolerance)


@dataclass(slots=True, eq=False)
class Path:
    """Where an iteration ended."""

    point: Point  # the last good point
    complete: bool  # whether the residual was brought to zero
    iterations: int  # Newton steps taken
    moved: bool = True  # whether it got anywhere, by more than what errors on the way allow


class System:
    """Closures and target as one system of equations r(q) = 0."""

    def __init__(self, kinematics: LoopKinematics, target: Residual) -> None:
        self.kinematics = kinematics
        self.target = target

    def at(self, q: FloatArray) -> Point:
        """Evaluate the system at a configuration (nq,)."""
        closures = self.kinematics.at(q)
        if not self.target.size:
            return Point(closures.q, closures.error, closures.J, closures.rank_tolerance)
        error, J = self.target.evaluate(q)
        r = np.concatenate((closures.error, error))
        return Point(closures.q, r, np.concatenate((closures.J, J)), closures.rank_tolerance)

    def yardsticks(self, r0: FloatArray) -> FloatArray | None:
        """Return what to measure steps (nv,) by where the target is far away: one, and for lengths more."""
        far = max_abs(r0) / FAR
        return np.where(self.kinematics.lengths, far, 1.0) if far > 1.0 else None

    def moved(self, q: FloatArray, step: FloatArray) -> Point:
        """Evaluate the system at a configuration moved by a tangent step (nv,)."""
        return self.at(pin.integrate(self.kinematics.model, q, step))


def follow(system: System, q: FloatArray, tolerance: float) -> Path:
    """Drive the residual from its value r0 at `q` to zero along (1 - s) r0, never leaving the path.

    Each step of s is one predictor and a few Newton steps. It is taken when the predictor is small, every
    Newton step contracts and the Jacobian keeps its orientation; otherwise s takes half the step. The first
    attempt is the whole way, so a near start costs two or three iterations.

    Not complete if the path ends or turns back before s = 1, as at the border of reach.

    P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2011, section 5.1: natural continuation with
    a contraction test of 1/4.
    """
    point = system.at(q)
    r0 = point.r
    by = system.yardsticks(r0)
    s, step, count = 0.0, 1.0, 0
    while s < 1.0:
        end = min(s + step, 1.0)
        arrived, iterations = _correct(system, point, (1.0 - end) * r0, end == 1.0, tolerance, by)
        count += iterations
        if arrived is not None and point.same_branch(arrived):
            point, s, step = arrived, end, 2.0 * step
        elif step > _SHORTEST and count < _MOST:
            step = min(step, 1.0 - s) / 2.0
        else:
            moved = max_abs(pin.difference(system.kinematics.model, q, point.q)) > _OPEN
            return Path(point, False, count, moved)
    return Path(point, True, count)


def least_squares(system: System, q: FloatArray, tolerance: float) -> Path:
    """Minimise the residual by bounded Gauss-Newton steps; not complete in a minimum that is not zero."""
    point = system.at(q)
    by = system.yardsticks(point.r)
    count, size, history = 0, np.inf, [np.inf] * _PATIENCE
    while size > NEGLIGIBLE and point.gap < 0.5 * history[-_PATIENCE]:
        count += 1
        history.append(point.gap)
        step = point.step_to(0.0)
        size = max_abs(step if by is None else step / by)
        step *= min(1.0, _MAX_STEP / max(size, 1e-300))
        cost = point.r @ point.r
        for fraction in 0.5 ** np.arange(12):
            trial = system.moved(point.q, fraction * step)
            if trial.r @ trial.r < (1.0 - 1e-3 * fraction) * cost:
                point = trial
                break
        else:
            break
    return Path(point, point.gap <= max(tolerance, float(rounding(point.q))), count)


def _correct(
    system: System, start: Point, goal: FloatArray, last: bool, tolerance: float, by: FloatArray | None
) -> tuple[Point | None, int]:
    """Newton's method for r = goal; None unless it contracts from the first step on."""
    enough, error = (NEGLIGIBLE, tolerance) if last else (ON_THE_WAY, max(ON_THE_WAY, tolerance))
    point, limit = start, FIRST_STEP
    for count in range(1, 11):
        step = point.step_to(goal)
        size = max_abs(step if by is None else step / by)
        if not size <= (limit if limit > enough else enough):  # also when it is not a number
            return None, count
        point = system.moved(point.q, step)
        if size <= enough:
            error = max(error, float(rounding(point.q)))
            return (point if max_abs(point.r - goal) <= error else None), count
        limit = CONTRACTION * size
    return None, count


_MOST_STEPS = 300  # steps after which a start is given up
_SOLVED = 1e-14  # residual below which no further step is taken [m or rad]
_GAIN = 1e-4  # share of the predicted decrease from which on a step is taken
_STALLED = 1e-13  # relative step after which nothing moves any more
_SLOW = 40  # steps within which the residual must halve
_LARGEST = 1e12  # damping, relative to its start, at which a start is given up
BEYOND = 1e-9  # distance from which on a joint is beyond its limit [m or rad]
_AT_LIMIT = 1e-12  # distance at which a joint is at its limit [m or rad]


class Limits:
    """Position limits of the joints with one freedom that are plain coordinates."""

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
        return {self.names[i]: float(over[i]) for i in np.flatnonzero(np.abs(over) > BEYOND)}

    def inside(self, q: FloatArray) -> FloatArray:
        """Return the configuration (nq,) with these joints moved to their limits, whole turns first.

        What is beyond a limit by rounding only goes back to it, and by no turn.
        """
        q = q.copy()
        turn = np.where(self._lengths, np.inf, 2 * np.pi)
        over = np.maximum(q[self.q] - self.upper, 0.0) + np.minimum(q[self.q] - self.lower, 0.0)
        over = np.where(np.abs(over) > BEYOND, over, 0.0)
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

    Not complete if it ends in a minimum that is not zero.

    K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems, 2nd ed., Technical
    University of Denmark 2004, section 3.2: the damping.
    J. Fan, Y. Yuan, On the quadratic convergence of the Levenberg-Marquardt method without nonsingularity
    assumption, Computing 74 (2005) 23-39.
    """
    point = system.at(q if limits is None else limits.inside(q))
    damping, growth, count = 1.0, 2.0, 0
    costs = [float(point.r @ point.r)]
    while count < _MOST_STEPS and point.gap > _SOLVED:
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
    return Path(point, point.gap <= max(tolerance, float(rounding(point.q))), count)


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


class Evidence:
    """What is found out about an assembly when it is asked for, and once."""

    def __init__(self, find: Callable[[], bool], closures: ClosurePoint) -> None:
        self._find, self._closures = find, closures

    @cached_property
    def kept(self) -> bool:
        """Whether the assembly was kept."""
        return self._find()

    @property
    def rank(self) -> int:
        """Rank of the closures' Jacobian."""
        return self._closures.svd.rank if self._closures.J.size else 0

    @property
    def mobility(self) -> int:
        """Free motions of the closed mechanism."""
        return self._closures.J.shape[1] - self.rank

    def __reduce__(self) -> tuple[type[Evidence], tuple[partial[bool], ClosurePoint]]:
        return Evidence, (partial(bool, self.kept), self._closures)  # for other processes


@dataclass(frozen=True, eq=False)
class Assembly(Readable):
    """A configuration that closes the loops at the target.

    Parameters
    ----------
    q : (nq,) array
        Configuration of the whole tree.
    gap : float
        The largest closure or target error that is left [m or rad].
    iterations : int
        Steps taken in all to find it, those of attempts that failed included.
    evidence : Evidence
        What all other attributes ask.
    """

    q: FloatArray
    gap: float
    iterations: int
    evidence: Evidence = field(repr=False)

    @property
    def same_assembly(self) -> bool:
        """Whether the configuration was reached from the guess without leaving its assembly.

        Its closures then have the rank that is usual for the mechanism, too. False if this could not be
        established, as behind a pose in which assemblies meet. A guess whose own loops are open by more than
        1e-3 has no assembly; that of the reference configuration is meant then: what closing its loops, if
        they are open, leads to. That may take a while when it is asked for the first time, in the
        workspace of the model.
        """
        return self.evidence.kept

    @property
    def rank(self) -> int:
        """Rank of the closures' Jacobian at `q`."""
        return self.evidence.rank

    @property
    def mobility(self) -> int:
        """Free motions of the closed mechanism: nv - rank."""
        return self.evidence.mobility


@dataclass(frozen=True, eq=False)
class State(Assembly):
    """An assembly that moves; also see `Assembly`.

    Parameters
    ----------
    v, a : (nv,) array
        Velocity and acceleration of the whole tree.
    determined : bool
        False if closures and target leave velocities free; `v` and `a` are then the shortest possible.
    influence : (nv, size) array
        How fast every joint moves per unit speed of the target: v = influence @ velocity. Its rows of the
        actuated joints are the inverse Jacobian of a parallel mechanism.
    """

    v: FloatArray
    a: FloatArray
    determined: bool
    influence: FloatArray


_FOLLOWS = 1e-9  # share of a target's row in one of a closure from which on that follows from the target, too


class TargetMotions(Workspace):
    """Completes the motions of one model."""

    def __init__(self, kinematics: LoopKinematics) -> None:
        self.kinematics, self.model = kinematics, kinematics.model
        self._memories: dict[tuple[type, int], Memory] = {}

    def complete(
        self, target: Target, assembly: Assembly, velocity: FloatArray, acceleration: FloatArray
    ) -> State:
        """Find the velocity and the acceleration of the whole tree that move the target as asked."""
        k, q = self.kinematics, assembly.q
        closures = k.at(q)
        A = np.concatenate((closures.J, target.jacobian(q)))
        solve, influence, determined = self._solution(closures, A, target)
        b = np.concatenate((np.zeros(k.size), velocity))
        v = solve(b)
        self._check("velocity", A.dot(v) - b, b, v, closures)
        k.move(q, v)
        b = np.concatenate((-k.acceleration(), acceleration - target.drift()))
        a = solve(b)
        self._check("acceleration", A.dot(a) - b, b, a, closures)
        for array in (v, a, influence):
            array.setflags(write=False)
        return State(**vars(assembly), v=v, a=a, determined=determined, influence=influence)

    def _solution(
        self, closures: ClosurePoint, A: FloatArray, target: Target
    ) -> tuple[Callable[[FloatArray], FloatArray], FloatArray, bool]:
        """Return how to solve A x = b, a unit rate's motion, and if that is all; A: closures, then target."""
        count, size, nv = len(closures.J), target.size, self.model.nv
        if len(A) >= nv:  # else there is more than one solution
            memory = self._memories.setdefault((type(target), size), Memory(np.arange(nv)))
            split = memory.at(ClosurePoint(closures.q, closures.error, A))
            if split is not None and self._squarely(split, count, nv):
                rows, unit = split.partition.rows, np.zeros((nv, size), order="F")
                unit[nv - size :] = np.eye(size)  # the target's rows are the last ones
                return lambda b: split.solve(b.take(rows)), split.solve(unit), True
        stacked = Decomposition.of(A, closures.rank_tolerance)
        return stacked.solve, stacked.pseudo_inverse[:, count:], stacked.rank == nv

    def _squarely(self, split: Split, count: int, nv: int) -> bool:
        """Whether chosen rows determine every joint, and those left out are of closures and follow from such.

        What the target does is then the same by all of them.
        """
        partition = split.partition
        if len(partition.rows) < nv or not len(partition.left):
            return len(partition.rows) == nv
        of_target = split.weights[np.count_nonzero(partition.rows < count) :]
        return bool(partition.left[-1] < count and np.abs(of_target).max(initial=0.0) <= _FOLLOWS)

    def _check(
        self, what: str, error: FloatArray, b: FloatArray, x: FloatArray, closures: ClosurePoint
    ) -> None:
        if error.dot(error) <= ACCURACY**2:
            return  # less than what is always allowed
        worst = max_abs(error)
        if not worst <= ACCURACY * max(1.0, max_abs(b), max_abs(x)):
            asked, free = len(b) - self.kinematics.size, self.model.nv - closures.svd.rank
            told = f"; {asked} values are prescribed at a mobility of {free}: they have to fit each other"
            unit = "m/s or rad/s" if what == "velocity" else "m/s² or rad/s²"
            raise AssemblyError(
                f"the closed mechanism cannot have this {what}: {worst:.3g} {unit} is left over"
                + told * (asked > free),
                worst,
            )


_Solve: TypeAlias = Callable[[System, FloatArray, float], Path]

TOLERANCE = 1e-12  # largest closure and target error of an assembly by default [m or rad]
_OPEN = 1e-3  # a guess whose loops are open by more than this belongs to no assembly [m or rad]
_NEAR = 0.1  # the fallback has not left an assembly if it ends this near the end of the path [m or rad]
_SHAKE = 0.3  # standard deviation of the random starts of the last resort [m or rad]
_SHAKES = 3  # how many of them there are
RESTARTS = 20  # how many starts from anywhere there are, where nothing else closes the loops
_SAME = 1e-6  # configurations nearer than this are the same [m or rad]
_STEP = 0.05  # how far from the reference the usual rank is looked for [m or rad]


class Assembler:
    """Assembles one model."""

    def __init__(self, kinematics: LoopKinematics, reference: FloatArray) -> None:
        self.kinematics = kinematics
        self.model = kinematics.model
        self.reference = reference
        self._loops = System(kinematics, NoTarget(kinematics.model.nv))
        self.complete = TargetMotions(kinematics).complete  # see `TargetMotions.complete`

    def assemble(self, target: Target, guess: FloatArray | None, tolerance: float) -> Assembly:
        """Close the loops at a target."""
        start = self.reference if guess is None else guess
        system = System(self.kinematics, target)
        was_open = self.kinematics.at(start).gap > _OPEN
        path, kept = self._solve(system, start, tolerance)
        lost = guess is not None and was_open
        return self.found(path, lambda q: kept and (not lost or self.on_home(system, q)))

    @cached_property
    def _home(self) -> Path:
        """What closing the loops of the reference configuration leads to."""
        return self._close(self._loops, self.reference, TOLERANCE)[0]

    @cached_property
    def generic_rank(self) -> int | None:
        """The usual rank of the closures on the reference configuration's assembly.

        It is read off at configurations near the reference, after closing the loops, so that a reference
        configuration that happens to be singular does no harm. None if the loops cannot be closed from there.
        """
        if not self.kinematics.size:
            return 0
        ranks = Counter(svd.rank for _, svd in self._nearby(_STEP, 4))
        return ranks.most_common(1)[0][0] if ranks else None

    def regular(self, actuated_v: NDArray[np.intp]) -> FloatArray | None:
        """`ClosedLoopModel.regular_configuration`; None if the loops cannot be closed."""
        nearby = [*self._nearby(_STEP, 4)]

        def evidence(one: tuple[FloatArray, Decomposition]) -> tuple[bool, int, float]:
            """Whether closures have their usual rank, how many free motions motors see, how far both are."""
            svd, seen = one[1], actuation_of(one[1], actuated_v)
            far = svd.s[svd.rank - 1] / svd.s[0] if svd.rank else 0.0
            return svd.rank == self.generic_rank, seen.rank, float(far * seen.s[: seen.rank].min(initial=1.0))

        if not nearby or evidence(nearby[0])[:2] == max(map(evidence, nearby))[:2]:
            return nearby[0][0] if nearby else None
        nearby += [one for step in (2 * _STEP, 4 * _STEP, 8 * _STEP) for one in self._nearby(step, 8)]
        return max(nearby, key=evidence)[0]

    def _nearby(self, step: float, count: int) -> Iterator[tuple[FloatArray, Decomposition]]:
        """Yield the closed reference configuration, then closed ones near it, which are always the same."""
        if not self._home.complete:
            return
        home = self.kinematics.at(self._home.point.q)
        yield home.q, home.svd
        free, generator = home.svd.null_space, np.random.default_rng(0)
        for _ in range(count if free.size else 0):
            direction = free @ generator.normal(size=free.shape[1])
            near = pin.integrate(self.model, home.q, step * direction / np.linalg.norm(direction))
            path = least_squares(self._loops, near, TOLERANCE)
            if path.complete:
                yield path.point.q, self.kinematics.at(path.point.q).svd

    def _solve(self, system: System, start: FloatArray, tolerance: float) -> tuple[Path, bool]:
        """Follow the path from `start`, else fall back; the flag says whether the assembly was kept."""
        count = 0
        if system.target.size and self.kinematics.at(start).gap > _OPEN:
            closed, kept = self._close(self._loops, start, tolerance)
            count = closed.iterations
            if not closed.complete:
                raise self.failure(closed, system)
            path, kept_too = self._close(system, closed.point.q, tolerance)
            kept = (kept or start is self.reference) and kept_too
        else:
            path, kept = self._close(system, start, tolerance)
            kept = kept or (start is self.reference and not system.target.size)
        if not path.complete:
            raise self.failure(path, system)
        return Path(path.point, True, count + path.iterations), kept

    def _close(self, system: System, start: FloatArray, tolerance: float) -> tuple[Path, bool]:
        """Follow the path from `start`; fall back from where it ends, from `start`, and from around it."""
        path = follow(system, start, tolerance)
        if path.complete:
            return path, True
        best = least_squares(system, path.point.q, tolerance)
        count = path.iterations + best.iterations
        for solve, origin in self._attempts(system, start, path.moved):
            if best.complete:
                break
            other = solve(system, origin, tolerance)
            count += other.iterations
            best = min(best, other, key=lambda found: found.point.gap)
        moved = max_abs(pin.difference(self.model, path.point.q, best.point.q))
        return Path(best.point, best.complete, count), moved < _NEAR and path.point.same_branch(best.point)

    def _attempts(
        self, system: System, start: FloatArray, moved: bool
    ) -> Iterator[tuple[_Solve, FloatArray]]:
        """Return methods and where to start them, from near to far; random starts are always the same."""
        yield least_squares, start
        # A stretched chain is a saddle of the residual: Newton sees no way out of it, its neighbours do.
        shifts = np.random.default_rng(0).normal(scale=_SHAKE, size=(0 if moved else _SHAKES, self.model.nv))
        yield from ((least_squares, pin.integrate(self.model, start, shift)) for shift in shifts)
        yield levenberg_marquardt, start
        if not system.target.size:
            generator, limits = np.random.default_rng(0), Limits(self.model)
            for _ in range(RESTARTS):
                yield levenberg_marquardt, limits.random(self.model, start, generator)

    def found(self, path: Path, kept: Callable[[FloatArray], bool]) -> Assembly:
        """Return a result whose evidence is still to be found."""
        q = path.point.q
        q.setflags(write=False)
        closures = self.kinematics.at(q)

        def same() -> bool:
            return kept(q) and self.generic_rank in (evidence.rank, None)

        evidence = Evidence(same, closures)
        return Assembly(q, path.point.gap, path.iterations, evidence)

    def on_home(self, system: System, q: FloatArray, tolerance: float = TOLERANCE) -> bool:
        """Tell whether a path leads from the reference configuration's assembly to a configuration."""
        if not self._home.complete:
            return False
        home = self._home.point
        closures = self.kinematics.at(home.q)
        determined = Decomposition.of(system.at(q).J, closures.rank_tolerance).rank == self.model.nv
        if determined:
            path, kept = self._close(system, home.q, tolerance)
        else:
            free = Decomposition.of(home.J, closures.rank_tolerance).null_space
            chart = System(self.kinematics, ChartTarget(self.model, home.q, free, q))
            path, kept = follow(chart, home.q, tolerance), True
        near = max_abs(pin.difference(self.model, q, path.point.q)) < _SAME
        return path.complete and kept and near

    def failure(self, path: Path, system: System) -> AssemblyError:
        """Return the error that says what a path leaves open, and where."""
        k = self.kinematics
        gap, error = path.point.gap, path.point.r[: k.size]
        if not np.isfinite(gap):
            return AssemblyError("the loops do not close: the iteration left the numbers", gap)
        on_target = not k.size or max_abs(error) < gap
        where = "the target" if on_target else f"the {k.worst(error)}"
        goal = " at the target" if system.target.size else ""
        return AssemblyError(
            f"the loops do not close{goal}: the best configuration found leaves {gap:.3g} m or rad, "
            f"most at {where}",
            gap,
        )


def assemble_within_limits(
    assembler: Assembler, target: Target, guess: FloatArray | None, tolerance: float
) -> Assembly:
    """Close the loops at a target with all joints within their limits."""
    model = assembler.model
    found, limits = assembler.assemble(target, guess, tolerance), Limits(model)
    system, count = System(assembler.kinematics, target), found.iterations
    start, generator = assembler.reference if guess is None else guess, np.random.default_rng(0)
    if not limits.beyond(found.q):
        if not limits.turns(found.q, start):
            return found
        point = _unwound(system, limits, system.at(found.q), start)
        return assembler.found(Path(point, True, count), lambda q: assembler.on_home(system, q))
    far = (limits.random(model, start, generator) for _ in range(RESTARTS))
    best: Path | None = None
    for origin in (found.q, start, *far):
        path = levenberg_marquardt(system, origin, tolerance, limits)
        count += path.iterations
        best = path if best is None or path.point.gap < best.point.gap else best
        if best.complete:
            point = _unwound(system, limits, best.point, start)
            return assembler.found(Path(point, True, count), lambda q: assembler.on_home(system, q))
    gap = best.point.gap if best else np.inf
    raise AssemblyError(
        f"the loops close{' at the target' if target.size else ''} beyond the limits of joints only: "
        f"{limits.told(found.q)}; within them {gap:.3g} m or rad is left",
        gap,
    )


def _unwound(system: System, limits: Limits, point: Point, start: FloatArray) -> Point:
    """Take back whole turns of joints that lead away from the start, where nothing asks for them."""
    for at, shift in limits.turns(point.q, start):
        q = point.q.copy()
        q[at] += shift
        there = system.at(q)
        if there.gap <= max(TOLERANCE, point.gap):  # a target or a coupling may count turns
            point = there
    return point


def assembly_modes(
    assembler: Assembler, target: Target, starts: int, seed: int, within: bool
) -> tuple[Assembly, ...]:
    """Find all configurations that close the loops at a target; the one nearest to the reference first."""
    model = assembler.model
    system, generator, limits = (
        System(assembler.kinematics, target),
        np.random.default_rng(seed),
        Limits(model),
    )
    # Whole turns of a joint make no other mode, unless another joint follows it through gears.
    apart_of = pin.difference if assembler.kinematics.couplings.size else limits.apart
    found: list[tuple[float, Assembly]] = []
    best: Path | None = None
    for k in range(starts):
        origin = assembler.reference if k == 0 else limits.random(model, assembler.reference, generator)
        path = levenberg_marquardt(system, origin, TOLERANCE, limits if within else None)
        best = path if best is None or path.point.gap < best.point.gap else best
        apart = [np.linalg.norm(apart_of(model, one.q, path.point.q)) for _, one in found]
        if not path.complete or min(apart, default=np.inf) < _SAME:
            continue
        _check_determined(model, path.point)
        away = float(np.linalg.norm(apart_of(model, assembler.reference, path.point.q)))
        found.append((away, assembler.found(path, lambda q: assembler.on_home(system, q))))
    if not found and best is not None:
        raise assembler.failure(best, system)
    return tuple(one for _, one in sorted(found, key=lambda item: item[0]))


def _check_determined(model: pin.Model, point: Point) -> None:
    free = model.nv - Decomposition.of(point.J, point.rank_tolerance).rank
    if free:
        raise AssemblyError(
            f"the target leaves {free} free motions, so that there are no single configurations to count",
            point.gap,
        )
