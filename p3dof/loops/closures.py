"""Positions, Jacobian and drift of the loop closures of one model: the only place that evaluates them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import chain, groupby, pairwise
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats, frozen_array, one_line
from p3dof._base.errors import InputError, ModelError, P3dofError
from p3dof._base.threads import Own
from p3dof.loops.closure_kinds import LENGTHS, PARTS, Ends, KindRows, OtherClosures
from p3dof.loops.coordinates import length_coordinates, single_joint
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition
from p3dof.loops.sidecar import MAX_COEFFICIENTS, Closure, Coupling, Sidecar, suggestion

IndexArray: TypeAlias = NDArray[np.int_]

_LARGEST_DENOMINATOR = 1000
"""Of the ratio of two continuous joints; a gear with more teeth could be turned by one unnoticed."""
_EXACT = 1e-12  # how near a ratio is to its fraction


class CouplingRows:
    """The couplings q_joint = p(q_on) + Σ f q_other of a model; leading axes, if any, count samples."""

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling]) -> None:
        self.size, self._nv = len(couplings), int(model.nv)
        joints = np.array([_ends(model, c) for c in couplings], dtype=int).reshape(-1, 2).T
        self._q, self._v = np.array(model.idx_qs)[joints], np.array(model.idx_vs)[joints]
        self.following = self._v[0]  # indices in v of the joints that follow
        circles = np.array(model.nqs)[joints] == 2
        circles[joints == 0] = False
        self._circles = [np.flatnonzero(end) for end in circles]
        self._on = np.flatnonzero(joints[1])
        coefficients = np.zeros((self.size, MAX_COEFFICIENTS))
        for row, coupling in enumerate(couplings):
            coefficients[row, : len(coupling.coefficients)] = coupling.coefficients
        powers = np.arange(MAX_COEFFICIENTS)
        first = np.roll(coefficients * powers, -1, axis=1)
        self._polynomials = np.stack((coefficients, first, np.roll(first * powers, -1, axis=1)))
        self._powers = powers
        self._others = _Others(model, couplings)
        each = zip(couplings, *circles, self._others.on_circles, strict=True)
        self.periods = np.array([_period(coupling, *known) for coupling, *known in each])
        """Up to multiples of what each holds; zero where it holds as it is."""
        self._wrapped = np.flatnonzero(self.periods)

    def errors(self, q: FloatArray) -> FloatArray:
        """Return q_joint - p(q_on) - Σ f q_other (..., size), to the nearest that continuous joints allow."""
        error = self._values(q, 0) - self._derivative(q, 0) - self._others.sums(q)
        period = self.periods[self._wrapped]
        error[..., self._wrapped] -= period * np.round(error[..., self._wrapped] / period)
        return error

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the Jacobian (..., size, nv)."""
        J, rows = np.zeros((*q.shape[:-1], self.size, self._nv)), np.arange(self.size)
        J[..., rows, self._v[0]] = 1.0
        J[..., self._on, self._v[1, self._on]] = -self._derivative(q, 1)[..., self._on]
        J[..., self._others.rows, self._others.v] = -self._others.factors
        return J

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return J̇ v (..., size)."""
        return np.asarray(-self._derivative(q, 2) * v[..., self._v[1]] ** 2)

    def _values(self, q: FloatArray, end: int) -> FloatArray:
        """Return the values of the joints at one end."""
        return _angles(q, self._q[end], self._circles[end])

    def _derivative(self, q: FloatArray, order: int) -> FloatArray:
        """Return p, p' or p'' of the joints at the other end."""
        powers = self._values(q, 1)[..., None] ** self._powers
        return np.asarray(np.sum(self._polynomials[order] * powers, axis=-1))


