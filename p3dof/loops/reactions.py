"""Reactions: the force and the moment that every joint and every closure transmits.

With the wrenches w of the closures known, the reactions of the tree's joints follow by recursion from the
tips to the root (the data.f of Pinocchio's RNEA). The closures' wrenches themselves solve

    A w = rnea(q, v, a) - Σ Jeᵀ we - B τ - joint_forces,    A = Jᵀ        (1)

where J has a row for every force and moment that the closures can transmit. How they are built decides
which these are (`ClosureJoint`). Couplings have a row each, too; their forces act along the freedoms of two
joints. Where the closures hold the mechanism more often than needed, (1) leaves some of w open, and with it
the reactions of the joints between the closures: rigid bodies do not tell them. Every component is marked
as determined or not. Of all solutions the one is taken in which

    Σ |f|² + |m|² / ℓ²    over all joints and closures                                (2)

is smallest: forces f and moments m of tree and closures alike, so that it does not depend on where the loops
were cut, on the unit of moments, or on left and right of a symmetric mechanism. It does depend on the length
ℓ. It is how joints that are all equally stiff would share the load, with ℓ² for the ratio of their stiffness
against turning to that against shifting; other joints share it otherwise, and where their compliances are
given (`p3dof.loops.compliance`), the complementary energy takes the place of (2).

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, chapters 5 and 8.
M. Wojtyra, Joint reactions in rigid body mechanisms with dependent constraints, Mechanism and Machine Theory
44 (2009) 2265-2278.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, as_floats, frozen_array, positive, shown
from p3dof._base.errors import DynamicsError, InputError, ModelError
from p3dof._base.threads import Own
from p3dof.loops.batch.kinematics import placed, shared_placements
from p3dof.loops.closed_tree import CLOSED, CONSISTENT, External
from p3dof.loops.closure_joints import ClosureJoint, joints_of
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.compliance import JointCompliance
from p3dof.loops.coordinates import ACCURACY
from p3dof.loops.linear import UNIQUE, blocks
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.reaction_algebra import IndexArray, Loads, Measure, Solved, Structure, solve

BoolArray: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class JointReactions(Readable):
    """The wrench that every joint and closure transmits at one state of motion.

    Tree joints come first, in Pinocchio's order, then the closures in the sidecar's. A reaction is what the
    predecessor exerts on the successor: at a joint of the tree the parent's side on the child's, at the
    joint's origin and in the joint's axes, those of the child's link; at a closure the body of `frame1` on
    the body of `frame2`, at the origin and in the axes of `frame1` (as the multipliers of `InverseDynamics`).
    It is the total: along the freedoms of a joint lie the forces of its actuator, of couplings and of
    `joint_forces`, less what its rotor (`model.armature`) takes.

    Parameters
    ----------
    names : tuple of str
        Names of the joints, then of the closures (``frame1/frame2``).
    forces, moments : (n, 3) array
        The reactions [N, N m]; of undetermined ones those that make (2) smallest.
    determined_forces, determined_moments : (n, 3) array of bool
        Which components every solution has in common.
    rotations : (n, 3, 3) array
        The axes of each reaction, as columns, in the world frame.
    positions : (n, 3) array
        Where each reaction acts, in the world frame [m].
    undetermined : int
        How many independent changes of the closures' wrenches leave the motion as it is.
    residual : float
        Largest error of (1) [N or N m].
    fit : (2, n, 2, 3) array
        What assembly errors may add to forces and moments, at worst and at random [N, N m]; zero unless
        the solver knows any.
    """

    names: tuple[str, ...]
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: int
    residual: float
    fit: FloatArray


@dataclass(frozen=True, eq=False)
class ReactionState:
    """What the algebra needs of one state of motion; see `p3dof.loops.reaction_algebra.Loads`."""

    missing: FloatArray
    tree: FloatArray
    J: FloatArray
    placements: FloatArray
    coupled: FloatArray
    rank: int
    tolerance: float
    scale: float
    own: FloatArray

    def __iter__(self) -> Iterator[FloatArray | float]:
        return (getattr(self, name) for name in self.__dataclass_fields__)


__all__ = ["BoolArray", "ClosureJoint", "JointReactions", "ReactionSolver", "loop_reactions"]

_NOTHING = np.zeros(6)  # the wrench of a closure whose joint exerts none itself
LENGTH_SHARE = 1 / 20  # the length of (2) as a share of the longest link, unless it is given


def _centrifugal(data: pin.Data) -> FloatArray:
    """Return |ω| |p| [N] and |v| |p| + |ω| |l| [N m] of each body, after its Newton-Euler equations.

    What these equations add is as large: ω × p and v × p + ω × l of the momenta p and l. The result may be
    far smaller, as v × m v of a body that glides is nothing but rounding.
    """
    twists, momenta = (np.array([x.vector for x in part[1:]]) for part in (data.v, data.h))
    (v, w), (p, turning) = (np.linalg.norm(x.reshape(-1, 2, 3), axis=-1).T for x in (twists, momenta))
    return np.concatenate([w * p, v * p + w * turning])


def loop_reactions(
    loop: ClosedLoopModel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    tau: ArrayLike,
    external: External | None = None,
    joint_forces: ArrayLike | None = None,
    joints: Sequence[ClosureJoint] | None = None,
    length: float | None = None,
) -> JointReactions:
    """Return the reactions of all joints and closures at one state; see `ReactionSolver` for many."""
    return ReactionSolver(loop, joints, length).solve(q, v, a, tau, external, joint_forces)


class ReactionSolver:
    """Reactions of one robot, for any number of threads at once.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot. Its masses and gravity are read at every call.
    joints : sequence of ClosureJoint, optional
        How each closure is built, in the sidecar's order; without it the closures transmit just what they
        prescribe: a ``3d`` is a ball joint, a ``6d`` a rigid connection, and so on.
    length : float, optional
        What compares moments with forces where a choice is made, ℓ in (2) [m]; a twentieth of the longest
        link by default, about the span of a bearing.
    compliances : sequence of JointCompliance, optional
        How each joint and closure gives way, in the order of `names`: then, instead of (2), the complementary
        energy is smallest: what elastic joints bear; see `p3dof.loops.compliance`.
    misfit : (n + c, 6) array, optional
        By how much each joint may be out of place when it is assembled, shifts [m] and turns [rad] of the
        successor against the predecessor in the axes of the reaction; zero along freedoms. Then the results
        tell what this adds.

    Raises
    ------
    InputError
        If `loop` is something else, or the length is not positive.
    ModelError
        If there is not one `ClosureJoint` for each closure, or not one `JointCompliance` for each joint.
    """

    def __init__(
        self,
        loop: ClosedLoopModel,
        joints: Sequence[ClosureJoint] | None = None,
        length: float | None = None,
        compliances: Sequence[JointCompliance] | None = None,
        misfit: ArrayLike | None = None,
    ) -> None:
        if not isinstance(loop, ClosedLoopModel):
            raise InputError(f"loop: expected a ClosedLoopModel, got {type(loop).__name__}")
        self.loop = loop
        self.joints = joints_of(loop.sidecar, joints)
        self.names = (*(str(name) for name in loop.model.names[1:]), *(c.name for c in loop.sidecar.closures))
        self._kinematics = LoopKinematics(loop.model, loop.sidecar)
        self._data = Own(loop.model.createData)
        ends = [(c.frame1, c.frame2) for c in loop.sidecar.closures]
        frame = self._kinematics.frame
        self._ends = [tuple(frame(name, "closure", ModelError) for name in pair) for pair in ends]
        self._size = self._longest_link()
        self.length = LENGTH_SHARE * self._size if length is None else positive("length", length, InputError)
        self._structure = self._structured(self._measure(compliances, misfit))
        self._placements = Own(lambda: shared_placements(self._kinematics.data))
        self._no_loads = pin.StdVec_Force([pin.Force.Zero() for _ in range(loop.model.njoints)])

    def solve(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> JointReactions:
        """Return the reactions at one state of motion.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v, a : (nv,) array
            Velocity and acceleration, which keep the loops closed.
        tau : (n_actuated,) array
            Forces of the actuated joints that produce the motion, as `ClosedLoopModel.inverse_dynamics`
            returns them [N or N m].
        external : mapping of str to (6,) array, optional
            Wrenches that act on frames: force [N], moment [N m], in world axes at the frame's origin. They
            are part of no reaction; neither is friction in a closure, a pair of them on its frames.
        joint_forces : (nv,) array, optional
            Generalised forces that act in the joints besides the actuators', such as springs and friction.

        Raises
        ------
        DynamicsError
            If the forces do not produce the motion.
        ModelError
            If the closures' joints block a free motion of the loops, or leave one that the loops block.
        InputError
            If an argument has the wrong shape or is not finite, the loops are open by more than 1e-5, or the
            velocity would open them.
        """
        found = self.solve_all([self.state(q, v, a, tau, external, joint_forces)])
        error = self.error_of(found, 0)
        if error is not None:
            raise error
        wrenches = found.wrenches[0].reshape(-1, 2, 3)
        determined = self.determined(found)[0]
        return JointReactions(
            self.names,
            forces=wrenches[:, 0],
            moments=wrenches[:, 1],
            determined_forces=determined[:, 0],
            determined_moments=determined[:, 1],
            rotations=found.rotations[0],
            positions=found.positions[0],
            undetermined=int(found.undetermined[0]),
            residual=float(found.residual[0]),
            fit=found.fit[:, 0].reshape(2, -1, 2, 3),
        )

    def state(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        within: Mapping[str, FloatArray] | None = None,
    ) -> ReactionState:
        """Return what the algebra needs of one state of motion; arguments and errors are those of `solve`.

        `within` has those of `external`, by frame, that the joint of the closure with this `frame2` exerts
        itself.
        """
        model = self.loop.model
        v, a = frozen_array("v", v, (model.nv,)), frozen_array("a", a, (model.nv,))
        parts = [np.zeros(model.nv)]
        if joint_forces is not None:
            parts.append(frozen_array("joint_forces", joint_forces, (model.nv,)))
        parts[0][self.loop.actuated_v] = frozen_array("tau", tau, (len(self.loop.actuated),))
        point = self._closed(q, v)
        if self.loop.passive:
            parts.append(self.loop.passive.joint_forces(point.q, v))
        given = np.sum(parts, axis=0)
        bushings = self.loop.passive.bushings
        loads = self._loads(external) if external or bushings else self._no_loads
        for joint, force in bushings.wrenches(self._kinematics.data, point.q, v) if bushings else ():
            loads[joint] = loads[joint] + force
        data = self._data.here
        missing = np.array(pin.rnea(model, data, point.q, v, a, loads)) - given
        tree = np.array([f.vector for f in data.f[1:]]).reshape(-1, 6)
        parts.append(_centrifugal(data))
        return ReactionState(
            missing,
            tree,
            np.array(self._kinematics.data.J).reshape(6, model.nv),  # Pinocchio flattens one column
            self._placements.here.copy(),
            point.J[self._kinematics.coupled],
            point.svd.rank,
            point.rank_tolerance,
            max_abs(np.concatenate(parts)),  # not of their sum: a motor can do nothing but overcome friction
            np.array([(within or {}).get(c.frame2, _NOTHING) for c in self.loop.sidecar.closures]).reshape(
                -1, 6
            ),
        )

    def solve_all(self, states: Sequence[ReactionState]) -> Solved:
        """Return the reactions of many states; `error_of` tells which of them are none.

        Raises
        ------
        ModelError
            If the closures' joints block a free motion of the loops, or leave one that the loops block.
        """
        stacks = [np.array(column) for column in zip(*states, strict=True)]
        missing, tree, J, placements, coupled, rank, tolerance, scale, own = stacks
        R, p = placed(placements)
        found = solve(self._structure, Loads(missing, tree, J, R, p, coupled, rank, tolerance, scale, own))
        for wrong in np.flatnonzero(found.rank != rank).tolist():
            free = missing.shape[1] - np.array([found.rank[wrong], rank[wrong]])
            raise ModelError(f"joints: they leave {free[0]} free motions, the loops have {free[1]}")
        return found

    def error_of(self, found: Solved, i: int) -> DynamicsError | None:
        """Return why a state has no reactions, if it has none."""
        residual = found.residual[i]
        if residual <= ACCURACY * found.scale[i]:  # not when something is not a number
            return None
        return DynamicsError(
            f"tau: the forces do not produce the motion, {residual:.3g} N or N m is missing; "
            "inverse_dynamics() returns those that do"
        )

    def determined(self, found: Solved) -> BoolArray:
        """Return which components every solution has in common, (N, n, 2, 3): of forces, of moments."""
        return np.asarray(found.moves <= UNIQUE * np.array([[1.0], [self._size]]))

    def _closed(self, q: ArrayLike, v: FloatArray) -> ClosurePoint:
        """Return the closures at `q` after checking that they are closed and stay so."""
        self.loop.closure_error(q)  # checks shape and norm
        point = self._kinematics.at(np.array(q, dtype=float))
        if not point.gap <= CLOSED:
            raise InputError(
                f"q: the {self._kinematics.worst(point.error)} is open by {point.gap:.3g} m or rad, "
                f"expected at most {CLOSED:g}; assemble(None, guess=q) closes it"
            )
        opening = point.J @ v
        if max_abs(opening) > (CONSISTENT + 100.0 * point.gap) * max(1.0, max_abs(v)):
            raise InputError(
                f"v: opens the {self._kinematics.worst(opening)} by {max_abs(opening):.3g} (SI units)"
            )
        return point

    def _loads(self, external: External | None) -> pin.StdVec_Force:
        """Return the external wrenches joint by joint, in the axes and at the origin of each joint."""
        if external is not None and not isinstance(external, Mapping):
            raise InputError(f"external: expected a mapping of frames to wrenches, got {shown(external)}")
        loads = pin.StdVec_Force([pin.Force.Zero() for _ in range(self.loop.model.njoints)])
        for name, wrench in (external or {}).items():
            frame = self._kinematics.frame(name, "external", InputError)
            joint = self._kinematics.data.oMi[frame.parentJoint]
            place = pin.SE3(joint.rotation.T, frame.placement.translation)  # of world axes at the frame
            load = pin.Force(np.array(frozen_array(f"external {name}", wrench, (6,))))
            loads[frame.parentJoint] = loads[frame.parentJoint] + place.act(load)
        return loads

    def _passes(self, frame1: pin.Frame, frame2: pin.Frame) -> FloatArray:
        """Return what part of a closure's wrench each joint bears: 1 or -1 on either branch, 0 elsewhere."""
        signs = np.zeros(self.loop.model.njoints)
        signs[list(self.loop.model.supports[frame1.parentJoint])] += 1
        signs[list(self.loop.model.supports[frame2.parentJoint])] -= 1
        return signs

    def _measure(self, compliances: Sequence[JointCompliance] | None, misfit: ArrayLike | None) -> Measure:
        """Return what is smallest where rigid bodies leave a choice."""
        count = len(self.names)
        if compliances is None:
            if misfit is not None:
                raise ModelError("misfit: loads of assembly errors depend on the compliances; give them too")
            return Measure(self.length)
        given = tuple(compliances)
        if len(given) != count or not all(isinstance(one, JointCompliance) for one in given):
            raise ModelError(f"compliances: expected a JointCompliance for each of {', '.join(self.names)}")
        if misfit is None:
            return Measure(self.length, given)
        tolerances = frozen_array("misfit", misfit, (count, 6), ModelError)
        if (tolerances < 0).any():
            raise ModelError("misfit: expected tolerances that are not negative")
        return Measure(self.length, given, tolerances)

    def _structured(self, measure: Measure) -> Structure:
        """Return what is the same in all samples."""
        model = self.loop.model
        ends = [(f.parentJoint, f.placement, g.parentJoint, g.placement) for f, g in self._ends]
        signs = np.array([self._passes(*pair) for pair in self._ends]).reshape(-1, model.njoints)
        freedoms = np.repeat(np.arange(model.njoints), model.nvs)
        along = self._kinematics.lengths[self._kinematics.couplings.following]
        parents = np.array(list(model.parents))
        return Structure(self.joints, ends, signs, freedoms, along, self._size, parents, measure)

    def _longest_link(self) -> float:
        """Return the length that compares moments with forces in (1): the longest arm within a body [m]."""
        model, frames = self.loop.model, [frame for pair in self._ends for frame in pair]
        arms = [model.jointPlacements[j].translation for j in range(1, model.njoints) if model.parents[j]]
        arms += [frame.placement.translation for frame in frames if frame.parentJoint]
        return max((float(np.linalg.norm(arm)) for arm in arms), default=0.0) or 1.0


