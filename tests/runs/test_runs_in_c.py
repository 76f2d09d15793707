"""Runs of the machine in C against the integrator in Python: events, samples, errors, sanitizers."""

import pickle
import shutil
import signal
import subprocess
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from runs_in_c import both, difference, in_python, random_run, result
from sanitized import LINUX, run_sanitized

import p3dof
from p3dof._base.errors import ControllerError, DynamicsError, InputError, ReachError
from p3dof.closed_form.compiled import levels, runs
from p3dof.closed_form.compiled.lanes import lane_kernel
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers
from p3dof.machine import Friction
from p3dof.runs import PD, ComputedTorque, ControlLoop, Feedforward, InitialState, Integration, Noise, Springs
from p3dof.runs.integration import Integrator
from p3dof.runs.machine import RunOfMachine
from p3dof.runs.machine_plants import Limiter
from p3dof.runs.settings import LEAST_RTOL

pytestmark = pytest.mark.skipif(levels()[-1] == "numpy", reason="the extension was not built")

HOME = np.zeros(3)
ROUGH = Friction({"sliders": 20, "joints": 0.3}, {"sliders": 5, "joints": 0.2})


def both_ways(robot):
    """Return what runs a machine in C, and what does in Python."""
    return partial(robot.simulate, method="compiled"), partial(in_python, robot)


@pytest.mark.parametrize("seed", range(24))
def test_random_runs_are_those_of_the_integrator_in_python(seed):
    assert difference(*both(seed)) == ""


@pytest.mark.parametrize("seed", range(5))
def test_evaluations_are_those_of_the_integrator_in_python(seed):
    """The middle of four tolerances where the error of a step, from which the next follows, is not rounding.

    At a single one a step may just be refused by one and not by the other, and another course follow: starts
    that are moved by 1e-15 change single counts by up to 4 %, the middle by less than 1 %. A tolerance wrong
    by a factor of 2 changes it by 2^(1/8), 9 %.
    """
    machine, duration, run = random_run(seed)
    ratios = []
    for rtol in (3e-8, 1.1e-8, 1e-8, 0.9e-8):
        run["integration"] = Integration(rtol=rtol, atol=rtol / 100)
        found = machine.simulate(duration, method="compiled", **run)
        ratios.append(found.evaluations / in_python(machine, duration, **run).evaluations)
    assert np.median(ratios) == pytest.approx(1, rel=0.03)


@pytest.mark.fuzz
@pytest.mark.parametrize("hundred", range(10))
def test_a_thousand_random_runs_are_those_of_the_integrator_in_python(hundred, request):
    begin = request.config.getoption("--hypothesis-seed")
    first = 1000 + 1000 * (int(begin) % 2**32 if begin else 0) + 100 * hundred
    wrong = {seed: difference(*both(seed)) for seed in range(first, first + 100)}
    assert {seed: what for seed, what in wrong.items() if what} == {}


def test_the_random_runs_end_in_every_way():
    """What is compared must not be free falls only."""
    ends, drives = set(), set()
    for seed in range(60):
        machine, duration, run = random_run(seed)
        task = RunOfMachine(machine, duration, method="compiled", **run)
        drives.add((task.pace, type(run["controller"]).__name__, bool(run["control"].rate)))
        found = result(machine.simulate, duration, method="compiled", **run)
        ends.add("controller" if isinstance(found, str) else found.stop and found.stop.kind)
    assert ends >= {None, "slider stop", "tilt limit", "singular pose", "controller"}
    assert len(drives) >= 10
    assert {drive[0] for drive in drives} == {"C", "C and Python"}


def test_a_wrong_limit_is_noticed(monkeypatch):
    watched = Limiter.watched.fget

    def wrong(limiter):
        bounds, signs, counted = watched(limiter)
        return bounds + 1e-7, signs, counted

    monkeypatch.setattr(Limiter, "watched", property(wrong))
    assert any(difference(*both(seed)) for seed in range(6))


def test_a_wrong_friction_is_noticed(monkeypatch):
    right = runs.friction_numbers
    monkeypatch.setattr(runs, "friction_numbers", lambda friction: [1.0001 * x for x in right(friction)])
    assert any(difference(*both(seed)) for seed in range(12))


# Whole holds in six evaluations


PAPER_MOTION = p3dof.paper_motion()


@pytest.fixture
def by_dop853_alone(monkeypatch):
    """What runs in Python as SciPy's DOP853 does it, hold by hold."""

    def run(machine, duration, **how):
        with monkeypatch.context() as patch:
            patch.setattr(Integrator, "_at_once", lambda _, solver: solver)
            return in_python(machine, duration, **how)

    return run


