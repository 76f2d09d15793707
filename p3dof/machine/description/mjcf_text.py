"""MJCF, the format of MuJoCo, with the loop closures in it."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof._base.markup import moments, mujoco, numbers, sub
from p3dof.machine.description.mechanism import (
    Box,
    Cylinder,
    Joint,
    Link,
    Mechanism,
    Placement,
    Solid,
    document,
    tell_friction,
)
from p3dof.machine.parameters import Body

_RANK = 1e-9
"""Relative size of the singular values that are zero: closures in space of a planar loop are redundant."""


def mjcf(mechanism: Mechanism) -> str:
    """Return a mechanism as MJCF text: one base body with all others below it, loops and motors included.

    Links and joints have the names that they have in the URDF; markers are bodies without a joint. The loops
    are ``<connect>`` equalities, as stiff as the step allows: with Runge-Kutta the gaps stay near 1e-8 m,
    where MuJoCo's defaults leave a millimetre. Its Euler and implicit integrators diverge at this stiffness.
    Solids that are drawn are in group 2, those that must not touch in group 3, and none has a mass. The
    keyframe ``home`` is at rest under its own forces. A joint that mimics another one is left to the loops.
    Inertia of motors is ``armature``, friction ``damping`` and ``frictionloss``. A counterbalance is the
    joint's spring with its ``springref``; one of constant force compensates as much of the body's gravity
    (``gravcomp``). These are passive forces: inverse dynamics counts them, and they take nothing of the
    motors' limits.
    """
    links = {link.name: link for link in mechanism.links}
    for joint in mechanism.moving:
        body = links[joint.child].body
        if body is None or body.mass == 0:
            raise ModelError(f"MJCF: expected a mass for every moving link, {joint.child!r} has none")
    tell_friction(mechanism, "MJCF", ("damping", "friction"))
    root, defaults = mujoco(mechanism.name, mechanism.gravity)
    _defaults(defaults)
    _materials(root, mechanism)
    _bodies(root, mechanism, links)
    _closures(root, mechanism)
    _motors(root, mechanism)
    home, held = numbers(np.zeros(len(mechanism.moving))), numbers(holding_forces(mechanism))
    sub(sub(root, "keyframe"), "key", name="home", qpos=home, ctrl=held)
    return document(root, mechanism, "The loops are in its equality constraints.")


def holding_forces(mechanism: Mechanism) -> FloatArray:
    """Return the actuator forces that hold a mechanism at home against gravity, besides its counterbalances.

    Forces of the actuated joints, in their order [N or N m]; the smallest if there is a choice.
    """
    places = _home(mechanism)
    above: dict[str, list[int]] = {mechanism.links[0].name: []}  # the moving joints that move a link
    axes: list[FloatArray] = []
    origins: list[FloatArray] = []
    for joint in mechanism.joints:
        above[joint.child] = list(above[joint.parent])
        if joint.axis is not None:
            above[joint.child].append(len(axes))
            axes.append(places[joint.child].rotation @ joint.axis)
            origins.append(places[joint.child].position)
    slides = [joint.kind == "prismatic" for joint in mechanism.moving]

    def jacobian(link: str, point: FloatArray) -> FloatArray:
        """Return the velocity of a point on a link for each joint velocity, (3, joints)."""
        J = np.zeros((3, len(axes)))
        for i in above[link]:
            J[:, i] = axes[i] if slides[i] else np.cross(axes[i], point - origins[i])
        return J

    load = np.zeros(len(axes))
    for link in mechanism.links:
        if link.body is not None:
            place = places[link.name]
            center = place.position + place.rotation @ link.body.com
            load += jacobian(link.name, center).T @ (link.body.mass * mechanism.gravity)
    names = [joint.name for joint in mechanism.moving]
    columns = [np.eye(len(axes))[:, [names.index(name) for name in mechanism.actuated]]]
    for closure in mechanism.closures:
        point = places[closure.frame1].position
        columns.append((jacobian(closure.frame1, point) - jacobian(closure.frame2, point)).T)
    balance = np.linalg.lstsq(np.hstack(columns), -load, rcond=_RANK)[0]  # [B Jᵀ] [f; λ] = -Q
    taken_over = [next(j.force for j in mechanism.moving if j.name == name) for name in mechanism.actuated]
    return np.asarray(balance[: len(mechanism.actuated)] - taken_over, dtype=float)


def _home(mechanism: Mechanism) -> dict[str, Placement]:
    """Return where the links are when all joints are at zero."""
    places = {mechanism.links[0].name: Placement()}
    for joint in mechanism.joints:
        parent, own = places[joint.parent], joint.placement
        position = parent.position + parent.rotation @ own.position
        places[joint.child] = Placement(position, parent.rotation @ own.rotation)
    return places


def _defaults(defaults: ET.Element) -> None:
    drawn = {"group": "2", "contype": "0", "conaffinity": "0"}
    for name, attributes in (("visual", drawn), ("collision", {"group": "3"})):
        sub(sub(defaults, "default", **{"class": name}), "geom", **attributes, mass="0")


def _materials(root: ET.Element, mechanism: Mechanism) -> None:
    assets = sub(root, "asset")
    colours = {solid.colour.name: solid.colour for link in mechanism.links for solid in link.visuals}
    for name, colour in sorted(colours.items()):
        sub(assets, "material", name=name, rgba=numbers(colour.rgba))


def _bodies(root: ET.Element, mechanism: Mechanism, links: Mapping[str, Link]) -> None:
    base = mechanism.links[0]
    elements = {base.name: sub(sub(root, "worldbody"), "body", name=base.name)}
    _contents(elements[base.name], base)
    for joint in mechanism.joints:
        element = sub(elements[joint.parent], "body", name=joint.child, **_pose(joint.placement))
        elements[joint.child] = element
        _contents(element, links[joint.child], joint)
        if joint.force and not joint.stiffness:
            element.set("gravcomp", numbers(_compensation(joint, links[joint.child], mechanism.gravity)))


def _compensation(joint: Joint, link: Link, gravity: FloatArray) -> float:
    """Return which share of a body's gravity to compensate so that its slide gets a constant force."""
    weight = 0.0
    if link.body is not None and joint.kind == "prismatic" and joint.axis is not None:
        weight = -link.body.mass * float(gravity @ joint.placement.rotation @ joint.axis)
    if not weight or joint.force / weight < 0:
        raise ModelError(
            f"MJCF: {joint.name}: a constant force of {joint.force:g} N: MuJoCo has only those against the "
            "gravity of the body on the joint, or with a spring"
        )
    return joint.force / weight


