"""One page that tells all about a machine and a motion, in one HTML file that needs no network.

It needs the extra ``report`` (Jinja2, matplotlib), which is imported when a page is made.
"""

from p3dof.report.page import render, write

__all__ = ["render", "write"]
