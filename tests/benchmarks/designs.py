"""Designs a second on one thread, beside the kernel that they are made of.

    python tests/benchmarks/designs.py [--rounds 7]

CPU time of the thread, least of several rounds, all in one process; 200 samples of the paper's motion. Ratios
mean more than numbers: the kernel alone is the same processor in the same minute.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

import p3dof
from p3dof._base.files import write_table
from p3dof.analysis.designs import DesignEvaluation, Designs
from p3dof.analysis.designs.figures import FigureGroup, samples_of
from p3dof.analysis.designs.files import ROWS, evaluated, read_designs, results_file, table_of_results
from p3dof.closed_form.compiled.designs import design_kernel
from p3dof.closed_form.compiled.kernels import MachineKernels, levels
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers

SAMPLES, DESIGNS = 200, 32_768
MOTION = p3dof.paper_motion(SAMPLES)


_CONSOLE = Console(highlight=False, width=170)


def say(text: str) -> None:
    """Print a line."""
    _CONSOLE.print(text, markup=False)


def least(work: Callable[[], object], rounds: int) -> float:
    """Return the least CPU time of this thread [s]."""
    found = float("inf")
    for _ in range(rounds):
        start = time.thread_time()
        work()
        found = min(found, time.thread_time() - start)
    return found


def kernel_alone(name: str, machine: p3dof.Parameters, level: str, rounds: int) -> float:
    """Return the seconds that a kernel takes for a sample, on columns of 200 that stay in the cache."""
    kernels = MachineKernels(machine, level, 1)
    columns = [
        np.ascontiguousarray(row) for row in (*MOTION.pose.T, *MOTION.velocity.T, *MOTION.acceleration.T)
    ]
    columns += [np.zeros(SAMPLES)] * (len(kernels.prepared(name)[0].inputs) - 9)
    outputs = [np.empty(SAMPLES) for _ in range(4)]
    from p3dof._native import _compiled

    used, constants = kernels.prepared(name)
    call = _compiled.Call(used.name, level, constants, columns, outputs)
    return least(lambda: [call() for _ in range(1000)], rounds) / 1000 / SAMPLES


def own_kernel_alone(name: str, machine: p3dof.Parameters, level: str, rounds: int) -> float:
    """Return the seconds that a kernel for designs takes for a sample, likewise."""
    from p3dof._native import _compiled

    used, padded = design_kernel(name), -(-SAMPLES // 8) * 8
    packed = samples_of(MOTION).packed()
    inputs = [packed[k * padded :][:SAMPLES].copy() for k in range(len(used.inputs))]
    outputs = [np.empty(SAMPLES) for _ in used.outputs]
    friction = friction_numbers(machine.friction) if "friction" in name else ()
    call = _compiled.Call(name, level, used.of(model_of(machine), friction), inputs, outputs)
    return least(lambda: [call() for _ in range(1000)], rounds) / 1000 / SAMPLES


def columns(kind: str, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return designs: lengths, and what makes a kind of them."""
    found = {"R [mm]": rng.uniform(235, 265, DESIGNS), "L": rng.uniform(0.39, 0.45, DESIGNS)}
    more = {
        "symmetric": {"platform.mass": rng.uniform(5, 9, DESIGNS)},
        "symmetric, of solids": {"rod_radius [mm]": rng.uniform(8, 12, DESIGNS)},
        "general": {"leg.com.y [mm]": rng.uniform(-3, 3, DESIGNS)},
        "general, with friction": {
            "leg.com.y [mm]": rng.uniform(-3, 3, DESIGNS),
            "friction.viscous.sliders": rng.uniform(1, 3, DESIGNS),
        },
    }
    return found | more[kind]


def gradients(designs: dict[str, np.ndarray], figures: tuple[FigureGroup, ...], rounds: int) -> str:
    """Return what a column to differentiate by costs, beside the figures."""
    found, by = [], ("R", "L")
    for level, count in (("numpy", 256), (None, 4096)):
        some = Designs({name: column[:count] for name, column in designs.items()})
        problems = [
            DesignEvaluation(MOTION, figures=figures, gradients=names, level=level, threads=1)
            for names in ((), by)
        ]
        alone, both = (least(partial(one.evaluate, some), rounds) / count for one in problems)
        found.append(((both - alone) / len(by), alone))
    (slow, _), (fast, alone) = found
    return f"{slow * 1e6:.0f}, {fast * 1e6:.1f}, {slow / fast:.0f} × ({alone * 1e6:.1f})"


