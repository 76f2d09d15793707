"""The numbers of --json are numbers: no command has one, or a share in percent, as a text in its tables."""

from __future__ import annotations

import json
import re
import shlex

import numpy as np
import pytest
import yaml
from command_line import commands, run
from design_problems import FILE as PROBLEM
from documents import ROOT
from motor_logs import fourier_motion, motor_log, truth_of

import p3dof
from p3dof.analysis.identification import MachineForces
from p3dof.analysis.tolerances.calibration import _candidates
from p3dof.closed_form.kinematics import forward_kinematics
from p3dof.loops.identification.forces import LoopForces
from p3dof.machine.parameters import PAPER

GALLERY = ROOT / "docs" / "_static" / "gallery"
FIVE_BAR = str(GALLERY / "five_bar.urdf")
UNIT = r"(%|[nµmkM]?[NmsWJg]|N m|kg|Mrev|rad|mrad|deg|°|h|rpm|m/s)"
NUMBER = re.compile(rf"[<>+−-]? ?\d[\d.,]*(e[+-]?\d+)?( ?{UNIT}(/\S+)?( or {UNIT})*)?")
"""A number, perhaps with its unit, is no text; several are one: ``"10 to 20"``, ``"0.7 ± 0.1"``."""

SHORT = "--samples 101"
EXACT = "--accuracy 10um --angle-accuracy 0.05mrad --sigma R=50um --sigma L=50um --sigma encoder=50um"
DRIVES = "--drives drives.yaml"
CALLS = {
    "init": ["init new"],
    "doctor": ["doctor"],
    "completion": ["completion bash"],
    "compare": [f"compare {SHORT} --no-plot --out out"],
    "forces": [f"forces {SHORT}"],
    "energy": [f"energy {SHORT}"],
    "reactions": [f"reactions {SHORT}"],
    "show": ["show --out machine.html"],
    "plots": [f"plots {SHORT} --out out"],
    "urdf": ["urdf --out out"],
    "export": ["export --format mjcf --out out"],
    "plan": ["plan task.yaml", "plan points.yaml --duration 3"],
    "fastest": [
        "fastest task.yaml --nodes 60",
        "fastest task.yaml --nodes 60 --shape zv --drive-stiffness 2e6",
        "fastest best.yaml --nodes 40 --best-path",
    ],
    "balance": ["balance task.yaml --kind constant --out out.yaml"],
    "size": [f"size task.yaml {DRIVES} --stops", f"size task.yaml {DRIVES} --per-axis"],
    "bearings": ["bearings bearings.yaml --task task.yaml --life '20000 h'"],
    "report": [f"report task.yaml {DRIVES} --bearings bearings.yaml --out r.html --no-animation"],
    "workspace": ["workspace"],
    "indices": ["indices --pose 0,0,0"],
    "studio": ["studio --grid 5 --samples 51 --out studio.html"],
    "compare-designs": [f"compare-designs machine.yaml other.yaml --task task.yaml {DRIVES}"],
    "designs": [f"designs designs.csv {SHORT} --out found.csv --top 2"],
    "sweep": ["sweep sweep.yaml --out sweep"],
    "optimise": ["optimise problem.yaml --starts 1"],
    "pareto": ["pareto two.yaml --points 3"],
    "sensitivity": [
        f"sensitivity uncertainty.yaml {SHORT} --local",
        f"sensitivity uncertainty.yaml {SHORT} --rows 64",
    ],
    "tolerance": [
        f"tolerance uncertainty.yaml {SHORT}",
        f"tolerance uncertainty.yaml {SHORT} --machines 50",
        "tolerance --sigma L=50um --pose 0,0,0",
    ],
    "simulate": ["simulate --samples 51 --controller pd --no-plot --out out"],
    "runs": ["runs runs.csv --duration 0.01"],
    "codegen": ["codegen --out c"],
    "excite": ["excite --harmonics 2 --motions 5 --rate 100 --out e.csv"],
    "identify": ["identify log0.csv --validate log1.csv --force-delay 0.003"],
    "calibrate": [f"calibrate poses.csv {EXACT}", f"calibrate {EXACT} --plan 9"],
    "loop info": [f"loop info {FIVE_BAR}"],
    "loop assemble": [f"loop assemble {FIVE_BAR}"],
    "loop forces": [f"loop forces {FIVE_BAR} --motion joints.csv"],
    "loop simulate": [f"loop simulate {FIVE_BAR} --duration 0.02"],
    "loop excite": [f"loop excite {FIVE_BAR} --harmonics 2 --motions 5 --rate 100 --noise 0.01 --out e.csv"],
    "loop identify": [f"loop identify {FIVE_BAR} loop0.csv --validate loop1.csv --force-delay 0.003"],
    "loop calibrate": [
        f"loop calibrate {FIVE_BAR} --frame left_tip --accuracy 1um --sigma *_motor.offset=2deg --plan 6"
    ],
    "loop show": [f"loop show {FIVE_BAR} --out robot.html"],
    "loop export": [f"loop export {FIVE_BAR} --out robot.xml"],
    "loop codegen": [f"loop codegen {FIVE_BAR} --out c"],
}


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "init", ".")[0] == 0
    machine = yaml.safe_load((tmp_path / "machine.yaml").read_text())
    points = [{"pose": [-0.1, 0, -0.2]}, {"pose": [0.1, 0, 0.2]}, {"pose": [-0.1, 0, -0.2]}]
    bent = [
        {"pose": [-0.1, 0, 0]},
        {"pose": [0, 0.05], "blend": 0.02, "blend_range": [0.01, 0.04]},
        {"pose": [0.1, 0, 0]},
    ]
    texts = {
        "other.yaml": machine | {"geometry": machine["geometry"] | {"R": 0.26}},
        "problem.yaml": PROBLEM | {"motion": {"paper": 51}},
        "two.yaml": PROBLEM | {"motion": {"paper": 51}, "objectives": ["peak_force", "moving_mass"]},
        "points.yaml": {"waypoints": points},
        "best.yaml": {"waypoints": bent},
        "sweep.yaml": PROBLEM | {"motion": {"paper": 51}, "count": 200},
        "uncertainty.yaml": {
            "sigma": {"R": "0.1 mm", "L": 1e-4},
            "variables": {"R": "5 %", "platform.mass": "2 %"},
        },
    }
    for name, data in texts.items():
        (tmp_path / name).write_text(yaml.safe_dump(data))
    (tmp_path / "designs.csv").write_text("R [mm],L\n250,0.41\n260,0.4\n")
    (tmp_path / "joints.csv").write_text(
        "t,left_motor,right_motor\n0,0,0\n0.1,0.01,0.02\n0.2,0.03,0.01\n0.3,0.02,0\n"
    )
    (tmp_path / "runs.csv").write_text("frequency\n5\n6\n")
    read = _candidates(PAPER, 40, 0)
    poses = forward_kinematics(PAPER.geometry, read) + 1e-5 * np.random.default_rng(0).normal(size=read.shape)
    rows = np.column_stack([read, poses])
    np.savetxt(tmp_path / "poses.csv", rows, delimiter=",", header="A,B,C,y,z,theta", comments="")
    return tmp_path


