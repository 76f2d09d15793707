"""Base parameters: the combinations of parameters that forces of motions with closed loops can show.

The regressors of random motions are put under each other, W φ = forces. Columns of W that depend on others
add their parameters to those of the others, W = W_base K, and π = K φ are as many as W has rank.

References
----------
M. Gautier, Numerical calculation of the base inertial parameters of robots, Journal of Robotic Systems 8
(1991) 485-506.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError, DynamicsError
from p3dof.loops.closures import ClosurePoint
from p3dof.loops.linear import RANK_TOLERANCE
from p3dof.loops.loop_model import LoopModel

_NOTHING = 1e-11
"""The same for the size of a column."""
_ROUNDING = 1e-9
"""Share of a column in another one that counts as none."""
_STEP, _SPEED, _ACCELERATION = 0.4, 3.0, 10.0
"""How far, how fast motions go, in rad or the model's own unit of length."""
_FEWEST_ROWS = 1.2
"""Rows of W at first, over its columns."""
_TRIES = 10
"""Random configurations tried for each that is wanted."""


@dataclass(frozen=True, eq=False)
class BaseParameters:
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
    loop: LoopModel, generator: np.random.Generator
) -> Callable[[], tuple[ClosurePoint, FloatArray, FloatArray]]:
    """Return what draws motions with closed loops around the reference assembly.

    Parameters
    ----------
    loop : LoopModel
        The robot, in its own unit of length.
    generator : np.random.Generator
        Where chance comes from.

    Returns
    -------
    callable
        Returns closures, velocity and acceleration (nv,) of another motion.

    Raises
    ------
    AssemblyError
        If the loops do not close at the reference.
    """
    k = loop._kinematics
    home = loop.assemble().q
    free = k.at(home).svd.null_space
    n = free.shape[1]

    def draw() -> tuple[ClosurePoint, FloatArray, FloatArray]:
        for _ in range(_TRIES):
            step = _STEP * free @ generator.normal(size=n)
            try:
                q = loop.assemble(None, np.array(pin.integrate(loop.model, home, step))).q
            except AssemblyError:
                continue
            point = k.at(q)
            N = point.svd.null_space
            if N.shape[1] == n:
                v = _SPEED * N @ generator.normal(size=n)
                a = _ACCELERATION * N @ generator.normal(size=n)
                if point.J.size:
                    k.move(q, v)
                    a = a - point.svd.solve(k.acceleration())
                return point, v, a
        raise DynamicsError("base parameters: no motions with closed loops were found around the reference")

    return draw


def base_parameters(
    rows: Callable[[], FloatArray], names: tuple[str, ...], parameters: FloatArray
) -> BaseParameters:
    """Return the base parameters that regressors of many motions can tell.

    Parameters
    ----------
    rows : callable
        Returns the regressor (n, P) of another motion.
    names : tuple of str
        Of the P parameters.
    parameters : (P,) array
        Their values.

    Returns
    -------
    BaseParameters
    """
    blocks = [rows()]
    wanted = int(_FEWEST_ROWS * len(names) / max(1, len(blocks[0]))) + 4
    rank = -1
    while True:
        blocks += [rows() for _ in range(wanted - len(blocks))]
        W = np.concatenate(blocks)
        size = np.linalg.norm(W, axis=0)
        kept = np.flatnonzero(size > _NOTHING * size.max(initial=0.0))
        s = np.linalg.svd(W[:, kept] / size[kept], compute_uv=False)
        found = int(np.count_nonzero(s > RANK_TOLERANCE * s.max(initial=0.0)))
        if found == rank:
            break
        rank, wanted = found, len(blocks) + max(4, len(blocks) // 2)
    beside = np.append(s / s.max(initial=0.0), 0.0)[max(0, rank - 1) :] if rank else np.zeros(2)
    columns, matrix = _combined(W, size, kept, rank)
    return BaseParameters(
        names=tuple(_told(row, names, k) for row, k in zip(matrix, columns, strict=True)),
        values=matrix @ parameters,
        matrix=matrix,
        columns=columns,
        parameter_names=names,
        parameters=parameters,
        samples=len(blocks),
        margin=(float(beside[0]), float(beside[1])),
    )


def _combined(
    W: FloatArray, size: FloatArray, kept: NDArray[np.int_], rank: int
) -> tuple[NDArray[np.int_], FloatArray]:
    """Return which columns are the base, and K (rank, P)."""
    from scipy.linalg import qr, solve_triangular  # not at start-up

    scaled = W[:, kept] / size[kept]
    order = qr(scaled, mode="r", pivoting=True)[1]
    base = np.sort(order[:rank])  # in the order of the parameters
    rest = np.setdiff1d(order, base)
    R = np.asarray(np.linalg.qr(scaled[:, np.concatenate((base, rest))]).R)
    share = solve_triangular(R[:rank, :rank], R[:rank, rank:])
    share[np.abs(share) < _ROUNDING] = 0.0
    columns = kept[base]
    matrix = np.zeros((rank, W.shape[1]))
    matrix[np.arange(rank), columns] = 1.0
    matrix[:, kept[rest]] = share * size[kept[rest]] / size[columns, None]
    return columns, matrix


def _told(row: FloatArray, names: tuple[str, ...], first: int) -> str:
    """Return a combination in words, its own parameter first."""
    words = names[first]
    for k in np.flatnonzero(row):
        if k != first:
            factor = f"{abs(row[k]):.4g}"
            words += f" {'-' if row[k] < 0 else '+'} {'' if factor == '1' else factor + ' '}{names[k]}"
    return words
