"""`Motion`: a sampled motion of the platform."""

from __future__ import annotations

import math
import operator
import os
from dataclasses import InitVar, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, frozen_array, positive, shown
from p3dof._base.errors import InputError, MotionError
from p3dof._base.files import Source, called, read_text, suffix_of, write_atomic
from p3dof._base.tables import ShownInNotebook, Table, Tabular, html_of, notebook_html, number, table_of
from p3dof._base.time_series import csv_files, smoothing
from p3dof._base.time_series.smoothing import Smooth, checked, eased
from p3dof._base.time_series.times import (
    counted,
    counted_told,
    evenly,
    require_inside,
    require_rising,
    rounding_told,
    sample_count,
    set_times,
)
from p3dof._base.time_series.wrenches import WrenchHistory
from p3dof.machine.motion.curve import AT_REST, Curve, check_consistency, is_rough, remarks_on_curve

_JOINT_TOLERANCE = 1e-9
"""By how much poses [m, rad] and velocities [m/s, rad/s] may differ where two motions are joined."""

_FROM_CURVE = 1000
"""Least number of steps of a motion that is made from a curve."""


@dataclass(frozen=True, eq=False, repr=False)
class Motion(FrozenArrays, ShownInNotebook, Tabular):
    """A motion of the platform, sampled in time: pose, velocity and acceleration.

    Parameters
    ----------
    time : array-like, shape (N,)
        Strictly rising times [s]; steps need not be even. Times of a clock, which begin 10,000 s or more from
        zero, are counted from the first one.
    pose : array-like, shape (N, 3)
        y, z [m] and θ [rad].
    velocity : array-like, shape (N, 3)
        Their first derivatives [m/s, rad/s].
    acceleration : array-like, shape (N, 3)
        Their second derivatives [m/s², rad/s²].
    check : bool
        Whether to check that velocity and acceleration are the derivatives of the pose, to 1e-3 of each
        column's largest value (`p3dof.machine.motion.curve` has the details). The check finds wrong
        units, swapped columns and wrong samples. Columns that hardly move (derivatives below 1e-6 in SI
        units) pass unless they are 1e-9 apart, and fewer than 6 samples always pass.
    curve : Curve, optional
        What the samples are taken from, where the motion comes from poses alone: `resampled` and `divided`
        follow it. Without it, they interpolate between the samples.
    start : float, optional
        The time of a clock at time zero [s]: what was subtracted. Given, the times are taken as they are.

    Raises
    ------
    MotionError
        If shapes do not fit, a number is not finite, times do not rise, or the check fails.
    """

    time: FloatArray
    pose: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    check: InitVar[bool] = True
    curve: Curve | None = None
    start: float = None  # type: ignore[assignment]  # made below

    def __post_init__(self, check: bool) -> None:
        count = set_times(self)
        for name in ("pose", "velocity", "acceleration"):
            array = frozen_array(name, getattr(self, name), (count, 3), MotionError)
            object.__setattr__(self, name, array)
        if self.curve is not None and not isinstance(self.curve, Curve):
            raise MotionError(f"curve: expected a Curve, got {shown(self.curve)}")
        if check:
            check_consistency(self.time, self.pose, self.velocity, self.acceleration)

    @classmethod
    def rest_to_rest(
        cls, start: ArrayLike, end: ArrayLike, duration: float, samples: int = 1001, order: int = 5
    ) -> Motion:
        """Make the straight motion between two poses that starts and ends at rest.

        Parameters
        ----------
        start, end : array-like, shape (3,)
            The two poses: y, z [m] and θ [rad].
        duration : float
            Time that it takes [s].
        samples : int
            Number of samples, evenly spaced; at least two.
        order : int
            Degree of the polynomial: 5 (velocity and acceleration vanish at both ends), 7 (jerk too) or 9
            (and its derivative).

        Raises
        ------
        MotionError
            If an argument does not fit.
        """
        start = frozen_array("start", start, (3,), MotionError)
        end = frozen_array("end", end, (3,), MotionError)
        duration = positive("duration", duration, MotionError)
        if isinstance(order, bool) or order not in (5, 7, 9):
            raise MotionError(f"order: expected 5, 7 or 9, got {order!r}")
        time = evenly(0.0, duration, sample_count(samples, least=2))
        with np.errstate(all="ignore"):  # the constructor refuses what overflows
            return cls._along(smoothing.rest_to_rest(start, end, duration, int(order)), time)

    @classmethod
    def through(
        cls,
        waypoints: ArrayLike,
        times: ArrayLike | None = None,
        duration: float | None = None,
        samples: int = 1001,
    ) -> Motion:
        """Make a smooth motion through waypoints that starts and ends at rest.

        The curve is a quintic spline with four continuous derivatives; velocity and acceleration vanish at
        both ends. It passes the waypoints exactly; with evenly spaced times, they are among the samples if
        ``samples - 1`` is a multiple of ``len(waypoints) - 1``.

        Parameters
        ----------
        waypoints : array-like, shape (K, 3)
            Poses to pass, at least two: y, z [m] and θ [rad].
        times : array-like, shape (K,), optional
            When to pass them [s], strictly rising.
        duration : float, optional
            Total time [s], for waypoints at evenly spaced times from 0. Either this or `times` is needed.
        samples : int
            Number of samples, evenly spaced; at least two.

        Raises
        ------
        MotionError
            If an argument does not fit.
        """
        waypoints = frozen_array("waypoints", waypoints, ("K", 3), MotionError)
        if len(waypoints) < 2:
            raise MotionError(f"waypoints: expected at least two, got {len(waypoints)}")
        if (times is None) == (duration is None):
            raise MotionError("times, duration: expected one of the two, got neither or both")
        if duration is not None:
            times = np.linspace(0.0, positive("duration", duration, MotionError), len(waypoints))
        times = frozen_array("times", times, (len(waypoints),), MotionError)
        require_rising("times", times)
        time = evenly(times[0], times[-1], sample_count(samples, least=2))
        motion = cls._along(smoothing.through(times, waypoints), time)
        pose, velocity, acceleration = motion.pose.copy(), motion.velocity.copy(), motion.acceleration.copy()
        pose[[0, -1]] = waypoints[[0, -1]]  # roundoff apart, these hold already
        velocity[[0, -1]] = acceleration[[0, -1]] = 0.0
        return cls(time, pose, velocity, acceleration, check=False)

    @classmethod
    def from_poses(cls, time: ArrayLike, pose: ArrayLike, smooth: Smooth = None) -> Motion:
        """Make a motion from poses alone, differentiated by a spline of degree 7.

        The poses are points of a `Curve`, which the motion keeps: `resampled` and `divided` follow it, and
        `Manipulator.refined` takes as many samples of it as its forces need.

        On the paper's motion the largest error, as a share of the largest derivative, is 1e-8 in velocity and
        5e-7 in acceleration with 101 samples, and 4e-12 and 2e-9 with 1001 samples. Noise in the poses, their
        last printed digit included, comes out in the acceleration divided by the square of the time step:
        `remarks` say so where it matters, and `smooth` takes it out. Of the paper's motion, rounded to .1 mm
        and .1 mrad, it leaves errors of 1 % of the largest force at steps from 1 to 40 ms.

        Parameters
        ----------
        time : array-like, shape (N,)
            Strictly rising times [s]; at least two. Fewer than eight samples are differentiated as the
            polynomial through all of them.
        pose : array-like, shape (N, 3)
            y, z [m] and θ [rad].
        smooth : float or "auto", optional
            For measured or rounded poses, which the curve need not pass then: up to which frequency it
            follows them [Hz]. With ``"auto"``, poses that are exact enough are passed, and others are
            followed as far as they have more than noise. `remarks` state the band and the residual, which
            `Curve.fit` has.

        Raises
        ------
        MotionError
            If an argument does not fit, or the times are too uneven for a spline.
        """
        known, start = counted(frozen_array("time", time, ("N",), MotionError))
        return cls._near(Curve(known, pose), smooth, start)  # type: ignore[arg-type]  # it makes an array of it

    @classmethod
    def _near(cls, curve: Curve, smooth: Smooth, start: float) -> Motion:
        """Return the motion at the times of a curve that passes poses, smoothed if that is asked for."""
        if checked(smooth) == "auto":
            if is_rough(curve) or rounding_told(curve.time, start):
                near = replace(curve, smooth="auto")
                curve = near if near.fit is not None and near.fit.settled else curve
        elif smooth is not None:
            curve = replace(curve, smooth=smooth)
        pose, velocity, acceleration = curve.at(curve.time)
        if curve.fit is None:
            pose = curve.pose
        return cls(curve.time, pose, velocity, acceleration, check=False, curve=curve, start=start)

    @classmethod
    def from_csv(cls, path: Source, check: bool = True, smooth: Smooth = None) -> Motion:
        """Read a motion file.

        The header is ``t,y,z,theta``, for poses alone (points of a curve, as for `from_poses`), or
        ``t,y,z,theta,ydot,zdot,thetadot,yddot,zddot,thetaddot``, in this order. A unit in brackets may follow
        each name: ``t [ms]``, ``y [mm]``, ``theta [deg]``, ``ydot [mm/s]``, ``thetaddot [deg/s^2]`` and so
        on; without one, the column is in s, m, rad. Blank lines and lines that begin with ``#`` are skipped.
        What p3dof writes beside a motion, such as forces and sliders, is passed over, with a warning.

        Parameters
        ----------
        path : path-like
            The CSV file; or a stream that is open for reading.
        check : bool
            Whether to check velocity and acceleration against the pose; see `Motion`. Those of a simulation
            are exact and not checked: accelerations jump where a controller acts.
        smooth : float or "auto", optional
            For poses alone: see `from_poses`.

        Raises
        ------
        MotionError
            If the content does not fit; the message names file, line and column, what was expected and
            what came.
        FileError
            If the file cannot be read.
        """
        text = read_text(path, csv_files.MAX_BYTES)
        time, columns, start = csv_files.parse(text, called(path))
        check = check and csv_files.OF_A_RUN not in csv_files.header_of(text, called(path))
        try:
            if columns.shape[1] == 3:
                return cls._near(Curve(time, columns), smooth, start)
            if checked(smooth) is not None:
                raise MotionError(
                    "smooth: expected poses alone, got velocities and accelerations beside them"
                )
            return cls(time, columns[:, :3], columns[:, 3:6], columns[:, 6:], check=check, start=start)
        except MotionError as error:
            clock = f" ({counted_told(start)})" if start else ""
            raise MotionError(f"{called(path)}: {error.args[0]}{clock}", error.hint) from error

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, pose, velocity and acceleration, (N,) each, by name and unit."""
        columns = (self.time, *self.pose.T, *self.velocity.T, *self.acceleration.T)
        return dict(zip(csv_files.HEADER, columns, strict=True))

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write a motion file that `from_csv` reads back to the same bits; times count from `start`.

        Parameters
        ----------
        path : path-like
            The CSV file; replaced whole or not at all.

        Raises
        ------
        InputError
            If its name does not end in ``.csv``.
        FileError
            If the file cannot be written.
        """
        suffix_of(path, "table")
        columns = np.hstack([self.pose, self.velocity, self.acceleration])
        return write_atomic(path, csv_files.dump(self.time, columns, self.start))

    @classmethod
    def joined(cls, *motions: Motion) -> Motion:
        """Put motions one after the other, each shifted in time to begin where the one before it ends.

        Parameters
        ----------
        *motions : Motion
            At least one. Pose and velocity must meet to 1e-9; accelerations may jump. The sample in which
            two motions meet is that of the former.

        Raises
        ------
        MotionError
            If there is no motion, one is something else, or two of them do not meet.
        """
        if not motions:
            raise MotionError("motions: expected at least one, got none")
        for motion in motions:
            if not isinstance(motion, Motion):
                raise MotionError(f"motions: expected Motion objects, got {shown(motion)}")
        for count, (former, latter) in enumerate(pairwise(motions), start=1):
            for name in ("pose", "velocity"):
                end, begin = getattr(former, name)[-1], getattr(latter, name)[0]
                if np.abs(end - begin).max() > _JOINT_TOLERANCE:
                    raise MotionError(
                        f"motions: expected number {count + 1} to begin with the {name} {end.tolist()} "
                        f"that number {count} ends with, got {begin.tolist()}"
                    )
        first, rest = motions[0], motions[1:]
        times, end = [first.time], first.time[-1]
        for motion in rest:
            times.append(motion.time[1:] - motion.time[0] + end)
            end = end + motion.duration
        return cls(
            np.concatenate(times),
            np.concatenate([first.pose, *(motion.pose[1:] for motion in rest)]),
            np.concatenate([first.velocity, *(motion.velocity[1:] for motion in rest)]),
            np.concatenate([first.acceleration, *(motion.acceleration[1:] for motion in rest)]),
            check=False,
            start=first.start,
        )

    def resampled(self, samples: int | ArrayLike) -> Motion:
        """Return the motion at other times: on its curve, or by quintic Hermite interpolation.

        Without a curve, the interpolation takes on pose, velocity and acceleration of every sample, so that
        the samples themselves come back unchanged; between them it is exact for a polynomial of degree 5 and
        errs by the sixth power of the time step otherwise.

        Parameters
        ----------
        samples : int or array-like, shape (M,)
            How many samples, evenly spaced over the whole motion, or the times themselves [s].

        Raises
        ------
        MotionError
            If a time lies outside the motion, or times do not rise.
        """
        if np.ndim(samples) == 0:
            time = evenly(self.time[0], self.time[-1], sample_count(samples, least=min(2, len(self))))
        else:
            time = frozen_array("times", samples, ("M",), MotionError)
        require_rising("times", time)
        require_inside("times", time, float(self.time[0]), float(self.time[-1]))
        if len(self) == 1:
            return self[:]
        return Motion(time, *self._at(time), check=False, curve=self.curve, start=self.start)

    def divided(self, parts: int) -> Motion:
        """Return the motion with every step between samples in equal parts; the samples stay as they are.

        Parameters
        ----------
        parts : int
            How many parts.

        Returns
        -------
        Motion
            With ``parts * (len(self) - 1) + 1`` samples, on the curve or interpolated as by `resampled`. A
            step a thousand times shorter than both beside it stays: its ends are the two sides of a jump.

        Raises
        ------
        MotionError
            If `parts` is not a whole number of one or more, or the samples would be too many.
        """
        parts = sample_count(parts, least=1)
        sample_count(parts * (len(self) - 1) + 1, least=1)
        if parts == 1 or len(self) == 1:
            return self[:]
        each = np.where(smoothing.breaks(self.time), 1, parts)
        time = np.append(smoothing.subdivided(self.time, each), self.time[-1])
        columns, places = self._at(time), np.append(0, np.cumsum(each))
        for column, known in zip(columns, (self.pose, self.velocity, self.acceleration), strict=True):
            column[places] = known
        return Motion(time, *columns, check=False, curve=self.curve, start=self.start)

    def from_rest(self, ramp: float, stop: float = 0.0, samples: int | None = None) -> Motion:
        """Return the motion along the same path that starts at rest, and may end so too.

        Time runs slower at the beginning: its rate rises from 0 to 1 within `ramp` by the polynomial of
        degree 7 whose first three derivatives vanish at both ends. The motion takes half of `ramp` longer.

        Parameters
        ----------
        ramp : float
            Time from rest to the full rate [s].
        stop : float
            Time from the full rate to rest at the end [s]; zero to end as this motion does.
        samples : int, optional
            Number of samples, evenly spaced; by default about as dense as in this motion, of a curve 1001 at
            least.

        Raises
        ------
        MotionError
            If a time is not positive, or the ramps take more than the whole motion.
        """
        ramp = positive("ramp", ramp, MotionError)
        stop = positive("stop", stop, MotionError) if np.ndim(stop) or stop != 0 else 0.0
        if (ramp + stop) / 2 > self.duration:
            raise MotionError(
                f"ramp, stop: expected at most {2 * self.duration:g} s together, got {ramp + stop:g} s"
            )
        duration = self.duration + (ramp + stop) / 2
        if samples is None:
            least = 0 if self.curve is None else _FROM_CURVE
            samples = max(least, round((len(self) - 1) * duration / self.duration)) + 1
        time = evenly(0.0, duration, sample_count(samples, least=2))
        phase, rate, change = smoothing.eased(time, duration, ramp, stop)
        along = np.clip(self.time[0] + phase, self.time[0], self.time[-1])
        pose, slope, bend = self._at(along)
        acceleration = bend * rate[:, None] ** 2 + slope * change[:, None]
        return Motion(time, pose, slope * rate[:, None], acceleration, check=False, start=0.0)

    @classmethod
    def _along(cls, curve: Any, time: FloatArray) -> Motion:
        """Sample a curve that can differentiate itself."""
        with np.errstate(all="ignore"):  # the constructor refuses what overflows
            pose, velocity, acceleration = (np.asarray(curve(time, order)) for order in (0, 1, 2))
        return cls(time, pose, velocity, acceleration, check=False)

    def _at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return pose, velocity and acceleration at times within the motion, between two samples or more."""
        if self.curve is not None:
            return self.curve.at(time)
        curve = smoothing.hermite(self.time, self.pose, self.velocity, self.acceleration)
        pose, velocity, acceleration = (np.asarray(curve(time, order)) for order in (0, 1, 2))
        return pose, velocity, acceleration

    def remarks(self) -> tuple[str, ...]:
        """Return what to know about poses that were given alone, one sentence each.

        Returns
        -------
        tuple of str
            With which velocities their curve starts and ends, whether they look like waypoints, and whether
            they are too noisy to differentiate; nothing of these for a motion without a `Curve`. From when
            times count, if they are those of a clock.
        """
        clock = (f"{counted_told(self.start)}",) if self.start else ()
        if self.curve is None:
            return clock
        rounded = rounding_told(self.curve.time, self.start)
        return (*clock, *((rounded,) if rounded else ()), *remarks_on_curve(self.curve))

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, index: slice | SupportsIndex) -> Motion:
        """Return some of the samples as a motion: a slice with a positive step, or a single one."""
        if not isinstance(index, slice):
            i = operator.index(index)
            index = slice(range(len(self))[i], range(len(self))[i] + 1)
        columns = self.pose[index], self.velocity[index], self.acceleration[index]
        return Motion(self.time[index], *columns, check=False, curve=self.curve, start=self.start)

    def __repr__(self) -> str:
        return f"Motion({len(self)} samples, {self.time[0]:g} to {self.time[-1]:g} s)"


RAMP = 0.2
"""How long a motion that does not start at rest takes to come from there, if nobody says so [s]."""


_ROWS_OF_A_RAMP = 2000
"""Rows of the load a second of a ramp, along which it changes as the motion comes up to its rate."""


def natural_ramp(motion: Motion) -> float:
    """Return how long a motion takes to come from rest, if nobody says so: no time if it starts there [s]."""
    speed = np.abs(motion.velocity)
    at_rest = np.all(speed[0] <= AT_REST * speed.max(axis=0))
    return 0.0 if at_rest else min(RAMP, motion.duration)


def load_along(history: WrenchHistory, motion: Motion, ramp: float) -> WrenchHistory:
    """Return the load of a run that enters a motion from rest, by its place on the path.

    At the times of the run.
    """
    history, begin = history.since(motion.start), float(motion.time[0])
    places = history.time - begin
    if not ramp:
        return WrenchHistory(places, history.wrench, 0.0)
    entered: FloatArray = np.array(np.linspace(0.0, ramp, math.ceil(_ROWS_OF_A_RAMP * ramp) + 1), dtype=float)
    phase = eased(entered, motion.duration + ramp / 2, ramp, 0.0)[0]
    inside = places[(places > 0) & (places < ramp / 2)]
    times = np.concatenate([entered, np.interp(inside, phase, entered)])
    times, first = np.unique(times, return_index=True)
    phase = np.concatenate([phase, inside])[first]
    later = places[places > ramp / 2]
    return WrenchHistory(
        np.concatenate([times, later + ramp / 2]),
        np.concatenate([history(begin + phase), history(begin + later)]),
        0.0,
    )


def require_motion(value: object, name: str = "motion") -> Motion:
    """Return a motion; or raise, and say what makes one."""
    if not isinstance(value, Motion):
        made = "from_csv reads a file" if isinstance(value, str | os.PathLike) else "from_poses takes poses"
        raise InputError(f"{name}: expected a Motion, got {shown(value)}; p3dof.Motion.{made}")
    return value


def paper_motion(samples: int = 1001) -> Motion:
    """Return the motion of the paper's example, eq. (5), with exact derivatives.

    y = -t²(t² - 1.3t + .3), z = .2t²(2t² - t - 1), θ = .4 sin 4πt, for t from 0 to 1 s. It neither starts nor
    ends at rest: θ̇(0) = 5.03 rad/s, ẏ(1) = -.7 m/s, ż(1) = .6 m/s.

    Parameters
    ----------
    samples : int
        Number of samples, evenly spaced; one is t = 0 alone.

    Raises
    ------
    MotionError
        If `samples` is not a whole number of one or more.
    """
    t = evenly(0.0, 1.0, sample_count(samples, least=1))
    w = 4 * math.pi
    swing = w * t
    pose = [-(t**2) * (t**2 - 1.3 * t + 0.3), 0.2 * t**2 * (2 * t**2 - t - 1), 0.4 * np.sin(swing)]
    velocity = [-t * (4 * t**2 - 3.9 * t + 0.6), 0.2 * t * (8 * t**2 - 3 * t - 2), 0.4 * w * np.cos(swing)]
    acceleration = [-(12 * t**2 - 7.8 * t + 0.6), 0.2 * (24 * t**2 - 6 * t - 2), -0.4 * w**2 * np.sin(swing)]
    return Motion(
        t, np.column_stack(pose), np.column_stack(velocity), np.column_stack(acceleration), check=False
    )


def motion_table(motion: Motion, wrench: FloatArray | None = None) -> Table:
    """Return how far, how fast and how hard the platform moves, and what loads it."""
    names = (("y [m], per s, per s²", 0), ("z [m], per s, per s²", 1), ("θ [rad], per s, per s²", 2))
    rows = {
        name: (
            motion.pose[:, k].min(),
            motion.pose[:, k].max(),
            np.abs(motion.velocity[:, k]).max(),
            np.abs(motion.acceleration[:, k]).max(),
        )
        for name, k in names
    }
    note = (
        f"{len(motion)} samples over {number(motion.duration)} s."
        f"{f' T{counted_told(motion.start)[1:]}.' if motion.start else ''}"
        f"{'' if wrench is None else _loads(wrench)}"
    )
    header = ("platform", "lowest", "highest", "largest speed", "largest acceleration")
    return table_of("Motion", header, rows, note)


@html_of.register(Motion)
def motion_html(motion: Motion) -> str:
    """Return how a notebook shows a motion, as HTML."""
    span = f"from {number(motion.time[0])} to {number(motion.time[-1])} s"
    return notebook_html("Motion", f"{len(motion)} samples, {span}", [motion_table(motion)])


def _loads(wrench: FloatArray) -> str:
    """Return the largest load in words."""
    largest = np.abs(wrench).max(axis=0)
    if not largest.any():
        return " No external load."
    force, moment = (", ".join(number(value) for value in part) for part in (largest[:3], largest[3:]))
    return f" Largest external force and moment at P, by components: {force} N; {moment} N m."
