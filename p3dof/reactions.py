"""Reactions in every joint of the manipulator over a motion: what its bearings and guides have to bear.

Thirteen joints: the ten of the tree, and the three where its loops were cut. How the cuts are built decides
which moments they transmit:

``"paper"``
    Legs A and B meet the platform in universal joints, with the leg's hinge axis and the platform's y axis;
    the right rod meets the lower cross-bar in a hinge. 13 components on 7 constraints: 6 are left open.
``"points"``
    The cuts are ball joints, as they are in the model. 9 components on 7 constraints: 2 are left open.

What is left open, rigid bodies do not tell: it depends on stiffness, play and assembly. Such components are
marked in every sample, and have the values that belong to the smallest forces at the cuts (see
`p3dof.closed_loop.reactions`). That is a choice, not an estimate: with ``"paper"``, for example, it lets the
left rod bear nearly all of the parallelogram's axial load, since only the right one ends in a cut. A bearing
that is sized by a marked number needs a look at what else its joint could bear.

Friction of the joints is part of their reactions, and lies along their freedoms.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof import kinematics
from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.reactions import BoolArray, ClosureJoint, JointReactions, ReactionSolver
from p3dof.errors import DynamicsError, InputError, SampleError
from p3dof.kinematics import OnInvalid
from p3dof.kinematics.states import holdable_states
from p3dof.motion import Motion
from p3dof.parameters import Parameters
from p3dof.routes import Solution, pinocchio_route, write_table
from p3dof.routes.friction import FrictionForces
from p3dof.routes.loads import WrenchOverTime, wrenches_at

Idealisation: TypeAlias = Literal["paper", "points"]
"""How the cuts of the loops are built."""
IDEALISATIONS: tuple[str, ...] = get_args(Idealisation)

_Y = (0.0, 1.0, 0.0)
_LEG, _ROD, _BALL = ClosureJoint.universal(_Y, _Y), ClosureJoint.revolute(_Y), ClosureJoint.ball()
_CUTS = {"paper": (_LEG, _LEG, _ROD), "points": (_BALL, _BALL, _BALL)}
_AXIS = {"y": _Y, "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Joint:
    """One of the thirteen joints.

    Parameters
    ----------
    name : str
        Its name.
    predecessor, successor : str
        Links that it joins; the reaction is what the predecessor exerts on the successor.
    frame : str
        Link or marker at whose origin and in whose axes the reaction is given.
    axis : str
        Which of these axes is the joint's: ``"y"``, or ``"z"`` for the slides. Of a universal joint it is
        the leg's; a ball joint has none.
    """

    name: str
    predecessor: str
    successor: str
    frame: str
    axis: str


JOINTS = (
    Joint("slide_a", "base_link", "slider_a", "slider_a", "z"),
    Joint("hinge_a", "slider_a", "leg_a", "leg_a", "y"),
    Joint("slide_b", "base_link", "slider_b", "slider_b", "z"),
    Joint("hinge_b", "slider_b", "leg_b", "leg_b", "y"),
    Joint("slide_c", "base_link", "slider_c", "slider_c", "z"),
    Joint("hinge_c", "slider_c", "crossbar_upper", "crossbar_upper", "y"),
    Joint("hinge_left", "crossbar_upper", "rod_left", "rod_left", "y"),
    Joint("hinge_lower", "rod_left", "crossbar_lower", "crossbar_lower", "y"),
    Joint("hinge_platform", "crossbar_lower", "platform", "platform", "y"),
    Joint("hinge_right", "crossbar_upper", "rod_right", "rod_right", "y"),
    Joint("loop_a", "leg_a", "platform", "leg_a_tip", "y"),
    Joint("loop_b", "leg_b", "platform", "leg_b_tip", "y"),
    Joint("loop_c", "rod_right", "crossbar_lower", "rod_right_tip", "y"),
)
"""The joints of the tree in Pinocchio's order, then the cuts."""


@dataclass(frozen=True, eq=False)
class JointReaction:
    """The reaction of one joint over the motion.

    Parameters
    ----------
    joint : Joint
        Which.
    axis : ndarray, shape (3,)
        Its axis; NaN if it has none.
    forces, moments : ndarray, shape (N, 3)
        What the predecessor exerts on the successor, at the origin and in the axes of the joint's frame
        [N, N m].
    determined_forces, determined_moments : ndarray of bool, shape (N, 3)
        Which components rigid bodies determine; False where the sample is invalid.
    """

    joint: Joint
    axis: FloatArray
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray


