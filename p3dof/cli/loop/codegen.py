"""`p3dof loop codegen`: the dynamics of any robot as C."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
from rich.console import Console

from p3dof._base.files import check_generated, together, write_generated
from p3dof._base.tables import table_of
from p3dof.cli.export import CHECK, FORCE, WASM, print_differences
from p3dof.cli.files import OutputFolder, file_name, protect
from p3dof.cli.loop.group import loop, with_robot
from p3dof.cli.output import print_plain, show
from p3dof.codegen.loops import MARK, loop_files
from p3dof.codegen.naming import command_of, of_another
from p3dof.codegen.wasm_files import WebFiles
from p3dof.loops import ClosedLoopModel

TOLERANCE = 1e-9
"""Relative difference of numbers that ``--check`` lets pass."""


@loop.command()
@with_robot
@click.option("--out", type=OutputFolder(), required=True, help="Folder of the C.")
@click.option("--prefix", help="What all names begin with; by default made from the robot's name.")
@click.option(
    "--functions",
    help="Which functions, with commas: inverse_dynamics, forward_dynamics, hybrid_dynamics, motion, step, "
    "integrate, tangent_of_forces, tangent_of_accelerations. By default forces and accelerations, and what "
    "follows a motion of the motors (motion, step, integrate).",
)
@click.option("--external", multiple=True, metavar="FRAME", help="Frame on which a wrench can act.")
@click.option("--joint-forces", is_flag=True, help="There can be other forces in the joints.")
@click.option(
    "--inertia",
    "inertias",
    multiple=True,
    metavar="JOINT",
    help="Joint whose body has its inertial parameters as an argument, such as a payload.",
)
@WASM
@CHECK
@FORCE
def codegen(
    robot: ClosedLoopModel,
    inputs: list[Path],
    out: Path,
    prefix: str | None,
    functions: str | None,
    external: tuple[str, ...],
    joint_forces: bool,
    inertias: tuple[str, ...],
    wasm: bool,
    check: bool,
    force: bool,
) -> int:
    """Write the dynamics of a robot as C99, its loops solved, with a program that tests it."""
    chosen = None if functions is None else [name.strip() for name in functions.split(",")]
    code = loop_files(robot, prefix, chosen, external, joint_forces, inertias, _command())
    console, web = Console(), WebFiles(code.web) if wasm else None
    texts = code.files | (web.texts() if web else {})
    if check:
        differences = check_generated(texts, out, TOLERANCE) + (web.check(out) if web else [])
        if not differences:
            print_plain(console, f"{out}: up to date")
        print_differences(console, differences)
        return 1 if differences else 0
    protect(inputs, [out / name for name in (*texts, *(web.names if web else ()))])
    with together():
        written = write_generated(texts, out, MARK, force, of_another(code.web.prefix))
        written += [web.write(out, texts, force)] if web else []
    for path in written:
        print_plain(console, f"wrote {path}")
    rows = {name: [str(count)] for name, count in code.operations.items()}
    show(console, table_of("Operations of a call", ("function", "operations"), rows))
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
        "--prefix": given["prefix"],
        "--functions": given["functions"],
        "--external": given["external"],
        "--joint-forces": given["joint_forces"],
        "--inertia": given["inertias"],
    }
    name = " ".join(["p3dof loop codegen", *(shlex.quote(file) for file in files if file)])
    return command_of(name, options)
