"""Bodies of a tree for formats that have none without mass: joints in a row share the body behind them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.checks import LARGEST, FloatArray, one_line, shown
from p3dof._base.errors import AssemblyError, ModelError, ModelWarning
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.loop_model import LoopModel

KNOWN = (
    "JointModelR",
    "JointModelP",
    "JointModelSphericalZYX",
    "JointModelTranslation",
    "JointModelUniversal",
)
"""Beginnings of the names of joints that turn and slide about and along the axes of their own subspace."""
_COMPOSITE = "JointModelComposite"


@dataclass(frozen=True)
class WrittenJoint:
    """A hinge, a slide, a ball or a free joint."""

    name: str  # the joint's name; a number is added where a joint is several parts
    joint: int  # the joint of the tree
    kind: str  # `"hinge"`, `"slide"`, `"ball"` or `"free"`
    axis: FloatArray  # (3,): of a hinge or a slide, in its own axes
    place: Any  # where it is, in the axes of what is before it, when that is at zero
    v: tuple[int, ...]
    """What in the velocity of the tree is its own, if it is a joint by itself or all together are."""
    turned: bool = False  # whether the velocity is in axes that the joint turns, which these parts do not


def parts_of(model: pin.Model, joint: int, target: str) -> tuple[WrittenJoint, ...]:
    """Return the parts that a joint is made of."""
    name, place = str(model.names[joint]), model.jointPlacements[joint]
    parts = tuple(_parts(model.joints[joint], name, joint, int(model.idx_vs[joint]), target))
    first = replace(parts[0], place=place * parts[0].place)
    parts = (first, *parts[1:])
    if len(parts) == 1:
        return parts
    return tuple(replace(part, name=f"{name}_{number}") for number, part in enumerate(parts, 1))


def _parts(joint_model: Any, name: str, joint: int, v: int, target: str) -> Iterator[WrittenJoint]:
    short, nothing = str(joint_model.shortname()), pin.SE3.Identity()
    count = int(joint_model.nv)
    rates = tuple(range(v, v + count))
    if short == "JointModelFreeFlyer":
        yield WrittenJoint(name, joint, "free", np.zeros(3), nothing, rates, True)
    elif short == "JointModelSpherical":
        yield WrittenJoint(name, joint, "ball", np.zeros(3), nothing, rates)
    elif short == _COMPOSITE:
        whole = joint_model.extract()
        for inner, place in zip(whole.joints, whole.jointPlacements, strict=True):
            for part in _parts(inner, name, joint, v, target):
                yield replace(part, place=place * part.place)
                place = nothing  # noqa: PLW2901 - further parts of the same joint are where the first is
            v += int(inner.nv)
    elif short == "JointModelPlanar" or (short.startswith(KNOWN) and "Mimic" not in short):
        for column, rate in zip(_subspace(joint_model).T, rates, strict=True):
            sliding = bool(column[:3].any())
            axis = column[:3] if sliding else column[3:]
            kind = "slide" if sliding else "hinge"
            yield WrittenJoint(
                name, joint, kind, axis, nothing, (rate,), sliding and short == "JointModelPlanar"
            )
    else:
        raise ModelError(f"{target}: the joint {shown(name)} is a {short}, which it does not know")


def _subspace(joint_model: Any) -> FloatArray:
    """Return the motions (6, nv) of a joint at zero, in its own axes: linear, angular."""
    model = pin.Model()
    model.addJoint(0, joint_model, pin.SE3.Identity(), "joint")
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    return np.array(pin.getJointJacobian(model, data, 1, pin.LOCAL)).reshape(6, -1)


def values_of(parts: Sequence[WrittenJoint], model: pin.Model, q: FloatArray) -> list[FloatArray]:
    """Return the values of the parts of a joint in MuJoCo's order: quaternions begin with their scalar."""
    joint = parts[0].joint
    left = list(q[model.idx_qs[joint] : model.idx_qs[joint] + model.nqs[joint]])
    sizes = _sizes(model.joints[joint])
    found = []
    for part, size in zip(parts, sizes, strict=True):
        values, left = np.array(left[:size]), left[size:]
        if part.kind == "free":
            place = part.place * pin.SE3(pin.Quaternion(values[3:]).normalized().matrix(), values[:3])
            turn = pin.Quaternion(place.rotation).coeffs()
            found.append(np.array([*place.translation, turn[3], *turn[:3]]))
        elif part.kind == "ball":
            found.append(np.array([values[3], *values[:3]]))
        else:
            found.append(np.array([np.arctan2(values[1], values[0])]) if size == 2 else values)
    return found


