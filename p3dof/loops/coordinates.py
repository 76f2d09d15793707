"""Coordinates of a tree: which are lengths, how fast they change, and how exact they and results can be.

How exact results are: what single samples, many samples and compiled dynamics measure by, said once. Who
decides (single samples, by singular value decompositions) refuses by `ACCURACY`. Faster ways keep what is
`SURELY` within it, whatever norm it is measured in, and hand all else over: so all refuse the same samples.

Then rotations, joints by name, and springs, counterbalances, damping and friction in joints, with bushings
between bodies: forces, energy, power, at any states.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import EllipsisType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.bushings import Bushing, Bushings
from p3dof.loops.sidecar import SMOOTHING, JointData, suggestion

_LENGTHS: dict[str, slice | EllipsisType] = {
    "JointModelP": ...,
    "JointModelTranslation": ...,
    "JointModelFreeFlyer": slice(0, 3),
    "JointModelPlanar": slice(0, 2),
    "JointModelR": slice(0, 0),
    "JointModelSpherical": slice(0, 0),
    "JointModelUniversal": slice(0, 0),
}
"""Which coordinates of a joint are lengths, by the beginning of its name in Pinocchio; the longest counts."""
_ROUNDING = 16 * np.finfo(float).eps  # share of the largest coordinate by which a body's place is uncertain


def length_coordinates(model: pin.Model) -> tuple[NDArray[np.bool_], NDArray[np.bool_], bool]:
    """Return which of q and of v are lengths."""
    q, v, known = np.zeros(model.nq, dtype=bool), np.zeros(model.nv, dtype=bool), True
    for i in range(1, model.njoints):
        name = model.joints[i].shortname()
        kinds = [kind for kind in _LENGTHS if name.startswith(kind)]
        known = known and bool(kinds)
        lengths = _LENGTHS[max(kinds, key=len)] if kinds else slice(0, 0)
        q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]][lengths] = True
        v[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]][lengths] = True
    return q, v, known


def rounding(q: FloatArray) -> FloatArray:
    """Return how far rounding of configurations (..., nq) may leave loops open, (...,) [m or rad]."""
    return np.asarray(_ROUNDING * np.abs(q).max(axis=-1, initial=0.0))


ACCURACY = 1e-9
"""Largest error of an equation of motion, relative to the forces in it, or of rates, relative to these."""
SURELY = ACCURACY / 10.0  # the same for ways that hand over what they are not sure of
NO_CHANGE = 1e-13
"""Change of forces or accelerations, relative to them, or error likewise, that nothing is refined for."""
WELL = 1e-5  # least reciprocal condition number of what faster ways solve, for ten digits and more
NORMALISED = 1e-6  # largest error of the length of quaternions and circles in configurations


_UNITS = {"JointModelRU": 2, "JointModelRevoluteUnbounded": 2, "JointModelPlanar": 2}
_UNITS |= {"JointModelSpherical": 4, "JointModelFreeFlyer": 4}
"""How many numbers at the end of a joint's q have length one, by the beginning of its name in Pinocchio."""


class Norms:
    """Tells whether configurations of one model have circles and quaternions of length one."""

    def __init__(self, model: pin.Model) -> None:
        self._model, self._known = model, True
        units: dict[int, list[list[int]]] = {}
        for joint in list(model.joints)[1:]:
            if joint.nq != joint.nv:
                kind, stop = joint.shortname(), joint.idx_q + joint.nq
                size = next((size for start, size in _UNITS.items() if kind.startswith(start)), 0)
                self._known = self._known and size > 0
                units.setdefault(size, []).append([*range(stop - size, stop)])
        self._units = [np.array(places) for places in units.values()]

    def __call__(self, q: FloatArray) -> bool:
        """Whether all configurations (N, nq) are normalised, as Pinocchio tells of each."""
        if self._known:
            parts = (q[:, places] for places in self._units)
            offs = (np.sqrt(np.einsum("nki,nki->nk", part, part)) - 1.0 for part in parts)
            if all(np.abs(off).max(initial=0.0) < NORMALISED * (1.0 - 1e-6) for off in offs):
                return True
        return all(pin.isNormalized(self._model, row, NORMALISED) for row in q)


