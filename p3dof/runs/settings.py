"""What a run is given: start, control, integration, and how long it may take."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, as_floats, frozen_array, positive, shown
from p3dof._base.errors import InputError
from p3dof.runs.actuation import Encoders, Noise

TIME_LIMIT = 3600.0
"""Longest estimated time of a run, if nobody says otherwise [s]."""

MAX_SAMPLES = 1_000_000  # most samples of a run: each takes about 4 kB

_EVALUATION = {"virtual-power": 4e-5, "compiled": 1.5e-5, "pinocchio": 3e-4}
_EVALUATION |= {"C": 2e-7, "C and Python": 1e-6}
"""Time of an evaluation of the equations of motion with a controller, by method, on one core [s]."""

_PER_STEP, _PER_SAMPLE = 14, 3  # evaluations of a step of DOP853 that begins anew, and of what a sample takes

_SLOWEST = 2.0  # steps a second of a machine that swings freely, without controller and longest step [Hz]


class Work(NamedTuple):
    """What a run will take."""

    steps: float  # of the integrator, at least
    seconds: float  # on the clock, about


def estimate(
    method: str, duration: float, samples: int, rate: float | None = None, max_step: float = math.inf
) -> Work:
    """Return what a run will take: it grows with duration, rate and samples, and as steps become shorter."""
    steps = duration * max(rate or 0.0, 1 / max_step, _SLOWEST)
    return Work(steps, _EVALUATION[method] * (_PER_STEP * steps + _PER_SAMPLE * samples))


def require_affordable(work: Work, samples: int, time_limit: float, how_to_allow: str) -> None:
    """Raise if a run would take too long, or too much memory."""
    require_room(samples)
    if work.seconds > time_limit:
        raise InputError(
            f"the run would take about {_in_words(work.seconds)} ({work.steps:.2g} steps), the limit is "
            f"{_in_words(time_limit)}: choose a shorter duration, a lower rate, a longer max_step, fewer "
            f"samples or the method 'compiled', or allow it by {how_to_allow}"
        )


def require_room(samples: int) -> None:
    """Raise if a run would take too much memory."""
    if samples > MAX_SAMPLES:
        raise InputError(f"samples: expected at most {MAX_SAMPLES} in a run, got {samples}")


def _in_words(seconds: float) -> str:
    for unit, size in (("years", 3.156e7), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


KINDS = ("slider stop", "tilt limit", "reach limit", "singular pose")
"""What can end a run; the reach limit always does."""

SCHEMES = ("dop853", "rk4")  # how runs are integrated

LEAST_RTOL = 2.3e-14  # below, rounding hides the error of a step

EDGE = 1e-9  # share of a period, of a hold or of a step below which a rest of it is rounding

_STABLE = 6.0  # longest step of DOP853 in time constants of a lag

STIFFEST = 1e3
"""Largest stabilisation: what it makes of rounding in the gaps stays below the accuracy asked of a step."""


_ZERO = (0.0, 0.0, 0.0)
_ZEROS = frozen_array("zero", _ZERO, (3,))


@dataclass(frozen=True, eq=False)
class InitialState(FrozenArrays):
    """Where a run starts, and how fast: the platform, or all joints.

    Parameters
    ----------
    pose, velocity : array-like, shape (3,)
        Of the platform: (y, z, θ) [m, m, rad] and per second; at rest at home by default.
    joints : tuple of two array-like, optional
        Positions and velocities of all joints [m or rad, m/s or rad/s] instead: (10,) each, for
        ``method="pinocchio"``; (nq,) and (nv,) for any robot.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, or both the platform and the joints are given.
    """

    pose: ArrayLike = _ZERO
    velocity: ArrayLike = _ZERO
    joints: tuple[ArrayLike, ArrayLike] | None = None

    def __post_init__(self) -> None:
        pose = _ZEROS if self.pose is _ZERO else frozen_array("pose", self.pose, (3,))
        velocity = _ZEROS if self.velocity is _ZERO else frozen_array("velocity", self.velocity, (3,))
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "velocity", velocity)
        if self.joints is None:
            return
        if not isinstance(self.joints, tuple) or len(self.joints) != 2:
            raise InputError("joints: expected a tuple of joint positions and velocities, (q, v)")
        if pose.any() or velocity.any():
            raise InputError(
                "joints: they determine the pose of the platform; give them without pose and velocity"
            )
        q, v = (frozen_array(name, value, ("nv",)) for name, value in zip("qv", self.joints, strict=True))
        object.__setattr__(self, "joints", (q, v))


@dataclass(frozen=True, eq=False)
class ControlLoop(FrozenArrays):
    """How a controller acts on the machine: how often, how strongly, and how well it measures.

    What is measured gets its noise first, is then rounded to counts, then differences are taken. Forces are
    cut off first, are then late, then the drives lag behind them.

    Parameters
    ----------
    rate : float, optional
        How often it acts, its forces held in between [Hz]; continuously by default.
    saturation : bool or array-like, shape () or (n,)
        Cut the forces of the n actuators off at these values [N or N m]; True for those of its `Limits`, or
        for any robot those of its file (effort).
    noise : Noise, optional
        Errors of the measured positions and velocities of the actuated joints; needs a `rate`.
    resolution : array-like, shape () or (n,)
        Length or angle of a count of the encoders, to which positions are rounded [m or rad]; zero for any
        number. Needs a `rate`.
    differencing : bool
        Whether velocities are measured as differences of positions over a period, those of the first reading
        being exact; needs a `rate`.
    delay : float
        How long after the measurement the forces change [s], less or more than a period; until the first time
        they are what the first measurement asks for. Needs a `rate`.
    bandwidth : array-like, shape () or (n,)
        Of the drives, where the amplitude of their forces has fallen by 3 dB [Hz]: they follow the commands
        with a first-order lag, and start settled. Infinite for none.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    rate: float | None = None
    saturation: bool | ArrayLike = False
    noise: Noise | None = None
    resolution: ArrayLike = 0.0
    differencing: bool = False
    delay: float = 0.0
    bandwidth: ArrayLike = math.inf

    def __post_init__(self) -> None:
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise InputError(f"noise: expected a Noise, got {shown(self.noise)}")
        if not isinstance(self.differencing, bool | np.bool_):
            raise InputError(f"differencing: expected True or False, got {shown(self.differencing)}")
        resolution = _each_of("resolution", self.resolution)
        delay = float(frozen_array("delay", self.delay, ()))
        if not (resolution >= 0).all():
            raise InputError(f"resolution: expected zero or more, got {resolution.tolist()}")
        if delay < 0:
            raise InputError(f"delay: expected zero or more, got {delay:g}")
        bandwidth = _each_of("bandwidth", self.bandwidth, endless=True)
        if not (bandwidth > 0).all():
            raise InputError(f"bandwidth: expected positive frequencies, got {bandwidth.tolist()}")
        for name, value in (("resolution", resolution), ("delay", delay), ("bandwidth", bandwidth)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "differencing", bool(self.differencing))
        self._check_rate()
        if isinstance(self.saturation, bool | np.bool_):
            return
        forces = as_floats("saturation", self.saturation)
        if forces.ndim > 1 or not (forces > 0).all():
            raise InputError(
                "saturation: expected True, False, or one positive force, or one an actuator, got "
                f"{forces.tolist()}"
            )
        object.__setattr__(self, "saturation", forces)

    def _check_rate(self) -> None:
        if self.rate is not None:
            object.__setattr__(self, "rate", positive("rate", self.rate, InputError))
            return
        wanting = {
            "noise": self.noise is not None,
            "resolution": bool(np.any(self.resolution)),
            "differencing": self.differencing,
            "delay": self.delay > 0,
        }
        for name, asked in wanting.items():
            if asked:
                raise InputError(f"{name}: needs a control rate, this run is continuous")

    @property
    def changes(self) -> float:
        """How often forces change [Hz]: twice a period where they are late by a part of one; or zero."""
        return 0.0 if self.rate is None else self.rate * (2 if self.lateness[1] else 1)

    @cached_property
    def same(self) -> tuple[Any, ...]:
        """What is the same of loops that act alike."""
        arrays = (np.asarray(part) for part in (self.saturation, self.resolution, self.bandwidth))
        numbers = ((part.dtype.char, part.tobytes()) for part in arrays)
        return (self.rate, self.noise, self.differencing, self.delay, *numbers)

    @property
    def quickest(self) -> float:
        """How long steps may be at most for the lag of the drives [s]; infinite without."""
        finite = np.ravel(np.asarray(self.bandwidth))
        finite = finite[np.isfinite(finite)]
        return _STABLE / (2 * math.pi * float(finite.max())) if finite.size else math.inf

    @property
    def lateness(self) -> tuple[int, float]:
        """The delay in whole periods, and the rest of it as a share of one."""
        periods = self.delay * (self.rate or 0.0)
        whole = math.floor(periods + EDGE)
        rest = periods - whole
        return whole, rest if rest > EDGE else 0.0

    def encoders(self, count: int = 3) -> Encoders | None:
        """Return the encoders of a run with n joints; None if they tell the joints as they are.

        Raises
        ------
        InputError
            If there are not as many resolutions as joints.
        """
        resolution = _for_all("resolution", self.resolution, count)
        if self.noise is None and not resolution.any() and not self.differencing:
            return None
        return Encoders(self.period, self.noise, resolution, self.differencing)

    def drives(self, count: int = 3) -> FloatArray | None:
        """Return the bandwidth of n drives, shape (n,) [Hz]; None if all act at once.

        Raises
        ------
        InputError
            If there are not as many bandwidths as actuators.
        """
        if np.ndim(self.bandwidth) == 0 and self.bandwidth == math.inf:
            return None
        bandwidth = _for_all("bandwidth", self.bandwidth, count)
        return bandwidth if np.isfinite(bandwidth).any() else None

    @property
    def period(self) -> float:
        """How long forces are held [s]; zero if they are not."""
        return 1.0 / self.rate if self.rate else 0.0

    def largest_forces(self, limits: ArrayLike, count: int = 3) -> FloatArray:
        """Return where the forces of the actuators are cut off, shape (n,) [N or N m], or infinity.

        Parameters
        ----------
        limits : array-like, shape () or (n,)
            Those of the machine [N or N m].
        count : int
            How many actuators there are, n.

        Raises
        ------
        InputError
            If there are not as many forces as actuators.
        """
        if isinstance(self.saturation, bool | np.bool_):
            return np.array(np.broadcast_to(limits, count)) if self.saturation else np.full(count, np.inf)
        return _for_all("saturation", self.saturation, count, "force")


