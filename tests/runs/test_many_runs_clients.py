"""Many runs by the workers of a client: the same bits as of this process, whoever makes them."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import p3dof
from p3dof import PAPER
from p3dof._base import blocks
from p3dof._base.errors import InputError, SweepError
from p3dof.closed_form.compiled import levels
from p3dof.runs import PD, ComputedTorque, ControlLoop, Noise
from p3dof.runs.many import running

ROBOT = p3dof.load()
MOTION = p3dof.paper_motion(201).from_rest(0.2)
HOLD = np.array([46.7, 46.7, 53.6])
NOISY = ControlLoop(1000, noise=Noise(1e-6, 1e-4, seed=3))
FIGURES = ("stop", "time", "pose", "velocity", "peak_error", "rms_error", "peak_force", "rms_force", "energy")

compiled = pytest.mark.skipif(len(levels()) == 1, reason="needs the extension")


def columns(count):
    rng = np.random.default_rng(2)
    found = {
        "L": PAPER.geometry.L + rng.normal(0, 5e-5, count),
        "payload.com.y": np.where(rng.random(count) < 0.5, 0.0, 0.01),  # some machines are symmetric
        "payload.mass": 0.2,
        "friction.viscous.sliders": np.where(rng.random(count) < 0.5, 0.0, 3.0),
        "start.y [mm]": rng.normal(0, 0.5, count),
        "frequency": rng.uniform(4, 8, count),
    }
    found["start.y [mm]"][count // 3] = np.nan
    found["L"][count // 2] = -1
    return found


def same(one, other):
    assert list(one.given) == list(other.given)
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.fixture(scope="module")
def workers():
    with blocks.Processes(2) as found:
        yield found


@compiled
@pytest.mark.parametrize("kind", [PD, ComputedTorque])
def test_workers_make_the_same_bits(workers, monkeypatch, kind):
    monkeypatch.setattr(running, "_SENT", 2000)  # some parts
    told = []
    options = {"controller": kind(PAPER, MOTION), "control": NOISY, "start": MOTION.pose[0]}
    options |= {"histories": [2, 3, 100, 199], "every": 3}
    here = ROBOT.simulate_many(0.05, columns(200), **options)
    there = ROBOT.simulate_many(
        0.05, columns(200), **options, client=workers, progress=lambda *now: told.append(now)
    )
    same(here, there)
    assert here.counts() == {"finished": 198, "not a number": 1, "impossible machine": 1}
    for run in (2, 3, 100, 199):
        if here.finished[run]:
            for name, states in here.history(run).items():
                np.testing.assert_array_equal(states, there.history(run)[name])
    assert len(told) > 2
    assert told[-1] == (200, 200)


def hold(measured):
    """A controller written in Python."""
    return [46.0, 46.0, 53.0] - 500 * measured.sliders


def test_controllers_in_python_go_to_workers(workers, monkeypatch):
    monkeypatch.setattr(running, "_SENT", 60)
    options = {"controller": hold, "control": ControlLoop(500, noise=Noise(1e-6, 1e-4, seed=3))}
    here = ROBOT.simulate_many(0.01, {"start.y": [0.0, 0.001, 0.002, 5.0]}, **options)
    there = ROBOT.simulate_many(0.01, {"start.y": [0.0, 0.001, 0.002, 5.0]}, **options, client=workers)
    same(here, there)
    assert here.note == there.note == "one by one: the controller is Python"


@compiled
def test_parts_of_a_dead_worker_are_made_again(monkeypatch):
    monkeypatch.setattr(running, "_SENT", 3000)
    options = {"controller": PD(PAPER, MOTION), "control": NOISY}
    killed = []

    def kill(done, _):
        if done > 100 and not killed:
            killed.append(client.pids[0])
            os.kill(killed[0], signal.SIGKILL)

    with blocks.Processes(1) as client:
        there = ROBOT.simulate_many(0.02, columns(600), **options, client=client, progress=kill)
    assert killed
    same(ROBOT.simulate_many(0.02, columns(600), **options), there)


def die(_measured):
    os._exit(1)


def test_runs_that_kill_every_worker_are_given_up(monkeypatch):
    monkeypatch.setattr(running, "DEATHS", 0)
    with blocks.Processes(1) as client, pytest.raises(SweepError, match="workers died while run 0"):
        ROBOT.simulate_many(0.01, 2, controller=die, control=ControlLoop(1000), client=client)


@compiled
@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_returns_what_the_workers_made(workers, monkeypatch):
    monkeypatch.setattr(running, "_SENT", 3000)

    def progress(done, _):
        if done > 200:
            signal.raise_signal(signal.SIGINT)

    found = ROBOT.simulate_many(0.02, 2000, controller=HOLD, client=workers, progress=progress)
    assert found.interrupted
    assert 200 < found.done.sum() < 2000
    assert found.finished.sum() == found.done.sum()
    assert np.isnan(found.pose[~found.done]).all()


def test_what_cannot_be_sent_is_one_clear_error(workers):
    with pytest.raises(InputError, match="controller and wrench: expected what can be pickled"):
        ROBOT.simulate_many(0.01, 2, controller=lambda _: HOLD, control=NOISY, client=workers)
    with pytest.raises(InputError, match=r"client: expected a distributed\.Client, an executor"):
        ROBOT.simulate_many(0.01, 2, client=5)


@compiled
def test_errors_of_workers_come_through_as_they_are(monkeypatch):
    def fail(_):
        raise InputError("level: this processor has none of them")

    monkeypatch.setattr(running, "_make", fail)
    with ThreadPoolExecutor(1) as client, pytest.raises(InputError, match="this processor has none"):
        ROBOT.simulate_many(0.01, 2, controller=HOLD, client=client)
