"""Measures of the machine as it stands: size, mass, bending of its rods, room between its solids."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof.closed_form.compiled import reduced
from p3dof.design.optimisation.measure import ClosedForm
from p3dof.design.optimisation.of_poses import legs
from p3dof.design.optimisation.population import Numbers, Population


def _width(n: Numbers, population: Population) -> Any:
    return _column(2 * n.R, population)


def _mass(n: Numbers, population: Population) -> Any:
    """All that moves moves along z: the entry of the mass matrix."""
    none = np.zeros(1)
    x = reduced.shape(n.model, none, none, np)
    return _column(reduced.mass_matrix(n.model, x, none, np)[1][1], population)


def _bending(n: Numbers, population: Population) -> Any:
    """First natural frequency of a rod between hinges, (π / 2 L²) √(E I / μ), with √(I/A) = radius / 2."""
    radius = n.size("rod_radius")
    return _column(
        np.pi * radius / (4 * n.L**2) * np.sqrt(population.setting.modulus / n.density), population
    )


def _buckling(n: Numbers, population: Population) -> Any:
    """Euler's load of a rod between two hinges, π² E I / L²."""
    radius = n.size("rod_radius")
    return _column(np.pi**3 * population.setting.modulus * radius**4 / (4 * n.L**2), population)


def _clearance(n: Numbers, population: Population) -> Any:
    """Gaps between solids: sliders and plate at all poses of the box (or at home), rods, sliders.

    Slider and plate are apart if they are so across the guide-ways or along them.
    """
    edge, rod, corner = n.size("slider_edge"), n.size("rod_radius"), n.size("corner_radius")
    thickness = n.size("plate_thickness")
    box = population.setting.box
    y, theta = (np.zeros(1), np.zeros(1)) if box is None else box.poses
    x = legs(n, y, theta)
    edges = thickness / 2 * np.cos(theta) + corner * np.abs(np.sin(theta))  # of the plate, upward
    gaps = [
        np.maximum(across - edge / 2 - corner, drop - edge / 2 - upward)
        for across, drop, upward in (
            (x.wa, x.Sa, thickness / 2),
            (x.wb, x.Sb, thickness / 2),
            (x.wc, x.Sc, edges),
        )
    ]
    gaps += [_column(2 * n.b - 2 * rod, population), _column(n.R - edge, population)]
    rows = [np.broadcast_to(gap, (len(population), np.shape(gap)[-1])) for gap in gaps]
    return np.concatenate(rows, axis=1)


def _column(values: Any, population: Population) -> Any:
    return np.broadcast_to(values, (len(population), 1))


OF_SOLIDS = (
    ClosedForm("width", "m", "small", "width of the base between the guide-ways of A and B, 2R", _width),
    ClosedForm("moving_mass", "kg", "small", "mass of all that moves", _mass),
    ClosedForm(
        "rod_frequency", "Hz", "large", "first bending frequency of a rod between its hinges", _bending
    ),
    ClosedForm("rod_buckling", "N", "large", "Euler's buckling load of a rod between its hinges", _buckling),
    ClosedForm("clearance", "m", "large", "least gap between solids that come side by side", _clearance),
)
"""Measures of the machine as it stands."""
