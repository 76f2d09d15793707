"""Which machine it is, by its options: its file, its size, its actuators, what it carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import LARGEST, SMALLEST, shown
from p3dof._base.errors import ParameterError
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MASS, STIFFNESS, Quantity
from p3dof.cli.files import STREAM, InputFile, source
from p3dof.cli.kinds import options
from p3dof.cli.output import print_plain
from p3dof.machine.parameters import SLIDES, Body, Parameters, read_parameters
from p3dof.machine.parameters.machine import require_near
from p3dof.manipulator import Manipulator, load


class BySlide(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """One number for all sliders, or three for A, B and C; units may follow each."""

    def __init__(self, quantity: Quantity, positive: bool = False) -> None:
        self._quantity, self._positive = quantity, positive
        self.name = "NUMBER[,B,C]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> dict[str, float]:
        """Return the numbers by slide."""
        parts = value.split(",")
        if len(parts) not in {1, len(SLIDES)}:
            self.fail(f"expected one number, or three for A, B and C, got {value!r}", param, ctx)
        try:
            numbers = [self._quantity.read(part, str(param.opts[0] if param else value)) for part in parts]
        except ParameterError as error:
            self.fail(str(error), param, ctx)
        least = SMALLEST if self._positive else 0.0 if self._quantity is MASS else -LARGEST
        if not all(least <= number <= LARGEST for number in numbers):
            kind = "positive" if self._positive else "finite"
            told = " from zero on" * (self._quantity is MASS)
            self.fail(f"expected {kind} numbers{told}, got {shown(value)}", param, ctx)
        return dict(zip(SLIDES, numbers * (len(SLIDES) // len(numbers)), strict=True))


class Payload(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A point mass on the platform, ``MASS`` at P or ``MASS,X,Y,Z`` in the platform's frame."""

    name = "MASS[,X,Y,Z]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Body:
        """Return the body."""
        rule = f"expected a mass [kg], or a mass and x,y,z [m], got {value!r}"
        first, *others = value.split(",")
        if len(others) not in {0, 3}:
            self.fail(rule, param, ctx)
        try:
            mass = MASS.read(first, "mass")
            com = LENGTH.read(others, "x,y,z")
        except ParameterError as error:
            self.fail(f"{rule} ({error})", param, ctx)
        try:
            return Body(mass, np.array(com or (0.0, 0.0, 0.0)), np.zeros((3, 3)))
        except ParameterError as error:
            self.fail(f"{rule} ({error})", param, ctx)


class Pose(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A pose of the platform, ``y,z,theta``, with units or in SI units."""

    name = "Y,Z,THETA"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[float]:
        """Return the pose."""
        parts = value.split(",") if isinstance(value, str) else []
        try:
            pose = [
                kind.read(part.strip(), "pose")
                for kind, part in zip((LENGTH, LENGTH, ANGLE), parts, strict=True)
            ]
            if not np.isfinite(pose).all():
                raise ValueError
        except (ParameterError, ValueError):
            self.fail(
                f"expected y,z,theta such as '0.1,0,-30 deg' or '100 mm,0,0', got {value!r}", param, ctx
            )
        return [float(number) for number in pose]


_META, _ACTUATORS = "p3dof.any_size", "p3dof.actuators."
"""Where in the context is what the machine is told."""

_PARAMETERS = click.option(
    "--parameters",
    type=InputFile(),
    help="Parameter file of the machine (YAML), - for the standard input; by default the paper's machine.",
)
_ANY_SIZE = click.option(
    "--any-size",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, value: context.meta.__setitem__(_META, value),
    help="Accept a machine larger than 20 m or smaller than 1 mm: lengths are in metres.",
)


def _of_actuators(name: str, quantity: Quantity, words: str) -> Callable[..., Any]:
    found: Callable[..., Any] = click.option(
        f"--{name}",
        type=BySlide(quantity),
        expose_value=False,
        callback=lambda context, _, value: context.meta.__setitem__(f"{_ACTUATORS}{name}", value),
        help=f"{words}: one number, or A,B,C; replaces that of the parameter file.",
    )
    return found


_ARMATURE = _of_actuators(
    "armature", MASS, "Armature, the inertia of motor and screw reflected to the sliders [kg]"
)
_BALANCE = _of_actuators("counterbalance", FORCE, "Counterbalance force on the sliders at home, upward [N]")
PARAMETERS = options(_PARAMETERS, _ARMATURE, _BALANCE, _ANY_SIZE)
"""The parameter file, and what else `machine_of` is told of the machine."""
DRIVE_STIFFNESS = click.option(
    "--drive-stiffness",
    type=BySlide(STIFFNESS, positive=True),
    help="Stiffness of each drive from motor to slider [N/m], such as '20 N/um': one number, or A,B,C.",
)
PAYLOAD = click.option(
    "--payload",
    type=Payload(),
    help="Point mass on the platform [kg], at P or at x,y,z in its frame [m]; added to the payloads of the "
    "parameter file.",
)


def any_size() -> bool:
    """Return whether the command may take machines of any size."""
    return bool(click.get_current_context().meta.get(_META, False))


def _given_actuators() -> dict[str, dict[str, float]]:
    meta = click.get_current_context().meta
    given = {name: meta.get(f"{_ACTUATORS}{name}") for name in ("armature", "counterbalance")}
    return {name: by_slide for name, by_slide in given.items() if by_slide is not None}


def driven(parameters: Parameters) -> Parameters:
    """Return a machine with the armature and the balance that the command was given."""
    return replace(parameters, actuators=replace(parameters.actuators, **_given_actuators()))


def actuator_options() -> dict[str, str]:
    """Return how armature and balance were given on the command line, by option."""
    return {
        f"--{name}": ",".join(f"{value:.15g}" for value in by_slide.values())
        for name, by_slide in _given_actuators().items()
    }


def machine_of(parameters: Path | None, payload: Body | None = None) -> Manipulator:
    """Return the machine that a command was given, of a size that the user means."""
    machine = load(None if parameters is None else read_parameters(source(parameters), any_size()))
    if _given_actuators():
        machine = load(driven(machine.parameters))
    if payload is None:
        return machine
    if not any_size():
        require_near(payload, "--payload")
    return load(machine.parameters.carrying(payload))


def say_payloads(console: Console, machine: Parameters, file: Path | None, given: Body | None = None) -> None:
    """Say in one line what a platform carries; nothing of an empty one."""
    words = payloads_in_words(machine, file, given)
    if words:
        print_plain(console, words)


def payloads_in_words(machine: Parameters, file: Path | None, given: Body | None) -> str:
    """Return every payload with its mass centre and where it comes from, and what they weigh in all.

    One line; empty if there is no payload.
    """
    if not machine.payloads:
        return ""
    sources = ["standard input" if file == STREAM else str(file)] * len(machine.payloads)
    if given is not None and given.mass > 0:
        sources[-1] = "--payload"
    parts = [
        f"{body.mass:g} kg at ({', '.join(f'{part:g}' for part in body.com)}) m ({source})"
        for body, source in zip(machine.payloads, sources, strict=True)
    ]
    mass = sum(body.mass for body in machine.payloads)
    platform, total = machine.unladen.bodies.platform.mass, machine.bodies.platform.mass
    sum_ = f" = {mass:g} kg" if len(parts) > 1 else ""
    return f"payload: {' + '.join(parts)}{sum_}; platform {platform:g} kg, with payload {total:g} kg"


def payload_text(payload: Body) -> str:
    """Return a payload as it is given on the command line."""
    com = payload.com.tolist()
    return ",".join(f"{number:.15g}" for number in (payload.mass, *(com if any(com) else ())))
