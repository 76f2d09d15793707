"""Reactions of all joints over a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import InputError
from p3dof._base.tables import ShownInNotebook, Tabular
from p3dof.loops.closure_joints import ClosureJoint
from p3dof.loops.linear import BoolArray
from p3dof.machine.motion import Motion

Idealisation: TypeAlias = Literal["paper", "points"]
"""How the cuts of the loops are built."""
IDEALISATIONS: tuple[Idealisation, ...] = get_args(Idealisation)
Way: TypeAlias = Literal["elastic", "paper", "points"]
"""By what the loads are found that rigid bodies leave open: by stiffness, or by a choice."""
WAYS: tuple[Way, ...] = get_args(Way)
Choice: TypeAlias = Literal["all", "elastic", "paper", "points"]
"""One of them, or all."""
ALL: Literal["all"] = "all"

_Y = (0.0, 1.0, 0.0)
_AXES = {"y": _Y, "z": (0.0, 0.0, 1.0)}
_LEG, _ROD, _BALL = ClosureJoint.universal(_Y, _Y), ClosureJoint.revolute(_Y), ClosureJoint.ball()
_CUTS = {"paper": (_LEG, _LEG, _ROD), "points": (_BALL, _BALL, _BALL)}


@dataclass(frozen=True)
class Joint:
    """One of the thirteen joints."""

    name: str  # its name, in tables and files
    label: str  # its name in the drawing: the paper's, but for C7, which the paper does not name
    meaning: str  # what it is
    predecessor: str  # links that it joins; the reaction is what the predecessor exerts on the successor
    successor: str
    frame: str
    """Link or marker of the URDF at whose origin and in whose axes the reaction is given. All but one are
    parallel to the frame of a `Body`: the link `crossbar_lower` (of `hinge_lower`) has the axes of its
    rods at home, its `Body` those of the fixed frame there."""
    axis: str
    """Which of these axes is the joint's: `"y"`, or `"z"` for the slides. Of a universal joint it is the
    leg's; a ball joint has none."""


JOINTS = (
    Joint("slide_a", "A1", "guide of slider A", "base_link", "slider_a", "slider_a", "z"),
    Joint("hinge_a", "A2", "leg A on its slider", "slider_a", "leg_a", "leg_a", "y"),
    Joint("slide_b", "B1", "guide of slider B", "base_link", "slider_b", "slider_b", "z"),
    Joint("hinge_b", "B2", "leg B on its slider", "slider_b", "leg_b", "leg_b", "y"),
    Joint("slide_c", "C1", "guide of slider C", "base_link", "slider_c", "slider_c", "z"),
    Joint(
        "hinge_c", "C2", "upper cross-bar on slider C", "slider_c", "crossbar_upper", "crossbar_upper", "y"
    ),
    Joint("hinge_left", "C3", "left rod, upper end", "crossbar_upper", "rod_left", "rod_left", "y"),
    Joint("hinge_lower", "C4", "left rod, lower end", "rod_left", "crossbar_lower", "crossbar_lower", "y"),
    Joint(
        "hinge_platform",
        "C5",
        "platform on the lower cross-bar",
        "crossbar_lower",
        "platform",
        "platform",
        "y",
    ),
    Joint("hinge_right", "C6", "right rod, upper end", "crossbar_upper", "rod_right", "rod_right", "y"),
    Joint(
        "loop_a",
        "A3",
        "leg A on the platform (its friction: universal_a)",
        "leg_a",
        "platform",
        "leg_a_tip",
        "y",
    ),
    Joint(
        "loop_b",
        "B3",
        "leg B on the platform (its friction: universal_b)",
        "leg_b",
        "platform",
        "leg_b_tip",
        "y",
    ),
    Joint(
        "loop_c",
        "C7",
        "right rod, lower end (its friction: hinge_lower_right)",
        "rod_right",
        "crossbar_lower",
        "rod_right_tip",
        "y",
    ),
)
"""The joints of the tree in Pinocchio's order, then the cuts."""


