"""The described tree over the whole workspace: loops closed, limits wide enough, no two solids in contact.

The joint angles at a pose come from a closed form written for this test alone (paper-notes: λA, λB, λC).
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from p3dof.machine.description import describe, urdf
from p3dof.machine.description.tree import MARGIN
from p3dof.machine.parameters import PAPER, SOLIDS, Geometry, Limits, of_solids

PAIRS = [("leg_a_tip", "platform_a"), ("leg_b_tip", "platform_b"), ("rod_right_tip", "crossbar_lower_right")]


def joints_at(geometry, y, z, theta):
    """Return the joint positions at a pose by name, or None out of reach."""
    R, r, L, h = geometry.R, geometry.r, geometry.L, geometry.h
    w, X = R - r, R - r * math.cos(theta)
    rest = (L - w - y) * (L + w + y), (L - w + y) * (L + w - y), L**2 - y**2 - X**2
    if min(rest) < 0:
        return None
    SA, SB, SC = (math.sqrt(value) for value in rest)
    home = math.atan2(-h, w)
    swing = math.asin(y / L)
    bar = home - math.atan2(-SC, X)
    return {
        "slide_a": z - h + SA,
        "hinge_a": math.atan2(-SA, w + y) - home,
        "slide_b": z - h + SB,
        "hinge_b": home - math.atan2(-SB, w - y),
        "slide_c": z - h + r * math.sin(theta) + SC,
        "hinge_c": bar,
        "hinge_left": swing,
        "hinge_lower": -swing,
        "hinge_platform": theta - bar,
        "hinge_right": swing,
    }


def poses(parameters, count, share=1.0, seed=0):
    """Yield (pose, joints): the corners of the workspace, then random poses, all with the sliders in travel.

    `share` shrinks the ranges of y and θ toward home.
    """
    geometry, (low, high) = parameters.geometry, parameters.limits.travel
    far = share * (geometry.L - (geometry.R - geometry.r))
    down, up = (share * end for end in parameters.limits.tilt)
    rng = np.random.default_rng(seed)
    sideways = [side * far * part for side in (-1, 1) for part in (0, 0.3, 0.6, 0.8, 0.9, 0.99, 1 - 1e-9)]
    corners = itertools.product(sideways, [down, down / 2, 0.0, up / 2, up], [0.0, 0.5, 1.0])
    randoms = zip(rng.uniform(-far, far, count), rng.uniform(down, up, count), rng.random(count), strict=True)
    for y, theta, part in itertools.chain(corners, randoms):
        joints = joints_at(geometry, y, 0.0, theta)
        if joints is None:
            continue
        sliders = [joints["slide_a"], joints["slide_b"], joints["slide_c"]]
        bottom, top = low - min(sliders), high - max(sliders)
        if bottom > top:
            continue
        z = bottom + part * (top - bottom)
        yield ((y, z, theta), {key: value + z * key.startswith("slide") for key, value in joints.items()})


def load(parameters):
    text = urdf(describe(parameters))
    model = pin.buildModelFromXML(text)
    return model, model.createData(), text


def vector(model, joints):
    return np.array([joints[name] for name in list(model.names)[1:]])


GEOMETRIES = [
    Geometry(),
    Geometry(0.01, 0.025, 0.04, 0.005),
    Geometry(0.3, 0.75, 1.2, 0.15),
    Geometry(b=0.2),
    Geometry(r=0.2),
    Geometry(0.05, 0.3, 0.3, 0.05),
    Geometry(L=0.8),
    Geometry(L=0.16),
    Geometry(R=0.11),
]


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_loops_are_closed_over_the_workspace(geometry):
    parameters = replace(PAPER, geometry=geometry)
    model, data, _ = load(parameters)
    frames = [[model.getFrameId(name) for name in pair] for pair in PAIRS]
    platform = model.getFrameId("platform_center")
    seen = 0
    for (y, z, theta), joints in poses(parameters, 300):
        pin.framesForwardKinematics(model, data, vector(model, joints))
        for one, two in frames:
            assert np.abs(data.oMf[one].translation - data.oMf[two].translation).max() < 1e-12
        center = data.oMf[platform]
        np.testing.assert_allclose(center.translation, [0, y, z - geometry.h], rtol=0, atol=1e-12)
        np.testing.assert_allclose(center.rotation, pin.rpy.rpyToMatrix(0, theta, 0), rtol=0, atol=1e-12)
        for name, column in (("crossbar_upper", 1), ("crossbar_lower", 2)):
            axis = data.oMf[model.getFrameId(name)].rotation[:, column] * (1 if column == 1 else -1)
            np.testing.assert_allclose(axis, [0, 1, 0], rtol=0, atol=1e-12)
        seen += 1
    assert seen > 30


def test_three_point_closures_leave_three_degrees_of_freedom():
    model, data, _ = load(PAPER)
    for _, joints in itertools.islice(poses(PAPER, 200, share=0.95), 0, None, 3):
        q = vector(model, joints)
        rows = []
        for pair in PAIRS:
            one, two = (
                pin.computeFrameJacobian(model, data, q, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)[:3]
                for name in pair
            )
            rows.append(one - two)
        values = np.linalg.svd(np.vstack(rows), compute_uv=False)  # (9,)
        assert values[6] > 1e-3
        assert values[7] < 1e-12


@pytest.mark.parametrize(
    "parameters",
    [
        PAPER,
        replace(PAPER, limits=Limits(tilt=(-1.0, 0.2), travel=(-0.4, 0.4))),
        *(replace(PAPER, geometry=geometry) for geometry in GEOMETRIES[1:]),
    ],
)
def test_joint_limits_hold_the_workspace(parameters):
    model, _, _ = load(parameters)
    passive = np.array([not name.startswith("slide") for name in list(model.names)[1:]])
    margin = np.where(passive, MARGIN, 0.0) - 1e-9
    found = np.array([vector(model, joints) for _, joints in poses(parameters, 2000)])
    assert np.all(found.min(axis=0) >= model.lowerPositionLimit + margin)
    assert np.all(found.max(axis=0) <= model.upperPositionLimit - margin)


def test_the_margin_of_the_joint_limits_is_all_that_is_added():
    """With enough travel every passive joint comes near its end: to .08 rad for the platform, else .001."""
    parameters = replace(PAPER, limits=Limits(travel=(-1.0, 1.0)))
    model, _, _ = load(parameters)
    found = np.array([vector(model, joints) for _, joints in poses(parameters, 0)])
    tight = np.array([name not in ("slide_a", "slide_b", "slide_c") for name in list(model.names)[1:]])
    low = (found.min(axis=0) - model.lowerPositionLimit - MARGIN)[tight]
    high = (model.upperPositionLimit - found.max(axis=0) - MARGIN)[tight]
    assert np.all(np.sort(np.concatenate([low, high]))[:-1] < 1e-3)
    assert np.max(np.concatenate([low, high])) < 0.1


def test_speed_limits_of_legs_and_rods_hold_at_any_speed_of_the_sliders():
    model, _, _ = load(PAPER)
    geometry, speed, step = PAPER.geometry, PAPER.limits.speed, 1e-6
    bounded = [
        i for i, name in enumerate(list(model.names)[1:]) if name in ("hinge_a", "hinge_b", "hinge_left")
    ]
    worst = np.zeros(model.nq)
    for pose, _ in poses(PAPER, 300, share=0.98):
        columns = []
        for i in range(3):
            ahead, behind = (
                vector(model, joints_at(geometry, *(np.array(pose) + side * step * np.eye(3)[i])))
                for side in (1, -1)
            )
            columns.append((ahead - behind) / (2 * step))
        rates = np.column_stack(columns)  # (10, 3): joints over pose
        per_slider = rates @ np.linalg.inv(rates[[0, 2, 4]])
        worst = np.maximum(worst, speed * np.abs(per_slider).sum(axis=1))
    assert np.all(worst[bounded] <= model.upperVelocityLimit[bounded])
    assert np.all(worst[bounded] >= 0.5 * model.upperVelocityLimit[bounded])  # and they are not far off


def smallest_distance(parameters, count, share=1.0):
    """Return the smallest distance of any two collision solids of different links, and the poses seen."""
    model, data, text = load(parameters)
    solids = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    solids.addAllCollisionPairs()  # of different joints: parent and child included
    links = {geometry.parentJoint for geometry in solids.geometryObjects}
    assert len(links) == 11
    placed = solids.createData()
    smallest, seen = math.inf, 0
    for _, joints in poses(parameters, count, share):
        pin.updateGeometryPlacements(model, data, solids, placed, vector(model, joints))
        pin.computeDistances(solids, placed)
        smallest = min(smallest, *(result.min_distance for result in placed.distanceResults))
        seen += 1
    return smallest, seen


@pytest.mark.slow
def test_no_two_solids_touch_anywhere_in_the_workspace():
    smallest, seen = smallest_distance(PAPER, 20_000)
    assert seen > 20_000
    # 3.536 mm, between the lower cross-bar's stubs and the platform's slanted edges: the same at every pose.
    assert smallest == pytest.approx(0.005 / math.sqrt(2), abs=1e-6)


@pytest.mark.parametrize(
    "limits", [Limits(tilt=(-1.0, 1.0)), Limits(travel=(-0.6, 0.6)), Limits(travel=(-0.05, 0.1))]
)
def test_no_two_solids_touch_with_other_limits(limits):
    smallest, seen = smallest_distance(replace(PAPER, limits=limits), 1500)
    assert seen > 500
    assert smallest > 0.0035


@pytest.mark.parametrize("geometry", GEOMETRIES[1:])
def test_no_two_solids_touch_in_machines_of_other_proportions(geometry):
    size = geometry.L
    limits = replace(SOLIDS.limits, travel=(-size / 2, size / 2))
    smallest, seen = smallest_distance(of_solids(geometry, limits=limits), 800)
    assert seen > 200
    assert smallest > 0
