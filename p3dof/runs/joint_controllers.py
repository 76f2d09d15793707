"""Controllers of the actuated joints of any robot: PD, feedforward, computed torque.

Each has a model of its own, which need not be the robot that it drives. What they ask of it is its hybrid
dynamics: forces for accelerations of the actuated joints, while passive freedoms move freely.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats, frozen_array, positive, require
from p3dof._base.errors import InputError, MotionError
from p3dof._base.files import Source, called, read_text
from p3dof._base.threads import Own
from p3dof._base.time_series.joint_files import JointCurve, read_joints
from p3dof._base.time_series.smoothing import Smooth
from p3dof._base.time_series.times import require_rising, rounding_told
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled.kept import require_fit
from p3dof.loops.tables import is_slide
from p3dof.runs.integration import CHECKED
from p3dof.runs.plants import CompiledStates


class JointReference:
    """Values, velocities and accelerations of the actuated joints at any time.

    Between its samples it is a spline of degree 7, whose velocities need not be zero at its ends; before the
    first sample and after the last one the joints rest there.

    Parameters
    ----------
    time : array-like, shape (N,)
        Rising times [s]; they count from the first one.
    values : array-like, shape (N, n_actuated)
        Of the joints [m or rad].
    smooth : float or "auto", optional
        For measured or rounded values, which the reference need not pass then, as of
        `p3dof.machine.motion.Motion.from_poses`; `curve.remarks` state what it does.

    Raises
    ------
    MotionError
        If shapes do not fit, a number is not finite, or times do not rise or are too coarse, as those of a
        clock that were rounded before the first one was subtracted.
    """

    def __init__(self, time: ArrayLike, values: ArrayLike, smooth: Smooth = None) -> None:
        times = frozen_array("time", time, ("N",), MotionError)
        if not len(times):
            raise MotionError("time: expected at least one sample, got none")
        require_rising("time", times)
        times, first = times - times[0], float(times[0])
        rounded = rounding_told(times, first)
        if rounded and smooth is None:
            raise MotionError(f"time: {rounded}")
        rows = frozen_array("values", values, (len(times), "n"), MotionError)
        self.curve = JointCurve(times, rows, smooth=smooth)
        with np.errstate(all="ignore"):
            found = self.curve.at(times)
        if not all(np.isfinite(array).all() for array in found):
            raise MotionError("values: too large or too near in time for finite velocities and accelerations")

    @classmethod
    def from_csv(cls, loop: ClosedLoopModel, path: Source, smooth: Smooth = None) -> JointReference:
        """Read a motion of the actuated joints: CSV with ``t`` and their names, see the file formats.

        Parameters
        ----------
        loop : ClosedLoopModel
            The robot.
        path : path-like or stream
            The file.
        smooth : float or "auto", optional
            As of the class.

        Raises
        ------
        MotionError, FileError
            If the file cannot be read or does not fit the robot.
        """
        sliding = [is_slide(loop, loop.model.getJointId(name)) for name in loop.actuated]
        others = list(loop.model.names)
        curve = read_joints(read_text(path), called(path), loop.actuated, sliding, others=others)
        return cls(curve.time, curve.values, smooth)

    @classmethod
    def standing(cls, values: ArrayLike) -> JointReference:
        """Return a reference that stays at values (n_actuated,) of the joints [m or rad]."""
        return cls([0.0], frozen_array("values", values, ("n",))[None])

    @property
    def duration(self) -> float:
        """How long it moves [s]."""
        return float(self.curve.time[-1])

    @property
    def step(self) -> float:
        """The mean step between its samples [s]; infinite if there is one only."""
        return self.duration / (len(self.curve.time) - 1) if len(self.curve.time) > 1 else np.inf

    @property
    def size(self) -> int:
        """Of how many joints it is."""
        return int(self.curve.values.shape[1])

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return values, velocities and accelerations (n_actuated,) at a time since its beginning [s]."""
        values, velocities, accelerations = self.over(np.array([time]))
        return values[0], velocities[0], accelerations[0]

    def over(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return values, velocities and accelerations (N, n_actuated) at times (N,) since its beginning."""
        inside = np.clip(times, 0.0, self.duration)
        found = self.curve.at(inside)
        slack = 1e-12 * max(1.0, self.duration)
        moving = ((times >= -slack) & (times <= self.duration + slack))[:, None]
        values, velocities, accelerations = found
        return values, np.where(moving, velocities, 0.0), np.where(moving, accelerations, 0.0)


def reference_of(loop: ClosedLoopModel, given: JointReference | ArrayLike) -> JointReference:
    """Return a reference of a robot's actuated joints: one that is given, or values (n,) that stay."""
    require("loop", loop, ClosedLoopModel)
    reference = given if isinstance(given, JointReference) else JointReference.standing(given)
    if reference.size != len(loop.actuated):
        raise InputError(
            f"reference: expected values of the {len(loop.actuated)} actuated joints, got {reference.size}"
        )
    return reference


_SEEN = 1e-9  # share of the largest motion of a motor below which one follows from the others


class RobotMeasurement(NamedTuple):
    """What a controller of a robot sees.

    Parameters
    ----------
    time : float
        Since the start of the run [s].
    positions, velocities : (n,) array
        Of the actuated joints [m or rad, and per second], noise included.
    period : float
        How long the forces will be held [s]; zero if the controller acts continuously.
    saturated : (n,) array of bool
        Which of the forces that it gave last were cut off.
    q : (nq,) array
        Configuration of all joints, exactly: what a simulation knows, and a machine would have to estimate.
    v : (nv,) array
        Velocities of all joints, likewise.
    """

    time: float
    positions: FloatArray
    velocities: FloatArray
    period: float
    saturated: NDArray[np.bool_]
    q: FloatArray
    v: FloatArray


class JointPD:
    """PD feedback at each actuated joint: τ = kp (r - p) + kd (ṙ - ṗ), and the forces of rest on request.

    The error of a continuous joint is taken by the shorter way.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    reference : JointReference or (n_actuated,) array
        What to follow, or where to stay [m or rad].
    kp, kd : float or (n_actuated,) array
        Gains [N/m or N m/rad, and per second].
    gravity : bool
        Add what holds the robot at rest where it is, against gravity and springs.
    compiled : CompiledLoop, optional
        The same robot compiled, for those forces; not used where there are more actuators than freedoms.

    Raises
    ------
    InputError
        If an argument does not fit, or a gain is negative.
    """

    def __init__(
        self,
        loop: ClosedLoopModel,
        reference: JointReference | ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike = 0.0,
        gravity: bool = False,
        compiled: CompiledLoop | None = None,
    ) -> None:
        self.reference = reference_of(loop, reference)
        self.loop = loop.copy()
        count = len(loop.actuated)
        self.kp, self.kd = _gains("kp", kp, count), _gains("kd", kd, count)
        self.gravity = bool(gravity)
        self._states: Own[CompiledStates] | None = None
        if compiled is not None:
            require_fit(loop, compiled, name="compiled")
            if compiled.hybrid:
                self._states = Own(partial(CompiledStates, compiled, "hybrid_dynamics"))
        joints = [loop.model.getJointId(name) for name in loop.actuated]
        self._circles = np.array([loop.model.nqs[joint] == 2 for joint in joints], dtype=bool)
        self._chosen: list[int] | None = None

    @property
    def longest_step(self) -> float:
        """Longest step of an integrator that sees all of it, if it acts continuously [s]."""
        return self.reference.step

    def __call__(self, measured: RobotMeasurement) -> FloatArray:
        """Return the forces [N or N m]."""
        forces = self.feedback(measured)
        if self.gravity:
            at_rest = np.zeros(self.loop.model.nv)
            forces = forces + self.inverse_model(measured.q, at_rest, np.zeros(len(forces)))
        return forces

    def feedback(self, measured: RobotMeasurement) -> FloatArray:
        """Return what the errors of the actuated joints ask for, kp e + kd ė."""
        values, velocities, _ = self.reference.at(measured.time)
        error = values - measured.positions
        turned = np.arctan2(np.sin(error), np.cos(error))
        error = np.where(self._circles, turned, error)
        return np.asarray(self.kp * error + self.kd * (velocities - measured.velocities))

    def inverse_model(self, q: FloatArray, v: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the forces for accelerations (n_actuated,) of the actuated joints, by the model.

        Of joints that cannot be chosen freely, as there are more motors than motions, some follow the others;
        the forces are the least ones then.
        """
        if self._states is not None:
            found = self._states.here(q, v, acceleration, np.zeros(0), "tau")
            if found is not None:
                return found
        if self._chosen is None:
            self._chosen = independent(self.loop, q)
        if len(self._chosen) == len(acceleration):
            return self.loop.hybrid_dynamics(q, v, acceleration).tau
        names = self.loop.actuated
        return self.loop.hybrid_dynamics(q, v, {names[i]: acceleration[i] for i in self._chosen}).tau


class JointFeedforward(JointPD):
    """Known forces along a motion, such as those of an inverse-dynamics run, plus PD feedback.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    reference : JointReference or (n_actuated,) array
        What to follow.
    time : (N,) array
        Times of the forces since the start of the run [s].
    forces : (N, n_actuated) array
        Of the actuated joints [N or N m]; linear in between, constant before and after.
    kp, kd : float or (n_actuated,) array
        Gains, as of `JointPD`.

    Raises
    ------
    InputError, MotionError
        If an argument does not fit.
    """

    def __init__(
        self,
        loop: ClosedLoopModel,
        reference: JointReference | ArrayLike,
        time: ArrayLike,
        forces: ArrayLike,
        kp: ArrayLike = 0.0,
        kd: ArrayLike = 0.0,
    ) -> None:
        super().__init__(loop, reference, kp, kd)
        self.time = frozen_array("time", time, ("N",))
        self.forces = frozen_array("forces", forces, (len(self.time), len(loop.actuated)))
        if not len(self.time) or (np.diff(self.time) <= 0).any():
            raise InputError("time: expected rising times of the forces")

    @property
    def longest_step(self) -> float:
        """Longest step of an integrator that sees all of it, if it acts continuously [s]."""
        return min(self.reference.step, CHECKED)

    def __call__(self, measured: RobotMeasurement) -> FloatArray:
        """Return the forces [N or N m]: those of the middle of the time for which they are held."""
        now = measured.time + measured.period / 2
        forward = np.array([np.interp(now, self.time, column) for column in self.forces.T])
        return forward + self.feedback(measured)


class JointComputedTorque(JointPD):
    """Hybrid dynamics in the loop: each actuated joint follows its reference as ë + kd ė + kp e = 0.

    The forces are those that the model needs for accelerations r̈ + kd (ṙ - ṗ) + kp (r - p); passive freedoms
    move as they must. It reads the state of all joints.

    Parameters
    ----------
    loop : ClosedLoopModel
        The model that the forces are computed from; it may differ from the robot.
    reference : JointReference or (n_actuated,) array
        What to follow.
    kp, kd : float or (n_actuated,) array
        Gains [1/s², 1/s].
    compiled : CompiledLoop, optional
        The same model compiled, for its hybrid dynamics.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __init__(
        self,
        loop: ClosedLoopModel,
        reference: JointReference | ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike = 0.0,
        compiled: CompiledLoop | None = None,
    ) -> None:
        super().__init__(loop, reference, kp, kd, compiled=compiled)

    def __call__(self, measured: RobotMeasurement) -> FloatArray:
        """Return the forces [N or N m]; the reference is that of the middle of their hold."""
        _, _, acceleration = self.reference.at(measured.time + measured.period / 2)
        return self.inverse_model(measured.q, measured.v, acceleration + self.feedback(measured))


def gains(frequency: float, damping: float = 1.0) -> tuple[float, float]:
    """Return kp = ω² [1/s²] and kd = 2 ζ ω [1/s] of a feedback.

    Parameters
    ----------
    frequency : float
        ω / 2π [Hz].
    damping : float
        ζ; 1 is critical.

    Raises
    ------
    InputError
        If a number is not positive.
    """
    omega = 2 * math.pi * positive("frequency", frequency, InputError)
    return omega**2, 2 * positive("damping", damping, InputError) * omega


def independent(loop: ClosedLoopModel, q: ArrayLike) -> list[int]:
    """Return the indices, rising, of actuated joints that can be chosen freely."""
    from scipy.linalg import qr

    N = _free_motions(loop, q)
    _, R, order = qr(N[loop.actuated_v].T, mode="economic", pivoting=True)
    size = np.abs(np.diag(R))
    return sorted(int(i) for i in order[: np.count_nonzero(size > _SEEN * size.max(initial=0.0))])


def _free_motions(loop: ClosedLoopModel, q: ArrayLike) -> FloatArray:
    """Return an orthonormal basis (nv, mobility) of the motions that keep the loops closed."""
    J, rank = loop.closure_jacobian(q), loop.rank(q)
    return np.asarray(np.linalg.svd(J, full_matrices=True)[2][rank:].T)


def moved_inertia(loop: ClosedLoopModel, q: ArrayLike) -> FloatArray:
    """Return what each actuated joint has to move, the others standing still: gains of a PD are multiples.

    With more motors than motions the others cannot stand still; they move freely then.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    q : (nq,) array
        Configuration, with closed loops.

    Returns
    -------
    (n_actuated,) array
        Force for a unit of acceleration [kg or kg m²]; passive freedoms move freely.

    Raises
    ------
    DynamicsError, SingularityError, InputError
        As `ClosedLoopModel.hybrid_dynamics`.
    """
    count, still = len(loop.actuated), np.zeros(loop.model.nv)
    if len(independent(loop, q)) < count:
        N = _free_motions(loop, q)
        M = np.array(pin.crba(loop.model, loop.model.createData(), np.asarray(q, dtype=float)))
        M = np.triu(M) + np.triu(M, 1).T
        B = N[loop.actuated_v]
        return np.asarray(1.0 / np.einsum("ij,ij->i", B, np.linalg.solve(N.T @ M @ N, B.T).T))
    at_rest = loop.hybrid_dynamics(q, still, np.zeros(count)).tau
    found = [loop.hybrid_dynamics(q, still, row).tau[i] for i, row in enumerate(np.eye(count))]
    return np.asarray(found - at_rest)


def _gains(name: str, value: ArrayLike, count: int) -> FloatArray:
    array = as_floats(name, value)
    if array.shape not in ((), (1,), (count,)):
        raise InputError(f"{name}: expected one number or {count}, one an actuated joint, got {array.size}")
    array = frozen_array(name, np.broadcast_to(array, count), (count,))
    if (array < 0).any():
        raise InputError(f"{name}: expected zero or more, got {array.tolist()}")
    return array
