"""The machine of a design as a closed-loop model on Pinocchio."""

from __future__ import annotations

from p3dof.loops import ClosedLoopModel
from p3dof.machine import description
from p3dof.machine.parameters import Parameters
from p3dof.methods.pinocchio_balance import armature_of


def loop_of(machine: Parameters) -> ClosedLoopModel:
    """Return the mechanism of a machine as a general closed-loop model.

    Parameters
    ----------
    machine : Parameters
        The machine.

    Returns
    -------
    ClosedLoopModel
    """
    mechanism = description.describe(machine)
    urdf = description.urdf(mechanism)
    sidecar = description.sidecar(mechanism.without_balance())  # the method adds it itself
    loop = ClosedLoopModel.from_urdf(urdf, sidecar, mimic=False)
    loop.model.gravity.linear = machine.gravity  # a URDF has no place for it
    loop.model.armature = armature_of(loop.model, machine.actuators)  # nor for this
    return loop
