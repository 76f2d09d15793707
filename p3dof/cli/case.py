"""Which machine makes which motion under which load, by the options of all that moves."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.errors import SampleError
from p3dof._base.samples import OnInvalid
from p3dof._base.time_series.smoothing import Smooth
from p3dof.cli.files import InputFile, console_beside, protect, source
from p3dof.cli.kinds import SMOOTH, Whole, as_one
from p3dof.cli.machine import PARAMETERS, PAYLOAD, machine_of, say_payloads
from p3dof.cli.output import progress_bar, say
from p3dof.machine.motion import Motion, WrenchHistory, paper_motion
from p3dof.machine.motion.core import load_along, natural_ramp
from p3dof.machine.parameters import Body
from p3dof.manipulator import Manipulator
from p3dof.methods import DEFAULT_METHOD, METHODS, InverseDynamics
from p3dof.methods.registry import prepare

if TYPE_CHECKING:
    from p3dof.analysis.load_friction import LoadFriction, LoadFrictionEffect
    from p3dof.analysis.reactions import AnyReactions, Choice, Stiffness

METHOD = click.option(
    "--method", type=click.Choice(METHODS), default=DEFAULT_METHOD, help="Method of inverse dynamics."
)
STIFFNESS = click.option(
    "--stiffness", type=InputFile(), help="Stiffness of joints and rods, and assembly errors (YAML)."
)
LOAD_FRICTION = click.option(
    "--load-friction", type=InputFile(), help="Load-dependent friction of guides, screws and hinges (YAML)."
)
_CASE = (
    PARAMETERS,
    click.option(
        "--motion",
        "motion_file",
        type=InputFile(),
        help="Motion file (CSV: t,y,z,theta[,ydot,...]); by default the paper's motion.",
    ),
    click.option(
        "--samples",
        type=Whole(2, 1_000_000),
        help="Number of samples of the paper's motion (by default 1001), or of the curve through the poses "
        "of a file (by default, as many as peaks and work need).",
    ),
    SMOOTH,
    PAYLOAD,
    click.option(
        "--wrench",
        "wrench_file",
        type=InputFile(),
        help="External load on the platform at P (CSV: t,fx,fy,fz,mx,my,mz); by default none.",
    ),
)
_ON_INVALID = click.option(
    "--on-invalid",
    type=click.Choice(("raise", "nan")),
    default="raise",
    help="At a sample that is out of reach or singular: stop with an error, or leave it NaN.",
)


@dataclass(frozen=True)
class Case:
    """A machine, its motion and its load, as the options name them; files are read when asked for."""

    parameters: Path | None  # files to read
    motion_file: Path | None
    samples: int | None  # of the paper's motion, or of the curve through the poses of a file
    payload: Body | None  # on the platform
    wrench_file: Path | None
    on_invalid: OnInvalid = "raise"  # what to do with invalid samples
    smooth: Smooth = None  # how to smooth the poses of a file

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

    def entered(self, ramp: float | None) -> tuple[Motion, WrenchHistory | None]:
        """Return the motion as a run enters it from rest, and the load by its place on the path."""
        chosen = natural_ramp(self.motion) if ramp is None else ramp
        load = None if self.history is None else load_along(self.history, self.motion, chosen)
        return self.motion.from_rest(chosen) if chosen else self.motion, load

    def _solved(
        self, what: str, compute: Callable[..., Any], *given: Any, **others: Any
    ) -> tuple[Any, float]:
        """Compute something over the motion, with a progress bar; return it, and the seconds that it took."""
        with progress_bar(what, len(self.motion)) as progress:
            start = time.perf_counter()
            found = compute(
                self.motion,
                *given,
                wrench=self.wrench,
                on_invalid=self.on_invalid,
                progress=progress,
                **others,
            )
            seconds = time.perf_counter() - start
        self.require_valid(getattr(found, "result", found).valid)
        return found, seconds

    def solve(self, method: str) -> tuple[InverseDynamics, float]:
        """Return the forces, and the seconds that they took."""
        prepare(self.robot.forces, self.motion, method)
        return self._solved(method, self.robot.inverse_dynamics, method=method)

    def load_friction(
        self, friction: LoadFriction, method: str, stiffness: Stiffness | None
    ) -> tuple[LoadFrictionEffect, float]:
        """Return the forces with friction by load, and the seconds that they took."""
        own = {"method": method, "stiffness": stiffness}
        return self._solved(method, self.robot.load_friction, friction, **own)

    def reactions(
        self,
        joints: Choice = "all",
        stiffness: Stiffness | None = None,
        load_friction: LoadFriction | None = None,
    ) -> AnyReactions:
        """Return the reactions of all joints."""
        own = {"stiffness": stiffness, "load_friction": load_friction}
        found: AnyReactions = self._solved("reactions", self.robot.reactions, joints, **own)[0]
        return found

    def console(self, *outputs: Path | None) -> Console:
        """Return where to print beside the outputs, after what the platform carries was said there."""
        console = console_beside(*outputs)
        say_payloads(console, self.robot.parameters, self.parameters, self.payload)
        return console

    def require_moment(self, option: str, moment: float | None) -> None:
        """Raise unless a time, if one is given, lies within the motion."""
        first, last = float(self.motion.time[0]), float(self.motion.time[-1])
        if moment is not None and not first <= moment <= last:
            raise click.BadParameter(
                f"expected a time of the motion, from {first:g} to {last:g} s, got {moment:g}",
                param_hint=option,
            )

    def require_valid(self, valid: np.ndarray[Any, np.dtype[np.bool_]]) -> None:
        """Raise unless some sample is valid."""
        if not valid.any():
            raise SampleError(
                f"no sample of the motion is within what the machine can do ({len(valid)} samples)"
            )


def stiffness_in(path: Path | None) -> Stiffness | None:
    """Return how joints and rods give way by a file, if there is one."""
    if path is None:
        return None
    from p3dof.analysis.reactions import read_stiffness

    return read_stiffness(source(path))


def load_friction_in(path: Path | None) -> LoadFriction | None:
    """Return friction that grows with loads by a file, if there is one."""
    if path is None:
        return None
    from p3dof.analysis.load_friction import read_load_friction

    return read_load_friction(source(path))


with_load = as_one("case", Case, *_CASE)
"""The options of a `Case`, and the case as the argument `case`."""
with_case = as_one("case", Case, *_CASE, _ON_INVALID)
"""Likewise, for a command that can leave samples out."""