def cuts(idealisation: str) -> tuple[ClosureJoint, ...]:
    """Return how the three cuts are built."""
    if idealisation not in IDEALISATIONS:
        expected = " or ".join(map(repr, IDEALISATIONS))
        raise InputError(f"cuts: expected {expected}, got {idealisation!r}")
    return _CUTS[idealisation]


def ways_of(choice: str) -> tuple[Way, ...]:
    """Return the ways that were asked for."""
    if choice == ALL:
        return WAYS
    for way in WAYS:
        if choice == way:
            return (way,)
    raise InputError(f"joints: expected {' or '.join(map(repr, (ALL, *WAYS)))}, got {choice!r}")


def joint_axes(idealisation: str) -> FloatArray:
    """Return the axis of each joint in its own frame; ndarray, shape (13, 3): NaN for ball joints."""
    axes = np.array([_AXES[joint.axis] for joint in JOINTS])
    if idealisation == "points":
        axes[-len(_CUTS["points"]) :] = np.nan
    return axes


@dataclass(frozen=True, eq=False)
class JointReaction(Readable):
    """The reaction of one joint over the motion."""

    joint: Joint  # which
    axis: FloatArray  # (3,): its axis; NaN if it has none
    forces: FloatArray
    """(N, 3): what the predecessor exerts on the successor, at the origin and in the axes of the joint's
    frame [N, N m]."""
    moments: FloatArray
    determined_forces: BoolArray
    """(N, 3): which components rigid bodies determine; False where the sample is invalid."""
    determined_moments: BoolArray
    fit: FloatArray
    """(N, 2, 3): what an assembly error adds to force and moment at worst, either way [N, N m]."""


@dataclass(frozen=True)
class Peak(Readable):
    """The largest loads of one joint, over the valid samples of a motion.

    They are what rigid bodies determine, and beyond it what elastic joints bear. NaN stands for a load that
    the joint has not (without an axis nothing is along or across it) and, where no stiffness was asked for,
    for one that has an undetermined part.

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
        Which of these fields contain a component that rigid bodies do not determine: with elastic joints they
        rest on their stiffness, without they are NaN.
    fit_force, fit_moment : float
        A bound of what an assembly error adds to the force and to the moment: the norm of what it adds
        at worst to each component [N, N m].
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
    fit_force: float = 0.0
    fit_moment: float = 0.0


@dataclass(frozen=True)
class OpenPeak(Readable):
    """The largest value of a load that rigid bodies do not determine, by ways to find it.

    Those of idealisations are some of many possible ones, and bound nothing.

    Parameters
    ----------
    joint : str
        Name of the joint.
    load : str
        Which of the fields of a `Peak`.
    values : mapping of str to float
        By the name of the way [N or N m]; NaN where the joint has no such load.
    """

    joint: str
    load: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class JointLoad:
    """The largest value of one load of a joint, and whether it contains an undetermined component.

    Parameters
    ----------
    value : float
        NaN if there is none [N or N m].
    undetermined : bool
        Whether rigid bodies leave it open.
    """

    value: float
    undetermined: bool


_FIT = ("fit_force", "fit_moment")


def loads_of(one: JointReaction, time: FloatArray, valid: BoolArray) -> dict[str, JointLoad]:
    """Return the largest loads of a joint, by the fields of a `Peak`; NaN if no sample is valid."""
    time, axis = time[valid], one.axis
    force, moment = one.forces[valid], one.moments[valid]
    open_force = np.asarray(np.any(~one.determined_forces[valid], axis=0))
    open_moment = np.asarray(np.any(~one.determined_moments[valid], axis=0))
    along, across = axis != 0, axis == 0  # NaN is along: what has no axis is NaN itself
    loads = {
        "force": (largest(_length(force)), open_force.any()),
        "axial": (largest(force @ axis), open_force[along].any()),
        "radial": (largest(_length(_across(force, axis))), open_force[across].any()),
        "moment": (largest(_length(moment)), open_moment.any()),
        "across": (largest(_length(_across(moment, axis))), open_moment[across].any()),
        "rms_force": (_rms(time, _length(force)), open_force.any()),
        "rms_moment": (_rms(time, _length(moment)), open_moment.any()),
        "fit_force": (largest(_length(one.fit[valid, 0])), False),
        "fit_moment": (largest(_length(one.fit[valid, 1])), False),
    }
    return {
        name: JointLoad(value, bool(mark and np.isfinite(value))) for name, (value, mark) in loads.items()
    }


def peaks_of(joint: str, loads: Mapping[str, dict[str, JointLoad]]) -> tuple[Peak, tuple[OpenPeak, ...]]:
    """Return what all idealisations determine of a joint's loads, and apart from it the rest."""
    names = tuple(name for name in next(iter(loads.values())) if not name.startswith("fit_"))
    each = {name: {kind: one[name] for kind, one in loads.items()} for name in names}
    marked = tuple(name for name in names if any(load.undetermined for load in each[name].values()))
    known = {}
    for name in names:
        values = [load.value for load in each[name].values() if np.isfinite(load.value)]
        known[name] = values[0] if values and name not in marked else float("nan")
        if "elastic" in each[name]:
            known[name] = each[name]["elastic"].value
    rest = (OpenPeak(joint, name, {kind: load.value for kind, load in each[name].items()}) for name in marked)
    fit = {name: loads["elastic"][name].value for name in _FIT} if "elastic" in loads else {}
    return Peak(joint, **known, undetermined=marked, **fit), tuple(rest)


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def _across(vectors: FloatArray, axis: FloatArray) -> FloatArray:
    return vectors - np.outer(vectors @ axis, axis)


