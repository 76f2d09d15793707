"""Motion of one frame seen from another, at the configuration and motion that a `pin.Data` holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

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
        self._model, self._kinds = model, kinds
        self._turn, self._J = np.zeros((len(ends), 3)), np.zeros((len(ends), 6, model.nv))
        self._d = np.zeros((len(ends), 3))
        self._at = kinds.at(self._turn, np.zeros((len(ends), 3, 3)), self._turn)
        # Frame anchors tell how frame 2 moves relative to frame 1.
        self._anchors = pin.StdVec_ConstraintModel()
        self._datas = pin.StdVec_ConstraintData()
        for one in ends:
            self._anchors.append(pin.ConstraintModel(pin.FrameAnchorConstraintModel(model, *one)))
        for anchor in self._anchors:
            self._datas.append(anchor.createData())
        # Taken out once the vectors have their final place in memory: they are references.
        pairs = zip(list(self._anchors), list(self._datas), strict=True)
        self._pairs = [(anchor, anchored, anchored.extract()) for anchor, anchored in pairs]
        self._accelerations = [content.constraint_acceleration_error for _, _, content in self._pairs]

    def calculate(self, data: pin.Data) -> None:
        """Let the frame anchors look at what `data` holds."""
        for anchor, anchored, _ in self._pairs:
            anchor.calc(self._model, data, anchored)

    def evaluate(self, data: pin.Data, error: FloatArray, J: FloatArray) -> None:
        """Enter errors (size,) and their Jacobian (size, nv), after `calculate`."""
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

    def accelerate(self, v: FloatArray, result: FloatArray) -> None:
        """Enter d²/dt² of the errors (size,) evaluated last, after `calculate` of a motion."""
        rates = self._J @ v
        accelerations = np.array(self._accelerations)
        carried = cross(accelerations[:, 3:], self._d) + cross(rates[:, 3:], rates[:, :3])
        accelerations[:, :3] += carried
        for group in self._at:
            group.drift(rates, accelerations, result)
