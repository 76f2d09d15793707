"""A wrench over time: a function of one time and one of many serve wherever a wrench is taken."""

import math

import numpy as np
import pytest

import p3dof
from p3dof.machine.motion import Load
from p3dof.methods import METHODS

TIMES = np.linspace(0, 2, 6)  # as many times as a wrench has components: what fits both must not be mixed up
MOTION = p3dof.Motion.rest_to_rest([0, 0, 0], [0.05, 0.02, 0.1], 2.0, samples=6)
FORCE, MOMENT = np.eye(6)[[2, 4]]


def expected(times):
    rows = np.zeros((len(times), 6))
    rows[:, 2], rows[:, 4] = 50 * np.sin(times), times
    return rows


def branching(t):
    return [0, 0, 50 * math.sin(t) if t > 0 else 0.0, 0, t, 0]


def of_many(t):
    if np.ndim(t) != 1:
        raise TypeError("an array of times, please")
    return expected(t)


FUNCTIONS = {
    "numbers of one time": lambda t: [0, 0, 50 * math.sin(t), 0, t, 0],
    "numbers or a ragged list": lambda t: [0, 0, 50 * np.sin(t), 0, t, 0],
    "numbers or components by rows": lambda t: [0 * t, 0 * t, 50 * np.sin(t), 0 * t, t, 0 * t],
    "an array of one time": lambda t: np.array([0, 0, 50 * np.sin(t), 0, t, 0]),
    "a question about one time": branching,
    "many times": of_many,
    "many times, or one as a row": lambda t: (
        np.outer(50 * np.sin(t), np.eye(6)[2]) + np.outer(t, np.eye(6)[4])
    ),
    "any times": lambda t: np.stack([0 * t, 0 * t, 50 * np.sin(t), 0 * t, t, 0 * t], axis=-1),
    "a history": p3dof.WrenchHistory(np.linspace(0, 2, 21), expected(np.linspace(0, 2, 21))),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("count", [0, 1, 2, 5, 6, 7])
def test_a_function_of_one_time_or_of_many(name, count):
    times = np.arange(count) / 10  # rows of the history
    np.testing.assert_allclose(Load(FUNCTIONS[name]).over(times), expected(times), rtol=0, atol=1e-13)
    for time in times:
        np.testing.assert_allclose(
            Load(FUNCTIONS[name]).at(float(time)), expected([time])[0], rtol=0, atol=1e-13
        )


def test_one_load_serves_both_in_any_order():
    for function in FUNCTIONS.values():
        load = Load(function)
        for _ in range(2):
            np.testing.assert_allclose(load.at(0.3), expected([0.3])[0], rtol=0, atol=1e-13)
            np.testing.assert_allclose(load.over(TIMES[:1]), expected(TIMES[:1]), rtol=0, atol=1e-13)


def test_a_history_keeps_its_first_and_its_last_values():
    """Before the first sample, at it, half-way, at the last, after it; in a single run as well."""
    first, last = np.arange(1.0, 7), np.arange(-3.0, 3)
    history = p3dof.WrenchHistory([0.5, 1.5], [first, last])
    rows = [first, first, (first + last) / 2, last, last]
    np.testing.assert_array_equal(history([-9.0, 0.5, 1.0, 1.5, 7.0]), rows)
    np.testing.assert_array_equal(Load(history).over(np.array([0.0, 0.25])), [first, first])
    robot = p3dof.load()
    given = {"motion": p3dof.Motion([0, 0.2, 0.4], np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)))}
    held = [
        robot.inverse_dynamics(**given, wrench=load).forces for load in (history(given["motion"].time), first)
    ]
    np.testing.assert_array_equal(*held)
    assert np.abs(held[0] - robot.inverse_dynamics(**given).forces).max() > 1


@pytest.mark.parametrize("method", ["compiled", "virtual-power"])
def test_a_run_before_the_first_sample_of_a_history_has_its_first_load(method):
    """In C and in Python: the same as under that load all the time."""
    robot, first = p3dof.load(), np.array([0, 30.0, 20, 0, 3, 0])
    history = p3dof.WrenchHistory([0.5, 1.5], [first, -first])
    runs = [robot.simulate(0.05, samples=6, method=method, wrench=load) for load in (history, first, None)]
    np.testing.assert_allclose(runs[0].pose, runs[1].pose, rtol=0, atol=1e-12)
    assert np.abs(runs[0].pose - runs[2].pose).max() > 1e-3


