"""Reactions of all joints by elastic joints and by both idealisations, side by side."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.files import write_table
from p3dof._base.tables import ShownInNotebook
from p3dof.analysis.reactions.one_joint import OpenPeak, Peak, largest, peaks_of
from p3dof.analysis.reactions.results import Reactions
from p3dof.loops.reactions import BoolArray
from p3dof.machine.motion import Motion

UNDECIDED = (
    "Rigid bodies cannot decide the open loads: stiffness, play and assembly do. Each idealisation shows one "
    "of many possible values. Neither is a bound, and that they lie close together is no evidence."
)
"""What must stand beside every open load."""
ELASTIC = (
    "Loads marked ~ are those of elastic joints and rods between rigid bodies, without play. They are as "
    "good as the stiffness that these were given, and depend on the width b of the parallelogram, which no "
    "paper tells."
)
"""What must stand beside every load of elastic joints."""


@dataclass(frozen=True, eq=False)
class ReactionsComparison(ShownInNotebook):
    """Reactions of all joints over a motion, with elastic joints and with two idealisations beside them.

    What rigid bodies determine is the same in all. Of the rest the idealisations show one of many possible
    values each, and neither is a bound: with elastic joints a load can lie outside both.

    Parameters
    ----------
    elastic : Reactions
        Of joints and rods that give way.
    paper, points : Reactions
        With universal joints and a hinge at the cuts, and with balls; open loads by a choice.
    """

    elastic: Reactions
    paper: Reactions
    points: Reactions

    def __repr__(self) -> str:
        worst = largest(self.residual[self.valid])
        return f"ReactionsComparison({self.motion!r}, residual {worst:.1e})"

    @property
    def ways(self) -> tuple[str, ...]:
        """Names of what is compared."""
        return tuple(one.way for one in self.each)

    @property
    def rests_on_stiffness(self) -> bool:
        """Whether loads that rigid bodies leave open are those of elastic joints."""
        return True

    @property
    def motion(self) -> Motion:
        """The motion of the platform."""
        return self.paper.motion

    @property
    def length(self) -> float:
        """What moments are compared with forces by, where a choice is made [m]."""
        return self.paper.length

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the thirteen joints."""
        return self.paper.joints

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""
        return self.paper.time

    @property
    def valid(self) -> BoolArray:
        """Which samples have reactions in all, shape (N,)."""
        return self.elastic.valid & self.paper.valid & self.points.valid

    @property
    def possible(self) -> bool:
        """Whether every sample is valid: else the machine cannot make the motion."""
        return bool(self.valid.all())

    @property
    def residual(self) -> FloatArray:
        """Largest error of Newton's and Euler's equations in any, shape (N,) [N or N m]."""
        return np.asarray(np.max([one.residual for one in self.each], axis=0))

    @property
    def determined_forces(self) -> BoolArray:
        """Which components of the forces are determined in all, shape (N, 13, 3)."""
        return np.asarray(np.all([one.determined_forces for one in self.each], axis=0))

    @property
    def determined_moments(self) -> BoolArray:
        """Which components of the moments are determined in all, shape (N, 13, 3)."""
        return np.asarray(np.all([one.determined_moments for one in self.each], axis=0))

    @property
    def each(self) -> tuple[Reactions, ...]:
        """What is compared."""
        return self.elastic, self.paper, self.points

    def peaks(self) -> tuple[Peak, ...]:
        """Return the largest loads of every joint, for sizing its bearings.

        Returns
        -------
        tuple of Peak
            One for each of `JOINTS`, with what elastic joints bear of loads that rigid bodies leave open.
        """
        return tuple(peak for peak, _ in self._peaks())

    def open_peaks(self) -> tuple[OpenPeak, ...]:
        """Return the largest values, in each way, of the loads that rigid bodies leave open.

        Returns
        -------
        tuple of OpenPeak
            In the order of `JOINTS`.
        """
        return tuple(peak for _, peaks in self._peaks() for peak in peaks)

    def _peaks(self) -> list[tuple[Peak, tuple[OpenPeak, ...]]]:
        return [peaks_of(name, {one.way: one.loads(name) for one in self.each}) for name in self.joints]

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write time, all reactions and the residuals to a CSV file, 17 significant digits.

        A component that is determined throughout has one column. Of any other there are four: its values with
        elastic joints and in both idealisations, and where it is determined (1) and where not (0).

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        header, columns = ["t [s]"], [self.time]
        for k, name in enumerate(self.joints):
            for kind, unit in (("forces", "N"), ("moments", "N m")):
                determined = getattr(self, f"determined_{kind}")[:, k]
                for i, axis in enumerate("xyz"):
                    component = f"{name} {kind[0]}{axis}"
                    values = {one.way: getattr(one, kind)[:, k, i] for one in self.each}
                    if determined[self.valid, i].all():
                        header.append(f"{component} [{unit}]")
                        columns.append(values["elastic"])
                        continue
                    header += [f"{component} {kind} [{unit}]" for kind in values]
                    header.append(f"{component} determined")
                    columns += [*values.values(), determined[:, i].astype(float)]
        header += [f"residual {name}" for name in self.ways]
        return write_table(path, header, (*columns, *(one.residual for one in self.each)))


AnyReactions: TypeAlias = Reactions | ReactionsComparison
"""Found in one way or in all."""


def how_chosen(result: AnyReactions) -> str:
    """Say by which rule the values of open loads were chosen.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        The reactions.

    Returns
    -------
    str
        A few sentences.

    Raises
    ------
    InputError
        If `result` is something else.
    """
    if not isinstance(result, Reactions | ReactionsComparison):
        raise InputError(f"result: expected Reactions, got {type(result).__name__}")
    told = [ELASTIC] if result.rests_on_stiffness else []
    ideal = [f"{way!r}" for way in result.ways if way != "elastic"]
    if ideal:
        told.append(
            f"{UNDECIDED} Those of {' and '.join(ideal)} have the least sum of squares over all joints, "
            f"moments taken as forces on an arm of {1e3 * result.length:g} mm, as if all were equally stiff."
        )
    return " ".join(told)
