"""Bushings: springs and dampers without mass between two frames, and what they do to a tree.

The law is Drake's (`LinearBushingRollPitchYaw`). With frames A and C, the frame B has its origin half-way
between theirs and half the turn from A to C; r is the vector from A's origin to C's, in the axes of B, and
φ are the angles of roll, pitch and yaw from A to C, with R_AC = Rz(yaw) Ry(pitch) Rx(roll):

    f = -K r - D r',    τ = -K φ - D φ',    r' = R_BA (u - ω × p / 2)

with p that vector, u its rate and ω the angular velocity of C, all in A. The force acts on C, and its
opposite on A, at B's origin; the torque is the one whose power is τ φ'. So the power of a bushing is
-(r', φ')ᵀ (K (r, φ) + D (r', φ')): dampers never give any. But r' is the rate of r only where B turns half
as fast as C, as it does about a fixed axis; elsewhere the power of springs differs from the rate of their
energy ½ (r, φ)ᵀ K (r, φ), unless the three stiffnesses against forces are equal.

All is written once, on a tape: traced into functions of one state or of many here, and into C elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, Readable, checked_name, frozen_array, shown, suggestion
from p3dof._base.errors import InputError, ModelError
from p3dof._base.tracing import Number, Symbol, Tape, straight_line
from p3dof._base.tracing.tape import tangent
from p3dof.loops.tree_formulas import (
    IDENTITY,
    RATES,
    ZERO,
    Matrix,
    Vector,
    axial,
    back,
    between,
    cross,
    dot,
    matrix_of,
    minus,
    numbers,
    placements,
    plus,
    product,
    times,
    transposed,
    tree_of,
)

_Formula: TypeAlias = Callable[[Tape, Sequence[Number], Sequence[Number]], list[Number]]
COMPONENTS = ("x", "y", "z", "roll", "pitch", "yaw")
LOCKED = 0.008  # cosine of the pitch below which its angles have no rates, as in Drake [0.46°]
HALF_A_TURN = 1e-4  # cosine of half the turn below which half the turn has no direction [0.01°]


@dataclass(frozen=True)
class Bushing(Readable):
    """A spring and damper without mass between two frames, as `LinearBushingRollPitchYaw` of Drake.

    Parameters
    ----------
    frames : (str, str)
        Names of the frames A and C, on two bodies, or one on a body and one fixed to the world.
    stiffness : (6,) sequence of float
        Against the shift along x, y and z of the frame half-way [N/m], and against roll, pitch and yaw of C
        in A [N m/rad].
    damping : (6,) sequence of float
        Likewise [N s/m and N m s/rad].
    name : str, optional
        What to call it; both frames in one text by default.

    Raises
    ------
    ModelError
        If a name is empty or not text, both frames are the same, or a number is negative or not finite.
    """

    frames: tuple[str, str]
    stiffness: tuple[float, ...] = (0.0,) * 6
    damping: tuple[float, ...] = (0.0,) * 6
    name: str | None = None

    def __post_init__(self) -> None:
        given: object = self.frames
        if not isinstance(given, list | tuple) or len(given) != 2:
            raise ModelError(f"bushing: frames: expected a pair of names, got {shown(given)}")
        for name in given:
            checked_name("bushing: frames", name)
        if given[0] == given[1]:
            raise ModelError(f"bushing: frames: expected two different frames, got {shown(given[0])} twice")
        object.__setattr__(self, "frames", tuple(given))
        if self.name is not None:
            checked_name("bushing: name", self.name)
        for what in ("stiffness", "damping"):
            where = f"bushing {shown(self.title)}: {what}"
            values = frozen_array(where, getattr(self, what), (6,), ModelError).tolist()
            if min(values) < 0:
                raise ModelError(f"{where}: expected no negative numbers, got {min(values):g}")
            object.__setattr__(self, what, tuple(values))

    @property
    def title(self) -> str:
        """What to call it: its `name`, else both frames, ``frame1/frame2``."""
        return self.name or "/".join(self.frames)


class _Side(NamedTuple):
    """A frame of a bushing."""

    part: int  # the part on whose body it is, and where it is there
    R: Matrix
    p: Vector


class _Stretch(NamedTuple):
    """How a bushing is stretched."""

    values: list[Number]  # (r, φ)
    forms: list[tuple[Vector, Vector]]  # what their rates take of u and ω
    columns: dict[int, tuple[Vector, Vector]]  # u and ω by place in v
    rates: list[Number]


class Bushings:
    """What the bushings of a robot, at least one, do to its tree."""

    def __init__(self, model: pin.Model, bushings: Sequence[Bushing]) -> None:
        self.all = tuple(bushings)
        self._sizes = int(model.nq), int(model.nv)
        self._function = cache(self._traced)
        self._ends: list[tuple[_Side, _Side]] = []
        self._frames: list[tuple[Any, Any]] = []
        self._tree = tree_of(model)
        ids = {str(frame.name): i for i, frame in reversed(list(enumerate(model.frames)))}
        for bushing in self.all:
            where = f"bushing {shown(bushing.title)}"
            for name in bushing.frames:
                if name not in ids:
                    help_ = suggestion(name, ids)
                    raise ModelError(f"{where}: the frame {shown(name)} does not exist; {help_}")
            one, two = (model.frames[ids[name]] for name in bushing.frames)
            if one.parentJoint == two.parentJoint:
                raise ModelError(f"{where}: expected frames on two bodies that move against each other")
            self._frames.append((one, two))
            self._ends.append((self._side(one), self._side(two)))
        paths = [[set(self._tree.path(end.part)) for end in ends] for ends in self._ends]
        moving = {part for one, two in paths for part in one ^ two}
        self._places = sorted({place for part in moving for place in self._tree.parts[part].v})

    def traced_forces(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> dict[int, Number]:
        """Return the generalised forces by place in v, on a tape."""
        found: dict[int, Number] = {}
        for stretch, (along, about) in self._wrenches(tape, q, v):
            for place, (velocity, turning) in stretch.columns.items():
                found[place] = found.get(place, 0.0) + (dot(velocity, along) + dot(turning, about))
        return found

    def forces(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the generalised forces (..., nv) at configurations (..., nq) and velocities (..., nv)."""
        found = np.zeros((*q.shape[:-1], self._sizes[1]))
        found[..., self._places] = self._evaluated("forces", q, v)
        return found

    def derivatives(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (nv, nv) of the forces of one state by small motions and by the speeds."""
        both, at = np.zeros((2, self._sizes[1], self._sizes[1])), self._places
        both[np.ix_((0, 1), at, at)] = self._evaluated("derivatives", q, v).reshape(2, len(at), len(at))
        return both[0], both[1]

    def energy(self, q: FloatArray) -> FloatArray:
        """Return the energy of the springs (...) [J]."""
        stretch, _ = self._stretched(q, np.zeros((*q.shape[:-1], self._sizes[1])))
        return np.asarray(np.sum(self._numbers("stiffness") * stretch**2, axis=-1) / 2)

    def power(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the power that the springs take (...) [W]: that of their forces, as it is."""
        stretch, rates = self._stretched(q, v)
        return np.asarray(np.sum(self._numbers("stiffness") * stretch * rates, axis=-1))

    def dissipation(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the power that the dampers take (...) [W]."""
        return np.asarray(np.sum(self._numbers("damping") * self._stretched(q, v)[1] ** 2, axis=-1))

    def wrenches(self, data: pin.Data, q: FloatArray, v: FloatArray) -> list[tuple[int, pin.Force]]:
        """Return what acts on bodies, by joint, in its axes at its origin, where `data` has the joints."""
        found, values = [], self._evaluated("wrenches", q, v).reshape(-1, 6)
        for (one, two), wrench in zip(self._frames, values, strict=True):
            first, second = (data.oMi[frame.parentJoint] for frame in (one, two))
            A, C = first * one.placement, second * two.placement
            force = pin.SE3(A.rotation, C.translation).act(pin.Force(wrench))
            found += [(two.parentJoint, second.actInv(force)), (one.parentJoint, -first.actInv(force))]
        return found

    @property
    def parameters(self) -> dict[str, float]:
        """The stiffnesses and dampings that are not both zero, by name."""
        return {
            f"{bushing.title}.{what}_{COMPONENTS[i]}": getattr(bushing, what)[i]
            for bushing in self.all
            for i in _used(bushing)
            for what in ("stiffness", "damping")
        }

    def regressor(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the matrix (nv, P) from the parameters to the forces against the bushings of one state."""
        found = np.zeros((self._sizes[1], len(self.parameters)))
        found[self._places] = self._evaluated("regressor", q, v).reshape(-1, len(self._places)).T
        return found

    def _numbers(self, what: str) -> FloatArray:
        return np.array([getattr(bushing, what) for bushing in self.all]).ravel()

    def _stretched(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (r, φ) and (r', φ') of all bushings, (..., 6 n) each; zero where nothing acts."""
        found = self._evaluated("stretches", q, v)
        return found[..., : found.shape[-1] // 2], found[..., found.shape[-1] // 2 :]

    def _evaluated(self, what: str, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the values (..., n) of a traced formula; many may be NaN, one state may not."""
        if q.ndim == 1:
            try:
                return np.array(self._function(what, math)(*q.tolist(), *v.tolist()))
            except (ValueError, ZeroDivisionError) as error:
                raise self._refusal(q) from error
        with np.errstate(invalid="ignore", divide="ignore"):
            values = self._function(what, np)(*np.moveaxis(q, -1, 0), *np.moveaxis(v, -1, 0))
        return np.stack([np.broadcast_to(value, q.shape[:-1]) for value in values], axis=-1)

    def _refusal(self, q: FloatArray) -> InputError:
        found = self._evaluated("wrenches", q[None], np.zeros((1, self._sizes[1]))).reshape(-1, 6)
        name = self.all[int(np.isnan(found).any(axis=1).argmax())].title
        return InputError(
            f"q: the bushing {shown(name)} is turned to where its axes are not determined: by a pitch within "
            "0.46° of 90°, or by half a turn, within 0.01°"
        )

    def _traced(self, what: str, namespace: Any) -> Callable[..., tuple[float, ...]]:
        """Return a formula as a function of numbers (`math`) or of arrays."""
        nq, nv = self._sizes
        formula: _Formula = getattr(self, f"_all_{what}")
        return straight_line(lambda tape, *x: formula(tape, x[:nq], x[nq:]), nq + nv, namespace)

    def _all_forces(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> list[Number]:
        found = self.traced_forces(tape, q, v)
        return [found[place] for place in self._places]

    def _all_derivatives(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> list[Number]:
        """Return the derivatives by q, row after row, then those by v."""
        forces = self._all_forces(tape, q, v)
        columns: tuple[list[list[Number]], ...] = ([], [])
        for part in self._tree.parts[1:]:
            for place, direction in zip(part.v, np.eye(len(part.v)).tolist(), strict=True):
                if place in self._places:
                    rates = RATES[part.kind]([q[i] for i in part.q], direction)
                    moved = {_index(q[i]): rate for i, rate in zip(part.q, rates, strict=True)}
                    columns[0].append(tangent(forces, moved))
                    columns[1].append(tangent(forces, {_index(v[place]): 1.0}))
        return [x for half in columns for row in zip(*half, strict=True) for x in row]

    def _all_stretches(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> list[Number]:
        found = self._stretches(tape, q, v)
        return [x for stretch in found for x in stretch.values] + [x for s in found for x in s.rates]

    def _all_wrenches(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> list[Number]:
        """Return force and moment on C at its origin, in the axes of A."""
        return [x for _, pair in self._wrenches(tape, q, v) for vector in pair for x in vector]

    def _all_regressor(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> list[Number]:
        """Return the columns of the regressor, one after the other."""
        found: list[Number] = []
        for bushing, stretch in zip(self.all, self._stretches(tape, q, v, exact=True), strict=True):
            for i in _used(bushing):
                along, about = stretch.forms[i]
                form = {place: dot(along, u) + dot(about, w) for place, (u, w) in stretch.columns.items()}
                for size in (stretch.values[i], stretch.rates[i]):
                    found += [size * form.get(place, 0.0) for place in self._places]
        return found

    def _wrenches(
        self, tape: Tape, q: Sequence[Number], v: Sequence[Number]
    ) -> list[tuple[_Stretch, tuple[Vector, Vector]]]:
        """Return how each bushing is stretched, and force and moment on C at its origin in the axes of A."""
        found = []
        for bushing, stretch in zip(self.all, self._stretches(tape, q, v), strict=True):
            force, moment = ZERO, ZERO
            for i in _used(bushing):
                size = -(bushing.stiffness[i] * stretch.values[i] + bushing.damping[i] * stretch.rates[i])
                along, about = stretch.forms[i]
                force, moment = plus(force, times(size, along)), plus(moment, times(size, about))
            found.append((stretch, (force, moment)))
        return found

    def _stretches(
        self, tape: Tape, q: Sequence[Number], v: Sequence[Number], exact: bool = False
    ) -> list[_Stretch]:
        """Return how all bushings are stretched; exactly in their axes even where these do not matter."""
        where = placements(self._tree, tape, q)
        found = []
        for bushing, (one, two) in zip(self.all, self._ends, strict=True):
            seen = between(self._tree, where, (one.part, two.part), two.p)
            R = product(transposed(one.R), product(seen.R, two.R))
            p = back(one.R, minus(seen.point, one.p))
            columns = {i: (back(one.R, u), back(one.R, w)) for i, (u, w) in seen.columns.items()}
            used = _used(bushing)
            values: list[Number] = [0.0] * 6
            forms: list[tuple[Vector, Vector]] = [(ZERO, ZERO)] * 6
            if min(used, default=6) < 3:
                alike = all(len(set(part[:3])) == 1 for part in (bushing.stiffness, bushing.damping))
                for i, axis in enumerate(IDENTITY if alike and not exact else _half_way(tape, R)):
                    values[i], forms[i] = dot(axis, p), (axis, times(0.5, cross(axis, p)))
            if max(used, default=0) > 2:
                values[3:], turning = _angles(tape, R)
                forms[3:] = [(ZERO, form) for form in turning]
            u, w = ZERO, ZERO
            for place, (velocity, turn) in columns.items():
                u, w = plus(u, times(v[place], velocity)), plus(w, times(v[place], turn))
            rates = [dot(along, u) + dot(about, w) for along, about in forms]
            found.append(_Stretch(values, forms, columns, rates))
        return found

    def _side(self, frame: pin.Frame) -> _Side:
        where = frame.placement
        part = self._tree.of_joint[int(frame.parentJoint)]
        return _Side(part, matrix_of(where.rotation), numbers(where.translation, self._tree.size))


def _used(bushing: Bushing) -> list[int]:
    """Return the components in which a bushing acts."""
    pairs = enumerate(zip(bushing.stiffness, bushing.damping, strict=True))
    return [i for i, pair in pairs if any(pair)]


def _index(symbol: Number) -> int:
    assert isinstance(symbol, Symbol)  # noqa: S101 - q and v are inputs
    return symbol.index


def _one_or_nan(tape: Tape, positive: Number) -> Number:
    """Return one where a number is positive, else what is none: NaN, or an error of `math`."""
    root = tape.sqrt(positive)
    return tape.divide(root, root)


def _half_way(tape: Tape, R: Matrix) -> Matrix:
    """Return the axes of B in those of A: half the turn of R, by its quaternion (w, a)."""
    square = (1.0 + R[0][0] + R[1][1] + R[2][2]) * 0.25
    w = tape.sqrt(square) * _one_or_nan(tape, tape.subtract(square, HALF_A_TURN**2))
    x, y, z = a = times(tape.divide(0.25, w), axial(R))
    share = times(tape.divide(1.0, 1.0 + w), a)
    return (
        (w + share[0] * x, z + share[0] * y, share[0] * z - y),
        (share[1] * x - z, w + share[1] * y, x + share[1] * z),
        (y + share[2] * x, share[2] * y - x, w + share[2] * z),
    )


def _angles(tape: Tape, R: Matrix) -> tuple[list[Number], list[Vector]]:
    """Return roll, pitch and yaw of R, and what their rates take of the angular velocity."""
    (c, _, _), (s, _, _), (down, at_y, at_z) = R
    square = c * c + s * s  # of the cosine of the pitch
    cosine = tape.sqrt(square) * _one_or_nan(tape, tape.subtract(square, LOCKED**2))
    angles = [tape.atan2(at_y, at_z), tape.atan2(-down, cosine), tape.atan2(s, c)]
    over, twice = tape.divide(1.0, cosine), tape.divide(1.0, cosine * cosine)
    roll: Vector = (c * twice, s * twice, 0.0)
    return angles, [roll, (-(s * over), c * over, 0.0), plus((0.0, 0.0, 1.0), times(-down, roll))]
