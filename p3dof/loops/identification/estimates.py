"""Parameters from measured forces, with what the design knows: a Gaussian prior.

Forces are linear in the parameters φ: measured = A φ + noise. Short or slow motions show few combinations of
them; least squares alone fills the others with noise. With a prior, φ is normally distributed about the
design with standard deviations s; the most likely parameters given the forces then minimise (maximum a
posteriori)

    Σ |A φ - measured|² / σ² + |(φ - φ_design) / s|²

and combinations that the motions do not show stay at the design. Columns need not be scaled, nor base
parameters be chosen, and no tolerance decides a rank. The noise σ of each actuator, and how wide the prior
is, may be estimated from the same data: they maximise the probability of the forces (evidence). Bodies are
possible where their pseudo-inertias are positive semidefinite.

References
----------
C. M. Bishop, Pattern Recognition and Machine Learning, Springer 2006, sections 3.3 and 3.5.
P. J. Huber, E. M. Ronchetti, Robust Statistics, Wiley 2009, chapter 7.
P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
parameter identification, IEEE Robotics and Automation Letters 3(1), 2018.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, as_floats, frozen_array, positive, shown
from p3dof._base.errors import InputError
from p3dof.loops.identification.forces import IdentifiableForces, States, bodies_of, pseudo_inertia
from p3dof.loops.linear import RANK_TOLERANCE
from p3dof.loops.minimal import pivoted
from p3dof.loops.regressor import MOMENTS, combined, in_words

EstimationMethod: TypeAlias = Literal["map", "wls", "essential", "robust"]
METHODS = ("map", "wls", "essential", "robust")
_HUBER = 1.345  # residual beyond which a sample counts less, over the noise: 95 % efficient for normal noise
_OUTLIER = 1 / 3  # weight below which a force is told as an outlier
_NORMAL = 1.4826  # standard deviation of normal noise over its median of sizes
_ESSENTIAL = 0.3  # relative standard deviation above which a base parameter stays at the design
_STEPS, _SETTLED = 200, 1e-9
_WIDEST = np.log(100.0)  # of factors of estimated widths, both ways
_HYPER = np.log(10.0)  # standard deviation of the logarithm of such a factor before the data
_ROUNDS = 4
_GAP = 1e-10  # of consistent parameters, relative
_LITTLE = 0.01  # share of a combination's doubt below which a parameter is not named in it
_INSIDE = 1e-8  # least eigenvalue of a scaled pseudo-inertia
_NOT_NEGATIVE = ("damping", "friction", "armature", "load_friction")
_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class ParameterEstimate(Readable):
    """Parameters from measured forces.

    Parameters
    ----------
    names : tuple of str
        Of the P parameters.
    parameters : ndarray, shape (P,)
        The most likely ones.
    deviations : ndarray, shape (P,)
        Their standard deviations: where they are those of the prior, the forces told nothing.
    covariance : ndarray, shape (P, P)
        Of the parameters, before impossible bodies and negative friction are ruled out. With ``wls`` and
        ``essential`` of the combinations that were fitted, in their leading parameters alone.
    design, prior : ndarray, shape (P,)
        Parameters of the design, and their standard deviations, after `widths`.
    noise : ndarray, shape (m,)
        Standard deviation of the forces of each actuator [N or N m].
    residuals : ndarray, shape (N, m)
        What is left of the forces [N or N m]; much more than the noise tells of something else than
        parameters.
    widths : dict of str to float
        By what the standard deviations of the prior were multiplied, by group: ``bodies``, ``friction``, and
        ``joints`` for all else.
    combinations : tuple of (str, float, float)
        What the forces show, better than the prior knows it: combinations of parameters in words, their
        values, and their standard deviations; the surest first.
    method : str
        How it was found.
    remarks : tuple of str
        What to know about it.
    """

    names: tuple[str, ...]
    parameters: FloatArray
    deviations: FloatArray
    covariance: FloatArray
    design: FloatArray
    prior: FloatArray
    noise: FloatArray
    residuals: FloatArray
    widths: dict[str, float]
    combinations: tuple[tuple[str, float, float], ...]
    method: str
    remarks: tuple[str, ...] = ()

    @property
    def seen(self) -> FloatArray:
        """How much of each parameter's doubt the forces removed, (P,): from 0, nothing, to 1."""
        known = self.prior > 0
        found: FloatArray = np.zeros(len(self.prior))
        found[known] = 1 - np.minimum(self.deviations[known] / self.prior[known], 1.0)
        return found

    @property
    def residual(self) -> float:
        """Root mean square of the residuals [N or N m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def predicted(self, columns: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return forces (..., m) that the parameters predict, and their standard deviations without noise.

        Parameters
        ----------
        columns : array-like, shape (..., m, P)
            Derivatives of the forces by the parameters.
        """
        A = as_floats("columns", columns)
        if A.shape[-1:] != self.parameters.shape:
            raise InputError(f"columns: expected shape (..., {len(self.parameters)}), got {A.shape}")
        variance = np.einsum("...i,ij,...j->...", A, self.covariance, A)
        return A @ self.parameters, np.sqrt(np.maximum(variance, 0.0))


