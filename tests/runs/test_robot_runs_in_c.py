"""Runs of any robot that are made in C, against the integrator in Python and the general layer."""

from __future__ import annotations

import gc
import signal
import threading
import weakref
from dataclasses import replace
from functools import cache

import closed_loop_robots as robots
import closed_trees as trees
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT

import p3dof
from p3dof._base.errors import ControllerError, InputError, ModelWarning
from p3dof.loops import ClosedLoopModel, JointData
from p3dof.loops.compiled import build, runs
from p3dof.loops.compiled.adaptive import AdaptiveRun
from p3dof.runs import (
    ControlLoop,
    Event,
    Integration,
    JointComputedTorque,
    JointFeedforward,
    JointPD,
    JointReference,
    Noise,
    simulate_robot,
    simulate_robot_many,
)
from p3dof.runs.compiled_robot_runs import runs_of
from p3dof.runs.integration import Integrator
from p3dof.runs.robots import RunOfRobot

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler here")
EXACT = Integration(rtol=1e-12, atol=1e-14)
ABOVE_ROUNDING = Integration(rtol=1e-8, atol=1e-10)
"""Where the error of a step, from which the next follows, is not rounding, which differs by processor."""


def steps(step=1e-3):
    return Integration(scheme="rk4", step=step, stabilisation=0.0)


@cache
def kept(name):
    loop = p3dof.load_robot(ROOT / f"docs/_static/gallery/{name}.urdf")
    return loop, loop.compile()


def home_of(loop):
    q = loop.assemble().q
    return q, np.array([q[loop.model.joints[loop.model.getJointId(name)].idx_q] for name in loop.actuated])


@pytest.fixture
def in_c(monkeypatch):
    """Counts the runs that are made in C to their end."""
    made, own = [], RunOfRobot.in_c

    def call(self):
        found = own(self)
        made.append(not isinstance(found, str))
        return found

    monkeypatch.setattr(RunOfRobot, "in_c", call)
    return made


def swinging(home):
    time = np.linspace(0.0, 0.4, 41)
    return JointReference(time, home + 0.05 * np.sin(8 * time[:, None] + np.arange(len(home))))


CONTROLLERS = {
    "pd": lambda loop, wanted: JointPD(loop, wanted, 60.0, 4.0),
    "gravity": lambda loop, wanted: JointPD(loop, wanted, 60.0, 4.0, gravity=True),
    "computed": lambda loop, wanted: JointComputedTorque(loop, wanted, 900.0, 60.0),
    "feedforward": lambda loop, wanted: JointFeedforward(
        loop, wanted, [0.0, 0.1, 0.3], [[1.0, -1.0], [2.0, 0.5], [0.0, 0.0]], 50.0, 3.0
    ),
    "another": lambda loop, wanted: JointComputedTorque(heavier(loop), wanted, 900.0, 60.0),
    "called": lambda _, wanted: lambda seen: 60.0 * (wanted.at(seen.time)[0] - seen.positions),
    "constant": lambda *_: np.array([0.1, -0.2]),
}


def heavier(loop):
    other = loop.copy()
    for i in range(1, other.model.njoints):
        body = other.model.inertias[i]
        body.mass = 1.3 * body.mass
    return other


@pytest.mark.parametrize("name", CONTROLLERS)
def test_it_is_the_run_of_the_integrator_in_python(in_c, name):
    loop, compiled = kept("five_bar")
    q, home = home_of(loop)
    wanted = swinging(home)
    control = ControlLoop(200.0, saturation=3.0) if name != "constant" else ControlLoop(saturation=0.5)
    start = loop.complete(*wanted.at(0.0), q)
    duration = 0.15 if name == "constant" else 0.4  # it falls
    acting = CONTROLLERS[name](loop, wanted)
    options = {"controller": acting, "control": control, "samples": 47, "stop_at": ()}
    found, python, exact = (
        simulate_robot(loop, duration, start.q, start.v, **options, integration=of, method=method)
        for of, method in ((steps(), compiled), (steps(), "general"), (EXACT, "general"))
    )
    assert in_c == [True]
    assert len(found) == len(python) == 47
    np.testing.assert_array_equal(found.time, python.time)
    for attribute, allowed in (("q", 1e-9), ("v", 1e-8), ("a", 1e-6), ("forces", 1e-7), ("asked", 1e-7)):
        mine, theirs, truth = (getattr(run, attribute) for run in (found, python, exact))
        size = max(1.0, np.abs(truth).max())
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=allowed * size, err_msg=attribute)
        np.testing.assert_allclose(mine, truth, rtol=0, atol=allowed * size, err_msg=attribute)
    assert found.gap.max() < 1e-14
    assert found.stop is None
    assert np.abs(found.forces).max() <= 3.0


