"""The first hour on the command line: files to start from, what is installed, completion, and slips."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from documents import ROOT

import p3dof
from p3dof._base.errors import ModelWarning
from p3dof.cli import start
from p3dof.cli.start import NEXT, starting_files
from p3dof.design.bearings import read_bearings
from p3dof.design.drives import GENERIC, read_catalogue

FILES = ["bearings.yaml", "drives.yaml", "machine.yaml", "motion.csv", "task.yaml"]


@pytest.fixture
def started(tmp_path, monkeypatch, capsys):
    """A folder with the files to start from."""
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "init")[0] == 0
    return tmp_path


@pytest.mark.usefixtures("undrawn")
def test_init_prints_commands_that_work_on_its_files(started, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    told = re.findall(r"^  p3dof (.*)", run(capsys, "init", "--force")[1], re.MULTILINE)
    assert told == list(NEXT)
    assert len(told) == 4
    said = {}
    for command in told:
        code, said[command.split()[0]], err = run(capsys, *command.split())
        assert (code, err) == (0, ""), command
    assert " fits with " in said["size"]
    for rating in ("DN [mm rpm]", "static load [N]", "L10 [h]", "static safety"):
        assert rating in said["size"]
    for kind in ("slide_a", "hinge_a", "loop_c"):
        (line,) = (row for row in said["bearings"].splitlines() if "generic" in row and f" {kind} " in row)
        assert "> 100,000" in line
    report = "report task.yaml --parameters machine.yaml --drives drives.yaml --no-animation"
    assert run(capsys, *report.split())[0] == 0
    assert (started / "out" / "report.html").is_file()


@pytest.mark.usefixtures("started")
def test_the_files_hold_the_packages_own_numbers():
    machine = p3dof.read_parameters("machine.yaml")
    assert machine.geometry == p3dof.SOLIDS.geometry
    assert machine.limits.travel == p3dof.SOLIDS.limits.travel
    np.testing.assert_allclose(machine.limits.tilt, p3dof.SOLIDS.limits.tilt, rtol=1e-15)
    for name, body in p3dof.SOLIDS.bodies.items():  # six digits
        found = getattr(machine.bodies, name)
        assert found.mass == pytest.approx(body.mass, rel=5e-6)
        np.testing.assert_allclose(found.com, body.com, rtol=5e-6, atol=1e-12)
        np.testing.assert_allclose(found.inertia.diagonal(), body.inertia.diagonal(), rtol=5e-6)
    catalogue = read_catalogue("drives.yaml")
    assert [drive.name for drive in catalogue] == [drive.name for drive in GENERIC]
    for found, motor in zip(catalogue.motors, GENERIC.motors, strict=True):
        np.testing.assert_allclose(found.curve, motor.curve, rtol=1e-15)
        assert found.inertia == pytest.approx(motor.inertia, rel=1e-15)
    for found, screw in zip(catalogue.transmissions, GENERIC.transmissions, strict=True):
        assert found.inertia == pytest.approx(screw.inertia, rel=1e-14)
    motion, paper = p3dof.Motion.from_csv("motion.csv"), p3dof.paper_motion(41)
    np.testing.assert_allclose(motion.pose, paper.pose, rtol=5e-6, atol=1e-14)


def test_generic_bearings_are_those_of_their_size():
    """A 6000 with seven balls of 3/16 inch by ISO 281 and ISO 76; similar rails of 15, 20 and 23 mm."""
    text = starting_files()["bearings.yaml"]
    hinges = read_bearings(io.StringIO(text)).hinges
    assert (hinges.X, hinges.Y, hinges.e) == (0.56, 2.30, 0.19)  # ISO 281, f0 Fa / C0 = 0.172
    balls, ball, ratio = 7, 4.762, 4.762 / 18
    within = (1 + (1.04 * ((1 - ratio) / (1 + ratio)) ** 1.72) ** (10 / 3)) ** -0.3
    fc = 39.9 * within * ratio**0.3 * (1 - ratio) ** 1.39 / (1 + ratio) ** (1 / 3) * 26**0.41
    assert 0.9 < hinges.dynamic / (1.3 * fc * balls ** (2 / 3) * ball**1.8) < 1
    assert 0.9 < hinges.static / (12.3 * balls * ball**2) < 1
    rows = re.findall(r"\{name: generic \d\d, .*\}", text)
    guides = [read_bearings(io.StringIO(f"guides: {row}")).guides for row in rows]
    assert [guide.name for guide in guides] == ["generic 15", "generic 20", "generic 25"]
    for guide, width in zip(guides, (15, 20, 23), strict=True):
        assert 0.9 < guide.dynamic / (44 * width**2) < 1.05
        assert 1.3 < guide.static / guide.dynamic < 1.6
        across, along = (share * width * guide.dynamic / 1e3 for share in (0.35, 0.45))
        for moment, exact in zip(guide.moments, (across, across, along), strict=True):
            assert 0 <= exact - moment < 5


def test_every_number_of_a_file_to_start_from_has_a_unit_or_a_remark():
    for name, text in starting_files().items():
        assert text.startswith("# ")
        assert "$" not in text
        if name == "machine.yaml":
            lines = [line for line in text.splitlines() if re.search(r"\d", line) and line[0] != "#"]
            assert len(lines) == 21
            assert all(re.search(r" (mm|g|m/s|N|deg|kg mm\^2)\b|# m/s\^2", line) for line in lines)


def test_init_writes_all_files_or_none(tmp_path, capsys):
    folder = tmp_path / "new" / "machine"
    assert run(capsys, "init", folder)[0] == 0
    assert sorted(path.name for path in folder.iterdir()) == FILES
    own = folder / "task.yaml"
    own.write_text("mine")
    for path in folder.iterdir():
        if path != own:
            path.unlink()
    code, out, err = run(capsys, "init", folder)
    assert (code, out) == (2, "")
    assert err == f"p3dof: error: {own} exists already: nothing was written; --force overwrites it\n"
    assert [path.name for path in folder.iterdir()] == ["task.yaml"]
    assert own.read_text() == "mine"
    assert run(capsys, "init", folder, "--force")[0] == 0
    assert own.read_text() != "mine"
    (folder / "drives.yaml").unlink()
    (folder / "drives.yaml").mkdir()
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    own.write_text("mine again")
    code, _, err = run(capsys, "init", folder, "--force")
    assert code == 2
    assert "drives.yaml" in err
    assert own.read_text() == "mine again"
    assert len(before) == 4


def finding(out, name):
    return next(line.split(maxsplit=1) for line in out.splitlines() if line[9:].startswith(f"{name} "))


def test_doctor_has_a_line_for_everything_and_the_same_as_json(capsys):
    code, out, _ = run(capsys, "doctor")
    assert code == 0
    lines = [(line[:9].strip(), line[9:21].strip(), line[21:]) for line in out.splitlines()]
    names = ["p3dof", "Python", *start.REQUIRED, "kernels", *start.EXTRAS, *start.ENGINES]
    assert [name for _, name, _ in lines] == [*names, "C compiler", "browser", "cache"]
    assert lines[0][2] == f"{p3dof.__version__} in {Path(p3dof.__file__).parent}"
    assert ("ok", "numpy", np.__version__) in lines
    code, out, _ = run(capsys, "doctor", "--json")
    data = json.loads(out)
    assert (code, data["works"]) == (0, True)
    assert [(one["state"], one["name"], one["detail"]) for one in data["findings"]] == lines


def test_doctor_says_what_is_missing_is_for(capsys, monkeypatch, tmp_path):
    from p3dof.loops.compiled import build

    real = metadata.version
    gone = ("matplotlib", "drake")

    def version(name):
        if name in gone:
            raise metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(metadata, "version", version)
    for name, value in {
        "PATH": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "c"),
        "HOME": str(tmp_path),
    }.items():
        monkeypatch.setenv(name, value)
    for name in ("CC", "CHROMIUM", "PLAYWRIGHT_BROWSERS_PATH"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(build, "_private", lambda _: False)  # somebody else's
    build.compiler.cache_clear()
    try:
        code, out, _ = run(capsys, "doctor")
    finally:
        build.compiler.cache_clear()
    assert code == 0
    assert "missing  plot        for figures (matplotlib): pip install 'p3dof[plot]'\n" in out
    assert (
        "missing  drake       for cross-checks of the forces (drake): pip install 'p3dof[engines]'\n" in out
    )
    for name in ("C compiler", "browser", "cache"):
        assert f"missing  {name:12}for " in out


def test_doctor_tells_a_broken_import_from_a_missing_extra(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy", None)
    code, out, _ = run(capsys, "doctor")
    assert code == 1
    assert re.search(
        r"^BROKEN   scipy       .*; try: pip install --force-reinstall scipy$", out, re.MULTILINE
    )
    code, out, _ = run(capsys, "doctor", "--json")
    assert (code, json.loads(out)["works"]) == (1, False)
    monkeypatch.undo()
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    code, out, _ = run(capsys, "doctor")
    assert code == 0
    assert "missing  kernels     numpy: P3DOF_LEVEL asks for it\n" in out


def test_doctor_knows_every_extra_and_what_it_needs():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]

    def needs(extra):
        for line in extras[extra]:
            own = re.match(r"p3dof\[([\w,]+)\]", line)
            yield from (
                (part for one in own[1].split(",") for part in needs(one))
                if own
                else [re.match(r"[\w.-]+", line)[0]]
            )

    tools = {"interop", "test", "dev", "docs", "adapters", "torch"}  # which the package imports nothing of
    assert set(start.EXTRAS) | {"engines"} == set(extras) - tools
    for extra, (_, packages) in start.EXTRAS.items():
        assert packages.split() == sorted(set(needs(extra)), key=str.lower), extra
    assert sorted(start.ENGINES) == sorted(needs("engines"))
    page = (ROOT / "docs" / "how-to" / "install.md").read_text(encoding="utf-8")
    assert {*start.EXTRAS, "engines"} <= set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))


def test_bash_completes_commands_options_values_and_files(tmp_path):
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("there is no bash here")
    program = tmp_path / "p3dof"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m p3dof "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    script = """
