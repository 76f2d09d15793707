"""The names of the machine's parts, as every file, table and error has them."""

from __future__ import annotations

from dataclasses import fields

from p3dof.machine.parameters.bodies import Bodies

LEGS = ("A", "B", "C")
"""The legs, each with its actuator."""

LINKS = tuple(item.name for item in fields(Bodies))
"""The ten moving bodies."""

SLIDES = ("slide_a", "slide_b", "slide_c")
"""The actuated joints, in the order of the legs."""

PASSIVE = (
    "hinge_a",
    "hinge_b",
    "hinge_c",
    "hinge_left",
    "hinge_right",
    "hinge_lower",
    "hinge_platform",
    "universal_a",
    "universal_b",
    "hinge_lower_right",
)
"""The passive joints: those of the URDF's tree, and the three at which its loops are cut."""

JOINT_GROUPS = {"sliders": SLIDES, "joints": PASSIVE}
"""Names that stand for several joints."""

PLATFORM = "platform_center"
"""The frame of the platform at P, with axes parallel to the fixed frame at θ = 0."""