def _contents(element: ET.Element, link: Link, joint: Joint | None = None) -> None:
    """Fill in what belongs to a body: its joint, mass and solids."""
    if joint is not None and joint.axis is not None and joint.limits is not None:
        kind = "slide" if joint.kind == "prismatic" else "hinge"
        sub(
            element,
            "joint",
            name=joint.name,
            type=kind,
            axis=numbers(joint.axis),
            range=numbers(joint.limits.lower, joint.limits.upper),
            actuatorfrcrange=numbers(-joint.limits.effort, joint.limits.effort),
            **_drive(joint),
        )
    if link.body is not None and link.body.mass > 0:
        mass = {"pos": numbers(link.body.com), "mass": numbers(link.body.mass)}
        sub(element, "inertial", **mass, **_inertia(link.body))
    for solid in link.visuals:
        _geom(element, "visual", solid, material=solid.colour.name)
    for solid in link.collisions:
        _geom(element, "collision", solid)


def _drive(joint: Joint) -> dict[str, str]:
    """Return what motor, spring and friction add, as attributes of a joint."""
    found = {"armature": joint.armature, "stiffness": joint.stiffness}
    found |= {"damping": joint.damping, "frictionloss": joint.friction}
    if joint.stiffness:
        found["springref"] = joint.force / joint.stiffness
    return {name: numbers(value) for name, value in found.items() if value}


def _inertia(body: Body) -> dict[str, str]:
    # MuJoCo diagonalises a full matrix, and then refuses moments below 1e-14.
    inertia = moments(body.inertia)
    across = [inertia[name] for name in ("ixy", "ixz", "iyz")]
    along = [inertia[name] for name in ("ixx", "iyy", "izz")]
    return {"fullinertia": numbers(along, across)} if any(across) else {"diaginertia": numbers(along)}


def _geom(element: ET.Element, kind: str, solid: Solid, **attributes: str) -> None:
    shape = solid.shape
    if isinstance(shape, Box):
        form, size = "box", [edge / 2 for edge in shape.size]
    elif isinstance(shape, Cylinder):
        form, size = "cylinder", [shape.radius, shape.length / 2]
    else:
        form, size = "sphere", [shape.radius]
    pose = _pose(solid.placement)
    sub(element, "geom", **{"class": kind}, type=form, size=numbers(size), **pose, **attributes)


def _pose(placement: Placement) -> dict[str, str]:
    pose = {"pos": numbers(placement.position)}
    if np.any(placement.rotation != np.eye(3)):
        pose["xyaxes"] = numbers(placement.rotation[:, 0], placement.rotation[:, 1])
    return pose


def _closures(root: ET.Element, mechanism: Mechanism) -> None:
    closures = sub(root, "equality")
    for closure in mechanism.closures:
        # Not between the markers: Pinocchio 4.1 misplaces an anchor on a body that has no joint.
        (body1, anchor), (body2, _) = (_carrier(mechanism, name) for name in (closure.frame1, closure.frame2))
        sub(closures, "connect", name=closure.name, body1=body1, body2=body2, anchor=numbers(anchor))


def _carrier(mechanism: Mechanism, frame: str) -> tuple[str, FloatArray]:
    """Return the moving link or root that a frame is fixed to, and where on it the frame's origin is."""
    position: FloatArray = np.zeros(3)
    while joint := mechanism.markers.get(frame):
        position = joint.placement.position + joint.placement.rotation @ position
        frame = joint.parent
    return frame, position


def _motors(root: ET.Element, mechanism: Mechanism) -> None:
    motors = sub(root, "actuator")
    joints = {joint.name: joint for joint in mechanism.moving}
    for name in mechanism.actuated:
        if (limits := joints[name].limits) is not None:
            sub(motors, "motor", name=name, joint=name, ctrlrange=numbers(-limits.effort, limits.effort))
