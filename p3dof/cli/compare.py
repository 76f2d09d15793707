"""`p3dof compare`: the main job. Forces by both methods, and by other engines, side by side."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from p3dof import engines
from p3dof.checks import FloatArray
from p3dof.cli.app import app
from p3dof.cli.files import OutputFolder
from p3dof.cli.options import Case, Number, with_case
from p3dof.cli.output import (
    agreement_table,
    evidence_table,
    print_plain,
    print_warnings,
    progress_bar,
    time_text,
)
from p3dof.cli.payloads import print_payloads
from p3dof.cli.terminal import print_table
from p3dof.errors import InputError, MissingExtraError, SampleError
from p3dof.files import together
from p3dof.manipulator import InverseDynamics
from p3dof.methods import LEGS, write_table
from p3dof.motion import Motion

FILES = ("forces.csv", "forces.png", "forces.svg")
ENGINE_TOLERANCE = 1e-9
"""Largest difference of another engine, as a share of the largest force."""

STEP, HALVINGS, RAMP = 1e-3, 3, 0.2
"""Longest time step of the comparison in time [s], how often it is halved, and the ramp from rest [s]."""


@dataclass(frozen=True, eq=False)
class Opinion:
    """What another engine found.

    Parameters
    ----------
    name : str
        Engine and version.
    forces : ndarray, shape (N, 3)
        Its forces; NaN where the motion is invalid [N].
    seconds : float
        How long it took [s].
    """

    name: str
    forces: FloatArray
    seconds: float


@app.command()
@with_case
@click.option(
    "--out",
    type=OutputFolder(),
    default="out",
    show_default=True,
    help="Folder for forces.csv and the figure.",
)
@click.option(
    "--tolerance",
    type=Number(min=0),
    default=1e-10,
    show_default=True,
    help="Largest difference of the two methods allowed, as a share of the largest force.",
)
@click.option(
    "--engines",
    "chosen",
    type=click.Choice(("all", *engines.ENGINES)),
    multiple=True,
    help="Ask other engines too (extra 'engines'); may be given several times.",
)
@click.option(
    "--in-time",
    is_flag=True,
    help="Let Exudyn integrate the motion in time, from rest, with ever smaller steps (extra 'engines').",
)
@click.option("--plot/--no-plot", default=True, help="Draw the figure (needs the extra 'plot').")
def compare(
    case: Case, out: Path, tolerance: float, chosen: tuple[str, ...], in_time: bool, plot: bool
) -> int:
    """Compute the forces by both methods, compare them, and write forces.csv and a figure.

    Exit code 1 when they disagree by more than the tolerance, or the compiled kernels or an engine do by
    more than that and 1e-9; and when the machine cannot make the motion.
    """
    case.protect(*(out / name for name in FILES))
    console = Console()
    print_payloads(console, case)
    (first, first_seconds), (second, second_seconds) = _solve_both(case)
    same_rows = _print_verdicts(console, first, second)
    if not (first.valid & second.valid).any():
        return 1
    opinions = [_ask(name, case, second) for name in _names(chosen)]
    difference = np.abs(first.forces - second.forces)[first.valid & second.valid]
    largest = float(second.force_scale.max())
    worst = float(difference.max(initial=0))
    agree = same_rows and worst <= tolerance * largest
    with together():
        written = [_write(out / FILES[0], first, second, opinions)]
        if plot:
            written += _draw(out, (first, second))
    print_table(console, agreement_table(first, second, difference))
    print_table(console, evidence_table((first, first_seconds), (second, second_seconds)))
    confirmed = _print_opinions(
        console, [_compiled(case, second), *opinions], second, max(tolerance, ENGINE_TOLERANCE)
    )
    if in_time:
        _print_convergence(console, case)
    print_warnings(console, second.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    verdict = "agree" if agree else "DISAGREE"
    share = worst / largest if largest else 0.0
    console.print(
        f"the methods {verdict}: {worst:.1e} N, {share:.1e} of the largest force "
        f"(tolerance {tolerance:.0e}), over {int(first.valid.sum())} samples",
        style="bold green" if agree else "bold red",
        highlight=False,
        soft_wrap=True,
    )
    return 0 if agree and confirmed and second.possible else 1


def _solve_both(case: Case) -> tuple[tuple[InverseDynamics, float], tuple[InverseDynamics, float]]:
    """Solve by both methods; an invalid sample raises as asked only if both refuse the same ones."""
    try:
        return case.solve("pinocchio"), case.solve("virtual-power")
    except (SampleError, InputError):  # the latter: no valid sample at all
        runs = []
        for method in ("pinocchio", "virtual-power"):
            start = time.perf_counter()
            result = case.robot.inverse_dynamics(case.motion, method, case.wrench, "nan")
            runs.append((result, time.perf_counter() - start))
        if np.array_equal(runs[0][0].valid, runs[1][0].valid):
            raise
        return runs[0], runs[1]


def _print_verdicts(console: Console, first: InverseDynamics, second: InverseDynamics) -> bool:
    """Print on which samples the methods, each judging by itself, differ; return whether on none."""
    differing = np.flatnonzero(first.valid != second.valid)
    if not len(differing):
        return True
    i = int(differing[0])
    taken, refused = (first, second) if first.valid[i] else (second, first)
    console.print(
        f"the methods DISAGREE on which samples are valid: {len(differing)} of {len(first.valid)}, the "
        f"first at t = {first.time[i]:g} s (sample {i}), which {taken.method} takes and "
        f"{refused.method} refuses",
        style="bold red",
        highlight=False,
        soft_wrap=True,
    )
    return False


def _names(chosen: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(engines.ENGINES) if "all" in chosen else tuple(dict.fromkeys(chosen))


def _ask(name: str, case: Case, known: InverseDynamics) -> Opinion:
    """Let an engine compute the forces of the valid samples."""
    engine = engines.load(name, case.robot.parameters)
    valid, motion = known.valid, case.motion
    time_, pose = motion.time[valid], motion.pose[valid]
    asked = Motion(time_, pose, motion.velocity[valid], motion.acceleration[valid], check=False)
    forces = np.full_like(known.forces, np.nan)
    with progress_bar(name, len(asked)) as progress:
        start = time.perf_counter()
        forces[valid] = engine.forces(asked, known.wrench[valid], progress)
        seconds = time.perf_counter() - start
    return Opinion(f"{name} {engine.version}", forces, seconds)


def _compiled(case: Case, known: InverseDynamics) -> Opinion:
    """Compute the forces of the valid samples by the kernels, without what else a result carries."""
    valid, motion, kernels = known.valid, case.motion, case.robot.kernels
    states = motion.pose[valid], motion.velocity[valid], motion.acceleration[valid]
    forces = np.full_like(known.forces, np.nan)
    case.robot.forces(*states, "compiled", known.wrench[valid])  # the first call prepares
    start = time.perf_counter()
    forces[valid] = case.robot.forces(*states, "compiled", known.wrench[valid])
    return Opinion(f"compiled ({kernels.level})", forces, time.perf_counter() - start)


def _print_opinions(
    console: Console, opinions: list[Opinion], known: InverseDynamics, tolerance: float
) -> bool:
    """Print how far others are from the virtual powers; return whether all are near enough."""
    table = Table("by", "largest difference [N]", "of the largest force", "time per sample")
    table.title = "others against virtual-power"
    largest, agree = float(known.force_scale.max()), True
    for opinion in opinions:
        worst = float(np.abs(opinion.forces - known.forces)[known.valid].max())
        agree = agree and worst <= tolerance * largest
        share = worst / largest if largest else 0.0
        table.add_row(
            opinion.name, f"{worst:.1e}", f"{share:.1e}", time_text(opinion.seconds / int(known.valid.sum()))
        )
    print_table(console, table)
    if not agree:
        console.print(f"one of the others DISAGREES by more than {tolerance:.0e}", style="bold red")
    return agree


def _print_convergence(console: Console, case: Case) -> None:
    """Print how the forces of Exudyn's integration in time approach the virtual powers."""
    entered = case.motion.from_rest(min(RAMP, case.motion.duration))
    count = max(2, 2 * round(entered.duration / STEP / 2))  # whole double steps
    motion = entered.resampled(count + 1)
    wrench = None if case.history is None else case.history(motion.time)
    known = case.robot.inverse_dynamics(motion, "virtual-power", wrench=wrench)
    found = engines.convergence(
        case.robot.parameters, motion, known.forces, motion.duration / count, HALVINGS, wrench=wrench
    )
    table = Table(escape("step [ms]"), "error, of the largest force", "order", escape("largest gap [m]"))
    table.title = "Exudyn in time (sliders driven, trapezoidal rule), against virtual-power"
    orders = ["", *(f"{order:.3f}" for order in found.orders)]
    for step, error, order, gap in zip(found.steps, found.errors, orders, found.gaps, strict=True):
        table.add_row(f"{1e3 * step:.4g}", f"{error:.1e}", order, f"{gap:.1e}")
    table.add_row("→ 0", f"{found.extrapolated_error:.1e}", "", "")
    print_table(console, table)


def _write(path: Path, first: InverseDynamics, second: InverseDynamics, opinions: list[Opinion]) -> Path:
    named = {first.method: first.forces, second.method: second.forces}
    named |= {opinion.name: opinion.forces for opinion in opinions}
    header = ["t [s]", *(f"f{leg} {name} [N]" for name in named for leg in LEGS)]
    header += [f"difference {leg} [N]" for leg in LEGS]
    tables = [*named.values(), first.forces - second.forces]
    return write_table(path, header, (first.time, *(column for table in tables for column in table.T)))


def _draw(out: Path, results: tuple[InverseDynamics, InverseDynamics]) -> list[Path]:
    from p3dof import plots

    try:
        figure = plots.forces_figure(results)
    except MissingExtraError as error:
        sys.stderr.write(f"p3dof: no figure: {error}\n")
        return []
    return [plots.save(figure, out / name) for name in FILES[1:]]
