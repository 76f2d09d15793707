"""`Layers`: what of a robot's picture is seen: its shapes, rods, closures, and arrows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from p3dof.checks import shown
from p3dof.errors import InputError

LAYERS: Mapping[str, str] = MappingProxyType(
    {
        "shapes": "shapes",
        "sticks": "rods",
        "forces": "actuator forces",
        "closures": "closures",
        "numbers": "numbers of closures",
        "closure_forces": "forces in closures",
        "wrenches": "external wrenches",
    }
)
"""Parts of the picture that can be hidden, and what a page calls them."""


class Layers:
    """The parts of one picture.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The root of what is drawn.
    present : mapping of str to (bool, sequence of str)
        Those of `LAYERS` that there are: whether they are seen usually, and their nodes.
    wanted : mapping of str to bool, optional
        What is to be seen or not.

    Raises
    ------
    InputError
        If `wanted` is something else.
    """

    def __init__(
        self,
        viewer: Any,
        present: Mapping[str, tuple[bool, Sequence[str]]],
        wanted: Mapping[str, bool] | None = None,
    ) -> None:
        self._viewer = viewer
        self.nodes = {name: tuple(nodes) for name, (_, nodes) in present.items()}
        """The nodes of each layer, under ``/meshcat``."""
        chosen = checked_layers(wanted or {})
        self.seen = {name: chosen.get(name, usual) for name, (usual, _) in present.items()}
        """Whether each layer is seen."""
        self._apply(self.seen)

    def shows(self, node: str) -> bool:
        """Return whether a node of the scene is seen."""
        return all(
            self.seen[name]
            for name, nodes in self.nodes.items()
            if any(node == path or node.startswith(f"{path}/") for path in nodes)
        )

    def rows(self) -> list[list[object]]:
        """Return name, words, whether it is seen, and nodes of each layer, for a page."""
        return [[name, LAYERS[name], self.seen[name], list(nodes)] for name, nodes in self.nodes.items()]

    def choose(self, wanted: Mapping[str, bool]) -> None:
        """Show some layers, hide others, and leave the rest as it is; what is not there is passed over."""
        changed = {name: on for name, on in wanted.items() if name in self.seen and self.seen[name] is not on}
        self.seen.update(changed)
        self._apply(changed)

    def _apply(self, wanted: Mapping[str, bool]) -> None:
        for name, on in wanted.items():
            for path in self.nodes[name]:
                self._viewer[path].set_property("visible", on)


def checked_layers(given: object) -> dict[str, bool]:
    """Return layers that somebody wants to see or not, checked.

    Raises
    ------
    InputError
        If it is no mapping of names of `LAYERS` to true or false.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"layers: expected a mapping of names to true or false, got {shown(given)}")
    for name, on in given.items():
        if name not in LAYERS:
            raise InputError(f"layers: expected some of {', '.join(LAYERS)}, got {shown(name)}")
        if not isinstance(on, bool):
            raise InputError(f"layers: {name}: expected true or false, got {shown(on)}")
    return dict(given)
