"""The command line as a user calls it: files, tables, exit codes, one line for every bad input."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from documents import ROOT

import p3dof
from p3dof.cli.app import COMMANDS, app
from p3dof.closed_form import compiled
from p3dof.machine.parameters import PAPER, Actuators, write_parameters


def test_compare_on_the_papers_motion(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")  # headers in one line
    code, out, err = run(capsys, "compare", "--samples", 101, "--out", tmp_path / "ö ut")
    assert code == 0
    assert "the methods agree" in out
    for word in (
        "Forces by pinocchio and by virtual-power",
        "closure error",
        "power residual",
        "time per sample",
    ):
        assert word in out
    table = np.genfromtxt(tmp_path / "ö ut" / "forces.csv", delimiter=",", skip_header=1)
    assert table.shape == (101, 10)
    expected = p3dof.load().inverse_dynamics(p3dof.paper_motion(101), method="virtual-power").forces
    np.testing.assert_array_equal(table[:, 4:7], expected)
    np.testing.assert_allclose(table[:, 1:4], expected, atol=1e-11)
    np.testing.assert_array_equal(table[:, 7:], table[:, 1:4] - table[:, 4:7])
    assert (tmp_path / "ö ut" / "forces.png").read_bytes().startswith(b"\x89PNG")
    assert "</svg>" in (tmp_path / "ö ut" / "forces.svg").read_text(encoding="utf-8")
    assert f"wrote {tmp_path / 'ö ut' / 'forces.csv'}" in out
    assert "Traceback" not in err


def test_compare_fails_when_the_methods_disagree(tmp_path, capsys, monkeypatch):
    from p3dof.methods import virtual_power

    real = virtual_power.forces_at
    monkeypatch.setattr(virtual_power, "forces_at", lambda *a, **k: real(*a, **k) * (1 + 1e-9))
    code, out, _ = run(capsys, "compare", "--samples", 11, "--out", tmp_path, "--no-plot")
    assert code == 1
    assert "the methods DISAGREE" in out
    code, out, _ = run(
        capsys, "compare", "--samples", 11, "--out", tmp_path, "--no-plot", "--tolerance", 1e-8
    )
    assert code == 0


def test_compare_with_files_and_invalid_samples(tmp_path, capsys):
    p3dof.write_parameters(p3dof.SOLIDS, tmp_path / "m.yaml")
    time = np.linspace(0, 1, 21)
    pose = np.column_stack([0.3 * time**2, 0 * time, 0 * time])
    p3dof.Motion.from_poses(time, pose).to_csv(tmp_path / "m.csv")
    arguments = ["compare", "--parameters", tmp_path / "m.yaml", "--motion", tmp_path / "m.csv"]
    code, _, err = run(capsys, *arguments, "--out", tmp_path / "o")
    assert code == 1
    assert "leg A is too short" in err
    code, out, _ = run(capsys, *arguments, "--out", tmp_path / "o", "--on-invalid", "nan", "--no-plot")
    assert code == 1
    assert "the methods agree" in out
    assert "of 21 samples are invalid and left NaN" in " ".join(out.split())


def test_compare_sees_that_the_methods_find_other_samples_valid(tmp_path, capsys, monkeypatch):
    from p3dof.methods import virtual_power

    real = virtual_power.forces_at

    def lame(*args, **kwargs):
        forces = real(*args, **kwargs)
        forces[3:4] = np.nan
        return forces

    monkeypatch.setattr(virtual_power, "forces_at", lame)
    code, out, _ = run(capsys, "compare", "--samples", 11, "--out", tmp_path, "--no-plot")
    assert code == 1
    assert "the methods DISAGREE" in out


def test_nothing_valid_is_not_agreement(tmp_path, capsys):
    (tmp_path / "m.csv").write_text("t,y,z,theta\n0,0.5,0,0\n1,0.5,0,0\n", encoding="utf-8")
    for command in ("compare", "forces"):
        code, out, err = run(capsys, command, "--motion", tmp_path / "m.csv", "--on-invalid", "nan")
        one_line(code, err, 1)
        assert re.search(r"no sample of the motion is within what the machine can do \(\d+ samples\)", err)
        assert "agree" not in out


def test_limits_are_told(tmp_path, capsys):
    text = (tmp_path / "m.yaml").write_text
    machine = p3dof.machine.parameters.machine.dump(PAPER).replace("force: 500.0", "force: 100")
    text(machine, encoding="utf-8")
    code, out, _ = run(
        capsys, "forces", "--method", "virtual-power", "--samples", 11, "--parameters", tmp_path / "m.yaml"
    )
    assert code == 0
    assert "limit exceeded: force of slider A: 118.498 N at t = 1 s, limit 100 N" in " ".join(out.split())


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power", "compiled"])
def test_forces(tmp_path, capsys, method):
    code, out, _ = run(
        capsys, "forces", "--method", method, "--samples", 51,
        "--out", tmp_path / "f.csv", "--figure", tmp_path / "f.pdf",
    )  # fmt: skip
    assert code == 0
    assert "118.4980" in out
    table = np.genfromtxt(tmp_path / "f.csv", delimiter=",", skip_header=1)
    assert table.shape == (51, 13)
    assert (tmp_path / "f.pdf").read_bytes().startswith(b"%PDF")


def test_urdf_writes_and_checks(tmp_path, capsys):
    code, out, _ = run(capsys, "urdf", "--out", tmp_path / "u")
    assert code == 0
    assert "p3dof.urdf" in out
    assert run(capsys, "urdf", "--out", tmp_path / "u", "--check")[0] == 0
    file = tmp_path / "u" / "p3dof.urdf"
    file.write_text(file.read_text().replace("0.9751", "0.9752", 1))
    code, out, _ = run(capsys, "urdf", "--out", tmp_path / "u", "--check")
    assert code == 1
    assert "0.9752" in out
    code, out, _ = run(capsys, "urdf", "--out", tmp_path / "nothing", "--check")
    assert code == 1
    assert "missing" in out
    assert not (tmp_path / "nothing").exists()


def test_committed_files_are_up_to_date(capsys):
    code, out, _ = run(capsys, "urdf", "--out", ROOT / "urdf", "--check")
    assert code == 0, out


def test_version_and_help(capsys):
    code, out, _ = run(capsys, "--version")
    assert (code, out.strip()) == (0, f"p3dof {p3dof.__version__} (kernels: {compiled.in_words()})")
    for command in ((), ("compare",), ("forces",), ("urdf",)):
        code, out, _ = run(capsys, *command, "--help")
        assert code == 0
        assert "Usage: p3dof" in out


HEADER = "t,y,z,theta"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,y,z\n0,0,0\n", "theta"),
        ("t,y,z,theta [furlong]\n0,0,0,0\n", "furlong"),
        (f"{HEADER}\n0,0,0,x\n1,0,0,0\n", "line 2"),
        (f"{HEADER}\n0,0,0,0\n1,0,nan,0\n", "line 3"),
        (f"{HEADER}\n1,0,0,0\n0,0,0,0\n", "line 3, column t: expected a time after 1"),
        ("", "empty"),
    ],
)
def test_bad_motion_files(tmp_path, capsys, text, words):
    file = tmp_path / "motion.csv"
    file.write_text(text, encoding="utf-8")
    for command in ("compare", "forces"):
        code, _, err = run(capsys, command, "--motion", file)
        one_line(code, err)
        assert "motion.csv" in err
        assert words in err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass: 8.1573", "mass: -1", "bodies.platform: mass"),
        ("mass: 8.1573", "mass: .nan", "bodies.platform: mass"),
        ("mass: 8.1573", "weight: 8", "'weight'"),
        ("R: 0.25", "R: 0.05", "geometry: r, R"),
        ("R: 0.25, ", "", "'R' is missing"),
        ("geometry:", "geometri:", "'geometri'"),
        ("- [0.0269, ", "- [9.0, ", "bodies.platform: inertia"),
        ("gravity: [", "gravity: [[", "line"),
    ],
)
def test_bad_parameter_files(tmp_path, capsys, old, new, words):
    text = p3dof.machine.parameters.machine.dump(PAPER)
    assert old in text
    file = tmp_path / "machine.yaml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    for command in ("compare", "forces", "urdf"):
        code, _, err = run(capsys, command, "--parameters", file)
        one_line(code, err)
        assert "machine.yaml" in err
        assert words in err


@pytest.mark.parametrize(
    "arguments",
    [
        ["compare", "--samples", "1"],
        ["compare", "--samples", "many"],
        ["compare", "--tolerance", "-1"],
        ["compare", "--tolerance", "nan"],
        ["compare", "--tolerance", "inf"],
        ["compare", "--motion", "m.csv", "--samples", "5"],
        ["compare", "--motion", "no such file.csv"],
        ["compare", "--parameters", "/"],
        ["forces", "--method", "adams"],
        ["forces", "--colour", "red"],
        ["forces", "--figure", "out/forces.doc", "--method", "virtual-power"],
        ["simulatee"],
    ],
)
def test_bad_arguments(capsys, arguments):
    code, _, err = run(capsys, *arguments)
    one_line(code, err)


def one_line(code, err, expected=2):
    assert code == expected, err
    assert err.startswith("p3dof: error: ")
    assert len(err.strip().splitlines()) == 1


def test_unreachable_and_singular_motions(tmp_path, capsys):
    file = tmp_path / "motion.csv"
    file.write_text(f"{HEADER}\n0,0,0,0\n1,0.4,0,0\n", encoding="utf-8")
    code, _, err = run(capsys, "compare", "--motion", file)
    one_line(code, err, 1)  # nothing is wrong with the file: the machine cannot do it
    assert "leg A is too short by 0.15 m (sample 1, the first of 1" in err
    file.write_text(f"{HEADER}\n0,0,0,0\n1,0,0,{np.pi / 3!r}\n", encoding="utf-8")
    code, _, err = run(capsys, "forces", "--motion", file)
    one_line(code, err, 1)
    assert "actuation-singular" in err


def test_folder_that_cannot_be_written_leaves_files_whole(tmp_path, capsys):
    blocker = tmp_path / "file"
    blocker.write_text("mine", encoding="utf-8")
    for command in ("compare", "urdf"):
        code, _, err = run(capsys, command, "--out", blocker)
        one_line(code, err)
        assert str(blocker) in err
    assert blocker.read_text(encoding="utf-8") == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_without_matplotlib_compare_still_works(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    code, out, err = run(capsys, "compare", "--samples", 11, "--out", tmp_path)
    assert code == 0
    assert "p3dof[plot]" in err
    assert "the methods agree" in out
    code, _, err = run(capsys, "forces", "--samples", 11, "--figure", tmp_path / "f.png")
    one_line(code, err)
    assert "p3dof[plot]" in err


def test_as_a_process_with_a_closed_pipe(tmp_path):
    """The real program: exit code, nothing but text in a pipe, and no traceback when the reader leaves."""
    command = [sys.executable, "-m", "p3dof", "compare", "--samples", "21", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert not re.search(r"\x1b\[", done.stdout)
    (tmp_path / "forces.csv").unlink()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        error = process.stderr.read()
        process.wait(60)
    assert error == ""
    assert process.returncode == 141  # as the shell has it for SIGPIPE; 1 would be a failed check
    assert (tmp_path / "forces.csv").read_text().count("\n") == 22  # files come before the tables


def test_inputs_and_outputs_are_never_the_same_file(tmp_path, capsys):
    motion, machine = tmp_path / "motion.csv", tmp_path / "p3dof.yaml"
    p3dof.paper_motion(5).to_csv(motion)
    p3dof.write_parameters(PAPER, machine)
    before = {path: path.read_bytes() for path in (motion, machine)}
    for arguments in (
        ["forces", "--motion", motion, "--out", motion],
        ["forces", "--motion", motion, "--out", tmp_path / "." / "motion.csv"],
        ["show", "--out", tmp_path / "a.png", "--screenshot", tmp_path / "." / "a.png"],
        ["urdf", "--parameters", machine, "--out", tmp_path],
        ["export", "--parameters", machine, "--out", tmp_path],
    ):
        code, _, err = run(capsys, *arguments)
        one_line(code, err)
        assert "would be overwritten" in err
    assert {path: path.read_bytes() for path in before} == before
    motion.rename(tmp_path / "forces.csv")
    code, _, err = run(capsys, "compare", "--motion", tmp_path / "forces.csv", "--out", tmp_path)
    one_line(code, err)


def test_crossing_a_singularity_is_told(tmp_path, capsys):
    theta = np.arange(0, 1.95, 0.1)
    p3dof.Motion.from_poses(theta, np.column_stack([0 * theta, 0 * theta, theta])).to_csv(tmp_path / "m.csv")
    told = "after t = 1 s the motion crosses an actuation singularity: no force can do that"
    out = tmp_path / "f.csv"
    code, _, err = run(capsys, "forces", "--motion", tmp_path / "m.csv", "--out", out)
    one_line(code, err, 1)
    assert told in err
    assert not out.exists()
    arguments = ("--motion", tmp_path / "m.csv", "--on-invalid", "nan")
    code, shown, _ = run(capsys, "forces", *arguments, "--out", out)
    assert code == 1
    assert told in shown
    assert not re.search(r"\d N\b|[ABC] +│ +-?\d", shown)  # no peak
    table = np.genfromtxt(out, delimiter=",", skip_header=1)
    assert np.flatnonzero(np.isnan(table[:, 1:4]).any(axis=1)).tolist() == [10, 11]


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_any_terminal_gets_its_tables(tmp_path, encoding):
    command = [
        sys.executable,
        "-m",
        "p3dof",
        "compare",
        "--samples",
        "5",
        "--no-plot",
        "--out",
        str(tmp_path),
    ]
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert b"the methods agree" in done.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_behind_the_output_is_one_line(tmp_path):
    command = [
        sys.executable,
        "-m",
        "p3dof",
        "compare",
        "--samples",
        "5",
        "--no-plot",
        "--out",
        str(tmp_path),
    ]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    one_line(done.returncode, done.stderr)


def test_export_leaves_out_formats_that_cannot_hold_the_machine(tmp_path, capsys):
    """Aloud, each with its reason; what was written before for another machine is named."""
    machine, out = tmp_path / "machine.yaml", tmp_path / "model"
    write_parameters(replace(PAPER, actuators=Actuators(counterbalance={"slide_a": 30.0})), machine)
    stale = out / "p3dof.sdf"
    stale.parent.mkdir()
    stale.write_text("of another machine")
    for more in ((), ("--check",)):
        code, told, err = run(capsys, "export", "--parameters", machine, "--out", out, *more)
        assert code == 0, err
        for name in ("drake", "sdf", "urdf+"):
            (line,) = (one for one in err.splitlines() if one.startswith(f"p3dof: {name} left out: "))
            assert "has no word for a counterbalance, which slide_a has" in line
            assert line.endswith(f"; {stale} stays as it was") == (name == "sdf")
        assert "p3dof: usd left out: " in err
    names = {"p3dof.urdf", "p3dof.yaml", "p3dof_mjcf.xml", "p3dof.srdf"}
    assert {path.name for path in out.iterdir()} == names | {stale.name}
    assert stale.read_text() == "of another machine"
    assert "up to date" in told
    # What is asked for by name is an error, and so is a file that another format cannot write: nothing is.
    other = tmp_path / "other"
    asked = ("--format", "urdf", "--format", "sdf")
    code, _, err = run(capsys, "export", "--parameters", machine, "--out", other, *asked)
    assert code == 2
    one_line(code, err)
    assert not other.exists()
    (out / "p3dof.srdf").write_text("mine")
    (out / "p3dof.urdf").unlink()
    assert run(capsys, "export", "--parameters", machine, "--out", out)[0] == 2
    assert not (out / "p3dof.urdf").exists()


def test_export_writes_and_checks_every_format(tmp_path, capsys):
    from p3dof.machine import description

    code, out, err = run(capsys, "export", "--out", tmp_path / "ö x")
    assert code == 0, err
    files = {file for formats in description.FORMATS.values() for file in formats}
    written = {path.name for path in (tmp_path / "ö x").iterdir()}
    assert written == files or "usd left out" in err
    assert out.count("wrote ") == len(written)
    assert run(capsys, "export", "--out", tmp_path / "ö x", "--check")[0] == 0
    code, out, _ = run(capsys, "export", "--out", tmp_path / "two", "--format", "mjcf", "--format", "sdf")
    assert code == 0
    assert {path.name for path in (tmp_path / "two").iterdir()} == {"p3dof_mjcf.xml", "p3dof.sdf"}
    code, out, _ = run(capsys, "export", "--out", tmp_path / "two", "--check")
    assert code == 1
    assert "p3dof.urdf: missing" in out
    code, _, err = run(capsys, "export", "--format", "cad")
    one_line(code, err)


def test_many_differences_are_not_all_printed(tmp_path, capsys):
    run(capsys, "urdf", "--out", tmp_path)
    file = tmp_path / "p3dof.urdf"
    file.write_text(file.read_text().replace("<robot", "<!-- one line more -->\n<robot", 1))
    code, out, _ = run(capsys, "urdf", "--out", tmp_path, "--check")
    assert code == 1
    assert len(out.splitlines()) < 30
    assert "more differences" in out


def test_the_exact_variant(tmp_path, capsys):
    assert run(capsys, "urdf", "--exact", "--out", tmp_path)[0] == 0
    assert '<link name="crossbar_upper">' in (tmp_path / "p3dof.urdf").read_text()
    assert (tmp_path / "p3dof.urdf").read_text().count("<inertial>") == 8
    assert run(capsys, "urdf", "--exact", "--out", tmp_path, "--check")[0] == 0
    assert run(capsys, "urdf", "--out", tmp_path, "--check")[0] == 1


@pytest.mark.parametrize(
    ("work", "loaded"),
    [
        ("pass", []),
        # Names are imported when they are first used: touch them all, and compute.
        ("[getattr(p3dof, name) for name in p3dof.__all__ if name[0].isupper()]", ["numpy", "pinocchio"]),
        (
            "from p3dof.methods.registry import METHODS; "
            "[p3dof.load().forces([0] * 3, [0] * 3, [0] * 3, method=m) for m in METHODS if m != 'pinocchio']",
            ["numpy"],
        ),
        ("p3dof.load().forces([0] * 3, [0] * 3, [0] * 3)", ["numpy", "pinocchio"]),
    ],
)
def test_start_up_loads_nothing_that_is_not_used(work, loaded):
    libraries = (
        "numpy", "pinocchio", "scipy", "matplotlib", "pxr", "rich", "click", "meshcat", "tornado", "jinja2",
        "casadi", "mujoco", "exudyn", "pydrake",
    )  # fmt: skip
    code = f"import sys, p3dof; {work}; print([m for m in {libraries} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(loaded)


def test_interrupt_is_one_line(monkeypatch, capsys):
    from p3dof.cli import machine

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(machine, "load", interrupted)
    code, _, err = run(capsys, "compare")
    assert code == 130
    assert err == "p3dof: error: interrupted\n"


def test_output_does_not_depend_on_the_folder_it_runs_in(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "forces", "--samples", 5, "--method", "virtual-power", "--out", "f.csv")[0] == 0
    assert os.listdir(tmp_path) == ["f.csv"]  # noqa: PTH208


def test_files_of_another_machine_have_a_folder_of_their_own(tmp_path, capsys, monkeypatch):
    """`urdf --parameters mine.yaml` in a clone leaves the files of the paper's machine alone."""
    monkeypatch.chdir(tmp_path)
    machine = tmp_path / "mine.yaml"
    p3dof.write_parameters(replace(PAPER, geometry=p3dof.machine.Geometry(r=0.12)), machine)
    assert run(capsys, "export", "--format", "urdf", "--format", "sdf")[0] == 0
    before = {path: path.read_bytes() for path in (tmp_path / "urdf").iterdir()}
    assert len(before) == 3
    for command in (("urdf",), ("export", "--format", "sdf")):
        assert run(capsys, *command, "--parameters", machine)[0] == 0
        assert run(capsys, *command, "--parameters", machine, "--check")[0] == 0
        code, _, err = run(capsys, *command, "--parameters", machine, "--out", "urdf")
        assert code == 2
        assert "would be overwritten, but describes the paper's machine" in err
        assert "--force" in err
    assert {path: path.read_bytes() for path in (tmp_path / "urdf").iterdir()} == before
    assert {path.name for path in (tmp_path / "out" / "urdf").iterdir()} == {path.name for path in before}
    assert run(capsys, "urdf", "--check")[0] == 0
    assert run(capsys, "urdf", "--parameters", machine, "--out", "urdf", "--force")[0] == 0
    assert run(capsys, "urdf", "--check")[0] == 1
    (tmp_path / "urdf" / "p3dof.urdf").write_text("<robot name='somebody else'/>")
    code, _, err = run(capsys, "urdf")
    assert code == 2
    assert "p3dof.urdf: would be overwritten, but was not generated by p3dof" in err


