# What `p3dof.loops` offers; each name is imported when it is first used.

from .assembly import Assembly, FrameTarget, State
from .batch.assembly import BatchStates, FrameTargets
from .batch.dynamics import BatchForwardDynamics, BatchHybridDynamics, BatchInverseDynamics
from .batch.kinematics import BodyEnergies
from .bushings import Bushing
from .compiled.compiled_loop import CompiledLoop
from .compiled.results import CompiledDerivatives, CompiledDynamics
from .compliance import JointCompliance, beam
from .derivatives import (
    ByForces,
    ByMotion,
    ByPrescription,
    ForwardDynamicsDerivatives,
    HybridDynamicsDerivatives,
    InverseDynamicsDerivatives,
)
from .identification.data import PreparedLog, prepare_log
from .identification.estimates import (
    ParameterEstimate,
    PayloadEstimate,
    estimate_parameters,
    estimate_payload,
)
from .identification.forces import (
    ExtendedForces,
    IdentifiableForces,
    LoopForces,
    Rows,
    States,
    prior_deviations,
)
from .identification.validation import Identification, identify
from .identification.logs import MotorLog, read_log
from .identification.validation import Validation, validate
from .identification.excitation import Excitation, SampledMotion, optimise_excitation
from .margins import SingularityMargins
from .minimal import FrameJacobian, MinimalDynamics
from .model import ClosedLoopModel
from .observer import MomentumObserver
from .online import BodyEstimate, RecursiveEstimator, payload_deviations
from .reactions import (
    BatchReactions,
    ClosureJoint,
    JointReactions,
    ReactionSolver,
    reactions_batch,
    reactions_by_each,
)
from .regressor import BaseParameters, LoopRegressor
from .results import ForwardDynamics, HybridDynamics, InverseDynamics
from .robots import load_robot
from .identification.calibration import (
    Calibration,
    MeasurementPlan,
    Measurements,
    calibrate,
    plan_measurements,
)
from .sidecar import Closure, Coupling, JointData, MotorSide, Sidecar
from .transmission import BoundDirection, ForceLimits, MappedMotion, ReflectedDynamics, Transmission

__all__ = [
    "Assembly",
    "BaseParameters",
    "BatchForwardDynamics",
    "BatchHybridDynamics",
    "BatchInverseDynamics",
    "BatchReactions",
    "BatchStates",
    "BodyEnergies",
    "BodyEstimate",
    "BoundDirection",
    "Bushing",
    "ByForces",
    "ByMotion",
    "ByPrescription",
    "Calibration",
    "ClosedLoopModel",
    "Closure",
    "ClosureJoint",
    "CompiledDerivatives",
    "CompiledDynamics",
    "CompiledLoop",
    "Coupling",
    "Excitation",
    "ExtendedForces",
    "ForceLimits",
    "ForwardDynamics",
    "ForwardDynamicsDerivatives",
    "FrameJacobian",
    "FrameTarget",
    "FrameTargets",
    "HybridDynamics",
    "HybridDynamicsDerivatives",
    "IdentifiableForces",
    "Identification",
    "InverseDynamics",
    "InverseDynamicsDerivatives",
    "JointCompliance",
    "JointData",
    "JointReactions",
    "LoopForces",
    "LoopRegressor",
    "MappedMotion",
    "MeasurementPlan",
    "Measurements",
    "MinimalDynamics",
    "MomentumObserver",
    "MotorLog",
    "MotorSide",
    "ParameterEstimate",
    "PayloadEstimate",
    "PreparedLog",
    "ReactionSolver",
    "RecursiveEstimator",
    "ReflectedDynamics",
    "Rows",
    "SampledMotion",
    "Sidecar",
    "SingularityMargins",
    "State",
    "States",
    "Transmission",
    "Validation",
    "beam",
    "calibrate",
    "estimate_parameters",
    "estimate_payload",
    "identify",
    "load_robot",
    "optimise_excitation",
    "payload_deviations",
    "plan_measurements",
    "prepare_log",
    "prior_deviations",
    "reactions_batch",
    "reactions_by_each",
    "read_log",
    "validate",
]
