"""Assembling closed loops: closed forms, finite differences along assembled motions, and honest failures."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import FOUR_BAR, FOUR_BAR_SIDECAR
from hypothesis import given, settings
from hypothesis import strategies as st

from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import ClosedLoopModel, Closure, FrameTarget, Sidecar
from p3dof.loops import assembly as solver
from p3dof.loops.linear import Decomposition

XZ = [True, False, True, False, False, False]


@pytest.fixture(scope="module")
def bennett() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.bennett(), robots.BENNETT_SIDECAR)


@pytest.fixture(scope="module")
def parallelogram() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.parallelogram(), robots.PARALLELOGRAM_SIDECAR)


@pytest.fixture(scope="module")
def arm() -> ClosedLoopModel:
    model = robots.arm_model()
    return ClosedLoopModel(model, Sidecar.serial(model))


def frame_of(loop: ClosedLoopModel, q: np.ndarray, name: str) -> pin.SE3:
    data = loop.model.createData()
    pin.framesForwardKinematics(loop.model, data, q)
    return data.oMf[loop.model.getFrameId(name)].copy()


HEXAPOD_PLACE = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.05, -0.03, 0.6]))
ARM_Q = np.array([0.1, -0.3, 0.2, -2.0, 0.15, 1.9, 0.4])


# --- closed forms -------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(theta=st.floats(-3.1, 3.1), step=st.floats(-0.5, 0.5))
def test_four_bar_positions_in_closed_form(four_bar, theta, step):
    start = robots.four_bar_q(theta, *FOUR_BAR)
    result = four_bar.assemble([theta + step], guess=start)
    expected = robots.four_bar_q(theta + step, *FOUR_BAR)
    difference = (result.q - expected + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(difference).max() < 1e-13
    assert result.gap < 1e-14
    assert (result.rank, result.mobility, result.same_assembly) == (2, 1, True)


@settings(max_examples=40)
@given(theta=st.floats(-3.1, 3.1), step=st.floats(0.5, 3.0), sign=st.sampled_from([-1, 1]))
def test_a_long_way_is_followed_not_jumped(four_bar, theta, step, sign):
    # Plain Newton lands in the other assembly for many of these.
    start, goal = (robots.four_bar_q(t, *FOUR_BAR) for t in (theta, theta + sign * step))
    result = four_bar.assemble([theta + sign * step], guess=start)
    difference = (result.q - goal + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(difference).max() < 1e-12
    assert np.abs(result.q - start).max() < 2 * np.pi  # nor does any joint take an extra turn
    assert result.same_assembly


def test_a_continuous_crank_turns_all_the_way_round():
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*FOUR_BAR, kind="continuous"), FOUR_BAR_SIDECAR)
    assert (loop.model.nq, loop.model.nv) == (6, 3)
    angles = robots.four_bar_q(0.9, *FOUR_BAR)
    start = np.ravel(np.column_stack((np.cos(angles), np.sin(angles))))
    q = start
    for theta in 0.9 + np.linspace(0, 2 * np.pi, 40):  # the targets pass π, and end beyond 2π
        result = loop.assemble([theta], guess=q)
        q = result.q
        expected = robots.four_bar_q(theta, *FOUR_BAR)
        assert np.arctan2(q[1::2], q[::2]) == pytest.approx((expected + np.pi) % (2 * np.pi) - np.pi)
        assert result.same_assembly
    assert q == pytest.approx(start, abs=1e-13)
    state = loop.complete([0.9 + 2 * np.pi], [1.5], [2.0], guess=q)
    revolute = ClosedLoopModel.from_urdf(robots.four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR)
    same = revolute.complete([0.9], [1.5], [2.0], guess=angles)
    assert state.v == pytest.approx(same.v, abs=1e-12)
    assert state.a == pytest.approx(same.a, abs=1e-12)


def test_hexapod_leg_lengths_in_closed_form(hexapod):
    start = robots.hexapod_q(HEXAPOD_PLACE, hexapod.model)
    assert np.abs(hexapod.closure_error(start)).max() < 1e-15
    assert (hexapod.rank(start), hexapod.mobility(start), hexapod.generic_rank) == (18, 6, 18)
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.1, 0.5), np.array([0.15, -0.03, 0.7]))
    there = hexapod.assemble(FrameTarget("platform", place), guess=start)
    assert np.abs(there.q - robots.hexapod_q(place, hexapod.model)).max() < 1e-13
    # And back by the six actuators alone: forward kinematics.
    slides = [hexapod.model.idx_qs[hexapod.model.getJointId(name)] for name in hexapod.actuated]
    back = hexapod.assemble(start[slides], guess=there.q)
    assert np.abs(pin.difference(hexapod.model, start, back.q)).max() < 1e-12
    assert there.same_assembly
    assert back.same_assembly


@pytest.mark.parametrize("foot", [-0.3, 0.05, 0.4, 0.7])
def test_sarrus_lifts_along_a_line_in_spite_of_its_redundant_row(sarrus, foot):
    result = sarrus.assemble([foot])
    assert np.abs(result.q - foot * np.array([1, -2, 1] * 2)).max() < 1e-13
    assert (result.rank, result.mobility, sarrus.generic_rank) == (5, 1, 5)
    assert result.gap < 1e-14
    assert result.same_assembly
    plate = frame_of(sarrus, result.q, "plate")
    expected = [0.2, 0.0, 2 * robots.SARRUS_ARM * np.sin(np.pi / 4 + foot)]
    assert plate.translation == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("turn", [-0.5, 0.1, 1.5])
def test_bennetts_linkage_moves_although_its_rank_off_the_motion_says_not(bennett, turn):
    result = bennett.assemble([turn])
    expected = robots.bennett_angles(1.0 + turn) - robots.bennett_angles(1.0)
    assert np.abs(result.q - expected).max() < 1e-13
    assert (result.rank, result.mobility, bennett.generic_rank) == (3, 1, 3)
    assert result.gap < 1e-14
    assert result.same_assembly
    assert np.linalg.matrix_rank(bennett.closure_jacobian(result.q + 0.1 * np.arange(4))) == 4


@pytest.mark.parametrize("offset", [1e-5, 1e-4, 1e-3])
def test_rows_that_are_redundant_on_the_motion_only_do_not_mislead_newton(bennett, offset):
    # Closing from nearby must not slide along the free motion: with a fixed rank tolerance of 1e-9 it goes 60
    # times the offset that way.
    q = robots.bennett_angles(1.1) - robots.bennett_angles(1.0)
    for seed in range(5):
        start = q + offset * np.random.default_rng(seed).normal(size=4)
        result = bennett.assemble(None, guess=start)
        N = Decomposition.of(bennett.closure_jacobian(result.q)).null_space
        assert np.abs(N.T @ (result.q - start)).max() < 0.01 * offset
        assert result.iterations <= 3


def test_newton_is_quadratic(sarrus, five_bar):
    # A start that is off by some 1e-4: errors 1e-4 → 1e-8 → round-off.
    start = 0.2 * np.array([1, -2, 1] * 2) + 1e-4 * np.array([1, -1, 2, -2, 1, 1])
    assert sarrus.assemble([0.2], guess=start).iterations <= 3
    assert five_bar.assemble([2.0, 1.2], guess=robots.five_bar_q(2.0, 1.2) + 1e-4).iterations <= 3


# --- velocities and accelerations ---------------------------------------------------------------------------


def joint_motion(loop, q, rate, acceleration):
    """State at 0 and the assembled configurations around it, for a motion of the actuated joints."""
    indices = [loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]
    start, rate, acceleration = q[indices], np.asarray(rate), np.asarray(acceleration)
    state = loop.complete(start, rate, acceleration, guess=q)
    return state, lambda t: loop.assemble(start + rate * t + acceleration * t**2 / 2, guess=q).q


CASES = {
    "four_bar": (lambda _: robots.four_bar_q(0.9, *FOUR_BAR), [1.3], [-2.0]),
    "five_bar": (lambda _: robots.five_bar_q(2.0, 1.2), [1.3, -0.7], [2.0, 3.0]),
    "sarrus": (lambda _: 0.2 * np.array([1, -2, 1] * 2), [1.3], [-2.0]),
    "hexapod": (
        lambda model: robots.hexapod_q(HEXAPOD_PLACE, model),
        [0.3, -0.2, 0.1, 0.2, 0.4, -0.3],
        [1.0, 2.0, -1.0, 0.5, 0.2, -2.0],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_velocity_and_acceleration_are_the_derivatives_of_the_assembled_motion(request, name):
    loop = request.getfixturevalue(name)
    start, rate, acceleration = CASES[name]
    state, motion = joint_motion(loop, start(loop.model), rate, acceleration)
    v, a = robots.differences(motion, loop.model, h=5e-3)
    assert state.v == pytest.approx(v, abs=1e-9)
    assert state.a == pytest.approx(a, abs=1e-6)
    assert state.determined


MASKS = [
    [True] * 6,
    [True, True, True, False, False, False],
    [False, False, True, True, False, True],
    [False, False, False, False, True, False],
]


@pytest.mark.parametrize("mask", MASKS)
def test_frame_target_prescribes_the_masked_components(hexapod, mask):
    loop, model, k = hexapod, hexapod.model, sum(mask)
    q = robots.hexapod_q(HEXAPOD_PLACE, model)
    generator = np.random.default_rng(k)
    velocity, acceleration = generator.normal(size=(2, k))
    place = pin.SE3(pin.exp3(np.array([0.1, 0.2, -0.1])) @ HEXAPOD_PLACE.rotation, HEXAPOD_PLACE.translation)
    state = loop.complete(FrameTarget("corner_2", place, mask), velocity, acceleration, guess=q)
    data = model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, state.a)
    pin.updateFramePlacements(model, data)
    frame = (model, data, model.getFrameId("corner_2"), pin.LOCAL_WORLD_ALIGNED)
    M = data.oMf[model.getFrameId("corner_2")]
    error = np.concatenate((M.translation - place.translation, pin.log3(M.rotation @ place.rotation.T)))
    assert np.abs(error[mask]).max() < 1e-13
    assert np.all(np.abs(error[~np.array(mask)]) > 1e-3)  # the others are really left alone
    assert pin.getFrameVelocity(*frame).vector[mask] == pytest.approx(velocity, abs=1e-12)
    assert pin.getFrameClassicalAcceleration(*frame).vector[mask] == pytest.approx(acceleration, abs=1e-11)
    assert state.determined == (k == 6)
    assert np.abs(loop.closure_jacobian(state.q) @ state.v).max() < 1e-12


def test_frame_target_velocity_against_differences(hexapod):
    loop, q = hexapod, robots.hexapod_q(HEXAPOD_PLACE, hexapod.model)
    u, w, du = np.array([0.1, -0.2, 0.3]), np.array([0.4, 0.2, -0.5]), np.array([1.0, -2.0, 0.5])

    def place(t: float) -> pin.SE3:
        turned = pin.exp3(w * t) @ HEXAPOD_PLACE.rotation
        return pin.SE3(turned, HEXAPOD_PLACE.translation + u * t + du * t**2 / 2)

    velocity, acceleration = np.concatenate((u, w)), np.concatenate((du, np.zeros(3)))
    state = loop.complete(FrameTarget("platform", place(0.0)), velocity, acceleration, guess=q)
    v, a = robots.differences(
        lambda t: loop.assemble(FrameTarget("platform", place(t)), guess=q).q, loop.model, h=5e-3
    )
    assert state.v == pytest.approx(v, abs=1e-9)
    assert state.a == pytest.approx(a, abs=1e-6)


def test_newton_stays_quadratic_at_large_unmasked_rotations(arm):
    # Prescribe one component of rotation, a radian away in the two that are free.
    place = frame_of(arm, ARM_Q, "panda_hand")
    tilted = pin.SE3(pin.exp3(np.array([0.9, 0.0, -0.7])) @ place.rotation, place.translation)
    mask = [True, True, True, False, True, False]
    first = arm.assemble(FrameTarget("panda_hand", tilted, mask), guess=ARM_Q)
    near = arm.assemble(FrameTarget("panda_hand", tilted, mask), guess=first.q + 1e-3)
    rotation = frame_of(arm, near.q, "panda_hand").rotation @ tilted.rotation.T
    assert np.abs(pin.log3(rotation)[[0, 2]]).min() > 0.3
    assert abs(pin.log3(rotation)[1]) < 1e-14
    assert near.iterations <= 4
    assert near.gap < 1e-14


def test_a_serial_arm_reaches_from_its_stretched_singularity():
    # Stretched along x, no joint moves the tip inward to first order: a saddle for Newton.
    xml = robots.robot(
        robots.link("base"),
        robots.link("upper", robots.ROD),
        robots.link("lower", robots.BAR),
        robots.link("tip"),
        robots.joint("shoulder", "base", "upper"),
        robots.joint("elbow", "upper", "lower", (0.5, 0, 0)),
        robots.joint("tip_joint", "lower", "tip", (0.4, 0, 0), kind="fixed"),
    )
    loop = ClosedLoopModel.from_urdf(xml)
    target = FrameTarget("tip", pin.SE3(np.eye(3), np.array([0.6, 0.0, 0.0])), XZ)
    result = loop.assemble(target)
    elbow = np.arccos((0.6**2 - 0.5**2 - 0.4**2) / (2 * 0.5 * 0.4))
    assert abs(result.q[1]) == pytest.approx(elbow, abs=1e-13)
    assert not result.same_assembly  # elbow up or down: nothing says which


def test_without_a_target_the_loops_close_by_the_shortest_way(five_bar):
    q = robots.five_bar_q(2.0, 1.2)
    off = q + 1e-4 * np.array([1.0, -2.0, 3.0, 1.0])
    result = five_bar.assemble(guess=off)
    N = Decomposition.of(five_bar.closure_jacobian(result.q)).null_space
    assert np.abs(N.T @ (result.q - off)).max() < 1e-7  # no motion along the free directions
    assert np.abs(five_bar.closure_error(result.q)).max() < 1e-15


def test_warm_start_takes_few_iterations(hexapod):
    q = robots.hexapod_q(HEXAPOD_PLACE, hexapod.model)
    place = pin.SE3(HEXAPOD_PLACE.rotation, HEXAPOD_PLACE.translation + np.array([1e-3, 0, -1e-3]))
    result = hexapod.assemble(FrameTarget("platform", place), guess=q)
    assert result.iterations <= 3
    assert result.gap < 1e-14


def test_an_unfeasible_velocity_is_refused(five_bar):
    q = robots.five_bar_q(2.0, 1.2)
    target = FrameTarget("left_tip", frame_of(five_bar, q, "left_tip"), [True] * 3 + [False] * 3)
    five_bar.complete(target, [1.0, 0.0, 1.0], [0.0, 0.0, 0.0], guess=q)
    with pytest.raises(AssemblyError, match="cannot have this velocity") as caught:
        five_bar.complete(target, [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], guess=q)  # out of its plane
    assert caught.value.gap == pytest.approx(1.0)
    with pytest.raises(AssemblyError, match="cannot have this acceleration"):
        five_bar.complete(target, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], guess=q)


# --- which assembly -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [-1.5, -0.5, 0.5, 1.5])
def test_the_parallelogram_stays_one(parallelogram, theta):
    result = parallelogram.assemble([theta])
    assert np.abs(result.q - theta * np.array([1, -1, 1])).max() < 1e-13
    assert result.same_assembly


@pytest.mark.parametrize("theta", [-2.0, 3.0])
def test_behind_its_flat_pose_the_parallelogram_is_not_certain(parallelogram, theta):
    """At 90° it is flat and could go on as an antiparallelogram: which one it is cannot be established."""
    result = parallelogram.assemble([theta])
    assert result.gap < 1e-13
    assert not result.same_assembly


def test_a_bad_guess_lands_in_the_antiparallelogram_and_is_flagged(parallelogram):
    result = parallelogram.assemble([0.5], guess=[0.5, 2.0, -2.0])
    assert result.gap < 1e-12
    assert abs(result.q[0] - result.q[2]) > 0.5  # the cranks are not parallel
    assert not result.same_assembly


def test_a_rough_guess_that_ends_right_is_not_flagged(parallelogram):
    result = parallelogram.assemble([0.5], guess=[0.45, -0.6, 0.55])
    assert np.abs(parallelogram.closure_error([0.45, -0.6, 0.55])).max() > 1e-2
    assert np.abs(result.q - 0.5 * np.array([1, -1, 1])).max() < 1e-13
    assert result.same_assembly


def test_it_follows_the_antiparallelogram_when_asked_from_there(parallelogram):
    other = parallelogram.assemble([0.5], guess=[0.5, 2.0, -2.0])
    further = parallelogram.assemble([0.7], guess=other.q)
    assert abs(further.q[0] - further.q[2]) > 0.5
    assert further.same_assembly  # the same as the guess's, whose loops were closed


def test_elbow_modes_are_kept_over_a_long_way(five_bar):
    up = robots.five_bar_q(2.4, 0.8)
    down = five_bar.assemble([2.4, 0.8], guess=np.array([2.4, -3.3, 0.8, 3.0]))
    assert np.abs(down.q - up).max() > 0.5
    for start, goal in ((up, True), (down.q, False)):
        there = five_bar.assemble([1.6, 1.5], guess=start)
        back = five_bar.assemble([2.4, 0.8], guess=there.q)
        assert there.same_assembly
        assert back.same_assembly
        assert back.q == pytest.approx(start, abs=1e-12)
        assert (np.abs(there.q - robots.five_bar_q(1.6, 1.5)).max() < 1e-12) == goal


@pytest.mark.parametrize("guard", ["contraction", "short steps"])
def test_either_guard_alone_keeps_the_assembly(monkeypatch, guard):
    # Four hundred long ways of a non-Grashof four-bar; with neither guard, four of them end wrong unnoticed.
    if guard == "contraction":
        monkeypatch.setattr(solver, "FIRST_STEP", 3.0)
    else:
        monkeypatch.setattr(solver, "CONTRACTION", 1e9)
    lengths = (0.5, 0.4, 0.35, 0.3)
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), FOUR_BAR_SIDECAR)
    generator = np.random.default_rng(0)
    for start, goal in generator.uniform(0.45, 1.6, (400, 2)):
        result = loop.assemble([goal], guess=robots.four_bar_q(start, *lengths))
        difference = (result.q - robots.four_bar_q(goal, *lengths) + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(difference).max() < 1e-9
        assert result.same_assembly


def test_a_singular_configuration_is_flagged_by_its_rank(parallelogram):
    flat = np.pi / 2 * np.array([1, -1, 1])  # cranks along the bar: parallelogram and antiparallelogram meet
    assert parallelogram.rank(flat) == 1
    assert parallelogram.mobility(flat) == 2
    assert parallelogram.generic_rank == 2
    result = parallelogram.assemble([np.pi / 2], guess=flat)
    assert result.rank == 1
    assert not result.same_assembly


def test_the_generic_rank_is_not_spoiled_by_a_singular_neutral_configuration():
    loop = ClosedLoopModel.from_urdf(robots.flat_parallelogram(), robots.PARALLELOGRAM_SIDECAR)
    assert np.abs(loop.closure_error(np.zeros(3))).max() < 1e-15
    assert loop.rank(np.zeros(3)) == 1
    assert loop.generic_rank == 2
    regular = loop.regular_configuration
    assert loop.rank(regular) == 2
    assert np.abs(loop.closure_error(regular)).max() < 1e-12
    assert 0.05 < np.abs(regular).max() < 0.5  # near the reference, and well away from where it is singular
    s = np.linalg.svd(loop.closure_jacobian(regular), compute_uv=False)
    assert s[1] > 0.01 * s[0]
    usual = ClosedLoopModel.from_urdf(robots.parallelogram(), robots.PARALLELOGRAM_SIDECAR)
    np.testing.assert_array_equal(usual.regular_configuration, usual.assemble().q)


def test_a_regular_configuration_is_in_metres_whatever_the_size_of_the_robot():
    small = ClosedLoopModel.from_urdf(robots.flat_parallelogram(1e-3), robots.PARALLELOGRAM_SIDECAR)
    assert small.unit_of_length < 0.01
    assert (small.rank(np.zeros(3)), small.generic_rank) == (1, 2)
    assert small.rank(small.regular_configuration) == small.generic_rank
    assert np.abs(small.closure_error(small.regular_configuration)).max() < 1e-15


@pytest.fixture(scope="module")
def dead_centre() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.slider_crank(), robots.SLIDER_CRANK_SIDECAR)


@pytest.mark.parametrize("x", [0.1701, 0.2, 0.25, 0.28, 0.3, 0.32, 0.329])
def test_a_dead_centre_is_left_for_whatever_the_piston_reaches(dead_centre, x):
    crank, rod = robots.SLIDER_CRANK
    angle = np.arccos((x**2 + crank**2 - rod**2) / (2 * x * crank))  # law of cosines
    result = dead_centre.assemble([x - crank - rod])
    assert abs(np.cos(result.q[0]) - np.cos(angle)) < 1e-11
    assert not result.same_assembly
    state = dead_centre.complete([x - crank - rod], [1.0], [0.0])
    lever = np.sin(angle) * (1 + crank * np.cos(angle) / np.sqrt(rod**2 - (crank * np.sin(angle)) ** 2))
    assert abs(abs(state.v[0]) * crank * lever - 1.0) < 1e-10
    batch = dead_centre.complete_batch([[x - crank - rod]], [[1.0]], [[0.0]])
    assert abs(np.cos(batch.q[0, 0]) - np.cos(angle)) < 1e-11


def test_beyond_its_reach_the_piston_cannot_be(dead_centre):
    for x in (0.169, 0.3301, 0.4):
        with pytest.raises(AssemblyError, match="do not close at the target"):
            dead_centre.assemble([x - sum(robots.SLIDER_CRANK)])


def test_a_regular_configuration_is_one_that_the_motors_can_move(dead_centre):
    """The motor sees dx/dθ of the crank: zero at the dead centre, where the closures have their rank."""
    zero = np.zeros(3)
    assert dead_centre.rank(zero) == dead_centre.generic_rank == 2
    assert dead_centre.singularity_margins(zero).actuation < 1e-15
    regular = dead_centre.regular_configuration
    assert np.abs(dead_centre.closure_error(regular)).max() < 1e-12
    assert 0.05 < np.abs(regular).max() < 0.5
    assert dead_centre.singularity_margins(regular).actuation > 0.01
    around = dead_centre.around({"crank_joint": 1.0})
    np.testing.assert_array_equal(around.regular_configuration, around.assemble().q)
    # The motor of the crank moves it there: that one is regular.
    other = replace(robots.SLIDER_CRANK_SIDECAR, actuated=("crank_joint",))
    moved = ClosedLoopModel.from_urdf(robots.slider_crank(), other)
    np.testing.assert_array_equal(moved.regular_configuration, zero)


def test_another_reference_is_closed_where_joints_have_given_values():
    """In closed form; the value of a joint that follows chooses the other assembly of a four-bar."""
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    expected = robots.five_bar_q(1.9, 1.2)
    near = loop.around({"left_joint": 1.9, "right_joint": 1.2})
    np.testing.assert_allclose(near.reference, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(near.regular_configuration, near.assemble().q)
    assert loop.sidecar == robots.FIVE_BAR_SIDECAR
    assert (near.sidecar.closures, near.actuated) == (loop.sidecar.closures, loop.actuated)
    names = [str(name) for name in list(loop.model.names)[1:]]
    rounded = dict(zip(names, expected.round(2).tolist(), strict=True))  # more than there are freedoms
    assert np.abs(loop.around(rounded).reference - expected).max() < 0.01
    lengths = 0.5, 0.2, 0.45, 0.35
    four = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    for side in (1, -1):  # mirrored at the line of the ground
        q = side * robots.four_bar_q(0.7, *lengths)
        found = four.around({"rocker_joint": q[2], "crank_joint": q[0]})
        np.testing.assert_allclose(found.reference, q, rtol=0, atol=1e-12)


def test_joints_that_turn_without_end_and_floating_bases_start_anywhere():
    xml = robots.four_bar(0.5, 0.2, 0.45, 0.35, kind="continuous")
    q = robots.four_bar_q(0.7, 0.5, 0.2, 0.45, 0.35)
    sidecar = replace(robots.FOUR_BAR_SIDECAR, reference={"rocker_joint": q[2]})
    loop = ClosedLoopModel.from_urdf(xml, sidecar, pin.JointModelFreeFlyer())
    found = loop.around({"crank_joint": 0.7 - 2 * np.pi}).reference[7:].reshape(3, 2)
    np.testing.assert_allclose(found, np.column_stack((np.cos(q), np.sin(q))), rtol=0, atol=1e-12)


def test_a_reference_that_cannot_be_is_refused(five_bar):
    four = ClosedLoopModel.from_urdf(robots.four_bar(0.5, 0.2, 0.45, 0.35), robots.FOUR_BAR_SIDECAR)
    for loop, values, words in (
        (four, {"rocker_joint": 0.0}, r"do not close at rocker_joint=0: 0\.\d+ m or rad is left"),
        (
            five_bar,
            {"left_joint": 1.9, "right_joint": 1.2, "left_elbow": 1.0},
            "close at left_joint=1.9, right",
        ),
    ):
        with pytest.raises(AssemblyError, match=words) as caught:
            loop.around(values)
        assert 0.01 < caught.value.gap < np.inf
    for values, words in (
        ({"left_jont": 1.0}, "around: the joint 'left_jont' does not exist; did you mean"),
        ({"left_joint": np.nan}, "around: "),
        ({"left_joint": "far"}, "around: "),
        ([1.0], "around: expected a Mapping, got a list"),
    ):
        with pytest.raises(InputError, match=words):
            five_bar.around(values)


# --- failures -----------------------------------------------------------------------------------------------


def test_an_unreachable_target_raises_with_the_gap(five_bar, hexapod):
    q = robots.five_bar_q(2.0, 1.2)
    far = FrameTarget("left_tip", pin.SE3(np.eye(3), np.array([0.15, 0.0, 2.0])), XZ)
    with pytest.raises(AssemblyError, match=r"do not close at the target: .* most at the") as caught:
        five_bar.assemble(far, guess=q)
    assert 0.3 < caught.value.gap < 2.0
    assert f"{caught.value.gap:.3g}" in str(caught.value)
    sunk = FrameTarget("platform", pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.6])))
    hexapod.assemble(sunk, guess=robots.hexapod_q(HEXAPOD_PLACE, hexapod.model))  # this one is fine


@pytest.mark.parametrize("theta", [1.55, 1.8])
def test_a_crank_that_cannot_turn_so_far(theta):
    # Non-Grashof: coupler and rocker are in line at 1.602 rad, the crank goes no further.
    lengths = (0.5, 0.4, 0.35, 0.3)
    limit = np.arccos((0.5**2 + 0.4**2 - 0.65**2) / (2 * 0.5 * 0.4))
    assert 1.6 < limit < 1.61
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), FOUR_BAR_SIDECAR)
    start = robots.four_bar_q(1.0, *lengths)
    assert loop.assemble([limit - 1e-6], guess=start).same_assembly
    if theta < limit:
        assert loop.assemble([theta], guess=start).same_assembly
    else:
        with pytest.raises(AssemblyError) as caught:
            loop.assemble([theta], guess=start)
        assert caught.value.gap > 1e-3


def test_a_closure_that_cannot_close_is_named():
    loop = ClosedLoopModel.from_urdf(robots.four_bar(2.0, 0.2, 0.45, 0.35), FOUR_BAR_SIDECAR)
    with pytest.raises(AssemblyError, match=r"the loops do not close: .* coupler_tip/rocker_tip") as caught:
        loop.assemble(guess=np.array([0.1, 0.2, 2.9]))
    assert caught.value.gap == pytest.approx(1.0, abs=1e-2)  # 2.0 - 0.2 - 0.45 - 0.35
    with pytest.raises(AssemblyError, match="closure coupler_tip/rocker_tip"):
        loop.assemble([0.3])
    assert loop.generic_rank is None


def test_the_worst_of_several_closures_is_named():
    far = robots.link("far") + robots.joint("far_joint", "base", "far", (9, 0, 0), kind="fixed")
    xml = robots.four_bar(*FOUR_BAR).replace("</robot>", far + "</robot>")
    sidecar = Sidecar((*FOUR_BAR_SIDECAR.closures, Closure("far", "crank")), ("rocker_joint",))
    with pytest.raises(AssemblyError, match="most at the closure far/crank"):
        ClosedLoopModel.from_urdf(xml, sidecar).assemble()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0],), r"target: expected shape \(1,\), got \(2,\)"),
        (([np.nan],), "target: expected finite"),
        (("soon",), "target: expected real numbers"),
        (([1.0], [0.0, 0.0]), r"guess: expected shape \(3,\)"),
        (([1.0], [0.0, 0.0, np.inf]), "guess: expected finite"),
        (([1.0], None, 0.0), "tolerance: expected a positive number"),
        ((FrameTarget("crnk", pin.SE3.Identity()),), "target: the frame 'crnk' does not exist; did you mean"),
    ],
)  # fmt: skip
def test_assemble_refuses(four_bar, arguments, message):
    with pytest.raises(InputError, match=message):
        four_bar.assemble(*arguments)


@pytest.mark.parametrize(("velocity", "acceleration"), [([1.0, 2.0], [1.0]), ([1.0], []), ([np.nan], [1.0])])
def test_complete_refuses(four_bar, velocity, acceleration):
    with pytest.raises(InputError, match=r"velocity|acceleration"):
        four_bar.complete([0.9], velocity, acceleration, guess=robots.four_bar_q(0.9, *FOUR_BAR))


STRETCHED = pin.SE3(np.diag([2.0, 1.0, 1.0]), np.zeros(3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((3, pin.SE3.Identity()), "frame: expected the name"),
        (("tip", np.eye(4)), "placement: expected a pinocchio.SE3, got ndarray"),
        (("tip", STRETCHED), "not a rotation"),
        (("tip", pin.SE3(-np.eye(3), np.zeros(3))), "not a rotation"),
        (("tip", pin.SE3(np.eye(3), np.array([0, np.nan, 0]))), "placement: expected finite"),
        (("tip", pin.SE3.Identity(), [True] * 5), "mask: expected six bools"),
        (("tip", pin.SE3.Identity(), [1, 1, 1, 0, 0, 0]), "mask: expected six bools"),
        (("tip", pin.SE3.Identity(), [False] * 6), "at least one"),
    ],
)
def test_frame_target_refuses(arguments, message):
    with pytest.raises(InputError, match=message):
        FrameTarget(*arguments)


def test_a_frame_target_does_not_follow_its_arguments():
    place, mask = pin.SE3.Identity(), np.array(XZ)
    target = FrameTarget("tip", place, mask)
    place.translation = np.ones(3)
    mask[:] = False
    assert np.array_equal(target.placement.translation, np.zeros(3))
    assert np.array_equal(target.mask, XZ)
    with pytest.raises(ValueError, match="read-only"):
        target.mask[0] = False


# --- closures as such ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_jacobian_and_drift_are_derivatives_also_off_the_closed_loops(kind):
    """The drift is exact where the loop is open too: J̇ v against differences of J."""
    xml = robots.hexapod()
    loop = ClosedLoopModel.from_urdf(xml, Sidecar((Closure("rod_0_tip", "corner_0", kind),), ("slide_0",)))
    generator = np.random.default_rng(1)
    q = pin.integrate(loop.model, pin.neutral(loop.model), generator.normal(size=loop.model.nv))
    v = generator.normal(size=loop.model.nv)
    J = loop.closure_jacobian(q)
    J_dot, _ = robots.differences(lambda t: loop.closure_jacobian(pin.integrate(loop.model, q, t * v)))
    kinematics = loop._tree.kinematics
    kinematics.move(q, v)
    assert kinematics.acceleration() == pytest.approx(J_dot @ v, abs=1e-10)
    if kind == "3d":
        rate, _ = robots.differences(lambda t: loop.closure_error(pin.integrate(loop.model, q, t * v)))
        assert J @ v == pytest.approx(rate, abs=1e-10)


def test_constraint_models_are_plain_and_a_copy(hexapod, sarrus):
    models = hexapod.constraint_models
    assert [model.shortname() for model in models] == ["PointAnchorConstraintModel"] * 6
    assert [model.shortname() for model in sarrus.constraint_models] == ["FrameAnchorConstraintModel"]
    models.append(models[0])
    assert len(hexapod.constraint_models) == 6
    assert [rows.stop - rows.start for rows in hexapod.constraint_rows] == [3] * 6


def test_copies_work_in_threads(five_bar):
    from concurrent.futures import ThreadPoolExecutor

    q = robots.five_bar_q(2.0, 1.2)
    loops = [five_bar.copy() for _ in range(4)]

    def run(index: int) -> np.ndarray:
        return np.array(
            [loops[index].assemble([2.0 + 0.01 * index + 0.001 * k, 1.2], guess=q).q for k in range(50)]
        )

    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(run, range(4)))
    for index, result in enumerate(results):
        expected = [robots.five_bar_q(2.0 + 0.01 * index + 0.001 * k, 1.2) for k in range(50)]
        assert np.abs(result - expected).max() < 1e-12
