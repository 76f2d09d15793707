"""URDF, and the sidecar with the loop closures that URDF cannot hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from xml.sax.saxutils import quoteattr

import numpy as np
import yaml

from p3dof.checks import FloatArray
from p3dof.description.mechanism import Box, Cylinder, Joint, Link, Mechanism, Placement, Shape, Solid
from p3dof.parameters import Body

_GIMBAL = 1e-12
"""Cosine of the pitch below which roll and yaw turn about the same axis."""


def urdf(mechanism: Mechanism) -> str:
    """Return the tree of a mechanism as URDF text: self-contained, primitives only, always the same bytes.

    Numbers have 15 significant digits. Links without mass have no ``<inertial>``.

    Parameters
    ----------
    mechanism : Mechanism
        What to write.

    Returns
    -------
    str
    """
    colours = {
        solid.colour.name: solid.colour
        for link in mechanism.links
        for solid in (*link.visuals, *link.collisions)
    }
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Written by p3dof: change the parameters, not this file. The loops are in the .yaml. -->",
        f"<robot name={quoteattr(mechanism.name)}>",
    ]
    for name, colour in sorted(colours.items()):
        lines.append(f'  <material name={quoteattr(name)}><color rgba="{numbers(colour.rgba)}"/></material>')
    for link in mechanism.links:
        lines += _link(link)
    for joint in mechanism.joints:
        lines += _joint(joint)
    return "\n".join([*lines, "</robot>", ""])


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
        actuated joints.
    """
    data = {
        "closed_loop": [[closure.frame1, closure.frame2] for closure in mechanism.closures],
        "type": ["3d"] * len(mechanism.closures),
        "name_mot": list(mechanism.actuated),
    }
    header = "# Written by p3dof: the loops that the URDF beside this file leaves open.\n"
    return header + yaml.safe_dump(
        data, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
    )


def numbers(values: Iterable[float]) -> str:
    """Return numbers with 15 significant digits, separated by spaces; no negative zero.

    Parameters
    ----------
    values : iterable of float
        The numbers.

    Returns
    -------
    str
    """
    return " ".join(f"{float(value) + 0.0:.15g}" for value in values)


def roll_pitch_yaw(rotation: FloatArray) -> tuple[float, float, float]:
    """Return the angles of a rotation about the fixed axes x, then y, then z: R = Rz(yaw) Ry(pitch) Rx(roll).

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        Rotation matrix.

    Returns
    -------
    roll, pitch, yaw : float
        Angles [rad]; yaw is zero where the pitch is ±90°.
    """
    R = rotation
    cosine = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cosine)
    if cosine < _GIMBAL:
        return math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def _origin(placement: Placement) -> str:
    rpy = roll_pitch_yaw(placement.rotation)
    return f'<origin xyz="{numbers(placement.position)}" rpy="{numbers(rpy)}"/>'


def _link(link: Link) -> Iterator[str]:
    content: list[str] = []
    if link.body is not None and link.body.mass > 0:
        content += _inertial(link.body)
    for solid in link.visuals:
        content += _geometry("visual", solid, f"<material name={quoteattr(solid.colour.name)}/>")
    for solid in link.collisions:
        content += _geometry("collision", solid)
    if content:
        yield f"  <link name={quoteattr(link.name)}>"
        yield from content
        yield "  </link>"
    else:
        yield f"  <link name={quoteattr(link.name)}/>"


def _inertial(body: Body) -> Iterator[str]:
    moments = (body.inertia + body.inertia.T) / 2
    # What is left of a zero after rounding would differ between machines.
    moments = np.where(np.abs(moments) < 1e-15 * np.abs(moments).max(), 0.0, moments)
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    yield "    <inertial>"
    yield f"      {_origin(Placement(body.com))}"
    yield f'      <mass value="{numbers([body.mass])}"/>'
    values = " ".join(f'{name}="{numbers([moments[at]])}"' for name, at in names.items())
    yield f"      <inertia {values}/>"
    yield "    </inertial>"


def _geometry(tag: str, solid: Solid, rest: str = "") -> Iterator[str]:
    yield f"    <{tag}>"
    yield f"      {_origin(solid.placement)}"
    yield f"      <geometry>{_shape(solid.shape)}</geometry>"
    if rest:
        yield f"      {rest}"
    yield f"    </{tag}>"


def _shape(shape: Shape) -> str:
    if isinstance(shape, Box):
        return f'<box size="{numbers(shape.size)}"/>'
    if isinstance(shape, Cylinder):
        return f'<cylinder radius="{numbers([shape.radius])}" length="{numbers([shape.length])}"/>'
    return f'<sphere radius="{numbers([shape.radius])}"/>'


def _joint(joint: Joint) -> Iterator[str]:
    yield f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">'
    yield f"    {_origin(joint.placement)}"
    yield f"    <parent link={quoteattr(joint.parent)}/>"
    yield f"    <child link={quoteattr(joint.child)}/>"
    if joint.axis is not None and joint.limits is not None:
        values = " ".join(
            f'{name}="{numbers([getattr(joint.limits, name)])}"'
            for name in ("lower", "upper", "effort", "velocity")
        )
        yield f'    <axis xyz="{numbers(joint.axis)}"/>'
        yield f"    <limit {values}/>"
    yield "  </joint>"
