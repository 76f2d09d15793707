"""The options that say which machine makes which motion under which load: shared by all that moves."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from p3dof._base.checks import LARGEST, SMALLEST, shown
from p3dof._base.errors import ParameterError, SampleError
from p3dof.analysis.load_friction import LoadFriction, LoadFrictionEffect, read_load_friction
from p3dof.analysis.reactions import ALL, WAYS, AnyReactions, Choice, Stiffness, read_stiffness
from p3dof.cli.files import InputFile, OutputFile, protect, source
from p3dof.cli.kinds import POSITIVE, Payload, Whole
from p3dof.cli.machine import PARAMETERS, machine_of
from p3dof.cli.output import progress_bar, say
from p3dof.machine.motion import Motion, WrenchHistory, paper_motion
from p3dof.machine.motion.entering import load_along
from p3dof.machine.motion.smoothing import Smooth
from p3dof.machine.parameters import Body
from p3dof.machine.parameters.quantities import Quantity
from p3dof.manipulator import Manipulator
from p3dof.methods import DEFAULT_METHOD, METHODS, InverseDynamics

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
        if not (SMALLEST <= number <= LARGEST or (number == 0 and self._zero)):
            self.fail(f"expected a positive number, got {number:g}", param, ctx)
        return number


class Smoothing(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """How to smooth poses: "auto", or a frequency [Hz]."""

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
    help="Smooth the motion of a file, measured or rounded: up to a frequency [Hz], or as far as they "
    "have more than noise.",
)


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
    SMOOTH,
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
    smooth : "auto" or float, optional
        How to smooth the poses of a file.
    """

    parameters: Path | None
    motion_file: Path | None
    samples: int | None
    payload: Body | None
    wrench_file: Path | None
    on_invalid: str = "raise"
    smooth: Smooth = None

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
            if self.smooth is not None:
                raise click.UsageError("--smooth belongs to the poses of a file, --motion")
            return paper_motion(1001 if self.samples is None else self.samples)
        motion = Motion.from_csv(source(self.motion_file), smooth=self.smooth)
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
        known, asked = self.history.since(self.motion.start).time, self.motion.time
        if known[0] > asked[0] or known[-1] < asked[-1]:
            say(
                f"the load is known from {known[0]:g} to {known[-1]:g} s, the motion takes place from "
                f"{asked[0]:g} to {asked[-1]:g} s: its first and last values are kept"
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
        smooth: Smooth,
        payload: Body | None,
        wrench_file: Path | None,
        **others: Any,
    ) -> Any:
        policy = {"on_invalid": others.pop("on_invalid")} if on_invalid else {}
        case = Case(parameters, motion_file, samples, payload, wrench_file, smooth=smooth, **policy)
        return command(case, **others)

    for option in reversed(_CASE):
        wrapped = option(wrapped)
    return wrapped
