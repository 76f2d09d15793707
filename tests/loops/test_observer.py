"""Momentum observers: against the equations of motion, runs under known wrenches, and the paper's method."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import FOUR_BAR, FOUR_BAR_SIDECAR, four_bar
from gallery import GALLERY, gallery
from numpy.testing import assert_allclose

import p3dof
from p3dof import runs
from p3dof._base.errors import AssemblyError, InputError, ModelError, SingularityError
from p3dof.loops import ClosedLoopModel, MomentumObserver
from p3dof.loops.trees import joint_value

LAST = {"five_bar": "right_tip", "delta": "platform", "leg": "foot"}


def lagged(time, values, bandwidth):
    """Values behind a lag of first order, by the implicit Euler method, in the middle of every period."""
    found, gains = np.zeros_like(values), 2 * np.pi * bandwidth * np.diff(time)
    for k, gain in enumerate(gains):
        middle = (values[k] + values[k + 1]) / 2
        found[k + 1] = (found[k] + gain * middle) / (1 + gain)
    return found


def along(robot, observer, frame, wrench, q):
    """What a wrench on a frame does along the coordinates."""
    return np.array(
        [robot.frame_jacobian(frame, one, None, observer.coordinates).jacobian.T @ wrench for one in q]
    )


@pytest.fixture(scope="module")
def pushed():
    """A five-bar that holds a pose against a wrench at its tip."""
    robot = gallery("five_bar")
    home = robot.assemble().q
    wrench = np.array([3.0, 0.0, -4.0, 0.0, 0.0, 0.0])
    pd = runs.JointPD(robot, home[[0, 2]] + 0.3, 100.0, 6.0, gravity=True)
    run = runs.simulate_robot(robot, 0.5, home, controller=pd, samples=1001, external={"right_tip": wrench})
    return robot, run, wrench


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "delta", "stewart", "gripper", "leg", "two_arms"])
def test_momentum_and_its_rate_are_those_of_the_equations_of_motion(name):
    """Ṁ ẏ is (C + Cᵀ) ẏ: what is left of the rate is Cᵀ ẏ, weight, springs, damping and friction."""
    robot, draw = gallery(name), np.random.default_rng(0)
    compiled = robot.compile(level="numpy")
    q = robot.regular_configuration
    for _ in range(3):
        speeds, tau = draw.normal(size=len(compiled.independent)), draw.normal(size=len(robot.actuated))
        state = {"q": q[None], "v_independent": speeds[None]}
        v = compiled.rows("completion", {**state, "a_independent": np.zeros((1, len(speeds)))})["v"][0]
        found = compiled.rows("momentum", {**state, "tau": tau[None]})
        of = robot.minimal_dynamics(q, v, compiled.independent)
        rate = of.coriolis_matrix.T @ of.speeds - of.gravity_forces + of.passive_forces + of.external_forces
        expected = {"momentum": of.mass_matrix @ of.speeds, "rate": rate, "actuation": of.actuation @ tau}
        for key, value in expected.items():
            assert_allclose(found[key][0], value, rtol=0, atol=1e-13 * max(1.0, np.abs(value).max()))


def test_a_wrench_is_seen_behind_the_lag(pushed):
    """To second order in the period."""
    robot, run, wrench = pushed
    observer, errors = robot.observer(20.0), []
    for step in (2, 1):
        time, q, v, forces = (array[::step] for array in (run.time, run.q, run.v, run.forces))
        true = along(robot, observer, "right_tip", wrench, q)
        found = observer.record(time, q, v, forces)
        errors.append(np.abs(found - lagged(time, true, 20.0)).max() / np.abs(true).max())
    assert errors[1] < 3e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("name", ["delta", "leg"])
def test_redundant_loops_and_free_coordinates(name):
    """A leg that nobody holds swings; what is not actuated is observed, too."""
    robot = gallery(name)
    start = robot.regular_configuration
    wrench = np.array([2.0, 1.0, -3.0, 0.1, 0.2, 0.3])
    frame = LAST[name]
    run = runs.simulate_robot(robot, 0.05, start, samples=201, external={frame: wrench})
    observer = robot.observer(200.0)
    found = observer.record(run.time, run.q, run.v, run.forces)
    true = along(robot, observer, frame, wrench, run.q)
    scale = np.abs(true).max()
    assert scale > 0.1
    assert_allclose(found, lagged(run.time, true, 200.0), rtol=0, atol=1e-4 * scale)


def test_a_floating_robot_feels_a_push_on_its_base():
    robot = p3dof.load_robot(GALLERY / "five_bar.urdf", root_joint=pin.JointModelFreeFlyer())
    start = robot.regular_configuration
    base = next(frame.name for frame in robot.model.frames if frame.parentJoint == 1)
    wrench = np.array([5.0, -2.0, 30.0, 0.2, 0.4, -0.3])
    run = runs.simulate_robot(robot, 0.05, start, samples=201, external={base: wrench})
    observer = robot.observer(200.0)
    found = observer.record(run.time, run.q, run.v, run.forces)
    true = along(robot, observer, base, wrench, run.q)
    assert len(observer.coordinates) == 8
    assert_allclose(found, lagged(run.time, true, 200.0), rtol=0, atol=1e-4 * np.abs(true).max())


def test_the_paper_s_method_says_what_the_motors_bear_of_a_load():
    """The observer is told the forces of a loaded platform by virtual powers, and nothing of the load."""
    machine, motion = p3dof.load(), p3dof.paper_motion(samples=1501)
    wrench = np.array([0.0, 40.0, -60.0, 0.0, 5.0, 0.0])
    loaded, free = (
        machine.inverse_dynamics(motion, wrench=w, method="virtual-power").forces for w in (wrench, None)
    )
    robot, moving = machine.loop, machine.mechanism_motion(motion)
    states = robot.complete_batch(moving.sliders, moving.slider_velocities, moving.slider_accelerations)
    observer = robot.observer(5.0)
    assert observer.coordinates == robot.actuated
    found, true = observer.record(motion.time, states.q, states.v, loaded), free - loaded
    assert np.abs(true).max() > 30.0  # N
    assert_allclose(found, lagged(motion.time, true, 5.0), rtol=0, atol=2e-5 * np.abs(true).max())
    # At rest nothing is left of the lag, and the platform's load is that of the paper's method to rounding.
    rest = np.zeros(robot.model.nv)
    still = np.zeros(3)
    held = machine.forces(motion.pose[700], still, still, wrench=wrench, method="virtual-power")
    for dt in (0.0, 1e12):
        observer.update(dt, states.q[700], rest, held)
    assert_allclose(observer.frame_wrench("platform_center", ["fy", "fz", "my"]), wrench, rtol=0, atol=1e-9)


def test_a_wrong_mass_is_a_force(pushed):
    """What the observer rests on is its model: a forearm of another mass shows as a load."""
    robot, run, _ = pushed
    heavier = robot.copy()
    heavier.model.inertias[heavier.model.getJointId("right_elbow")].mass *= 1.5
    q, rest = run.q[-1], np.zeros(robot.model.nv)
    more, usual = (one.inverse_dynamics(q, rest, rest).tau for one in (heavier, robot))
    for one, load in ((robot, 0.0 * more), (heavier, more - usual)):
        observer = one.observer(20.0)
        for dt in (0.0, 1e12):
            observer.update(dt, q, rest, usual)
        assert_allclose(observer.external, load, rtol=0, atol=1e-10)
    assert np.abs(load).max() > 0.1  # N m


def test_one_by_one_from_the_motors_and_all_at_once_are_the_same(pushed):
    robot, run, _ = pushed
    expected = robot.observer(20.0).record(run.time, run.q, run.v, run.forces, held=True)
    one, other = robot.observer(20.0, threshold=[0.1, 0.2]), robot.observer(20.0)
    motors = robot.actuated_v
    for i in range(60):
        dt = run.time[i] - run.time[i - 1] if i else 0.0
        acted = run.forces[max(i - 1, 0)]
        found = one.update(dt, run.q[i], run.v[i], acted)
        assert_allclose(found, expected[i], rtol=0, atol=1e-12)
        found = other.update_from_motors(dt, run.q[i][[0, 2]], run.v[i][motors], acted)
        assert_allclose(found, expected[i], rtol=0, atol=1e-8)
    assert one.share == pytest.approx(np.abs(expected[59] / [0.1, 0.2]).max(), rel=1e-10)
    assert one.contact
    one.update(0.0, run.q[60], run.v[60], run.forces[60])  # begins anew
    assert not one.external.any()
    assert not one.contact


def test_motors_that_jump_are_followed_on_their_branch():
    """Samples far from each other, as of a slow log, go the way in pieces."""
    robot, observer = gallery("five_bar"), gallery("five_bar").observer(20.0)
    home = robot.assemble().q
    for far in (0.0, 0.5, -0.4):
        values = home[[0, 2]] + [far, -far]
        observer.update_from_motors(0.1, values, [0.0, 0.0], [0.0, 0.0])
        q = robot.complete_batch(values[None], np.zeros((1, 2)), np.zeros((1, 2)), guess=home).q[0]
        weight = robot.inverse_dynamics(q, np.zeros(4), np.zeros(4)).tau
        held = robot.observer(20.0)
        for _ in range(2):
            held.update(0.1, q, np.zeros(4), weight)
        assert_allclose(held.external, 0.0, rtol=0, atol=1e-12)


def test_a_position_out_of_reach_is_told():
    """The rocker of a four-bar, driven there, turns by less than half a turn."""
    sidecar = replace(FOUR_BAR_SIDECAR, actuated=("rocker_joint",))
    robot = ClosedLoopModel.from_urdf(four_bar(*FOUR_BAR), sidecar)
    observer, start = robot.observer(20.0), robot.assemble()
    rocker = joint_value(robot.model, "rocker_joint", start.q)
    before = observer.update_from_motors(0.0, [rocker], [0.0], [0.0])
    with pytest.raises(AssemblyError, match="the linkage does not reach rocker_joint="):
        observer.update_from_motors(0.1, [rocker + 3.0], [0.0], [0.0])
    assert observer.external is before


def test_known_loads_are_no_contact():
    robot = gallery("stewart")
    compiled = robot.compile(external=["platform"], inertias=["platform_free"])
    q, rest = robot.assemble().q, np.zeros(robot.model.nv)
    wrench = {"platform": [5.0, 0.0, -20.0, 1.0, 0.0, 0.0]}
    body = robot.model.inertias[robot.model.getJointId("platform_free")].toDynamicParameters()
    body[:4] += [2.0, 0.0, 0.0, 0.1]
    given = {"platform_free": body}
    tau = compiled.inverse_dynamics(q, rest, rest, wrench, inertias=given).tau
    observer = robot.observer(10.0, compiled=compiled)
    for known in ((wrench, given), (None, given), (None, None)):
        observer.start()
        for dt in (0.0, 10.0):  # nothing of the lag is left: 2π 100 periods
            observer.update(dt, q, rest, tau, *known)
        assert (np.abs(observer.external).max() < 1e-9) == (known[0] is not None)
    observer.start()
    legs = q[[2, 5, 8, 11, 14, 17]]
    for dt in (0.0, 10.0):
        observer.update_from_motors(dt, legs, np.zeros(6), tau, wrench, given)
    assert np.abs(observer.external).max() < 1e-9
    assert_allclose(
        observer.record([0.0, 1.0], [q, q], [rest, rest], [tau, tau], wrench, given), 0.0, rtol=0, atol=1e-9
    )


def test_bad_input_is_one_line_and_changes_nothing(pushed):
    robot, run, _ = pushed
    q, v, tau = run.q[0], run.v[0], run.forces[0]
    for bandwidth in (0.0, -1.0, np.nan, "x"):
        with pytest.raises(InputError, match="bandwidth"):
            robot.observer(bandwidth)
    for threshold in (0.0, [1.0, 2.0, 3.0], [1.0, np.nan], -1.0):
        with pytest.raises(InputError, match="threshold: expected a positive number or 2 of them"):
            robot.observer(1.0, threshold)
    with pytest.raises(InputError, match="compiled: it was compiled for another robot"):
        robot.observer(1.0, compiled=gallery("delta").compile(level="numpy"))
    observer = robot.observer(20.0)
    with pytest.raises(ModelError, match="without a threshold"):
        observer.share  # noqa: B018
    with pytest.raises(InputError, match="nothing was seen yet"):
        observer.frame_wrench("right_tip", "fx")
    for i in range(3):
        observer.update(1e-3, run.q[i], run.v[i], run.forces[i])
    before = observer.external
    for words, arguments in (
        ("dt", (-1.0, q, v, tau)),
        ("dt", (np.nan, q, v, tau)),
        ("q: ", (1e-3, q[:3], v, tau)),
        ("v: ", (1e-3, q, [np.nan] * 4, tau)),
        ("forces", (1e-3, q, v, [1.0])),
        ("loops are open by", (1e-3, q + np.array([0.0, 0.1, 0.0, 0.0]), v, tau)),
        ("it was not compiled for that", (1e-3, q, v, tau, {"right_tip": np.zeros(6)})),
    ):
        with pytest.raises(InputError, match=words):
            observer.update(*arguments)
    with pytest.raises(InputError, match="rising times"):
        observer.record([0.0, 0.0], run.q[:2], run.v[:2], run.forces[:2])
    opened = run.q[:2] + np.array([[0.0] * 4, [0.0, 0.1, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"loops are open by .* at sample 1"):
        observer.record([0.0, 1.0], opened, run.v[:2], run.forces[:2])
    for components in ((), ["x"], ["fx", "fx"]):
        with pytest.raises(InputError, match="components: expected some of fx, fy"):
            observer.frame_wrench("right_tip", components)
    with pytest.raises(InputError, match="2 coordinates tell at most as many"):
        observer.frame_wrench("right_tip", ["fx", "fz", "my"])
    with pytest.raises(InputError, match="frame"):
        observer.frame_wrench("nowhere", "fx")
    with pytest.raises(SingularityError, match="does not tell fy apart"):  # out of the plane
        observer.frame_wrench("right_tip", "fy")
    assert observer.external is before
    with pytest.raises(ModelError, match="do not determine the motion"):
        gallery("leg").observer(1.0).update_from_motors(1e-3, np.zeros(6), np.zeros(6), np.zeros(6))
    assert repr(observer) == "MomentumObserver(left_motor, right_motor; 20 Hz)"
    assert isinstance(observer, MomentumObserver)


def test_near_a_singular_configuration_it_says_so():
    """The cranks' speeds determine nothing where both rods are in line."""
    robot = gallery("five_bar")
    q = robot.assemble([np.pi, 0.0]).q
    observer = robot.observer(20.0)
    with pytest.raises(SingularityError, match="hardly determine the motion"):
        observer.update(0.0, q, np.zeros(4), np.zeros(2))
