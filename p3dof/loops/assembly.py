"""Assembling a mechanism: configurations that close the loops at a target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError
from p3dof.loops.assembly_results import Assembly, Evidence
from p3dof.loops.closures import LoopKinematics, max_abs
from p3dof.loops.linear import Decomposition
from p3dof.loops.solver import Path, System, follow, least_squares
from p3dof.loops.target_motions import TargetMotions
from p3dof.loops.targets import ChartTarget, NoTarget, Target
from p3dof.loops.trust import Limits, levenberg_marquardt

_Solve: TypeAlias = Callable[[System, FloatArray, float], Path]

TOLERANCE = 1e-12
"""Largest closure and target error of an assembly by default [m or rad]."""
_OPEN = 1e-3
"""A guess whose loops are open by more than this belongs to no assembly [m or rad]."""
_NEAR = 0.1
"""The fallback has not left an assembly if it ends this near the end of the path [m or rad]."""
_SHAKE = 0.3
"""Standard deviation of the random starts of the last resort [m or rad]."""
_SHAKES = 3
"""How many of them there are."""
RESTARTS = 20
"""How many starts from anywhere there are, where nothing else closes the loops."""
SAME = 1e-6
"""Configurations nearer than this are the same [m or rad]."""


class Assembler:
    """Assembles one model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model and its closures.
    reference : (nq,) array
        The configuration that says which assembly is meant.
    """

    def __init__(self, kinematics: LoopKinematics, reference: FloatArray) -> None:
        self.kinematics = kinematics
        self.model = kinematics.model
        self.reference = reference
        self._loops = System(kinematics, NoTarget(kinematics.model.nv))
        self.complete = TargetMotions(kinematics).complete
        """See `TargetMotions.complete`."""

    def assemble(self, target: Target, guess: FloatArray | None, tolerance: float) -> Assembly:
        """Close the loops at a target.

        Parameters
        ----------
        target : Target
            The target.
        guess : (nq,) array, optional
            Where to start; the reference configuration by default.
        tolerance : float
            Largest closure and target error that counts as closed [m or rad].

        Returns
        -------
        Assembly

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target.
        """
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
        if not self._home.complete:
            return None
        home = self.kinematics.at(self._home.point.q)
        free = home.svd.null_space
        generator = np.random.default_rng(0)
        ranks = Counter([home.svd.rank])
        for _ in range(4 if free.size else 0):
            direction = free @ generator.normal(size=free.shape[1])
            near = pin.integrate(self.model, home.q, 0.05 * direction / np.linalg.norm(direction))
            path = least_squares(self._loops, near, TOLERANCE)
            ranks.update([self.kinematics.at(path.point.q).svd.rank] if path.complete else [])
        return ranks.most_common(1)[0][0]

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
        """Return a result whose evidence is still to be found.

        Parameters
        ----------
        path : Path
            What leads to it.
        kept : callable
            Tells of a configuration (nq,) whether its assembly was kept.

        Returns
        -------
        Assembly
        """
        q = path.point.q
        q.setflags(write=False)
        closures = self.kinematics.at(q)

        def same() -> bool:
            return kept(q) and self.generic_rank in (evidence.rank, None)

        evidence = Evidence(same, closures)
        return Assembly(q, path.point.gap, path.iterations, evidence)

    def on_home(self, system: System, q: FloatArray, tolerance: float = TOLERANCE) -> bool:
        """Tell whether a path leads from the reference configuration's assembly to a configuration.

        Parameters
        ----------
        system : System
            What the configuration solves.
        q : (nq,) array
            The configuration.
        tolerance : float
            As for `assemble`.

        Returns
        -------
        bool
        """
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
        near = max_abs(pin.difference(self.model, q, path.point.q)) < SAME
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
