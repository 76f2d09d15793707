"""`ClosedTree`, a robot in one unit of length: a tree, closures and couplings, drives, data of joints.

It checks what it is asked, and asks those that stand in it side by side: `LoopKinematics`, `Assembler`,
`Dynamics`, `Passive`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, checked_array, frozen_array, not_negative, positive, shown, whole
from p3dof._base.errors import InputError, ModelError
from p3dof._base.threads import Own
from p3dof.loops.assembly import (
    TOLERANCE,
    Assembler,
    Assembly,
    State,
    Target,
    TargetLike,
    assemble_within_limits,
    assembly_modes,
    bound,
)
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.coordinates import NORMALISED, Norms, Passive, configuration_of, single_joint
from p3dof.loops.forward import Forward
from p3dof.loops.hybrid import ByName, Hybrid, Prescription
from p3dof.loops.inverse import Inverse
from p3dof.loops.partitions import Terms
from p3dof.loops.results import ForwardDynamics, HybridDynamics, InverseDynamics
from p3dof.loops.sidecar import Sidecar


def energy_rate(model: pin.Model, data: pin.Data, q: FloatArray, v: FloatArray, a: FloatArray) -> float:
    """Return the rate of change of kinetic plus potential energy [W].

    Each body contributes m vc·(ac - g) + ω·(I α + ω × I ω), from the motion of its own mass centre; rotors
    (`model.armature`) contribute their own inertia. No forces are computed on the way.
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


External: TypeAlias = Mapping[str, ArrayLike]
"""Frame name → wrench (6,): force [N], moment [N m], in world axes at the frame's origin."""
Loads: TypeAlias = tuple[External | None, ArrayLike | None]
"""External wrenches, and what acts in the joints besides the actuators (nv,)."""
Asked: TypeAlias = tuple[ArrayLike | ByName | None, ByName | None]
"""Prescribed accelerations of joints, and of frames."""
CLOSED = 1e-5  # largest gap at which inverse dynamics has a meaning [m or rad]
NEARLY_CLOSED = 1e-3
"""Largest gap at which forward dynamics has: an integrator's intermediate stages are a little open."""
CONSISTENT = 1e-6  # largest relative error of rates at the closures, for inverse dynamics
NEARLY_CONSISTENT = 1e-2  # largest relative error of velocities at the closures, for forward dynamics


class Dynamics(Terms):
    """Inverse, forward and hybrid dynamics, which remember what was of use at the thread's last sample."""

    @cached_property
    def inverse(self) -> Inverse:
        """Forces of a motion."""
        return Inverse(self)

    @cached_property
    def forward(self) -> Forward:
        """Motion under forces."""
        return Forward(self)

    @cached_property
    def hybrid(self) -> Hybrid:
        """Forces of some prescribed accelerations, and the rest of the motion."""
        return Hybrid(self)


