"""Options that several commands share, and what reads them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from p3dof.motion import Motion, paper_motion

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


def protect(inputs: Iterable[Path | None], outputs: Iterable[Path | None]) -> None:
    """Refuse to write over a file that is read in the same command, or twice to one file."""
    used = {path.resolve() for path in inputs if path is not None}
    for path in outputs:
        if path is not None and path.resolve() in used:
            raise click.UsageError(f"{path} would be overwritten: it is already used by this command")


def read_motion(path: Path | None, samples: int | None) -> Motion:
    """Return the motion of a file, or the paper's with so many samples."""
    if path is None:
        return paper_motion(1001 if samples is None else samples)
    if samples is not None:
        raise click.UsageError("--samples belongs to the paper's motion, and --motion gives another one")
    return Motion.from_csv(path)
