"""Energy, momentum and work over a motion whose forces are known."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.energy.bodies import bodies_of, quantities
from p3dof.analysis.energy.results import DriveLoads, Energy
from p3dof.analysis.energy.work import work_over
from p3dof.machine.motion.wrenches import WRENCH_ROWS
from p3dof.machine.parameters import Parameters
from p3dof.methods import InverseDynamics

_SAME_MACHINE = 1e-6
"""Share of a leg's length by which sliders of a result may differ from those of the machine."""

_BLOCK = 10_000
"""Samples whose energies are held at a time."""

_ROUNDING = 1e-9
"""Share of the whole energy below which nothing moves."""


def energy_of(parameters: Parameters, result: InverseDynamics) -> Energy:
    """Return energy, momentum and work over a motion whose forces are known.

    Parameters
    ----------
    parameters : Parameters
        The machine that the result belongs to.
    result : InverseDynamics
        The forces of the actuators, by either method.

    Returns
    -------
    Energy

    Raises
    ------
    InputError
        If an argument is something else, or the result is that of a machine of another geometry.
    """
    if not isinstance(result, InverseDynamics):
        raise InputError(f"result: expected InverseDynamics, got {shown(result)}")
    pose = np.where(result.valid[:, None], result.motion.pose, np.nan)
    found = quantities(parameters, pose, result.motion.velocity, "nan")
    _check_machine(parameters, result, found.sliders)
    rates = _rates(result)
    total = np.sum(found.kinetic + found.potential, axis=-1)
    work, balance, given = work_over(result, rates, total)
    return Energy(
        time=result.time,
        bodies=bodies_of(parameters),
        kinetic=found.kinetic,
        potential=found.potential,
        momentum=found.momentum,
        angular_momentum=found.angular_momentum,
        power=rates[:, :3],
        work=work[:, :3],
        wrench_power=rates[:, 3],
        wrench_work=work[:, 3],
        dissipated_power=rates[:, 4],
        dissipated_work=work[:, 4],
        balance=balance,
        drives=_drive_loads(result, rates[:, :3], work[:, :3], given),
    )


def imbalance(parameters: Parameters, result: InverseDynamics) -> tuple[float, float]:
    """Return by how much the work over a motion misses the change of the energy, and what that is small to.

    Parameters
    ----------
    parameters : Parameters
        The machine that the result belongs to.
    result : InverseDynamics
        The forces of the actuators, valid in all samples; two at least.

    Returns
    -------
    missed : float
        Largest magnitude of `Energy.balance` [J]; zero where it is rounding.
    scale : float
        `Energy.scale` [J].
    """
    pose, velocity = result.motion.pose, result.motion.velocity
    energies = np.concatenate(
        [
            [found.kinetic.sum(axis=-1), found.potential.sum(axis=-1)]
            for start in range(0, len(pose), _BLOCK)
            for found in [quantities(parameters, pose[start:][:_BLOCK], velocity[start:][:_BLOCK], "nan")]
        ],
        axis=1,
    )
    total = energies.sum(axis=0)
    _, balance, _ = work_over(result, _rates(result), total)
    missed = float(np.abs(balance).max())
    rounding = _ROUNDING * float(np.abs(total).max())
    scale = float(max(energies[0].max(), np.ptp(total)))
    return (missed if missed > rounding else 0.0), scale


def _check_machine(parameters: Parameters, result: InverseDynamics, sliders: FloatArray) -> None:
    apart = np.abs(result.sliders - sliders)[result.valid]
    if not np.all(apart <= _SAME_MACHINE * parameters.geometry.L):  # NaN: out of reach of this machine
        raise InputError(
            "result: expected one of a machine with these parameters, got sliders where this machine has none"
        )


def _rates(result: InverseDynamics) -> FloatArray:
    """Return the powers of the actuators and of the wrench, and what friction takes, (N, 5) [W]."""
    power = result.forces * result.slider_velocities
    wrench_power = np.sum(result.wrench[:, WRENCH_ROWS] * result.motion.velocity, axis=-1)
    rates = np.column_stack([power, wrench_power, result.dissipation])
    return np.where(result.valid[:, None], rates, np.nan)


def _drive_loads(
    result: InverseDynamics, power: FloatArray, work: FloatArray, given: FloatArray
) -> DriveLoads:
    if not result.possible:
        nothing = np.full(3, np.nan)
        return DriveLoads(*(nothing for _ in fields(DriveLoads)))
    net, duration = work[-1], result.motion.duration
    return DriveLoads(
        peak_force=result.peak_forces,
        rms_force=result.rms_forces,
        peak_speed=np.abs(result.slider_velocities).max(axis=0),
        peak_power=np.maximum(power.max(axis=0), 0.0),
        peak_braking=np.maximum(-power.min(axis=0), 0.0),
        mean_power=net / duration if duration > 0 else power.mean(axis=0),
        positive_work=given,
        negative_work=np.minimum(net - given, 0.0),
    )
