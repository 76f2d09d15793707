"""The visible shapes that a robot's own file gives to its links, and the mesh files that it names.

A file of somebody else may name any path. Only regular files inside of given folders are opened, wherever
links lead, and read within bounds; what a mesh refers to itself (materials, images) is not looked for.
"""

from __future__ import annotations

import io
import logging
import os
import re
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import LARGEST, FloatArray, one_line, shown
from p3dof._base.errors import FileError, InputError, MissingExtraError, ModelError, P3dofError
from p3dof._base.files import read_bytes
from p3dof.loops.formats.mjcf import geoms
from p3dof.loops.xml_text import XmlReader, is_text, read_xml, root_of

if TYPE_CHECKING:
    from p3dof.loops.formats.sdf_file import Item, SdfRobot, SdfText

SUFFIXES = (".stl", ".obj", ".ply", ".dae", ".off")
"""The endings of mesh files that are read."""
MAX_MESH = 40_000_000
"""Largest mesh file [bytes]."""
MAX_MESHES = 200_000_000
"""Most bytes of all mesh files of a robot, whether they can be read or not."""
MAX_FACES = 600_000
"""Most triangles of all meshes of a robot: that is tens of megabytes in a page."""
_MAX_COPIES = 400_000_000
"""Most bytes of a Collada file, counted once for each instance of a geometry in it."""
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_ENCODING = re.compile(r"""<\?xml[^>]*encoding\s*=\s*["'](?!utf-?8["'])([^"']*)""", re.IGNORECASE)
"""An XML declaration of another encoding: another reader would read other text than was checked."""
_GREY = (0.7, 0.7, 0.72, 1.0)


@dataclass(frozen=True, eq=False)
class Skin:
    """Triangles with colours."""

    corners: FloatArray  # (N, 3, 3): the corners of each [m]
    colours: FloatArray  # (N, 3): red, green and blue of each, from 0 to 1

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest coordinates, (3,) each [m]."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)


class MeshFiles:
    """The mesh files that a robot's file may name."""

    def __init__(
        self, folder: str | os.PathLike[str] | None, package_dirs: Iterable[str | os.PathLike[str]] = ()
    ) -> None:
        self._folders = [*_folders(package_dirs), *([] if folder is None else [Path(folder).resolve()])]
        self._own = None if folder is None else Path(folder).resolve()
        self._faces = self._bytes = 0
        self._known: dict[Path, Skin] = {}

    def find(self, name: str) -> Path:
        """Return the file that a name stands for.

        A regular file inside of one of the folders, links resolved.
        """
        package = name.removeprefix("package://").lstrip("/") if name.startswith("package://") else None
        inner = PurePosixPath(name if package is None else package)
        if (package is None and (_SCHEME.match(name) or inner.is_absolute())) or "\\" in name or "\0" in name:
            raise FileError(f"{_short(name)}: only package:// and relative paths are read")
        if inner.suffix.lower() not in SUFFIXES:
            raise FileError(f"{_short(name)}: expected a mesh that ends in {', '.join(SUFFIXES)}")
        outside = False
        for candidate in self._candidates(inner, package is not None):
            path, inside = self._resolved(candidate)
            if inside and path is not None:
                return path
            outside = outside or path is not None
        where = (
            "outside of the folders given" if outside or ".." in inner.parts else "not in the folders given"
        )
        raise FileError(f"{_short(name)}: {where}")

    def _resolved(self, candidate: Path) -> tuple[Path | None, bool]:
        """Return the file that a path leads to, if there is one, and whether it is inside of the folders."""
        try:
            path = candidate.resolve()
            inside = any(path.is_relative_to(folder) for folder in self._folders)
            return (path if path.is_file() else None), inside
        except (OSError, RuntimeError, ValueError):  # a ring of links, a name that is too long
            return None, False

    def read(self, name: str, colour: tuple[float, ...] | None) -> Skin:
        """Return the triangles of a mesh."""
        path = self.find(name)
        if path not in self._known:
            self._known[path] = self._loaded(path, _short(name))
        skin = self._known[path]
        self._faces += len(skin.corners)
        if self._faces > MAX_FACES:
            self._faces -= len(skin.corners)
            raise FileError(f"{_short(name)}: expected at most {MAX_FACES} triangles in all")
        if colour is None:
            return skin
        return Skin(skin.corners, np.broadcast_to(np.array(colour[:3]), (len(skin.corners), 3)))

    def _candidates(self, inner: PurePosixPath, is_package: bool) -> list[Path]:
        """Return where a mesh may be; nothing of it is looked at yet."""
        if not is_package:
            return [folder / inner for folder in ([self._own] if self._own else []) + self._folders]
        first = inner.parts[0] if inner.parts else ""
        rest = PurePosixPath(*inner.parts[1:])
        own = [folder / rest for folder in self._folders if folder.name == first]
        return [*own, *(folder / inner for folder in self._folders)]

    def _loaded(self, path: Path, name: str) -> Skin:
        if self._bytes > MAX_MESHES:
            raise FileError(f"{name}: expected at most {MAX_MESHES} bytes in all meshes")
        data = read_bytes(path, MAX_MESH)
        self._bytes += len(data)
        if path.suffix.lower() == ".dae":
            data = _checked_collada(data, name)
        trimesh = _trimesh()
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # what is not finite is refused below
                warnings.filterwarnings("error", "string or file could not be read to its end")  # NumPy's
                scene = trimesh.load_scene(io.BytesIO(data), file_type=path.suffix.lower()[1:], process=False)
                parts = [_part(mesh) for mesh in scene.dump() if hasattr(mesh, "triangles")]
        except P3dofError:
            raise
        except Exception as error:  # trimesh and what it calls raise whatever they like
            words = one_line(str(error), 120) or type(error).__name__
            raise FileError(f"{name}: trimesh cannot read it ({words})") from error
        if sum(len(corners) for corners, _ in parts) > MAX_FACES:
            raise FileError(f"{name}: expected at most {MAX_FACES} triangles in all")
        corners, colours = (np.concatenate([part[i] for part in parts] or [np.zeros((0, 3))]) for i in (0, 1))
        if not len(corners) or not np.all(np.abs(corners) < LARGEST):
            raise FileError(f"{name}: expected triangles with finite corners")
        return Skin(corners.astype(float), colours)


