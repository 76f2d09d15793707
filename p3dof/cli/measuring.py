"""What the commands that calibrate share: options, files of measured poses, what is held out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.files import read_text, suffix_of
from p3dof._base.quantities import ANGLE, LENGTH
from p3dof.cli.files import file_name, source
from p3dof.cli.kinds import Amount, Named, Whole, options
from p3dof.cli.output import print_plain
from p3dof.loops.identification.pose_files import read_poses

MEASURING = options(
    click.option(
        "--accuracy", type=Amount(LENGTH), required=True, help="Standard deviation of a measured length.",
    ),
    click.option(
        "--angle-accuracy", type=Amount(ANGLE), default="0.1 mrad", show_default=True,
        help="Standard deviation of a measured angle.",
    ),
    click.option(
        "--sigma", "sigmas", type=Named(), multiple=True,
        help="Standard deviation of a parameter about the design, 'L=50 um'; repeatable.",
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
