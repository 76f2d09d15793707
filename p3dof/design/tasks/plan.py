"""`Plan`: a task in time: its motion, and what the platform carries and bears along the path."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.time_series.smoothing import subdivided
from p3dof.design.tasks.laws import Law
from p3dof.design.tasks.paths import Path, Waypoint
from p3dof.machine.motion import Motion, WrenchHistory
from p3dof.machine.parameters import Body

JUMP = 1e-9  # share of a plan within which the wrench of a history changes from one constant value to another
_PARTS = 7
"""Every part of a way has so many times fewer samples than all ways are asked to have, at least; and a wait
so many times fewer again."""
_BETWEEN = 5  # least number of steps between a jump of an acceleration and the next
_CLOSE, _BESIDE, _ROOM = 1e-9, 1e-7, 1e-4
"""Shares of the time that all ways take: within the first two samples are one, and by the second the samples
on both sides of a jump are apart; or by the third of the step beside, if that is less."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A way from one stop to the next, and its time."""

    path: Path  # where it goes
    first: int  # the waypoints at its ends
    last: int
    law: Law  # how it is covered in time


@dataclass(frozen=True, eq=False)
class Source:
    """What a plan was made of, to plan it with other laws."""

    waypoints: tuple[Waypoint, ...]
    carrying: Body | None
    stretches: tuple[Stretch, ...]

    def bends(self) -> tuple[FloatArray, FloatArray]:
        """Return when accelerations jump, and when they or their rates may [s].

        Of a law that jumps, the many small steps of its rate are left out.
        """
        jumps: list[FloatArray] = [np.zeros(0)]
        bends: list[FloatArray] = [np.zeros(0)]
        for begin, stretch in _begun(self.waypoints, self.stretches):
            law = stretch.law
            jumps.append(begin + law.jumps)
            own = law.jumps if len(law.jumps) else law.kinks
            bends += [begin + own, begin + law.when(stretch.path.breaks)]
        return np.unique(np.concatenate(jumps)), np.unique(np.concatenate(bends))


@dataclass(frozen=True, eq=False)
class Piece(Readable):
    """A part of a plan over which load and payload stay."""

    first: str  # the waypoints at its ends; the same during a dwell
    last: str
    motion: Motion  # what the platform does, both ends included
    payload: Body | None  # what it carries
    wrench: FloatArray  # (6,): external force and moment on the platform at P, in the fixed frame [N, N m]

    @property
    def dwells(self) -> bool:
        """Whether the platform stays where it is."""
        return self.first == self.last

    @property
    def name(self) -> str:
        """What tables call it."""
        return f"at {self.first}" if self.dwells else f"{self.first} → {self.last}"


@dataclass(frozen=True, eq=False)
class Plan(Readable):
    """A task in time.

    Parameters
    ----------
    name : str
        Of the task.
    motion : Motion
        Of the platform, from 0.
    pieces : tuple of Piece
        The same in parts, from waypoint to waypoint, with what acts in each.
    waypoints : tuple of str
        Names of the waypoints.
    times : ndarray, shape (K,)
        When the platform gets to each waypoint; where it is passed by a blend, to the middle of that [s].
    source : Source, optional
        Paths and laws, to shape it by `p3dof.design.shaped`.
    """

    name: str
    motion: Motion
    pieces: tuple[Piece, ...]
    waypoints: tuple[str, ...]
    times: FloatArray
    source: Source | None = field(default=None, kw_only=True, repr=False)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.motion.duration

    def piece_at(self, time: float) -> Piece:
        """Return the piece that a time belongs to; the former where two meet.

        Parameters
        ----------
        time : float
            [s]
        """
        ends = [float(piece.motion.time[-1]) for piece in self.pieces]
        return self.pieces[min(int(np.searchsorted(ends, time)), len(ends) - 1)]

    @property
    def wrench(self) -> WrenchHistory | None:
        """The external wrench over time; None if there is none. Steps take a billionth of the duration."""
        if not any(piece.wrench.any() for piece in self.pieces):
            return None
        step = JUMP * self.duration
        times, rows = [0.0], [self.pieces[0].wrench]
        for former, latter in zip(self.pieces[:-1], self.pieces[1:], strict=True):
            if (former.wrench != latter.wrench).any():
                change = float(latter.motion.time[0])
                times += [change, change + step]
                rows += [former.wrench, latter.wrench]
        if times[-1] < self.duration:
            times.append(self.duration)
            rows.append(self.pieces[-1].wrench)
        return WrenchHistory(np.array(times), np.array(rows), 0.0)


