"""Results of compiled dynamics, with the samples that the general layer had to compute."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import P3dofError
from p3dof.loops.derivatives import ByForces, ByMotion
from p3dof.loops.results import read_only


@dataclass(frozen=True, eq=False)
class CompiledDynamics(Readable):
    """Results of compiled dynamics at one sample, or at N.

    Parameters
    ----------
    margin : (N,) array
        Smallest pivot over what it usually is: towards zero the partition of speeds fails.
    gap : (N,) array
        How far the loops are open: the length of the vector of all errors [m, rad].
    general : (N,) array of bool
        Samples that the general layer computed: below the margin, not closed, or with forces that no actuator
        gives.
    errors : dict of int to P3dofError
        Of samples that failed; their results are NaN.
    tau : (N, n_actuated) array, optional
        Forces of the actuated joints [N or N m].
    lambda_ : (N, rows) array, optional
        Multipliers, as in `InverseDynamics`; where they are not unique, others than there.
    q : (N, nq) array, optional
        Configurations.
    v, a : (N, nv) array, optional
        Velocities and accelerations of the tree.
    """

    margin: FloatArray
    gap: FloatArray
    general: NDArray[np.bool_]
    errors: dict[int, P3dofError]
    tau: FloatArray | None = None
    lambda_: FloatArray | None = None
    q: FloatArray | None = None
    v: FloatArray | None = None
    a: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class CompiledDerivatives(Readable):
    """Forces or accelerations at one sample or at N, and their exact derivatives on the constraint manifold.

    Parameters
    ----------
    values : (N, m) array
        Forces of the actuated joints, or accelerations of the tree.
    by : ByMotion or ByForces
        Their derivatives (N, m, n) by the independent coordinates, their speeds, and their accelerations or
        the actuators' forces; columns in the order of `CompiledLoop.independent`.
    margin : (N,) array
        As in `CompiledDynamics`.
    general : (N,) array of bool
        As in `CompiledDynamics`.
    errors : dict of int to P3dofError
        As in `CompiledDynamics`.
    """

    values: FloatArray
    by: ByMotion | ByForces
    margin: FloatArray
    general: NDArray[np.bool_]
    errors: dict[int, P3dofError]


def with_general(
    found: dict[str, FloatArray],
    alone: Callable[[int], dict[str, ArrayLike]],
    names: Sequence[str],
    single: bool,
) -> CompiledDynamics:
    """Return results, with samples that are not to be trusted by the general layer."""
    doubtful = ~(found["trusted"][:, 0] > 0.0)
    errors: dict[int, P3dofError] = {}
    for i in np.flatnonzero(doubtful).tolist():
        try:
            values: Mapping[str, Any] = alone(i)
        except P3dofError as error:
            if single:
                raise
            errors[i] = error
            values = dict.fromkeys(names, np.nan)
        for name in names:
            found[name][i] = values[name]
    chosen = {name: found[name] for name in names}
    arrays = {"margin": found["margin"][:, 0], "gap": found["gap"][:, 0], **chosen}
    if single:
        arrays = {name: array[0] for name, array in arrays.items()}
        doubtful = doubtful[0]
    return CompiledDynamics(
        general=doubtful, errors=errors, **{name: read_only(np.asarray(x)) for name, x in arrays.items()}
    )


@dataclass(frozen=True, eq=False)
class Tangents:
    """What a tangent function gives (N, directions, size), and where its groups of directions are."""

    found: dict[str, FloatArray]
    edges: list[int]


_By = TypeVar("_By", ByMotion, ByForces)


def derivatives_with_general(
    tangents: Tangents,
    names: tuple[str, str],
    kind: type[_By],
    alone: Callable[[int], tuple[FloatArray, _By]],
    single: bool,
) -> CompiledDerivatives:
    """Return derivatives, with samples that are not to be trusted by the general layer."""
    found = tangents.found
    errors: dict[int, P3dofError] = {}
    values = np.array(found[names[0]][:, 0])
    columns = found[names[1]].transpose(0, 2, 1)
    by: list[FloatArray] = [np.array(columns[:, :, first:stop]) for first, stop in pairwise(tangents.edges)]
    general = np.asarray(~(found["trusted"][:, :, 0] > 0.0).all(axis=1))
    for i in np.flatnonzero(general).tolist():
        try:
            values[i], told = alone(i)
            parts: Sequence[ArrayLike] = tuple(vars(told).values())
        except P3dofError as error:
            if single:
                raise
            errors[i], values[i], parts = error, np.nan, (np.nan,) * 3
        for array, part in zip(by, parts, strict=True):
            array[i] = part
    arrays = [read_only(x[0] if single else x) for x in (values, *by, found["margin"][:, 0, 0])]
    return CompiledDerivatives(
        arrays[0], kind(*arrays[1:4]), arrays[4], np.asarray(general[0] if single else general), errors
    )
