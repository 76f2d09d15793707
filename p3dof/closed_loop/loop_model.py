"""`LoopModel`: a tree model, its loop closures and its actuators, one configuration at a time."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, TypeGuard, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from typing_extensions import Self

from p3dof.checks import FloatArray, frozen_array, positive, shown
from p3dof.closed_loop.assembly import TOLERANCE, Assembler, Assembly, State
from p3dof.closed_loop.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.closed_loop.dynamics import Dynamics
from p3dof.closed_loop.energy import energy_rate
from p3dof.closed_loop.formats import pinocchio_models, urdf
from p3dof.closed_loop.joints import configuration_of, joint_named, single_joint
from p3dof.closed_loop.locks import locked_at, without
from p3dof.closed_loop.modes import assemble_within_limits, assembly_modes
from p3dof.closed_loop.passive import Passive
from p3dof.closed_loop.results import ForwardDynamics, InverseDynamics
from p3dof.closed_loop.sidecar import Coupling, Sidecar, SidecarLike
from p3dof.closed_loop.targets import (
    BoundFrameTarget,
    CombinedTarget,
    FrameTarget,
    JointTarget,
    NoTarget,
    Target,
)
from p3dof.closed_loop.trees import check_tree
from p3dof.closed_loop.trust import Limits
from p3dof.closed_loop.units import ScaledModel, scaled
from p3dof.errors import InputError, ModelError

CLOSED = 1e-5
"""Largest gap at which inverse dynamics has a meaning [m or rad]."""
NEARLY_CLOSED = 1e-3
"""Largest gap at which forward dynamics has: an integrator's intermediate stages are a little open."""
CONSISTENT = 1e-6
"""Largest relative error of velocities and accelerations at the closures, for inverse dynamics."""
NEARLY_CONSISTENT = 1e-2
"""Largest relative error of velocities at the closures, for forward dynamics: likewise."""

OneTarget: TypeAlias = FrameTarget | ArrayLike | Mapping[str, float]
"""A frame's placement, the values of the actuated joints, or values of joints by name."""
TargetLike: TypeAlias = OneTarget | Sequence[OneTarget] | None
"""One target, several at once, or nothing but closed loops."""
_SEQUENCES, _NO_NUMBERS = (list, tuple), (FrameTarget, Mapping)  # checked at every call: no union is made
External = Mapping[str, ArrayLike]
"""Frame name → wrench (6,): force [N], moment [N m], in world axes at the frame's origin."""


