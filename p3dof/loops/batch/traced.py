"""Closed loops as straight-line functions of where Pinocchio puts the bodies: one sample, or arrays of them.

For trees whose joints turn about one axis or slide along one, closures of points, and a frame whose
prescribed components determine all joints. Pinocchio's kinematics go sample by sample. Everything after them,
from the rows of closures and target to the motion of the joints, is traced once: what is zero or one at all
configurations, as most components of axes and levers, takes part in no operation, and what remains is done
with floats for one sample, with arrays for many.

Each sample starts from the reference by itself, at a polynomial of the joints in the target: results depend
on no other sample. The square system has the same zeros everywhere, so that the order of elimination with
least fill (Markowitz, Management Science 3 (1957) 255) is found once. What does not contract, is not closed
to the last digits or nears a singularity is not `good`: slower ways decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from itertools import combinations_with_replacement, pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import DynamicsError, InputError
from p3dof._base.threads import Workspace
from p3dof._base.tracing import Number, Tape, straight_line
from p3dof.loops.assembly import CONTRACTION, FIRST_STEP, TOLERANCE
from p3dof.loops.batch.kinematics import shared_placements
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.coordinates import ACCURACY
from p3dof.loops.linear import BoolArray, independent_rows, solve
from p3dof.loops.sidecar import Sidecar

Vector: TypeAlias = tuple[Number, Number, Number]
Rows: TypeAlias = list[list[Number]]
Frame: TypeAlias = tuple[Vector, list[Vector]]  # where a frame is, and its axes

Formula: TypeAlias = Callable[..., tuple[Any, ...]]

ZERO: Vector = (0.0, 0.0, 0.0)
_LAYOUT = 12  # numbers in a placement: the axes, then the origin
_SAME = 1e-14  # numbers of placements that differ by less at all configurations are the same [1 or m]
_PIVOT = 0.1  # least pivot, relative to the largest of its row, that is chosen
_SHRUNK = 1e-3  # least pivot, relative to that at the reference, with which a solution is trusted
_REACH = 0.02  # how far from the reference that polynomial is fitted [m or rad]
_HALVED = 10  # how many times that distance is tried, half as far each time
_TURNED = 2.0  # how far a first guess may turn a joint, for fear of a whole turn too many [rad]
_FITTED, _GUESSED = 3, 2  # its degree, and up to which its terms are used
_STEPS = 7  # newton steps after which a sample is left to slower ways
_LAST = 2e-8  # a Newton step behind which quadratic convergence leaves nothing but round-off [m or rad]


def _add(x: Vector, y: Vector) -> Vector:
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


def _less(x: Vector, y: Vector) -> Vector:
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


def _scaled(x: Vector, y: Number) -> Vector:
    return x[0] * y, x[1] * y, x[2] * y


def _dot(x: Iterable[Number], y: Iterable[Number]) -> Number:
    total: Number = 0.0
    for one, other in zip(x, y, strict=True):
        total = total + one * other
    return total


def _cross(x: Vector, y: Vector) -> Vector:
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


def _turned(axes: Sequence[Vector], x: Vector) -> Vector:
    """Return R x, R being given by its columns."""
    return _add(_add(_scaled(axes[0], x[0]), _scaled(axes[1], x[1])), _scaled(axes[2], x[2]))


def _vector(values: Iterable[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def columns_of(values: Sequence[Any], count: int) -> FloatArray:
    """Return arrays (N,) or numbers as the columns of one array (N, n)."""
    return np.stack([np.broadcast_to(value, count) for value in values], axis=1)


class Elimination:
    """Solves square systems A x = b that have the same zeros, by elimination in one order.

    `values` (n, n) is A at a configuration where it is well conditioned; entries that are not in `pattern`
    (n, n) are zero everywhere.
    """

    def __init__(self, values: FloatArray, pattern: BoolArray) -> None:
        left, filled = values.copy(), pattern.copy()
        rows, columns = list(range(len(values))), list(range(len(values)))
        self._steps: list[tuple[int, int, list[int], list[int]]] = []
        while rows:
            sizes, marks = np.abs(left[np.ix_(rows, columns)]), filled[np.ix_(rows, columns)]
            cost = np.outer(marks.sum(axis=1) - 1, marks.sum(axis=0) - 1) - 0.5 * sizes / sizes.max()
            cost[sizes < _PIVOT * sizes.max(axis=1, keepdims=True)] = np.inf
            r, c = divmod(int(np.argmin(cost)), len(columns))
            row, column = rows.pop(r), columns.pop(c)
            below = [i for i in rows if filled[i, column]]
            right = [j for j in columns if filled[row, j]]
            for i in below:
                left[i] -= left[i, column] / left[row, column] * left[row]
                filled[i, right] = True
            self._steps.append((row, column, below, right))
        self.pivots = [float(left[row, column]) for row, column, *_ in self._steps]  # those of `values`

    def factorise(self, A: Rows) -> list[Number]:
        """Put the factors in the place of A; return the pivots."""
        pivots = []
        for row, column, below, right in self._steps:
            pivot = A[row]
            pivots.append(pivot[column])
            pivot[column] = 1.0 / pivot[column]
            for line in (A[r] for r in below):
                line[column] = line[column] * pivot[column]
                for c in right:
                    line[c] = line[c] - line[column] * pivot[c]
        return pivots

    def solve(self, factors: Rows, b: Sequence[Number]) -> list[Number]:
        """Return x."""
        b, x = list(b), list(b)
        for row, column, below, _ in self._steps:
            for r in below:
                b[r] = b[r] - factors[r][column] * b[row]
        for row, column, _, right in reversed(self._steps):
            known = _dot((factors[row][c] for c in right), (x[c] for c in right))
            x[column] = (b[row] - known) * factors[row][column]
        return x


class _Motion(NamedTuple):
    """Velocities and accelerations of the bodies of a tree: of turning, and of their origins."""

    omega: list[Vector]
    alpha: list[Vector]
    v: list[Vector]
    a: list[Vector]

    def velocity(self, joint: int, arm: Vector) -> Vector:
        """Return the velocity of a point at an arm, in the world, from a body's origin."""
        return _add(self.v[joint], _cross(self.omega[joint], arm))

    def acceleration(self, joint: int, arm: Vector) -> Vector:
        """Return the acceleration of such a point."""
        omega = self.omega[joint]
        turning = _add(_cross(self.alpha[joint], arm), _cross(omega, _cross(omega, arm)))
        return _add(self.a[joint], turning)