class ConfigurationRates:
    """Configuration and velocity of one model to the time derivative of the configuration."""

    def __init__(self, model: pin.Model) -> None:
        self.flat = bool(model.nq == model.nv)
        self._straight: list[tuple[slice, slice]] = []
        self._turning: list[tuple[slice, slice, Callable[[FloatArray, FloatArray], FloatArray]]] = []
        self._nq = int(model.nq)
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
            q = slice(joint.idx_q, joint.idx_q + joint.nq)
            v = slice(joint.idx_v, joint.idx_v + joint.nv)
            if joint.nq == joint.nv:
                self._straight.append((q, v))
                continue
            kind = joint.shortname()
            rates = [rate for start, rate in _KINDS.items() if kind.startswith(start)]
            if not rates:
                raise ModelError(f"the joint {name!r} ({kind}) cannot be integrated: expected a simple joint")
            self._turning.append((q, v, rates[0]))

    def __call__(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return dq/dt (nq,) at a normalised configuration q (nq,) with velocity v (nv,)."""
        if self.flat:
            return v
        result = np.empty(self._nq)
        for at, of in self._straight:
            result[at] = v[of]
        for at, of, rate in self._turning:
            result[at] = rate(q[at], v[of])
        return result


def _circle(q: FloatArray, v: FloatArray) -> FloatArray:
    """Of cosine and sine."""
    return np.array([-q[1] * v[0], q[0] * v[0]])


def _quaternion(q: FloatArray, omega: FloatArray) -> FloatArray:
    """Of a unit quaternion x, y, z, w, for an angular velocity in the axes of the body: q ⊗ ω / 2."""
    (x, y, z, w), (a, b, c) = q.tolist(), omega.tolist()
    return 0.5 * np.array(
        [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -(x * a + y * b + z * c)]
    )


def _free(q: FloatArray, v: FloatArray) -> FloatArray:
    R = np.array(pin.Quaternion(q[3:]).toRotationMatrix())
    return np.concatenate([R @ v[:3], _quaternion(q[3:], v[3:])])


def _planar(q: FloatArray, v: FloatArray) -> FloatArray:
    c, s = q[2:]
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], -s * v[2], c * v[2]])


_KINDS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "JointModelRUB": _circle,
    "JointModelRevoluteUnboundedUnaligned": _circle,
    "JointModelSpherical": _quaternion,
    "JointModelFreeFlyer": _free,
    "JointModelPlanar": _planar,
}
"""By the beginning of a joint's name in Pinocchio."""


def joint_named(model: pin.Model, name: str, what: str) -> int:
    """Return the index of a joint."""
    joints = [str(joint) for joint in model.names[1:]]
    if name not in joints:
        raise ModelError(f"{what}: the joint {shown(name)} does not exist; {suggestion(name, joints)}")
    return joints.index(name) + 1


def single_joint(model: pin.Model, name: str, what: str) -> int:
    """Return the index of a joint that has one degree of freedom."""
    index = joint_named(model, name, what)
    if model.nvs[index] != 1:
        got = model.nvs[index]
        raise ModelError(f"{what}: expected joints with one degree of freedom, {shown(name)} has {got}")
    return index


def configuration_of(
    model: pin.Model,
    values: Mapping[str, Any] | None,
    what: str = "reference",
    others: FloatArray | None = None,
) -> FloatArray:
    """Return the configuration in which some joints have given values, others neutral or as given; (nq,)."""
    q = np.array(pin.neutral(model) if others is None else others, dtype=float)
    for name, value in (values or {}).items():
        index = joint_named(model, name, what)
        numbers, size = np.atleast_1d(np.asarray(value, dtype=float)), int(model.nqs[index])
        if len(numbers) == 1 and size == 2 and model.nvs[index] == 1:  # a continuous joint
            numbers = np.array([np.cos(numbers[0]), np.sin(numbers[0])])
        if len(numbers) != size:
            raise ModelError(f"{what}: {shown(name)}: expected {size} values, got {len(numbers)}")
        q[model.idx_qs[index] : model.idx_qs[index] + size] = numbers
        if not pin.isNormalized(model, q, NORMALISED):
            raise ModelError(f"{what}: {shown(name)}: its values are not normalised")
    return np.array(pin.normalize(model, q)) if model.nq != model.nv else q


_FAR_TURN = -0.99  # cosine of the largest rotation whose vector is taken; beyond it is NaN
_SMALL = 0.1  # squares of angles below this are treated by series
NEAR_TURN = 0.05  # likewise values of (1 - cosine)/2
_a = np.cumprod([1.0, *(2 * k / (2 * k + 1) for k in range(1, 16))])
_k = np.arange(16)
_SERIES = np.stack(
    (_a, -0.5 * np.append(_k * _a, 0.0)[1:], 0.25 * np.append(_k * (_k - 1) * _a, [0.0, 0.0])[2:]), 1
)
"""Coefficients of aₖ yᵏ and its first two derivatives by the cosine; see `shortest_turn`."""


def rotation_vector(R: FloatArray) -> FloatArray:
    """Return log3 of rotations (..., 3, 3) as (..., 3) [rad]; NaN for those of more than 170°."""
    s = 0.5 * np.stack(
        (R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]), axis=-1
    )
    sine = np.sqrt(np.sum(s * s, axis=-1))
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-8, angle / np.maximum(sine, 1e-8), 1.0)
    return np.asarray(s * np.where(cosine > _FAR_TURN, factor, np.nan)[..., None])


