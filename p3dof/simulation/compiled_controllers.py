"""The controllers of the package as tables for runs in C, which need no Python at their ticks.

Each table has a row a tick: what the motion to follow asks for, which is known before the run.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from p3dof import kinematics
from p3dof.checks import FloatArray
from p3dof.compiled.formulas import is_symmetric
from p3dof.compiled.lanes import lane_kernel
from p3dof.compiled.reduced import model_of
from p3dof.compiled.runs import Controller
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.motion import states_of
from p3dof.parameters import Parameters
from p3dof.simulation.controllers import PD, ComputedTorque, Feedforward, Springs
from p3dof.simulation.task import Task

MOST_LATE = 16
"""Periods that forces may be late, in C."""

MOST_TICKS = 2_000_000
"""Longer runs ask Python at every tick, for want of memory."""


def has_table(task: Task) -> bool:
    """Return whether a controller that acts at a rate needs no Python.

    Parameters
    ----------
    task : Task
        What is asked for.

    Returns
    -------
    bool
    """
    controller, rate = task.controller, task.control.rate
    if rate is None or type(controller) not in (PD, Feedforward, ComputedTorque, Springs):
        return False
    rough = isinstance(controller, ComputedTorque) and bool(controller.model.friction)
    return not rough and task.times[-1] * rate < MOST_TICKS


def controller_of(task: Task, largest: FloatArray) -> Controller:
    """Return the controller of a task that `has_table`.

    Parameters
    ----------
    task : Task
        What is asked for.
    largest : ndarray, shape (3,)
        Where forces are cut off [N].

    Returns
    -------
    Controller
    """
    control, controller = task.control, task.controller
    count = math.ceil(float(task.times[-1]) / control.period - 1e-9)
    times: FloatArray = np.arange(max(count, 1), dtype=float) * control.period
    given = np.concatenate([*_gains(controller, control.period), largest])
    sigma = (0.0, 0.0) if control.noise is None else (control.noise.position, control.noise.velocity)
    noise: FloatArray = np.zeros(0)
    if control.noise is not None:
        noise = np.random.default_rng(control.noise.seed).standard_normal(6 * len(times))
    counts = np.broadcast_to(np.asarray(control.resolution), 3)
    torque = isinstance(controller, ComputedTorque)
    model: tuple[FloatArray, ...] = (np.zeros(0),) * 3
    symmetric = False
    if isinstance(controller, ComputedTorque):
        model, symmetric = _inverse_model(controller.model)
    flags = [torque, control.noise is not None, counts.any(), control.differencing]
    integrating = isinstance(controller, PD) and controller.integral_time < math.inf
    huge = controller.huge if isinstance(controller, Feedforward | ComputedTorque) else math.inf
    return Controller(
        settings=np.array([*flags, integrating, symmetric, huge, control.lateness[0]], dtype=float),
        given=np.concatenate([given, counts, sigma, np.full(3, math.inf)]),
        table=_table(controller, times, control.period / 2).ravel(),
        noise=noise,
        model=model,
    )


@lru_cache(maxsize=16)
def _inverse_model(parameters: Parameters) -> tuple[tuple[FloatArray, ...], bool]:
    """Return the constants of computed torque, and whether the machine is symmetric; by identity."""
    numbers = model_of(parameters)
    symmetric = is_symmetric(numbers)
    parts = tuple(lane_kernel(name, symmetric).of(numbers) for name in ("assembly", "torque", "inverse"))
    return parts, symmetric


def _gains(controller: object, period: float) -> list[FloatArray]:
    """Return gain, damping, share of an error that joins its integral; and what stays without a table."""
    none = np.zeros(3)
    if isinstance(controller, Springs):
        parts = controller.stiffness, controller.damping, none
        return [*parts, controller.preload, controller.rest, none]
    assert isinstance(controller, PD)  # noqa: S101 - `has_table`
    moved = np.ones(3) if isinstance(controller, ComputedTorque) else controller.moved
    gain, damping = controller.omega**2 * moved, 2 * controller.zeta * controller.omega * moved
    return [gain, damping, np.full(3, period / controller.integral_time), none, none, none]


def _table(controller: object, times: FloatArray, half: float) -> FloatArray:
    """Return what a controller follows, a row of nine a tick; NaN where a model has no answer."""
    if not isinstance(controller, PD):
        return np.zeros(0)
    model, reference = controller.model, controller.reference
    pose, velocity, _ = reference.over(times)
    if isinstance(controller, ComputedTorque):
        return np.hstack([pose, velocity, reference.over(times + half)[2]])
    sliders = kinematics.inverse_kinematics(model.geometry, pose, on_invalid="nan").sliders
    J = kinematics.inverse_jacobian(model.geometry, pose, on_invalid="nan")
    rates = np.einsum("nij,nj->ni", J, velocity)
    base = np.broadcast_to(controller.holding, pose.shape)
    if isinstance(controller, Feedforward):
        ahead = reference.over(times + half)
        base = VirtualPowerMethod(model).forces(states_of(*ahead, on_invalid="nan"))
    return np.hstack([base, sliders, rates])
