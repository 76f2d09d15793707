"""What answers the requests of pages on this machine: the page's files, and its two websockets."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import re
import secrets
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from p3dof._base.checks import one_line
from p3dof._base.errors import InputError, MissingExtraError, P3dofError
from p3dof._base.files import parse_json

try:
    from tornado.iostream import IOStream, StreamClosedError
    from tornado.web import RequestHandler
    from tornado.websocket import WebSocketClosedError, WebSocketHandler, WebSocketProtocol13
except ImportError as error:
    raise MissingExtraError("the viewer needs meshcat: pip install 'p3dof[viz]'") from error

Message: TypeAlias = dict[str, Any]
"""Plain data, as JSON has it."""

RATE, BURST = 200, 600
"""How many messages a second a page may send, and how many at once; one that sends more is closed."""
MAX_MESSAGE = 1 << 14
"""Longest message that a page may send [bytes]; a longer one closes its connection."""
MAX_WAITING, MAX_WAITING_BYTES = 4096, 1 << 26
"""How much can wait for a slow page, in messages and bytes; a page that is still slower is closed."""
MAX_PAGES = 64
"""How many pages can be open."""

_PINGS = (1, 60)
"""Likewise pings, which the pages do not send."""
_GRACE = 0.25
"""How long a page that is closed has to take the reason [s]."""
_WRONG, _TOO_MUCH, _TOO_SLOW = 1002, 1008, 1013
"""Why a connection is closed (RFC 6455): the protocol or a rule is broken; try again later."""
_MASKED = 0x80
"""In the second byte of a frame."""
_ORIGINS = ("Origin", "Sec-WebSocket-Origin", "WebSocket-Origin")
"""Where a browser says whose page asks: the last two in old drafts of the protocol."""
_LOCAL = re.compile(r"(127\.0\.0\.1|localhost)(:\d{1,5})?")

_UNKNOWN = "Open the whole address of the viewer, with its token"
_RETURN = (
    "const token = sessionStorage.getItem('p3dof-token');"
    "if (token) location.replace('/?token=' + encodeURIComponent(token) + location.hash);"
)
"""What a page that was loaded again does: it has taken the token out of its address, and kept it."""
_RETURN_POLICY = (
    "default-src 'none'; script-src 'sha256-"
    + base64.b64encode(hashlib.sha256(_RETURN.encode()).digest()).decode("ascii")
    + "'; base-uri 'none'; form-action 'none'"
)


def packed(message: Message) -> str:
    """Return a message as JSON."""
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


@dataclass(eq=False)
class Channel:
    """One kind of connection of the pages."""

    greeting: Callable[[], list[Any]]  # returns what a page is sent first
    received: Callable[[Message, PageHandler], None] | None = None
    """Takes the messages of the pages; without it they are refused."""
    pages: set[PageHandler] = field(default_factory=set)  # those that are open
    fresh: Outbox = field(default_factory=lambda: Outbox(MAX_WAITING, MAX_WAITING_BYTES))
    """What is to be handed to them."""

    def renewed(self) -> Outbox:
        """Take what is to be handed to the pages, and begin anew."""
        fresh, self.fresh = self.fresh, Outbox(MAX_WAITING, MAX_WAITING_BYTES)
        return fresh

    def deliver(self, fresh: Outbox) -> None:
        """Hand messages to the pages; where some are missing, the pages have to come back for all."""
        while (waiting := fresh.pop()) is not None:
            for page in tuple(self.pages):
                page.put(waiting[1], waiting[0])
        if fresh.full:
            for page in tuple(self.pages):
                page.give_up()


class LocalHandler(RequestHandler):
    """Answers this machine's own pages only, and of these who knows the token."""

    def prepare(self) -> None:
        """Refuse a request for another host, from another site's page, or without the token."""
        host = self.request.host.lower()
        own = {f"http://{host}", f"https://{host}"}
        origins = {self.request.headers[name].lower() for name in _ORIGINS if name in self.request.headers}
        given = self.get_query_argument("token", "")
        if not _LOCAL.fullmatch(host) or not origins <= own:
            self.send_error(403, reason="Only pages of this machine")
        elif not secrets.compare_digest(given.encode(), self.settings["token"].encode()):
            self.send_error(403, reason=_UNKNOWN)
        else:
            connection: Any = self.request.connection
            self.settings["entrance"].know(connection.stream)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        """Say why a request is refused; a page that was loaded again finds its way back with its token."""
        if self._reason == _UNKNOWN and self.request.path == "/" and "token" not in self.request.arguments:
            self.set_header("Content-Security-Policy", _RETURN_POLICY)
            self.set_header("Referrer-Policy", "no-referrer")
            self.finish(f"<!doctype html><title>403</title><p>{_UNKNOWN}.</p><script>{_RETURN}</script>")
        else:
            super().write_error(status_code, **kwargs)


