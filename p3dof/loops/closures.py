"""Positions, Jacobian and drift of the loop closures of one model: the only place that evaluates them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain, groupby, pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, one_line
from p3dof._base.errors import ModelError, P3dofError
from p3dof._base.threads import Own
from p3dof.loops.closure_kinds import PARTS, KindRows, lengths_of
from p3dof.loops.coordinates import length_coordinates
from p3dof.loops.couplings import CouplingRows
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition
from p3dof.loops.relative_motion import Ends, OtherClosures
from p3dof.loops.sidecar import Closure, Sidecar, suggestion

TIGHT = 1e-11
"""Gap so small that rank tolerances do not depend on it [m or rad]."""


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

    @cached_property
    def gap(self) -> float:
        """The largest entry of `error` [m or rad]; zero without closures."""
        return max_abs(self.error)

    @cached_property
    def tight(self) -> bool:
        """Whether the gap is smaller than all that tolerances look at."""
        return bool(self.error.dot(self.error) <= TIGHT**2)

    @cached_property
    def rank_tolerance(self) -> float:
        """Relative rank tolerance at this configuration.

        Rows that are redundant only where the loops are closed have singular values of the order of the gap
        elsewhere, so the tolerance grows with the gap. Without this, Gauss-Newton chases those rows and
        slides along the free motions, and a rank read off a slightly open configuration is too large.
        """
        return RANK_TOLERANCE if self.tight else max(RANK_TOLERANCE, min(1e-3, 100.0 * self.gap))

    @cached_property
    def svd(self) -> Decomposition:
        """Decomposition of `J`."""
        return Decomposition.of(self.J, self.rank_tolerance)


class LoopKinematics:
    """The closures and couplings of a model, and their evaluation.

    Points and frames are Pinocchio constraint models. Every thread has an `_Evaluation` of its own.

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        The closures and couplings, whose rows follow each other in this order.

    Raises
    ------
    ModelError
        If a frame or joint does not exist, both frames of a closure are on the same body, or a coupled joint
        has several degrees of freedom.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self.model = model
        self.frames = _frames_by_name(model)
        self.closures = sidecar.closures
        self.couplings = CouplingRows(model, sidecar.couplings)
        titles = [f"coupling {coupling.title}" for coupling in sidecar.couplings]
        self.names = [*(f"closure {closure.name}" for closure in self.closures), *titles]
        stops = np.cumsum([0, *(closure.rows for closure in self.closures), *(1 for _ in titles)]).tolist()
        self.rows = [slice(*ends) for ends in pairwise(stops)]
        """Rows of the closures, then of the couplings."""
        self.size: int = stops[-1]
        self.coupled = slice(self.size - len(titles), self.size)
        """Rows of all couplings."""
        sizes = [[len(list(part)) for _, part in groupby(lengths_of(c.kind))] for c in self.closures]
        parts = [*sizes, *([1] for _ in titles)]
        self._parts = np.cumsum([0, *chain.from_iterable(parts)])[:-1]
        self._first_parts = np.cumsum([0, *map(len, parts)])[:-1]
        self.ends = [self._ends(closure) for closure in self.closures]
        """Joint and placement in its body of frame 1, then of frame 2, by closure."""
        own = [i for i, closure in enumerate(self.closures) if closure.kind in PARTS]
        self.own = np.array(own, dtype=int)
        """Which closures are no constraint models of Pinocchio."""
        self.kinds = KindRows([self.closures[i] for i in own], [self.rows[i] for i in own])
        self.plain = not own and not titles
        """Whether all are constraint models of Pinocchio."""
        self.anchors = [i for i in range(len(self.closures)) if i not in own]
        """Those that are."""
        self.constraint_models = pin.StdVec_ConstraintModel()
        for i in self.anchors:
            kind = (
                pin.PointAnchorConstraintModel
                if _is_point(self.closures[i])
                else pin.FrameAnchorConstraintModel
            )
            self.constraint_models.append(pin.ConstraintModel(kind(model, *self.ends[i])))
        self.lengths = length_coordinates(model)[1]
        """Which of v are rates of lengths."""
        self._own = Own(lambda: _Evaluation(self))

    @property
    def data(self) -> pin.Data:
        """Joint placements and Jacobians of the last configuration that this thread gave to `at`."""
        return self._own.here.data

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
        return self._own.here.at(q)

    def move(self, q: FloatArray, v: FloatArray, a: FloatArray | None = None) -> None:
        """Bring the velocities and accelerations of all bodies into `data`.

        Parameters
        ----------
        q : (nq,) array
            The configuration.
        v, a : (nv,) array
            Velocity and acceleration; zero acceleration by default.
        """
        self._own.here.move(q, v, a)

    def acceleration(self) -> FloatArray:
        """Return the closures' relative acceleration d(J v)/dt (rows,) of the motion given to `move`.

        With zero joint acceleration it is the drift J̇ v. It is exact also where the loops are a little open.
        """
        return self._own.here.acceleration()

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

    def gaps(self, error: FloatArray) -> FloatArray:
        """Return how far each closure and coupling is open: the longer of distance and rotation vector."""
        if not self.size:
            return np.zeros((*error.shape[:-1], 0))
        sizes = np.sqrt(np.add.reduceat(error * error, self._parts, axis=-1))
        return np.asarray(np.maximum.reduceat(sizes, self._first_parts, axis=-1))

    def worst(self, error: FloatArray) -> str:
        """Return what is open the most: ``closure`` or ``coupling``, and its name."""
        sizes = [max_abs(error[rows]) for rows in self.rows]
        return self.names[int(np.argmax(sizes))]

    def _ends(self, closure: Closure) -> Ends:
        frame1, frame2 = (
            self.frame(name, f"closure {one_line(closure.name)}", ModelError)
            for name in (closure.frame1, closure.frame2)
        )
        if frame1.parentJoint == frame2.parentJoint:
            raise ModelError(f"closure {one_line(closure.name)}: both frames are on the same body")
        placements = frame1.placement.copy(), frame2.placement.copy()
        return frame1.parentJoint, placements[0], frame2.parentJoint, placements[1]


