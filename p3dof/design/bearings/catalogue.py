"""Bearings of the hinges and guides of the sliders, as a catalogue gives them.

`p3dof.design.bearings.catalogue` reads them from files.

Bearings files: YAML.

The form of a file::

    hinges:                                    # of every hinge and universal joint that `joints` leaves out
      {name: 6001, dynamic: 5.1 kN, static: 2.4 kN, X: 0.56, Y: 1.6, e: 0.27}
    guides:
      {name: size 15, dynamic: 10 kN, basis: 50 km, static: 16 kN, moments: [120 Nm, 120 Nm, 150 Nm]}
    joints:
      hinge_left: {name: needle, dynamic: 6 kN, kind: roller}
    life: 20000 h                              # optional: what they have to live; or '1e7 cycles', '5000 km'

Numbers are in SI units, or have one of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np

from p3dof._base.checks import FloatArray, Readable, frozen_array, not_negative, shown
from p3dof._base.errors import DriveError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MOMENT, Quantity
from p3dof.analysis.reactions import JOINTS
from p3dof.design.drives import RequiredLife, required_life
from p3dof.machine.parameters.machine import named, read_fields

_EXPONENTS = {"ball": 3.0, "roller": 10.0 / 3.0}
_STATIC = {"ball": (0.6, 0.5), "roller": (1.0, 0.0)}  # factors of the static load, where the file has none
RELEASED = 2.8  # load by preload at which a guide is released, as makers round 2^(3/2)
SEAL_FRICTION, ROLLING_FRICTION = 3.5, 0.003
"""Friction of a carriage: 2 to 5 N of its seals, 0.002 to 0.003 of its load (makers of profiled rails)."""
_BASES = (50e3, 100e3)  # ways for which makers of guides give the dynamic load [m]
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


def _share_of(field: str, value: Any, whole: float) -> float:
    """Return a force, given in N or as a share of another in percent."""
    if isinstance(value, str) and value.strip().endswith("%"):
        try:
            value = float(value.strip()[:-1]) / 100 * whole
        except ValueError:
            raise ParameterError(f"{field}: expected a share such as '2 %', got {shown(value)}") from None
    force = not_negative(field, value, ParameterError)
    if force >= whole:
        raise ParameterError(f"{field}: expected less than the dynamic rating, got {force:g} N")
    return force


@dataclass(frozen=True)
class Bearing(Readable):
    """A rolling bearing of a hinge.

    Its equivalent dynamic load is P = Fr where Fa / Fr is at most e, and X Fr + Y Fa beyond (ISO 281), the
    static one P0 = X0 Fr + Y0 Fa, at least Fr (ISO 76).
    """

    dynamic: float  # basic dynamic load rating C, for a million revolutions [N]
    static: float | None = None  # basic static load rating C0 [N]; without it the static safety is not told
    kind: Literal["ball", "roller"] = "ball"  # of the rolling elements: the exponent of the life is 3 or 10/3
    X: float = 1.0  # factors of the dynamic load: radial, axial, and from which share of axial load on
    Y: float = 0.0
    e: float = 0.0
    X0: float | None = None
    """Factors of the static load; those of deep-groove ball bearings, 0.6 and 0.5, and of rollers 1 and 0,
    without them."""
    Y0: float | None = None
    name: str = "bearing"  # what tables call it
    static_safety: float = 2.0  # how often the largest static load goes into C0 at least

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
            set_(self, item, not_negative(item, getattr(self, item), ParameterError))
        set_(self, "static_safety", _positive("static_safety", self.static_safety))

    @property
    def exponent(self) -> float:
        """The exponent p of the life."""
        return _EXPONENTS[self.kind]

    def equivalent(self, radial: FloatArray, axial: FloatArray) -> FloatArray:
        """Return the equivalent dynamic loads P (N,) [N]."""
        along = self.X * radial + self.Y * axial
        return np.where(axial <= self.e * radial, radial, along)

    def static_equivalent(self, radial: FloatArray, axial: FloatArray) -> FloatArray:
        """Return the equivalent static loads P0 (N,) [N]; arguments as of `equivalent`."""
        x, y = float(self.X0 or 0.0), float(self.Y0 or 0.0)
        return np.asarray(np.maximum(radial, x * radial + y * axial))


@dataclass(frozen=True)
class Guide(Readable):
    """The carriage of a slider on its profiled rail, or several taken as one, or two at a distance."""

    dynamic: float  # basic dynamic load rating C, of one carriage [N]
    basis: float
    """The way that it holds for: 50 or 100 km [m]; makers differ, and the rating for 50 km is 1.26 times
    the other of ball guides."""
    moments: Sequence[float]  # moments about x, y and z of the rail that count as much as the force C [N m]
    static: float | None = None  # basic static load rating C0 [N]
    kind: Literal["ball", "roller"] = "ball"  # of the rolling elements
    centre: Sequence[float] = (0.0, 0.0, 0.0)  # of the carriage, in the slider's frame [m]
    turn: float = 0.0
    """How the rail is mounted: the angle about z by which its x axis is turned from that of the slide
    [rad]. Its z axis is that of the slide."""
    name: str = "guide"  # what tables call it
    distance: float | None = None
    """From one carriage to another on the rail, middle to middle, half of it to each side of `centre` [m];
    one carriage without it."""
    preload: float | str = 0.0  # of each carriage [N], or its share of `dynamic` such as ``"2 %"``
    static_safety: float = 2.0  # how often the largest load goes into C0 at least; 5 is usual with impacts
    seal_friction: float = SEAL_FRICTION  # of the seals of each carriage [N]
    mu: float = ROLLING_FRICTION  # coefficient of friction under the equivalent load

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
        if self.distance is not None:
            set_(self, "distance", _positive("distance", self.distance))
        set_(self, "preload", _share_of("preload", self.preload, self.dynamic))
        set_(self, "static_safety", _positive("static_safety", self.static_safety))
        for item in ("seal_friction", "mu"):
            set_(self, item, not_negative(item, getattr(self, item), ParameterError))
        if not isinstance(self.kind, str) or self.kind not in _EXPONENTS:
            raise ParameterError(f"kind: expected ball or roller, got {shown(self.kind)}")

    @property
    def exponent(self) -> float:
        """The exponent p of the life."""
        return _EXPONENTS[self.kind]

    def parts(self, forces: FloatArray, moments: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what forces and what moments contribute to the equivalent loads: sums of sizes.

        Their sum is the equivalent load P of each carriage without its preload, (N, carriages) [N].
        """
        across = forces * np.array([1.0, 1.0, 0.0])
        about = moments - np.cross(np.asarray(self.centre), across)
        c, s = math.cos(self.turn), math.sin(self.turn)
        rail = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # its axes, as columns
        along, turning = (across @ rail)[:, None], (about @ rail)[:, None]
        if self.distance is not None:  # the moments across the rail become forces, one up and one down
            pair = np.array([[-turning[:, 0, 1], turning[:, 0, 0], 0 * turning[:, 0, 0]]]).transpose(2, 0, 1)
            pair = pair / self.distance
            along = np.concatenate([along / 2 - pair, along / 2 + pair], axis=1)
            turning = np.repeat(turning * np.array([0.0, 0.0, 0.5]), 2, axis=1)
        rated = self.dynamic / np.asarray(self.moments)
        return np.abs(along).sum(axis=2), (np.abs(turning) * rated).sum(axis=2)

    def equivalent(self, forces: FloatArray, moments: FloatArray) -> FloatArray:
        """Return the equivalent loads of each carriage, (N, carriages) [N], with what preload adds."""
        load, preload = sum(self.parts(forces, moments)), float(self.preload)
        if preload == 0:
            return np.asarray(load)
        limit = RELEASED * preload
        return np.where(load < limit, preload * (1 + load / limit) ** 1.5, load)

    def resistance(self, forces: FloatArray, moments: FloatArray) -> FloatArray:
        """Return the friction of all carriages while they slide, (N,) [N]."""
        load = self.equivalent(forces, moments)
        return np.asarray(load.shape[1] * self.seal_friction + self.mu * load.sum(axis=1))


