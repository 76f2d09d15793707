"""`Actuators`: what motors, screws and counterbalances add at the sliders."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable, frozen_array, meant, positive, real, shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.body import JOINT_GROUPS, PASSIVE, SLIDES

_REST = 1e-3


class Coefficients(Mapping[str, float]):
    """Numbers by joint that nobody can change; a copy of them is a plain dictionary."""

    def __init__(self, by_joint: Mapping[str, float]) -> None:
        self._by_joint = dict(by_joint)

    def __getitem__(self, name: str) -> float:
        return self._by_joint[name]

    def __contains__(self, name: object) -> bool:
        return name in self._by_joint

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_joint)

    def __len__(self) -> int:
        return len(self._by_joint)

    def __repr__(self) -> str:
        return repr(self._by_joint)

    def __deepcopy__(self, memo: dict[int, object]) -> dict[str, float]:
        return dict(self._by_joint)  # for `dataclasses.asdict`


@dataclass(frozen=True, eq=False)
class Friction(Readable):
    """Viscous and Coulomb friction in the joints; by default none.

    A joint that moves at the rate w resists with ``viscous * w + coulomb * tanh(w / smoothing)``, whatever
    load it carries.

    Parameters
    ----------
    viscous : mapping of str to float
        Coefficients by joint, zero where not given: of a slide [N s/m], of a hinge [N m s/rad]. The names are
        those of `SLIDES` and `PASSIVE`; ``"sliders"`` and ``"joints"`` stand for all of them, and a joint
        named on its own overrides. ``universal_a`` and ``universal_b`` join legs and platform and resist
        about each of their two axes, x0 and y0; ``hinge_lower_right`` is the lower pivot of the right rod.
    coulomb : mapping of str to float
        Forces [N] and moments [N m] likewise.
    smoothing : float
        How smoothly Coulomb friction changes its sign [m/s, rad/s]: at this rate it has three quarters of its
        full value, at four times this rate 99.9 %.

    Raises
    ------
    ParameterError
        If a joint does not exist, a coefficient is negative or not finite, or `smoothing` is not positive.
    """

    viscous: Mapping[str, float] = field(default_factory=dict)
    coulomb: Mapping[str, float] = field(default_factory=dict)
    smoothing: float = _REST

    def __post_init__(self) -> None:
        for name in ("viscous", "coulomb"):
            by_joint = _by_name(name, getattr(self, name), "joint", JOINT_GROUPS, *SLIDES, *PASSIVE)
            object.__setattr__(self, name, Coefficients(by_joint))
        object.__setattr__(self, "smoothing", positive("smoothing", self.smoothing, ParameterError))

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that have any friction."""
        return tuple(name for name in (*SLIDES, *PASSIVE) if name in self.viscous or name in self.coulomb)

    def __bool__(self) -> bool:
        return bool(self.joints)

    def __reduce__(self) -> tuple[type[Friction], tuple[dict[str, float], dict[str, float], float]]:
        return Friction, (dict(self.viscous), dict(self.coulomb), self.smoothing)

    def to_dict(self) -> dict[str, object]:
        """Return plain numbers: the form of the parameter file."""
        return {"viscous": dict(self.viscous), "coulomb": dict(self.coulomb), "smoothing": self.smoothing}


def _by_name(
    what: str, given: Mapping[str, float], kind: str, groups: Mapping[str, tuple[str, ...]], *known: str
) -> dict[str, float]:
    """Return the numbers that are not zero by joint or slide, groups first; most may not be negative."""
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what}: expected numbers by {kind}, got {shown(given)}")
    found: dict[str, float] = {}
    for name in sorted(given, key=lambda name: name not in groups):
        if name not in groups and name not in known:
            expected = f"expected one of {', '.join((*groups, *known))}{meant(str(name), (*groups, *known))}"
            raise ParameterError(f"{what}: unknown {kind} {shown(name)}, {expected}")
        value = real(f"{what}.{name}", given[name], ParameterError)
        if value < 0 and what not in _SIGNED:
            raise ParameterError(f"{what}.{name}: expected zero or more, got {value:g}")
        for each in groups.get(name, (name,)):
            found[each] = value
    return {name: value for name, value in found.items() if value}


_GROUPS = {"sliders": SLIDES}
_SIGNED = ("counterbalance", "spring")


