"""The first hour of four readers: what README and the pages that it names for them say, from an empty folder.

The commands, the files and the Python are those of the pages. What is checked is what a reader would look at:
the files, the numbers that a page or a table shows, by a reference of another kind, and that nothing else is
said. One command of each reader is a process of its own.
"""

from __future__ import annotations

import csv
import re
import shlex
import shutil
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from documents import READERS, ROOT, begin_with, commands, first_block, run
from lagrange import lagrange_forces
from scipy.interpolate import CubicSpline

import p3dof
from p3dof.viewer import headless

PAPER, PART, CONTROL, OTHER = READERS
SERVED = re.compile(r"http://127\.0\.0\.1:\d+/\?token=\S+ shows the motion\n")
"""What MeshCat says aside: where to look."""


@pytest.fixture
def walk(tmp_path, monkeypatch, capsys):
    """Run pages one after the other in an empty folder; return their sessions, and what they printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "150")

    def go(*pages):
        sessions = [run(page, tmp_path, clone=False) for page in pages]
        told = capsys.readouterr()
        assert SERVED.sub("", told.err) == ""
        return sessions, told.out

    return go


def process(*command, **others):
    """Run a program as a user does; return what it prints."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, **others)
    assert (done.returncode, done.stderr) == (0, ""), command
    return done.stdout


def p3dof_process(line, **others):
    """Run a command of a page in a process of its own."""
    return process(
        sys.executable, "-m", "p3dof", *shlex.split(line.partition("p3dof ")[2], comments=True), **others
    )


def table(path):
    """Return the columns of a CSV file by the names of its header, without units."""
    with path.open(encoding="utf-8", newline="") as lines:
        header, *rows = list(csv.reader(line for line in lines if line[0] != "#"))
    names = [name.partition("[")[0].strip() for name in header]
    return dict(zip(names, np.array(rows, dtype=float).T, strict=True))


def from_lagrange(parameters, motion, forces):
    """Return how far forces are from those of Lagrange's equations, as a share of the largest."""
    expected = lagrange_forces(parameters, motion.pose, motion.velocity, motion.acceleration)
    return np.abs(forces - expected).max() / np.abs(expected).max()


def in_table(found, suffix=""):
    return np.column_stack([found[f"f{actuator}{suffix}"] for actuator in "ABC"])


def test_the_researcher_with_the_paper(walk, tmp_path):
    (page,) = begin_with(PAPER)
    (session,), _ = walk(page)
    result, motion = session["result"], session["motion"]
    shown = re.search(r"# \[([\d. ]+)\] N", page.read_text(encoding="utf-8"))[1].split()
    np.testing.assert_allclose(result.forces[40], np.array(shown, dtype=float), atol=0.05)
    assert from_lagrange(p3dof.PAPER, motion, result.forces) < 1e-12
    other = session["robot"].inverse_dynamics(motion, method="virtual-power").forces
    assert np.abs(result.forces - other).max() < 1e-13 * np.abs(other).max()
    np.testing.assert_allclose(session["forces"], result.forces[40], atol=1e-10)  # by Pinocchio alone
    assert (tmp_path / "out/motion.html").stat().st_size > 1e5
    names = {path.name for path in (tmp_path / "urdf").iterdir()}
    assert names == {"p3dof.srdf", "p3dof.urdf", "p3dof.yaml"}
    (compare,) = commands(ROOT / "README.md")
    assert "the methods agree" in p3dof_process(compare)
    found = in_table(table(tmp_path / "out/loaded/forces.csv"), " virtual-power")
    assert from_lagrange(p3dof.PAPER.carrying(2), p3dof.paper_motion(), found) < 1e-12
    assert (tmp_path / "out/loaded/forces.png").is_file()


