"""One driver for all runs: in C where what is asked for has a compiled form, else in Python; it says why."""

from __future__ import annotations

import math
import time as clock
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, frozen_array, positive, shown
from p3dof._base.errors import ControllerError, DynamicsError, InputError
from p3dof._base.time_series.times import evenly, sample_count
from p3dof.runs.actuation import Actuation, Measure
from p3dof.runs.integration import CHECKED, Integrator, Recording, Schedule, Tolerances, Watch
from p3dof.runs.margins import Margins
from p3dof.runs.plants import DrivenPlant, Lag, Plant
from p3dof.runs.settings import ControlLoop, Integration, require_settings

Found = TypeVar("Found")

PYTHON_CONTROLLER = "a controller of Python acts continuously; give it a rate, ControlLoop(rate=1000)"
IN_PYTHON = "made in Python, hundreds of times as slow as in C: "  # how a note begins
LAGGING = "drives lag behind forces that change continuously; give the controller a rate"


class Moving(NamedTuple):
    """What moves in a run."""

    plant: Plant
    state: FloatArray  # where it starts
    load: Callable[[float], FloatArray]  # time [s] to what acts from outside, as the plant takes it
    margins: Margins  # what ends the run
    watch: Watch | None = None  # what is noted on the way


class Run(ABC, Generic[Found]):
    """One run, checked when it is made: what the machine's and any robot's have in common."""

    count: int  # actuators
    measure: Measure  # what makes a controller's input
    largest: FloatArray  # where forces are cut off, (n,) [N or N m]
    kinks: FloatArray  # times at which a load changes its slope [s]
    longest: float  # longest step [s]
    shortest = 0.0  # very many steps that are shorter lead nowhere [s]

    def __init__(
        self,
        duration: float,
        samples: int | ArrayLike,
        controller: Any,
        control: ControlLoop,
        integration: Integration,
        progress: Progress | None,
    ) -> None:
        self.begun = clock.perf_counter()
        require_settings(control, integration)
        if progress is not None and not callable(progress):
            raise InputError(f"progress: expected a function, got {shown(progress)}")
        if control.rate is None and getattr(controller, "integral_time", math.inf) != math.inf:
            raise InputError("integral_time: an integral needs a control rate, this run is continuous")
        self.times = _sample_times(duration, samples)
        self.controller, self.control, self.integration = controller, control, integration
        self.progress = progress

    def __call__(self) -> Found:
        """Make the run."""
        found = next(self.obstacles(), "") or self.in_c()
        made = self.in_python(IN_PYTHON + found) if isinstance(found, str) else found
        vars(made)["seconds"] = clock.perf_counter() - self.begun  # of the whole call
        return made

    @abstractmethod
    def obstacles(self) -> Iterator[str]:
        """Yield whatever keeps the run from being made in C, and what to do instead."""

    @abstractmethod
    def in_c(self) -> Found | str:
        """Make the run in C; return why it has to be made again in Python if it cannot be trusted."""

    @abstractmethod
    def moving(self) -> Moving:
        """Return what moves."""

    @abstractmethod
    def result(self, record: Recording, note: str) -> Found:
        """Return what the run leaves behind."""

    @property
    def outside(self) -> bool:
        """Whether a controller acts continuously."""
        return callable(self.controller) and not self.control.rate

    def longest_step(self, watched: bool) -> float:
        """Return the longest step [s]: short where a function acts that could change unseen in between."""
        own = math.inf
        if self.outside:
            known = math.inf if getattr(self.controller, "autonomous", False) else CHECKED
            own = float(getattr(self.controller, "longest_step", known))
        return self.integration.longest_step(min(own, CHECKED if watched else math.inf))

    @contextmanager
    def telling(self, record: Recording, note: str = "") -> Iterator[None]:
        """Give the error of a controller the run so far."""
        try:
            yield
        except ControllerError as error:
            if record.times:
                error.run = self.result(record, note)
            raise

    def actuation(self) -> Actuation:
        """Return the path from the actuated joints to the forces; the controller is reset."""
        encoders = self.control.encoders(self.count)
        return Actuation(self.measure, self.controller, self.control.period, self.largest, encoders)

    def in_python(self, note: str = "") -> Found:
        """Make the run by the integrator in Python, which serves whatever is asked for."""
        plant, state, load, margins, watch = self.moving()
        control, given, drives = self.control, self.integration, self.control.drives(self.count)
        lag = None if drives is None or not control.period else Lag(drives)
        integrator = Integrator(
            plant if drives is None or lag is not None else DrivenPlant(plant, drives),
            self.actuation(),
            load,
            margins,
            Schedule(self.times, control.period, self.kinks, control.lateness),
            Tolerances(given.rtol, given.atol, self.longest, given.scheme),
            self.progress,
            watch,
            self.shortest,
            lag,
        )
        with self.telling(integrator.recording, note):
            record = integrator.run(state)
        if not record.times:
            raise DynamicsError(f"the run cannot start: {record.stop}")
        return self.result(record, note)


def _sample_times(duration: float, samples: int | ArrayLike) -> FloatArray:
    """Return the times of the samples, from 0 to the end."""
    end = positive("duration", duration, InputError)
    if np.ndim(samples) == 0:
        return evenly(0.0, end, sample_count(samples, least=2))
    times = frozen_array("samples", samples, ("N",))
    if len(times) == 0 or times[0] < 0 or times[-1] > end or np.any(np.diff(times) <= 0):
        raise InputError(f"samples: expected rising times from 0 to {end:g} s")
    return times if times[-1] == end else np.append(times, end)
