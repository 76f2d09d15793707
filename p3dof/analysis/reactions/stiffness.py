"""How the joints and rods of the manipulator give way, from numbers of catalogues and of the drawing.

The numbers by default are guesses for joints of this size: replace them by those of the bearings that are to
be used. `p3dof.analysis.reactions.stiffness_file` reads them from files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from p3dof._base.checks import FloatArray, not_negative, positive, shown
from p3dof._base.errors import ParameterError
from p3dof.analysis.reactions.joints import JOINTS, Idealisation, cuts
from p3dof.loops.compliance import JointCompliance, beam
from p3dof.machine.parameters import STEEL_DENSITY, Parameters

_LOOPS = ("loop_a", "loop_b", "loop_c")
_RODS = {"loop_a": "leg_a", "loop_b": "leg_b", "hinge_lower": "rod_left", "loop_c": "rod_right"}
"""Where rods end, and which."""


def _positive(of: object) -> None:
    for item in fields(of):  # type: ignore[arg-type]
        positive(item.name, getattr(of, item.name), ParameterError)


@dataclass(frozen=True)
class HingeStiffness:
    """A hinge: a bearing about y.

    Parameters
    ----------
    radial, axial : float
        Against shifting across and along the axis [N/m].
    tilt : float
        Against turning about an axis across it [N m/rad].

    Raises
    ------
    ParameterError
        If a number is not positive; infinity is rigid.
    """

    radial: float = 1e8
    axial: float = 5e7
    tilt: float = 1e4

    def __post_init__(self) -> None:
        _positive(self)

    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness along x, y, z, and about them; (3,) each."""
        return np.array([self.radial, self.axial, self.radial]), np.full(3, self.tilt)


@dataclass(frozen=True)
class SlideStiffness:
    """The guide of a slider: carriages on a rail along z.

    Parameters
    ----------
    lateral : float
        Against shifting across the rail [N/m].
    tilt, roll : float
        Against turning about an axis across the rail, and about the rail [N m/rad].

    Raises
    ------
    ParameterError
        If a number is not positive; infinity is rigid.
    """

    lateral: float = 2e8
    tilt: float = 2e4
    roll: float = 1e4

    def __post_init__(self) -> None:
        _positive(self)

    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness along x, y, z, and about them; (3,) each."""
        return np.full(3, self.lateral), np.array([self.tilt, self.tilt, self.roll])


@dataclass(frozen=True)
class UniversalStiffness:
    """A universal or a ball joint at the end of a leg.

    Parameters
    ----------
    force : float
        Against shifting [N/m].
    moment : float
        Against turning about the axis that it does not turn about freely [N m/rad].

    Raises
    ------
    ParameterError
        If a number is not positive; infinity is rigid.
    """

    force: float = 8e7
    moment: float = 4e3

    def __post_init__(self) -> None:
        _positive(self)

    def along_axes(self) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness along x, y, z, and about them; (3,) each."""
        return np.full(3, self.force), np.full(3, self.moment)


@dataclass(frozen=True)
class RodSection:
    """Legs and rods as slender round beams without mass, of one diameter and material.

    Parameters
    ----------
    diameter : float, optional
        [m]; by default that of a solid cylinder of steel as heavy as each leg or rod.
    young : float
        Young's modulus [Pa].
    poisson : float
        Poisson's ratio.

    Raises
    ------
    ParameterError
        If a number is not physical.
    """

    diameter: float | None = None
    young: float = 210e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        if self.diameter is None:
            _positive(replace(self, diameter=1.0))
        else:
            _positive(self)
        if not self.poisson < 0.5:
            raise ParameterError(f"poisson: expected less than 0.5, got {self.poisson:g}")

    def compliance(self, length: float, mass: float) -> FloatArray:
        """Return the compliance at the tip of a rod.

        Parameters
        ----------
        length : float
            [m]
        mass : float
            Of the rod [kg].

        Returns
        -------
        ndarray, shape (6, 6)
            See `p3dof.loops.compliance.beam`.
        """
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
    """By how much every joint may be out of place when the machine is assembled.

    Parameters
    ----------
    shift : float
        In every direction in which a joint holds [m].
    turn : float
        About every axis about which it holds [rad].

    Raises
    ------
    ParameterError
        If a number is negative.
    """

    shift: float = 0.0
    turn: float = 0.0

    def __post_init__(self) -> None:
        for name in ("shift", "turn"):
            not_negative(name, getattr(self, name), ParameterError)


@dataclass(frozen=True)
class Stiffness:
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

        Returns
        -------
        tuple of JointCompliance
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
