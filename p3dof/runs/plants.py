"""What is integrated: any plant, and any robot with loop closures as one, in all its joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import DynamicsError, InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.configuration_rates import ConfigurationRates
from p3dof.runs.compiled_robots import CompiledStates


class Plant(Protocol):
    """A mechanism that moves under forces: n actuators, and a load from outside.

    Numbers that follow its state belong to what drives it, see `p3dof.runs.drives`.
    """

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
    """All joints of a robot's tree, held together by its loop closures, which are stabilised.

    The state is (q, v), shape (nq + nv,). Quaternions and circles in q are normalised when they are read.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot; the workspaces of a copy are used.
    stabilisation : float
        β of Baumgarte's stabilisation [1/s].
    frames : sequence of str
        Where the load acts, a wrench (6,) for each of them, one after the other: force [N] and moment [N m]
        at the frame's origin, in world axes.
    resisting : callable, optional
        What acts in the joints and on frames by itself; nothing by default.

    Raises
    ------
    ModelError
        If a joint that turns freely is none of revolute, spherical, planar, free.
    """

    def __init__(
        self,
        loop: ClosedLoopModel,
        stabilisation: float = 0.0,
        frames: Sequence[str] = (),
        resisting: Resisting | None = None,
    ) -> None:
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
        return (q if self._rates.flat else np.asarray(pin.normalize(self.loop.model, q))), v

    def checked_state(self, q: ArrayLike, v: ArrayLike, tolerance: float) -> FloatArray:
        """Return the state of joint positions (nq,) and velocities (nv,).

        Raises
        ------
        InputError
            If the loops are open, or the velocity opens them, by more than the tolerance; with the gap.
        """
        q = frozen_array("q", q, (self._nq,))
        v = frozen_array("v", v, (self._nv,))
        gap = float(np.abs(self.loop.closure_error(q)).max(initial=0.0))
        opening = float(np.abs(self.loop.closure_jacobian(q) @ v).max(initial=0.0))
        if gap > tolerance:
            raise InputError(
                f"q: the loops are open by {gap:.3g} m, expected at most {tolerance:g} m; "
                "robot.loop.assemble(None, guess=q) closes them"
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
        """Return configurations (N, nq), velocities and accelerations (N, nv), and the largest gaps (N,).

        Parameters
        ----------
        states, rates : ndarray, shape (N, nq + nv)
            States, and their derivatives.
        """
        pairs = [self.split(state) for state in states]
        q = np.array([pair[0] for pair in pairs]).reshape(-1, self._nq)
        v = np.array([pair[1] for pair in pairs]).reshape(-1, self._nv)
        gaps = self.loop.closure_gaps(q).max(axis=1, initial=0.0)
        return q, v, rates[:, self._nq : self._nq + self._nv], gaps
