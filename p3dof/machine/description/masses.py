"""Masses for links that have none, taken from their neighbours so exactly that no force changes.

Many readers refuse a massless link, drop it, or give it a kilogram. A point mass that sits on a joint's axis
moves alike with either body, so it can be given to either one:

- A *marker* takes a gram at its origin, and a speck of inertia, from the body that carries it.
- A *cross-bar* takes ten grams at each of its ends from the two rods that pivot there. About its own axis y0
  it would still have no inertia: it takes ε, and both rods lose ε/2 along their axis and across it in the
  plane of the parallelogram. A rod turns about y0 at the bar's rate and about its hinge; ε/2 in these two
  directions weighs on the first alone, whatever the rod's angle, so that bar and rods together are as before.
- The *root* takes the mass of its solids; it is at rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError, ParameterError
from p3dof.machine.description.mechanism import Box, Cylinder, Joint, Mechanism, Solid, Sphere
from p3dof.machine.parameters import STEEL_DENSITY, Body, box, cylinder
from p3dof.machine.parameters.body import steiner

BAR_MASS, MARKER_MASS = 0.02, 0.001
"""What a cross-bar and a marker take [kg]; less where their donors are light."""

BAR_INERTIA, MARKER_INERTIA = 1e-6, 1e-9
"""ε of a cross-bar, and the inertia of a marker [kg m²]; less where their donors are light."""

SHARES = tuple(4.0**-n for n in range(7))
"""What is tried of these, one after the other, until every donor is left a possible body."""

_Part: TypeAlias = tuple[float, FloatArray, FloatArray]
"""Mass, centre and inertia about it of something to add; negative to take away."""


def with_masses(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with the same dynamics in which every link has a mass.

    Parameters
    ----------
    mechanism : Mechanism
        Of `describe`; its markers and perhaps its cross-bars are massless.

    Returns
    -------
    Mechanism

    Raises
    ------
    ModelError
        If a body is too light or too slender to give what a massless neighbour needs.
    """
    for share in SHARES:
        try:
            bodies = _endowed(mechanism, share)
            break
        except ParameterError as error:
            refusal = error
    else:
        raise ModelError(
            f"a massless link cannot take its mass from its neighbours exactly ({refusal}); "
            "give the cross-bars a mass and the rods a thickness, or write the exact variant"
        ) from refusal
    root = mechanism.links[0]
    bodies[root.name] = _of_solids(root.visuals)
    links = tuple(replace(link, body=bodies[link.name]) for link in mechanism.links)
    return replace(mechanism, links=links)


def _endowed(mechanism: Mechanism, share: float) -> dict[str, Body]:
    """Return the bodies after all gifts, each of them a share of the usual one."""
    bodies = {link.name: link.body for link in mechanism.links if link.body is not None}
    for bar in ("crossbar_upper", "crossbar_lower"):
        if bodies[bar].mass == 0:
            _endow_bar(mechanism, bodies, bar, share)
    for name, joint in mechanism.markers.items():
        _endow_marker(bodies, name, joint, share)
    return bodies


def _endow_bar(mechanism: Mechanism, bodies: dict[str, Body], bar: str, share: float) -> None:
    """Give a cross-bar its mass, from the two rods at its ends."""
    rods = ("rod_left", "rod_right")
    ends = _ends(mechanism, bar)
    across = ends[1][1] - ends[0][1]  # from one end of the bar to the other
    length = float(np.linalg.norm(across))
    mass = share * min(BAR_MASS, *(bodies[rod].mass / 40 for rod in rods))
    spare = min(_spare(rod, bodies[rod], bodies[rod].inertia[[0, 2], [0, 2]]) for rod in rods)
    epsilon = min(share * BAR_INERTIA, spare / 50, mass * length**2 / 16)
    shared: list[_Part] = []
    for rod, (at_rod, at_bar) in zip(rods, ends, strict=True):
        taken = np.zeros((3, 3))
        taken[[0, 2], [0, 2]] = -epsilon / 2
        parts: list[_Part] = [(-mass / 2, at_rod, np.zeros((3, 3))), (0.0, np.zeros(3), taken)]
        bodies[rod] = _sum(rod, [_part(bodies[rod]), *parts])
        shared.append((mass / 2, at_bar, np.zeros((3, 3))))
    axis = across / length
    about: FloatArray = np.asarray(epsilon * np.outer(axis, axis), dtype=np.float64)
    bodies[bar] = _sum(bar, [*shared, (0.0, np.zeros(3), about)])


def _ends(mechanism: Mechanism, bar: str) -> list[tuple[FloatArray, FloatArray]]:
    """Return where the left and the right rod pivot on a cross-bar: in the rod's frame and in the bar's."""
    joints = {joint.child: joint for joint in mechanism.joints}
    tip = joints["rod_right_tip"].placement.position
    if bar == "crossbar_upper":
        return [(np.zeros(3), joints[rod].placement.position) for rod in ("rod_left", "rod_right")]
    return [
        (joints["crossbar_lower"].placement.position, np.zeros(3)),
        (tip, joints["crossbar_lower_right"].placement.position),
    ]


def _endow_marker(bodies: dict[str, Body], marker: str, joint: Joint, share: float) -> None:
    """Give a marker its mass, from the body that carries it."""
    carrier = joint.parent
    body = bodies[carrier]
    mass = share * min(MARKER_MASS, body.mass / 20)
    spare = _spare(carrier, body, np.asarray(np.linalg.eigvalsh(body.inertia)))
    speck = min(share * MARKER_INERTIA, spare / 1000) * np.eye(3)
    bodies[carrier] = _sum(carrier, [_part(body), (-mass, joint.placement.position, -speck)])
    bodies[marker] = Body(mass, np.zeros(3), speck)


def _spare(name: str, body: Body, moments: FloatArray) -> float:
    """Return the smallest of some moments of inertia, of which a part can be given away."""
    spare = float(moments.min())
    if spare <= 1e-9 * float(np.abs(body.inertia).max()):
        raise ParameterError(f"{name} is too slender: it has no inertia about an axis")
    return spare


def _part(body: Body) -> _Part:
    return body.mass, body.com, body.inertia


def _sum(name: str, parts: Iterable[_Part]) -> Body:
    """Return the body made of parts, some of which may be taken away."""
    masses, centers, inertias = (np.array(column) for column in zip(*parts, strict=True))
    mass = float(masses.sum())
    if mass <= 0:
        raise ParameterError(f"{name}: no mass is left")
    com = masses @ centers / mass
    offsets = (m * steiner(center - com) for m, center in zip(masses, centers, strict=True))
    inertia = inertias.sum(axis=0) + np.sum(list(offsets), axis=0)
    try:
        return Body(mass, com, inertia)
    except ParameterError as error:
        raise ParameterError(f"{name}: {error}") from error


def _of_solids(solids: Iterable[Solid]) -> Body:
    """Return the body of solids of steel."""
    parts: list[_Part] = []
    for solid in solids:
        shape, turn = solid.shape, solid.placement.rotation
        if isinstance(shape, Box):
            body = box(shape.size, STEEL_DENSITY)
        elif isinstance(shape, Cylinder):
            body = cylinder(shape.radius, shape.length, 2, -shape.length / 2, STEEL_DENSITY)
        else:
            body = _ball(shape)
        parts.append((body.mass, solid.placement.position, turn @ body.inertia @ turn.T))
    return _sum("solids", parts)


def _ball(shape: Sphere) -> Body:
    mass = STEEL_DENSITY * 4 / 3 * np.pi * shape.radius**3
    return Body(mass, np.zeros(3), np.full(3, 0.4 * mass * shape.radius**2))