class _Others:
    """The linear terms of further joints, all couplings together."""

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling]) -> None:
        terms = [
            (row, single_joint(model, name, f"coupling {coupling.title}"), factor)
            for row, coupling in enumerate(couplings)
            for name, factor in coupling.others
        ]
        rows, joints, factors = zip(*terms, strict=True) if terms else ((), (), ())
        self.rows, self.factors = np.array(rows, dtype=int), np.array(factors)
        """Of each term, the coupling and the factor."""
        chosen = np.array(joints, dtype=int)
        self.v, self._q = np.array(model.idx_vs)[chosen], np.array(model.idx_qs)[chosen]
        """Of each term, where its joint is in v."""
        circles = np.array(model.nqs)[chosen] == 2
        self._circles = np.flatnonzero(circles)
        self.on_circles = [self.factors[circles & (self.rows == row)] for row in range(len(couplings))]
        """Of each coupling, the factors of continuous joints."""
        self._sums = np.zeros((len(terms), len(couplings)))
        self._sums[np.arange(len(terms)), self.rows] = self.factors

    def sums(self, q: FloatArray) -> FloatArray:
        """Return Σ f q_other (..., size)."""
        return np.asarray(_angles(q, self._q, self._circles) @ self._sums) if len(self.rows) else np.zeros(())


def _angles(q: FloatArray, indices: IndexArray, circles: IndexArray) -> FloatArray:
    """Return values of joints, for continuous ones their angles within half a turn."""
    values = q[..., indices]
    if len(circles):
        cosine = indices[circles]
        values[..., circles] = np.arctan2(q[..., cosine + 1], q[..., cosine])
    return values


def _ends(model: pin.Model, coupling: Coupling) -> tuple[int, int]:
    """Return the joint that follows, and the other one or 0."""
    what = f"coupling {coupling.title}"
    joint = single_joint(model, coupling.joint, what)
    return joint, 0 if coupling.on is None else single_joint(model, coupling.on, what)


def _period(coupling: Coupling, circle: bool, on_circle: bool, others: FloatArray) -> float:
    """Return up to multiples of what the coupling holds: what whole turns of continuous joints leave open."""
    ratio = coupling.coefficients[1] if len(coupling.coefficients) > 1 else 0.0
    help_ = "the turns of a continuous joint are not counted: make it revolute"
    if on_circle and any(coupling.coefficients[2:]):
        raise ModelError(f"coupling {coupling.title}: {coupling.on!r} enters in a higher power; {help_}")
    turns = [1.0 if circle else 0.0, ratio if on_circle else 0.0, *others.tolist()]
    factors = [abs(factor) for factor in turns if factor]
    if not factors:
        return 0.0
    shares = [Fraction(factor / factors[0]).limit_denominator(_LARGEST_DENOMINATOR) for factor in factors]
    for factor, share in zip(factors, shares, strict=True):
        if abs(float(share) * factors[0] - factor) > _EXACT * factor:
            ratio = factor / factors[0]
            raise ModelError(
                f"coupling {coupling.title}: the ratio {ratio:.12g} of two continuous joints is no fraction "
                f"with a denominator of at most {_LARGEST_DENOMINATOR}; {help_}"
            )
    common = math.lcm(*(share.denominator for share in shares))
    if common > _LARGEST_DENOMINATOR:
        raise ModelError(
            f"coupling {coupling.title}: the ratios of its continuous joints have the common denominator "
            f"{common}, expected at most {_LARGEST_DENOMINATOR}; {help_}"
        )
    divisor = math.gcd(*(int(share * common) for share in shares))
    return float(2.0 * np.pi * factors[0] * divisor / common)


TIGHT = 1e-11  # gap so small that rank tolerances do not depend on it [m or rad]


@dataclass(eq=False)
class ClosurePoint:
    """The closures at one configuration."""

    q: FloatArray  # (nq,): the configuration
    error: FloatArray
    """(rows,): how far each closure is open. `3d`: R1ᵀ(p2 - p1) [m]; `6d`: log6(M1⁻¹ M2) [m, rad]."""
    J: FloatArray
    """(rows, nv): the closures' Jacobian: velocity of frame 2 relative to frame 1, in the axes of frame 1."""

    @property
    def gap(self) -> float:
        """The largest entry of `error` [m or rad]; zero without closures."""
        return max_abs(self.error)

    @property
    def tight(self) -> bool:
        """Whether the gap is smaller than all that tolerances look at."""
        return bool(self.error.dot(self.error) <= TIGHT**2)

    @property
    def rank_tolerance(self) -> float:
        """Relative rank tolerance at this configuration.

        Rows that are redundant only where the loops are closed have singular values of the order of the gap
        elsewhere, so the tolerance grows with the gap. Without this, Gauss-Newton chases those rows and
        slides along the free motions, and a rank read off a slightly open configuration is too large.
        """
        return RANK_TOLERANCE if self.tight else max(RANK_TOLERANCE, min(1e-3, 100.0 * self.gap))

    @cached_property
    def svd(self) -> Decomposition:
        """Decomposition of `J`."""
        return Decomposition.of(self.J, self.rank_tolerance)


