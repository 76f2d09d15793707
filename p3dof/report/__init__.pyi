# What `p3dof.report` offers; each name is imported when it is first used.

from . import plots
from .assessment import moving_page, render_assessment, render_designs, write_assessment, write_designs
from .identification import render_identification, write_identification
from .page import render, write

__all__ = [
    "moving_page",
    "plots",
    "render",
    "render_assessment",
    "render_designs",
    "render_identification",
    "write",
    "write_assessment",
    "write_designs",
    "write_identification",
]
