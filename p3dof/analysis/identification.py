"""Forces of the manipulator as linear functions of its parameters, in closed form, for identification.

The same as `p3dof.loops.identification` computes for any robot; the two share parameters alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof.analysis.tolerances.directions import AnyMachine, parameters_of
from p3dof.closed_form.compiled.kernels import loss_by_lengths
from p3dof.closed_form.kinematics import forward_kinematics, inverse_jacobian, mechanism_motion, singularity
from p3dof.loops.identification.forces import (
    COULOMB,
    MASS,
    OTHER,
    SHIFT,
    VISCOUS,
    Rows,
    States,
    bodies_of,
    prior_deviations,
    require_possible,
)
from p3dof.machine.motion.states import states_of
from p3dof.machine.parameters import LINKS, PASSIVE, SLIDES, Actuators, Body, Friction, Parameters
from p3dof.methods.regressor import INERTIAL, force_regressor, inertial_parameters

_OWN = ("viscous", "coulomb")
_FRICTION = ("damping", "friction")
_ACTUATOR = ("armature", "counterbalance", "spring")
_MARGIN = 0.1
"""Least angle from a singularity of actuation, and of a leg from the horizontal, a serial one [rad]."""


class MachineForces:
    """Forces of the manipulator: 100 inertial parameters, nine of the actuators, friction of the sliders.

    Parameters
    ----------
    robot : Manipulator, Parameters or None
        The design; the paper's for None.
    passive : bool
        Whether friction in the passive joints are parameters too; else it stays what the design has.
    """

    position_units: tuple[str, ...] = ("m", "m", "m")
    force_units: tuple[str, ...] = ("N", "N", "N")
    actuators: tuple[str, ...] = tuple(SLIDES)
    coordinates: tuple[str, ...] = ("y", "z", "theta")
    coordinate_units: tuple[str, ...] = ("m", "m", "rad")
    limits: tuple[str, ...] = (
        *(f"{what} of {name}" for what in ("position", "speed", "force") for name in SLIDES),
        "tilt",
        "singularity margin",
    )

    def __init__(self, robot: AnyMachine = None, passive: bool = False) -> None:
        self.parameters = parameters_of(robot)
        own = self.parameters.friction
        self._rubbing = (*SLIDES, *(PASSIVE if passive else ()))
        rest = {
            name: {j: x for j, x in getattr(own, name).items() if j not in self._rubbing} for name in _OWN
        }
        self._known = replace(self.parameters, friction=Friction(**rest, smoothing=own.smoothing))
        self.names = (
            *INERTIAL,
            *(f"{slide}.{what}" for what in _ACTUATOR for slide in SLIDES),
            *(f"{joint}.{what}" for what in _FRICTION for joint in self._rubbing),
        )
        actuators = self.parameters.actuators
        psi = (actuators.inertia, actuators.balance_at_home(self.parameters.gravity), actuators.stiffness)
        friction = [getattr(own, name).get(joint, 0.0) for name in _OWN for joint in self._rubbing]
        self.design: FloatArray = np.concatenate(
            [inertial_parameters(self.parameters.bodies), *psi, friction]
        )
        self.home: FloatArray = np.zeros(3)

    @property
    def largest(self) -> tuple[FloatArray, FloatArray]:
        """Largest forces and speeds (3,) of the sliders."""
        limits = self.parameters.limits
        return np.full(3, limits.force), np.full(3, limits.speed)

    def deviations(
        self,
        mass: float = MASS,
        shift: float = SHIFT,
        other: float = OTHER,
        coulomb: float = COULOMB,
        viscous: float = VISCOUS,
    ) -> FloatArray:
        """Return the prior: standard deviations (P,) about the design, as `LoopForces.deviations`."""
        found = prior_deviations(self.names, self.design, mass, shift, other)
        limits = self.parameters.limits
        for slide in SLIDES:
            for what, size in (("friction", coulomb), ("damping", viscous / limits.speed)):
                at = self.names.index(f"{slide}.{what}")
                found[at] = max(found[at], size * limits.force)
        return found

    def from_actuators(self, positions: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at positions, velocities and accelerations (N, 3) of the sliders.

        Raises
        ------
        ReachError
            If the legs do not reach.
        """
        geometry = self.parameters.geometry
        y = frozen_array("positions", positions, ("N", 3))
        rates, second = (
            frozen_array(name, x, y.shape)
            for name, x in (("velocities", velocities), ("accelerations", accelerations))
        )
        pose = forward_kinematics(geometry, y)
        J = inverse_jacobian(geometry, pose)
        velocity = np.linalg.solve(J, rates[..., None])[..., 0]
        drift = mechanism_motion(geometry, pose, velocity, np.zeros_like(pose)).slider_accelerations
        acceleration = np.linalg.solve(J, (second - drift)[..., None])[..., 0]
        return States(y, rates, second, states_of(pose, velocity, acceleration))

    def from_coordinates(self, values: ArrayLike, rates: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at poses (N, 3), their velocities and accelerations.

        Raises
        ------
        ReachError
            If the legs do not reach.
        """
        moved = mechanism_motion(self.parameters.geometry, values, rates, accelerations)
        return States(
            moved.sliders,
            moved.slider_velocities,
            moved.slider_accelerations,
            states_of(values, rates, accelerations),
        )

    def rows(self, states: States) -> Rows:
        """Return the forces as functions of the parameters."""
        found = force_regressor(self._known, states.whole)
        v = states.velocities
        with np.errstate(over="ignore"):
            losses = {"damping": v, "friction": np.tanh(v / self.parameters.friction.smoothing)}
        friction = np.zeros((*v.shape, len(_FRICTION) * len(self._rubbing)))
        for i, what in enumerate(_FRICTION):
            for k, joint in enumerate(self._rubbing):
                column = i * len(self._rubbing) + k
                if joint in SLIDES:
                    friction[:, k, column] = losses[what][:, k]
                else:
                    unit = {joint: 1.0}
                    smoothing = self.parameters.friction.smoothing
                    one = Friction({} if i else unit, unit if i else {}, smoothing)
                    alone = replace(self._known, friction=one)
                    friction[..., column], _ = loss_by_lengths(
                        alone, states.whole.pose, states.whole.velocity
                    )
        return Rows(np.concatenate([found.inertial, found.actuators, friction], axis=-1), found.friction)

    def excess(self, states: States, rows: Rows | None = None) -> FloatArray:
        """Return by how much limits are exceeded, each over its size, (N, K): at most zero within."""
        rows = self.rows(states) if rows is None else rows
        limits, pose = self.parameters.limits, states.whole.pose
        sides = (
            (states.positions, *limits.travel),
            (states.velocities, -limits.speed, limits.speed),
            (rows.columns @ self.design + rows.known, -limits.force, limits.force),
            (pose[:, 2:], *limits.tilt),
        )
        over = [np.maximum(x / high, x / low) - 1 for x, low, high in sides]
        margins = singularity(self.parameters.geometry, pose)
        legs = np.arccos(
            np.clip(1 - margins.serial / self.parameters.geometry.L, -1, 1)
        )  # above the horizontal
        nearest = np.minimum(margins.actuation, legs.min(axis=-1))
        return np.column_stack([*over, 1 - nearest / _MARGIN])

    def corrected(self, parameters: ArrayLike) -> Parameters:
        """Return the machine with other parameters (P,).

        Raises
        ------
        InputError
            If a body would be impossible.
        ParameterError
            If a coefficient of friction or an armature would be negative.
        """
        values = frozen_array("parameters", parameters, (len(self.names),))
        bodies = {}
        for link, first in zip(LINKS, bodies_of(self.names), strict=True):
            ten = values[first : first + 10]
            if not np.array_equal(ten, self.design[first : first + 10]):
                require_possible(link, ten)
                bodies[link] = _body(ten)
        machine, at = self.parameters, len(INERTIAL)
        own = machine.actuators
        psi = values[at : at + 9].reshape(3, 3) - self.design[at : at + 9].reshape(3, 3)
        armature, balance, spring = (
            {
                slide: given.get(slide, 0.0) + change
                for slide, change in zip(SLIDES, row.tolist(), strict=True)
            }
            for given, row in zip((own.armature, own.counterbalance, own.spring), psi, strict=True)
        )
        rubbing = values[at + 9 :].reshape(2, -1)
        friction = {
            name: {**getattr(machine.friction, name), **dict(zip(self._rubbing, row.tolist(), strict=True))}
            for name, row in zip(_OWN, rubbing, strict=True)
        }
        return replace(
            machine,
            bodies=replace(machine.bodies, **bodies),
            actuators=Actuators(armature, balance, spring, own.counterweight),
            friction=Friction(**friction, smoothing=machine.friction.smoothing),
        )


def _body(ten: FloatArray) -> Body:
    """Return the body with ten inertial parameters about its origin."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten.tolist()
    com = np.array([x, y, z]) / m
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Body(m, com, about - m * (com @ com * np.eye(3) - np.outer(com, com)))
