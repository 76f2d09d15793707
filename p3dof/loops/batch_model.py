"""`BatchModel`: a model whose motions and forces are found at many samples at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeAlias, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array
from p3dof._base.errors import InputError, P3dofError
from p3dof.loops.accuracy import NORMALISED
from p3dof.loops.batch.dynamics import BatchDynamics
from p3dof.loops.batch.energy import BodyEnergies, body_energies
from p3dof.loops.batch.linear import IndexArray, blocks
from p3dof.loops.batch.results import BatchForwardDynamics, BatchInverseDynamics
from p3dof.loops.batch.states import BatchAssembler, BatchStates
from p3dof.loops.batch.targets import FrameTargets, Targets
from p3dof.loops.hybrid_model import acting_rows
from p3dof.loops.loop_model import External
from p3dof.loops.margins_model import MarginsModel
from p3dof.loops.scaled_model import ScaledModel

BatchTarget: TypeAlias = FrameTargets | ArrayLike | Mapping[str, ArrayLike]
"""Placements of a frame, values of the actuated joints, or values of joints by name, at many samples."""


class BatchModel(MarginsModel):
    """Motions and forces of any robot at many samples."""

    def complete_batch(
        self,
        target: BatchTarget | Sequence[BatchTarget],
        velocity: ArrayLike,
        acceleration: ArrayLike,
        guess: ArrayLike | None = None,
        near: ArrayLike | None = None,
        stop: bool = False,
    ) -> BatchStates:
        """Find the motion of the whole tree at many samples; fast where the target determines every joint.

        Parameters
        ----------
        target : FrameTargets, (N, n_actuated) array, mapping of str to (N,) array, or a list of these
            Placements of a frame, values of the actuated joints, or those of other joints by name, a number
            for the same at all samples; or several of them at once, as in `complete`.
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
            If an argument has the wrong shape, is not finite, or names a frame or joint that does not exist.
        """
        goals = self._targets(target, len(np.atleast_1d(as_floats("velocity", velocity))))
        shape = (len(goals), len(goals.order))
        rates = [frozen_array("velocity", velocity, shape), frozen_array("acceleration", acceleration, shape)]
        motion = rates[0][:, goals.order], rates[1][:, goals.order]
        start = None if guess is None else self._configuration("guess", guess)
        first = None if near is None else self._configuration("near", near)
        if self._scaled is not None:
            found = _complete_scaled(self._scaled, goals, motion, start, first, stop)
        else:
            found = self._batch_assembler.complete(goals, motion, start, first, stop)
        return replace(found, influence=goals.given(found.influence))

    def _targets(self, target: BatchTarget | Sequence[BatchTarget], count: int) -> Targets:
        """Return targets of `count` samples, frames first; the number counts where none is given."""
        several = isinstance(target, list | tuple) and any(
            isinstance(part, FrameTargets | Mapping) for part in target
        )
        frames: list[FrameTargets] = []
        joints: list[int] = []
        columns: list[FloatArray] = []
        places: list[IndexArray] = []
        of_joints: list[IndexArray] = []
        size = 0
        for part in cast("Sequence[BatchTarget]", target if several else [target]):
            if isinstance(part, FrameTargets):
                self._kinematics.frame(part.frame, "target", InputError)
                frames.append(part)
                places.append(size + np.arange(np.count_nonzero(part.mask)))
                size += len(places[-1])
                continue
            ids, values = self._joint_values(part, count)
            joints += ids
            columns.append(values)
            of_joints.append(size + np.arange(len(ids)))
            size += len(ids)
        lengths = {len(part) for part in frames} | {len(part) for part in columns}
        if len(lengths) != 1:
            raise InputError(f"target: expected as many samples in all parts, got {sorted(lengths)}")
        values = np.concatenate([np.zeros((lengths.pop(), 0)), *columns], axis=1)
        order = np.concatenate([np.arange(0), *places, *of_joints])
        return Targets(tuple(frames), tuple(joints), values, order)

    def _joint_values(
        self, target: ArrayLike | Mapping[str, ArrayLike], count: int
    ) -> tuple[Any, FloatArray]:
        """Return ids of joints, and their values (N, n)."""
        if not isinstance(target, Mapping):
            return self._joints, frozen_array("target", target, ("N", len(self._joints)))
        ids, columns = self._named_joints(target), []
        for name, value in target.items():
            array = as_floats(f"target {name}", value)
            array = np.broadcast_to(array, (count,)) if array.ndim == 0 else array
            columns.append(frozen_array(f"target {name}", array, ("N",)))
        if len({len(column) for column in columns}) > 1:
            raise InputError("target: expected as many samples of all joints")
        return ids, np.stack(columns, axis=1) if columns else np.zeros((count, 0))

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
        loads, forces = acting_rows(external, joint_forces, len(states[0]), self.model.nv)
        if self._scaled is not None:
            forces = forces + self.passive.forces(*states[:2])
            return _inverse_dynamics_scaled(self._scaled, states, loads, forces, stop)
        return self._batch_dynamics.inverse_dynamics(*states, loads, forces, stop)

    def forward_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
    ) -> BatchForwardDynamics:
        """Return the accelerations that actuator forces produce at many samples, one after the other.

        Parameters
        ----------
        q : (N, nq) array
            Configurations, with closed loops.
        v : (N, nv) array
            Velocities.
        tau : (N, n_actuated) array
            Forces of the actuated joints [N or N m].
        external : mapping of str to (6,) or (N, 6) array, optional
            Wrenches that act on frames, as in `forward_dynamics`.
        joint_forces : (nv,) or (N, nv) array, optional
            As in `forward_dynamics`.
        stop : bool
            Leave the rest out after the first sample that fails.

        Returns
        -------
        BatchForwardDynamics
            With the errors of the samples that failed, which are those of `forward_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        q, v, _ = self._states(q, v, v)
        tau = frozen_array("tau", tau, (len(q), len(self.actuated)))
        loads, forces = acting_rows(external, joint_forces, len(q), self.model.nv)
        a, gaps = np.full((len(q), self.model.nv), np.nan), np.full((len(q), self._kinematics.size), np.nan)
        residual, opening = np.full((2, len(q)), np.nan)
        result = BatchForwardDynamics(a, residual, opening, gaps, {})
        for i in range(len(q)):
            acting = {name: wrench[i] for name, wrench in loads.items()}
            try:
                one = self.forward_dynamics(q[i], v[i], tau[i], acting, forces[i])
            except P3dofError as error:
                result.errors[i] = error
                if stop:
                    break
            else:
                a[i], residual[i], opening[i] = one.a, one.residual, one.closure_residual
                gaps[i] = self.closure_error(q[i])
        return result

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

    def closure_gaps(self, q: ArrayLike) -> FloatArray:
        """Return how far each closure, then coupling, is open, at one configuration or at N.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            One configuration, or N of them.

        Returns
        -------
        (closures + couplings,) or (N, closures + couplings) array
            As `ClosedTree.closure_gaps`.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        if np.ndim(q) == 1:
            return super().closure_gaps(q)
        q, _, _ = self._states(q, *(np.zeros((len(np.atleast_2d(as_floats("q", q))), self.model.nv)),) * 2)
        found = [self._batch_dynamics.errors(q[block]) for block in blocks(len(q))]
        return self._kinematics.gaps(np.concatenate([np.zeros((0, self._kinematics.size)), *found]))

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
            return replace(body_energies(self.model, q, v), springs=self.passive.energy(q))
        q = self._configuration("q", q)
        v = frozen_array("v", v, (self.model.nv,))
        one = body_energies(self.model, q[None], v[None])
        return BodyEnergies(
            one.names,
            one.kinetic[0],
            one.potential[0],
            one.momentum[0],
            one.angular_momentum[0],
            self.passive.energy(q),
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
            model = self.model
            if not all(pin.isNormalized(model, row, NORMALISED) for row in q):
                raise InputError("q: not normalised (unit quaternions and circles); see pinocchio.normalize")
        shape = (len(q), self.model.nv)
        return q, frozen_array("v", v, shape), frozen_array("a", a, shape)


def _complete_scaled(
    scaled: ScaledModel[BatchModel],
    target: Targets,
    motion: tuple[FloatArray, FloatArray],
    guess: FloatArray | None,
    near: FloatArray | None,
    stop: bool,
) -> BatchStates:
    """`BatchModel.complete_batch` in the model's own unit of length."""
    core, units = scaled.core, scaled.units
    of_joints = units.motion(units.v[[core.model.idx_vs[joint] for joint in target.joints]])
    factors = np.concatenate([*(scaled.of_mask(part.mask) for part in target.frames), of_joints])
    frames = (
        FrameTargets(part.frame, part.positions / units.length, part.rotations, part.mask)
        for part in target.frames
    )
    goals = replace(target, frames=tuple(frames), values=target.values / of_joints)
    rates = motion[0] / factors, motion[1] / factors
    begin, first = (None if q is None else scaled.q(q) for q in (guess, near))
    with scaled.in_words():
        found = core._batch_assembler.complete(goals, rates, begin, first, stop)
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
    scaled: ScaledModel[BatchModel],
    states: tuple[FloatArray, FloatArray, FloatArray],
    loads: Mapping[str, FloatArray],
    forces: FloatArray,
    stop: bool,
) -> BatchInverseDynamics:
    """`BatchModel.inverse_dynamics_batch` in the model's own unit of length."""
    core, units = scaled.core, scaled.units
    q, v, a = states
    with scaled.in_words():
        found = core.inverse_dynamics_batch(
            scaled.q(q), scaled.v(v), scaled.v(a), scaled.wrenches(loads), scaled.forces(forces), stop
        )
    return BatchInverseDynamics(
        found.tau * units.force(units.v[core.actuated_v]),
        found.residual * max(units.length, units.length**2),
        found.closure_error * units.motion(units.rows),
        {i: scaled.told(error) for i, error in found.errors.items()},
        found.evidence,
    )
