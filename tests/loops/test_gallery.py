"""The robots of the gallery: what the page says of them, against what is known of such machines."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT, run
from gallery import GALLERY, MOBILITY, MOTORS

import p3dof
from p3dof.loops.tables import overview

IDLE = {"leg": ("left_ball", "right_ball")}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Names of the page's session."""
    folder = tmp_path_factory.mktemp("gallery")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return run(ROOT / "docs/how-to/gallery.md", folder)


@pytest.mark.parametrize("name", MOBILITY)
def test_robots_close_near_their_reference_and_every_motor_counts(name):
    robot = p3dof.load_robot(GALLERY / f"{name}.urdf")
    assembly = robot.assemble()
    assert assembly.same_assembly
    assert assembly.gap < 1e-12
    seen = overview(robot, assembly.q)
    assert seen.mobility == MOBILITY[name]
    assert len(robot.actuated) == MOTORS[name]
    assert seen.held == min(MOBILITY[name], MOTORS[name])
    assert seen.idle == IDLE.get(name, ())
    assert robot.beyond_limits(assembly.q) == {}
    assert (GALLERY / f"{name}.png").stat().st_size > 5000
    assert f"{name}.png" in (ROOT / "docs/how-to/gallery.md").read_text(encoding="utf-8")


def test_the_four_bar_keeps_its_energy_and_a_whole_turn_takes_no_work(page):
    assert page["drift"] < 1e-6
    turn, torque, time = page["turn"], page["torque"], page["time"]
    np.testing.assert_allclose(turn.q[-1] - turn.q[0], [2 * np.pi, -2 * np.pi, 0], rtol=0, atol=1e-9)
    power = torque[:, 0] * np.pi
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(time))
    assert abs(work) < 1e-9 * np.abs(power).max()  # of a periodic function: the rule is exact


def test_the_four_bar_turns_freely_without_end():
    robot = p3dof.load_robot(GALLERY / "four_bar.urdf")
    run = p3dof.runs.simulate_robot(robot, 2.0, samples=11, method="general")
    assert run.finished  # no limit is in its way
    assert np.ptp(run.q[:, 0]) > 5.0


def test_the_delta_shifts_and_does_not_turn(page):
    np.testing.assert_allclose(page["turning"], 0, rtol=0, atol=1e-12)
    assert page["mobility"] == 3
    assert page["delta"].unique.all()


def test_the_five_bar_has_one_force_that_is_open(page):
    assert page["five_bar"].unique.tolist() == [True, False, True]


def test_controllers_bring_robots_where_they_should_be(page):
    for name, motors, wanted in (
        ("settled", ("left_motor", "right_motor"), [1.8, 1.3]),
        ("shifted", ("motor_a", "motor_b", "motor_c"), [0.3, 0.5, 0.6]),
    ):
        found, model = page[name], page[name].loop.model
        assert found.finished
        assert found.gap.max() < 1e-10
        last = [found.q[-1][model.idx_qs[model.getJointId(motor)]] for motor in motors]
        np.testing.assert_allclose(last, wanted, rtol=0, atol=1e-3)


def test_the_pushed_stewart_platform_gives_way_as_springs_do(page):
    found, loop = page["pushed_run"], page["pushed_run"].loop
    assert found.finished
    assert np.abs(found.v[-1]).max() < 1e-2
    legs = [loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]
    # At rest the springs bear the push: held is what the controller adds against the weight.
    spring = 2000.0 * (np.array(page["lengths"]) - found.q[-1][legs])
    still = np.zeros(loop.model.nv)
    held = loop.inverse_dynamics(found.q[-1], still, still).tau
    pushed = loop.inverse_dynamics(found.q[-1], still, still, external=page["pushed"]).tau
    damped = 150.0 * np.abs(found.v[-1]).max()  # what dampers still give
    np.testing.assert_allclose(spring, pushed - held, rtol=0, atol=2 * damped)


def test_the_gripper_closes_until_its_fingers_meet(page):
    closing = page["closing"]
    assert not closing.finished
    assert "'left_drive' at its lower limit" in str(closing.stop)
    apart = 2 * (0.02 + 0.09 * np.sin(closing.q[-1][0]))
    assert 0 < apart < 5e-3


def test_the_stewart_platform_bears_its_weight_and_what_pushes_it(page):
    np.testing.assert_allclose(page["back"].a, page["wanted"], rtol=0, atol=1e-9)
    assert page["legs"].residual < 1e-11


def test_the_gripper_squeezes_by_virtual_work(page):
    robot, state = p3dof.load_robot(GALLERY / "gripper.urdf"), page["grasp"]
    free = robot.inverse_dynamics(state.q, state.v, state.a)
    lever = 0.09 * np.cos(0.35)  # m a finger moves per rad of the motor
    np.testing.assert_allclose(page["motor"] - free.tau, -2 * 10.0 * lever, rtol=1e-12)
    weightless = page["held"].lambda_[robot.constraint_rows[-1]] - free.lambda_[robot.constraint_rows[-1]]
    np.testing.assert_allclose(np.abs(weightless), 10.0 * lever, rtol=1e-10)


