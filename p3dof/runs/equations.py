"""The equations of one machine for one sample at a time, as straight-line functions of numbers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TypeAlias

from p3dof._base.algebra import Scalar, Vector, apply_transposed, dot
from p3dof._base.tracing import Tape, straight_line
from p3dof.closed_form.compiled import MachineKernels
from p3dof.closed_form.compiled.friction import losses_of_state
from p3dof.closed_form.paper.actuators import Actuation, actuation_of
from p3dof.closed_form.paper.formulas import Lengths, configuration, jacobian
from p3dof.closed_form.paper.friction import losses_of
from p3dof.closed_form.paper.inertials import inertials, numbers
from p3dof.closed_form.paper.virtual_power import actuator_forces, generalized_forces
from p3dof.machine.parameters import Parameters

Compiled: TypeAlias = Callable[..., tuple[float, ...]]

_REST: Vector = (0, 0, 0)
_AXES: tuple[Vector, ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


class Equations:
    """Kinematics, inverse and forward dynamics of one machine; as `p3dof.methods.equations_of_motion`.

    Each is a function of numbers that returns a tuple of numbers, compiled when it is first used. Outside of
    reach they raise ValueError or ZeroDivisionError, as `math` does.

    Parameters
    ----------
    parameters : Parameters
        The machine.
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
    """What a run in the minimal form asks of `Equations`, by the kernels.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    """

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
