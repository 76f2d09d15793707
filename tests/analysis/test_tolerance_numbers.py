"""Numbers of tolerances and sensitivities: differences by the other way to the forces, every corner of the
tolerances, closures of the test's own, left-out rows."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import fsolve
from scipy.stats import norm
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof.analysis.tolerances import identifiability, sensitivity_table, sobol_indices, tolerance_tables
from p3dof.machine.parameters import PAPER, Body

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
    assert_allclose(closures(pose, p, sliders), 0, rtol=0, atol=1e-15)

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


SHORT = p3dof.paper_motion(51)


def machine_of(R: float = 0.0, mass: float = 0.0) -> p3dof.Manipulator:
    """Return the paper's machine with another R, and a platform of another mass but the same shape."""
    body = PAPER.bodies.platform
    share = 1 + mass / body.mass
    bodies = replace(PAPER.bodies, platform=Body(share * body.mass, body.com, share * body.inertia))
    geometry = replace(PAPER.geometry, R=PAPER.geometry.R + R)
    return p3dof.load(replace(PAPER, geometry=geometry, bodies=bodies))


def short_forces(**off: float) -> np.ndarray:
    return machine_of(**off).inverse_dynamics(SHORT, method="pinocchio").forces


@pytest.fixture(scope="module")
def slopes() -> tuple[np.ndarray, np.ndarray]:
    """Forces (N, 3), and their derivatives by R and by the platform's mass (2, N, 3)."""
    h, m = 1e-5, 1e-3
    by_R = (short_forces(R=h) - short_forces(R=-h)) / (2 * h)
    by_mass = (short_forces(mass=m) - short_forces(mass=-m)) / (2 * m)
    return short_forces(), np.array([by_R, by_mass])


SIGMAS = np.array([2e-4, 0.02 * PAPER.bodies.platform.mass])
GIVEN = {"R": "0.2 mm", "platform.mass": "2 %"}


@shows(
    "p3dof.analysis.tolerances.tolerance._of_forces", "p3dof.analysis.tolerances.tolerance.tolerance_tables"
)
def test_tables_of_forces_have_sums_over_differences(slopes: tuple[np.ndarray, np.ndarray]) -> None:
    forces, by = slopes
    result = p3dof.tolerance(PAPER, SHORT, sigma=GIVEN, worst=2.5)
    found = tolerance_tables(result)
    at = np.abs(forces).argmax(axis=0)
    sides = np.sign(forces[at, range(3)])
    peaks = np.abs(forces).max(axis=0)
    spread = SIGMAS[:, None, None] * by
    of_all = np.sqrt((spread**2).sum(axis=0))
    assert_allclose(result.low, forces - 1.9599640 * of_all, rtol=1e-8, atol=1e-6)
    assert_allclose(result.high, forces + 1.9599640 * of_all, rtol=1e-8, atol=1e-6)
    deviation = of_all.max(axis=0)
    of_peak = SIGMAS[:, None] * by[:, at, range(3)] * sides
    at_peak = np.sqrt((of_peak**2).sum(axis=0))
    worst = (np.abs(forces) + 2.5 * np.abs(spread).sum(axis=0)).max(axis=0)
    largest = int(peaks.argmax())
    columns = [peaks, deviation, at_peak, peaks + 1.6448536 * at_peak, worst]
    rows = dict(zip("ABC", zip(*columns, strict=True), strict=True))
    rows["largest"] = (peaks[largest], deviation.max(), at_peak[largest], columns[3][largest], worst.max())
    told = (0.95, 2.5)
    check_table(found[0], rows, header=told, note=["First order, by exact derivatives."])
    share = of_peak[:, largest] ** 2 / at_peak[largest] ** 2
    slope = by[:, at[largest], largest] * sides[largest]
    parts = {
        name: ((nominal, unit), (sigma, unit), (slope[k], f"N/{unit}"), float(f"{share[k]:.3g}"))
        for k, name, nominal, unit, sigma in (
            (1, "bodies.platform.mass", PAPER.bodies.platform.mass, " kg", SIGMAS[1]),
            (0, "geometry.R", PAPER.geometry.R, " m", SIGMAS[0]),
        )
    }
    parts = {name: (a, b, (c[0], c[1].replace(" ", "")), share) for name, (a, b, c, share) in parts.items()}
    assert share[1] > share[0]
    check_table(found[1], parts)


