"""`Sidecar`: what a tree URDF cannot say, its loops, couplings and actuated joints, and its YAML file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin
import yaml

from p3dof._base.checks import (
    FloatArray,
    Readable,
    checked_name,
    frozen_array,
    got_of,
    positive,
    shown,
    suggestion,
    unknown_field,
)
from p3dof._base.errors import FileError, ModelError
from p3dof._base.files import parse_yaml, read_text
from p3dof.loops.bushings import Bushing

KINDS: Mapping[str, int] = MappingProxyType(
    {"3d": 3, "6d": 6, "hinge": 5, "slider": 5, "universal": 4, "cylindrical": 4, "planar": 3, "distance": 1}
)
"""The kinds of closure, and how many rows each has in the Jacobian."""
SYNONYMS: Mapping[str, str] = MappingProxyType({"point": "3d", "frame": "6d"})  # other names of kinds
MAX_COEFFICIENTS = 5  # the most coefficients of a coupling: a polynomial of degree four


@dataclass(frozen=True)
class Closure:
    """Two frames on different bodies whose relative placement is prescribed, altogether or in part.

    Parameters
    ----------
    frame1, frame2 : str
        Names of the frames.
    kind : str
        What is prescribed; p1, p2 are the frames' origins, z1 is the z axis of frame 1, and so on:

        - ``"3d"`` or ``"point"`` (3 rows): p2 = p1, a ball joint;
        - ``"6d"`` or ``"frame"`` (6 rows): the frames coincide, a rigid connection;
        - ``"hinge"`` (5 rows): p2 = p1, and z2 = z1; frame 2 turns about z;
        - ``"slider"`` (5 rows): p2 is on the line along z1 through p1, and the axes agree; frame 2 slides
          along z;
        - ``"universal"`` (4 rows): p2 = p1, and x1 is perpendicular to y2; frame 2 turns about x1 and y2;
        - ``"cylindrical"`` (4 rows): p2 is on the line along z1 through p1, and z2 = z1; frame 2 slides along
          and turns about z;
        - ``"planar"`` (3 rows): p2 is in the plane through p1 across z1, and z2 = z1; frame 2 moves in this
          plane;
        - ``"distance"`` (1 row): p1 and p2 are `length` apart, a massless rod with a ball joint at each end.
    length : float, optional
        The distance [m]; of a ``"distance"``, and of no other kind.

    Raises
    ------
    ModelError
        If a name is empty or not text, both are the same, the kind is unknown, or the length is missing, not
        positive, or given to another kind.
    """

    frame1: str
    frame2: str
    kind: str = "3d"
    length: float | None = None

    def __post_init__(self) -> None:
        for end in ("frame1", "frame2"):
            checked_name(f"closure: {end}", getattr(self, end))
        if self.frame1 == self.frame2:
            raise ModelError(f"closure: expected two different frames, got {shown(self.frame1)} twice")
        where = f"closure of {shown(self.frame1)} and {shown(self.frame2)}"
        object.__setattr__(self, "kind", known_kind(f"{where}: kind", self.kind))
        if self.kind == "distance":
            if self.length is None:
                raise ModelError(f"{where}: length: a distance needs one [m]")
            object.__setattr__(self, "length", positive(f"{where}: length", self.length, ModelError))
        elif self.length is not None:
            raise ModelError(
                f"{where}: length: only a 'distance' has one, got {shown(self.length)} for {self.kind!r}"
            )

    @property
    def name(self) -> str:
        """Both frames in one text, ``frame1/frame2``."""
        return f"{self.frame1}/{self.frame2}"

    @property
    def rows(self) -> int:
        """How many rows the closure has in the Jacobian."""
        return KINDS[self.kind]


@dataclass(frozen=True)
class Coupling(Readable):
    """A joint that follows another one: q_joint = c0 + c1 q_on + ... + c4 q_on⁴ + Σ f q_other.

    All joints have one degree of freedom. Gears, belts, ``<mimic>`` and MuJoCo's joint equalities are such
    couplings; with c0 alone the joint is locked. The value of a continuous joint is its angle; see Notes.

    Parameters
    ----------
    joint : str
        Name of the joint that follows.
    on : str, optional
        Name of the joint that it follows; None for a locked joint.
    coefficients : sequence of float
        c0, c1, ... [m or rad of `joint`, per m or rad of `on`]: one if `on` is None, else one to five.
    name : str, optional
        What to call the coupling in messages; the names of the joints by default.
    others : sequence of (str, float)
        Names of further joints that it follows, and their factors f [m or rad of `joint`, per m or rad]: a
        differential, or a gear between links that hang on several joints.

    Raises
    ------
    ModelError
        If a name is empty or not text, the joint follows itself, another joint is named twice, or the numbers
        are not finite or too many.

    Notes
    -----
    Pinocchio knows the angle of a continuous joint up to whole turns only, so the coupling holds up to what
    that leaves open: its error is taken to the nearest value, and is continuous. If the joint that follows is
    continuous, these are whole turns; if the other one is, multiples of 2π c1; if both are and c1 = a/b in
    lowest terms, b-ths of a turn; and so on with further joints. Where nothing can be said, a continuous
    joint in a polynomial of higher degree or two in a ratio of no such fraction up to b = 1000, the model
    refuses the coupling; a revolute joint, whose turns are counted, can take its place.
    """

    joint: str
    on: str | None
    coefficients: tuple[float, ...]
    name: str | None = None
    others: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        checked_name("coupling: joint", self.joint)
        where = f"coupling of {shown(self.joint)}"
        if self.on is not None:
            checked_name(f"{where}: on", self.on)
        if self.name is not None:
            checked_name(f"{where}: name", self.name)
        if self.on == self.joint:
            raise ModelError(f"{where}: on: the joint cannot follow itself")
        numbers = self.coefficients
        if isinstance(numbers, Iterable) and not isinstance(numbers, str | Mapping):
            numbers = tuple(numbers)
        array = frozen_array(f"{where}: coefficients", numbers, ("n",), ModelError)
        most = 1 if self.on is None else MAX_COEFFICIENTS
        if not 1 <= len(array) <= most:
            wanted = "one, the joint being locked" if self.on is None else f"one to {most}"
            raise ModelError(f"{where}: coefficients: expected {wanted}, got {len(array)}")
        object.__setattr__(self, "coefficients", tuple(float(c) for c in array))
        object.__setattr__(self, "others", self._checked_others(where))

    @property
    def leaders(self) -> tuple[str, ...]:
        """Names of all joints that it follows."""
        return (*(() if self.on is None else (self.on,)), *(name for name, _ in self.others))

    def _checked_others(self, where: str) -> tuple[tuple[str, float], ...]:
        given: object = self.others
        if isinstance(given, str) or not isinstance(given, Iterable):
            raise ModelError(f"{where}: others: expected pairs of a joint and a factor, got {shown(given)}")
        found: dict[str, float] = {}
        for pair in given.items() if isinstance(given, Mapping) else given:
            if not isinstance(pair, list | tuple) or len(pair) != 2:
                raise ModelError(
                    f"{where}: others: expected pairs of a joint and a factor, got {shown(pair)}"
                )
            name, factor = pair
            checked_name(f"{where}: others", name)
            if name in (self.joint, self.on) or name in found:
                raise ModelError(f"{where}: others: the joint {shown(name)} is there already")
            found[name] = float(frozen_array(f"{where}: others: {shown(name)}", factor, (), ModelError))
        return tuple(found.items())

    @property
    def title(self) -> str:
        """What to call the coupling: its `name`, else the joints in one text, ``joint=on``."""
        return self.name or (self.joint if self.on is None else f"{self.joint}={self.on}")


def known_kind(where: str, kind: Any) -> str:
    """Return the name of a kind of closure as `KINDS` has it."""
    word = kind.lower() if isinstance(kind, str) else ""
    word = SYNONYMS.get(word, word)
    if word not in KINDS:
        raise ModelError(f"{where}: expected {', '.join(map(repr, KINDS))}, got {shown(kind)}")
    return word


def check_couplings(where: str, couplings: Iterable[Coupling]) -> None:
    """Refuse couplings of which two have the same joint, or which follow each other in a ring."""
    leaders: dict[str, tuple[str, ...]] = {}
    for coupling in couplings:
        if coupling.joint in leaders:
            raise ModelError(f"{where}: the joint {shown(coupling.joint)} is coupled twice")
        leaders[coupling.joint] = coupling.leaders
    try:
        list(TopologicalSorter(leaders).static_order())
    except CycleError as error:
        ring = " -> ".join(reversed(error.args[1]))
        raise ModelError(f"{where}: the joints follow each other in a ring: {ring}") from error


_SIGNED = ("stiffness", "force", "gear_ratio")
_POSITIVE = ("damping", "friction", "armature", "rotor_inertia")
SMOOTHING = 1e-3
"""Rate over which Coulomb friction changes its sign [m/s or rad/s]: that of `p3dof.machine.Friction`."""
_SEVERAL = (4, 7)  # how many values a ball and a free joint have


@dataclass(frozen=True)
class JointData(Readable):
    """What acts in a joint: force - stiffness (q - rest) - damping v - friction tanh(v / smoothing).

    Parameters
    ----------
    joint : str
        Name of the joint.
    stiffness : float
        Of a spring [N/m or N m/rad], in a joint with one degree of freedom, a ball or a free joint. That of a
        ball turns back about the axis of the turn from `rest`, its torque in proportion to the angle; a free
        joint has such a spring for its turn and one of the same stiffness for its shift, as in MuJoCo. With
        one degree of freedom it may be negative, as of a spring beyond its dead point.
    rest : float or tuple of float
        Value of the joint at which the spring has no force [m or rad]; of a continuous joint an angle, from
        which it turns back by the shorter way. Of a ball or free joint all its values, in Pinocchio's order
        (the quaternion x, y, z, w last); neutral by default.
    damping : float
        Viscous friction, of every freedom of the joint [N s/m or N m s/rad].
    friction : float
        Coulomb friction, likewise [N or N m].
    armature : float
        Inertia that a rotor adds at the joint, seen through its gear [kg or kg m²]. It belongs to the tree:
        whoever reads its file enters it there.
    rotor_inertia : float
        Inertia of the motor's rotor itself [kg m²]. It adds its product with the square of the gear ratio to
        the armature, likewise.
    gear_ratio : float
        Turns of the motor per turn of the joint, or radians per metre of a slide; not zero. Forces are those
        at the joint whatever it is: `ClosedLoopModel.motor_side` tells what is before the gear.
    force : float
        Constant force of a counterbalance, along a joint with one degree of freedom and ends [N or N m].
    smoothing : float
        Rate over which Coulomb friction changes its sign [m/s or rad/s], more than zero.

    Raises
    ------
    ModelError
        If the name is empty or not text, a number is not finite, a loss or an inertia is negative, or the
        gear ratio is zero, or the smoothing not positive.
    """

    joint: str
    stiffness: float = 0.0
    rest: float | tuple[float, ...] = 0.0
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    rotor_inertia: float = 0.0
    gear_ratio: float = 1.0
    force: float = 0.0
    smoothing: float = SMOOTHING

    def __post_init__(self) -> None:
        checked_name("joint data: joint", self.joint)
        object.__setattr__(self, "rest", _rest(self.joint, self.rest))
        for name in (*_SIGNED, *_POSITIVE):
            where = f"joint data of {shown(self.joint)}: {name}"
            value = float(frozen_array(where, getattr(self, name), (), ModelError))
            if value < 0 and name in _POSITIVE:
                raise ModelError(f"{where}: expected zero or more, got {value:g}")
            if value == 0 and name == "gear_ratio":
                raise ModelError(f"{where}: expected a number other than zero")
            object.__setattr__(self, name, value)
        where = f"joint data of {shown(self.joint)}: smoothing"
        object.__setattr__(self, "smoothing", positive(where, self.smoothing, ModelError))

    def __bool__(self) -> bool:
        given = any(getattr(self, name) for name in (*_POSITIVE, "stiffness", "force"))
        return given or self.gear_ratio != 1.0

    @property
    def reflected_inertia(self) -> float:
        """What the rotor adds at the joint, gear_ratio² rotor_inertia [kg or kg m²]."""
        return self.gear_ratio**2 * self.rotor_inertia


def _rest(joint: str, rest: object) -> float | tuple[float, ...]:
    where = f"joint data of {shown(joint)}: rest"
    if isinstance(rest, list | tuple) or (isinstance(rest, np.ndarray) and rest.ndim):
        numbers = frozen_array(where, rest, ("n",), ModelError)
        if len(numbers) not in _SEVERAL:
            raise ModelError(f"{where}: expected one number, four or seven, got {len(numbers)}")
        return tuple(float(x) for x in numbers)
    return float(frozen_array(where, rest, (), ModelError))


def checked_data(where: str, entries: Iterable[object]) -> tuple[JointData, ...]:
    """Return the entries that say anything."""
    found: dict[str, JointData] = {}
    for entry in entries:
        if not isinstance(entry, JointData):
            raise ModelError(f"{where}: expected JointData objects, got {shown(entry)}")
        if entry.joint in found:
            raise ModelError(f"{where}: the joint {shown(entry.joint)} is named twice")
        found[entry.joint] = entry
    return tuple(entry for entry in found.values() if entry)


class MotorSide(NamedTuple):
    """What the motors of the actuated joints do, before their gears, which lose nothing.

    Parameters
    ----------
    gear_ratio : (n_actuated,) array
        Turns of the motor per turn of the joint, or radians per metre; 1 where nothing is said.
    torque : (..., n_actuated) array
        At the rotor [N m], its own inertia included; of a slide without a gear the force [N].
    speed : (..., n_actuated) array
        Of the rotor [rad/s], or of a slide without a gear [m/s].
    """

    gear_ratio: FloatArray
    torque: FloatArray
    speed: FloatArray


def motor_side(
    actuated: Sequence[str], data: Sequence[JointData], tau: FloatArray, speed: FloatArray
) -> MotorSide:
    """Return what the motors do that give forces to joints."""
    known = {entry.joint: entry.gear_ratio for entry in data}
    ratio = np.array([known.get(name, 1.0) for name in actuated])
    return MotorSide(ratio, np.asarray(tau / ratio), np.asarray(speed * ratio))


_REQUIRED = ("closed_loop", "type", "name_mot")
_OPTIONAL = ("length", "coupling", "reference", "joint_name", "joint_type", "joint_data", "bushings")
_JOINT_DATA = tuple(field.name for field in fields(JointData) if field.name != "joint")
_BUSHING = ("stiffness", "damping", "name")
_COUPLING = ("joint", "coefficients", "on", "name", "others")


def parts_of(content: Mapping[str, Any], source: str) -> tuple[Any, ...]:
    """Return the arguments of `Sidecar` from a mapping with the keys of the file."""
    if not isinstance(content, Mapping):
        raise ModelError(f"{source}: expected a mapping with {_listed(_REQUIRED)}, got {got_of(content)}")
    _known_keys(source, content, _REQUIRED, _OPTIONAL)
    pairs, kinds, actuated = (_list(source, content, key) for key in _REQUIRED)
    lengths, couplings, names, types, data, bushings = (
        [] if content.get(key) is None else _list(source, content, key)
        for key in ("length", "coupling", "joint_name", "joint_type", "joint_data", "bushings")
    )
    _same_number(source, "type", len(kinds), len(pairs), "closure")
    if lengths:
        _same_number(source, "length", len(lengths), len(pairs), "closure")
    _same_number(source, "joint_type", len(types), len(names), "name")
    entries = zip(pairs, kinds, lengths or [None] * len(pairs), strict=True)
    closures = [_closure(source, i, *entry) for i, entry in enumerate(entries)]
    distinct(f"{source}: name_mot", actuated)
    distinct(f"{source}: joint_name", names)
    found = [_coupling(f"{source}: coupling[{i}]", entry) for i, entry in enumerate(couplings)]
    check_couplings(f"{source}: coupling", found)
    acting = [
        _entry(JointData, f"{source}: joint_data[{i}]", entry, "joint", _JOINT_DATA)
        for i, entry in enumerate(data)
    ]
    between = [
        _entry(Bushing, f"{source}: bushings[{i}]", entry, "frames", _BUSHING)
        for i, entry in enumerate(bushings)
    ]
    distinct(f"{source}: bushings", [bushing.title for bushing in between], "bushing")
    return (
        tuple(closures),
        tuple(actuated),
        tuple(found),
        reference_of(f"{source}: reference", content.get("reference")),
        tuple(pair_of(f"{source}: joint_type", pair) for pair in zip(names, types, strict=True)),
        checked_data(f"{source}: joint_data", acting),
        tuple(between),
    )


def content_of(
    closures: tuple[Closure, ...],
    actuated: tuple[str, ...],
    couplings: tuple[Coupling, ...],
    reference: Mapping[str, Any] | None,
    joints: tuple[tuple[str, str], ...],
    joint_data: tuple[JointData, ...],
    bushings: tuple[Bushing, ...],
) -> dict[str, Any]:
    """Return the content of a sidecar's file as lists, text and numbers; without empty keys."""
    content: dict[str, Any] = {
        "closed_loop": [[closure.frame1, closure.frame2] for closure in closures],
        "type": [closure.kind for closure in closures],
        "name_mot": list(actuated),
    }
    if any(closure.length is not None for closure in closures):
        content["length"] = [closure.length for closure in closures]
    if couplings:
        content["coupling"] = [_fields(coupling) for coupling in couplings]
    if reference is not None:
        content["reference"] = {
            joint: list(value) if isinstance(value, tuple) else value for joint, value in reference.items()
        }
    if joints:
        content["joint_name"], content["joint_type"] = (list(part) for part in zip(*joints, strict=True))
    if joint_data:
        content["joint_data"] = [_data_fields(entry) for entry in joint_data]
    if bushings:
        content["bushings"] = [_bushing_fields(bushing) for bushing in bushings]
    return content


