"""Joints of a tree by name: their indices, and configurations put together from their values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.accuracy import NORMALISED
from p3dof.loops.sidecar import suggestion


def joint_named(model: pin.Model, name: str, what: str) -> int:
    """Return the index of a joint.

    Parameters
    ----------
    model : pin.Model
        The tree.
    name : str
        The joint's name.
    what : str
        What to call it in an error.

    Returns
    -------
    int

    Raises
    ------
    ModelError
        If there is no such joint.
    """
    joints = [str(joint) for joint in model.names[1:]]
    if name not in joints:
        raise ModelError(f"{what}: the joint {shown(name)} does not exist; {suggestion(name, joints)}")
    return joints.index(name) + 1


def single_joint(model: pin.Model, name: str, what: str) -> int:
    """Return the index of a joint that has one degree of freedom.

    Parameters
    ----------
    model : pin.Model
        The tree.
    name : str
        The joint's name.
    what : str
        What to call it in an error.

    Returns
    -------
    int

    Raises
    ------
    ModelError
        If there is no such joint, or it has another number of freedoms.
    """
    index = joint_named(model, name, what)
    if model.nvs[index] != 1:
        got = model.nvs[index]
        raise ModelError(f"{what}: expected joints with one degree of freedom, {shown(name)} has {got}")
    return index


def configuration_of(
    model: pin.Model, values: Mapping[str, Any] | None, what: str = "reference"
) -> FloatArray:
    """Return the configuration in which some joints have given values.

    Parameters
    ----------
    model : pin.Model
        The tree.
    values : mapping of str to float or tuple of float, optional
        Values by joint, as of `Sidecar.reference`; the other joints are neutral.
    what : str
        What to call the values in an error.

    Returns
    -------
    (nq,) array

    Raises
    ------
    ModelError
        If a joint does not exist, its values are not as many as it has, or are not normalised.
    """
    q = np.array(pin.neutral(model), dtype=float)
    for name, value in (values or {}).items():
        index = joint_named(model, name, what)
        numbers, size = np.atleast_1d(np.asarray(value, dtype=float)), int(model.nqs[index])
        if len(numbers) == 1 and size == 2 and model.nvs[index] == 1:  # a continuous joint
            numbers = np.array([np.cos(numbers[0]), np.sin(numbers[0])])
        if len(numbers) != size:
            raise ModelError(f"{what}: {shown(name)}: expected {size} values, got {len(numbers)}")
        q[model.idx_qs[index] : model.idx_qs[index] + size] = numbers
        if not pin.isNormalized(model, q, NORMALISED):
            raise ModelError(f"{what}: {shown(name)}: its values are not normalised")
    return np.array(pin.normalize(model, q)) if model.nq != model.nv else q
