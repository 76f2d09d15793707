"""Worst cases and conditions: every corner of the tolerances by the other way, closures of the test's own."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

import p3dof
from p3dof.parameters import PAPER
from p3dof.tolerances import identifiability

MOTION = p3dof.paper_motion(101)
LENGTHS = ("r", "R", "L")
SIGMA, WORST = 1e-5, 3.0
"""Of each length [m], and how many of these the worst case is."""


def forces_of(**changes: float) -> np.ndarray:
    geometry = replace(PAPER.geometry, **{k: getattr(PAPER.geometry, k) + v for k, v in changes.items()})
    machine = p3dof.load(replace(PAPER, geometry=geometry))
    return machine.inverse_dynamics(MOTION, method="pinocchio").forces


@pytest.fixture(scope="module")
def corners() -> np.ndarray:
    """By how much forces change at the worst corner of all lengths, (N, 3), by the other way to the forces.

    Half the difference of opposite corners leaves errors of third order only.
    """
    worst = np.zeros((len(MOTION), 3))
    for signs in product((1.0, -1.0), repeat=2):
        step = WORST * SIGMA * np.array([1.0, *signs])
        there, back = (forces_of(**dict(zip(LENGTHS, side * step, strict=True))) for side in (1, -1))
        worst = np.maximum(worst, np.abs(there - back) / 2)
    return worst


def test_the_worst_case_is_that_of_the_worst_corner(corners: np.ndarray) -> None:
    found = p3dof.tolerance(PAPER, MOTION, sigma=dict.fromkeys(LENGTHS, SIGMA), worst=WORST)
    assert_allclose(found.worst, corners, rtol=1e-5, atol=1e-9)  # third order; rounding of 100 N forces
    assert (found.worst < np.sqrt(3) * WORST * found.deviation * (1 + 1e-12)).all()  # Cauchy and Schwarz
    assert (found.worst > 1.1 * WORST * found.deviation).any()  # several lengths matter at once


def test_the_worst_peak_is_where_force_and_change_are_large_together(corners: np.ndarray) -> None:
    found = p3dof.tolerance(PAPER, MOTION, sigma=dict.fromkeys(LENGTHS, SIGMA), worst=WORST)
    sizes = np.abs(forces_of())
    each = (sizes + corners).max(axis=0)
    assert_allclose(found.peak_worst, [*each, each.max()], rtol=0, atol=1e-8)
    apart = sizes.max(axis=0) + corners.max(axis=0) - each
    assert apart.max() > 1e-3  # largest force and largest change are at different times


def closures(x: np.ndarray, p: np.ndarray, sliders: np.ndarray) -> np.ndarray:
    """Return how open the legs are: squares of distances between their ends less those of their lengths."""
    (y, z, theta), (R, r, L, e) = x, p.reshape(3, 4).T
    rise = sliders - e - z + PAPER.geometry.h
    across = [R[0] - r[0] + y, R[1] - r[1] - y, R[2] - r[2] * np.cos(theta)]
    aside = [0.0, 0.0, y]
    up = [rise[0], rise[1], rise[2] - r[2] * np.sin(theta)]
    return np.array([across[k] ** 2 + aside[k] ** 2 + up[k] ** 2 - L[k] ** 2 for k in range(3)])


def own_rows(pose: np.ndarray) -> np.ndarray:
    """Return how a pose changes with the twelve parameters, sliders held, (3, 12), by complex steps."""
    size = PAPER.geometry
    p = np.tile([size.R, size.r, size.L, 0.0], 3)
    sliders = p3dof.load().inverse_kinematics(pose).sliders
    assert_allclose(closures(pose, p, sliders), 0, atol=1e-15)

    def by(x: np.ndarray, q: np.ndarray) -> np.ndarray:
        return closures(x, q, sliders).imag / 1e-30

    by_pose = np.stack([by(pose + 1e-30j * row, p) for row in np.eye(3)], axis=1)
    by_p = np.stack([by(pose, p + 1e-30j * row) for row in np.eye(12)], axis=1)
    return -np.linalg.solve(by_pose, by_p)


def test_the_condition_is_that_of_what_can_be_found() -> None:
    """Two of the twelve cannot: the smallest of all singular values is rounding, and tells nothing."""
    rng = np.random.default_rng(4)
    poses = rng.uniform([-0.1, -0.1, -0.6], [0.1, 0.1, 0.6], (40, 3))
    rows = np.concatenate([own_rows(pose) for pose in poses])
    rows /= np.linalg.norm(rows, axis=0)
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(rows.T @ rows)[::-1], 0))
    found = identifiability(PAPER, poses)
    assert found.rank == 10
    assert_allclose(found.singular_values[:10], values[:10], rtol=1e-7)  # squared conditioning, 1e3
    assert found.condition == pytest.approx(values[0] / values[9], rel=1e-7)
    assert found.singular_values[11] < 1e-14 * values[0]  # the last would say 1e14 and more