class _Bodies:
    """The bodies of a tree at one configuration, given by its numbers."""

    def __init__(self, tree: AxisTree, numbers: Sequence[Number]) -> None:
        self._tree = tree
        parts = [(numbers[i], numbers[i + 1], numbers[i + 2]) for i in range(0, len(numbers), 3)]
        self.R = [parts[i : i + 3] for i in range(0, len(parts), 4)]
        self.p = parts[3::4]
        self.axes = [_turned(R, s) for R, s in zip(self.R, tree.directions, strict=True)]

    def arm(self, joint: int, lever: Vector) -> Vector:
        """Return what leads from a body's origin to one of its points, in the world."""
        return _turned(self.R[joint], lever)

    def point(self, joint: int, lever: Vector) -> Vector:
        """Return where a point of a body is."""
        return _add(self.p[joint], self.arm(joint, lever))

    def rates(self, joint: int, point: Vector) -> dict[int, Vector]:
        """Return how fast a point of a body moves per unit speed of each joint that carries it."""
        tree = self._tree
        return {
            j: self.axes[j] if tree.slides[j] else _cross(self.axes[j], _less(point, self.p[j]))
            for j in tree.supports[joint]
        }

    def moving(self, v: Sequence[Number], a: Sequence[Number]) -> _Motion:
        """Return the motion of the bodies."""
        tree, found = self._tree, _Motion([ZERO], [ZERO], [ZERO], [ZERO])
        for j, parent in enumerate(tree.parents[1:], 1):
            k, omega, alpha = tree.columns[j], found.omega[parent], found.alpha[parent]
            arm = _less(self.p[j], self.p[parent])
            speed, faster = found.velocity(parent, arm), found.acceleration(parent, arm)
            own, more = _scaled(self.axes[j], v[k]), _scaled(self.axes[j], a[k])
            bias = _cross(omega, own)
            if tree.slides[j]:
                speed, faster = _add(speed, own), _add(_add(faster, more), _add(bias, bias))
            else:
                omega, alpha = _add(omega, own), _add(_add(alpha, more), bias)
            for values, value in zip(found, (omega, alpha, speed, faster), strict=True):
                values.append(value)
        return found


