"""What the live page of a robot is told: once, and with every frame."""

from __future__ import annotations

import numpy as np

from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.tables import is_slide, units_of_actuated
from p3dof.page.robots.motion import JointMotion, Moment
from p3dof.page.robots.ranges import values_of
from p3dof.viewer.connections import Message
from p3dof.viewer.player import FASTEST, SLOWEST
from p3dof.viewer.robots.readings import UNDETERMINED, ClosureReadings
from p3dof.viewer.robots.scene import RobotScene
from p3dof.viewer.stage import number

_MOST = 241
"""Most samples of a chart."""
_MOST_LIMITS = 4
"""So many joints beyond their limits are named."""


class Panel:
    """What is said of one robot and its motion.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    motion : JointMotion
        What can be played.
    """

    def __init__(self, robot: ClosedLoopModel, motion: JointMotion) -> None:
        self.robot, self.motion = robot, motion
        self.units = units_of_actuated(robot)
        self.closures = ClosureReadings(robot)

    def state(self, moment: Moment, message: str, unknown: str = "") -> Message:
        """Return what is said of a moment, what went wrong, and why forces are not known."""
        forces = zip(moment.forces, self.units, strict=False)  # a motion may be without forces
        return {
            "joints": values_of(self.robot, moment.q).tolist(),
            "forces": [_written(float(force), unit) for force, (_, unit) in forces],
            "closures": self.closures.texts(moment),
            "smallest": moment.smallest,
            "limits": self._beyond(moment.q),
            "message": message,
            "unknown": unknown,
        }

    def curves(self) -> tuple[list[float], list[list[float | None]]]:
        """Return times (N,), and the forces of each actuator over them, for a chart."""
        count = len(self.motion.time)
        some = np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(int))
        columns = [
            [float(f) if np.isfinite(f) else None for f in column] for column in self.motion.known[some].T
        ]
        return self.motion.time[some].tolist(), columns

    def _beyond(self, q: FloatArray) -> list[str]:
        model, found = self.robot.model, []
        for name, by in self.robot.beyond_limits(q).items():
            unit = "m" if is_slide(self.robot, model.getJointId(name)) else "rad"
            found.append(f"{name} by {number(abs(float(by)))} {unit}")
        more = len(found) - _MOST_LIMITS
        return found if more <= 0 else [*found[:_MOST_LIMITS], f"and {more} more"]


def setup_message(
    panel: Panel,
    scene: RobotScene,
    ranges: list[tuple[float, float]],
    title: str,
    warnings: tuple[str, ...],
) -> Message:
    """Return what a page needs to know before the first state.

    Parameters
    ----------
    panel : Panel
        Of the robot.
    scene : RobotScene
        Its picture.
    ranges : list of (float, float)
        How far the sliders of the actuated joints go [m or rad].
    title : str
        Heading of the page.
    warnings : tuple of str
        What is said beneath the motion.

    Returns
    -------
    dict
        Plain data.
    """
    robot, motion = panel.robot, panel.motion
    time, curves = panel.curves()
    joints = zip(robot.actuated, panel.units, ranges, strict=True)
    actuators = zip(motion.actuated, panel.units, scene.colours, strict=False)
    return {
        "type": "setup",
        "title": title,
        "motion": [float(motion.time[0]), float(motion.time[-1])] if len(motion.time) > 1 else None,
        "joints": [{"name": name, "unit": unit, "range": list(ends)} for name, (unit, _), ends in joints],
        "actuators": [
            {"name": name, "unit": unit, "colour": [round(255 * part) for part in colour]}
            for name, (_, unit), colour in actuators
        ],
        "closures": [vars(one) for one in panel.closures.readings],
        "layers": scene.layers.rows(),
        "speeds": [SLOWEST, FASTEST],
        "warnings": list(warnings),
        "time": time,
        "curves": curves,
    }


def _written(force: float, unit: str) -> str:
    return f"{number(force)} {unit}" if np.isfinite(force) else UNDETERMINED
