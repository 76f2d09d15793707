"""`p3dof loop simulate`: any robot in time, under a controller, constant forces or none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import click
import numpy as np
from click.core import ParameterSource

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MOMENT, ROTATION, SPEED
from p3dof._base.tables import Table, formatted, number
from p3dof._base.time_series.times import evenly
from p3dof.cli.app import FAILED
from p3dof.cli.control import DAMPING, FREQUENCY, RATE, Feedback, actuation, time_limit
from p3dof.cli.files import InputFile, console_beside, protect, save_figure_if_possible, source, write_results
from p3dof.cli.kinds import FIGURE, SECONDS, Amount, Whole, as_one, require_unit, table_out
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import (
    AT,
    EXTERNAL,
    assembled,
    exceeded,
    externals,
    force_option,
    forces_of,
    numbers_of,
    with_robot,
)
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, progress_bar, show
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled.kept import ROBOT_METHODS
from p3dof.loops.tables import doubtful_bodies, joint_values, units_of_actuated
from p3dof.runs import (
    ROBOT_KINDS,
    ControlLoop,
    Integration,
    JointComputedTorque,
    JointPD,
    JointReference,
    RobotController,
    RobotRun,
    gains,
    moved_inertia,
    simulate_robot,
)
from p3dof.runs.settings import EDGE

NONE, PD, COMPUTED_TORQUE = "none", "pd", "computed-torque"

_LIMITS = {"stop": ROBOT_KINDS, "ignore": tuple(kind for kind in ROBOT_KINDS if kind != "joint limit")}

_WORDS = {
    "external: ": "--external: ",
    "q: the run would start": "the run would start",
    "(see stop_at)": "(see --limits)",
    "a longer max_step, ": "",
    "the method 'compiled'": "--method compiled",
    "allow it by time_limit": "allow it by --time-limit",
}
"""What arguments of Python are here."""


_OPTIONS_OF_CONTROL = (
    click.option(
        "--controller",
        type=click.Choice((NONE, PD, COMPUTED_TORQUE)),
        default=NONE,
        help="PD control of the actuated joints with gravity compensation, computed torque (by hybrid "
        "dynamics where degrees of freedom are uncontrolled), or none: --actuator-force acts.",
    ),
    click.option(
        "--kp",
        help="Position gains, one or one an actuated joint, with commas: of pd [N/m, N m/rad], of "
        "computed-torque [1/s^2]; by default from --frequency.",
    ),
    click.option(
        "--kd",
        help="Velocity gains, likewise: of pd [N s/m, N m s/rad], of computed-torque [1/s]; by default from "
        "--frequency and --damping.",
    ),
    FREQUENCY,
    DAMPING,
    click.option(
        "--motion",
        "motion_file",
        type=InputFile(),
        help="Motion of the actuated joints to follow, as for 'loop forces'; the robot starts on it, or at "
        "rest at --set. By default, the controller holds the initial position.",
    ),
    RATE,
    click.option(
        "--saturation",
        type=Amount(FORCE, MOMENT, words={"file": True}),
        metavar="FORCE|file",
        help="Saturation of the actuator forces [N or N m], or 'file' for the effort limits in the file of "
        "the robot; by default unlimited.",
    ),
    actuation((LENGTH, ANGLE), (SPEED, ROTATION)),
)


_OF_CONTROLLERS = ("kp", "kd", "frequency", "damping", "rate")


@dataclass(frozen=True)
class Control(Feedback):
    """What the options say."""

    controller: str  # its name
    kp: str | None  # gains
    kd: str | None
    motion_file: Path | None  # what to follow

    @property
    def acting(self) -> ControlLoop:
        """How the controller acts."""
        if self.controller == NONE:
            asked = click.get_current_context().get_parameter_source
            told = [f"--{name}" for name in _OF_CONTROLLERS if asked(name) == ParameterSource.COMMANDLINE]
            for option in (*told, *self.measuring):
                raise InputError(f"{option}: needs a --controller")
        return self.loop(self.controller != NONE)

    def require_units(self, robot: ClosedLoopModel) -> None:
        """Raise where a number has a unit that the actuated joints have not."""
        positions, forces = zip(*units_of_actuated(robot), strict=True) if robot.actuated else ((), ())
        require_unit("--saturation", self.saturation, forces)
        require_unit("--resolution", self.resolution, positions)
        if self.noise is not None:
            require_unit("--noise", self.noise[0], positions)
            require_unit("--noise", self.noise[1], [f"{unit}/s" for unit in positions])

    def reference(self, robot: ClosedLoopModel) -> JointReference | None:
        """Return the motion to follow."""
        if self.motion_file is None:
            return None
        if self.controller == NONE:
            raise InputError("--motion: needs a --controller that follows it")
        if not robot.actuated:
            raise InputError("--motion: the robot has no actuated joints")
        return JointReference.from_csv(robot, source(self.motion_file))

    @in_options({"--k": "k", "kp: ": "--kp: ", "kd: ": "--kd: "})
    def of(
        self,
        robot: ClosedLoopModel,
        q: FloatArray,
        reference: JointReference,
        compiled: CompiledLoop | None = None,
    ) -> JointPD:
        """Return the controller, for a start at a configuration (nq,)."""
        if not robot.actuated:
            raise InputError(f"--controller {self.controller}: the robot has no actuated joints")
        computed = self.controller == COMPUTED_TORQUE
        own = gains(self.frequency, self.damping)
        scale = np.ones(1) if computed or None not in (self.kp, self.kd) else moved_inertia(robot, q)
        kp = own[0] * scale if self.kp is None else numbers_of("--kp", self.kp)
        kd = own[1] * scale if self.kd is None else numbers_of("--kd", self.kd)
        if computed:
            return JointComputedTorque(robot, reference, kp, kd, compiled)
        return JointPD(robot, reference, kp, kd, gravity=True, compiled=compiled)


@loop.command()
@with_robot
@AT
@force_option()
@as_one("control", Control, *_OPTIONS_OF_CONTROL)
@EXTERNAL
@click.option(
    "--limits",
    type=click.Choice(tuple(_LIMITS)),
    default="stop",
    help="At a joint limit in the file of the robot: end the simulation, or ignore it.",
)
@click.option(
    "--duration", type=SECONDS, help="Duration of the simulation [s]; by default that of the motion, or 1."
)
@click.option("--samples", type=Whole(2, 1_000_000), default=1001, help="Number of samples to keep.")
@time_limit("the simulation")
@click.option(
    "--method",
    type=click.Choice(list(ROBOT_METHODS)),
    help="Dynamics by Pinocchio, or by C code compiled for the robot (needs gcc or clang); by default "
    "compiled if the whole simulation can be.",
)
@table_out("joint positions, velocities, actuator forces and energy")
@click.option("--multipliers", is_flag=True, help="Also write the closure forces to the CSV file.")
@FIGURE
def simulate(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    forces: tuple[str, ...],
    control: Control,
    external: tuple[str, ...],
    limits: str,
    duration: float | None,
    samples: int,
    time_limit: float,
    method: Literal["general", "compiled"] | None,
    out: Path | None,
    multipliers: bool,
    figure: Path | None,
) -> int:
    """Simulate a robot, under control or constant actuator forces.

    Exit code 1 when the loops do not close at the start, or the simulation ends early.
    """
    protect([*inputs, *([] if control.motion_file is None else [control.motion_file])], [out, figure])
    if multipliers and out is None:
        raise click.UsageError("--multipliers needs --out")
    if forces and control.controller != NONE:
        raise click.UsageError("--actuator-force and --controller exclude each other")
    control.require_units(robot)
    loads, wanted = externals(external), control.reference(robot)
    q, v = _start(robot, values, wanted)
    compile_ = None if method is None else ROBOT_METHODS[method]
    compiled = None if compile_ is None else compile_(robot, q, loads)
    if control.controller == NONE:
        acting: RobotController = forces_of(robot, forces)
    else:
        acting = control.of(robot, q, wanted or JointReference.standing(_actuated(robot, q)), compiled)
    if duration is None:
        duration = wanted.duration if wanted is not None and wanted.duration else 1.0
    settings = Integration(rtol=1e-9, atol=1e-11, time_limit=time_limit)
    asked = evenly(0.0, duration, samples)
    times = _looked_at(asked, control.acting)
    with in_options(_WORDS), progress_bar("run", len(times)) as progress:
        run = simulate_robot(
            robot,
            duration,
            q,
            v,
            acting,
            control=control.acting,
            external=loads,
            stop_at=_LIMITS[limits],
            samples=times,
            integration=settings,
            progress=progress,
            method=method if compiled is None else compiled,
        )
    written = write_results(partial(_sampled(run, asked).save, multipliers=multipliers), out)
    written += save_figure_if_possible(lambda plots: plots.robot_run_figure(run), figure)
    console = console_beside(out)
    show(console, _table(run, control.acting))
    told = [*doubtful_bodies(robot), *exceeded(run.exceedances())]
    print_warnings(console, told if run.stop is None else [f"ended by {run.stop}", *told])
    if run.note:
        print_plain(console, run.note)
    print_written(console, written)
    return 0 if run.finished else FAILED


def _start(
    robot: ClosedLoopModel, values: tuple[str, ...], wanted: JointReference | None
) -> tuple[FloatArray, FloatArray]:
    """Return configuration and velocity of the start: at rest where it was set, or as the motion starts."""
    if wanted is None or values:
        return assembled(robot, values).q, np.zeros(robot.model.nv)
    state = robot.complete(*wanted.at(0.0), robot.assemble().q)
    return state.q, state.v


def _actuated(robot: ClosedLoopModel, q: FloatArray) -> FloatArray:
    held = joint_values(robot, q)
    return np.array([float(held[name][0]) for name in robot.actuated])


_FINE, _LAGGING = 1000, 8  # looks at forces that change all the time, in a run or in a period
_MOST = 200_000  # looks, at most


def _looked_at(asked: FloatArray, control: ControlLoop) -> FloatArray:
    """Return times of samples with those at which forces change, which peaks and work depend on."""
    period, parts = control.period or asked[-1] / _FINE, _LAGGING if control.drives(1) is not None else 1
    if not 0 < asked[-1] * parts <= _MOST * period:
        return asked
    changes = period * (np.arange(parts * math.ceil(asked[-1] / period)) / parts + control.lateness[1])
    times = np.sort(np.concatenate([asked, changes[changes < asked[-1]]]))
    times = times[np.append(True, np.diff(times) > EDGE * period)]
    times[-1] = asked[-1]
    return np.asarray(times)


def _sampled(run: RobotRun, asked: FloatArray) -> RobotRun:
    """Return a run at the samples that were asked for, and at its end."""
    after = np.searchsorted(run.time, asked).clip(1, len(run) - 1)
    rows = np.unique(after - (asked - run.time[after - 1] < run.time[after] - asked))
    arrays = ("time", "q", "v", "a", "forces", "asked", "gap", "energy", "reference")
    kept = {name: value[rows] for name in arrays if (value := getattr(run, name)) is not None}
    return replace(run, **kept, external={name: wrench[rows] for name, wrench in run.external.items()})


def _work(run: RobotRun, control: ControlLoop) -> float:
    """Return the work of the actuators [J]; NaN where samples miss changes of held forces."""
    later: float | FloatArray = 0.5  # the weight of the force at the end of a step in its mean
    if control.rate:
        if np.diff(run.time).max(initial=0.0) > (1 + EDGE) * control.period:
            return math.nan
        drives = control.drives(len(run.loop.actuated))
        steps = 2 * math.pi * np.outer(np.diff(run.time), math.inf if drives is None else drives)
        later = np.where(np.isinf(steps), 0.0, -1 / np.expm1(-steps) - 1 / steps)  # held, or a lag
    forces = run.forces[:-1] + later * np.diff(run.forces, axis=0)
    return float(np.sum(forces * np.diff(run.actuated, axis=0)))


def _table(run: RobotRun, control: ControlLoop) -> Table:
    rows = [
        ("time", number(float(run.time[-1]), "s")),
        ("method", run.method),
        ("energy gained", number(float(run.energy[-1] - run.energy[0]), "J")),
        ("work of the actuators", number(_work(run, control), "J")),
        ("largest force of an actuator", number(float(np.abs(run.forces).max(initial=0.0)), "N or N m")),
        ("largest speed of a joint", number(float(np.abs(run.v).max(initial=0.0)), "m/s or rad/s")),
        ("largest gap of a loop", formatted(run.gap.max(initial=0.0), ".1e", "m or rad")),
    ]
    if run.error is not None:
        error = formatted(np.abs(run.error).max(), ".3g", "m or rad")
        rows.insert(1, ("largest error of an actuated joint", error))
    return Table("Run", ("", "value"), tuple(rows), layout="words")
