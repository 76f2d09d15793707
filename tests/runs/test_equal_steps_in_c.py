"""Runs by RK4 in equal steps, in C: against the same in Python."""

from dataclasses import replace

import numpy as np
import pytest
from machines import random_machine, random_states
from runs_in_c import around, in_python

import p3dof
from p3dof import WrenchHistory
from p3dof._base.errors import InputError, ReachError
from p3dof.closed_form.compiled import levels
from p3dof.machine.parameters import Friction, Limits
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
from p3dof.runs.machine import RunOfMachine

pytestmark = pytest.mark.skipif(levels()[-1] == "numpy", reason="the extension was not built")

FIELDS = ("pose", "velocity", "acceleration", "forces", "asked", "sliders", "slider_velocities", "wrench")
ROBOT = p3dof.load()

DURATION = 0.0503  # no whole number of ticks


class Follower:
    """A PD controller written in Python."""

    def __init__(self, mass, rest):
        self.mass, self.rest = mass, rest

    def __call__(self, measured):
        return self.mass * (30 * (self.rest - measured.sliders) - measured.slider_velocities)


def random_run(seed):
    """Return a machine, and the arguments of a short run of it, from a seed."""
    rng = np.random.default_rng([seed, 4])
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 1)
    pose, mass = states.pose[0], parameters.bodies.mass
    if rng.random() < 0.4:
        friction = Friction({"sliders": 3.0, "joints": 0.1}, {"sliders": 1.0}, smoothing=0.05)
        parameters = replace(parameters, friction=friction)
    sliders = p3dof.Manipulator(parameters).inverse_kinematics(pose).sliders
    room = parameters.geometry.L * np.array([-0.3, 0.3])
    travel = min(sliders.min(), 0) + room[0], max(sliders.max(), 0) + room[1]
    limits = Limits(travel=travel, tilt=(min(pose[2], 0) - 0.5, max(pose[2], 0) + 0.5))
    machine = p3dof.Manipulator(replace(parameters, limits=limits))
    kind = seed % 8
    rate = rng.choice([200.0, 500.0, 1000.0]) if kind >= 3 else [None, 500.0, None][kind]
    controller = [
        rng.normal(0, mass, 3),
        None,
        Springs(mass * np.array([10, 20, 30]), sliders, mass, rng.normal(0, mass, 3)),
        Springs(mass * 20, sliders, mass),
        *(make(parameters, *around(pose, rng)) for make in (PD, Feedforward, ComputedTorque)),
        Follower(mass, sliders),
    ][kind]
    if 4 <= kind < 7 and controller.integral_time == np.inf and rng.random() < 0.4:
        rate = None
    more = {}
    if rate and rng.random() < 0.5:
        more = {"noise": Noise(1e-6, 1e-4, seed), "resolution": 1e-6, "differencing": bool(rng.integers(2))}
    if rate and rng.random() < 0.5:
        more["delay"] = rng.choice([1.0, 2.0, 0.3, 2.6, 40.0]) / rate
    if rate and rng.random() < 0.4:
        more["bandwidth"] = rng.uniform(5, 100, 3)
    time = np.sort(rng.uniform(0, 0.05, 4))
    history = WrenchHistory(time, rng.normal(0, mass, (4, 6)))
    return machine, DURATION, {
        "start": InitialState(pose, 0.2 * states.velocity[0]),
        "controller": controller,
        "control": ControlLoop(rate, saturation=[False, 3 * mass][rng.integers(2)], **more),
        "wrench": [None, rng.normal(0, mass, 6), history][rng.integers(3)],
        "stop_at": [kind for kind in KINDS[:2] if rng.random() < 0.5],
        "samples": [rng.integers(2, 60), np.sort(rng.uniform(0, 0.05, 20))][rng.integers(2)],
        "integration": Integration(scheme="rk4", step=rng.choice([3e-3, 1e-3, 0.4e-3])),
    }  # fmt: skip


def in_c(machine, duration, **run):
    return RunOfMachine(machine, duration, method="compiled", **run).in_c()


