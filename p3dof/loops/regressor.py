"""What the forces of any robot owe to each inertial parameter of its bodies and each datum of its joints.

Base parameters: the combinations of parameters that forces of motions with closed loops can show.

The regressors of random motions are put under each other, W φ = forces. Columns of W that depend on others
add their parameters to those of the others, W = W_base K, and π = K φ are as many as W has rank.

References
----------
M. Gautier, Numerical calculation of the base inertial parameters of robots, Journal of Robotic Systems 8
(1991) 485-506.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, whole
from p3dof._base.errors import AssemblyError, DynamicsError
from p3dof._base.threads import Own
from p3dof.loops.bushings import Bushings
from p3dof.loops.closed_tree import ClosedTree, Loads
from p3dof.loops.closures import ClosurePoint
from p3dof.loops.coordinates import TurningSpring
from p3dof.loops.linear import RANK_TOLERANCE, actuation_of
from p3dof.loops.minimal import Names, Setting, coordinate_names, pivoted, stacked
from p3dof.loops.sidecar import JointData

MOMENTS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Inertial parameters of a body, about the origin of its joint and in its axes, in Pinocchio's order."""
JOINT = ("armature", "damping", "friction", "stiffness", "preload")
"""Parameters of a joint's freedom; stiffness and preload only of joints that have one, and the
stiffness of balls and free joints with a spring."""


@dataclass(frozen=True, eq=False)
class LoopRegressor(Readable):
    """How forces depend on the parameters, at one motion or (leading axis N) at many; exact.

    Parameters
    ----------
    parameter_names : tuple of str
        Of the P parameters: ``body.name`` with a link's name and the names in `MOMENTS`, masses [kg], first
        moments [kg m] and inertias [kg m²] about the origin of the joint that carries the body; then
        ``joint.armature``, ``joint.damping``, ``joint.friction``, ``joint.stiffness`` (about `rest` of
        `JointData`) and ``joint.preload``, a constant force that resists: less its `force`.
    parameters : (P,) array
        Their values.
    forces : (..., m, P) array
        Of the actuators: tau = forces @ parameters + external; the smallest, where they are not unique.
    external : (..., m) array
        What external wrenches and joint forces add.
    coordinates : tuple of str
        Names of independent coordinates.
    generalised : (..., n, P) array
        Along these coordinates: generalised @ parameters = actuation @ tau + generalised_external. With idle
        freedoms it says more than `forces`.
    generalised_external : (..., n) array
        Of external wrenches and joint forces, along the coordinates.
    actuation : (..., n, m) array
        As in `MinimalDynamics`.
    """

    parameter_names: tuple[str, ...]
    parameters: FloatArray
    forces: FloatArray
    external: FloatArray
    coordinates: tuple[str, ...]
    generalised: FloatArray
    generalised_external: FloatArray
    actuation: FloatArray

    @property
    def inertial(self) -> FloatArray:
        """The columns of `forces` of the inertial parameters of the bodies, (..., m, 10 per body)."""
        bodies = sum(name.rsplit(".", 1)[1] in MOMENTS for name in self.parameter_names)
        return self.forces[..., :bodies]


