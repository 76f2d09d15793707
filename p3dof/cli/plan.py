"""`p3dof plan` and `p3dof fastest`: the motion of a task, and what it takes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from p3dof._base.checks import FloatArray, meant, shown
from p3dof._base.errors import InputError
from p3dof._base.files import together, write_table
from p3dof._base.quantities import FORCE, JERK, MASS, POWER, SPEED
from p3dof.cli.app import app
from p3dof.cli.case import METHOD
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import DURATION, FIGURE, Amount, Whole, as_one
from p3dof.cli.machine import DRIVE_STIFFNESS, PARAMETERS, machine_of
from p3dof.cli.output import in_options, print_plain, print_written, progress_bar, show
from p3dof.cli.work import CLEARANCE, SURROUNDINGS, surroundings_in
from p3dof.design.clearance import clearance_of, clearance_table
from p3dof.design.drives import GENERIC, Catalogue, ratings_table, read_catalogue, verdict
from p3dof.design.fastest import (
    MOST_NODES,
    NODES,
    SMOOTH_NODES,
    BestPath,
    best_path,
    best_path_table,
    drive_limits,
    fastest_plan,
    limits_of,
    sizing_table,
    tighter,
    within_limits,
)
from p3dof.design.forces_of_tasks import TaskForces, forces_of_task, limits_table, pieces_table
from p3dof.design.sizing import size_drives
from p3dof.design.tasks import FastestPlan, Plan, Task, read_task, write_task
from p3dof.design.tasks.task import MotionTask
from p3dof.design.vibration import (
    KINDS,
    Kind,
    modes_table,
    motor_references,
    shaped,
    shapers_of,
    swings_of,
    swings_table,
)
from p3dof.machine.motion import Motion, WrenchHistory
from p3dof.manipulator import Manipulator
from p3dof.methods import Method

_NAMED = 6  # drives that an error names
_OPTIONS = (
    click.argument("task_file", metavar="TASK", type=InputFile()),
    PARAMETERS,
    click.option(
        "--samples",
        type=Whole(2, 1_000_000),
        default=1001,
        help="Least number of samples between stops; dwells add a few.",
    ),
    METHOD,
    click.option(
        "--out",
        type=OutputFile("table"),
        help="Motion file to write (CSV), - for the standard output; for --motion of other commands.",
    ),
    click.option(
        "--wrench-out",
        type=OutputFile("table"),
        help="File to write the external load over the task to (CSV); for --wrench of other commands.",
    ),
    click.option(
        "--forces-out",
        type=OutputFile("table"),
        help="File to write forces, power and payload over the task to (CSV).",
    ),
    click.option(
        "--shape",
        type=click.Choice(tuple(KINDS)),
        help="Shape the motion so that it leaves little vibration at the stops, by the frequencies on "
        "drives of --drive-stiffness: two impulses (zv), or three, which bear wrong frequencies (zvd).",
    ),
    DRIVE_STIFFNESS,
    click.option(
        "--motors-out",
        type=OutputFile("table"),
        help="File to write motor references of elastic drives to (CSV); with --drive-stiffness.",
    ),
    SURROUNDINGS,
    CLEARANCE,
    FIGURE,
)


@dataclass(frozen=True)
class _Asked:
    """A task, a machine, and what is written of a plan, as the options name them."""

    task_file: Path
    parameters: Path | None
    samples: int  # least number of the ways
    method: Method
    out: Path | None
    wrench_out: Path | None
    forces_out: Path | None
    shape: Kind | None
    drive_stiffness: dict[str, float] | None  # of each drive [N/m]
    motors_out: Path | None
    surroundings: Path | None
    clearance: float | None  # least distance of all parts [m]
    figure: Path | None
    task_out: Path | None = None
    better_path: bool = False

    def opened(self, motions: bool = False) -> tuple[Task, Manipulator]:
        """Return task and machine, unless something that is read would be written over.

        Where `motions` are allowed too, a file of one stands for a task with its path.
        """
        if self.task_out is not None and not self.better_path:
            raise InputError("--task-out: expected with --best-path only")
        for option, value in (("--shape", self.shape), ("--motors-out", self.motors_out)):
            if value is not None and self.drive_stiffness is None:
                raise InputError(f"{option}: expected with --drive-stiffness, that of motors and screws")
        outputs = self.out, self.wrench_out, self.forces_out, self.figure, self.task_out, self.motors_out
        protect((self.task_file, self.parameters, self.surroundings), outputs)
        file = self.task_file
        task: Task
        if motions and file.suffix.lower() == ".csv":
            task = MotionTask(Motion.from_csv(source(file)), file.stem)
        else:
            task = read_task(source(file))
        robot = machine_of(self.parameters)
        task = task.on(robot.parameters.geometry)
        if self.wrench_out is not None and not any(waypoint.wrench.any() for waypoint in task.waypoints):
            raise InputError("--wrench-out: there is no external load in this task")
        return task, robot

    def told(
        self, task: Task, robot: Manipulator, made: Plan | BestPath, drive: Catalogue | None = None
    ) -> int:
        """Compute the forces of a plan, write its files and print its tables; return the exit code.

        A catalogue of one drive says by which the plan was made: it is sized.
        """
        out = self.out
        given = made.plan if isinstance(made, BestPath) else made
        planned = self._shaped(robot, given)
        with progress_bar("forces", len(planned.pieces)) as progress:
            found = forces_of_task(robot, planned, self.method, progress)
        plain = found if planned is given else forces_of_task(robot, given, self.method)
        elastic = []
        if self.drive_stiffness is not None:
            k = self._stiffness
            with (
                in_options({"drive_stiffness": "--drive-stiffness"}),
                progress_bar("vibration", 5) as progress,
            ):
                elastic = [modes_table(robot, plain.plan, found.plan, k)]
                swings = swings_of(robot, plain, found, k, self.shape, progress)
            elastic.append(swings_table(swings, found.plan))
        written = self._written(found, made)
        console = console_beside(out)
        machine, own = robot.parameters.limits, None
        if isinstance(given, FastestPlan):
            own = None if planned is given else given.limits
        elif task.limits:
            own = limits_of(robot, task)
        tables = [pieces_table(found), sizing_table(found, machine, own)]
        if isinstance(planned, FastestPlan):
            tables.append(limits_table(planned))
        if isinstance(made, BestPath):
            tables.append(best_path_table(made))
        tables += elastic
        near = None
        if self.surroundings is not None or self.clearance is not None:
            around = surroundings_in(self.surroundings)
            near = clearance_of(robot, found, around, required=self.clearance or 0.0)
            tables.append(clearance_table(near))
        sizing = None
        if drive is not None and found.possible:
            sizing = size_drives(robot, found, drive)[0]
            print_plain(console, f"{sizing.name} {verdict(sizing, lambda time: found.piece_at(time).name)}")
            tables.append(ratings_table(sizing, lambda time: found.piece_at(time).name))
        show(console, *tables, notes=True)
        if near is not None:
            print_plain(console, near.verdict)
        if not task.closed:
            print_plain(console, "the last pose of the task is not its first: it cannot be repeated")
        print_written(console, written)
        if out is not None and any(piece.payload is not None for piece in planned.pieces):
            print_plain(
                console,
                f"{out} has no payloads: commands that read it as --motion omit them; those that read the "
                "task include them (report, size, balance, reactions --task, bearings --task)",
            )
        kept = within_limits(found, machine, own)
        if not kept and planned is not given and within_limits(plain, machine, own):
            print_plain(console, "the shaped motion exceeds limits that the plain one keeps")
        return 0 if kept and (near is None or near.fits) and (sizing is None or sizing.fits) else 1

    def _written(self, found: TaskForces, made: Plan | BestPath) -> list[Path]:
        """Write the files that are asked for."""
        load = found.plan.wrench
        with together():
            others = [] if self.forces_out is None else [found.to_csv(self.forces_out)]
            if self.wrench_out is not None and load is not None:
                others.append(_write_load(load, self.wrench_out))
            if self.motors_out is not None:
                others.append(motor_references(found, self._stiffness).to_csv(self.motors_out))
            written = write_results(
                found.plan.motion.to_csv, self.out, self.figure, lambda plots: plots.task_figure(found)
            )
            written += others
            if self.task_out is not None and isinstance(made, BestPath):
                write_task(made.decided, self.task_out)
                written.append(self.task_out)
        return written

    @property
    def _stiffness(self) -> FloatArray:
        return np.array(list((self.drive_stiffness or {}).values()))

    def _shaped(self, robot: Manipulator, plan: Plan) -> Plan:
        """Return a plan with the shape that is asked for."""
        if self.shape is None:
            return plan
        with in_options({"drive_stiffness": "--drive-stiffness"}):
            return shaped(plan, shapers_of(robot, plan, self._stiffness, self.shape), self.samples)


_with_task = as_one("asked", _Asked, *_OPTIONS)


@app.command()
@_with_task
@DURATION
def plan(asked: _Asked, duration: float | None) -> int:
    """Plan the motion of a task file: from stop to stop, with blends, dwells, payloads and external loads.

    The tables list peak force, speed and power of each segment, and the utilisation of the tighter limits of
    machine and task, with time and place. Exit code 1 when a limit is exceeded, parts are nearer to each
    other than --clearance, or the machine cannot perform the motion.
    """
    task, robot = asked.opened()
    with in_options({"duration: ": "--duration: "}):
        given = task.plan(duration, asked.samples)
    return asked.told(task, robot, given)


@app.command()
@_with_task
@click.option("--max-force", "force", type=Amount(FORCE), help="Limit of the force of each actuator [N].")
@click.option("--max-speed", "speed", type=Amount(SPEED), help="Limit of the slider speeds [m/s].")
@click.option("--max-power", "power", type=Amount(POWER), help="Limit of the power of each actuator [W].")
@click.option(
    "--max-jerk",
    "jerk",
    type=Amount(JERK),
    help="Limit of the slider jerks [m/s³]; by default none: accelerations are discontinuous.",
)
@click.option("--max-nut-force", "nut_force", type=Amount(FORCE), help="Limit of the force of each nut [N].")
@click.option(
    "--reflected-mass",
    type=Amount(MASS, zero=True),
    help="Reflected mass of motor and screw at each slider [kg], counted in the force limit.",
)
@click.option(
    "--drive",
    "named",
    metavar="NAME",
    help="Drive of the catalogue, such as 'M400 + 16x10': limits are its torque-speed curve, speeds, power.",
)
@click.option(
    "--drives",
    "catalogue_file",
    type=InputFile(),
    help="Catalogue of motors, gears, screws and belts (YAML); by default generic sizes.",
)
@click.option(
    "--nodes",
    type=Whole(10, MOST_NODES),
    help=f"Grid intervals between two stops: more come nearer to the least time.  [default: {NODES}; "
    f"{SMOOTH_NODES} with --max-jerk]",
)
@click.option(
    "--best-path",
    "better_path",
    is_flag=True,
    help="Also optimise blends and waypoints within blend_range and tolerance of the file.",
)
@click.option(
    "--task-out", type=OutputFile("parameters"), help="Task file to write, with the best path (YAML)."
)
def fastest(
    asked: _Asked, nodes: int | None, named: str | None, catalogue_file: Path | None, **limits: float | None
) -> int:
    """Compute the time-optimal motion of a task file under limits of force, speed, power and jerk.

    TASK may be a motion file (CSV): its path is kept, and the durations of its rests.

    The limits are those of the task file and of the parameter file, the tighter; an option replaces them.
    They also hold between the grid points: a table lists the utilisation of each limit, and when it is
    active. With --drive the peak torque over speed, speeds and power of that drive are limits too, less its
    margins, and its rms torque, heat and lives are looked at as by 'size'. The files written are those of
    'plan'. Exit code 1 when another limit of the machine is exceeded, such as its stroke, or of the drive.
    """
    drive = _chosen_drive(named, catalogue_file)
    if drive is not None and limits["reflected_mass"] is not None:
        raise InputError("--reflected-mass: the drive has its own (--drive)")
    task, robot = asked.opened(motions=True)
    chosen = limits_of(robot, task, **limits)
    if drive is not None:
        chosen = tighter(chosen, drive_limits(robot, next(iter(drive)), drive.margins))
    own: dict[str, Any] = {"nodes": nodes, "samples": asked.samples}
    made: Plan | BestPath
    if asked.better_path:
        with progress_bar("paths", 1) as progress:
            made = best_path(robot, task, chosen, progress=progress, **own)
    else:
        with progress_bar("ways", len(task.paths)) as progress:
            made = fastest_plan(robot, task, chosen, progress=progress, **own)
    return asked.told(task, robot, made, drive)


def _chosen_drive(name: str | None, file: Path | None) -> Catalogue | None:
    """Return a catalogue of the one drive that has a name, or that there is."""
    if name is None and file is None:
        return None
    catalogue = GENERIC if file is None else read_catalogue(source(file))
    drives = {drive.name: drive for drive in catalogue}
    if name is None and len(drives) > 1:
        raise InputError(f"--drives: expected --drive with it, one of {_some(drives)}")
    if name is not None and name not in drives:
        raise InputError(f"--drive: expected one of {_some(drives)}{meant(name, drives)}, got {shown(name)}")
    one = drives[name] if name is not None else next(iter(drives.values()))
    return replace(catalogue, motors=[one.motor], transmissions=[one.transmission], gears=[one.gear], axes={})


def _some(names: Iterable[str]) -> str:
    """Return the first names, and how many more there are."""
    every = list(names)
    more = f" and {len(every) - _NAMED} more" if len(every) > _NAMED else ""
    return ", ".join(every[:_NAMED]) + more


def _write_load(load: WrenchHistory, path: Path) -> Path:
    header = ["t", "fx", "fy", "fz", "mx", "my", "mz"]
    return write_table(path, header, (load.time, *load.wrench.T))
