"""yourdfpy: `yourdfpy.URDF.load("urdf/p3dof.urdf")`."""

import numpy as np
import pytest
from reference import LINKS, MECHANISM, MOVING, URDF, assert_bodies, assert_placements, mimicking_joints

yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy not installed: pip install 'p3dof[interop]'")

# yourdfpy 0.0.60 itself calls a function that trimesh has deprecated.
pytestmark = pytest.mark.filterwarnings(r"ignore:`Scene.dump\(concatenate=True\)`:DeprecationWarning")


@pytest.fixture(scope="module")
def robot():
    return yourdfpy.URDF.load(str(URDF), load_collision_meshes=True, build_collision_scene_graph=True)


def test_it_is_valid(robot):
    assert robot.validate()
    assert robot.errors == []
    assert robot.base_link == "base_link"


def test_every_link_weighs_the_same(robot):
    bodies = {name: link.inertial for name, link in robot.link_map.items()}
    assert_bodies({name: (body.mass, body.origin[:3, 3], body.inertia) for name, body in bodies.items()})
    for body in bodies.values():
        np.testing.assert_array_equal(body.origin[:3, :3], np.eye(3))


def test_joints_have_the_same_names_types_and_limits(robot):
    assert list(robot.joint_map) == [joint.name for joint in MECHANISM.joints]
    for joint in MECHANISM.joints:
        found = robot.joint_map[joint.name]
        assert (found.type, found.parent, found.child) == (joint.kind, joint.parent, joint.child)
        if joint.limits is not None:
            for name in ("lower", "upper", "velocity", "effort"):
                assert getattr(found.limit, name) == pytest.approx(getattr(joint.limits, name), rel=1e-14)
        if joint.mimic is not None:
            assert (found.mimic.joint, found.mimic.multiplier) == (joint.mimic.joint, joint.mimic.multiplier)
    assert robot.actuated_joint_names == [name for name, joint in MOVING.items() if joint.mimic is None]


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(robot, seed):
    q = mimicking_joints(seed)
    robot.update_cfg({name: q[name] for name in robot.actuated_joint_names})
    assert_placements({name: robot.get_transform(name, "base_link") for name in LINKS}, q)


def test_every_solid_is_there_in_its_colour(robot):
    for name, link in LINKS.items():
        found = robot.link_map[name]
        assert [visual.material.name for visual in found.visuals] == [s.colour.name for s in link.visuals]
        assert len(found.collisions) == len(link.collisions)
        for solid in link.visuals:
            rgba = robot._material_map[solid.colour.name].color.rgba
            np.testing.assert_allclose(rgba, solid.colour.rgba, rtol=0, atol=1e-12)
    assert len(robot.scene.geometry) == sum(len(link.visuals) for link in LINKS.values())
    # It melts the collision solids of a link into one mesh.
    assert len(robot.collision_scene.geometry) == sum(bool(link.collisions) for link in LINKS.values())
