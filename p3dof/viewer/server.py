"""`Server`: what MeshCat draws, in MeshCat's own page, for browsers on this machine only.

A websocket, ``/scene``, carries MeshCat's packed commands to the pages. They can reach nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import Any

from p3dof.viewer.connections import Channel, Source
from p3dof.viewer.host import Host
from p3dof.viewer.session import Session
from p3dof.viewer.window import SceneWindow, meshcat_script

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host} data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'"
)
_FILES = {
    "/": ("meshcat.html", "text/html"),
    "/licences.txt": ("licences.txt", "text/plain"),
    "/pane.js": ("pane.js", "text/javascript"),
    "/fit.js": ("fit.js", "text/javascript"),
    "/scene.js": ("scene.js", "text/javascript"),
}


class Server(Host):
    """Serves a scene on 127.0.0.1 from a thread of its own, until it is stopped or the process ends."""

    def __init__(self, window: SceneWindow, port: int | None = None) -> None:
        self._window = window
        self._scenes = Channel(window.messages)
        super().__init__(_files(lambda: self.token), {"/scene": self._scenes}, port, _POLICY)
        self._unsubscribe = window.subscribe(self._draw)
        window.web_url = self.url

    def stop(self) -> None:
        """End the thread, close the pages' connections and free the port; may be called more than once."""
        self._unsubscribe()
        if self._window.web_url == self.url:
            self._window.web_url = ""
        super().stop()

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return bool(self._scenes.pages)

    def _draw(self, message: bytes) -> None:
        self.post(message, subject_of(message), self._scenes)


class ServedWindow(SceneWindow):
    """A scene with a server of its own, which `close` ends."""

    def __init__(self) -> None:
        super().__init__()
        self.server: Server | None = None

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return self.server is not None and self.server.watched

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


def _files(token: Callable[[], str]) -> dict[str, Source]:
    """Return the files of the page, which asks for the others with the token."""
    page = resources.files("p3dof.viewer") / "meshcat"
    found = {path: _source((page / file).read_bytes(), kind) for path, (file, kind) in _FILES.items()}
    found["/meshcat.js"] = _source(meshcat_script(), "text/javascript")
    first = found["/"].content()
    found["/"] = Source(lambda: first.replace(b"@TOKEN@", token().encode()), "text/html")
    return found


def _source(content: bytes, kind: str) -> Source:
    return Source(lambda: content, kind)


def guest_of(session: Session, window: SceneWindow | None = None) -> Any:
    """Return a visualizer whose drawings appear in the pages of a session."""
    shown = SceneWindow() if window is None else window
    import meshcat

    draw = session.draw_guests(shown.messages)
    shown.subscribe(lambda command: draw(command, subject_of(command)))
    return meshcat.Visualizer(window=shown)
