"""Motion/force transmission in closed form: what each rod passes on between slider and platform."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.workspace.closed_forms import Sizes, drops, extents


def input_transmission(sizes: Sizes, y: FloatArray, theta: FloatArray) -> FloatArray:
    """Return ITI of A, B, C, ``|rod direction · slider direction| = S/L``.

    The rod of leg C is the middle line between the rods of the parallelogram.

    Parameters
    ----------
    sizes : Sizes
        Of the machine.
    y, theta : ndarray, shape (n,)
        Position [m] and rotation [rad] of the platform.

    Returns
    -------
    ndarray, shape (n, 3)
        From 0 (serial singularity) to 1; NaN out of reach.
    """
    found: FloatArray = np.stack(drops(sizes, y, theta), axis=-1) / sizes.L
    return found


def output_transmission(sizes: Sizes, y: FloatArray, theta: FloatArray) -> FloatArray:
    """Return OTI of A, B, C, ``|rod direction · v| / |v|``, v the velocity of the leg's platform joint.

    v is what it is when the leg's own slider alone moves. With sliders B and C held, P can only turn about
    the slider of B: OTI of A (and of B) is the sine of the angle between the rods A and B. With A and B held
    the platform can only turn about P: OTI of C is the cosine of the angle between its arm's motion and the
    rod.

    Parameters
    ----------
    sizes : Sizes
        Of the machine.
    y, theta : ndarray, shape (n,)
        Position [m] and rotation [rad] of the platform.

    Returns
    -------
    ndarray, shape (n, 3)
        From 0 (actuation singularity) to 1; NaN out of reach.
    """
    wa, wb, wc = extents(sizes, y, theta)
    a, b, c = drops(sizes, y, theta)
    across = np.abs(wa * b + wb * a) / sizes.L**2
    return np.stack([across, across, np.abs(np.cos(theta) * c - np.sin(theta) * wc) / sizes.L], axis=-1)
