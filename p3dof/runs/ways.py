"""Which runs are made in C, and what to say where one is not: no run is slow without a word."""

from __future__ import annotations

from collections.abc import Iterator

from p3dof.closed_form.compiled import runs
from p3dof.closed_form.compiled.kernels import in_words
from p3dof.machine.motion import WrenchHistory
from p3dof.runs.compiled_controllers import follows
from p3dof.runs.controllers import Springs
from p3dof.runs.task import Task

IN_C = frozenset({"compiled"})
"""Methods whose runs can be in C."""

NO_ANSWER = (
    "the model of the controller has no answer, or a huge one, somewhere on the way: look at its motion"
)
"""Why a run that was begun in C was made again."""


def why_python(task: Task) -> str:
    """Return what keeps a run from being made in C, and what to do instead; empty if nothing does.

    Parameters
    ----------
    task : Task
        What is asked for.

    Returns
    -------
    str
    """
    return next(_obstacles(task), "")


def in_python(reason: str) -> str:
    """Return the note of a run that was made in Python for a reason."""
    return f"made in Python, hundreds of times as slow as in C: {reason}"


def _obstacles(task: Task) -> Iterator[str]:
    """Yield whatever keeps a run from being made in C."""
    if task.method not in IN_C:
        yield f"the method is {task.method!r}; 'compiled' runs in C"
    if not runs.available(task.machine.kernels):
        yield f"the compiled extension is not used ({in_words()})"
    if task.begin.joints is not None:
        yield "it starts in all joints; give a pose and a velocity"
    if callable(task.wrench) and type(task.wrench) is not WrenchHistory:
        yield "the wrench is a function of Python; give it as a WrenchHistory, linear between its rows"
    control, continuous = task.control, task.control.rate is None
    known = type(task.controller) is Springs or follows(task)
    if continuous and callable(task.controller) and not known:
        yield "a controller of Python acts continuously; give it a rate, ControlLoop(rate=1000)"
    if continuous and control.drives() is not None:
        yield "drives lag behind forces that change continuously; give the controller a rate"
