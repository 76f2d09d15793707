"""Controllers: springs, PD and PID at the sliders, feedforward of the inverse model, computed torque.

All models in them are `Parameters` of their own, which need not be those of the machine that they drive.

References
----------
R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, CRC Press 1994, 4.5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, as_floats, batch_of, frozen_array, positive, shown
from p3dof._base.errors import InputError
from p3dof._base.threads import OneThread
from p3dof._base.time_series.smoothing import hermite
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled.kernels import pose_at
from p3dof.machine.motion import Motion, states_of
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import Geometry, Parameters
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.runs.machine_plants import Equations


@dataclass(frozen=True, eq=False)
class Measurement(Readable):
    """What a controller knows: what encoders on the sliders tell.

    Parameters
    ----------
    time : float
        Time since the start of the run [s].
    period : float
        How long the forces will be held [s]; zero if the controller acts continuously.
    sliders, slider_velocities : ndarray, shape (3,)
        Of A, B, C [m, m/s], noise included.
    saturated : ndarray of bool, shape (3,)
        Which of the forces that it gave last were cut off at the limits.
    geometry : Geometry
        Lengths of the machine, for the forward kinematics.
    """

    time: float
    period: float
    sliders: FloatArray
    slider_velocities: FloatArray
    saturated: NDArray[np.bool_]
    geometry: Geometry

    @classmethod
    def made(
        cls,
        geometry: Geometry,
        time: float,
        period: float,
        sliders: FloatArray,
        slider_velocities: FloatArray,
        saturated: NDArray[np.bool_],
    ) -> Measurement:
        """Return one sooner than the constructor does: there is one a tick."""
        found = object.__new__(cls)
        found.__dict__.update(
            time=time,
            period=period,
            sliders=sliders,
            slider_velocities=slider_velocities,
            saturated=saturated,
            geometry=geometry,
        )
        return found

    @cached_property
    def pose(self) -> FloatArray:
        """Pose by forward kinematics of the sliders, shape (3,), in the working mode.

        Sliders do not tell on which side of a singular pose (det J = 0) the platform is: behind one this is
        another pose than the machine's.
        """
        return pose_at(self.geometry, self.sliders)

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocity of the pose, from that of the sliders, shape (3,)."""
        J = kinematics.inverse_jacobian(self.geometry, self.pose)
        return np.asarray(np.linalg.solve(J, self.slider_velocities))

    # As of any robot, so that controllers of its joints drive the machine too.

    @property
    def positions(self) -> FloatArray:
        """Of the actuated joints, shape (3,) [m]: `sliders`."""
        return self.sliders

    @property
    def velocities(self) -> FloatArray:
        """Of the actuated joints, shape (3,) [m/s]: `slider_velocities`."""
        return self.slider_velocities

    @cached_property
    def q(self) -> FloatArray:
        """Positions of all joints at `pose`, shape (10,) [m or rad]."""
        return self._joints[0]

    @cached_property
    def v(self) -> FloatArray:
        """Velocities of all joints, shape (10,) [m/s or rad/s]."""
        return self._joints[1]

    @cached_property
    def _joints(self) -> tuple[FloatArray, FloatArray]:
        moving = kinematics.mechanism_motion(self.geometry, self.pose, self.velocity, np.zeros(3))
        return np.array([*moving.position.values()]), np.array([*moving.velocity.values()])


class Controller(Protocol):
    """Anything that can be called with a `Measurement` and returns the forces of A, B, C [N], shape (3,).

    A method ``reset()`` is called before a run if there is one; an attribute ``motion`` is taken as what the
    run should follow; a true attribute ``autonomous`` says that the forces depend on the state alone, so that
    a continuous run can take steps as long as its accuracy allows. A continuous controller is also called at
    trial times that are not kept: it should not count its calls.
    """

    def __call__(self, measured: Measurement, /) -> ArrayLike:
        """Return the forces of the actuators [N]."""


ControllerLike: TypeAlias = "Controller | Callable[[Measurement], ArrayLike] | ArrayLike | None"
"""A controller, constant forces (3,), or None for none at all."""


