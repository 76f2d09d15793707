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

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray, Progress, Readable, not_negative, positive, require, shown
from p3dof._base.errors import DynamicsError, InputError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof._base.quantities import FORCE, LENGTH, RATE, Quantity
from p3dof._base.samples import OnInvalid
from p3dof._base.tables import ShownInNotebook, Table, formatted, html_of, notebook_html, number, table_of
from p3dof.analysis.reactions import Reactions, Stiffness
from p3dof.closed_form import kinematics
from p3dof.closed_form.paper.formulas import velocities
from p3dof.closed_form.paper.friction import joint_rates
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import LEGS, PASSIVE, SLIDES, Parameters
from p3dof.machine.parameters.machine import named, read_fields
from p3dof.methods import (
    CoulombLimits,
    DynamicsMethod,
    InverseDynamics,
    Solution,
    virtual_power,
    with_evidence,
    without_crossings,
)

if TYPE_CHECKING:
    from p3dof.loops import ClosedLoopModel

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


@dataclass(frozen=True, eq=False)
class LoadFrictionEffect(ShownInNotebook):
    """Forces with and without friction that depends on the loads of the joints.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    friction : LoadFriction
        Its contacts.
    without : InverseDynamics
        Forces with the constant friction of the machine only.
    result : InverseDynamics
        Forces with all friction.
    reactions : Reactions
        Of elastic joints, under all friction.
    loads : mapping of str to ndarray, shape (N, axes)
        What the contacts of guides, hinges and universal joints bear: see `LoadFriction` [N].
    steps : int
        How many it took until no load changed.
    """

    parameters: Parameters
    friction: LoadFriction
    without: InverseDynamics
    result: InverseDynamics
    reactions: Reactions
    loads: Mapping[str, FloatArray]
    steps: int

    def __repr__(self) -> str:
        most = ", ".join(f"{more:.4g}" for more in self.largest_additions)
        return f"LoadFrictionEffect({self.result!r}, at most {most} N more, {self.steps} steps)"

    @property
    def coulomb(self) -> CoulombLimits:
        """The largest friction of each contact, by joint and sample."""
        assert self.result.coulomb is not None  # noqa: S101 - it was found with it
        return self.result.coulomb

    @property
    def additions(self) -> FloatArray:
        """What friction adds to the forces of A, B and C, shape (N, 3) [N]."""
        return self.result.forces - self.without.forces

    @property
    def largest_additions(self) -> FloatArray:
        """The largest sizes of these, shape (3,) [N]; NaN unless the motion is possible."""
        if not self.result.possible:
            return np.full(3, np.nan)
        return np.asarray(np.abs(self.additions).max(axis=0))

    @cached_property
    def resistances(self) -> Mapping[str, FloatArray]:
        """Friction of each contact at each sample, signs as its rate, (N, axes) by joint [N or N m]."""
        smoothing, limits = self.coulomb.smoothing, self.coulomb.limits
        return {name: limits[name] * np.tanh(rate / smoothing) for name, rate in self._rates.items()}

    @property
    def of_guides(self) -> FloatArray:
        """What of these is friction of the own guide and screw, (N, 3) [N]; hinges add the rest."""
        none = np.zeros((len(self.result.time), 1))
        return np.hstack([self.resistances.get(name, none) for name in SLIDES])

    @cached_property
    def lost_work(self) -> Mapping[str, float]:
        """What each contact takes over the motion, by joint [J]; NaN unless the motion is possible."""
        time = self.result.time
        powers = {name: (self.resistances[name] * rate).sum(axis=1) for name, rate in self._rates.items()}
        return {name: float(np.trapezoid(power, time)) for name, power in powers.items()}

    @cached_property
    def _rates(self) -> dict[str, FloatArray]:
        """How fast each contact slides or turns, (N, axes) by joint."""
        motion = self.result.motion
        states = states_over(motion, None, "nan")
        placed = kinematics.holdable(self.parameters.geometry, states)
        velocity = components(placed.states.velocity)
        rates = joint_rates(velocities(placed.lengths, placed.x, velocity), velocity)
        count = len(motion)
        return {
            name: np.column_stack([np.broadcast_to(rate, count) for rate in rates[name]])
            for name in self.coulomb.limits
        }


