"""What is integrated: any robot with loop closures in all its joints, wrenches on it, drives before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, frozen_array, shown
from p3dof._base.errors import DynamicsError, InputError
from p3dof._base.time_series.wrenches import Load, WrenchHistory, WrenchOverTime

if TYPE_CHECKING:  # the machine runs without Pinocchio, which all that other robots need imports
    from p3dof.loops import ClosedLoopModel, CompiledLoop
    from p3dof.loops.compiled.kept import Method

CLOSED = 1e-9  # largest gap of a start, and share of its velocity that may open the loops

Kind: TypeAlias = Literal["forward_dynamics", "hybrid_dynamics"]


class CompiledStates:
    """A compiled function of one state, with the arrays that it reads and writes."""

    def __init__(
        self, compiled: CompiledLoop, kind: Kind, frames: Sequence[str] = (), stabilisation: float = 0.0
    ) -> None:
        self.loop = compiled  # the robot
        bound = compiled.bind(f"stabilised_{kind}" if stabilisation else kind)
        if stabilisation:
            bound.inputs["stabilisation"][:] = stabilisation
        given = bound.inputs["tau" if kind == "forward_dynamics" else "a_actuated"]
        self._state = bound.inputs["q"], bound.inputs["v"], given
        self._wrenches = [bound.inputs[f"wrench_{name}"] for name in frames]
        self._trusted, self._outputs, self._run = bound.outputs["trusted"], bound.outputs, bound.run
        self.doubtful = 0  # states that were not to be trusted

    def __call__(
        self, q: FloatArray, v: FloatArray, given: FloatArray, wrenches: FloatArray, name: str
    ) -> FloatArray | None:
        """Return an output at a state; None where the general layer has to decide."""
        for target, value in zip(self._state, (q, v, given), strict=True):
            target[:] = value
        for i, wrench in enumerate(self._wrenches if len(wrenches) else ()):
            wrench[:] = wrenches[6 * i : 6 * i + 6]
        self._run()
        if self._trusted[0] > 0.0:
            return self._outputs[name].copy()
        self.doubtful += 1
        return None


def states_for(
    loop: ClosedLoopModel,
    method: Method,
    kind: Kind,
    frames: Sequence[str],
    stabilisation: float,
    q: FloatArray,
) -> CompiledStates | None:
    """Return what computes the states of a run, None for the robot's own methods."""
    from p3dof.loops import CompiledLoop
    from p3dof.loops.compiled.kept import method_of

    compiled = method_of(loop, method, frames)
    if compiled is None:
        return None
    if not isinstance(compiled, CompiledLoop):
        compiled = compiled(loop, q, frames)
    return CompiledStates(compiled, kind, frames, stabilisation)


ExternalOverTime: TypeAlias = Mapping[str, WrenchOverTime]
"""Frame name → wrench (6,) that stays, or a function of time, as `p3dof.WrenchHistory`."""


class Loads:
    """Wrenches on frames, one after the other."""

    def __init__(self, loop: ClosedLoopModel, external: ExternalOverTime | None) -> None:
        if external is not None and not isinstance(external, Mapping):
            raise InputError(f"external: expected a mapping of frames to wrenches, got {shown(external)}")
        given = dict(external or {})
        known = [str(frame.name) for frame in loop.model.frames]
        for name in given:
            if name not in known:
                from p3dof.loops.sidecar import suggestion

                raise InputError(
                    f"external: the frame {shown(name)} does not exist; {suggestion(str(name), known)}"
                )
        self.frames = tuple(given)
        self._loads = {name: Load(wrench) for name, wrench in given.items()}
        self.kinks = np.unique(
            np.concatenate([np.zeros(0), *(w.time for w in given.values() if isinstance(w, WrenchHistory))])
        )
        """Times at which a wrench changes its slope [s]."""
        self.watched = any(callable(w) and not isinstance(w, WrenchHistory) for w in given.values())
        """Whether a function acts that could change unseen between two steps."""
        self._held = None if any(map(callable, given.values())) else self._now(0.0)

    def __call__(self, time: float) -> FloatArray:
        """Return the wrenches at a time since the start [s], one after the other, (6 k,)."""
        return self._now(time) if self._held is None else self._held

    @property
    def stays(self) -> bool:
        """Whether all wrenches stay as they are."""
        return self._held is not None

    def over(self, times: FloatArray) -> dict[str, FloatArray]:
        """Return the wrenches (N, 6) on each frame at times (N,)."""
        rows = np.array([self(float(time)) for time in times]).reshape(len(times), -1, 6)
        return {name: rows[:, i] for i, name in enumerate(self.frames)}

    def _now(self, time: float) -> FloatArray:
        found = [_wrench(name, load, time) for name, load in self._loads.items()]
        return np.concatenate([np.zeros(0), *found])


def _wrench(name: str, load: Load, time: float) -> FloatArray:
    try:
        return load.at(time)
    except InputError as error:
        raise InputError(f"external {shown(name)}: {error}") from error


