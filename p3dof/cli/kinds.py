"""What kinds of values options take: numbers, poses, payloads, forces by slide."""

from __future__ import annotations

from typing import Any

import click
import numpy as np

from p3dof._base.checks import LARGEST, shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters import SLIDES, Body
from p3dof.machine.parameters.quantities import ANGLE, LENGTH, MASS, Quantity


class BySlide(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """One number for all sliders, or three for A, B and C; units may follow each.

    Parameters
    ----------
    quantity : Quantity
        What the numbers are.
    """

    def __init__(self, quantity: Quantity) -> None:
        self._quantity = quantity
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
        return dict(zip(SLIDES, numbers * (len(SLIDES) // len(numbers)), strict=True))


class Number(click.FloatRange):
    """A finite number in a range, of a size that arithmetic can bear; the option that it came by is named."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            self.fail(f"expected a number, got {shown(value)}", param, ctx)
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


_OTHERS = {
    "m/s": ("mm/s",),
    "rad/s": ("deg/s", "rpm"),
    "m/s^2": ("mm/s^2",),
    "rad/s^2": ("deg/s^2",),
}

"""Further units of numbers of three."""


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
        except (ParameterError, ValueError):
            self.fail(
                f"expected y,z,theta such as '0.1,0,-30 deg' or '100 mm,0,0', got {value!r}", param, ctx
            )
        return [float(number) for number in pose]


class Span(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """A range around zero, ``MOST`` to both sides or ``FROM,TO``, with a unit or in SI units.

    Parameters
    ----------
    quantity : Quantity
        Of its ends.
    example : str
        For errors.
    """

    name = "MOST|FROM,TO"

    def __init__(self, quantity: Quantity, example: str) -> None:
        self._quantity, self._example = quantity, example

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Return the ends."""
        if isinstance(value, tuple):
            return value
        parts = [part.strip() for part in str(value).split(",")]
        rule = f"expected one number or two such as {self._example}, got {value!r}"
        try:
            ends = [float(self._quantity.read(part, "number")) for part in parts]
        except (ParameterError, ValueError):
            self.fail(rule, param, ctx)
        if len(ends) == 1 and ends[0] > 0:
            return -ends[0], ends[0]
        if len(ends) != 2:
            self.fail(rule, param, ctx)
        return ends[0], ends[1]


class Triple(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """Three numbers, of y, z and θ, with units or in SI units.

    Parameters
    ----------
    units : tuple of str
        SI units of the three.
    """

    name = "Y,Z,THETA"

    def __init__(self, *units: str) -> None:
        self._kinds = [Quantity("a number", unit, _OTHERS.get(unit, ())) for unit in units]

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        """Return the numbers."""
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        try:
            y, z, theta = (
                float(kind.read(part.strip(), "number"))
                for kind, part in zip(self._kinds, parts, strict=True)
            )
        except (ParameterError, ValueError):
            units = ", ".join(kind.unit for kind in self._kinds)
            self.fail(f"expected three numbers, of y, z and theta [{units}], got {value!r}", param, ctx)
        return y, z, theta


def payload_text(payload: Body) -> str:
    """Return a payload as it is given on the command line."""
    com = payload.com.tolist()
    return ",".join(f"{number:.15g}" for number in (payload.mass, *(com if any(com) else ())))