def test_its_error_is_of_order_four():
    loop, compiled = kept("five_bar")
    q, _ = home_of(loop)
    exact = simulate_robot(loop, 0.2, q, integration=EXACT, samples=5, method="general")
    errors = []
    for step in (8e-3, 4e-3, 2e-3):
        run = simulate_robot(loop, 0.2, q, integration=steps(step), samples=5, method=compiled)
        errors.append(np.abs(run.q[-1] - exact.q[-1]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-6
    assert (np.abs(orders - 4) < 0.4).all(), orders


@pytest.mark.slow
def test_loops_stay_closed_over_ten_seconds(in_c):
    loop, compiled = kept("stewart")
    q, home = home_of(loop)
    time = np.linspace(0, 10, 201)
    wanted = JointReference(time, home + 0.02 * np.sin(3 * time[:, None] + np.arange(6)))
    start = loop.complete(*wanted.at(0.0), q)
    stay = JointPD(loop, wanted, 2e4, 1500.0)
    run = simulate_robot(
        loop, 10.0, start.q, start.v, stay, control=ControlLoop(1000.0), integration=steps(), method=compiled
    )
    assert in_c == [True]
    assert run.finished
    assert run.gap.max() < 1e-12
    assert np.abs(run.error).max() < 0.02
    for i in (100, 700):
        assert np.abs(loop.closure_jacobian(run.q[i]) @ run.v[i]).max() < 1e-12
        back = loop.forward_dynamics(run.q[i], run.v[i], run.forces[i])
        np.testing.assert_allclose(run.a[i], back.a, rtol=0, atol=1e-9 * np.abs(back.a).max())


@pytest.mark.parametrize("seed", [11, 20, 47])
def test_any_closed_tree_moves_likewise(seed):
    loop = trees.random_robot(seed, joints=4 + seed % 3, loops=1 + seed % 2, several=0.3 * (seed % 2))
    if loop is None:
        pytest.skip("it has no closed configuration")
    moving = trees.motions(loop, 1, seed)
    compiled = loop.compile(around=moving.q[0])
    forces = np.linspace(-1, 1, len(loop.actuated))
    options = {"controller": forces, "stop_at": (), "samples": 8}
    found, exact = (
        simulate_robot(loop, 0.05, moving.q[0], moving.v[0], **options, integration=of, method=method)
        for of, method in ((steps(2e-4), compiled), (EXACT, "general"))
    )
    assert len(found) == len(exact)
    np.testing.assert_allclose(found.q, exact.q, rtol=0, atol=2e-8 * max(1.0, np.abs(exact.v).max()))
    assert found.gap.max() < 1e-12


def limited(loop, name, lower, upper):
    other = ClosedLoopModel(loop.model.copy(), loop.sidecar)
    at = other.model.joints[other.model.getJointId(name)].idx_q
    low, high = np.array(other.model.lowerPositionLimit), np.array(other.model.upperPositionLimit)
    low[at], high[at] = lower, upper
    other.model.lowerPositionLimit, other.model.upperPositionLimit = low, high
    return other


@pytest.mark.parametrize("control", [ControlLoop(), ControlLoop(40.0)])
def test_it_ends_where_a_joint_reaches_a_limit(in_c, control):
    loop, _ = kept("five_bar")
    q, home = home_of(loop)
    stay = JointPD(loop, home + 0.2, 4.0, 0.05) if control.rate else None
    free = simulate_robot(
        loop, 0.4, q, controller=stay, control=control, integration=EXACT, samples=401, method="general"
    )
    at = free.actuated[:, 0]
    turn = int(np.argmax(np.abs(at - at[0])))
    for share, inside in ((0.5, None), (1.0, 1e-7)):  # on the way, and just before it turns round
        value = (
            at[0]
            + share * (at[turn] - at[0])
            - (0.0 if inside is None else inside * np.sign(at[turn] - at[0]))
        )
        side = (-9.0, value) if at[turn] > at[0] else (value, 9.0)
        other = limited(loop, loop.actuated[0], *side)
        options = {"controller": stay, "control": control, "samples": 9, "stop_at": ["joint limit"]}
        found, python = (
            simulate_robot(other, 0.4, q, **options, integration=steps(2e-4), method=method)
            for method in ("compiled", "general")
        )
        assert str(found.stop) == str(python.stop)
        assert found.stop.kind == "joint limit"
        assert found.stop.time == pytest.approx(python.stop.time, abs=1e-9 if inside is None else 2e-5)
        assert len(found) == len(python)
        assert found.time[-1] == found.stop.time
        assert abs(found.actuated[-1, 0] - value) < 1e-10
        np.testing.assert_allclose(found.v[-1], python.v[-1], rtol=0, atol=1e-3)
    assert in_c == [True, True]


def test_near_a_singular_partition_the_robot_itself_goes_on(in_c):
    bar = kept("four_bar")[0]
    loop = ClosedLoopModel(bar.model, replace(bar.sidecar, actuated=("rocker_joint",)))
    q = loop.assemble().q
    free = trees.free(loop, q)[:, 0]
    v = 6.0 * free / free[0]
    options = {"samples": 21, "stop_at": ()}
    found, exact = (
        simulate_robot(loop, 0.6, q, v, **options, integration=of, method=method)
        for of, method in ((steps(2e-4), "compiled"), (EXACT, "general"))
    )
    assert in_c == [False]  # the crank passes where rod and rocker are in line
    np.testing.assert_allclose(found.q, exact.q, rtol=0, atol=1e-7)


def test_what_has_no_compiled_form_goes_the_other_way(in_c):
    loop = kept("five_bar")[0]
    q, home = home_of(loop)
    stay = JointPD(loop, home + 0.05, 60.0, 4.0)
    for options in (
        {"control": ControlLoop(200.0, delay=0.002)},
        {"control": ControlLoop(200.0, bandwidth=50.0)},
        {"control": ControlLoop()},
        {"external": {loop.model.frames[loop.model.nframes - 1].name: lambda t: [0, 0, -t, 0, 0, 0]}},
        {"events": [Event("up", lambda t, *_: t - 0.05)], "control": ControlLoop(200.0)},
    ):
        runs_ = [
            simulate_robot(loop, 0.1, q, controller=stay, samples=5, integration=steps(), method=m, **options)
            for m in ("compiled", "general")
        ]
        np.testing.assert_allclose(runs_[0].q, runs_[1].q, rtol=0, atol=1e-9)
    assert in_c == []


def test_encoders_and_controllers_in_python_see_what_they_would(in_c):
    loop = kept("five_bar")[0]
    q, home = home_of(loop)
    stay = JointPD(loop, home + 0.05, 60.0, 4.0)
    control = ControlLoop(200.0, noise=Noise(1e-4, 1e-2, 7), resolution=1e-3, differencing=True)
    wrench = {loop.model.frames[loop.model.nframes - 1].name: [0, 0, -2.0, 0, 0, 0]}
    found, python = (
        simulate_robot(
            loop,
            0.2,
            q,
            controller=stay,
            control=control,
            external=wrench,
            samples=17,
            integration=steps(),
            method=m,
        )
        for m in ("compiled", "general")
    )
    assert in_c == [True]
    np.testing.assert_allclose(found.asked, python.asked, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.q, python.q, rtol=0, atol=1e-10)


def test_a_controller_that_fails_leaves_the_run_so_far():
    loop, compiled = kept("five_bar")

    def fails(seen):
        if seen.time > 0.05:
            raise ValueError("no more")
        return np.zeros(2)

    for method in (compiled, "general"):
        with pytest.raises(ControllerError, match=r"failed at t = 0\.055 s: no more") as caught:
            simulate_robot(
                loop,
                0.2,
                controller=fails,
                control=ControlLoop(200.0),
                samples=41,
                integration=steps(),
                method=method,
            )
        assert caught.value.run.time[-1] == pytest.approx(0.05)
        assert caught.value.run.stop.kind == "controller"


def test_springs_and_damping_act():
    bar, _ = kept("five_bar")
    data = tuple(JointData(name, stiffness=3.0, rest=0.2, damping=0.1, friction=0.0) for name in bar.actuated)
    loop = ClosedLoopModel(bar.model, replace(bar.sidecar, joint_data=data))
    q, _ = home_of(loop)
    found, exact = (
        simulate_robot(loop, 0.2, q, samples=5, integration=of, method=method)
        for of, method in ((steps(2e-4), "compiled"), (EXACT, "general"))
    )
    np.testing.assert_allclose(found.q, exact.q, rtol=0, atol=1e-8)


def test_runs_side_by_side_do_not_know_each_other():
    loop, compiled = kept("five_bar")
    q, home = home_of(loop)
    made = runs_of(compiled, compiled)
    count, ticks = 13, 40
    rng = np.random.default_rng(0)
    plan = runs.StepPlan(
        np.linspace(0, 0.2, 81),
        np.tile(np.array([1, 0], dtype=np.uint8), 40),
        np.arange(0, 80, 9),
        np.zeros(9),
    )
    plan.sample_share[3] = 0.4
    rows = [home + 0.1 * rng.normal(size=(ticks, 2)), np.zeros((ticks, 2)), np.zeros((ticks, 2))]
    given = {
        "q": np.tile(q, (count, 1)),
        "v": np.zeros((count, 2)),
        "kp": rng.uniform(10, 60, (count, 2)),
        "kd": rng.uniform(1, 4, (count, 2)),
        "most": np.array([2.0, 3.0]),
    }
    given["q"][4] = np.nan
    given["kp"][7] = np.inf
    limit = runs.Limited(np.array([0], dtype=np.int32), np.array([home[0] - 0.004]), np.array([9.0]))
    together = made.prepare(plan, given, rows, limit, runs.PD_WITH_GRAVITY, 9).run(threads=2)
    assert together.reason[4] == runs.DOUBTFUL
    assert len(set(together.reason.tolist())) == 3
    for i in range(count):
        one = {name: array if array.ndim == 1 else array[i : i + 1] for name, array in given.items()}
        alone = made.prepare(plan, one, rows, limit, runs.PD_WITH_GRAVITY, 9).run()
        assert alone.reason[0] == together.reason[i]
        assert alone.samples[0] == together.samples[i]
        if alone.reason[0] != runs.DOUBTFUL:
            assert alone.time[0] == pytest.approx(together.time[i], abs=1e-13)
            for name in ("q", "v", "peak_force", "square_force", "peak_error", "square_error"):
                mine, theirs = getattr(together, name)[i], getattr(alone, name)[0]
                np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-12, err_msg=name)
            for name, array in together.past.items():
                np.testing.assert_allclose(array[i], alone.past[name][0], rtol=1e-11, atol=1e-11)


# Many runs


def test_many_runs_are_each_the_run_alone():
    loop = kept("five_bar")[0]
    q, home = home_of(loop)
    wanted = swinging(home)
    start = loop.complete(*wanted.at(0.0), q)
    stay = JointPD(loop, wanted, 60.0, 4.0, gravity=True)
    joint = str(loop.model.names[2])
    body = loop.model.inertias[2].toDynamicParameters()
    tip = loop.model.frames[loop.model.nframes - 1].name
    count, rng = 11, np.random.default_rng(2)
    columns = {
        "q": start.q,
        "v": start.v,
        "kp": rng.uniform(20, 80, (count, 2)),
        "kd": [3.0, 4.0],
        "saturation": rng.uniform(0.5, 3, (count, 2)),
        f"inertia.{joint}": body * rng.uniform(0.8, 1.2, (count, 1)),
        f"external.{tip}": rng.normal(0, 1, (count, 6)),
    }
    seen = []
    control = ControlLoop(200.0)
    found = simulate_robot_many(
        loop, 0.3, columns, stay, control=control, samples=7, progress=lambda *n: seen.append(n), stop_at=()
    )
    assert seen[-1] == (count, count)
    assert found.finished.all()
    assert not found.general.any()
    assert found.gap.max() < 1e-9
    for i in (0, 6, 10):
        other = loop.copy()
        other.model.inertias[2] = pin.Inertia.FromDynamicParameters(columns[f"inertia.{joint}"][i])
        acting = JointPD(loop, wanted, columns["kp"][i], [3.0, 4.0], gravity=True)
        alone = simulate_robot(
            other,
            0.3,
            start.q,
            start.v,
            acting,
            control=replace(control, saturation=columns["saturation"][i]),
            external={tip: columns[f"external.{tip}"][i]},
            samples=7,
            stop_at=(),
            integration=steps(),
            method="general",
        )
        for name in ("q", "v", "forces", "asked"):
            np.testing.assert_allclose(found.past[name][i], getattr(alone, name), rtol=0, atol=1e-7)
        np.testing.assert_allclose(found.q[i], alone.q[-1], rtol=0, atol=1e-9)
        fine = simulate_robot(
            other,
            0.3,
            start.q,
            start.v,
            acting,
            control=replace(control, saturation=columns["saturation"][i]),
            external={tip: columns[f"external.{tip}"][i]},
            samples=61,
            stop_at=(),
            integration=steps(),
            method="general",
        )
        np.testing.assert_allclose(found.peak_force[i], np.abs(fine.forces[:-1]).max(axis=0), rtol=1e-6)
        np.testing.assert_allclose(found.rms_force[i] ** 2, np.mean(fine.forces[:-1] ** 2, axis=0), rtol=1e-6)
        np.testing.assert_allclose(found.rms_error[i] ** 2, np.mean(fine.error[:-1] ** 2, axis=0), rtol=1e-6)


def test_many_runs_end_at_limits_or_by_the_robot_itself():
    bar = kept("four_bar")[0]
    loop = ClosedLoopModel(bar.model, replace(bar.sidecar, actuated=("rocker_joint",)))
    q = loop.assemble().q
    free = trees.free(loop, q)[:, 0]
    speeds = np.array([6.0, 5.0, 30.0])
    columns = {"q": q, "v": speeds[:, None] * free / free[0]}
    told = []
    found = simulate_robot_many(
        loop,
        0.3,
        columns,
        stop_at=(),
        samples=6,
        control=ControlLoop(),
        integration=steps(2e-4),
        progress=lambda *done: told.append(done),
    )
    assert found.general.tolist() == [False, False, True]
    assert told == [(2, 3), (3, 3)]  # one of the block was not to be trusted
    for i, v in enumerate(columns["v"]):
        exact = simulate_robot(loop, 0.3, q, v, samples=6, stop_at=(), integration=EXACT, method="general")
        np.testing.assert_allclose(found.past["q"][i], exact.q, rtol=0, atol=1e-6)
    five, _ = kept("five_bar")
    q, home = home_of(five)
    way = np.sign(simulate_robot(five, 0.05, q, samples=2, method="general").actuated[-1, 0] - home[0])
    side = (-9.0, home[0] + 0.05) if way > 0 else (home[0] - 0.05, 9.0)
    other = limited(five, five.actuated[0], *side)
    runs_ = simulate_robot_many(other, 0.4, {"forces": [[0.0, 0.0], [0.1, 0.0]]}, samples=5)
    assert all(stop.kind == "joint limit" for stop in runs_.stop)
    one = simulate_robot(other, 0.4, controller=[0.1, 0.0], integration=steps(), method="general")
    assert runs_.stop[1].time == pytest.approx(one.stop.time, abs=1e-9)
    assert runs_.stop[1].reason == one.stop.reason
    assert np.isnan(runs_.past["q"][1, -1]).all()
    closed = limited(five, five.actuated[0], home[0] - 9.0, home[0])  # at its limit, it may be held or leave
    at_end = simulate_robot_many(closed, 0.01, {"forces": [[50.0, 0.0], [-50.0, 0.0]]}, samples=3)
    assert [stop is None for stop in at_end.stop] == [False, True]
    assert at_end.stop[0].time < 1e-3


def test_without_a_compiler_the_robot_makes_all_runs_itself(monkeypatch):
    monkeypatch.setattr(build, "compiler", lambda: None)
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/four_bar.urdf")
    with pytest.warns(ModelWarning, match="no C compiler"):
        found = simulate_robot_many(loop, 0.02, {"forces": [[0.0], [0.1]]}, samples=3)
    assert found.general.all()
    exact = simulate_robot(loop, 0.02, controller=[0.1], integration=EXACT, samples=3, method="general")
    np.testing.assert_allclose(found.past["q"][1], exact.q, rtol=0, atol=1e-9)


def test_what_is_done_is_kept_when_it_is_interrupted():
    loop = kept("five_bar")[0]
    seen = []

    def interrupt(done, total):
        seen.append((done, total))
        raise KeyboardInterrupt

    found = simulate_robot_many(
        loop, 0.01, {"forces": np.zeros((300, 2))}, stop_at=(), progress=interrupt, threads=1
    )
    assert seen == [(256, 300)]
    assert found.finished.sum() == 256
    assert found.stop[-1].kind == "interrupted"
    assert np.isnan(found.q[-1]).all()


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({}, "a row for each run"),
        ({"kp": 1.0}, "kp: expected shape"),
        ({"gain": np.ones((2, 2))}, "columns: expected q, v, kp"),
        ({"kp": -np.ones((2, 2))}, "kp: expected zero or more"),
        ({"kp": np.ones((2, 2)), "kd": np.ones((3, 2))}, "kd: expected shape"),
        ({"q": np.zeros((2, 4))}, "q: the loops of run 0 are open"),
        ({"v": np.ones((2, 4))}, "v: that of run 0 opens the loops"),
        ({"external.nowhere": np.ones((2, 6))}, "columns: expected"),
    ],
)
def test_columns_that_do_not_fit_are_refused(columns, told):
    with pytest.raises(InputError, match=told):
        simulate_robot_many(kept("five_bar")[0], 0.1, columns)


