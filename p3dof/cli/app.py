"""The program: its group of commands, and its exit codes."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence

import click

from p3dof import __version__
from p3dof.errors import P3dofError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The arguments; those of the process by default.

    Returns
    -------
    int
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek letters still gets its tables
    try:
        code = app(
            args=None if arguments is None else list(arguments), standalone_mode=False, prog_name="p3dof"
        )
    except P3dofError as error:
        return _fail(str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        sys.stderr.write(f"{error.format_message()}\n")
        return 2
    except click.exceptions.Abort:
        return _fail("interrupted", 130)
    except click.ClickException as error:
        return _fail(error.format_message())
    except OSError as error:  # such as a full disk behind the standard output
        return _fail(f"cannot write the output ({error.strerror or error})")
    return int(code or 0)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="p3dof %(version)s")
def app() -> None:
    """Inverse dynamics of a 3-DOF spatial parallel manipulator, by Pinocchio and by virtual powers."""


def _fail(message: str, code: int = 2) -> int:
    line = " ".join(message.split())
    sys.stderr.write(f"p3dof: error: {line}\n")
    return code