APPLIES = (
    "Load-dependent friction: in forces over motions and tasks, reactions, lives of bearings, drives. "
    "Kernels, generated C, simulations and fastest motions have only the constant friction of the parameters."
)
"""What must stand beside it: where it counts, and where not."""


def additions_table(effect: LoadFrictionEffect) -> Table:
    """Return what load-dependent friction adds to the force of each actuator."""
    with_, without, additions = effect.result, effect.without, effect.additions
    guides = np.abs(effect.of_guides)
    rows = {}
    for k, leg in enumerate(LEGS):
        size = np.abs(additions[:, k])
        at = int(np.nanargmax(size)) if with_.possible else 0
        rows[f"force {leg} [N]"] = (
            without.peak_forces[k],
            with_.peak_forces[k],
            without.rms_forces[k],
            with_.rms_forces[k],
            effect.largest_additions[k],
            with_.time[at] if with_.possible else float("nan"),
            guides[at, k] if with_.possible else float("nan"),
            _share(float(effect.largest_additions[k]), float(without.peak_forces[k])),
        )
    header = (
        "", "peak without", "peak with", "RMS without", "RMS with", "most added", "at t [s]",
        "of its own guide", "share of the peak",
    )  # fmt: skip
    note = f"Loads and friction converged in {effect.steps} steps. Hinges: all but the own guide and screw."
    return table_of("Additional forces of load-dependent friction", header, rows, note, "wide", decimals=3)


def contacts_table(effect: LoadFrictionEffect) -> Table:
    """Return the load and the friction of each contact, and what it loses."""
    total = sum(effect.lost_work.values())
    rows = {}
    for name, work in effect.lost_work.items():
        load, friction = (
            float(values[name].max()) if effect.result.possible else float("nan")
            for values in (effect.loads, effect.coulomb.limits)
        )
        unit = "N" if name in SLIDES else "N m"
        rows[name] = (number(load), number(friction, unit), number(work), _share(work, total))
    header = ("joint", "largest load [N]", "largest friction", "lost in the motion [J]", "share")
    note = "Load: of a hinge across its axis; of a guide |fx| + |fy| + (|mx| + |my| + |mz|) / arm."
    return table_of("Origin of load-dependent friction", header, rows, note)


def _share(part: float, whole: float) -> str:
    return formatted(part / whole, ".1%") if whole > 0 else "–"


@html_of.register(LoadFrictionEffect)
def effect_html(effect: LoadFrictionEffect) -> str:
    """Return how a notebook shows what load-dependent friction adds, as HTML."""
    facts = f"{len(effect.result.time)} samples over {number(effect.result.motion.duration)} s"
    tables = [additions_table(effect), contacts_table(effect)]
    return notebook_html("Load-dependent friction", facts, tables, [], APPLIES)


TOLERANCE = 1e-12  # share of the largest load of all joints by which a load may change in the last step
_PATIENCE = 12  # steps within which the changes must halve
_BEYOND = 1e3  # a change by so many times the largest load will not settle any more

_Against: TypeAlias = Callable[[CoulombLimits, Solution], tuple[FloatArray, FloatArray]]
"""Returns what friction takes of the actuators (N, 3) [N], and its power (N,) [W]."""


def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    dynamics: DynamicsMethod,
    method: str,
    motion: Motion,
    friction: LoadFriction,
    *,
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    stiffness: Stiffness | None = None,
    progress: Progress | None = None,
    examine: Callable[[InverseDynamics], tuple[str, ...]] | None = None,
) -> LoadFrictionEffect:
    """Return the forces over a motion with friction that depends on the loads of the joints."""
    from p3dof.analysis.reactions.evaluation import of_solution

    require("load_friction", friction, LoadFriction)
    states = states_over(motion, wrench, on_invalid)
    against = _way_of(method, loop, parameters, states)
    solution, crossings = without_crossings(motion, dynamics.solve(states, progress), on_invalid)

    def loaded(found: Solution, coulomb: CoulombLimits | None) -> Reactions:
        given = "elastic", states.wrench, on_invalid, stiffness, coulomb
        return of_solution(loop, parameters, motion, found, *given)  # type: ignore[arg-type,unused-ignore]

    slides = solution.joints.columns(SLIDES)
    armature = parameters.actuators.rotors
    given = _Given(friction, solution, slides.a * armature, against, loaded)
    settled, steps = _settle(given, motion)
    without, with_friction = (
        with_evidence(method, motion, one, states.wrench, crossings, examine, limits, parameters.actuators)
        for one, limits in ((solution, None), (settled.solution, settled.coulomb))
    )
    return LoadFrictionEffect(
        parameters, friction, without, with_friction, settled.reactions, settled.loads, steps
    )


