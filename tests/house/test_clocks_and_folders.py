"""Clocks that jump, and folders that are read only: the same results, or one clear error."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
import sweep_problems

import p3dof
from p3dof._base.errors import LOG
from p3dof.cli.output import progress_bar
from p3dof.loops.compiled import build
from p3dof.viewer.connections import Allowance

JUMPS = (0.0, 1e9, -1e9, 3.0, 1e18, -3.0, 0.0)
"""What is added to clocks, one after the other [s]."""


@pytest.fixture
def jumping(monkeypatch):
    """All clocks jump at every look, the one that should never go back too."""
    for name in ("time", "monotonic", "perf_counter"):
        usual, jumps = getattr(time, name), itertools.cycle(JUMPS)
        monkeypatch.setattr(time, name, lambda usual=usual, jumps=jumps: usual() + next(jumps))


@pytest.mark.usefixtures("jumping")
def test_sweeps_and_their_journals_do_not_look_at_the_clock(tmp_path):
    problem, reductions = sweep_problems.problem(20), sweep_problems.reductions()
    made = p3dof.sweep(problem, tmp_path / "one", reductions=reductions, workers=2)
    next((tmp_path / "one").rglob("0000000002.npz")).unlink()
    resumed = p3dof.sweep(problem, tmp_path / "one", reductions=reductions, resume=True)
    assert resumed.computed == 1
    for name, values in resumed.columns().items():
        np.testing.assert_array_equal(values, made.columns()[name])


@pytest.mark.usefixtures("jumping")
def test_runs_do_not_look_at_the_clock_but_for_how_long_they_took():
    robot, motion = p3dof.load(), p3dof.paper_motion(101).from_rest(0.2)
    given = {"controller": p3dof.runs.PD(robot, motion), "control": p3dof.runs.ControlLoop(200), "samples": 5}
    one, other = (robot.simulate(0.05, **given) for _ in range(2))
    np.testing.assert_array_equal(one.forces, other.forces)
    assert one.stop is None


@pytest.mark.usefixtures("jumping")
def test_progress_is_shown_whatever_the_clock_says(monkeypatch, capsys):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar("items", 10) as progress:
        assert progress is not None
        for done in range(11):
            progress(done, 10)
    assert "items" in capsys.readouterr().err


def test_beside_a_bar_is_what_keeps_it_from_going_on(monkeypatch, capsys):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    level, handlers = LOG.level, list(LOG.handlers)
    with progress_bar("items", 10) as progress:
        LOG.info("compiling [once]")
        progress._bar.refresh()
        assert "compiling [once]" in capsys.readouterr().err
        progress(1, 10)
        progress._bar.refresh()
        assert "compiling" not in capsys.readouterr().err
    assert (LOG.level, LOG.handlers) == (level, handlers)


def test_a_page_is_neither_closed_nor_let_do_more_when_the_clock_jumps():
    times = iter([0.0, 1e9, -1e9, -1e9, -1e9 + 0.5])
    allowance = Allowance(2.0, 3.0, lambda: next(times))
    assert allowance.take()  # after a jump forward no more than the burst is saved up
    taken = [allowance.take() for _ in range(3)]
    assert taken[0] in (True, False)
    assert sum(taken) <= 3


def bound_by_modes():
    """What a program is started with so that the modes of files hold for it: root may write everywhere."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return []
    setpriv = shutil.which("setpriv")
    if setpriv is None:
        pytest.skip("root may write everywhere")
    return [setpriv, "--bounding-set=-dac_override,-dac_read_search"]


@pytest.mark.skipif(sys.platform.startswith("win"), reason="modes of POSIX")
@pytest.mark.parametrize(
    "command",
    [
        ("forces", "--samples", "5", "--out", "locked/f.csv"),
        ("report", "--samples", "5", "--out", "locked/r.html"),
        ("export", "--out", "locked/urdf"),
        ("codegen", "--out", "locked"),
        ("sweep", "sweep.yaml", "--out", "locked/out"),
    ],
    ids=lambda command: command[0],
)
def test_a_folder_that_is_locked_is_one_clear_error(command, tmp_path):
    (tmp_path / "sweep.yaml").write_text(
        "motion: {paper: 21}\nvariables: {R: {uniform: [0.24, 0.28]}}\ncount: 10\n", encoding="utf-8"
    )
    (tmp_path / "locked").mkdir(mode=0o555)
    done = subprocess.run(
        [*bound_by_modes(), sys.executable, "-m", "p3dof", *command],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("p3dof: error: ")
    assert "locked" in done.stderr
    assert done.stderr.endswith("(Permission denied)\n")
    assert done.stderr.count("\n") == 1
    assert list((tmp_path / "locked").iterdir()) == []


def test_a_cache_does_not_depend_on_when_a_file_was_written(tmp_path, monkeypatch):
    """A library of the year 2100, or of 1970, is the one that was kept."""
    if build.compiler() is None:
        pytest.skip("no C compiler here")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tmp_path.chmod(0o700)
    source = "double twice(double x) { return 2 * x; }"
    build.libraries([source])
    (kept,) = tmp_path.rglob("*.so")
    for moment in (0, 4_102_444_800):
        os.utime(kept, (moment, moment))
        build.libraries([source])
        assert [*tmp_path.rglob("*.so")] == [kept]
        assert kept.stat().st_mtime == moment