def files(rounds: int) -> str:
    """Return what a design costs from file to file, of it computed, and how fast motions are read."""
    rng = np.random.default_rng(1)
    evaluation = DesignEvaluation(MOTION, threads=1)
    with tempfile.TemporaryDirectory() as folder:
        table, found, motion = (Path(folder) / f"{name}.csv" for name in ("designs", "found", "motion"))
        given = columns("symmetric", rng)
        write_table(table, list(given), tuple(given.values()))
        p3dof.paper_motion(100_001).to_csv(motion)
        text, size = motion.read_text(), motion.stat().st_size / 1e6

        def command() -> None:
            with results_file(found) as writer:
                for rows, results in evaluated(
                    read_designs(table, ROWS), evaluation, p3dof.PAPER, "kept", "designs"
                ):
                    writer.write(table_of_results(rows, results))

        whole = least(command, rounds) / DESIGNS
        alone = least(partial(evaluation.evaluate, Designs(given)), rounds) / DESIGNS
        read = size / least(partial(p3dof.Motion.from_csv, motion, check=False), rounds)
        careful = size / least(lambda: np.loadtxt(text.splitlines()[1:], delimiter=","), rounds)
    return (
        f"a design from file to file {whole * 1e6:.2f} µs, of it computed {alone * 1e6:.2f}; "
        f"Motion.from_csv {read:.0f} MB/s, {read / careful:.1f} × numpy.loadtxt"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    rng, level = np.random.default_rng(0), levels()[-1]
    say(
        f"{DESIGNS} designs, {SAMPLES} samples, {level}, one thread: million designs a second "
        "(as a share of the kernel of a machine alone)"
    )
    skew = p3dof.analysis.Designs({"leg.com.y [mm]": [1.0]})[0]
    rough = p3dof.analysis.Designs({"leg.com.y [mm]": [1.0], "friction.viscous.sliders": [1.0]})[0]
    alone = {
        "symmetric": kernel_alone("inverse_dynamics", p3dof.PAPER, level, rounds),
        "symmetric, of solids": kernel_alone("inverse_dynamics", p3dof.PAPER, level, rounds),
        "general": kernel_alone("inverse_dynamics", skew, level, rounds),
        "general, with friction": kernel_alone("inverse_dynamics_with_friction", rough, level, rounds),
    }
    own = {
        "symmetric": own_kernel_alone("design_forces_symmetric", p3dof.PAPER, level, rounds),
        "general": own_kernel_alone("design_forces", skew, level, rounds),
        "general, with friction": own_kernel_alone(
            "design_motion_with_friction_viscous", rough, level, rounds
        ),
    }
    for kind, kernel in alone.items():
        designs = Designs(columns(kind, rng), bodies="solids" if "solids" in kind else "kept")
        told = []
        for name, figures in (
            ("forces, reach", ()),
            ("+ singularity", ("singularity",)),
            ("+ power", ("power",)),
        ):
            problem = DesignEvaluation(MOTION, figures=figures, threads=1)
            rate = DESIGNS / least(partial(problem.evaluate, designs), rounds) / 1e6
            told.append(f"{name} {rate:.3f} ({rate * 1e6 * SAMPLES * kernel:.2f})")
        mine = own.get(kind, own["symmetric"])
        kernels = f"kernel of a machine {kernel * 1e9:.2f}, of designs {mine * 1e9:.2f} ns a sample"
        say(f"{kind:24s} {kernels};  {';  '.join(told)}")
    say("gradients, µs a design and column: on NumPy, compiled, ratio (the figures themselves, compiled)")
    for kind in ("symmetric", "general", "general, with friction"):
        for figures in (("singularity",), ("power",)):
            say(f"{kind:24s} {figures[0]:12s} {gradients(columns(kind, rng), figures, rounds)}")
    say(files(rounds))
    few = Designs({name: column[:256] for name, column in columns("symmetric", rng).items()})
    robot = p3dof.load()
    state = MOTION.pose, MOTION.velocity, MOTION.acceleration
    one = (
        least(
            lambda: [np.abs(robot.forces(*state, method="compiled")).max(axis=0) for _ in range(100)], rounds
        )
        / 100
    )
    new = (
        least(lambda: [p3dof.load(few[k]).forces(*state, method="compiled") for k in range(20)], rounds) / 20
    )
    say(f"robot.forces of one motion: {one * 1e6:.1f} µs; of a new machine: {new * 1e6:.0f} µs")


if __name__ == "__main__":
    main()
