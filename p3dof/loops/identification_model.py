"""`IdentificationModel`: regressors and base parameters of any robot."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof.loops.assembly_model import whole
from p3dof.loops.base_parameters import BaseParameters, base_parameters, random_motions
from p3dof.loops.derivatives_model import DerivativesModel
from p3dof.loops.linear import actuation_of
from p3dof.loops.loop_model import External
from p3dof.loops.minimal import stacked
from p3dof.loops.minimal_model import Names
from p3dof.loops.regressor import LoopRegressor, TreeRegressor


class IdentificationModel(DerivativesModel):
    """What the forces of any robot owe to its parameters."""

    def force_regressor(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        coordinates: Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> LoopRegressor:
        """Return how the actuators' forces depend on inertial parameters and on data of the joints.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        v, a : (nv,) or (N, nv) array
            Velocity and acceleration, which keep the loops closed.
        coordinates : iterable of str, optional
            As in `minimal_dynamics`.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        LoopRegressor

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        InputError
            As `minimal_dynamics`; if the acceleration would open the loops.
        """
        if np.ndim(q) == 2:
            q, v = self._samples(q, v)
            a = frozen_array("a", a, v.shape)
            names = self.coordinates(q[0], coordinates)
            each = zip(q, v, a, strict=True)
            results = [self.force_regressor(*one, names, external, joint_forces) for one in each]
            return stacked(results, ("parameter_names", "parameters"))
        q, v = self._state(q, v)
        a = frozen_array("a", a, v.shape)
        setting = self._setting
        with setting.open():
            at = self._independent(q, coordinates, v)
            setting.core._moving(at.point.q, v / setting.v, a / setting.v)
        free = at.point.svd.null_space
        actuation = actuation_of(at.point.svd, self.actuated_v)
        to_tau = actuation.pseudo_inverse @ free.T  # of generalised forces: the smallest ones
        to_tau = setting.force[self.actuated_v, None] * to_tau / setting.force
        N, Y = setting.motion(at), self._regressor.rows(q, v, a)
        self._kinematics.at(q)
        load = self._external(external, joint_forces)
        return LoopRegressor(
            parameter_names=self._regressor.names,
            parameters=self._regressor.parameters(),
            forces=to_tau @ Y,
            external=-to_tau @ load,
            coordinates=at.names,
            generalised=N.T @ Y,
            generalised_external=N.T @ load,
            actuation=N[self.actuated_v].T.copy(),
        )

    def base_parameters(self, joints: bool = False, seed: int = 0) -> BaseParameters:
        """Return the combinations of parameters that the forces of motions with closed loops can show.

        Found from random motions around the reference assembly, as many as it takes until more of them do not
        show more. The same seed gives the same result.

        Parameters
        ----------
        joints : bool
            Whether rotors, damping, friction, springs and constant forces of the joints are parameters too;
            else only the inertial parameters of the bodies.
        seed : int
            Of the random motions.

        Returns
        -------
        BaseParameters

        Raises
        ------
        AssemblyError
            If the loops do not close at the reference configuration.
        DynamicsError
            If no motions are found.
        InputError
            If `seed` is no whole number of at least zero.
        """
        setting, regressor = self._setting, self._regressor
        count = len(regressor.names) if joints else regressor.inertial
        with setting.open():
            draw = random_motions(setting.core, np.random.default_rng(whole("seed", seed, 0)))

            def rows() -> FloatArray:
                point, v, a = draw()
                Y = regressor.rows(point.q * setting.q, v * setting.v, a * setting.v)
                N = setting.v[:, None] * point.svd.null_space
                return np.asarray(N.T @ Y[:, :count])

            return base_parameters(rows, regressor.names[:count], regressor.parameters()[:count])

    @cached_property
    def _regressor(self) -> TreeRegressor:
        return TreeRegressor(self.model, self.sidecar.joint_data)
