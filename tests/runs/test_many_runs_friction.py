"""Many runs of machines with friction: in lanes, each that of `simulate`, and none depends on another."""

from dataclasses import replace

import numpy as np
import pytest

import p3dof
from p3dof import PAPER
from p3dof.closed_form.compiled import levels
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers
from p3dof.machine.parameters import Body, Friction
from p3dof.runs import (
    KINDS,
    PD,
    ComputedTorque,
    ControlLoop,
    Feedforward,
    InitialState,
    Integration,
    Noise,
    Springs,
)
from p3dof.runs.many.many import EQUAL_STEPS, _task
from p3dof.runs.many.plan import CAREFULLY, decay_rates, parts_of_steps

MOTION = p3dof.paper_motion(1001).from_rest(0.2)
PRECISE = Integration(rtol=1e-12, atol=1e-14)
AT_1_KHZ = ControlLoop(1000)
FIGURES = ("stop", "time", "pose", "velocity", "peak_error", "rms_error", "peak_force", "rms_force", "work")
VISCOUS = {"sliders": 5.0, "joints": 0.05}
COULOMB = {"sliders": 2.0, "joints": 0.02}
FRICTIONS = {  # and how far RK4 in steps of its time constant may be off [m, rad]
    "viscous": (Friction(VISCOUS), 2e-11),
    "smooth": (Friction(VISCOUS, COULOMB, smoothing=0.05), 5e-9),
    "steep": (Friction(VISCOUS, COULOMB), 2e-8),
}

compiled = pytest.mark.skipif(len(levels()) == 1, reason="needs the extension")


def robot(friction):
    return p3dof.load(replace(PAPER, friction=friction))


def columns(count, seed=0):
    rng = np.random.default_rng(seed)
    y, z, theta = MOTION.pose[0]
    return {
        "start.y": y + rng.normal(0, 1e-3, count),
        "start.z": z + rng.normal(0, 1e-3, count),
        "start.theta": theta + rng.normal(0, 1e-3, count),
        "L": PAPER.geometry.L * rng.normal(1, 1e-3, count),
        "platform.mass": PAPER.bodies.platform.mass * rng.uniform(0.9, 1.1, count),
        "payload.com.y": rng.uniform(0, 0.01, count) * (rng.random(count) < 0.5),  # some are symmetric
        "payload.mass": rng.uniform(0.1, 0.5, count),
        "friction.viscous.sliders": rng.uniform(0, 10, count),
        "friction.viscous.joints": rng.uniform(0, 0.1, count),
        "friction.coulomb.slide_b": rng.uniform(0, 3, count),
        "friction.coulomb.hinge_platform": rng.uniform(0, 0.05, count),
        "friction.smoothing": 10 ** rng.uniform(-3, -1, count),
    }


def same(one, other):
    return all(np.array_equal(getattr(one, n), getattr(other, n), equal_nan=True) for n in FIGURES)


def apart(one, other, name="pose"):
    return np.abs(getattr(one, name) - getattr(other, name)).max()


def part(given, which):
    return {name: column[which] for name, column in given.items()}


@compiled
@pytest.mark.parametrize("name", FRICTIONS)
@pytest.mark.parametrize("kind", [PD, Feedforward, ComputedTorque])
def test_a_run_with_friction_is_that_of_simulate(kind, name):
    friction, allowed = FRICTIONS[name]
    loop = {"controller": kind(PAPER, MOTION), "control": AT_1_KHZ, "start": MOTION.pose[0]}
    many = robot(friction).simulate_many(0.1004, 1, **loop)
    free = p3dof.load().simulate_many(0.1004, 1, **loop)
    run = robot(friction).simulate(
        0.1004, **(loop | {"start": InitialState(MOTION.pose[0])}), method="compiled", integration=PRECISE
    )
    assert many.note.startswith("lanes")
    assert not many.careful.any()
    assert np.abs(many.pose[0] - run.pose[-1]).max() < allowed
    assert np.abs(many.velocity[0] - run.velocity[-1]).max() < 100 * allowed
    assert apart(many, free) > 1e3 * allowed  # friction does something


@compiled
def test_columns_of_friction_count():
    given, loop = columns(4), {"controller": PD(PAPER, MOTION), "control": AT_1_KHZ}
    many = p3dof.load().simulate_many(0.1, given, **loop)
    one = p3dof.load().simulate_many(0.1, given, **loop, integration=PRECISE)
    assert many.note.startswith("lanes")
    assert one.note.startswith("one by one")
    assert apart(many, one) < 1e-6
    assert apart(many, one, "rms_force") < 1e-3
    assert apart(many, one, "work") < 2e-6
    fine = p3dof.load().simulate_many(0.1, given, **loop, integration=Integration(scheme="rk4", step=1e-5))
    assert apart(fine, one) < 1e-10


