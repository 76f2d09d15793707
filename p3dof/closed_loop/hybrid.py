"""Hybrid dynamics: forces for prescribed accelerations, while idle freedoms move as they must.

With S a = s the prescribed accelerations, N the null space of the closures' Jacobian J, and the equation of
motion (1) of `p3dof.closed_loop.dynamics`, unknown are τ and a of

    Nᵀ B τ = Nᵀ (rnea(q, v, a) - Σ Jeᵀ w),    J a = -J̇ v,    S a = s        (1)

Of the free motions, Z are those that S does not see and P the others. T = P - Z (Zᵀ M Z)⁻¹ Zᵀ M P are motions
in which idle freedoms move as they would if they were pushed, so that Tᵀ M Z = 0 and

    Tᵀ B τ = Tᵀ (rnea(q, v, a0) - Σ Jeᵀ w)        (2)

for any a0 that closures and S allow. The idle motions follow from Zᵀ M Z.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, sections 9.1 (hybrid dynamics) and 9.4
(floating bases).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof.checks import FloatArray, as_floats, frozen_array, shown
from p3dof.closed_loop.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.closed_loop.dynamics import Dynamics, read_only
from p3dof.closed_loop.linear import RANK_TOLERANCE, Decomposition
from p3dof.closed_loop.sidecar import suggestion
from p3dof.errors import DynamicsError, InputError, SingularityError

ByName: TypeAlias = Mapping[str, ArrayLike]
"""Joint or frame name → acceleration."""

_ACCURACY = 1e-9
"""Largest error of the equation of motion, relative to the forces in it."""
_ENOUGH = 1e-14
"""The same, from which on nothing is refined."""
_SOLUTIONS = 3
"""Solutions of the linear equations at most; each further one refines the one before."""
_UNSEEN = 1e-7
"""What a force that the prescribed accelerations leave open may do to the idle freedoms."""
_MASSLESS = 1e-15
"""Inertia of an idle motion, relative to the largest, that is none."""


@dataclass(frozen=True, eq=False)
class HybridDynamics:
    """Actuator forces that produce prescribed accelerations, the motion with them, and the evidence.

    Parameters
    ----------
    tau : (n_actuated,) array
        Forces of the actuated joints [N or N m]; the smallest possible if they are not unique.
    a : (nv,) array
        Acceleration of the whole tree: as prescribed, and of the idle freedoms what follows.
    lambda_ : (rows,) array
        Multipliers of closures and couplings, as in `InverseDynamics`.
    unique : (rows,) array of bool
        Which multipliers are determined.
    tau_unique : bool
        Whether `tau` is determined; not so if actuators can work against each other without any motion.
    rank, mobility : int
        Rank of the closures' Jacobian, and nv - rank.
    conditioning : float
        Smallest singular value of S N, where S picks the prescribed accelerations and N are the orthonormal
        free motions: how well they are seen. It is 0 where they cannot be chosen freely.
    residual : float
        Largest error of the full equation of motion [N or N m].
    prescribed_residual : float
        Largest error of a prescribed acceleration [m/s² or rad/s²].
    closure_residual : float
        Largest relative acceleration that is left at a closure, J a + J̇ v [m/s² or rad/s²].
    gap : float
        Largest closure error of the configuration [m or rad].
    """

    tau: FloatArray
    a: FloatArray
    lambda_: FloatArray
    unique: NDArray[np.bool_]
    tau_unique: bool
    rank: int
    mobility: int
    conditioning: float
    residual: float
    prescribed_residual: float
    closure_residual: float
    gap: float


class Prescription:
    """Prescribed accelerations of joints and frames, checked against a model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    joints : mapping of str to (n,) array
        Accelerations by joint, as many as it has freedoms.
    frames : mapping of str to (6,) array
        Classical ``LOCAL_WORLD_ALIGNED`` accelerations of frames; NaN where one is left free.

    Raises
    ------
    InputError
        If a name does not exist, or values have the wrong shape or are not finite.
    """

    def __init__(self, kinematics: LoopKinematics, joints: ByName, frames: ByName) -> None:
        self._kinematics, model = kinematics, kinematics.model
        parts = [joint_freedoms(model, name) for name in joints]
        self.v = np.array([k for part in parts for k in part], dtype=int)
        """Indices in v of the prescribed joints."""
        values = [joint_values(name, joints[name], len(k)) for name, k in zip(joints, parts, strict=True)]
        self._frames = [kinematics.frame(name, "frames", InputError) for name in frames]
        wanted = [frame_values(name, value) for name, value in frames.items()]
        self._masks = [np.isfinite(value) for value in wanted]
        chosen = [value[mask] for value, mask in zip(wanted, self._masks, strict=True)]
        self.values = np.concatenate([np.zeros(0), *values, *chosen])
        """All prescribed accelerations, (size,)."""

    def rows(self, q: FloatArray) -> FloatArray:
        """Return S (size, nv) at a configuration."""
        k = self._kinematics
        k.at(q)
        S = np.zeros((len(self.values), k.model.nv))
        S[np.arange(len(self.v)), self.v] = 1.0
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
        for frame, mask in zip(self._frames, self._masks, strict=True):
            ends = (frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED)
            parts.append(pin.getFrameClassicalAcceleration(k.model, k.data, *ends).vector[mask])
        return np.concatenate(parts)


def joint_freedoms(model: pin.Model, name: str) -> range:
    """Return the indices in v of a joint.

    Parameters
    ----------
    model : pin.Model
        The tree.
    name : str
        The joint's name.

    Returns
    -------
    range

    Raises
    ------
    InputError
        If there is no such joint.
    """
    if not isinstance(name, str) or not model.existJointName(name) or not model.getJointId(name):
        known = [str(joint) for joint in model.names[1:]]
        raise InputError(
            f"prescribed: the joint {shown(name)} does not exist; {suggestion(str(name), known)}"
        )
    joint = model.getJointId(name)
    return range(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])


def joint_values(name: str, value: ArrayLike, size: int) -> FloatArray:
    """Return the accelerations (size,) of a joint; those of one freedom may be a plain number.

    Parameters
    ----------
    name : str
        The joint's name.
    value : float or (size,) array
        Its accelerations.
    size : int
        How many it has.

    Returns
    -------
    (size,) array

    Raises
    ------
    InputError
        If the shape is another one, or a value is not finite.
    """
    array = as_floats(f"prescribed {name}", value)
    if array.shape == () and size == 1:
        return frozen_array(f"prescribed {name}", array, ()).reshape(1)
    return frozen_array(f"prescribed {name}", array, (size,))


def frame_values(name: str, value: ArrayLike) -> FloatArray:
    """Return the accelerations (6,) of a frame, NaN where free.

    Parameters
    ----------
    name : str
        The frame's name.
    value : (6,) array
        Its accelerations.

    Returns
    -------
    (6,) array

    Raises
    ------
    InputError
        If the shape is another one, a value is infinite, or none is prescribed.
    """
    array = as_floats(f"frames {name}", value)
    frozen_array(f"frames {name}", np.where(np.isnan(array), 0.0, array), (6,))
    if np.isnan(array).all():
        raise InputError(f"frames {name}: expected at least one prescribed component, all are NaN")
    return array


def hybrid_dynamics(
    dynamics: Dynamics, point: ClosurePoint, v: FloatArray, given: Prescription, external: FloatArray
) -> HybridDynamics:
    """Return the forces that produce prescribed accelerations, and the motion with them.

    Parameters
    ----------
    dynamics : Dynamics
        The model.
    point : ClosurePoint
        The closures at the configuration.
    v : (nv,) array
        Velocity.
    given : Prescription
        The prescribed accelerations.
    external : (nv,) array
        Generalised force of everything that is no actuator.

    Returns
    -------
    HybridDynamics

    Raises
    ------
    SingularityError
        If the actuators cannot produce such accelerations at this configuration.
    DynamicsError
        If the accelerations depend on each other, leave forces open, or need one that no actuator gives.
    """
    k, svd, actuated = dynamics.kinematics, point.svd, dynamics.actuated_v
    S = given.rows(point.q)
    k.move(point.q, v)
    drift, wanted = k.acceleration(), given.values - given.drift()
    N = svd.null_space
    seen = Decomposition.of(S @ N, RANK_TOLERANCE, max(1.0, max_abs(S)))
    _check_choice(seen, len(S), N.shape[1])
    a = -svd.solve(drift) if point.J.size else np.zeros(len(v))
    a = a + N @ seen.solve(wanted - S @ a)
    T, Z = _motions(dynamics.mass_matrix(point.q), N @ seen.Vt[: seen.rank].T, N @ seen.null_space)
    actuation = Decomposition.of(T[actuated].T, RANK_TOLERANCE, float(np.linalg.norm(T)))
    _check_determined(actuation, N[actuated], len(wanted))
    tau: FloatArray = np.zeros(len(actuated))
    for step in range(_SOLUTIONS + 1):
        force = dynamics.tree_force(point.q, v, a) - external
        size = max(max_abs(force), max_abs(tau))
        force[actuated] -= tau
        if step == _SOLUTIONS or (step and max_abs(N.T @ force) <= _ENOUGH * size):
            break
        more = actuation.solve(T.T @ force)
        tau = tau + more
        remaining = force.copy()
        remaining[actuated] -= more
        a = a - Z @ (Z.T @ remaining)
    missing = max_abs(N.T @ force)
    fits = missing <= _ACCURACY * size or missing <= _ACCURACY * dynamics.scale(point.q, v, a, external)
    if not fits:  # also when something is not a number
        _refuse(missing, actuation, len(wanted), len(tau))
    lambda_ = svd.solve_transpose(force)
    return HybridDynamics(
        tau=read_only(tau),
        a=read_only(a),
        lambda_=read_only(lambda_),
        unique=read_only(dynamics.determined(svd, actuation)),
        tau_unique=actuation.rank == len(tau),
        rank=svd.rank,
        mobility=N.shape[1],
        conditioning=float(seen.s[-1]) if seen.s.size else 1.0,
        residual=max_abs(force - point.J.T @ lambda_),
        prescribed_residual=max_abs(S @ a - wanted),
        closure_residual=max_abs(point.J @ a + drift),
        gap=point.gap,
    )


def _motions(M: FloatArray, P: FloatArray, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return T (nv, n) and Z (nv, k) of the module's notes, Z such that Zᵀ M Z = 1."""
    try:
        root = np.linalg.cholesky(Z.T @ M @ Z)
    except np.linalg.LinAlgError as error:
        raise DynamicsError("an idle freedom of the mechanism has no inertia") from error
    pivots = np.diag(root)
    if pivots.size and pivots.min() ** 2 <= _MASSLESS * pivots.max() ** 2:
        raise DynamicsError("an idle freedom of the mechanism has no inertia")
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
    if max_abs(B.T @ actuation.null_space) > _UNSEEN:
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
