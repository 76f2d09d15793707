"""Where Pinocchio has no wheel: the package is imported, and forces and runs are computed, without it."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from documents import ROOT

import p3dof
from p3dof._base.errors import NO_PINOCCHIO
from p3dof.cli import main, start

BLOCKED = """
import json, sys
sys.modules["pinocchio"] = None  # as if it were not installed
import p3dof
from p3dof.cli import main
"""
FORCES = """
robot, motion = p3dof.load(), p3dof.paper_motion(11)
found = {}
for method in ("compiled", "virtual-power"):
    run = robot.simulate(0.05, method=method, samples=3)
    found[method] = [robot.inverse_dynamics(motion, method=method).forces.tolist(), run.motion.pose.tolist()]
print(json.dumps(found))
"""
ASKED = """
for call in (lambda: robot.loop, lambda: robot.inverse_dynamics(p3dof.paper_motion(3)), lambda: robot.model):
    try:
        robot = p3dof.load()
        call()
    except p3dof.errors.MissingExtraError as error:
        print(error)
"""
COMMANDS = """
code = main(sys.argv[1:])
print(json.dumps(sorted(name for name in sys.modules if name.startswith("p3dof.loops."))))
sys.exit(code)
"""


def ran(script, *arguments, cwd=ROOT):
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{BLOCKED}{script}"]
    return subprocess.run([*command, *arguments], capture_output=True, text=True, check=False, cwd=cwd)


def test_forces_and_runs_are_those_of_an_installation_with_pinocchio():
    done = ran(FORCES)
    assert done.returncode == 0, done.stderr
    robot, motion = p3dof.load(), p3dof.paper_motion(11)
    forces = robot.inverse_dynamics(motion, method="pinocchio").forces
    poses = robot.simulate(0.05, method="pinocchio", samples=3).motion.pose
    for method, (found, run) in json.loads(done.stdout).items():
        np.testing.assert_allclose(found, forces, rtol=0, atol=1e-12 * np.abs(forces).max(), err_msg=method)
        np.testing.assert_allclose(run, poses, rtol=0, atol=1e-9, err_msg=method)


def test_what_needs_pinocchio_says_so():
    done = ran(ASKED)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [NO_PINOCCHIO] * 3


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("forces --method compiled --samples 11", 0),
        ("simulate --method compiled --samples 11 --no-plot --out .", 0),
        ("simulate --method virtual-power --controller pd --samples 3 --no-plot --out .", 0),
        ("compare", 2),
        ("loop info robot.urdf", 2),
    ],
)
def test_commands_do_without_or_say_what_to_install(command, code, tmp_path):
    done = ran(COMMANDS, *command.split(), cwd=tmp_path)
    assert done.returncode == code, done.stderr
    if code:
        assert done.stderr == f"p3dof: error: {NO_PINOCCHIO}\n"
    else:
        assert json.loads(done.stdout.splitlines()[-1]) == []


def test_machines_are_designed_without_it(tmp_path, monkeypatch, capsys):
    """Each command prints, to the last digit, what it does where Pinocchio is installed."""
    for name, text in start.starting_files().items():
        (tmp_path / name).write_text(text)
    for command in (
        "plan task.yaml --parameters machine.yaml --method compiled --json",
        "fastest task.yaml --parameters machine.yaml --max-force 300 --method compiled --json",
        "size task.yaml --drives drives.yaml --method compiled --frictionless --json",
        "workspace --json",
    ):
        done = ran("sys.exit(main(sys.argv[1:]))", *command.split(), cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        monkeypatch.chdir(tmp_path)
        assert main(command.split()) == 0
        assert json.loads(done.stdout) == json.loads(capsys.readouterr().out)
    done = ran("sys.exit(main(sys.argv[1:]))", "plan", "task.yaml", "--method", "pinocchio", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"p3dof: error: {NO_PINOCCHIO}\n")


def test_an_error_of_another_module_is_not_taken_for_it():
    broken = "sys.modules['p3dof.methods.pinocchio'] = None\np3dof.load().forces([0] * 3, [0] * 3, [0] * 3)"
    done = ran(broken)
    assert done.returncode == 1
    assert "ModuleNotFoundError: import of p3dof.methods.pinocchio halted" in done.stderr
    done = ran("sys.modules['p3dof.cli.forces'] = None\nsys.exit(main(['forces']))")
    assert done.returncode == 1
    assert "ModuleNotFoundError: import of p3dof.cli.forces halted" in done.stderr


@pytest.mark.parametrize("version", [None, "4.1.0"])
def test_doctor_takes_it_for_broken_where_it_is_installed(version, monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    monkeypatch.setattr(start, "_version", lambda _: version)
    pin = next(one for one in start.examined() if one.name == "pin")
    assert pin.state == ("missing" if version is None else "BROKEN")
    assert (NO_PINOCCHIO in pin.detail) == (version is None)