def _sizes(joint_model: Any) -> list[int]:
    """Return how many numbers of the configuration each part of a joint has."""
    short = str(joint_model.shortname())
    if short == _COMPOSITE:
        return [size for inner in joint_model.extract().joints for size in _sizes(inner)]
    if short == "JointModelPlanar":
        return [1, 1, 2]
    nq, nv = int(joint_model.nq), int(joint_model.nv)
    return [nq] if nq != nv else [1] * nq


LEAST = 2e-15  # mass [kg], moments of inertia [kg m²] of what has none: the least of MuJoCo is 1e-15
_UNNOTICED = 1e-12  # of the largest entry of the mass matrix, what it may add
_PARALLEL = 1e-12  # sine of the angle between parallel axes
_MOST = 6  # degrees of freedom that a body can have from the one before it


@dataclass
class Body:
    """A body and the joints that lead to it."""

    name: str  # its name
    joint: int  # the last joint, which it hangs on, and whose axes are its own
    parent: int  # the joint of the body before it; 0 for the world
    parts: tuple[WrittenJoint, ...]  # the joints
    inertia: Any  # its inertia, in the axes of its last joint

    @property
    def place(self) -> pin.SE3:
        """Where it is in the axes of the body before it, when all joints are at zero."""
        place = pin.SE3.Identity()
        for part in self.parts:
            place = place * part.place
        return place

    def seen(self) -> list[tuple[WrittenJoint, pin.SE3]]:
        """Return the joints with where they are at zero, in the axes of the body."""
        found = [(self.parts[-1], pin.SE3.Identity())]
        for part, behind in zip(self.parts[-2::-1], self.parts[:0:-1], strict=True):
            found.append((part, found[-1][1] * behind.place.inverse()))
        return found[::-1]


def bodies_of(model: pin.Model, held: Collection[int], tendons: Collection[int], target: str) -> list[Body]:
    """Return the bodies of a tree, each after its parent; without mass those not joined: `with_least`."""
    children: dict[int, list[int]] = {i: [] for i in range(model.njoints)}
    for i in range(1, model.njoints):
        children[int(model.parents[i])].append(i)
    weighs = [has_mass(inertia) for inertia in model.inertias]
    for i in range(model.njoints - 1, 0, -1):
        weighs[int(model.parents[i])] |= weighs[i]
    found: list[Body] = []
    waiting: dict[int, tuple[int, tuple[WrittenJoint, ...]]] = {}
    for i in range(1, model.njoints):
        if i in tendons:
            continue
        span = slice(model.idx_vs[i], model.idx_vs[i] + model.nvs[i])
        name = str(model.names[i])
        if not weighs[i] and not np.all(np.asarray(model.armature)[span]):
            raise ModelError(
                f"{target}: nothing behind the joint {shown(name)} has a mass, so it cannot move there"
            )
        parent, parts = waiting.pop(i, (int(model.parents[i]), ()))
        parts = (*parts, *parts_of(model, i, target))
        if i not in held and not has_mass(model.inertias[i]) and len(children[i]) == 1:
            after = parts_of(model, children[i][0], target)
            if _fit((*parts, *after)):
                waiting[children[i][0]] = parent, parts
                continue
        found.append(Body(name, i, parent, parts, model.inertias[i].copy()))
    return found


def _fit(parts: tuple[WrittenJoint, ...]) -> bool:
    """Whether joints can be those of one body."""
    kinds = [part.kind for part in parts]
    if "free" in kinds or kinds.count("ball") > 1 or ("ball" in kinds and "hinge" in kinds):
        return False
    return sum(len(part.v) for part in parts) <= _MOST


def has_mass(inertia: Any) -> bool:
    """Whether an inertia has a mass or moments."""
    return bool(inertia.mass > 0 or np.any(inertia.inertia))