def furthest(one, other, names=("pose", "velocity", "forces")):
    """Return the largest difference of states and forces, as shares of the largest of each."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in names]
    return max(float(np.abs(a - b).max() / max(1e-3, np.abs(b).max())) for a, b in pairs)


@pytest.mark.parametrize("rate", [800.0, 1000.0, 2000.0])
@pytest.mark.parametrize("kind", ["pd", "torque", "python"])
def test_holds_take_half_the_evaluations_and_no_error(rate, kind):
    """Against steps of a quarter of a millisecond, at the least tolerances."""
    robot, rest = p3dof.load(), p3dof.load().inverse_kinematics(HOME).sliders
    controller = {
        "pd": PD(p3dof.PAPER, PAPER_MOTION, 10.0),
        "torque": ComputedTorque(robot, PAPER_MOTION),
        "python": lambda seen: 3000 * (rest - seen.sliders) - 100 * seen.slider_velocities,
    }[kind]
    how = {"start": PAPER_MOTION.pose[0], "controller": controller, "control": ControlLoop(rate)}
    how |= {"samples": np.arange(0, 500, 5) / rate}
    duration = 500 / rate
    found = robot.simulate(duration, **how)
    exact = Integration(rtol=LEAST_RTOL, atol=1e-16, max_step=2.5e-4)
    reference = robot.simulate(duration, integration=exact, **how)
    assert found.note == reference.note == ""
    assert len(found) == len(reference) == 101
    assert furthest(found, reference) < 1e-13
    assert found.evaluations < 8.5 * 500


@pytest.mark.parametrize("seed", [0, 3, 7, 9, 15, 24, 33])
def test_random_machines_move_as_by_dop853_alone(seed, by_dop853_alone):
    """To rounding, and what the motion makes of it: by how much it multiplies a small error at its start."""
    machine, duration, run = random_run(seed)
    control = replace(run["control"], rate=1000.0, resolution=0.0, delay=min(run["control"].delay, 0.01))
    run |= {"control": control, "integration": Integration(), "samples": 101}
    found, alone = (
        machine.simulate(duration, method="compiled", **run),
        by_dop853_alone(machine, duration, **run),
    )
    assert (found.stop and found.stop.reason) == (alone.stop and alone.stop.reason)
    assert len(found) == len(alone)
    start = run["start"]
    run["start"] = InitialState(start.pose + 1e-9, start.velocity)
    other, inside = in_python(machine, duration, **run), slice(-1)
    count = min(len(other), len(found)) - 1
    for name in ("pose", "velocity", "forces"):
        mine, theirs, moved = (getattr(one, name)[inside][:count] for one in (found, alone, other))
        size = max(1.0, np.abs(theirs).max())
        worse = max(1.0, np.abs(moved - theirs).max() / size / 1e-9)
        assert np.abs(mine - theirs).max() <= 1e-13 * worse * size, name
    ticks = round(1000 * found.time[-1])
    assert found.evaluations <= alone.evaluations + 5 * (7 + ticks / 64)


@pytest.mark.parametrize("smoothing", [1e-3, 1e-4])
def test_stiff_friction_is_left_to_dop853(smoothing, by_dop853_alone):
    """Which is tried again seldom enough to cost next to nothing."""
    friction = replace(ROUGH, smoothing=smoothing)
    machine = p3dof.Manipulator(replace(p3dof.PAPER, friction=friction))
    how = {"start": PAPER_MOTION.pose[0], "controller": PD(machine, PAPER_MOTION), "samples": 31}
    how["control"] = ControlLoop(1000)
    found, alone = machine.simulate(0.3, **how), by_dop853_alone(machine, 0.3, **how)
    assert furthest(found, alone) < 1e-13
    assert alone.evaluations > 20 * 300
    assert found.evaluations <= 1.01 * alone.evaluations


@pytest.mark.parametrize(
    "how",
    [
        {"control": ControlLoop(10), "samples": 2},
        {"control": ControlLoop(100), "samples": 2},
        {"control": ControlLoop(400), "samples": 2},
        {"control": ControlLoop(1000), "samples": 1201},  # some in each hold
    ],
    ids=["10 Hz", "100 Hz", "400 Hz", "between ticks"],
)
def test_holds_that_are_looked_into_are_those_of_dop853(how, by_dop853_alone):
    robot = p3dof.load()
    how = {"start": PAPER_MOTION.pose[0], "controller": PD(robot, PAPER_MOTION), **how}
    how["integration"] = Integration(rtol=1e-8, atol=1e-10)
    found, alone = robot.simulate(0.3, **how), by_dop853_alone(robot, 0.3, **how)
    assert furthest(found, alone) < 1e-13
    assert found.evaluations == alone.evaluations == in_python(robot, 0.3, **how).evaluations


def test_a_limit_within_a_hold_is_crossed_when_it_was(by_dop853_alone):
    limits = replace(p3dof.PAPER.limits, tilt=(-0.2, 0.2))
    machine = p3dof.Manipulator(replace(p3dof.PAPER, limits=limits))
    away = p3dof.Motion.rest_to_rest([0, 0, 0.15], [0, 0, 0.4], 0.5, 51)
    how = {"start": [0, 0, 0.15], "controller": PD(machine, away, 10.0), "control": ControlLoop(1000)}
    found, alone = (
        machine.simulate(1.0, samples=101, **how),
        by_dop853_alone(machine, 1.0, samples=101, **how),
    )
    assert found.stop.kind == alone.stop.kind == "tilt limit"
    assert found.stop.time == pytest.approx(alone.stop.time, abs=1e-14)
    assert (1000 * found.stop.time) % 1 == pytest.approx(0.5, abs=0.45)  # not at a tick
    assert furthest(found, alone) < 1e-13
    assert found.evaluations < 0.6 * alone.evaluations
    assert found.evaluations == in_python(machine, 1.0, samples=101, **how).evaluations


def test_what_samples_are_asked_for_changes_no_more_than_rounding():
    robot = p3dof.load()
    how = {"start": PAPER_MOTION.pose[0], "controller": PD(robot, PAPER_MOTION), "control": ControlLoop(1000)}
    few, many = (robot.simulate(0.2, samples=samples, **how) for samples in (11, 801))
    assert len(many) == 80 * (len(few) - 1) + 1
    for name in ("pose", "velocity", "forces"):
        one, other = getattr(few, name), getattr(many, name)[::80]
        assert np.abs(one - other).max() < 1e-13 * np.abs(one).max()


@pytest.fixture(params=levels()[1:])
def at_level(request, monkeypatch):
    """The machine at a level of the processor, and on NumPy alone."""
    machines = []
    for level in (request.param, "numpy"):
        monkeypatch.setenv("P3DOF_LEVEL", level)
        machines.append(p3dof.load())
        assert machines[-1].kernels.level == level
    return machines


def test_a_free_fall_is_exact_at_every_level(at_level):
    """Not in as many evaluations: under a constant acceleration every step is exact.

    So the error of a step is rounding, which differs by level (a fused multiply-add rounds once, not twice),
    and the next step follows from it. Rounding of the accelerations, some 1e-14 of g, moves it by less still.
    """
    for run in (
        at_level[0].simulate(0.5, start=[0, 0, 0.3], stop_at=[], method="compiled", samples=51),
        in_python(at_level[1], 0.5, start=[0, 0, 0.3], stop_at=[], samples=51),
    ):
        nothing = np.zeros(51)
        fallen = np.stack([nothing, -9.806 * run.time**2 / 2, nothing + 0.3], axis=1)
        np.testing.assert_allclose(run.pose, fallen, rtol=0, atol=1e-12)


def test_every_level_swings_alike_in_as_many_evaluations(at_level):
    start = InitialState([0, 0, 0.3], [0.2, -0.1, 1.0])
    springs = Springs(2000, damping=5)
    for rtol in (3e-8, 3e-9):  # far above rounding
        how = {"start": start, "controller": springs, "stop_at": [], "samples": 51}
        how["integration"] = Integration(rtol=rtol, atol=rtol / 100)
        run, other = at_level[0].simulate(0.5, method="compiled", **how), in_python(at_level[1], 0.5, **how)
        assert difference(run, other) == ""
        assert run.evaluations == other.evaluations > 300


def test_what_has_no_compiled_form_is_done_in_python(monkeypatch):
    robot = p3dof.load()

    def asked(**how):
        return not any(RunOfMachine(robot, 0.1, **{"method": "compiled", **how}).obstacles())

    assert asked()
    assert asked(controller=[1, 2, 3], wrench=np.ones(6), control=ControlLoop(100, saturation=True))
    assert asked(controller=lambda _: HOME, control=ControlLoop(100))
    assert asked(controller=lambda _: HOME, control=ControlLoop(100, resolution=1e-6, differencing=True))
    assert asked(controller=Springs(100))
    assert not asked(method="virtual-power")
    assert not asked(controller=lambda _: HOME)
    assert not asked(wrench=lambda t: np.full(6, t))
    assert asked(control=ControlLoop(100, delay=0.01))
    assert asked(control=ControlLoop(100, delay=0.005))
    assert asked(control=ControlLoop(100, delay=0.2))
    assert asked(control=ControlLoop(100, bandwidth=50))
    assert not asked(control=ControlLoop(bandwidth=50))
    assert asked(integration=Integration(scheme="rk4"))
    assert asked(controller=PD(robot, p3dof.paper_motion()))

    class Stiffer(Springs):
        def __call__(self, measured):
            return 2 * super().__call__(measured)

    assert not asked(controller=Stiffer(100))
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    assert any(RunOfMachine(p3dof.load(), 0.1, method="compiled").obstacles())


def test_what_a_run_leaves_is_that_of_the_integrator_in_python(tmp_path):
    machine, duration, run = random_run(3)
    one, other = machine.simulate(duration, method="compiled", **run), in_python(machine, duration, **run)
    for name in ("q", "v", "a"):
        np.testing.assert_allclose(
            getattr(one.joints, name), getattr(other.joints, name), rtol=1e-5, atol=1e-5
        )
    assert one.joints.names == other.joints.names
    assert one.closure_error.max() < 1e-12
    again = pickle.loads(pickle.dumps(one))  # noqa: S301 - our own
    np.testing.assert_array_equal(again.joints.q, one.joints.q)
    one.save(tmp_path / "run.npz")
    np.testing.assert_array_equal(p3dof.Simulation.load(tmp_path / "run.npz").forces, one.forces)
    with pytest.raises(AttributeError, match="has no attribute 'joint'"):
        _ = one.joint


@pytest.mark.parametrize("kind", [PD, Feedforward, ComputedTorque])
@pytest.mark.parametrize("integral_time", [np.inf, 0.3])
def test_the_controllers_of_the_package_need_no_python(kind, integral_time, monkeypatch):
    robot, motion = p3dof.load(), p3dof.paper_motion()
    controller = kind(robot, motion, frequency=6, damping=0.8, integral_time=integral_time)
    control = ControlLoop(500, saturation=40, noise=Noise(seed=3), resolution=1e-6, differencing=True)
    how = {"controller": controller, "control": control, "samples": 31, "wrench": [0, 3, -20, 0, 1, 0]}
    other = in_python(robot, 0.6, **how)
    monkeypatch.setattr(kind, "__call__", lambda *_: pytest.fail("asked in Python"))
    run = robot.simulate(0.6, method="compiled", **how)
    assert difference(run, other) == ""
    np.testing.assert_allclose(run.asked, other.asked, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(run.reference, other.reference, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", [PD, Feedforward, ComputedTorque])
def test_a_model_without_an_answer_says_so_as_in_python(kind):
    """The machine can do what the controller's model, with shorter legs, cannot reach."""
    robot, motion = p3dof.load(), p3dof.paper_motion()
    g = robot.parameters.geometry
    reach = np.abs(motion.pose[:, 1]).max()
    assert reach < g.L
    short = replace(robot.parameters, geometry=replace(g, L=g.R - g.r + 0.01))
    how = {"controller": kind(short, motion), "control": ControlLoop(200)}
    messages = []
    for run in both_ways(robot):
        with pytest.raises(ControllerError) as caught:
            run(1.0, **how)
        messages.append((str(caught.value), caught.value.time))
    assert messages[0] == messages[1]


