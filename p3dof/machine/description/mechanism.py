"""The neutral description of a mechanism: links, joints, loop closures and solids, of no file format."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np

from p3dof._base.checks import FloatArray, Readable, frozen_array, positive
from p3dof._base.errors import ModelError, ModelWarning
from p3dof._base.markup import document as document_text
from p3dof.machine.parameters import Body

_UNIT = 1e-9
"""By how much an axis may miss unit length, or a rotation orthogonality."""


@dataclass(frozen=True, eq=False)
class Placement(Readable):
    """Where a frame is, seen from another one."""

    position: FloatArray = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    """(3,): its origin [m]."""
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))  # (3, 3): its axes, as columns

    def __post_init__(self) -> None:
        # Adding zero turns -0 into 0: no sign of zero reaches an angle or a file.
        position = frozen_array("position", np.add(self.position, 0.0), (3,), ModelError)
        rotation = frozen_array("rotation", np.add(self.rotation, 0.0), (3, 3), ModelError)
        if np.abs(rotation.T @ rotation - np.eye(3)).max() > _UNIT or np.linalg.det(rotation) < 0:
            raise ModelError("rotation: expected right-handed perpendicular unit vectors as columns")
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "rotation", rotation)


@dataclass(frozen=True)
class Box(Readable):
    """A box, centred on its placement.

    Parameters
    ----------
    size : tuple of float
        Edges along x, y, z [m].
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        x, y, z = (positive("size", edge, ModelError) for edge in self.size)
        object.__setattr__(self, "size", (x, y, z))


@dataclass(frozen=True)
class Cylinder:
    """A round bar along z, centred on its placement."""

    radius: float  # sizes [m]
    length: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive("radius", self.radius, ModelError))
        object.__setattr__(self, "length", positive("length", self.length, ModelError))


@dataclass(frozen=True)
class Sphere:
    """A ball, centred on its placement."""

    radius: float  # radius [m]

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive("radius", self.radius, ModelError))


Shape: TypeAlias = Box | Cylinder | Sphere
"""The primitives: a description needs no mesh files."""


@dataclass(frozen=True)
class Colour(Readable):
    """A named colour."""

    name: str  # what formats that name their materials call it
    rgba: tuple[float, float, float, float]  # red, green, blue and opacity, each from 0 to 1


@dataclass(frozen=True, eq=False)
class Solid(Readable):
    """One primitive fixed to a link."""

    shape: Shape  # its form
    placement: Placement  # where its middle is, in the link frame
    colour: Colour  # its colour


@dataclass(frozen=True, eq=False)
class Link(Readable):
    """A rigid body, or a marker frame when it has neither body nor solids."""

    name: str  # unique among the links
    body: Body | None = None
    """Mass, mass centre and inertia in the link frame; None for the base and for markers."""
    visuals: tuple[Solid, ...] = ()  # what is drawn, and what must not touch
    collisions: tuple[Solid, ...] = ()


@dataclass(frozen=True)
class JointLimits:
    """What a joint can do."""

    lower: float  # range around home (0) [m or rad]
    upper: float
    velocity: float  # largest speed [m/s or rad/s]
    effort: float  # largest force or torque [N or N m]

    def __post_init__(self) -> None:
        if not self.lower < 0 < self.upper:
            raise ModelError(
                f"limits: expected a range around 0 (home), got [{self.lower:g}, {self.upper:g}]"
            )
        positive("velocity", self.velocity, ModelError)
        positive("effort", self.effort, ModelError)


@dataclass(frozen=True)
class Mimic:
    """That a joint copies another one, for readers that keep no loops."""

    joint: str  # the joint that it copies
    multiplier: float  # its position is this times that joint's


@dataclass(frozen=True, eq=False)
class Joint(Readable):
    """A joint of the tree, between two links."""

    name: str  # unique among the joints
    kind: Literal["prismatic", "revolute", "fixed"]  # how it moves
    parent: str  # links; the child's frame is the joint's frame moved by the joint
    child: str
    placement: Placement  # the joint's frame in the parent's
    axis: FloatArray | None = None  # (3,): unit vector in the joint's frame; None for a fixed joint
    limits: JointLimits | None = None  # none for a fixed joint
    mimic: Mimic | None = None  # for a joint that always copies another one when the loops are closed
    armature: float = 0.0  # inertia that its actuator adds, on which gravity does not act [kg or kg m²]
    force: float = 0.0
    """What a counterbalance adds along the axis at home [N or N m], and its decrease [N/m or N m/rad]."""
    stiffness: float = 0.0
    damping: float = 0.0  # viscous friction [N s/m or N m s/rad]
    friction: float = 0.0  # Coulomb friction [N or N m]

    @property
    def balanced(self) -> bool:
        """Whether a counterbalance acts in it."""
        return bool(self.force or self.stiffness)

    def __post_init__(self) -> None:
        if self.kind not in ("prismatic", "revolute", "fixed"):
            raise ModelError(f"{self.name}: expected prismatic, revolute or fixed, got {self.kind!r}")
        moves = self.kind != "fixed"
        if moves != (self.axis is not None) or moves != (self.limits is not None):
            raise ModelError(
                f"{self.name}: expected axis and limits for a moving joint, none for a fixed one"
            )
        if not moves and (self.armature or self.balanced or self.damping or self.friction):
            raise ModelError(
                f"{self.name}: expected no armature, counterbalance or friction of a fixed joint"
            )
        if self.axis is not None:
            axis = frozen_array(f"{self.name}: axis", np.add(self.axis, 0.0), (3,), ModelError)
            if abs(float(np.linalg.norm(axis)) - 1) > _UNIT:
                raise ModelError(f"{self.name}: expected a unit vector as axis, got {axis}")
            object.__setattr__(self, "axis", axis)