@dataclass(frozen=True, eq=False)
class Actuators(Readable):
    """Reflected inertia and counterbalance at the sliders; by default none.

    With the force F that moves the machine without them, and λ, the slider's position, zero at home,

        n = F + counterweight λ̈ - balance,    balance = counterbalance - spring λ - counterweight g_z

    is the force at the nut, and f = n + armature λ̈ the force of the actuator; g is gravity. All numbers are
    by slide, zero where not given. The names are those of `SLIDES`; ``"sliders"`` stands for all of them, and
    a slide named on its own overrides.

    Parameters
    ----------
    armature : mapping of str to float
        Inertia of rotor, brake, gear and screw, reflected to the slider [kg]: their moment of inertia times
        the square of the ratio in rad/m. Gravity does not act on it.
    counterbalance : mapping of str to float
        Force on the slider along z0, upward if positive, at home [N]; constant without a spring.
    spring : mapping of str to float
        How fast that force falls as the slider rises [N/m]; negative where it grows.
    counterweight : mapping of str to float
        Mass on a rope over a pulley that pulls the slider up [kg].

    Raises
    ------
    ParameterError
        If a slide does not exist, a number is not finite, or a mass is negative.
    """

    armature: Mapping[str, float] = field(default_factory=dict)
    counterbalance: Mapping[str, float] = field(default_factory=dict)
    spring: Mapping[str, float] = field(default_factory=dict)
    counterweight: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for item in fields(self):
            by_slide = _by_name(item.name, getattr(self, item.name), "slide", _GROUPS, *SLIDES)
            ordered = {name: by_slide[name] for name in SLIDES if name in by_slide}
            object.__setattr__(self, item.name, Coefficients(ordered))

    @property
    def slides(self) -> tuple[str, ...]:
        """The slides that have any of it."""
        return tuple(name for name in SLIDES if any(name in by_slide for by_slide in self.mappings))

    def __bool__(self) -> bool:
        return bool(self.slides)

    def __reduce__(self) -> tuple[type[Actuators], tuple[dict[str, float], ...]]:
        return Actuators, tuple(dict(by_slide) for by_slide in self.mappings)

    @property
    def mappings(self) -> tuple[Mapping[str, float], ...]:
        """Armature, counterbalance, spring and counterweight, in this order."""
        return self.armature, self.counterbalance, self.spring, self.counterweight

    @property
    def inertia(self) -> FloatArray:
        """What has to be moved with the sliders A, B, C and gravity does not act on, (3,) [kg]."""
        return self._row("armature") + self._row("counterweight")

    @property
    def rotors(self) -> FloatArray:
        """Armature of A, B, C, (3,) [kg]: what turns with the motors, between their forces and the nuts."""
        return self._row("armature")

    @property
    def stiffness(self) -> FloatArray:
        """How fast the counterbalances' forces on A, B, C fall as the sliders rise, (3,) [N/m]."""
        return self._row("spring")

    def balance_at_home(self, gravity: FloatArray) -> FloatArray:
        """Return the forces (3,) of the counterbalances along z0 at home [N], under a gravity (3,) [m/s²]."""
        return self._row("counterbalance") - self._row("counterweight") * float(gravity[2])

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers: the form of the parameter file, without what is nowhere."""
        found = {item.name: dict(getattr(self, item.name)) for item in fields(self)}
        return {name: by_slide for name, by_slide in found.items() if by_slide}

    def _row(self, name: str) -> FloatArray:
        by_slide = getattr(self, name)
        return np.array([by_slide.get(slide, 0.0) for slide in SLIDES])


@dataclass(frozen=True)
class Limits(Readable):
    """What the actuators can do, and how far the platform may turn; the paper gives none of these.

    Parameters
    ----------
    travel : tuple of float
        Lowest and highest slider position [m]; home (0) lies between.
    speed : float
        Largest slider speed [m/s].
    force : float
        Largest actuator force [N].
    tilt : tuple of float
        Smallest and largest platform rotation θ [rad]; home (0) lies between.

    Raises
    ------
    ParameterError
        If a number is not finite, not positive where it must be, or a range does not hold home.
    """

    travel: tuple[float, float] = (-0.2, 0.2)
    speed: float = 2.0
    force: float = 500.0
    tilt: tuple[float, float] = (-math.pi / 4, math.pi / 4)

    def __post_init__(self) -> None:
        for name in ("travel", "tilt"):
            low, high = (float(end) for end in frozen_array(name, getattr(self, name), (2,), ParameterError))
            if not low < 0 < high:
                raise ParameterError(f"{name}: expected a range around 0 (home), got [{low:g}, {high:g}]")
            object.__setattr__(self, name, (low, high))
        for name in ("speed", "force"):
            object.__setattr__(self, name, positive(name, getattr(self, name), ParameterError))


PARALLEL = 1e-6
"""Least R - r, as a share of L: half the angle between the legs A and B at home [rad]."""


@dataclass(frozen=True)
class Geometry(Readable):
    """Lengths of the mechanism [m]; the defaults are the paper's.

    Parameters
    ----------
    r : float
        Size of the platform: distance from P to each of its joints A3, B3, C5.
    R : float
        Size of the base: distance from O to each guide.
    L : float
        Length of the legs and of the rods of the parallelogram.
    b : float
        Half width of the parallelogram. The paper does not give it, and no force depends on it.

    Raises
    ------
    ParameterError
        Unless 0 < r < R, L > R - r >= 1e-6 L and b > 0. Were R - r smaller, the legs A and B would be
        parallel at home, and could not hold the platform sideways.
    """

    r: float = 0.1
    R: float = 0.25
    L: float = 0.4
    b: float = 0.05

    def __post_init__(self) -> None:
        for item in fields(self):
            value = positive(item.name, getattr(self, item.name), ParameterError)
            object.__setattr__(self, item.name, value)
        if self.r >= self.R:
            raise ParameterError(
                f"r, R: expected r < R (r = R is singular everywhere), got r = {self.r:g}, R = {self.R:g} m"
            )
        if not self.R - self.r >= PARALLEL * self.L:
            raise ParameterError(
                f"R - r: expected at least {PARALLEL:g} L = {PARALLEL * self.L:g} m, or the legs A and B are "
                f"parallel and cannot hold the platform; got {self.R - self.r:g} m"
            )
        if not self.R - self.r < self.L:
            raise ParameterError(
                f"L: expected more than R - r = {self.R - self.r:g} m to reach the platform, got {self.L:g} m"
            )

    @property
    def h(self) -> float:
        """Depth of the platform below the sliders at home, h = √(L² - (R-r)²) [m] (paper, eq. 7)."""
        width = self.R - self.r
        return math.sqrt((self.L - width) * (self.L + width))
