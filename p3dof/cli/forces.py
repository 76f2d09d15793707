"""`p3dof compare` and `p3dof forces`: the actuator forces over a motion."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from p3dof.cli.app import app
from p3dof.cli.options import MOTION, ON_INVALID, PARAMETERS, SAMPLES, protect, read_motion
from p3dof.cli.output import agreement_table, evidence_table, print_plain, print_warnings, progress_bar
from p3dof.errors import InputError, MissingExtraError
from p3dof.manipulator import METHODS, InverseDynamics, Manipulator, load
from p3dof.motion import Motion
from p3dof.routes import LEGS, write_table


@app.command()
@PARAMETERS
@MOTION
@SAMPLES
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="out",
    show_default=True,
    help="Folder for forces.csv and the figure.",
)
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0),
    default=1e-10,
    show_default=True,
    help="Largest difference allowed, as a share of the largest force.",
)
@ON_INVALID
@click.option("--plot/--no-plot", default=True, help="Draw the figure (needs the extra 'plot').")
def compare(
    parameters: Path | None,
    motion: Path | None,
    samples: int | None,
    out: Path,
    tolerance: float,
    on_invalid: str,
    plot: bool,
) -> int:
    """Compute the forces by both methods, compare them, and write forces.csv and a figure.

    Exit code 1 when they disagree by more than the tolerance.
    """
    if not np.isfinite(tolerance):
        raise click.BadParameter(f"expected a finite number, got {tolerance:g}", param_hint="--tolerance")
    protect((parameters, motion), [out / name for name in ("forces.csv", "forces.png", "forces.svg")])
    robot, given = load(parameters), read_motion(motion, samples)
    first, first_seconds = timed(robot, given, "pinocchio", on_invalid)
    second, second_seconds = timed(robot, given, "virtual-power", on_invalid)
    difference = np.abs(first.forces - second.forces)[first.valid & second.valid]
    same_rows = np.array_equal(first.valid, second.valid)
    largest = float(second.peak_forces.max())
    worst = float(difference.max(initial=0))
    agree = same_rows and worst <= tolerance * largest
    written = [_write_both(out / "forces.csv", first, second)]
    if plot:
        written += _draw(out, (first, second))
    console = Console()
    console.print(agreement_table(first, second, difference))
    console.print(evidence_table((first, first_seconds), (second, second_seconds)))
    print_warnings(console, robot, second)
    for path in written:
        print_plain(console, f"wrote {path}")
    verdict = "agree" if agree else "DISAGREE"
    share = worst / largest if largest else 0.0
    console.print(
        f"the methods {verdict}: {worst:.1e} N, {share:.1e} of the largest force "
        f"(tolerance {tolerance:.0e}), over {int(first.valid.sum())} samples",
        style="bold green" if agree else "bold red",
        highlight=False,
    )
    return 0 if agree else 1


@app.command()
@PARAMETERS
@MOTION
@SAMPLES
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="How to compute.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="CSV file for forces, sliders and the power balance.",
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    help="Figure to draw (.png, .svg or .pdf; needs the extra 'plot').",
)
@ON_INVALID
def forces(
    parameters: Path | None,
    motion: Path | None,
    samples: int | None,
    method: str,
    out: Path | None,
    figure: Path | None,
    on_invalid: str,
) -> None:
    """Compute the forces over a motion by one method: peaks on the screen, all samples in a file."""
    protect((parameters, motion, figure), [out])
    protect((parameters, motion), [figure])
    robot, given = load(parameters), read_motion(motion, samples)
    result, seconds = timed(robot, given, method, on_invalid)
    written = [] if out is None else [result.to_csv(out)]
    if figure is not None:
        from p3dof import plots

        written.append(plots.save(plots.forces_figure([result]), figure))
    console = Console()
    table = Table("actuator", "lowest [N]", "highest [N]", "RMS [N]", title=f"forces, {method}")
    for leg, name in enumerate(LEGS):
        values = result.forces[result.valid, leg]
        low, high = (values.min(), values.max()) if len(values) else (np.nan, np.nan)
        table.add_row(name, f"{low:.4f}", f"{high:.4f}", f"{result.rms_forces[leg]:.4f}")
    console.print(table)
    console.print(evidence_table((result, seconds)))
    print_warnings(console, robot, result)
    for path in written:
        print_plain(console, f"wrote {path}")


def timed(robot: Manipulator, motion: Motion, method: str, on_invalid: str) -> tuple[InverseDynamics, float]:
    """Solve with a progress bar; return the result and the seconds that it took."""
    with progress_bar(method, len(motion)) as progress:
        start = time.perf_counter()
        result = robot.inverse_dynamics(
            motion,
            method=method,  # type: ignore[arg-type]  # one of METHODS, as the options say
            on_invalid=on_invalid,  # type: ignore[arg-type]  # likewise
            progress=progress,
        )
        seconds = time.perf_counter() - start
    if not result.valid.any():
        raise InputError(f"no sample of the motion is within what the machine can do ({len(motion)} samples)")
    return result, seconds


def _write_both(path: Path, first: InverseDynamics, second: InverseDynamics) -> Path:
    header = ["t [s]"]
    header += [f"f{leg} {result.method} [N]" for result in (first, second) for leg in LEGS]
    header += [f"difference {leg} [N]" for leg in LEGS]
    columns = (first.time, *first.forces.T, *second.forces.T, *(first.forces - second.forces).T)
    return write_table(path, header, columns)


def _draw(out: Path, results: tuple[InverseDynamics, InverseDynamics]) -> list[Path]:
    from p3dof import plots

    try:
        figure = plots.forces_figure(results)
    except MissingExtraError as error:
        sys.stderr.write(f"p3dof: no figure: {error}\n")
        return []
    return [plots.save(figure, out / name) for name in ("forces.png", "forces.svg")]