class _Problem(NamedTuple):
    """Measured forces in units of doubts: forces = design's + S z, z standard normal before the data."""

    S: FloatArray  # (N, m, F) of the F parameters that are not known
    r: FloatArray  # (N, m): measured less the design's
    groups: tuple[str, ...]  # (F,)


class _Posterior(NamedTuple):
    z: FloatArray  # (F,)
    covariance: FloatArray  # (F, F)
    information: FloatArray  # (F or less, F): rows of S over the noise, reduced


def estimate_parameters(
    columns: ArrayLike,
    measured: ArrayLike,
    design: ArrayLike,
    deviations: ArrayLike,
    noise: ArrayLike | None = None,
    *,
    method: EstimationMethod = "map",
    widths: Literal["given", "estimated"] = "given",
    names: Sequence[str] | None = None,
    consistent: bool = True,
    solver: Literal["clarabel", "barrier"] | None = None,
) -> ParameterEstimate:
    """Return the most likely parameters, given measured forces and a design.

    Parameters
    ----------
    columns : array-like, shape (N, m, P) or (N, P)
        Derivatives of the forces by the parameters, as `ForceRegressor.inertial`, `LoopRegressor.forces` and
        `LoopForces.rows`.
    measured : array-like, shape (N, m) or (N,)
        The forces, less what the parameters do not explain, such as known loads [N or N m].
    design, deviations : array-like, shape (P,)
        Parameters of the design, and their standard deviations; zero keeps a parameter as it is.
    noise : array-like, shape () or (m,), optional
        Standard deviation of a measured force of each actuator [N or N m]; estimated where it is not given.
    method : {"map", "wls", "essential", "robust"}
        Maximum a posteriori; weighted least squares in the base parameters of these data, which with weak
        excitation predicts worse than the design; likewise, without those that are uncertain by more than
        30 %, one after the other; or maximum a posteriori with Huber's weights, for forces with outliers.
    widths : {"given", "estimated"}
        Whether the standard deviations are multiplied by factors, one for bodies, friction and other data of
        joints each, that make the measured forces most probable. It wants well excited data.
    names : sequence of str, optional
        Of the parameters, ``body.m`` and so on: needed for `consistent` and for what is told.
    consistent : bool
        Whether bodies shall be possible (pseudo-inertias positive semidefinite), friction and rotors not
        negative. Bodies on this boundary, such as laminas, are given 1e-7 of their inertia as thickness.
    solver : {"clarabel", "barrier"}, optional
        What solves for consistent parameters where the most likely ones are not: a semidefinite program by
        Clarabel (extra ``identify``), by default where it is installed; or Newton's method with a barrier.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, a deviation is negative, or the noise not positive.
    """
    for what, value, choices in (("method", method, METHODS), ("widths", widths, ("given", "estimated"))):
        if value not in choices:
            raise InputError(f"{what}: expected one of {', '.join(choices)}, got {shown(value)}")
    A, b, phi, doubt = _checked(columns, measured, design, deviations)
    known = _named(names, len(phi))
    given = None if noise is None else _noise(noise, b.shape[1])
    free = np.flatnonzero(doubt)
    problem = _Problem(A[..., free] * doubt[free], b - A @ phi, tuple(_group(known[i]) for i in free))
    factors = dict.fromkeys(sorted(set(problem.groups)), 1.0)
    sigma, posterior = _most_likely(problem, given)
    if widths == "estimated" and len(free):
        own, doubt = problem, doubt.copy()
        for _ in range(_ROUNDS):  # noise and widths, one after the other
            factors, scale = _evident(own, sigma, factors)
            problem = own._replace(S=own.S * scale)
            sigma, posterior = _most_likely(problem, given)
        doubt[free] *= scale
    told = _combinations(posterior, known, phi, doubt, free)
    remarks = []
    if method == "robust":
        sigma, posterior, weights = _robust(problem, given)
        if few := int((weights < _OUTLIER).sum()):
            remarks.append(f"{few} of {weights.size} forces are outliers and count less than a third")
    elif method != "map":
        sigma, posterior = _least_squares(problem, given, phi[free] / doubt[free], method == "essential")
    found = phi.copy()
    found[free] += doubt[free] * posterior.z
    if consistent and names is not None and method in ("map", "robust"):
        found, left = _made_possible(found, posterior, known, (phi, doubt), free, solver)
        remarks += left
    covariance = np.zeros((len(phi), len(phi)))
    covariance[np.ix_(free, free)] = posterior.covariance * np.outer(doubt[free], doubt[free])
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if method in ("wls", "essential"):
        spread = np.where(spread > 0, spread, doubt)
    if not told:
        remarks.append("the forces show nothing that the prior does not know better: excite the robot more")
    combinations = tuple((words, float(row @ found), spread) for words, row, spread in told)
    return ParameterEstimate(
        known,
        found,
        spread,
        covariance,
        phi,
        doubt,
        sigma,
        b - A @ found,
        factors,
        combinations,
        method,
        tuple(remarks),
    )


