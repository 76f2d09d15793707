"""`DerivativesModel`: exact derivatives of the dynamics of any robot, on its constraint manifold."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof.loops.derivatives import (
    ByForces,
    ByMotion,
    ByPrescription,
    ForwardDynamicsDerivatives,
    HybridDynamicsDerivatives,
    InverseDynamicsDerivatives,
    parts,
    where_unique,
)
from p3dof.loops.independent import Independent, IndexArray
from p3dof.loops.linearised import Acting, Linearised, Motion
from p3dof.loops.loop_model import External
from p3dof.loops.minimal_model import MinimalModel, Names
from p3dof.loops.prescriptions import ByName, joint_freedoms
from p3dof.loops.results import determined


class DerivativesModel(MinimalModel):
    """Exact derivatives of inverse, hybrid and forward dynamics of any robot."""

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        coordinates: Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> InverseDynamicsDerivatives:
        """Return the exact derivatives of `inverse_dynamics` on the constraint manifold.

        By independent coordinates, their speeds and their accelerations. Wrenches stay in world axes and
        follow their frame's origin, joint forces stay. Springs, damping and friction of `joint_data` change:
        friction is smooth, and away from rest it does not.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v, a : (nv,) array
            Velocity and acceleration, which keep the loops closed.
        coordinates : iterable of str, optional
            As in `coordinates`.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        InverseDynamicsDerivatives

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion, or the actuators cannot hold the mechanism.
        DynamicsError
            If there are fewer actuators than free motions.
        InputError
            As `inverse_dynamics`; if a name does not exist.
        """
        found = self.inverse_dynamics(q, v, a, external, joint_forces)
        q, v = self._state(q, v)
        setting = self._setting
        with setting.open():
            at = self._independent(q, coordinates, v)
            motion = v, np.asarray(a, dtype=float), found.tau, found.lambda_
            linear = self._linearised(at, motion, external)
            by_a, by_tau = linear.inverse()
            by_lambda = where_unique(linear.multipliers(by_a, by_tau), found.unique)
        units, n = setting.v[at.v], len(at.v)
        columns = np.tile(units, 3)
        return InverseDynamicsDerivatives(
            *self._moved(at, linear),
            dynamics=found,
            tau=ByMotion(*parts(setting.force[self.actuated_v, None] * by_tau / columns, n)),
            a=ByMotion(*parts(setting.v[:, None] * by_a / columns, n)),
            lambda_=ByMotion(*parts(setting.rows[:, None] * by_lambda / columns, n)),
        )

    def hybrid_dynamics_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        coordinates: Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> HybridDynamicsDerivatives:
        """Return the exact derivatives of `hybrid_dynamics` on the constraint manifold.

        By independent coordinates, their speeds, and the prescribed accelerations: joints in their order,
        then the components of frames that are not NaN.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v : (nv,) array
            Velocity, which keeps the loops closed.
        prescribed, frames
            As in `hybrid_dynamics`.
        coordinates : iterable of str, optional
            As in `coordinates`.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        HybridDynamicsDerivatives

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion; as `hybrid_dynamics`.
        DynamicsError
            As `hybrid_dynamics`.
        InputError
            As `hybrid_dynamics`; if the loops are open by more than 1e-5 or the velocity would open them.
        """
        found = self.hybrid_dynamics(q, v, prescribed, frames, external, joint_forces)
        q, v = self._state(q, v)
        setting = self._setting
        joints = self._prescribed(prescribed, ())
        index = np.array([k for name in joints for k in joint_freedoms(self.model, name)], dtype=int)
        with setting.open():
            at = self._independent(q, coordinates, v)
            linear = self._linearised(at, (v, found.a, found.tau, found.lambda_), external)
            S, drift, twists = self._prescription(linear, index, frames or {})
            by_a, by_tau = linear.hybrid(S, drift)
            by_lambda = where_unique(linear.multipliers(by_a, by_tau), found.unique)
        units, n = setting.v[at.v], len(at.v)
        columns = np.concatenate((units, units, setting.v[index], twists))
        return HybridDynamicsDerivatives(
            *self._moved(at, linear),
            dynamics=found,
            tau=ByPrescription(*parts(setting.force[self.actuated_v, None] * by_tau / columns, n)),
            a=ByPrescription(*parts(setting.v[:, None] * by_a / columns, n)),
            lambda_=ByPrescription(*parts(setting.rows[:, None] * by_lambda / columns, n)),
        )

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        coordinates: Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> ForwardDynamicsDerivatives:
        """Return the exact derivatives of `forward_dynamics` on the constraint manifold.

        By independent coordinates, their speeds, and the forces of the actuators.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v : (nv,) array
            Velocity, which keeps the loops closed.
        tau : (n_actuated,) array
            Forces of the actuated joints [N or N m].
        coordinates : iterable of str, optional
            As in `coordinates`.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        ForwardDynamicsDerivatives

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        DynamicsError
            As `forward_dynamics`.
        InputError
            As `forward_dynamics`; if the loops are open by more than 1e-5 or the velocity would open them.
        """
        found = self.forward_dynamics(q, v, tau, external, joint_forces)
        q, v = self._state(q, v)
        setting = self._setting
        with setting.open():
            at = self._independent(q, coordinates, v)
            motion = v, found.a, np.asarray(tau, dtype=float), found.lambda_
            linear = self._linearised(at, motion, external)
            by_a, by_y = linear.forward()
            m, n = len(self.actuated_v), len(at.v)
            unique = determined(at.point.svd, None, self.actuated_v)
            given = np.concatenate((np.zeros((m, 2 * n)), np.eye(m)), axis=1)
            by_lambda = where_unique(linear.multipliers(by_a, given), unique)
        units = setting.v[at.v]
        columns = np.concatenate((units, units, setting.force[self.actuated_v]))
        return ForwardDynamicsDerivatives(
            *self._moved(at, linear),
            dynamics=found,
            accelerations=ByForces(*parts(units[:, None] * by_y / columns, n)),
            a=ByForces(*parts(setting.v[:, None] * by_a / columns, n)),
            lambda_=ByForces(*parts(setting.rows[:, None] * by_lambda / columns, n)),
        )

    def _linearised(
        self,
        at: Independent,
        motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        external: External | None,
    ) -> Linearised:
        """Return the linearised equations of motion in the model's own units."""
        setting, (v, a, tau, lambda_) = self._setting, motion
        by_q, by_v = self.passive.derivatives(at.point.q * setting.q, v)
        by_q = by_q * setting.v / setting.force[:, None]
        wrenches = [
            (setting.kinematics.frame(name, "external", InputError), np.asarray(wrench) / setting.wrench)
            for name, wrench in (external or {}).items()
        ]
        return Linearised(
            setting.kinematics,
            setting.couplings,
            setting.tree,
            self.actuated_v,
            at,
            Motion(
                v / setting.v, a / setting.v, tau / setting.force[self.actuated_v], lambda_ / setting.rows
            ),
            Acting(by_q, by_v * setting.v / setting.force, wrenches),
        )

    def _prescription(
        self, linear: Linearised, index: IndexArray, frames: ByName
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the matrix of prescribed accelerations, their derivatives by q and v, and frames' units."""
        setting, nv = self._setting, int(self.model.nv)
        matrices, drifts, units = [np.eye(nv)[index]], [np.zeros((len(index), 2 * nv))], [np.zeros(0)]
        for name, value in frames.items():
            mask = np.isfinite(np.asarray(value, dtype=float))
            J, _, by_q, by_v = linear.bodies.frame(setting.kinematics.frame(name, "frames", InputError))
            matrices.append(J[mask])
            drifts.append(np.concatenate((by_q, by_v), axis=1)[mask])
            units.append(setting.twist[mask])
        return np.concatenate(matrices), np.concatenate(drifts), np.concatenate(units)

    def _moved(self, at: Independent, linear: Linearised) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """Return the fields of `derivatives.Kinematics`."""
        setting = self._setting
        v_by_q = setting.v[:, None] * linear.v_by_q / setting.v[at.v]
        return at.names, setting.motion(at), v_by_q
