"""`Recorder`: a window that remembers where everything was in every frame, and what plays these again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.viewer.window import Command, SceneWindow

_KINDS = ("position", "quaternion", "scale"), ("vector3", "quaternion", "vector3")
"""What a transform is made of, and what the page calls their types."""


class Recorder(SceneWindow):
    """A window that remembers where everything was in every frame."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0
        self._placements: dict[str, dict[int, FloatArray]] = {}
        self._visible: dict[str, dict[int, bool]] = {}

    def next_frame(self) -> None:
        """Begin a frame: what is drawn from now on belongs to it."""
        self._count += 1

    def send(self, command: Command) -> None:
        """Keep a command, as `SceneWindow.send` does, and what it says of the frame."""
        data = command.lower()
        if self._count and data["type"] == "set_transform":
            matrix = np.reshape(data["matrix"], (4, 4)).T
            self._placements.setdefault(data["path"], {})[self._count - 1] = matrix
        elif self._count and data["type"] == "set_property" and data["property"] == "visible":
            self._visible.setdefault(data["path"], {})[self._count - 1] = data["value"]
        super().send(command)

    def clips(self, rate: float) -> dict[str, Any]:
        """Return the command that plays the frames: only what moves is in it."""
        tracks = {path: _placed(matrices) for path, matrices in self._placements.items()}
        for path, shown_at in self._visible.items():
            if len(set(shown_at.values())) > 1:
                tracks.setdefault(path, []).append(_track("visible", "bool", shown_at.items()))
        return {
            "type": "set_animation",
            "path": "",
            "animations": [
                {"path": path, "clip": {"fps": rate, "name": "motion", "tracks": moving}}
                for path, moving in tracks.items()
                if moving
            ],
            "options": {"play": True, "repetitions": math.inf},
        }


def _placed(matrices: dict[int, FloatArray]) -> list[dict[str, Any]]:
    """Return the tracks of what is placed so in these frames; none if it stands still.

    What stays the same has one key, and is not left out: the page starts from the last transform, in which it
    takes a mirrored z for a turned and mirrored x.
    """
    parts = [_parts(matrix) for matrix in matrices.values()]
    tracks, moves = [], False
    for name, kind, values in zip(*_KINDS, zip(*parts, strict=True), strict=True):
        constant = np.ptp(values, axis=0).max() == 0
        moves = moves or not constant
        keys = zip(matrices, (value.tolist() for value in values[: 1 if constant else None]), strict=False)
        tracks.append(_track(name, kind, keys))
    return tracks if moves else []


def _parts(matrix: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Take a transform apart: position, quaternion (x, y, z, w) and scale, negative along a mirrored z."""
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    scale[2] = np.copysign(scale[2], np.linalg.det(matrix[:3, :3]))
    return matrix[:3, 3], pin.Quaternion(matrix[:3, :3] / scale).coeffs(), scale


def _track(name: str, kind: str, keys: Any) -> dict[str, Any]:
    return {
        "name": f".{name}",
        "type": kind,
        "keys": [{"time": frame, "value": value} for frame, value in keys],
    }


def packed(command: dict[str, Any]) -> bytes:
    """Pack an animation in single precision, which is all that a page keeps of it."""
    import umsgpack

    return bytes(umsgpack.packb(command, force_float_precision="single"))