class _ErrorRows:
    """Where in the errors of a robot its closures are, and after them its couplings."""

    def __init__(self, sidecar: Sidecar) -> None:
        closures, couplings = sidecar.closures, sidecar.couplings
        self.names = [
            *(f"closure {closure.name}" for closure in closures),
            *(f"coupling {coupling.title}" for coupling in couplings),
        ]
        lengths = [*(LENGTHS[closure.kind] for closure in closures), *([False] for _ in couplings)]
        stops = np.cumsum([0, *map(len, lengths)]).tolist()
        self.rows = [slice(*ends) for ends in pairwise(stops)]  # by closure, then by coupling
        self.size: int = stops[-1]
        self.coupled = slice(self.size - len(couplings), self.size)  # rows of all couplings
        # What is measured as one: a distance, a rotation.
        parts = [[len(list(part)) for _, part in groupby(each)] for each in lengths]
        self._parts = np.cumsum([0, *chain.from_iterable(parts)])[:-1]
        self._first_parts = np.cumsum([0, *map(len, parts)])[:-1]

    def gaps(self, error: FloatArray) -> FloatArray:
        """Return how far each closure and coupling is open: the longer of distance and rotation vector."""
        if not self.size:
            return np.zeros((*error.shape[:-1], 0))
        sizes = np.sqrt(np.add.reduceat(error * error, self._parts, axis=-1))
        return np.asarray(np.maximum.reduceat(sizes, self._first_parts, axis=-1))

    def worst(self, error: FloatArray) -> str:
        """Return what is open the most: ``closure`` or ``coupling``, and its name."""
        sizes = [max_abs(error[rows]) for rows in self.rows]
        return self.names[int(np.argmax(sizes))]


