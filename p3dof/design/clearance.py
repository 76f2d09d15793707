"""`clearance_of`: how near the parts of a machine come to each other, to payloads and to obstacles.

Legs, rods and cross-bars are capsules, sliders and frame boxes, the platform is a prism: the solids that are
drawn (`p3dof.machine.description.shapes`), with rounded ends. The corners of the platform are polygons of
`CORNERS` edges around the round ones. Distances of convex shapes are those of coal (GJK; of shapes that
overlap EPA). Positions are closed forms.

Surroundings files: YAML.

The form of a file::

    payload: {size: [120 mm, 80 mm, 60 mm], at: [0, 0, 60 mm]}      # in the platform's axes, from P
    obstacles:                                                      # in the fixed frame
      - {name: table, size: [600 mm, 900 mm, 20 mm], at: [0, 0, -560 mm]}
      - {name: post, ends: [[0.2, 0.1, -0.6], [0.2, 0.1, 0]], radius: 20 mm}
    dimensions: {rod_radius: 8 mm}                                  # the others in proportion to the paper's
    ignored: [[payload, table]]

Numbers are in SI units, or have one of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, not_negative, positive, require, shown
from p3dof._base.errors import InputError, MissingExtraError, OptimisationError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof._base.quantities import ANGLE, LENGTH, Quantity
from p3dof._base.tables import (
    NONE,
    POSE_COLUMNS,
    Cell,
    ShownInNotebook,
    Table,
    Tabular,
    columns_by,
    html_of,
    notebook_html,
    number,
)
from p3dof.analysis.workspace import Workspace
from p3dof.closed_form.kinematics import mechanism_motion
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.machine.description.mechanism import Box, Cylinder, Sphere
from p3dof.machine.description.shapes import Solids
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Dimensions, Parameters
from p3dof.machine.parameters.machine import named, read_fields, read_sizes
from p3dof.machine.parameters.solids import sizes_given
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics

CORNERS = 64
"""Edges of the polygon around a round corner of the platform: it stands out by 0.12 % of the radius."""

ACCURACY = 1e-4
"""By how much distances between samples may be less than what is found, where it can be had [m]."""

FRAME = "base_link"
_PLATFORM = "platform"
_JOINED = (
    *((FRAME, f"slider_{leg}") for leg in "abc"),
    *((f"slider_{leg}", f"leg_{leg}") for leg in "ab"),
    *((f"leg_{leg}", _PLATFORM) for leg in "ab"),
    ("slider_c", "crossbar_upper"),
    *(pair for side in ("left", "right") for pair in (
        ("crossbar_upper", f"rod_{side}"), (f"rod_{side}", "crossbar_lower"))),
    ("crossbar_lower", _PLATFORM),
)  # fmt: skip
"""Neighbours: what joints and loop closures join."""
_EXACT = 1e-12  # tolerances of GJK and EPA, which end sooner with polyhedra and capsules
_ROUNDS, _INNER = 14, 5  # of a search for a minimum: each round leaves a third of its bracket
_BLOCK = 200  # samples whose corners are in the memory at a time
_MOST = 60_000  # distances that are computed between samples at most
_GRID = (9, 9, 3)  # poses of a workspace along y, θ and z
_STARTS = 3  # poses of the grid that each pair is followed from
_MOVES, _SMALLEST = 2_000, 1e-7  # of a pair, each to the best of its neighbours or to half the step


@dataclass(frozen=True)
class CollisionShape(Readable):
    """A box, or a capsule, that is fixed to the platform or to the frame.

    Parameters
    ----------
    name : str
        What tables call it.
    size : array-like, shape (3,), optional
        Edges of a box [m].
    at : array-like, shape (3,)
        Its middle [m]: from P in the platform's axes, or in the fixed frame.
    turn : array-like, shape (3,)
        Its angles about x, y and z of that frame, one after the other [rad].
    ends : array-like, shape (2, 3), optional
        Instead: the ends of the axis of a capsule [m].
    radius : float, optional
        Of the capsule [m].

    Raises
    ------
    ParameterError
        If it is neither a box nor a capsule, or both, or a size is not positive.
    """

    name: str
    size: tuple[float, float, float] | None = None
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ends: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    radius: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not (self.name and self.name.isprintable()):
            raise ParameterError(f"name: expected a printable text, got {shown(self.name)}")
        if (self.size is None) == (self.ends is None) or (self.ends is None) != (self.radius is None):
            raise ParameterError(f"{self.name}: expected size, or ends and radius")
        for name in ("at", "turn"):
            self._set(name, frozen_array(name, getattr(self, name), (3,), ParameterError).tolist())
        if self.size is not None:
            edges = frozen_array("size", self.size, (3,), ParameterError)
            self._set("size", [positive("size", float(edge), ParameterError) for edge in edges])
            return
        if any(self.at) or any(self.turn):
            raise ParameterError(f"{self.name}: expected at and turn of a box only")
        ends = frozen_array("ends", self.ends, (2, 3), ParameterError)
        object.__setattr__(self, "ends", tuple(tuple(row) for row in ends.tolist()))
        object.__setattr__(self, "radius", positive("radius", self.radius, ParameterError))

    def _set(self, name: str, values: list[float]) -> None:
        object.__setattr__(self, name, tuple(values))


@dataclass(frozen=True)
class Surroundings(Readable):
    """What a machine carries, what stands around it, and how thick its own parts are.

    Parameters
    ----------
    payload, obstacles : sequence of CollisionShape
        What is fixed to the platform, and to the frame.
    dimensions : mapping of str to float
        Sizes of the machine's solids that differ from its own, by the names of `Dimensions` [m].
    ignored : sequence of pair of str
        Pairs of parts that are not looked at, by their names.

    Raises
    ------
    ParameterError
        If a name is used twice, or something is of another kind.
    """

    payload: Sequence[CollisionShape] = ()
    obstacles: Sequence[CollisionShape] = ()
    dimensions: Mapping[str, float] = field(default_factory=dict)
    ignored: Sequence[tuple[str, str]] = ()

    def __post_init__(self) -> None:
        for name in ("payload", "obstacles"):
            given = getattr(self, name)
            shapes = tuple(given) if isinstance(given, list | tuple) else (given,)
            for one in shapes:
                if not isinstance(one, CollisionShape):
                    raise ParameterError(f"{name}: expected a CollisionShape, got {shown(one)}")
            object.__setattr__(self, name, shapes)
        object.__setattr__(self, "dimensions", sizes_given(self.dimensions))
        object.__setattr__(self, "ignored", _pairs(self.ignored))
        names = [*_BODIES, *(one.name for one in (*self.payload, *self.obstacles))]
        for name in names:
            if names.count(name) > 1:
                raise ParameterError(f"the name {name!r} is used more than once")
        for name in (name for pair in self.ignored for name in pair):
            if name not in names:
                raise ParameterError(f"ignored: there is no part {name!r}, only {', '.join(names)}")


def _pairs(given: Any) -> tuple[tuple[str, str], ...]:
    pairs = list(given) if isinstance(given, list | tuple) else [given]
    for pair in pairs:
        named = isinstance(pair, list | tuple) and len(pair) == 2
        if not named or not all(isinstance(name, str) for name in pair):
            raise ParameterError(f"ignored: expected pairs of names of parts, got {shown(pair)}")
    return tuple((one, other) for one, other in pairs)


_BODIES = tuple(dict.fromkeys(name for pair in _JOINED for name in pair))

_NUMBERS: Mapping[str, Quantity] = {
    "size": LENGTH,
    "at": LENGTH,
    "turn": ANGLE,
    "ends": LENGTH,
    "radius": LENGTH,
}


def read_surroundings(path: Source) -> Surroundings:
    """Read what a machine carries and what stands around it from a YAML file as above.

    Parameters
    ----------
    path : path-like, or text file
        The file.

    Raises
    ------
    ParameterError
        If a field is missing, unknown, or does not fit; the message names file and field.
    FileError
        If it cannot be read.
    """
    source = called(path)
    known = [item.name for item in fields(Surroundings)]
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {}
    for name, usual in (("payload", "payload"), ("obstacles", None)):
        given = data.get(name, [])
        rows = given if isinstance(given, list) else [given]
        parts[name] = [
            _read_shape(row, f"{source}: {name}" + f"[{k}]" * (given is rows), usual)
            for k, row in enumerate(rows)
        ]
    parts["dimensions"] = read_sizes(data.get("dimensions", {}), source)
    parts["ignored"] = data.get("ignored", [])
    return named(source, lambda: Surroundings(**parts))


def _read_shape(data: Any, where: str, usual: str | None) -> CollisionShape:
    known = [item.name for item in fields(CollisionShape)]
    data = read_fields(data, where, ("name",) if usual is None else (), known)
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    return named(where, lambda: CollisionShape(**{"name": usual, **values}))


class _Solid(NamedTuple):
    """One convex shape of a part, in the axes of what it is fixed to."""

    shape: Any  # of coal
    rotation: FloatArray  # (3, 3)
    position: FloatArray  # (3,) [m]
    corners: FloatArray  # (V, 3): of what is swept by a ball [m]
    radius: float  # of the ball [m]


class _States(NamedTuple):
    """States of a motion, at times in any order."""

    time: FloatArray  # (K,) [s]
    pose: FloatArray  # (K, 3), as of `Motion`
    velocity: FloatArray


class _Part(NamedTuple):
    """What is looked at as one."""

    name: str
    body: str  # what it is fixed to
    solids: tuple[_Solid, ...]


class CollisionModel:
    """The parts of one machine with its surroundings, and their distances at poses."""

    def __init__(self, parameters: Parameters, surroundings: Surroundings | None = None) -> None:
        self.around = around = Surroundings() if surroundings is None else surroundings
        self.geometry = parameters.geometry
        import pinocchio as pin

        sizes = {**parameters.dimensions, **around.dimensions}
        self.parts = _parts_of(replace(parameters, dimensions=sizes), around)
        self.pairs = self._looked_at(around)
        solids = [(one, number) for number, part in enumerate(self.parts) for one in part.solids]
        self._solids = [one for one, _ in solids]
        self._bodies = [self.parts[number].body for _, number in solids]
        self._moving = [k for k, body in enumerate(self._bodies) if body != FRAME]
        self._pin = pin
        self._model = pin.GeometryModel()
        for k, one in enumerate(self._solids):
            place = pin.SE3(one.rotation, one.position)
            self._model.addGeometryObject(pin.GeometryObject(str(k), 0, place, one.shape))
        rows: list[NDArray[np.int_]] = []
        for pair in self.pairs:
            first, second = ([k for k, (_, n) in enumerate(solids) if n == number] for number in pair)
            rows.append(len(self._model.collisionPairs) + np.arange(len(first) * len(second)))
            for solid, other in product(first, second):
                self._model.addCollisionPair(pin.CollisionPair(solid, other))
        self._rows = rows  # pairs of solids of each pair of parts
        self._starts = np.array([row[0] for row in rows], dtype=int)
        self._data = pin.GeometryData(self._model)
        for k, one in enumerate(self._solids):
            self._data.oMg[k] = pin.SE3(one.rotation, one.position)
        for request in self._data.distanceRequests:
            request.gjk_tolerance = request.epa_tolerance = _EXACT
            request.gjk_max_iterations = request.epa_max_iterations = 1000

    @cached_property
    def names(self) -> tuple[tuple[str, str], ...]:
        """The pairs of parts that are looked at, by name."""
        return tuple((self.parts[i].name, self.parts[j].name) for i, j in self.pairs)

    def _looked_at(self, around: Surroundings) -> tuple[tuple[int, int], ...]:
        """Return the pairs of parts that move against each other and are no neighbours."""
        out = {frozenset(pair) for pair in (*_JOINED, *around.ignored)}
        return tuple(
            (i, j)
            for (i, one), (j, other) in combinations(enumerate(self.parts), 2)
            if one.body != other.body and frozenset((one.name, other.name)) not in out
        )

    def distances(self, pose: FloatArray, asked: NDArray[np.int_] | None = None) -> FloatArray:
        """Return the distances of all pairs of parts at poses, (N, P) [m]; negative where they overlap.

        With `asked`, only that of one pair at each pose, (N,).
        """
        rotation, position = self._placed(pose)
        found = np.empty((len(pose), len(self.pairs)) if asked is None else len(pose))
        for k in range(len(pose)):
            self._put(rotation[k], position[k])
            if asked is None:
                self._pin.computeDistances(self._model, self._data)
                values = [one.min_distance for one in self._data.distanceResults]
                found[k] = np.minimum.reduceat(values, self._starts)
            else:
                found[k] = min(self._distance(int(row)) for row in self._rows[asked[k]])
        return found

    def points(self, pose: FloatArray, pair: int) -> FloatArray:
        """Return where two parts are nearest to each other at a pose, or overlap most, (2, 3) [m]."""
        return np.asarray(self.points_over(pose[None], np.array([pair]))[0])

    def points_over(self, pose: FloatArray, pairs: NDArray[np.int_]) -> FloatArray:
        """Return the same at poses (N, 3), of one pair at each, (N, 2, 3) [m]."""
        rotation, position = self._placed(pose)
        found = np.empty((len(pose), 2, 3))
        for k, pair in enumerate(pairs):
            self._put(rotation[k], position[k])
            row = min(self._rows[pair], key=lambda each: self._distance(int(each)))
            one = self._data.distanceResults[int(row)]
            found[k] = one.getNearestPoint1(), one.getNearestPoint2()
        return found

    def solids(self, pose: FloatArray) -> list[tuple[str, FloatArray, float]]:
        """Return all convex solids at a pose: part, corners (V, 3), radius of what sweeps them [m]."""
        bodies = mechanism_motion(self.geometry, pose, 0 * pose, 0 * pose).bodies
        found = []
        for part in self.parts:
            for one in part.solids:
                corners = one.position + one.corners @ one.rotation.T
                if part.body != FRAME:
                    body = bodies[part.body]
                    corners = body.origin + corners @ body.rotation.T
                found.append((part.name, corners, one.radius))
        return found

    def sweep(self, pose: FloatArray) -> FloatArray:
        """Return the lowest and highest corner of the box around all that moves, over poses, (2, 3) [m]."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for start in range(0, len(pose), _BLOCK):
            corners = self._corners(pose[start : start + _BLOCK], 0 * pose[start : start + _BLOCK])[0]
            low = np.minimum(low, (corners - self._radii[:, None]).min(axis=(0, 1)))
            high = np.maximum(high, (corners + self._radii[:, None]).max(axis=(0, 1)))
        return np.stack([low, high])

    def rates(self, start: _States, end: _States) -> FloatArray:
        """Return by how much distances can change over steps of a motion, (N, P) [m/s].

        The sum of the largest speeds of the corners of both parts; of two parts that rise with the platform,
        of what is left of these. Corners move as cubics over a step, whose velocities lie within the hull of
        their three Bézier points.
        """
        found = np.empty((len(start.time), len(self.pairs)))
        for k in range(0, len(start.time), _BLOCK):
            found[k : k + _BLOCK] = self._rates(start, end, slice(k, k + _BLOCK))
        return found

    def _rates(self, start: _States, end: _States, rows: slice) -> FloatArray:
        step = (end.time - start.time)[rows, None, None]
        before, v0 = self._corners(start.pose[rows], start.velocity[rows])
        after, v1 = self._corners(end.pose[rows], end.velocity[rows])
        rise = [np.zeros_like(v0[:, :1]) for _ in range(3)]
        z0, z1 = start.velocity[rows, 1], end.velocity[rows, 1]
        climbed = end.pose[rows, 1] - start.pose[rows, 1]
        for one, value in zip(rise, (z0, 3 * climbed / step[:, 0, 0] - z0 - z1, z1), strict=True):
            one[:, 0, 2] = value
        own = (v0, 3 * (after - before) / step - v0 - v1, v1)
        speeds = np.zeros((2, len(step), len(self.parts)))
        for one, up in zip(own, rise, strict=True):
            for frame in (0, 1):
                sizes = np.linalg.norm(one - frame * up, axis=-1)
                fixed = frame * np.abs(up[:, 0, 2])[:, None]
                each = np.broadcast_to(fixed, speeds[0].shape).copy()
                each[:, self._mobile] = np.maximum.reduceat(sizes, self._firsts, axis=1)
                speeds[frame] = np.maximum(speeds[frame], each)
        i, j = np.array(self.pairs).T
        return np.asarray((speeds[:, :, i] + speeds[:, :, j]).min(axis=0))

    @cached_property
    def _mobile(self) -> list[int]:
        return [k for k, part in enumerate(self.parts) if part.body != FRAME]

    @cached_property
    def _firsts(self) -> NDArray[np.int_]:
        counts = [sum(len(one.corners) for one in self.parts[k].solids) for k in self._mobile]
        return np.append(0, np.cumsum(counts)[:-1])

    @cached_property
    def _radii(self) -> FloatArray:
        solids = [one for k in self._mobile for one in self.parts[k].solids]
        return np.concatenate([np.full(len(one.corners), one.radius) for one in solids])

    def _corners(self, pose: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of the corners of all that moves, (N, V, 3)."""
        bodies = mechanism_motion(self.geometry, pose, velocity, 0 * velocity).bodies
        places, speeds = [], []
        for k in self._mobile:
            part = self.parts[k]
            corners = np.concatenate([one.position + one.corners @ one.rotation.T for one in part.solids])
            body = bodies[part.body]
            place = body.origin[:, None] + np.einsum("nij,vj->nvi", body.rotation, corners)
            turning = np.cross(body.omega[:, None], place - body.joint[:, None])
            places.append(place)
            speeds.append(body.velocity[:, None] + turning)
        return np.concatenate(places, axis=1), np.concatenate(speeds, axis=1)

    def _placed(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, S, 3, 3) and positions (N, S, 3) of the solids that move."""
        bodies = mechanism_motion(self.geometry, pose, 0 * pose, 0 * pose).bodies
        rotations, positions = [], []
        for k in self._moving:
            one, body = self._solids[k], bodies[self._bodies[k]]
            rotations.append(body.rotation @ one.rotation)
            positions.append(body.origin + body.rotation @ one.position)
        return np.stack(rotations, axis=1), np.stack(positions, axis=1)

    def _put(self, rotation: FloatArray, position: FloatArray) -> None:
        for row, k in enumerate(self._moving):
            self._data.oMg[k] = self._pin.SE3(rotation[row], position[row])

    def _distance(self, row: int) -> float:
        return float(self._pin.computeDistance(self._model, self._data, row).min_distance)


def _parts_of(parameters: Parameters, around: Surroundings) -> tuple[_Part, ...]:
    """Return all parts, in the body frames of `mechanism_motion`."""
    visuals, size, shift = Solids(parameters).visuals, parameters.sizes, [-parameters.geometry.r, 0.0]
    parts = []
    for name in _BODIES:
        if name == _PLATFORM:  # its link has its frame at C5, the body at P
            solids: tuple[_Solid, ...] = (_plate(visuals[name], size, np.array(shift)),)
        else:  # both cross-bars are alike, in the frames of their bodies
            drawn = visuals["crossbar_upper" if name == "crossbar_lower" else name]
            solids = tuple(
                _convex(one.shape, one.placement.rotation, one.placement.position) for one in drawn
            )
        parts.append(_Part(name, name, solids))
    for body, shapes in ((_PLATFORM, around.payload), (FRAME, around.obstacles)):
        parts += [_Part(one.name, body, (_given(one),)) for one in shapes]
    return tuple(parts)


def _coal() -> Any:
    try:
        import coal
    except ImportError as error:
        raise MissingExtraError("distances need coal: pip install 'p3dof[viz]'") from error
    return coal


def _convex(shape: Box | Cylinder | Sphere, rotation: FloatArray, position: FloatArray) -> _Solid:
    """Return a solid of the description; a cylinder with round ends."""
    coal = _coal()
    if isinstance(shape, Box):
        corners = np.array([*product(*((-edge / 2, edge / 2) for edge in shape.size))])
        return _Solid(coal.Box(*shape.size), rotation, position, corners, 0.0)
    if isinstance(shape, Sphere):
        return _Solid(coal.Sphere(shape.radius), rotation, position, np.zeros((1, 3)), shape.radius)
    ends = np.array([[0.0, 0.0, -shape.length / 2], [0.0, 0.0, shape.length / 2]])
    return _Solid(coal.Capsule(shape.radius, shape.length), rotation, position, ends, shape.radius)


def _given(one: CollisionShape) -> _Solid:
    if one.size is not None:
        import pinocchio as pin

        rotation = pin.rpy.rpyToMatrix(*one.turn)
        return _convex(Box(one.size), rotation, np.array(one.at))
    start, end = np.array(one.ends)
    length = float(np.linalg.norm(end - start))
    if not length:
        return _convex(Sphere(float(one.radius or 0.0)), np.eye(3), start)
    axis = (end - start) / length
    across = np.linalg.svd(axis[None])[2][1:]
    turn = np.column_stack([across[0], np.cross(axis, across[0]), axis])
    return _convex(Cylinder(float(one.radius or 0.0), length), turn, (start + end) / 2)


def _plate(slabs: Sequence[Any], size: Dimensions, shift: FloatArray) -> _Solid:
    """Return the platform as one prism, whose corners are polygons around the round ones."""
    from scipy.spatial import ConvexHull  # not at start-up

    angles = 2 * math.pi * np.arange(CORNERS) / CORNERS
    ring = size.corner_radius / math.cos(math.pi / CORNERS) * np.array([np.cos(angles), np.sin(angles)]).T
    middles = [one.placement.position[:2] for one in slabs if isinstance(one.shape, Cylinder)]
    outline = np.concatenate([middle + ring for middle in middles])
    outline = outline[ConvexHull(outline).vertices] + shift
    half = np.full((len(outline), 1), size.plate_thickness / 2)
    corners = np.concatenate([np.hstack([outline, -half]), np.hstack([outline, half])])
    coal = _coal()
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    return _Solid(coal.Convex.convexHull(points, True, "Qt"), np.eye(3), np.zeros(3), corners, 0.0)


@dataclass(frozen=True, eq=False)
class Approach(Readable):
    """How near two parts come to each other, when and where."""

    parts: tuple[str, str]  # their names
    distance: float  # least distance [m]; negative: how far they overlap
    time: float  # when [s]; NaN over a workspace
    place: str  # the segment of a task; empty without one
    pose: FloatArray  # (3,): of the platform then
    points: FloatArray  # (2, 3): the points of both that are nearest, in the fixed frame [m]

    @property
    def names(self) -> str:
        """Both parts in words."""
        return " and ".join(self.parts)


@dataclass(frozen=True, eq=False)
class Clearance(ShownInNotebook, Tabular):
    """Least distances of all pairs of parts that are no neighbours, over a motion or a workspace.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Samples [s]; NaN over a workspace.
    pose : ndarray, shape (N, 3)
        The platform's poses there.
    pairs : tuple of pair of str
        The pairs of parts that were looked at.
    distances : ndarray, shape (N, P)
        Of each pair at each sample [m]; negative where they overlap.
    approaches : tuple of Approach
        The least of each pair, the nearest pair first. Over a motion, pairs are followed between samples from
        their nearest sample on; that nothing between other samples is nearer is known of the first only.
    lower_bound : float
        No distance is below this between samples either, by the speeds of the parts, which are taken to move
        as cubics over a step [m]; NaN over a workspace.
    sweep : ndarray, shape (2, 3)
        Lowest and highest corner of the box around all that moves, at all samples [m].
    machine : Parameters
        The machine.
    surroundings : Surroundings
        What it carried and what stood around it.
    required : float
        The least distance that was asked for [m].
    """

    time: FloatArray
    pose: FloatArray
    pairs: tuple[tuple[str, str], ...]
    distances: FloatArray
    approaches: tuple[Approach, ...]
    lower_bound: float
    sweep: FloatArray
    machine: Parameters
    surroundings: Surroundings
    required: float = 0.0

    def __repr__(self) -> str:
        return f"Clearance({self.verdict})"

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, pose and the distance of each pair at each sample, (N,) each, by name and unit."""
        pairs = [" and ".join(pair) for pair in self.pairs]
        pose = columns_by("{}", POSE_COLUMNS, self.pose)
        return {"t [s]": self.time} | pose | columns_by("{} [m]", pairs, self.distances)

    @property
    def least(self) -> Approach:
        """The pair that comes nearest."""
        return self.approaches[0]

    def nearest_points(self) -> FloatArray:
        """Return the two points that are nearest to each other at each sample, (N, 2, 3) [m], fixed frame.

        They are of the pair with the least of `distances` there; where it overlaps, where it does so most.
        """
        model = CollisionModel(self.machine, self.surroundings)
        return model.points_over(self.pose, self.distances.argmin(axis=1))

    @property
    def fits(self) -> bool:
        """Whether all pairs keep the distance that was asked for."""
        return self.least.distance >= self.required

    @property
    def sides(self) -> FloatArray:
        """Sides of the box around all that moves, along x, y and z (3,) [m]."""
        return np.asarray(self.sweep[1] - self.sweep[0])

    @property
    def room(self) -> float:
        """Its volume [m³]."""
        return float(self.sides.prod())

    @property
    def verdict(self) -> str:
        """Which parts come nearest, how near, when and where, in a sentence."""
        one = self.least
        when = "" if math.isnan(one.time) else f" at t = {one.time:.4g} s"
        when += f", {one.place}" if one.place else ""
        if one.distance < 0:
            return f"{one.names} overlap by {_mm(-one.distance)} mm{when}"
        asked = f", {_mm(self.required)} mm required" if self.required else ""
        return f"{one.names} come within {_mm(one.distance)} mm{when}{asked}"


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g}"


def clearance_of(
    robot: Manipulator,
    found: Motion | InverseDynamics | TaskForces,
    surroundings: Surroundings | None = None,
    *,
    required: float = 0.0,
    accuracy: float = ACCURACY,
) -> Clearance:
    """Return how near parts come to each other over a motion or a task, also between its samples.

    Looked at are all pairs that move against each other, but for neighbours: what a joint joins touches.
    Where two parts may come nearer between two samples than anything found, by their speeds, the step is
    halved until the difference is below the accuracy.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    found : Motion, InverseDynamics or TaskForces
        What it does.
    surroundings : Surroundings, optional
        What it carries and what stands around it; without them its own parts alone. The payload is there
        during the whole motion.
    required : float
        The least distance that is asked for [m].
    accuracy : float
        How much less than found the least distance may be [m]; `Clearance.lower_bound` says what was reached.

    Raises
    ------
    SampleError
        If the machine cannot perform the motion.
    InputError
        If an argument does not fit.
    MissingExtraError
        If coal is not installed.
    """
    require("robot", robot, Manipulator)
    motion = found
    if isinstance(motion, TaskForces):
        motion = motion.plan.motion
    elif isinstance(motion, InverseDynamics):
        motion = motion.motion
    require("found", motion, Motion)
    model = _model_of(robot, surroundings)
    asked = not_negative("required", required)
    search = _Search(model, motion, positive("accuracy", accuracy, InputError))
    approaches = []
    for pair, (distance, time) in enumerate(zip(search.least, search.when, strict=True)):
        pose = motion.pose[0] if len(motion) == 1 else motion.resampled(np.array([time])).pose[0]
        place = found.piece_at(float(time)).name if isinstance(found, TaskForces) else ""
        points = model.points(pose, pair)
        approaches.append(Approach(model.names[pair], float(distance), float(time), place, pose, points))
    return Clearance(
        motion.time,
        motion.pose,
        model.names,
        search.sampled,
        tuple(sorted(approaches, key=lambda one: one.distance)),
        search.bound,
        model.sweep(motion.pose),
        robot.parameters,
        model.around,
        asked,
    )


def _model_of(robot: Manipulator, surroundings: Surroundings | None) -> CollisionModel:
    if not isinstance(surroundings, Surroundings | None):
        raise InputError(f"surroundings: expected Surroundings, got {shown(surroundings)}")
    return CollisionModel(robot.parameters, surroundings)


class _Search:
    """Least distances over a motion, at samples and between them."""

    def __init__(self, model: CollisionModel, motion: Motion, accuracy: float) -> None:
        self._model, self._motion, self._accuracy = model, motion, accuracy
        self.sampled = model.distances(motion.pose)
        rows = self.sampled.argmin(axis=0)
        self.least, self.when = self.sampled.min(axis=0), motion.time[rows].copy()
        self.bound = float(self.least.min())
        if len(motion) > 1:
            last = len(motion) - 1
            pairs = np.arange(len(model.pairs))
            self._descend(
                pairs, motion.time[np.maximum(rows - 1, 0)], motion.time[np.minimum(rows + 1, last)]
            )
            self.bound = self._bound()

    def _at(self, times: FloatArray, pairs: NDArray[np.int_]) -> FloatArray:
        """Return the distance of one pair at each time, (K,)."""
        unique, back = np.unique(times, return_inverse=True)
        return self._model.distances(self._motion.resampled(unique).pose[back], pairs)

    def _descend(self, pairs: NDArray[np.int_], low: FloatArray, high: FloatArray) -> None:
        """Follow pairs to the least distance of a bracket each, and keep what is less than known."""
        inner = np.arange(1, _INNER + 1) / (_INNER + 1)
        step = high - low
        for _ in range(_ROUNDS):
            times = low[:, None] + step[:, None] * inner
            values = self._at(times.ravel(), np.repeat(pairs, _INNER)).reshape(times.shape)
            best = values.argmin(axis=1)
            each = np.arange(len(pairs))
            for k in each[values[each, best] < self.least[pairs]]:
                self.least[pairs[k]], self.when[pairs[k]] = values[k, best[k]], times[k, best[k]]
            middle = np.clip(self.when[pairs], low, high)
            width = step / (_INNER + 1)
            low, high = np.maximum(middle - width, low), np.minimum(middle + width, high)
            step = high - low

    def _bound(self) -> float:
        """Return what no distance is below; steps where one may be are halved."""
        motion = self._motion
        states = _States(motion.time, motion.pose, motion.velocity)
        starts, ends = (_States(*(each[rows] for each in states)) for rows in (slice(-1), slice(1, None)))
        low = self._below(starts, ends, self.sampled[:-1], self.sampled[1:])
        left = low >= self.least.min() - self._accuracy
        bounds = [float(low[left].min(initial=np.inf))]
        rows, pairs = np.nonzero(~left)
        low = low[rows, pairs]
        start, end = motion.time[rows], motion.time[rows + 1]
        before, after = self.sampled[rows, pairs], self.sampled[rows + 1, pairs]
        spent = 0
        while len(pairs) and spent < _MOST:
            spent += len(pairs)
            middle = (start + end) / 2
            between = self._at(middle, pairs)
            worst = int(between.argmin())
            if between[worst] < self.least.min():
                one = slice(worst, worst + 1)
                self._descend(pairs[one], start[one], end[one])
            start, end = np.append(start, middle), np.append(middle, end)
            before, after = np.append(before, between), np.append(between, after)
            pairs = np.append(pairs, pairs)
            every = np.arange(len(pairs))
            low = self._below(*self._ends(start, end), before[:, None], after[:, None])[every, pairs]
            open_ = low < self.least.min() - self._accuracy
            bounds.append(float(low[~open_].min(initial=np.inf)))
            start, end, before, after, pairs, low = (
                values[open_] for values in (start, end, before, after, pairs, low)
            )
        return min(*bounds, float(low.min(initial=np.inf)), float(self.least.min()))

    def _ends(self, start: FloatArray, end: FloatArray) -> tuple[_States, _States]:
        """Return the motion at the starts and ends of steps."""
        times, back = np.unique(np.append(start, end), return_inverse=True)
        found = self._motion.resampled(times)
        states = _States(times, found.pose, found.velocity)
        first, second = (
            _States(*(each[rows] for each in states)) for rows in (back[: len(start)], back[len(start) :])
        )
        return first, second

    def _below(self, start: _States, end: _States, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return what the distances of pairs are not below over steps, (K, P)."""
        step = (end.time - start.time)[:, None]
        return np.asarray((before + after - self._model.rates(start, end) * step) / 2)


def clearance_over(
    robot: Manipulator,
    space: Workspace | None = None,
    surroundings: Surroundings | None = None,
    *,
    required: float = 0.0,
    grid: tuple[int, int, int] = _GRID,
) -> Clearance:
    """Return how near parts come to each other over a workspace.

    From the nearest poses of a grid on, each pair is followed to where its distance is least, up to the
    border of the workspace. A narrow place that no pose of the grid leads to is not found: a finer grid does.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    space : Workspace, optional
        Where it works; within its own limits without it.
    surroundings : Surroundings, optional
        As of `clearance_of`.
    required : float
        The least distance that is asked for [m].
    grid : tuple of int
        Poses along y, θ and z, two or more each; z reaches as far as the stroke allows at each (y, θ).

    Raises
    ------
    InputError
        If an argument does not fit.
    MissingExtraError
        If coal is not installed.
    OptimisationError
        If the least distance of some parts was not found.
    """
    require("robot", robot, Manipulator)
    space = robot.workspace() if space is None else space
    require("space", space, Workspace)
    asked = not_negative("required", required)
    if len(grid) != 3 or not all(isinstance(count, int) and 2 <= count <= 201 for count in grid):
        raise InputError(f"grid: expected three whole numbers from 2 to 201, got {shown(grid)}")
    model = _model_of(robot, surroundings)
    points = space.points
    low = np.array([points.y.min(), points.theta.min(), 0.0])
    high = np.array([points.y.max(), points.theta.max(), 1.0])
    axes = [np.linspace(low[k], high[k], grid[k]) for k in range(3)]
    places = np.reshape(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), (-1, 3))
    poses = _poses(space, places)
    inside = np.isfinite(poses).all(axis=1)
    places, poses = places[inside], poses[inside]
    sampled = model.distances(poses)
    step = (high - low) / (np.array(grid) - 1)
    rows = np.argsort(sampled, axis=0, kind="stable")[:_STARTS]
    pairs = np.broadcast_to(np.arange(len(model.pairs)), rows.shape)
    rows, pairs = rows.ravel(), pairs.ravel()
    least, pose = _followed(model, space, pairs, places[rows], poses[rows], sampled[rows, pairs], step)
    approaches = []
    for k, names in enumerate(model.names):
        one = min(np.flatnonzero(pairs == k), key=lambda start: float(least[start]))
        approaches.append(
            Approach(names, float(least[one]), math.nan, "", pose[one], model.points(pose[one], k))
        )
    return Clearance(
        np.full(len(poses), np.nan),
        poses,
        model.names,
        sampled,
        tuple(sorted(approaches, key=lambda one: one.distance)),
        math.nan,
        model.sweep(np.concatenate([poses, pose])),
        robot.parameters,
        model.around,
        asked,
    )


