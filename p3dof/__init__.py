"""Inverse dynamics of a 3-DOF spatial parallel manipulator, two independent ways.

>>> import p3dof
>>> robot = p3dof.load()                                    # the paper's machine
>>> result = robot.inverse_dynamics(p3dof.paper_motion())   # by Pinocchio: URDF, loop closures, RNEA
>>> result.forces                                           # (N, 3): actuators A, B, C [N]

The rooms, from the bottom; each imports only from below:

- `blocks`: work of any size in blocks, on any number of machines.
- `parameters`: what the machine is; `motion`: what it does, and what acts on it; `tasks`: what it has to do;
  `drives`: what moves it.
- `paper`: the paper's formulas on scalars; `closed_loop`: any robot with closed loops, on Pinocchio;
  `description`: the machine as URDF and sister formats. The first knows nothing of the other two: their
  agreement is the evidence.
- `kinematics`: closed forms over arrays; `compiled`: the paper's method folded into few operations, in C.
- `methods`: the ways to the forces, with one kind of result; `engines`: second opinions from other programs.
- `simulation`: runs in time, under control; `energy`; `reactions`: joint forces;
  `workspace`: where the machine can work; `indices`: how well, at poses;
  `bearings`: how long they live; `codegen`: C code.
- `load_friction`: friction that grows with the loads of joints.
- `tolerances`: machines that are not what their drawings say: tolerances, sensitivity.
- `designs`: the forces of many designs over one motion, by columns; `sweeps`: by the million, in blocks.
- `viewer`: moving robots in the browser; `manipulator`: one object with everything about one machine.
- `plots`: figures; `report`: one page; `cli`: the command line.
- `algebra`, `files`, `tables`, `checks`, `errors`: what all of these stand on.

What is here is imported when it is first used; `__init__.pyi` lists the names by topic.

Poses are (y, z, θ); forces and sliders are ordered A, B, C, positive along +z0. SI units everywhere.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
