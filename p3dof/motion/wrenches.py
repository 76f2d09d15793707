"""`WrenchHistory`: an external load on the platform that changes in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, FrozenArrays, as_floats, frozen_array
from p3dof.errors import MotionError
from p3dof.files import Source, called, read_text
from p3dof.motion import csv_files
from p3dof.motion.times import require_rising

WRENCH_ROWS = (1, 2, 4)
"""What of a wrench works on the platform, which moves in y, z and θ: F_y, F_z and M_y."""


@dataclass(frozen=True, eq=False, repr=False)
class WrenchHistory(FrozenArrays):
    """External force and moment on the platform at P, in the fixed frame, sampled in time.

    Between samples it changes linearly; before the first and after the last one it keeps their values.

    Parameters
    ----------
    time : array-like, shape (N,)
        Strictly rising times [s].
    wrench : array-like, shape (N, 6)
        Force [N] and moment [N m].

    Raises
    ------
    MotionError
        If shapes do not fit, a number is not finite, or times do not rise.
    """

    time: FloatArray
    wrench: FloatArray

    def __post_init__(self) -> None:
        time = frozen_array("time", self.time, ("N",), MotionError)
        if len(time) == 0:
            raise MotionError("time: expected at least one sample, got none")
        require_rising("time", time)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "wrench", frozen_array("wrench", self.wrench, (len(time), 6), MotionError))

    @classmethod
    def from_csv(cls, path: Source) -> WrenchHistory:
        """Read a wrench file: CSV with the header ``t,fx,fy,fz,mx,my,mz``.

        A unit in brackets may follow each name: s or ms, N or kN, N m or N mm; without one the column is in
        s, N or N m.

        Parameters
        ----------
        path : path-like
            The CSV file; or a stream that is open for reading.

        Returns
        -------
        WrenchHistory

        Raises
        ------
        MotionError
            If the content does not fit; the message names file, line and column.
        FileError
            If the file cannot be read.
        """
        text = read_text(path, csv_files.MAX_BYTES)
        time, columns = csv_files.parse(text, called(path), csv_files.WRENCH)
        try:
            return cls(time, columns)
        except MotionError as error:
            raise MotionError(f"{called(path)}: {error}") from error

    def __call__(self, time: ArrayLike) -> FloatArray:
        """Return the wrench at times of shape (...), shape (..., 6) [N, N m]."""
        times = as_floats("time", time, MotionError)
        return np.stack([np.interp(times, self.time, column) for column in self.wrench.T], axis=-1)

    def __repr__(self) -> str:
        return f"WrenchHistory({len(self.time)} samples, {self.time[0]:g} to {self.time[-1]:g} s)"