@shows("p3dof.analysis.tolerances.tolerance._of_forces")
def test_tables_of_machines_drawn_are_those_of_each_machine() -> None:
    """Each built by itself, for the other way to the forces; those that cannot move are counted."""
    motion = p3dof.paper_motion(11)
    sigma = {"L": "120 mm", "platform.mass": "2 %"}
    ask = {"sigma": sigma, "method": "montecarlo", "samples": 24, "seed": 4}
    found = p3dof.tolerance(PAPER, motion, **ask)
    forces = []
    for L, mass in found.drawn:
        bodies = machine_of(mass=mass).parameters.bodies
        try:
            geometry = replace(PAPER.geometry, L=PAPER.geometry.L + L)
            robot = p3dof.load(replace(PAPER, geometry=geometry, bodies=bodies))
            forces.append(robot.inverse_dynamics(motion, method="pinocchio").forces)
        except p3dof.P3dofError:
            continue
    each = np.array(forces)
    gone = 24 - len(each)
    assert 0 < gone < 12
    sizes = np.abs(each).max(axis=1)
    sizes = np.column_stack([sizes, sizes.max(axis=1)])
    deviation = each.std(axis=0, ddof=1)
    half = norm.ppf(0.975) * deviation
    assert_allclose(found.low, each.mean(axis=0) - half, rtol=0, atol=1e-9)
    assert_allclose(found.high, each.mean(axis=0) + half, rtol=0, atol=1e-9)
    spread = deviation.max(axis=0)
    nominal = np.abs(p3dof.load().inverse_dynamics(motion, method="pinocchio").forces).max(axis=0)
    in_order = np.sort(sizes, axis=0)
    place = 0.95 * (len(each) - 1)
    below = int(place)
    high = in_order[below] + (place - below) * (in_order[below + 1] - in_order[below])
    table = tolerance_tables(found)[0]
    rows = {
        name: (
            [*nominal, nominal.max()][k],
            [*spread, spread.max()][k],
            sizes[:, k].std(ddof=1),
            high[k],
            float(table.rows[k][5]),  # of first order: see the other tests
        )
        for k, name in enumerate(("A", "B", "C", "largest"))
    }
    check_table(
        table, rows, header=(0.95, 3), note=(24, "sampled machines", gone, "cannot perform the motion")
    )


