"""The robots of the gallery: where they are, their freedoms and their motors."""

from __future__ import annotations

from documents import ROOT

import p3dof

GALLERY = ROOT / "docs/_static/gallery"
MOBILITY = {
    "four_bar": 1,
    "five_bar": 2,
    "delta": 3,
    "stewart": 6,
    "gripper": 1,
    "leg": 8,
    "two_arms": 6,
    "biped": 6,
}
MOTORS = {**MOBILITY, "leg": 6, "two_arms": 12, "biped": 12}


def gallery(name):
    return p3dof.load_robot(GALLERY / f"{name}.urdf")
