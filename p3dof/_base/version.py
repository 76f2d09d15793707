"""The version of the package, as it was installed."""

from importlib.metadata import version

__version__ = version("p3dof")
"""The version of the package, such as ``0.1.0``."""
