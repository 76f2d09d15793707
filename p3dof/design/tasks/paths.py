"""`Path`: where the platform goes from one stop to the next, as a curve with two continuous derivatives.

Along straight lines the parameter is the length in the metric of the task, (y, z, ℓ θ) with a length ℓ. A
corner is a Bézier curve of degree 5 with control points at d, 2 d/3 and d/3 before and after it, over which
the parameter runs 5 d/3: two derivatives go on where it begins and ends. One of degree 7 with control points
at d, 3 d/4, d/2 and d/4 keeps three.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, not_negative, positive, shown
from p3dof._base.errors import TaskError
from p3dof._base.time_series import smoothing
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics.bodies import slider_motion
from p3dof.design.tasks.laws import eased, quintic
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Body, Geometry
from p3dof.machine.parameters.machine import body_of


@dataclass(frozen=True, eq=False)
class Waypoint(Readable):
    """A pose of the platform on its way, and what happens there.

    Parameters
    ----------
    pose : array-like, shape (3,) or (2,)
        y, z [m] and θ [rad]. A waypoint that is passed without a stop may leave θ out: the platform turns
        smoothly from the stop before it to the stop after it.
    name : str
        What tables and messages call it; its number without one.
    blend : float
        How far before and after the waypoint the path leaves its straight lines, to pass it without a stop
        [m, in the metric of `Task`]; zero to stop there.
    dwell : float
        How long the platform stays at a stop [s].
    duration : float, optional
        How long the platform takes to this stop from the one before it [s]; shared out without it.
    pick_up : Body, float or str, optional
        What the platform carries from here on, in its own frame; it does so when the dwell begins. A mass
        alone, ``2`` [kg] or ``"950 g"``, is a point mass at P.
    put_down : bool
        Whether the platform leaves here what it carries, at the end of the dwell.
    wrench : array-like, shape (6,), optional
        External force and moment on the platform at P, in the fixed frame, on the way from the waypoint
        before it to this one [N, N m]; none without it.
    blend_range : array-like, shape (2,), optional
        Least and largest blend when the best path is looked for [m]; it stays without it.
    tolerance : array-like, shape (2,) or (3,), optional
        How far y, z and, where the pose has one, θ may be from the pose when the best path is looked for, to
        either side [m, m, rad], at a waypoint that is passed; not at all without it.

    Raises
    ------
    TaskError
        If an argument does not fit, or something is to happen at a waypoint that is passed without a stop.
    """

    pose: FloatArray
    name: str = ""
    blend: float = 0.0
    dwell: float = 0.0
    duration: float | None = None
    pick_up: Body | None = None
    put_down: bool = False
    wrench: FloatArray = field(default_factory=lambda: np.zeros(6))
    blend_range: FloatArray | None = None
    tolerance: FloatArray | None = None

    def __init__(
        self,
        pose: ArrayLike,
        name: str = "",
        blend: float = 0.0,
        dwell: float = 0.0,
        duration: float | None = None,
        pick_up: Body | float | str | None = None,
        put_down: bool = False,
        wrench: ArrayLike | None = None,
        blend_range: ArrayLike | None = None,
        tolerance: ArrayLike | None = None,
    ) -> None:
        if not isinstance(name, str):
            raise TaskError(f"name: expected a text, got {shown(name)}")
        where = f"waypoint {name}: " if name else ""
        place = frozen_array(f"{where}pose", pose, ("K",), TaskError)
        if len(place) not in (2, 3):
            raise TaskError(f"{where}pose: expected y, z, θ or y, z, got {len(place)} numbers")
        if pick_up is not None:
            pick_up = body_of(pick_up, f"{where}pick_up", TaskError)
        if not isinstance(put_down, bool):
            raise TaskError(f"{where}put_down: expected true or false, got {shown(put_down)}")
        set_ = object.__setattr__
        set_(self, "pose", place)
        set_(self, "name", name)
        set_(self, "blend", not_negative(f"{where}blend", blend, TaskError))
        set_(self, "dwell", not_negative(f"{where}dwell", dwell, TaskError))
        set_(
            self, "duration", None if duration is None else positive(f"{where}duration", duration, TaskError)
        )
        set_(self, "pick_up", pick_up)
        set_(self, "put_down", put_down)
        load = np.zeros(6) if wrench is None else wrench
        set_(self, "wrench", frozen_array(f"{where}wrench", load, (6,), TaskError))
        set_(self, "blend_range", None if blend_range is None else self._range(where, blend_range))
        set_(self, "tolerance", None if tolerance is None else self._tolerance(where, tolerance))
        self._check(where)

    @property
    def stops(self) -> bool:
        """Whether the platform comes to rest here."""
        return self.blend == 0.0

    def _range(self, where: str, value: ArrayLike) -> FloatArray:
        bounds = frozen_array(f"{where}blend_range", value, (2,), TaskError)
        if not 0 < bounds[0] <= self.blend <= bounds[1]:
            raise TaskError(
                f"{where}blend_range: expected least and largest blend above zero around "
                f"blend = {self.blend:g} m, got {bounds[0]:g} and {bounds[1]:g} m"
            )
        return bounds

    def _tolerance(self, where: str, value: ArrayLike) -> FloatArray:
        bounds = frozen_array(f"{where}tolerance", value, (len(self.pose),), TaskError)
        if (bounds < 0).any():
            raise TaskError(f"{where}tolerance: expected zero or more, got {bounds.min():g}")
        if self.stops:
            raise TaskError(f"{where}tolerance: expected at a waypoint that is passed, with a blend, only")
        return bounds

    def _check(self, where: str) -> None:
        if self.stops:
            if len(self.pose) == 2:
                raise TaskError(f"{where}pose: expected y, z, θ at a stop, got y, z")
            return
        happens = {
            "dwell": self.dwell > 0,
            "duration": self.duration is not None,
            "pick_up": self.pick_up is not None,
            "put_down": self.put_down,
        }
        for name, set_here in happens.items():
            if set_here:
                raise TaskError(
                    f"{where}{name}: expected at a stop only, but blend = {self.blend:g} m passes it"
                )


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_TOUCH = 1 + 1e-12  # blends may meet, but for rounding
_SAME = 1e-9  # poses that are nearer, by the turning length, are one: a way between them is all rounding


class Path:
    """The way of the platform from one stop to the next.

    Parameters
    ----------
    waypoints : sequence of Waypoint
        A stop, what is passed, and a stop.
    names : sequence of str
        What to call them in an error.
    length : float
        ℓ: how long an arc counts that a turn of 1 rad makes [m].
    spline : bool
        Whether the path is a spline of degree 5 through the waypoints instead of lines with blends.
    smoothness : int
        How many derivatives go on where blends begin and end: 2 or 3.

    Attributes
    ----------
    end : float
        The parameter at the end; it begins at 0.
    at_waypoints : ndarray, shape (K,)
        The parameter at every waypoint: for one that is passed by a blend, at the middle of that.
    breaks : ndarray, shape (M,)
        The parameter where the lines and blends, or the parts of the spline, begin and end: its third
        derivative may jump there.

    Raises
    ------
    TaskError
        If two waypoints are the same, blends overlap, or some of the waypoints that are passed say θ.
    """

    def __init__(
        self,
        waypoints: Sequence[Waypoint],
        names: Sequence[str],
        length: float,
        spline: bool = False,
        smoothness: int = 2,
    ) -> None:
        from scipy.interpolate import BPoly, PPoly

        self._names, self._half = names, smoothness + 1
        inner = [len(point.pose) for point in waypoints[1:-1]]
        if len(set(inner)) > 1:
            raise TaskError(
                f"{names[0]} to {names[-1]}: expected θ at all waypoints between two stops, or at none"
            )
        first, last = waypoints[0].pose, waypoints[-1].pose
        self._turn = (first[2], last[2] - first[2]) if 2 in inner else None
        size = 3 if self._turn is None else 2
        points = np.array([point.pose[:size] for point in waypoints])
        legs = np.diff(points, axis=0)
        lengths = np.linalg.norm(legs * np.array([1.0, 1.0, length])[:size], axis=1)
        for k, leg in enumerate(lengths):
            if leg <= _SAME * length:
                raise TaskError(f"{names[k]} and {names[k + 1]}: expected two different poses")
        if spline:
            self.at_waypoints = np.append(0.0, np.cumsum(lengths))
            found, self._unit = smoothing.interpolating(self.at_waypoints, points, 5)
            self._curve: Any = found
            self._rates: Any = found
            self.breaks: FloatArray = self.at_waypoints
        else:
            self._unit = 1.0
            parts, self.breaks, self.at_waypoints = self._blended(waypoints, points, legs, lengths)
            self._curve = BPoly(np.array(parts).transpose(1, 0, 2), self.breaks)  # exact where parts begin
            self._rates = PPoly.from_bernstein_basis(self._curve)  # ten times as quick
        self.end = float(self.breaks[-1])
        if self._turn is not None:
            self._ways = np.append(0.0, np.cumsum([self._way(a, b) for a, b in self._pieces()]))

    def at(self, parameter: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return poses and their first two derivatives by the parameter, (N, 3) each.

        Parameters
        ----------
        parameter : ndarray, shape (N,)
            From 0 to `end`.
        """
        found = [self._derived(parameter, n) for n in range(3)]
        if self._turn is None:
            return found[0], found[1], found[2]
        start, turn = self._turn
        x, slope, bend = self._share(parameter, found[1], found[2])
        q, rate, change = quintic(x)
        angle = (start + turn * q, turn * rate * slope, turn * (change * slope**2 + rate * bend))
        pose, first, second = (np.column_stack(pair) for pair in zip(found, angle, strict=True))
        return pose, first, second

    def third(self, parameter: FloatArray) -> FloatArray:
        """Return the third derivative of the pose by the parameter, (N, 3); after a jump where it jumps.

        Parameters
        ----------
        parameter : ndarray, shape (N,)
            From 0 to `end`.
        """
        one, two, three = (self._derived(parameter, n) for n in (1, 2, 3))
        if self._turn is None:
            return three
        x, slope, bend = self._share(parameter, one, two)
        speed = slope * self._ways[-1]
        along, across = np.einsum("ij,ij->i", one, two), np.einsum("ij,ij->i", two, two)
        change = (across + np.einsum("ij,ij->i", one, three) - along**2 / speed**2) / speed
        _, rate, rise, third = eased(x)
        angle = third * slope**3 + 3 * rise * slope * bend + rate * change / self._ways[-1]
        return np.column_stack([three, self._turn[1] * angle])

    def _blended(
        self, waypoints: Sequence[Waypoint], points: FloatArray, legs: FloatArray, lengths: FloatArray
    ) -> tuple[list[FloatArray], FloatArray, FloatArray]:
        """Return Bernstein coefficients of lines and corners in turn, their ends, and waypoints."""
        half = self._half  # control points on either side of a corner
        degree, shares = 2 * half - 1, np.arange(half)[:, None] / half
        blends = np.array([point.blend for point in waypoints])
        for k, leg in enumerate(lengths):
            if blends[k] + blends[k + 1] > leg * _TOUCH:
                raise TaskError(
                    f"{self._names[k]} and {self._names[k + 1]}: their blends, {blends[k]:g} and "
                    f"{blends[k + 1]:g} m, overlap: they are {leg:g} m apart"
                )
        along = legs / lengths[:, None]
        parts, ends, middles = [], [0.0], [0.0]
        for k, leg in enumerate(lengths):
            straight = leg - blends[k] - blends[k + 1]
            if straight > 0:
                begin = points[k] + blends[k] * along[k]
                parts.append(begin + np.linspace(0, straight, degree + 1)[:, None] * along[k])
                ends.append(ends[-1] + straight)
            if k + 1 < len(lengths):
                before = points[k + 1] - blends[k + 1] * (1 - shares) * along[k]
                after = points[k + 1] + blends[k + 1] * shares[1:] * along[k + 1]
                last = points[k + 1] + blends[k + 1] * along[k + 1]
                parts.append(np.vstack([before, after, last]))
                ends.append(ends[-1] + degree / half * blends[k + 1])
                middles.append((ends[-2] + ends[-1]) / 2)
        return parts, np.array(ends), np.array([*middles, ends[-1]])

    def _derived(self, parameter: FloatArray, n: int) -> FloatArray:
        """Return y, z and perhaps θ of the curve, or their derivatives of order n."""
        curve = self._rates if n else self._curve
        return np.asarray(curve(parameter / self._unit, n)) / self._unit**n

    def _pieces(self) -> list[tuple[float, float]]:
        return list(zip(self.breaks[:-1].tolist(), self.breaks[1:].tolist(), strict=True))

    def _way(self, start: float, end: float) -> float:
        """Return the length in y and z of a piece of the curve [m]."""
        middle, half = (start + end) / 2, (end - start) / 2
        rates = self._derived(middle + half * _NODES, 1)
        return float(half * _WEIGHTS @ np.linalg.norm(rates, axis=1))

    def _share(
        self, parameter: FloatArray, first: FloatArray, second: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the share of the length in y and z, and its first two derivatives by the parameter."""
        piece = np.clip(np.searchsorted(self.breaks, parameter, "right") - 1, 0, len(self.breaks) - 2)
        starts = self.breaks[piece]
        half = (parameter - starts) / 2
        nodes = starts[:, None] + half[:, None] * (1 + _NODES)
        rates = self._derived(nodes.ravel(), 1)
        speeds = np.linalg.norm(rates, axis=1).reshape(nodes.shape)
        total = self._ways[-1]
        speed = np.linalg.norm(first, axis=1)
        bend = np.einsum("ij,ij->i", first, second) / speed
        return (self._ways[piece] + half * (speeds @ _WEIGHTS)) / total, speed / total, bend / total


class JointPath(Path):
    """The way from one stop to the next on which the sliders go on straight lines with blends.

    The parameter is the length in the space of the sliders' ways [m], with blends as of `Path`. The pose
    follows by forward kinematics, in the working mode: λ' = J x', λ'' = J x'' + J' x'.
    """

    def __init__(
        self, waypoints: Sequence[Waypoint], names: Sequence[str], geometry: Geometry, smoothness: int = 2
    ) -> None:
        for point, name in zip(waypoints, names, strict=True):
            if len(point.pose) != 3:
                raise TaskError(f"{name}: pose: expected y, z, θ on a path of 'joint', got y, z")
        poses = np.array([point.pose for point in waypoints])
        ways = kinematics.inverse_kinematics(geometry, poses).sliders
        moved = [replace(point, pose=way, tolerance=None) for point, way in zip(waypoints, ways, strict=True)]
        super().__init__(moved, names, 1.0, smoothness=smoothness)
        self._geometry = geometry

    def at(self, parameter: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return poses and their first two derivatives by the parameter, (N, 3) each."""
        return self._posed(*super().at(parameter))

    def third(self, parameter: FloatArray) -> FloatArray:
        """Return the third derivative of the pose by the parameter, (N, 3); after a jump where it jumps.

        By differences of the second one along a cubic of the sliders.
        """
        way, slope, bend = super().at(parameter)
        return third_by_differences(self._posed, way, slope, bend, super().third(parameter), self.end)

    def _posed(
        self, way: FloatArray, slope: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return poses and two derivatives of ways of the sliders with theirs, (N, 3) each."""
        pose = kinematics.forward_kinematics(self._geometry, way)
        inverse = np.linalg.inv(kinematics.inverse_jacobian(self._geometry, pose))
        first = np.einsum("nij,nj->ni", inverse, slope)
        _, _, turned = slider_motion(self._geometry, pose, first, np.zeros_like(pose))
        return pose, first, np.einsum("nij,nj->ni", inverse, bend - turned)


def third_by_differences(
    mapped: Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]],
    way: FloatArray,
    slope: FloatArray,
    bend: FloatArray,
    third: FloatArray,
    end: float,
) -> FloatArray:
    """Return the third derivative of what is mapped, by differences of its second one along a cubic."""
    step = 1e-3 * end

    def second(s: float) -> FloatArray:
        place = way + s * (slope + s * (bend / 2 + s * third / 6))
        return mapped(place, slope + s * (bend + s * third / 2), bend + s * third)[2]

    near, far = (second(k * step) - second(-k * step) for k in (1, 2))
    return (8 * near - far) / (12 * step)


_FINE = 0.2  # share of the mean step of samples under which one is left out: there rounding bends a spline
_GAP, _BESIDE = 5.0, 3  # a step so many times longer than all of so many on either side is a gap
_ALONG = math.cos(math.radians(15))  # so well the spline must go where the velocity of a sample does
_REST = 0.05  # share of the mean speed under which the parameter goes by length, and above it by time
_STILL = 1e-3  # share of the largest speed under which the platform rests where it is slowest
_POSED = 1e-15  # share of the way within which poses are one: their samples are a rest


class SampledPath(Path):
    """The way of a motion from one stop to the next, whatever its time.

    It is a spline of degree 5 through the poses. Its parameter p is a length near the stops, where the motion
    is slow, and elsewhere goes with its time t: dp = ε ds / √(v² + ε²), by the length s in the metric of
    `Path` and the speed v = ds/dt. So what happens fast, as where a path turns sharply, is not lost.
    """

    def __init__(self, motion: Motion, length: float) -> None:
        metric = self.metric = np.array([1.0, 1.0, length])
        time, poses = motion.time, motion.pose
        steps = np.linalg.norm(np.diff(poses, axis=0) * metric, axis=1)
        _require_near(time, steps)
        speed = np.linalg.norm(motion.velocity * metric, axis=1)
        slow = _REST * steps.sum() / (time[-1] - time[0])
        rate = slow * speed / np.hypot(speed, slow)
        places = np.append(0.0, np.cumsum(np.diff(time) * (rate[1:] + rate[:-1]) / 2))
        kept = _thinned(places)
        self._turn = None
        self._curve, self._unit = smoothing.interpolating(places[kept], poses[kept], 5)
        self._rates = self._curve
        self.end = float(places[-1])
        self.at_waypoints = self.breaks = np.array([0.0, self.end])
        along = np.asarray(self._curve(places / self._unit, 1)) * metric
        cosine = np.einsum("ij,ij->i", along, motion.velocity * metric)
        off = (speed > slow) & (cosine < _ALONG * speed * np.linalg.norm(along, axis=1))
        if off.any():
            raise TaskError(
                f"the path through the poses does not go as the velocity at {time[int(off.argmax())]:g} s: "
                "expected closer samples"
            )


class LengthPath(Path):
    """The way of a `SampledPath` by its length."""

    def __init__(self, path: SampledPath) -> None:
        from scipy.interpolate import make_interp_spline

        self._path, self._turn = path, None
        self._places: FloatArray = np.linspace(0.0, path.end, _LOOKS, dtype=np.float64)
        rate = np.linalg.norm(path.at(self._places)[1] * path.metric, axis=1)
        if rate.min() < _SHARP * rate.max():
            raise TaskError("the path of the motion turns too sharply to go along it by its length")
        self._rate = make_interp_spline(self._places, rate, 5)
        self._length = self._rate.antiderivative()
        self._lengths = self._length(self._places)
        self.end = float(self._lengths[-1])
        self.at_waypoints = self.breaks = np.array([0.0, self.end])

    def lengths(self, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the length at parameters (N,) of the path, and its first two derivatives by them."""
        return self._length(place), self._rate(place), self._rate(place, 1)

    def at(self, parameter: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the pose and its first two derivatives by the length, at lengths (N,), (N, 3) each."""
        place = np.interp(parameter, self._lengths, self._places)
        for _ in range(_NEWTON):
            place = np.clip(
                place + (parameter - self._length(place)) / self._rate(place), 0.0, self._path.end
            )
        pose, slope, bend = self._path.at(place)
        _, rate, change = (part[:, None] for part in self.lengths(place))
        return pose, slope / rate, (bend - slope * change / rate) / rate**2


_LOOKS, _SHARP, _NEWTON = 4001, 1e-3, 4
"""Places at which lengths are found, the least share of the rate of length, and steps to the place of one."""


def _require_near(time: FloatArray, steps: FloatArray) -> None:
    """Raise where a step is much longer than those beside it: samples are missing there."""
    for k in range(1, len(steps) - 1):
        beside = max(steps[max(k - _BESIDE, 0) : k].max(), steps[k + 1 : k + 1 + _BESIDE].max())
        if steps[k] > _GAP * beside:
            raise TaskError(
                f"the path has a gap from {time[k]:g} to {time[k + 1]:g} s: a step of {steps[k]:g} m in the "
                f"metric of the task, where those beside it have at most {beside:g} m"
            )


def _thinned(places: FloatArray) -> NDArray[np.intp]:
    """Return the indices of samples that are not too near to each other, both ends among them."""
    least, kept = _FINE * places[-1] / (len(places) - 1), [0]
    for k, place in enumerate(places.tolist()):
        if place - places[kept[-1]] >= least and places[-1] - place >= least:
            kept.append(k)
    return np.array([*kept, len(places) - 1])


def stops_of(motion: Motion, length: float) -> list[tuple[int, int]]:
    """Return the first and the last sample of each rest of a motion, its ends among them, in order."""
    metric = np.array([1.0, 1.0, length])
    steps = np.linalg.norm(np.diff(motion.pose, axis=0) * metric, axis=1)
    speed = np.linalg.norm(motion.velocity * metric, axis=1)
    still = steps <= _POSED * steps.sum()
    if still.all():
        raise TaskError("the motion stays in one pose: there is no path to follow")
    slow = speed <= _STILL * speed.max()
    count, found = len(speed), [[0, 0]]
    for k in range(count):
        resting = k > 0 and still[k - 1]
        if resting and found[-1][1] == k - 1:
            found[-1][1] = k
        elif resting:
            found.append([k - 1, k])
        elif 0 < k < count - 1 and slow[k] and speed[k - 1] > speed[k] <= speed[k + 1]:
            found.append([k, k])
    if found[-1][1] != count - 1:
        found.append([count - 1, count - 1])
    return [(first, last) for first, last in found]
