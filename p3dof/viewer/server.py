"""`Server`: a scene and its controls, for browsers on this machine only.

One page, two websockets: ``/scene`` carries MeshCat's packed commands to the pages, ``/control`` small JSON
objects both ways. The page can reach nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import Protocol

from p3dof.viewer.connections import Channel, Message, Source, packed
from p3dof.viewer.host import HOST, PORT, Host
from p3dof.viewer.window import SceneWindow

__all__ = ["HOST", "PAGES", "PORT", "Controls", "ServedWindow", "Server"]

PAGES = ("machine", "robot")
"""The pages that there are: a file that ends in .html, and one in .js for its panel."""

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host} data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'"
)
_FILES = {
    "/": ("@PAGE@.html", "text/html"),
    "/licences.txt": ("licences.txt", "text/plain"),
    "/pane.js": ("pane.js", "text/javascript"),
    "/fit.js": ("fit.js", "text/javascript"),
    "/common.js": ("common.js", "text/javascript"),
    "/panel.js": ("@PAGE@.js", "text/javascript"),
    "/panel.css": ("panel.css", "text/css"),
    "/meshcat.js": ("main.min.js", "text/javascript"),
}


class Controls(Protocol):
    """Who answers the pages; both are called in the server's thread and must return at once."""

    def greeting(self) -> list[Message]:
        """Return what a page is told when it is opened."""

    def received(self, message: Message) -> None:
        """Take what a page says; a `P3dofError` is told to that page."""


class Server(Host):
    """Serves a scene on 127.0.0.1 from a thread of its own, until it is stopped or the process ends.

    Parameters
    ----------
    window : SceneWindow
        The scene.
    port : int, optional
        The port, 0 for any; the first free one from 7000 on by default.
    controls : Controls, optional
        Who answers the pages; without, they show the scene only.
    page : str
        Which page, one of `PAGES`.

    Raises
    ------
    InputError
        If the port is not one, is busy, or may not be used.
    MissingExtraError
        If tornado, which MeshCat brings, is not installed.
    """

    def __init__(
        self,
        window: SceneWindow,
        port: int | None = None,
        controls: Controls | None = None,
        page: str = PAGES[0],
    ) -> None:
        self._window = window
        self._scenes = Channel(window.messages)
        self._panels = Channel(list)
        if controls is not None:
            answering = controls
            self._panels = Channel(answering.greeting, lambda message, _: answering.received(message))
        channels = {"/scene": self._scenes, "/control": self._panels}
        super().__init__(_files(page, lambda: self.token), channels, port, _POLICY)
        self._unsubscribe = window.subscribe(self._draw)
        window.web_url = self.url

    @property
    def pages(self) -> int:
        """How many pages are open now."""
        return len(self._panels.pages)

    def tell(self, message: Message, key: str | None = None) -> None:
        """Send a message to the panels of all pages; may be called from any thread.

        Parameters
        ----------
        message : dict
            Plain data.
        key : str, optional
            A message with a key takes the place of an earlier one that a slow page has not yet taken.
        """
        self.post(packed(message), key, self._panels)

    def stop(self) -> None:
        """End the thread, close the pages' connections and free the port; may be called more than once."""
        self._unsubscribe()
        if self._window.web_url == self.url:
            self._window.web_url = ""
        super().stop()

    def _draw(self, message: bytes) -> None:
        self.post(message, subject_of(message), self._scenes)


class ServedWindow(SceneWindow):
    """A scene with a server of its own, which `close` ends.

    Attributes
    ----------
    server : Server or None
        The server, once there is one.
    """

    def __init__(self) -> None:
        super().__init__()
        self.server: Server | None = None

    def close(self) -> None:
        """End the server."""
        if self.server is not None:
            self.server.stop()


def subject_of(message: bytes) -> bytes | None:
    """Return what is set by a packed transform or property: all that comes before its value."""
    for kind, value in ((b"set_transform", b"matrix"), (b"set_property", b"value")):
        if kind in message[:32]:
            return message.partition(value)[0]
    return None


def _files(name: str, token: Callable[[], str]) -> dict[str, Source]:
    """Return the files of a page, which asks for the others with the token."""
    page, meshcat = resources.files("p3dof.viewer") / "page", resources.files("meshcat") / "viewer" / "dist"
    found: dict[str, Source] = {}
    for path, (file, kind) in _FILES.items():
        folder = meshcat if file == "main.min.js" else page
        content = (folder / file.replace("@PAGE@", name)).read_bytes()
        found[path] = _source(content, kind, token if path == "/" else None)
    return found


def _source(content: bytes, kind: str, token: Callable[[], str] | None) -> Source:
    """Return a file, with the token filled in where it has a place for it."""
    if token is None:
        return Source(lambda: content, kind)
    return Source(lambda: content.replace(b"@TOKEN@", token().encode()), kind)
