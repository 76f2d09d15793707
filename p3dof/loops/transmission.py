"""Transmissions: how coordinates of a linkage and the actuators behind it move and load each other.

With the positions x of the coordinates and y of the actuators, both of which determine the motion, and
J = ∂y/∂x, virtual power gives for forces f, stiffness K and damping D of a controller, and inertia M

    ẏ = J ẋ,    ÿ = J ẍ + J̇ ẋ,    f_x = Jᵀ f_y,    K_x = Jᵀ K_y J - ∂(Jᵀ f_y)/∂x,    D_x = Jᵀ D_y J,

and the same from y to x with ∂x/∂y. Every direction has its own division of the speeds into independent and
dependent ones, so that neither needs the other's to be regular.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, section 3.2. C. Gosselin, Stiffness mapping
for parallel manipulators, IEEE Transactions on Robotics and Automation 6(3), 1990. S. Chen, I. Kao,
Conservative congruence transformation for joint and Cartesian stiffness matrices of robotic hands and
fingers, International Journal of Robotics Research 19(9), 2000.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, as_floats, shown
from p3dof._base.errors import AssemblyError, InputError, ModelError, P3dofError, SingularityError
from p3dof._base.threads import OneThread, in_threads, shares, slices, thread_count
from p3dof._base.tracing import Number, Tape
from p3dof._base.tracing.printing import function_of
from p3dof._base.tracing.tape import tangent
from p3dof.loops.assembly import CONTRACTION
from p3dof.loops.closed_tree import CLOSED
from p3dof.loops.compiled import solutions
from p3dof.loops.compiled.build import libraries
from p3dof.loops.compiled.compiled_functions import CompiledFunctions
from p3dof.loops.compiled.following import CONVERGED, CONVERGING, LARGEST_CORRECTION, Settled, Settler
from p3dof.loops.compiled.formulas import At, Robot, moved, seeds_of
from p3dof.loops.compiled.function import Builder, Function, pointers, views
from p3dof.loops.compiled.functions import FOLLOWED
from p3dof.loops.compiled.printing import fill, lanes_source
from p3dof.loops.compiled.robot import SAMPLES, unplanned
from p3dof.loops.coordinates import length_coordinates, single_joint
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.results import read_only
from p3dof.loops.tree_formulas import dot
from p3dof.loops.trees import joint_value

LoopT = TypeVar("LoopT", bound=LoopModel)

_TURN, _SLIDE = 1.0, 0.3  # way from home over which pivots are chosen [rad, share of the unit of length]
_APART = 1e-7  # share of a free motion that is none in a coordinate


@dataclass(frozen=True, eq=False)
class MappedMotion(Readable):
    """The other side of a transmission, at one sample or (leading axis N) at many.

    Parameters
    ----------
    q : (..., nq) array
        Configuration of the linkage, with which forces and gains are mapped.
    position, velocity, acceleration : (..., n) array
        Of the other side: of the actuators where coordinates were given, and the other way round.
    jacobian : (..., n, n) array
        By how much each of these grows with each of those that were given.
    margin : (...,) array
        Smallest pivot over what it usually is: towards zero, what was given determines the motion no more.
    errors : dict of int to P3dofError
        Of samples that failed; their results are NaN.
    """

    q: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jacobian: FloatArray
    margin: FloatArray
    errors: dict[int, P3dofError]


@dataclass(frozen=True, eq=False)
class ForceLimits(Readable):
    """The forces of coordinates that actuators within their limits can give: a polytope.

    Parameters
    ----------
    A, b : (..., 2 n, n) and (2 n,) array
        Forces f with A f <= b, rows of the upper limits of the actuators, then of the lower ones.
    vertices : (..., 2^n, n) array
        Its corners; of two coordinates in their order around it.
    """

    A: FloatArray
    b: FloatArray
    vertices: FloatArray


@dataclass(frozen=True, eq=False)
class ReflectedDynamics(Readable):
    """What a motion of a linkage takes, seen from one side of a transmission.

    Parameters
    ----------
    inertia : (..., n, n) array
        Reflected inertia, rotors included.
    forces : (..., n) array
        For a motion: of inertia, weight, springs, damping, friction [N or N m].
    """

    inertia: FloatArray
    forces: FloatArray


class _Moving(NamedTuple):
    """A robot in the motion of what is given."""

    at: At
    needed: Callable[[Sequence[Number]], list[Number]]
    v: list[Number]
    a: list[Number]


def _moving(build: Builder, robot: Robot, given: Sequence[int], gravity: bool = False) -> _Moving:
    q = build.take("q", robot.tree.nq)
    v, a = (dict(zip(given, build.take(name, len(given)), strict=True)) for name in ("v", "a"))
    if gravity:
        x, y, z = build.take("gravity", 3)
        robot = replace(robot, tree=replace(robot.tree, gravity=(x, y, z)))
    at = At(robot, build.tape, q)
    speeds, rates = ([values[place] for place in robot.independent] for values in (v, a))
    moving, all_v, all_a = solutions.completed_motion(at, speeds, rates, {})
    return _Moving(at, moving.needed, all_v, all_a)


def _motion(
    robot: Robot, given: Sequence[int], others: Sequence[int], closed: float = CLOSED * FOLLOWED
) -> Function:
    """Return speeds, accelerations and Jacobian of the others from the motion of what is given."""
    build = Builder()
    found = _moving(build, robot, given)
    build.give("velocity", [found.v[place] for place in others])
    build.give("acceleration", [found.a[place] for place in others])
    build.give("jacobian", [entry for row in _jacobian(found.at, given, others) for entry in row])
    build.evidence(found.at, closed)
    return build.function("motion")


def _close(robot: Robot, _given: Sequence[int], _others: Sequence[int]) -> Function:
    """Return q after one Newton step of all that follows, and the orientation before it."""
    build = Builder()
    at = At(robot, build.tape, build.take("q", robot.tree.nq))
    build.give("q", moved(at, at.factors.solve({row: -at.errors[row] for row in robot.plan.rows})))
    build.give("orientation", [at.orientation])
    return build.function("close")


def _jacobian(at: At, given: Sequence[int], others: Sequence[int]) -> list[list[Number]]:
    columns = [{place: 1.0, **at.null_space[place]} for place in given]
    return [[column.get(other, 0.0) for column in columns] for other in others]


def _forces_of(at: At, given: Sequence[int], others: Sequence[int], forces: Sequence[Number]) -> list[Number]:
    acting: list[Number] = [0.0] * at.robot.tree.nv
    for place, force in zip(others, forces, strict=True):
        acting[place] = force
    found, _ = at.projected(acting)
    return [found[place] for place in given]


def _forces(robot: Robot, given: Sequence[int], others: Sequence[int]) -> Function:
    """Return the forces of what is given which have the power of those of the others."""
    build = Builder()
    at = At(robot, build.tape, build.take("q", robot.tree.nq))
    build.give("forces", _forces_of(at, given, others, build.take("forces", len(others))))
    build.evidence(at, CLOSED)
    return build.function("forces")


def _gains(robot: Robot, given: Sequence[int], others: Sequence[int]) -> Function:
    """Return stiffness and damping of what is given from those of the others and the forces in them."""
    build, n = Builder(), len(others)
    at = At(robot, build.tape, build.take("q", robot.tree.nq))
    stiffness, damping = (build.take(name, n * n) for name in ("stiffness", "damping"))
    J = _jacobian(at, given, others)
    borne = _forces_of(at, given, others, build.take("forces", n))
    still = dict.fromkeys(given, 0.0)
    bent = [tangent(borne, seeds_of(at, {**still, place: 1.0})) for place in given]
    held, lost = _congruent(J, stiffness), _congruent(J, damping)
    build.give("stiffness", [held[i][k] - bent[k][i] for i in range(n) for k in range(n)])
    build.give("damping", [entry for row in lost for entry in row])
    build.evidence(at, CLOSED)
    return build.function("gains")


def _congruent(J: Sequence[Sequence[Number]], entries: Sequence[Number]) -> list[list[Number]]:
    """Return Jᵀ K J from the entries of K by rows."""
    n, columns = len(J), [*zip(*J, strict=True)]
    right = [[dot(entries[n * i : n * i + n], column) for column in columns] for i in range(n)]
    return [[dot(left, column) for column in zip(*right, strict=True)] for left in columns]


def _dynamics(robot: Robot, given: Sequence[int], _others: Sequence[int]) -> Function:
    """Return inertia, and forces for a motion under a gravity, in what is given."""
    build = Builder()
    at, needed, _, a = _moving(build, robot, given, gravity=True)
    force, _ = at.projected(needed(a))
    order, size = sorted(given), range(len(given))
    lower = solutions.projected_mass(at, order, order)
    row = [order.index(place) for place in given]
    build.give("inertia", [lower[max(row[i], row[k])][min(row[i], row[k])] for i in size for k in size])
    build.give("forces", [force[place] for place in given])
    build.evidence(at, CLOSED)
    return build.function("dynamics")


FUNCTIONS: Mapping[str, Callable[[Robot, Sequence[int], Sequence[int]], Function]] = {
    "motion": _motion,
    "single_motion": partial(_motion, closed=CLOSED),  # in single precision loops close less well
    "close": _close,
    "forces": _forces,
    "gains": _gains,
    "dynamics": _dynamics,
}
"""What a direction of a transmission has, by name."""


class Side(CompiledFunctions):
    """One direction of a transmission: from the coordinates that are given to the others."""

    def __init__(self, loop: LoopModel, names: Sequence[str], others: Sequence[str], level: str) -> None:
        given, self.others = (_places(loop.model, some) for some in (names, others))
        self.names = tuple(names)
        idle = _idle(loop, self.names, given, self.others)
        super().__init__(loop, _spread(loop, self.names), level=level, given=given, idle=idle)
        if not set(given) <= set(self.independent_places):
            raise ModelError(
                f"transmission: {', '.join(self.names)} do not determine the motion: the loops lock the "
                "linkage but at singular configurations, such as the one where it stands"
            )
        self.settle = Settler(self)

    def function(self, name: str) -> Function:
        """Return a function as it was traced: one of `FUNCTIONS`, or of those of any robot."""
        if name not in FUNCTIONS:
            return super().function(name)
        with self._making:
            if name not in self._functions:
                self._functions[name] = FUNCTIONS[name](self._robot, self.followed, self.others)
            return self._functions[name]


def _spread(loop: LoopModel, names: Sequence[str]) -> FloatArray:
    """Return closed configurations all over the way of joints, always the same: pivots must serve there."""
    home, model, draw = loop.regular_configuration, loop.model, np.random.default_rng(0)
    joints = [model.joints[single_joint(model, name, "transmission")] for name in names]
    slides, at = length_coordinates(model)[0], [joint.idx_q for joint in joints]
    start = np.array([joint_value(model, name, home) for name in names])
    width = np.where(slides[at], _SLIDE * loop.unit_of_length, _TURN)
    endless = np.array([joint.nq > 1 for joint in joints])  # the limits are those of a cosine
    lower = np.where(endless, -np.inf, np.array(model.lowerPositionLimit)[at])
    upper = np.where(endless, np.inf, np.array(model.upperPositionLimit)[at])
    found = [home]
    for _ in range(4 * SAMPLES):
        values = np.clip(start + width * draw.uniform(-1, 1, len(names)), lower, upper)
        try:
            state = loop.assemble(dict(zip(names, values.tolist(), strict=True)), guess=home)
        except AssemblyError:
            continue
        if state.same_assembly:
            found.append(state.q)
        if len(found) == SAMPLES:
            break
    return np.array(found)


def _idle(
    loop: LoopModel, names: Sequence[str], given: Sequence[int], others: Sequence[int]
) -> list[dict[int, float]]:
    """Return rows that hold still what moves while both sides do, as a rod that spins about its own axis.

    In the axes of bodies that axis does not change. Raise where what is given depends on itself, or does not
    determine the others.
    """
    q, model = loop.regular_configuration, loop.model
    J = loop.closure_jacobian(q)
    N = np.linalg.svd(J)[2][loop.rank(q) :].T if J.size else np.eye(model.nv)
    seen = int(np.linalg.matrix_rank(N[list(given)], _APART))
    idle = N @ np.linalg.svd(N[list(given)])[2][seen:].T  # what moves while what is given stands still
    if seen < len(given) or np.abs(idle[list(others)]).max(initial=0.0) > _APART:
        told = "depend on each other" if seen < len(given) else "do not determine the other side"
        raise ModelError(
            f"transmission: {', '.join(names)} {told}; the linkage of {', '.join(list(model.names)[1:])} has "
            f"{N.shape[1]} free motions, of which they see {seen}"
        )
    idle[np.abs(idle) < _APART] = 0.0
    return [{k: float(column[k]) for k in np.flatnonzero(column)} for column in idle.T]


def _places(model: pin.Model, names: Iterable[str]) -> tuple[int, ...]:
    return tuple(int(model.idx_vs[single_joint(model, name, "transmission")]) for name in names)


def linkage_of(loop: LoopT, names: Sequence[str]) -> LoopT:
    """Return the joints that closures and couplings tie to some, all others locked where the loops close."""
    model, robot = loop.model, unplanned(loop)
    tape = Tape()
    at = At(robot, tape, tape.symbols(f"q{i}" for i in range(model.nq)))
    tied = set(_places(model, names))
    rows = [set(row) for row in at.rows]
    while more := [row for row in rows if row & tied and not row <= tied]:
        tied = tied.union(*more)
    q = loop.regular_configuration
    joints = [(str(name), joint) for name, joint in zip(model.names[1:], list(model.joints)[1:], strict=True)]
    locked = {
        name: q[joint.idx_q : joint.idx_q + joint.nq]
        for name, joint in joints
        if not tied & {*range(joint.idx_v, joint.idx_v + joint.nv)}
    }
    placed = loop._with_reference(q)
    return placed.lock(locked) if locked else placed


def _bare(loop: LoopModel, names: Iterable[str]) -> LoopModel:
    """Return a linkage without the bodies of the coordinates' joints, and without what acts in those."""
    bare, armature = loop.copy(), np.array(loop.model.armature)
    own = set(names) - set(loop.actuated)
    for name in names:
        bare.model.inertias[bare.model.getJointId(name)] = pin.Inertia.Zero()
    armature[list(_places(loop.model, own))] = 0.0
    bare.model.armature = armature
    entries = tuple(entry for entry in loop.sidecar.joint_data if entry.joint not in own)
    return type(loop)(bare.model, replace(loop.sidecar, joint_data=entries))


