"""The machine and any closed-loop robot move by one driver: the same bits, equally many evaluations."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from documents import ROOT

import p3dof
from p3dof import FileError, InputError, Simulation
from p3dof.loops.compiled import build
from p3dof.machine.parameters import PLATFORM
from p3dof.runs import (
    KINDS,
    ControlLoop,
    Event,
    InitialState,
    Integration,
    JointComputedTorque,
    JointPD,
    JointReference,
    Noise,
    RobotRun,
    robots,
    simulate_robot,
)
from p3dof.runs.robots import DOUBTFUL, RunOfRobot

ROBOT = p3dof.load()
ADAPTIVE = Integration(rtol=1e-9, atol=1e-11)
WRENCH = np.array([0.0, 20.0, -5.0, 0.0, 1.0, 0.0])


def held(places, speeds):
    """Springs and dampers at the sliders."""
    return -400.0 * places - 30.0 * speeds


@pytest.mark.parametrize(
    ("feedback", "control", "integration"),
    [
        (False, ControlLoop(), ADAPTIVE),
        (True, ControlLoop(), ADAPTIVE),
        (True, ControlLoop(200.0, saturation=8.0), ADAPTIVE),
        (True, ControlLoop(200.0, noise=Noise(seed=3), delay=2e-3, bandwidth=40.0), ADAPTIVE),
        (True, ControlLoop(bandwidth=(40.0, np.inf, 60.0)), ADAPTIVE),
        (True, ControlLoop(100.0), Integration(scheme="rk4", step=2e-3)),
    ],
)
def test_the_machine_is_a_robot_to_the_last_bit(feedback, control, integration):
    """Its joints, forces and loops, and how often its equations are evaluated."""
    how = {"control": control, "integration": integration, "samples": 21, "stop_at": ()}
    controllers = (
        (lambda seen: held(seen.sliders, seen.slider_velocities), lambda seen: held(*seen[1:3]))
        if feedback
        else ([1.0, 2.0, 3.0],) * 2
    )
    start = InitialState((0.01, 0.02, 0.05), (0.1, 0.0, -0.2))
    machine = ROBOT.simulate(
        0.15, start=start, controller=controllers[0], wrench=WRENCH, method="pinocchio", **how
    )
    first = machine.joints.q[0], machine.joints.v[0]
    robot = simulate_robot(
        ROBOT.loop, 0.15, *first, controllers[1], external={PLATFORM: WRENCH}, method="general", **how
    )
    assert machine.evaluations == robot.evaluations
    assert machine.joints.names == tuple(ROBOT.loop.model.names)[1:]
    pairs = {
        "time": (machine.time, robot.time),
        "q": (machine.joints.q, robot.q),
        "v": (machine.joints.v, robot.v),
        "a": (machine.joints.a, robot.a),
        "forces": (machine.forces, robot.forces),
        "asked": (machine.asked, robot.asked),
        "gap": (machine.closure_error, robot.gap),
        "wrench": (machine.wrench, robot.external[PLATFORM]),
    }
    assert [name for name, pair in pairs.items() if not np.array_equal(*pair)] == []


ALONE = """
import sys
from p3dof import load_robot
from p3dof.runs import Event, JointPD, JointReference, follow_motion, simulate_robot, simulate_robot_many

