"""The program on any terminal: narrow, without Greek letters, with a reader that leaves, and with Ctrl-C."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys

import pytest
from documents import ROOT, first_block
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from p3dof._base.tables import time_text
from p3dof.cli import main
from p3dof.cli.app import spelled, write_what_is_there
from p3dof.cli.output import print_table

PROGRAM = [sys.executable, "-m", "p3dof"]
SHORT = ("--samples", "5")
ASCII = {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
TABLES = {
    "forces": ("forces", *SHORT),
    "compare": ("compare", *SHORT, "--no-plot"),
    "energy": ("energy", *SHORT),
    "reactions": ("reactions", *SHORT),
    "simulate": ("simulate", *SHORT, "--no-plot", "--controller", "pd", "--method", "compiled"),
    "codegen": ("codegen", "--bake"),
}


def lines_at(width, arguments, folder, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    out = () if arguments[0] in {"forces", "energy", "reactions"} else ("--out", str(folder))
    code = main([*arguments, *out])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    return [line for line in captured.out.splitlines() if not line.startswith("wrote ")]


def words(lines):
    """Every number and name, without the frames and the times that differ from run to run."""
    text = " ".join(re.sub(r"[│┃┏━┳┓┡╇┩└─┴┘]", " ", line) for line in lines)
    text = re.sub(r"[\d.]+ (?:[mµn]?s)\b", "TIME", text)
    return set(text.replace(":", " ").split())


@pytest.mark.parametrize("command", TABLES)
def test_no_width_cuts_a_number_or_a_name(tmp_path, capsys, monkeypatch, command):
    if command == "simulate":  # its speed differs from run to run
        monkeypatch.setattr("p3dof.runs.Simulation.speed", 1.0)
    wide = words(lines_at(500, TABLES[command], tmp_path, capsys, monkeypatch))
    for width in (80, 60, 30):
        lines = lines_at(width, TABLES[command], tmp_path, capsys, monkeypatch)
        assert wide - words(lines) == set(), width
        assert not any("…" in line for line in lines)


@pytest.mark.parametrize("box", [None, SIMPLE_HEAD])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_tables_fit_or_become_lines(capsys, monkeypatch, box, encoding):
    table = Table("θ name", "largest difference \\[N]", "time", title="a title of many words")
    table.box = box or table.box
    table.add_row("hinge_platform", "-118.498034", "72.1 µs")
    for width in range(12, 100):
        monkeypatch.setattr(Console, "encoding", encoding)
        print_table(Console(width=width), table)
        lines = capsys.readouterr().out.splitlines()
        longest = 0 if width >= 18 else len("    hinge_platform")
        assert all(len(line) <= max(width, longest) for line in lines), width
        text = "\n".join(lines)
        for word in ("hinge_platform", "-118.498034", "[N]", "72.1"):
            assert word in text
        assert ("theta name" if encoding == "ascii" else "θ name") in re.sub(r"\s+", " ", text) or width < 60
        if encoding == "ascii":
            assert text.isascii()


def test_narrow_rows_become_lines(capsys):
    table = Table("actuator", "lowest \\[N]", "highest \\[N]", "", title="forces")
    table.add_row("A", "-118.4980", "103.5000", "")
    table.add_row("B", "", "3.0000", "weak")
    print_table(Console(width=20), table)
    expected = "forces\nactuator: A\n  lowest [N]:\n      -118.4980\n  highest [N]:\n      103.5000\n"
    assert capsys.readouterr().out == expected + "actuator: B\n  highest [N]:\n      3.0000\n  weak\n"


def test_a_plan_stays_a_table_at_eighty_columns(tmp_path, capsys, monkeypatch):
    (tmp_path / "task.yaml").write_text(first_block("how-to/plan-a-task.md", "yaml"), encoding="utf-8")
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["plan", str(tmp_path / "task.yaml"), "--duration", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 35  # 17 rows in two tables; one number a line would be 110
    assert max(map(len, lines)) <= 80
    assert any(line.split()[:3] == ["home", "→", "pick"] and len(line.split()) == 10 for line in lines)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (2.5, "2.5 s"), (1.03e-2, "10.3 ms"), (7.21e-5, "72.1 µs"), (9.999e-4, "1 ms"), (9.996e-7, "1 µs"),
        (3e-9, "3 ns"), (0.0, "0 ns"), (123.456, "123 s"), (1234.0, "1230 s"),
    ],
)  # fmt: skip
def test_times_are_told_in_units_that_suit_them(seconds, text):
    assert time_text(seconds) == text


def test_letters_are_spelled_where_there_are_none():
    assert (
        spelled("θ [mrad], 3 µs, × 2 → m/s², Höhe, 木", "ascii")
        == "theta [mrad], 3 us, x 2 -> m/s^2, Hohe, ?"
    )
    assert spelled("θ µ × ö", "utf-8") == "θ µ × ö"
    assert spelled("µs × ö θ", "latin-1") == "µs × ö theta"
    assert "b\udcff".encode("ascii", write_what_is_there) == b"b\xff"  # a file's name, byte by byte


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        ((*TABLES["simulate"],), ("theta [mrad]", "x real")),
        (("compare", "--no-plot", *SHORT), ("time per sample",)),
        (("simulate", "--help"), ("theta",)),
    ],
)  # fmt: skip
def test_an_ascii_terminal_gets_words_for_letters(tmp_path, arguments, wanted):
    extra = () if "--help" in arguments else ("--out", str(tmp_path))
    done = subprocess.run(
        [*PROGRAM, *arguments, *extra], capture_output=True, env=os.environ | ASCII, check=False
    )
    text = done.stdout.decode("ascii")
    assert done.returncode == 0, done.stderr
    assert "?" not in text
    for word in wanted:
        assert word in text


@pytest.mark.parametrize("method", ["pipe", "closed"])
@pytest.mark.parametrize("arguments", [("forces", *SHORT), ("compare", "--help"), ("--version",)])
def test_a_reader_that_leaves_is_no_failed_check(arguments, method):
    """Exit code 141, as the shell has it for SIGPIPE; nothing is said, also while Python ends."""
    if method == "closed":  # p3dof ... >&-
        done = subprocess.run(
            ["/bin/sh", "-c", 'exec "$@" >&-', "sh", *PROGRAM, *arguments],
            stderr=subprocess.PIPE,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, b"")
        return
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run([*PROGRAM, *arguments], stdout=write, stderr=subprocess.PIPE, check=False)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


def test_an_error_that_nobody_reads_has_its_exit_code():
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run([*PROGRAM, "forces", "--samples", "x"], stderr=write, check=False)
    finally:
        os.close(write)
    assert done.returncode == 2


def test_no_memory_is_one_line(monkeypatch, capsys):
    from p3dof.cli import machine

    def full(*_):
        raise MemoryError

    monkeypatch.setattr(machine, "load", full)
    assert main(["forces"]) == 2
    assert (
        capsys.readouterr().err
        == "p3dof: error: there is not enough memory for this; fewer samples need less\n"
    )


SLOW_IMPORT = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            print("importing", flush=True)
            sys.stdin.readline()
sys.meta_path.insert(0, Finder())
sys.argv = ["p3dof", "forces", "--samples", "5", "--figure", {figure!r}]
import runpy
runpy.run_module("p3dof", run_name="__main__")
"""


