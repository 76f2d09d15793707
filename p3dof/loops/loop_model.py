"""`LoopModel`: a tree model, its loop closures and its actuators, one configuration at a time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError
from p3dof._base.threads import Own
from p3dof.loops.assembly_model import AssemblyModel
from p3dof.loops.dynamics import Dynamics
from p3dof.loops.energy import energy_rate
from p3dof.loops.passive import Passive
from p3dof.loops.results import ForwardDynamics, InverseDynamics
from p3dof.loops.sidecar import Sidecar

External = Mapping[str, ArrayLike]
"""Frame name → wrench (6,): force [N], moment [N m], in world axes at the frame's origin."""


class LoopModel(AssemblyModel):
    """Kinematics and dynamics of any robot with (or without) loop closures.

    Parameters
    ----------
    model : pin.Model
        A tree. Its frames and joints must stay as they are; masses and gravity may be changed.
    sidecar : Sidecar
        Loop closures, couplings, actuated joints, and perhaps the reference configuration.

    Raises
    ------
    ModelError
        If a frame or joint that the sidecar names does not exist, both frames of a closure are on the same
        body, an actuated or coupled joint has not exactly one degree of freedom, a continuous joint is
        coupled in a way that needs its turns counted, the reference does not fit the joints, or joints of the
        tree are not depth first.

    Notes
    -----
    Any number of threads may use an instance at once: each has workspaces of its own. Masses and gravity are
    for a time when no method runs. Arrays in results are read-only copies.

    A model much larger or smaller than a metre is computed in a unit of length of its own, see
    `p3dof.loops.units`: tolerances that are said here in metres are in that unit then, and so are ranks
    and the conditioning.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        super().__init__(model, sidecar)
        self._dynamics = Dynamics(self._kinematics, self.actuated_v)
        self._data = Own(model.createData)
        self.passive = Passive(model, sidecar.joint_data)
        """Springs, damping and friction in the joints; see `Sidecar.joint_data`."""

    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> InverseDynamics:
        """Return the actuator forces that produce a motion, with the forces in the closures.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v, a : (nv,) array
            Velocity and acceleration, which keep the loops closed.
        external : mapping of str to (6,) array, optional
            Wrenches that act on frames: force [N], moment [N m], in world axes at the frame's origin.
        joint_forces : (nv,) array, optional
            What acts in the joints besides the actuators, such as friction and springs [N or N m].

        Returns
        -------
        InverseDynamics

        Raises
        ------
        SingularityError
            If there are enough actuators but they cannot hold the mechanism at this configuration.
        DynamicsError
            If the motion needs a force that no actuator gives (fewer actuators than mobility).
        InputError
            If an argument has the wrong shape or is not finite, the loops are open by more than 1e-5, or the
            motion would open them.
        """
        v = frozen_array("v", v, (self.model.nv,))
        a = frozen_array("a", a, (self.model.nv,))
        joint_forces = self._acting(q, v, joint_forces)
        if self._scaled is not None:
            q = self._at(q).q
            self._external(external, joint_forces)
            return self._scaled.inverse_dynamics(q, v, a, external, joint_forces)
        point = self._moving(q, v, a)
        return self._dynamics.inverse.solve(point, v, a, self._external(external, joint_forces))

    def residual(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        tau: ArrayLike,
        lambda_: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> float:
        """Return how far given forces are from the equation of motion, such as measured ones.

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.
        tau : (n_actuated,) array
            Forces of the actuated joints [N or N m].
        lambda_ : (rows,) array
            Multipliers of the closures, as in the result of `inverse_dynamics`.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        float
            The largest error of the equation of motion of all joints [N or N m].

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        point = self._at(q)
        v = frozen_array("v", v, (self.model.nv,))
        a = frozen_array("a", a, (self.model.nv,))
        tau = frozen_array("tau", tau, (len(self.actuated),))
        lambda_ = frozen_array("lambda_", lambda_, (self._kinematics.size,))
        joint_forces = self._acting(q, v, joint_forces)
        return self._dynamics.residual(point, v, a, self._external(external, joint_forces), tau, lambda_)

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stabilisation: float = 0.0,
    ) -> ForwardDynamics:
        """Return the acceleration that actuator forces produce; redundant closures do no harm.

        With stabilisation, integrated loops do not drift open. Without, project configurations that have
        drifted back with ``assemble(None, guess=q)``.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v : (nv,) array
            Velocity.
        tau : (n_actuated,) array
            Forces of the actuated joints [N or N m].
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.
        stabilisation : float
            β of Baumgarte's stabilisation [1/s]: gaps e of the loops follow ë + 2β ė + β² e = 0.

        Returns
        -------
        ForwardDynamics

        Raises
        ------
        DynamicsError
            If no acceleration satisfies closures and equation of motion to the accuracy of the method.
        InputError
            If an argument has the wrong shape or is not finite, the loops are open by more than 1e-3, or the
            velocity opens them by more than 1e-2 of itself.
        """
        v = frozen_array("v", v, (self.model.nv,))
        beta = float(frozen_array("stabilisation", stabilisation, ()))
        if beta < 0:
            raise InputError(f"stabilisation: expected zero or more, got {beta:g}")
        tau = frozen_array("tau", tau, (len(self.actuated),))
        point = self._closed_at(q, v)
        joint_forces = self._acting(q, v, joint_forces)
        force = self._external(external, joint_forces)
        if self._scaled is not None:
            return self._scaled.forward_dynamics(point.q, v, tau, external, joint_forces, beta)
        force[self.actuated_v] += tau
        return self._dynamics.forward.solve(point, v, force, beta)

    def power(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> float:
        """Return the rate of change of the mechanical energy, summed body by body.

        It equals the power of actuators and external wrenches, less the `dissipation`, if the dynamics is
        right, and shares nothing with it: every body contributes m vc·(ac - g) + ω·(I α + ω × I ω), every
        spring its power.

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.

        Returns
        -------
        float
            [W]

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        q = self._configuration("q", q)
        v = frozen_array("v", v, (self.model.nv,))
        a = frozen_array("a", a, (self.model.nv,))
        return energy_rate(self.model, self._data.here, q, v, a) + float(self.passive.power(q, v))

    def dissipation(self, v: ArrayLike) -> FloatArray:
        """Return the power that damping and friction in the joints take, see `Sidecar.joint_data`.

        Parameters
        ----------
        v : (nv,) or (N, nv) array
            Velocities.

        Returns
        -------
        array, shape () or (N,)
            [W]

        Raises
        ------
        InputError
            If `v` has the wrong shape or is not finite.
        """
        shape = (self.model.nv,) if np.ndim(v) == 1 else ("N", self.model.nv)
        return self.passive.dissipation(frozen_array("v", v, shape))

    def _acting(self, q: ArrayLike, v: FloatArray, joint_forces: ArrayLike | None) -> ArrayLike | None:
        """Return what acts in the joints besides the actuators: what is given, springs, damping, friction."""
        if not self.passive:
            return joint_forces
        own = self.passive.forces(self._configuration("q", q), v)
        return own if joint_forces is None else own + frozen_array("joint_forces", joint_forces, own.shape)

    def _external(self, external: External | None, joint_forces: ArrayLike | None) -> FloatArray:
        """Return the generalised force (nv,) of everything that is not an actuator."""
        if external is not None and not isinstance(external, Mapping):
            raise InputError(
                f"external: expected a mapping of frame names to wrenches, got {type(external).__name__}"
            )
        wrenches = []
        for name, wrench in external.items() if external else ():
            frame = self._kinematics.frame(name, "external", InputError)
            wrenches.append((frame, frozen_array(f"external {name}", wrench, (6,))))
        force = self._dynamics.external(wrenches)
        if joint_forces is not None:
            force += frozen_array("joint_forces", joint_forces, (self.model.nv,))
        return force
