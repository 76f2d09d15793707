"""Forces of the actuators as linear functions of parameters: what identification needs of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, positive, shown
from p3dof._base.errors import AssemblyError, InputError, ModelError
from p3dof.loops.assembly import Limits
from p3dof.loops.compiled.kept import Method
from p3dof.loops.coordinates import length_coordinates
from p3dof.loops.minimal import coordinate_names
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.regressor import MOMENTS
from p3dof.loops.sidecar import SMOOTHING, JointData

MASS, SHIFT, OTHER = 0.1, 5e-3, 0.1
"""Standard deviations about a design by default: shares of masses and other parameters; mass centres [m]."""
COULOMB, VISCOUS = 0.01, 0.05
"""The same of the actuators' friction, as shares of their largest forces; viscous at their largest speed."""
_FIELDS = {
    "armature": "",
    "damping": "damping",
    "friction": "friction",
    "stiffness": "stiffness",
    "preload": "force",
}
"""What of `JointData` has the parameters of a joint."""
_FREE_SPEED, _FREE_RANGE = 1.0, 0.5
"""Largest speed and way of an actuator without limits [per second; rad, or share of the unit of length]."""
_SEEN, _IDLE = 1e-6, 1e-3
"""Share of a motion that actuators see; share of the largest inertial forces above which they feel one."""
LEAST_MARGIN = 0.05
"""Least singularity margin of actuation."""


class States(NamedTuple):
    """States of a motion whose loops are closed."""

    positions: FloatArray  # (N, m) of the actuators [m or rad]; their derivatives likewise
    velocities: FloatArray
    accelerations: FloatArray
    whole: Any
    """What `rows` needs: (q, v, a) of a robot, states of the platform of the machine."""


class Rows(NamedTuple):
    """Forces = columns @ parameters + known."""

    columns: FloatArray  # (N, m, P): derivatives of the actuators' forces by the parameters
    known: FloatArray  # (N, m): what no parameter changes [N or N m]


