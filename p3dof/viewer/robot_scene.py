"""`RobotScene`: any robot to look at, its solids and the forces of its actuators as arrows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, FrozenArrays, as_floats, frozen_array, shown
from p3dof.errors import InputError
from p3dof.viewer.arrows import draw_arrow, set_length
from p3dof.viewer.drawing import Drawable, Drawing
from p3dof.viewer.stage import colour_number, draw_floor, enlargement, mesh_of, set_stage
from p3dof.viewer.window import SceneWindow

_LOOKED_AT = 200
"""At so many configurations at most it is looked how much room a robot takes."""
_COLOURS = ((0.0, 0.45, 0.70), (0.84, 0.37, 0.0), (0.0, 0.62, 0.45), (0.80, 0.47, 0.65))
"""Of the actuators' arrows; told apart by colour-blind readers."""
_LONGEST = 0.6
"""Length of the longest arrow, as a share of half the robot's size."""


@dataclass(frozen=True, eq=False)
class JointMotion(FrozenArrays):
    """Joint positions over time, and the forces of the actuators if they are known.

    Parameters
    ----------
    time : array-like, shape (N,)
        Strictly rising times [s].
    q : array-like, shape (N, nq)
        Configurations in Pinocchio's order [m, rad], as of a run of a `ConstrainedPlant`.
    actuated : tuple of str
        Names of the n actuated joints, as of `p3dof.ClosedLoopModel.actuated`.
    forces : array-like, shape (N, n), optional
        Of the actuators [N or N m]; NaN where they are not determined. Without, no actuator is shown.

    Raises
    ------
    InputError
        If shapes do not fit, times do not rise, or a time or a joint is not finite.
    """

    time: FloatArray
    q: FloatArray
    actuated: tuple[str, ...] = ()
    forces: ArrayLike | None = None

    def __post_init__(self) -> None:
        time = frozen_array("time", self.time, ("N",))
        if not len(time):
            raise InputError("time: expected at least one sample, got none")
        if np.any(np.diff(time) <= 0):
            raise InputError("time: expected strictly rising times")
        q = as_floats("q", self.q)
        count = q.shape[1] if q.ndim == 2 else 0
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "q", frozen_array("q", q, (len(time), count)))
        names = () if self.forces is None else tuple(self.actuated)
        shape = len(time), len(names)
        forces = np.empty(shape) if self.forces is None else as_floats("forces", self.forces).copy()
        if forces.shape != shape:
            raise InputError(f"forces: expected shape {shape}, got {forces.shape}")
        forces.setflags(write=False)
        object.__setattr__(self, "actuated", names)
        object.__setattr__(self, "forces", forces)

    @property
    def known(self) -> FloatArray:
        """The forces, shape (N, n); no column without."""
        return np.asarray(self.forces)


