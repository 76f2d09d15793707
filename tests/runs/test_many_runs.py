"""Many runs at once: each is that of `simulate`, depends on no other, and says why it ended."""

import csv
import re
import signal
import sys

import numpy as np
import pytest
from documents import ROOT

import p3dof
from p3dof import PAPER
from p3dof._base.errors import InputError
from p3dof.cli import main
from p3dof.closed_form.compiled import levels
from p3dof.runs import PD, ComputedTorque, ControlLoop, Feedforward, InitialState, Integration, Noise, Springs
from p3dof.runs.many import figures_table, kind_of, read_runs, running, stop_codes, stops_table

ROBOT = p3dof.load()
MOTION = p3dof.paper_motion(1001).from_rest(0.2)
PRECISE = Integration(rtol=1e-12, atol=1e-14)
HOLD = ROBOT.gravity_forces(np.zeros(3))
AT_1_KHZ = ControlLoop(1000)
FIGURES = ("time", "pose", "velocity", "peak_error", "rms_error", "peak_force", "rms_force", "work", "energy")

compiled = pytest.mark.skipif(len(levels()) == 1, reason="needs the extension")


def columns(count, seed=0):
    rng = np.random.default_rng(seed)
    y, z, theta = MOTION.pose[0]
    return {
        "start.y [mm]": 1e3 * y + rng.normal(0, 1, count),
        "start.z": z + rng.normal(0, 1e-3, count),
        "start.theta": theta + rng.normal(0, 1e-3, count),
        "start.vy": rng.normal(0, 0.01, count),
        "L": PAPER.geometry.L * rng.normal(1, 1e-3, count),
        "platform.mass": PAPER.bodies.platform.mass * rng.uniform(0.9, 1.1, count),
        "payload.mass [g]": rng.uniform(100, 500, count),
        "payload.com.z": rng.uniform(0, 0.02, count),
        "frequency": rng.uniform(4, 6, count),
        "controller.damping": rng.uniform(0.7, 1, count),
        "wrench.fy": rng.normal(0, 2, count),
    }


def same(one, other):
    return all(np.array_equal(getattr(one, n), getattr(other, n), equal_nan=True) for n in ("stop", *FIGURES))


def apart(one, other, name):
    return np.abs(getattr(one, name) - getattr(other, name)).max()


CONTROLS = {
    "plain": (AT_1_KHZ, 1e-11),
    "noise": (ControlLoop(1000, noise=Noise(1e-6, 1e-4, 5)), 1e-11),
    "differencing": (ControlLoop(1000, differencing=True), 1e-10),
    "late": (ControlLoop(1000, delay=1e-3), 1e-11),
    "later": (ControlLoop(500, delay=5e-3), 1e-11),
    "late by a part": (ControlLoop(1000, delay=2.5e-3), 1e-11),
    "cut off": (ControlLoop(1000, saturation=40.0), 1e-10),
    "drives": (ControlLoop(1000, bandwidth=[50, np.inf, 200]), 1e-7),
    "late drives": (ControlLoop(1000, bandwidth=100, delay=0.3e-3), 1e-7),
}


@compiled
@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("kind", [PD, Feedforward, ComputedTorque])
def test_a_run_among_many_is_that_of_simulate(kind, name):
    """They end between two ticks; tolerances are those of RK4 at 1 ms, also for exponentials of drives."""
    control, allowed = CONTROLS[name]
    given, loop = columns(2), {"controller": kind(PAPER, MOTION, integral_time=0.5), "control": control}
    many = ROBOT.simulate_many(0.1004, given, **loop)
    one = ROBOT.simulate_many(0.1004, given, **loop, integration=PRECISE)
    assert many.note.startswith("lanes")
    assert one.note == "one by one: adaptive steps were requested"
    assert many.finished.all()
    assert np.array_equal(many.stop, one.stop)
    for figure in ("pose", "peak_error", "rms_error"):
        assert apart(many, one, figure) < allowed, figure
    for figure in ("velocity", "peak_force", "rms_force", "work", "energy"):
        assert apart(many, one, figure) < 3e3 * allowed, figure


