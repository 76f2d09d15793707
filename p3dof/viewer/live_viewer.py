"""`LiveViewer`: a page in the browser that Python sends runs to, and that may ask Python for forces."""

from __future__ import annotations

import asyncio
import threading
import webbrowser
from collections.abc import Callable
from typing import Any

from typing_extensions import Self

from p3dof._base.checks import frozen_array, shown
from p3dof._base.errors import InputError, MissingExtraError
from p3dof.viewer.connections import Channel, PageHandler, Source
from p3dof.viewer.document.html import HEIGHT, Page, page_html
from p3dof.viewer.host import Host
from p3dof.viewer.session import Answerer, Message, Session


class LiveViewer:
    """One machine in the browser, until it is stopped or the process ends, for any number of threads.

    Whole runs are sent to the pages, never frames: each page has its own time, and so two pages can look at
    two instants. A page that has lost its viewer goes on with what it has, and finds it again after `start`.
    """

    def __init__(
        self,
        document: Message,
        run_of: Callable[..., Message] | None = None,
        answerer: Answerer | None = None,
        port: int | None = None,
    ) -> None:
        self.session = Session(document, answerer)
        self._run_of = run_of
        self._guest: Any = None
        self._widget: Any = None
        self._ended = threading.Event()
        self._making = threading.RLock()  # there is one server, one widget, one scene of guests
        self.server = PageServer(self.session, self._page, port)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.url if self.server.running else 'stopped'})"

    def _repr_html_(self) -> str:
        """Show the page in a notebook on this machine; after `stop`, with what it showed then."""
        if not self.server.running:
            return Page(self.session.document).frame()
        return f'<iframe src="{self.url}" style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        """Show the page in a notebook: live, where there is anywidget and so through the notebook itself."""
        bundle = {"text/plain": repr(self), "text/html": self._repr_html_()}
        if not self.server.running:
            return bundle
        try:
            data, metadata = self.widget()._repr_mimebundle_(include=include, exclude=exclude)
        except MissingExtraError:
            return bundle
        return {**data, **bundle}, metadata

    def widget(self) -> Any:
        """Return the page as a widget for a notebook, whose kernel may run on another machine.

        Every cell that shows it has a page with its own time. What is shown is not kept in the notebook's
        file; a `p3dof.viewer.Page` is.
        """
        from p3dof.viewer.widget import PageWidget

        with self._making:
            if self._widget is None:
                title = str(self.session.document["title"])
                self._widget = PageWidget(self.session, self._page_of_widget, title)
            return self._widget

    @property
    def url(self) -> str:
        """Where the page is, with the token that it asks for."""
        return self.server.url

    @property
    def pages(self) -> int:
        """How many pages are open now."""
        return self.server.pages

    @property
    def selection(self) -> Message | None:
        """What was looked at last in a page, once it is followed; see `follow`."""
        return self.session.selection

    @property
    def waypoints(self) -> list[Any]:
        """The waypoints of the last page that sent some."""
        return self.session.waypoints

    @property
    def guest(self) -> Any:
        """MeshCat's visualizer for what is to be drawn beside the machine: `guest["box"].set_object(...)`."""
        from p3dof.viewer.server import guest_of

        with self._making:
            if self._guest is None:
                self._guest = guest_of(self.session)
            return self._guest

    def show(self, result: Any, name: str | None = None, **options: Any) -> Self:
        """Show a run in all pages, in place of one with its name or beside the others."""
        if self._run_of is None:
            raise InputError(f"result: this viewer shows one document, and not {shown(result)}")
        if not isinstance(name, str | None):
            raise InputError(f"name: expected text, got {shown(name)}")
        run = self._run_of(result, **options)
        self.session.show_run(run if name is None else {**run, "name": name})
        return self

    def seek(self, time: float) -> Self:
        """Ask all pages to stop at a time of their run [s]; it is the nearest one that the run has."""
        self.session.seek(float(frozen_array("time", time, ())))
        return self

    def follow(self, follower: Callable[[Any], None], what: str = "selection") -> Self:
        """Call a function with what is looked at in a page, or with its waypoints, as it changes.

        `follower`: takes a dict with ``time`` [s], ``run`` and, if moved by hand, ``pose`` or ``q``; or a
        list of waypoints. It is called in a thread of its own, with the latest only.
        """
        if not callable(follower):
            raise InputError(f"follower: expected a function, got {shown(follower)}")
        if what not in ("selection", "waypoints"):
            raise InputError(f"what: expected selection or waypoints, got {shown(what)}")
        self.session.follow(what, follower)
        return self

    def open(self) -> Self:
        """Open the page in the user's browser."""
        webbrowser.open(self.url, new=2)
        return self

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is stopped, for so long [s] or for ever; return whether it was."""
        return self._ended.wait(timeout)

    def start(self) -> Self:
        """Serve again after `stop`, at the same address: pages that are open still find their way back."""
        with self._making:
            if not self.server.running:
                self._ended.clear()
                self.server = PageServer(self.session, self._page, self.server.port, self.server.token)
        return self

    def stop(self) -> None:
        """End serving: no thread and no port is left. May be called more than once."""
        with self._making:
            self.server.stop()
            if self._widget is not None:
                self._widget.stop()
                self._widget = None
        self.session.stop()
        self._ended.set()

    def _page_of_widget(self) -> str:
        return page_html(self.session.document, f"parent {self.session.version}")

    def _page(self) -> str:
        hosts = [f"ws://{host}:{self.server.port}" for host in ("127.0.0.1", "localhost")]
        return page_html(self.session.document, f"server {self.session.version}", hosts)


SOCKET = "/page"
MAX_MESSAGE = 1 << 18
"""Longest message that a page may send [bytes]: a list of thousands of waypoints."""

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; media-src blob:; connect-src ws://{host}; base-uri 'none'; form-action 'none'"
)
"""The page itself allows one script only, by its hash."""


class PageServer(Host):
    """Serves the page of a session on 127.0.0.1, until it is stopped or the process ends."""

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