def _part(mesh: Any) -> tuple[FloatArray, FloatArray]:
    """Return corners (N, 3, 3) and colours (N, 3) of a mesh."""
    triangles: NDArray[np.float64] = np.asarray(mesh.triangles, dtype=float).reshape(-1, 3, 3)
    material = getattr(mesh.visual, "material", None)
    main = getattr(material, "main_color", None)
    if main is None and getattr(mesh.visual, "kind", None) in ("face", "vertex"):
        main = mesh.visual.main_color
    colour = np.array(_GREY[:3]) if main is None else np.asarray(main, dtype=float)[:3] / 255
    return triangles, np.broadcast_to(colour, (len(triangles), 3))


def _checked_collada(data: bytes, name: str) -> bytes:
    """Return a Collada file without entities, in which nothing is repeated beyond bounds."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: expected UTF-8 text") from error
    if encoding := _ENCODING.match(text):
        raise FileError(f"{name}: expected UTF-8, got {shown(encoding[1])}")
    root = XmlReader(name).parse(text)
    tags = [element.tag.rpartition("}")[2].rpartition(":")[2] for element in root.iter()]
    if "instance_node" in tags:
        raise FileError(f"{name}: nodes that are used again (instance_node) are not read")
    if tags.count("instance_geometry") * len(data) > _MAX_COPIES:
        raise FileError(f"{name}: too large, with {tags.count('instance_geometry')} instances")
    content: bytes = text.encode()
    return content


def _folders(given: Iterable[str | os.PathLike[str]]) -> list[Path]:
    if isinstance(given, str | os.PathLike):
        given = [given]
    found = []
    for folder in given:
        if not isinstance(folder, str | os.PathLike) or not Path(folder).is_dir():
            raise InputError(f"package_dirs: expected folders, got {shown(os.fspath(folder))}")
        found.append(Path(folder).resolve())
    return found


def _short(name: str) -> str:
    """Return a name that fits into a line of notes."""
    line = one_line(name, 120)
    return line if line.isprintable() else repr(line)


def _trimesh() -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError("meshes need trimesh: pip install 'p3dof[shapes]'") from error
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it writes to the terminal
    return trimesh


MAX_SHAPES = 2000
"""Most shapes of a robot."""

_SIZES = {"box": 3, "cylinder": 2, "sphere": 1, "mesh": 3}
"""How many measures each kind of a URDF has."""


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape on a body."""

    joint: int  # the joint that carries it
    placement: pin.SE3  # where it is in the axes of the joint
    kind: str  # `"box"`, `"cylinder"`, `"sphere"`, `"capsule"`, `"ellipsoid"` or `"mesh"`
    size: tuple[float, ...]
    """Edges; radius and length; radius; radius and length; radii; or the scale of a mesh [m]."""
    mesh: str = ""  # what the file calls the mesh
    colour: tuple[float, ...] | None = None  # red, green, blue and opacity, from 0 to 1


