"""`Host`: files and websockets for browsers on this machine only, from a thread of its own.

It listens on 127.0.0.1 alone. Requests with a foreign `Host` (a name made to point here) or `Origin` (another
site's page), or without the host's token, are refused.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import errno
import logging
import secrets
import socket
import sys
import threading
from collections.abc import Hashable, Mapping
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.iostream import IOStream
from typing_extensions import Self

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.viewer.connections import MAX_MESSAGE, Channel, FileHandler, PageHandler, Source

HOST = "127.0.0.1"
PORT = 7000
"""The first port that is tried."""

_GATHERING = 0.003
"""How long to gather the messages of one frame, to send them at once [s]."""
_PORTS_TRIED = 100
_PATIENCE = 10.0
"""How long a connection has for each request, or without one [s]."""


class Host:
    """Serves files and websockets on 127.0.0.1, until it is stopped or the process ends."""

    def __init__(
        self,
        files: Mapping[str, Source],
        channels: Mapping[str, Channel],
        port: int | None,
        policy: str,
        token: str | None = None,
        max_message: int = MAX_MESSAGE,
    ) -> None:
        self._files, self._channels, self._policy = dict(files), dict(channels), policy
        self._max_message = max_message
        self.token = secrets.token_urlsafe(24) if token is None else token
        self._socket = _bound_socket(port)
        self.port: int = self._socket.getsockname()[1]
        self.url = f"http://{HOST}:{self.port}/?token={self.token}"
        self._posted = False
        self._lock = threading.Lock()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name=f"p3dof viewer {self.port}", daemon=True)
        self._thread.start()
        atexit.register(self.stop)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.url if self.running else 'stopped'})"

    @property
    def running(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def post(self, message: bytes | str, key: Hashable, channel: Channel) -> None:
        """Send a message to all pages of a channel; may be called from any thread."""
        with self._lock:
            channel.fresh.put(message, key)
            posted, self._posted = self._posted, True
        if not posted:  # the thread is woken once for many
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                self._loop.call_soon_threadsafe(self._loop.call_later, _GATHERING, self._deliver)

    def stop(self) -> None:
        """End the thread, close the pages' connections and free the port; may be called more than once."""
        atexit.unregister(self.stop)
        if self.running:
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join(timeout=10)

    def _deliver(self) -> None:
        with self._lock:
            self._posted = False
            fresh = [(channel, channel.renewed()) for channel in self._channels.values()]
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

        from p3dof.viewer.host import Entrance

        files = [(path, FileHandler, {"source": source}) for path, source in self._files.items()]
        sockets = [(path, PageHandler, {"channel": channel}) for path, channel in self._channels.items()]
        application = Application(
            [*files, *sockets],
            log_function=lambda _: None,
            token=self.token,
            policy=self._policy,
            websocket_max_message_size=self._max_message,
        )
        server = HTTPServer(
            application,
            max_header_size=1 << 16,
            max_body_size=self._max_message,
            idle_connection_timeout=_PATIENCE,
            body_timeout=_PATIENCE,
        )
        entrance = application.settings["entrance"] = Entrance(self._socket, server)
        await self._ended.wait()
        entrance.close()
        await self._dismiss()
        await server.close_all_connections()

    async def _dismiss(self) -> None:
        """Close the pages' connections: when they have what was drawn, politely, and then in any case."""
        self._deliver()
        for _ in range(50):
            if not any(page.waiting for page in self._connections()):
                break
            await asyncio.sleep(0.02)
        for page in self._connections():
            page.close(1001, "the viewer was closed")
        for _ in range(20):
            if not self._connections():
                return
            await asyncio.sleep(0.02)
        for page in self._connections():
            page.hang_up()

    def _connections(self) -> list[PageHandler]:
        return [page for channel in self._channels.values() for page in channel.pages]


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


MOST = 256
"""How many connections a host has at once, where the process may open files enough."""

_SHARE = 4
"""One in so many of the files that the process may open can be a connection."""
_AT_ONCE = 64
"""How many connections are let in before others have their turn."""
_PAUSE = 0.5
"""How long nobody is let in where even one connection is too many [s]."""
_BUFFER = 1 << 20

_log = logging.getLogger(__name__)


class Entrance:
    """Lets connections in; those that have not shown the token give way, the oldest first.

    So whoever opens connections and says nothing on them keeps nobody out, nor takes the process its files.
    """

    def __init__(self, listener: socket.socket, server: HTTPServer) -> None:
        self._listener, self._server = listener, server
        self._most = min(MOST, max(_most_files() // _SHARE, 1))
        self._streams: dict[IOStream, bool] = {}
        self._told = False
        self._loop = IOLoop.current()
        self._waiting: object | None = None
        self._loop.add_handler(listener, self._accept, IOLoop.READ)

    def know(self, stream: IOStream) -> None:
        """Keep a connection, which has shown the token, whoever else may come."""
        if stream in self._streams:
            self._streams[stream] = True

    def close(self) -> None:
        """Let nobody in any more."""
        if self._waiting is None:
            self._loop.remove_handler(self._listener)
        else:
            self._loop.remove_timeout(self._waiting)
        self._listener.close()

    def _accept(self, *_events: Any) -> None:
        for _ in range(_AT_ONCE):
            try:
                connection, address = self._listener.accept()
            except BlockingIOError:
                return
            except ConnectionAbortedError:
                continue
            except OSError as error:  # of files or memory, none is left in this process or system
                self._tell(error.strerror or str(error))
                if not self._one_gives_way():
                    self._pause()
                return
            self._admit(connection, address)

    def _admit(self, connection: socket.socket, address: Any) -> None:
        self._streams = {stream: known for stream, known in self._streams.items() if not stream.closed()}
        if len(self._streams) < self._most // 2:
            self._told = False
        if len(self._streams) >= self._most:
            self._tell(f"there are {self._most}")
            if not self._one_gives_way():
                connection.close()
                return
        stream = IOStream(connection, max_buffer_size=_BUFFER)
        self._streams[stream] = False
        self._server.handle_stream(stream, address)

    def _one_gives_way(self) -> bool:
        """Close the oldest connection that has not shown the token; return whether there was one."""
        for stream, known in tuple(self._streams.items()):
            if not known:
                del self._streams[stream]
                if not stream.closed():
                    stream.close()
                    return True
        return False

    def _pause(self) -> None:
        self._loop.remove_handler(self._listener)
        self._waiting = self._loop.call_later(_PAUSE, self._resume)

    def _resume(self) -> None:
        self._waiting = None
        self._loop.add_handler(self._listener, self._accept, IOLoop.READ)

    def _tell(self, reason: str) -> None:
        """Say once, until there is room again, that connections are closed."""
        if not self._told:
            self._told = True
            _log.warning("p3dof: connections to the page are closed that have not requested it (%s)", reason)


def _most_files() -> int:
    """Return how many files the process may open."""
    if sys.platform == "win32":
        return _SHARE * MOST
    import resource

    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return _SHARE * MOST if most == resource.RLIM_INFINITY else most
