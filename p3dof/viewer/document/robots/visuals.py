"""The visible shapes that a robot's own file gives to its links: URDF by yourdfpy, MJCF by MuJoCo."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import LARGEST, one_line
from p3dof._base.errors import MissingExtraError
from p3dof.loops.formats.mjcf_geoms import geoms
from p3dof.loops.xml_text import XmlReader, is_text, read_xml, root_of

MAX_SHAPES = 2000
"""Most shapes of a robot."""

_SIZES = {"box": 3, "cylinder": 2, "sphere": 1, "mesh": 3}
"""How many measures each kind of a URDF has."""


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape on a body.

    Parameters
    ----------
    joint : int
        The joint that carries it.
    placement : pin.SE3
        Where it is in the axes of the joint.
    kind : str
        ``"box"``, ``"cylinder"``, ``"sphere"``, ``"capsule"``, ``"ellipsoid"`` or ``"mesh"``.
    size : tuple of float
        Edges; radius and length; radius; radius and length; radii; or the scale of a mesh [m].
    mesh : str
        What the file calls the mesh.
    colour : tuple of float, optional
        Red, green, blue and opacity, from 0 to 1.
    """

    joint: int
    placement: pin.SE3
    kind: str
    size: tuple[float, ...]
    mesh: str = ""
    colour: tuple[float, ...] | None = None


def visuals_of(model: pin.Model, source: str | os.PathLike[str]) -> tuple[list[Visual], list[str]]:
    """Return the shapes that a robot's file has, and what could not be understood.

    Parameters
    ----------
    model : pin.Model
        The tree that was read from it.
    source : str or path-like
        The path of the file, or its text.

    Returns
    -------
    list of Visual
    list of str
        One line each.

    Raises
    ------
    ModelError
        If the file is malformed or too large.
    MissingExtraError
        If the library for it is not installed.
    """
    text, name = read_xml(source, "robot")
    found = _of_mjcf(model, source, text) if root_of(text, name) == "mujoco" else _of_urdf(model, text, name)
    return found[0][:MAX_SHAPES], found[1]


def folder_of(source: str | os.PathLike[str]) -> Path | None:
    """Return the folder of a robot's file; None for text."""
    return None if is_text(source) else Path(source).parent


def _of_urdf(model: pin.Model, text: str, name: str) -> tuple[list[Visual], list[str]]:
    robot = XmlReader(name).parse(text)
    if robot.find("link/visual") is None:
        return [], []
    try:
        import yourdfpy
    except ImportError as error:
        raise MissingExtraError("shapes of a URDF need yourdfpy: pip install 'p3dof[shapes]'") from error
    materials = robot.findall("material")
    found: list[Visual] = []
    left_out: list[str] = []
    for link in robot.findall("link"):
        name = link.get("name", "")
        if model.existFrame(name, pin.FrameType.BODY):
            frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
            for visual in link.findall("visual")[: MAX_SHAPES - len(found)]:
                shape = _shape(yourdfpy, materials, visual, frame)
                if isinstance(shape, Visual):
                    found.append(shape)
                else:
                    left_out.append(f"{one_line(name, 80)}: {shape}")
    return found, left_out


def _shape(
    yourdfpy: Any, materials: list[Xml.Element], visual: Xml.Element, frame: pin.Frame
) -> Visual | str:
    """Return a shape as yourdfpy reads it, or what is wrong with it."""
    plain = Xml.Element("robot", name="robot")
    wanted = [material.get("name") for material in visual.findall("material")]
    plain.extend([one for one in materials if one.get("name") in wanted][:1])
    Xml.SubElement(plain, "link", name="link").append(visual)
    content = io.BytesIO(Xml.tostring(plain, encoding="utf-8"))
    try:
        read = yourdfpy.URDF.load(content, build_scene_graph=False, load_meshes=False).robot
        named = {material.name: material for material in read.materials}
        return _translated(read.links[0].visuals[0], frame, named) or "a shape that is not understood"
    except Exception as error:  # yourdfpy raises whatever Python does with what it did not expect
        words = one_line(str(error), 120) or type(error).__name__
        return f"yourdfpy cannot read its shape ({words})"


def _translated(visual: Any, frame: pin.Frame, materials: dict[str, Any]) -> Visual | None:
    """Return a shape as yourdfpy has it on a link; None if there is none that is known."""
    origin = np.eye(4) if visual.origin is None else np.asarray(visual.origin, dtype=float)
    place = frame.placement * pin.SE3(origin[:3, :3], origin[:3, 3])
    geometry = visual.geometry
    if geometry is None:
        return None
    colour = _colour(visual.material, materials)
    kind, mesh, size = "", "", None
    if geometry.box is not None:
        kind, size = "box", tuple(np.ravel(geometry.box.size))
    elif geometry.cylinder is not None:
        kind, size = "cylinder", (geometry.cylinder.radius, geometry.cylinder.length)
    elif geometry.sphere is not None:
        kind, size = "sphere", (geometry.sphere.radius,)
    elif geometry.mesh is not None:
        scale = 1.0 if geometry.mesh.scale is None else geometry.mesh.scale
        kind, mesh, size = "mesh", str(geometry.mesh.filename), tuple(np.broadcast_to(scale, 3))
    if size is None or len(size) != _SIZES[kind]:
        return None
    if not np.all(np.abs(np.array([*size, *origin.ravel()], dtype=float)) < LARGEST):
        return None
    return Visual(int(frame.parentJoint), place, kind, tuple(float(x) for x in size), mesh, colour)


def _colour(material: Any, materials: dict[str, Any]) -> tuple[float, ...] | None:
    """Return the colour of a material, or of the one of its name."""
    for one in (material, None if material is None else materials.get(material.name)):
        if one is not None and one.color is not None:
            rgba = np.clip(np.asarray(one.color.rgba, dtype=float).ravel(), 0.0, 1.0)
            if len(rgba) == 4 and np.isfinite(rgba).all():
                return tuple(rgba.tolist())
    return None


def _of_mjcf(model: pin.Model, source: str | os.PathLike[str], text: str) -> tuple[list[Visual], list[str]]:
    sizes: dict[str, Callable[[Any], tuple[float, ...]]] = {
        "box": lambda s: tuple(2 * s),
        "cylinder": lambda s: (s[0], 2 * s[1]),
        "capsule": lambda s: (s[0], 2 * s[1]),
        "sphere": lambda s: (s[0],),
        "ellipsoid": tuple,
    }
    found = []
    for geom in geoms(source):
        if geom.joint == "universe" or model.existJointName(geom.joint):
            joint = 0 if geom.joint == "universe" else int(model.getJointId(geom.joint))
            size = tuple(float(x) for x in sizes[geom.kind](geom.size))
            found.append(Visual(joint, geom.placement, geom.kind, size, "", tuple(geom.rgba.tolist())))
    return found, ["meshes of an MJCF are not shown"] if "<mesh" in text else []
