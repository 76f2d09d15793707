"""`p3dof codegen`: C for a controller, and the package's own kernels."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof._base.files import together
from p3dof._base.tables import Table, formatted, number, table_of
from p3dof.cli.app import app
from p3dof.cli.files import Generated, OutputFolder, file_name, print_check, protect
from p3dof.cli.kinds import OF_CODE
from p3dof.cli.machine import PARAMETERS, PAYLOAD, actuator_options, machine_of, payload_text, say_payloads
from p3dof.cli.output import print_plain, print_written, show
from p3dof.closed_form.compiled.formulas import NAMES, kernel
from p3dof.codegen.batch import DIRECTORY, batch_files, lane_files
from p3dof.codegen.controller import MARK, controller_files, origin_of
from p3dof.codegen.gpu import cuda_files
from p3dof.codegen.naming import PREFIX, checked_prefix, command_of
from p3dof.codegen.printing import operation_counts
from p3dof.codegen.web_controller import DIRECTORY as PAGE
from p3dof.codegen.web_controller import controller_module, page_wasm
from p3dof.codegen.webassembly import WebFiles
from p3dof.machine.parameters import Body, Parameters


@app.command()
@PARAMETERS
@PAYLOAD
@click.option("--out", type=OutputFolder(), help="Folder to write the C code to.")
@click.option(
    "--bake", is_flag=True, help="Make the parameters of the machine constants: smaller code, fixed machine."
)
@click.option(
    "--float", "single", is_flag=True, help="Single precision, for processors without double precision."
)
@click.option(
    "--prefix", help="Prefix of all names and files, by default p3dof; two machines in one program need two."
)
@click.option("--cuda", is_flag=True, help="Also CUDA C++: forces of many samples and designs.")
@click.option("--kernels", is_flag=True, help="For developers: the kernels of the package, in their place.")
@click.option(
    "--page", "page", is_flag=True, help="For developers: the WebAssembly of the page, in its place."
)
@OF_CODE
def codegen(
    parameters: Path | None,
    payload: Body | None,
    out: Path | None,
    bake: bool,
    single: bool,
    prefix: str | None,
    cuda: bool,
    kernels: bool,
    page: bool,
    cpu: str,
    wasm: bool,
    check: bool,
    force: bool,
) -> int:
    """Generate C99 code for a controller: kinematics, dynamics, derivatives, and a self-test program."""
    given = {"--parameters": file_name(parameters), "--payload": payload and payload_text(payload)}
    given |= actuator_options()
    own = (*given.values(), bake or None, single or None, wasm or None, cuda or None, prefix)
    _check_usage(out, kernels, page, any(value is not None for value in own))
    if single and wasm:
        raise click.UsageError("--float: WebAssembly computes with doubles, leave out --wasm")
    if single and cuda:
        raise click.UsageError("--float: CUDA C++ computes with doubles, leave out --cuda")
    if page:
        return _page(check, force)
    jobs, tables = [], []
    if out is not None:
        machine = machine_of(parameters, payload).parameters
        options = {
            **given,
            "--prefix": prefix,
            "--bake": bake,
            "--float": single,
            "--cuda": cuda,
            "--cpu": None if cpu == "native" else cpu,
        }
        name = PREFIX if prefix is None else checked_prefix(prefix)
        settings = machine, bake, name, command_of("p3dof codegen", options)
        texts = controller_files(*settings, "float" if single else "double", cpu)
        if cuda:
            texts |= cuda_files(*settings)
        web = WebFiles(controller_module(bake, name, origin_of(*settings)))
        jobs.append(Generated.of(texts, out, MARK, web, wasm))
        tables.append(_function_table(machine))
    if kernels:
        jobs.append(Generated(batch_files() | lane_files(), DIRECTORY, PREFIX, MARK, tolerance=0.0))
        tables.append(_kernel_table())
    if check:
        return print_check({job.folder: job.differences() for job in jobs})
    protect((parameters,), [path for job in jobs for path in job.paths])
    console = Console()
    if out is not None:
        say_payloads(console, machine, parameters, payload)
    with together():
        written = [path for job in jobs for path in job.write(force)]
    print_written(console, written)
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
            "--parameters, --payload, --armature, --counterbalance, --bake, --float, --prefix, --cuda and "
            "--wasm belong to --out"
        )


def _page(check: bool, force: bool) -> int:
    """Write the WebAssembly of the page, or compare it."""
    web, texts = page_wasm()
    if check:
        return print_check({PAGE / web.names[0]: web.compare(PAGE, *texts.values())})
    print_plain(Console(), f"wrote {web.write(PAGE, texts, force)}")
    return 0


def _function_table(machine: Parameters) -> Table:
    rows = {}
    for one in operation_counts(machine):
        sizes = number(one.general), number(one.symmetric), formatted(one.friction, "+d"), number(one.machine)
        rows[one.name] = sizes
    title = (
        "Operations of a call: any machine, a symmetric one, more for friction, this one baked; "
        "a sine or a tanh counts as one, though it takes as long as dozens"
    )
    return table_of(title, ("function", "general", "symmetric", "friction", "baked"), rows)


def _kernel_table() -> Table:
    rows = {
        name: [number(sum(kernel(name, symmetric).operations().values())) for symmetric in (False, True)]
        for name in NAMES
    }
    return table_of("Operations of a sample, beside the margin", ("kernel", "general", "symmetric"), rows)
