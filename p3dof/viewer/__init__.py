"""The machine to look at, in a browser: through MeshCat and Pinocchio's visualizer.

It needs the extra ``viz`` (meshcat), which is imported when something is drawn; pictures and films need
``video`` too (playwright, for a browser without a window).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from p3dof.closed_loop import ClosedLoopModel
from p3dof.methods import InverseDynamics
from p3dof.motion import Motion
from p3dof.page.machine import Machine
from p3dof.page.poses import joints_of, trace_of
from p3dof.page.robots.motion import JointMotion
from p3dof.viewer.animation import animation_html, save_animation
from p3dof.viewer.robots.animation import robot_animation_html, robot_picture, save_robot_film
from p3dof.viewer.robots.scene import RobotScene
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scene import Scene
from p3dof.viewer.video import save_screenshot, save_video
from p3dof.viewer.window import SceneWindow

if TYPE_CHECKING:
    from p3dof.viewer.live import LiveViewer

__all__ = [
    "ArrowScale",
    "JointMotion",
    "LiveViewer",
    "RobotScene",
    "RobotViewer",
    "Scene",
    "SceneWindow",
    "animation_html",
    "joints_of",
    "robot_animation_html",
    "robot_picture",
    "save_animation",
    "save_robot_film",
    "save_screenshot",
    "save_video",
    "show",
    "show_robot",
    "trace_of",
    "viewer",
]


def __getattr__(name: str) -> Any:
    if name == "LiveViewer":  # with the server, which is not imported before something is served
        from p3dof.viewer.live import LiveViewer

        return LiveViewer
    if name == "RobotViewer":
        from p3dof.viewer.robots.live import RobotViewer

        return RobotViewer
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def show(robot: Machine, motion: Motion | InverseDynamics | None = None, **options: Any) -> LiveViewer:
    """Show a machine in a page with controls; see `p3dof.viewer.live.LiveViewer`, which takes the options."""
    from p3dof.viewer.live import LiveViewer

    return LiveViewer(robot, motion, **options)


def show_robot(robot: ClosedLoopModel, motion: Any = None, **options: Any) -> Any:
    """Show any robot in a page with controls: closures, forces, sliders for its actuated joints.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot, as of `p3dof.load_robot`.
    motion : RobotRun or JointMotion, optional
        What to play; without, the robot stands where its loops close near the reference.
    **options
        Those of `p3dof.viewer.robots.live.RobotViewer`: port, speed, layers, external, ...

    Returns
    -------
    RobotViewer
        With ``url`` and ``stop()``; it shows itself in a notebook.

    Raises
    ------
    AssemblyError
        If the loops do not close.
    InputError
        If an argument does not fit, or the port is busy.
    MissingExtraError
        If MeshCat is not installed.
    """
    from p3dof.viewer.robots.live import RobotViewer

    return RobotViewer(robot, motion, **options)


def viewer(robot: Machine, port: int | None = None) -> Any:
    """Return Pinocchio's visualizer of a machine, shown in a page; see `p3dof.viewer.live.viewer`."""
    from p3dof.viewer import live

    return live.viewer(robot, port)