@compiled
def test_its_summary_is_that_of_the_run_itself():
    given = columns(3)
    many = ROBOT.simulate_many(0.1, given, controller=PD(PAPER, MOTION), control=AT_1_KHZ)
    designs = p3dof.analysis.Designs(
        {name: given[name] for name in ("L", "platform.mass", "payload.mass [g]", "payload.com.z")}
    )
    for i in range(3):
        run = p3dof.load(designs[i]).simulate(
            0.1,
            start=InitialState(
                (given["start.y [mm]"][i] / 1e3, given["start.z"][i], given["start.theta"][i]),
                (given["start.vy"][i], 0, 0),
            ),
            controller=PD(PAPER, MOTION, given["frequency"][i], given["controller.damping"][i]),
            control=AT_1_KHZ,
            wrench=[0, given["wrench.fy"][i], 0, 0, 0, 0],
            method="compiled",
            samples=101,
            integration=PRECISE,
        )
        assert np.abs(many.pose[i] - run.pose[-1]).max() < 1e-11
        assert np.abs(many.velocity[i] - run.velocity[-1]).max() < 1e-9
        assert np.abs(many.peak_error[i] - run.peak_error).max() < 1e-11
        assert np.abs(many.rms_error[i] - run.rms_error).max() < 1e-11
        assert np.abs(many.peak_force[i] - np.abs(run.forces).max(axis=0)).max() < 1e-7
        assert many.work[i] == pytest.approx(np.sum(run.forces[:-1] * np.diff(run.sliders, axis=0)), abs=1e-8)


@compiled
def test_counts_that_flip_by_rounding_stay_small():
    loop = {"controller": PD(PAPER, MOTION), "control": ControlLoop(1000, resolution=1e-5)}
    many = ROBOT.simulate_many(0.1, columns(3), **loop)
    one = ROBOT.simulate_many(0.1, columns(3), **loop, integration=PRECISE)
    exact = ROBOT.simulate_many(0.1, columns(3), controller=PD(PAPER, MOTION), control=AT_1_KHZ)
    assert apart(many, exact, "rms_force") > 1e-4  # counting does something
    assert apart(many, one, "pose") < 1e-7


@compiled
@pytest.mark.parametrize("level", levels()[1:])
@pytest.mark.parametrize("kind", [PD, ComputedTorque])
def test_no_run_depends_on_another(kind, level):
    control = ControlLoop(1000, noise=Noise(1e-6, 1e-4), delay=1.5e-3, resolution=1e-6)
    loop = {"controller": kind(PAPER, MOTION), "control": control, "level": level}
    given = columns(70) | {"seed": np.arange(70) + 3}
    together = ROBOT.simulate_many(0.02, given, **loop)
    assert len(np.unique(together.pose[:, 0])) == 70
    rng = np.random.default_rng(2)
    order = rng.permutation(70)
    shuffled = ROBOT.simulate_many(0.02, {name: c[order] for name, c in given.items()}, **loop)
    for name in FIGURES:
        assert np.array_equal(getattr(together, name)[order], getattr(shuffled, name)), name
    for i in (0, 33, 69):
        alone = ROBOT.simulate_many(0.02, {name: c[i : i + 1] for name, c in given.items()}, **loop)
        assert all(np.array_equal(getattr(alone, n)[0], getattr(together, n)[i]) for n in FIGURES)
    broken = {name: c.copy() for name, c in given.items()}
    broken["start.y [mm]"][::2] = rng.choice([np.nan, 1e3, np.inf, 200], 35)
    others = ROBOT.simulate_many(0.02, broken, **loop)
    for name in FIGURES:
        assert np.array_equal(getattr(others, name)[1::2], getattr(together, name)[1::2]), name


