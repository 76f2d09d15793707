"""urchin: `urchin.URDF.load("urdf/p3dof.urdf")`."""

import numpy as np
import pytest
from reference import LINKS, MECHANISM, URDF, assert_bodies, assert_placements, mimicking_joints

urchin = pytest.importorskip("urchin", reason="urchin not installed: pip install 'p3dof[interop]'")


@pytest.fixture(scope="module")
def robot():
    return urchin.URDF.load(str(URDF))


def test_every_link_weighs_the_same(robot):
    bodies = {link.name: link.inertial for link in robot.links}
    assert_bodies({name: (body.mass, body.origin[:3, 3], body.inertia) for name, body in bodies.items()})
    for body in bodies.values():
        np.testing.assert_array_equal(body.origin[:3, :3], np.eye(3))


def test_joints_have_the_same_names_types_and_limits(robot):
    assert robot.base_link.name == "base_link"
    found = {joint.name: joint for joint in robot.joints}
    assert list(found) == [joint.name for joint in MECHANISM.joints]
    for joint in MECHANISM.joints:
        other = found[joint.name]
        assert (other.joint_type, other.parent, other.child) == (joint.kind, joint.parent, joint.child)
        if joint.limits is not None:
            for name in ("lower", "upper", "velocity", "effort"):
                assert getattr(other.limit, name) == pytest.approx(getattr(joint.limits, name), rel=1e-14)
        if joint.mimic is not None:
            assert (other.mimic.joint, other.mimic.multiplier) == (joint.mimic.joint, joint.mimic.multiplier)
    assert sorted(robot.actuated_joint_names) == sorted(
        joint.name for joint in MECHANISM.moving if joint.mimic is None
    )


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(robot, seed):
    q = mimicking_joints(seed)
    found = robot.link_fk(cfg={name: q[name] for name in robot.actuated_joint_names}, use_names=True)
    assert_placements(found, q)


def test_every_solid_is_there_in_its_colour(robot):
    for found in robot.links:
        link = LINKS[found.name]
        assert len(found.collisions) == len(link.collisions)
        assert len(found.visuals) == len(link.visuals)
        for visual, solid in zip(found.visuals, link.visuals, strict=True):
            assert visual.material.name == solid.colour.name
            np.testing.assert_allclose(visual.material.color, solid.colour.rgba, rtol=0, atol=1e-12)
            np.testing.assert_allclose(visual.origin[:3, 3], solid.placement.position, rtol=0, atol=1e-12)
            np.testing.assert_allclose(visual.origin[:3, :3], solid.placement.rotation, rtol=0, atol=1e-12)
            assert visual.geometry.geometry.meshes
