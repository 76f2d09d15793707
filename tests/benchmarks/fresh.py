"""What only a process of its own can tell: how long an import takes, and how much memory a batch."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from collections.abc import Mapping

IMPORTS = {
    "import pinocchio, numpy": "import pinocchio, numpy",
    "import p3dof": "import p3dof",
    "import p3dof, and a manipulator": "import p3dof; p3dof.load",
}
MEMORY = {"compiled": 1_000_000, "virtual-power": 1_000_000, "pinocchio": 10_000}
"""Samples a call by method."""

_IMPORT = "import time; begin = time.perf_counter(); {}; print(time.perf_counter() - begin)"
_ALLOCATED = """
import resource, tracemalloc
import numpy as np, p3dof
count, method, traced = {count}, {method!r}, {traced}
rng = np.random.default_rng(0)
states = [np.empty((count, 3)) for _ in range(3)]
for array, size in zip(states, (0.05, 0.5, 5.0)):
    for row in range(0, count, 1000):
        array[row:row + 1000] = rng.uniform(-size, size, (1000, 3))
robot = p3dof.load()
robot.forces(*(array[:1000] for array in states), method=method)
if traced:
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    robot.forces(*states, method=method)
    peak = tracemalloc.get_traced_memory()[1]
else:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    robot.forces(*states, method=method)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print((peak - before) / count)
"""


def import_times(rounds: int) -> Mapping[str, float]:
    """Return median seconds of each import, in fresh processes, interleaved."""
    values: dict[str, list[float]] = {name: [] for name in IMPORTS}
    for turn in range(rounds + 1):
        for name, code in IMPORTS.items():
            seconds = _number(_IMPORT.format(code))
            if turn:  # the first one may read from disk
                values[name].append(seconds)
    return {name: statistics.median(found) for name, found in values.items()}


def memory_per_sample() -> Mapping[str, tuple[float, float]]:
    """Return by method how many bytes a sample a call of `robot.forces` adds at its peak.

    Its result, 24 bytes, is among them, the states that it gets, 72 bytes, are not. First what the process
    holds (resident set), then what was allocated for Python and NumPy.
    """
    found = {}
    for method, count in MEMORY.items():
        code = [_ALLOCATED.format(count=count, method=method, traced=traced) for traced in (False, True)]
        found[method] = _number(code[0]), _number(code[1])
    return found


def _number(code: str) -> float:
    usual = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=usual)
    return float(done.stdout)
