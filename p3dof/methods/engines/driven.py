"""A motion in time: Exudyn is led at the sliders, integrates all else and says what leading takes.

As in the paper's comparison with ADAMS, only the sliders' positions and velocities are given. Where the
passive bodies go, and the forces, which are the multipliers of the leading constraints, are the integrator's.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, frozen_array, positive, shown
from p3dof._base.errors import DynamicsError, InputError
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics import MechanismMotion
from p3dof.machine import description
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.parameters import Parameters
from p3dof.methods.engines.base import FREEDOMS, check_machine, check_motion, step_count
from p3dof.methods.engines.exudyn import Drive, ExudynModel, integrate, settings

Integrator: TypeAlias = Literal["trapezoidal", "generalized-alpha"]
"""The trapezoidal rule with constraints of index 2, or the generalised-α method with those of index 3."""

_SOLVERS = {"trapezoidal": "TrapezoidalIndex2", "generalized-alpha": "GeneralizedAlpha"}
_ORDERS = {"trapezoidal": (2, 4, 6, 8, 10, 12), "generalized-alpha": (2, 3, 4, 5, 6, 7)}
"""Powers of the step in the error of the forces, which extrapolation removes one after the other."""

_REST = 1e-9
"""Share of the largest speed or acceleration that counts as none."""

_ALIKE = 1e-6
"""Share of a step by which two times may differ and be the same."""

_HALVINGS = 6

TOLERANCE = 1e-12
"""Residual of Newton's method, relative and absolute: what it leaves is magnified by extrapolation."""


@dataclass(frozen=True, eq=False)
class DrivenForces(Readable):
    """What leading the sliders along a motion takes."""

    integrator: str  # `"trapezoidal"` or `"generalized-alpha"`
    step: float  # time step [s]
    time: FloatArray  # (K,): ends of the steps [s]
    forces: FloatArray  # (K, 3): forces of the actuators A, B, C [N]
    gap: FloatArray  # (K,): largest distance of two points that a loop joins [m]
    seconds: float  # time that the integration took on the clock [s]


@dataclass(frozen=True, eq=False)
class Convergence(Readable):
    """Forces of ever smaller steps beside reference forces; all errors as shares of the largest of these."""

    integrator: str  # `"trapezoidal"` or `"generalized-alpha"`
    steps: FloatArray  # (S,): time steps, each half of the one before [s]
    time: FloatArray  # (K,): times of comparison: every second step of the longest ones [s]
    largest: float  # largest reference force [N]
    errors: FloatArray  # (S,): largest error with each step
    gaps: FloatArray  # (S,): largest gap of the loops with each step [m]
    forces: FloatArray  # (K, 3): forces extrapolated to a step of zero [N]
    extrapolated_error: float  # their largest error

    @property
    def orders(self) -> FloatArray:
        """Observed orders, log₂ of what halving the step divides the error by, shape (S - 1,)."""
        return np.log2(self.errors[:-1] / self.errors[1:])


def driven_forces(
    parameters: Parameters,
    motion: Motion,
    step: float,
    integrator: Integrator = "trapezoidal",
    wrench: WrenchOverTime = None,
    tolerance: float = TOLERANCE,
) -> DrivenForces:
    """Lead the sliders along a motion in Exudyn, and return the forces that this takes.

    The trapezoidal rule starts from any first state of the motion, at speed too, with the accelerations that
    belong to it. The generalised-α method counts with accelerations of its own, which are known at the start
    only if the motion starts at rest with zero acceleration: without that the forces would tremble for long.

    Between its samples, the motion is the quintic Hermite spline of `Motion.resampled`, whose third
    derivative jumps at samples. It should have samples as dense as the steps, or dense enough that the
    spline's error, of sixth order, is nothing.
    """
    check_machine(parameters)
    check_motion(motion)
    _check_integrator(integrator, motion)
    loads = states_over(motion, wrench).wrench
    time = _steps(motion, step)
    fine = motion.resampled(time)
    geometry = parameters.geometry
    moving = kinematics.motion_at(geometry, kinematics.holdable(geometry, states_over(fine)))
    step = motion.duration / (len(time) - 1)
    model = _led_model(parameters, moving, step)
    if loads is not None:
        table = np.column_stack([np.interp(time, motion.time, column) for column in loads.T])
        model.add_wrench(lambda t: np.asarray(table[_index(t, step)]))
    given = settings(model.exudyn, len(time) - 1, motion.duration, tolerance)
    given.timeIntegration.generalizedAlpha.resetAccelerations = False  # those of the start
    forces, gap, seconds = _recorded(model, given, moving, _SOLVERS[integrator])
    if len(forces) != len(time):
        raise DynamicsError(f"exudyn: expected {len(time) - 1} steps, got {len(forces) - 1}")
    return DrivenForces(integrator, step, time[1:], forces[1:], gap[1:], seconds)