class TreeRegressor:
    """The regressor of a tree: inertial parameters of its bodies, data of its joints and bushings."""

    def __init__(self, model: pin.Model, joint_data: Sequence[JointData], bushings: Bushings | None) -> None:
        self._bushings = bushings
        self._model, self._data = model, Own(model.createData)
        given = {entry.joint: entry for entry in joint_data}
        each = [
            given.get(str(model.names[i]), JointData(str(model.names[i]))) for i in range(1, model.njoints)
        ]
        sizes = [model.nvs[i] for i in range(1, model.njoints)]
        self._friction = np.repeat([(one.damping, one.friction) for one in each], sizes, axis=0)
        self._smoothing = np.repeat([one.smoothing for one in each], sizes)
        single = [i for i in range(1, model.njoints) if model.nvs[i] == 1]
        self._single_v = np.array([model.idx_vs[i] for i in single], dtype=int)
        self._single_q = np.array([model.idx_qs[i] for i in single], dtype=int)
        self._circles = np.array([model.nqs[i] == 2 for i in single], dtype=bool)
        self._stiffness = np.array([each[i - 1].stiffness for i in single])
        self._rest = np.array([each[i - 1].rest for i in single])
        self._preload = np.array([-each[i - 1].force for i in single])
        several = [i for i in range(1, model.njoints) if model.nvs[i] > 1 and each[i - 1].stiffness]
        self._turning = [TurningSpring.of(model, i, each[i - 1]) for i in several]
        freedoms = coordinate_names(model)
        bodies = [f"{body}.{moment}" for body in body_names(model) for moment in MOMENTS]
        joints = [f"{freedom}.{what}" for what in JOINT[:3] for freedom in freedoms]
        joints += [f"{model.names[i]}.{what}" for what in JOINT[3:] for i in single]
        joints += [f"{model.names[i]}.stiffness" for i in several]
        joints += bushings.parameters if bushings else ()
        self.inertial = len(bodies)  # how many inertial parameters there are; they come first
        self.names = (*bodies, *joints)  # of all parameters

    def parameters(self) -> FloatArray:
        """Return the values of all parameters, as the tree has them now."""
        bodies = [self._model.inertias[i].toDynamicParameters() for i in range(1, self._model.njoints)]
        joints = np.asarray(self._model.armature), *self._friction.T, self._stiffness
        turning = [spring.stiffness for spring in self._turning]
        between = list(self._bushings.parameters.values()) if self._bushings else []
        return np.concatenate([np.zeros(0), *bodies, *joints, self._preload, turning, between])

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the matrix (nv, P) from the parameters to the generalised forces that the motion takes."""
        nv, count = len(v), len(self._rest)
        bodies = np.array(pin.computeJointTorqueRegressor(self._model, self._data.here, q, v, a))
        values = q[self._single_q] - self._rest
        if self._circles.any():
            at = self._single_q[self._circles]
            angle = np.arctan2(q[at + 1], q[at]) - self._rest[self._circles]
            values[self._circles] = np.arctan2(np.sin(angle), np.cos(angle))
        springs = np.zeros((nv, 2 * count))
        springs[self._single_v, np.arange(count)] = values
        springs[self._single_v, count + np.arange(count)] = 1.0
        turning = np.zeros((nv, len(self._turning)))
        for k, spring in enumerate(self._turning):
            turning[spring.v, k] = spring.stretch(q)
        joints = (np.diag(x) for x in (a, v, np.tanh(v / self._smoothing)))
        between = self._bushings.regressor(q, v) if self._bushings else np.zeros((nv, 0))
        return np.concatenate((bodies, *joints, springs, turning, between), axis=1)


def force_regressor(
    setting: Setting,
    regressor: TreeRegressor,
    motion: tuple[ArrayLike, ArrayLike, ArrayLike],
    coordinates: Names,
    loads: Loads,
) -> LoopRegressor:
    """Return what the forces of a motion q, v, a owe to the parameters; see `ClosedLoopModel`."""
    q, v, a = motion
    if np.ndim(q) == 2:
        q, v = setting.samples(q, v)
        a = frozen_array("a", a, v.shape)
        names = setting.coordinates(setting.robot.configuration("q", q[0]), coordinates)
        each = zip(q, v, a, strict=True)
        results = [force_regressor(setting, regressor, one, names, loads) for one in each]
        return stacked(results, ("parameter_names", "parameters"))
    robot, (q, v) = setting.robot, setting.robot.state(q, v)
    a = frozen_array("a", a, v.shape)
    with setting.open():
        at = setting.independent(q, coordinates, v)
        setting.core.moving(at.point.q, v / setting.v, a / setting.v)
    free = at.point.svd.null_space
    actuation = actuation_of(at.point.svd, robot.actuated_v)
    to_tau = actuation.pseudo_inverse @ free.T  # of generalised forces: the smallest ones
    to_tau = setting.motors[:, None] * to_tau / setting.force
    N, Y = setting.motion(at), regressor.rows(q, v, a)
    robot.kinematics.at(q)
    load = robot.force(loads)
    return LoopRegressor(
        parameter_names=regressor.names,
        parameters=regressor.parameters(),
        forces=to_tau @ Y,
        external=-to_tau @ load,
        coordinates=at.names,
        generalised=N.T @ Y,
        generalised_external=N.T @ load,
        actuation=N[robot.actuated_v].T.copy(),
    )


def body_names(model: pin.Model) -> list[str]:
    """Return a name for what each joint carries: that of its first link, else of the joint."""
    links: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            links.setdefault(int(frame.parentJoint), str(frame.name))
    names = [links.get(i, str(model.names[i])) for i in range(1, model.njoints)]
    return names if len(set(names)) == len(names) else [str(name) for name in model.names[1:]]


_NOTHING = 1e-11  # the same for the size of a column
_ROUNDING = 1e-9  # share of a column in another one that counts as none
_STEP, _SPEED, _ACCELERATION = 0.4, 3.0, 10.0
"""How far, how fast motions go, in rad or the model's own unit of length."""
_FEWEST_ROWS = 1.2  # rows of W at first, over its columns
_TRIES = 10  # random configurations tried for each that is wanted


