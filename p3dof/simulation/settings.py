"""What a run is given in groups: where it starts, how its controller acts, how it is integrated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, FrozenArrays, as_floats, frozen_array, positive, shown
from p3dof.errors import InputError
from p3dof.simulation.actuation import Noise
from p3dof.simulation.work import TIME_LIMIT

LEAST_RTOL = 2.3e-14
"""Below, rounding hides the error of a step."""

STIFFEST = 1e3
"""Largest stabilisation: what it makes of rounding in the gaps stays below the accuracy asked of a step."""


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

    pose: ArrayLike = (0.0, 0.0, 0.0)
    velocity: ArrayLike = (0.0, 0.0, 0.0)
    joints: tuple[ArrayLike, ArrayLike] | None = None

    def __post_init__(self) -> None:
        pose = frozen_array("pose", self.pose, (3,))
        velocity = frozen_array("velocity", self.velocity, (3,))
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "velocity", velocity)
        if self.joints is None:
            return
        if not isinstance(self.joints, tuple) or len(self.joints) != 2:
            raise InputError("joints: expected a tuple of joint positions and velocities, (q, v)")
        if pose.any() or velocity.any():
            raise InputError("joints: they say where the platform is; give them without pose and velocity")
        q, v = (frozen_array(name, value, ("nv",)) for name, value in zip("qv", self.joints, strict=True))
        object.__setattr__(self, "joints", (q, v))


@dataclass(frozen=True, eq=False)
class ControlLoop(FrozenArrays):
    """How a controller acts on the machine: how often, how strongly, and how well it measures.

    Parameters
    ----------
    rate : float, optional
        How often it acts, its forces held in between [Hz]; continuously by default.
    saturation : bool or array-like, shape () or (n,)
        Cut the forces of the n actuators off at these values [N or N m]; True for those of `p3dof.Limits`, or
        for any robot those of its file (effort).
    noise : Noise, optional
        Errors of the measured positions and velocities of the actuated joints; needs a `rate`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    rate: float | None = None
    saturation: bool | ArrayLike = False
    noise: Noise | None = None

    def __post_init__(self) -> None:
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise InputError(f"noise: expected a Noise, got {shown(self.noise)}")
        if self.rate is not None:
            object.__setattr__(self, "rate", positive("rate", self.rate, InputError))
        elif self.noise is not None:
            raise InputError("noise: needs a control rate, this run is continuous")
        if isinstance(self.saturation, bool | np.bool_):
            return
        forces = as_floats("saturation", self.saturation)
        if forces.ndim > 1 or not (forces > 0).all():
            raise InputError(
                "saturation: expected True, False, or one positive force, or one an actuator, got "
                f"{forces.tolist()}"
            )
        object.__setattr__(self, "saturation", forces)

    @property
    def period(self) -> float:
        """How long forces are held [s]; zero if they are not."""
        return 1.0 / self.rate if self.rate else 0.0

    def largest_forces(self, limits: ArrayLike, count: int = 3) -> FloatArray:
        """Return where the forces of the actuators are cut off, shape (n,) [N or N m].

        Parameters
        ----------
        limits : array-like, shape () or (n,)
            Those of the machine [N or N m].
        count : int
            How many actuators there are, n.

        Returns
        -------
        ndarray, shape (n,)
            Infinite for not at all.

        Raises
        ------
        InputError
            If there are not as many forces as actuators.
        """
        if isinstance(self.saturation, bool | np.bool_):
            return np.array(np.broadcast_to(limits, count)) if self.saturation else np.full(count, np.inf)
        forces = np.asarray(self.saturation)
        if forces.shape not in ((), (count,)):
            raise InputError(f"saturation: expected one force or {count}, got {len(forces)}")
        return np.array(np.broadcast_to(forces, count))


@dataclass(frozen=True)
class Integration:
    """How a run is integrated: by DOP853, an explicit Runge-Kutta method of order 8 with adaptive steps.

    Parameters
    ----------
    rtol, atol : float
        Relative and absolute tolerance of a step. With those by default, a minute of undamped swinging keeps
        its energy to 1e-9 of the kinetic, and its loops closed to 1e-11 m.
    max_step : float, optional
        Longest step [s]. By default 2 ms where a function of time or of the state, other than
        `p3dof.Springs`, acts continuously, which could change for a moment between longer steps; else
        unlimited.
    stabilisation : float
        β of Baumgarte's stabilisation of the closures [1/s], for ``method="pinocchio"``.
    time_limit : float
        Longest time that the run may take on the clock [s], as estimated before it starts.

    Raises
    ------
    InputError
        If a number is not positive, `rtol` is below what rounding allows, or the stabilisation is too stiff.
    """

    rtol: float = 1e-11
    atol: float = 1e-13
    max_step: float | None = None
    stabilisation: float = 10.0
    time_limit: float = TIME_LIMIT

    def __post_init__(self) -> None:
        for name in ("rtol", "atol", "time_limit"):
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
        return otherwise if self.max_step is None else self.max_step
