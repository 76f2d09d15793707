"""What the platform carries, in words: the payload of the parameter file, and that of the option."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from p3dof.cli.files import STREAM
from p3dof.cli.options import Case
from p3dof.cli.output import print_plain
from p3dof.machine.parameters import Body, Parameters


def print_payloads(console: Console, case: Case) -> None:
    """Say in one line what the platform of a case carries; nothing of an empty one."""
    say_payloads(console, case.robot.parameters, case.parameters, case.payload)


def say_payloads(console: Console, machine: Parameters, file: Path | None, given: Body | None = None) -> None:
    """Say in one line what a platform carries; nothing of an empty one.

    Parameters
    ----------
    console : rich.console.Console
        Where to print it.
    machine, file, given
        As for `payloads_in_words`.
    """
    words = payloads_in_words(machine, file, given)
    if words:
        print_plain(console, words)


def payloads_in_words(machine: Parameters, file: Path | None, given: Body | None) -> str:
    """Return every payload with its mass centre and where it comes from, and what they weigh in all.

    Parameters
    ----------
    machine : Parameters
        The machine with all that it carries.
    file : Path, optional
        The parameter file that the machine was read from.
    given : Body, optional
        What the command line adds, the last of the payloads.

    Returns
    -------
    str
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