class Reference:
    """Pose, velocity and acceleration of a motion at any time, by quintic Hermite interpolation.

    Before its first sample and after its last one the motion rests there.

    Parameters
    ----------
    motion : Motion
        The motion; its time counts from its first sample.

    Raises
    ------
    InputError
        If it is not a `Motion`.
    """

    def __init__(self, motion: Motion) -> None:
        require_motion(motion)
        self.motion = motion
        self._curves: list[Any] = []
        if len(motion) > 1:
            from scipy.interpolate import PPoly

            time = motion.time - motion.time[0]
            curve = PPoly.from_bernstein_basis(
                hermite(time, motion.pose, motion.velocity, motion.acceleration)
            )
            self._curves = [curve, curve.derivative(), curve.derivative(2)]

    @property
    def curve(self) -> Any:
        """The poses as SciPy's ``PPoly``, from time zero; None if there is only one."""
        return self._curves[0] if self._curves else None

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return pose, velocity and acceleration at a time, each of shape (3,).

        Parameters
        ----------
        time : float
            Time since the beginning of the motion [s].
        """
        if time < 0 or not self._curves:
            return self.motion.pose[0], np.zeros(3), np.zeros(3)
        if time > self.motion.duration * (1 + 1e-14):
            return self.motion.pose[-1], np.zeros(3), np.zeros(3)
        inside = min(time, self.motion.duration)
        pose, velocity, acceleration = (np.asarray(curve(inside)) for curve in self._curves)
        return pose, velocity, acceleration

    def over(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return poses, velocities and accelerations at times since the beginning (N,), shape (N, 3) each."""
        pose, velocity, acceleration = (self.derivative(times, order) for order in range(3))
        return pose, velocity, acceleration

    def derivative(self, times: FloatArray, order: int) -> FloatArray:
        """Return one of them at times (N,), shape (N, 3): poses, velocities, accelerations are 0, 1, 2."""
        before, after = times < 0, times > self.motion.duration * (1 + 1e-14)
        if self._curves:
            found = np.asarray(self._curves[order](np.clip(times, 0.0, self.motion.duration)))
        else:
            found = np.zeros((len(times), 3)) + (self.motion.pose[0] if order == 0 else 0.0)
        found[before] = self.motion.pose[0] if order == 0 else 0.0
        found[after] = self.motion.pose[-1] if order == 0 else 0.0
        return found

    def poses(self, times: FloatArray) -> FloatArray:
        """Return the poses at times since the beginning, shape (N, 3)."""
        return self.derivative(times, 0)


_HOME = np.zeros(3)

_HUGE = 1e3  # forces by so much larger than the weight make one look whether the pose is singular


class Springs:
    """Linear springs and dampers between the guides and the sliders, instead of drives.

    Parameters
    ----------
    stiffness : array-like, shape () or (3,)
        Of the springs at A, B, C [N/m].
    rest : array-like, shape () or (3,)
        Slider positions at which they are free of force [m].
    damping : array-like, shape () or (3,)
        Of the dampers [N s/m].
    preload : array-like, shape () or (3,)
        Forces at `rest` [N].

    Raises
    ------
    InputError
        If an argument does not fit, or a stiffness or damping is negative.
    """

    autonomous = True

    def __init__(
        self, stiffness: ArrayLike, rest: ArrayLike = 0.0, damping: ArrayLike = 0.0, preload: ArrayLike = 0.0
    ) -> None:
        self.stiffness, self.rest = _each("stiffness", stiffness), _each("rest", rest)
        self.damping, self.preload = _each("damping", damping), _each("preload", preload)
        for name in ("stiffness", "damping"):
            if getattr(self, name).min() < 0:
                raise InputError(f"{name}: expected zero or more, got {getattr(self, name).tolist()}")

    def __call__(self, measured: Measurement) -> FloatArray:
        """Return the forces of the springs [N]."""
        stretched = self.stiffness * (measured.sliders - self.rest)
        return self.preload - stretched - self.damping * measured.slider_velocities

    def energy(self, sliders: ArrayLike) -> FloatArray:
        """Return the energy in the springs, shape (...), for slider positions (..., 3) [J].

        Of the preload it counts the potential, which is zero at `rest`.
        """
        stretch = batch_of("sliders", sliders, 3) - self.rest
        return np.asarray(np.sum(stretch * (self.stiffness * stretch / 2 - self.preload), axis=-1))


