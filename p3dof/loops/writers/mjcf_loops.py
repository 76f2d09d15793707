"""Closures as equalities of MuJoCo, each with the same free motions, exactly.

MuJoCo ties points (``connect``), frames (``weld``), values of joints, and lengths of tendons. A hinge is two
points on its axis. A rod is a tendon of a fixed length; the axes of a universal joint are perpendicular where
a tendon between a point on each, both as far from where they meet, is as long as the longest side of a
triangle with a right angle. What slides has no such word: a slider, a cylindrical and a planar joint get a
carriage, a body that moves on one of the two bodies as the closure lets it, and is welded to the other.
It takes a part of the mass of that body, with which it moves as one: closed, nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof._base.markup import numbers, sub
from p3dof.loops.constraints import Closure
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.writers.bodies import Body, has_mass
from p3dof.loops.writers.frames import End
from p3dof.loops.writers.names import Names

_X, _Y, _Z = np.eye(3)
_SLIDING = {
    "slider": (("slide", _Z),),
    "cylindrical": (("slide", _Z), ("hinge", _Z)),
    "planar": (("slide", _X), ("slide", _Y), ("hinge", _Z)),
}
"""What a carriage can do, by the kind of closure."""


@dataclass
class Carriage:
    """A body between those of a closure.

    Parameters
    ----------
    name : str
        Its name.
    closure : int
        The closure that it stands for.
    on, place
        The joint whose body it slides on, and where.
    with_, seat
        The joint whose body it is welded to, and where.
    joints : list of (str, str, (3,) array)
        Its joints: names, kinds and axes.
    inertia : pin.Inertia
        Its inertia, in its own axes.
    site : str
        The site at its origin, once that is written.
    """

    name: str
    closure: int
    on: int
    place: pin.SE3
    with_: int
    seat: pin.SE3
    joints: list[tuple[str, str, FloatArray]] = field(default_factory=list)
    inertia: Any = None
    site: str = ""

    def values(self, places: Sequence[pin.SE3]) -> list[FloatArray]:
        """Return the values of its joints where the joints of the tree have these placements."""
        between = (places[self.on] * self.place).actInv(places[self.with_] * self.seat)
        x, y, z = between.translation
        turn = float(np.arctan2(between.rotation[1, 0], between.rotation[0, 0]))
        found = {"slide": {"x": x, "y": y, "z": z}, "hinge": {"z": turn}}
        return [np.array([found[kind]["xyz"[int(np.argmax(axis))]]]) for _, kind, axis in self.joints]


def carriages_of(
    closures: Sequence[Closure], ends: Sequence[tuple[End, End]], bodies: Sequence[Body], names: Names
) -> list[Carriage]:
    """Return the carriages of closures that slide; the bodies that they are welded to get lighter.

    Parameters
    ----------
    closures : sequence of Closure
        The closures.
    ends : sequence of pairs
        Where their frames are.
    bodies : sequence of Body
        The bodies, which change.
    names : Names
        Of joints.

    Returns
    -------
    list of Carriage

    Raises
    ------
    ModelError
        If neither body of such a closure has a mass.
    """
    by_joint = {body.joint: body for body in bodies if has_mass(body.inertia)}
    found = []
    for number, (closure, (one, two)) in enumerate(zip(closures, ends, strict=True)):
        if closure.kind not in _SLIDING:
            continue
        (on, place), (with_, seat) = (one, two) if two[0] in by_joint else (two, one)
        if with_ not in by_joint:
            raise ModelError(
                f"MJCF: the closure {shown(closure.name)} is a {closure.kind}, which MuJoCo has between "
                "bodies with a mass only"
            )
        name = f"{closure.frame1}_{closure.frame2}_{closure.kind}"
        carriage = Carriage(name, number, on, place, with_, seat)
        for kind, axis in _SLIDING[closure.kind]:
            carriage.joints.append((names.new(f"{name}_{'xyz'[int(np.argmax(axis))]}_{kind}"), kind, axis))
        found.append(carriage)
    for joint in dict.fromkeys(carriage.with_ for carriage in found):
        riding = [carriage for carriage in found if carriage.with_ == joint]
        whole, share = by_joint[joint].inertia, 1.0 / (len(riding) + 1)
        part = pin.Inertia(share * whole.mass, whole.lever, share * whole.inertia)
        by_joint[joint].inertia = part
        for carriage in riding:
            carriage.inertia = carriage.seat.actInv(part)
    return found


class LoopWriter:
    """Writes closures.

    Parameters
    ----------
    loop : LoopModel
        The robot.
    ends : sequence of pairs
        Where the frames of its closures are.
    site : callable
        Writes a site, given a joint, a placement and a name, and returns its name.
    names : Names
        Of tendons and equalities.
    tendons, equalities : Element
        Where to.
    """

    def __init__(
        self,
        loop: LoopModel,
        ends: Sequence[tuple[End, End]],
        site: Callable[[int, pin.SE3, str], str],
        names: Names,
        tendons: Xml.Element,
        equalities: Xml.Element,
    ) -> None:
        self._ends, self._closures, self._new = ends, loop.sidecar.closures, site
        self._names, self._tendons, self._equalities = names, tendons, equalities
        data = loop.model.createData()
        pin.forwardKinematics(loop.model, data, pin.neutral(loop.model))
        self._zero = [place.copy() for place in data.oMi]
        spans = [np.linalg.norm(place.translation) for place in loop.model.jointPlacements]
        self._arm = float(max(spans)) or 1.0

    def write(self, carriages: Sequence[Carriage]) -> None:
        """Write all closures, those that slide by their carriages."""
        riding = {carriage.closure: carriage for carriage in carriages}
        for number, (closure, ends) in enumerate(zip(self._closures, self._ends, strict=True)):
            frames = closure.frame1, closure.frame2
            sites = [self._new(*end, name) for end, name in zip(ends, frames, strict=True)]
            name = self._names.new("_".join(frames))
            if number in riding:
                carriage = riding[number]
                seat = sites[1] if carriage.with_ == ends[1][0] else sites[0]
                self._equality("weld", name, carriage.site, seat)
            elif closure.kind == "6d":
                self._equality("weld", name, *sites)
            elif closure.kind == "distance":
                self._tendon(name, sites, ends, float(closure.length or 0.0))
            else:
                self._equality("connect", name, *sites)
                if closure.kind == "hinge":
                    self._equality(
                        "connect", self._names.new(f"{name}_axis"), *self._shifted(ends, name, _Z, _Z)[0]
                    )
                elif closure.kind == "universal":
                    axes = self._names.new(f"{name}_axes")
                    self._tendon(axes, *self._shifted(ends, name, _X, _Y), np.sqrt(2.0) * self._arm)

    def _shifted(
        self, ends: tuple[End, End], name: str, axis1: FloatArray, axis2: FloatArray
    ) -> tuple[list[str], tuple[End, End]]:
        """Return sites on axes of both frames, as far from their origins, and where they are."""
        moved = []
        for (joint, place), axis in zip(ends, (axis1, axis2), strict=True):
            moved.append((joint, place * pin.SE3(np.eye(3), self._arm * axis)))
        sites = [self._new(*end, f"{name}_axis_{number}") for number, end in enumerate(moved, 1)]
        return sites, (moved[0], moved[1])

    def _equality(self, kind: str, name: str, site1: str, site2: str) -> None:
        sub(self._equalities, kind, name=name, site1=site1, site2=site2)

    def _tendon(self, name: str, sites: Sequence[str], ends: tuple[End, End], length: float) -> None:
        """Write a straight tendon of a fixed length: MuJoCo counts from what it has at zero."""
        tendon = sub(self._tendons, "spatial", name=name)
        for site in sites:
            sub(tendon, "site", site=site)
        one, two = ((self._zero[joint] * place).translation for joint, place in ends)
        more = length - float(np.linalg.norm(one - two))
        sub(
            self._equalities,
            "tendon",
            name=name,
            tendon1=name,
            polycoef=numbers(more, 0, 0, 0, 0, exact=True),
        )