@dataclass(frozen=True, eq=False)
class BatchReactions(Readable):
    """The wrench that every joint and closure transmits at N samples; see `JointReactions`.

    Rows of samples without a solution are NaN, False or 0.

    Parameters
    ----------
    names : tuple of str
        Names of the joints, then of the closures.
    forces, moments : (N, n, 3) array
        The reactions [N, N m].
    determined_forces, determined_moments : (N, n, 3) array of bool
        Which components every solution has in common.
    rotations : (N, n, 3, 3) array
        The axes of each reaction, as columns, in the world frame.
    positions : (N, n, 3) array
        Where each reaction acts, in the world frame [m].
    undetermined : (N,) array of int
        How many independent changes of the closures' wrenches leave the motion as it is.
    fit : (N, 2, n, 2, 3) array
        What assembly errors may add to forces and moments, at worst and at random [N, N m]; zero unless
        the solver knows any.
    errors : dict of int to DynamicsError
        Why there is no solution, by sample; not for samples that are not finite.
    """

    names: tuple[str, ...]
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: NDArray[np.int_]
    fit: FloatArray
    errors: dict[int, DynamicsError]

    def arrays(self) -> dict[str, Any]:
        """Return the arrays by name."""
        return {name: getattr(self, name) for name in _ARRAYS}

    def put(self, solver: ReactionSolver, rows: IndexArray, found: Solved) -> None:
        """Enter the reactions of some samples, or why they have none."""
        wrong = {i: solver.error_of(found, i) for i in range(len(rows))}
        self.errors.update({int(rows[i]): error for i, error in wrong.items() if error is not None})
        good = np.array([i for i, error in wrong.items() if error is None], dtype=int)
        at, wrenches, determined = rows[good], found.wrenches[good], solver.determined(found)[good]
        self.forces[at], self.moments[at] = wrenches[..., :3], wrenches[..., 3:]
        self.determined_forces[at], self.determined_moments[at] = determined[:, :, 0], determined[:, :, 1]
        self.rotations[at], self.positions[at] = found.rotations[good], found.positions[good]
        self.undetermined[at] = found.undetermined[good]
        self.fit[at] = np.moveaxis(found.fit[:, good], 0, 1).reshape(self.fit[at].shape)