@dataclass(frozen=True)
class Integration:
    """How a run is integrated: by an explicit Runge-Kutta method, with adaptive or with equal steps.

    Parameters
    ----------
    rtol, atol : float
        Relative and absolute tolerance of a step. With those by default, a minute of undamped swinging keeps
        its energy to 1e-9 of the kinetic, and its loops closed to 1e-11 m.
    max_step : float, optional
        Longest step of DOP853 [s]. By default 2 ms where a function of time or of the state, other than
        `p3dof.runs.Springs`, acts continuously, which could change for a moment between longer steps; else
        unlimited.
    stabilisation : float
        β of Baumgarte's stabilisation of the closures [1/s], for ``method="pinocchio"``.
    time_limit : float
        Longest time that the run may take on the clock [s], as estimated before it starts.
    scheme : {"dop853", "rk4"}
        DOP853, of order 8 with adaptive steps, and one of order 5 from tick to tick where its error is far
        below the tolerance; or the classical method of order 4 in equal ones, which end at every change of
        the forces: for controllers that act often, and for `p3dof.Manipulator.simulate_many`.
    step : float
        Longest step of rk4 [s].

    Raises
    ------
    InputError
        If the scheme is unknown, a number is not positive, `rtol` is below what rounding allows, or the
        stabilisation is too stiff.
    """

    rtol: float = 1e-11
    atol: float = 1e-13
    max_step: float | None = None
    stabilisation: float = 10.0
    time_limit: float = TIME_LIMIT
    scheme: str = "dop853"
    step: float = 1e-3

    def __post_init__(self) -> None:
        if not isinstance(self.scheme, str) or self.scheme not in SCHEMES:
            raise InputError(f"scheme: expected {' or '.join(map(repr, SCHEMES))}, got {shown(self.scheme)}")
        for name in ("rtol", "atol", "time_limit", "step"):
            object.__setattr__(self, name, positive(name, getattr(self, name), InputError))
        if self.rtol < LEAST_RTOL:
            raise InputError(f"rtol: expected at least {LEAST_RTOL:g}, got {self.rtol:g}")
        if self.max_step is not None:
            object.__setattr__(self, "max_step", positive("max_step", self.max_step, InputError))
        beta = float(frozen_array("stabilisation", self.stabilisation, ()))
        if not 0 <= beta <= STIFFEST:
            raise InputError(f"stabilisation: expected 0 to {STIFFEST:g} 1/s, got {beta:g}")
        object.__setattr__(self, "stabilisation", beta)

    def longest_step(self, otherwise: float = math.inf) -> float:
        """Return the longest step [s]: `max_step`, or what holds where nothing was said."""
        if self.scheme == "rk4":
            return self.step
        return otherwise if self.max_step is None else self.max_step


