"""`p3dof identify` and `p3dof loop identify`: from logs to files that predict, end to end."""

from __future__ import annotations

import re
from dataclasses import replace

import command_line
import numpy as np
import pytest
from gallery import GALLERY, gallery
from motor_logs import fourier_motion, motor_log, truth_of

import p3dof
from p3dof.analysis.identification import MachineForces
from p3dof.loops.identification.forces import LoopForces
from p3dof.machine.parameters import read_parameters


def logs(forces, folder, sizes, noise, counts, rate=250.0):
    """Two logs of a robot as built, in files; the parameters that it has."""
    truth = truth_of(forces, seed=3)
    found = []
    for i, (size, T) in enumerate(((1.0, 1.5), (0.7, 2.3))):
        motion = fourier_motion(forces.home, size * sizes, T, 4, seed=i + 1)
        log = motor_log(
            forces, truth, motion, 3.0, rate=rate, noise=noise, counts=counts, delay=0.003, seed=i
        )
        found.append(log)
        log.to_csv(folder / f"log{i}.csv")
    return truth, found


@pytest.fixture
def run(capsys):
    """What runs a command: its exit code, and all that it printed."""

    def running(*words):
        code, out, err = command_line.run(capsys, *(str(word) for word in words))
        return code, out + err

    return running


def verdict(output):
    """Errors of the identified robot and of the design, by the verdict."""
    told = re.search(r"held-out data: ([\d.e-]+) (N|N m) rms instead of ([\d.]+)\.", output)
    return float(told[1]), float(told[3])


def predicts(forces, truth, states, own):
    """The rms error of a robot that was read back, in forces of the robot as built."""
    rows, other = forces.rows(states), own.rows(own.from_actuators(*states[:3]))
    return np.sqrt(
        ((other.columns @ own.design + other.known - rows.columns @ truth - rows.known) ** 2).mean()
    )


def held_out_states(forces, log):
    from p3dof.loops.identification.data import prepare_log

    return prepare_log(forces, log, delay=0.003).states


def test_a_robot_is_identified_validated_and_written(run, tmp_path):
    robot = GALLERY / "five_bar.urdf"
    forces = LoopForces(gallery("five_bar"))
    truth, (_, other) = logs(forces, tmp_path, np.full(2, 0.4), 0.02, 2 * np.pi / 8192)
    data, held_out, out = tmp_path / "log0.csv", tmp_path / "log1.csv", tmp_path / "robot.urdf"
    code, told = run("loop", "identify", robot, data, "--validate", held_out, "--out", out)
    assert code == 0, told
    now, design = verdict(told)
    assert now < design / 30
    assert re.search(r"Forces are (2\.[89]|3\.[0-2])\d* ms later than positions", told)
    assert "left_motor: viscous friction" in told
    own = LoopForces(p3dof.load_robot(out))
    assert predicts(forces, truth, held_out_states(forces, other), own) < 0.02
    # With the sidecar named: the same.
    code, again = run("loop", "identify", robot, robot.with_suffix(".yaml"), data, "--validate", held_out)
    assert (code, verdict(again)) == (0, (now, design))


@pytest.mark.slow
def test_a_leg_is_identified_by_a_command(run, tmp_path):
    forces = LoopForces(gallery("leg"))
    truth, (_, other) = logs(forces, tmp_path, np.full(6, 0.25), 0.05, 2 * np.pi / 16384)
    out = tmp_path / "leg.urdf"
    code, told = run(
        "loop", "identify", GALLERY / "leg.urdf", tmp_path / "log0.csv", "--validate", tmp_path / "log1.csv",
        "--out", out,
    )  # fmt: skip
    assert code == 0, told
    now, design = verdict(told)
    assert now < design / 10
    assert (
        predicts(forces, truth, held_out_states(forces, other), LoopForces(p3dof.load_robot(out)))
        < design / 10
    )