def convergence(
    parameters: Parameters,
    motion: Motion,
    reference: ArrayLike,
    step: float = 1e-3,
    halvings: int = 2,
    integrator: Integrator = "trapezoidal",
    wrench: WrenchOverTime = None,
) -> Convergence:
    """Compare the forces of `driven_forces` with others, with ever smaller steps.

    The errors of the steps fall by the integrator's order; Richardson's extrapolation removes the leading
    powers of the step. Compared are every second of the longest steps: the trapezoidal rule leaves an error
    that changes its sign from step to step and is not damped.

    `step`: longest time step [s]; all times of comparison must be samples of the motion.
    """
    check_motion(motion)
    step = positive("step", step, InputError)
    expected = frozen_array("reference", reference, (len(motion), FREEDOMS))
    if isinstance(halvings, bool) or not isinstance(halvings, int) or not 1 <= halvings <= _HALVINGS:
        raise InputError(f"halvings: expected 1 to {_HALVINGS}, got {shown(halvings)}")
    time = _steps(motion, step)[2::2]
    rows = np.searchsorted(motion.time, time - _ALIKE * step)  # no time is after the last
    if len(time) == 0 or np.abs(motion.time[rows] - time).max() > _ALIKE * step:
        raise InputError(f"motion: expected samples at every second step of {step:g} s")
    runs = [driven_forces(parameters, motion, step / 2**n, integrator, wrench) for n in range(halvings + 1)]
    expected = expected[rows]
    largest = float(np.abs(expected).max())
    found = [run.forces[2 ** (n + 1) - 1 :: 2 ** (n + 1)] for n, run in enumerate(runs)]
    forces = _extrapolated(found, _ORDERS[integrator])
    return Convergence(
        integrator,
        np.array([run.step for run in runs]),
        time,
        largest,
        np.array([np.abs(values - expected).max() / largest for values in found]),
        np.array([run.gap.max() for run in runs]),
        forces,
        float(np.abs(forces - expected).max() / largest),
    )


def _extrapolated(values: list[FloatArray], powers: tuple[int, ...]) -> FloatArray:
    """Combine what halved steps gave so that the given powers of the step vanish from the error."""
    for power in powers[: len(values) - 1]:
        values = [(2**power * fine - coarse) / (2**power - 1) for coarse, fine in pairwise(values)]
    return values[0]


def _check_integrator(integrator: str, motion: Motion) -> None:
    """Raise unless the integrator exists and can start as the motion does."""
    known = get_args(Integrator)
    if integrator not in known:
        raise InputError(f"integrator: expected one of {', '.join(known)}, got {shown(integrator)}")
    if integrator == "trapezoidal":
        return
    for what in ("velocity", "acceleration"):
        rates = getattr(motion, what)
        if np.abs(rates[0]).max() > _REST * np.abs(rates).max():
            raise InputError(
                "motion: expected a start at rest with zero acceleration for the generalised-α method, "
                f"got the {what} {rates[0].tolist()}"
            )


def _steps(motion: Motion, step: float) -> FloatArray:
    """Return the start of a motion and the ends of all steps."""
    if len(motion) < 2:
        raise InputError("motion: expected at least two samples, got one")
    return np.linspace(motion.time[0], motion.time[-1], step_count(motion.duration, step) + 1)


def _led_model(parameters: Parameters, moving: MechanismMotion, step: float) -> ExudynModel:
    """Return a model whose sliders are led as they move at every step."""
    model = ExudynModel(description.describe(parameters))
    positions, velocities = (
        [_stepped(column, step) for column in rates.T] for rates in (moving.sliders, moving.slider_velocities)
    )
    model.add_drives(positions, velocities)
    return model


def _stepped(values: FloatArray, step: float) -> Drive:
    """Return a function of time from its values at the steps; the integrators ask for no other times."""
    table = values.tolist()
    return lambda t: float(table[_index(t, step)])


def _index(t: float, step: float) -> int:
    index = round(t / step)
    if abs(index * step - t) > 1e-3 * step:
        raise DynamicsError(f"exudyn: the motion was requested between two steps, at {t:g} s")
    return index


def _recorded(
    model: ExudynModel, given: Any, moving: MechanismMotion, solver: str
) -> tuple[FloatArray, FloatArray, float]:
    """Integrate from the first state; return forces and gaps, at the start too, and the time it took."""
    types = model.exudyn.OutputVariableType
    pushes = [model.add_sensor(drive, types.Force) for drive in model.drives]
    gaps = [model.add_sensor(closure, types.DisplacementLocal) for closure in model.closures]
    rates = (moving.position, moving.velocity, moving.acceleration)
    names = [joint.name for joint in model.mechanism.moving]
    model.start(*(np.array([float(values[name][0]) for name in names]) for values in rates))
    begin = clock.perf_counter()
    integrate(model, given, getattr(model.exudyn.DynamicSolverType, solver))
    seconds = clock.perf_counter() - begin
    read = model.system.GetSensorStoredData
    forces = -np.column_stack([read(sensor)[:, 1] for sensor in pushes])  # multipliers hold back
    gap = np.max([np.linalg.norm(read(sensor)[:, 1:], axis=1) for sensor in gaps], axis=0)
    return forces, gap, seconds
