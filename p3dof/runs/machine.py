"""Runs of the machine in time: as any robot's, of which it is one, or in C by its own equations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import LOG, InputError
from p3dof._base.time_series.wrenches import Load, WrenchHistory, WrenchOverTime
from p3dof.closed_form.compiled import runs
from p3dof.closed_form.compiled.kernels import in_words
from p3dof.closed_form.kinematics import reachable_poses
from p3dof.machine.motion import Motion
from p3dof.methods import Machine, Method, check_method
from p3dof.runs import compiled_controllers as controllers
from p3dof.runs import settings
from p3dof.runs.controllers import ControllerLike, Measurement, Reference, Springs
from p3dof.runs.driver import LAGGING, PYTHON_CONTROLLER, Moving, Run
from p3dof.runs.integration import Recording, Watch
from p3dof.runs.machine_in_c import MachineInC
from p3dof.runs.machine_plants import (
    CompiledEquations,
    Equations,
    Limiter,
    MachineJoints,
    MachineMargins,
    MachinePlant,
    MinimalPlant,
)
from p3dof.runs.margins import Event, checked_events
from p3dof.runs.plants import CLOSED
from p3dof.runs.simulation import Simulation

COMPILED: Method = "compiled"
"""The method whose runs are made in C: the default, but where a run starts in all joints."""

NO_ANSWER = "the model of the controller has no answer, or a huge one, somewhere along the motion: look at it"
"""Why a run that was begun in C was made again."""


class RunOfMachine(Run[Simulation]):
    """One run of the machine, checked; arguments as of `simulate`."""

    count = 3

    def __init__(
        self,
        machine: Machine,
        duration: float,
        start: ArrayLike | settings.InitialState = settings.AT_HOME,
        controller: ControllerLike = None,
        control: settings.ControlLoop = settings.CONTINUOUS,
        reference: Motion | None = None,
        wrench: WrenchOverTime = None,
        method: Method | None = None,
        samples: int | ArrayLike = 1001,
        stop_at: Sequence[str | Event] = settings.KINDS,
        integration: settings.Integration = settings.PRECISE,
        progress: Progress | None = None,
    ) -> None:
        if method is not None:
            check_method(method)
        self.begin = start if isinstance(start, settings.InitialState) else settings.InitialState(start)
        super().__init__(duration, samples, controller, control, integration, progress)
        self.machine, self.parameters = machine, machine.parameters
        self.method = method or (COMPILED if self.begin.joints is None else "pinocchio")
        self.reference, self.wrench = reference, wrench
        several = isinstance(stop_at, Iterable) and not isinstance(stop_at, str)
        self.events = checked_events([what for what in stop_at if isinstance(what, Event)] if several else ())
        self.stop_at: Any = [what for what in stop_at if not isinstance(what, Event)] if several else stop_at
        self.measure = partial(Measurement.made, self.parameters.geometry)
        self.largest = control.largest_forces(self.parameters.limits.force)
        history = isinstance(wrench, WrenchHistory)
        self.kinks = wrench.time if isinstance(wrench, WrenchHistory) else np.zeros(0)
        self.longest = self.longest_step(callable(wrench) and not history)
        end, known = float(self.times[-1]), (controller, control)
        self.in_c_too = controllers.has_table(*known) or controllers.follows(*known) or self.springs
        work = settings.estimate(
            self.pace, end, len(self.times), control.changes, min(self.longest, control.quickest)
        )
        samples = 0 if self.pace.startswith("C") else len(self.times)  # in C, they may go to a file
        settings.require_affordable(work, samples, integration.time_limit, "time_limit")

    @property
    def pace(self) -> str:
        """By what it is integrated, as `p3dof.runs.settings.estimate` takes it."""
        if next(self.obstacles(), ""):
            return self.method
        return "C and Python" if self.called else "C"

    @property
    def called(self) -> bool:
        """Whether a controller in Python acts at every tick."""
        return callable(self.controller) and not self.in_c_too

    @property
    def ticks(self) -> float:
        """How often a controller acts."""
        return float(self.times[-1]) * (self.control.rate or 0.0)

    @property
    def springs(self) -> bool:
        """Whether springs act continuously, instead of drives."""
        return self.control.rate is None and type(self.controller) is Springs

    def obstacles(self) -> Iterator[str]:
        """Yield whatever keeps the run from being made in C, and what to do instead."""
        if self.begin.joints is not None:
            yield "it starts in all joints; give a pose and a velocity"
        if self.method != COMPILED:
            yield f"the method is {self.method!r}; 'compiled' runs in C"
        if not runs.available(self.machine.kernels):
            yield f"the compiled extension is not used ({in_words()})"
        if self.events:
            yield "events are functions of Python"
        if callable(self.wrench) and type(self.wrench) is not WrenchHistory:
            yield "the wrench is a function of Python; give it as a WrenchHistory, linear between its rows"
        if self.outside and not self.in_c_too:
            yield PYTHON_CONTROLLER
        if self.control.rate is None and self.control.drives() is not None:
            yield LAGGING

    def in_c(self) -> Simulation | str:
        """Make the run in C; return why it has to be made again in Python if a model has no answer."""
        found = MachineInC(self)(self.begin)
        return NO_ANSWER if found is None else found

    def moving(self) -> Moving:
        """Return the machine, in the coordinates of the method."""
        load, begin = _wrench(self.wrench), self.begin
        plant = _PLANTS[self.method](self.machine, self.integration)
        if begin.joints is None:
            pose = reachable_poses(self.parameters.geometry, np.asarray(begin.pose), "raise")
            state = plant.state(pose, np.asarray(begin.velocity))
        elif isinstance(plant, MachineJoints):
            state = plant.checked_state(*begin.joints, CLOSED)
        else:
            raise InputError(
                "joints: the minimal coordinates have none; use pose and velocity, or 'pinocchio'"
            )
        limiter, _ = Limiter(self.parameters, self.stop_at).started(plant.pose(state)[0], plant.drops(state))
        margins = MachineMargins(plant, limiter, [event for event in self.events if event.stops], state)
        self._plant, self._watch = plant, Watch.of(self.events, plant.pose)
        return Moving(plant, state, load, margins, self._watch)

    def result(self, record: Recording, note: str) -> Simulation:
        """Return what the run leaves behind."""
        if note:
            LOG.info("a run in Python: %s", note)
        plant, watch, followed = self._plant, self._watch, self.followed()
        states, rates, time = np.array(record.states), np.array(record.rates), np.array(record.times)
        poses, velocities = (np.array(rows) for rows in zip(*map(plant.pose, states), strict=True))
        accelerations = np.array([plant.acceleration(*pair) for pair in zip(states, rates, strict=True)])
        sliders, speeds = (np.array(rows) for rows in zip(*map(plant.actuated, states), strict=True))
        joints, gap = plant.joints(states, rates)
        return Simulation(
            method=self.method,
            motion=Motion(time, poses, velocities, accelerations, check=False),
            forces=np.array(record.forces),
            asked=np.array(record.asked),
            sliders=sliders,
            slider_velocities=speeds,
            joints=joints,
            closure_error=gap,
            wrench=np.array(record.loads),
            reference=None if followed is None else followed.poses(time),
            stop=record.stop,
            evaluations=record.evaluations,
            seconds=record.seconds,
            note=note,
            events=() if watch is None else watch.occurrences,
            parameters=self.parameters,
        )

    def followed(self) -> Reference | None:
        """Return what the run should follow: what was given, else what the controller follows."""
        own = getattr(self.controller, "motion", None)
        motion = own if self.reference is None else self.reference
        known = getattr(self.controller, "reference", None)
        if isinstance(known, Reference) and known.motion is motion:
            return known
        if self.reference is not None:
            return Reference(self.reference)
        return Reference(own) if isinstance(own, Motion) else None


def _joints(machine: Machine, integration: settings.Integration) -> MachinePlant:
    return MachineJoints(machine.parameters, machine.bare_loop, integration.stabilisation)


def _minimal(machine: Machine, _: settings.Integration) -> MachinePlant:
    return MinimalPlant(machine.parameters, Equations(machine.parameters))


def _minimal_compiled(machine: Machine, _: settings.Integration) -> MachinePlant:
    return MinimalPlant(machine.parameters, CompiledEquations(machine.kernels))


_PLANTS = {"pinocchio": _joints, "virtual-power": _minimal, "compiled": _minimal_compiled}
"""What is integrated, by method."""


def _wrench(wrench: WrenchOverTime) -> Callable[[float], FloatArray]:
    load = Load(wrench)
    if callable(wrench):
        return load.at
    held = load.at(0.0)
    return lambda _: held
