"""What is found of bearings, guides and rods over a cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from p3dof._base.tables import ShownInNotebook
from p3dof.design.bearings.catalogue import Bearing, Guide

FULL_TURN = 2 * math.pi


@dataclass(frozen=True)
class BearingLife:
    """A bearing over a cycle.

    Parameters
    ----------
    joint : str
        Where it is.
    bearing : Bearing
        Which.
    mean_load : float
        Equivalent load of the whole cycle, weighted by the angle turned: the constant load with the same life
        [N]; NaN if it does not turn.
    peak_load : float
        Largest equivalent load [N].
    peak_time : float
        When [s].
    static_load : float
        Largest equivalent static load [N].
    static_time : float
        When [s].
    revolutions : float
        Angle turned in a cycle, to and fro, in revolutions.
    swing : float
        From one end of its way to the other [rad].
    life : float
        L10 in revolutions: nine of ten bearings reach it; infinite if it does not turn.
    hours : float
        The same in hours of the cycle.
    """

    joint: str
    bearing: Bearing
    mean_load: float
    peak_load: float
    peak_time: float
    static_load: float
    static_time: float
    revolutions: float
    swing: float
    life: float
    hours: float

    @property
    def static_safety(self) -> float:
        """C0 over the largest equivalent static load; NaN without C0."""
        if self.bearing.static is None:
            return math.nan
        return self.bearing.static / self.static_load if self.static_load else math.inf

    @property
    def oscillates(self) -> bool:
        """Whether it never turns right round, so that the formula of its life is a guide only."""
        return self.swing < FULL_TURN


@dataclass(frozen=True)
class GuideLife:
    """A guide over a cycle.

    Parameters
    ----------
    joint : str
        Where it is.
    guide : Guide
        Which.
    mean_load : float
        Equivalent load of the whole cycle, weighted by the way [N]; NaN if it does not move.
    peak_load : float
        Largest equivalent load [N].
    peak_time : float
        When [s].
    way : float
        Of a cycle, to and fro [m].
    moment_share : float
        Which part of the equivalent load comes from moments, in the mean over the cycle.
    life : float
        [m]; infinite if it does not move.
    hours : float
        The same in hours of the cycle.
    """

    joint: str
    guide: Guide
    mean_load: float
    peak_load: float
    peak_time: float
    way: float
    moment_share: float
    life: float
    hours: float

    @property
    def static_load(self) -> float:
        """Largest equivalent load, which of a guide is the static one too [N]."""
        return self.peak_load

    @property
    def static_time(self) -> float:
        """When that is [s]."""
        return self.peak_time

    @property
    def static_safety(self) -> float:
        """C0 over the largest load; NaN without C0."""
        if self.guide.static is None:
            return math.nan
        return self.guide.static / self.peak_load if self.peak_load else math.inf


@dataclass(frozen=True)
class RodCheck:
    """A leg or rod over a cycle.

    Parameters
    ----------
    rod : str
        Its link.
    compression : float
        The largest, at either end [N]; zero where there is none.
    compression_time : float
        When [s]; NaN without any.
    tension : float
        The largest, at either end [N]; zero where there is none.
    buckling : float
        Euler's load with both ends hinged [N].
    frequency : float
        Of its first bending vibration with both ends hinged [Hz].
    """

    rod: str
    compression: float
    compression_time: float
    tension: float
    buckling: float
    frequency: float

    @property
    def buckling_safety(self) -> float:
        """Euler's load over the largest compression; infinite without any."""
        return self.buckling / self.compression if self.compression else math.inf


@dataclass(frozen=True, eq=False)
class BearingReport(ShownInNotebook):
    """Bearings, guides and rods of a machine over a cycle.

    Parameters
    ----------
    bearings : tuple of BearingLife
        Of the hinges that have one.
    guides : tuple of GuideLife
        Of the sliders that have one.
    rods : tuple of RodCheck
        Legs and rods; none if they are rigid.
    cycle : float
        How long a cycle takes [s].
    warnings : tuple of str
        What to know before these numbers are used, the most important first.
    """

    bearings: tuple[BearingLife, ...]
    guides: tuple[GuideLife, ...]
    rods: tuple[RodCheck, ...]
    cycle: float
    warnings: tuple[str, ...]
