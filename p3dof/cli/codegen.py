"""`p3dof codegen`: C for a controller, and the package's own kernels."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof._base.files import check_generated, together, write_generated
from p3dof._base.tables import Table, table_of
from p3dof.cli.app import app
from p3dof.cli.export import CHECK, FORCE, WASM, print_differences
from p3dof.cli.files import OutputFolder, file_name, protect
from p3dof.cli.kinds import Payload, payload_text
from p3dof.cli.machine import PARAMETERS, actuator_options, machine_of
from p3dof.cli.output import print_plain, show
from p3dof.cli.payloads import say_payloads
from p3dof.closed_form.compiled.formulas import NAMES, kernel
from p3dof.codegen.batch import DIRECTORY, batch_files
from p3dof.codegen.controller import MARK, controller_files, origin_of
from p3dof.codegen.lanes import lane_files
from p3dof.codegen.naming import PREFIX, checked_prefix, command_of, of_another
from p3dof.codegen.page_wasm import DIRECTORY as PAGE
from p3dof.codegen.page_wasm import page_wasm
from p3dof.codegen.printing import operation_counts
from p3dof.codegen.wasm_files import WebFiles
from p3dof.codegen.web_controller import controller_module
from p3dof.machine.parameters import Body, Parameters

TOLERANCE = 1e-9
"""Relative difference of numbers that ``--check`` lets pass in the files of a controller: a change of the
parameters that matters is more, other last bits on another processor are less."""


@app.command()
@PARAMETERS
@click.option(
    "--payload",
    type=Payload(),
    help="Point mass on the platform [kg], at P or at x,y,z in its frame [m]; besides the payload of the "
    "parameter file.",
)
@click.option("--out", type=OutputFolder(), help="Folder of the C for a controller.")
@click.option(
    "--bake", is_flag=True, help="Put the machine's numbers into the code: smaller, not to be changed."
)
@click.option(
    "--float",
    "single",
    is_flag=True,
    help="Compute with floats instead of doubles: for processors without double precision.",
)
@click.option(
    "--prefix",
    help="What all names and files of the C for a controller begin with, p3dof without it; two machines in "
    "one program need two.",
)
@click.option("--kernels", is_flag=True, help="The package's own kernels, where they are in the package.")
@click.option("--page", is_flag=True, help="The WebAssembly of the page, where it is in the package.")
@WASM
@CHECK
@FORCE
def codegen(
    parameters: Path | None,
    payload: Body | None,
    out: Path | None,
    bake: bool,
    single: bool,
    prefix: str | None,
    kernels: bool,
    page: bool,
    wasm: bool,
    check: bool,
    force: bool,
) -> int:
    """Write C99 for a controller: kinematics, dynamics and derivatives, with a program that tests it."""
    drives = actuator_options()
    of_controller = (parameters, payload, bake or None, single or None, wasm or None, prefix, drives or None)
    _check_usage(out, kernels, page, any(value is not None for value in of_controller))
    if single and wasm:
        raise click.UsageError("--float: WebAssembly computes with doubles, leave out --wasm")
    if page:
        return _page(check, force)
    jobs: list[tuple[dict[str, str], Path, float]] = []
    tables = []
    web = None
    if out is not None:
        machine = machine_of(parameters, payload).parameters
        given = {"--parameters": file_name(parameters), "--payload": payload and payload_text(payload)}
        given |= drives
        command = command_of(
            "p3dof codegen", {**given, "--prefix": prefix, "--bake": bake, "--float": single}
        )
        name = PREFIX if prefix is None else checked_prefix(prefix)
        if wasm:
            web = WebFiles(controller_module(bake, name, origin_of(machine, bake, name, command)))
        texts = controller_files(machine, bake, name, command, "float" if single else "double")
        texts |= web.texts() if web else {}
        jobs.append((texts, out, TOLERANCE))
        tables.append(_function_table(machine))
    if kernels:
        jobs.append((batch_files() | lane_files(), DIRECTORY, 0.0))
        tables.append(_kernel_table())
    if check:
        return _check(jobs, web)
    outputs = [folder / name for texts, folder, _ in jobs for name in texts]
    if web and out:
        outputs += [out / name for name in web.names]
    protect((parameters,), outputs)
    console = Console()
    if out is not None:
        say_payloads(console, machine, parameters, payload)
    with together():
        foreign = of_another(name if out is not None else PREFIX)
        written = [
            path for texts, folder, _ in jobs for path in write_generated(texts, folder, MARK, force, foreign)
        ]
        if web and out:
            written.append(web.write(out, jobs[0][0], force))
    for path in written:
        print_plain(console, f"wrote {path}")
    show(console, *tables)
    return 0


def _check_usage(out: Path | None, kernels: bool, page: bool, of_controller: bool) -> None:
    """Raise UsageError for options that do not go together."""
    if kernels and not DIRECTORY.is_dir():
        raise click.UsageError(
            "--kernels: the C of the kernels is in the source tree, not where it is installed"
        )
    if page and (out is not None or kernels):
        raise click.UsageError("--page has a place of its own: leave --out and --kernels out")
    if out is None and not (kernels or page):
        raise click.UsageError("expected --out (C for a controller), --kernels (the package's own) or --page")
    if out is None and of_controller:
        raise click.UsageError(
            "--parameters, --payload, --armature, --counterbalance, --bake, --float, --prefix and --wasm "
            "belong to --out"
        )


def _page(check: bool, force: bool) -> int:
    """Write the WebAssembly of the page, or compare it."""
    console = Console()
    web, texts = page_wasm()
    if not check:
        print_plain(console, f"wrote {web.write(PAGE, texts, force)}")
        return 0
    differences = web.compare(PAGE, *texts.values())
    if not differences:
        print_plain(console, f"{PAGE / web.names[0]}: up to date")
    print_differences(console, differences)
    return 1 if differences else 0


def _check(jobs: list[tuple[dict[str, str], Path, float]], web: WebFiles | None) -> int:
    console, differences = Console(), []
    for i, (texts, folder, tolerance) in enumerate(jobs):
        found = check_generated(texts, folder, tolerance) + (web.check(folder) if web and i == 0 else [])
        differences += found
        if not found:
            print_plain(console, f"{folder}: up to date")
    print_differences(console, differences)
    return 1 if differences else 0


def _function_table(machine: Parameters) -> Table:
    rows = {
        count.name: (str(count.general), str(count.symmetric), f"+{count.friction}", str(count.machine))
        for count in operation_counts(machine)
    }
    title = "Operations of a call: any machine, a symmetric one, more for friction, this one baked"
    return table_of(title, ("function", "general", "symmetric", "friction", "baked"), rows)


def _kernel_table() -> Table:
    rows = {
        name: [str(sum(kernel(name, symmetric).operations().values())) for symmetric in (False, True)]
        for name in NAMES
    }
    return table_of("Operations of a sample, beside the margin", ("kernel", "general", "symmetric"), rows)
