"""How far and how fast the joints can go."""

from __future__ import annotations

import math

from p3dof.machine.description.mechanism import JointLimits
from p3dof.machine.parameters import Geometry, Parameters

MARGIN = 0.1
"""Added at both ends of what a passive joint can reach [rad], so that no engine's soft stop acts inside."""


def joint_limits(parameters: Parameters) -> dict[str, JointLimits]:
    """Return the limits of all moving joints.

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

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    dict of str to JointLimits
        By joint name.
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
