"""Motions of the actuated joints of any robot: CSV text in.

The header is ``t`` and the names of the joints, in any order; a unit in brackets may follow each, as in
``crank [deg]``; without one the column is in s, m or rad. Blank lines and lines that begin with ``#`` are
skipped, and what p3dof writes beside a motion is passed over: forces, velocities, other joints. The values
are points of a curve, as the poses of the manipulator's motion files are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from p3dof._base.checks import ANGLES, LENGTHS, FloatArray, warn_caller
from p3dof._base.errors import MotionError
from p3dof._base.time_series.csv_files import Form, header_of, parse
from p3dof._base.time_series.smoothing import (
    ORDER,
    Smooth,
    SmoothingFit,
    checked,
    fitted,
    interpolating,
    roughness_told,
    smoothing_told,
)
from p3dof._base.time_series.times import counted_told


@dataclass(frozen=True, eq=False)
class JointCurve:
    """The spline of degree 7 through values of joints, or near them; a polynomial through fewer than nine."""

    time: FloatArray  # (N,): strictly rising times [s]
    values: FloatArray  # (N, n): values of the joints [m or rad]
    start: float = 0.0  # the time of a clock at time zero [s]; 0 where times are not those of a clock
    smooth: Smooth = None
    """Up to which frequency quintic splines follow the values [Hz], which they need not pass then;
    `"auto"` passes those that are exact enough, and follows others as far as they have more than noise."""

    @cached_property
    def fit(self) -> SmoothingFit | None:
        """The splines near the values; None if the curve passes them."""
        way = checked(self.smooth)
        if way is None or (way == "auto" and not self._roughness([""] * self.values.shape[1])):
            return None
        found = fitted(self.time, self.values, way)
        return found if found.settled else None

    def remarks(self, names: Sequence[str], sliding: Sequence[bool]) -> tuple[str, ...]:
        """Return what to know about the values: rough or smoothed, and from when times count."""
        found = [counted_told(self.start)] if self.start else []
        if self.fit is not None:
            units = ["mm" if slides else "mrad" for slides in sliding]
            found.append(f"the values {smoothing_told(self.fit, names, units)}")
        elif rough := self._roughness(names, sliding):
            found.append(f"the values {rough})")
        return tuple(found)

    def _roughness(self, names: Sequence[str], sliding: Sequence[bool] = ()) -> str:
        if len(self.time) < 2:
            return ""
        units = ["m/s" if slides else "rad/s" for slides in sliding] or ["/s"] * len(names)
        spline, unit = self._spline
        acceleration = np.asarray(spline((self.time - self.time[0]) / unit, 2)) / unit**2
        return roughness_told(self.time, self.values, acceleration, names, units)

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return values, velocities and accelerations (M, n) at times between the first and the last."""
        if len(self.time) == 1:
            nothing = np.zeros((len(times), self.values.shape[1]))
            return self.values[np.zeros(len(times), dtype=int)], nothing, nothing
        if self.fit is not None:
            local = times - self.time[0]
            return self.fit.at(local, 0), self.fit.at(local, 1), self.fit.at(local, 2)
        spline, unit = self._spline
        local = (times - self.time[0]) / unit
        values, velocities, accelerations = (np.asarray(spline(local, n)) / unit**n for n in range(3))
        return values, velocities, accelerations

    def divided(self, parts: int) -> FloatArray:
        """Return the times with every step between two of them divided into equal parts."""
        inner = self.time[:-1, None] + np.diff(self.time)[:, None] * np.arange(parts) / parts
        return np.append(inner.ravel(), self.time[-1])

    @cached_property
    def _spline(self) -> tuple[Any, float]:
        return interpolating(self.time, self.values, ORDER)


_DEGREES = 1e4
"""Values of a hinge that are all beyond a turn in rad, and below this, may be degrees."""


def read_joints(
    text: str,
    source: str,
    joints: Sequence[str],
    sliding: Sequence[bool],
    smooth: Smooth = None,
    others: Sequence[str] = (),
) -> JointCurve:
    """Read the motion of some joints from CSV text; of the joints, in the order of `joints`.

    What p3dof writes beside it, also of `others`, which are the robot's other joints, is passed over.
    """
    header = header_of(text, source)
    beside = frozenset(name for name in header if _beside(name, {*joints, *others}))
    given = [name for name in header if name in joints or name not in beside]
    if sorted(given[1:]) == sorted(joints) and given[:1] == ["t"]:
        order = [list(given[1:]).index(name) for name in joints]
        named = given
    else:  # the error is that of a file in the robot's own order
        order, named = list(range(len(joints))), ["t", *joints]
    kinds = dict(zip(joints, sliding, strict=True))
    units = {name: LENGTHS if kinds[name] else ANGLES for name in named[1:]}
    form = Form("a motion of joints", tuple(named), (len(named),), units, "the joints in any order", beside)
    time, values, start = parse(text, source, form)
    values = np.ascontiguousarray(values[:, order])
    for name, column in zip(joints, values.T, strict=True):
        least, most = np.abs(column).min(), np.abs(column).max()
        if not kinds[name] and 2 * np.pi < least and most < _DEGREES and f"{name} [" not in text:
            warn_caller(f"{source}: {name} is beyond a turn in rad (degrees? then name it {name} [deg])")
    curve = JointCurve(time, values, start, smooth)
    with np.errstate(all="ignore"):
        found = curve.at(time)
    for name, array in zip(("value", "velocity", "acceleration"), found, strict=True):
        if not np.isfinite(array).all():
            raise MotionError(f"{source}: the values are too large or too near in time: no finite {name}")
    return curve


def _beside(name: str, joints: set[str]) -> bool:
    """Return whether a column is one that p3dof writes beside a motion, of a robot with these joints."""
    bare = name.removeprefix("force ").removesuffix(" dot")
    joint, _, number = bare.rpartition(".")  # of several freedoms
    of_joint = bare in joints or (number.isdecimal() and joint in joints)
    return of_joint or name in ("energy", "gap") or name.startswith("multiplier ")
