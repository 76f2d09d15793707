"""Equations of motion of a closed mechanism in independent coordinates y, and Jacobians from their speeds.

With v = N ẏ, where J N = 0, the equation of motion (1) of `p3dof.loops.inverse` becomes

    Nᵀ M N ÿ + Nᵀ (C N + M Ṅ) ẏ + Nᵀ g = Nᵀ B τ + Nᵀ (passive and external forces),        (1)

with M, C, g of the tree. Ṁ - 2 C of the tree is skew-symmetric, and so it is here.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, section 3.2 (explicit constraints).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, shown
from p3dof._base.errors import AssemblyError, InputError, SingularityError
from p3dof._base.threads import Workspace
from p3dof.loops.closed_tree import CLOSED, CONSISTENT, Loads
from p3dof.loops.closure_tangents import ClosureTangents
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition, actuation_of
from p3dof.loops.sidecar import Coupling, suggestion
from p3dof.loops.tree_tangents import TangentTree, TreeMotion
from p3dof.loops.units import ScaledTree

IndexArray: TypeAlias = NDArray[np.int_]
Names: TypeAlias = Iterable[str] | str | None
"""Names of joints, or of single freedoms of joints such as ``base[2]``."""

_TIE = 1e-9  # freedoms whose share in a free motion differs by less are alike; the first one counts
_KEPT = 1e-3  # conditioning from which on a choice is kept at another configuration


def coordinate_names(model: pin.Model) -> tuple[str, ...]:
    """Return a name for every entry of v: that of its joint, with an index if the joint has several."""
    return tuple(
        str(model.names[i]) if model.nvs[i] == 1 else f"{model.names[i]}[{k}]"
        for i in range(1, model.njoints)
        for k in range(model.nvs[i])
    )


def named_coordinates(model: pin.Model, names: Iterable[str] | str) -> IndexArray:
    """Return the entries of v that joints or single freedoms of joints have; (n,) array of int."""
    if not isinstance(names, Iterable):
        raise InputError(f"coordinates: expected names of joints, got {shown(names)}")
    all_names, chosen = coordinate_names(model), []
    for name in [names] if isinstance(names, str) else names:
        if isinstance(name, str) and name in all_names:
            chosen.append(all_names.index(name))
        elif isinstance(name, str) and model.existJointName(name) and model.getJointId(name):
            i = model.getJointId(name)
            chosen.extend(range(model.idx_vs[i], model.idx_vs[i] + model.nvs[i]))
        else:
            known = [*map(str, model.names[1:]), *all_names]
            raise InputError(
                f"coordinates: the joint {shown(name)} does not exist; {suggestion(str(name), known)}"
            )
    if len(set(chosen)) < len(chosen):
        twice = next(all_names[k] for k in chosen if chosen.count(k) > 1)
        raise InputError(f"coordinates: {shown(twice)} is named twice")
    return np.array(chosen, dtype=int)


def pivoted(N: FloatArray, first: IndexArray) -> IndexArray:
    """Choose freedoms, those with the largest share in what is open first; `first` ascending, then others."""
    left = N.copy()
    parts: list[list[int]] = []
    for candidates in (np.sort(first), np.setdiff1d(np.arange(len(N)), first)):
        chosen: list[int] = []
        while len(chosen) + sum(len(part) for part in parts) < N.shape[1]:
            size = np.linalg.norm(left[candidates], axis=1)
            largest = size.max(initial=0.0)
            if largest <= RANK_TOLERANCE ** (0.5 if not parts else 1.0):
                break
            pick = candidates[int(np.argmax(size >= (1.0 - _TIE) * largest))]
            row = left[pick] / np.linalg.norm(left[pick])
            left = left - np.outer(left @ row, row)
            chosen.append(int(pick))
        parts.append(sorted(chosen))
    return np.array([*parts[0], *parts[1]], dtype=int)


def default_coordinates(
    point: ClosurePoint, actuated: IndexArray, preferred: Callable[[], IndexArray | None]
) -> IndexArray:
    """Return the actuated freedoms, in their order, where they determine the motion; else a choice.

    `preferred`: returns a choice made elsewhere, to keep where it is good, or None.
    """
    N = point.svd.null_space
    if len(actuated) == N.shape[1] == actuation_of(point.svd, actuated).rank:
        return actuated
    choice = preferred()
    if choice is not None and len(choice) == N.shape[1]:
        s = np.linalg.svd(N[choice], compute_uv=False)
        if s.min(initial=1.0) > _KEPT:
            return choice
    return pivoted(N, actuated)


@dataclass(frozen=True, eq=False)
class Independent:
    """How the tree moves with independent coordinates, at one configuration: v = N ẏ."""

    v: IndexArray  # (n,): the coordinates' entries of v
    names: tuple[str, ...]  # their names
    point: ClosurePoint  # the closures at the configuration

    def __post_init__(self) -> None:
        mobility = self.point.svd.null_space.shape[1]
        if len(self.v) > mobility:
            raise InputError(
                f"coordinates: {len(self.v)} are given, and the mechanism has {mobility} free motions here"
            )
        seen = Decomposition.of(self.point.svd.null_space[self.v], RANK_TOLERANCE, 1.0)
        if seen.rank < mobility:
            raise SingularityError(
                f"the coordinates {', '.join(self.names) or '(none)'} do not determine the motion here: they "
                f"see {seen.rank} of {mobility} free motions"
            )

    @cached_property
    def _inverse(self) -> FloatArray:
        N = self.point.svd.null_space
        return np.asarray(np.linalg.inv(N[self.v]))

    @cached_property
    def N(self) -> FloatArray:  # noqa: N802
        """The motions (nv, n) of the tree at unit speed of each coordinate."""
        N = self.point.svd.null_space @ self._inverse
        N[self.v] = np.eye(len(self.v))
        return N

    @cached_property
    def closing(self) -> FloatArray:
        """The matrix (nv, rows) from what the closures do to the motion that does it, coordinates at rest."""
        pinv = self.point.svd.pseudo_inverse
        return pinv - self.N @ pinv[self.v]


class Setting(Workspace):
    """A robot as its analyses compute it: in its own unit of length, with the units of all numbers."""

    def __init__(self, scaled: ScaledTree) -> None:
        self.scaled, self.robot, self.core = scaled, scaled.tree, scaled.core
        self.kinematics, self.couplings = self.core.kinematics, self.core.sidecar.couplings
        self.actuated_v = self.robot.actuated_v
        self.names = coordinate_names(self.robot.model)
        self.tree = TangentTree(self.core.model)
        self.si_tree = self.tree if self.core is self.robot else TangentTree(self.robot.model)
        self.length = scaled.units.length  # the unit of length [m]
        self.q, self.v, self.force, self.rows = scaled.of_q, scaled.of_v, scaled.of_forces, scaled.of_rows
        self.twist, self.wrench, self.motors = scaled.of_twists, scaled.of_wrenches, scaled.of_motors

    @contextmanager
    def open(self) -> Iterator[None]:
        """Bring masses up to date, and say in errors in which unit their numbers are."""
        with self.scaled.in_words():
            self.tree.refresh()
            if self.si_tree is not self.tree:
                self.si_tree.refresh()
            yield

    def independent(self, q: FloatArray, names: Names, v: FloatArray | None = None) -> Independent:
        """Return independent coordinates in the robot's own units, after checks of the closures."""
        point = self.core.at(q / self.q, CLOSED)
        if v is not None and point.J.size:
            own = v / self.v
            allowed = (CONSISTENT + 100.0 * point.gap) * max(1.0, max_abs(own))
            self.core.check_opening("v", point.J @ own, allowed)
        if names is not None:
            chosen = named_coordinates(self.robot.model, names)
        else:
            chosen = default_coordinates(point, self.actuated_v, lambda: self._reference_choice)
        return Independent(chosen, tuple(self.names[k] for k in chosen), point)

    @cached_property
    def _reference_choice(self) -> IndexArray | None:
        """Coordinates at the reference configuration; None if the loops do not close there."""
        try:
            q = self.core.assemble().q
        except AssemblyError:
            return None
        return pivoted(self.kinematics.at(q).svd.null_space, self.actuated_v)

    def coordinates(self, q: FloatArray, names: Names) -> tuple[str, ...]:
        """Return the names of independent coordinates at a configuration."""
        with self.open():
            return self.independent(q, names).names

    def motion(self, independent: Independent) -> FloatArray:
        """Return N (nv, n) of coordinates in SI units."""
        return np.asarray(self.v[:, None] * independent.N / self.v[independent.v])

    def samples(self, q: ArrayLike, v: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        """Return configurations (N, nq), one at least, and velocities (N, nv), zero by default."""
        q = frozen_array("q", q, ("N", self.robot.model.nq))
        if not len(q):
            raise InputError("q: expected at least one configuration, got none")
        shape = len(q), self.robot.model.nv
        return q, np.zeros(shape) if v is None else frozen_array("v", v, shape)


@dataclass(frozen=True, eq=False)
class MinimalDynamics(Readable):
    """Equations of motion in n independent coordinates y, at one state or (leading axis N) at many.

    mass_matrix ÿ + coriolis_matrix ẏ + gravity_forces = actuation τ + passive_forces + external_forces

    Parameters
    ----------
    coordinates : tuple of str
        Names of the coordinates: joints, or single freedoms of joints that have several, such as ``base[2]``,
        whose speeds are those in `v` (those of a floating base are in its own axes).
    speeds : (..., n) array
        ẏ of the velocity.
    motion : (..., nv, n) array
        N: the velocity of the whole tree is N ẏ.
    motion_rate : (..., nv, n) array
        Ṅ: the acceleration of the whole tree is N ÿ + Ṅ ẏ.
    mass_matrix : (..., n, n) array
        Symmetric, positive definite; rotors included.
    coriolis_matrix : (..., n, n) array
        C, with Ṁ - 2 C skew-symmetric.
    gravity_forces : (..., n) array
        Gradient of the potential energy of the bodies [N or N m].
    actuation : (..., n, m) array
        Forces along the coordinates of unit forces of the actuators, Nᵀ B.
    passive_forces : (..., n) array
        Of springs, damping and friction in the joints [N or N m].
    external_forces : (..., n) array
        Of the external wrenches and joint forces [N or N m].
    """

    coordinates: tuple[str, ...]
    speeds: FloatArray
    motion: FloatArray
    motion_rate: FloatArray
    mass_matrix: FloatArray
    coriolis_matrix: FloatArray
    gravity_forces: FloatArray
    actuation: FloatArray
    passive_forces: FloatArray
    external_forces: FloatArray

    @property
    def coriolis_forces(self) -> FloatArray:
        """C ẏ (..., n), Coriolis and centrifugal forces [N or N m]."""
        return np.asarray((self.coriolis_matrix @ self.speeds[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class FrameJacobian(Readable):
    """How a frame moves with independent coordinates, at one state or (leading axis N) at many.

    Parameters
    ----------
    coordinates : tuple of str
        As in `MinimalDynamics`.
    jacobian : (..., 6, n) array
        Velocity of the frame at unit speed of each coordinate: linear, then angular, in world axes at the
        frame's origin (``LOCAL_WORLD_ALIGNED``).
    drift : (..., 6) array
        Classical acceleration of the frame at zero ÿ, likewise; that of a motion is jacobian ÿ + drift.
    """

    coordinates: tuple[str, ...]
    jacobian: FloatArray
    drift: FloatArray


def motion_rate(
    kinematics: LoopKinematics,
    couplings: Sequence[Coupling],
    tree: TangentTree,
    independent: Independent,
    v: FloatArray,
) -> FloatArray:
    """Return Ṅ (nv, n)."""
    q, rest = independent.point.q, np.zeros(len(v))
    closures = ClosureTangents(kinematics, couplings, TreeMotion(tree, q, v, rest), q, v, rest)
    return -independent.closing @ (closures.jacobian_rate() @ independent.N)


ResultT = TypeVar("ResultT")


def stacked(results: Sequence[ResultT], same: Sequence[str] = ()) -> ResultT:
    """Return the results of many states as one, whose arrays have a leading axis."""
    first = results[0]
    arrays: dict[str, Any] = {
        field.name: np.stack([getattr(one, field.name) for one in results])
        for field in fields(cast("Any", first))
        if field.name not in ("coordinates", *same)
    }
    return cast("ResultT", replace(cast("Any", first), **arrays))


def frame_motion(
    tree: TangentTree, independent: Independent, N_dot: FloatArray, v: FloatArray, frame: pin.Frame
) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian (6, n) of a frame and its drift (6,); parameters as in `motion_rate`."""
    bodies = TreeMotion(tree, independent.point.q, v, N_dot @ v[independent.v])
    J, acceleration, _, _ = bodies.frame(frame)
    return J @ independent.N, acceleration


def minimal_dynamics(
    setting: Setting, q: ArrayLike, v: ArrayLike | None, coordinates: Names, loads: Loads
) -> MinimalDynamics:
    """Return the equations of motion, see `ClosedLoopModel.minimal_dynamics`."""
    if np.ndim(q) == 2:
        q, v = setting.samples(q, v)
        names = setting.coordinates(setting.robot.configuration("q", q[0]), coordinates)
        states = zip(q, v, strict=True)
        return stacked([minimal_dynamics(setting, *state, names, loads) for state in states])
    robot, (q, v) = setting.robot, setting.robot.state(q, v)
    with setting.open():
        at = setting.independent(q, coordinates, v)
        N_dot = motion_rate(setting.kinematics, setting.couplings, setting.tree, at, v / setting.v)
    N, N_dot = setting.motion(at), setting.v[:, None] * N_dot / setting.v[at.v]
    tree, data = setting.si_tree, setting.si_tree.data
    M = tree.mass_matrix(q)
    C = np.array(pin.computeCoriolisMatrix(tree.model, data, q, v))
    robot.kinematics.at(q)
    return MinimalDynamics(
        coordinates=at.names,
        speeds=v[at.v],
        motion=N,
        motion_rate=N_dot,
        mass_matrix=N.T @ M @ N,
        coriolis_matrix=N.T @ (C @ N + M @ N_dot),
        gravity_forces=N.T @ np.array(pin.computeGeneralizedGravity(tree.model, data, q)),
        actuation=N[robot.actuated_v].T.copy(),
        passive_forces=N.T @ robot.passive.forces(q, v),
        external_forces=N.T @ robot.force(loads),
    )


def frame_jacobian(
    setting: Setting, frame: str, q: ArrayLike, v: ArrayLike | None, coordinates: Names
) -> FrameJacobian:
    """Return how a frame moves, see `ClosedLoopModel.frame_jacobian`."""
    if np.ndim(q) == 2:
        q, v = setting.samples(q, v)
        names = setting.coordinates(setting.robot.configuration("q", q[0]), coordinates)
        return stacked([frame_jacobian(setting, frame, *state, names) for state in zip(q, v, strict=True)])
    q, v = setting.robot.state(q, v)
    place = setting.kinematics.frame(frame, "frame", InputError)
    with setting.open():
        at, own = setting.independent(q, coordinates, v), v / setting.v
        N_dot = motion_rate(setting.kinematics, setting.couplings, setting.tree, at, own)
        J, drift = frame_motion(setting.tree, at, N_dot, own, place)
    return FrameJacobian(at.names, setting.twist[:, None] * J / setting.v[at.v], setting.twist * drift)
