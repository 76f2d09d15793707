"""PyBullet: `pybullet.loadURDF("urdf/p3dof.urdf", useFixedBase=True, flags=URDF_USE_INERTIA_FROM_FILE)`."""

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
    placements,
    random_joints,
    tree_forces,
)

bullet = pytest.importorskip("pybullet", reason="pybullet not installed: pip install 'p3dof[interop]'")

SINGLE = 1e-6
"""PyBullet hands out link frames in single precision; mass centres and forces are in double."""


class Robot:
    """The loaded robot, addressed by names."""

    def __init__(self, flags):
        self.id = bullet.loadURDF(str(URDF), useFixedBase=True, flags=flags)
        self.joints = [bullet.getJointInfo(self.id, i) for i in range(bullet.getNumJoints(self.id))]
        self.index = {info[1].decode(): info[0] for info in self.joints}
        self.links = {"base_link": -1} | {info[12].decode(): info[0] for info in self.joints}
        self.names = {index: name for name, index in self.links.items()}

    def move(self, q):
        for name, value in q.items():
            bullet.resetJointState(self.id, self.index[name], value)

    def contacts(self):
        """Pairs of links that bullet has contact points for, also those that do not touch yet."""
        bullet.performCollisionDetection()
        points = bullet.getContactPoints(self.id, self.id)
        return {(self.names[point[3]], self.names[point[4]]) for point in points}


@pytest.fixture
def load():
    client = bullet.connect(bullet.DIRECT)
    yield Robot
    bullet.disconnect(client)


def test_every_link_weighs_the_same(load):
    robot = load(bullet.URDF_USE_INERTIA_FROM_FILE)
    bodies = {}
    for name, index in robot.links.items():
        mass, _, moments, com, turn, *_ = bullet.getDynamicsInfo(robot.id, index)
        if name == "base_link":  # its fixed base has none in Bullet; the tensor is diagonal in turned axes
            assert mass == 0
            axes = np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3))
            np.testing.assert_allclose(com, LINKS[name].body.com, rtol=1e-12)
            assert axes == pytest.approx(np.eye(3))
            continue
        assert turn == (0, 0, 0, 1)
        bodies[name] = (mass, com, np.diag(moments))
    bodies["base_link"] = (
        LINKS["base_link"].body.mass,
        LINKS["base_link"].body.com,
        LINKS["base_link"].body.inertia,
    )
    assert_bodies(bodies)


def test_without_the_flag_it_makes_up_its_own_inertias(load):
    """PyBullet's default: the tensor of the collision shapes, whatever the file says."""
    robot = load(0)
    *_, moments, _, _ = bullet.getDynamicsInfo(robot.id, robot.links["leg_a"])[:5]
    assert np.abs(np.array(moments) / np.diag(LINKS["leg_a"].body.inertia) - 1).max() > 0.1


def test_joints_have_the_same_names_types_and_limits(load):
    robot = load(bullet.URDF_USE_INERTIA_FROM_FILE)
    kinds = {
        bullet.JOINT_PRISMATIC: "prismatic",
        bullet.JOINT_REVOLUTE: "revolute",
        bullet.JOINT_FIXED: "fixed",
    }
    found = {info[1].decode(): info for info in robot.joints}
    assert sorted(found) == sorted(joint.name for joint in MECHANISM.joints)
    for joint in MECHANISM.joints:
        info = found[joint.name]
        assert (kinds[info[2]], info[12].decode()) == (joint.kind, joint.child)
        assert robot.names[info[16]] == joint.parent
        if joint.limits is not None:
            limits = joint.limits
            assert info[8:12] == pytest.approx((limits.lower, limits.upper, limits.effort, limits.velocity))
            assert info[13] == pytest.approx(joint.axis)


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(load, seed):
    robot = load(bullet.URDF_USE_INERTIA_FROM_FILE)
    q = random_joints(seed)
    robot.move(q)
    expected, found = placements(q), {"base_link": np.eye(4)}
    for name, index in list(robot.links.items())[1:]:
        state = bullet.getLinkState(robot.id, index, computeForwardKinematics=True)
        placement = np.eye(4)
        placement[:3, :3] = np.reshape(bullet.getMatrixFromQuaternion(state[5]), (3, 3))
        placement[:3, 3] = state[4]
        found[name] = placement
        center = expected[name] @ [*LINKS[name].body.com, 1]
        np.testing.assert_allclose(state[0], center[:3], rtol=0, atol=1e-12, err_msg=name)
    assert_placements(found, q, SINGLE)


@pytest.mark.parametrize("seed", range(3))
def test_the_tree_takes_the_same_forces(load, seed):
    robot = load(bullet.URDF_USE_INERTIA_FROM_FILE)
    bullet.setGravity(*GRAVITY)
    states = tree_forces(seed)
    names = [info[1].decode() for info in robot.joints if info[1].decode() in MOVING]
    q, v, a, forces = ([values[name] for name in names] for values in states)
    found = bullet.calculateInverseDynamics(robot.id, q, v, a)
    np.testing.assert_allclose(found, forces, rtol=0, atol=1e-12 * np.abs(forces).max())


def test_every_solid_is_there_in_its_colour(load):
    robot = load(bullet.URDF_USE_INERTIA_FROM_FILE)
    found = bullet.getVisualShapeData(robot.id)
    for name, link in LINKS.items():
        colours = [shape[7] for shape in found if shape[1] == robot.links[name]]
        assert len(colours) == len(link.visuals)
        for colour, solid in zip(colours, link.visuals, strict=True):
            assert colour == pytest.approx(solid.colour.rgba, abs=1e-6)


def test_nothing_touches_in_the_workspace(load):
    """Parent and child included."""
    robot = load(
        bullet.URDF_USE_INERTIA_FROM_FILE
        | bullet.URDF_USE_SELF_COLLISION
        | bullet.URDF_USE_SELF_COLLISION_INCLUDE_PARENT
    )
    for q in closed_joints(3000):
        robot.move(q)
        assert robot.contacts() == set()
    robot.move(dict.fromkeys(MOVING, 0.0) | {"hinge_a": 1.2, "hinge_b": -1.2})  # the legs swung up, crossed
    assert robot.contacts() == {("leg_a", "leg_b")}
    robot.move(dict.fromkeys(MOVING, 0.0) | {"slide_c": 0.3})  # too high
    assert robot.contacts() == {("base_link", "slider_c")}