class PD:
    """PD or PID feedback at each slider, plus the forces that hold the machine at home.

    f = f_home + K (λ_d - λ) + D (λ̇_d - λ̇) + K/T ∫(λ_d - λ) dt

    K = ω² m and D = 2 ζ ω m with what each slider has to move at home, m = diag (J⁻ᵀ M J⁻¹): ω is that of a
    slider alone, the coordinates y, z, θ swing a little slower or faster.

    Parameters
    ----------
    model : Parameters or Manipulator
        What the gains and the forces at home are computed from.
    motion : Motion
        What to follow.
    frequency : float
        ω / 2π [Hz].
    damping : float
        ζ; 1 is critical.
    integral_time : float
        T [s]; infinite for no integral. An axis does not integrate while its force is cut off.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __init__(
        self,
        model: Any,
        motion: Motion,
        frequency: float = 5.0,
        damping: float = 1.0,
        integral_time: float = math.inf,
    ) -> None:
        self.reference = Reference(motion)
        self.model = _parameters(model)
        self.equations = Equations(self.model)
        self.omega = 2 * math.pi * positive("frequency", frequency, InputError)
        self.zeta = positive("damping", damping, InputError)
        endless = isinstance(integral_time, float) and integral_time == math.inf
        self.integral_time = math.inf if endless else positive("integral_time", integral_time, InputError)
        J = kinematics.inverse_jacobian(self.model.geometry, _HOME)
        dynamics = VirtualPowerMethod(self.model)
        inverse = np.linalg.inv(J)
        self.moved = np.diag(inverse.T @ dynamics.mass_matrix(states_of(_HOME)) @ inverse)
        self.holding = dynamics.forces(states_of(_HOME))
        gravity = max(9.81, float(np.abs(self.model.gravity).max()))
        moving = self.model.bodies.mass + float(self.model.actuators.inertia.sum())
        self.huge = _HUGE * moving * gravity
        self._integral = np.zeros(3)
        self._mine = OneThread("the integral of this controller, give each run its own")

    @property
    def motion(self) -> Motion:
        """What it follows."""
        return self.reference.motion

    def reset(self) -> None:
        """Forget the integral of the error; from now on it is that of this thread's run."""
        self._mine.give()
        self._integral = np.zeros(3)

    def __call__(self, measured: Measurement) -> FloatArray:
        """Return the forces [N]."""
        return self.holding + self.feedback(measured)

    def feedback(self, measured: Measurement) -> FloatArray:
        """Return what the errors at the sliders ask for [N]."""
        pose, velocity, _ = self.reference.at(measured.time)
        try:
            wanted = self.equations.sliders(*pose.tolist(), *velocity.tolist())
        except (ValueError, ArithmeticError):  # the checked way says which leg does not reach
            sliders = kinematics.inverse_kinematics(self.model.geometry, pose).sliders
            rates = kinematics.inverse_jacobian(self.model.geometry, pose) @ velocity
            wanted = (*sliders.tolist(), *rates.tolist())
        error, rate = wanted[:3] - measured.sliders, wanted[3:] - measured.slider_velocities
        integral = self._integrated(error, measured, measured.saturated)
        return self.moved * (self.omega**2 * (error + integral) + 2 * self.zeta * self.omega * rate)

    def _integrated(self, error: FloatArray, measured: Measurement, frozen: Any) -> FloatArray:
        """Return ∫ error dt / T, and go on integrating."""
        if self.integral_time == math.inf:
            return self._integral
        if not measured.period:
            raise InputError("integral_time: an integral needs a control rate, this run is continuous")
        self._mine.check()
        self._integral = self._integral + np.where(frozen, 0.0, error * measured.period / self.integral_time)
        return self._integral

    def inverse_model(self, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the forces that a motion takes by the model [N]."""
        try:
            found = np.array(
                self.equations.forces(*pose.tolist(), *velocity.tolist(), *acceleration.tolist())
            )
        except (ValueError, ArithmeticError):
            found = np.full(3, np.nan)
        if np.all(np.abs(found) < self.huge):
            return found
        # It says what is wrong, if it is.
        return VirtualPowerMethod(self.model).forces(states_of(pose, velocity, acceleration))


class Feedforward(PD):
    """The forces that the model needs for the wanted motion, plus PD or PID feedback at the sliders.

    Between two calls the forces are held: the forward part is that of the middle of this time.

    Parameters
    ----------
    model : Parameters or Manipulator
        What the forces are computed from; it may differ from the machine that is controlled.
    motion, frequency, damping, integral_time
        As of `PD`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __call__(self, measured: Measurement) -> FloatArray:
        """Return the forces [N]."""
        wanted = self.reference.at(measured.time + measured.period / 2)
        return self.inverse_model(*wanted) + self.feedback(measured)


class ComputedTorque(PD):
    """Inverse dynamics in the loop: the machine behaves as three independent masses on springs and dampers.

    The pose is computed from the sliders. The forces are what the model needs there for the acceleration
    ẍ_d + 2 ζ ω (ẋ_d - ẋ) + ω² (x_d - x + ∫(x_d - x) dt / T). Between two calls the forces are held: pose,
    velocity and wanted acceleration are then those of the middle of this time.

    Parameters
    ----------
    model, motion, frequency, damping, integral_time
        As of `Feedforward`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __call__(self, measured: Measurement) -> FloatArray:
        """Return the forces [N]."""
        pose = pose_at(self.model.geometry, measured.sliders)
        J = np.reshape(self.equations.jacobian(*pose.tolist()), (3, 3))
        velocity = np.linalg.solve(J, measured.slider_velocities)
        half = measured.period / 2
        wanted, wanted_velocity, _ = self.reference.at(measured.time)
        _, _, acceleration = self.reference.at(measured.time + half)
        error = wanted - pose
        integral = self._integrated(error, measured, measured.saturated.any())  # each force moves all of x
        correction = self.omega**2 * (error + integral)
        correction = correction + 2 * self.zeta * self.omega * (wanted_velocity - velocity)
        ahead = pose + half * (velocity + half / 2 * acceleration)
        if not kinematics.singularity(self.model.geometry, ahead).serial.min() > 0:
            ahead = pose  # the middle of the hold is beyond reach
        return self.inverse_model(ahead, velocity + half * acceleration, acceleration + correction)


def _each(name: str, value: ArrayLike) -> FloatArray:
    array = as_floats(name, value)
    one = array.ndim == 0
    return frozen_array(name, np.full(3, frozen_array(name, array, ())) if one else array, (3,))


def _parameters(model: Any) -> Parameters:
    parameters = getattr(model, "parameters", model)
    if not isinstance(parameters, Parameters):
        raise InputError(f"model: expected Parameters or a Manipulator, got {shown(model)}")
    return parameters


CONTROLLERS = {"pd": PD, "feedforward": Feedforward, "computed-torque": ComputedTorque}
"""What follows a motion."""
