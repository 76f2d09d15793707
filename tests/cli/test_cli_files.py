"""Files of the command line: endings decide or are refused, before any work; ``-`` is a stream."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import p3dof
from p3dof.cli import main
from p3dof.machine.parameters import PAPER

COLUMNS = {"forces": "fA [N]", "energy": "kinetic", "reactions": "slide_a"}


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def idle(monkeypatch):
    """Nothing may be computed."""

    def work(*_, **__):
        raise AssertionError("it worked before it looked where to write")

    for name in ("inverse_dynamics", "reactions", "simulate", "energy"):
        monkeypatch.setattr(p3dof.Manipulator, name, work)
    for name in ("write", "texts"):
        monkeypatch.setattr(p3dof.machine.description, name, work)


ENDINGS = [
    ("forces --out o.xlsx", "o.xlsx: expected a file name that ends in .csv"),
    ("forces --out o", "o: expected a file name that ends in .csv"),
    ("forces --out o.csv.gz", "ends in .csv"),
    ("forces --figure f.jpg", "ends in .png, .svg or .pdf"),
    ("energy --out e.json", "ends in .csv"),
    ("energy --figure e.gif", "ends in .png, .svg or .pdf"),
    ("reactions --out r.ods", "ends in .csv"),
    ("reactions --figure r.html", "ends in .png, .svg or .pdf"),
    ("report --out r.docx", "ends in .html or .pdf"),
    ("report --out r", "ends in .html or .pdf"),
    ("show --out s.webm", "ends in .html, .mp4, .gif or .png"),
    ("show --video s.html", "ends in .mp4 or .gif"),
    ("show --screenshot s.jpg", "ends in .png"),
    ("compare --out -", "--out': expected a folder: several files do not fit"),
    ("plots --out -", "--out': expected a folder: several files do not fit"),
    ("simulate --out -", "--out': expected a folder: several files do not fit"),
    ("codegen --out -", "--out': expected a folder: several files do not fit"),
    ("urdf --out x.urdf", "--out': expected a folder, got the name of a file, x.urdf (x.urdf/ is one)"),
    ("export --out x.xml", "expected a folder, got the name of a file"),
    ("plots --out a.png", "expected a folder, got the name of a file"),
    ("compare --out a.CSV", "expected a folder, got the name of a file"),
    ("codegen --out a.c", "expected a folder, got the name of a file"),
    ("sweep s.yaml --out a.npz", "expected a folder, got the name of a file"),
]


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(("line", "words"), ENDINGS)
def test_an_ending_that_is_not_written_is_refused_before_the_work(capsys, tmp_path, monkeypatch, line, words):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *line.split())
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


NOWHERE = [
    ("forces --out file/o.csv", "Not a directory"),
    ("forces --out folder.csv", "it is a folder"),
    ("forces --figure /dev/full/f.png", "Not a directory"),
    ("energy --out /proc/e.csv", "cannot be written"),
    ("reactions --out file/deep/r.csv", "Not a directory"),
    ("report --out file/r.pdf", "Not a directory"),
    ("show --out file/s.html", "Not a directory"),
    ("show --video file/s.gif", "Not a directory"),
    ("compare --out file", "Not a directory"),
    ("compare --out /dev/full", "Not a directory"),
    ("plots --out file/figures", "Not a directory"),
    ("simulate --out file", "Not a directory"),
    ("urdf --out file", "Not a directory"),
    ("export --out file/deep", "Not a directory"),
    ("codegen --out file", "Not a directory"),
    ("forces --out loop/o.csv", "cannot be written"),
]


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(("line", "words"), NOWHERE)
def test_what_cannot_be_written_is_refused_before_the_work(capsys, tmp_path, monkeypatch, line, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    before = sorted(tmp_path.rglob("*"))
    code, out, err = run(capsys, *line.split())
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "file").read_text() == "kept"


ROOT = "/p3dof-is-not-here"


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(
    "line",
    [
        f"forces --out {ROOT}/a.csv",
        f"forces --figure {ROOT}/deep/a.png",
        f"report --out {ROOT}/a.html",
        f"urdf --out {ROOT}",
        f"plots --out {ROOT}/deep",
        f"codegen --out {ROOT}",
    ],
)
def test_no_folder_is_made_at_the_root_of_the_file_system(capsys, line):
    """Who is root in a container would else write where nothing is mounted, and lose it."""
    code, out, err = run(capsys, *line.split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"(there is no folder {ROOT})" in err
    assert not Path(ROOT).exists()


def test_other_folders_are_made_by_every_command(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for line in ("forces --samples 5 --out a/b/f.csv", "urdf --out c/d", "export --format mjcf --out e.x/f"):
        assert run(capsys, *line.split())[0] == 0
    assert {path.name for path in tmp_path.rglob("*.*") if path.is_file()} >= {"f.csv", "p3dof.urdf"}


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(
    ("stream", "line", "words"),
    [
        ("stdout", "forces --out -", "--out': the standard output is closed"),
        ("stdout", "urdf --out -", "--out': the standard output is closed"),
        ("stdout", "indices --json", "--json': the standard output is closed"),
        ("stdin", "forces --motion -", "--motion': the standard input is closed"),
        ("stdin", "loop assemble -", "'FILE': the standard input is closed"),
    ],
)
def test_what_would_be_lost_in_a_closed_stream_is_refused(capsys, monkeypatch, stream, line, words):
    monkeypatch.setattr(sys, stream, None)
    code = main(line.split())
    if stream == "stdout":
        sys.stdout.close()  # what stood for it
    monkeypatch.undo()
    err = capsys.readouterr().err
    assert (code, err.count("\n")) == (2, 1)
    assert words in err


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(
    ("line", "module", "extra"),
    [
        ("forces --figure f.png", "matplotlib.figure", "plot"),
        ("report --out r.html", "matplotlib.figure", "report"),
        ("report --out r.pdf", "playwright", "video"),
        ("show --out s.mp4", "playwright", "video"),
    ],
)
def test_a_library_that_is_missing_is_told_before_the_work(
    capsys, tmp_path, monkeypatch, line, module, extra
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    code, out, err = run(capsys, *line.split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"pip install 'p3dof[{extra}]'" in err


@pytest.mark.parametrize("command", COLUMNS)
def test_a_table_goes_to_the_standard_output_and_messages_aside(capsys, tmp_path, command):
    arguments = (command, "--samples", 5)
    assert run(capsys, *arguments, "--out", tmp_path / "t.csv")[0] == 0
    figure = tmp_path / "f.svg"
    code, out, err = run(capsys, *arguments, "--out", "-", "--figure", figure)
    assert code == 0
    assert out == (tmp_path / "t.csv").read_text()
    assert COLUMNS[command] in out.splitlines()[0]
    assert len(out.splitlines()) == 6
    assert f"wrote {figure}" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["f.svg", "t.csv"]


def test_models_go_to_the_standard_output(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "export", "--format", "urdf", "--format", "sdf", "--out", "o")[0] == 0
    code, out, err = run(capsys, "urdf", "--out", "-")
    assert (code, out) == (0, Path("o/p3dof.urdf").read_text())
    assert err == "p3dof: p3dof.yaml, which belongs to it, is written to a folder only\n"
    code, out, err = run(capsys, "export", "--format", "sdf", "--out", "-")
    assert (code, out, err) == (0, Path("o/p3dof.sdf").read_text(), "")
    for arguments in (("export", "--out", "-"), ("urdf", "--out", "-", "--check")):
        code, out, err = run(capsys, *arguments)
        assert (code, out) == (2, "")
        assert "expected" in err
    assert not Path("-").exists()


def with_input(monkeypatch, content):
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content), encoding="ascii"))


@pytest.mark.parametrize("option", ["--parameters", "--motion", "--wrench"])
def test_each_input_may_be_the_standard_input(capsys, tmp_path, monkeypatch, option):
    file = tmp_path / ("m.yaml" if option == "--parameters" else "m.csv")
    if option == "--parameters":
        p3dof.write_parameters(p3dof.SOLIDS, file)
    elif option == "--motion":
        p3dof.Motion.rest_to_rest([0, 0, 0], [0.01, 0, 0], 0.5, 21).to_csv(file)
    else:
        file.write_text("t,fx,fy,fz,mx,my,mz\n0,0,0,-50,0,0,0\n1,0,0,50,0,0,0\n")
    command = ("forces", "--method", "virtual-power", "--out", "-")
    _, plain, _ = run(capsys, *command)
    code, known, _ = run(capsys, *command, option, file)
    assert code == 0
    assert known != plain
    with_input(monkeypatch, file.read_bytes())
    assert run(capsys, *command, option, "-")[:2] == (0, known)
    with_input(monkeypatch, b"\xff\xfe")
    code, out, err = run(capsys, *command, option, "-")
    assert (code, out) == (2, "")
    assert "standard input: expected UTF-8 text" in err
    with_input(monkeypatch, b"nonsense: [")
    assert "standard input" in run(capsys, *command, option, "-")[2]


@pytest.mark.usefixtures("idle")
def test_only_one_input_can_be_the_standard_input(capsys):
    for options in (("--parameters", "--motion"), ("--motion", "--wrench")):
        for command in ("forces", "show", "simulate", "report", "plots", "compare"):
            code, out, err = run(capsys, command, options[0], "-", options[1], "-")
            assert (code, out) == (2, "")
            assert "only one file can be read from the standard input" in err


def test_commands_in_a_pipe(tmp_path):
    """A machine from one program, its forces to another one, and nothing else between."""
    p3dof.write_parameters(PAPER, tmp_path / "m.yaml")
    command = [sys.executable, "-m", "p3dof", "forces", "--samples", "5", "--parameters", "-", "--out", "-"]
    options = {"capture_output": True, "text": True, "cwd": tmp_path}
    ran = subprocess.run(command, check=False, input=(tmp_path / "m.yaml").read_text(), **options)
    assert ran.returncode == 0
    table = np.genfromtxt(io.StringIO(ran.stdout), delimiter=",", names=True)
    expected = p3dof.load().inverse_dynamics(p3dof.paper_motion(5), method="pinocchio").forces
    np.testing.assert_array_equal(np.column_stack([table[f"f{leg}_N"] for leg in "ABC"]), expected)
    assert "Forces" in ran.stderr  # the table for people
    assert os.listdir(tmp_path) == ["m.yaml"]  # noqa: PTH208 - the bare names


@pytest.mark.parametrize(
    "arguments",
    [
        ("forces", "--out", "o/forces.csv", "--figure", "o/forces.svg"),
        ("compare", "--out", "o"),
        ("plots", "--out", "o", "--only", "forces", "--only", "mechanism", "--format", "svg"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_files_of_one_command_are_replaced_together(capsys, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, *arguments, "--samples", 5)[0] == 0
    before = {path: path.read_bytes() for path in Path("o").iterdir()}
    assert len(before) > 1
    last, put = max(before), Path.replace

    def sometimes(path, target):
        if Path(target).name == last.name and path.read_bytes() != before[last]:
            raise OSError(28, "No space left on device")
        return put(path, target)

    monkeypatch.setattr(Path, "replace", sometimes)
    code, out, err = run(capsys, *arguments, "--samples", 7)
    assert code == 2
    assert f"{last.name}: cannot be written (No space left on device)" in err
    assert "wrote" not in out
    assert {path: path.read_bytes() for path in Path("o").iterdir()} == before