def _named(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    known = tuple(names) if names is not None else tuple(f"parameter {i + 1}" for i in range(count))
    if len(known) != count:
        raise InputError(f"names: expected {count}, got {len(known)}")
    return known


def _noise(noise: ArrayLike, m: int) -> FloatArray:
    given = as_floats("noise", noise)
    if given.shape not in ((), (m,)):
        raise InputError(f"noise: expected shape () or ({m},), got {given.shape}")
    if not (np.isfinite(given) & (given > 0)).all():
        raise InputError("noise: expected positive numbers")
    return np.broadcast_to(given, m).copy()


def _checked(
    columns: ArrayLike, measured: ArrayLike, design: ArrayLike, deviations: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    A, b = as_floats("columns", columns), as_floats("measured", measured)
    if A.ndim not in (2, 3):
        raise InputError(f"columns: expected shape (N, m, P) or (N, P), got {A.shape}")
    if b.shape != A.shape[:-1]:
        raise InputError(f"measured: expected shape {A.shape[:-1]}, got {b.shape}")
    if A.ndim == 2:
        A, b = A[:, None], b[:, None]
    A, b = frozen_array("columns", A, A.shape), frozen_array("measured", b, b.shape)
    phi = frozen_array("design", design, A.shape[-1:])
    doubt = frozen_array("deviations", deviations, phi.shape)
    if (doubt < 0).any():
        raise InputError("deviations: expected zero or more")
    if not len(b):
        raise InputError("measured: expected at least one sample")
    return A, b, phi, doubt


def _group(name: str) -> str:
    kind = name.rpartition(".")[2]
    if kind in ("damping", "friction", "stribeck", "load_friction"):
        return "friction"
    return (
        "joints"
        if kind in ("armature", "stiffness", "preload", "counterbalance", "spring", "constant")
        else "bodies"
    )


def _reduced(problem: _Problem, weights: FloatArray | None = None) -> list[FloatArray]:
    """Return a triangle [S | r] for each actuator, which has all that its samples tell."""
    found = []
    for k in range(problem.r.shape[1]):
        block = np.column_stack([problem.S[:, k], problem.r[:, k]])
        if weights is not None:
            block *= np.sqrt(weights[:, k])[:, None]
        found.append(_triangle(block))
    return found


def _triangle(rows: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)


def _posterior(triangles: Sequence[FloatArray], sigma: FloatArray) -> _Posterior:
    """Return z given the noise: (TᵀT + 1) z = Tᵀ t, by the singular values of T."""
    stacked = _triangle(np.concatenate([R / s for R, s in zip(triangles, sigma, strict=True)]))
    T, t = stacked[:, :-1], stacked[:, -1]
    U, s, Vt = np.linalg.svd(T, full_matrices=False)
    z = Vt.T @ (s / (s**2 + 1) * (U.T @ t))
    covariance = np.eye(T.shape[1]) - (Vt.T * (s**2 / (s**2 + 1))) @ Vt
    return _Posterior(z, covariance, stacked)


def _most_likely(
    problem: _Problem, given: FloatArray | None, weights: FloatArray | None = None
) -> tuple[FloatArray, _Posterior]:
    """Return noise and posterior; noise not given maximises the evidence (Bishop, 3.5.2)."""
    triangles = _reduced(problem, weights)
    count = np.full(problem.r.shape[1], float(len(problem.r))) if weights is None else weights.sum(axis=0)
    if given is not None:
        return given, _posterior(triangles, given)
    least = 1e-12 * max(float(np.abs(problem.r).max(initial=0.0)), np.finfo(float).tiny)
    sigma = np.maximum(np.sqrt((problem.r**2).mean(axis=0)), least)
    grams = np.array([R.T @ R for R in triangles])  # only the noise comes from these
    for _ in range(_STEPS):
        whole = np.einsum("kij,k->ij", grams, sigma**-2.0)
        covariance = np.linalg.inv(np.eye(len(whole) - 1) + whole[:-1, :-1])
        z = np.append(covariance @ -whole[:-1, -1], 1.0)
        left = np.einsum("kij,i,j->k", grams, z, z)
        told = np.einsum("kij,ij->k", grams[:, :-1, :-1], covariance) / sigma**2
        better = np.maximum(np.sqrt(np.maximum(left, 0.0) / (count - told)), least)
        settled = np.abs(better / sigma - 1).max() <= 1e-6
        sigma = better
        if settled:
            break
    return sigma, _posterior(triangles, sigma)


def _evident(
    problem: _Problem, sigma: FloatArray, start: dict[str, float]
) -> tuple[dict[str, float], FloatArray]:
    """Return factors of the prior's widths that maximise the evidence, and these by parameter (F,)."""
    from scipy.optimize import minimize  # not at start-up

    T = _posterior(_reduced(problem), sigma).information
    names = tuple(start)
    which = np.array([names.index(group) for group in problem.groups])

    def cost(logs: FloatArray) -> float:
        _, s, Vt = np.linalg.svd(T[:, :-1] * np.exp(logs)[which], full_matrices=False)
        right = T[:, -1] @ (T[:, :-1] * np.exp(logs)[which]) @ Vt.T / np.maximum(s, np.finfo(float).tiny)
        gained = np.sum(s**2 / (1 + s**2) * right**2) - np.sum(np.log1p(s**2))
        return float(-gained / 2 + np.sum((logs / _HYPER) ** 2) / 2)

    bounds = [(-_WIDEST, _WIDEST)] * len(names)
    first = np.log([start[name] for name in names])
    found = minimize(cost, first, method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-3, "fatol": 1e-6})
    factors = np.exp(found.x)
    return dict(zip(names, factors.tolist(), strict=True)), factors[which]


def _robust(problem: _Problem, given: FloatArray | None) -> tuple[FloatArray, _Posterior, FloatArray]:
    """Return noise, posterior and Huber's weights (N, m)."""
    left = problem.r - np.median(problem.r, axis=0)
    weights = np.ones_like(left)
    sigma, posterior = _most_likely(problem, given)
    for _ in range(_STEPS):
        left = problem.r - problem.S @ posterior.z
        if given is None:
            sizes = _NORMAL * np.median(np.abs(left), axis=0)
            sigma = np.maximum(sizes, np.finfo(float).tiny)
        better = np.minimum(1.0, _HUBER / np.maximum(np.abs(left) / sigma, 1e-300))
        moved = np.abs(better - weights).max()
        weights = better
        posterior = _posterior(_reduced(problem, weights), sigma)
        if moved < 1e-6:
            break
    return sigma, posterior, weights


def _least_squares(
    problem: _Problem, given: FloatArray | None, design: FloatArray, essential: bool
) -> tuple[FloatArray, _Posterior]:
    """Return weighted least squares in leading parameters of what the data show."""
    triangles, (count, m) = _reduced(problem), problem.r.shape
    sigma, F = np.ones(m) if given is None else given, len(design)
    for _ in range(_STEPS):
        T = _triangle(np.concatenate([R / s for R, s in zip(triangles, sigma, strict=True)]))
        base, z, C = _leading(T, design, essential)
        whole, covariance = np.zeros(F), np.zeros((F, F))
        whole[base], covariance[np.ix_(base, base)] = z, C
        if given is not None:
            break
        left = np.array([np.sum((R[:, -1] - R[:, :-1] @ whole) ** 2) for R in triangles])
        better = np.maximum(np.sqrt(left / max(count - len(base) / m, 1.0)), np.finfo(float).tiny)
        settled = np.abs(better / sigma - 1).max() < 1e-6
        sigma = better
        if settled:
            break
    return sigma, _Posterior(whole, covariance, T)


def _leading(
    T: FloatArray, design: FloatArray, essential: bool
) -> tuple[NDArray[np.int_], FloatArray, FloatArray]:
    """Return which parameters are fitted, their changes, and the covariance of these."""
    base, matrix = _base(T[:, :-1])
    own = matrix @ design  # the combinations that they stand for
    while True:
        Q, R = np.linalg.qr(T[:, base])
        inverse = np.linalg.pinv(R)
        z, C = inverse @ (Q.T @ T[:, -1]), inverse @ inverse.T
        relative = np.sqrt(np.diag(C)) / np.maximum(np.abs(own + z), np.finfo(float).tiny)
        if not essential or not len(base) or relative.max() <= _ESSENTIAL:
            return base, z, C
        kept = np.arange(len(base)) != relative.argmax()
        base, own = base[kept], own[kept]


def _base(T: FloatArray) -> tuple[NDArray[np.int_], FloatArray]:
    """Return which columns are a base of all, and the combinations (rank, F) that they stand for."""
    size = np.linalg.norm(T, axis=0)
    kept = np.flatnonzero(size > RANK_TOLERANCE * size.max(initial=0.0))
    if not len(kept):
        return kept, np.zeros((0, T.shape[1]))
    _, s, Vt = np.linalg.svd(T[:, kept] / size[kept], full_matrices=False)
    rank = int(np.count_nonzero(s > RANK_TOLERANCE * s[0]))
    return combined(T, size, kept, pivoted(Vt[:rank].T, np.array([], dtype=int)))


def _combinations(
    posterior: _Posterior,
    names: tuple[str, ...],
    design: FloatArray,
    doubt: FloatArray,
    free: NDArray[np.int_],
) -> list[tuple[str, FloatArray, float]]:
    """Return what the forces show better than the prior: in words, as rows (P,), standard deviations."""
    _, s, Vt = np.linalg.svd(posterior.information[:, :-1], full_matrices=False)
    rank = int(np.count_nonzero(s > 1.0))
    if not rank:
        return []
    W = s[:rank, None] * Vt[:rank]
    size = np.linalg.norm(W, axis=0)
    kept = np.flatnonzero(size > RANK_TOLERANCE * size.max())
    columns, matrix = combined(W, size, kept, pivoted(Vt[:rank, kept].T, np.array([], dtype=int)))
    told = []
    for every, lead in zip(matrix, columns.tolist(), strict=True):
        row = np.where(np.abs(every) < _LITTLE, 0.0, every)  # value and deviation are those of the words
        spread = doubt[free[lead]] * np.sqrt(max(float(row @ posterior.covariance @ row), 0.0))
        whole = np.zeros(len(design))
        whole[free] = row * doubt[free[lead]] / doubt[free]
        told.append((in_words(whole, names, int(free[lead])), whole, float(spread)))
    sizes = [abs(float(whole @ design)) for _, whole, _ in told]
    shares = [
        one[2] / size if size > 1e-12 * one[2] else np.inf for one, size in zip(told, sizes, strict=True)
    ]
    return [told[k] for k in np.argsort(shares, kind="stable")]


# Possible bodies


_TEN: FloatArray = np.array([pseudo_inertia(unit) for unit in np.eye(10)])  # (10, 4, 4)
_THICK, _BALL = 1e-7, np.array([0.0, 0, 0, 0, 1, 0, 1, 0, 0, 1])


class _Constraints(NamedTuple):
    """Scaled pseudo-inertias `J0 + Σ G w` that must be positive semidefinite, and numbers `c + H w` >= 0."""

    J0: FloatArray  # (B, 4, 4)
    G: FloatArray  # (B, F, 4, 4)
    c: FloatArray  # (n,)
    H: FloatArray  # (n, F)

    def slack(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what must be positive semidefinite and not negative."""
        return self.J0 + np.einsum("bfij,f->bij", self.G, w), self.c + self.H @ w

    def hold(self, w: FloatArray) -> bool:
        """Whether they hold, with nothing to spare."""
        J, c = self.slack(w)
        return not (np.linalg.eigvalsh(J) < 0).any() and not (c < 0).any()


def _made_possible(
    found: FloatArray,
    posterior: _Posterior,
    names: tuple[str, ...],
    prior: tuple[FloatArray, FloatArray],
    free: NDArray[np.int_],
    solver: Literal["clarabel", "barrier"] | None,
) -> tuple[FloatArray, list[str]]:
    """Return the most likely parameters among possible ones, and remarks."""
    design, doubt = prior[0].copy(), prior[1]
    T = posterior.information
    _, s, Vt = np.linalg.svd(T[:, :-1], full_matrices=True)
    root = np.sqrt(1 + np.append(s, np.zeros(len(free) - len(s))) ** 2)
    back = Vt.T / root  # z = back w: the objective is |w|² / 2 - gᵀ w
    g = back.T @ (T[:, :-1].T @ T[:, -1])
    by_w = np.zeros((len(design), len(free)))
    by_w[free] = doubt[free, None] * back
    J0, G, remarks = [], [], []
    for first in bodies_of(names):
        at = slice(first, first + 10)
        if not doubt[at].any():
            continue
        for thick in (0.0, _THICK):  # a lamina or a rod: into what bodies have, by less than anybody measures
            design[at] += thick * pseudo_inertia(design[at]).diagonal()[:3].max() * _BALL
            J = pseudo_inertia(design[at])
            size = np.sqrt(np.maximum(np.diag(J), 1e-12 * max(float(np.trace(J)), np.finfo(float).tiny)))
            scale = np.outer(size, size)
            if np.linalg.eigvalsh(J / scale).min() >= _INSIDE:
                break
        else:
            remarks.append(f"{names[first][:-2]}: its design is no possible solid body; left so")
            continue
        J0.append(J / scale - _INSIDE / 2 * np.eye(4))
        G.append(np.einsum("tij,tf->fij", _TEN / scale, by_w[at]))
    signed = [i for i in free.tolist() if names[i].rpartition(".")[2] in _NOT_NEGATIVE]
    constraints = _Constraints(
        np.array(J0).reshape(-1, 4, 4),
        np.array(G).reshape(-1, len(free), 4, 4),
        design[signed] / doubt[signed],
        by_w[signed] / doubt[signed, None],
    )
    if constraints.hold(g):
        return found + design - prior[0], remarks
    if solver is None:
        from importlib.util import find_spec

        solver = "clarabel" if find_spec("clarabel") else "barrier"
    if solver == "clarabel":
        w = _by_clarabel(g, constraints)
    elif solver == "barrier":
        w = _by_barrier(g, constraints, root * (Vt @ np.isin(free, signed).astype(float)))
    else:
        raise InputError(f"solver: expected clarabel or barrier, got {shown(solver)}")
    better = design + by_w @ w
    better[signed] = np.maximum(better[signed], 0.0)
    return better, remarks


def _by_clarabel(g: FloatArray, constraints: _Constraints) -> FloatArray:
    """Minimise |w|² / 2 - gᵀ w under the constraints as a semidefinite program."""
    import clarabel
    from scipy import sparse

    rows, columns = np.array([(i, j) for j in range(4) for i in range(j + 1)]).T  # of the upper triangle
    weight = np.where(rows == columns, 1.0, np.sqrt(2.0))
    offset = np.concatenate([(constraints.J0[:, rows, columns] * weight).ravel(), constraints.c])
    G = (constraints.G[:, :, rows, columns] * weight).transpose(0, 2, 1).reshape(-1, len(g))
    cones = [clarabel.PSDTriangleConeT(4)] * len(constraints.J0)
    if len(constraints.c):
        cones.append(clarabel.NonnegativeConeT(len(constraints.c)))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _GAP
    one, A = sparse.csc_matrix(np.eye(len(g))), sparse.csc_matrix(-np.concatenate([G, constraints.H]))
    return np.array(clarabel.DefaultSolver(one, -g, A, offset, cones, settings).solve().x)


def _by_barrier(g: FloatArray, constraints: _Constraints, inside: FloatArray) -> FloatArray:
    """Minimise the same by Newton's method with a logarithmic barrier, from a point inside.

    S. Boyd, L. Vandenberghe, Convex Optimization, Cambridge 2004, chapter 11. After the last barrier the
    objective is less than its weight times the degree of the barrier from the least.
    """
    w, weight = inside, 1.0
    degree = 4 * len(constraints.J0) + len(constraints.c)

    def cost(w: FloatArray) -> float:
        J, c = constraints.slack(w)
        if (np.linalg.eigvalsh(J) <= 0).any() or (c <= 0).any():
            return np.inf
        barrier = np.linalg.slogdet(J)[1].sum() + np.log(c).sum()
        return float(w @ w / 2 - g @ w - weight * barrier)

    while weight * degree > _GAP * (1 + float(g @ g)):
        weight /= 10
        for _ in range(_STEPS):
            J, c = constraints.slack(w)
            turned = np.linalg.inv(J)[:, None] @ constraints.G  # (B, F, 4, 4)
            slope = (
                w
                - g
                - weight
                * (np.trace(turned, axis1=2, axis2=3).sum(axis=0) + (constraints.H.T / c).sum(axis=1))
            )
            pairs = (
                turned.transpose(1, 0, 2, 3).reshape(len(g), -1),
                turned.transpose(1, 0, 3, 2).reshape(len(g), -1),
            )
            scaled = constraints.H / c[:, None]
            step = -np.linalg.solve(
                np.eye(len(g)) + weight * (pairs[0] @ pairs[1].T + scaled.T @ scaled), slope
            )
            decrement = -float(slope @ step)
            if decrement < 1e-3 * weight:
                break
            size, here = 1.0, cost(w)
            while size > 1e-12 and not cost(w + size * step) <= here - 0.1 * size * decrement:
                size /= 2
            w = w + size * step
    return w


@dataclass(frozen=True, eq=False)
class PayloadEstimate(Readable):
    """A payload from forces with it and without it.

    Parameters
    ----------
    mass, mass_deviation : float
        [kg], and its standard deviation.
    com, com_deviations : ndarray, shape (3,)
        Mass centre in the axes of the joint that carries the body [m]; a deviation as large as the size that
        was supposed tells that the forces do not show it.
    inertia : ndarray, shape (3, 3)
        About the mass centre [kg m²].
    estimate : ParameterEstimate
        All of it: of ten inertial parameters about the origin of the joint.
    """

    mass: float
    mass_deviation: float
    com: FloatArray
    com_deviations: FloatArray
    inertia: FloatArray
    estimate: ParameterEstimate


def estimate_payload(
    forces: IdentifiableForces,
    states: States,
    difference: ArrayLike,
    body: str,
    *,
    heaviest: float | None = None,
    size: float = 0.2,
    noise: ArrayLike | None = None,
) -> PayloadEstimate:
    """Return what a body carries, from the forces of a motion with and without it.

    Parameters
    ----------
    forces : LoopForces or MachineForces
        Of the robot or machine.
    states : States
        Of the motion.
    difference : array-like, shape (N, m)
        Forces with the payload less those without, measured or those of an identified model, so that friction
        and errors of the model fall out [N or N m].
    body : str
        The body that carries it, as in the names of parameters: ``platform``.
    heaviest : float, optional
        Largest payload that is supposed [kg]; by default what the strongest actuator could lift.
    size : float
        How large it is supposed to be [m].
    noise : array-like, optional
        Standard deviation of the difference, as in `estimate_parameters`.

    Raises
    ------
    InputError
        If there is no such body, a number is not positive, or shapes do not fit.
    """
    names = [f"{body}.{moment}" for moment in MOMENTS]
    if names[0] not in forces.names:
        bodies = [forces.names[first].rpartition(".")[0] for first in bodies_of(forces.names)]
        raise InputError(f"body: expected one of {', '.join(bodies)}, got {shown(body)}")
    largest = float(forces.largest[0].max()) / _GRAVITY if heaviest is None else heaviest
    mass, length = positive("heaviest", largest, InputError), positive("size", size, InputError)
    first = forces.names.index(names[0])
    columns = forces.rows(states).columns[..., first : first + 10]
    ball = (
        0.1 * mass * length**2 * np.array([1.0, 0, 1, 0, 0, 1])
    )  # a tenth of the mass, all about `size` away
    design = np.concatenate([[0.1 * mass, 0, 0, 0], ball])
    doubts = mass * np.concatenate([[1.0], np.full(3, length), np.full(6, length**2)])
    found = estimate_parameters(columns, difference, design, doubts, noise, names=names)
    m, moments, six = found.parameters[0], found.parameters[1:4], found.parameters[4:]
    com = moments / m
    by = np.column_stack([-com / m, np.eye(3) / m])
    spread = np.sqrt(np.maximum(np.diag(by @ found.covariance[:4, :4] @ by.T), 0.0))
    xx, xy, yy, xz, yz, zz = six
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    inertia = about - m * (com @ com * np.eye(3) - np.outer(com, com))
    return PayloadEstimate(float(m), float(found.deviations[0]), com, spread, inertia, found)
