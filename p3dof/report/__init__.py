"""Reports, each in one file of HTML or PDF: on a motion, and on whether a machine fits a task.

It needs the extra ``report`` (Jinja2, matplotlib), which is imported when a page is made.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
