"""What all engines have in common: their protocol, the check of their loops, the projection on them."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from importlib.metadata import version
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, frozen_array
from p3dof._base.errors import DynamicsError
from p3dof.closed_form import kinematics
from p3dof.machine import description
from p3dof.machine.description import Mechanism
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.parameters import PAPER, Parameters
from p3dof.methods.engines.inputs import check_machine, check_motion, library, step_count
from p3dof.methods.engines.samples import FinalState, Sample, platform_motion

CLOSED = 1e-9
"""Share of the machine's size, speed and acceleration by which an engine may find its loops open."""

FREEDOMS = 3
"""Freedoms of the closed mechanism, one for each actuator."""

_RANK = 1e-9
"""Relative size of the singular values that are zero."""


class Engine(ABC):
    """A machine in another engine.

    Parameters
    ----------
    parameters : Parameters
        The machine; the paper's by default.

    Raises
    ------
    InputError
        If `parameters` is something else, or the machine has friction.
    MissingExtraError
        If the library is not installed.
    """

    name: ClassVar[str]
    """What the engine is called."""

    module: ClassVar[str]
    """The Python module of its library."""

    def __init__(self, parameters: Parameters = PAPER) -> None:
        check_machine(parameters)
        self._library = library(self.module, self.name)
        self._working = threading.Lock()  # there is one set of buffers
        self._parameters = parameters
        self._mechanism = self._described()
        self._slides = np.array([joint.kind == "prismatic" for joint in self._mechanism.moving])

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name} {self.version})"

    @property
    def parameters(self) -> Parameters:
        """The machine."""
        return self._parameters

    @property
    def version(self) -> str:
        """Version of the library."""
        return version(self.name)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the description."""
        return tuple(joint.name for joint in self._mechanism.moving)

    def forces(
        self, motion: Motion, wrench: WrenchOverTime = None, progress: Progress | None = None
    ) -> FloatArray:
        """Return the actuator forces over a motion, each sample on its own.

        The joints' motion is that of `p3dof.closed_form.kinematics`; before it is used, the engine must find
        in its own model that every loop is closed and stays so, in position, velocity and acceleration, and
        that the platform is where the motion has it and moves as it should. Together, that leaves the joints
        no choice.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of one
            time or of many.
        progress : callable, optional
            Called with (done, total) after every sample.

        Returns
        -------
        ndarray, shape (N, 3)
            Forces of the actuators A, B, C on their sliders [N].

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If the wrench does not fit, or `motion` is not a `Motion`.
        DynamicsError
            If the engine finds a loop open or the platform elsewhere.
        """
        check_motion(motion)
        geometry, states = self.parameters.geometry, states_over(motion, wrench)
        loads = np.zeros((len(motion), 6)) if states.wrench is None else states.wrench
        found = kinematics.motion_at(geometry, kinematics.holdable(geometry, states))
        q, v, a = (
            np.stack([values[name] for name in self.joints], axis=-1)
            for values in (found.position, found.velocity, found.acceleration)
        )
        forces = np.empty((len(motion), FREEDOMS))
        for k in range(len(motion)):
            with self._working:
                sample = self._sample(q[k], v[k], a[k], loads[k])
            self._check(k, sample, motion, v[k], a[k])
            forces[k] = self._projected(sample)
            if progress is not None:
                progress(k + 1, len(motion))
        return forces

    @abstractmethod
    def simulate(self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike) -> FinalState:
        """Move the machine from rest under constant forces.

        Joints have no ends, actuators no limits and solids do not touch.

        Parameters
        ----------
        duration : float
            How long [s]; a whole number of steps.
        step : float
            Time step [s].
        pose : array-like, shape (3,)
            Where it starts: y, z [m] and θ [rad].
        forces : array-like, shape (3,)
            Forces of the actuators A, B, C [N].

        Returns
        -------
        FinalState

        Raises
        ------
        InputError, ReachError
            If an argument does not fit.
        DynamicsError
            If the engine gives up.
        """

    @abstractmethod
    def _sample(self, q: FloatArray, v: FloatArray, a: FloatArray, wrench: FloatArray) -> Sample:
        """Return the equations of motion at a state of the joints, in their order."""

    def _described(self) -> Mechanism:
        """Return the description that the model is made from."""
        return description.describe(self.parameters)

    def _start(
        self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike
    ) -> tuple[int, FloatArray, FloatArray]:
        """Return the number of steps, the joints at the start and the forces, checked."""
        pose = frozen_array("pose", pose, (3,))
        forces = frozen_array("forces", forces, (FREEDOMS,))
        joints = kinematics.inverse_kinematics(self.parameters.geometry, pose).joints
        return step_count(duration, step), np.array([float(joints[name]) for name in self.joints]), forces

    def _final(self, duration: float, step: float, q: FloatArray, seconds: float) -> FinalState:
        """Name what a simulation came to."""
        if not np.isfinite(q).all():
            raise DynamicsError(f"{self.name}: the simulation diverged at a step of {step:g} s")
        return FinalState(self.name, duration, step, dict(zip(self.joints, q.tolist(), strict=True)), seconds)

    def _check(self, k: int, sample: Sample, motion: Motion, v: FloatArray, a: FloatArray) -> None:
        """Raise unless the loops are closed and the platform moves as it should, in the engine's model."""
        L, arms = self.parameters.geometry.L, np.where(self._slides, 1.0, self.parameters.geometry.L)
        speed = float(np.abs(v * arms).max())
        rate = float(np.abs(a * arms).max() + speed**2 / L + np.abs(self.parameters.gravity).max())
        due = platform_motion(motion, k, self.parameters.geometry.h)
        found, reach = sample.platform, np.repeat([1.0, L], 3)
        off = {
            "position": (L, sample.gap, found.position - due.position, L * (found.rotation - due.rotation)),
            "velocity": (speed, sample.slip, reach * (found.velocity - due.velocity)),
            "acceleration": (rate, sample.pull, reach * (found.acceleration - due.acceleration)),
        }
        for what, (scale, loops, *platform) in off.items():
            for who, errors in (("its loops open", [loops]), ("the platform elsewhere", platform)):
                worst = max(float(np.abs(error).max()) for error in errors)
                if not worst <= CLOSED * scale:
                    raise DynamicsError(
                        f"{self.name}: sample {k}: finds {who} in {what} by {worst:.2g}, "
                        f"expected at most {CLOSED * scale:.2g} (SI units)"
                    )

    def _projected(self, sample: Sample) -> FloatArray:
        """Solve ``load = B u + Jᵀ λ`` for u."""
        A = np.hstack([sample.B, sample.J.T])
        if A.shape[0] == A.shape[1]:  # no row of J is redundant
            return np.asarray(np.linalg.solve(A, sample.load)[:FREEDOMS])
        _, sizes, rows = np.linalg.svd(sample.J)
        free = rows[np.count_nonzero(sizes > _RANK * sizes[0]) :]  # the directions that J leaves, (3, n)
        if len(free) != FREEDOMS:
            raise DynamicsError(f"{self.name}: expected {FREEDOMS} freedoms, found {len(free)}")
        return np.asarray(np.linalg.solve(free @ sample.B, free @ sample.load))
