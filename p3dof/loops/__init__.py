"""Dynamics of any robot with loop closures, on Pinocchio: a tree URDF and a sidecar with its closures.

`ClosedLoopModel` is the entry: `assemble` closes the loops at a target, `complete` adds the velocity and the
acceleration of the whole tree, `inverse_dynamics` and `forward_dynamics` follow. Redundant closures and
redundant actuators are welcome; every result carries its own residuals, and what did not converge raises.
This layer knows no particular mechanism.

Where to look, from what a user has to what is computed:

- files: `robots` (`load_robot`), `formats` (URDF, URDF+, MJCF, SRDF, names, Pinocchio's own models),
  `sidecar`, `constraints` (closures and couplings), `joint_data`, `writers`;
- the tree: `trees`, `joints`, `coordinates`, `locks`, `passive` (springs, damping, friction), `motors`,
  `energy`;
- closures: `closures` evaluates them, `closure_kinds` and `relative_motion` those that Pinocchio does not
  know, `couplings`; `closure_wrenches` has the forces in them in space;
- closing loops: `assembly`, `solver`, `trust`, `modes`, `targets`;
- dynamics: `inverse`, `forward`, `hybrid` with their `results`; `partitions` and `linear` solve;
  `reactions`, with `compliance` of elastic joints;
- equations of motion: `independent`, `minimal`, `margins`, `linearised` with `*_tangents` (derivatives),
  `regressor`, `base_parameters`;
- the class, a chain in which each module adds one subject: `closed_tree` (what it is), `built_model` (where
  it comes from), `assembly_model`, `loop_model` (dynamics), `hybrid_model`, `minimal_model`,
  `derivatives_model`, `identification_model`, `margins_model`, `batch_model` (many samples),
  `compiling_model` (which keeps what is compiled), `compiled_model` (``method="compiled"``), `model`
  (`ClosedLoopModel`); `scaled_model` and `units` serve robots much smaller or larger than a metre;
- many samples: `batch`; in C: `compiled`, with the runs in time that `p3dof.runs` makes.
"""

from p3dof.loops.assembly_results import Assembly, State
from p3dof.loops.base_parameters import BaseParameters
from p3dof.loops.batch.energy import BodyEnergies
from p3dof.loops.batch.results import BatchForwardDynamics, BatchHybridDynamics, BatchInverseDynamics
from p3dof.loops.batch.states import BatchStates
from p3dof.loops.batch.targets import FrameTargets
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
from p3dof.loops.hybrid_results import HybridDynamics
from p3dof.loops.joint_data import JointData
from p3dof.loops.margins import SingularityMargins
from p3dof.loops.minimal import FrameJacobian, MinimalDynamics
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.motors import MotorSide
from p3dof.loops.reactions import ClosureJoint, JointReactions, ReactionSolver
from p3dof.loops.reactions_batch import BatchReactions, reactions_batch, reactions_by_each
from p3dof.loops.regressor import LoopRegressor
from p3dof.loops.results import ForwardDynamics, InverseDynamics
from p3dof.loops.robots import load_robot
from p3dof.loops.sidecar import Closure, Coupling, Sidecar
from p3dof.loops.targets import FrameTarget

__all__ = [
    "Assembly",
    "BaseParameters",
    "BatchForwardDynamics",
    "BatchHybridDynamics",
    "BatchInverseDynamics",
    "BatchReactions",
    "BatchStates",
    "BodyEnergies",
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
    "MinimalDynamics",
    "MotorSide",
    "ReactionSolver",
    "Sidecar",
    "SingularityMargins",
    "State",
    "beam",
    "load_robot",
    "reactions_batch",
    "reactions_by_each",
]
