"""The program: its group of commands, its exit codes, and letters on any terminal."""

from __future__ import annotations

import codecs
import io
import os
import re
import sys
import textwrap
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from importlib import import_module
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from p3dof._base.errors import (
    NO_PINOCCHIO,
    AssemblyError,
    DynamicsError,
    ModelWarning,
    OptimisationError,
    P3dofError,
    SampleError,
)

FAILED, BAD_INPUT, INTERRUPTED, READER_LEFT = 1, 2, 130, 141
"""Exit codes: a check failed or the machine cannot perform a motion; bad input; the last two as a shell has
them for a program that SIGINT or SIGPIPE ended."""


_CANNOT = (SampleError, AssemblyError, DynamicsError, OptimisationError)
"""What is no fault of the input: the machine cannot do it."""

_ROOM, _HEADING = 78, 10
"""Width of a help that has headings beside its commands, and of these headings [characters]."""

LONGEST = 1000
"""Longest message in an error's line [characters]."""


COMMANDS = {
    "Start": {
        "init": ("p3dof.cli.start", "Write files of a machine, motion, task and drives."),
        "doctor": ("p3dof.cli.start", "Check the installation: kernels, extras, tools."),
        "completion": ("p3dof.cli.start", "Print the shell completion: bash, zsh or fish."),
    },
    "Forces": {
        "compare": ("p3dof.cli.forces", "Compare the actuator forces of both methods."),
        "forces": ("p3dof.cli.forces", "Compute the actuator forces over a motion."),
        "energy": ("p3dof.cli.forces", "Compute energies, power and drive loads."),
        "reactions": ("p3dof.cli.reactions", "Compute joint reactions."),
    },
    "See and export": {
        "show": ("p3dof.cli.show", "Show the machine in the browser, or in MeshCat."),
        "plots": ("p3dof.cli.forces", "Draw all figures of a motion."),
        "urdf": ("p3dof.cli.export", "Write the URDF and its loop closures."),
        "export": ("p3dof.cli.export", "Write the model for other tools: MJCF, SDF, USD."),
    },
    "Tasks and drives": {
        "plan": ("p3dof.cli.plan", "Plan the motion of a task and check its limits."),
        "fastest": ("p3dof.cli.plan", "Compute the time-optimal motion of a task."),
        "balance": ("p3dof.cli.size", "Optimise the counterbalance of the sliders."),
        "size": ("p3dof.cli.size", "Size motors and screws for a task."),
        "bearings": ("p3dof.cli.reactions", "Compute bearing life and rod safety."),
        "report": ("p3dof.cli.report", "Write a report on a task or a motion."),
    },
    "Design": {
        "workspace": ("p3dof.cli.workspace", "Compute and draw the workspace."),
        "indices": ("p3dof.cli.workspace", "Compute performance indices at poses."),
        "studio": ("p3dof.cli.report", "Write a page with maps of indices and designs."),
        "compare-designs": ("p3dof.cli.report", "Compare machines or tasks."),
        "designs": ("p3dof.cli.designs", "Evaluate a table of designs over one motion."),
        "sweep": ("p3dof.cli.designs", "Run a resumable sweep over designs."),
        "optimise": ("p3dof.cli.optimise", "Optimise a design under constraints."),
        "pareto": ("p3dof.cli.optimise", "Compute a Pareto front of designs."),
        "sensitivity": ("p3dof.cli.tolerance", "Compute sensitivities (local, Sobol')."),
        "tolerance": ("p3dof.cli.tolerance", "Tolerance analysis of poses and forces."),
    },
    "Control": {
        "simulate": ("p3dof.cli.simulate", "Simulate the machine under control."),
        "runs": ("p3dof.cli.simulate", "Run a batch of simulations from a table."),
        "codegen": ("p3dof.cli.codegen", "Generate C99 code for a controller."),
    },
    "Measure": {
        "excite": ("p3dof.cli.identify", "Optimise an excitation motion (identification)."),
        "identify": ("p3dof.cli.identify", "Identify inertia and friction from a log."),
        "calibrate": ("p3dof.cli.identify", "Calibrate legs and encoders from measured poses."),
    },
    "Any robot": {"loop": ("p3dof.cli.loop", "Any closed-loop robot: forces, simulation, C.")},
}
"""The commands by what they are for, each heading in the order of work.

Of each its module, which is imported when it is asked for, and what the program's help says of it."""


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


