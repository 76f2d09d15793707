"""Runs in time: conservation, an independent integration, events, bad input."""

import inspect
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from lagrange import LagrangeModel
from machines import random_friction, random_machine, random_states
from scipy.integrate import solve_ivp

import p3dof
from p3dof import PAPER
from p3dof._base.errors import ControllerError, DynamicsError, FileError, InputError, ReachError
from p3dof.machine import Friction, Limits
from p3dof.runs import ControlLoop, InitialState, Integration, Springs
from p3dof.runs.settings import estimate

METHODS = ("virtual-power", "pinocchio")
HOME = np.zeros(3)
WIDE = replace(PAPER, limits=Limits(travel=(-5, 5), tilt=(-3, 3)))


def grouped(arguments):
    """Make the settings of a run; they are given as mappings where making them is what fails."""
    kinds = {"start": InitialState, "control": ControlLoop, "integration": Integration}
    made = {k: kinds[k](**v) for k, v in arguments.items() if k in kinds and isinstance(v, dict)}
    return {"method": "virtual-power", **arguments, **made}


def swinging(method, duration, samples, **integration):
    """Undamped, the sliders on springs: a conservative system within the limits."""
    robot = p3dof.load()
    springs = Springs(2000.0, preload=robot.forces(HOME, HOME, HOME))
    run = robot.simulate(
        duration,
        start=InitialState([0.02, 0.03, 0.15], [0.1, 0, 0.2]),
        controller=springs,
        method=method,
        samples=samples,
        integration=Integration(**integration),
    )
    return robot, springs, run


@pytest.mark.slow
def test_a_minute_of_oscillation_keeps_its_energy():
    robot, springs, run = swinging("virtual-power", 60, 3001, rtol=1e-12, atol=1e-14)
    assert run.finished
    assert run.time[-1] == 60
    assert drift(robot, springs, run) <= 1e-10
    assert np.ptp(run.pose, axis=0).min() > 0.05  # it does swing


def drift(robot, springs, run):
    """By how much the energy changes, as a share of the largest kinetic energy."""
    model = LagrangeModel(robot.parameters)
    kinetic = model.kinetic_energy(run.pose, run.velocity)
    energy = kinetic + model.potential_energy(run.pose) + springs.energy(run.sliders)
    assert kinetic.max() > 3
    return np.abs(energy - energy[0]).max() / kinetic.max()


def test_a_minute_at_the_default_tolerance_keeps_its_energy():
    robot, springs, run = swinging("compiled", 60, 3001)
    assert run.time[-1] == 60
    assert drift(robot, springs, run) <= 1e-9


@pytest.mark.slow
def test_oscillation_of_all_joints_keeps_its_loops_closed():
    robot, springs, run = swinging("pinocchio", 20, 201)
    assert run.finished
    assert run.closure_error.max() <= 1e-11
    assert drift(robot, springs, run) <= 1e-9 / 3
    _, _, other = swinging("compiled", 20, 201)
    assert np.abs(run.pose - other.pose).max() < 1e-8


def test_both_ways_agree_over_the_first_second():
    _, _, run = swinging("pinocchio", 1, 101, rtol=1e-12, atol=1e-14)
    assert run.closure_error.max() <= 1e-11
    _, _, other = swinging("virtual-power", 1, 101, rtol=1e-12, atol=1e-14)
    assert np.abs(run.pose - other.pose).max() < 1e-11
    assert np.abs(run.velocity - other.velocity).max() < 1e-10
    assert np.abs(run.acceleration - other.acceleration).max() < 2e-9


def test_without_stabilisation_loops_open_faster():
    _, _, held = swinging("pinocchio", 5, 51, rtol=1e-7)
    _, _, loose = swinging("pinocchio", 5, 51, rtol=1e-7, stabilisation=0)
    assert held.closure_error.max() < loose.closure_error.max() / 5


