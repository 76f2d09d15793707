"""`Session`: what the pages of one machine are told, and what they are answered, whatever carries it.

Down go ``hello``, ``document``, ``run``, ``seek``, ``answer``, ``guest`` and ``error``; up come ``get``,
``ask``, ``selection`` and ``waypoints``. Whole runs are sent, never frames: each page owns its time.
"""

from __future__ import annotations

import itertools
import logging
import threading
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeAlias

from p3dof._base.checks import one_line, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof.viewer.messages import packed_message

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


class Session:
    """The document that pages show, and who answers what they ask; may be used from several threads.

    Parameters
    ----------
    document : dict
        As of `p3dof.viewer.document`: machine, scene and runs.
    answerer : callable, optional
        Answers a page that has no engine of its own; called in a thread of its own, one question at a time,
        of each page the latest.

    Attributes
    ----------
    version : int
        Counts what was pushed.
    selection : dict or None
        What was looked at last in a page, while it is followed: ``time`` [s], ``run``, and ``pose`` or ``q``
        if moved by hand.
    waypoints : list
        Those of the last page that sent some, as the page has them.
    """

    def __init__(self, document: Message, answerer: Answerer | None = None) -> None:
        self._document = document
        self._answerer = answerer
        self.version = 0
        self.selection: Message | None = None
        self.waypoints: list[Any] = []
        self._followers: dict[str, list[Callable[[Any], None]]] = {"selection": [], "waypoints": []}
        self._listeners: list[Listener] = []
        self._guests: Callable[[], list[bytes]] = list
        self._lock = threading.RLock()
        self._work = _Latest()

    @property
    def document(self) -> Message:
        """What a page that is opened now shows."""
        return self._document

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Pass all messages for the pages from now on to a function; return what ends that."""
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

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
        """Let MeshCat's packed commands appear in the pages; return what takes those from now on.

        Parameters
        ----------
        rebuilt : callable
            Returns the commands that draw what there is.
        """
        self._guests = rebuilt
        return lambda command, key: self._tell({"type": "guest", "command": command}, key)

    def received(self, message: Mapping[str, Any], page: Hashable, reply: Reply) -> None:
        """Take what a page says.

        Parameters
        ----------
        message : mapping
            Plain data with a ``type``.
        page : hashable
            Which page it is: of its questions that wait only the latest is answered.
        reply : callable
            Sends to this page.

        Raises
        ------
        InputError
            If it is nothing that a page may say.
        """
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
            found = {"refused": one_line(str(error)), "legs": _blamed(error)}
        reply(packed_message({"type": "answer", "id": number, **found}), "answer")

    def _keep(self, kind: str, message: Mapping[str, Any]) -> None:
        if kind == "selection":
            if not self._followers[kind]:
                return
            value: Any = {name: one for name, one in message.items() if name != "type"}
            self.selection = value
        else:
            value = message.get("waypoints")
            if not isinstance(value, list):
                raise InputError(f"waypoints: expected a list, got {shown(value)}")
            self.waypoints = value
        for follower in tuple(self._followers[kind]):
            self._work.put((id(follower), kind), lambda follower=follower: follower(value))  # type: ignore[misc]

    def _hello(self) -> Message:
        return {"type": "hello", "version": self.version, "follow": any(self._followers.values())}

    def _tell(self, message: Message, key: Hashable) -> None:
        data = packed_message(message)
        for listener in tuple(self._listeners):
            listener(data, key)


def _blamed(error: P3dofError) -> list[str]:
    """Return which leg of the manipulator is to blame, if one is."""
    leg = getattr(error, "leg", None)
    return [leg] if isinstance(leg, str) else []


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
