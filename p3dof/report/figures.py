"""The figures of a report, as pictures that stand in the page itself."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from p3dof.analysis.energy import Energy
from p3dof.analysis.reactions import AnyReactions
from p3dof.machine.parameters import LEGS
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.report import plots
from p3dof.report.plots.common import encoded, laid_out
from p3dof.report.plots.joints import joints_figure
from p3dof.report.plots.mechanism import mechanism_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A picture for a page.

    Parameters
    ----------
    source : str
        Its address: a data URI with the whole picture.
    alternative : str
        What it shows, for who cannot see it.
    caption : str
        What stands below it.
    width, height : int
        Its size [px].
    """

    source: str
    alternative: str
    caption: str
    width: int
    height: int


@dataclass(frozen=True)
class Pictures:
    """The pictures of a report.

    Parameters
    ----------
    mechanism, joints, forces, energy, reactions : Picture
        One of each figure.
    """

    mechanism: Picture
    joints: Picture
    forces: Picture
    energy: Picture
    reactions: Picture


def pictures_of(
    robot: Manipulator,
    results: tuple[InverseDynamics, InverseDynamics],
    energy: Energy,
    reactions: AnyReactions,
) -> Pictures:
    """Draw the figures of a report.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    results : tuple of two InverseDynamics
        The forces by both methods; the mechanism is drawn at the first valid sample.
    energy : Energy
        Over the motion.
    reactions : Reactions or ReactionsComparison
        Likewise.

    Returns
    -------
    Pictures
    """
    first = results[0]
    motion, row = first.motion, int(np.argmax(first.valid))
    y, z, theta = motion.pose[row]
    peaks, work = _peaks(first), _work(energy)
    span = f"from t = {motion.time[0]:g} to {motion.time[-1]:g} s"
    return Pictures(
        mechanism=picture(
            mechanism_figure(robot, motion.pose[row], motion),
            "Drawing of the mechanism from the front, the side, the top and at an angle, with the joints "
            f"A1 to C7, at y = {y:.4g} m, z = {z:.4g} m, θ = {theta:.4g} rad.",
            f"The mechanism at t = {motion.time[row]:g} s, from the front, the side and the top at one "
            "scale, and the path of P. Guide-ways are drawn behind all.",
        ),
        joints=picture(
            joints_figure(first),
            f"Positions, velocities and accelerations of the three sliders and the seven hinges {span}.",
            "Sliders and passive joints: positions, velocities and accelerations.",
        ),
        forces=picture(
            plots.forces_figure(list(results)),
            f"Forces of the three actuators {span} by both methods, and their difference. {peaks}",
            "Actuator forces by both methods (for the paper's motion its Figs. 3–5), and their difference.",
        ),
        energy=picture(
            plots.energy_figure(energy),
            f"Energy, kinetic energy by bodies, and power of the actuators {span}. {work}",
            "Change of the energy and the work done, kinetic energy by bodies, power of the actuators.",
        ),
        reactions=picture(
            plots.reactions_figure(reactions),
            f"Resultant force and moment in each of the thirteen joints {span}.",
            "Resultant forces and moments in the joints. Of what rigid bodies leave open, solid lines are "
            "what elastic joints bear, dashed and dotted ones what two idealisations would say.",
        ),
    )


def _peaks(result: InverseDynamics) -> str:
    if not result.possible:
        return "Shaded where the machine cannot make the motion."
    peaks = zip(LEGS, result.peak_forces, strict=True)
    return f"Peaks: {', '.join(f'{leg} {force:.4g} N' for leg, force in peaks)}."


def _work(energy: Energy) -> str:
    if not energy.valid.all():
        return "Shaded where the machine cannot make the motion."
    given, taken = energy.drives.positive_work.sum(), -energy.drives.negative_work.sum()
    return f"The actuators give {given:.4g} J and take back {taken:.4g} J."


def picture(figure: Figure, alternative: str, caption: str) -> Picture:
    """Draw a figure as SVG, the same bytes each time.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    alternative, caption : str
        Of the picture.

    Returns
    -------
    Picture
    """
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "p3dof", "svg.fonttype": "path"}), laid_out(figure):
        data = base64.b64encode(encoded(figure, "svg")).decode("ascii")
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return Picture(f"data:image/svg+xml;base64,{data}", alternative, caption, width, height)
