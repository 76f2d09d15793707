"""What the paper's machine is (parameters), does (motion), and how other programs read it (description).

Each name is imported when it is first used.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
