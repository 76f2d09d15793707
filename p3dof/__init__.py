"""Inverse dynamics of a 3-DOF spatial parallel manipulator, two independent ways.

>>> import p3dof
>>> robot = p3dof.load()                                    # the paper's machine
>>> result = robot.inverse_dynamics(p3dof.paper_motion())   # by Pinocchio: URDF, loop closures, RNEA
>>> result.forces                                           # (N, 3): actuators A, B, C [N]

The map, from the bottom: `parameters` (what the machine is), `motion` (what it does), `kinematics` (closed
forms), then side by side and sharing only the parameters: `virtual_power` (the paper's method) and
`description` with `closed_loop` (a generated URDF, its loops as Pinocchio constraint models; `closed_loop`
works for any robot). `manipulator` puts them behind one object, `plots` and `cli` show what comes out.

Poses are (y, z, θ); forces and sliders are ordered A, B, C, positive along +z0. SI units everywhere.
"""

from importlib.metadata import version as _version

from p3dof.closed_loop import ClosedLoopModel, FrameTarget, Sidecar
from p3dof.energy import Energy
from p3dof.errors import (
    AssemblyError,
    ControllerError,
    DynamicsError,
    FileError,
    InputError,
    ModelError,
    MotionError,
    P3dofError,
    ParameterError,
    ReachError,
    SampleError,
    SingularityError,
)
from p3dof.manipulator import InverseDynamics, Manipulator, load
from p3dof.motion import Motion, WrenchHistory, paper_motion
from p3dof.parameters import (
    PAPER,
    SOLIDS,
    Bodies,
    Body,
    Dimensions,
    Friction,
    Geometry,
    Limits,
    Parameters,
    of_solids,
    read_parameters,
    write_parameters,
)
from p3dof.reactions import Reactions
from p3dof.simulation import PD, ComputedTorque, Feedforward, Measurement, Noise, Simulation, Springs

__version__ = _version("p3dof")

__all__ = [
    "PAPER",
    "PD",
    "SOLIDS",
    "AssemblyError",
    "Bodies",
    "Body",
    "ClosedLoopModel",
    "ComputedTorque",
    "ControllerError",
    "Dimensions",
    "DynamicsError",
    "Energy",
    "Feedforward",
    "FileError",
    "FrameTarget",
    "Friction",
    "Geometry",
    "InputError",
    "InverseDynamics",
    "Limits",
    "Manipulator",
    "Measurement",
    "ModelError",
    "Motion",
    "MotionError",
    "Noise",
    "P3dofError",
    "ParameterError",
    "Parameters",
    "ReachError",
    "Reactions",
    "SampleError",
    "Sidecar",
    "Simulation",
    "SingularityError",
    "Springs",
    "WrenchHistory",
    "load",
    "of_solids",
    "paper_motion",
    "read_parameters",
    "write_parameters",
]
