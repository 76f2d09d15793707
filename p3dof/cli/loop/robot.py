"""`p3dof loop info`, `assemble`; what all commands for any robot share: the robot, its start, loads."""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
import pinocchio as pin
import yaml
from rich.console import Console

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import AssemblyError, InputError, ParameterError
from p3dof._base.files import read_text, write_atomic, write_table
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MOMENT, Quantity
from p3dof._base.time_series.wrenches import WrenchHistory
from p3dof.cli.app import FAILED
from p3dof.cli.files import STREAM, InputFile, InputFolder, OutputFile, console_beside, protect, write_results
from p3dof.cli.kinds import options
from p3dof.cli.loop import loop
from p3dof.cli.output import in_options, print_warnings, print_written, say, show
from p3dof.loops import Assembly, ClosedLoopModel, load_robot
from p3dof.loops.compiled.kept import ROBOT_METHODS
from p3dof.loops.robots import named_file
from p3dof.loops.sidecar import suggestion
from p3dof.loops.tables import (
    assembly_table,
    bushings_table,
    closures_table,
    doubtful_bodies,
    doubts,
    facts_table,
    is_slide,
    joint_values,
    joints_table,
    overview,
    units_of_actuated,
)
from p3dof.loops.xml_text import Macros

if TYPE_CHECKING:
    from p3dof.viewer.document.figure import RobotFigure

_ROBOT = options(
    click.argument("file", type=InputFile()),
    click.argument("sidecar", type=InputFile(), required=False),
    click.option("--floating", is_flag=True, help="Floating base: the root link of a URDF is free."),
    click.option(
        "--reference",
        help="Reference configuration that selects the assembly mode: a keyframe of an MJCF, or a group "
        "state of the SRDF.",
    ),
    click.option("--srdf", type=InputFile(), help="SRDF file of a URDF, for --reference."),
    click.option(
        "--ignore-unknown", is_flag=True, help="Ignore elements of a URDF or SDF that are not understood."
    ),
    click.option(
        "--include-root",
        type=InputFolder(),
        help="Folder below which an MJCF or SDF may include files, that of model:// too; its own by default.",
    ),
    click.option(
        "--xacro-arg",
        "xacro_args",
        multiple=True,
        metavar="NAME:=VALUE",
        help="Argument of a .xacro file, whose macros the program xacro expands.",
    ),
    click.option(
        "--around",
        multiple=True,
        metavar="JOINT=VALUE,...",
        help="Positions of joints [m or rad, or with a unit: '30 deg'] at which the loops are closed: the "
        "reference configuration, from which all else starts.",
    ),
)


_OPTIONS = {
    "on_unknown='ignore'": "--ignore-unknown",
    "include_root=": "--include-root ",
    "include_root:": "--include-root:",
    "xacro_args:": "--xacro-arg:",
}
"""What the arguments of `load_robot` are called here."""


