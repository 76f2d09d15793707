"""What acts in the joints of the Pinocchio route by itself: friction, and the balances of the sliders.

The reflected inertia of motors and screws is none of it: it is in the model, as Pinocchio's armature.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel
from p3dof.machine.parameters import SLIDES, Actuators, Parameters
from p3dof.methods.pinocchio_friction import FrictionForces, Resistance


def armature_of(model: pin.Model, actuators: Actuators) -> FloatArray:
    """Return the armature of a tree: what is reflected to the sliders, zero elsewhere.

    Parameters
    ----------
    model : pinocchio.Model
        The tree.
    actuators : Actuators
        Motors, screws and balances.

    Returns
    -------
    ndarray, shape (nv,)
        [kg]
    """
    found = np.zeros(model.nv)
    found[[model.idx_vs[model.getJointId(slide)] for slide in SLIDES]] = actuators.inertia
    return found


class JointForces:
    """Friction and balances of a machine in its closed-loop model.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    parameters : Parameters
        The machine.
    """

    def __init__(self, loop: ClosedLoopModel, parameters: Parameters) -> None:
        self._friction = FrictionForces(loop, parameters.friction)
        model, actuators = loop.model, parameters.actuators
        joints = [model.getJointId(name) for name in SLIDES]
        self._q = np.array([model.idx_qs[joint] for joint in joints], dtype=int)
        self._v = np.array([model.idx_vs[joint] for joint in joints], dtype=int)
        self._home, self._stiffness = actuators.balance_at_home(parameters.gravity), actuators.stiffness
        self._balanced = bool(self._home.any() or self._stiffness.any())

    def at(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what acts at one state.

        Parameters
        ----------
        q, v : (nv,) array
            Configuration and velocity of the tree.

        Returns
        -------
        Resistance
            Its power is that of friction alone.
        """
        return self._with_balance(self._friction.at(q, v), q)

    def over(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what acts at N states.

        Parameters
        ----------
        q, v : (N, nv) array
            Configurations and velocities of the tree.

        Returns
        -------
        Resistance
        """
        return self._with_balance(self._friction.over(q, v), q)

    def stored_power(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return how fast the potential energy of the balances grows.

        Parameters
        ----------
        q, v : (..., nv) array
            Configurations and velocities of the tree.

        Returns
        -------
        ndarray, shape (...)
            [W]
        """
        return np.asarray(-(self._balance(q) * v[..., self._v]).sum(axis=-1))

    def _balance(self, q: FloatArray) -> FloatArray:
        return np.asarray(self._home - self._stiffness * q[..., self._q])

    def _with_balance(self, lost: Resistance, q: FloatArray) -> Resistance:
        if not self._balanced:
            return lost
        forces = np.array(np.broadcast_to(lost.joint_forces, q.shape))
        forces[..., self._v] += self._balance(q)
        return replace(lost, joint_forces=forces)
