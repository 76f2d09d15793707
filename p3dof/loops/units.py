"""The unit of length in which a robot is computed: its own.

All tolerances of this layer are lengths and angles, and the rows and columns of its matrices mix both, which
fits machines whose links are about as long as the unit of length. `Units` finds such a unit, a power of 64 m;
`ScaledTree` is the only place where numbers go from metres into that unit and back. Powers of two scale
exactly: tolerances change, and no rounding. The metre is the unit of all models of .125 to 8 m; nothing is
scaled there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import LARGEST, FloatArray, frozen_array, not_negative, shown
from p3dof._base.errors import AssemblyError, DynamicsError, InputError, ModelError, P3dofError
from p3dof._base.threads import Workspace
from p3dof.loops.assembly import TOLERANCE, Assembly, FrameTarget, State, TargetLike, in_arrays
from p3dof.loops.batch.assembly import BatchAssembler, BatchStates, FrameTargets, Targets
from p3dof.loops.batch.dynamics import BatchDynamics, BatchHybridDynamics, BatchInverseDynamics, Prescribed
from p3dof.loops.batch.hybrid import BatchHybrid
from p3dof.loops.closed_tree import Asked, ClosedTree, Loads
from p3dof.loops.closure_kinds import LENGTHS
from p3dof.loops.coordinates import length_coordinates
from p3dof.loops.hybrid import JointAccelerations, Prescription
from p3dof.loops.linear import BoolArray, blocks
from p3dof.loops.results import ClosureForces, ForwardDynamics, HybridDynamics, InverseDynamics, read_only
from p3dof.loops.sidecar import Coupling, Sidecar

_STEP = 6  # units are powers of 2**6 m
_POSITIONS = np.arange(6) < 3  # which components of placements, motions and wrenches are lengths, or forces
_EvidenceT = TypeVar("_EvidenceT", bound=ClosureForces)


class Units:
    """Factors between metres and a model's unit of length, for all that this layer takes and returns."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self.q, self.v, known = length_coordinates(model)
        size = size_of(model, sidecar)
        if not size < LARGEST:  # also what is not a number
            raise ModelError(f"model: expected placements of less than {LARGEST:g} m, got {size:g} m")
        power = round(math.log2(size) / _STEP) if known and size > 0 else 0
        self.length = 2.0 ** (_STEP * power)  # the unit of length [m]
        joints = [i for i in range(1, model.njoints) if model.nvs[i] == 1]
        self._slides = {str(model.names[i]): bool(self.v[model.idx_vs[i]]) for i in joints}
        rows = [is_length for closure in sidecar.closures for is_length in LENGTHS[closure.kind]]
        rows += [self._slides[coupling.joint] for coupling in sidecar.couplings]
        self.rows = np.array(rows, dtype=bool)  # which rows of closures and couplings are lengths

    def motion(self, lengths: NDArray[np.bool_]) -> FloatArray:
        """Return the units [m, rad] of coordinates, some of which are lengths."""
        return np.where(lengths, self.length, 1.0)

    def force(self, lengths: NDArray[np.bool_]) -> FloatArray:
        """Return the units [N, N m] of the forces along such coordinates."""
        return np.where(lengths, self.length, self.length**2)

    def scaled(self, model: pin.Model) -> pin.Model:
        """Return a copy of the model in these units; masses and times stay."""
        copy = model.copy()
        for i in range(model.njoints):
            copy.jointPlacements[i] = self._placement(model.jointPlacements[i])
        for frame in copy.frames:
            frame.placement = self._placement(frame.placement)
        self.update(copy, model)
        return copy

    def update(self, copy: pin.Model, model: pin.Model) -> None:
        """Give a scaled copy the masses and the gravity that its model has now."""
        u = self.length
        for i in range(model.njoints):
            body, own = model.inertias[i], pin.Inertia.Zero()  # which is not checked to be a body's
            with np.errstate(over="ignore"):
                lever, inertia = body.lever / u, body.inertia / u**2
            if not (np.abs(lever).max() < LARGEST and np.abs(inertia).max() < LARGEST):
                name = shown(str(model.names[i]))
                raise ModelError(f"the inertia behind the joint {name} is too large in units of {u:.1g} m")
            own.mass, own.lever, own.inertia = body.mass, lever, inertia
            copy.inertias[i] = own
        copy.gravity.linear = model.gravity.linear / u
        with np.errstate(over="ignore"):  # where there is no limit
            for name in ("lowerPositionLimit", "upperPositionLimit"):
                setattr(copy, name, np.asarray(getattr(model, name)) / self.motion(self.q))
        copy.armature = np.asarray(model.armature) / np.where(self.v, 1.0, u**2)

    def sidecar(self, model: pin.Model, sidecar: Sidecar) -> Sidecar:
        """Return the sidecar of the scaled copy of a model."""
        reference: dict[str, Any] = {}
        for name, value in (sidecar.reference or {}).items():
            i = model.getJointId(name)
            lengths = self.q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
            reference[name] = np.asarray(value) / (self.motion(lengths) if lengths.any() else 1.0)
        return replace(
            sidecar,
            closures=tuple(
                replace(closure, length=None if closure.length is None else closure.length / self.length)
                for closure in sidecar.closures
            ),
            couplings=tuple(self._coupling(coupling) for coupling in sidecar.couplings),
            reference=reference or None,
            joint_data=(),  # whoever hands a state in adds what acts in the joints
            bushings=(),
        )

    def _coupling(self, coupling: Coupling) -> Coupling:
        def unit(name: str | None) -> float:
            return self.length if name and self._slides[name] else 1.0

        powers = np.arange(len(coupling.coefficients))
        one = unit(coupling.joint)
        return replace(
            coupling,
            coefficients=tuple(np.array(coupling.coefficients) * unit(coupling.on) ** powers / one),
            others=tuple((name, factor * unit(name) / one) for name, factor in coupling.others),
        )

    def _placement(self, M: pin.SE3) -> pin.SE3:
        return pin.SE3(M.rotation, M.translation / self.length)