@compiled
@pytest.mark.parametrize("kind", [PD, ComputedTorque])
def test_runs_one_after_the_other_are_the_same_but_for_rounding(kind):
    loop = {"controller": kind(PAPER, MOTION), "control": ControlLoop(1000, delay=0.5e-3, bandwidth=300)}
    beside = ROBOT.simulate_many(0.1, columns(5), **loop, histories=2)
    after = ROBOT.simulate_many(0.1, columns(5), **loop, histories=2, lanes=False)
    assert after.note.startswith("in C")
    assert apart(beside, after, "pose") < 1e-14
    assert apart(beside, after, "peak_force") < 1e-9
    assert np.abs(beside.history(1)["pose"] - after.history(1)["pose"]).max() < 1e-14


@compiled
def test_blocks_and_threads_change_nothing(monkeypatch):
    loop = {"controller": PD(PAPER, MOTION), "control": ControlLoop(1000, noise=Noise())}
    whole = ROBOT.simulate_many(0.02, columns(100), **loop, threads=1)
    monkeypatch.setattr(running, "BLOCK", 7)
    told = []
    parts = ROBOT.simulate_many(0.02, columns(100), **loop, threads=3, progress=lambda *at: told.append(at))
    assert same(whole, parts)
    assert told[-1] == (100, 100)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


@compiled
@pytest.mark.parametrize(
    ("controller", "stop_at", "kind", "allowed"),
    [
        (None, p3dof.runs.KINDS, "slider stop", 1e-11),
        (HOLD, p3dof.runs.KINDS, "tilt limit", 1e-9),
        (1.2 * HOLD, (), "reach limit", 1e-8),
        (Springs(500.0, preload=HOLD), p3dof.runs.KINDS, "tilt limit", 1e-9),
    ],
)
def test_limits_end_runs_for_the_same_reason_at_the_same_time(controller, stop_at, kind, allowed):
    rng = np.random.default_rng(0)
    given = {
        "start.y": rng.normal(0, 0.02, 12),
        "start.theta": rng.normal(0, 0.1, 12),
        "start.vy": rng.normal(0, 0.1, 12),
        "start.vtheta": rng.normal(0, 1, 12),
        "wrench.fy": rng.normal(0, 10, 12),
    }
    options = {"controller": controller, "stop_at": stop_at}
    many = ROBOT.simulate_many(2.0, given, **options)
    one = ROBOT.simulate_many(2.0, given, **options, integration=PRECISE)
    assert np.array_equal(many.stop, one.stop)
    assert many.counts()[kind] >= 10
    assert apart(many, one, "time") < allowed
    assert kind in many.reason(int(np.flatnonzero(many.careful)[0]))


@pytest.mark.parametrize("level", ["numpy", None])
def test_runs_tell_which_limit_they_ended_at(level):
    """By the poses where they ended: platforms turned either way, sliders thrown down or up."""
    limits = PAPER.limits
    spun = ROBOT.simulate_many(1.0, {"wrench.my": [-200.0, 200.0]}, controller=HOLD, level=level)
    for run, end in enumerate(("lower", "upper")):
        assert spun.reason(run).endswith(f" s: the platform at its {end} limit")
        assert spun.pose[run, 2] == pytest.approx(limits.tilt[run], abs=1e-9)
    thrown = {"start.y": [-0.03, 0.03], "start.theta": [0.1, -0.1]}
    for end, way, limit in zip(("lower", "upper"), (-1, 1), limits.travel, strict=True):
        start = {"start.z": [0.15 * way] * 2, "start.vz": [3.0 * way] * 2}
        moved = ROBOT.simulate_many(1.0, thrown | start, controller=0 * HOLD, level=level)
        for run in range(2):
            sliders = ROBOT.inverse_kinematics(moved.pose[run]).sliders
            (leg,) = np.flatnonzero(np.abs(sliders - limit) < 1e-9)
            assert moved.reason(run).endswith(f" s: slider {'ABC'[leg]} at its {end} end")
    if level == "numpy":
        assert spun.careful.all()


