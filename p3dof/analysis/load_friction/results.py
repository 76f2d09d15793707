"""What friction that depends on loads adds to the forces over a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray
from p3dof._base.tables import ShownInNotebook
from p3dof.analysis.load_friction.contacts import LoadFriction
from p3dof.analysis.reactions import Reactions
from p3dof.closed_form import kinematics
from p3dof.closed_form.paper.formulas import velocities
from p3dof.closed_form.paper.friction import joint_rates
from p3dof.machine.motion import states_over
from p3dof.machine.parameters import SLIDES, Parameters
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
