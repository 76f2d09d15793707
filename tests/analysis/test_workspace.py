"""Workspaces: the reference numbers, random machines by counting random poses, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from machines import SEEDS, random_geometry, random_machine

import p3dof
from p3dof.closed_form import kinematics

ROBOT = p3dof.load()
SPACE = ROBOT.workspace()
NARROW = replace(p3dof.PAPER.limits, travel=(-0.1, 0.1))
TURNED = replace(p3dof.PAPER.limits, tilt=(-np.pi / 3, np.pi / 3))


def counted(geometry, limits, margins, rng, count=30_000):
    """Whether random poses are within, from joints alone; the poses; the volume that they are drawn from.

    Home's aspect: the sliders go back to home with no change of det J's sign on the straight way in θ.
    """
    low = np.array([-geometry.L, limits.travel[0] - geometry.L, limits.tilt[0]])
    high = np.array([geometry.L, limits.travel[1] + geometry.L, limits.tilt[1]])
    pose = rng.uniform(low, high, (count, 3))
    inside = kinematics.singularity(geometry, pose).serial.min(axis=-1) > 0
    sliders = (
        np.where(inside[:, None], 0, np.nan)
        + kinematics.inverse_kinematics(geometry, pose, on_invalid="nan").sliders
    )
    inside &= (sliders >= limits.travel[0]).all(axis=-1) & (sliders <= limits.travel[1]).all(axis=-1)
    inside[inside] &= _drops(geometry, pose[inside]).min(axis=-1) >= margins.serial
    inside[inside] &= kinematics.singularity(geometry, pose[inside]).actuation >= margins.actuation
    rows = np.flatnonzero(inside)
    way = pose[rows, None, :] * np.array([1, 1, 0]) + pose[rows, 2, None, None] * np.linspace(0, 1, 40)[
        :, None
    ] * (0, 0, 1)
    inside[rows] &= (kinematics.singularity(geometry, way).actuation > 0).all(axis=-1)
    return inside, pose, float(np.prod(high - low))


def _drops(geometry, pose):
    y, theta = pose[:, 0], pose[:, 2]
    wide = geometry.R - geometry.r
    squares = (wide + y) ** 2, (wide - y) ** 2, y**2 + (geometry.R - geometry.r * np.cos(theta)) ** 2
    return np.sqrt(np.maximum(1 - np.stack(squares, axis=-1) / geometry.L**2, 0))


def test_the_sizes_of_the_paper_s_workspace_are_the_references():
    assert SPACE.volume == pytest.approx(0.2098281, abs=1.5e-7)
    assert SPACE.area_y_theta == pytest.approx(0.5 * np.pi / 2, rel=1e-12)  # the stroke never closes it
    assert SPACE.aspects.home == pytest.approx(1.8290624, abs=1e-7)
    degrees = np.array([-45, -30, -15, 0, 15, 30, 45])
    areas = [0.1226397, 0.1308258, 0.1361376, 0.1379188, 0.1364152, 0.1330064, 0.1297467]
    assert [SPACE.area(theta) for theta in np.radians(degrees)] == pytest.approx(areas, abs=6e-8)
    dexterous = [0.1346340, 0.1259134, 0.1144676]
    assert [SPACE.dexterous(t) for t in np.radians([15, 30, 45])] == pytest.approx(dexterous, abs=6e-8)
    assert SPACE.dexterous() == SPACE.dexterous((-np.pi / 4, np.pi / 4))


def test_the_volume_is_the_integral_of_the_areas_at_constant_orientation():
    x, w = np.polynomial.legendre.leggauss(12)
    for space in (SPACE, ROBOT.workspace(NARROW)):
        total = 0.0
        for low, high in ((-np.pi / 4, 0.0), (0.0, np.pi / 4)):
            theta = (low + high) / 2 + (high - low) / 2 * x
            total += (high - low) / 2 * (w @ [space.area(t) for t in theta])
        assert space.volume == pytest.approx(total, rel=1e-9)


def test_other_limits_give_the_references():
    turned, narrow = ROBOT.workspace(TURNED), ROBOT.workspace(NARROW)
    assert turned.area_y_theta == pytest.approx(1.02885, abs=2e-5)
    assert turned.volume == pytest.approx(0.27094, abs=6e-6)
    assert narrow.volume == pytest.approx(0.062470, abs=6e-7)
    box = narrow.largest_symmetric_box()
    assert (box.y[1], box.theta[1], box.height) == pytest.approx((0.12585, 0.55131, 0.072824), rel=1e-4)


def test_areas_in_y_and_theta_are_those_of_a_fine_sum():
    """The range of θ at each y, by the sign of H on 20,001 points, for travel ±.1 m."""
    y = (np.arange(800) + 0.5) / 800 * 0.5 - 0.25
    theta = np.linspace(-np.pi / 4, np.pi / 4, 20_001)
    wide, total = 0.15, 0.0
    for place in y:
        a, b = (np.sqrt(0.16 - (wide + side * place) ** 2) for side in (1, -1))
        c = np.sqrt(0.16 - place**2 - (0.25 - 0.1 * np.cos(theta)) ** 2) + 0.1 * np.sin(theta)
        rise = 0.2 - (np.maximum(max(a, b), c) - np.minimum(min(a, b), c))
        total += (rise >= 0).mean() * (np.pi / 2) * (0.5 / 800)
    assert ROBOT.workspace(NARROW).area_y_theta == pytest.approx(total, abs=6e-4)  # a step is 1e-3 m rad


@pytest.mark.parametrize(
    ("degrees", "Y", "height"), [(15, 0.172920, 0.236056), (30, 0.169617, 0.225406), (45, 0.166698, 0.216062)]
)
def test_the_largest_boxes_are_at_least_as_large_as_the_references(degrees, Y, height):
    box = SPACE.largest_box(np.radians(degrees))
    assert box.area >= 2 * Y * height * (1 - 3e-6)
    assert box.area == pytest.approx(2 * Y * height, rel=1e-5)
    assert (box.y[1], box.height) == pytest.approx((Y, height), rel=1e-3)  # the maximum is flat
    corners = np.array([[y, z, t] for y in box.y for z in box.z for t in box.theta])
    inner = corners * (1 - 1e-9) + corners.mean(axis=0) * 1e-9
    assert SPACE.margin(inner).inside.all()


def test_the_largest_box_of_any_tilt_is_the_reference():
    box = SPACE.largest_box()
    assert box.volume == pytest.approx(0.113151, abs=1e-6)
    assert box.theta[1] == pytest.approx(np.pi / 4)
    rng = np.random.default_rng(1)
    low, high = np.array([box.y, box.z, box.theta]).T
    assert SPACE.margin(rng.uniform(low, high, (20_000, 3))).inside.all()


@settings(max_examples=6)
@given(SEEDS)
def test_volume_and_areas_of_random_machines_are_what_random_poses_count(seed):
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    stroke, tilt = geometry.L * rng.uniform(0.1, 0.9, 2), rng.uniform(0.2, 2.9, 2)
    limits = p3dof.machine.Limits(travel=(-stroke[0], stroke[1]), tilt=(-tilt[0], tilt[1]))
    home = geometry.h / geometry.L
    margins = p3dof.analysis.WorkspaceMargins(
        serial=rng.choice([0, rng.uniform(0, 0.8) * home]), actuation=rng.choice([0, rng.uniform(0, 0.2)])
    )
    robot = p3dof.load(replace(p3dof.PAPER, geometry=geometry, limits=limits))
    space = robot.workspace(margins=margins)
    inside, pose, volume = counted(geometry, limits, margins, rng)
    share = inside.mean()
    error = volume * np.sqrt(share * (1 - share) / len(inside))
    assert abs(space.volume - volume * share) < 4.5 * error + 1e-12
    found = space.margin(pose)
    assert (found.inside != inside).mean() < 2e-4  # but for the samples of the way in θ
    some = pose[inside][:200]
    low, high = space.z_range(some[:, 0], some[:, 2])
    assert ((low <= some[:, 1] + 1e-9) & (some[:, 1] <= high + 1e-9)).all()
    np.testing.assert_allclose(high - low, space.height(some[:, 0], some[:, 2]), rtol=0, atol=1e-12)
    # constant orientation, dexterous and reachable are of one order
    assert space.dexterous(0.1) <= space.area(0.0) * (1 + 1e-9) + 1e-15
    assert space.area(0.05) <= space.reachable * (1 + 1e-9)


def test_near_impossible_machines_have_small_workspaces():
    """R nearly r; and a leg hardly longer than R - r, horizontal at home."""
    for geometry in (
        p3dof.machine.Geometry(r=0.25 - 1e-6, R=0.25, L=0.4),
        p3dof.machine.Geometry(r=0.1, R=0.25, L=0.15000001),
    ):
        robot = p3dof.load(replace(p3dof.PAPER, geometry=geometry))
        space = robot.workspace()
        assert space.volume > 0
        assert np.isfinite([space.area(), space.dexterous(0.001), space.reachable, *space.aspects[:3]]).all()
        low, high = space.z_range(space.points.y, space.points.theta)
        pose = np.stack([space.points.y, (low + high) / 2, space.points.theta], axis=-1)
        found = space.margin(pose[np.isfinite(pose).all(axis=-1)])
        assert min(values.min() for values in found.columns.values()) > -1e-10


def test_demands_of_speed_and_force_shrink_the_workspace_to_what_random_poses_count():
    margins = p3dof.analysis.WorkspaceMargins(velocity=(2.0, 1.5, 10.0), acceleration=(25.0, 20.0, 100.0))
    space = ROBOT.workspace(margins=margins)
    rng = np.random.default_rng(2)
    limits = p3dof.PAPER.limits
    inside, pose, volume = counted(p3dof.PAPER.geometry, limits, margins, rng, 40_000)
    rows = pose[inside]
    good = np.ones(len(rows), dtype=bool)
    for k in range(3):
        rate = np.eye(3)[k] * margins.velocity[k]
        step = 1e-6
        ends = [ROBOT.sliders(rows + side * step * rate, on_invalid="nan") for side in (1, -1)]
        good &= (np.abs(ends[0] - ends[1]) / (2 * step) <= limits.speed).all(axis=-1)
        for side in (1, -1):
            a = side * np.eye(3)[k] * margins.acceleration[k]
            forces = ROBOT.forces(rows, np.zeros(3), a, on_invalid="nan", method="virtual-power")
            good &= (np.abs(forces) <= limits.force).all(axis=-1)
    share = good.sum() / len(inside)
    assert 0.3 < good.mean() < 0.95
    error = volume * np.sqrt(share * (1 - share) / len(inside))
    assert abs(space.volume - volume * share) < 4 * error
    found = space.margin(rows)
    np.testing.assert_array_equal(found.inside, good)
    named = set(found.reason[~good].tolist())
    assert named <= {f"{kind} {leg}" for kind in ("speed", "force") for leg in "ABC"}
    box = space.largest_box()
    low, high = np.array([box.y, box.z, box.theta]).T
    margin = space.margin(rng.uniform(low, high, (4000, 3)))
    assert margin.inside.mean() > 0.999  # between the points of the grid on which demands are looked at
    assert 0 < box.volume < SPACE.largest_box().volume


def test_margins_name_the_reason_of_each_pose():
    poses = [[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.9], [0, 0, 1.2], [0, 0, -3.1], [np.nan, 0, 0]]
    found = SPACE.margin(poses)
    assert found.inside.tolist() == [True, *6 * [False]]
    told = found.reason.tolist()
    assert told == ["", "serial A", "travel A", "tilt", "actuation", "actuation", "not finite"]
    assert found.columns["travel C"][2] == pytest.approx(-0.1)
    assert found.tilt[3] == pytest.approx(np.pi / 4 - 0.9)
    assert SPACE.margin(poses[1]).inside.shape == ()


def test_the_loci_are_where_the_machine_is_singular():
    curves = SPACE.loci()
    assert set(curves) == {
        *("actuation above", "actuation below", "serial a", "serial b", "serial c above", "serial c below")
    }
    for name, curve in curves.items():
        rows = curve[np.isfinite(curve).all(axis=-1)]
        pose = np.stack([rows[:, 0], 0 * rows[:, 0], rows[:, 1]], axis=-1)
        known = kinematics.singularity(p3dof.PAPER.geometry, pose * (1 - 1e-12))
        if name.startswith("actuation"):
            inner = known.serial.min(axis=-1) > 1e-6
            assert inner.sum() > 400
            np.testing.assert_allclose(known.actuation[inner], 0, atol=2e-6)
        else:
            np.testing.assert_allclose(known.serial[:, "abc".index(name[7])], 0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_areas_of_aspects_are_what_random_poses_count(seed):
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    found = p3dof.load(replace(p3dof.PAPER, geometry=geometry)).workspace().aspects
    reach = geometry.L - geometry.R + geometry.r
    pose = rng.uniform([-reach, 0, -np.pi], [reach, 1e-9, np.pi], (200_000, 3))
    known = kinematics.singularity(geometry, pose)
    inside = known.serial.min(axis=-1) > 0
    whole, home = 4 * np.pi * reach, inside & (known.actuation > 0)
    for area, share in ((found.home, home.mean()), (found.above + found.below, (inside & ~home).mean())):
        assert abs(area - whole * share) <= 4.5 * whole * np.sqrt(share * (1 - share) / len(inside))
    assert found.joined == bool(geometry.R + geometry.r <= geometry.L)


@pytest.mark.parametrize("seed", range(6))
def test_without_narrow_limits_a_workspace_is_home_s_aspect(seed):
    geometry = p3dof.PAPER.geometry if seed == 0 else random_geometry(np.random.default_rng(seed))
    limits = p3dof.machine.Limits(travel=(-50, 50), tilt=(-7, 7))
    space = p3dof.load(replace(p3dof.PAPER, geometry=geometry, limits=limits)).workspace()
    assert space.area_y_theta == pytest.approx(space.aspects.home, rel=1e-8)
    assert space.volume == pytest.approx(100 * space.aspects.home, rel=0.2)


def test_a_notebook_shows_sizes_and_the_box():
    html = SPACE._repr_html_()
    assert "0.209828" in html
    assert "Largest box" in html
    assert repr(SPACE) == "Workspace(area 0.785398 m rad, volume 0.209828 m² rad)"


def test_what_cannot_be_is_refused_in_one_line():
    with pytest.raises(p3dof.InputError, match=r"at home the margin of 'serial A' is -0.02297"):
        ROBOT.workspace(margins=p3dof.analysis.WorkspaceMargins(serial=0.95))
    with pytest.raises(p3dof.InputError, match=r"'speed A' is -1"):
        ROBOT.workspace(margins=p3dof.analysis.WorkspaceMargins(velocity=(0, 3, 0)))
    with pytest.raises(p3dof.InputError, match=r"serial: expected a number from 0 to 1"):
        p3dof.analysis.WorkspaceMargins(serial=1.0)
    with pytest.raises(p3dof.InputError, match=r"velocity: expected magnitudes"):
        p3dof.analysis.WorkspaceMargins(velocity=(0, -1, 0))
    for made in (p3dof.Workspace, lambda machine: p3dof.Indices(machine, [0, 0, 0])):
        with pytest.raises(p3dof.InputError, match=r"machine: expected a Manipulator, got a Parameters"):
            made(p3dof.PAPER)
    with pytest.raises(p3dof.InputError, match=r"limits: expected Limits, got 3"):
        ROBOT.workspace(3)
    with pytest.raises(p3dof.InputError, match=r"tilt: expected within the limits, -0.785398 to 0.785398"):
        SPACE.largest_box(1.0)
    with pytest.raises(p3dof.InputError, match=r"pose: expected shape"):
        SPACE.margin([0, 0])


def test_forces_of_springs_are_demanded_at_every_height():
    spring = p3dof.machine.Actuators(spring={"sliders": 300.0})
    robot = p3dof.load(replace(p3dof.PAPER, actuators=spring))
    demand = p3dof.analysis.WorkspaceMargins(acceleration=(22, 20, 100))
    limits = replace(p3dof.PAPER.limits, force=330.0)
    space = robot.workspace(limits, demand)
    stiff = p3dof.load(replace(p3dof.PAPER, actuators=p3dof.machine.Actuators(spring={"sliders": 5000.0})))
    with pytest.raises(p3dof.InputError, match="does at every z of the stroke"):
        stiff.workspace(limits, demand)
    assert 0.01 < space.volume < 0.5 * ROBOT.workspace(limits, demand).volume
    rng = np.random.default_rng(8)
    rows = rng.choice(len(space.points.y), 300)
    y, theta = space.points.y[rows], space.points.theta[rows]
    low, high = space.z_range(y, theta)
    inside = np.isfinite(low)
    for share in (0.0, 0.5, 1.0):
        pose = np.stack([y, low + share * (high - low), theta], axis=-1)[inside]
        assert space.margin(pose).force.min() > -1e-6


@settings(max_examples=4)
@given(SEEDS)
def test_areas_of_random_machines_are_what_random_points_count(seed):
    """At one orientation, at all of a range, at any: points (y, z) at 61 orientations, by joints alone."""
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    stroke, tilt = geometry.L * rng.uniform(0.2, 0.9), rng.uniform(0.1, 0.6)
    limits = p3dof.machine.Limits(travel=(-stroke, stroke), tilt=(-tilt, tilt))
    space = p3dof.load(replace(p3dof.PAPER, geometry=geometry, limits=limits)).workspace()
    count, low, high = 6000, [-geometry.L, -2 * geometry.L], [geometry.L, 2 * geometry.L]
    places, theta = rng.uniform(low, high, (count, 2)), np.linspace(-tilt, tilt, 61)
    pose = np.stack(np.broadcast_arrays(places[:, :1], places[:, 1:], theta), axis=-1)
    sliders = kinematics.inverse_kinematics(geometry, pose, on_invalid="nan").sliders
    fine = (np.abs(sliders) <= stroke).all(axis=-1)  # NaN is not
    known = kinematics.singularity(geometry, pose)
    good = fine & (known.actuation > 0)
    whole = 8 * geometry.L**2
    found = {"one": space.area(float(theta[40])), "all": space.dexterous(), "any": space.reachable}
    counts = {"one": good[:, 40], "all": good.all(axis=1), "any": good.any(axis=1)}
    for name, area in found.items():
        share = counts[name].mean()
        error = whole * np.sqrt(max(share * (1 - share), 1 / count) / count)
        assert abs(area - whole * share) < 4.5 * error + 0.01 * whole * share, name  # orientations are a grid


def test_gravity_and_masses_of_any_machine_go_into_the_force_demand():
    machine = random_machine(7)
    robot = p3dof.load(
        replace(machine, limits=p3dof.machine.Limits(travel=(-9, 9), tilt=(-0.5, 0.5), force=1e6))
    )
    demand = p3dof.analysis.WorkspaceMargins(acceleration=(0, 0, 0))
    pose = np.array([0.01, 0.0, 0.1]) * machine.geometry.L
    held = robot.forces(pose, np.zeros(3), np.zeros(3), method="virtual-power")
    np.testing.assert_allclose(robot.workspace(margins=demand).margin(pose).force, 1e6 - np.abs(held))
