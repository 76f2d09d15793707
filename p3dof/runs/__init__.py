"""The machine in time: integration with events, controllers, and what a run leaves behind."""

import lazy_loader

from p3dof.runs.control import Controller, ControllerLike, Measurement
from p3dof.runs.controllers import PD, ComputedTorque, Feedforward, Springs
from p3dof.runs.encoders import Encoders, Noise
from p3dof.runs.equilibrium import find_equilibrium
from p3dof.runs.events import Event, Occurrence
from p3dof.runs.following import follow_motion
from p3dof.runs.joint_controllers import (
    JointComputedTorque,
    JointFeedforward,
    JointPD,
    RobotMeasurement,
    gains,
    moved_inertia,
)
from p3dof.runs.joint_reference import JointReference
from p3dof.runs.limits import KINDS
from p3dof.runs.margins import Stop
from p3dof.runs.reference import Reference
from p3dof.runs.robot_margins import ROBOT_KINDS
from p3dof.runs.robot_run import JointExceedance, RobotRun
from p3dof.runs.robot_runs import RobotRuns
from p3dof.runs.robots import RobotController, simulate_robot
from p3dof.runs.robots_many import simulate_robot_many
from p3dof.runs.run import Simulation
from p3dof.runs.settings import ControlLoop, InitialState, Integration
from p3dof.runs.simulate import AT_HOME, CONTINUOUS, PRECISE, simulate
from p3dof.runs.tables import errors_table
from p3dof.runs.work import TIME_LIMIT

__getattr__ = lazy_loader.attach(__name__, ["many"])[0]

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
    "Measurement",
    "Noise",
    "Occurrence",
    "Reference",
    "RobotController",
    "RobotMeasurement",
    "RobotRun",
    "RobotRuns",
    "Simulation",
    "Springs",
    "Stop",
    "errors_table",
    "find_equilibrium",
    "follow_motion",
    "gains",
    "many",
    "moved_inertia",
    "simulate",
    "simulate_robot",
    "simulate_robot_many",
]