@dataclass(frozen=True)
class Closure:
    """A loop closure: the origins of two marker frames coincide, their axes are free."""

    name: str  # unique among the closures
    frame1: str  # links, one on each side of the cut
    frame2: str


@dataclass(frozen=True)
class Drag:
    """Friction at a rate that no joint of the tree has: between two links that turn about one axis y."""

    name: str  # of which joints it is
    link1: str  # links; the second turns about the y axis of the first
    link2: str
    damping: float  # viscous [N m s/rad]
    friction: float  # Coulomb [N m]


@dataclass(frozen=True, eq=False)
class Mechanism(Readable):
    """A tree of links with loop closures.

    Parameters
    ----------
    name : str
        Name of the robot.
    links : tuple of Link
        The root first.
    joints : tuple of Joint
        Depth first: a joint's parent link is the root or the child of an earlier joint, and the joints below
        it follow it without a gap.
    closures : tuple of Closure
        What the tree was cut at.
    actuated : tuple of str
        Joints with an actuator.
    gravity : array-like, shape (3,)
        Acceleration of gravity in the root's frame [m/s²].
    drags : tuple of Drag
        Friction at a rate that no joint of the tree has.
    smoothing : float
        Rate over which Coulomb friction changes its sign [m/s or rad/s].

    Raises
    ------
    ModelError
        If a name is used twice, does not exist or cannot be printed, or the joints are not a depth-first
        tree.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]
    gravity: FloatArray
    drags: tuple[Drag, ...] = ()
    smoothing: float = 1e-3

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", frozen_array("gravity", self.gravity, (3,), ModelError))
        for what in ("links", "joints", "closures"):
            names = [item.name for item in getattr(self, what)]
            unfit = [name for name in names if not (name and name.isprintable())]
            if unfit:
                raise ModelError(f"{what}: expected printable names, got {unfit[0]!r}")
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise ModelError(f"{what}: the name {twice[0]!r} is used more than once")
        self._check_tree()
        links = {link.name for link in self.links}
        for closure in self.closures:
            for frame in (closure.frame1, closure.frame2):
                if frame not in links:
                    raise ModelError(f"closure {closure.name}: there is no link {frame!r}")
        moving = [joint.name for joint in self.moving]
        for name in self.actuated:
            if name not in moving:
                raise ModelError(f"actuated: there is no moving joint {name!r}")

    def _check_tree(self) -> None:
        if not self.links:
            raise ModelError("links: expected at least the root")
        links = {link.name for link in self.links}
        path = [self.links[0].name]  # from the root to the last child
        reached = set(path)
        for joint in self.joints:
            if joint.child not in links or joint.child in reached:
                raise ModelError(f"{joint.name}: expected a link not yet reached, got {joint.child!r}")
            if joint.parent not in path:
                raise ModelError(f"{joint.name}: not depth first, the parent {joint.parent!r} is behind")
            del path[path.index(joint.parent) + 1 :]
            path.append(joint.child)
            reached.add(joint.child)
        if reached != links:
            raise ModelError(f"links: no joint leads to {sorted(links - reached)[0]!r}")

    @property
    def moving(self) -> tuple[Joint, ...]:
        """The joints that are not fixed, depth first."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    @property
    def passive(self) -> tuple[Joint, ...]:
        """The moving joints without an actuator."""
        return tuple(joint for joint in self.moving if joint.name not in self.actuated)

    @property
    def markers(self) -> dict[str, Joint]:
        """The frames fixed to a link, by name: the joints that fix them."""
        return {joint.child: joint for joint in self.joints if joint.kind == "fixed"}

    def bare(self) -> Mechanism:
        """Return the mechanism without counterbalances and friction; the inertia of motors stays."""
        nothing: dict[str, Any] = dict.fromkeys(("force", "stiffness", "damping", "friction"), 0.0)
        return replace(self, joints=tuple(replace(one, **nothing) for one in self.joints), drags=())

    @property
    def mass(self) -> float:
        """Total mass of all links but the root, which is at rest [kg]."""
        return sum(link.body.mass for link in self.links[1:] if link.body is not None)


def require_no_drive(joint: Joint, form: str, armature: bool = False) -> None:
    """Refuse what motor and counterbalance add in a joint, where a format has no word for it."""
    what = "an inertia of its motor" if joint.armature and not armature else "a counterbalance"
    if joint.balanced or (joint.armature and not armature):
        raise ModelError(
            f"{form} has no word for {what}, which {joint.name} has; MJCF and URDF with its YAML do"
        )


def tell_friction(
    mechanism: Mechanism, form: str, joints: Iterable[str] = (), drags: Iterable[str] = ()
) -> None:
    """Warn of friction that a format has no word for: it has those of `joints` and of `drags`."""
    lost = []
    for kind, what in (("viscous", "damping"), ("Coulomb", "friction")):
        names = [one.name for one in mechanism.moving if what not in joints and getattr(one, what)]
        names += [one.name for one in mechanism.drags if what not in drags and getattr(one, what)]
        if names:
            lost.append(f"the {kind} friction in {', '.join(names)}")
    if lost:
        words = f"{form} has no word for {' and '.join(lost)}, which is left out"
        warnings.warn(words, ModelWarning, stacklevel=4)


def document(root: ET.Element, mechanism: Mechanism, comment: str) -> str:
    """Return the text of an XML file: declaration, comment, indented elements."""
    note = f"{mechanism.name}, written by p3dof: change the parameters, not this file. {comment}"
    return document_text(root, note)
