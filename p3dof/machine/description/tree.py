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
"""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.description.mechanism import Closure, Joint, Link, Mechanism, Mimic, Placement
from p3dof.machine.description.ranges import joint_limits
from p3dof.machine.description.shapes import Solids
from p3dof.machine.parameters import PLATFORM, SLIDES, Body, Geometry, Parameters

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

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    Mechanism
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
    joints = _joints(parameters)
    links = tuple(
        Link(name, bodies.get(name), solids.visuals.get(name, ()), solids.collisions.get(name, ()))
        for name in ("base_link", *(joint.child for joint in joints))
    )
    return Mechanism("p3dof", links, joints, CLOSURES, SLIDES, parameters.gravity)


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

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.

    Returns
    -------
    ndarray, shape (3, 3)
        The axes are its columns, in the fixed frame.
    """
    s, c = (geometry.R - geometry.r) / geometry.L, geometry.h / geometry.L
    return np.array([[s, c, 0.0], [0.0, 0.0, -1.0], [-c, s, 0.0]])