def test_what_stays_and_what_is_given_row_by_row():
    wrench = [1.0, 2, 3, 4, 5, 6]
    for given in (wrench, lambda _: wrench):
        np.testing.assert_array_equal(Load(given).over(TIMES), np.tile(wrench, (6, 1)))
        np.testing.assert_array_equal(Load(given).at(0.7), wrench)
    np.testing.assert_array_equal(Load().over(TIMES), np.zeros((6, 6)))
    np.testing.assert_array_equal(Load().at(1.0), np.zeros(6))
    table = np.arange(36.0).reshape(6, 6)
    np.testing.assert_array_equal(Load(table).over(TIMES), table)


@pytest.mark.parametrize("method", METHODS)
def test_every_calculation_takes_either(method):
    robot, motion = p3dof.load(), p3dof.paper_motion(6)
    known = robot.inverse_dynamics(motion, method=method, wrench=expected(motion.time)).forces
    for name in ("numbers or components by rows", "a question about one time", "many times"):
        found = robot.inverse_dynamics(motion, method=method, wrench=FUNCTIONS[name])
        np.testing.assert_array_equal(found.forces, known)


def test_derivatives_reactions_and_comparison_take_either():
    robot, motion = p3dof.load(), p3dof.paper_motion(7)
    table, function = expected(motion.time), FUNCTIONS["a question about one time"]
    for calculate in (
        lambda wrench: robot.inverse_dynamics_derivatives(motion, wrench=wrench).forces,
        lambda wrench: robot.reactions(motion, "paper", wrench=wrench).forces,
        lambda wrench: robot.compare(motion, wrench=wrench).first.forces,
        lambda wrench: (
            robot.refined(
                motion, wrench=p3dof.WrenchHistory(motion.time, wrench) if wrench is table else wrench
            ).time
        ),
    ):
        np.testing.assert_array_equal(calculate(function), calculate(table))


@pytest.mark.parametrize(
    ("wrench", "message"),
    [
        (lambda _: [1, 2], r"wrench at t = 0 s: expected shape \(6,\), or \(N, 6\) for N times, got \(2,\)"),
        (lambda _: "six", "wrench at t = 0 s: expected real numbers, got 'six'"),
        (lambda t: 1 / 0 if t == 0 else [0] * 6, "wrench at t = 0 s: division by zero"),
        (lambda t: [0] * 6 if t < 0.5 else {}["missing"], "wrench at t = 0.8 s: 'missing'"),
        (lambda t: [0, 0, np.nan if t > 1 else 0, 0, 0, 0], r"wrench: expected finite numbers.*sample 3"),
        (np.zeros((4, 6)), r"wrench: expected shape \(6, 6\) or \(6,\), got \(4, 6\)"),
    ],
)
def test_a_wrench_that_is_none(wrench, message):
    with pytest.raises(p3dof.InputError, match=message):
        p3dof.load().inverse_dynamics(MOTION, wrench=wrench, method="compiled")


def test_a_wrench_that_is_none_at_one_time():
    with pytest.raises(p3dof.InputError, match=r"wrench: expected shape \(6,\), got \(4, 6\)"):
        Load(np.zeros((4, 6))).at(0.0)
    with pytest.raises(p3dof.InputError, match=r"wrench at t = 2 s: expected finite numbers"):
        Load(lambda _: [np.inf] * 6).at(2.0)


def test_engines_take_either():
    pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    engine, motion = p3dof.methods.engines.load("mujoco"), MOTION
    known = engine.forces(motion, expected(motion.time))
    for name in ("a question about one time", "many times", "numbers or components by rows"):
        np.testing.assert_array_equal(engine.forces(motion, FUNCTIONS[name]), known)


@pytest.mark.parametrize("name", ["a question about one time", "many times", "numbers or components by rows"])
def test_runs_in_time_take_either(name):
    robot = p3dof.load()
    hold = robot.forces(np.zeros(3), np.zeros(3), np.zeros(3))
    run = robot.simulate(0.05, controller=hold, wrench=FUNCTIONS[name], samples=6, method="compiled")
    np.testing.assert_allclose(run.wrench, expected(run.time), rtol=0, atol=1e-13)


def test_a_function_of_many_times_is_asked_once():
    asked = []
    Load(lambda t: (asked.append(np.shape(t)), expected(t))[1]).over(np.linspace(0, 1, 100))
    assert asked == [(100,)]