@pytest.mark.parametrize(
    ("method", "seed"), [*(("virtual-power", seed) for seed in (1, 2, 3)), ("pinocchio", 1)]
)
def test_any_machine_moves_as_lagrange_has_it(method, seed):
    """Friction, wrench and forces that change in time, against SciPy on the third derivation."""
    rough = random_friction(np.random.default_rng(seed))
    machine = random_machine(seed)
    size = machine.geometry.L
    machine = replace(machine, limits=Limits((-99 * size, 99 * size), tilt=(-3, 3)))
    pose = random_states(machine, seed, 1, drop=0.5, angle=0.5).pose[0]
    robot, model = p3dof.load(machine), LagrangeModel(machine)
    hold = robot.forces(pose, HOME, HOME)
    wrench = np.random.default_rng(seed).normal(0, 1, 6) * np.abs(hold).max() / 10
    duration = 0.15 * np.sqrt(size)

    def forces(time):
        return hold * (1 + 0.3 * np.sin(20 * time))

    def rate(time, x):
        return np.concatenate([x[3:], model.accelerations(x[:3], x[3:], forces(time), wrench)])

    exact = solve_ivp(rate, (0, duration), np.concatenate([pose, HOME]), "DOP853", rtol=1e-12, atol=1e-14)
    options = {"method": method, "controller": lambda measured: forces(measured.time), "wrench": wrench}
    options["integration"] = Integration(rtol=1e-12, atol=1e-14)
    run = robot.simulate(duration, start=pose, **options)
    assert run.finished
    np.testing.assert_allclose(run.pose[-1], exact.y[:3, -1], rtol=0, atol=1e-11 * max(1, size))
    assert np.abs(run.pose[-1] - pose).max() > 1e-3 * size
    lossy = p3dof.load(replace(machine, friction=rough)).simulate(duration, start=pose, **options)
    power = np.sum(lossy.forces * lossy.slider_velocities, axis=1)
    power += np.sum(lossy.wrench[:, (1, 2, 4)] * lossy.velocity, axis=1)
    result = p3dof.load(replace(machine, friction=rough)).inverse_dynamics(
        lossy.motion, method="virtual-power", wrench=lossy.wrench
    )
    scale = np.abs(lossy.forces).max()
    np.testing.assert_allclose(result.forces, lossy.forces, rtol=0, atol=1e-10 * scale)
    energy = model.energy(lossy.pose, lossy.velocity)
    lost = np.trapezoid(power - result.dissipation, lossy.time)
    assert energy[-1] - energy[0] == pytest.approx(lost, abs=1e-5 * np.abs(power).max() * duration)


@pytest.mark.parametrize("method", METHODS)
def test_let_go_at_home_it_falls_freely_to_its_stops(method):
    run = p3dof.load().simulate(1.0, method=method)
    assert not run.finished
    assert run.stop.kind == "slider stop"
    assert run.stop.time == pytest.approx(np.sqrt(2 * 0.2 / 9.806), abs=1e-9)
    assert re.fullmatch("slider [ABC] at its lower end, -0.2 m", run.stop.reason)  # all at once
    assert run.time[-1] == run.stop.time
    np.testing.assert_allclose(run.sliders[-1], -0.2, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.pose[:, 1], -9.806 * run.time**2 / 2, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(run.time[:-1], np.linspace(0, 1, 1001)[: len(run) - 1])
    assert "ended by slider stop at t = 0.201969 s" in repr(run)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("kind", "start", "forces"),
    [
        ("reach limit", InitialState(velocity=[2.0, 0, 0]), None),
        ("reach limit", InitialState(velocity=[-2.0, 0, 0]), None),
        ("singular pose", InitialState([0, 0, 0.5], [0, 0, 10.0]), None),
        ("singular pose", InitialState([0, 0, -2.0], [0, 0, -9.0]), None),
        ("tilt limit", InitialState(velocity=[0, 0, 5.0]), (-0.8, 0.8)),
        ("tilt limit", InitialState(velocity=[0, 0, -5.0]), (-0.8, 0.8)),
    ],
)
def test_what_ends_a_run_is_named(method, kind, start, forces):
    machine = WIDE if forces is None else replace(WIDE, limits=Limits((-5, 5), tilt=forces))
    run = p3dof.load(machine).simulate(2.0, start=start, method=method)
    assert run.stop.kind == kind
    end = run.pose[-1]
    if kind == "singular pose":
        assert abs(p3dof.load(machine).singularity(end).actuation) < 1e-8
    elif kind == "tilt limit":
        assert abs(end[2]) == pytest.approx(0.8, abs=1e-9)
    else:
        drop = np.sqrt(0.4**2 - (0.15 + abs(end[0])) ** 2) / 0.4
        assert drop == pytest.approx(1e-3, rel=1e-4)
        assert f"leg {'A' if end[0] > 0 else 'B'} horizontal" in run.stop.reason
    assert np.isfinite(run.pose).all()


