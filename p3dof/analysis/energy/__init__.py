"""Energy, momentum and work over a motion, body by body, and what they mean for the choice of the drives.

    T = Σ ½ m ċ·ċ + ½ ω·I ω     V = -Σ m g·c     p = Σ m ċ     H = Σ c × m ċ + I ω

with the mass centre c of each body from the origin O of the fixed frame: potential energy is zero where it is
at O. Momenta are in the axes of the fixed frame, the angular one about O. All of it comes from the closed
forms of the kinematics and from the bodies, without any force: that the work of the forces makes up for the
change of T + V is evidence for the forces.
"""

from p3dof.analysis.energy.evaluation import (
    DriveLoads,
    Energy,
    balance_table,
    bodies_table,
    drives_table,
    energy_of,
    imbalance,
    kinetic_energy,
    momentum,
    potential_energy,
    work_given,
)

__all__ = [
    "DriveLoads",
    "Energy",
    "balance_table",
    "bodies_table",
    "drives_table",
    "energy_of",
    "imbalance",
    "kinetic_energy",
    "momentum",
    "potential_energy",
    "work_given",
]
