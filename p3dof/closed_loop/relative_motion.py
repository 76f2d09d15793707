"""Motion of one frame seen from another, at the configuration and motion that a `pin.Data` holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.closure_kinds import KindRows

Ends: TypeAlias = tuple[int, pin.SE3, int, pin.SE3]
"""Joint and placement in its body, of frame 1 and of frame 2."""


class OtherClosures:
    """The closures of a model that are no constraint models of Pinocchio, at one configuration.

    Parameters
    ----------
    model : pin.Model
        The tree.
    ends : sequence of Ends
        The frames of each closure.
    kinds : KindRows
        The closures' rows.
    """

    def __init__(self, model: pin.Model, ends: Sequence[Ends], kinds: KindRows) -> None:
        self._model, self._ends, self._kinds = model, ends, kinds
        self._d, self._E = np.zeros((len(ends), 3)), np.zeros((len(ends), 3, 3))
        self._turn, self._J = np.zeros((len(ends), 3)), np.zeros((len(ends), 6, model.nv))

    def evaluate(self, data: pin.Data, error: FloatArray, J: FloatArray) -> None:
        """Enter errors (size,) and their Jacobian (size, nv), from placements and joint Jacobians."""
        model, world = self._model, pin.LOCAL_WORLD_ALIGNED
        for i, (joint1, M1, joint2, M2) in enumerate(self._ends):
            oM1, oM2 = data.oMi[joint1] * M1, data.oMi[joint2] * M2
            J1 = pin.getFrameJacobian(model, data, joint1, M1, world)
            moved = pin.getFrameJacobian(model, data, joint2, M2, world) - J1
            axes, apart = oM1.rotation.T, oM2.translation - oM1.translation
            self._d[i], self._E[i] = axes @ apart, axes @ oM2.rotation
            self._J[i, :3], self._J[i, 3:] = axes @ (moved[:3] + pin.skew(apart) @ J1[3:]), axes @ moved[3:]
        for i in self._kinds.turning:
            self._turn[i] = pin.log3(self._E[i])
        self._kinds.errors(self._d, self._E, self._turn, error)
        self._kinds.jacobian(self._d, self._E, self._turn, self._J, J)

    def accelerate(self, data: pin.Data, v: FloatArray, result: FloatArray) -> None:
        """Enter d²/dt² of the errors (size,) evaluated last, from the motion of all bodies."""
        parts = [
            [f(self._model, data, ends) for f in (point_acceleration, spin_acceleration)]
            for ends in self._ends
        ]
        motion = self._J @ v, np.array(parts).reshape(-1, 6)
        self._kinds.drift(self._d, self._E, self._turn, motion, result)


def point_acceleration(model: pin.Model, data: pin.Data, ends: Ends) -> Any:
    """Return d²/dt² of R1ᵀ (p2 - p1) (3,): the acceleration of frame 2 seen from frame 1, in its axes."""
    (joint1, M1, joint2, M2), world = ends, pin.LOCAL_WORLD_ALIGNED
    oM1, oM2 = data.oMi[joint1] * M1, data.oMi[joint2] * M2
    V1 = pin.getFrameVelocity(model, data, joint1, M1, world)
    V2 = pin.getFrameVelocity(model, data, joint2, M2, world)
    A1 = pin.getFrameClassicalAcceleration(model, data, joint1, M1, world)
    A2 = pin.getFrameClassicalAcceleration(model, data, joint2, M2, world)
    d, d_dot = oM2.translation - oM1.translation, V2.linear - V1.linear
    omega = pin.skew(V1.angular)
    relative = A2.linear - A1.linear - pin.skew(A1.angular) @ d - omega @ (2.0 * d_dot - omega @ d)
    return oM1.rotation.T @ relative


def spin_acceleration(model: pin.Model, data: pin.Data, ends: Ends) -> Any:
    """Return d/dt of R1ᵀ (ω2 - ω1) (3,)."""
    (joint1, M1, joint2, M2), world = ends, pin.LOCAL_WORLD_ALIGNED
    omega1 = pin.getFrameVelocity(model, data, joint1, M1, world).angular
    omega2 = pin.getFrameVelocity(model, data, joint2, M2, world).angular
    alpha1 = pin.getFrameAcceleration(model, data, joint1, M1, world).angular
    alpha2 = pin.getFrameAcceleration(model, data, joint2, M2, world).angular
    rotation = (data.oMi[joint1] * M1).rotation
    return rotation.T @ (alpha2 - alpha1 - pin.skew(omega1) @ (omega2 - omega1))


def frame_acceleration(model: pin.Model, data: pin.Data, ends: Ends) -> Any:
    """Return d/dt of Ad(M12) V2 - V1 (6,), both in the axes of frame 1."""
    (joint1, M1, joint2, M2), local = ends, pin.LOCAL
    M12 = (data.oMi[joint1] * M1).actInv(data.oMi[joint2] * M2)
    V1 = pin.getFrameVelocity(model, data, joint1, M1, local)
    V2 = M12.act(pin.getFrameVelocity(model, data, joint2, M2, local))
    A1 = pin.getFrameAcceleration(model, data, joint1, M1, local)
    A2 = M12.act(pin.getFrameAcceleration(model, data, joint2, M2, local))
    return (A2 - V1.cross(V2) - A1).vector
