"""Energy and momentum of any robot at many samples, body by body; no forces are computed on the way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.batch.kinematics import Sweep
from p3dof.loops.batch.linear import apply
from p3dof.loops.rotations import cross


@dataclass(frozen=True, eq=False)
class BodyEnergies:
    """Energy and momentum of the bodies of a robot, at one state or at N of them.

    Parameters
    ----------
    names : tuple of str
        The n joints that carry the bodies, in Pinocchio's order. Links that are fixed to each other are one
        body.
    kinetic : ndarray, shape (n,) or (N, n)
        Of each body, and of the rotor of its joint (`model.armature`) [J].
    potential : ndarray, shape (n,) or (N, n)
        Of each body, zero where its mass centre is at the world's origin [J].
    momentum, angular_momentum : ndarray, shape (3,) or (N, 3)
        Of all bodies together, without rotors, the angular one about the world's origin [N s, N m s].
    springs : ndarray, shape () or (N,)
        Energy in the springs of the joints [J].
    """

    names: tuple[str, ...]
    kinetic: FloatArray
    potential: FloatArray
    momentum: FloatArray
    angular_momentum: FloatArray
    springs: FloatArray = field(default_factory=lambda: np.zeros(()))

    @property
    def total(self) -> FloatArray:
        """Kinetic and potential energy of all bodies and springs together, shape () or (N,) [J]."""
        return np.asarray(np.sum(self.kinetic + self.potential, axis=-1) + self.springs)


def body_energies(model: pin.Model, q: FloatArray, v: FloatArray) -> BodyEnergies:
    """Return energies and momenta of the bodies of a tree.

    Parameters
    ----------
    model : pin.Model
        The tree; masses, gravity and armature are read at every call.
    q : (N, nq) array
        Configurations.
    v : (N, nv) array
        Velocities.

    Returns
    -------
    BodyEnergies
    """
    bodies = range(1, model.njoints)
    m = np.array([model.inertias[i].mass for i in bodies])
    lever = np.array([model.inertias[i].lever for i in bodies]).reshape(-1, 3)
    inertia = np.array([model.inertias[i].inertia for i in bodies]).reshape(-1, 3, 3)
    sweep = Sweep(model)
    samples = sweep.at(q)
    twists = sweep.twists(samples.J, v)[:, 1:]
    R = samples.R[:, 1:]
    c, omega = samples.p[:, 1:] + apply(R, lever), twists[..., 3:]
    vc = twists[..., :3] + cross(omega, c)
    turning = np.einsum("...ji,...j->...i", R, omega)  # in the axes of the body
    spin = apply(inertia, turning)
    rotors = np.asarray(model.armature) * v**2
    each = [rotors[:, model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]].sum(axis=-1) for i in bodies]
    kinetic = m * np.sum(vc * vc, axis=-1) + np.sum(turning * spin, axis=-1)
    kinetic += np.array(each).reshape(len(m), len(q)).T
    return BodyEnergies(
        tuple(str(name) for name in model.names[1:]),
        kinetic / 2,
        -m * (c @ model.gravity.linear),
        np.sum(m[:, None] * vc, axis=1),
        np.sum(m[:, None] * cross(c, vc) + apply(R, spin), axis=1),
    )