@compiled
def test_runs_that_go_on_carefully_count_as_thousands_of_steps():
    given = {"friction.coulomb.slide_b": np.full(5, 1e6), "friction.smoothing": np.full(5, 1e-3)}
    short = Integration(scheme="rk4", step=1e-3, time_limit=1e-4)
    with pytest.raises(InputError, match=r"\(1e\+05 steps\)"):  # 5 runs of 20 steps, each as 1000
        ROBOT.simulate_many(0.02, given, controller=HOLD, integration=short)


@compiled
def test_a_wrench_over_time_acts_on_all():
    def push(t):
        return np.array([0, 20 * np.sin(30 * t), 0, 0, np.cos(20 * t), 0])

    options = {"controller": Springs(2000.0, preload=HOLD, damping=20.0), "wrench": push}
    many = ROBOT.simulate_many(
        0.1, {"start.y": [0.0, 0.01]}, **options, integration=Integration(scheme="rk4", step=5e-4)
    )
    one = ROBOT.simulate_many(0.1, {"start.y": [0.0, 0.01]}, **options, integration=PRECISE)
    still = ROBOT.simulate_many(0.1, {"start.y": [0.0, 0.01]}, controller=options["controller"])
    assert apart(many, still, "pose") > 1e-4
    assert apart(many, one, "pose") < 1e-9


@compiled
def test_histories_are_kept_of_those_that_are_asked_for():
    loop = {"controller": PD(PAPER, MOTION), "control": AT_1_KHZ}
    many = ROBOT.simulate_many(0.05, columns(40), **loop, histories=[3, 39], every=7)
    assert same(many, ROBOT.simulate_many(0.05, columns(40), **loop))
    one = ROBOT.simulate_many(0.05, columns(40), **loop, histories=[3, 39], every=7, level="numpy")
    assert many.histories.runs.tolist() == [3, 39]
    for run in (3, 39):
        found, expected = many.history(run), one.history(run)
        assert np.allclose(found["time"], [*np.arange(0, 0.05, 7e-3), 0.05])
        for name, allowed in (
            ("time", 1e-12),
            ("pose", 1e-9),
            ("velocity", 1e-7),
            ("forces", 1e-6),
            ("asked", 1e-6),
        ):
            assert np.abs(found[name] - expected[name]).max() < allowed
        assert np.array_equal(found["pose"][-1], many.pose[run])
    with pytest.raises(InputError, match="no history of run 5"):
        many.history(5)
    falls = ROBOT.simulate_many(1.0, 2, histories=1, every=100)
    assert falls.history(0)["time"][-1] == falls.time[0] < 0.3
    assert falls.history(0)["pose"][-1] == pytest.approx(falls.pose[0])


@compiled
def test_runs_that_cannot_be_have_a_reason_and_leave_the_others():
    given = {name: np.repeat(column[:1], 12) for name, column in columns(1).items()}
    given["start.y [mm]"][1] = np.nan
    given["start.y [mm]"][2] = 300
    given["start.z"][3] = -1.0
    given["frequency"][4] = -5
    given["controller.damping"][5] = 0
    given["L"][6] = -1
    given["platform.mass"][7] = -1
    given["wrench.fy"][8] = np.inf
    given["L"][9] = np.nan
    loop = {"controller": PD(PAPER, MOTION), "control": AT_1_KHZ}
    many = ROBOT.simulate_many(0.02, given, **loop)
    words = [many.reason(i) for i in range(12)]
    assert [word.split(":")[0] for word in words[1:10]] == [
        "not a number", "impossible start", "impossible start", "bad gain or seed", "bad gain or seed",
        "impossible machine", "impossible machine", "not a number", "not a number",
    ]  # fmt: skip
    assert words[1] == "not a number: start.y is nan"
    assert words[4] == "bad gain or seed: controller.frequency is -5"
    assert words[8] == "not a number: wrench.fy is inf"
    assert words[9] == "not a number: geometry.L is nan"
    assert "out of reach" in words[2]
    assert "beyond a limit" in words[3]
    assert many.finished.tolist() == [True] + [False] * 9 + [True] * 2
    assert np.array_equal(many.pose[[10, 11]], many.pose[[0, 0]])
    assert np.isnan(many.peak_force[1:10]).all() or np.isnan(many.pose[[1, 4, 5, 6, 7, 8, 9]]).all()
    alone = ROBOT.simulate_many(0.02, given, **loop, level="numpy")
    assert [alone.reason(i) for i in range(12)] == words
    bad = ROBOT.simulate_many(0.02, {"seed": [0.5, -1, 2]}, controller=HOLD)
    assert bad.finished.tolist() == [False, False, True]


