"""Exudyn: maximal coordinates and multipliers, as in ADAMS."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, one_line
from p3dof._base.errors import DynamicsError
from p3dof.machine.parameters import PAPER, PLATFORM, Parameters
from p3dof.methods.engines.base import Engine
from p3dof.methods.engines.exudyn_model import ExudynModel
from p3dof.methods.engines.poses import carrier
from p3dof.methods.engines.samples import FinalState, FrameMotion, Sample

TOLERANCE = 1e-10
"""Residual of Newton's method, relative and absolute, in a simulation."""


class ExudynEngine(Engine):
    """A machine in Exudyn.

    Its model is made from the description alone and needs no other masses: ten bodies, a hinge or a slide
    for every joint, and the sliders held by constraints whose multipliers are the actuator forces.

    Parameters
    ----------
    parameters : Parameters
        The machine; the paper's by default.

    Raises
    ------
    InputError, MissingExtraError
        As `p3dof.methods.engines.load`.
    """

    name = "exudyn"
    module = "exudyn"

    def __init__(self, parameters: Parameters = PAPER) -> None:
        super().__init__(parameters)
        self._model = ExudynModel(self._mechanism)
        self._model.add_drives()
        self._model.add_wrench()
        self._model.system.Assemble()
        self._solver = self._library.MainSolverImplicitSecondOrder()
        self._solver.InitializeSolver(self._model.system, settings(self._library))

    def _sample(self, q: FloatArray, v: FloatArray, a: FloatArray, wrench: FloatArray) -> Sample:
        system, solver = self._model.system, self._solver
        x, dx, ddx = self._model.coordinates(q, v, a)
        size, held = len(x), solver.GetAEsize()
        data = system.systemData
        data.SetODE2Coordinates(x)
        data.SetODE2Coordinates_t(dx)
        data.SetODE2Coordinates_tt(ddx)
        data.SetAECoordinates(np.zeros(held))
        self._model.set_wrench(wrench)
        solver.ComputeMassMatrix(system)
        solver.ComputeODE2RHS(system)
        load = solver.GetSystemMassMatrix() @ ddx - solver.GetSystemResidual()[:size]
        solver.SetSystemJacobian(np.zeros((size + held, size + held)))
        solver.ComputeJacobianAE(system, 1.0, 0.0, 1.0, False)
        solver.ComputeAlgebraicEquations(system, False)
        # Rows of the drives, and those of axes that are free, are no constraints of the machine.
        drives = [data.GetObjectLTGAE(drive)[0] for drive in self._model.drives]
        J, gap = solver.GetSystemJacobian()[size:, :size].copy(), solver.GetSystemResidual()[size:].copy()
        B = J[drives].T
        rows = np.setdiff1d(np.flatnonzero(J.any(axis=1)), drives)
        pairs = [
            (self._frame(closure.frame1), self._frame(closure.frame2)) for closure in self._mechanism.closures
        ]
        pull = np.concatenate([(one.acceleration - other.acceleration)[:3] for one, other in pairs])
        return Sample(load, B, J[rows], gap[rows], J[rows] @ dx, pull, self._frame(PLATFORM))

    def _frame(self, name: str) -> FrameMotion:
        """Return how a marker stands and moves."""
        link, place = carrier(self._mechanism, name)
        kinds, system = self._library.OutputVariableType, self._model.system

        def read(what: Any) -> FloatArray:
            return np.asarray(system.GetObjectOutputBody(self._model.bodies[link], what, place.position))

        return FrameMotion(
            read(kinds.Position),
            read(kinds.RotationMatrix).reshape(3, 3) @ place.rotation,
            np.concatenate([read(kinds.Velocity), read(kinds.AngularVelocity)]),
            np.concatenate([read(kinds.Acceleration), read(kinds.AngularAcceleration)]),
        )

    def simulate(self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike) -> FinalState:
        """Move the machine from rest under constant forces; see `Engine.simulate`.

        With Exudyn's implicit trapezoidal rule and constraints of index 2, of second order in the step.

        Parameters
        ----------
        duration, step : float
            How long, and the time step [s].
        pose : array-like, shape (3,)
            Where it starts: y, z [m] and θ [rad].
        forces : array-like, shape (3,)
            Forces of the actuators A, B, C [N].

        Returns
        -------
        FinalState

        Raises
        ------
        InputError, ReachError, DynamicsError
            As `Engine.simulate`.
        """
        count, q, forces = self._start(duration, step, pose, forces)
        model = ExudynModel(self._mechanism)
        model.add_forces(forces)
        model.start(q)
        given = settings(self._library, count, duration)
        given.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
        begin = time.perf_counter()
        integrate(model, given, self._library.DynamicSolverType.TrapezoidalIndex2)
        return self._final(duration, step, model.positions(), time.perf_counter() - begin)


def settings(library: Any, steps: int = 1, duration: float = 1.0, tolerance: float = TOLERANCE) -> Any:
    """Return settings of a silent simulation that writes no files and never changes its step.

    Parameters
    ----------
    library : module
        Exudyn.
    steps : int
        How many steps.
    duration : float
        How long [s].
    tolerance : float
        Residual of Newton's method, relative and absolute.

    Returns
    -------
    exudyn.SimulationSettings
    """
    given = library.SimulationSettings()
    given.solution.file.write = False
    given.solution.sensors.writePeriod = duration / steps
    integration = given.timeIntegration
    integration.verboseMode = 0
    integration.adaptiveStep = False
    integration.numberOfSteps, integration.endTime = steps, duration
    integration.newton.useModifiedNewton = True
    integration.newton.relativeTolerance = integration.newton.absoluteTolerance = tolerance
    integration.generalizedAlpha.computeInitialAccelerations = False
    return given


def integrate(model: ExudynModel, given: Any, solver: Any) -> None:
    """Integrate a model in time, from the state that it was started in.

    Parameters
    ----------
    model : ExudynModel
        The model.
    given : exudyn.SimulationSettings
        Step, duration and tolerances.
    solver : exudyn.DynamicSolverType
        The integrator.

    Raises
    ------
    DynamicsError
        If the solver gives up.
    """
    config = model.exudyn.config
    loud, config.printToConsole = config.printToConsole, False  # it prints a banner where it fails
    try:
        model.system.SolveDynamic(given, solverType=solver, storeSolver=False)
    except model.exudyn.ExudynError as error:
        raise DynamicsError(f"exudyn: the simulation failed ({one_line(str(error))})") from error
    finally:
        config.printToConsole = loud
