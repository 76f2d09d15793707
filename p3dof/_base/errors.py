"""Every error that p3dof raises on purpose.

One root, `P3dofError`, so that ``except p3dof.P3dofError`` catches them all; each subclass is also the
built-in error that a Python programmer would expect (`ValueError`, `RuntimeError`, `OSError`).
"""

from __future__ import annotations

import logging
from typing import Any

LOG = logging.getLogger("p3dof")
"""What works otherwise than it might, such as a run in Python, is logged here, as INFO; silent by default."""
LOG.addHandler(logging.NullHandler())

__all__ = [
    "AssemblyError",
    "ControllerError",
    "DriveError",
    "DynamicsError",
    "FileError",
    "InputError",
    "MissingExtraError",
    "ModelError",
    "ModelWarning",
    "MotionError",
    "OptimisationError",
    "P3dofError",
    "ParameterError",
    "ReachError",
    "SampleError",
    "SingularityError",
    "SweepError",
    "TaskError",
]


class P3dofError(Exception):
    """Root of all errors raised by p3dof."""


class InputError(P3dofError, ValueError):
    """An argument has the wrong shape, type or range, or is not finite."""


class ParameterError(P3dofError, ValueError):
    """A geometric, inertial or limit parameter is not physical, is missing or is unknown."""


class MotionError(P3dofError, ValueError):
    """A motion is malformed: shapes, times, finite values, or velocities that its poses contradict.

    Parameters
    ----------
    message : str
        The sentence shown to the user.
    hint : str
        What a program in Python can do about it; not shown on the command line.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.args[0]} ({self.hint})" if self.hint else str(self.args[0])


class TaskError(P3dofError, ValueError):
    """A task is malformed: its waypoints, times, payloads or blends do not fit each other."""


class DriveError(P3dofError, ValueError):
    """A part of a drive, or a catalogue, is malformed; or there is nothing to size a drive by."""


class ModelError(P3dofError, ValueError):
    """A robot description (URDF or sidecar) is malformed or names something that does not exist."""


class ModelWarning(UserWarning):
    """A robot description may be meant otherwise than it is read."""


class FileError(P3dofError, OSError):
    """A file cannot be read or written."""


class SampleError(P3dofError, ValueError):
    """Some samples of a batch are invalid; the message names the first one.

    Parameters
    ----------
    message : str
        The sentence shown to the user.
    index : tuple of int
        Index of the first bad sample in the leading batch dimensions; empty for a single sample.
    count : int
        How many samples of the batch are bad.
    """

    def __init__(self, message: str, index: tuple[int, ...] = (), count: int = 1) -> None:
        super().__init__(message)
        self.index, self.count = index, count


class ReachError(SampleError):
    """A pose (or a set of slider positions) is out of reach.

    Parameters
    ----------
    message : str
        The sentence shown to the user.
    leg : str
        The offending leg: ``"a"``, ``"b"`` or ``"c"``.
    margin : float
        Reach margin of that leg [m]; negative or zero when out of reach.
    index, count
        See `SampleError`.
    """

    def __init__(
        self, message: str, leg: str, margin: float, index: tuple[int, ...] = (), count: int = 1
    ) -> None:
        super().__init__(message, index, count)
        self.leg, self.margin = leg, margin

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.leg, self.margin, self.index, self.count)


class SingularityError(SampleError):
    """The actuators cannot hold the mechanism: their forces are unbounded at this configuration."""


class AssemblyError(P3dofError, RuntimeError):
    """The loops of a mechanism do not close at the requested target.

    Parameters
    ----------
    message : str
        The sentence shown to the user.
    gap : float
        The largest closure or target error that is left [m or rad].
    """

    def __init__(self, message: str, gap: float = float("nan")) -> None:
        super().__init__(message)
        self.gap = gap


class DynamicsError(P3dofError, RuntimeError):
    """A dynamics problem has no solution, or the solver did not reach the accuracy asked for."""


class SweepError(P3dofError, RuntimeError):
    """A sweep cannot be begun, resumed or finished; the message says what to do."""


class OptimisationError(P3dofError, RuntimeError):
    """A problem of optimisation has no solution; the message names what cannot be kept, and by how much.

    Parameters
    ----------
    message : str
        The sentence shown to the user.
    conflicts : tuple of p3dof.design.optimisation.Conflict
        Sets of constraints that exclude each other; empty where something else is the reason.
    """

    def __init__(self, message: str, conflicts: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.conflicts = conflicts


class MissingExtraError(P3dofError, ImportError):
    """An optional dependency is not installed; the message says which extra brings it."""


NO_PINOCCHIO = (
    "Pinocchio is not installed, which is needed here: pip install pin, which has no wheels for Windows and "
    "musl; forces and runs by the methods 'compiled' and 'virtual-power' do without it"
)
"""What is said of a call that finds no Pinocchio."""


class ControllerError(P3dofError, RuntimeError):
    """A controller raised, or returned something else than three finite forces.

    Its ``__cause__`` is what the controller raised.

    Parameters
    ----------
    message : str
        The sentence shown to the user.
    time : float
        When it happened, since the start of the run [s].
    run : Simulation, optional
        The run up to then.
    """

    def __init__(self, message: str, time: float = float("nan"), run: Any = None) -> None:
        super().__init__(message)
        self.time, self.run = time, run