@pytest.mark.parametrize("integration", [Integration(), Integration(scheme="rk4")])
@pytest.mark.parametrize(
    ("start", "other", "itself"),
    [
        ([0, 0, 0.1], False, True),
        ([0, 0, 0.1], True, True),
        ([0, 0, 2.2], False, False),
        ([0, 0, -2.2], False, True),
        ([0, 0, 2 * np.pi - 2.2], False, False),
        ([0.2, 0, 0], False, True),
    ],
)
def test_computed_torque_knows_the_pose_that_its_sliders_tell(start, other, itself, integration):
    """Which is the platform's own where the lengths of the model are, on this side of the singular pose."""
    robot = p3dof.load()
    g = robot.parameters.geometry
    wrong = replace(robot.parameters, geometry=replace(g, r=1.01 * g.r))
    motion = p3dof.Motion.rest_to_rest([0, 0, 0.1], [0.02, 0.01, 0.2], 0.1, 21)
    controller = ComputedTorque(wrong if other else robot, motion, frequency=3, integral_time=0.5)
    how = {"start": start, "controller": controller, "control": ControlLoop(1000), "stop_at": []}
    run, exact = (each(0.03, samples=31, integration=integration, **how) for each in both_ways(robot))
    assert difference(run, exact) == ""
    assert run.note == ""
    assert np.abs(run.forces - exact.forces).max() < 1e-10 * np.abs(exact.forces).max()
    taken = robot.forward_kinematics(exact.sliders[0])  # beyond the singular pose for another one
    assert np.allclose(taken, start) == itself


