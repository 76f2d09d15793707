"""The machine in time: integration with events, controllers, and what a run leaves behind."""

from p3dof.simulation.control import Controller, ControllerLike, Measurement
from p3dof.simulation.controllers import PD, ComputedTorque, Feedforward, Springs
from p3dof.simulation.encoders import Encoders, Noise
from p3dof.simulation.equilibrium import find_equilibrium
from p3dof.simulation.events import Event, Occurrence
from p3dof.simulation.following import follow_motion
from p3dof.simulation.joint_controllers import (
    JointComputedTorque,
    JointFeedforward,
    JointPD,
    RobotMeasurement,
    gains,
    moved_inertia,
)
from p3dof.simulation.joint_reference import JointReference
from p3dof.simulation.limits import KINDS
from p3dof.simulation.margins import Stop
from p3dof.simulation.reference import Reference
from p3dof.simulation.robot_margins import ROBOT_KINDS
from p3dof.simulation.robot_run import JointExceedance, RobotRun
from p3dof.simulation.robot_runs import RobotRuns
from p3dof.simulation.robots import RobotController, simulate_robot
from p3dof.simulation.robots_many import simulate_robot_many
from p3dof.simulation.run import Simulation
from p3dof.simulation.settings import ControlLoop, InitialState, Integration
from p3dof.simulation.simulate import AT_HOME, CONTINUOUS, PRECISE, simulate
from p3dof.simulation.tables import errors_table
from p3dof.simulation.work import TIME_LIMIT

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
    "moved_inertia",
    "simulate",
    "simulate_robot",
    "simulate_robot_many",
]
