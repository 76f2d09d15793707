"""What the commands that measure share: options, files of measured poses, what excitation tells."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import (
    ANGLES,
    LARGEST,
    LENGTHS,
    FloatArray,
    is_number,
    name_and_unit,
    shown,
    with_point,
)
from p3dof._base.errors import InputError
from p3dof._base.files import read_text, suffix_of
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MOMENT
from p3dof.cli.files import InputFile, console_beside, file_name, source, write_results
from p3dof.cli.kinds import (
    FIGURE,
    HERTZ,
    SECONDS,
    Amount,
    Whole,
    as_one,
    named_option,
    options,
    require_unit,
    table_out,
)
from p3dof.cli.output import in_options, print_plain, print_written, progress_bar, show
from p3dof.loops.identification.excitation import Excitation, excitation_tables, optimise_excitation
from p3dof.loops.identification.forces import IdentifiableForces, States
from p3dof.loops.identification.search import Criterion

_FORCE = Amount(FORCE, MOMENT)


def read_poses(
    text: str, source: str, readings: Mapping[str, bool], measured: Mapping[str, bool]
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Return readings (K, m) of the motors, names of what was measured, and its values (K, c) or NaN.

    Columns come in any order; `readings` and `measured` tell which there may be, and which are lengths.
    """
    lines = [
        (i, line) for i, line in enumerate(io.StringIO(text), 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    if len(lines) < 2:
        raise InputError(f"{source}: expected a line of names and lines of numbers, got {len(lines)} lines")
    names, factors = _header(lines[0], source, {**measured, **readings})
    missing = [name for name in readings if name not in names]
    if missing:
        raise InputError(f"{source}: there is no column {shown(missing[0])}: expected one for every motor")
    table = np.array([_row(line, source, names, readings) for line in lines[1:]]) * factors
    seen = tuple(name for name in measured if name in names)
    columns = [names.index(name) for name in (*readings, *seen)]
    values = table[:, columns]
    return values[:, : len(readings)], seen, values[:, len(readings) :]


def _fields(line: tuple[int, str], source: str) -> list[str]:
    if ";" in line[1] and "," not in line[1]:
        raise InputError(f"{source}, line {line[0]}: expected commas between the columns, got ';'")
    return [field.strip() for field in next(csv.reader([line[1]]))]


def _header(line: tuple[int, str], source: str, lengths: Mapping[str, bool]) -> tuple[list[str], FloatArray]:
    names, factors = [], []
    for field in _fields(line, source):
        name, unit = name_and_unit(field)
        where = f"{source}, line {line[0]}, column {shown(name)}"
        if name not in lengths or name in names:
            wanted = "each name once" if name in names else f"one of {', '.join(lengths)}"
            raise InputError(f"{where}: expected {wanted}")
        units = LENGTHS if lengths[name] else ANGLES
        if unit is not None and unit not in units:
            raise InputError(f"{where}: expected a unit of {', '.join(units)}, got [{unit[:20]}]")
        multiply, divide = units[unit] if unit is not None else (1.0, 1.0)
        names.append(name)
        factors.append(multiply / divide)
    return names, np.array(factors)


def _row(line: tuple[int, str], source: str, names: Sequence[str], needed: Mapping[str, bool]) -> list[float]:
    fields = _fields(line, source)
    if len(fields) != len(names):
        raise InputError(f"{source}, line {line[0]}: expected {len(names)} columns, got {len(fields)}")
    row = []
    for name, field in zip(names, fields, strict=True):
        number = float(field) if is_number(field) else math.nan
        if (field or name in needed) and not abs(number) <= LARGEST:
            where = f"{source}, line {line[0]}, column {name}"
            raise InputError(f"{where}: expected a number, got {shown(field)}{with_point(field)}")
        row.append(number)
    return row


MEASURING = options(
    click.option(
        "--accuracy", type=Amount(LENGTH), required=True,
        help="Standard deviation of a measured length, such as '10 um'.",
    ),
    click.option(
        "--angle-accuracy", type=Amount(ANGLE), default="0.1 mrad", show_default=True,
        help="Standard deviation of a measured angle.",
    ),
    named_option(
        "--sigma", "sigmas", "Standard deviation of a parameter about the design, 'L=50 um'; repeatable."
    ),
    click.option(
        "--hold-out", type=Whole(2, 1000), metavar="N",
        help="Leave every N-th pose out, to test the result with.",
    ),
    click.option("--leave-out", is_flag=True, help="Leave out numbers that do not fit the others."),
    click.option(
        "--plan", type=Whole(1, 10_000), metavar="POSES",
        help="Choose so many poses to measure instead, of those in the file, or of random ones.",
    ),
)  # fmt: skip
"""Options of both commands that calibrate."""
ACCURACIES = {"sigma of measured lengths": "--accuracy", "sigma of measured angles": "--angle-accuracy"}
"""What arguments of Python are among these options."""


def poses_in(
    path: Path, readings: dict[str, bool], measured: dict[str, bool], needed: bool
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Return what a file of poses has."""
    text = read_text(source(path))
    read, seen, values = read_poses(text, file_name(path) or "-", readings, measured)
    if needed and not seen:
        raise InputError(f"{file_name(path)}: expected measured columns, some of {', '.join(measured)}")
    return read, seen, values


def parted(count: int, hold_out: int | None) -> tuple[Any, Any]:
    """Return which poses are used, and which are held out."""
    held = np.zeros(count, dtype=bool)
    if hold_out:
        held[hold_out - 1 :: hold_out] = True
    return ~held, held


def require_plan(out: Path | None, figure: Path | None, hold_out: int | None, leave_out: bool) -> None:
    """Raise if options do not belong to a plan."""
    if figure is not None or hold_out is not None or leave_out:
        raise click.UsageError(
            "--plan measures nothing yet: expected no --figure, --hold-out and --leave-out"
        )
    if out is not None:
        suffix_of(out, "table")


def tell_noise(console: Console, noise: float) -> None:
    """Say how well the numbers fit."""
    told = f"Measured numbers scatter by {noise:.3g} of what the accuracy says."
    if noise > _MUCH:
        told += " Much more than 1: something else than these parameters, or a worse accuracy."
    print_plain(console, told)


_MUCH = 2.0


def rms(error: FloatArray, noise: Any) -> float:
    """Return the root mean square of errors in standard deviations."""
    return float(np.sqrt(np.nanmean((np.asarray(error) / np.asarray(noise)) ** 2)))


HELD_OUT = 5.0
"""Deviations from which a number of a pose held out does not fit."""


def held_out_told(error: FloatArray, sigma: Any, names: Sequence[str], held: Any, noise: float) -> list[str]:
    """Return a line for each number of poses held out that is far off, the worst first."""
    unit = float(np.fmax(1.0, noise))  # where all numbers scatter more than was said
    apart = np.nan_to_num(np.abs(np.asarray(error) / np.asarray(sigma)))
    poses = np.flatnonzero(held)
    far = [(float(apart[k, i]), poses[k] + 1, names[i]) for k, i in np.argwhere(apart > HELD_OUT * unit)]
    return [f"pose {k}, {name}: held out, and {x:.3g} deviations off" for x, k, name in sorted(far)[::-1]]


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
        click.option("--duration", type=SECONDS, default=2.0, help="Duration of a period [s]."),
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
        click.option("--noise", type=_FORCE, default=1.0, help="Noise of a measured force [N or N m]."),
        click.option("--rate", type=HERTZ, default=1000.0, help="Samples of the measurement [Hz]."),
        click.option("--periods", type=Whole(1, 100_000), default=5, help="Periods that are measured."),
        click.option(
            "--ramp", type=SECONDS, help="Ramps from and to rest, each [s]; by default a period or more."
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
    type=_FORCE,
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
    require_unit("--noise", wanted.noise, forces.force_units)
    require_unit("--target-error", target_error, forces.force_units)
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
        print_plain(console, _told(found, target_error or 0.0, measured))
    print_written(console, written)
    return 0


def _told(found: Excitation, accuracy: float, measured: float) -> str:
    what = "the workspace" if found.task_error is None else "the task"
    unit = " or ".join(dict.fromkeys(found.force_units))
    return (
        f"An error of {accuracy:g} {unit} RMS of every actuator over {what} takes {measured:g} s of "
        f"measurement, {round(measured / found.period)} periods."
    )