class AxisTree(Workspace):
    """A tree whose joints have one axis each, and Pinocchio's placements of its bodies as numbers."""

    def __init__(self, model: pin.Model) -> None:
        self.model, self._data = model, model.createData()
        self._shared = shared_placements(self._data)
        joints = range(1, model.njoints)
        S = [np.ravel(self._data.joints[i].S) for i in joints]
        self.slides = [False, *(bool(s[:3].any()) for s in S)]  # whether a joint slides along its axis
        self.directions = [ZERO, *(_vector(s[:3] + s[3:]) for s in S)]
        """Axes of the joints, in those of their bodies."""
        self.parents = [int(parent) for parent in model.parents]
        self.supports = [[int(j) for j in model.supports[i]][1:] for i in range(model.njoints)]
        self.columns = [0, *(int(model.idx_vs[i]) for i in joints)]  # of each joint, its place in q and v
        tried = self._placed(np.random.default_rng(0).uniform(-1.0, 1.0, (8, model.nq)))
        near = np.round(tried[0])
        snapped = np.where(np.abs(tried[0] - near) < _SAME, near, tried[0])
        same = np.ptp(tried, axis=0) < _SAME
        self._moving = np.flatnonzero(~same)
        self._fixed = [float(x) if fixed else None for x, fixed in zip(snapped, same, strict=True)]
        self.size = len(self._moving)  # how many numbers tell where the bodies are

    @staticmethod
    def suits(model: pin.Model) -> bool:
        """Whether every joint of a model turns about one axis or slides along one."""
        if model.nq != model.nv or model.nv != model.njoints - 1:
            return False
        data = model.createData()
        axes = [np.ravel(data.joints[i].S) for i in range(1, model.njoints)]
        return all(S[:3].any() != S[3:].any() for S in axes)

    def numbers(self, q: FloatArray) -> list[FloatArray]:
        """Return the numbers of the bodies (size arrays of N) at configurations (N, nq)."""
        return list(np.ascontiguousarray(self._placed(q)[:, self._moving].T))

    def numbers_of_one(self, q: FloatArray) -> list[float]:
        """Return the numbers of the bodies at one configuration."""
        pin.forwardKinematics(self.model, self._data, q)
        found: list[float] = self._shared[self._moving].tolist()
        return found

    def bodies(self, numbers: Sequence[Any]) -> _Bodies:
        """Return the bodies that numbers tell of."""
        moving = iter(numbers)
        return _Bodies(self, [next(moving) if value is None else value for value in self._fixed])

    def _placed(self, q: FloatArray) -> FloatArray:
        """Return all placements (N, 12 njoints)."""
        placements = np.empty((len(q), len(self._shared)))
        compute, model, data, shared = pin.forwardKinematics, self.model, self._data, self._shared
        for q_i, placements_i in zip(q, placements, strict=True):
            compute(model, data, q_i)
            placements_i[:] = shared
        return placements


class Closed(NamedTuple):
    """Closed loops whose target moves: arrays over samples, or the floats of one sample."""

    good: BoolArray | bool  # whether every test was passed: what follows has a meaning only there
    q: Any  # (N, nv) or (nv,)
    numbers: Sequence[Any]  # of the bodies
    v: Sequence[Any]  # of each joint; likewise `a`
    a: Sequence[Any]
    influence: Sequence[Any]
    """How fast every joint moves with the first component of the target, then with the second..."""
    gap: Any  # the largest distance of the points of a closure [m]


