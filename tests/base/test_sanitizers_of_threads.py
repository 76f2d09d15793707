"""The extension in several threads at once, under the sanitizer that finds races between them."""

from __future__ import annotations

import shutil

import pytest
from sanitized import LINUX, run_sanitized

TOGETHER = """
import threading
import numpy as np
import p3dof

sys.setswitchinterval(1e-5)
motion, rng, robot = p3dof.paper_motion(400), np.random.default_rng(0), p3dof.load()
states, still = rng.uniform(-0.05, 0.05, (3, 400, 3)), motion.from_rest(0.1)
acting = {"controller": p3dof.runs.PD(robot, still), "control": p3dof.runs.ControlLoop(1000)}
machines = {"R": rng.uniform(0.22, 0.3, 64), "platform.mass": rng.uniform(7, 9, 64)}
jobs = {
    "batch": lambda: robot.forces(*states, method="compiled"),
    "single": lambda: np.array([robot.forces(*states[:, k], method="compiled") for k in range(40)]),
    "forward": lambda: robot.forward_dynamics(*states, method="compiled"),
    "masses": lambda: robot.mass_matrix(states[0], method="compiled"),
    "derivatives": lambda: robot.force_derivatives(*states).by_pose,
    "run": lambda: robot.simulate(0.02, method="compiled", samples=5, **acting).forces,
    "runs": lambda: robot.simulate_many(0.02, {"start.y": np.arange(8) / 1e3}, threads=2, **acting).pose,
    "designs": lambda: p3dof.analysis.forces_of_designs(
        machines, motion, figures=("singularity", "power"), gradients=("R",), threads=2
    ).peak_force,
}
alone, wrong = {name: job() for name, job in jobs.items()}, []

def work(seed):
    for name in np.random.default_rng(seed).permutation([*jobs] * 2):
        if not np.array_equal(jobs[name](), alone[name], equal_nan=True):
            wrong.append(name)

workers = [threading.Thread(target=work, args=(k,)) for k in range(6)]
for worker in workers:
    worker.start()
for worker in workers:
    worker.join()
print(wrong or "clean")
"""
RACE = """
import threading
import numpy as np
import p3dof

robot, states, out = p3dof.load(), np.zeros((3, 20_000, 3)), np.empty((20_000, 3))
robot.forces(*states[:, :1], method="compiled")
workers = [threading.Thread(target=lambda: robot.forces(*states, method="compiled", out=out)) for _ in "ab"]
for worker in workers:
    worker.start()
for worker in workers:
    worker.join()
"""


@pytest.mark.fuzz
@LINUX
@pytest.mark.skipif(shutil.which("setarch") is None, reason="setarch not installed")
def test_threads_that_share_a_machine_are_clean_under_sanitizers(tmp_path):
    """Kernels, runs, many runs and designs at once; and two threads that write the same array are found."""
    done = run_sanitized(tmp_path, TOGETHER, "thread")
    assert (done.returncode, done.stdout, done.stderr) == (0, "clean\n", "")
    race = run_sanitized(tmp_path, RACE, "thread")
    assert race.returncode == 66
    assert "WARNING: ThreadSanitizer: data race" in race.stderr
    assert "_compiled.c" in race.stderr or "p3dof/_native" in race.stderr
