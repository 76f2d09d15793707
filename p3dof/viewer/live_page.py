"""`LivePage`: a picture in the browser with controls, which plays a motion or is moved by hand."""

from __future__ import annotations

import html
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from typing_extensions import Self

from p3dof.checks import FloatArray, positive, shown
from p3dof.errors import InputError
from p3dof.viewer.connections import Message
from p3dof.viewer.drawing import Drawing
from p3dof.viewer.player import FASTEST, SLOWEST, Frames, Player, within
from p3dof.viewer.server import Server

Request = Callable[[], None]
"""What somebody has asked for, checked, to be done with the next frame."""


class LivePage(ABC):
    """A scene in the browser, with its controls, until it is stopped or the process ends.

    Whatever a page can do, the methods do too; all pages show the same. Requests come from pages and callers
    in any thread; all drawing is done by one, which takes the latest request of each kind with every frame.

    Parameters
    ----------
    player : Player
        The time of the motion that can be played.
    has_motion : bool
        Whether there is one.
    fps : float
        Most frames per second.

    Attributes
    ----------
    scene : Drawing
        What is drawn.
    server : Server
        What serves it.
    """

    KINDS: ClassVar[tuple[str, ...]] = ("play", "pause", "time", "speed")
    """What can be asked for."""
    PAGE: ClassVar[str]
    """Which page is served."""
    scene: Drawing
    server: Server

    def __init__(self, player: Player, has_motion: bool, fps: float) -> None:
        self._player, self._has_motion = player, has_motion
        self._frames = Frames(self._draw, positive("fps", fps, InputError), "p3dof frames")
        self._lock = threading.Lock()
        self._requests: dict[str, Request] = {}
        self._by_hand: FloatArray | None = None
        self._setup: Message = {}
        self._state: Message = {}

    def _serve(self, port: int | None) -> None:
        """Draw the first frame, serve the page, and go on drawing."""
        self._step()
        self.server = Server(self.scene.window, port, self, self.PAGE)
        self._frames.start()

    @abstractmethod
    def _show(self, time: float) -> Message:
        """Draw what is to be seen at a time of the motion, or by hand; return what the panels show."""

    @abstractmethod
    def _own_request(self, kind: str, value: Any) -> Request:
        """Return what a message of another kind than those of motions asks for, checked."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.url if self.server.running else 'stopped'})"

    def _repr_html_(self) -> str:
        """Show the page in a notebook; after `stop`, the scene as it was then."""
        source = f'src="{self.url}"'
        if not self.server.running:
            source = f'srcdoc="{html.escape(self.scene.window.get_scene())}"'
        return f'<iframe {source} style="width: 100%; height: 640px; border: 0"></iframe>'

    @property
    def url(self) -> str:
        """Where the page is."""
        return self.server.url

    @property
    def visualizer(self) -> Any:
        """Pinocchio's `MeshcatVisualizer` of the page, to draw more into it."""
        return self.scene.visualizer

    @property
    def frames(self) -> int:
        """How many frames have been drawn."""
        return self._frames.count

    def open(self) -> Self:
        """Open the page in the user's browser."""
        self.scene.window.open()
        return self

    def play(self) -> None:
        """Play the motion.

        Raises
        ------
        InputError
            If there is none.
        """
        self.received({"type": "play"})

    def pause(self) -> None:
        """Stop the motion where it is.

        Raises
        ------
        InputError
            If there is none.
        """
        self.received({"type": "pause"})

    def seek(self, time: float) -> None:
        """Stop at a time of the motion.

        Parameters
        ----------
        time : float
            [s]

        Raises
        ------
        InputError
            If there is no motion, or it has no such time.
        """
        self.received({"type": "time", "value": time})

    def set_speed(self, speed: float) -> None:
        """Play faster or slower.

        Parameters
        ----------
        speed : float
            How many times faster than in reality, from 0.1 to 4.

        Raises
        ------
        InputError
            If there is no motion, or the speed is out of range.
        """
        self.received({"type": "speed", "value": speed})

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is stopped.

        Parameters
        ----------
        timeout : float, optional
            How long [s]; for ever without.

        Returns
        -------
        bool
            Whether it was stopped.
        """
        return self._frames.wait(timeout)

    def stop(self) -> None:
        """End playing and serving: no thread and no port is left. May be called more than once."""
        self._frames.stop()
        self.server.stop()

    def greeting(self) -> list[Message]:
        """Return what a page is told when it is opened (for the server)."""
        self._frames.ask()
        return [self._setup, self._state]

    def received(self, message: Message) -> None:
        """Take what a page asks for, to be done with the next frame (for the server).

        Parameters
        ----------
        message : dict
            A ``type`` and mostly a ``value``.

        Raises
        ------
        InputError
            If it cannot be done.
        """
        kind = message.get("type")
        if not isinstance(kind, str) or kind not in self.KINDS:
            *first, last = self.KINDS
            raise InputError(f"type: expected {', '.join(first)} or {last}, got {shown(kind)}")
        request = self._request(kind, message.get("value"))
        with self._lock:
            self._requests.pop(kind, None)
            self._requests[kind] = request
        self._frames.ask()

    def _request(self, kind: str, value: Any) -> Request:
        """Return what a message asks for, checked."""
        if kind not in LivePage.KINDS:
            return self._own_request(kind, value)
        if not self._has_motion:
            raise InputError(f"{kind}: there is no motion to play")
        if kind == "time":
            time = within("time", value, self._player.start, self._player.end)
            return lambda: self._release(lambda: self._player.seek(time))
        if kind == "speed":
            speed = within("speed", value, SLOWEST, FASTEST)
            return lambda: self._player.set_speed(speed)
        return (lambda: self._release(self._player.play)) if kind == "play" else self._player.pause

    def _take(self, by_hand: FloatArray) -> None:
        """Stop the motion, and follow the hand."""
        self._player.pause()
        self._by_hand = by_hand

    def _release(self, then: Request) -> None:
        """Follow the motion again."""
        self._by_hand = None
        then()

    def _draw(self) -> bool:
        """Draw a frame; more are to follow while the motion plays and somebody looks."""
        self._step()
        self.server.tell(self._state, "state")
        return self._player.playing and self.server.pages > 0

    def _step(self) -> None:
        with self._lock:
            requests, self._requests = self._requests, {}
        for request in requests.values():
            request()
        time = self._player.time
        self._state = {
            "type": "state",
            **self._show(time),
            "source": "motion" if self._by_hand is None else "pose",
            "playing": self._player.playing,
            "time": time,
            "speed": self._player.speed,
        }


def player_of(time: FloatArray | None, speed: float, playing: bool, at: float | None) -> Player:
    """Return the player of a motion with such times (N,), or of none."""
    if time is None:
        return Player(0.0, 0.0, speed, False, at)
    return Player(float(time[0]), float(time[-1]), speed, playing, at)
