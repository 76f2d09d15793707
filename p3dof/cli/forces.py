"""`p3dof forces`, `compare`, `energy`, `plots`: what a motion takes, as tables, files and figures."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.console import Console

from p3dof._base.files import SUFFIXES, together
from p3dof._base.tables import formatted, table_of
from p3dof.cli.app import app
from p3dof.cli.case import LOAD_FRICTION, METHOD, STIFFNESS, Case, load_friction_in, stiffness_in, with_case
from p3dof.cli.files import out_folder, save_figure_if_possible, write_results
from p3dof.cli.kinds import FIGURE, MOMENT_OF_MOTION, Number, table_out
from p3dof.cli.output import print_plain, print_warnings, print_written, progress_bar, show
from p3dof.methods import InverseDynamics, engines, evidence_table, forces_table, limits_table
from p3dof.methods.comparison import ENGINE_TOLERANCE, agreement_table, opinions_table
from p3dof.methods.comparison import compare as compare_methods
from p3dof.methods.registry import TOLERANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = tuple(suffix.lstrip(".") for suffix in SUFFIXES["figure"])
FIGURES = ("forces", "joints", "energy", "reactions", "mechanism")
COMPARED = ("forces.csv", "forces.png", "forces.svg")

STEP, HALVINGS, RAMP = 1e-3, 3, 0.2
"""Longest time step of the comparison in time [s], how often it is halved, and the ramp from rest [s]."""


@app.command()
@with_case
@METHOD
@LOAD_FRICTION
@STIFFNESS
@table_out("actuator forces, slider motion and power balance")
@FIGURE
def forces(
    case: Case,
    method: str,
    load_friction: Path | None,
    stiffness: Path | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Compute the actuator forces over a motion by one method: prints peaks, writes all samples.

    With --load-friction (methods pinocchio and virtual-power), friction and joint loads are solved together.

    Exit code 1 when the machine cannot perform the motion; no peaks are printed then.
    """
    case.protect(out, figure, read=(load_friction, stiffness))
    friction = load_friction_in(load_friction)
    if friction is None and stiffness is not None:
        raise click.UsageError("--stiffness decides the loads of --load-friction, which is not given")
    if friction is None:
        result, seconds = case.solve(method)
        drawn, tables, remarks = [result], [], []
    else:
        from p3dof.analysis.load_friction import APPLIES, additions_table, contacts_table

        effect, seconds = case.load_friction(friction, method, stiffness_in(stiffness))
        result, tables = effect.result, [additions_table(effect), contacts_table(effect)]
        drawn, remarks = [result, effect.without], [APPLIES]
    written = write_results(result.to_csv, out, figure, lambda plots: plots.forces_figure(drawn))
    console = case.console(out)
    limits = limits_table(result, case.robot.parameters.limits)
    show(console, forces_table(result), limits, evidence_table(result, seconds=[seconds]))
    show(console, *tables, notes=True)
    for remark in remarks:
        print_plain(console, remark)
    print_warnings(console, result.warnings)
    print_written(console, written)
    return 0 if result.possible else 1


@app.command()
@with_case
@METHOD
@table_out("energies, momenta, power and work")
@FIGURE
def energy(case: Case, method: str, out: Path | None, figure: Path | None) -> int:
    """Compute energies of the bodies, and power and work of the actuators over a motion.

    Exit code 1 when the machine cannot perform the motion; no peaks and sums are printed then.
    """
    case.protect(out, figure)
    from p3dof.analysis.energy import balance_table, bodies_table, drives_table

    result, _ = case.solve(method)
    found = case.robot.energy(result)
    written = write_results(found.to_csv, out, figure, lambda plots: plots.energy_figure(found))
    console = case.console(out)
    show(console, bodies_table(found), notes=True)
    show(console, drives_table(found), limits_table(result, case.robot.parameters.limits))
    show(console, balance_table(found), evidence_table(result))
    print_warnings(console, result.warnings)
    print_written(console, written)
    return 0 if result.possible else 1


