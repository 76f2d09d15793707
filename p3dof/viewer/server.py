"""`Server`: a scene and its controls, for browsers on this machine only.

One page, two websockets: ``/scene`` carries MeshCat's packed commands to the pages, ``/control`` small JSON
objects both ways. It listens on 127.0.0.1 alone. Requests with a foreign `Host` (a name made to point here)
or `Origin` (another site's page), or without the server's token, are refused, and the page can reach nothing
else.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import errno
import secrets
import socket
import threading
from collections.abc import Hashable
from importlib import resources
from typing import Protocol

from p3dof.checks import shown
from p3dof.errors import InputError
from p3dof.viewer.connections import (
    MAX_MESSAGE,
    Channel,
    FileHandler,
    Message,
    PageHandler,
    packed,
)
from p3dof.viewer.window import SceneWindow

HOST = "127.0.0.1"
PORT = 7000
"""The first port that is tried."""
PAGES = ("machine", "robot")
"""The pages that there are: a file that ends in .html, and one in .js for its panel."""

_GATHERING = 0.003
"""How long to gather the messages of one frame, to send them at once [s]."""
_PORTS_TRIED = 100
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


class Server:
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

    Attributes
    ----------
    port : int
        The port.
    url : str
        Where the page is, with the token that it asks for: a new one with every server.

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
        self._token = secrets.token_urlsafe(24)
        self._files = _load_files(self._token, page)
        self._socket = _bound_socket(port)
        self.port: int = self._socket.getsockname()[1]
        self.url = f"http://{HOST}:{self.port}/?token={self._token}"
        self._scenes = Channel(window.messages)
        self._panels = Channel(controls.greeting, controls.received) if controls else Channel(list)
        self._posted = False
        self._lock = threading.Lock()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name=f"p3dof viewer {self.port}", daemon=True)
        self._thread.start()
        self._unsubscribe = window.subscribe(self._draw)
        window.web_url = self.url
        atexit.register(self.stop)

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"Server({self.url if self.running else 'stopped'})"

    @property
    def running(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

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
        self._post(packed(message), key, self._panels)

    def stop(self) -> None:
        """End the thread, close the pages' connections and free the port; may be called more than once."""
        self._unsubscribe()
        atexit.unregister(self.stop)
        if self._window.web_url == self.url:
            self._window.web_url = ""
        if self.running:
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join(timeout=10)

    def _draw(self, message: bytes) -> None:
        self._post(message, _subject_of(message), self._scenes)

    def _post(self, message: bytes | str, key: Hashable, channel: Channel) -> None:
        """Hand a message over to the server's thread, which is woken once for many."""
        with self._lock:
            channel.fresh.put(message, key)
            posted, self._posted = self._posted, True
        if not posted:
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                self._loop.call_soon_threadsafe(self._loop.call_later, _GATHERING, self._deliver)

    def _deliver(self) -> None:
        with self._lock:
            self._posted = False
            fresh = [(channel, channel.renewed()) for channel in (self._scenes, self._panels)]
        for channel, messages in fresh:
            channel.deliver(messages)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            left = asyncio.all_tasks(self._loop)
            for task in left:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
            self._loop.close()

    async def _serve(self) -> None:
        from tornado.httpserver import HTTPServer
        from tornado.web import Application

        files = [(path, FileHandler, {"files": self._files}) for path in _FILES]
        sockets = [
            (path, PageHandler, {"channel": channel})
            for path, channel in (("/scene", self._scenes), ("/control", self._panels))
        ]
        application = Application(
            [*files, *sockets],
            log_function=lambda _: None,
            token=self._token,
            websocket_max_message_size=MAX_MESSAGE,
        )
        server = HTTPServer(
            application,
            max_header_size=1 << 16,
            max_body_size=MAX_MESSAGE,
            max_buffer_size=1 << 20,
            idle_connection_timeout=60,
        )
        server.add_socket(self._socket)
        await self._ended.wait()
        server.stop()
        await self._dismiss()
        await server.close_all_connections()

    async def _dismiss(self) -> None:
        """Close the pages' connections: politely, and then in any case."""
        for page in self._connections():
            page.close(1001, "the viewer was closed")
        for _ in range(20):
            if not self._connections():
                return
            await asyncio.sleep(0.02)
        for page in self._connections():
            page.hang_up()

    def _connections(self) -> list[PageHandler]:
        return [*self._scenes.pages, *self._panels.pages]


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


def _subject_of(message: bytes) -> bytes | None:
    """Return what is set by a packed transform or property: all that comes before its value."""
    for kind, value in ((b"set_transform", b"matrix"), (b"set_property", b"value")):
        if kind in message[:32]:
            return message.partition(value)[0]
    return None


def _load_files(token: str, name: str) -> dict[str, tuple[bytes, str]]:
    """Return the files of the page, which asks for the others with the token."""
    page, meshcat = resources.files("p3dof.viewer") / "page", resources.files("meshcat") / "viewer" / "dist"
    files = {}
    for path, (file, kind) in _FILES.items():
        folder = meshcat if file == "main.min.js" else page
        content = (folder / file.replace("@PAGE@", name)).read_bytes()
        files[path] = (content.replace(b"@TOKEN@", token.encode()) if path == "/" else content, kind)
    return files


def _bound_socket(port: int | None) -> socket.socket:
    """Return a socket that listens on the given port, or on the first free one from `PORT` on."""
    if port is not None and (isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 1 << 16):
        raise InputError(f"port: expected a whole number from 0 to 65535, got {shown(port)}")
    for candidate in range(PORT, PORT + _PORTS_TRIED) if port is None else (port,):
        listener = _listening(candidate)
        if isinstance(listener, socket.socket):
            return listener
    if port is None:
        raise InputError(f"port: none from {PORT} to {PORT + _PORTS_TRIED - 1} is free")
    raise InputError(f"port {port}: cannot listen on it ({listener}); give another one, or none")


def _listening(port: int) -> socket.socket | str:
    """Return a socket that listens on a port, or why there is none."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows would share the port without it
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((HOST, port))
        listener.listen(128)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        return "it is busy" if error.errno == errno.EADDRINUSE else error.strerror or str(error)
    return listener
