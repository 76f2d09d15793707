"""How the actuator forces depend on the parameters: the regressor, its base parameters, lengths, gravity.

Less what friction takes and without external loads, the forces are linear in the inertial parameters of the
bodies, and 21 combinations of these 100 are all that forces can tell; see
`p3dof.closed_form.compiled.reduced`. They are linear in nine numbers of motors, screws and counterbalances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from p3dof._base.algebra import BLOCK
from p3dof._base.checks import FloatArray, Readable
from p3dof._base.tracing import Number, Symbol, Tape, derivatives, straight_line
from p3dof._base.tracing.printing import function_of
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.kernels import loss_by_lengths
from p3dof.closed_form.compiled.reduced import (
    Actuated,
    Model,
    Moments,
    Reduced,
    State,
    actuator_forces,
    fold_moments,
    model_of,
    shape,
)
from p3dof.closed_form.kinematics import holdable
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import LINKS, SLIDES, Bodies, Parameters

MOMENTS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Inertial parameters of a body, about the origin of its axes, in the order of Pinocchio's."""

INERTIAL = tuple(f"{link}.{name}" for link in LINKS for name in MOMENTS)
"""The 100 inertial parameters of the machine."""

BASE = Reduced._fields
"""The 21 base inertial parameters."""

ACTUATED = Actuated._fields
"""Reflected inertia, counterbalance at home and stiffness at each slider, counterweights in the first two."""

LENGTHS = ("r", "R", "L")
"""The lengths that the forces depend on."""


@dataclass(frozen=True, eq=False)
class ForceRegressor(Readable):
    """Derivatives of the actuator forces by the parameters; exact, without external loads.

    Parameters
    ----------
    base : ndarray, shape (..., 3, 21)
        ∂f/∂π by the base inertial parameters, named in `BASE`; f = base @ base_parameters + actuators @
        actuator_parameters + friction.
    base_parameters : ndarray, shape (21,)
        π of the machine.
    base_matrix : ndarray, shape (21, 100)
        ∂π/∂φ by the inertial parameters of the bodies, named in `INERTIAL`: masses [kg], first moments
        [kg m] and inertias about the origin of the body's axes [kg m²].
    by_lengths : ndarray, shape (..., 3, 3)
        By r, R and L with every body kept as it is in its own axes, friction included [N/m].
    by_gravity : ndarray, shape (..., 3, 3)
        By the acceleration of gravity [N s²/m].
    actuators : ndarray, shape (..., 3, 9)
        ∂f/∂ψ by reflected inertia, counterbalance at home and stiffness of each slider, named in `ACTUATED`:
        the acceleration of the slider, -1, and its position. With gravity known, forces tell an armature from
        the mass of a slider only by its weight, which a counterbalance may bear.
    actuator_parameters : ndarray, shape (9,)
        ψ of the machine: armatures and counterweights together [kg]; forces of counterbalances and
        counterweights at home [N]; [N/m].
    friction : ndarray, shape (..., 3)
        The part of the forces that works against friction, which no inertial parameter changes [N]; zero
        without friction.
    """

    base: FloatArray
    base_parameters: FloatArray
    base_matrix: FloatArray
    by_lengths: FloatArray
    by_gravity: FloatArray
    actuators: FloatArray
    actuator_parameters: FloatArray
    friction: FloatArray

    base_names = BASE
    """Names of the 21 base inertial parameters."""
    inertial_names = INERTIAL
    """Names of the 100 inertial parameters of the bodies."""
    actuator_names = ACTUATED
    """Names of the nine numbers of the actuators."""

    @property
    def inertial(self) -> FloatArray:
        """∂f/∂φ by the 100 inertial parameters of the bodies, (..., 3, 100)."""
        return self.base @ self.base_matrix


def inertial_parameters(bodies: Bodies) -> FloatArray:
    """Return the 100 inertial parameters φ of the bodies, in the order of `INERTIAL`."""
    rows = []
    for _, body in tuple(bodies.items()):
        I = body.inertia_about(np.zeros(3))  # noqa: E741 - the inertia
        six = (I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2])
        rows.append([body.mass, *(body.mass * body.com), *six])
    return np.array(rows, dtype=float).ravel()


