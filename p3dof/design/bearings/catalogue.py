"""Bearings of the hinges and guides of the sliders, as a catalogue gives them.

`p3dof.design.bearings.files` reads them from files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import ParameterError
from p3dof.analysis.reactions import JOINTS

_EXPONENTS = {"ball": 3.0, "roller": 10.0 / 3.0}
_STATIC = {"ball": (0.6, 0.5), "roller": (1.0, 0.0)}
"""Factors of the static load, where the file has none."""
_BASES = (50e3, 100e3)
"""Ways for which makers of guides give the dynamic load [m]."""
SLIDES = tuple(joint.name for joint in JOINTS if joint.axis == "z")
TURNING = tuple(joint.name for joint in JOINTS if joint.axis == "y")
_MOMENTS = "moments: expected three positive numbers, about x, y, z of the slide"


def _name(value: Any) -> str:
    if not isinstance(value, str | int) or isinstance(value, bool):
        raise ParameterError(f"name: expected a text, got {shown(value)}")
    return str(value)


def _positive(field: str, value: Any) -> float:
    number = float(frozen_array(field, value, (), ParameterError))
    if not number > 0:
        raise ParameterError(f"{field}: expected a number above 0, got {number:g}")
    return number


def _from_zero(field: str, value: Any) -> float:
    number = float(frozen_array(field, value, (), ParameterError))
    if number < 0:
        raise ParameterError(f"{field}: expected zero or more, got {number:g}")
    return number


@dataclass(frozen=True)
class Bearing:
    """A rolling bearing of a hinge.

    Its equivalent dynamic load is P = Fr where Fa / Fr is at most e, and X Fr + Y Fa beyond (ISO 281), the
    static one P0 = X0 Fr + Y0 Fa, at least Fr (ISO 76).

    Parameters
    ----------
    dynamic : float
        Basic dynamic load rating C, for a million revolutions [N].
    static : float, optional
        Basic static load rating C0 [N]; without it the static safety is not told.
    kind : {"ball", "roller"}
        Of the rolling elements: the exponent of the life is 3 or 10/3.
    X, Y, e : float
        Factors of the dynamic load: radial, axial, and from which share of axial load on.
    X0, Y0 : float, optional
        Factors of the static load; those of deep-groove ball bearings, 0.6 and 0.5, and of rollers 1 and 0,
        without them.
    name : str
        What tables call it.

    Raises
    ------
    ParameterError
        If a number is not physical.
    """

    dynamic: float
    static: float | None = None
    kind: Literal["ball", "roller"] = "ball"
    X: float = 1.0
    Y: float = 0.0
    e: float = 0.0
    X0: float | None = None
    Y0: float | None = None
    name: str = "bearing"

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "name", _name(self.name))
        set_(self, "dynamic", _positive("dynamic", self.dynamic))
        if self.static is not None:
            set_(self, "static", _positive("static", self.static))
        if not isinstance(self.kind, str) or self.kind not in _EXPONENTS:
            raise ParameterError(f"kind: expected ball or roller, got {shown(self.kind)}")
        for item, usual in zip(("X0", "Y0"), _STATIC[self.kind], strict=True):
            if getattr(self, item) is None:
                set_(self, item, usual)
        for item in ("X", "Y", "e", "X0", "Y0"):
            set_(self, item, _from_zero(item, getattr(self, item)))

    @property
    def exponent(self) -> float:
        """The exponent p of the life."""
        return _EXPONENTS[self.kind]

    def equivalent(self, radial: FloatArray, axial: FloatArray) -> FloatArray:
        """Return the equivalent dynamic loads P (N,) [N].

        Parameters
        ----------
        radial, axial : ndarray, shape (N,)
            Sizes of the loads across and along the axis [N].

        Returns
        -------
        ndarray, shape (N,)
        """
        along = self.X * radial + self.Y * axial
        return np.where(axial <= self.e * radial, radial, along)

    def static_equivalent(self, radial: FloatArray, axial: FloatArray) -> FloatArray:
        """Return the equivalent static loads P0 (N,) [N]; arguments as of `equivalent`."""
        x, y = float(self.X0 or 0.0), float(self.Y0 or 0.0)
        return np.asarray(np.maximum(radial, x * radial + y * axial))


@dataclass(frozen=True)
class Guide:
    """The carriage of a slider on its profiled rail, or several taken as one.

    Parameters
    ----------
    dynamic : float
        Basic dynamic load rating C [N].
    basis : float
        The way that it holds for: 50 or 100 km [m]; makers differ, and the rating for 50 km is 1.26 times the
        other of ball guides.
    moments : sequence of 3 floats
        Moments about x, y and z of the rail that count as much as the force C [N m].
    static : float, optional
        Basic static load rating C0 [N].
    kind : {"ball", "roller"}
        Of the rolling elements.
    centre : sequence of 3 floats
        Of the carriage, in the slider's frame [m].
    turn : float
        How the rail is mounted: the angle about z by which its x axis is turned from that of the slide [rad].
        Its z axis is that of the slide.
    name : str
        What tables call it.

    Raises
    ------
    ParameterError
        If a number is not physical, or the basis is none.
    """

    dynamic: float
    basis: float
    moments: Sequence[float]
    static: float | None = None
    kind: Literal["ball", "roller"] = "ball"
    centre: Sequence[float] = (0.0, 0.0, 0.0)
    turn: float = 0.0
    name: str = "guide"

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "name", _name(self.name))
        set_(self, "dynamic", _positive("dynamic", self.dynamic))
        if self.static is not None:
            set_(self, "static", _positive("static", self.static))
        if not any(math.isclose(float(_positive("basis", self.basis)), basis) for basis in _BASES):
            raise ParameterError(f"basis: expected 50 km or 100 km, got {self.basis:g} m")
        moments = frozen_array("moments", self.moments, (3,), ParameterError)
        if not (moments > 0).all():
            raise ParameterError(_MOMENTS)
        set_(self, "moments", tuple(moments.tolist()))
        set_(self, "centre", tuple(frozen_array("centre", self.centre, (3,), ParameterError).tolist()))
        set_(self, "turn", float(frozen_array("turn", self.turn, (), ParameterError)))
        if not isinstance(self.kind, str) or self.kind not in _EXPONENTS:
            raise ParameterError(f"kind: expected ball or roller, got {shown(self.kind)}")

    @property
    def exponent(self) -> float:
        """The exponent p of the life."""
        return _EXPONENTS[self.kind]

    def parts(self, forces: FloatArray, moments: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what forces and what moments contribute to the equivalent loads: sums of sizes.

        Parameters
        ----------
        forces, moments : ndarray, shape (N, 3)
            On the carriage at the slider's origin, in the slide's axes [N, N m]; along z it bears nothing.

        Returns
        -------
        forces, moments : ndarray, shape (N,)
            Their sum is the equivalent load P [N].
        """
        across = forces * np.array([1.0, 1.0, 0.0])
        about = moments - np.cross(np.asarray(self.centre), across)
        c, s = math.cos(self.turn), math.sin(self.turn)
        rail = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # its axes, as columns
        rated = self.dynamic / np.asarray(self.moments)
        return np.abs(across @ rail).sum(axis=1), (np.abs(about @ rail) * rated).sum(axis=1)


