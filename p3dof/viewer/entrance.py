"""`Entrance`: how many connections a host has at once, and which of them gives way to the next."""

from __future__ import annotations

import logging
import socket
import sys
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.iostream import IOStream

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

    Parameters
    ----------
    listener : socket.socket
        Where they come.
    server : HTTPServer
        What answers them.
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
            _log.warning("p3dof: connections to the page are closed that have not asked for it (%s)", reason)


def _most_files() -> int:
    """Return how many files the process may open."""
    if sys.platform == "win32":
        return _SHARE * MOST
    import resource

    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return _SHARE * MOST if most == resource.RLIM_INFINITY else most
