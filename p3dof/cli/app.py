"""The program: its group of commands, and its exit codes."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from p3dof._base.errors import (
    AssemblyError,
    DynamicsError,
    ModelWarning,
    OptimisationError,
    P3dofError,
    SampleError,
)
from p3dof.cli.encoding import spelled, write_what_is_there

FAILED, BAD_INPUT, INTERRUPTED, READER_LEFT = 1, 2, 130, 141
"""Exit codes: a check failed or the machine cannot make a motion; bad input; the last two as a shell has them
for a program that SIGINT or SIGPIPE ended."""


_CANNOT = (SampleError, AssemblyError, DynamicsError, OptimisationError)
"""What is no fault of the input: the machine cannot do it."""

LONGEST = 1000
"""Longest message in an error's line [characters]."""


COMMANDS = {
    "balance": ("p3dof.cli.balance", "Find the balance that spares the actuators most."),
    "bearings": ("p3dof.cli.bearings", "Say how long bearings live, and if rods are safe."),
    "codegen": ("p3dof.cli.codegen", "Write C99 for a controller."),
    "compare": ("p3dof.cli.compare", "Compute the forces by both methods, and compare them."),
    "compare-designs": ("p3dof.cli.compare_designs", "Put a few machines, or tasks, side by side."),
    "designs": ("p3dof.cli.designs", "Compare many machines over one motion, from a table."),
    "energy": ("p3dof.cli.energy", "Say what moves most, and what the drives must do."),
    "export": ("p3dof.cli.export", "Write the model for other tools, with its loops."),
    "fastest": ("p3dof.cli.plan", "Find the fastest motion of a task within the limits."),
    "forces": ("p3dof.cli.forces", "Compute the forces over a motion by one method."),
    "indices": ("p3dof.cli.indices", "Say how well the machine moves and holds at poses."),
    "loop": ("p3dof.cli.loop", "Assemble, weigh and move any robot with closed loops."),
    "optimise": ("p3dof.cli.optimise", "Find a better machine, and say what binds it."),
    "pareto": ("p3dof.cli.optimise", "Find the machines that no other one beats."),
    "plan": ("p3dof.cli.plan", "Plan the motion of a task, and say what it takes."),
    "plots": ("p3dof.cli.plots", "Draw all figures of a motion."),
    "reactions": ("p3dof.cli.reactions", "Compute forces and moments in all joints."),
    "report": ("p3dof.cli.report", "Say if a machine fits a task; tell all about a motion."),
    "runs": ("p3dof.cli.runs", "Run many machines in time, from a table."),
    "sensitivity": ("p3dof.cli.tolerance", "Say which parameters the forces depend on."),
    "show": ("p3dof.cli.show", "Show the machine and its forces in the browser."),
    "simulate": ("p3dof.cli.simulate", "Follow a motion under controllers, in time."),
    "size": ("p3dof.cli.size", "Say which drives fit a task."),
    "studio": ("p3dof.cli.studio", "Write a page with maps of indices, and designs."),
    "sweep": ("p3dof.cli.sweep", "Compute machines by the million, in blocks."),
    "tolerance": ("p3dof.cli.tolerance", "Say how uncertain forces and poses are."),
    "urdf": ("p3dof.cli.export", "Write the URDF, its loops and its actuated joints."),
    "workspace": ("p3dof.cli.workspace", "Say where the machine can work; draw maps."),
}
"""The commands: the module of each, imported when it is asked for, and what the program's help says of it."""


class _Interrupted(Exception):  # noqa: N818 - never seen outside
    """Ctrl-C, hidden from Click, which would print an empty line."""


class _ReaderLeft(Exception):  # noqa: N818 - never seen outside
    """A closed pipe, hidden from Click, whose exit code for it is that of a failed check."""


@contextmanager
def _hidden_from_click() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as problem:
        raise _Interrupted(*problem.args) from problem
    except BrokenPipeError as problem:
        raise _ReaderLeft from problem
    except SystemExit as problem:  # what Rich makes of a closed pipe
        if isinstance(problem.__context__, BrokenPipeError):
            raise _ReaderLeft from problem
        raise


class Command(click.Command):
    """A command whose help any terminal can show: Click would write UTF-8 to one that knows ASCII only."""

    def get_help(self, ctx: click.Context) -> str:
        """Return the help, in the characters that the terminal has."""
        return spelled(super().get_help(ctx), getattr(sys.stdout, "encoding", None) or "utf-8")


