"""Reactions of all joints by both idealisations, side by side."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from p3dof.checks import FloatArray
from p3dof.closed_loop.reactions import BoolArray
from p3dof.errors import InputError
from p3dof.files import write_table
from p3dof.motion import Motion
from p3dof.reactions.one_joint import OpenPeak, Peak, largest, peaks_of
from p3dof.reactions.results import Reactions
from p3dof.tables import ShownInNotebook

UNDECIDED = (
    "Rigid bodies cannot decide the open loads: stiffness, play and assembly do. Each idealisation shows one "
    "of many possible values. Neither is a bound, and that they lie close together is no evidence."
)
"""What must stand beside every open load."""


@dataclass(frozen=True, eq=False)
class ReactionsComparison(ShownInNotebook):
    """Reactions of all joints over a motion, with the cuts of the loops built in both ways.

    What rigid bodies determine is the same in both. Of the rest each shows one of many possible values, and
    neither is a bound: with elastic joints a load can lie outside both.

    Parameters
    ----------
    paper, points : Reactions
        With universal joints and a hinge at the cuts, and with balls.
    """

    paper: Reactions
    points: Reactions

    def __repr__(self) -> str:
        worst = largest(self.residual[self.valid])
        return f"ReactionsComparison({self.motion!r}, residual {worst:.1e})"

    @property
    def idealisations(self) -> tuple[str, ...]:
        """Names of what is compared."""
        return tuple(one.idealisation for one in self.each)

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
        """Which samples have reactions in both, shape (N,)."""
        return self.paper.valid & self.points.valid

    @property
    def possible(self) -> bool:
        """Whether every sample is valid: else the machine cannot make the motion."""
        return bool(self.valid.all())

    @property
    def residual(self) -> FloatArray:
        """Largest error of Newton's and Euler's equations in either, shape (N,) [N or N m]."""
        return np.maximum(self.paper.residual, self.points.residual)

    @property
    def determined_forces(self) -> BoolArray:
        """Which components of the forces are determined in both, shape (N, 13, 3)."""
        return self.paper.determined_forces & self.points.determined_forces

    @property
    def determined_moments(self) -> BoolArray:
        """Which components of the moments are determined in both, shape (N, 13, 3)."""
        return self.paper.determined_moments & self.points.determined_moments

    @property
    def each(self) -> tuple[Reactions, ...]:
        """What is compared."""
        return self.paper, self.points

    def peaks(self) -> tuple[Peak, ...]:
        """Return the largest loads of every joint that rigid bodies determine, for sizing its bearings.

        Returns
        -------
        tuple of Peak
            One for each of `JOINTS`; NaN where `open_peaks` tells.
        """
        return tuple(peak for peak, _ in self._peaks())

    def open_peaks(self) -> tuple[OpenPeak, ...]:
        """Return the largest values, in either idealisation, of the loads that rigid bodies leave open.

        Returns
        -------
        tuple of OpenPeak
            In the order of `JOINTS`.
        """
        return tuple(peak for _, peaks in self._peaks() for peak in peaks)

    def _peaks(self) -> list[tuple[Peak, tuple[OpenPeak, ...]]]:
        return [
            peaks_of(name, {one.idealisation: one.loads(name) for one in self.each}) for name in self.joints
        ]

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write time, all reactions and the residuals to a CSV file, 17 significant digits.

        A component that is determined throughout has one column. Of any other there are three: its values in
        both idealisations, and where it is determined (1) and where not (0).

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
                    values = {one.idealisation: getattr(one, kind)[:, k, i] for one in self.each}
                    if determined[self.valid, i].all():
                        header.append(f"{component} [{unit}]")
                        columns.append(values["paper"])
                        continue
                    header += [f"{component} {kind} [{unit}]" for kind in values]
                    header.append(f"{component} determined")
                    columns += [*values.values(), determined[:, i].astype(float)]
        header += [f"residual {name}" for name in self.idealisations]
        return write_table(path, header, (*columns, *(one.residual for one in self.each)))


AnyReactions: TypeAlias = Reactions | ReactionsComparison
"""Of one idealisation or of both."""


def how_chosen(result: AnyReactions) -> str:
    """Say by which rule the values of open loads were chosen.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        The reactions.

    Returns
    -------
    str
        One sentence.

    Raises
    ------
    InputError
        If `result` is something else.
    """
    if not isinstance(result, Reactions | ReactionsComparison):
        raise InputError(f"result: expected Reactions, got {type(result).__name__}")
    return (
        "Shown are those with the least sum of squares over all joints, moments taken as forces on an arm of "
        f"{1e3 * result.length:g} mm, as if all joints were equally stiff."
    )