def with_robot(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the robot, `robot`, and the files it comes from, `inputs`."""

    @functools.wraps(command)
    def run(
        file: Path,
        sidecar: Path | None,
        floating: bool,
        reference: str | None,
        srdf: Path | None,
        ignore_unknown: bool,
        include_root: Path | None,
        xacro_args: tuple[str, ...],
        around: tuple[str, ...],
        **others: Any,
    ) -> Any:
        if reference is not None and reference.lower().endswith(".csv"):
            raise InputError("--reference: expected a keyframe or group state; a motion is given by --motion")
        file = Path(named_file(str(file)))
        inputs = [path for path in (file, sidecar, srdf) if path is not None]
        protect(inputs, ())
        with in_options(_OPTIONS):
            robot = load_robot(
                _given(file),
                None if sidecar is None else _given(sidecar),
                root_joint=pin.JointModelFreeFlyer() if floating else None,
                reference=reference,
                srdf_file=srdf,
                on_unknown="ignore" if ignore_unknown else "raise",
                include_root=include_root,
                xacro_args=_arguments(xacro_args),
            )
        return command(robot=_around(robot, around), inputs=inputs, **others)

    found: Callable[..., Any] = _ROBOT(run)
    return found


def _arguments(texts: tuple[str, ...]) -> dict[str, str]:
    """Return the arguments of xacro."""
    found: dict[str, str] = {}
    for text in texts:
        name, sign, value = text.partition(":=")
        if not sign or name in found:
            wanted = "each name once" if sign else "NAME:=VALUE"
            raise InputError(f"--xacro-arg: expected {wanted}, got {shown(text)}")
        found[name] = value
    return found


def figure_of(robot: ClosedLoopModel, path: Path | None, package_dirs: Iterable[Path]) -> RobotFigure:
    """Return a robot with the shapes of a file; rods alone without one, or for a stream, which is gone."""
    from p3dof.viewer.document.figure import RobotFigure

    given = click.get_current_context().params
    source = None if path in (None, STREAM) else str(path)
    if source is not None and source.lower().endswith(Macros.SUFFIX):
        return RobotFigure(robot, Macros(source, _arguments(given["xacro_args"])), package_dirs)
    root = given["include_root"]
    return RobotFigure(robot, source, [*package_dirs, *([] if root is None else [root])])


def _around(robot: ClosedLoopModel, texts: tuple[str, ...]) -> ClosedLoopModel:
    """Return the robot with the reference configuration that ``--around`` says."""
    if not texts:
        return robot
    model, kinds = robot.model, {}
    for joint in range(1, model.njoints):
        if model.nvs[joint] == 1:
            kinds[str(model.names[joint])] = LENGTH if is_slide(robot, joint) else ANGLE
    each = [part for text in texts for part in re.split(r",(?=[^,]*=)", text)]  # commas before a name
    refusal = "there is no joint {} with one degree of freedom"
    values = _entered(each, kinds, "--around", refusal)
    with in_options({"around: ": "--around: "}):
        return robot.around(values)


def _given(path: Path) -> str:
    """Return a path, or the text that the standard input has."""
    return read_text(sys.stdin.buffer) + "\n" if path == STREAM else str(path)


METHOD = click.option(
    "--method",
    type=click.Choice(list(ROBOT_METHODS)),
    default="general",
    help="Dynamics by Pinocchio, or by C code compiled for the robot (needs gcc or clang).",
)
EXTERNAL = click.option(
    "--external",
    "external",
    multiple=True,
    metavar="FRAME=FX,FY,FZ[,MX,MY,MZ]",
    help="External wrench on a frame, at its origin in world axes [N, N m, or with units]; or FRAME=FILE "
    "over time (CSV: t,fx,fy,fz,mx,my,mz).",
)


def force_option(when: str = "") -> Callable[..., Any]:
    """Return the option for constant forces of actuated joints, as of `forces_of`."""
    words = f"{when}constant force of an actuated joint [N or N m, or with a unit]; none without it."
    return click.option(
        "--actuator-force", "forces", multiple=True, metavar="JOINT=FORCE", help=words[0].upper() + words[1:]
    )


AT = click.option(
    "--set",
    "values",
    multiple=True,
    metavar="JOINT=VALUE",
    help="Position of an actuated joint [m or rad, or with a unit: '30 deg']; the others keep that of the "
    "reference configuration.",
)


def assembled(robot: ClosedLoopModel, values: tuple[str, ...]) -> Assembly:
    """Return the assembly in which actuated joints have given values."""
    start = robot.assemble()
    if not values:
        return start
    held = joint_values(robot, start.q)
    target = np.array([float(held[name][0]) for name in robot.actuated])
    return robot.assemble(_set(robot, values, target, "--set", 0), start.q)


def forces_of(robot: ClosedLoopModel, values: tuple[str, ...]) -> FloatArray:
    """Return forces of the actuated joints (n_actuated,), ``joint=force`` of each, zero for the others."""
    return _set(robot, values, np.zeros(len(robot.actuated)), "--actuator-force", 1)


_QUANTITIES: dict[str, Quantity] = {"m": LENGTH, "rad": ANGLE, "N": FORCE, "N m": MOMENT}


def _set(
    robot: ClosedLoopModel, values: tuple[str, ...], into: FloatArray, option: str, unit: int
) -> FloatArray:
    """Enter ``joint=value`` of actuated joints into an array."""
    units = [_QUANTITIES[each[unit]] for each in units_of_actuated(robot)]
    kinds = dict(zip(robot.actuated, units, strict=True))
    given = _entered(values, kinds, option, "the joint {} is not actuated")
    return np.array([given.get(name, old) for name, old in zip(robot.actuated, into, strict=True)])


def _entered(
    texts: Iterable[str], kinds: Mapping[str, Quantity], option: str, refusal: str
) -> dict[str, float]:
    """Return the numbers of ``joint=value``, by joint."""
    result: dict[str, float] = {}
    for text in texts:
        name, sign, value = text.rpartition("=")
        name = name.strip()
        if not sign:
            raise InputError(f"{option}: expected JOINT=VALUE, got {shown(text)}")
        if name not in kinds:
            raise InputError(f"{option}: {refusal.format(shown(name))}; {suggestion(name, kinds)}")
        if name in result:
            raise InputError(f"{option}: the joint {shown(name)} is set twice")
        quantity = kinds[name]
        try:
            number = quantity.read(value.strip(), f"{option} {name}")
        except ParameterError as error:
            raise InputError(str(error)) from error
        if not np.isfinite(number):
            raise InputError(f"{option} {name}: expected a finite number, got {shown(value)}")
        if quantity is ANGLE and abs(number) > 2 * np.pi and not value.strip(" .+-eE0123456789"):
            say(f"{option} {name}: {number:g} rad is more than a turn (degrees? then write '{number:g} deg')")
        result[name] = number
    return result


def externals(texts: tuple[str, ...]) -> dict[str, FloatArray | WrenchHistory]:
    """Return the wrenches on frames that `EXTERNAL` names."""
    found: dict[str, FloatArray | WrenchHistory] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        name = name.strip()
        if not sign or not name:
            raise InputError(f"--external: expected FRAME=FX,FY,FZ or with MX,MY,MZ, got {shown(text)}")
        if name in found:
            raise InputError(f"--external: the frame {shown(name)} is named twice")
        if value.strip().lower().endswith(".csv"):
            path = Path(value.strip())
            protect([path], ())
            found[name] = WrenchHistory.from_csv(path)
            continue
        numbers = numbers_of(f"--external {name}", value, FORCE, MOMENT)
        if len(numbers) not in (3, 6):
            raise InputError(f"--external {name}: expected three or six numbers, got {len(numbers)}")
        found[name] = np.array([*numbers, 0.0, 0.0, 0.0][:6])
    return found


def exceeded(found: Sequence[object]) -> list[str]:
    """Return what is said of limits that are exceeded: the first ones."""
    more = [f"{len(found) - 8} more limits are exceeded"] if len(found) > 8 else []
    return [*(f"limit exceeded: {one}" for one in found[:8]), *more]


def numbers_of(option: str, text: str, *kinds: Quantity) -> FloatArray:
    """Return the numbers between commas, in SI units: three of each kind, or without units."""
    parts: list[Any] = text.split(",")
    try:
        for i, kind in enumerate([kind for kind in kinds for _ in range(3)][: len(parts)]):
            parts[i] = kind.read(parts[i].strip(), option)
        found = np.array([float(part) for part in parts])
    except ParameterError as error:
        raise InputError(str(error)) from error
    except ValueError as error:
        raise InputError(f"{option}: expected numbers with commas, got {shown(text)}") from error
    if not np.isfinite(found).all():
        raise InputError(f"{option}: expected finite numbers, got {shown(text)}")
    return found


@loop.command()
@with_robot
@click.option("--list-joints/--no-list-joints", "listed", default=True, help="List all joints.")
def info(robot: ClosedLoopModel, inputs: list[Path], listed: bool) -> int:
    """Show the structure of a robot: joints, loop closures, mobility, and what stays indeterminate.

    Exit code 1 when its loops do not close.
    """
    del inputs
    console = Console()
    problem, seen, gap, told = "", None, float("nan"), []
    try:
        assembly = robot.assemble()
    except AssemblyError as error:
        problem, gap = str(error), error.gap
    else:
        seen, gap = overview(robot, robot.regular_configuration), assembly.gap
        told = doubts(robot, seen)
    tables = [facts_table(robot, seen, gap)]
    if listed:
        tables.append(joints_table(robot, seen))
    if robot.constraint_rows:
        tables.append(closures_table(robot, seen))
    if robot.sidecar.bushings:
        tables.append(bushings_table(robot))
    show(console, *tables)
    print_warnings(console, [*([problem] if problem else told), *doubtful_bodies(robot)])
    return FAILED if problem else 0


@loop.command()
@with_robot
@AT
@click.option(
    "--out",
    type=OutputFile("joints"),
    help="File to write the positions of all joints to: .csv, or .yaml in the form of 'reference' of the "
    "sidecar; - for CSV on the standard output.",
)
def assemble(robot: ClosedLoopModel, inputs: list[Path], values: tuple[str, ...], out: Path | None) -> int:
    """Close the loops at given positions of the actuated joints, and list all joints.

    Exit code 1 when the loops do not close there.
    """
    protect(inputs, [out])
    assembly = assembled(robot, values)
    found = joint_values(robot, assembly.q)

    def save(path: Path) -> Path:
        if path.suffix.lower() == ".csv":
            names = [
                name if len(row) == 1 else f"{name}.{i}"
                for name, row in found.items()
                for i in range(len(row))
            ]
            return write_table(path, names, tuple(np.array([x]) for row in found.values() for x in row))
        plain = {
            name: [float(x) for x in row] if len(row) > 1 else float(row[0]) for name, row in found.items()
        }
        return write_atomic(path, yaml.safe_dump({"reference": plain}, sort_keys=False, allow_unicode=True))

    written = write_results(save, out)
    console = console_beside(out)
    show(console, assembly_table(robot, assembly), notes=True)
    print_written(console, written)
    return 0
