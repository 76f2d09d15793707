"""What Python adds to the kernels: one sample, large batches, evidence, and the start of programs.

    python tests/benchmarks/paths.py [--quick]

Times are processor seconds, the best of several rounds; ratios are those of one process. Nothing is judged.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from functools import partial

import numpy as np
from rich.console import Console

import p3dof

_CONSOLE = Console(highlight=False, width=150)


def say(text: str) -> None:
    """Print a line."""
    _CONSOLE.print(text, markup=False)


def seconds(call: Callable[[], object], rounds: int = 7, least: float = 0.02) -> float:
    """Return the processor seconds of a call, the best of some rounds."""
    times, repetitions = [], 1
    for _ in range(rounds):
        while True:
            start = time.process_time()
            for _ in range(repetitions):
                call()
            took = time.process_time() - start
            if took >= least:
                break
            repetitions *= 2
        times.append(took / repetitions)
    return min(times)


def one_sample(robot: p3dof.Manipulator) -> None:
    """Print what one sample takes at every door."""
    pose, velocity, acceleration = np.array([[0.01, 0.02, 0.1], [0.1, 0.2, 0.3], [1.0, 2.0, 3.0]])
    forces, matrix, wrench = np.empty(3), np.empty((3, 3)), np.arange(6.0)
    lists = [row.tolist() for row in (pose, velocity, acceleration)]
    bound = robot.kernels.bind_inverse_dynamics()
    bound.state[:] = pose, velocity, acceleration
    doors: dict[str, Callable[[], object]] = {
        "forces, arrays": lambda: robot.forces(pose, velocity, acceleration, method="compiled"),
        "forces, lists": lambda: robot.forces(*lists, method="compiled"),
        "forces, out=": lambda: robot.forces(pose, velocity, acceleration, method="compiled", out=forces),
        "forces, wrench": lambda: robot.forces(
            pose, velocity, acceleration, wrench=wrench, method="compiled"
        ),
        "forces, batch of one": lambda: robot.forces(
            pose[None], velocity[None], acceleration[None], method="compiled"
        ),
        "forward_dynamics": lambda: robot.forward_dynamics(pose, velocity, acceleration, method="compiled"),
        "jacobian": lambda: robot.jacobian(pose, method="compiled"),
        "mass_matrix, out=": lambda: robot.mass_matrix(pose, method="compiled", out=matrix),
        "sliders": lambda: robot.sliders(pose),
        "force_derivatives": lambda: robot.force_derivatives(pose, velocity, acceleration),
        "bound loop": bound.run,
    }
    for name, door in doors.items():
        say(f"  {name:28s} {1e6 * seconds(door):8.3f} µs")


def batches(robot: p3dof.Manipulator, largest: int) -> None:
    """Print what a sample of large batches takes, into new arrays and into kept ones."""
    rng = np.random.default_rng(1)
    pose, velocity, acceleration = rng.uniform(-0.1, 0.1, (3, largest, 3))
    out = np.zeros((largest, 3))
    robot.kernels = p3dof.MachineKernels(robot.parameters, threads=1)
    known = 0.0
    count = 1000
    while count <= largest:
        part = slice(0, count)
        call = partial(robot.forces, pose[part], velocity[part], acceleration[part], method="compiled")
        new = seconds(call, 5) / count
        kept = seconds(partial(call, out=out[part]), 5) / count
        ratio = f"{kept / known:6.2f} x a tenth of them" if known else ""
        say(f"  {count:10,d} samples: new {1e9 * new:6.2f} ns, out= {1e9 * kept:6.2f} ns {ratio}")
        known, count = kept, 10 * count


def evidence(count: int) -> None:
    """Print time and memory of `inverse_dynamics`, a sample."""
    robot, motion = p3dof.load(), p3dof.paper_motion(count)
    for method in ("compiled", "virtual-power"):
        took = seconds(partial(robot.inverse_dynamics, motion, method=method), 3)
        tracemalloc.start()
        result = robot.inverse_dynamics(motion, method=method)
        kept, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert result.possible
        beside = (peak - kept) / count
        say(f"  {method:14s} {1e6 * took / count:6.2f} µs, {kept / count:.0f} B kept, {beside:.0f} B beside")


def starts(rounds: int) -> None:
    """Print the processor seconds of small programs, those of an empty one left out."""
    programs = {
        "import p3dof": ["-c", "import p3dof"],
        "p3dof.load": ["-c", "import p3dof; p3dof.load"],
        "p3dof.loops": ["-c", "import p3dof.loops"],
        "ClosedLoopModel": ["-c", "import p3dof; p3dof.ClosedLoopModel"],
        "--help": ["-m", "p3dof", "--help"],
        "--version": ["-m", "p3dof", "--version"],
        "forces --help": ["-m", "p3dof", "forces", "--help"],
        "loop --help": ["-m", "p3dof", "loop", "--help"],
    }
    empty = processor_seconds(["-c", "pass"], rounds)
    for name, arguments in programs.items():
        say(f"  {name:20s} {processor_seconds(arguments, rounds) - empty:6.3f} s")


def processor_seconds(arguments: list[str], rounds: int) -> float:
    """Return the least processor time of a Python program."""
    import resource

    times = []
    for _ in range(rounds):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(times)


def main() -> None:
    """Measure everything."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="smaller batches, fewer rounds")
    quick = parser.parse_args().quick
    say("One sample")
    one_sample(p3dof.load())
    say("Batches of forces, one thread")
    batches(p3dof.load(), 1_000_000 if quick else 10_000_000)
    say("inverse_dynamics, a sample")
    evidence(20_000 if quick else 200_000)
    say("Starting, processor seconds beside an empty program")
    starts(2 if quick else 5)


if __name__ == "__main__":
    main()
