"""`p3dof plots`: all figures of a motion in one folder."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.console import Console

from p3dof._base.files import SUFFIXES, together
from p3dof.cli.app import app
from p3dof.cli.files import OutputFolder
from p3dof.cli.options import Case, with_case
from p3dof.cli.output import print_plain, print_warnings
from p3dof.cli.payloads import print_payloads
from p3dof.methods import InverseDynamics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = tuple(suffix.lstrip(".") for suffix in SUFFIXES["figure"])
FIGURES = ("forces", "joints", "energy", "reactions", "mechanism")


class Drawings:
    """The figures of a case; what several of them need is computed once.

    Parameters
    ----------
    case : Case
        Machine, motion and load.
    at : float, optional
        When the mechanism is drawn [s]; at the first valid sample by default.
    """

    def __init__(self, case: Case, at: float | None = None) -> None:
        self._case, self._at = case, at

    def figure(self, name: str) -> Figure:
        """Draw one of `FIGURES`."""
        figure: Figure = getattr(self, name)()
        return figure

    @cached_property
    def by_pinocchio(self) -> InverseDynamics:
        """Forces and joints by Pinocchio."""
        return self._case.solve("pinocchio")[0]

    @cached_property
    def by_virtual_power(self) -> InverseDynamics:
        """Forces and joints by virtual powers."""
        return self._case.solve("virtual-power")[0]

    def forces(self) -> Figure:
        """Draw the forces by both methods, and their difference."""
        from p3dof.report import plots

        return plots.forces_figure([self.by_pinocchio, self.by_virtual_power])

    def joints(self) -> Figure:
        """Draw positions, velocities and accelerations of all joints."""
        from p3dof.report.plots.joints import joints_figure

        return joints_figure(self.by_pinocchio)

    def energy(self) -> Figure:
        """Draw energy, work and power."""
        from p3dof.report import plots

        return plots.energy_figure(self._case.robot.energy(self.by_pinocchio))

    def reactions(self) -> Figure:
        """Draw the reactions of all joints."""
        from p3dof.report import plots

        return plots.reactions_figure(self._case.reactions())

    def mechanism(self) -> Figure:
        """Draw the mechanism with the path of P."""
        from p3dof.report.plots.mechanism import mechanism_figure

        motion = self._case.motion
        if self._at is None:
            row = int(np.argmax(self.by_virtual_power.valid))
        else:
            row = int(np.argmin(np.abs(motion.time - self._at)))
        return mechanism_figure(self._case.robot, motion.pose[row], motion)


@app.command("plots")
@with_case
@click.option(
    "--out",
    type=OutputFolder(),
    default="out/figures",
    show_default=True,
    help="Folder for the figures.",
)
@click.option(
    "--format",
    "formats",
    type=click.Choice(FORMATS),
    multiple=True,
    default=FORMATS[:2],
    show_default=True,
    help="How to write them; may be given several times.",
)
@click.option(
    "--only",
    type=click.Choice(FIGURES),
    multiple=True,
    help="Draw this figure; may be given several times. All without it.",
)
@click.option(
    "--at",
    type=float,
    help="Draw the mechanism at the sample nearest to this time [s]; at the first one without it.",
)
def draw(case: Case, out: Path, formats: tuple[str, ...], only: tuple[str, ...], at: float | None) -> int:
    """Draw forces, joints, energy, reactions and the mechanism over a motion (needs the extra 'plot').

    Exit code 1 when the machine cannot make the motion.
    """
    chosen = [name for name in FIGURES if name in (only or FIGURES)]
    paths = {name: [out / f"{name}.{kind}" for kind in dict.fromkeys(formats)] for name in chosen}
    case.protect(*(path for some in paths.values() for path in some))
    case.require_moment("--at", at)
    from p3dof.report import plots
    from p3dof.report.plots.common import new_figure

    new_figure((1.0, 1.0))  # says that matplotlib is missing before the work begins
    drawings = Drawings(case, at)
    with together():
        written = [
            path for name, files in paths.items() for path in plots.save_all(drawings.figure(name), files)
        ]
    console = Console()
    print_payloads(console, case)
    for path in written:
        print_plain(console, f"wrote {path}")
    print_warnings(console, drawings.by_virtual_power.warnings)
    return 0 if drawings.by_virtual_power.possible else 1
