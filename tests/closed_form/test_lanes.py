"""Runs in lanes of the extension: as the integrator has them, whatever is in the other lanes."""

import re
from dataclasses import replace

import numpy as np
import pytest

import p3dof
from p3dof import PAPER
from p3dof._native.sources import PACKAGE
from p3dof.closed_form.compiled import many
from p3dof.closed_form.compiled.kernels import _extension, levels
from p3dof.closed_form.compiled.many import (
    INPUTS,
    NOWHERE,
    RESULT_WIDTH,
    RESULTS,
    START,
    Engine,
    empty_inputs,
    set_machines,
)
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.runs import PD, ControlLoop, InitialState, Integration

pytestmark = pytest.mark.skipif(_extension() is None, reason="needs the extension")

MOTION = p3dof.paper_motion(1001).from_rest(0.2)
END, PERIOD = 0.2, 1e-3
STIFF = PD(PAPER, MOTION)


def starts(count, seed=0):
    x = np.zeros((count, 6))
    x[:, :3] = MOTION.pose[0] + np.random.default_rng(seed).normal(0, 1e-3, (count, 3))
    return x


def inputs(x, machine=PAPER, symmetric=True):
    rows = empty_inputs(len(x))
    rows[:, INPUTS["x"]] = x
    side = set_machines(rows, tuple(np.full(len(x), n) for n in model_of(machine).numbers), symmetric)
    rows[:, INPUTS["side"]] = np.sign(side)[:, None]
    rows[:, INPUTS["bound"]] = [*machine.limits.travel, *machine.limits.tilt]
    rows[:, INPUTS["gain"]] = STIFF.omega**2 * STIFF.moved
    rows[:, INPUTS["damping"]] = 2 * STIFF.omega * STIFF.moved
    return rows


def engine(steps=1, **settings):
    at = [STIFF.reference.at(k * PERIOD) for k in range(round(END / PERIOD) + 1)]
    table = np.array(
        [[*STIFF.holding, *STIFF.equations.sliders(*pose, *speed)] for pose, speed, _ in at[:-1]]
    )
    lengths, changes = np.full(steps, PERIOD / steps), np.zeros(steps, np.int64)
    changes[0] = 1
    return Engine(
        PERIOD, END, lengths, changes, 0.1, 1e-11, 1e-13,
        table=table, reference=np.array([row[0] for row in at]), **settings,
    )  # fmt: skip


def results(given, rows, level=None, wide=True, **more):
    found = np.full((len(rows), RESULT_WIDTH), np.nan)
    given.run(level or levels()[-1], True, rows, found, np.zeros(1, np.int64), wide=wide, **more)
    return found


def test_a_run_in_a_lane_is_that_of_the_integrator():
    x = starts(3)
    x[0, :3] = MOTION.pose[0]
    found = results(engine(), inputs(x))
    for row, start in zip(found, x, strict=True):
        run = p3dof.load().simulate(
            END,
            start=InitialState(start[:3]),
            controller=STIFF,
            control=ControlLoop(1 / PERIOD),
            method="compiled",
            samples=201,
            integration=Integration(rtol=1e-12),
        )
        assert row[RESULTS["stop"]] == -1
        assert row[RESULTS["samples"]] == 201
        allowed = np.array([1e-12, 1e-12, 1e-11])  # [m, m, rad]
        assert np.all(np.abs(row[RESULTS["pose"]] - run.pose[-1]) < allowed)
        assert np.all(np.abs(row[RESULTS["velocity"]] - run.velocity[-1]) < 100 * allowed)
        assert np.all(np.abs(row[RESULTS["peak_error"]] - run.peak_error) < 2 * allowed)
        assert np.all(np.abs(row[RESULTS["rms_error"]] - run.rms_error) < 2 * allowed)
        assert np.abs(row[RESULTS["peak_force"]] - np.abs(run.forces).max(axis=0)).max() < 1e-7
        assert np.abs(row[RESULTS["rms_force"]] - np.sqrt((run.forces**2).mean(axis=0))).max() < 1e-8
        work = np.sum(run.forces[:-1] * np.diff(run.sliders, axis=0))
        assert row[RESULTS["work"]][0] == pytest.approx(work, abs=1e-10)


