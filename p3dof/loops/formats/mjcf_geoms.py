"""The primitive shapes of an MJCF, as MuJoCo compiles it, on the joints of the tree that is read from it."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.formats import mjcf

_SHOWN_GROUPS = 3
"""MuJoCo shows the geoms of the first groups; the others are mostly there for contacts."""
_KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")


@dataclass(frozen=True, eq=False)
class Geom:
    """A primitive shape.

    Parameters
    ----------
    joint : str
        The joint whose body it is on; ``"universe"`` for the world.
    placement : pin.SE3
        Where it is in the axes of the joint.
    kind : str
        ``"sphere"``, ``"capsule"``, ``"ellipsoid"``, ``"cylinder"`` or ``"box"``.
    size : (3,) array
        As MuJoCo has it: radii and half lengths [m].
    rgba : (4,) array
        Its colour.
    """

    joint: str
    placement: pin.SE3
    kind: str
    size: FloatArray
    rgba: FloatArray


def geoms(source: str | os.PathLike[str]) -> list[Geom]:
    """Return the primitive shapes that MuJoCo would show; planes, meshes and height fields are left out.

    Parameters
    ----------
    source : str or path-like
        XML text or the path of a file.

    Returns
    -------
    list of Geom

    Raises
    ------
    ModelError
        If the file is malformed or too large.
    MissingExtraError
        If MuJoCo is not installed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # who reads the robot is told
        compiled, translation = mjcf.translation_of(source)
        model, _ = translation.result()
    found = []
    for i in range(compiled.ngeom):
        kind = translation.kind_of_geom(i)
        if kind not in _KINDS or compiled.geom_group[i] >= _SHOWN_GROUPS:
            continue
        joint, place = translation.place_of_body(int(compiled.geom_bodyid[i]))
        w, x, y, z = (float(number) for number in compiled.geom_quat[i])
        own = pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(compiled.geom_pos[i]))
        size, rgba = np.array(compiled.geom_size[i]), np.array(compiled.geom_rgba[i], dtype=float)
        found.append(Geom(str(model.names[joint]), place * own, kind, size, rgba))
    return found
