"""What a manipulator is made of: its parameters, and the model as plain text and plain Pinocchio objects."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from p3dof._base.errors import InputError
from p3dof.closed_form.compiled import MachineKernels
from p3dof.machine.parameters import Parameters
from p3dof.methods import Methods

if TYPE_CHECKING:  # what only some of it needs
    from p3dof.loops import ClosedLoopModel
    from p3dof.machine import description


class ManipulatorModel:
    """Parameters, description, Pinocchio model and methods of one machine, each made when first asked for."""

    def __init__(self, parameters: Parameters) -> None:
        if not isinstance(parameters, Parameters):
            raise InputError(
                f"parameters: expected Parameters, got {type(parameters).__name__}; from_dict takes a dict"
            )
        self.parameters = parameters
        self.methods = Methods(self)

    @cached_property
    def mechanism(self) -> description.Mechanism:
        """The neutral description: links, joints, closures, solids."""
        from p3dof.machine import description

        return description.describe(self.parameters)

    @cached_property
    def urdf(self) -> str:
        """The URDF of the tree for any reader: self-contained, primitives only, every link with a mass."""
        from p3dof.machine import description

        return description.urdf(description.with_masses(self.mechanism))

    @cached_property
    def exact_urdf(self) -> str:
        """The URDF of the tree with the bodies just as the parameters have them, massless ones included."""
        from p3dof.machine import description

        return description.urdf(self.mechanism)

    @cached_property
    def sidecar(self) -> str:
        """The loop closures and actuated joints that belong to the URDF, as YAML."""
        from p3dof.machine import description

        return description.sidecar(self.mechanism)

    @cached_property
    def kernels(self) -> MachineKernels:
        """The compiled kernels of the machine, or what stands in for them."""
        return MachineKernels(self.parameters)

    def use(self, kernels: MachineKernels) -> None:
        """Put other kernels in the place of those that are there, such as ones of another level."""
        if not isinstance(kernels, MachineKernels):
            raise InputError(f"kernels: expected MachineKernels, got {type(kernels).__name__}")
        self.__dict__["kernels"] = kernels
        self.methods = Methods(self)

    @cached_property
    def loop(self) -> ClosedLoopModel:
        """The mechanism as a closed-loop model on Pinocchio: armature, no friction or counterbalances."""
        from p3dof.loops import ClosedLoopModel
        from p3dof.machine import description
        from p3dof.methods.pinocchio import armature_of

        closures = description.sidecar(self.mechanism.without_balance())  # the method adds it itself
        loop = ClosedLoopModel.from_urdf(self.exact_urdf, closures, mimic=False)
        loop.model.gravity.linear = self.parameters.gravity  # a URDF has no place for it
        loop.model.armature = armature_of(loop.model, self.parameters.actuators)  # nor for this
        return loop

    @cached_property
    def visual_model(self) -> Any:
        """The visible solids as a `pinocchio.GeometryModel`."""
        import pinocchio as pin

        return pin.buildGeomFromUrdfString(self.loop.model, self.exact_urdf, pin.GeometryType.VISUAL)

    @cached_property
    def collision_model(self) -> Any:
        """The solids for collision checks as a `pinocchio.GeometryModel`."""
        import pinocchio as pin

        return pin.buildGeomFromUrdfString(self.loop.model, self.exact_urdf, pin.GeometryType.COLLISION)