_ARRAYS = (
    "forces",
    "moments",
    "determined_forces",
    "determined_moments",
    "rotations",
    "positions",
    "undetermined",
    "fit",
)


def reactions_batch(
    solver: ReactionSolver,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    tau: ArrayLike,
    external: Mapping[str, ArrayLike] | None = None,
    joint_forces: ArrayLike | None = None,
    within: Mapping[str, ArrayLike] | None = None,
) -> BatchReactions:
    """Return the reactions at many samples.

    Parameters
    ----------
    solver : ReactionSolver
        Of the robot.
    q : (N, nq) array
        Configurations, with closed loops. Samples that are not finite in `q` or `tau` are left out.
    v, a : (N, nv) array
        Velocities and accelerations.
    tau : (N, n_actuated) array
        Forces of the actuated joints that produce the motion [N or N m].
    external : mapping of str to (6,) or (N, 6) array, optional
        Wrenches that act on frames, in world axes [N, N m].
    joint_forces : (nv,) or (N, nv) array, optional
        What acts in the joints besides the actuators.
    within : mapping of str to (6,) or (N, 6) array, optional
        Those of `external` on a closure's `frame2` that its joint exerts itself, such as friction: they are
        counted in its reaction, and in the energy of elastic joints.

    Raises
    ------
    ModelError, InputError
        As `ReactionSolver.solve`, or if the shapes do not fit.
    """
    return reactions_by_each([solver], q, v, a, tau, external, joint_forces, within)[0]