@dataclass(frozen=True, eq=False)
class Span:
    """A part of a plan before its samples are known, as `Piece`."""

    first: int
    last: int
    start: float
    end: float
    payload: Body | None
    wrench: FloatArray


def planned(
    waypoints: Sequence[Waypoint],
    names: Sequence[str],
    carrying: Body | None,
    stretches: Sequence[Stretch],
    samples: int,
    name: str,
) -> Plan:
    """Return a plan of ways whose durations are known."""
    spans = list(_spans(waypoints, carrying, stretches))
    time = sampled(spans, list(_begun(waypoints, stretches)), samples)
    motion = _moved(waypoints, stretches, time)
    pieces = []
    for span in spans:
        begin, end = np.searchsorted(time, [span.start, span.end])
        rows = slice(int(begin), int(end) + 1)
        pieces.append(Piece(names[span.first], names[span.last], motion[rows], span.payload, span.wrench))
    times = np.zeros(len(waypoints))
    for span in reversed(spans):
        if span.first != span.last:
            times[span.last] = span.end
    source = Source(tuple(waypoints), carrying, tuple(stretches))
    return Plan(name, motion, tuple(pieces), tuple(names), times, source=source)


def sampled(spans: Sequence[Span], begun: Sequence[tuple[float, Stretch]], samples: int) -> FloatArray:
    """Return the times of the samples of a plan; ndarray, shape (N,): rising, from 0 [s].

    They are even over each straight or blended part of a way, which has a seventh of `samples` at least, so
    that no peak is lost whatever else the task does meanwhile; where the platform stays, few are enough.
    Where loads or accelerations change at once, there is a sample, and another one on the other side of a
    jump of the acceleration.
    """
    moving, total = sum(stretch.law.duration for _, stretch in begun), spans[-1].end
    close = max(_CLOSE * moving, 1e-15 * total)
    turns = _apart([begin + s.law.when(s.path.breaks) for begin, s in begun], np.zeros(0), close)
    ends = np.array([0.0, *(span.end for span in spans)])
    kinks = _apart([begin + s.law.kinks for begin, s in begun], np.append(ends, turns), close)
    jumps = np.sort(np.concatenate([begin + s.law.jumps for begin, s in begun] or [np.zeros(0)]))
    least = math.ceil((samples - 1) / _PARTS)
    found = [ends[-1:]]
    for span in spans:
        inner = turns[(turns > span.start + close) & (turns < span.end - close)]
        for start, end in pairwise([span.start, *inner.tolist(), span.end]):
            count = max(least, math.ceil((samples - 1) * (end - start) / moving - 1e-9))
            if span.first == span.last:
                count = math.ceil(least / _PARTS)
            edges = np.concatenate([[start], kinks[(kinks > start) & (kinks < end)], [end]])
            found.append(_between(edges, (end - start) / count, _gap(edges, jumps) <= close, close))
    every = np.sort(np.concatenate(found))
    beside, end = [every], 0.0
    for begin, stretch in begun:
        at = np.searchsorted(every, begin + stretch.law.jumps - close)
        room = np.diff(every, prepend=-np.inf, append=np.inf)
        apart = np.minimum(_BESIDE * moving, _ROOM * np.minimum(room[at], room[at + 1]))
        if begin > end:
            beside.append(every[at[:1]] + apart[:1])  # after a dwell, which has the sample where both meet
        beside.append(every[at[1:]] - apart[1:])
        end = begin + stretch.law.duration
    return np.sort(np.concatenate(beside))