def logs(folder, name, forces, sizes, noise):
    truth = truth_of(forces, seed=3)
    for i, (size, period) in enumerate(((1.0, 1.5), (0.7, 2.3))):
        motion = fourier_motion(forces.home, size * np.array(sizes), period, 4, seed=i + 1)
        log = motor_log(forces, truth, motion, 3.0, rate=250.0, noise=noise, delay=0.003, seed=i)
        log.to_csv(folder / f"{name}{i}.csv")


def texts_that_are_numbers(data):
    """Cells of all tables but the first of each row, which is its name."""
    for table in data["tables"]:
        for row in table["rows"]:
            for header, cell in zip(table["header"][1:], row[1:], strict=True):
                if header != "unit" and isinstance(cell, str) and NUMBER.fullmatch(cell):
                    yield table["title"], row[0], header, cell


@pytest.mark.parametrize("call", [call for calls in CALLS.values() for call in calls])
def test_numbers_are_numbers(call, here, capsys):
    if "identify" in call:
        machine = MachineForces(), (0.1, 0.1, 0.4), 1.0
        robot = LoopForces(p3dof.load_robot(FIVE_BAR)), (0.4, 0.4), 0.02
        logs(here, *(("loop", *robot) if "loop" in call else ("log", *machine)))
    code, out, err = run(capsys, *shlex.split(call), "--json")
    assert code in (0, 1), err
    data = json.loads(out)
    assert not list(texts_that_are_numbers(data))


def rows_of(capsys, title, *call):
    tables = json.loads(run(capsys, *call, "--json")[1])["tables"]
    return {row[0]: row[1:] for row in next(one for one in tables if one["title"] == title)["rows"]}


@pytest.mark.usefixtures("here")
def test_shares_and_numbers_with_units_are_as_they_are(capsys):
    forces = ("forces", "--samples", "101")
    for peak, _, limit, share in rows_of(capsys, "Utilisation of limits", *forces).values():
        assert share == peak / limit
    energy = rows_of(capsys, "Kinetic energy", "energy", "--samples", "101")
    assert sum(share for _, share in energy.values()) == pytest.approx(1, abs=1e-12)
    pair = ("compare-designs", "machine.yaml", "other.yaml", "--task", "task.yaml")
    for first, second, more, _ in rows_of(capsys, "Comparison: task", *pair).values():
        assert more is None or more == pytest.approx((second - first) / abs(first), rel=1e-12)
    found = rows_of(capsys, "Where it comes from", "tolerance", "uncertainty.yaml", "--samples", "101")
    assert [found[name][:2] for name in ("geometry.R", "geometry.L")] == [[0.25, 1e-4], [0.4, 1e-4]]
    assert sum(row[-1] for row in found.values()) == pytest.approx(1, abs=1e-12)
    assert rows_of(capsys, "How the runs ended", "runs", "runs.csv", "--duration", "0.01") == {
        "finished": [2, 1]
    }


def test_every_command_is_called():
    assert {name for name, _ in commands()} == set(CALLS)
