"""The command line as a user calls it, in this process."""

from __future__ import annotations

from p3dof.cli import main


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err
