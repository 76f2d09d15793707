"""States of the platform are checked once, and the mechanism's configuration is computed once or twice."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import p3dof
from p3dof._base.errors import InputError
from p3dof.closed_form.kinematics import validity as gate
from p3dof.closed_form.paper import formulas
from p3dof.machine.motion import States, states_of, states_over
from p3dof.machine.parameters import PAPER, Friction
from p3dof.methods import METHODS

HOME = np.zeros(3)
ROUGH = replace(PAPER, friction=Friction(viscous={"sliders": 1.0}, coulomb={"joints": 0.01}))
MOTION = p3dof.paper_motion(60)
WRENCH = np.array([3.0, 40.0, -30.0, 1.0, 2.0, 5.0])


@pytest.fixture
def counted(monkeypatch):
    """How often states are looked at, and at how many samples the configuration is computed."""
    count = Counter()
    look, configuration = States.finite, formulas.configuration

    def finite(self):
        count["looked at"] += 1
        return look(self)

    def computed(lengths, pose, xp):
        count["configurations"] += np.size(pose[0])
        return configuration(lengths, pose, xp)

    monkeypatch.setattr(States, "finite", finite)
    for name, module in list(sys.modules.items()):
        if name.startswith("p3dof") and getattr(module, "configuration", None) is configuration:
            monkeypatch.setattr(module, "configuration", computed)
    return count


def ask(method, count):
    """Solve a motion; how often its states were looked at, and configurations computed for a sample."""
    robot = p3dof.load(ROUGH)
    robot.inverse_dynamics(MOTION, wrench=WRENCH, method=method)
    count.clear()  # a machine's formulas are traced when they are first used
    robot.inverse_dynamics(MOTION, wrench=WRENCH, method=method)
    return count["looked at"], count["configurations"] / len(MOTION)


@pytest.mark.parametrize(
    ("method", "looks", "configurations"),
    [("pinocchio", 1, 0), ("virtual-power", 1, 2), ("compiled", 0, 0)],  # kernels look for themselves
)
def test_states_are_looked_at_once_and_configured_twice_at_most(counted, method, looks, configurations):
    assert ask(method, counted) == (looks, configurations)


def test_every_method_is_counted():
    assert set(METHODS) == {"pinocchio", "virtual-power", "compiled"}


@pytest.mark.parametrize("method", METHODS)
def test_a_second_look_would_be_noticed(counted, monkeypatch, method):
    """The counting test can fail: with a gate that looks again, it counts one more, and a configuration."""
    way = type(METHODS[method](p3dof.load(ROUGH)))
    real = way.solve

    def careful(self, states, progress=None):
        gate.holdable(ROUGH.geometry, states)
        return real(self, states, progress)

    looks, before = ask(method, counted)
    monkeypatch.setattr(way, "solve", careful)
    assert ask(method, counted) == (looks + 1, before + 1)


@pytest.mark.parametrize("method", METHODS)
def test_wrenches_are_checked_once(monkeypatch, method):
    seen = []
    real = np.isfinite

    def isfinite(array, *rest, **named):
        if np.shape(array)[-1:] == (6,):
            seen.append(np.shape(array))
        return real(array, *rest, **named)

    robot = p3dof.load()
    monkeypatch.setattr(np, "isfinite", isfinite)
    robot.inverse_dynamics(MOTION, wrench=WRENCH, method=method)
    assert seen == [(60, 6)]


def test_states_have_one_shape():
    states = states_of(np.ones((2, 5, 3)), [0, 0, 1], np.zeros((5, 3)), wrench=WRENCH)
    assert states.shape == (2, 5)
    for array in states[:4]:
        assert array.shape == (2, 5, 3)
    assert states.wrench.shape == (2, 5, 6)
    rows = states.rows()
    assert (rows.shape, rows.velocity.shape, rows.wrench.shape) == ((10,), (10, 3), (10, 6))
    assert rows.rows() is rows
    some = states.of_rows(np.array([1, 7]), "nan")
    assert (some.shape, some.on_invalid) == ((2,), "nan")
    np.testing.assert_array_equal(some.wrench, [WRENCH, WRENCH])


def test_states_are_plain_and_cannot_be_exchanged():
    states = states_of(HOME)
    assert states.finite() is states
    np.testing.assert_array_equal(states.velocity, HOME)
    with pytest.raises(AttributeError):
        states.pose = HOME
    with pytest.raises(ValueError, match="read-only"):
        states.velocity[0] = 1


def test_what_is_not_finite_is_told_or_left_out():
    pose, velocity = np.zeros((4, 3)), np.zeros((4, 3))
    pose[1, 2], velocity[3, 0] = np.nan, np.inf
    states = states_of(pose, velocity, HOME, on_invalid="nan").finite()
    for array in (states.pose, states.velocity, states.acceleration):
        np.testing.assert_array_equal(np.isnan(array).all(axis=1), [False, True, False, True])
        assert np.isfinite(array[[0, 2]]).all()
    with pytest.raises(
        InputError, match=r"pose: expected finite numbers.*sample 1, the first of 1 such of 4"
    ):
        states_of(pose, velocity, HOME).finite()
    with pytest.raises(InputError, match=r"velocity: expected finite numbers.*sample 3"):
        states_of(HOME, velocity, HOME).finite()
    with pytest.raises(InputError, match="forces: expected finite numbers"):
        states_of(HOME, HOME, forces=[np.nan, 0, 0]).finite()


def test_what_overflows_is_told_with_the_largest_that_was_given():
    nan = np.array([[0.0, 0, 0], [np.nan, 0, 0]])
    states = states_of([HOME, HOME], [[3e200, 0, 0], [1, -2e200, 0]], wrench=[1e190] * 6)
    states.raise_overflow("forces", np.zeros((2, 3)))
    told = r"^forces: expected finite numbers, got \[nan, 0.0, 0.0\] from {} \(sample 1, the first of 1 such"
    with pytest.raises(InputError, match=told.format(r"velocity \[1.0, -2e\+200, 0.0\]")):
        states.raise_overflow("forces", nan)
    states = states_of([HOME, HOME], [HOME, HOME], wrench=[[0] * 6, [0, 1e300, 0, 0, 0, 0]])
    with pytest.raises(InputError, match=told.format(r"wrench \[0.0, 1e\+300, 0.0, 0.0, 0.0, 0.0\]")):
        states.raise_overflow("forces", nan)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda: states_of([0, 0]), r"pose: expected shape \(..., 3\), got \(2,\)"),
        (lambda: states_of(HOME, "fast"), "velocity: expected real numbers, got 'fast'"),
        (lambda: states_of(HOME, HOME, forces=[1]), r"forces: expected shape \(..., 3\), got \(1,\)"),
        (
            lambda: states_of(np.zeros((2, 3)), np.zeros((3, 3)), HOME),
            r"pose, velocity, acceleration: expected shapes that fit .*, got \(2, 3\), \(3, 3\), \(3,\)",
        ),
        (
            lambda: states_of(np.zeros((2, 3)), HOME, forces=np.zeros((3, 3))),
            r"pose, velocity, forces: expected shapes that fit each other, got \(2, 3\), \(3,\), \(3, 3\)",
        ),
        (lambda: states_of(HOME, on_invalid="skip"), "on_invalid: expected 'raise' or 'nan', got 'skip'"),
        (lambda: states_of(HOME, wrench=[1, 2]), r"wrench: expected shape \(..., 6\), got \(2,\)"),
        (lambda: states_of(HOME, wrench=[np.inf] * 6), "wrench: expected finite numbers"),
        (lambda: states_over(HOME), "motion: expected a Motion, got a ndarray"),
    ],
)
def test_what_are_no_states(given, message):
    with pytest.raises(InputError, match=message):
        given()
