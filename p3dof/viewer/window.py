"""`SceneWindow`: what MeshCat draws into here, and a scene as one HTML file; no process, port or network."""

from __future__ import annotations

import base64
import html
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any, Protocol, TypeAlias

from p3dof._base.errors import InputError, MissingExtraError
from p3dof.viewer.document.html import as_script, filled
from p3dof.viewer.session import Listeners

Listener: TypeAlias = Callable[[bytes], None]
"""Takes a packed command; it must return at once, as whoever draws waits for it."""


class Command(Protocol):
    """A command of `meshcat.commands`."""

    def lower(self) -> dict[str, Any]:
        """Return the command as plain data."""


@dataclass
class _Node:
    """What was last said of one place of the scene, packed."""

    kept: dict[str, bytes] = field(default_factory=dict)
    properties: dict[str, bytes] = field(default_factory=dict)

    @property
    def messages(self) -> list[bytes]:
        kept = [
            self.kept[kind] for kind in ("set_object", "set_transform", "set_animation") if kind in self.kept
        ]
        return [*kept[:1], *self.properties.values(), *kept[1:]]


class SceneWindow:
    """A scene that MeshCat draws into: the place of `meshcat.visualizer.ViewerWindow`.

    Give it to ``meshcat.Visualizer(window=...)``. It holds what a page needs to show the scene; pages get it
    through a listener, or as a file. May be used from several threads.
    """

    def __init__(self) -> None:
        self.web_url = ""
        self._pack = packer()
        self._nodes: dict[tuple[str, ...], _Node] = {}
        self._listeners = Listeners()
        self._lock = threading.RLock()

    @property
    def watched(self) -> bool:
        """Whether it is seen: of a scene without a server nobody can come later."""
        return True

    def send(self, command: Command) -> None:
        """Keep a command and pass it on to the listeners.

        `command`: anything whose ``lower()`` returns the plain data of a command.
        """
        data = command.lower()
        message = self._pack(data)
        with self._lock:
            self._keep(data, message)
            self._listeners.tell(message)

    def messages(self) -> list[bytes]:
        """Return the commands that rebuild the scene, each packed as MeshCat's page takes it."""
        with self._lock:
            return [message for node in self._nodes.values() for message in node.messages]

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Pass all commands from now on to a function; ends it; may be called more than once.

        `listener`: takes a packed command, in the thread that draws; it must return at once.
        """
        return self._listeners.subscribe(listener)

    def get_scene(self) -> str:
        """Return a self-contained page of the scene as it is now (MeshCat's ``static_html`` calls it)."""
        return standalone(self.messages())

    def get_image(self) -> Any:
        """Return a picture of the scene as it is now, as a `PIL.Image` (``captureImage`` calls it)."""
        from p3dof.viewer.headless import SIZE, as_image, picture_of

        return as_image(picture_of(self.get_scene(), SIZE))

    def open(self) -> SceneWindow:
        """Open the scene in the user's browser."""
        if not self.web_url:
            raise InputError("this scene has no server to open in a browser")
        webbrowser.open(self.web_url, new=2)
        return self

    def wait(self) -> str:
        """Return at once: the scene is kept for whatever page is opened later."""
        return "ok"

    def close(self) -> None:
        """Do nothing: there is no process to end."""

    def _keep(self, data: Mapping[str, Any], message: bytes) -> None:
        kind = data["type"]
        path = tuple(name for name in data.get("path", "").split("/") if name)
        if kind == "set_property":
            properties = self._nodes.setdefault(path, _Node()).properties
            properties[data["property"]] = message
        elif kind in ("set_object", "set_transform", "set_animation"):
            node = self._nodes.setdefault(path, _Node())
            node.kept[kind] = message
            if kind == "set_object":  # the page forgets these with the object that they were of
                node.properties.pop("color", None)
                self._forget((*path, "<object>"))
        elif kind == "delete":
            self._forget(path)

    def _forget(self, path: tuple[str, ...]) -> None:
        inside = [other for other in self._nodes if other[: len(path)] == path]
        for other in inside:
            del self._nodes[other]


def packer() -> Callable[[Any], bytes]:
    """Return what packs plain data for MeshCat's page."""
    try:
        import meshcat  # noqa: F401
        import umsgpack
    except ImportError as error:
        raise MissingExtraError("the viewer needs meshcat: pip install 'p3dof[viz]'") from error
    pack: Callable[[Any], bytes] = umsgpack.packb
    return pack


def has_display() -> bool:
    """Return whether a browser can have a window: without, Python would open one in the terminal."""
    wanted = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    return sys.platform in {"win32", "darwin"} or any(os.environ.get(name) for name in wanted)


def standalone(
    messages: Iterable[bytes], title: str = "p3dof", start: Mapping[str, Any] | None = None
) -> str:
    """Return a page that shows a scene with no network, the HTML; `start`: how its animation begins."""
    commands = [base64.b64encode(message).decode("ascii") for message in messages]
    parts = {
        "@TITLE@": html.escape(title),
        "@LICENCES@": html.escape(licences()),
        "@MESHCAT@": meshcat_script().decode(),
        "@FIT@": resource("meshcat/fit.js"),
        "@COMMANDS@": as_script(commands),
        "@START@": as_script(start),
        "@PLAYER@": "" if start is None else resource("meshcat/player.js"),
    }
    return filled(resource("standalone.html"), parts)


def resource(name: str) -> str:
    """Return the text of a file of this package."""
    return (resources.files("p3dof.viewer") / name).read_text(encoding="utf-8")


def licences() -> str:
    """Return the notices of all whose JavaScript is in a page: MeshCat 0.3.2, and what its script holds.

    Whoever takes another MeshCat has to look again at what is in it; a test compares them.
    """
    return resource("meshcat/licences.txt")


@cache
def meshcat_script() -> bytes:
    """Return MeshCat's JavaScript, from its package."""
    return (resources.files("meshcat") / "viewer/dist/main.min.js").read_bytes()
