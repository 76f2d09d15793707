"""What answers the requests of pages on this machine: the page's files, and its two websockets."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable
from typing import Any, TypeAlias

from p3dof.checks import one_line
from p3dof.errors import InputError, MissingExtraError, P3dofError

try:
    from tornado.web import RequestHandler
    from tornado.websocket import WebSocketClosedError, WebSocketHandler
except ImportError as error:
    raise MissingExtraError("the viewer needs meshcat: pip install 'p3dof[viz]'") from error

Message: TypeAlias = dict[str, Any]
"""Plain data, as JSON has it."""

_LOCAL = re.compile(r"(127\.0\.0\.1|localhost)(:\d{1,5})?")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host} data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'"
)


def packed(message: Message) -> str:
    """Return a message as JSON.

    Parameters
    ----------
    message : dict
        Plain data, without NaN.

    Returns
    -------
    str
    """
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


class LocalHandler(RequestHandler):
    """Answers this machine's own pages only."""

    def prepare(self) -> None:
        """Refuse a request for another host, or from another site's page."""
        host = self.request.host.lower()
        origin = self.request.headers.get("Origin", f"http://{host}").lower()
        if not _LOCAL.fullmatch(host) or origin not in {f"http://{host}", f"https://{host}"}:
            self.send_error(403, reason="Only pages of this machine")


class FileHandler(LocalHandler):
    """One of the page's files, from memory."""

    def initialize(self, files: dict[str, tuple[bytes, str]]) -> None:
        """Take the files: content and kind by path."""
        self._files = files

    def get(self) -> None:
        """Send the file."""
        content, kind = self._files[self.request.path]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Content-Security-Policy", _POLICY.format(host=self.request.host))
        self.finish(content)


class PageHandler(WebSocketHandler, LocalHandler):
    """One connection of a page. A slow page gets the latest of what has a key, and so never lags behind."""

    def initialize(
        self,
        pages: set[PageHandler],
        greeting: Callable[[], list[Any]],
        received: Callable[[Message], None] | None,
    ) -> None:
        """Take where to enter the page, what to send it first, and who takes its messages."""
        self._pages = pages
        self._greeting = greeting
        self._received = received
        self._waiting: dict[Any, bytes | str] = {}
        self._woken = asyncio.Event()
        self._writer: asyncio.Future[None] | None = None

    def check_origin(self, origin: str) -> bool:  # noqa: ARG002 - `prepare` has checked it
        """Return True: `prepare` has refused the foreign ones."""
        return True

    def open(self, *_: str, **__: str) -> None:
        """Send what there is; the rest follows."""
        self.set_nodelay(True)
        self._pages.add(self)
        for message in self._greeting():
            self.put(message if isinstance(message, bytes) else packed(message), None)
        self._writer = asyncio.ensure_future(self._write())

    def put(self, message: bytes | str, key: Any) -> None:
        """Send a message in turn, in place of an earlier one with its key that still waits."""
        key = object() if key is None else key
        self._waiting.pop(key, None)
        self._waiting[key] = message
        self._woken.set()

    async def _write(self) -> None:
        try:
            while True:
                await self._woken.wait()
                self._woken.clear()
                batch, self._waiting = self._waiting, {}
                sent = [self.write_message(m, binary=isinstance(m, bytes)) for m in batch.values()]
                await asyncio.gather(*sent)
        except WebSocketClosedError:
            pass

    def on_message(self, message: str | bytes) -> None:
        """Pass a message on, or say what is wrong with it."""
        try:
            content = json.loads(message)
            if not isinstance(content, dict):
                raise InputError("expected a JSON object")
            if self._received is None:
                raise InputError("nobody takes messages here")
            self._received(content)
        except P3dofError as error:
            self.put(packed({"type": "error", "message": one_line(str(error))}), None)
        except (ValueError, RecursionError):
            self.put(packed({"type": "error", "message": "expected a JSON object"}), None)

    def on_close(self) -> None:
        """Forget the page."""
        self._pages.discard(self)
        if self._writer is not None:
            self._writer.cancel()

    def hang_up(self) -> None:
        """Close the connection of a page that does not answer."""
        stream = None if self.ws_connection is None else self.ws_connection.stream
        if stream is not None:
            stream.close()
