"""Which parameters of the legs a calibration from measured poses can find."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances.directions import AnyMachine, parameters_of
from p3dof.analysis.tolerances.pose import NAMES, checked_pose, pose_gradient

_NONE = 1e-10  # share of the largest singular value below which one is zero


@dataclass(frozen=True, eq=False)
class Identifiability(Readable):
    """What measured poses tell of the parameters of the legs."""

    rank: int  # how many combinations of the twelve parameters they tell
    condition: float
    """Largest over smallest singular value of these, columns scaled to one: errors of measured poses grow
    by so much at worst."""
    singular_values: FloatArray  # (12,): of the scaled columns
    unseen: tuple[str, ...]
    """Combinations that change no pose, such as `R.a + r.a`: these parameters grow together."""
    null_space: FloatArray
    """(12 - rank, 12): the same as numbers, in the order of `R.a, r.a, L.a, encoder.a, R.b`."""


def identifiability(robot: AnyMachine, pose: ArrayLike) -> Identifiability:
    """Return which parameters of the legs a calibration from measured poses can find.

    Sliders are read, the pose of the platform is measured: each pose tells three numbers.

    Parameters
    ----------
    robot : Manipulator, Parameters or None
        The nominal machine; the paper's for None.
    pose : array-like, shape (K, 3)
        Where it is measured: y [m], z [m], θ [rad].

    Raises
    ------
    InputError
        If there are less than four poses, which could not tell twelve numbers.
    ReachError, SingularityError
        If the machine cannot be at a pose.
    """
    geometry = parameters_of(robot).geometry
    poses = checked_pose(geometry, pose).reshape(-1, 3)
    if len(poses) < 4:
        raise InputError(f"pose: expected four poses or more for twelve parameters, got {len(poses)}")
    rows = pose_gradient(geometry, poses).reshape(-1, len(NAMES))
    sizes = np.linalg.norm(rows, axis=0)
    _, values, directions = np.linalg.svd(rows / sizes, full_matrices=False)
    rank = int((values > _NONE * values[0]).sum())
    null = _reduced(directions[rank:] / sizes)
    return Identifiability(
        rank, float(values[0] / values[rank - 1]), values, tuple(map(_in_words, null)), null
    )


def _reduced(rows: FloatArray) -> FloatArray:
    """Return the same space in rows with a leading one, each alone in its column."""
    found = rows.copy()
    done = 0
    for column in range(found.shape[1]):
        if done == len(found):
            break
        best = done + int(np.abs(found[done:, column]).argmax())
        if abs(found[best, column]) <= 1e-6 * np.abs(found[done:]).max():
            continue
        found[[done, best]] = found[[best, done]]
        found[done] /= found[done, column]
        others = np.arange(len(found)) != done
        found[others] -= np.outer(found[others, column], found[done])
        done += 1
    return found


def _in_words(row: FloatArray) -> str:
    told = ""
    for name, number in zip(NAMES, row.tolist(), strict=True):
        if abs(number) < 1e-6:
            continue
        size = "" if abs(abs(number) - 1) < 1e-6 else f"{abs(number):.3g} "
        sign = ("-" if number < 0 else "") if not told else (" - " if number < 0 else " + ")
        told += f"{sign}{size}{name}"
    return told
