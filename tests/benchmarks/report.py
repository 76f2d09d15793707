"""Figures and the report as commands: processor time, and the size of the page.

    python tests/benchmarks/report.py [--rounds 5]

Least of several fresh processes, interleaved; ratios to importing Matplotlib alone travel between machines.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console

COMMANDS = {
    "import matplotlib": [sys.executable, "-c", "import matplotlib.figure, matplotlib.backends.backend_agg"],
    "p3dof plots": [sys.executable, "-m", "p3dof", "plots", "--out", "figures"],
    "p3dof report": [sys.executable, "-m", "p3dof", "report", "--out", "report.html"],
}


def seconds(command: list[str], folder: str) -> float:
    """Return the processor time of a command [s]."""
    with Path(os.devnull).open("wb") as nowhere:
        child = subprocess.Popen(command, cwd=folder, stdout=nowhere)
        _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}")
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory() as folder:
        turns = [
            {name: seconds(command, folder) for name, command in COMMANDS.items()} for _ in range(rounds)
        ]
        size = (Path(folder) / "report.html").stat().st_size / 1e6
    least = {name: min(turn[name] for turn in turns) for name in COMMANDS}
    console = Console(highlight=False, width=120)
    for name, found in least.items():
        console.print(f"{name:20s} {found:.2f} s CPU, {found / least['import matplotlib']:.1f} × the import")
    console.print(f"report.html {size:.2f} MB")


if __name__ == "__main__":
    main()
