"""The reduced formulas as fast kernels: compiled where the package's extension was built, else on NumPy.

`MachineKernels` runs them for one machine, on columns of numbers; `p3dof.methods.compiled` on arrays of
states, with the checks and errors of the other methods. The C is generated from
`p3dof.closed_form.compiled.reduced` and committed; `p3dof codegen --kernels --check` holds it against the
formulas.
"""

from p3dof.closed_form.compiled.kernels import BoundInverseDynamics, MachineKernels, in_words, levels

__all__ = ["BoundInverseDynamics", "MachineKernels", "in_words", "levels"]
