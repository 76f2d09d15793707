"""`RobotScene`: any robot to look at, its solids, its closures and the forces on it as arrows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, as_floats, shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.closure_wrenches import ClosureWrenches
from p3dof.errors import InputError
from p3dof.page.drawable import Drawable
from p3dof.page.measures import enlargement, mesh_of
from p3dof.page.robots.motion import JointMotion, Moment
from p3dof.page.robots.room import corners_of, some_of
from p3dof.page.robots.sticks import thickness
from p3dof.viewer.drawing import ROOT, Drawing
from p3dof.viewer.robots.arrows import (
    ACTUATORS,
    LONGEST,
    UNITS,
    Arrow,
    RobotArrows,
    actuator_arrows,
    closure_arrows,
    wrench_arrows,
)
from p3dof.viewer.robots.closures import MOST_NUMBERS, ClosureMarks
from p3dof.viewer.robots.layers import LAYERS, Layers
from p3dof.viewer.robots.skins import draw_skins
from p3dof.viewer.robots.slides import Slides
from p3dof.viewer.stage import draw_floor, number, set_stage
from p3dof.viewer.window import SceneWindow

_STEP = 0.01
"""By so much at least the picture gets smaller or larger."""
_FILLED = 0.84
"""How much of the picture is filled: words are beside the robot."""


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
    loop : ClosedLoopModel, optional
        Its closures are drawn too, and the forces in them.
    layers : mapping of str to bool, optional
        What is to be seen or not, see `LAYERS`; the others are as usual.

    Attributes
    ----------
    half : float
        Half the size of the robot [m].
    layers : Layers
        What is seen.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    InputError
        If an argument does not fit the robot.
    """

    def __init__(
        self,
        robot: Drawable,
        motion: JointMotion,
        window: SceneWindow | None = None,
        loop: ClosedLoopModel | None = None,
        layers: Mapping[str, bool] | None = None,
    ) -> None:
        super().__init__(robot, window)
        if not isinstance(motion, JointMotion):
            raise InputError(f"motion: expected a JointMotion, got {shown(motion)}")
        if motion.q.shape[1] != self.model.nq:
            raise InputError(f"q: expected shape (N, {self.model.nq}), got {motion.q.shape}")
        self._loop = loop
        self._share = 1.0
        self._sticks = frozenset(getattr(robot, "sticks", ()))
        self._usual: Mapping[str, bool] = getattr(robot, "usual", {})
        draw_skins(self._solid, getattr(robot, "skins", {}))
        self._wrenches = None if loop is None else ClosureWrenches(loop)
        rows = 0 if loop is None else sum(span.stop - span.start for span in loop.constraint_rows)
        if loop is not None and motion.closing.shape[1] not in (0, rows):
            raise InputError(f"multipliers: expected shape (N, {rows}), got {motion.closing.shape}")
        self._data = self.model.createData()
        self._actuators = [_actuator(self.model, name) for name in motion.actuated]
        self._frames = {name: _frame(self.model, name) for name in motion.acting}
        self.colours = _colours(len(motion.actuated))
        self._boxes = [(solid, corners_of(solid)) for solid in self.visual_model.geometryObjects]
        solids = self._room_taken(motion.q)
        low, high = solids.min(axis=0), solids.max(axis=0)
        self.half = max(float(np.max(high - low)) / 2, np.finfo(float).tiny)
        self._arrows = RobotArrows(self._viewer, LONGEST * self.half, 0.018 * self.half)
        seen = [self._forces(motion.sample(int(i))) for i in some_of(len(motion.time))]
        sizes = np.nanmax(np.abs(motion.known), axis=0, initial=0.0)
        self._arrows.scale_to((a for arrows in seen for a in arrows), zip(self.units, sizes, strict=True))
        self._draw()
        self.layers = Layers(self._viewer, self._present(), layers)
        ends = [self._arrows.ends(a for a in arrows if self.layers.shows(a.name)) for arrows in seen]
        points = np.concatenate((solids, *ends, *self._numbers(motion.q)))
        self._set_stage(points, float(low[2]))
        self.show(motion.sample(0))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each actuator's force: N along a joint, N m about it."""
        return tuple(UNITS[0 if sliding else 1] for _, sliding in self._actuators)

    @property
    def mesh(self) -> float:
        """Distance between the lines of the floor [m]."""
        return mesh_of(self.half)

    @property
    def largest(self) -> dict[str, float]:
        """What the longest arrow stands for, by unit [N, N m]."""
        return self._arrows.largest

    @property
    def legend(self) -> str:
        """How long the arrows are, in words."""
        longest = [f"{number(self.largest[unit])} {unit}" for unit in UNITS if unit in self.largest]
        return f"The longest arrow is {' and '.join(longest)}." if longest else ""

    def display(
        self,
        q: ArrayLike,
        forces: ArrayLike | None = None,
        multipliers: ArrayLike | None = None,
        wrenches: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Show the robot at joint positions, and the forces on it.

        The arrow of an actuator stands at its joint and points along the axis, for a torque by the right-hand
        rule; it has two heads then. That of a closure is what it exerts on the body of its second frame.

        Parameters
        ----------
        q : array-like, shape (nq,)
            Joints in Pinocchio's order [m, rad].
        forces : array-like, shape (n,), optional
            Of the actuators [N or N m]; there is no arrow for NaN, and none without.
        multipliers : array-like, shape (rows,), optional
            Of closures and couplings; the arrow of a closure is pale where some of its own are NaN, and there
            is none where all are.
        wrenches : mapping of str to array-like, shape (6,), optional
            External wrenches by frame: those of the motion only.

        Raises
        ------
        InputError
            If a shape does not fit, or a joint is not finite.
        """
        count = len(self._actuators)
        given = np.full(count, np.nan) if forces is None else as_floats("forces", forces)
        closing = np.zeros(0) if multipliers is None else as_floats("multipliers", multipliers)
        acting = {name: as_floats(f"wrench {name}", w) for name, w in (wrenches or {}).items()}
        self.show(Moment(as_floats("q", q), given, closing, acting))

    def show(self, moment: Moment, by_hand: bool = False) -> None:
        """Show a moment.

        Parameters
        ----------
        moment : Moment
            Joints and forces.
        by_hand : bool
            Whether it is beyond the motion: the scale of the arrows may change then to that of these forces,
            and the picture gets smaller rather than that some of the robot is out of it.

        Raises
        ------
        InputError
            If a shape does not fit, or a joint is not finite.
        """
        self.place(moment.q)
        arrows = self._forces(moment)
        if by_hand:
            self._arrows.fit(arrows)
        share = self._sight.share(self._points()) if by_hand else 1.0
        if abs(share - self._share) > _STEP * share or share == 1.0 != self._share:
            self._viewer.set_transform(self._sight.transform(share))
            self._share = share
        self._arrows.show(arrows)
        if self._wrenches is not None:
            self._marks.place(*self._wrenches.places(moment.q))
        if self._slides is not None:
            self._slides.place(self._data)

    def _forces(self, moment: Moment) -> list[Arrow]:
        """Return all forces of a moment."""
        if moment.forces.shape != (len(self._actuators),):
            raise InputError(f"forces: expected shape ({len(self._actuators)},), got {moment.forces.shape}")
        pin.computeJointJacobians(self.model, self._data, np.array(moment.q))
        arrows = actuator_arrows(self._data, self.model, self._actuators, moment.forces)
        if self._wrenches is not None and moment.multipliers.size:
            arrows += closure_arrows(self._wrenches.at(moment.q, moment.multipliers), moment.smallest)
        if moment.wrenches:
            arrows += wrench_arrows(self._data, self._frames, moment.wrenches)
        return arrows

    def _draw(self) -> None:
        self._arrows.draw_actuators(self.units, self.colours)
        self._arrows.draw_wrenches(self._frames)
        radius = 0.0 if self._loop is None else 0.5 * thickness(self._loop)
        self._slides = Slides(self._viewer, self.model, radius) if radius and self._sticks else None
        if self._loop is not None:
            closures = self._loop.sidecar.closures
            through = len(self._sticks) < len(self.visual_model.geometryObjects)  # shapes may hide them
            size = max(2.2 * thickness(self._loop), (0.03 if through else 0.012) * self.half)
            self._marks = ClosureMarks(self._viewer, closures, min(size, 0.05 * self.half), through)
            self._arrows.draw_closures([c.kind not in ("3d", "distance") for c in closures], through)

    def _present(self) -> dict[str, tuple[bool, Sequence[str]]]:
        """Return which layers there are: whether they are seen usually, and their nodes."""
        count = 0 if self._loop is None else len(self._loop.sidecar.closures)
        names = [str(solid.name) for solid in self.visual_model.geometryObjects]
        paths = {
            "shapes": [f"{ROOT}/visuals/{name}" for name in names if name not in self._sticks],
            "sticks": [f"{ROOT}/visuals/{name}" for name in names if name in self._sticks]
            + (["slides"] if self._slides and self._slides.joints else []),
            "forces": ["forces"] if self._actuators else [],
            "closures": ["closures"] if count else [],
            "numbers": ["closure_numbers"] if count else [],
            "closure_forces": ["closure_forces"] if count else [],
            "wrenches": ["wrenches"] if self._frames else [],
        }
        usual = {**dict.fromkeys(LAYERS, True), "closure_forces": False, "numbers": count <= MOST_NUMBERS}
        usual.update(self._usual)
        return {name: (usual[name], nodes) for name, nodes in paths.items() if nodes}

    def _set_stage(self, points: FloatArray, bottom: float) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        x, y, _ = ((low + high) / 2).tolist()
        self._sight = set_stage(self._viewer, points, enlargement(self.half), (x, y), _FILLED)
        draw_floor(self._viewer["scenery/floor"], self.half, bottom, (x, y))

    def _room_taken(self, q: FloatArray) -> FloatArray:
        """Return points (N, 3) that hold all solids, or the joints of a robot without, along a motion."""
        points: list[Any] = []
        for row in q[some_of(len(q))]:
            pin.forwardKinematics(self.model, self._data, row)
            points.append(self._points())
        return np.concatenate(points)

    def _numbers(self, q: FloatArray) -> list[FloatArray]:
        """Return where the numbers of the closures reach to along a motion, if they are seen."""
        if self._wrenches is None or not self.layers.seen.get("numbers", False):
            return []
        return [self._marks.tops(*self._wrenches.places(row)) for row in q[some_of(len(q))]]

    def _points(self) -> FloatArray:
        """Return points (N, 3) that hold all solids at the joint placements computed last."""
        places = list(self._data.oMi)
        if not self._boxes:
            return np.array([place.translation for place in places])
        points = []
        for solid, box in self._boxes:
            place = places[solid.parentJoint] * solid.placement
            points.append(box @ place.rotation.T + place.translation)
        return np.concatenate(points)


def _actuator(model: pin.Model, name: str) -> tuple[int, bool]:
    """Return an actuated joint, and whether it slides."""
    if not model.existJointName(name):
        raise InputError(f"actuated: the joint {name!r} does not exist")
    joint = model.getJointId(name)
    freedoms = model.nvs[joint]
    if freedoms != 1:
        raise InputError(f"actuated: expected joints with one degree of freedom, {name!r} has {freedoms}")
    return joint, "JointModelP" in model.joints[joint].shortname()


def _frame(model: pin.Model, name: str) -> tuple[int, pin.SE3]:
    """Return the joint that carries a frame, and where it is in the axes of the joint."""
    if not model.existFrame(name):
        raise InputError(f"wrenches: the frame {shown(name)} does not exist")
    body = model.existFrame(name, pin.FrameType.BODY)  # links go before joints of the same name
    index = model.getFrameId(name, pin.FrameType.BODY) if body else model.getFrameId(name)
    frame = model.frames[index]
    return int(frame.parentJoint), frame.placement.copy()


def _colours(count: int) -> tuple[Sequence[float], ...]:
    return tuple(ACTUATORS[i % len(ACTUATORS)] for i in range(count))
