"""The options that say which machine makes which motion under which load: shared by all that moves."""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from p3dof.checks import LARGEST, shown
from p3dof.cli.files import InputFile, OutputFile, protect, source
from p3dof.cli.output import progress_bar
from p3dof.errors import ParameterError, SampleError
from p3dof.load_friction import LoadFriction, LoadFrictionEffect, read_load_friction
from p3dof.manipulator import InverseDynamics, Manipulator, load
from p3dof.methods import DEFAULT_METHOD, METHODS
from p3dof.motion import Motion, WrenchHistory, paper_motion
from p3dof.motion.entering import load_along
from p3dof.parameters import SLIDES, Body, Parameters, read_parameters
from p3dof.parameters.plain import require_near
from p3dof.parameters.quantities import ANGLE, FORCE, LENGTH, MASS, Quantity
from p3dof.reactions import ALL, WAYS, AnyReactions, Choice, Stiffness, read_stiffness

_PARAMETERS = click.option(
    "--parameters",
    type=InputFile(),
    help="Parameter file (YAML), - for the standard input; the paper's machine without it.",
)
_ANY_SIZE = click.option(
    "--any-size",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, value: context.meta.__setitem__(_META, value),
    help="Take a machine of more than 20 m or less than 1 mm too: lengths are in metres.",
)
_META = "p3dof.any_size"


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


def _of_actuators(name: str, quantity: Quantity, words: str) -> Callable[..., Any]:
    found: Callable[..., Any] = click.option(
        f"--{name}",
        type=BySlide(quantity),
        expose_value=False,
        callback=lambda context, _, value: context.meta.__setitem__(f"{_ACTUATORS}{name}", value),
        help=f"{words}: one number, or A,B,C; in place of the parameter file's.",
    )
    return found


_ACTUATORS = "p3dof.actuators."
_ARMATURE = _of_actuators("armature", MASS, "Inertia of motor and screw, reflected to the sliders [kg]")
_BALANCE = _of_actuators("counterbalance", FORCE, "Force of a balance on the sliders at home, upward [N]")


def PARAMETERS(command: Callable[..., Any]) -> Callable[..., Any]:  # noqa: N802 - used as the other options are
    """Give a command the parameter file, and `machine_of` what else is said of the machine."""
    found: Callable[..., Any] = _PARAMETERS(_ARMATURE(_BALANCE(_ANY_SIZE(command))))
    return found


def any_size() -> bool:
    """Return whether the command may take machines of any size."""
    return bool(click.get_current_context().meta.get(_META, False))


def _given_actuators() -> dict[str, dict[str, float]]:
    meta = click.get_current_context().meta
    given = {name: meta.get(f"{_ACTUATORS}{name}") for name in ("armature", "counterbalance")}
    return {name: by_slide for name, by_slide in given.items() if by_slide is not None}


def driven(parameters: Parameters) -> Parameters:
    """Return a machine with the armature and the balance that the command was given.

    Parameters
    ----------
    parameters : Parameters
        The machine of a file.

    Returns
    -------
    p3dof.Parameters

    Raises
    ------
    ParameterError
        If an inertia is negative.
    """
    return replace(parameters, actuators=replace(parameters.actuators, **_given_actuators()))


def actuator_options() -> dict[str, str]:
    """Return how armature and balance were given on the command line, by option."""
    return {
        f"--{name}": ",".join(f"{value:.15g}" for value in by_slide.values())
        for name, by_slide in _given_actuators().items()
    }


def machine_of(parameters: Path | None, payload: Body | None = None) -> Manipulator:
    """Return the machine that a command was given, of a size that the user means.

    Parameters
    ----------
    parameters : Path, optional
        Its file; the paper's machine without one.
    payload : Body, optional
        Added to its platform.

    Returns
    -------
    Manipulator

    Raises
    ------
    ParameterError, FileError
        As `p3dof.load`; also if the payload is very far away.
    """
    machine = load(None if parameters is None else read_parameters(source(parameters), any_size()))
    if _given_actuators():
        machine = load(driven(machine.parameters))
    if payload is None:
        return machine
    if not any_size():
        require_near(payload, "--payload")
    return load(machine.parameters.carrying(payload))