class Drawings:
    """The figures of a case; what several of them need is computed once."""

    def __init__(self, case: Case, at: float | None = None) -> None:
        self._case, self._at = case, at

    def drawn(self, name: str) -> Figure:
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
        from p3dof.report.plots.forces import joints_figure

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
@out_folder("the figures", "out/figures")
@click.option(
    "--format",
    "formats",
    type=click.Choice(FORMATS),
    multiple=True,
    default=FORMATS[:2],
    help="Format of the figures; repeatable.",
)
@click.option("--only", type=click.Choice(FIGURES), multiple=True, help="Draw only this figure; repeatable.")
@click.option(
    "--at",
    type=MOMENT_OF_MOTION,
    help="Time of the motion at which the mechanism is drawn [s]; by default its first valid sample.",
)
def draw(case: Case, out: Path, formats: tuple[str, ...], only: tuple[str, ...], at: float | None) -> int:
    """Draw forces, joints, energy, reactions and the mechanism over a motion (needs the extra 'plot').

    Exit code 1 when the machine cannot perform the motion.
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
            path for name, files in paths.items() for path in plots.save_all(drawings.drawn(name), files)
        ]
    console = case.console()
    print_written(console, written)
    print_warnings(console, drawings.by_virtual_power.warnings)
    return 0 if drawings.by_virtual_power.possible else 1


@app.command()
@with_case
@out_folder("forces.csv and the figure")
@click.option(
    "--tolerance",
    type=Number(min=0),
    default=TOLERANCE,
    help="Largest allowed difference of the two methods, relative to the largest force.",
)
@click.option(
    "--engines",
    "chosen",
    type=click.Choice(("all", *engines.ENGINES)),
    multiple=True,
    help="Also compute the forces with another engine (extra 'engines'); repeatable.",
)
@click.option(
    "--in-time",
    is_flag=True,
    help="Also simulate the motion with Exudyn, at decreasing step sizes (extra 'engines').",
)
@click.option("--plot/--no-plot", default=True, help="Draw the figure (needs the extra 'plot').")
def compare(
    case: Case, out: Path, tolerance: float, chosen: tuple[str, ...], in_time: bool, plot: bool
) -> int:
    """Compute the actuator forces by both methods, compare them, and write forces.csv and a figure.

    Exit code 1 when the methods differ by more than the tolerance, when the compiled kernels or another
    engine differ by more than the tolerance and 1e-9, or when the machine cannot perform the motion.
    """
    case.protect(*(out / name for name in COMPARED))
    console = case.console()
    found = compare_methods(
        case.robot, case.motion, case.wrench, case.on_invalid, chosen, tolerance, progress_bar
    )
    if found.verdict_on_samples:
        _print_verdict(console, found.verdict_on_samples, False)
    if not found.both_valid.any():
        if not found.verdict_on_samples:
            case.require_valid(found.second.valid)
        return 1
    with together():
        written = [found.to_csv(out / COMPARED[0])]
        if plot:
            both = (found.first, found.second)
            paths = [out / name for name in COMPARED[1:]]
            written += save_figure_if_possible(lambda plots: plots.forces_figure(both), *paths)
    show(console, agreement_table(found))
    show(console, evidence_table(found.first, found.second, seconds=found.seconds), opinions_table(found))
    if not found.confirmed:
        allowed = max(found.tolerance, ENGINE_TOLERANCE)
        print_plain(console, f"one of the others DISAGREES by more than {allowed:.0e}", "bold red")
    if in_time:
        _print_convergence(console, case)
    print_warnings(console, found.warnings)
    print_written(console, written)
    _print_verdict(console, found.verdict, found.agree)
    return 0 if found.passed else 1


def _print_verdict(console: Console, sentence: str, good: bool) -> None:
    style = "bold green" if good else "bold red"
    print_plain(console, sentence, style)


def _print_convergence(console: Console, case: Case) -> None:
    """Print how the forces of Exudyn's integration in time approach the virtual powers."""
    entered = case.motion.from_rest(min(RAMP, case.motion.duration))
    count = max(2, 2 * round(entered.duration / STEP / 2))  # whole double steps
    motion = entered.resampled(count + 1)
    wrench = None if case.history is None else case.history(motion.time)
    known = case.robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench)
    found = engines.convergence(
        case.robot.parameters, motion, known.forces, motion.duration / count, HALVINGS, wrench=wrench
    )
    orders = ["", *(formatted(order, ".3f") for order in found.orders)]
    rows: dict[str, tuple[str, ...]] = {
        f"{1e3 * step:.4g}": (formatted(error, ".1e"), order, formatted(gap, ".1e"))
        for step, error, order, gap in zip(found.steps, found.errors, orders, found.gaps, strict=True)
    }
    rows["→ 0"] = (formatted(found.extrapolated_error, ".1e"), "", "")
    title = "Exudyn simulation (sliders driven, trapezoidal rule), against virtual-power"
    header = ("step [ms]", "error, of the largest force", "order", "largest gap [m]")
    show(console, table_of(title, header, rows))