def _poses(space: Workspace, places: FloatArray) -> FloatArray:
    """Return poses of a workspace from y, θ and the share of the height, (K, 3); NaN outside."""
    y, theta, share = places.T
    low, high = space.z_range(y, theta)
    return np.stack([y, low + np.clip(share, 0.0, 1.0) * (high - low), theta], axis=1)


def _followed(
    model: CollisionModel,
    space: Workspace,
    pairs: NDArray[np.int_],
    places: FloatArray,
    poses: FloatArray,
    least: FloatArray,
    step: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Follow each pair to where its distance is least; the distances and poses.

    Steps along and across all axes, halved where none leads down.
    """
    stencil = np.array([one for one in product((-1.0, 0.0, 1.0), repeat=3) if any(one)])
    sizes = np.ones(len(places))
    for _ in range(_MOVES):
        going = np.flatnonzero(sizes > _SMALLEST)
        if not len(going):
            return least, poses
        tried = places[going, None] + sizes[going, None, None] * step * stencil
        tried[..., 2] = np.clip(tried[..., 2], 0.0, 1.0)
        there = _poses(space, tried.reshape(-1, 3))
        found = np.full(len(there), np.inf)
        inside = np.isfinite(there).all(axis=1)
        found[inside] = model.distances(there[inside], np.repeat(pairs[going], len(stencil))[inside])
        values = found.reshape(len(going), -1)
        best = values.argmin(axis=1)
        for row, k in enumerate(going):
            if values[row, best[row]] < least[k] - _EXACT:
                least[k], places[k] = values[row, best[row]], tried[row, best[row]]
                poses[k] = there.reshape(*tried.shape)[row, best[row]]
            else:
                sizes[k] /= 2
    raise OptimisationError(f"no least distance of parts was found in {_MOVES} steps")


def clearance_table(found: Clearance, most: int | None = 12) -> Table:
    """Return the least distance of each pair with time and place, the nearest first."""
    rows: list[tuple[Cell, ...]] = []
    for one in found.approaches[:most]:
        y, z, theta = one.pose
        pose = 1e3 * y, 1e3 * z, math.degrees(theta)
        spot = 1e3 * one.points.mean(axis=0) + 0.0
        when = NONE if math.isnan(one.time) else number(one.time)
        numbers = [number(value, form=".4f") for value in (1e3 * one.distance, *pose, *spot)]
        rows.append((one.names, numbers[0], when, one.place or NONE, *numbers[1:]))
    header = ("parts", "distance [mm]", "at t [s]", "segment", "y [mm]", "z [mm]", "θ [deg]",
              "at x0 [mm]", "at y0 [mm]", "at z0 [mm]")  # fmt: skip
    x, y, z = (_mm(side) for side in found.sides)
    note = f"Pairs of parts looked at: {len(found.pairs)}; neighbours at a joint are left out. "
    if not math.isnan(found.lower_bound):
        note += f"Nowhere between samples less than {number(1e3 * found.lower_bound, form='.4f')} mm. "
    note += f"All that moves stays in a box of {x} × {y} × {z} mm, {found.room:.4g} m³."
    return Table("Clearance", header, tuple(rows), note, "wide")


@html_of.register(Clearance)
def clearance_html(found: Clearance) -> str:
    """Return how a notebook shows a clearance, as HTML."""
    return notebook_html("Clearance", f"{found.verdict}.", [clearance_table(found)], ())