def reference_of(where: str, reference: Any) -> Mapping[str, float | tuple[float, ...]] | None:
    """Return a reference configuration that cannot be changed: a number, or a tuple of several, by joint."""
    if reference is None:
        return None
    if not isinstance(reference, Mapping):
        raise ModelError(f"{where}: expected a mapping of joints to values, got {shown(reference)}")
    result: dict[str, float | tuple[float, ...]] = {}
    for joint, value in reference.items():
        checked_name(where, joint)
        several = isinstance(value, Iterable) and not isinstance(value, str | Mapping)
        numbers = tuple(_number(number) for number in value) if several else (_number(value),)
        array = frozen_array(f"{where}: {shown(joint)}", numbers, ("n",), ModelError)
        if not len(array):
            raise ModelError(f"{where}: {shown(joint)}: expected a number, got none")
        result[joint] = tuple(float(x) for x in array) if len(array) > 1 else float(array[0])
    return MappingProxyType(result)


def pair_of(where: str, pair: Any) -> tuple[str, str]:
    """Return a pair of names as a tuple."""
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise ModelError(f"{where}: expected pairs of a joint and its type, got {shown(pair)}")
    for name in pair:
        checked_name(where, name)
    return pair[0], pair[1]


def distinct(where: str, names: Sequence[Any], what: str = "joint") -> None:
    """Refuse names of which two are the same."""
    seen: set[str] = set()
    for index, name in enumerate(names):
        checked_name(f"{where}[{index}]", name)
        if name in seen:
            raise ModelError(f"{where}[{index}]: the {what} {shown(name)} is named twice")
        seen.add(name)