def test_the_first_of_several_limits_ends_the_run():
    machine = replace(WIDE, limits=Limits((-0.05, 5), tilt=(-3, 0.3)))
    run = p3dof.load(machine).simulate(2.0, start=InitialState(velocity=[0, 0, 3.5]), method="virtual-power")
    both = [run.stop.kind]
    both.append(
        p3dof.load(machine)
        .simulate(2.0, start=InitialState(velocity=[0, 0, 2.5]), method="virtual-power")
        .stop.kind
    )
    assert both == ["tilt limit", "slider stop"]


def test_limits_that_do_not_count_are_passed():
    run = p3dof.load().simulate(0.5, method="virtual-power", stop_at=())
    assert run.finished
    assert run.sliders.min() < -1
    # past det J = 0 the motion goes on, though no force could have been found there
    run = p3dof.load(WIDE).simulate(
        0.2, start=InitialState([0, 0, 0.5], [0, 0, 10.0]), method="virtual-power", stop_at=("slider stop",)
    )
    assert run.finished
    assert p3dof.load().singularity(run.pose[-1]).actuation < 0


def test_held_forces_are_those_of_the_last_period():
    times = []

    def controller(measured):
        times.append(measured.time)
        assert measured.period == 0.01
        return hold + 10 * len(times) % 7

    robot = p3dof.load()
    hold = robot.forces(HOME, HOME, HOME)
    run = robot.simulate(
        0.1,
        controller=controller,
        control=ControlLoop(100),
        method="virtual-power",
        samples=np.linspace(0, 0.1, 101),
    )
    np.testing.assert_allclose(times, np.arange(10) * 0.01, rtol=0, atol=1e-15)
    assert len(run) == 101
    for k in range(10):
        assert np.all(run.forces[10 * k : 10 * k + 10] == run.forces[10 * k])
    assert len(np.unique(run.forces[:, 0])) > 5


@pytest.mark.parametrize(
    ("method", "size"),
    [
        *(("virtual-power", size) for size in (1e8, 1e15, 1e20, 1e25)),
        ("pinocchio", 1e8),
        pytest.param("pinocchio", 1e25, marks=pytest.mark.slow),
    ],
)
def test_forces_beyond_all_measure_end_the_run(method, size):
    robot = p3dof.load()
    run = robot.simulate(0.1, controller=[size, -size, size], method=method)
    assert run.stop.kind in {"tilt limit", "slider stop", "accuracy"}
    assert np.isfinite(run.pose).all()
    assert run.time[0] == 0


def test_a_run_without_a_finite_beginning_cannot_start():
    for method in METHODS:
        with pytest.raises(
            DynamicsError, match="the run cannot start: accuracy at t = 0 s: no step is small"
        ):
            p3dof.load().simulate(0.1, controller=lambda _: [1.7e308, 1.7e308, 1.7e308], method=method)


def test_settings_are_few_and_are_named():
    given = inspect.signature(p3dof.Manipulator.simulate).parameters
    _, duration, *settings = given.values()
    assert duration.name == "duration"
    assert len(settings) <= 10
    assert {setting.kind for setting in settings} == {inspect.Parameter.KEYWORD_ONLY}
    assert given["method"].default is None  # in C, where there is a compiled way
    with pytest.raises(AttributeError):
        InitialState().pose = HOME  # what a run was given does not change


def test_a_wrench_may_be_a_function_of_one_time_or_of_many():
    def of_one(time):
        return [0, 0, 50 * time, 0, 0, 0]

    def of_many(times):
        return np.outer(50 * times, [0, 0, 1, 0, 0, 0])

    runs = [p3dof.load().simulate(0.05, wrench=load, samples=11) for load in (of_one, of_many)]
    np.testing.assert_allclose(runs[0].wrench[:, 2], 50 * runs[0].time, rtol=1e-15)
    np.testing.assert_array_equal(runs[1].wrench, runs[0].wrench)
    np.testing.assert_array_equal(runs[1].pose, runs[0].pose)
    assert runs[0].method == "compiled"  # by default, if not in C
    assert "the wrench is a function of Python" in runs[0].note


