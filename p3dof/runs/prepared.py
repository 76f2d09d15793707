"""`prepare_run` and `simulate`: what is the same for many runs of the machine is made once, and kept."""

from __future__ import annotations

import contextlib
import os
import time as clock
from collections import OrderedDict
from collections.abc import Hashable, Iterator, Sequence
from threading import Lock
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import Progress, shown
from p3dof._base.errors import InputError
from p3dof._base.files import called, csv_line, suffix_of, table_lines, write_streamed
from p3dof._base.time_series.wrenches import WrenchHistory, WrenchOverTime
from p3dof.machine.motion import Motion
from p3dof.methods import Machine, Method
from p3dof.runs.controllers import PD, ControllerLike, Springs
from p3dof.runs.machine import RunOfMachine
from p3dof.runs.machine_in_c import MachineInC
from p3dof.runs.margins import Event
from p3dof.runs.settings import AT_HOME, CONTINUOUS, KINDS, PRECISE, ControlLoop, InitialState, Integration
from p3dof.runs.simulation import Simulation

_KEPT = 8  # most runs that are kept prepared with a machine

_SMALL = 10_000  # most samples, and ticks, of a run that is kept prepared: 2 MB


def simulate(
    machine: Machine,
    duration: float,
    *,
    start: ArrayLike | InitialState = AT_HOME,
    controller: ControllerLike = None,
    control: ControlLoop = CONTINUOUS,
    reference: Motion | None = None,
    wrench: WrenchOverTime = None,
    method: Method | None = None,
    samples: int | ArrayLike = 1001,
    stop_at: Sequence[str | Event] = KINDS,
    integration: Integration = PRECISE,
    progress: Progress | None = None,
) -> Simulation:
    """Move a machine in time under a controller, constant forces, or none.

    It ends early, with its reason in `Simulation.stop` and all samples so far, at a slider stop or tilt limit
    of `p3dof.machine.Limits`, where a leg becomes horizontal, or where the sliders lose hold of the platform.

    Parameters
    ----------
    machine : Machine
        What is moved: `p3dof.Manipulator`.
    duration : float
        How long [s].
    start : array-like, shape (3,), or InitialState
        Where the platform starts from rest: (y, z, θ) [m, m, rad]; or with a velocity, or in all joints.
    controller : callable or array-like, shape (3,), optional
        Takes a `p3dof.runs.Measurement`, returns the forces of A, B, C [N]; or forces that stay.
    control : ControlLoop
        How it acts: how often, how strongly, with which noise; continuously and exactly by default.
    reference : Motion, optional
        What the run should follow, for `Simulation.error`; what the controller follows by default.
    wrench : array-like, shape (6,), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of one time
        since the start of the run, or of many, such as a `p3dof.WrenchHistory`.
    method : {"compiled", "virtual-power", "pinocchio"}, optional
        Integrate the minimal form in y, z, θ by the kernels, in C where all that acts has a compiled form, or
        by the paper's formulas; or Pinocchio's constrained dynamics of all joints, with stabilised closures.
        By default ``"compiled"``, and ``"pinocchio"`` from a start in all joints; `Simulation.note` says what
        keeps a run from C.
    samples : int or array-like, shape (N,)
        How many samples to keep, evenly spaced, or their times [s]; the end is always one.
    stop_at : sequence of str or Event
        Which limits end the run, of ``"slider stop"``, ``"tilt limit"``, ``"singular pose"``; the
        ``"reach limit"`` always does. An `Event` besides is a function of time, and of pose and velocity of
        the platform; it ends the run, or is noted.
    integration : Integration
        Tolerances, longest step, stabilisation of the closures, and how long it may take.
    progress : callable, optional
        Called with (done, total) samples.

    Raises
    ------
    ReachError
        If the run starts out of reach.
    ControllerError
        If the controller raises or returns something else than three finite numbers; with the time, and the
        run so far in ``run``.
    InputError
        If an argument does not fit, the run would take too long, or it starts beyond a limit or with open
        loops.
    """
    begun = clock.perf_counter()
    begin = start if isinstance(start, InitialState) else InitialState(start)
    given = controller, control, reference, wrench, method, samples, stop_at, integration
    if begin.joints is not None:
        return RunOfMachine(machine, duration, begin, *given, progress)()
    forces = None if callable(controller) else controller
    return _prepared(machine, duration, given).made(begin, forces, progress, begun)


