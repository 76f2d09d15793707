"""`SceneWindow`: what MeshCat draws into here. It keeps the scene; no process, no port and no network."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

from p3dof._base.errors import InputError, MissingExtraError

Listener: TypeAlias = Callable[[bytes], None]
"""Takes a packed command; it must return at once, as whoever draws waits for it."""
Path: TypeAlias = tuple[str, ...]


class Command(Protocol):
    """A command of `meshcat.commands`."""

    def lower(self) -> dict[str, Any]:
        """Return the command as plain data."""


@dataclass
class _Node:
    """What was last said of one place of the scene, packed."""

    kept: dict[str, bytes] = field(default_factory=dict)
    properties: dict[str, bytes] = field(default_factory=dict)

    @property
    def messages(self) -> list[bytes]:
        kept = [
            self.kept[kind] for kind in ("set_object", "set_transform", "set_animation") if kind in self.kept
        ]
        return [*kept[:1], *self.properties.values(), *kept[1:]]


class SceneWindow:
    """A scene that MeshCat draws into: the place of `meshcat.visualizer.ViewerWindow`.

    Give it to ``meshcat.Visualizer(window=...)``. It holds what a page needs to show the scene; pages get it
    through a listener, or as a file. May be used from several threads.

    Attributes
    ----------
    web_url : str
        Where a server shows the scene; empty without one.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    """

    def __init__(self) -> None:
        self.web_url = ""
        self._pack = packer()
        self._nodes: dict[Path, _Node] = {}
        self._listeners: list[Listener] = []
        self._lock = threading.RLock()

    def send(self, command: Command) -> None:
        """Keep a command and pass it on to the listeners.

        Parameters
        ----------
        command : meshcat.commands command
            Anything whose ``lower()`` returns the plain data of a command.
        """
        data = command.lower()
        message = self._pack(data)
        with self._lock:
            self._keep(data, message)
            for listener in tuple(self._listeners):
                listener(message)

    def messages(self) -> list[bytes]:
        """Return the commands that rebuild the scene, each packed as MeshCat's page takes it."""
        with self._lock:
            return [message for node in self._nodes.values() for message in node.messages]

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Pass all commands from now on to a function.

        Parameters
        ----------
        listener : callable
            Takes a packed command, in the thread that draws; it must return at once.

        Returns
        -------
        callable
            Ends it; may be called more than once.
        """
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

    def get_scene(self) -> str:
        """Return a self-contained page of the scene as it is now (MeshCat's ``static_html`` calls it)."""
        from p3dof.viewer.pages import standalone

        return standalone(self.messages())

    def get_image(self) -> Any:
        """Return a picture of the scene as it is now, as a `PIL.Image` (``captureImage`` calls it).

        Raises
        ------
        MissingExtraError
            If there is no browser to draw it.
        """
        from p3dof.viewer.headless import picture

        return picture(self.get_scene())

    def open(self) -> SceneWindow:
        """Open the scene in the user's browser.

        Raises
        ------
        InputError
            If no server shows it.
        """
        if not self.web_url:
            raise InputError("this scene has no server to open in a browser")
        webbrowser.open(self.web_url, new=2)
        return self

    def wait(self) -> str:
        """Return at once: the scene is kept for whatever page is opened later."""
        return "ok"

    def close(self) -> None:
        """Do nothing: there is no process to end."""

    def _keep(self, data: Mapping[str, Any], message: bytes) -> None:
        kind = data["type"]
        path = tuple(name for name in data.get("path", "").split("/") if name)
        if kind == "set_property":
            properties = self._nodes.setdefault(path, _Node()).properties
            properties[data["property"]] = message
        elif kind in ("set_object", "set_transform", "set_animation"):
            node = self._nodes.setdefault(path, _Node())
            node.kept[kind] = message
            if kind == "set_object":  # the page forgets these with the object that they were of
                node.properties.pop("color", None)
                self._forget((*path, "<object>"))
        elif kind == "delete":
            self._forget(path)

    def _forget(self, path: Path) -> None:
        inside = [other for other in self._nodes if other[: len(path)] == path]
        for other in inside:
            del self._nodes[other]


def packer() -> Callable[[Any], bytes]:
    """Return what packs plain data for MeshCat's page.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    """
    try:
        import meshcat  # noqa: F401
        import umsgpack
    except ImportError as error:
        raise MissingExtraError("the viewer needs meshcat: pip install 'p3dof[viz]'") from error
    pack: Callable[[Any], bytes] = umsgpack.packb
    return pack
