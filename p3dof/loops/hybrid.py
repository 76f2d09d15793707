"""Hybrid dynamics: forces for prescribed accelerations, while passive freedoms move freely.

With S a = s the prescribed accelerations, N the null space of the closures' Jacobian J, and the equation of
motion (1) of `p3dof.loops.inverse`, unknown are τ and a of

    Nᵀ B τ = Nᵀ (rnea(q, v, a) - Σ Jeᵀ w),    J a = -J̇ v,    S a = s        (1)

Of the free motions, Z are those that S does not see and P the others. T = P - Z (Zᵀ M Z)⁻¹ Zᵀ M P are motions
in which passive freedoms move as they would if they were pushed, so that Tᵀ M Z = 0 and

    Tᵀ B τ = Tᵀ (rnea(q, v, a0) - Σ Jeᵀ w)        (2)

for any a0 that closures and S allow. The idle motions follow from Zᵀ M Z.

Z and P come from a partition of the rows of J and S together (see `p3dof.loops.partitions`), where one
is good enough and there are as many prescribed accelerations as actuators. Else they come from the singular
value decomposition of J, which decides on whatever cannot be done.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, sections 9.1 (hybrid dynamics) and 9.4
(floating bases).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array, shown
from p3dof._base.errors import DynamicsError, InputError, SingularityError
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.coordinates import ACCURACY, NO_CHANGE, WELL
from p3dof.loops.linear import RANK_TOLERANCE, UNIQUE, Decomposition, lapack
from p3dof.loops.partitions import IndexArray, Memory, Split, Terms
from p3dof.loops.results import HybridDynamics, PrescribedMotion, read_only
from p3dof.loops.sidecar import suggestion

KINDS = 16
"""How many kinds of prescription are remembered."""
ByName: TypeAlias = Mapping[str, ArrayLike]  # joint or frame name → acceleration


@dataclass(frozen=True, eq=False)
class JointAccelerations:
    """Prescribed accelerations of joints, at one sample or at many."""

    v: IndexArray  # (n,): indices in v
    values: FloatArray  # (..., n): the accelerations [m/s² or rad/s²]

    @classmethod
    def by_name(cls, model: pin.Model, joints: ByName) -> JointAccelerations:
        """Return those of joints by name."""
        parts = [joint_freedoms(model, name) for name in joints]
        values = [joint_values(name, joints[name], len(k)) for name, k in zip(joints, parts, strict=True)]
        at = np.array([k for part in parts for k in part], dtype=int)
        return cls(at, np.concatenate([np.zeros(0), *values]))


class Prescription:
    """Prescribed accelerations of joints and frames of a model."""

    def __init__(self, kinematics: LoopKinematics, joints: JointAccelerations, frames: ByName) -> None:
        self._kinematics, self.joints, self.frames = kinematics, joints, frames
        self.v = joints.v  # indices in v of the prescribed joints
        self._frames = [kinematics.frame(name, "frames", InputError) for name in frames]
        wanted = [frame_values(name, value) for name, value in frames.items()]
        self._masks = [np.isfinite(value) for value in wanted]
        chosen = [value[mask] for value, mask in zip(wanted, self._masks, strict=True)]
        self.values = np.concatenate([joints.values, *chosen]) if chosen else joints.values
        """All prescribed accelerations, (size,)."""

    @classmethod
    def of(
        cls,
        kinematics: LoopKinematics,
        actuated_v: IndexArray,
        joints: ArrayLike | ByName | None,
        frames: ByName | None,
    ) -> Prescription:
        """Return what a user prescribes: of the actuated joints in their order or by name, and of frames."""
        if isinstance(joints, Mapping) or joints is None:
            known = JointAccelerations.by_name(kinematics.model, by_name("prescribed", joints or {}))
        else:
            known = JointAccelerations(actuated_v, frozen_array("prescribed", joints, (len(actuated_v),)))
        return cls(kinematics, known, by_name("frames", frames or {}))

    @property
    def kind(self) -> tuple[object, ...]:
        """What is prescribed, without the values."""
        frames = (
            (f.parentJoint, f.placement.translation.tobytes(), f.placement.rotation.tobytes())
            for f in self._frames
        )
        return (self.v.tobytes(), *frames, *(mask.tobytes() for mask in self._masks))

    def rows(self, q: FloatArray) -> FloatArray:
        """Return S (size, nv) at a configuration."""
        k = self._kinematics
        k.at(q)
        S = np.zeros((len(self.values), k.model.nv))
        S[range(len(self.v)), self.v] = 1.0
        start = len(self.v)
        for frame, mask in zip(self._frames, self._masks, strict=True):
            ends = (frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED)
            J = pin.getFrameJacobian(k.model, k.data, *ends)[mask]
            S[start : start + len(J)] = J
            start += len(J)
        return S

    def drift(self) -> FloatArray:
        """Return the accelerations (size,) at zero joint acceleration, after `LoopKinematics.move`."""
        k, parts = self._kinematics, [np.zeros(len(self.v))]
        if not self._frames:
            return parts[0]
        for frame, mask in zip(self._frames, self._masks, strict=True):
            ends = (frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED)
            parts.append(pin.getFrameClassicalAcceleration(k.model, k.data, *ends).vector[mask])
        return np.concatenate(parts)


def by_name(what: str, values: ByName) -> dict[str, FloatArray]:
    """Return a mapping whose values are arrays of numbers."""
    if not isinstance(values, Mapping):
        raise InputError(f"{what}: expected a mapping of names to accelerations, got {type(values).__name__}")
    return {name: as_floats(f"{what} {name}", value) for name, value in values.items()}


def by_joint(what: str, values: ByName, joints: Sequence[str], rest: float | None = None) -> FloatArray:
    """Return values by joint in the order of `joints`, on the last axis; `rest` for those without, if any."""
    for name in (name for name in values if name not in joints):
        raise InputError(f"{what}: no joint {shown(name)} is asked for; {suggestion(str(name), joints)}")
    if rest is None and len(values) < len(joints):
        missing = ", ".join(name for name in joints if name not in values)
        raise InputError(f"{what}: expected a value of each joint, got none of {missing}")
    rows = [as_floats(f"{what} {name}", values.get(name, rest)) for name in joints]
    if len({len(row) for row in rows if row.ndim}) > 1 or any(row.ndim > 1 for row in rows):
        raise InputError(f"{what}: expected a number of each joint, or arrays of one length")
    return np.stack(np.broadcast_arrays(*rows), axis=-1) if rows else np.zeros(0)


def rates_of(target: Any, rates: tuple[Any, Any], actuated: Sequence[str]) -> tuple[ArrayLike, ArrayLike]:
    """Return velocity and acceleration of a target in its order; they may be given by joint, as it is."""
    found, named = [*rates], isinstance(target, Mapping)
    for k, what in enumerate(("velocity", "acceleration")):
        if isinstance(rates[k], Mapping):
            parts = target if isinstance(target, list | tuple) else [target]
            if not named and any(x is None or isinstance(x, Mapping) or hasattr(x, "frame") for x in parts):
                raise InputError(f"{what}: expected an array, got names; these belong to a target of joints")
            found[k] = by_joint(what, rates[k], [*target] if named else actuated)
    return found[0], found[1]


def joint_freedoms(model: pin.Model, name: str) -> range:
    """Return the indices in v of a joint."""
    if not isinstance(name, str) or not model.existJointName(name) or not model.getJointId(name):
        known = [str(joint) for joint in model.names[1:]]
        raise InputError(
            f"prescribed: the joint {shown(name)} does not exist; {suggestion(str(name), known)}"
        )
    joint = model.getJointId(name)
    return range(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])


def joint_values(name: str, value: ArrayLike, size: int) -> FloatArray:
    """Return the accelerations (size,) of a joint; those of one freedom may be a plain number."""
    array = as_floats(f"prescribed {name}", value)
    if array.shape == () and size == 1:
        return frozen_array(f"prescribed {name}", array, ()).reshape(1)
    return frozen_array(f"prescribed {name}", array, (size,))


def frame_values(name: str, value: ArrayLike) -> FloatArray:
    """Return the accelerations (6,) of a frame, NaN where free."""
    array = as_floats(f"frames {name}", value)
    frozen_array(f"frames {name}", np.where(np.isnan(array), 0.0, array), (6,))
    if np.isnan(array).all():
        raise InputError(f"frames {name}: expected at least one prescribed component, all are NaN")
    return array


_SOLUTIONS = 3  # solutions of the linear equations at most; each further one refines the one before
_MASSLESS = 1e-15  # inertia of an idle motion, relative to the largest, that is none


class Hybrid:
    """Hybrid dynamics of one model."""

    def __init__(self, terms: Terms) -> None:
        self._terms, self._actuated = terms, terms.actuated_v
        self._memories: dict[Any, Memory] = {}

    def solve(
        self,
        point: ClosurePoint,
        v: FloatArray,
        given: Prescription,
        external: FloatArray,
        stabilisation: float = 0.0,
    ) -> HybridDynamics:
        """Return the forces that produce prescribed accelerations, and the motion with them."""
        k = self._terms.kinematics
        S = given.rows(point.q)
        k.move(point.q, v)
        drift = k.acceleration()
        if stabilisation and point.J.size:
            drift = drift + stabilisation * (2.0 * point.J.dot(v) + stabilisation * point.error)
        task = _Task(point, v, S, drift, given.values - given.drift(), external)
        if len(S) == len(self._actuated) > 0:
            both = ClosurePoint(point.q, point.error, np.concatenate((point.J, S)))
            split = self._memory(given.kind).at(both)
            found = None if split is None else self._partitioned(split, task)
            if found is not None:
                return found
        return self._projected(task)

    def _memory(self, kind: Any) -> Memory:
        """Return what was of use at the last sample where the same accelerations were prescribed."""
        if kind not in self._memories:
            if len(self._memories) >= KINDS:
                self._memories.clear()
            self._memories[kind] = Memory(np.arange(self._terms.model.nv))
        return self._memories[kind]

    def _partitioned(self, split: Split, task: _Task) -> HybridDynamics | None:
        """Return the forces by a partition of J and S together; None where these are not certain."""
        terms, actuated, partition, rows = self._terms, self._actuated, split.partition, split.rows
        closures, size = len(task.point.J), len(task.S)
        own = partition.rows < closures
        if len(own) - np.count_nonzero(own) != size:
            return None  # some are redundant
        of_closures = split.weights[len(own) - size :]
        if np.abs(of_closures).max(initial=0.0) > task.point.rank_tolerance:
            return None  # what is prescribed follows from the closures: these have more rows than are chosen
        # The chosen rows of S are the last ones, in their order. Unknown are Z | P | a.
        known, free, idle = len(own) - size, partition.free, len(partition.free)
        asked = np.zeros((len(own), idle + size + 1), order="F")
        asked[:, :idle] = -rows.take(free, axis=1)
        asked[known:, idle:-1] = np.eye(size)
        asked[:known, -1] = -task.drift[partition.rows[:known]]
        asked[known:, -1] = task.wanted
        found = np.zeros((len(task.v), idle + size + 1))
        found[free, :idle] = np.eye(idle)
        found[partition.dependent] = split.solve(asked)
        Z, T, a = found[:, :idle], found[:, idle:-1], found[:, -1].copy()
        if idle:
            half = terms.half_mass_matrix(task.point.q)
            MZ = half.dot(Z) + half.T.dot(Z)
            root, wrong = lapack().dpotrf(Z.T.dot(MZ))
            inertia = root.diagonal()
            if wrong or not inertia.min() ** 2 > 1e3 * _MASSLESS * inertia.max() ** 2:
                return None
            T = T - Z.dot(lapack().dpotrs(root, MZ.T.dot(T))[0])
        lu, pivots, _ = lapack().dgetrf(T[actuated].T)
        if not lapack().dgecon(lu, sqrt(np.vdot(T, T)))[0] >= WELL:
            return None
        tau: FloatArray = np.zeros(size)
        for step in range(_SOLUTIONS + 1):
            left = terms.tree_force(task.point.q, task.v, a) - task.external
            left[actuated] -= tau
            lambda_ = split.solve_transpose(left.take(partition.dependent))[:known]
            missing = left - lambda_.dot(rows[:known])  # as in `Forward`
            if step == _SOLUTIONS:
                break
            more = lapack().dgetrs(lu, pivots, missing.dot(T))[0]
            remaining = missing.copy()
            remaining[actuated] -= more
            change = lapack().dpotrs(root, remaining.dot(Z))[0] if idle else tau[:0]
            settled = change.dot(change) <= NO_CHANGE**2 * a.dot(a)
            if step and settled and more.dot(more) <= NO_CHANGE**2 * tau.dot(tau):
                break
            tau = tau + more
            a -= Z.dot(change)
        result = self._result(task, left, tau, a)
        opened, off = result.evidence.opening, result.evidence.off
        forces = (tau.dot(tau) + left.dot(left)) / len(left)  # no more than the largest ones, squared
        rates = max(1.0, a.dot(a) / len(a), task.drift.dot(task.drift) / max(1, len(task.drift)))
        good = missing.dot(missing) <= ACCURACY**2 * forces
        good = good and opened.dot(opened) + off.dot(off) <= ACCURACY**2 * rates
        return result if good else None  # not good also when something is not a number

    def _projected(self, task: _Task) -> HybridDynamics:
        """Return the forces by the singular value decomposition of J, or say why there are none."""
        terms, point, v, S, svd = self._terms, task.point, task.v, task.S, task.point.svd
        actuated, drift, wanted, external = self._actuated, task.drift, task.wanted, task.external
        N = svd.null_space
        seen = Decomposition.of(S @ N, RANK_TOLERANCE, max(1.0, max_abs(S)))
        _check_choice(seen, len(S), N.shape[1])
        a = -svd.solve(drift) if point.J.size else np.zeros(len(v))
        a = a + N @ seen.solve(wanted - S @ a)
        T, Z = _motions(terms.mass_matrix(point.q), N @ seen.Vt[: seen.rank].T, N @ seen.null_space)
        actuation = Decomposition.of(T[actuated].T, RANK_TOLERANCE, float(np.linalg.norm(T)))
        _check_determined(actuation, N[actuated], len(wanted))
        tau: FloatArray = np.zeros(len(actuated))
        for step in range(_SOLUTIONS + 1):
            force = terms.tree_force(point.q, v, a) - external
            size = max(max_abs(force), max_abs(tau))
            force[actuated] -= tau
            remaining = force - point.J.T @ svd.solve_transpose(force)  # as in `Forward`
            missing = max_abs(N.T @ remaining)
            if step == _SOLUTIONS:
                break
            more = actuation.solve(T.T @ remaining)
            remaining[actuated] -= more
            change = Z @ (Z.T @ remaining)
            small = max_abs(more) <= NO_CHANGE * max_abs(tau) and max_abs(change) <= NO_CHANGE * max_abs(a)
            if step and small and missing <= NO_CHANGE * size:
                break
            tau, a = tau + more, a - change
        fits = missing <= ACCURACY * size or missing <= ACCURACY * terms.scale(point.q, v, a, external)
        if not fits:  # also when something is not a number
            _refuse(missing, actuation, len(wanted), len(tau))
        return self._result(task, force, tau, a)

    def _result(self, task: _Task, force: FloatArray, tau: FloatArray, a: FloatArray) -> HybridDynamics:
        opening, off = task.point.J.dot(a) + task.drift, task.S.dot(a) - task.wanted
        evidence = PrescribedMotion(task.point, force, self._actuated, task.S, (opening, off))
        return HybridDynamics(read_only(tau), read_only(a), evidence)


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked at one sample."""

    point: ClosurePoint  # the closures
    v: FloatArray  # (nv,): velocity
    S: FloatArray  # (size, nv): the matrix from accelerations to the prescribed ones
    drift: FloatArray  # (rows,): J̇ v
    wanted: FloatArray  # (size,): S a
    external: FloatArray  # (nv,): generalised force of everything that is no actuator


