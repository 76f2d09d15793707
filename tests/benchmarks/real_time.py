"""Generated C in real time: how long each of many calls takes, and how loops keep their period under load.

Four functions: inverse dynamics of the paper's machine, forces of a Stewart platform, a step of an ankle's
transmission along a way, and the longest ways that there are: towards positions that it does not reach. Times
of single calls include the clock's own, which stands beside them. The loops sleep until absolute times, by
SCHED_FIFO where that is allowed, while every processor is busy. Run with ``make benchmarks``, or with more
samples: ``--samples 100000000``. Timings are never a test.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from rich.table import Table
from rounds import described, load_average, wide_console

import p3dof
from p3dof.codegen.controller import controller_files
from p3dof.codegen.loops import loop_files
from p3dof.machine.parameters import PAPER
from p3dof.report.plots.common import new_figure, save, tidy

HERE = Path(__file__).parent
GALLERY = HERE.parents[1] / "docs/_static/gallery"
ROWS = 1024
SHARES = {"50 %": 0.5, "99 %": 0.99, "99.9 %": 0.999, "99.99 %": 0.9999, "99.9999 %": 0.999999, "worst": 1.0}
ANKLE = ("ankle_pitch", "ankle_roll")
MAPPED = """
static ankle_transmission state;
static int call(long i)
{
    double joint[2], speed[2];
    if (i == 0) {
        ankle_transmission_start(&state, NULL);
    }
    return (int)ankle_actuator_to_joint(&state, rows[i % 1024], rows[i % 1024] + 2, NULL, joint, speed,
                                        NULL, NULL);
}
"""


@dataclass(frozen=True)
class Subject:
    """A function, the files that have it, and rows of numbers that it is given."""

    name: str
    prefix: str
    files: dict[str, str]
    rows: np.ndarray
    call: str


def subjects() -> list[Subject]:
    """Return what is timed."""
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(-0.05, 0.05, ROWS), rng.uniform(-0.05, 0.05, ROWS),
                             rng.uniform(-0.3, 0.3, ROWS)])  # fmt: skip
    machine = np.column_stack([poses, rng.normal(size=(ROWS, 6))])
    forces = (
        "static int call(long i)\n{\n    const double *x = rows[i % 1024];\n    double f[3];\n"
        "    return (int)mill_inverse_dynamics(x, x + 3, x + 6, NULL, f);\n}\n"
    )
    stewart = p3dof.load_robot(GALLERY / "stewart.urdf")
    home, n = stewart.assemble().q, len(stewart.actuated)
    start = [home[stewart.model.idx_qs[stewart.model.getJointId(name)]] for name in stewart.actuated]
    target = np.array(start) + rng.uniform(-0.01, 0.01, (ROWS, n))
    states = stewart.complete_batch(target, *rng.normal(size=(2, ROWS, n)), guess=home)
    robot = (
        "static int call(long i)\n{\n    const double *q = rows[i % 1024];\n"
        f"    const double *v = q + {stewart.model.nq}, *a = v + {stewart.model.nv};\n"
        f"    double tau[{n}], lambda_[{stewart.model.nv}];\n"
        "    return (int)platform_inverse_dynamics(q, v, a, tau, lambda_, NULL);\n}\n"
    )
    leg = p3dof.load_robot(GALLERY / "leg.urdf")
    one = leg.transmission(ANKLE, level="numpy")
    phase = 2 * np.pi * np.arange(ROWS)[:, None] / ROWS + [0.0, 1.0]
    middle = one.positions("actuator", one.home) - 0.3 * np.sin([0.0, 1.0])
    way = np.column_stack([middle + 0.3 * np.sin(phase), 6.0 * np.cos(phase)])  # 3 Hz at 3 kHz
    home = one.positions("actuator", one.home)
    tried = home + rng.uniform(-3.1, 3.1, (8 * ROWS, 2))
    far = np.column_stack([tried[unreached(leg, tried)][:ROWS], np.zeros((ROWS, 2))])
    mapped = loop_files(leg, "ankle", coordinates=ANKLE).files
    everything = np.concatenate([states.q, states.v, states.a], axis=1)
    return [
        Subject("machine, inverse dynamics", "mill", controller_files(PAPER, True, "mill"), machine, forces),
        Subject("Stewart platform, inverse dynamics", "platform",
                loop_files(stewart, "platform", ["inverse_dynamics"]).files, everything, robot),
        Subject("ankle, motors to joints", "ankle", mapped, way, MAPPED),
        Subject("ankle, beyond its reach", "ankle", mapped, far, MAPPED),
    ]  # fmt: skip


def unreached(leg: p3dof.ClosedLoopModel, motors: np.ndarray) -> list[bool]:
    """Return which positions of its ankle's motors the leg does not reach from where it is."""
    _, mapped = leg.transmission(ANKLE).bind()
    start, found = mapped._state.copy(), []
    for row in motors:
        mapped._state[:] = start
        mapped.inputs["position"][:] = row
        mapped.run()
        found.append(mapped.status != 0)
    return found


