"""The largest boxes of poses: against all boxes between the lines of grids, and tables of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from table_numbers import check_table, shows

import p3dof
from p3dof.analysis.workspace import Box, Workspace, WorkspaceMargins, box_table, largest

LINES, CLOSER = 17, 9
"""Lines of a grid over all boxes, and of one about the best of these, in each direction."""
ACROSS, TURNED = 33, 9
"""Poses that are looked at in each box along y and θ."""

CASES = {
    "tilted": ((0.14, 0.32, 0.55), (-0.15, 0.3), (-30, 55), WorkspaceMargins(), 0.1423, 0.1128),
    "wide": ((0.2, 0.22, 0.5), (-0.3, 0.3), (-60, 60), WorkspaceMargins(), 0.2288, 0.2034),
    "far from singular": (
        (0.1, 0.25, 0.4), (-0.25, 0.25), (-160, 160), WorkspaceMargins(0.2, np.radians(50)), None, None
    ),
    "by both margins": ((0.1, 0.25, 0.4), (-0.3, 0.3), (-86, 86), WorkspaceMargins(0.625, 0.756), None, None),
    "little travel": ((0.1, 0.25, 0.4), (-0.02, 0.02), (-45, 45), WorkspaceMargins(), None, None),
    "upright": ((0.1, 0.25, 0.4), (-0.2, 0.2), (-5, 70), WorkspaceMargins(0.5, np.radians(25)), None, None),
}  # fmt: skip
"""Sizes r, R, L [m], travel [m], tilt [deg], margins, and volumes that others found [m² rad]."""


def space_of(case: str) -> Workspace:
    (r, R, L), travel, tilt, margins, *_ = CASES[case]
    geometry = replace(p3dof.PAPER.geometry, r=r, R=R, L=L)
    limits = p3dof.machine.Limits(travel=travel, tilt=tuple(np.radians(tilt)))
    return p3dof.load(replace(p3dof.PAPER, geometry=geometry)).workspace(limits, margins)


def volumes(space: Workspace, ends: np.ndarray) -> np.ndarray:
    """Return the volumes of boxes (m, 4) by the poses of a grid in each; 0 where one does not fit.

    From positions of the sliders alone; the angle from det J = 0 is that between leg C's plane and the arm r
    of the platform, which is upright to it there.
    """
    r, R, L = space.sizes
    y = ends[:, :1] + (ends[:, 1:2] - ends[:, :1]) * np.linspace(0, 1, ACROSS)
    t = ends[:, 2:3] + (ends[:, 3:] - ends[:, 2:3]) * np.linspace(0, 1, TURNED)
    with np.errstate(invalid="ignore"):
        ab = np.sqrt(L**2 - np.stack([R - r + y, R - r - y]) ** 2)
        w = (R - r * np.cos(t))[:, None]
        c = np.sqrt(L**2 - y[:, :, None] ** 2 - w**2)
    sine, cosine = np.sin(t)[:, None], np.cos(t)[:, None]
    rise = c + r * sine
    angle = np.arcsin((cosine * c - sine * w) / np.hypot(c, w))
    serial = np.minimum(ab.min(axis=(0, 2)), c.min(axis=(1, 2))) / L  # NaN out of reach
    top = np.maximum(ab.max(axis=(0, 2)), rise.max(axis=(1, 2)))
    low = np.minimum(ab.min(axis=(0, 2)), rise.min(axis=(1, 2)))
    height = space.limits.travel[1] - space.limits.travel[0] - (top - low)
    good = (serial >= space.margins.serial) & (angle.min(axis=(1, 2)) >= space.margins.actuation)
    size = height * (ends[:, 1] - ends[:, 0]) * (ends[:, 3] - ends[:, 2])
    return np.where(good & (height > 0) & (ends[:, 0] < ends[:, 1]) & (ends[:, 2] < ends[:, 3]), size, 0.0)


def best_of_grids(space: Workspace) -> float:
    """Return the volume of the best of all boxes between the lines of a grid, then of a closer one."""
    y, theta = space.points.y, space.points.theta
    across, turned = (np.linspace(values.min(), values.max(), LINES) for values in (y, theta))
    pairs = [(a, b) for a, b in product(across, across) if a < b]
    ends = np.array([(*a, *b) for a in pairs for b in product(turned, turned) if b[0] < b[1]])
    best = ends[np.argmax(volumes(space, ends))]
    steps = [across[1] - across[0], turned[1] - turned[0]]
    low, high = space.limits.tilt
    for _ in range(2):
        about = zip(best, np.repeat(steps, 2), strict=True)
        axes = [at + step * np.linspace(-1, 1, CLOSER) for at, step in about]
        axes[2], axes[3] = np.maximum(axes[2], low), np.minimum(axes[3], high)
        ends = np.array(list(product(*axes)))
        sizes = volumes(space, ends)
        best, steps = ends[np.argmax(sizes)], [step / 3 for step in steps]
    return float(sizes.max())


@pytest.mark.parametrize("case", CASES)
def test_the_largest_box_is_that_of_all_boxes(case: str) -> None:
    space = space_of(case)
    box, symmetric = space.largest_box(), space.largest_symmetric_box()
    grid = best_of_grids(space)
    missed = 2e-3  # between the poses that the test looks at, ℓ may be (Δy/2)²/2L higher
    assert grid * (1 - missed) <= box.volume <= grid * 1.04  # a ninth of a line in each of four ends
    for found in (box, symmetric):
        ends = np.array([[*found.y, *found.theta]])
        inner = ends + 1e-9 * np.array([1, -1, 1, -1])
        assert volumes(space, inner)[0] == pytest.approx(found.volume, rel=missed)
        corners = np.array([[y, z, t] for y in found.y for z in found.z for t in found.theta])
        middle = corners.mean(axis=0)
        assert space.margin(middle + (1 - 1e-9) * (corners - middle)).inside.all()
    assert symmetric.y[0] == -symmetric.y[1]
    assert symmetric.theta[0] == -symmetric.theta[1]
    assert symmetric.volume <= box.volume * (1 + 1e-9)
    _, _, _, _, largest, around_home = CASES[case]
    if largest is not None:
        assert (round(box.volume, 4), round(symmetric.volume, 4)) == (largest, around_home)


def test_boxes_need_not_have_home_in_them() -> None:
    """Where only one side of θ keeps the margin, the symmetric box is nothing beside the largest."""
    space = space_of("far from singular")
    assert space.largest_box().volume > 2.5 * space.largest_symmetric_box().volume
    turned = space.largest_box((-1.2, -0.6))
    assert turned.theta == pytest.approx((-1.2, -0.6))
    assert turned.area > 0
    grid = np.linspace(-space.sizes.reach, space.sizes.reach, 81)
    ends = np.array([(a, b, -1.2, -0.6) for a, b in product(grid, grid) if a < b])
    best = volumes(space, ends).max() / 0.6
    assert best * (1 - 2e-3) <= turned.area <= best * 1.06
    with pytest.raises(p3dof.InputError, match=r"tilt: expected within the limits"):
        space.largest_box((-3.0, 0.0))


@shows("p3dof.analysis.workspace.workspace.box_table")
def test_the_table_has_both_boxes_and_says_which_is_which() -> None:
    space = space_of("tilted")
    table = box_table(space)
    found: dict[str, Box] = {"all": space.largest_box(), "symmetric": space.largest_symmetric_box()}
    r, R, L = space.sizes
    rows: dict[str, list[object]] = {"y": [], "z": [], "θ": []}
    volume = {}
    for name, box in found.items():
        (y0, y1), (t0, t1) = box.y, box.theta
        far = max(-y0, y1)
        h = np.sqrt(L**2 - (R - r) ** 2)
        lowest = min(
            np.sqrt(L**2 - (R - r + far) ** 2),
            np.sqrt(L**2 - far**2 - (R - r * np.cos(t0)) ** 2) + r * np.sin(t0),
        )
        highest = max(
            np.sqrt(L**2 - max(R - r - far, 0.0) ** 2),
            np.sqrt(L**2 - (R - r * np.cos(t1)) ** 2) + r * np.sin(t1),
        )
        z = (-0.15 - (lowest - h), 0.3 - (highest - h))
        volume[name] = (y1 - y0) * (t1 - t0) * (z[1] - z[0])
        for what, ends, unit in (("y", box.y, 1e3), ("z", z, 1e3), ("θ", box.theta, 180 / np.pi)):
            rows[what] += [unit * ends[0], unit * ends[1]]
    for what, unit in (("y", "mm"), ("z", "mm"), ("θ", "deg")):
        rows[what].append(unit)
    assert volume["all"] == pytest.approx(0.1423, abs=5e-5)
    assert volume["symmetric"] == pytest.approx(0.1128, abs=5e-5)
    told = (volume["all"], "Of all boxes", volume["symmetric"], "|y| ≤ Y, |θ| ≤ Θ")
    check_table(table, rows, note=told)


def test_a_box_ends_where_a_demand_does() -> None:
    """A lone velocity along y moves slider A by w/S of it: too much beyond a y that is known."""
    end, (r, R, L) = 0.12, (0.1, 0.25, 0.4)
    lever = (R - r + end) / np.sqrt(L**2 - (R - r + end) ** 2)
    limits = p3dof.machine.Limits(travel=(-0.25, 0.25), speed=2.0)
    margins = WorkspaceMargins(velocity=(2.0 / lever, 0, 0))
    space = p3dof.load().workspace(limits, margins)
    for box in (space.largest_box(), space.largest_symmetric_box()):
        assert np.array([*box.y, *box.theta]) == pytest.approx([-end, end, -np.pi / 4, np.pi / 4], abs=1e-6)
        assert max(np.abs(box.y)) <= end
        height = volumes(p3dof.load().workspace(limits), np.array([[-end, end, -np.pi / 4, np.pi / 4]]))
        assert box.volume == pytest.approx(height[0], rel=2e-3)


def test_an_optimum_that_rounding_puts_outside_is_drawn_in() -> None:
    space = space_of("by both margins")
    region, box = space._region, space.largest_box()
    family = largest._family(region, space.points, None, symmetric=False)
    found = np.array([*box.y, *box.theta])
    middle = np.repeat([found[:2].mean(), found[2:].mean()], 2)
    outside = middle + (1 + 1e-9) * (found - middle)
    assert largest._sizes(region, family, outside[None])[0] < 0
    drawn = largest._pulled_in(region, family, middle + 0.8 * (found - middle), outside)
    assert largest._sizes(region, family, drawn[None])[0] > 0
    assert np.abs(drawn - found).max() < 1e-7
