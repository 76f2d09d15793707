"""Robotics Toolbox: `Robot(URDF_file("/full/path/of/urdf/p3dof.urdf")[0], name="p3dof")`.

`URDF_file` is in `roboticstoolbox.models.URDF.URDFRobot`; it looks for relative paths among its own robots.
"""

import numpy as np
import pytest
from reference import GRAVITY, MECHANISM, MOVING, URDF, assert_bodies, placements, random_joints, tree_forces

toolbox = pytest.importorskip(
    "roboticstoolbox", reason="roboticstoolbox not installed: pip install 'p3dof[interop]'"
)

LEGS = ("slide_a", "hinge_a", "slide_b", "hinge_b")


@pytest.fixture(scope="module")
def robot():
    from roboticstoolbox.models.URDF.URDFRobot import URDF_file

    links, name, _ = URDF_file(str(URDF))
    return toolbox.Robot(links, name=name)


def vector(robot, values):
    found = np.zeros(robot.n)
    for link in robot.links:
        if link.isjoint:
            found[link.jindex] = values[link._joint_name]
    return found


def test_every_link_weighs_the_same(robot):
    assert_bodies({link.name: (link.m, link.r, link.I) for link in robot.links})


def test_joints_have_the_same_names_types_and_limits(robot):
    """All ten joints move on their own: the toolbox has no notion of <mimic>."""
    assert robot.n == len(MOVING) == 10
    links = {link._joint_name: link for link in robot.links if link.parent is not None}
    assert sorted(links) == sorted(joint.name for joint in MECHANISM.joints)
    for joint in MECHANISM.joints:
        link = links[joint.name]
        assert (link.name, link.parent.name) == (joint.child, joint.parent)
        assert (link.isprismatic, link.isrevolute) == (joint.kind == "prismatic", joint.kind == "revolute")
        if joint.limits is not None:
            limits = joint.limits
            assert link.qlim == pytest.approx([limits.lower, limits.upper], rel=1e-14)
            assert (link.qdlim, link.tlim) == pytest.approx((limits.velocity, limits.effort), rel=1e-14)


def differences(robot, seed):
    q = random_joints(seed)
    expected, values = placements(q), vector(robot, q)
    return {
        link.name: np.abs(robot.fkine(values, end=link.name).A - expected[link.name]).max()
        for link in robot.links
    }


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(robot, seed):
    found = differences(robot, seed)
    assert max(found.values()) < 1e-14


@pytest.mark.parametrize("seed", range(3))
def test_the_legs_take_the_same_forces(robot, seed):
    """Those of leg C are off: roboticstoolbox 1.5.0 adds up several markers on one link wrongly."""
    q, v, a, forces = tree_forces(seed)
    found = robot.rne(*(vector(robot, values) for values in (q, v, a)), gravity=GRAVITY)
    expected = vector(robot, forces)
    legs = [link.jindex for link in robot.links if link._joint_name in LEGS]
    assert len(legs) == 4
    np.testing.assert_allclose(found[legs], expected[legs], rtol=0, atol=1e-12 * np.abs(expected).max())
