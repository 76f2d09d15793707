"""Pinocchio itself: `p3dof.loops.ClosedLoopModel.from_urdf("urdf/p3dof.urdf", "urdf/p3dof.yaml")`."""

import numpy as np
import pinocchio as pin
import pytest
from reference import (
    FILES,
    GRAVITY,
    LINKS,
    MECHANISM,
    MOVING,
    URDF,
    closed_joints,
    closed_states,
    mimicking_joints,
    placements,
)

from p3dof.loops import ClosedLoopModel, Sidecar

SIDECAR = FILES / "p3dof.yaml"


def test_every_link_weighs_what_the_description_says():
    """Pinocchio melts fixed links together: what all other tests compare with is compared here."""
    model = pin.buildModelFromUrdf(str(URDF))
    for joint in [None, *MECHANISM.moving]:
        name = "base_link" if joint is None else joint.child
        parts = [(LINKS[name].body, np.zeros(3))]
        parts += [
            (LINKS[m].body, j.placement.position) for m, j in MECHANISM.markers.items() if j.parent == name
        ]
        expected = pin.Inertia.Zero()
        for body, origin in parts:
            expected += pin.Inertia(body.mass, origin + body.com, body.inertia)
        found = model.inertias[0 if joint is None else model.getJointId(joint.name)]
        assert found.mass == pytest.approx(expected.mass, rel=1e-14)
        np.testing.assert_allclose(found.lever, expected.lever, rtol=0, atol=1e-15)
        size = np.abs(expected.inertia).max()
        np.testing.assert_allclose(found.inertia, expected.inertia, rtol=0, atol=1e-14 * size)
        if joint is not None:
            at = model.idx_qs[model.getJointId(joint.name)]
            limits = joint.limits
            assert model.lowerPositionLimit[at] == pytest.approx(limits.lower, rel=1e-14)
            assert model.upperPositionLimit[at] == pytest.approx(limits.upper, rel=1e-14)
            assert model.upperVelocityLimit[at] == pytest.approx(limits.velocity, rel=1e-14)
            assert model.upperEffortLimit[at] == pytest.approx(limits.effort, rel=1e-14)


def test_the_committed_pair_has_three_degrees_of_freedom_everywhere():
    loop = ClosedLoopModel.from_urdf(URDF, SIDECAR)
    assert loop.actuated == MECHANISM.actuated
    assert loop.mobility(np.zeros(10)) == 3
    for q in closed_joints(200):
        values = np.array([q[name] for name in loop.model.names[1:]])
        assert np.abs(loop.closure_error(values)).max() < 1e-13
        assert loop.mobility(values) == 3


@pytest.mark.parametrize("seed", range(3))
def test_mimic_moves_the_links_alike(seed):
    model = pin.buildModelFromUrdf(str(URDF), mimic=True)
    data = model.createData()
    assert (model.nq, model.nv, model.njoints) == (8, 8, 11)
    q = mimicking_joints(seed)
    free = [name for name, joint in MOVING.items() if joint.mimic is None]
    values = np.zeros(model.nq)
    for name in free:
        values[model.idx_qs[model.getJointId(name)]] = q[name]
    pin.framesForwardKinematics(model, data, values)
    for name, placement in placements(q).items():
        found = data.oMf[model.getFrameId(name, pin.FrameType.BODY)]
        np.testing.assert_allclose(found.homogeneous, placement, rtol=0, atol=1e-14)


def test_mimic_takes_the_same_forces():
    """With <mimic> for the parallelogram only legs A and B are left to close: the forces are the same."""
    model = pin.buildModelFromUrdf(str(URDF), mimic=True)
    model.gravity.linear = GRAVITY
    data = model.createData()
    states = closed_states(101)
    joints = states.joints
    free = [name for name, joint in MOVING.items() if joint.mimic is None]
    at = [model.idx_vs[model.getJointId(name)] for name in free]
    pairs = Sidecar.from_yaml(SIDECAR).closures[:2]
    selection = np.zeros((model.nv, 3))
    for column, name in enumerate(MECHANISM.actuated):
        selection[model.idx_vs[model.getJointId(name)], column] = 1
    worst = 0.0
    columns = [joints.names.index(name) for name in free]
    for q, v, a, forces in zip(joints.q, joints.v, joints.a, states.forces, strict=True):
        full = np.zeros((3, model.nv))
        full[:, at] = q[columns], v[columns], a[columns]
        rows = []
        for pair in pairs:
            one, two = (
                pin.computeFrameJacobian(
                    model, data, full[0], model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED
                )[:3]
                for frame in (pair.frame1, pair.frame2)
            )
            rows.append(two - one)
        needed = pin.rnea(model, data, *full)
        found = np.linalg.lstsq(np.hstack([selection, np.vstack(rows).T]), needed, rcond=1e-10)[0][:3]
        worst = max(worst, np.abs(found - forces).max())
    assert worst < 1e-12 * np.abs(states.forces).max()
