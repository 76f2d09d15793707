"""`p3dof sweep`: the forces of any number of machines, block by block, here or on a cluster."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from p3dof._base.blocks import Processes, Sweep, sweep_facts, sweep_tables
from p3dof._base.errors import InputError, MissingExtraError
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, OutputFolder, protect
from p3dof.cli.kinds import Whole
from p3dof.cli.output import in_options, print_plain, print_warnings, progress_bar, show
from p3dof.design.sweeps import read_sweep

_OPTIONS = {
    "resume=True": "--resume",
    "shared=False": "--local-folder",
    "bodies='solids'": "bodies: solids",
}
"""What arguments of Python are here."""

_PATIENCE = 10.0
"""How long to wait for a cluster [s]."""

_PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")

ADDRESS = "tcp://127.0.0.1:8786"
"""What an address looks like."""


@app.command()
@click.argument("problem", type=InputFile(), metavar="PROBLEM")
@click.option("--out", type=OutputFolder(), required=True, help="Folder for the results.")
@click.option("--resume", is_flag=True, help="Go on with the sweep that is in the folder.")
@click.option("--workers", type=Whole(1, 4096), help="Worker processes on this machine; this one without it.")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help=f"Cluster of Dask that computes, such as {ADDRESS} (needs the extra 'cluster').",
)
@click.option(
    "--local-folder",
    is_flag=True,
    help="The cluster does not see the folder: results come back to be written here.",
)
@click.option(
    "--figure",
    type=OutputFile("figure"),
    help="Figure of histograms and Pareto fronts to draw (.png, .svg or .pdf; needs the extra 'plot').",
)
@click.option("--any-size", is_flag=True, help="Take a machine of more than 20 m or less than 1 mm too.")
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
    """Compute the forces of thousands to billions of machines over one motion, or their runs in time.

    PROBLEM is a YAML file: the motion, the ranges of lengths, masses and all else that differs between
    machines, and what to find: the best ones, Pareto fronts, histograms. With a field 'run', machines follow
    the motion under a controller, and starts, gains and loads may differ too. All is computed block by block;
    a sweep that was interrupted goes on with --resume.
    """
    if workers is not None and scheduler is not None:
        raise click.UsageError("expected --workers or --scheduler, got both")
    if local_folder and scheduler is None:
        raise click.UsageError("--local-folder belongs to --scheduler: here, the folder is seen")
    protect((problem,), (figure,))
    with in_options(_OPTIONS):
        plan = read_sweep(problem, any_size)
        if figure is not None:
            from p3dof.report.plots.sweep import require_panels

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
    if figure is not None:
        from p3dof.report import plots

        print_plain(console, f"wrote {plots.save(plots.sweep_figure(made), figure)}")
    print_plain(console, _told(made))


def _told(made: Sweep) -> str:
    """Return what was done."""
    folder, blocks = os.path.relpath(made.folder), made.manifest.blocks
    if not made.computed:
        return f"nothing was missing: all {blocks} blocks were in {folder}"
    if made.computed < blocks:
        return f"computed {made.computed} of {blocks} blocks, those that were missing, in {folder}"
    return f"wrote {folder}"
