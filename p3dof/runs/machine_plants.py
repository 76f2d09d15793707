"""The machine as a plant: in y, z, θ by its own equations, or in all joints with closures; and its limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from p3dof._base.algebra import Scalar, Vector, apply_transposed, dot
from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.samples import unit_hint
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof._base.tracing import Tape, straight_line
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import MachineKernels
from p3dof.closed_form.compiled.kernels import losses_of_state
from p3dof.closed_form.kinematics import reachable_poses
from p3dof.closed_form.kinematics.validity import reach_margins
from p3dof.closed_form.paper.formulas import Lengths, configuration, jacobian
from p3dof.closed_form.paper.friction import Actuation, actuation_of, losses_of
from p3dof.closed_form.paper.virtual_power import actuator_forces, generalized_forces
from p3dof.machine.parameters import LEGS, PLATFORM, Geometry, Parameters
from p3dof.machine.parameters.body import inertials, numbers
from p3dof.methods import JointStates
from p3dof.runs.margins import Event, EventMargins, Stop
from p3dof.runs.plants import ConstrainedPlant, Plant
from p3dof.runs.settings import KINDS

if TYPE_CHECKING:  # only `MachineJoints` needs Pinocchio, and imports it
    from p3dof.loops import ClosedLoopModel

HORIZONTAL = 1e-3  # a leg is at its reach when its drop is this share of its length: .06° from horizontal

_REACH = slice(8, 11)  # where the legs' reach is among the margins
_LIMITS = 12


class Limiter:
    """How far a pose is from everything that can end a run; not positive is beyond it."""

    def __init__(self, parameters: Parameters, stop_at: Sequence[str]) -> None:
        kinds = [stop_at] if isinstance(stop_at, str) or not isinstance(stop_at, Iterable) else list(stop_at)
        unknown = [kind for kind in kinds if kind not in KINDS]
        if unknown or isinstance(stop_at, str):
            raise InputError(f"stop_at: expected a list of {', '.join(KINDS)}, got {shown(stop_at)}")
        self._geometry = parameters.geometry
        limits = parameters.limits
        self._values = _values(parameters.geometry)
        low, high = limits.travel
        down, up = limits.tilt
        names = [("slider stop", f"slider {leg} at its lower end, {low:g} m") for leg in LEGS]
        names += [("slider stop", f"slider {leg} at its upper end, {high:g} m") for leg in LEGS]
        names += [("tilt limit", f"the platform at {angle:g} rad") for angle in (down, up)]
        names += [("reach limit", f"leg {leg} horizontal") for leg in LEGS]
        names += [("singular pose", "the sliders cannot hold the platform's rotation (det J = 0)")]
        self._names = names
        counted = np.array([kind in kinds or kind == "reach limit" for kind, _ in names])
        self._offset = np.where(counted, 0.0, np.inf)
        self._bounds = np.array([low] * 3 + [high] * 3 + [down, up] + [HORIZONTAL] * 3 + [0.0])
        self._sign = np.array([1.0] * 3 + [-1.0] * 3 + [1.0, -1.0] + [1.0] * 4)
        self._sides = {
            side: tuple(
                zip(
                    self._bounds.tolist(),
                    [*self._sign.tolist()[:-1], side],
                    self._offset.tolist(),
                    strict=True,
                )
            )
            for side in (-1.0, 1.0)
        }

    def started(self, pose: FloatArray, drops: FloatArray | None = None) -> tuple[Limiter, float]:
        """Return the limiter of a run from a pose (3,), and its side of the singular pose: 1 or -1."""
        try:
            values = self._values(*pose.tolist())
        except (ValueError, ArithmeticError):
            reachable_poses(self._geometry, pose, "raise")
            raise
        side = math.copysign(1.0, values[-1] or 1.0)
        found = self if self._sign[-1] == side else self._other
        near = drops is not None
        for value, (bound, sign, offset) in zip(values, self._sides[side], strict=True):
            near |= not sign * (value - bound) + offset > 0
        if near:
            if drops is None:
                reachable_poses(self._geometry, pose, "raise")
            margins = found(pose, drops)
            if margins.min() <= 0:
                kind, reason = self._names[int(np.argmin(margins))]
                y, z, theta = pose
                told = f"pose (y = {y:g} m, z = {z:g} m, theta = {theta:g} rad)"
                g = self._geometry
                hint = unit_hint(pose, 4 * (g.L - g.R + g.r))
                raise InputError(f"{told}: the run would start beyond a limit: {kind}: {reason}{hint}")
        return found, side

    @cached_property
    def _other(self) -> Limiter:
        """The same on the other side of the singular pose."""
        other = copy(self)
        other._sign = self._sign * np.array([1.0] * (_LIMITS - 1) + [-1.0])
        return other

    def __call__(self, pose: FloatArray, drops: FloatArray | None = None) -> FloatArray:
        """Return the margins of a pose (3,): positive inside, shape (12,).

        A mechanism that is integrated in its joints can swing a leg through the horizontal, where its pose
        turns back: its `drops` (3,), shares of the legs' lengths, then tell, being negative beyond.
        """
        try:
            values = np.array(self._values(*pose.tolist()))
        except (ValueError, ArithmeticError):  # beyond reach there are no angles
            margins = np.full(len(self._names), np.inf)
            margins[_REACH] = np.minimum(reach_margins(self._geometry, pose), 0.0)
            return margins
        if drops is not None:
            values[_REACH] = drops
        return np.asarray(self._sign * (values - self._bounds) + self._offset)

    @property
    def watched(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bounds, signs and whether they count, shape (12,): margins are sign (value - bound)."""
        return self._bounds, self._sign, (self._offset == 0).astype(float)

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        kind, reason = self._names[index]
        return Stop(kind, time, reason)