def test_rods_of_the_leg_bear_what_their_levers_say(page):
    robot, q = p3dof.load_robot(GALLERY / "leg.urdf"), page["bent_leg"].q
    model, data = robot.model, robot.model.createData()
    joint, frame = model.getJointId("knee"), model.getFrameId
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)
    crank, lever = (data.oMf[frame(name)].translation for name in ("knee_crank_pin", "shank_pin"))
    along = (lever - crank) / np.linalg.norm(lever - crank)
    # What hangs on the knee: shank, foot, cranks and rods of the ankle, and the push of the ground.
    knee = data.oMi[joint].translation
    weights = [
        (data.oMi[i].act(model.inertias[i].lever), model.inertias[i].mass * 9.81)
        for i in model.subtrees[joint]
        if i >= joint and model.names[i] != "knee_motor"
    ]
    forces = [(at, np.array([0, 0, -weight])) for at, weight in weights]
    forces.append((data.oMf[frame("foot")].translation, np.array([0, 0, 300.0])))
    about = sum(np.cross(at - knee, force)[1] for at, force in forces) - 30.0
    np.testing.assert_allclose(page["knee_rod"][0] * np.cross(lever - knee, along)[1], -about, rtol=1e-10)
    # The rods of the ankle pitch the foot together.
    ankle, centre = (
        data.oMf[frame("foot")].translation,
        data.oMf[frame("foot")].act(np.array([0.03, 0, -0.04])),
    )
    moment = np.cross(centre - ankle, [0, 0, -0.8 * 9.81])[1] - 30.0
    for side in ("left", "right"):
        rod = data.oMf[frame(f"{side}_rod_end")]
        heel = data.oMf[frame(f"{side}_heel")].translation
        moment += np.cross(heel - ankle, rod.rotation @ page[f"{side}_rod"])[1]
    assert abs(moment) < 1e-10 * 30.0


@pytest.mark.parametrize("drift", ["kick_drift", "sink_drift"])
def test_what_swings_freely_keeps_its_energy(page, drift):
    assert page[drift] < 1e-6


def test_two_hands_bear_the_bar_and_can_press_on_it(page):
    robot, state, smallest = p3dof.load_robot(GALLERY / "two_arms.urdf"), page["state"], page["smallest"]
    assert not smallest.tau_unique
    sixfold = np.array([50.0, 0, 0, 0, 0, 0] * 2)
    np.testing.assert_allclose(page["pressed"], sixfold, rtol=0, atol=1e-4)  # the yaw of one is 3.1415927
    np.testing.assert_allclose(page["firm"].a, state.a, rtol=0, atol=1e-9)
    rotation = page["place"].rotation
    other = rotation @ pin.rpy.rpyToMatrix(0, 0, np.pi)
    held = rotation @ smallest.lambda_[:3] + other @ smallest.lambda_[6:9]
    np.testing.assert_allclose(held, [0, 0, 3.0 * (9.81 + 1.0)], rtol=0, atol=1e-5)
    for extra in np.random.default_rng(0).normal(size=(5, 12)):
        # Other torques for the same motion are larger.
        N = np.linalg.svd(robot.closure_jacobian(state.q))[2][12:].T
        idle = extra - np.linalg.pinv(N[robot.actuated_v].T) @ (N[robot.actuated_v].T @ extra)
        assert np.linalg.norm(smallest.tau + idle) > np.linalg.norm(smallest.tau)
        again = robot.forward_dynamics(state.q, state.v, smallest.tau + idle)
        np.testing.assert_allclose(again.a, state.a, rtol=0, atol=1e-8)


def test_the_ground_bears_the_robot(page):
    feet, robot = page["feet"], p3dof.load_robot(GALLERY / "biped.urdf")
    np.testing.assert_allclose(feet[:, :3].sum(axis=0), [0, 0, page["weight"]], rtol=0, atol=1e-10)
    # The centre of pressure of both feet is below the centre of mass.
    centre = pin.centerOfMass(robot.model, robot.model.createData(), page["upright"].q)
    share = feet[:, 2] / page["weight"]
    print_y = np.array([[0.0, 0.1], [0.0, -0.1]])
    np.testing.assert_allclose(share @ (print_y + page["pressure"]), centre[:2], rtol=0, atol=1e-12)
    assert page["friction"].max() < 0.1
    assert np.abs(page["pressure"][:, 0]).max() < 0.1  # on the sole


def test_a_squat_takes_the_force_off_the_ground_that_momentum_says(page):
    robot, falling = p3dof.load_robot(GALLERY / "biped.urdf"), page["falling"]
    model, data = robot.model, robot.model.createData()
    q, still = page["upright"].q, np.zeros(robot.model.nv)
    pin.centerOfMass(model, data, q, still, np.array(falling.a))
    total = pin.computeTotalMass(model) * (data.acom[0] + [0, 0, 9.81])
    np.testing.assert_allclose(page["pushes"][:, :3].sum(axis=0), total, rtol=0, atol=1e-9)
    torso = pin.getFrameClassicalAcceleration(model, data, model.getFrameId("torso"), pin.LOCAL_WORLD_ALIGNED)
    np.testing.assert_allclose(torso.vector, [0, 0, -2.0, 0, 0, 0], rtol=0, atol=1e-9)


def test_the_robot_squats_and_its_feet_stay(page):
    down = page["down"]
    assert down.finished
    assert down.gap.max() < 1e-10
    assert page["height"][0] - page["height"][-1] > 0.06
    assert np.abs(down.v[-1]).max() < 0.5
    assert np.abs(down.forces).max() < 120.0
