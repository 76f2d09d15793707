"""The problem of structural optimisation that tests share: the paper's motion, steel solids, four sizes."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof.design import DesignProblem
from p3dof.design.optimisation import Box

VARIABLES = {"r": (0.08, 0.2), "R": (0.15, 0.5), "L": (0.2, 0.8), "rod_radius": (0.003, 0.015)}
STEEL = {"slider_edge": 0.05, "plate_thickness": 0.05, "corner_radius": 0.02}
CONSTRAINTS = {
    "box_height": {"min": 0.15},
    "singularity": {"min": np.radians(15)},
    "serial_reach": {"min": 0.4},
    "rod_frequency": {"min": 120.0},
    "lowest_frequency": {"min": 80.0},
    "relations": ["R >= r + 0.03", "L >= 1.02*(R - r + 0.1)"],
}
PAPER_DESIGN = [0.1, 0.25, 0.4, 0.01]
BETTER = [
    ("free", 60.3069, [0.08, 0.3042, 0.3537, 0.00368]),
    ("width 0.5", 61.6491, [0.08, 0.25, 0.29459, 0.003]),
    ("r 0.1", 76.0598, [0.1, 0.33601, 0.36662, 0.00396]),
    ("r 0.1, width 0.5", 80.2398, [0.1, 0.25, 0.27277, 0.003]),
]
"""Optima found by two other programs, rounded: peak force [N] and design."""


def paper_problem(**changes: Any) -> DesignProblem:
    """Return the problem, with some arguments of it changed."""
    arguments: dict[str, Any] = {
        "objectives": ["peak_force", "width", "rms_power"],
        "constraints": CONSTRAINTS,
        "box": Box((-0.1, 0.1), (-np.pi / 6, np.pi / 6)),
        "bodies": "solids",
        "fixed": STEEL,
    }
    return DesignProblem(VARIABLES, **(arguments | changes))


FILE: dict[str, Any] = {
    "motion": {"paper": 201},
    "bodies": "solids",
    "variables": {
        "r": ["80 mm", 0.2],
        "R": ["150 mm", "500 mm"],
        "L": ["200 mm", "80 cm"],
        "rod_radius": ["3 mm", "15 mm"],
    },
    "fixed": {"slider_edge": "50 mm", "plate_thickness": 0.05, "corner_radius": "20 mm"},
    "box": {"y": ["-100 mm", "100 mm"], "theta": ["-30 deg", "30 deg"]},
    "objectives": ["peak_force", "width", "rms_power"],
    "constraints": {
        "box_height": {"min": "150 mm"},
        "singularity": {"min": "15 deg"},
        "serial_reach": {"min": 0.4},
        "rod_frequency": {"min": 120},
        "lowest_frequency": {"min": 80},
        "relations": ["R >= r + 0.03", "L >= 1.02*(R - r + 0.1)"],
    },
    "modulus": "210 GPa",
    "drive_stiffness": "10 N/um",
}