def test_a_controller_is_called_at_its_rate_only():
    asked = []

    def controller(measured):
        asked.append(measured.time)
        return HOME

    p3dof.load().simulate(0.1, controller=controller, control=ControlLoop(1000), method="compiled")
    np.testing.assert_allclose(asked, np.arange(100) / 1000, rtol=0, atol=1e-15)


@pytest.mark.parametrize("answer", [lambda: 1 / 0, lambda: [0, 0, np.nan], lambda: None, lambda: [1, 2]])
def test_a_controller_that_fails_keeps_the_run_until_there(answer):
    robot = p3dof.load()
    hold = robot.forces(HOME, HOME, HOME)
    how = {"controller": lambda m: hold if m.time < 0.05 else answer(), "control": ControlLoop(1000)}
    errors = []
    for run in both_ways(robot):
        with pytest.raises(ControllerError) as caught:
            run(0.1, **how)
        errors.append(caught.value)
    one, other = errors
    assert str(one) == str(other)
    assert (one.time, one.run.stop) == (pytest.approx(other.time, abs=1e-12), other.run.stop)
    np.testing.assert_allclose(one.run.time, other.run.time, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.run.pose, other.run.pose, rtol=0, atol=1e-9)


def test_bad_starts_are_refused_as_in_python():
    robot = p3dof.load()
    for how, error in (
        ({"start": [5, 0, 0]}, ReachError),
        ({"start": [0, 0.3, 0]}, InputError),
        ({"controller": [1e300, 0, 0]}, InputError),
        ({"stop_at": ["wall"]}, InputError),
        ({"start": p3dof.runs.InitialState(joints=(np.zeros(10), np.zeros(10)))}, InputError),
    ):
        messages = []
        for run in both_ways(robot):
            with pytest.raises(error) as caught:
                run(0.1, **how)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]


