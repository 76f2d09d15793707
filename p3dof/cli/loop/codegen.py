"""`p3dof loop codegen`: the dynamics of any robot as C."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
from rich.console import Console

from p3dof._base.errors import InputError
from p3dof._base.tables import formatted, table_of
from p3dof.cli.files import Generated, OutputFolder, file_name, print_check, protect
from p3dof.cli.kinds import OF_CODE
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import with_robot
from p3dof.cli.output import print_plain, print_written, show
from p3dof.codegen.loops import MARK, loop_files
from p3dof.codegen.naming import command_of
from p3dof.codegen.webassembly import WebFiles
from p3dof.loops import ClosedLoopModel


@loop.command()
@with_robot
@click.option("--out", type=OutputFolder(), required=True, help="Folder to write the C code to.")
@click.option("--prefix", help="Prefix of all names and files, by default from the name of the robot.")
@click.option(
    "--functions",
    help="Functions, with commas: inverse_dynamics, forward_dynamics, hybrid_dynamics, motion, step, "
    "integrate, momentum, body_regressor, tangent_of_forces, tangent_of_accelerations. By default "
    "inverse_dynamics, forward_dynamics, motion, step and integrate; of robots with passive freedoms "
    "hybrid_dynamics instead of the last three.",
)
@click.option("--external", multiple=True, metavar="FRAME", help="Frame on which an external wrench can act.")
@click.option("--joint-forces", is_flag=True, help="Additional joint forces as an argument.")
@click.option(
    "--inertia",
    "inertias",
    multiple=True,
    metavar="JOINT",
    help="Joint of a body whose inertial parameters are an argument, as for a payload.",
)
@click.option(
    "--coordinates",
    help="Joints, with commas: functions that map their motion, forces and gains to those of the actuators "
    "behind their linkage, and back.",
)
@click.option(
    "--actuators", help="Actuators behind --coordinates, with commas; all of the linkage by default."
)
@click.option("--cuda", is_flag=True, help="Also CUDA C++: the functions at many samples.")
@click.option("--observer", is_flag=True, help="A momentum observer of contact forces.")
@click.option(
    "--payload-estimator",
    "estimator",
    is_flag=True,
    help="An estimator of the inertial parameters of the body of --inertia.",
)
@click.option("--float", "single", is_flag=True, help="Single precision, of --coordinates.")
@OF_CODE
def codegen(
    robot: ClosedLoopModel,
    inputs: list[Path],
    out: Path,
    prefix: str | None,
    functions: str | None,
    external: tuple[str, ...],
    joint_forces: bool,
    inertias: tuple[str, ...],
    coordinates: str | None,
    actuators: str | None,
    cuda: bool,
    observer: bool,
    estimator: bool,
    single: bool,
    cpu: str,
    wasm: bool,
    check: bool,
    force: bool,
) -> int:
    """Generate C99 code of the dynamics of a robot, loop closures solved, with a self-test program."""
    chosen, ends, others = (
        None if one is None else [name.strip() for name in one.split(",")]
        for one in (functions, coordinates, actuators)
    )
    if wasm and single:
        raise InputError("--wasm: JavaScript's numbers are doubles: leave --float out")
    kind, loads = "float" if single else "double", (external, joint_forces, inertias)
    extras = observer, cuda, estimator
    code = loop_files(robot, prefix, chosen, *loads, _command(), cpu, ends, others, kind, *extras)
    job = Generated.of(code.files, out, MARK, WebFiles(code.web), wasm)
    if check:
        return print_check({out: job.differences()})
    protect(inputs, job.paths)
    console = Console()
    print_written(console, job.write(force))
    rows = {name: [formatted(count, "d")] for name, count in code.operations.items()}
    show(console, table_of("Operations of a call", ("function", "operations"), rows))
    if code.left_out:
        print_plain(console, code.left_out)
    return 0


def _command() -> str:
    """Return the command that is running: names of its files, and all that changes the C."""
    given = click.get_current_context().params
    files = [file_name(given[name]) for name in ("file", "sidecar")]
    options = {
        "--floating": given["floating"],
        "--reference": given["reference"],
        "--srdf": file_name(given["srdf"]),
        "--ignore-unknown": given["ignore_unknown"],
        "--include-root": file_name(given["include_root"]),
        "--xacro-arg": given["xacro_args"],
        "--around": given["around"],
        "--prefix": given["prefix"],
        "--functions": given["functions"],
        "--external": given["external"],
        "--joint-forces": given["joint_forces"],
        "--inertia": given["inertias"],
        "--coordinates": given["coordinates"],
        "--actuators": given["actuators"],
        "--cuda": given["cuda"],
        "--observer": given["observer"],
        "--payload-estimator": given["estimator"],
        "--float": given["single"],
        "--cpu": None if given["cpu"] == "native" else given["cpu"],
    }
    name = " ".join(["p3dof loop codegen", *(shlex.quote(file) for file in files if file)])
    return command_of(name, options)