def prepare_run(
    machine: Machine,
    duration: float,
    *,
    controller: ControllerLike = None,
    control: ControlLoop = CONTINUOUS,
    reference: Motion | None = None,
    wrench: WrenchOverTime = None,
    method: Method | None = None,
    samples: int | ArrayLike = 1001,
    stop_at: Sequence[str | Event] = KINDS,
    integration: Integration = PRECISE,
) -> PreparedRun:
    """Check what `simulate` is given but for the start, which a call gives, and make its tables only once.

    Parameters
    ----------
    machine, duration, controller, control, reference, wrench, method, samples, stop_at, integration
        As of `simulate`. Gains of a controller are taken as they are now.

    Raises
    ------
    InputError
        If an argument does not fit, or a run would take too long.
    """
    given = controller, control, reference, wrench, method, samples, stop_at, integration
    return PreparedRun(machine, duration, given)


class PreparedRun:
    """Runs that differ in their start only, as `prepare_run` makes them: call it, from any thread."""

    def __init__(self, machine: Machine, duration: float, given: tuple[Any, ...]) -> None:
        self._machine, self._duration, self._given = machine, duration, given
        self._task = RunOfMachine(machine, duration, AT_HOME, *given)
        self._in_c = None if any(self._task.obstacles()) else MachineInC(self._task)

    def __call__(
        self,
        start: ArrayLike | InitialState = AT_HOME,
        *,
        forces: ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Simulation:
        """Make a run from a start: the same bits as of `simulate`.

        Parameters
        ----------
        start : array-like, shape (3,), or InitialState
            Where it starts, as of `simulate`.
        forces : array-like, shape (3,), optional
            Constant forces of A, B, C [N] instead of those it was prepared with.
        progress : callable, optional
            Called with (done, total) samples.

        Raises
        ------
        ReachError, ControllerError, InputError
            As `simulate`; and if there are forces beside a controller.
        """
        begun = clock.perf_counter()
        begin = start if isinstance(start, InitialState) else InitialState(start)
        if forces is not None and callable(self._task.controller):
            raise InputError("forces: the run was prepared with a controller")
        return self.made(begin, forces, progress, begun)

    def stream(
        self,
        path: str | os.PathLike[str],
        start: ArrayLike | InitialState = AT_HOME,
        *,
        forces: ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Simulation:
        """Make a run whose samples go to a file on the way, however many, in the memory of ten thousand.

        Parameters
        ----------
        path : path-like
            A ``.csv`` file as of `Simulation.save`. It takes its place whole at the end; there is none of a
            run that is interrupted or fails.
        start, forces, progress
            As of a call.

        Returns
        -------
        Simulation
            The run with every so many of its samples, about a thousand, and the last.

        Raises
        ------
        ReachError, ControllerError, InputError, FileError
            As a call, and if the file cannot be written.
        """
        begun = clock.perf_counter()
        if suffix_of(path, "run") != ".csv":
            raise InputError(f"{called(path)}: expected a file name that ends in .csv")
        if self._in_c is not None and callable(self._task.controller) and forces is not None:
            raise InputError("forces: the run was prepared with a controller")
        begin = start if isinstance(start, InitialState) else InitialState(start)
        found = None
        if self._in_c is not None and begin.joints is None:
            with contextlib.suppress(_Unmade), write_streamed(path) as stream:
                found = self._in_c(begin, forces, progress, begun, _Lines(stream))
                if found is None:  # and no file
                    raise _Unmade
        if found is None:  # by Python, in which it is all in memory
            found = self.made(begin, forces, progress, begun)
            found.save(path)
        return found

    def made(
        self, begin: InitialState, forces: ArrayLike | None, progress: Progress | None, begun: float
    ) -> Simulation:
        """Make a run that began on the clock [s]."""
        if progress is not None and not callable(progress):
            raise InputError(f"progress: expected a function, got {shown(progress)}")
        if self._in_c is not None and begin.joints is None:
            found = self._in_c(begin, forces, progress, begun)
            if found is not None:
                return found
        given = (forces if forces is not None else self._given[0], *self._given[1:], progress)
        task = RunOfMachine(self._machine, self._duration, begin, *given)
        task.begun = begun
        return task()

    @property
    def kept(self) -> bool:
        """Whether it takes so little memory that it may be kept for other calls."""
        return self._in_c is not None and max(len(self._task.times), self._task.ticks) <= _SMALL


class _Unmade(Exception):  # noqa: N818 - never seen outside
    """The run has to be made in Python."""


class _Lines:
    """What writes parts of a run to a CSV file, one after the other."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream, self._begun = stream, False

    def __call__(self, part: Simulation) -> None:
        columns = part.to_columns()
        if not self._begun:
            self._stream.write(csv_line(columns))
        self._begun = True
        self._stream.write(table_lines(list(columns.values()), False))


_lock = Lock()


def _prepared(machine: Machine, duration: float, given: tuple[Any, ...]) -> PreparedRun:
    """Return a prepared run: one that is kept with the machine, if there is one for just this."""
    key = tuple(_key(duration, given))
    if None in key:
        return PreparedRun(machine, duration, given)
    kept: OrderedDict[Hashable, tuple[PreparedRun, Any]]
    kept = vars(machine.kernels).setdefault("prepared_runs", OrderedDict())
    with _lock:
        found = kept.get(key)
        if found is not None:
            kept.move_to_end(key)
            return found[0]
    made = PreparedRun(machine, duration, given)
    if made.kept:
        named = given, getattr(given[0], "model", None), getattr(given[0], "reference", None)
        with _lock:
            kept[key] = made, named  # so that nothing else gets an identity that is in the key
            while len(kept) > _KEPT:
                kept.popitem(last=False)
    return made


def _key(duration: Any, given: tuple[Any, ...]) -> Iterator[Hashable]:
    """Yield what tells prepared runs apart; None where something is not simple enough."""
    controller, control, reference, wrench, method, samples, stop_at, integration = given
    yield duration if type(duration) in (float, int) else None
    yield _key_of_controller(controller)
    yield control.same if isinstance(control, ControlLoop) else None
    yield id(reference)
    yield _key_of_wrench(wrench)
    yield method if isinstance(method, str) else "" if method is None else None
    yield samples if type(samples) is int else None
    plain = type(stop_at) in (tuple, list) and all(type(kind) is str for kind in stop_at)
    yield tuple(stop_at) if plain else None
    yield integration if isinstance(integration, Integration) else None


def _key_of_controller(controller: Any) -> Hashable:
    if not callable(controller):
        return "none" if controller is None else "constant"
    if type(controller) is Springs:
        parts = controller.stiffness, controller.rest, controller.damping, controller.preload
        return tuple(part.tobytes() for part in parts)
    if not isinstance(controller, PD):
        return id(controller)
    c = controller
    gains = c.omega, c.zeta, c.integral_time, c.moved.tobytes(), c.holding.tobytes(), c.huge
    return id(c), id(c.model), id(c.reference), *gains


def _key_of_wrench(wrench: Any) -> Hashable:
    if wrench is None or type(wrench) is WrenchHistory:
        return id(wrench)
    if isinstance(wrench, np.ndarray):
        return wrench.tobytes(), wrench.shape, wrench.dtype.str
    return None if callable(wrench) else repr(wrench)
