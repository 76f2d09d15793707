"""`follow_motion`: the actuated joints move as they are told, and passive freedoms as they must, or rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, frozen_array, require
from p3dof._base.errors import AssemblyError, DynamicsError, InputError, SingularityError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiled.kept import Method
from p3dof.loops.linear import Decomposition
from p3dof.runs.driver import Moving, Run
from p3dof.runs.integration import Recording
from p3dof.runs.joint_controllers import JointReference, reference_of
from p3dof.runs.margins import RobotMargins
from p3dof.runs.plants import CLOSED, ConstrainedPlant, ExternalOverTime, Loads, states_for
from p3dof.runs.results import RobotRun, left_behind
from p3dof.runs.robots import ROBOT_CONTINUOUS, SHORTEST
from p3dof.runs.settings import Integration

_AT_REST, _NEARLY = 1e-9, 1e-7
"""Acceleration of what is at rest, and of what is as good as rounding allows [m/s² or rad/s²]."""
_MOST, _LONGEST, _SHORTEST = 200, 0.3, 1e-10
"""Steps before it is given up, and longest and shortest of them [m or rad]."""
_NEARBY, _FLAT = 1e-6, 1e-8
"""Step of differences [m or rad], and share of the largest stiffness below which a direction is flat."""


def find_equilibrium(loop: ClosedLoopModel, values: ArrayLike, guess: ArrayLike | None = None) -> FloatArray:
    """Return where passive freedoms are at rest under gravity and springs, the actuated joints being held.

    It goes downhill from the guess: what it finds is stable, unless the guess is an equilibrium itself.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    values : (n_actuated,) array
        Of the actuated joints [m or rad].
    guess : (nq,) array, optional
        Where to start; by default the reference configuration.

    Raises
    ------
    AssemblyError
        If the loops do not close at these values.
    DynamicsError
        If there is no equilibrium within reach, such as of a body that falls freely.
    SingularityError, InputError
        As `ClosedLoopModel.hybrid_dynamics`, `ClosedLoopModel.assemble`.
    """
    values = frozen_array("values", values, (len(loop.actuated),))
    q = np.array(loop.assemble(values, guess).q)
    reach = _LONGEST
    pull, (energy, size) = _pull(loop, q), _energy(loop, q)
    scale = max(1.0, pull.rest)  # small robots are faster
    for _ in range(_MOST):
        if pull.rest <= _AT_REST * scale:
            return q
        step = pull.step(reach)
        try:
            there = np.array(loop.assemble(values, pin.integrate(loop.model, q, step)).q)
            found, (height, _) = _pull(loop, there), _energy(loop, there)
        except AssemblyError:
            reach /= 4
            continue
        rounding = 1e-13 * size
        if height < energy - rounding or (height <= energy + rounding and found.rest < pull.rest):
            q, pull, energy, reach = there, found, height, min(2 * reach, _LONGEST)
        else:
            reach = min(reach, float(np.linalg.norm(step))) / 4
        if reach < _SHORTEST:
            break
    if pull.rest <= _NEARLY * scale:
        return q
    raise DynamicsError(
        f"no equilibrium of the passive degrees of freedom was found: at best they accelerate by "
        f"{pull.rest:.3g} m/s² or rad/s²"
    )


class _Pull:
    """What pulls at the passive freedoms of a configuration at rest."""

    def __init__(
        self, N: FloatArray, force: FloatArray, rest: float, loop: ClosedLoopModel, q: FloatArray
    ) -> None:
        self.N, self.force, self.rest = N, force, rest
        self._loop, self._q = loop, q

    def step(self, longest: float) -> FloatArray:
        """Return a step (nv,) downhill: Newton's, where the energy is convex."""
        model, N = self._loop.model, self.N
        stiffness = np.array(
            [
                N.T @ (self.force - _pull(self._loop, there).force) / _NEARBY
                for there in (np.array(pin.integrate(model, self._q, _NEARBY * column)) for column in N.T)
            ]
        )
        curvature, axes = np.linalg.eigh((stiffness + stiffness.T) / 2)
        size = np.maximum(np.abs(curvature), _FLAT * np.abs(curvature).max(initial=1e-6))
        along = axes.T @ (N.T @ self.force) / size
        along = N @ (axes @ along)
        length = float(np.linalg.norm(along))
        return np.asarray(along * min(1.0, longest / length)) if length > 0 else along