@compiled
@pytest.mark.parametrize("level", levels()[1:])
def test_no_run_depends_on_the_friction_of_another(level):
    control = ControlLoop(1000, noise=Noise(1e-6, 1e-4), delay=1.5e-3)
    given = columns(70) | {"seed": np.arange(70)}
    given["friction.coulomb.slide_b"][::7] = 1e4  # so steep that they go on carefully
    given["friction.smoothing"][::7] = 1e-3

    def runs(which, **options):
        loop = {"controller": PD(PAPER, MOTION), "control": control, "level": level}
        return p3dof.load().simulate_many(0.02, part(given, which), **loop, **options)

    together, order = runs(np.arange(70)), np.random.default_rng(1).permutation(70)
    mixed = runs(order)
    assert together.finished.all()
    assert np.array_equal(together.careful, np.arange(70) % 7 == 0)
    for name in FIGURES:
        assert np.array_equal(getattr(mixed, name), getattr(together, name)[order]), name
    for i in range(3):
        alone = runs(np.array([i]))
        for name in FIGURES:
            assert np.array_equal(getattr(alone, name)[0], getattr(together, name)[i]), name
    single = runs(np.arange(70), lanes=False)
    assert apart(single, together) < 1e-14
    assert apart(single, together, "velocity") < 1e-12


@compiled
def test_machines_without_friction_keep_their_own_kernel():
    """To the last bit, also where others have some; the one for friction fuses other products and sums."""
    given = columns(6)
    free = {name: column for name, column in given.items() if not name.startswith("friction")}
    for name in given.keys() - free.keys() - {"friction.smoothing"}:
        given[name][::2] = 0.0
    loop = {"controller": PD(PAPER, MOTION), "control": AT_1_KHZ}
    some = p3dof.load().simulate_many(0.1, given, **loop)
    none = p3dof.load().simulate_many(0.1, free, **loop)
    assert np.array_equal(some.pose[::2], none.pose[::2])
    assert np.abs(some.pose[1::2] - none.pose[1::2]).max(axis=1).min() > 1e-6


@compiled
def test_springs_and_friction_come_to_rest():
    hold = p3dof.load().gravity_forces(np.zeros(3))
    many = robot(FRICTIONS["steep"][0]).simulate_many(
        0.5, {"start.vy": [0.0, 0.1]}, controller=Springs(2000.0, preload=hold)
    )
    free = p3dof.load().simulate_many(0.5, {"start.vy": [0.0, 0.1]}, controller=Springs(2000.0, preload=hold))
    assert many.note.startswith("lanes")
    assert many.finished.all()
    assert np.abs(many.velocity[1]).max() < 0.2 * np.abs(free.velocity[1]).max()


@pytest.mark.parametrize("symmetric", [True, False])
def test_decay_rates_are_those_of_forward_dynamics(symmetric):
    friction = Friction(VISCOUS, COULOMB, smoothing=0.5)
    machine = replace(PAPER, friction=friction)
    if not symmetric:
        payload = Body(0.4, [0.01, 0.02, 0.03], np.diag([1e-3, 2e-3, 2e-3]))
        machine = machine.carrying(payload)
    pose, step = np.array([0.05, 0.01, 0.1]), 1e-6
    faster, slower = (
        p3dof.load(machine).forward_dynamics(np.tile(pose, (3, 1)), sign * step * np.eye(3), np.zeros((3, 3)))
        for sign in (1, -1)
    )
    trace = -np.trace(faster - slower) / (2 * step)
    model = (*model_of(machine).numbers, *friction_numbers(friction))
    assert decay_rates(model, pose[0], pose[2]) == pytest.approx(trace, rel=1e-6)


def test_steps_are_cut_where_friction_is_steep():
    task = _task(1.0, InitialState(), None, AT_1_KHZ, None, None, KINDS, EQUAL_STEPS)
    free = tuple(np.full(4, number) for number in model_of(PAPER).numbers)
    assert parts_of_steps(task, free, 0.0, 0.0, 4).tolist() == [1, 1, 1, 1]
    rate = decay_rates((*model_of(PAPER).numbers, *friction_numbers(Friction({"slide_c": 1.0}))), 0.0, 0.0)
    viscous = np.array([400, 600, 30_000, 40_000]) / rate  # times 2 ms: 0.8, 1.2, 60, 80
    rough = [np.zeros(4)] * 19
    rough[2] = viscous
    assert parts_of_steps(task, (*free, *rough), 0.0, 0.0, 4).tolist() == [1, 2, 64, CAREFULLY]
    slow = replace(task, control=ControlLoop(1))
    assert parts_of_steps(slow, (*free, *rough), 0.0, 0.0, 4).tolist() == [1, 2, CAREFULLY, CAREFULLY]
    beyond = parts_of_steps(task, (*free, *rough), np.array([0.0, 9.0, 0.0, 9.0]), 0.0, 4)
    assert beyond.tolist() == [1, 1, 64, 1]  # out of reach
