"""The options that say which machine it is: its file, its size, its actuators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from p3dof.cli.files import InputFile, source
from p3dof.cli.kinds import BySlide
from p3dof.machine.parameters import Body, Parameters, read_parameters
from p3dof.machine.parameters.plain import require_near
from p3dof.machine.parameters.quantities import FORCE, MASS, Quantity
from p3dof.manipulator import Manipulator, load

_PARAMETERS = click.option(
    "--parameters",
    type=InputFile(),
    help="Parameter file (YAML), - for the standard input; the paper's machine without it.",
)


_ANY_SIZE = click.option(
    "--any-size",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, value: context.meta.__setitem__(_META, value),
    help="Take a machine of more than 20 m or less than 1 mm too: lengths are in metres.",
)


_META = "p3dof.any_size"


def _of_actuators(name: str, quantity: Quantity, words: str) -> Callable[..., Any]:
    found: Callable[..., Any] = click.option(
        f"--{name}",
        type=BySlide(quantity),
        expose_value=False,
        callback=lambda context, _, value: context.meta.__setitem__(f"{_ACTUATORS}{name}", value),
        help=f"{words}: one number, or A,B,C; in place of the parameter file's.",
    )
    return found


_ACTUATORS = "p3dof.actuators."


_ARMATURE = _of_actuators("armature", MASS, "Inertia of motor and screw, reflected to the sliders [kg]")


_BALANCE = _of_actuators("counterbalance", FORCE, "Force of a balance on the sliders at home, upward [N]")


def PARAMETERS(command: Callable[..., Any]) -> Callable[..., Any]:  # noqa: N802 - used as the other options are
    """Give a command the parameter file, and `machine_of` what else is said of the machine."""
    found: Callable[..., Any] = _PARAMETERS(_ARMATURE(_BALANCE(_ANY_SIZE(command))))
    return found


def any_size() -> bool:
    """Return whether the command may take machines of any size."""
    return bool(click.get_current_context().meta.get(_META, False))


def _given_actuators() -> dict[str, dict[str, float]]:
    meta = click.get_current_context().meta
    given = {name: meta.get(f"{_ACTUATORS}{name}") for name in ("armature", "counterbalance")}
    return {name: by_slide for name, by_slide in given.items() if by_slide is not None}


def driven(parameters: Parameters) -> Parameters:
    """Return a machine with the armature and the balance that the command was given.

    Parameters
    ----------
    parameters : Parameters
        The machine of a file.

    Returns
    -------
    p3dof.Parameters

    Raises
    ------
    ParameterError
        If an inertia is negative.
    """
    return replace(parameters, actuators=replace(parameters.actuators, **_given_actuators()))


def actuator_options() -> dict[str, str]:
    """Return how armature and balance were given on the command line, by option."""
    return {
        f"--{name}": ",".join(f"{value:.15g}" for value in by_slide.values())
        for name, by_slide in _given_actuators().items()
    }


def machine_of(parameters: Path | None, payload: Body | None = None) -> Manipulator:
    """Return the machine that a command was given, of a size that the user means.

    Parameters
    ----------
    parameters : Path, optional
        Its file; the paper's machine without one.
    payload : Body, optional
        Added to its platform.

    Returns
    -------
    Manipulator

    Raises
    ------
    ParameterError, FileError
        As `p3dof.load`; also if the payload is very far away.
    """
    machine = load(None if parameters is None else read_parameters(source(parameters), any_size()))
    if _given_actuators():
        machine = load(driven(machine.parameters))
    if payload is None:
        return machine
    if not any_size():
        require_near(payload, "--payload")
    return load(machine.parameters.carrying(payload))