def turned_rates(turn: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) from ω to the rate of the rotation vector of E, where dE/dt = ω × E.

    The inverse of the left Jacobian of SO(3), 1 - [φ]/2 + (1/φ² - (1 + cos φ)/(2 φ sin φ)) [φ]².
    """
    square = np.sum(turn * turn, axis=-1)
    angle = np.sqrt(np.maximum(square, 1e-4))
    exact = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    factor = np.where(square > 1e-4, exact, 1.0 / 12.0 + square / 720.0)
    across = skew(turn)
    return np.asarray(np.eye(3) - 0.5 * across + factor[..., None, None] * (across @ across))


def turned_rates_dot(turn: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the rates (..., 3, 3) of the matrices of `turned_rates`."""
    rate = (turned_rates(turn) @ omega[..., None])[..., 0]
    factor, slope = _factors(np.sum(turn * turn, axis=-1))
    across, across_dot = skew(turn), skew(rate)
    product = across_dot @ across
    both = product + np.swapaxes(product, -1, -2)  # of [φ]²: (a b)ᵀ = b a, for skew-symmetric ones
    change = slope * 2.0 * np.sum(turn * rate, axis=-1)
    turned = change[..., None, None] * (across @ across)
    return np.asarray(factor[..., None, None] * both + turned - 0.5 * across_dot)


