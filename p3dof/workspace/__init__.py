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
from p3dof.workspace.largest import Box
from p3dof.workspace.loci import Aspects
from p3dof.workspace.machine import Machine
from p3dof.workspace.margins import PoseMargins, WorkspaceMargins
from p3dof.workspace.region import Points
from p3dof.workspace.slices import aspect_range, reach_range, stroke_range, theta_of
from p3dof.workspace.tables import box_table, plain_workspace, workspace_table
from p3dof.workspace.workspace import Workspace

__all__ = [
    "Aspects",
    "Box",
    "BoxMargins",
    "Machine",
    "Points",
    "PoseMargins",
    "Sizes",
    "Workspace",
    "WorkspaceMargins",
    "actuation_angle",
    "arm",
    "aspect_range",
    "box_margins",
    "box_table",
    "determinant",
    "drops",
    "extents",
    "height",
    "lean",
    "offsets",
    "plain_workspace",
    "reach_range",
    "stroke_range",
    "theta_of",
    "workspace_table",
]
