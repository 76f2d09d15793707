"""`DesignForces`: what designs need over a motion, by design."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.files import write_table
from p3dof.analysis.designs.status import DesignStatus

_PLACE = "status_at"


@dataclass(frozen=True, eq=False, repr=False)
class DesignForces:
    """What each design needs over a motion; NaN where it cannot make it.

    Figures that were not asked for are None.

    Parameters
    ----------
    status : ndarray of uint8, shape (D,)
        `DesignStatus`; 0 for designs that can.
    status_at : ndarray, shape (D,)
        Time of the first sample that a design cannot make [s]; NaN if it can, or could not be built at all.
    reach : ndarray, shape (D,)
        Least reach margin of all legs over the motion [m]; negative out of reach.
    peak_force, peak_time, rms_force : ndarray, shape (D, 3)
        Largest magnitude of each actuator's force [N], when it first comes [s], root mean square over time
        [N].
    actuation : ndarray, shape (D,), optional
        Least angle from the actuation singularity, positive on home's side [rad]; a sign that differs from
        that at another sample means that the motion crosses it.
    lowest_slider, highest_slider : ndarray, shape (D, 3), optional
        Slider positions [m].
    peak_speed : ndarray, shape (D, 3), optional
        Largest magnitude of the sliders' speeds [m/s].
    travel_margin, tilt_margin, speed_margin, force_margin : ndarray, shape (D,), optional
        What is left to the nearest limit of each design [m, rad, m/s, N]; negative beyond it.
    peak_power, peak_braking, work, positive_work, negative_work : ndarray, shape (D, 3), optional
        As of `DriveLoads` and `Energy` [W, J].
    gradients : dict of str to dict of str to ndarray
        By column, then by figure: its derivative by that column, in SI units, (D,) or (D, 3).
    """

    status: NDArray[np.uint8]
    status_at: FloatArray
    reach: FloatArray
    peak_force: FloatArray
    peak_time: FloatArray
    rms_force: FloatArray
    actuation: FloatArray | None = None
    lowest_slider: FloatArray | None = None
    highest_slider: FloatArray | None = None
    peak_speed: FloatArray | None = None
    travel_margin: FloatArray | None = None
    tilt_margin: FloatArray | None = None
    speed_margin: FloatArray | None = None
    force_margin: FloatArray | None = None
    peak_power: FloatArray | None = None
    peak_braking: FloatArray | None = None
    work: FloatArray | None = None
    positive_work: FloatArray | None = None
    negative_work: FloatArray | None = None
    gradients: dict[str, dict[str, FloatArray]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"DesignForces({int(self.feasible.sum())} of {len(self)} designs make the motion)"

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Which designs make the motion (D,)."""
        return np.equal(self.status, DesignStatus.FEASIBLE)

    def reason(self, design: int) -> str:
        """Return in words whether a design makes the motion, and why not."""
        words = DesignStatus(int(self.status[design])).in_words
        at = self.status_at[design]
        return words if np.isnan(at) else f"{words} (first at {at:g} s)"

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return all figures as columns of numbers, with units in their names.

        Returns
        -------
        dict of str to ndarray, shape (D,)
            Such as ``peak_force_a [N]``, ``reach [m]``, ``d_peak_force_a/d_geometry.R [N/m]``; ``status`` is
            a `DesignStatus`.
        """
        return columns_of_results(
            {name: getattr(self, name) for name in RESULT_UNITS if getattr(self, name) is not None},
            self.gradients,
        )

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write all figures to a CSV file, one design a row.

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        InputError
            If its name does not end in ``.csv``.
        FileError
            If the file cannot be written.
        """
        columns = self.to_columns()
        return write_table(path, list(columns), tuple(columns.values()))


RESULT_UNITS = {
    "status": "",
    _PLACE: "s",
    "reach": "m",
    "actuation": "rad",
    "peak_force": "N",
    "peak_time": "s",
    "rms_force": "N",
    "lowest_slider": "m",
    "highest_slider": "m",
    "peak_speed": "m/s",
    "travel_margin": "m",
    "tilt_margin": "rad",
    "speed_margin": "m/s",
    "force_margin": "N",
    "peak_power": "W",
    "peak_braking": "W",
    "work": "J",
    "positive_work": "J",
    "negative_work": "J",
}
"""The fields of `DesignForces` in the order of files, and their units."""


def columns_of_results(
    figures: Mapping[str, NDArray[Any]], gradients: Mapping[str, Mapping[str, FloatArray]]
) -> dict[str, NDArray[Any]]:
    """Return figures and their derivatives as columns; see `DesignForces.to_columns`."""
    from p3dof.analysis.designs.names import QUANTITIES

    columns: dict[str, NDArray[Any]] = {}
    for name, values in figures.items():
        unit = f" [{RESULT_UNITS[name]}]" if RESULT_UNITS[name] else ""
        columns |= {f"{each}{unit}": column for each, column in _each(name, values)}
    for by, derivatives in gradients.items():
        for name, values in derivatives.items():
            unit = f"{RESULT_UNITS[name]}/({QUANTITIES[by].unit})"
            columns |= {f"d_{each}/d_{by} [{unit}]": column for each, column in _each(name, values)}
    return columns


def _each(name: str, values: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    if values.ndim == 1:
        return [(name, values)]
    return [(f"{name}_{leg}", column) for leg, column in zip("abc", values.T, strict=True)]


def results_from_columns(columns: Mapping[str, NDArray[Any]]) -> DesignForces:
    """Return the results that columns hold; the other way round than `DesignForces.to_columns`.

    Parameters
    ----------
    columns : mapping of str to ndarray, shape (D,)
        With units in their names.

    Returns
    -------
    DesignForces
    """
    known = {name.partition(" [")[0]: column for name, column in columns.items()}
    fields: dict[str, Any] = {}
    for name in RESULT_UNITS:
        if name in known:
            fields[name] = known[name]
        elif f"{name}_a" in known:
            fields[name] = np.stack([known[f"{name}_{leg}"] for leg in "abc"], axis=1)
    gradients: dict[str, dict[str, FloatArray]] = {}
    for header, values in known.items():
        what, slash, by = header.partition("/d_")
        name = what.removeprefix("d_")
        if slash and not name.endswith(("_a", "_b", "_c")):
            gradients.setdefault(by, {})[name] = values
        elif slash and name.endswith("_a"):
            legs = [known[f"d_{name[:-2]}_{leg}/d_{by}"] for leg in "abc"]
            gradients.setdefault(by, {})[name[:-2]] = np.stack(legs, axis=1)
    status = np.asarray(fields.pop("status")).astype(np.uint8)
    return DesignForces(status=status, gradients=gradients, **fields)