def require_settings(control: Any, integration: Any) -> None:
    """Raise `InputError` unless these are a `ControlLoop` and an `Integration`."""
    for name, value, kind in (("control", control, ControlLoop), ("integration", integration, Integration)):
        if not isinstance(value, kind):
            raise InputError(f"{name}: expected {kind.__name__}(...), got {shown(value)}")


def _each_of(name: str, value: ArrayLike, endless: bool = False) -> FloatArray:
    """Return one number, or one an actuator; infinity where that has a meaning."""
    array = np.array(as_floats(name, value))
    if array.ndim > 1 or array.size == 0 or np.isnan(array).any() or (not endless and np.isinf(array).any()):
        raise InputError(f"{name}: expected a number, or one an actuator, got {array.tolist()}")
    array.setflags(write=False)
    return array


def _for_all(name: str, value: ArrayLike, count: int, what: str = "number") -> FloatArray:
    array = np.asarray(value)
    if array.shape not in ((), (count,)):
        raise InputError(f"{name}: expected one {what} or {count}, got {len(array)}")
    return np.array(np.broadcast_to(array, count))


AT_HOME, CONTINUOUS, PRECISE = InitialState(), ControlLoop(), Integration()
"""How a run of the machine starts, is controlled and integrated where nothing is said."""
