"""Forward kinematics: the pose at given sliders, in the working mode of `p3dof.closed_form.kinematics`."""

from __future__ import annotations

from p3dof._base.algebra import Ordered, Scalar, Vector
from p3dof.closed_form.compiled.reduced.constants import Model

NEAR_REACH = 1e-12
"""Shares of L² that squares of roots have in an assembly that is clearly good, and of L its drops."""


def assembled(model: Model, sliders: Vector, xp: Ordered) -> tuple[Vector, Scalar]:
    """Return the pose at slider positions, and by how much it is clearly good.

    Parameters
    ----------
    model : Model
        The machine; only its lengths matter.
    sliders : tuple
        λ10 of A, B, C [m].
    xp : Ordered
        Where sqrt, sin, atan2 and `minimum` come from.

    Returns
    -------
    pose : tuple
        y [m], z [m], θ [rad].
    margin : number, array or symbol
        Zero, negative or NaN where the working mode does not exist, or hardly.
    """
    r, R, L = model[:3]
    width = R - r
    mean, half = (sliders[0] + sliders[1]) * 0.5, (sliders[1] - sliders[0]) * 0.5
    distance = xp.sqrt(width * width + half * half)  # half of that between the centres of the circles A, B
    circles = (L - distance) * (L + distance)
    reach, share = xp.sqrt(circles), 1 / distance
    y = reach * half * share
    p = mean - reach * width * share  # z - h
    q = sliders[2] - p
    rho2 = R * R + q * q
    rho = xp.sqrt(rho2)
    K = (q * q + (r * r + R * R) - (L - y) * (L + y)) * (1 / (2 * r))
    closure = (rho - K) * (rho + K)
    theta = xp.atan2(q, R) - xp.atan2(xp.sqrt(closure), K)
    drops = (sliders[0] - p, sliders[1] - p, q - r * xp.sin(theta))
    squares = xp.minimum(circles, closure)
    lowest = xp.minimum(xp.minimum(drops[0], drops[1]), drops[2])
    found = xp.minimum(squares - NEAR_REACH * (L * L), L * lowest - NEAR_REACH * (L * L))
    pose = (y, p + xp.sqrt((L - width) * (L + width)), theta)
    total = y + pose[1] + theta
    return pose, found + (total - total)  # NaN where a result is not finite