_SIDES = ("joint", "actuator")
_BLOCK = 2_048  # samples that go from one to the next; each block anew, on however many threads
MAPS = ("close", "motion")  # the functions that mapping positions is made of
_PIECE, _MOST = 0.2, 16  # longest piece [rad, or share of the unit of length], and most of them
TRIES, STEPS_OF_PIECE = (
    48,
    8,
)  # most pieces, those that were too long too, and steps of Newton's method of each


def mapping_text(transmission: Transmission[Any], key: str, rounding: float = 0.0) -> dict[str, object]:
    """Return what the template of a direction of a transmission, in C, is filled with.

    `rounding`: what numbers of single precision leave of corrections that would be zero [m or rad].
    """
    side: Side = getattr(transmission, key)
    places, nq, n = side.follow_places(), transmission.robot.model.nq, len(side.names)
    pieces = [_PIECE * (side.length if slides else 1.0) for slides in side.slides]
    return {
        "side": key,
        "n": n,
        "nq": nq,
        "told": nq + 1,
        "inputs": nq + 2 * n,
        "places": ", ".join(str(place) for place, *_ in places),
        "circles": ", ".join(str(int(circle)) for _, circle, _ in places),
        "pieces": ", ".join(map(repr, pieces)),
        "most": _MOST,
        "tries": TRIES,
        "steps": STEPS_OF_PIECE,
        "first": repr(LARGEST_CORRECTION),
        "contraction": repr(CONTRACTION),
        "nearly": repr(max(CONVERGING, 4.0 * rounding)),
        "last": repr(max(CONVERGED, rounding)),
        "turn": repr(2.0 * np.pi),
    }