METHOD = click.option(
    "--method",
    type=click.Choice(METHODS),
    default=DEFAULT_METHOD,
    show_default=True,
    help="How to compute the forces.",
)
FIGURE = click.option(
    "--figure",
    type=OutputFile("figure"),
    help="Figure to draw (.png, .svg or .pdf; needs the extra 'plot').",
)
JOINTS = click.option(
    "--joints",
    type=click.Choice((ALL, *WAYS)),
    default=ALL,
    show_default=True,
    help="How loads are found that rigid bodies leave open: by elastic joints and rods, or by one of two "
    "idealisations of what joins legs and platform: universal joints (paper), balls (points).",
)
STIFFNESS = click.option(
    "--stiffness",
    type=InputFile(),
    help="YAML file with the stiffness of joints and rods, and the misfit of assembly.",
)


LOAD_FRICTION = click.option(
    "--load-friction",
    type=InputFile(),
    help="YAML file with friction of guides, screws and hinges that grows with their loads.",
)


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


class Amount(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """A positive number with a unit, or in SI units.

    Parameters
    ----------
    quantity : Quantity
        What it is of.
    zero : bool
        Take zero too.
    """

    name = "AMOUNT"

    def __init__(self, quantity: Quantity, zero: bool = False) -> None:
        self._quantity, self._zero = quantity, zero

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number in SI units."""
        try:
            number = float(self._quantity.read(value, "number"))
        except (ParameterError, ValueError):
            example = (self._quantity.unit, *self._quantity.others)[-1]
            self.fail(f"expected {self._quantity.name} such as '5 {example}', got {shown(value)}", param, ctx)
        if not 0 <= number <= LARGEST or (number == 0 and not self._zero):
            self.fail(f"expected a positive number, got {number:g}", param, ctx)
        return number


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


_CASE = (
    PARAMETERS,
    click.option(
        "--motion",
        "motion_file",
        type=InputFile(),
        help="Motion file (CSV: t,y,z,theta[,ydot,...]); the paper's without it.",
    ),
    click.option(
        "--samples",
        type=Whole(2, 1_000_000),
        help="Samples of the paper's motion, or of the curve through the poses of a file; 1001, or as many "
        "as peaks and work need, without it.",
    ),
    click.option(
        "--payload",
        type=Payload(),
        help="Point mass on the platform [kg], at P or at x,y,z in its frame [m]; besides the payload of the "
        "parameter file.",
    ),
    click.option(
        "--wrench",
        "wrench_file",
        type=InputFile(),
        help="External load on the platform at P (CSV: t,fx,fy,fz,mx,my,mz); none without it.",
    ),
)
_ON_INVALID = click.option(
    "--on-invalid",
    type=click.Choice(("raise", "nan")),
    default="raise",
    show_default=True,
    help="Stop at a sample that is out of reach or singular, or leave it NaN.",
)


@dataclass(frozen=True)
class Case:
    """A machine, its motion and its load, as the options name them; files are read when they are asked for.

    Parameters
    ----------
    parameters, motion_file, wrench_file : Path, optional
        Files to read.
    samples : int, optional
        Of the paper's motion, or of the curve through the poses of a file.
    payload : Body, optional
        On the platform.
    on_invalid : str
        What to do with invalid samples.
    """

    parameters: Path | None
    motion_file: Path | None
    samples: int | None
    payload: Body | None
    wrench_file: Path | None
    on_invalid: str = "raise"

    def protect(self, *outputs: Path | None, read: tuple[Path | None, ...] = ()) -> None:
        """Refuse to write over a file that is read, twice to one file, or where nothing can be written."""
        protect((self.parameters, self.motion_file, self.wrench_file, *read), outputs)

    @functools.cached_property
    def robot(self) -> Manipulator:
        """The machine."""
        return machine_of(self.parameters, self.payload)

    @functools.cached_property
    def motion(self) -> Motion:
        """The motion."""
        if self.motion_file is None:
            return paper_motion(1001 if self.samples is None else self.samples)
        motion = Motion.from_csv(source(self.motion_file))
        if motion.curve is None:
            if self.samples is not None:
                raise click.UsageError(
                    f"--samples belongs to the paper's motion and to poses alone; {self.motion_file} has "
                    "velocities and accelerations: its rows are the samples"
                )
            return motion
        if self.on_invalid == "raise":  # names the row of the file rather than a sample of the curve
            self.robot.forces(motion.pose, motion.velocity, motion.acceleration, method="compiled")
        if self.samples is not None:
            return motion.resampled(self.samples)
        return self.robot.refined(motion, wrench=self.history)

    @functools.cached_property
    def history(self) -> WrenchHistory | None:
        """The external load."""
        return None if self.wrench_file is None else WrenchHistory.from_csv(source(self.wrench_file))

    @property
    def wrench(self) -> WrenchHistory | None:
        """The external load over the motion; says so if it is not known all along."""
        if self.history is None:
            return None
        known, asked = self.history.time, self.motion.time
        if known[0] > asked[0] or known[-1] < asked[-1]:
            sys.stderr.write(
                f"p3dof: the load is known from {known[0]:g} to {known[-1]:g} s, the motion takes place from "
                f"{asked[0]:g} to {asked[-1]:g} s: its first and last values are kept\n"
            )
        return self.history

    def load_along(self, ramp: float) -> WrenchHistory | None:
        """Return the load of a run that enters the motion from rest, by its place on the path.

        Parameters
        ----------
        ramp : float
            How long it takes to come from rest to the motion's own rate [s]; 0 to start as the motion does.
        """
        return None if self.history is None else load_along(self.history, self.motion, ramp)

    def solve(self, method: str) -> tuple[InverseDynamics, float]:
        """Solve with a progress bar; return the result and the seconds that it took."""
        with progress_bar(method, len(self.motion)) as progress:
            start = time.perf_counter()
            result = self.robot.inverse_dynamics(
                self.motion,
                method=method,
                wrench=self.wrench,
                on_invalid=self.on_invalid,  # type: ignore[arg-type]  # likewise
                progress=progress,
            )
            seconds = time.perf_counter() - start
        self.require_valid(result.valid)
        return result, seconds

    def require_moment(self, option: str, moment: float | None) -> None:
        """Raise unless a time, if one is given, lies within the motion."""
        first, last = float(self.motion.time[0]), float(self.motion.time[-1])
        if moment is not None and not first <= moment <= last:
            raise click.BadParameter(
                f"expected a time of the motion, from {first:g} to {last:g} s, got {moment:g}",
                param_hint=option,
            )

    def load_friction(
        self, friction: LoadFriction, method: str, stiffness: Stiffness | None
    ) -> tuple[LoadFrictionEffect, float]:
        """Solve with friction by load and a progress bar; return the result and the seconds that it took."""
        with progress_bar(method, len(self.motion)) as progress:
            start = time.perf_counter()
            found = self.robot.load_friction(
                self.motion,
                friction,
                method=method,
                wrench=self.wrench,
                on_invalid=self.on_invalid,  # type: ignore[arg-type]  # likewise
                progress=progress,
                stiffness=stiffness,
            )
            seconds = time.perf_counter() - start
        self.require_valid(found.result.valid)
        return found, seconds

    def reactions(
        self,
        joints: Choice = ALL,
        stiffness: Stiffness | None = None,
        load_friction: LoadFriction | None = None,
    ) -> AnyReactions:
        """Return the reactions of all joints, with a progress bar."""
        with progress_bar("reactions", len(self.motion)) as progress:
            result = self.robot.reactions(  # type: ignore[call-overload,misc,unused-ignore]  # on_invalid: see solve
                self.motion,
                joints,
                wrench=self.wrench,
                on_invalid=self.on_invalid,
                progress=progress,
                stiffness=stiffness,
                load_friction=load_friction,
            )
        self.require_valid(result.valid)
        return cast(AnyReactions, result)

    def require_valid(self, valid: np.ndarray[Any, np.dtype[np.bool_]]) -> None:
        """Raise unless some sample is valid."""
        if not valid.any():
            raise SampleError(
                f"no sample of the motion is within what the machine can do ({len(valid)} samples)"
            )


def stiffness_in(path: Path | None) -> Stiffness | None:
    """Return how joints and rods give way by a file, if there is one."""
    return None if path is None else read_stiffness(source(path))


def load_friction_in(path: Path | None) -> LoadFriction | None:
    """Return friction that grows with loads by a file, if there is one."""
    return None if path is None else read_load_friction(source(path))


def with_case(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a `Case`, and the case as its first argument."""
    return with_load(_ON_INVALID(command), on_invalid=True)


def with_load(command: Callable[..., Any], on_invalid: bool = False) -> Callable[..., Any]:
    """Likewise, for a command that cannot leave samples out."""

    @functools.wraps(command)
    def wrapped(
        parameters: Path | None,
        motion_file: Path | None,
        samples: int | None,
        payload: Body | None,
        wrench_file: Path | None,
        **others: Any,
    ) -> Any:
        policy = {"on_invalid": others.pop("on_invalid")} if on_invalid else {}
        case = Case(parameters, motion_file, samples, payload, wrench_file, **policy)
        return command(case, **others)

    for option in reversed(_CASE):
        wrapped = option(wrapped)
    return wrapped
