"""Nonlinear least squares about a design, what it can tell, what is an outlier, and where to measure.

Measured numbers y have standard deviations σ, parameters p standard deviations s about the design, p = 0. The
most likely parameters minimise (maximum a posteriori)

    |(f(p) - y) / σ|² + |p / s|²

by Gauss-Newton steps, each of which is shortened until the sum falls. Without s, combinations of parameters
that no number depends on stay at the design.

References
----------
J. Nocedal, S. J. Wright, Numerical Optimization, Springer 2006, section 10.3 (Gauss-Newton).
W. Baarda, A testing procedure for use in geodetic networks, Delft 1968 (outliers: `outliers_of`).
V. V. Fedorov, Theory of Optimal Experiments, Academic Press 1972 (exchange: `chosen_poses`).
J.-H. Borm, C.-H. Menq, Determination of optimal measurement configurations for robot calibration based on
observability measure, International Journal of Robotics Research 10 (1991) 51-63 (`observability`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, positive, real, require, shown, suggestion, whole
from p3dof._base.errors import AssemblyError, InputError, OptimisationError
from p3dof.loops.coordinates import length_coordinates
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.sidecar import Closure

Rows: TypeAlias = tuple[FloatArray, FloatArray]
"""Numbers less what was measured (N,), and their derivatives by the parameters (N, P)."""

NONE = 1e-10  # share of the largest singular value below which one is zero
_STEPS = 60  # most steps
_SMALL = 1e-9  # length of a step, in deviations of the result, that is the last one: of rounding
_NEAR = 1e-3  # from where on steps that do not halve are of rounding, too
_EVEN = 1e-9  # by how much of itself the sum may grow by rounding
_HALVINGS = 20  # how often a step is shortened
_LEVEL = 0.05  # chance that one of all numbers is told as an outlier where none is
_MEDIAN = 0.6744897501960817  # of the absolute value of a standard normal number
_LITTLE = 1e-9  # gain of log det below which no exchange is made


@dataclass(frozen=True, eq=False)
class Combinations(Readable):
    """What measured numbers tell of parameters."""

    rank: int  # how many combinations of the parameters they tell
    condition: float  # largest over smallest singular value of these, columns scaled to one
    singular_values: FloatArray  # (P,): of the scaled columns
    unseen: tuple[str, ...]  # combinations that change no number, in words: these parameters grow together
    null_space: FloatArray  # (P - rank, P): the same as numbers


def combinations_of(rows: FloatArray, names: Sequence[str]) -> Combinations:
    """Return what numbers with derivatives (N, P) tell of P parameters."""
    sizes = np.linalg.norm(rows, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    _, values, directions = np.linalg.svd(rows / sizes, full_matrices=True)
    values = np.concatenate((values, np.zeros(rows.shape[1] - len(values))))
    rank = int((values > NONE * values.max(initial=0.0)).sum())
    null = reduced(directions[rank:] / sizes)
    condition = float(values[0] / values[rank - 1]) if rank else float("nan")
    return Combinations(rank, condition, values, tuple(in_words(row, names) for row in null), null)


def reduced(rows: FloatArray) -> FloatArray:
    """Return the same space in rows with a leading one, each alone in its column."""
    found = rows.copy()
    done = 0
    for column in range(found.shape[1]):
        if done == len(found):
            break
        best = done + int(np.abs(found[done:, column]).argmax())
        if abs(found[best, column]) <= 1e-6 * np.abs(found[done:]).max():
            continue
        found[[done, best]] = found[[best, done]]
        found[done] /= found[done, column]
        others = np.arange(len(found)) != done
        found[others] -= np.outer(found[others, column], found[done])
        done += 1
    return found


def in_words(row: FloatArray, names: Sequence[str]) -> str:
    """Return a combination of parameters in words."""
    told = ""
    for name, number in zip(names, row.tolist(), strict=True):
        if abs(number) < 1e-6:
            continue
        size = "" if abs(abs(number) - 1) < 1e-6 else f"{abs(number):.3g} "
        sign = ("-" if number < 0 else "") if not told else (" - " if number < 0 else " + ")
        told += f"{sign}{size}{name}"
    return told


@dataclass(frozen=True, eq=False)
class Fit:
    """The most likely parameters."""

    parameters: FloatArray  # (P,)
    covariance: FloatArray  # (P, P); infinite where nothing is known of a parameter
    residuals: FloatArray  # (N,): what is left, in standard deviations of the numbers
    rows: FloatArray  # (N, P): derivatives at the result, likewise
    tested: (
        FloatArray  # (N,): residuals over their own standard deviations; zero where nothing checks a number
    )
    steps: int  # how many it took

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of the parameters (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def noise(self) -> float:
        """Standard deviation of the measured numbers, over what was given: about 1 if all is as assumed."""
        used = self.rows.any(axis=1) | (self.residuals != 0)
        redundancy = float(np.sum(1.0 - leverage(self.rows[used], self.covariance)))
        return float(np.sqrt(self.residuals @ self.residuals / redundancy)) if redundancy > NONE else np.nan


def fit(evaluate: Callable[[FloatArray], Rows], sigma: FloatArray, tolerances: FloatArray) -> Fit:
    """Return the most likely parameters about a design, whose tolerances (P,) may be infinite.

    `evaluate` takes parameters (P,) and returns numbers less what was measured (N,), and their derivatives.
    """
    known = np.isfinite(tolerances)
    p: FloatArray = np.zeros(len(tolerances))
    steps, before = 0, np.inf
    error, rows = evaluate(p)
    while True:
        A, scale = _whitened(rows, sigma, tolerances, known)
        residuals = np.concatenate((error / sigma, (p / np.where(known, tolerances, 1.0))[known]))
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        seen = s > NONE * s.max(initial=0.0)
        down = U[:, seen].T @ residuals
        step = -scale * (Vt[seen].T @ (down / s[seen]))
        size = float(np.linalg.norm(down))
        if size <= _SMALL or _NEAR > size > before / 2 or steps == _STEPS:
            break
        before, steps = size, steps + 1
        p, error, rows = _shortened(evaluate, p, step, sigma, tolerances, float(residuals @ residuals))
    if size > _NEAR:
        raise OptimisationError(f"calibration: {_STEPS} steps of Gauss-Newton did not converge")
    covariance = _covariance(Vt, s, seen, scale)
    white = rows / sigma[:, None]
    return Fit(p, covariance, error / sigma, white, _tested(error / sigma, white, covariance), steps)


def _whitened(
    rows: FloatArray, sigma: FloatArray, tolerances: FloatArray, known: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the rows of numbers and of the design in units of their deviations, and the columns' scale."""
    white = rows / sigma[:, None]
    sizes = np.linalg.norm(white, axis=0)
    scale = np.where(known, tolerances, 1.0 / np.where(sizes > 0, sizes, 1.0))
    return np.concatenate((white * scale, np.eye(len(scale))[known])), scale


