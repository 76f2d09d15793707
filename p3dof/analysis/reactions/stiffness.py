"""How the joints and rods of the manipulator give way, from numbers of catalogues and of the drawing.

The numbers by default are guesses for joints of this size: replace them by those of the bearings that are to
be used. `p3dof.analysis.reactions.stiffness` reads them from files.

Stiffness files: YAML.

The form of a file, in which everything may be left out::

    hinges: {radial: 100 N/um, axial: 50 N/um, tilt: 10 N m/mrad}
    slides: {lateral: 200 N/um, tilt: 20 N m/mrad, roll: 10 N m/mrad}
    universals: {force: 80 N/um, moment: 4 N m/mrad}
    rods: {diameter: 20 mm, young: 210 GPa, poisson: 0.3}    # or: rods: rigid
    joints:                                     # where one joint differs
      hinge_left: {radial: 60 N/um}
    misfit: {shift: 5 um, turn: 0.1 mrad}       # assembly error, position and angle, in every joint
    cuts: paper                                 # or points: ball joints at the ends of the legs

Numbers are in SI units, or have one of their own. What is left out has the values of `Stiffness`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable, not_negative, positive, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof._base.quantities import ANGLE, LENGTH, PRESSURE, STIFFNESS, TURNING_STIFFNESS, Quantity
from p3dof.analysis.reactions.results import JOINTS, Idealisation, cuts
from p3dof.loops.compliance import JointCompliance, beam
from p3dof.machine.parameters import STEEL_DENSITY, Parameters
from p3dof.machine.parameters.machine import named, read_fields

_LOOPS = ("loop_a", "loop_b", "loop_c")
_RODS = {"loop_a": "leg_a", "loop_b": "leg_b", "hinge_lower": "rod_left", "loop_c": "rod_right"}
"""Where rods end, and which."""


def _positive(of: object) -> None:
    for item in fields(of):  # type: ignore[arg-type]
        positive(item.name, getattr(of, item.name), ParameterError)


@dataclass(frozen=True)
class HingeStiffness:
    """A hinge: a bearing about y."""

    radial: float = 1e8  # against shifting across and along the axis [N/m]
    axial: float = 5e7
    tilt: float = 1e4  # against turning about an axis across it [N m/rad]

    def __post_init__(self) -> None:
        _positive(self)

    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness along x, y, z, and about them; (3,) each."""
        return np.array([self.radial, self.axial, self.radial]), np.full(3, self.tilt)


@dataclass(frozen=True)
class SlideStiffness:
    """The guide of a slider: carriages on a rail along z."""

    lateral: float = 2e8  # against shifting across the rail [N/m]
    tilt: float = 2e4  # against turning about an axis across the rail, and about the rail [N m/rad]
    roll: float = 1e4

    def __post_init__(self) -> None:
        _positive(self)

    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness along x, y, z, and about them; (3,) each."""
        return np.full(3, self.lateral), np.array([self.tilt, self.tilt, self.roll])


@dataclass(frozen=True)
class UniversalStiffness:
    """A universal or a ball joint at the end of a leg."""

    force: float = 8e7  # against shifting [N/m]
    moment: float = 4e3  # against turning about the axis that it does not turn about freely [N m/rad]

    def __post_init__(self) -> None:
        _positive(self)

    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness along x, y, z, and about them; (3,) each."""
        return np.full(3, self.force), np.full(3, self.moment)


@dataclass(frozen=True)
class RodSection:
    """Legs and rods as slender round beams without mass, of one diameter and material."""

    diameter: float | None = None
    """[m]; by default that of a solid cylinder of steel as heavy as each leg or rod."""
    young: float = 210e9  # young's modulus [Pa]
    poisson: float = 0.3  # poisson's ratio

    def __post_init__(self) -> None:
        if self.diameter is None:
            _positive(replace(self, diameter=1.0))
        else:
            _positive(self)
        if not self.poisson < 0.5:
            raise ParameterError(f"poisson: expected less than 0.5, got {self.poisson:g}")

    def compliance(self, length: float, mass: float) -> FloatArray:
        """Return the compliance at the tip of a rod; ndarray, shape (6, 6)."""
        radius = self.radius(length, mass)
        bending = math.pi * radius**4 / 4
        shear = self.young / (2 * (1 + self.poisson))
        return beam(length, math.pi * radius**2, bending, 2 * bending, self.young, shear)

    def radius(self, length: float, mass: float) -> float:
        """Return the radius of a rod [m]; arguments as of `compliance`."""
        if self.diameter is not None:
            return self.diameter / 2
        return math.sqrt(mass / (math.pi * length * STEEL_DENSITY))


_JointStiffness = HingeStiffness | SlideStiffness | UniversalStiffness


@dataclass(frozen=True)
class Misfit:
    """By how much every joint may be out of place when the machine is assembled."""

    shift: float = 0.0  # in every direction in which a joint holds [m]
    turn: float = 0.0  # about every axis about which it holds [rad]

    def __post_init__(self) -> None:
        for name in ("shift", "turn"):
            not_negative(name, getattr(self, name), ParameterError)


