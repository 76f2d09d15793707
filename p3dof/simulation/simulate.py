"""Runs of the machine in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, as_floats, frozen_array, positive, shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.errors import ControllerError, InputError
from p3dof.kinematics.states import reachable_poses
from p3dof.motion import Motion
from p3dof.motion.times import evenly, sample_count
from p3dof.parameters import Parameters
from p3dof.simulation.control import Actuation, ControllerLike, Noise
from p3dof.simulation.integration import Integrator, Progress, Recording, Tolerances
from p3dof.simulation.limits import KINDS, Margins
from p3dof.simulation.plants import ConstrainedPlant, MinimalPlant
from p3dof.simulation.reference import Reference
from p3dof.simulation.run import Simulation

WrenchLike: TypeAlias = ArrayLike | Callable[[float], ArrayLike] | None
"""A wrench (6,) that stays, a function of time, or none."""

CLOSED = 1e-9
"""Largest gap of the loops that a run may start with [m]."""

MAX_HOLDS = 100_000_000
"""Most control periods in a run: a slip of the keyboard must not run for days."""


def simulate(
    parameters: Parameters,
    loop: Callable[[], ClosedLoopModel],
    duration: float,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    controller: ControllerLike = None,
    reference: Motion | None = None,
    method: str = "virtual-power",
    rate: float | None = None,
    saturation: bool | ArrayLike = False,
    noise: Noise | None = None,
    wrench: WrenchLike = None,
    samples: int | ArrayLike = 1001,
    joints: tuple[ArrayLike, ArrayLike] | None = None,
    stop_at: Sequence[str] = KINDS,
    rtol: float = 1e-9,
    atol: float = 1e-11,
    stabilisation: float = 10.0,
    progress: Progress | None = None,
) -> Simulation:
    """Move the machine under forces; `p3dof.Manipulator.simulate` has the arguments.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    loop : callable
        Returns its closed-loop model; called for ``method="pinocchio"`` only.
    duration, pose, velocity, controller, reference, method, rate, saturation, noise, wrench, samples
        As for `p3dof.Manipulator.simulate`.
    joints, stop_at, rtol, atol, stabilisation, progress
        Likewise.

    Returns
    -------
    Simulation
    """
    times = _times(duration, samples)
    tolerances = Tolerances(positive("rtol", rtol, InputError), positive("atol", atol, InputError))
    period = 0.0 if rate is None else 1.0 / positive("rate", rate, InputError)
    if period and times[-1] / period > MAX_HOLDS:
        raise InputError(f"rate: expected at most {MAX_HOLDS} control periods, got {times[-1] / period:.3g}")
    if noise is not None and not isinstance(noise, Noise):
        raise InputError(f"noise: expected a Noise, got {shown(noise)}")
    if noise is not None and not period:
        raise InputError("noise: needs a control rate, this run is continuous")
    beta = float(frozen_array("stabilisation", stabilisation, ()))
    if beta < 0:
        raise InputError(f"stabilisation: expected zero or more, got {beta:g}")
    acting = _wrench(wrench)
    plant: MinimalPlant | ConstrainedPlant
    if method == "virtual-power":
        plant = MinimalPlant(parameters)
        if joints is not None:
            raise InputError(
                "joints: the minimal coordinates have none; use pose and velocity, or 'pinocchio'"
            )
    else:
        plant = ConstrainedPlant(parameters, loop(), beta)
    if joints is None:
        start = reachable_poses(parameters.geometry, frozen_array("pose", pose, (3,)), "raise")
        state = plant.state(start, frozen_array("velocity", velocity, (3,)))
    else:
        state = _joint_state(plant, joints)
    margins = Margins(parameters, tuple(stop_at), plant.pose(state)[0])
    limits = _saturation(saturation, parameters.limits.force)
    actuation = Actuation(parameters, controller, period, limits, noise)
    followed = _reference(controller) if reference is None else Reference(reference)
    integrator = Integrator(plant, actuation, acting, margins, times, period, tolerances, progress)
    try:
        recording = integrator.run(state)
    except ControllerError as error:
        if integrator.recording.times:
            error.run = _result(method, plant, integrator.recording, followed)
        raise
    return _result(method, plant, recording, followed)


def _result(
    method: str, plant: MinimalPlant | ConstrainedPlant, record: Recording, reference: Reference | None
) -> Simulation:
    states, rates, time = np.array(record.states), np.array(record.rates), np.array(record.times)
    poses, velocities = (np.array(rows) for rows in zip(*map(plant.pose, states), strict=True))
    accelerations = np.array([plant.acceleration(*pair) for pair in zip(states, rates, strict=True)])
    sliders, speeds = (np.array(rows) for rows in zip(*map(plant.sliders, states), strict=True))
    joints, gap = plant.joints(states, rates)
    return Simulation(
        method=method,
        motion=Motion(time, poses, velocities, accelerations, check=False),
        forces=np.array(record.forces),
        asked=np.array(record.asked),
        sliders=sliders,
        slider_velocities=speeds,
        joints=joints,
        closure_error=gap,
        wrench=np.array(record.wrenches),
        reference=None if reference is None else reference.poses(time),
        stop=record.stop,
        evaluations=record.evaluations,
        seconds=record.seconds,
    )


def _times(duration: float, samples: int | ArrayLike) -> FloatArray:
    """Return the sample times, from 0 to the end."""
    end = positive("duration", duration, InputError)
    if np.ndim(samples) == 0:
        return evenly(0.0, end, sample_count(samples, least=2))
    times = frozen_array("samples", samples, ("N",))
    if len(times) == 0 or times[0] < 0 or times[-1] > end or np.any(np.diff(times) <= 0):
        raise InputError(f"samples: expected rising times from 0 to {end:g} s")
    return times if times[-1] == end else np.append(times, end)


def _saturation(saturation: bool | ArrayLike, limit: float) -> FloatArray:
    if isinstance(saturation, bool):
        return np.full(3, limit if saturation else np.inf)
    forces = as_floats("saturation", saturation)
    if forces.shape not in ((), (3,)) or not (forces > 0).all():
        raise InputError(
            f"saturation: expected True, False, or one or three positive forces, got {forces.tolist()}"
        )
    return np.broadcast_to(forces, 3)


def _wrench(wrench: WrenchLike) -> Callable[[float], FloatArray]:
    if callable(wrench):
        function = wrench
        return lambda time: frozen_array(f"wrench at t = {time:g} s", function(time), (6,))
    held = frozen_array("wrench", np.zeros(6) if wrench is None else wrench, (6,))
    return lambda _: held


def _joint_state(plant: MinimalPlant | ConstrainedPlant, joints: tuple[ArrayLike, ArrayLike]) -> FloatArray:
    if not isinstance(joints, tuple) or len(joints) != 2 or isinstance(plant, MinimalPlant):
        raise InputError("joints: expected a tuple of joint positions and velocities, (q, v)")
    return plant.checked_state(*joints, CLOSED)


def _reference(controller: ControllerLike) -> Reference | None:
    motion = getattr(controller, "motion", None)
    return Reference(motion) if isinstance(motion, Motion) else None