eval "$(p3dof completion bash)"
compopt() { echo "names as by $2"; }
complete -p p3dof
try() {
  COMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); COMPREPLY=(); _p3dof_completion p3dof; echo "$* -> ${COMPREPLY[*]}"
}
try p3dof comp
try p3dof loop fo
try p3dof compare --sam
try p3dof forces --method v
try p3dof forces --motion m
try p3dof plots --out m
"""
    path = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [bash, "--norc", "-c", script], capture_output=True, text=True, check=True, env={**os.environ, **path}
    )
    assert done.stdout.splitlines() == [
        "complete -o nosort -F _p3dof_completion p3dof",
        "p3dof comp -> completion compare compare-designs",
        "p3dof loop fo -> forces",
        "p3dof compare --sam -> --samples",
        "p3dof forces --method v -> virtual-power",
        "names as by default",
        "p3dof forces --motion m -> ",
        "names as by dirnames",
        "p3dof plots --out m -> ",
    ]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script_too(capsys, shell):
    code, out, _ = run(capsys, "completion", shell)
    assert code == 0
    assert "_P3DOF_COMPLETE" in out
    assert shell in out


SLIPS = {
    # words
    "force": "no such command 'force'; did you mean 'forces'?",
    "load": "no such command 'load'; p3dof.load is Python, no command",
    "info four_bar.urdf": "no such command 'info'; did you mean 'loop info'?",
    "four_bar.urdf": "no such command*; a command stands before a file: 'p3dof loop info four_bar.urdf'",
    "forces motion.csv": "unexpected argument 'motion.csv'; did you mean --motion motion.csv?",
    "export mjcf": "unexpected argument 'mjcf'; did you mean --format mjcf?",
    "forces --paramters machine.yaml": "no such option '--paramters'; did you mean '--parameters'?",
    "forces --method pinochio": "'pinochio' is not one of 'pinocchio', 'virtual-power', 'compiled'.",
    "indices --index condtion": "got 'condtion'; did you mean 'condition'",
    "size": "Missing argument 'TASK'.",
    "forces --motion": "Option '--motion' requires an argument.",
    # numbers
    "forces --payload 2,5": "'--payload': expected a mass [kg], or a mass and x,y,z [m], got '2,5'",
    "compare --tolerance 0,5": "expected a number, got '0,5'; with a decimal point it is 0.5",
    "fastest task.yaml --max-force 0,3kN": "got '0,3kN'; with a decimal point it is 0.3kN",
    "fastest task.yaml --max-force 300W": "'--max-force': expected a force such as '5 kN', got '300W'",
    "forces --samples 1e3": "'--samples': expected a whole number, got '1e3'",
    "plan task.yaml --duration 2kg": "'--duration': expected a time such as '5 ms', got '2kg'",
    "compare --tolerance 1mm": "expected a number, got '1mm'; write it without a unit",
    "indices --pose [0.1,0,0]": "expected y,z,theta such as '0.1,0,-30 deg' or '100 mm,0,0', got '[0.1,0,0]'",
    "indices --pose 0.1;0;0": "expected y,z,theta such as '0.1,0,-30 deg' or '100 mm,0,0', got '0.1;0;0'",
    "indices --pose 100,0,0": "is out of reach*(100 m: mm?): give the unit, as in '10 mm'",
    # motions
    "forces --motion motoin.csv": "'--motion': there is no file motoin.csv; did you mean 'motion.csv'?",
    "forces --motion absent.csv": "absent.csv: cannot be read (No such file or directory)",
    "forces --motion folder": "folder: cannot be read (it is a folder)",
    "forces --motion machine.yaml": "machine.yaml, line 4, column 1: expected t, got 'geometry:'",
    "forces --motion degrees.csv": "no force can do that*(30 rad: degrees?): give the unit*theta [deg]",
    "forces --motion mm.csv": "is out of reach*(100 m: mm?): give the unit, as in*y [mm]",
    "forces --motion ms.csv": "the motion takes 1000 s, at 0.0002 m/s at most (ms? write t [ms])",
    "forces --motion headless.csv": "column 1: expected t, got '0'*; a first line names the columns",
    "forces --motion brackets.csv": "expected t, got 't (s)'*; a unit is in square brackets: t [s]",
    "forces --motion comma.csv": "line 3, column y: expected a number, got '0,1'; with a decimal point",
    "forces --motion commas.csv": "line 3: expected 4 columns, got 5; decimals are written with a point",
    "forces --motion mixed.csv": "line 2: expected 4 columns, got 1; commas stand between the columns",
    "forces --motion trailing.csv": "column 5: expected ydot, got ''*; a comma too many?",
    "forces --motion semicolons.csv": "line 1: expected commas between the columns, got semicolons",
    "forces --motion spaces.csv": "line 1: expected commas between the columns, got spaces",
    "forces --motion nan.csv": "nan.csv, line 3, column y: expected a finite number, got nan",
    # machines, tasks and drives
    "forces --parameters motion.csv": "motion.csv: expected a YAML file, got a CSV file",
    "forces --parameters task.yaml": "task.yaml: unknown field 'name'*; this looks like a task",
    "forces --parameters four_bar.urdf": "looks like a URDF; p3dof loop and p3dof.load_robot read it",
    "forces --parameters typo.yaml": "typo.yaml: unknown field 'geometri'*; did you mean 'geometry'?",
    "forces --parameters point.yaml": "geometry.r: expected a length*, got '100,5 mm'; with a decimal point",
    "forces --parameters mm.yaml": "400 m is more than 20 m: lengths are in metres; did you mean '400 mm'",
    "forces --parameters tilt.yaml": "limits.tilt = 45 rad (degrees?)",
    "forces --parameters speed.yaml": "limits.speed = 2000 m/s (mm/s?)",
    "forces --parameters density.yaml": "density = 7.85 kg/m^3 (g/cm^3?)",
    "forces --parameters travel.yaml": "limits.travel = 200 m (mm?)",
    "forces --parameters grams.yaml": "platform.mass = 8157.31 kg in a machine of 0.65 m (g?)",
    "forces --parameters colon.yaml": "colon.yaml, line 6: not valid YAML*, and have a space after the colon",
    "forces --parameters two.yaml": "inertia: expected three numbers, or 3 x 3 of them, got shape (2,)",
    "forces --parameters solid.yaml": "expected 'solids', or mass, com and inertia of each, got 'solid'",
    "plan machine.yaml": "machine.yaml: unknown field 'geometry'*; this looks like a machine",
    "plan dwel.yaml": "dwel.yaml: waypoint 2: unknown field 'dwel'*; did you mean 'dwell'?",
    "plan slow.yaml": "waypoint 2: dwell = 200 s (ms? then write '200 ms')",
    "plan timeless.yaml": "duration: expected that of the whole task, since pick has none of its own",
    "size drives.yaml --drives task.yaml": "drives.yaml: unknown field 'motors'*; this looks like a cat",
    "size task.yaml --drives rpm.yaml": "generic 50 W: max_speed = 6000 rad/s (rpm?): a number without",
    "size task.yaml --drives rotor.yaml": "generic 50 W: inertia = 0.04 kg m^2 (kg cm^2?): a number without",
    "optimise machine.yaml": "machine.yaml: unknown field 'geometry'*; this looks like a machine",
    "tolerance machine.yaml": "unknown field 'geometry', expected sigma, variables; this looks like a",
    # files to write
    "forces --out result.xlsx": "result.xlsx: expected a file name that ends in .csv",
    "forces --out folder": "folder: expected a file name that ends in .csv",
    "compare --out result.csv": "expected a folder, got the name of a file, result.csv (result.csv/ is one)",
    "forces --out motion.csv --motion motion.csv": "motion.csv would be overwritten: it is already used",
    "report --out report.docx": "report.docx: expected a file name that ends in .html or .pdf",
    # other robots
    "loop info four_bar": "'four_bar' is no file and no robot by name; did you mean 'four_bar.urdf'?",
    "loop info machine.yaml": "machine.yaml: expected URDF, SDF or MJCF, this is not XML; "
    "a sidecar comes second",
    "loop info alone.urdf": "alone.urdf: read as an open tree*beside it (looked for alone.yaml, alone.yml)",
    "loop info four_bar.urdf machine.yaml": "unknown field 'geometry'*; this looks like a machine",
    "loop info four_bar.urdf empty.yaml": "expected a mapping with 'closed_loop'*, got nothing",
    "loop info four_bar.urdf tip.yaml": "the frame 'couplertip' does not exist; did you mean 'coupler_tip'",
    "loop info four_bar.urdf motors.yaml": "motors.yaml: unknown field 'motors', expected closed_loop, type",
    "loop assemble four_bar.urdf --set crank=1": "'crank' is not actuated; did you mean 'crank_joint'?",
    "loop assemble four_bar.urdf --set crank_joint=30": "30 rad is more than a turn (degrees? then write",
    "loop forces four_bar.urdf --motion motion.csv": "column 2: expected crank_joint, got 'y' (the col",
    "loop forces four_bar.urdf --motion crank.csv": "crank_joint is beyond a turn in rad (degrees? then name",
    "loop simulate four_bar.urdf --actuator-force crank_joint=2N": "expected a moment*, got '2N'",
    # Python
    "python robot.forces([0, 0], [0, 0], [0, 0])": "pose: expected shape (..., 3), got (2,)",
    "python robot.forces([0, 0, 0])": "missing 2 required positional arguments: 'velocity'",
    "python robot.forces([[0, 0, 0], [0]], *REST)": "expected real numbers, got rows of different lengths",
    "python robot.forces([0, np.nan, 0], *REST)": "pose: expected finite numbers, got [0.0, nan, 0.0]",
    "python robot.forces([0, 0, 30], *REST)": "beyond what the machine can do (30 rad: degrees?)",
    "python robot.forces('0,0,0', *REST)": "pose: expected real numbers, got '0,0,0'",
    "python robot.inverse_dynamics('motion.csv')": "got 'motion.csv'; p3dof.Motion.from_csv reads a file",
    "python robot.inverse_dynamics(np.zeros((9, 3)))": "got a ndarray; p3dof.Motion.from_poses takes poses",
    "python robot.inverse_dynamics(p3dof.paper_motion(9)).force": "did you mean 'forces'?",
    "python robot.simulate(p3dof.paper_motion(9))": "duration: expected real numbers, got a Motion",
    "python robot.simulate(1.0, controller='pd')": "expected one, such as PD(robot, motion), or forces",
    "python p3dof.load({'geometry': {}})": "expected Parameters, got dict; from_dict takes a dict",
    "python p3dof.Motion.from_csv('semicolons.csv')": "expected commas between the columns, got semicolons",
    "python p3dof.load_robot('four_bar')": "is no file and no robot by name; did you mean 'four_bar.urdf'?",
}
"""What is easily typed wrong, and what is said of it; a star stands for anything between.

