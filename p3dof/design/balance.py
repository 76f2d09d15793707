"""The counterbalance of each slider that leaves its actuator the least to do over a motion or a task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.checks import FloatArray, require, shown
from p3dof._base.errors import InputError, SampleError
from p3dof._base.tables import NONE, Table, number
from p3dof.design.forces_of_tasks import TaskForces, forces_of_task
from p3dof.design.tasks import Plan
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, SLIDES, Actuators, Parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics

BalanceKind: TypeAlias = Literal["constant", "spring", "counterweight"]
"""Kinds of counterbalance: a constant force, a spring with a force at home, or a mass over a pulley."""
BALANCE_KINDS: tuple[BalanceKind, ...] = get_args(BalanceKind)
Objective: TypeAlias = Literal["rms", "peak"]
"""What is to be least: the root mean square of each force, or its largest magnitude."""
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)

_STILL = 1e-9  # a slider that moves less than that does not tell a spring from a constant force [m]
_NUMBERS = {
    "constant": ("counterbalance",),
    "spring": ("counterbalance", "spring"),
    "counterweight": ("counterweight",),
}
_UNITS = {"counterbalance": "N", "spring": "N/m", "counterweight": "kg"}


@dataclass(frozen=True, eq=False)
class BestBalance:
    """The best counterbalance of one kind.

    Parameters
    ----------
    kind : {"constant", "spring", "counterweight"}
        The kind of counterbalance.
    objective : {"rms", "peak"}
        What is least.
    parameters : Parameters
        The machine with it; what it carries on the way is not in it.
    time : ndarray, shape (N,)
        Times of the samples [s].
    before, after : ndarray, shape (N, 3)
        Forces of the actuators A, B, C without a counterbalance of this kind, and with the best one [N].
    rms_before, rms_after : ndarray, shape (3,)
        Root mean square of these forces over time, dwells included [N].
    notes : tuple of str
        What has to be known of it: springs of negative stiffness, counterweights that do not help.
    """

    kind: BalanceKind
    objective: Objective
    parameters: Parameters
    time: FloatArray
    before: FloatArray
    after: FloatArray
    rms_before: FloatArray
    rms_after: FloatArray
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        values = "; ".join(f"{name} {row.tolist()}" for name, row in self.values.items())
        return f"BestBalance({self.kind}, {self.objective}: {values})"

    @property
    def actuators(self) -> Actuators:
        """What motors and counterbalances of the machine then are."""
        return self.parameters.actuators

    @property
    def values(self) -> dict[str, FloatArray]:
        """What was chosen, by name of the parameter: for A, B, C, (3,) [N, N/m or kg]."""
        return {name: _row(self.actuators, name) for name in _NUMBERS[self.kind]}

    @property
    def named_values(self) -> list[tuple[str, str, FloatArray]]:
        """What was chosen: names of the parameters, their units, and for A, B, C (3,)."""
        return [(name, _UNITS[name], row) for name, row in self.values.items()]

    @property
    def peak_before(self) -> FloatArray:
        """Largest magnitudes of the forces without it, shape (3,) [N]."""
        return np.asarray(np.abs(self.before).max(axis=0))

    @property
    def peak_after(self) -> FloatArray:
        """Largest magnitudes of the forces with it, shape (3,) [N]."""
        return np.asarray(np.abs(self.after).max(axis=0))


def best_balance(
    robot: Manipulator,
    found: InverseDynamics | TaskForces | Motion | Plan,
    kind: BalanceKind = "constant",
    objective: Objective = "rms",
) -> BestBalance:
    """Return the counterbalance of each slider with which its actuator has the least to do.

    A counterbalance changes the forces linearly, and each only that of its own actuator: a constant force c
    by -c, a spring of stiffness k by k λ, a counterweight m by m (λ̈ + g_z), its own inertia included. So the
    best one is found exactly: by least squares over time, or by a linear program for the peak. What the
    machine has of the same kind already is replaced; its armature and its other counterbalances stay.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    found : InverseDynamics, TaskForces, Motion or Plan
        Its forces over a motion, or over a task with its dwells and payloads; or what it has to do.
    kind : {"constant", "spring", "counterweight"}
        The kind of counterbalance.
    objective : {"rms", "peak"}
        What is to be least: the root mean square over time, or the largest magnitude.

    Raises
    ------
    InputError
        If an argument is something else, or the forces are those of another machine.
    SampleError
        If the machine cannot perform the motion; `ReachError` or `SingularityError` if `found` is a motion.
    """
    found = _forces(robot, found)
    for name, value, known in (("kind", kind, BALANCE_KINDS), ("objective", objective, OBJECTIVES)):
        if value not in known:
            raise InputError(f"{name}: expected one of {', '.join(known)}, got {shown(value)}")
    own, gravity = robot.parameters.actuators, float(robot.parameters.gravity[2])
    parts = found.results if isinstance(found, TaskForces) else (found,)
    sliders = np.concatenate([part.sliders for part in parts])
    lifting = found.slider_accelerations + gravity
    before = found.forces + _row(own, "counterbalance") * ("counterbalance" in _NUMBERS[kind])
    if kind == "spring":
        before = before - _row(own, "spring") * sliders
    elif kind == "counterweight":
        before = before - _row(own, "counterweight") * lifting
    weights = np.concatenate([_weights(part.time) for part in parts])
    chosen = {name: np.zeros(3) for name in _NUMBERS[kind]}
    after = np.empty_like(before)
    for leg in range(3):
        shapes = _shapes(kind, sliders[:, leg], lifting[:, leg])
        if objective == "rms":
            share = _least_squares(before[:, leg], shapes, weights)
        else:
            share = _least_peak(before[:, leg], shapes, positive=kind == "counterweight")
        if kind == "counterweight":
            share = np.maximum(share, 0.0)
        after[:, leg] = before[:, leg] + shapes @ share
        for name, value in zip(chosen, share, strict=False):
            chosen[name][leg] = -value if name == "counterbalance" else value
    fields = {name: dict(zip(SLIDES, row.tolist(), strict=True)) for name, row in chosen.items()}
    with_it = replace(robot.parameters, actuators=replace(own, **fields))
    rms = [np.sqrt(weights @ forces**2 / weights.sum()) for forces in (before, after)]
    notes = tuple(_notes(kind, chosen))
    return BestBalance(kind, objective, with_it, found.time, before, after, rms[0], rms[1], notes)


def _forces(
    robot: Manipulator, found: InverseDynamics | TaskForces | Motion | Plan
) -> InverseDynamics | TaskForces:
    """Return forces over a motion or a task, checked."""
    require("robot", robot, Manipulator)
    if isinstance(found, Motion):
        found = robot.inverse_dynamics(found, method="compiled")
    elif isinstance(found, Plan):
        found = forces_of_task(robot, found)
    if not isinstance(found, InverseDynamics | TaskForces):
        raise InputError(f"found: expected forces over a motion or a task, got {shown(found)}")
    if not found.possible:
        raise SampleError("the machine cannot perform this motion: there is nothing to counterbalance")
    return found


def _row(actuators: Actuators, name: str) -> FloatArray:
    by_slide = getattr(actuators, name)
    return np.array([by_slide.get(slide, 0.0) for slide in SLIDES])


def _weights(time: FloatArray) -> FloatArray:
    """Return the weights of trapezoids over time, (N,)."""
    step = np.diff(time)
    found: FloatArray = (np.append(step, 0.0) + np.append(0.0, step)) / 2
    return found if len(time) > 1 else np.ones(1)


def _shapes(kind: BalanceKind, slider: FloatArray, lifting: FloatArray) -> FloatArray:
    """Return what a unit of each number adds to a force, (N, 1 or 2)."""
    if kind == "counterweight":
        return lifting[:, None]
    constant = np.ones((len(slider), 1))
    if kind == "constant" or np.ptp(slider) < _STILL:
        return constant
    return np.column_stack([constant, slider])


def _least_squares(force: FloatArray, shapes: FloatArray, weights: FloatArray) -> FloatArray:
    """Return shares of the shapes that leave the least mean square of a force."""
    root = np.sqrt(weights)[:, None]
    size = np.linalg.norm(root * shapes, axis=0)
    found = np.linalg.lstsq(root * shapes / size, -root[:, 0] * force, rcond=None)[0]
    return np.asarray(found / size)


def _least_peak(force: FloatArray, shapes: FloatArray, positive: bool) -> FloatArray:
    """Return shares of the shapes that leave the least peak of a force."""
    from scipy.optimize import linprog

    size, most = np.abs(shapes).max(axis=0), max(float(np.abs(force).max()), 1e-300)
    scaled, given = shapes / size, force / most
    rows = np.block([[scaled, -np.ones((len(force), 1))], [-scaled, -np.ones((len(force), 1))]])
    bounds = [(0.0 if positive else None, None)] * shapes.shape[1] + [(0.0, None)]
    cost = np.append(np.zeros(shapes.shape[1]), 1.0)
    solved = linprog(cost, A_ub=rows, b_ub=np.append(-given, given), bounds=bounds, method="highs")
    return np.asarray(solved.x[:-1] * most / size)


def _notes(kind: BalanceKind, chosen: Mapping[str, FloatArray]) -> Iterator[str]:
    """Say what has to be known of a counterbalance."""
    if kind == "spring":
        for leg, stiffness in zip(LEGS, chosen["spring"], strict=True):
            if stiffness < 0:
                yield (
                    f"{leg}: a negative stiffness, {number(stiffness)} N/m: the force has to grow as the "
                    "slider rises, which no plain spring does; a plain one is worse than a constant force"
                )
    if kind == "counterweight":
        none = [leg for leg, mass in zip(LEGS, chosen["counterweight"], strict=True) if mass == 0]
        if none:
            legs = ", ".join(none)
            yield f"{legs}: no counterweight helps: its inertia needs more force than its weight saves"


def balance_table(found: BestBalance) -> Table:
    """Return a counterbalance, and what it spares."""
    values = found.named_values
    header = (
        "actuator",
        *(f"{name} [{unit}]" for name, unit, _ in values),
        "RMS without [N]",
        "RMS with it [N]",
        "peak without [N]",
        "peak with it [N]",
    )
    rows = []
    for k, leg in enumerate(LEGS):
        chosen = [NONE if not row[k] else number(row[k]) for _, _, row in values]
        forces = (found.rms_before, found.rms_after, found.peak_before, found.peak_after)
        rows.append((leg, *chosen, *(number(row[k]) for row in forces)))
    least = "root mean square" if found.objective == "rms" else "peak"
    words = {
        "constant": "Constant force on each slider",
        "spring": "Spring with a force at home on each slider",
        "counterweight": "Counterweight of each slider, its own inertia counted",
    }
    return Table(f"{words[found.kind]}, for the least {least}", header, tuple(rows), ". ".join(found.notes))