def own_spread(pose: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    return own_rows(pose) * sigmas


@shows(
    "p3dof.analysis.tolerances.tolerance._of_poses", "p3dof.analysis.tolerances.tolerance.tolerance_tables"
)
def test_tables_of_poses_have_sums_over_closures_of_the_tests_own() -> None:
    poses = np.array([[0.1, 0.02, -0.5], [0.0, 0.0, 0.5]])
    given = {"R": "50 um", "L": "30 um", "encoder": "10 um", "L.b": "40 um"}
    of_legs = np.array([[50e-6, 0, 30e-6, 10e-6], [50e-6, 0, 40e-6, 10e-6], [50e-6, 0, 30e-6, 10e-6]])
    found = p3dof.tolerance(PAPER, pose=poses, sigma=given, worst=2.0)
    errors, parts = tolerance_tables(found)
    names = ["1: 0.1 m, 0.02 m, -28.65°", "2: 0 m, 0 m, 28.65°"]
    rows = {}
    for name, pose in zip(names, poses, strict=True):
        spread = own_spread(pose, of_legs.ravel()) * np.array([[1e6], [1e6], [1e3]])
        sigma = np.sqrt((spread**2).sum(axis=1))
        rows[name] = (*sigma, *(1.9599640 * sigma), *(2.0 * np.abs(spread).sum(axis=1)))
    check_table(errors, rows, header=3 * (0.95,) + 3 * (2,), note=["First order"])
    y, z, turn = np.max(list(rows.values()), axis=0)[:3]
    assert f"up to {y:.4g} µm in y, {z:.4g} µm in z, {turn:.4g} mrad" in repr(found)
    variances = own_spread(poses[0], of_legs.ravel()) ** 2
    shares = 100 * variances / variances.sum(axis=1, keepdims=True)
    wanted = {}
    for leg in range(3):
        for kind, name in enumerate(("R", "r", "L", "encoder")):
            if name != "r":
                k = 4 * leg + kind
                wanted[f"{name}.{'abc'[leg]}"] = (1e6 * of_legs[leg, kind], *shares[:, k])
    check_table(parts, wanted)


@shows("p3dof.analysis.tolerances.pose.PoseTolerance.errors", "p3dof.analysis.tolerances.tolerance._of_poses")
def test_errors_of_machines_drawn_are_those_at_which_their_legs_close() -> None:
    pose = np.array([0.1, 0.0, -0.5])
    given = {"R": "0.5 mm", "L": "0.5 mm", "r": "0.2 mm", "encoder": "0.1 mm"}
    found = p3dof.tolerance(PAPER, pose=pose, sigma=given, method="montecarlo", samples=12, seed=2)
    size = PAPER.geometry
    p = np.tile([size.R, size.r, size.L, 0.0], 3)
    sliders = p3dof.load().inverse_kinematics(pose).sliders
    at = np.array([fsolve(closures, pose, (p + off, sliders), xtol=1e-13) for off in found.drawn])
    check_evidence(found, "errors", at - pose, rtol=1e-8, atol=1e-12)
    table = tolerance_tables(found)[0]
    scale = np.array([1e6, 1e6, 1e3])
    off = np.sort(np.abs(at - pose), axis=0)
    high = off[10] + 0.45 * (off[11] - off[10])  # .95 of the way from the first to the twelfth
    row = (*(scale * (at - pose).std(axis=0, ddof=1)), *(scale * high), *map(float, table.rows[0][7:]))
    check_table(
        table,
        {"1: 0.1 m, 0 m, -28.65°": row},
        header=3 * (0.95,) + 3 * (3,),
        note=(12, "sampled machines; the worst case is of first order."),
    )


@pytest.fixture(scope="module")
def matched() -> np.ndarray:
    """Results (rows, 4) of two variables, uncertain ones with an interaction: A, B, and A with one of B."""
    rng = np.random.default_rng(7)
    a, b = rng.normal(0, 1, (2, 3000, 2))

    def result(x: np.ndarray) -> np.ndarray:
        return 40 + 3 * x[:, 0] + x[:, 1] + 2 * x[:, 0] * x[:, 1]

    mixed = [np.where(np.arange(2) == k, b, a) for k in range(2)]
    rows = np.stack([result(x) for x in (a, b, *mixed)], axis=1)
    rows[5, 2] = np.nan
    return rows


def shares_and_errors(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return S1 and ST (2, d) by Jansen's formulas, and half widths from leaving out each row in turn."""
    a, b, mixed = rows[:, 0], rows[:, 1], rows[:, 2:]
    both = np.concatenate([a, b])
    squares = ((a - both.mean()) ** 2 + (b - both.mean()) ** 2) / 2
    gaps = np.stack([(b[:, None] - mixed) ** 2 / 2, (a[:, None] - mixed) ** 2 / 2])
    total = gaps.sum(axis=1) / squares.sum()
    without = (gaps.sum(axis=1, keepdims=True) - gaps) / (squares.sum() - squares)[:, None]
    count = len(rows)
    error = 1.9599640 * np.sqrt((count - 1) * without.var(axis=1))
    return np.stack([1 - total[0], total[1]]), error


@shows(
    "p3dof.analysis.tolerances.sensitivity.SobolIndices.first_error",
    "p3dof.analysis.tolerances.sensitivity.SobolIndices.total_error",
    "p3dof.analysis.tolerances.tolerance.sensitivity_table",
)
def test_indices_have_the_errors_of_left_out_rows(matched: np.ndarray) -> None:
    found = sobol_indices(matched.ravel(), ("x", "y"), "peak", "N", on_missing="drop")
    good = matched[np.isfinite(matched).all(axis=1)]
    shares, errors = shares_and_errors(good)
    check_evidence(found, "first_error", errors[0], rtol=2e-3)
    check_evidence(found, "total_error", errors[1], rtol=2e-3)
    both = good[:, :2].T.ravel()
    in_order = np.sort(both)
    ends = []
    for share in (0.025, 0.975):
        place = share * (len(both) - 1)
        ends.append(np.interp(place, np.arange(len(both)), in_order))
    rows = {name: tuple((shares[k, i], "±", errors[k, i]) for k in range(2)) for i, name in enumerate("xy")}
    check_table(
        sensitivity_table(found),
        rows,
        header=("S1", "ST"),
        note=(both.mean(), both.std(ddof=1), 0.95, *ends, len(good), 1, "left out"),
    )


@shows("p3dof.analysis.tolerances.tolerance.sensitivity_table")
def test_the_table_of_derivatives_has_differences(slopes: tuple[np.ndarray, np.ndarray]) -> None:
    forces, by = slopes
    found = p3dof.sensitivity(PAPER, SHORT, {"R": 1e-4, "platform.mass": "1 %"}, method="gradient")
    sample, leg = np.unravel_index(np.abs(forces).argmax(), forces.shape)
    peak = abs(forces[sample, leg])
    slope = by[:, sample, leg] * np.sign(forces[sample, leg])
    nominal = np.array([PAPER.geometry.R, PAPER.bodies.platform.mass])
    share = slope * nominal / peak
    names = ("geometry.R", "bodies.platform.mass")
    rows = {
        names[k]: ((nominal[k], unit), (slope[k], f"N/{unit}"), share[k]) for k, unit in ((0, "m"), (1, "kg"))
    }
    assert abs(share[0]) > abs(share[1])
    check_table(sensitivity_table(found), rows, title=(peak, " N"))