@compiled
def test_a_controller_that_cannot_go_on_ends_its_run_only():
    """Sliders that do not assemble: computed torque has no pose to begin with."""
    noisy = ControlLoop(1000, noise=Noise(position=0.3, velocity=0.0))
    loop = {"controller": ComputedTorque(PAPER, MOTION), "control": noisy, "start": MOTION.pose[0]}
    many = ROBOT.simulate_many(0.1, 12, **loop)
    one = ROBOT.simulate_many(0.1, 12, **loop, integration=PRECISE)
    assert many.counts().get("controller", 0) > 5
    assert np.array_equal(many.stop, one.stop)
    assert np.allclose(many.time, one.time, atol=1e-8)


@pytest.mark.parametrize(
    ("runs", "options", "message"),
    [
        (0, {}, "at least one, got 0"),
        ("ten", {}, "expected columns"),
        ([], {}, "expected columns by name, a number, or machines"),
        ({}, {}, "expected columns, got none"),
        ({"start.x": [0]}, {}, "unknown column 'start.x'"),
        ({"start.y": [0, 0], "L": [0.5]}, {}, "columns of one length"),
        ({"start.y": [0, 0], "start.z": [0.0, 0, 0]}, {}, "columns of one length, got start.y 2, start.z 3"),
        ({"start.y": [[0.0]]}, {}, "start.y"),
        ({"start.y": ["a"]}, {}, "real numbers"),
        ({"start.y [kg]": [0.0]}, {}, "start.y"),
        ({"seed [m]": [0.0]}, {}, "no unit"),
        ({"rod_radius": [0.01]}, {}, "the column dimensions.rod_radius is of solids; runs take masses"),
        ({"start.y": [0.0], "start.y [mm]": [0.0]}, {}, "two columns are start.y: 'start.y' and 'start.y "),
        ({"R": [0.25], "R [mm]": [250]}, {}, r"two columns are geometry.R: 'R' and 'R \[mm\]'"),
        ({"offset.y": [0.0]}, {}, "unknown column offset.y"),
        ({"frequency": [5.0]}, {}, "is for a controller of the kind PD"),
        ({"controller.stiffness": [5.0]}, {"controller": HOLD}, "is for a controller of the kind Springs"),
        (3, {"controller": PD(PAPER, MOTION)}, "need a control rate"),
        (3, {"controller": PD}, "got the class PD"),
        (3, {"controller": [0, 0]}, "controller: expected"),
        (3, {"control": 1000}, "control: expected ControlLoop"),
        (3, {"integration": "rk4"}, "integration: expected Integration"),
        (3, {"stop_at": ["wall"]}, "stop_at: expected"),
        (3, {"stop_at": "tilt limit"}, "stop_at: expected"),
        (3, {"reference": 1}, "reference: expected a Motion"),
        (3, {"wrench": [1.0]}, "wrench"),
        (3, {"start": [0.0]}, "pose"),
        (3, {"start": InitialState(joints=(np.zeros(10), np.zeros(10)))}, "not in joints"),
        (3, {"histories": [5]}, "histories: expected numbers of runs from 0 to 2"),
        (3, {"histories": -1}, "histories"),
        (3, {"every": 0}, "every"),
        (3, {"progress": 1}, "progress"),
        (3, {"threads": 0}, "threads"),
        (10**9, {"integration": Integration(scheme="rk4", step=1e-6)}, "would take about"),
    ],
)
def test_bad_input_is_one_clear_error(runs, options, message):
    with pytest.raises(InputError, match=message):
        ROBOT.simulate_many(0.01, runs, **options)


