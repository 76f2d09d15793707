"""What all engines have in common: their protocol, the check of their loops, the projection on them."""

from __future__ import annotations

import importlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, Readable, frozen_array, positive
from p3dof._base.errors import DynamicsError, InputError, MissingExtraError
from p3dof.closed_form import kinematics
from p3dof.machine import description
from p3dof.machine.description import Joint, JointLimits, Mechanism, Placement
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import PAPER, Parameters


def step_count(duration: float, step: float) -> int:
    """Return how many steps a duration has."""
    duration, step = positive("duration", duration, InputError), positive("step", step, InputError)
    count = round(duration / step)
    if count < 1 or abs(count * step - duration) > 1e-6 * step:
        raise InputError(f"step: expected one that divides the duration of {duration:g} s, got {step:g} s")
    return count


def check_machine(parameters: object) -> None:
    """Raise unless an engine can model a machine."""
    if not isinstance(parameters, Parameters):
        raise InputError(f"parameters: expected Parameters, got {type(parameters).__name__}")
    if parameters.friction:
        raise InputError(
            "parameters: expected a machine without friction, got some in "
            f"{', '.join(parameters.friction.joints)} (the engines model none)"
        )


def check_motion(motion: object) -> None:
    """Raise unless something is a motion."""
    require_motion(motion)


def library(module: str, engine: str) -> Any:
    """Return a module of an optional library."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"the engine {engine} needs its library: pip install 'p3dof[engines]'"
        ) from error


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """How an engine finds a frame to stand and move, in the axes of the fixed frame."""

    position: FloatArray  # (3,): its origin [m]
    rotation: FloatArray  # (3, 3): its axes, as columns
    velocity: FloatArray  # (6,): of the origin, then of the turning [m/s, rad/s, m/s², rad/s²]
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Sample:
    """What an engine says of one state of motion: ``load = B u + Jᵀ λ``, and how far its loops are open."""

    load: FloatArray
    """(n,): generalised forces that the motion takes without its constraints, the wrench taken off."""
    B: FloatArray  # (n, 3): generalised forces of a unit force of each actuator
    J: FloatArray  # (m, n): Jacobian of the engine's constraints; rows may be redundant
    gap: FloatArray
    """(k,): by how much constraints are violated in position, velocity and acceleration [m, m/s, m/s²]."""
    slip: FloatArray
    pull: FloatArray
    platform: FrameMotion  # the platform at P


@dataclass(frozen=True, eq=False)
class FinalState(Readable):
    """Where a simulation ended."""

    engine: str  # name of the engine
    duration: float  # simulated time and its step [s]
    step: float
    positions: Mapping[str, float]  # position of every joint of the description at the end [m or rad]
    seconds: float  # time that the integration took on the clock, without building the model [s]

    @property
    def speed(self) -> float:
        """Simulated time by time on the clock: 2 is twice as fast as reality."""
        return self.duration / self.seconds


def platform_motion(motion: Motion, k: int, depth: float) -> FrameMotion:
    """Return the frame at P at a sample of a motion."""
    y, z, theta = motion.pose[k]
    c, s = np.cos(theta), np.sin(theta)
    rates = []
    for dy, dz, turning in (motion.velocity[k], motion.acceleration[k]):
        rates.append(np.array([0.0, dy, dz, 0.0, turning, 0.0]))
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return FrameMotion(np.array([0.0, y, z - depth]), rotation, *rates)


CLOSED = 1e-9
"""Share of the machine's size, speed and acceleration by which an engine may find its loops open."""

FREEDOMS = 3
"""Freedoms of the closed mechanism, one for each actuator."""

_RANK = 1e-9
"""Relative size of the singular values that are zero."""