@lru_cache(maxsize=64)
def _values(geometry: Geometry) -> Callable[..., tuple[float, ...]]:
    """Return what has limits, of a pose."""
    lengths = Lengths.of(geometry)

    def formula(tape: Tape, *pose: Scalar) -> list[Scalar]:
        x = configuration(lengths, (pose[0], pose[1], pose[2]), tape)
        return [*x.sliders, *x.sliders, pose[2], pose[2], x.cos_a, x.cos_b, x.cos_c, x.cos_54]

    return straight_line(formula, 3)


Compiled: TypeAlias = Callable[..., tuple[float, ...]]

_REST: Vector = (0, 0, 0)
_AXES: tuple[Vector, ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


class Equations:
    """Kinematics, inverse and forward dynamics of one machine; as `p3dof.methods.closed_form`.

    Each is a function of numbers that returns a tuple of numbers, compiled when it is first used. Outside of
    reach they raise ValueError or ZeroDivisionError, as `math` does.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._lengths = Lengths.of(parameters.geometry)
        self._bodies = inertials(parameters.bodies)
        self._gravity = numbers(parameters.gravity)
        self._losses = losses_of(parameters.friction)
        self._actuation = actuation_of(parameters.actuators, parameters.gravity)
        self._parameters = parameters

    def __reduce__(self) -> tuple[type[Equations], tuple[Parameters]]:
        return Equations, (self._parameters,)  # compiled functions are not for other processes

    @cached_property
    def sliders(self) -> Compiled:
        """(pose 3, velocity 3) → slider positions 3 [m] and velocities 3 [m/s]."""

        def formula(tape: Tape, *symbols: Scalar) -> list[Scalar]:
            x = configuration(self._lengths, symbols[:3], tape)
            J = jacobian(self._lengths, x)
            return [*x.sliders, *(dot(row, symbols[3:]) for row in J)]

        return straight_line(formula, 6)

    @cached_property
    def jacobian(self) -> Compiled:
        """(pose 3) → ∂(λA, λB, λC)/∂(y, z, θ) row by row, 9."""

        def formula(tape: Tape, *symbols: Scalar) -> list[Scalar]:
            J = jacobian(self._lengths, configuration(self._lengths, symbols, tape))
            return [entry for row in J for entry in row]

        return straight_line(formula, 3)

    @cached_property
    def forces(self) -> Compiled:
        """(pose 3, velocity 3, acceleration 3) → actuator forces 3 [N]."""

        def formula(tape: Tape, *symbols: Scalar) -> Vector:
            motion = symbols[:3], symbols[3:6], symbols[6:]
            return actuator_forces(
                self._lengths,
                self._bodies,
                self._gravity,
                *motion,
                tape,
                losses=self._losses,
                actuation=self._actuation,
            )

        return straight_line(formula, 9)

    @cached_property
    def acceleration(self) -> Compiled:
        """(pose 3, velocity 3, actuator forces 3, wrench's F_y, F_z, M_y) → acceleration of the pose 3."""

        def formula(tape: Tape, *symbols: Scalar) -> Vector:
            pose, velocity, forces, wrench = (symbols[i : i + 3] for i in (0, 3, 6, 9))
            J = jacobian(self._lengths, configuration(self._lengths, pose, tape))
            acting = apply_transposed(J, forces)
            bias = self._generalized(tape, pose, velocity, _REST, self._gravity, self._actuation)
            inertia = self._actuation.resting
            M = [self._generalized(tape, pose, _REST, axis, _REST, inertia) for axis in _AXES]
            return _solve_symmetric(M, [a + w - b for a, w, b in zip(acting, wrench, bias, strict=True)])

        return straight_line(formula, 12)

    def _generalized(
        self,
        tape: Tape,
        pose: Vector,
        velocity: Vector,
        acceleration: Vector,
        gravity: Vector,
        actuation: Actuation,
    ) -> Vector:
        return generalized_forces(
            self._lengths,
            self._bodies,
            gravity,
            pose,
            velocity,
            acceleration,
            tape,
            losses=self._losses,
            actuation=actuation,
        )


class CompiledEquations:
    """What a run in the minimal form asks of `Equations`, by the kernels."""

    def __init__(self, kernels: MachineKernels) -> None:
        self._kinematics = kernels.function("kinematics")
        self._acceleration = kernels.function("forward_dynamics_loaded")
        parameters = kernels.parameters
        self._losses = losses_of_state(parameters) if parameters.friction else None

    def sliders(self, *state: float) -> tuple[float, ...]:
        """(pose 3, velocity 3) → slider positions 3 [m] and velocities 3 [m/s]; NaN out of reach."""
        y, z, theta, vy, vz, vtheta = state
        a, b, c, j_a, j_b, j_c, arm, _ = self._kinematics(y, z, theta)
        return a, b, c, vz + j_a * vy, vz + j_b * vy, vz + j_c * vy + arm * vtheta

    def acceleration(self, *given: float) -> tuple[float, ...]:
        """(pose 3, velocity 3, actuator forces 3, wrench's F_y, F_z, M_y) → acceleration of the pose 3."""
        y, z, theta, vy, vz, vtheta, f_a, f_b, f_c, w_y, w_z, w_theta = given
        if self._losses is not None:
            d_y, d_z, d_theta = self._losses(y, z, theta, vy, vz, vtheta)
            w_y, w_z, w_theta = w_y - d_y, w_z - d_z, w_theta - d_theta
        return self._acceleration(y, z, theta, vy, vz, vtheta, f_a, f_b, f_c, w_y, w_z, w_theta)[:3]


def _solve_symmetric(M: list[Vector], b: list[Scalar]) -> Vector:
    """Solve M x = b for a positive definite M, by M = L D Lᵀ written out."""
    d1 = M[0][0]
    l21, l31 = M[0][1] / d1, M[0][2] / d1
    d2 = M[1][1] - l21 * M[0][1]
    t = M[1][2] - l31 * M[0][1]
    l32 = t / d2
    d3 = M[2][2] - l31 * M[0][2] - l32 * t
    y2 = b[1] - l21 * b[0]
    y3 = b[2] - l31 * b[0] - l32 * y2
    x3 = y3 / d3
    x2 = y2 / d2 - l32 * x3
    return (b[0] / d1 - l21 * x2 - l31 * x3, x2, x3)


_NOWHERE = (ValueError, ArithmeticError)  # what the closed forms raise out of reach


class MachinePlant(Plant, Protocol):
    """The manipulator that moves under forces: a plant with a platform."""

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state of a pose and its velocity."""

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""

    def drops(self, state: FloatArray) -> FloatArray | None:
        """Return by how much of its length each leg hangs down (3,), if the pose does not tell."""

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the acceleration of the pose (3,), given the derivative of the state."""

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, n)."""


class MachineMargins:
    """The margins of the manipulator's limits and of events, for the states of a plant."""

    def __init__(
        self, plant: MachinePlant, limiter: Limiter, events: Sequence[Event], state: FloatArray
    ) -> None:
        self._plant, self._limiter = plant, limiter
        self._happening = EventMargins(events, *plant.pose(state)) if events else None

    def __call__(self, time: float, state: FloatArray) -> FloatArray:
        """Return the margins of a state: twelve, and one an event."""
        return self._at(time, *self._plant.pose(state), self._plant.drops(state))

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state, and those a short time ahead at its present velocity."""
        (pose, velocity), drops = self._plant.pose(state), self._plant.drops(state)
        later = self._at(time + ahead, pose + ahead * velocity, velocity, drops)
        return self._at(time, pose, velocity, drops), later

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        if self._happening is None or index < _LIMITS:
            return self._limiter.stop(index, time)
        return self._happening.stop(index - _LIMITS, time)

    def _at(
        self, time: float, pose: FloatArray, velocity: FloatArray, drops: FloatArray | None
    ) -> FloatArray:
        margins = self._limiter(pose, drops)
        if self._happening is None:
            return margins
        return np.concatenate([margins, self._happening(time, pose, velocity)])


class MinimalPlant:
    """The equations of motion in y, z, θ; the loops are closed by construction."""

    def __init__(self, parameters: Parameters, equations: Equations | CompiledEquations) -> None:
        self._parameters = parameters
        self._equations = equations

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state (6,) of a pose and its velocity."""
        return np.concatenate([pose, velocity])

    def rate(self, state: FloatArray, forces: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""
        acting = [wrench[row] for row in WRENCH_ROWS]
        derivative = np.empty(6)
        derivative[:3] = state[3:]
        try:
            derivative[3:] = self._equations.acceleration(*state.tolist(), *forces.tolist(), *acting)
        except _NOWHERE:
            derivative[:] = np.nan
        return derivative

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slider positions [m] and velocities [m/s], (3,) each."""
        found = self._equations.sliders(*state[:6].tolist())
        return np.array(found[:3]), np.array(found[3:])

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""
        return state[:3], state[3:6]

    def drops(self, state: FloatArray) -> FloatArray | None:  # noqa: ARG002 - as the other
        """Return None: the pose tells, since no leg can get beyond the horizontal."""
        return None

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:  # noqa: ARG002 - as the other
        """Return the acceleration of the pose (3,), given the derivative of the state."""
        return rate[3:6]

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, 6)."""
        geometry = self._parameters.geometry
        motion = kinematics.mechanism_motion(geometry, states[:, :3], states[:, 3:6], rates[:, 3:6], "nan")
        names = tuple(motion.position)
        found = JointStates.from_mappings(names, motion.position, motion.velocity, motion.acceleration)
        return found, kinematics.closure_error(geometry, motion)


class MachineJoints(ConstrainedPlant):
    """All joints of the tree, held together by its closures, with friction and counterbalances."""

    def __init__(self, parameters: Parameters, loop: ClosedLoopModel, stabilisation: float) -> None:
        from p3dof.methods.pinocchio import JointForces, bare

        loop = bare(loop)
        super().__init__(loop, stabilisation, (PLATFORM,), JointForces(loop, parameters).at)
        self._depth = parameters.geometry.h
        self._data = self.loop.model.createData()
        self._frame = self.loop.model.getFrameId(PLATFORM)
        names = list(self.names)
        self._turns = [names.index(name) for name in ("hinge_c", "hinge_platform")]
        self._legs = [names.index(name) + 1 for name in ("hinge_a", "hinge_b", "hinge_left")]

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state (20,) of a pose and its velocity."""
        from p3dof.methods.pinocchio import complete

        found = complete(self.loop, self._depth, pose, velocity, np.zeros(3))
        return np.concatenate([found.q, found.v])

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""
        import pinocchio as pin

        model, data = self.loop.model, self._data
        pin.forwardKinematics(model, data, *self.split(state))
        place = pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameVelocity(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        _, y, z = place.translation
        turned = np.arctan2(place.rotation[0, 2], place.rotation[0, 0])
        turned += 2 * np.pi * np.round((state[self._turns].sum() - turned) / (2 * np.pi))  # whole turns
        velocity = np.array([moving.linear[1], moving.linear[2], moving.angular[1]])
        return np.array([y, z + self._depth, turned]), velocity

    def drops(self, state: FloatArray) -> FloatArray:
        """Return by how much of its length each leg hangs down (3,): of leg C, in the plane across y0."""
        import pinocchio as pin

        pin.forwardKinematics(self.loop.model, self._data, state[: self._nv])
        a, b, c = (self._data.oMi[joint].rotation[:, 0] for joint in self._legs)
        return np.array([-a[2], -b[2], -c[2] / np.hypot(c[0], c[2])])

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the acceleration of the pose (3,), given the derivative of the state."""
        import pinocchio as pin

        model, data = self.loop.model, self._data
        pin.forwardKinematics(model, data, *self.split(state), rate[self._nv : 2 * self._nv])
        pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameClassicalAcceleration(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        return np.array([moving.linear[1], moving.linear[2], moving.angular[1]])

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, 20)."""
        q, v, a, gap = self.motion(states, rates)
        return JointStates(self.names, q, v, a), gap
