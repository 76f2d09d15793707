"""How near parts come: closed forms, Wolfe's algorithm on corners that Pinocchio places, made collisions."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace

import jsonschema
import numpy as np
import pinocchio as pin
import pytest
import yaml
from documents import ROOT
from machines import positions, random_geometry
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import InputError, OptimisationError, ParameterError, SampleError
from p3dof.cli import main
from p3dof.design import clearance as clearance_module
from p3dof.design.clearance import (
    _BODIES,
    _JOINED,
    CORNERS,
    Clearance,
    CollisionModel,
    CollisionShape,
    Surroundings,
    _States,
    clearance_html,
    clearance_of,
    clearance_over,
    clearance_table,
    read_surroundings,
)
from p3dof.machine.description.shapes import Solids
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import PAPER, Dimensions, Limits, Parameters
from p3dof.report.assessment import moving_page

FAR = CollisionShape("far", size=(0.1, 0.1, 0.1), at=(0.0, 0.0, -5.0))
HOME = np.zeros((1, 3))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def only(*names, payload=(), obstacles=()):
    """Surroundings of which no pairs but those of the first name with each other one are looked at."""
    given = [one if isinstance(one, tuple) else (one,) for one in (payload, obstacles)]
    parts = [*_BODIES, *(one.name for one in (*given[0], *given[1]))]
    kept = {frozenset((names[0], name)) for name in names[1:]}
    ignored = [pair for pair in itertools.combinations(parts, 2) if frozenset(pair) not in kept]
    return Surroundings(*given, ignored=ignored)


def along_y(low=-0.15, high=0.15, samples=41, theta=0.0):
    """There and back once along y, as a cosine: the ends are at t = 0, 1 and 2 s."""
    time = np.linspace(0.0, 2.0, samples)
    middle, half = (low + high) / 2, (high - low) / 2
    pose, velocity, acceleration = np.zeros((3, samples, 3))
    pose[:, 0], pose[:, 2] = middle - half * np.cos(math.pi * time), theta
    velocity[:, 0] = math.pi * half * np.sin(math.pi * time)
    acceleration[:, 0] = math.pi**2 * half * np.cos(math.pi * time)
    return Motion(time, pose, velocity, acceleration)


def nearest(points):
    """The point of the convex hull of points that is nearest to the origin (P. Wolfe, 1976)."""
    base, weights = [int((points**2).sum(axis=1).argmin())], np.array([1.0])
    for _ in range(300):
        x = weights @ points[base]
        along = points @ x
        best = int(along.argmin())
        if along[best] > x @ x - 1e-15 * max((points**2).sum(axis=1).max(), 1e-30) or best in base:
            break
        base, weights = [*base, best], np.append(weights, 0.0)
        while True:
            ones = np.ones((len(base), 1))
            edges = points[base] @ points[base].T
            system = np.block([[edges, ones], [ones.T, np.zeros((1, 1))]])
            flat = np.linalg.lstsq(system, np.append(np.zeros(len(base)), 1.0), rcond=None)[0][:-1]
            if (flat > 0).all():
                weights = flat
                break
            falling = flat <= 0
            share = (weights[falling] / (weights[falling] - flat[falling])).min()
            weights = np.maximum(weights + share * (flat - weights), 0.0)
            keep = weights > 1e-14
            base = [one for one, kept in zip(base, keep, strict=True) if kept]
            weights = weights[keep] / weights[keep].sum()
    return x


def hull_distance(one, other):
    """The distance of two hulls, each of corners and the radius of a ball; how far a direction parts them."""
    corners = (one[0][:, None] - other[0][None]).reshape(-1, 3)
    x = nearest(corners)
    size = float(np.linalg.norm(x)) or 1e-300
    radii = one[1] + other[1]
    return size - radii, float((corners @ x).min()) / size - radii


def placed_by_pinocchio(robot, pose):
    """Corners and radii of all solids of each link, from the URDF's own solids and joint angles."""
    model, solids = robot.model, robot.visual_model
    q = np.zeros(model.nq)
    for name, value in robot.inverse_kinematics(pose).joints.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    data, placed = model.createData(), pin.GeometryData(solids)
    pin.updateGeometryPlacements(model, data, solids, placed, q)
    found, rings = {}, []
    for one, place in zip(solids.geometryObjects, placed.oMg, strict=True):
        name, kind, shape = one.name.rpartition("_")[0], type(one.geometry).__name__, one.geometry
        if kind == "Box":
            corners, radius = np.array([*itertools.product((-1, 1), repeat=3)]) * shape.halfSide, 0.0
        elif kind == "Sphere":
            corners, radius = np.zeros((1, 3)), shape.radius
        else:
            corners, radius = np.array([[0, 0, -1], [0, 0, 1]]) * shape.halfLength, shape.radius
        if name != "platform":
            world = corners @ place.rotation.T + place.translation
            found.setdefault(name, []).append((world, float(radius)))
        elif kind == "Cylinder":  # a round corner
            angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
            ring = radius / np.cos(np.pi / CORNERS) * np.array([np.cos(angles), np.sin(angles)]).T
            whole = np.concatenate([np.c_[ring, np.full(CORNERS, end[2])] for end in corners])
            rings.append(whole @ place.rotation.T + place.translation)
    return found | {"platform": [(np.concatenate(rings), 0.0)]}


