"""URDF for Drake: with the loops as Drake's ball constraints, and the actuators as transmissions."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

from p3dof._base.markup import numbers, sub
from p3dof.machine.description.mechanism import Joint, Mechanism
from p3dof.machine.description.urdf_text import urdf_tree
from p3dof.machine.description.xml_text import document, require_no_drive

NAMESPACE = "http://drake.mit.edu"


def drake(mechanism: Mechanism) -> str:
    """Return a mechanism as URDF with Drake's own elements for the loops.

    The tree is that of `urdf`, without ``<mimic>``: Drake makes coupler constraints of it, which would close
    the parallelogram a second time. Each loop is a ``<drake:ball_constraint>`` between the origins of its two
    frames. Drake keeps them in discrete plants only (a continuous one refuses to move), and neither its
    inverse dynamics nor its mass matrix know of them. What a URDF has no place for is left to the reader:
    gravity, and a weld of the root to the world. Inertia of motors is that of a rotor with a gear of 1.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.

    Returns
    -------
    str

    Raises
    ------
    ModelError
        If a joint has a balance.

    References
    ----------
    Drake, "Parsing Models for MultibodyPlant", tag drake:ball_constraint.
    """
    joints = tuple(replace(joint, mimic=None) for joint in mechanism.joints)
    root = urdf_tree(replace(mechanism, joints=joints))
    root.set("xmlns:drake", NAMESPACE)
    for joint in mechanism.moving:
        require_no_drive(joint, "Drake's URDF", armature=joint.name in mechanism.actuated)
        if joint.name in mechanism.actuated:
            _transmission(root, joint)
    for closure in mechanism.closures:
        element = sub(root, "drake:ball_constraint")
        for side, point, frame in (("A", "AP", closure.frame1), ("B", "BQ", closure.frame2)):
            sub(element, f"drake:ball_constraint_body_{side}", name=frame)
            sub(element, f"drake:ball_constraint_p_{point}", value="0 0 0")
    return document(root, mechanism, "For discrete plants of Drake.")


def _transmission(root: ET.Element, joint: Joint) -> None:
    """Make a joint an actuated one; Drake takes the largest force from the joint's limits."""
    interface = "hardware_interface/EffortJointInterface"
    element = sub(root, "transmission", name=f"{joint.name}_transmission")
    sub(element, "type", "transmission_interface/SimpleTransmission")
    sub(sub(element, "joint", name=joint.name), "hardwareInterface", interface)
    actuator = sub(element, "actuator", name=f"{joint.name}_actuator")
    sub(actuator, "hardwareInterface", interface)
    sub(actuator, "mechanicalReduction", "1")
    if joint.armature:
        sub(actuator, "drake:rotor_inertia", value=numbers(joint.armature))
        sub(actuator, "drake:gear_ratio", value="1")
