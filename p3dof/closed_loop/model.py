"""`ClosedLoopModel`: a tree model, its loop closures and its actuators, for one sample and for many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, as_floats, frozen_array
from p3dof.closed_loop.batch.dynamics import BatchDynamics, BatchInverseDynamics
from p3dof.closed_loop.batch.energy import BodyEnergies, body_energies
from p3dof.closed_loop.batch.states import BatchAssembler, BatchStates
from p3dof.closed_loop.batch.targets import FrameGoals, FrameTargets, JointGoals
from p3dof.closed_loop.dynamics import read_only
from p3dof.closed_loop.hybrid import ByName, HybridDynamics, Prescription, hybrid_dynamics, joint_freedoms
from p3dof.closed_loop.loop_model import External, LoopModel
from p3dof.closed_loop.units import ScaledModel
from p3dof.errors import InputError


class ClosedLoopModel(LoopModel):
    """Kinematics and dynamics of any robot with (or without) loop closures, for one sample and for many.

    Parameters
    ----------
    model : pin.Model
        A tree. Its frames and joints must stay as they are; masses and gravity may be changed.
    sidecar : Sidecar
        Loop closures, couplings, actuated joints, and perhaps the reference configuration.

    Raises
    ------
    ModelError
        If a frame or joint that the sidecar names does not exist, both frames of a closure are on the same
        body, an actuated or coupled joint has not exactly one degree of freedom, a continuous joint is
        coupled in a way that needs its turns counted, or the reference does not fit the joints.

    Notes
    -----
    An instance owns workspaces that every method writes to: it is not thread-safe. Give each thread a `copy`.
    Arrays in results are read-only copies.
    """

    def complete_batch(
        self,
        target: FrameTargets | ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        guess: ArrayLike | None = None,
        near: ArrayLike | None = None,
        stop: bool = False,
    ) -> BatchStates:
        """Find the motion of the whole tree at many samples; fast where the target determines every joint.

        Parameters
        ----------
        target : FrameTargets or (N, n_actuated) array
            Placements of a frame, or values of the actuated joints.
        velocity, acceleration : (N, size) array
            As in `complete`, of every sample.
        guess : (nq,) array, optional
            Where all samples start; by default the reference configuration.
        near : (nq,) array, optional
            Where a sample that has to be treated alone starts first, while no other one is known.
        stop : bool
            Leave the rest out after the first sample that fails.

        Returns
        -------
        BatchStates
            With the errors of the samples that failed, which are those of `complete`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        goals: FrameGoals | JointGoals
        if isinstance(target, FrameTargets):
            goals = FrameGoals(self._kinematics, target)
        else:
            target = frozen_array("target", target, ("N", len(self._joints)))
            goals = JointGoals(self._kinematics, self._joints, target)
        shape = (len(target), goals.size)
        motion = frozen_array("velocity", velocity, shape), frozen_array("acceleration", acceleration, shape)
        start = None if guess is None else self._configuration("guess", guess)
        first = None if near is None else self._configuration("near", near)
        if self._scaled is not None:
            return _complete_scaled(self._scaled, target, motion, start, first, stop)
        return self._batch_assembler.complete(target, goals, motion, start, first, stop)

    def inverse_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
    ) -> BatchInverseDynamics:
        """Return the actuator forces at many samples; fast with as many actuators as freedoms.

        Parameters
        ----------
        q : (N, nq) array
            Configurations, with closed loops.
        v, a : (N, nv) array
            Velocities and accelerations, which keep the loops closed.
        external : mapping of str to (6,) or (N, 6) array, optional
            Wrenches that act on frames, as in `inverse_dynamics`.
        joint_forces : (nv,) or (N, nv) array, optional
            As in `inverse_dynamics`.
        stop : bool
            Leave the rest out after the first sample that fails.

        Returns
        -------
        BatchInverseDynamics
            With the errors of the samples that failed, which are those of `inverse_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        states = self._states(q, v, a)
        count = len(states[0])
        if external is not None and not isinstance(external, Mapping):
            raise InputError(
                f"external: expected a mapping of frame names to wrenches, got {type(external).__name__}"
            )
        loads = {
            name: _rows(f"external {name}", wrench, count, 6) for name, wrench in (external or {}).items()
        }
        nothing = np.zeros(self.model.nv)
        forces = _rows("joint_forces", nothing if joint_forces is None else joint_forces, count, len(nothing))
        if self._scaled is not None:
            return _inverse_dynamics_scaled(self._scaled, states, loads, forces, stop)
        return self._batch_dynamics.inverse_dynamics(*states, loads, forces, stop)

    def hybrid_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> HybridDynamics:
        """Return the forces that produce prescribed accelerations, while idle freedoms move as they must.

        Idle is what is neither prescribed nor determined by the closures: a floating base, wheels, rods that
        spin about themselves. Where everything is prescribed it is `inverse_dynamics`.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v : (nv,) array
            Velocity, which keeps the loops closed.
        prescribed : (n_actuated,) array or mapping of str to float or array
            Accelerations of the actuated joints [m/s² or rad/s²], or those of other joints by name: a number,
            or an array of as many as the joint has freedoms (a floating base: linear, angular, in its own
            axes, as in `v`).
        frames : mapping of str to (6,) array, optional
            Prescribed ``LOCAL_WORLD_ALIGNED`` classical accelerations of frames, linear, then angular; NaN
            where one is left free.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        HybridDynamics

        Raises
        ------
        SingularityError
            If the actuators cannot produce such accelerations at this configuration.
        DynamicsError
            If the prescribed accelerations depend on each other, leave forces open, or need a force that no
            actuator gives.
        InputError
            If an argument has the wrong shape or is not finite, a name does not exist, the loops are open by
            more than 1e-3, or the velocity opens them by more than 1e-2 of itself.
        """
        joints, frames = self._prescribed(prescribed, 1), _by_name("frames", frames or {})
        given = Prescription(self._kinematics, joints, frames)
        v = frozen_array("v", v, (self.model.nv,))
        point = self._closed_at(q, v)
        force = self._external(external, joint_forces)
        if self._scaled is not None:
            return _hybrid_scaled(self._scaled, (point.q, v), joints, frames, external, joint_forces)
        return hybrid_dynamics(self._dynamics, point, v, given, force)

    def _prescribed(self, prescribed: ArrayLike | ByName | None, dimensions: int) -> dict[str, FloatArray]:
        """Return the prescribed accelerations by joint; an array is that of the actuated joints."""
        if isinstance(prescribed, Mapping) or prescribed is None:
            return _by_name("prescribed", prescribed or {})
        shape = ("N", len(self.actuated))[2 - dimensions :]
        values = frozen_array("prescribed", prescribed, shape)
        return {name: values[..., i] for i, name in enumerate(self.actuated)}

    def power_batch(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> FloatArray:
        """Return the rate of change of the mechanical energy (N,) at many samples [W]; see `power`.

        Parameters
        ----------
        q : (N, nq) array
            Configurations.
        v, a : (N, nv) array
            Velocities and accelerations.

        Returns
        -------
        (N,) array

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        return self._batch_dynamics.power(*self._states(q, v, a))

    def body_energies(self, q: ArrayLike, v: ArrayLike) -> BodyEnergies:
        """Return the kinetic and potential energy of every body, and the momentum of all of them.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            One configuration, or N of them.
        v : (nv,) or (N, nv) array
            Velocities.

        Returns
        -------
        BodyEnergies

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or a configuration is not normalised.
        """
        if np.ndim(q) != 1:
            q, v, _ = self._states(q, v, v)
            return body_energies(self.model, q, v)
        q = self._configuration("q", q)
        v = frozen_array("v", v, (self.model.nv,))
        one = body_energies(self.model, q[None], v[None])
        return BodyEnergies(
            one.names, one.kinetic[0], one.potential[0], one.momentum[0], one.angular_momentum[0]
        )

    @cached_property
    def _batch_assembler(self) -> BatchAssembler:
        return BatchAssembler(self, self._kinematics, self._assembler)

    @cached_property
    def _batch_dynamics(self) -> BatchDynamics:
        return BatchDynamics(self, self._kinematics)

    def _states(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        q = frozen_array("q", q, ("N", self.model.nq))
        if self.model.nq != self.model.nv:
            for row in q:
                self._configuration("q", row)
        shape = (len(q), self.model.nv)
        return q, frozen_array("v", v, shape), frozen_array("a", a, shape)


def _complete_scaled(
    scaled: ScaledModel[ClosedLoopModel],
    target: FrameTargets | FloatArray,
    motion: tuple[FloatArray, FloatArray],
    guess: FloatArray | None,
    near: FloatArray | None,
    stop: bool,
) -> BatchStates:
    """`ClosedLoopModel.complete_batch` in the model's own unit of length."""
    core, units = scaled.core, scaled.units
    goals: FrameTargets | FloatArray
    if isinstance(target, FrameTargets):
        factors = scaled.of_mask(target.mask)
        goals = FrameTargets(target.frame, target.positions / units.length, target.rotations, target.mask)
    else:
        factors = units.motion(units.v[core.actuated_v])
        goals = target / factors
    velocity, acceleration = (values / factors for values in motion)
    begin, first = (None if q is None else scaled.q(q) for q in (guess, near))
    with scaled.in_words():
        found = core.complete_batch(goals, velocity, acceleration, begin, first, stop)
    return BatchStates(
        found.q * units.motion(units.q),
        found.v * units.motion(units.v),
        found.a * units.motion(units.v),
        scaled.influence(found.influence, units.v, factors),
        found.actuated_v,
        found.same_assembly,
        {i: scaled.told(error) for i, error in found.errors.items()},
    )


def _inverse_dynamics_scaled(
    scaled: ScaledModel[ClosedLoopModel],
    states: tuple[FloatArray, FloatArray, FloatArray],
    loads: Mapping[str, FloatArray],
    forces: FloatArray,
    stop: bool,
) -> BatchInverseDynamics:
    """`ClosedLoopModel.inverse_dynamics_batch` in the model's own unit of length."""
    core, units = scaled.core, scaled.units
    q, v, a = states
    with scaled.in_words():
        found = core.inverse_dynamics_batch(
            scaled.q(q), scaled.v(v), scaled.v(a), scaled.wrenches(loads), scaled.forces(forces), stop
        )
    return BatchInverseDynamics(
        found.tau * units.force(units.v[core.actuated_v]),
        found.conditioning,
        found.residual * max(units.length, units.length**2),
        found.closure_error * units.motion(units.rows),
        {i: scaled.told(error) for i, error in found.errors.items()},
    )


def _by_name(what: str, values: ByName) -> dict[str, FloatArray]:
    """Return a mapping whose values are arrays of numbers."""
    if not isinstance(values, Mapping):
        raise InputError(f"{what}: expected a mapping of names to accelerations, got {type(values).__name__}")
    return {name: as_floats(f"{what} {name}", value) for name, value in values.items()}


def _hybrid_scaled(
    scaled: ScaledModel[ClosedLoopModel],
    state: tuple[FloatArray, FloatArray],
    joints: Mapping[str, FloatArray],
    frames: Mapping[str, FloatArray],
    external: External | None,
    joint_forces: ArrayLike | None,
) -> HybridDynamics:
    """`ClosedLoopModel.hybrid_dynamics` in the model's own unit of length."""
    core, units = scaled.core, scaled.units
    parts = {name: list(joint_freedoms(core.model, name)) for name in joints}
    given = {name: value / units.motion(units.v[parts[name]]) for name, value in joints.items()}
    given = {name: value.reshape(len(parts[name])) for name, value in given.items()}
    places = {name: value / units.motion(np.arange(6) < 3) for name, value in frames.items()}
    with scaled.in_words():
        found = core.hybrid_dynamics(
            scaled.q(state[0]),
            scaled.v(state[1]),
            given,
            places,
            scaled.wrenches(external),
            scaled.forces(joint_forces),
        )
    return replace(
        found,
        tau=read_only(found.tau * units.force(units.v[core.actuated_v])),
        a=read_only(found.a * units.motion(units.v)),
        lambda_=read_only(found.lambda_ * units.force(units.rows)),
        residual=found.residual * max(units.length, units.length**2),
        prescribed_residual=found.prescribed_residual * max(units.length, 1.0),
        closure_residual=found.closure_residual * max(units.length, 1.0),
        gap=found.gap * units.length,
    )


def _rows(name: str, value: ArrayLike, count: int, width: int) -> FloatArray:
    """Return (count, width) rows of a value that may be the same for all."""
    array = as_floats(name, value)
    return frozen_array(
        name, np.tile(array, (count, 1)) if array.shape == (width,) else array, (count, width)
    )