def segments_apart(p, q, a, b):
    """The distance of two segments: both inner, or one at an end (C. Ericson, 2005, 5.1.9)."""
    u, v, w = q - p, b - a, p - a
    inner = np.array([[u @ u, -u @ v], [-u @ v, v @ v]])
    s, t = np.linalg.lstsq(inner, np.array([-u @ w, v @ w]), rcond=None)[0]
    found = [np.linalg.norm(w + s * u - t * v)] if 0 <= s <= 1 and 0 <= t <= 1 else []
    for point, start, along in ((p, a, v), (q, a, v), (a, p, u), (b, p, u)):
        share = np.clip((point - start) @ along / (along @ along), 0, 1)
        found.append(np.linalg.norm(point - start - share * along))
    return min(found)


def test_neighbours_are_what_joints_and_closures_join(robot):
    mechanism = robot.mechanism
    carriers = {name: joint.parent for name, joint in mechanism.markers.items()}
    joined = {frozenset((one.parent, one.child)) for one in mechanism.moving}
    joined |= {frozenset((carriers[one.frame1], carriers[one.frame2])) for one in mechanism.closures}
    assert {frozenset(pair) for pair in _JOINED} == joined
    names = {frozenset(pair) for pair in CollisionModel(PAPER).names}
    links = [link.name for link in mechanism.links if link.visuals]
    assert names == {frozenset(pair) for pair in itertools.combinations(links, 2)} - joined


@pytest.mark.parametrize("seed", range(8))
def test_distances_of_legs_and_rods_are_those_of_segments(seed):
    """On random machines, from the paper's loop equations."""
    rng = np.random.default_rng(seed)
    machine = replace(PAPER, geometry=random_geometry(rng))
    geometry, size = machine.geometry, Dimensions.scaled(machine.geometry)
    reach = geometry.L - (geometry.R - geometry.r)
    pose = np.array([rng.uniform(-0.6, 0.6) * reach, rng.normal() * geometry.L, rng.uniform(-0.4, 0.4)])
    model = CollisionModel(machine)
    found = dict(zip(model.names, model.distances(pose[None])[0], strict=True))
    (slide_a, slide_b, slide_c), (a3, b3, c5) = positions(geometry, pose)
    side = np.array([0.0, geometry.b, 0.0])
    # x is measured from the plane of the legs, and C5 is on the side of the slider C
    upper = np.array([-geometry.R, 0.0, slide_c])
    lower = np.array([-c5[0], c5[1], c5[2]])
    ends = {
        "leg_a": (np.array([0.0, -geometry.R, slide_a]), a3),
        "leg_b": (np.array([0.0, geometry.R, slide_b]), b3),
        "rod_left": (upper + side, lower + side),
        "rod_right": (upper - side, lower - side),
    }
    for one, other in itertools.combinations(ends, 2):
        apart = segments_apart(*ends[one], *ends[other]) - 2 * size.rod_radius
        pair = next(pair for pair in found if set(pair) == {one, other})
        assert found[pair] == pytest.approx(apart, abs=1e-10 * geometry.L)


@pytest.mark.parametrize("seed", range(3))
def test_distances_of_all_pairs_are_those_of_wolfes_algorithm(seed):
    """Of corners that Pinocchio places: neither the positions nor the algorithm is shared."""
    rng = np.random.default_rng(seed)
    geometry = PAPER.geometry if seed == 0 else random_geometry(rng)
    robot = p3dof.Manipulator(replace(PAPER, geometry=geometry))
    reach = geometry.L - (geometry.R - geometry.r)
    pose = np.array([rng.uniform(-0.5, 0.5) * reach, rng.uniform(-0.1, 0.1), rng.uniform(-0.35, 0.35)])
    model = CollisionModel(robot.parameters)
    solids = placed_by_pinocchio(robot, pose)
    for (one, other), distance in zip(model.names, model.distances(pose[None])[0], strict=True):
        both = [hull_distance(*pair) for pair in itertools.product(solids[one], solids[other])]
        apart = min(upper for upper, _ in both)
        if apart < 0:  # the sum of the radii is all that Wolfe's point can tell then
            assert distance < 1e-9
            continue
        assert distance == pytest.approx(apart, abs=1e-9 * geometry.L)
        assert min(lower for _, lower in both) == pytest.approx(apart, abs=1e-9 * geometry.L)


def test_solids_are_where_pinocchio_has_them(robot):
    pose = np.array([0.05, -0.02, 0.3])
    ends = np.array([[0.01, 0.02, 0.03], [-0.04, 0.05, -0.2]])
    post = CollisionShape("post", ends=ends, radius=0.03)
    wanted = placed_by_pinocchio(robot, pose) | {"post": [(ends, 0.03)]}
    given = {}
    for name, corners, radius in CollisionModel(PAPER, Surroundings(obstacles=post)).solids(pose):
        given.setdefault(name, []).append((corners, radius))
    assert given.keys() == wanted.keys()
    for name, solids in given.items():
        if name == "platform":  # less what lies within the hull of the three rings
            ((corners, _),), ((rings, _),) = solids, wanted[name]
            nearest = np.linalg.norm(corners[:, None] - rings[None], axis=2).min(axis=1)
            assert nearest.max() < 1e-14
            assert np.ptp(corners, axis=0) == pytest.approx(np.ptp(rings, axis=0), abs=1e-14)
            continue
        for found, expected in (
            [np.sort(np.round(np.c_[one[0], np.full(len(one[0]), one[1])], 9), axis=0) for one in both]
            for both in zip(
                sorted(solids, key=lambda one: one[0].mean(axis=0).round(9).tolist()),
                sorted(wanted[name], key=lambda one: one[0].mean(axis=0).round(9).tolist()),
                strict=True,
            )
        ):
            assert found == pytest.approx(expected, abs=2e-9)


