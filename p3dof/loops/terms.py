"""`Terms`: the terms of the tree's equation of motion, and how large they are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.threads import Workspace
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs


class Terms(Workspace):
    """Terms of the equation of motion of one model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model and its closures.
    actuated_v : (n_actuated,) array of int
        Indices of the actuated joints in v.
    """

    def __init__(self, kinematics: LoopKinematics, actuated_v: np.ndarray) -> None:
        self.kinematics = kinematics
        self.model = kinematics.model
        self.actuated_v = actuated_v
        self._data = self.model.createData()
        nv = self.model.nv
        self._upper = np.triu(np.ones((nv, nv), dtype=bool))
        self._halved = np.triu(np.ones((nv, nv))) - np.eye(nv) / 2

    def tree_force(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return M a + h (nv,), what the motion of the tree takes [N or N m].

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.

        Returns
        -------
        (nv,) array
        """
        return np.array(pin.rnea(self.model, self._data, q, v, a))

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return M (nv, nv), that of the tree, at a configuration (nq,)."""
        M = np.array(pin.crba(self.model, self._data, q))
        return np.where(self._upper, M, M.T)

    def half_mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return the upper triangle of M with half the diagonal: M is this and its transpose."""
        return np.asarray(pin.crba(self.model, self._data, q) * self._halved)

    def external(self, wrenches: list[tuple[pin.Frame, FloatArray]]) -> FloatArray:
        """Return the generalised force (nv,) of wrenches at frames, at the last configuration evaluated.

        Parameters
        ----------
        wrenches : list of (pin.Frame, (6,) array)
            Force [N] and moment [N m] in world axes at the frame's origin.

        Returns
        -------
        (nv,) array
        """
        k = self.kinematics
        force = np.zeros(self.model.nv)
        for frame, wrench in wrenches:
            ends = (frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED)
            force += pin.getFrameJacobian(k.model, k.data, *ends).T @ wrench
        return force

    def residual(
        self,
        point: ClosurePoint,
        v: FloatArray,
        a: FloatArray,
        external: FloatArray,
        tau: FloatArray,
        lambda_: FloatArray,
    ) -> float:
        """Return the largest error of the full equation of motion under given forces.

        Parameters
        ----------
        point : ClosurePoint
            The closures at the configuration.
        v, a : (nv,) array
            Velocity and acceleration.
        external : (nv,) array
            Generalised force of the external wrenches.
        tau : (n_actuated,) array
            Forces of the actuated joints.
        lambda_ : (rows,) array
            Multipliers of the closures.

        Returns
        -------
        float
            [N or N m]
        """
        left = self.tree_force(point.q, v, a) - external - point.J.T @ lambda_
        left[self.actuated_v] -= tau
        return max_abs(left)

    def scale(self, q: FloatArray, v: FloatArray, a: FloatArray, force: FloatArray) -> float:
        """Return the size of the forces that cancel in the equation of motion.

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.
        force : (nv,) array
            Generalised force of actuators and external wrenches.

        Returns
        -------
        float
            [N or N m]
        """
        h = np.array(pin.nle(self.model, self._data, q, v))
        inertial = pin.rnea(self.model, self._data, q, v, a) - h
        gravity = pin.computeGeneralizedGravity(self.model, self._data, q)
        return max(max_abs(h), max_abs(inertial), max_abs(force), max_abs(gravity))
