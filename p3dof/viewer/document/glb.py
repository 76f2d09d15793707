"""A document as a binary glTF: a node for each joint, solids below, and a run as animation of the joints."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.version import __version__
from p3dof.viewer.document.encoding import decoded, some_of
from p3dof.viewer.document.solids import surface_of

KEYS = 1000
"""Most key frames of an animation; between them viewers go straight, and turn evenly."""
_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
"""Turns z up into glTF's y up."""
_FLOAT, _SHORT, _INT = 5126, 5123, 5125
_STILL = 1e-12


def as_glb(document: Mapping[str, Any], run: int = 0) -> bytes:
    """Return a document as binary glTF 2.0, for browsers, presentations, and tools that draw.

    A node is named after each joint, moves as the joint does, and holds the solids; lengths are metres. Where
    the joint is at zero is in a node above it, so that little is lost in the single precision of tracks.
    What does not change has no track. Neither forces nor layers that are hidden at first are in it.
    """
    count = len(document["runs"])
    if isinstance(run, bool) or not isinstance(run, int) or not 0 <= run < count:
        raise InputError(f"run: expected a number from 0 to {count - 1}, got {shown(run)}")
    time, places = _keys(decoded(document["runs"][run]["time"]), motions_over(document, run))
    writer = _Writer()
    writer.scene(document, places[0])
    if len(time) > 1:
        writer.animation(str(document["runs"][run]["name"]), time, places)
    return writer.file()


def save_glb(path: str | os.PathLike[str], document: Mapping[str, Any], run: int = 0) -> Path:
    """Write the file of `as_glb`, whole or not at all.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.glb``; missing folders are made.
    document, run
        As of `as_glb`.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If the name ends otherwise, or there is no such run.
    """
    suffix_of(path, "scene")
    return write_atomic(path, as_glb(document, run))


def _keys(time: FloatArray, places: FloatArray) -> tuple[NDArray[np.float32], FloatArray]:
    """Return times from 0, strictly rising in single precision, and the placements there; at least one."""
    good = np.flatnonzero(np.isfinite(places).all(axis=(1, 2)))
    if not len(good):
        raise InputError("run: expected a sample with finite joints")
    good = good[some_of(len(good), KEYS)]
    single = (time[good] - time[good[0]]).astype(np.float32)
    rising = np.concatenate(([True], single[1:] > np.maximum.accumulate(single)[:-1]))
    return single[rising], places[good[rising]]


