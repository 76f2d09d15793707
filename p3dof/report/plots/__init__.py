"""Figures; they need the extra ``plot`` (matplotlib), which is imported when one is drawn."""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
