"""The optimum by differential evolution (SciPy's), whole generations of designs at once.

Reference
---------
R. Storn, K. Price, J. Global Optimization 11 (1997) 341; for constraints J. Lampinen, CEC 2002.

Pareto fronts by the genetic algorithms NSGA-II and NSGA-III (pymoo's), whole generations at once.

References
----------
K. Deb et al., IEEE Trans. Evolutionary Computation 6 (2002) 182 (NSGA-II); K. Deb, H. Jain, ibid. 18 (2014)
577 (NSGA-III). J. Blank, K. Deb, pymoo, IEEE Access 8 (2020) 89497.

`Journal`: the folder of an optimisation, in which every finished part of it is a file.

An optimisation that is begun anew with the same journal takes finished parts from it instead of computing
them: it comes to the same result as one that was never interrupted. Files are whole or not there.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from p3dof._base import files
from p3dof._base.blocks.storage import locked
from p3dof._base.checks import FloatArray, Progress, one_line
from p3dof._base.errors import FileError, MissingExtraError, OptimisationError, SweepError
from p3dof._base.version import __version__
from p3dof.design.optimisation.statement import Statement

MANIFEST = "optimisation.json"  # what the folder is the journal of

_LARGEST = 1_000_000
_MOST = 10_000_000  # largest manifest [bytes], and most numbers of an array
_KIND = "p3dof optimisation"
_TOLD = 3


class Journal:
    """Finished parts of an optimisation, by name: in a folder, or nowhere."""

    def __init__(
        self, folder: str | os.PathLike[str] | None, about: Mapping[str, Any], resume: bool = False
    ) -> None:
        self.folder = None if folder is None else Path(files.called(folder)).absolute()
        self.taken = 0
        self._about = {"kind": _KIND, "versions": {"p3dof": __version__, "numpy": np.__version__}, **about}
        self._lock: AbstractContextManager[None] | None = None
        if self.folder is not None:
            self._begin(self.folder, resume)

    def __enter__(self) -> Journal:
        if self.folder is not None:
            self._lock = locked(self.folder)
            self._lock.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._lock is not None:
            self._lock.__exit__(None, None, None)

    def _begin(self, folder: Path, resume: bool) -> None:
        path = folder / MANIFEST
        ours = json.loads(json.dumps(self._about, sort_keys=True))
        if not path.exists():
            files.write_atomic(path, files.dump_hashed(ours))
            return
        try:
            there = files.parse_hashed(files.read_text(path, _LARGEST), _KIND)
        except ValueError as error:
            raise FileError(
                f"{path}: expected the state of an optimisation ({one_line(str(error))})"
            ) from error
        different = list(_differences(there, ours, ""))
        if different:
            more = f" (and {len(different) - _TOLD} more)" if len(different) > _TOLD else ""
            raise SweepError(
                f"{folder}: holds another optimisation: {one_line(', '.join(different[:_TOLD]))}{more}; "
                "choose another folder"
            )
        if not resume:
            raise SweepError(f"{folder}: holds this optimisation already; to resume it: resume=True")

    def read(self, name: str) -> dict[str, Any] | None:
        """Return a finished part, or None if it is not there or is damaged."""
        if self.folder is None:
            return None
        path = self.folder / f"{name}.npz"
        if not path.exists():
            return None
        try:
            found = files.unpack_arrays(path, lambda there: there, _accept, what="a part of an optimisation")
        except FileError:
            return None  # it is computed again
        self.taken += 1
        return found

    def write(self, name: str, **arrays: Any) -> None:
        """Keep a finished part."""
        if self.folder is not None:
            files.write_atomic(self.folder / f"{name}.npz", files.pack_arrays(arrays, compressed=False))


def _accept(name: str, kind: Any, shape: tuple[int, ...]) -> None:
    if kind.kind not in "fi" or np.prod(shape, dtype=float) > _MOST:
        raise files.UnfitError(f"{name}: it is of the type {kind} and the shape {shape}")


def _differences(there: Any, ours: Any, where: str) -> list[str]:
    """Return what differs, by name."""
    if isinstance(there, dict) and isinstance(ours, dict):
        found = []
        for key in dict.fromkeys((*there, *ours)):
            name = f"{where}.{key}" if where else str(key)
            if key not in there or key not in ours:
                found.append(f"{name} is only {'here' if key in ours else 'there'}")
            else:
                found += _differences(there[key], ours[key], name)
        return found
    if json.dumps(there) == json.dumps(ours):
        return []
    return [f"{where} is {one_line(json.dumps(there), 60)} there, {one_line(json.dumps(ours), 60)} here"]


GENERATIONS = 300
_MEMBERS = 24  # members of the population a variable
_WORST = 1e30
_PRECISION = 1e-9


class Generations:
    """Designs evaluated generation by generation; those of a journal are not computed again."""

    def __init__(self, problem: Statement, journal: Journal, name: str) -> None:
        self._problem, self._journal, self._name = problem, journal, name
        self.count = 0

    def evaluate(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the objectives, to become small, and the violations of each constraint of designs."""
        number, self.count = self.count, self.count + 1
        name = f"{self._name}-{number:05d}"
        kept = self._journal.read(name)
        if kept is not None and np.array_equal(kept.get("designs", ()), scaled):
            return kept["objectives"], kept["violations"]
        found = self._compute(scaled)
        self._journal.write(name, designs=scaled, objectives=found[0], violations=found[1])
        return found

    def _compute(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
        problem = self._problem
        found = problem.evaluate(problem.variables.values(scaled))
        signs = np.array([1.0 if m.better == "small" else -1.0 for m in problem.objectives])
        objectives = np.where(np.isnan(found.objectives), _WORST, signs * found.objectives)
        scales = np.array([item.scale for item in problem.constraints])
        with np.errstate(invalid="ignore"):
            missed = np.maximum(-found.margins / scales, 0.0)
        missed = np.where(np.isnan(missed), 1.0, missed)
        lost = np.where(found.status == 0, 0.0, 10.0)[:, None]
        return objectives, np.hstack([lost, missed])


def evolve(
    problem: Statement,
    seed: int,
    journal: Journal,
    generations: int = GENERATIONS,
    progress: Progress | None = None,
) -> FloatArray:
    """Return the best design by differential evolution; ndarray, shape (n,): variables [SI units]."""
    from scipy.optimize import NonlinearConstraint, differential_evolution

    count = len(problem.variables)
    made = Generations(problem, journal, "generation")
    known: dict[bytes, float] = {}

    def violations(x: FloatArray) -> FloatArray:
        columns = np.atleast_2d(x.T) if x.ndim == 2 else x[None]
        objectives, missed = made.evaluate(np.ascontiguousarray(columns))
        known.update({row.tobytes(): value for row, value in zip(columns, objectives[:, 0], strict=True)})
        return missed.T if x.ndim == 2 else missed[0]

    def objective(x: FloatArray) -> FloatArray:
        return np.array([known[row.tobytes()] for row in np.ascontiguousarray(x.T)])

    def tell(*_: object, **__: object) -> None:
        if progress is not None:
            progress(min(made.count, generations), generations)

    found = differential_evolution(
        objective,
        [(0.0, 1.0)] * count,
        constraints=NonlinearConstraint(violations, -np.inf, 0.0),
        maxiter=generations,
        popsize=_MEMBERS,
        tol=_PRECISION,
        atol=0.0,
        init="sobol",
        polish=False,
        updating="deferred",
        vectorized=True,
        callback=tell,
        rng=np.random.default_rng(seed),
    )
    return problem.variables.values(found.x)


Genetic: TypeAlias = Literal["nsga2", "nsga3"]  # which algorithm

_NO_VALUE = 1e12


def genetic_front(
    problem: Statement,
    algorithm: Genetic,
    population: int,
    generations: int,
    seed: int,
    journal: Journal,
    progress: Progress | None = None,
) -> FloatArray:
    """Return the designs of a Pareto front, unpolished [SI units].

    Generations that are in the journal are taken from it: the algorithm runs through them again, with the
    same random numbers, and comes to the same state.
    """
    try:
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize
    except ImportError as error:
        raise MissingExtraError(
            "NSGA-II and NSGA-III need pymoo: pip install 'p3dof[studio]'; method='epsilon' does not"
        ) from error
    made = Generations(problem, journal, "generation")
    count = len(problem.variables)

    class Whole(Problem):  # type: ignore[misc]  # pymoo has no types
        def __init__(self) -> None:
            constraints = len(problem.constraints) + 1
            super().__init__(
                n_var=count, n_obj=len(problem.objectives), n_ieq_constr=constraints, xl=0.0, xu=1.0
            )

        def _evaluate(self, x: FloatArray, out: dict[str, Any], *_: Any, **__: Any) -> None:
            objectives, violations = made.evaluate(np.ascontiguousarray(x, dtype=np.float64))
            out["F"], out["G"] = np.minimum(objectives, _NO_VALUE), violations
            if progress is not None:
                progress(min(made.count, generations), generations)

    found = minimize(
        Whole(), _algorithm(algorithm, population, len(problem.objectives)), ("n_gen", generations), seed=seed
    )
    if found.X is None:
        raise OptimisationError("no design that was found satisfies all constraints")
    return problem.variables.values(np.atleast_2d(found.X))


def _algorithm(algorithm: Genetic, population: int, objectives: int) -> Any:
    if algorithm == "nsga2":
        from pymoo.algorithms.moo.nsga2 import NSGA2

        return NSGA2(pop_size=population)
    from pymoo.algorithms.moo.nsga3 import NSGA3
    from pymoo.util.ref_dirs import get_reference_directions

    directions = get_reference_directions("energy", objectives, population, seed=1)
    return NSGA3(directions, pop_size=population)