class TracedLoops:
    """Closures of points in a tree, and a frame of which some components are prescribed.

    `goal` makes the prescribed placement from `count` numbers of the target; it is called with symbols.
    """

    def __init__(
        self,
        model: pin.Model,
        sidecar: Sidecar,
        reference: FloatArray,
        frame: str,
        mask: Sequence[bool],
        goal: Callable[..., Frame],
        count: int,
    ) -> None:
        kinematics = self._kinematics = LoopKinematics(model, sidecar)
        self.usable = False
        """Whether closures and target are a square system of the kind that can be solved here."""
        points = kinematics.plain and all(closure.kind == "3d" for closure in kinematics.closures)
        if not (points and AxisTree.suits(model)):
            return
        self._loads: dict[tuple[str, ...], Formula] = {}
        self.tree, self._reference, self._goal, self._count = AxisTree(model), reference, goal, count
        self._ends = [
            (
                joint1,
                _vector(M1.translation),
                list(map(_vector, M1.rotation.T)),
                joint2,
                _vector(M2.translation),
            )
            for joint1, M1, joint2, M2 in kinematics.ends
        ]
        placed = kinematics.frame(frame, "target", InputError)
        self._carrier, M = int(placed.parentJoint), placed.placement
        self._lever, self._axes = _vector(M.translation), list(map(_vector, M.rotation.T))
        self._turning = [
            k for k, slides in zip(self.tree.columns[1:], self.tree.slides[1:], strict=True) if not slides
        ]
        self._mask, self._size = [i for i, masked in enumerate(mask) if masked], 3 * len(self._ends)
        self.usable = self._choose()

    def _choose(self) -> bool:
        """Choose independent rows of the closures; find the order of elimination, and the first guess."""
        nv, free = self.tree.model.nv, len(self._mask)
        tried = np.vstack((self._reference, np.random.default_rng(0).uniform(-1.0, 1.0, (8, nv))))
        all_rows = range(self._size)
        J = np.array([self._rows(self.tree.bodies(self.tree.numbers_of_one(q)), all_rows) for q in tried])
        chosen = independent_rows(J[0, : self._size], nv - free)
        self._chosen = sorted(int(i) for i in chosen)
        self._others = sorted(set(all_rows) - set(self._chosen))
        used = [*self._chosen, *range(self._size, self._size + free)]
        if len(used) != nv:
            return False
        self._elimination = Elimination(J[0, used], np.abs(J[:, used]).max(axis=0) > 0.0)
        guess = self._guess()
        if guess is None:
            return False
        self._predict = straight_line(guess, self._count, np)
        return True

    def _guess(self) -> Callable[..., Sequence[Number]] | None:
        """Return how joints move from the reference, as a polynomial of the target; None if there is none."""
        free = len(self._mask)
        placed = self._placed(self.tree.bodies(self.tree.numbers_of_one(self._reference)))
        terms = [
            term
            for degree in range(1, _FITTED + 1)
            for term in combinations_with_replacement(range(free), degree)
        ]
        for halved in range(_HALVED):
            way = np.random.default_rng(0).uniform(-1.0, 1.0, (4 * len(terms), free)) * _REACH / 2**halved
            q, last = self._towards(placed, way)
            if last <= _LAST:
                break
        else:
            return None
        values = np.stack([way[:, list(term)].prod(axis=1) for term in terms], axis=1)
        found = np.linalg.lstsq(values, q - self._reference, rcond=None)[0].tolist()

        def guess(_: Tape, *target: Number) -> list[Number]:
            x = [-error for error in self._target_errors(placed, self._goal(*target))]
            moved = self._empty_row()
            for term, row in zip(terms, found, strict=True):
                if len(term) <= _GUESSED:
                    product = math.prod((x[i] for i in term[1:]), start=x[term[0]])
                    moved = [value + product * each for value, each in zip(moved, row, strict=True)]
            return moved

        return guess

    def _towards(self, placed: Frame, way: FloatArray) -> tuple[FloatArray, float]:
        """Return configurations whose targets are a way (n, size) from the reference's; the last step."""
        q, held = np.tile(self._reference, (len(way), 1)), len(self._chosen)
        step: FloatArray = np.zeros(0)
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                bodies = self.tree.bodies(self.tree.numbers(q))
                A, r = self._rows(bodies, self._chosen), columns_of(self._errors(bodies, placed), len(q))
                r[:, held:] -= way
                step = solve(np.stack([columns_of(row, len(q)) for row in A], axis=1), r[..., None])[..., 0]
                q -= step
        return q, float(np.abs(step).max())

    def _errors(self, bodies: _Bodies, goal: Frame) -> list[Number]:
        """Return the chosen rows of the closures' errors, then those of the target."""
        apart = self._apart(bodies)
        closures = [_dot(self._axis(bodies, row), apart[row // 3]) for row in self._chosen]
        return [*closures, *self._target_errors(self._placed(bodies), goal)]

    # Formulas, of symbols or floats

    @cached_property
    def _step(self) -> Formula:
        """`_newton` as a function, of floats or arrays."""
        return straight_line(lambda _, *x: self._newton(x), self.tree.size + self._count)

    @cached_property
    def _end(self) -> Formula:
        """`_motion` as a function of floats."""
        return straight_line(self._motion, self.tree.size + self._count + 2 * len(self._mask))

    @cached_property
    def _ends_of_all(self) -> Formula:
        """`_motion` as a function of arrays."""
        return straight_line(self._motion, self.tree.size + self._count + 2 * len(self._mask), np)

    def loads(self, frames: tuple[str, ...]) -> Formula:
        """Return what makes joint forces of bodies' numbers and world wrenches (6) at frames' origins."""
        if frames not in self._loads:
            self._loads[frames] = straight_line(
                partial(self._generalised, frames), self.tree.size + 6 * len(frames)
            )
        return self._loads[frames]

    @cached_property
    def power(self) -> Formula:
        """How fast the energy of the bodies grows [W], from their numbers, v and a; see `energy_rate`."""
        return straight_line(self._power, self.tree.size + 2 * self.tree.model.nv)

    def drives(self, actuated: Sequence[int]) -> Formula:
        """Return what makes the forces of three actuated joints, at places in v, by virtual power.

        It takes the influence of three components, then the joint forces f that a motion takes: Gaᵀ τ = Gᵀ f.
        """
        nv = self.tree.model.nv

        def formula(_: Tape, *given: Number) -> list[Number]:
            G, f = [given[k : k + nv] for k in range(0, 3 * nv, nv)], given[3 * nv :]
            power = [_dot(column, f) for column in G]
            one, other, third = ((G[0][k], G[1][k], G[2][k]) for k in actuated)
            across = _cross(other, third), _cross(third, one), _cross(one, other)
            inverse = 1.0 / _dot(one, across[0])
            return [_dot(axis, power) * inverse for axis in across]

        return straight_line(formula, 4 * nv)

    def _generalised(self, frames: Sequence[str], _: Tape, *given: Number) -> list[Number]:
        tree, bodies = self.tree, self.tree.bodies(given[: self.tree.size])
        forces: list[Number] = [0.0] * tree.model.nv
        for k, name in enumerate(frames):
            frame = self._kinematics.frame(name, "external", DynamicsError)
            wrench = given[self.tree.size + 6 * k :][:6]
            force, moment = (wrench[0], wrench[1], wrench[2]), wrench[3:]
            joint = int(frame.parentJoint)
            point = bodies.point(joint, _vector(frame.placement.translation))
            for j, rate in bodies.rates(joint, point).items():
                turning = 0.0 if tree.slides[j] else _dot(bodies.axes[j], moment)
                forces[tree.columns[j]] = forces[tree.columns[j]] + _dot(rate, force) + turning
        return forces

    def _power(self, _: Tape, *given: Number) -> list[Number]:
        model, nv = self.tree.model, self.tree.model.nv
        numbers, v, a = given[: -2 * nv], given[-2 * nv : -nv], given[-nv:]
        bodies, gravity = self.tree.bodies(numbers), _vector(model.gravity.linear)
        motion = bodies.moving(v, a)
        total = _dot([x * float(m) for m, x in zip(model.armature, v, strict=True)], a)
        for j in range(1, model.njoints):
            body = model.inertias[j]
            arm = bodies.arm(j, _vector(body.lever))
            faster = _less(motion.acceleration(j, arm), gravity)
            total = total + float(body.mass) * _dot(motion.velocity(j, arm), faster)
            turning = motion.omega[j], motion.alpha[j]
            omega, alpha = ([_dot(axis, x) for axis in bodies.R[j]] for x in turning)
            total = total + _dot(omega, [_dot(map(float, line), alpha) for line in body.inertia])
        return [total]

    def _newton(self, given: Sequence[Number]) -> list[Number]:
        """Return the Newton step of the numbers of the bodies, then of the target."""
        bodies, goal = self.tree.bodies(given[: self.tree.size]), self._goal(*given[self.tree.size :])
        factors = self._rows(bodies, self._chosen)
        self._elimination.factorise(factors)
        return self._elimination.solve(factors, self._errors(bodies, goal))

    def _motion(self, tape: Tape, *given: Number) -> list[Number]:
        """Return the least margin of all tests, v, a, influence and the squares of the gaps.

        From the numbers of the bodies, then those of the target, of its velocity and its acceleration.
        """
        size, free = self.tree.size, len(self._mask)
        numbers, target, velocity, acceleration = (
            given[i:j] for i, j in pairwise((0, size, size + self._count, len(given) - free, len(given)))
        )
        bodies, goal = self.tree.bodies(numbers), self._goal(*target)
        rows = self._rows(bodies, [*self._chosen, *self._others])
        held = len(self._chosen)
        split = held + len(self._others)
        factors, others = [*rows[:held], *rows[split:]], rows[held:split]
        pivots = self._elimination.factorise(factors)
        margins = [
            pivot * (1.0 / home) - _SHRUNK
            for pivot, home in zip(pivots, self._elimination.pivots, strict=True)
        ]
        placed = self._placed(bodies)
        margins.append(sum(_dot(one, other) for one, other in zip(placed[1], goal[1], strict=True)) - 1.0)
        gaps = [_dot(apart, apart) for apart in self._apart(bodies)]
        errors = [error * error for error in self._target_errors(placed, goal)]
        margins.append(TOLERANCE**2 - sum(gaps) - sum(errors))
        G = [self._influence(factors, unit) for unit in np.eye(free).tolist()]
        v = [_dot(column, velocity) for column in zip(*G, strict=True)]
        drift, of_target = self._drift(bodies, v)
        wanted = [value - bias for value, bias in zip(acceleration, of_target, strict=True)]
        a = self._elimination.solve(factors, [*(-drift[row] for row in self._chosen), *wanted])
        speed = 1.0 + _dot(v, v)  # (1 + n) times less than the largest square at most
        faster = speed + _dot(a, a) + sum(square * square for square in (x * x for x in v))
        fast, faster = (ACCURACY**2 / (1 + k * len(v)) * x for k, x in ((1, speed), (3, faster)))
        opening = [_dot(line, v) for line in others]
        more = [_dot(line, a) + drift[row] for line, row in zip(others, self._others, strict=True)]
        margins += [fast - _dot(opening, opening), faster - _dot(more, more)]
        least = margins[0]
        for margin in margins[1:]:
            least = tape.minimum(least, margin)
        return [least, *v, *a, *(x for column in G for x in column), *gaps]

    def _influence(self, factors: Rows, unit: list[float]) -> list[Number]:
        """Return how fast the joints move with the target."""
        return self._elimination.solve(factors, [*(0.0 for _ in self._chosen), *unit])

    def _axis(self, bodies: _Bodies, row: int) -> Vector:
        """Return the axis along which a row of a closure looks."""
        joint1, _, axes1, *_ = self._ends[row // 3]
        return bodies.arm(joint1, axes1[row % 3])

    def _empty_row(self) -> list[Number]:
        return [0.0] * len(self._reference)

    def _rows(self, bodies: _Bodies, which: Iterable[int]) -> Rows:
        """Return some rows of the closures' Jacobian, then those of the target."""
        columns, slides = self.tree.columns, self.tree.slides
        found: Rows = []
        apart: dict[int, dict[int, Vector]] = {}
        for row in which:
            closure = row // 3
            if closure not in apart:
                joint1, _, _, joint2, lever2 = self._ends[closure]
                point = bodies.point(joint2, lever2)
                one, other = (bodies.rates(joint, point) for joint in (joint1, joint2))
                apart[closure] = {j: rate for j, rate in other.items() if j not in one}
                apart[closure] |= {j: _less(ZERO, rate) for j, rate in one.items() if j not in other}
            axis, line = self._axis(bodies, row), self._empty_row()
            for j, rate in apart[closure].items():
                line[columns[j]] = _dot(axis, rate)
            found.append(line)
        rates = bodies.rates(self._carrier, bodies.point(self._carrier, self._lever))
        for component in self._mask:
            line = self._empty_row()
            for j, rate in rates.items():
                if component < 3:
                    line[columns[j]] = rate[component]
                elif not slides[j]:
                    line[columns[j]] = bodies.axes[j][component - 3]
            found.append(line)
        return found

    def _apart(self, bodies: _Bodies) -> list[Vector]:
        """Return what leads from the first to the second point of each closure."""
        return [
            _less(bodies.point(joint2, lever2), bodies.point(joint1, lever1))
            for joint1, lever1, _, joint2, lever2 in self._ends
        ]

    def _placed(self, bodies: _Bodies) -> Frame:
        """Return where the frame is."""
        axes = [bodies.arm(self._carrier, axis) for axis in self._axes]
        return bodies.point(self._carrier, self._lever), axes

    def _target_errors(self, placed: Frame, goal: Frame) -> list[Number]:
        """Return how far a frame is from its goal: distances, and of turns the axis times the sine."""
        turns = ZERO
        for one, other in zip(goal[1], placed[1], strict=True):
            turns = _add(turns, _cross(one, other))
        return [(*_less(placed[0], goal[0]), *_scaled(turns, 0.5))[i] for i in self._mask]

    def _drift(self, bodies: _Bodies, v: Sequence[Number]) -> tuple[list[Number], list[Number]]:
        """Return the accelerations of all rows of closures, and of the target, at zero joint acceleration."""
        motion, apart = bodies.moving(v, [0.0] * len(v)), []
        for joint1, lever1, _, joint2, lever2 in self._ends:
            one, other = (
                motion.acceleration(joint, bodies.arm(joint, lever))
                for joint, lever in ((joint1, lever1), (joint2, lever2))
            )
            apart.append(_less(other, one))
        moving = motion.acceleration(self._carrier, bodies.arm(self._carrier, self._lever))
        both = (*moving, *motion.alpha[self._carrier])
        rows = [_dot(self._axis(bodies, row), apart[row // 3]) for row in range(self._size)]
        return rows, [both[i] for i in self._mask]

    # Samples

    def one(
        self, target: Sequence[float], velocity: Sequence[float], acceleration: Sequence[float]
    ) -> Closed | None:
        """Close the loops at one sample; None where that is for slower ways."""
        tree, moved, limit = self.tree, self._predict(*target), FIRST_STEP
        if not max(abs(moved[i]) for i in self._turning) <= _TURNED:
            return None
        q = self._reference + moved
        try:
            for _ in range(_STEPS):
                step = self._step(*tree.numbers_of_one(q), *target)
                q -= step
                size = max(map(abs, step))
                if size <= _LAST:
                    break
                if not size <= limit:
                    return None
                limit = CONTRACTION * size
            else:
                return None
            numbers = tree.numbers_of_one(q)
            found = self._end(*numbers, *target, *velocity, *acceleration)
        except (ZeroDivisionError, OverflowError):
            return None
        return self._closed(q, numbers, found) if found[0] > 0.0 else None

    def many(self, target: Sequence[FloatArray], velocity: FloatArray, acceleration: FloatArray) -> Closed:
        """Close the loops at N samples: `target` (count arrays of N), rates (N, size)."""
        with np.errstate(all="ignore"):  # what is not a number passes no test
            q, good = self._assembled(target)
            numbers = self.tree.numbers(q)
            found = self._ends_of_all(*numbers, *target, *velocity.T, *acceleration.T)
            closed = self._closed(q, numbers, found)
            return closed._replace(good=good & closed.good)

    def _assembled(self, target: Sequence[FloatArray]) -> tuple[FloatArray, BoolArray]:
        """Return configurations (N, nv), and which of them Newton's method has found."""
        count = len(target[0])
        moved = columns_of(self._predict(*target), count)
        near = np.abs(moved[:, self._turning]).max(axis=1) <= _TURNED
        q = self._reference + moved
        solved, todo, limit = (
            np.zeros(count, dtype=bool),
            np.flatnonzero(near),
            np.full(int(near.sum()), FIRST_STEP),
        )
        for _ in range(_STEPS):
            steps = self._step(*self.tree.numbers(q[todo]), *(x[todo] for x in target))
            moved = columns_of(steps, len(todo))
            size = np.abs(moved).max(axis=1)
            last = size <= _LAST
            q[todo] -= moved
            solved[todo[last]] = True
            going = (size <= limit) & ~last
            todo, limit = todo[going], CONTRACTION * size[going]
            if not len(todo):
                break
        q[~solved] = self._reference
        return q, solved

    def _closed(self, q: Any, numbers: Sequence[Any], found: Sequence[Any]) -> Closed:
        """Return what `_motion` has found, by its names."""
        nv = len(self._reference)
        v, a, rest = found[1 : 1 + nv], found[1 + nv : 1 + 2 * nv], found[1 + 2 * nv :]
        split = nv * len(self._mask)
        gaps = rest[split:]
        gap = math.sqrt(max(gaps)) if isinstance(found[0], float) else np.sqrt(np.max(gaps, axis=0))
        return Closed(found[0] > 0.0, q, numbers, v, a, rest[:split], gap)
