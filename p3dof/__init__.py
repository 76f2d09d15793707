"""Inverse dynamics of a 3-DOF spatial parallel manipulator, two independent ways.

>>> import p3dof
>>> robot = p3dof.load()                                    # the paper's machine
>>> result = robot.inverse_dynamics(p3dof.paper_motion())   # by Pinocchio: URDF, loop closures, RNEA
>>> result.forces                                           # (N, 3): actuators A, B, C [N]

The map, from the bottom: `parameters` (what the machine is), `motion` (what it does), `kinematics` (closed
forms), then side by side and sharing only the parameters: `virtual_power` (the paper's method) and
`description` with `closed_loop` (a generated URDF, its loops as Pinocchio constraint models; `closed_loop`
works for any robot). `reduced` folds the paper's method into few operations, `kernels` runs them compiled,
`codegen` writes them for a controller. `manipulator` puts all behind one object, `plots` and `cli` show what
comes out.

What is here is imported when it is first used; the names are in `__init__.pyi`.

Poses are (y, z, θ); forces and sliders are ordered A, B, C, positive along +z0. SI units everywhere.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
