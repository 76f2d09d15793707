"""Motion of one frame seen from another, at the configuration and motion that a `pin.Data` holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.closure_kinds import KindRows
from p3dof.closed_loop.rotations import cross, skew

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
        self._turn, self._J = np.zeros((len(ends), 3)), np.zeros((len(ends), 6, model.nv))
        self._d, self._at = (
            np.zeros((len(ends), 3)),
            kinds.at(self._turn, np.zeros((len(ends), 3, 3)), self._turn),
        )
        self._anchors = (
            pin.StdVec_ConstraintModel()
        )  # frame anchors tell how frame 2 moves relative to frame 1
        self._datas = pin.StdVec_ConstraintData()
        for one in ends:
            self._anchors.append(pin.ConstraintModel(pin.FrameAnchorConstraintModel(model, *one)))
        for anchor in self._anchors:
            self._datas.append(anchor.createData())
        # Taken out once the vectors have their final place in memory: they are references.
        pairs = zip(list(self._anchors), list(self._datas), strict=True)
        self._pairs = [(anchor, anchored, anchored.extract()) for anchor, anchored in pairs]

    def evaluate(self, data: pin.Data, error: FloatArray, J: FloatArray) -> None:
        """Enter errors (size,) and their Jacobian (size, nv), from placements and joint Jacobians."""
        for anchor, anchored, _ in self._pairs:
            anchor.calc(self._model, data, anchored)
        places = [content.c1Mc2 for _, _, content in self._pairs]
        self._d = np.array([M.translation for M in places])
        E = np.array([M.rotation for M in places])
        for i in self._kinds.turning:
            self._turn[i] = pin.log3(E[i])
        # Velocity of the point of body 2 at frame 1's origin; that at frame 2's follows.
        rates = pin.getConstraintsJacobian(self._model, data, self._anchors, self._datas)
        self._J = np.asarray(rates).reshape(len(places), 6, -1)
        self._J[:, :3] -= skew(self._d) @ self._J[:, 3:]
        self._at = self._kinds.at(self._d, E, self._turn)
        for group in self._at:
            group.errors(error)
            group.jacobian(self._J, J)

    def accelerate(self, data: pin.Data, v: FloatArray, result: FloatArray) -> None:
        """Enter d²/dt² of the errors (size,) evaluated last, from the motion of all bodies."""
        rates = self._J @ v
        accelerations = np.array([frame_acceleration(self._model, data, ends) for ends in self._ends])
        carried = cross(accelerations[:, 3:], self._d) + cross(rates[:, 3:], rates[:, :3])
        accelerations[:, :3] += carried
        for group in self._at:
            group.drift(rates, accelerations, result)


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


def frame_acceleration(model: pin.Model, data: pin.Data, ends: Ends) -> Any:
    """Return d/dt of Ad(M12) V2 - V1 (6,), both in the axes of frame 1."""
    (joint1, M1, joint2, M2), local = ends, pin.LOCAL
    M12 = (data.oMi[joint1] * M1).actInv(data.oMi[joint2] * M2)
    V1 = pin.getFrameVelocity(model, data, joint1, M1, local)
    V2 = M12.act(pin.getFrameVelocity(model, data, joint2, M2, local))
    A1 = pin.getFrameAcceleration(model, data, joint1, M1, local)
    A2 = M12.act(pin.getFrameAcceleration(model, data, joint2, M2, local))
    return (A2 - V1.cross(V2) - A1).vector
