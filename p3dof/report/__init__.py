"""Reports in one file each, HTML that needs no network or PDF: a motion, and whether a machine fits a task.

It needs the extra ``report`` (Jinja2, matplotlib), which is imported when a page is made.
"""

import lazy_loader

from p3dof.report.assessment import moving_page, render_assessment, write_assessment
from p3dof.report.designs import render_designs, write_designs
from p3dof.report.page import render, write

__getattr__ = lazy_loader.attach(__name__, ["plots"])[0]

__all__ = [
    "moving_page",
    "plots",
    "render",
    "render_assessment",
    "render_designs",
    "write",
    "write_assessment",
    "write_designs",
]
