"""Friction of guides, screws and hinges that grows with the load they carry.

The friction of a joint depends on its reaction, and the reactions of most joints on the friction of hinges.
Both are found together, as the fixed point of: friction → actuator forces → reactions of elastic joints →
friction. Its steps shrink by about mu radius over the arms of the rods; where they do not, the machine jams,
and `DynamicsError` says so. Friction of a guide acts along the guide and changes only the force of its
own actuator.

It is there for forces over a motion or a task, for reactions, lives of bearings and sizes of drives. Kernels
(``method="compiled"``), generated C, forward dynamics, simulations and the fastest motion know only the
constant `Friction` of the parameters: their functions have no argument for it.

Both methods have it. They share the reactions, and with them the numbers mu radius √(fx² + fz²); what the
actuators need against these is found by Pinocchio's joint forces on closed loops in one, by virtual powers
in the other.
"""

from p3dof.analysis.load_friction.contacts import (
    APPLIES,
    HingeContact,
    LoadFriction,
    LoadFrictionEffect,
    SlideContact,
    additions_table,
    contacts_table,
    over_motion,
    read_load_friction,
)
from p3dof.methods import CoulombLimits

__all__ = [
    "APPLIES",
    "CoulombLimits",
    "HingeContact",
    "LoadFriction",
    "LoadFrictionEffect",
    "SlideContact",
    "additions_table",
    "contacts_table",
    "over_motion",
    "read_load_friction",
]