class BoundDirection:
    """One direction of a transmission that reads and writes arrays of its own.

    Fill `inputs` (``position``, ``velocity``, ``acceleration``), call `run`, read `outputs` (the same of the
    other side, ``jacobian``, ``margin``, ``gap``) and `status`: 0 where all is well, 1 where the linkage
    does not reach the position on its branch, 2 near a singular one; the outputs then stay as they were.
    """

    def __init__(self, side: Side, call: Any, state: FloatArray, mine: Callable[[], None]) -> None:
        n = len(side.names)
        self._in, self._out = np.zeros(3 * n), np.zeros(3 + 3 * n + n * n)
        self._state, self._nq = state, len(state) - 2 * n
        self.inputs = views(self._in, dict.fromkeys(("position", "velocity", "acceleration"), n))
        sizes = {"status": 1, **dict.fromkeys(self.inputs, n), "jacobian": n * n, "margin": 1, "gap": 1}
        self.outputs = views(self._out, sizes)
        self.outputs["jacobian"].shape = n, n
        call.argtypes, call.restype = [ctypes.c_void_p], None
        self._buffers = pointers([array.ctypes.data for array in (self._in, self._out, state)])
        self._call, self._place, self._mine = call, ctypes.addressof(self._buffers), mine

    def run(self) -> None:
        """Map one sample; `InputError` in another thread than before."""
        self._mine()
        self._call(self._place)

    @property
    def status(self) -> int:
        """How the last call ended."""
        return int(self._out[0])

    @property
    def q(self) -> FloatArray:
        """The configuration of the linkage (nq,), shared by both directions."""
        return self._state[: self._nq]


