"""`CompiledLoop`: the dynamics of one robot with closed loops, compiled for its partition of speeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, not_negative
from p3dof.loops.closed_tree import External
from p3dof.loops.compiled.following import FollowingLoop
from p3dof.loops.compiled.results import (
    CompiledDerivatives,
    CompiledDynamics,
    derivatives_with_general,
    with_general,
)
from p3dof.loops.derivatives import ByForces, ByMotion
from p3dof.loops.loop_model import LoopModel


class CompiledLoop(FollowingLoop):
    """The dynamics of one robot, compiled; made by `ClosedLoopModel.compile`.

    Parameters
    ----------
    loop : ClosedLoopModel
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
        """Return the forces ``tau`` that produce a motion, and ``lambda_``, at one sample or at N.

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

        Raises
        ------
        InputError, SingularityError, DynamicsError
            Of one sample, as `ClosedLoopModel.inverse_dynamics`; those of many are in ``errors``.
        """
        state, acting = self._state(q, v, "a", a, self._loop.model.nv), (external, joint_forces, inertias)
        return self._found("inverse_dynamics", state, acting, LoopModel.inverse_dynamics, ("tau", "lambda_"))

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
        """Return ``tau``, ``a``, ``lambda_`` for accelerations of actuated joints; passive ones move freely.

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

        Raises
        ------
        ModelError
            If there are more actuators than freedoms.
        InputError, SingularityError, DynamicsError
            Of one sample, as `ClosedLoopModel.hybrid_dynamics`; those of many are in ``errors``.
        """

        def general(loop: LoopModel, q: Any, v: Any, a_actuated: Any, forces: Any, joints: Any) -> Any:
            return loop.hybrid_dynamics(q, v, a_actuated, None, forces, joints)

        state = self._state(q, v, "a_actuated", a_actuated, len(self._robot.motors))
        acting, outputs = (external, joint_forces, inertias), ("tau", "a", "lambda_")
        return self._found("hybrid_dynamics", state, acting, general, outputs, stabilisation)

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
        """Return the acceleration ``a`` that actuator forces produce, at one sample or at N.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, with closed loops.
        v : (nv,) or (N, nv) array
            Velocities.
        tau : (n_actuated,) or (N, n_actuated) array
            Forces of the actuated joints [N or N m].
        external, joint_forces, inertias, stabilisation
            As of `hybrid_dynamics`.

        Raises
        ------
        InputError, DynamicsError
            Of one sample, as `ClosedLoopModel.forward_dynamics`; those of many are in ``errors``.
        """
        state = self._state(q, v, "tau", tau, len(self._robot.motors))
        acting, general = (external, joint_forces, inertias), LoopModel.forward_dynamics
        return self._found("forward_dynamics", state, acting, general, ("a",), stabilisation)

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, external: External | None = None
    ) -> CompiledDerivatives:
        """Return the actuator forces and their exact derivatives, at one sample or at N.

        Parameters
        ----------
        q, v, a
            As of `inverse_dynamics`.
        external : mapping of str to (6,) or (N, 6) array, optional
            As in `inverse_dynamics`; constant in world axes.

        Raises
        ------
        InputError, SingularityError, DynamicsError
            Of one sample, as `ClosedLoopModel.inverse_dynamics_derivatives`; those of many are in ``errors``.
        """
        given, single = self._rows(self._state(q, v, "a", a, self._loop.model.nv))
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

        Raises
        ------
        InputError, DynamicsError
            Of one sample, as `ClosedLoopModel.forward_dynamics_derivatives`; those of many are in ``errors``.
        """
        given, single = self._rows(self._state(q, v, "tau", tau, len(self._robot.motors)))
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

    def _state(
        self, q: ArrayLike, v: ArrayLike, name: str, value: ArrayLike, size: int
    ) -> dict[str, tuple[ArrayLike, int]]:
        """Return the inputs of a function, with their widths."""
        return {"q": (q, self._loop.model.nq), "v": (v, self._loop.model.nv), name: (value, size)}

    def _found(
        self,
        name: str,
        state: Mapping[str, tuple[ArrayLike, int]],
        acting: tuple[Any, Any, Any],
        general: Callable[..., Any],
        outputs: tuple[str, ...],
        stabilisation: float = 0.0,
    ) -> CompiledDynamics:
        """Return the outputs of a function, where they are not to be trusted those of the general layer."""
        given, single = self._rows(state)
        load = self._load(len(given["q"]), *acting)
        beta = not_negative("stabilisation", stabilisation)
        more = {"stabilisation": np.array([beta])} if beta else {}
        found = self._run(f"stabilised_{name}" if beta else name, {**given, **load, **more})

        def alone(i: int) -> dict[str, ArrayLike]:
            loop, loads = self._alone(i, load)
            done = general(loop, *(rows[i] for rows in given.values()), *loads)
            return {key: getattr(done, key) for key in outputs}

        return with_general(found, alone, outputs, single)