def _between(edges: FloatArray, step: float, jumps: NDArray[np.bool_], close: float) -> FloatArray:
    """Return times from each edge to before the next, evenly: so many that no step is longer.

    From a jump to the next there are some at least, for derivatives from one side.
    """
    size = np.diff(edges)
    count = np.ceil(size / step - 1e-9)
    count = np.where(jumps[1:] & jumps[:-1], np.maximum(count, _BETWEEN), count)
    count = np.minimum(count, np.maximum(1, size // close)).astype(np.intp)
    return subdivided(edges, count)


def _apart(times: Sequence[FloatArray], known: FloatArray, close: float) -> FloatArray:
    """Return those of times, shape (N,), that are no closer to each other, and to known ones, than that."""
    every: FloatArray = np.sort(np.concatenate(times))
    every = every[np.append(True, np.diff(every) > close)[: len(every)]]
    return np.asarray(every[_gap(every, known) > close])


def _gap(times: FloatArray, known: FloatArray) -> FloatArray:
    """Return how far each of some times is from the nearest known one, infinite if there is none [s]."""
    if not len(known):
        return np.full(len(times), np.inf)
    there = np.sort(known)
    after = np.searchsorted(there, times)
    nearest = [there[np.minimum(after, len(there) - 1)], there[np.maximum(after - 1, 0)]]
    return np.asarray(np.abs(np.array(nearest) - times).min(axis=0))


def payloads(waypoints: Sequence[Waypoint], carrying: Body | None) -> list[Body | None]:
    """Return what the platform carries on the way to each waypoint; to the first, at the beginning."""
    found = []
    for point in waypoints:
        found.append(carrying)
        carrying = None if point.put_down else carrying
        carrying = carrying if point.pick_up is None else point.pick_up
    return found


def _spans(
    waypoints: Sequence[Waypoint], carrying: Body | None, stretches: Sequence[Stretch]
) -> Iterator[Span]:
    """Go through a task: dwells at stops, and ways from waypoint to waypoint."""
    none, time, carried = np.zeros(6), 0.0, payloads(waypoints, carrying)
    for stretch in (None, *stretches):
        if stretch is not None:
            passed = stretch.law.when(stretch.path.at_waypoints)
            for k in range(stretch.first, stretch.last):
                begin, end = time + passed[k - stretch.first : k - stretch.first + 2]
                yield Span(k, k + 1, float(begin), float(end), carried[k + 1], waypoints[k + 1].wrench)
            time = float(time + passed[-1])
        stop = 0 if stretch is None else stretch.last
        point = waypoints[stop]
        if point.dwell > 0:
            here = carried[stop] if point.pick_up is None else point.pick_up
            yield Span(stop, stop, time, time + point.dwell, here, none)
            time += point.dwell


def _begun(waypoints: Sequence[Waypoint], stretches: Sequence[Stretch]) -> Iterator[tuple[float, Stretch]]:
    """Go through the ways with the times at which they begin [s]."""
    begin = waypoints[0].dwell
    for stretch in stretches:
        yield begin, stretch
        begin = begin + stretch.law.duration + waypoints[stretch.last].dwell


def _moved(waypoints: Sequence[Waypoint], stretches: Sequence[Stretch], time: FloatArray) -> Motion:
    """Return the motion of the platform at times.

    Where an acceleration jumps, a sample has that of what begins there, and the last one that of what ends.
    """
    pose = np.tile(waypoints[0].pose, (len(time), 1))
    velocity, acceleration = np.zeros_like(pose), np.zeros_like(pose)
    for begin, stretch in _begun(waypoints, stretches):
        end = begin + stretch.law.duration
        pose[time >= end] = waypoints[stretch.last].pose
        starts = time >= begin if waypoints[stretch.first].dwell == 0 else time > begin
        rows = starts & ((time < end) | (time == time[-1]) & (waypoints[stretch.last].dwell == 0))
        parameter, speed, change = stretch.law.at(time[rows] - begin)
        place, slope, bend = stretch.path.at(np.clip(parameter, 0.0, stretch.path.end))
        pose[rows] = place
        velocity[rows] = slope * speed[:, None]
        acceleration[rows] = bend * speed[:, None] ** 2 + slope * change[:, None]
        at_rest = (time == begin) | (time == end)
        pose[time == end] = waypoints[stretch.last].pose
        velocity[at_rest] = 0.0
    return Motion(time, pose, velocity, acceleration, check=False, start=0.0)