class _Evaluation:
    """The closures at one configuration after the other, for one thread: all that is written to.

    Its `data` always holds the joint placements and Jacobians of the last configuration.
    """

    def __init__(self, kinematics: LoopKinematics) -> None:
        k = self._k = kinematics
        self.model, self.plain = k.model, k.plain
        self.data = k.model.createData()
        closures, ends, rows = ([part[i] for i in k.own] for part in (k.closures, k.ends, k.rows))
        self._others = OtherClosures(k.model, closures, ends, rows) if closures else None
        self._anchored = np.array([r for i in k.anchors for r in range(k.size)[k.rows[i]]], int)
        self._constraint_datas = pin.StdVec_ConstraintData()
        for constraint in k.constraint_models:
            self._constraint_datas.append(constraint.createData())
        # Taken out once the vectors have their final place in memory: they are references, and so are the
        # arrays that `calc` writes to.
        self._pairs = list(zip(k.constraint_models, self._constraint_datas, strict=True))
        contents = [data.extract() for data in self._constraint_datas]
        self._errors = [content.constraint_position_error for content in contents]
        self._accelerations = [content.constraint_acceleration_error for content in contents]
        self._contents = contents  # own that memory
        self._zero = np.zeros(k.model.nv)
        self._last: ClosurePoint | None = None
        self._key = b""

    def at(self, q: FloatArray) -> ClosurePoint:
        """`LoopKinematics.at`."""
        key = q.tobytes()
        if self._last is not None and key == self._key:
            return self._last
        pin.computeJointJacobians(self.model, self.data, q)
        self._calculate()
        return self._evaluated(q, key)

    def _calculate(self) -> None:
        """Let the constraint models look at what `data` holds."""
        model, data = self.model, self.data
        for constraint, own in self._pairs:
            constraint.calc(model, data, own)
        if self._others is not None:
            self._others.calculate(data)

    def _evaluated(self, q: FloatArray, key: bytes) -> ClosurePoint:
        """Return the closures at the configuration that `data` and the constraint models hold."""
        error = np.concatenate(self._errors) if self._errors else np.zeros(0)
        J = self._anchor_jacobian()
        if not self.plain:
            error, J = self._complete(q, error, J)
        self._key = key
        self._last = ClosurePoint(q.copy(), error, J)
        return self._last

    def _anchor_jacobian(self) -> Any:
        """Return the rows of the constraint models."""
        if not self._pairs:
            return np.zeros((0, self.model.nv))
        models = self._k.constraint_models
        return pin.getConstraintsJacobian(self.model, self.data, models, self._constraint_datas)

    def _complete(
        self, q: FloatArray, errors: FloatArray, anchored: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the errors and the Jacobian of all rows, those of the constraint models being known."""
        k = self._k
        error, J = np.zeros(k.size), np.zeros((k.size, self.model.nv))
        if self._pairs:
            error[self._anchored], J[self._anchored] = errors, anchored
        if self._others is not None:
            self._others.evaluate(self.data, error, J)
        if k.couplings.size:
            error[k.coupled] = k.couplings.errors(q)
            J[k.coupled] = k.couplings.jacobian(q)
        return error, J

    def move(self, q: FloatArray, v: FloatArray, a: FloatArray | None) -> None:
        """`LoopKinematics.move`."""
        self._v, self._a = v, self._zero if a is None else a
        pin.forwardKinematics(self.model, self.data, q, v, self._a)
        key = q.tobytes()
        known = self._last is not None and key == self._key
        if not known:
            pin.computeJointJacobians(self.model, self.data)
        self._calculate()
        if not known:
            self._evaluated(q, key)

    def acceleration(self) -> FloatArray:
        """`LoopKinematics.acceleration`."""
        anchored: FloatArray = np.concatenate(self._accelerations) if self._accelerations else np.zeros(0)
        if self.plain:
            return anchored
        k = self._k
        result = np.zeros(k.size)
        if self._pairs:
            result[self._anchored] = anchored
        if self._others is not None:
            self._others.accelerate(result)
        if k.couplings.size and self._last is not None:
            J = self._last.J[k.coupled]
            result[k.coupled] = k.couplings.drift(self._last.q, self._v) + J @ self._a
        return result


def max_abs(values: FloatArray) -> float:
    """Return the largest absolute value, zero for an empty array."""
    return float(np.abs(values).max()) if values.size else 0.0


def _is_point(closure: Closure) -> bool:
    return closure.kind == "3d"


def _frames_by_name(model: pin.Model) -> dict[str, int]:
    """Frame index by name; links take precedence over joints of the same name."""
    indices: dict[str, int] = {}
    for index, frame in enumerate(model.frames):
        if frame.name not in indices or frame.type == pin.FrameType.BODY:
            indices[frame.name] = index
    return indices
