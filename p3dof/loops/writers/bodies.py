"""Bodies of a tree for formats that have none without mass: joints in a row share the body behind them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import LARGEST, FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.writers.chains import Part, parts_of

LEAST = 2e-15
"""Mass [kg] and moments of inertia [kg m²] of what has none: the least that MuJoCo takes is 1e-15."""
_UNNOTICED = 1e-12
"""Of the largest entry of the mass matrix, what it may add."""
_PARALLEL = 1e-12
"""Sine of the angle between parallel axes."""
_MOST = 6
"""Degrees of freedom that a body can have from the one before it."""


@dataclass
class Body:
    """A body and the joints that lead to it.

    Parameters
    ----------
    name : str
        Its name.
    joint : int
        The last joint, which it hangs on, and whose axes are its own.
    parent : int
        The joint of the body before it; 0 for the world.
    parts : tuple of Part
        The joints.
    inertia : pin.Inertia
        Its inertia, in the axes of its last joint.
    """

    name: str
    joint: int
    parent: int
    parts: tuple[Part, ...]
    inertia: Any

    @property
    def place(self) -> pin.SE3:
        """Where it is in the axes of the body before it, when all joints are at zero."""
        place = pin.SE3.Identity()
        for part in self.parts:
            place = place * part.place
        return place

    def seen(self) -> list[tuple[Part, pin.SE3]]:
        """Return the joints with where they are at zero, in the axes of the body."""
        found = [(self.parts[-1], pin.SE3.Identity())]
        for part, behind in zip(self.parts[-2::-1], self.parts[:0:-1], strict=True):
            found.append((part, found[-1][1] * behind.place.inverse()))
        return found[::-1]


def bodies_of(model: pin.Model, held: Collection[int], tendons: Collection[int], target: str) -> list[Body]:
    """Return the bodies of a tree, every one after the one it hangs on.

    Parameters
    ----------
    model : pin.Model
        The tree.
    held : collection of int
        Joints whose bodies something else is fixed to.
    tendons : collection of int
        Joints that are written otherwise.
    target : str
        What is written, for the error.

    Returns
    -------
    list of Body
        Without mass are those that cannot be joined with the next one: see `with_least`.

    Raises
    ------
    ModelError
        If a joint is of a type that cannot be written, or nothing with mass hangs on it.
    """
    children: dict[int, list[int]] = {i: [] for i in range(model.njoints)}
    for i in range(1, model.njoints):
        children[int(model.parents[i])].append(i)
    weighs = [has_mass(inertia) for inertia in model.inertias]
    for i in range(model.njoints - 1, 0, -1):
        weighs[int(model.parents[i])] |= weighs[i]
    found: list[Body] = []
    waiting: dict[int, tuple[int, tuple[Part, ...]]] = {}
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


def _fit(parts: tuple[Part, ...]) -> bool:
    """Whether joints can be those of one body."""
    kinds = [part.kind for part in parts]
    if "free" in kinds or kinds.count("ball") > 1 or ("ball" in kinds and "hinge" in kinds):
        return False
    return sum(len(part.v) for part in parts) <= _MOST


def has_mass(inertia: Any) -> bool:
    """Whether an inertia has a mass or moments.

    Parameters
    ----------
    inertia : pin.Inertia
        The inertia.

    Returns
    -------
    bool
    """
    return bool(inertia.mass > 0 or np.any(inertia.inertia))


def with_least(model: pin.Model, bodies: list[Body], target: str) -> None:
    """Give bodies the least mass and moments of inertia that MuJoCo takes, where they have less.

    Parameters
    ----------
    model : pin.Model
        The tree.
    bodies : list of Body
        The bodies, which change.
    target : str
        What is written, for the error.

    Raises
    ------
    ModelError
        If the robot is so light that this is noticed, or an inertia is of no rigid body.
    """
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
    """Return the only direction (3,) about which a body can turn, in its own axes; zero if it cannot turn.

    None for one that can turn otherwise too. Moments of inertia across that direction have no effect.
    """
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
    """Return the principal moments of an inertia, the smallest first, and their axes as columns (3, 3).

    Parameters
    ----------
    inertia : pin.Inertia
        The inertia.

    Returns
    -------
    moments : (3,) array
    axes : (3, 3) array
        A rotation matrix; the identity where the inertia is diagonal and in this order.
    """
    matrix = np.array(inertia.inertia)
    moments, axes = np.linalg.eigh((matrix + matrix.T) / 2)
    if np.linalg.det(axes) < 0:
        axes = -axes
    return moments, axes
