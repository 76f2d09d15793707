"""What the page and the viewer ask of the machine that they show."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel
from p3dof.machine.parameters import Parameters
from p3dof.methods import InverseDynamics
from p3dof.viewer.document.drawable import Drawable


class Machine(Drawable, Protocol):
    """The manipulator, as `p3dof.Manipulator` is it: also with its measures, and forces over a motion."""

    @property
    def parameters(self) -> Parameters:
        """Its measures and limits."""

    @property
    def loop(self) -> ClosedLoopModel:
        """The same with its loop closures."""

    @property
    def inverse_dynamics(self) -> Callable[..., InverseDynamics]:
        """Takes a `Motion`, a method and a wrench; returns the forces of the actuators."""


def require_machine(robot: object) -> None:
    """Raise unless something is a manipulator.

    Parameters
    ----------
    robot : object
        What the user gave.

    Raises
    ------
    InputError
        If it has no parameters, model or solids.
    """
    drawn = all(hasattr(robot, name) for name in ("model", "visual_model", "inverse_dynamics"))
    if not drawn or not isinstance(getattr(robot, "parameters", None), Parameters):
        raise InputError(f"robot: expected a Manipulator, got {shown(robot)}")
