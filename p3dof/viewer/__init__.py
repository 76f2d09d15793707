"""Machines to look at in the browser: one page, in files and notebooks, live, as pictures and films.

A page that is saved needs nothing else. A live one needs the extra ``viz`` (tornado, and MeshCat for
Pinocchio's visualizer), pictures and films ``video`` (playwright, for a browser without a window).

What is here is imported when it is first used: who looks at a robot loads nothing of the paper's machine.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
