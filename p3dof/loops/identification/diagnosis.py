"""What may be wrong with a log, by the robot's model: columns, signs, units, limits, excitation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof.loops.identification.forces import IdentifiableForces, Rows, States

_BAD = 0.3
"""Share of the forces that the model leaves, from which something may be wrong with the columns."""
_BETTER = 0.5
"""By what another reading of the columns is better at least."""
_NOISE, _OFFSET = 0.1, 0.1
"""Of forces, for these comparisons: shares of their variation."""
_SURE = 0.05
"""Share that another reading leaves, below which no further one is tried."""
_SCALE = 100.0
"""Ratio of measured forces to the design's from which their unit is asked about."""
_NOT_NEGATIVE = ("damping", "friction", "armature")
_ROUNDS = 3
_SAMPLES = 150
_TURN, _ANGLE = np.pi / 180, 3 * np.pi

Motion = tuple[FloatArray, FloatArray, FloatArray]


class Reading(NamedTuple):
    """Another reading of the columns."""

    words: str
    of: Callable[[FloatArray], FloatArray]  # columns (N, m) as they would be then


def readings(names: tuple[str, ...], what: str, kinds: tuple[str, ...]) -> Iterator[Reading]:
    """Yield what may have happened to columns (N, m): exchanged, turned round, in other units."""

    def exchanged(i: int, j: int) -> Callable[[FloatArray], FloatArray]:
        order = list(range(len(names)))
        order[i], order[j] = j, i
        return lambda x: x[:, order]

    def times(factors: FloatArray) -> Callable[[FloatArray], FloatArray]:
        return lambda x: x * factors

    each = np.eye(len(names))
    for i, name in enumerate(names):
        yield Reading(f"the {what} of {name} has the other sign", times(1 - 2 * each[i]))
    if len(names) > 1:
        yield Reading(f"all {what}s have the other sign", times(np.full(len(names), -1.0)))
    for i, j in combinations(range(len(names)), 2):
        yield Reading(f"the {what}s of {names[i]} and {names[j]} are exchanged", exchanged(i, j))
    scales = [(1e-3, "1000 times too large (mm or N mm?)"), (1e3, "1000 times too small (kN?)")]
    if "rad" in kinds:
        scales = [(_TURN, "in degrees"), (1 / _TURN, "in rad where they were given as degrees")]
    for factor, words in scales:
        yield Reading(f"all {what}s are {words}", times(np.full(len(names), factor)))
        if len(names) > 1:
            for i, name in enumerate(names):
                yield Reading(f"the {what} of {name} is {words}", times(1 + (factor - 1) * each[i]))


def left_over(forces: IdentifiableForces, rows: Rows, prior: FloatArray, measured: FloatArray) -> float:
    """Return how badly the model explains forces, as a share of their variation.

    All parameters are free within the prior, which counts too; friction and rotors are not negative.
    """
    size, m = np.maximum(measured.std(axis=0), 1e-300), measured.shape[1]
    shift = np.broadcast_to(np.diag(_OFFSET * size), (len(measured), m, m))
    own = np.concatenate([rows.columns * prior, shift], axis=-1) / (_NOISE * size[:, None])
    A = own.reshape(-1, own.shape[-1])
    r = ((measured - rows.columns @ forces.design - rows.known) / (_NOISE * size)).ravel()
    least = np.full(A.shape[1], -np.inf)
    for k, name in enumerate(forces.names):
        if prior[k] > 0 and name.rpartition(".")[2] in _NOT_NEGATIVE:
            least[k] = -forces.design[k] / prior[k]
    z, free = np.zeros(A.shape[1]), np.append(prior > 0, np.ones(m, dtype=bool))
    for _ in range(_ROUNDS):
        F = A[:, free]
        z[free] = np.linalg.solve(F.T @ F + np.eye(F.shape[1]), F.T @ (r - A[:, ~free] @ z[~free]))
        below = z < least
        if not below.any():
            break
        z[below], free = least[below], free & ~below
    left = r - A @ z
    return _NOISE * float(np.sqrt((left @ left + z @ z) / len(r)))


