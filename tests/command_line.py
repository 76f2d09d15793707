"""The command line as a user calls it, in this process."""

from __future__ import annotations

import click

from p3dof.cli import main
from p3dof.cli.app import app


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def commands(group=app, path=()):
    """Every command by its name."""
    context = click.Context(group)
    for name in group.list_commands(context):
        found = group.get_command(context, name)
        if isinstance(found, click.Group):
            yield from commands(found, (*path, name))
        else:
            yield " ".join((*path, name)), found