def largest(values: FloatArray) -> float:
    """Return the largest magnitude, NaN of nothing."""
    return float(np.abs(values).max()) if len(values) else float("nan")


def _rms(time: FloatArray, values: FloatArray) -> float:
    """Return the root mean square over time; of one sample its value, of none NaN."""
    if len(time) < 2:
        return largest(values)
    return float(np.sqrt(np.trapezoid(values**2, time) / (time[-1] - time[0])))


@dataclass(frozen=True, eq=False)
class Reactions(ShownInNotebook, Tabular):
    """Reactions of all joints over a motion; ``result["hinge_a"]`` is one of them.

    Parameters
    ----------
    way : str
        How loads are found that rigid bodies leave open: ``"elastic"``, ``"paper"`` or ``"points"``.
    cuts : str
        How the cuts are built, ``"paper"`` or ``"points"``.
    length : float
        What compares moments with forces where a choice is made [m]; see `p3dof.analysis.reactions`.
    motion : Motion
        The motion of the platform.
    forces, moments : ndarray, shape (N, 13, 3)
        What the predecessor of each of `JOINTS` exerts on the successor, at the origin and in the axes of
        the joint's frame (`Joint.frame`; `in_base` turns them) [N, N m]; NaN where a sample is invalid. Along
        a joint's freedoms lie the force of its actuator and its friction.
    determined_forces, determined_moments : ndarray of bool, shape (N, 13, 3)
        Which components rigid bodies determine; False where a sample is invalid.
    rotations : ndarray, shape (N, 13, 3, 3)
        Axes of the joints' frames, as columns, in the fixed frame.
    positions : ndarray, shape (N, 13, 3)
        Origins of the joints' frames in the fixed frame [m].
    undetermined : ndarray of int, shape (N,)
        How many independent changes of the reactions leave the motion as it is.
    fit : ndarray, shape (N, 2, 13, 2, 3)
        What an assembly error may add to each component of force and moment, either way: at worst, and at
        random (standard deviations, if the tolerances are some) [N, N m]; zero without any.
    residual : ndarray, shape (N,)
        Largest error of Newton's and Euler's equations [N or N m]: of every body, with the motion of its mass
        centre from the closed forms of `p3dof.closed_form.kinematics`, and all reactions that act on it.
    """

    way: str
    cuts: str
    length: float
    motion: Motion
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: NDArray[np.int_]
    fit: FloatArray
    residual: FloatArray

    def __repr__(self) -> str:
        worst = largest(self.residual[self.valid])
        return f"Reactions({self.way}, {self.motion!r}, residual {worst:.1e})"

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
            self.fit[:, 0, i],
        )

    @property
    def ways(self) -> tuple[str, ...]:
        """The one way, as of a comparison."""
        return (self.way,)

    @property
    def rests_on_stiffness(self) -> bool:
        """Whether loads that rigid bodies leave open are those of elastic joints."""
        return self.way == "elastic"

    @property
    def each(self) -> tuple[Reactions, ...]:
        """Itself alone, as of a comparison."""
        return (self,)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the thirteen joints."""
        return tuple(joint.name for joint in JOINTS)

    @property
    def axes(self) -> FloatArray:
        """Axis of each joint in its own frame, shape (13, 3); NaN for ball joints."""
        return joint_axes(self.cuts)

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""
        return self.motion.time

    @property
    def valid(self) -> BoolArray:
        """Which samples have reactions, shape (N,)."""
        return np.asarray(np.isfinite(self.forces).all(axis=(1, 2)))

    @property
    def possible(self) -> bool:
        """Whether every sample is valid: else the machine cannot perform the motion."""
        return bool(self.valid.all())

    def in_base(self) -> tuple[FloatArray, FloatArray]:
        """Return forces and moments (N, 13, 3) [N, N m] in the axes of the fixed frame, at the same points.

        Marks hold for the joints' own axes only: here a component mixes what is determined and what is not.
        """
        return in_fixed_axes(self.rotations, self.forces), in_fixed_axes(self.rotations, self.moments)

    def loads(self, name: str) -> dict[str, JointLoad]:
        """Return a joint's largest loads and which are open, by fields of a `Peak`; NaN if not `possible`.

        Parameters
        ----------
        name : str
            Of the joint.

        Raises
        ------
        InputError
            If there is no such joint.
        """
        return loads_of(self[name], self.time, self.valid & self.possible)

    def peaks(self) -> tuple[Peak, ...]:
        """Return the largest loads of all `JOINTS`, for sizing; rigid ones NaN where `open_peaks` tells."""
        return tuple(peaks_of(name, {self.way: self.loads(name)})[0] for name in self.joints)

    def open_peaks(self) -> tuple[OpenPeak, ...]:
        """Return the largest values here, by `JOINTS`, of the loads that rigid bodies leave open.

        Unless the joints are elastic, each is one of many possible values, and no bound.
        """
        found = (peaks_of(name, {self.way: self.loads(name)})[1] for name in self.joints)
        return tuple(peak for peaks in found for peak in peaks)

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, all reactions and the residual, (N,) each, by name and unit.

        Components are in the axes of the joints' frames (`Joint.frame`). One that is not determined in every
        sample is followed by a column that says where it is (1) and where not (0).
        """
        found = {"t [s]": self.time}
        for name in self.joints:
            one = self[name]
            for kind, values, determined in (
                ("f{} [N]", one.forces, one.determined_forces),
                ("m{} [N m]", one.moments, one.determined_moments),
            ):
                for i, axis in enumerate("xyz"):
                    found[f"{name} {kind.format(axis)}"] = values[:, i]
                    if not determined[self.valid, i].all():
                        found[f"{name} {kind[0]}{axis} determined"] = determined[:, i].astype(float)
        return found | {"residual": self.residual}


def in_fixed_axes(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors in the axes of the fixed frame; ndarray, shape (..., 3)."""
    return np.asarray(np.einsum("...ij,...j->...i", rotations, vectors))