def build(subject: Subject, folder: Path) -> Path:
    """Compile the program that times a subject, with the flags of its Makefile."""
    for name, text in subject.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    rows = ",\n".join("{" + ", ".join(map(repr, row)) + "}" for row in subject.rows.tolist())
    table = f"static const double rows[{ROWS}][{subject.rows.shape[1]}] = {{\n{rows}}};\n"
    text = f'#define _GNU_SOURCE\n#include "{subject.prefix}.h"\n#include <stddef.h>\n{table}{subject.call}'
    (folder / "timed.c").write_text(text + f'#include "{HERE / "real_time.c"}"\n', encoding="utf-8")
    flags = ["-O2", "-march=native", "-ffp-contract=fast", "-std=c99"]
    command = ["gcc", *flags, "timed.c", f"{subject.prefix}.c", "-o", "timed", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "timed"


def spread(program: Path, *arguments: object) -> dict[str, np.ndarray]:
    """Run it; return times [ns] and how often they were, by name."""
    command = [program, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise click.ClickException(done.stderr.strip() or "the program failed")
    found: dict[str, list[tuple[int, int]]] = {}
    for line in done.stdout.splitlines():
        name, time, count = line.split()
        found.setdefault(name, []).append((int(time), int(count)))
    return {name: np.array(rows) for name, rows in found.items()}


def cells(rows: np.ndarray) -> list[str]:
    """Return the times of a table's row."""
    share = np.cumsum(rows[:, 1]) / rows[:, 1].sum()
    return [shown(rows[int(np.searchsorted(share, least - 1e-15)), 0]) for least in SHARES.values()]


def shown(time: float) -> str:
    """Return a time [ns] in a unit that fits."""
    for unit, size in (("ms", 1e6), ("µs", 1e3)):
        if time >= size:
            return f"{time / size:.3g} {unit}"
    return f"{time:.0f} ns"


@contextlib.contextmanager
def busy() -> Iterator[None]:
    """Keep every processor at work, with arithmetic and memory beyond the caches."""
    text = "import numpy as np\nx = np.ones(1 << 22)\nwhile True:\n    x = np.sqrt(x[::-1]) + 1e-9"
    children = [subprocess.Popen([sys.executable, "-c", text]) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def draw(found: Sequence[tuple[str, np.ndarray]], path: Path) -> Path:
    """Draw how many calls take longer than a time."""
    figure = new_figure((8.0, 4.4))
    axis = figure.subplots()
    for name, rows in found:
        longer = 1.0 - (np.cumsum(rows[:, 1]) - rows[:, 1]) / rows[:, 1].sum()
        axis.step(rows[:, 0] * 1e-9, longer, where="post", label=name)
    axis.set(xscale="log", yscale="log", xlabel="time of a call, or wake-up latency [s]",
             ylabel="share of calls that take longer")  # fmt: skip
    tidy(axis)
    axis.legend(fontsize=8)
    return save(figure, path)


@click.command()
@click.option("--samples", default=10_000_000, help="Calls of each function; a hundredth of the longest one.")
@click.option("--seconds", default=20.0, help="Length of each loop [s].")
@click.option("--figure", type=click.Path(path_type=Path), help="Figure of the distributions to draw.")
def main(samples: int, seconds: float, figure: Path | None) -> None:
    """Time generated C call by call, and in loops under load."""
    console = wide_console()
    console.print(f"{described()}; {load_average()}", highlight=False)
    curves: list[tuple[str, np.ndarray]] = []
    with tempfile.TemporaryDirectory() as base:
        table, loops = (
            Table(title=title) for title in (f"{samples:,} calls", f"Loops of {seconds:g} s under load")
        )
        for one in (table, loops):
            for column in ("", *SHARES):
                one.add_column(column, justify="left" if not column else "right")
        programs = {}
        for i, subject in enumerate(subjects()):
            folder = Path(base) / str(i)
            folder.mkdir()
            programs[subject.name] = program = build(subject, folder)
            count = samples // 100 if "beyond" in subject.name else samples  # it takes long
            found = spread(program, "spread", count)
            table.add_row(subject.name, *cells(found["work"]))
            failed = int(found["failed"][0, 1])
            if failed != count * ("beyond" in subject.name):
                raise click.ClickException(f"{subject.name}: {failed} calls failed")
            curves.append((subject.name, found["work"]))
        table.add_row("the clock alone", *cells(found["clock"]))
        console.print(table)
        with busy():
            for name in list(programs)[:3]:
                for rate in (1000, 4000):
                    for fifo in (1, 0):
                        try:
                            found = spread(programs[name], "loop", rate, seconds, fifo)
                        except click.ClickException as error:
                            console.print(f"{name}, SCHED_FIFO: {error.message}", highlight=False)
                            continue
                        kind = f"{name}, {rate} Hz, {'SCHED_FIFO' if fifo else 'usual scheduler'}"
                        loops.add_row(f"{kind}: wake-up", *cells(found["wake"]))
                        loops.add_row(f"{kind}: call", *cells(found["work"]))
                        if rate == 4000 and name.startswith("machine"):
                            words = "SCHED_FIFO" if fifo else "usual scheduler"
                            curves.append((f"wake-up, 4 kHz, {words}, under load", found["wake"]))
        console.print(loops)
    if figure is not None:
        console.print(f"wrote {draw(curves, figure)}", highlight=False)


if __name__ == "__main__":
    main()
