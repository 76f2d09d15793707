"""Controllers by the names that commands and files have for them."""

from p3dof.runs.controllers import PD, ComputedTorque, Feedforward

CONTROLLERS = {"pd": PD, "feedforward": Feedforward, "computed-torque": ComputedTorque}
"""What follows a motion."""