def shortest_turn(cosine: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an angle over its sine, as a function g(c) of its cosine, and its first two derivatives.

    (1 - c²) g' = c g - 1. Around zero g = Σ aₖ yᵏ with y = (1 - c)/2, a₀ = 1, aₖ = aₖ₋₁ 2k/(2k + 1).
    """
    c = np.maximum(np.minimum(cosine, 1.0), -1.0)
    y = 0.5 * (1.0 - c)
    near = y < NEAR_TURN
    series = np.minimum(y, NEAR_TURN)[..., None] ** _k @ _SERIES
    if near.all():
        return series[..., 0], series[..., 1], series[..., 2]
    square = np.where(near, 1.0, np.maximum(1.0 - c * c, 1e-12))
    g = np.arccos(c) / np.sqrt(square)
    slope = (c * g - 1.0) / square
    exact = g, slope, (g + 3.0 * c * slope) / square
    g, slope, curvature = (np.where(near, series[..., i], value) for i, value in enumerate(exact))
    return g, slope, curvature


def skew(a: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of the cross product with a (..., 3)."""
    result = np.zeros((*a.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -a[..., 2], a[..., 1]
    result[..., 1, 0], result[..., 1, 2] = a[..., 2], -a[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -a[..., 1], a[..., 0]
    return result


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b (..., 3)."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    first = y * w - z * v
    result = np.empty((*first.shape, 3))
    result[..., 0], result[..., 1], result[..., 2] = first, z * u - x * w, x * v - y * u
    return result


def _factors(square: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return 1/φ² - (1 + cos φ)/(2 φ sin φ), and its derivative, as functions of φ²."""
    angle = np.sqrt(np.maximum(square, _SMALL))
    cot, x = 1.0 / np.tan(0.5 * angle), np.minimum(square, _SMALL)
    value = (1.0 - 0.5 * angle * cot) / angle**2
    rise = 0.5 * cot - 0.25 * angle * (1.0 + cot**2)
    slope = -(rise / angle + 2.0 * value) / (2.0 * angle**2)
    series = (691 / 1307674368000, 1 / 47900160, 1 / 1209600, 1 / 30240, 1 / 720, 1 / 12)
    near = square < _SMALL
    small = np.polyval(series, x), np.polyval(np.polyder(series), x)
    return np.where(near, small[0], value), np.where(near, small[1], slope)


_SPRUNG = {"JointModelSpherical": False, "JointModelFreeFlyer": True}
"""Which joints may have one, and whether they shift."""


@dataclass(frozen=True, eq=False)
class TurningSpring:
    """A spring in a ball or a free joint."""

    q: slice  # where the joint is in configuration and velocity
    v: slice
    stiffness: float  # [N m/rad], and for the shift of a free joint [N/m]
    rest: FloatArray  # (4,): values of the joint without force

    @classmethod
    def of(cls, model: pin.Model, joint: int, entry: JointData) -> TurningSpring:
        """Return the spring of a joint."""
        where, kind = f"joint data of {shown(entry.joint)}", str(model.joints[joint].shortname())
        if kind not in _SPRUNG:
            raise ModelError(
                f"{where}: stiffness: only a joint with one degree of freedom, a ball or a free joint can "
                f"have a spring, it has {model.nvs[joint]}"
            )
        size = int(model.nqs[joint])
        rest: FloatArray = np.zeros(size)
        rest[-1] = 1.0
        if isinstance(entry.rest, tuple):
            if len(entry.rest) != size or abs(np.linalg.norm(entry.rest[-4:]) - 1) > 1e-6:
                raise ModelError(f"{where}: rest: expected {size} values that end in a unit quaternion")
            rest = np.array(entry.rest)
            rest[-4:] /= np.linalg.norm(rest[-4:])
        elif entry.rest:
            raise ModelError(f"{where}: rest: expected {size} values, got one")
        v = slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])
        return cls(slice(model.idx_qs[joint], model.idx_qs[joint] + size), v, entry.stiffness, rest)

    def stretch(self, q: FloatArray) -> FloatArray:
        """Return how far the joint is from rest, in its own axes: (..., 3), or shift and turn (..., 6)."""
        values = q[..., self.q]
        turn = _turn(self.rest[-4:], values[..., -4:])
        if len(self.rest) == 4:
            return turn
        shift = _turned_back(values[..., 3:], values[..., :3] - self.rest[:3])
        return np.concatenate([shift, turn], axis=-1)

    def stretch_by_q(self, q: FloatArray) -> FloatArray:
        """Return the derivative of `stretch` at one configuration by small motions in the joint's axes."""
        found = self.stretch(q)
        R = pin.exp3(found[-3:])
        by_turn = np.array(pin.Jlog3(R))
        if len(self.rest) == 4:
            return by_turn
        whole = np.zeros((6, 6))
        whole[:3, :3], whole[:3, 3:], whole[3:, 3:] = np.eye(3), pin.skew(found[:3]), by_turn
        return whole


def _turn(rest: FloatArray, now: FloatArray) -> FloatArray:
    """Return the rotation vector (..., 3) from a quaternion x, y, z, w to others, the shorter way."""
    u, w = -rest[:3], rest[3]
    vector = w * now[..., :3] + now[..., 3:] * u + np.cross(u, now[..., :3])
    scalar = w * now[..., 3] - np.sum(u * now[..., :3], axis=-1)
    sign = np.where(scalar < 0, -1.0, 1.0)
    length = np.linalg.norm(vector, axis=-1)
    angle = 2.0 * np.arctan2(length, sign * scalar)
    share = np.where(length > 1e-12, angle / np.where(length > 1e-12, length, 1.0), 2.0)
    return np.asarray((sign * share)[..., None] * vector)


def _turned_back(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (..., 3) in the axes of a body with a quaternion x, y, z, w."""
    u, w = -quaternion[..., :3], quaternion[..., 3:]
    once = 2.0 * np.cross(u, vector)
    return np.asarray(vector + w * once + np.cross(u, once))


class Passive:
    """What acts in a tree by itself: in its joints, and in bushings between its bodies."""

    def __init__(self, model: pin.Model, entries: Sequence[JointData], bushings: Sequence[Bushing]) -> None:
        self._nv = int(model.nv)
        self.bushings = Bushings(model, bushings) if bushings else None
        self._any = bool(entries) or bool(bushings)
        self._damping, self._friction, self._force = np.zeros((3, model.nv))
        self._smoothing = np.full(model.nv, SMOOTHING)
        pushed = []
        self._turning: list[TurningSpring] = []
        springs = []
        for entry in entries:
            joint = joint_named(model, entry.joint, "joint data")
            span = slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])
            _require_rotor(entry, np.asarray(model.armature)[span])
            self._damping[span], self._friction[span] = entry.damping, entry.friction
            self._smoothing[span] = entry.smoothing
            _require_one(entry, model.nvs[joint], model.nqs[joint])
            if entry.force:
                self._force[span] = entry.force
                pushed.append((model.idx_qs[joint], model.idx_vs[joint]))
            if entry.stiffness and model.nvs[joint] > 1:
                self._turning.append(TurningSpring.of(model, joint, entry))
            elif entry.stiffness:
                if isinstance(entry.rest, tuple):
                    raise ModelError(f"joint data of {shown(entry.joint)}: rest: expected one number")
                places = model.idx_qs[joint], model.idx_vs[joint], model.nqs[joint] == 2
                springs.append((*places, entry.stiffness, entry.rest))
        columns = np.array(springs, dtype=float).reshape(-1, 5).T
        self._q, self._v = columns[:2].astype(int)
        self._circles = np.flatnonzero(columns[2])
        self._stiffness, self._rest = columns[3:]
        self._pushed_q, self._pushed_v = np.array(pushed, dtype=int).reshape(-1, 2).T

    def __bool__(self) -> bool:
        return self._any

    def forces(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the generalised forces (..., nv) at configurations (..., nq) and velocities (..., nv)."""
        found = self.joint_forces(q, v)
        return found + self.bushings.forces(q, v) if self.bushings else found

    def joint_forces(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return what of the forces acts in the joints themselves."""
        found: FloatArray = self._force - self._damping * v - self._friction * self._sign(v)
        if len(self._q):
            found[..., self._v] -= self._stiffness * self._stretch(q)
        for spring in self._turning:
            found[..., spring.v] -= spring.stiffness * spring.stretch(q)
        return found

    def derivatives(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (nv, nv) of the forces by the positions and by the speeds.

        Friction is smooth: away from rest its derivative fades out within a few times its smoothing.
        """
        by_q = np.zeros((self._nv, self._nv))
        by_q[self._v, self._v] = -self._stiffness
        for spring in self._turning:
            by_q[spring.v, spring.v] = -spring.stiffness * spring.stretch_by_q(q)
        steep = self._friction / self._smoothing * (1.0 - self._sign(v) ** 2)
        by_v = np.diag(-self._damping - steep)
        if not self.bushings:
            return by_q, by_v
        more = self.bushings.derivatives(q, v)
        return by_q + more[0], by_v + more[1]

    def energy(self, q: FloatArray) -> FloatArray:
        """Return the energy in springs, counterbalances and bushings (...) [J]."""
        found = np.asarray(np.sum(self._stiffness * self._stretch(q) ** 2, axis=-1) / 2)
        for spring in self._turning:
            found = found + spring.stiffness * np.sum(spring.stretch(q) ** 2, axis=-1) / 2
        if len(self._pushed_q):
            found = found - np.sum(self._force[self._pushed_v] * q[..., self._pushed_q], axis=-1)
        return np.asarray(found + self.bushings.energy(q) if self.bushings else found)

    def power(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return how fast springs, counterbalances and bushings take up energy (...) [W]."""
        found = np.sum(self._stiffness * self._stretch(q) * v[..., self._v], axis=-1)
        for spring in self._turning:
            found = found + spring.stiffness * np.sum(spring.stretch(q) * v[..., spring.v], axis=-1)
        if len(self._pushed_v):
            found = found - np.sum(self._force[self._pushed_v] * v[..., self._pushed_v], axis=-1)
        return np.asarray(found + self.bushings.power(q, v) if self.bushings else found)

    def dissipation(self, v: FloatArray, q: FloatArray | None = None) -> FloatArray:
        """Return what damping and friction take (...) [W]; that of bushings depends on q."""
        lost = np.sum(self._damping * v**2 + self._friction * v * self._sign(v), axis=-1)
        return np.asarray(lost + self.bushings.dissipation(q, v) if self.bushings and q is not None else lost)

    def _sign(self, v: FloatArray) -> FloatArray:
        """Return the sign of speeds as Coulomb friction has it, smooth about zero."""
        return np.asarray(np.tanh(v / self._smoothing))

    def _stretch(self, q: FloatArray) -> FloatArray:
        """Return how far the joints with springs are from rest (..., n)."""
        values = q[..., self._q] - self._rest
        if len(self._circles):
            at = self._q[self._circles]
            angle = np.arctan2(q[..., at + 1], q[..., at]) - self._rest[self._circles]
            values[..., self._circles] = np.arctan2(np.sin(angle), np.cos(angle))
        return np.asarray(values)


def _require_one(entry: JointData, freedoms: int, values: int) -> None:
    """Refuse a constant force, or a negative spring, where it has no direction."""
    where = f"joint data of {shown(entry.joint)}"
    if entry.force and (freedoms != 1 or values != 1):
        raise ModelError(
            f"{where}: force: expected a joint with one degree of freedom that is not continuous"
        )
    if entry.stiffness < 0 and freedoms != 1:
        raise ModelError(f"{where}: stiffness: expected zero or more, got {entry.stiffness:g}")


def _require_rotor(entry: JointData, armature: FloatArray) -> None:
    """Refuse data of a rotor that the tree does not have."""
    where = f"joint data of {shown(entry.joint)}"
    if entry.armature:
        raise ModelError(f"{where}: armature: it belongs to the tree, model.armature")
    if (armature < entry.reflected_inertia * (1 - 1e-9)).any():
        raise ModelError(
            f"{where}: rotor_inertia: the tree has {float(armature.min()):g} in model.armature, less than "
            f"gear_ratio² rotor_inertia = {entry.reflected_inertia:g}"
        )


def with_armature(model: pin.Model, entries: Sequence[JointData]) -> tuple[JointData, ...]:
    """Give a tree the rotors of its joints, and return what is left to act in them."""
    armature = np.array(model.armature)
    left = []
    for entry in entries:
        joint = joint_named(model, entry.joint, "joint data")
        rotor = entry.armature + entry.reflected_inertia
        if rotor:
            armature[model.idx_vs[joint] : model.idx_vs[joint] + model.nvs[joint]] = rotor
        left.append(replace(entry, armature=0.0))
    model.armature = armature
    return tuple(entry for entry in left if entry)


def losses_of(model: pin.Model) -> tuple[JointData, ...]:
    """Return the damping and the friction that the file of a tree gives to its joints."""
    found = []
    for i in range(1, model.njoints):
        if model.nvs[i]:
            at = model.idx_vs[i]
            losses = max(0.0, float(model.damping[at])), max(0.0, float(model.upperDryFrictionLimit[at]))
            found.append(JointData(str(model.names[i]), damping=losses[0], friction=losses[1]))
    return tuple(entry for entry in found if entry)


def add_frame(model: pin.Model, name: str, on: int, placement: pin.SE3) -> None:
    """Add a frame to a tree."""
    frame = model.frames[on]
    where = frame.placement * placement
    model.addFrame(pin.Frame(name, frame.parentJoint, on, where, pin.FrameType.OP_FRAME))
