"""Formats that any robot with loops is written in, by the ending of the file's name."""

from __future__ import annotations

import os
from pathlib import Path

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, ModelError
from p3dof._base.files import suffix_of
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.writers import mjcf, sdf, urdf

SUFFIX = {"urdf": ".urdf", "mjcf": ".xml", "sdf": ".sdf", "drake": ".sdf"}
"""The formats, and how the names of their files end; ``"drake"`` is SDF with Drake's own elements."""


def contents(
    loop: LoopModel,
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002 - as everywhere
) -> dict[Path, str]:
    """Return what to write into which file; the sidecar of a URDF is the second file."""
    if format is not None and format not in SUFFIX:
        raise InputError(f"format: expected one of {', '.join(SUFFIX)}, got {shown(format)}")
    suffix, file = suffix_of(path, "robot"), Path(path)
    if format is not None and suffix != SUFFIX[format]:
        raise InputError(f"{file}: expected a file name that ends in {SUFFIX[format]} for {format}")
    if suffix == ".urdf":
        return dict(zip((file, file.with_suffix(".yaml")), urdf.texts(loop), strict=True))
    if loop.sidecar.bushings:
        name, kind = shown(loop.sidecar.bushings[0].title), "MJCF" if suffix == ".xml" else "SDF"
        raise ModelError(f"{kind}: the bushing {name} acts between two bodies, which {kind} has no word for")
    if suffix == ".xml":
        return {file: mjcf.text(loop)}
    return {file: sdf.text(loop, drake=format == "drake")}
