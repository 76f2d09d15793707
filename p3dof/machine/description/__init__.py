"""The machine as links, joints, loop closures and solids, and the files made from them.

`describe` turns `Parameters` into one neutral `Mechanism`; `urdf` and `sidecar` write it as URDF and as the
closures beside it; `write` and `check` keep the files of a folder up to date, in every format of `FORMATS`.
"""

from p3dof.machine.description.files import FORMATS, check, texts, write
from p3dof.machine.description.mechanism import (
    Box,
    Closure,
    Colour,
    Cylinder,
    Drag,
    Joint,
    JointLimits,
    Link,
    Mechanism,
    Mimic,
    Placement,
    Shape,
    Solid,
    Sphere,
)
from p3dof.machine.description.tree import describe, with_masses
from p3dof.machine.description.urdf_text import sidecar, urdf

__all__ = [
    "FORMATS",
    "Box",
    "Closure",
    "Colour",
    "Cylinder",
    "Drag",
    "Joint",
    "JointLimits",
    "Link",
    "Mechanism",
    "Mimic",
    "Placement",
    "Shape",
    "Solid",
    "Sphere",
    "check",
    "describe",
    "sidecar",
    "texts",
    "urdf",
    "with_masses",
    "write",
]
