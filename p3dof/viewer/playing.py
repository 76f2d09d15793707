"""Motions in MeshCat: what is played, in real time, in a scene of the machine or any robot."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from typing_extensions import Self

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.encoding import some_of
from p3dof.viewer.document.motion import MOST_SAMPLES
from p3dof.viewer.recording import Film, Recording
from p3dof.viewer.showing import start_of
from p3dof.viewer.window import SceneWindow

_PICTURES = 60.0
"""Most pictures a second."""
_KEYS = 100.0
"""Most samples a second of a motion that is recorded."""
PATIENCE = 5.0
"""How long a motion waits for a page before it begins [s]."""


@dataclass(frozen=True, eq=False)
class Take:
    """What is played."""

    time: FloatArray  # (N,): rising times [s]
    q: FloatArray  # (N, nq): joint positions; NaN where they are not known
    forces: FloatArray  # (N, n): of the actuators [N or N m]; no column where they are not known
    path: FloatArray  # (M, 3): of the point whose path is drawn [m]

    def at(self, model: pin.Model, moment: float) -> tuple[FloatArray, FloatArray] | None:
        """Return joints and forces at a time, between samples by interpolation; None if they are NaN."""
        i = int(np.searchsorted(self.time, moment, side="right")) - 1
        q, forces = self.q[i], self.forces[i]
        if i + 1 < len(self.time) and moment > self.time[i]:
            share = (moment - self.time[i]) / (self.time[i + 1] - self.time[i])
            q = np.asarray(pin.interpolate(model, q, self.q[i + 1], share))
            forces = (1.0 - share) * forces + share * self.forces[i + 1]
        return (q, forces) if np.isfinite(q).all() else None


class MotionScene:
    """One robot in a window of MeshCat, which shows and plays its motions.

    What draws the machine, or any robot, says what a motion is, and draws what is around it.
    """

    model: pin.Model  # of the robot
    title: str  # of a page of its motions

    def __init__(self, window: SceneWindow | None, model: pin.Model, visual_model: Any) -> None:
        self.window = SceneWindow() if window is None else window
        self.drawing = threading.RLock()  # one picture after the other, whichever threads draw
        self.model = model
        from p3dof.viewer.visualizer import MotionVisualizer  # meshcat

        self.visualizer: Any = MotionVisualizer(self, model, visual_model)
        self._viewer = self.visualizer.viewer

    def take(self, motion: Any, wrench: Any = None) -> Take:
        """Return what is played of a motion, a result or a run."""
        raise NotImplementedError

    def begin(self, take: Take) -> None:
        """Draw the path, and set scales and camera for what is to be played."""
        raise NotImplementedError

    def another(self) -> MotionScene:
        """Return the same robot in a window of its own."""
        raise NotImplementedError

    def display(self, q: FloatArray, forces: FloatArray | None = None) -> None:
        """Show the robot at joint positions, and the forces of its actuators."""
        raise NotImplementedError

    def follow(self) -> None:
        """Draw what moves with the robot, after its bodies."""

    def player(
        self,
        motion: Any,
        *,
        wrench: Any = None,
        speed: float = 1.0,
        at: float | None = None,
        repeat: bool = False,
        playing: bool = True,
    ) -> Player:
        """Return what plays a motion, drawn at its beginning; arguments as of `MotionVisualizer.play`."""
        take = self.take(motion, wrench)
        start = start_of(take.time, at, speed, playing)
        with self.drawing:
            self.begin(take)
        return Player(self, take, start["speed"] if playing else 0.0, start.get("time"), repeat)

    def record(
        self,
        motion: Any,
        *,
        wrench: Any = None,
        speed: float = 1.0,
        at: float | None = None,
        repeat: bool = True,
        playing: bool = True,
    ) -> Recording:
        """Return a page that plays a motion; arguments as of `MotionVisualizer.play`."""
        from meshcat.commands import SetAnimation

        scene = self.another()
        film = Film(scene.window)
        player = scene.player(motion, wrench=wrench, speed=speed, at=at)
        times = player.take.time
        most = min(MOST_SAMPLES, math.ceil((times[-1] - times[0]) * _KEYS) + 1)
        for moment in times[some_of(len(times), max(most, 2))]:
            player.draw(float(moment))
            film.keep(float(moment - times[0]))
        again = math.inf if repeat else 1
        scene.window.send(SetAnimation(film.animation(), repetitions=again))
        start = start_of(times, at, speed, playing and len(times) > 1) | {"first": float(times[0])}
        return Recording(scene.window, self.title, start)


class Player:
    """Plays a motion in real time: each picture is that of its instant, however long drawing takes."""

    def __init__(self, scene: MotionScene, take: Take, speed: float, at: float | None, repeat: bool) -> None:
        self.take = take
        self._scene, self._speed, self._repeat = scene, speed, repeat
        self._begin = 0.0 if at is None else at - float(take.time[0])
        self._since: float | None = None
        self._patience = math.inf
        self._drawn = math.nan
        self.draw(float(take.time[0]) + self._begin)

    def draw(self, moment: float) -> None:
        """Draw the motion at a time [s]; what is not known leaves the picture before."""
        found = self.take.at(self._scene.model, moment)
        if found is not None and moment != self._drawn:
            self._scene.display(found[0], found[1] if found[1].size else None)
            self._drawn = moment

    def run(self, seconds: float = math.inf) -> bool:
        """Play to the end, or for so long [s] and go on with the next call; return whether it has ended."""
        now = time.monotonic()
        until, ended = now + seconds, False
        while not ended and now < until:
            ended = self._step(now)
            time.sleep(max(min(now + 1.0 / _PICTURES, until) - time.monotonic(), 0.0))
            now = time.monotonic()
        return ended

    def _step(self, now: float) -> bool:
        if self._since is None:  # it begins when somebody looks, or nobody comes
            self._patience = min(self._patience, now + PATIENCE)
            self._since = now if self._scene.window.watched or now >= self._patience else None
        elapsed = self._begin + (0.0 if self._since is None else (now - self._since) * self._speed)
        first, last = float(self.take.time[0]), float(self.take.time[-1])
        if self._repeat and elapsed > last - first > 0.0:
            elapsed %= last - first
        self.draw(min(first + elapsed, last))
        return self._since is not None and not self._repeat and first + elapsed >= last


class PlayedPage:
    """The page of a visualizer in which a motion is played, as a context that ends it."""

    def __init__(self, visualizer: Any, motion: Any, **options: Any) -> None:
        self._visualizer = visualizer
        try:
            self._player: Player = visualizer.scene.player(motion, **options)
        except BaseException:
            visualizer.viewer.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._visualizer.viewer.close()

    @property
    def url(self) -> str:
        """Where it is."""
        return str(self._visualizer.viewer.url())

    def open(self) -> Self:
        """Open it in the user's browser."""
        self._visualizer.viewer.open()
        return self

    def wait(self, timeout: float | None = None) -> bool:
        """Play for so long [s], or to the end; return whether it has ended."""
        return self._player.run(math.inf if timeout is None else timeout)


def served(make: Callable[[SceneWindow], MotionScene], port: int | None) -> Any:
    """Return the visualizer of a scene that is made in a window, served at a port."""
    from p3dof.viewer.server import ServedWindow, Server  # tornado

    window = ServedWindow()
    scene = make(window)
    window.server = Server(window, port)
    return scene.visualizer
