"""`Task`: what the platform has to do: where to go, what to carry, in what time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from p3dof._base.checks import FloatArray, Readable, meant, positive, shown
from p3dof._base.errors import TaskError
from p3dof._base.time_series.times import sample_count
from p3dof.design.tasks.laws import PROFILES, ProfileLaw
from p3dof.design.tasks.limits import AxisLimits
from p3dof.design.tasks.paths import JointPath, Path, SampledPath, Waypoint, stops_of
from p3dof.design.tasks.plan import Plan, Stretch, planned
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Body, Geometry
from p3dof.machine.parameters.machine import body_of

PATHS = ("straight", "spline", "joint")
"""How the platform goes between stops: on lines with blends, on a spline, or with its sliders on lines."""
_GRID = 401
_MOST = 1000
_SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Task(Readable):
    """What the platform has to do: from stop to stop, at rest in each, with continuous acceleration.

    Parameters
    ----------
    waypoints : iterable of Waypoint
        Where it has to go: at least two, the first and the last of them stops.
    name : str
        What the task is called.
    path : {"straight", "spline", "joint"}
        Lines with blends at the waypoints that are passed, or a spline of degree 5 from stop to stop, which
        needs blends only to say that it does not stop. With ``"joint"`` the sliders go on lines with blends,
        each a share of its way at a time: that takes a machine, see `on`.
    profile : {"quintic", "septic", "s-curve"}
        How the way is covered in time: acceleration zero at both ends, jerk zero too, or seven equal parts of
        constant jerk.
    smoothness : {2, 3}
        How many derivatives of the path go on where blends begin and end.
    turning_length : float
        ℓ: a turn of 1 rad counts as so much way where lengths of poses and shares of time are meant [m].
    carrying : Body, float or str, optional
        What the platform carries at the beginning, as `Waypoint.pick_up`.
    limits : mapping of str to float or sequence of three, optional
        Limits of the actuators in the time-optimal plan, by the names of `AxisLimits`; force and
        speed of the machine where there are none.

    Raises
    ------
    TaskError
        If there are too few waypoints, the first or the last is passed, something is picked up while another
        thing is carried, or put down with nothing carried, or a path is not possible.
    """

    waypoints: tuple[Waypoint, ...]
    name: str = ""
    path: str = "straight"
    profile: str = "quintic"
    smoothness: int = 2
    turning_length: float = 0.1
    carrying: Body | None = None
    limits: Mapping[str, Any] = field(default_factory=dict)
    _geometry: ClassVar[Geometry | None] = None

    def __init__(
        self,
        waypoints: Iterable[Waypoint],
        name: str = "",
        path: str = "straight",
        profile: str = "quintic",
        smoothness: int = 2,
        turning_length: float = 0.1,
        carrying: Body | float | str | None = None,
        limits: Mapping[str, Any] | None = None,
    ) -> None:
        points = tuple(waypoints)
        for point in points:
            if not isinstance(point, Waypoint):
                raise TaskError(f"waypoints: expected Waypoint objects, got {shown(point)}")
        if not 2 <= len(points) <= _MOST:
            raise TaskError(f"waypoints: expected from 2 to {_MOST}, got {len(points)}")
        if not isinstance(name, str):
            raise TaskError(f"name: expected a text, got {shown(name)}")
        for what, value, known in (("path", path, PATHS), ("profile", profile, tuple(PROFILES))):
            if value not in known:
                raise TaskError(f"{what}: expected one of {', '.join(known)}, got {shown(value)}")
        if isinstance(smoothness, bool) or smoothness not in (2, 3):
            raise TaskError(f"smoothness: expected 2 or 3, got {shown(smoothness)}")
        values = {
            "waypoints": points,
            "name": name,
            "path": path,
            "profile": profile,
            "smoothness": int(smoothness),
            "turning_length": positive("turning_length", turning_length, TaskError),
            "carrying": None if carrying is None else body_of(carrying, "carrying", TaskError),
            "limits": _checked_limits({} if limits is None else limits),
        }
        for what, setting in values.items():
            object.__setattr__(self, what, setting)
        self._check()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What each waypoint is called."""
        return tuple(point.name or f"waypoint {k + 1}" for k, point in enumerate(self.waypoints))

    @property
    def closed(self) -> bool:
        """Whether it ends where it began, so that it can be repeated."""
        first, last = self.waypoints[0].pose, self.waypoints[-1].pose
        return bool(np.abs(first - last).max() <= _SAME)

    @property
    def dwell(self) -> float:
        """Time at rest in all stops [s]."""
        return float(sum(point.dwell for point in self.waypoints))

    @cached_property
    def paths(self) -> tuple[Path, ...]:
        """The ways from stop to stop."""
        return tuple(self.path_through(self.waypoints[a : b + 1], (a, b)) for a, b in self.stretches)

    def path_through(self, waypoints: Sequence[Waypoint], stops: tuple[int, int]) -> Path:
        """Return a way between two stops of this task, by index, through waypoints in place of its own."""
        names = self.names[stops[0] : stops[1] + 1]
        if self.path != "joint":
            return Path(waypoints, names, self.turning_length, self.path == "spline", self.smoothness)
        if self._geometry is None:
            raise TaskError("path: joint: expected a machine, by task.on(robot.parameters.geometry)")
        return JointPath(waypoints, names, self._geometry, self.smoothness)

    def on(self, geometry: Geometry) -> Task:
        """Return the task on a machine, which a path of ``"joint"`` needs; others stay as they are.

        Parameters
        ----------
        geometry : Geometry
            Lengths of the machine, `robot.parameters.geometry`.

        Raises
        ------
        TaskError
            If a path is not possible.
        ReachError
            If the machine cannot reach a waypoint.
        """
        if not isinstance(geometry, Geometry):
            raise TaskError(f"geometry: expected a Geometry, got {shown(geometry)}")
        if self.path != "joint":
            return self
        bound = replace(self)
        object.__setattr__(bound, "_geometry", geometry)
        bound._check()
        return bound

    @cached_property
    def stretches(self) -> tuple[tuple[int, int], ...]:
        """Indices of the stops that each way begins and ends with."""
        stops = [k for k, point in enumerate(self.waypoints) if point.stops]
        return tuple(pairwise(stops))

    def plan(self, duration: float | None = None, samples: int = 1001) -> Plan:
        """Return the motion with what acts on the way.

        Parameters
        ----------
        duration : float, optional
            Time of the whole task, dwells included [s]. What is left of it is shared out to the ways whose
            stops have no duration of their own, so that the largest acceleration is the same in all of them,
            in the metric (y, z, ℓ θ). Not needed where all have one.
        samples : int
            Least number of samples of the ways together. They are even over each straight or blended part of
            a way, which has a seventh of so many at least, so that the peaks are seen however long the
            platform dwells; all stops and waypoints are samples.

        Raises
        ------
        TaskError
            If the duration is missing, is not above the time that dwells and given durations take, or differs
            from what all durations give.
        MotionError
            If `samples` does not fit.
        """
        count = sample_count(samples, least=2)
        times = self._times(duration)
        stretches = [
            Stretch(path, a, b, ProfileLaw(PROFILES[self.profile], path.end, float(time)))
            for path, (a, b), time in zip(self.paths, self.stretches, times, strict=True)
        ]
        return planned(self.waypoints, self.names, self.carrying, stretches, count, self.name)

    def _times(self, duration: float | None) -> FloatArray:
        """Return how long each way takes [s]."""
        times = np.array([self.waypoints[b].duration or np.nan for _, b in self.stretches])
        free = np.isnan(times)
        given = self.dwell + float(times[~free].sum())
        if duration is None:
            if free.any():
                stop = self.names[self.stretches[int(np.argmax(free))][1]]
                raise TaskError(
                    f"duration: expected that of the whole task, since {stop} has none of its own"
                )
            return times
        total = positive("duration", duration, TaskError)
        if not free.any():
            if abs(total - given) > 1e-9 * total:
                raise TaskError(
                    f"duration: expected {given:g} s, which the waypoints add up to, got {total:g} s"
                )
            return times
        if total <= given:
            raise TaskError(
                f"duration: expected more than the {given:g} s that dwells and given durations take, "
                f"got {total:g} s"
            )
        needs = np.array([np.sqrt(self._hardest(path)) for path in self.paths])
        times[free] = (total - given) * needs[free] / needs[free].sum()
        return times

    def _hardest(self, path: Path) -> float:
        """Return the largest acceleration on a way that takes one second [m/s²]."""
        share, rate, change = PROFILES[self.profile](np.linspace(0, 1, _GRID, dtype=np.float64))
        _, slope, bend = path.at(path.end * share)
        found = bend * (path.end * rate[:, None]) ** 2 + slope * path.end * change[:, None]
        return float(np.linalg.norm(found * [1, 1, self.turning_length], axis=1).max())

    def _check(self) -> None:
        """Raise unless it can be done, whatever the machine."""
        for k in (0, -1):
            if not self.waypoints[k].stops:
                raise TaskError(
                    f"{self.names[k]}: expected a stop at the beginning and at the end, got a blend"
                )
        if self.waypoints[0].duration is not None:
            raise TaskError(f"{self.names[0]}: duration: nothing is before the first waypoint")
        if self.waypoints[0].wrench.any():
            raise TaskError(f"{self.names[0]}: wrench: nothing is before the first waypoint")
        carried = self.carrying is not None
        for name, point in zip(self.names, self.waypoints, strict=True):
            if point.put_down and not carried:
                raise TaskError(f"{name}: put_down: the platform carries nothing here")
            carried = carried and not point.put_down
            if point.pick_up is not None and carried:
                raise TaskError(f"{name}: pick_up: the platform carries something already; put it down first")
            carried = carried or point.pick_up is not None
        if self.path != "joint" or self._geometry is not None:
            _ = self.paths  # says at once that one is not possible


