"""What the forces of any robot owe to each inertial parameter of its bodies and each datum of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.threads import Own
from p3dof.loops.independent import coordinate_names
from p3dof.loops.joint_data import JointData
from p3dof.loops.passive import SMOOTHING
from p3dof.loops.turning_springs import TurningSpring

MOMENTS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Inertial parameters of a body, about the origin of its joint and in its axes, in Pinocchio's order."""
JOINT = ("armature", "damping", "friction", "stiffness", "preload")
"""Parameters of a joint's freedom; stiffness and preload only of joints that have one, and the
stiffness of balls and free joints with a spring."""


@dataclass(frozen=True, eq=False)
class LoopRegressor:
    """How forces depend on the parameters, at one motion or (leading axis N) at many; exact.

    Parameters
    ----------
    parameter_names : tuple of str
        Of the P parameters: ``body.name`` with a link's name and the names in `MOMENTS`, masses [kg], first
        moments [kg m] and inertias [kg m²] about the origin of the joint that carries the body; then
        ``joint.armature``, ``joint.damping``, ``joint.friction``, ``joint.stiffness`` (about `rest` of
        `JointData`) and ``joint.preload``, a constant force that resists: less its `force`.
    parameters : (P,) array
        Their values.
    forces : (..., m, P) array
        Of the actuators: tau = forces @ parameters + external; the smallest, where they are not unique.
    external : (..., m) array
        What external wrenches and joint forces add.
    coordinates : tuple of str
        Names of independent coordinates.
    generalised : (..., n, P) array
        Along these coordinates: generalised @ parameters = actuation @ tau + generalised_external. With idle
        freedoms it says more than `forces`.
    generalised_external : (..., n) array
        Of external wrenches and joint forces, along the coordinates.
    actuation : (..., n, m) array
        As in `MinimalDynamics`.
    """

    parameter_names: tuple[str, ...]
    parameters: FloatArray
    forces: FloatArray
    external: FloatArray
    coordinates: tuple[str, ...]
    generalised: FloatArray
    generalised_external: FloatArray
    actuation: FloatArray

    @property
    def inertial(self) -> FloatArray:
        """The columns of `forces` of the inertial parameters of the bodies, (..., m, 10 per body)."""
        bodies = sum(name.rsplit(".", 1)[1] in MOMENTS for name in self.parameter_names)
        return self.forces[..., :bodies]


class TreeRegressor:
    """The regressor of a tree: inertial parameters of its bodies, and data of its joints.

    Parameters
    ----------
    model : pin.Model
        The tree.
    joint_data : sequence of JointData
        What acts in its joints.
    """

    def __init__(self, model: pin.Model, joint_data: Sequence[JointData]) -> None:
        self._model, self._data = model, Own(model.createData)
        given = {entry.joint: entry for entry in joint_data}
        each = [
            given.get(str(model.names[i]), JointData(str(model.names[i]))) for i in range(1, model.njoints)
        ]
        sizes = [model.nvs[i] for i in range(1, model.njoints)]
        self._friction = np.repeat([(one.damping, one.friction) for one in each], sizes, axis=0)
        single = [i for i in range(1, model.njoints) if model.nvs[i] == 1]
        self._single_v = np.array([model.idx_vs[i] for i in single], dtype=int)
        self._single_q = np.array([model.idx_qs[i] for i in single], dtype=int)
        self._circles = np.array([model.nqs[i] == 2 for i in single], dtype=bool)
        self._stiffness = np.array([each[i - 1].stiffness for i in single])
        self._rest = np.array([each[i - 1].rest for i in single])
        self._preload = np.array([-each[i - 1].force for i in single])
        several = [i for i in range(1, model.njoints) if model.nvs[i] > 1 and each[i - 1].stiffness]
        self._turning = [TurningSpring.of(model, i, each[i - 1]) for i in several]
        freedoms = coordinate_names(model)
        bodies = [f"{body}.{moment}" for body in body_names(model) for moment in MOMENTS]
        joints = [f"{freedom}.{what}" for what in JOINT[:3] for freedom in freedoms]
        joints += [f"{model.names[i]}.{what}" for what in JOINT[3:] for i in single]
        joints += [f"{model.names[i]}.stiffness" for i in several]
        self.inertial = len(bodies)
        """How many inertial parameters there are; they come first."""
        self.names = (*bodies, *joints)
        """Of all parameters."""

    def parameters(self) -> FloatArray:
        """Return the values of all parameters, as the tree has them now."""
        bodies = [self._model.inertias[i].toDynamicParameters() for i in range(1, self._model.njoints)]
        joints = np.asarray(self._model.armature), *self._friction.T, self._stiffness
        turning = [spring.stiffness for spring in self._turning]
        return np.concatenate([np.zeros(0), *bodies, *joints, self._preload, turning])

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the matrix (nv, P) from the parameters to the generalised forces that the motion takes."""
        nv, count = len(v), len(self._rest)
        bodies = np.array(pin.computeJointTorqueRegressor(self._model, self._data.here, q, v, a))
        values = q[self._single_q] - self._rest
        if self._circles.any():
            at = self._single_q[self._circles]
            angle = np.arctan2(q[at + 1], q[at]) - self._rest[self._circles]
            values[self._circles] = np.arctan2(np.sin(angle), np.cos(angle))
        springs = np.zeros((nv, 2 * count))
        springs[self._single_v, np.arange(count)] = values
        springs[self._single_v, count + np.arange(count)] = 1.0
        turning = np.zeros((nv, len(self._turning)))
        for k, spring in enumerate(self._turning):
            turning[spring.v, k] = spring.stretch(q)
        joints = (np.diag(x) for x in (a, v, np.tanh(v / SMOOTHING)))
        return np.concatenate((bodies, *joints, springs, turning), axis=1)


def body_names(model: pin.Model) -> list[str]:
    """Return a name for what each joint carries: that of its first link, else of the joint."""
    links: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            links.setdefault(int(frame.parentJoint), str(frame.name))
    names = [links.get(i, str(model.names[i])) for i in range(1, model.njoints)]
    return names if len(set(names)) == len(names) else [str(name) for name in model.names[1:]]
