"""How near closures are to becoming dependent."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops.loop_model import LoopModel


def closure_conditioning(loop: LoopModel, q: FloatArray, rank: int) -> float:
    """Return how far the closures' Jacobian is from losing rank.

    Parameters
    ----------
    loop : LoopModel
        The robot; of one that is computed in a unit of length of its own, the Jacobian is in that unit.
    q : (nq,) array
        Configuration.
    rank : int
        The rank that it may lose.

    Returns
    -------
    float
        The singular value of this number, the largest being 1; infinite if the rank is zero.
    """
    if not rank:
        return np.inf
    if loop._scaled is not None:
        return closure_conditioning(loop._scaled.core, loop._scaled.q(q), rank)
    s = np.linalg.svd(loop.closure_jacobian(q), compute_uv=False)
    return float(s[rank - 1] / s[0])
