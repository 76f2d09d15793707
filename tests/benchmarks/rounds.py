"""Interleaved rounds: every contender has its turn in each, and what slows the machine slows all alike."""

from __future__ import annotations

import gc
import os
import platform
import statistics
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import distributions, version
from pathlib import Path
from timeit import Timer

from rich.console import Console

TURN = 2e-3
"""Least time that a turn takes [s]: the caches are warm for most of it."""

FEWEST = 5
"""Rounds that every contender is in, however long it takes."""

WIDTH = 150
LIBRARIES = ("numpy", "pin", "casadi", "mujoco", "drake", "exudyn")


@dataclass(frozen=True, eq=False)
class Contender:
    """Something to measure.

    Parameters
    ----------
    group, name, machine : str
        What it is; together unique.
    run : callable
        Takes a number of repetitions, returns the seconds that they took.
    samples : int
        How many samples a repetition computes.
    threads : int
        On how many threads.
    """

    group: str
    name: str
    machine: str
    run: Callable[[int], float]
    samples: int = 1
    threads: int = 1

    @property
    def key(self) -> tuple[str, str, str]:
        return self.group, self.name, self.machine


@dataclass(frozen=True, eq=False)
class Timing:
    """Seconds a sample of one contender, one value a round."""

    contender: Contender
    values: Sequence[float]

    @property
    def median(self) -> float:
        return statistics.median(self.values)

    @property
    def best(self) -> float:
        return min(self.values)


def calling(
    group: str, name: str, machine: str, function: Callable[[], object], samples: int = 1, threads: int = 1
) -> Contender:
    """Return the contender that calls a Python function."""
    return Contender(group, name, machine, Timer(function).timeit, samples, threads)


def measure(contenders: Iterable[Contender], rounds: int, share: float) -> dict[tuple[str, str, str], Timing]:
    """Return the timings of all contenders by their key.

    Parameters
    ----------
    contenders : iterable of Contender
        What to measure.
    rounds : int
        How many turns each gets.
    share : float
        Time after which a contender sits out once it had its `FEWEST` turns [s].

    Returns
    -------
    dict
    """
    waiting = list(contenders)
    repetitions = [_repetitions(contender) for contender in waiting]
    values: list[list[float]] = [[] for _ in waiting]
    spent = [0.0] * len(waiting)
    gc.collect()
    for turn in range(rounds):
        for place in range(len(waiting)):
            i = (place + turn * 7) % len(waiting)  # other neighbours in every round
            if spent[i] > share and len(values[i]) >= FEWEST:
                continue
            seconds = waiting[i].run(repetitions[i])
            spent[i] += seconds
            values[i].append(seconds / repetitions[i] / waiting[i].samples)
    return {one.key: Timing(one, found) for one, found in zip(waiting, values, strict=True)}


def _repetitions(contender: Contender) -> int:
    """Return how many repetitions fill a turn; the first one may have to prepare something."""
    if contender.run(1) > 20 * TURN:
        return 1
    count = 1
    while (seconds := min(contender.run(count), contender.run(count))) < TURN / 4:
        count *= 4
    return max(1, round(count * TURN / seconds))


def wide_console() -> Console:
    """Return where to print tables: as wide as they need, unless it is a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)


@cache
def machine_description() -> Mapping[str, str | int]:
    """Return what it runs on, and the versions of what is measured."""
    found: dict[str, str | int] = {
        "processor": _processor(),
        "processors": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        "compiler": compiler_version(),
    }
    installed = {one.metadata["Name"] for one in distributions()}
    return found | {name: version(name) for name in LIBRARIES if name in installed}


def described() -> str:
    """Return the description in one line."""
    return ", ".join(
        str(value) if name in {"processor", "system", "compiler"} else f"{name} {value}"
        for name, value in machine_description().items()
        if value
    )


def load_average() -> str:
    """Return what else the machine does, as far as it tells."""
    if not hasattr(os, "getloadavg"):
        return ""
    one, five, _ = os.getloadavg()
    return f"load average of the last minute {one:.1f}, of five {five:.1f}"


def compiler_version() -> str:
    """Return the first line that the C compiler says of itself; empty without one."""
    try:
        done = subprocess.run(["gcc", "--version"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.partition("\n")[0]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