LIFT = np.array([0, 0, 100.0, 0, 0, 0])


def triangle(width):
    """A push upwards of 100 N at t = 1 s."""
    return p3dof.WrenchHistory([0, 1, 1 + width / 2, 1 + width, 9], np.outer([0, 0, 1, 0, 0], LIFT))


@pytest.fixture(scope="module")
def push(request):
    """How long a push is, and the velocity after it: in steps so short that none can be missed."""
    robot, width = p3dof.load(WIDE), request.param
    options = {"controller": robot.forces(HOME, HOME, HOME), "samples": [1.0, 1 + width]}
    options["integration"] = Integration(max_step=2e-4)
    run = robot.simulate(1 + width, wrench=triangle(width), method="compiled", **options)
    return width, run.velocity[-1]


@pytest.mark.parametrize(
    ("method", "push"),
    [
        ("virtual-power", 0.002),
        pytest.param("virtual-power", 0.01, marks=pytest.mark.slow),
        pytest.param("virtual-power", 0.05, marks=pytest.mark.slow),
        ("pinocchio", 0.01),
    ],
    indirect=["push"],
)
def test_a_short_push_is_felt_where_nothing_else_happens(method, push):
    """At rest steps could be as long as the run: a triangle of 100 N gives its impulse all the same."""
    robot, (width, exact) = p3dof.load(WIDE), push
    hold = robot.forces(HOME, HOME, HOME)
    wrench = triangle(width)
    gain = np.linalg.inv(robot.mass_matrix(HOME))[1, 1]
    pushed = (np.linalg.inv(robot.mass_matrix(HOME)) @ robot.jacobian(HOME).T @ np.full(3, 20.0))[1]
    options = {"controller": hold, "method": method, "samples": [1.0, 1 + width]}
    for load in (wrench, wrench.__call__):  # a history, and a function that nothing is known of
        run = robot.simulate(1 + width, wrench=load, **options)
        assert run.velocity[-1, 1] == pytest.approx(100 * width / 2 * gain, rel=0.02)
        np.testing.assert_allclose(run.velocity[-1], exact, rtol=0, atol=1e-7)
    run = robot.simulate(
        1 + width, controller=lambda m: hold + 20.0 * (1 < m.time < 1 + width), method=method, samples=2
    )
    assert run.velocity[-1, 1] == pytest.approx(pushed * width, rel=0.05)


@pytest.mark.parametrize(
    ("frequency", "rtol"),
    [
        pytest.param(10, 1e-9, marks=pytest.mark.slow),
        pytest.param(68, 1e-5, marks=pytest.mark.slow),
        (152, 1e-3),
    ],
)
def test_a_limit_passed_within_a_step_is_seen(frequency, rtol):
    robot = p3dof.load()
    hold = robot.forces(HOME, HOME, HOME)
    springs = Springs(4.0 * (2 * np.pi * frequency) ** 2, preload=hold)
    options = {"start": InitialState(velocity=[0.3, 0.1, 0.5]), "controller": springs}
    options |= {"method": "virtual-power", "integration": Integration(rtol=rtol)}
    free = robot.simulate(0.2, samples=20001, **options)
    assert free.finished
    peak = free.sliders[:, 1].max()
    for share in (0.5, 0.9, 0.99, 0.999):
        limits = Limits((-0.2, share * peak), tilt=(-1, 1))
        run = p3dof.load(replace(PAPER, limits=limits)).simulate(0.2, samples=2, **options)
        assert run.stop is not None
        assert run.sliders[-1, 1] == pytest.approx(share * peak, abs=1e-9)
        first = free.time[np.argmax(free.sliders[:, 1] >= share * peak)]
        assert run.stop.time == pytest.approx(first, abs=2e-5)


