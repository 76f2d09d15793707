"""Closures as joints: which forces and moments they transmit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, frozen_array, shown
from p3dof._base.errors import ModelError
from p3dof.loops.linear import Decomposition

if TYPE_CHECKING:  # what the machine's joints transmit is known without Pinocchio
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