# Adaptive steps


def by_scipy(monkeypatch, *arguments, **options):
    """The same run with compiled accelerations, integrated in Python."""
    with monkeypatch.context() as patch:
        patch.setattr(RunOfRobot, "in_c", lambda *_: "asked for")
        return simulate_robot(*arguments, **options)


@pytest.mark.parametrize(
    "name", ["pd", "gravity", "computed", "feedforward", "called", "standing", "falling"]
)
def test_adaptive_steps_are_those_of_scipy(in_c, monkeypatch, name):
    loop, compiled = kept("five_bar")
    q, home = home_of(loop)
    wanted = swinging(home)
    start = loop.complete(*wanted.at(0.0), q)
    control = ControlLoop() if name in ("standing", "falling") else ControlLoop(100.0, saturation=3.0)
    acting = {
        **CONTROLLERS,
        "standing": lambda *_: JointPD(loop, home + 0.05, 60.0, 4.0, gravity=True),
        "falling": lambda *_: None,
    }[name](loop, wanted)
    tip = loop.model.frames[loop.model.nframes - 1].name
    options = {
        "controller": acting,
        "control": control,
        "samples": 34,
        "stop_at": (),
        "external": {tip: [0, 0.5, -1.0, 0, 0, 0]} if name == "standing" else None,
        "method": "compiled" if name == "standing" else compiled,
        "integration": ABOVE_ROUNDING,
    }
    found = simulate_robot(loop, 0.25, start.q, start.v, **options)
    python = by_scipy(monkeypatch, loop, 0.25, start.q, start.v, **options)
    assert in_c == [True]
    assert len(found) == len(python) == 34
    assert found.evaluations == python.evaluations
    for attribute, allowed in (("q", 1e-10), ("v", 1e-9), ("a", 1e-6), ("forces", 1e-8), ("gap", 1e-10)):
        mine, theirs = getattr(found, attribute), getattr(python, attribute)
        size = max(1.0, np.abs(theirs).max())
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=allowed * size, err_msg=attribute)


