"""The frames of an animation of any robot, and the page that plays them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from p3dof.checks import FloatArray
from p3dof.viewer.pages import as_script, filled, resource, standalone
from p3dof.viewer.recorder import Recorder, packed

MAX_FRAMES = 20_000
"""Most frames of an animation: that is tens of megabytes."""
_WORDS = {"N": "force", "N m": "torque"}
"""What has a unit."""


@dataclass(frozen=True, eq=False)
class Frames:
    """What is shown, evenly spaced in time.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times of the motion [s].
    joints : ndarray, shape (N, nq)
        Joints in Pinocchio's order; of the manipulator, those of the last pose within reach where one is not.
    forces : ndarray, shape (N, n)
        Of the n actuators [N or N m]; NaN where there are none.
    """

    time: FloatArray
    joints: FloatArray
    forces: FloatArray

    @property
    def rate(self) -> float:
        """Frames a second of the motion; 1 when there is only one."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0]) if len(self.time) > 1 else 1.0


@dataclass(frozen=True)
class Labels:
    """What the page says of the forces of n actuators.

    Parameters
    ----------
    names : tuple of str
        Names of the actuators.
    colours : tuple of tuple of float
        Red, green, blue (and opacity) of each, from 0 to 1.
    legend : str
        What the arrows mean, in words.
    units : tuple of str, optional
        Of each force, ``"N"`` or ``"N m"``; newtons by default.
    digits : int
        Digits behind the point.
    layers : sequence of [str, str, bool, list of str]
        Parts of the picture that can be hidden: name, words, whether it is seen at first, nodes.
    closures : sequence of dict
        ``number``, ``kind`` and ``name`` of each closure, and ``texts``, what is said of it in each frame.
    """

    names: tuple[str, ...]
    colours: tuple[Sequence[float], ...]
    legend: str
    units: tuple[str, ...] | None = None
    digits: int = 1
    layers: Sequence[Any] = ()
    closures: Sequence[Mapping[str, Any]] = ()


def page_of(window: Recorder, frames: Frames, labels: Labels, speed: float, title: str, mesh: float) -> str:
    """Return the page that plays what a window has recorded.

    Parameters
    ----------
    window : Recorder
        With all frames.
    frames : Frames
        Their times and forces.
    labels : Labels
        What is said of the forces.
    speed : float
        Seconds of the motion a second.
    title : str
        Heading of the page.
    mesh : float
        Distance between the lines of the floor [m].

    Returns
    -------
    str
        HTML with everything in it.
    """
    units = labels.units or ("N",) * len(labels.names)
    motion = {
        "title": title,
        "start": float(frames.time[0]),
        "speed": speed,
        "rate": frames.rate,
        "mesh": round(mesh, 12),
        "legend": labels.legend,
        "names": list(labels.names),
        "words": [f"{_WORDS[unit]} {name}" for name, unit in zip(labels.names, units, strict=True)],
        "units": list(units),
        "digits": labels.digits,
        "colours": [_web_colour(colour) for colour in labels.colours],
        "layers": list(labels.layers),
        "closures": [dict(closure) for closure in labels.closures],
        "forces": [[_plain(force, max(4, labels.digits)) for force in row] for row in frames.forces],
    }
    script = filled(resource("animation.js"), MOTION=as_script(motion))
    return standalone([*window.messages(), packed(window.clips(frames.rate))], title, script)


def _plain(force: float, digits: int) -> float | None:
    return round(float(force), digits) if math.isfinite(force) else None


def _web_colour(rgba: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgba[:3])
