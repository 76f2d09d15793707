"""Dynamics of any robot with loop closures, on Pinocchio: a tree URDF and a sidecar with its closures.

`ClosedLoopModel` is the entry: `assemble` closes the loops at a target, `complete` adds the velocity and the
acceleration of the whole tree, `inverse_dynamics` and `forward_dynamics` follow. Redundant closures and
redundant actuators are welcome; every result carries its own residuals, and what did not converge raises.
This layer knows no particular mechanism.

Where to look, from what a user has to what is computed:

- files: `robots` (`load_robot`), `formats` (URDF, URDF+, MJCF, SRDF, names, Pinocchio's own models),
  `sidecar` (closures, couplings, data of joints), `writers`;
- the tree: `trees` (joints locked, too), `coordinates` (joints, rotations, springs, damping, friction),
  `bushings`, `tree_formulas` (for tapes);
- closures: `closures` evaluates them and couplings, `closure_kinds` those that Pinocchio does not know;
  `closure_joints` has the forces in them in space;
- closing loops: `assembly`, with targets and what solves;
- dynamics: `inverse`, `forward`, `hybrid` with their `results`; `partitions` and `linear` solve;
  `reactions`, with `compliance` of elastic joints;
- equations of motion: `minimal` (independent coordinates), `margins`, `derivatives` with `*_tangents`,
  `regressor` (and base parameters);
- the class: `loop_model` is the door for one configuration, `model` (`ClosedLoopModel`) adds many samples, C
  and files. Behind them stand a robot in one unit of length (`closed_tree`), the modules above, and
  `compiled.kept` (``method="compiled"``); `units` serves robots much smaller or larger than a
  metre, and is the only place where numbers change their unit;
- from joints to the actuators behind linkages: `transmission`;
- many samples: `batch`; in C: `compiled`, with the simulations that `p3dof.runs` makes.
"""

from p3dof.loops.assembly import Assembly, FrameTarget, State
from p3dof.loops.batch.assembly import BatchStates, FrameTargets
from p3dof.loops.batch.dynamics import BatchForwardDynamics, BatchHybridDynamics, BatchInverseDynamics
from p3dof.loops.batch.kinematics import BodyEnergies
from p3dof.loops.bushings import Bushing
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.results import CompiledDerivatives, CompiledDynamics
from p3dof.loops.compliance import JointCompliance, beam
from p3dof.loops.derivatives import (
    ByForces,
    ByMotion,
    ByPrescription,
    ForwardDynamicsDerivatives,
    HybridDynamicsDerivatives,
    InverseDynamicsDerivatives,
)
from p3dof.loops.margins import SingularityMargins
from p3dof.loops.minimal import FrameJacobian, MinimalDynamics
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.reactions import (
    BatchReactions,
    ClosureJoint,
    JointReactions,
    ReactionSolver,
    reactions_batch,
    reactions_by_each,
)
from p3dof.loops.regressor import BaseParameters, LoopRegressor
from p3dof.loops.results import ForwardDynamics, HybridDynamics, InverseDynamics
from p3dof.loops.robots import load_robot
from p3dof.loops.sidecar import Closure, Coupling, JointData, MotorSide, Sidecar
from p3dof.loops.transmission import (
    BoundDirection,
    ForceLimits,
    MappedMotion,
    ReflectedDynamics,
    Transmission,
)

__all__ = [
    "Assembly",
    "BaseParameters",
    "BatchForwardDynamics",
    "BatchHybridDynamics",
    "BatchInverseDynamics",
    "BatchReactions",
    "BatchStates",
    "BodyEnergies",
    "BoundDirection",
    "Bushing",
    "ByForces",
    "ByMotion",
    "ByPrescription",
    "ClosedLoopModel",
    "Closure",
    "ClosureJoint",
    "CompiledDerivatives",
    "CompiledDynamics",
    "CompiledLoop",
    "Coupling",
    "ForceLimits",
    "ForwardDynamics",
    "ForwardDynamicsDerivatives",
    "FrameJacobian",
    "FrameTarget",
    "FrameTargets",
    "HybridDynamics",
    "HybridDynamicsDerivatives",
    "InverseDynamics",
    "InverseDynamicsDerivatives",
    "JointCompliance",
    "JointData",
    "JointReactions",
    "LoopRegressor",
    "MappedMotion",
    "MinimalDynamics",
    "MotorSide",
    "ReactionSolver",
    "ReflectedDynamics",
    "Sidecar",
    "SingularityMargins",
    "State",
    "Transmission",
    "beam",
    "load_robot",
    "reactions_batch",
    "reactions_by_each",
]
