"""The best path of a task: blends and waypoints, as far as they may be moved, for the least time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from p3dof._base.checks import Progress
from p3dof._base.errors import SampleError, TaskError
from p3dof._base.tables import ShownInNotebook, Table, html_of, notebook_html, number, table_of
from p3dof.design.fastest import chosen_limits, fastest_along, fastest_plan, way_of
from p3dof.design.tasks import AxisLimits, FastestPlan, Path, Task, Waypoint
from p3dof.manipulator import Manipulator

_FEW, _FEW_SMOOTH = 60, 40  # steps along a way while paths are compared
_STEP, _LEAST = 0.25, 0.01  # shares of what a freedom allows by which the search goes first, and at last
_EVALUATIONS, _EVALUATIONS_SMOOTH = 150, 60  # most paths that are tried on a way, without and with a jerk
_GAIN = 1e-5  # least share of the time that is a gain while paths are compared


@dataclass(frozen=True, eq=False)
class BestPath(ShownInNotebook):
    """What `best_path` found.

    Parameters
    ----------
    task : Task
        With the blends and poses found.
    plan : FastestPlan
        Its fastest plan.
    given : Task
        What was asked for.
    given_plan : FastestPlan
        The fastest plan of that.
    """

    task: Task
    plan: FastestPlan
    given: Task
    given_plan: FastestPlan

    @property
    def decided(self) -> Task:
        """`task` without blend_range and tolerance, which are those about the given path and are used up."""
        points = (replace(point, blend_range=None, tolerance=None) for point in self.task.waypoints)
        return replace(self.task, waypoints=tuple(points))

    def __repr__(self) -> str:
        return f"BestPath({self.given_plan.duration:.6g} s → {self.plan.duration:.6g} s)"


def best_path(
    robot: Manipulator,
    task: Task,
    limits: AxisLimits | None = None,
    *,
    nodes: int | None = None,
    samples: int = 1001,
    progress: Progress | None = None,
) -> BestPath:
    """Return the path of a task that takes the least time, with blends and waypoints where they may be.

    A waypoint that is passed may say between which sizes its blend may be (`Waypoint.blend_range`), and how
    far its pose may be from the one given (`Waypoint.tolerance`). Way by way a compass search goes from the
    given path, and from those of the smallest and the largest blends, to faster ones, with few steps;
    the best is planned with as many as the given one. What is found is never slower than the given path, and
    the same every time; it is the best near it, not surely of all.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    task : Task
        What it has to do.
    limits : AxisLimits, optional
        As of `fastest_plan`.
    nodes : int, optional
        As of `fastest_plan`.
    samples : int
        As of `fastest_plan`.
    progress : callable, optional
        Called with (done, total) paths; most of the total may not be needed.

    Raises
    ------
    InputError, TaskError, ReachError, SingularityError
        As `fastest_plan`; also if no waypoint says what may be changed.
    """
    chosen = chosen_limits(robot, task, limits)
    free = [k for k, (a, b) in enumerate(task.stretches) if _freedoms(task, a, b)]
    if not free:
        raise TaskError(
            "no waypoint on a segment of free duration has a blend_range or a tolerance: nothing can be "
            "optimised"
        )
    given = fastest_plan(robot, task, limits, nodes=nodes, samples=samples)
    points = list(task.waypoints)
    most = _EVALUATIONS_SMOOTH if np.isfinite(chosen.jerk).any() else _EVALUATIONS
    total = most * len(free)
    for done, way in enumerate(free):
        first, last = task.stretches[way]
        search = _PathSearch(robot, task, chosen, (first, last), most)
        points[first : last + 1] = search.best(_counted(progress, done * most, total))
    if progress is not None:
        progress(total, total)
    found = replace(task, waypoints=tuple(points))
    plan = fastest_plan(robot, found, limits, nodes=nodes, samples=samples)
    if plan.duration >= given.duration:
        found, plan = task, given
    return BestPath(found, plan, task, given)


def _counted(progress: Progress | None, done: int, total: int) -> Callable[[int], None]:
    def told(more: int) -> None:
        if progress is not None:
            progress(done + more, total)

    return told


class _PathSearch:
    """The search for the best path from one stop to the next."""

    def __init__(
        self, robot: Manipulator, task: Task, limits: AxisLimits, stops: tuple[int, int], most: int
    ) -> None:
        self._robot, self._task, self._limits = robot, task, limits
        self._first, self._last = stops
        self._free, self._most = _freedoms(task, *stops), most
        self._steps = _FEW_SMOOTH if np.isfinite(limits.jerk).any() else _FEW
        self._known: dict[tuple[float, ...], float] = {}

    def best(self, told: Callable[[int], None]) -> Sequence[Waypoint]:
        """Return the waypoints of the way, its stops among them."""
        given = tuple(start for _, _, low, high, start in self._free)
        low, high = (tuple(one[k] for one in self._free) for k in (2, 3))
        blends = [one[1] < 0 for one in self._free]
        starts = [given]
        if any(blends):
            starts += [tuple(np.where(blends, end, given).tolist()) for end in (low, high)]
        place = min(starts, key=self._time)
        step = _STEP
        while step >= _LEAST and len(self._known) < self._most:
            best = min(self._around(place, step, told), key=self._time)
            if self._time(best) < self._time(place) * (1 - _GAIN):
                place = best
            else:
                step /= 2
        return self._points(place)

    def _around(
        self, place: tuple[float, ...], step: float, told: Callable[[int], None]
    ) -> list[tuple[float, ...]]:
        """Return the neighbours of a place, and where two good steps together lead."""
        found, downhill = [], np.zeros(len(place))
        for k, (_, _, low, high, _) in enumerate(self._free):
            for sign in (1, -1):
                moved = min(max(place[k] + sign * step * (high - low), low), high)
                other = (*place[:k], moved, *place[k + 1 :])
                if moved == place[k] or len(self._known) >= self._most:
                    continue
                found.append(other)
                if self._time(other) < self._time(place):
                    downhill[k] = moved - place[k]
                told(len(self._known))
        if np.count_nonzero(downhill) > 1:
            found.append(tuple((np.array(place) + downhill).tolist()))
        return found or [place]

    def _points(self, place: tuple[float, ...]) -> list[Waypoint]:
        points = list(self._task.waypoints[self._first : self._last + 1])
        for (k, what, *_), value in zip(self._free, place, strict=True):
            point = points[k]
            if what < 0:
                points[k] = replace(point, blend=value)
            else:
                pose = point.pose.copy()
                pose[what] = value
                points[k] = replace(point, pose=pose)
        return self._fitted(points)

    def _fitted(self, points: list[Waypoint]) -> list[Waypoint]:
        """Return the points, with blends that may be smaller made so small that they do not overlap."""
        least = {k: low for k, what, low, _, _ in self._free if what < 0}
        size = min(len(point.pose) for point in points)
        metric = np.array([1.0, 1.0, self._task.turning_length])[:size]
        for k in range(len(points) - 1):
            one, other = points[k : k + 2]
            leg = float(np.linalg.norm((other.pose[:size] - one.pose[:size]) * metric))
            free = [j for j in (k, k + 1) if j in least]
            over = one.blend + other.blend - leg
            room = sum(points[j].blend - least[j] for j in free)
            if over <= 0 or over > room:
                continue
            share = over / room
            for j in free:
                points[j] = replace(points[j], blend=points[j].blend - share * (points[j].blend - least[j]))
        return points

    def _time(self, place: tuple[float, ...]) -> float:
        """Return how long the way takes; infinite where it is not possible."""
        if place not in self._known:
            self._known[place] = self._found(place)
        return self._known[place]

    def _found(self, place: tuple[float, ...]) -> float:
        task, first, last = self._task, self._first, self._last
        try:
            points = self._points(place)
            path = Path(
                points,
                task.names[first : last + 1],
                task.turning_length,
                task.path == "spline",
                task.smoothness,
            )
            way = way_of(self._robot, task, path, (first, last), self._limits)
            return fastest_along(path, way, self._limits, self._steps, starts=1).duration
        except (TaskError, SampleError):
            return math.inf


def _freedoms(task: Task, first: int, last: int) -> list[tuple[int, int, float, float, float]]:
    """Return what may be changed: waypoint of the way, -1 for the blend or a coordinate, low, high, given."""
    found: list[tuple[int, int, float, float, float]] = []
    if task.waypoints[last].duration is not None:
        return found
    for k, point in enumerate(task.waypoints[first : last + 1]):
        if point.blend_range is not None and task.path != "spline":
            found.append((k, -1, *point.blend_range, point.blend))
        if point.tolerance is not None:
            for what, half in enumerate(point.tolerance.tolist()):
                if half > 0:
                    middle = float(point.pose[what])
                    found.append((k, what, middle - half, middle + half, middle))
    return found


def best_path_table(found: BestPath) -> Table:
    """Return what was changed of a path."""
    rows: dict[str, tuple[str, ...]] = {
        "whole task: time [s]": (number(found.given_plan.duration), number(found.plan.duration), "")
    }
    points = zip(found.given.names, found.given.waypoints, found.task.waypoints, strict=True)
    for name, old, new in points:
        if old.blend_range is not None and found.given.path != "spline":
            bounds = " to ".join(f"{1e3 * end:g}" for end in old.blend_range)
            rows[f"{name}: blend [mm]"] = (number(1e3 * old.blend), number(1e3 * new.blend), bounds)
        if old.tolerance is None:
            continue
        units = (("y [mm]", 1e3), ("z [mm]", 1e3), ("θ [deg]", 180 / math.pi))
        for k, (what, unit) in enumerate(units[: len(old.tolerance)]):
            middle, half = unit * old.pose[k], unit * old.tolerance[k]
            if half > 0:
                bounds = f"{middle - half:g} to {middle + half:g}"
                rows[f"{name}: {what}"] = (number(middle), number(unit * new.pose[k]), bounds)
    return table_of("Optimised path", ("", "given", "best", "allowed"), rows)


@html_of.register(BestPath)
def best_path_html(found: BestPath) -> str:
    """Return how a notebook shows the best path, as HTML."""
    facts = f"{number(found.given_plan.duration)} s → {number(found.plan.duration)} s"
    return notebook_html("Best path", facts, [best_path_table(found)])