@dataclass(frozen=True, eq=False)
class BaseParameters(Readable):
    """The combinations of parameters that forces can show.

    Parameters
    ----------
    names : tuple of str
        What each of the b base parameters is, such as ``crank.Izz + 0.04 coupler.m``.
    values : (b,) array
        Their values.
    matrix : (b, P) array
        K: values = matrix @ parameters.
    columns : (b,) array of int
        Which columns of a regressor are those of the base: forces = regressor[:, columns] @ values.
    parameter_names : tuple of str
        Of the P parameters.
    parameters : (P,) array
        Their values.
    samples : int
        How many motions it took.
    margin : tuple of float
        Smallest singular value of the stacked, scaled regressor that counts, and the largest that does not,
        relative to the largest of all: how clear the number is.
    """

    names: tuple[str, ...]
    values: FloatArray
    matrix: FloatArray
    columns: NDArray[np.int_]
    parameter_names: tuple[str, ...]
    parameters: FloatArray
    samples: int
    margin: tuple[float, float]

    def __len__(self) -> int:
        return len(self.names)

    def regressor(self, full: FloatArray) -> FloatArray:
        """Return the columns (..., b) of a regressor (..., P or more) that the base parameters need.

        Parameters
        ----------
        full : (..., P or more) array
            `forces` or `generalised` of a `LoopRegressor`.
        """
        return np.asarray(full)[..., self.columns]


def random_motions(
    robot: ClosedTree, generator: np.random.Generator
) -> Callable[[], tuple[ClosurePoint, FloatArray, FloatArray]]:
    """Return what draws closures, velocity and acceleration (nv,) of motions around the reference."""
    k = robot.kinematics
    home = robot.assemble().q
    free = k.at(home).svd.null_space
    nv, n = free.shape

    def within(N: FloatArray) -> FloatArray:  # the same on each processor, whichever basis N is
        return np.asarray(N @ (N.T @ generator.normal(size=nv)))

    def draw() -> tuple[ClosurePoint, FloatArray, FloatArray]:
        for _ in range(_TRIES):
            step = _STEP * within(free)
            try:
                q = robot.assemble(None, np.array(pin.integrate(robot.model, home, step))).q
            except AssemblyError:
                continue
            point = k.at(q)
            N = point.svd.null_space
            if N.shape[1] == n:
                v, a = _SPEED * within(N), _ACCELERATION * within(N)
                if point.J.size:
                    k.move(q, v)
                    a = a - point.svd.solve(k.acceleration())
                return point, v, a
        raise DynamicsError("base parameters: no motions with closed loops were found around the reference")

    return draw


