"""Configurations that close loops, and the motion with them; evidence when it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

from p3dof._base.checks import FloatArray
from p3dof.loops.closures import ClosurePoint


class Evidence:
    """What is found out about an assembly when it is asked for, and once.

    Parameters
    ----------
    find : callable
        Finds out whether the assembly was kept.
    closures : ClosurePoint
        The closures there.
    """

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
class Assembly:
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