@pytest.mark.parametrize("name", ["pd", "computed", "called"])
def test_short_holds_are_taken_at_once_in_both(in_c, monkeypatch, name):
    """In as many evaluations, half of what DOP853 alone takes; the states are its own."""
    loop, compiled = kept("five_bar")
    q, home = home_of(loop)
    wanted = swinging(home)
    start = loop.complete(*wanted.at(0.0), q)
    options = {
        "controller": CONTROLLERS[name](loop, wanted),
        "control": ControlLoop(1000.0),
        "samples": 11,
        "stop_at": (),
        "method": compiled,
        "integration": ABOVE_ROUNDING,
    }
    found = simulate_robot(loop, 0.1, start.q, start.v, **options)
    python = by_scipy(monkeypatch, loop, 0.1, start.q, start.v, **options)
    monkeypatch.setattr(Integrator, "_at_once", lambda _, solver: solver)
    alone = by_scipy(monkeypatch, loop, 0.1, start.q, start.v, **options)
    assert in_c == [True]
    assert found.evaluations == python.evaluations < 0.6 * alone.evaluations
    for attribute, allowed in (("q", 1e-12), ("v", 1e-11), ("forces", 1e-10), ("gap", 1e-12)):
        mine, theirs, plain = (getattr(run, attribute) for run in (found, python, alone))
        size = max(1.0, np.abs(plain).max())
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=allowed * size, err_msg=attribute)
        np.testing.assert_allclose(mine, plain, rtol=0, atol=allowed * size, err_msg=attribute)


