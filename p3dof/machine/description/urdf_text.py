"""URDF, and the sidecar with the loop closures that URDF cannot hold."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

import yaml

from p3dof._base.markup import moments, numbers, roll_pitch_yaw, sub
from p3dof.machine.description.mechanism import Box, Cylinder, Joint, Link, Mechanism, Placement, Solid
from p3dof.machine.description.xml_text import document


def urdf(mechanism: Mechanism) -> str:
    """Return the tree of a mechanism as URDF text: self-contained, primitives only, always the same bytes.

    Numbers have 15 significant digits. The parallelogram's joints mimic each other, for readers that keep no
    loops; ``<ros2_control>`` names the actuators. Links without mass have no ``<inertial>``. The inertia of
    motors and the balances, for which URDF has no place, are in the `sidecar`.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.

    Returns
    -------
    str
    """
    root = urdf_tree(mechanism)
    _ros2_control(root, mechanism)
    return document(root, mechanism, "The loops are in the .yaml beside it.")


def urdf_tree(mechanism: Mechanism) -> ET.Element:
    """Return links and joints as URDF elements, for the formats that add to them.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.

    Returns
    -------
    Element
        ``<robot>``.
    """
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
        actuated joints; ``joint_data``: inertia of motors and screws, and balances, if there are any.
    """
    data: dict[str, Any] = {
        "closed_loop": [[closure.frame1, closure.frame2] for closure in mechanism.closures],
        "type": ["3d"] * len(mechanism.closures),
        "name_mot": list(mechanism.actuated),
    }
    drives = [_drive(joint) for joint in mechanism.moving if joint.armature or joint.balanced]
    if drives:
        data["joint_data"] = drives
    header = "# Written by p3dof: the loops that the URDF beside this file leaves open.\n"
    return header + yaml.safe_dump(
        data, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
    )


def _drive(joint: Joint) -> dict[str, Any]:
    """Return what motor and balance add in a joint, as `p3dof.loops.JointData` has it."""
    values = {"armature": joint.armature, "force": joint.force, "stiffness": joint.stiffness}
    return {"joint": joint.name, **{key: value for key, value in values.items() if value}}


def _origin(parent: ET.Element, placement: Placement) -> None:
    rpy = roll_pitch_yaw(placement.rotation)
    sub(parent, "origin", xyz=numbers(placement.position), rpy=numbers(rpy))


def _link(root: ET.Element, link: Link) -> None:
    element = sub(root, "link", name=link.name)
    if link.body is not None and link.body.mass > 0:
        inertial = sub(element, "inertial")
        _origin(inertial, Placement(link.body.com))
        sub(inertial, "mass", value=numbers(link.body.mass))
        sub(
            inertial,
            "inertia",
            **{name: numbers(value) for name, value in moments(link.body.inertia).items()},
        )
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
