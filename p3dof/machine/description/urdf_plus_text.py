"""URDF+: a URDF with the loops in it."""

from __future__ import annotations

from dataclasses import replace

from p3dof._base.markup import numbers, roll_pitch_yaw, sub
from p3dof.machine.description.mechanism import Mechanism, Placement
from p3dof.machine.description.urdf_text import urdf_tree
from p3dof.machine.description.xml_text import document, require_no_drive


def urdf_plus(mechanism: Mechanism) -> str:
    """Return a mechanism as URDF+ text: the tree as in the URDF, and a ``<loop>`` for every closure.

    A loop names a predecessor and a successor link, each with the ``<origin>`` of its half of the loop joint
    in the link's frame. Joints with ``independent="false"`` follow from the others: all but the actuated
    ones. There is no ``<mimic>``: the loops say it. Other readers of URDF ignore both and see the plain tree.

    The loops are of type ``spherical``, as the closures are: points coincide, axes are free. The paper's own
    parser does not know that type (only revolute, continuous, prismatic, planar and fixed) and refuses the
    file with a message. It reads the file once ``spherical`` is replaced by ``revolute``; its companion
    library then equates the points alone, whatever the type, but takes every joint of a loop for a revolute
    one, which would be wrong for these sliders. A reader that took ``revolute`` at its word would lock the
    mechanism, which is why it is not written.

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
        If a joint has inertia of a motor or a balance.

    References
    ----------
    M. Chignoli, J.-J. Slotine, P. M. Wensing, S. Kim, "URDF+: An Enhanced URDF for Robots with Kinematic
    Loops", arXiv 2411.19753. Element names, attributes and types are those that its parser reads:
    github.com/mit-biomimetics/urdfdom, urdf_parser/src/constraint.cpp and joint.cpp at 0425417; used by
    github.com/ROAM-Lab-ND/generalized_rbda, robot-models/four_bar.urdf at 45fa7c4.
    """
    joints = tuple(replace(joint, mimic=None) for joint in mechanism.joints)
    for joint in joints:
        require_no_drive(joint, "URDF+")
    root = urdf_tree(replace(mechanism, joints=joints))
    passive = {joint.name for joint in mechanism.passive}
    for element in root.iter("joint"):
        if element.get("name") in passive:
            element.set("independent", "false")
    for closure in mechanism.closures:
        loop = sub(root, "loop", name=closure.name, type="spherical")
        for side, frame in (("predecessor", closure.frame1), ("successor", closure.frame2)):
            marker = mechanism.markers.get(frame)
            link, at = (marker.parent, marker.placement) if marker else (frame, Placement())
            half = sub(loop, side, link=link)
            sub(half, "origin", xyz=numbers(at.position), rpy=numbers(roll_pitch_yaw(at.rotation)))
    return document(root, mechanism, "URDF+ (arXiv 2411.19753): the loops are at the end.")
