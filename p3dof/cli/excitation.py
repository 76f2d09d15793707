"""What `p3dof excite` and `p3dof loop excite` share: what motion is wanted, and what is shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import click

from p3dof.cli.files import InputFile, console_beside, write_results
from p3dof.cli.kinds import FIGURE, POSITIVE, Whole, as_one, options, table_out
from p3dof.cli.output import in_options, print_written, progress_bar, show
from p3dof.loops.identification.excitation import Excitation, excitation_tables, optimise_excitation
from p3dof.loops.identification.forces import IdentifiableForces, States
from p3dof.loops.identification.search import Criterion


@dataclass(frozen=True)
class Wanted:
    """How an excitation motion is wanted: arguments of `optimise_excitation`."""

    duration: float
    harmonics: int
    waypoints: int | None
    criterion: Criterion
    prior: bool
    noise: float
    rate: float
    periods: int
    ramp: float | None
    seed: int
    motions: int


def wanted(motions: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return what gives a command these options as the argument `wanted`."""
    found: Callable[[Callable[..., Any]], Callable[..., Any]] = as_one(
        "wanted",
        Wanted,
        click.option("--duration", type=POSITIVE, default=2.0, help="Duration of a period [s]."),
        click.option("--harmonics", type=Whole(1, 100), default=5, help="Harmonics of the Fourier series."),
        click.option(
            "--waypoints",
            type=Whole(6, 200),
            help="Use closed quintic splines through so many waypoints in place of the Fourier series.",
        ),
        click.option(
            "--criterion",
            type=click.Choice(get_args(Criterion)),
            default="prediction",
            help="Least error of predicted forces (I-optimal), least confidence ellipsoid (D-optimal), or "
            "condition number.",
        ),
        click.option("--prior", is_flag=True, help="The estimate will use the prior of the design."),
        click.option("--noise", type=POSITIVE, default=1.0, help="Noise of a measured force [N or N m]."),
        click.option("--rate", type=POSITIVE, default=1000.0, help="Samples of the measurement [Hz]."),
        click.option("--periods", type=Whole(1, 100_000), default=5, help="Periods that are measured."),
        click.option(
            "--ramp", type=POSITIVE, help="Ramps from and to rest, each [s]; by default a period or more."
        ),
        click.option("--seed", type=Whole(0, 2**32 - 1), default=0, help="Seed of the random numbers."),
        click.option(
            "--motions",
            type=Whole(1, 10_000_000),
            default=motions,
            help="Motions that are evaluated at most.",
        ),
    )
    return found


ACCURACY = click.option(
    "--target-error",
    type=POSITIVE,
    help="Also compute how long must be measured for this error of predicted forces [N or N m, RMS].",
)
TASK = click.option(
    "--task", type=InputFile(), help="Motion file whose forces are to be predicted; by default any motion."
)
OUTPUTS = options(table_out("the whole experiment, a motion file"), FIGURE)


def run(
    forces: IdentifiableForces,
    task: States | None,
    wanted: Wanted,
    target_error: float | None,
    files: tuple[Path | None, Path | None],
    derivatives: bool,
) -> int:
    """Find an excitation motion; print and write it."""
    with in_options({"waypoints: ": "--waypoints: ", "rate: ": "--rate: ", "accuracy: ": "--target-error: "}):
        found = optimise_excitation(forces, task=task, watch=progress_bar, **asdict(wanted))
        measured = None if target_error is None else found.duration_for(target_error)
    out, figure = files
    written = write_results(
        lambda path: found.to_csv(path, derivatives=derivatives),
        out,
        figure,
        lambda plots: plots.excitation_figure(found, forces),
    )
    console = console_beside(out)
    show(console, *excitation_tables(found), notes=True)
    if measured is not None:
        console.print(_told(found, target_error or 0.0, measured), highlight=False, soft_wrap=True)
    print_written(console, written)
    return 0


def _told(found: Excitation, accuracy: float, measured: float) -> str:
    what = "the workspace" if found.task_error is None else "the task"
    unit = " or ".join(dict.fromkeys(found.force_units))
    return (
        f"An error of {accuracy:g} {unit} RMS of every actuator over {what} takes {measured:g} s of "
        f"measurement, {round(measured / found.period)} periods."
    )
