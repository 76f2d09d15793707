"""XML text: numbers, angles, elements, documents. Attributes are escaped by ElementTree."""

from __future__ import annotations

import math
from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

from p3dof._base.checks import FloatArray

_GIMBAL = 1e-12
"""Cosine of the pitch below which roll and yaw turn about the same axis."""


def numbers(*values: float | Iterable[float], exact: bool = False) -> str:
    """Return numbers separated by spaces; no negative zero, nor numbers so small that readers refuse them.

    Parameters
    ----------
    *values : float or iterable of float
        The numbers.
    exact : bool
        Write the shortest text that is read as the very number; else 15 significant digits, the same
        on every computer.

    Returns
    -------
    str
    """
    flat = np.hstack([np.asarray(value, dtype=float).ravel() for value in values])
    flat = np.where(np.abs(flat) < np.finfo(float).tiny, 0.0, flat)
    return " ".join(_number(value + 0.0, exact) for value in flat.tolist())


def _number(value: float, exact: bool) -> str:
    short = f"{value:.15g}"
    return short if not exact or float(short) == value else repr(value)


def roll_pitch_yaw(rotation: FloatArray) -> tuple[float, float, float]:
    """Return the angles of a rotation about the fixed axes x, then y, then z: R = Rz(yaw) Ry(pitch) Rx(roll).

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        Rotation matrix.

    Returns
    -------
    roll, pitch, yaw : float
        Angles [rad]; yaw is zero where the pitch is ±90°.
    """
    R = rotation
    cosine = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cosine)
    if cosine < _GIMBAL:
        return math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def moments(inertia: FloatArray) -> dict[str, float]:
    """Return the six entries of an inertia by their names in URDF and SDF.

    Parameters
    ----------
    inertia : ndarray, shape (3, 3)
        Inertia about the mass centre [kg m²].

    Returns
    -------
    dict of str to float
        ixx, ixy, ixz, iyy, iyz, izz [kg m²]; what rounding left of a zero is zero.
    """
    J = (inertia + inertia.T) / 2
    J = np.where(np.abs(J) < 1e-15 * np.abs(J).max(), 0.0, J)
    at = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    return {name: float(J[index]) for name, index in at.items()}


def sub(parent: ET.Element, tag: str, text: str | None = None, /, **attributes: str) -> ET.Element:
    """Append a child element and return it.

    Parameters
    ----------
    parent : Element
        Where to.
    tag : str
        Its name.
    text : str, optional
        What it holds.
    **attributes : str
        Its attributes, in this order.

    Returns
    -------
    Element
    """
    child = ET.SubElement(parent, tag, attributes)
    child.text = text
    return child


def document(root: ET.Element, note: str) -> str:
    """Return the text of an XML file: declaration, comment, indented elements.

    Parameters
    ----------
    root : Element
        The root element.
    note : str
        What a reader should know.

    Returns
    -------
    str
    """
    ET.indent(root)
    note = note.replace("--", "- -")
    return f'<?xml version="1.0"?>\n<!-- {note} -->\n{ET.tostring(root, encoding="unicode")}\n'