def _shortened(
    evaluate: Callable[[FloatArray], Rows],
    p: FloatArray,
    step: FloatArray,
    sigma: FloatArray,
    tolerances: FloatArray,
    cost: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parameters after a step, and what they give; the step is halved until the cost falls."""
    for halving in range(_HALVINGS):
        trial = p + 0.5**halving * step
        try:
            error, rows = evaluate(trial)
        except AssemblyError:
            if halving == _HALVINGS - 1:
                raise
            continue
        now = float(np.sum((error / sigma) ** 2) + np.sum((trial / tolerances) ** 2))
        if now <= cost * (1 + _EVEN):
            return trial, error, rows
    return p, *evaluate(p)


def _covariance(Vt: FloatArray, s: FloatArray, seen: NDArray[np.bool_], scale: FloatArray) -> FloatArray:
    half = scale[:, None] * (Vt[seen].T / s[seen])
    covariance = half @ half.T
    unknown = (np.abs(Vt[~seen]) > 1e-8).any(axis=0)
    covariance[unknown, unknown] = np.inf
    return np.asarray(covariance)


def leverage(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return which share of each number's deviation (N,) the parameters take up."""
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    return np.asarray(np.einsum("np,pq,nq->n", rows, finite, rows))


def _tested(residuals: FloatArray, rows: FloatArray, covariance: FloatArray) -> FloatArray:
    free = 1.0 - leverage(rows, covariance)
    checked = free > 1e-6
    return np.where(checked, residuals / np.sqrt(np.where(checked, free, 1.0)), 0.0)


def outliers_of(found: Fit, tolerances: FloatArray) -> list[int]:
    """Return which numbers do not fit to the others, the worst first.

    The largest residual over its own deviation is an outlier if chance brings it in one of twenty
    calibrations at most; it is taken out, the rest is solved again to first order, and so on. Where noise is
    larger than what was given, their median is the measure.
    """
    from scipy.stats import norm  # not at start-up

    residuals, rows = found.residuals.copy(), found.rows
    left, outliers = np.ones(len(residuals), dtype=bool), []
    precision = np.where(np.isfinite(tolerances), tolerances, np.inf) ** -2.0
    critical = float(norm.ppf(1 - _LEVEL / (2 * len(residuals))))
    offset = found.parameters
    while left.sum() > max(len(residuals) // 2, 1):
        A = np.concatenate((rows[left], np.diag(np.sqrt(precision))))
        b = np.concatenate((residuals[left], np.sqrt(precision) * offset))
        change = -np.linalg.lstsq(A, b, rcond=NONE)[0]
        covariance = np.linalg.pinv(A.T @ A, rcond=NONE**1.5, hermitian=True)
        tested = np.where(left, np.abs(_tested(residuals + rows @ change, rows, covariance)), 0.0)
        unit = max(1.0, float(np.median(tested[left])) / _MEDIAN)
        worst = int(tested.argmax())
        if tested[worst] <= critical * unit:
            break
        left[worst] = False
        outliers.append(worst)
    return outliers


@dataclass(frozen=True, eq=False)
class ChosenPoses:
    """Poses that were chosen of many."""

    poses: NDArray[np.int_]  # (K,): which, in rising order
    deviations: FloatArray  # (P,): of the parameters after they were measured; infinite where not told
    observability: float  # O1 of Borm and Menq
    exchanges: int  # how many improved the first choice


def chosen_poses(rows: FloatArray, tolerances: FloatArray, count: int) -> ChosenPoses:
    """Return the D-optimal poses, whose parameters' covariance is least, of rows (C, k, P) of derivatives.

    The first are taken one after the other, each of which adds most to log det of the information; then poses
    are exchanged for others as long as that grows. A row of zeros is no number; a tolerance may be infinite.
    """
    whole("count", count, 1)
    if count > len(rows):
        raise InputError(f"count: expected at most {len(rows)}, the number of candidates, got {count}")
    size = np.linalg.norm(rows.reshape(-1, rows.shape[2]), axis=0)
    scale = np.where(np.isfinite(tolerances), tolerances, 1.0 / np.where(size > 0, size, 1.0))
    scaled = rows * scale
    prior = np.isfinite(tolerances).astype(float)
    _, s, Vt = np.linalg.svd(np.concatenate((scaled.reshape(-1, len(scale)), np.diag(prior))))
    basis = Vt[: int((s > NONE * s[0]).sum())].T  # what all candidates together tell
    small = scaled @ basis
    start = basis.T @ (prior[:, None] * basis)
    if count * rows.shape[1] + int(prior.sum()) < basis.shape[1]:
        needed = int(np.ceil((basis.shape[1] - prior.sum()) / rows.shape[1]))
        raise InputError(
            f"count: expected {needed} poses or more for {basis.shape[1]} parameters, got {count}"
        )
    chosen = _first(small, start, count)
    exchanges = _exchange(small, start, chosen)
    poses = np.sort(np.array(chosen))
    information = start + np.einsum("nkp,nkq->pq", small[poses], small[poses])
    half = scale[:, None] * (basis @ np.linalg.inv(np.linalg.cholesky(information)).T)
    deviations = np.sqrt(np.sum(half**2, axis=1))
    told = np.linalg.norm(Vt[basis.shape[1] :], axis=0, ord=np.inf) if len(Vt) > basis.shape[1] else None
    if told is not None:
        deviations = np.where(told > 1e-8, np.inf, deviations)
    return ChosenPoses(poses, deviations, observability(rows[poses], tolerances), exchanges)


def observability(rows: FloatArray, tolerances: FloatArray | None = None) -> float:
    """Return O1 of K measured poses, (σ1 ... σr)^(1/r) / √K, of columns in units of the tolerances.

    σ are the singular values that are not zero. Where a tolerance is infinite, columns are scaled to one.
    """
    flat = rows.reshape(-1, rows.shape[-1])
    sizes = np.linalg.norm(flat, axis=0)
    scale = 1.0 / np.where(sizes > 0, sizes, 1.0)
    if tolerances is not None:
        scale = np.where(np.isfinite(tolerances), tolerances, scale)
    s = np.linalg.svd(flat * scale, compute_uv=False)
    s = s[s > NONE * s.max(initial=0.0)]
    return float(np.exp(np.log(s).mean()) / np.sqrt(len(rows))) if len(s) else 0.0


def _gains(small: FloatArray, information: FloatArray) -> FloatArray:
    """Return how much log det of the information grows (C,) with each candidate."""
    half = np.linalg.solve(np.linalg.cholesky(information), np.swapaxes(small, 1, 2))
    inner = np.eye(small.shape[1]) + np.swapaxes(half, 1, 2) @ half
    return np.asarray(np.linalg.slogdet(inner)[1])


def _first(small: FloatArray, start: FloatArray, count: int) -> list[int]:
    """Choose one candidate after the other; what is not known yet has a little weight."""
    P = start.shape[0]
    little = 1e-6 * np.trace(np.einsum("nkp,nkq->pq", small, small)) / (len(small) * P)
    information, chosen = start + little * np.eye(P), list[int]()
    for _ in range(count):
        gains = _gains(small, information)
        gains[chosen] = -np.inf
        best = int(gains.argmax())
        chosen.append(best)
        information = information + small[best].T @ small[best]
    return chosen


def _exchange(small: FloatArray, start: FloatArray, chosen: list[int]) -> int:
    """Exchange chosen candidates for others as long as that improves; return how often."""
    P, count, before = start.shape[0], 0, -1
    while count > before:
        before = count
        for position, old in enumerate(chosen):
            others = chosen[:position] + chosen[position + 1 :]
            information = start + np.einsum("nkp,nkq->pq", small[others], small[others])
            little = 1e-12 * np.trace(information) / P
            gains = _gains(small, information + little * np.eye(P))
            gains[others] = -np.inf
            best = int(gains.argmax())
            if gains[best] > gains[old] + _LITTLE:
                chosen[position] = best
                count += 1
    return count


DEVICE = "device"
"""What measures, if no frame of the robot is named: a frame fixed in the world, by default at its origin."""
_SHIFTS = {"x": pin.JointModelPX, "y": pin.JointModelPY, "z": pin.JointModelPZ}
_TURNS = {"yaw": pin.JointModelRZ, "pitch": pin.JointModelRY, "roll": pin.JointModelRX}
KINDS = (*_SHIFTS, "roll", "pitch", "yaw", "length")  # of a placement
OFFSET = "offset"  # of the encoder of an actuated joint: what it reads less where the joint is
_COINCIDENT = (
    1e-9  # distance from the joint before it below which a placement has no length [units of length]
)
_OPEN = 1e-6  # what a displacement may open the loops by, as a share of it


class Displacements(NamedTuple):
    """Parameters of the geometry of a robot: names, and what each of them displaces."""

    names: tuple[str, ...]  # P of them
    elements: tuple[str, ...]  # E displacements `what.kind`
    matrix: FloatArray  # (E, P): displacements = matrix @ parameters
    tolerances: FloatArray  # (P,): standard deviations about the design [m or rad]; infinite where unknown
    lengths: tuple[bool, ...]  # of P, which are lengths


def displacements(
    robot: LoopModel,
    tolerances: Mapping[str, float],
    combined: Mapping[str, Mapping[str, float] | Sequence[str]],
    frames: Iterable[str] = (),
) -> Displacements:
    """Return the parameters that names and patterns of names say; see `calibrate`."""
    require("tolerances", tolerances, Mapping)
    known = _elements(robot, frames)
    mixed = {str(name): _parts(str(name), parts, known) for name, parts in combined.items()}
    clash = next((name for name in mixed if name in known), None)
    if clash is not None:
        raise InputError(f"combined: {shown(clash)} is a displacement of the robot already")
    found: dict[str, float] = {}
    for pattern, value in tolerances.items():
        where = f"tolerances: {shown(pattern)}"
        amount = np.inf if value == np.inf else positive(where, value, InputError)
        some = [name for name in (*mixed, *known) if fnmatchcase(name, str(pattern))]
        some = [str(pattern)] if str(pattern) in (*mixed, *known) else some
        if not some:
            raise InputError(
                f"tolerances: there is no {shown(pattern)}; expected JOINT or FRAME with one of "
                f"{', '.join(KINDS)}, an actuated JOINT.{OFFSET}{_near(str(pattern), known)}"
            )
        found |= dict.fromkeys(some, amount)
    if not found:
        raise InputError("tolerances: expected one parameter or more")
    names = tuple(found)
    each = [mixed.get(name, {name: 1.0}) for name in names]
    elements = tuple(dict.fromkeys(element for parts in each for element in parts))
    matrix = np.array([[parts.get(element, 0.0) for parts in each] for element in elements])
    lengths = tuple(known[next(iter(parts))] for parts in each)
    return Displacements(names, elements, matrix, np.array([found[name] for name in names]), lengths)


def _near(name: str, known: Mapping[str, bool]) -> str:
    return f"; {suggestion(name, known)}" if len(known) < 5000 else ""


def _elements(robot: LoopModel, frames: Iterable[str]) -> dict[str, bool]:
    """Return all displacements that a robot has, and whether each is a length."""
    model = robot.model
    places = [str(name) for name in list(model.names)[1:]]
    places += [str(frame.name) for frame in model.frames if frame.type != pin.FrameType.JOINT]
    found = {
        f"{place}.{kind}": kind in _SHIFTS or kind == "length"
        for place in dict.fromkeys((*places, *frames))
        if place != "universe"
        for kind in KINDS
    }
    slides = length_coordinates(model)[1]
    for name in robot.actuated:
        found[f"{name}.{OFFSET}"] = bool(slides[model.idx_vs[model.getJointId(name)]])
    for closure in robot.sidecar.closures:
        if closure.length is not None:
            found[f"{closure.name}.length"] = True
    return found


def _parts(
    name: str, parts: Mapping[str, float] | Sequence[str], known: Mapping[str, bool]
) -> dict[str, float]:
    """Return the displacements that a parameter moves together, with their factors."""
    if isinstance(parts, str) or not isinstance(parts, Mapping | Sequence) or not len(parts):
        raise InputError(f"combined: {name}: expected names of displacements, or a mapping to their factors")
    given = parts if isinstance(parts, Mapping) else dict.fromkeys(parts, 1.0)
    found: dict[str, float] = {}
    for pattern, factor in given.items():
        some = (
            [str(pattern)] if pattern in known else [one for one in known if fnmatchcase(one, str(pattern))]
        )
        if not some:
            raise InputError(
                f"combined: {name}: there is no displacement {shown(pattern)}{_near(str(pattern), known)}"
            )
        found |= dict.fromkeys(some, real(f"combined: {name}: {pattern}", factor))
    if len({known[one] for one in found}) > 1 and len(set(found.values())) == 1:
        raise InputError(f"combined: {name}: expected lengths or angles, got both with the same factor")
    return found


class DisplacedRobot:
    """A robot whose placements may be displaced."""

    def __init__(self, robot: LoopModel, elements: Sequence[str], frames: Iterable[str]) -> None:
        self.robot, self.elements = robot, tuple(elements)
        rods = {f"{closure.name}.length" for closure in robot.sidecar.closures if closure.length is not None}
        self._rods = [(e, name) for e, name in enumerate(elements) if name in rods]
        self._offsets = [
            (e, robot.actuated.index(name.rpartition(".")[0]))
            for e, name in enumerate(elements)
            if name.rpartition(".")[2] == OFFSET
        ]
        other = {e for e, _ in (*self._rods, *self._offsets)}
        self._moved = [e for e in range(len(elements)) if e not in other]
        base = robot.model
        missing = [name for name in dict.fromkeys(frames) if not base.existFrame(name)]
        names = [self.elements[e] for e in self._moved]
        model = _Extension(base, names, missing).model
        sidecar = replace(
            robot.sidecar, actuated=(*robot.actuated, *names), joint_data=(), bushings=(), joints=()
        )
        self.extended = ClosedLoopModel(model, sidecar)
        self._sized: tuple[bytes, ClosedLoopModel] = (b"", self.extended)

    def with_lengths(self, values: FloatArray) -> ClosedLoopModel:
        """Return the extended robot, whose massless rods have the displaced lengths."""
        change = np.array([values[e] for e, _ in self._rods])
        if not change.any():
            return self.extended
        if self._sized[0] != change.tobytes():
            more = dict(zip((name for _, name in self._rods), change.tolist(), strict=True))
            sidecar = replace(self.extended.sidecar, closures=_resized(self.robot, more))
            self._sized = change.tobytes(), ClosedLoopModel(self.extended.model, sidecar)
        return self._sized[1]

    def targets(self, readings: FloatArray, values: FloatArray) -> FloatArray:
        """Return the values of the actuated joints and of those that stand still, (K, ...)."""
        positions = readings.copy()
        for e, column in self._offsets:
            positions[:, column] -= values[e]
        still = np.broadcast_to(values[self._moved], (len(readings), len(self._moved)))
        return np.concatenate((positions, still), axis=1)

    def influence(self, robot: ClosedLoopModel, q: FloatArray, parameters: Displacements) -> FloatArray:
        """Return how the joints move with the parameters, readings held: (nv, P)."""
        model = self.extended.model
        J = robot.closure_jacobian(q)
        A = np.concatenate((J, np.eye(model.nv)[robot.actuated_v]))
        b: FloatArray = np.zeros((len(A), len(self.elements)))
        for column, e in enumerate(self._moved, len(self.robot.actuated)):
            b[len(J) + column, e] = 1.0
        for e, column in self._offsets:
            b[len(J) + column, e] = -1.0
        rows = dict(zip((c.name for c in robot.sidecar.closures), robot.constraint_rows, strict=False))
        for e, name in self._rods:
            b[rows[name.rpartition(".")[0]], e] = 1.0
        b = b @ parameters.matrix
        found = np.linalg.lstsq(A, b, rcond=RANK_TOLERANCE)[0]
        left = np.abs(A @ found - b).max(axis=0, initial=0.0)
        if left.max(initial=0.0) > _OPEN:
            name = parameters.names[int(left.argmax())]
            raise InputError(
                f"tolerances: the loops cannot close with another {name}: they are overconstrained; "
                "combine it with what has to change with it, or leave it out"
            )
        return np.asarray(found)

    def idle(self, robot: ClosedLoopModel, q: FloatArray) -> FloatArray:
        """Return the motions of the joints that the motors leave free, as columns (nv, k)."""
        A = np.concatenate((robot.closure_jacobian(q), np.eye(robot.model.nv)[robot.actuated_v]))
        return Decomposition.of(A).null_space

    def corrected(self, values: FloatArray) -> ClosedLoopModel:
        """Return the robot itself with these displacements; its joints are what encoders read."""
        model = self.robot.model.copy()
        by = dict(zip(self.elements, values.tolist(), strict=True))
        joints = set(list(model.names)[1:])
        for place in dict.fromkeys(self.elements[e].rpartition(".")[0] for e in self._moved):
            if place in joints:
                j = model.getJointId(place)
                model.jointPlacements[j] = _displaced(model.jointPlacements[j], place, by)
            elif model.existFrame(place):
                for frame in model.frames:
                    if frame.name == place and frame.type != pin.FrameType.JOINT:
                        frame.placement = _displaced(frame.placement, place, by)
        for e, column in self._offsets:
            j = model.getJointId(self.robot.actuated[column])
            zero, one = pin.neutral(model), np.zeros(model.nv)
            one[model.idx_vs[j]] = -values[e]
            data = model.createData()
            pin.forwardKinematics(model, data, pin.integrate(model, zero, one))
            moved = data.joints[j].M
            pin.forwardKinematics(model, data, zero)
            model.jointPlacements[j] = model.jointPlacements[j] * moved * data.joints[j].M.inverse()
        more = {name: float(values[e]) for e, name in self._rods}
        return ClosedLoopModel(model, replace(self.robot.sidecar, closures=_resized(self.robot, more)))


def _resized(robot: LoopModel, more: Mapping[str, float]) -> tuple[Closure, ...]:
    """Return the closures, massless rods being longer."""
    closures = robot.sidecar.closures
    return tuple(
        closure if closure.length is None
        else replace(closure, length=closure.length + more.get(f"{closure.name}.length", 0.0))
        for closure in closures
    )  # fmt: skip


def _displaced(placement: pin.SE3, place: str, by: Mapping[str, float]) -> pin.SE3:
    value = {kind: by.get(f"{place}.{kind}", 0.0) for kind in KINDS}
    shift = np.array([value[kind] for kind in _SHIFTS])
    if value["length"]:
        shift = shift + value["length"] * _direction(placement, place)
    turn = pin.rpy.rpyToMatrix(value["roll"], value["pitch"], value["yaw"])
    return pin.SE3(turn @ placement.rotation, placement.translation + shift)


def _direction(placement: pin.SE3, place: str) -> FloatArray:
    """Return the direction from the joint before to a placement, in the axes of that joint."""
    distance = float(np.linalg.norm(placement.translation))
    if distance <= _COINCIDENT:
        raise InputError(
            f"tolerances: {place}.length: it is at the origin of the joint before it, so that it has no "
            "length: displace it along x, y or z"
        )
    return np.asarray(placement.translation / distance)


class _Extension:
    """A tree with a joint for each displacement; its joints are depth first, as those of `base`."""

    def __init__(self, base: pin.Model, elements: Sequence[str], devices: Sequence[str]) -> None:
        self._base, self.model = base, pin.Model()
        self.model.name, self.model.gravity = base.name, base.gravity
        self._kinds: dict[str, list[str]] = {}
        for element in elements:
            place, _, kind = element.rpartition(".")
            self._kinds.setdefault(place, []).append(kind)
        self._joints = set(list(base.names)[1:])
        self._hung: dict[str, int] = {}
        for device in devices:
            on, at = self._hang(0, pin.SE3.Identity(), device)
            self.model.addFrame(pin.Frame(device, on, 0, at, pin.FrameType.OP_FRAME))
        self._grow(0, 0)

    def _hang(self, parent: int, placement: pin.SE3, place: str) -> tuple[int, pin.SE3]:
        """Add the joints of a place; return what it hangs on, and where."""
        wanted, turned = self._kinds.get(place, []), pin.SE3(placement.rotation, np.zeros(3))
        if not wanted:
            return parent, placement
        if place in self._hung:  # a link and the fixed joint that holds it may have one name
            return self._hung[place], turned
        at = pin.SE3(np.eye(3), placement.translation)
        for kind in (*_SHIFTS, "length", *_TURNS):
            if kind in wanted:
                joint = self._joint(kind, placement, place)
                parent, at = self.model.addJoint(parent, joint, at, f"{place}.{kind}"), pin.SE3.Identity()
                self.model.addJointFrame(parent)
        self._hung[place] = parent
        return parent, turned

    @staticmethod
    def _joint(kind: str, placement: pin.SE3, place: str) -> Any:
        if kind == "length":
            return pin.JointModelPrismaticUnaligned(_direction(placement, place))
        return {**_SHIFTS, **_TURNS}[kind]()

    def _grow(self, old: int, new: int) -> None:
        """Add the frames of a body, and the joints that hang on it."""
        base, model = self._base, self.model
        for frame in list(base.frames)[1:]:
            if frame.parentJoint == old and frame.type != pin.FrameType.JOINT:
                name = str(frame.name)
                free = name not in self._joints
                on, at = self._hang(new, frame.placement, name) if free else (new, frame.placement)
                model.addFrame(pin.Frame(name, on, 0, at, frame.type))
        for child in range(1, base.njoints):
            if base.parents[child] != old:
                continue
            name, joint = str(base.names[child]), base.joints[child]
            on, at = self._hang(new, base.jointPlacements[child], name)
            v, q = slice(joint.idx_v, joint.idx_v + joint.nv), slice(joint.idx_q, joint.idx_q + joint.nq)
            limits = [base.effortLimit[v], base.velocityLimit[v]]
            limits += [base.lowerPositionLimit[q], base.upperPositionLimit[q]]
            added = model.addJoint(on, joint, at, name, *limits)
            model.addJointFrame(added)
            model.appendBodyToJoint(added, base.inertias[child], pin.SE3.Identity())
            self._grow(child, added)