def test_what_the_engine_cannot_do_is_done_one_by_one():
    asked = []

    def python(measured):
        asked.append(measured.time)
        return HOLD - 500 * measured.sliders

    many = ROBOT.simulate_many(0.01, {"start.y": [0.0, 0.001]}, controller=python, control=AT_1_KHZ)
    assert many.note == "one by one: the controller is Python"
    assert many.finished.all()
    assert len(asked) == 20
    slow = ROBOT.simulate_many(0.01, 2, controller=HOLD, level="numpy")
    assert slow.note == "one by one: the extension is not used"


def test_any_kind_of_table_gives_the_same():
    rows = np.array([(0.0, 1.0), (0.001, 2.0)], dtype=[("start.y", float), ("seed", float)])
    as_mapping = {name: rows[name] for name in rows.dtype.names}
    one, other = (ROBOT.simulate_many(0.01, runs, controller=HOLD) for runs in (rows, as_mapping))
    assert same(one, other)
    machines = ROBOT.simulate_many(0.01, [PAPER, PAPER], controller=HOLD)
    assert np.allclose(machines.pose[0], one.pose[0], atol=1e-12)
    counted = ROBOT.simulate_many(0.01, 2, controller=HOLD)
    assert same(counted, ROBOT.simulate_many(0.01, {"start.y": [0.0, 0.0]}, controller=HOLD))


def test_runs_go_through_xarray():
    xarray = pytest.importorskip("xarray")
    given = {"L [mm]": [400.0, 410, 420], "frequency": [5.0, 6, 7], "payload.mass": 0.1, "seed": [1.0, 2, 3]}
    data = xarray.Dataset(
        {
            "L": ("run", given["L [mm]"], {"units": "mm"}),
            "frequency": ("run", given["frequency"], {"units": "Hz"}),
            "payload.mass": 0.1,
            "seed": ("run", given["seed"]),
        }
    )
    loop = {"controller": PD(PAPER, MOTION), "control": ControlLoop(1000, noise=Noise(1e-6, 1e-4))}
    many, other = (ROBOT.simulate_many(0.02, runs, **loop) for runs in (given, data))
    assert same(many, other)
    found = other.to_dataset()
    assert found.sizes == {"run": 3}
    assert found["geometry.L"].attrs["units"] == "m"
    assert found["controller.frequency"].attrs["units"] == "Hz"
    assert found["peak_force A"].attrs["units"] == "N"
    assert found["seed"].attrs == {}
    assert set(found["stop"].values) == {"finished"}
    assert np.array_equal(found["peak_error theta"], many.peak_error[:, 2])
    assert same(many, ROBOT.simulate_many(0.02, found[list(other.given)], **loop))  # what was given, again
    with pytest.raises(InputError, match="runs: expected columns along one dimension, got run, i"):
        ROBOT.simulate_many(0.02, data.assign(R=("i", [0.25, 0.26, 0.27])), **loop)


def test_without_xarray_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(p3dof.errors.MissingExtraError, match=r"p3dof\[xarray\]"):
        ROBOT.simulate_many(0.01, 1, controller=HOLD).to_dataset()


