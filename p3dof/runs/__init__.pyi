# What `p3dof.runs` offers, by topic; each name is imported when it is first used.

# What a run is given
from .actuation import Encoders, Noise
from .margins import ROBOT_KINDS, Event, Occurrence, Stop
from .settings import AT_HOME, CONTINUOUS, KINDS, PRECISE, TIME_LIMIT, ControlLoop, InitialState, Integration

# Any robot
from .following import find_equilibrium, follow_motion
from .joint_controllers import (
    JointComputedTorque,
    JointFeedforward,
    JointPD,
    JointReference,
    RobotMeasurement,
    gains,
    moved_inertia,
)
from .plants import JointExceedance
from .results import RobotRun
from .robots import RobotController, simulate_robot
from .robots_many import RobotRuns, simulate_robot_many

# The machine
from . import many
from .many import ManyRuns, RunHistories, simulate_many
from .controllers import (
    PD,
    ComputedTorque,
    Controller,
    ControllerLike,
    Feedforward,
    Measurement,
    Reference,
    Springs,
)
from .prepared import PreparedRun, prepare_run, simulate
from .simulation import Simulation, errors_table

__all__ = [
    "AT_HOME",
    "CONTINUOUS",
    "KINDS",
    "PD",
    "PRECISE",
    "ROBOT_KINDS",
    "TIME_LIMIT",
    "ComputedTorque",
    "ControlLoop",
    "Controller",
    "ControllerLike",
    "Encoders",
    "Event",
    "Feedforward",
    "InitialState",
    "Integration",
    "JointComputedTorque",
    "JointExceedance",
    "JointFeedforward",
    "JointPD",
    "JointReference",
    "ManyRuns",
    "Measurement",
    "Noise",
    "Occurrence",
    "PreparedRun",
    "Reference",
    "RobotController",
    "RobotMeasurement",
    "RobotRun",
    "RobotRuns",
    "RunHistories",
    "Simulation",
    "Springs",
    "Stop",
    "errors_table",
    "find_equilibrium",
    "follow_motion",
    "gains",
    "many",
    "moved_inertia",
    "prepare_run",
    "simulate",
    "simulate_many",
    "simulate_robot",
    "simulate_robot_many",
]