def test_corners_move_as_their_positions_do():
    """By differences over a short time, of all that moves at once, with a payload."""
    held = CollisionShape("held", size=(0.1, 0.2, 0.3), at=(0.1, 0.0, 0.2), turn=(0.1, 0.2, 0.3))
    model, step = CollisionModel(PAPER, Surroundings(held)), 1e-6
    pose, velocity = np.array([[0.05, -0.02, 0.3]]), np.array([[0.4, -0.3, 2.0]])
    found = model._corners(pose, velocity)[1]
    ahead, behind = (model._corners(pose + sign * step * velocity, 0 * pose)[0] for sign in (1, -1))
    assert found == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)


def test_nearest_points_are_as_far_apart_and_in_their_parts(robot):
    pose = np.array([0.05, -0.02, 0.3])
    model, solids = CollisionModel(PAPER), placed_by_pinocchio(robot, pose)
    for k, (names, distance) in enumerate(zip(model.names, model.distances(pose[None])[0], strict=True)):
        points = model.points(pose, k)
        assert np.linalg.norm(points[0] - points[1]) == pytest.approx(distance, abs=1e-10)
        for name, point in zip(names, points, strict=True):
            outside = min(hull_distance(one, (point[None], 0.0))[0] for one in solids[name])
            assert outside < 1e-9


def test_boxes_that_overlap_have_the_depth_of_the_thinnest_overlap():
    payload = CollisionShape("payload", size=(0.2, 0.1, 0.06), at=(0.0, 0.0, -0.08))
    z = -math.sqrt(0.4**2 - 0.15**2)  # of P at home
    for depth in (0.011, 1e-4, -0.013):
        wall = CollisionShape("wall", size=(0.4, 0.5, 0.3), at=(0.0, 0.3 - depth, z - 0.08))
        model = CollisionModel(PAPER, Surroundings(payload, wall))
        found = dict(zip(model.names, model.distances(HOME)[0], strict=True))
        assert found["payload", "wall"] == pytest.approx(-depth, abs=1e-9)


def test_a_turned_box_and_a_slanting_capsule_are_where_they_are_told():
    turned = CollisionShape("turned", size=(0.2, 0.1, 0.06), at=(1.0, 2.0, 3.0), turn=(0.3, -0.5, 1.1))
    ends = np.array([[0.2, 1.0, 2.0], [0.9, 1.2, 3.4]])
    held = CollisionShape("held", ends=ends, radius=0.05)
    model = CollisionModel(PAPER, Surroundings(held, turned))
    found = dict(zip(model.names, model.distances(HOME)[0], strict=True))["held", "turned"]
    (cx, cy, cz), (sx, sy, sz) = np.cos(turned.turn), np.sin(turned.turn)
    about = (
        np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    )
    corners = np.array([*itertools.product((-1, 1), repeat=3)]) * np.array(turned.size) / 2
    p = np.array([0.0, 0.0, -math.sqrt(0.4**2 - 0.15**2)])
    apart = hull_distance((corners @ about.T + turned.at, 0.0), (ends + p, 0.05))
    assert found == pytest.approx(apart[0], abs=1e-10)


def test_a_made_collision_is_found_when_and_where_it_is(robot):
    """The payload's face moves towards a wall as P does: gap 30 mm - (y - 0.1) at most, at y = 0.15."""
    payload = CollisionShape("payload", size=(0.02, 0.1, 0.02), at=(0.0, 0.0, -0.2))
    wall = CollisionShape("wall", size=(0.5, 0.02, 0.1), at=(0.0, 0.15 + 0.05 - 0.004 + 0.01, -0.57))
    for samples in (41, 42, 6):  # the turning point is a sample, or between two
        motion = along_y(samples=samples)
        found = clearance_of(
            robot, motion, only("wall", "payload", "platform", payload=payload, obstacles=wall)
        )
        one = next(one for one in found.approaches if one.parts == ("payload", "wall"))
        peak = motion.resampled(2001).pose[:, 0].max()
        assert one.distance == pytest.approx(-0.004 + 0.15 - peak, abs=1e-7)
        assert one.time == pytest.approx(1.0, abs=1e-4)
        assert not found.fits
        assert found.least is one
        assert "payload and wall overlap by" in found.verdict
        assert one.points[:, 1] == pytest.approx(0.2, abs=0.0041)


def test_nothing_between_samples_is_nearer_than_the_bound(robot):
    motion = paper_motion(21)
    post = CollisionShape("post", ends=((0.0, 0.12, -0.8), (0.0, 0.2, -0.42)), radius=0.01)
    around = only("post", "platform", "leg_b", "rod_left", obstacles=post)
    for accuracy in (1e-4, 1e-3):
        found = clearance_of(robot, motion, around, accuracy=accuracy)
        assert found.least.distance - accuracy <= found.lower_bound <= found.least.distance
        dense = CollisionModel(PAPER, around).distances(motion.resampled(1501).pose)
        assert dense.min() >= found.lower_bound
        assert dense.min() >= found.least.distance - 1e-9
        for one in found.approaches:
            assert one.distance <= found.distances[:, found.pairs.index(one.parts)].min()
    assert found.distances.shape == (21, len(found.pairs))


