"""What acts in an MJCF and is not read, in words: nothing that changes the forces is left out silently."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown

_SLIDE = 2
"""Of `mujoco.mjtJoint`."""


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


def lifting(m: Any, gravity: FloatArray) -> dict[int, float]:
    """Return the constant forces of joints that the compensation of gravity comes to.

    It does where a slide alone carries a body: all others would feel it differently in each position.

    Parameters
    ----------
    m : mujoco.MjModel
        The compiled model.
    gravity : ndarray, shape (3,)
        As it acts [m/s²].

    Returns
    -------
    dict of int to float
        Force along the joint [N], by its number.
    """
    found: dict[int, float] = {}
    for body in np.flatnonzero(m.body_gravcomp > 0):
        slide = _slide_of(m, int(body))
        if slide is not None:
            number, axis = slide
            weight = -float(m.body_mass[body]) * float(np.dot(gravity, axis))
            found[number] = found.get(number, 0.0) + float(m.body_gravcomp[body]) * weight
    return found


def _slide_of(m: Any, body: int) -> tuple[int, FloatArray] | None:
    """Return the slide by which alone a body moves, and its axis in the world; None if there is more."""
    joints: list[int] = []
    rotation, found = np.eye(3), body
    while body:
        first = int(m.body_jntadr[body])
        joints += range(first, first + int(m.body_jntnum[body]))
        body = int(m.body_parentid[body])
    if len(joints) != 1 or m.jnt_type[joints[0]] != _SLIDE or m.jnt_actgravcomp[joints[0]]:
        return None
    body = int(m.jnt_bodyid[joints[0]])
    while body:
        rotation = _matrix(m.body_quat[body]) @ rotation
        body = int(m.body_parentid[body])
    return (joints[0], rotation @ m.jnt_axis[joints[0]]) if found else None


def _not_lifting(m: Any) -> Iterator[str]:
    for body in np.flatnonzero(m.body_gravcomp > 0):
        if _slide_of(m, int(body)) is None:
            yield f"the compensation of gravity of the body {shown(str(m.body(int(body)).name))}"


def _matrix(quaternion: FloatArray) -> FloatArray:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


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
    yield from _not_lifting(m)
    if m.opt.density or m.opt.viscosity:
        yield "the fluid around the robot"


def _any(m: Any, field: str, which: Any) -> bool:
    """Whether an array of newer versions of MuJoCo has entries there that are not zero."""
    return hasattr(m, field) and bool(np.any(getattr(m, field)[which]))
