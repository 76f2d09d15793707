"""What every MJCF has that this package writes: how MuJoCo computes, and how stiff closed loops are."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.markup.text import numbers, sub

TIME_STEP = 1e-3
"""Step of the simulation [s]."""

STIFFNESS = 1e6
"""Stiffness of a closed loop by mass [1/s²]: a step is 1 rad of its vibration, RK4 is stable up to 2.7."""


def option(root: ET.Element, gravity: FloatArray) -> None:
    """Write how MuJoCo computes.

    Parameters
    ----------
    root : Element
        The root element of the file.
    gravity : (3,) array
        Gravity [m/s²].
    """
    # Dense: MuJoCo 4.0.0 factorises some sparse Jacobians wrongly (its release notes of 4.0.1).
    sub(
        root,
        "option",
        gravity=numbers(gravity),
        timestep=numbers(TIME_STEP),
        integrator="RK4",
        solver="Newton",
        jacobian="dense",
        tolerance="1e-12",
    )


def stiff_equalities(root: ET.Element) -> ET.Element:
    """Write how stiff equalities are, and return the element of the defaults.

    As stiff as the step allows: with Runge-Kutta the gaps stay near 1e-8 m; MuJoCo's own defaults leave a
    millimetre. Its Euler and implicit integrators diverge at this stiffness.

    Parameters
    ----------
    root : Element
        The root element of the file.

    Returns
    -------
    Element
    """
    defaults = sub(root, "default")
    damping = np.sqrt(STIFFNESS)  # half of critical, where position and speed are most exact at this step
    # .9999 is the most that MuJoCo takes; the other numbers are its own.
    sub(defaults, "equality", solref=numbers(-STIFFNESS, -damping), solimp="0.9999 0.9999 0.001 0.5 2")
    return defaults
