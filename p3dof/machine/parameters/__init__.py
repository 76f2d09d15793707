"""What the machine is: geometry, bodies, limits, gravity, actuators; the paper's values, and solid steel.

`PAPER` holds the printed numbers, completed by the mass centres that the paper leaves out; `SOLIDS` computes
every body from the solids that reproduce the printed masses. All classes are frozen and check what they are
given; `dataclasses.replace` makes variants.
"""

from p3dof.machine.parameters.actuators import Actuators
from p3dof.machine.parameters.bodies import Bodies
from p3dof.machine.parameters.body import Body
from p3dof.machine.parameters.friction import Friction
from p3dof.machine.parameters.geometry import Geometry
from p3dof.machine.parameters.limits import Limits
from p3dof.machine.parameters.machine import Parameters
from p3dof.machine.parameters.named import PAPER, SOLIDS, of_solids
from p3dof.machine.parameters.names import LEGS, LINKS, PASSIVE, PLATFORM, SLIDES
from p3dof.machine.parameters.serialization import read_parameters, write_parameters
from p3dof.machine.parameters.solids import STEEL_DENSITY, Dimensions, box, cylinder, rounded_plate
from p3dof.machine.parameters.tables import machine_html, parameter_tables, payload_table

__all__ = [
    "LEGS",
    "LINKS",
    "PAPER",
    "PASSIVE",
    "PLATFORM",
    "SLIDES",
    "SOLIDS",
    "STEEL_DENSITY",
    "Actuators",
    "Bodies",
    "Body",
    "Dimensions",
    "Friction",
    "Geometry",
    "Limits",
    "Parameters",
    "box",
    "cylinder",
    "machine_html",
    "of_solids",
    "parameter_tables",
    "payload_table",
    "read_parameters",
    "rounded_plate",
    "write_parameters",
]