@pytest.mark.parametrize(
    ("rate", "duration", "samples"), [(30, 0.3, 46), (700, 0.23, 162), (1000, 0.23, 1151)]
)
def test_a_sample_at_a_tick_has_the_forces_that_begin_there(rate, duration, samples):
    hold = p3dof.load().forces(HOME, HOME, HOME)
    run = p3dof.load().simulate(
        duration,
        controller=lambda m: hold + round(m.time * rate) % 7,
        control=ControlLoop(rate),
        method="virtual-power",
        samples=samples,
    )
    tick = np.minimum(np.floor(run.time * rate + 1e-6), np.ceil(duration * rate - 1e-6) - 1)
    np.testing.assert_allclose(run.forces[:, 0] - hold[0], tick % 7, rtol=0, atol=1e-12)


def test_a_controller_may_fill_the_same_array_again():
    held = np.zeros(3)
    hold = p3dof.load().forces(HOME, HOME, HOME)

    def controller(measured):
        held[:] = hold + measured.time
        return held

    run = p3dof.load().simulate(
        0.1, controller=controller, control=ControlLoop(100), method="virtual-power", samples=11
    )
    np.testing.assert_array_equal(run.asked, run.forces)
    assert len(np.unique(run.asked[:, 0])) == 10


def test_both_ways_count_whole_turns_of_the_platform():
    machine = p3dof.load(replace(PAPER, limits=Limits((-50, 50), tilt=(-20, 20))))
    runs = [
        machine.simulate(0.5, start=InitialState(velocity=[0, 0, -9]), method=method, stop_at=())
        for method in METHODS
    ]
    assert runs[0].pose[-1, 2] < -np.pi
    np.testing.assert_allclose(runs[1].pose, runs[0].pose, rtol=0, atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("start", [([0, 0, 0.3], [2.0, 0, 0]), ([0, 0, 0.1], [-2.0, 1.0, 0.5])])
def test_a_continuous_controller_is_not_asked_beyond_a_limit(method, start):
    hold = p3dof.load().forces(HOME, HOME, HOME)
    run = p3dof.load(WIDE).simulate(
        0.5,
        start=InitialState(*start),
        controller=lambda measured: (measured.pose, measured.velocity, hold)[2],
        method=method,
    )
    assert run.stop.kind == "reach limit"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"controller": p3dof.runs.PD}, InputError, "controller: expected an object, got the class PD"),
        ({"stop_at": "slider stop"}, InputError, "stop_at: expected a list of slider stop"),
        ({"stop_at": None}, InputError, "stop_at: expected a list of slider stop"),
        ({"progress": 5}, InputError, "progress: expected a function, got 5"),
        ({"integration": {"rtol": 1e-20}}, InputError, "rtol: expected at least 2.3e-14, got 1e-20"),
        ({"integration": {"max_step": 0}}, InputError, "max_step: expected a positive number, got 0"),
        (
            {"integration": {"stabilisation": 1e4}, "method": "pinocchio"},
            InputError,
            "stabilisation: expected 0 to 1000 1/s",
        ),
        ({"wrench": lambda _: 1 / 0}, InputError, "wrench at t = 0 s: division by zero"),
    ],
)
def test_more_bad_input(arguments, error, message):
    with pytest.raises(error, match=message):
        p3dof.load().simulate(0.1, **grouped(arguments))


def test_a_controller_that_cannot_be_reset():
    class Broken:
        def reset(self):
            raise ValueError("worn out")

        def __call__(self, _):
            return HOME

    with pytest.raises(ControllerError, match="the controller failed to reset: worn out"):
        p3dof.load().simulate(0.1, controller=Broken(), method="virtual-power")