def _noted(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    ctx.meta[f"p3dof.{param.name}"] = value
    if value and param.name == "json":
        require_standard_output(param, ctx)


def require_standard_output(param: click.Parameter | None, ctx: click.Context | None) -> None:
    """Raise where what is written to the standard output would be lost."""
    if getattr(sys.stdout, "name", None) == os.devnull:  # what stands for a stream that the caller closed
        raise click.BadParameter("the standard output is closed", ctx, param)


_ALL = {
    "--json": "Print the results as JSON, and nothing else.",
    "--quiet": "Print warnings and errors only.",
}
"""Options that every command has; `p3dof.cli.output` does what they say."""


class Command(click.Command):
    """A command with the options of all, and a help that any terminal can show: Click would write UTF-8."""

    @staticmethod
    def printing(ctx: click.Context) -> AbstractContextManager[None]:
        """Return within what a command runs; `p3dof.cli.output`, which all commands import, has its own."""
        del ctx
        return nullcontext()

    def __init__(self, *arguments: Any, **others: Any) -> None:
        super().__init__(*arguments, **others)
        for name, words in _ALL.items():
            option = click.Option([name], is_flag=True, expose_value=False, callback=_noted, help=words)
            self.params.append(option)

    def invoke(self, ctx: click.Context) -> Any:
        """Run it, and print what it has to tell as the options say."""
        with self.printing(ctx):
            return super().invoke(ctx)

    def get_help(self, ctx: click.Context) -> str:
        """Return the help, in the characters that the terminal has."""
        return spelled(super().get_help(ctx), getattr(sys.stdout, "encoding", None) or "utf-8")


class Group(click.Group):
    """A group that imports a command when it is asked for: a table has the module and a summary of each."""

    command_class = Command

    def __init__(self, *arguments: Any, table: Mapping[str, Mapping[str, tuple[str, str]]], **others: Any):
        super().__init__(*arguments, **others)
        self.headings = table
        self.table = {name: entry for commands in table.values() for name, entry in commands.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, in the order of the table."""
        return list(dict.fromkeys((*self.table, *super().list_commands(ctx))))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return a command, whose module adds it to the group."""
        if name in self.table:
            with app.loading():
                import_module(self.table[name][0])
        return super().get_command(ctx, name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is meant; an error names those that come close."""
        name = args[0]
        if name not in self.list_commands(ctx) and name[:1] != "-" and not ctx.resilient_parsing:
            ctx.fail(f"no such command {name!r}{self._command_hint(name, ctx)}")
        return super().resolve_command(ctx, args)

    def _command_hint(self, name: str, ctx: click.Context) -> str:
        """Return what ends an error about a command: what is near, or where a file belongs."""
        if Path(name).suffix:
            first = "info" if "info" in self.table else "loop info" if name.endswith("f") else "COMMAND"
            return f"; a command stands before a file: '{ctx.command_path} {first} {name}'"
        inner = self.get_command(ctx, "loop")
        if isinstance(inner, Group) and name in inner.table:
            return f"; did you mean 'loop {name}'?"
        from p3dof import __all__ as public

        return f"; p3dof.{name} is Python, no command" if name in public else _hint(name, self.table, ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write commands by heading, then options: headings stand on the left where there is room."""
        listed = {
            heading: [(name, summary) for name, (_, summary) in commands.items()]
            for heading, commands in self.headings.items()
        }
        listed["Options"] = [record for one in self.get_params(ctx) if (record := one.get_help_record(ctx))]
        if formatter.width < _ROOM:
            for heading, rows in listed.items():
                with formatter.section(heading):
                    formatter.write_dl(rows)
            return
        formatter.write_paragraph()
        middle = max(len(name) for rows in listed.values() for name, _ in rows) + 2
        for heading, rows in listed.items():
            words = chain(textwrap.wrap(heading, _HEADING), repeat(""))
            for word, (name, summary) in zip(words, rows, strict=False):
                formatter.write(f"{word:{_HEADING + 2}}{name:{middle}}{summary}\n")

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return what may be meant, by the table."""
        if incomplete.startswith("-"):
            return super().shell_complete(ctx, incomplete)
        found = ((name, summary) for name, (_, summary) in self.table.items() if name.startswith(incomplete))
        return [CompletionItem(name, help=summary) for name, summary in found]


class _Program(Group):
    """The group of all commands, whose interruptions are the program's."""

    loading: Callable[[], AbstractContextManager[None]] = nullcontext
    """Within what a command is imported."""

    def make_context(self, *arguments: Any, **others: Any) -> click.Context:
        with _hidden_from_click():
            return super().make_context(*arguments, **others)

    def invoke(self, ctx: click.Context) -> Any:
        with _hidden_from_click():
            return super().invoke(ctx)


def main(
    arguments: Sequence[str] | None = None, loading: Callable[[], AbstractContextManager[None]] = nullcontext
) -> int:
    """Run the command line; the exit code.

    `loading`: returns within what a command is imported, such as other answers to Ctrl-C.
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


_HELD: list[str] = []
"""Doubts about units that are told at the end, unless an error says the same."""
_UNITS = "): units are m, rad"


def _run(arguments: Sequence[str] | None) -> int:
    _HELD.clear()
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = _show_warning
        try:
            return _called(arguments)
        finally:
            tell_doubts()


def tell_doubts() -> None:
    """Say what is held."""
    sys.stderr.write("".join(_HELD))
    _HELD.clear()


def _show_warning(message: Warning | str, category: type[Warning], *place: Any, **others: Any) -> None:
    """Show a warning about the input as one line; others, which are ours to mend, as Python does."""
    if issubclass(category, ModelWarning):
        from p3dof._base.checks import one_line

        line = f"p3dof: {one_line(str(message), LONGEST)}\n"
        if _UNITS in line:
            _HELD.append(line)
        else:
            sys.stderr.write(line)
    else:
        sys.stderr.write(warnings.formatwarning(message, category, *place[:2], *place[3:4], **others))


def _called(arguments: Sequence[str] | None) -> int:
    try:
        code = app(
            args=None if arguments is None else list(arguments), standalone_mode=False, prog_name="p3dof"
        )
    except P3dofError as error:
        told = str(error.args[0] if error.args else error)  # without hints for programs
        if told.endswith("?)"):
            _HELD.clear()
            told += ": give the unit, as in '10 mm' or '30 deg', or y [mm], theta [deg] in a CSV file"
        return _fail(told, FAILED if isinstance(error, _CANNOT) else BAD_INPUT)
    except click.exceptions.NoArgsIsHelpError as error:
        first = error.ctx is not None and error.ctx.parent is None
        sys.stderr.write(f"{_FIRST if first else error.format_message()}\n")
        return BAD_INPUT
    except click.exceptions.Abort:
        return _told("interrupted", INTERRUPTED)
    except click.ClickException as error:
        return _fail(_said(error))
    except (MemoryError, ModuleNotFoundError) as error:
        if getattr(error, "name", "pinocchio") != "pinocchio":
            raise
        memory = "there is not enough memory for this; fewer samples need less"
        return _fail(memory if isinstance(error, MemoryError) else NO_PINOCCHIO)
    return int(code or 0)


@click.group(
    cls=_Program,
    table=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=lambda context, _, asked: _print_version(context) if asked else None,
    help="Show the version and the level of the kernels.",
)
def app() -> None:
    """Dynamics of a 3-DOF parallel manipulator, and of any closed-loop robot."""


def _print_version(context: click.Context) -> None:
    from p3dof import __version__
    from p3dof.closed_form.compiled import in_words

    click.echo(f"p3dof {__version__} (kernels: {in_words()})")
    context.exit()


_FIRST = """Usage: p3dof COMMAND [OPTIONS]

Try first:
  p3dof compare          Compute the actuator forces by two independent methods.
  p3dof show --meshcat   Show the machine in MeshCat, or else with forces.
  p3dof init             Write a machine, a motion, a task and drives to edit.

p3dof --help lists all commands; p3dof COMMAND --help describes one."""
"""What the program says when it is called alone."""


def _hint(name: str, known: Iterable[str], ctx: click.Context | None) -> str:
    """Return what ends an error about a command or an option: the names that come close, or where all are."""
    from p3dof._base.checks import meant  # it brings NumPy, which the help does not need

    bare = {one.lstrip("-"): one for one in known}  # dashes would make all options alike
    near = meant(name.lstrip("-"), bare)
    if not near:
        return f"; see '{'p3dof' if ctx is None else ctx.command_path} --help'"
    return re.sub("'([^']+)'", lambda found: repr(bare[found[1]]), near)


_TAKES = {".csv": "--motion", ".yaml": "--parameters", ".yml": "--parameters"}
"""The option that takes a file, by its ending."""


def _said(error: click.ClickException) -> str:
    context = error.ctx if isinstance(error, click.UsageError) else None
    extra = re.match(r"Got unexpected extra arguments? \((\S+)", error.format_message())
    if extra and context is not None:
        name = extra[1].rstrip(")")
        option = _TAKES.get(Path(name).suffix.lower())
        for one in context.command.params:
            option = one.opts[0] if name in getattr(one.type, "choices", ()) else option
        has = any(option in one.opts for one in context.command.params)
        near = f"; did you mean {option} {name}?" if has else f"; see '{context.command_path} --help'"
        return f"unexpected argument {name!r}{near}"
    if not isinstance(error, click.NoSuchOption):
        return error.format_message()
    known = [] if error.ctx is None else [name for one in error.ctx.command.params for name in one.opts]
    return f"no such option {error.option_name!r}{_hint(error.option_name, [*known, '--help'], error.ctx)}"


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


_WORDS = {
    "θ": "theta", "Σ": "sum", "Δ": "Delta", "π": "pi", "ω": "omega", "α": "alpha", "µ": "u", "μ": "u",
    "×": "x", "·": " ", "−": "-", "–": "-", "—": "-", "→": "->", "±": "+/-", "≤": "<=", "≥": ">=", "≈": "~",
    "°": "deg", "²": "^2", "³": "^3", "⁻": "^-", "…": "...", "“": '"', "”": '"', "„": '"', "‘": "'", "’": "'",
    "│": "|", "─": "-", "━": "-",
}  # fmt: skip
"""What to write for a character that an encoding does not have."""


def _spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """Write a character that the encoding does not have in letters that it has: the codec's error handler."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    if "\udc80" <= character <= "\udcff":  # a byte of a file's name, as Python keeps what it cannot decode
        return bytes([ord(character) - 0xDC00]), error.start + 1
    simple = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return _WORDS.get(character) or simple or "?", error.start + 1


write_what_is_there = "p3dof-spelled"
"""The name of the codecs' error handler that spells what an encoding does not have: θ as theta."""

codecs.register_error(write_what_is_there, _spelled)


def spelled(text: str, encoding: str) -> str:
    """Return a text as an encoding can write it.

    The same text where the encoding has all its characters; else with ``theta`` for θ and so on.
    """
    return text.encode(encoding, write_what_is_there).decode(encoding, "surrogateescape")
