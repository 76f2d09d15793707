"""Positions, Jacobian and drift of the loop closures of one model: the only place that evaluates them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.coordinates import length_coordinates
from p3dof.closed_loop.linear import RANK_TOLERANCE, Decomposition
from p3dof.closed_loop.sidecar import Closure, Sidecar, suggestion
from p3dof.errors import ModelError, P3dofError


@dataclass(frozen=True, eq=False)
class ClosurePoint:
    """The closures at one configuration.

    Parameters
    ----------
    q : (nq,) array
        The configuration.
    error : (rows,) array
        How far each closure is open. ``3d``: R1ᵀ(p2 - p1) [m]; ``6d``: log6(M1⁻¹ M2) [m, rad].
    J : (rows, nv) array
        The closures' Jacobian: velocity of frame 2 relative to frame 1, in the axes of frame 1.
    """

    q: FloatArray
    error: FloatArray
    J: FloatArray

    @property
    def gap(self) -> float:
        """The largest entry of `error` [m or rad]; zero without closures."""
        return max_abs(self.error)

    @cached_property
    def rank_tolerance(self) -> float:
        """Relative rank tolerance at this configuration.

        Rows that are redundant only where the loops are closed have singular values of the order of the gap
        elsewhere, so the tolerance grows with the gap. Without this, Gauss-Newton chases those rows and
        slides along the free motions, and a rank read off a slightly open configuration is too large.
        """
        return max(RANK_TOLERANCE, min(1e-3, 100.0 * self.gap))

    @cached_property
    def svd(self) -> Decomposition:
        """Decomposition of `J`."""
        return Decomposition.of(self.J, self.rank_tolerance)


class LoopKinematics:
    """The closures of a model as Pinocchio constraint models, and their evaluation.

    Owns a `pin.Data`, which always holds the joint placements and Jacobians of the last configuration given
    to `at`. Not thread-safe.

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        The closures.

    Raises
    ------
    ModelError
        If a frame does not exist, or both frames of a closure are on the same body.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self.model = model
        self.data = model.createData()
        self.frames = _frames_by_name(model)
        self.closures = sidecar.closures
        if sidecar.couplings or any(closure.kind not in ("3d", "6d") for closure in sidecar.closures):
            raise ModelError("closures other than '3d' and '6d', and couplings, cannot be computed yet")
        self.constraint_models = pin.StdVec_ConstraintModel()
        self._constraint_datas = pin.StdVec_ConstraintData()
        self.rows: list[slice] = []
        start = 0
        for closure in self.closures:
            self.constraint_models.append(self._anchor(closure))
            self.rows.append(slice(start, start + closure.rows))
            start += closure.rows
        for constraint in self.constraint_models:
            self._constraint_datas.append(constraint.createData())
        # Taken out once the vectors have their final place in memory: they are references.
        pairs = list(zip(self.constraint_models, self._constraint_datas, strict=True))
        self._pairs = [(constraint, data, data.extract()) for constraint, data in pairs]
        self._ends = [_ends(constraint.extract()) for constraint in self.constraint_models]
        self.size = start
        self.lengths = length_coordinates(model)[1]
        """Which of v are rates of lengths."""
        self._zero = np.zeros(model.nv)
        self._last: ClosurePoint | None = None
        self._key = b""

    def at(self, q: FloatArray) -> ClosurePoint:
        """Evaluate the closures; the last result is kept, so asking again costs nothing.

        Parameters
        ----------
        q : (nq,) array
            The configuration.

        Returns
        -------
        ClosurePoint
        """
        key = q.tobytes()
        if self._last is not None and key == self._key:
            return self._last
        pin.computeJointJacobians(self.model, self.data, q)
        error = np.zeros(self.size)
        if self._pairs:
            for (constraint, data, content), rows in zip(self._pairs, self.rows, strict=True):
                constraint.calc(self.model, self.data, data)
                error[rows] = content.constraint_position_error
            J = pin.getConstraintsJacobian(
                self.model, self.data, self.constraint_models, self._constraint_datas
            )
        else:
            J = np.zeros((0, self.model.nv))
        self._key = key
        self._last = ClosurePoint(np.array(q), error, J)
        return self._last

    def move(self, q: FloatArray, v: FloatArray, a: FloatArray | None = None) -> None:
        """Bring the velocities and accelerations of all bodies into `data`.

        Parameters
        ----------
        q : (nq,) array
            The configuration.
        v, a : (nv,) array
            Velocity and acceleration; zero acceleration by default.
        """
        self.at(q)
        pin.forwardKinematics(self.model, self.data, q, v, self._zero if a is None else a)

    def acceleration(self) -> FloatArray:
        """Return the closures' relative acceleration d(J v)/dt (rows,) of the motion given to `move`.

        With zero joint acceleration it is the drift J̇ v. It is exact also where the loops are a little open.
        """
        result = np.zeros(self.size)
        for ends, closure, rows in zip(self._ends, self.closures, self.rows, strict=True):
            relative = self._relative_3d if closure.kind == "3d" else self._relative_6d
            result[rows] = relative(*ends)
        return result

    def frame(self, name: str, what: str, error: type[P3dofError]) -> pin.Frame:
        """Return a frame of the model by name.

        Parameters
        ----------
        name : str
            The name; of several frames with this name the one of a link is meant.
        what : str
            What to call the argument in an error.
        error : type of P3dofError
            The error to raise if there is no such frame.

        Returns
        -------
        pin.Frame
        """
        try:
            return self.model.frames[self.frames[name]]
        except (KeyError, TypeError) as problem:
            help_ = suggestion(str(name), self.frames)
            raise error(f"{what}: the frame {name!r} does not exist; {help_}") from problem

    def worst(self, error: FloatArray) -> str:
        """Return the name of the closure that is open the most."""
        sizes = [max_abs(error[rows]) for rows in self.rows]
        return self.closures[int(np.argmax(sizes))].name

    def _anchor(self, closure: Closure) -> pin.ConstraintModel:
        frame1, frame2 = (
            self.frame(name, f"closure {closure.name}", ModelError)
            for name in (closure.frame1, closure.frame2)
        )
        if frame1.parentJoint == frame2.parentJoint:
            raise ModelError(f"closure {closure.name}: both frames are on the same body")
        kind = pin.PointAnchorConstraintModel if closure.kind == "3d" else pin.FrameAnchorConstraintModel
        ends = (frame1.parentJoint, frame1.placement, frame2.parentJoint, frame2.placement)
        return pin.ConstraintModel(kind(self.model, *ends))

    def _relative_3d(self, joint1: int, M1: pin.SE3, joint2: int, M2: pin.SE3) -> Any:
        """d²/dt² of R1ᵀ d, with d = p2 - p1: the acceleration of frame 2 seen from frame 1."""
        model, data, world = self.model, self.data, pin.LOCAL_WORLD_ALIGNED
        oM1, oM2 = data.oMi[joint1] * M1, data.oMi[joint2] * M2
        V1 = pin.getFrameVelocity(model, data, joint1, M1, world)
        V2 = pin.getFrameVelocity(model, data, joint2, M2, world)
        A1 = pin.getFrameClassicalAcceleration(model, data, joint1, M1, world)
        A2 = pin.getFrameClassicalAcceleration(model, data, joint2, M2, world)
        d, d_dot = oM2.translation - oM1.translation, V2.linear - V1.linear
        omega = pin.skew(V1.angular)
        relative = A2.linear - A1.linear - pin.skew(A1.angular) @ d - omega @ (2.0 * d_dot - omega @ d)
        return oM1.rotation.T @ relative

    def _relative_6d(self, joint1: int, M1: pin.SE3, joint2: int, M2: pin.SE3) -> Any:
        """d/dt of Ad(M12) V2 - V1, both in the axes of frame 1."""
        model, data, local = self.model, self.data, pin.LOCAL
        M12 = (data.oMi[joint1] * M1).actInv(data.oMi[joint2] * M2)
        V1 = pin.getFrameVelocity(model, data, joint1, M1, local)
        V2 = M12.act(pin.getFrameVelocity(model, data, joint2, M2, local))
        A1 = pin.getFrameAcceleration(model, data, joint1, M1, local)
        A2 = M12.act(pin.getFrameAcceleration(model, data, joint2, M2, local))
        return (A2 - V1.cross(V2) - A1).vector


def max_abs(values: FloatArray) -> float:
    """Return the largest absolute value, zero for an empty array."""
    return float(np.abs(values).max()) if values.size else 0.0


def _ends(anchor: Any) -> tuple[int, pin.SE3, int, pin.SE3]:
    return anchor.joint1_id, anchor.joint1_placement.copy(), anchor.joint2_id, anchor.joint2_placement.copy()


def _frames_by_name(model: pin.Model) -> dict[str, int]:
    """Frame index by name; links take precedence over joints of the same name."""
    indices: dict[str, int] = {}
    for index, frame in enumerate(model.frames):
        if frame.name not in indices or frame.type == pin.FrameType.BODY:
            indices[frame.name] = index
    return indices