def force_regressor(parameters: Parameters, states: States) -> ForceRegressor:
    """Return how the forces at states depend on the parameters."""
    rows, leading = holdable(parameters.geometry, states).states.rows(), states.shape
    q, v, a = rows.pose, rows.velocity, rows.acceleration
    columns = (q[:, 0], q[:, 2], v[:, 0], v[:, 2], a[:, 0], a[:, 1], a[:, 2], q[:, 1])
    model = model_of(parameters)
    found = np.empty((3 * len(MODEL), len(q)))
    function = _by_model()
    for start in range(0, len(q), BLOCK):
        block = slice(start, start + BLOCK)
        with np.errstate(all="ignore"):  # what overflows is told below
            values = function(*(float(x) for x in model.numbers), *(column[block] for column in columns))
        for row, value in zip(found, values, strict=True):
            row[block] = value
    by: FloatArray = found.reshape(3, len(MODEL), -1).transpose(2, 0, 1)  # (N, 3, 36)
    by[~np.isfinite(q).all(axis=1)] = np.nan
    by = by.reshape(*leading, 3, len(MODEL))
    if states.on_invalid == "raise":
        states.raise_overflow("regressor", by.sum(axis=-1))
    base = np.ascontiguousarray(by[..., 6 : 6 + len(BASE)])
    actuators = np.ascontiguousarray(by[..., 6 + len(BASE) :])
    lost, lost_by_lengths = np.zeros((*leading, 3)), np.zeros((*leading, 3, 3))
    lost[np.isnan(q).any(axis=-1).reshape(leading)] = np.nan
    if parameters.friction:
        found_lost, found_by_lengths = loss_by_lengths(parameters, q, v)
        lost, lost_by_lengths = (
            found_lost.reshape(lost.shape),
            found_by_lengths.reshape(lost_by_lengths.shape),
        )
    matrix, by_length = _fold_derivatives(parameters)
    return ForceRegressor(
        base=base,
        base_parameters=np.array([float(x) for x in model.bodies]),
        base_matrix=matrix,
        by_lengths=by[..., :3] + base @ by_length + lost_by_lengths,
        by_gravity=by[..., 3:6] + actuators @ _counterweights(parameters),
        actuators=actuators,
        actuator_parameters=np.array([float(x) for x in model.actuators]),
        friction=lost,
    )


@cache
def _by_model() -> Callable[..., tuple[Any, ...]]:
    """Return ∂f/∂(numbers of the model), 108 rows, as a function of these numbers and of the state."""

    def formula(tape: Tape, *symbols: Symbol) -> list[Number]:
        numbers, state = symbols[: len(MODEL)], State(*symbols[len(MODEL) :])
        model = Model.of_numbers(numbers)
        forces = actuator_forces(model, shape(model, state.y, state.theta, tape), state, tape)
        return [entry for row in derivatives(forces, numbers) for entry in row]

    return straight_line(formula, len(MODEL) + len(State._fields), np)


def _counterweights(parameters: Parameters) -> FloatArray:
    """Return ∂ψ/∂g (9, 3): gravity along z0 pulls at counterweights."""
    found = np.zeros((len(ACTUATED), 3))
    for row, slide in enumerate(SLIDES, ACTUATED.index("balance_a")):
        found[row, 2] = -parameters.actuators.counterweight.get(slide, 0.0)
    return found


def _fold_derivatives(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """Return ∂π/∂φ (21, 100) and ∂π/∂(r, R, L) (21, 3)."""
    geometry = parameters.geometry
    given = (geometry.r, geometry.R, geometry.L, *inertial_parameters(parameters.bodies).tolist())
    found = np.array(_fold()(*given)).reshape(len(BASE), 3 + len(INERTIAL))
    return found[:, 3:], found[:, :3]


@cache
def _fold() -> Callable[..., tuple[float, ...]]:
    tape = Tape()
    r, R, L = tape.symbols(LENGTHS)
    symbols = tape.symbols(INERTIAL)
    lengths = Lengths(r, R, L, 0, tape.sqrt((L - (R - r)) * (L + (R - r))))
    bodies = {link: _body(symbols[len(MOMENTS) * i : len(MOMENTS) * (i + 1)]) for i, link in enumerate(LINKS)}
    folded = fold_moments(lengths, bodies)
    rows = derivatives(folded, (r, R, L, *symbols))
    return function_of(tape, (r, R, L, *symbols), [entry for row in rows for entry in row])


def _body(phi: tuple[Symbol, ...]) -> Moments:
    m, mx, my, mz, xx, xy, yy, xz, yz, zz = phi
    return Moments(m, (mx, my, mz), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