def python_is_refused(monkeypatch):
    def refused(run, note=""):
        assert not note  # the run was to be in C
        return own(run)

    own = RunOfMachine.in_python
    monkeypatch.setattr(RunOfMachine, "in_python", refused)


def amplification(machine, duration, run, found):
    """Return by how much a run multiplies a small error at its start; at least 1, much if it is unstable."""
    start = run["start"]
    other = in_python(machine, duration, **run | {"start": InitialState(start.pose + 1e-9, start.velocity)})
    count = min(len(other), len(found)) - 1
    moved = []
    for name in ("pose", "velocity", "acceleration", "forces"):
        one, two = getattr(other, name)[:count], getattr(found, name)[:count]
        moved.append(np.abs(one - two).max() / max(1, np.abs(two).max()))
    return max(1.0, max(moved) / 1e-9)


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[pytest.mark.slow] * (seed % 2)) for seed in range(64)]
)
def test_equal_steps_in_c_are_those_in_python(seed, monkeypatch):
    machine, duration, run = random_run(seed)
    other = in_python(machine, duration, **run)
    python_is_refused(monkeypatch)
    found = machine.simulate(duration, method="compiled", **run)
    assert found.note == ""
    assert (found.stop and found.stop.reason) == (other.stop and other.stop.reason)
    if not other.finished:
        assert found.stop.time == pytest.approx(other.stop.time, abs=1e-9)
    worse = amplification(machine, duration, run, other)
    for name in FIELDS:
        one, two = (getattr(run, name)[: len(other) if other.finished else -1] for run in (found, other))
        assert one.shape == two.shape
        assert np.abs(one - two).max() <= 1e-12 * worse * max(1, np.abs(two).max()), name
    assert found.time == pytest.approx(other.time, abs=1e-9 if other.stop else 0)
    assert (found.reference is None) == (other.reference is None)
    assert found.reference is None or found.reference == pytest.approx(other.reference, abs=1e-8)
    assert np.abs(found.joints.q - other.joints.q)[: len(other) - 1].max() < 1e-11 * worse
    assert found.evaluations <= other.evaluations


def test_the_random_runs_have_all_there_is():
    runs = [random_run(seed) for seed in range(64)]
    late = [run["control"].lateness for _, _, run in runs]
    assert sum(rest > 0 for _, rest in late) > 5
    assert sum(whole > 20 for whole, _ in late) > 2
    lagging = [
        machine.parameters.friction and run["control"].drives() is not None for machine, _, run in runs
    ]
    assert sum(map(bool, lagging)) > 3
    assert sum(isinstance(run["wrench"], WrenchHistory) for _, _, run in runs) > 10
    kinds = {type(run["controller"]) for _, _, run in runs if run["control"].rate is None}
    assert {PD, Feedforward, ComputedTorque, Springs} <= kinds


EQUAL = Integration(scheme="rk4")


@pytest.mark.parametrize(
    ("push", "kinds"),
    [([0, 0, 1], KINDS), ([0, 0, 60], KINDS), ([-80, 0, 0], ()), ([40, 40, -20], ("singular pose",))],
)
def test_a_run_that_meets_a_limit_ends_as_in_python(push, kinds, monkeypatch):
    how = {"start": [0.01, 0, 0.02], "controller": push, "stop_at": kinds, "integration": EQUAL}
    other = in_python(ROBOT, 1.0, **how)
    python_is_refused(monkeypatch)
    found = ROBOT.simulate(1.0, method="compiled", **how)
    assert (found.stop.kind, found.stop.reason) == (other.stop.kind, other.stop.reason)
    assert found.stop.time == pytest.approx(other.stop.time, abs=1e-9)
    assert found.time == pytest.approx(other.time, abs=1e-9)


