"""`RobotRuns`: what many runs of a robot leave behind, in columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel
from p3dof.runs.margins import Stop

INTERRUPTED = "interrupted"
"""Why a run was not made."""


@dataclass(frozen=True, eq=False)
class RobotRuns:
    """Many runs of one robot.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    time : (N,) array
        When each run ended [s].
    q, v : (N, nq) array, (N, nv) array
        Configuration and velocity then; NaN of runs that were not made.
    stop : tuple of N (Stop or None)
        What ended each before its time.
    peak_force, rms_force : (N, n) array
        Largest force of each actuator, and the root of its mean square [N or N m], over the control ticks.
    peak_error, rms_error : (N, n) array
        The same of reference less value of the actuated joints [m or rad]; NaN without a controller.
    gap : (N,) array
        Largest gap of the loops: before they were closed at each step, as the length of the vector of all
        errors [m, rad]; of a run by the robot itself as `RobotRun.gap`.
    margin : (N,) array
        Smallest margin of the compiled partition of speeds; NaN of runs by the robot itself.
    general : (N,) array of bool
        Runs that the robot itself made, as the compiled dynamics was not to be trusted.
    sample_time : (S,) array
        Times of the samples [s], if there are any.
    past : mapping of str to (N, S, size) array
        ``q``, ``v``, ``a``, ``forces`` and ``asked`` at the samples; NaN after the end of a run. A run that
        ended early has no sample at its end.
    seconds : float
        On the clock.
    """

    loop: ClosedLoopModel
    time: FloatArray
    q: FloatArray
    v: FloatArray
    stop: tuple[Stop | None, ...]
    peak_force: FloatArray
    rms_force: FloatArray
    peak_error: FloatArray
    rms_error: FloatArray
    gap: FloatArray
    margin: FloatArray
    general: NDArray[np.bool_]
    sample_time: FloatArray = field(default_factory=lambda: np.zeros(0))
    past: Mapping[str, FloatArray] = field(default_factory=dict)
    seconds: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        ended = sum(stop is not None for stop in self.stop)
        return f"RobotRuns({self.loop.model.name!r}, {len(self)} runs, {ended} ended early)"

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Which runs went on to their end (N,)."""
        return np.array([stop is None for stop in self.stop], dtype=bool)

    @classmethod
    def empty(cls, loop: ClosedLoopModel, count: int, times: FloatArray) -> RobotRuns:
        """Return runs none of which was made.

        Parameters
        ----------
        loop : ClosedLoopModel
            The robot.
        count : int
            How many.
        times : (S,) array
            Of the samples; none for no histories.
        """
        model, n = loop.model, len(loop.actuated)
        q, v = np.full((count, model.nq), np.nan), np.full((count, model.nv), np.nan)
        force, mean_force, error, mean_error = np.full((4, count, n), np.nan)
        gap, margin = np.full((2, count), np.nan)
        sizes = {"q": model.nq, "v": model.nv, "a": model.nv, "forces": n, "asked": n}
        past = {name: np.full((count, len(times), size), np.nan) for name, size in sizes.items()}
        stop = Stop(INTERRUPTED, 0.0, "the run was not made")
        return cls(
            loop,
            np.zeros(count),
            q,
            v,
            (stop,) * count,
            force,
            mean_force,
            error,
            mean_error,
            gap,
            margin,
            np.zeros(count, dtype=bool),
            times,
            past if len(times) else {},
        )
