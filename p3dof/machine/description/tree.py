"""The mechanism as a tree with three loops cut open.

The cuts are where legs A and B meet the platform, and where the right rod of the parallelogram meets the
lower cross-bar::

    base_link ─ slide_a ─ slider_a ─ hinge_a ─ leg_a (leg_a_tip)
              ─ slide_b ─ slider_b ─ hinge_b ─ leg_b (leg_b_tip)
              ─ slide_c ─ slider_c ─ hinge_c ─ crossbar_upper
                  ─ hinge_left  ─ rod_left ─ hinge_lower ─ crossbar_lower (crossbar_lower_right)
                                    ─ hinge_platform ─ platform (platform_a, platform_b, platform_center)
                  ─ hinge_right ─ rod_right (rod_right_tip)

Home is y = z = θ = 0: all joints at 0, all loops closed. Link frames have their origin on the joint's axis.
Those of sliders, upper cross-bar and platform are parallel to the fixed frame at home: a slider's at its
pivot, the cross-bar's at its middle, the platform's at C5. A leg or rod has its frame at its upper joint, x
along the rod and y along the hinge axis; a positive angle of the rods moves the platform toward +y0. The
lower cross-bar has its frame at its left pivot, with the rods' axes at home: some readers misplace what hangs
on an axis that is not one of x, y and z. Left is the side of +y0.

Masses for links that have none, taken from their neighbours so exactly that no force changes.

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

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError, ParameterError
from p3dof.machine.description.mechanism import (
    Box,
    Closure,
    Cylinder,
    Drag,
    Joint,
    JointLimits,
    Link,
    Mechanism,
    Mimic,
    Placement,
    Solid,
    Sphere,
)
from p3dof.machine.description.shapes import Solids
from p3dof.machine.parameters import (
    PLATFORM,
    SLIDES,
    STEEL_DENSITY,
    Body,
    Friction,
    Geometry,
    Parameters,
    box,
    cylinder,
)
from p3dof.machine.parameters.body import steiner

MARGIN = 0.1
"""Added at both ends of what a passive joint can reach [rad], so that no engine's soft stop acts inside."""


def joint_limits(parameters: Parameters) -> dict[str, JointLimits]:
    """Return the limits of all moving joints; by joint name.

    Sliders have the limits of `parameters`. The angles of the passive joints follow from what the loops can
    reach, with w = R - r and |y| < L - w (beyond, a leg A or B is horizontal), and a `MARGIN` on either side:

    - legs: the angle from the vertical has the sine (w+y)/L, between (2w-L)/L and 1;
    - rods: the angle has the sine y/L;
    - upper cross-bar: the plane of the rods has the sine (R - r cos θ)/√(L²-y²) from the vertical, with θ in
      the tilt range; it is smallest at home;
    - platform: θ minus the cross-bar's angle.

    Speeds follow from the sliders' speed v: legs turn at no more than 2v/w; |ẏ| ≤ v h/w, so that rods turn
    at no more than v h/(w √(w(2L-w))). Platform and cross-bar have no bound, because they turn ever faster
    toward the actuation singularity: theirs is four times the 2v/r of home. Nothing acts on a passive joint;
    as an effort other than zero (some engines fail on zero) it has the largest force times a leg's length.
    """
    geometry, limits = parameters.geometry, parameters.limits
    L, w, h = geometry.L, geometry.R - geometry.r, geometry.h
    speed, torque = limits.speed, limits.force * L
    home = math.asin(w / L)
    inward, outward = math.pi / 2 - home, math.asin((2 * w - L) / L) - home
    lean = math.asin((L - w) / L)
    leg_speed, rod_speed = 2 * speed / w, speed * h / (w * math.sqrt(w * (2 * L - w)))
    turn = home - _steepest(geometry, limits.tilt)  # <= 0
    turn_speed = 8 * speed / geometry.r
    low, high = limits.tilt

    def passive(lower: float, upper: float, velocity: float) -> JointLimits:
        return JointLimits(lower - MARGIN, upper + MARGIN, velocity, torque)

    slide = JointLimits(*limits.travel, speed, limits.force)
    rod = passive(-lean, lean, rod_speed)
    return {
        "slide_a": slide,
        "hinge_a": passive(outward, inward, leg_speed),
        "slide_b": slide,
        "hinge_b": passive(-inward, -outward, leg_speed),
        "slide_c": slide,
        "hinge_c": passive(turn, 0.0, turn_speed),
        "hinge_left": rod,
        "hinge_lower": rod,
        "hinge_platform": passive(low, high - turn, turn_speed),
        "hinge_right": rod,
    }


