"""What a way to the forces finds over samples: forces, joints, evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray


@dataclass(frozen=True, eq=False)
class JointStates:
    """Every joint of the mechanism over a motion, in the order of the URDF's joints in Pinocchio.

    Parameters
    ----------
    names : tuple of str
        Joint names.
    q, v, a : ndarray, shape (N, 10)
        Positions [m or rad], velocities and accelerations.
    """

    names: tuple[str, ...]
    q: FloatArray
    v: FloatArray
    a: FloatArray

    @classmethod
    def from_mappings(
        cls,
        names: tuple[str, ...],
        q: Mapping[str, FloatArray],
        v: Mapping[str, FloatArray],
        a: Mapping[str, FloatArray],
    ) -> JointStates:
        """Stack values by joint name.

        Parameters
        ----------
        names : tuple of str
            The order of the columns.
        q, v, a : mapping of str to ndarray, shape (N,)
            Values of every joint.

        Returns
        -------
        JointStates
        """
        return cls(names, *(np.stack([values[name] for name in names], axis=-1) for values in (q, v, a)))

    def columns(self, names: tuple[str, ...]) -> JointStates:
        """Return the states of some joints only, in the given order."""
        index = [self.names.index(name) for name in names]
        return JointStates(names, self.q[..., index], self.v[..., index], self.a[..., index])


@dataclass(frozen=True, eq=False)
class Solution:
    """What a method finds over samples, rows of NaN where a sample was invalid.

    Parameters
    ----------
    forces : ndarray, shape (N, 3)
        Actuator forces [N].
    joints : JointStates
        All joints.
    closure_error : ndarray, shape (N,)
        Largest gap of the loops [m].
    energy_rate : ndarray, shape (N,)
        Rate of change of kinetic and potential energy, summed body by body [W].
    dissipation : ndarray, shape (N,)
        Power lost in friction [W].
    actuation : ndarray, shape (N,)
        Angle from the actuation singularity [rad].
    """

    forces: FloatArray
    joints: JointStates
    closure_error: FloatArray
    energy_rate: FloatArray
    dissipation: FloatArray
    actuation: FloatArray
