"""Where the machine can work: closed forms over (y, θ), and what limits and margins leave of them."""

from p3dof.workspace.boxes import BoxMargins, box_margins
from p3dof.workspace.closed_forms import (
    Sizes,
    actuation_angle,
    arm,
    determinant,
    drops,
    extents,
    height,
    lean,
    offsets,
)
from p3dof.workspace.slices import aspect_range, reach_range, stroke_range, theta_of

__all__ = [
    "BoxMargins",
    "Sizes",
    "actuation_angle",
    "arm",
    "aspect_range",
    "box_margins",
    "determinant",
    "drops",
    "extents",
    "height",
    "lean",
    "offsets",
    "reach_range",
    "stroke_range",
    "theta_of",
]
