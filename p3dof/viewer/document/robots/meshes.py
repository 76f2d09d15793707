"""Mesh files that a robot's file names: found in given folders only, and read within bounds.

A file of somebody else may name any path. Only regular files inside of the folders are opened, wherever links
lead; what a mesh refers to itself (materials, images) is not looked for.
"""

from __future__ import annotations

import io
import logging
import os
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import LARGEST, FloatArray, one_line, shown
from p3dof._base.errors import FileError, InputError, MissingExtraError, P3dofError
from p3dof._base.files import read_bytes
from p3dof.loops.xml_text import XmlReader

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
    """Triangles with colours.

    Parameters
    ----------
    corners : ndarray, shape (N, 3, 3)
        The corners of each [m].
    colours : ndarray, shape (N, 3)
        Red, green and blue of each, from 0 to 1.
    """

    corners: FloatArray
    colours: FloatArray

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest coordinates, (3,) each [m]."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)


class MeshFiles:
    """The mesh files that a robot's file may name.

    Parameters
    ----------
    folder : path-like, optional
        That of the robot's file; None for text.
    package_dirs : iterable of path-like
        Further folders: those that hold the packages of ``package://name/...``, or are one of this name.

    Raises
    ------
    InputError
        If one of them is no folder.
    """

    def __init__(
        self, folder: str | os.PathLike[str] | None, package_dirs: Iterable[str | os.PathLike[str]] = ()
    ) -> None:
        self._folders = [*_folders(package_dirs), *([] if folder is None else [Path(folder).resolve()])]
        self._own = None if folder is None else Path(folder).resolve()
        self._faces = self._bytes = 0
        self._known: dict[Path, Skin] = {}

    def find(self, name: str) -> Path:
        """Return the file that a name stands for.

        Parameters
        ----------
        name : str
            ``package://package/path``, ``package:///path`` with no package, or a path relative to the
            robot's file or one of the folders.

        Returns
        -------
        Path
            A regular file inside of one of the folders, links resolved.

        Raises
        ------
        FileError
            If there is none; the message says why.
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
        """Return the triangles of a mesh.

        Parameters
        ----------
        name : str
            As of `find`.
        colour : tuple of float, optional
            Red, green and blue, from 0 to 1; by default those of the file, or grey.

        Returns
        -------
        Skin

        Raises
        ------
        FileError
            If it is not found, not read, or too large.
        MissingExtraError
            If trimesh is not installed.
        """
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
