"""`Friction`: what the sliders and passive joints lose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from p3dof._base.checks import frozen_array, positive, shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.names import JOINT_GROUPS, PASSIVE, SLIDES

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
class Friction:
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
            object.__setattr__(self, name, Coefficients(_by_joint(name, getattr(self, name))))
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


def _by_joint(what: str, given: Mapping[str, float]) -> dict[str, float]:
    """Return the coefficients that are not zero, by joint, groups first."""
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what}: expected coefficients by joint, got {shown(given)}")
    found: dict[str, float] = {}
    for name in sorted(given, key=lambda name: name not in JOINT_GROUPS):
        if name not in JOINT_GROUPS and name not in SLIDES and name not in PASSIVE:
            known = ", ".join((*JOINT_GROUPS, *SLIDES, *PASSIVE))
            raise ParameterError(f"{what}: unknown joint {shown(name)}, expected one of {known}")
        value = float(frozen_array(f"{what}.{name}", given[name], (), ParameterError))
        if value < 0:
            raise ParameterError(f"{what}.{name}: expected zero or more, got {value:g}")
        for joint in JOINT_GROUPS.get(name, (name,)):
            found[joint] = value
    return {name: value for name, value in found.items() if value}
