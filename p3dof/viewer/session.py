"""What the pages of one machine are told, and what they are answered, whatever carries it."""

from __future__ import annotations

import base64
import itertools
import json
import logging
import struct
import threading
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeAlias

import numpy as np

from p3dof._base.checks import one_line, require, shown
from p3dof._base.errors import InputError, P3dofError

Message: TypeAlias = dict[str, Any]
Answerer: TypeAlias = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Takes what a page asks for; returns the answer, or raises a `P3dofError` that says why there is none."""
Listener: TypeAlias = Callable[[bytes, Hashable], None]
"""Takes a packed message for all pages, and its key: it may take the place of an earlier one with that."""
Reply: TypeAlias = Callable[[bytes, Hashable], None]
"""The same for the page that a message came from; called from any thread."""

KINDS = ("get", "ask", "selection", "waypoints")
"""What a page may send."""

_log = logging.getLogger(__name__)


class Listeners:
    """Functions that are told what happens; may be used from several threads."""

    def __init__(self) -> None:
        self._all: list[Callable[..., None]] = []
        self._lock = threading.Lock()

    def subscribe(self, listener: Callable[..., None]) -> Callable[[], None]:
        """Tell a function all from now on; return what ends that, which may be called more than once."""
        with self._lock:
            self._all.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._all:
                    self._all.remove(listener)

        return unsubscribe

    def tell(self, *what: Any) -> None:
        """Tell all of them."""
        for listener in tuple(self._all):
            listener(*what)


class Session:
    """The document that pages show, and who answers what they ask; may be used from several threads.

    `answerer`: answers a page that has no engine of its own; called in a thread of its own, one question at a
    time, of each page the latest.
    """

    def __init__(self, document: Message, answerer: Answerer | None = None) -> None:
        self._document = document
        self._answerer = answerer
        self.version = 0
        self.selection: Message | None = None
        self.waypoints: list[Any] = []
        self._followers: dict[str, list[Callable[[Any], None]]] = {"selection": [], "waypoints": []}
        self._listeners = Listeners()
        self._guests: Callable[[], list[bytes]] = list
        self._lock = threading.RLock()
        self._work = _Latest()

    @property
    def document(self) -> Message:
        """What a page that is opened now shows."""
        return self._document

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Pass all messages for the pages from now on to a function; return what ends that."""
        return self._listeners.subscribe(listener)

    def greeting(self) -> list[bytes]:
        """Return what a page is told when it is connected."""
        guests = [packed_message({"type": "guest", "command": command}) for command in self._guests()]
        return [packed_message(self._hello()), *guests]

    def show_document(self, document: Message) -> None:
        """Show another document in all pages: another machine, or other runs."""
        with self._lock:
            self._document = document
            self.version += 1
            self._tell({"type": "document", "version": self.version, "document": document}, "document")

    def show_run(self, run: Message) -> int:
        """Show a run in all pages, in place of one with its name or beside the others; return its index."""
        with self._lock:
            runs = list(self._document["runs"])
            names = [one["name"] for one in runs]
            index = names.index(run["name"]) if run["name"] in names else len(runs)
            runs[index : index + 1] = [run]
            self._document = {**self._document, "runs": runs}
            self.version += 1
            message = {"type": "run", "version": self.version, "index": index, "run": run}
            self._tell(message, ("run", index))
        return index

    def seek(self, time: float) -> None:
        """Ask all pages to stop at a time [s]."""
        self._tell({"type": "seek", "time": float(time)}, "seek")

    def follow(self, what: str, follower: Callable[[Any], None]) -> None:
        """Call a function with what a page sends of one kind: ``selection`` or ``waypoints``."""
        self._followers[what].append(follower)
        self._tell(self._hello(), "hello")

    def draw_guests(self, rebuilt: Callable[[], list[bytes]]) -> Listener:
        """Let MeshCat's packed commands appear in the pages; return what takes those from now on."""
        self._guests = rebuilt
        return lambda command, key: self._tell({"type": "guest", "command": command}, key)

    def received(self, message: Mapping[str, Any], page: Hashable, reply: Reply) -> None:
        """Take what a page says."""
        kind = message.get("type")
        if not isinstance(kind, str) or kind not in KINDS:
            raise InputError(f"type: expected {', '.join(KINDS[:-1])} or {KINDS[-1]}, got {shown(kind)}")
        if kind == "get":
            found = {"type": "document", "version": self.version, "document": self._document}
            reply(packed_message(found), "document")
        elif kind == "ask":
            number = message.get("id")
            if not isinstance(number, int):
                raise InputError(f"id: expected a whole number, got {shown(number)}")
            self._work.put((page, kind), lambda: self._answer(number, message, reply))
        else:
            self._keep(kind, message)

    def stop(self) -> None:
        """End the thread that answers."""
        self._work.stop()

    def _answer(self, number: int, message: Mapping[str, Any], reply: Reply) -> None:
        try:
            if self._answerer is None:
                raise InputError("nobody answers: the page computes by itself")
            found = dict(self._answerer(message))
        except P3dofError as error:
            leg = getattr(error, "leg", None)  # of the manipulator, where one is to blame
            found = {"refused": one_line(str(error)), "legs": [leg] if isinstance(leg, str) else []}
        reply(packed_message({"type": "answer", "id": number, **found}), "answer")

    def _keep(self, kind: str, message: Mapping[str, Any]) -> None:
        if kind == "selection":
            if not self._followers[kind]:
                return
            value: Any = {name: one for name, one in message.items() if name != "type"}
            self.selection = value
        else:
            value = message.get("waypoints")
            require("waypoints", value, list)
            self.waypoints = value
        for follower in tuple(self._followers[kind]):
            self._work.put((id(follower), kind), lambda follower=follower: follower(value))  # type: ignore[misc]

    def _hello(self) -> Message:
        return {"type": "hello", "version": self.version, "follow": any(self._followers.values())}

    def _tell(self, message: Message, key: Hashable) -> None:
        self._listeners.tell(packed_message(message), key)


