"""What every SDF has that this package writes: names in one scope, and joints."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from p3dof._base.errors import ModelError
from p3dof._base.markup.text import sub

VERSION = "1.9"
"""Of SDF: what libsdformat 12 (Gazebo Fortress) and everything newer reads."""


def check_names(names: Sequence[str]) -> None:
    """Refuse names that SDF cannot hold: all names of a model are in one scope.

    Parameters
    ----------
    names : sequence of str
        Of links, joints, frames and closures.

    Raises
    ------
    ModelError
        If one is there twice, or is reserved.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ModelError(f"SDF: links, joints and closures share one scope, {name!r} is there twice")
        if name == "world" or "::" in name or (name.startswith("__") and name.endswith("__")):
            raise ModelError(f"SDF: the name {name!r} is reserved")
        seen.add(name)


def joint_between(model: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    """Write a joint, and return its element.

    Parameters
    ----------
    model : Element
        The model.
    name, kind : str
        Its name and type.
    parent, child : str
        What it connects.

    Returns
    -------
    Element
    """
    element = sub(model, "joint", name=name, type=kind)
    sub(element, "parent", parent)
    sub(element, "child", child)
    return element