@dataclass(frozen=True)
class Peak:
    """The largest loads of one joint over the valid samples of a motion; NaN where it has no axis.

    Parameters
    ----------
    joint : str
        Its name.
    force, axial, radial : float
        Resultant force, its component along the joint's axis, and the one across [N].
    moment, across : float
        Resultant moment, and its component across the joint's axis [N m].
    rms_force, rms_moment : float
        Root mean squares over time of the resultants [N, N m].
    undetermined : tuple of str
        Which of these fields contain a component that rigid bodies do not determine.
    """

    joint: str
    force: float
    axial: float
    radial: float
    moment: float
    across: float
    rms_force: float
    rms_moment: float
    undetermined: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Reactions:
    """Reactions of all joints over a motion; ``result["hinge_a"]`` is one of them.

    Parameters
    ----------
    idealisation : str
        How the cuts are built, ``"paper"`` or ``"points"``.
    motion : Motion
        The motion of the platform.
    forces, moments : ndarray, shape (N, 13, 3)
        What the predecessor of each of `JOINTS` exerts on the successor, at the origin and in the axes of
        the joint's frame [N, N m]; NaN where a sample is invalid. Along a joint's freedoms lie the force of
        its actuator and its friction.
    determined_forces, determined_moments : ndarray of bool, shape (N, 13, 3)
        Which components rigid bodies determine; False where a sample is invalid.
    rotations : ndarray, shape (N, 13, 3, 3)
        Axes of the joints' frames, as columns, in the fixed frame.
    positions : ndarray, shape (N, 13, 3)
        Origins of the joints' frames in the fixed frame [m].
    undetermined : ndarray of int, shape (N,)
        How many independent changes of the reactions leave the motion as it is.
    residual : ndarray, shape (N,)
        Largest error of Newton's and Euler's equations [N or N m]: of every body, with the motion of its mass
        centre from the closed forms of `p3dof.kinematics`, and all reactions that act on it.
    """

    idealisation: str
    motion: Motion
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: NDArray[np.int_]
    residual: FloatArray

    def __repr__(self) -> str:
        worst = _largest(self.residual[self.valid])
        return f"Reactions({self.idealisation}, {self.motion!r}, residual {worst:.1e})"

    def __getitem__(self, name: str) -> JointReaction:
        if name not in self.joints:
            raise InputError(f"joint: expected one of {', '.join(self.joints)}, got {name!r}")
        i = self.joints.index(name)
        return JointReaction(
            JOINTS[i],
            self.axes[i],
            self.forces[:, i],
            self.moments[:, i],
            self.determined_forces[:, i],
            self.determined_moments[:, i],
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the thirteen joints."""
        return tuple(joint.name for joint in JOINTS)

    @property
    def axes(self) -> FloatArray:
        """Axis of each joint in its own frame, shape (13, 3); NaN for ball joints."""
        balls = self.idealisation == "points"
        return np.array(
            [(np.nan,) * 3 if balls and j.name.startswith("loop") else _AXIS[j.axis] for j in JOINTS]
        )

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""
        return self.motion.time

    @property
    def valid(self) -> BoolArray:
        """Which samples have reactions, shape (N,)."""
        return np.asarray(np.isfinite(self.forces).all(axis=(1, 2)))

    def in_base(self) -> tuple[FloatArray, FloatArray]:
        """Return forces and moments in the axes of the fixed frame, at the same points.

        Marks hold for the joints' own axes only: here a component mixes what is determined and what is not.

        Returns
        -------
        forces, moments : ndarray, shape (N, 13, 3)
            [N, N m].
        """
        forces, moments = (
            np.einsum("...ij,...j->...i", self.rotations, part) for part in (self.forces, self.moments)
        )
        return forces, moments

    def peaks(self) -> tuple[Peak, ...]:
        """Return the largest loads of every joint, for sizing its bearings.

        Returns
        -------
        tuple of Peak
            One for each of `JOINTS`.
        """
        return tuple(_peak(self[name], self.time, self.valid) for name in self.joints)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write time, all reactions and the residual to a CSV file, 17 significant digits.

        A component that is not determined in every sample is followed by a column that says where it is
        (1) and where not (0).

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        header, columns = ["t [s]"], [self.time]
        for name in self.joints:
            one = self[name]
            for kind, values, determined in (
                ("f{} [N]", one.forces, one.determined_forces),
                ("m{} [N m]", one.moments, one.determined_moments),
            ):
                for i, axis in enumerate("xyz"):
                    header.append(f"{name} {kind.format(axis)}")
                    columns.append(values[:, i])
                    if not determined[self.valid, i].all():
                        header.append(f"{name} {kind[0]}{axis} determined")
                        columns.append(determined[:, i].astype(float))
        return write_table(path, [*header, "residual"], (*columns, self.residual))


def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    joints: Idealisation = "paper",
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    progress: Callable[[int, int], None] | None = None,
) -> Reactions:
    """Return the reactions of all joints over a motion.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    parameters : Parameters
        The machine that it is a model of.
    motion : Motion
        The motion of the platform.
    joints : {"paper", "points"}
        How the cuts of the loops are built; see the module.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of time.
    on_invalid : {"raise", "nan"}
        Raise for samples that are out of reach or singular, or leave NaN in their rows.
    progress : callable, optional
        Called with (done, total) now and then.

    Returns
    -------
    Reactions

    Raises
    ------
    ReachError, SingularityError, SampleError
        Naming the first bad sample.
    InputError
        If the wrench does not fit, the idealisation is unknown, or `motion` is not a `Motion`.
    """
    _check_idealisation(joints)
    if not isinstance(motion, Motion):
        raise InputError(f"motion: expected a Motion, got {type(motion).__name__}")
    states = holdable_states(parameters, motion.pose, motion.velocity, motion.acceleration, on_invalid)
    loads = None if wrench is None else wrenches_at(motion.time, wrench, on_invalid)
    solution = pinocchio_route.solve(
        loop, parameters.geometry.h, *states, loads, parameters.friction, on_invalid, progress
    )
    return of_solution(loop, parameters, motion, solution, joints, loads, on_invalid)


def of_solution(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    solution: Solution,
    joints: Idealisation = "paper",
    wrench: FloatArray | None = None,
    on_invalid: OnInvalid = "raise",
) -> Reactions:
    """Return the reactions that belong to actuator forces and joint states already found.

    Parameters
    ----------
    loop, parameters, motion, joints, on_invalid
        As for `over_motion`.
    solution : Solution
        Actuator forces and joints of the motion; rows of NaN are left out.
    wrench : ndarray, shape (N, 6), optional
        External force and moment on the platform at P [N, N m].

    Returns
    -------
    Reactions

    Raises
    ------
    SampleError
        If the forces of a sample do not produce its motion.
    InputError
        If the idealisation is unknown.
    """
    _check_idealisation(joints)
    solver, friction = ReactionSolver(loop, _CUTS[joints]), FrictionForces(loop, parameters.friction)
    found: list[JointReactions | None] = []
    for i, forces in enumerate(solution.forces):
        q, v, a = (part[i] for part in (solution.joints.q, solution.joints.v, solution.joints.a))
        if not np.isfinite([*forces, *q]).all():
            found.append(None)
            continue
        lost = friction.at(q, v)
        external = lost.external if wrench is None else {pinocchio_route.PLATFORM: wrench[i], **lost.external}
        try:
            one = solver.solve(q, v, a, forces, external, lost.joint_forces)
        except DynamicsError as error:
            if on_invalid == "raise":
                raise SampleError(f"sample {i}: {error}", (i,)) from error
            found.append(None)
            continue
        found.append(_with_friction_in_cuts(loop, one, lost.external))
    arrays = _stacked(found)
    names = "forces", "moments", "rotations", "positions"
    residual = _residual(parameters, motion, wrench, *(arrays[name] for name in names))
    return Reactions(joints, motion, **arrays, residual=residual)


def _check_idealisation(joints: str) -> None:
    if joints not in IDEALISATIONS:
        raise InputError(f"joints: expected {' or '.join(map(repr, IDEALISATIONS))}, got {joints!r}")


def _with_friction_in_cuts(
    loop: ClosedLoopModel, one: JointReactions, external: Mapping[str, FloatArray]
) -> JointReactions:
    """Return reactions whose cuts contain the friction there, which acts as a pair of external wrenches."""
    first = len(one.names) - len(loop.sidecar.closures)
    moments = one.moments.copy()
    for c, closure in enumerate(loop.sidecar.closures, first):
        if closure.frame2 in external:
            moments[c] += one.rotations[c].T @ external[closure.frame2][3:]
    return replace(one, moments=moments)


def _stacked(found: list[JointReactions | None]) -> dict[str, Any]:
    """Return the samples' arrays as arrays over the samples: NaN, False or 0 where there is none."""
    shape = (len(found), len(JOINTS), 3)
    arrays = {
        "forces": np.full(shape, np.nan),
        "moments": np.full(shape, np.nan),
        "determined_forces": np.zeros(shape, dtype=bool),
        "determined_moments": np.zeros(shape, dtype=bool),
        "rotations": np.full((*shape, 3), np.nan),
        "positions": np.full(shape, np.nan),
        "undetermined": np.zeros(len(found), dtype=int),
    }
    for i, one in enumerate(found):
        if one is not None:
            for name, array in arrays.items():
                array[i] = getattr(one, name)
    return arrays


def _residual(
    parameters: Parameters,
    motion: Motion,
    wrench: FloatArray | None,
    forces: FloatArray,
    moments: FloatArray,
    rotations: FloatArray,
    positions: FloatArray,
) -> FloatArray:
    """Return the largest error of Newton's and Euler's equations of all bodies, shape (N,)."""
    forces, moments = (np.einsum("...ij,...j->...i", rotations, part) for part in (forces, moments))
    states = motion.pose, motion.velocity, motion.acceleration
    moving = kinematics.mechanism_motion(parameters.geometry, *states, on_invalid="nan").bodies
    worst: FloatArray = np.zeros(len(motion))
    for link, body in parameters.bodies.items():
        its = moving[link]
        centre, _, acceleration = its.at(body.com)
        inertia = its.rotation @ body.inertia @ np.swapaxes(its.rotation, -1, -2)
        spin = np.einsum("...ij,...j->...i", inertia, its.omega)
        force = body.mass * (parameters.gravity - acceleration)
        moment = -np.einsum("...ij,...j->...i", inertia, its.epsilon) - np.cross(its.omega, spin)
        for i, joint in enumerate(JOINTS):
            sign = (joint.successor == link) - (joint.predecessor == link)
            if sign:
                force = force + sign * forces[:, i]
                moment = moment + sign * (moments[:, i] + np.cross(positions[:, i] - centre, forces[:, i]))
        if link == "platform" and wrench is not None:  # its frame is at P
            force = force + wrench[:, :3]
            moment = moment + wrench[:, 3:] + np.cross(its.origin - centre, wrench[:, :3])
        worst = np.maximum(worst, np.abs(np.hstack([force, moment])).max(axis=-1))
    return worst


def _peak(one: JointReaction, time: FloatArray, valid: BoolArray) -> Peak:
    """Return the largest loads of a joint; NaN if no sample is valid."""
    forces, moments, axis = one.forces[valid], one.moments[valid], one.axis
    free_forces, free_moments = (
        ~np.all(part[valid], axis=0) for part in (one.determined_forces, one.determined_moments)
    )
    along, across = axis != 0, axis == 0  # NaN is along: what has no axis is NaN itself
    force, moment = np.linalg.norm(forces, axis=-1), np.linalg.norm(moments, axis=-1)
    marks = {
        "force": free_forces.any(),
        "axial": free_forces[along].any(),
        "radial": free_forces[across].any(),
        "moment": free_moments.any(),
        "across": free_moments[across].any(),
        "rms_force": free_forces.any(),
        "rms_moment": free_moments.any(),
    }
    values = {
        "force": _largest(force),
        "axial": _largest(forces @ axis),
        "radial": _largest(np.linalg.norm(forces - np.outer(forces @ axis, axis), axis=-1)),
        "moment": _largest(moment),
        "across": _largest(np.linalg.norm(moments - np.outer(moments @ axis, axis), axis=-1)),
        "rms_force": _rms(time[valid], force),
        "rms_moment": _rms(time[valid], moment),
    }
    open_ = tuple(name for name, mark in marks.items() if mark and np.isfinite(values[name]))
    return Peak(one.joint.name, **values, undetermined=open_)


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max()) if len(values) else float("nan")


def _rms(time: FloatArray, values: FloatArray) -> float:
    """Return the root mean square over time; of one sample its value, of none NaN."""
    if len(time) < 2:
        return _largest(values)
    return float(np.sqrt(np.trapezoid(values**2, time) / (time[-1] - time[0])))
