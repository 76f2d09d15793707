"""The mechanism as MuJoCo and Drake get it: every link with a mass, and nothing that stops a motion."""

from __future__ import annotations

from dataclasses import replace

from p3dof.machine import description
from p3dof.machine.description import JointLimits, Mechanism
from p3dof.machine.parameters import Parameters

_ENDLESS = JointLimits(-1e9, 1e9, 1e9, 1e12)


def bare_mechanism(parameters: Parameters) -> Mechanism:
    """Return the description of a machine with masses for all links, without solids and without limits.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    Mechanism
        With the dynamics of `p3dof.machine.description.describe`.

    Raises
    ------
    ModelError
        If a body is too light or too slender to give what a massless neighbour needs.
    """
    mechanism = description.with_masses(description.describe(parameters))
    joints = tuple(
        replace(joint, limits=None if joint.limits is None else _ENDLESS) for joint in mechanism.joints
    )
    links = tuple(replace(link, visuals=(), collisions=()) for link in mechanism.links)
    return replace(mechanism, joints=joints, links=links)