@dataclass(frozen=True)
class Source:
    """What a path is answered with."""

    content: Callable[[], bytes]  # returns the bytes, as they are then
    kind: str  # their media type


class FileHandler(LocalHandler):
    """One of the page's files, from memory."""

    def initialize(self, source: Source) -> None:
        """Take the file."""
        self._source = source

    def get(self) -> None:
        """Send the file."""
        self.set_header("Content-Type", f"{self._source.kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")  # the address has the token in it
        policy: str = self.settings["policy"]
        self.set_header("Content-Security-Policy", policy.format(host=self.request.host))
        self.finish(self._source.content())


class PageHandler(WebSocketHandler, LocalHandler):
    """One connection of a page. A slow page gets the latest of what has a key, and so never lags behind.

    One that sends too much, or takes too little, is told why and closed.
    """

    def initialize(self, channel: Channel) -> None:
        """Take the kind of the connection."""
        self._channel = channel
        self._outbox = Outbox(MAX_WAITING, MAX_WAITING_BYTES)
        self._frames, self._pings = Allowance(RATE, BURST), Allowance(*_PINGS)
        self._woken = asyncio.Event()
        self._writer: asyncio.Future[None] | None = None
        self._ending = False
        self._stream: IOStream | None = None

    def prepare(self) -> None:
        """Refuse also what comes by an old draft of the protocol, or when there are too many pages."""
        super().prepare()
        version = self.request.headers.get("Sec-WebSocket-Version", "")
        if not self._finished and version != "13":
            self.set_header("Sec-WebSocket-Version", "13")
            self.send_error(426)
        elif not self._finished and len(self._channel.pages) >= MAX_PAGES:
            self.send_error(503, reason="Too many pages are open")

    def check_origin(self, origin: str) -> bool:  # noqa: ARG002 - `prepare` has checked it
        """Return True: `prepare` has refused the foreign ones."""
        return True

    def get_websocket_protocol(self) -> WebSocketProtocol13 | None:
        """Return the protocol, which asks before every frame whether there may be one."""
        plain = super().get_websocket_protocol()
        return _Paced(self, False, plain.params) if isinstance(plain, WebSocketProtocol13) else None

    def open(self, *_: str, **__: str) -> None:
        """Send what there is; the rest follows."""
        self.set_nodelay(True)
        self._stream = None if self.ws_connection is None else self.ws_connection.stream
        self._channel.pages.add(self)
        first = self._channel.greeting()
        self._writer = asyncio.ensure_future(
            self._write([m if isinstance(m, bytes) else packed(m) for m in first])
        )

    def put(self, message: bytes | str, key: Hashable) -> None:
        """Send a message in turn, in place of an earlier one with its key that still waits."""
        if self._outbox.put(message, key):
            self._woken.set()
        else:
            self.give_up()

    def give_up(self) -> None:
        """Close the connection of a page that is too slow; it can come back, and gets what there is then."""
        self._end(_TOO_SLOW, "the page is too slow for what is drawn")

    async def pace(self) -> None:
        """Let the others have their turn, and close the connection of a page that sends too much."""
        await asyncio.sleep(0)
        if not self._frames.take():
            self._end(_TOO_MUCH, f"too many messages: at most {RATE} a second")
        await self._require_open()

    async def require_mask(self, begin: bytes) -> None:
        """Close the connection of what sends frames that no browser would (RFC 6455, 5.1)."""
        if not begin[1] & _MASKED:
            self._end(_WRONG, "frames of a page are masked")
        await self._require_open()

    async def _require_open(self) -> None:
        if self._ending:
            await asyncio.sleep(_GRACE)  # nothing is read meanwhile, and so nothing is kept
            raise StreamClosedError

    def on_ping(self, data: bytes) -> None:  # noqa: ARG002 - it has been answered
        """Close the connection of a page that has far too many pings answered."""
        if not self._pings.take():
            self._end(_TOO_MUCH, f"too many pings: at most {_PINGS[0]} a second")

    def on_message(self, message: str | bytes) -> None:
        """Pass a message on, or say what is wrong with it."""
        try:
            content = parse_json(message)
            if not isinstance(content, dict):
                raise InputError("expected a JSON object")
            if self._channel.received is None:
                raise InputError("nobody takes messages here")
            self._channel.received(content, self)
        except P3dofError as error:
            self.put(packed({"type": "error", "message": one_line(str(error))}), "error")
        except ValueError:
            self.put(packed({"type": "error", "message": "expected a JSON object"}), "error")

    def on_close(self) -> None:
        """Forget the page."""
        self._channel.pages.discard(self)
        if self._writer is not None:
            self._writer.cancel()

    @property
    def waiting(self) -> int:
        """How many messages it has still to be sent."""
        return len(self._outbox)

    def hang_up(self) -> None:
        """Close the connection of a page that does not answer."""
        if self._stream is not None:
            self._stream.close()

    def _end(self, code: int, reason: str) -> None:
        """Close a connection, and hang up if the page does not answer soon."""
        if not self._ending:
            self._ending = True
            self.close(code, reason)
            asyncio.get_running_loop().call_later(_GRACE, self.hang_up)

    async def _write(self, greeting: list[bytes | str]) -> None:
        try:
            for message in greeting:
                await self.write_message(message, binary=isinstance(message, bytes))
            while True:
                while (waiting := self._outbox.pop()) is not None:
                    await self.write_message(waiting[1], binary=isinstance(waiting[1], bytes))
                self._woken.clear()
                await self._woken.wait()
        except (WebSocketClosedError, StreamClosedError):
            pass


