"""`p3dof designs` and `p3dof sweep`: the forces of many machines, from a table or block by block."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import click
from rich.console import Console

from p3dof._base.blocks import Processes, Sweep, sweep_facts, sweep_tables
from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.files import called
from p3dof.analysis.designs import DesignEvaluation
from p3dof.analysis.designs.figures import BITS
from p3dof.analysis.designs.files import (
    ROWS,
    DesignSummary,
    ResultWriter,
    count_designs,
    evaluated,
    read_designs,
    results_file,
    table_of_results,
)
from p3dof.cli.app import app
from p3dof.cli.case import Case, with_load
from p3dof.cli.files import STREAM, InputFile, OutputFile, OutputFolder, protect, save_figure, source
from p3dof.cli.kinds import Whole
from p3dof.cli.machine import any_size
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, progress_bar, show

_WORDS = {"resume=True": "--resume", "shared=False": "--local-folder", "bodies='solids'": "bodies: solids"}
"""What arguments of Python are here."""

_PATIENCE = 10.0
"""How long to wait for a cluster [s]."""

_PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")

ADDRESS = "tcp://127.0.0.1:8786"
"""What an address looks like."""


@app.command()
@click.argument("table", type=InputFile(), metavar="DESIGNS")
@with_load
@click.option("--solids", is_flag=True, help="Compute all bodies from the solids of each design.")
@click.option(
    "--compute",
    "figures",
    type=click.Choice(tuple(BITS)),
    multiple=True,
    help="Also compute this, besides forces and reach; repeatable.",
)
@click.option(
    "--gradient",
    "gradients",
    multiple=True,
    metavar="COLUMN",
    help="Column by which all results are differentiated; repeatable.",
)
@click.option("--top", type=Whole(0, 1000), default=10, help="Number of designs to list.")
@click.option("--threads", type=Whole(1, 1024), help="Number of threads; by default one a processor.")
@click.option(
    "--out",
    type=OutputFile("designs", stream=True),
    help="CSV or Parquet file to write, - for CSV on the standard output: the results of every design.",
)
def designs(
    case: Case,
    table: Path,
    solids: bool,
    figures: tuple[str, ...],
    gradients: tuple[str, ...],
    top: int,
    threads: int | None,
    out: Path | None,
) -> int:
    """Evaluate a table of designs over one motion: peak and mean forces, margins, reach.

    DESIGNS is a CSV or Parquet file with a row for each machine, or - for CSV on the standard input. Its
    columns are named as in the parameter file, with dots, and units in brackets: R [mm], rod_radius,
    platform.mass. Everything else is taken from --parameters. A design that cannot perform the motion gets a
    reason instead of numbers.

    Exit code 1 when no design can perform the motion.
    """
    protect((table, case.parameters, case.motion_file, case.wrench_file), (out,))
    machine = case.robot.parameters
    asked: Any = figures or ("singularity",)
    evaluation = DesignEvaluation(case.motion, case.wrench, asked, gradients, threads=threads)
    summary = DesignSummary(top)
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
    console = case.console(out)
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


@app.command()
@click.argument("problem", type=InputFile(), metavar="PROBLEM")
@click.option("--out", type=OutputFolder(), required=True, help="Folder to write the results to.")
@click.option("--resume", is_flag=True, help="Resume the work in the folder of --out.")
@click.option("--workers", type=Whole(1, 4096), help="Number of worker processes; by default none.")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help=f"Scheduler of a Dask cluster, such as {ADDRESS} (needs the extra 'cluster').",
)
@click.option(
    "--local-folder",
    is_flag=True,
    help="The cluster does not share the folder: results are sent back and written here.",
)
@click.option(
    "--figure",
    type=OutputFile("figure"),
    help="Figure of histograms and Pareto fronts to draw (.png, .svg or .pdf; needs the extra 'plot').",
)
@click.option("--any-size", is_flag=True, help="Accept a machine larger than 20 m or smaller than 1 mm.")
def sweep(
    problem: Path,
    out: Path,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    local_folder: bool,
    figure: Path | None,
    any_size: bool,
) -> int:
    """Run a resumable sweep: forces, or simulations, of thousands to billions of designs over one motion.

    PROBLEM is a YAML file: the motion, the ranges of lengths, masses and other variables, and the results
    to keep: best designs, Pareto fronts, histograms. With a field 'run', every machine is simulated under
    control, and initial states, gains and loads may vary too. The sweep is computed block by block; --resume
    continues one that was interrupted.
    """
    from p3dof.design.sweeps import read_sweep

    if workers is not None and scheduler is not None:
        raise click.UsageError("expected --workers or --scheduler, got both")
    if local_folder and scheduler is None:
        raise click.UsageError("--local-folder belongs to --scheduler: here, the folder is seen")
    protect((problem,), (figure,))
    with in_options(_WORDS):
        plan = read_sweep(problem, any_size)
        if figure is not None:
            from p3dof.report.plots.designs import require_panels

            with in_options({"sweep: ": "--figure: "}):
                require_panels(plan.options.get("reductions", ()))
        with _client(workers, scheduler) as client, progress_bar("items", plan.problem.count) as progress:
            made = plan.run(out, client=client, resume=resume, shared=not local_folder, progress=progress)
    _tell(made, figure)
    return 0


@contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Give who computes, and leave it in the end."""
    if workers is not None:
        with Processes(workers) as processes:
            yield processes
    elif scheduler is not None:
        try:
            from distributed import Client
        except ImportError as error:
            raise MissingExtraError("--scheduler needs Dask: pip install 'p3dof[cluster]'") from error
        _require_reachable(scheduler)
        connect: Any = Client
        try:
            client = connect(scheduler, set_as_default=False, timeout=_PATIENCE)
        except (OSError, ValueError) as error:
            raise _unreachable(scheduler, error) from error
        with client:
            yield client
    else:
        yield None


def _require_reachable(address: str) -> None:
    """Raise if nobody listens there: Dask would wait for a minute, and complain for long."""
    protocol, found, place = address.rpartition("://")
    host, _, port = place.rpartition(":")
    if (found and protocol not in _PROTOCOLS) or not host or not port.isdecimal():
        raise _unreachable(address, ValueError("no host and port"))
    try:
        socket.create_connection((host.strip("[]"), int(port)), _PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise _unreachable(address, error) from error


def _unreachable(address: str, error: Exception) -> InputError:
    reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return InputError(
        f"--scheduler: {address}: cannot be reached ({reason}); expected an address such as {ADDRESS}"
    )


def _tell(made: Sweep, figure: Path | None) -> None:
    console = Console()
    print_plain(console, sweep_facts(made))
    show(console, *sweep_tables(made), notes=True)
    print_warnings(console, made.notes)
    print_written(console, save_figure(lambda plots: plots.sweep_figure(made), figure))
    print_plain(console, _told(made))


def _told(made: Sweep) -> str:
    """Return what was done."""
    folder, blocks = os.path.relpath(made.folder), made.manifest.blocks
    if not made.computed:
        return f"nothing was missing: all {blocks} blocks were in {folder}"
    if made.computed < blocks:
        return f"computed {made.computed} of {blocks} blocks, those that were missing, in {folder}"
    return f"wrote {folder}"
