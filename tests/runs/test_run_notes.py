"""No run is slow without a word: what keeps it from C, and what to do instead."""

import logging
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from command_line import run

import p3dof
from p3dof import Simulation, WrenchHistory
from p3dof._base.errors import ControllerError
from p3dof._base.time_series.smoothing import eased
from p3dof.closed_form.compiled import levels
from p3dof.runs import ControlLoop, Feedforward, Integration, Springs

pytestmark = pytest.mark.skipif(levels()[-1] == "numpy", reason="the extension was not built")

ROBOT, HOME = p3dof.load(), np.zeros(3)
EQUAL = Integration(scheme="rk4")


def hold(_):
    return HOME


def note_of(robot=ROBOT, **how):
    return robot.simulate(0.01, **{"method": "compiled", "samples": 3, "stop_at": (), **how}).note


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"controller": [1, 2, 3], "wrench": np.ones(6)},
        {"controller": Springs(100)},
        {"controller": hold, "control": ControlLoop(100)},
        {"wrench": WrenchHistory([0, 1], np.ones((2, 6)))},
        {"integration": EQUAL},
        {"controller": [1, 2, 3], "control": ControlLoop(1000, delay=1.5e-3)},
        {"controller": hold, "control": ControlLoop(1000, delay=0.02, bandwidth=50)},
        {"controller": hold, "control": ControlLoop(1000), "integration": EQUAL},
        {"controller": p3dof.runs.PD(ROBOT, p3dof.paper_motion())},
    ],
)
def test_a_run_in_c_has_nothing_to_say(how):
    assert note_of(**how) == ""


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"method": "pinocchio"}, "the method is 'pinocchio'; 'compiled' runs in C"),
        ({"method": "virtual-power"}, "the method is 'virtual-power'; 'compiled' runs in C"),
        (
            {"wrench": lambda t: np.full(6, t)},
            "the wrench is a function of Python; give it as a WrenchHistory",
        ),
        (
            {"controller": hold},
            "a controller of Python acts continuously; give it a rate, ControlLoop(rate=1000)",
        ),
        ({"control": ControlLoop(bandwidth=50)}, "give the controller a rate"),
    ],
)
def test_a_run_in_python_says_why_and_what_to_do(how, words):
    note = note_of(**how)
    assert note.startswith("made in Python, hundreds of times as slow as in C: ")
    assert words in note
    assert "\n" not in note


def test_without_the_extension_it_is_said(monkeypatch):
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    assert "the compiled extension is not used (numpy: P3DOF_LEVEL asks for it)" in note_of(p3dof.load())


def test_a_run_that_is_made_again_says_so():
    """C begins it, and cannot say how it ends."""
    g = ROBOT.parameters.geometry  # the model's legs are too short for the motion
    short = replace(ROBOT.parameters, geometry=replace(g, L=g.R - g.r + 0.01))
    controller = Feedforward(short, p3dof.paper_motion())
    with pytest.raises(ControllerError) as caught:
        ROBOT.simulate(1.0, controller=controller, control=ControlLoop(200), method="compiled")
    assert "the model of the controller has no answer" in caught.value.run.note


def test_the_note_goes_where_the_run_goes(tmp_path):
    found = ROBOT.simulate(0.01, samples=3, method="pinocchio")
    assert found.note
    assert Simulation.load(found.save(tmp_path / "run.npz")).note == found.note
    assert pickle.loads(pickle.dumps(found)).note == found.note  # noqa: S301 - our own
    assert "runs in C" in found._repr_html_()


def test_the_command_says_it_once(tmp_path, capsys):
    p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.05, 11).to_csv(tmp_path / "m.csv")
    arguments = ["simulate", "--motion", tmp_path / "m.csv", "--no-plot", "--out", tmp_path, "--rate", 200]
    code, out, _ = run(capsys, *arguments, "--method", "pinocchio")
    assert code == 0
    assert out.count("made in Python") == 1
    assert "'compiled' runs in C" in out
    assert "method: pinocchio\n" in out
    code, out, _ = run(capsys, *arguments)
    assert code == 0
    assert "made in Python" not in out
    assert "method: compiled\n" in out


def test_a_run_is_in_c_by_default_and_says_so():
    """From a start in all joints it is Pinocchio's, which has them."""
    run, joints = ROBOT.simulate(0.01, samples=3), ROBOT.simulate(0.01, samples=3, method="pinocchio").joints
    assert (run.method, run.note) == ("compiled", "")
    begin = p3dof.runs.InitialState(joints=(joints.q[-1], joints.v[-1]))
    other = ROBOT.simulate(0.01, start=begin, samples=3)
    assert other.method == "pinocchio"
    assert "it starts in all joints" in note_of(start=begin, method=None) or "pinocchio" in other.note


@pytest.mark.parametrize("ramp", [0, 0.2])
def test_a_load_of_the_command_line_is_no_function_of_python(ramp, tmp_path, capsys):
    """It belongs to the place on the path, to which a ramp comes later."""
    rows = ("t,fx,fy,fz,mx,my,mz", "0,0,3,-10,0,1,0", "0.06,0,0,20,0,0,0", "0.5,0,0,-8,0,0,0")
    (tmp_path / "w.csv").write_text("\n".join(rows) + "\n")
    code, out, _ = run(
        capsys, "simulate", "--controller", "feedforward", "--wrench", tmp_path / "w.csv", "--samples", 201,
        "--ramp", ramp, "--method", "compiled", "--no-plot", "--format", "npz", "--out", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert "made in Python" not in out
    found = Simulation.load(tmp_path / "simulation_feedforward.npz")
    phase = eased(found.time, 1 + ramp / 2, ramp, 0.0)[0]
    wanted = WrenchHistory.from_csv(tmp_path / "w.csv")(phase)
    assert np.abs(found.wrench - wanted).max() < (0.01 if ramp else 1e-12)
    assert np.abs(wanted[:, 2]).max() == pytest.approx(20, abs=1)


def test_the_logger_of_the_package_says_what_runs_in_python(caplog):
    with caplog.at_level(logging.INFO, logger="p3dof"):
        assert note_of() == ""
        assert caplog.records == []
        note = note_of(method="pinocchio")
    (record,) = caplog.records
    assert (record.name, record.levelname) == ("p3dof", "INFO")
    assert record.getMessage() == f"a run in Python: {note}"


def test_the_logger_says_how_many_runs_are_made(caplog):
    with caplog.at_level(logging.INFO, logger="p3dof"):
        many = ROBOT.simulate_many(0.01, {"start.y": [0.0, 0.001]})
    assert [record.getMessage() for record in caplog.records] == [f"2 runs: {many.note}"]


def test_the_logger_is_silent_where_nobody_configures_it():
    script = "import logging, p3dof; p3dof.errors; logging.getLogger('p3dof.viewer').error('nobody asked')"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