def test_rates_bound_how_fast_distances_change():
    """By differences over short steps, and nothing changes faster than parts move."""
    motion = paper_motion(401)
    model = CollisionModel(PAPER, Surroundings(obstacles=FAR))
    states = [
        _States(motion.time[s], motion.pose[s], motion.velocity[s]) for s in (slice(-1), slice(1, None))
    ]
    rates = model.rates(*states)
    change = np.abs(np.diff(model.distances(motion.pose), axis=0)) / np.diff(motion.time)[:, None]
    assert (change <= rates + 1e-7).all()
    far = model.names.index(("platform", "far"))  # falls and rises with P: the bound is near what happens
    assert rates[:, far] == pytest.approx(change[:, far], abs=1.1 * np.abs(motion.velocity).max())
    assert rates[:, model.names.index(("slider_a", "slider_b"))].max() < 2 * np.abs(motion.velocity).max()


def test_distances_within_the_machine_are_alike_at_all_heights():
    rng = np.random.default_rng(5)
    model = CollisionModel(PAPER)
    inner = [k for k, pair in enumerate(model.names) if "base_link" not in pair]
    poses = rng.uniform((-0.15, -0.1, -0.4), (0.15, 0.1, 0.4), (6, 3))
    high = poses + np.array([0.0, 0.3, 0.0])
    assert model.distances(poses)[:, inner] == pytest.approx(model.distances(high)[:, inner], abs=1e-10)


def test_a_mirrored_pose_mirrors_the_pairs():
    swapped = {"slider_a": "slider_b", "leg_a": "leg_b", "rod_left": "rod_right"}
    swapped |= {other: one for one, other in swapped.items()}
    rng = np.random.default_rng(6)
    model = CollisionModel(PAPER)
    poses = rng.uniform((-0.15, -0.1, -0.4), (0.15, 0.1, 0.4), (6, 3))
    found, other = model.distances(poses), model.distances(poses * [-1, 1, 1])
    for k, pair in enumerate(model.names):
        names = {swapped.get(name, name) for name in pair}
        mirror = next(j for j, each in enumerate(model.names) if set(each) == names)
        assert found[:, k] == pytest.approx(other[:, mirror], abs=1e-10)


def test_a_machine_twice_as_large_has_distances_twice_as_large():
    geometry = PAPER.geometry
    large = replace(geometry, r=2 * geometry.r, R=2 * geometry.R, L=2 * geometry.L, b=2 * geometry.b)
    limits = Limits(travel=(2 * PAPER.limits.travel[0], 2 * PAPER.limits.travel[1]))
    one, other = CollisionModel(PAPER), CollisionModel(Parameters(large, PAPER.bodies, limits))
    pose = np.array([[0.08, -0.03, 0.2]])
    twice = other.distances(pose * [2, 2, 1])
    assert twice == pytest.approx(2 * one.distances(pose), abs=1e-10)


def test_sizes_that_are_given_replace_those_in_proportion():
    thin = CollisionModel(PAPER, Surroundings(dimensions={"rod_radius": 0.004}))
    usual = CollisionModel(PAPER)
    change = thin.distances(HOME)[0] - usual.distances(HOME)[0]
    for (one, other), by in zip(thin.names, change, strict=True):
        rods = sum(name.startswith(("leg", "rod")) for name in (one, other))
        bars = sum(name.startswith("crossbar") for name in (one, other))
        assert by >= -1e-12
        if not bars:
            assert by == pytest.approx(0.006 * rods, abs=1e-10)
    with pytest.raises(ParameterError, match="rod_radius"):
        CollisionModel(PAPER, Surroundings(dimensions={"rod_radius": -1.0}))


def test_the_box_of_all_that_moves_at_home(robot):
    """By hand: shoes at both ends of x, sliders at both of y, the cube's top and the plate's bottom."""
    at_rest = Motion(np.zeros(1), *np.zeros((3, 1, 3)))
    found = clearance_of(robot, at_rest)
    bottom = -math.sqrt(0.4**2 - 0.15**2) - 0.025
    reach = 0.02 / math.cos(math.pi / CORNERS)
    assert found.sweep[0] == pytest.approx([-0.25 - 0.8 * 0.05, -0.275, bottom], abs=1e-12)
    assert found.sweep[1] == pytest.approx([0.8 * 0.05, 0.275, 0.025], abs=1e-12)
    assert reach < 0.8 * 0.05
    assert found.room == pytest.approx(0.33 * 0.55 * (0.025 - bottom), rel=1e-12)
    assert found.lower_bound == found.least.distance
    moved = clearance_of(
        robot, along_y(), Surroundings(CollisionShape("rod", ends=[[0, 0, 0], [0, 0, -1]], radius=0.01))
    )
    assert moved.sweep[0, 2] == pytest.approx(bottom + 0.025 - 1.01, abs=1e-12)


def test_over_the_workspace_no_pose_is_nearer(robot):
    limits = Limits(travel=(-0.2, 0.2), tilt=(-0.3, 0.3))
    wall = CollisionShape("wall", size=(0.5, 0.02, 0.6), at=(0.0, 0.3, -0.4))
    wall = only("wall", "platform", "leg_b", "slider_c", obstacles=wall)
    space = robot.workspace(limits)
    found = clearance_over(robot, space, wall, grid=(5, 5, 3))
    rng = np.random.default_rng(1)
    y, theta = rng.uniform(-0.25, 0.25, 400), rng.uniform(-0.3, 0.3, 400)
    low, high = space.z_range(y, theta)
    poses = np.stack([y, low + rng.random(400) * (high - low), theta], axis=1)
    poses = poses[np.isfinite(poses).all(axis=1)]
    assert len(poses) > 200
    sampled = CollisionModel(PAPER, wall).distances(poses)
    least = {one.parts: one for one in found.approaches}
    for names, column in zip(found.pairs, sampled.T, strict=True):
        assert column.min() >= least[names].distance - 2e-4
        assert (
            space.margin(least[names].pose).inside or space.margin(least[names].pose).columns["tilt"] > -1e-6
        )
    assert found.least.distance < sampled.min()
    assert math.isnan(found.least.time)
    assert math.isnan(found.lower_bound)


