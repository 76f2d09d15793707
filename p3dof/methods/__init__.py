"""The methods of inverse dynamics, from the platform's motion to the forces, with one kind of result.

Each name is imported when it is first used.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
