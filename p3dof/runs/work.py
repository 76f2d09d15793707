"""How long a run will take on the clock, estimated before it starts: no slip may run for days."""

from __future__ import annotations

import math
from typing import NamedTuple

from p3dof._base.errors import InputError

TIME_LIMIT = 3600.0
"""Longest estimated time of a run, if nobody says otherwise [s]."""

MAX_SAMPLES = 1_000_000
"""Most samples of a run: each takes about 4 kB."""

_EVALUATION = {"virtual-power": 4e-5, "compiled": 1.5e-5, "pinocchio": 3e-4}
_EVALUATION |= {"C": 2e-7, "C and Python": 1e-6}
"""Time of an evaluation of the equations of motion with a controller, by method, on one core [s]."""

_PER_STEP, _PER_SAMPLE = 14, 3
"""Evaluations of a step of DOP853 that begins anew, and of what a sample takes."""

_SLOWEST = 2.0
"""Steps a second of a machine that swings freely, with neither controller nor longest step [Hz]."""


class Work(NamedTuple):
    """What a run will take.

    Parameters
    ----------
    steps : float
        Of the integrator, at least.
    seconds : float
        On the clock, about.
    """

    steps: float
    seconds: float


def estimate(
    method: str, duration: float, samples: int, rate: float | None = None, max_step: float = math.inf
) -> Work:
    """Return what a run will take: it grows with duration, rate and samples, and as steps become shorter.

    Parameters
    ----------
    method : str
        ``"virtual-power"``, ``"compiled"``, ``"pinocchio"``; ``"C"`` for runs in C, ``"C and Python"``
        where a controller from Python acts in them.
    duration : float
        How long the run is [s].
    samples : int
        How many are kept.
    rate : float, optional
        Of the controller [Hz].
    max_step : float
        Longest step of the integrator [s].

    Returns
    -------
    Work
    """
    steps = duration * max(rate or 0.0, 1 / max_step, _SLOWEST)
    return Work(steps, _EVALUATION[method] * (_PER_STEP * steps + _PER_SAMPLE * samples))


def require_affordable(work: Work, samples: int, time_limit: float, how_to_allow: str) -> None:
    """Raise if a run would take too long, or too much memory.

    Parameters
    ----------
    work : Work
        What it will take.
    samples : int
        How many are kept.
    time_limit : float
        Longest time on the clock [s].
    how_to_allow : str
        What to give a larger number, in words.

    Raises
    ------
    InputError
        Naming the estimate, and what to change.
    """
    if samples > MAX_SAMPLES:
        raise InputError(f"samples: expected at most {MAX_SAMPLES} in a run, got {samples}")
    if work.seconds > time_limit:
        raise InputError(
            f"the run would take about {_in_words(work.seconds)} ({work.steps:.2g} steps), the limit is "
            f"{_in_words(time_limit)}: choose a shorter duration, a lower rate, a longer max_step, fewer "
            f"samples or the method 'compiled', or allow it by {how_to_allow}"
        )


def _in_words(seconds: float) -> str:
    for unit, size in (("years", 3.156e7), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
