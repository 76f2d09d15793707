"""Time per sample of both methods, interleaved in one process: medians, and ratios to a bare RNEA call.

Run with ``make benchmark``. Timings are never a test: machines differ; compare the ratios of one run.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

import p3dof

ROUNDS = 7
SAMPLES = 1001
BATCH = 100_000


def main() -> None:
    """Measure and print."""
    robot = p3dof.load()
    motion, batch = p3dof.paper_motion(SAMPLES), p3dof.paper_motion(BATCH)
    result = robot.inverse_dynamics(motion)
    data = robot.model.createData()
    q, v, a = result.joints.q, result.joints.v, result.joints.a

    def bare_rnea() -> None:
        for i in range(SAMPLES):
            pin.rnea(robot.model, data, q[i], v[i], a[i])

    def from_joints() -> None:
        for i in range(SAMPLES):
            robot.loop.inverse_dynamics(q[i], v[i], a[i])

    def states(m: p3dof.Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return m.pose, m.velocity, m.acceleration

    contenders: dict[str, tuple[Callable[[], object], int]] = {
        "bare pin.rnea, called from Python": (bare_rnea, SAMPLES),
        "Pinocchio route, q, v, a given": (from_joints, SAMPLES),
        "Pinocchio route, from the pose": (lambda: robot.forces(*states(motion)), SAMPLES),
        "Pinocchio route with evidence": (lambda: robot.inverse_dynamics(motion), SAMPLES),
        f"virtual power, {SAMPLES} samples": (
            lambda: robot.forces(*states(motion), method="virtual-power"),
            SAMPLES,
        ),
        f"virtual power, {BATCH} samples": (
            lambda: robot.forces(*states(batch), method="virtual-power"),
            BATCH,
        ),
        "virtual power, one sample a call": (
            lambda: robot.forces(
                motion.pose[7], motion.velocity[7], motion.acceleration[7], method="virtual-power"
            ),
            1,
        ),
    }
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(ROUNDS):
        for name, (function, count) in contenders.items():
            start = time.perf_counter()
            function()
            times[name].append((time.perf_counter() - start) / count)
    table = Table("inverse dynamics", "µs a sample", "of a bare RNEA call")
    bare = statistics.median(times["bare pin.rnea, called from Python"])
    for name, values in times.items():
        median = statistics.median(values)
        table.add_row(name, f"{median * 1e6:.3g}", f"{median / bare:.3g}")
    console = Console()
    console.print(table)
    console.print(
        f"median of {ROUNDS} interleaved rounds; {platform.machine()}, Python {platform.python_version()}, "
        f"numpy {np.__version__}, pin {pin.__version__}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    main()