def reactions_by_each(
    solvers: Sequence[ReactionSolver],
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    tau: ArrayLike,
    external: Mapping[str, ArrayLike] | None = None,
    joint_forces: ArrayLike | None = None,
    within: Mapping[str, ArrayLike] | None = None,
) -> list[BatchReactions]:
    """Return what `reactions_batch` returns, by solvers of one robot that build its closures differently."""
    solver = solvers[0]
    model, rows = solver.loop.model, as_floats("q", q)
    if rows.ndim != 2 or rows.shape[1] != model.nq:
        raise InputError(f"q: expected shape (N, {model.nq}), got {rows.shape}")
    count = len(rows)
    forces = _each("tau", tau, count, len(solver.loop.actuated))
    motion = [_each(name, value, count, model.nv) for name, value in (("v", v), ("a", a))]
    loads = {name: _each(f"external {name}", load, count, 6) for name, load in (external or {}).items()}
    own = {name: _each(f"within {name}", load, count, 6) for name, load in (within or {}).items()}
    nothing = np.zeros(model.nv)
    acting = _each("joint_forces", nothing if joint_forces is None else joint_forces, count, model.nv)
    results = [_nothing(one.names, count) for one in solvers]
    known = np.isfinite(forces).all(axis=1) & np.isfinite(rows).all(axis=1)
    rows_known = np.flatnonzero(known)
    for block in (rows_known[some] for some in blocks(len(rows_known))):
        states = [
            solver.state(
                rows[i],
                motion[0][i],
                motion[1][i],
                forces[i],
                {name: load[i] for name, load in loads.items()},
                acting[i],
                {name: load[i] for name, load in own.items()},
            )
            for i in block.tolist()
        ]
        for one, result in zip(solvers, results, strict=True):
            result.put(one, block, one.solve_all(states))
    return results


def _nothing(names: tuple[str, ...], count: int) -> BatchReactions:
    shape = (count, len(names), 3)
    return BatchReactions(
        names,
        forces=np.full(shape, np.nan),
        moments=np.full(shape, np.nan),
        determined_forces=np.zeros(shape, dtype=bool),
        determined_moments=np.zeros(shape, dtype=bool),
        rotations=np.full((*shape, 3), np.nan),
        positions=np.full(shape, np.nan),
        undetermined=np.zeros(count, dtype=int),
        fit=np.full((count, 2, len(names), 2, 3), np.nan),
        errors={},
    )


def _each(name: str, value: ArrayLike, count: int, width: int) -> FloatArray:
    """Return (count, width) rows of a value that may be the same for all; they may hold NaN."""
    array = as_floats(name, value)
    if array.shape not in ((width,), (count, width)):
        raise InputError(f"{name}: expected shape ({count}, {width}), got {array.shape}")
    return np.broadcast_to(array, (count, width))