class _Program(click.Group):
    """A group that imports a command when it is asked for, and whose interruptions are the program's."""

    command_class = Command
    loading: Callable[[], AbstractContextManager[None]] = nullcontext
    """Within what a command is imported."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*COMMANDS, *super().list_commands(ctx)})

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name in COMMANDS:
            with self.loading():
                import_module(COMMANDS[name][0])
        return super().get_command(ctx, name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (_, summary) in COMMANDS.items()])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        if incomplete.startswith("-"):
            return super().shell_complete(ctx, incomplete)
        found = ((name, summary) for name, (_, summary) in COMMANDS.items() if name.startswith(incomplete))
        return [CompletionItem(name, help=summary) for name, summary in found]

    def make_context(self, *arguments: Any, **others: Any) -> click.Context:
        with _hidden_from_click():
            return super().make_context(*arguments, **others)

    def invoke(self, ctx: click.Context) -> Any:
        with _hidden_from_click():
            return super().invoke(ctx)


def main(
    arguments: Sequence[str] | None = None, loading: Callable[[], AbstractContextManager[None]] = nullcontext
) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The arguments; those of the process by default.
    loading : callable, optional
        Returns within what a command is imported, such as other answers to Ctrl-C.

    Returns
    -------
    int
        The exit code.
    """
    _prepare_streams()
    app.loading = loading
    try:
        code = _run(arguments)
        with _hidden_from_click():
            sys.stdout.flush()
    except _Interrupted as problem:
        return _told(str(problem) or "interrupted", INTERRUPTED)
    except _ReaderLeft:
        _drop_what_is_left(sys.stdout)
        return READER_LEFT
    except OSError as error:  # such as a full disk behind the standard output
        _drop_what_is_left(sys.stdout)
        return _fail(f"cannot write the output ({error.strerror or error})")
    return code


def _run(arguments: Sequence[str] | None) -> int:
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        return _called(arguments)


def _show_warning(message: Warning | str, category: type[Warning], *place: Any, **others: Any) -> None:
    """Show a warning about the input as one line; others, which are ours to mend, as Python does."""
    if issubclass(category, ModelWarning):
        from p3dof._base.checks import one_line

        sys.stderr.write(f"p3dof: {one_line(str(message), LONGEST)}\n")
    else:
        sys.stderr.write(warnings.formatwarning(message, category, *place[:2], *place[3:4], **others))


def _called(arguments: Sequence[str] | None) -> int:
    try:
        code = app(
            args=None if arguments is None else list(arguments), standalone_mode=False, prog_name="p3dof"
        )
    except P3dofError as error:
        told = str(error.args[0] if error.args else error)  # without hints for programs
        return _fail(told, FAILED if isinstance(error, _CANNOT) else BAD_INPUT)
    except click.exceptions.NoArgsIsHelpError as error:
        sys.stderr.write(f"{error.format_message()}\n")
        return BAD_INPUT
    except click.exceptions.Abort:
        return _told("interrupted", INTERRUPTED)
    except click.ClickException as error:
        return _fail(error.format_message())
    except MemoryError:
        return _fail("there is not enough memory for this; fewer samples need less")
    return int(code or 0)


@click.group(cls=_Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=lambda context, _, asked: _print_version(context) if asked else None,
    help="Show the version, and what the compiled method runs on.",
)
def app() -> None:
    """Inverse dynamics of a 3-DOF spatial parallel manipulator, by Pinocchio and by virtual powers."""


def _print_version(context: click.Context) -> None:
    from p3dof import __version__
    from p3dof.closed_form.compiled import in_words

    click.echo(f"p3dof {__version__} (kernels: {in_words()})")
    context.exit()


def _prepare_streams() -> None:
    """Let every character through, and let there be streams where the caller closed them."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - for good
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=write_what_is_there)


def _drop_what_is_left(stream: Any) -> None:
    """Lead a stream that nobody reads into nothing: Python would try to write the rest when it ends."""
    with suppress(OSError, ValueError):  # it may have no descriptor, as under a test
        nothing = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nothing, stream.fileno())
        finally:
            os.close(nothing)


def _fail(message: str, code: int = BAD_INPUT) -> int:
    from p3dof._base.checks import one_line  # it brings NumPy, which the help does not need

    return _told(one_line(message, LONGEST), code)


def _told(line: str, code: int) -> int:
    try:
        sys.stderr.write(f"p3dof: error: {line}\n")
        sys.stderr.flush()
    except OSError:
        _drop_what_is_left(sys.stderr)
    return code