@pytest.mark.parametrize("control", [ControlLoop(), ControlLoop(40.0)])
def test_adaptive_runs_end_at_limits_when_those_of_scipy_do(in_c, monkeypatch, control):
    loop, _ = kept("five_bar")
    q, home = home_of(loop)
    stay = JointPD(loop, home + 0.2, 4.0, 0.05) if control.rate else None
    free = simulate_robot(loop, 0.4, q, controller=stay, control=control, samples=4001, method="general")
    at = free.actuated[:, 0]
    turn = int(np.argmax(np.abs(at - at[0])))
    for share, inside in ((0.3, 0.0), (0.7, 0.0), (1.0, 1e-6)):
        way = at[turn] - at[0]
        value = at[0] + share * way - inside * np.sign(way)
        other = limited(loop, loop.actuated[0], *((-9.0, value) if way > 0 else (value, 9.0)))
        options = {"controller": stay, "control": control, "samples": 9, "method": "compiled"}
        found = simulate_robot(other, 0.4, q, **options)
        python = by_scipy(monkeypatch, other, 0.4, q, **options)
        assert found.stop.reason == python.stop.reason
        assert found.stop.time == pytest.approx(python.stop.time, abs=1e-9)
        assert len(found) == len(python)
        np.testing.assert_allclose(found.q[-1], python.q[-1], rtol=0, atol=1e-9)
    assert in_c == [True] * 3


