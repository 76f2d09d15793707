"""Where the machine can work: closed forms over (y, θ), and what limits and margins leave of them."""

from p3dof.analysis.workspace.closed_forms import (
    Aspects,
    Sizes,
    actuation_angle,
    arm,
    aspect_range,
    determinant,
    drops,
    extents,
    height,
    lean,
    offsets,
    reach_range,
    stroke_range,
    theta_of,
)
from p3dof.analysis.workspace.largest import Box
from p3dof.analysis.workspace.margins import (
    BoxMargins,
    PoseMargins,
    WorkspaceMachine,
    WorkspaceMargins,
    box_margins,
)
from p3dof.analysis.workspace.region import Points
from p3dof.analysis.workspace.workspace import Workspace, box_table, plain_workspace, workspace_table

__all__ = [
    "Aspects",
    "Box",
    "BoxMargins",
    "Points",
    "PoseMargins",
    "Sizes",
    "Workspace",
    "WorkspaceMachine",
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
