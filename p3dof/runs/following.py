"""`follow_motion`: the actuated joints move as they are told, and idle freedoms as they must."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import DynamicsError, InputError, SingularityError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiling_model import Method
from p3dof.machine.motion.times import evenly, sample_count
from p3dof.runs.actuation import Actuation
from p3dof.runs.compiled_robots import states_for
from p3dof.runs.crossings import CHECKED
from p3dof.runs.equilibrium import find_equilibrium
from p3dof.runs.integration import Integrator, Schedule, Tolerances
from p3dof.runs.joint_reference import JointReference, reference_of
from p3dof.runs.plants import ConstrainedPlant
from p3dof.runs.robot_loads import ExternalOverTime, Loads
from p3dof.runs.robot_margins import RobotMargins
from p3dof.runs.robot_run import RobotRun, explained
from p3dof.runs.robots import CLOSED, SHORTEST
from p3dof.runs.settings import Integration

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
    """Return the forces along a motion of the actuated joints, idle freedoms moving as they must.

    The hybrid dynamics are integrated in time: idle freedoms (rods that spin, wheels, a floating base)
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
        Whether idle freedoms start where gravity and springs let them rest, see `find_equilibrium`.
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

    Returns
    -------
    RobotRun
        Its `forces` are those that the motion takes; its `error` is that of the integration.

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
    if not isinstance(motion, JointReference):
        raise InputError(f"motion: expected a JointReference, got {shown(motion)}")
    motion = reference_of(loop, motion)
    if not isinstance(integration, Integration):
        raise InputError(f"integration: expected Integration(...), got {shown(integration)}")
    if not motion.duration:
        raise InputError("motion: expected at least two samples, got one")
    times = evenly(0.0, motion.duration, sample_count(samples, least=2))
    values, velocities, accelerations = motion.at(0.0)
    begin = find_equilibrium(loop, values, q) if equilibrium else q
    state = loop.complete(values, velocities, accelerations, begin)
    loads = Loads(loop, external)
    beta = integration.stabilisation
    plant = _Led(loop, motion, loads, beta)
    wrenches = {name: rows[0] for name, rows in loads.over(np.zeros(1)).items()}
    loop.hybrid_dynamics(state.q, state.v, accelerations, external=wrenches)  # says what does not work
    start = plant.checked_state(state.q, state.v, max(CLOSED, 1e-6))
    plant.compiled = states_for(loop, method, "hybrid_dynamics", loads.frames, beta, state.q)
    margins = RobotMargins(plant, stop_at, (), start)
    count = len(loop.actuated)
    actuation = Actuation(lambda *_: None, None, 0.0, np.full(count, np.inf))
    longest = min(integration.longest_step(), motion.step, CHECKED if loads.watched else np.inf)
    tolerances = Tolerances(integration.rtol, integration.atol, longest, integration.scheme)
    schedule = Schedule(times, 0.0, loads.kinks)
    record = Integrator(
        plant, actuation, plant.load, margins, schedule, tolerances, progress, shortest=SHORTEST
    ).run(start)
    if not record.times:
        raise DynamicsError(f"the motion cannot start: {record.stop}")
    time = np.array(record.times)
    q_, v, a, gap = plant.motion(np.array(record.states), np.array(record.rates))
    acting = loads.over(time)
    found = loop.hybrid_dynamics_batch(q_, v, a[:, loop.actuated_v], external=acting)
    if found.errors:
        first = min(found.errors)
        raise type(found.errors[first])(f"at t = {time[first]:.6g} s: {found.errors[first]}")
    return RobotRun(
        loop,
        time,
        q_,
        v,
        a,
        found.tau,
        found.tau,
        gap,
        loop.body_energies(q_, v).total,
        explained(record.stop, loop, v[-1]),
        record.evaluations,
        record.seconds,
        acting,
        motion.over(time)[0],
    )


class _Led(ConstrainedPlant):
    """A robot whose actuated joints are led along a motion.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    motion : JointReference
        Of its actuated joints.
    loads : Loads
        What acts from outside.
    stabilisation : float
        β of Baumgarte's stabilisation of closures and motion [1/s].
    """

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
