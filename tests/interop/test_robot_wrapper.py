"""RobotWrapper, as example-robot-data loads: `pin.RobotWrapper.BuildFromURDF("urdf/p3dof.urdf")`."""

import numpy as np
import pinocchio as pin
import pytest
from reference import FILES, GRAVITY, LINKS, MOVING, URDF, placements, random_joints, tree_forces

from p3dof.loops import ClosedLoopModel, Sidecar


def wrapped():
    return pin.RobotWrapper.BuildFromURDF(str(URDF), [str(FILES)])


def example():
    loaders = pytest.importorskip(
        "example_robot_data.robots_loader",
        reason="example_robot_data not installed: pip install 'p3dof[interop]'",
    )

    class Loader(loaders.RobotLoader):
        model_path = str(FILES)
        urdf_subpath = ""
        urdf_filename = URDF.name

    return Loader().robot


@pytest.mark.parametrize("load", [wrapped, example])
def test_it_wraps_model_and_solids(load):
    robot = load()
    assert list(robot.model.names)[1:] == list(MOVING)
    assert len(robot.visual_model.geometryObjects) == sum(len(link.visuals) for link in LINKS.values())
    assert len(robot.collision_model.geometryObjects) == sum(len(link.collisions) for link in LINKS.values())
    assert pin.computeTotalMass(robot.model) == pytest.approx(
        sum(link.body.mass for name, link in LINKS.items() if name != "base_link"), rel=1e-12
    )
    np.testing.assert_array_equal(robot.q0, np.zeros(10))
    for solid in robot.visual_model.geometryObjects:
        name, number = solid.name.rsplit("_", 1)
        expected = LINKS[name].visuals[int(number)]
        np.testing.assert_allclose(solid.meshColor, expected.colour.rgba, atol=1e-12)
        link = robot.model.frames[robot.model.getFrameId(name, pin.FrameType.BODY)].placement
        place = link.actInv(solid.placement)
        np.testing.assert_allclose(place.translation, expected.placement.position, rtol=0, atol=1e-12)
        np.testing.assert_allclose(place.rotation, expected.placement.rotation, rtol=0, atol=1e-12)


@pytest.mark.parametrize("load", [wrapped, example])
def test_it_moves_and_weighs_the_same(load):
    robot = load()
    robot.model.gravity.linear = GRAVITY
    q, v, a, forces = (np.array([values[name] for name in MOVING]) for values in tree_forces(0))
    np.testing.assert_allclose(pin.rnea(robot.model, robot.data, q, v, a), forces, rtol=0, atol=1e-12)
    values = random_joints(1)
    robot.framesForwardKinematics(np.array([values[name] for name in MOVING]))
    for name, placement in placements(values).items():
        found = robot.data.oMf[robot.model.getFrameId(name, pin.FrameType.BODY)]
        np.testing.assert_allclose(found.homogeneous, placement, rtol=0, atol=1e-14)


def test_the_sidecar_closes_its_loops():
    loop = ClosedLoopModel(wrapped().model, Sidecar.from_yaml(FILES / "p3dof.yaml"))
    assert loop.mobility(np.zeros(10)) == 3
