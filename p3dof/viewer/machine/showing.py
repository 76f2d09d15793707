"""The manipulator as a page: in a file or a notebook, or live with Python behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import frozen_array, shown
from p3dof._base.errors import InputError
from p3dof.analysis.reactions import AnyReactions
from p3dof.machine.motion import Motion, WrenchOverTime
from p3dof.methods import InverseDynamics
from p3dof.viewer.document.encoding import decoded, finite
from p3dof.viewer.document.html import Page
from p3dof.viewer.machine.document import TITLE, page_document
from p3dof.viewer.machine.room import Machine, require_machine
from p3dof.viewer.machine.runs import Runnable, Samples, run_of
from p3dof.viewer.showing import start_of

if TYPE_CHECKING:
    from p3dof.viewer.live_viewer import LiveViewer


def page(
    robot: Machine,
    result: Runnable | None = None,
    *,
    wrench: WrenchOverTime = None,
    runs: Mapping[str, Runnable] | None = None,
    reactions: AnyReactions | None = None,
    clearance: Any = None,
    title: str = TITLE,
    at: float | None = None,
    speed: float = 1.0,
    playing: bool = False,
) -> Page:
    """Return a page of the manipulator, to be saved or shown in a notebook; Python is not needed any more.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : Motion, InverseDynamics or Simulation, optional
        What is shown; without, the machine is held at home.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External load at the samples of a `Motion`, as of `Manipulator.inverse_dynamics`.
    runs : mapping of str to Motion, InverseDynamics or Simulation, optional
        Further runs by name, to be compared with it.
    reactions : Reactions or ReactionsComparison, optional
        Of the joints over the same motion: curves, and arrows that can be shown.
    clearance : p3dof.design.Clearance, optional
        Of the parts over the same motion: the two points that are nearest, with their distance.
    title : str
        Heading.
    at : float, optional
        Time of the run to begin at [s]; its first by default.
    speed : float
        How many times faster than in reality, from 0.1 to 4.
    playing : bool
        Whether it plays already.

    Raises
    ------
    ReachError, SingularityError
        If a sample of a `Motion` is out of reach or singular.
    InputError
        If an argument does not fit.
    """
    require_machine(robot)
    first = solved(robot, result, wrench)
    document = page_document(robot, first, runs=runs, reactions=reactions, clearance=clearance, title=title)
    times = None if first is None else first.time
    return Page({**document, "start": start_of(times, at, speed, playing)})


def show(
    robot: Machine,
    result: Runnable | None = None,
    *,
    wrench: WrenchOverTime = None,
    runs: Mapping[str, Runnable] | None = None,
    reactions: AnyReactions | None = None,
    clearance: Any = None,
    title: str = TITLE,
    port: int | None = None,
    at: float | None = None,
    speed: float = 1.0,
    playing: bool = True,
) -> LiveViewer:
    """Show the manipulator in the browser, live: more runs can be sent to the page; arguments as of `page`.

    Parameters
    ----------
    robot, result, wrench, runs, reactions, clearance, title, at, speed, playing
        As of `page`.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.

    Returns
    -------
    LiveViewer
        With ``url``, ``show(result)`` and ``stop()``; it shows itself in a notebook.

    Raises
    ------
    ReachError, SingularityError
        If a sample of a `Motion` is out of reach or singular.
    InputError
        If an argument does not fit, or the port is busy.
    MissingExtraError
        If tornado, which the extra ``viz`` brings, is not installed.
    """
    from p3dof.viewer.live_viewer import LiveViewer

    shown_first = page(
        robot,
        result,
        wrench=wrench,
        runs=runs,
        reactions=reactions,
        clearance=clearance,
        title=title,
        at=at,
        speed=speed,
        playing=playing,
    )

    def run(another: Any, wrench: WrenchOverTime = None) -> dict[str, Any]:
        return run_of(robot, Samples.of(robot, solved(robot, another, wrench)))

    return LiveViewer(shown_first.document, run, lambda question: _answer(robot, question), port)


def _answer(robot: Machine, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return where the machine is at a pose and what holds it there, for a page without WebAssembly."""
    pose = frozen_array("pose", question.get("pose"), (3,))
    motion = Motion(np.zeros(1), pose[None], *np.zeros((2, 1, 3)))
    run = run_of(robot, Samples.of(robot, robot.inverse_dynamics(motion, method="virtual-power")))
    values = {}
    for curve in run["curves"]:
        table, column = curve.get("column", (None, 0))
        found = decoded(curve["values"])[0] if table is None else decoded(run[table])[0, column]
        values[curve["key"]] = finite(found)
    return {"q": decoded(run["q"])[0], "pose": pose.tolist(), "values": values}


def solved(robot: Machine, result: Any, wrench: WrenchOverTime) -> Any:
    """Return a motion with its forces; anything else as it is."""
    if isinstance(result, Motion):
        found: InverseDynamics = robot.inverse_dynamics(result, wrench=wrench)
        return found
    if wrench is not None:
        raise InputError(f"wrench: expected a Motion to go with it, got {shown(result)}")
    return result
