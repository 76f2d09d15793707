"""The commands, thin: they read the options, call the package and print what comes back."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from p3dof import __version__, description
from p3dof.cli.output import agreement_table, evidence_table, print_plain, print_warnings, progress_bar
from p3dof.errors import InputError, MissingExtraError, P3dofError
from p3dof.manipulator import METHODS, InverseDynamics, Manipulator, load
from p3dof.manipulator.results import LEGS, write_table
from p3dof.motion import Motion, paper_motion

SHOWN = 20
"""Most differences that ``--check`` prints."""

PARAMETERS = click.option(
    "--parameters",
    type=click.Path(path_type=Path),
    help="Parameter file (YAML); the paper's machine without it.",
)
MOTION = click.option(
    "--motion",
    type=click.Path(path_type=Path),
    help="Motion file (CSV: t,y,z,theta[,ydot,...]); the paper's without it.",
)
SAMPLES = click.option(
    "--samples",
    type=click.IntRange(2, 1_000_000),
    help="Samples of the paper's motion; 1001 without it.",
)
ON_INVALID = click.option(
    "--on-invalid",
    type=click.Choice(("raise", "nan")),
    default="raise",
    show_default=True,
    help="Stop at a sample that is out of reach or singular, or leave it NaN.",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The arguments; those of the process by default.

    Returns
    -------
    int
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek letters still gets its tables
    try:
        code = app(
            args=None if arguments is None else list(arguments), standalone_mode=False, prog_name="p3dof"
        )
    except P3dofError as error:
        return _fail(str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        sys.stderr.write(f"{error.format_message()}\n")
        return 2
    except click.exceptions.Abort:
        return _fail("interrupted", 130)
    except click.ClickException as error:
        return _fail(error.format_message())
    except OSError as error:  # such as a full disk behind the standard output
        return _fail(f"cannot write the output ({error.strerror or error})")
    return int(code or 0)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="p3dof %(version)s")
def app() -> None:
    """Inverse dynamics of a 3-DOF spatial parallel manipulator, by Pinocchio and by virtual powers."""


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
    _protect((parameters, motion), [out / name for name in ("forces.csv", "forces.png", "forces.svg")])
    robot, given = load(parameters), _motion(motion, samples)
    first, first_seconds = _timed(robot, given, "pinocchio", on_invalid)
    second, second_seconds = _timed(robot, given, "virtual-power", on_invalid)
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
    _protect((parameters, motion, figure), [out])
    _protect((parameters, motion), [figure])
    robot, given = load(parameters), _motion(motion, samples)
    result, seconds = _timed(robot, given, method, on_invalid)
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


OUT_FOLDER = click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="urdf",
    show_default=True,
    help="Folder of the generated files.",
)
CHECK = click.option("--check", is_flag=True, help="Write nothing; exit code 1 if the files there differ.")


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@click.option("--exact", is_flag=True, help="Leave massless links massless, which many readers misread.")
def urdf(parameters: Path | None, out: Path, check: bool, exact: bool) -> int:
    """Write the URDF and its sidecar (loop closures, actuated joints), or check those in a folder."""
    return _write_or_check(parameters, out, ("urdf",), check, exact)


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@click.option(
    "--format",
    "formats",
    type=click.Choice(("all", *description.FORMATS)),
    multiple=True,
    default=("all",),
    show_default=True,
    help="What to write; may be given several times.",
)
def export(parameters: Path | None, out: Path, check: bool, formats: tuple[str, ...]) -> int:
    """Write the model for other tools, with its loops where the format can hold them."""
    if "all" not in formats:
        return _write_or_check(parameters, out, tuple(dict.fromkeys(formats)), check)
    return _write_or_check(parameters, out, tuple(description.FORMATS), check, skip_missing=True)


def _write_or_check(
    source: Path | None,
    out: Path,
    formats: tuple[str, ...],
    check: bool,
    exact: bool = False,
    skip_missing: bool = False,
) -> int:
    """Write or check formats; with `skip_missing` one whose library is not installed is passed over aloud."""
    console, differences = Console(), []
    if not check:
        _protect((source,), [out / file for name in formats for file in description.FORMATS[name]])
    robot = load(source)
    for name in formats:
        try:
            if check:
                differences += description.check(robot.parameters, out, (name,), exact)
                continue
            for path in description.write(robot.parameters, out, (name,), exact):
                print_plain(console, f"wrote {path}")
        except MissingExtraError as error:
            if not skip_missing:
                raise
            sys.stderr.write(f"p3dof: {name} left out: {error}\n")
    for line in differences[:SHOWN]:
        print_plain(console, line)
    if len(differences) > SHOWN:
        print_plain(console, f"... and {len(differences) - SHOWN} more differences")
    if check and not differences:
        print_plain(console, f"{out}: up to date")
    return 1 if differences else 0


def _fail(message: str, code: int = 2) -> int:
    line = " ".join(message.split())
    sys.stderr.write(f"p3dof: error: {line}\n")
    return code


def _protect(inputs: Iterable[Path | None], outputs: Iterable[Path | None]) -> None:
    """Refuse to write over a file that is read in the same command, or twice to one file."""
    used = {path.resolve() for path in inputs if path is not None}
    for path in outputs:
        if path is not None and path.resolve() in used:
            raise click.UsageError(f"{path} would be overwritten: it is already used by this command")


def _motion(path: Path | None, samples: int | None) -> Motion:
    if path is None:
        return paper_motion(1001 if samples is None else samples)
    if samples is not None:
        raise click.UsageError("--samples belongs to the paper's motion, and --motion gives another one")
    return Motion.from_csv(path)


def _timed(robot: Manipulator, motion: Motion, method: str, on_invalid: str) -> tuple[InverseDynamics, float]:
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