def _motions(M: FloatArray, P: FloatArray, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return T (nv, n) and Z (nv, k) of the module's notes, Z such that Zᵀ M Z = 1."""
    try:
        root = np.linalg.cholesky(Z.T @ M @ Z)
    except np.linalg.LinAlgError as error:
        raise DynamicsError("a passive degree of freedom has no inertia") from error
    pivots = np.diag(root)
    if pivots.size and pivots.min() ** 2 <= _MASSLESS * pivots.max() ** 2:
        raise DynamicsError("a passive degree of freedom has no inertia")
    Z = np.linalg.solve(root, Z.T).T
    return P - Z @ (Z.T @ (M @ P)), Z


def _check_choice(seen: Decomposition, size: int, mobility: int) -> None:
    """Refuse prescribed accelerations that depend on each other."""
    if seen.rank < size:
        raise DynamicsError(
            f"the prescribed accelerations depend on each other: {size} are prescribed, and the mechanism, "
            f"which has {mobility} free motions here, can choose {seen.rank} of them"
        )


def _check_determined(actuation: Decomposition, B: FloatArray, size: int) -> None:
    """Refuse what leaves forces open that move something; B (n_actuated, mobility) is that of Bᵀ N."""
    if max_abs(B.T @ actuation.null_space) > UNIQUE:
        count = len(B)
        raise DynamicsError(
            f"the forces are not determined: {size} prescribed accelerations leave {count - actuation.rank} "
            f"of the {count} actuators' forces open; prescribe as many accelerations as there are actuators"
        )


def _refuse(missing: float, actuation: Decomposition, size: int, count: int) -> None:
    """Say why forces do not produce the prescribed accelerations."""
    if size <= count and actuation.rank < size:
        raise SingularityError(
            f"the actuators cannot produce the prescribed accelerations here: they act on {actuation.rank} "
            f"of the {size} (smallest singular value {float(actuation.s[-1]):.1e})"
        )
    raise DynamicsError(
        f"the prescribed accelerations need a force that no actuator gives: {missing:.3g} N or N m is "
        f"missing ({count} actuators, {size} prescribed accelerations)"
    )
