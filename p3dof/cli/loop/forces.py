"""`p3dof loop forces`: what the actuators of any robot must do along a motion."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import Whole
from p3dof.cli.loop.control import EXTERNAL, METHOD, externals
from p3dof.cli.loop.group import loop, with_robot
from p3dof.cli.loop.motion import Forces, forces_along
from p3dof.cli.options import SMOOTH
from p3dof.cli.output import print_plain, show
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import actuators_table, motors_table
from p3dof.machine.motion.smoothing import Smooth

MOTION = click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    required=True,
    help="Motion of the actuated joints (CSV: t and the names of all of them, each perhaps with its unit, as "
    "in 'crank [deg]').",
)


@loop.command()
@with_robot
@MOTION
@click.option(
    "--samples",
    type=Whole(2, 100_000),
    help="Samples of the curve through the values of the file; as many as peaks need, without it.",
)
@SMOOTH
@EXTERNAL
@click.option(
    "--equilibrium",
    is_flag=True,
    help="Start idle freedoms where gravity and springs let them rest; else they start at rest as assembled.",
)
@METHOD
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for joints and forces at all samples.",
)
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
    """Compute the forces of the actuated joints over a motion: peaks on the screen, all samples in a file.

    Joints that no actuator holds move as they must. Exit code 1 when the robot cannot make the motion.
    """
    protect([*inputs, motion_file], [out])
    found: Forces = forces_along(
        robot, source(motion_file), samples, externals(external), equilibrium, method, smooth
    )
    written = write_results(found.to_csv, out)
    console = console_beside(out)
    motors = motors_table(robot, found.tau, found.v)
    show(console, actuators_table(robot, found.time, found.tau, found.v), *([motors] if motors else []))
    for remark in found.remarks:
        print_plain(console, remark)
    print_plain(console, f"{len(found.time)} samples of the curve through the values of the file.")
    print_plain(console, f"Largest gap {found.gap:.1e} m or rad, residual {found.residual:.1e} N or N m.")
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0