def test_forces_beyond_all_measure_end_the_run_as_in_python():
    robot = p3dof.load()
    for size in (1e12, 1e20):
        one, other = (ending(run, 0.1, controller=[size, 0, 0]) for run in both_ways(robot))
        assert one == other


def ending(run, *arguments, **how):
    """Return what ended a run, or why it could not begin."""
    try:
        ended = run(*arguments, **how)
    except DynamicsError as error:
        return str(error)
    return ended.stop.kind, len(ended) > 0


@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_ends_a_run_in_c():
    """The main thread is deep in C when the signal comes."""
    robot = p3dof.load()
    springs = Springs(2000.0, preload=robot.forces(HOME, HOME, HOME))
    going = threading.Event()

    def progress(done, total):
        assert 0 <= done <= total == 2
        going.set()

    def interrupt():
        going.wait(60)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            robot.simulate(
                1e5,
                start=[0.02, 0.03, 0.15],
                controller=springs,
                method="compiled",
                samples=2,
                progress=progress,
            )
    finally:
        thread.join()


def test_other_threads_go_on_while_a_run_is_in_c():
    robot = p3dof.load()
    springs = Springs(2000.0, preload=robot.forces(HOME, HOME, HOME))
    how = {"start": [0.02, 0.03, 0.15], "controller": springs, "method": "compiled", "samples": 21}
    alone = robot.simulate(50, **how)
    found = [None] * 4

    def run(k):
        found[k] = robot.simulate(50, **how)

    threads = [threading.Thread(target=run, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one in found:
        np.testing.assert_array_equal(one.pose, alone.pose)


def test_what_the_extension_refuses():
    from p3dof._native._compiled import MachineRun

    robot = p3dof.load()
    motion, constants, place, watch = runs.lane_constants(robot.kernels)
    tables = [constants, place, robot.kernels.prepared("limits")[1]]
    tables += [np.zeros(36), np.zeros(0), np.zeros(1), np.zeros(3), np.zeros(0), np.ones(1)]
    tables += [*[np.zeros(0)] * 11, watch]
    level, numbers = robot.kernels.level, np.zeros(23)
    run = MachineRun(motion, level, tuple(tables), numbers)
    with pytest.raises(ValueError, match="expected a row of 13 doubles"):
        run.live(np.zeros(12))
    with pytest.raises(ValueError, match="expected a row of 0 doubles"):
        run.samples(np.zeros(13))
    with pytest.raises(ValueError, match="must have 6 numbers, not 3"):
        run.hold(np.zeros(3))
    with pytest.raises(ValueError, match="tuple of 21 tables"):
        MachineRun(motion, level, tuple(tables[:8]), numbers)
    with pytest.raises(ValueError, match="no kernel 'magic' of motion"):
        MachineRun("magic", level, tuple(tables), numbers)
    with pytest.raises(ValueError, match="numbers must have 23 numbers, not 16"):
        MachineRun(motion, level, tuple(tables), numbers[:16])
    for place, size in ((0, 2), (3, 35), (6, 4), (8, 0), (4, 3), (9, 7)):
        wrong = np.zeros(size)
        broken = [*tables[:place], wrong, *tables[place + 1 :]]
        with pytest.raises(ValueError, match=r"must have|do not fit"):
            MachineRun(motion, level, tuple(broken), numbers)
    torque = [*tables[:9], np.ones(10), np.zeros(29), np.zeros(9), *tables[12:]]
    with pytest.raises(ValueError, match="the model of the controller does not fit"):
        MachineRun(motion, level, tuple(torque), numbers)
    followed = [*tables[:9], np.zeros(10), np.zeros(29), *tables[11:18], np.zeros(6), np.zeros(9), watch]
    with pytest.raises(ValueError, match="what the controller follows does not fit"):
        MachineRun(motion, level, tuple(followed), numbers)
    for late in ((-1, 0), (0, 1), (np.nan, 0), (1e10, 0)):
        with pytest.raises(ValueError, match="late by whole periods and a part of one"):
            MachineRun(motion, level, tuple(tables), np.array([*numbers[:21], *late]))
    with pytest.raises(TypeError, match="must be a buffer of doubles"):
        MachineRun(motion, level, (*tables[:20], None), numbers)


DRIVER = r"""
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#define P3DOF_INLINE inline
#define P3DOF_SIMD
#define P3DOF_ALIGNED
#define P3DOF_TARGET
enum { CACHE_LINE = 8, BLOCK = 80, LINE = 88 };
#define P3DOF_NAME(f) f##_here
#include "p3dof/_native/machine.h"
#include "p3dof/_native/vector_math.h"
#define P3DOF_ROW 1
#include "p3dof/_native/rows.h"
#include "p3dof/_native/generated/batch_kernels.h"
#include "p3dof/_native/machine_run.h"
#define P3DOF_LANE(f) P3DOF_NAME(f##_single)
#define P3DOF_LANES 1
#include "p3dof/_native/generated/lane_kernels.h"
#include "p3dof/_native/control.h"
#include "p3dof/_native/follow.h"
@TABLES@

static int polls;
static int poll(MachineRun *m)
{
    (void)m;
    return ++polls > 3;
}

static double plan[9 * 100], errors[6 * 100]; /* the motion rests at home */

static void act(MachineRun *m, const double *sliders)
{
    Control_single_here *control = m->control;
    const ptrdiff_t tick = (ptrdiff_t)m->ticks;
    const double *noise = errors;
    ((ControlPath *)m->path)->known = m->exact && m->looked && m->placed[6] > 0.0 ? m->y : NULL;
    control_wanted_single_here(m->path, control, &tick);
    control_act_single_here(m->path, control, &tick, &noise, (const double(*)[1])sliders);
    memcpy(m->given, control->late[0][3], 3 * sizeof(double));
    memcpy(m->given + 3, control->late[0][0], 3 * sizeof(double));
}

static void follow(MachineRun *m, double t, const double *sliders, double *forces)
{
    Control_single_here *control = m->control;
    const double none = 0.0, *noise = &none;
    const ptrdiff_t tick = 0;
    followed_at(m->followed, t, control->goal[0]);
    control_act_single_here(m->path, control, &tick, &noise, (const double(*)[1])sliders);
    memcpy(forces, control->late[0][3], 3 * sizeof(double));
    memcpy(forces + 3, control->late[0][0], 3 * sizeof(double));
}

static int scheme;
static double part;

static int run(int drive, double period, double size, int friction, double end, double room)
{
    static double out[ROW * 32];
    const double load_time[3] = {0.01, 0.02, 0.03}, load[9] = {1, 2, 3, -1, 0, 2, 5, 5, 5};
    double times[31];
    MachineRun m = {0};
    for (int k = 0; k < 31; ++k)
        times[k] = end * k / 30;
    m.motion = friction ? lane_motion_with_friction_apart_single_here : lane_motion_apart_single_here;
    m.place = lane_place_single_here;
    m.watch = lane_limits_single_here;
    m.limits.run = limits_here;
    m.motion_constants = friction ? rough : forward;
    m.place_constants = place;
    m.watch_constants = watch;
    m.limits.constants = limits;
    m.r = lengths[0];
    m.R = lengths[1];
    m.L = lengths[2];
    for (int k = 0; k < LIMITS; ++k) {
        m.bound[k] = bounds[k] - room * signs[k];
        m.sign[k] = signs[k];
        m.counted[k] = 1;
    }
    m.drive = drive;
    for (int k = 0; k < 3; ++k) {
        m.stiffness[k] = 500 * size;
        m.preload[k] = m.held[k] = m.held[3 + k] = m.given[k] = m.given[3 + k] = size * (k + 1);
        m.cut[k] = INFINITY;
    }
    m.load_time = load_time;
    m.load = load;
    m.loads = friction ? 3 : 1;
    m.kinks = load_time;
    m.kink_count = friction ? 3 : 0;
    m.times = times;
    m.samples = 31;
    m.period = period;
    m.outside = period > 0.0 && drive == DRIVE_HELD;
    m.rtol = 1e-11;
    m.atol = 1e-13;
    m.longest = INFINITY;
    m.poll = poll;
    m.out = out;
    m.exact = friction;
    m.scheme = scheme;
    if (scheme == STEPS_EQUAL)
        m.longest = 7e-4;
    double late[6 * 5], breaks[3] = {0.0, 0.1, 0.2}, curve[36] = {0};
    Followed followed = {.breaks = breaks, .curve = curve, .pieces = 2, .duration = 0.2};
    curve[12] = curve[30] = 1.0; /* y = t^2 from 0 and from 0.1 s */
    m.followed = &followed;
    m.follow = follow;
    m.late = late;
    m.ring = 5;
    m.whole = part > 0.0 ? 3.0 : 0.0;
    m.part = part;
    const int kind = size > 0.0 ? CONTROL_TORQUE : CONTROL_FEEDBACK;
    const int ticks = drive != DRIVE_FOLLOW;
    ControlPath path = {.kind = kind, .noisy = ticks, .counting = 1, .differencing = ticks,
                              .integrating = ticks, .ring = 1, .period = period, .table = plan,
                              .assembly = assembly, .torque = torque, .inverse = inverse};
    Control_single_here control = {0};
    for (int k = 0; k < 3; ++k) {
        control.gain[k][0] = 900.0;
        control.damping[k][0] = 60.0;
        control.share[k][0] = 0.01;
        control.cut[k][0] = 500.0;
        control.count[k][0] = 1e-6;
    }
    m.control = &control;
    m.path = &path;
    m.act = act;
    m.planned = 100;
    m.huge = end == 0.3 ? 1e-9 : INFINITY;
    m.lagging = friction && period > 0.0;
    m.lag[0] = m.lag[1] = 100.0;
    m.lag[2] = INFINITY;
    int status;
    do {
        status = advance_here(&m);
    } while (status == RUN_TICK);
    printf("%d ", status);
    return status;
}

static void all(void)
{
    run(DRIVE_HELD, 0.0, 0.0, 0, 0.5, 0.0);
    run(DRIVE_HELD, 0.0, 0.0, 0, 0.5, 9.0);
    run(DRIVE_SPRINGS, 0.0, 9.0, 1, 0.5, 0.0);
    run(DRIVE_SPRINGS, 1e-3, 9.0, 1, 0.1, 9.0);
    run(DRIVE_HELD, 1e-3, 1.0, 0, 0.1, 9.0);
    run(DRIVE_HELD, 0.0, 1e300, 0, 0.5, 0.0);
    run(DRIVE_HELD, 0.0, NAN, 0, 0.5, 0.0);
    run(DRIVE_CONTROL, 1e-3, 1.0, 0, 0.1, 9.0);
    run(DRIVE_CONTROL, 1e-3, 0.0, 1, 0.05, 9.0);
    run(DRIVE_CONTROL, 1e-3, 1.0, 0, 0.2, 9.0);
    run(DRIVE_CONTROL, 1e-3, 1.0, 0, 0.3, 9.0);
    run(DRIVE_FOLLOW, 0.0, 1.0, 0, 0.29, 9.0);
    run(DRIVE_FOLLOW, 0.0, 1.0, 1, 0.29, 0.0);
}

int main(void)
{
    for (scheme = STEPS_ADAPTIVE; scheme <= STEPS_EQUAL; ++scheme) {
        part = 0.0;
        all();
        part = 0.4;
        all();
        polls = 0;
        run(DRIVE_SPRINGS, 0.0, 9.0, 0, 5000.0, 9.0);
    }
    return 0;
}
"""


@pytest.mark.slow
def test_sanitizers_find_nothing(tmp_path):
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc here")
    parameters = random_run(3)[0].parameters  # general bodies
    parameters = replace(p3dof.load().parameters, bodies=parameters.bodies, friction=ROUGH)
    kernels, g = p3dof.Manipulator(parameters).kernels, parameters.geometry
    bounds, signs, _ = Limiter(parameters, []).watched
    tables = {
        "forward": lane_kernel("motion").of(kernels.model),
        "rough": lane_kernel("motion_with_friction").of(kernels.model, friction_numbers(ROUGH)),
        "place": lane_kernel("place").of(kernels.model),
        "watch": lane_kernel("limits").of(kernels.model),
        "limits": kernels.prepared("limits")[1],
        **{name: lane_kernel(name).of(kernels.model) for name in ("assembly", "torque", "inverse")},
        "lengths": (g.r, g.R, g.L),
        "bounds": bounds,
        "signs": signs,
    }
    assert not kernels.symmetric
    lines = [
        f"static const double {name}[] = {{{', '.join(map(repr, map(float, row)))}}};"
        for name, row in tables.items()
    ]
    source = tmp_path / "driver.c"
    source.write_text(DRIVER.replace("@TABLES@", "\n".join(lines)))
    root = Path(p3dof.__file__).parents[1]
    flags = ["-std=c11", "-O0", "-g", "-Wall", "-Wextra", "-Wno-unused-function", "-Werror"]
    flags += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", f"-I{root}"]
    program = tmp_path / "driver"
    subprocess.run([compiler, *flags, "-o", program, source, "-lm"], check=True)
    ran = subprocess.run([program], check=True, capture_output=True, text=True)
    assert set(ran.stdout.split()) == {"0", "2", "3", "4", "5", "6"}


UNDER_SANITIZERS = """
import os
import numpy as np
import p3dof
import runs_in_c, test_equal_steps_in_c as equal, test_runs_in_c as own
from p3dof.closed_form.compiled import levels
rough = p3dof.machine.Friction({"sliders": 5.0}, {"joints": 0.02}, smoothing=0.05)
motion = p3dof.paper_motion(51)
for level in levels()[1:]:
    os.environ["P3DOF_LEVEL"] = level
    for seed in range(30):
        for make in (runs_in_c.random_run, equal.random_run):
            machine, duration, run = make(seed)
            machine = p3dof.Manipulator(machine.parameters)
            assert machine.kernels.level == level
            runs_in_c.result(machine.simulate, duration / 4, method="compiled", **run)
    own.test_what_the_extension_refuses()
    start = np.where(np.arange(70) % 9, 0.1, np.nan)
    for friction in ("friction.viscous.sliders", "start.y"):
        columns = {"start.theta": start, "platform.mass": np.linspace(1, 90, 70)}
        columns[friction] = np.linspace(0, 0.1, 70)
        for kind in (p3dof.runs.PD, p3dof.runs.Feedforward, p3dof.runs.ComputedTorque):
            machine = p3dof.load(
                own.replace(
                    p3dof.PAPER, friction=rough if kind is p3dof.runs.PD else p3dof.machine.Friction()
                )
            )
            for lanes in (True, False):
                for late in (0.0, 2.3e-3):
                    more = {"resolution": 1e-6, "delay": late, "bandwidth": 90}
                    control = p3dof.runs.ControlLoop(1000, noise=p3dof.runs.Noise(1e-6), **more)
                    controller = kind(p3dof.PAPER, motion)
                    how = {"controller": controller, "control": control, "lanes": lanes, "histories": 5}
                    machine.simulate_many(0.02, columns, **how)
print("clean")
"""


@pytest.mark.fuzz
@LINUX
def test_the_extension_runs_clean_under_sanitizers(tmp_path):
    """Single runs of every kind, and many runs with friction, at every level."""
    done = run_sanitized(tmp_path, UNDER_SANITIZERS)
    assert done.stdout == "clean\n", done.stderr[-3000:]
