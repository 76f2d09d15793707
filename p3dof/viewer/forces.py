"""`ForceArrows`: the arrows of the actuators' forces, what is written beside them, and the legend's arrow."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.viewer.arrows import draw_arrow, set_length
from p3dof.viewer.document.measures import above
from p3dof.viewer.document.room import COLOURS, LEGS, Room
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.stage import colour_number, number, sideways, write_text

LEGEND = 0x4A545E
"""Colour of the arrow that tells the scale of the others."""
TEXTS = {"cut": "off scale", "open": "undetermined"}
"""What is written over an arrow that is cut off, and in place of one whose force is NaN."""


class ForceArrows:
    """The arrows of the forces A, B, C, and one for a round number of newtons.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The root of what is drawn.
    room : Room
        Its measures.
    b : float
        Half the width of the parallelogram, which the arrow of C stands beside [m].
    scale : ArrowScale
        How long the arrows are, and where they reach.

    Attributes
    ----------
    scale : ArrowScale
        How long the arrows are.
    radius : float
        Of their shafts [m].
    """

    def __init__(self, viewer: Any, room: Room, b: float, scale: ArrowScale) -> None:
        self.scale = scale
        self.radius = 0.7 * room.size.rod_radius
        self._viewer, self._room = viewer, room
        edge = room.size.slider_edge
        beside = {"a": -1.2 * edge, "b": 1.2 * edge, "c": b + 0.7 * edge}
        self._places = {leg: room.pivots[leg] + np.array([0.0, beside[leg], 0.0]) for leg in LEGS}
        low, high = room.travel  # the legend stands left of the machine, about as far from the eye
        self._legend = above(-1.7 * room.radius * sideways(), (low + high) / 2 - 0.5 * scale.metres)

    @property
    def ends(self) -> FloatArray:
        """All that the arrows reach, and what is written about the legend's, shape (N, 3)."""
        letter = self._room.letter
        ends = [above(p, end) for p in self._places.values() for end in (self.scale.low, self.scale.high)]
        text = above(self._legend, self.scale.metres + 1.5 * letter)
        return np.stack((*ends, self._legend, text, text + letter * sideways(), text - letter * sideways()))

    def draw(self) -> None:
        """Put all into the scene; `show` places it."""
        import meshcat.geometry as mg

        for leg in LEGS:
            material = mg.MeshLambertMaterial(color=colour_number(COLOURS[leg]))
            draw_arrow(self._viewer["forces"][leg], self.radius, material)
            for name, text in TEXTS.items():
                write_text(self._viewer[name][leg]["text"], text, np.zeros(3), 2 * self._room.letter)
        draw_arrow(self._viewer["legend/arrow"], self.radius, mg.MeshLambertMaterial(color=LEGEND))
        self._viewer["legend"].set_transform(_at(self._legend))
        self._draw_legend()

    def show(self, sliders: FloatArray, forces: FloatArray | None) -> None:
        """Show forces.

        Parameters
        ----------
        sliders : ndarray, shape (3,)
            Where the sliders A, B, C are [m].
        forces : ndarray, shape (3,), optional
            Of their actuators [N], NaN where it is not determined; without, all is hidden.
        """
        self._viewer["legend"].set_property("visible", forces is not None)
        newtons = np.zeros(3) if forces is None else forces
        for leg, slider, force in zip(LEGS, sliders.tolist(), newtons.tolist(), strict=True):
            node, place = self._viewer["forces"][leg], above(self._places[leg], slider)
            length = self.scale.length(force)
            node.set_transform(_at(place))
            set_length(node, length, self.radius)
            self._say("open", leg, bool(np.isnan(force)), place)
            below = 1.4 * self._room.letter if length < 0 else 0.0
            self._say("cut", leg, self.scale.beyond(force), above(place, length - below))

    def set_scale(self, scale: ArrowScale) -> None:
        """Take another scale, and draw the legend anew; the arrows follow when they are shown."""
        if scale != self.scale:
            self.scale = scale
            self._draw_legend()

    def _say(self, name: str, leg: str, so: bool, place: FloatArray) -> None:
        """Show one of `TEXTS` over a place, or hide it."""
        self._viewer[name][leg].set_property("visible", so)
        if so:
            self._viewer[name][leg].set_transform(_at(above(place, 0.7 * self._room.letter)))

    def _draw_legend(self) -> None:
        length, letter = self.scale.length(self.scale.reference), self._room.letter
        set_length(self._viewer["legend/arrow"], length, self.radius)
        text = above(np.zeros(3), length + 0.5 * letter)
        write_text(self._viewer["legend/text"], f"{number(self.scale.reference)} N", text, 1.4 * letter)


def _at(place: FloatArray) -> FloatArray:
    """Return a place (3,) as a matrix."""
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return matrix