class BatchTree:
    """What computes many samples of a `ClosedTree`, of arguments that were checked."""

    def __init__(self, tree: ClosedTree) -> None:
        self.tree = tree

    @cached_property
    def dynamics(self) -> BatchDynamics:
        """Forces, power and conditioning."""
        return BatchDynamics(self.tree)

    @cached_property
    def complete_batch(self) -> Callable[..., BatchStates]:
        """`BatchAssembler.complete`."""
        return BatchAssembler(self.tree).complete

    @cached_property
    def inverse_dynamics_batch(self) -> Callable[..., BatchInverseDynamics]:
        """`BatchDynamics.inverse_dynamics`."""
        return self.dynamics.inverse_dynamics

    @cached_property
    def hybrid_dynamics_batch(self) -> Callable[..., tuple[BatchHybridDynamics, BoolArray]]:
        """`BatchHybrid.solve`; the forces in the joints are all that act there."""
        return BatchHybrid(self.tree).solve

    def gaps(self, q: FloatArray) -> FloatArray:
        """Return how far each closure, then coupling, is open at configurations (N, nq)."""
        kinematics = self.tree.kinematics
        found = [self.dynamics.errors(q[block]) for block in blocks(len(q))]
        return kinematics.gaps(np.concatenate([np.zeros((0, kinematics.size)), *found]))


_WITH_UNIT = re.compile(
    r"(\d[-+.\de]*) (m or rad|m/s or rad/s|m/s² or rad/s²|N or N m|\(SI units\))"
    r"|(?<=expected at most )(\d[-+.\de]*)(?=;)"
)