def visuals_of(
    model: pin.Model, source: str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]] = ()
) -> tuple[list[Visual], list[str]]:
    """Return the shapes that a robot's file has, and what could not be understood.

    Included files are below its folder, or one of `folders`.
    """
    if os.fspath(source).lower().endswith(".usda"):
        return [], ["the shapes of a USD file are not read"]
    text, name = read_xml(source, "robot")
    root = root_of(text, name)
    if root == "sdf":
        return _of_sdf(model, source, folders)
    found = _of_mjcf(model, source, text) if root == "mujoco" else _of_urdf(model, text, name)
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


_MEASURES: dict[str, dict[str, int]] = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "ellipsoid": {"radii": 3},
    "mesh": {"scale": 3},
}
"""What says the size of each kind in SDF, and how many numbers that is."""


def _of_sdf(
    model: pin.Model, source: str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]]
) -> tuple[list[Visual], list[str]]:
    from p3dof.loops.formats.sdf_file import SdfRobot

    try:
        robot = SdfRobot(source)
    except ModelError as error:  # perhaps for a file that is included from elsewhere
        for folder in folders:
            with suppress(ModelError):
                robot = SdfRobot(source, folder)
                break
        else:
            return [], [str(error)]
    found: list[Visual] = []
    left_out: list[str] = []
    for link in robot.links:
        if model.existFrame(link.full, pin.FrameType.BODY):
            frame = model.frames[model.getFrameId(link.full, pin.FrameType.BODY)]
            for visual in link.element.findall("visual")[: MAX_SHAPES - len(found)]:
                shape = _sdf_shape(robot, link, visual, frame, folder_of(source))
                if isinstance(shape, Visual):
                    found.append(shape)
                elif shape:
                    left_out.append(shape)
    return found, left_out


def _sdf_shape(
    robot: SdfRobot, link: Item, visual: Xml.Element, frame: pin.Frame, folder: Path | None
) -> Visual | str:
    """Return the shape of a ``<visual>``, or what is wrong with it; an empty text where it is empty."""
    try:
        return _checked_shape(robot, link, visual, frame, folder) or ""
    except ModelError as error:
        return str(error)


def _checked_shape(
    robot: SdfRobot, link: Item, visual: Xml.Element, frame: pin.Frame, folder: Path | None
) -> Visual | None:
    from p3dof.loops.formats.sdf_file import relative_to

    file, pose, geometry = link.file, visual.find("pose"), visual.find("geometry")
    place = file.placement(pose)
    if beside := relative_to(file, pose):
        there = robot.place(link.scope, beside, (file, visual))
        place = robot.place_of(link).actInv(there) * place
    parts = [] if geometry is None else list(geometry)
    if [part.tag for part in parts] == ["empty"]:
        return None
    shape = next((part for part in parts if part.tag in _MEASURES), None)
    if shape is None:
        file.bad(visual, f"a shape that is not drawn: {', '.join(part.tag for part in parts) or 'none'}")
    mesh, size = "", list[float]()
    for tag, count in _MEASURES[shape.tag].items():
        part = shape.find(tag)
        if part is None and shape.tag != "mesh":
            file.bad(visual, f"<{shape.tag}>: the element <{tag}> is missing")
        size += [1.0] * count if part is None else file.numbers(part, count).tolist()
    if shape.tag == "mesh":
        if shape.find("submesh") is not None:
            file.bad(visual, "<submesh>: parts of a mesh are not drawn")
        mesh = _uri(file.word(shape, "uri"), Path(file.source).parent, folder)
    colour = _diffuse(file, visual)
    return Visual(int(frame.parentJoint), frame.placement * place, shape.tag, tuple(size), mesh, colour)


def _uri(uri: str, beside: Path, folder: Path | None) -> str:
    """Return a mesh's name as `MeshFiles` has it: by its package, or from the folder of the first file."""
    if uri.startswith("model://"):
        return f"package://{uri.removeprefix('model://')}"
    if folder is None or _SCHEME.match(uri) or beside.resolve() == folder.resolve():
        return uri
    return os.path.relpath(beside.resolve() / uri, folder.resolve())


def _diffuse(file: SdfText, visual: Xml.Element) -> tuple[float, ...] | None:
    """Return red, green, blue and opacity of a ``<visual>``; None if it says none."""
    diffuse = visual.find("material/diffuse")
    if diffuse is None:
        return None
    count = len((diffuse.text or "").split())
    rgba = [*file.numbers(diffuse, 3 if count == 3 else 4).tolist(), 1.0][:4]
    rgba[3] *= 1.0 - file.number(visual, "transparency", 0.0)
    return tuple(np.clip(rgba, 0.0, 1.0).tolist())
