"""Machines to look at in the browser: one page, in files and notebooks, live, as pictures and films.

A page that is saved needs nothing else. A live one needs the extra ``viz`` (tornado, and MeshCat for
Pinocchio's visualizer), pictures and films ``video`` (playwright, for a browser without a window).
"""

from __future__ import annotations

from typing import Any

from p3dof.viewer.document.machine import Machine
from p3dof.viewer.document.poses import joints_of, trace_of
from p3dof.viewer.document.robots.motion import JointMotion
from p3dof.viewer.document.saved import Page
from p3dof.viewer.pictures import save_screenshot, save_video
from p3dof.viewer.robots.showing import robot_page, show_robot
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scene import Scene
from p3dof.viewer.showing import page, show
from p3dof.viewer.window import SceneWindow

__all__ = [
    "ArrowScale",
    "JointMotion",
    "LiveViewer",
    "Page",
    "Scene",
    "SceneWindow",
    "document",
    "joints_of",
    "page",
    "robot_page",
    "save_screenshot",
    "save_video",
    "show",
    "show_robot",
    "trace_of",
    "viewer",
]


def __getattr__(name: str) -> Any:
    if name == "LiveViewer":  # with the server, which is not imported before something is served
        from p3dof.viewer.live_viewer import LiveViewer

        return LiveViewer
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def viewer(robot: Machine, port: int | None = None) -> Any:
    """Return Pinocchio's visualizer of a machine, in MeshCat's page; see `p3dof.viewer.visualizer.viewer`."""
    from p3dof.viewer import visualizer

    return visualizer.viewer(robot, port)
