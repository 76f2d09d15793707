"""`p3dof reactions`: what the bearings and guides of every joint have to bear over a motion."""

from __future__ import annotations

from pathlib import Path

import click

from p3dof.analysis.reactions import JOINTS as ALL_JOINTS
from p3dof.analysis.reactions import Choice, how_chosen, open_tables, reactions_table
from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, JOINTS, Case, with_case
from p3dof.cli.output import print_plain, print_warnings, show
from p3dof.cli.payloads import print_payloads
from p3dof.cli.task_loads import JointLoads, with_joint_loads

_KEY = "\n".join(f"  {joint.label}  {joint.name:15} {joint.meaning}" for joint in ALL_JOINTS)


@app.command(epilog=f"\b\nJoints: in the drawing, in tables and files, and what they are\n{_KEY}")
@with_case
@with_joint_loads
@JOINTS
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for the reactions of all joints in all samples.",
)
@FIGURE
def reactions(loads: JointLoads, joints: Choice, out: Path | None, figure: Path | None) -> int:
    """Compute the forces and moments in all joints over a motion: peaks on the screen, samples in a file.

    Loads that rigid bodies leave open (~) are those of elastic joints and rods, with the stiffness of
    --stiffness or a guessed one; apart from them is what two idealisations would say, which are no bounds.

    Exit code 1 when the machine cannot make the motion: there are no peaks then.
    """
    loads.protect(out, figure)
    case, result = loads.case, loads.reactions(joints)
    from p3dof.report import plots

    written = write_results(result.to_csv, out, lambda: plots.reactions_figure(result), figure)
    console = console_beside(out)
    print_payloads(console, case)
    show(console, reactions_table(result), notes=True)
    show(console, *(table for table in open_tables(result) if table.rows))
    print_plain(console, how_chosen(result))
    if loads.plan is None:
        print_warnings(console, _warnings(case))
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1


def _warnings(case: Case) -> tuple[str, ...]:
    """Return what there is to know about the motion."""
    known = case.robot.inverse_dynamics(
        case.motion,
        method="virtual-power",
        wrench=case.wrench,
        on_invalid=case.on_invalid,  # type: ignore[arg-type]  # one of two, as the options say
    )
    return known.warnings