@pytest.mark.skipif(sys.platform.startswith("win"), reason="POSIX signals")
@pytest.mark.parametrize(
    ("module", "number"),
    [
        *(
            (name, signal.SIGINT)
            for name in ("p3dof.cli", "pinocchio", "click", "rich.table", "p3dof.report.plots")
        ),
        *((name, signal.SIGTERM) for name in ("p3dof.cli", "p3dof.report.plots")),
        *(("numpy._core._internal", number) for number in (signal.SIGINT, signal.SIGTERM)),  # half of NumPy
    ],
)
@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_during_start_up_is_one_line(tmp_path, module, number):
    told, code = {signal.SIGINT: ("interrupted", 130), signal.SIGTERM: ("terminated", 143)}[number]
    with starting(tmp_path, module) as process:
        process.send_signal(number)
        _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (code, f"p3dof: error: {told}\n")


@contextlib.contextmanager
def starting(folder, module, *before):
    """The program, while it imports a module: it goes on when it is told a line."""
    code = SLOW_IMPORT.format(module=module, figure=str(folder / "f.png"))
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([*before, sys.executable, "-c", code], **pipes, text=True) as process:
        assert process.stdout.readline() == "importing\n"
        yield process


@pytest.mark.skipif(sys.platform.startswith("win"), reason="POSIX signals")
@pytest.mark.parametrize("module", ["p3dof.cli", pytest.param("p3dof.report.plots", marks=pytest.mark.slow)])
def test_in_the_background_of_a_script_ctrl_c_is_for_others(tmp_path, module):
    """A shell lets what it starts with & ignore Ctrl-C: it ends what is in front."""
    script = 'trap "" INT; exec "$0" "$@"'
    with starting(tmp_path, module, "sh", "-c", script) as process:
        process.send_signal(signal.SIGINT)
        _, error = process.communicate("go on\n", timeout=60)
    assert (process.returncode, error) == (0, "")
    assert (tmp_path / "f.png").exists()


def test_the_program_is_what_watches_for_interrupts():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'p3dof = "p3dof.__main__:main"' in text  # not p3dof.cli, whose import takes half a second
    assert '"click>=8.2"' in text  # with 8.1 every usage error is a traceback


@pytest.mark.parametrize("moment", ["nan", "99", "-1e-3", "inf"])
@pytest.mark.parametrize(
    "command", ["show --no-open", "show --out x.html", "show --screenshot x.png", "plots"]
)
def test_a_time_outside_the_motion_is_refused(tmp_path, capsys, monkeypatch, command, moment):
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), *SHORT, "--at", moment]) == 2
    error = capsys.readouterr().err
    assert "--at: expected a time of the motion, from 0 to 1 s, got" in error
    assert not list(tmp_path.iterdir())


LOST = """
import signal, sys, time
import p3dof.cli
module = sys.modules["p3dof.cli.app"]
class Ending:
    def __del__(self):
        signal.raise_signal(signal.{number})
        list(range(10))
def called(arguments):
    with module._hidden_from_click():
        Ending()
        time.sleep(60)
module._called = called
import p3dof.__main__
sys.exit(p3dof.__main__.main())
"""


@pytest.mark.skipif(sys.platform.startswith("win"), reason="POSIX signals")
@pytest.mark.parametrize(
    ("number", "told", "code"), [("SIGINT", "interrupted", 130), ("SIGTERM", "terminated", 143)]
)
@pytest.mark.usefixtures("ctrl_c")
def test_a_signal_where_nothing_can_be_raised_ends_the_program_all_the_same(number, told, code):
    """Python only prints an exception that comes at the end of an object."""
    script = LOST.format(number=number)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, f"p3dof: error: {told}\n")
