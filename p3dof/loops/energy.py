"""Rate of change of the mechanical energy, body by body: an independent check on the dynamics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray


def energy_rate(model: pin.Model, data: pin.Data, q: FloatArray, v: FloatArray, a: FloatArray) -> float:
    """Return the rate of change of kinetic plus potential energy [W].

    Each body contributes m vc·(ac - g) + ω·(I α + ω × I ω), from the motion of its own mass centre; rotors
    (`model.armature`) contribute their own inertia. No forces are computed on the way.

    Parameters
    ----------
    model : pin.Model
        The tree; masses, gravity and armature are read at every call.
    data : pin.Data
        Workspace.
    q : (nq,) array
        Configuration.
    v, a : (nv,) array
        Velocity and acceleration.

    Returns
    -------
    float
    """
    pin.forwardKinematics(model, data, q, v, a)
    bodies = range(1, model.njoints)
    m = np.array([model.inertias[i].mass for i in bodies])
    c = np.array([model.inertias[i].lever for i in bodies]).reshape(-1, 3)
    inertia = np.array([model.inertias[i].inertia for i in bodies]).reshape(-1, 3, 3)
    V = np.array([data.v[i].vector for i in bodies]).reshape(-1, 6)
    A = np.array([data.a[i].vector for i in bodies]).reshape(-1, 6)
    R = np.array([data.oMi[i].rotation for i in bodies]).reshape(-1, 3, 3)
    u, omega, alpha = V[:, :3], V[:, 3:], A[:, 3:]  # (n, 3) each, in the axes of the body
    g = np.einsum("nji,j->ni", R, model.gravity.linear)
    vc = u + np.cross(omega, c)
    # Spatial acceleration + ω × u is the acceleration of the joint's origin.
    ac = A[:, :3] + np.cross(omega, u) + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c))
    momentum = np.einsum("nij,nj->ni", inertia, omega)
    torque = np.einsum("nij,nj->ni", inertia, alpha) + np.cross(omega, momentum)
    rate = np.sum(m[:, None] * vc * (ac - g)) + np.sum(omega * torque)
    return float(rate + np.sum(np.asarray(model.armature) * v * a))
