"""Simulation of the machine and of any closed-loop robot: controllers, events, results.

Each name is imported when it is first used: runs of a robot load nothing of the machine.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
