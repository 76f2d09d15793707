"""Runs of the machine in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, as_floats, frozen_array, positive, shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.compiled import MachineKernels
from p3dof.errors import ControllerError, DynamicsError, InputError
from p3dof.kinematics.states import reachable_poses
from p3dof.motion import Motion, WrenchHistory
from p3dof.motion.times import evenly, sample_count
from p3dof.parameters import Parameters
from p3dof.simulation.control import Actuation, ControllerLike, Noise
from p3dof.simulation.crossings import CHECKED
from p3dof.simulation.equations import CompiledEquations, Equations
from p3dof.simulation.integration import Integrator, Progress, Recording, Schedule, Tolerances
from p3dof.simulation.limits import KINDS, Margins
from p3dof.simulation.plants import ConstrainedPlant, MinimalPlant
from p3dof.simulation.reference import Reference
from p3dof.simulation.run import Simulation
from p3dof.simulation.work import TIME_LIMIT, estimate, require_affordable

WrenchLike: TypeAlias = ArrayLike | Callable[[float], ArrayLike] | None
"""A wrench (6,) that stays, a function of time, or none."""

CLOSED = 1e-9
"""Largest gap of the loops that a run may start with [m]."""

LEAST_RTOL = 2.3e-14
"""Below, rounding hides the error of a step."""

STIFFEST = 1e3
"""Largest stabilisation: what it makes of rounding in the gaps stays below the accuracy asked of a step."""


def simulate(
    parameters: Parameters,
    loop: Callable[[], ClosedLoopModel],
    kernels: Callable[[], MachineKernels],
    duration: float,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    controller: ControllerLike = None,
    reference: Motion | None = None,
    method: str = "virtual-power",
    rate: float | None = None,
    saturation: bool | ArrayLike | None = False,
    noise: Noise | None = None,
    wrench: WrenchLike = None,
    samples: int | ArrayLike = 1001,
    joints: tuple[ArrayLike, ArrayLike] | None = None,
    stop_at: Sequence[str] = KINDS,
    rtol: float = 1e-11,
    atol: float = 1e-13,
    max_step: float | None = None,
    stabilisation: float = 10.0,
    progress: Progress | None = None,
    time_limit: float = TIME_LIMIT,
) -> Simulation:
    """Move the machine under forces; `p3dof.Manipulator.simulate` has the arguments.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    loop : callable
        Returns its closed-loop model; called for ``method="pinocchio"`` only.
    kernels : callable
        Returns its kernels; called for ``method="compiled"`` only.
    duration, pose, velocity, controller, reference, method, rate, saturation, noise, wrench, samples
        As for `p3dof.Manipulator.simulate`.
    joints, stop_at, rtol, atol, max_step, stabilisation, progress, time_limit
        Likewise.

    Returns
    -------
    Simulation
    """
    times = _times(duration, samples)
    period = _period(rate, controller, noise)
    longest = _longest_step(max_step, rate, controller, wrench)
    tolerances = _tolerances(rtol, atol, longest)
    work = estimate(method, float(times[-1]), len(times), 1 / period if period else None, longest)
    require_affordable(work, len(times), positive("time_limit", time_limit, InputError), "time_limit")
    if progress is not None and not callable(progress):
        raise InputError(f"progress: expected a function, got {shown(progress)}")
    beta = float(frozen_array("stabilisation", stabilisation, ()))
    if not 0 <= beta <= STIFFEST:
        raise InputError(f"stabilisation: expected 0 to {STIFFEST:g} 1/s, got {beta:g}")
    acting = _wrench(wrench)
    plant: MinimalPlant | ConstrainedPlant
    if method != "pinocchio":
        compiled = method == "compiled"
        plant = MinimalPlant(parameters, CompiledEquations(kernels()) if compiled else Equations(parameters))
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
    margins = Margins(parameters, stop_at, plant.pose(state)[0], plant.drops(state))
    limits = _saturation(saturation, parameters.limits.force)
    actuation = Actuation(parameters, controller, period, limits, noise)
    followed = _reference(controller) if reference is None else Reference(reference)
    kinks = wrench.time if isinstance(wrench, WrenchHistory) else np.zeros(0)
    schedule = Schedule(times, period, kinks)
    integrator = Integrator(plant, actuation, acting, margins, schedule, tolerances, progress)
    try:
        recording = integrator.run(state)
    except ControllerError as error:
        if integrator.recording.times:
            error.run = _result(method, plant, integrator.recording, followed)
        raise
    if not recording.times:
        raise DynamicsError(f"the run cannot start: {recording.stop}")
    return _result(method, plant, recording, followed)


def _period(rate: float | None, controller: ControllerLike, noise: Noise | None) -> float:
    """Return how long forces are held [s]; zero if they are not, which not everything can do with."""
    if noise is not None and not isinstance(noise, Noise):
        raise InputError(f"noise: expected a Noise, got {shown(noise)}")
    if rate is None:
        if noise is not None:
            raise InputError("noise: needs a control rate, this run is continuous")
        if getattr(controller, "integral_time", math.inf) != math.inf:
            raise InputError("integral_time: an integral needs a control rate, this run is continuous")
        return 0.0
    return 1.0 / positive("rate", rate, InputError)


def _tolerances(rtol: float, atol: float, longest: float) -> Tolerances:
    if positive("rtol", rtol, InputError) < LEAST_RTOL:
        raise InputError(f"rtol: expected at least {LEAST_RTOL:g}, got {float(rtol):g}")
    return Tolerances(float(rtol), positive("atol", atol, InputError), longest)


def _longest_step(
    max_step: float | None, rate: float | None, controller: ControllerLike, wrench: WrenchLike
) -> float:
    """Return the longest step of the integrator [s]: short where something may change unseen in between."""
    if max_step is not None:
        return positive("max_step", max_step, InputError)
    watched = callable(wrench) and not isinstance(wrench, WrenchHistory)
    acting = not rate and callable(controller) and not getattr(controller, "autonomous", False)
    return CHECKED if watched or acting else math.inf


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


def _saturation(saturation: bool | ArrayLike | None, limit: float) -> FloatArray:
    if saturation is None or isinstance(saturation, bool | np.bool_):
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

        def at(time: float) -> FloatArray:
            name = f"wrench at t = {time:g} s"
            try:
                found = function(time)
            except Exception as error:
                raise InputError(f"{name}: {error}") from error
            return frozen_array(name, found, (6,))

        return at
    held = frozen_array("wrench", np.zeros(6) if wrench is None else wrench, (6,))
    return lambda _: held


def _joint_state(plant: MinimalPlant | ConstrainedPlant, joints: tuple[ArrayLike, ArrayLike]) -> FloatArray:
    if not isinstance(joints, tuple) or len(joints) != 2 or isinstance(plant, MinimalPlant):
        raise InputError("joints: expected a tuple of joint positions and velocities, (q, v)")
    return plant.checked_state(*joints, CLOSED)


def _reference(controller: ControllerLike) -> Reference | None:
    motion = getattr(controller, "motion", None)
    return Reference(motion) if isinstance(motion, Motion) else None
