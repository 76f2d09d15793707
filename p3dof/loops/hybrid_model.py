"""`HybridModel`: a model whose forces follow from prescribed accelerations, for one sample and for many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array
from p3dof._base.errors import InputError, P3dofError
from p3dof.loops.accuracy import NORMALISED
from p3dof.loops.batch.hybrid import BatchHybrid
from p3dof.loops.batch.linear import BoolArray, IndexArray
from p3dof.loops.batch.results import BatchHybridDynamics, Prescribed
from p3dof.loops.hybrid_results import HybridDynamics
from p3dof.loops.loop_model import External, LoopModel
from p3dof.loops.prescriptions import ByName, JointAccelerations, Prescription, joint_freedoms
from p3dof.loops.results import read_only
from p3dof.loops.scaled_model import ScaledModel


class HybridModel(LoopModel):
    """Forces of any robot for prescribed accelerations, while idle freedoms move as they must."""

    def hybrid_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stabilisation: float = 0.0,
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
        stabilisation : float
            As in `forward_dynamics`.

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
        if isinstance(prescribed, Mapping) or prescribed is None:
            joints = JointAccelerations.by_name(self.model, _by_name("prescribed", prescribed or {}))
        else:
            values = frozen_array("prescribed", prescribed, (len(self.actuated),))
            joints = JointAccelerations(self.actuated_v, values)
        given = Prescription(self._kinematics, joints, _by_name("frames", frames or {}))
        beta = float(frozen_array("stabilisation", stabilisation, ()))
        if beta < 0:
            raise InputError(f"stabilisation: expected zero or more, got {beta:g}")
        return self._hybrid(q, v, given, external, joint_forces, beta)

    def _hybrid(
        self,
        q: ArrayLike,
        v: ArrayLike,
        given: Prescription,
        external: External | None,
        joint_forces: ArrayLike | None,
        stabilisation: float = 0.0,
    ) -> HybridDynamics:
        """Return the forces for accelerations that are prescribed properly."""
        v = frozen_array("v", v, (self.model.nv,))
        point = self._closed_at(q, v)
        joint_forces = self._acting(q, v, joint_forces)
        force = self._external(external, joint_forces)
        if self._scaled is not None:
            acting = external, joint_forces
            return _hybrid_scaled(self._scaled, (point.q, v), given, acting, stabilisation)
        return self._dynamics.hybrid.solve(point, v, given, force, stabilisation)

    def hybrid_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
    ) -> BatchHybridDynamics:
        """Return forces and motions for prescribed accelerations at many samples.

        It is fast where as many accelerations are prescribed as joints are actuated, and the same components
        of frames at all samples.

        Parameters
        ----------
        q : (N, nq) array
            Configurations, with closed loops.
        v : (N, nv) array
            Velocities, which keep the loops closed.
        prescribed : (N, n_actuated) array or mapping of str to float or array
            As in `hybrid_dynamics`, of every sample; a value by name may also be the same for all.
        frames : mapping of str to (6,) or (N, 6) array, optional
            As in `hybrid_dynamics`.
        external : mapping of str to (6,) or (N, 6) array, optional
            As in `hybrid_dynamics`.
        joint_forces : (nv,) or (N, nv) array, optional
            As in `hybrid_dynamics`.
        stop : bool
            Leave the rest out after the first sample that fails.

        Returns
        -------
        BatchHybridDynamics
            With the errors of the samples that failed, which are those of `hybrid_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite, or a name does not exist.
        """
        model = self.model
        q = frozen_array("q", q, ("N", model.nq))
        if model.nq != model.nv and not all(pin.isNormalized(model, row, NORMALISED) for row in q):
            raise InputError("q: not normalised (unit quaternions and circles); see pinocchio.normalize")
        count = len(q)
        v = frozen_array("v", v, (count, model.nv))
        given = self._prescribed(prescribed, ("N",))
        freedoms = {name: list(joint_freedoms(model, name)) for name in given}
        joints = {name: _of_samples(name, given[name], count, len(at)) for name, at in freedoms.items()}
        places = _by_name("frames", frames or {})
        places = {name: np.broadcast_to(value, (count, *value.shape[-1:])) for name, value in places.items()}
        loads, forces = acting_rows(external, joint_forces, count, model.nv)
        acting = forces + self.passive.forces(q, v)
        at = np.array([k for part in freedoms.values() for k in part], dtype=int)
        values = np.concatenate([np.zeros((count, 0)), *joints.values()], axis=1)
        sizes = len(self.actuated), model.nv, self._kinematics.size
        result = BatchHybridDynamics.empty(count, *sizes)
        done: BoolArray = np.zeros(count, dtype=bool)
        asked = _prescribed_alike(at, values, places)
        if asked is not None:
            if self._scaled is not None:
                result, done = _solved_scaled(self._scaled, (q, v), asked, loads, acting)
            else:
                result, done = self._batch_hybrid.solve(q, v, asked, loads, acting)
        for i in np.flatnonzero(~done):
            mine, framed, loaded = (
                {name: value[i] for name, value in part.items()} for part in (joints, places, loads)
            )
            try:
                one = self.hybrid_dynamics(q[i], v[i], mine, framed, loaded, forces[i])
            except P3dofError as error:
                result.errors[int(i)] = error
                if stop:
                    break
            else:
                result.put(int(i), one, self.closure_error(q[i]))
        return result

    @cached_property
    def _batch_hybrid(self) -> BatchHybrid:
        return BatchHybrid(self, self._kinematics)

    def _prescribed(
        self, prescribed: ArrayLike | ByName | None, samples: tuple[str, ...]
    ) -> dict[str, FloatArray]:
        """Return the prescribed accelerations by joint; an array is that of the actuated joints."""
        if isinstance(prescribed, Mapping) or prescribed is None:
            return _by_name("prescribed", prescribed or {})
        values = frozen_array("prescribed", prescribed, (*samples, len(self.actuated)))
        return {name: values[..., i] for i, name in enumerate(self.actuated)}


def _by_name(what: str, values: ByName) -> dict[str, FloatArray]:
    """Return a mapping whose values are arrays of numbers."""
    if not isinstance(values, Mapping):
        raise InputError(f"{what}: expected a mapping of names to accelerations, got {type(values).__name__}")
    return {name: as_floats(f"{what} {name}", value) for name, value in values.items()}


def _hybrid_scaled(
    scaled: ScaledModel[HybridModel],
    state: tuple[FloatArray, FloatArray],
    given: Prescription,
    acting: tuple[External | None, ArrayLike | None],
    stabilisation: float,
) -> HybridDynamics:
    """`HybridModel.hybrid_dynamics` in the model's own unit of length."""
    core, units, joints = scaled.core, scaled.units, given.joints
    places = {
        name: np.asarray(value) / units.motion(np.arange(6) < 3) for name, value in given.frames.items()
    }
    rates = JointAccelerations(joints.v, joints.values / units.motion(units.v[joints.v]))
    asked = Prescription(core._kinematics, rates, places)
    loads = scaled.wrenches(acting[0]), scaled.forces(acting[1])
    with scaled.in_words():
        found = core._hybrid(scaled.q(state[0]), scaled.v(state[1]), asked, *loads, stabilisation)
    return replace(
        found,
        tau=read_only(found.tau * units.force(units.v[core.actuated_v])),
        a=read_only(found.a * units.motion(units.v)),
        evidence=scaled.evidence(found.evidence),
    )


def _solved_scaled(
    scaled: ScaledModel[HybridModel],
    state: tuple[FloatArray, FloatArray],
    prescribed: Prescribed,
    loads: Mapping[str, FloatArray],
    forces: FloatArray,
) -> tuple[BatchHybridDynamics, BoolArray]:
    """`BatchHybrid.solve` in the model's own unit of length."""
    core, units, at = scaled.core, scaled.units, prescribed.at
    lengths = np.concatenate([np.arange(0), *(np.flatnonzero(mask) for _, mask in prescribed.frames)]) < 3
    given = replace(
        prescribed,
        values=prescribed.values / units.motion(units.v[at]),
        of_frames=prescribed.of_frames / units.motion(lengths),
    )
    acting = scaled.wrenches(loads), forces / units.force(units.v)
    with scaled.in_words():
        found, done = core._batch_hybrid.solve(scaled.q(state[0]), scaled.v(state[1]), given, *acting)
    result = replace(
        found,
        tau=found.tau * units.force(units.v[core.actuated_v]),
        a=found.a * units.motion(units.v),
        residual=found.residual * max(units.length, units.length**2),
        closure_error=found.closure_error * units.motion(units.rows),
    )
    return result, done


def _prescribed_alike(
    at: IndexArray, values: FloatArray, places: Mapping[str, FloatArray]
) -> Prescribed | None:
    """Return what is prescribed of joints and frames; None if not the same components at all samples."""
    frames: list[tuple[str, BoolArray]] = []
    columns: list[FloatArray] = [np.zeros((len(values), 0))]
    for name, wanted in places.items():
        if wanted.shape != (len(values), 6) or np.isinf(wanted).any():
            return None  # each sample alone tells what is wrong
        mask = ~np.isnan(wanted[:1]).ravel() if len(wanted) else np.ones(6, dtype=bool)
        if not (np.isnan(wanted) == ~mask).all() or not mask.any():
            return None
        frames.append((name, mask))
        columns.append(wanted[:, mask])
    return Prescribed(at, values, tuple(frames), np.concatenate(columns, axis=1))


def _of_samples(name: str, value: FloatArray, count: int, size: int) -> FloatArray:
    """Return the accelerations (count, size) of a joint; those of one freedom may be plain numbers."""
    if size == 1 and value.ndim < 2 and value.shape != (1,):
        value = np.broadcast_to(value, count) if value.shape == () else value
        return frozen_array(f"prescribed {name}", value, (count,))[:, None]
    return rows_of(f"prescribed {name}", value, count, size)


def acting_rows(
    external: External | None, joint_forces: ArrayLike | None, count: int, nv: int
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return what acts at many samples: wrenches (count, 6) by frame, and forces in joints (count, nv).

    Parameters
    ----------
    external : mapping of str to (6,) or (count, 6) array, optional
        Wrenches.
    joint_forces : (nv,) or (count, nv) array, optional
        Forces; none by default.
    count, nv : int
        How many samples and speeds there are.

    Raises
    ------
    InputError
        If something has another shape or is not finite.
    """
    if external is not None and not isinstance(external, Mapping):
        raise InputError(
            f"external: expected a mapping of frame names to wrenches, got {type(external).__name__}"
        )
    loads = {name: rows_of(f"external {name}", wrench, count, 6) for name, wrench in (external or {}).items()}
    forces = np.zeros(nv) if joint_forces is None else joint_forces
    return loads, rows_of("joint_forces", forces, count, nv)


def rows_of(name: str, value: ArrayLike, count: int, width: int) -> FloatArray:
    """Return rows of a value that may be the same for all.

    Parameters
    ----------
    name : str
        What to call it in an error.
    value : (width,) or (count, width) array
        The value.
    count, width : int
        How many there are, and how long they are.

    Returns
    -------
    (count, width) array

    Raises
    ------
    InputError
        If it has another shape or is not finite.
    """
    array = as_floats(name, value)
    return frozen_array(
        name, np.tile(array, (count, 1)) if array.shape == (width,) else array, (count, width)
    )
