"""XML text: numbers, angles, elements, documents, and what every MJCF and SDF has that is written here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError

_GIMBAL = 1e-12  # cosine of the pitch below which roll and yaw turn about the same axis


def numbers(*values: float | Iterable[float], exact: bool = False) -> str:
    """Return numbers separated by spaces; no negative zero, nor numbers so small that readers refuse them."""
    flat = np.hstack([np.asarray(value, dtype=float).ravel() for value in values])
    flat = np.where(np.abs(flat) < np.finfo(float).tiny, 0.0, flat)
    return " ".join(_number(value + 0.0, exact) for value in flat.tolist())


def _number(value: float, exact: bool) -> str:
    short = f"{value:.15g}"
    return short if not exact or float(short) == value else repr(value)


def roll_pitch_yaw(rotation: FloatArray) -> tuple[float, float, float]:
    """Return x, then y, then z angles of R = Rz(yaw) Ry(pitch) Rx(roll) [rad]; yaw is zero at pitch ±90°."""
    R = rotation
    cosine = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cosine)
    if cosine < _GIMBAL:
        return math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def moments(inertia: FloatArray) -> dict[str, float]:
    """Return ixx, ixy, ixz, iyy, iyz, izz of URDF and SDF [kg m²]; rounded zeros are zero."""
    J = (inertia + inertia.T) / 2
    J = np.where(np.abs(J) < 1e-15 * np.abs(J).max(), 0.0, J)
    at = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    return {name: float(J[index]) for name, index in at.items()}


def sub(parent: ET.Element, tag: str, text: str | None = None, /, **attributes: str) -> ET.Element:
    """Append a child element and return it."""
    child = ET.SubElement(parent, tag, attributes)
    child.text = text
    return child


def document(root: ET.Element, note: str) -> str:
    """Return the text of an XML file: declaration, comment, indented elements."""
    ET.indent(root)
    note = note.replace("--", "- -")
    return f'<?xml version="1.0"?>\n<!-- {note} -->\n{ET.tostring(root, encoding="unicode")}\n'


TIME_STEP = 1e-3  # step of the simulation [s]

STIFFNESS = 1e6  # of a closed loop by mass [1/s²]: a step is 1 rad of its vibration, RK4 is stable to 2.7


def mujoco(name: str, gravity: FloatArray) -> tuple[ET.Element, ET.Element]:
    """Return an MJCF that says how MuJoCo computes, and the element of its defaults.

    Equalities are as stiff as the step allows: with Runge-Kutta the gaps stay near 1e-8 m; MuJoCo's own
    defaults leave a millimetre. Its Euler and implicit integrators diverge at this stiffness.
    """
    root = ET.Element("mujoco", model=name)
    sub(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    # Dense: MuJoCo 4.0.0 factorises some sparse Jacobians wrongly (its release notes of 4.0.1).
    sub(
        root,
        "option",
        gravity=numbers(gravity),
        timestep=numbers(TIME_STEP),
        integrator="RK4",
        solver="Newton",
        jacobian="dense",
        tolerance="1e-12",
    )
    defaults = sub(root, "default")
    damping = np.sqrt(STIFFNESS)  # half of critical, where position and speed are most exact at this step
    # .9999 is the most that MuJoCo takes; the other numbers are its own.
    sub(defaults, "equality", solref=numbers(-STIFFNESS, -damping), solimp="0.9999 0.9999 0.001 0.5 2")
    return root, defaults


VERSION = "1.9"  # of SDF: what libsdformat 12 (Gazebo Fortress) and everything newer reads


def inertial(
    link: ET.Element, mass: float, com: FloatArray, inertia: FloatArray, exact: bool = False
) -> None:
    """Write the mass of a link in SDF, in the axes of the link."""
    element = sub(link, "inertial")
    sub(element, "pose", numbers(com, np.zeros(3), exact=exact))
    sub(element, "mass", numbers(mass, exact=exact))
    entries = sub(element, "inertia")
    for name, value in moments(inertia).items():
        sub(entries, name, numbers(value, exact=exact))


def check_names(names: Sequence[str]) -> None:
    """Refuse names that SDF cannot hold: all names of a model are in one scope."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ModelError(f"SDF: links, joints and closures share one scope, {name!r} is there twice")
        if name == "world" or "::" in name or (name.startswith("__") and name.endswith("__")):
            raise ModelError(f"SDF: the name {name!r} is reserved")
        seen.add(name)


def joint_between(model: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    """Write a joint, and return its element."""
    element = sub(model, "joint", name=name, type=kind)
    sub(element, "parent", parent)
    sub(element, "child", child)
    return element
