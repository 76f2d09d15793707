"""What is asked of one run of the manipulator, checked once for all ways to integrate it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from p3dof._base.checks import FloatArray, Progress
from p3dof.machine.motion import Motion, WrenchOverTime
from p3dof.methods import Machine, Method
from p3dof.runs.actuation import Actuation
from p3dof.runs.control import ControllerLike, Measurement
from p3dof.runs.reference import Reference
from p3dof.runs.settings import ControlLoop, InitialState, Integration


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked of one run; see `p3dof.runs.simulate`.

    Parameters
    ----------
    machine : Machine
        What is moved.
    method : str
        How.
    times : ndarray, shape (N,)
        Of the samples; the last is the end [s].
    longest : float
        Longest step [s].
    begin : InitialState
        Where it starts.
    controller, control, reference, wrench, stop_at, integration, progress
        As given.
    """

    machine: Machine
    method: Method
    times: FloatArray
    longest: float
    begin: InitialState
    controller: ControllerLike
    control: ControlLoop
    reference: Motion | None
    wrench: WrenchOverTime
    stop_at: Sequence[str]
    integration: Integration
    progress: Progress | None

    def actuation(self) -> Actuation:
        """Return the path from the sliders to the forces; the controller is reset.

        Raises
        ------
        InputError, ControllerError
            As `Actuation`.
        """
        parameters = self.machine.parameters
        limits = self.control.largest_forces(parameters.limits.force)
        measure = partial(Measurement, geometry=parameters.geometry)
        return Actuation(measure, self.controller, self.control.period, limits, self.control.encoders())

    def followed(self) -> Reference | None:
        """Return what the run should follow: what was given, else what the controller follows."""
        own = getattr(self.controller, "motion", None)
        motion = own if self.reference is None else self.reference
        known = getattr(self.controller, "reference", None)
        if isinstance(known, Reference) and known.motion is motion:
            return known
        if self.reference is not None:
            return Reference(self.reference)
        return Reference(own) if isinstance(own, Motion) else None
