"""Reports in one file each, HTML that needs no network or PDF: a motion, and whether a machine fits a task.

It needs the extra ``report`` (Jinja2, matplotlib), which is imported when a page is made.
"""

from p3dof.report.assessment import moving_page, render_assessment, write_assessment
from p3dof.report.designs import render_designs, write_designs
from p3dof.report.page import render, write

__all__ = [
    "moving_page",
    "render",
    "render_assessment",
    "render_designs",
    "write",
    "write_assessment",
    "write_designs",
]