def test_payload_of_a_task_has_the_name_of_its_segment(robot):
    task = p3dof.Task(
        [
            p3dof.Waypoint([0, 0, 0], "home"),
            p3dof.Waypoint([0.15, 0, 0], "there"),
            p3dof.Waypoint([0, 0, 0], "back"),
        ]
    )
    found = p3dof.design.forces_of_task(robot, task.plan(1.0, 101))
    wall = CollisionShape("wall", size=(0.5, 0.02, 0.2), at=(0.0, 0.3, -0.37))
    wall = only("wall", "platform", obstacles=wall)
    one = clearance_of(robot, found, wall)
    platform = next(each for each in one.approaches if each.parts == ("platform", "wall"))
    assert "there" in platform.place
    # a corner of the polygon looks along y
    assert platform.distance == pytest.approx(0.04 - 0.02 / math.cos(math.pi / CORNERS), abs=1e-9)


TEXT = """
payload: {size: [120 mm, 80 mm, 60 mm], at: [0, 0, 60 mm], turn: [0, 0, 30 deg]}
obstacles:
  - {name: table, size: [600 mm, 900 mm, 20 mm], at: [0, 0, -560 mm]}
  - {name: post, ends: [[0.2, 0.1, -0.6], [0.2, 0.1, 0]], radius: 20 mm}
dimensions: {rod_radius: 8 mm}
ignored: [[payload, table]]
"""


SCHEMA = json.loads((ROOT / "docs/reference/surroundings.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
BEYOND = "used more than once", "there is no part"
"""What no schema sees."""


def test_the_schema_takes_the_example():
    VALIDATOR.check_schema(SCHEMA)
    VALIDATOR.validate(yaml.safe_load(TEXT))


def test_a_file_is_read_in_its_units(tmp_path):
    path = tmp_path / "around.yaml"
    path.write_text(TEXT)
    found = read_surroundings(path)
    assert found == Surroundings(
        CollisionShape("payload", (0.12, 0.08, 0.06), (0, 0, 0.06), (0, 0, math.pi / 6)),
        [
            CollisionShape("table", (0.6, 0.9, 0.02), (0, 0, -0.56)),
            CollisionShape("post", ends=((0.2, 0.1, -0.6), (0.2, 0.1, 0)), radius=0.02),
        ],
        {"rod_radius": 0.008},
        [("payload", "table")],
    )
    names = CollisionModel(PAPER, found).names
    assert ("payload", "post") in names
    assert ("payload", "table") not in names
    assert ("table", "post") not in names
    assert ("platform", "payload") not in names
    assert ("leg_a", "payload") in names


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("payload: {}", "payload: expected size, or ends and radius"),
        ("payload: {size: [1, 2]}", "expected shape"),
        ("payload: {size: [1, 2, 0]}", "size"),
        ("payload: {size: [1 kg, 2 kg, 3 kg]}", "expected a length"),
        ("payload: {ends: [[0, 0, 0], [0, 0, 1]]}", "expected size, or ends and radius"),
        ("payload: {ends: [[0, 0, 0], [0, 0, 1]], radius: 0}", "radius"),
        ("payload: {ends: [[0, 0, 0], [0, 0, 1]], radius: 1, at: [1, 0, 0]}", "at and turn of a box only"),
        ("payload: {size: [1, 1, 1], ends: [[0, 0, 0], [0, 0, 1]], radius: 1}", "expected size, or ends"),
        ("payload: {name: leg_a, size: [1, 1, 1]}", "'leg_a' is used more than once"),
        ("payload: {name: 3, size: [1, 1, 1]}", "expected a printable text"),
        ("payload: 2", "expected the fields"),
        ("obstacles: [{size: [1, 1, 1]}]", "obstacles[0]: the field 'name' is missing"),
        ("obstacles: [{name: a, size: [1, 1, 1]}, {name: a, size: [1, 1, 1]}]", "used more than once"),
        ("obstacles: [{name: a, edges: [1, 1, 1]}]", "edges"),
        ("dimensions: {rod: 1 mm}", "rod"),
        ("dimensions: {rod_radius: 0 mm}", "rod_radius"),
        ("dimensions: 3", "expected the fields"),
        ("ignored: [[leg_a, table]]", "there is no part 'table'"),
        ("ignored: [[leg_a]]", "expected pairs"),
        ("ignored: leg_a", "expected pairs"),
        ("ignored: [[1, 2]]", "expected pairs"),
        ("walls: []", "walls"),
        ("3", "expected the fields"),
    ],
)
def test_every_fault_of_a_file_is_told(tmp_path, text, words):
    path = tmp_path / "around.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as error:
        read_surroundings(path)
    told = str(error.value)
    assert words in told
    assert told.startswith(str(path))
    assert "\n" not in told
    if not any(one in words for one in BEYOND):
        assert not VALIDATOR.is_valid(yaml.safe_load(text))


