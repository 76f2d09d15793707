"""Kinds of values that options take, options that many commands share, and several as one argument."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable
from typing import Any

import click
import yaml

from p3dof._base.checks import LARGEST, SMALLEST, shown, with_point
from p3dof._base.errors import ParameterError
from p3dof._base.quantities import TIME, Quantity
from p3dof._base.time_series.smoothing import Smooth
from p3dof.cli.files import OutputFile


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


class Amount(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A positive number with a unit, or in SI units; zero too if it is said."""

    name = "AMOUNT"

    def __init__(self, quantity: Quantity, zero: bool = False) -> None:
        self._quantity, self._zero = quantity, zero

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number in SI units."""
        try:
            number = float(self._quantity.read(value, "number"))
        except (ParameterError, ValueError):
            example = (self._quantity.unit, *self._quantity.others)[-1]
            rule = f"expected {self._quantity.name} such as '5 {example}'"
            self.fail(f"{rule}, got {shown(value)}{with_point(value)}", param, ctx)
        if not (SMALLEST <= number <= LARGEST or (number == 0 and self._zero)):
            self.fail(f"expected a positive number, got {number:g}", param, ctx)
        return number


class Named(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A parameter and what is said of it, ``NAME=VALUE``."""

    name = "NAME=VALUE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, Any]:
        """Return the name and the value."""
        if isinstance(value, tuple):
            return value
        name, equals, text = str(value).partition("=")
        if not equals or not name.strip() or not text.strip():
            self.fail(f"expected NAME=VALUE such as 'R=0.1 mm', got {value!r}", param, ctx)
        try:
            number = yaml.safe_load(text) if text.strip()[0] in "[{" else text.strip()
        except yaml.YAMLError:
            self.fail(f"{name}: expected a number, a share or a range [LOW, HIGH], got {text!r}", param, ctx)
        return name.strip(), number


class Smoothing(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """How to smooth the values of a motion file: "auto", or a frequency [Hz]."""

    name = "SMOOTH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Smooth:
        """Return what `Motion.from_csv` takes."""
        if value == "auto":
            return "auto"
        try:
            return float(POSITIVE.convert(value, param, ctx))
        except click.BadParameter:
            self.fail(f"expected auto, or a frequency in Hz above zero, got {shown(value)}", param, ctx)


SMOOTH = click.option(
    "--smooth",
    type=Smoothing(),
    metavar="auto|HZ",
    help="Filter a measured or rounded motion: a cut-off frequency [Hz], or auto, above which there is only "
    "noise.",
)
FIGURE = click.option(
    "--figure", type=OutputFile("figure"), help="Figure to draw (.png, .svg or .pdf; needs the extra 'plot')."
)

DURATION = click.option(
    "--duration",
    type=Amount(TIME),
    help="Duration of the whole task, dwells included [s]; not needed if every stop has one in the file.",
)


def table_out(what: str) -> Callable[..., Any]:
    """Return the option for a CSV file, or the standard output, for something."""
    return click.option(
        "--out", type=OutputFile("table"), help=f"CSV file to write, - for the standard output: {what}."
    )