class _Latest:
    """A thread that does one thing after the other, of those with the same key only the latest."""

    def __init__(self) -> None:
        self._waiting: dict[Hashable, Callable[[], None]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._names = itertools.count()

    def put(self, key: Hashable, work: Callable[[], None]) -> None:
        with self._changed:
            self._waiting.pop(key, None)
            self._waiting[key] = work
            if self._thread is None:
                name = f"p3dof answers {next(self._names)}"
                self._thread = threading.Thread(target=self._run, name=name, daemon=True)
                self._thread.start()
            self._changed.notify()

    def stop(self) -> None:
        with self._changed:
            thread, self._thread = self._thread, None
            self._waiting.clear()
            self._changed.notify()
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=10)

    def _run(self) -> None:
        me = threading.current_thread()
        while True:
            with self._changed:
                while not self._waiting and self._thread is me:
                    self._changed.wait()
                if self._thread is not me:
                    return
                work = self._waiting.pop(next(iter(self._waiting)))
            try:
                work()
            except Exception:
                _log.exception("what follows a page failed")


MAGIC = b"P3D1"
_ALIGNED = 8


def packed_message(message: Mapping[str, Any]) -> bytes:
    """Return a message as a page takes it."""
    arrays = _Arrays()
    text = json.dumps(arrays.without(message), allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % _ALIGNED)
    return b"".join((MAGIC, struct.pack("<I", len(text)), text, *arrays.parts))


class _Arrays:
    """The arrays of one message, taken out of it."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self._length = 0

    def without(self, value: Any) -> Any:
        """Return plain data in which every array says where it is."""
        if isinstance(value, Mapping):
            if "base64" in value and "dtype" in value:
                content = base64.b64decode(value["base64"])
                return {"shape": value["shape"], "dtype": value["dtype"], "offset": self._put(content)}
            return {key: self.without(one) for key, one in value.items()}
        if isinstance(value, list | tuple):
            return [self.without(one) for one in value]
        if isinstance(value, bytes):
            return {"shape": [len(value)], "dtype": "uint8", "offset": self._put(value)}
        if isinstance(value, np.ndarray):
            order = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
            return {
                "shape": list(value.shape),
                "dtype": value.dtype.name,
                "offset": self._put(order.tobytes()),
            }
        return value

    def _put(self, content: bytes) -> int:
        offset = self._length
        content += bytes(-len(content) % _ALIGNED)
        self.parts.append(content)
        self._length += len(content)
        return offset
