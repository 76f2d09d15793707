"""The manipulator as Pinocchio's `MeshcatVisualizer` shows it, in MeshCat's own page."""

from __future__ import annotations

import threading
from typing import Any

from typing_extensions import Self

from p3dof.viewer.document.machine import Machine
from p3dof.viewer.scene import Scene
from p3dof.viewer.server import ServedWindow, Server


def viewer(robot: Machine, port: int | None = None) -> Any:
    """Return Pinocchio's visualizer of a machine at home, shown in a page without controls.

    The page is at ``visualizer.viewer.url()``; it is served until ``visualizer.viewer.close()``, or
    the end of the process.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.

    Returns
    -------
    pinocchio.visualize.MeshcatVisualizer

    Raises
    ------
    InputError
        If the port is busy.
    MissingExtraError
        If MeshCat is not installed.
    """
    window = ServedWindow()
    scene = Scene(robot, window)
    window.server = Server(window, port)
    return scene.visualizer


class MeshcatPage:
    """The page of `viewer`, as a context that ends it.

    Parameters
    ----------
    robot, port
        As of `viewer`.

    Attributes
    ----------
    visualizer : pinocchio.visualize.MeshcatVisualizer
        What draws into it.
    """

    def __init__(self, robot: Machine, port: int | None = None) -> None:
        self.visualizer = viewer(robot, port)
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.visualizer.viewer.close()
        self._ended.set()

    @property
    def url(self) -> str:
        """Where it is."""
        return str(self.visualizer.viewer.url())

    def open(self) -> Self:
        """Open it in the user's browser."""
        self.visualizer.viewer.open()
        return self

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is closed, for so long [s] or for ever; return whether it was."""
        return self._ended.wait(timeout)
