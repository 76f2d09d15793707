"""MuJoCo: the MJCF with its ``<connect>`` equalities, in joint coordinates."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, one_line
from p3dof._base.errors import DynamicsError
from p3dof.machine.description import Mechanism
from p3dof.machine.description.mjcf_text import mjcf
from p3dof.machine.parameters import PAPER, PLATFORM, Parameters
from p3dof.methods.engines.base import FREEDOMS, Engine, FinalState, FrameMotion, Sample, bare_mechanism

_WARNED = threading.Lock()
"""Held by who is told of MuJoCo's warnings: one for all models."""


class MujocoEngine(Engine):
    """A machine in MuJoCo.

    `mj_inverse` knows of loops as springs only: with the forces of these springs added, it gives what the
    open tree takes. The loops enter by their Jacobian, as rigid ones.
    """

    name = "mujoco"
    module = "mujoco"

    def __init__(self, parameters: Parameters = PAPER) -> None:
        super().__init__(parameters)
        self._model = self._library.MjModel.from_xml_string(self._text())
        self._data = self._library.MjData(self._model)

    def _described(self) -> Mechanism:
        return bare_mechanism(self.parameters)

    def _text(self) -> str:
        """Return the MJCF. Constant forces of balances are applied: MuJoCo has only some of them."""
        joints = tuple(replace(joint, force=0.0) for joint in self._mechanism.joints)
        return mjcf(replace(self._mechanism, joints=joints))

    @property
    def _pushes(self) -> FloatArray:
        return np.array([joint.force for joint in self._mechanism.moving])

    def _sample(self, q: FloatArray, v: FloatArray, a: FloatArray, wrench: FloatArray) -> Sample:
        lib, model, data = self._library, self._model, self._data
        # Joints are in the order of the description in MJCF too.
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        lib.mj_inverse(model, data)
        lib.mj_rnePostConstraint(model, data)  # accelerations of the bodies
        loops = data.efc_type == lib.mjtConstraint.mjCNSTR_EQUALITY
        J = data.efc_J.reshape(data.nefc, model.nv)[loops]
        platform = self._frame(PLATFORM)
        given = self._pushes
        body = model.body(PLATFORM).id
        lib.mj_applyFT(model, data, wrench[:3], wrench[3:], platform.position, body, given)
        pairs = [
            (self._frame(closure.frame1), self._frame(closure.frame2)) for closure in self._mechanism.closures
        ]
        return Sample(
            data.qfrc_inverse + data.qfrc_constraint - given,
            np.eye(model.nv)[:, model.actuator_trnid[:FREEDOMS, 0]],
            J,
            data.efc_pos[loops],
            J @ v,
            np.concatenate([(one.acceleration - other.acceleration)[:3] for one, other in pairs]),
            platform,
        )

    def _frame(self, name: str) -> FrameMotion:
        """Return how a marker stands and moves."""
        data, body = self._data, self._model.body(name).id
        velocity, acceleration = (self._six(read, body) for read in ("Velocity", "Acceleration"))
        acceleration[:3] += self._model.opt.gravity  # MuJoCo lets the world accelerate upward instead
        return FrameMotion(
            data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy(), velocity, acceleration
        )

    def _six(self, what: str, body: int) -> FloatArray:
        """Return an object's velocity or acceleration, linear part first."""
        found = np.zeros(6)
        read: Any = getattr(self._library, f"mj_object{what}")
        read(self._model, self._data, self._library.mjtObj.mjOBJ_XBODY, body, found, 0)
        return np.concatenate([found[3:], found[:3]])

    def simulate(self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike) -> FinalState:
        """Move the machine from rest under constant forces; see `Engine.simulate`.

        With the integrator of the MJCF, Runge-Kutta of order 4, and loops as stiff as the step allows: at
        1 ms the springs are those of the MJCF.
        """
        count, q, forces = self._start(duration, step, pose, forces)
        lib, model = self._library, self._library.MjModel.from_xml_string(self._text())
        model.opt.timestep = step
        model.eq_solref[:] = -1 / step**2, -1 / step
        data = lib.MjData(model)
        data.qpos[:], data.ctrl[:], data.qfrc_applied[:] = q, forces, self._pushes
        trouble: list[str] = []
        with _WARNED:
            before = lib.get_mju_user_warning()
            lib.set_mju_user_warning(trouble.append)  # rather than into a file
            try:
                begin = time.perf_counter()
                lib.mj_step(model, data, nstep=count)
                seconds = time.perf_counter() - begin
            finally:
                lib.set_mju_user_warning(before)
        if trouble:
            raise DynamicsError(f"mujoco: {one_line(trouble[0])}")
        return self._final(duration, step, data.qpos.copy(), seconds)
