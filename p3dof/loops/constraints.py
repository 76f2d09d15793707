"""`Closure` and `Coupling`: what ties the joints of a tree to each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from types import MappingProxyType
from typing import Any

from p3dof._base.checks import frozen_array, positive, shown
from p3dof._base.errors import ModelError

KINDS: Mapping[str, int] = MappingProxyType(
    {
        "3d": 3,
        "6d": 6,
        "hinge": 5,
        "slider": 5,
        "universal": 4,
        "cylindrical": 4,
        "planar": 3,
        "distance": 1,
    }
)
"""The kinds of closure, and how many rows each has in the Jacobian."""
SYNONYMS: Mapping[str, str] = MappingProxyType({"point": "3d", "frame": "6d"})
"""Other names of kinds."""
MAX_COEFFICIENTS = 5
"""The most coefficients of a coupling: a polynomial of degree four."""


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
        for field in ("frame1", "frame2"):
            checked_name(f"closure: {field}", getattr(self, field))
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
class Coupling:
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
    """Return the name of a kind of closure as `KINDS` has it.

    Parameters
    ----------
    where : str
        What to call it in an error.
    kind : str
        A name or a synonym, in small or capital letters.

    Returns
    -------
    str

    Raises
    ------
    ModelError
        If there is no such kind.
    """
    word = kind.lower() if isinstance(kind, str) else ""
    word = SYNONYMS.get(word, word)
    if word not in KINDS:
        raise ModelError(f"{where}: expected {', '.join(map(repr, KINDS))}, got {shown(kind)}")
    return word


def checked_name(where: str, value: Any) -> None:
    """Refuse what is not a name.

    Parameters
    ----------
    where : str
        What to call it in an error.
    value : object
        What should be a name: text that is not blank.

    Raises
    ------
    ModelError
        If it is none.
    """
    if not isinstance(value, str) or not value.strip():
        raise ModelError(f"{where}: expected a name, got {shown(value)}")


def check_couplings(where: str, couplings: Iterable[Coupling]) -> None:
    """Refuse couplings of which two have the same joint, or which follow each other in a ring.

    Parameters
    ----------
    where : str
        What to call them in an error.
    couplings : iterable of Coupling
        The couplings.

    Raises
    ------
    ModelError
        If they are such.
    """
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
