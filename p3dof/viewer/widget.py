"""`PageWidget`: a page in a cell of a notebook, through the notebook's own connection to Python.

The kernel may run on another machine: nothing listens, and the page reaches nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from importlib import resources
from typing import Any

from p3dof._base.checks import one_line
from p3dof._base.errors import MissingExtraError, P3dofError
from p3dof.viewer.document.html import HEIGHT
from p3dof.viewer.session import Session, packed_message

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise MissingExtraError(
        "a live page in a notebook needs anywidget: pip install 'p3dof[jupyter]'"
    ) from error


class PageWidget(anywidget.AnyWidget):
    """The page of a session, shown in a notebook.

    Every place that shows it has its own page, with its own time. What is shown is not kept in the notebook's
    file.
    """

    _esm = (resources.files("p3dof.viewer") / "widget.js").read_text(encoding="utf-8")
    title = traitlets.Unicode().tag(sync=True)
    height = traitlets.Int(HEIGHT).tag(sync=True)

    def __init__(
        self, session: Session, page: Callable[[], str], title: str = "machine", height: int = HEIGHT
    ) -> None:
        super().__init__(title=title, height=height)
        self._session = session
        self._page = page
        self._unsubscribe = session.subscribe(lambda data, _: self.send({}, [data]))
        self.on_msg(self._received)

    def stop(self) -> None:
        """Leave the pages to themselves: they go on with what they have, and say so."""
        self._unsubscribe()
        self.send({"closed": True}, [])

    def _received(self, _widget: Any, content: Any, _buffers: Any) -> None:
        if not isinstance(content, Mapping) or not isinstance(content.get("message"), Mapping):
            return
        view, message = str(content.get("view", "")), content["message"]

        def reply(data: bytes, _key: Hashable) -> None:
            self.send({"view": view}, [data])

        kind = message.get("type")
        if kind == "page":
            self.send({"view": view, "page": True}, [self._page().encode()])
        elif kind == "hello":
            for data in self._session.greeting():
                reply(data, None)
        else:
            try:
                self._session.received(message, view, reply)
            except P3dofError as error:
                reply(packed_message({"type": "error", "message": one_line(str(error))}), "error")
