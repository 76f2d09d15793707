"""SRDF: what a motion planner should know beside the URDF."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from p3dof._base.markup import sub
from p3dof.machine.description.mechanism import Mechanism
from p3dof.machine.description.xml_text import document

ALL, ACTUATORS = "mechanism", "actuators"
"""The groups: all moving joints, and those with an actuator."""

HOME = "home"
"""The state in which every joint is at 0; all loops are closed."""


def srdf(mechanism: Mechanism) -> str:
    """Return the semantics of a mechanism as SRDF text, for MoveIt and Pinocchio.

    Groups, the home state, the root fixed to the world, the passive joints, and the pairs of neighbours whose
    contacts do not count: those joined by a joint or by a loop closure. SRDF knows no loops.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.

    Returns
    -------
    str

    References
    ----------
    wiki.ros.org/srdf; the reader is github.com/moveit/srdfdom.
    """
    root = ET.Element("robot", name=mechanism.name)
    groups = {ALL: [joint.name for joint in mechanism.moving], ACTUATORS: list(mechanism.actuated)}
    for group, names in groups.items():
        element = sub(root, "group", name=group)
        for name in names:
            sub(element, "joint", name=name)
    state = sub(root, "group_state", name=HOME, group=ALL)
    for joint in mechanism.moving:
        sub(state, "joint", name=joint.name, value="0")
    base = mechanism.links[0].name
    sub(root, "virtual_joint", name="world_fixed", type="fixed", parent_frame="world", child_link=base)
    for joint in mechanism.passive:
        sub(root, "passive_joint", name=joint.name)
    for link1, link2 in neighbours(mechanism):
        sub(root, "disable_collisions", link1=link1, link2=link2, reason="Adjacent")
    return document(root, mechanism, "It belongs to the .urdf beside it.")


def neighbours(mechanism: Mechanism) -> list[tuple[str, str]]:
    """Return the pairs of links that a joint or a closure joins, markers counted as their link.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.

    Returns
    -------
    list of tuple of str
        Without repetition: joints first, then closures, each in their order.
    """

    def carrier(link: str) -> str:
        while link in mechanism.markers:
            link = mechanism.markers[link].parent
        return link

    joined = [(joint.parent, joint.child) for joint in mechanism.moving]
    joined += [(closure.frame1, closure.frame2) for closure in mechanism.closures]
    return list(dict.fromkeys((carrier(one), carrier(other)) for one, other in joined))
