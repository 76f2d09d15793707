"""`DesignForces`: what designs need over a motion, by design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.tables import Tabular
from p3dof.analysis.designs.columns import ACTUATORS, COMPONENTS, DENSITY, KINDS, LENGTHS, SIZES, Designs
from p3dof.analysis.designs.folding import solids_of
from p3dof.machine.parameters import LINKS
from p3dof.machine.parameters.actuators import PARALLEL
from p3dof.machine.parameters.body import inertials

_TOLERANCE = 1e-9  # share of the largest entry by which an inertia may miss the triangle inequality: `Body`


class DesignStatus(IntEnum):
    """Whether a design can perform the motion; if not, the first reason in this order from the end."""

    FEASIBLE = 0
    OUT_OF_REACH = 1
    SINGULAR = 2
    NOT_FINITE = 3
    GEOMETRY = 4
    DIMENSIONS = 5
    BODY = 6
    FRICTION = 7
    LIMITS = 8
    ACTUATORS = 9

    @property
    def in_words(self) -> str:
        """What it means."""
        return _WORDS[self]


_MASSES = (f"{ACTUATORS}armature", f"{ACTUATORS}counterweight")
_WORDS = {
    DesignStatus.FEASIBLE: "makes the motion",
    DesignStatus.OUT_OF_REACH: "a leg is too short for a sample of the motion",
    DesignStatus.SINGULAR: "a sample of the motion is actuation-singular",
    DesignStatus.NOT_FINITE: "a number is not finite",
    DesignStatus.GEOMETRY: "no geometry: 0 < r < R, L > R - r >= 1e-6 L and b > 0 do not hold",
    DesignStatus.DIMENSIONS: "a size or the density of solids is not positive",
    DesignStatus.BODY: "no possible body: a mass that is not positive, or an inertia that no mass has",
    DesignStatus.FRICTION: "a negative coefficient of friction, or a smoothing that is not positive",
    DesignStatus.LIMITS: "a limit that is not positive, or a range that does not hold home",
    DesignStatus.ACTUATORS: "a negative armature or counterweight",
}


def status_of(designs: Designs) -> NDArray[np.uint8]:
    """Return `DesignStatus` by the rules of `Geometry`, `Body` and so on; `FEASIBLE` if it can be built."""
    columns, status = designs.columns, np.zeros(len(designs), np.uint8)
    with np.errstate(all="ignore"):
        for reason, possible in (
            (DesignStatus.LIMITS, _limits(designs)),
            (DesignStatus.ACTUATORS, _all(columns, lambda name: name.startswith(_MASSES), 0, True)),
            (DesignStatus.FRICTION, _friction(columns)),
            (DesignStatus.BODY, _bodies(designs)),
            (DesignStatus.DIMENSIONS, _all(columns, lambda name: name in (*SIZES, DENSITY), 0)),
            (DesignStatus.GEOMETRY, _geometry(designs)),
        ):
            status[~np.broadcast_to(possible, status.shape)] = reason
    finite = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    status[~finite] = DesignStatus.NOT_FINITE
    return status


def _geometry(designs: Designs) -> Any:
    known = asdict(designs.machine.geometry)
    r, R, L, b = (designs.columns.get(name, known[name[-1]]) for name in LENGTHS)
    return (r > 0) & (b > 0) & (r < R) & (R - r >= PARALLEL * L) & (R - r < L)


def _all(columns: Mapping[str, FloatArray], wanted: Any, above: float, or_equal: bool = False) -> Any:
    found: Any = np.True_
    for name, column in columns.items():
        if wanted(name):
            found = found & (column >= above if or_equal else column > above)
    return found


def _friction(columns: Mapping[str, FloatArray]) -> Any:
    coefficients = _all(
        columns, lambda name: name.startswith(("friction.viscous", "friction.coulomb")), 0, True
    )
    return coefficients & _all(columns, lambda name: name == "friction.smoothing", 0)


def _limits(designs: Designs) -> Any:
    columns, limits = designs.columns, designs.machine.limits
    found = _all(columns, lambda name: name in ("limits.speed", "limits.force"), 0)
    for name in ("travel", "tilt"):
        low, high = getattr(limits, name)
        found = found & (columns.get(f"limits.{name}.low", low) < 0)
        found = found & (columns.get(f"limits.{name}.high", high) > 0)
    return found


def _bodies(designs: Designs) -> Any:
    found: Any = np.True_
    columns, machine = designs.columns, designs.machine
    own = solids_of(columns, machine) if designs.bodies == "solids" else inertials(machine.bodies)
    for link in LINKS:
        kind = next(kind for kind, links in KINDS.items() if link in links)
        given = {**_given(designs, f"bodies.{kind}."), **_given(designs, f"bodies.{link}.")}
        if given:
            body = own[link]
            (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
            known = [body.mass, *body.com, xx, yy, zz, xy, xz, yz]
            numbers = dict(zip(COMPONENTS, known, strict=True)) | given
            found = found & _possible(numbers, massless=kind == "crossbar")
    payload = _given(designs, "payload.")
    if payload:
        found = found & _possible(dict.fromkeys(COMPONENTS, 0.0) | payload, massless=True)
    return found


def _given(designs: Designs, prefix: str) -> dict[str, Any]:
    return {
        name.removeprefix(prefix): column
        for name, column in designs.columns.items()
        if name.startswith(prefix)
    }


def _possible(numbers: Mapping[str, Any], massless: bool) -> Any:
    mass = np.asarray(numbers["mass"])
    moments = [numbers[f"inertia.{axes}"] for axes in ("xx", "xy", "xz", "xy", "yy", "yz", "xz", "yz", "zz")]
    inertia = np.stack(np.broadcast_arrays(*moments), axis=-1)
    inertia = inertia.reshape(*inertia.shape[:-1], 3, 3)
    finite = np.isfinite(inertia).all(axis=(-1, -2))
    low, middle, high = np.moveaxis(
        np.linalg.eigvalsh(np.where(finite[..., None, None], inertia, 0.0)), -1, 0
    )
    slack = _TOLERANCE * np.abs(inertia).max(axis=(-1, -2))
    possible = finite & (low >= -slack) & (high <= low + middle + slack)
    none = ~np.any(inertia, axis=(-1, -2)) if massless else np.False_
    return possible & ((mass > 0) | ((mass == 0) & none))


_PLACE = "status_at"


@dataclass(frozen=True, eq=False, repr=False)
class DesignForces(Tabular):
    """What each design needs over a motion; NaN where it cannot perform it.

    Figures that were not asked for are None.

    Parameters
    ----------
    status : ndarray of uint8, shape (D,)
        `DesignStatus`; 0 for designs that can.
    status_at : ndarray, shape (D,)
        Time of the first sample that a design cannot reach [s]; NaN if it can, or could not be built at all.
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

    _row_name = "design"

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
    from p3dof.analysis.designs.columns import QUANTITIES

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
