"""DART: `dartpy.utils.DartLoader().parseSkeleton("/full/path/of/urdf/p3dof.urdf")`."""

import numpy as np
import pytest
from reference import (
    GRAVITY,
    LINKS,
    MECHANISM,
    MOVING,
    URDF,
    assert_bodies,
    assert_placements,
    closed_joints,
    random_joints,
    tree_forces,
)

dart = pytest.importorskip("dartpy", reason="dartpy not installed: pip install 'p3dof[interop]'")


@pytest.fixture
def robot():
    options = dart.utils.DartLoaderOptions()
    options.mDefaultRootJointType = dart.utils.DartLoaderRootJointType.FIXED  # its default is a floating base
    loader = dart.utils.DartLoader()
    loader.setOptions(options)
    return loader.parseSkeleton(str(URDF))


def set_values(robot, what, values):
    for name, value in values.items():
        getattr(robot.getDof(name), what)(value)


def test_every_link_weighs_the_same(robot):
    bodies = {node.getName(): node.getInertia() for node in robot.getBodyNodes()}
    assert_bodies({n: (b.getMass(), b.getLocalCOM(), b.getMoment()) for n, b in bodies.items()})
    assert robot.getMass() == pytest.approx(sum(link.body.mass for link in LINKS.values()), rel=1e-12)


def test_joints_have_the_same_names_types_and_limits(robot):
    kinds = {"prismatic": "PrismaticJoint", "revolute": "RevoluteJoint", "fixed": "WeldJoint"}
    assert [dof.getName() for dof in robot.getDofs()] == list(MOVING)
    for joint in MECHANISM.joints:
        found = robot.getJoint(joint.name)
        assert found.getType() == kinds[joint.kind]
        assert found.getParentBodyNode().getName() == joint.parent
        assert found.getChildBodyNode().getName() == joint.child
        if joint.limits is None:
            continue
        limits, dof = joint.limits, robot.getDof(joint.name)
        assert dof.getPositionLimits() == pytest.approx((limits.lower, limits.upper), rel=1e-14)
        assert dof.getVelocityLimits() == pytest.approx((-limits.velocity, limits.velocity), rel=1e-14)
        assert dof.getForceLimits() == pytest.approx((-limits.effort, limits.effort), rel=1e-14)
        mimics = found.getActuatorType() == dart.dynamics.ActuatorType.MIMIC
        assert mimics == (joint.mimic is not None)


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(robot, seed):
    q = random_joints(seed)
    set_values(robot, "setPosition", q)
    assert_placements({n.getName(): n.getTransform().matrix() for n in robot.getBodyNodes()}, q, 1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_the_tree_takes_the_same_forces(robot, seed):
    q, v, a, forces = tree_forces(seed)
    robot.setGravity(GRAVITY)
    for what, values in (("setPosition", q), ("setVelocity", v), ("setAcceleration", a)):
        set_values(robot, what, values)
    robot.computeInverseDynamics()
    largest = max(map(abs, forces.values()))
    for name, force in forces.items():
        assert robot.getDof(name).getForce() == pytest.approx(force, abs=1e-12 * largest)


def test_every_solid_is_there_in_its_colour(robot):
    for name, link in LINKS.items():
        nodes = robot.getBodyNode(name).getShapeNodes()
        seen = [node.getVisualAspect().getRGBA() for node in nodes if node.hasVisualAspect()]
        assert len(seen) == len(link.visuals)
        for rgba, solid in zip(seen, link.visuals, strict=True):
            np.testing.assert_allclose(rgba, solid.colour.rgba, atol=1e-6)  # it keeps colours as floats
        assert sum(node.hasCollisionAspect() for node in nodes) == len(link.collisions)


@pytest.mark.parametrize("detector", ["FCL", "Bullet", "DART", "Ode"])
def test_nothing_touches_in_the_workspace(robot, detector):
    """Parent and child included."""
    robot.enableSelfCollisionCheck()
    robot.enableAdjacentBodyCheck()
    group = getattr(dart.collision, f"{detector}CollisionDetector")().createCollisionGroup()
    group.addShapeFramesOf(robot)
    option = dart.collision.CollisionOption(True, 100)
    option.collisionFilter = dart.collision.BodyNodeCollisionFilter()
    assert group.getNumShapeFrames() == sum(len(link.collisions) for link in LINKS.values())

    def touching(q):
        set_values(robot, "setPosition", q)
        result = dart.collision.CollisionResult()
        group.collide(option, result)
        return {node.getName() for node in result.getCollidingBodyNodes()}

    for q in closed_joints(2000):
        assert touching(q) == set()
    folded = {"hinge_a": 1.15, "hinge_b": -1.2}  # the legs swung up, crossed
    assert touching(dict.fromkeys(MOVING, 0.0) | folded) == {"leg_a", "leg_b"}
    assert touching(dict.fromkeys(MOVING, 0.0) | {"slide_c": 0.3}) == {"base_link", "slider_c"}  # too high
