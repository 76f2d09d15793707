"""Inverse dynamics of a 3-DOF spatial parallel manipulator, by two independent methods.

>>> import p3dof
>>> robot = p3dof.load()                                    # the paper's machine
>>> result = robot.inverse_dynamics(p3dof.paper_motion())   # by Pinocchio: URDF, loop closures, RNEA
>>> result.forces                                           # (N, 3): actuators A, B, C [N]

The doors, from the top; each imports only from those below it:

- `cli`: the command line; `report`: pages, figures and tables for a colleague.
- `design`: tasks, sizing of drives and bearings, design optimisation, sweeps.
- `manipulator`: one object with everything about one machine.
- `viewer`: moving machines and robots in the browser; `codegen`: C and other languages.
- `runs`: simulation under control, one run or many.
- `analysis`: energy, joint reactions, workspace, indices, load-dependent friction, design tables, tolerances.
- `methods`: the methods side by side; cross-checks by MuJoCo, Drake and Exudyn.
- `closed_form`: the first method, the paper's equations; it uses neither Pinocchio nor the description.
- `loops`: the second method, any robot with closed loops, on Pinocchio; `machine`: parameters, motion, and
  the description as URDF and sister formats. They use no closed form: agreement of both is evidence.

What is here is imported when it is first used; `__init__.pyi` lists the names by topic.

Poses are (y, z, θ); forces and sliders are ordered A, B, C, positive along +z0. SI units everywhere.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
