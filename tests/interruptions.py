"""Jobs of the command line that are ended by a signal at some moment, and what must hold then.

After it there is one line and the right exit code, no file is half written, no process goes on, and the same
job, begun again, comes to the same bits and leaves nothing behind.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import closed_loop_robots as robots
import matplotlib
import psutil

SWEEP = """
motion: {paper: 41}
variables: {R: {uniform: [240 mm, 280 mm]}, L: {uniform: [380 mm, 500 mm]}}
count: 1200
block_size: 100
reductions: [{top: peak_force, count: 5}, {moments: [peak_force]}]
"""
PROBLEM = """
motion: {paper: 41}
variables: {R: [200 mm, 400 mm], L: [300 mm, 700 mm]}
objectives: [peak_force, width]
constraints: {width: {max: 600 mm}}
"""
RUNS = "start.y [mm],platform.mass\n" + "".join(f"{k % 3},{8 + k / 100}\n" for k in range(40))
FILES = {"sweep.yaml": SWEEP, "problem.yaml": PROBLEM, "runs.csv": RUNS, "robot.urdf": robots.five_bar()}
SIDECAR = "closed_loop:\n- [left_tip, right_tip]\ntype: [3d]\nname_mot: [left_joint, right_joint]\n"
FALLING = ("loop", "simulate", "robot.urdf", "--method", "compiled", "--duration", "0.05")


@dataclass(frozen=True)
class Job:
    """A command, what to add when it is begun again, and what is not the same each time."""

    command: tuple[str, ...]
    again: tuple[str, ...] = ()
    differs: Callable[[str], bool] = field(default=lambda _: False)


JOBS = {
    "sweep": Job(("sweep", "sweep.yaml", "--out", "out"), ("--resume",)),
    "sweep by workers": Job(("sweep", "sweep.yaml", "--out", "out", "--workers", "2"), ("--resume",)),
    "optimise": Job(
        (
            "optimise",
            "problem.yaml",
            "--starts",
            "8",
            "--objective",
            "peak_force",
            "--store",
            "out",
            "--out",
            "m.yaml",
        )
    ),
    "pareto": Job(("pareto", "problem.yaml", "--points", "8", "--store", "out", "--out", "f.csv")),
    "runs": Job(("runs", "runs.csv", "--duration", "0.3", "--out", "runs.npz")),
    "export": Job(("export", "--out", "out")),
    "codegen": Job(("codegen", "--out", "out")),
    "loop codegen": Job(("loop", "codegen", "robot.urdf", "--out", "out")),
    "compiled": Job((*FALLING, "--out", "run.csv"), differs=lambda name: name.startswith("cache")),
    "report": Job(("report", "--samples", "41", "--out", "r.html"), differs=lambda name: name == "r.html"),
    "forces": Job(("forces", "--out", "f.csv", "--figure", "f.svg"), differs=lambda name: name == "f.svg"),
}


def prepare(folder: Path) -> None:
    """Put there what jobs read; temporary files and caches have folders of their own."""
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "robot.yaml").write_text(SIDECAR, encoding="utf-8")
    (folder / "tmp").mkdir()
    (folder / "cache").mkdir(mode=0o700)


def start(job: Job, folder: Path, *more: str) -> subprocess.Popen[str]:
    """Start a job, with places of its own for temporary files and for what it compiles."""
    places = {"XDG_CACHE_HOME": str(folder / "cache"), "TMPDIR": str(folder / "tmp")}
    fonts = {"MPLCONFIGDIR": matplotlib.get_cachedir()}  # looked for once, not by every job
    return subprocess.Popen(
        [sys.executable, "-m", "p3dof", *job.command, *more],
        cwd=folder,
        env=os.environ | places | fonts | {"OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def ready(process: subprocess.Popen[str]) -> bool:
    """Whether the program looks after signals by now: Python alone does not after SIGTERM."""
    try:
        lines = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii").splitlines()
        caught = next(int(line.split()[1], 16) for line in lines if line.startswith("SigCgt"))
    except (OSError, StopIteration):
        return True  # it has ended
    return process.poll() is not None or bool(caught >> (signal.SIGTERM - 1) & 1)


def wait_until(state: Callable[[], object], process: subprocess.Popen[str]) -> None:
    while not state() and process.poll() is None:
        time.sleep(0.002)


def left_over(folder: Path) -> list[str]:
    """Temporary files, wherever they are."""
    found = [path for path in folder.rglob("*") if path.name.endswith(".tmp")]
    return sorted(str(path.relative_to(folder)) for path in {*found, *(folder / "tmp").iterdir()})


def outputs(folder: Path) -> dict[str, bytes]:
    """What a job has written, by name; temporary files are `left_over`, and swept by the next run."""
    own = {*FILES, "robot.yaml", "tmp"}
    paths = [
        path for path in folder.rglob("*") if path.is_file() and path.relative_to(folder).parts[0] not in own
    ]
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in paths
        if path.name != "sweep.lock" and path.suffix != ".tmp"
    }


def require_same(job: Job, found: dict[str, bytes], whole: dict[str, bytes], where: str) -> None:
    """Every file is one of those that a job writes when nobody interrupts it, to the last bit."""
    for name, data in found.items():
        if not job.differs(name):
            assert name in whole, f"{where}: {name} is of no whole run"
            assert data == whole[name], f"{where}: {name} differs from that of a whole run"
        elif name.endswith((".html", ".svg")):
            assert data.rstrip().endswith((b"</html>", b"</svg>")), f"{where}: {name} is cut off"


def processes_of(folder: Path) -> list[psutil.Process]:
    """The processes that work for a job: those with its place for temporary files."""
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get("TMPDIR") == str(folder / "tmp"):
                found.append(process)
        except (OSError, psutil.Error):  # noqa: PERF203 - it is somebody else's, or has just ended
            continue
    return found


def seconds_of(job: Job, folder: Path) -> float:
    """Let a job come to its end; return how long it works once it looks after signals."""
    process = start(job, folder)
    wait_until(lambda: ready(process), process)
    begun = time.monotonic()
    process.communicate(timeout=600)
    return time.monotonic() - begun


def finish(job: Job, folder: Path, *more: str) -> dict[str, bytes]:
    """Let a job come to its end; return what it has written."""
    process = start(job, folder, *more)
    _, error = process.communicate(timeout=600)
    assert (process.returncode, error) == (0, ""), (job.command, error)
    return outputs(folder)


def end(
    job: Job, folder: Path, number: signal.Signals, moment: Callable[[], object], whole: dict[str, bytes]
) -> str:
    """End a job by a signal when `moment` says so, hold what is left against a whole run, and go on.

    Returns
    -------
    str
        How it ended: "done" (before the signal), or as the exit code says.
    """
    process = start(job, folder)
    wait_until(lambda: ready(process), process)
    wait_until(moment, process)
    process.send_signal(number)
    _, error = process.communicate(timeout=600)
    word, code = {signal.SIGINT: ("interrupted", 130), signal.SIGTERM: ("terminated", 143)}[number]
    where = f"{job.command[0]} after {number.name}"
    if process.returncode == 0:
        assert error == "", f"{where}: {error}"
    else:
        assert process.returncode == code, f"{where}: {process.returncode}, {error}"
        assert error.startswith((f"p3dof: error: {word}", "p3dof: error: interrupted: ")), f"{where}: {error}"
        assert error.count("\n") == 1, f"{where}: {error}"
    deadline = time.monotonic() + 60  # what works for it ends with it, soon
    while processes_of(folder):
        assert time.monotonic() < deadline, f"{where}: {processes_of(folder)} goes on"
        time.sleep(0.01)
    require_same(job, outputs(folder), whole, where)
    told = {0: "done"}.get(process.returncode, word) + (", swept later" if left_over(folder) else "")
    begun = outputs(folder)
    more = job.again if any(name.startswith("out") for name in begun) else ()
    found = finish(job, folder, *more)
    assert left_over(folder) == [], where
    assert {name for name in whole if not job.differs(name)} <= set(found), where
    require_same(job, found, whole, f"{where}, begun again")
    return told
