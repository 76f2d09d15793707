"""Controllers: what they promise on the exact model, on a wrong one, with cut-off forces and noise."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from lagrange import LagrangeModel
from machines import random_machine, random_states

import p3dof
from p3dof import PAPER
from p3dof._base.errors import ControllerError, InputError, SingularityError
from p3dof.machine.parameters import Friction
from p3dof.runs import (
    PD,
    ComputedTorque,
    ControlLoop,
    Feedforward,
    InitialState,
    Measurement,
    Noise,
    Reference,
    Springs,
)
from p3dof.runs.integration import RungeKutta4
from p3dof.runs.machine_plants import CompiledEquations

HOME = np.zeros(3)
ENTERED = p3dof.paper_motion(1001).from_rest(0.2)
OMEGA = 2 * math.pi * 5


def followed(controller, method="virtual-power", duration=ENTERED.duration, **limits):
    options = {
        "control": ControlLoop(1000, **limits),
        "method": method,
        "samples": round(1000 * duration) + 1,
    }
    return p3dof.load().simulate(duration, controller=controller, **options)


def scaled(factor):
    return replace(PAPER, bodies=PAPER.bodies.scaled(factor))


@pytest.fixture(scope="module")
def plain():
    return followed(PD(PAPER, ENTERED))


@pytest.mark.parametrize("method", ["virtual-power", "pinocchio"])
def test_the_inverse_model_makes_errors_hundreds_of_times_smaller(plain, method):
    run = followed(ComputedTorque(PAPER, ENTERED), method)
    assert run.finished
    assert np.all(run.peak_error < plain.peak_error / 1000)
    assert np.all(run.rms_error < plain.rms_error / 1000)
    assert plain.peak_error[2] > 0.05  # the motion is one that PD alone cannot follow


@pytest.mark.parametrize("error", [-0.1, pytest.param(0.1, marks=pytest.mark.slow)])
def test_a_wrong_mass_costs_no_more_than_its_share_of_the_acceleration(plain, error):
    """The closed loop is ë + s 2ζω ė + s ω² e = (1 - s)(ẍ_d + M⁻¹h): its gain is 1 / (s ω²) at most.

    For s below 1 it is a little underdamped, with a gain larger by exp(-πζ'/√(1-ζ'²)) < 1e-4.
    """
    run = followed(ComputedTorque(scaled(1 + error), ENTERED))
    robot, s = p3dof.load(), 1 + error
    M = robot.mass_matrix(ENTERED.pose, method="virtual-power")
    C = robot.coriolis_matrix(ENTERED.pose, ENTERED.velocity)
    h = np.einsum("nij,nj->ni", C, ENTERED.velocity) + robot.gravity_forces(ENTERED.pose)
    needed = ENTERED.acceleration + np.linalg.solve(M, h[..., None])[..., 0]
    bound = abs(error) * np.abs(needed).max(axis=0) / (s * OMEGA**2)
    assert np.all(run.peak_error < 1.01 * bound)
    assert np.all(run.peak_error[[0, 2]] < plain.peak_error[[0, 2]] / 8)
    better = followed(ComputedTorque(scaled(1 + error), ENTERED, frequency=20))
    assert np.all(better.peak_error < run.peak_error / 10)


def test_cut_off_forces_cost_little_and_are_made_up_for():
    """80 N where 95 N are needed in the last fifth of a motion that ends at rest, and half a second there."""
    motion = p3dof.paper_motion(1001).from_rest(0.2, stop=0.2)
    controller, end = ComputedTorque(PAPER, motion), motion.duration + 0.5
    options = {"controller": controller, "method": "virtual-power", "samples": 1701}
    free = p3dof.load().simulate(end, control=ControlLoop(1000), **options)
    assert np.abs(free.forces).max() > 95
    run = p3dof.load().simulate(end, control=ControlLoop(1000, saturation=80.0), **options)
    assert run.finished
    assert np.abs(run.forces).max() == 80
    assert np.abs(run.asked).max() > 80
    assert np.all(run.peak_error < [1.5e-3, 4e-3, 0.15])
    assert np.all(np.abs(run.error[-1]) < 1e-7)
    early = run.time < 0.9
    np.testing.assert_allclose(run.pose[early], free.pose[early], rtol=0, atol=1e-12)


def test_forces_far_too_small_end_the_run_with_its_reason():
    run = followed(ComputedTorque(PAPER, ENTERED), saturation=[40.0, 30.0, 30.0])
    assert not run.finished
    assert run.stop.kind == "slider stop"
    assert 0 < run.time[-1] < 1
    assert len(run) > 50


def test_an_error_at_the_start_dies_out_as_a_critically_damped_mass():
    """Continuous computed torque on the exact model: e = e0 (1 + ωt) exp(-ωt), in all three coordinates."""
    start = np.array([0.01, -0.02, 0.1])
    still = p3dof.Motion([0.0], [HOME], [HOME], [HOME])
    for method in ("virtual-power", "pinocchio"):
        controller = ComputedTorque(PAPER, still)
        run = p3dof.load().simulate(0.3, start=start, controller=controller, method=method, samples=31)
        expected = start * ((1 + OMEGA * run.time) * np.exp(-OMEGA * run.time))[:, None]
        np.testing.assert_allclose(run.pose, expected, rtol=0, atol=1e-9)


def test_the_damping_ratio_is_what_it_says():
    start, zeta = np.array([0.01, 0.0, 0.05]), 0.3
    still = p3dof.Motion([0.0], [HOME], [HOME], [HOME])
    controller = ComputedTorque(PAPER, still, damping=zeta)
    run = p3dof.load().simulate(0.5, start=start, controller=controller, method="virtual-power", samples=51)
    fast = OMEGA * math.sqrt(1 - zeta**2)
    wave = np.cos(fast * run.time) + zeta * OMEGA / fast * np.sin(fast * run.time)
    np.testing.assert_allclose(
        run.pose, start * (np.exp(-zeta * OMEGA * run.time) * wave)[:, None], rtol=0, atol=1e-9
    )


@pytest.mark.parametrize(
    "controller",
    [
        pytest.param(PD, marks=pytest.mark.slow),
        pytest.param(Feedforward, marks=pytest.mark.slow),
        ComputedTorque,
    ],
)
def test_an_integral_takes_away_what_a_wrong_mass_leaves(controller):
    still = p3dof.Motion([0.0], [HOME], [HOME], [HOME])
    robot = p3dof.load()
    without = robot.simulate(
        3,
        controller=controller(scaled(1.1), still),
        control=ControlLoop(200),
        method="virtual-power",
        samples=31,
    )
    with_it = robot.simulate(
        3,
        controller=controller(scaled(1.1), still, integral_time=0.2),
        control=ControlLoop(200),
        method="virtual-power",
        samples=31,
    )
    assert np.abs(without.pose[-1]).max() > 5e-4
    assert np.abs(with_it.pose[-1]).max() < 1e-7


def test_an_integral_does_not_wind_up_while_forces_are_cut_off():
    far = p3dof.Motion([0.0], [[0.05, 0.05, 0.3]], [HOME], [HOME])
    robot = p3dof.load()
    controller = PD(PAPER, far, integral_time=0.1)
    controller.reset()
    none, all_ = np.zeros(3, dtype=bool), np.ones(3, dtype=bool)
    geometry = PAPER.geometry
    first = controller(Measurement(0, 1e-3, HOME, HOME, none, geometry))
    cut = controller(Measurement(1e-3, 1e-3, HOME, HOME, all_, geometry))
    further = controller(Measurement(2e-3, 1e-3, HOME, HOME, none, geometry))
    np.testing.assert_array_equal(cut, first)
    assert np.all(np.abs(further) > np.abs(first) - 1e-12)
    assert np.any(further != first)
    run = robot.simulate(
        2,
        controller=controller,
        control=ControlLoop(500, saturation=90.0),
        method="virtual-power",
        samples=201,
    )
    assert run.finished
    assert np.abs(run.pose[-1] - [0.05, 0.05, 0.3]).max() < 1e-3


def test_computed_torque_stops_integrating_whichever_force_is_cut_off():
    far = p3dof.Motion([0.0], [[0.05, 0.05, 0.3]], [HOME], [HOME])
    controller = ComputedTorque(PAPER, far, integral_time=0.1)
    controller.reset()
    only_a = np.array([True, False, False])
    none = np.zeros(3, dtype=bool)
    first = controller(Measurement(0, 1e-3, HOME, HOME, none, PAPER.geometry))
    cut = controller(Measurement(1e-3, 1e-3, HOME, HOME, only_a, PAPER.geometry))
    np.testing.assert_array_equal(cut, first)


def test_a_reference_out_of_reach_is_named():
    far = p3dof.Motion([0.0], [[0.3, 0.0, 0.0]], [HOME], [HOME])
    for controller in (PD, Feedforward):  # computed torque only takes the difference
        with pytest.raises(ControllerError, match="out of reach: leg A is too short"):
            p3dof.load().simulate(
                0.1,
                controller=controller(PAPER, far),
                control=ControlLoop(100),
                method="virtual-power",
                stop_at=(),
            )


def test_a_controller_can_be_used_again():
    controller = PD(scaled(1.1), ENTERED, integral_time=0.1)
    first, second = (followed(controller, duration=0.4) for _ in range(2))
    np.testing.assert_array_equal(first.pose, second.pose)


def test_controllers_and_errors_travel_to_other_processes():
    controller = ComputedTorque(PAPER, ENTERED)
    none = np.zeros(3, dtype=bool)
    measured = Measurement(0.1, 1e-3, HOME, HOME, none, PAPER.geometry)
    expected = controller(measured)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(controller))(measured), expected)  # noqa: S301
    for error in (
        p3dof.errors.ReachError("far", "a", -0.1, (3,), 2),
        SingularityError("flat", (1, 2), 4),
        p3dof.errors.AssemblyError("open", 0.1),
        ControllerError("late", 0.5, None),
    ):
        again = pickle.loads(pickle.dumps(error))  # noqa: S301
        assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


def test_equal_seeds_give_equal_noise():
    noisy = [Noise(1e-6, 1e-3, seed) for seed in (1, 1, 2)]
    runs = [followed(ComputedTorque(PAPER, ENTERED), duration=0.4, noise=noise) for noise in noisy]
    np.testing.assert_array_equal(runs[0].pose, runs[1].pose)
    assert np.any(runs[0].pose != runs[2].pose)
    exact = followed(ComputedTorque(PAPER, ENTERED), duration=0.4)
    assert np.abs(runs[0].pose - exact.pose).max() < 1e-3
    assert np.all(runs[0].rms_error > exact.rms_error)


def test_what_is_measured_is_the_machine_and_its_noise():
    seen, robot = [], p3dof.load()
    hold = robot.forces(HOME, HOME, HOME)

    def controller(measured):
        seen.append(measured)
        return hold

    run = robot.simulate(
        0.1,
        start=InitialState([0.01, 0.02, 0.1], [0.1, 0, 0.2]),
        controller=controller,
        control=ControlLoop(1000, noise=Noise(1e-3, 1e-2)),
        method="virtual-power",
        samples=101,
    )
    sliders = np.array([measured.sliders for measured in seen]) - run.sliders[:100]
    speeds = np.array([measured.slider_velocities for measured in seen]) - run.slider_velocities[:100]
    assert sliders.std() == pytest.approx(1e-3, rel=0.15)
    assert speeds.std() == pytest.approx(1e-2, rel=0.15)
    exact = []
    robot.simulate(
        0.01,
        start=InitialState([0.01, 0.02, 0.1], [0.1, 0, 0.2]),
        controller=lambda m: (exact.append(m), HOME)[1],
        control=ControlLoop(1000),
        method="virtual-power",
    )
    np.testing.assert_allclose(exact[0].pose, [0.01, 0.02, 0.1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(exact[0].velocity, [0.1, 0, 0.2], rtol=0, atol=1e-14)


def test_the_gains_are_those_of_the_docstring():
    pd = PD(PAPER, ENTERED, frequency=2, damping=0.7)
    robot = p3dof.load()
    J = robot.jacobian(HOME, method="virtual-power")
    m = np.diag(np.linalg.inv(J).T @ robot.mass_matrix(HOME, method="virtual-power") @ np.linalg.inv(J))
    hold = robot.forces(HOME, HOME, HOME)
    still = np.zeros(3, dtype=bool)
    measured = Measurement(0.0, 0.0, np.array([0.01, 0, 0]), np.array([0, 0.1, 0]), still, PAPER.geometry)
    omega = 2 * math.pi * 2
    expected = hold - m * (omega**2 * np.array([0.01, 0, 0]) + 2 * 0.7 * omega * np.array([0, 0.1, 0]))
    np.testing.assert_allclose(pd(measured), expected, rtol=1e-12)


def test_plain_springs_have_no_preload_no_damping_and_rest_at_zero():
    none = np.zeros(3, dtype=bool)
    moving = Measurement(0, 0, HOME, np.ones(3), none, PAPER.geometry)
    np.testing.assert_array_equal(Springs(100.0)(moving), np.zeros(3))


def test_springs():
    springs = Springs([100, 200, 300], rest=0.01, damping=5, preload=[1, 2, 3])
    none = np.zeros(3, dtype=bool)
    measured = Measurement(0, 0, np.array([0.02, 0, 0]), np.array([0, 0, 0.1]), none, PAPER.geometry)
    np.testing.assert_allclose(springs(measured), [1 - 1, 2 + 2, 3 + 3 - 0.5], rtol=1e-14)
    x, step = np.array([0.03, -0.02, 0.01]), 1e-6
    undamped = Springs([100, 200, 300], rest=0.01, preload=[1, 2, 3])
    slope = [
        (undamped.energy(x + step * axis) - undamped.energy(x - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    force = undamped(Measurement(0, 0, x, HOME, none, PAPER.geometry))
    np.testing.assert_allclose(slope, -force, rtol=1e-8)


@pytest.mark.parametrize("sign", [-1, 1])
def test_held_computed_torque_asks_for_the_middle_of_the_hold(sign):
    """On a reference of constant acceleration the middle of a hold is known: x + v h/2 + a (h/2)²/2."""
    time = np.linspace(0, 1, 6)[:, None]
    a = sign * np.array([0.3, -0.4, 1.5])
    start, speed = np.array([0.01, 0.02, 0.1]), np.array([-0.1, 0.1, -0.5])
    pose = start + time * speed + time**2 / 2 * a
    motion = p3dof.Motion(time[:, 0], pose, speed + time * a, np.tile(a, (6, 1)))
    controller, robot, hold = ComputedTorque(PAPER, motion), p3dof.load(), 0.1
    for t in (0.0, 0.2, 0.4):
        x, v = start + t * speed + t**2 / 2 * a, speed + t * a
        sliders = robot.inverse_kinematics(x).sliders
        held = Measurement(
            t,
            hold,
            sliders,
            robot.jacobian(x, method="virtual-power") @ v,
            np.zeros(3, dtype=bool),
            PAPER.geometry,
        )
        middle = x + v * hold / 2 + a * hold**2 / 8
        expected = robot.forces(middle, v + a * hold / 2, a)
        np.testing.assert_allclose(controller(held), expected, rtol=1e-11)


def test_held_feedforward_is_that_of_the_middle_of_the_hold():
    robot, controller = p3dof.load(), Feedforward(PAPER, ENTERED)
    hold, t, none = 0.01, 0.6, np.zeros(3, dtype=bool)
    pose, velocity, _ = Reference(ENTERED).at(t)
    sliders = robot.inverse_kinematics(pose).sliders
    on_track = Measurement(
        t, hold, sliders, robot.jacobian(pose, method="virtual-power") @ velocity, none, PAPER.geometry
    )
    expected = robot.forces(*Reference(ENTERED).at(t + hold / 2))
    np.testing.assert_allclose(controller(on_track), expected, rtol=1e-10)


def test_computed_torque_gives_the_errors_the_dynamics_it_was_designed_for():
    """At any state: ẍ = ẍ_d + 2ζω (ẋ_d - ẋ) + ω² (x_d - x), by the forward dynamics of the machine."""
    robot, zeta, omega = p3dof.load(), 0.7, 2 * math.pi * 3
    controller = ComputedTorque(PAPER, ENTERED, frequency=3, damping=zeta)
    rng, none = np.random.default_rng(5), np.zeros(3, dtype=bool)
    for t in (0.0, 0.3, 0.7, 1.1):
        wanted = Reference(ENTERED).at(t)
        pose = wanted[0] + rng.normal(0, 0.01, 3)
        velocity = wanted[1] + rng.normal(0, 0.2, 3)
        sliders = robot.inverse_kinematics(pose).sliders
        measured = Measurement(
            t, 0.0, sliders, robot.jacobian(pose, method="virtual-power") @ velocity, none, PAPER.geometry
        )
        found = robot.forward_dynamics(pose, velocity, controller(measured), method="virtual-power")
        designed = wanted[2] + 2 * zeta * omega * (wanted[1] - velocity) + omega**2 * (wanted[0] - pose)
        np.testing.assert_allclose(found, designed, rtol=0, atol=1e-10)


def test_feedforward_adds_the_feedback_of_errors():
    robot, t, none = p3dof.load(), 0.6, np.zeros(3, dtype=bool)
    pose, velocity, _ = Reference(ENTERED).at(t)
    sliders = robot.inverse_kinematics(pose).sliders
    found = {}
    for off in (0.0, 0.003):
        measured = Measurement(t, 0.0, sliders - off, robot.jacobian(pose) @ velocity, none, PAPER.geometry)
        found[off] = Feedforward(PAPER, ENTERED)(measured)
    more = found[0.003] - found[0.0]
    assert np.all(more > 0)  # sliders that are too low are pushed up
    controller = PD(PAPER, ENTERED)
    np.testing.assert_allclose(more, controller.moved * controller.omega**2 * 0.003, rtol=1e-9)


@pytest.mark.parametrize("controller", [PD, Feedforward])
def test_the_integral_at_the_sliders_adds_to_the_error(controller):
    """Off by e at rest: after n calls every h the feedback is that of e (1 + n h / T)."""
    robot, none, period, within, off = p3dof.load(), np.zeros(3, dtype=bool), 1e-6, 1e-5, 0.002
    pose = np.array([0.02, 0.03, 0.1])
    still = p3dof.Motion([0.0, 1.0], [pose, pose], np.zeros((2, 3)), np.zeros((2, 3)))
    plain, integrating = controller(PAPER, still), controller(PAPER, still, integral_time=within)
    sliders = robot.inverse_kinematics(pose).sliders
    on_track, low = (
        Measurement(0.5, period, sliders - e, np.zeros(3), none, PAPER.geometry) for e in (0.0, off)
    )
    for calls in (1, 2, 3):
        more = integrating(low) - plain(on_track)
        expected = plain.moved * plain.omega**2 * off * (1 + calls * period / within)
        np.testing.assert_allclose(more, expected, rtol=1e-9)


def test_the_integral_of_computed_torque_adds_to_the_error():
    """At rest, off by e: after n calls every h the wanted acceleration is ω² e (1 + n h / T)."""
    robot, none, period, within = p3dof.load(), np.zeros(3, dtype=bool), 1e-6, 1e-5
    pose, off = np.array([0.02, 0.03, 0.1]), np.array([0.001, -0.002, 0.01])
    still = p3dof.Motion([0.0, 1.0], [pose, pose], np.zeros((2, 3)), np.zeros((2, 3)))
    controller = ComputedTorque(PAPER, still, integral_time=within)
    sliders = robot.inverse_kinematics(pose - off).sliders
    measured = Measurement(0.5, period, sliders, np.zeros(3), none, PAPER.geometry)
    for calls in (1, 2, 3):
        acceleration = robot.forward_dynamics(pose - off, HOME, controller(measured), method="compiled")
        expected = OMEGA**2 * off * (1 + calls * period / within)
        np.testing.assert_allclose(acceleration, expected, rtol=1e-6)


def test_a_reference_rests_before_and_after():
    motion = p3dof.paper_motion(101)
    reference = Reference(motion)
    pose, velocity, acceleration = reference.at(0.5)
    for found, expected in (
        (pose, motion.pose),
        (velocity, motion.velocity),
        (acceleration, motion.acceleration),
    ):
        np.testing.assert_allclose(found, expected[50], atol=1e-12)
    for time, end in ((-0.1, 0), (1.1, -1)):
        pose, velocity, acceleration = reference.at(time)
        np.testing.assert_array_equal(pose, motion.pose[end])
        assert velocity.shape == acceleration.shape == (3,)
        assert not velocity.any()
        assert not acceleration.any()
    np.testing.assert_allclose(reference.poses(motion.time[[3, 50]]), motion.pose[[3, 50]], atol=1e-12)
    np.testing.assert_array_equal(reference.poses(np.array([2.0])), motion.pose[-1:])
    late = p3dof.Motion(motion.time + 5, motion.pose, motion.velocity, motion.acceleration)
    np.testing.assert_allclose(Reference(late).at(0.5)[0], motion.pose[50], atol=1e-12)


def test_two_samples_are_a_reference_that_moves():
    motion = p3dof.Motion(
        [0.0, 1.0], [HOME, [0.02, 0.01, 0.1]], np.zeros((2, 3)), np.zeros((2, 3)), check=False
    )
    np.testing.assert_allclose(Reference(motion).at(0.5)[0], [0.01, 0.005, 0.05], rtol=1e-12)


def test_a_hold_whose_middle_is_beyond_reach_is_taken_at_its_beginning():
    """Leg A has 10 mm left and comes 50 mm nearer in half a hold; the other legs reach on."""
    pose, velocity = np.array([0.24, 0.0, 0.1]), np.array([1.0, 0.0, 0.0])
    time = np.array([0.0, 1.0])
    still = p3dof.Motion(time, np.tile(pose, (2, 1)), np.zeros((2, 3)), np.zeros((2, 3)))
    controller, robot, none = ComputedTorque(PAPER, still), p3dof.load(), np.zeros(3, dtype=bool)
    sliders = robot.inverse_kinematics(pose).sliders
    held = Measurement(
        0.0, 0.1, sliders, robot.jacobian(pose, method="virtual-power") @ velocity, none, PAPER.geometry
    )
    correction = -2 * OMEGA * velocity  # the pose is the wanted one
    expected = robot.forces(pose, velocity, correction)
    np.testing.assert_allclose(controller(held), expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PD("paper", ENTERED), "model: expected Parameters or a Manipulator, got 'paper'"),
        (lambda: PD(PAPER, 3), "motion: expected a Motion, got 3"),
        (lambda: PD(PAPER, ENTERED, frequency=0), "frequency: expected a positive number, got 0"),
        (lambda: PD(PAPER, ENTERED, damping=-1), "damping: expected a positive number, got -1"),
        (lambda: PD(PAPER, ENTERED, integral_time=0), "integral_time: expected a positive number, got 0"),
        (lambda: Springs(-1), "stiffness: expected zero or more"),
        (lambda: Springs([1, 2]), r"stiffness: expected shape \(3,\), got \(2,\)"),
        (lambda: Springs(1, damping=[0, -1, 0]), "damping: expected zero or more"),
        (lambda: Springs(np.nan), "stiffness: expected a finite number"),
        (lambda: Noise(-1), "position: expected zero or more, got -1"),
        (lambda: Noise(seed=-1), "seed: expected a whole number of zero or more, got -1"),
        (lambda: Noise(seed=1.5), "seed: expected a whole number of zero or more, got 1.5"),
    ],
)
def test_bad_input_is_one_clear_error(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_an_integral_needs_a_rate():
    controller = PD(PAPER, ENTERED, integral_time=0.1)
    with pytest.raises(InputError, match="an integral needs a control rate, this run is continuous"):
        p3dof.load().simulate(0.1, controller=controller, method="virtual-power")


def test_a_model_that_is_asked_at_a_singular_pose_says_so():
    singular = np.array([0.0, 0.0, math.atan2(p3dof.PAPER.geometry.h, 0.15)])
    theta = singular[2]
    robot = p3dof.load()
    for _ in range(50):  # Newton on the actuation angle
        step = 1e-6
        value = robot.singularity([0, 0, theta]).actuation
        theta -= value * step / (robot.singularity([0, 0, theta + step]).actuation - value)
    controller = Feedforward(PAPER, p3dof.Motion([0.0], [[0, 0, theta]], [HOME], [HOME]))
    with pytest.raises(ControllerError, match="actuation-singular") as caught:
        robot.simulate(0.1, controller=controller, control=ControlLoop(100), method="virtual-power")
    assert isinstance(caught.value.__cause__, SingularityError)


# --- what runs are made of ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "friction", [None, Friction({"joints": 0.3}, {"sliders": 4.0, "hinge_c": 0.2}, 0.05)]
)
@pytest.mark.parametrize("seed", [2, 5])
def test_the_compiled_equations_of_a_run_are_lagranges(seed, friction):
    machine = random_machine(seed)
    machine = machine if friction is None else replace(machine, friction=friction)
    states, model = random_states(machine, seed, 4, angle=0.3), LagrangeModel(machine)
    equations, robot = CompiledEquations(p3dof.closed_form.MachineKernels(machine)), p3dof.load(machine)
    for pose, velocity in zip(states.pose, states.velocity, strict=True):
        sliders, speeds = model.sliders(pose), model.slider_velocities(pose, velocity)
        found = equations.sliders(*pose, *velocity)
        np.testing.assert_allclose(found, [*sliders, *speeds], rtol=1e-9, atol=1e-12)
        forces, wrench = np.array([30.0, -20.0, 50.0]), np.array([0, 3.0, -7.0, 0, 1.5, 0])
        found = equations.acceleration(*pose, *velocity, *forces, *wrench[[1, 2, 4]])
        expected = robot.forward_dynamics(pose, velocity, forces, wrench=wrench)
        np.testing.assert_allclose(found, expected, rtol=1e-8)
        again = robot.forces(pose, velocity, np.array(found), wrench=wrench, method="pinocchio")
        np.testing.assert_allclose(again, forces, rtol=0, atol=1e-7 * np.abs(forces).max())


def test_rk4_is_exact_for_cubics_and_takes_the_series_of_exponentials():
    step = RungeKutta4(lambda t, y: np.array([4 * t**3, -y[1]]), 0.0, np.array([1.0, 1.0]), 0.3, 0.1)
    for count in range(1, 4):
        step.step()
        h = 0.1
        assert step.y[0] == pytest.approx(1 + (count * h) ** 4, rel=1e-14)
        assert step.y[1] == pytest.approx((1 - h + h**2 / 2 - h**3 / 6 + h**4 / 24) ** count, rel=1e-14)
    assert step.status == "finished"


def test_forces_that_are_late_by_a_part_of_a_period_change_twice_in_it():
    assert ControlLoop().changes == 0
    assert ControlLoop(1000).changes == ControlLoop(1000, delay=2e-3).changes == 1000
    assert ControlLoop(1000, delay=1.5e-3).changes == 2000
