"""`p3dof loop forces`: what the actuators of any robot must do along a motion."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from p3dof._base.time_series.smoothing import Smooth
from p3dof.cli.app import FAILED
from p3dof.cli.files import InputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import SMOOTH, Whole, table_out
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import EXTERNAL, METHOD, exceeded, externals, with_robot
from p3dof.cli.output import print_plain, print_warnings, print_written, progress_bar, show
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import actuators_table, doubtful_bodies, motors_table
from p3dof.runs.forces_along import forces_along


@loop.command()
@with_robot
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    required=True,
    help="Motion of the actuated joints (CSV: t and their names, with units if not SI: 'crank [deg]').",
)
@click.option(
    "--samples",
    type=Whole(2, 100_000),
    help="Number of samples of the curve through the values of the file (by default, as many as peaks need).",
)
@SMOOTH
@EXTERNAL
@click.option(
    "--equilibrium",
    is_flag=True,
    help="Start uncontrolled degrees of freedom in static equilibrium; by default at rest as assembled.",
)
@METHOD
@table_out("joint motion and actuator forces at all samples")
def forces(
    robot: ClosedLoopModel,
    inputs: list[Path],
    motion_file: Path,
    samples: int | None,
    smooth: Smooth,
    external: tuple[str, ...],
    equilibrium: bool,
    method: Literal["general", "compiled"],
    out: Path | None,
) -> int:
    """Compute the actuator forces of a robot over a motion: prints peaks, writes all samples.

    Uncontrolled degrees of freedom move by their dynamics. Exit code 1 when the robot cannot perform the
    motion: its loops do not close, closures become dependent, or a joint leaves its limits.
    """
    protect([*inputs, motion_file], [out])
    found = forces_along(
        robot, source(motion_file), samples, externals(external), equilibrium, method, smooth, progress_bar
    )
    written = write_results(found.to_csv, out)
    console = console_beside(out)
    motors = motors_table(robot, found.forces, found.v)
    show(console, actuators_table(robot, found.time, found.forces, found.v), *([motors] if motors else []))
    stop, beyond = found.crossing(), found.exceedances()
    told = doubtful_bodies(robot)
    if not any(body.mass for body in robot.model.inertias):
        told = ["all bodies are without mass"]
    print_warnings(console, [*told, *([] if stop is None else [str(stop)]), *exceeded(beyond)])
    for remark in found.remarks:
        print_plain(console, remark)
    print_plain(console, f"{len(found.time)} samples of the curve through the values of the file.")
    print_plain(console, f"Largest gap {found.gap:.1e} m or rad, residual {found.residual:.1e} N or N m.")
    print_written(console, written)
    return 0 if stop is None and all(one.quantity != "position" for one in beyond) else FAILED