def base_parameters(setting: Setting, regressor: TreeRegressor, joints: bool, seed: int) -> BaseParameters:
    """Return the base parameters of a robot; see `ClosedLoopModel.base_parameters`."""
    count = len(regressor.names) if joints else regressor.inertial
    with setting.open():
        draw = random_motions(setting.core, np.random.default_rng(whole("seed", seed, 0)))

        def rows() -> FloatArray:
            point, v, a = draw()
            Y = regressor.rows(point.q * setting.q, v * setting.v, a * setting.v)
            N = setting.v[:, None] * point.svd.null_space
            return np.asarray(N.T @ Y[:, :count])

        return base_of_rows(rows, regressor.names[:count], regressor.parameters()[:count])


def base_of_rows(
    rows: Callable[[], FloatArray], names: tuple[str, ...], parameters: FloatArray
) -> BaseParameters:
    """Return the base parameters that regressors of many motions can tell."""
    blocks = [rows()]
    wanted = int(_FEWEST_ROWS * len(names) / max(1, len(blocks[0]))) + 4
    rank = -1
    while True:
        blocks += [rows() for _ in range(wanted - len(blocks))]
        W = np.concatenate(blocks)
        size = np.linalg.norm(W, axis=0)
        kept = np.flatnonzero(size > _NOTHING * size.max(initial=0.0))
        _, s, Vt = np.linalg.svd(W[:, kept] / size[kept], full_matrices=False)
        found = int(np.count_nonzero(s > RANK_TOLERANCE * s.max(initial=0.0)))
        if found == rank:
            break
        rank, wanted = found, len(blocks) + max(4, len(blocks) // 2)
    beside = np.append(s / s.max(initial=0.0), 0.0)[max(0, rank - 1) :] if rank else np.zeros(2)
    columns, matrix = combined(W, size, kept, pivoted(Vt[:rank].T, np.array([], dtype=int)))
    return BaseParameters(
        names=tuple(in_words(row, names, k) for row, k in zip(matrix, columns, strict=True)),
        values=matrix @ parameters,
        matrix=matrix,
        columns=columns,
        parameter_names=names,
        parameters=parameters,
        samples=len(blocks),
        margin=(float(beside[0]), float(beside[1])),
    )


def combined(
    W: FloatArray, size: FloatArray, kept: NDArray[np.int_], base: NDArray[np.int_]
) -> tuple[NDArray[np.int_], FloatArray]:
    """Return which columns are the base, those of `kept` that `base` says, and K (rank, P)."""
    from scipy.linalg import solve_triangular  # not at start-up

    scaled, rank = W[:, kept] / size[kept], len(base)
    rest = np.setdiff1d(np.arange(len(kept)), base)
    R = np.asarray(np.linalg.qr(scaled[:, np.concatenate((base, rest))]).R)
    share = solve_triangular(R[:rank, :rank], R[:rank, rank:])
    share[np.abs(share) < _ROUNDING] = 0.0
    columns = kept[base]
    matrix = np.zeros((rank, W.shape[1]))
    matrix[np.arange(rank), columns] = 1.0
    matrix[:, kept[rest]] = share * size[kept[rest]] / size[columns, None]
    return columns, matrix


def in_words(row: FloatArray, names: tuple[str, ...], first: int) -> str:
    """Return a combination in words, its own parameter first."""
    words = names[first]
    for k in np.flatnonzero(row):
        if k != first:
            factor = f"{abs(row[k]):.4g}"
            words += f" {'-' if row[k] < 0 else '+'} {'' if factor == '1' else factor + ' '}{names[k]}"
    return words