class MotionTask(Task):
    """What a motion does, but for its timing: the same path with the same rests.

    The ways between its rests are splines through its poses. Where it is slowest, and a thousand times slower
    than at its fastest, it stops for a moment; its first and last samples are stops whatever their speed.
    """

    def __init__(
        self,
        motion: Motion,
        name: str = "",
        turning_length: float = 0.1,
        limits: Mapping[str, Any] | None = None,
    ) -> None:
        if not isinstance(motion, Motion):
            raise TaskError(f"motion: expected a Motion, got {shown(motion)}")
        length = positive("turning_length", turning_length, TaskError)
        rests = stops_of(motion, length)
        begins, ends = (motion.time[[rest[k] for rest in rests]] for k in (0, 1))
        points = [
            Waypoint(motion.pose[last], f"stop at {begin:g} s", dwell=float(end - begin))
            for (_, last), begin, end in zip(rests, begins, ends, strict=True)
        ]
        points[0], points[-1] = (replace(points[k], name=name) for k, name in ((0, "start"), (-1, "end")))
        ways = tuple(SampledPath(motion[a : b + 1], length) for (_, a), (b, _) in pairwise(rests))
        object.__setattr__(self, "paths", ways)
        super().__init__(points, name, turning_length=length, limits=limits)


def _checked_limits(given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return limits by name, numbers or rows of three."""
    known = [one.name for one in fields(AxisLimits)]
    if not isinstance(given, Mapping):
        raise TaskError(f"limits: expected limits by name, got {shown(given)}")
    for name in given:
        if name not in known:
            wanted = f"expected one of {', '.join(known)}{meant(name, known)}"
            raise TaskError(f"limits: unknown limit {shown(name)}, {wanted}")
    try:
        checked = AxisLimits(**({"force": 1.0, "speed": 1.0} | dict(given)))
    except TaskError as error:
        raise TaskError(f"limits: {error}") from error
    rows = {name: getattr(checked, name).tolist() for name in given if given[name] is not None}
    return MappingProxyType(
        {name: row[0] if all(one == row[0] for one in row) else tuple(row) for name, row in rows.items()}
    )
