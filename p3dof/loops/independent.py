"""Independent coordinates of a closed mechanism: which they are, and how the tree moves with them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, SingularityError
from p3dof.loops.closures import ClosurePoint
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition, actuation_of
from p3dof.loops.sidecar import suggestion

IndexArray: TypeAlias = NDArray[np.int_]

_TIE = 1e-9
"""Freedoms whose share in a free motion differs by less are alike; the first one counts."""
_KEPT = 1e-3
"""Conditioning from which on a choice is kept at another configuration."""


def coordinate_names(model: pin.Model) -> tuple[str, ...]:
    """Return a name for every entry of v: that of its joint, with an index if the joint has several."""
    return tuple(
        str(model.names[i]) if model.nvs[i] == 1 else f"{model.names[i]}[{k}]"
        for i in range(1, model.njoints)
        for k in range(model.nvs[i])
    )


def named_coordinates(model: pin.Model, names: Iterable[str] | str) -> IndexArray:
    """Return the entries of v that joints or single freedoms of joints have.

    Parameters
    ----------
    model : pin.Model
        The tree.
    names : iterable of str
        Names of joints, with all their freedoms, or of single freedoms, such as ``base[2]``.

    Returns
    -------
    (n,) array of int

    Raises
    ------
    InputError
        If a name does not exist or a freedom is named twice.
    """
    if not isinstance(names, Iterable):
        raise InputError(f"coordinates: expected names of joints, got {shown(names)}")
    all_names, chosen = coordinate_names(model), []
    for name in [names] if isinstance(names, str) else names:
        if isinstance(name, str) and name in all_names:
            chosen.append(all_names.index(name))
        elif isinstance(name, str) and model.existJointName(name) and model.getJointId(name):
            i = model.getJointId(name)
            chosen.extend(range(model.idx_vs[i], model.idx_vs[i] + model.nvs[i]))
        else:
            known = [*map(str, model.names[1:]), *all_names]
            raise InputError(
                f"coordinates: the joint {shown(name)} does not exist; {suggestion(str(name), known)}"
            )
    if len(set(chosen)) < len(chosen):
        twice = next(all_names[k] for k in chosen if chosen.count(k) > 1)
        raise InputError(f"coordinates: {shown(twice)} is named twice")
    return np.array(chosen, dtype=int)


def pivoted(N: FloatArray, first: IndexArray) -> IndexArray:
    """Choose freedoms that determine a motion, those with the largest share in what is left open first.

    Parameters
    ----------
    N : (nv, n) array
        Orthonormal free motions.
    first : (m,) array of int
        The freedoms to prefer.

    Returns
    -------
    (n,) array of int
        Ascending among `first`, then ascending.
    """
    left = N.copy()
    parts: list[list[int]] = []
    for candidates in (np.sort(first), np.setdiff1d(np.arange(len(N)), first)):
        chosen: list[int] = []
        while len(chosen) + sum(len(part) for part in parts) < N.shape[1]:
            size = np.linalg.norm(left[candidates], axis=1)
            largest = size.max(initial=0.0)
            if largest <= RANK_TOLERANCE ** (0.5 if not parts else 1.0):
                break
            pick = candidates[int(np.argmax(size >= (1.0 - _TIE) * largest))]
            row = left[pick] / np.linalg.norm(left[pick])
            left = left - np.outer(left @ row, row)
            chosen.append(int(pick))
        parts.append(sorted(chosen))
    return np.array([*parts[0], *parts[1]], dtype=int)


def default_coordinates(
    point: ClosurePoint, actuated: IndexArray, preferred: Callable[[], IndexArray | None]
) -> IndexArray:
    """Return the actuated freedoms, in their order, where they determine the motion; else a choice.

    Parameters
    ----------
    point : ClosurePoint
        The closures at the configuration.
    actuated : (m,) array of int
        The actuated freedoms.
    preferred : callable
        Returns a choice made elsewhere, to keep where it is good, or None.

    Returns
    -------
    (n,) array of int
    """
    N = point.svd.null_space
    if len(actuated) == N.shape[1] == actuation_of(point.svd, actuated).rank:
        return actuated
    choice = preferred()
    if choice is not None and len(choice) == N.shape[1]:
        s = np.linalg.svd(N[choice], compute_uv=False)
        if s.min(initial=1.0) > _KEPT:
            return choice
    return pivoted(N, actuated)


@dataclass(frozen=True, eq=False)
class Independent:
    """How the tree moves with independent coordinates, at one configuration: v = N ẏ.

    Parameters
    ----------
    v : (n,) array of int
        The coordinates' entries of v.
    names : tuple of str
        Their names.
    point : ClosurePoint
        The closures at the configuration.

    Raises
    ------
    SingularityError
        If the coordinates do not determine the motion.
    InputError
        If there are more than free motions.
    """

    v: IndexArray
    names: tuple[str, ...]
    point: ClosurePoint

    def __post_init__(self) -> None:
        mobility = self.point.svd.null_space.shape[1]
        if len(self.v) > mobility:
            raise InputError(
                f"coordinates: {len(self.v)} are given, and the mechanism has {mobility} free motions here"
            )
        seen = Decomposition.of(self.point.svd.null_space[self.v], RANK_TOLERANCE, 1.0)
        if seen.rank < mobility:
            raise SingularityError(
                f"the coordinates {', '.join(self.names) or '(none)'} do not determine the motion here: they "
                f"see {seen.rank} of {mobility} free motions"
            )

    @cached_property
    def _inverse(self) -> FloatArray:
        N = self.point.svd.null_space
        return np.asarray(np.linalg.inv(N[self.v]))

    @cached_property
    def N(self) -> FloatArray:  # noqa: N802
        """The motions (nv, n) of the tree at unit speed of each coordinate."""
        N = self.point.svd.null_space @ self._inverse
        N[self.v] = np.eye(len(self.v))
        return N

    @cached_property
    def closing(self) -> FloatArray:
        """The matrix (nv, rows) from what the closures do to the motion that does it, coordinates at rest."""
        pinv = self.point.svd.pseudo_inverse
        return pinv - self.N @ pinv[self.v]