class RobotScene(Drawing):
    """Any robot in a window, at the beginning of its motion at first.

    Parameters
    ----------
    robot : Drawable
        Its tree and its solids: ``model`` and ``visual_model``.
    motion : JointMotion
        What will be shown: the picture has room for all of it, the longest arrow is for its largest force.
    window : SceneWindow, optional
        What to draw into; a new one by default.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    InputError
        If an argument does not fit the robot.
    """

    def __init__(self, robot: Drawable, motion: JointMotion, window: SceneWindow | None = None) -> None:
        super().__init__(robot, window)
        if not isinstance(motion, JointMotion):
            raise InputError(f"motion: expected a JointMotion, got {shown(motion)}")
        if motion.q.shape[1] != self.model.nq:
            raise InputError(f"q: expected shape (N, {self.model.nq}), got {motion.q.shape}")
        self._data = self.model.createData()
        self._actuators = [_actuator(self.model, name) for name in motion.actuated]
        points = self._room_taken(motion.q)
        low, high = points.min(axis=0), points.max(axis=0)
        self.half = max(float(np.max(high - low)) / 2, np.finfo(float).tiny)
        self.colours = _colours(len(motion.actuated))
        self.largest = _largest(self.units, motion.known)
        self._radius = 0.02 * self.half
        arrow = _LONGEST * self.half if motion.actuated else 0.0
        corners = np.array(list(product(*zip(low - arrow, high + arrow, strict=True))))
        x, y, _ = ((low + high) / 2).tolist()
        set_stage(self._viewer, corners, enlargement(self.half), (x, y))
        draw_floor(self._viewer["scenery/floor"], self.half, float(low[2]))
        self._draw_arrows()
        self.display(motion.q[0], motion.known[0])

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each actuator's force: N along a joint, N m about it."""
        return tuple("N" if sliding else "N m" for _, sliding in self._actuators)

    @property
    def mesh(self) -> float:
        """Distance between the lines of the floor [m]."""
        return mesh_of(self.half)

    def display(self, q: ArrayLike, forces: ArrayLike | None = None) -> None:
        """Show the robot at joint positions, and the forces of its actuators.

        An arrow stands at its joint and points along the axis, for a torque by the right-hand rule.

        Parameters
        ----------
        q : array-like, shape (nq,)
            Joints in Pinocchio's order [m, rad].
        forces : array-like, shape (n,), optional
            Of the actuators [N or N m]; there is no arrow for NaN, and none without.

        Raises
        ------
        InputError
            If a shape does not fit, or a joint is not finite.
        """
        joints = self.place(q)
        count = len(self._actuators)
        given = np.full(count, np.nan) if forces is None else as_floats("forces", forces)
        if given.shape != (count,):
            raise InputError(f"forces: expected shape ({count},), got {given.shape}")
        pin.computeJointJacobians(self.model, self._data, joints)
        for i, (joint, sliding) in enumerate(self._actuators):
            node = self._viewer["forces"][str(i)]
            node.set_transform(self._along(joint, sliding))
            largest = self.largest[self.units[i]]
            set_length(node, _LONGEST * self.half * given[i] / largest, self._radius)

    def _along(self, joint: int, sliding: bool) -> FloatArray:
        """Return a matrix whose third axis is that of an actuated joint, at its origin."""
        column = np.asarray(self._data.J).reshape(6, -1)[:, self.model.idx_vs[joint]]
        axis = column[:3] if sliding else column[3:]
        matrix = np.eye(4)
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(axis))
        matrix[:3, :3] = turn.toRotationMatrix()
        matrix[:3, 3] = self._data.oMi[joint].translation
        return matrix

    def _draw_arrows(self) -> None:
        import meshcat.geometry as mg

        for i, colour in enumerate(self.colours):
            material = mg.MeshLambertMaterial(color=colour_number(colour))
            draw_arrow(self._viewer["forces"][str(i)], self._radius, material)

    def _room_taken(self, q: FloatArray) -> FloatArray:
        """Return points (N, 3) that hold all solids, or the joints of a robot without, along a motion."""
        some = np.unique(np.linspace(0, len(q) - 1, min(len(q), _LOOKED_AT)).round().astype(int))
        solids = list(self.visual_model.geometryObjects)
        for solid in solids:
            solid.geometry.computeLocalAABB()
        points = []
        for row in q[some]:
            pin.forwardKinematics(self.model, self._data, row)
            places = list(self._data.oMi)
            if not solids:
                points += [place.translation.copy() for place in places]
            for solid in solids:
                centre = (places[solid.parentJoint] * solid.placement).act(solid.geometry.aabb_center)
                size = solid.geometry.aabb_radius * np.max(solid.meshScale)
                points += [centre - size, centre + size]
        return np.array(points)


def _actuator(model: pin.Model, name: str) -> tuple[int, bool]:
    """Return an actuated joint, and whether it slides."""
    if not model.existJointName(name):
        raise InputError(f"actuated: the joint {name!r} does not exist")
    joint = model.getJointId(name)
    freedoms = model.nvs[joint]
    if freedoms != 1:
        raise InputError(f"actuated: expected joints with one degree of freedom, {name!r} has {freedoms}")
    return joint, "JointModelP" in model.joints[joint].shortname()


def _largest(units: tuple[str, ...], forces: FloatArray) -> dict[str, float]:
    """Return the largest force by its unit; 1 where there is none."""
    found = dict.fromkeys(units, 0.0)
    for unit, column in zip(units, forces.T, strict=True):
        found[unit] = max(found[unit], float(np.abs(column[np.isfinite(column)]).max(initial=0.0)))
    return {unit: value if value > np.finfo(float).tiny else 1.0 for unit, value in found.items()}


def _colours(count: int) -> tuple[Sequence[float], ...]:
    return tuple(_COLOURS[i % len(_COLOURS)] for i in range(count))
