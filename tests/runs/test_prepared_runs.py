"""Prepared runs: the bits of single ones, whatever ran before; what a call leaves serves only its like."""

import json
import threading
from dataclasses import replace

import numpy as np
import pytest
from runs_in_c import random_run

import p3dof
from p3dof import InputError, P3dofError
from p3dof._base.errors import ReachError
from p3dof.closed_form.compiled import levels
from p3dof.runs import PD, ComputedTorque, ControlLoop, InitialState, Integration, Noise, Springs
from p3dof.runs.machine import RunOfMachine

pytestmark = pytest.mark.skipif(levels()[-1] == "numpy", reason="the extension was not built")

ARRAYS = ("time", "pose", "velocity", "acceleration", "forces", "asked", "sliders", "wrench", "closure_error")
START = InitialState((0.01, 0.02, 0.05), (0.1, 0.0, -0.2))


def same(one, other):
    """Return what differs of two runs, to the last bit; how long they took may."""
    found = [name for name in ARRAYS if not np.array_equal(getattr(one, name), getattr(other, name))]
    return found + [
        name for name in ("stop", "evaluations", "note") if getattr(one, name) != getattr(other, name)
    ]


def alone(robot, duration, **how):
    """Make a run of which nothing was made before."""
    return RunOfMachine(p3dof.Manipulator(robot.parameters), duration, **how)()


@pytest.mark.parametrize("seed", range(24))
def test_a_prepared_run_has_the_bits_of_a_single_one(seed):
    robot, duration, how = random_run(seed)
    start = how.pop("start")
    try:
        wanted = alone(robot, duration / 4, start=start, **how)
    except P3dofError as error:
        with pytest.raises(type(error)):
            robot.simulate(duration / 4, start=start, **how)
        return
    prepared = robot.prepare_run(duration / 4, **how)
    elsewhere = InitialState(0.9 * np.asarray(start.pose), 0.5 * np.asarray(start.velocity))
    for _ in range(2):
        assert same(prepared(start), wanted) == []
        prepared(elsewhere)
        assert same(robot.simulate(duration / 4, start=start, **how), wanted) == []
        robot.simulate(duration / 4, start=elsewhere, **how)


def test_what_was_kept_of_another_call_is_not_taken():
    """Calls that differ in one thing, whatever it is; the first again at the end."""
    robot = p3dof.load()
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.05, 11)
    feedback = PD(robot, motion)
    usual = {"controller": feedback, "control": ControlLoop(1000), "samples": 5, "stop_at": ()}
    other = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.03, 0.1], 0.05, 11)
    changes = [
        {},
        {"controller": None},
        {"controller": [1.0, 2.0, 3.0]},
        {"controller": [1.0, 2.0, 4.0]},
        {"controller": Springs(1000.0)},
        {"controller": Springs(1000.0, damping=1.0)},
        {"controller": ComputedTorque(robot, motion)},
        {"controller": PD(robot, other)},
        {"control": ControlLoop(500)},
        {"control": ControlLoop(1000, saturation=1.0)},
        {"control": ControlLoop(1000, saturation=True)},
        {"control": ControlLoop(1000, noise=Noise(seed=1))},
        {"control": ControlLoop(1000, noise=Noise(seed=2))},
        {"control": ControlLoop(1000, delay=1e-3)},
        {"control": ControlLoop(1000, bandwidth=30.0)},
        {"control": ControlLoop(1000, resolution=1e-3)},
        {"reference": other},
        {"wrench": np.ones(6)},
        {"wrench": 2 * np.ones(6)},
        {"wrench": p3dof.WrenchHistory([0, 1], np.ones((2, 6)))},
        {"wrench": p3dof.WrenchHistory([0, 1], 3 * np.ones((2, 6)))},
        {"samples": 6},
        {"samples": [0.01, 0.02]},
        {"stop_at": ["tilt limit"]},
        {"integration": Integration(rtol=1e-6)},
        {"integration": Integration(scheme="rk4")},
    ]
    for change in [*changes, *reversed(changes)]:
        how = usual | change
        run, wanted = robot.simulate(0.05, start=START, **how), alone(robot, 0.05, start=START, **how)
        assert same(run, wanted) == [], change
        if run.reference is not None:
            np.testing.assert_array_equal(run.reference, wanted.reference)
    before = robot.simulate(0.05, start=START, **usual)
    feedback.omega *= 2  # a controller may be changed between two calls
    assert same(robot.simulate(0.05, start=START, **usual), alone(robot, 0.05, start=START, **usual)) == []
    assert "pose" in same(robot.simulate(0.05, start=START, **usual), before)
    with pytest.raises(P3dofError, match="samples"):
        robot.simulate(0.05, **usual | {"samples": True})


