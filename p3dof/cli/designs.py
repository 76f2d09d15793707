"""`p3dof designs`: the forces of many machines over one motion, from a table to a table."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import click

from p3dof._base.files import called
from p3dof.analysis.designs import DesignEvaluation
from p3dof.analysis.designs.figures import BITS
from p3dof.analysis.designs.files import ResultWriter, count_designs, read_designs, results_file
from p3dof.analysis.designs.stream import ROWS, DesignSummary, evaluated, table_of_results
from p3dof.cli.app import app
from p3dof.cli.files import STREAM, InputFile, OutputFile, console_beside, protect, source
from p3dof.cli.kinds import Whole
from p3dof.cli.machine import any_size
from p3dof.cli.options import Case, with_load
from p3dof.cli.output import in_options, print_plain, progress_bar, show
from p3dof.cli.payloads import print_payloads


@app.command()
@click.argument("table", type=InputFile(), metavar="DESIGNS")
@with_load
@click.option("--solids", is_flag=True, help="Compute all bodies from the solids of each design.")
@click.option(
    "--figures",
    type=click.Choice(tuple(BITS)),
    multiple=True,
    help="What to compute beside forces and reach; several times for more.",
)
@click.option(
    "--gradient",
    "gradients",
    multiple=True,
    metavar="COLUMN",
    help="Column to differentiate all figures by; several times for more.",
)
@click.option("--best", type=Whole(0, 1000), default=10, show_default=True, help="How many to show.")
@click.option("--threads", type=Whole(1, 1024), help="Most threads; all processors without it.")
@click.option(
    "--out",
    type=OutputFile("designs", stream=True),
    help="CSV or Parquet file for the figures of every design, - for CSV on the standard output.",
)
def designs(
    case: Case,
    table: Path,
    solids: bool,
    figures: tuple[str, ...],
    gradients: tuple[str, ...],
    best: int,
    threads: int | None,
    out: Path | None,
) -> int:
    """Compute peaks, means and margins of the forces of many machines over one motion.

    DESIGNS is a CSV or Parquet file with a row for each machine, or - for CSV on the standard input. Its
    columns have the names of the parameter file, with dots, and units in brackets: R [mm], rod_radius,
    platform.mass. All else is that of --parameters. Designs that cannot make the motion have a reason
    instead of numbers.

    Exit code 1 when no design can make the motion.
    """
    protect((table, case.parameters, case.motion_file, case.wrench_file), (out,))
    machine = case.robot.parameters
    asked: Any = figures or ("singularity",)
    evaluation = DesignEvaluation(case.motion, case.wrench, asked, gradients, threads=threads)
    summary = DesignSummary(best)
    name, given = called(source(table)), source(table)
    bodies: Any = "solids" if solids else "kept"
    found = evaluated(read_designs(given, ROWS), evaluation, machine, bodies, name, any_size())
    with in_options({"bodies='solids'": "--solids"}), ExitStack() as stack:
        writer = _writer(stack, out)
        total = count_designs(given)
        progress = stack.enter_context(progress_bar("designs", total or 0)) if total else None
        for rows, results in found:
            summary.add(rows, results)
            if writer is not None:
                writer.write(table_of_results(rows, results))
            if progress is not None:
                progress(summary.count, max(summary.count, total or 0))
    console = console_beside(out)
    print_payloads(console, case)
    show(console, *summary.tables())
    if out is not None and out != STREAM:
        print_plain(console, f"wrote {out}")
    return 0 if summary.feasible else 1


def _writer(stack: ExitStack, out: Path | None) -> ResultWriter | None:
    if out is None:
        return None
    if out != STREAM:
        return stack.enter_context(results_file(out))
    stdout: Any = sys.stdout
    stream: Any = getattr(stdout, "buffer", None) or _Bytes(stdout)
    return ResultWriter(stream, parquet=False)


class _Bytes:
    """A stream of bytes to one of text, which has none beneath it."""

    def __init__(self, text: IO[str]) -> None:
        self._text = text

    def write(self, data: bytes) -> int:
        return self._text.write(data.decode())
