"""`Recording`: what moved in a scene of MeshCat, as one HTML file that plays it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.files import suffix_of, write_atomic
from p3dof.viewer.document.html import framed
from p3dof.viewer.window import SceneWindow, standalone


class Film:
    """Keeps where everything in a window is, picture after picture, and makes an animation of it.

    Whatever is drawn is kept: transforms, and whether a node is visible.
    """

    def __init__(self, window: SceneWindow) -> None:
        self._now: dict[tuple[str, str], Any] = {}
        self._pictures: list[dict[tuple[str, str], Any]] = []
        self._times: list[float] = []
        self._end = window.subscribe(self._hear)

    def _hear(self, message: bytes) -> None:
        import umsgpack  # of meshcat

        command = umsgpack.unpackb(message)
        if command["type"] == "set_transform":
            self._now[command["path"], "transform"] = command["matrix"]
        elif command["type"] == "set_property" and command["property"] == "visible":
            self._now[command["path"], "visible"] = command["value"]

    def keep(self, time: float) -> None:
        """Keep the scene as it is, as the picture at a time [s]."""
        self._times.append(time)
        self._pictures.append(dict(self._now))

    def animation(self) -> Any:
        """Return a `meshcat.animation.Animation` of all that changes; no more is heard."""
        from meshcat.animation import Animation, AnimationClip
        from meshcat.path import Path as ScenePath

        self._end()
        clips: dict[str, Any] = {}
        for path, kind in self._now:
            values = [picture.get((path, kind)) for picture in self._pictures]
            first = next((value for value in values if value is not None), self._now[path, kind])
            values = [first if value is None else value for value in values]
            if all(value == values[0] for value in values):
                continue
            tracks = _transforms(np.array(values)) if kind == "transform" else [("visible", "bool", values)]
            clip = clips.setdefault(path, AnimationClip(fps=1))  # times in seconds are numbers of pictures
            clip.tracks |= {name: self._track(name, *track) for name, *track in tracks}
        return Animation({ScenePath(tuple(path.split("/")[1:])): clip for path, clip in clips.items()})

    def _track(self, name: str, kind: str, values: Any) -> Any:
        """Return a track without what lies between two equal pictures."""
        from meshcat.animation import AnimationTrack

        last = len(values) - 1
        told = [
            i for i in range(last + 1) if i in (0, last) or not values[i - 1] == values[i] == values[i + 1]
        ]
        return AnimationTrack(name, kind, [self._times[i] for i in told], [values[i] for i in told])


def _transforms(columns: FloatArray) -> list[tuple[str, str, list[list[float]]]]:
    """Return tracks of transforms (N, 16), each column by column: places, turns, and how much is stretched.

    An arrow that points down is mirrored along its axis, so that it shrinks through zero when it turns.
    """
    from scipy.spatial.transform import Rotation

    matrices = columns.reshape(-1, 4, 4).transpose(0, 2, 1)
    stretch = np.linalg.norm(matrices[:, :3, :3], axis=1)
    stretch[np.linalg.det(matrices[:, :3, :3]) < 0, 2] *= -1.0
    turns = Rotation.from_matrix(matrices[:, :3, :3] / stretch[:, None]).as_quat()
    return [
        ("position", "vector3", matrices[:, :3, 3].tolist()),
        ("quaternion", "quaternion", turns.tolist()),
        ("scale", "vector3", stretch.tolist()),
    ]


class Recording:
    """A motion in MeshCat's page, in one file that needs nothing else.

    In a notebook it shows itself.
    """

    def __init__(self, window: SceneWindow, title: str, start: dict[str, Any]) -> None:
        self.html = standalone(window.messages(), title, start)
        self.title = title

    def __repr__(self) -> str:
        return f"Recording({self.title}, {len(self.html) / 1e6:.1f} MB)"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page into a file, whole or not at all; the path written."""
        suffix_of(path, "animation")
        return write_atomic(path, self.html)

    def _repr_html_(self) -> str:
        return framed(self.html, self.title)