def test_the_machine_is_identified_with_a_report(run, tmp_path):
    pytest.importorskip("jinja2", reason="jinja2 not installed")
    pytest.importorskip("matplotlib", reason="matplotlib not installed")
    forces = MachineForces()
    truth, (_, other) = logs(forces, tmp_path, np.array([0.1, 0.1, 0.4]), 1.0, 1e-5)
    out, page = tmp_path / "machine.yaml", tmp_path / "page.html"
    code, told = run(
        "identify", tmp_path / "log0.csv", "--validate", tmp_path / "log1.csv", "--out", out, "--report", page
    )
    assert code == 0, told
    now, design = verdict(told)
    assert now < design / 10
    own = MachineForces(read_parameters(out))
    assert predicts(forces, truth, held_out_states(forces, other), own) < design / 10
    text = page.read_text(encoding="utf-8")
    assert "Better than the design on held-out data" in text
    assert "slide_a: viscous friction" in text
    assert text.count("data:image/svg+xml;base64,") == 2
    assert not re.search(r'(src|href)="(?!data:|#)', text)  # it loads nothing


def test_a_robot_that_is_worse_is_not_written(run, tmp_path):
    """The held-out log is of the design: what the other log taught is wrong for it."""
    forces = LoopForces(gallery("five_bar"))
    logs(forces, tmp_path, np.full(2, 0.4), 0.02, 2 * np.pi / 8192)
    motion = fourier_motion(forces.home, np.full(2, 0.3), 2.3, 4, seed=2)
    motor_log(forces, forces.design, motion, 3.0, rate=250.0, noise=0.02, delay=0.003).to_csv(
        tmp_path / "new.csv"
    )
    out = tmp_path / "robot.urdf"
    code, told = run(
        "loop", "identify", GALLERY / "five_bar.urdf", tmp_path / "log0.csv", "--validate",
        tmp_path / "new.csv", "--out", out,
    )  # fmt: skip
    assert code == 1
    assert "Do not use: not better than the design on held-out data" in told
    assert not out.exists()


def test_without_held_out_data_nothing_is_promised(run, tmp_path):
    forces = LoopForces(gallery("five_bar"))
    logs(forces, tmp_path, np.full(2, 0.4), 0.02, 2 * np.pi / 8192)
    code, told = run(
        "loop", "identify", GALLERY / "five_bar.urdf", tmp_path / "log0.csv", "--force-delay", "0.003"
    )
    assert code == 0
    assert "not validated: give --validate a log of another motion" in told
    assert "later than positions" not in told  # it was given


def test_currents_become_forces_by_the_constants_of_the_motors(run, tmp_path):
    forces = LoopForces(gallery("five_bar"))
    _, (log, other) = logs(forces, tmp_path, np.full(2, 0.4), 0.02, 2 * np.pi / 8192)
    for name, one in (("log0.csv", log), ("log1.csv", other)):
        path = replace(one, forces=one.forces / [0.5, -0.25]).to_csv(tmp_path / name)
        path.write_text(path.read_text(encoding="utf-8").replace("force:", "current:"), encoding="utf-8")
    words = (
        "loop",
        "identify",
        GALLERY / "five_bar.urdf",
        tmp_path / "log0.csv",
        "--validate",
        tmp_path / "log1.csv",
    )
    code, told = run(*words, "--constants", "0.5,-0.25")
    assert code == 0, told
    assert verdict(told)[0] < verdict(told)[1] / 30
    code, told = run(*words)
    assert code == 2
    assert "current:left_motor is a current: give constants" in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--constants", "1,2,3"), "--constants: expected one number, or 2 for left_motor, right_motor"),
        (("--constants", "a"), "--constants: expected numbers with commas, got 'a'"),
        (("--constants", "1"), "log0.csv has forces, no currents"),
        (("--period", "2.9"), "has less than two periods of 2.9 s"),
    ],
)
def test_a_bad_option_is_one_line(run, tmp_path, words, message):
    forces = LoopForces(gallery("five_bar"))
    logs(forces, tmp_path, np.full(2, 0.4), 0.02, 2 * np.pi / 8192)
    code, told = run("loop", "identify", GALLERY / "five_bar.urdf", tmp_path / "log0.csv", *words)
    assert code == 2
    assert message in told
    assert len(told.strip().splitlines()) == 1


def test_a_log_is_needed(run):
    code, told = run("loop", "identify", GALLERY / "five_bar.urdf")
    assert code == 2
    assert "DATA is missing" in told