def with_least(model: pin.Model, bodies: list[Body], target: str) -> None:
    """Give bodies the least mass and moments of inertia that MuJoCo takes, where they have less."""
    data = model.createData()
    largest = float(np.abs(pin.crba(model, data, pin.neutral(model))).max(initial=0.0))
    directions = _directions(bodies)
    for body in bodies:
        known = np.append(np.ravel(body.inertia.inertia), [body.inertia.mass, *body.inertia.lever])
        if not np.all(np.abs(known) < LARGEST):  # also what is not a number
            raise ModelError(
                f"{target}: the inertia of the body {shown(body.name)} is too large, or no number"
            )
        moments, axes = principal(body.inertia)
        more = np.maximum(moments, LEAST)
        more[2] = min(more[2], more[0] + more[1])
        mass = max(float(body.inertia.mass), LEAST)
        added = mass > body.inertia.mass
        axis = directions[body.joint]
        if axis is not None and (np.any(more > moments) or moments[2] > more[2] * (1 + _UNNOTICED)):
            about = float(axis @ np.array(body.inertia.inertia) @ axis)  # no other moment is ever felt
            more, axes, added = (
                np.full(3, max(about, LEAST)),
                np.eye(3),
                added or (about < LEAST and axis.any()),
            )
        elif moments[2] > more[2] * (1 + _UNNOTICED):
            raise ModelError(
                f"{target}: the inertia of the body {shown(body.name)} is of no rigid body: its largest "
                "moment is larger than the others together"
            )
        else:
            added = added or bool(np.any(more > moments))
        if added and _UNNOTICED * largest < LEAST:
            raise ModelError(
                f"{target}: the body {shown(body.name)} has no mass or moment of inertia, and the robot is "
                f"too light for the least of {LEAST:g} that it would get"
            )
        if not added and np.all(np.abs(more - moments) <= _UNNOTICED * moments[2]):
            continue
        matrix = axes @ np.diag(more) @ axes.T
        body.inertia = pin.Inertia(mass, body.inertia.lever, (matrix + matrix.T) / 2)


def _directions(bodies: list[Body]) -> dict[int, FloatArray | None]:
    """Return the only axis (3,) a body can turn about; zero for none, None if more; inertia across idles."""
    found: dict[int, FloatArray | None] = {0: np.zeros(3)}
    for body in bodies:
        before = found[body.parent]
        axis = None if before is None else body.place.rotation.T @ before
        for part, at in body.seen():
            if axis is None or part.kind in ("ball", "free"):
                axis = None
            elif part.kind == "hinge":
                turn = at.rotation @ (part.axis / np.linalg.norm(part.axis))
                if axis.any() and np.linalg.norm(np.cross(axis, turn)) > _PARALLEL:
                    axis = None
                elif not axis.any():
                    axis = turn
        found[body.joint] = axis
    return found


def principal(inertia: Any) -> tuple[FloatArray, FloatArray]:
    """Return the principal moments of an inertia, the smallest first, and their axes as columns (3, 3)."""
    matrix = np.array(inertia.inertia)
    moments, axes = np.linalg.eigh((matrix + matrix.T) / 2)
    if np.linalg.det(axes) < 0:
        axes = -axes
    return moments, axes


End: TypeAlias = tuple[int, pin.SE3]  # a joint, and where on its body a frame is


def frame_ends(loop: LoopModel) -> list[tuple[End, End]]:
    """Return where the two frames of every closure are."""
    ends = LoopKinematics(loop.model, loop.sidecar).ends
    return [((int(one), at), (int(two), there)) for one, at, two, there in ends]


def closed_configuration(loop: LoopModel, target: str) -> FloatArray:
    """Return the reference configuration with closed loops; (nq,)."""
    try:
        return loop.assemble().q
    except AssemblyError as error:
        message = f"{target}: the loops are open in what is written: {one_line(str(error))}"
        warnings.warn(message, ModelWarning, stacklevel=5)
        return loop.reference


_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class Names:
    """The names of one scope."""

    def __init__(self, target: str, taken: Iterable[str] = ()) -> None:
        self._target, self._taken = target, set(taken)

    def own(self, name: str) -> str:
        """Enter a name of the robot and return it."""
        if not name or _NO_XML.search(name):
            raise ModelError(f"{self._target}: the name {shown(name)} cannot be written in XML")
        if name in self._taken:
            raise ModelError(f"{self._target}: the name {shown(name)} is there twice")
        self._taken.add(name)
        return name

    def new(self, name: str) -> str:
        """Return a name that is not used yet, one that is given if possible."""
        name = _NO_XML.sub("_", name) or "_"
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name