def _steepest(geometry: Geometry, tilt: tuple[float, float]) -> float:
    """Return the largest angle of the rods' plane from the vertical [rad]."""
    r, R, L = geometry.r, geometry.R, geometry.L
    w = R - r
    far = min(max(abs(end) for end in tilt), math.pi)
    return math.asin(min((R - r * math.cos(far)) / math.sqrt(w * (2 * L - w)), 1.0))  # L² - (L-w)² = w(2L-w)


_Point = tuple[float, float, float]
_ORIGIN: _Point = (0.0, 0.0, 0.0)
_, _Y, _Z = np.eye(3)

CLOSURES = (
    Closure("loop_a", "leg_a_tip", "platform_a"),
    Closure("loop_b", "leg_b_tip", "platform_b"),
    Closure("loop_c", "rod_right_tip", "crossbar_lower_right"),
)
"""Where the tree was cut."""


def describe(parameters: Parameters) -> Mechanism:
    """Describe a machine as links, joints, loop closures and solids.

    With the names and frames of this module's docstring.
    """
    geometry = parameters.geometry
    bodies = dict(parameters.bodies.items())
    # Where the body frame is in the link frame, where the two differ.
    bodies["crossbar_lower"] = _moved(
        bodies["crossbar_lower"], Placement(np.array([0.0, 0.0, geometry.b]), rod_axes(geometry).T)
    )
    bodies["platform"] = _moved(bodies["platform"], _at((geometry.r, 0.0, 0.0)))
    solids = Solids(parameters)
    losses, drags = _friction(parameters.friction)
    joints = tuple(replace(joint, **losses.get(joint.name, {})) for joint in _joints(parameters))
    links = tuple(
        Link(name, bodies.get(name), solids.visuals.get(name, ()), solids.collisions.get(name, ()))
        for name in ("base_link", *(joint.child for joint in joints))
    )
    smoothing = parameters.friction.smoothing
    return Mechanism("p3dof", links, joints, CLOSURES, SLIDES, parameters.gravity, drags, smoothing)


_ALIKE = {"universal_a": "hinge_a", "universal_b": "hinge_b", "hinge_lower_right": "hinge_right"}
"""Joints at which the loops are cut, and those of the tree that turn as fast while the loops are closed."""


def _friction(friction: Friction) -> tuple[dict[str, dict[str, Any]], tuple[Drag, ...]]:
    """Return damping and friction by joint of the tree, and what drags the platform.

    A universal joint turns about x0 as fast as the leg on its slider, and about y0 as fast as the platform:
    no force of the actuators tells where at these rates there is friction.
    """
    found: dict[str, dict[str, Any]] = {}
    rates = {"damping": friction.viscous, "friction": friction.coulomb}
    for what, by_joint in rates.items():
        for name, value in by_joint.items():
            own = found.setdefault(_ALIKE.get(name, name), {})
            own[what] = own.get(what, 0.0) + value
    both = [name for name in ("universal_a", "universal_b") if name in friction.joints]
    total = [sum(by_joint.get(name, 0.0) for name in both) for by_joint in rates.values()]
    name = f"{' and '.join(both)} about y0"
    return found, (Drag(name, "base_link", "platform", *total),) if both else ()


def _moved(body: Body, place: Placement) -> Body:
    """Return a body seen from a frame in which its own frame has this placement."""
    turn = place.rotation
    inertia = turn @ body.inertia @ turn.T
    return Body(body.mass, place.position + turn @ body.com, (inertia + inertia.T) / 2)


