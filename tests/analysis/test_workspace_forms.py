"""The closed forms of the workspace: against the kinematics of the package, and against plain searches."""

import numpy as np
import pytest
from hypothesis import given
from machines import SEEDS, random_geometry

import p3dof
from p3dof.analysis import workspace as ws
from p3dof.closed_form import kinematics

PAPER = ws.Sizes.of(p3dof.PAPER.geometry)


def poses_of(geometry, rng, count):
    y = rng.uniform(-1, 1, count) * (geometry.L - geometry.R + geometry.r)
    return np.stack([y, np.zeros(count), rng.uniform(-np.pi, np.pi, count)], axis=-1)


@given(SEEDS)
def test_offsets_angles_and_determinants_are_those_of_the_kinematics(seed):
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    sizes, poses = ws.Sizes.of(geometry), poses_of(geometry, rng, 50)
    known = kinematics.singularity(geometry, poses)
    inside = known.serial.min(axis=-1) > 1e-3 * geometry.L
    poses, y, theta = poses[inside], poses[inside][:, 0], poses[inside][:, 2]
    sliders = kinematics.inverse_kinematics(geometry, poses).sliders
    found = np.stack(ws.offsets(sizes, y, theta), axis=-1)
    np.testing.assert_allclose(found, sliders, rtol=0, atol=1e-12 * geometry.L)
    np.testing.assert_allclose(ws.actuation_angle(sizes, y, theta), known.actuation[inside], atol=1e-7)
    scale = np.abs(known.determinant[inside]).max(initial=1e-30)
    np.testing.assert_allclose(
        ws.determinant(sizes, y, theta), known.determinant[inside], rtol=0, atol=1e-9 * scale
    )
    jacobian = kinematics.inverse_jacobian(geometry, poses)
    np.testing.assert_allclose(
        ws.arm(sizes, y, theta), jacobian[:, 2, 2], rtol=0, atol=1e-12 * 1e3 * geometry.R
    )


def test_many_designs_are_the_rows_of_one_call():
    rng = np.random.default_rng(5)
    machines = [random_geometry(rng) for _ in range(6)]
    columns = (np.array([[getattr(g, name)] for g in machines]) for name in ("r", "R", "L"))
    together = ws.Sizes(*columns)
    y, theta = rng.uniform(-0.05, 0.05, 9), rng.uniform(-0.5, 0.5, 9)
    box = (np.array([[-0.02]]), 0.03), (-0.3, 0.4)
    boxes = ws.box_margins(together, *box, 0.5)
    for row, geometry in enumerate(machines):
        sizes = ws.Sizes.of(geometry)
        np.testing.assert_array_equal(
            ws.height(together, y, theta, 0.4)[row], ws.height(sizes, y, theta, 0.4)
        )
        np.testing.assert_array_equal(
            ws.actuation_angle(together, y, theta)[row], ws.actuation_angle(sizes, y, theta)
        )
        alone = ws.box_margins(sizes, (-0.02, 0.03), (-0.3, 0.4), 0.5)
        assert [float(np.squeeze(v[row])) for v in boxes] == [float(v) for v in alone]


@given(SEEDS)
def test_a_box_leaves_what_a_fine_grid_of_its_poses_leaves(seed):
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    sizes = ws.Sizes.of(geometry)
    y = np.sort(rng.uniform(-0.7, 0.7, 2)) * (geometry.L - geometry.R + geometry.r)
    theta = np.sort(rng.uniform(-2.5, 1.2, 2))
    found = ws.box_margins(sizes, tuple(y), tuple(theta), 1.0)
    across, turned = np.meshgrid(np.linspace(*y, 141), np.linspace(*theta, 281))
    serial = np.stack(ws.drops(sizes, across, turned)).min(axis=0) / geometry.L
    if np.isnan(serial).any():
        assert found.serial < 0.08  # out of reach, or nearer to its border than the grid can tell
        return
    assert found.serial == pytest.approx(serial.min(), abs=1e-12)
    angles = np.pi / 2 - np.abs(ws.lean(sizes, across, turned))
    assert angles.min() - 2e-3 < found.actuation <= angles.min() + 1e-12
    if found.actuation > 0:
        offsets = np.stack(ws.offsets(sizes, across, turned))
        span = offsets.max() - offsets.min()
        assert span - 1e-12 <= 1.0 - found.height <= span + 2e-4 * geometry.L
        assert found.highest - found.lowest == pytest.approx(1.0 - found.height, abs=1e-12)