@pytest.mark.parametrize("seed", [20, 47])
def test_any_closed_tree_falls_as_by_scipy(in_c, monkeypatch, seed):
    loop = trees.random_robot(seed, joints=4 + seed % 3, loops=1 + seed % 2, several=0.3 * (seed % 2))
    moving = trees.motions(loop, 1, seed)
    options = {"stop_at": (), "samples": 5, "method": loop.compile(around=moving.q[0])}
    options["integration"] = ABOVE_ROUNDING
    found = simulate_robot(loop, 0.03, moving.q[0], moving.v[0], **options)
    python = by_scipy(monkeypatch, loop, 0.03, moving.q[0], moving.v[0], **options)
    assert in_c == [True]
    np.testing.assert_allclose(found.q, python.q, rtol=0, atol=1e-9)
    assert found.evaluations == python.evaluations


@pytest.mark.parametrize("stop_at", [(), ("singular closures",)])
def test_the_robot_itself_gives_rates_near_a_singular_partition(in_c, monkeypatch, stop_at):
    bar = kept("four_bar")[0]
    loop = ClosedLoopModel(bar.model, replace(bar.sidecar, actuated=("rocker_joint",)))
    q = loop.assemble().q
    asked, own = [], RunOfRobot.decided
    monkeypatch.setattr(RunOfRobot, "decided", lambda *given: asked.append(given) or own(*given))
    options = {"samples": 13, "stop_at": stop_at, "method": "compiled", "integration": ABOVE_ROUNDING}
    found = simulate_robot(loop, 0.6, q, **options)
    python = by_scipy(monkeypatch, loop, 0.6, q, **options)
    assert in_c == [True]
    assert 0 < len(asked) < 0.1 * found.evaluations
    assert found.evaluations == python.evaluations
    np.testing.assert_allclose(found.q, python.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.a, python.a, rtol=0, atol=1e-6 * np.abs(python.a).max())


