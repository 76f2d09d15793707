"""What a workspace needs of a machine: `p3dof.Manipulator` has it."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray
from p3dof._base.samples import OnInvalid
from p3dof.machine.parameters import Parameters
from p3dof.methods import Method


class Machine(Protocol):
    """What the workspace is asked of: `p3dof.Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """The machine."""

    def jacobian(self, pose: ArrayLike, *, on_invalid: OnInvalid = ..., method: Method = ...) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ) (..., 3, 3)."""

    def forces(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        *,
        on_invalid: OnInvalid = ...,
        method: Method = ...,
    ) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""

    def indices(self, pose: ArrayLike, length: float | None = ..., **options: Any) -> Any:
        """Return performance indices at poses: `p3dof.Indices`."""