@pytest.mark.parametrize("method", METHODS)
def test_holding_a_constant_force_changes_nothing(method):
    robot = p3dof.load()
    forces = robot.forces(HOME, HOME, HOME) + np.array([3, -2, 1])
    free = robot.simulate(0.2, controller=forces, method=method, samples=21)
    held = robot.simulate(0.2, controller=forces, control=ControlLoop(333), method=method, samples=21)
    np.testing.assert_allclose(held.pose, free.pose, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(held.time, free.time)


def test_joints_may_be_the_start_and_open_loops_are_refused_with_their_gap():
    robot = p3dof.load()
    state = robot.loop.complete(robot.inverse_kinematics([0.01, 0.02, 0.1]).sliders, [0.1, 0, 0], np.zeros(3))
    pose, velocity = ([0.01, 0.02, 0.1], np.linalg.solve(robot.jacobian([0.01, 0.02, 0.1]), [0.1, 0, 0]))
    forces = robot.forces(pose, HOME, HOME)
    first = robot.simulate(
        0.05, start=InitialState(joints=(state.q, state.v)), controller=forces, method="pinocchio"
    )
    second = robot.simulate(
        0.05, start=InitialState(pose, velocity), controller=forces, method="virtual-power"
    )
    np.testing.assert_allclose(first.pose, second.pose, rtol=0, atol=1e-10)
    q = state.q.copy()
    q[1] += 1e-3
    with pytest.raises(InputError, match=r"q: the loops are open by 0\.0004 m, expected at most 1e-09 m"):
        robot.simulate(0.05, start=InitialState(joints=(q, state.v)), method="pinocchio")
    with pytest.raises(InputError, match=r"v: opens the loops at 0.0917 m/s"):
        robot.simulate(0.05, start=InitialState(joints=(state.q, np.eye(10)[0] * 0.1)), method="pinocchio")
    with pytest.raises(InputError, match=r"q: expected shape \(10,\), got \(3,\)"):
        robot.simulate(0.05, start=InitialState(joints=(np.zeros(3), np.zeros(10))), method="pinocchio")
    with pytest.raises(InputError, match="joints: expected a tuple of joint positions and velocities"):
        robot.simulate(0.05, start=InitialState(joints=np.zeros(20)), method="pinocchio")
    with pytest.raises(InputError, match="joints: the minimal coordinates have none"):
        robot.simulate(0.05, start=InitialState(joints=(state.q, state.v)), method="virtual-power")


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"duration": 0}, InputError, "duration: expected a positive number, got 0"),
        ({"duration": -1}, InputError, "duration: expected a positive number, got -1"),
        ({"duration": np.nan}, InputError, "duration: expected a finite number, got nan"),
        ({"duration": "long"}, InputError, "duration: expected real numbers, got 'long'"),
        ({"start": {"pose": [0, 0]}}, InputError, r"pose: expected shape \(3,\), got \(2,\)"),
        ({"start": [1, 0, 0]}, ReachError, "out of reach: leg A is too short"),
        ({"start": [0, 0.3, 0]}, InputError, "beyond a limit: slider stop: slider A at its upper end, 0.2 m"),
        ({"start": [0, 0, 0.9]}, InputError, "beyond a limit: tilt limit"),
        (
            {"start": {"velocity": [0, np.nan, 0]}},
            InputError,
            r"velocity: expected finite numbers, got nan at index \[1\]",
        ),
        ({"controller": [1, 2]}, InputError, r"controller: expected shape \(3,\), got \(2,\)"),
        ({"controller": [1, 2, np.nan]}, InputError, "controller: expected finite numbers"),
        ({"controller": "strong"}, InputError, "controller: expected one, .* got 'strong'"),
        (
            {"method": "magic"},
            InputError,
            "method: expected one of 'pinocchio', 'virtual-power', 'compiled', got 'magic'",
        ),
        ({"control": {"rate": 0}}, InputError, "rate: expected a positive number, got 0"),
        (
            {"control": {"rate": 1e12}},
            InputError,
            r"^the run would take about \d+ days \(\S+ steps\), the limit is 60 minutes: .*by time_limit$",
        ),
        (
            {"control": {"saturation": -1}},
            InputError,
            "saturation: expected True, False, or one positive force, or one an actuator, got -1",
        ),
        ({"control": {"saturation": [1, 2]}}, InputError, "saturation: expected one force or 3, got 2"),
        ({"control": {"noise": 0.1, "rate": 100}}, InputError, "noise: expected a Noise, got 0.1"),
        ({"control": {"noise": p3dof.runs.Noise()}}, InputError, "noise: needs a control rate"),
        ({"wrench": [1, 2, 3]}, InputError, r"wrench: expected shape \(6,\), got \(3,\)"),
        ({"wrench": lambda _: [1, 2]}, InputError, r"wrench at t = 0 s: expected shape \(6,\)"),
        ({"samples": 1}, p3dof.errors.MotionError, "samples: expected a whole number from 2"),
        ({"samples": [0, 0.5, 0.4]}, InputError, "samples: expected rising times from 0 to 0.1 s"),
        ({"stop_at": ["collision"]}, InputError, "stop_at: expected a list of slider stop, tilt limit"),
        ({"integration": {"rtol": 0}}, InputError, "rtol: expected a positive number, got 0"),
        ({"integration": {"atol": -1}}, InputError, "atol: expected a positive number, got -1"),
        ({"integration": {"stabilisation": -1}}, InputError, "stabilisation: expected 0 to 1000 1/s, got -1"),
        ({"integration": {"time_limit": 0}}, InputError, "time_limit: expected a positive number, got 0"),
        ({"integration": 1e-9}, InputError, r"integration: expected Integration\(...\), got 1e-09"),
        ({"control": 1000}, InputError, r"control: expected ControlLoop\(...\), got 1000"),
        ({"start": "home"}, InputError, "pose: expected real numbers, got 'home'"),
        (
            {"start": {"pose": [0, 0, 0.1], "joints": (np.zeros(10), np.zeros(10))}},
            InputError,
            "joints: they determine the pose of the platform; give them without pose and velocity",
        ),
    ],
)
def test_bad_input_is_one_clear_error(arguments, error, message):
    with pytest.raises(error, match=message):
        p3dof.load().simulate(**{"duration": 0.1, **grouped(arguments)})