def test_closures_that_become_dependent_end_it_as_ever(monkeypatch):
    """A parallelogram that unfolds comes to a line, where it may go on in two ways."""
    loop = p3dof.ClosedLoopModel.from_urdf(robots.four_bar(0.4, 0.3, 0.4, 0.3), robots.FOUR_BAR_SIDECAR)
    q = loop.assemble([0.5]).q
    free = trees.free(loop, q)[:, 0]
    options = {"samples": 5, "stop_at": ["singular closures"], "method": "compiled"}
    found = simulate_robot(loop, 1.0, q, -2.0 * free / free[0], **options)
    python = by_scipy(monkeypatch, loop, 1.0, q, -2.0 * free / free[0], **options)
    assert str(found.stop) == str(python.stop)
    assert found.stop.kind == "singular closures"
    assert found.stop.time == pytest.approx(python.stop.time, abs=1e-9)


def test_many_runs_with_noise_have_seeds_of_their_own(in_c):
    loop, compiled = kept("five_bar")
    home = home_of(loop)[1]
    control = ControlLoop(200.0, noise=Noise(1e-4, 1e-2))
    stay = JointPD(loop, home + 0.02, 60.0, 4.0)
    found = simulate_robot_many(
        loop, 0.1, {"seed": [[3], [4]]}, stay, control=control, samples=5, integration=steps()
    )
    assert in_c == [True, True]
    assert not found.general.any()
    for i, seed in enumerate((3, 4)):
        alone = simulate_robot(
            loop,
            0.1,
            controller=stay,
            control=replace(control, noise=Noise(1e-4, 1e-2, seed)),
            samples=5,
            integration=steps(),
            method=compiled,
        )
        np.testing.assert_allclose(found.past["q"][i], alone.q, rtol=0, atol=1e-12)
    assert np.abs(found.q[0] - found.q[1]).max() > 1e-7


