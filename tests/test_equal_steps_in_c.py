"""Runs by RK4 in equal steps, in C: against the same in Python."""

import importlib
from dataclasses import replace

import numpy as np
import pytest
from machines import random_machine, random_states
from runs_in_c import around, in_python

import p3dof
from p3dof import PD, ComputedTorque, ControlLoop, Feedforward, Integration, Springs
from p3dof.compiled import levels
from p3dof.errors import InputError, ReachError
from p3dof.parameters import Friction, Limits
from p3dof.simulation import KINDS, InitialState, Noise
from p3dof.simulation.compiled_equal_steps import serves_equal_steps, simulate_equal_steps
from p3dof.simulation.simulate import task_of

pytestmark = pytest.mark.skipif(levels()[-1] == "numpy", reason="the extension was not built")

FIELDS = ("pose", "velocity", "acceleration", "forces", "asked", "sliders", "slider_velocities", "wrench")
ROBOT, simulate_module = p3dof.load(), importlib.import_module("p3dof.simulation.simulate")

DURATION = 0.0503  # no whole number of ticks


def random_run(seed):
    """Return a machine, and the arguments of a short run of it, from a seed."""
    rng = np.random.default_rng([seed, 4])
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 1)
    pose, mass = states.pose[0], parameters.bodies.mass
    sliders = p3dof.Manipulator(parameters).inverse_kinematics(pose).sliders
    room = parameters.geometry.L * np.array([-0.3, 0.3])
    travel = min(sliders.min(), 0) + room[0], max(sliders.max(), 0) + room[1]
    limits = Limits(travel=travel, tilt=(min(pose[2], 0) - 0.5, max(pose[2], 0) + 0.5))
    machine = p3dof.Manipulator(replace(parameters, limits=limits))
    kind = seed % 7
    rate = rng.choice([200.0, 500.0, 1000.0]) if kind >= 3 else [None, 500.0, None][kind]
    controller = [
        rng.normal(0, mass, 3),
        None,
        Springs(mass * np.array([10, 20, 30]), sliders, mass, rng.normal(0, mass, 3)),
        Springs(mass * 20, sliders, mass),
        *(make(parameters, *around(pose, rng)) for make in (PD, Feedforward, ComputedTorque)),
    ][kind]
    more = {}
    if rate and rng.random() < 0.5:
        more = {"noise": Noise(1e-6, 1e-4, seed), "resolution": 1e-6, "differencing": bool(rng.integers(2))}
    if rate and kind != 6 and rng.random() < 0.5:
        more["delay"] = int(rng.integers(1, 4)) / rate
    step = rng.choice([2e-3, 1e-3]) if rate != 200 else 2e-3
    whole = rate and step < 0.999 / rate
    return machine, 0.05 if whole else DURATION, {
        "start": InitialState(pose, 0.2 * states.velocity[0]),
        "controller": controller,
        "control": ControlLoop(rate, saturation=[False, 3 * mass][rng.integers(2)], **more),
        "wrench": [None, rng.normal(0, mass, 6)][rng.integers(2)],
        "stop_at": [kind for kind in KINDS[:2] if rng.random() < 0.5],
        "samples": [rng.integers(2, 60), np.sort(rng.uniform(0, 0.05, 20))][rng.integers(2)],
        "integration": Integration(scheme="rk4", step=step),
    }  # fmt: skip


def in_c(machine, duration, **run):
    task = task_of(machine, duration, method="compiled", **run)
    assert serves_equal_steps(task)
    return simulate_equal_steps(task)


def python_is_refused(monkeypatch):
    def refused(_):
        raise AssertionError("the run was not in C")

    monkeypatch.setattr(simulate_module, "simulate_in_python", refused)


@pytest.mark.parametrize("seed", range(41))
def test_equal_steps_in_c_are_those_in_python(seed, monkeypatch):
    machine, duration, run = random_run(seed)
    other = in_python(machine, duration, **run)
    if not other.finished:
        assert in_c(machine, duration, **run) is None
        return
    python_is_refused(monkeypatch)
    found = machine.simulate(duration, method="compiled", **run)
    assert found.method == other.method
    assert found.finished
    for name in FIELDS:
        one, two = getattr(found, name), getattr(other, name)
        assert one.shape == two.shape
        assert np.abs(one - two).max() <= 1e-12 * max(1, np.abs(two).max()), name
    assert np.array_equal(found.time, other.time)
    assert (found.reference is None) == (other.reference is None)
    assert found.reference is None or np.array_equal(found.reference, other.reference)
    assert np.abs(found.joints.q - other.joints.q).max() < 1e-11
    rate, step = run["control"].rate, run["integration"].step
    ticks, steps = (int(np.ceil(duration * rate - 1e-9)), np.ceil(1 / rate / step - 1e-9)) if rate else (1, 0)
    assert found.evaluations == 4 * ticks * (steps or int(np.ceil(duration / step - 1e-9)))


EQUAL = Integration(scheme="rk4")


@pytest.mark.parametrize(
    ("push", "kinds"),
    [([0, 0, 1], KINDS), ([0, 0, 60], KINDS), ([-80, 0, 0], ()), ([40, 40, -20], ("singular pose",))],
)
def test_a_run_that_meets_a_limit_ends_as_in_python(push, kinds):
    how = {"start": [0.01, 0, 0.02], "controller": push, "stop_at": kinds, "integration": EQUAL}
    assert in_c(ROBOT, 1.0, **how) is None
    found, other = ROBOT.simulate(1.0, method="compiled", **how), in_python(ROBOT, 1.0, **how)
    assert (found.stop.kind, found.stop.reason) == (other.stop.kind, other.stop.reason)
    assert found.stop.time == pytest.approx(other.stop.time, abs=1e-9)
    assert np.array_equal(found.time, other.time)


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
    assert in_c(machine, 0.1, **how) is None
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
        task = task_of(machine, duration, **{"method": "compiled", "integration": EQUAL, **how})
        return serves_equal_steps(task)

    assert asked()
    assert asked(controller=[1, 2, 3], wrench=np.ones(6), control=ControlLoop(100, saturation=True))
    assert asked(controller=Springs(100), control=ControlLoop(100, delay=0.01))
    assert not asked(integration=Integration())
    assert not asked(integration=Integration(scheme="rk4", step=3e-3))
    assert not asked(method="virtual-power")
    assert not asked(controller=lambda _: [0, 0, 0], control=ControlLoop(100))
    assert not asked(wrench=lambda t: np.full(6, t))
    assert not asked(control=ControlLoop(100, delay=0.005))
    assert not asked(control=ControlLoop(100, bandwidth=50))
    assert not asked(duration=501)
    assert not asked(duration=0.1005, control=ControlLoop(100))
    rough = replace(ROBOT.parameters, friction=Friction({"slide_a": 1.0}))
    assert not asked(p3dof.Manipulator(rough))
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    assert not asked(p3dof.load())