class Transmission(Generic[LoopT]):
    """How coordinates of a robot, and the actuators behind its linkages, move and load each other.

    For a policy or a controller that knows the coordinates alone. Made by `ClosedLoopModel.transmission`.
    Joints that no closure or coupling ties to the coordinates are locked as in the reference configuration.
    Positions stay on the branch of the assembly where they start.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot as it is now.
    coordinates : iterable of str
        Joints with one degree of freedom, whose positions are the coordinates.
    actuators : iterable of str, optional
        As many actuated joints; by default all those of the linkage.
    level : str
        As of `ClosedLoopModel.compile`.

    Raises
    ------
    ModelError
        If a joint does not exist or has several degrees of freedom, if there are not as many actuators as
        coordinates, or one side does not determine the other.
    AssemblyError
        If the loops do not close at the reference configuration.
    """

    def __init__(
        self,
        loop: LoopT,
        coordinates: Iterable[str],
        actuators: Iterable[str] | None = None,
        level: str = "auto",
    ) -> None:
        self.coordinates = _names("coordinates", coordinates)
        chosen = () if actuators is None else _names("actuators", actuators)
        self.robot: LoopT = linkage_of(loop, (*self.coordinates, *chosen))
        """The linkage: the robot without the joints that are locked; its q is that of the results."""
        self.actuators = chosen or self.robot.actuated
        if len(self.actuators) != len(self.coordinates):
            raise ModelError(
                f"transmission: expected as many actuators as coordinates: for {', '.join(self.coordinates)} "
                f"there are {', '.join(self.actuators) or 'none'}; name more coordinates (a joint with an "
                "actuator of its own is one), or lock joints"
            )
        self.joint = Side(self.robot, self.coordinates, self.actuators, level)  # from the coordinates
        self.actuator = self.joint  # from the actuators: the same where these are the coordinates
        if self.actuators != self.coordinates:
            self.actuator = Side(self.robot, self.actuators, self.coordinates, level)
        bare = _bare(self.robot, self.coordinates)
        self.bare = Side(
            bare, self.coordinates, self.actuators, level
        )  # from the coordinates, of cranks and rods

    def __repr__(self) -> str:
        return f"Transmission({', '.join(self.coordinates)} <-> {', '.join(self.actuators)})"

    @cached_property
    def home(self) -> FloatArray:
        """Configuration (nq,) of the linkage where searches start: closed, on the branch that is kept."""
        return self.robot.regular_configuration

    def positions(self, side: str, q: FloatArray) -> FloatArray:
        """Return the positions (n,) of the side ``"joint"`` or ``"actuator"`` in a configuration (nq,).

        Parameters
        ----------
        side : {"joint", "actuator"}
            Whose.
        q : (nq,) array
            Configuration of the linkage.
        """
        one: Side = getattr(self, side)
        return np.asarray(one.settle.values(q[None])[0])

    def joint_to_actuator(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        near: ArrayLike | None = None,
    ) -> MappedMotion:
        """Return the motion of the actuators for one of the coordinates, at one sample or at N.

        Parameters
        ----------
        position : (n,) or (N, n) array
            Of the coordinates [m or rad].
        velocity, acceleration : array of the same shape, optional
            At rest by default.
        near : (nq,) array, optional
            Configuration of the linkage where the search starts once its loops are closed; `home` by
            default.

        Raises
        ------
        InputError
            If an array has the wrong shape, or one sample is not finite.
        AssemblyError
            Of one sample: if the linkage does not reach it on its branch; those of many are in ``errors``.
        SingularityError
            Of one sample: if the actuators' motion is not determined there; likewise.
        """
        return self._mapped(self.joint, self.actuator, (position, velocity, acceleration), near)

    def actuator_to_joint(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        near: ArrayLike | None = None,
    ) -> MappedMotion:
        """Return the motion of the coordinates for one of the actuators, as `joint_to_actuator`.

        Parameters
        ----------
        position, velocity, acceleration, near
            As of `joint_to_actuator`, of the actuators.

        Raises
        ------
        InputError, AssemblyError, SingularityError
            As `joint_to_actuator`.
        """
        return self._mapped(self.actuator, self.joint, (position, velocity, acceleration), near)

    def actuator_forces(self, q: ArrayLike, joint_forces: ArrayLike) -> FloatArray:
        """Return the forces of the actuators that have the virtual power of forces of the coordinates.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations, as `joint_to_actuator` and `actuator_to_joint` return them.
        joint_forces : (n,) or (N, n) array
            Forces of the coordinates [N or N m].

        Raises
        ------
        InputError
            If an array has the wrong shape.
        SingularityError
            If the actuators do not determine the motion; of many configurations, forces there are NaN.
        """
        return self._at(self.actuator, "forces", q, forces=joint_forces)["forces"]

    def joint_forces(self, q: ArrayLike, actuator_forces: ArrayLike) -> FloatArray:
        """Return the forces of the coordinates that have the virtual power of forces of the actuators.

        Parameters
        ----------
        q, actuator_forces
            As of `actuator_forces`.

        Raises
        ------
        InputError, SingularityError
            As `actuator_forces`; where the coordinates do not determine the motion.
        """
        return self._at(self.joint, "forces", q, forces=actuator_forces)["forces"]

    def actuator_gains(
        self,
        q: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return gains of a controller of the actuators that acts like one of the coordinates.

        To first order in small motions about `q`; feed forward `actuator_forces` of the same forces.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations.
        stiffness, damping : (n,), (n, n) or (N, n, n) array
            Gains of the coordinates, or their diagonals; no damping by default.
        joint_forces : (n,) or (N, n) array, optional
            Forces that the coordinates bear: turning with the linkage, they are stiffness, too. By default
            none.

        Raises
        ------
        InputError, SingularityError
            As `actuator_forces`.
        """
        return self._gains(self.actuator, q, stiffness, damping, joint_forces)

    def joint_gains(
        self,
        q: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike | None = None,
        actuator_forces: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the stiffness and damping that gains of the actuators give the coordinates.

        Parameters
        ----------
        q, stiffness, damping, actuator_forces
            As of `actuator_gains`, with the sides changed.

        Raises
        ------
        InputError, SingularityError
            As `joint_forces`.
        """
        return self._gains(self.joint, q, stiffness, damping, actuator_forces)

    def joint_dynamics(
        self,
        q: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> ReflectedDynamics:
        """Return inertia of the whole, and forces for a motion, in the coordinates.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations.
        velocity, acceleration : (n,) or (N, n) array, optional
            Of the coordinates; at rest by default.
        gravity : (3,) or (N, 3) array, optional
            Less the acceleration of what carries the linkage, in axes that turn with it and are those of the
            world in the reference configuration [m/s²]: what an accelerometer there measures, with the other
            sign. That of the robot by default.

        Raises
        ------
        InputError, SingularityError
            As `joint_forces`.
        """
        return self._dynamics(self.joint, q, velocity, acceleration, gravity)

    def actuator_dynamics(
        self,
        q: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> ReflectedDynamics:
        """Return inertia of the whole, and forces for a motion, in the actuators: their inverse dynamics.

        Parameters
        ----------
        q, velocity, acceleration, gravity
            As of `joint_dynamics`, of the actuators.

        Raises
        ------
        InputError, SingularityError
            As `actuator_forces`.
        """
        return self._dynamics(self.actuator, q, velocity, acceleration, gravity)

    def linkage_dynamics(
        self,
        q: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> ReflectedDynamics:
        """Return what a model of the coordinates' own joints and bodies lacks: cranks, rods and rotors.

        To a serial model, whose bodies are those that the coordinates' joints carry, the inertia is armature;
        its forces and these together, mapped by `actuator_forces`, are those of the whole.

        Parameters
        ----------
        q, velocity, acceleration, gravity
            As of `joint_dynamics`.

        Raises
        ------
        InputError, SingularityError
            As `joint_forces`.
        """
        return self._dynamics(self.bare, q, velocity, acceleration, gravity)

    def _dynamics(self, side: Side, q: ArrayLike, *given: ArrayLike | None) -> ReflectedDynamics:
        n, usual = len(side.names), self.robot.model.gravity.linear
        v, a, g = ((np.zeros(n) if i < 2 else usual) if x is None else x for i, x in enumerate(given))
        found = self._at(side, "dynamics", q, v=v, a=a, gravity=g)
        inertia, forces = found["inertia"], found["forces"]
        return ReflectedDynamics(inertia.reshape(*inertia.shape[:-1], n, n), forces)

    def force_limits(self, q: ArrayLike) -> ForceLimits:
        """Return the forces of the coordinates that the actuators can give within their limits of effort.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configurations.

        Raises
        ------
        ModelError
            If an actuator has no limit.
        InputError, SingularityError
            As `actuator_forces`.
        """
        model, n = self.robot.model, len(self.coordinates)
        places = list(self.actuator.followed)
        upper, lower = (np.array(limit)[places] for limit in (model.upperEffortLimit, model.lowerEffortLimit))
        if not (np.isfinite(upper) & np.isfinite(lower)).all():
            raise ModelError(f"force limits: not all of {', '.join(self.actuators)} have a limit of effort")
        columns = [self.actuator_forces(q, unit) for unit in np.eye(n)]
        A = np.stack(columns, axis=-1)  # rows by actuator
        corners = np.array([*product(*zip(lower, upper, strict=True))])
        if n == 2:
            corners = corners[[0, 1, 3, 2]]  # around it
        vertices = np.stack([self.joint_forces(q, corner) for corner in corners], axis=-2)
        return ForceLimits(np.concatenate([A, -A], axis=-2), np.concatenate([upper, -lower]), vertices)

    def traced(self, side: str, name: str, namespace: Any = np) -> Callable[..., dict[str, Any]]:
        """Return a function of one direction as one of arrays, of NumPy, JAX or another that is like it.

        It branches on nothing, so that it can be compiled, vectorised and differentiated there.

        Parameters
        ----------
        side : {"joint", "actuator"}
            What is given.
        name : {"close", "motion", "forces", "gains", "dynamics"}
            ``close`` takes q (..., nq) and returns it one step of Newton's method nearer; ``motion`` and
            ``dynamics`` take q, velocity and acceleration (..., n) of what is given, the latter
            also gravity (..., 3); ``forces``: q and forces
            of the other side; ``gains``: q, its stiffness and damping by rows (..., n²), and its forces.
            Outputs are by name, matrices by rows.
        namespace : module
            Has ``sqrt``, ``sin``, ``stack`` and so on: `numpy`, ``jax.numpy``.

        Raises
        ------
        InputError
            If there is no such direction or function.
        """
        known_functions = [one for one in FUNCTIONS if "single" not in one]
        if side not in _SIDES or name not in known_functions:
            known = f"'joint' or 'actuator' and one of {', '.join(known_functions)}"
            raise InputError(f"traced: expected {known}, got {shown(side)} and {shown(name)}")
        function: Function = getattr(self, side).function(name)
        flat = function_of(function.tape, function.symbols, function.results, namespace)

        def call(*groups: Any) -> dict[str, Any]:
            sized = zip(groups, function.inputs.values(), strict=True)
            columns = namespace.broadcast_arrays(
                *flat(*(x[..., i] for x, size in sized for i in range(size)))
            )
            found, start = {}, 0
            for key, size in function.outputs.items():
                found[key] = namespace.stack(columns[start : start + size], axis=-1)
                start += size
            return found

        return call

    def bind(self) -> tuple[BoundDirection, BoundDirection]:
        """Return both directions for a loop at kHz: from coordinates to actuators, and back.

        They share a configuration, at first `home`, which every call that ends well moves on: each search
        starts where the last one ended. Positions of joints that turn without end count their turns.

        Raises
        ------
        ModelError
            If there is no C compiler.
        """
        if self.joint.level == "numpy":
            raise ModelError("transmission: bind needs a C compiler; joint_to_actuator does without one")
        state = np.concatenate([self.home, *(self.positions(key, self.home) for key in _SIDES)])
        mine = OneThread("the arrays of this transmission, bind one in each thread").check
        own = ctypes.PyDLL(self._library._name)
        sides, calls = (self.joint, self.actuator), (own.joint_bound, own.actuator_bound)
        one, other = (BoundDirection(*pair, state, mine) for pair in zip(sides, calls, strict=True))
        return one, other

    @cached_property
    def _library(self) -> ctypes.CDLL:
        """Both directions in C."""
        texts = [mapping_text(self, key) for key in _SIDES]
        functions = [
            replace(getattr(self, key).function(name), name=f"{key}_{name}")
            for key in _SIDES
            for name in MAPS
        ]
        parts = [
            fill("transmission.in", **text, compute="", one="_one", unreached=1, singular=2) for text in texts
        ]
        for own, text in enumerate(texts):
            more = {"own": own, "results": len(functions[2 * own + 1].results), "other": _SIDES[1 - own]}
            parts.append(fill("transmission_bound.in", **text, **more))
        (library,) = libraries([lanes_source(functions, "\n".join(parts), calls=False)], self.joint.level)
        return library

    def _settled(self, side: Side, start: FloatArray, values: FloatArray) -> Settled:
        """Return configurations at positions (N, n) of a side, from one that is closed."""
        if side.level == "numpy":
            return side.settle(start, values)
        count, blocks = len(values), [*slices(len(values), _BLOCK)]
        q, good = np.empty((count, len(start))), np.zeros(count, dtype=bool)
        begin, targets = side.settle.values(start[None]), np.ascontiguousarray(values)
        call = self._library.joint_many if side is self.joint else self._library.actuator_many
        call.argtypes, call.restype = [ctypes.c_ssize_t, *[ctypes.c_void_p] * 5], None

        def run(part: tuple[int, int]) -> None:
            for block in blocks[slice(*part)]:
                places = [array[block].ctypes.data for array in (targets, q, good)]
                call(block.stop - block.start, start.ctypes.data, begin.ctypes.data, *places)

        in_threads(run, shares(len(blocks), thread_count(None)))
        rest = np.flatnonzero(~good)  # out of reach, or farther than C goes at a time
        if len(rest):
            q[rest], good[rest] = side.settle(start, values[rest])
        return Settled(q, good)

    def _mapped(
        self, side: Side, other: Side, motion: Sequence[ArrayLike | None], near: ArrayLike | None
    ) -> MappedMotion:
        n, first = len(side.names), as_floats("position", motion[0])
        single, shape = first.ndim == 1, (n,) if first.ndim == 1 else (len(first), n)
        rows = []
        for name, value in zip(("position", "velocity", "acceleration"), motion, strict=True):
            array = np.zeros(shape) if value is None else as_floats(name, value)
            if array.shape != shape or array.ndim > 2:
                told = f"({n},) or (N, {n})" if name == "position" else str(shape)
                raise InputError(f"{name}: expected shape {told}, got {array.shape}")
            rows.append(np.array(np.atleast_2d(array)))
        start = self.home if near is None else self.robot.assemble(None, guess=near).q
        finite = np.asarray(np.isfinite(np.concatenate(rows, axis=1)).all(axis=1))
        rows[0][~finite] = side.settle.values(start[None])
        q, good = self._settled(side, np.ascontiguousarray(start), rows[0])
        found = side.rows("motion", {"q": q, "v": rows[1], "a": rows[2]})
        position = other.settle.values(q)
        errors: dict[int, P3dofError] = {}
        for i in np.flatnonzero(~(finite & good & (found["trusted"][:, 0] > 0.0))).tolist():
            if not finite[i]:
                errors[i] = InputError(f"transmission: expected finite numbers, sample {i} has others")
            else:
                margin = float(found["margin"][i, 0])
                errors[i] = self._failure(side, rows[0][i], start if single else None, bool(good[i]), margin)
            if single:
                raise errors[i]
        found |= {"q": q, "position": position}
        for array in found.values():
            array[list(errors)] = np.nan
        found |= {"jacobian": found["jacobian"].reshape(-1, n, n), "margin": found["margin"][:, 0]}
        names = ("q", "position", "velocity", "acceleration", "jacobian", "margin")
        chosen = {name: read_only(found[name][0] if single else found[name]) for name in names}
        return MappedMotion(**chosen, errors=errors)

    def _failure(
        self, side: Side, values: FloatArray, start: FloatArray | None, good: bool, margin: float
    ) -> P3dofError:
        """Return why a sample has no result; with a start, after a search for one on other branches."""
        told = ", ".join(f"{name}={value:.4g}" for name, value in zip(side.names, values, strict=True))
        if good:
            return SingularityError(
                f"transmission: at {told} the motion is not determined: margin {margin:.2g}"
            )
        if start is None:
            return AssemblyError(f"transmission: the linkage does not reach {told} on its branch")
        try:
            self.robot.assemble(dict(zip(side.names, values.tolist(), strict=True)), guess=start)
        except AssemblyError as error:
            return AssemblyError(f"transmission: the linkage does not reach {told}: {error}", error.gap)
        return AssemblyError(
            f"transmission: {told} is reached on another branch only, behind a singular position"
        )

    def _at(self, side: Side, name: str, q: ArrayLike, **given: ArrayLike) -> dict[str, FloatArray]:
        """Return outputs of a function at configurations, NaN at failed and at singular ones of many."""
        function, rows = side.function(name), np.atleast_2d(as_floats("q", q))
        count = max(len(rows), *(len(np.atleast_2d(np.asarray(value))) for value in given.values()))
        inputs: dict[str, FloatArray] = {}
        for key, value in {"q": rows, **given}.items():
            array, size = np.atleast_2d(as_floats(key, value)), function.inputs[key]
            if array.shape not in ((1, size), (count, size)):
                raise InputError(
                    f"{key}: expected shape ({size},) or ({count}, {size}), got {np.shape(value)}"
                )
            inputs[key] = np.ascontiguousarray(np.broadcast_to(array, (count, size)))
        found = side.rows(name, inputs)
        gaps, margins = (
            np.where(np.isnan(inputs["q"][:, 0]), 0.0, found[key][:, 0]) for key in ("gap", "margin")
        )
        if (gaps > function.closed).any():
            i = int(np.argmax(gaps))
            raise InputError(f"q: the loops are open by {gaps[i]:.3g} m or rad at configuration {i}")
        single = np.ndim(q) == 1 and all(np.ndim(value) == 1 for value in given.values())
        failed = ~(found["trusted"][:, 0] > 0.0)
        if single and failed[0]:
            raise SingularityError(
                f"transmission: near a singular configuration: margin {margins[0]:.2g}, expected at least "
                f"{function.least_margin:g}"
            )
        for array in found.values():
            array[failed] = np.nan
        return {key: read_only(found[key][0] if single else found[key]) for key in function.outputs}

    def _gains(
        self,
        side: Side,
        q: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike | None,
        forces: ArrayLike | None,
    ) -> tuple[FloatArray, FloatArray]:
        n = len(self.coordinates)
        gains = {
            "stiffness": _matrices("stiffness", stiffness, n),
            "damping": _matrices("damping", np.zeros(n) if damping is None else damping, n),
        }
        found = self._at(side, "gains", q, **gains, forces=np.zeros(n) if forces is None else forces)
        K, D = (found[name].reshape(*found[name].shape[:-1], n, n) for name in gains)
        return K, D


def _matrices(name: str, value: ArrayLike, n: int) -> FloatArray:
    """Return gains by rows, (n²,) or (N, n²), from diagonals or matrices."""
    array = as_floats(name, value)
    if array.shape == (n,):
        array = np.diag(array)
    if array.shape[-2:] != (n, n) or array.ndim > 3:
        raise InputError(f"{name}: expected shape ({n},), ({n}, {n}) or (N, {n}, {n}), got {np.shape(value)}")
    return array.reshape(*array.shape[:-2], n * n)


def _names(what: str, names: Iterable[str]) -> tuple[str, ...]:
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError(f"{what}: expected several names, got {shown(names)}")
    found = tuple(names)
    if not found:
        raise InputError(f"{what}: expected at least one joint")
    if len(set(found)) < len(found):
        raise InputError(f"{what}: a joint is named twice")
    return found