def _pull(loop: ClosedLoopModel, q: FloatArray) -> _Pull:
    model, count = loop.model, len(loop.actuated)
    a = loop.hybrid_dynamics(q, np.zeros(model.nv), np.zeros(count)).a
    S = np.zeros((count, model.nv))
    S[np.arange(count), loop.actuated_v] = 1.0
    N = Decomposition.of(np.concatenate([loop.closure_jacobian(q), S]), 1e-7).null_space
    M = np.array(pin.crba(model, model.createData(), q))
    M = np.triu(M) + np.triu(M, 1).T
    return _Pull(N, N @ (N.T @ (M @ a)), float(np.abs(a).max(initial=0.0)), loop, q)


def _energy(loop: ClosedLoopModel, q: FloatArray) -> tuple[float, float]:
    """Return the potential energy, and how large its parts are [J]."""
    found = loop.body_energies(q, np.zeros(loop.model.nv))
    return float(found.total), float(np.abs(found.potential).sum() + found.springs)


FOLLOWING = Integration(rtol=1e-8, atol=1e-9)
"""What forces to six digits need: rounding in the accelerations of light rods allows no better."""


def follow_motion(
    loop: ClosedLoopModel,
    motion: JointReference,
    q: ArrayLike | None = None,
    *,
    equilibrium: bool = False,
    external: ExternalOverTime | None = None,
    stop_at: Sequence[str] = (),
    samples: int = 1001,
    integration: Integration = FOLLOWING,
    progress: Progress | None = None,
    method: Method = "general",
) -> RobotRun:
    """Return the forces along a motion of the actuated joints, passive freedoms moving freely.

    The hybrid dynamics are integrated in time: passive freedoms (rods that spin, wheels, a floating base)
    start at rest, as far as the motion's first velocity lets them. Where there are none it is inverse
    dynamics along the motion.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    motion : JointReference
        Of all actuated joints.
    q : (nq,) array, optional
        Near which configuration it starts; by default the reference configuration. The motion's first values
        are met exactly.
    equilibrium : bool
        Whether passive freedoms start where gravity and springs let them rest, see `find_equilibrium`.
    external : mapping of str to array-like (6,) or callable, optional
        Wrenches on frames, as of `simulate_robot`.
    stop_at : sequence of str
        What ends the run, as of `simulate_robot`; nothing by default.
    samples : int
        How many samples to keep, evenly spaced over the motion.
    integration : Integration
        Tolerances, longest step, and stabilisation of closures and of the motion.
    progress : callable, optional
        Called with (done, total) samples.
    method : {"general", "compiled"} or CompiledLoop
        What computes the accelerations, as of `simulate_robot`; forces at the samples are the robot's own.

    Raises
    ------
    AssemblyError
        If the loops do not close at the motion's first values.
    DynamicsError, SingularityError
        If the motion does not determine the forces, or there is no equilibrium.
    InputError
        If an argument does not fit.
    ModelError
        If the robot cannot be compiled.
    """
    given = motion, q, equilibrium, external, stop_at, samples, integration, progress, method
    return FollowedMotion(loop, *given).in_python()


