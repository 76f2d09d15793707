"""Inverse dynamics by Pinocchio: the generated URDF, its loop closures, RNEA and the projection.

Only the platform's motion is given, as the target of the frame ``platform_center``; every joint is found by
closing the loops. No closed form of this mechanism is used: what agrees with `p3dof.methods.virtual_power`
agrees independently.

Friction for the Pinocchio route: joint forces in the tree, pairs of moments where its loops are cut.

The rates are those of Pinocchio's own joints and frames; no closed form of the mechanism is used.

What acts in the joints of the Pinocchio route by itself: friction, and the counterbalances of the sliders.

The reflected inertia of motors and screws is none of it: it is in the model, as Pinocchio's armature.

Which samples the Pinocchio route takes: its own verdict, from Pinocchio's model and constraint Jacobian.

A pose is out of reach if the loops do not close there on the assembly of home. It is actuation-singular if
the sliders cannot hold the platform: with ∂λC/∂θ from the constraint Jacobian, r the arm from P to the
hinge and φ the tilt of leg C's cross-bar from the vertical, the arm is

    sin α = ∂λC/∂θ · cos φ / r        (1)

away from the plane of the rods, the angle that `p3dof.closed_form.kinematics` has in closed form. Nothing
here comes from there: when both ways call the same samples valid, they do so independently.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import AssemblyError, P3dofError, SampleError, SingularityError
from p3dof._base.outputs import written
from p3dof._base.samples import ACTUATION_TOLERANCE, POLICIES, raise_out_of_reach, raise_singular
from p3dof._base.threads import Own
from p3dof._base.tracing import Number
from p3dof.loops import ClosedLoopModel, FrameTarget, State
from p3dof.loops.batch.assembly import FrameTargets, complete_near
from p3dof.loops.batch.kinematics import Sweep
from p3dof.loops.batch.traced import TracedLoops, Vector, columns_of
from p3dof.loops.linear import BLOCK, IndexArray, blocks
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import PLATFORM, SLIDES, Actuators, Friction, Parameters
from p3dof.methods.solution import CoulombLimits, JointStates, Solution

_UNIVERSALS = ("universal_a", "universal_b")
_UNIVERSAL = np.eye(3)[:2]
"""In the closed mechanism a leg turns about x0 only, the platform about y0 only."""

CUTS = {
    "universal_a": ("leg_a_tip", "platform_a"),
    "universal_b": ("leg_b_tip", "platform_b"),
    "hinge_lower_right": ("rod_right_tip", "crossbar_lower_right"),
}
"""The joints at which the loops are cut: the frames on both sides."""


@dataclass(frozen=True, eq=False)
class Resistance:
    """What friction does at one state, or at N of them."""

    joint_forces: FloatArray  # (nv,): friction in the joints of the tree [N or N m]
    external: dict[str, FloatArray]  # (6,): wrenches on the frames at the cuts, in world axes
    power: float | FloatArray  # (N,): power that is lost [W]

    def external_with(self, wrench: FloatArray | None) -> dict[str, FloatArray]:
        """Return all wrenches on frames: these, and one on the platform at P if there is one."""
        return self.external if wrench is None else {PLATFORM: wrench, **self.external}

    def plus(self, other: Resistance) -> Resistance:
        """Return both together."""
        external = dict(self.external)
        for frame, wrench in other.external.items():
            external[frame] = external[frame] + wrench if frame in external else wrench
        return Resistance(self.joint_forces + other.joint_forces, external, self.power + other.power)


class FrictionForces:
    """Friction of a machine in its closed-loop model."""

    def __init__(self, loop: ClosedLoopModel, friction: Friction | None) -> None:
        self._model = loop.model
        friction = friction or Friction()
        self._frictionless, self._smoothing = not friction, friction.smoothing
        self._viscous, self._coulomb = np.zeros((2, self._model.nv))
        self._of_cuts: dict[str, tuple[float, float | FloatArray]] = {}
        places = places_of(loop)
        for name in friction.joints:
            viscous, coulomb = friction.viscous.get(name, 0.0), friction.coulomb.get(name, 0.0)
            if name in places:
                self._viscous[places[name]], self._coulomb[places[name]] = viscous, coulomb
            else:
                self._of_cuts[name] = viscous, coulomb
        self._watch(tuple(self._of_cuts))

    @classmethod
    def of_limits(cls, loop: ClosedLoopModel, coulomb: CoulombLimits) -> FrictionForces:
        """Return Coulomb friction that differs from sample to sample, for `over` these samples."""
        found, places = cls(loop, None), places_of(loop)
        found._frictionless, found._smoothing = False, coulomb.smoothing
        count = max((len(values) for values in coulomb.limits.values()), default=0)
        found._coulomb = np.zeros((count, loop.model.nv))
        for name, values in coulomb.limits.items():
            if name in places:
                found._coulomb[:, places[name]] = values[:, 0]
            else:
                found._of_cuts[name] = 0.0, values
        found._watch(tuple(found._of_cuts))
        return found

    def _watch(self, cuts: tuple[str, ...]) -> None:
        """Keep in mind at which cuts there is friction."""
        self._cuts = cuts
        self._frames = {frame: self._model.getFrameId(frame) for name in self._cuts for frame in CUTS[name]}
        self._data = Own(self._model.createData)
        self._nothing = Resistance(np.zeros(self._model.nv), {}, 0.0)

    def at(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what friction does at one state."""
        if self._frictionless:
            return self._nothing
        turning: dict[str, tuple[FloatArray, FloatArray]] = {}
        data = self._data.here
        if self._cuts:
            pin.forwardKinematics(self._model, data, q, v)
        for name in self._cuts:
            one, other = (self._frames[frame] for frame in CUTS[name])
            axes = _UNIVERSAL
            if name not in _UNIVERSALS:
                axes = pin.updateFramePlacement(self._model, data, one).rotation[None, :, 1]
            turning[name] = self._spin(data, other) - self._spin(data, one), axes
        return self._resistance(v, turning)

    def over(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what friction does at N states."""
        turning: dict[str, tuple[FloatArray, FloatArray]] = {}
        if self._cuts:
            sweep = Sweep(self._model)
            samples = sweep.at(q)
            spins = sweep.twists(samples.J, v)[..., 3:]
        for name in self._cuts:
            one, other = (self._model.frames[self._frames[frame]] for frame in CUTS[name])
            axes = _UNIVERSAL
            if name not in _UNIVERSALS:
                axes = (samples.R[:, one.parentJoint] @ one.placement.rotation[:, 1])[:, None]
            turning[name] = spins[:, other.parentJoint] - spins[:, one.parentJoint], axes
        return self._resistance(v, turning)

    def _resistance(self, v: FloatArray, turning: dict[str, tuple[FloatArray, FloatArray]]) -> Resistance:
        """Return the resistance from v (..., nv), and the relative spin (..., 3) and axes of every cut."""
        forces = -self._viscous * v - self._coulomb * np.tanh(v / self._smoothing)
        power = -(forces * v).sum(axis=-1)
        external: dict[str, FloatArray] = {}
        for name, (omega, axes) in turning.items():
            viscous, coulomb = self._of_cuts[name]
            rates = (axes @ omega[..., None])[..., 0]
            resisting = viscous * rates + coulomb * np.tanh(rates / self._smoothing)
            power = power + (resisting * rates).sum(axis=-1)
            wrench = np.zeros((*omega.shape[:-1], 6))
            wrench[..., 3:] = -(resisting[..., None, :] @ axes)[..., 0, :]
            one, other = CUTS[name]
            external[one], external[other] = -wrench, wrench
        return Resistance(forces, external, power)

    def _spin(self, data: pin.Data, frame: int) -> FloatArray:
        found = pin.getFrameVelocity(self._model, data, frame, pin.LOCAL_WORLD_ALIGNED).angular
        return np.array(found)


def places_of(loop: ClosedLoopModel) -> dict[str, int]:
    """Return where the velocity of each joint of the tree stands."""
    return {str(name): loop.model.idx_vs[i] for i, name in enumerate(loop.model.names) if i}


def forces_against(
    loop: ClosedLoopModel, joints: JointStates, coulomb: CoulombLimits
) -> tuple[FloatArray, FloatArray]:
    """Return what actuators need more because of Coulomb friction that differs from sample to sample.

    Forces are linear in it, so that they are the difference of those that hold the machine at rest with and
    without what the joints resist with.
    """
    forces, power = np.full((len(joints.q), len(loop.actuated)), np.nan), np.full(len(joints.q), np.nan)
    known, loop = np.isfinite(joints.q).all(axis=1), bare(loop)
    q, v = joints.q[known], joints.v[known]
    rows = CoulombLimits({name: values[known] for name, values in coulomb.limits.items()}, coulomb.smoothing)
    lost, still = FrictionForces.of_limits(loop, rows).over(q, v), np.zeros_like(v)
    held = [
        loop.inverse_dynamics_batch(q, still, still, *against)
        for against in ((lost.external, lost.joint_forces), (None, None))
    ]
    for one in held:
        if one.errors:
            raise next(iter(one.errors.values()))
    forces[known], power[known] = held[0].tau - held[1].tau, lost.power
    return forces, power


def bare(loop: ClosedLoopModel) -> ClosedLoopModel:
    """Return a loop in whose joints nothing acts: `JointForces` adds what acts in those of the machine."""
    if not loop.passive:
        return loop
    return ClosedLoopModel(loop.model, replace(loop.sidecar, joint_data=(), bushings=()))


def armature_of(model: pin.Model, actuators: Actuators) -> FloatArray:
    """Return the armature of a tree: what is reflected to the sliders, zero elsewhere [kg]."""
    found = np.zeros(model.nv)
    found[[model.idx_vs[model.getJointId(slide)] for slide in SLIDES]] = actuators.inertia
    return found


class JointForces:
    """Friction and counterbalances of a machine in its closed-loop model."""

    def __init__(self, loop: ClosedLoopModel, parameters: Parameters) -> None:
        self._friction = FrictionForces(loop, parameters.friction)
        model, actuators = loop.model, parameters.actuators
        joints = [model.getJointId(name) for name in SLIDES]
        self._q = np.array([model.idx_qs[joint] for joint in joints], dtype=int)
        self._v = np.array([model.idx_vs[joint] for joint in joints], dtype=int)
        self._home, self._stiffness = actuators.balance_at_home(parameters.gravity), actuators.stiffness
        self._balanced = bool(self._home.any() or self._stiffness.any())

    def at(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what acts at one state; its power is that of friction alone."""
        return self._with_balance(self._friction.at(q, v), q)

    def over(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what acts at N states."""
        return self._with_balance(self._friction.over(q, v), q)

    def stored_power(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return how fast the potential energy of the counterbalances grows [W]."""
        return np.asarray(-(self._balance(q) * v[..., self._v]).sum(axis=-1))

    def _balance(self, q: FloatArray) -> FloatArray:
        return np.asarray(self._home - self._stiffness * q[..., self._q])

    def _with_balance(self, lost: Resistance, q: FloatArray) -> Resistance:
        if not self._balanced:
            return lost
        forces = np.array(np.broadcast_to(lost.joint_forces, q.shape))
        forces[..., self._v] += self._balance(q)
        return replace(lost, joint_forces=forces)


_CHAINS = (
    ("slide_a", "hinge_a", "leg_a_tip", "platform_a"),
    ("slide_b", "hinge_b", "leg_b_tip", "platform_b"),
    ("slide_c", "hinge_left", "hinge_lower", "hinge_platform"),
)
"""Of each leg: its guideway, both ends of its rod, and where it meets the platform."""
_TILT, _ARM = "hinge_c", "hinge_platform"
_HOPELESS = 1e-3
"""Share of a leg's length by which it may be too short before the assembly is not even tried."""
_CLEAR = 1e-3
"""Sine of the angle from the actuation singularity from which on there is no doubt."""
_HORIZONTAL = 1e-6
"""Share of a leg's length up to which its margin is taken for the reason why the loops do not close."""


class Gate:
    """Margins of one machine, from its model."""

    def __init__(self, loop: ClosedLoopModel) -> None:
        model, data = loop.model, loop.model.createData()
        neutral = pin.neutral(model)
        pin.computeJointJacobians(model, data, neutral)
        pin.updateFramePlacements(model, data)

        def place(name: str) -> FloatArray:
            return np.array(data.oMf[model.getFrameId(name)].translation)

        home = data.oMf[model.getFrameId(PLATFORM)]
        self._guides = np.array([place(slide) for slide, *_ in _CHAINS])
        columns = [model.idx_vs[model.getJointId(slide)] for slide, *_ in _CHAINS]
        self._axes = np.array([data.J[:3, column] for column in columns])
        self._lengths = np.array([np.linalg.norm(place(tip) - place(root)) for _, root, tip, _ in _CHAINS])
        self._points = np.array([home.actInv(place(point)) for *_, point in _CHAINS])
        self._arm = float(np.linalg.norm(place(_ARM) - home.translation))
        rod = place(_CHAINS[2][2]) - place(_CHAINS[2][1])
        tilt = model.getJointId(_TILT)
        self.tilt, across = model.idx_qs[tilt], data.J[3:, model.idx_vs[tilt]]
        sideways, along = np.cross(across, rod), self._axes[2]
        size = np.linalg.norm(sideways)
        # The rod, turned by q about the cross-bar's axis, has cos q rod + sin q (axis × rod) along the guide.
        self._cosine, self._sine = -(rod @ along) / size, -(sideways @ along) / size

    def margins(self, targets: FrameTargets) -> FloatArray:
        """Return by how much the chain of each leg is longer than its way from the guideway, (N, 3) [m].

        Negative: too short, whatever the joints do.
        """
        points = targets.positions[:, None] + self._points @ np.swapaxes(targets.rotations, -1, -2)
        return np.asarray(
            self._lengths - np.linalg.norm(np.cross(points - self._guides, self._axes), axis=-1)
        )

    def hopeless(self, margins: FloatArray) -> NDArray[np.bool_]:
        """Whether a chain is so much too short that closing the loops need not be tried, (N,)."""
        return np.asarray((margins < -_HOPELESS * self._lengths).any(axis=-1))

    def horizontal(self, margins: FloatArray) -> NDArray[np.bool_]:
        """Whether a chain is too short, or nearly so, (N,)."""
        return np.asarray((margins < _HORIZONTAL * self._lengths).any(axis=-1))

    def actuation(self, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the angle α of (1), (N,) [rad], positive on home's side: from the tilt and ∂λC/∂θ."""
        return np.asarray(np.arcsin(np.clip(self.sine(angle, rate), -1, 1)))

    def sine(self, angle: Any, rate: Any, of: Any = np) -> Any:
        """Return sin α of (1)."""
        return rate * (self._cosine * of.cos(angle) + self._sine * of.sin(angle)) / self._arm


class Verdict:
    """What is known of the samples of a batch, and the error for those that are invalid."""

    def __init__(self, gate: Gate, pose: FloatArray, depth: float) -> None:
        self._gate, self._pose, self._depth = gate, pose, depth
        self.margins = np.full(pose.shape, np.nan)
        self.actuation = np.full(len(pose), np.nan)
        self.unreached, self.singular = np.zeros((2, len(pose)), dtype=bool)
        self.errors: dict[int, P3dofError] = {}

    def try_rows(self, rows: NDArray[np.int_]) -> NDArray[np.int_]:
        """Return which of some samples are worth assembling; the others are out of reach."""
        self.margins[rows] = self._gate.margins(targets_of(self._pose[rows], self._depth))
        hopeless = self._gate.hopeless(self.margins[rows])
        self.unreached[rows[hopeless]] = True
        return np.asarray(rows[~hopeless])

    def not_assembled(self, errors: Mapping[int, P3dofError]) -> None:
        """Enter samples that do not assemble: out of reach where a leg has no margin."""
        for i, error in errors.items():
            if self._gate.horizontal(self.margins[i : i + 1])[0]:
                self.unreached[i] = True
            else:
                self.errors[i] = error

    def hold(self, rows: NDArray[np.int_], q: FloatArray, inverse_jacobian: FloatArray) -> NDArray[np.bool_]:
        """Return which of some assembled samples the sliders can hold."""
        self.actuation[rows] = self._gate.actuation(q[:, self._gate.tilt], inverse_jacobian[:, 2, 2])
        self.singular[rows] = ~(np.abs(self.actuation[rows]) >= ACTUATION_TOLERANCE)
        return ~self.singular[rows]

    def tell(self, shape: tuple[int, ...], complete: bool) -> None:
        """Raise for the first invalid sample, if there is one."""
        pose = self._pose.reshape(*shape, 3)
        margins, actuation = self.margins.reshape(*shape, 3), self.actuation.reshape(shape)
        raise_out_of_reach(pose, self.unreached.reshape(shape), margins, complete)
        raise_singular(pose, self.singular.reshape(shape), actuation, complete)
        if self.errors:
            sample = min(self.errors)
            index = tuple(int(i) for i in np.unravel_index(sample, shape)) if shape else ()
            error = self.errors[sample]
            kind = SingularityError if isinstance(error, SingularityError) else SampleError
            where = index[0] if len(index) == 1 else index
            words = f"sample {where}: {error}" if index else str(error)
            raise kind(words, index, len(self.errors)) from error


MASK = (False, True, True, False, True, False)
"""What a pose prescribes of the platform's placement: y, z and the rotation about y0."""


class OneByPinocchio:
    """One plain sample without what batches take; doors as `OneSample` has them, None for all else."""

    def __init__(self, direct: Own[_Direct]) -> None:
        self._direct = direct

    def forces(self, out: Any, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces (3,) [N] at a pose, velocity and acceleration."""
        if out is not None or wrench is not None or on_invalid not in POLICIES:
            return None
        rows = [_three_numbers(row) for row in (q, v, a)]
        if not all(rows):
            return None
        found = self._direct.here.one(*rows)
        return None if found is None else np.array(found)

    def accelerate(self, *_: Any) -> None:
        """Nothing: a batch answers."""

    jacobian = mass_matrix = derivatives = sliders = poses = accelerate


def _three_numbers(row: Any) -> list[float]:
    """Return a plain row of three finite numbers, else nothing."""
    if type(row) is np.ndarray:
        plain = row.dtype == np.float64 and row.shape == (3,)
        row = row.tolist() if plain else []
    elif not (type(row) in (list, tuple) and len(row) == 3 and all(type(x) is float for x in row)):
        return []
    return list(row) if row and math.isfinite(sum(row)) else []


class PinocchioMethod:
    """Forces and equations of motion by Pinocchio; doors as `DynamicsMethod` has them."""

    def __init__(self, parameters: Parameters, loop: ClosedLoopModel) -> None:
        loop = bare(loop)
        self._loop, self._depth = loop, parameters.geometry.h
        self._acting = JointForces(loop, parameters)
        self._gate = Gate(loop)
        self._data = Own(loop.model.createData)
        self._frame = loop.model.getFrameId(PLATFORM)
        self._direct = Own(lambda: _Direct(loop, self._depth, self._acting, self._gate))
        self.one = OneByPinocchio(self._direct)

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""
        return written(self.solve(states).forces.reshape(states.pose.shape), out)

    def solve(self, states: States, progress: Progress | None = None) -> Solution:
        """Return forces, joints and evidence at N samples; of a batch of another shape, row by row."""
        shape, rows = states.shape, states.finite().rows()
        pose, count, nv = rows.pose, len(rows.pose), self._loop.model.nv
        joints, forces, evidence = np.full((3, count, nv), np.nan), *np.full((2, count, 3), np.nan)
        finite = np.asarray(np.isfinite(_acting_on(pose, rows.wrench)).all(axis=1))
        verdict = self._verdict(pose)
        solver, direct = _Solver(self._loop, self._depth, self._acting, verdict), self._direct.here
        for block in blocks(count, BLOCK):
            if progress is not None:
                progress(int(block[0]), count)
            left = block[finite[block]]
            for solve in (direct.together, solver.together):
                if len(left):
                    found = solve(left, *_parts(rows, left))
                    joints[:, found.rows], forces[found.rows] = found.joints, found.forces
                    evidence[found.rows], verdict.actuation[found.rows] = found.evidence, found.actuation
                    left = np.setdiff1d(left, found.rows)
            if states.on_invalid == "raise":
                verdict.tell(shape, int(block[-1]) + 1 == count)
        if progress is not None:
            progress(count, count)
        gap, energy, lost = np.ascontiguousarray(evidence.T)
        return Solution(
            forces=forces,
            joints=JointStates(tuple(self._loop.model.names[1:]), *joints),
            closure_error=gap,
            energy_rate=energy,
            dissipation=lost,
            actuation=np.where(np.isfinite(forces).all(axis=1), verdict.actuation, np.nan),
        )

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration (..., 3) of the platform, by constrained dynamics of all joints."""
        rows = states.finite().rows()
        pose, velocity, forces, wrench = rows.pose, rows.velocity, rows.forces, rows.wrench
        loop, result, guess = self._loop, np.full(pose.shape, np.nan), None
        finite = np.asarray(np.isfinite(_acting_on(pose, wrench)).all(axis=1))
        verdict = self._verdict(pose)
        for i in verdict.try_rows(np.flatnonzero(finite)).tolist():
            try:
                state = complete_near(loop, target_of(pose[i], self._depth), velocity[i], np.zeros(3), guess)
            except AssemblyError as error:
                verdict.not_assembled({i: error})
                continue
            if not state.same_assembly:
                verdict.not_assembled({i: _left_assembly()})
                continue
            guess = state.q
            lost = self._acting.at(state.q, state.v)
            external = lost.external_with(None if wrench is None else wrench[i])
            a = loop.forward_dynamics(state.q, state.v, forces[i], external, lost.joint_forces).a
            result[i] = self._platform_acceleration(state.q, state.v, a)
        if states.on_invalid == "raise":
            verdict.tell(states.shape, True)
        return written(result.reshape(states.pose.shape), out)

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3): rows of the influence matrix of the closed loops."""
        _, influence = self._assembled(states)
        return written(influence[:, self._loop.actuated_v].reshape(*states.shape, 3, 3), out)

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3).

        It is Gᵀ M G: M of the tree, by CRBA, G the influence matrix of the closed loops.
        """
        q, G = self._assembled(states)
        model, data, nv = self._loop.model, self._data.here, self._loop.model.nv
        M = np.full((len(q), nv, nv), np.nan)
        for i in np.flatnonzero(np.isfinite(q).all(axis=1)).tolist():
            M[i] = np.triu(pin.crba(model, data, q[i]))
        M += np.swapaxes(np.triu(M, 1), -1, -2)  # CRBA fills the upper half
        found = np.swapaxes(G, -1, -2) @ M @ G
        return written(((found + np.swapaxes(found, -1, -2)) / 2).reshape(*states.shape, 3, 3), out)

    def _assembled(self, states: States) -> tuple[FloatArray, FloatArray]:
        """Return configurations (N, nq) at poses, and joint speeds per unit ẏ, ż, θ̇ (N, nv, 3)."""
        loop, pose = self._loop, states.finite().rows().pose
        q = np.full((len(pose), loop.model.nq), np.nan)
        G = np.full((len(pose), loop.model.nv, 3), np.nan)
        finite, near = np.asarray(np.isfinite(pose).all(axis=1)), None
        verdict = self._verdict(pose)
        for start in range(0, len(pose), BLOCK):
            i = verdict.try_rows(start + np.flatnonzero(finite[start : start + BLOCK]))
            rest = np.zeros((len(i), 3))
            found = loop.complete_batch(targets_of(pose[i], self._depth), rest, rest, near=near)
            known = np.isfinite(found.q).all(axis=1)
            errors = {int(i[k]): error for k, error in found.errors.items()}
            errors.update((int(k), _left_assembly()) for k in i[known & ~found.same_assembly])
            verdict.not_assembled(errors)
            known &= found.same_assembly
            q[i[known]], G[i[known]] = found.q[known], found.influence[known]
            near = found.q[known][-1] if known.any() else near
            if states.on_invalid == "raise":
                verdict.tell(states.shape, start + BLOCK >= len(pose))
        return q, G

    def _verdict(self, pose: FloatArray) -> Verdict:
        return Verdict(self._gate, pose, self._depth)

    def _platform_acceleration(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return ÿ, z̈ and θ̈ of a motion of all joints."""
        model, data = self._loop.model, self._data.here
        pin.forwardKinematics(model, data, q, v, a)
        pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameClassicalAcceleration(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        return np.array((moving.linear[1], moving.linear[2], moving.angular[1]))


def _parts(rows: States, which: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Return pose, velocity, acceleration and wrench of some rows."""
    wrench = None if rows.wrench is None else rows.wrench[which]
    return rows.pose[which], rows.velocity[which], rows.acceleration[which], wrench


def _acting_on(pose: FloatArray, wrench: FloatArray | None) -> FloatArray:
    """Return what must be finite for a sample to be tried; all other numbers are where the pose is."""
    return pose if wrench is None else np.concatenate((pose, wrench), axis=1)


class _Part(NamedTuple):
    """Samples that have forces."""

    rows: IndexArray
    joints: FloatArray  # (3, n, nv): q, v, a
    forces: FloatArray  # (n, 3)
    evidence: FloatArray  # (n, 3): gap, rate of change of the energy, and losses
    actuation: FloatArray  # (n,): angles from the singularity


class _Direct:
    """Solves samples by straight-line functions from home; those that are doubtful it leaves."""

    def __init__(self, loop: ClosedLoopModel, depth: float, acting: JointForces, gate: Gate) -> None:
        def goal(y: Number, z: Number, c: Number, s: Number) -> tuple[Vector, list[Vector]]:
            return (0.0, y, z - depth), [(c, 0.0, -s), (0.0, 1.0, 0.0), (s, 0.0, c)]

        self._loops = TracedLoops(loop.model, loop.sidecar, loop.reference, PLATFORM, MASK, goal, 4)
        self._loop, self._acting, self._gate = loop, acting, gate
        self._data, self._nv = loop.model.createData(), loop.model.nv
        actuated = [int(k) for k in loop.actuated_v]
        self._turning = 2 * self._nv + actuated[2]
        """Where ∂λC/∂θ is in the influence."""
        if self._loops.usable:
            self._drive = self._loops.drives(actuated)

    def one(
        self, pose: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float]
    ) -> tuple[float, ...] | None:
        """Return the forces of one sample."""
        turned = float(np.cos(pose[2])), float(np.sin(pose[2]))
        closed = (
            self._loops.one((pose[0], pose[1], *turned), velocity, acceleration)
            if self._loops.usable
            else None
        )
        if closed is None:
            return None
        q, v, a = closed.q, np.array(closed.v), np.array(closed.a)
        if (
            not abs(self._gate.sine(float(q[self._gate.tilt]), closed.influence[self._turning], math))
            >= _CLEAR
        ):
            return None
        f = pin.rnea(self._loop.model, self._data, q, v, a)
        lost = self._acting.at(q, v)
        if lost.external:
            loads = self._loops.loads(tuple(lost.external))
            f -= loads(*closed.numbers, *(x for wrench in lost.external.values() for x in wrench.tolist()))
        found: tuple[float, ...] = self._drive(*closed.influence, *(f - lost.joint_forces).tolist())
        return found if math.isfinite(sum(found)) else None

    def together(
        self,
        rows: IndexArray,
        pose: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        wrench: FloatArray | None,
    ) -> _Part:
        """Solve many samples at once."""
        if not self._loops.usable:
            none = np.zeros((0, 3))
            return _Part(rows[:0], np.zeros((3, 0, self._nv)), none, none, np.zeros(0))
        model, loops, count = self._loop.model, self._loops, len(rows)
        with np.errstate(all="ignore"):  # what is not a number passes no test
            target = pose[:, 0], pose[:, 1], np.cos(pose[:, 2]), np.sin(pose[:, 2])
            closed = loops.many(tuple(map(np.ascontiguousarray, target)), velocity, acceleration)
            q, (v, a) = closed.q, (columns_of(values, count) for values in (closed.v, closed.a))
            actuation = self._gate.actuation(q[:, self._gate.tilt], closed.influence[self._turning])
            lost = self._acting.over(q, v)
            external = lost.external_with(wrench)
            f = np.ascontiguousarray(pin.rneaInParallel(1, pin.ModelPool(model, 1), q.T, v.T, a.T))
            f = f.reshape(self._nv, count)  # a vector, for one sample
            f -= np.transpose(np.broadcast_to(lost.joint_forces, q.shape))
            if external:
                parts = (column for load in external.values() for column in np.ascontiguousarray(load.T))
                f -= columns_of(loops.loads(tuple(external))(*closed.numbers, *parts), count).T
            forces = columns_of(self._drive(*closed.influence, *f), count)
            energy = loops.power(*closed.numbers, *closed.v, *closed.a)[0] + self._acting.stored_power(q, v)
            good = closed.good & (np.abs(np.sin(actuation)) >= _CLEAR) & np.isfinite(forces).all(axis=1)
        evidence = columns_of((closed.gap, energy, lost.power), count)
        return _Part(rows[good], np.array((q, v, a))[:, good], forces[good], evidence[good], actuation[good])


class _Solver:
    """Solves samples by the general way, and remembers where the last of them was."""

    def __init__(self, loop: ClosedLoopModel, depth: float, acting: JointForces, verdict: Verdict) -> None:
        self._loop, self._depth, self._acting, self._verdict = loop, depth, acting, verdict
        self._near: FloatArray | None = None

    def together(
        self,
        rows: IndexArray,
        pose: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        wrench: FloatArray | None,
    ) -> _Part:
        """Solve many samples at once."""
        tried = np.isin(rows, self._verdict.try_rows(rows))
        pose, velocity, acceleration = pose[tried], velocity[tried], acceleration[tried]
        rows, wrench = rows[tried], None if wrench is None else wrench[tried]
        loop, targets = self._loop, targets_of(pose, self._depth)
        motion = loop.complete_batch(targets, velocity, acceleration, near=self._near)
        errors = {int(rows[i]): error for i, error in motion.errors.items()}
        known = np.isfinite(motion.q).all(axis=1)
        errors.update((int(i), _left_assembly()) for i in rows[known & ~motion.same_assembly])
        self._verdict.not_assembled(errors)
        known &= motion.same_assembly
        known[known] = self._verdict.hold(rows[known], motion.q[known], motion.inverse_jacobian[known])
        rows, q, v, a = rows[known], motion.q[known], motion.v[known], motion.a[known]
        lost = self._acting.over(q, v)
        external = lost.external_with(None if wrench is None else wrench[known])
        found = loop.inverse_dynamics_batch(q, v, a, external, lost.joint_forces)
        self._verdict.errors.update((int(rows[i]), error) for i, error in found.errors.items())
        held = np.isfinite(found.tau).all(axis=1)
        joints = np.array((q[held], v[held], a[held]))
        if held.any():
            self._near = joints[0, -1]
        gaps, losses = _gaps(found.closure_error[held]), np.asarray(lost.power)[held]
        energy = loop.power_batch(*joints) + self._acting.stored_power(joints[0], joints[1])
        evidence = np.column_stack((gaps, energy, losses))
        rows = rows[held]
        return _Part(rows, joints, found.tau[held], evidence, self._verdict.actuation[rows])


def _left_assembly() -> AssemblyError:
    return AssemblyError("the loops close only on another assembly than that of home")


def _gaps(errors: FloatArray) -> FloatArray:
    """Return the largest gap from closure errors (..., 9)."""
    return np.asarray(np.linalg.norm(errors.reshape(*errors.shape[:-1], 3, 3), axis=-1).max(axis=-1))


def complete(
    loop: ClosedLoopModel, depth: float, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> State:
    """Return the whole tree's motion for one state of the platform, assembled from home."""
    return loop.complete(target_of(pose, depth), velocity, acceleration)


def targets_of(pose: FloatArray, depth: float) -> FrameTargets:
    """Return the frame targets of poses: P at (0, y, z - h), turned by θ about y0."""
    y, z, theta = pose.T
    c, s, none, one = np.cos(theta), np.sin(theta), np.zeros(len(pose)), np.ones(len(pose))
    rotations = np.column_stack((c, none, s, none, one, none, -s, none, c)).reshape(-1, 3, 3)
    return FrameTargets(PLATFORM, np.column_stack((none, y, z - depth)), rotations, MASK)


def target_of(pose: FloatArray, depth: float) -> FrameTarget:
    """Return the frame target of a pose: P at (0, y, z - h), turned by θ about y0."""
    y, z, theta = (float(value) for value in pose)
    rotation = pin.utils.rotate("y", theta)
    return FrameTarget(PLATFORM, pin.SE3(rotation, np.array([0.0, y, z - depth])), MASK)
