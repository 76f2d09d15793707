"""`CompiledLoop`: the dynamics of one robot with closed loops, compiled for its partition of speeds."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError
from p3dof.loops.compiled.following import FollowingLoop
from p3dof.loops.compiled.results import (
    CompiledDerivatives,
    CompiledDynamics,
    derivatives_with_general,
    with_general,
)
from p3dof.loops.derivatives import ByForces, ByMotion
from p3dof.loops.loop_model import External


class CompiledLoop(FollowingLoop):
    """The dynamics of one robot, compiled; made by `ClosedLoopModel.compile`.

    Parameters
    ----------
    loop : DerivativesModel
        The robot as it is now: masses and gravity that change later are not seen.
    around : (K, nq) array, optional
        Closed configurations that the partition of speeds is made for.
    external : iterable of str
        Frames on which external wrenches act.
    joint_forces : bool
        Whether forces in all joints are given.
    inertias : iterable of str
        Joints whose bodies get their inertial parameters at each call.
    level : str
        ``"auto"``, ``"avx512"``, ``"avx2"``, ``"baseline"`` or ``"numpy"``.
    threads : int, optional
        Most threads for many samples; by default ``P3DOF_THREADS``, else all processors.

    Raises
    ------
    ModelError
        If a joint is of a kind that cannot be compiled, or the robot is too large.
    AssemblyError
        If the loops do not close at the reference configuration.
    InputError
        If an argument does not fit.
    """

    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
    ) -> CompiledDynamics:
        """Return the actuator forces that produce a motion, at one sample or at N.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, with closed loops.
        v, a : (nv,) or (N, nv) array
            Velocities and accelerations, which keep the loops closed.
        external : mapping of str to (6,) or (N, 6) array, optional
            Wrenches on the frames that were named when it was compiled: force [N], moment [N m], in world
            axes at the frame's origin.
        joint_forces : (nv,) or (N, nv) array, optional
            What else acts in the joints, where it was compiled for that.
        inertias : mapping of str to (10,) or (N, 10) array, optional
            Inertial parameters of the bodies of joints that were named when it was compiled, as
            `pinocchio.Inertia.toDynamicParameters` gives them; what the robot has by default.

        Returns
        -------
        CompiledDynamics
            With ``tau`` and ``lambda_``.

        Raises
        ------
        InputError, SingularityError, DynamicsError
            Of one sample, as `ClosedLoopModel.inverse_dynamics`; those of many are in ``errors``.
        """
        nv = self._loop.model.nv
        given, single = self._rows({"q": (q, self._loop.model.nq), "v": (v, nv), "a": (a, nv)})
        load = self._load(len(given["q"]), external, joint_forces, inertias)
        found = self._run("inverse_dynamics", {**given, **load})

        def alone(i: int) -> dict[str, ArrayLike]:
            loop, (forces, joints) = self._alone(i, load)
            done = loop.inverse_dynamics(given["q"][i], given["v"][i], given["a"][i], forces, joints)
            return {"tau": done.tau, "lambda_": done.lambda_}

        return with_general(found, alone, ("tau", "lambda_"), single)

    def hybrid_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a_actuated: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
        stabilisation: float = 0.0,
    ) -> CompiledDynamics:
        """Return forces and motion for accelerations of the actuated joints; idle freedoms move as they must.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, with closed loops.
        v : (nv,) or (N, nv) array
            Velocities, which keep them closed.
        a_actuated : (n_actuated,) or (N, n_actuated) array
            Accelerations of the actuated joints.
        external, joint_forces, inertias
            As in `inverse_dynamics`.
        stabilisation : float
            β of Baumgarte's stabilisation [1/s], as of `ClosedLoopModel.forward_dynamics`.

        Returns
        -------
        CompiledDynamics
            With ``tau``, ``a`` and ``lambda_``.

        Raises
        ------
        ModelError
            If there are more actuators than freedoms.
        InputError, SingularityError, DynamicsError
            Of one sample, as `ClosedLoopModel.hybrid_dynamics`; those of many are in ``errors``.
        """
        model, count = self._loop.model, len(self._robot.motors)
        given, single = self._rows(
            {"q": (q, model.nq), "v": (v, model.nv), "a_actuated": (a_actuated, count)}
        )
        load = self._load(len(given["q"]), external, joint_forces, inertias)
        name, beta = _stabilised("hybrid_dynamics", stabilisation)
        found = self._run(name, {**given, **load, **beta})

        def alone(i: int) -> dict[str, ArrayLike]:
            loop, (forces, joints) = self._alone(i, load)
            sample = given["q"][i], given["v"][i], given["a_actuated"][i]
            done = loop.hybrid_dynamics(*sample, None, forces, joints)
            return {"tau": done.tau, "a": done.a, "lambda_": done.lambda_}

        return with_general(found, alone, ("tau", "a", "lambda_"), single)

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
        stabilisation: float = 0.0,
    ) -> CompiledDynamics:
        """Return the acceleration that actuator forces produce, at one sample or at N.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, with closed loops.
        v : (nv,) or (N, nv) array
            Velocities.
        tau : (n_actuated,) or (N, n_actuated) array
            Forces of the actuated joints [N or N m].
        external, joint_forces, inertias
            As in `inverse_dynamics`.
        stabilisation : float
            β of Baumgarte's stabilisation [1/s], as of `ClosedLoopModel.forward_dynamics`.

        Returns
        -------
        CompiledDynamics
            With ``a``.

        Raises
        ------
        InputError, DynamicsError
            Of one sample, as `ClosedLoopModel.forward_dynamics`; those of many are in ``errors``.
        """
        model, count = self._loop.model, len(self._robot.motors)
        given, single = self._rows({"q": (q, model.nq), "v": (v, model.nv), "tau": (tau, count)})
        load = self._load(len(given["q"]), external, joint_forces, inertias)
        name, beta = _stabilised("forward_dynamics", stabilisation)
        found = self._run(name, {**given, **load, **beta})

        def alone(i: int) -> dict[str, ArrayLike]:
            loop, (forces, joints) = self._alone(i, load)
            done = loop.forward_dynamics(given["q"][i], given["v"][i], given["tau"][i], forces, joints)
            return {"a": done.a}

        return with_general(found, alone, ("a",), single)

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, external: External | None = None
    ) -> CompiledDerivatives:
        """Return the actuator forces and their exact derivatives, at one sample or at N.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, with closed loops.
        v, a : (nv,) or (N, nv) array
            Velocities and accelerations, which keep the loops closed.
        external : mapping of str to (6,) or (N, 6) array, optional
            As in `inverse_dynamics`; constant in world axes.

        Returns
        -------
        CompiledDerivatives

        Raises
        ------
        InputError, SingularityError, DynamicsError
            Of one sample, as `ClosedLoopModel.inverse_dynamics_derivatives`; those of many are in ``errors``.
        """
        nv = self._loop.model.nv
        given, single = self._rows({"q": (q, self._loop.model.nq), "v": (v, nv), "a": (a, nv)})
        load = self._load(len(given["q"]), external, None)

        def alone(i: int) -> tuple[FloatArray, ByMotion]:
            loop, (forces, _) = self._alone(i, load)
            state = given["q"][i], given["v"][i], given["a"][i]
            found = loop.inverse_dynamics_derivatives(*state, self.independent, forces)
            return found.dynamics.tau, found.tau

        inputs = {
            "q": given["q"],
            "v_independent": given["v"][:, self._robot.independent],
            "a_independent": given["a"][:, self._robot.independent],
        }
        found = self._tangents("tangent_of_forces", inputs, load, ("dq", "dv", "da"))
        return derivatives_with_general(found, ("tau", "dtau"), ByMotion, alone, single)

    def forward_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, external: External | None = None
    ) -> CompiledDerivatives:
        """Return the acceleration of the tree and its exact derivatives, at one sample or at N.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, with closed loops.
        v : (nv,) or (N, nv) array
            Velocities, which keep them closed.
        tau : (n_actuated,) or (N, n_actuated) array
            Forces of the actuated joints.
        external : mapping of str to (6,) or (N, 6) array, optional
            As in `inverse_dynamics`; constant in world axes.

        Returns
        -------
        CompiledDerivatives

        Raises
        ------
        InputError, DynamicsError
            Of one sample, as `ClosedLoopModel.forward_dynamics_derivatives`; those of many are in ``errors``.
        """
        model, count = self._loop.model, len(self._robot.motors)
        given, single = self._rows({"q": (q, model.nq), "v": (v, model.nv), "tau": (tau, count)})
        load = self._load(len(given["q"]), external, None)

        def alone(i: int) -> tuple[FloatArray, ByForces]:
            loop, (forces, _) = self._alone(i, load)
            state = given["q"][i], given["v"][i], given["tau"][i]
            found = loop.forward_dynamics_derivatives(*state, self.independent, forces)
            return found.dynamics.a, found.a

        inputs = {
            "q": given["q"],
            "v_independent": given["v"][:, self._robot.independent],
            "tau": given["tau"],
        }
        found = self._tangents("tangent_of_accelerations", inputs, load, ("dq", "dv", "dtau"))
        return derivatives_with_general(found, ("a", "da"), ByForces, alone, single)


def _stabilised(name: str, stabilisation: float) -> tuple[str, dict[str, FloatArray]]:
    """Return the function for β, and that as its input."""
    beta = frozen_array("stabilisation", stabilisation, ())
    if beta < 0:
        raise InputError(f"stabilisation: expected zero or more, got {float(beta):g}")
    return (f"stabilised_{name}", {"stabilisation": beta.reshape(1)}) if beta else (name, {})
