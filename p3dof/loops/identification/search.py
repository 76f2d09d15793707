"""Search for excitation motions: sums of functions of time, what they tell of parameters, limits on the way.

A motion is Φ(t) X, X the coefficients. Rows of the regressor depend on one sample of the motion each, so that
gradients take differences by position, velocity and acceleration of the samples, 3 n of them, whatever the
number of coefficients is. Limits are constraints, their largest value over a period smoothed; sequential
quadratic programming (SciPy's SLSQP) from the best of some random motions, each as large as limits allow.

References
----------
J. Swevers, C. Ganseman, D. Tükel, J. De Schutter, H. Van Brussel, Optimal robot excitation and
identification, IEEE Transactions on Robotics and Automation 13(5), 1997 (Fourier series). F. Pukelsheim,
Optimal design of experiments, SIAM 2006 (D- and I-optimality). D. Kraft, DFVLR-FB 88-28, 1988 (SLSQP).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError, DynamicsError, OptimisationError, SampleError
from p3dof.loops.identification.forces import IdentifiableForces, Rows, States
from p3dof.loops.regressor import BaseParameters, base_of_rows

Criterion: TypeAlias = Literal["prediction", "D", "condition"]

RESERVE = 2e-3  # share of every limit that is kept between samples
_BEYOND = (AssemblyError, DynamicsError, SampleError, np.linalg.LinAlgError)
"""What the robot cannot be or do."""
_STEP = 1e-6  # of differences, as a share of the size of a coordinate
_FIRST = 0.3  # unit of the optimiser's variables, in sizes of the coordinates: its first steps are smaller
_SHARP = 100.0  # of the smooth largest value: above it by the logarithm of the samples, over this number
_FARTHEST, _TINIEST = (
    np.pi,
    1e-4,
)  # how far a coordinate goes from home at most, and what counts as not at all
_SETTLED_TO, _BETTER = 1e-5, 1e-3
"""Of the logarithm of the criterion: where the optimiser ends, and what beginning anew must gain."""


class Basis(NamedTuple):
    """The functions of time that motions are sums of: Fourier's, or quintic splines through waypoints."""

    period: float  # [s]
    harmonics: int
    waypoints: int | None  # of closed quintic splines, in place of the Fourier series

    @property
    def size(self) -> int:
        """How many functions."""
        return 2 * self.harmonics + 1 if self.waypoints is None else self.waypoints

    @property
    def samples(self) -> int:
        """How many samples a period the search takes: more than twice of what tells products of rates."""
        return 10 * self.harmonics + 2 if self.waypoints is None else 5 * self.waypoints

    @property
    def dense(self) -> int:
        """How many samples a period limits are checked with at last."""
        return 12 * self.samples

    def at(self, time: FloatArray) -> FloatArray:
        """Return the functions, their first and second derivatives (3, N, J) at times [s]."""
        if self.waypoints is not None:
            return self._splines(time)
        k = np.arange(1, self.harmonics + 1)
        w = 2 * np.pi * k / self.period
        angle = np.multiply.outer(time, w)
        c, s = np.cos(angle) / k, np.sin(angle) / k  # coefficients of all harmonics move about as fast
        one = np.ones((len(time), 1))
        value, rate = np.hstack([one, c, s]), np.hstack([0 * one, -w * s, w * c])
        return np.array([value, rate, np.hstack([0 * one, -w * w * c, -w * w * s])])

    def _splines(self, time: FloatArray) -> FloatArray:
        from scipy.interpolate import make_interp_spline

        count = self.size
        knots, values = np.linspace(0.0, self.period, count + 1), np.eye(count)[np.arange(count + 1) % count]
        spline, local = make_interp_spline(knots, values, 5, bc_type="periodic"), time % self.period
        return np.array([spline(local, order) for order in range(3)])

    def scaled(self, X: FloatArray, by: float) -> FloatArray:
        """Return a motion with other amplitudes about the same centre."""
        if self.waypoints is None:
            return np.vstack([X[:1], by * X[1:]])
        centre = X.mean(axis=0)
        return np.asarray(centre + by * (X - centre))

    def random(self, centre: FloatArray, size: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return a random motion about a centre, as large as the sizes (n,)."""
        X = size * generator.normal(size=(self.size, len(size)))
        if self.waypoints is None:
            X[0] = centre
            return X
        return np.asarray(centre + X - X.mean(axis=0))


class Evaluated(NamedTuple):
    """A motion at some samples."""

    states: States
    rows: Rows
    excess: FloatArray  # (N, K)

    @property
    def worst(self) -> float:
        """By how much the nearest limit is exceeded."""
        return float(self.excess.max())


def sampled(forces: IdentifiableForces, motion: FloatArray) -> Evaluated | None:
    """Return what a motion (3, N, n) takes; None if the robot cannot make it."""
    try:
        with np.errstate(all="ignore"):
            states = forces.from_coordinates(*motion)
            rows = forces.rows(states)
            excess = forces.excess(states, rows)
    except _BEYOND:
        return None
    if not (np.isfinite(excess).all() and np.isfinite(rows.columns).all()):
        return None
    return Evaluated(states, rows, excess)


def worst(forces: IdentifiableForces, motion: FloatArray) -> float:
    """Return by how much the nearest limit is exceeded; infinite if the robot cannot make the motion."""
    try:
        with np.errstate(all="ignore"):
            excess = float(forces.excess(forces.from_coordinates(*motion)).max())
    except _BEYOND:
        return np.inf
    return excess if np.isfinite(excess) else np.inf


def at_rest(values: FloatArray) -> FloatArray:
    """Return values of the coordinates (n,) as a motion (3, 1, n)."""
    return np.stack([values, 0 * values, 0 * values])[:, None]


def room(forces: IdentifiableForces) -> tuple[FloatArray, FloatArray]:
    """Return how far each coordinate alone may go from home at rest (n,), down and up."""
    found = np.zeros((2, len(forces.home)))
    for side, sign in enumerate((-1.0, 1.0)):
        for k in range(len(forces.home)):
            way = np.zeros(len(forces.home))
            way[k] = sign

            def fits(size: float, way: FloatArray = way) -> bool:
                return worst(forces, at_rest(forces.home + size * way)) <= 0

            found[side, k] = _largest(fits, _FARTHEST)
    return found[0], found[1]


def _largest(fits: Callable[[float], bool], most: float) -> float:
    """Return about the largest number that fits, by halving; zero if even a tiny one does not."""
    if fits(most):
        return most
    low, high = 0.0, most
    while high - low > 0.02 * high and high > _TINIEST * most:
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def amplitude(excess: Callable[[float], float], precision: float, start: float = 1.0) -> float:
    """Return about the largest factor on the amplitude that keeps limits; zero if there is none."""

    def fits(by: float) -> bool:
        return excess(by) <= -RESERVE

    low, high = 0.0, np.inf
    by = start
    while low == 0.0 or not np.isfinite(high):
        if fits(by):
            low, by = by, 1.5 * by
        else:
            high, by = by, by / 2
        if by < _TINIEST * start or by > start / _TINIEST:
            return low
    while high - low > precision * low:
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is to be identified: coordinates z of the identifiable combinations π = design + transform z.

    With a prior, z is of unit covariance before the experiment.
    """

    base: BaseParameters  # of the parameters that are not known
    free: NDArray[np.int_]  # which of the P parameters these are
    noise: FloatArray  # (m,): standard deviations of the measured forces
    transform: FloatArray  # (b, r)
    prior: FloatArray  # (r, r): information before the experiment

    @classmethod
    def of(
        cls,
        forces: IdentifiableForces,
        library: Callable[[], Evaluated],
        noise: FloatArray,
        deviations: FloatArray,
        prior: bool,
    ) -> Unknowns:
        """Return what random motions of a robot can show of all that is uncertain."""
        free = np.flatnonzero(deviations > 0)
        if not len(free):
            raise OptimisationError("excitation: no parameter is uncertain")
        blocks: list[FloatArray] = []

        def rows() -> FloatArray:
            columns = library().rows.columns[..., free] / noise[:, None]
            blocks.append(columns.reshape(-1, len(free)))
            return blocks[-1]

        base = base_of_rows(rows, tuple(forces.names[k] for k in free), forces.design[free])
        if not len(base):
            raise OptimisationError("excitation: no uncertain parameter changes a force of the actuators")
        if prior:
            R = np.linalg.qr((base.matrix * deviations[free]).T).R
            transform, before = R.T, np.eye(len(R))
        else:
            mean = np.concatenate(blocks)[:, base.columns]
            size = np.sqrt((mean**2).mean(axis=0))
            transform, before = np.diag(1 / size), np.zeros((len(base), len(base)))
        return cls(base, free, noise, transform, before)

    def columns(self, rows: Rows) -> FloatArray:
        """Return the derivatives (N, m, r) of forces over noise by z."""
        return np.asarray(
            rows.columns[..., self.free[self.base.columns]] / self.noise[:, None] @ self.transform
        )


def gram(columns: FloatArray) -> FloatArray:
    """Return the mean of products of columns (N, m, r) over the samples, (m, r, r)."""
    return np.asarray(np.einsum("nip,niq->ipq", columns, columns, optimize=True) / len(columns))


def measure(criterion: Criterion, H: FloatArray, over: FloatArray) -> tuple[float, FloatArray]:
    """Return the logarithm of a criterion, and its derivative by the information H (r, r), symmetric.

    `over` is the mean product of the columns of the forces to be predicted, (r, r).
    """
    if criterion == "condition":
        return _condition(H)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / np.sqrt(np.diag(H))
    if not np.isfinite(scale).all():
        raise np.linalg.LinAlgError("a parameter is not seen at all")
    lower = np.linalg.cholesky(scale[:, None] * H * scale)
    half = np.linalg.solve(lower, np.diag(scale))
    inverse = half.T @ half
    if criterion == "D":
        return -float(np.mean(np.log(np.diag(lower) / scale))), -inverse / (2 * len(H))
    variance = float(np.einsum("pq,pq->", over, inverse))
    return float(np.log(variance)) / 2, -inverse @ over @ inverse / (2 * variance)


def _condition(H: FloatArray) -> tuple[float, FloatArray]:
    """Return the same of the condition number of the regressor, its columns scaled to one."""
    with np.errstate(divide="ignore", invalid="ignore"):
        S = 1 / np.sqrt(np.diag(H))
    if not np.isfinite(S).all():
        raise np.linalg.LinAlgError("a parameter is not seen at all")
    values, vectors = np.linalg.eigh(S[:, None] * H * S)
    if values[0] <= np.finfo(float).eps * values[-1]:
        raise np.linalg.LinAlgError("parameters are not told apart")
    first, last = vectors[:, 0], vectors[:, -1]
    W = (np.outer(last, last) / values[-1] - np.outer(first, first) / values[0]) / 2
    by = S[:, None] * W * S
    return float(np.log(values[-1] / values[0])) / 2, by - np.diag(np.diag(by @ H) / np.diag(H))


class _Spent(Exception):  # noqa: N818 - never seen outside
    """As many motions were evaluated as were allowed."""


class Search:
    """The criterion and the limits of motions, with derivatives; counts the motions it evaluates."""

    def __init__(
        self,
        forces: IdentifiableForces,
        basis: Basis,
        criterion: Criterion,
        size: FloatArray,
        most: int,
        tell: Callable[[int], None],
    ) -> None:
        self.forces, self.basis, self.criterion, self.size = forces, basis, criterion, size
        self.scale = _FIRST * size
        self.unknowns: Unknowns
        self.over: FloatArray
        self.count = 0.0  # of measured samples
        self.motions = 0
        self._usual = 0.3  # factor that the last random motion had
        self._most, self._tell = most, tell
        self.units = np.concatenate([size, size, size])  # of differences
        rate = 2 * np.pi / basis.period
        self.units *= _STEP * np.repeat([1.0, rate, rate**2], len(size))
        self.refine(basis.samples)

    def refine(self, samples: int) -> None:
        """Take so many samples a period."""
        time = np.arange(samples, dtype=np.float64) * (self.basis.period / samples)
        self.functions = self.basis.at(time)

    @cached_property
    def _between(self) -> FloatArray:
        """The functions at so many times that limits are kept between them."""
        time = np.arange(self.basis.dense, dtype=np.float64) * (self.basis.period / self.basis.dense)
        return self.basis.at(time)

    def motion(self, X: FloatArray) -> FloatArray:
        """Return the samples (3, N, n) of a motion."""
        return np.asarray(self.functions @ X)

    def dense_motion(self, X: FloatArray) -> FloatArray:
        """Return many samples (3, N, n) of a motion."""
        return np.asarray(self._between @ X)

    def fitted(self, X: FloatArray, dense: bool = False) -> FloatArray | None:
        """Return a motion as large as limits allow; None if there is none of this shape."""
        motion = self.dense_motion if dense else self.motion
        found = amplitude(
            lambda by: worst(self.forces, motion(self.basis.scaled(X, by))),
            1e-3 if dense else 0.1,
            1.0 if dense else self._usual,
        )
        if found and not dense:
            self._usual = found
        return self.basis.scaled(X, found) if found else None

    def rated(self, motion: FloatArray) -> float:
        """Return the logarithm of the criterion of a motion (3, N, n); infinite if it has none."""
        one = sampled(self.forces, motion)
        try:
            return np.inf if one is None else self.value(one)[0]
        except np.linalg.LinAlgError:
            return np.inf

    def value(self, one: Evaluated) -> tuple[float, FloatArray, FloatArray]:
        """Return the logarithm of the criterion, its derivative by H, and the columns."""
        columns = self.unknowns.columns(one.rows)
        H = self.unknowns.prior + self.count * gram(columns).sum(axis=0)
        return *measure(self.criterion, H, self.over), columns

    def improve(self, X: FloatArray) -> FloatArray:
        """Return the motion that sequential quadratic programming makes of one; limits kept at samples."""
        from scipy.optimize import minimize

        at, x = _At(self), (X / self.scale).ravel()
        limits = {"type": "ineq", "fun": at.margins, "jac": at.margins_by}
        before = np.inf
        try:
            while True:  # where it goes out of reach it ends, and begins anew at the best point before
                minimize(
                    at.value, x, jac=at.value_by, constraints=[limits], method="SLSQP",
                    options={"maxiter": 10_000, "ftol": _SETTLED_TO},
                )  # fmt: skip
                if not at.lowest < before - _BETTER:
                    break
                before, x = at.lowest, at.best.ravel()
        except _Spent:
            pass
        return at.best * self.scale

    @property
    def spent(self) -> bool:
        """Whether as many motions were evaluated as are allowed."""
        return self.motions >= self._most

    def spend(self, motions: int) -> None:
        """Count motions; raises when there were enough."""
        self.motions += motions
        self._tell(self.motions)
        if self.spent:
            raise _Spent


class _At:
    """Criterion and limits at the point where the optimiser is; what it asks for together is done once."""

    def __init__(self, search: Search) -> None:
        self._search, self._key = search, b""
        self._by: tuple[FloatArray, FloatArray] | None = None
        self._one: Evaluated | None = None
        self.lowest, self.best = np.inf, np.zeros((0, 0))

    def _go(self, x: FloatArray) -> None:
        if x.tobytes() == self._key:
            return
        search, self._key = self._search, x.tobytes()
        X = x.reshape(search.basis.size, -1)
        if not self.best.size:
            self.best = X.copy()
        self._motion, self._by = search.motion(X * search.scale), None
        self._one = sampled(search.forces, self._motion)
        search.spend(1)
        self._value, self._margins = 1e3, np.full(len(search.forces.limits), -10.0)
        if self._one is None:
            return
        try:
            self._value, self._by_H, self._columns = search.value(self._one)
        except np.linalg.LinAlgError:
            self._one = None
            return
        peak = self._one.excess.max(axis=0)
        weights = np.exp(_SHARP * (self._one.excess - peak))
        self._margins = -(peak + np.log(weights.sum(axis=0)) / _SHARP + RESERVE)
        self._weights = weights / weights.sum(axis=0)
        if self._one.worst <= RESERVE and self._value < self.lowest:
            self.lowest, self.best = self._value, X.copy()

    def _derive(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradient of the criterion and the Jacobian of the margins."""
        self._go(x)
        if self._by is None:
            self._by = self._differences(x.size)
        return self._by

    def _differences(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the same by differences by the motion of every sample."""
        search, n, one = self._search, len(self._search.size), self._one
        K, samples = len(search.forces.limits), self._motion.shape[1]
        nothing = np.zeros(count), np.zeros((K, count))
        if one is None:
            return nothing
        steps = np.repeat(np.diag(search.units)[:, None], samples, axis=1)  # (3 n, N, 3 n)
        moved = np.moveaxis(steps.reshape(3 * n, samples, 3, n), 2, 0) + self._motion[:, None]
        there = sampled(search.forces, moved.reshape(3, -1, n))
        search.spend(3 * n)
        if there is None:
            return nothing
        each = (3 * n, samples)
        columns = search.unknowns.columns(there.rows).reshape(*each, *self._columns.shape[1:])
        change = (columns - self._columns) / search.units[:, None, None, None]
        by_columns = 2 * search.count / samples * self._columns @ self._by_H
        by_state = np.einsum("ksip,sip->ks", change, by_columns)
        excess = there.excess.reshape(*each, K) - one.excess
        limits = excess / search.units[:, None, None] * self._weights
        by_limits = -np.einsum("dksq,dsj->qjk", limits.reshape(3, n, samples, K), search.functions)
        by_value = np.einsum("dks,dsj->jk", by_state.reshape(3, n, samples), search.functions)
        size = np.broadcast_to(search.scale, by_value.shape).ravel()
        return by_value.ravel() * size, by_limits.reshape(K, -1) * size

    def value(self, x: FloatArray) -> float:
        """Return the logarithm of the criterion."""
        self._go(x)
        return self._value

    def value_by(self, x: FloatArray) -> FloatArray:
        """Return its gradient."""
        return self._derive(x)[0]

    def margins(self, x: FloatArray) -> FloatArray:
        """Return how far limits are, (K,): not negative within."""
        self._go(x)
        return self._margins

    def margins_by(self, x: FloatArray) -> FloatArray:
        """Return its Jacobian (K, J n)."""
        return self._derive(x)[1]
