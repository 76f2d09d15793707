"""The solids of the machine: what is drawn and what must not touch.

What is drawn are the solids that the masses come from (`Dimensions`), with guides, shoes and knobs beside
them. The solids for collisions are fewer and shorter, so that no two of different links touch at any pose of
the working mode, joints included: legs and rods leave out the ends that are inside slider and platform,
cross-bars are two stubs each, outside slider and platform.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.description.mechanism import Box, Colour, Cylinder, Placement, Shape, Solid, Sphere
from p3dof.machine.parameters import Dimensions, Geometry, Parameters

Point: TypeAlias = tuple[float, float, float]

MAX_SLABS = 40
"""Most slabs that the plate is cut into; only a parallelogram far narrower than the platform needs more."""

# The palette of Okabe and Ito, which the colour-blind can tell apart.
BASE = Colour("base", (0.6, 0.6, 0.6, 1.0))
SHOE = Colour("shoe", (0.25, 0.25, 0.25, 1.0))
LEG_A = Colour("leg_a", (0.0, 0.447, 0.698, 1.0))  # blue
LEG_B = Colour("leg_b", (0.835, 0.369, 0.0, 1.0))  # vermilion
LEG_C = Colour("leg_c", (0.0, 0.62, 0.451, 1.0))  # bluish green
SLIDER_A = Colour("slider_a", (0.0, 0.313, 0.489, 1.0))  # the legs' colours, darker
SLIDER_B = Colour("slider_b", (0.585, 0.258, 0.0, 1.0))
SLIDER_C = Colour("slider_c", (0.0, 0.434, 0.316, 1.0))
PLATFORM = Colour("platform", (0.941, 0.894, 0.259, 1.0))  # yellow

_ALONG = {
    "x": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotations that turn z, the axis of a cylinder, into an axis of the link."""


class Solids:
    """Visuals and collisions of every link, with the sizes of its solids."""

    def __init__(self, parameters: Parameters) -> None:
        geometry, size = parameters.geometry, parameters.sizes
        edge, b = size.slider_edge, geometry.b
        start, end = trimmed(parameters, size, 0.0)
        leaning = trimmed(parameters, size, 1 - (geometry.R - geometry.r) / geometry.L)
        frame, plate = _frame(parameters, edge), _plate(geometry, size)
        beside, behind = (0.65 * edge, 0.0, 0.0), (-0.65 * edge, 0.0, 0.0)
        inner = 0.6 * edge
        outer = size.rod_radius + math.sqrt(2) * size.corner_radius + 0.1 * edge  # outside the plate's corner
        rod, bar = size.rod_radius, (b, -b)
        self.visuals = {
            "base_link": frame,
            "slider_a": _slider(edge, beside, SLIDER_A),
            "leg_a": (_bar("x", rod, 0.0, geometry.L, LEG_A),),
            "slider_b": _slider(edge, beside, SLIDER_B),
            "leg_b": (_bar("x", rod, 0.0, geometry.L, LEG_B),),
            "slider_c": _slider(edge, behind, SLIDER_C),
            "crossbar_upper": (_bar("y", rod, -b, b, LEG_C), *_knobs("y", rod, bar)),
            "rod_left": (_bar("x", rod, 0.0, geometry.L, LEG_C),),
            "crossbar_lower": (_bar("z", rod, 0.0, 2 * b, LEG_C), *_knobs("z", rod, (0.0, 2 * b))),
            "platform": plate,
            "rod_right": (_bar("x", rod, 0.0, geometry.L, LEG_C),),
        }
        self.collisions = {
            "base_link": frame,
            "slider_a": _slider(edge, beside, SLIDER_A)[:1],
            "leg_a": (_bar("x", rod, start, end, LEG_A),),
            "slider_b": _slider(edge, beside, SLIDER_B)[:1],
            "leg_b": (_bar("x", rod, start, end, LEG_B),),
            "slider_c": _slider(edge, behind, SLIDER_C)[:1],
            "crossbar_upper": (_bar("y", rod, inner, b, LEG_C), _bar("y", rod, -b, -inner, LEG_C)),
            "rod_left": (_bar("x", rod, *leaning, LEG_C),),
            "crossbar_lower": (
                _bar("z", rod, 0.0, b - outer, LEG_C),
                _bar("z", rod, b + outer, 2 * b, LEG_C),
            ),
            "platform": plate,
            "rod_right": (_bar("x", rod, *leaning, LEG_C),),
        }