def test_arguments_are_checked(robot):
    motion = along_y(samples=3)
    for call, words in (
        (lambda: clearance_of(PAPER, motion), "robot"),
        (lambda: clearance_of(robot, 3), "found"),
        (lambda: clearance_of(robot, motion, 3), "surroundings"),
        (lambda: clearance_of(robot, motion, required=-1.0), "required"),
        (lambda: clearance_of(robot, motion, accuracy=0.0), "accuracy"),
        (lambda: clearance_over(robot, 3), "space"),
        (lambda: clearance_over(robot, required=math.nan), "required"),
        (lambda: clearance_over(robot, grid=(1, 2, 3)), "grid"),
        (lambda: clearance_over(robot, grid=(2, 2, 202)), "grid"),
        (lambda: clearance_over(robot, grid=(3, 3)), "grid"),
    ):
        with pytest.raises(InputError, match=words):
            call()
    for wrong in ({"payload": [3]}, {"obstacles": 3}, {"ignored": ["leg_a"]}, {"dimensions": {"edge": 1.0}}):
        with pytest.raises(ParameterError, match=next(iter(wrong))):
            Surroundings(**wrong)
    with pytest.raises(SampleError):
        clearance_of(robot, along_y(-0.3, 0.3))


@shows("p3dof.design.clearance.clearance_table")
def test_the_table_has_what_was_found(robot):
    payload = CollisionShape("box", size=(0.02, 0.1, 0.02), at=(0.0, 0.0, -0.2))
    wall = CollisionShape("wall", size=(0.5, 0.02, 0.5), at=(0.0, 0.206, -0.55))
    around = only("wall", "box", payload=payload, obstacles=wall)
    found = clearance_of(robot, along_y(), around, required=0.003, accuracy=1e-6)
    z = -1e3 * math.sqrt(0.4**2 - 0.15**2)
    (one,) = found.approaches
    x, spot = 1e3 * one.points.mean(axis=0)[[0, 2]]
    assert abs(x) < 10.0001
    assert abs(spot - z + 200) < 10.0001
    sides = (330.0, 550.0, 1e3 * found.sides[2])
    sliders = np.array([positions(PAPER.geometry, (y, 0.0, 0.0))[0] for y in along_y().pose[:, 0]])
    assert sides[2] == pytest.approx(1e3 * sliders.max() + 25 - z + 210, abs=1e-9)
    assert -4.001 <= 1e3 * found.lower_bound <= -4.0
    note = (1, 1e3 * found.lower_bound, *sides, 1e-9 * sides[0] * sides[1] * sides[2])
    row = (-4.0, 1.0, "–", 150.0, 0.0, 0.0, x, 198.0, spot)
    check_table(clearance_table(found), {"box and wall": row}, note=note, rtol=1e-4, atol=1e-3)
    assert "box and wall overlap by 4 mm at t = 1 s" in repr(found)
    assert "Clearance" in clearance_html(found)
    kept = replace(found, approaches=(replace(one, distance=0.002),))
    assert kept.verdict == "box and wall come within 2 mm at t = 1 s, 3 mm required"
    assert not kept.fits
    assert isinstance(kept, Clearance)
    assert replace(kept, required=0.002).fits


def test_solids_of_given_sizes_are_drawn_with_them():
    (leg,) = Solids(replace(PAPER, dimensions={"rod_radius": 0.007})).visuals["leg_a"]
    assert leg.shape.radius == 0.007
    assert Solids(PAPER).visuals["leg_a"][0].shape.radius == 0.01


