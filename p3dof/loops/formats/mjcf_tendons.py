"""Tendons of an MJCF: their equalities are couplings and rods, and what pulls at some joints is a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import ModelError
from p3dof.loops.constraints import check_couplings
from p3dof.loops.sidecar import Closure, Coupling

_LINEAR = 2
"""Coefficients of a polynomial of degree one."""


@dataclass(frozen=True)
class Tendon:
    """A tendon.

    Parameters
    ----------
    name : str
        What to call it.
    start : float
        Its length at ``qpos0`` [m or rad].
    joints : mapping of str to float
        Of a fixed tendon, its joints and how much of each its length is.
    sites : tuple of int
        Of a straight tendon between two sites, these.
    """

    name: str
    start: float
    joints: Mapping[str, float]
    sites: tuple[int, ...] = ()


def tendon(m: Any, number: int, name: str, joints: Sequence[str]) -> Tendon:
    """Return a tendon of a compiled model; one that is neither fixed nor straight has nothing in it.

    Parameters
    ----------
    m : mujoco.MjModel
        The model.
    number : int
        Which one.
    name : str
        What to call it.
    joints : sequence of str
        Names of all joints.

    Returns
    -------
    Tendon
    """
    import mujoco

    parts = range(m.tendon_adr[number], m.tendon_adr[number] + m.tendon_num[number])
    kinds = {mujoco.mjtWrap(int(m.wrap_type[part])) for part in parts}
    start = float(m.tendon_length0[number])
    if kinds == {mujoco.mjtWrap.mjWRAP_JOINT}:
        terms: dict[str, float] = {}
        for part in parts:
            joint = joints[m.wrap_objid[part]]
            terms[joint] = terms.get(joint, 0.0) + float(m.wrap_prm[part])
        return Tendon(name, start, {joint: factor for joint, factor in terms.items() if factor})
    straight = kinds == {mujoco.mjtWrap.mjWRAP_SITE} and len(parts) == 2
    return Tendon(name, start, {}, tuple(int(m.wrap_objid[part]) for part in parts) if straight else ())


def tied(
    name: str,
    one: Tendon,
    other: Tendon | None,
    polynomial: Sequence[float],
    sites: Sequence[str],
    others: Sequence[Coupling],
) -> Closure | Coupling:
    """Return what an equality of tendons is: length1 - start1 = p(length2 - start2).

    Parameters
    ----------
    name : str
        What to call the equality.
    one, other : Tendon
        The tendons; the second may be none.
    polynomial : sequence of float
        The coefficients of p.
    sites : sequence of str
        The frames of all sites.
    others : sequence of Coupling
        The couplings that there are already.

    Returns
    -------
    Closure or Coupling
        A rod between two sites; or a coupling of the joints of fixed tendons.

    Raises
    ------
    ModelError
        If it is neither.
    """
    if one.sites and other is None:
        first, second = (sites[site] for site in one.sites)
        return Closure(first, second, "distance", one.start + polynomial[0])
    if not one.joints or (other is not None and not other.joints):
        raise ModelError(
            f"MJCF: the equality {shown(name)} ties tendons that are neither fixed nor, one alone, straight "
            "between two sites: it is not understood"
        )
    p = np.polynomial.Polynomial([polynomial[0]])
    if other is not None:
        p = np.polynomial.Polynomial(polynomial).trim()
    joints, start = dict(one.joints), one.start
    if other is not None and len(p.coef) == _LINEAR:  # all joints on one side
        for joint, factor in other.joints.items():
            joints[joint] = joints.get(joint, 0.0) - p.coef[1] * factor
        constant = start + p.coef[0] - p.coef[1] * other.start
        return _coupling(name, {j: f for j, f in joints.items() if f}, None, np.array([constant]), others)
    if other is None or len(p.coef) == 1:
        return _coupling(name, joints, None, np.array([start + p.coef[0]]), others)
    if len(other.joints) > 1:
        raise ModelError(
            f"MJCF: the equality {shown(name)} is a polynomial in the length of a tendon over "
            f"{len(other.joints)} joints, which is not understood"
        )
    ((leader, factor),) = other.joints.items()
    return _coupling(
        name, joints, leader, (p(np.polynomial.Polynomial([-other.start, factor])) + start).coef, others
    )


def _coupling(
    name: str, joints: Mapping[str, float], leader: str | None, constant: Any, others: Sequence[Coupling]
) -> Coupling:
    """Return Σ factor q = constant, or that polynomial in the value of the leader, solved for some joint."""
    failed = None
    for joint, factor in joints.items():
        rest = {other: -f / factor for other, f in joints.items() if other != joint}
        coefficients = [float(c) / factor for c in constant]
        on = leader
        if leader is None and rest:
            on = next(iter(rest))
            coefficients.append(rest.pop(on))
        try:
            found = Coupling(joint, on, tuple(coefficients), name, tuple(rest.items()))
            check_couplings("MJCF", [*others, found])
        except ModelError as error:
            failed = error
        else:
            return found
    raise failed or ModelError(f"MJCF: the equality {shown(name)} ties no joint")


def pulled(one: Tendon) -> Coupling:
    """Return what makes the joint of a fixed tendon have its length.

    Parameters
    ----------
    one : Tendon
        The tendon, with the name of the joint.

    Returns
    -------
    Coupling
    """
    (first, factor), *rest = one.joints.items()
    return Coupling(one.name, first, (0.0, factor), f"tendon {one.name}", tuple(rest))
