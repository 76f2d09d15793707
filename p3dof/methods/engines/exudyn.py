"""Exudyn: maximal coordinates and multipliers, as in ADAMS."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, one_line
from p3dof._base.errors import DynamicsError
from p3dof.machine.description import Joint, Mechanism, Placement
from p3dof.machine.parameters import PAPER, PLATFORM, Parameters
from p3dof.methods.engines.base import (
    Engine,
    FinalState,
    FrameMotion,
    Sample,
    axis_frame,
    carrier,
    homogeneous,
    library,
    link_motions,
)

PLANAR = ("loop_b", "loop_c")
"""Closures held across their hinge's axis only: along it, the loops are closed already."""

_ACROSS_Y = [1, 0, 1, 0, 0, 0]
_POINT = [1, 1, 1, 0, 0, 0]
_HINGE = [1, 1, 1, 1, 1, 0]
_SLIDE = [1, 1, 0, 1, 1, 1]
_NAME = "exudyn"

Drive: TypeAlias = Callable[[float], float]
"""A slider's position or velocity as a function of time."""


class ExudynModel:
    """The mechanism as an Exudyn system, home as its reference configuration.

    Bodies have Euler parameters as coordinates, with a constraint for their length. Massless bodies stay
    massless: their neighbours' inertia and the constraints determine how they move. Hinges and slides hold
    five freedoms each, `PLANAR` closures two, and ``loop_a`` three: no constraint is redundant.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.exudyn = library(_NAME, _NAME)
        self.items = library("exudyn.itemInterface", _NAME)
        self.mechanism = mechanism
        self._container = self.exudyn.SystemContainer()  # the system lives as long as it does
        self.system = self._container.AddSystem()
        self.links = tuple(joint.child for joint in mechanism.moving)
        self._home = link_motions(mechanism)
        self.bodies = {mechanism.links[0].name: self.system.AddObject(self.items.ObjectGround())}
        self.nodes: dict[str, Any] = {}
        for link in self.links:
            self._add_body(link)
        for joint in mechanism.moving:
            self._add_joint(joint)
        for joint in mechanism.moving:
            if joint.armature or joint.balanced:
                self._add_balance(joint)
        self.closures = [self._add_closure(*names) for names in _closures(mechanism)]
        self.drives: list[Any] = []
        self._load: tuple[Any, Any] | None = None

    def _add_body(self, link: str) -> None:
        """Add a rigid body with its weight; its frame is the link's."""
        body = next(item.body for item in self.mechanism.links if item.name == link)
        place = self._home[link]
        coordinates = [*place.position, *place.quaternion]
        node = self.system.AddNode(self.items.NodeRigidBodyEP(referenceCoordinates=coordinates))
        moments = np.zeros((3, 3)) if body is None else body.inertia_about(np.zeros(3))
        mass = 0.0 if body is None else body.mass
        joint = next(item for item in self.mechanism.joints if item.child == link)
        whole = mass + (joint.armature if joint.kind == "prismatic" else 0.0)  # at the slider's origin
        self.nodes[link] = node
        self.bodies[link] = self.system.AddObject(
            self.items.ObjectRigidBody(
                mass=whole,
                inertia=moments[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
                centerOfMass=np.zeros(3) if body is None or not whole else mass / whole * body.com,
                nodeNumber=node,
            )
        )
        if whole > 0:
            marker = self.system.AddMarker(self.items.MarkerBodyMass(bodyNumber=self.bodies[link]))
            self.system.AddLoad(
                self.items.LoadMassProportional(markerNumber=marker, loadVector=self.mechanism.gravity)
            )

    def _add_joint(self, joint: Joint) -> None:
        """Hold what a joint does not let free; its axis is z of both markers."""
        turn = axis_frame(np.asarray(joint.axis))
        place = joint.placement
        one = self._marker(joint.parent, Placement(place.position, place.rotation @ turn))
        other = self._marker(joint.child, Placement(rotation=turn))
        axes = _SLIDE if joint.kind == "prismatic" else _HINGE
        self._add_generic(one, other, axes)

    def _add_balance(self, joint: Joint) -> None:
        """Push a slider as its balance does, and take the weight of the inertia of its motor off it."""
        slide, given = (
            self._slide(joint.name),
            joint.force - joint.armature * float(self.mechanism.gravity[2]),
        )
        self.system.AddLoad(self.items.LoadCoordinate(markerNumber=slide, load=given))
        if joint.stiffness:
            self.system.AddObject(
                self.items.ObjectConnectorCoordinateSpringDamper(
                    markerNumbers=[self._ground(), slide], stiffness=joint.stiffness
                )
            )

    def _ground(self) -> Any:
        """Return a coordinate that stays zero."""
        node = self.system.AddNode(self.items.NodePointGround())
        return self.system.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))

    def _add_closure(self, name: str, frame1: str, frame2: str) -> Any:
        """Join two points; those of a `PLANAR` closure across y of the first frame."""
        one, other = (self._marker(*carrier(self.mechanism, frame)) for frame in (frame1, frame2))
        return self._add_generic(one, other, _ACROSS_Y if name in PLANAR else _POINT)

    def _add_generic(self, one: Any, other: Any, axes: list[int]) -> Any:
        return self.system.AddObject(
            self.items.ObjectJointGeneric(markerNumbers=[one, other], constrainedAxes=axes)
        )

    def _marker(self, link: str, place: Placement) -> Any:
        return self.system.AddMarker(
            self.items.MarkerBodyRigid(bodyNumber=self.bodies[link], localHT=homogeneous(place))
        )

    def _slide(self, name: str) -> Any:
        """Return a marker on the coordinate of a slider along its guideway, zero at home."""
        link = next(joint.child for joint in self.mechanism.moving if joint.name == name)
        return self.system.AddMarker(
            self.items.MarkerNodeCoordinate(nodeNumber=self.nodes[link], coordinate=2)
        )

    def add_drives(self, positions: Sequence[Drive] = (), velocities: Sequence[Drive] = ()) -> None:
        """Hold the sliders, or lead them."""
        ground = self._ground()
        for i, name in enumerate(self.mechanism.actuated):
            led = {}
            if positions:
                led = {
                    "offsetUserFunction": _user_function(positions[i]),
                    "offsetUserFunction_t": _user_function(velocities[i]),
                }
            self.drives.append(
                self.system.AddObject(
                    self.items.ObjectConnectorCoordinate(markerNumbers=[ground, self._slide(name)], **led)
                )
            )

    def add_forces(self, forces: FloatArray) -> None:
        """Push the sliders."""
        for name, force in zip(self.mechanism.actuated, forces, strict=True):
            self.system.AddLoad(self.items.LoadCoordinate(markerNumber=self._slide(name), load=float(force)))

    def add_wrench(self, wrench: Callable[[float], FloatArray] | None = None) -> None:
        """Load the platform at P."""
        marker = self._marker(*carrier(self.mechanism, PLATFORM))
        kinds = (self.items.LoadForceVector, self.items.LoadTorqueVector)
        loads = []
        for kind, part in zip(kinds, (slice(3), slice(3, 6)), strict=True):
            given = {} if wrench is None else {"loadVectorUserFunction": _load_function(wrench, part)}
            loads.append(self.system.AddLoad(kind(markerNumber=marker, **given)))
        self._load = (loads[0], loads[1])

    def set_wrench(self, wrench: FloatArray) -> None:
        """Set a load of `add_wrench`, shape (6,) [N, N m]."""
        if self._load is not None:
            for load, part in zip(self._load, (wrench[:3], wrench[3:]), strict=True):
                self.system.SetLoadParameter(load, "loadVector", part)

    def add_sensor(self, item: Any, what: Any) -> Any:
        """Record an output of an object at every step; what to ask `system.GetSensorStoredData` for."""
        return self.system.AddSensor(
            self.items.SensorObject(
                objectNumber=item, storeInternal=True, writeToFile=False, outputVariableType=what
            )
        )

    def coordinates(
        self, q: FloatArray, v: FloatArray | None = None, a: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return all bodies' coordinates at a state of the joints, with two derivatives.

        Displacements from home and changes of the Euler parameters since, and their rates.
        """
        motions = link_motions(self.mechanism, q, v, a)
        columns: list[list[FloatArray]] = [[], [], []]
        for link in self.links:
            now, home = motions[link], self._home[link]
            turning, speeding = now.quaternion_rates()
            columns[0] += [now.position - home.position, now.quaternion - home.quaternion]
            columns[1] += [now.velocity, turning]
            columns[2] += [now.acceleration, speeding]
        first, second, third = (np.concatenate(column) for column in columns)
        return first, second, third

    def start(self, q: FloatArray, v: FloatArray | None = None, a: FloatArray | None = None) -> None:
        """Assemble the system, and set the state that it starts from; see `coordinates`."""
        self.system.Assemble()
        initial, data = self.exudyn.ConfigurationType.Initial, self.system.systemData
        for write, values in zip(
            (data.SetODE2Coordinates, data.SetODE2Coordinates_t, data.SetODE2Coordinates_tt),
            self.coordinates(q, v, a),
            strict=True,
        ):
            write(values, initial)

    def positions(self) -> FloatArray:
        """Return the positions of the joints at the current coordinates, shape (10,) [m or rad]."""
        current, types = self.exudyn.ConfigurationType.Current, self.exudyn.OutputVariableType

        def frame(link: str) -> tuple[FloatArray, FloatArray]:
            read, body = self.system.GetObjectOutputBody, self.bodies[link]
            place = [
                read(body, what, np.zeros(3), current) for what in (types.RotationMatrix, types.Position)
            ]
            return place[0].reshape(3, 3), place[1]

        found = []
        for joint in self.mechanism.moving:
            (R0, p0), (R1, p1), axis = frame(joint.parent), frame(joint.child), np.asarray(joint.axis)
            R = R0 @ joint.placement.rotation
            if joint.kind == "prismatic":
                found.append(float(axis @ R.T @ (p1 - p0 - R0 @ joint.placement.position)))
            else:
                turned, x = R.T @ R1, axis_frame(axis)
                found.append(float(np.arctan2(x[:, 1] @ turned @ x[:, 0], x[:, 0] @ turned @ x[:, 0])))
        return np.array(found)


def _closures(mechanism: Mechanism) -> list[tuple[str, str, str]]:
    return [(closure.name, closure.frame1, closure.frame2) for closure in mechanism.closures]


def _user_function(drive: Drive) -> Callable[[Any, float, int, float], float]:
    """Return a function of time with the arguments that Exudyn gives."""
    return lambda _system, t, _item, _offset: drive(t)


def _load_function(
    wrench: Callable[[float], FloatArray], part: slice
) -> Callable[[Any, float, FloatArray], FloatArray]:
    return lambda _system, t, _load: wrench(t)[part]


TOLERANCE = 1e-10
"""Residual of Newton's method, relative and absolute, in a simulation."""


class ExudynEngine(Engine):
    """A machine in Exudyn.

    Its model is made from the description alone and needs no other masses: ten bodies, a hinge or a slide
    for every joint, and the sliders held by constraints whose multipliers are the actuator forces.
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
    """Return settings of a silent simulation that writes no files and never changes its step."""
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
    """Integrate a model in time, from the state that it was started in."""
    config = model.exudyn.config
    loud, config.printToConsole = config.printToConsole, False  # it prints a banner where it fails
    try:
        model.system.SolveDynamic(given, solverType=solver, storeSolver=False)
    except model.exudyn.ExudynError as error:
        raise DynamicsError(f"exudyn: the simulation failed ({one_line(str(error))})") from error
    finally:
        config.printToConsole = loud
