"""`p3dof compare`: the main job. Forces by both methods, and by other engines, side by side."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof._base.errors import MissingExtraError
from p3dof._base.files import together
from p3dof._base.tables import table_of
from p3dof.cli.app import app
from p3dof.cli.files import OutputFolder
from p3dof.cli.kinds import Number
from p3dof.cli.options import Case, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar, say, show
from p3dof.cli.payloads import print_payloads
from p3dof.methods import InverseDynamics, engines, evidence_table
from p3dof.methods.comparison import ENGINE_TOLERANCE, TOLERANCE
from p3dof.methods.comparison import compare as compare_methods
from p3dof.methods.comparison_tables import agreement_table, opinions_table

FILES = ("forces.csv", "forces.png", "forces.svg")

STEP, HALVINGS, RAMP = 1e-3, 3, 0.2
"""Longest time step of the comparison in time [s], how often it is halved, and the ramp from rest [s]."""


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
    default=TOLERANCE,
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
    found = compare_methods(
        case.robot,
        case.motion,
        case.wrench,
        case.on_invalid,  # type: ignore[arg-type]  # one of two, as the options say
        chosen,
        tolerance,
        progress_bar,
    )
    if found.verdict_on_samples:
        _print_verdict(console, found.verdict_on_samples, False)
    if not found.both_valid.any():
        if not found.verdict_on_samples:
            case.require_valid(found.second.valid)
        return 1
    with together():
        written = [found.to_csv(out / FILES[0])]
        if plot:
            written += _draw(out, (found.first, found.second))
    show(console, agreement_table(found))
    show(console, evidence_table(found.first, found.second, seconds=found.seconds), opinions_table(found))
    if not found.confirmed:
        allowed = max(found.tolerance, ENGINE_TOLERANCE)
        console.print(f"one of the others DISAGREES by more than {allowed:.0e}", style="bold red")
    if in_time:
        _print_convergence(console, case)
    print_warnings(console, found.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    _print_verdict(console, found.verdict, found.agree)
    return 0 if found.passed else 1


def _print_verdict(console: Console, sentence: str, good: bool) -> None:
    style = "bold green" if good else "bold red"
    console.print(sentence, style=style, highlight=False, soft_wrap=True)


def _print_convergence(console: Console, case: Case) -> None:
    """Print how the forces of Exudyn's integration in time approach the virtual powers."""
    entered = case.motion.from_rest(min(RAMP, case.motion.duration))
    count = max(2, 2 * round(entered.duration / STEP / 2))  # whole double steps
    motion = entered.resampled(count + 1)
    wrench = None if case.history is None else case.history(motion.time)
    known = case.robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench)
    found = engines.convergence(
        case.robot.parameters, motion, known.forces, motion.duration / count, HALVINGS, wrench=wrench
    )
    orders = ["", *(f"{order:.3f}" for order in found.orders)]
    rows = {
        f"{1e3 * step:.4g}": (f"{error:.1e}", order, f"{gap:.1e}")
        for step, error, order, gap in zip(found.steps, found.errors, orders, found.gaps, strict=True)
    }
    rows["→ 0"] = (f"{found.extrapolated_error:.1e}", "", "")
    title = "Exudyn in time (sliders driven, trapezoidal rule), against virtual-power"
    header = ("step [ms]", "error, of the largest force", "order", "largest gap [m]")
    show(console, table_of(title, header, rows))


def _draw(out: Path, results: tuple[InverseDynamics, InverseDynamics]) -> list[Path]:
    from p3dof.report import plots

    try:
        figure = plots.forces_figure(results)
    except MissingExtraError as error:
        say(f"no figure: {error}")
        return []
    return [plots.save(figure, out / name) for name in FILES[1:]]
