"""Loops that somebody may have forgotten: signs in a URDF read without a sidecar that it belongs to one."""

from __future__ import annotations

from contextlib import suppress
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.errors import FileError
from p3dof._base.files import read_text

_TOGETHER = 1e-6
"""How near two ends coincide, as a share of the robot's size."""

_SIDECAR_KEY = "closed_loop:"


def open_ends(path: str | None, robot: Xml.Element, model: pin.Model) -> str:
    """Say what in a URDF looks like a loop that is left open.

    That is a sidecar beside the file (``robot.yaml`` beside ``robot.urdf``), or two ends of different
    branches that coincide in the neutral configuration: links at fixed joints, without shape and children.

    Parameters
    ----------
    path : str, optional
        Of the file; None for text.
    robot : xml.etree.ElementTree.Element
        What the file says.
    model : pin.Model
        The tree that it makes.

    Returns
    -------
    str
        The sign in words; empty if there is none.
    """
    for ending in (".yaml", ".yml") if path else ():
        beside = Path(str(path)).with_suffix(ending)
        with suppress(FileError):
            if _SIDECAR_KEY in read_text(beside):
                return f"{beside} beside it holds loop closures"
    pairs = _coinciding(model, _bare_ends(robot))
    if not pairs:
        return ""
    more = f" and {len(pairs) - 1} more such pairs" if len(pairs) > 1 else ""
    return f"its frames {pairs[0][0]} and {pairs[0][1]} coincide{more}"


def _bare_ends(robot: Xml.Element) -> list[str]:
    """Return the links without shape and children that hang at fixed joints."""
    parents = {tag.get("link") for tag in robot.iterfind("joint/parent")}
    fixed = {tag.get("link") for tag in robot.iterfind("joint[@type='fixed']/child")}
    return [
        name
        for link in robot.iterfind("link")
        if (name := link.get("name")) in fixed - parents
        and name
        and link.find("visual") is None
        and link.find("collision") is None
    ]


def _coinciding(model: pin.Model, names: list[str]) -> list[tuple[str, str]]:
    """Return pairs of frames on different branches that have the same place in the neutral configuration."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    place = {name: np.array(data.oMf[model.getFrameId(name)].translation) for name in names}
    joint = {name: model.frames[model.getFrameId(name)].parentJoint for name in names}
    size = max((float(np.abs(frame.translation).max()) for frame in data.oMf), default=0.0)
    return [
        (a, b)
        for a, b in combinations(names, 2)
        if np.abs(place[a] - place[b]).max() <= _TOGETHER * size
        and joint[a] not in model.supports[joint[b]]
        and joint[b] not in model.supports[joint[a]]
    ]
