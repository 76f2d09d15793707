"""`PageServer`: the page for browsers on this machine only, with one websocket that carries its session."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from p3dof.viewer.connections import Channel, Message, PageHandler, Source
from p3dof.viewer.host import Host
from p3dof.viewer.session import Session

SOCKET = "/page"
MAX_MESSAGE = 1 << 18
"""Longest message that a page may send [bytes]: a list of thousands of waypoints."""

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; media-src blob:; connect-src ws://{host}; base-uri 'none'; form-action 'none'"
)
"""The page itself allows one script only, by its hash."""


class PageServer(Host):
    """Serves the page of a session on 127.0.0.1, until it is stopped or the process ends.

    Parameters
    ----------
    session : Session
        What its pages show.
    page : callable
        Returns the page as it is when it is opened.
    port : int, optional
        The port, 0 for any; the first free one from 7000 on by default.
    token : str, optional
        What a page has to know; a new one by default.

    Raises
    ------
    InputError
        If the port is not one, is busy, or may not be used.
    MissingExtraError
        If tornado, which MeshCat brings, is not installed.
    """

    def __init__(
        self, session: Session, page: Callable[[], str], port: int | None = None, token: str | None = None
    ) -> None:
        self._session = session
        self._channel = Channel(session.greeting, self._received)
        files = {"/": Source(lambda: page().encode(), "text/html")}
        super().__init__(files, {SOCKET: self._channel}, port, _POLICY, token, MAX_MESSAGE)
        self._unsubscribe = session.subscribe(lambda data, key: self.post(data, key, self._channel))

    @property
    def pages(self) -> int:
        """How many pages are open now."""
        return len(self._channel.pages)

    def stop(self) -> None:
        """End the thread, close the pages' connections and free the port; may be called more than once."""
        self._unsubscribe()
        super().stop()

    def _received(self, message: Message, page: PageHandler) -> None:
        loop = asyncio.get_running_loop()

        def reply(data: bytes, key: object) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(page.put, data, key)

        self._session.received(message, page, reply)