@dataclass(frozen=True)
class Stiffness(Readable):
    """How joints and rods give way; platform, sliders and cross-bars are rigid.

    Parameters
    ----------
    hinges, slides, universals : HingeStiffness, SlideStiffness, UniversalStiffness
        Of the joints of each kind. The numbers by default are guesses for joints of the paper's machine.
    rods : RodSection, optional
        Of legs and rods; None for rigid ones.
    joints : mapping of str to one of these
        For joints that differ from the others of their kind, by name.
    misfit : Misfit, optional
        What assembly may be off by.
    cuts : {"paper", "points"}
        How the legs meet the platform and the right rod the cross-bar; see `p3dof.analysis.reactions`.

    Raises
    ------
    ParameterError
        If a part is something else, or there is no such joint.
    InputError
        If there is no such kind of cuts.
    """

    hinges: HingeStiffness = HingeStiffness()
    slides: SlideStiffness = SlideStiffness()
    universals: UniversalStiffness = UniversalStiffness()
    rods: RodSection | None = RodSection()
    joints: Mapping[str, _JointStiffness] = field(default_factory=dict)
    misfit: Misfit | None = None
    cuts: Idealisation = "paper"

    def __post_init__(self) -> None:
        cuts(self.cuts)
        for name, kind in KINDS.items():
            if not isinstance(getattr(self, name), kind):
                raise ParameterError(f"{name}: expected a {kind.__name__}, got {shown(getattr(self, name))}")
        if not isinstance(self.rods, RodSection | None):
            raise ParameterError(f"rods: expected a RodSection or None, got {shown(self.rods)}")
        if not isinstance(self.misfit, Misfit | None):
            raise ParameterError(f"misfit: expected a Misfit or None, got {shown(self.misfit)}")
        for name, stiffness in self.joints.items():
            kind = KINDS[kind_of(name)]
            if not isinstance(stiffness, kind):
                raise ParameterError(f"joints: {name}: expected a {kind.__name__}, got {shown(stiffness)}")

    def compliances(self, parameters: Parameters) -> tuple[JointCompliance, ...]:
        """Return how each of `JOINTS` gives way, with the rod before it.

        Parameters
        ----------
        parameters : Parameters
            The machine, for lengths and masses of its rods.
        """
        found = []
        for joint in JOINTS:
            stiffness = self.joints.get(joint.name, getattr(self, kind_of(joint.name)))
            rod = None
            if self.rods is not None and joint.name in _RODS:
                mass = getattr(parameters.bodies, _RODS[joint.name]).mass
                rod = self.rods.compliance(parameters.geometry.L, mass)
            forces, moments = stiffness.along_axes()
            found.append(JointCompliance.of_stiffness(forces, moments, rod))
        return tuple(found)

    def misfits(self) -> FloatArray | None:
        """Return by how much each of `JOINTS` may be out of place, (13, 6) [m, rad]; None without misfit."""
        if self.misfit is None:
            return None
        each = np.array([[self.misfit.shift] * 3 + [self.misfit.turn] * 3] * len(JOINTS))
        for row, joint in zip(each, JOINTS, strict=True):
            row[2 if kind_of(joint.name) == "slides" else 4] = 0.0  # along the joint's freedom
        return each


KINDS: Mapping[str, type[_JointStiffness]] = {
    "hinges": HingeStiffness,
    "slides": SlideStiffness,
    "universals": UniversalStiffness,
}


def kind_of(joint: str) -> str:
    """Return which of the fields of `Stiffness` a joint belongs to; `ParameterError` if there is none."""
    names = [one.name for one in JOINTS]
    if joint not in names:
        raise ParameterError(f"joints: expected names of {', '.join(names)}, got {joint!r}")
    if joint.startswith("slide"):
        return "slides"
    return "universals" if joint in _LOOPS[:2] else "hinges"


_NUMBERS: Mapping[str, Quantity] = {
    **dict.fromkeys(("radial", "axial", "lateral", "force"), STIFFNESS),
    **dict.fromkeys(("tilt", "roll", "moment"), TURNING_STIFFNESS),
    **dict.fromkeys(("diameter", "shift"), LENGTH),
    "young": PRESSURE,
    "turn": ANGLE,
}


def read_stiffness(path: Source) -> Stiffness:
    """Read how joints and rods give way from a YAML file as above; errors as of `read_parameters`."""
    source = called(path)
    known = tuple(item.name for item in fields(Stiffness))
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {
        name: _read(data[name], kind(), f"{source}: {name}") for name, kind in KINDS.items() if name in data
    }
    if "joints" in data:
        where = f"{source}: joints"
        own = read_fields(data["joints"], where, (), [joint.name for joint in JOINTS])
        alike = {name: parts.get(name, kind()) for name, kind in KINDS.items()}
        parts["joints"] = {
            name: _read(value, alike[kind_of(name)], f"{where}.{name}") for name, value in own.items()
        }
    if "rods" in data:
        rigid = data["rods"] == "rigid"
        parts["rods"] = None if rigid else _read(data["rods"], RodSection(), f"{source}: rods")
    if "misfit" in data:
        parts["misfit"] = _read(data["misfit"], Misfit(), f"{source}: misfit")
    if "cuts" in data:
        parts["cuts"] = data["cuts"]
    try:
        return named(source, lambda: Stiffness(**parts))
    except InputError as error:
        raise ParameterError(f"{source}: {error}") from error


def _read(data: Any, start: Any, where: str) -> Any:
    """Return a part with the numbers of a file in place of its own."""
    data = read_fields(data, where, (), [item.name for item in fields(start)])
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    return named(where, lambda: replace(start, **values))