def _known_keys(
    where: str, content: Mapping[str, Any], required: tuple[str, ...], optional: tuple[str, ...]
) -> None:
    for key in content:
        if key not in required + optional:
            raise ModelError(f"{where}: {unknown_field(key, content, required + optional)}")
    for key in required:
        if key not in content:
            raise ModelError(f"{where}: the key {key!r} is missing")


def _list(source: str, content: Mapping[str, Any], key: str) -> list[Any]:
    if isinstance(content[key], str | Mapping) or not isinstance(content[key], Iterable):
        raise ModelError(f"{source}: {key}: expected a list, got {shown(content[key])}")
    return list(content[key])


def _same_number(source: str, key: str, got: int, expected: int, what: str) -> None:
    if got != expected:
        raise ModelError(f"{source}: {key}: expected {expected} entries, one a {what}, got {got}")


def _closure(source: str, index: int, pair: Any, kind: Any, length: Any) -> Closure:
    where = f"{source}: closed_loop[{index}]"
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise ModelError(f"{where}: expected a pair of frame names, got {shown(pair)}")
    for frame in pair:
        checked_name(where, frame)
    if pair[0] == pair[1]:
        raise ModelError(f"{where}: expected two different frames, got {shown(pair[0])} twice")
    kind = known_kind(f"{source}: type[{index}]", kind)
    try:
        return Closure(pair[0], pair[1], kind, _number(length))
    except ModelError as error:
        raise ModelError(f"{source}: length[{index}]: {error}") from error


