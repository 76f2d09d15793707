"""The controllers of the package for runs of the machine in C, which need no Python on the way.

At a rate each has a table with a row a tick: what the motion to follow asks for, which is known before the
run. Acting all the time it has the motion itself, in pieces of polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.samples import OnInvalid
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled.formulas import is_symmetric
from p3dof.closed_form.compiled.lanes import lane_kernel
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers
from p3dof.closed_form.compiled.runs import Controller
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import Geometry, Parameters
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.runs.controllers import PD, ComputedTorque, Feedforward, Springs
from p3dof.runs.settings import EDGE, ControlLoop

_KEPT = 100_000  # ticks of a table that is kept for other runs: 7 MB; of longer ones, parts are made

_PART = 20_000  # ticks of a part

_TABLES: WeakKeyDictionary[PD, tuple[tuple[object, ...], FloatArray]] = WeakKeyDictionary()

_NO_MODEL: tuple[FloatArray, ...] = (np.zeros(0),) * 3


def has_table(controller: Any, control: ControlLoop) -> bool:
    """Return whether a controller that acts at a rate needs no Python."""
    return control.rate is not None and type(controller) in (PD, Feedforward, ComputedTorque, Springs)


def follows(controller: Any, control: ControlLoop) -> bool:
    """Return whether a controller that acts all the time needs no Python, and a motion."""
    return control.rate is None and type(controller) in (PD, Feedforward, ComputedTorque)


def in_c(
    controller: Any, control: ControlLoop, end: float, geometry: Geometry, largest: FloatArray
) -> Controller:
    """Return a controller that `has_table` or `follows`, until the end of a run [s]."""
    endless = np.full(3, math.inf)
    sigma = (0.0, 0.0) if control.noise is None else (control.noise.position, control.noise.velocity)
    counts = np.broadcast_to(np.asarray(control.resolution), 3)
    numbers = [*_gains(controller, control.period), largest, counts, np.array(sigma), endless]
    given: FloatArray = np.concatenate(numbers)
    torque, forward = isinstance(controller, ComputedTorque), isinstance(controller, Feedforward)
    model, symmetric, rough = _NO_MODEL, False, False
    if isinstance(controller, Feedforward | ComputedTorque):
        model, symmetric = _inverse_model(controller.model)
        rough = bool(controller.model.friction)
    flags = [torque, control.noise is not None, counts.any(), control.differencing]
    integrating = isinstance(controller, PD) and controller.integral_time < math.inf
    huge = controller.huge if isinstance(controller, Feedforward | ComputedTorque) else math.inf
    ideal = False
    if isinstance(controller, ComputedTorque) and control.encoders() is None:
        ideal = controller.model.geometry == geometry
    settings = np.array([*flags, integrating, symmetric, huge, rough, forward, ideal], dtype=float)
    if control.rate is None and isinstance(controller, PD):
        none: FloatArray = np.zeros(0)
        return Controller(settings, given, none, none, model, _followed(controller))
    count = math.ceil(end / control.period - EDGE)
    parts = _parts(controller, control, max(count, 1))
    table, noise = next(parts)
    return Controller(settings, given, table, noise, model, later=parts if count > _KEPT else None)


def _parts(controller: object, control: ControlLoop, count: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield table and noise of so many ticks: all at once, or part by part of a long run."""
    random = None if control.noise is None else np.random.default_rng(control.noise.seed)
    size, none = count if count <= _KEPT else _PART, np.zeros(0)
    for first in range(0, count, size):
        times = np.arange(first, min(first + size, count), dtype=float) * control.period
        noise = none if random is None else random.standard_normal(6 * len(times))
        yield _table(controller, times, control.period / 2, size == count).ravel(), noise


@lru_cache(maxsize=16)
def _inverse_model(parameters: Parameters) -> tuple[tuple[FloatArray, ...], bool]:
    """Return the constants of computed torque, and whether the machine is symmetric; by identity."""
    numbers = model_of(parameters)
    symmetric = is_symmetric(numbers)
    assembly, torque = (lane_kernel(name, symmetric).of(numbers) for name in ("assembly", "torque"))
    if parameters.friction:
        inverse = lane_kernel("inverse_with_friction", symmetric)
        return (assembly, torque, inverse.of(numbers, friction_numbers(parameters.friction))), symmetric
    return (assembly, torque, lane_kernel("inverse", symmetric).of(numbers)), symmetric


def _followed(controller: PD) -> tuple[FloatArray, ...]:
    """Return the motion that a controller follows, in pieces, and the constants of its model's sliders."""
    motion, curve = controller.reference.motion, controller.reference.curve
    breaks, pieces = (np.zeros(0), np.zeros(0)) if curve is None else (curve.x, curve.c)
    ends = np.concatenate([motion.pose[0], motion.pose[-1], [motion.duration]])
    rows = np.moveaxis(pieces, 1, 0) if curve is not None else pieces
    return (
        breaks,
        np.ascontiguousarray(rows).ravel(),
        ends,
        lane_kernel("place").of(model_of(controller.model)),
    )


def _gains(controller: object, period: float) -> list[FloatArray]:
    """Return gain, damping, share of an error that joins its integral; forces and targets that may stay."""
    none = np.zeros(3)
    if isinstance(controller, Springs):
        parts = controller.stiffness, controller.damping, none
        return [*parts, controller.preload, controller.rest, none]
    assert isinstance(controller, PD)  # noqa: S101 - `has_table`
    moved = np.ones(3) if isinstance(controller, ComputedTorque) else controller.moved
    gain, damping = controller.omega**2 * moved, 2 * controller.zeta * controller.omega * moved
    return [gain, damping, np.full(3, period / controller.integral_time), controller.holding, none, none]


def _table(controller: object, times: FloatArray, half: float, keep: bool) -> FloatArray:
    """Return rows of nine a tick of what a controller follows, kept with it; NaN without an answer."""
    if not isinstance(controller, PD):
        return np.zeros(0)
    if not keep:
        return table_of(controller, times, half)
    made_of = controller.model, controller.reference, controller.holding.tobytes(), len(times), half
    known = _TABLES.get(controller)
    if known is not None and all(a is b or a == b for a, b in zip(known[0], made_of, strict=True)):
        return known[1]
    table = table_of(controller, times, half)
    table.setflags(write=False)
    _TABLES[controller] = made_of, table
    return table


def table_of(controller: PD, times: FloatArray, half: float, on_invalid: OnInvalid = "nan") -> FloatArray:
    """Return what a controller follows, a row of nine a tick, forces being those of half a period later."""
    model, reference = controller.model, controller.reference
    pose, velocity = reference.derivative(times, 0), reference.derivative(times, 1)
    if isinstance(controller, ComputedTorque):
        return np.hstack([pose, velocity, reference.derivative(times + half, 2)])
    sliders = kinematics.inverse_kinematics(model.geometry, pose, on_invalid=on_invalid).sliders
    J = kinematics.inverse_jacobian(model.geometry, pose, on_invalid=on_invalid)
    rates = np.einsum("nij,nj->ni", J, velocity)
    base = np.broadcast_to(controller.holding, pose.shape)
    if isinstance(controller, Feedforward):
        ahead = states_of(*reference.over(times + half), on_invalid=on_invalid)
        base = VirtualPowerMethod(model).forces(ahead)
    return np.hstack([base, sliders, rates])
