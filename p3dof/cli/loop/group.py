"""The group of commands for any robot, and what they share: the robot, its start, warnings in one line."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, ModelWarning, ParameterError
from p3dof._base.files import read_text
from p3dof.cli.app import Command, app
from p3dof.cli.files import STREAM, InputFile, protect
from p3dof.cli.output import in_options, say
from p3dof.loops import Assembly, ClosedLoopModel, load_robot
from p3dof.loops.sidecar import suggestion
from p3dof.loops.tables import joint_values, units_of_actuated
from p3dof.machine.parameters.quantities import ANGLE, FORCE, LENGTH, MOMENT, Quantity


class _Group(click.Group):
    command_class = Command


@app.group(cls=_Group)
def loop() -> None:
    """Look at, assemble, weigh and move any robot with closed loops.

    FILE is a URDF, URDF+ or MJCF file, or the name of a robot of example-robot-data; SIDECAR a YAML file with
    its loops and actuated joints, by default the one beside FILE.
    """


class _RobotFile(InputFile):
    """A file, or the name of a robot."""

    name = "FILE"


_OPTIONS = (
    click.argument("file", type=_RobotFile()),
    click.argument("sidecar", type=InputFile(), required=False),
    click.option("--floating", is_flag=True, help="The root link of a URDF floats instead of being fixed."),
    click.option(
        "--reference",
        help="Keyframe of an MJCF, or group state of the SRDF, that says which assembly is meant.",
    ),
    click.option("--srdf", type=InputFile(), help="SRDF of a URDF, for --reference."),
    click.option(
        "--ignore-unknown", is_flag=True, help="Leave out what looks like a loop and is not understood."
    ),
)


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
        **others: Any,
    ) -> Any:
        if reference is not None and reference.lower().endswith(".csv"):
            raise InputError("--reference: expected a keyframe or group state; a motion is given by --motion")
        inputs = [path for path in (file, sidecar, srdf) if path is not None]
        protect(inputs, ())
        words = in_options({"on_unknown='ignore'": "--ignore-unknown"})
        with words, warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ModelWarning)
            robot = load_robot(
                _given(file),
                None if sidecar is None else _given(sidecar),
                root_joint=pin.JointModelFreeFlyer() if floating else None,
                reference=reference,
                srdf_file=srdf,
                on_unknown="ignore" if ignore_unknown else "raise",
            )
        for warning in caught:
            if issubclass(warning.category, ModelWarning):
                say(str(warning.message))
        return command(robot=robot, inputs=inputs, **others)

    for option in reversed(_OPTIONS):
        run = option(run)
    return run


def _given(path: Path) -> str:
    """Return a path, or the text that the standard input has."""
    return read_text(sys.stdin.buffer) + "\n" if path == STREAM else str(path)


AT = click.option(
    "--set",
    "values",
    multiple=True,
    metavar="JOINT=VALUE",
    help="Value of an actuated joint [m or rad, or with a unit: '30 deg']; those that are not set keep what "
    "they have in the reference configuration, as assembled.",
)


def assembled(robot: ClosedLoopModel, values: tuple[str, ...]) -> Assembly:
    """Return the assembly in which actuated joints have given values.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    values : tuple of str
        ``joint=value`` of each; the other actuated joints keep what they have.

    Returns
    -------
    Assembly

    Raises
    ------
    AssemblyError
        If the loops do not close there.
    InputError
        If a joint is not actuated, is set twice, or a value is none.
    """
    start = robot.assemble()
    if not values:
        return start
    held = joint_values(robot, start.q)
    target = np.array([float(held[name][0]) for name in robot.actuated])
    return robot.assemble(_set(robot, values, target, "--set", 0), start.q)


def forces_of(robot: ClosedLoopModel, values: tuple[str, ...]) -> FloatArray:
    """Return forces of the actuated joints (n_actuated,), ``joint=force`` of each, zero for the others."""
    return _set(robot, values, np.zeros(len(robot.actuated)), "--force", 1)


_QUANTITIES: dict[str, Quantity] = {"m": LENGTH, "rad": ANGLE, "N": FORCE, "N m": MOMENT}


def _set(
    robot: ClosedLoopModel, values: tuple[str, ...], into: FloatArray, option: str, unit: int
) -> FloatArray:
    """Enter ``joint=value`` of actuated joints into an array."""
    result, seen = into.copy(), set()
    for text in values:
        name, sign, value = text.rpartition("=")
        name = name.strip()
        if not sign:
            raise InputError(f"{option}: expected JOINT=VALUE, got {shown(text)}")
        if name not in robot.actuated:
            help_ = suggestion(name, robot.actuated)
            raise InputError(f"{option}: the joint {shown(name)} is not actuated; {help_}")
        if name in seen:
            raise InputError(f"{option}: the joint {shown(name)} is set twice")
        seen.add(name)
        index = robot.actuated.index(name)
        quantity = _QUANTITIES[units_of_actuated(robot)[index][unit]]
        try:
            number = quantity.read(value.strip(), f"{option} {name}")
        except ParameterError as error:
            raise InputError(str(error)) from error
        if not np.isfinite(number):
            raise InputError(f"{option} {name}: expected a finite number, got {shown(value)}")
        result[index] = number
    return result