def test_a_limit_that_is_met_within_a_step_is_not_missed():
    """Thrown up, a slider touches its stop for a small part of a step and falls back."""
    thrown = InitialState(velocity=[0, 0.3, 0])
    how = {"start": thrown, "integration": EQUAL, "controller": [5, 5, 5], "stop_at": ("slider stop",)}
    free = in_python(ROBOT, 0.1, samples=10_001, **how)
    top = free.sliders.max(axis=1)
    where = top.argmax()
    assert 0.1 < free.time[where] / 1e-3 % 1 < 0.9
    limits = replace(ROBOT.parameters.limits, travel=(-1.0, top[where] - 1e-9))
    assert top[::100].max() < limits.travel[1]  # no end of a step is beyond it
    machine = p3dof.Manipulator(replace(ROBOT.parameters, limits=limits))
    stopped = machine.simulate(0.1, method="compiled", **how).stop
    assert stopped.kind == "slider stop"
    assert stopped.time == pytest.approx(free.time[where], abs=1e-4)


def test_out_of_reach_and_bad_forces_are_refused():
    for how, error in (({"start": [9, 0, 0]}, ReachError), ({"controller": [1, 2]}, InputError)):
        with pytest.raises(error):
            ROBOT.simulate(0.1, method="compiled", integration=EQUAL, **how)


def test_another_controller_has_its_own_model():
    """Its constants are kept between runs."""
    other = replace(ROBOT.parameters, gravity=[0, 0, -5.0])
    motion = p3dof.paper_motion(1001).from_rest(0.2)
    for model in (ROBOT.parameters, other, ROBOT.parameters):
        how = {
            "controller": ComputedTorque(model, motion),
            "control": ControlLoop(1000),
            "integration": EQUAL,
        }
        found = in_c(ROBOT, 0.02, samples=21, start=motion.pose[0], **how)
        exact = in_python(ROBOT, 0.02, samples=21, start=motion.pose[0], **how)
        assert np.abs(found.forces - exact.forces).max() < 1e-10
    elsewhere = in_c(ROBOT, 0.02, samples=21, start=motion.pose[0], reference=p3dof.paper_motion(11), **how)
    assert not np.array_equal(elsewhere.reference, found.reference)


def test_one_controller_serves_runs_at_many_rates():
    """What it follows is kept between runs of the same ticks, until it follows something else."""
    motion = p3dof.paper_motion(1001).from_rest(0.2)
    controller = PD(ROBOT, motion)
    runs = {}
    for rate, duration, push in (
        (1000, 0.02, 0),
        (500, 0.02, 0),
        (500, 0.03, 0),
        (500, 0.03, 9),
        (1000, 0.02, 0),
    ):
        controller.holding = ROBOT.forces(*np.zeros((3, 3))) + push
        how = {"controller": controller, "control": ControlLoop(rate), "start": motion.pose[0], "samples": 9}
        found = in_c(ROBOT, duration, integration=EQUAL, **how)
        exact = in_python(ROBOT, duration, integration=EQUAL, **how)
        assert np.abs(found.forces - exact.forces).max() < 1e-10
        runs[rate, duration, push] = found.forces
    assert np.abs(runs[500, 0.03, 9] - runs[500, 0.03, 0]).max() > 1


def test_progress_is_told():
    told = []
    ROBOT.simulate(
        0.01,
        method="compiled",
        integration=EQUAL,
        stop_at=(),
        samples=5,
        progress=lambda *done: told.append(done),
    )
    assert told[-1] == (5, 5)


def test_what_equal_steps_in_c_do_not_know_is_done_in_python(monkeypatch):
    def asked(machine=ROBOT, duration=0.1, **how):
        return not any(
            RunOfMachine(machine, duration, **{"method": "compiled", "integration": EQUAL, **how}).obstacles()
        )

    assert asked()
    assert asked(controller=[1, 2, 3], wrench=np.ones(6), control=ControlLoop(100, saturation=True))
    assert asked(controller=Springs(100), control=ControlLoop(100, delay=0.01))
    assert asked(controller=lambda _: [0, 0, 0], control=ControlLoop(100, bandwidth=50, delay=0.005))
    assert asked(integration=Integration(scheme="rk4", step=3e-3), duration=501)
    assert not asked(method="virtual-power")
    assert not asked(controller=lambda _: [0, 0, 0])
    assert not asked(wrench=lambda t: np.full(6, t))
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    assert not asked(p3dof.load())
