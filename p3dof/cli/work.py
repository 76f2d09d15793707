"""The options that say what a machine has to do and with which parts: shared by reports and comparisons."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from p3dof._base.errors import P3dofError, ParameterError, TaskError
from p3dof._base.files import called
from p3dof._base.quantities import LENGTH
from p3dof.analysis.reactions import Stiffness
from p3dof.cli.case import LOAD_FRICTION, load_friction_in
from p3dof.cli.files import InputFile, protect, source
from p3dof.cli.kinds import DURATION, FROM_ZERO, POSITIVE, Amount, as_one
from p3dof.cli.output import in_options, progress_bar
from p3dof.design.assessment import Assessment, assess
from p3dof.design.bearings import read_bearings
from p3dof.design.clearance import Clearance, Surroundings, read_surroundings
from p3dof.design.drives import RequiredLife, read_catalogue, required_life
from p3dof.design.drives.sizing import BRAKE_SAFETY
from p3dof.design.fastest import fastest_plan
from p3dof.design.forces_of_tasks import TaskForces, forces_of_task
from p3dof.design.tasks import AxisLimits, Plan, Task, read_task
from p3dof.machine.parameters import read_parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.methods.registry import Method

SAMPLES = 2001
"""Least number of samples of a planned task."""

REST = click.option("--rest", type=FROM_ZERO, default=0.0, help="Time at rest after each cycle [s].")
BRAKE = click.option(
    "--brake-safety", type=POSITIVE, default=BRAKE_SAFETY, help="Safety factor of holding brakes."
)
SURROUNDINGS = click.option(
    "--surroundings",
    type=InputFile(),
    help="Payload, obstacles and sizes of parts (YAML), for the least distances of all parts.",
)
CLEARANCE = click.option(
    "--clearance",
    type=Amount(LENGTH, zero=True),
    help="Least distance that all parts must keep, such as '5 mm'; 0 for none that overlap.",
)
PER_AXIS = click.option("--per-axis", is_flag=True, help="Choose the drive of each axis on its own.")
STOPS = click.option("--stops", is_flag=True, help="Also compute emergency stops at all instants.")
LIFE = click.option(
    "--life",
    help="Required life of ball nuts, bearings and guides, such as '20000 h', '1e7 cycles' or '5000 km'.",
)
FRICTIONLESS = click.option(
    "--frictionless",
    is_flag=True,
    help="Size drives without the usual friction of guides, where none is given.",
)
_OPTIONS = (
    click.option("--drives", type=InputFile(), help="Catalogue of motors, gears, screws and belts (YAML)."),
    click.option(
        "--bearings", type=InputFile(), help="Ratings of bearings and guides (YAML), for their life."
    ),
    LOAD_FRICTION,
    DURATION,
    click.option(
        "--fastest",
        is_flag=True,
        help="Plan the time-optimal motion of the task within the limits of the machine.",
    ),
    REST,
    BRAKE,
    PER_AXIS,
    LIFE,
    FRICTIONLESS,
)


@dataclass(frozen=True)
class Work:
    """What a machine has to do it with, as the options name it."""

    drives: Path | None  # files to read
    bearings: Path | None
    load_friction: Path | None
    duration: float | None  # of tasks [s]
    fastest: bool  # whether tasks are done as fast as the limits allow
    rest: float  # after each cycle [s]
    brake_safety: float  # of holding brakes
    per_axis: bool  # whether the axes may have different drives
    life: str | None  # that is required
    frictionless: bool  # whether guides have no friction but what is given

    @property
    def asks(self) -> bool:
        """Whether anything is asked of a machine besides its forces."""
        return any((self.drives, self.bearings, self.load_friction, self.duration, self.fastest, self.rest))

    @property
    def options(self) -> dict[str, Any]:
        """The options that differ from what they are without."""
        return {
            "--drives": self.drives,
            "--bearings": self.bearings,
            "--load-friction": self.load_friction,
            "--duration": self.duration,
            "--fastest": self.fastest or None,
            "--rest": self.rest or None,
            "--brake-safety": None if self.brake_safety == BRAKE_SAFETY else self.brake_safety,
            "--per-axis": self.per_axis or None,
            "--life": self.life,
            "--frictionless": self.frictionless or None,
        }

    def protect(
        self, task: Path | None, inputs: Iterable[Path | None], outputs: Iterable[Path | None]
    ) -> None:
        """Refuse to write over a file that is read, and settings that exclude each other."""
        protect((task, self.drives, self.bearings, self.load_friction, *inputs), outputs)
        if self.fastest and self.duration is not None:
            raise click.UsageError("--duration: the fastest motion has its own (--fastest)")

    @property
    def required(self) -> RequiredLife | None:
        """The life that is required."""
        return required_life(self.life, "--life")

    def refuse_plans(self, reason: str) -> None:
        """Refuse options of plans where there is nothing to plan."""
        for option in ("--duration", "--fastest"):
            if self.options[option] is not None:
                raise click.UsageError(f"{option}: {reason}")

    def forces(
        self, robot: Manipulator, task: Task, stiffness: Stiffness | None, samples: int | None = None
    ) -> TaskForces:
        """Return the forces over a task, in the time that is given or the least."""
        friction = load_friction_in(self.load_friction)
        method: Method = "compiled" if friction is None else "virtual-power"
        count = SAMPLES if samples is None else samples
        task = task.on(robot.parameters.geometry)
        plan: Plan
        if self.fastest:
            with progress_bar("ways", len(task.paths)) as progress:
                plan = fastest_plan(robot, task, samples=count, progress=progress)
        else:
            with in_options({"duration: ": "--duration, or --fastest: "}):
                plan = task.plan(self.duration, count)
        with progress_bar("forces", len(plan.pieces)) as progress:
            return forces_of_task(robot, plan, method, progress, friction, stiffness)

    def assessed(
        self,
        robot: Manipulator,
        found: InverseDynamics | TaskForces,
        stiffness: Stiffness | None,
        name: str,
        limits: AxisLimits | None = None,
        clearance: Clearance | None = None,
        stops: bool = False,
    ) -> Assessment:
        """Return whether a machine fits what it has to do."""
        catalogue = None if self.drives is None else read_catalogue(source(self.drives))
        parts = None if self.bearings is None else read_bearings(source(self.bearings))
        with progress_bar("drives", 0 if catalogue is None else len(catalogue)) as progress:
            return assess(
                robot,
                found,
                drives=catalogue,
                bearings=parts,
                stiffness=stiffness,
                limits=limits,
                rest=self.rest,
                brake_safety=self.brake_safety,
                per_axis=self.per_axis,
                stops=stops,
                life=self.required,
                frictionless=self.frictionless,
                name=name,
                clearance=clearance,
                progress=progress,
            )


with_work = as_one("work", Work, *_OPTIONS)
"""The options of a `Work`, and these as the argument `work`."""


def surroundings_in(path: Path | None) -> Surroundings | None:
    """Return what stands around a machine, if a file says so."""
    return None if path is None else read_surroundings(source(path))


def task_named(path: Path) -> Task:
    """Return the task of a file; of a file of a machine, say that it is one."""
    try:
        return read_task(source(path))
    except TaskError as error:
        if _is_machine(path):
            name = called(path)
            raise TaskError(
                f"{name}: expected a task, got the parameters of a machine: --parameters takes them"
            ) from error
        raise


def _is_machine(path: Path) -> bool:
    try:
        read_parameters(path, any_size=True)
    except (P3dofError, ParameterError):
        return False
    return True
