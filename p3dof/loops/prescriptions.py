"""Prescribed accelerations of joints and frames, for hybrid dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.partitions import IndexArray
from p3dof.loops.sidecar import suggestion

KINDS = 16
"""How many kinds of prescription are remembered."""
ByName: TypeAlias = Mapping[str, ArrayLike]
"""Joint or frame name → acceleration."""


@dataclass(frozen=True, eq=False)
class JointAccelerations:
    """Prescribed accelerations of joints, at one sample or at many.

    Parameters
    ----------
    v : (n,) array of int
        Indices in v.
    values : (..., n) array
        The accelerations [m/s² or rad/s²].
    """

    v: IndexArray
    values: FloatArray

    @classmethod
    def by_name(cls, model: pin.Model, joints: ByName) -> JointAccelerations:
        """Return those of joints by name.

        Parameters
        ----------
        model : pin.Model
            The tree.
        joints : mapping of str to float or (n,) array
            Accelerations by joint, as many as it has freedoms.

        Raises
        ------
        InputError
            If a joint does not exist, or values have the wrong shape or are not finite.
        """
        parts = [joint_freedoms(model, name) for name in joints]
        values = [joint_values(name, joints[name], len(k)) for name, k in zip(joints, parts, strict=True)]
        at = np.array([k for part in parts for k in part], dtype=int)
        return cls(at, np.concatenate([np.zeros(0), *values]))


class Prescription:
    """Prescribed accelerations of joints and frames of a model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    joints : JointAccelerations
        Those of joints.
    frames : mapping of str to (6,) array
        Classical ``LOCAL_WORLD_ALIGNED`` accelerations of frames; NaN where one is left free.

    Raises
    ------
    InputError
        If a frame does not exist, or values have the wrong shape or are not finite.
    """

    def __init__(self, kinematics: LoopKinematics, joints: JointAccelerations, frames: ByName) -> None:
        self._kinematics, self.joints, self.frames = kinematics, joints, frames
        self.v = joints.v
        """Indices in v of the prescribed joints."""
        self._frames = [kinematics.frame(name, "frames", InputError) for name in frames]
        wanted = [frame_values(name, value) for name, value in frames.items()]
        self._masks = [np.isfinite(value) for value in wanted]
        chosen = [value[mask] for value, mask in zip(wanted, self._masks, strict=True)]
        self.values = np.concatenate([joints.values, *chosen]) if chosen else joints.values
        """All prescribed accelerations, (size,)."""

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