class LoopModel:
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
    An instance owns workspaces that every method writes to: it is not thread-safe. Give each thread a `copy`.
    Arrays in results are read-only copies.

    A model much larger or smaller than a metre is computed in a unit of length of its own, see
    `p3dof.closed_loop.units`: tolerances that are said here in metres are in that unit then, and so are ranks
    and the conditioning.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        if not isinstance(model, pin.Model):
            raise ModelError(f"model: expected a pinocchio.Model, got {type(model).__name__}")
        if not isinstance(sidecar, Sidecar):
            raise ModelError(f"sidecar: expected a Sidecar, got {type(sidecar).__name__}")
        check_tree(model)
        self.model = model
        self.sidecar = sidecar
        self._kinematics = LoopKinematics(model, sidecar)
        self.reference = configuration_of(model, sidecar.reference)
        """The configuration (nq,) that says which assembly is meant; neutral if the sidecar says nothing."""
        self.reference.setflags(write=False)
        self._joints = [single_joint(model, name, "actuated") for name in sidecar.actuated]
        self.actuated_v = np.array([model.idx_vs[j] for j in self._joints], dtype=int)
        self.actuated_v.setflags(write=False)
        self._assembler = Assembler(self._kinematics, self.reference)
        self._dynamics = Dynamics(self._kinematics, self.actuated_v)
        self._data = model.createData()
        self.passive = Passive(model, sidecar.joint_data)
        """Springs, damping and friction in the joints; see `Sidecar.joint_data`."""
        own = cast("type[Self]", type(self))
        self._scaled: ScaledModel[Self] | None = scaled(model, sidecar, own)

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
        Drake's ball constraints, ``<mimic>``. At most 1000 links and 200 degrees of freedom are read.

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
            What to do with elements that look like loops and are not understood.
        passive : bool
            Whether the damping and friction of ``<dynamics>`` act; they are often guesses. What the sidecar
            says of a joint always does, and goes before.

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            If a file is missing, malformed or too large, names something that does not exist, or has what
            looks like a loop and is not understood.
        InputError
            If `root_joint` is not a joint model.
        """
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

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            If a constraint is of another kind, has an offset, a velocity or an acceleration of its own, or
            the tree is one that Pinocchio computes wrongly (joints that are not depth first).
        InputError
            If `model` is no tree of Pinocchio.
        """
        return cls(*pinocchio_models.read(model, constraint_models, actuated, couplings, reference))

    def copy(self) -> Self:
        """Return an independent copy, for another thread (processes: an instance can be pickled)."""
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

        Returns
        -------
        ClosedLoopModel

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

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            As `lock`; if no joint is kept.
        """
        kept = {joint_named(self.model, str(name), "reduced") for name in list(joints)}
        return self.lock([str(self.model.names[i]) for i in range(1, self.model.njoints) if i not in kept])

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
        return self._kinematics.constraint_models.copy()

    @property
    def constraint_rows(self) -> tuple[slice, ...]:
        """Rows of each closure, then coupling, in `closure_error`, `closure_jacobian` and the multipliers."""
        return tuple(self._kinematics.rows)

    @property
    def generic_rank(self) -> int | None:
        """Rank of the closures around the reference configuration; None if the loops do not close there."""
        return self._assembler.generic_rank if self._scaled is None else self._scaled.core.generic_rank

    @property
    def unit_of_length(self) -> float:
        """The unit that a model much larger or smaller than a metre is computed in [m]; else 1."""
        return 1.0 if self._scaled is None else self._scaled.units.length

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
            `p3dof.closed_loop.closure_kinds`: positions, then rotations. Couplings: q_joint - p(q_on)
            [m or rad], where joints are continuous the nearest of the values that differ by whole turns.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._at(q).error.copy()

    def closure_gaps(self, q: ArrayLike) -> FloatArray:
        """Return one number for each closure, then coupling: how far it is open.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Returns
        -------
        (closures + couplings,) array
            The distance by which the closure's positions are off [m] or the angle by which its rotations are
            [rad], whichever is the larger number; the absolute error of a coupling.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._kinematics.gaps(self._at(q).error)

    def closure_jacobian(self, q: ArrayLike) -> FloatArray:
        """Return the Jacobian J of closures and couplings.

        For ``3d`` and ``6d`` J v is the velocity of frame 2 seen from frame 1, in the axes of frame 1. It is
        the derivative of `closure_error`; that of a ``6d`` where it is closed.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Returns
        -------
        (rows, nv) array

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._at(q).J.copy()

    def rank(self, q: ArrayLike) -> int:
        """Return the rank of the closures' Jacobian at `q` (nq,), whose loops should be closed."""
        if self._scaled is not None:
            return self._scaled.core.rank(self._scaled.q(self._configuration("q", q)))
        return self._at(q).svd.rank

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

        Returns
        -------
        Assembly

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or only beyond the limits; it carries the gap that is
            left.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        start = None if guess is None else self._configuration("guess", guess)
        bound, tolerance = self._target(target), positive("tolerance", tolerance, InputError)
        if self._scaled is not None:
            return self._scaled.assemble(_goal(target), start, tolerance, within_limits)
        if within_limits:
            return assemble_within_limits(self._assembler, bound, start, tolerance)
        return self._assembler.assemble(bound, start, tolerance)

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
        bound, starts, seed = self._target(target), whole("starts", starts, 1), whole("seed", seed, 0)
        if self._scaled is not None:
            return self._scaled.assembly_modes(_goal(target), starts, seed, within_limits)
        return assembly_modes(self._assembler, bound, starts, seed, within_limits)

    def beyond_limits(self, q: ArrayLike) -> dict[str, float]:
        """Return which hinges and slides are beyond their limits at `q` (nq,), and by how much [m or rad].

        Below the lower limit it is negative.
        """
        return Limits(self.model).beyond(self._configuration("q", q))

    def complete(
        self, target: TargetLike, velocity: ArrayLike, acceleration: ArrayLike, guess: ArrayLike | None = None
    ) -> State:
        """Find configuration, velocity and acceleration of the whole tree from the motion of a target.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these
            As in `assemble`.
        velocity, acceleration : (n,) array
            Velocity and acceleration of the joints, or the prescribed components, in the order of the mask,
            of the frame's ``LOCAL_WORLD_ALIGNED`` velocity and classical acceleration. Of several targets one
            after the other.
        guess : (nq,) array, optional
            As in `assemble`.

        Returns
        -------
        State

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or the closed mechanism cannot move so.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        bound = self._target(target)
        v = frozen_array("velocity", velocity, (bound.size,))
        a = frozen_array("acceleration", acceleration, (bound.size,))
        start = None if guess is None else self._configuration("guess", guess)
        if self._scaled is not None:
            return self._scaled.complete(_goal(target), v, a, start)
        return self._assembler.complete(bound, self._assembler.assemble(bound, start, TOLERANCE), v, a)

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
        return energy_rate(self.model, self._data, q, v, a) + float(self.passive.power(q, v))

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

    def _configuration(self, name: str, q: ArrayLike) -> FloatArray:
        array = frozen_array(name, q, (self.model.nq,))
        if self.model.nq != self.model.nv and not pin.isNormalized(self.model, array, 1e-6):
            raise InputError(
                f"{name}: not normalised (unit quaternions and circles); see pinocchio.normalize"
            )
        return array

    def _at(self, q: ArrayLike, largest_gap: float = np.inf) -> ClosurePoint:
        point = self._kinematics.at(self._configuration("q", q))
        self._check_gap(point, largest_gap)
        return point

    def _check_gap(self, point: ClosurePoint, largest_gap: float) -> None:
        if not point.tight and not point.gap <= largest_gap:
            raise InputError(
                f"q: the {self._kinematics.worst(point.error)} is open by {point.gap:.3g} m or rad, "
                f"expected at most {largest_gap:g}; assemble(None, guess=q) closes it"
            )

    def _closed_at(self, q: ArrayLike, v: FloatArray) -> ClosurePoint:
        """Return the closures at a state that nearly keeps them closed; a scaled core checks for itself."""
        point = self._at(q, NEARLY_CLOSED if self._scaled is None else np.inf)
        if self._scaled is None and point.J.size:
            opening = point.J @ v
            if not opening.dot(opening) <= NEARLY_CONSISTENT**2:  # else the largest is less, too
                self._check_opening("v", opening, NEARLY_CONSISTENT * max(1.0, max_abs(v)))
        return point

    def _target(self, target: TargetLike) -> Target:
        if target is None:
            return NoTarget(self.model.nv)
        if isinstance(target, FrameTarget):
            return BoundFrameTarget(self._kinematics, target)
        if isinstance(target, Mapping):
            return JointTarget(self._kinematics, self._named_joints(target), list(target.values()))
        if _are_several(target):
            return CombinedTarget([self._target(part) for part in target])
        return JointTarget(self._kinematics, self._joints, cast("ArrayLike", target))

    def _named_joints(self, names: Iterable[str]) -> list[int]:
        try:
            return [single_joint(self.model, name, "target") for name in names]
        except ModelError as error:
            raise InputError(str(error)) from error

    def _moving(self, q: ArrayLike, v: FloatArray, a: FloatArray) -> ClosurePoint:
        """Return the closures at a motion that keeps them closed."""
        k, q = self._kinematics, self._configuration("q", q)
        k.move(q, v, a)
        point = k.at(q)
        if point.J.size:
            self._check_gap(point, CLOSED)
            relative = CONSISTENT + (0.0 if point.tight else 100.0 * point.gap)
            opening = point.J @ v
            if not opening.dot(opening) <= relative**2:  # else the largest is less, too
                self._check_opening("v", opening, relative * max(1.0, max_abs(v)))
            opening = k.acceleration()
            if not opening.dot(opening) <= relative**2:
                allowed = relative * max(1.0, max_abs(a), max_abs(v) ** 2)
                self._check_opening("a", opening, allowed)
        return point

    def _check_opening(self, name: str, opening: FloatArray, allowed: float) -> None:
        worst = max_abs(opening)
        if worst > allowed:
            raise InputError(
                f"{name}: opens the {self._kinematics.worst(opening)} by {worst:.3g} (SI units), "
                f"expected at most {allowed:.1g}; complete() finds motions that keep the loops closed"
            )

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


def _are_several(target: TargetLike) -> TypeGuard[Sequence[OneTarget]]:
    """Whether a target is a sequence of targets, and not of numbers."""
    return isinstance(target, list | tuple) and any(
        isinstance(part, FrameTarget | Mapping) for part in target
    )


def whole(name: str, value: int, least: int) -> int:
    """Return a whole number that is at least so large.

    Parameters
    ----------
    name : str
        What to call it in an error.
    value : int
        The number.
    least : int
        The least that it may be.

    Raises
    ------
    InputError
        If it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name}: expected a whole number of at least {least}, got {shown(value)}")
    return int(value)


def _goal(target: TargetLike) -> Any:
    """Return a target that was checked, with arrays where numbers are meant."""
    if target is None or isinstance(target, FrameTarget):
        return target
    if isinstance(target, Mapping):
        return {name: float(value) for name, value in target.items()}
    if _are_several(target):
        return [_goal(part) for part in target]
    return np.asarray(target, dtype=float)