def _coupling(where: str, entry: Any) -> Coupling:
    if not isinstance(entry, Mapping):
        raise ModelError(f"{where}: expected a mapping with {_listed(_COUPLING)}, got {shown(entry)}")
    if "on" not in entry:  # which YAML reads as true, if it is not in quotes
        entry = {"on" if key is True else key: value for key, value in entry.items()}
    _known_keys(where, entry, _COUPLING[:2], _COUPLING[2:])
    numbers = entry["coefficients"]
    if isinstance(numbers, list | tuple):
        numbers = tuple(_number(number) for number in numbers)
    try:
        others = entry.get("others", ())
        if isinstance(others, Mapping):
            others = {name: _number(factor) for name, factor in others.items()}
        return Coupling(entry["joint"], entry.get("on"), numbers, entry.get("name"), others)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error


_EntryT = TypeVar("_EntryT", JointData, Bushing)


def _entry(
    kind: Callable[..., _EntryT], where: str, entry: Any, first: str, others: tuple[str, ...]
) -> _EntryT:
    """Return a mapping with the fields of a class as one of it; `first` is the field that it must have."""
    if not isinstance(entry, Mapping):
        raise ModelError(f"{where}: expected a mapping with {_listed((first, *others))}, got {shown(entry)}")
    _known_keys(where, entry, (first,), others)
    given = {key: entry[key] for key in (first, *others) if key in entry}
    for key in set(given) - {first, "name"}:
        value = given[key]
        given[key] = [_number(x) for x in value] if isinstance(value, list | tuple) else _number(value)
    try:
        return kind(**given)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error


