"""Friction and the reactions that it depends on, found together: a fixed point over all samples at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, Progress, require, shown
from p3dof._base.errors import DynamicsError, InputError
from p3dof._base.samples import OnInvalid
from p3dof.analysis.load_friction.contacts import LoadFriction, limits_of, loads_of, with_screws
from p3dof.analysis.load_friction.results import LoadFrictionEffect
from p3dof.analysis.reactions import Reactions, Stiffness, of_solution
from p3dof.loops import ClosedLoopModel
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import SLIDES, Parameters
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
