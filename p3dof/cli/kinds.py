"""Kinds of values that options take, options that many commands share, and several as one argument."""

from __future__ import annotations

import functools
import inspect
import math
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import click
import yaml

from p3dof._base.checks import LARGEST, SMALLEST, is_number, shown, with_point
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.quantities import FREQUENCY, TIME, Quantity
from p3dof.cli.files import CHECK, CPU, FORCE, WASM, OutputFile
from p3dof.cli.output import in_options


def options(*each: Callable[..., Any]) -> Callable[..., Any]:
    """Return what gives a command several options, in the order of its help."""

    def give(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(each):
            command = option(command)
        return command

    return give


def as_one(name: str, kind: Callable[..., Any], *each: Callable[..., Any]) -> Callable[..., Any]:
    """Return what gives a command options, and as one argument what a class makes of them: its fields."""
    fields = tuple(inspect.signature(kind).parameters)

    def give(command: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(command)
        def taking(**given: Any) -> Any:
            own = {field: given.pop(field) for field in fields if field in given}
            return command(**{name: kind(**own)}, **given)

        return options(*each)(taking)  # type: ignore[no-any-return]

    return give


class Number(click.FloatRange):
    """A finite number in a range, of a size that arithmetic can bear; the option that it came by is named."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            told = with_point(value)
            if not told and re.match(r"[+-]?[\d.]+ *[A-Za-z]", str(value)):
                told = "; write it without a unit, which --help names"
            self.fail(f"expected a number, got {shown(value)}{told}", param, ctx)
        if not abs(number) <= LARGEST:
            self.fail(f"expected a finite number of at most {LARGEST:g} in size, got {number:g}", param, ctx)
        found: float = super().convert(number, param, ctx)
        return found


class Whole(click.IntRange):
    """A whole number in a range."""

    name = "whole number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number."""
        try:
            number = int(value)
        except ValueError:
            self.fail(f"expected a whole number, got {shown(value)}", param, ctx)
        found: int = super().convert(number, param, ctx)
        return found


POSITIVE = Number(min=0, min_open=True)


class Given(float):
    """A number in SI units that came with a unit, where units of several kinds may be given."""

    unit = ""


def require_unit(option: str, number: object, units: Iterable[str]) -> None:
    """Raise where a number came with a unit, and what it is for has others."""
    known = sorted(set(units))
    if isinstance(number, Given) and known != [number.unit]:
        raise InputError(
            f"{option}: expected {' and '.join(known) or 'no unit'}, as the actuated joints have"
            f"{', by a number without a unit' if len(known) > 1 else ''}, got {number:g} {number.unit}"
        )


class Amount(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A number with a unit, or in SI units: a positive one, zero too if it is said, or within ends, if any.

    Of several kinds, whichever its unit is of, which a `Given` has. Words may stand for other values.
    """

    name = "AMOUNT"

    def __init__(
        self,
        *kinds: Quantity,
        zero: bool = False,
        ends: tuple[float, ...] | None = None,
        words: dict[str, Any] | None = None,
    ) -> None:
        self._kinds, self._zero, self._ends, self._words = kinds, zero, ends, words or {}

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number in SI units."""
        if value in self._words:
            return self._words[value]
        number, kind = math.nan, self._kinds[0]
        for each in self._kinds:
            with suppress(ParameterError, ValueError):
                number, kind = float(each.read(value, "number")), each
                break
        else:
            names, example = " or ".join(one.name for one in self._kinds), (kind.unit, *kind.others)[-1]
            told = f"{''.join(f', or {word}' for word in self._words)}, got {shown(value)}{with_point(value)}"
            self.fail(f"expected {names} such as '5 {example}'{told}", param, ctx)
        rule = f"expected {'zero or ' * self._zero}a positive number"
        good = SMALLEST <= number <= LARGEST or (number == 0 and self._zero)
        if self._ends:
            low, high = self._ends
            rule, good = f"expected {kind.name} from {low:g} to {high:g} {kind.unit}", low <= number <= high
        if not good and self._ends != ():
            self.fail(f"{rule}, got {number:g}", param, ctx)
        if len(self._kinds) > 1 and isinstance(value, str) and not is_number(value):
            number = Given(number)
            number.unit = kind.unit
        return number


SECONDS, HERTZ = Amount(TIME), Amount(FREQUENCY)
FROM_ZERO = Amount(TIME, zero=True)
MOMENT_OF_MOTION = Amount(TIME, ends=())


class Named(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A parameter and what is said of it, ``NAME=VALUE``."""

    name = "NAME=VALUE"

    def __init__(self, example: str = "R=0.1 mm") -> None:
        self._example = example

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, Any]:
        """Return the name and the value."""
        if isinstance(value, tuple):
            return value
        name, equals, text = str(value).partition("=")
        if not equals or not name.strip() or not text.strip():
            self.fail(f"expected NAME=VALUE such as '{self._example}', got {value!r}", param, ctx)
        try:
            number = yaml.safe_load(text) if text.strip()[0] in "[{" else text.strip()
        except yaml.YAMLError:
            self.fail(f"{name}: expected a number, a share or a range [LOW, HIGH], got {text!r}", param, ctx)
        return name.strip(), number


SMOOTH = click.option(
    "--smooth",
    type=Amount(FREQUENCY, words={"auto": "auto"}),
    metavar="auto|HZ",
    help="Filter a measured or rounded motion: a cut-off frequency [Hz], or auto, above which there is only "
    "noise.",
)
FIGURE = click.option(
    "--figure", type=OutputFile("figure"), help="Figure to draw (.png, .svg or .pdf; needs the extra 'plot')."
)

_OF_CODE = {f"{name}: ": f"--{name}: " for name in ("cpu", "prefix", "functions", "external", "float")} | {
    "inertias: ": "--inertia: ",
    "actuators: expected coordinates,": "--actuators: expected --coordinates,",
    "estimator: expected one inertia": "--payload-estimator: expected one --inertia",
}
OF_CODE = options(CPU, WASM, CHECK, FORCE, in_options(_OF_CODE))
"""What commands that write C share; arguments of Python are options in their errors."""

DURATION = click.option(
    "--duration",
    type=SECONDS,
    help="Duration of the whole task, dwells included [s]; not needed if every stop has one in the file.",
)


def named_option(option: str, name: str, words: str, example: str = "R=0.1 mm") -> Callable[..., Any]:
    """Return the repeatable option for what is said of parameters, of each once."""

    def once(ctx: click.Context, param: click.Parameter, value: tuple[tuple[str, Any], ...]) -> Any:
        names = [each for each, _ in value]
        for each in set(names):
            if names.count(each) > 1:
                raise click.BadParameter(f"expected each name once, got {each} twice", ctx, param)
        return value

    return click.option(option, name, type=Named(example), multiple=True, callback=once, help=words)


def table_out(what: str) -> Callable[..., Any]:
    """Return the option for a CSV file, or the standard output, for something."""
    return click.option(
        "--out", type=OutputFile("table"), help=f"CSV file to write, - for the standard output: {what}."
    )
