"""Friction and the reactions that it depends on, found together: a fixed point over all samples at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray, Progress, require, shown
from p3dof._base.errors import DynamicsError, InputError
from p3dof._base.samples import OnInvalid
from p3dof._base.tables import ShownInNotebook, Table, html_of, notebook_html, number, table_of
from p3dof.analysis.load_friction.contacts import LoadFriction, limits_of, loads_of, with_screws
from p3dof.analysis.reactions import Reactions, Stiffness, of_solution
from p3dof.closed_form import kinematics
from p3dof.closed_form.paper.formulas import velocities
from p3dof.closed_form.paper.friction import joint_rates
from p3dof.loops import ClosedLoopModel
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import LEGS, SLIDES, Parameters
from p3dof.methods import (
    CoulombLimits,
    DynamicsMethod,
    InverseDynamics,
    Solution,
    virtual_power,
    with_evidence,
    without_crossings,
)
from p3dof.methods import pinocchio as pinocchio_friction


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
        rows[name] = (number(load), f"{number(friction)} {unit}", number(work), _share(work, total))
    header = ("joint", "largest load [N]", "largest friction", "lost in the motion [J]", "share")
    note = "Load: of a hinge across its axis; of a guide |fx| + |fy| + (|mx| + |my| + |mz|) / arm."
    return table_of("Origin of load-dependent friction", header, rows, note)


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole > 0 else "–"


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
