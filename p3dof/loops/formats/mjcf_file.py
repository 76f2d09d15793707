"""MJCF files as MuJoCo compiles them, whether their meshes and textures are at hand or not."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from warnings import warn
from xml.etree import ElementTree as Xml

import numpy as np

from p3dof._base.checks import LARGEST, one_line, shown
from p3dof._base.errors import MissingExtraError, ModelError, ModelWarning
from p3dof.loops.xml_text import Macros, XmlReader, check_includes, is_text, read_xml

_EXTRA = "MJCF files are compiled by MuJoCo: pip install 'p3dof[mjcf]'"


def compiled(source: str | os.PathLike[str], include_root: str | os.PathLike[str] | None = None) -> Any:
    """Return MuJoCo's model of a file."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError(_EXTRA) from error
    text, name = read_xml(source, "MJCF")
    robot = XmlReader(name).parse(text)
    if robot.tag != "mujoco":
        raise ModelError(f"{name}: expected the element <mujoco>, got <{robot.tag:.80}>")
    check_includes(robot, source, name, include_root)
    _check_numbers(robot, name)
    missing: list[tuple[str, str]] = []
    try:
        whole = is_text(source) or isinstance(source, Macros)
        spec = mujoco.MjSpec.from_string(text) if whole else mujoco.MjSpec.from_file(name)
        missing = _without_files(mujoco, spec)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = spec.compile()
    except Exception as error:  # ValueError, and what MuJoCo's bindings raise beside it
        message = f"{name}: MuJoCo cannot compile it: {one_line(str(error))}"
        if missing and "mass" in str(error):
            meshes = _listed(mesh for mesh, _ in missing)
            message += f"; the files of meshes are missing ({meshes}), and so is what they weigh"
        raise ModelError(message) from error
    for one in told:
        warn(f"{name}: MuJoCo: {one_line(str(one.message))}", ModelWarning, stacklevel=4)
    for field in ("body_mass", "body_inertia", "body_pos", "body_ipos", "jnt_pos", "dof_armature", "eq_data"):
        numbers = getattr(found, field)
        if not np.all(np.abs(numbers) < LARGEST):  # also what is not a number
            raise ModelError(f"{name}: MuJoCo compiles numbers that are too large, or none, into {field}")
    if missing:
        meshes, bodies = (_listed(names) for names in zip(*missing, strict=True))
        message = f"{name}: meshes are missing ({meshes}): what they weigh is not in the inertia of {bodies}"
        warn(message, ModelWarning, stacklevel=4)
    return found


def _listed(names: Iterable[str]) -> str:
    all_ = list(dict.fromkeys(names))
    return ", ".join(map(shown, all_[:4])) + (", ..." if len(all_) > 4 else "")


def _check_numbers(robot: Xml.Element, name: str) -> None:
    """Refuse NaN: MuJoCo only warns of it, and in MuJoCo 4.0 such a warning can go on for ever."""
    for element in robot.iter():
        for attribute, text in element.attrib.items():
            if (
                any(word.lower().lstrip("+-").startswith("nan") for word in text.split())
                and attribute != "name"
            ):
                raise ModelError(
                    f"{name}: <{element.tag:.80}> {attribute:.80}: expected numbers, got {shown(text)}"
                )


def _without_files(mujoco: Any, spec: Any) -> list[tuple[str, str]]:
    """Take out what only shows, and what is not there; return the missing meshes that weigh, and of what."""
    kinds = mujoco.mjtGeom
    from_file = {kinds.mjGEOM_MESH, kinds.mjGEOM_SDF, kinds.mjGEOM_HFIELD}
    there = {mesh.name for mesh in spec.meshes if _is_there(spec, mesh)}
    missing: list[tuple[str, str]] = []
    declared = {mesh.name for mesh in spec.meshes}
    for geom in list(spec.geoms):
        geom.material = ""
        if geom.type not in from_file and not geom.meshname:
            continue
        if not _weighs(spec, geom):
            _delete(spec, geom)
        elif geom.meshname in declared - there:
            missing.append((geom.meshname, geom.parent.name))
            _delete(spec, geom)
    for site in spec.sites:
        site.material = ""
    weighed = {geom.meshname for geom in spec.geoms}
    meshes = [mesh for mesh in spec.meshes if mesh.name not in weighed]
    for asset in (*spec.skins, *spec.materials, *spec.textures, *spec.hfields, *meshes):
        _delete(spec, asset)
    return missing


def _weighs(spec: Any, geom: Any) -> bool:
    """Whether the mass of a geom belongs to a body that moves."""
    if geom.mass == 0 or (np.isnan(geom.mass) and geom.density == 0):
        return False
    first, last = spec.compiler.inertiagrouprange
    if not first <= geom.group <= last:
        return False
    body = geom.parent
    if body.name == "world" or (body.explicitinertial and spec.compiler.inertiafromgeom != 1):
        return False
    while body is not None and body.name != "world":
        if body.joints:
            return True
        body = body.parent
    return False


def _is_there(spec: Any, mesh: Any) -> bool:
    """Whether a mesh needs no file, or its file is there."""
    if not mesh.file:
        return True
    file = Path(mesh.file)
    if spec.strippath:
        file = Path(file.name)
    return bool((Path(spec.modelfiledir) / spec.meshdir / file).is_file())


def _delete(spec: Any, element: Any) -> None:
    if hasattr(spec, "delete"):
        spec.delete(element)
    else:  # before MuJoCo 3.3.3
        element.delete()
