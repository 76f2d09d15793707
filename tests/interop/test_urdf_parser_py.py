"""urdf-parser-py, the parser of ROS: `urdf_parser_py.urdf.URDF.from_xml_file("urdf/p3dof.urdf")`."""

import numpy as np
import pinocchio as pin
import pytest
from reference import LINKS, MECHANISM, URDF, assert_bodies, assert_placements, composed, random_joints

parser = pytest.importorskip(
    "urdf_parser_py.urdf", reason="urdf_parser_py not installed: pip install 'p3dof[interop]'"
)


@pytest.fixture
def robot():
    return parser.URDF.from_xml_string(URDF.read_bytes())


def homogeneous(pose):
    return pin.SE3(pin.rpy.rpyToMatrix(*pose.rpy), np.array(pose.xyz)).homogeneous


# urdf_parser_py 0.0.4 leaves the file open.
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
def test_only_ros2_control_is_unknown_to_it(capsys):
    robot = parser.URDF.from_xml_file(str(URDF))
    assert robot.name == "p3dof"
    assert capsys.readouterr().err.splitlines() == ["Unknown tag \"ros2_control\" in /robot[@name='p3dof']"]


def test_every_link_weighs_the_same(robot):
    bodies = {link.name: link.inertial for link in robot.links}
    assert_bodies({n: (b.mass, np.array(b.origin.xyz), b.inertia.to_matrix()) for n, b in bodies.items()})
    assert not any(any(body.origin.rpy) for body in bodies.values())


def test_joints_have_the_same_names_types_and_limits(robot):
    assert robot.get_root() == "base_link"
    assert [joint.name for joint in robot.joints] == [joint.name for joint in MECHANISM.joints]
    for found, joint in zip(robot.joints, MECHANISM.joints, strict=True):
        assert (found.type, found.parent, found.child) == (joint.kind, joint.parent, joint.child)
        if joint.limits is not None:
            for name in ("lower", "upper", "velocity", "effort"):
                assert getattr(found.limit, name) == pytest.approx(getattr(joint.limits, name), rel=1e-14)
        if joint.mimic is not None:
            assert (found.mimic.joint, found.mimic.multiplier) == (joint.mimic.joint, joint.mimic.multiplier)


@pytest.mark.parametrize("seed", range(3))
def test_its_numbers_put_the_links_where_they_should_be(robot, seed):
    q = random_joints(seed)
    steps = {}
    for joint in robot.joints:
        move = pin.SE3.Identity()
        if joint.type == "prismatic":
            move.translation = q[joint.name] * np.array(joint.axis)
        elif joint.type == "revolute":
            move.rotation = pin.exp3(q[joint.name] * np.array(joint.axis))
        steps[joint.child] = (joint.parent, homogeneous(joint.origin) @ move.homogeneous)
    assert_placements(composed(steps), q)


def test_every_solid_is_there_in_its_colour(robot):
    colours = {material.name: material.color.rgba for material in robot.materials}
    for found in robot.links:
        link = LINKS[found.name]
        assert [visual.material.name for visual in found.visuals] == [s.colour.name for s in link.visuals]
        assert len(found.collisions) == len(link.collisions)
        for visual, solid in zip(found.visuals, link.visuals, strict=True):
            np.testing.assert_allclose(colours[visual.material.name], solid.colour.rgba, atol=1e-12)
            np.testing.assert_allclose(visual.origin.xyz, solid.placement.position, atol=1e-12)
            assert type(visual.geometry).__name__ == type(solid.shape).__name__
