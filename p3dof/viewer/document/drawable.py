"""`Drawable`: what a scene needs of a robot."""

from __future__ import annotations

from typing import Any, Protocol


class Drawable(Protocol):
    """A robot that can be drawn: a tree, and solids on its bodies."""

    @property
    def model(self) -> Any:
        """The tree, a `pinocchio.Model`."""

    @property
    def visual_model(self) -> Any:
        """Its visible solids, a `pinocchio.GeometryModel`."""