def test_results_are_columns_files_and_tables(tmp_path):
    many = ROBOT.simulate_many(0.05, columns(20), controller=PD(PAPER, MOTION), control=AT_1_KHZ, histories=2)
    found = many.to_columns()
    assert list(found)[:3] == ["start.y [m]", "start.z [m]", "start.theta [rad]"]
    assert {"stop", "reason", "end [s]", "peak_error theta [rad]", "rms_force B [N]", "work [J]"} <= set(
        found
    )
    with many.save(tmp_path / "runs.csv").open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    assert [float(row["peak_force A [N]"]) for row in read] == many.peak_force[:, 0].tolist()
    assert {row["stop"] for row in read} == {"finished"}
    assert {row["reason"] for row in read} == {"it went on to its end"}
    with np.load(many.save(tmp_path / "runs.npz")) as arrays:
        assert set(arrays["stop"]) == {"finished"}
        assert np.array_equal(arrays["history pose"], many.histories.pose)
    with pytest.raises(InputError, match=r"runs\.txt"):
        many.save(tmp_path / "runs.txt")
    assert repr(many) == "ManyRuns(20 runs: 20 finished)"
    assert "largest force A [N]" in many._repr_html_()
    assert stops_table(many).rows == (("finished", "20", "100 %"),)
    assert len(figures_table(many).rows) == 7


def test_the_page_explains_every_reason():
    page = (ROOT / "docs/how-to/many-runs.md").read_text("utf-8")
    told = {}
    for kind, number in re.findall(r"^\| ([a-z ]+) \|.*\| ([-\d,; to]+) \|$", page, re.MULTILINE):
        for part in re.split("[,;]", number):
            first, _, last = part.partition(" to ")
            told |= dict.fromkeys(range(int(first), int(last or first) + 1), kind)
    assert told == {code: kind_of(code) for code in stop_codes()}


@compiled
@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_returns_what_is_done():
    """Somebody presses Ctrl-C when some runs are done and others are not."""
    seen = []

    def progress(done, _total):
        seen.append(done)
        if len(seen) == 2:
            signal.raise_signal(signal.SIGINT)

    many = ROBOT.simulate_many(
        2.0, 20_000, controller=Springs(2000.0, preload=HOLD), progress=progress, threads=1
    )
    assert many.interrupted
    assert 1024 <= many.finished.sum() < 20_000
    assert many.done.sum() == many.finished.sum()
    assert np.isnan(many.pose[~many.done]).all()
    assert "interrupted" in many._repr_html_()


@compiled
def test_a_deliberate_error_would_be_seen(monkeypatch):
    """A controller's table that is one tick late is a hundred thousand times the tolerance."""
    from p3dof.runs.many import plan

    right = plan._table
    monkeypatch.setattr(plan, "_table", lambda task: np.roll(right(task), 1, axis=0))
    loop = {"controller": PD(PAPER, MOTION), "control": AT_1_KHZ}
    wrong = ROBOT.simulate_many(0.1, columns(2), **loop)
    one = ROBOT.simulate_many(0.1, columns(2), **loop, integration=PRECISE)
    assert apart(wrong, one, "pose") > 1e-6