robot = load_robot(sys.argv[1])
home = robot.assemble()
held = JointPD(robot, home.q[robot.actuated_v], 1.0)
assert len(simulate_robot(robot, 0.01, controller=held, samples=3)) == 3
print(*(name for name in sys.modules if name.startswith(("p3dof.mach", "p3dof.closed_form", "p3dof.mani"))))
"""


def test_runs_of_a_robot_load_nothing_of_the_machine():
    robot = ROOT / "docs/_static/gallery/four_bar.urdf"
    run = subprocess.run([sys.executable, "-c", ALONE, robot], capture_output=True, text=True, check=False)
    assert (run.stdout.strip(), run.stderr) == ("", "")


def test_every_name_of_the_door_is_there():
    assert [name for name in p3dof.runs.__all__ if not hasattr(p3dof.runs, name)] == []


@pytest.mark.parametrize("kind", ["pd", "gravity", "computed"])
def test_controllers_of_any_robot_drive_the_machine(kind):
    loop = ROBOT.loop
    start = ROBOT.simulate(1e-3, start=(0.01, 0.02, 0.05), samples=2, stop_at=()).joints
    wanted = JointReference(
        np.linspace(0, 0.1, 11), start.q[0][loop.actuated_v] + np.linspace(0, 1e-3, 11)[:, None]
    )
    controller = {
        "pd": lambda: JointPD(loop, wanted, 900.0, 60.0),
        "gravity": lambda: JointPD(loop, wanted, 900.0, 60.0, gravity=True),
        "computed": lambda: JointComputedTorque(loop, wanted, 900.0, 60.0),
    }[kind]()
    how = {"controller": controller, "control": ControlLoop(200.0), "samples": 6, "integration": ADAPTIVE}
    begin = InitialState(joints=(start.q[0], start.v[0]))
    machine = ROBOT.simulate(0.05, start=begin, stop_at=(), method="pinocchio", **how)
    robot = simulate_robot(loop, 0.05, begin, stop_at=(), method="general", **how)
    allowed = 0.0 if kind == "pd" else 1e-9  # the machine's joints are those of its sliders
    np.testing.assert_allclose(machine.joints.q, robot.q, rtol=0, atol=allowed)
    np.testing.assert_allclose(machine.forces, robot.forces, rtol=0, atol=1e4 * allowed)
    assert np.abs(robot.error).max() < 0.05


SHORT = {"samples": 3, "stop_at": ()}


def both(how=None, **more):
    """The same run of the machine, and of its model as any robot."""
    how = {"samples": 6, "integration": ADAPTIVE, **(how or {})}
    machine = ROBOT.simulate(0.05, controller=[9.0, -4.0, 12.0], method="pinocchio", **how, **more)
    start = machine.joints.q[0], machine.joints.v[0]
    return machine, simulate_robot(ROBOT.loop, 0.05, *start, [9.0, -4.0, 12.0], method="general", **how)


def test_what_runs_leave_behind_is_the_same():
    """Power, gap, energy but for its zero, reactions where rigid bodies determine them."""
    machine, robot = both()
    np.testing.assert_array_equal(machine.power, robot.power)
    np.testing.assert_array_equal(machine.gap, robot.gap)
    assert machine.duration == robot.duration
    change = machine.energy - robot.energy
    assert np.ptp(change) < 1e-11 * np.ptp(robot.energy)
    work = np.trapezoid(machine.power.sum(axis=1), machine.time)
    assert np.ptp(machine.energy) == pytest.approx(abs(work), rel=1e-2)
    mine, found = machine.reactions(), robot.reactions()
    assert mine.residual.max() < 1e-6
    assert not found.errors
    known = ROBOT.reactions(machine.motion, "elastic", wrench=machine.wrench)
    np.testing.assert_allclose(mine.forces, known.forces, rtol=0, atol=1e-6)


def test_both_have_the_errors_of_what_they_follow():
    machine, robot = both()
    wrong = np.array([1e-3, 0.0, -2e-3])
    led = replace(machine, reference=machine.pose - wrong), replace(robot, reference=robot.actuated - wrong)
    for run in led:
        np.testing.assert_allclose(run.rms_error, np.abs(wrong), rtol=1e-9)
        np.testing.assert_allclose(run.peak_error, np.abs(wrong), rtol=1e-9)
    with pytest.raises(InputError, match="no motion to follow"):
        _ = robot.rms_error


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power", "compiled"])
def test_events_of_the_machine_are_those_of_any_robot(method):
    """The slider falls through a height: the run goes on, or ends there."""
    _, robot = both({"stop_at": ()})
    height = (robot.actuated[0, 0] + robot.actuated[-1, 0]) / 2
    at = ROBOT.loop.actuated_v[0]

    def of_slider(_, q, __):
        return (q[at] if len(q) > 3 else ROBOT.inverse_kinematics(q).sliders[0]) - height

    passing, end = Event("passing", of_slider, stops=False), Event("end", of_slider)
    how = {"samples": 6, "integration": ADAPTIVE, "controller": [9.0, -4.0, 12.0]}
    noted = simulate_robot(
        ROBOT.loop, 0.05, robot.q[0], stop_at=(), events=[passing], method="general", **how
    )
    machine = ROBOT.simulate(0.05, stop_at=[passing], method=method, **how)
    assert machine.finished
    assert [event.name for event in machine.events] == ["passing"]
    assert machine.events[0].rising == noted.events[0].rising
    assert machine.events[0].time == pytest.approx(noted.events[0].time, abs=1e-9)
    ended = ROBOT.simulate(0.05, stop_at=[*KINDS, end], method=method, **how)
    assert (ended.stop.kind, ended.stop.reason) == ("event", "end")
    assert ended.stop.time == pytest.approx(noted.events[0].time, abs=1e-9)


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler here")
def test_a_robot_is_compiled_by_default_where_the_whole_run_can_be_in_c(monkeypatch):
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/four_bar.urdf")
    made = simulate_robot(loop, 0.01, **SHORT)
    assert (made.method, made.note) == ("compiled", "")
    named = simulate_robot(loop, 0.01, method="compiled", **SHORT)
    np.testing.assert_array_equal(made.q, named.q)
    event = [Event("never", lambda *_: 1.0)]
    with monkeypatch.context() as patch:
        for words, case in {
            "events are functions": {"events": event},
            "forces are late": {"control": ControlLoop(500.0, delay=1e-3)},
            "compilers take long for a robot of 3 freedoms; 'compiled' does it": {},
            "there is no C compiler": {},
        }.items():
            patch.setattr(robots, "_LARGE", 2 if "long" in words else 30)
            if "compiler" in words and "no C" in words:
                patch.setattr(build, "compiler", lambda: None)
            run = simulate_robot(loop, 0.01, **case, **SHORT)
            assert run.method == "general"
            assert words in run.note
            np.testing.assert_allclose(run.q, named.q, rtol=0, atol=1e-9)


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler here")
def test_a_robot_in_python_says_why(monkeypatch):
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/four_bar.urdf")
    assert (
        "the method is 'general'; 'compiled' runs in C"
        in simulate_robot(loop, 0.01, method="general", **SHORT).note
    )
    tip = loop.model.frames[loop.model.nframes - 1].name
    compiled = loop.compile(external=[tip])
    hold, rate = (lambda seen: -seen.velocities), ControlLoop(500.0)
    how = {"method": compiled, **SHORT}
    cases = {
        "": {"controller": hold, "control": rate},
        "acts continuously; give it a rate": {"controller": hold},
        "events are functions": {"events": [Event("never", lambda *_: 1.0)]},
        "a wrench changes with time": {"external": {tip: lambda _: np.zeros(6)}},
        "forces are late": {"controller": hold, "control": ControlLoop(500.0, delay=1e-3)},
        "drives lag behind": {"controller": hold, "control": ControlLoop(500.0, bandwidth=50.0)},
    }
    for words, case in cases.items():
        run = simulate_robot(loop, 0.01, **how, **case)
        assert run.method == "compiled"
        assert words in run.note
        assert bool(run.note) == bool(words), run.note
    monkeypatch.setattr(RunOfRobot, "in_c", lambda *_: DOUBTFUL)
    assert DOUBTFUL in simulate_robot(loop, 0.01, **how).note


def test_a_saved_run_of_a_robot_is_what_is_read(tmp_path):
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/four_bar.urdf")
    frame, q = loop.model.frames[loop.model.nframes - 1].name, loop.assemble().q
    wanted = JointReference.standing(q[loop.actuated_v])
    run = simulate_robot(
        loop,
        0.02,
        q,
        controller=JointPD(loop, wanted, 1.0),
        external={frame: WRENCH},
        events=[Event("now", lambda t, *_: t - 0.01, stops=False)],
        samples=5,
        method="general",
    )
    again = RobotRun.load(run.save(tmp_path / "run.npz"), loop)
    for name in ("time", "q", "v", "a", "forces", "asked", "gap", "energy", "reference"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    np.testing.assert_array_equal(again.external[frame], run.external[frame])
    for name in ("method", "note", "events", "stop", "evaluations", "seconds"):
        assert getattr(again, name) == getattr(run, name)
    assert again.events[0].name == "now"
    header = run.save(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.split(",") == list(run.to_columns())
    with pytest.raises(FileError, match="expected"):
        RobotRun.load(tmp_path / "run.npz", ROBOT.loop)


def test_a_run_from_a_file_needs_its_machine(tmp_path):
    run = ROBOT.simulate(0.01, stop_at=[Event("now", lambda t, *_: t - 0.005, stops=False)], samples=3)
    path = run.save(tmp_path / "run.npz")
    again = Simulation.load(path, ROBOT.parameters)
    assert again.events == run.events != ()
    np.testing.assert_array_equal(again.energy, run.energy)
    with pytest.raises(InputError, match="does not hold the machine"):
        _ = Simulation.load(path).energy