def _bushing_fields(bushing: Bushing) -> dict[str, Any]:
    named = {} if bushing.name is None else {"name": bushing.name}
    return {key: list(getattr(bushing, key)) for key in ("frames", *_BUSHING[:2])} | named


def _data_fields(entry: JointData) -> dict[str, Any]:
    plain = JointData(entry.joint)
    found = {key: getattr(entry, key) for key in _JOINT_DATA if getattr(entry, key) != getattr(plain, key)}
    if isinstance(entry.rest, tuple):
        found["rest"] = list(entry.rest)
    return {"joint": entry.joint, **found}


def _fields(coupling: Coupling) -> dict[str, Any]:
    content: dict[str, Any] = {
        "joint": coupling.joint,
        "on": coupling.on,
        "coefficients": list(coupling.coefficients),
    }
    if coupling.name is not None:
        content["name"] = coupling.name
    if coupling.others:
        content["others"] = dict(coupling.others)
    return content


def _number(value: Any) -> Any:
    """Return what YAML reads as text but is a number, such as 1e-3, as a number; else the value itself."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _listed(keys: Iterable[str]) -> str:
    return ", ".join(repr(key) for key in keys)


__all__ = ["Closure", "Coupling", "Sidecar", "SidecarLike", "sidecar_of", "suggestion"]


@dataclass(frozen=True)
class Sidecar(Readable):
    """What completes a tree model: loop closures, couplings, actuated joints, a reference configuration.

    Its file is the YAML sidecar of the Gepetto team's example-parallel-robots: ``closed_loop`` lists pairs of
    frames, ``type`` says for each pair of which kind the closure is, ``name_mot`` lists the actuated joints.
    Five keys may be added: ``length`` (for each pair the distance, or null), ``coupling``, ``joint_data`` and
    ``bushings`` (lists of mappings with the fields of `Coupling`, `JointData` and `Bushing`) and
    ``reference`` (a mapping).
    ``joint_name`` and ``joint_type`` list joints that are of another type than the URDF says.

    Parameters
    ----------
    closures : tuple of Closure
        The closures; may be empty, and may be redundant.
    actuated : tuple of str
        Names of the actuated joints, in the order of every `tau`. Empty for a mechanism that moves passively.
    couplings : tuple of Coupling
        Joints that follow others, or are locked.
    reference : mapping of str to float or sequence of float, optional
        A configuration of the assembly that is meant, by joint: its value [m or rad], for a continuous joint
        the angle; all its values in Pinocchio's order if it has several. Joints that are left out are
        neutral. It is where assembling starts; couplings and closures need not hold exactly.
    joints : tuple of (str, str)
        Names and types of joints that are of another type than the tree's file says; whoever reads that file
        applies them.
    joint_data : tuple of JointData
        Springs, damping and friction that act in joints, and their rotors.
    bushings : tuple of Bushing
        Springs and dampers between two frames each.

    Raises
    ------
    ModelError
        If an entry has the wrong type, a joint is named or coupled twice, couplings form a ring, or two
        bushings have one name.
    """

    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]
    couplings: tuple[Coupling, ...] = ()
    reference: Mapping[str, Any] | None = field(default=None, hash=False)
    joints: tuple[tuple[str, str], ...] = ()
    joint_data: tuple[JointData, ...] = ()
    bushings: tuple[Bushing, ...] = ()

    def __post_init__(self) -> None:
        for name in ("closures", "actuated", "couplings", "joints", "joint_data", "bushings"):
            value = getattr(self, name)
            if isinstance(value, str) or not isinstance(value, Iterable):
                raise ModelError(f"{name}: expected a sequence, got {shown(value)}")
            object.__setattr__(self, name, tuple(value))
        kinds = {"closures": Closure, "couplings": Coupling, "bushings": Bushing}
        for name, kind in kinds.items():
            for entry in getattr(self, name):
                if not isinstance(entry, kind):
                    raise ModelError(f"{name}: expected {kind.__name__} objects, got {shown(entry)}")
        distinct("actuated", self.actuated)
        check_couplings("couplings", self.couplings)
        object.__setattr__(self, "reference", reference_of("reference", self.reference))
        object.__setattr__(self, "joints", tuple(pair_of("joints", pair) for pair in self.joints))
        distinct("joints", [name for name, _ in self.joints])
        distinct("bushings", [bushing.title for bushing in self.bushings], "bushing")
        object.__setattr__(self, "joint_data", checked_data("joint_data", self.joint_data))

    def __reduce__(self) -> tuple[Any, ...]:
        reference = None if self.reference is None else dict(self.reference)
        parts = self.closures, self.actuated, self.couplings, reference, self.joints, self.joint_data
        return Sidecar, (*parts, self.bushings)

    @classmethod
    def serial(cls, model: pin.Model) -> Sidecar:
        """Return the sidecar of an open tree: no closures, every joint with one degree of freedom actuated.

        Parameters
        ----------
        model : pin.Model
            The tree.
        """
        joints = range(1, model.njoints)
        return cls((), tuple(str(model.names[i]) for i in joints if model.nvs[i] == 1))

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Sidecar:
        """Read a sidecar file.

        Parameters
        ----------
        path : path-like
            The YAML file.

        Raises
        ------
        ModelError
            If the file cannot be read or is malformed; the message names the file and the field.
        """
        try:
            text = read_text(path)
        except FileError as error:
            raise ModelError(str(error)) from error
        return cls.parse(text, os.fspath(path))

    @classmethod
    def parse(cls, text: str, source: str = "sidecar") -> Sidecar:
        """Read a sidecar from YAML text.

        Parameters
        ----------
        text : str
            The YAML text.
        source : str
            What to call it in an error: usually the file name.

        Raises
        ------
        ModelError
            If the text is malformed; the message names the source and the field.
        """
        return cls.from_mapping(parse_yaml(text, source, ModelError), source)

    @classmethod
    def from_mapping(cls, content: Mapping[str, Any], source: str = "sidecar") -> Sidecar:
        """Build a sidecar from a mapping with the keys of the file.

        Parameters
        ----------
        content : mapping
            ``closed_loop``, ``type`` and ``name_mot``, and perhaps more, as in the file.
        source : str
            What to call it in an error.

        Raises
        ------
        ModelError
            If a key is missing or unknown, or a value has the wrong type or length.
        """
        return cls(*parts_of(content, source))

    def to_yaml(self) -> str:
        """Return the text of the sidecar file, YAML that `parse` reads back to an equal sidecar."""
        content = content_of(*self.__reduce__()[1])
        text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True)
        return text


SidecarLike: TypeAlias = Sidecar | Mapping[str, Any] | str | os.PathLike[str] | tuple[()] | None
"""A sidecar, a mapping with the keys of its file, the path of the file or its text; an empty tuple or None
for none."""


def sidecar_of(given: SidecarLike) -> Sidecar | None:
    """Return what a user gives for a sidecar as one; None for none."""
    if given is None or (isinstance(given, tuple) and not given) or isinstance(given, Sidecar):
        return given or None
    if isinstance(given, str) and "\n" in given:
        return Sidecar.parse(given)
    if isinstance(given, str | os.PathLike):
        return Sidecar.from_yaml(given)
    return Sidecar.from_mapping(given)


def names_beside(path: str | os.PathLike[str]) -> list[Path]:
    """Return the paths that the sidecar of a file has, if there is one."""
    name = Path(path).name.removesuffix(".xacro")
    stem = name.rpartition(".")[0] or name
    return [Path(path).with_name(stem + ending) for ending in (".yaml", ".yml")]
