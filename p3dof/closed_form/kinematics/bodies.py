"""The motion of every joint and body of the mechanism, on arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.algebra import (
    Matrix,
    Vector,
    add,
    apply_transposed,
    components,
    matrix_array,
    product,
    transpose,
    vector_array,
)
from p3dof._base.checks import FloatArray, Readable, batch_of
from p3dof._base.samples import OnInvalid
from p3dof.closed_form.kinematics.inverse import joint_coordinates, paper_angles
from p3dof.closed_form.kinematics.validity import Placed, reachable
from p3dof.closed_form.paper.formulas import Rates, accelerations, velocities
from p3dof.closed_form.paper.recursion import Frame, body_axes, frames
from p3dof.machine.motion.states import states_of
from p3dof.machine.parameters import Geometry


@dataclass(frozen=True, eq=False)
class BodyMotion(Readable):
    """How one body stands and moves, in the axes of the fixed frame.

    Parameters
    ----------
    rotation : ndarray, shape (..., 3, 3)
        Orientation: takes components from the `Body` axes to the fixed frame.
    origin : ndarray, shape (..., 3)
        Origin of the `Body` frame [m].
    joint : ndarray, shape (..., 3)
        The body's joint A_k of the paper: for the platform C5, for the lower cross-bar its left pivot, for
        every other body the origin of its `Body` frame [m].
    velocity, acceleration : ndarray, shape (..., 3)
        Of that joint [m/s, m/s²].
    omega, epsilon : ndarray, shape (..., 3)
        Angular velocity and acceleration [rad/s, rad/s²].
    """

    rotation: FloatArray
    origin: FloatArray
    joint: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    omega: FloatArray
    epsilon: FloatArray

    def at(self, point: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity, acceleration of a point of the body, (..., 3), in the fixed frame [SI].

        Parameters
        ----------
        point : array-like, shape (..., 3)
            The point in the `Body` frame [m]: one for all samples, or one for each.

        Raises
        ------
        InputError
            If the shape does not fit.
        """
        position = self.origin + np.einsum("...ij,...j->...i", self.rotation, batch_of("point", point, 3))
        arm = position - self.joint
        spin = np.cross(self.omega, arm)
        velocity = self.velocity + spin
        acceleration = self.acceleration + np.cross(self.epsilon, arm) + np.cross(self.omega, spin)
        return position, velocity, acceleration


@dataclass(frozen=True, eq=False)
class MechanismMotion(Readable):
    """The whole mechanism in motion.

    Parameters
    ----------
    sliders, slider_velocities, slider_accelerations : ndarray, shape (..., 3)
        λ10, v10, γ10 of A, B, C [m, m/s, m/s²].
    position, velocity, acceleration : dict of str to ndarray, shape (...)
        Every joint by its name in the URDF, with its rates [m or rad, per second, per second²].
    bodies : dict of str to BodyMotion
        Every moving link by its name.
    """

    sliders: FloatArray
    slider_velocities: FloatArray
    slider_accelerations: FloatArray
    position: Mapping[str, FloatArray]
    velocity: Mapping[str, FloatArray]
    acceleration: Mapping[str, FloatArray]
    bodies: Mapping[str, BodyMotion]


def mechanism_motion(
    geometry: Geometry,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    on_invalid: OnInvalid = "raise",
) -> MechanismMotion:
    """Return the motion of every joint and body: the paper's (8)-(15).

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose, velocity, acceleration : array-like, shape (..., 3)
        Of (y, z, θ): [m, m, rad] and per second, per second²; leading shapes broadcast.
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Raises
    ------
    ReachError, InputError
        As `inverse_kinematics`.
    """
    states = states_of(pose, velocity, acceleration, on_invalid=on_invalid)
    return motion_at(geometry, reachable(geometry, states))


def motion_at(geometry: Geometry, placed: Placed) -> MechanismMotion:
    """Return `mechanism_motion` at states that were looked at."""
    states, lengths, x = placed
    shape, velocity = states.shape, components(states.velocity)
    v = velocities(lengths, x, velocity)
    a = accelerations(lengths, x, v, velocity, components(states.acceleration))
    axes = body_axes(lengths)
    bodies = {name: _body(frame, axes[name], shape) for name, frame in frames(lengths, x, v, a).items()}
    sliders = vector_array(x.sliders, shape)
    return MechanismMotion(
        sliders,
        vector_array(v.sliders, shape),
        vector_array(a.sliders, shape),
        joint_coordinates(sliders, *paper_angles(geometry, x, states.pose[..., 2]).values()),
        _joint_rates(v, shape),
        _joint_rates(a, shape),
        bodies,
    )


def slider_motion(
    geometry: Geometry, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions, velocities and accelerations of the sliders alone, as `mechanism_motion` does."""
    states, lengths, x = reachable(geometry, states_of(pose, velocity, acceleration))
    rates = components(states.velocity)
    v = velocities(lengths, x, rates)
    a = accelerations(lengths, x, v, rates, components(states.acceleration))
    one, two, three = (vector_array(of.sliders, states.shape) for of in (x, v, a))
    return one, two, three


def closure_error(geometry: Geometry, motion: MechanismMotion) -> FloatArray:
    """Return how far the loops are open, by (6) the largest of left less right sides, shape (...) [m].

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    motion : MechanismMotion
        The motion.
    """
    r, L, b = geometry.r, geometry.L, geometry.b
    ends = (
        ("leg_a", (L, 0.0, 0.0), "platform", (0.0, -r, 0.0)),
        ("leg_b", (L, 0.0, 0.0), "platform", (0.0, r, 0.0)),
        ("rod_right", (L, 0.0, 0.0), "crossbar_lower", (0.0, -b, 0.0)),
    )
    gaps = [
        np.linalg.norm(motion.bodies[one].at(tip)[0] - motion.bodies[other].at(seat)[0], axis=-1)
        for one, tip, other, seat in ends
    ]
    error: FloatArray = np.max(gaps, axis=0)
    return error


def _joint_rates(rates: Rates, shape: tuple[int, ...]) -> dict[str, FloatArray]:
    sliders = vector_array(rates.sliders, shape)
    return joint_coordinates(sliders, rates.w21a, rates.w21b, rates.w21c, rates.w32c, rates.w54c)


def _body(frame: Frame, axes: tuple[Matrix, Vector], shape: tuple[int, ...]) -> BodyMotion:
    """Turn a frame T_k into the motion of a body, in fixed axes."""
    body_to_frame, offset = axes
    to_fixed = transpose(frame.a0)
    return BodyMotion(
        rotation=matrix_array(product(to_fixed, body_to_frame), shape),
        origin=vector_array(add(frame.position, apply_transposed(frame.a0, offset)), shape),
        joint=vector_array(frame.position, shape),
        velocity=vector_array(apply_transposed(frame.a0, frame.velocity), shape),
        acceleration=vector_array(apply_transposed(frame.a0, frame.acceleration), shape),
        omega=vector_array(apply_transposed(frame.a0, frame.omega), shape),
        epsilon=vector_array(apply_transposed(frame.a0, frame.epsilon), shape),
    )