@runtime_checkable
class IdentifiableForces(Protocol):
    """What identification needs of a robot or machine: `LoopForces`, `MachineForces`."""

    actuators: tuple[str, ...]  # m names, in the order of the forces
    position_units: tuple[str, ...]  # "m" or "rad", of each actuator
    force_units: tuple[str, ...]  # "N" or "N m"
    coordinates: tuple[str, ...]  # n names: what excitation motions move
    coordinate_units: tuple[str, ...]
    home: FloatArray  # (n,): where excitation motions begin by default
    names: tuple[str, ...]  # of the P parameters
    design: FloatArray  # (P,): their values in the design

    def deviations(
        self,
        mass: float = ...,
        shift: float = ...,
        other: float = ...,
        coulomb: float = ...,
        viscous: float = ...,
    ) -> FloatArray:
        """Return the prior: standard deviations (P,) about the design; zero keeps a parameter."""

    def from_actuators(self, positions: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at positions, velocities and accelerations (N, m) of the actuators."""

    def from_coordinates(self, values: ArrayLike, rates: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at values (N, n) of the coordinates and their derivatives."""

    def rows(self, states: States) -> Rows:
        """Return the forces as functions of the parameters."""

    def excess(self, states: States, rows: Rows | None = None) -> FloatArray:
        """Return by how much limits are exceeded, each over its size, (N, K): at most zero within."""

    limits: tuple[str, ...]  # K names of what `excess` has

    @property
    def largest(self) -> tuple[FloatArray, FloatArray]:
        """Largest forces and speeds (m,) of the actuators."""

    def corrected(self, parameters: ArrayLike) -> Any:
        """Return the same robot or machine with these parameters (P,)."""


def prior_deviations(
    names: Sequence[str],
    parameters: ArrayLike,
    mass: float = MASS,
    shift: float = SHIFT,
    other: float = OTHER,
) -> FloatArray:
    """Return how uncertain the inertial parameters of a design are, as standard deviations.

    Parameters
    ----------
    names : sequence of str
        ``body.m``, ``body.mx`` and so on, ten a body in the order of Pinocchio, as
        `ForceRegressor.inertial_names` and `LoopRegressor.parameter_names`; other names are those of joints.
    parameters : array-like, shape (P,)
        Of the design.
    mass : float
        Of masses, as a share of them; of inertias too.
    shift : float
        Of mass centres, in every direction [m].
    other : float
        Of all other parameters, as a share of them.

    Returns
    -------
    ndarray, shape (P,)
        Zero keeps a parameter as it is: masses of nothing, and other parameters that are zero.

    Raises
    ------
    InputError
        If an argument does not fit.
    """
    values = frozen_array("parameters", parameters, (len(names),))
    share, way, rest = (
        positive(name, one, InputError)
        for name, one in zip(("mass", "shift", "other"), (mass, shift, other), strict=True)
    )
    found: FloatArray = rest * np.abs(values)
    for first in bodies_of(names):
        m, moments, six = values[first], values[first + 1 : first + 4], values[first + 4 : first + 10]
        size = max(float(six[0] + six[2] + six[5]) / 2, 0.0)  # about a point: of all its mass
        found[first] = share * m
        found[first + 1 : first + 4] = np.hypot(share * moments, way * m)
        found[first + 4 : first + 10] = np.hypot(share * size, 2 * way * np.sqrt(max(m * size, 0.0)))
    return found


def bodies_of(names: Sequence[str]) -> list[int]:
    """Return where the ten inertial parameters of each body begin."""
    kinds = [str(name).rpartition(".")[2] for name in names]
    found, first = [], 0
    while first < len(kinds):
        if kinds[first] != "m":
            first += 1
            continue
        if tuple(kinds[first : first + 10]) != MOMENTS:
            raise InputError(f"names: expected {', '.join(MOMENTS)} of a body from {names[first]!r} on")
        found.append(first)
        first += 10
    return found


class LoopForces:
    """Forces of any closed-loop robot whose actuators determine its motion.

    Parameters
    ----------
    robot : ClosedLoopModel
        Of the design. Its parameters are those of `LoopRegressor`.
    method : {"general", "compiled"} or CompiledLoop
        What closes the loops, see `ClosedLoopModel`.

    Raises
    ------
    ModelError
        If the robot has no actuator, or its actuators do not determine the motion.
    """

    def __init__(self, robot: ClosedLoopModel, method: Method = "general") -> None:
        self._robot, self._method, model = robot, method, robot.model
        home = robot.assemble().q
        if not robot.actuated or _idle_felt(robot, home):
            raise ModelError(
                f"{model.name}: {len(robot.actuated)} actuators do not determine a motion with "
                f"{robot.mobility(home)} degrees of freedom; lock the others, or name more actuated joints"
            )
        self.actuators = self.coordinates = robot.actuated
        joints = [model.getJointId(name) for name in self.actuators]
        lengths = length_coordinates(model)[1]
        self.sliding = frozenset(np.array(coordinate_names(model))[lengths].tolist())  # freedoms by name
        slides = lengths[robot.actuated_v]
        self.position_units = self.coordinate_units = tuple("m" if s else "rad" for s in slides)
        self.force_units = tuple("N" if s else "N m" for s in slides)
        self._home, self._v = home, robot.actuated_v
        at = [model.idx_qs[joint] for joint in joints]
        self.home: FloatArray = np.array(
            [
                home[q] if model.nqs[j] == 1 else np.arctan2(home[q + 1], home[q])
                for q, j in zip(at, joints, strict=True)
            ]
        )
        self._limits = Limits(model)
        joints_within = tuple(f"position of {name}" for name in self._limits.names)
        self._passive = [
            joint
            for joint in range(1, model.njoints)
            if model.nvs[joint] == 1
            and model.idx_vs[joint] not in self._v
            and 0 < model.velocityLimit[model.idx_vs[joint]] < np.inf
        ]
        each = [f"{what} of {name}" for what in ("way", "speed", "force") for name in self.actuators]
        each += [f"speed of {model.names[joint]}" for joint in self._passive]
        self.limits: tuple[str, ...] = (*joints_within, *each, "singularity margin")
        rest = np.zeros(model.nv)
        at_rest = robot.force_regressor(home, rest, rest)
        self.names, self.design = at_rest.parameter_names, at_rest.parameters
        self._bodies = 10 * len(bodies_of(self.names))
        self._static = np.abs(at_rest.forces @ self.design + at_rest.external)

    @property
    def robot(self) -> ClosedLoopModel:
        """The robot as designed."""
        return self._robot

    @cached_property
    def largest(self) -> tuple[FloatArray, FloatArray]:
        """Largest forces and speeds (m,) of the actuators: the model's limits, or twice what holds it."""
        model = self._robot.model
        effort, speed = (np.array(x)[self._v] for x in (model.effortLimit, model.velocityLimit))
        free = 2 * np.where(self._static > 0, self._static, max(1.0, float(self._static.max(initial=0.0))))
        force: FloatArray = np.where(np.isfinite(effort) & (effort > 0), effort, free)
        fast: FloatArray = np.where(np.isfinite(speed) & (speed > 0), speed, _FREE_SPEED)
        return force, fast

    def deviations(
        self,
        mass: float = MASS,
        shift: float = SHIFT,
        other: float = OTHER,
        coulomb: float = COULOMB,
        viscous: float = VISCOUS,
    ) -> FloatArray:
        """Return the prior: standard deviations (P,) about the design; zero keeps a parameter.

        Parameters
        ----------
        mass, shift, other : float
            As in `prior_deviations`.
        coulomb, viscous : float
            Of friction in the actuated joints, as shares of their largest forces; viscous at largest speed.
        """
        found = prior_deviations(self.names, self.design, mass, shift, other)
        found[
            [
                not self._robot.model.existJointName(name.rpartition(".")[0]) and at >= self._bodies
                for at, name in enumerate(self.names)
            ]
        ] = 0.0  # of one freedom among several
        force, speed = self.largest
        for i, name in enumerate(self.actuators):
            for what, size in (("friction", coulomb * force[i]), ("damping", viscous * force[i] / speed[i])):
                at = self.names.index(f"{name}.{what}")
                found[at] = max(found[at], size)
        return found

    def from_actuators(self, positions: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at positions, velocities and accelerations (N, m) of the actuators.

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at a sample, or cannot move so.
        """
        shape = ("N", len(self.actuators))
        y = frozen_array("positions", positions, shape)
        v, a = (
            frozen_array(name, x, y.shape)
            for name, x in (("velocities", velocities), ("accelerations", accelerations))
        )
        found = self._robot.complete_batch(y, v, a, guess=self._home, stop=True, method=self._method)
        for sample, error in found.errors.items():
            raise AssemblyError(f"sample {sample}: {error}", getattr(error, "gap", np.nan)) from error
        if not found.same_assembly.all():
            other = int(np.argmin(found.same_assembly))
            raise AssemblyError(f"sample {other}: the loops close in another assembly mode")
        return States(y, v, a, (found.q, found.v, found.a))

    from_coordinates = from_actuators

    def rows(self, states: States) -> Rows:
        """Return the forces as functions of the parameters."""
        found = self._robot.force_regressor(*states.whole)
        return Rows(found.forces, found.external)

    def excess(self, states: States, rows: Rows | None = None) -> FloatArray:
        """Return by how much limits are exceeded, each over its size, (N, K): at most zero within.

        Positions of all joints with limits; the way of actuators without any from where they start; speeds
        and forces of the actuators, the design's, against `largest`; speeds of other joints with limits; the
        singularity margin of actuation.
        """
        (q, v, a), (force, speed) = states.whole, self.largest
        if rows is None:  # the same forces, and sooner
            tau = self._robot.inverse_dynamics_batch(q, v, a, method=self._method).tau
        else:
            tau = rows.columns @ self.design + rows.known
        low, high = self._limits.lower, self._limits.upper
        values = q[:, self._limits.q]
        bounded = np.isfinite(high - low) & (high - low < 1e6)
        half, middle = np.where(bounded, (high - low) / 2, 1.0), np.where(bounded, (high + low) / 2, 0.0)
        joints = np.where(bounded, np.abs(values - middle) / half - 1, -1.0)
        has = {name for name, one in zip(self._limits.names, bounded, strict=True) if one}
        room = np.array(
            [_FREE_RANGE * (self._robot.unit_of_length if u == "m" else 1.0) for u in self.position_units]
        )
        free = np.array([name not in has for name in self.actuators])
        way = np.where(free, np.abs(states.positions - self.home) / room - 1, -1.0)
        fast = np.abs(states.velocities) / speed - 1
        strong = np.abs(tau) / force - 1
        places = [self._robot.model.idx_vs[joint] for joint in self._passive]
        others = np.abs(v[:, places]) / self._robot.model.velocityLimit[places] - 1
        margin = self._robot.singularity_margins(q).actuation
        return np.column_stack([joints, way, fast, strong, others, 1 - margin / LEAST_MARGIN])

    def corrected(self, parameters: ArrayLike) -> ClosedLoopModel:
        """Return the robot with other parameters (P,).

        Raises
        ------
        InputError
            If a body would be impossible, or a parameter of a joint negative.
        """
        values = frozen_array("parameters", parameters, (len(self.names),))
        model = self._robot.model.copy()
        for i, first in zip(range(1, model.njoints), bodies_of(self.names), strict=True):
            if not np.array_equal(values[first : first + 10], self.design[first : first + 10]):
                require_possible(self.names[first].rpartition(".")[0], values[first : first + 10])
                model.inertias[i] = pin.Inertia.FromDynamicParameters(values[first : first + 10])
        changed = {entry.joint: entry for entry in self._robot.sidecar.joint_data}
        armature = np.array(model.armature)
        for name, old, new in zip(self.names, self.design.tolist(), values.tolist(), strict=True):
            joint, _, what = name.rpartition(".")
            if new == old or what in MOMENTS:
                continue
            if what not in _FIELDS or not model.existJointName(joint):
                raise InputError(f"parameters: {name} cannot be changed in the robot")
            entry = changed.get(joint, JointData(joint))
            if what == "armature":
                armature[model.idx_vs[model.getJointId(joint)]] = new
                rotor = min(entry.rotor_inertia, max(new, 0.0) / entry.gear_ratio**2)
                changed[joint] = replace(entry, rotor_inertia=rotor)
            else:
                changed[joint] = replace(entry, **{_FIELDS[what]: -new if what == "preload" else new})
        model.armature = armature
        return ClosedLoopModel(model, replace(self._robot.sidecar, joint_data=tuple(changed.values())))


def _idle_felt(robot: ClosedLoopModel, q: FloatArray) -> bool:
    """Return whether actuators feel what moves while they stand still; not a rod that spins between balls."""
    J = robot.closure_jacobian(q)
    N = np.linalg.svd(J)[2][robot.rank(q) :].T if J.size else np.eye(robot.model.nv)
    _, values, turned = np.linalg.svd(N[robot.actuated_v])
    seen = int(np.count_nonzero(values > _SEEN * values.max(initial=0.0)))
    if seen == N.shape[1]:
        return False
    rest = np.zeros(robot.model.nv)

    def inertial(way: FloatArray) -> float:
        there = robot.force_regressor(q, rest, way)
        return float(np.abs(there.forces @ there.parameters + there.external - held).max(initial=0.0))

    at_rest = robot.force_regressor(q, rest, rest)
    held = at_rest.forces @ at_rest.parameters + at_rest.external
    own = max(inertial(N @ turned[k]) for k in range(seen))
    return max(inertial(N @ turned[k]) for k in range(seen, N.shape[1])) > _IDLE * own


def pseudo_inertia(ten: FloatArray) -> FloatArray:
    """Return the pseudo-inertia (4, 4) of ten inertial parameters: positive definite if a body has them.

    P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
    parameter identification, IEEE Robotics and Automation Letters 3(1), 2018.
    """
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten
    half = (xx + yy + zz) / 2
    return np.array(
        [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]
    )


def require_possible(body: str, ten: FloatArray) -> None:
    """Raise if no body has these inertial parameters; a lamina is one, to rounding."""
    pseudo = pseudo_inertia(ten)
    own = np.diag(pseudo)
    scale = np.sqrt(np.maximum(own, max(1e-6 * own[:3].max(), np.finfo(float).tiny)))
    if np.linalg.eigvalsh(pseudo / np.outer(scale, scale)).min() < -1e-9:
        raise InputError(f"parameters: no body has the mass, mass centre and inertia of {body}")


EXTRAS = ("stribeck", "load_friction", "constant", "offset")
"""What `ExtendedForces` may add."""
_LOAD_FRICTION, _CONSTANT, _OFFSET_SHARE = 0.05, 0.05, 0.01
"""Standard deviations of these by default: two shares of the force, and a share of the largest force."""


class ExtendedForces:
    """Forces with what a model of bodies and simple friction lacks, at each actuator.

    With the speed v and the force f of the actuator, and ``s(v) = tanh(v / 0.001)``,

    - ``stribeck``: friction that falls as the joint begins to move, ``exp(-(v / v_s)²) s(v)`` [N or N m];
    - ``load_friction``: friction in proportion to the load, ``|f| s(v)``, as of screws and gears [-];
    - ``constant``: by what share the motor's constant is larger than was taken for the measured force [-];
    - ``offset``: of the measured force [N or N m].

    The second and third are not linear: f is that of the design, or `at` other parameters, as of an estimate
    before.

    Parameters
    ----------
    forces : LoopForces or MachineForces
        Of the robot or machine.
    extras : sequence of str
        Which of these.
    stribeck_speed : float
        v_s [m/s or rad/s].
    at : (P,) array, optional
        Parameters at which forces are taken, those of `forces` alone or with extras.

    Raises
    ------
    InputError
        If there is no such extra, or the speed is not positive.
    """

    def __init__(
        self,
        forces: IdentifiableForces,
        extras: Sequence[str] = EXTRAS,
        stribeck_speed: float = 0.01,
        at: ArrayLike | None = None,
    ) -> None:
        for name in extras:
            if name not in EXTRAS:
                raise InputError(f"extras: expected some of {', '.join(EXTRAS)}, got {shown(name)}")
        self._forces, self._extras = forces, tuple(dict.fromkeys(extras))
        self._speed = positive("stribeck_speed", stribeck_speed, InputError)
        own = len(forces.design)
        self.actuators, self.coordinates, self.home = forces.actuators, forces.coordinates, forces.home
        self.position_units, self.force_units = forces.position_units, forces.force_units
        self.coordinate_units, self.limits = forces.coordinate_units, forces.limits
        self.sliding: frozenset[str] = getattr(forces, "sliding", frozenset())
        added = tuple(f"{name}.{extra}" for extra in self._extras for name in forces.actuators)
        self.names: tuple[str, ...] = (*forces.names, *added)
        self.design: FloatArray = np.append(forces.design, np.zeros(len(added)))
        self._at = forces.design if at is None else frozen_array("at", at, np.shape(at))[:own]
        if self._at.shape != forces.design.shape:
            raise InputError(f"at: expected {own} parameters or more, got {len(self._at)}")
        self.largest = forces.largest

    def deviations(
        self,
        mass: float = MASS,
        shift: float = SHIFT,
        other: float = OTHER,
        coulomb: float = COULOMB,
        viscous: float = VISCOUS,
    ) -> FloatArray:
        """Return the prior: standard deviations about the design, as `LoopForces.deviations`."""
        force, _ = self.largest
        sizes = {
            "stribeck": coulomb * force,
            "load_friction": np.full_like(force, _LOAD_FRICTION),
            "constant": np.full_like(force, _CONSTANT),
            "offset": _OFFSET_SHARE * force,
        }
        own = self._forces.deviations(mass, shift, other, coulomb, viscous)
        return np.concatenate([own, *(sizes[extra] for extra in self._extras)])

    def from_actuators(self, positions: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at positions, velocities and accelerations (N, m) of the actuators."""
        return self._forces.from_actuators(positions, velocities, accelerations)

    def from_coordinates(self, values: ArrayLike, rates: ArrayLike, accelerations: ArrayLike) -> States:
        """Return the states at values (N, n) of the coordinates and their derivatives."""
        return self._forces.from_coordinates(values, rates, accelerations)

    def rows(self, states: States) -> Rows:
        """Return the forces as functions of the parameters."""
        own, v = self._forces.rows(states), states.velocities
        load, sign = own.columns @ self._at + own.known, np.tanh(v / SMOOTHING)
        kinds = {
            "stribeck": np.exp(-((v / self._speed) ** 2)) * sign,
            "load_friction": np.abs(load) * sign,
            "constant": -load,
            "offset": np.ones_like(v),
        }
        added = [kinds[extra][..., None] * np.eye(v.shape[1]) for extra in self._extras]
        return Rows(np.concatenate([own.columns, *added], axis=-1), own.known)

    def excess(self, states: States, rows: Rows | None = None) -> FloatArray:
        """Return by how much limits are exceeded, each over its size, (N, K): at most zero within."""
        own = len(self._forces.design)  # the extras of the design are zero
        bare = None if rows is None else rows._replace(columns=rows.columns[..., :own])
        return self._forces.excess(states, bare)

    def corrected(self, parameters: ArrayLike) -> Any:
        """Return the robot or machine with these parameters; the extras are none of it."""
        values = frozen_array("parameters", parameters, (len(self.names),))
        return self._forces.corrected(values[: len(self._forces.design)])