def test_the_engineer_with_a_part_to_move(walk, tmp_path):
    if not any(map(shutil.which, headless.NAMES)):
        pytest.skip("no Chromium: the tutorial writes its report as PDF too")
    own, tutorial = begin_with(PART)
    _, said = walk(own)
    told = re.findall(r"^  (p3dof .*)", said, re.MULTILINE)
    assert len(told) == 4
    size, bearings = (p3dof_process(line, cwd=tmp_path / "mine") for line in told[-2:])
    assert " fits with " in size
    assert "two carriages on each rail" in bearings
    lengths = p3dof.read_parameters(tmp_path / "lengths.yaml")
    found = in_table(table(tmp_path / "out/forces.csv"))
    assert from_lagrange(lengths, p3dof.paper_motion(), found) < 1e-12
    found = table(tmp_path / "out/first/forces.csv")
    motion = p3dof.Motion.from_csv(tmp_path / "mine/motion.csv").resampled(found["t"])
    mine = p3dof.read_parameters(tmp_path / "mine/machine.yaml")
    assert from_lagrange(mine, motion, in_table(found, " pinocchio")) < 1e-12
    _, said = walk(tutorial)
    fastest = float(re.findall(r"^([\d.]+) s in total", said, re.MULTILINE)[1])
    assert 0.9 < fastest < 1.1  # of 2 s
    assert "M400 + 16x10 fits with 20% reserve; the least is DN of A" in said
    saved = [float(share) for share in re.findall(r"rms force of [ABC] .* -([\d.]+) %", said)]
    assert len(saved) == 3
    assert min(saved) > 40
    assert max(saved) < 80
    floor = float(re.search(r"footprint of the joints .* \+([\d.]+) %", said)[1])
    assert floor == pytest.approx(100 * (0.28 / 0.25) ** 2 - 100, abs=0.1)
    for name in ("out/machine.html", "out/machine.pdf", "machines.png"):
        assert (tmp_path / name).stat().st_size > 1e4, name


def test_the_control_engineer(walk, tmp_path):
    simulation, _ = begin_with(CONTROL)
    (session,), said = walk(simulation)
    computed, pd = (np.array(row.split(), dtype=float) for row in re.findall(r"\[(.*?)\]", said)[:2])
    shown = re.search(r"# about (\S+) m, (\S+) m, (\S+) rad", simulation.read_text(encoding="utf-8")).groups()
    np.testing.assert_allclose(computed, np.array(shown, dtype=float), rtol=0.2)
    assert np.all((pd / computed > 5e3) & (pd / computed < 5e4))
    rest = np.zeros(3)
    np.testing.assert_allclose(session["hold"], lagrange_forces(p3dof.PAPER, rest, rest, rest), rtol=1e-12)
    assert session["swinging"].closure_error.max() < 1e-13
    assert {"run.npz", "simulation_pd.csv"} <= {path.name for path in (tmp_path / "out").iterdir()}
    for tool in ("make", "cc"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} not installed")
    codegen, _, check = first_block("how-to/controller-in-c.md", "console").splitlines()
    assert "p3dof.h" in p3dof_process(codegen)
    assert "\nall is well\n" in process(*shlex.split(check.removeprefix("$ ")))


def test_the_roboticist_with_another_robot(walk, tmp_path):
    (page,) = begin_with(OTHER)
    (session,), said = walk(page)
    assert "mobility                       │ 1 " in said
    found = table(tmp_path / "forces.csv")
    time, crank = found["t"], found["crank_joint"]
    np.testing.assert_allclose(np.degrees(crank[[0, -1]]), [30, 65], rtol=1e-12)
    # The power of the crank is the rate of the energy, which Pinocchio has of the tree alone.
    model = pin.buildModelFromUrdf(str(tmp_path / "four_bar.urdf"))
    data, joints = model.createData(), CubicSpline(time, np.column_stack([found[n] for n in model.names[1:]]))
    energy = [
        pin.computeMechanicalEnergy(model, data, np.column_stack([np.cos(q), np.sin(q)]).ravel(), v)
        for q, v in zip(joints(time), joints(time, 1), strict=True)
    ]
    power = found["force crank_joint"] * joints(time, 1)[:, 0]
    inside = slice(20, -20)
    np.testing.assert_allclose(
        CubicSpline(time, energy)(time, 1)[inside], power[inside], rtol=0, atol=1e-3 * np.abs(power).max()
    )
    info = next(line for line in commands(page) if " loop info " in line)
    assert "four_bar" in p3dof_process(info)
    again = p3dof.load_robot(tmp_path / "new/robot.urdf")
    state = again.complete([0.5], [1.0], [0.0])
    expected = session["loop"].inverse_dynamics(
        *(getattr(session["loop"].complete([0.5], [1.0], [0.0]), n) for n in "qva")
    )
    np.testing.assert_allclose(again.inverse_dynamics(state.q, state.v, state.a).tau, expected.tau, rtol=1e-9)
    for name in ("new/robot.xml", "new/robot.sdf", "page.html", "run.png"):
        assert (tmp_path / name).stat().st_size > 1000, name