def test_the_program_knows_all_its_commands_before_it_imports_them():
    entries = [entry for commands in COMMANDS.values() for entry in commands.items()]
    for _, (module, _) in entries:
        importlib.import_module(module)
    assert set(app.commands) == {name for name, _ in entries}
    assert len({name for name, _ in entries}) == len(entries)


@pytest.mark.parametrize(
    ("arguments", "environment"),
    [
        (["--help"], {}),
        (["--version"], {}),
        ([], {"_P3DOF_COMPLETE": "bash_complete", "COMP_WORDS": "p3dof com", "COMP_CWORD": "1"}),
    ],
)
def test_what_is_said_at_once_loads_no_model(arguments, environment):
    script = (
        "import sys; from p3dof.__main__ import main\n"
        f"sys.argv = ['p3dof', *{arguments}]\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = ['pinocchio', 'rich', 'scipy', 'matplotlib', 'meshcat', 'tornado']\n"
        "heavy += [] if '--version' in sys.argv else ['numpy', 'email']\n"
        "sys.stderr.write(str([name for name in heavy if name in sys.modules]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=True,
    )
    assert done.stderr == "[]"
    assert "compare" in done.stdout or "kernels" in done.stdout


@pytest.mark.slow
def test_a_report_loads_no_visualizer_that_it_does_not_use(tmp_path):
    """Pinocchio would, where they are installed."""
    script = (
        "import gc, sys; from p3dof.__main__ import main\n"
        f"sys.argv = ['p3dof', 'report', '--samples', '5', '--out', {str(tmp_path / 'r.html')!r}]\n"
        "main()\n"
        "loaded = [name for name in ('meshcat', 'viser', 'trimesh') if sys.modules.get(name) is not None]\n"
        "sys.stderr.write(str(loaded)); assert gc.isenabled() and gc.get_threshold()[0] > 10_000"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr == "[]"