def test_constant_forces_may_differ():
    robot = p3dof.load()
    prepared = robot.prepare_run(0.05, controller=[1.0, 2.0, 3.0], samples=5, stop_at=())
    for forces in (None, [9.0, -4.0, 12.0], np.zeros(3)):
        given = [1.0, 2.0, 3.0] if forces is None else forces
        wanted = alone(robot, 0.05, controller=given, samples=5, stop_at=())
        assert same(prepared(forces=forces), wanted) == []
    for wrong in ([1, 2], [np.nan, 0, 0], "strong"):
        with pytest.raises(InputError, match="controller"):
            prepared(forces=wrong)
    with pytest.raises(InputError, match="forces: the run was prepared with a controller"):
        robot.prepare_run(0.05, controller=Springs(1.0))(forces=np.zeros(3))
    with pytest.raises(ReachError):
        prepared([9.0, 0, 0])
    with pytest.raises(InputError, match="beyond a limit"):
        p3dof.load(replace(robot.parameters, limits=p3dof.machine.Limits(tilt=(-0.1, 0.1)))).prepare_run(0.1)(
            [0, 0, 0.2]
        )


def test_threads_share_a_prepared_run():
    robot = p3dof.load()
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.05, 11)
    prepared = robot.prepare_run(0.05, controller=PD(robot, motion), control=ControlLoop(1000), samples=9)
    starts = [InitialState((0.001 * k, 0.0, 0.01 * k)) for k in range(8)]
    wanted, wrong = [prepared(start) for start in starts], []

    def work(own):
        for _ in range(10):
            wrong.extend(same(prepared(starts[own]), wanted[own]))

    threads = [threading.Thread(target=work, args=(own,)) for own in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_a_prepared_run_that_is_not_in_c():
    """A start in all joints, or a function of Python: the same result and note, by the same driver."""
    robot = p3dof.load()
    how = {"samples": 3, "stop_at": (), "wrench": lambda t: np.full(6, t)}
    made = robot.prepare_run(0.01, **how)(START)
    assert same(made, alone(robot, 0.01, start=START, **how)) == []
    assert "the wrench is a function of Python" in made.note
    joints = robot.simulate(0.01, start=START, samples=2).joints
    begin = InitialState(joints=(joints.q[0], joints.v[0]))
    by_joints = robot.prepare_run(0.01, samples=3, stop_at=())(begin)
    assert by_joints.method == "pinocchio"


def test_the_seconds_are_those_of_the_call():
    import time

    robot, fastest = p3dof.load(), []
    for _ in range(20):
        begun = time.perf_counter()
        run = robot.simulate(0.05, samples=3)
        fastest.append((time.perf_counter() - begun, run.seconds))
    assert all(inside <= around for around, inside in fastest)
    around, inside = min(fastest)
    assert inside > 0.5 * around  # not only the integration, a tenth of it


def test_a_part_of_a_table_is_as_the_whole(monkeypatch):
    """Long runs make the controller's table on the way, part by part: the same bits, with noise too."""
    from p3dof.runs import compiled_controllers

    robot = p3dof.load()
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.2, 11)
    for kind in (PD, p3dof.runs.Feedforward, ComputedTorque, lambda *_: Springs(1e3, damping=30.0)):
        how = {
            "controller": kind(robot, motion),
            "control": ControlLoop(1000, noise=Noise(seed=4), delay=1.4e-3, differencing=True),
            "samples": 7,
        }
        wanted = alone(robot, 0.25, **how)
        with monkeypatch.context() as patch:
            patch.setattr(compiled_controllers, "_KEPT", 50)
            patch.setattr(compiled_controllers, "_PART", 33)
            prepared = robot.prepare_run(0.25, **how)
            for _ in range(2):
                assert same(prepared(), wanted) == []


def test_more_samples_than_there_is_room_for():
    robot = p3dof.load()
    forces = robot.forces(np.zeros(3), np.zeros(3), np.zeros(3))
    many = robot.simulate(0.02, controller=forces * 0.9, samples=25_001, stop_at=())
    few = robot.simulate(0.02, controller=forces * 0.9, samples=26, stop_at=())
    assert len(many) == 25_001
    np.testing.assert_allclose(many.pose[::1000], few.pose, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(many.time, np.linspace(0, 0.02, 25_001))
    held = robot.simulate(0.02, controller=lambda _: forces, control=ControlLoop(100), samples=25_001)
    assert len(held) == 25_001


@pytest.mark.parametrize("controlled", [True, False])
def test_a_streamed_run_is_the_file_of_a_saved_one(controlled, tmp_path):
    """Byte by byte, in several parts; what is returned has some of its samples."""
    robot = p3dof.load()
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.05, 11)
    weight = robot.forces(np.zeros(3), np.zeros(3), np.zeros(3))
    acting = {"controller": PD(robot, motion), "control": ControlLoop(1000)} if controlled else {}
    acting = acting or {"controller": weight * [1.0, 1.01, 0.99], "wrench": np.ones(6)}
    prepared = robot.prepare_run(0.2, samples=20_012, **acting)
    whole, told = prepared(START), []
    whole.save(tmp_path / "saved.csv")
    some = prepared.stream(
        tmp_path / "streamed.csv", START, progress=lambda done, of: told.append((done, of))
    )
    assert (tmp_path / "streamed.csv").read_bytes() == (tmp_path / "saved.csv").read_bytes()
    at = [*range(0, 20_012, 20), 20_011]
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[at])
    assert (some.stop, some.evaluations, told[-1]) == (whole.stop, whole.evaluations, (20_012, 20_012))