class _Paced(WebSocketProtocol13):
    """The protocol, with a pause before every frame: also of pings, and of parts of a message."""

    handler: PageHandler
    _begins = False

    async def _receive_frame(self) -> None:
        await self.handler.pace()
        self._begins = True
        await super()._receive_frame()

    async def _read_bytes(self, n: int) -> bytes:
        data = await super()._read_bytes(n)
        if self._begins:
            self._begins = False
            await self.handler.require_mask(data)
        return data


class Allowance:
    """So many a second, and so many at once; what is not used is saved up to that number."""

    def __init__(self, rate: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._burst, self._clock = rate, burst, clock
        self._left, self._since = burst, clock()

    def take(self) -> bool:
        """Take one; return whether there was one left."""
        now = self._clock()
        self._left = min(self._burst, self._left + self._rate * (now - self._since))
        self._since = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Outbox:
    """Messages in the order in which they are to go, of those with the same key only the latest."""

    def __init__(self, most: int, most_bytes: int) -> None:
        self._most, self._most_bytes = most, most_bytes
        self._waiting: dict[Hashable, bytes | str] = {}
        self._bytes = 0
        self.full = False

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: bytes | str, key: Hashable = None) -> bool:
        """Add a message, in place of an earlier one with its key; whether it was taken."""
        key = object() if key is None else key
        self._bytes += len(message) - len(self._waiting.pop(key, ""))
        self.full = self.full or len(self._waiting) >= self._most or self._bytes > self._most_bytes
        if self.full:
            self._waiting.clear()
            self._bytes = 0
            return False
        self._waiting[key] = message
        return True

    def pop(self) -> tuple[Hashable, bytes | str] | None:
        """Take the message that has waited longest, with its key; None when none waits."""
        if not self._waiting:
            return None
        key = next(iter(self._waiting))
        message = self._waiting.pop(key)
        self._bytes -= len(message)
        return key, message
