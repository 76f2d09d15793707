"""The first method: the paper's equations, on scalars, over arrays, and compiled.

Each name is imported when it is first used.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
