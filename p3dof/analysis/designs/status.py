"""`DesignStatus`: whether a design can make the motion, and if not, why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.analysis.designs.columns import Designs
from p3dof.analysis.designs.folding import solids_of
from p3dof.analysis.designs.names import ACTUATORS, COMPONENTS, DENSITY, KINDS, LENGTHS, SIZES
from p3dof.closed_form.paper.inertials import inertials
from p3dof.machine.parameters import LINKS
from p3dof.machine.parameters.geometry import PARALLEL

_TOLERANCE = 1e-9
"""Share of the largest entry by which an inertia may miss the triangle inequality, as in `Body`."""


class DesignStatus(IntEnum):
    """Whether a design can make the motion; if not, the first reason in this order from the end."""

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
    """Return which designs could be built, by the rules of `Geometry`, `Body` and the other parts.

    Parameters
    ----------
    designs : Designs
        The machines.

    Returns
    -------
    ndarray of uint8, shape (D,)
        `DesignStatus`; `FEASIBLE` for all that could.
    """
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
