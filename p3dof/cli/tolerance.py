"""`p3dof tolerance` and `p3dof sensitivity`: machines that are not what their drawings say."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from p3dof._base.blocks import Processes
from p3dof._base.checks import Progress
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances import read_uncertainty, sensitivity_table, tolerance_tables
from p3dof.analysis.tolerances import sensitivity as sensitivity_of
from p3dof.analysis.tolerances import tolerance as tolerance_of
from p3dof.analysis.tolerances.tolerance import plain_of
from p3dof.cli.app import app
from p3dof.cli.case import Case, with_load
from p3dof.cli.files import InputFile, OutputFolder, protect, save_figure, source
from p3dof.cli.kinds import FIGURE, POSITIVE, Whole, named_option, options
from p3dof.cli.machine import Pose, say_payloads
from p3dof.cli.output import give, in_options, print_written, progress_bar, show

_WORDS = {
    "resume=True": "--resume",
    "resume: expected a folder": "--resume: expected --out, the folder",
    "bodies='solids'": "--solids",
    "on_missing='drop'": "--drop-missing",
    "fixed: ": "--fix: ",
    "figure: expected": "--of: expected",
    "designs: unknown": "--fix: unknown",
    "samples:": "--machines:",
    "numbers by names of parameters, such as {'R': '0.1 mm'}": "one NAME=VALUE or more, such as 'R=0.1 mm', "
    "or a FILE",
    "lengths by names of parameters, such as {'L': '50 um'}": "one NAME=VALUE or more, such as 'L=50 um', "
    "or a FILE",
}
"""What arguments of Python are here."""


_work = options(
    click.option("--solids", is_flag=True, help="Compute all bodies from the solids of each design."),
    named_option(
        "--fix",
        "fixed",
        "Fixed value that differs from the machine, such as a size of its solids: 'rod_radius=3 mm'.",
    ),
    click.option("--seed", type=Whole(0, 2**63), default=0, help="Seed of the random numbers."),
    click.option("--workers", type=Whole(1, 4096), help="Number of worker processes; by default none."),
    click.option("--out", type=OutputFolder(), help="Folder to write the sampled machines to; see --resume."),
    click.option("--resume", is_flag=True, help="Resume the work in the folder of --out."),
    FIGURE,
)
"""What long work needs."""


@app.command()
@click.argument("file", type=InputFile(), required=False, metavar="[FILE]")
@with_load
@named_option(
    "--sigma", "sigmas", "Standard deviation of a parameter, 'R=0.1 mm' or 'platform.mass=2 %'; repeatable."
)
@click.option(
    "--pose", "poses", type=Pose(), multiple=True,
    help="Pose of the platform, '0.1,0,-30 deg', for its static error instead of forces; repeatable.",
)  # fmt: skip
@click.option(
    "--machines", type=Whole(2, 10_000_000),
    help="Monte Carlo: number of sampled machines; by default first order, with exact derivatives.",
)  # fmt: skip
@click.option(
    "--spread", type=click.Choice(("normal", "uniform")), default="normal",
    help="Distribution of the parameters of sampled machines.",
)  # fmt: skip
@click.option(
    "--worst", type=POSITIVE, default=3.0,
    help="Worst case: deviation of all parameters, in standard deviations.",
)  # fmt: skip
@_work
def tolerance(
    case: Case,
    file: Path | None,
    sigmas: tuple[tuple[str, Any], ...],
    poses: tuple[list[float], ...],
    machines: int | None,
    spread: Any,
    worst: float,
    figure: Path | None,
    **work: Any,
) -> int:
    """Tolerance analysis: the uncertainty of the forces over a motion, or of poses, from that of parameters.

    FILE is a YAML file with a field 'sigma': standard deviations by parameter, named as the columns of
    'designs' (R, leg.mass, friction.viscous.sliders), with a unit or in percent. With --pose the parameters
    are R, r, L and encoder, independent for each leg, or of one leg: L.a. --sigma adds to those of FILE.
    """
    protect((file, case.parameters, case.motion_file, case.wrench_file), (figure,))
    sigma = {**(read_uncertainty(source(file)).sigma if file is not None else {}), **dict(sigmas)}
    if poses and (case.motion_file is not None or case.wrench_file is not None):
        raise click.UsageError("--pose asks for static poses: expected no --motion and no --wrench")
    if poses and (work["solids"] or work["fixed"]):
        raise click.UsageError(
            "--solids and --fix belong to forces: the error of a pose depends on lengths alone"
        )
    if machines is None and (work["out"] is not None or work["workers"] is not None or work["resume"]):
        raise click.UsageError(
            "--out, --resume and --workers belong to --machines: the first order takes no time"
        )
    asked: dict[str, Any] = {"sigma": sigma, "worst": worst, "spread": spread}
    asked |= {"samples": machines, "method": "montecarlo"} if machines else {}
    asked |= {"pose": list(poses)} if poses else {"motion": case.motion, "wrench": case.wrench}
    place = "--sigma" if sigmas or file is None else f"{file}: sigma"
    words = {"sigma of": place, "sigma: ": f"{place}: "}
    with _prepared("machines", machines, work, words) as own:
        if poses:
            del own["bodies"], own["fixed"]
        found = tolerance_of(case.robot, **asked, **own)
    return _tell(case, found, tolerance_tables(found), "tolerance_figure", figure)


@app.command()
@click.argument("file", type=InputFile(), required=False, metavar="[FILE]")
@with_load
@named_option(
    "--vary", "variables",
    "Parameter range, 'R=10 %', 'L=[38 mm, 42 mm]' or 'leg.mass={normal: [1 kg, 20 g]}'; repeatable.",
    "R=10 %",
)  # fmt: skip
@click.option(
    "--of",
    "result",
    default="peak_force",
    help="Result whose sensitivity is computed, a column of 'designs'.",
)
@click.option(
    "--local", is_flag=True, help="Local sensitivities (exact derivatives) instead of Sobol' indices."
)
@click.option(
    "--rows", type=Whole(2, 2**28), default=4096,
    help="Base samples of the Sobol' indices (a power of two), each of as many machines as variables plus 2.",
)  # fmt: skip
@click.option(
    "--drop-missing",
    is_flag=True,
    help="Leave out base samples with a machine that cannot perform the motion.",
)
@_work
def sensitivity(
    case: Case,
    file: Path | None,
    variables: tuple[tuple[str, Any], ...],
    result: str,
    local: bool,
    rows: int,
    drop_missing: bool,
    figure: Path | None,
    **work: Any,
) -> int:
    """Compute the sensitivities of the forces to parameters: Sobol' indices over ranges, or local ones.

    FILE is a YAML file with a field 'variables': ranges by parameter, named as the columns of 'designs'.
    --vary adds to those of FILE.
    """
    protect((file, case.parameters, case.motion_file, case.wrench_file), (figure,))
    given = {**(read_uncertainty(source(file)).variables if file is not None else {}), **dict(variables)}
    if file is not None and not given:
        raise InputError(f"{file}: expected a section 'variables', or --vary")
    if local and (work["out"] is not None or work["workers"] is not None or work["resume"]):
        raise click.UsageError("--out, --resume and --workers do not belong to --local, which takes no time")
    method: Any = "gradient" if local else "sobol"
    words = {"variables: ": "--vary: " if variables or file is None else f"{file}: variables: "}
    with _prepared("machines", None if local else rows * (len(given) + 2), work, words) as own:
        found = sensitivity_of(
            case.robot,
            case.motion,
            given,
            result,
            method=method,
            wrench=case.wrench,
            rows=rows,
            on_missing="drop" if drop_missing else "raise",
            **own,
        )
    return _tell(case, found, (sensitivity_table(found),), "sensitivity_figure", figure)


@contextmanager
def _prepared(
    what: str, total: int | None, work: dict[str, Any], words: dict[str, str]
) -> Iterator[dict[str, Any]]:
    """Give the arguments of Python for long work, with workers and a progress bar."""
    with in_options({**_WORDS, **words}), ExitStack() as stack:
        progress: Progress | None = None
        if total:
            progress = stack.enter_context(progress_bar(what, total))
        client = stack.enter_context(Processes(work["workers"])) if work["workers"] is not None else None
        yield {
            "bodies": "solids" if work["solids"] else "kept",
            "fixed": dict(work["fixed"]),
            "seed": work["seed"],
            "folder": work["out"],
            "resume": work["resume"],
            "client": client,
            "progress": progress,
        }


def _tell(case: Case, found: Any, tables: tuple[Any, ...], draw: str, figure: Path | None) -> int:
    """Print what was found, and draw it."""
    console = Console()
    give(plain_of(found))
    say_payloads(console, case.robot.parameters, case.parameters, case.payload)
    show(console, *tables, notes=True)
    print_written(console, save_figure(lambda plots: getattr(plots, draw)(found), figure))
    return 0
