"""Inverse dynamics of a 3-DOF spatial parallel manipulator, two independent ways.

>>> import p3dof
>>> robot = p3dof.load()                                    # the paper's machine
>>> result = robot.inverse_dynamics(p3dof.paper_motion())   # by Pinocchio: URDF, loop closures, RNEA
>>> result.forces                                           # (N, 3): actuators A, B, C [N]

The doors, from the top; each imports only from those below it:

- `cli`: the command line; `report`: pages, figures and tables for a colleague.
- `design`: what a machine has to do, what drives it, which one is better: tasks, drives, optimisation.
- `manipulator`: one object with everything about one machine.
- `viewer`: moving machines and robots in the browser; `codegen`: C and other languages.
- `runs`: in time, under control, one or many.
- `analysis`: energy, joint forces, workspace, indices, friction with load; many designs, uncertain machines.
- `methods`: the ways to the forces, side by side; second opinions from other programs.
- `closed_form`: the first way, the paper's equations; it knows neither Pinocchio nor the description.
- `loops`: the second way, any robot with closed loops, on Pinocchio; `machine`: parameters, motion, and the
  description as URDF and sister formats. They know no closed form: that the two ways agree is the evidence.

What is here is imported when it is first used; `__init__.pyi` lists the names by topic.

Poses are (y, z, θ); forces and sliders are ordered A, B, C, positive along +z0. SI units everywhere.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
