"""External loads on the platform over time: as users give them, and `WrenchHistory` from a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, as_floats, frozen_array
from p3dof._base.errors import InputError, MotionError
from p3dof._base.files import Source, called, read_text
from p3dof._base.samples import rows_like
from p3dof._base.time_series import csv_files
from p3dof._base.time_series.times import set_times

WRENCH_ROWS = (1, 2, 4)
"""What of a wrench works on the platform, which moves in y, z and θ: F_y, F_z and M_y."""

WrenchOverTime: TypeAlias = ArrayLike | Callable[[Any], ArrayLike] | None
"""A wrench (6,) that stays, one a sample (N, 6), or a function of one time or of many, as `WrenchHistory`."""


class Load:
    """A wrench over time, whatever it was given as: `at` one time, or `over` many.

    A function may take one time and return (6,), or many times (N,) and return (N, 6): either serves both.
    Where a result could mean both, the function is asked time by time.

    Parameters
    ----------
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; none by default.
    start : float, optional
        The time of a clock from which the times count that it will be asked for, as `Motion.start` [s]; a
        `WrenchHistory` is then counted from there. Without it, it counts from its own.

    Raises
    ------
    MotionError
        If only one of the two has the times of a clock.
    """

    def __init__(self, wrench: WrenchOverTime = None, start: float | None = None) -> None:
        if start is not None and isinstance(wrench, WrenchHistory):
            wrench = wrench.since(start)
        self._wrench: Any = np.zeros(6) if wrench is None else wrench
        self._takes_arrays = False

    def at(self, time: float) -> FloatArray:
        """Return the wrench at a time [s], shape (6,) [N, N m].

        Raises
        ------
        InputError
            If it has another shape, is not finite, or the function raises; the message has the time.
        """
        if not callable(self._wrench):
            return frozen_array("wrench", self._wrench, (6,))
        return frozen_array(f"wrench at t = {time:g} s", self._at(time), (6,))

    def over(self, times: FloatArray) -> FloatArray:
        """Return the wrenches at times (N,) [s], shape (N, 6) [N, N m], finite or not: `States` tell.

        Raises
        ------
        InputError
            If the shape does not fit, or the function raises; the message has the time.
        """
        found = self._over(times) if callable(self._wrench) else self._wrench
        return np.array(rows_like(found, times.shape))

    def _over(self, times: FloatArray) -> FloatArray:
        known = self._of_many(times)
        if known is not None and known.shape != (6, 6):
            return known
        try:
            return np.array([self._at(float(time)) for time in times]).reshape(-1, 6)
        except InputError:
            if known is None:
                raise
            return known

    def _of_many(self, times: FloatArray) -> FloatArray | None:
        """Return what the function says to all times (N,) at once, (N, 6); None if it takes one only."""
        if len(times) == 1:
            return None  # an array of one passes for a number in too many places
        try:
            found = as_floats("wrench", self._wrench(times))
        except Exception:  # whatever a function raises that takes one time: it is asked again
            return None
        return found if found.shape == (len(times), 6) else None

    def _at(self, time: float) -> FloatArray:
        """Return what the function says to one time, (6,)."""
        try:
            return self._asked(time, self._takes_arrays)
        except InputError as error:
            problem = error
        try:
            found = self._asked(time, not self._takes_arrays)
        except InputError:
            raise problem from problem.__cause__
        self._takes_arrays = not self._takes_arrays
        return found

    def _asked(self, time: float, as_array: bool) -> FloatArray:
        """Ask the function for one time, as a number or as an array of one."""
        name = f"wrench at t = {time:g} s"
        try:
            found = self._wrench(np.array([time]) if as_array else time)
        except Exception as error:
            raise InputError(f"{name}: {error}") from error
        array = as_floats(name, found)
        if array.shape not in ((6,), (1, 6)):
            raise InputError(f"{name}: expected shape (6,), or (N, 6) for N times, got {array.shape}")
        return array.reshape(6)


@dataclass(frozen=True, eq=False, repr=False)
class WrenchHistory(FrozenArrays):
    """External force and moment on the platform at P, in the fixed frame, sampled in time.

    Between samples it changes linearly; before the first and after the last one it keeps their values.

    Parameters
    ----------
    time : array-like, shape (N,)
        Strictly rising times [s]. Times of a clock, which begin 10,000 s or more from zero, are counted from
        the first one.
    wrench : array-like, shape (N, 6)
        Force [N] and moment [N m].
    start : float, optional
        The time of a clock at time zero [s]: what was subtracted. Given, the times are taken as they are.

    Raises
    ------
    MotionError
        If shapes do not fit, a number is not finite, or times do not rise.
    """

    time: FloatArray
    wrench: FloatArray
    start: float = None  # type: ignore[assignment]  # made below

    def __post_init__(self) -> None:
        count = set_times(self)
        object.__setattr__(self, "wrench", frozen_array("wrench", self.wrench, (count, 6), MotionError))

    @classmethod
    def from_csv(cls, path: Source) -> WrenchHistory:
        """Read a wrench file: CSV with the header ``t,fx,fy,fz,mx,my,mz``.

        A unit in brackets may follow each name, such as ms, kN, N mm or lbf; without one the column is in
        s, N or N m.

        Parameters
        ----------
        path : path-like
            The CSV file; or a stream that is open for reading.

        Raises
        ------
        MotionError
            If the content does not fit; the message names file, line and column.
        FileError
            If the file cannot be read.
        """
        text = read_text(path, csv_files.MAX_BYTES)
        time, columns, start = csv_files.parse(text, called(path), csv_files.WRENCH)
        try:
            return cls(time, columns, start)
        except MotionError as error:
            raise MotionError(f"{called(path)}: {error}") from error

    def since(self, start: float) -> WrenchHistory:
        """Return the history with times that count from another time of its clock.

        Parameters
        ----------
        start : float
            That time, as `Motion.start` [s]; 0 for times that are not those of a clock.

        Raises
        ------
        MotionError
            If only one of the two is the time of a clock: how they belong together is unknown.
        """
        if start == self.start:
            return self
        if not start or not self.start:
            whose = ("load's", "motion's") if self.start else ("motion's", "load's")
            raise MotionError(
                f"the {whose[0]} times are those of a clock, from {self.start or start:.16g} s, "
                f"the {whose[1]} are not: expected both of one clock, or both from the beginning"
            )
        return WrenchHistory(self.time + (self.start - start), self.wrench, start)

    def __call__(self, time: ArrayLike) -> FloatArray:
        """Return the wrench at times of shape (...), shape (..., 6) [N, N m]."""
        times = as_floats("time", time, MotionError)
        return np.stack([np.interp(times, self.time, column) for column in self.wrench.T], axis=-1)

    def __repr__(self) -> str:
        return f"WrenchHistory({len(self.time)} samples, {self.time[0]:g} to {self.time[-1]:g} s)"