def test_a_streamed_run_that_ends_early_is_whole_and_one_that_fails_leaves_nothing(tmp_path):
    robot, path = p3dof.load(), tmp_path / "run.csv"
    fall = robot.prepare_run(3.0, samples=30_001)
    whole = fall([0, 0, 0.1])
    some = fall.stream(path, [0, 0, 0.1])
    assert some.stop == whole.stop is not None
    assert whole.save(tmp_path / "saved.csv").read_bytes() == path.read_bytes()
    path.write_text("as it was")
    ticks = ControlLoop(1000)

    def interrupted(measured):
        if measured.time > 0.1:
            raise KeyboardInterrupt
        return np.zeros(3)

    def failing(measured):
        return [1.0] if measured.time > 0.1 else np.zeros(3)

    for controller, kind in ((interrupted, KeyboardInterrupt), (failing, p3dof.errors.ControllerError)):
        prepared = robot.prepare_run(0.2, controller=controller, control=ticks, samples=90_001)
        with pytest.raises(kind):
            prepared.stream(path)
        assert path.read_text() == "as it was"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["run.csv", "saved.csv"]
    with pytest.raises(InputError, match=r"ends in \.csv"):
        fall.stream(tmp_path / "run.npz")
    by_python = robot.prepare_run(0.01, samples=3, stop_at=(), wrench=lambda t: np.full(6, t))
    assert by_python.stream(path).save(tmp_path / "saved.csv").read_bytes() == path.read_bytes()


def test_the_command_writes_every_tick(tmp_path, capsys):
    from command_line import run

    p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.1, 11).to_csv(tmp_path / "m.csv")
    arguments = ["simulate", "--motion", tmp_path / "m.csv", "--no-plot", "--out", tmp_path, "--rate", 2000]
    code, out, _ = run(capsys, *arguments, "--controller", "pd", "--every-tick")
    assert (code, "simulation_pd.csv" in out) == (0, True)
    table = np.loadtxt(tmp_path / "simulation_pd.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 0], np.arange(201) / 2000, rtol=0, atol=1e-15)
    code, _, err = run(capsys, *arguments, "--every-tick", "--format", "npz")
    assert (code, "--every-tick: writes CSV" in err) == (2, True)


def test_largest_forces_of_the_command_are_among_those_at_every_tick(tmp_path, capsys, monkeypatch):
    """Measurement noise makes another force at each tick; the largest of a part of them is told as such."""
    from command_line import run

    p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.1, 11).to_csv(tmp_path / "m.csv")
    arguments = ["simulate", "--motion", tmp_path / "m.csv", "--controller", "pd", "--rate", "20 kHz"]
    arguments += ["--noise", "1mm", "0.1 m/s", "--no-plot", "--json", "--out", tmp_path]

    def told(*more):
        code, out, _ = run(capsys, *arguments, *more)
        assert code == 0
        found = json.loads(out)
        return found["tables"][0]["rows"][0][4], [note for note in found["notes"] if "among" in note]

    words = "largest among a part of the 2000 samples of the controller; "
    fewer, notes = told("--every-tick")
    assert notes == [words + "the file has all"]
    with (tmp_path / "simulation_pd.csv").open(encoding="utf-8") as file:
        names = file.readline().split(",")
    table = np.loadtxt(tmp_path / "simulation_pd.csv", delimiter=",", skiprows=1)
    forces = table[:, [i for i, name in enumerate(names) if name in ("fA [N]", "fB [N]", "fC [N]")]]
    assert len(table) == 2001
    largest = np.abs(forces).max()
    assert fewer < largest
    assert told() == (largest, [])
    monkeypatch.setattr("p3dof.cli.simulate._SEEN", 2000)
    fewer, notes = told()
    assert fewer < largest
    assert notes == [words + "--every-tick writes all"]