class Engine(ABC):
    """A machine in another engine."""

    name: ClassVar[str]
    """What the engine is called."""

    module: ClassVar[str]
    """The Python module of its library."""

    def __init__(self, parameters: Parameters = PAPER) -> None:
        check_machine(parameters)
        self._library = library(self.module, self.name)
        self._working = threading.Lock()  # there is one set of buffers
        self._parameters = parameters
        self._mechanism = self._described()
        self._slides = np.array([joint.kind == "prismatic" for joint in self._mechanism.moving])

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name} {self.version})"

    @property
    def parameters(self) -> Parameters:
        """The machine."""
        return self._parameters

    @property
    def version(self) -> str:
        """Version of the library."""
        return version(self.name)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the description."""
        return tuple(joint.name for joint in self._mechanism.moving)

    def forces(
        self, motion: Motion, wrench: WrenchOverTime = None, progress: Progress | None = None
    ) -> FloatArray:
        """Return the actuator forces over a motion, each sample on its own; ndarray, shape (N, 3).

        The joints' motion is that of `p3dof.closed_form.kinematics`; before it is used, the engine must find
        in its own model that every loop is closed and stays so, in position, velocity and acceleration, and
        that the platform is where the motion has it and moves as it should. Together, that leaves the joints
        no choice.
        """
        check_motion(motion)
        geometry, states = self.parameters.geometry, states_over(motion, wrench)
        loads = np.zeros((len(motion), 6)) if states.wrench is None else states.wrench
        found = kinematics.motion_at(geometry, kinematics.holdable(geometry, states))
        q, v, a = (
            np.stack([values[name] for name in self.joints], axis=-1)
            for values in (found.position, found.velocity, found.acceleration)
        )
        forces = np.empty((len(motion), FREEDOMS))
        for k in range(len(motion)):
            with self._working:
                sample = self._sample(q[k], v[k], a[k], loads[k])
            self._check(k, sample, motion, v[k], a[k])
            forces[k] = self._projected(sample)
            if progress is not None:
                progress(k + 1, len(motion))
        return forces

    @abstractmethod
    def simulate(self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike) -> FinalState:
        """Move the machine from rest under constant forces.

        Joints have no ends, actuators no limits and solids do not touch.
        """

    @abstractmethod
    def _sample(self, q: FloatArray, v: FloatArray, a: FloatArray, wrench: FloatArray) -> Sample:
        """Return the equations of motion at a state of the joints, in their order."""

    def _described(self) -> Mechanism:
        """Return the description that the model is made from."""
        return description.describe(self.parameters)

    def _start(
        self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike
    ) -> tuple[int, FloatArray, FloatArray]:
        """Return the number of steps, the joints at the start and the forces, checked."""
        pose = frozen_array("pose", pose, (3,))
        forces = frozen_array("forces", forces, (FREEDOMS,))
        joints = kinematics.inverse_kinematics(self.parameters.geometry, pose).joints
        return step_count(duration, step), np.array([float(joints[name]) for name in self.joints]), forces

    def _final(self, duration: float, step: float, q: FloatArray, seconds: float) -> FinalState:
        """Name what a simulation came to."""
        if not np.isfinite(q).all():
            raise DynamicsError(f"{self.name}: the simulation diverged at a step of {step:g} s")
        return FinalState(self.name, duration, step, dict(zip(self.joints, q.tolist(), strict=True)), seconds)

    def _check(self, k: int, sample: Sample, motion: Motion, v: FloatArray, a: FloatArray) -> None:
        """Raise unless the loops are closed and the platform moves as it should, in the engine's model."""
        L, arms = self.parameters.geometry.L, np.where(self._slides, 1.0, self.parameters.geometry.L)
        speed = float(np.abs(v * arms).max())
        rate = float(np.abs(a * arms).max() + speed**2 / L + np.abs(self.parameters.gravity).max())
        due = platform_motion(motion, k, self.parameters.geometry.h)
        found, reach = sample.platform, np.repeat([1.0, L], 3)
        off = {
            "position": (L, sample.gap, found.position - due.position, L * (found.rotation - due.rotation)),
            "velocity": (speed, sample.slip, reach * (found.velocity - due.velocity)),
            "acceleration": (rate, sample.pull, reach * (found.acceleration - due.acceleration)),
        }
        for what, (scale, loops, *platform) in off.items():
            for who, errors in (("its loops open", [loops]), ("the platform elsewhere", platform)):
                worst = max(float(np.abs(error).max()) for error in errors)
                if not worst <= CLOSED * scale:
                    raise DynamicsError(
                        f"{self.name}: sample {k}: finds {who} in {what} by {worst:.2g}, "
                        f"expected at most {CLOSED * scale:.2g} (SI units)"
                    )

    def _projected(self, sample: Sample) -> FloatArray:
        """Solve ``load = B u + Jᵀ λ`` for u."""
        A = np.hstack([sample.B, sample.J.T])
        if A.shape[0] == A.shape[1]:  # no row of J is redundant
            return np.asarray(np.linalg.solve(A, sample.load)[:FREEDOMS])
        _, sizes, rows = np.linalg.svd(sample.J)
        free = rows[np.count_nonzero(sizes > _RANK * sizes[0]) :]  # the directions that J leaves, (3, n)
        if len(free) != FREEDOMS:
            raise DynamicsError(f"{self.name}: expected {FREEDOMS} freedoms, found {len(free)}")
        return np.asarray(np.linalg.solve(free @ sample.B, free @ sample.load))


_ENDLESS = JointLimits(-1e9, 1e9, 1e9, 1e12)


def bare_mechanism(parameters: Parameters) -> Mechanism:
    """Return the description of a machine with masses for all links, without solids and without limits.

    With the dynamics of `p3dof.machine.description.describe`.
    """
    mechanism = description.with_masses(description.describe(parameters))
    joints = tuple(
        replace(joint, limits=None if joint.limits is None else _ENDLESS) for joint in mechanism.joints
    )
    links = tuple(replace(link, visuals=(), collisions=()) for link in mechanism.links)
    return replace(mechanism, joints=joints, links=links)


