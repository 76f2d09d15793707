"""`Actuators`: what motors, screws and balances add at the sliders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.friction import Coefficients
from p3dof.machine.parameters.names import SLIDES

_GROUPS = {"sliders": SLIDES}
_POSITIVE = ("armature", "counterweight")


@dataclass(frozen=True, eq=False)
class Actuators:
    """Reflected inertia and balance at the sliders; by default none.

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
        Force of a balance on the slider along z0, upward if positive, at home [N]; constant without a spring.
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
            object.__setattr__(self, item.name, Coefficients(_by_slide(item.name, getattr(self, item.name))))

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
        """How fast the balances' forces on A, B, C fall as the sliders rise, (3,) [N/m]."""
        return self._row("spring")

    def balance_at_home(self, gravity: FloatArray) -> FloatArray:
        """Return the force of the balances on the sliders A, B, C along z0 at home.

        Parameters
        ----------
        gravity : ndarray, shape (3,)
            Acceleration of gravity, which acts on counterweights [m/s²].

        Returns
        -------
        ndarray, shape (3,)
            [N]; less `stiffness` times the sliders' positions anywhere else.
        """
        return self._row("counterbalance") - self._row("counterweight") * float(gravity[2])

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers: the form of the parameter file, without what is nowhere."""
        found = {item.name: dict(getattr(self, item.name)) for item in fields(self)}
        return {name: by_slide for name, by_slide in found.items() if by_slide}

    def _row(self, name: str) -> FloatArray:
        by_slide = getattr(self, name)
        return np.array([by_slide.get(slide, 0.0) for slide in SLIDES])


def _by_slide(what: str, given: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers that are not zero, by slide, the group first."""
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what}: expected numbers by slide, got {shown(given)}")
    found: dict[str, float] = {}
    for name in sorted(given, key=lambda name: name not in _GROUPS):
        if name not in _GROUPS and name not in SLIDES:
            known = ", ".join((*_GROUPS, *SLIDES))
            raise ParameterError(f"{what}: unknown slide {shown(name)}, expected one of {known}")
        value = float(frozen_array(f"{what}.{name}", given[name], (), ParameterError))
        if value < 0 and what in _POSITIVE:
            raise ParameterError(f"{what}.{name}: expected zero or more, got {value:g}")
        for slide in _GROUPS.get(name, (name,)):
            found[slide] = value
    return {name: found[name] for name in SLIDES if found.get(name)}
