"""Reactions of all joints and closures of any robot at many samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats
from p3dof._base.errors import DynamicsError, InputError
from p3dof.loops.batch.linear import blocks
from p3dof.loops.reaction_algebra import IndexArray, Solved
from p3dof.loops.reactions import BoolArray, ReactionSolver


@dataclass(frozen=True, eq=False)
class BatchReactions:
    """The wrench that every joint and closure transmits at N samples; see `JointReactions`.

    Rows of samples without a solution are NaN, False or 0.

    Parameters
    ----------
    names : tuple of str
        Names of the joints, then of the closures.
    forces, moments : (N, n, 3) array
        The reactions [N, N m].
    determined_forces, determined_moments : (N, n, 3) array of bool
        Which components every solution has in common.
    rotations : (N, n, 3, 3) array
        The axes of each reaction, as columns, in the world frame.
    positions : (N, n, 3) array
        Where each reaction acts, in the world frame [m].
    undetermined : (N,) array of int
        How many independent changes of the closures' wrenches leave the motion as it is.
    fit : (N, 2, n, 2, 3) array
        What misfits of assembly may add to forces and moments, at worst and at random [N, N m]; zero unless
        the solver knows any.
    errors : dict of int to DynamicsError
        Why there is no solution, by sample; not for samples that are not finite.
    """

    names: tuple[str, ...]
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: NDArray[np.int_]
    fit: FloatArray
    errors: dict[int, DynamicsError]

    def arrays(self) -> dict[str, Any]:
        """Return the arrays by name."""
        return {name: getattr(self, name) for name in _ARRAYS}

    def put(self, solver: ReactionSolver, rows: IndexArray, found: Solved) -> None:
        """Enter the reactions of some samples, or why they have none."""
        wrong = {i: solver.error_of(found, i) for i in range(len(rows))}
        self.errors.update({int(rows[i]): error for i, error in wrong.items() if error is not None})
        good = np.array([i for i, error in wrong.items() if error is None], dtype=int)
        at, wrenches, determined = rows[good], found.wrenches[good], solver.determined(found)[good]
        self.forces[at], self.moments[at] = wrenches[..., :3], wrenches[..., 3:]
        self.determined_forces[at], self.determined_moments[at] = determined[:, :, 0], determined[:, :, 1]
        self.rotations[at], self.positions[at] = found.rotations[good], found.positions[good]
        self.undetermined[at] = found.undetermined[good]
        self.fit[at] = np.moveaxis(found.fit[:, good], 0, 1).reshape(self.fit[at].shape)


_ARRAYS = (
    "forces",
    "moments",
    "determined_forces",
    "determined_moments",
    "rotations",
    "positions",
    "undetermined",
    "fit",
)


def reactions_batch(
    solver: ReactionSolver,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    tau: ArrayLike,
    external: Mapping[str, ArrayLike] | None = None,
    joint_forces: ArrayLike | None = None,
    within: Mapping[str, ArrayLike] | None = None,
) -> BatchReactions:
    """Return the reactions at many samples.

    Parameters
    ----------
    solver : ReactionSolver
        Of the robot.
    q : (N, nq) array
        Configurations, with closed loops. Samples that are not finite in `q` or `tau` are left out.
    v, a : (N, nv) array
        Velocities and accelerations.
    tau : (N, n_actuated) array
        Forces of the actuated joints that produce the motion [N or N m].
    external : mapping of str to (6,) or (N, 6) array, optional
        Wrenches that act on frames, in world axes [N, N m].
    joint_forces : (nv,) or (N, nv) array, optional
        What acts in the joints besides the actuators.
    within : mapping of str to (6,) or (N, 6) array, optional
        Those of `external` on a closure's `frame2` that its joint exerts itself, such as friction: they are
        counted in its reaction, and in the energy of elastic joints.

    Returns
    -------
    BatchReactions

    Raises
    ------
    ModelError, InputError
        As `ReactionSolver.solve`, or if the shapes do not fit.
    """
    return reactions_by_each([solver], q, v, a, tau, external, joint_forces, within)[0]


def reactions_by_each(
    solvers: Sequence[ReactionSolver],
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    tau: ArrayLike,
    external: Mapping[str, ArrayLike] | None = None,
    joint_forces: ArrayLike | None = None,
    within: Mapping[str, ArrayLike] | None = None,
) -> list[BatchReactions]:
    """Return what `reactions_batch` returns, by solvers of one robot that build its closures differently."""
    solver = solvers[0]
    model, rows = solver.loop.model, as_floats("q", q)
    if rows.ndim != 2 or rows.shape[1] != model.nq:
        raise InputError(f"q: expected shape (N, {model.nq}), got {rows.shape}")
    count = len(rows)
    forces = _each("tau", tau, count, len(solver.loop.actuated))
    motion = [_each(name, value, count, model.nv) for name, value in (("v", v), ("a", a))]
    loads = {name: _each(f"external {name}", load, count, 6) for name, load in (external or {}).items()}
    own = {name: _each(f"within {name}", load, count, 6) for name, load in (within or {}).items()}
    nothing = np.zeros(model.nv)
    acting = _each("joint_forces", nothing if joint_forces is None else joint_forces, count, model.nv)
    results = [_nothing(one.names, count) for one in solvers]
    known = np.isfinite(forces).all(axis=1) & np.isfinite(rows).all(axis=1)
    rows_known = np.flatnonzero(known)
    for block in (rows_known[some] for some in blocks(len(rows_known))):
        states = [
            solver.state(
                rows[i],
                motion[0][i],
                motion[1][i],
                forces[i],
                {name: load[i] for name, load in loads.items()},
                acting[i],
                {name: load[i] for name, load in own.items()},
            )
            for i in block.tolist()
        ]
        for one, result in zip(solvers, results, strict=True):
            result.put(one, block, one.solve_all(states))
    return results


def _nothing(names: tuple[str, ...], count: int) -> BatchReactions:
    shape = (count, len(names), 3)
    return BatchReactions(
        names,
        forces=np.full(shape, np.nan),
        moments=np.full(shape, np.nan),
        determined_forces=np.zeros(shape, dtype=bool),
        determined_moments=np.zeros(shape, dtype=bool),
        rotations=np.full((*shape, 3), np.nan),
        positions=np.full(shape, np.nan),
        undetermined=np.zeros(count, dtype=int),
        fit=np.full((count, 2, len(names), 2, 3), np.nan),
        errors={},
    )


def _each(name: str, value: ArrayLike, count: int, width: int) -> FloatArray:
    """Return (count, width) rows of a value that may be the same for all; they may hold NaN."""
    array = as_floats(name, value)
    if array.shape not in ((width,), (count, width)):
        raise InputError(f"{name}: expected shape ({count}, {width}), got {array.shape}")
    return np.broadcast_to(array, (count, width))