class ClosedTree:
    """A robot in one unit of length; all methods as the ones of `ClosedLoopModel` of the same names."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        if not isinstance(model, pin.Model):
            raise ModelError(f"model: expected a pinocchio.Model, got {type(model).__name__}")
        if not isinstance(sidecar, Sidecar):
            raise ModelError(f"sidecar: expected a Sidecar, got {type(sidecar).__name__}")
        _check_tree(model)
        self.model, self.sidecar, self.actuated = model, sidecar, sidecar.actuated
        self.kinematics = LoopKinematics(model, sidecar)
        self.reference = configuration_of(model, sidecar.reference)
        self.reference.setflags(write=False)
        self.joints = [single_joint(model, name, "actuated") for name in sidecar.actuated]
        """Ids of the actuated joints."""
        self.actuated_v = np.array([model.idx_vs[j] for j in self.joints], dtype=int)
        self.actuated_v.setflags(write=False)
        self.assembler = Assembler(self.kinematics, self.reference)
        self.passive = Passive(model, sidecar.joint_data, sidecar.bushings)
        self._data = Own(model.createData)
        self._normalised = Norms(model)

    @cached_property
    def dynamics(self) -> Dynamics:
        """What computes one sample."""
        return Dynamics(self.kinematics, self.actuated_v)

    @property
    def generic_rank(self) -> int | None:
        """`ClosedLoopModel.generic_rank`."""
        return self.assembler.generic_rank

    @cached_property
    def regular(self) -> FloatArray | None:
        """`ClosedLoopModel.regular_configuration`."""
        return self.assembler.regular(self.actuated_v)

    def configuration(self, name: str, q: ArrayLike) -> FloatArray:
        """Return a configuration (nq,) after checking shape and norms."""
        array = frozen_array(name, q, (self.model.nq,))
        if self.model.nq != self.model.nv and not pin.isNormalized(self.model, array, NORMALISED):
            raise InputError(
                f"{name}: not normalised (unit quaternions and circles); see pinocchio.normalize"
            )
        return array

    def state(self, q: ArrayLike, v: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        """Return a configuration and a velocity, zero by default, after checking both."""
        v = np.zeros(self.model.nv) if v is None else frozen_array("v", v, (self.model.nv,))
        return self.configuration("q", q), v

    def states(self, q: ArrayLike, *rates: ArrayLike, kept: bool = True) -> list[FloatArray]:
        """Return checked configurations (N, nq) and rates (N, nv); copies, unless rates are not kept."""
        q, of_rates = frozen_array("q", q, ("N", self.model.nq)), frozen_array if kept else checked_array
        if self.model.nq != self.model.nv and not self._normalised(q):
            raise InputError("q: not normalised (unit quaternions and circles); see pinocchio.normalize")
        shape = len(q), self.model.nv
        return [q, *(of_rates(name, rate, shape) for name, rate in zip("va", rates, strict=False))]

    def at(self, q: ArrayLike, largest_gap: float = np.inf) -> ClosurePoint:
        """Return the closures at a configuration; an error where they are open by more than that."""
        point = self.kinematics.at(self.configuration("q", q))
        if not point.tight and not point.gap <= largest_gap:
            self._refuse_gap(point, largest_gap)
        return point

    def _refuse_gap(self, point: ClosurePoint, largest_gap: float) -> None:
        raise InputError(
            f"q: the {self.kinematics.worst(point.error)} is open by {point.gap:.3g} m or rad, "
            f"expected at most {largest_gap:g}; assemble(None, guess=q) closes it"
        )

    def check_opening(self, name: str, opening: FloatArray, allowed: float) -> None:
        """Refuse a velocity or an acceleration that opens closures by more than allowed."""
        worst = max_abs(opening)
        if worst > allowed:
            raise InputError(
                f"{name}: opens the {self.kinematics.worst(opening)} by {worst:.3g} (SI units), "
                f"expected at most {allowed:.1g}; complete() finds motions that keep the loops closed"
            )

    def _nearly_closed(self, q: ArrayLike, v: FloatArray) -> ClosurePoint:
        """Return the closures at a state that nearly keeps them closed."""
        point = self.at(q, NEARLY_CLOSED)
        if point.J.size:
            opening = point.J @ v
            if not opening.dot(opening) <= NEARLY_CONSISTENT**2:  # else the largest is less, too
                self.check_opening("v", opening, NEARLY_CONSISTENT * max(1.0, max_abs(v)))
        return point

    def moving(self, q: ArrayLike, v: FloatArray, a: FloatArray) -> ClosurePoint:
        """Return the closures at a motion that keeps them closed."""
        k, q = self.kinematics, self.configuration("q", q)
        k.move(q, v, a)
        point = k.at(q)
        if point.J.size:
            relative = CONSISTENT
            if not point.tight:
                if not point.gap <= CLOSED:
                    self._refuse_gap(point, CLOSED)
                relative += 100.0 * point.gap
            opening = point.J @ v
            if not opening.dot(opening) <= relative**2:  # else the largest is less, too
                self.check_opening("v", opening, relative * max(1.0, max_abs(v)))
            opening = k.acceleration()
            if not opening.dot(opening) <= relative**2:
                allowed = relative * max(1.0, max_abs(a), max_abs(v) ** 2)
                self.check_opening("a", opening, allowed)
        return point

    def closure_error(self, q: ArrayLike) -> FloatArray:
        """`ClosedLoopModel.closure_error`."""
        return self.at(q).error.copy()

    def rank(self, q: ArrayLike) -> int:
        """`ClosedLoopModel.rank`."""
        return self.at(q).svd.rank

    def assemble(
        self,
        target: TargetLike = None,
        guess: ArrayLike | None = None,
        tolerance: float = TOLERANCE,
        within_limits: bool = False,
    ) -> Assembly:
        """`ClosedLoopModel.assemble`."""
        start = None if guess is None else self.configuration("guess", guess)
        goal, tolerance = self.bound(target), positive("tolerance", tolerance, InputError)
        if within_limits:
            return assemble_within_limits(self.assembler, goal, start, tolerance)
        return self.assembler.assemble(goal, start, tolerance)

    def assembly_modes(
        self, target: TargetLike, starts: int = 64, seed: int = 0, within_limits: bool = False
    ) -> tuple[Assembly, ...]:
        """`ClosedLoopModel.assembly_modes`."""
        goal, starts, seed = self.bound(target), whole("starts", starts, 1), whole("seed", seed, 0)
        return assembly_modes(self.assembler, goal, starts, seed, within_limits)

    def complete(
        self, target: TargetLike, velocity: ArrayLike, acceleration: ArrayLike, guess: ArrayLike | None = None
    ) -> State:
        """`ClosedLoopModel.complete`."""
        goal = self.bound(target)
        v = frozen_array("velocity", velocity, (goal.size,))
        a = frozen_array("acceleration", acceleration, (goal.size,))
        start = None if guess is None else self.configuration("guess", guess)
        return self.assembler.complete(goal, self.assembler.assemble(goal, start, TOLERANCE), v, a)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, loads: Loads) -> InverseDynamics:
        """`ClosedLoopModel.inverse_dynamics`."""
        v = frozen_array("v", v, (self.model.nv,))
        a = frozen_array("a", a, (self.model.nv,))
        if self.passive:
            loads = loads[0], self.acting(q, v, loads[1])
        point = self.moving(q, v, a)
        return self.dynamics.inverse.solve(point, v, a, self.force(loads))

    def residual(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, tau: ArrayLike, lambda_: ArrayLike, loads: Loads
    ) -> float:
        """`ClosedLoopModel.residual`."""
        point = self.at(q)
        v = frozen_array("v", v, (self.model.nv,))
        a = frozen_array("a", a, (self.model.nv,))
        tau = frozen_array("tau", tau, (len(self.actuated),))
        lambda_ = frozen_array("lambda_", lambda_, (self.kinematics.size,))
        if self.passive:
            loads = loads[0], self.acting(q, v, loads[1])
        return self.dynamics.residual(point, v, a, self.force(loads), tau, lambda_)

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, loads: Loads, stabilisation: float
    ) -> ForwardDynamics:
        """`ClosedLoopModel.forward_dynamics`."""
        v = frozen_array("v", v, (self.model.nv,))
        beta = not_negative("stabilisation", stabilisation)
        tau = frozen_array("tau", tau, (len(self.actuated),))
        point = self._nearly_closed(q, v)
        if self.passive:
            loads = loads[0], self.acting(q, v, loads[1])
        force = self.force(loads)
        force[self.actuated_v] += tau
        return self.dynamics.forward.solve(point, v, force, beta)

    def hybrid_dynamics(
        self, q: ArrayLike, v: ArrayLike, asked: Asked, loads: Loads, stabilisation: float
    ) -> HybridDynamics:
        """`ClosedLoopModel.hybrid_dynamics`."""
        given = Prescription.of(self.kinematics, self.actuated_v, *asked)
        return self.prescribed_dynamics(q, v, given, loads, not_negative("stabilisation", stabilisation))

    def prescribed_dynamics(
        self, q: ArrayLike, v: ArrayLike, given: Prescription, loads: Loads, stabilisation: float
    ) -> HybridDynamics:
        """`ClosedLoopModel.hybrid_dynamics` of accelerations that were checked."""
        v = frozen_array("v", v, (self.model.nv,))
        point = self._nearly_closed(q, v)
        if self.passive:
            loads = loads[0], self.acting(q, v, loads[1])
        return self.dynamics.hybrid.solve(point, v, given, self.force(loads), stabilisation)

    def power(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> float:
        """`ClosedLoopModel.power`."""
        q, v = self.state(q, v)
        a = frozen_array("a", a, (self.model.nv,))
        return energy_rate(self.model, self._data.here, q, v, a) + float(self.passive.power(q, v))

    def acting(self, q: ArrayLike, v: FloatArray, joint_forces: ArrayLike | None) -> FloatArray:
        """Return springs, damping, friction and bushings, and what else acts in the joints (nv,)."""
        own = self.passive.forces(self.configuration("q", q), v)
        return own if joint_forces is None else own + frozen_array("joint_forces", joint_forces, own.shape)

    def force(self, loads: Loads) -> FloatArray:
        """Return the generalised force (nv,) of all that is given, where the closures were evaluated last."""
        k, force = self.kinematics, np.zeros(self.model.nv)
        external, joint_forces = loads
        if external is not None:
            for frame, wrench in self.wrenches(external).values():
                ends = frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED
                force += pin.getFrameJacobian(k.model, k.data, *ends).T @ wrench
        if joint_forces is not None:
            force += frozen_array("joint_forces", joint_forces, force.shape)
        return force

    def wrenches(self, external: External) -> dict[str, tuple[pin.Frame, FloatArray]]:
        """Return frames and wrenches (6,) by name after checking them."""
        if not isinstance(external, Mapping):
            raise InputError(
                f"external: expected a mapping of frame names to wrenches, got {type(external).__name__}"
            )
        return {
            name: (
                self.kinematics.frame(name, "external", InputError),
                frozen_array(f"external {name}", wrench, (6,)),
            )
            for name, wrench in external.items()
        }

    def bound(self, target: TargetLike) -> Target:
        """Return a target of this robot after checking it."""
        return bound(target, self.kinematics, self.joints)


def _check_tree(model: pin.Model) -> None:
    """Raise ModelError for a tree that Pinocchio's algorithms would compute wrongly, or refuse later.

    Joints that were not added depth first give a wrong mass matrix without a word; joints that mimic others
    are not taken by most algorithms.
    """
    mimicking = [str(model.names[i]) for i in model.mimicking_joints]
    if mimicking:
        raise ModelError(
            f"model: the joint {shown(mimicking[0])} mimics another one: build the model without, and couple "
            "them with a Coupling"
        )
    path = [0]
    for i in range(1, model.njoints):
        parent = int(model.parents[i])
        while path and path[-1] != parent:
            path.pop()
        if not path:
            raise ModelError(
                f"model: the joint {shown(str(model.names[i]))} is not depth first: add it right behind "
                f"{shown(str(model.names[parent]))} and what hangs on it, else Pinocchio's crba is wrong"
            )
        path.append(i)