def _joints(parameters: Parameters) -> tuple[Joint, ...]:
    geometry, limits = parameters.geometry, joint_limits(parameters)
    R, r, L, b = geometry.R, geometry.r, geometry.L, geometry.b
    rod, own = rod_axes(geometry), parameters.actuators
    added = (own.inertia, own.balance_at_home(parameters.gravity), own.stiffness)
    drives = dict(zip(SLIDES, np.column_stack(added).tolist(), strict=True))

    def slide(name: str, child: str, place: _Point) -> Joint:
        return Joint(name, "prismatic", "base_link", child, _at(place), _Z, limits[name], None, *drives[name])

    def hinge(name: str, parent: str, child: str, place: Placement, mimic: Mimic | None = None) -> Joint:
        return Joint(name, "revolute", parent, child, place, _Y, limits[name], mimic)

    return (
        slide("slide_a", "slider_a", (0.0, -R, 0.0)),
        hinge("hinge_a", "slider_a", "leg_a", _at(_ORIGIN, _leg_axes(geometry, +1))),
        _marker("leg_a", "leg_a_tip", (L, 0.0, 0.0)),
        slide("slide_b", "slider_b", (0.0, R, 0.0)),
        hinge("hinge_b", "slider_b", "leg_b", _at(_ORIGIN, _leg_axes(geometry, -1))),
        _marker("leg_b", "leg_b_tip", (L, 0.0, 0.0)),
        slide("slide_c", "slider_c", (-R, 0.0, 0.0)),
        hinge("hinge_c", "slider_c", "crossbar_upper", Placement()),
        hinge("hinge_left", "crossbar_upper", "rod_left", _at((0.0, b, 0.0), rod)),
        # At hinge_lower = -hinge_left the lower cross-bar stays parallel to the upper one.
        hinge("hinge_lower", "rod_left", "crossbar_lower", _at((L, 0.0, 0.0)), mimic=Mimic("hinge_left", -1)),
        _marker("crossbar_lower", "crossbar_lower_right", (0.0, 0.0, 2 * b)),
        hinge("hinge_platform", "crossbar_lower", "platform", _at((0.0, 0.0, b), rod.T)),
        _marker("platform", "platform_a", (r, -r, 0.0)),
        _marker("platform", "platform_b", (r, r, 0.0)),
        _marker("platform", PLATFORM, (r, 0.0, 0.0)),
        hinge(
            "hinge_right",
            "crossbar_upper",
            "rod_right",
            _at((0.0, -b, 0.0), rod),
            mimic=Mimic("hinge_left", 1),
        ),
        _marker("rod_right", "rod_right_tip", (L, 0.0, 0.0)),
    )


def _at(place: _Point, rotation: FloatArray | None = None) -> Placement:
    return Placement(np.array(place), np.eye(3) if rotation is None else rotation)


def _marker(parent: str, name: str, place: _Point) -> Joint:
    return Joint(f"{name}_fixed", "fixed", parent, name, _at(place))


def _leg_axes(geometry: Geometry, side: int) -> FloatArray:
    """Return the axes of a leg at home: x down the leg toward the side of +y0 or -y0, y = x0, z = x × y."""
    s, c = side * (geometry.R - geometry.r) / geometry.L, geometry.h / geometry.L
    return np.array([[0.0, 1.0, 0.0], [s, 0.0, -c], [-c, 0.0, -s]])


def rod_axes(geometry: Geometry) -> FloatArray:
    """Return the axes of a rod at home: x = e down the rod, y = n its hinge axis, z = e × n = -y0.

    The axes are its columns, in the fixed frame.
    """
    s, c = (geometry.R - geometry.r) / geometry.L, geometry.h / geometry.L
    return np.array([[s, c, 0.0], [0.0, 0.0, -1.0], [-c, s, 0.0]])


BAR_MASS, MARKER_MASS = 0.02, 0.001
"""What a cross-bar and a marker take [kg]; less where their donors are light."""

BAR_INERTIA, MARKER_INERTIA = 1e-6, 1e-9
"""ε of a cross-bar, and the inertia of a marker [kg m²]; less where their donors are light."""

SHARES = tuple(4.0**-n for n in range(7))
"""What is tried of these, one after the other, until every donor is left a possible body."""

_Part: TypeAlias = tuple[float, FloatArray, FloatArray]
"""Mass, centre and inertia about it of something to add; negative to take away."""


def with_masses(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with the same dynamics in which every link has a mass."""
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