class _Writer:
    """Puts a glTF together."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._materials: dict[tuple[str, float], int] = {}
        self._meshes: dict[str, int | None] = {}
        self._joints: list[int] = []
        self._gltf: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"p3dof {__version__}"},
            **{name: [] for name in ("nodes", "meshes", "materials", "accessors", "bufferViews")},
        }

    def scene(self, document: Mapping[str, Any], places: FloatArray) -> None:
        """Add the root, nodes for each joint that has moved so far (njoints, 7), and the solids below."""
        nodes = self._gltf["nodes"]
        nodes.append({"name": str(document["machine"]["name"]), "rotation": _UP})
        for joint, place in zip(document["scene"]["joints"], places, strict=True):
            above = self._joints[joint["parent"]] if joint["parent"] >= 0 else 0
            zero = {} if joint["kind"] == "placed" else _placed(joint["placement"])
            if zero:
                above = self._node(above, {"name": f"{joint['name']} at zero", **zero})
            self._joints.append(self._node(above, {"name": joint["name"], **_placed(place)}))
        hidden = {layer["name"] for layer in document["scene"]["layers"] if not layer["shown"]}
        for solid in document["scene"]["solids"]:
            number = None if solid["layer"] in hidden else self._mesh(solid)
            if number is not None:
                above = self._joints[solid["joint"]] if solid["joint"] >= 0 else 0
                self._node(above, {"name": solid["name"], "mesh": number, **_placed(solid["placement"])})
        self._gltf |= {"scene": 0, "scenes": [{"name": str(document["title"]), "nodes": [0]}]}

    def animation(self, name: str, time: NDArray[np.float32], places: FloatArray) -> None:
        """Add the motion of the joints: time (N,), places (N, njoints, 7)."""
        given = self._accessor(time, "SCALAR", bounds=True)
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for i in range(places.shape[1]):
            for path, values in (("translation", places[:, i, :3]), ("rotation", places[:, i, 3:])):
                if np.ptp(values, axis=0).max() <= _STILL * max(1.0, np.abs(values).max()):
                    continue
                kind = "VEC3" if path == "translation" else "VEC4"
                single = values.astype(np.float32) if kind == "VEC3" else _single_turns(values)
                samplers.append({"input": given, "output": self._accessor(single, kind)})
                channels.append(
                    {"sampler": len(samplers) - 1, "target": {"node": self._joints[i], "path": path}}
                )
        if channels:
            self._gltf["animations"] = [{"name": name, "samplers": samplers, "channels": channels}]

    def file(self) -> bytes:
        """Return the file: a header, JSON, and the numbers."""
        gltf = {key: value for key, value in self._gltf.items() if value != []}
        if self._binary:
            gltf["buffers"] = [{"byteLength": len(self._binary)}]
        text = json.dumps(gltf, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        chunks = [(b"JSON", text + b" " * (-len(text) % 4))]
        if self._binary:
            chunks.append((b"BIN\0", bytes(self._binary)))
        body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def _node(self, above: int, node: dict[str, Any]) -> int:
        """Add a node below another one; return its number."""
        nodes = self._gltf["nodes"]
        nodes.append(node)
        nodes[above].setdefault("children", []).append(len(nodes) - 1)
        return len(nodes) - 1

    def _mesh(self, solid: Mapping[str, Any]) -> int | None:
        """Return the mesh of a solid, which others of the same form and colour share; None without any."""
        key = json.dumps([solid[name] for name in ("shape", "colour", "opacity")], sort_keys=True)
        if key not in self._meshes:
            self._meshes[key] = self._new_mesh(solid)
        return self._meshes[key]

    def _new_mesh(self, solid: Mapping[str, Any]) -> int | None:
        surface = surface_of(solid["shape"])
        if not len(surface.faces):
            return None
        attributes = {"POSITION": self._accessor(surface.corners.astype(np.float32), "VEC3", 34962, True)}
        if surface.normals is not None:
            attributes["NORMAL"] = self._accessor(surface.normals.astype(np.float32), "VEC3", 34962)
        kind = np.uint16 if len(surface.corners) < np.iinfo(np.uint16).max else np.uint32
        indices = self._accessor(surface.faces.astype(kind).ravel(), "SCALAR", 34963)
        material = self._material(solid["colour"], float(solid["opacity"]))
        one = {"attributes": attributes, "indices": indices, "material": material}
        self._gltf["meshes"].append({"name": solid["name"], "primitives": [one]})
        return len(self._gltf["meshes"]) - 1

    def _material(self, colour: str, opacity: float) -> int:
        key = colour, opacity
        if key not in self._materials:
            self._materials[key] = len(self._gltf["materials"])
            rgba = [*_linear(colour), opacity]
            rough = {"baseColorFactor": rgba, "metallicFactor": 0.0, "roughnessFactor": 0.7}
            clear = {"alphaMode": "BLEND"} if opacity < 1.0 else {}
            self._gltf["materials"].append({"name": colour, "pbrMetallicRoughness": rough, **clear})
        return self._materials[key]

    def _accessor(
        self, values: NDArray[Any], kind: str, target: int | None = None, bounds: bool = False
    ) -> int:
        """Add numbers, shape (N,) or (N, k); return the number of their accessor."""
        self._binary += b"\0" * (-len(self._binary) % 4)
        content = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("<"))).tobytes()
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(content)}
        self._binary += content + b"\0" * (-len(content) % 4)
        self._gltf["bufferViews"].append(view if target is None else view | {"target": target})
        component = {"f": _FLOAT}.get(values.dtype.kind, _SHORT if values.dtype.itemsize == 2 else _INT)
        accessor: dict[str, Any] = {
            "bufferView": len(self._gltf["bufferViews"]) - 1,
            "componentType": component,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._gltf["accessors"].append(accessor)
        return len(self._gltf["accessors"]) - 1


def _placed(place: Any) -> dict[str, Any]:
    """Return the translation and rotation of a node, as far as it has any."""
    x = [float(value) for value in place]
    found: dict[str, Any] = {} if x[:3] == [0.0, 0.0, 0.0] else {"translation": x[:3]}
    return found if x[3:] == [0.0, 0.0, 0.0, 1.0] else found | {"rotation": x[3:]}


def _single_turns(turns: FloatArray) -> NDArray[np.float32]:
    """Return unit quaternions (N, 4) in single precision, rounded so that their rotations are nearest.

    Of the sixteen ways to round four numbers up or down, since a viewer takes them as they are.
    """
    near = turns.astype(np.float32)
    far = np.nextafter(near, np.where(near > turns, -np.inf, np.inf).astype(np.float32))
    ways = [[k >> bit & 1 for bit in range(4)] for k in range(16)]
    tried = np.stack([np.where(way, far, near) for way in ways])  # (16, N, 4)
    off = np.abs(_rotations(tried.astype(float)) - _rotations(turns)).max(axis=-1)
    return np.asarray(tried[off.argmin(axis=0), np.arange(len(turns))])


def _rotations(turns: FloatArray) -> FloatArray:
    """Return the entries (..., 9) of the rotations of quaternions (..., 4) as viewers compute them."""
    x, y, z, w = np.moveaxis(turns, -1, 0)
    rows = [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)]
    rows += [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)]
    rows += [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]
    return np.stack(rows, axis=-1)


def _linear(colour: str) -> list[float]:
    """Return red, green and blue in proportion to light, of ``#rrggbb``, which is as screens have it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]