class FollowedMotion(Run[RobotRun]):
    """A motion that a robot is led along; arguments as of `follow_motion`."""

    shortest = SHORTEST

    def __init__(
        self,
        loop: ClosedLoopModel,
        motion: JointReference,
        q: ArrayLike | None,
        equilibrium: bool,
        external: ExternalOverTime | None,
        stop_at: Sequence[str],
        samples: int,
        integration: Integration,
        progress: Progress | None,
        method: Method,
    ) -> None:
        require("motion", motion, JointReference)
        self.loop, self.motion = loop, reference_of(loop, motion)
        if not motion.duration:
            raise InputError("motion: expected at least two samples, got one")
        super().__init__(motion.duration, samples, None, ROBOT_CONTINUOUS, integration, progress)
        values, velocities, accelerations = motion.at(0.0)
        begin = find_equilibrium(loop, values, q) if equilibrium else q
        start = loop.complete(values, velocities, accelerations, begin)
        self.loads, beta = Loads(loop, external), integration.stabilisation
        self.plant = _Led(loop, motion, self.loads, beta)
        wrenches = {name: rows[0] for name, rows in self.loads.over(np.zeros(1)).items()}
        loop.hybrid_dynamics(start.q, start.v, accelerations, external=wrenches)  # says what does not work
        self.state = self.plant.checked_state(start.q, start.v, max(CLOSED, 1e-6))
        frames = self.loads.frames
        self.plant.compiled = states_for(loop, method, "hybrid_dynamics", frames, beta, start.q)
        self.margins = RobotMargins(self.plant, stop_at, (), self.state)
        self.count, self.kinks = len(loop.actuated), self.loads.kinks
        self.largest, self.measure = np.full(self.count, np.inf), lambda *_: None
        self.longest = min(self.longest_step(self.loads.watched), motion.step)

    def obstacles(self) -> Iterator[str]:
        """Yield what keeps the run from being made in C."""
        yield "motions that are followed have no compiled form"

    def in_c(self) -> str:
        """Return that there is no such run."""
        return next(self.obstacles())

    def moving(self) -> Moving:
        """Return the robot that is led."""
        return Moving(self.plant, self.state, self.plant.load, self.margins)

    def result(self, record: Recording, note: str) -> RobotRun:
        """Return what the run leaves behind, with the forces that the motion takes."""
        record.loads = [load[1:] for load in record.loads]
        method = "general" if self.plant.compiled is None else "compiled"
        run = left_behind(
            self.loop, self.plant, record, self.loads.frames, self.motion, method=method, note=note
        )
        moved = run.a[:, self.loop.actuated_v]
        found = self.loop.hybrid_dynamics_batch(run.q, run.v, moved, external=run.external)
        if found.errors:
            first = min(found.errors)
            raise type(found.errors[first])(f"at t = {run.time[first]:.6g} s: {found.errors[first]}")
        return replace(run, forces=found.tau, asked=found.tau)


class _Led(ConstrainedPlant):
    """A robot whose actuated joints are led along a motion."""

    def __init__(
        self, loop: ClosedLoopModel, motion: JointReference, loads: Loads, stabilisation: float
    ) -> None:
        super().__init__(loop, stabilisation, loads.frames)
        self._reference, self._loads, self._stabilisation = motion, loads, stabilisation

    def load(self, time: float) -> FloatArray:
        """Return the time, and the wrenches then: what this plant takes for a load."""
        return np.concatenate([[time], self._loads(time)])

    def rate(self, state: FloatArray, forces: FloatArray, load: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return the derivative of the state; NaN where there is none."""
        if not np.isfinite(state).all():
            return np.full(len(state), np.nan)
        q, v = self.split(state)
        positions, speeds = self.actuated(state)
        values, velocities, accelerations = self._reference.at(float(load[0]))
        error = values - positions
        error = np.where(self._circles, np.arctan2(np.sin(error), np.cos(error)), error)
        beta = self._stabilisation
        wanted = accelerations + beta * (2 * (velocities - speeds) + beta * error)
        if self.compiled is not None:
            found = self.compiled(q, v, wanted, load[1:], "a")
            if found is not None:
                return np.concatenate([self._rates(q, v), found])
        wrenches = dict(zip(self._load_frames, load[1:].reshape(-1, 6), strict=True))
        try:
            a = self.loop.hybrid_dynamics(q, v, wanted, external=wrenches, stabilisation=beta).a
        except (InputError, DynamicsError, SingularityError):
            return np.full(len(state), np.nan)
        return np.concatenate([self._rates(q, v), a])
