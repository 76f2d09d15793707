"""The evidence that a result carries: the power of its forces against the change of the energy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.motion import Motion
from p3dof.machine.motion.wrenches import WRENCH_ROWS
from p3dof.machine.parameters import SLIDES
from p3dof.methods.coulomb import CoulombLimits
from p3dof.methods.results import InverseDynamics
from p3dof.methods.solution import Solution


def with_evidence(
    method: str,
    motion: Motion,
    solution: Solution,
    wrench: FloatArray | None,
    crossings: FloatArray | None = None,
    examine: Callable[[InverseDynamics], tuple[str, ...]] | None = None,
    coulomb: CoulombLimits | None = None,
    armature: FloatArray | None = None,
) -> InverseDynamics:
    """Balance the power of actuators and wrench with the losses and the rate of change of the energy.

    Parameters
    ----------
    method : str
        How the solution was found.
    motion : Motion
        The motion of the platform.
    solution : Solution
        Forces and joints over it, and the power that the bodies take up.
    wrench : ndarray, shape (N, 6), optional
        External force and moment on the platform at P [N, N m].
    crossings : ndarray, shape (K,), optional
        Times of the samples after which the motion crosses a singularity [s]; none by default.
    examine : callable, optional
        Finds the warnings of the result.
    coulomb : CoulombLimits, optional
        Friction that depends on loads, where the solution has any.
    armature : ndarray, shape (3,), optional
        Inertia of motors and screws reflected to the sliders [kg]; none by default.

    Returns
    -------
    InverseDynamics
    """
    speeds = solution.joints.columns(SLIDES).v
    power = np.sum(solution.forces * speeds, axis=-1)
    loads = np.zeros((len(motion), 6)) if wrench is None else wrench
    given = power + np.sum(loads[:, WRENCH_ROWS] * motion.velocity, axis=-1)
    return InverseDynamics(
        method,
        motion,
        solution.forces,
        solution.joints,
        solution.closure_error,
        loads,
        power,
        given - solution.dissipation - solution.energy_rate,
        solution.dissipation,
        solution.actuation,
        np.zeros(0) if crossings is None else crossings,
        examine,
        coulomb,
        np.zeros(3) if armature is None else armature,
    )