def wrong_columns(
    forces: IdentifiableForces, motion: Motion, measured: FloatArray, prior: FloatArray, failed: str = ""
) -> str:
    """Return in words what explains the forces far better than the columns as they are; empty if nothing.

    Parameters
    ----------
    motion : tuple of (N, m) array
        Positions, velocities and accelerations, as measured.
    measured : (N, m) array
        Forces.
    failed : str
        Why the robot cannot move so, if it cannot.
    """
    some = np.unique(np.linspace(0, len(measured) - 1, min(len(measured), _SAMPLES)).astype(int))
    x, v, a = (part[some] for part in motion)
    y = measured[some]
    now = np.inf
    if not failed:
        rows = forces.rows(forces.from_actuators(x, v, a))
        now = left_over(forces, rows, prior, y)
        own = (rows.columns @ forces.design + rows.known).std(axis=0)
        alike = (own > y.std(axis=0) / _SCALE).any() and (own < y.std(axis=0) * _SCALE).any()
        if now < _BAD and alike:
            return ""
        found = [
            (left_over(forces, rows, prior, one.of(y)), one.words)
            for one in readings(forces.actuators, "force", forces.force_units)
        ]
        if min(found)[0] < _SURE:
            return _told(*min(found), now)
    else:
        found = []
    for one in readings(forces.actuators, "position", forces.position_units):
        if beyond_a_turn(forces, one.of(x)):
            continue
        try:  # at one sample first: what cannot be takes long
            forces.from_actuators(*(one.of(part[len(y) // 2 :][:1]) for part in (x, v, a)))
            rows = forces.rows(forces.from_actuators(*(one.of(part) for part in (x, v, a))))
        except (P3dofError, np.linalg.LinAlgError, ValueError, FloatingPointError):
            continue
        if np.isfinite(rows.columns).all():
            found.append((left_over(forces, rows, prior, y), one.words))
    best = min(found, default=(np.inf, ""))
    return _told(*best, now) if best[0] < _BETTER * min(now, 1.0) else ""


def beyond_a_turn(forces: IdentifiableForces, positions: FloatArray) -> bool:
    """Return whether angles (N, m) are beyond a turn and a half: in another unit, it seems."""
    angles = np.array([unit == "rad" for unit in forces.position_units])
    return bool((np.abs(positions[:, angles]) > _ANGLE).any())


def _told(share: float, words: str, now: float) -> str:
    before = "the robot cannot be there" if now == np.inf else f"the model leaves {now:.0%} of the forces"
    return f"it seems that {words}: as they are, {before}; then it leaves {share:.0%}. Correct the columns"


def beyond_limits(forces: IdentifiableForces, states: States, time: FloatArray) -> list[str]:
    """Return a line for each limit that the motion exceeds."""
    if states.whole is None:
        return []
    excess, found = forces.excess(states), []
    for k, name in enumerate(forces.limits):
        over = excess[:, k]
        if name.startswith("force of") or not over.max(initial=-1.0) > 0:
            continue  # of the design: measured ones are what they are
        at = int(np.argmax(over))
        found.append(
            f"the {name} exceeds the design's limit by {over[at]:.2g} of its size at t = {time[at]:.4g} s: "
            "look at the zero of its encoder, or correct the limit"
        )
    return found


def excitation_told(rows: Rows, prior: FloatArray, noise: FloatArray) -> list[str]:
    """Return lines if the motion shows little: few combinations of parameters, or of few samples."""
    found, m = [], len(noise)
    A = rows.columns * prior / noise[:, None]

    def combinations_in(matrix: FloatArray) -> int:
        flat = matrix.reshape(-1, matrix.shape[-1])
        return int((np.linalg.eigvalsh(flat.T @ flat) > 1).sum())

    seen, moving, samples = combinations_in(A), combinations_in(A - A.mean(axis=0)), A.shape[0] * m
    if moving <= m:
        found.append(
            f"not exciting: the motion shows only {moving} combinations of parameters better than the "
            "design knows them; move faster, and through more of the workspace"
        )
    if samples < 5 * seen:
        found.append(
            f"too short: {samples} independent forces for {seen} combinations of parameters; record a "
            "longer motion"
        )
    return found