def trimmed(parameters: Parameters, size: Dimensions, lean: float) -> tuple[float, float]:
    """Return where the collision solid of a leg or rod starts and ends, from its upper joint.

    It starts where it has left its slider: an edge e away, or e/cos α for the rods beside slider C, which
    lean under it up to sin α = (L-w)/L, with w = R - r. It ends above the platform: with c the cosine of the
    angle between rod and normal of the plate, a rod of radius ρ leaves a plate of thickness t at
    (t/2 + ρ √(1-c²))/c from its middle. That angle is made of the tilt θ and of how far legs A and B lean
    inward, sin ψ = (L-2w)/L; rods keep as far from the platform's corner as from the slider. Neither end
    takes more than .3 L: that matters only where the plate stands on edge or legs A and B lie flat over it.

    Distances from the upper joint [m].
    """
    geometry, edge = parameters.geometry, size.slider_edge
    L = geometry.L
    tilt = min(max(abs(end) for end in parameters.limits.tilt), math.pi / 2)
    inward = max(1 - 2 * (geometry.R - geometry.r) / L, 0.0)
    cosine = max(math.cos(tilt) * math.sqrt(1 - inward**2), 1e-3)
    below = (size.plate_thickness / 2 + size.rod_radius * math.sqrt(1 - cosine**2)) / cosine
    start = edge / math.sqrt((1 - lean) * (1 + lean))
    return min(start, 0.3 * L), L - min(max(below + 0.2 * edge, start), 0.3 * L)


def _solid(
    shape: Shape,
    colour: Colour,
    position: Iterable[float] = (0.0, 0.0, 0.0),
    rotation: FloatArray | None = None,
) -> Solid:
    return Solid(shape, Placement(np.array([*position]), np.eye(3) if rotation is None else rotation), colour)


def _bar(axis: str, radius: float, start: float, end: float, colour: Colour) -> Solid:
    """Return a round bar on an axis of the link, between two coordinates."""
    along = _ALONG[axis]
    return _solid(Cylinder(radius, end - start), colour, along[:, 2] * (start + end) / 2, along)


def _knobs(axis: str, radius: float, ends: tuple[float, float]) -> tuple[Solid, ...]:
    """Return balls at the ends of a cross-bar, where the rods turn."""
    return tuple(_solid(Sphere(1.5 * radius), LEG_C, _ALONG[axis][:, 2] * end) for end in ends)


def _slider(edge: float, shoe: Point, colour: Colour) -> tuple[Solid, Solid]:
    """Return the cube, and the shoe that reaches from it to the guide."""
    return (
        _solid(Box((edge, edge, edge)), colour),
        _solid(Box((0.3 * edge, 0.4 * edge, 0.7 * edge)), SHOE, shoe),
    )


def _frame(parameters: Parameters, edge: float) -> tuple[Solid, ...]:
    """Return the three guides and the beams that hold them at the top.

    The legs A and B swing in the plane x = 0: their guides stand on the side of +x, .8 edges off, so that
    the platform's edge, which reaches √(corner² + (thickness/2)²) = .64 edges when it tilts, passes them. The
    rods only lean toward +x: the guide of C stands behind its slider. Nothing rises above the highest
    slider's pivot by more than those .64 edges; the beams begin a whole edge above the top of the travel.
    """
    R, (low, high) = parameters.geometry.R, parameters.limits.travel
    bottom, under = low - 0.7 * edge, high + edge  # a slider ends half an edge above its pivot
    top = under + 0.6 * edge
    thick, wide = 0.4 * edge, 0.6 * edge
    beside, behind = edge, -R - edge
    upright = Box((thick, wide, top - bottom))
    middle, beam = (bottom + top) / 2, (under + top) / 2
    return (
        _solid(upright, BASE, (beside, -R, middle)),
        _solid(upright, BASE, (beside, R, middle)),
        _solid(upright, BASE, (behind, 0.0, middle)),
        _solid(Box((thick, 2 * R - wide, wide)), BASE, (beside, 0.0, beam)),
        _solid(Box((beside - behind - thick, thick, wide)), BASE, ((beside + behind) / 2, 0.0, beam)),
    )


def _plate(geometry: Geometry, size: Dimensions) -> tuple[Solid, ...]:
    """Return the platform: the triangle A3 B3 C5, widened by the corner radius, as cylinders and boxes.

    Round corners, edges of twice the radius, and slabs along y in between. A slab from x0 to x1 of P's frame
    has the half width of the triangle at its middle: with x1 - x0 ≤ 2√2 radii neither does its corner leave
    the widened triangle nor is anything left between it and the edges, and the union is the plate exactly.
    """
    r, radius, thickness = geometry.r, size.corner_radius, size.plate_thickness
    corners = [(r, -r), (r, r), (0.0, 0.0)]  # A3, B3, C5 seen from C5
    solids = [_solid(Cylinder(radius, thickness), PLATFORM, (x, y, 0.0)) for x, y in corners]
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        length = math.hypot(x1 - x0, y1 - y0)
        c, s = (x1 - x0) / length, (y1 - y0) / length
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle = ((x0 + x1) / 2, (y0 + y1) / 2, 0.0)
        solids.append(_solid(Box((length, 2 * radius, thickness)), PLATFORM, middle, turn))
    count = min(math.ceil(r / (2 * math.sqrt(2) * radius)), MAX_SLABS)
    step = r / count
    for i in range(count):
        half = i * step + min(step / 2, math.sqrt(2) * radius)  # the second only where MAX_SLABS cuts in
        solids.append(_solid(Box((step, 2 * half, thickness)), PLATFORM, ((i + 0.5) * step, 0.0, 0.0)))
    return tuple(solids)