class LoopKinematics(_ErrorRows):
    """The closures and couplings of a model; every thread has an `_Evaluation` of its own."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        super().__init__(sidecar)
        self.model, self.frames = model, _frames_by_name(model)
        self.closures, self.couplings = sidecar.closures, CouplingRows(model, sidecar.couplings)
        self.ends = [self._ends(closure) for closure in self.closures]
        """Joint and placement in its body of frame 1, then of frame 2, by closure."""
        own = [i for i, closure in enumerate(self.closures) if closure.kind in PARTS]
        self.own = np.array(own, dtype=int)  # which closures are no constraint models of Pinocchio
        self.anchors = [i for i in range(len(self.closures)) if i not in own]  # those that are
        self.plain = len(self.anchors) == len(self.rows)  # whether all are constraint models of Pinocchio
        self.constraint_models = pin.StdVec_ConstraintModel()
        for i in self.anchors:
            point = self.closures[i].kind == "3d"
            kind = pin.PointAnchorConstraintModel if point else pin.FrameAnchorConstraintModel
            self.constraint_models.append(pin.ConstraintModel(kind(model, *self.ends[i])))
        self.lengths = length_coordinates(model)[1]  # which of v are rates of lengths
        self._own = Own(lambda: _Evaluation(self))

    @cached_property
    def kinds(self) -> KindRows:
        """The rows of those closures."""
        return KindRows([self.closures[i] for i in self.own], [self.rows[i] for i in self.own])

    @property
    def data(self) -> pin.Data:
        """Joint placements and Jacobians of the last configuration that this thread gave to `at`."""
        return self._own.here.data

    def at(self, q: FloatArray) -> ClosurePoint:
        """Evaluate the closures; the last result is kept, so asking again costs nothing."""
        return self._own.here.at(q)

    def move(self, q: FloatArray, v: FloatArray, a: FloatArray | None = None) -> None:
        """Bring the velocities and accelerations of all bodies into `data`."""
        self._own.here.move(q, v, a)

    def acceleration(self) -> FloatArray:
        """Return d(J v)/dt (rows,) of the motion given to `move`, exact in open loops too; J̇ v without a."""
        return self._own.here.acceleration()

    def frame(self, name: str, what: str, error: type[P3dofError]) -> pin.Frame:
        """Return a frame of the model by name."""
        try:
            return self.model.frames[self.frames[name]]
        except (KeyError, TypeError) as problem:
            help_ = suggestion(str(name), self.frames)
            raise error(f"{what}: the frame {name!r} does not exist; {help_}") from problem

    def _ends(self, closure: Closure) -> Ends:
        frame1, frame2 = (
            self.frame(name, f"closure {one_line(closure.name)}", ModelError)
            for name in (closure.frame1, closure.frame2)
        )
        if frame1.parentJoint == frame2.parentJoint:
            raise ModelError(f"closure {one_line(closure.name)}: both frames are on the same body")
        placements = frame1.placement.copy(), frame2.placement.copy()
        return frame1.parentJoint, placements[0], frame2.parentJoint, placements[1]


class _Evaluation:
    """The closures at one configuration, for one thread: `data` has placements and Jacobians of the last."""

    def __init__(self, kinematics: LoopKinematics) -> None:
        k = self._k = kinematics
        self.model, self.plain = k.model, k.plain
        self.data = k.model.createData()
        closures, ends, rows = ([part[i] for i in k.own] for part in (k.closures, k.ends, k.rows))
        self._others = OtherClosures(k.model, closures, ends, rows) if closures else None
        self._anchored = np.array([r for i in k.anchors for r in range(k.size)[k.rows[i]]], int)
        self._constraint_datas = pin.StdVec_ConstraintData()
        for constraint in k.constraint_models:
            self._constraint_datas.append(constraint.createData())
        # Taken out once the vectors have their final place in memory: they are references, and so are the
        # arrays that `calc` writes to.
        self._pairs = list(zip(k.constraint_models, self._constraint_datas, strict=True))
        contents = [data.extract() for data in self._constraint_datas]
        self._errors = [content.constraint_position_error for content in contents]
        self._accelerations = [content.constraint_acceleration_error for content in contents]
        self._contents = contents  # own that memory
        self._zero = np.zeros(k.model.nv)
        self._last: ClosurePoint | None = None
        self._key = b""

    def at(self, q: FloatArray) -> ClosurePoint:
        """`LoopKinematics.at`."""
        key = q.tobytes()
        if self._last is not None and key == self._key:
            return self._last
        pin.computeJointJacobians(self.model, self.data, q)
        self._calculate()
        return self._evaluated(q, key)

    def _calculate(self) -> None:
        """Let the constraint models look at what `data` holds."""
        model, data = self.model, self.data
        for constraint, own in self._pairs:
            constraint.calc(model, data, own)
        if self._others is not None:
            self._others.calculate(data)

    def _evaluated(self, q: FloatArray, key: bytes) -> ClosurePoint:
        """Return the closures at the configuration that `data` and the constraint models hold."""
        if self._pairs:
            error, models = np.concatenate(self._errors), self._k.constraint_models
            J = pin.getConstraintsJacobian(self.model, self.data, models, self._constraint_datas)
        else:
            error, J = np.zeros(0), np.zeros((0, self.model.nv))
        if not self.plain:
            error, J = self._complete(q, error, J)
        self._key = key
        self._last = ClosurePoint(q.copy(), error, J)
        return self._last

    def _complete(
        self, q: FloatArray, errors: FloatArray, anchored: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the errors and the Jacobian of all rows, those of the constraint models being known."""
        k = self._k
        error, J = np.zeros(k.size), np.zeros((k.size, self.model.nv))
        if self._pairs:
            error[self._anchored], J[self._anchored] = errors, anchored
        if self._others is not None:
            self._others.evaluate(self.data, error, J)
        if k.couplings.size:
            error[k.coupled] = k.couplings.errors(q)
            J[k.coupled] = k.couplings.jacobian(q)
        return error, J

    def move(self, q: FloatArray, v: FloatArray, a: FloatArray | None) -> None:
        """`LoopKinematics.move`."""
        self._v, self._a = v, self._zero if a is None else a
        pin.forwardKinematics(self.model, self.data, q, v, self._a)
        key = q.tobytes()
        known = self._last is not None and key == self._key
        if not known:
            pin.computeJointJacobians(self.model, self.data)
        self._calculate()
        if not known:
            self._evaluated(q, key)

    def acceleration(self) -> FloatArray:
        """`LoopKinematics.acceleration`."""
        anchored: FloatArray = np.concatenate(self._accelerations) if self._accelerations else np.zeros(0)
        if self.plain:
            return anchored
        k = self._k
        result = np.zeros(k.size)
        if self._pairs:
            result[self._anchored] = anchored
        if self._others is not None:
            self._others.accelerate(result)
        if k.couplings.size and self._last is not None:
            J = self._last.J[k.coupled]
            result[k.coupled] = k.couplings.drift(self._last.q, self._v) + J @ self._a
        return result


