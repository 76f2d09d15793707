"""Why runs ended, as numbers and in words."""

from __future__ import annotations

from p3dof.analysis.designs import DesignStatus
from p3dof.closed_form.compiled.many import ACCURACY, CONTROLLER, FINISHED, NOWHERE, START
from p3dof.machine.parameters import LEGS

__all__ = ["BAD_COLUMN", "DESIGN", "FINISHED", "NOT_FINITE", "NOT_RUN", "kind_of", "reason_of", "stop_codes"]

NOT_RUN, NOT_FINITE, BAD_COLUMN, DESIGN = -2, 16, 17, 20
"""Why a run was not made, besides the numbers of the engine; from `DESIGN` on the `DesignStatus`."""

_LIMITS = (
    *(("slider stop", f"slider {leg} at its lower end") for leg in LEGS),
    *(("slider stop", f"slider {leg} at its upper end") for leg in LEGS),
    ("tilt limit", "the platform at its lower limit"),
    ("tilt limit", "the platform at its upper limit"),
    *(("reach limit", f"leg {leg} horizontal") for leg in LEGS),
    ("singular pose", "the sliders cannot hold the platform's rotation (det J = 0)"),
)
_OTHERS = {
    NOT_RUN: ("not run", "it was interrupted"),
    FINISHED: ("finished", "it went on to its end"),
    ACCURACY: ("accuracy", "no step is small enough for the tolerances"),
    CONTROLLER: ("controller", "it gave forces that are not finite, or failed"),
    START: ("impossible start", "it would start beyond a limit"),
    NOWHERE: ("impossible start", "it would start out of reach"),
    NOT_FINITE: ("not a number", "a column has NaN or infinity"),
    BAD_COLUMN: ("bad gain or seed", "a gain that is not positive, or a seed that is no whole number"),
}


_MACHINES = tuple(
    DESIGN + status
    for status in DesignStatus
    if status not in (DesignStatus.FEASIBLE, DesignStatus.OUT_OF_REACH, DesignStatus.SINGULAR)
)


def kind_of(stop: int) -> str:
    """Return what ended a run.

    Parameters
    ----------
    stop : int
        Of `ManyRuns.stop`, or of the column ``stop`` of a sweep.

    Returns
    -------
    str
        A kind of `p3dof.Stop`, ``"finished"``, or why it was not made.
    """
    return _words(stop)[0]


def reason_of(stop: int) -> str:
    """Return in words why a run ended.

    Parameters
    ----------
    stop : int
        As of `kind_of`.

    Returns
    -------
    str
        The kind, and what it means.
    """
    kind, reason = _words(stop)
    return f"{kind}: {reason}"


def stop_codes() -> tuple[int, ...]:
    """Return all numbers that say why a run ended, rising."""
    return tuple(sorted((*range(len(_LIMITS)), *_OTHERS, *_MACHINES)))


def _words(stop: int) -> tuple[str, str]:
    if 0 <= stop < len(_LIMITS):
        return _LIMITS[stop]
    if stop == DESIGN + DesignStatus.NOT_FINITE:
        return _OTHERS[NOT_FINITE]
    if stop >= DESIGN:
        return "impossible machine", DesignStatus(stop - DESIGN).in_words
    return _OTHERS[stop]
