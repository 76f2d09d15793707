"""A run of one machine in C: what `MachineRun` of the extension is given, and what comes out of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.closed_form.compiled.kernels import NUMPY, MachineKernels
from p3dof.closed_form.compiled.lanes import lane_kernel
from p3dof.closed_form.compiled.reduced.friction import friction_numbers
from p3dof.machine.motion.wrenches import WRENCH_ROWS

FINISHED, TICK, CROSSED, FAILED, _, BEYOND = range(6)
"""Why a run came back: at its end, for forces to hold, at a limit, where no step is small enough; or because
its controller has no answer, or a huge one."""

_ROW = 13


class Load(NamedTuple):
    """Wrenches on the platform, linear in between; one stays.

    Parameters
    ----------
    time : ndarray, shape (K,)
        [s]
    wrench : ndarray, shape (K, 6)
        [N, N m]
    kinks : ndarray, shape (M,)
        Where a step must end, rising, within the run [s].
    """

    time: FloatArray
    wrench: FloatArray
    kinks: FloatArray


class Watched(NamedTuple):
    """Limits: twelve margins, sign (value - bound), see `p3dof.runs.limits`.

    Parameters
    ----------
    bounds, signs, counted : ndarray, shape (12,)
        Those that are not counted do not end a run.
    """

    bounds: FloatArray
    signs: FloatArray
    counted: FloatArray


class Forces(NamedTuple):
    """What drives a run: forces that stay or are held, or springs.

    Parameters
    ----------
    held : ndarray, shape (6,)
        Forces of A, B, C, and those asked for [N].
    springs : ndarray, shape (12,) or (0,)
        Stiffness, rest, damping and preload; empty for none.
    largest : ndarray, shape (3,)
        Where forces are cut off [N].
    outside : bool
        Whether `held` is given anew at every tick.
    lag : ndarray, shape (3,)
        2 π bandwidth of the drives [1/s]; infinite for none.
    """

    held: FloatArray
    springs: FloatArray
    largest: FloatArray
    outside: bool
    lag: FloatArray


class Controller(NamedTuple):
    """A controller of control.h in the extension.

    Parameters
    ----------
    settings : ndarray, shape (10,)
        Whether it is computed torque, noisy, counting, differencing, integrating, of a symmetric model; the
        size of forces that need a second look [N]; whether its model has friction, whether the forces of
        the model are fed forward all the time, and whether it measures the machine as it is and its model has
        the machine's lengths.
    given : ndarray, shape (29,)
        Gain 3, damping 3, share of an error that joins its integral 3; forces 3, sliders 3 and their
        velocities 3 if there is no table; largest forces 3; counts of encoders 3; noise 2; bandwidth of
        drives 3.
    table : ndarray, shape (9 N,) or (0,)
        A row a tick: forces, sliders and their velocities; or pose, velocity, acceleration.
    noise : ndarray, shape (6 N,) or (0,)
        Normal numbers, six a tick.
    model : tuple of 3 ndarray
        Constants of assembly, torque and inverse dynamics, for computed torque; the last for feedforward all
        the time.
    followed : tuple of 4 ndarray
        What it follows all the time: the ends of the pieces of a motion (P + 1,); six coefficients of y, z, θ
        for each (18 P,), the highest power first; first pose 3, last pose 3 and duration; and the constants
        of the model's ``place``. Empty at ticks.
    """

    settings: FloatArray
    given: FloatArray
    table: FloatArray
    noise: FloatArray
    model: tuple[FloatArray, ...]
    followed: tuple[FloatArray, ...] = (np.zeros(0),) * 4


NO_CONTROLLER = Controller(*(np.zeros(0),) * 4, (np.zeros(0),) * 3)


class Timing(NamedTuple):
    """When something happens, and how exactly it is integrated.

    Parameters
    ----------
    times : ndarray, shape (N,)
        Of the samples [s].
    period : float
        How long forces are held [s]; zero for continuously acting ones.
    rtol, atol, longest : float
        Tolerances and the longest step [s].
    equal : bool
        Whether the steps are equal, of RK4.
    lateness : tuple of int and float
        How many whole periods after its tick a force acts, and the rest as a share of one.
    """

    times: FloatArray
    period: float
    rtol: float
    atol: float
    longest: float
    equal: bool = False
    lateness: tuple[int, float] = (0, 0.0)


class Samples(NamedTuple):
    """What a run left.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s]
    pose, velocity : ndarray, shape (N, 3)
        Of the platform.
    forces, asked : ndarray, shape (N, 3)
        Of A, B, C [N].
    """

    time: FloatArray
    pose: FloatArray
    velocity: FloatArray
    forces: FloatArray
    asked: FloatArray


def available(kernels: MachineKernels) -> bool:
    """Return whether runs in C are possible here.

    Parameters
    ----------
    kernels : MachineKernels
        Of a machine.

    Returns
    -------
    bool
    """
    return kernels.level != NUMPY


class CompiledRun:
    """One run of one machine, without Python between its steps, for the thread that makes it.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine; `available`.
    state : ndarray, shape (6,)
        Pose and velocity at the start.
    forces : Forces
        What drives it.
    load : Load
        What pushes the platform.
    limits : Watched
        What ends it.
    timing : Timing
        When, and how exactly.
    controller : Controller, optional
        What gives the forces at every tick.
    """

    def __init__(
        self,
        kernels: MachineKernels,
        state: FloatArray,
        forces: Forces,
        load: Load,
        limits: Watched,
        timing: Timing,
        controller: Controller = NO_CONTROLLER,
    ) -> None:
        from p3dof._native import _compiled

        (motion, constants, place, watch), g = lane_constants(kernels), kernels.parameters.geometry
        tables = (
            constants,
            place,
            kernels.prepared("limits")[1],
            np.concatenate(limits),
            forces.springs,
            load.time,
            np.ravel(load.wrench[:, WRENCH_ROWS]),
            load.kinks,
            timing.times,
            *controller[:4],
            *controller.model,
            *controller.followed,
            watch,
        )
        tolerances = timing.period, timing.rtol, timing.atol, timing.longest
        whole, part = timing.lateness
        ticks = np.ceil(timing.times[-1] / timing.period) if timing.period else 0  # forces as late never act
        steps = timing.equal, min(whole, ticks + 1), part
        drives = *forces.largest, forces.outside, *state, *forces.lag
        numbers = np.array([g.r, g.R, g.L, *tolerances, *drives, *steps], dtype=float)
        self._run = _compiled.MachineRun(motion, kernels.level, tables, numbers)
        self._run.hold(forces.held)
        self._live, self._held = np.empty(_ROW), np.empty(6)
        self._sliders, self._speeds = self._live[7:10], self._live[10:13]

    def advance(self, told: Callable[[int], object] | None = None) -> int:
        """Go on until the run ends or forces are to be held.

        Parameters
        ----------
        told : callable, optional
            Called with the number of samples so far, some times a second.

        Returns
        -------
        int
            One of `FINISHED`, `TICK`, `CROSSED`, `FAILED`, `BEYOND`.
        """
        return int(self._run.advance(told))

    def actuated(self) -> tuple[float, FloatArray, FloatArray]:
        """Return the time [s], and positions and velocities of the sliders, (3,) each [m, m/s]."""
        self._run.live(self._live)
        return float(self._live[0]), self._sliders.copy(), self._speeds.copy()

    def state(self) -> FloatArray:
        """Return pose and velocity, (6,)."""
        self._run.live(self._live)
        return self._live[1:7].copy()

    def hold(self, forces: Sequence[float] | FloatArray, asked: Sequence[float] | FloatArray) -> None:
        """Hold forces (3,) from now on [N], where others (3,) may have been asked for."""
        self._held[:3] = forces
        self._held[3:] = asked
        self._run.hold(self._held)

    @property
    def time(self) -> float:
        """Where the run is [s]."""
        return float(self._run.time)

    @property
    def index(self) -> int:
        """Which limit ended the run."""
        return int(self._run.index)

    @property
    def count(self) -> int:
        """How many samples there are so far."""
        return int(self._run.count)

    @property
    def evaluations(self) -> int:
        """Of the equations of motion."""
        return int(self._run.evaluations)

    def samples(self) -> Samples:
        """Return the samples so far."""
        rows = np.empty((self._run.count, _ROW))
        self._run.samples(rows.reshape(-1))
        return Samples(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10], rows[:, 10:13])


@lru_cache(maxsize=16)
def lane_constants(kernels: MachineKernels) -> tuple[str, FloatArray, FloatArray, FloatArray]:
    """Return which kernel moves a machine in one lane, and the constants of it, of ``place`` and ``limits``.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.

    Returns
    -------
    name : str
    motion, place, limits : ndarray
    """
    name = "motion_with_friction" if kernels.has_friction else "motion"
    friction = friction_numbers(kernels.parameters.friction) if kernels.has_friction else ()
    motion = lane_kernel(name, kernels.symmetric).of(kernels.model, friction)
    place, watch = (lane_kernel(name).of(kernels.model) for name in ("place", "limits"))
    return name + ("_symmetric" if kernels.symmetric else ""), motion, place, watch


def accelerations(kernels: MachineKernels, samples: Samples, wrench: FloatArray) -> FloatArray:
    """Return the accelerations of the platform at samples, (N, 3).

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    samples : Samples
        Of a run.
    wrench : ndarray, shape (N, 6)
        On the platform [N, N m].

    Returns
    -------
    ndarray, shape (N, 3)
    """
    found = np.empty((len(samples.time), 3))
    parts = samples.pose, samples.velocity, samples.forces, wrench[:, WRENCH_ROWS]
    kernels.run(_forward(kernels), [column for part in parts for column in part.T], [*found.T, None])
    return found


def sliders(kernels: MachineKernels, samples: Samples) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of the sliders at samples, (N, 3) each [m, m/s].

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    samples : Samples
        Of a run.

    Returns
    -------
    positions, velocities : ndarray, shape (N, 3)
    """
    found = np.empty((len(samples.time), 14))
    kernels.run("limits", [*samples.pose.T, *samples.velocity.T], [*found.T, None])
    return found[:, :3].copy(), found[:, 7:10].copy()


def _forward(kernels: MachineKernels) -> str:
    """Return the kernel of forward dynamics that serves a machine."""
    return "forward_dynamics_with_friction" if kernels.has_friction else "forward_dynamics_loaded"