@pytest.mark.parametrize("level", levels()[1:])
def test_a_run_does_not_depend_on_its_neighbours(level):
    rows = inputs(starts(70))
    together = results(engine(), rows, level)
    rng = np.random.default_rng(1)
    mixed = rows.copy()
    others = rng.random(70) < 0.5
    mixed[others] = np.nan
    mixed[others & (rng.random(70) < 0.5)] = rows[0] * 1.5  # starts beyond a limit, or ends early
    kept = ~others
    assert np.array_equal(results(engine(), mixed, level)[kept], together[kept])
    shuffled = rng.permutation(70)
    assert np.array_equal(results(engine(), rows[shuffled], level), together[shuffled])
    alone = np.vstack([results(engine(), rows[i : i + 1], level) for i in range(5)])
    assert np.array_equal(alone, together[:5])
    single = results(engine(), rows, level, wide=False)
    assert np.allclose(single, together, rtol=1e-12, atol=1e-14)


def test_levels_agree():
    rows = inputs(starts(5))
    first, *others = (results(engine(), rows, level) for level in levels()[1:])
    for other in others:
        assert np.allclose(first, other, rtol=1e-10, atol=1e-13)


def test_smaller_steps_gain_four_orders():
    rows = inputs(starts(2))
    exact, *found = (results(engine(steps), rows)[:, RESULTS["pose"]] for steps in (16, 1, 2))
    coarse, fine = (np.abs(pose - exact).max() for pose in found)
    assert coarse / fine > 8


def test_what_cannot_start_says_so_and_leaves_the_others():
    rows = inputs(np.vstack([starts(2), [[0.3, 0, 0, 0, 0, 0]], [[0, -0.5, 0, 0, 0, 0]]]))
    found = results(engine(), rows)
    assert found[:, 0].tolist() == [-1, -1, NOWHERE, START]
    assert np.array_equal(found[:2], results(engine(), rows[:2]))


def test_cancelled_runs_leave_nothing():
    rows, found = inputs(starts(3)), np.full((3, RESULT_WIDTH), np.nan)
    engine().run(levels()[-1], True, rows, found, np.ones(1, np.int64))
    assert np.isnan(found).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lengths": np.zeros(0)}, "lengths"),
        ({"changes": np.zeros(3, np.int64)}, "changes: expected 1 numbers, got 3"),
        ({"table": np.zeros((5, 9))}, "table: expected 1800 numbers, got 45"),
        ({"reference": np.zeros((5, 3))}, "reference"),
        ({"loads": np.zeros(3)}, "loads"),
        ({"kind": 1}, "assembly"),
        ({"kind": 7}, "settings"),
        ({"whole": 99}, "settings"),
        ({"flags": {"noisy": True}}, "noise"),
        ({"lengths": np.zeros(1, np.float32)}, "lengths: expected doubles"),
        ({"changes": np.zeros(1, np.int32)}, "changes: expected 64-bit integers"),
    ],
)
def test_buffers_that_do_not_fit_are_refused(change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        results(replace(engine(), **change), inputs(starts(2)))


def test_arrays_of_another_size_are_refused():
    rows = inputs(starts(2))
    for wrong in (rows[:, :-1].copy(), rows[:1]):
        with pytest.raises(ValueError, match=r"inputs|results"):
            engine().run(levels()[-1], True, wrong, np.zeros((2, RESULT_WIDTH)), np.zeros(1, np.int64))


def test_numbers_of_the_extension_have_the_same_names_here():
    header = (PACKAGE / "_native/many_batch.h").read_text()
    given = {name: int(value) for name, value in re.findall(r"\bMANY_([A-Z]+) = (-?\d+)[, ]", header)}
    limits = given.pop("LIMITS")
    assert given == {
        "FINISHED": many.FINISHED,
        "ACCURACY": many.ACCURACY,
        "CONTROLLER": many.CONTROLLER,
        "START": many.START,
        "NOWHERE": many.NOWHERE,
        "RESULTS": many.RESULT_WIDTH,
        "HISTORY": many.HISTORY_WIDTH,
    }
    assert given["ACCURACY"] == limits  # those are numbered from zero