@dataclass(frozen=True)
class Bearings:
    """What every joint runs in.

    Parameters
    ----------
    hinges : Bearing, optional
        Of all hinges and universal joints that `joints` leaves out; without it only those are looked at.
    guides : Guide, optional
        Likewise of the sliders.
    joints : mapping of str to Bearing or Guide
        Of single joints, by name.

    Raises
    ------
    ParameterError
        If there is no such joint, a part is something else, or there is none.
    """

    hinges: Bearing | None = None
    guides: Guide | None = None
    joints: Mapping[str, Bearing | Guide] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, kind in (("hinges", Bearing), ("guides", Guide)):
            if not isinstance(getattr(self, name), kind | None):
                raise ParameterError(f"{name}: expected a {kind.__name__}, got {shown(getattr(self, name))}")
        for name, part in self.joints.items():
            if name not in (*SLIDES, *TURNING):
                raise ParameterError(
                    f"joints: expected names of {', '.join((*SLIDES, *TURNING))}, got {name!r}"
                )
            kind = Guide if name in SLIDES else Bearing
            if not isinstance(part, kind):
                raise ParameterError(f"joints: {name}: expected a {kind.__name__}, got {shown(part)}")
        if not (self.hinges or self.guides or self.joints):
            raise ParameterError("expected hinges, guides or joints, got none of them")

    def of(self, joint: str) -> Bearing | Guide | None:
        """Return what a joint runs in."""
        return self.joints.get(joint, self.guides if joint in SLIDES else self.hinges)
