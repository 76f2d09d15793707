"""`simulate_robot`: any robot with closed loops in time, by the integrator that moves the manipulator."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, Progress, positive, shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.tables import joint_values, units_of_actuated
from p3dof.errors import DynamicsError, InputError
from p3dof.files import write_table
from p3dof.motion.times import evenly, sample_count
from p3dof.simulation.actuation import Actuation
from p3dof.simulation.integration import Integrator, Recording, Schedule, Tolerances
from p3dof.simulation.margins import Stop, Unlimited
from p3dof.simulation.plants import ConstrainedPlant
from p3dof.simulation.settings import Integration
from p3dof.simulation.work import Work, require_affordable

_CLOSED = 1e-9
"""Largest gap of a start, and share of its velocity that may open the loops."""
_STEPS, _PER_STEP = 50.0, 14
"""Steps a second that are expected of a robot that moves freely, and evaluations in each."""
_CHECKED = 2e-3
"""Longest step while a function of the state acts, which could change unseen in between [s]."""


class RobotMeasurement(NamedTuple):
    """What a controller of a robot sees.

    Parameters
    ----------
    time : float
        Since the start of the run [s].
    positions, velocities : (n,) array
        Of the actuated joints [m or rad, and per second].
    """

    time: float
    positions: FloatArray
    velocities: FloatArray


@dataclass(frozen=True, eq=False)
class RobotRun:
    """A run of any robot in time.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    time : (N,) array
        Times of the samples [s].
    q : (N, nq) array
        Configurations in Pinocchio's order [m, rad].
    v, a : (N, nv) array
        Velocities and accelerations.
    forces : (N, n_actuated) array
        Of the actuated joints [N or N m].
    gap : (N,) array
        Largest distance by which a loop is open [m or rad].
    energy : (N,) array
        Kinetic and potential energy [J].
    stop : Stop, optional
        What ended the run before its time.
    evaluations : int
        Of the equations of motion.
    """

    loop: ClosedLoopModel
    time: FloatArray
    q: FloatArray
    v: FloatArray
    a: FloatArray
    forces: FloatArray
    gap: FloatArray
    energy: FloatArray
    stop: Stop | None
    evaluations: int

    @property
    def finished(self) -> bool:
        """Whether it went on to its end."""
        return self.stop is None

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write time, joints, velocities, forces, energy and gap to a CSV file.

        Parameters
        ----------
        path : path-like
            The file, which ends in ``.csv``; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        InputError, FileError
            If its name does not fit, or it cannot be written.
        """
        model = self.loop.model
        each = [joint_values(self.loop, q) for q in self.q]
        header, columns = ["t [s]"], [self.time]
        for name in each[0]:
            values = np.array([values[name] for values in each])
            if model.nqs[model.getJointId(name)] == 2:
                values = np.unwrap(values, axis=0)
            header += [name if values.shape[1] == 1 else f"{name}.{i}" for i in range(values.shape[1])]
            columns += list(values.T)
        for name in each[0]:
            joint = model.getJointId(name)
            span = self.v[:, model.idx_vs[joint] : model.idx_vs[joint] + model.nvs[joint]]
            header += [
                f"{name} dot" if span.shape[1] == 1 else f"{name}.{i} dot" for i in range(span.shape[1])
            ]
            columns += list(span.T)
        units = units_of_actuated(self.loop)
        header += [
            f"force {name} [{unit}]" for name, (_, unit) in zip(self.loop.actuated, units, strict=True)
        ]
        columns += [*self.forces.T, self.energy, self.gap]
        return write_table(path, [*header, "energy [J]", "gap"], tuple(columns))


def simulate_robot(
    loop: ClosedLoopModel,
    duration: float,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    controller: Callable[[RobotMeasurement], ArrayLike] | ArrayLike | None = None,
    *,
    samples: int = 1001,
    integration: Integration = Integration(rtol=1e-9, atol=1e-11),  # noqa: B008 - it is frozen
    progress: Progress | None = None,
) -> RobotRun:
    """Follow any robot with closed loops in time.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    duration : float
        How long [s].
    q : (nq,) array, optional
        Where it starts, with closed loops; by default the assembly of the reference configuration.
    v : (nv,) array, optional
        How fast, not opening the loops; at rest by default.
    controller : callable or (n_actuated,) array, optional
        Takes a `RobotMeasurement`, returns the forces of the actuated joints [N or N m]; or forces that stay,
        none by default.
    samples : int
        How many samples to keep, evenly spaced.
    integration : Integration
        Tolerances, longest step, stabilisation of the closures, and how long it may take.
    progress : callable, optional
        Called with (done, total) samples.

    Returns
    -------
    RobotRun

    Raises
    ------
    AssemblyError
        If the loops do not close at the reference configuration.
    ControllerError
        If the controller raises or returns something else than finite forces.
    InputError
        If an argument does not fit, the loops are open, or the run would take too long.
    """
    if not isinstance(loop, ClosedLoopModel):
        raise InputError(f"loop: expected a ClosedLoopModel, got {shown(loop)}")
    if not loop.model.nv:
        raise InputError("loop: expected a robot with joints, this one has none")
    if not isinstance(integration, Integration):
        raise InputError(f"integration: expected Integration(...), got {shown(integration)}")
    times = evenly(0.0, positive("duration", duration, InputError), sample_count(samples, least=2))
    plant = ConstrainedPlant(loop, integration.stabilisation)
    start = loop.assemble().q if q is None else q
    state = plant.checked_state(start, np.zeros(loop.model.nv) if v is None else v, _CLOSED)
    count = len(loop.actuated)
    actuation = Actuation(_measurement, controller, 0.0, np.full(count, np.inf))
    longest = integration.longest_step(_CHECKED if callable(controller) else np.inf)
    _require_affordable(plant, state, count, times, longest, integration.time_limit)
    schedule = Schedule(times, 0.0, np.zeros(0))
    tolerances = Tolerances(integration.rtol, integration.atol, longest)
    nothing = np.zeros(6)
    integrator = Integrator(plant, actuation, lambda _: nothing, Unlimited(), schedule, tolerances, progress)
    record = integrator.run(state)
    if not record.times:
        raise DynamicsError(f"the run cannot start: {record.stop}")
    return _run_of(loop, plant, record)


def _measurement(time: float, _period: float, q: FloatArray, v: FloatArray, _cut: object) -> RobotMeasurement:
    return RobotMeasurement(time, q, v)


def _require_affordable(
    plant: ConstrainedPlant, state: FloatArray, count: int, times: FloatArray, longest: float, limit: float
) -> None:
    """Raise if a run would take too long, by the time that the equations of motion take here."""
    began = clock.perf_counter()
    for _ in range(3):
        plant.rate(state, np.zeros(count), np.zeros(6))
    seconds = (clock.perf_counter() - began) / 3
    steps = float(times[-1]) * max(_STEPS, 1 / longest)
    require_affordable(
        Work(steps, seconds * (_PER_STEP * steps + len(times))), len(times), limit, "time_limit"
    )


def _run_of(loop: ClosedLoopModel, plant: ConstrainedPlant, record: Recording) -> RobotRun:
    q, v, a, gap = plant.motion(np.array(record.states), np.array(record.rates))
    forces = np.array(record.forces).reshape(len(q), -1)
    time, energy = np.array(record.times), loop.body_energies(q, v).total
    return RobotRun(loop, time, q, v, a, forces, gap, energy, record.stop, record.evaluations)