def _zeros() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """How a link frame stands and moves, in the axes of the root."""

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))  # (3, 3): its axes, as columns
    quaternion: FloatArray = field(default_factory=lambda: np.eye(4)[0])
    """(4,): the same, as Euler parameters, the scalar first; their sign is steady as joints move."""
    position: FloatArray = field(default_factory=_zeros)  # (3,): of its origin [m, m/s, m/s²]
    velocity: FloatArray = field(default_factory=_zeros)
    acceleration: FloatArray = field(default_factory=_zeros)
    omega: FloatArray = field(default_factory=_zeros)
    """(3,): angular velocity and acceleration [rad/s, rad/s²]."""
    epsilon: FloatArray = field(default_factory=_zeros)

    def quaternion_rates(self) -> tuple[FloatArray, FloatArray]:
        """Return the first and second time derivative of the quaternion, ṗ = ½ ω p, each of shape (4,)."""
        spin = np.append(0.0, self.omega)
        first = product(spin, self.quaternion) / 2
        return first, (product(np.append(0.0, self.epsilon), self.quaternion) + product(spin, first)) / 2


def link_motions(
    mechanism: Mechanism,
    q: FloatArray | None = None,
    v: FloatArray | None = None,
    a: FloatArray | None = None,
) -> dict[str, LinkMotion]:
    """Return the motion of every link, by its name."""
    rest = np.zeros(len(mechanism.moving))
    rates = np.column_stack([rest if values is None else values for values in (q, v, a)])
    given = {joint.name: row for joint, row in zip(mechanism.moving, rates, strict=True)}
    found = {mechanism.links[0].name: LinkMotion()}
    for joint in mechanism.joints:
        base = _fixed(found[joint.parent], joint.placement)
        found[joint.child] = base if joint.axis is None else _moved(base, joint, *given[joint.name])
    return found


def _fixed(link: LinkMotion, place: Placement) -> LinkMotion:
    """Return the motion of a frame fixed to a link."""
    arm = link.rotation @ place.position
    spin = cross(link.omega, arm)
    return LinkMotion(
        link.rotation @ place.rotation,
        product(link.quaternion, quaternion_of(place.rotation)),
        link.position + arm,
        link.velocity + spin,
        link.acceleration + cross(link.epsilon, arm) + cross(link.omega, spin),
        link.omega,
        link.epsilon,
    )


def _moved(base: LinkMotion, joint: Joint, q: float, v: float, a: float) -> LinkMotion:
    """Return the motion of a joint's child from that of the joint's frame."""
    axis = base.rotation @ np.asarray(joint.axis)
    omega, epsilon = base.omega, base.epsilon
    if joint.kind == "prismatic":
        arm = q * axis
        spin = cross(omega, arm)
        return LinkMotion(
            base.rotation,
            base.quaternion,
            base.position + arm,
            base.velocity + spin + v * axis,
            base.acceleration + cross(epsilon, arm) + cross(omega, spin + 2 * v * axis) + a * axis,
            omega,
            epsilon,
        )
    turn = np.append(np.cos(q / 2), np.sin(q / 2) * np.asarray(joint.axis))
    return LinkMotion(
        base.rotation @ rotation_of(turn),
        product(base.quaternion, turn),
        base.position,
        base.velocity,
        base.acceleration,
        omega + v * axis,
        epsilon + a * axis + cross(omega, v * axis),
    )


def carrier(mechanism: Mechanism, frame: str) -> tuple[str, Placement]:
    """Return the moving link or root that a frame is fixed to, and its place there."""
    place = Placement()
    while joint := mechanism.markers.get(frame):
        own = joint.placement
        place = Placement(own.position + own.rotation @ place.position, own.rotation @ place.rotation)
        frame = joint.parent
    return frame, place


def axis_frame(axis: FloatArray) -> FloatArray:
    """Return right-handed axes, as columns, of which the third is given, shape (3, 3)."""
    x = cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(axis, x), axis])


def homogeneous(place: Placement) -> FloatArray:
    """Return a placement as a homogeneous transformation, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = place.rotation, place.position
    return matrix


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the product of two quaternions, shape (4,)."""
    vector = p[0] * q[1:] + q[0] * p[1:] + cross(p[1:], q[1:])
    return np.append(p[0] * q[0] - p[1:] @ q[1:], vector)


def quaternion_of(rotation: FloatArray) -> FloatArray:
    """Return the Euler parameters of a rotation matrix, the scalar first and not negative, shape (4,)."""
    from scipy.spatial.transform import Rotation

    writable = np.array(rotation)  # SciPy 1.15 takes no other
    x, y, z, w = (float(value) for value in Rotation.from_matrix(writable).as_quat())
    found = np.array([w, x, y, z])
    return np.asarray(found if w >= 0 else -found)


def rotation_of(p: FloatArray) -> FloatArray:
    """Return the rotation matrix of Euler parameters, shape (3, 3)."""
    s, u = p[0], p[1:]
    U = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    return np.asarray(np.eye(3) + 2 * s * U + 2 * U @ U)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b, shape (3,): NumPy's own takes twenty times as long for one pair."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])
