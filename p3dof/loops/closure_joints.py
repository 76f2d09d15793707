"""Closures as joints: which forces and moments they transmit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, as_floats, frozen_array, shown
from p3dof._base.errors import InputError, ModelError
from p3dof._base.threads import Own
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.linear import Decomposition
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.sidecar import Sidecar


@dataclass(frozen=True)
class ClosureJoint(Readable):
    """How a closure is built: how its two bodies can move; it transmits every other force and moment.

    Parameters
    ----------
    axes1 : tuple of (3,) tuples
        Free axes of rotation that are fixed in `frame1` of the closure, in its axes.
    axes2 : tuple of (3,) tuples
        Free axes of rotation that are fixed in `frame2`, in its axes.
    slides : tuple of (3,) tuples
        Free directions of translation of the origin of `frame2`, in the axes of `frame1`.
    rod : bool
        Whether the origins are held apart by a rod instead: no force but along it, and no moment.

    Raises
    ------
    ModelError
        If an axis is not three finite numbers, or is zero.
    """

    axes1: tuple[tuple[float, float, float], ...] = ()
    axes2: tuple[tuple[float, float, float], ...] = ()
    slides: tuple[tuple[float, float, float], ...] = ()
    rod: bool = False

    def __post_init__(self) -> None:
        for field in ("axes1", "axes2", "slides"):
            axes = getattr(self, field)
            if not isinstance(axes, tuple | list):
                raise ModelError(f"{field}: expected a tuple of axes, got {shown(axes)}")
            object.__setattr__(self, field, tuple(_unit(field, axis) for axis in axes))

    @classmethod
    def ball(cls) -> ClosureJoint:
        """Return a ball joint: it transmits a force only."""
        return cls(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))

    @classmethod
    def universal(cls, axis1: ArrayLike, axis2: ArrayLike) -> ClosureJoint:
        """Return a universal joint: it transmits a force, and a moment across both its axes.

        Parameters
        ----------
        axis1, axis2 : (3,) array
            The axis in each body, in the axes of `frame1` and of `frame2`.
        """
        return cls((_unit("axis1", axis1),), (_unit("axis2", axis2),))

    @classmethod
    def revolute(cls, axis: ArrayLike) -> ClosureJoint:
        """Return a hinge: it transmits a force, and both moments across its axis.

        Parameters
        ----------
        axis : (3,) array
            The axis, in the axes of `frame1`.
        """
        return cls((_unit("axis", axis),))

    @classmethod
    def weld(cls) -> ClosureJoint:
        """Return a rigid connection: it transmits every force and moment."""
        return cls()

    @classmethod
    def of_kind(cls, kind: str) -> ClosureJoint:
        """Return the joint that transmits just what a kind of closure prescribes.

        Parameters
        ----------
        kind : str
            One of the kinds of `Closure`.
        """
        x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        return {
            "3d": cls((x, y, z)),
            "6d": cls(),
            "hinge": cls((z,)),
            "slider": cls(slides=(z,)),
            "universal": cls((x,), (y,)),
            "cylindrical": cls((z,), slides=(z,)),
            "planar": cls((z,), slides=(x, y)),
            "distance": cls((x, y, z), rod=True),
        }[kind]

    def forces(self, d: FloatArray) -> FloatArray:
        """Return an orthonormal basis (..., 3, k) of the forces that it transmits, in the axes of `frame1`.

        Parameters
        ----------
        d : (..., 3) array
            Origin of `frame2` from that of `frame1`, in the axes of `frame1` [m].
        """
        if self.rod:
            return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))[..., None]
        basis = np.eye(3)
        if self.slides:
            basis = Decomposition.of(np.array(self.slides)).null_space
        return np.broadcast_to(basis, (*d.shape[:-1], *basis.shape))

    def moments(self, rotation: FloatArray) -> FloatArray:
        """Return an orthonormal basis (3, k) of the moments that it transmits, in the axes of `frame1`.

        Parameters
        ----------
        rotation : (3, 3) array
            Axes of `frame2` in those of `frame1`.
        """
        free = np.array([*self.axes1, *(rotation @ axis for axis in self.axes2)]).reshape(-1, 3)
        return Decomposition.of(free).null_space


def joints_of(sidecar: Sidecar, joints: Sequence[ClosureJoint] | None) -> tuple[ClosureJoint, ...]:
    """Return one joint for each closure."""
    closures = sidecar.closures
    if joints is None:
        return tuple(ClosureJoint.of_kind(closure.kind) for closure in closures)
    if not isinstance(joints, Sequence) or not all(isinstance(joint, ClosureJoint) for joint in joints):
        raise ModelError(f"joints: expected a sequence of ClosureJoint, got {shown(joints)}")
    if len(joints) != len(closures):
        raise ModelError(f"joints: expected {len(closures)}, one for each closure, got {len(joints)}")
    return tuple(joints)


def _unit(name: str, axis: ArrayLike) -> tuple[float, float, float]:
    array = frozen_array(name, axis, (3,), ModelError)
    length = float(np.linalg.norm(array))
    if not length > 0:
        raise ModelError(f"{name}: expected an axis, got zeros")
    x, y, z = (float(value) / length for value in array)
    return x, y, z


_NONE, _PARTLY, _WHOLLY = 0, 1, 2


@dataclass(frozen=True, eq=False)
class ClosureWrench:
    """What closures exert on the bodies of their second frames; those of the first ones get the opposite."""

    places: FloatArray  # (n, 3): origins of the second frames, where the forces act [m]
    forces: FloatArray  # (n, 3): in world axes [N, N m]: what the multipliers that are known make up
    moments: FloatArray
    determined: NDArray[np.int_]
    """(n,): 2 where all multipliers of the closure are known, 1 where some are, 0 where none is."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether anything of a closure is known, (n,)."""
        return np.asarray(self.determined != _NONE)

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Whether all of a closure is known, (n,)."""
        return np.asarray(self.determined == _WHOLLY)


class ClosureWrenches:
    """Turns multipliers of a robot's closures into forces and moments in space."""

    def __init__(self, loop: LoopModel) -> None:
        self._kinematics = LoopKinematics(loop.model, loop.sidecar)
        self._data = Own(loop.model.createData)

    def places(self, q: ArrayLike) -> tuple[list[pin.SE3], list[pin.SE3]]:
        """Return where the first and the second frames of the closures are, at joints (nq,)."""
        model, data = self._kinematics.model, self._data.here
        pin.forwardKinematics(model, data, frozen_array("q", q, (model.nq,)))
        ends = self._kinematics.ends
        return [data.oMi[a] * A for a, A, _, _ in ends], [data.oMi[b] * B for _, _, b, B in ends]

    def at(self, q: ArrayLike, multipliers: ArrayLike) -> ClosureWrench:
        """Return what the closures exert."""
        k = self._kinematics
        lambda_ = as_floats("multipliers", multipliers)
        if lambda_.shape != (k.size,):
            raise InputError(f"multipliers: expected shape ({k.size},), got {lambda_.shape}")
        first, second = self.places(q)
        wrenches, determined = np.zeros((len(first), 6)), np.full(len(first), _PARTLY)
        for i, rates in enumerate(self._rates(first, second)):
            own = lambda_[k.rows[i]]
            known = np.isfinite(own)
            wrench = rates[known].T @ own[known]
            wrenches[i] = (wrench.reshape(2, 3) @ first[i].rotation.T).reshape(6)
            if not known.any() or known.all():
                determined[i] = _WHOLLY if known.all() else _NONE
        places = np.array([end.translation for end in second]).reshape(-1, 3)
        return ClosureWrench(places, wrenches[:, :3], wrenches[:, 3:], determined)

    def _rates(self, first: list[pin.SE3], second: list[pin.SE3]) -> list[FloatArray]:
        """Return, by closure, the matrix (rows, 6) from the relative motion (ḋ, ω) to the errors' rates."""
        k = self._kinematics
        found = [np.eye(6)[: closure.rows] for closure in k.closures]  # of points and frames
        between = [first[i].actInv(second[i]) for i in k.own]
        turn = np.zeros((len(between), 3))
        for i in k.kinds.turning:
            turn[i] = pin.log3(between[i].rotation)
        d = np.array([place.translation for place in between]).reshape(-1, 3)
        axes = np.array([place.rotation for place in between]).reshape(-1, 3, 3)
        for group in k.kinds.at(d, axes, turn):
            for number, rates in zip(np.arange(len(between))[group.which], group.A, strict=True):
                found[k.own[number]] = rates
        return found
