"""URDF, and the sidecar with the loop closures that URDF cannot hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import yaml

from p3dof._base.markup import moments, numbers, roll_pitch_yaw, sub
from p3dof.machine.description.mechanism import (
    Box,
    Cylinder,
    Joint,
    Link,
    Mechanism,
    Placement,
    Solid,
    document,
    require_no_drive,
    tell_friction,
)


def urdf(mechanism: Mechanism) -> str:
    """Return the tree of a mechanism as URDF text: self-contained, primitives only, always the same bytes.

    Numbers have 15 significant digits. The parallelogram's joints mimic each other, for readers that keep no
    loops; ``<ros2_control>`` names the actuators. Links without mass have no ``<inertial>``. Friction of its
    joints is ``<dynamics>``. The inertia of motors and the counterbalances, for which URDF has no place, and
    friction again are in the `sidecar`.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.
    """
    root = urdf_tree(mechanism)
    _ros2_control(root, mechanism)
    return document(root, mechanism, "The loops are in the .yaml beside it.")


def urdf_tree(mechanism: Mechanism) -> ET.Element:
    """Return links and joints as URDF elements, for the formats that add to them; ``<robot>``."""
    root = ET.Element("robot", name=mechanism.name)
    colours = {
        solid.colour.name: solid.colour
        for link in mechanism.links
        for solid in (*link.visuals, *link.collisions)
    }
    for name, colour in sorted(colours.items()):
        sub(sub(root, "material", name=name), "color", rgba=numbers(colour.rgba))
    for link in mechanism.links:
        _link(root, link)
    for joint in mechanism.joints:
        _joint(root, joint)
    return root


_SMOOTHING = 1e-3  # of `p3dof.loops.JointData`, if it says nothing


def sidecar(mechanism: Mechanism) -> str:
    """Return the loop closures and actuated joints as YAML, in the convention of Gepetto's parallel robots.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.

    Returns
    -------
    str
        ``closed_loop``: pairs of frames; ``type``: ``3d`` (point closures) for each; ``name_mot``: the
        actuated joints; ``joint_data``: inertia of motors and screws, counterbalances and friction, if there
        are any; ``bushings``: viscous friction at a rate that no joint has. `ModelWarning` of the Coulomb
        friction at such a rate.
    """
    data: dict[str, Any] = {
        "closed_loop": [[closure.frame1, closure.frame2] for closure in mechanism.closures],
        "type": ["3d"] * len(mechanism.closures),
        "name_mot": list(mechanism.actuated),
    }
    tell_friction(mechanism, "A closed-loop model", ("damping", "friction"), ("damping",))
    acting = [_acting(joint, mechanism.smoothing) for joint in mechanism.moving]
    if said := [entry for entry in acting if len(entry) > 1]:
        data["joint_data"] = said
    if dampers := [drag for drag in mechanism.drags if drag.damping]:
        data["bushings"] = [
            {"frames": [d.link1, d.link2], "damping": [0, 0, 0, 0, d.damping, 0], "name": d.name}
            for d in dampers
        ]  # the pitch of Drake's bushings is the turn about y
    header = "# Written by p3dof: the loops that the URDF beside this file leaves open.\n"
    return header + yaml.safe_dump(
        data, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
    )


def _acting(joint: Joint, smoothing: float) -> dict[str, Any]:
    """Return what motor, counterbalance and friction add in a joint, as `p3dof.loops.JointData` has it."""
    names = ("armature", "force", "stiffness", "damping", "friction")
    found = {name: value for name in names if (value := getattr(joint, name))}
    if joint.friction and smoothing != _SMOOTHING:
        found["smoothing"] = smoothing
    return {"joint": joint.name, **found}


def _origin(parent: ET.Element, placement: Placement) -> None:
    rpy = roll_pitch_yaw(placement.rotation)
    sub(parent, "origin", xyz=numbers(placement.position), rpy=numbers(rpy))


def _link(root: ET.Element, link: Link) -> None:
    element = sub(root, "link", name=link.name)
    if link.body is not None and link.body.mass > 0:
        inertial = sub(element, "inertial")
        _origin(inertial, Placement(link.body.com))
        sub(inertial, "mass", value=numbers(link.body.mass))
        entries = moments(link.body.inertia).items()
        sub(inertial, "inertia", **{name: numbers(value) for name, value in entries})
    for solid in link.visuals:
        sub(_geometry(element, "visual", solid), "material", name=solid.colour.name)
    for solid in link.collisions:
        _geometry(element, "collision", solid)


def _geometry(link: ET.Element, tag: str, solid: Solid) -> ET.Element:
    element = sub(link, tag)
    _origin(element, solid.placement)
    geometry, shape = sub(element, "geometry"), solid.shape
    if isinstance(shape, Box):
        sub(geometry, "box", size=numbers(shape.size))
    elif isinstance(shape, Cylinder):
        sub(geometry, "cylinder", radius=numbers(shape.radius), length=numbers(shape.length))
    else:
        sub(geometry, "sphere", radius=numbers(shape.radius))
    return element


def _joint(root: ET.Element, joint: Joint) -> None:
    element = sub(root, "joint", name=joint.name, type=joint.kind)
    _origin(element, joint.placement)
    sub(element, "parent", link=joint.parent)
    sub(element, "child", link=joint.child)
    if joint.axis is not None and joint.limits is not None:
        names = ("lower", "upper", "effort", "velocity")
        sub(element, "axis", xyz=numbers(joint.axis))
        sub(element, "limit", **{name: numbers(getattr(joint.limits, name)) for name in names})
    if joint.damping or joint.friction:
        sub(element, "dynamics", damping=numbers(joint.damping), friction=numbers(joint.friction))
    if joint.mimic is not None:
        sub(element, "mimic", joint=joint.mimic.joint, multiplier=numbers(joint.mimic.multiplier), offset="0")


def _ros2_control(root: ET.Element, mechanism: Mechanism) -> None:
    """Name the effort interfaces of the actuators; the plugin is the mock that ships with ros2_control."""
    system = sub(root, "ros2_control", name=f"{mechanism.name}_system", type="system")
    sub(sub(system, "hardware"), "plugin", "mock_components/GenericSystem")
    for joint in mechanism.moving:
        if joint.name not in mechanism.actuated or joint.limits is None:
            continue
        element = sub(system, "joint", name=joint.name)
        command = sub(element, "command_interface", name="effort")
        sub(command, "param", numbers(-joint.limits.effort), name="min")
        sub(command, "param", numbers(joint.limits.effort), name="max")
        for interface in ("position", "velocity", "effort"):
            sub(element, "state_interface", name=interface)


NAMESPACE = "http://drake.mit.edu"


def drake(mechanism: Mechanism) -> str:
    """Return a mechanism as URDF with Drake's own elements for the loops.

    The tree is that of `urdf`, without ``<mimic>``: Drake makes coupler constraints of it, which would close
    the parallelogram a second time. Each loop is a ``<drake:ball_constraint>`` between the origins of its two
    frames. Drake keeps them in discrete plants only (a continuous one refuses to move), and neither its
    inverse dynamics nor its mass matrix know of them. What a URDF has no place for is left to the reader:
    gravity, and a weld of the root to the world. Inertia of motors is that of a rotor with a gear of 1. Drake
    has viscous friction alone.

    Drake, "Parsing Models for MultibodyPlant", tag drake:ball_constraint.
    """
    tell_friction(mechanism, "Drake's URDF", ("damping",))
    joints = tuple(replace(joint, mimic=None, friction=0.0) for joint in mechanism.joints)
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

    M. Chignoli, J.-J. Slotine, P. M. Wensing, S. Kim, "URDF+: An Enhanced URDF for Robots with Kinematic
    Loops", arXiv 2411.19753. Element names, attributes and types are those that its parser reads:
    github.com/mit-biomimetics/urdfdom, urdf_parser/src/constraint.cpp and joint.cpp at 0425417; used by
    github.com/ROAM-Lab-ND/generalized_rbda, robot-models/four_bar.urdf at 45fa7c4.
    """
    joints = tuple(replace(joint, mimic=None) for joint in mechanism.joints)
    for joint in joints:
        require_no_drive(joint, "URDF+")
    tell_friction(mechanism, "URDF+", ("damping", "friction"))
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
            _origin(sub(loop, side, link=link), at)
    return document(root, mechanism, "URDF+ (arXiv 2411.19753): the loops are at the end.")


ALL, ACTUATORS = "mechanism", "actuators"
"""The groups: all moving joints, and those with an actuator."""

HOME = "home"
"""The state in which every joint is at 0; all loops are closed."""


def srdf(mechanism: Mechanism) -> str:
    """Return the semantics of a mechanism as SRDF text, for MoveIt and Pinocchio.

    Groups, the home state, the root fixed to the world, the passive joints, and the pairs of neighbours whose
    contacts do not count: those joined by a joint or by a loop closure. SRDF knows no loops.

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

    Without repetition: joints first, then closures, each in their order.
    """

    def carrier(link: str) -> str:
        while link in mechanism.markers:
            link = mechanism.markers[link].parent
        return link

    joined = [(joint.parent, joint.child) for joint in mechanism.moving]
    joined += [(closure.frame1, closure.frame2) for closure in mechanism.closures]
    return list(dict.fromkeys((carrier(one), carrier(other)) for one, other in joined))
