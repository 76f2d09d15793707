"""`p3dof balance`: the counterbalance, spring or counterweight that spares the actuators most."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

import click

from p3dof._base.errors import InputError
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import POSITIVE, Payload, Whole
from p3dof.cli.machine import PARAMETERS, machine_of
from p3dof.cli.options import FIGURE, METHOD, Case
from p3dof.cli.output import print_plain, show
from p3dof.design.balance import OBJECTIVES, BalanceKind, Objective, balance_table, best_balance
from p3dof.design.forces_of_tasks import TaskForces, forces_of_task
from p3dof.design.tasks import read_task
from p3dof.machine.parameters import Body, write_parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics, Method

_ALL = "all"
_TASKS = (".yaml", ".yml")


@app.command()
@click.argument("file", metavar="[MOTION_OR_TASK]", required=False, type=InputFile())
@PARAMETERS
@click.option(
    "--kind",
    type=click.Choice((*get_args(BalanceKind), _ALL)),
    default=_ALL,
    show_default=True,
    help="What balances: a constant force, a spring with a force at home, a counterweight.",
)
@click.option(
    "--objective",
    type=click.Choice(OBJECTIVES),
    default="rms",
    show_default=True,
    help="What is to be least: the root mean square of the forces, or their peak.",
)
@click.option("--payload", type=Payload(), help="Point mass on the platform, as of 'p3dof forces'.")
@click.option("--wrench", "wrench_file", type=InputFile(), help="External load over a motion (CSV).")
@click.option("--samples", type=Whole(2, 1_000_000), help="Samples of the paper's motion or of a task.")
@click.option("--duration", type=POSITIVE, help="Time of a whole task, dwells included [s].")
@METHOD
@click.option(
    "--out", type=OutputFile("parameters"), help="Parameter file to write: the machine with it (YAML)."
)
@FIGURE
def balance(
    file: Path | None,
    parameters: Path | None,
    kind: str,
    objective: Objective,
    payload: Body | None,
    wrench_file: Path | None,
    samples: int | None,
    duration: float | None,
    method: Method,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Find the balance of each slider that leaves its actuator the least to do.

    For a motion file (CSV), a task file (YAML) with its waits and payloads, or the paper's motion. What the
    machine has of the same kind already is replaced. --out writes the machine with the balance of --kind.
    """
    protect((file, parameters, wrench_file), (out, figure))
    if kind == _ALL and (out, figure) != (None, None):
        raise click.UsageError("--out and --figure show one balance: choose it with --kind")
    if file is not None and file.suffix.lower() in _TASKS:
        if wrench_file is not None:
            raise click.UsageError("--wrench belongs to a motion; a task has its loads in its file")
        robot = machine_of(parameters, payload)
        plan = read_task(source(file)).plan(duration, 1001 if samples is None else samples)
        found: InverseDynamics | TaskForces = forces_of_task(robot, plan, method)
    else:
        robot, found = _moved(Case(parameters, file, samples, payload, wrench_file), duration, method)
    kinds = get_args(BalanceKind) if kind == _ALL else (kind,)
    best = [best_balance(robot, found, cast(BalanceKind, one), objective) for one in kinds]
    console = console_beside(out)
    show(console, *(balance_table(one) for one in best), notes=True)
    from p3dof.report import plots

    def save(path: Path) -> Path:
        own = machine_of(parameters).parameters  # what the option adds is no part of the machine
        write_parameters(replace(own, actuators=best[0].actuators), path)
        return path

    for path in write_results(save, out, lambda: plots.balance_figure(best[0]), figure):
        print_plain(console, f"wrote {path}")
    return 0


def _moved(case: Case, duration: float | None, method: Method) -> tuple[Manipulator, InverseDynamics]:
    """Return a machine and its forces over a motion."""
    if duration is not None:
        raise click.UsageError("--duration belongs to a task; a motion has its own times")
    result, _ = case.solve(method)
    if not result.possible:
        raise InputError("the machine cannot make this motion")
    return case.robot, result
