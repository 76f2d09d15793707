"""`LoopModel`: all that a user asks a robot with loops at one configuration, and what answers it.

The robot itself is a `ClosedTree`, which computes one sample; `minimal`, `derivatives`, `regressor` and
`margins` have its equations of motion. `ScaledTree` stands between metres and the unit of length that the
robot is computed in.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Self

from p3dof._base.checks import FloatArray, frozen_array, require
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import derivatives, minimal, regressor
from p3dof.loops.assembly import TOLERANCE, Assembly, Limits, State, TargetLike, named_joints
from p3dof.loops.batch.kinematics import BodyEnergies, energies_of
from p3dof.loops.closed_tree import ClosedTree, External
from p3dof.loops.coordinates import configuration_of, joint_named, length_coordinates
from p3dof.loops.hybrid import ByName, by_joint, rates_of
from p3dof.loops.margins import Margins, SingularityMargins
from p3dof.loops.results import ForwardDynamics, HybridDynamics, InverseDynamics
from p3dof.loops.sidecar import Coupling, MotorSide, Sidecar, SidecarLike, motor_side
from p3dof.loops.trees import locked_at, without
from p3dof.loops.units import BatchTree, ScaledTree, Units


class LoopModel:
    """A robot with (or without) loop closures, one configuration at a time; see `ClosedLoopModel`."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self._tree = ClosedTree(model, sidecar)
        self._si_batch = BatchTree(self._tree)
        self._scaled = ScaledTree(self._si_batch, Units(model, sidecar))
        natural = self._scaled.core is self._tree
        self._own = self._tree if natural else self._scaled  # what computes one sample, in and out in metres
        self._many = self._si_batch if natural else self._scaled  # and many
        self._made: dict[str, Any] = {}  # what others make of the robot, and keep with it
        self.model, self.sidecar = model, sidecar
        self.reference = self._tree.reference
        """The configuration (nq,) that says which assembly is meant; neutral if the sidecar says nothing."""
        self.actuated_v = self._tree.actuated_v  # where in v the actuated joints are, in their order
        self.passive = self._tree.passive
        """Springs, damping and friction in the joints, and bushings; see `Sidecar`."""

    def __reduce__(self) -> tuple[type[Self], tuple[pin.Model, Sidecar]]:

        return type(self), (self.model, self.sidecar)  # so that it can be sent to another process

    def __repr__(self) -> str:

        kind, loops, names = type(self).__name__, len(self.sidecar.closures), ", ".join(self.actuated)
        coupled = f", couplings={len(self.sidecar.couplings)}" if self.sidecar.couplings else ""
        return (
            f"{kind}({self.model.name!r}, nv={self.model.nv}, closures={loops}{coupled}, actuated=[{names}])"
        )

    @property
    def actuated(self) -> tuple[str, ...]:
        """Names of the actuated joints, in the order of `tau`."""
        return self.sidecar.actuated

    @property
    def constraint_models(self) -> pin.StdVec_ConstraintModel:
        """The closures that Pinocchio knows, points and frames, as its constraint models; a copy."""
        return self._tree.kinematics.constraint_models.copy()

    @property
    def constraint_rows(self) -> tuple[slice, ...]:
        """Rows of each closure, then coupling, in `closure_error`, `closure_jacobian` and the multipliers."""
        return tuple(self._tree.kinematics.rows)

    @property
    def unit_of_length(self) -> float:
        """The unit that a model much larger or smaller than a metre is computed in [m]; else 1."""
        return self._scaled.units.length

    @property
    def generic_rank(self) -> int | None:
        """Rank of the closures around the reference configuration; None if the loops do not close there."""
        return self._own.generic_rank

    @property
    def regular_configuration(self) -> FloatArray:
        """A closed configuration (nq,) of the generic rank: the reference, or one nearby if it is singular.

        A four-bar that lies flat in its reference configuration has a smaller rank and more mobility there
        than anywhere else, so that accelerations and forces are not determined. The motor of the piston
        cannot move a slider-crank at its dead centre, as it does nearby.

        Raises
        ------
        AssemblyError
            If the loops do not close at the reference configuration.
        """
        found = self._own.regular
        return np.array(self.assemble().q if found is None else found)

    @classmethod
    def from_urdf(
        cls,
        path_or_xml: str | os.PathLike[str],
        closures: SidecarLike = None,
        root_joint: pin.JointModel | None = None,
        mimic: bool = True,
        on_unknown: Literal["raise", "ignore"] = "raise",
        passive: bool = False,
    ) -> Self:
        """Build the model from a tree URDF and its sidecar; `p3dof.load_robot` reads more formats.

        Loops in the file itself are read too: those of URDF+ (``<loop>``, ``<coupling>``, ``independent``),
        Drake, Isaac Sim and Gazebo, ``<mimic>``. At most 1000 links and 200 degrees of freedom are read.

        Parameters
        ----------
        path_or_xml : str or path-like
            The path of a URDF, or its text.
        closures : Sidecar, mapping, str or path-like, optional
            The sidecar, a mapping with the keys of its file, or the path of the file or its text. Without one
            the robot is an open tree and every joint with one degree of freedom is actuated; a warning
            is given for one that looks as if it had loops, unless an empty tuple says that this is meant.
        root_joint : pin.JointModel, optional
            The joint between the world and the root link; by default the root link is fixed.
        mimic : bool
            Whether ``<mimic>`` couples joints; else they are independent.
        on_unknown : {"raise", "ignore"}
            What to do with elements that are not understood: refuse those that may hold links or joints
            together and name the others in a warning, or leave all out without a word.
        passive : bool
            Whether the damping and friction of ``<dynamics>`` act; they are often guesses. What the sidecar
            says of a joint always does, and goes before.

        Raises
        ------
        ModelError
            If a file is missing, malformed or too large, names something that does not exist, or has what may
            hold links or joints together and is not understood.
        InputError
            If `root_joint` is not a joint model.
        """
        from p3dof.loops.formats import urdf

        return cls(*urdf.read(path_or_xml, closures, root_joint, mimic, on_unknown, passive))

    @classmethod
    def from_pinocchio(
        cls,
        model: pin.Model,
        constraint_models: Iterable[Any] = (),
        actuated: Sequence[str] | None = None,
        couplings: Iterable[Coupling] = (),
        reference: Mapping[str, Any] | None = None,
    ) -> Self:
        """Take over a tree and constraint models that were made with Pinocchio.

        The tree is copied, and gets a frame at each end of each constraint. Baumgarte's parameters and the
        compliance of the constraints are left out: see `stabilisation` of `forward_dynamics`.

        Parameters
        ----------
        model : pin.Model
            The tree, or what has one as its `model`, such as a RobotWrapper.
        constraint_models : iterable
            `RigidConstraintModel` (3D or 6D), `PointAnchorConstraintModel`, `FrameAnchorConstraintModel`, or
            a `ConstraintModel` that holds one of the two.
        actuated : sequence of str, optional
            Names of the actuated joints; by default all with one degree of freedom that no coupling
            determines.
        couplings : iterable of Coupling
            Joints that follow others.
        reference : mapping of str to float or sequence of float, optional
            The configuration that says which assembly is meant, as in `Sidecar`.

        Raises
        ------
        ModelError
            If a constraint is of another kind, has an offset, a velocity or an acceleration of its own, or
            the tree is one that Pinocchio computes wrongly (joints that are not depth first).
        InputError
            If `model` is no tree of Pinocchio.
        """
        from p3dof.loops.formats import pinocchio_models

        return cls(*pinocchio_models.read(model, constraint_models, actuated, couplings, reference))

    def copy(self) -> Self:
        """Return an independent copy, for other masses or gravity; instances can be pickled, too."""
        return type(self)(self.model.copy(), self.sidecar)

    def lock(self, joints: Mapping[str, Any] | Iterable[str] | str) -> Self:
        """Return the robot with some joints locked; its closures, couplings and other joints stay.

        Locked joints are no joints any more: what hung on them is part of the body before them. A model that
        keeps the joint, and the force that locks it, has a coupling ``Coupling(joint, None, (value,))``.

        Parameters
        ----------
        joints : mapping of str to float or sequence of float, or names
            Values by joint, as in `Sidecar.reference`; names alone for the values of the reference
            configuration.

        Raises
        ------
        ModelError
            If a joint does not exist, its values do not fit, no joint would be left, or a closure or coupling
            is broken that the joints left over cannot restore.
        """
        names, q = locked_at(self.model, joints, self.reference)
        return type(self)(*without(self.model, self.sidecar, names, q))

    def reduced(self, joints: Iterable[str]) -> Self:
        """Return the robot with only some of its joints; the others are locked as in the reference.

        Parameters
        ----------
        joints : iterable of str
            The joints to keep. They should close the loops: assemble a reference configuration first.

        Raises
        ------
        ModelError
            As `lock`; if no joint is kept.
        """
        kept = {joint_named(self.model, str(name), "reduced") for name in list(joints)}
        return self.lock([str(self.model.names[i]) for i in range(1, self.model.njoints) if i not in kept])

    def around(self, values: Mapping[str, float]) -> Self:
        """Return the robot with another reference configuration: closed, where some joints have given values.

        Assembly, `regular_configuration`, compiled functions and generated code start there. Other joints
        follow on the assembly of the reference configuration, or on that of the values where too many are
        given for any other; these may be rounded, to 0.01.

        Parameters
        ----------
        values : mapping of str to float
            Values of joints with one degree of freedom [m or rad].

        Raises
        ------
        AssemblyError
            If the loops do not close there.
        InputError
            If there is no such joint, or a value is not finite.
        """
        require("around", values, Mapping)
        model, gap, names = self.model, np.inf, [*values]
        joints = named_joints(model, names, "around")
        numbers = frozen_array("around", [*values.values()], (len(names),))
        wanted = dict(zip(names, numbers.tolist(), strict=True))
        guess = configuration_of(model, wanted, "around", self.reference)
        try:
            home = self.assemble().q
        except AssemblyError:
            home = guess
        freedoms = [model.idx_vs[joint] for joint in joints]
        near = 0.01 * np.where(length_coordinates(model)[1], self.unit_of_length, 1.0)
        for target, start in ((wanted, home), (wanted, guess), (None, guess)):
            try:
                q = self.assemble(target, start).q
            except AssemblyError as error:
                gap = min(gap, error.gap)
                continue
            if (np.abs(pin.difference(model, guess, q)) <= near)[freedoms].all():
                return self._with_reference(q)
        told = ", ".join(f"{name}={value:.4g}" for name, value in wanted.items())
        raise AssemblyError(f"around: the loops do not close at {told}: {gap:.3g} m or rad is left", gap)

    def _with_reference(self, q: FloatArray) -> Self:
        """Return the robot with another reference configuration."""
        places = zip(list(self.model.names)[1:], list(self.model.joints)[1:], strict=True)
        reference = {str(name): q[j.idx_q : j.idx_q + j.nq] for name, j in places}
        return type(self)(self.model.copy(), replace(self.sidecar, reference=reference))

    def closure_error(self, q: ArrayLike) -> FloatArray:
        """Return how far each closure is open, and how far off each coupling is.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Returns
        -------
        (rows,) array
            ``3d``: R1ᵀ(p2 - p1) [m]; ``6d``: log6(M1⁻¹ M2) [m, rad]; the others as in
            `p3dof.loops.closure_kinds`: positions, then rotations. Couplings: q_joint - p(q_on)
            [m or rad], where joints are continuous the nearest of the values that differ by whole turns.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._tree.closure_error(q)

    def closure_gaps(self, q: ArrayLike) -> FloatArray:
        """Return how far each closure, then coupling, is open: (closures + couplings,), or of N, (N, ...).

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            One configuration, or N of them.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        if np.ndim(q) == 1:
            return self._tree.kinematics.gaps(self._tree.at(q).error)
        return self._si_batch.gaps(*self._tree.states(q))

    def closure_jacobian(self, q: ArrayLike) -> FloatArray:
        """Return the Jacobian J (rows, nv) of closures and couplings.

        For ``3d`` and ``6d`` J v is the velocity of frame 2 seen from frame 1, in the axes of frame 1. It is
        the derivative of `closure_error`; that of a ``6d`` where it is closed.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._tree.at(q).J.copy()

    def rank(self, q: ArrayLike) -> int:
        """Return the rank of the closures' Jacobian at `q` (nq,), whose loops should be closed."""
        return self._own.rank(q)

    def mobility(self, q: ArrayLike) -> int:
        """Return the number of free motions of the closed mechanism at `q` (nq,): nv - rank."""
        return int(self.model.nv) - self.rank(q)

    def assemble(
        self,
        target: TargetLike = None,
        guess: ArrayLike | None = None,
        tolerance: float = TOLERANCE,
        within_limits: bool = False,
    ) -> Assembly:
        """Find the configuration that closes the loops at a target, on the assembly of the guess.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these, optional
            A frame's placement, or the values of the actuated joints [m or rad; an angle for a continuous
            joint], or those of other joints by name; or several of them at once, such as the placement of a
            floating base, motors by name and a hand. Without one the loops are only closed, by the shortest
            way.
        guess : (nq,) array, optional
            Where to start; by default the reference configuration. Others can fall into a wrong assembly,
            which `same_assembly` of the result then tells.
        tolerance : float
            Largest closure and target error that counts as closed [m or rad]. The iteration goes on to
            round-off whatever it is.
        within_limits : bool
            Whether hinges and slides have to stay within the limits that the tree's model has for them, which
            may lead to another assembly; else `beyond_limits` tells who does not.

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or only beyond the limits; it carries the gap that is
            left.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        return self._own.assemble(target, guess, tolerance, within_limits)

    def assembly_modes(
        self, target: TargetLike, starts: int = 64, seed: int = 0, within_limits: bool = False
    ) -> tuple[Assembly, ...]:
        """Find all configurations that close the loops at a target, from random starts.

        That none is missing cannot be known; more starts find more. Whole turns of a joint make no other mode
        in a model without couplings.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these
            As in `assemble`; it must determine every joint, together with the closures.
        starts : int
            How many starts there are; the first one is the reference configuration.
        seed : int
            Of the random starts.
        within_limits : bool
            As in `assemble`.

        Returns
        -------
        tuple of Assembly
            That nearest to the reference configuration first; `same_assembly` tells which are on its
            assembly.

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or there are free motions left.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        return self._own.assembly_modes(target, starts, seed, within_limits)

    def beyond_limits(self, q: ArrayLike) -> dict[str, float]:
        """Return which hinges and slides are beyond their limits at `q` (nq,), and by how much [m or rad].

        Below the lower limit it is negative.
        """
        return Limits(self.model).beyond(self._tree.configuration("q", q))

    def complete(
        self,
        target: TargetLike,
        velocity: ArrayLike | ByName,
        acceleration: ArrayLike | ByName,
        guess: ArrayLike | None = None,
    ) -> State:
        """Find configuration, velocity and acceleration of the whole tree from the motion of a target.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these
            As in `assemble`.
        velocity, acceleration : (n,) array, or mapping of str to float
            Velocity and acceleration of the joints, in the order of the target or all of them by name; or the
            prescribed components, in the order of the mask, of the frame's ``LOCAL_WORLD_ALIGNED`` velocity
            and classical acceleration. Of several targets one after the other.
        guess : (nq,) array, optional
            As in `assemble`.

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or the closed mechanism cannot move so.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        if type(velocity) is not np.ndarray or type(acceleration) is not np.ndarray:
            velocity, acceleration = rates_of(target, (velocity, acceleration), self.actuated)
        return self._own.complete(target, velocity, acceleration, guess)

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
        return self._own.inverse_dynamics(q, v, a, (external, joint_forces))

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
        """Return the largest error of the equation of motion with given forces, as measured [N or N m].

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
        external, joint_forces : optional
            As in `inverse_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        return self._tree.residual(q, v, a, tau, lambda_, (external, joint_forces))

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | ByName,
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
        tau : (n_actuated,) array, or mapping of str to float
            Forces of the actuated joints [N or N m]; by name, those of the others are zero.
        external, joint_forces
            As of `residual`.
        stabilisation : float
            β of Baumgarte's stabilisation [1/s]: gaps e of the loops follow ë + 2β ė + β² e = 0.

        Raises
        ------
        DynamicsError
            If no acceleration satisfies closures and equation of motion to the accuracy of the method.
        InputError
            If an argument has the wrong shape or is not finite, the loops are open by more than 1e-3, or the
            velocity opens them by more than 1e-2 of itself.
        """
        if type(tau) is not np.ndarray and isinstance(tau, Mapping):
            tau = by_joint("tau", tau, self.actuated, 0.0)
        return self._own.forward_dynamics(q, v, tau, (external, joint_forces), stabilisation)

    def hybrid_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stabilisation: float = 0.0,
    ) -> HybridDynamics:
        """Return the forces that produce prescribed accelerations, while passive freedoms move freely.

        Passive is what is neither prescribed nor determined by the closures: a floating base, wheels, rods
        that spin about themselves. Where everything is prescribed it is `inverse_dynamics`.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v : (nv,) array
            Velocity, which keeps the loops closed.
        prescribed : (n_actuated,) array or mapping of str to float or array
            Accelerations of the actuated joints [m/s² or rad/s²], or those of other joints by name: a number,
            or an array of as many as the joint has freedoms (a floating base: linear, angular, in its own
            axes, as in `v`).
        frames : mapping of str to (6,) array, optional
            Prescribed ``LOCAL_WORLD_ALIGNED`` classical accelerations of frames, linear, then angular; NaN
            where one is left free.
        external, joint_forces : optional
            As in `inverse_dynamics`.
        stabilisation : float
            As in `forward_dynamics`.

        Raises
        ------
        SingularityError
            If the actuators cannot produce such accelerations at this configuration.
        DynamicsError
            If the prescribed accelerations depend on each other, leave forces open, or need a force that no
            actuator gives.
        InputError
            If an argument has the wrong shape or is not finite, a name does not exist, the loops are open by
            more than 1e-3, or the velocity opens them by more than 1e-2 of itself.
        """
        asked, loads = (prescribed, frames), (external, joint_forces)
        return self._own.hybrid_dynamics(q, v, asked, loads, stabilisation)

    def power(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> float:
        """Return the rate of change of the mechanical energy, summed body by body [W].

        It equals the power of actuators and external wrenches, less the `dissipation`, if the dynamics is
        right, and shares nothing with it: every body contributes m vc·(ac - g) + ω·(I α + ω × I ω), every
        spring its power.

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        return self._tree.power(q, v, a)

    def body_energies(self, q: ArrayLike, v: ArrayLike) -> BodyEnergies:
        """Return the kinetic and potential energy of every body, and the momentum of all of them.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            One configuration, or N of them.
        v : (nv,) or (N, nv) array
            Velocities.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or a configuration is not normalised.
        """
        return energies_of(self._tree, q, v)

    def dissipation(self, v: ArrayLike, q: ArrayLike | None = None) -> FloatArray:
        """Return the power [W] that damping and friction in joints and bushings take, see `Sidecar`.

        Parameters
        ----------
        v : (nv,) or (N, nv) array
            Velocities.
        q : (nq,) or (N, nq) array, optional
            Configurations; only what bushings take depends on them.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite, or `q` is missing.
        """
        shape: tuple[int | str, ...] = () if np.ndim(v) == 1 else ("N",)
        v = frozen_array("v", v, (*shape, self.model.nv))
        if not self.passive.bushings:
            return self.passive.dissipation(v)
        if q is None:
            raise InputError("q: expected the configuration, on which the losses of bushings depend")
        return self.passive.dissipation(v, frozen_array("q", q, (*v.shape[:-1], self.model.nq)))

    def motor_side(self, tau: ArrayLike, v: ArrayLike) -> MotorSide:
        """Return torques and speeds of the motors before their gears, see `JointData`.

        Parameters
        ----------
        tau : (n_actuated,) or (N, n_actuated) array
            Forces of the actuated joints [N or N m].
        v : (nv,) or (N, nv) array
            Velocities of the tree.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        shape: tuple[int | str, ...] = () if np.ndim(tau) == 1 else ("N",)
        forces = frozen_array("tau", tau, (*shape, len(self.actuated)))
        speeds = frozen_array("v", v, (*forces.shape[:-1], self.model.nv))[..., self.actuated_v]
        return motor_side(self.actuated, self.sidecar.joint_data, forces, speeds)

    def coordinates(self, q: ArrayLike, names: minimal.Names = None) -> tuple[str, ...]:
        """Return names of independent coordinates at a configuration, one for each freedom.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        names : iterable of str, optional
            Joints, or single freedoms of joints that have several, such as ``base[2]``. By default the
            actuated joints, in their order, if they determine the motion; else those of them that do not
            depend on each other, and other freedoms for what they leave open, those first that move most.
            This choice is made at the reference configuration if it determines the motion here too.

        Raises
        ------
        SingularityError
            If they do not determine the motion at this configuration.
        InputError
            If a name does not exist, there are more than free motions, `q` has the wrong shape or is not
            finite, or the loops are open by more than 1e-5.
        """
        return self._setting.coordinates(self._tree.configuration("q", q), names)

    def minimal_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike | None = None,
        coordinates: minimal.Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> minimal.MinimalDynamics:
        """Return the equations of motion in independent coordinates.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        v : (nv,) or (N, nv) array, optional
            Velocity, which keeps the loops closed; zero by default.
        coordinates : iterable of str, optional
            As in `coordinates`; many configurations have those of the first one.
        external, joint_forces : optional
            As in `inverse_dynamics`.

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        InputError
            If an argument has the wrong shape or is not finite, a name does not exist, the loops are open by
            more than 1e-5, or the velocity would open them.
        """
        return minimal.minimal_dynamics(self._setting, q, v, coordinates, (external, joint_forces))

    def frame_jacobian(
        self, frame: str, q: ArrayLike, v: ArrayLike | None = None, coordinates: minimal.Names = None
    ) -> minimal.FrameJacobian:
        """Return the Jacobian from the motors, or other independent coordinates, to a frame, and its drift.

        Parameters
        ----------
        frame : str
            Name of the frame.
        q, v
            As of `minimal_dynamics`.
        coordinates : iterable of str, optional
            As in `minimal_dynamics`.

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        InputError
            As `minimal_dynamics`, and if the frame does not exist.
        """
        return minimal.frame_jacobian(self._setting, frame, q, v, coordinates)

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        coordinates: minimal.Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> derivatives.InverseDynamicsDerivatives:
        """Return the exact derivatives of `inverse_dynamics` on the constraint manifold.

        By independent coordinates, their speeds and their accelerations. Wrenches stay in world axes and
        follow their frame's origin, joint forces stay. Springs, damping and friction of `joint_data` change:
        friction is smooth, and away from rest it does not.

        Parameters
        ----------
        q, v, a
            As of `inverse_dynamics`.
        coordinates : iterable of str, optional
            As in `coordinates`.
        external, joint_forces : optional
            As in `inverse_dynamics`.

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
        return derivatives.of_inverse_dynamics(self._setting, found, (q, v, a), coordinates, external)

    def hybrid_dynamics_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        coordinates: minimal.Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> derivatives.HybridDynamicsDerivatives:
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
        external, joint_forces : optional
            As in `inverse_dynamics`.

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
        asked = prescribed, frames
        return derivatives.of_hybrid_dynamics(self._setting, found, (q, v), asked, coordinates, external)

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        coordinates: minimal.Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> derivatives.ForwardDynamicsDerivatives:
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
        external, joint_forces : optional
            As in `inverse_dynamics`.

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
        return derivatives.of_forward_dynamics(self._setting, found, (q, v), tau, coordinates, external)

    def force_regressor(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        coordinates: minimal.Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> regressor.LoopRegressor:
        """Return how the actuators' forces depend on inertial parameters and on data of the joints.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        v, a : (nv,) or (N, nv) array
            Velocity and acceleration, which keep the loops closed.
        coordinates : iterable of str, optional
            As in `minimal_dynamics`.
        external, joint_forces : optional
            As in `inverse_dynamics`.

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        InputError
            As `minimal_dynamics`; if the acceleration would open the loops.
        """
        loads = external, joint_forces
        return regressor.force_regressor(self._setting, self._regressor, (q, v, a), coordinates, loads)

    def base_parameters(self, joints: bool = False, seed: int = 0) -> regressor.BaseParameters:
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

        Raises
        ------
        AssemblyError
            If the loops do not close at the reference configuration.
        DynamicsError
            If no motions are found.
        InputError
            If `seed` is no whole number of at least zero.
        """
        return regressor.base_parameters(self._setting, self._regressor, joints, seed)

    def singularity_margins(
        self,
        q: ArrayLike,
        frame: str | None = None,
        components: Sequence[bool] | NDArray[np.bool_] = (True,) * 6,
        length: float | None = None,
    ) -> SingularityMargins:
        """Return how far a configuration is from singularities of actuation, closures and a frame.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        frame : str, optional
            The frame whose motion counts.
        components : (6,) array of bool
            Which of x, y, z, rx, ry, rz of the frame count, in world axes.
        length : float, optional
            The characteristic length by which lengths are divided [m]; by default the longest distance
            between the origin of a joint and what the model fixes to its body.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised, the loops are open by more than 1e-5,
            the frame does not exist, or the length is not positive.
        """
        return self._margins.at(q, frame, components, length)

    @cached_property
    def _setting(self) -> minimal.Setting:
        return minimal.Setting(self._scaled)

    @cached_property
    def _regressor(self) -> regressor.TreeRegressor:
        return regressor.TreeRegressor(self.model, self.sidecar.joint_data, self.passive.bushings)

    @cached_property
    def _margins(self) -> Margins:
        return Margins(self._setting)