class Plant(Protocol):
    """A mechanism that moves under the forces of n actuators, and a load from outside."""

    def rate(self, state: FloatArray, forces: FloatArray, load: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of the actuated joints, (n,) each."""


class Resistance(Protocol):
    """What acts in a mechanism by itself, such as friction and springs."""

    @property
    def joint_forces(self) -> FloatArray:
        """Forces in the joints of the tree, (nv,) [N or N m]."""

    @property
    def external(self) -> Mapping[str, FloatArray]:
        """Wrenches (6,) on frames, in world axes [N, N m]."""


Resisting: TypeAlias = Callable[[FloatArray, FloatArray], Resistance]
"""Configuration (nq,) and velocity (nv,) to what acts there."""


class ConstrainedPlant:
    """All joints of a tree with stabilised closures; the state is (q, v), read with q normalised."""

    def __init__(
        self,
        loop: ClosedLoopModel,
        stabilisation: float = 0.0,
        frames: Sequence[str] = (),
        resisting: Resisting | None = None,
    ) -> None:
        from p3dof.loops.coordinates import ConfigurationRates

        self.loop = loop.copy()
        self.names = tuple(str(name) for name in self.loop.model.names[1:])
        self._beta = stabilisation
        self._load_frames, self._resisting = tuple(frames), resisting
        self.compiled: CompiledStates | None = None
        """What computes accelerations where nothing resists and it is to be trusted; else the robot does."""
        self._nq, self._nv = int(self.loop.model.nq), int(self.loop.model.nv)
        self._rates = ConfigurationRates(self.loop.model)
        joints = [self.loop.model.getJointId(name) for name in self.loop.actuated]
        self._actuated_q = np.array([self.loop.model.idx_qs[joint] for joint in joints], dtype=int)
        self._circles = np.array([self.loop.model.nqs[joint] == 2 for joint in joints], dtype=bool)

    def split(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return configuration (nq,) and velocity (nv,) of a state."""
        q, v = state[: self._nq], state[self._nq : self._nq + self._nv]
        if not self._rates.flat:
            import pinocchio as pin

            q = np.asarray(pin.normalize(self.loop.model, q))
        return q, v

    def checked_state(self, q: ArrayLike, v: ArrayLike, tolerance: float) -> FloatArray:
        """Return the state of joint positions (nq,) and velocities (nv,)."""
        q = frozen_array("q", q, (self._nq,))
        v = frozen_array("v", v, (self._nv,))
        gap = float(np.abs(self.loop.closure_error(q)).max(initial=0.0))
        opening = float(np.abs(self.loop.closure_jacobian(q) @ v).max(initial=0.0))
        if gap > tolerance:
            raise InputError(
                f"q: the loops are open by {gap:.3g} m, expected at most {tolerance:g} m; "
                "loop.assemble(guess=q) closes them"
            )
        if opening > tolerance * max(1.0, float(np.abs(v).max(initial=0.0))):
            raise InputError(f"v: opens the loops at {opening:.3g} m/s, expected at most {tolerance:g} m/s")
        return np.concatenate([q, v])

    def rate(self, state: FloatArray, forces: FloatArray, load: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""
        if not np.isfinite(state).all():
            return np.full(len(state), np.nan)
        q, v = self.split(state)
        if self.compiled is not None and self._resisting is None:
            a = self.compiled(q, v, forces, load, "a")
            if a is not None:
                return np.concatenate([self._rates(q, v), a])
        external: dict[str, FloatArray] = {}
        joint_forces = None
        if self._load_frames and load.any():
            external.update(zip(self._load_frames, load.reshape(-1, 6), strict=True))
        if self._resisting is not None:
            acting = self._resisting(q, v)
            joint_forces = acting.joint_forces
            external.update(acting.external)
        try:
            found = self.loop.forward_dynamics(q, v, forces, external, joint_forces, self._beta)
        except (InputError, DynamicsError):  # the trial step of an integrator that went too far
            return np.full(len(state), np.nan)
        return np.concatenate([self._rates(q, v), found.a])

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of the actuated joints, (n,) each [m or rad, and per second]."""
        at = self._actuated_q
        positions = state[at]
        if self._circles.any():  # cosine and sine of an angle
            turned = np.arctan2(state[np.minimum(at + 1, self._nq - 1)], positions)
            positions = np.where(self._circles, turned, positions)
        return positions, state[self._nq :][self.loop.actuated_v]

    def motion(
        self, states: FloatArray, rates: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return configurations (N, nq), velocities and accelerations (N, nv), and the largest gaps (N,)."""
        pairs = [self.split(state) for state in states]
        q = np.array([pair[0] for pair in pairs]).reshape(-1, self._nq)
        v = np.array([pair[1] for pair in pairs]).reshape(-1, self._nv)
        gaps = self.loop.closure_gaps(q).max(axis=1, initial=0.0)
        return q, v, rates[:, self._nq : self._nq + self._nv], gaps


class Lag:
    """Forces that follow commands which stay for a while: ḟ = 2π b (command - f), solved exactly."""

    def __init__(self, bandwidth: FloatArray) -> None:
        self._rates = 2 * np.pi * bandwidth
        self._since = 0.0
        self._begun: FloatArray = np.zeros(0)
        self._command: FloatArray = self._begun

    def follow(self, time: float, command: FloatArray) -> None:
        """Take another command (n,) from a time on [s]; drives have settled at the first one."""
        self._begun = self.at(time) if len(self._command) else command
        self._since, self._command = time, command

    def at(self, time: float) -> FloatArray:
        """Return the forces at a time since then, (n,) [N or N m]."""
        after = time - self._since
        rest = np.exp(-self._rates * after) if after > 0 else np.where(np.isinf(self._rates), 0.0, 1.0)
        return np.asarray(self._command + (self._begun - self._command) * rest)


class DrivenPlant:
    """A plant behind drives, ḟ = 2π b (command - f); its state is that of the plant, then n forces."""

    def __init__(self, plant: Plant, bandwidth: FloatArray) -> None:
        self._plant, self._count = plant, len(bandwidth)
        self._at_once = ~np.isfinite(bandwidth)
        self._rates = 2 * np.pi * np.where(self._at_once, 0.0, bandwidth)

    def begin(self, state: FloatArray, forces: FloatArray) -> FloatArray:
        """Return the state for one of the plant, whose drives have settled at forces (n,)."""
        return np.concatenate([state, forces])

    def delivered(self, state: FloatArray, command: FloatArray) -> FloatArray:
        """Return the forces on the plant, (n,) [N or N m]."""
        return np.where(self._at_once, command, state[-self._count :])

    def rate(self, state: FloatArray, command: FloatArray, load: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""
        own, forces = state[: -self._count], self.delivered(state, command)
        lag = np.where(self._at_once, 0.0, self._rates * (command - forces))
        return np.concatenate([self._plant.rate(own, forces, load), lag])

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of the actuated joints, (n,) each."""
        return self._plant.actuated(state)


@dataclass(frozen=True)
class JointExceedance(Readable):
    """A limit of a joint's force, speed or position that a run exceeds, where it does so the most.

    Parameters
    ----------
    quantity : str
        ``"force"``, ``"speed"`` or ``"position"``.
    joint : str
        The joint.
    time : float
        When [s].
    value, limit : float
        What it is then, and the limit of the robot's file on its side.
    unit : str
        Of both.
    """

    quantity: str
    joint: str
    time: float
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.quantity} of {self.joint}: {self.value:g} {self.unit} at t = {self.time:g} s, "
            f"limit {self.limit:g} {self.unit}"
        )


class Limited:
    """A motion of any robot with its forces, held against the limits of the robot's file."""

    loop: ClosedLoopModel
    time: FloatArray
    q: FloatArray
    v: FloatArray
    forces: FloatArray

    def exceedances(self) -> tuple[JointExceedance, ...]:
        """Return which limits in the robot's file samples exceed, each at its worst.

        Those of force or speed that are zero or infinite are none, as files leave them out; and those of
        position whose lower is not below the upper.
        """
        from p3dof.loops.assembly import BEYOND, Limits
        from p3dof.loops.tables import is_slide

        loop, model, found, ends = self.loop, self.loop.model, [], Limits(self.loop.model)
        effort, speed = model.upperEffortLimit[loop.actuated_v], model.upperVelocityLimit
        most = [("force", *one) for one in zip(loop.actuated, self.forces.T, effort, strict=True)]
        single = [(str(model.names[i]), model.idx_vs[i]) for i in range(model.njoints) if model.nvs[i] == 1]
        most += [("speed", name, self.v[:, at], speed[at]) for name, at in single]
        rows = [(*one, -one[-1], 1e-12 * one[-1]) for one in most if one[-1] > 0]
        limits = zip(ends.names, self.q[:, ends.q].T, ends.upper, ends.lower, strict=True)
        rows += [("position", *one, BEYOND) for one in limits if one[-1] < one[-2]]
        units = {"force": ("N m", "N"), "speed": ("rad/s", "m/s"), "position": ("rad", "m")}
        for quantity, name, values, high, low, least in rows:
            at = int(np.argmax(np.maximum(values - high, low - values)))
            value, limit = float(values[at]), float(high if values[at] > high else low)
            if max(value - high, low - value) > least:
                unit = units[quantity][is_slide(loop, model.getJointId(name))]
                found.append(JointExceedance(quantity, name, float(self.time[at]), value, limit, unit))
        return tuple(found)

    def values(self, name: str) -> FloatArray:
        """Return the values of a joint (N,) or (N, n) [m, rad]; those of a continuous one go on after a turn.

        Parameters
        ----------
        name : str
            The joint; it must exist.
        """
        model, joint = self.loop.model, self.loop.model.getJointId(name)
        at, size = model.idx_qs[joint], model.nqs[joint]
        if size == 2 and model.nvs[joint] == 1:
            return np.asarray(np.unwrap(np.arctan2(self.q[:, at + 1], self.q[:, at])))
        return self.q[:, at] if size == 1 else self.q[:, at : at + size]
