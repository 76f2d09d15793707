"""`LoadFriction`: friction of hinges, guides and screws that grows with the load they carry.

Files of friction that grows with loads.

The form::

    hinges: {mu: 0.1, radius: 8 mm}                        # of all hinges
    universals: {mu: 0.1, radius: 8 mm}                    # of both axes of each
    slides: {drag: 4 N, mu: 0.01, arm: 30 mm, screw: 0.1}
    joints:                                                # where one joint differs
      hinge_platform: {mu: 0.002}
      hinge_lower_right: none
    smoothing: 1 mm/s

Numbers are in SI units, or have one of their own. Kinds of joints that are left out have no such friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable, not_negative, positive, shown
from p3dof._base.errors import ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof._base.quantities import FORCE, LENGTH, RATE, Quantity
from p3dof.analysis.reactions import Reactions
from p3dof.machine.parameters import PASSIVE, SLIDES
from p3dof.machine.parameters.machine import named, read_fields
from p3dof.methods import CoulombLimits

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
class LoadFriction(Readable):
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


_NUMBERS: Mapping[str, Quantity] = {"radius": LENGTH, "arm": LENGTH, "drag": FORCE}


def read_load_friction(path: Source) -> LoadFriction:
    """Read how friction grows with loads from a YAML file as above; errors as of `read_parameters`."""
    source = called(path)
    known = tuple(item.name for item in fields(LoadFriction))
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {
        name: _contact(data[name], kind, None, f"{source}: {name}")
        for name, kind in KINDS.items()
        if name in data
    }
    if "joints" in data:
        where = f"{source}: joints"
        own = read_fields(data["joints"], where, (), (*SLIDES, *PASSIVE))
        parts["joints"] = {
            name: _contact(value, KINDS[kind_of(name)], parts.get(kind_of(name)), f"{where}.{name}")
            for name, value in own.items()
        }
    if "smoothing" in data:
        parts["smoothing"] = RATE.read(data["smoothing"], f"{source}: smoothing")
    return named(source, lambda: LoadFriction(**parts))


def _contact(data: Any, kind: type[Any], alike: Any, where: str) -> Any:
    """Return a contact, with the numbers of its kind where a joint has none of its own; None for "none"."""
    if data == "none":
        return None
    needed = [item.name for item in fields(kind) if item.default is MISSING] if alike is None else []
    data = read_fields(data, where, needed, [item.name for item in fields(kind)])
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    return named(where, lambda: kind(**values) if alike is None else replace(alike, **values))


_CUTS = {"universal_a": "loop_a", "universal_b": "loop_b", "hinge_lower_right": "loop_c"}
"""Reactions of joints at which loops are cut."""


def loads_of(friction: LoadFriction, reactions: Reactions) -> dict[str, FloatArray]:
    """Return the loads that contacts multiply, by joint [N]: of a guide, or across each axis of a hinge."""
    found = {}
    for name, contact in _contacts(friction):
        i = reactions.joints.index(_CUTS.get(name, name))
        f, m = reactions.forces[:, i], reactions.moments[:, i]
        if isinstance(contact, SlideContact):
            load = np.abs(f[:, :2]).sum(axis=1) + np.abs(m).sum(axis=1) / contact.arm
            found[name] = load[:, None]
        elif name in UNIVERSALS:  # a leg turns about x0 only, the platform about y0 only
            x, y, z = np.einsum("nij,nj->in", reactions.rotations[:, i], f)
            found[name] = np.column_stack([np.hypot(y, z), np.hypot(x, z)])
        else:
            found[name] = np.hypot(f[:, 0], f[:, 2])[:, None]
    return found


def limits_of(friction: LoadFriction, loads: Mapping[str, FloatArray]) -> CoulombLimits:
    """Return the friction that belongs to loads, without that of screws."""
    limits = {}
    for name, contact in _contacts(friction):
        if isinstance(contact, SlideContact):
            limits[name] = contact.drag + contact.mu * loads[name]
        else:
            limits[name] = contact.mu * contact.radius * loads[name]
    return CoulombLimits(limits, friction.smoothing)


def with_screws(friction: LoadFriction, guides: CoulombLimits, nuts: FloatArray) -> CoulombLimits:
    """Return friction with what screws lose under the forces of their nuts."""
    limits, screws = dict(guides.limits), np.zeros_like(nuts)
    for i, name in enumerate(SLIDES):
        contact = friction.of(name)
        if isinstance(contact, SlideContact):
            screws[:, i] = contact.screw * np.abs(nuts[:, i])
            limits[name] = limits[name] + screws[:, i : i + 1]
    return CoulombLimits(limits, guides.smoothing, screws)


def _contacts(friction: LoadFriction) -> Iterator[tuple[str, HingeContact | SlideContact]]:
    """Go through the joints that have a contact."""
    for name in (*SLIDES, *PASSIVE):
        contact = friction.of(name)
        if contact is not None:
            yield name, contact
