"""Where idle freedoms rest while the actuated joints are held."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import AssemblyError, DynamicsError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.linear import Decomposition

_AT_REST, _NEARLY = 1e-9, 1e-7
"""Acceleration of what is at rest, and of what is as good as rounding allows [m/s² or rad/s²]."""
_MOST, _LONGEST, _SHORTEST = 200, 0.3, 1e-10
"""Steps before it is given up, and longest and shortest of them [m or rad]."""
_NEARBY, _FLAT = 1e-6, 1e-8
"""Step of differences [m or rad], and share of the largest stiffness below which a direction is flat."""


def find_equilibrium(loop: ClosedLoopModel, values: ArrayLike, guess: ArrayLike | None = None) -> FloatArray:
    """Return where idle freedoms are at rest under gravity and springs, the actuated joints being held.

    It goes downhill from the guess: what it finds is stable, unless the guess is an equilibrium itself.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    values : (n_actuated,) array
        Of the actuated joints [m or rad].
    guess : (nq,) array, optional
        Where to start; by default the reference configuration.

    Returns
    -------
    (nq,) array

    Raises
    ------
    AssemblyError
        If the loops do not close at these values.
    DynamicsError
        If there is no equilibrium within reach, such as of a body that falls freely.
    SingularityError, InputError
        As `ClosedLoopModel.hybrid_dynamics`, `ClosedLoopModel.assemble`.
    """
    values = frozen_array("values", values, (len(loop.actuated),))
    q = np.array(loop.assemble(values, guess).q)
    reach = _LONGEST
    pull, (energy, size) = _pull(loop, q), _energy(loop, q)
    scale = max(1.0, pull.rest)  # small robots are faster
    for _ in range(_MOST):
        if pull.rest <= _AT_REST * scale:
            return q
        step = pull.step(reach)
        try:
            there = np.array(loop.assemble(values, pin.integrate(loop.model, q, step)).q)
            found, (height, _) = _pull(loop, there), _energy(loop, there)
        except AssemblyError:
            reach /= 4
            continue
        rounding = 1e-13 * size
        if height < energy - rounding or (height <= energy + rounding and found.rest < pull.rest):
            q, pull, energy, reach = there, found, height, min(2 * reach, _LONGEST)
        else:
            reach = min(reach, float(np.linalg.norm(step))) / 4
        if reach < _SHORTEST:
            break
    if pull.rest <= _NEARLY * scale:
        return q
    raise DynamicsError(
        f"no equilibrium of the idle freedoms was found: at best they accelerate by {pull.rest:.3g} m/s² or "
        "rad/s²"
    )


class _Pull:
    """What pulls at the idle freedoms of a configuration at rest.

    Parameters
    ----------
    N : (nv, k) array
        Their motions.
    force : (nv,) array
        What pulls, along them.
    rest : float
        Largest acceleration.
    loop, q
        Of what.
    """

    def __init__(
        self, N: FloatArray, force: FloatArray, rest: float, loop: ClosedLoopModel, q: FloatArray
    ) -> None:
        self.N, self.force, self.rest = N, force, rest
        self._loop, self._q = loop, q

    def step(self, longest: float) -> FloatArray:
        """Return a step (nv,) downhill: Newton's, where the energy is convex."""
        model, N = self._loop.model, self.N
        stiffness = np.array(
            [
                N.T @ (self.force - _pull(self._loop, there).force) / _NEARBY
                for there in (np.array(pin.integrate(model, self._q, _NEARBY * column)) for column in N.T)
            ]
        )
        curvature, axes = np.linalg.eigh((stiffness + stiffness.T) / 2)
        size = np.maximum(np.abs(curvature), _FLAT * np.abs(curvature).max(initial=1e-6))
        along = axes.T @ (N.T @ self.force) / size
        along = N @ (axes @ along)
        length = float(np.linalg.norm(along))
        return np.asarray(along * min(1.0, longest / length)) if length > 0 else along


def _pull(loop: ClosedLoopModel, q: FloatArray) -> _Pull:
    model, count = loop.model, len(loop.actuated)
    a = loop.hybrid_dynamics(q, np.zeros(model.nv), np.zeros(count)).a
    S = np.zeros((count, model.nv))
    S[np.arange(count), loop.actuated_v] = 1.0
    N = Decomposition.of(np.concatenate([loop.closure_jacobian(q), S]), 1e-7).null_space
    M = np.array(pin.crba(model, model.createData(), q))
    M = np.triu(M) + np.triu(M, 1).T
    return _Pull(N, N @ (N.T @ (M @ a)), float(np.abs(a).max(initial=0.0)), loop, q)


def _energy(loop: ClosedLoopModel, q: FloatArray) -> tuple[float, float]:
    """Return the potential energy, and how large its parts are [J]."""
    found = loop.body_energies(q, np.zeros(loop.model.nv))
    return float(found.total), float(np.abs(found.potential).sum() + found.springs)
