"""Excitation motions: what a robot should do so that measured forces identify its parameters.

Periodic motions within all limits, optimised for what the parameters are identified for. What an experiment
will tell is known before it: with the regressor A of N samples, noise σ of each actuator and, if wanted, the
prior covariance S of the design, the covariance of the estimate is (Aᵀ A / σ² + S⁻¹)⁻¹, and forces that are
predicted with it have the variances diag(Aₜ C Aₜᵀ) of their regressor Aₜ.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, Watch, frozen_array, meant, positive, shown, whole
from p3dof._base.errors import InputError, OptimisationError
from p3dof._base.files import suffix_of, write_table
from p3dof._base.tables import ShownInNotebook, Table, html_of, notebook_html, number, percent, table_of
from p3dof.loops.identification.forces import IdentifiableForces, States
from p3dof.loops.identification.search import (
    Basis,
    Criterion,
    Evaluated,
    Search,
    Unknowns,
    at_rest,
    gram,
    room,
    sampled,
)

MOTIONS = 1000
"""Motions that the search evaluates at most."""
_RANDOM = 12  # random motions: starts of the search, and what the workspace is represented by
_STARTS = 4  # of these, the best so many are improved
_DRAWS = 400  # random shapes tried for them at most
_LONGEST_RAMP = 16  # periods


def _unwatched(_name: str, _total: int) -> AbstractContextManager[None]:
    return nullcontext()


class SampledMotion(NamedTuple):
    """A whole experiment: from rest at home, into the periodic motion, and back to rest."""

    time: FloatArray  # (N,) [s]
    values: FloatArray  # (N, n) of the coordinates [m or rad]; their derivatives likewise
    rates: FloatArray
    accelerations: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(FrozenArrays, ShownInNotebook):
    """An excitation motion, and what an experiment with it will tell; see `optimise_excitation`.

    The motion begins and ends at rest at `home`. In between, after a ramp, are whole periods: these are to be
    used for identification.

    Parameters
    ----------
    coordinates, coordinate_units : tuple of str
        What moves, n of them: the actuators of a robot; y, z and theta of the machine.
    actuators, force_units : tuple of str
        Whose forces are measured, m of them.
    period : float
        Of the motion [s].
    harmonics : int
        Of the Fourier series.
    waypoints : int or None
        Of the closed quintic spline, in place of the Fourier series.
    coefficients : (J, n) array
        Of the Fourier series: centre, then those of cos(2πkt/T)/k, then those of sin(2πkt/T)/k; or the
        waypoints, from t = 0, evenly spaced in time [m or rad].
    home : (n,) array
        Where the experiment begins and ends.
    ramp : float
        Duration of the ramp from rest, and of that to rest [s].
    periods : int
        Whole periods between the ramps.
    rate : float
        Samples of the measurement a second [Hz].
    noise : (m,) array
        Standard deviation of one measured force of each actuator [N or N m].
    criterion : str
        What was optimised.
    prior : bool
        Whether the estimate uses the prior of the design.
    names : tuple of str
        Of the b identifiable combinations of parameters: the base parameters of all that are uncertain.
    values : (b,) array
        Theirs in the design.
    deviations : (b,) array
        Standard deviations of the estimates that the experiment will give.
    parameter_names : tuple of str
        Of the single parameters that are uncertain.
    parameter_prior : (p,) array
        Standard deviations about the design, before the experiment.
    parameter_deviations : (p,) array
        After it, with the prior; without, infinite for parameters that the forces show in combinations only.
    workspace_error : (m,) array
        Expected root mean square error of forces predicted for random motions within the limits, of each
        actuator [N or N m].
    task_error : (m,) array or None
        The same for the task motion.
    condition : float
        Condition number of the regressor of the combinations, columns scaled to one.
    utilisation : (K,) array
        Largest utilisation of each limit over the experiment: 1 is the limit.
    limits : tuple of str
        Their names.
    motions : int
        How many motions the search evaluated.
    """

    coordinates: tuple[str, ...]
    coordinate_units: tuple[str, ...]
    actuators: tuple[str, ...]
    force_units: tuple[str, ...]
    period: float
    harmonics: int
    waypoints: int | None
    coefficients: FloatArray
    home: FloatArray
    ramp: float
    periods: int
    rate: float
    noise: FloatArray
    criterion: str
    prior: bool
    names: tuple[str, ...]
    values: FloatArray
    deviations: FloatArray
    parameter_names: tuple[str, ...]
    parameter_prior: FloatArray
    parameter_deviations: FloatArray
    workspace_error: FloatArray
    task_error: FloatArray | None
    condition: float
    utilisation: FloatArray
    limits: tuple[str, ...]
    motions: int
    _expected: _Expected

    def __repr__(self) -> str:
        shape = f"{self.harmonics} harmonics" if self.waypoints is None else f"{self.waypoints} waypoints"
        return (
            f"Excitation({', '.join(self.coordinates)}; {self.period:g} s, {shape}, {self.criterion}: "
            f"{len(self.names)} combinations of {len(self.parameter_names)} parameters)"
        )

    @property
    def duration(self) -> float:
        """Of the whole experiment [s]."""
        return 2 * self.ramp + self.measured

    @property
    def measured(self) -> float:
        """Duration of the whole periods between the ramps [s]."""
        return self.periods * self.period

    @property
    def nearest_limit(self) -> str:
        """The limit with the largest utilisation."""
        return self.limits[int(np.argmax(self.utilisation))]

    def at(self, time: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return values, rates and accelerations (N, n) of the coordinates at times of the experiment.

        Parameters
        ----------
        time : array-like, shape (N,)
            From 0 to `duration` [s]; before and after it, the robot is at rest at `home`.
        """
        t = frozen_array("time", time, ("N",))
        steady = Basis(self.period, self.harmonics, self.waypoints).at(t - self.ramp) @ self.coefficients
        return _from_rest(t, steady, self.home, self.ramp, self.duration)

    def steady(self, time: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the same of the periodic motion alone.

        Parameters
        ----------
        time : array-like, shape (N,)
            Since the end of the ramp [s].
        """
        basis = Basis(self.period, self.harmonics, self.waypoints)
        values, rates, accelerations = basis.at(frozen_array("time", time, ("N",))) @ self.coefficients
        return values, rates, accelerations

    def sampled(self, rate: float | None = None) -> SampledMotion:
        """Return the whole experiment, sampled.

        Parameters
        ----------
        rate : float, optional
            Samples a second [Hz]; that of the measurement without it.

        Raises
        ------
        InputError
            If the rate is not above twice the frequency of the highest harmonic.
        """
        often = self.rate if rate is None else _rate(rate, self.period, self.harmonics, self.waypoints)
        time = np.arange(int(np.floor(self.duration * often * (1 + 1e-12))) + 1) / often
        return SampledMotion(time, *self.at(time))

    def to_csv(
        self, path: str | os.PathLike[str], rate: float | None = None, derivatives: bool = False
    ) -> Path:
        """Write the whole experiment as a motion file.

        Parameters
        ----------
        path : path-like
            The CSV file; replaced whole or not at all. Columns: ``t`` and the coordinates, in SI units.
        rate : float, optional
            As of `sampled`.
        derivatives : bool
            Whether velocities and accelerations follow, ``ydot`` and ``yddot`` for ``y``: motion files of the
            machine may have them.

        Raises
        ------
        InputError
            If the name does not end in ``.csv``, or the rate is too low.
        FileError
            If the file cannot be written.
        """
        suffix_of(path, "table")
        motion = self.sampled(rate)
        orders = ("", "dot", "ddot") if derivatives else ("",)
        header = ["t", *(f"{name}{order}" for order in orders for name in self.coordinates)]
        columns = [column for part in motion[1 : 1 + len(orders)] for column in part.T]
        return write_table(Path(path), header, (motion.time, *columns))

    def predicted_error(self, measured: float, over: str | None = None) -> FloatArray:
        """Return the expected errors of predicted forces after an experiment of another duration.

        Parameters
        ----------
        measured : float
            Duration of the measurement, without ramps [s].
        over : {"task", "workspace"}, optional
            Of which motions; the task, if there was one, without it.

        Returns
        -------
        ndarray, shape (m,)
            Root mean square of each actuator [N or N m].

        Raises
        ------
        InputError
            If an argument does not fit.
        """
        count = positive("measured", measured, InputError) * self.rate
        return self.noise * self._expected.errors(count, self._over(over))

    def duration_for(self, accuracy: ArrayLike, over: str | None = None) -> float:
        """Return how long must be measured until the expected error of predicted forces is small enough.

        Parameters
        ----------
        accuracy : float or array-like, shape (m,)
            Wanted root mean square of the errors, of every actuator [N or N m].
        over : {"task", "workspace"}, optional
            As of `predicted_error`.

        Returns
        -------
        float
            Whole periods, without ramps [s].

        Raises
        ------
        InputError
            If an argument does not fit.
        """
        wanted = np.asarray(accuracy, dtype=float)
        if wanted.shape not in ((), self.noise.shape) or not (np.isfinite(wanted) & (wanted > 0)).all():
            raise InputError(
                f"accuracy: expected a positive number or {len(self.noise)} of them, got {shown(accuracy)}"
            )
        kind = self._over(over)

        def enough(periods: int) -> bool:
            error = self.predicted_error(periods * self.period, kind)
            return bool((error <= wanted * (1 + 1e-12)).all())

        high = 1
        while not enough(high):
            high *= 2
            if high * self.period > _FOREVER:
                raise InputError(f"accuracy: it takes more than {_FOREVER:g} s of measurement")
        low = high // 2
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        return high * self.period

    def _over(self, over: str | None) -> str:
        kind = over or ("workspace" if self.task_error is None else "task")
        if kind not in ("task", "workspace") or (kind == "task" and self.task_error is None):
            known = "'workspace'" if self.task_error is None else "'task' or 'workspace'"
            raise InputError(f"over: expected {known}, got {shown(over)}")
        return kind


_FOREVER = 1e7  # [s]


class _Expected(NamedTuple):
    """What an experiment of any length tells: by eigenvectors of the information of a sample."""

    prior: bool
    values: FloatArray  # (r,): information of a measured sample along its eigenvectors
    shares: dict[str, FloatArray]  # (m, r): mean squares of predicted forces over noise along these

    @classmethod
    def of(cls, unknowns: Unknowns, columns: FloatArray, over: dict[str, FloatArray]) -> _Expected:
        # By singular values of the columns: half of the digits would be lost in their products.
        rows = columns.reshape(-1, columns.shape[-1]) / np.sqrt(len(columns))
        _, s, Vt = np.linalg.svd(rows, full_matrices=len(rows) < rows.shape[1])
        values = np.append(s, np.zeros(len(Vt) - len(s))) ** 2
        shares = {name: ((one @ Vt.T) ** 2).mean(axis=0) for name, one in over.items()}
        return cls(bool(unknowns.prior.any()), values, shares)

    def variances(self, count: float) -> FloatArray:
        """Return the variances (r,) along the eigenvectors after some samples."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / (self.prior + count * self.values))

    def errors(self, count: float, over: str) -> FloatArray:
        """Return the expected errors (m,) of predicted forces over noise."""
        return np.asarray(np.sqrt(self.shares[over] @ self.variances(count)))


def optimise_excitation(
    forces: IdentifiableForces,
    *,
    duration: float = 2.0,
    harmonics: int = 5,
    waypoints: int | None = None,
    criterion: Criterion = "prediction",
    task: States | None = None,
    prior: bool = False,
    deviations: ArrayLike | None = None,
    noise: ArrayLike = 1.0,
    rate: float = 1000.0,
    periods: int = 5,
    ramp: float | None = None,
    seed: int = 0,
    motions: int = MOTIONS,
    watch: Watch = _unwatched,
) -> Excitation:
    """Return the periodic motion within all limits whose measured forces identify a robot best.

    Parameters
    ----------
    forces : LoopForces or MachineForces
        The robot: its forces, parameters and limits.
    duration : float
        Of one period [s].
    harmonics : int
        Of the Fourier series of every coordinate.
    waypoints : int, optional
        Of closed quintic splines, at least 6, in place of the Fourier series.
    criterion : {"prediction", "D", "condition"}
        What becomes small: the mean variance of predicted forces over the task or, without one, over random
        motions in the workspace (I-optimality); the volume of the confidence ellipsoid of the parameters
        (D-optimality); the condition number of the regressor.
    task : States, optional
        The motion whose forces are to be predicted, as `forces.from_actuators` returns.
    prior : bool
        Whether the estimate uses the prior of the design, `deviations`. Without it, all combinations that the
        forces can show are estimated from these alone.
    deviations : array-like, shape (P,), optional
        Standard deviations of the parameters about the design; zero for what is known. Those of
        `forces.deviations()` without it.
    noise : float or array-like, shape (m,)
        Standard deviation of one measured force [N or N m].
    rate : float
        Samples a second [Hz].
    periods : int
        How many are measured.
    ramp : float, optional
        Duration of the ramps from and to rest [s]; without it one period, or as many as limits need.
    seed : int
        Of the random motions that the search starts from.
    motions : int
        How many motions the search evaluates at most.
    watch : callable, optional
        What shows the progress.

    Raises
    ------
    InputError
        If an argument does not fit.
    OptimisationError
        If no motion is within the limits.
    """
    basis = _basis(duration, harmonics, waypoints)
    often = _rate(rate, basis.period, basis.harmonics, basis.waypoints)
    if criterion not in get_args(Criterion):
        known = get_args(Criterion)
        raise InputError(
            f"criterion: expected {', '.join(known)}, got {shown(criterion)}{meant(criterion, known)}"
        )
    sigma = _noise(noise, len(forces.actuators))
    given = forces.deviations() if deviations is None else deviations
    doubts = frozen_array("deviations", given, (len(forces.names),))
    if (doubts < 0).any():
        raise InputError("deviations: expected zero or more")
    if ramp is not None:
        positive("ramp", ramp, InputError)
    seed, periods, most = whole("seed", seed, 0), whole("periods", periods, 1), whole("motions", motions, 1)
    with watch("excitation", most) as progress:

        def tell(done: int) -> None:
            if progress is not None:
                progress(min(done, most), most)

        size, centre = _reach(forces)
        search = Search(forces, basis, criterion, size, most, tell)
        search.count = periods * basis.period * often
        shapes = _Random(search, centre, np.random.default_rng(seed))
        search.unknowns = unknowns = Unknowns.of(forces, shapes, sigma, doubts, prior)
        speeds = sum(limit.startswith("speed of ") for limit in forces.limits)
        finer = 2 if speeds > len(forces.actuators) else 1  # joints that others move are fast for a moment
        search.refine(finer * max(basis.samples, -(-2 * len(unknowns.base) // len(sigma))))
        while len(shapes.found) < _RANDOM:
            shapes()
        over = {"workspace": np.concatenate([unknowns.columns(one.rows) for _, one in shapes.found])}
        if task is not None:
            over["task"] = unknowns.columns(forces.rows(task))
        wanted = gram(over.get("task", over["workspace"]))
        search.over = wanted.mean(axis=0)
        best = _best(search, shapes)
    steady = sampled(forces, search.dense_motion(best))
    if steady is None:  # what is within all limits was evaluated before
        raise OptimisationError("excitation: the best motion that was found cannot be evaluated")
    columns = unknowns.columns(steady.rows)
    expected = _Expected.of(unknowns, columns, over)
    ramp, utilisation = _ramped(forces, basis, best, ramp, steady)
    own, single = _deviations(unknowns, columns, search.count, doubts[unknowns.free], prior)
    rows = columns.reshape(-1, columns.shape[-1])
    return Excitation(
        coordinates=forces.coordinates,
        coordinate_units=forces.coordinate_units,
        actuators=forces.actuators,
        force_units=forces.force_units,
        period=basis.period,
        harmonics=basis.harmonics,
        waypoints=basis.waypoints,
        coefficients=_held(best),
        home=_held(forces.home),
        ramp=ramp,
        periods=periods,
        rate=often,
        noise=sigma,
        criterion=criterion,
        prior=prior,
        names=unknowns.base.names,
        values=_held(unknowns.base.values),
        deviations=_held(own),
        parameter_names=unknowns.base.parameter_names,
        parameter_prior=_held(doubts[unknowns.free]),
        parameter_deviations=_held(single),
        workspace_error=_held(sigma * expected.errors(search.count, "workspace")),
        task_error=None if task is None else _held(sigma * expected.errors(search.count, "task")),
        condition=float(np.linalg.cond(rows / np.linalg.norm(rows, axis=0))),
        utilisation=_held(utilisation),
        limits=forces.limits,
        motions=search.motions,
        _expected=expected,
    )


class _Random:
    """Random motions of a search, each as large as limits allow, with their samples."""

    def __init__(self, search: Search, centre: FloatArray, generator: np.random.Generator) -> None:
        self._search, self._centre, self._generator = search, centre, generator
        self.found: list[tuple[FloatArray, Evaluated]] = []
        self._drawn = 0

    def __call__(self) -> Evaluated:
        search = self._search
        while self._drawn < _DRAWS + 2 * len(self.found):
            self._drawn += 1
            shape = search.basis.random(self._centre, search.size, self._generator)
            X = search.fitted(shape)
            one = None if X is None else sampled(search.forces, search.motion(X))
            if X is not None and one is not None:
                self.found.append((X, one))
                return one
        raise OptimisationError(
            f"excitation: no motion within the limits was found in {self._drawn} random ones of "
            f"{search.basis.period:g} s (a longer duration makes it slower)"
        )


def _best(search: Search, shapes: _Random) -> FloatArray:
    """Return the best motion that is found from the best random ones, within the limits between samples."""
    starts = sorted(
        ((search.rated(search.motion(X)), k, X) for k, (X, _) in enumerate(shapes.found)),
        key=lambda one: one[:2],
    )
    if not np.isfinite(starts[0][0]):
        raise OptimisationError("excitation: motions with so few harmonics do not tell the parameters apart")
    found = []
    for k, (_, _, X) in enumerate(starts[:_STARTS]):
        for one in (search.improve(X), X):  # an improved one may have to become smaller between samples
            better = search.fitted(one, dense=True)
            if better is not None:
                found.append((search.rated(search.dense_motion(better)), k, better))
        if search.spent:
            break
    if not found:
        raise OptimisationError("excitation: between samples, no motion that was found is within the limits")
    return min(found, key=lambda one: one[:2])[2]


def _reach(forces: IdentifiableForces) -> tuple[FloatArray, FloatArray]:
    """Return the size of the coordinates' ranges (n,), and where motions are centred."""
    start = sampled(forces, at_rest(forces.home))
    if start is None or start.worst > 0:
        told = "it cannot be there"
        if start is not None:
            k = int(np.argmax(start.excess.max(axis=0)))
            told = f"{forces.limits[k]} exceeds its limit by {percent(float(start.excess.max()))}"
        raise OptimisationError(f"excitation: at home, at rest, {told}")
    down, up = room(forces)
    size = (down + up) / 2
    if not size.max(initial=0.0) > 0:
        raise OptimisationError("excitation: no coordinate can move from home within the limits")
    middle = forces.home + (up - down) / 2
    there = sampled(forces, at_rest(middle))
    centre = middle if there is not None and there.worst < start.worst else forces.home
    return np.where(size > 0, size, 1e-3 * size.max()), centre


def _from_rest(
    time: FloatArray, steady: FloatArray, home: FloatArray, ramp: float, duration: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a motion (3, N, n) that leaves home smoothly in a ramp, and comes back in another one."""
    from_end = time > duration / 2
    u = np.clip(np.where(from_end, duration - time, time) / ramp, 0.0, 1.0)[:, None]
    back = np.where(from_end, -1.0, 1.0)[:, None]
    share = u**4 * (35 - u * (84 - u * (70 - 20 * u)))  # with three continuous derivatives
    rate = back * 140 * u**3 * (1 - u) ** 3 / ramp
    change = 420 * u**2 * (1 - u) ** 2 * (1 - 2 * u) / ramp**2
    away, v, a = steady[0] - home, steady[1], steady[2]
    return home + share * away, share * v + rate * away, share * a + 2 * rate * v + change * away


def _ramped(
    forces: IdentifiableForces, basis: Basis, X: FloatArray, ramp: float | None, steady: Evaluated
) -> tuple[float, FloatArray]:
    """Return the duration of the ramps, and the utilisation of the limits over the whole experiment."""
    reached = steady.excess.max(axis=0)
    tried = ramp or basis.period
    while True:
        time = np.linspace(
            0.0, tried, max(basis.samples, round(basis.dense * tried / basis.period)), dtype=np.float64
        )
        ends = []
        for start in (0.0, tried + basis.period):  # one whole period between the ramps
            moment = start + time
            whole_motion = basis.at(moment - tried) @ X
            ends.append(_from_rest(moment, whole_motion, forces.home, tried, 2 * tried + basis.period))
        found = [sampled(forces, np.array(end)) for end in ends]
        if all(one is not None and one.worst <= 0 for one in found):
            peaks = [one.excess.max(axis=0) for one in found if one is not None]
            return tried, 1 + np.max([reached, *peaks], axis=0)
        if ramp is not None or tried >= _LONGEST_RAMP * basis.period:
            raise OptimisationError(
                f"excitation: in a ramp of {tried:g} s the motion does not stay within the limits"
                + ("; a longer ramp may" if ramp is not None else "")
            )
        tried *= 2


def _deviations(
    unknowns: Unknowns, columns: FloatArray, count: float, doubts: FloatArray, prior: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of the combinations (b,) and of single parameters (p,)."""
    rows = columns.reshape(-1, columns.shape[-1]) * np.sqrt(count / len(columns))
    if prior:
        rows = np.vstack([rows, np.eye(rows.shape[1])])
    R = np.linalg.qr(rows).R
    half = np.linalg.solve(R.T, unknowns.transform.T)  # (r, b): covariance halfᵀ half
    own = np.linalg.norm(half, axis=0)
    K = unknowns.base.matrix
    if not prior:
        alone = np.count_nonzero(K, axis=1) == 1
        single = np.full(len(doubts), np.inf)
        single[unknowns.base.columns[alone]] = own[alone]
        return own, single
    # Of φ = design + D u, u of unit covariance: what the forces do not show stays as it was.
    Q = np.linalg.qr((K * doubts).T).Q  # (p, r)
    after = np.linalg.solve(R.T, Q.T)
    told = 1 - np.einsum("pr,pr->p", Q, Q) + np.einsum("rp,rp->p", after, after)
    return own, doubts * np.sqrt(np.clip(told, 0.0, 1.0))


def _basis(duration: float, harmonics: int, waypoints: int | None) -> Basis:
    """Return the functions of a motion, checked."""
    period = positive("duration", duration, InputError)
    points = None if waypoints is None else whole("waypoints", waypoints, 6)
    return Basis(period, whole("harmonics", harmonics, 1), points)


def _rate(rate: float, period: float, harmonics: int, waypoints: int | None) -> float:
    """Return a rate of samples that shows the fastest part of a motion."""
    often = positive("rate", rate, InputError)
    fastest = (harmonics if waypoints is None else waypoints / 2) / period
    if often <= 2 * fastest:
        raise InputError(
            f"rate: expected more than {2 * fastest:g} Hz, twice the highest frequency of the motion, "
            f"got {often:g} Hz"
        )
    return often


def _noise(noise: ArrayLike, actuators: int) -> FloatArray:
    """Return the noise of each actuator."""
    values = np.asarray(noise, dtype=float)
    if values.shape not in ((), (actuators,)) or not (np.isfinite(values) & (values > 0)).all():
        raise InputError(f"noise: expected a positive number or {actuators} of them, got {shown(noise)}")
    return _held(np.broadcast_to(values, (actuators,)))


def _held(array: ArrayLike) -> FloatArray:
    found = np.array(array, dtype=float)
    found.setflags(write=False)
    return found


def excitation_tables(found: Excitation) -> tuple[Table, ...]:
    """Return the tables of an excitation motion: how it moves, and what it will tell."""
    return _motion_table(found), _error_table(found), _combinations_table(found)


def _motion_table(found: Excitation) -> Table:
    time = np.arange(found.rate * found.period) / found.rate
    values, rates, accelerations = found.steady(time)
    rows = {
        f"{name} [{unit}]": (lowest, highest, fast, strong)
        for name, unit, lowest, highest, fast, strong in zip(
            found.coordinates,
            found.coordinate_units,
            values.min(axis=0),
            values.max(axis=0),
            np.abs(rates).max(axis=0),
            np.abs(accelerations).max(axis=0),
            strict=True,
        )
    }
    note = (
        f"From rest and to rest in {found.ramp:g} s each, {found.periods} periods of {found.period:g} s in "
        f"between; nearest limit: {found.nearest_limit}, utilisation "
        f"{percent(float(found.utilisation.max()))}."
    )
    header = ("Coordinate", "lowest", "highest", "peak speed [/s]", "peak acceleration [/s²]")
    return table_of("Excitation motion", header, rows, note)


def _error_table(found: Excitation) -> Table:
    errors = {"random motions in the workspace": found.workspace_error}
    if found.task_error is not None:
        errors = {"task motion": found.task_error, **errors}
    header = (
        "Forces predicted for",
        *(f"{a} [{u}]" for a, u in zip(found.actuators, found.force_units, strict=True)),
    )
    rows = {name: [number(x) for x in values.tolist()] for name, values in errors.items()}
    rows["noise of one measured force"] = [number(x) for x in found.noise.tolist()]
    note = (
        f"Expected root mean square errors after {found.measured:g} s at {found.rate:g} Hz, if nothing but "
        f"these parameters is wrong{', with the prior of the design' if found.prior else ''}."
    )
    return table_of("Expected errors of predicted forces", header, rows, note)


def _combinations_table(found: Excitation) -> Table:
    rows = []
    with np.errstate(divide="ignore"):
        shares = found.deviations / np.abs(found.values)
    for k in np.argsort(shares, kind="stable"):
        share = percent(float(shares[k]), 2) if shares[k] < _ANY else "-"
        rows.append((_short(found.names[k]), number(found.values[k]), number(found.deviations[k]), share))
    note = (
        f"Base parameters of {len(found.parameter_names)} uncertain ones, condition number "
        f"{found.condition:.4g}. Large deviations: not identified alone; predicted forces do not need it."
    )
    header = ("Combination", "design", "standard deviation", "of the design")
    return Table("Identifiable combinations of parameters [SI]", header, tuple(rows), note, layout="list")


_ANY, _WORDS = 1e3, 2  # share above which it is none; parameters named of a combination


def _short(name: str) -> str:
    """Return the first parameters of a combination."""
    parts = name.split(" ")
    signs = [k for k, part in enumerate(parts) if part in "+-"]
    if len(signs) < _WORDS:
        return name
    more = len(signs) - _WORDS + 1
    return f"{' '.join(parts[: signs[_WORDS - 1]])} ... ({more} more)"


@html_of.register(Excitation)
def _(found: Excitation) -> str:
    return notebook_html("Excitation motion", repr(found), excitation_tables(found))
