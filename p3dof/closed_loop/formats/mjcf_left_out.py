"""What acts in an MJCF and is not read, in words: nothing that changes the forces is left out silently."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from p3dof.checks import FloatArray, shown


def acting(m: Any, number: int) -> bool:
    """Return whether something acts in a tendon by itself.

    Parameters
    ----------
    m : mujoco.MjModel
        The compiled model.
    number : int
        Which tendon.

    Returns
    -------
    bool
    """
    fields = m.tendon_stiffness, m.tendon_damping, m.tendon_frictionloss, tendon_armature(m)
    return any(bool(field[number]) for field in fields)


def tendon_armature(m: Any) -> FloatArray:
    """Return the inertia of all tendons, which they have since MuJoCo 3.3.1.

    Parameters
    ----------
    m : mujoco.MjModel
        The compiled model.

    Returns
    -------
    (ntendon,) array
    """
    return np.array(getattr(m, "tendon_armature", np.zeros(m.ntendon)))


def left_out(m: Any, tendons: Collection[int]) -> Iterator[str]:
    """Yield words for what acts and is not read.

    Parameters
    ----------
    m : mujoco.MjModel
        The compiled model.
    tendons : collection of int
        The tendons that are read.
    """
    for number in range(m.ntendon):
        called = f"the tendon {shown(str(m.tendon(number).name))}"
        if number in tendons:
            low, high = m.tendon_lengthspring[number]
            if m.tendon_stiffness[number] and low != high:
                yield f"the spring of {called}, which is slack between two lengths"
        elif acting(m, number):
            yield f"what acts in {called}, which is not fixed to joints"
    if hasattr(m, "actuator_damping"):
        for number in np.flatnonzero(m.actuator_damping):
            yield f"the damping of the actuator {shown(str(m.actuator(int(number)).name))}"
    for number in range(m.njnt):
        called = f"the joint {shown(str(m.joint(number).name))}"
        dofs = np.flatnonzero(m.dof_jntid == number)
        if _any(m, "jnt_stiffnesspoly", number) or _any(m, "dof_dampingpoly", dofs):
            yield f"the higher powers of the spring or damper of {called}"
        if m.jnt_type[number] == 0 and m.dof_armature[dofs].any():
            yield f"that the armature of {called} is in axes of the world"
    if np.any(m.body_gravcomp):
        yield "the compensation of gravity"
    if m.opt.density or m.opt.viscosity:
        yield "the fluid around the robot"


def _any(m: Any, field: str, which: Any) -> bool:
    """Whether an array of newer versions of MuJoCo has entries there that are not zero."""
    return hasattr(m, field) and bool(np.any(getattr(m, field)[which]))