def max_abs(values: FloatArray) -> float:
    """Return the largest absolute value, zero for an empty array."""
    return float(np.maximum.reduce(np.abs(values), None)) if values.size else 0.0


def _frames_by_name(model: pin.Model) -> dict[str, int]:
    """Frame index by name; links take precedence over joints of the same name."""
    indices: dict[str, int] = {}
    for index, frame in enumerate(model.frames):
        if frame.name not in indices or frame.type == pin.FrameType.BODY:
            indices[frame.name] = index
    return indices


_NONE, _PARTLY, _WHOLLY = 0, 1, 2


@dataclass(frozen=True, eq=False)
class ClosureWrench:
    """What closures exert on the bodies of their second frames; those of the first ones get the opposite."""

    places: FloatArray  # (n, 3): origins of the second frames, where the forces act [m]
    forces: FloatArray  # (n, 3): in world axes [N, N m]: what the multipliers that are known make up
    moments: FloatArray
    determined: NDArray[np.int_]
    """(n,): 2 where all multipliers of the closure are known, 1 where some are, 0 where none is."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether anything of a closure is known, (n,)."""
        return np.asarray(self.determined != _NONE)

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Whether all of a closure is known, (n,)."""
        return np.asarray(self.determined == _WHOLLY)


class ClosureWrenches:
    """Turns multipliers of a robot's closures into forces and moments in space."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self._kinematics = LoopKinematics(model, sidecar)
        self._data = Own(model.createData)

    def places(self, q: ArrayLike) -> tuple[list[pin.SE3], list[pin.SE3]]:
        """Return where the first and the second frames of the closures are, at joints (nq,)."""
        model, data = self._kinematics.model, self._data.here
        pin.forwardKinematics(model, data, frozen_array("q", q, (model.nq,)))
        ends = self._kinematics.ends
        return [data.oMi[a] * A for a, A, _, _ in ends], [data.oMi[b] * B for _, _, b, B in ends]

    def at(self, q: ArrayLike, multipliers: ArrayLike) -> ClosureWrench:
        """Return what the closures exert."""
        k = self._kinematics
        lambda_ = as_floats("multipliers", multipliers)
        if lambda_.shape != (k.size,):
            raise InputError(f"multipliers: expected shape ({k.size},), got {lambda_.shape}")
        first, second = self.places(q)
        wrenches, determined = np.zeros((len(first), 6)), np.full(len(first), _PARTLY)
        for i, rates in enumerate(self._rates(first, second)):
            own = lambda_[k.rows[i]]
            known = np.isfinite(own)
            wrench = rates[known].T @ own[known]
            wrenches[i] = (wrench.reshape(2, 3) @ first[i].rotation.T).reshape(6)
            if not known.any() or known.all():
                determined[i] = _WHOLLY if known.all() else _NONE
        places = np.array([end.translation for end in second]).reshape(-1, 3)
        return ClosureWrench(places, wrenches[:, :3], wrenches[:, 3:], determined)

    def _rates(self, first: list[pin.SE3], second: list[pin.SE3]) -> list[FloatArray]:
        """Return, by closure, the matrix (rows, 6) from the relative motion (ḋ, ω) to the errors' rates."""
        k = self._kinematics
        found = [np.eye(6)[: closure.rows] for closure in k.closures]  # of points and frames
        between = [first[i].actInv(second[i]) for i in k.own]
        turn = np.zeros((len(between), 3))
        for i in k.kinds.turning:
            turn[i] = pin.log3(between[i].rotation)
        d = np.array([place.translation for place in between]).reshape(-1, 3)
        axes = np.array([place.rotation for place in between]).reshape(-1, 3, 3)
        for group in k.kinds.at(d, axes, turn):
            for number, rates in zip(np.arange(len(between))[group.which], group.A, strict=True):
                found[k.own[number]] = rates
        return found