Input that may be meant is computed with, and the line is a warning.
"""
REST = ((0, 0, 0), (0, 0, 0))


def slipped_files(texts):
    """Return files with mistakes, by name; `texts` are those to start from."""
    machine, robot = texts["machine.yaml"], (ROOT / "docs/_static/gallery/four_bar.urdf").read_text()
    sidecar = (ROOT / "docs/_static/gallery/four_bar.yaml").read_text()
    return {
        "degrees.csv": "t,y,z,theta\n0,0,0,0\n.5,0,0,10\n1,0,0,30\n",
        "mm.csv": "t,y,z,theta\n0,0,0,0\n.5,50,0,0\n1,100,0,0\n",
        "ms.csv": "t,y,z,theta\n0,0,0,0\n500,.1,0,0\n1000,0.2,0,0\n",
        "headless.csv": "0,0,0,0\n1,0,0,0.1\n",
        "brackets.csv": "t (s),y (mm),z (mm),theta (deg)\n0,0,0,0\n1,0,0,1\n",
        "comma.csv": 't,y,z,theta\n0,0,0,0\n1,"0,1",0,0\n',
        "commas.csv": "t,y,z,theta\n0,0,0,0\n1,0,1,0,0\n",
        "mixed.csv": "t,y,z,theta\n0;0;0;0\n1;0;0;0\n",
        "trailing.csv": "t,y,z,theta,\n0,0,0,0,\n1,0,0,0,\n",
        "semicolons.csv": "t;y;z;theta\n0;0;0;0\n1;0,1;0;0\n",
        "spaces.csv": "t y z theta\n0 0 0 0\n1 0 0 0.1\n",
        "nan.csv": "t,y,z,theta\n0,0,0,0\n1,nan,0,0\n2,0,0,0\n",
        "typo.yaml": machine.replace("geometry", "geometri"),
        "point.yaml": machine.replace("r: 100 mm", "r: 100,5 mm"),
        "mm.yaml": "geometry: {r: 100, R: 250, L: 400, b: 50}\nbodies: solids\n",
        "tilt.yaml": machine.replace("[-45 deg, 45 deg]", "[-45, 45]"),
        "travel.yaml": machine.replace("[-200 mm, 200 mm]", "[-200, 200]"),
        "speed.yaml": machine.replace("speed: 2 m/s", "speed: 2000"),
        "density.yaml": "geometry: {r: 0.1, R: 0.25, L: 0.4}\nbodies: solids\ndensity: 7.85\n",
        "grams.yaml": machine.replace("8157.31 g", "8157.31"),
        "colon.yaml": machine.replace("r: 100 mm", "r:100 mm"),
        "two.yaml": machine.replace("[406.302 kg mm^2, 406.302 kg mm^2, ", "[406.302 kg mm^2, "),
        "solid.yaml": "geometry: {r: 0.1, R: 0.25, L: 0.4}\nbodies: solid\n",
        "dwel.yaml": texts["task.yaml"].replace("    dwell:", "    dwel:"),
        "slow.yaml": texts["task.yaml"].replace("dwell: 200 ms", "dwell: 200", 1),
        "timeless.yaml": texts["task.yaml"].replace("    duration:", "    # duration:", 1),
        "rpm.yaml": texts["drives.yaml"].replace(" rpm", ""),
        "rotor.yaml": texts["drives.yaml"].replace(" kg cm^2", ""),
        "four_bar.urdf": robot,
        "alone.urdf": robot,
        "four_bar.yaml": sidecar,
        "tip.yaml": sidecar.replace("coupler_tip", "couplertip"),
        "motors.yaml": sidecar.replace("name_mot", "motors"),
        "empty.yaml": "",
        "crank.csv": "t,crank_joint\n0,30\n1,32\n2,38\n3,46\n4,55\n",
    }


def line_of_python(code):
    """Return the line that code ends with: an error, or a warning."""
    with pytest.raises((p3dof.P3dofError, ModelWarning, TypeError, AttributeError)) as told:
        eval(code, {"np": np, "p3dof": p3dof, "robot": p3dof.load(), "REST": REST})  # noqa: S307 - our own
    return str(told.value)


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_one_line_that_helps(started, capsys, monkeypatch, slip):
    monkeypatch.setenv("COLUMNS", "200")
    for name, text in slipped_files({name: (started / name).read_text() for name in FILES}).items():
        (started / name).write_text(text, encoding="utf-8")
    (started / "folder").mkdir()
    before = sorted(started.iterdir())
    if slip.startswith("python "):
        line = line_of_python(slip.removeprefix("python "))
    else:
        code, out, line = run(capsys, *slip.split())
        refused = line.startswith("p3dof: error: ")
        assert (code in (1, 2) and not out) if refused else out
        if "ms.csv" in slip:  # it stands among what there is to know of the forces
            line = next(each for each in out.splitlines(keepends=True) if "ms?" in each)
        assert line[-1] == "\n"
        line = line[:-1]
    assert "\n" not in line
    assert re.search(re.escape(SLIPS[slip]).replace(r"\*", ".*"), line), line
    assert sorted(started.iterdir()) == before


@pytest.mark.usefixtures("started")
def test_a_missing_extra_is_one_line_with_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    code, _, err = run(capsys, "report", "task.yaml", "--out", "r.html")
    assert code == 2
    assert (
        err == "p3dof: error: Invalid value for '--out': a report needs jinja2: pip install 'p3dof[report]'\n"
    )


def test_words_for_a_decimal_comma_a_missing_section_and_semicolons(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("m.yaml").write_text("geometry: {r: 0,12, R: 0.25}")
    Path("u.yaml").write_text("sigma: {R: 0.1 mm}")
    Path("d.csv").write_text("a;b\n1;2\n")
    for call, words in (
        ("forces --parameters m.yaml", "unknown field '12', expected r, R, L, b; decimals have a point"),
        ("sensitivity u.yaml --local", "u.yaml: expected a section 'variables', or --vary"),
        ("studio --designs d.csv --out s.html", "d.csv: expected commas between the columns, got semicolons"),
    ):
        code, out, err = run(capsys, *call.split())
        assert (code, out) == (2, "")
        assert words in err


def test_durations_and_lives_have_units(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "init", ".")[0] == 0
    plain = run(capsys, "size", "task.yaml", "--duration", "2.5", "--life", "20000 h", "--top", "1")
    assert plain[0] == 0
    for duration, life in (("2500 ms", "20000h"), ("2.5 s", "2e4h")):
        line = ("--duration", duration, "--life", life)
        assert run(capsys, "size", "task.yaml", *line, "--top", "1") == plain
