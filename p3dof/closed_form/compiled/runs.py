"""A run of one machine in C: what `MachineRun` of the extension is given, and what comes out of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form.compiled.kernels import NUMPY, MachineKernels
from p3dof.closed_form.compiled.lanes import lane_kernel
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers

FINISHED, TICK, CROSSED, FAILED, _, BEYOND, ROWS = range(7)
"""Why a run came back: at its end, for forces to hold, at a limit, where no step is small enough; or because
its controller has no answer, or a huge one; or for the next rows of its table."""

_ROW = 13


class Load(NamedTuple):
    """Wrenches on the platform, linear in between; one stays."""

    time: FloatArray  # (K,): [s]
    wrench: FloatArray  # (K, 6): [N, N m]
    kinks: FloatArray  # (M,): where a step must end, rising, within the run [s]


class Watched(NamedTuple):
    """Limits: twelve margins, sign (value - bound), see `p3dof.runs.machine_plants`."""

    bounds: FloatArray  # (12,): those that are not counted do not end a run
    signs: FloatArray
    counted: FloatArray


class Forces(NamedTuple):
    """What drives a run beside the forces that it holds."""

    springs: FloatArray  # (12,): stiffness, rest, damping and preload; empty for none
    largest: FloatArray  # (3,): where forces are cut off [N]
    outside: bool  # whether forces are given anew at every tick
    lag: FloatArray  # (3,): 2 π bandwidth of the drives [1/s]; infinite for none


class Controller(NamedTuple):
    """A controller of control.h in the extension."""

    settings: FloatArray
    """(10,): whether it is computed torque, noisy, counting, differencing, integrating, of a symmetric
    model; the size of forces that need a second look [N]; whether its model has friction, whether the
    forces of the model are fed forward all the time, and whether it measures the machine as it is and
    its model has the machine's lengths."""
    given: FloatArray
    """(29,): gain 3, damping 3, share of an error that joins its integral 3; forces 3, sliders 3 and their
    velocities 3 if there is no table; largest forces 3; counts of encoders 3; noise 2; bandwidth of
    drives 3."""
    table: FloatArray
    """(9 N,): a row a tick: forces, sliders and their velocities; or pose, velocity, acceleration."""
    noise: FloatArray  # (6 N,): normal numbers, six a tick
    model: tuple[FloatArray, ...]
    """Constants of assembly, torque and inverse dynamics, for computed torque; the last for feedforward
    all the time."""
    followed: tuple[FloatArray, ...] = (np.zeros(0),) * 4
    """What it follows all the time: the ends of the pieces of a motion (P + 1,); six coefficients of y, z,
    θ for each (18 P,), the highest power first; first pose 3, last pose 3 and duration; and the
    constants of the model's `place`. Empty at ticks."""
    later: Iterator[tuple[FloatArray, FloatArray]] | None = None
    """The rows of table and noise that come after these, part by part; None if these are all."""


NO_CONTROLLER = Controller(*(np.zeros(0),) * 4, (np.zeros(0),) * 3)


class Timing(NamedTuple):
    """When something happens, and how exactly it is integrated."""

    times: FloatArray  # (N,): of the samples [s]
    period: float  # how long forces are held [s]; zero for continuously acting ones
    rtol: float  # tolerances and the longest step [s]
    atol: float
    longest: float
    equal: bool = False  # whether the steps are equal, of RK4
    lateness: tuple[int, float] = (0, 0.0)
    """How many whole periods after its tick a force acts, and the rest as a share of one."""


class Samples(NamedTuple):
    """What a run left."""

    time: FloatArray  # (N,): [s]
    pose: FloatArray  # (N, 3): of the platform
    velocity: FloatArray
    forces: FloatArray  # (N, 3): of A, B, C [N]
    asked: FloatArray

    @classmethod
    def of(cls, rows: FloatArray) -> Samples:
        """Return them from rows of 13."""
        return cls(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10], rows[:, 10:13])


def available(kernels: MachineKernels) -> bool:
    """Return whether runs in C are possible here."""
    return kernels.level != NUMPY


