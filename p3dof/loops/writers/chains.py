"""Joints of a tree as hinges, slides, balls and free joints, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError

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
class Part:
    """A hinge, a slide, a ball or a free joint.

    Parameters
    ----------
    name : str
        The joint's name; a number is added where a joint is several parts.
    joint : int
        The joint of the tree.
    kind : str
        ``"hinge"``, ``"slide"``, ``"ball"`` or ``"free"``.
    axis : (3,) array
        Of a hinge or a slide, in its own axes.
    place : pin.SE3
        Where it is, in the axes of what is before it, when that is at zero.
    v : tuple of int
        What in the velocity of the tree is its own, if it is a joint by itself or all together are.
    turned : bool
        Whether the velocity is in axes that the joint turns, which these parts do not.
    """

    name: str
    joint: int
    kind: str
    axis: FloatArray
    place: Any
    v: tuple[int, ...]
    turned: bool = False


def parts_of(model: pin.Model, joint: int, target: str) -> tuple[Part, ...]:
    """Return the parts that a joint is made of.

    Parameters
    ----------
    model : pin.Model
        The tree.
    joint : int
        The joint.
    target : str
        What the joint is written as, for the error.

    Returns
    -------
    tuple of Part

    Raises
    ------
    ModelError
        If no such parts move as the joint does.
    """
    name, place = str(model.names[joint]), model.jointPlacements[joint]
    parts = tuple(_parts(model.joints[joint], name, joint, int(model.idx_vs[joint]), target))
    first = replace(parts[0], place=place * parts[0].place)
    parts = (first, *parts[1:])
    if len(parts) == 1:
        return parts
    return tuple(replace(part, name=f"{name}_{number}") for number, part in enumerate(parts, 1))


def _parts(joint_model: Any, name: str, joint: int, v: int, target: str) -> Iterator[Part]:
    short, nothing = str(joint_model.shortname()), pin.SE3.Identity()
    count = int(joint_model.nv)
    rates = tuple(range(v, v + count))
    if short == "JointModelFreeFlyer":
        yield Part(name, joint, "free", np.zeros(3), nothing, rates, True)
    elif short == "JointModelSpherical":
        yield Part(name, joint, "ball", np.zeros(3), nothing, rates)
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
            yield Part(name, joint, kind, axis, nothing, (rate,), sliding and short == "JointModelPlanar")
    else:
        raise ModelError(f"{target}: the joint {shown(name)} is a {short}, which it does not know")


def _subspace(joint_model: Any) -> FloatArray:
    """Return the motions (6, nv) of a joint at zero, in its own axes: linear, angular."""
    model = pin.Model()
    model.addJoint(0, joint_model, pin.SE3.Identity(), "joint")
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    return np.array(pin.getJointJacobian(model, data, 1, pin.LOCAL)).reshape(6, -1)


def values_of(parts: Sequence[Part], model: pin.Model, q: FloatArray) -> list[FloatArray]:
    """Return the values of the parts of a joint in MuJoCo's order: quaternions begin with their scalar.

    Parameters
    ----------
    parts : sequence of Part
        All parts of a joint.
    model : pin.Model
        The tree.
    q : (nq,) array
        The configuration.

    Returns
    -------
    list of arrays
    """
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
