"""What a manipulator is made of: its parameters, and the model as plain text and plain Pinocchio objects."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import pinocchio as pin

from p3dof import description
from p3dof.closed_loop import ClosedLoopModel
from p3dof.compiled import MachineKernels
from p3dof.errors import InputError
from p3dof.parameters import PAPER, Parameters, machine_html


class Machine:
    """Parameters, description and Pinocchio model of one machine.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    """

    def __init__(self, parameters: Parameters = PAPER) -> None:
        if not isinstance(parameters, Parameters):
            raise InputError(f"parameters: expected Parameters, got {type(parameters).__name__}")
        self._parameters = parameters

    @property
    def parameters(self) -> Parameters:
        """The machine; make another `Manipulator` for another one."""
        return self._parameters

    def __repr__(self) -> str:
        g = self.parameters.geometry
        mass = self.parameters.bodies.mass
        return f"{type(self).__name__}(r={g.r:g}, R={g.R:g}, L={g.L:g}, moving mass {mass:g} kg)"

    def _repr_html_(self) -> str:
        return machine_html(self.parameters, type(self).__name__)

    @cached_property
    def mechanism(self) -> description.Mechanism:
        """The neutral description: links, joints, closures, solids."""
        return description.describe(self.parameters)

    @cached_property
    def urdf(self) -> str:
        """The URDF of the tree for any reader: self-contained, primitives only, every link with a mass.

        Raises
        ------
        ModelError
            If a body is too light to give its massless neighbours a mass; `exact_urdf` is then left.
        """
        return description.urdf(description.with_masses(self.mechanism))

    @cached_property
    def exact_urdf(self) -> str:
        """The URDF of the tree with the bodies just as the parameters have them, massless ones included."""
        return description.urdf(self.mechanism)

    @cached_property
    def sidecar(self) -> str:
        """The loop closures and actuated joints that belong to the URDF, as YAML."""
        return description.sidecar(self.mechanism)

    @cached_property
    def kernels(self) -> MachineKernels:
        """The compiled kernels of the machine (or what stands in for them), for any number of threads."""
        return MachineKernels(self.parameters)

    @cached_property
    def loop(self) -> ClosedLoopModel:
        """The mechanism as a general closed-loop model on Pinocchio; not for several threads at once."""
        loop = ClosedLoopModel.from_urdf(self.exact_urdf, self.sidecar)
        loop.model.gravity.linear = self.parameters.gravity  # a URDF has no place for it
        return loop

    @property
    def model(self) -> Any:
        """The tree as a plain `pinocchio.Model`."""
        return self.loop.model

    @property
    def constraint_models(self) -> Any:
        """The loop closures as Pinocchio constraint models (`pinocchio.StdVec_ConstraintModel`)."""
        return self.loop.constraint_models

    @cached_property
    def visual_model(self) -> Any:
        """The visible solids as a plain `pinocchio.GeometryModel`."""
        return pin.buildGeomFromUrdfString(self.model, self.exact_urdf, pin.GeometryType.VISUAL)

    @cached_property
    def collision_model(self) -> Any:
        """The solids for collision checks as a plain `pinocchio.GeometryModel`."""
        return pin.buildGeomFromUrdfString(self.model, self.exact_urdf, pin.GeometryType.COLLISION)