WAYS = """
waypoints:
  - {name: here, pose: [0, 0, 0]}
  - {name: there, pose: [150 mm, 0, 0], duration: 1}
  - {name: back, pose: [0, 0, 0], duration: 1}
"""
AROUND = """
obstacles: {name: wall, size: [500 mm, 20 mm, 200 mm], at: [0, 300 mm, -370 mm]}
dimensions: {corner_radius: 22 mm}
"""
GAP = 40e-3 - 22e-3 / math.cos(math.pi / CORNERS)
"""Of the platform and the wall at y = 150 mm."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(WAYS)
    around = only("wall", "platform", obstacles=CollisionShape("wall", size=(1, 1, 1)))
    (tmp_path / "around.yaml").write_text(AROUND + yaml.safe_dump({"ignored": [*map(list, around.ignored)]}))
    return tmp_path


@pytest.mark.parametrize(("least", "code"), [("17.9 mm", 0), ("18 mm", 1), (None, 0)])
@pytest.mark.usefixtures("folder")
def test_plan_reports_the_nearest_parts(capsys, least, code):
    asked = [] if least is None else ["--clearance", least]
    assert main(["plan", "task.yaml", "--samples", "101", "--surroundings", "around.yaml", *asked]) == code
    told = capsys.readouterr().out
    words = f"platform and wall come within {1e3 * GAP:.4g} mm at t = 1 s"
    assert words in told
    assert (least is not None) == (f"{least} required" in told)


def test_a_file_that_is_wrong_is_one_line(folder, capsys):
    (folder / "around.yaml").write_text("walls: 3")
    assert main(["plan", "task.yaml", "--surroundings", "around.yaml"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("p3dof: error: around.yaml:")


def test_the_nearest_points_of_each_sample(robot):
    """They are as far apart as the parts, on their surfaces: a capsule's lies its radius from the axis."""
    post = CollisionShape("post", ends=((0.0, 0.3, -0.6), (0.0, 0.3, 0.1)), radius=0.02)
    found = clearance_of(robot, paper_motion(41), Surroundings(obstacles=[post]))
    points, pairs = found.nearest_points(), found.distances.argmin(axis=1)
    assert points.shape == (41, 2, 3)
    assert len(set(pairs)) > 1
    apart = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    np.testing.assert_allclose(apart, found.distances.min(axis=1), atol=1e-9)
    near = clearance_of(robot, paper_motion(41), only("post", "leg_b", obstacles=post))
    of_post = near.nearest_points()[:, next(pair.index("post") for pair in near.pairs)]
    np.testing.assert_allclose(np.hypot(of_post[:, 0], of_post[:, 1] - 0.3), 0.02, atol=1e-9)
    box = CollisionShape("box", size=(0.5, 0.5, 0.1), at=(0, 0, -0.4))
    inside = clearance_of(robot, paper_motion(3), only("box", "platform", obstacles=box))
    assert (inside.distances < 0).all()
    gap = np.linalg.norm(np.diff(inside.nearest_points(), axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(gap, -inside.distances[:, 0], atol=1e-7)


@pytest.mark.parametrize(("least", "code"), [("5 mm", 0), ("40 mm", 1)])
def test_report_has_the_clearance_as_a_rating_and_a_figure(folder, capsys, least, code):
    asked = ["--surroundings", "around.yaml", "--clearance", least, "--no-animation", "--out", "a.html"]
    assert main(["report", "task.yaml", "--samples", "101", *asked]) == code
    told, page = capsys.readouterr().out, (folder / "a.html").read_text(encoding="utf-8")
    assert ("does not fit: required clearance of platform and wall" in told) == bool(code)
    assert "collisions" not in told
    for words in (
        'id="clearance"',
        "Least distances of the nearest parts",
        "around.yaml",
        "required clearance",
    ):
        assert words in page
    assert f"--clearance={float(least.split()[0]) / 1e3!r}" in page


def test_a_least_distance_that_was_not_found_is_an_error(robot, monkeypatch):
    monkeypatch.setattr(clearance_module, "_MOVES", 3)
    with pytest.raises(OptimisationError, match="no least distance of parts was found in 3 steps"):
        clearance_over(robot, robot.workspace(Limits(tilt=(-0.1, 0.1))), grid=(3, 3, 2))


@pytest.mark.usefixtures("folder")
def test_workspace_finds_where_parts_come_nearest(capsys):
    asked = ["workspace", "--travel", "100 mm", "--tilt", "10 deg", "--surroundings", "around.yaml"]
    assert main([*asked, "--clearance", "0", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["clearance"]
    assert found["parts"] == ["platform", "wall"]
    assert found["distance"] < 0
    assert found["required"] == 0
    model = CollisionModel(PAPER, read_surroundings("around.yaml"))
    assert model.distances(np.array([found["pose"]]))[0, 0] == pytest.approx(found["distance"], abs=1e-9)


def test_an_assessment_fits_as_far_as_parts_keep_apart(robot):
    motion = along_y()
    result = robot.inverse_dynamics(motion)
    wall = CollisionShape("wall", size=(0.5, 0.02, 0.2), at=(0.0, 0.3, -0.37))
    around, gap = only("wall", "platform", obstacles=wall), 0.04 - 0.02 / math.cos(math.pi / CORNERS)
    assert any("collisions" in words for words in p3dof.assess(robot, result).unchecked)
    for required, fits in ((0.01, True), (0.03, False)):
        found = clearance_of(robot, motion, around, required=required)
        answer = p3dof.assess(robot, result, clearance=found)
        use = next(one for one in answer.ratings if one.kind == "clearance")
        assert use.share == pytest.approx(required / gap, rel=1e-6)
        assert (use.name, use.part, use.unit) == ("required clearance", "platform and wall", "m")
        assert use.time == pytest.approx(1.0, abs=1e-4)
        assert answer.fits is fits
        assert not any("collisions" in words for words in answer.unchecked)
    free = p3dof.assess(robot, result, clearance=clearance_of(robot, motion, around))
    assert not any(one.kind == "clearance" for one in free.ratings)
    near = replace(wall, at=(0.0, 0.27, -0.37))
    hit = p3dof.assess(
        robot, result, clearance=clearance_of(robot, motion, only("wall", "platform", obstacles=near))
    )
    assert not hit.fits
    assert hit.worst.name == "overlap"
    assert hit.worst.required == pytest.approx(0.03 - gap, abs=1e-9)
    assert "where none is permissible" in hit.verdict
    with pytest.raises(InputError, match="clearance"):
        p3dof.assess(robot, result, clearance=0.01)


def test_the_page_of_a_report_shows_the_nearest_parts_of_the_same_samples(robot):
    result = robot.inverse_dynamics(along_y(samples=11))
    for samples, there in ((11, True), (9, False)):
        found = clearance_of(robot, along_y(samples=samples))
        (run,) = moving_page(p3dof.assess(robot, result, clearance=found)).document["runs"]
        assert ("nearest" in run) is there


def test_the_figure_draws_the_distances_and_the_nearest_points(robot):
    from p3dof.report.plots import clearance_figure

    wall = CollisionShape("wall", size=(0.5, 0.02, 0.2), at=(0.0, 0.3, -0.37))
    around = only("wall", "platform", "leg_b", obstacles=wall)
    found = clearance_of(robot, along_y(), around, required=0.005)
    left, right = clearance_figure(found).axes
    lines = {line.get_label(): line for line in left.lines}
    for pair, column in zip(found.pairs, found.distances.T, strict=True):
        assert np.asarray(lines[" and ".join(pair)].get_ydata()) == pytest.approx(1e3 * column)
    points = np.array(right.lines[0].get_xydata())
    assert points == pytest.approx(1e3 * found.least.points[:, 1:])
    assert "platform and wall: 19.98 mm at t = 1 s" in right.get_title()
    over = clearance_over(robot, robot.workspace(Limits(tilt=(-0.1, 0.1))), around, grid=(3, 3, 2))
    left, right = clearance_figure(over).axes
    widths = [bar.get_width() for bar in left.patches]
    assert widths == pytest.approx([1e3 * one.distance for one in over.approaches])
    assert [text.get_text() for text in left.get_yticklabels()] == [one.names for one in over.approaches]
    with pytest.raises(InputError, match="found"):
        clearance_figure(3)


def test_measures_of_space_are_those_of_each_machine(robot):
    """On designs of other lengths, sizes and places, with surroundings; gradients by other differences."""
    motion = along_y(samples=9)
    wall = CollisionShape("wall", size=(0.5, 0.02, 0.2), at=(0.0, 0.33, -0.37))
    around = only("wall", "platform", "slider_b", obstacles=wall)
    names = ["motion_clearance", "height", "room"]
    bounds = {"L": (0.35, 0.5), "rod_radius": (0.005, 0.02), "offset.y": (-0.02, 0.02)}
    problem = p3dof.design.DesignProblem(bounds, motion, names, bodies="solids", surroundings=around)
    design = np.array([0.42, 0.008, 0.006])
    found = problem.evaluate(design)
    geometry = replace(PAPER.geometry, L=0.42)
    machine = replace(PAPER, geometry=geometry, dimensions={"rod_radius": 0.008})
    pose = motion.pose + np.array([design[2], 0.0, 0.0])
    size = Dimensions.scaled(geometry)
    model = CollisionModel(machine, around)
    assert found["motion_clearance"][0] == model.distances(pose).min()
    low, high = model.sweep(pose)
    assert found["height"][0] == pytest.approx(high[2] - low[2], rel=1e-12)
    assert found["room"][0] == pytest.approx((high - low).prod(), rel=1e-12)
    # at y = 156 mm: from the corner of the platform to the wall; the bottom from the loop equations
    assert found["motion_clearance"][0] == pytest.approx(
        0.32 - 0.256 - size.corner_radius / math.cos(math.pi / CORNERS), abs=1e-9
    )
    sliders = np.array([positions(geometry, row)[0] for row in pose])
    bottom = -math.sqrt(0.42**2 - 0.15**2) - size.plate_thickness / 2
    assert found["height"][0] == pytest.approx(sliders.max() + size.slider_edge / 2 - bottom, abs=1e-12)
    gradient = problem.gradient(design)
    for k, step in enumerate((1e-5, 1e-6, 1e-6)):
        moved = problem.evaluate(design + step * np.array([[1.0], [-1.0]]) * np.eye(3)[k])
        for name in names:
            by = (moved[name][0] - moved[name][1]) / (2 * step)
            assert gradient[name][k] == pytest.approx(by, rel=1e-5, abs=1e-4)
    assert gradient["motion_clearance"] == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)
    alone = p3dof.design.DesignProblem(bounds, motion, names, bodies="solids")
    assert "surroundings" not in alone.settings()
    json.dumps(problem.settings())
    assert alone.settings() != {k: v for k, v in problem.settings().items() if k != "names"}
    assert robot.parameters == PAPER


def test_a_problem_file_names_its_surroundings(tmp_path):
    (tmp_path / "around.yaml").write_text(TEXT)
    path = tmp_path / "problem.yaml"
    text = "variables: {L: [0.35, 0.5]}\nmotion: {paper: 11}\nobjectives: [height]\n"
    path.write_text(text + "surroundings: around.yaml\n")
    problem = p3dof.design.optimisation.read_problem(path)
    assert problem.setting.surroundings == read_surroundings(tmp_path / "around.yaml")
    path.write_text(text + "surroundings: 3\n")
    with pytest.raises(InputError, match=r"surroundings: expected the name of a file"):
        p3dof.design.optimisation.read_problem(path)
    with pytest.raises(InputError, match="surroundings"):
        p3dof.design.DesignProblem({"L": (0.35, 0.5)}, surroundings=3)


def test_designs_out_of_reach_have_no_clearance():
    problem = p3dof.design.DesignProblem({"L": (0.16, 0.5)}, paper_motion(11), ["motion_clearance"])
    found = problem.evaluate([[0.17], [0.4]])["motion_clearance"]
    assert np.isnan(found).tolist() == [True, False]
    assert np.isnan(problem.evaluate([[0.17]])["motion_clearance"]).all()


@pytest.mark.parametrize("y", [0.0, 0.1, 0.2, 0.245])
def test_the_rods_of_the_parallelogram_close_as_it_leans(y):
    """Parallel lines 2b apart along y, 2b √(1 - (y/L)²) across: nothing where it is flat."""
    wide = replace(PAPER, geometry=replace(PAPER.geometry, R=0.1, r=0.09, L=0.26))
    model = CollisionModel(wide, Surroundings(dimensions={"rod_radius": 0.01}))
    pair = next(k for k, names in enumerate(model.names) if set(names) == {"rod_left", "rod_right"})
    found = model.distances(np.array([[y, 0.0, 0.0]]))[0, pair]
    assert found == pytest.approx(0.1 * math.sqrt(1 - (y / 0.26) ** 2) - 0.02, abs=1e-10)


@pytest.mark.parametrize("r", [0.012, 0.01, 0.006])
def test_legs_whose_lower_ends_meet_overlap_there(r):
    small = replace(PAPER, geometry=replace(PAPER.geometry, r=r))
    model = CollisionModel(small, Surroundings(dimensions={"rod_radius": 0.01}))
    pair = next(k for k, names in enumerate(model.names) if set(names) == {"leg_a", "leg_b"})
    assert model.distances(HOME)[0, pair] == pytest.approx(2 * r - 0.02, abs=1e-10)
    points = model.points(HOME[0], pair)
    assert points[:, 2] == pytest.approx(-math.sqrt(0.4**2 - (0.25 - r) ** 2), abs=1e-6)