@dataclass(frozen=True)
class Bearings(Readable):
    """What every joint runs in.

    Parameters
    ----------
    hinges : Bearing, optional
        Of all hinges and universal joints that `joints` leaves out; without it only those are looked at.
    guides : Guide, optional
        Likewise of the sliders.
    joints : mapping of str to Bearing or Guide
        Of single joints, by name.
    life : RequiredLife or str, optional
        What they have to live, such as ``"20000 h"``.

    Raises
    ------
    ParameterError
        If there is no such joint, a part is something else, or there is none.
    """

    hinges: Bearing | None = None
    guides: Guide | None = None
    joints: Mapping[str, Bearing | Guide] = field(default_factory=dict)
    life: RequiredLife | str | None = None

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
        try:
            object.__setattr__(self, "life", required_life(self.life))
        except DriveError as error:
            raise ParameterError(str(error)) from error

    def of(self, joint: str) -> Bearing | Guide | None:
        """Return what a joint runs in."""
        return self.joints.get(joint, self.guides if joint in SLIDES else self.hinges)


_NUMBERS: Mapping[str, Quantity] = {
    "dynamic": FORCE,
    "static": FORCE,
    "basis": LENGTH,
    "moments": MOMENT,
    "centre": LENGTH,
    "turn": ANGLE,
    "distance": LENGTH,
    "seal_friction": FORCE,
}


def read_bearings(path: Source) -> Bearings:
    """Read what the joints run in from a YAML file as above; errors as of `read_parameters`."""
    source = called(path)
    known = [item.name for item in fields(Bearings)]
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {}
    for name, kind in (("hinges", Bearing), ("guides", Guide)):
        if name in data:
            parts[name] = _read(data[name], kind, f"{source}: {name}")
    if "joints" in data:
        where = f"{source}: joints"
        own = read_fields(data["joints"], where, (), (*SLIDES, *TURNING))
        parts["joints"] = {
            name: _read(value, Guide if name in SLIDES else Bearing, f"{where}.{name}")
            for name, value in own.items()
        }
    return named(source, lambda: Bearings(**parts, life=data.get("life")))


def _read(data: Any, kind: type[Any], where: str) -> Any:
    required = ("dynamic", "basis", "moments") if kind is Guide else ("dynamic",)
    data = read_fields(data, where, required, [item.name for item in fields(kind)])
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    if isinstance(data.get("preload"), str) and "%" not in data["preload"]:
        values["preload"] = FORCE.read(data["preload"], f"{where}.preload")
    return named(where, lambda: kind(**values))
