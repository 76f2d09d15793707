"""What the machine is: geometry, bodies, limits, gravity, actuators; the paper's values, and solid steel.

`PAPER` holds the printed numbers, completed by the mass centres that the paper leaves out; `SOLIDS` computes
every body from the solids that reproduce the printed masses. All classes are frozen and check what they are
given; `dataclasses.replace` makes variants.
"""

from p3dof.machine.parameters.actuators import Actuators, Friction, Geometry, Limits
from p3dof.machine.parameters.body import LEGS, LINKS, PASSIVE, PLATFORM, SLIDES, Bodies, Body
from p3dof.machine.parameters.machine import (
    PAPER,
    SOLIDS,
    Parameters,
    of_solids,
    read_parameters,
    write_parameters,
)
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
