"""SDF, which holds the loops itself: as joints to a link that another joint already leads to."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from p3dof._base.errors import ModelError
from p3dof._base.markup import VERSION, check_names, inertial, joint_between, numbers, roll_pitch_yaw, sub
from p3dof.machine.description.mechanism import (
    Box,
    Colour,
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
from p3dof.machine.parameters import Body


def sdf(mechanism: Mechanism) -> str:
    """Return a mechanism as a model in SDF, with its loops.

    Each loop is a joint of type ball between its two frames, whose child already has a joint. Markers are
    ``<frame>`` elements; their masses are part of the link that carries them, which moves as before. A fixed
    joint holds the root in the world. No gravity is written: in SDF the world has it, not the model.
    """
    anchor = f"{mechanism.links[0].name}_fixed"
    names = [anchor, *(link.name for link in mechanism.links), *(joint.name for joint in mechanism.joints)]
    check_names([*names, *(closure.name for closure in mechanism.closures)])
    for joint in mechanism.joints:
        if joint.armature or not joint.stiffness:
            require_no_drive(joint, "SDF")
    tell_friction(mechanism, "SDF", ("damping", "friction"))
    frames = _frames(mechanism)
    bodies = _bodies(mechanism, frames)
    placed = {joint.child: joint.name for joint in mechanism.joints}
    root = ET.Element("sdf", version=VERSION)
    model = sub(root, "model", name=mechanism.name, canonical_link=mechanism.links[0].name)
    for link in mechanism.links:
        if link.name not in frames:
            _link(model, link, placed.get(link.name), bodies[link.name])
    joint_between(model, anchor, "fixed", "world", mechanism.links[0].name)
    for joint in mechanism.joints:
        if joint.child in frames:
            frame = sub(model, "frame", name=joint.child, attached_to=joint.parent)
            _pose(frame, joint.placement, joint.parent)
        else:
            element = joint_between(model, joint.name, joint.kind, joint.parent, joint.child)
            _pose(element, joint.placement, joint.parent)
            _axis(element, joint)
    for closure in mechanism.closures:
        joint_between(model, closure.name, "ball", closure.frame1, closure.frame2)
    return document(root, mechanism, "Gravity belongs to the world that this model is put in.")


def _frames(mechanism: Mechanism) -> set[str]:
    """Return the links that are no more than frames: fixed to another one, without solids."""
    solid = {link.name for link in mechanism.links if link.visuals or link.collisions}
    return set(mechanism.markers) - solid


def _bodies(mechanism: Mechanism, frames: set[str]) -> dict[str, Body]:
    """Return the bodies of the links, each with what the frames on it weigh."""
    bodies = {link.name: link.body for link in mechanism.links if link.body is not None}
    bodies = {name: body for name, body in bodies.items() if body.mass > 0}
    for joint in reversed(mechanism.joints):  # a frame may be on a frame
        if joint.child in frames and joint.child in bodies:
            part = _moved(bodies.pop(joint.child), joint.placement)
            bodies[joint.parent] = _joined(bodies[joint.parent], part) if joint.parent in bodies else part
    for link in mechanism.links:
        if link.name not in frames and link.name not in bodies:
            raise ModelError(f"SDF: expected a mass of every link, got none of {link.name!r}")
    return bodies


def _moved(body: Body, placement: Placement) -> Body:
    """Return a body of a placed frame, seen from where that frame is placed."""
    R = placement.rotation
    return Body(body.mass, placement.position + R @ body.com, R @ body.inertia @ R.T)


def _joined(one: Body, two: Body) -> Body:
    """Return two bodies as one."""
    mass = one.mass + two.mass
    com = (one.mass * one.com + two.mass * two.com) / mass
    return Body(mass, com, one.inertia_about(com) + two.inertia_about(com))


def _pose(parent: ET.Element, placement: Placement, frame: str | None = None) -> None:
    """Write a pose, in a named frame or in that of the element that holds it."""
    text = numbers(placement.position, roll_pitch_yaw(placement.rotation))
    attributes = {} if frame is None else {"relative_to": frame}
    sub(parent, "pose", text, **attributes)


def _link(model: ET.Element, link: Link, joint: str | None, body: Body) -> None:
    element = sub(model, "link", name=link.name)
    _pose(element, Placement(), joint)
    inertial(element, body.mass, body.com, body.inertia)
    for number, solid in enumerate(link.visuals, start=1):
        _material(_geometry(element, "visual", f"{link.name}_visual_{number}", solid), solid.colour)
    for number, solid in enumerate(link.collisions, start=1):
        _geometry(element, "collision", f"{link.name}_collision_{number}", solid)


def _geometry(link: ET.Element, tag: str, name: str, solid: Solid) -> ET.Element:
    element = sub(link, tag, name=name)
    _pose(element, solid.placement)
    geometry, shape = sub(element, "geometry"), solid.shape
    if isinstance(shape, Box):
        sub(sub(geometry, "box"), "size", numbers(shape.size))
    elif isinstance(shape, Cylinder):
        cylinder = sub(geometry, "cylinder")
        sub(cylinder, "radius", numbers(shape.radius))
        sub(cylinder, "length", numbers(shape.length))
    else:
        sub(sub(geometry, "sphere"), "radius", numbers(shape.radius))
    return element


def _material(visual: ET.Element, colour: Colour) -> None:
    material = sub(visual, "material")
    for light in ("ambient", "diffuse"):
        sub(material, light, numbers(colour.rgba))


def _axis(element: ET.Element, joint: Joint) -> None:
    if joint.axis is None or joint.limits is None:
        return
    axis = sub(element, "axis")
    sub(axis, "xyz", numbers(joint.axis))
    limit = sub(axis, "limit")
    for name in ("lower", "upper", "effort", "velocity"):
        sub(limit, name, numbers(getattr(joint.limits, name)))
    acting = {"damping": joint.damping, "friction": joint.friction}
    if joint.stiffness:
        acting["spring_reference"] = joint.force / joint.stiffness
        acting["spring_stiffness"] = joint.stiffness
    if any(acting.values()):
        dynamics = sub(axis, "dynamics")
        for name, value in acting.items():
            if value or name.startswith("spring"):
                sub(dynamics, name, numbers(value))