@pytest.mark.parametrize(("method", "rate"), [("virtual-power", None), ("pinocchio", 100.0)])
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda: np.zeros(2), r"controller: expected forces of shape \(3,\), got \(2,\)"),
        (lambda: [0, 0, np.inf], r"controller: expected finite forces, got \[0.0, 0.0, inf\]"),
        (lambda: None, "controller: expected real numbers, got None"),
        (lambda: 1 / 0, "division by zero"),
        (lambda: {}["gain"], "'gain'"),
    ],
)
def test_a_controller_that_fails_says_when_and_keeps_the_run(method, rate, answer, message):
    robot = p3dof.load()
    hold = robot.forces(HOME, HOME, HOME)

    def controller(measured):
        return hold if measured.time < 0.05 else answer()

    with pytest.raises(
        ControllerError, match=rf"the controller failed at t = 0\.0\d* s: {message}"
    ) as caught:
        robot.simulate(0.1, controller=controller, control=ControlLoop(rate), method=method)
    error = caught.value
    assert error.__cause__ is not None
    assert 0.05 <= error.time < 0.1
    if rate:
        assert error.time == pytest.approx(0.05)
        assert error.run.time[-1] == pytest.approx(0.049, abs=2e-3)
        np.testing.assert_allclose(error.run.pose, 0, rtol=0, atol=1e-9)
    assert not error.run.finished
    assert error.run.stop.kind == "controller"
    assert error.run.stop.time == error.time


