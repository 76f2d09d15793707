"""`LoadFriction`: friction of hinges, guides and screws that grows with the load they carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from p3dof._base.checks import not_negative, positive, shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters import PASSIVE, SLIDES

UNIVERSALS = ("universal_a", "universal_b")
HINGES = tuple(name for name in PASSIVE if name not in UNIVERSALS)


@dataclass(frozen=True)
class HingeContact:
    """Bearing of a hinge, or of one axis of a universal joint: M = mu radius √(fx² + fz²).

    fx and fz are the components of its reaction across its axis.

    Parameters
    ----------
    mu : float
        Coefficient of friction: some .1 of a plain bearing, some .0015 of a ball bearing.
    radius : float
        At which it acts: half the bore of the bearing [m].

    Raises
    ------
    ParameterError
        If a number is negative or not finite.
    """

    mu: float
    radius: float

    def __post_init__(self) -> None:
        for name in ("mu", "radius"):
            object.__setattr__(self, name, not_negative(name, getattr(self, name), ParameterError))


@dataclass(frozen=True)
class SlideContact:
    """Guide and screw of a slider: ``F = drag + mu (|fx| + |fy| + (|mx| + |my| + |mz|) / arm) + screw |f|``.

    fx, fy, mx, my, mz are what the guide transmits at the slider's origin, in its axes; f is the force of the
    nut, which overcomes the guide's friction too but moves no rotor (armature). The screw's line goes through
    the slider's origin.

    Parameters
    ----------
    drag : float
        Of seals and preload, of guide and nut, whatever the load [N].
    mu : float
        Coefficient of friction of the guide: some .003 of balls, .01 with seals, .1 of plain ways.
    arm : float
        What turns moments on the carriage into loads on its rows of balls: about half of their distance [m].
    screw : float
        Share of the nut's force that the screw loses, 1 / η - 1 of its forward efficiency η. Zero where a
        drive is sized: `p3dof.design.drives` has efficiencies of its own.

    Raises
    ------
    ParameterError
        If a number is negative or not finite, or the arm not positive.
    """

    drag: float = 0.0
    mu: float = 0.0
    arm: float = 0.03
    screw: float = 0.0

    def __post_init__(self) -> None:
        for name in ("drag", "mu", "screw"):
            object.__setattr__(self, name, not_negative(name, getattr(self, name), ParameterError))
        object.__setattr__(self, "arm", positive("arm", self.arm, ParameterError))


@dataclass(frozen=True)
class LoadFriction:
    """Friction of joints that grows with what they bear, besides the `Friction` of the machine.

    The friction of a joint that moves at the rate w is the sum that `HingeContact` or `SlideContact` tells,
    times tanh(w / smoothing). What a joint bears is its reaction with elastic joints, friction included: both
    are found together, `p3dof.analysis.load_friction`.

    Parameters
    ----------
    hinges : HingeContact, optional
        Of all eight hinges; none by default.
    universals : HingeContact, optional
        Of both axes of the universal joints between legs and platform.
    slides : SlideContact, optional
        Of the three sliders.
    joints : mapping of str to HingeContact or SlideContact or None
        Of joints that differ from the others of their kind, by the names of `Friction`; None for one without.
    smoothing : float
        The rate at which friction has three quarters of its full value [m/s, rad/s].

    Raises
    ------
    ParameterError
        If a part is something else, there is no such joint, or no joint has any friction.
    """

    hinges: HingeContact | None = None
    universals: HingeContact | None = None
    slides: SlideContact | None = None
    joints: Mapping[str, HingeContact | SlideContact | None] = field(default_factory=dict)
    smoothing: float = 1e-3

    def __post_init__(self) -> None:
        for name, kind in KINDS.items():
            if not isinstance(getattr(self, name), kind | None):
                raise ParameterError(f"{name}: expected a {kind.__name__}, got {shown(getattr(self, name))}")
        if not isinstance(self.joints, Mapping):
            raise ParameterError(f"joints: expected contacts by joint, got {shown(self.joints)}")
        for name, contact in self.joints.items():
            kind = KINDS[kind_of(name)]
            if not isinstance(contact, kind | None):
                raise ParameterError(f"joints: {name}: expected a {kind.__name__}, got {shown(contact)}")
        object.__setattr__(self, "smoothing", positive("smoothing", self.smoothing, ParameterError))
        if not any(self.of(name) for name in (*SLIDES, *PASSIVE)):
            raise ParameterError("expected hinges, universals, slides or joints, got none of them")

    def of(self, joint: str) -> HingeContact | SlideContact | None:
        """Return the contact of a joint, if it has one; by the names of `Friction`."""
        found = self.joints.get(joint, getattr(self, kind_of(joint)))
        return found if isinstance(found, HingeContact | SlideContact) else None

    @property
    def screws(self) -> bool:
        """Whether any screw loses a share of its nut's force."""
        found = [self.of(name) for name in SLIDES]
        return any(isinstance(one, SlideContact) and one.screw > 0 for one in found)


KINDS: Mapping[str, type[HingeContact] | type[SlideContact]] = {
    "hinges": HingeContact,
    "universals": HingeContact,
    "slides": SlideContact,
}


def kind_of(joint: str) -> str:
    """Return which of the fields of `LoadFriction` a joint belongs to; `ParameterError` if to none."""
    for kind, names in (("slides", SLIDES), ("hinges", HINGES), ("universals", UNIVERSALS)):
        if joint in names:
            return kind
    known = ", ".join((*SLIDES, *PASSIVE))
    raise ParameterError(f"joints: unknown joint {shown(joint)}, expected one of {known}")