def _way_of(method: str, loop: ClosedLoopModel, parameters: Parameters, states: States) -> _Against:
    """Return how a method finds what friction takes."""
    from p3dof.methods import pinocchio as pinocchio_friction

    ways: Mapping[str, _Against] = {
        "pinocchio": lambda coulomb, known: pinocchio_friction.forces_against(loop, known.joints, coulomb),
        "virtual-power": lambda coulomb, _: virtual_power.forces_against(parameters, states, coulomb),
    }
    if method not in ways:
        raise InputError(
            f"load_friction: load-dependent friction is available with {' or '.join(map(repr, ways))}, not "
            f"by {shown(method)}: kernels, generated C and simulations have only the constant Friction of "
            "the parameters"
        )
    return ways[method]


class _Given(NamedTuple):
    """What stays from step to step: contacts, forces without them, forces of the rotors, and what to ask."""

    friction: LoadFriction
    solution: Solution
    rotors: FloatArray
    against: _Against
    loaded: Callable[[Solution, CoulombLimits | None], Reactions]


class _Step(NamedTuple):
    """Forces with friction, the reactions under them, and what these load the contacts with."""

    solution: Solution
    coulomb: CoulombLimits
    reactions: Reactions
    loads: dict[str, FloatArray]


def _settle(given: _Given, motion: Motion) -> tuple[_Step, int]:
    """Return forces, friction and loads that belong together, and after how many steps they do."""
    bare, changes = given.loaded(given.solution, None), [np.inf]
    loads = loads_of(given.friction, bare)
    now = _stepped(given, loads)
    scale = _largest_forces(now.reactions)  # not of `bare`: it may be nothing where that is rounding
    while True:
        change, joint, i = _largest_change(loads, now, scale)
        loads = now.loads
        if change <= TOLERANCE:
            return now, len(changes)
        changes.append(change)
        late = len(changes) > _PATIENCE and min(changes[-_PATIENCE:]) > min(changes[:-_PATIENCE]) / 2
        if late or not change < _BEYOND:
            raise DynamicsError(
                f"load_friction: loads and friction do not converge: after {len(changes) - 1} steps the load "
                f"of {joint} at t = {motion.time[i]:.4g} s still changes by {change:.2g} of the largest. "
                "Friction that grows with itself jams the machine: is a coefficient or a radius too large?"
            )
        now = _stepped(given, loads)


def _largest_forces(reactions: Reactions) -> FloatArray:
    """Return the largest component of the reactions of each sample, (N,) [N]; never zero."""
    return np.asarray(np.maximum(np.abs(reactions.forces).max(axis=(1, 2)), np.finfo(float).tiny))


def _stepped(given: _Given, loads: dict[str, FloatArray]) -> _Step:
    """Return the forces under the friction of some loads, and the loads under these forces."""
    friction, solution = given.friction, given.solution
    coulomb = limits_of(friction, loads)
    more, lost = given.against(coulomb, solution)
    if friction.screws:
        coulomb = with_screws(friction, coulomb, solution.forces + more - given.rotors)
        more, lost = given.against(coulomb, solution)
    found = replace(solution, forces=solution.forces + more, dissipation=solution.dissipation + lost)
    reactions = given.loaded(found, coulomb)
    return _Step(found, coulomb, reactions, loads_of(friction, reactions))


def _largest_change(former: dict[str, FloatArray], now: _Step, scale: FloatArray) -> tuple[float, str, int]:
    """Return the largest change of a load as a share of the largest force of its sample, and where it is."""
    worst = (0.0, "", 0)
    for name, latter in now.loads.items():
        change = np.abs(latter - former[name]).max(axis=1) / scale
        change[~now.reactions.valid] = 0.0
        if not change.max() <= worst[0]:
            worst = (float(change.max()), name, int(np.argmax(change)))
    return worst