def test_an_interrupt_goes_through():
    def controller(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        p3dof.load().simulate(0.1, controller=controller, method="virtual-power")


def test_progress_is_told():
    told = []
    p3dof.load().simulate(
        0.1, method="virtual-power", samples=11, progress=lambda done, total: told.append((done, total))
    )
    assert told == [(i, 11) for i in range(1, 12)]


def test_files_hold_the_run(tmp_path):
    robot = p3dof.load()
    motion = p3dof.paper_motion(101).from_rest(0.2)
    run = robot.simulate(
        0.1,
        controller=p3dof.runs.PD(robot, motion),
        control=ControlLoop(200),
        method="virtual-power",
        samples=21,
    )
    table = np.genfromtxt(run.save(tmp_path / "run.csv"), delimiter=",", names=True)
    assert len(table) == 21
    np.testing.assert_array_equal(table["t_s"], run.time)
    header = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert header.startswith("t [s],y [m],z [m],theta [rad],ydot [m/s]")
    assert header.endswith("reference y [m],reference z [m],reference theta [rad],closure_error [m]")
    with np.load(run.save(tmp_path / "run.npz")) as arrays:
        for name in ("time", "pose", "velocity", "acceleration", "forces", "asked", "sliders", "reference"):
            np.testing.assert_array_equal(arrays[name], getattr(run, name))
        np.testing.assert_array_equal(arrays["q"], run.joints.q)
        assert arrays["joint_names"].tolist() == list(run.joints.names)
    again = p3dof.Simulation.load(tmp_path / "run.npz")
    assert again.finished
    for name, column in run.to_columns().items():
        np.testing.assert_array_equal(again.to_columns()[name], column)
    np.testing.assert_array_equal(again.joints.q, run.joints.q)
    stopped = robot.simulate(1.0, method="virtual-power")
    stopped.save(tmp_path / "stopped.npz")
    assert p3dof.Simulation.load(tmp_path / "stopped.npz").stop == stopped.stop
    (tmp_path / "bad.npz").write_bytes(b"PK not really")
    np.savez(tmp_path / "other.npz", time=[1, 2])
    for name in ("bad.npz", "other.npz", "run.csv", "nowhere.npz"):
        with pytest.raises(FileError, match=f"{name}: expected a run saved as .npz"):
            p3dof.Simulation.load(tmp_path / name)
    with pytest.raises(FileError, match="expected the path of a file, got 5"):
        run.save(5)
    with pytest.raises(
        InputError, match=re.escape("run.xlsx: expected a file name that ends in .csv or .npz")
    ):
        run.save(tmp_path / "run.xlsx")
    with pytest.raises(FileError):
        run.save(tmp_path / "run.csv" / "inside.csv")
    other = p3dof.paper_motion(11)
    followed = robot.simulate(
        0.01, controller=p3dof.runs.PD(robot, motion), reference=other, method="virtual-power", samples=2
    )
    np.testing.assert_allclose(followed.reference, other.resampled([0, 0.01]).pose, rtol=0, atol=1e-14)
    with pytest.raises(InputError, match="motion: expected a Motion, got 3"):
        robot.simulate(0.01, reference=3, method="virtual-power")
    with pytest.raises(InputError, match="error: the run had no motion to follow"):
        _ = robot.simulate(0.01, method="virtual-power").error


def test_friction_brings_it_to_rest():
    rough = replace(PAPER, friction=Friction({"sliders": 100.0, "joints": 0.5}))
    robot = p3dof.load(rough)
    springs = Springs(2000.0, preload=robot.forces(HOME, HOME, HOME))
    run = robot.simulate(5, start=[0.02, 0.03, 0.15], controller=springs, method="virtual-power")
    np.testing.assert_allclose(run.pose[-1], 0, atol=1e-6)
    assert np.abs(run.velocity[-1]).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
def test_a_run_is_bounded_before_it_starts(method):
    """By what it will take, not by a number of holds; what grows with each argument is refused at once."""
    robot = p3dof.load()
    for slip in (
        {"duration": 1e9},
        {"duration": 10, "control": ControlLoop(1e9)},
        {"duration": 10, "integration": Integration(max_step=1e-9)},
        {"duration": 1e6, "controller": lambda _: [0, 0, 0]},
        {"duration": 10, "samples": 2_000_000},
    ):
        with pytest.raises(InputError, match=r"^the run would take about|^samples: expected at most 1000000"):
            robot.simulate(**slip, method=method)
    with pytest.raises(InputError, match=r"about .* steps.*limit is 0.001 s"):
        robot.simulate(
            0.1, control=ControlLoop(1000), method=method, integration=Integration(time_limit=1e-3)
        )
    robot.simulate(
        0.002, start=[0, 0, 0], controller=[1, 1, 1], control=ControlLoop(1000), method=method, samples=2
    )


def test_the_estimate_is_near_the_truth():
    """Within a factor of twenty, on any machine of these years: enough to tell a minute from a day."""
    robot = p3dof.load()
    compiled = "compiled" if robot.kernels.level == "numpy" else "C"
    for method, pace in (*zip(METHODS, METHODS, strict=True), ("compiled", compiled)):
        robot.simulate(0.002, control=ControlLoop(1000), method=method, samples=2)
        took = []
        for _ in range(3):
            begun = time.process_time()
            run = robot.simulate(0.05, control=ControlLoop(1000), method=method, samples=51)
            took.append(time.process_time() - begun)
        expected = estimate(pace, 0.05, 51, 1000)
        assert expected.steps == 50
        assert 1 / 20 < expected.seconds / min(took) < 20
        assert run.evaluations <= 20 * expected.steps