def test_complex_steps_differentiate_a_box_by_the_lengths():
    base = np.array(PAPER)
    box = (-0.1, 0.1), (-np.pi / 6, np.pi / 6), 0.4
    for k in range(3):
        moved = base.astype(complex)
        moved[k] += 1e-30j
        exact = [np.imag(v) / 1e-30 for v in ws.box_margins(ws.Sizes(*moved), *box)]
        ends = [ws.box_margins(ws.Sizes(*(base + s * 1e-6 * np.eye(3)[k])), *box) for s in (1, -1)]
        differences = [(one - other) / 2e-6 for one, other in zip(*ends, strict=True)]
        np.testing.assert_allclose(exact, differences, atol=1e-7)


def test_out_of_reach_a_box_goes_on_in_numbers():
    found = ws.box_margins(PAPER, (-0.6, 0.6), (-3.0, 3.0), 0.4)
    assert np.isfinite([float(value) for value in found]).all()
    assert found.serial < 0
    assert found.actuation < 0


def test_the_aspect_of_the_paper_is_bounded_where_the_closed_forms_say():
    y = np.array([0, 0.05, 0.1, 0.15, 0.2, 0.24])
    lower, upper = ws.aspect_range(PAPER, y)
    known = [60, 59.790906, 59.133949, 57.926964, 55.942605, 53.470393]
    np.testing.assert_allclose(np.degrees(upper), known, atol=1e-6)
    assert np.degrees(lower[0]) == pytest.approx(-146.44, abs=5e-3)
    edge = ws.aspect_range(PAPER, np.array([0.25 - 1e-12]))[0]
    assert np.degrees(edge[0]) == pytest.approx(-128.5, abs=5e-3)


@given(SEEDS)
def test_the_aspect_is_the_piece_around_the_middle_of_what_a_search_finds(seed):
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    sizes = ws.Sizes.of(geometry)
    serial, actuation = rng.choice([0.0, 0.05, 0.3]), rng.choice([0.0, 0.05, 0.25])
    edge = geometry.L * np.sqrt(1 - serial**2) - (geometry.R - geometry.r)
    if edge <= 0:
        return
    for y in rng.uniform(-1, 1, 5) * edge:
        lower, upper = (float(end[0]) for end in ws.aspect_range(sizes, np.array([y]), serial, actuation))
        theta = np.linspace(-np.pi, np.pi, 4001)
        poses = np.stack([np.full_like(theta, y), 0 * theta, theta], axis=-1)
        known = kinematics.singularity(geometry, poses)
        drop = np.stack(np.broadcast_arrays(*ws.drops(sizes, y, theta))).min(axis=0) / geometry.L
        fine = (drop >= serial) & (known.actuation >= actuation)
        if np.isnan(lower):
            assert not fine[np.abs(theta) < 0.005].any()
            continue
        step = theta[1] - theta[0]
        inner = (theta > lower + 1e-9) & (theta < upper - 1e-9)
        assert fine[inner].all()
        for end, side in ((lower, -1), (upper, 1)):  # just beyond its ends there is none
            place = end + side * 1e-5
            if abs(place) < np.pi:
                pose = np.array([y, 0, place])
                beyond = kinematics.singularity(geometry, pose)
                drops = np.array([float(d) for d in ws.drops(sizes, y, place)]) / geometry.L
                assert not (drops.min() >= serial and beyond.actuation >= actuation), (end, step)


@given(SEEDS)
def test_the_stroke_bounds_theta_where_the_height_ends(seed):
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    sizes = ws.Sizes.of(geometry)
    y = rng.uniform(-0.9, 0.9, 8) * (geometry.L - geometry.R + geometry.r)
    travel = geometry.L * rng.uniform(0.05, 1.0)
    whole = ws.aspect_range(sizes, y)
    lower, upper = ws.stroke_range(sizes, y, *whole, travel)
    for k in range(len(y)):
        theta = np.linspace(whole[0][k], whole[1][k], 3001)[1:-1]
        fine = ws.height(sizes, y[k], theta, travel) >= 0
        if np.isnan(lower[k]):
            assert fine.sum() <= 1
            continue
        inner = (theta >= lower[k] + 1e-9) & (theta <= upper[k] - 1e-9)
        np.testing.assert_array_equal(fine[inner], np.True_)
        outer = (theta < lower[k] - 1e-9) | (theta > upper[k] + 1e-9)
        np.testing.assert_array_equal(fine[outer], np.False_)