def in_metres(words: str, unit: float) -> str:
    """Return a message whose numbers are in a unit of length, with them in metres and newtons."""

    def plain(found: re.Match[str]) -> str:
        number, units = float(found[1] or found[3]), found[2] or "m or rad"
        if units.startswith("(") or (found[3] and "(SI" in words):
            return f"{number * unit:.3g} (of angles {number:.3g})" + " (SI units)" * bool(found[2])
        own, other = units.split(" or ")
        return f"{number * unit:.3g} {own} or {number * (unit**2 if own == 'N' else 1):.3g} {other}"

    return _WITH_UNIT.sub(plain, words)


class ScaledTree(Workspace):
    """A robot in its own unit of length, `core`; methods as of `ClosedTree`, in metres."""

    def __init__(self, batch: BatchTree, units: Units) -> None:
        tree = self.tree = batch.tree
        self.units, self._u = units, units.length
        self.batch = batch  # many samples of the robot in this unit
        if units.length != 1.0:
            own = ClosedTree(units.scaled(tree.model), units.sidecar(tree.model, tree.sidecar))
            self.batch = BatchTree(own)
        self.core = self.batch.tree  # the robot in this unit
        self.of_q, self.of_v = units.motion(units.q), units.motion(units.v)  # units [m, rad] of q and v
        self.of_forces, self.of_rows = units.force(units.v), units.force(units.rows)
        """Units [N, N m] of the forces in joints, and of the multipliers."""
        self.of_motors = self.of_forces[tree.actuated_v]
        self.of_twists, self.of_wrenches = units.motion(_POSITIONS), units.force(_POSITIONS)

    @contextmanager
    def in_words(self) -> Iterator[None]:
        """Bring the robot up to date, and say in errors in which unit their numbers are."""
        if self.core is self.tree:
            yield
            return
        self.units.update(self.core.model, self.tree.model)
        try:
            yield
        except (AssemblyError, DynamicsError, InputError) as error:
            raise self.told(error) from error

    def told(self, error: P3dofError) -> P3dofError:
        """Return an error whose numbers name their units."""
        words = in_metres(str(error), self._u)
        if isinstance(error, AssemblyError):
            return AssemblyError(words, error.gap * self._u)
        return type(error)(words)

    @property
    def generic_rank(self) -> int | None:
        """`ClosedTree.generic_rank`."""
        return self.core.generic_rank

    @property
    def regular(self) -> FloatArray | None:
        """`ClosedTree.regular`."""
        found = self.core.regular
        return None if found is None else np.asarray(found * self.of_q)

    def rank(self, q: ArrayLike) -> int:
        """`ClosedTree.rank`."""
        return self.core.rank(self.q(q))

    def q(self, q: ArrayLike, name: str = "q") -> FloatArray:
        """Return a configuration (nq,) in this unit after checking it."""
        return self.tree.configuration(name, q) / self.of_q

    def v(self, name: str, v: ArrayLike) -> FloatArray:
        """Return a velocity or an acceleration (nv,) in this unit after checking it."""
        return frozen_array(name, v, self.of_v.shape) / self.of_v

    def loads(self, q: ArrayLike, v: ArrayLike, loads: Loads) -> Loads:
        """Return all that acts on frames and in joints, in this unit, after checking it."""
        forces = self.tree.acting(q, frozen_array("v", v, self.of_v.shape), loads[1])
        wrenches = self.tree.wrenches({} if loads[0] is None else loads[0])
        of_frames = {name: wrench / self.of_wrenches for name, (_, wrench) in wrenches.items()}
        return of_frames, forces / self.of_forces

    def target(self, target: Any) -> tuple[Any, FloatArray]:
        """Return a target in this unit, and the units [m, rad] of its components."""
        if target is None:
            return None, np.ones(0)
        if isinstance(target, list):
            goals, parts = zip(*(self.target(part) for part in target), strict=True)
            return list(goals), np.concatenate(parts)
        if isinstance(target, Mapping):
            model = self.tree.model
            factors = self.of_v[[model.idx_vs[model.getJointId(name)] for name in target]]
            return {
                name: value / u for (name, value), u in zip(target.items(), factors, strict=True)
            }, factors
        if isinstance(target, FrameTarget):
            place = pin.SE3(target.placement.rotation, target.placement.translation / self._u)
            return FrameTarget(target.frame, place, target.mask), self.of_twists[np.asarray(target.mask)]
        factors = self.of_v[self.tree.actuated_v]
        return target / factors, factors

    def assemble(
        self,
        target: TargetLike = None,
        guess: ArrayLike | None = None,
        tolerance: float = TOLERANCE,
        within_limits: bool = False,
    ) -> Assembly:
        """`ClosedTree.assemble`; the tolerance is in this unit."""
        start = None if guess is None else self.q(guess, "guess")
        self.tree.bound(target)
        goal, _ = self.target(in_arrays(target))
        with self.in_words():
            found = self.core.assemble(goal, start, tolerance, within_limits)
        return self._assembly(found)

    def assembly_modes(
        self, target: TargetLike, starts: int = 64, seed: int = 0, within_limits: bool = False
    ) -> tuple[Assembly, ...]:
        """`ClosedTree.assembly_modes`."""
        self.tree.bound(target)
        goal, _ = self.target(in_arrays(target))
        with self.in_words():
            found = self.core.assembly_modes(goal, starts, seed, within_limits)
        return tuple(self._assembly(one) for one in found)

    def _assembly(self, found: Assembly) -> Assembly:
        return replace(found, q=read_only(found.q * self.of_q), gap=found.gap * self._u)

    def complete(
        self, target: TargetLike, velocity: ArrayLike, acceleration: ArrayLike, guess: ArrayLike | None = None
    ) -> State:
        """`ClosedTree.complete`."""
        size = self.tree.bound(target).size
        goal, factors = self.target(in_arrays(target))
        v = frozen_array("velocity", velocity, (size,)) / factors
        a = frozen_array("acceleration", acceleration, (size,)) / factors
        start = None if guess is None else self.q(guess, "guess")
        with self.in_words():
            found = self.core.complete(goal, v, a, start)
        return replace(
            found,
            q=read_only(found.q * self.of_q),
            v=read_only(found.v * self.of_v),
            a=read_only(found.a * self.of_v),
            gap=found.gap * self._u,
            influence=read_only(found.influence * self.of_v[:, None] / factors),
        )

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, loads: Loads) -> InverseDynamics:
        """`ClosedTree.inverse_dynamics`."""
        given = self.q(q), self.v("v", v), self.v("a", a), self.loads(q, v, loads)
        with self.in_words():
            found = self.core.inverse_dynamics(*given)
        return InverseDynamics(read_only(found.tau * self.of_motors), self._evidence(found.evidence))

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, loads: Loads, stabilisation: float
    ) -> ForwardDynamics:
        """`ClosedTree.forward_dynamics`."""
        motors = frozen_array("tau", tau, self.of_motors.shape) / self.of_motors
        given = self.q(q), self.v("v", v), motors, self.loads(q, v, loads)
        with self.in_words():
            found = self.core.forward_dynamics(*given, stabilisation)
        return replace(found, a=read_only(found.a * self.of_v), evidence=self._evidence(found.evidence))

    def hybrid_dynamics(
        self, q: ArrayLike, v: ArrayLike, asked: Asked, loads: Loads, stabilisation: float
    ) -> HybridDynamics:
        """`ClosedTree.hybrid_dynamics`."""
        checked = Prescription.of(self.tree.kinematics, self.tree.actuated_v, *asked)
        rates = JointAccelerations(checked.v, checked.joints.values / self.of_v[checked.v])
        places = {name: np.asarray(value) / self.of_twists for name, value in checked.frames.items()}
        prescription = Prescription(self.core.kinematics, rates, places)
        given = self.q(q), self.v("v", v), prescription, self.loads(q, v, loads)
        beta = not_negative("stabilisation", stabilisation)
        with self.in_words():
            found = self.core.prescribed_dynamics(*given, beta)
        return replace(
            found,
            tau=read_only(found.tau * self.of_motors),
            a=read_only(found.a * self.of_v),
            evidence=self._evidence(found.evidence),
        )

    def _evidence(self, found: _EvidenceT) -> _EvidenceT:
        """Return evidence of forces in SI units."""
        return found.in_units(self.of_rows, max(self._u, self._u**2), self._u)

    def complete_batch(
        self,
        target: Targets,
        motion: tuple[FloatArray, FloatArray],
        guess: FloatArray | None,
        near: FloatArray | None,
        stop: bool,
    ) -> BatchStates:
        """`BatchTree.complete_batch`."""
        of_joints = self.of_v[[self.core.model.idx_vs[joint] for joint in target.joints]]
        factors = np.concatenate([*(self.of_twists[np.asarray(f.mask)] for f in target.frames), of_joints])
        frames = (
            FrameTargets(part.frame, part.positions / self._u, part.rotations, part.mask)
            for part in target.frames
        )
        goals = replace(target, frames=tuple(frames), values=target.values / of_joints)
        start, first = (None if q is None else q / self.of_q for q in (guess, near))
        with self.in_words():
            found = self.batch.complete_batch(
                goals, (motion[0] / factors, motion[1] / factors), start, first, stop
            )
        return replace(
            found,
            q=found.q * self.of_q,
            v=found.v * self.of_v,
            a=found.a * self.of_v,
            influence=found.influence * self.of_v[:, None] / factors,
            errors={i: self.told(error) for i, error in found.errors.items()},
        )

    def inverse_dynamics_batch(
        self,
        q: FloatArray,
        v: FloatArray,
        a: FloatArray,
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
        stop: bool,
    ) -> BatchInverseDynamics:
        """`BatchTree.inverse_dynamics_batch`."""
        motion = q / self.of_q, v / self.of_v, a / self.of_v
        loads = {name: wrench / self.of_wrenches for name, wrench in external.items()}
        forces = (joint_forces + self.tree.passive.forces(q, v)) / self.of_forces
        with self.in_words():
            found = self.batch.inverse_dynamics_batch(*motion, loads, forces, stop)
        return replace(
            found,
            tau=found.tau * self.of_motors,
            residual=found.residual * max(self._u, self._u**2),
            closure_error=found.closure_error * self.units.motion(self.units.rows),
            errors={i: self.told(error) for i, error in found.errors.items()},
        )

    def hybrid_dynamics_batch(
        self,
        q: FloatArray,
        v: FloatArray,
        prescribed: Prescribed,
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
    ) -> tuple[BatchHybridDynamics, BoolArray]:
        """`BatchTree.hybrid_dynamics_batch`."""
        components = [np.arange(0), *(np.flatnonzero(mask) for _, mask in prescribed.frames)]
        given = replace(
            prescribed,
            values=prescribed.values / self.of_v[prescribed.at],
            of_frames=prescribed.of_frames / self.of_twists[np.concatenate(components)],
        )
        loads = {name: wrench / self.of_wrenches for name, wrench in external.items()}
        state, forces = (q / self.of_q, v / self.of_v), joint_forces / self.of_forces
        with self.in_words():
            found, done = self.batch.hybrid_dynamics_batch(*state, given, loads, forces)
        result = replace(
            found,
            tau=found.tau * self.of_motors,
            a=found.a * self.of_v,
            residual=found.residual * max(self._u, self._u**2),
            closure_error=found.closure_error * self.units.motion(self.units.rows),
        )
        return result, done


def size_of(model: pin.Model, sidecar: Sidecar) -> float:
    """Return the longest distance between a joint's origin and what the model fixes to it [m]."""
    ends = {frame for closure in sidecar.closures for frame in (closure.frame1, closure.frame2)}
    placements = [*model.jointPlacements, *(frame.placement for frame in model.frames if frame.name in ends)]
    rods = [closure.length for closure in sidecar.closures if closure.length is not None]
    return max((*(float(np.linalg.norm(M.translation)) for M in placements), *rods), default=0.0)