def test_what_is_no_robot_is_refused():
    with pytest.raises(InputError, match="loop: expected a ClosedLoopModel"):
        simulate_robot_many("robot", 0.1, {})
    with pytest.raises(InputError, match="expected the scheme 'rk4'"):
        simulate_robot_many(kept("five_bar")[0], 0.1, {}, integration=EXACT)


@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_ends_a_run_that_is_deep_in_c(in_c):
    """A run without ticks is one call of C: it looks whether to go on, and tells how far it is."""
    loop = kept("four_bar")[0]
    going, seen = threading.Event(), []

    def progress(done, total):
        seen.append((done, total))
        going.set()

    def interrupt():
        going.wait(60)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            simulate_robot(loop, 1e7, samples=3, progress=progress)
    finally:
        thread.join()
    assert set(seen) == {(1, 3)}

    def fail(*_):
        raise OSError("the terminal is gone")

    with pytest.raises(OSError, match="the terminal is gone"):
        simulate_robot(loop, 1e7, samples=3, progress=fail)
    assert in_c == []
    assert simulate_robot(loop, 20.0, samples=3, progress=progress).finished
    assert seen[-1] == (3, 3)


def test_a_run_in_c_leaves_nothing_to_the_garbage_collector(monkeypatch):
    """Its samples may be many: they go with the last name of the run."""
    made, own = [], AdaptiveRun.__init__

    def init(self, *given, **more):
        own(self, *given, **more)
        made.append(weakref.ref(self))

    monkeypatch.setattr(AdaptiveRun, "__init__", init)
    loop = kept("four_bar")[0]
    gc.disable()
    try:
        simulate_robot(loop, 0.1, samples=3)
        assert [one() for one in made] == [None]
    finally:
        gc.enable()
