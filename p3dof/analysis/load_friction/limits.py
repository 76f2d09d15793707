"""What contacts resist with under the reactions of the joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.load_friction.contacts import UNIVERSALS, HingeContact, LoadFriction, SlideContact
from p3dof.analysis.reactions import Reactions
from p3dof.machine.parameters import PASSIVE, SLIDES
from p3dof.methods import CoulombLimits

_CUTS = {"universal_a": "loop_a", "universal_b": "loop_b", "hinge_lower_right": "loop_c"}
"""Reactions of joints at which loops are cut."""


def loads_of(friction: LoadFriction, reactions: Reactions) -> dict[str, FloatArray]:
    """Return the loads that the contacts of guides, hinges and universal joints multiply.

    Parameters
    ----------
    friction : LoadFriction
        The contacts.
    reactions : Reactions
        Of all joints, with friction.

    Returns
    -------
    dict of str to ndarray, shape (N, axes)
        By joint [N]: of a guide, or across each axis of a hinge or universal joint.
    """
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
    """Return the friction that belongs to loads, without that of screws.

    Parameters
    ----------
    friction : LoadFriction
        The contacts.
    loads : mapping of str to ndarray, shape (N, axes)
        As `loads_of` returns them.

    Returns
    -------
    CoulombLimits
    """
    limits = {}
    for name, contact in _contacts(friction):
        if isinstance(contact, SlideContact):
            limits[name] = contact.drag + contact.mu * loads[name]
        else:
            limits[name] = contact.mu * contact.radius * loads[name]
    return CoulombLimits(limits, friction.smoothing)


def with_screws(friction: LoadFriction, guides: CoulombLimits, nuts: FloatArray) -> CoulombLimits:
    """Return friction with what screws lose under the forces of their nuts.

    Parameters
    ----------
    friction : LoadFriction
        The contacts.
    guides : CoulombLimits
        The friction without screws.
    nuts : ndarray, shape (N, 3)
        Forces of the nuts, which overcome the friction of the guides too [N].

    Returns
    -------
    CoulombLimits
    """
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
