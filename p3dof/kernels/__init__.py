"""The reduced formulas as fast kernels: compiled where the package's extension was built, else on NumPy.

`MachineKernels` runs them for one machine, on columns of numbers; `p3dof.kernels.dynamics` on arrays of
states, with the checks and errors of the other methods. The C is generated from `p3dof.reduced` and
committed; `p3dof codegen --kernels --check` holds it against the formulas.
"""

from p3dof.kernels.dynamics import ForceDerivatives
from p3dof.kernels.machine import BoundInverseDynamics, MachineKernels, levels
from p3dof.kernels.regressor import ForceRegressor

__all__ = ["BoundInverseDynamics", "ForceDerivatives", "ForceRegressor", "MachineKernels", "levels"]
