"""Rerun: `rerun.log_file_from_path("urdf/p3dof.urdf")`, or `rerun.urdf.UrdfTree` to move its joints."""

import numpy as np
import pinocchio as pin
import pytest
from reference import LINKS, MECHANISM, MOVING, URDF, assert_placements, composed, random_joints

rerun = pytest.importorskip("rerun", reason="rerun not installed: pip install 'p3dof[interop]'")
urdf = pytest.importorskip(
    "rerun.urdf", reason="this rerun-sdk has no rerun.urdf: pip install 'p3dof[interop]'"
)

SINGLE = 1e-6
"""Rerun computes transforms in single precision."""


@pytest.fixture(scope="module")
def tree():
    return urdf.UrdfTree.from_file_path(str(URDF))


def test_joints_have_the_same_names_types_and_limits(tree):
    assert (tree.name, tree.root_link().name) == ("p3dof", "base_link")
    assert sorted(joint.name for joint in tree.joints()) == sorted(joint.name for joint in MECHANISM.joints)
    for joint in MECHANISM.joints:
        found = tree.get_joint_by_name(joint.name)
        assert (found.joint_type, found.parent_link, found.child_link) == (
            joint.kind,
            joint.parent,
            joint.child,
        )
        assert found.origin_xyz == pytest.approx(joint.placement.position, abs=1e-14)
        rotation = pin.rpy.rpyToMatrix(*found.origin_rpy)
        np.testing.assert_allclose(rotation, joint.placement.rotation, rtol=0, atol=1e-14)
        if joint.limits is not None:
            for name in ("lower", "upper", "velocity", "effort"):
                expected = getattr(joint.limits, name)
                assert getattr(found, f"limit_{name}") == pytest.approx(expected, rel=1e-14)
        if joint.mimic is not None:
            assert (found.mimic.joint, found.mimic.multiplier) == (joint.mimic.joint, joint.mimic.multiplier)


def homogeneous(transform):
    placement = np.eye(4)
    (quaternion,) = transform.quaternion.as_arrow_array().to_pylist()
    (placement[:3, 3],) = transform.translation.as_arrow_array().to_pylist()
    placement[:3, :3] = pin.Quaternion(np.array(quaternion)).matrix()
    return placement


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(tree, seed):
    q = random_joints(seed)
    steps = {
        joint.child: (
            joint.parent,
            homogeneous(tree.get_joint_by_name(joint.name).compute_transform(q.get(joint.name, 0.0))),
        )
        for joint in MECHANISM.joints
    }
    assert_placements(composed(steps), q, SINGLE)


def test_it_logs_the_whole_robot_without_a_viewer(tree):
    for name, link in LINKS.items():
        assert len(tree.get_visual_geometry_paths(name)) == len(link.visuals)
        assert len(tree.get_collision_geometry_paths(name)) == len(link.collisions)
    with rerun.RecordingStream("p3dof") as recording:
        memory = recording.memory_recording()
        tree.log_urdf_to_recording(recording)
        for name in MOVING:
            recording.log(f"joints/{name}", tree.get_joint_by_name(name).compute_transform(0.05))
        solids = sum(len(link.visuals) + len(link.collisions) for link in LINKS.values())
        assert memory.num_msgs() >= solids + len(MECHANISM.joints) + len(MOVING)
        assert len(memory.drain_as_bytes()) > 10_000
