"""Locked joints: the robot without them moves and weighs as the one whose joints are held."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

from p3dof._base.errors import ModelError
from p3dof.loops import ClosedLoopModel, Closure, Coupling, Sidecar

ANGLE = 1.2


def five_bar():
    model = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR).model
    rng = np.random.default_rng(1)
    model.armature = rng.uniform(0.01, 0.1, model.nv)
    model.damping = rng.uniform(0.1, 1.0, model.nv)
    reference = dict(zip(list(model.names)[1:], robots.five_bar_q(1.9, ANGLE), strict=True))
    return ClosedLoopModel(model, replace(robots.FIVE_BAR_SIDECAR, reference=reference))


def held(loop, joint, value):
    """The whole robot, a joint of which is held by a coupling; its motor is left out."""
    actuated = tuple(name for name in loop.actuated if name != joint)
    coupling = Coupling(joint, None, (value,))
    return ClosedLoopModel(
        loop.model, replace(loop.sidecar, actuated=actuated, couplings=(*loop.sidecar.couplings, coupling))
    )


def test_a_locked_robot_has_the_forces_and_accelerations_of_one_that_is_held():
    whole = five_bar()
    part, full = whole.lock({"right_joint": ANGLE}), held(whole, "right_joint", ANGLE)
    assert list(part.model.names)[1:] == ["left_joint", "left_elbow", "right_elbow"]
    assert part.actuated == ("left_joint",)
    assert part.sidecar.closures == whole.sidecar.closures
    rest = [0, 1, 3]
    for name in ("armature", "damping"):
        np.testing.assert_array_equal(getattr(part.model, name), getattr(whole.model, name)[rest])
    np.testing.assert_array_equal(part.reference, whole.reference[rest])
    rng = np.random.default_rng(2)
    for _ in range(5):
        motion = rng.normal(size=(2, 1))
        one, other = part.complete([1.85], *motion), full.complete([1.85], *motion)
        np.testing.assert_allclose(one.q, other.q[rest], rtol=0, atol=1e-12)
        pull = {"left_tip": rng.normal(size=6)}
        forces = [m.inverse_dynamics(s.q, s.v, s.a, pull) for m, s in ((part, one), (full, other))]
        np.testing.assert_allclose(forces[0].tau, forces[1].tau, rtol=0, atol=1e-11)
        np.testing.assert_allclose(forces[0].lambda_[[0, 2]], forces[1].lambda_[[0, 2]], rtol=0, atol=1e-10)
        tau = rng.normal(size=1)
        moves = [m.forward_dynamics(s.q, s.v, tau, pull) for m, s in ((part, one), (full, other))]
        np.testing.assert_allclose(moves[0].a, moves[1].a[rest], rtol=0, atol=1e-10)
        energies = [m.body_energies(s.q, s.v).kinetic.sum() for m, s in ((part, one), (full, other))]
        assert energies[0] == pytest.approx(energies[1], abs=1e-12)


def test_a_hexapod_without_its_motors_stands_still():
    whole = ClosedLoopModel.from_urdf(robots.hexapod(), robots.HEXAPOD_SIDECAR)
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.05, 0.2), np.array([0.02, 0.03, 0.6]))
    q = robots.hexapod_q(place, whole.model)
    values = {name: float(q[whole.model.idx_qs[whole.model.getJointId(name)]]) for name in whole.actuated}
    part = whole.lock(values)
    assert part.actuated == ()
    assert part.model.nv == whole.model.nv - 6
    rest = [i for i in range(whole.model.nq) if i not in [whole.model.idx_qs[j] for j in _ids(whole)]]
    assert np.abs(part.closure_error(q[rest])).max() <= 1e-12
    assert part.mobility(q[rest]) == whole.mobility(q) - 6


def _ids(loop):
    return [loop.model.getJointId(name) for name in loop.actuated]


def test_names_alone_lock_where_the_reference_is_and_reduced_keeps_the_others():
    whole = five_bar()
    for part in (whole.lock("right_joint"), whole.reduced(["left_joint", "left_elbow", "right_elbow"])):
        assert part.assemble([1.9]).q == pytest.approx(robots.five_bar_q(1.9, ANGLE)[[0, 1, 3]], abs=1e-12)
    assert whole.model.nv == 4  # untouched


def test_a_closure_that_locked_joints_hold_is_left_out_if_it_is_closed():
    whole, pair = five_bar(), robots.FIVE_BAR_SIDECAR.closures[0]
    part = whole.lock(["left_elbow", "right_joint", "left_joint"])
    assert part.sidecar.closures == (pair,)  # one joint is left, on one side
    loop = ClosedLoopModel(
        whole.model, replace(whole.sidecar, closures=(pair, Closure("left_far", "right_near", "hinge")))
    )
    with pytest.raises(ModelError, match=r"lock: the closure left_far/right_near is open by 0\.\d+ m or rad"):
        loop.lock({"left_joint": 0.3, "left_elbow": 0.2, "right_joint": 0.1})
    origin = np.array(whole.model.jointPlacements[1].translation)
    at_motor = whole.model.copy()
    at_motor.addFrame(pin.Frame("motor", 0, 0, pin.SE3(np.eye(3), origin), pin.FrameType.OP_FRAME))
    at_motor.addFrame(pin.Frame("shaft", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    loop = ClosedLoopModel(at_motor, replace(whole.sidecar, closures=(pair, Closure("motor", "shaft", "3d"))))
    assert loop.lock("left_joint").sidecar.closures == (pair,)


def coupled(*couplings):
    sidecar = Sidecar((), ("crank_joint",), couplings)
    return ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)


@pytest.mark.parametrize(
    ("coupling", "locked", "left"),
    [
        (Coupling("rocker_joint", "crank_joint", (0.1, -2.0)), {"crank_joint": 0.3}, ("rocker_joint", -0.5)),
        (Coupling("rocker_joint", "crank_joint", (0.1, -2.0)), {"rocker_joint": 0.5}, ("crank_joint", -0.2)),
        (Coupling("rocker_joint", "crank_joint", (0, 0, 2.0)), {"crank_joint": 0.3}, ("rocker_joint", 0.18)),
    ],
)
def test_of_two_coupled_joints_one_locks_the_other(coupling, locked, left):
    part = coupled(coupling).lock(locked)
    joint, value = left
    (found,) = part.sidecar.couplings
    assert (found.joint, found.on) == (joint, None)
    assert found.coefficients[0] == pytest.approx(value, abs=1e-15)


def test_of_three_coupled_joints_two_stay_coupled():
    coupling = Coupling("rocker_joint", "crank_joint", (0.1, -2.0), None, {"coupler_joint": 0.5})
    whole = coupled(coupling)
    for joint in ("rocker_joint", "crank_joint", "coupler_joint"):
        part = whole.lock({joint: 0.4})
        assert len(part.sidecar.couplings) == 1
        q = whole.assemble(None, _with(whole, joint, 0.4)).q
        held_ = held(whole, joint, 0.4) if joint != "rocker_joint" else None
        rest = [i for i in range(3) if i != whole.model.idx_qs[whole.model.getJointId(joint)]]
        if held_ is not None:
            q = held_.assemble(None, q).q
            assert np.abs(part.closure_error(q[rest])).max() < 1e-12
        solved = part.assemble().q
        full = np.empty(3)
        full[rest], full[whole.model.idx_qs[whole.model.getJointId(joint)]] = solved, 0.4
        assert np.abs(whole.closure_error(full)).max() < 1e-12


def _with(loop, joint, value):
    q = np.array(loop.reference)
    q[loop.model.idx_qs[loop.model.getJointId(joint)]] = value
    return q


def test_what_cannot_be_locked():
    whole = five_bar()
    for joints, words in (
        ({"left_elbo": 0.0}, "lock: the joint 'left_elbo' does not exist; did you mean 'left_elbow'"),
        ({"left_elbow": (0.0, 1.0)}, "lock: 'left_elbow': expected 1 values, got 2"),
        ({"left_elbow": float("nan")}, "lock: 'left_elbow': expected finite"),
        ({"left_elbow": "bent"}, "lock: 'left_elbow'"),
        (list(whole.model.names)[1:], "lock: expected at least one joint that is left"),
        (3, "lock: expected names of joints, or values by joint, got 3"),
        ([3], "lock: expected names of joints, got 3"),
    ):
        with pytest.raises(ModelError, match=words):
            whole.lock(joints)
    with pytest.raises(ModelError, match="reduced: the joint 'nobody' does not exist"):
        whole.reduced(["nobody"])
    with pytest.raises(ModelError, match="expected at least one joint that is left"):
        whole.reduced([])
    square = coupled(Coupling("rocker_joint", "crank_joint", (0.0, 0.0, 1.0)))
    with pytest.raises(ModelError, match="cannot be solved for 'crank_joint': lock that joint instead"):
        square.lock({"rocker_joint": 0.25})
    with pytest.raises(ModelError, match="the coupling rocker_joint=crank_joint does not hold: it is off"):
        square.lock({"rocker_joint": 0.3, "crank_joint": 0.5})
    assert square.lock({"rocker_joint": 0.25, "crank_joint": 0.5}).sidecar.couplings == ()


def test_a_continuous_joint_is_locked_at_an_angle():
    forces = []
    for kind in ("continuous", "revolute"):
        text = robots.four_bar(*robots.FOUR_BAR, kind=kind)
        whole = ClosedLoopModel.from_urdf(text, Sidecar((), ("crank_joint", "rocker_joint")))
        part = whole.lock({"coupler_joint": 0.7})
        forces.append(part.inverse_dynamics(part.reference, np.zeros(2), np.ones(2)).tau)
    np.testing.assert_allclose(*forces, rtol=0, atol=1e-12)