class CompiledRun:
    """One run after the other of one machine, without Python between its steps, for one thread at a time."""

    def __init__(
        self,
        kernels: MachineKernels,
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
        drives = *forces.largest, forces.outside, *(0,) * 6, *forces.lag
        numbers = np.array([g.r, g.R, g.L, *tolerances, *drives, *steps], dtype=float)
        self._run = _compiled.MachineRun(motion, kernels.level, tables, numbers)
        self._live, self._held = np.empty(_ROW), np.empty(6)
        self._later = controller.later
        self.begin, self.hold = self._run.begin, self._run.hold
        """Begin at pose 3 and velocity 3, with the sign of the last limit; hold forces 3, and those asked for
        3, from now on."""

    @property
    def again(self) -> bool:
        """Whether another run can begin with the same tables."""
        return self._later is None

    def advance(
        self, told: Callable[[int], object] | None = None, drain: Callable[[int], object] | None = None
    ) -> int:
        """Go on until the run ends or forces are to be held.

        One of `FINISHED`, `TICK`, `CROSSED`, `FAILED`, `BEYOND`. `told` is called with the number of samples
        so far, some times a second; `drain` with how many are to be taken out by `rows` before there is room
        for more.
        """
        status = self._run.advance(told, drain)
        while status == ROWS:
            part = None if self._later is None else next(self._later, None)
            if part is None:
                return BEYOND
            self._run.rows(*part)
            status = self._run.advance(told, drain)
        return int(status)

    def actuated(self) -> tuple[float, FloatArray, FloatArray]:
        """Return the time [s], and positions and velocities of the sliders, (3,) each [m, m/s]."""
        live = np.empty(_ROW)
        self._run.live(live)
        return live.item(0), live[7:10], live[10:13]

    def state(self) -> FloatArray:
        """Return pose and velocity, (6,)."""
        self._run.live(self._live)
        return self._live[1:7].copy()

    def command(self, forces: Sequence[float] | FloatArray, asked: Sequence[float] | FloatArray) -> None:
        """Hold forces (3,) from now on [N], where others (3,) may have been asked for."""
        self._held[:3] = forces
        self._held[3:] = asked
        self.hold(self._held)

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

    def rows(self) -> FloatArray:
        """Return the samples since the last ones that were taken out, (N, 13), for `Samples.of`."""
        rows = np.empty((self._run.count, _ROW))
        self._run.samples(rows.reshape(-1))
        return rows


@lru_cache(maxsize=16)
def lane_constants(kernels: MachineKernels) -> tuple[str, FloatArray, FloatArray, FloatArray]:
    """Return which kernel moves a machine in one lane, and the constants of it, of `place` and `limits`."""
    name = "motion_with_friction" if kernels.has_friction else "motion"
    friction = friction_numbers(kernels.parameters.friction) if kernels.has_friction else ()
    motion = lane_kernel(name, kernels.symmetric).of(kernels.model, friction)
    place, watch = (lane_kernel(name).of(kernels.model) for name in ("place", "limits"))
    return name + ("_symmetric" if kernels.symmetric else ""), motion, place, watch


def accelerations(kernels: MachineKernels, samples: Samples, wrench: FloatArray) -> FloatArray:
    """Return the accelerations of the platform at samples, (N, 3)."""
    found = np.empty((len(samples.time), 3))
    parts = samples.pose, samples.velocity, samples.forces, wrench[:, WRENCH_ROWS]
    kernels.run(_forward(kernels), [column for part in parts for column in part.T], [*found.T, None])
    return found


def sliders(kernels: MachineKernels, samples: Samples) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of the sliders at samples, (N, 3) each [m, m/s]."""
    found = np.empty((len(samples.time), 14))
    kernels.run("limits", [*samples.pose.T, *samples.velocity.T], [*found.T, None])
    return found[:, :3].copy(), found[:, 7:10].copy()


def _forward(kernels: MachineKernels) -> str:
    """Return the kernel of forward dynamics that serves a machine."""
    return "forward_dynamics_with_friction" if kernels.has_friction else "forward_dynamics_loaded"
