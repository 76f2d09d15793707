"""The thirteen joints of the manipulator, and how the three where its loops were cut can be built."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof.loops.closure_joints import ClosureJoint

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
