"""Processor time of optima and fronts: `python tests/benchmarks/optimisation.py`, on one thread."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("P3DOF_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from design_problems import paper_problem


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the least processor time of three runs, and the result."""
    found = []
    for _ in range(3):
        before = time.process_time()
        result = work()
        found.append(time.process_time() - before)
    return min(found), result


def main() -> None:
    """Print what is asked for, and what it takes."""
    problem = paper_problem()
    rng = np.random.default_rng(0)
    designs = rng.uniform(problem.variables.low, problem.variables.high, (2000, 4))
    rows: dict[str, Callable[[], Any]] = {
        "2000 designs, three objectives, all constraints": lambda: problem.evaluate(designs),
        "least peak force, 8 starts (asked: 30 s)": lambda: problem.minimise("peak_force"),
        "the same within the width, 8 starts": lambda: problem.minimise("peak_force", {"width": 0.5}),
        "the same by evolution": lambda: problem.minimise(
            "peak_force", {"width": 0.5}, method="evolution", polish=False
        ),
        "front of 50 points (asked: 60 s)": lambda: problem.pareto(["peak_force", "width"]),
        "NSGA-II 100 x 150, 50 polished": lambda: problem.pareto(["peak_force", "width"], method="nsga2"),
    }
    for name, work in rows.items():
        taken, result = seconds(work)
        sys.stdout.write(f"{name:55s} {taken:8.3f} s   {result}\n")


if __name__ == "__main__":
    main()