@compiled
def test_the_command_line_reads_runs_and_writes_figures(tmp_path, capsys):
    table, out = tmp_path / "runs.csv", tmp_path / "found.csv"
    rows = ("500,2.0,5,1", "501,2.5,6,2", "500,nan,5,3", "500,2,-1,4", "5,2,5,5", "6,2,5,6", "7,2,5,7")
    table.write_text("\n".join(("L [mm],platform.mass,frequency,seed", *rows)), "utf-8")
    arguments = ["runs", str(table), "--noise", "1e-6", "1e-4", "--duration", "0.05", "--out", str(out)]
    assert main(arguments) == 1
    text = capsys.readouterr().out
    assert "finished" in text
    assert [line for line in text.splitlines() if line.startswith("run ")] == [
        "run 3: not a number: bodies.platform.mass is nan",
        "run 4: bad gain or seed: controller.frequency is -1",
        "run 5: impossible machine: no geometry: 0 < r < R, L > R - r >= 1e-6 L and b > 0 do not hold "
        "(and 2 more runs)",
    ]
    with out.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    machine = p3dof.load(p3dof.analysis.Designs({"L [mm]": [501.0], "platform.mass": [2.5]})[0])
    entered = p3dof.paper_motion(1001).from_rest(0.2)
    run = machine.simulate(
        0.05,
        start=InitialState(entered.pose[0], entered.velocity[0]),
        controller=PD(PAPER, entered, 6.0),
        control=ControlLoop(1000, noise=Noise(1e-6, 1e-4, 2)),
        method="compiled",
        samples=51,
    )
    assert float(rows[1]["peak_force A [N]"]) == pytest.approx(np.abs(run.forces[:, 0]).max(), rel=1e-8)
    assert [row["stop"] for row in rows[1:5]] == [
        "finished", "not a number", "bad gain or seed", "impossible machine",
    ]  # fmt: skip
    assert rows[4]["reason"].startswith("no geometry: ")
    two = tmp_path / "two.csv"
    two.write_text("frequency\n5\n6\n", "utf-8")
    assert main(["runs", str(two), "--duration", "0.01"]) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "runs.csv: expected the names of columns first, got an empty file"),
        ("L\n", "runs.csv: expected rows of numbers after the names of columns, got none"),
        ("L,L\n1,2\n", "runs.csv: two columns are geometry.L: 'L' and 'L'"),
        ("L,\n1,2\n", "runs.csv, column 2: unknown column ''"),
        ("L,R\n1\n", "runs.csv, row 1 (line 2): expected 2 columns, got 1"),
        ("L,R\n1,2\n1,x\n", "runs.csv, row 2 (line 3), column R: expected a number, got 'x'"),
        ("L;R\n1;2\n", "runs.csv: expected commas between the columns, got semicolons"),
        ('frequency\n"5,0"\n', "runs.csv, row 1 (line 2), column frequency: expected a number, got '5,0'"),
        (
            "# mm\nL\n400\n",
            "runs.csv, row 1, column L: 400 m is more than 20 m: lengths are in metres; did you",
        ),
        ("wheel\n1\n", "runs.csv, column 1: unknown column 'wheel'"),
        (
            "R [mm],R\n240,.24\n",
            "runs.csv: two columns are geometry.R: 'R [mm]' and 'R'; leave one of them out",
        ),
        (
            "240,300\n241,300\n",
            "runs.csv: the first line has numbers only; expected the names of the columns",
        ),
    ],
)
def test_bad_tables_are_one_clear_error(tmp_path, capsys, text, message):
    table = tmp_path / "runs.csv"
    table.write_text(text, "utf-8")
    assert main(["runs", str(table)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("p3dof: error: ")
    assert message in error
    assert error.count("\n") == 1


def test_tables_of_runs_are_those_of_designs(tmp_path):
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    (tmp_path / "runs.csv").write_text("# a note\nL [mm],frequency\n400,5\n\n401,6\n", "utf-8")
    wanted = {"L [mm]": [400.0, 401.0], "frequency": [5.0, 6.0]}
    pq.write_table(pa.table(wanted), tmp_path / "runs.parquet")
    for name in ("runs.csv", "runs.parquet"):
        found = read_runs(tmp_path / name)
        assert {header: column.tolist() for header, column in found.items()} == wanted
    (tmp_path / "large.csv").write_text("L\n400\n", "utf-8")
    assert read_runs(tmp_path / "large.csv", any_size=True)["L"].tolist() == [400]


def test_the_figure_has_all_finished_runs():
    pytest.importorskip("matplotlib")
    from p3dof.report import plots

    many = ROBOT.simulate_many(0.02, columns(5), controller=PD(PAPER, MOTION), control=AT_1_KHZ)
    figure = plots.many_runs_figure(many)
    assert [sum(bar.get_height() for bar in axis.patches) for axis in figure.axes] == [5] * 6
    assert all(tick == round(tick) for axis in figure.axes for tick in axis.get_yticks())  # runs are whole
    fallen = ROBOT.simulate_many(1.0, 2)
    with pytest.raises(InputError, match="there is none"):
        plots.many_runs_figure(fallen)
