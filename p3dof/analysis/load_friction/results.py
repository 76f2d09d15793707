"""What friction that depends on loads adds to the forces over a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray
from p3dof._base.tables import ShownInNotebook, Table, html_of, notebook_html, number, table_of
from p3dof.analysis.load_friction.contacts import LoadFriction
from p3dof.analysis.reactions import Reactions
from p3dof.closed_form import kinematics
from p3dof.closed_form.paper.formulas import velocities
from p3dof.closed_form.paper.friction import joint_rates
from p3dof.machine.motion import states_over
from p3dof.machine.parameters import LEGS, SLIDES, Parameters
from p3dof.methods import CoulombLimits, InverseDynamics


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