def motions_over(document: Mapping[str, Any], run: int = 0) -> FloatArray:
    """Return how all joints have moved from zero, in the axes of their placements, over a run.

    x, y, z [m] and the quaternion x, y, z, w, whose sign does not jump; NaN where the run has none. Of joints
    of the kind placed: where they are in their parents.
    """
    given = document["runs"][run]
    q = decoded(given["q"]).astype(float)
    joints = document["scene"]["joints"]
    found = np.empty((len(q), len(joints), 7))
    for i, joint in enumerate(joints):
        if joint["kind"] == "placed":
            found[:, i] = decoded(given["placed"][joint["name"]])
        else:
            start, count = joint["q"]
            found[:, i] = _moved(joint, q[:, start : start + count])
        found[:, i, 3:] = _without_jumps(found[:, i, 3:])
    return found


def _moved(joint: Mapping[str, Any], q: FloatArray) -> FloatArray:
    """Return how a joint has moved (N, 7) at its positions."""
    shift: FloatArray = np.zeros((len(q), 3))
    kind, axis = joint["kind"], np.asarray(joint.get("axis", (0.0, 0.0, 1.0)), dtype=float)
    known = np.asarray(np.isfinite(q).all(axis=1))
    values: FloatArray = np.where(known[:, None], q, 0.0)
    angle: FloatArray = values[:, 0] if values.shape[1] else np.zeros(len(q))
    if kind in ("continuous", "planar"):
        angle = np.arctan2(values[:, -1], values[:, -2])
    turns = np.outer(angle, axis) if kind in ("revolute", "continuous", "helical", "planar") else 0.0 * shift
    rotation = Rotation.from_rotvec(turns)
    if kind in ("prismatic", "helical"):
        shift += np.outer(angle * joint.get("pitch", 1.0), axis)
    elif kind in ("translation", "free"):
        shift += values[:, :3]
    elif kind == "planar":
        shift[:, :2] += values[:, :2]
    if kind in ("spherical", "free"):
        rotation = Rotation.from_quat(np.where(known[:, None], values[:, -4:], (0.0, 0.0, 0.0, 1.0)))
    elif kind == "universal":
        second = np.outer(values[:, 1], np.asarray(joint["axis2"], dtype=float))
        rotation = Rotation.from_rotvec(np.outer(angle, axis)) * Rotation.from_rotvec(second)
    found = np.column_stack((shift, rotation.as_quat()))
    found[~known] = np.nan
    return np.asarray(found)


def _without_jumps(turns: FloatArray) -> FloatArray:
    """Return quaternions (N, 4) each on the side of the one before; rows of NaN are passed over."""
    rows = np.flatnonzero(np.isfinite(turns).all(axis=1))
    own = turns[rows]
    signs = np.where(np.einsum("ij,ij->i", own[1:], own[:-1]) < 0, -1.0, 1.0)
    found = turns.copy()
    found[rows[1:]] *= np.cumprod(signs)[:, None]
    return found
